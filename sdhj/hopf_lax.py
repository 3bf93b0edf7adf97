"""The Hopf-Lax formula for velocities that do not depend on the state.

Under input u_j the state at the end of an interval of length tau ranges over a box around its start, so game 3 of
App. A.3 has the closed form

    Phi_j(x) = max over y in [x + tau a_j, x + tau b_j] of s(y),

a_j, b_j the extreme velocities on each axis. On a grid the maximum is taken axis by axis: over the two ends of the interval,
by interpolation, and over the nodes between them. Where s is interpolated linearly those points hold the maximum of the
interpolant on each axis; taking it axis by axis can only raise the result (interpolating a maximum bounds the maximum
of interpolants), so the sets it gives err to the safe side. At a wall the interval is clipped, as the velocity is.

The same operator with an interval of no width shifts a function, which the moving frame of `schemes.Scheme` needs.
"""

from collections.abc import Iterator, Sequence
from functools import lru_cache

import numpy as np
from numba import njit, prange

from sdhj.grid import FloatArray, Grid

INTERPOLATIONS = {"linear": 2, "cubic": 4, "quintic": 6}  # name: nodes that an interpolated value is made of


@njit(cache=True, parallel=True)
def maximum_of_taps(values, index, weight, out):
    """out[a, i, b] = max over e of sum over t of weight[i, e, t] * values[a, index[i, e, t], b].

    values, out : (A, n, B); index, weight : (n, E, T). `out` is written.
    """
    before, n, after = values.shape
    candidates, taps = index.shape[1], index.shape[2]
    for task in prange(before * n):
        a = np.int64(task) // n
        i = np.int64(task) - a * n
        row = out[a, i]
        total = np.empty(after, values.dtype)
        for e in range(candidates):
            w = weight[i, e, 0]
            source = values[a, index[i, e, 0]]
            for b in range(after):
                total[b] = w * source[b]
            for t in range(1, taps):
                w = weight[i, e, t]
                if w != 0.0:
                    source = values[a, index[i, e, t]]
                    for b in range(after):
                        total[b] += w * source[b]
            if e == 0:
                row[:] = total
            else:
                for b in range(after):
                    row[b] = max(row[b], total[b])


def _taps(position: float, nodes: int, periodic: bool, taps: int) -> tuple[FloatArray, FloatArray]:
    """Nodes and weights that interpolate at a position counted in cells (Lagrange's polynomial through `taps` nodes)."""
    base = int(np.floor(position)) - taps // 2 + 1
    if not periodic:  # a stencil that would leave through a wall moves inward
        base = min(max(base, 0), nodes - taps)
    stencil = base + np.arange(taps)
    weights = np.array([np.prod([(position - m) / (k - m) for m in stencil if m != k]) for k in stencil])
    return stencil % nodes if periodic else stencil, weights


@lru_cache(maxsize=256)  # the recursion asks for the same few intervals hundreds of times
def interval_taps(nodes: int, periodic: bool, low: float, high: float, taps: int) -> tuple[FloatArray, FloatArray]:
    """Candidates of the maximum over [x + low, x + high] for every node x of an axis, in cells: index and weight (n, E, T)."""
    rows = []
    for i in range(nodes):
        ends = [i + low, i + high]
        if not periodic:
            ends = [min(max(end, 0.0), nodes - 1.0) for end in ends]
        points = [ends[0]] if ends[0] == ends[1] else [*ends, *range(int(np.ceil(ends[0])), int(np.floor(ends[1])) + 1)]
        rows.append([_taps(float(p), nodes, periodic, taps) for p in points])
    most = max(len(row) for row in rows)
    index = np.empty((nodes, most, taps), np.int64)
    weight = np.empty((nodes, most, taps))
    for i, row in enumerate(rows):
        for e in range(most):  # a row with fewer candidates repeats its first
            index[i, e], weight[i, e] = row[e if e < len(row) else 0]
    return index, weight


def maximum_over_interval(
    grid: Grid, values: FloatArray, axis: int, low: float, high: float, interpolation: str
) -> FloatArray:
    """max over y in [x + low, x + high] along one axis of a grid function; shape and dtype as `values`."""
    shape, spacing = grid.shape, grid.spacing[axis]
    index, weight = interval_taps(
        shape[axis], grid.periodic[axis], low / spacing, high / spacing, INTERPOLATIONS[interpolation]
    )
    view = np.ascontiguousarray(values).reshape(int(np.prod(shape[:axis])), shape[axis], int(np.prod(shape[axis + 1 :])))
    out = np.empty_like(view)
    maximum_of_taps(view, index, weight.astype(view.dtype), out)
    return out.reshape(shape)


def maximum_over_boxes(
    grid: Grid, values: FloatArray, low: FloatArray, high: FloatArray, interpolation: str
) -> Iterator[tuple[int, FloatArray]]:
    """Yield (j, max of `values` over the box [x + low_j, x + high_j]) for every row j of low, high (L, ndim).

    Boxes that agree on an axis share the work: the axes with the fewest different intervals go first.
    """
    intervals = [[(low[j, axis], high[j, axis]) for j in range(len(low))] for axis in range(grid.ndim)]
    order = sorted(range(grid.ndim), key=lambda axis: len(set(intervals[axis])))

    def descend(values: FloatArray, depth: int, members: Sequence[int]) -> Iterator[tuple[int, FloatArray]]:
        if depth == grid.ndim:
            yield from ((j, values) for j in members)
            return
        axis = order[depth]
        for interval in dict.fromkeys(intervals[axis][j] for j in members):
            chosen = [j for j in members if intervals[axis][j] == interval]
            same = interval == (0.0, 0.0)
            moved = values if same else maximum_over_interval(grid, values, axis, *interval, interpolation)
            yield from descend(moved, depth + 1, chosen)

    yield from descend(np.asarray(values), 0, range(len(low)))
