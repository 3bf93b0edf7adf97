"""Compiled operations on packed sets of cells, and the questions of states about them.

A *block* holds the packed cells of one row cell: bit b of the block is bit b % 64 of its word b // 64. Where two packed
axes x and y have nx and ny cells, cell (x, y) is bit x * ny + y.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from sdhj.kernels import FloatArray
from sdhj.kernels.compiling import UNCOUNTED, kernel

# obligation 8.1
STATE_SLACK = 1e-10  # of the largest coordinate of an axis (of the arm: m, rad): see sdhj.certified.sets
MOST_LAPS = 1e9  # of a periodic axis: farther away numbers do not tell cells apart
TOUCHING = 1e-300  # the hazard of an input that is not proved to stay clear is at least this
FULL = np.uint64(0xFFFFFFFFFFFFFFFF)
BIT = np.uint64(1)


class Cells(NamedTuple):
    """The cells of every axis as arrays of shape (ndim,), and how blocks are packed.

    lower, width, length : where the first cell begins, how wide one is, and how long they all are, in the axis's unit;
        counts, periodic.
    layers (2, ndim) int64 : 1 where the first or the last cell lies outside the axis, and stands for its end alone.
    told : whether only points behind a wall, by half a shell, are in its layer: those of which it is known.
    """

    lower: FloatArray
    width: FloatArray
    length: FloatArray
    layers: FloatArray
    counts: FloatArray
    periodic: FloatArray
    rows: int  # leading axes that number the blocks; the others are packed
    told: bool = False


def to_words(bits: FloatArray) -> FloatArray:
    """Bool (..., n) as packed uint64 (..., ceil(n / 64)), bit b of a word the b-th of its 64 values, 0 behind the n."""
    padded = np.zeros((*bits.shape[:-1], -(-bits.shape[-1] // 64) * 64), np.bool_)
    padded[..., : bits.shape[-1]] = bits
    return np.packbits(padded, axis=-1, bitorder="little").view(np.uint64)


def to_bits(blocks: FloatArray, count: int) -> FloatArray:
    """Packed blocks (R, W) uint64 as bool (R, count): their first `count` bits."""
    return np.unpackbits(blocks.view(np.uint8), axis=1, count=count, bitorder="little").view(np.bool_)


# ---- bits of a block


@kernel(inline="always")
def has_bit(block, bit):
    """Whether bit number `bit` of a block (W,) uint64 is set."""
    return (block[bit >> 6] >> np.uint64(bit & 63)) & BIT != 0


@kernel(inline="always")
def bits_between(word, start, stop):
    """A word whose set bits are those of word number `word` that are among the bits start to stop - 1 of a block."""
    bits = FULL
    if word == start >> 6:
        bits &= FULL << np.uint64(start & 63)
    if word == (stop - 1) >> 6:
        bits &= FULL >> np.uint64(63 - ((stop - 1) & 63))
    return bits


@kernel(inline="always")
def set_bits(block, start, stop):
    """Set the bits start to stop - 1 of a block (W,), in place."""
    for word in range(start >> 6, ((stop - 1) >> 6) + 1):
        block[word] |= bits_between(word, start, stop)


@kernel(inline="always")
def has_bits(block, start, stop):
    """Whether the bits start to stop - 1 of a block (W,) are all set."""
    for word in range(start >> 6, ((stop - 1) >> 6) + 1):
        if ~block[word] & bits_between(word, start, stop) != 0:
            return False
    return True


@kernel(inline="always")
def shifted_word(block, word, shift):
    """Word number `word` of the block, moved so that bit b shows bit b + shift (zero beyond the ends)."""
    source, bit = (word * 64 + shift) >> 6, shift & 63  # floor, also for negative numbers
    shown = np.uint64(0)
    if 0 <= source < block.size:
        shown |= block[source] >> np.uint64(bit)
    if bit > 0 and 0 <= source + 1 < block.size:
        shown |= block[source + 1] << np.uint64(64 - bit)
    return shown


# ---- whole sets


@kernel(parallel=True)
def erode_packed(cells, shifts, passes):
    """AND of shifted copies of every block, one packed axis after the other: a bit stays if those at all shifts are
    set.

    cells (R, W) uint64, modified in place. shifts (A, K) int64 : for each packed axis in bits, zero entries are
    skipped. passes (A, K, W) uint64 : bits whose shifted neighbour lies beyond a wall, they pass.
    """
    rows, words = cells.shape
    for row in prange(rows):
        block = np.empty(words, np.uint64)
        for axis in range(shifts.shape[0]):
            for word in range(words):
                block[word] = cells[row, word]
            for k in range(shifts.shape[1]):
                for word in range(words if shifts[axis, k] != 0 else 0):
                    # obligation 3.16
                    cells[row, word] &= shifted_word(block, word, shifts[axis, k]) | passes[axis, k, word]


@kernel(parallel=True)
def erode_rows(cells, first, number, out):
    """out[i] = AND of cells[(first[i] + c) % n] for c < number[i], of rows of (n, W) uint64 arrays; first, number
    (n,).
    """
    n, words = cells.shape
    for row in prange(n):
        i, k = np.int64(row), first[row]
        for word in range(words):
            out[i, word] = cells[k, word]
        for _ in range(1, number[i]):  # obligation 3.17
            k = k + 1 if k + 1 < n else 0
            for word in range(words):
                out[i, word] &= cells[k, word]


@kernel(parallel=True)
def add_certified(cells, first, number, allowed, clear, out):
    """out |= (AND of cells[a, (first[i] + c) % n] for c < number[i]) & clear, for the row cells (a, i) where `allowed`.

    cells, clear, out (A, n, W) uint64, `out` modified in place; first, number (n,) int64; allowed (A, n) bool.
    """
    outer, n, words = cells.shape
    for a in prange(outer):
        block = np.empty(words, np.uint64)
        for i in range(n):
            if not allowed[a, i]:
                continue
            k, some = first[i], np.uint64(0)
            for word in range(words):
                block[word] = cells[a, k, word] & clear[a, i, word]
                some |= block[word]
            for _ in range(1, number[i]):  # obligation 3.18
                if some == 0:
                    break
                k, some = k + 1 if k + 1 < n else 0, np.uint64(0)
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
    """Write to `found` (2^ndim, ndim) the cells within slack (ndim,) of a state (ndim,), each once; returns how many.

    None off a bounded axis, or `MOST_LAPS` of a periodic one away. Cells outside an axis count where a state is known
    to be at its wall (`Cells.told`).
    """
    held = 1
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
        if cells.told and cells.layers[0, axis]:
            known = offset < width - slack[axis] / 4
            first, last = (0, 0) if known else (max(first, 1), max(last, 1))
        if cells.told and cells.layers[1, axis]:
            known = offset > length - width + slack[axis] / 4
            first, last = (count - 1, count - 1) if known else (min(first, count - 2), min(last, count - 2))
        if cells.periodic[axis] and below < 0.0:
            first = count - 1
        if cells.periodic[axis] and above >= length:
            last = 0
        for k in range(held):
            found[k, axis] = first
            if last != first:
                for other in range(axis):
                    found[held + k, other] = found[k, other]
                found[held + k, axis] = last
        held *= 1 if last == first else 2
    return held


@kernel(inline="always")
def row_and_bit(cell, cells):
    """The number of a cell's block, by the first `rows` axes of `cells` (`Cells`), and of its bit there."""
    row, bit = 0, 0
    for axis in range(cell.size):
        if axis < cells.rows:
            row = row * cells.counts[axis] + cell[axis]
        else:
            bit = bit * cells.counts[axis] + cell[axis]
    return row, bit


