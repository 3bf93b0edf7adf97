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
from sdhj.kernels.packed import BIT, bits_between, has_bit, has_bits, row_and_bit, shifted_word


class Moves(NamedTuple):
    """The cells that everything a cell can lead to lies in: low, high (L, places, ndim) int16, from its own on.

    strides (ndim,) int64: a cell is at the place sum(cell * strides). safe (2, ndim): the safe ends, infinite where
    there are none: of what is past one by a cell or more, and so by more than rounding, no cell is asked for.

    Where images are oblique (`sdhj.certified.oblique`), lines (L, places, rows, 2) int16: the first and the last cell
    along the last axis, from a cell's own on, of each row of the box on some `oblique` (ndim,) axes; halo (2, ndim):
    cells with fewer cells before or behind them have boxes. Else lines are of no inputs.
    """

    low: FloatArray
    high: FloatArray
    strides: FloatArray
    safe: FloatArray
    lines: FloatArray = np.zeros((0, 0, 0, 2), np.int16)
    oblique: FloatArray = np.zeros(0, np.bool_)
    halo: FloatArray = np.zeros((2, 0), np.int64)


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
    """Write to cell (ndim,) the indices of the cell whose flat number, last axis fastest, is `number`; counts
    (ndim,).
    """
    for back in range(counts.size):
        axis = counts.size - 1 - back
        cell[axis] = number % counts[axis]
        number //= counts[axis]


@kernel(**UNCOUNTED)
def step_on(at, number, axes):
    """Move `at` from one place of a box, at[axis] < number[axis] for so many axes, to the next, the last axis
    fastest; after the last one to the first. In place.
    """
    axis = axes - 1
    while axis >= 0:
        at[axis] += 1
        if at[axis] < number[axis]:  # obligation 3.1
            break
        at[axis] = 0
        axis -= 1


@kernel(**UNCOUNTED)
def box_of_image(cell, low, high, safe, cells, axes, box):
    """Write to box (3, ndim) the first cell, the number of cells, and a begin of 0, of the image cell + low to cell +
    high on the first `axes` axes; returns how many rows these are.

    Rows are of all axes but the last. On a bounded axis the image is clipped at the ends. It is 0 where the image is
    past a safe end (2, ndim), see `Moves`.
    """
    first, number, at, total = box[0], box[1], box[2], 1
    for axis in range(axes):
        count, begin, end = cells.counts[axis], cell[axis] + low[axis], cell[axis] + high[axis]
        if not cells.periodic[axis]:
            if (begin > count and safe[1, axis] < np.inf) or (end < -1 and safe[0, axis] > -np.inf):  # obligation 3.4
                return 0
            begin, end = min(max(begin, 0), count - 1), min(max(end, 0), count - 1)
        elif end - begin >= count:
            begin, end = 0, count - 1
        first[axis], number[axis], at[axis] = begin, end - begin + 1, 0
        if not 0 <= begin < count:  # a remainder takes longest
            first[axis] = begin % count
        total *= number[axis] if axis < cell.size - 1 else 1
    return total


@kernel(inline="always")
def row_of_box(box, cells):
    """The number of the row of cells that the begin of a box (`box_of_image`) stands at."""
    row = 0
    for axis in range(cells.counts.size - 1):
        count, place = cells.counts[axis], box[0, axis] + box[2, axis]
        row = row * count + (place if place < count else place - count)  # a remainder takes longest
    return row


@kernel(**UNCOUNTED)
def image_inside(cell, low, high, safe, cells, index, pool, scratch):
    """Whether all cells from cell + low to cell + high are in a set with rows pool[index]; scratch (3, ndim).

    safe (2, ndim): see `Moves`. True where the image is past a safe end.
    """
    return rows_inside(box_of_image(cell, low, high, safe, cells, cell.size, scratch), cells, index, pool, scratch)


