"""Compiled tests of packed cells: which images are in a set, which tubes meet an unsafe set, what a change can reach.

A cell of a set is bit `cell[-1]` of its row; rows count the cells of all other axes, the last of them fastest. How far
an interval moves a cell is given in cells: from cell + low to cell + high on each axis, clipped at the ends of a
bounded one. It depends on some of the axes only: on the cell's *place*, their part of it, a row of `Moves`.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from sdhj.common.remembering import FloatArray
from sdhj.kernels.compiling import UNCOUNTED, kernel
from sdhj.kernels.packed import BIT, bits_between, has_bits, shifted_word

CHUNKS = 64  # that cells are looked at in, each with scratch memory


class Moves(NamedTuple):
    """Where each input leads the cells at each place: from cell + low to cell + high, (L, places, ndim) int16."""

    low: FloatArray
    high: FloatArray
    strides: FloatArray  # (ndim,): a cell is at the place sum(cell * strides)
    # (2, ndim): the safe ends, infinite where there are none: past one by a cell, more than rounding, no cell is asked
    # for
    safe: FloatArray


class Clear(NamedTuple):
    """From which cells each input is clear in one interval, for each of G kinds of dangers on axes of its own.

    Input j is bit j % 8 of byte j // 8 from where a cell's bytes begin, and has to be clear of all kinds.
    """

    bits: FloatArray  # (bytes,) uint8: of all kinds
    begin: FloatArray  # (G,): where a kind's bytes begin
    # (G, ndim): by how many bytes they go on along each axis, 0 along one that the kind does not have
    strides: FloatArray


class Boxes(NamedTuple):
    """Boxes of equal size on the axes of an unsafe set, and how many of them may meet the set."""

    # (d,): the axes, and how many boxes there are along each
    axes: FloatArray
    sizes: FloatArray
    # (d,): where boxes begin, how long one is, and how long the axis is, in its unit
    lower: FloatArray
    pitch: FloatArray
    length: FloatArray
    periodic: FloatArray  # (d,) bool
    # (d,): what a tube may stick out of the boxes that it is looked up in, as these were made wider by more. A tube
    # that is narrower than twice that is looked up in the box around its lower end plus `narrow`, which reaches to both
    # of its ends.
    narrow: FloatArray
    # (parts, prod(sizes + 1)) int32: the number of boxes that may meet the set below each corner: for each part of the
    # interval, and for all parts together, last; or one for all
    sums: FloatArray


@kernel(inline="always")
def cell_of(number, counts, cell):
    """Write to cell (ndim,) the indices of the cell with a flat number, the last axis fastest; counts (ndim,)."""
    for back in range(counts.size):
        axis = counts.size - 1 - back
        cell[axis] = number % counts[axis]
        number //= counts[axis]


@kernel(inline="always")
def begins_of_clear(cell, clear, begins):
    """Write to begins (G,) where the bytes of a cell (ndim,) begin in a `Clear`, but for its index on the last axis."""
    for kind in range(begins.size):
        begins[kind] = clear.begin[kind]
        for axis in range(cell.size - 1):
            begins[kind] += cell[axis] * clear.strides[kind, axis]


@kernel(inline="always")
def is_clear(clear, begins, bit, j):
    """Whether input j is clear of all kinds from the cell with index `bit` on the last axis of `begins_of_clear`."""
    out = True
    for kind in range(begins.size):
        # All kinds of dangers, each by cells of its own axes; the first that is not clear is enough.
        at = begins[kind] + bit * clear.strides[kind, clear.strides.shape[1] - 1]
        out &= (clear.bits[at + (j >> 3)] >> (j & 7)) & 1 != 0
        if not out:
            break
    return out


@kernel(**UNCOUNTED)
def next_in_box(at, number, axes):
    """Move at (axes,), in place, to the next point of a box, 0 <= at < number, the last axis fastest, all around."""
    # After the last point comes the first: callers count the points, and need not start anew.
    axis = axes - 1
    while axis >= 0:
        at[axis] += 1
        if at[axis] < number[axis]:
            break
        at[axis] = 0
        axis -= 1


@kernel(**UNCOUNTED)
def box_of_image(cell, low, high, safe, cells, axes, box):
    """Write to box (3, ndim) an image on the first `axes` axes: the first cell, how many cells, and zeros.

    Clipped at the ends of a bounded axis, once around a periodic one at most. Returns the number of rows, over all axes
    but the last; 0 past a safe end.
    """
    first, number, at = box[0], box[1], box[2]
    total = 1
    for axis in range(axes):
        count = cells.counts[axis]
        begin, end = cell[axis] + low[axis], cell[axis] + high[axis]
        if not cells.periodic[axis]:
            if (begin > count and safe[1, axis] < np.inf) or (end < -1 and safe[0, axis] > -np.inf):
                return 0
            begin, end = min(max(begin, 0), count - 1), min(max(end, 0), count - 1)
        elif end - begin >= count:
            begin, end = 0, count - 1
        first[axis], number[axis], at[axis] = begin, end - begin + 1, 0
        if not 0 <= begin < count:  # a remainder takes longest
            first[axis] = begin % count
        # Rows alone: along the last axis cells are bits of one.
        total *= number[axis] if axis < cell.size - 1 else 1
    return total


@kernel(inline="always")
def row_of_box(box, cells):
    """The number of the row of cells at which a box (3, ndim) stands, its first cell + box[2]."""
    row = 0
    for axis in range(cells.counts.size - 1):
        count = cells.counts[axis]
        place = box[0, axis] + box[2, axis]
        row = row * count + (place if place < count else place - count)  # a remainder takes longest
    return row


@kernel(**UNCOUNTED)
def rows_inside(total, cells, index, pool, scratch):
    """Whether all cells of a box with `total` rows, perhaps 0, are in a set, whose rows are the blocks pool[index].

    scratch (3, ndim) : the box, as `box_of_image` left it; overwritten.
    """
    last = cells.counts.size - 1
    whole = cells.counts[last]
    begin, end = scratch[0, last], scratch[0, last] + scratch[1, last]
    word = begin >> 6
    short = end <= whole and (end - 1) >> 6 == begin >> 6
    asked = bits_between(word, begin, end)  # all of them where it is short, which most are
    for _ in range(total):
        block = pool[index[row_of_box(scratch, cells)]]
        if short:
            if block[word] & asked != asked:
                return False
        elif not has_bits(block, begin, min(end, whole)) or (end > whole and not has_bits(block, 0, end - whole)):
            return False
        next_in_box(scratch[2], scratch[1], last)
    return True


@kernel(**UNCOUNTED)
def move_inside(cell, j, place, moves, cells, index, pool, scratch):
    """Whether the image of a cell (ndim,), at a place, under move j is in a set (`rows_inside`), or past a safe end."""
    # `grow_row` asks it while sets are made, or `images_inside`, which has to say the same, and `certified_inputs`
    # later: so the input that made a cell certified is found again
    total = box_of_image(cell, moves.low[j, place], moves.high[j, place], moves.safe, cells, cell.size, scratch)
    return rows_inside(total, cells, index, pool, scratch)


@kernel(inline="always")
def runs_of_ones(block, begin, length):
    """A word whose bit b is set where `length`, 1 to 64, bits of a block are all set from begin + b on."""
    low, high, run = shifted_word(block, 0, begin), shifted_word(block, 0, begin + 64), 1
    # By doubling: from runs of n to runs of up to 2 n in one step.
    while run < length:
        more = min(run, length - run)
        low &= low >> np.uint64(more) | high << np.uint64(64 - more)
        high &= high >> np.uint64(more)
        run += more
    return low


@kernel(inline="always")
def runs_of_any_length(block, begin, length):
    """`runs_of_ones` of any length; all ones where it is 0 or less. Beyond the ends of the block bits count as 0."""
    out = ~np.uint64(0)
    for at in range(0, length, 64):
        # By 64, as many as a word and the one behind it tell.
        out &= runs_of_ones(block, begin + at, min(length - at, 64))
    return out


@kernel(**UNCOUNTED)
def images_inside(word, cell, place, moves, cells, extended, scratch, found):
    """Keep in found (L,), in place, a word's cells whose image under each move is in a set; returns their OR.

    extended (R, margin + W + margin) : the rows of the set, with what comes before and behind them along the last axis.
    """
    # `Packing._extended` makes them by `with_margins`, wide enough for the farthest image
    last, count = cell.size - 1, cells.counts[cell.size - 1]
    some = np.uint64(0)
    start = 32 * (extended.shape[1] - ((count + 63) >> 6)) + 64 * word  # half of what is more is before
    for j in range(found.size):
        total = box_of_image(cell, moves.low[j, place], moves.high[j, place], moves.safe, cells, last, scratch)
        begin, length = start + moves.low[j, place, last], 1 + moves.high[j, place, last] - moves.low[j, place, last]
        for _ in range(total):
            # With what is past a seam of the last axis, so that no bit has to go around.
            block = extended[row_of_box(scratch, cells)]
            found[j] &= runs_of_any_length(block, begin, min(length, count))
            if found[j] == 0:
                break
            next_in_box(scratch[2], scratch[1], last)
        some |= found[j]
    return some


@kernel(parallel=True)
def grow(near, inside, following, clear, moves, cells, keep):
    """Add to `inside`, in place, the cells that clear moves lead into `following`; for `keep`, keep only such.

    near, inside, following (R, W) : the words that are looked at, and the sets; where all cells along the last axis are
        at one place, `following` may be extended as in `images_inside`.
    """
    index = np.arange(len(inside))
    ndim = cells.counts.size
    rows, words = inside.shape
    for i in prange(rows):
        row = np.int64(i)
        if near[row].any():
            images_in = np.empty(moves.low.shape[0] if following.shape[1] > words else 0, np.uint64)
            at = np.empty((4, ndim), np.int64)
            begins = np.empty(clear.begin.size, np.int64)
            grow_row(row, near[row], inside[row], index, following, clear, moves, cells, keep, at, images_in, begins)


@kernel(**UNCOUNTED)
def grow_row(row, near, inside, index, pool, clear, moves, cells, keep, indices, images_in, begins):
    """What `grow` does, for row number `row`: near (W,), inside (W,) in place, the other set as pool[index].

    indices (4, ndim), images_in (L,), begins (G,) : overwritten.
    """
    begin = 0
    tried = 0
    last = cells.counts[-1]
    count = moves.low.shape[0]
    some = ~np.uint64(0)
    cell = indices[3]
    cell_of(row * last, cells.counts, cell)
    begins_of_clear(cell, clear, begins)
    for axis in range(cell.size):
        begin += cell[axis] * moves.strides[axis]
    for word in range(inside.size):
        asked = (inside[word] if keep else ~inside[word]) & bits_between(word, 0, last)
        if not near[word] or asked == 0:
            continue
        # All inputs for the whole word first, where one image serves all of its cells.
        if images_in.size > 0:
            images_in[:] = asked
            some = images_inside(word, cell, begin, moves, cells, pool, indices, images_in)
        for bit in range(64 * word, min(64 * word + 64, last)):
            if not (asked >> np.uint64(bit & 63)) & BIT:
                continue
            cell[cell.size - 1] = bit
            found = (some >> np.uint64(bit & 63)) & BIT != 0
            place = begin + bit * moves.strides[cell.size - 1]
            for turn in range(count if found else 0):
                j = (tried + turn) % count  # what served before is tried first
                found = is_clear(clear, begins, bit, j)
                if found and images_in.size > 0:
                    found = (images_in[j] >> np.uint64(bit & 63)) & BIT != 0
                elif found:
                    found = move_inside(cell, j, place, moves, cells, index, pool, indices)
                if found:
                    tried = j
                    break
            # Growing sets a bit that was found, keeping takes one that was not.
            if found != keep:
                inside[word] ^= BIT << np.uint64(bit & 63)


@kernel(parallel=True)
def add_marked(inside, clear, marks, strides, counts):
    """Add to a set, inside (R, W), in place, the cells from which an input is clear that has a bit in marks[site].

    marks (sites, bytes). strides, counts (ndim,) : a cell is at the site sum(cell * strides); the numbers of cells.
    """
    rows = inside.shape[0]
    last = counts[counts.size - 1]
    for chunk in prange(CHUNKS):
        cell = np.empty(counts.size, np.int64)
        begins = np.empty(clear.begin.size, np.int64)
        for i in range(np.int64(chunk) * rows // CHUNKS, (np.int64(chunk) + 1) * rows // CHUNKS):
            site = 0
            cell_of(np.int64(i) * last, counts, cell)
            begins_of_clear(cell, clear, begins)
            for axis in range(counts.size - 1):
                site += cell[axis] * strides[axis]
            for bit in range(last):
                at = site + bit * strides[counts.size - 1]
                for byte in range(marks.shape[1]):
                    some = marks[at, byte]
                    # As many inputs at once as are in a byte; once none is left, no more is asked.
                    for kind in range(begins.size if some else 0):
                        clear_at = begins[kind] + bit * clear.strides[kind, counts.size - 1]
                        some &= clear.bits[clear_at + byte]
                    if some:
                        inside[i, bit >> 6] |= BIT << np.uint64(bit & 63)


@kernel(inline="always")
def boxes_along(low, high, k, lattice):
    """(first, past): which boxes along the lattice's k-th axis [low, high] overlaps, that at low at least.

    On a periodic axis the first is in the first lap, and those past the end of it are in the next one.
    """
    size, pitch, length = lattice.sizes[k], lattice.pitch[k], lattice.length[k]
    begin, end = low - lattice.lower[k], high - lattice.lower[k]
    if lattice.periodic[k]:
        if end - begin >= length:
            return 0, size
        # Both by the same turns, so that the interval keeps its length.
        begin, end = begin - length * math.floor(begin / length), end - length * math.floor(begin / length)
        first = min(math.floor(begin / pitch), size - 1)
        if end > length:
            last = size + min(math.ceil((end - length) / pitch), size)
        else:
            last = min(math.ceil(end / pitch), size)
    else:
        first = min(max(math.floor(begin / pitch), 0), size - 1)
        last = min(max(math.ceil(end / pitch), 0), size)
    # A tube of no width on an edge overlaps the box above it.
    return first, max(last, first + 1)


@kernel()
def add_up(flat, n, stride):
    """Add to each entry of `flat` (M,), in place, all entries before it along an axis of n entries, `stride` apart."""
    # once for each axis it makes prefix sums, of which `count_in_a_line` takes differences
    for begin in range(0, flat.size, n * stride):
        for at in range(begin + stride, begin + n * stride):
            flat[at] += flat[at - stride]


SEGMENT = 16  # cells of a line that are looked up together first
# places whose cells are looked at line by line where no cache holds all cells, as they are mostly next to each other in
# memory; and the cells of these lines, at most, which bounds the scratch memory
TOGETHER, CELLS_IN_CACHE, CELLS_TOGETHER = 16, 1 << 22, 1 << 14


class Placed(NamedTuple):
    """The order of cells in memory: number = begin[place] + offset[line] + n * stride, with 0 <= n < length.

    A line is a stretch of cells along `axis`, for `mark_collisions` one of the lattice's, even where it is a single
    cell.
    """

    counts: FloatArray  # (ndim,): the numbers of cells
    begin: FloatArray
    offset: FloatArray
    axis: int
    stride: int
    length: int
    edges: FloatArray  # (ndim, most + 1): where cells begin and end
    # (2, ndim): the coordinates past which a state has left by a safe end; infinite where there are none
    safe: FloatArray


@kernel(**UNCOUNTED)
def parts_inside(cell, tube, layout):
    """In how many parts of the interval, from the first on, what was in a cell may still be between the safe ends.

    cell (ndim,). tube (parts, ndim, 2) : how far the cell's lower and upper ends move in each part, here and below.
    """
    for axis in range(cell.size):
        if layout.safe[0, axis] > -np.inf or layout.safe[1, axis] < np.inf:
            break
    # Without safe ends, which most robots have none of, nothing has left.
    else:
        return tube.shape[0]
    for part in range(tube.shape[0]):
        for axis in range(cell.size):
            if layout.edges[axis, cell[axis]] + tube[part, axis, 0] > layout.safe[1, axis] or (
                layout.edges[axis, cell[axis] + 1] + tube[part, axis, 1] < layout.safe[0, axis]
            ):
                # From here on it is beyond: what it meets there does not count.
                return part
    return tube.shape[0]


class Lines(NamedTuple):
    """What `mark_collisions` overwrites, for a chunk; `known` is -1 at first, with a row for each place of a group."""

    cell: FloatArray
    known: FloatArray
    along: FloatArray
    hulls: FloatArray
    corner: FloatArray
    left: FloatArray
    met: FloatArray


@kernel(parallel=True)
def mark_collisions(clear, tubes, places, lattice, bit, layout, together):
    """Clear a bit of clear (cells,), in place, for the cells from which a tube may meet a box of the `lattice`.

    tubes (places, parts, ndim, 2) : how far a cell's ends move, at each of `places` (begin, end). together : of how
        many places lines follow one another, at most.
    """
    # bits are only cleared: sets, parts and steps may be marked one after another, in any order
    d = lattice.axes.size
    spans = tubes.shape[1] + 1
    length = layout.length
    together = max(min(together, CELLS_TOGETHER // length), 1)
    for chunk in prange(CHUNKS):
        cell = np.empty(layout.counts.size, np.int64)
        known = np.full((together, spans), -1)
        along = np.empty((together, spans, 3, length), np.int64)
        hulls = np.empty((together, spans, 3, length // SEGMENT + 1), np.int64)
        corner = np.empty((2, 3 ** (d - 1)), np.int64)
        left = np.empty(length, np.int64)
        met = np.empty(length, np.int64)
        number = np.int64(chunk)
        scratch = Lines(cell, known, along, hulls, corner, left, met)
        mark_collisions_in_chunk(clear, tubes, places, lattice, bit, layout, number, scratch)


@kernel(**UNCOUNTED)
def mark_collisions_in_chunk(clear, tubes, places, lattice, bit, layout, chunk, scratch):
    """What `mark_collisions` does, for chunk number `chunk` of `CHUNKS` of the cells.

    Span 0 is the whole interval: only cells whose tube meets something there are looked up in each part. A line of one
    place is followed by that of the next, so that memory is read once.
    """
    cell, known, along, hulls, corner, left, met = scratch
    lines = layout.offset.size
    sums = lattice.sums
    total = (places[1] - places[0]) * lines
    together = known.shape[0]
    for i in range(chunk * total // CHUNKS, (chunk + 1) * total // CHUNKS):
        group = i // (lines * together) * together  # the first of some places, the last of which may be fewer
        size = min(together, places[1] - places[0] - group)
        line, nth = (i - group * lines) // size, (i - group * lines) % size
        place = group + nth
        first = layout.begin[places[0] + place] + layout.offset[line]
        tube = tubes[place]
        cell_of(first, layout.counts, cell)
        begin = cell[layout.axis]
        more = 0
        for n in range(left.size):
            left[n] = parts_inside(cell, tube, layout) if clear[first + n * layout.stride] & bit else 0
            cell[layout.axis] += 1
            more += left[n]
        for span in range(known.shape[1] if more > 0 else 0):
            # Lines of one place have the same boxes along them: these are made once for all.
            if known[nth, span] != place:
                boxes_of_a_line(begin, span, tube, lattice, layout, along[nth, span], hulls[nth, span])
                known[nth, span] = place
            corners = corners_of_a_line(cell, span, tube, lattice, layout, corner)
            of_span = sums[(span - 1) % len(sums)]
            count_in_a_line(of_span, corner, corners, along[nth, span], hulls[nth, span], left, met)
            more = 0
            for n in range(left.size):
                # Span 0 has only said that some part may meet something: the parts decide.
                if span > 0 and span <= left[n] and met[n] > 0:
                    clear[first + n * layout.stride] &= ~bit
                left[n] = left[n] if (met[n] > 0) == (span == 0) else 0
                more += left[n]
            if more == 0:
                break


@kernel(inline="always")
def swept_boxes(number, span, tube, k, lattice, edges):
    """(first, past): which boxes along the lattice's k-th axis the tube of a cell of that axis overlaps in a span."""
    axis = lattice.axes[k]
    begin, end = max(span - 1, 0), span if span > 0 else tube.shape[0]
    low, high = tube[begin, axis, 0], tube[begin, axis, 1]
    for part in range(begin + 1, end):
        low, high = min(low, tube[part, axis, 0]), max(high, tube[part, axis, 1])
    # Boxes have been widened by more (`counted_boxes`), so that tubes may be narrowed by this.
    low, high = low + lattice.narrow[k], high - lattice.narrow[k]
    return boxes_along(edges[axis, number] + low, edges[axis, number + 1] + high, k, lattice)


