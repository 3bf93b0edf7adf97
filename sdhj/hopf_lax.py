"""The Hopf-Lax formula for velocities that do not depend on the state.

Under input u_j the state at the end of an interval of length tau ranges over a box around its start, so game 3 of
App. A.3 has the closed form

    Phi_j(x) = max over y in [x + tau a_j, x + tau b_j] of s(y),

a_j, b_j the extreme velocities on each axis. On a grid the maximum is taken axis by axis: over the two ends of the
interval, by interpolation, and over the nodes between them. At a wall the interval is clipped, as the velocity is.
Between two nodes, at the fraction t of the way, s is taken

* "linear"ly. Those points then hold the maximum of the interpolant on each axis; going axis by axis can only raise the
  result (interpolating a maximum bounds the maximum of interpolants), so where s is convex between nodes, as a
  signed distance to the outside mostly is, sets come out too small, by a tenth on coarse grids;
* "limited": linearly, less t (1 - t) / 2 times the lesser of the second differences at the two nodes, or nothing where
  their signs differ. That is third order where s is smooth, and across a kink the correction never goes beyond the
  kink, as a polynomial through more nodes does: for s with one kink between two nodes the result lies between the line
  and s itself.

The same operator with an interval of no width shifts a function, which the moving frame of `schemes.Scheme` needs.
"""

from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import prange

from sdhj.compiling import kernel
from sdhj.grid import FloatArray, Grid, Window
from sdhj.rim import out_of_danger
from sdhj.stages import MATH, raise_to

Nodes = Sequence[slice]  # of each axis
INTERPOLATIONS = ("linear", "limited")
STRETCH = 1024  # nodes in one loop: long enough to vectorise, short enough for the first-level cache
SHORT = 100  # fewer nodes than this behind an axis: turning the array, so that loops are long, pays


class Intervals(NamedTuple):
    """The interval [x + low, x + high] for every node x of one axis, as the kernel reads it.

    taps : (n, 2, 4) nodes around the two ends: before, left, right, behind
    weight : (n, 2, 2) share of the right node; factor of the limited second difference
    between : (n, 2) first node within the interval and the one behind the last, periodic axes unwrapped
    point : whether the two ends are one
    """

    taps: FloatArray
    weight: FloatArray
    between: FloatArray
    point: bool


@kernel(inline="always")
def _limited(a, b):
    """The lesser of two second differences; nothing where their signs differ."""
    lesser = a if abs(a) < abs(b) else b
    return lesser if a * b > 0 else a * 0


@kernel(fastmath=MATH)
def _between_nodes(out, m, a, b, p, weight, bend):
    """out = the value between a and b; m and p are the nodes next to them."""
    if bend == 0:
        for i in range(out.size):
            out[i] = a[i] + weight * (b[i] - a[i])
    else:
        for i in range(out.size):
            rise = b[i] - a[i]
            out[i] = a[i] + weight * rise + bend * _limited(rise - (a[i] - m[i]), (p[i] - b[i]) - rise)


@kernel()
def _end(out, values, taps, weight, start, stop):
    m, a = values[taps[0], start:stop], values[taps[1], start:stop]
    b, p = values[taps[2], start:stop], values[taps[3], start:stop]
    _between_nodes(out, m, a, b, p, weight[0], weight[1])


@kernel(parallel=True)
def maximum_of_intervals(values, taps, weight, between, point, out):
    """out[a, i] = max of values[a] over the interval of node i; values, out (A, n, B), the rest as in `Intervals`."""
    before, n, after = values.shape
    chunks = (after + STRETCH - 1) // STRETCH
    for task in prange(before * n * chunks):
        row, chunk = np.int64(task) // chunks, np.int64(task) % chunks
        a, i = row // n, row % n
        start, stop = after * chunk // chunks, after * (chunk + 1) // chunks
        target = out[a, i, start:stop]
        _end(target, values[a], taps[i, 0], weight[i, 0], start, stop)
        if not point:
            other = np.empty(stop - start, values.dtype)
            _end(other, values[a], taps[i, 1], weight[i, 1], start, stop)
            raise_to(target, other)
            for node in range(between[i, 0], between[i, 1]):
                raise_to(target, values[a, node % n, start:stop])