@kernel(**UNCOUNTED)
def rows_inside(total, cells, index, pool, scratch):
    """Whether all cells of the box in `scratch`, as `box_of_image` left it, with `total` rows, are in a set with
    rows pool[index]; its begin is overwritten.
    """
    last = cells.counts.size - 1
    whole, begin, end = cells.counts[last], scratch[0, last], scratch[0, last] + scratch[1, last]
    word, short = begin >> 6, end <= whole and (end - 1) >> 6 == begin >> 6
    asked = bits_between(word, begin, end)  # all of them where it is short, which most are  # obligation 3.2
    for _ in range(total):
        block = pool[index[row_of_box(scratch, cells)]]
        if short:
            if block[word] & asked != asked:
                return False
        # obligation 3.3
        elif not has_bits(block, begin, min(end, whole)) or (end > whole and not has_bits(block, 0, end - whole)):
            return False
        step_on(scratch[2], scratch[1], last)
    return True


@kernel(**UNCOUNTED)
def has_lines(cell, moves, cells, axes):
    """Whether the image of a cell is lines of `moves` (`Moves`): there are some, and the cell is at least `halo`
    cells from the ends of the first `axes` axes.
    """
    for axis in range(axes if moves.lines.shape[0] > 0 else 0):
        # obligation 3.20
        if cell[axis] < moves.halo[0, axis] or cell[axis] >= cells.counts[axis] - moves.halo[1, axis]:
            return False
    return moves.lines.shape[0] > 0


@kernel(inline="always")
def line_of_box(box, oblique):
    """The number of the line of `Moves` that the begin of a box (`box_of_image`) stands at, by the axes that are
    oblique.
    """
    line = 0
    for axis in range(oblique.size - 1):
        if oblique[axis]:
            line = line * box[1, axis] + box[2, axis]
    return line


@kernel(**UNCOUNTED)
def move_inside(cell, j, place, moves, cells, index, pool, scratch):
    """Whether the image of a cell at a place under move j of `moves` (`Moves`), a box or lines, is in a set with
    rows pool[index]; scratch (3, ndim) as for `image_inside`.
    """
    last = cell.size - 1
    total = box_of_image(cell, moves.low[j, place], moves.high[j, place], moves.safe, cells, cell.size, scratch)
    if not has_lines(cell, moves, cells, cell.size):
        return rows_inside(total, cells, index, pool, scratch)
    whole = cells.counts[last]
    for _ in range(total):
        line = moves.lines[j, place, line_of_box(scratch, moves.oblique)]
        begin, end = cell[last] + line[0], cell[last] + line[1] + 1
        if not cells.periodic[last]:
            begin, end = min(max(begin, 0), whole - 1), max(min(end, whole), 1)
        elif end - begin >= whole:
            begin, end = 0, whole
        else:
            begin, end = begin % whole, begin % whole + end - begin  # obligation 3.27
        if line[0] <= line[1]:  # obligation 3.22
            block = pool[index[row_of_box(scratch, cells)]]
            if not has_bits(block, begin, min(end, whole)):  # obligation 3.23
                return False
            if end > whole and not has_bits(block, 0, end - whole):  # obligation 3.28
                return False
        step_on(scratch[2], scratch[1], last)
    return True


@kernel(inline="always")
def runs_of_ones(block, begin, length):
    """A word whose bit b is set where bits begin + b to begin + b + length - 1 of a block are all set, 1 <=
    length <= 64.
    """
    low, high, run = shifted_word(block, 0, begin), shifted_word(block, 0, begin + 64), 1
    while run < length:  # obligation 3.5
        more = min(run, length - run)
        low &= low >> np.uint64(more) | high << np.uint64(64 - more)
        high &= high >> np.uint64(more)
        run += more
    return low


@kernel(inline="always")
def runs(block, begin, length):
    """A word whose bit b is set where bits begin + b to begin + b + length - 1 of a block are all set, of any
    length; all ones where that is 0 or less.
    """
    out = ~np.uint64(0)
    for at in range(0, length, 64):
        out &= runs_of_ones(block, begin + at, min(length - at, 64))
    return out


