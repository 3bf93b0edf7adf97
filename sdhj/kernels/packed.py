"""Compiled operations on packed sets of cells, and the questions of states about them.

A *block* holds the packed cells of one row cell: bit b of the block is bit b % 64 of its word b // 64. Where two packed
axes x and y have nx and ny cells, cell (x, y) is bit x * ny + y.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from sdhj.common.remembering import FloatArray
from sdhj.kernels.compiling import UNCOUNTED, kernel

STATE_SLACK = 1e-10  # of the largest coordinate of an axis (of the arm: m, rad): see sdhj.certified.sets
MOST_LAPS = 1e9  # of a periodic axis: farther away numbers do not tell cells apart
TOUCHING = 1e-300  # the hazard of an input that is not proved to stay clear is at least this
FULL = np.uint64(0xFFFFFFFFFFFFFFFF)
BIT = np.uint64(1)


class Cells(NamedTuple):
    """The cells of every axis as arrays of shape (ndim,), and how they are packed into blocks."""

    # where the first cell begins, how wide a cell is, how long all are together, in the axis's unit
    lower: FloatArray
    width: FloatArray
    length: FloatArray
    # (2, ndim) int64: 1 where the first, or the last, cell is a layer, which lies outside the axis and stands for the
    # wall at its end
    layers: FloatArray
    # how many cells an axis has, and whether it is periodic
    counts: FloatArray
    periodic: FloatArray
    rows: int  # leading axes that number the blocks; the others are packed
    # a point is in a layer only behind the wall by half a shell, which says that the state is known to be there; else a
    # state at the wall is
    wall_known: bool = False


def to_words(bits: FloatArray) -> FloatArray:
    """Bits, bool (..., n), packed as uint64 (..., ceil(n / 64)): bit b of word w is number 64 w + b."""
    padded = np.zeros((*bits.shape[:-1], -(-bits.shape[-1] // 64) * 64), np.bool_)
    padded[..., : bits.shape[-1]] = bits
    return np.packbits(padded, axis=-1, bitorder="little").view(np.uint64)


def to_bits(blocks: FloatArray, count: int) -> FloatArray:
    """The first `count` bits of packed blocks (R, W) uint64: bool (R, count)."""
    return np.unpackbits(blocks.view(np.uint8), axis=1, count=count, bitorder="little").view(np.bool_)


# ---- bits of a block


@kernel(inline="always")
def has_bit(block, bit):
    return (block[bit >> 6] >> np.uint64(bit & 63)) & BIT != 0


@kernel(inline="always")
def bits_between(word, start, stop):
    """The bits start to stop - 1 of a block as a mask for one word of it, which must hold some of them."""
    bits = FULL
    if word == start >> 6:
        bits &= FULL << np.uint64(start & 63)
    if word == (stop - 1) >> 6:
        bits &= FULL >> np.uint64(63 - ((stop - 1) & 63))
    return bits


@kernel(inline="always")
def set_bits(block, start, stop):
    """Set the bits start to stop - 1 of a block (W,), in place; start < stop, both within the block."""
    for word in range(start >> 6, ((stop - 1) >> 6) + 1):
        block[word] |= bits_between(word, start, stop)


@kernel(inline="always")
def has_bits(block, start, stop):
    """Whether the bits start to stop - 1 of a block (W,) are all set; start < stop, both within the block."""
    for word in range(start >> 6, ((stop - 1) >> 6) + 1):
        if ~block[word] & bits_between(word, start, stop) != 0:
            return False
    return True


@kernel(inline="always")
def shifted_word(block, word, shift):
    """Bit b of the word is the block's bit 64 word + b + shift, of either sign; 0 beyond the ends of the block (W,)."""
    source, bit = (word * 64 + shift) >> 6, shift & 63  # floor, also for negative numbers
    shown = np.uint64(0)
    if 0 <= source < block.size:
        shown |= block[source] >> np.uint64(bit)
    if bit > 0 and 0 <= source + 1 < block.size:
        shown |= block[source + 1] << np.uint64(64 - bit)
    return shown


# ---- whole sets


@kernel(inline="always")
def transpose_word_block(block):
    """Transpose 64 words as a matrix of bits, in place: bit b of word a becomes bit a of word b.

    By quarters, of halves, of quarters and so on (Warren, Hacker's Delight, Sec. 7-3).
    """
    side, low = 32, np.uint64(0x00000000FFFFFFFF)
    while side > 0:
        k = 0
        # Each word of a half with its partner in the other one.
        while k < 64:
            moved = ((block[k] >> np.uint64(side)) ^ block[k + side]) & low
            block[k] ^= moved << np.uint64(side)
            block[k + side] ^= moved
            k = (k + side + 1) & ~side
        side >>= 1
        low ^= low << np.uint64(side)


