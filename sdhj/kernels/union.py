"""Inputs join a tube: their reach-avoid sets, united with those before, and their marks.

Rows of the grid are read once for eight inputs, whose marks share a byte. Their reach sets are never written out: they
are made where they are used, a row at a time, of what `add_inputs` is given.
"""

from typing import NamedTuple

import numpy as np
from numba import prange

from sdhj.common.remembering import FloatArray
from sdhj.kernels.boxes import Leaves, over_interval
from sdhj.kernels.compiling import FEW, UNCOUNTED, inlined, kernel
from sdhj.kernels.stages import BLOCKS

EIGHT = 8  # inputs at a time
PAST = 32  # numbers beyond a row that may be written, and beyond its pieces that may be read


class AvoidRows(NamedTuple):
    """The avoid tubes of all L inputs, > 0 in danger, as rows of nodes along the grid's last axis."""

    highest: FloatArray  # (L, r): the greatest value of each static row
    # (L, r, B): r different rows of as many nodes as the grid's; or (L, r, 1), one value for each whole row
    static: FloatArray
    static_at: FloatArray  # (R,): for each of the grid's R rows the number of its row in `static`
    # likewise, for one step; r is another number there
    moving: FloatArray
    moving_at: FloatArray


class InPieces(NamedTuple):
    """Reach sets of some inputs, each the least of some pieces, for each line of `nodes` nodes along the last axis.

    Piece p has width[p] values for a line, 1 or as many as nodes; those of input j begin at begin[p, j] in the flat
    values, and of them at[p, i] belong to line i of the grid.
    """

    values: FloatArray
    begin: FloatArray
    at: FloatArray
    width: FloatArray
    nodes: int


@inlined
def _write_reach_row(out, reach_sets, j, row):
    """Write row number `row` of the reach set of an input, the j-th in `reach_sets`, to out (B + PAST,), in place."""
    # told apart by how many arrays they are: a field more of `InPieces` or of `Leaves` changes what is meant here
    if len(reach_sets) == 5:  # an `InPieces`; this is decided when it is compiled
        _write_minimum_row(out, reach_sets, j, row)
    else:
        values, parent, which, taps, weight, between, point = reach_sets  # no tuple may stand in another here
        _write_maximum_row(out[:-PAST], values, Leaves(parent, which, taps, weight, between, point), j, row)


