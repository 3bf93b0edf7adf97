"""A robot in the plane with a heading: its tubes for one heading, and a run over them."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from widgets import Explorer, Numbers, angle, slider

from sdhj.plotting import draw_constraints, draw_path, draw_set, draw_tubes, plane
from sdhj.plotting.looks import INK, TARGET_LOOKS
from sdhj.table.batches import Table


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


def explore_car(table: Table) -> Explorer:
    """The car's tubes, heading by heading."""

    def draw(figure: Figure, heading: float, within: int) -> Numbers:
        return draw_car(figure.subplots(), table, heading=heading, within=within)

    controls = {
        "heading": angle("heading (rad)", 0.0),
        "within": slider("within, steps to go n", 0, table.steps, 1, table.steps),
    }
    return Explorer(draw, controls, size=(4.8, 3.9), alt="Tubes of the car for one heading", motion="heading")
