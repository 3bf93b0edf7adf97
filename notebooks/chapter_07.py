"""The recursion and the look-up table, in the plane."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from chapter_04 import draw_plane_game, point_robot
from live_slices import HERE, LIVE, draw_pixels, fewest_steps, slice_values
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from widgets import Explorer, Numbers, slider

import sdhj
from sdhj.arm.workspace import Disk, Line
from sdhj.plotting import plane, step_colours
from sdhj.plotting.looks import OUTCOME_INK
from sdhj.table.batches import Table


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


def explore_row(table: Table) -> Explorer:
    """A row of the look-up table: every tube from one step, and the leftmost one that holds a point you place."""

    def draw(figure: Figure, start: int, x: float, y: float) -> Numbers:
        return draw_row(figure.subplots(), table, start=start, point=(x, y))

    controls = {
        "start": slider("start, step k", 0, table.steps, 1, 0),
        "x": slider("x (m)", -1.0, 1.0, 0.05, -0.3),
        "y": slider("y (m)", -1.0, 1.0, 0.05, 0.3),
    }
    return Explorer(
        draw, controls, size=(8.6, 2.1), alt="A row of tubes, the leftmost that holds the point framed", motion="x"
    )


def explore_plane_game(nodes: int = 41) -> Explorer:
    """The point robot's whole game, solved at each change: adversary, sampling interval, inputs, obstacle."""

    @lru_cache(maxsize=32)
    def solved(v_max: float, delta: float, input_levels: int, obstacle_x: float, obstacle_speed: float) -> Table:
        obstacle = Disk(Line((obstacle_x, -0.45), (0.0, obstacle_speed)), 0.16)
        problem = point_robot(nodes, 4, delta=delta, v_max=v_max, input_levels=input_levels, obstacle=obstacle)
        return sdhj.solve(problem, progress=False)

    def draw(figure: Figure, start: int, **game: Any) -> Numbers:
        table, ax = solved(**game), figure.subplots()
        draw_plane_game(ax, table, start=start)
        ax.set_title(f"from step {start}, t = {table.problem.time(start):.2f} s")
        return {f"within {n}": table.fraction(start=start, within=n) for n in range(4 - start + 1)}

    controls = {
        "v_max": slider("adversary's speed (m/s)", 0.0, 0.9, 0.05, 0.25, live=False),
        "delta": slider("sampling interval (s)", 0.05, 0.4, 0.05, 0.2, live=False),
        "input_levels": slider("input levels on each axis", 2, 5, 1, 3, live=False),
        "obstacle_x": slider("obstacle's x (m)", -0.8, 0.1, 0.05, -0.15, live=False),
        "obstacle_speed": slider("obstacle's speed (m/s)", 0.0, 1.0, 0.05, 0.5, live=False),
        "start": slider("start, step k", 0, 4, 1, 0),
    }
    return Explorer(draw, controls, size=(4.8, 3.9), slow=True, alt="Tubes of the point robot", motion="v_max")
