"""Fig. 8: At each step a run is in some sets of the look-up table, and the one of fewest steps to go is used."""

from itertools import pairwise

import numpy as np
from common import Context, command_of
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import ConnectionPatch

from sdhj import plotting
from sdhj.common.remembering import FloatArray
from sdhj.plotting.looks import OUTCOME_INK
from sdhj.simulation.runs import Trajectory
from sdhj.table.batches import Table

CELL = 49  # points along each side of a slice
LEFT, TOP, SIZE, GAP = 0.105, 0.915, 0.087, 0.0095  # of the cells, in shares of the page
FAINT_UNSAFE = {"facecolor": "#e9e9e9", "edgecolor": "#9a9a9a", "linewidth": 0.5}
KEY = (
    "each cell: joint angles $q_1$ (across) and $q_2$ (up), from $-\\pi$ to $\\pi$,\n"
    "at where the pursuer is at step $k$ of the run\n"
    "coloured: $\\mathcal{S}_k^{N-n}$;  grey: unsafe at $t_k$\n"
    "dot: the arm;  frame: the leftmost set of its row that holds it\n"
    "$*$: the same as the last set of its row"
)


def value(context: Context) -> list[int]:
    """The steps to go of the run, step by step."""
    return [int(n) for n in context.run.steps_to_go]


def draw(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 7.0, layout="none")
    draw_lookup(figure, context.table("hji"), context.run)
    return figure


def draw_lookup(figure: Figure, table: Table, run: Trajectory) -> None:
    """The look-up table as small C-space slices and a run's way through it, for a figure of 7 by 7 inches.

    Row k is the step, column n the steps to go. Each row is sliced at where the agent was then in the run, so the dot,
    the joint angles at step k, lies in the framed set and in none to its left.
    """
    samples = run.samples
    promised = [int(n) for n in run.steps_to_go]
    if run.outcome == "reached":  # by the true target: S_k^N on the grid may miss its boundary
        promised.append(0)
    framed = []
    for k in range(table.steps + 1):
        state = samples[min(k, len(samples) - 1)]
        for n in range(table.steps + 1):
            x, y = LEFT + n * (SIZE + GAP), TOP - (k + 1) * SIZE - k * GAP
            ax = figure.add_axes((x, y, SIZE, SIZE))
            draw_cell(ax, table, state, k, n)
            if k < len(samples) and n <= table.steps - k:
                chosen = k < len(promised) and n == promised[k]
                draw_joints(ax, table, state, chosen)
                framed += [ax] if chosen else []
    draw_way(figure, framed)
    draw_margins(figure, table.steps)


def draw_cell(ax: Axes, table: Table, state: FloatArray, k: int, n: int) -> None:
    """The set of row k and column n on the slice through a state, with what is unsafe then; a star where it ends."""
    problem = table.problem
    where = plotting.plane(problem.grid, state, resolution=CELL)
    ax.set(xticks=[], yticks=[], xlim=where.x[[0, -1]], ylim=where.y[[0, -1]])
    if n > table.steps - k:
        ax.axis("off")
        if n == table.steps - k + 1:
            ax.text(0, 0, r"$*$", ha="center", va="center", color="#777777", fontsize=10)
        return
    ax.set_gid(f"cell-{k}-{n}")
    for part in problem.unsafe:
        values = where.shaped(part.level_set(where.points[:, part.axes], k * problem.delta))
        plotting.draw_set(ax, where, values, FAINT_UNSAFE, part.name, zorder=1.0)
    values = where.of(problem.grid, table.values(start=k, within=n))
    looks = {"facecolor": plotting.step_colours(table.steps)[n], "edgecolor": "#222222", "linewidth": 0.5}
    plotting.draw_set(ax, where, values, looks, "tube", zorder=2.0)
    for spine in ax.spines.values():
        spine.set(visible=True, linewidth=0.5, color="#9a9a9a")


def draw_joints(ax: Axes, table: Table, state: FloatArray, chosen: bool) -> None:
    """The joint angles as a dot, larger in the chosen cell, which is framed."""
    joints = np.where(table.grid.periodic, np.mod(state + np.pi, 2 * np.pi) - np.pi, state)[:2]
    looks = {"color": OUTCOME_INK, "markeredgecolor": "white", "markeredgewidth": 0.6, "zorder": 5}
    ax.plot(*joints, "o", markersize=4.2 if chosen else 2.0, **looks)
    if chosen:
        for spine in ax.spines.values():
            spine.set(linewidth=2.0, color=OUTCOME_INK)
        ax.set_zorder(2)


def draw_way(figure: Figure, framed: list[Axes]) -> None:
    """Arrows from each framed cell to the next."""
    looks = {"arrowstyle": "-|>,head_length=5,head_width=2.5", "mutation_scale": 1.0}
    looks |= {"color": OUTCOME_INK, "linewidth": 1.4, "zorder": 10}
    for first, second in pairwise(framed):
        frames = {"coordsA": "axes fraction", "coordsB": "axes fraction", "axesA": first, "axesB": second}
        figure.add_artist(ConnectionPatch((0.0, 0.0), (1.0, 1.0), **frames, **looks))


def draw_margins(figure: Figure, steps: int) -> None:
    """Numbers of the rows and columns, what they count, and the key."""
    for n in range(steps + 1):
        figure.text(LEFT + n * (SIZE + GAP) + SIZE / 2, TOP + 0.008, str(n), ha="center", va="bottom")
        figure.text(LEFT - 0.008, TOP - n * (SIZE + GAP) - SIZE / 2, str(n), ha="right", va="center")
    middle = (steps + 1) * (SIZE + GAP) / 2
    figure.text(LEFT + middle, TOP + 0.045, r"reach within ... steps ($n$)", ha="center", va="bottom", fontsize=9)
    figure.text(0.035, TOP - middle, r"from step ($k$)", ha="center", va="center", rotation=90, fontsize=9)
    figure.text(0.98, 0.06, KEY, ha="right", va="bottom", linespacing=1.6, color="#333333")


if __name__ == "__main__":
    command_of(__file__)()
