"""Maxima of grid functions over boxes around each node, and the padding of nodes past safe ends.

On a grid the maximum over a box is taken axis by axis: over the two ends of the interval, by interpolation, and over
the nodes between them (`sdhj.solver.hopf_lax` says how, and what for).
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from sdhj.common.remembering import FloatArray
from sdhj.kernels.boxes import Leaves, maximum_of_intervals
from sdhj.kernels.interpolation import SLACK
from sdhj.kernels.union import EIGHT
from sdhj.problem.grid import Grid

Nodes = Sequence[slice]  # of each axis
Spans = tuple[tuple[float, float], ...]
INTERPOLATIONS = ("linear", "limited")
TOGETHER = 2**20  # numbers, of functions that are kept at a time where there are more than eight


@lru_cache(maxsize=256)  # a recursion needs the same few intervals hundreds of times
def intervals(nodes: int, periodic: bool, spans: Spans, limited: bool, dtype: str) -> tuple[FloatArray, ...]:
    """The arrays of `Leaves` for intervals [x + low, x + high], in cells, at nodes x.

    With `limited`, t (t - 1) / 2 times the limited second difference is added: the lesser in magnitude of those around
    the two nodes, 0 where their signs differ. Equal arguments share the arrays, which nobody may write.
    """
    x = np.arange(nodes)[:, None] + np.array(spans)[:, None]  # (intervals, nodes, 2)
    if not periodic:  # at the ends intervals are clipped
        x = np.clip(x, 0.0, nodes - 1.0)
    left = np.floor(x) if periodic else np.minimum(np.floor(x), nodes - 2)
    t = x - left
    taps = left.astype(np.int64)[..., None] + np.arange(-1, 3)
    bend = t * (t - 1) / 2 * limited
    if not periodic:  # no second difference reaches across a wall
        bend = np.where((taps[..., 0] < 0) | (taps[..., 3] >= nodes), 0.0, bend)
    between = np.stack([np.ceil(x[..., 0]), np.floor(x[..., 1]) + 1], axis=-1).astype(np.int64)
    if periodic:  # once around is enough
        between[..., 1] = np.minimum(between[..., 1], between[..., 0] + nodes)
    weight = np.stack([t, bend], axis=-1).astype(dtype)
    point = np.array([low == high for low, high in spans])
    # in the order of `taps`, `weight`, `between` and `point` in `Leaves`, by which `_leaves` takes them apart
    return taps % nodes if periodic else np.clip(taps, 0, nodes - 1), weight, between, point


class Maxima(NamedTuple):
    """Maxima of a grid function over successive boxes along all axes but one, along which `of` takes them."""

    first: int  # the index of the first of these boxes
    number: int  # how many boxes there are
    values: FloatArray  # (functions, *shape): the maxima along the other axes
    axis: int  # the axis of the shape along which maxima are still to be taken
    leaves: Leaves  # a leaf for each box: of which function, and over which interval of this axis

    @property
    def split(self) -> FloatArray:
        """The values as `maximum_of_intervals` takes them, a view: (functions, A, n, B), n nodes on the open axis."""
        count, *shape = self.values.shape
        before, behind = math.prod(shape[: self.axis]), math.prod(shape[self.axis + 1 :])
        return self.values.reshape(count, before, shape[self.axis], behind)

    def of(self, some: slice = slice(None), into: FloatArray | None = None, raised: bool = False) -> FloatArray:
        """The maxima over some of the boxes, counted from `first`: (boxes, *shape), in `into` where given."""
        leaves = self.leaves._replace(parent=self.leaves.parent[some], which=self.leaves.which[some])
        shape = [len(leaves.parent), *self.values.shape[1:]]
        shape[1 + self.axis] = leaves.taps.shape[1]
        out, split = np.empty(shape, self.values.dtype) if into is None else into, self.split
        # with `raised`, what is greater in `into` stays there
        maximum_of_intervals(split, leaves, raised, out.reshape(len(out), split.shape[1], -1, split.shape[3]))
        return out


class AxisMaxima(NamedTuple):
    """Maxima along one axis: leaf i is that of function parent[i] over spans[which[i]], and a function of the next."""

    axis: int
    spans: Spans  # different intervals (low, high) around a node, in the unit of the axis
    parent: tuple[int, ...]
    which: tuple[int, ...]


@lru_cache(maxsize=16)  # the same at every step
def _leaves(axis_maxima: AxisMaxima, grid: Grid, limited: bool, dtype: str, begin: int, end: int) -> Leaves:
    """The `Leaves` of maxima along an axis, for its nodes from `begin` to `end`, which nobody may write."""
    axis, n = axis_maxima.axis, grid.shape[axis_maxima.axis]
    cells = tuple((low / grid.spacing[axis], high / grid.spacing[axis]) for low, high in axis_maxima.spans)
    found = intervals(n, grid.periodic[axis], cells, limited, dtype)
    taps, weight, between = (np.ascontiguousarray(one[:, begin:end]) for one in found[:3])
    return Leaves(np.array(axis_maxima.parent), np.array(axis_maxima.which), taps, weight, between, found[3])


@lru_cache(maxsize=64)
def _maxima_by_axis(corners: bytes, count: int, most: int) -> tuple[tuple[int, tuple[AxisMaxima, ...]], ...]:
    """For each run of successive boxes, its first and the `AxisMaxima` of each axis; boxes that agree share work."""
    spans = np.frombuffer(corners).reshape(count, -1, 2)  # bytes can be remembered by, arrays cannot
    different = [len(np.unique(spans[:, axis], axis=0)) for axis in range(spans.shape[1])]
    # the axes with the fewest different intervals go first
    *others, last = sorted(range(len(different)), key=lambda axis: (bool(spans[:, axis].any()), different[axis]))
    before = np.column_stack([np.zeros(count), spans[:, others].reshape(count, 2 * len(others))])
    kinds = np.unique(before, axis=0, return_inverse=True)[1].reshape(-1)
    # runs begin at multiples of eight: where the boxes are those of inputs, eight of them share a byte of marks
    runs, first = [], 0
    for end in range(EIGHT, count, EIGHT):  # until more than `most` functions would be kept before the last axis
        if len(set(kinds[first : end + EIGHT].tolist())) > most:
            runs.append((first, end))
            first = end
    runs.append((first, count))
    found = []
    for begin, end in runs:
        axes_maxima, leaf_of_box = [], np.zeros(end - begin, np.int64)
        for axis in (*others, last):
            some = np.column_stack([leaf_of_box, spans[begin:end, axis]])
            leaves, leaf_of_box = np.unique(some, axis=0, return_inverse=True) if axis != last else (some, leaf_of_box)
            leaf_of_box = leaf_of_box.reshape(-1)
            if axis == last or leaves[:, 1:].any():
                kinds_here, which = np.unique(leaves[:, 1:], axis=0, return_inverse=True)
                parent = tuple(leaves[:, 0].astype(int).tolist())
                pairs = tuple((low, high) for low, high in kinds_here.tolist())
                axes_maxima.append(AxisMaxima(axis, pairs, parent, tuple(which.reshape(-1).tolist())))
        found.append((begin, tuple(axes_maxima)))
    return tuple(found)


def maxima(
    grid: Grid, values: FloatArray, low: FloatArray, high: FloatArray, interpolation: str, wanted: Nodes | None = None
) -> Iterator[Maxima]:
    """Yield the maxima over boxes [x + low_j, x + high_j] at nodes x, some j at a time."""
    corners, values = np.stack([low, high], axis=2).astype(float), out_of_danger(grid, np.asarray(values))
    for first, axes_maxima in _maxima_by_axis(corners.tobytes(), len(low), max(EIGHT, TOGETHER // grid.size)):
        done = {axis_maxima.axis for axis_maxima in axes_maxima}
        # `wanted`, as `Grid.inner`: the nodes at which maxima are asked; axes along which none are taken are cut here
        rest = [slice(None) if axis in done or not wanted else wanted[axis] for axis in range(grid.ndim)]
        # a copy of what may not be written to, for which kernels would be compiled once more
        found = np.require(values[tuple(rest)], requirements=("C", "W"))[None]
        for axis_maxima in axes_maxima:
            some = range(grid.shape[axis_maxima.axis])[wanted[axis_maxima.axis] if wanted else slice(None)]
            leaves = _leaves(axis_maxima, grid, interpolation == "limited", values.dtype.str, some.start, some.stop)
            of_run = Maxima(first, len(axis_maxima.parent), found, axis_maxima.axis, leaves)
            found = of_run.of() if axis_maxima is not axes_maxima[-1] else found
        yield of_run


def one_by_one(groups: Iterable[Any]) -> Iterator[tuple[int, FloatArray]]:
    """Yield (j, the values of box, or input, j) of groups of `Maxima` or `sdhj.solver.games.Pieces`."""
    for some in groups:  # eight are computed at a time
        for begin in range(0, some.number, EIGHT):
            yield from enumerate(some.of(slice(begin, begin + EIGHT)), some.first + begin)


def maximum_over_boxes(
    grid: Grid, values: FloatArray, low: FloatArray, high: FloatArray, interpolation: str
) -> Iterator[tuple[int, FloatArray]]:
    """Yield (j, maximum of `values` over [x + low_j, x + high_j] at each node x)."""
    return one_by_one(maxima(grid, values, low, high, interpolation))


def crossings(half: FloatArray) -> FloatArray:
    """Points (P, ndim) of the segment from -half to half, in cells: its ends, and where it crosses planes of nodes."""
    each = [np.arange(-math.floor(most), math.floor(most) + 1) / most for most in np.abs(half).tolist() if most > 0.0]
    shares = np.concatenate([[-1.0, 1.0], *each])
    # ascending, without repetition
    points = shares[np.unique(np.round(shares, 12), return_index=True)[1], None] * half
    # what rounding has put beside a plane of nodes is put on it, or a node behind it would count by a tiny share
    return np.where(np.abs(points - np.round(points)) < 1e-9, np.round(points), points)


def maximum_over_segments(grid: Grid, values: FloatArray, halves: FloatArray, interpolation: str) -> FloatArray:
    """The maximum (*shape) of `values` over x + the sum of the segments from -half to half, halves (K, ndim)."""
    past = np.where(
        grid.ends_where("holds").any(axis=0), np.ceil(np.abs(halves).sum(axis=0) / grid.spacing).astype(int) + 1, 0
    ).tolist()
    around = [(n, n) for n in past]
    # past a wall the values are continued by that at the wall, and dropped only at the end
    raised, wide = np.pad(out_of_danger(grid, values), around, "edge"), grid.wider(around)
    for half in halves[np.abs(halves).any(axis=1)]:
        points, most = crossings(half / grid.spacing) * grid.spacing, None
        for _, found in maximum_over_boxes(wide, raised, points, points, interpolation):
            most = found if most is None else np.maximum(most, found, out=most)
        raised = np.asarray(most)
    return raised[tuple(slice(n, n + inner) for n, inner in zip(past, grid.shape, strict=True))]


@lru_cache(maxsize=64)
def most_on_padding(grid: Grid) -> FloatArray | None:
    """What values may be at most: minus the distance past a safe end, else +inf; None without padding."""
    if not np.any(grid.padding):
        return None
    # equal grids get one array, which callers must not write to
    far = np.broadcast_to(grid.to_ends("frees"), grid.shape)
    return np.where(far < -SLACK * min(grid.spacing), far, np.inf)


def out_of_danger(grid: Grid, values: FloatArray) -> FloatArray:
    """Values lowered to `most_on_padding`: a new array, or `values` where the grid has no padding."""
    most = most_on_padding(grid)
    return values if most is None else np.minimum(values, most, dtype=values.dtype)
