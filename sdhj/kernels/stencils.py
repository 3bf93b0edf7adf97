"""Compiled tests of packed cells: which images are in a set, which tubes meet an unsafe set, what a change can reach.

A cell of a set is bit `cell[-1]` of its row; rows count the cells of all other axes, the last of them fastest. How far
an interval moves a cell is given in cells: from cell + low to cell + high on each axis, clipped at the ends of a
bounded one. It depends on some of the axes only: on the cell's *place*, their part of it, a row of `Moves`.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from sdhj.kernels import FloatArray
from sdhj.kernels.compiling import UNCOUNTED, kernel
from sdhj.kernels.packed import BIT, STATE_SLACK, cells_at, has_bit, has_bits, row_and_bit


class Moves(NamedTuple):
    """The cells that everything a cell can lead to lies in: low, high (L, places, ndim) int16, from its own on.

    strides (ndim,) int64: a cell is at the place sum(cell * strides). safe (2, ndim): the safe ends, infinite where
    there are none: of what is past one by a cell or more, and so by more than rounding, no cell is asked for.
    """

    low: FloatArray
    high: FloatArray
    strides: FloatArray
    safe: FloatArray


class Boxes(NamedTuple):
    """Boxes of equal size on the axes that an unsafe set depends on, and how many of them may meet it.

    axes, sizes (d,); lower, pitch, length (d,) in the axes' units; periodic (d,). A periodic axis has two laps. narrow
    (d,): what a tube may stick out of the boxes that it is looked up in, which were wider by more; one that is narrower
    than twice that is looked up in the box around its lower end and `narrow`, which reaches to both of its ends. sums
    (parts, prod(sizes + 1)) int32: the number of boxes that may meet the set below each corner, in each part of the
    interval, or one for all.
    """

    axes: FloatArray
    sizes: FloatArray
    lower: FloatArray
    pitch: FloatArray
    length: FloatArray
    periodic: FloatArray
    narrow: FloatArray
    sums: FloatArray


@kernel(inline="always")
def cell_of(number, counts, cell):
    """Write the cell whose flat number, last axis fastest, is `number`."""
    for back in range(counts.size):
        axis = counts.size - 1 - back
        cell[axis] = number % counts[axis]
        number //= counts[axis]


@kernel(**UNCOUNTED)
def step_on(at, number, axes):
    """From a place of a box, at[axis] < number[axis] for so many axes, to the next, the last axis fastest. In place."""
    axis = axes - 1
    while axis >= 0:
        at[axis] += 1
        if at[axis] < number[axis]:
            break
        at[axis] = 0
        axis -= 1


@kernel(**UNCOUNTED)
def image_inside(cell, low, high, safe, cells, index, pool, room):
    """Whether all cells from cell + low to cell + high are in a set with rows pool[index]; room (3, ndim): scratch.

    safe (2, ndim): see `Moves`.
    """
    first, number, at, last, total = room[0], room[1], room[2], cell.size - 1, 1
    for axis in range(cell.size):
        count, begin, end = cells.counts[axis], cell[axis] + low[axis], cell[axis] + high[axis]
        if not cells.periodic[axis]:
            if (begin > count and safe[1, axis] < np.inf) or (end < -1 and safe[0, axis] > -np.inf):
                return True
            begin, end = min(max(begin, 0), count - 1), min(max(end, 0), count - 1)
        elif end - begin >= count:
            begin, end = 0, count - 1
        first[axis], number[axis], at[axis] = begin % count, end - begin + 1, 0
        total *= number[axis] if axis < last else 1
    whole, begin, end = cells.counts[last], first[last], first[last] + number[last]
    for _ in range(total):
        row = 0
        for axis in range(last):
            count, place = cells.counts[axis], first[axis] + at[axis]
            row = row * count + (place if place < count else place - count)  # a remainder takes longest
        block = pool[index[row]]
        if not has_bits(block, begin, min(end, whole)) or (end > whole and not has_bits(block, 0, end - whole)):
            return False
        step_on(at, number, last)
    return True


@kernel(parallel=True)
def grow(near, inside, following, clear, moves, groups, cells, keep):
    """Of the cells in some words, add those led into `following` by a move of each group; keep: only such stay in.

    near (R, W) bool: the words; inside, following (R, W): the sets, `inside` modified in place. The moves are `groups`
    of one length; of one group of all, clear (cells, bytes) has those that are safe from each cell, otherwise it is
    (0, 0).
    """
    index, ndim = np.arange(len(inside)), cells.counts.size
    for i in prange(len(inside)):
        row = np.int64(i)
        if near[row].any():
            room = np.empty((4, ndim), np.int64)
            grow_row(row, (near[row], inside[row], index, following), clear, moves, groups, cells, keep, room)


@kernel(**UNCOUNTED)
def grow_row(row, sets, clear, moves, groups, cells, keep, room):
    """What `grow` does of one row; sets: (near, inside) of it, (index, pool) as for `image_inside`; room (4, ndim)."""
    (near, inside, index, pool), last, some = sets, cells.counts[-1], moves.low.shape[0] // groups
    cell, scratch, begin, tried = room[0], room[1:], 0, 0
    cell_of(row * last, cells.counts, cell)
    for axis in range(cell.size):
        begin += cell[axis] * moves.strides[axis]
    for bit in range(last):
        if not near[bit >> 6] or has_bit(inside, bit) != keep:
            continue
        cell[cell.size - 1], number, found = bit, row * last + bit, True
        place = begin + bit * moves.strides[cell.size - 1]
        for group in range(groups):
            found = False
            for turn in range(some):
                j = (tried + turn) % some  # what served before is tried first
                at = group * some + j
                if (clear.size == 0 or (clear[number, j >> 3] >> (j & 7)) & 1) and image_inside(
                    cell, moves.low[at, place], moves.high[at, place], moves.safe, cells, index, pool, scratch
                ):
                    found, tried = True, j
                    break
            if not found:
                break
        if found != keep:
            inside[bit >> 6] ^= BIT << np.uint64(bit & 63)


@kernel(**UNCOUNTED)
def reached_words(rows, changed, reach, cells, out, room, hit):
    """Mark the words with cells whose images under some input may hold cells that changed.

    changed (n, W): not 0 in the words of some rows (n,) that have such cells. reach (inputs, 2, ndim): how far each
    input leads from any place, first and last. out (R, W) bool: words are set to True. room (4, ndim - 1) int64 and hit
    (W,) bool: scratch.
    """
    (cell, begin, number, at), last, words = (room[0], room[1], room[2], room[3]), cells.counts.size - 1, out.shape[1]
    for i in range(rows.size):
        cell_of(rows[i], cells.counts[:last], cell)
        for j in range(reach.shape[0]):
            total = 1
            for axis in range(last):
                count, periodic = cells.counts[axis], cells.periodic[axis]
                begin[axis], end = led_from(cell[axis], cell[axis], reach[j, :, axis], count, periodic)
                number[axis], at[axis] = end - begin[axis] + 1, 0
                begin[axis] %= count
                total *= max(number[axis], 0)
            hit[:] = False
            for word in range(words):
                if changed[i, word] != 0:
                    count, bit = cells.counts[last], 64 * word
                    first, end = led_from(bit, min(bit + 63, count - 1), reach[j, :, last], count, cells.periodic[last])
                    end -= first // count * count
                    first %= count
                    hit[first >> 6 : (min(end, count - 1) >> 6) + 1] = True
                    hit[: ((end - count) >> 6) + 1 if end >= count else 0] = True
            for _ in range(total):
                flat = 0
                for axis in range(last):
                    count, place = cells.counts[axis], begin[axis] + at[axis]
                    flat = flat * count + (place if place < count else place - count)  # a remainder takes longest
                for word in range(words):
                    out[flat, word] |= hit[word]
                step_on(at, number, last)


@kernel(inline="always")
def led_from(first, last, reach, count, periodic):
    """The first and the last cell of an axis from which an image may hold one of some cells."""
    begin, end = first - reach[1], last - reach[0]
    if periodic:
        return begin, min(end, begin + count - 1)
    # the end cells are in every image that was clipped
    return 0 if first == 0 else max(begin, 0), count - 1 if last == count - 1 else min(end, count - 1)


@kernel(inline="always")
def boxes_along(low, high, k, lattice):
    """The first of the lattice boxes along an axis that [low, high] overlaps, and the one behind the last."""
    size, pitch, length = lattice.sizes[k], lattice.pitch[k], lattice.length[k]
    begin, end = low - lattice.lower[k], high - lattice.lower[k]
    if lattice.periodic[k]:
        lap = size // 2
        if end - begin >= length:
            return 0, lap
        begin, end = begin - length * math.floor(begin / length), end - length * math.floor(begin / length)
        first = min(math.floor(begin / pitch), lap - 1)
        if end > length:
            last = lap + min(math.ceil((end - length) / pitch), lap)
        else:
            last = min(math.ceil(end / pitch), lap)
    else:
        first = min(max(math.floor(begin / pitch), 0), size - 1)
        last = min(max(math.ceil(end / pitch), 0), size)
    return first, max(last, first + 1)


CHUNKS = 64  # that cells are looked at in, each with scratch memory


class Placed(NamedTuple):
    """Cells by place and the rest: number = begin[place] + offset[rest], rest < free; and their edges.

    Of the rest, so many `abreast` differ on the last axis only, in turn. counts (ndim,); edges (ndim, most + 1);
    safe (2, ndim): the safe ends, infinite where there are none.
    """

    counts: FloatArray
    begin: FloatArray
    offset: FloatArray
    free: int
    abreast: int
    edges: FloatArray
    safe: FloatArray


@kernel(**UNCOUNTED)
def parts_inside(cell, tube, layout):
    """In how many parts of the interval, from the first on, what was in a cell may still be between the safe ends."""
    for axis in range(cell.size):
        if layout.safe[0, axis] > -np.inf or layout.safe[1, axis] < np.inf:
            break
    else:
        return tube.shape[0]
    for part in range(tube.shape[0]):
        for axis in range(cell.size):
            if layout.edges[axis, cell[axis]] + tube[part, axis, 0] > layout.safe[1, axis] + STATE_SLACK or (
                layout.edges[axis, cell[axis] + 1] + tube[part, axis, 1] < layout.safe[0, axis] - STATE_SLACK
            ):
                return part
    return tube.shape[0]


@kernel(parallel=True)
def strike(clear, tubes, places, lattice, bit, layout):
    """Clear a bit of the cells from which a tube may meet an unsafe set.

    clear (cells,) uint8, modified in place; tubes (places, parts, ndim, 2): how far the lower and the upper end of a
    cell at a place move in each part of the interval. places (begin, end) of the cells looked at.
    """
    ndim, last, abreast = layout.counts.size, lattice.axes.size - 1, layout.abreast
    for chunk in prange(CHUNKS):
        cell, at, along = np.empty(ndim, np.int64), np.empty((2, last), np.int64), np.empty((2, abreast), np.int64)
        room = cell, at, along, np.empty(abreast, np.int64), np.empty(abreast, np.bool_)
        strike_chunk(clear, tubes, places, lattice, bit, layout, np.int64(chunk), room)


@kernel(**UNCOUNTED)
def strike_chunk(clear, tubes, places, lattice, bit, layout, chunk, room):
    """What one thread does of `strike`, the chunk of so many of `CHUNKS`."""
    (cell, at, along, found, open_), groups = room, layout.free // layout.abreast
    total = (places[1] - places[0]) * groups
    for i in range(chunk * total // CHUNKS, (chunk + 1) * total // CHUNKS):
        place = places[0] + i // groups
        first = layout.begin[place] + layout.offset[i % groups * layout.abreast]
        left = False
        for n in range(layout.abreast):
            open_[n] = clear[first + n] & bit != 0
            left |= open_[n]
        if left:
            cell_of(first, layout.counts, cell)
            tube = tubes[place - places[0]]
            tube = tube[: parts_inside(cell, tube, layout)]
            some = clear[first : first + layout.abreast]
            strike_abreast(some, cell, tube, lattice, bit, layout.edges, open_, (at, along, found))


@kernel(**UNCOUNTED)
def strike_abreast(clear, cell, tube, lattice, bit, edges, open_, room):
    """Clear a bit of those of some cells (n,), abreast of a first, that are open, where a tube may meet a set.

    open_ (n,) : overwritten. room: at (2, d - 1), along (2, n), the lattice boxes that tubes overlap on all axes but
    the last, and on that; found (n,), how many of them may meet the set.
    """
    axes, kinds, last = lattice.axes, lattice.sums.shape[0], lattice.axes.size - 1
    at, along, found = room
    for part in range(-1 if kinds == 1 else 0, tube.shape[0]):  # where one lattice is that of all, all parts first
        begin, end = (0, tube.shape[0]) if part < 0 else (part, part + 1)
        for k in range(axes.size):
            axis = axes[k]
            low, high = tube[begin, axis, 0], tube[begin, axis, 1]
            for other in range(begin + 1, end):
                low, high = min(low, tube[other, axis, 0]), max(high, tube[other, axis, 1])
            low, high = low + lattice.narrow[k], high - lattice.narrow[k]
            for n in range(open_.size if k == last else 1):
                number = cell[axis] + n
                ends = boxes_along(edges[axis, number] + low, edges[axis, number + 1] + high, k, lattice)
                if k == last:
                    along[0, n], along[1, n] = ends
                else:
                    at[0, k], at[1, k] = ends
        counted, found[:] = lattice.sums[max(part, 0) % kinds], 0
        for corner in range(1 << last):
            flat, sign = 0, 1
            for k in range(last):
                side = (corner >> k) & 1
                sign = sign if side else -sign
                flat = flat * (lattice.sizes[k] + 1) + at[side, k]
            flat *= lattice.sizes[last] + 1
            for n in range(open_.size):
                found[n] += sign * (counted[flat + along[1, n]] - counted[flat + along[0, n]])
        left = False
        for n in range(open_.size):
            if open_[n] and (found[n] > 0) == (part >= 0):
                open_[n] = False
                if part >= 0:
                    clear[n] &= ~bit
            left |= open_[n]
        if not left:
            return


@kernel(parallel=True)
def strike_ends(clear, tubes, places, faces, bit, layout):
    """As `strike`, of the unsafe ends: faces (2, ndim), infinite where there is none."""
    ndim = layout.counts.size
    for chunk in prange(CHUNKS):
        room = np.empty(ndim, np.int64), np.empty((2, ndim))
        strike_ends_chunk(clear, tubes, places, faces, bit, layout, np.int64(chunk), room)


@kernel(**UNCOUNTED)
def strike_ends_chunk(clear, tubes, places, faces, bit, layout, chunk, room):
    """What one thread does of `strike_ends`; how far (2, ndim) the ends of a cell get is kept while that is so."""
    cell, far = room
    total, known, edges = (places[1] - places[0]) * layout.free, (-1, -1), layout.edges
    for i in range(chunk * total // CHUNKS, (chunk + 1) * total // CHUNKS):
        place = places[0] + i // layout.free
        number, tube = layout.begin[place] + layout.offset[i % layout.free], tubes[place - places[0]]
        cell_of(number, layout.counts, cell)
        parts = parts_inside(cell, tube, layout)
        if known != (place, parts):
            known, far[0], far[1] = (place, parts), np.inf, -np.inf
            for part in range(parts):
                for axis in range(cell.size):
                    far[0, axis] = min(far[0, axis], tube[part, axis, 0])
                    far[1, axis] = max(far[1, axis], tube[part, axis, 1])
        for axis in range(cell.size):
            if edges[axis, cell[axis]] + far[0, axis] < faces[0, axis] or (
                edges[axis, cell[axis] + 1] + far[1, axis] > faces[1, axis]
            ):
                clear[number] &= ~bit


@kernel(nogil=True)
def certified_inputs(states, cells, moves, clear, index, pool, out):
    """Inputs that are safe and lead into a set with rows pool[index], of all cells within STATE_SLACK of each state.

    clear (cells, bytes); out (M, L) bool, overwritten. Where the pool is empty: inputs that are safe.
    """
    ndim = states.shape[1]
    found, room = np.empty((1 << ndim, ndim), np.int64), np.empty((3, ndim), np.int64)
    out[:] = False
    for m in range(states.shape[0]):
        for k in range(cells_at(states[m], cells, found)):
            cell = found[k]
            row, bit = row_and_bit(cell, cells)
            safe, place = clear[row * cells.counts[-1] + bit], np.sum(cell * moves.strides)
            for j in range(out.shape[1]):
                if (safe[j >> 3] >> (j & 7)) & 1 and not out[m, j]:
                    out[m, j] = pool.size == 0 or image_inside(
                        cell, moves.low[j, place], moves.high[j, place], moves.safe, cells, index, pool, room
                    )