@kernel(**UNCOUNTED)
def images_inside(word, cell, place, moves, cells, extended, scratch, found):
    """Write to found (L,) uint64, a bit for each, which of the 64 cells of word number `word` have their image under
    each move in a set; returns the OR of these.

    cell (ndim,), of all but the last axis, and the place of all these cells. extended (R, margin + W + margin): the
    rows of the set with what comes before and behind them on the last axis, in words. scratch (3, ndim): overwritten.
    """
    last, count, some = cell.size - 1, cells.counts[cell.size - 1], np.uint64(0)
    start = 32 * (extended.shape[1] - ((count + 63) >> 6)) + 64 * word  # half of what is more is before
    inner = np.uint64(0)  # the cells of which images are lines
    for bit in range(64 if has_lines(cell, moves, cells, last) else 0):
        if moves.halo[0, last] <= 64 * word + bit < count - moves.halo[1, last]:  # obligation 3.25
            inner |= BIT << np.uint64(bit)
    for j in range(found.size):
        total = box_of_image(cell, moves.low[j, place], moves.high[j, place], moves.safe, cells, last, scratch)
        begin, length = start + moves.low[j, place, last], 1 + moves.high[j, place, last] - moves.low[j, place, last]
        found[j] = ~np.uint64(0)
        for _ in range(total):
            block = extended[row_of_box(scratch, cells)]
            if inner != ~np.uint64(0):
                found[j] &= runs(block, begin, min(length, count)) | inner
            if inner != 0:
                line = moves.lines[j, place, line_of_box(scratch, moves.oblique)]
                # obligation 3.26
                found[j] &= runs(block, start + line[0], min(1 + line[1] - line[0], count)) | ~inner
            if found[j] == 0:
                break
            step_on(scratch[2], scratch[1], last)
        some |= found[j]
    return some


@kernel(parallel=True)
def grow(near, inside, following, clear, moves, groups, cells, keep):
    """Of the cells in words that are `near`, add those that a move of each group leads into `following`; keep: of those
    in `inside`, keep only such.

    near (R, W) bool: the words; inside, following (R, W): the sets, `inside` modified in place. The moves are `groups`
    of one length; of one group of all, clear (cells, bytes) has those that are safe from each cell, otherwise it is (0,
    0). Where all cells along the last axis are at one place, `following` may be extended as in `images_inside`.
    """
    index, ndim, (rows, words) = np.arange(len(inside)), cells.counts.size, inside.shape
    for i in prange(rows):
        row = np.int64(i)
        if near[row].any():
            images_in = np.empty(moves.low.shape[0] if following.shape[1] > words else 0, np.uint64)
            scratch = np.empty((4, ndim), np.int64), images_in
            grow_row(row, (near[row], inside[row], index, following), clear, moves, groups, cells, keep, scratch)


@kernel(**UNCOUNTED)
def grow_row(row, sets, clear, moves, groups, cells, keep, scratch):
    """`grow` for one row; sets: (near (W,), inside (W,)) of it, in place, (index, pool) as for `image_inside`;
    scratch: (4, ndim) int64, and (L,) uint64 where the pool is extended; the others as for `grow`.
    """
    (near, inside, index, pool), (indices, images_in), begin, tried = sets, scratch, 0, 0
    last, each, some, cell = cells.counts[-1], moves.low.shape[0] // groups, ~np.uint64(0), indices[3]
    cell_of(row * last, cells.counts, cell)
    for axis in range(cell.size):
        begin += cell[axis] * moves.strides[axis]
    for bit in range(last):
        if not near[bit >> 6]:
            continue
        if bit & 63 == 0 and images_in.size > 0:
            some = images_inside(bit >> 6, cell, begin, moves, cells, pool, indices, images_in)
        if has_bit(inside, bit) != keep:  # obligation 3.11
            continue
        cell[cell.size - 1], number, found = bit, row * last + bit, (some >> np.uint64(bit & 63)) & BIT != 0
        place = begin + bit * moves.strides[cell.size - 1]
        for group in range(groups if found else 0):
            found = False
            for turn in range(each):
                j = (tried + turn) % each  # what served before is tried first
                at = group * each + j
                if clear.size > 0 and not (clear[number, j >> 3] >> (j & 7)) & 1:  # obligation 3.7
                    continue
                if images_in.size > 0:
                    found = (images_in[at] >> np.uint64(bit & 63)) & BIT != 0
                else:
                    found = move_inside(cell, at, place, moves, cells, index, pool, indices)
                if found:
                    tried = j
                    break
            if not found:
                break
        if found != keep:
            inside[bit >> 6] ^= BIT << np.uint64(bit & 63)


