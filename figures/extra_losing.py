"""Cells are proved to be won or proved to be lost, and of those between more cells decide more.

The README's car at one heading, on two numbers of cells. What is lost is lost whatever the robot does.
"""

from typing import Any

import numpy as np
from common import Context, command_of
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

import sdhj
from sdhj import plotting
from sdhj.certified.table import lost_cells
from sdhj.kernels import FloatArray

MAIN_JOB = False
CELLS = ((26, 26, 37), (51, 51, 72), (130, 130, 144))
COLOURS = {"won": "#2a8c82", "unknown": "#eceae4", "lost": "#c0504d"}


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
    table = sdhj.solve(car(), sdhj.Certified(cells=CELLS[0]))
    return [one.fraction(start=0, within=table.steps) for one in (table, lost_cells(car(), table.axes))]


def draw(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 3.6)
    for ax, cells in zip(figure.subplots(1, 2), CELLS[:2] if context.coarse else CELLS[1:], strict=True):
        context.say(f"both sides of the car with {' x '.join(map(str, cells))} cells")
        table = sdhj.solve(car(), sdhj.Certified(cells=cells))
        draw_sides(ax, table, lost_cells(car(), table.axes), (0.0,))
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
    said = f"won {shares[0]:.0%}, lost {shares[1]:.0%}, unknown {1 - sum(shares):.0%}"
    ax.set_title(f"{' x '.join(map(str, table.shape))} cells:\n{said}", fontsize=8)


if __name__ == "__main__":
    command_of(__file__)()