@kernel(parallel=True)
def swap_packed(sets, first, middle, last, out):
    """The packed axis changes places with another: bit b of row (o, a, m) becomes bit a of row (o, b, m) of `out`.

    sets (outer * first * middle, ceil(last / 64)), out (outer * last * middle, ceil(first / 64)).
    """
    outer = sets.shape[0] // (first * middle)
    for i in prange(outer * middle):
        block = np.empty(64, np.uint64)
        o, m = i // middle, i % middle
        for across in range(out.shape[1]):
            for along in range(sets.shape[1]):
                for a in range(64):
                    row = 64 * across + a
                    # Rows behind the last one are empty, so that their bits are 0 in `out`.
                    block[a] = sets[(o * first + row) * middle + m, along] if row < first else np.uint64(0)
                transpose_word_block(block)
                for b in range(min(64, last - 64 * along)):
                    out[(o * last + 64 * along + b) * middle + m, across] = block[b]


@kernel(parallel=True)
def with_beyond(sets, count, far, periodic, out):
    """Write rows of `count` bits to `out` with `far` bits, at most a margin, before and behind them.

    These are of the next lap on a periodic axis; on a bounded one the bit at its end, repeated. sets (R, W), out (R,
    margin + W + margin), overwritten.
    """
    words = sets.shape[1]
    margin = 32 * (out.shape[1] - words)
    for row in prange(sets.shape[0]):
        block, whole = out[row], sets[row]
        block[:] = 0
        for word in range(words):
            block[(margin >> 6) + word] = whole[word] & bits_between(word, 0, count)
        for d in range(1, far + 1):
            low, high = ((count - d) % count, (d - 1) % count) if periodic else (0, count - 1)
            if has_bit(whole, low):
                set_bits(block, margin - d, margin - d + 1)
            if has_bit(whole, high):
                set_bits(block, margin + count + d - 1, margin + count + d)


@kernel(parallel=True)
def erode_packed(cells, shifts, passes):
    """A bit of cells (R, W), in place, stays if the bits at all shifts from it are set, axis after axis.

    shifts (A, K) : how many bits away the neighbours along each of A packed axes are; 0 is skipped. passes (A, K, W) :
        the bits that need no such neighbour. Beyond the ends of a block bits count as not set.
    """
    rows, words = cells.shape
    for row in prange(rows):
        block = np.empty(words, np.uint64)
        for axis in range(shifts.shape[0]):
            for word in range(words):
                # A copy, as neighbours are those before this axis.
                block[word] = cells[row, word]
            for k in range(shifts.shape[1]):
                for word in range(words if shifts[axis, k] != 0 else 0):
                    cells[row, word] &= shifted_word(block, word, shifts[axis, k]) | passes[axis, k, word]


@kernel(parallel=True)
def erode_rows(cells, first, number, out):
    """out[i] = the AND of cells[(first[i] + c) % n] over c < number[i], at least 1; (n, W), out in place."""
    n, words = cells.shape
    for row in prange(n):
        i, k = np.int64(row), first[row]
        for word in range(words):
            out[i, word] = cells[k, word]
        for _ in range(1, number[i]):
            # Joints turn: behind the last row comes the first.
            k = k + 1 if k + 1 < n else 0
            for word in range(words):
                out[i, word] &= cells[k, word]


@kernel(parallel=True)
def add_certified(cells, first, number, allowed, clear, out):
    """out[a, i] |= clear[a, i] & (the AND of cells[a, (first[i] + c) % n] over c < number[i]), where allowed[a, i].

    cells, clear, out (A, n, W), `out` in place; first, number (n,); allowed (A, n).
    """
    outer, n, words = cells.shape
    for a in prange(outer):
        block = np.empty(words, np.uint64)
        for i in range(n):
            if not allowed[a, i]:
                continue
            k = first[i]
            some = np.uint64(0)
            for word in range(words):
                block[word] = cells[a, k, word] & clear[a, i, word]
                some |= block[word]
            for _ in range(1, number[i]):
                # Nothing is left that more rows could keep.
                if some == 0:
                    break
                k = k + 1 if k + 1 < n else 0
                some = np.uint64(0)
                for word in range(words):
                    block[word] &= cells[a, k, word]
                    some |= block[word]
            for word in range(words if some != 0 else 0):
                out[a, i, word] |= block[word]


# ---- questions about states
#
# Serial and without Python's lock: batches are shared out over threads, and only some of Numba's threading layers take
# calls of parallel kernels from several threads at once.