@kernel(parallel=True)
def add_marked(inside, clear, marks, strides, counts):
    """Add to a set, in place, the cells with a bit in both clear[cell] and marks[site], (cells, bytes) and (sites,
    bytes).

    inside (R, W): the set; a cell is at the site sum(cell * strides), strides and counts (ndim,).
    """
    last = counts[counts.size - 1]
    for i in prange(inside.shape[0]):
        site, rest = 0, np.int64(i)
        for back in range(1, counts.size):
            axis = counts.size - 1 - back
            site += rest % counts[axis] * strides[axis]
            rest //= counts[axis]
        for bit in range(last):
            at = site + bit * strides[counts.size - 1]
            for byte in range(marks.shape[1]):
                if marks[at, byte] & clear[i * last + bit, byte]:  # obligation 9.15
                    inside[i, bit >> 6] |= BIT << np.uint64(bit & 63)


@kernel(**UNCOUNTED)
def reached_words(rows, changed, far, cells, out, scratch, hit):
    """Mark in out (R, W) bool the words with cells whose images under some input may hold cells that changed: words are
    set to True, none to False.

    changed (n, W): not 0 in the words of some rows (n,) that have such cells. far (inputs, 2, ndim): how far each input
    leads from any place, first and last. scratch (4, ndim - 1) int64, hit (W,) bool.
    """
    (cell, begin, number, at), last, words = (
        (scratch[0], scratch[1], scratch[2], scratch[3]),
        cells.counts.size - 1,
        out.shape[1],
    )
    for i in range(rows.size):
        cell_of(rows[i], cells.counts[:last], cell)
        for j in range(far.shape[0]):
            total = 1
            for axis in range(last):
                count, periodic = cells.counts[axis], cells.periodic[axis]
                begin[axis], end = predecessors_along(cell[axis], cell[axis], far[j, :, axis], count, periodic)
                number[axis], at[axis] = end - begin[axis] + 1, 0
                begin[axis] %= count
                total *= max(number[axis], 0)
            hit[:] = False
            for word in range(words):
                if changed[i, word] != 0:
                    count, bit = cells.counts[last], 64 * word
                    first, end = predecessors_along(
                        bit, min(bit + 63, count - 1), far[j, :, last], count, cells.periodic[last]
                    )
                    end -= first // count * count
                    first %= count
                    hit[first >> 6 : (min(end, count - 1) >> 6) + 1] = True  # obligation 3.10
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
def predecessors_along(first, last, far, count, periodic):
    """The first and the last cell of an axis of `count` cells from which an image, far[0] to far[1] cells on, may
    hold one of the cells first to last; on a periodic axis unwrapped.
    """
    begin, end = first - far[1], last - far[0]  # obligation 3.8
    if periodic:
        return begin, min(end, begin + count - 1)
    # the end cells are in every image that was clipped
    return 0 if first == 0 else max(begin, 0), count - 1 if last == count - 1 else min(end, count - 1)  # obligation 3.9


@kernel(inline="always")
def boxes_along(low, high, k, lattice):
    """The number of the first of the lattice boxes along its k-th axis that [low, high], in the axis's unit,
    overlaps, and of the one behind the last; at least one. On a periodic axis in two laps.
    """
    size, pitch, length = lattice.sizes[k], lattice.pitch[k], lattice.length[k]
    begin, end = low - lattice.lower[k], high - lattice.lower[k]
    if lattice.periodic[k]:
        lap = size // 2
        if end - begin >= length:
            return 0, lap
        # obligation 4.19
        begin, end = begin - length * math.floor(begin / length), end - length * math.floor(begin / length)
        first = min(math.floor(begin / pitch), lap - 1)
        if end > length:  # obligation 4.18
            last = lap + min(math.ceil((end - length) / pitch), lap)
        else:
            last = min(math.ceil(end / pitch), lap)
    else:
        first = min(max(math.floor(begin / pitch), 0), size - 1)  # obligation 4.17
        last = min(max(math.ceil(end / pitch), 0), size)  # obligation 4.16
    return first, max(last, first + 1)


