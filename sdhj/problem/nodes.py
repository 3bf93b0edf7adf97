"""Level-set functions at the nodes of a grid: sampled and checked, closed on their boundary, or bounded by cell."""

from collections.abc import Callable

import numpy as np

from sdhj.kernels import FloatArray
from sdhj.problem.grid import Grid
from sdhj.problem.sets import LARGEST, STEEP

SMALLEST = float(np.finfo(np.float32).tiny)  # smaller level-set values become 0, so that nodes outside count as inside
AROUND = 6  # nodes on each side that `closed` depends on
# Shares of the largest value at the corners of the grid (`size_of`):
HAIR = 1e-9  # below 0: values so close to 0 count as 0 inside a set
ON_BOUNDARY = 2.0**-90  # below 0, at a node where a function is 0: negative in single precision, negligible
FINE = 4  # parts of a cell's edge, in the search for the least value in the cell


def sampled_on(grid: Grid, function: Callable[[FloatArray], FloatArray], name: str) -> FloatArray:
    """Values of a level-set function of points (M, ndim) at all nodes, (*grid.shape) float64, sampled piece by piece.

    ValueError, with the set's `name`, where a value is not finite, or out of the range of single precision
    (`checked_values`).
    """
    values = [checked_values(function(points), points, name) for points in grid.pieces()]
    return np.concatenate(values).reshape(grid.shape)


def checked_values(values: FloatArray, points: FloatArray, name: str) -> FloatArray:
    """The values (M,) of a level-set function at points (M, ndim), after a check that single precision can hold them.

    ValueError, with the set's `name`, where a value is not finite, above `LARGEST` in magnitude, or below `SMALLEST`
    and not 0, so that it would become 0. There must be at least one point.
    """
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
    """The largest |difference| of values between neighbours along an axis; 0 where `values` have one node along it.

    values : (*shape), or with one node on axes along which they do not change.
    """
    here, there = grid.edges(values, axis)
    return float(np.abs(there - here).max(initial=0.0)) if values.shape[axis] > 1 else 0.0


def neighbour(grid: Grid, values: FloatArray, axis: int, by: int, past: float) -> FloatArray:
    """For each node (or cell) the value at the one that is `by` further along an axis: a new array.

    by : how many nodes, not 0, negative for the other direction; on a bounded axis fewer than it has. On a periodic
    axis neighbours go around; past the end of a bounded one the value is `past`.
    """
    out = np.roll(values, -by, axis)
    if not grid.periodic[axis]:
        ends = slice(0, -by) if by < 0 else slice(values.shape[axis] - by, None)
        out[(slice(None),) * axis + (ends,)] = past
    return out


def size_of(grid: Grid, function: Callable[[FloatArray], FloatArray]) -> float:
    """The largest |value| of a level-set function of points at the corners of a grid.

    Undefined and infinite values count as 0; the result is 1 where all are 0. What counts as rounding is relative to
    this, so that the function's unit makes no difference.
    """
    ends = [grid.nodes(axis)[[0, -1]] for axis in range(grid.ndim)]
    corners = np.stack([one.ravel() for one in np.meshgrid(*ends, indexing="ij")], axis=1)
    return float(np.abs(np.nan_to_num(function(corners), posinf=0.0, neginf=0.0)).max()) or 1.0


