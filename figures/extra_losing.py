"""Cells are proved to be won or proved to be lost, and of those between nothing is known.

Left the README's car at one heading, right the arm with the pursuer at one place, on cells as coarse as a picture
needs. The arm's functions are written in plain NumPy here, which intervals go through; `sdhj.arm` has compiled ones.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from common import PURSUER_AT, Context, command_of
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

import sdhj
from sdhj import plotting
from sdhj.arm.case_studies import OBSTACLES, TARGET
from sdhj.arm.workspace import Circle, Line
from sdhj.certified.table import lost_cells
from sdhj.kernels import FloatArray

MAIN_JOB = False
CELLS = {
    "car": ((26, 26, 37), (51, 51, 72)),
    "arm": ((30, 30, 8, 8), (42, 42, 12, 12)),
}  # a quick look, and a good one
COLOURS = {"won": "#2a8c82", "unknown": "#eceae4", "lost": "#c0504d"}
LENGTH, HALF_WIDTH, PURSUER = 0.15, 0.01, 0.04


def gap(cos: Any, sin: Any, x: Any, y: Any) -> Any:
    """Distance of (x, y) from a link at the origin: seen from the link, so that each coordinate occurs once."""
    along, across = cos * x + sin * y, cos * y - sin * x
    return np.hypot(along - np.clip(along, 0.0, LENGTH), across)


def clearance(q: Any, x: Any, y: Any) -> Any:
    """Distance from the links to points; that from the second in two frames, of which the larger bound holds."""
    first, second, both = q[:, 0], q[:, 1], q[:, 0] + q[:, 1]
    cos, sin = np.cos(first), np.sin(first)
    along, across = cos * x + sin * y, cos * y - sin * x
    one = gap(np.cos(both), np.sin(both), x - LENGTH * cos, y - LENGTH * sin)
    other = gap(np.cos(second), np.sin(second), along - LENGTH, across)
    return np.minimum(gap(cos, sin, x, y), np.maximum(one, other)) - HALF_WIDTH


def on_path(path: Any, t: Any) -> Any:
    if isinstance(path, Line):
        return path.start[0] + path.velocity[0] * t, path.start[1] + path.velocity[1] * t
    if isinstance(path, Circle):
        angle = path.rate * t + path.phase
        return path.centre[0] + path.radius * np.cos(angle), path.centre[1] + path.radius * np.sin(angle)
    return path.centre


def plain_arm(**options: Any) -> sdhj.ReachAvoidProblem:
    """The case study without its recipe: nothing tells that it is an arm."""

    def target(q: Any, t: Any) -> Any:
        x, y = on_path(TARGET.path, t)
        tip = [LENGTH * (turn(q[:, 0]) + turn(q[:, 0] + q[:, 1])) for turn in (np.cos, np.sin)]
        return np.hypot(tip[0] - x, tip[1] - y) - TARGET.radius

    unsafe = [sdhj.UnsafeSet((0, 1, 2, 3), lambda q, t: clearance(q, q[:, 2], q[:, 3]) - PURSUER, name="pursuer")]
    for k, disk in enumerate(OBSTACLES):
        apart = lambda q, t, disk=disk: clearance(q, *on_path(disk.path, t)) - disk.radius  # noqa: E731
        unsafe.append(sdhj.UnsafeSet((0, 1), apart, name=f"disk {k}"))
    problem = sdhj.arm_case_study(**options)
    return replace(problem, target=sdhj.TargetSet((0, 1), target), unsafe=unsafe, recipe={})


def car() -> sdhj.ReachAvoidProblem:
    """The README's: two speeds, three rates of turn, wind, a post."""

    def drift(q: FloatArray, u: FloatArray) -> FloatArray:
        return np.stack([u[0] * np.cos(q[:, 2]), u[0] * np.sin(q[:, 2]), np.full(len(q), u[1])], axis=1)

    inputs = [[speed, turn] for speed in (0.5, 1.0) for turn in (-2.0, 0.0, 2.0)]
    names = ["x (m)", "y (m)", "heading (rad)"]
    return sdhj.ReachAvoidProblem(
        grid=sdhj.Grid([-2, -2, -np.pi], [2, 2, np.pi], [41, 41, 32], [False, False, True], names),
        dynamics=sdhj.Dynamics(inputs, drift, [[1, 0], [0, 1], [0, 0]], [0.1, 0.1]),
        target=sdhj.TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 1.2, p[:, 1] - 0.8) - 0.4),
        unsafe=[sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0], p[:, 1]) - 0.4, name="post")],
        delta=0.25,
        steps=8,
    )


def value(context: Context) -> list[float]:
    """The shares of the car's states that are proved to be won and proved to be lost, on few cells."""
    table = sdhj.solve(car(), sdhj.Certified(cells=CELLS["car"][0]))
    return [one.fraction(start=0, within=table.steps) for one in (table, lost_cells(car(), table.axes))]


def draw(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 3.6)
    arm, which = sdhj.arm_case_study(), 0 if context.coarse else 1
    cases = (("car", car(), car(), (0.0,)), ("arm", arm, plain_arm(), PURSUER_AT[2:]))
    for ax, (name, problem, followed, through) in zip(figure.subplots(1, 2), cases, strict=True):
        context.say(f"both sides of the {name}")
        table = sdhj.solve(problem, sdhj.Certified(cells=CELLS[name][which]))
        draw_sides(ax, table, lost_cells(followed, table.axes), through)
    entries = [Patch(facecolor=colour, edgecolor="0.5", label=label) for label, colour in COLOURS.items()]
    figure.legend(handles=entries, loc="outside upper center", ncols=3)
    return figure


def draw_sides(ax: Axes, table: Any, losing: Any, through: tuple[float, ...]) -> None:
    """The cells of the first two axes, where the others are at `through`; shares of the whole volume above."""
    within, grid = table.steps, table.grid
    at = [int((x - float(axis.lower)) / float(axis.width)) for x, axis in zip(through, table.axes[2:], strict=True)]
    won, lost = (one.bits(start=0, within=within)[(..., *at)] for one in (table, losing))
    shares = [one.fraction(start=0, within=within) for one in (table, losing)]
    extent = (grid.lower[0], grid.upper[0], grid.lower[1], grid.upper[1])
    sides = np.where(won, 0, np.where(lost, 2, 1))
    ax.imshow(sides.T, extent=extent, origin="lower", vmin=0, vmax=2, cmap=ListedColormap(list(COLOURS.values())))
    ax.set(xlabel=grid.names[0], ylabel=grid.names[1])
    ax.set_title(f"won {shares[0]:.1%}, lost {shares[1]:.1%}, unknown {1 - sum(shares):.1%}", fontsize=8)


if __name__ == "__main__":
    command_of(__file__)()
