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

UNSAFE_PINK, NOTHING = (0.965, 0.741, 0.659, 1.0), (1.0, 1.0, 1.0, 0.0)


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


def filling(steps: int) -> list[tuple[int, int | None]]:
    """What the library makes, in its order: (k, None), the walls of row k, and (k, n), a tube of it; (7.1)."""
    made: list[tuple[int, int | None]] = []
    for k in range(steps, -1, -1):
        made += [(k, None)] if k < steps else []
        made += [(k, n) for n in range(steps - k + 1)]
    return made


def draw_filling(ax: Axes, table: Table, made: int) -> Numbers:
    """The look-up table after so many of `filling`: the newest framed, and dashed the two that it was made from."""
    done, grid, gap = filling(table.steps)[:made], table.grid, 0.18
    k_now, n_now = done[-1] if done else (None, None)
    sources = {(k_now, n_now - 1), (k_now + 1, n_now - 1)} if n_now and k_now is not None else set()
    where, side = plane(grid, (0.0, 0.0), resolution=LIVE // 2), grid.upper[0] - grid.lower[0]
    colours = np.array([*step_colours(table.steps), UNSAFE_PINK, NOTHING])
    for k in range(table.steps + 1):
        blank = (k, None) not in done and (k, 0) not in done  # nothing of this row is known yet
        hit = where.shaped(table.problem.unsafe_value(where.points, table.problem.time(k))) <= 0
        for n in range(table.steps - k + 1):
            left, low = n * (side + gap), (table.steps - k) * (side + gap)
            places = np.where(hit & (not blank), -2, -1)
            if (k, n) in done:
                values = slice_values(grid, table.values(start=k, within=n), (0, 0), (0, 1), where.x, where.y)
                places[values <= 0] = n
            draw_pixels(ax, colours[places], (left, left + side, low, low + side), f"tube-{k}-{n}")
            now = k == k_now and n_now in (n, None)
            looks = {"edgecolor": OUTCOME_INK if now else INK if (k, n) in sources else "#9a9a9a"}
            looks |= {"linewidth": 2.4 if now else 1.8 if (k, n) in sources else 0.6}
            looks |= {"linestyle": "--" if (k, n) in sources else "-", "zorder": 4.0 if now else 3.0}
            ax.add_patch(Rectangle((left, low), side, side, facecolor="none", gid=f"cell-{k}-{n}", **looks))
        ax.text(-gap, (table.steps - k) * (side + gap) + side / 2, f"k = {k}", ha="right", va="center")
        ax.text(k * (side + gap) + side / 2, -gap, f"n = {k}", ha="center", va="top")
    far = (table.steps + 1) * (side + gap)
    ax.set(xlim=(-0.45 * side, far), ylim=(-0.3 * side, far), aspect="equal")
    ax.axis("off")
    tubes = [(k, n) for k, n in done if n is not None]
    newest = "nothing" if not done else f"walls of row {k_now}" if n_now is None else f"tube k = {k_now}, n = {n_now}"
    return {
        "made last": newest,
        "tubes": len(tubes),
        "games to reach": len(table.problem.inputs) * sum(n > 0 for _, n in tubes),
        "games to avoid": len(table.problem.inputs) * (len(done) - len(tubes)),
    }


def draw_row(ax: Axes, table: Table, *, start: int, point: Sequence[float]) -> Numbers:
    """A row of the look-up table: the tubes from step `start`, the leftmost one that holds `point` framed."""
    most, gap, grid = table.steps - start, 0.15, table.grid
    colours = np.array([NOTHING, UNSAFE_PINK])
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
