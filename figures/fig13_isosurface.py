"""Fig. 13: full and projected tubes over (q1, q2, p_x)."""

from common import PURSUER_AT, Context, command_of
from matplotlib.figure import Figure
from surfaces import draw_isosurface

from sdhj import plotting


def draw(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 3.6, layout="none")
    for place, (method, name, colour) in enumerate((("hji", "full", "#6aa6d6"), ("projected", "projected", "#46ab9f"))):
        ax = figure.add_axes((0.49 * place, 0.0, 0.49, 0.94), projection="3d")
        ax.patch.set_visible(False)
        draw_isosurface(ax, context.table(method), through=PURSUER_AT, colour=colour)
        ax.set_title(f"{name}: {context.shares(method)[-1]:.1%} of $\\mathcal{{C}}$", y=0.97)
    said = f"within {context.problem.steps} steps, $p_y$ = {PURSUER_AT[3]:.2f} m"
    figure.text(0.5, 0.985, said, ha="center", va="top")
    return figure


if __name__ == "__main__":
    command_of(__file__)()
