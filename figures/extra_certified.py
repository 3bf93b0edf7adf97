"""The more cells there are, the larger is the share of the states that is certified."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from charts import METHOD_LOOKS, METHOD_NAMES, SHARE
from common import PURSUER_AT, Context, command_of
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

import sdhj
from sdhj import plotting
from sdhj.common.remembering import FloatArray
from sdhj.plotting.looks import FULL_LOOKS, INK, INNER_LOOKS, State
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.table.batches import Table

MAIN_JOB = False
LABELS = ("certified", "not certified", "outside")
LABEL_COLOURS = (INNER_LOOKS["facecolor"], "#f2c14e", "#ffffff")  # of `LABELS`; they differ in greyscale too
CELLS = ((42, 42, 12, 12), (84, 84, 36, 36), (210, 210, 36, 36), (210, 210, 72, 72), (419, 419, 72, 72))


@dataclass(frozen=True)
class CellSweep:
    """What is certified with more and more cells.

    Attributes
    ----------
    numbers : tuple of int
        Cells of the whole state space.
    fractions : tuple of float
        Certified share of the grid, from step 0 within all steps.
    finest : Table
    """

    numbers: tuple[int, ...]
    fractions: tuple[float, ...]
    finest: Table


def sweep_cells(problem: ReachAvoidProblem, cells: Sequence[Sequence[int]], say: Callable[[str], Any]) -> CellSweep:
    """Certify a problem with each of `cells`, as the certified method takes them; `say` receives progress lines."""
    numbers, fractions = [], []
    for each in cells:
        say(f"certifying with {' x '.join(map(str, each))} cells")
        finest = sdhj.solve(problem, sdhj.Certified(cells=each))
        numbers.append(int(np.prod(finest.details["cells"], dtype=np.int64)))
        fractions.append(finest.fraction(start=0, within=problem.steps))
    return CellSweep(tuple(numbers), tuple(fractions), finest)


def value(context: Context) -> list[float]:
    """The shares of C that are certified with few cells and with more."""
    return list(sweep_cells(context.problem, CELLS[:2], context.say).fractions)


def draw(context: Context) -> Figure:
    sweep = sweep_cells(context.problem, CELLS[:2] if context.coarse else CELLS, context.say)
    peers = {method: context.shares(method)[-1] for method in ("hji", "lax", "projected")}
    figure = plotting.new_figure(7.0, 3.7)
    left, right = figure.subplots(1, 2, width_ratios=(1.15, 1.0))
    draw_cells(left, sweep, peers)
    left.set_title(f"full, Hopf-Lax, projected: {context.nodes} nodes an axis", fontsize=8)
    draw_labels(right, context.table("hji"), sweep.finest, through=PURSUER_AT)
    right.set_title(f"pursuer at ({PURSUER_AT[2]:.2f}, {PURSUER_AT[3]:.2f}) m; line: interpolated tube", fontsize=8)
    edge: dict[str, Any] = {"edgecolor": INK, "linewidth": 0.6}
    entries = [Patch(facecolor=c, label=label, **edge) for c, label in zip(LABEL_COLOURS, LABELS, strict=True)]
    figure.legend(handles=entries, loc="outside upper right", ncols=3)
    return figure


def labels(table: Table, certified: Table, states: FloatArray) -> FloatArray:
    """The index in LABELS of each of the states (M, ndim), (M,) int: proved, in the table's tube alone, or in neither.

    table, certified : an interpolated and the certified table of one game.
    """
    claimed = table.contains(states, within=table.steps)
    return np.where(certified.contains(states, within=table.steps), 0, np.where(claimed, 1, 2))


def draw_labels(ax: Axes, table: Table, certified: Table, *, through: State, resolution: int = 121) -> None:
    """Colour a slice by `LABELS`, which part of the table's tube is certified, and outline the table's tube."""
    where = plotting.plane(table.grid, through, resolution=resolution)
    found = where.shaped(labels(table, certified, where.points))
    colours, norm = ListedColormap(LABEL_COLOURS), BoundaryNorm(np.arange(-0.5, len(LABELS)), len(LABELS))
    image = ax.pcolormesh(where.x, where.y, found, cmap=colours, norm=norm, shading="nearest", rasterized=True)
    image.set_gid("labels")
    outline = FULL_LOOKS | {"facecolor": "none", "edgecolor": INK}
    plotting.draw_set(ax, where, where.of(table.grid, table.values()), outline, "tube", 3.0)
    plotting.frame_slice(ax, table.grid)


def draw_cells(ax: Axes, sweep: CellSweep, claimed: Mapping[str, float]) -> None:
    """Certified share of C against the number of cells, beside what interpolated tables of methods claim."""
    for method, fraction in claimed.items():
        looks = {key: METHOD_LOOKS[method][key] for key in ("color", "linestyle")}
        ax.axhline(fraction, gid=f"claimed-{method}", label=f"{METHOD_NAMES[method]}, claimed: {fraction:.3f}", **looks)
    ax.semilogx(sweep.numbers, sweep.fractions, gid="certified", label="certified", **METHOD_LOOKS["certified"])
    for number, fraction in zip(sweep.numbers, sweep.fractions, strict=True):
        ax.annotate(f"{fraction:.3f}", (number, fraction), (-4, 4), textcoords="offset points", fontsize=7, ha="right")
    ax.set(xlabel="cells", ylabel=SHARE, ylim=(0, None))
    ax.margins(x=0.15)
    ax.grid(axis="y")
    ax.legend(loc="lower right")


if __name__ == "__main__":
    command_of(__file__)()