CHUNKS = 64  # that cells are looked at in, each with scratch memory
SEGMENT = 16  # cells of a line that are looked up together first


class Placed(NamedTuple):
    """Cells by place, in lines along an axis: number = begin[place] + offset[line] + n * stride, n < length.

    Of `mark_collisions` the axis is one of the lattice's, also where a line is a single cell. counts (ndim,); edges
    (ndim, most + 1): where cells begin and end; safe (2, ndim): what is past these has left by a safe end; infinite
    where there are none.
    """

    counts: FloatArray
    begin: FloatArray
    offset: FloatArray
    axis: int
    stride: int
    length: int
    edges: FloatArray
    safe: FloatArray


@kernel(**UNCOUNTED)
def parts_inside(cell, tube, layout):
    """In how many of the parts of the interval, from the first on, what was in a cell may still be between the
    safe ends of the layout (`Placed`); tube (parts, ndim, 2): how far its ends move in each.
    """
    for axis in range(cell.size):
        if layout.safe[0, axis] > -np.inf or layout.safe[1, axis] < np.inf:
            break
    else:
        return tube.shape[0]
    for part in range(tube.shape[0]):
        for axis in range(cell.size):
            # obligation 4.30
            if layout.edges[axis, cell[axis]] + tube[part, axis, 0] > layout.safe[1, axis] or (
                layout.edges[axis, cell[axis] + 1] + tube[part, axis, 1] < layout.safe[0, axis]
            ):
                return part
    return tube.shape[0]


