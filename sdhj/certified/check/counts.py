"""How many cells of a set lie in a box, by counts at its corners: of many boxes one after the other, compiled.

What is counted is the cells of a set (`Robot.leads`), or the boxes of a lattice that may meet one (`lattice`).
"""

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from sdhj.certified.check.bits import Array, compiled

RUN = 16  # tubes, around which one box is looked up first
MOST = 1 << 62  # more than any number of a cell or a box

Spans = tuple[Array, Array, Array]  # of `spans_of`


def sums(inside: Array, periodic: Array) -> Array:
    """How many cells of a set lie below each corner on all axes: (*(n + 1)) int32.

    A periodic axis counts twice over: n is doubled there, so that boxes may go over the seam.

    inside (*n) : bool, which cells are in the set. periodic (axes,) : bool.
    """
    for axis in np.flatnonzero(periodic):
        inside = np.concatenate([inside] * 2, axis=axis)
    out = np.zeros([n + 1 for n in inside.shape], np.int32)
    out[(slice(1, None),) * inside.ndim] = inside
    for each, n in enumerate(out.shape):
        add_up(out.reshape(-1), n, math.prod(out.shape[each + 1 :]))
    return out


@compiled()
def add_up(flat, n, stride):
    """Add to each entry of a flat array those before it along one axis, of n entries `stride` apart; in place."""
    for begin in range(0, flat.size, n * stride):
        for at in range(begin + stride, begin + n * stride):
            flat[at] += flat[at - stride]


@lru_cache(maxsize=64)
def strides_of(shape: tuple[int, ...]) -> Array:
    """How far entries next to each other along each axis are apart in an array that is flat, the last axis fastest.

    Not to be modified: it is asked for at each input and step, and kept.
    """
    return np.cumprod([1, *shape[:0:-1]])[::-1].astype(np.int64)


@compiled()
def cells_in(counted, strides, first, past):
    """How many cells of a box are in a set, by inclusion and exclusion.

    counted : what `sums` returns for the set, flat. strides (axes,) : its `strides_of`.
    first, past (axes,) : int, the first cell of the box and the one past the last; on a periodic axis up to twice the
        number of cells. Not checked.
    """
    total = 0
    for corner in range(1 << strides.size):
        at, sign = 0, 1
        for axis in range(strides.size):
            upper = (corner >> axis) & 1
            at += (past[axis] if upper else first[axis]) * strides[axis]
            sign = sign if upper else -sign
        total += sign * counted[at]
    return total


@compiled()
def box_inside(counted, strides, counts, periodic, first, past):
    """Whether all cells of a box are in a set; the box is clipped at bounded ends and goes around periodic axes.

    counted, strides : of the set (`cells_in`). counts (axes,) : how many cells there are. periodic (axes,) : bool.
    first, past (axes,) : int, any cells, past > first; overwritten.
    """
    size = 1
    for axis in range(counts.size):
        n = counts[axis]
        if not periodic[axis]:
            first[axis], past[axis] = min(max(first[axis], 0), n - 1), min(max(past[axis], 1), n)
        elif past[axis] - first[axis] > n:
            first[axis], past[axis] = 0, n
        else:
            turns = first[axis] // n * n
            first[axis], past[axis] = first[axis] - turns, past[axis] - turns
        size *= past[axis] - first[axis]
    return cells_in(counted, strides, first, past) == size  # check 3.44


@compiled()
def led_into(counted, strides, counts, periodic, safe, low, high, of_places, numbers, out):
    """out[m] = whether all that the cell with flat number numbers[m] is led to is in a set, or out past a safe end.

    What has wholly left over a safe end by a cell is out.

    counted, strides, counts, periodic : of the set (`box_inside`). safe (axes, 2) : bool, which ends are safe.
    low, high (places, axes) : the first and the last cell that a cell is led to, less its own index.
    of_places (axes,) : the cell's place is the sum of these times its indices.
    """
    ndim = counts.size
    own, first, past = np.empty(ndim, np.int64), np.empty(ndim, np.int64), np.empty(ndim, np.int64)
    for m in range(numbers.size):
        number, place = numbers[m], 0
        for axis in range(ndim - 1, -1, -1):
            own[axis] = number % counts[axis]
            number //= counts[axis]
            place += own[axis] * of_places[axis]
        gone = False
        for axis in range(ndim):
            first[axis], past[axis] = own[axis] + low[place, axis], own[axis] + high[place, axis] + 1
            gone |= safe[axis, 0] and past[axis] < 0  # check 3.49
            gone |= safe[axis, 1] and first[axis] > counts[axis]  # check 3.50
        out[m] = gone or box_inside(counted, strides, counts, periodic, first, past)


def spans_of(ends: Sequence[tuple[Array, Array]]) -> Spans:
    """Which boxes tubes overlap along each axis, as `tubes_miss` reads it: ends (2, K), begins and widths (axes,).

    ends : for each axis the first and the last box (`Lattice.overlapped`), both (tubes, width); width is 1, or the
        number of cells, for what depends on the cell.
    """
    widths = np.array([first.shape[1] for first, _ in ends])
    begins = np.cumsum([0, *(first.size for first, _ in ends)])[:-1]
    return np.stack([np.concatenate([pair[side].ravel() for pair in ends]) for side in (0, 1)]), begins, widths


@compiled()
def tubes_miss(counted, strides, ends, begins, widths, cells, numbers, tubes, some, out):
    """out[m] = whether the tube of cell some[m] overlaps no box that is counted.

    A box around the tubes of `RUN` cells is looked up first: mostly none is counted there. As cells mostly follow one
    another, the index of a cell is worked out anew, by a division, only where that of the cell before has ended.

    counted, strides : of the boxes (`cells_in`). ends, begins, widths : what `spans_of` returns.
    cells (axes,) : the strides of cells along the lattice's axes. numbers, tubes (M,) : of each cell the flat number,
        and which of the tubes of `spans_of` is its.
    """
    ndim = strides.size
    places, first, past = np.empty((ndim, RUN), np.int64), np.empty(ndim, np.int64), np.empty(ndim, np.int64)
    for begin in range(0, some.size, RUN):
        size = min(RUN, some.size - begin)
        for axis in range(ndim):
            stride, width, least, most = cells[axis], widths[axis], MOST, 0
            start, own = MOST, 0  # the first cell with this index, and the index
            for m in range(size):
                cell = some[begin + m]
                number = numbers[cell]
                if not 0 <= number - start < stride:
                    start, own = number // stride * stride, number // stride % width
                at = begins[axis] + tubes[cell] * width + own
                places[axis, m] = at
                least, most = min(least, ends[0, at]), max(most, ends[1, at])
            first[axis], past[axis] = least, most + 1
        none = cells_in(counted, strides, first, past) == 0  # check 4.78
        for m in range(size):
            for axis in range(0 if none else ndim):
                first[axis], past[axis] = ends[0, places[axis, m]], ends[1, places[axis, m]] + 1
            out[begin + m] = none or cells_in(counted, strides, first, past) == 0  # check 4.63


@compiled()
def flags_at(flags, stride, numbers, tubes, some, out):
    """out[m] &= flags[tubes[c], n] for cell c = some[m], whose index along an axis is n; in place.

    flags (tubes, width) : bool; width is 1, or the number of cells along the axis. stride : of cells along the axis.
    numbers, tubes (M,) : of each cell the flat number, and which of the rows of `flags` is its.
    """
    for m in range(some.size):
        cell = some[m]
        out[m] &= flags[tubes[cell], numbers[cell] // stride % flags.shape[1]]
