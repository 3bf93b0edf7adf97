"""Sets as functions (Definition 5): level sets, min and max, and what a grid keeps of a set."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from widgets import Explorer, Numbers, choice, slider

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


def explore_sets(nodes: int = 81) -> Explorer:
    """Union, intersection and difference of a disk and a rectangle, as min and max of their functions."""
    grid = canvas(nodes)
    b = rectangle(grid, (0.25, 0.0), (0.35, 0.55))

    def draw(figure: Figure, operation: str, x: float, radius: float) -> Numbers:
        a = disk(grid, (x, 0.0), radius)
        c = combine(a, b, operation)
        draw_functions(figure, grid, {"$a$, disk": a, "$b$, rectangle": b, f"{operation}": c})
        return {f"area of {name}": area(grid, values, 401) for name, values in (("A", a), ("B", b), ("the result", c))}

    controls = {
        "operation": choice("operation", OPERATIONS, "union"),
        "x": slider("disk's centre x (m)", -0.9, 0.9, 0.05, -0.25),
        "radius": slider("disk's radius (m)", 0.1, 0.8, 0.05, 0.45),
    }
    return Explorer(
        draw, controls, size=(8.2, 3.0), alt="A disk, a rectangle, and what the operation makes of them", motion="x"
    )


def explore_nodes() -> Explorer:
    """What a coarse grid keeps of a thin bar: linear interpolation between nodes, and nothing else."""
    fine = canvas(401)

    def draw(figure: Figure, nodes: int, thickness: float, shift: float) -> Numbers:
        coarse, half = canvas(nodes), (0.7, thickness / 2)
        values, exact = (rectangle(grid, (0.0, shift), half) for grid in (coarse, fine))
        draw_nodes(figure, coarse, values, fine, exact)
        return {
            "spacing (m)": coarse.spacing[0],
            "true area": 1.4 * thickness,
            "area held": area(coarse, values, 401),
            "nodes inside": int(np.count_nonzero(values <= 0)),
        }

    controls = {
        "nodes": slider("nodes on each axis", 5, 41, 2, 11),
        "thickness": slider("thickness (m)", 0.04, 0.6, 0.02, 0.3),
        "shift": slider("shift (m)", -0.2, 0.2, 0.01, 0.05),
    }
    return Explorer(
        draw, controls, size=(6.0, 3.6), alt="A bar, and what the nodes of a coarse grid hold of it", motion="shift"
    )