@kernel(parallel=True)
def mark_collisions(clear, tubes, places, lattice, bit, layout):
    """Clear a bit (a mask) of the cells from which a tube may meet an unsafe set: of clear (cells,) uint8, in place.

    tubes (places, parts, ndim, 2): how far the lower and the upper end of a cell at a place move in each part of the
    interval. places: (begin, end) of those looked at. lattice: the `Boxes` that may meet the set. layout: the cells in
    lines along an axis of the lattice.
    """
    d, spans, length = lattice.axes.size, tubes.shape[1] + 1, layout.length
    for chunk in prange(CHUNKS):
        cell, known, at = np.empty(layout.counts.size, np.int64), np.full(spans, -1), np.empty((2, d), np.int64)
        along, hulls = np.empty((spans, 2, length), np.int64), np.empty((spans, 2, length // SEGMENT + 1), np.int64)
        scratch = cell, known, along, hulls, np.empty((2, 1 << d - 1), np.int64), at, np.empty((2, length), np.int64)
        mark_collisions_in_chunk(clear, tubes, places, lattice, bit, layout, np.int64(chunk), scratch)


@kernel(**UNCOUNTED)
def mark_collisions_in_chunk(clear, tubes, places, lattice, bit, layout, chunk, scratch):
    """`mark_collisions` for chunk number `chunk` of `CHUNKS` of the cells, with its arguments; scratch: arrays that are
    overwritten.

    Span 0 is the whole interval, the others are its parts: only what is met in some of them is looked up in each.
    """
    (cell, known, along, hulls, corner, at, (left, met)), lines, sums = scratch, layout.offset.size, lattice.sums
    total = (places[1] - places[0]) * lines
    for i in range(chunk * total // CHUNKS, (chunk + 1) * total // CHUNKS):
        place = i // lines
        first, tube = layout.begin[places[0] + place] + layout.offset[i % lines], tubes[place]
        cell_of(first, layout.counts, cell)
        begin, more = cell[layout.axis], 0
        for n in range(left.size):
            left[n] = parts_inside(cell, tube, layout) if clear[first + n * layout.stride] & bit else 0
            cell[layout.axis] += 1
            more += left[n]
        for span in range(known.size if more > 0 else 0):
            if known[span] != place:
                boxes_of_a_line(begin, span, tube, lattice, layout, (along[span], hulls[span]))
                known[span] = place
            corners_of_a_line(cell, span, tube, lattice, layout, (corner, at))
            # obligation 4.24
            count_in_a_line(sums[(span - 1) % len(sums)], corner, along[span], hulls[span], left, met)
            more = 0
            for n in range(left.size):
                if span > 0 and span <= left[n] and met[n] > 0:
                    clear[first + n * layout.stride] &= ~bit
                left[n] = left[n] if (met[n] > 0) == (span == 0) else 0
                more += left[n]
            if more == 0:
                break


@kernel(inline="always")
def swept_boxes(number, span, tube, k, lattice, edges):
    """The first of the lattice boxes (`Boxes`) along its k-th axis that the tube of cell `number` of that axis
    overlaps, and the one behind the last.

    tube (parts, ndim, 2): how far the lower and upper end of the cell move in each part of the interval; span: 0 of the
    whole interval, else of part span - 1. edges (ndim, most + 1): where cells begin and end.
    """
    axis, begin, end = lattice.axes[k], max(span - 1, 0), span if span > 0 else tube.shape[0]
    low, high = tube[begin, axis, 0], tube[begin, axis, 1]
    for part in range(begin + 1, end):
        low, high = min(low, tube[part, axis, 0]), max(high, tube[part, axis, 1])
    low, high = low + lattice.narrow[k], high - lattice.narrow[k]  # obligation 4.20
    return boxes_along(edges[axis, number] + low, edges[axis, number + 1] + high, k, lattice)


@kernel(**UNCOUNTED)
def boxes_of_a_line(begin, span, tube, lattice, layout, scratch):
    """Write `swept_boxes` along a line that begins at cell `begin`, times the step of its axis in the sums: scratch is
    along (2, length), first and behind last of each cell, and hulls (2, segments), of each segment.

    span, tube, lattice : as for `swept_boxes`; layout : the `Placed`.
    """
    (along, hulls), step = scratch, 1
    for k in range(lattice.axes.size - 1, -1, -1):
        if lattice.axes[k] == layout.axis:
            hulls[0], hulls[1] = step * lattice.sizes[k], 0
            for n in range(along.shape[1]):
                first, last = swept_boxes(begin + n, span, tube, k, lattice, layout.edges)  # obligation 4.21
                along[0, n], along[1, n], segment = step * first, step * last, n // SEGMENT
                hulls[0, segment] = min(hulls[0, segment], along[0, n])
                hulls[1, segment] = max(hulls[1, segment], along[1, n])  # obligation 4.22
        step *= lattice.sizes[k] + 1


@kernel(**UNCOUNTED)
def corners_of_a_line(cell, span, tube, lattice, layout, scratch):
    """Write where, on all axes but a line's, the corners of `swept_boxes` of a cell (ndim,) are in the sums, and which
    are subtracted.

    scratch : corner (2, 2^(d - 1)), places, and 1 or -1; at (2, d), overwritten. span, tube, lattice : as for
        `swept_boxes`; layout : the `Placed`.
    """
    (corner, at), d = scratch, lattice.axes.size
    for k in range(d):
        if lattice.axes[k] != layout.axis:
            at[0, k], at[1, k] = swept_boxes(cell[lattice.axes[k]], span, tube, k, lattice, layout.edges)
    for c in range(corner.shape[1]):
        flat, sign, sides = 0, 1, c
        for k in range(d):
            flat *= lattice.sizes[k] + 1
            if lattice.axes[k] != layout.axis:
                flat += at[sides & 1, k]  # obligation 4.23
                sign = sign if sides & 1 else -sign
                sides >>= 1
        corner[0, c], corner[1, c] = flat, sign


@kernel(**UNCOUNTED)
def count_in_a_line(sums, corner, along, hulls, left, met):
    """Write to met (length,) how many boxes that may meet the set each cell's tube overlaps, by differences of `sums`;
    0 in segments in which nothing is left, or none overlaps.

    Segments are looked up first: corner (2, 2^(d - 1)), along (2, length) and hulls (2, segments) as in the functions
    above.
    """
    for segment in range(hulls.shape[1]):
        begin, end, found = segment * SEGMENT, min((segment + 1) * SEGMENT, left.size), 0
        met[begin:end] = 0
        for c in range(corner.shape[1]):
            flat, sign = corner[0, c], corner[1, c]
            found += sign * (sums[flat + hulls[1, segment]] - sums[flat + hulls[0, segment]])
        if found > 0 and left[begin:end].any():
            for c in range(corner.shape[1]):
                flat, sign = corner[0, c], corner[1, c]
                for n in range(begin, end):
                    met[n] += sign * (sums[flat + along[1, n]] - sums[flat + along[0, n]])


@kernel(parallel=True)
def mark_exits(clear, tubes, places, faces, bit, layout):
    """Clear a bit (a mask) of the cells from which a tube may leave by an unsafe end: of clear (cells,) uint8, in
    place; faces (2, ndim): these ends, infinite for others. tubes, places, layout : as for `mark_collisions`.
    """
    ndim = layout.counts.size
    for chunk in prange(CHUNKS):
        scratch = np.empty(ndim, np.int64), np.empty((2, ndim))
        mark_exits_in_chunk(clear, tubes, places, faces, bit, layout, np.int64(chunk), scratch)


@kernel(**UNCOUNTED)
def mark_exits_in_chunk(clear, tubes, places, faces, bit, layout, chunk, scratch):
    """`mark_exits` for chunk number `chunk` of `CHUNKS`, with its arguments; scratch: a cell (ndim,), and how far
    a cell's ends get (2, ndim), overwritten.
    """
    (cell, far), lines, along = scratch, layout.offset.size, layout.axis
    total, known, left = (places[1] - places[0]) * lines, (-1, -1), False
    for i in range(chunk * total // CHUNKS, (chunk + 1) * total // CHUNKS):
        place = places[0] + i // lines
        first, tube = layout.begin[place] + layout.offset[i % lines], tubes[place - places[0]]
        cell_of(first, layout.counts, cell)
        begin = cell[along]
        for n in range(layout.length):
            cell[along] = begin + n
            parts = parts_inside(cell, tube, layout)
            new = known != (place, parts)
            if new:
                known, far[0], far[1] = (place, parts), np.inf, -np.inf
                for part in range(parts):
                    for axis in range(cell.size):
                        far[0, axis] = min(far[0, axis], tube[part, axis, 0])
                        far[1, axis] = max(far[1, axis], tube[part, axis, 1])
            if new or n == 0:
                left = past_a_face(cell, far, faces, layout.edges, along, True)
            if left or past_a_face(cell, far, faces, layout.edges, along, False):
                clear[first + n * layout.stride] &= ~bit


@kernel(inline="always")
def past_a_face(cell, far, faces, edges, along, others):
    """Whether the lower or upper end of a cell (ndim,), of the edges (ndim, most + 1), moved by far (2, ndim), is
    beyond one of the faces (2, ndim) on the axis `along`, or, for `others`, on one of the others.
    """
    left = False
    for axis in range(cell.size):
        if (axis == along) != others:  # obligation 4.28
            left |= edges[axis, cell[axis]] + far[0, axis] < faces[0, axis]  # obligation 4.27
            left |= edges[axis, cell[axis] + 1] + far[1, axis] > faces[1, axis]  # obligation 4.29
    return left


@kernel(nogil=True)
def certified_inputs(some, ahead, cells, moves, clear, sets, pool, out):
    """out[m, j] &= whether input j is safe from the cell some[m], (M, ndim), and leads into the set of one step less
    than ahead[m] to go; out (M, L) bool: the inputs that are asked about, in place.

    moves: `Moves`. clear (cells, bytes): a bit for each safe input. sets (n, R): the rows, in `pool`, of those with 0,
    1, ... steps to go, all later ones the last one; where there are none, inputs that are safe.
    """
    scratch = np.empty((3, some.shape[1]), np.int64)
    for m in range(some.shape[0]):
        cell, following, place = some[m], max(min(ahead[m], len(sets)) - 1, 0), 0
        row, bit = row_and_bit(cell, cells)
        safe = clear[row * cells.counts[-1] + bit]
        for axis in range(cell.size):
            place += cell[axis] * moves.strides[axis]
        for j in range(out.shape[1]):  # obligation 3.14
            if out[m, j]:
                out[m, j] = ahead[m] > 0 and (safe[j >> 3] >> (j & 7)) & 1  # obligation 3.13
            if out[m, j] and len(sets) > 0:  # obligation 3.12
                out[m, j] = move_inside(cell, j, place, moves, cells, sets[following], pool, scratch)


@kernel(nogil=True)
def inputs_in_lines(some, ahead, cells, moves, along, sets, pool, out):
    """`certified_inputs`, with its arguments, of inputs known to be safe, for cells some (M, ndim) that lie in lines
    along an axis (`along`) but the last: out (M, L) bool, in place.

    No place depends on that axis, and it has no safe ends. So from cell to cell of a line an image goes on along it,
    and only what of it is new is looked at.
    """
    ndim, begin, scratch = some.shape[1], 0, np.empty((3, some.shape[1]), np.int64)
    seen = np.empty((len(sets), 3), np.int64)
    while begin < some.shape[0]:
        end, place = begin + 1, 0
        while end < some.shape[0] and same_line(some[begin], some[end], along):
            end += 1
        for axis in range(ndim):
            place += some[begin, axis] * moves.strides[axis]
        for j in range(out.shape[1]):  # obligation 3.15
            if out[begin:end, j].any():
                low, high = moves.low[j, place], moves.high[j, place]
                total = box_of_image(some[begin], low, high, moves.safe, cells, ndim, scratch)
                if total == 0:  # past a safe end nothing is asked
                    continue
                total //= scratch[1, along]
                rows, scratch[0, along], scratch[1, along] = np.empty(total, np.int64), 0, 1
                for r in range(total):
                    rows[r] = row_of_box(scratch, cells)
                    step_on(scratch[2], scratch[1], ndim - 1)
                line, shape = slice(begin, end), (rows, scratch[0, -1], scratch[0, -1] + scratch[1, -1])
                seen[:, 1] = -2
                asked = some[line, along], ahead[line], low[along], high[along]
                slid_inside(asked, along, shape, cells, sets, pool, seen, out[line, j])
        begin = end


@kernel(inline="always")
def same_line(cell, other, along):
    """Whether a cell and another one, (ndim,) each, differ on the axis `along` at most."""
    for axis in range(cell.size):
        if axis != along and cell[axis] != other[axis]:
            return False
    return True


@kernel(**UNCOUNTED)
def slid_inside(asked, along, shape, cells, sets, pool, seen, out):
    """out[m] &= whether the image of cell m of one line along an axis (`along`), under one input, is in its set: out
    (M,) bool, see `inputs_in_lines`.

    asked: where on the axis its cells are (M,), the steps to go (M,), and from where to where an image lies there.
    shape: the rows (R,) of a slice of an image, the first one on the axis, and from where to where it lies on the last.
    sets, pool: as for `certified_inputs`. seen (n, 3): of each set the first slice that was looked at, the last one, or
    -2, and the last that is not in it.
    """
    (own, ahead, low, high), (rows, bit, past) = asked, shape
    count, stride, whole = cells.counts[along], 1, cells.counts[-1]
    for axis in range(along + 1, cells.counts.size - 1):
        stride *= cells.counts[axis]
    word, wanted = bit >> 6, bits_between(bit >> 6, bit, past)
    short = past <= whole and (past - 1) >> 6 == word
    for m in range(out.size):
        if not out[m]:
            continue
        near, far = own[m] + low, own[m] + high
        if not cells.periodic[along]:
            near, far = min(max(near, 0), count - 1), min(max(far, 0), count - 1)
        elif far - near >= count:
            near, far = 0, count - 1
        following = max(min(ahead[m], len(sets)) - 1, 0)
        index, known = sets[following], seen[following]
        if known[1] == -2 or near < known[0] or near > known[1] + 1 or far < known[1]:
            known[0], known[1], known[2] = near, near - 1, near - 1
        while known[2] < near and known[1] < far:
            known[1] += 1
            inside, at = True, known[1] % count * stride
            for r in range(rows.size):
                block = pool[index[at + rows[r]]]
                if short:
                    inside = block[word] & wanted == wanted
                else:
                    inside = has_bits(block, bit, min(past, whole))
                    inside = inside and (past <= whole or has_bits(block, 0, past - whole))
                if not inside:
                    known[2] = known[1]
                    break
        out[m] = known[2] < near