@kernel(**UNCOUNTED)
def _write_maximum_row(out, values, leaves, j, row):
    """Write a row of a reach set, the maximum over the intervals of leaf j of `values`, to out (B,), in place."""
    each = values.shape[3] // out.size
    # A row is a part of what lies behind the axis, at one node of it and of those before.
    node, start = row // each, row % each * out.size
    source = values[leaves.parent[j], node // leaves.taps.shape[1]]
    over_interval(out, source, start, start + out.size, node % leaves.taps.shape[1], leaves.which[j], leaves, False)


@kernel(**UNCOUNTED)
def _write_minimum_row(out, reach_sets, j, row):
    """Write row number `row` of a reach set, the least of some pieces (`InPieces`), to out (B + PAST,), in place."""
    values, begin, at, width, nodes = reach_sets
    # line by line, in whole vectors: what is written beyond a line's end is overwritten by the next line
    lines = (out.size - PAST) // nodes
    whole = nodes if lines == 1 else -(-nodes // EIGHT) * EIGHT
    for line in range(lines):
        start, here = np.uint64(line * nodes), np.uint64(row * lines + line)
        row_value = values.dtype.type(np.inf)
        flat = True
        for number in range(width.size):
            piece = np.uint64(number)
            value = values[np.uint64(begin[piece, np.uint64(j)] + at[piece, here] * width[piece])]
            row_value = value if width[piece] == 1 and value < row_value else row_value
        for number in range(width.size):
            piece = np.uint64(number)
            first = np.uint64(begin[piece, np.uint64(j)] + at[piece, here] * width[piece])
            if width[piece] > 1 and flat:
                flat = False
                for node in range(whole):
                    i = np.uint64(node)
                    out[start + i] = values[first + i] if values[first + i] < row_value else row_value
            elif width[piece] > 1:
                for node in range(whole):
                    i = np.uint64(node)
                    out[start + i] = values[first + i] if values[first + i] < out[start + i] else out[start + i]
        for node in range(nodes if flat else 0):
            out[start + np.uint64(node)] = row_value


@kernel(**UNCOUNTED)
def _raise_row(out, bound, highest, row_value):
    """Raise a row, out (B,), to a bound in place; to a bound of one value, return the greater of it and `row_value`.

    A bound whose `highest` value is below the row is not even read: most of the time goes there.
    """
    if bound.size < out.size:
        return bound[0] if bound[0] > row_value else row_value
    # Counted, as a loop that ends early is not vectorised.
    below = np.int32(0)
    for i in range(out.size):
        below = np.int32(below + (np.int32(1) if out[i] < highest else np.int32(0)))
    if below > 0:
        for i in range(out.size):
            out[i] = out[i] if out[i] > bound[i] else bound[i]
    return row_value


@kernel(**UNCOUNTED)
def _join(tube, marks, reach_sets, row_values):
    """tube = min(tube, v_q), and bit q of marks where v_q <= 0: v_q = max(reach_sets[q], row_values[q]), eight inputs.

    In place, for one row: tube (B,), marks (B,), reach_sets (8, at least B), row_values (8,).
    """
    for i in range(tube.size):
        # in lanes as wide as the values, or the loop would not be vectorised
        best = tube[i]
        found = np.int32(0)
        for q in range(EIGHT):
            value = reach_sets[q, i] if reach_sets[q, i] > row_values[q] else row_values[q]
            found = np.int32(found | (np.int32(1 << q) if value <= 0 else np.int32(0)))
            best = value if value < best else best
        tube[i] = best
        # Inputs of the same byte may have been added by another call.
        marks[i] |= np.uint8(found)


@kernel(**UNCOUNTED)
def _add_to_row(tube, marks, reach_sets, first, end, avoid_rows, before, row, found, row_values):
    """Do what `add_inputs` does, for row number `row` and the inputs from `first` to end - 1, in place."""
    size = tube.shape[1]
    for i in range(size):
        tube[row, i] = before[row, i]
    for byte in range(first // EIGHT, (end + EIGHT - 1) // EIGHT):
        for q in range(EIGHT):
            j = byte * EIGHT + q
            row_values[q] = np.inf  # outside, of an input that there is not
            if first <= j < end:
                _write_reach_row(found[q], reach_sets, j - first, row)
                line = found[q, :size]
                row_value = tube.dtype.type(-np.inf)
                at = avoid_rows.static_at[row]
                row_value = _raise_row(line, avoid_rows.static[j, at], avoid_rows.highest[j, at], row_value)
                row_values[q] = _raise_row(
                    line, avoid_rows.moving[j, avoid_rows.moving_at[row]], tube.dtype.type(np.inf), row_value
                )
        _join(tube[row], marks[byte, row], found, row_values)


@kernel(parallel=True, least=FEW)
def add_inputs(tube, marks, reach_sets, count, first, avoid_rows, before):
    """tube = min(before, max(reach_j, avoid_j)) for `count` inputs j from `first` on, and marks where max(...) <= 0.

    tube (R, B), marks (bytes, R, B) : the grid in rows, both in place. before (R, B) : may be `tube`. reach_sets : of
        the inputs from `first` on, an `InPieces`; or (values, *leaves), as `maximum_of_intervals` takes them: rows are
        parts of what lies behind the axis of the intervals.
    """
    rows, size = tube.shape
    blocks = min(rows, BLOCKS)
    for block in prange(blocks):
        found, row_values = np.empty((EIGHT, size + PAST), tube.dtype), np.empty(EIGHT, tube.dtype)
        for row in range(rows * np.int64(block) // blocks, rows * (np.int64(block) + 1) // blocks):
            _add_to_row(tube, marks, reach_sets, first, first + count, avoid_rows, before, row, found, row_values)