@kernel(nogil=True)
def fewest_steps(states, cells, slack, index, pool, out):
    """out[m] = the number of the first of nested sets with a certified cell of `cells` (`Cells`) within slack (ndim,)
    of states[m], (M, ndim).

    index (n, R), pool (B, W) : the numbers of the blocks of each row of the n sets, each inside the next, and the
    blocks
    out (M,) int64 : 0 to n - 1, or n where none holds the state. Overwritten.
    """
    found = np.empty((1 << states.shape[1], states.shape[1]), np.int64)
    for m in range(states.shape[0]):
        out[m] = index.shape[0]
        for k in range(cells_at(states[m], cells, slack, found)):
            row, bit = row_and_bit(found[k], cells)
            least, most = 0, out[m]  # bisection: the sets before `least` do not hold the cell, `most` may
            while least < most:
                middle = (least + most) // 2
                if has_bit(pool[index[middle, row]], bit):
                    most = middle
                else:
                    least = middle + 1
            out[m] = most


@kernel(nogil=True)
def held_in_boxes(first, last, cells, index, pool, out):
    """Whether all, and whether any, of the cells from first[m] to last[m], both (M, ndim) and included, are in a set:
    out (2, M) bool, overwritten.

    index (R,), pool (B, W) : the numbers of the set's blocks, and the blocks.
    """
    for m in range(first.shape[0]):
        cell, more = first[m].copy(), True
        out[0, m], out[1, m] = True, False
        while more and (out[0, m] or not out[1, m]):
            row, bit = row_and_bit(cell, cells)
            held = has_bit(pool[index[row]], bit)
            out[0, m], out[1, m] = out[0, m] and held, out[1, m] or held
            axis = cell.size - 1
            while axis >= 0 and cell[axis] == last[m, axis]:
                cell[axis] = first[m, axis]
                axis -= 1
            more = axis >= 0
            cell[axis] += 1 if more else 0