@kernel(**UNCOUNTED)
def boxes_of_a_line(begin, span, tube, lattice, layout, along, hulls):
    """Write `swept_boxes` of a line's cells, times the step of its axis in the sums, to along (3, length).

    In order: the first, the end in the first lap, and the end in the next one, or 0. begin : the line's first cell on
    its axis. hulls (3, segments) : overwritten with those of each `SEGMENT` cells.
    """
    step = 1
    for k in range(lattice.axes.size - 1, -1, -1):
        if lattice.axes[k] == layout.axis:
            lap = step * lattice.sizes[k]
            hulls[0], hulls[1], hulls[2] = lap, 0, 0
            for n in range(along.shape[1]):
                first, last = swept_boxes(begin + n, span, tube, k, lattice, layout.edges)
                along[0, n] = step * first
                along[1, n] = min(step * last, lap)
                along[2, n] = max(step * last - lap, 0)
                segment = n // SEGMENT
                hulls[0, segment] = min(hulls[0, segment], along[0, n])
                for side in (1, 2):
                    hulls[side, segment] = max(hulls[side, segment], along[side, n])
        step *= lattice.sizes[k] + 1


@kernel(**UNCOUNTED)
def corners_of_a_line(cell, span, tube, lattice, layout, corner):
    """Write to corner (2, 3^(d - 1)) corners of `swept_boxes` in the sums, but for a line's axis, and their signs.

    cell (ndim,). Returns how many: two on each axis, or three where boxes go on in the next lap.
    """
    corners = 1
    corner[0, 0], corner[1, 0] = 0, 1
    for k in range(lattice.axes.size):
        size = lattice.sizes[k]
        for c in range(corners):
            corner[0, c] *= size + 1
        if lattice.axes[k] == layout.axis:
            continue
        first, last = swept_boxes(cell[lattice.axes[k]], span, tube, k, lattice, layout.edges)
        # Of each corner so far one at the near end, as of any prefix sum, and one at the far end.
        for c in range(corners):
            flat, sign = corner[0, c], corner[1, c]
            corner[0, c], corner[1, c] = flat + first, -sign
            corner[0, corners + c], corner[1, corners + c] = flat + min(last, size), sign
            if last > size:  # sums begin anew at the seam
                corner[0, 2 * corners + c], corner[1, 2 * corners + c] = flat + last - size, sign
        corners *= 3 if last > size else 2
    return corners


