"""Chapter 1, Sets as functions: what it draws, its widgets, and the checks of its exercises."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from course.exercises import exercise, expect, expect_close
from course.widgets import Explorer, Numbers, choice, slider
from sdhj.common.remembering import FloatArray
from sdhj.plotting import draw_set, frame_slice, plane
from sdhj.plotting.looks import FULL_LOOKS
from sdhj.problem.grid import Grid

# ---- pictures

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
    levels = [fifth / 5 for fifth in range(-4, 9) if fifth]
    for ax, (title, values) in zip(axes, functions.items(), strict=True):
        where = plane(grid, (0.0, 0.0), resolution=81)
        fine = where.of(grid, values)
        draw_set(ax, where, fine, FULL_LOOKS | {"linewidth": 2.0}, title, zorder=1.0)
        thin = {"colors": "#8c8c8c", "linewidths": 0.5, "linestyles": "-"}
        lines = ax.contour(where.x, where.y, fine, levels=levels, zorder=2.0, **thin)
        ax.clabel(lines, fontsize=6, fmt="%.1f")
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


# ---- widgets


def explore_sets(nodes: int = 81) -> Explorer:
    """Union, intersection and difference of a disk and a rectangle, as min and max of their functions."""
    grid = canvas(nodes)
    b = rectangle(grid, (0.25, 0.0), (0.35, 0.55))

    def draw(figure: Figure, operation: str, x: float, radius: float) -> Numbers:
        a = disk(grid, (x, 0.0), radius)
        c = combine(a, b, operation)
        draw_functions(figure, grid, {"$a$, disk": a, "$b$, rectangle": b, f"{operation}": c})
        return {f"area of {name}": area(grid, values, 201) for name, values in (("A", a), ("B", b), ("the result", c))}

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


# ---- checks


@exercise(
    "1.1",
    "Take the ring as a large disk less a small one, and from it a rectangle that begins at x = 0: a difference "
    "is max(a, -b).",
)
def check_gap(gap):
    """A ring with radii 0.3 and 0.6, open where x > 0 and |y| < 0.15."""
    x, y = np.random.default_rng(0).uniform(-1, 1, (2, 20_000))
    r = np.hypot(x, y)
    values = np.asarray(gap(x, y))
    expect(values.shape == x.shape, "the function is given arrays and must return one value for each point.")
    sure = (np.abs(r - 0.3) > 1e-3) & (np.abs(r - 0.6) > 1e-3) & (np.abs(np.abs(y) - 0.15) > 1e-3) & (np.abs(x) > 1e-3)
    inside = values <= 0
    opening = (x > 0) & (np.abs(y) < 0.15)
    expect(~inside[sure & (r > 0.6)], "points outside the outer circle must not be in the set: is inside negative?")
    expect(~inside[sure & (r < 0.3)], "the hole in the middle: a difference is max(a, -b).")
    body = sure & (r > 0.3) & (r < 0.6)
    expect(inside[body & ~opening], "points of the ring away from the gap must be in the set, those at x < 0 too.")
    expect(~inside[body & opening], "the gap: is it at x > 0, and is all of |y| < 0.15 open?")
    return "Its area is that of the ring less the gap's; area(grid, gap(x, y)) tells."


@exercise("1.2", "The spacing is 2 / (n - 1). Solve for n, and round up.")
def check_nodes(nodes):
    """The least n with (2 / (n - 1)) sqrt(2) / 2 <= 0.01."""
    expect(nodes > 2, "a number of nodes on each side.")
    h = 2.0 / (nodes - 1)
    expect(
        h * np.sqrt(2) / 2 <= 0.01,
        "h sqrt(n) / 2 with n = 2 axes and h = 2 / (nodes - 1) is above 0.01.",
    )
    finer = 2.0 / (nodes - 2)
    expect(finer * np.sqrt(2) / 2 > 0.01, "one node fewer would do as well.")
    expect(int(nodes) == nodes, "nodes come whole.")
    return f"In four dimensions that would be {int(nodes) ** 4:.1e} values."


def _distance_to_rectangle(x, y, centre, half_sides):
    dx, dy = np.abs(x - centre[0]) - half_sides[0], np.abs(y - centre[1]) - half_sides[1]
    return np.hypot(np.maximum(dx, 0), np.maximum(dy, 0)) + np.minimum(np.maximum(dx, dy), 0)


@exercise(
    "1.3",
    "With dx = |x - c_x| - a, and dy alike: inside max(dx, dy) counts, outside the length of (max(dx, 0), max(dy, 0)).",
)
def check_rectangle(signed_distance):
    """The signed distance to a rectangle."""
    x, y = np.random.default_rng(1).uniform(-2, 2, (2, 5000))
    centre, half = (0.3, -0.2), (0.8, 0.4)
    got, wanted = np.asarray(signed_distance(x, y, centre, half)), _distance_to_rectangle(x, y, centre, half)
    expect(got.shape == x.shape, "one value for each point.")
    dx, dy = np.abs(x - centre[0]) - half[0], np.abs(y - centre[1]) - half[1]
    inside = wanted <= 0
    expect_close(got[inside], wanted[inside], "inside, the nearest edge decides, and the value is negative.")
    beside = ~inside & ((dx <= 0) | (dy <= 0))
    expect_close(got[beside], wanted[beside], "straight out from an edge the distance is that to the edge.")
    corner = (dx > 0) & (dy > 0)
    expect_close(got[corner], wanted[corner], "beyond a corner the nearest point is the corner: a Euclidean distance.")


@exercise(
    "1.4",
    "Drop a perpendicular on the line and clip its foot to the segment before you take the distance. A segment "
    "may have no length.",
)
def check_swept(swept):
    """The signed distance to a capsule."""
    x, y = np.random.default_rng(2).uniform(-2, 2, (2, 2000))
    begin, end, radius = np.array([-0.6, -0.3]), np.array([0.6, 0.2]), 0.15
    got = np.asarray(swept(x, y, begin, end, radius))
    expect(got.shape == x.shape, "one value for each point.")
    way = (end - begin) / np.linalg.norm(end - begin)
    along = (x - begin[0]) * way[0] + (y - begin[1]) * way[1]
    beyond = (along < 0) | (along > np.linalg.norm(end - begin))
    share = np.clip(along / np.linalg.norm(end - begin), 0, 1)
    wanted = np.hypot(x - begin[0] - share * 1.2, y - begin[1] - share * 0.5) - radius
    expect_close(got[~beyond], wanted[~beyond], "beside the segment: drop a perpendicular on it.")
    expect_close(got[beyond], wanted[beyond], "beyond its ends: the nearest point of the segment is an end.")
    still = swept(x, y, begin, begin, radius)
    expect_close(still, np.hypot(x - begin[0], y - begin[1]) - radius, "a disk that stands still: begin equals end.")


@exercise("1.5")
def check_cells(surely_outside):
    """Sound and sharp: the least value in a cell is (a0 + a1 - h) / 2."""
    rng = np.random.default_rng(3)
    for h in (0.1, 0.5):
        zeros = np.sort(rng.uniform(0, 20, 12))
        nodes = np.arange(0, 20, h)
        values = np.min(np.abs(nodes[:, None] - zeros), axis=1) - 0.02
        said = np.asarray(surely_outside(values, h))
        expect(said.shape == (len(nodes) - 1,), "n nodes have n - 1 cells between them.")
        said = said.astype(bool)
        least = (values[1:] + values[:-1] - h) / 2
        wrong = said & (least <= -1e-12)
        expect(
            ~wrong,
            "a cell was called free where a function can dip to zero between its nodes.",
        )
        missed = ~said & (least > 1e-12)
        expect(~missed, "safe, but not sharp: some cell is certainly free and you did not say so.")
    return "This is a certificate: a statement about all points of a cell from two numbers."
