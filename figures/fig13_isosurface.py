"""Fig. 13: Over (q1, q2, p_x) the projected tube lies inside the full one, and lacks what is shown at the right."""

import numpy as np
from common import PURSUER_AT, Context, command_of
from matplotlib.figure import Figure
from surfaces import draw_isosurface

from sdhj import plotting
from sdhj.common.remembering import FloatArray
from sdhj.plotting.looks import OUTCOME_INK
from sdhj.table.batches import Table

COLOURS = {"full": "#6aa6d6", "projected": "#46ab9f", "lost": OUTCOME_INK}


def value(context: Context) -> float:
    """The share of C that is lost."""
    lost = compared(context.table("hji"), context.table("projected"))["lost"]
    return context.problem.grid.fraction(lost <= 0)


def draw(context: Context) -> Figure:
    figure, full = plotting.new_figure(7.0, 2.6, layout="none"), context.table("hji")
    for place, (name, tube) in enumerate(compared(full, context.table("projected")).items()):
        ax = figure.add_axes((0.325 * place, 0.0, 0.325, 0.94), projection="3d")
        ax.patch.set_visible(False)
        draw_isosurface(ax, full, through=PURSUER_AT, colour=COLOURS[name], tube=tube, gid=name)
        ax.set_title(f"{name}: {full.grid.fraction(tube <= 0):.1%} of $\\mathcal{{C}}$", y=0.97)
    said = f"within {context.problem.steps} steps, $p_y$ = {PURSUER_AT[3]:.2f} m"
    figure.text(0.5, 0.985, said, ha="center", va="top")
    return figure


def compared(full: Table, inner: Table) -> dict[str, FloatArray]:
    """Level-set functions of the largest tubes of two tables, and of what the second has lost of the first."""
    ours, theirs = (table.values(start=0, within=table.steps) for table in (full, inner))
    return {"full": ours, "projected": theirs, "lost": np.maximum(ours, -theirs)}


if __name__ == "__main__":
    command_of(__file__)()
