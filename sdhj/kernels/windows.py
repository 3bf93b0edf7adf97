"""Boxes that may meet a set as packed bits, united over the stretch of boxes that a tube of each cell overlaps.

Along each axis `fine` boxes make a cell. Where all cells move alike, cell i overlaps the boxes fine i + first, ...,
fine i + last of an axis: so what all of them meet is united axis by axis, 64 cells of the last axis at a time.
"""

from typing import NamedTuple

import numpy as np
from numba import prange

from sdhj.common.remembering import FloatArray
from sdhj.kernels.compiling import kernel
from sdhj.kernels.packed import BIT, bits_between, has_bit, set_bits, shifted_word
from sdhj.kernels.stencils import CHUNKS, cell_of


class ClearWords(NamedTuple):
    """From which cells inputs are clear in one interval, 64 cells of the last axis in a word, for G kinds of dangers.

    begin, each (G,) : where a kind's words begin, and how many an input has. strides (G, ndim) : by how many words they
    go on along each axis: 0 along one that the kind does not have.
    """

    words: FloatArray
    begin: FloatArray
    each: FloatArray
    strides: FloatArray


@kernel(parallel=True)
def united_along(boxes, first, last, fine, periodic, out):
    """out[a, i] = OR of boxes[a, b] over the boxes b from fine i + first to fine i + last of an axis, both included.

    boxes (A, fine n, B), out (A, n, B). b is taken modulo fine n on a periodic axis, else clipped; first <= last, of
    cell 0, may be negative.
    """
    (outer, count, inner), size = out.shape, boxes.shape[1]
    for task in prange(outer * count):
        a, i = np.int64(task) // count, np.int64(task) % count
        for box in range(fine * i + first, fine * i + last + 1):
            at = box % size if periodic else min(max(box, 0), size - 1)
            for word in range(inner):
                own = boxes[a, at, word]
                out[a, i, word] = own if box == fine * i + first else out[a, i, word] | own


@kernel(parallel=True)
def united_in_words(planes, first, last, out):
    """Bit i of out[a] = OR of bits i + (box // fine) of planes[a, box % fine] over first <= box <= last.

    So `united_along` along the packed axis: box fine i + m of it is bit i of plane m. planes (A, fine, margin + W +
    margin) of `with_beyond`, out (A, W), overwritten.
    """
    (rows, fine, more), words = planes.shape, out.shape[1]
    start = 32 * (more - words)  # half of what is more is before
    for row in prange(rows):
        for word in range(words):
            met = np.uint64(0)
            for box in range(first, last + 1):
                met |= shifted_word(planes[row, box % fine], word, start + box // fine)
            out[row, word] = met


@kernel(parallel=True)
def clear_inputs_that_meet(clear, begin, met, count):
    """Clear bit j % 8 of byte j // 8 of clear (cells, bytes), in place, where met[j], (L, rows, W), has the cell's bit.

    begin (rows,) : the number of the first cell of each row. count : how many cells a row has.
    """
    inputs, rows, words = met.shape
    for row in prange(rows):
        for word in range(words):
            some = np.uint64(0)
            for j in range(inputs):
                some |= met[j, row, word]
            for bit in range(64 * word, min(64 * word + 64, count) if some != 0 else 0):
                if (some >> np.uint64(bit & 63)) & BIT == 0:
                    continue
                for byte in range(clear.shape[1]):
                    gone = np.uint8(0)
                    for j in range(8 * byte, min(8 * byte + 8, inputs)):
                        gone |= np.uint8((met[j, row, word] >> np.uint64(bit & 63)) & BIT) << np.uint8(j & 7)
                    clear[begin[row] + bit, byte] &= ~gone


@kernel(parallel=True)
def add_predecessors(missing, clear, inputs, wanted, led, counts):
    """Set in `led` the bits of the wanted cells that are not in `missing` and from which one of some inputs is clear.

    missing, wanted, led (rows, W) : uint64, a bit for each cell of a row; `led` is modified in place. clear : the
        `ClearWords`. inputs (n,) : their numbers. counts (ndim,) : of cells.
    """
    (rows, words), last = led.shape, counts.size - 1
    for chunk in prange(CHUNKS):
        cell, begins = np.empty(counts.size, np.int64), np.empty(clear.begin.size, np.int64)
        for row in range(np.int64(chunk) * rows // CHUNKS, (np.int64(chunk) + 1) * rows // CHUNKS):
            known = False
            for word in range(words):
                # beyond the cells of a row `missing` and `wanted` may have any bits, as callers hand over complements
                # of sets
                some = ~missing[row, word] & wanted[row, word] & ~led[row, word] & bits_between(word, 0, counts[last])
                if some == 0:
                    continue
                if not known:
                    cell_of(np.int64(row) * counts[last], counts, cell)
                    for kind in range(begins.size):
                        begins[kind] = clear.begin[kind]
                        for axis in range(last):
                            begins[kind] += cell[axis] * clear.strides[kind, axis]
                    known = True
                for j in inputs:
                    found = some
                    for kind in range(begins.size):
                        found &= clear.words[begins[kind] + j * clear.each[kind] + word * clear.strides[kind, last]]
                    led[row, word] |= found
                    some &= ~found
                    if some == 0:
                        break


@kernel(parallel=True)
def with_beyond(planes, count, far, periodic, out):
    """Write planes to `out` with the bits up to `far`, at most a margin, before and behind their `count` bits.

    These are of the next lap on a periodic axis; on a bounded one, the box at its end, repeated. planes (A, fine, W),
    out (A, fine, margin + W + margin), overwritten.
    """
    rows, fine, words = planes.shape
    margin = 32 * (out.shape[2] - words)
    for row in prange(rows):
        for plane in range(fine):
            block, whole = out[row, plane], planes[row, plane]
            block[:] = 0
            for word in range(words):
                block[(margin >> 6) + word] = whole[word] & bits_between(word, 0, count)
            for d in range(1, far + 1):
                before, after = (whole, whole) if periodic else (planes[row, 0], planes[row, fine - 1])
                low, high = ((count - d) % count, (d - 1) % count) if periodic else (0, count - 1)
                if has_bit(before, low):
                    set_bits(block, margin - d, margin - d + 1)
                if has_bit(after, high):
                    set_bits(block, margin + count + d - 1, margin + count + d)
