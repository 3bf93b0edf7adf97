"""A car: a robot of one's own, from its equations to its controller."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from chapter_03 import away, draw_plane_game
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from widgets import Explorer, Numbers, angle, slider

from sdhj.arm.workspace import Disk, Still
from sdhj.grid import FloatArray, Grid
from sdhj.plotting import draw_path, plane
from sdhj.plotting.looks import INK
from sdhj.problem import Dynamics, ReachAvoidProblem, TargetSet, UnsafeSet
from sdhj.table import Table


def car(
    nodes: Sequence[int] = (33, 33, 32),
    steps: int = 5,
    *,
    delta: float = 0.25,
    speed: float = 1.0,
    turn: float = 2.0,
    wind: float = 0.15,
    target: Disk | None = None,
    obstacle: Disk | None = None,
) -> ReachAvoidProblem:
    """A car that cannot drive sideways: state (x, y, heading), dx/dt = speed * (cos, sin) + wind, dheading/dt = u.

    It has to reach a disk past a post. The edge of the map is unsafe: the grid ends there, the car would not.

    Parameters
    ----------
    nodes : 3 int
    steps : int
    delta : float
        Sampling interval, s.
    speed, turn, wind : float
        m/s, rad/s, and the bound of each component of the wind, m/s.
    """
    target = Disk(Still((0.55, 0.0)), 0.25) if target is None else target
    obstacle = Disk(Still((0.0, 0.0)), 0.18) if obstacle is None else obstacle

    def drift(q: FloatArray, u: FloatArray) -> FloatArray:
        return np.stack([speed * np.cos(q[:, 2]), speed * np.sin(q[:, 2]), np.full(len(q), u[0])], axis=1)

    def off_the_map(q: FloatArray, t: float) -> FloatArray:
        return 0.95 - np.abs(q).max(axis=1)

    return ReachAvoidProblem(
        grid=Grid((-1.0, -1.0, -np.pi), (1.0, 1.0, np.pi), nodes, (False, False, True), ("x", "y", "heading")),
        dynamics=Dynamics(
            inputs=np.array([[-turn], [0.0], [turn]]),
            drift=drift,
            gain=np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]]),
            bounds=np.array([wind, wind]),
        ),
        target=TargetSet((0, 1), away(target)),
        unsafe=(UnsafeSet((0, 1), away(obstacle), name="obstacles"), UnsafeSet((0, 1), off_the_map, name="edge")),
        delta=delta,
        steps=steps,
        name="car",
    )


def draw_car(ax: Axes, table: Table, *, heading: float, within: int | None = None) -> Numbers:
    """The car's tubes for one heading, with the heading as an arrow; north is up."""
    within = table.steps if within is None else within
    state = (0.0, 0.0, heading)
    draw_plane_game(ax, table, within=within, through=state)
    tip = 0.18 * np.array([np.cos(heading), np.sin(heading)])
    corner, arrow = np.array([-0.75, 0.75]), {"arrowstyle": "-|>", "color": INK, "linewidth": 2}
    ax.annotate("", tuple(corner + tip), tuple(corner - tip), arrowprops=arrow)
    where = plane(table.grid, state, resolution=121)
    inside = where.of(table.grid, table.values(start=0, within=within)) <= 0
    return {"share of places for this heading": float(inside.mean())}


def draw_plane_run(ax: Axes, table: Table, run: Any) -> None:
    """A run in the plane over the tubes it starts in."""
    draw_plane_game(ax, table, through=run.states[0])
    draw_path(ax, table.grid, run.states, marks=run.samples)


def explore_car(table: Table) -> Explorer:
    """The car's tubes, heading by heading."""

    def draw(figure: Figure, heading: float, within: int) -> Numbers:
        return draw_car(figure.subplots(), table, heading=heading, within=within)

    controls = {
        "heading": angle("heading (rad)", 0.0),
        "within": slider("within, steps to go n", 0, table.steps, 1, table.steps),
    }
    return Explorer(draw, controls, size=(4.8, 3.9), alt="Tubes of the car for one heading")
