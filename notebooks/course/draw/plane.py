"""Tubes of robots in the plane, rows of their look-up tables, and runs over them."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from course.draw.slices import HERE, LIVE, draw_pixels, fewest_steps, slice_values
from course.paper import boat
from course.widgets import Numbers
from sdhj.kernels import FloatArray
from sdhj.plotting import draw_constraints, draw_path, draw_set, draw_tubes, plane, step_colours
from sdhj.plotting.looks import FULL_LOOKS, INK, OUTCOME_INK, TARGET_LOOKS
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.table.batches import Table


def draw_plane_game(
    ax: Axes, table: Table, *, start: int = 0, within: int | None = None, through: Sequence[float] | None = None
) -> None:
    """Tubes of a robot with two axes of position, its target and its obstacle where they are at step `start`."""
    state = np.zeros(table.grid.ndim) if through is None else np.asarray(through, dtype=np.float64)
    draw_tubes(ax, table, through=state, start=start, within=within, unsafe=False)
    shown = [part.name for part in table.problem.unsafe if part.name != "edge"]
    draw_constraints(ax, table.problem, through=state, step=start, parts=shown)
    where = plane(table.grid, state, resolution=201)
    target = table.problem.target
    goal = where.shaped(target.level_set(where.points[:, target.axes], start * table.problem.delta))
    draw_set(ax, where, goal, TARGET_LOOKS | {"facecolor": "none"}, "target", zorder=5.0)
    ax.set_aspect("equal")


def draw_plane_games(figure: Figure, tables: Mapping[str, Table]) -> None:
    """Tubes of several games in the plane, side by side, from step 0."""
    axes = np.atleast_1d(figure.subplots(1, len(tables), sharey=True))
    for ax, (title, table) in zip(axes, tables.items(), strict=True):
        draw_plane_game(ax, table)
        ax.set_title(title)
    for ax in axes[1:]:
        ax.set_ylabel("")


def draw_safe_twice(ax: Axes, problem: ReachAvoidProblem, at_instants: FloatArray, always: FloatArray) -> None:
    """States of the boat that are safe at both ends of the interval (blue), and those of them that are hit between."""
    where = boat.draw_lake(ax, boat.OneStepGame(problem, at_instants, always, always))
    instants, tube = where.of(problem.grid, at_instants), where.of(problem.grid, always)
    draw_set(ax, where, instants, FULL_LOOKS, "at-instants", zorder=0.5)
    between = np.maximum(instants, -tube)
    draw_set(
        ax, where, between, {"facecolor": "#d9480f", "edgecolor": "#8a2b06", "linewidth": 0.8}, "between", zorder=0.8
    )


def draw_row(ax: Axes, table: Table, *, start: int, point: Sequence[float]) -> Numbers:
    """A row of the look-up table: the tubes from step `start`, the leftmost one that holds `point` framed."""
    most, gap, grid = table.steps - start, 0.15, table.grid
    colours = np.array([(1.0, 1.0, 1.0, 0.0), (0.965, 0.741, 0.659, 1.0)])
    where = plane(grid, point, resolution=LIVE)
    unsafe = where.shaped(table.problem.unsafe_value(where.points, start * table.problem.delta)) <= 0
    side = grid.upper[0] - grid.lower[0]
    first = fewest_steps(table, point, start, most)
    for n in range(most + 1):
        left = n * (side + gap)
        image = colours[unsafe.astype(int)]
        image[slice_values(grid, table.values(start=start, within=n), point, (0, 1), where.x, where.y) <= 0] = (
            step_colours(table.steps)[n]
        )
        chosen = n == first
        draw_pixels(ax, image, (left, left + side, 0, side), f"tube-{n}")
        width, colour, gid = (2.4, OUTCOME_INK, "frame") if chosen else (0.6, "#9a9a9a", f"cell-{n}")
        looks = {"facecolor": "none", "linewidth": width, "edgecolor": colour}
        ax.add_patch(Rectangle((left, 0), side, side, zorder=3.0, gid=gid, **looks))
        ax.plot(left + point[0] - grid.lower[0], point[1] - grid.lower[1], **HERE)
        ax.text(left + side / 2, side * 1.04, f"n = {n}", ha="center")
    ax.set(xlim=(-0.05, (table.steps + 1) * (side + gap)), ylim=(-0.05, side * 1.2), aspect="equal")
    ax.axis("off")
    return {"fewest steps to go": first, "tubes that hold the point": 0 if np.isnan(first) else most + 1 - int(first)}


def draw_plane_tubes(ax: Axes, table: Table, *, through: Sequence[float], within: int | None = None) -> None:
    """Tubes of a robot in the plane, with its target and its obstacles; the edge of the map is left out."""
    draw_tubes(ax, table, through=through, within=within, unsafe=False)
    shown = [part.name for part in table.problem.unsafe if part.name != "edge"]
    draw_constraints(ax, table.problem, through=through, parts=shown)
    where = plane(table.grid, through, resolution=201)
    target = table.problem.target
    goal = where.shaped(target.level_set(where.points[:, target.axes], 0.0))
    draw_set(ax, where, goal, TARGET_LOOKS | {"facecolor": "none"}, "target", zorder=5.0)
    ax.set_aspect("equal")


def draw_car(ax: Axes, table: Table, *, heading: float, within: int | None = None) -> Numbers:
    """The car's tubes for one heading, with the heading as an arrow; north is up."""
    within = table.steps if within is None else within
    state = (0.0, 0.0, heading)
    draw_plane_tubes(ax, table, within=within, through=state)
    tip = 0.18 * np.array([np.cos(heading), np.sin(heading)])
    corner, arrow = np.array([-0.75, 0.75]), {"arrowstyle": "-|>", "color": INK, "linewidth": 2}
    ax.annotate("", tuple(corner + tip), tuple(corner - tip), arrowprops=arrow)
    where = plane(table.grid, state, resolution=121)
    inside = where.of(table.grid, table.values(start=0, within=within)) <= 0
    return {"share of places for this heading": float(inside.mean())}


def draw_plane_run(ax: Axes, table: Table, run: Any) -> None:
    """A run in the plane over the tubes it starts in."""
    draw_plane_tubes(ax, table, through=run.states[0])
    draw_path(ax, table.grid, run.states, marks=run.samples)
