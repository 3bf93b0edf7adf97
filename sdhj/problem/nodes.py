"""Level-set functions at the nodes of a grid: sampled and checked, closed on their boundary, or bounded by cell."""

from collections.abc import Callable

import numpy as np

from sdhj.common.remembering import FloatArray
from sdhj.problem.grid import Grid
from sdhj.problem.sets import LARGEST

SMALLEST = float(np.finfo(np.float32).tiny)  # smaller level-set values become 0, so that nodes outside count as inside
LOOKED_INTO = 1000  # cells with a 0 at all corners
# Shares of the largest value at the corners of the grid (`size_of`):
HAIR = 1e-9  # below 0: values so close to 0 count as 0 inside a set
ON_BOUNDARY = 2.0**-90  # below 0, at a node where a function is 0: negative in single precision, negligible
FINE = 4  # parts of a cell's edge, in the search for the least value in the cell


def sampled_on(grid: Grid, function: Callable[[FloatArray], FloatArray], name: str) -> FloatArray:
    """Values of a level-set function at all nodes, each checked."""
    values = [checked_values(function(points), points, name) for points in grid.pieces()]
    return np.concatenate(values).reshape(grid.shape)


def checked_values(values: FloatArray, points: FloatArray, name: str) -> FloatArray:
    """The values (M,) of a level-set function; ValueError where single precision holds one not."""
    if not (finite := np.isfinite(values)).all():  # not of values at one time, which say so themselves
        raise ValueError(
            f"level set of {name!r} may be undefined or infinite at {points[int(np.argmin(finite))].tolist()}, by the "
            "bounds over pieces of an interval of time, which are wider than its values; keep what is under a root or "
            "divides from 0, as in np.sqrt(np.maximum(x, 0.0)), give swept=, or use view_time='sampled'"
        )
    if (largest := float(np.abs(values).max())) > LARGEST:
        raise ValueError(
            f"level set of {name!r} reaches {largest:.3g}, and single precision supports at most {LARGEST:g}; clip "
            "it, because far from the boundary only the sign matters"
        )
    if (lost := values[(values != 0) & (np.abs(values) < SMALLEST)]).size:
        raise ValueError(
            f"level set of {name!r} is {lost[0]:.3g} at a node, and single precision rounds magnitudes below "
            f"{SMALLEST:.2g} to 0, which would change the set; scale the function, or return 0 there"
        )
    return values


def steepest(grid: Grid, values: FloatArray, axis: int) -> float:
    """The largest |difference| of values between neighbours along an axis; 0 where there is one node."""
    here, there = grid.edges(values, axis)
    return float(np.abs(there - here).max(initial=0.0)) if values.shape[axis] > 1 else 0.0


def neighbour(grid: Grid, values: FloatArray, axis: int, by: int, past: float) -> FloatArray:
    """For each node (or cell) the value at the one that is `by` further along an axis, or `past`."""
    out = np.roll(values, -by, axis)
    if not grid.periodic[axis]:
        ends = slice(0, -by) if by < 0 else slice(values.shape[axis] - by, None)
        out[(slice(None),) * axis + (ends,)] = past
    return out


def size_of(grid: Grid, function: Callable[[FloatArray], FloatArray]) -> float:
    """The largest finite |value| of a level-set function at a grid's corners, or 1: the measure of what is rounding."""
    ends = [grid.nodes(axis)[[0, -1]] for axis in range(grid.ndim)]
    corners = np.stack([one.ravel() for one in np.meshgrid(*ends, indexing="ij")], axis=1)
    return float(np.abs(np.nan_to_num(function(corners), posinf=0.0, neginf=0.0)).max()) or 1.0


