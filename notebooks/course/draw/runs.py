"""Runs of the arm, moment by moment, and the rows of the look-up table that its controller reads."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.patches import Rectangle

from course.draw.slices import (
    HERE,
    LIVE,
    around,
    colours_of,
    draw_arm_live,
    draw_pixels,
    draw_sets_quickly,
    fewest_steps,
    here,
    slice_values,
    steps_image,
)
from sdhj.arm.case_studies import scene
from sdhj.kernels import FloatArray
from sdhj.plotting import draw_path, plane
from sdhj.plotting.looks import FULL_LOOKS, OUTCOME_INK
from sdhj.plotting.trajectories import WAY
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.table.batches import Table


def draw_live_moment(axes: Sequence[Axes], table: Table, run: Any, index: int, *, tube: bool = True) -> None:
    """As `sdhj.plotting.draw_moment`, without formulas and hatching; the whole run is there, faint."""
    (left, right), problem = axes, table.problem
    state, time = run.states[index], float(run.times[index])
    step = min(int(time / problem.delta + 1e-6), max(len(run.inputs) - 1, 0))
    n = int(run.steps_to_go[step]) if len(run.inputs) else 0
    draw_arm_live(left, problem, state, time)
    left.set_title(f"t = {time:.2f} s, step {step}")
    if tube:
        where = plane(problem.grid, state, resolution=LIVE)
        goal = {"start": step + 1, "within": max(n - 1, 0)} if len(run.inputs) else {"start": 0, "within": 0}
        inside = slice_values(problem.grid, table.values(**goal), state, (0, 1), where.x, where.y) <= 0
        image = np.array([(1.0, 1.0, 1.0, 0.0), to_rgba(FULL_LOOKS["facecolor"])])[inside.astype(int)]
        draw_pixels(right, image, around(where.x, where.y), "tube")
    draw_sets_quickly(right, problem, through=state, step=time / problem.delta, resolution=81)
    draw_way((left, right), problem, run)
    done = run.states[: index + 1]
    left.plot(*scene(problem).arm.tip(done[:, :2]).T, zorder=6, gid="tip-path", **WAY)
    draw_path(right, problem.grid, done)
    right.plot(*here(problem.grid, state), **HERE)
    right.set_title(f"{n} step{'' if n == 1 else 's'} to go" if index < len(run.times) - 1 else run.outcome)


def draw_way(axes: Sequence[Axes], problem: ReachAvoidProblem, run: Any) -> None:
    """The whole run, faint, over the pictures of one moment: which run it is shows at every moment."""
    left, right = axes
    tips = scene(problem).arm.tip(run.states[:, :2])
    looks = {"color": OUTCOME_INK, "linewidth": 0.8, "alpha": 0.45, "zorder": 5.5}
    left.plot(*tips.T, linestyle="-", gid="whole-tip-path", **looks)
    left.plot(*run.states[:, 2:4].T, linestyle=":", gid="whole-agent-path", **looks | {"color": "black"})
    draw_path(right, problem.grid, run.states, gid="whole-path", **looks)


CELL = 45  # points along each side of a cell
GAP = 5  # points between two cells
BARE = (1.0, 1.0, 1.0, 0.0)


def row_image(table: Table, state: Sequence[float], start: int) -> tuple[FloatArray, int | None]:
    """Row `start` of the table as one picture of cells, and the column of the leftmost set that holds the state."""
    most, grid, colours = table.steps - start, table.grid, colours_of(table.steps)
    fewest = steps_image(table, through=state, start=start, within=most, resolution=CELL)
    where = plane(grid, state, resolution=CELL)
    unsafe = where.shaped(table.problem.unsafe_value(where.points, table.problem.time(start))) <= 0
    image = np.full((CELL + GAP, (table.steps + 1) * (CELL + GAP), 4), BARE)
    for n in range(most + 1):
        cell = np.where(unsafe[..., None], (0.91, 0.91, 0.91, 1.0), (0.985, 0.985, 0.985, 1.0))
        cell[fewest <= n] = colours[n]
        image[:CELL, n * (CELL + GAP) : n * (CELL + GAP) + CELL] = cell
    held = fewest_steps(table, state, start, most)
    return image, None if np.isnan(held) else int(held)


def draw_rows(ax: Axes, table: Table, states: Mapping[int, Sequence[float]]) -> dict[int, int | None]:
    """Rows of the look-up table from the top down, each through a state, which is dotted; its set is framed."""
    found, images, grid, side = {}, [], table.grid, CELL + GAP
    for place, (start, state) in enumerate(states.items()):
        image, found[start] = row_image(table, state, start)
        images.insert(0, image)
        bottom = -(place + 1) * side
        dot = (here(grid, state) - grid.lower[:2]) / (np.array(grid.upper[:2]) - grid.lower[:2]) * CELL
        columns = side * np.arange(table.steps - start + 1)
        looks = HERE | {"linestyle": "none", "markersize": 3.2, "markeredgewidth": 0.4}
        ax.plot(columns + dot[0], np.full(len(columns), bottom + dot[1]), **looks)
        if (n := found[start]) is not None:
            looks = {"facecolor": "none", "edgecolor": OUTCOME_INK, "linewidth": 1.8, "gid": f"frame-{start}"}
            ax.add_patch(Rectangle((n * side, bottom), CELL, CELL, zorder=6.0, **looks))
    draw_pixels(ax, np.concatenate(images), (0, (table.steps + 1) * side, -len(images) * side, 0), "rows")
    ax.set(xlim=(-1, (table.steps + 1) * side), ylim=(-len(states) * side - 2, 1), aspect="equal")
    # labels of rows and columns as ticks, which a live figure draws once
    ax.set_yticks(-side * np.arange(len(states)) - GAP - CELL / 2, [f"k = {start}" for start in states])
    ax.set_xticks(side * np.arange(table.steps + 1) + CELL / 2, [f"n = {n}" for n in range(table.steps + 1)])
    ax.tick_params(length=0, top=False, labeltop=True, labelbottom=False)
    ax.spines[:].set_visible(False)
    return found
