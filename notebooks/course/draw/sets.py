"""Sets as level-set functions (Definition 5), and what a grid keeps of them."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from sdhj.kernels import FloatArray
from sdhj.plotting import draw_set, frame_slice, plane
from sdhj.plotting.looks import FULL_LOOKS
from sdhj.problem.grid import Grid

OPERATIONS = ("union", "intersection", "difference")


def canvas(nodes: int = 81) -> Grid:
    """The square [-1, 1]^2 with `nodes` nodes on each side."""
    return Grid((-1.0, -1.0), (1.0, 1.0), (nodes, nodes), names=("x", "y"), ends="wall")


def disk(grid: Grid, centre: Sequence[float], radius: float) -> FloatArray:
    """Signed distance to a disk at the nodes of a plane grid; negative inside."""
    away = grid.points() - np.asarray(centre, dtype=np.float64)
    return (np.hypot(away[:, 0], away[:, 1]) - radius).reshape(grid.shape)


def rectangle(grid: Grid, centre: Sequence[float], half_sides: Sequence[float]) -> FloatArray:
    """A level-set function of a rectangle at the nodes of a plane grid: max of four planes, itself an intersection."""
    away = np.abs(grid.points() - np.asarray(centre, dtype=np.float64)) - np.asarray(half_sides, dtype=np.float64)
    return away.max(axis=1).reshape(grid.shape)


def combine(a: FloatArray, b: FloatArray, operation: str) -> FloatArray:
    """The level-set function of A with B: min, max, or max(a, -b) (below Definition 5).

    Raises
    ------
    ValueError
        For an unknown operation.
    """
    if operation not in OPERATIONS:
        raise ValueError(f"operation must be one of {', '.join(OPERATIONS)}, got {operation!r}")
    return {"union": np.minimum(a, b), "intersection": np.maximum(a, b), "difference": np.maximum(a, -b)}[operation]


def area(grid: Grid, values: FloatArray, fine: int = 1001) -> float:
    """Area of {values <= 0} on a plane grid, of the interpolant between the nodes, counted on fine^2 points."""
    x, y = (np.linspace(grid.lower[axis], grid.upper[axis], fine) for axis in (0, 1))
    points = np.stack([np.repeat(x, fine), np.tile(y, fine)], axis=1)
    whole = (grid.upper[0] - grid.lower[0]) * (grid.upper[1] - grid.lower[1])
    return float(np.mean(grid.interpolate(values, points) <= 0.0) * whole)


def draw_functions(figure: Figure, grid: Grid, functions: Mapping[str, FloatArray]) -> None:
    """Level-set functions side by side: thin lines are levels, the bold one is level zero, the set is blue."""
    axes = np.atleast_1d(figure.subplots(1, len(functions), sharey=True))
    levels = [tenth / 10 for tenth in range(-8, 17) if tenth]
    for ax, (title, values) in zip(axes, functions.items(), strict=True):
        where = plane(grid, (0.0, 0.0), resolution=201)
        fine = where.of(grid, values)
        draw_set(ax, where, fine, FULL_LOOKS | {"linewidth": 2.0}, title, zorder=1.0)
        thin = {"colors": "#8c8c8c", "linewidths": 0.5, "linestyles": "-"}
        lines = ax.contour(where.x, where.y, fine, levels=levels, zorder=2.0, **thin)
        ax.clabel(lines, lines.levels[::2], fontsize=6, fmt="%.1f")
        frame_slice(ax, grid)
        ax.set_aspect("equal")
        ax.set_title(title)
    for ax in axes[1:]:
        ax.set_ylabel("")


def draw_nodes(figure: Figure, coarse: Grid, values: FloatArray, fine: Grid, exact: FloatArray) -> None:
    """A set held by a coarse grid over the true one: the nodes inside are full, those outside hollow."""
    ax = figure.subplots()
    where = plane(coarse, (0.0, 0.0), resolution=401)
    true = {"facecolor": "#f3d9c9", "edgecolor": "#c44e00", "linewidth": 1.2}
    held = {"facecolor": "none", "edgecolor": "#0b3c5d", "linewidth": 1.8}
    draw_set(ax, where, where.of(fine, exact), true, "exact", 1.0)
    draw_set(ax, where, where.of(coarse, values), held, "held", 2.0)
    points, inside = coarse.points(), values.ravel() <= 0
    hollow = {"color": "none", "markeredgecolor": "#8c8c8c", "markeredgewidth": 0.6, "markersize": 3}
    ax.plot(*points[~inside].T, "o", gid="outside", **hollow)
    ax.plot(*points[inside].T, "o", color="#0b3c5d", markersize=3.5, gid="inside")
    frame_slice(ax, coarse)
    ax.set_aspect("equal")
    handles = [
        Line2D([], [], color="#c44e00", linewidth=1.2, linestyle="-", label="the set"),
        Line2D([], [], color="#0b3c5d", linewidth=1.8, linestyle="-", label="what the nodes hold"),
        Line2D([], [], color="#0b3c5d", marker="o", linestyle="", label="node inside"),
        Line2D([], [], color="none", marker="o", markeredgecolor="#8c8c8c", linestyle="", label="node outside"),
    ]
    ax.legend(handles=handles, loc="center left", bbox_to_anchor=(1.02, 0.5))