def closed(grid: Grid, values: FloatArray, function: Callable[[FloatArray], FloatArray], name: str) -> FloatArray:
    """Values of an unsafe set, negative at all nodes where they are <= 0, as G is closed: new."""
    # all shares are of this size, so that a function in other units, a multiple of it, gives the same set
    size = size_of(grid, function)
    flat = np.abs(values) <= HAIR * size
    for axis in range(grid.ndim if flat.any() else 0):
        flat = np.logical_and(*grid.edges(flat, axis))
    for axis, (before, behind) in enumerate(grid.added):  # past safe ends functions are as at the ends
        np.moveaxis(flat, axis, 0)[:before] = False
        np.moveaxis(flat, axis, 0)[len(np.moveaxis(flat, axis, 0)) - behind :] = False
    if flat.any():
        middles = np.array(grid.lower) + (np.argwhere(flat)[:LOOKED_INTO] + 0.5) * grid.spacing
        if (zero := np.abs(function(middles)) <= HAIR * size).any():
            where = np.round(middles[int(zero.argmax())], 6).tolist()
            raise ValueError(
                f"the level-set function of {name!r} is 0 in a whole region, as at {where}, so it does not say where "
                "between two nodes the set ends. Give a distance that is negative inside (without np.maximum(..., 0); "
                "sdhj.UnsafeSet.from_map, polygon, box, disk), or sampling='cell', which enlarges the set by a cell"
            )
    return np.where(values == 0.0, -ON_BOUNDARY * size, values)  # or nodes on the boundary would count as clear


def least_of_cells(grid: Grid, least: Callable[[FloatArray, FloatArray], FloatArray]) -> FloatArray:
    """For each node a lower bound in all cells around it, from bounds `least` (M,) in boxes."""
    ends = []
    for axis, (end, periodic) in enumerate(zip(grid.upper, grid.periodic, strict=True)):
        nodes = grid.nodes(axis)  # a function that is not periodic jumps where an axis closes, so both ends count
        ends.append(np.append(nodes, np.nextafter(end, nodes[0])) if periodic else nodes)
    shape = [len(one) - 1 for one in ends]
    low, high = (
        np.stack(np.meshgrid(*(one[some] for one in ends), indexing="ij"), axis=-1).reshape(-1, grid.ndim)
        for some in (slice(-1), slice(1, None))
    )
    values = np.asarray(least(low, high)).reshape(shape)
    for axis, periodic in enumerate(grid.periodic):
        if not periodic:
            values = np.pad(values, [(1 * (k == axis), 1 * (k == axis)) for k in range(grid.ndim)], "edge")
        before, behind = grid.edges(values, axis)
        # The least of the cells on both sides.
        values = np.minimum(np.roll(values, 1, axis), values) if periodic else np.minimum(before, behind)
    # 0 may be in the set, so that a node with it counts as inside.
    return np.where(values == 0.0, -ON_BOUNDARY, values)


def least_in_cells(grid: Grid, function: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """As `least_of_cells`, of a function of which no bounds are known.

    The least, over the points z that cut each cell's edge into `FINE` parts, of f(z) - 1/2 sum over the axes of the
    largest |f(z') - f(z'')|, z' and z'' neighbours along the axis within one part of z.
    """
    # an estimate: between the points of a black box nothing is known
    lines = [  # where a periodic axis closes both ends have points
        np.linspace(low, np.nextafter(high, low) if periodic else high, (n if periodic else n - 1) * FINE + 1)
        for low, high, n, periodic in zip(grid.lower, grid.upper, grid.shape, grid.periodic, strict=True)
    ]
    points = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, grid.ndim)
    values = np.asarray(function(points), dtype=np.float64).reshape([len(line) for line in lines])
    values = values - sum(_largest_change_nearby(values, axis) for axis in range(grid.ndim)) / 2
    for axis, periodic in enumerate(grid.periodic):
        parts = values.shape[axis] - 1
        around = np.clip(np.arange(0, parts + 1, FINE) + np.arange(-FINE, FINE + 1)[:, None], 0, parts)
        values = np.minimum.reduce([values.take(places, axis) for places in around])
        if periodic:  # its two ends are one node
            first, last = values.take([0], axis), values.take([-1], axis)
            values = np.concatenate([np.minimum(first, last), values.take(range(1, grid.shape[axis]), axis)], axis)
    return np.where(values == 0.0, -ON_BOUNDARY, values)


def _largest_change_nearby(values: FloatArray, axis: int) -> FloatArray:
    """For each point, the largest |difference| between neighbours along an axis, both at most one point away."""
    change = np.abs(np.diff(values, axis=axis))
    change = np.maximum(
        change.take([0, *range(change.shape[axis])], axis), change.take([*range(change.shape[axis]), -1], axis)
    )
    # half of this, added up over the axes, is what `least_in_cells` takes off at a point
    for other in set(range(values.ndim)) - {axis}:
        last = values.shape[other] - 1
        shifted = (np.clip(np.arange(last + 1) + by, 0, last) for by in (-1, 0, 1))
        change = np.maximum.reduce([change.take(places, other) for places in shifted])
    return np.asarray(change)