def closed(grid: Grid, values: FloatArray, size: float = 1.0) -> FloatArray:
    """Values (*grid.shape) of an unsafe set, made negative at all nodes where they are <= 0, as G is closed.

    The result is a new array; values above 0 stay as they are. A node on the boundary gets minus `ON_BOUNDARY`.

    A function that is 0, up to `HAIR`, in the whole set (an unsigned distance, a positive part, 1 - occupancy) does not
    say where between two nodes the set ends. It is therefore extrapolated into the set with its slope just outside,
    which puts the boundary of a distance where it belongs. If the slope at the set is steeper than before, as where the
    function jumps or is cut off, the set is assumed to end next to the outer node. The value at a node depends on those
    up to `AROUND` nodes away.

    size : of the function, from `size_of`; `ON_BOUNDARY` and `HAIR` are shares of it.
    """
    inside = np.nonzero(values <= 0.0)
    level, steps = values[inside], [(axis, by) for axis in range(grid.ndim) for by in (-1, 1)]
    near = [_values_beyond(grid, values, inside, *one) for one in steps]  # NaN past an end, which nothing finds
    flat = (level >= -HAIR * size) & ~np.any([one < level for one in near], axis=0)
    at_boundary = flat & np.any([one > 0.0 for one in near], axis=0)
    out = np.where(values == 0.0, -ON_BOUNDARY * size, values)
    if not at_boundary.any():
        return out
    at = tuple(index[at_boundary] for index in inside)
    depth, fallen = out[at], np.zeros(np.count_nonzero(at_boundary))
    for (axis, by), first in zip(steps, near, strict=True):
        first, second = first[at_boundary], _values_beyond(grid, values, at, axis, 2 * by)
        drop, rate = first - level[at_boundary], second - first
        fall = np.where(rate >= drop * (1.0 - 1e-6), np.maximum(rate, drop), (1.0 + STEEP) * drop)
        depth = np.where(first > 0.0, np.minimum(depth, first - fall), depth)
        fallen = np.where(first > 0.0, np.maximum(fallen, fall), fallen)
    step = np.zeros(values.shape)
    out[at], step[at] = depth, fallen
    rest = tuple(index[flat & ~at_boundary] for index in inside)
    for _ in range(AROUND - 2):  # deeper in by as much again, or differences would wear down what is but a shell
        falls = np.nan_to_num([_values_beyond(grid, step, rest, *one) for one in steps])
        there = (_values_beyond(grid, out, rest, *one) for one in steps)
        depths = [np.where(fall > 0.0, one - fall, -np.inf) for one, fall in zip(there, falls, strict=True)]
        found = falls.max(axis=0) > 0.0
        at = tuple(index[found] for index in rest)
        out[at], step[at] = np.max(depths, axis=0)[found], falls.max(axis=0)[found]
        rest = tuple(index[~found] for index in rest)
    return out


def _values_beyond(grid: Grid, values: FloatArray, at: tuple[FloatArray, ...], axis: int, by: int) -> FloatArray:
    """Values (K,) at the nodes that are `by` nodes further along an axis than the K nodes `at`; NaN past a bounded end.

    values : (*grid.shape). at : an index array (K,) for each axis, as np.nonzero gives. by : negative for the other
    direction. On a periodic axis nodes go around.
    """
    n, moved = grid.shape[axis], at[axis] + by
    found = values[(*at[:axis], moved % n, *at[axis + 1 :])]
    return found if grid.periodic[axis] else np.where((moved >= 0) & (moved < n), found, np.nan)


def least_in_cells(grid: Grid, function: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """For each node, a lower bound on a level-set function in all cells that touch it, (*grid.shape).

    It is the least, over the points z that cut each cell's edge into `FINE` parts, of

        f(z) - 1/2 sum over the axes of the largest |f(z') - f(z'')|,

    with z' and z'' neighbours along the axis, both at most one part from z: so a steep function far away costs nothing.
    The set of the interpolated bounds contains the true set. Both ends of a periodic axis have points, as a function
    that is not periodic jumps between the two and not before them. A bound of 0 becomes minus `ON_BOUNDARY`.
    """
    lines = [
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
    """For each point, the largest |difference| between neighbours along an axis near it; the same shape as `values`.

    Both neighbours are at most one point away from it along every axis. values : at the points of a grid.
    """
    change = np.abs(np.diff(values, axis=axis))
    change = np.maximum(
        change.take([0, *range(change.shape[axis])], axis), change.take([*range(change.shape[axis]), -1], axis)
    )
    for other in set(range(values.ndim)) - {axis}:
        last = values.shape[other] - 1
        shifted = (np.clip(np.arange(last + 1) + by, 0, last) for by in (-1, 0, 1))
        change = np.maximum.reduce([change.take(places, other) for places in shifted])
    return np.asarray(change)