@kernel(**UNCOUNTED)
def cells_at(state, cells, slack, found):
    """Write to found (2^ndim, ndim) the cells within slack (ndim,) of a state (ndim,), each once; returns how many.

    0 off a bounded axis, or more than `MOST_LAPS` laps of a periodic one away.
    """
    # `sdhj_place_of` in sdhj.h does the same, with the same `MOST_LAPS` and quarter of the slack: both have to find the
    # same cells
    many = 1
    for axis in range(state.size):
        count, length, width = cells.counts[axis], cells.length[axis], cells.width[axis]
        offset = state[axis] - cells.lower[axis]
        if cells.periodic[axis]:
            if not abs(offset / length) <= MOST_LAPS:
                return 0
            offset -= length * math.floor(offset / length)
        elif offset < cells.layers[0, axis] * width - slack[axis]:
            return 0
        elif offset > length - cells.layers[1, axis] * width + slack[axis]:
            return 0
        below, above = offset - slack[axis], offset + slack[axis]
        first = min(max(math.floor(below / width), 0), count - 1)
        last = min(max(math.floor(above / width), 0), count - 1)
        if cells.wall_known and cells.layers[0, axis]:
            known = offset < width - slack[axis] / 4
            first, last = (0, 0) if known else (max(first, 1), max(last, 1))
        if cells.wall_known and cells.layers[1, axis]:
            known = offset > length - width + slack[axis] / 4
            first, last = (count - 1, count - 1) if known else (min(first, count - 2), min(last, count - 2))
        if cells.periodic[axis] and below < 0.0:
            first = count - 1
        if cells.periodic[axis] and above >= length:
            last = 0
        for k in range(many):
            found[k, axis] = first
            if last != first:
                # A second cell along this axis, for each that there is so far.
                for other in range(axis):
                    found[many + k, other] = found[k, other]
                found[many + k, axis] = last
        many *= 1 if last == first else 2
    return many


@kernel(inline="always")
def row_and_bit(cell, cells):
    """(row, bit): the number of the block of a cell (ndim,), by its first `cells.rows` axes, and of its bit there."""
    row, bit = 0, 0
    for axis in range(cell.size):
        # The last axis fastest in both, as `index` and blocks are laid out in files.
        if axis < cells.rows:
            row = row * cells.counts[axis] + cell[axis]
        else:
            bit = bit * cells.counts[axis] + cell[axis]
    return row, bit


@kernel(inline="always")
def first_holding(cell, most, cells, index, pool):
    """The number of the first of `most` nested sets that has a cell (ndim,), `most` for none; as in `fewest_steps`."""
    # without a target sets shrink, and are not nested this way round: there `CertifiedTable.fewest` asks for the last
    # one alone
    row, bit = row_and_bit(cell, cells)
    least, first = 0, most  # bisection: the sets before `least` do not hold the cell, `first` may
    while least < first:
        middle = (least + first) // 2
        if has_bit(pool[index[middle, row]], bit):
            first = middle
        else:
            least = middle + 1
    return first


@kernel(nogil=True)
def fewest_steps(states, cells, slack, index, pool, out):
    """out[m] = the number of the first of n nested sets with a cell within slack of states[m], n for none; in place.

    index (n, R), pool (B, W) : the numbers of the blocks of each set's rows, and the blocks.
    """
    found = np.empty((1 << states.shape[1], states.shape[1]), np.int64)
    for m in range(states.shape[0]):
        out[m] = index.shape[0]
        for k in range(cells_at(states[m], cells, slack, found)):
            out[m] = first_holding(found[k], out[m], cells, index, pool)


@kernel(nogil=True)
def boxes_in_set(first, last, cells, index, pool, out):
    """out[0, m], out[1, m] = whether all, and any, of the cells from first[m] to last[m], included, are in a set.

    index (R,), pool (B, W) : the numbers of the blocks of the set's rows, and the blocks.
    """
    for m in range(first.shape[0]):
        cell = first[m].copy()
        more = True
        out[0, m], out[1, m] = True, False
        while more and (out[0, m] or not out[1, m]):
            row, bit = row_and_bit(cell, cells)
            held = has_bit(pool[index[row]], bit)
            out[0, m], out[1, m] = out[0, m] and held, out[1, m] or held
            # The next cell of the box, as an odometer counts.
            axis = cell.size - 1
            while axis >= 0 and cell[axis] == last[m, axis]:
                cell[axis] = first[m, axis]
                axis -= 1
            more = axis >= 0
            cell[axis] += 1 if more else 0