@lru_cache(maxsize=256)  # the recursion asks for the same few intervals hundreds of times
def intervals(
    nodes: int, periodic: bool, low: float, high: float, limited: bool, dtype: str, some: tuple[int, int] | None = None
) -> Intervals:
    """The intervals [x + low, x + high], in cells, of an axis's nodes, or of a window of it: its first node, how many.

    To the last bit it does not matter which: what is farther off than the window's ends is taken from there.
    """
    x = np.arange(nodes)[:, None] + np.array([low, high])
    if not periodic:
        x = np.clip(x, 0.0, nodes - 1.0)
    left = np.floor(x) if periodic else np.minimum(np.floor(x), nodes - 2)
    t = x - left
    taps = left.astype(np.int64)[..., None] + np.arange(-1, 3)
    bend = t * (t - 1) / 2 * limited
    if not periodic:  # no second difference reaches across a wall
        bend = np.where((taps[..., 0] < 0) | (taps[..., 3] >= nodes), 0.0, bend)
    between = np.stack([np.ceil(x[:, 0]), np.floor(x[:, 1]) + 1], axis=1).astype(np.int64)
    if periodic:  # once around is enough
        between[:, 1] = np.minimum(between[:, 1], between[:, 0] + nodes)
    weight = np.stack([t, bend], axis=-1).astype(dtype)
    if some is None:
        return Intervals(taps % nodes if periodic else np.clip(taps, 0, nodes - 1), weight, between, low == high)
    first, count = some
    places = (first + np.arange(count)) % nodes
    shift = (np.arange(count) - places)[:, None]
    taps = np.clip(taps[places] + shift[..., None], 0, count - 1)
    return Intervals(taps, weight[places], np.clip(between[places] + shift, 0, count), low == high)


def maximum_over_interval(
    grid: Grid, values: FloatArray, axis: int, low: float, high: float, interpolation: str
) -> FloatArray:
    """max over y in [x + low, x + high] along one axis of `values`, which on other axes may have some nodes only."""
    n, spacing = grid.shape[axis], grid.spacing[axis]
    limited = interpolation == "limited"
    nodes, some = (grid.whole.shape[axis], (grid.first[axis], n)) if isinstance(grid, Window) else (n, None)
    some = None if some == (0, nodes) else some
    where = intervals(nodes, grid.periodic[axis], low / spacing, high / spacing, limited, values.dtype.str, some)
    after = int(np.prod(values.shape[axis + 1 :]))
    view = np.asarray(values).reshape(-1, n, after)
    turned = after < SHORT
    if turned:
        view = np.moveaxis(view, 1, 0).reshape(1, n, -1)
    view = np.ascontiguousarray(view)
    out = np.empty_like(view)
    maximum_of_intervals(view, *where, out)
    if turned:
        out = np.ascontiguousarray(np.moveaxis(out.reshape(n, -1, after), 0, 1))
    return out.reshape(values.shape)


def maximum_over_boxes(
    grid: Grid, values: FloatArray, low: FloatArray, high: FloatArray, interpolation: str, wanted: Nodes | None = None
) -> Iterator[tuple[int, FloatArray]]:
    """Yield (j, max of `values` over the box [x + low_j, x + high_j]) for every row j of low, high (L, ndim).

    Boxes that agree on an axis share the work: the axes with the fewest different intervals go first. Where only some
    nodes are `wanted`, by axis, the others are dropped as soon as that axis is done.
    """
    spans = [[(float(low[j, axis]), float(high[j, axis])) for j in range(len(low))] for axis in range(grid.ndim)]
    order = sorted(range(grid.ndim), key=lambda axis: len(set(spans[axis])))

    def descend(values: FloatArray, depth: int, members: Sequence[int]) -> Iterator[tuple[int, FloatArray]]:
        if depth == grid.ndim:
            yield from ((j, values) for j in members)
            return
        axis = order[depth]
        for span in dict.fromkeys(spans[axis][j] for j in members):
            chosen = [j for j in members if spans[axis][j] == span]
            same = span == (0.0, 0.0)
            moved = values if same else maximum_over_interval(grid, values, axis, *span, interpolation)
            if wanted:
                moved = moved[(slice(None),) * axis + (wanted[axis],)]
            yield from descend(moved, depth + 1, chosen)

    yield from descend(out_of_danger(grid, np.asarray(values)), 0, range(len(low)))


def maximum_over_paths(
    grid: Grid, values: FloatArray, boxes: FloatArray, interpolation: str, wanted: Nodes | None = None
) -> Iterator[tuple[int, FloatArray]]:
    """Yield (j, max of `values` over x + all boxes of a path): boxes (P, 2, L, ndim), low and high corners in turn.

    Between two of them the corners move on straight lines: those boxes are in the one that holds both.
    """
    if len(boxes) == 1:
        yield from maximum_over_boxes(grid, values, boxes[0, 0], boxes[0, 1], interpolation, wanted)
    found: dict[int, FloatArray] = {}
    for low, high in zip(np.minimum(boxes[:-1, 0], boxes[1:, 0]), np.maximum(boxes[:-1, 1], boxes[1:, 1]), strict=True):
        for j, most in maximum_over_boxes(grid, values, low, high, interpolation, wanted):
            found[j] = np.maximum(found.get(j, most), most)
    yield from found.items()