@kernel(**UNCOUNTED)
def count_in_a_line(sums, corner, corners, along, hulls, left, met):
    """Write to met (length,) how many boxes that may meet the set each cell's tube overlaps, by differences of `sums`.

    Segments are looked up first; 0 is written in those that overlap no such box, or where left (length,) is 0.
    """
    for segment in range(hulls.shape[1]):
        begin, end = segment * SEGMENT, min((segment + 1) * SEGMENT, left.size)
        found = 0
        met[begin:end] = 0
        for c in range(corners if left[begin:end].any() else 0):
            flat, sign = corner[0, c], corner[1, c]
            found += sign * (sums[flat + hulls[1, segment]] - sums[flat + hulls[0, segment]])
            found += sign * sums[flat + hulls[2, segment]] if hulls[2, segment] > 0 else 0
        # Only where the whole segment overlaps one of them, each cell by itself.
        for n in range(begin, end if found > 0 else begin):
            for c in range(corners if left[n] > 0 else 0):
                flat, sign = corner[0, c], corner[1, c]
                met[n] += sign * (sums[flat + along[1, n]] - sums[flat + along[0, n]])
                met[n] += sign * sums[flat + along[2, n]] if along[2, n] > 0 else 0


@kernel(parallel=True)
def mark_exits(clear, tubes, places, faces, bit, layout):
    """Clear a bit of clear (cells,), in place, for the cells from which a tube may leave by an unsafe end.

    tubes, places : as for `mark_collisions`. faces (2, ndim) : these ends, infinite for others.
    """
    ndim = layout.counts.size
    for chunk in prange(CHUNKS):
        cell = np.empty(ndim, np.int64)
        far = np.empty((2, ndim))
        mark_exits_in_chunk(clear, tubes, places, faces, bit, layout, np.int64(chunk), cell, far)


