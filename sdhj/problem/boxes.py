"""Maxima of grid functions over boxes around each node, and the rim of nodes past safe ends.

On a grid the maximum over a box is taken axis by axis: over the two ends of the interval, by interpolation, and over
the nodes between them (`sdhj.solver.hopf_lax` says how, and what for).
"""

from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from sdhj.kernels import FloatArray
from sdhj.kernels.boxes import maximum_of_intervals
from sdhj.kernels.interpolation import SLACK
from sdhj.problem.grid import Grid, Window

Nodes = Sequence[slice]  # of each axis
INTERPOLATIONS = ("linear", "limited")
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


@lru_cache(maxsize=64)
def most_on_rim(grid: Grid) -> FloatArray | None:
    """Minus the distance past safe ends, +inf where nothing is past one, (shape); None where that is everywhere."""
    if not np.any(grid.rim):
        return None
    far = np.broadcast_to(grid.to_ends("safe"), grid.shape)
    return np.where(far < -SLACK * min(grid.spacing), far, np.inf)


def out_of_danger(grid: Grid, values: FloatArray) -> FloatArray:
    """Values (shape) held at most at `most_on_rim`."""
    most = most_on_rim(grid)
    return values if most is None else np.minimum(values, most, dtype=values.dtype)