@kernel(**UNCOUNTED)
def mark_exits_in_chunk(clear, tubes, places, faces, bit, layout, chunk, cell, far):
    """What `mark_exits` does, for chunk number `chunk` of `CHUNKS` of the cells.

    A line is looked at from both ends until a cell stays: those between do so, too, as all move alike.
    """
    lines = layout.offset.size
    along = layout.axis
    total = (places[1] - places[0]) * lines
    known = (-1, -1)
    gone = False
    for i in range(chunk * total // CHUNKS, (chunk + 1) * total // CHUNKS):
        place = places[0] + i // lines
        first = layout.begin[place] + layout.offset[i % lines]
        tube = tubes[place - places[0]]
        cell_of(first, layout.counts, cell)
        begin = cell[along]
        n, step = 0, 1
        while 0 <= n < layout.length:
            cell[along] = begin + n
            parts = parts_inside(cell, tube, layout)
            new = known != (place, parts)
            if new:
                known = (place, parts)
                far[0], far[1] = np.inf, -np.inf
                for part in range(parts):
                    for axis in range(cell.size):
                        far[0, axis] = min(far[0, axis], tube[part, axis, 0])
                        far[1, axis] = max(far[1, axis], tube[part, axis, 1])
            # Axes across the line say the same of all of its cells, until the parts change.
            if new or n == 0:
                gone = past_a_face(cell, far, faces, layout.edges, along, True)
            if gone or past_a_face(cell, far, faces, layout.edges, along, False):
                clear[first + n * layout.stride] &= ~bit
            elif step < 0 or n == layout.length - 1:
                break
            else:
                n, step = layout.length, -1
            n += step


@kernel(inline="always")
def past_a_face(cell, far, faces, edges, along, others):
    """Whether a cell (ndim,), moved by far (2, ndim), is beyond a face (2, ndim) on `along`, or all `others`."""
    gone = False
    for axis in range(cell.size):
        if (axis == along) != others:
            gone |= edges[axis, cell[axis]] + far[0, axis] < faces[0, axis]
            gone |= edges[axis, cell[axis] + 1] + far[1, axis] > faces[1, axis]
    return gone


@kernel(nogil=True)
def certified_inputs(some, steps_left, cells, moves, clear, sets, pool, out):
    """out[m, j] &= whether input j is clear from the cell some[m] and leads into its set, with a step less; in place.

    steps_left (M,) : 0 for no input. sets (n, R) : the blocks in `pool` of the sets with 0, 1, ... steps to go, the
        last for all later ones; n = 0: clear is enough.
    """
    scratch = np.empty((3, some.shape[1]), np.int64)
    begins = np.empty(clear.begin.size, np.int64)
    for m in range(some.shape[0]):
        cell = some[m]
        following = max(min(steps_left[m], len(sets)) - 1, 0)
        place = 0
        begins_of_clear(cell, clear, begins)
        for axis in range(cell.size):
            place += cell[axis] * moves.strides[axis]
        for j in range(out.shape[1]):
            if out[m, j]:
                out[m, j] = steps_left[m] > 0 and is_clear(clear, begins, cell[cell.size - 1], j)
            # Without sets only clear inputs are asked for (`CLEAR`).
            if out[m, j] and len(sets) > 0:
                out[m, j] = move_inside(cell, j, place, moves, cells, sets[following], pool, scratch)


@kernel(nogil=True)
def inputs_in_lines(some, steps_left, cells, moves, along, sets, pool, out):
    """out[m, j] &= whether input j leads from the cell some[m], of lines along an axis, into its set; in place.

    `certified_inputs` of inputs known to be safe. From cell to cell of a line only what is new of an image is looked
    at.

    along : an axis, not the last one, that no place depends on, without safe ends.
    """
    ndim = some.shape[1]
    begin = 0
    scratch = np.empty((3, some.shape[1]), np.int64)
    seen = np.empty((len(sets), 3), np.int64)
    while begin < some.shape[0]:
        end = begin + 1
        place = 0
        while end < some.shape[0] and same_line(some[begin], some[end], along):
            end += 1
        for axis in range(ndim):
            place += some[begin, axis] * moves.strides[axis]
        for j in range(out.shape[1]):
            # An input that is safe nowhere in the line costs nothing.
            if out[begin:end, j].any():
                low, high = moves.low[j, place], moves.high[j, place]
                total = box_of_image(some[begin], low, high, moves.safe, cells, ndim, scratch)
                if total == 0:  # past a safe end nothing is asked
                    continue
                total //= scratch[1, along]
                rows = np.empty(total, np.int64)
                scratch[0, along], scratch[1, along] = 0, 1
                for r in range(total):
                    rows[r] = row_of_box(scratch, cells)
                    next_in_box(scratch[2], scratch[1], ndim - 1)
                line = slice(begin, end)
                bit, past = scratch[0, -1], scratch[0, -1] + scratch[1, -1]
                own = some[line, along]
                left = steps_left[line]
                near, far = low[along], high[along]
                seen[:, 1] = -2
                slid_inside(own, left, near, far, along, rows, bit, past, cells, sets, pool, seen, out[line, j])
        begin = end


@kernel(inline="always")
def same_line(cell, other, along):
    for axis in range(cell.size):
        if axis != along and cell[axis] != other[axis]:
            return False
    return True


@kernel(**UNCOUNTED)
def slid_inside(own, steps_left, low, high, along, rows, bit, past, cells, sets, pool, seen, out):
    """out[m] &= whether the image of cell m of a line along an axis, under one input, is in its set; in place.

    own (M,) : the cells' indices there. low, high : of an image there, as offsets. rows (R,) : of a slice of an image,
        as if at index 0; bit, past : its first cell and the one past the last on the last axis.
    """
    count = cells.counts[along]
    stride = 1
    whole = cells.counts[-1]
    for axis in range(along + 1, cells.counts.size - 1):
        stride *= cells.counts[axis]
    word = bit >> 6
    wanted = bits_between(bit >> 6, bit, past)
    short = past <= whole and (past - 1) >> 6 == word
    for m in range(out.size):
        if not out[m]:
            continue
        near, far = own[m] + low, own[m] + high
        if not cells.periodic[along]:
            near, far = min(max(near, 0), count - 1), min(max(far, 0), count - 1)
        elif far - near >= count:
            near, far = 0, count - 1
        following = max(min(steps_left[m], len(sets)) - 1, 0)
        # of the set: the first slice looked at, the last one, -2 for none, and the last that is not in the set
        index = sets[following]
        known = seen[following]
        # The first image, or one that does not follow the one before: slices are looked at anew.
        if known[1] == -2 or near < known[0] or near > known[1] + 1 or far < known[1]:
            known[0], known[1], known[2] = near, near - 1, near - 1
        while known[2] < near and known[1] < far:
            known[1] += 1
            inside = True
            at = known[1] % count * stride
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
