"""Tapes: formulas as small programs, which one compiled kernel plays over blocks of points, or of boxes.

A tape's operations work on slots, each a row of numbers, one for each point of a block. What is undefined is NaN, and
everything that hangs on it is. Loops run over one operation of all points in a block, so they vectorise, and nothing
is compiled for a formula.
"""

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numba import get_num_threads

from sdhj.kernels import FloatArray, elementary, intervals
from sdhj.kernels.compiling import kernel
from sdhj.kernels.elementary import ERRORS, INF, NAN
from sdhj.kernels.intervals import PI_UP, STEP, TINY, farthest, larger, lesser, nearest

OPERATIONS = tuple(
    "x p const add sub mul div neg abs sqr sqrt power pow exp log sin cos tan arctan arctan2 tanh arcsin arccos hypot "
    "min max floor mod sign less lesseq equal and or not where gridded".split()
)
X, P, CONST, ADD, SUB, MUL, DIV, NEG, ABS, SQR, SQRT, POWER, POW, EXP, LOG, SIN, COS, TAN, ARCTAN = range(19)
ARCTAN2, TANH, ARCSIN, ARCCOS, HYPOT, MIN, MAX, FLOOR, MOD, SIGN, LESS, LESSEQ, EQUAL = range(19, 32)
AND, OR, NOT, WHERE, GRIDDED = range(32, 37)

BLOCK = 128  # points played at a time: rows of all slots stay in the first-level cache
MANY = 2**21  # operations of all points; fewer are not shared out to threads
LARGEST = np.finfo(np.float64).max

_BINARY = np.array(
    [op in "add sub mul div pow arctan2 hypot min max mod less lesseq equal and or where".split() for op in OPERATIONS]
)
_UNITS = np.array([float(ERRORS.get(op, 0)) for op in OPERATIONS])
_RANGES = np.full((len(OPERATIONS), 2), [-INF, INF])
_RANGES[[EXP, POW, HYPOT, ARCCOS], 0], _RANGES[ARCCOS, 1] = 0.0, PI_UP
_RANGES[TANH], _RANGES[ARCTAN2] = [-1.0, 1.0], [-PI_UP, PI_UP]
_RANGES[ARCTAN] = _RANGES[ARCSIN] = [-PI_UP / 2, PI_UP / 2]
_ZERO = np.where(np.isin(OPERATIONS, ("exp", "pow", "arctan2")), TINY, 0.0)  # what a result that is 0 may be off


class Tape(NamedTuple):
    """A formula, ready to be played. A result may be in the slot of an operand.

    code (n, 5) int64: operation, slot of its result, slots a, b, c of its operands; of `x` and `p` a is the number of
    the coordinate or parameter, of `gridded` a row of `lookups`. value (n,): of `const`; the exponent of `power`.
    slots: how many. outputs (K,) int64: slots of the results. lookups (G, 14) int64: number of axes, 6 slots, 6
    numbers of nodes, place of the first entry in `tables`. places (G, 12): 6 times lower, 6 times spacing. tables (T,)
    """

    code: FloatArray
    value: FloatArray
    slots: int
    outputs: FloatArray
    lookups: FloatArray
    places: FloatArray
    tables: FloatArray


@kernel(nogil=True, error_model="numpy")
def _arithmetic(op, a, b, out, count):
    if op == ADD:
        for m in range(count):
            out[m] = a[m] + b[m]
    elif op == SUB:
        for m in range(count):
            out[m] = a[m] - b[m]
    elif op == MUL:
        for m in range(count):
            out[m] = a[m] * b[m]
    elif op == DIV:
        for m in range(count):
            out[m] = a[m] / b[m] if b[m] != 0.0 else NAN
    elif op == NEG:
        for m in range(count):
            out[m] = -a[m]
    elif op == ABS:
        for m in range(count):
            out[m] = abs(a[m])
    elif op == SQR:
        for m in range(count):
            out[m] = a[m] * a[m]
    elif op == SQRT:
        for m in range(count):
            out[m] = np.sqrt(a[m])
    elif op == MIN:
        for m in range(count):
            out[m] = a[m] if (a[m] < b[m]) | (a[m] != a[m]) else b[m]
    elif op == MAX:
        for m in range(count):
            out[m] = a[m] if (a[m] > b[m]) | (a[m] != a[m]) else b[m]
    elif op == FLOOR:
        for m in range(count):
            out[m] = np.floor(a[m])


@kernel(nogil=True, error_model="numpy")
def _elementary(op, a, b, out, count):
    if op == POW:
        for m in range(count):
            out[m] = elementary.pow(a[m], b[m])
    elif op == EXP:
        for m in range(count):
            out[m] = elementary.exp(a[m])
    elif op == LOG:
        for m in range(count):
            out[m] = elementary.log(a[m])
    elif op == SIN:
        for m in range(count):
            out[m] = elementary.sin(a[m])
    elif op == COS:
        for m in range(count):
            out[m] = elementary.cos(a[m])
    elif op == TAN:
        for m in range(count):
            out[m] = elementary.tan(a[m])
    elif op == ARCTAN:
        for m in range(count):
            out[m] = elementary.arctan(a[m])
    elif op == ARCTAN2:
        for m in range(count):
            out[m] = elementary.arctan2(a[m], b[m])
    elif op == TANH:
        for m in range(count):
            out[m] = elementary.tanh(a[m])
    elif op == ARCSIN:
        for m in range(count):
            out[m] = elementary.arcsin(a[m])
    elif op == ARCCOS:
        for m in range(count):
            out[m] = elementary.arccos(a[m])
    elif op == HYPOT:
        for m in range(count):
            out[m] = elementary.hypot(a[m], b[m])
    elif op == MOD:
        for m in range(count):
            out[m] = elementary.mod(a[m], b[m])


@kernel(nogil=True, error_model="numpy")
def _power(a, n, out, count):
    """By squares, from the first binary digit of |n| on: at most |n| roundings each count once."""
    for m in range(count):
        out[m] = 1.0 if a[m] == a[m] else NAN
    for digit in range(6, -1, -1):
        if abs(n) >> digit > 1:
            for m in range(count):
                out[m] *= out[m]
        if (abs(n) >> digit) & 1:
            for m in range(count):
                out[m] *= a[m]
    if n < 0:
        for m in range(count):
            out[m] = 1.0 / out[m] if a[m] != 0.0 else NAN


@kernel(nogil=True, error_model="numpy")
def _truths(op, a, b, c, out, count):
    if op == SIGN:
        for m in range(count):
            out[m] = 1.0 if a[m] > 0.0 else (-1.0 if a[m] < 0.0 else 0.0 * a[m])
    elif op == LESS:
        for m in range(count):
            out[m] = (1.0 if a[m] < b[m] else 0.0) if (a[m] == a[m]) & (b[m] == b[m]) else NAN
    elif op == LESSEQ:
        for m in range(count):
            out[m] = (1.0 if a[m] <= b[m] else 0.0) if (a[m] == a[m]) & (b[m] == b[m]) else NAN
    elif op == EQUAL:
        for m in range(count):
            out[m] = (1.0 if a[m] == b[m] else 0.0) if (a[m] == a[m]) & (b[m] == b[m]) else NAN
    elif op == AND:
        for m in range(count):
            out[m] = a[m] * b[m]
    elif op == OR:
        for m in range(count):
            out[m] = a[m] + b[m] - a[m] * b[m]
    elif op == NOT:
        for m in range(count):
            out[m] = 1.0 - a[m]
    elif op == WHERE:
        for m in range(count):
            out[m] = (b[m] if a[m] != 0.0 else c[m]) if a[m] == a[m] else NAN


@kernel(nogil=True, error_model="numpy")
def _interpolated(tables, first, lookup, position, corner):
    """(value at a position, in nodes; how large what it was made of is); corner (64,): overwritten."""
    axes, most = lookup[0], 0.0
    for c in range(1 << axes):
        index = 0
        for axis in range(axes):
            nodes = lookup[7 + axis]
            index = index * nodes + min(int(position[axis]), nodes - 2) + ((c >> (axes - 1 - axis)) & 1)
        corner[c] = tables[first + index]
        most = max(most, abs(corner[c]))
    size = 1 << axes
    for axis in range(axes):
        size >>= 1
        share = position[axis] - min(int(position[axis]), lookup[7 + axis] - 2)
        for c in range(size):
            corner[c] = (1.0 - share) * corner[c] + share * corner[c + size]
    return corner[0], most


@kernel(nogil=True, error_model="numpy")
def _gridded(lookup, places, tables, room, place, out, count):
    position, corner = np.empty(6), np.empty(64)
    for m in range(count):
        fine = True
        for axis in range(lookup[0]):
            x = (room[place[lookup[1 + axis]], m] - places[axis]) / places[6 + axis]
            position[axis] = min(max(x, 0.0), lookup[7 + axis] - 1.0)
            fine &= x == x
        out[m] = _interpolated(tables, lookup[13], lookup, position, corner)[0] if fine else NAN


@kernel(nogil=True, error_model="numpy")
def play_part(tape, points, parameters, out, start, stop):
    """`play` of the points from start to stop; compiled code may call it, too.

    A result is written to a row that no slot has, which then is the row of its slot: operands are never overwritten.
    """
    code, value, slots, outputs, lookups, places, tables = tape
    width = min(BLOCK, stop - start)
    room, place, spare = np.empty((slots + 1, width)), np.arange(slots), slots
    for at in range(start, stop, BLOCK):
        count = min(BLOCK, stop - at)
        for k in range(code.shape[0]):
            op, slot, first = code[k, 0], code[k, 1], code[k, 2]
            result = room[spare]
            if op == X:
                for m in range(count):
                    result[m] = points[at + m, first]
            elif op == P or op == CONST:
                number = parameters[first] if op == P else value[k]
                for m in range(count):
                    result[m] = number
            elif op == GRIDDED:
                _gridded(lookups[first], places[first], tables, room, place, result, count)
            else:
                a = room[place[first]]
                b = room[place[code[k, 3]]] if _BINARY[op] else a
                if op < POWER or MIN <= op <= FLOOR:
                    _arithmetic(op, a, b, result, count)
                elif op == POWER:
                    _power(a, int(value[k]), result, count)
                elif op <= HYPOT or op == MOD:
                    _elementary(op, a, b, result, count)
                else:
                    _truths(op, a, b, room[place[code[k, 4]]] if op == WHERE else a, result, count)
            place[slot], spare = spare, place[slot]
        for i in range(outputs.size):
            result = room[place[outputs[i]]]
            for m in range(count):
                out[i, at + m] = result[m]


def play(tape: Tape, points: FloatArray, parameters: FloatArray, out: FloatArray) -> None:
    """Values of a tape at points (M, C) with parameters (P,), into out (K, M)."""
    if len(points) * len(tape.code) < MANY:
        play_part(tuple(tape), points, parameters, out, 0, len(points))  # handed over in half the time of a named one
    else:
        _share_out(play_part, len(points), tuple(tape), points, parameters, out)


def _share_out(part: Any, count: int, *arguments: Any) -> None:
    """Play parts in several threads; a parallel kernel would compile everything once more."""
    threads = get_num_threads()
    ends = pairwise(count * i // threads for i in range(threads + 1))
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(lambda part_ends: part(*arguments, *part_ends), ends))


@kernel(nogil=True, error_model="numpy")
def _simple_bounds(op, a, b, out, count):
    """Operands and result are (2, BLOCK): least and largest."""
    if op == ADD:
        for m in range(count):
            out[0, m], out[1, m] = intervals.of_sum(a[0, m] + b[0, m], a[1, m] + b[1, m])
    elif op == SUB:
        for m in range(count):
            out[0, m], out[1, m] = intervals.of_sum(a[0, m] - b[1, m], a[1, m] - b[0, m])
    elif op == MUL:
        for m in range(count):
            out[0, m], out[1, m] = intervals.mul(a[0, m], a[1, m], b[0, m], b[1, m])
    elif op == DIV:
        for m in range(count):
            out[0, m], out[1, m] = intervals.div(a[0, m], a[1, m], b[0, m], b[1, m])
    elif op == NEG:
        for m in range(count):
            out[0, m], out[1, m] = -a[1, m], -a[0, m]
    elif op == ABS:
        for m in range(count):
            out[0, m], out[1, m] = nearest(a[0, m], a[1, m]), farthest(a[0, m], a[1, m])
    elif op == SQR:
        for m in range(count):
            out[0, m], out[1, m] = intervals.sqr(a[0, m], a[1, m])
    elif op == SQRT:
        for m in range(count):
            out[0, m], out[1, m] = intervals.sqrt(a[0, m], a[1, m])
    elif op == MIN:
        for m in range(count):
            out[0, m], out[1, m] = lesser(a[0, m], b[0, m]), lesser(a[1, m], b[1, m])
    elif op == MAX:
        for m in range(count):
            out[0, m], out[1, m] = larger(a[0, m], b[0, m]), larger(a[1, m], b[1, m])
    elif op == FLOOR:
        for m in range(count):
            out[0, m], out[1, m] = np.floor(a[0, m]), np.floor(a[1, m])


@kernel(nogil=True, error_model="numpy")
def _truth_bounds(op, a, b, c, out, count):
    """What rises with each operand is played at both ends; c: the third operand of `where` only."""
    if op == LESS:
        for m in range(count):
            out[0, m], out[1, m] = 1.0 if a[1, m] < b[0, m] else 0.0, 1.0 if a[0, m] < b[1, m] else 0.0
    elif op == LESSEQ:
        for m in range(count):
            out[0, m], out[1, m] = 1.0 if a[1, m] <= b[0, m] else 0.0, 1.0 if a[0, m] <= b[1, m] else 0.0
    elif op == EQUAL:
        for m in range(count):
            out[0, m] = 1.0 if (a[0, m] == b[1, m]) & (a[1, m] == b[0, m]) else 0.0
            out[1, m] = 1.0 if (a[0, m] <= b[1, m]) & (b[0, m] <= a[1, m]) else 0.0
    elif op == WHERE:
        for m in range(count):
            sure, never = a[0, m] > 0.0, a[1, m] <= 0.0
            low = b[0, m] if sure else (c[0, m] if never else lesser(b[0, m], c[0, m]))
            high = b[1, m] if sure else (c[1, m] if never else larger(b[1, m], c[1, m]))
            both = (b[0, m] == b[0, m]) & (c[0, m] == c[0, m]) | sure | never
            out[0, m], out[1, m] = low if both & (a[0, m] == a[0, m]) else NAN, high
    else:
        _truths(op, a[0], b[0], a[0], out[0], count)
        _truths(op, a[1], b[1], a[1], out[1], count)
        if op == NOT:
            for m in range(count):
                out[0, m], out[1, m] = out[1, m], out[0, m]


@kernel(nogil=True, error_model="numpy")
def _power_bounds(a, n, out, work, count):
    """Of an even power the base counts by its absolute value; a negative one falls where it rises with its base."""
    for m in range(count):
        low, high = a[0, m], a[1, m]
        if n % 2 == 0:
            low, high = nearest(low, high), farthest(low, high)
        work[0, m], work[1, m] = low if n >= 0 else high, high if n >= 0 else low
    _power(work[0], n, out[0], count)
    _power(work[1], n, out[1], count)
    for m in range(count):
        out[0, m], out[1, m] = intervals.power(a[0, m], a[1, m], out[0, m], out[1, m], n)


@kernel(nogil=True, error_model="numpy")
def _at_ends(op, a, b, out, work, count):
    """The least and the largest value at the ends of the operands: of what rises or falls in each of them."""
    if op == HYPOT:
        for m in range(count):
            work[0, m], work[1, m] = nearest(a[0, m], a[1, m]), nearest(b[0, m], b[1, m])
        _elementary(op, work[0], work[1], out[0], count)
        for m in range(count):
            work[0, m], work[1, m] = farthest(a[0, m], a[1, m]), farthest(b[0, m], b[1, m])
        _elementary(op, work[0], work[1], out[1], count)
        return
    _elementary(op, a[0], b[0], out[0], count)
    _elementary(op, a[1], b[0], out[1], count)
    if op == ARCCOS:
        for m in range(count):
            out[0, m], out[1, m] = out[1, m], out[0, m]
    if op == POW or op == ARCTAN2:
        for m in range(count):
            low, high = out[0, m], out[1, m]
            out[0, m], out[1, m] = lesser(low, high), larger(low, high)
        for i in range(2):
            _elementary(op, a[i], b[1], work[0], count)
            for m in range(count):
                value = work[0, m]
                out[0, m], out[1, m] = lesser(value, out[0, m]), larger(value, out[1, m])


@kernel(nogil=True, error_model="numpy")
def _elementary_bounds(op, a, b, out, work, count):
    """Of what `_elementary` plays: its values at the ends, moved outward by more than its error."""
    units, lowest, highest, zero = _UNITS[op], _RANGES[op, 0], _RANGES[op, 1], _ZERO[op]
    _at_ends(op, a, b, out, work, count)
    if op == SIN or op == COS:
        shift = 0.25 if op == SIN else 0.0
        for m in range(count):
            out[0, m], out[1, m] = intervals.wave(a[0, m], a[1, m], out[0, m], out[1, m], shift, units)
    elif op == TAN:
        for m in range(count):
            out[0, m], out[1, m] = intervals.tan(a[0, m], a[1, m], out[0, m], out[1, m], units)
    elif op == MOD:
        for m in range(count):
            out[0, m], out[1, m] = intervals.mod(a[0, m], a[1, m], b[0, m], b[1, m], out[0, m], out[1, m])
    else:
        for m in range(count):
            low, high = intervals.widened(out[0, m], out[1, m], units, zero)
            out[0, m], out[1, m] = larger(lowest, low), lesser(highest, high)
    if op == POW:
        for m in range(count):
            out[0, m] = out[0, m] if (a[0, m] > 0.0) | (a[0, m] == 0.0) & (b[0, m] > 0.0) else NAN
    elif op == ARCTAN2:
        for m in range(count):
            cut = (a[0, m] <= 0.0) & (a[1, m] >= 0.0) & (b[0, m] <= 0.0)  # or the origin
            out[0, m], out[1, m] = -PI_UP if cut else out[0, m], PI_UP if cut else out[1, m]


@kernel(nogil=True, error_model="numpy")
def _gridded_bounds(lookup, places, tables, room, place, out, count):
    """The extremes of a multilinear function are among the ends of the box and the nodes inside, on each axis."""
    position, corner = np.empty(6), np.empty(64)
    ends, number, at = np.empty((2, 6)), np.empty(6, np.int64), np.empty(6, np.int64)
    for m in range(count):
        fine, total = True, 1
        for axis in range(lookup[0]):
            operand, last = room[place[lookup[1 + axis]]], lookup[7 + axis] - 1.0
            lower, spacing = places[axis], places[6 + axis]
            low, high = intervals.of_sum(operand[0, m] - lower, operand[1, m] - lower)
            low, high = intervals.of_sum(low / spacing, high / spacing)
            fine &= (low == low) & (high == high)
            ends[0, axis], ends[1, axis] = min(max(low - TINY, 0.0), last), min(max(high + TINY, 0.0), last)
            number[axis] = 2 + int(np.ceil(ends[1, axis])) - 1 - int(ends[0, axis]) if fine else 0
            at[axis] = 0
            total *= number[axis]
        out[0, m], out[1, m], largest = INF if fine else NAN, -INF, 0.0
        for _ in range(total):
            for axis in range(lookup[0]):
                inside = np.floor(ends[0, axis]) + at[axis]
                last = at[axis] == number[axis] - 1
                position[axis] = ends[0, axis] if at[axis] == 0 else (ends[1, axis] if last else inside)
            value, most = _interpolated(tables, lookup[13], lookup, position, corner)
            fine &= value == value
            out[0, m], out[1, m], largest = lesser(value, out[0, m]), larger(value, out[1, m]), larger(most, largest)
            axis = lookup[0] - 1
            while axis >= 0:
                at[axis] += 1
                if at[axis] < number[axis]:
                    break
                at[axis] = 0
                axis -= 1
        slack = (4.0 * lookup[0] + 2.0) * (STEP * largest) + TINY  # each axis: three roundings, of two numbers
        out[0, m], out[1, m] = out[0, m] - slack if fine else NAN, out[1, m] + slack


@kernel(nogil=True, error_model="numpy")
def _or_nothing(a, b, out, count):
    """Both ends of a result NaN where one is not finite or an operand is NaN."""
    for m in range(count):
        fine = (out[0, m] >= -LARGEST) & (out[1, m] <= LARGEST) & (a[0, m] == a[0, m]) & (b[0, m] == b[0, m])
        out[0, m], out[1, m] = out[0, m] if fine else NAN, out[1, m] if fine else NAN


@kernel(nogil=True, error_model="numpy")
def play_bounds_part(tape, low, high, parameters_low, parameters_high, out, start, stop):
    """`play_bounds` of the boxes from start to stop; rows as in `_play`."""
    code, value, slots, outputs, lookups, places, tables = tape
    width = min(BLOCK, stop - start)
    room, place, spare = np.empty((slots + 1, 2, width)), np.arange(slots), slots
    work = np.empty((2, width))
    for at in range(start, stop, BLOCK):
        count = min(BLOCK, stop - at)
        for k in range(code.shape[0]):
            op, slot, first = code[k, 0], code[k, 1], code[k, 2]
            result = room[spare]
            a, b = result, result
            if op == X:
                for m in range(count):
                    result[0, m], result[1, m] = low[at + m, first], high[at + m, first]
            elif op == P or op == CONST:
                least = parameters_low[first] if op == P else value[k]
                most = parameters_high[first] if op == P else value[k]
                for m in range(count):
                    result[0, m], result[1, m] = least, most
            elif op == GRIDDED:
                _gridded_bounds(lookups[first], places[first], tables, room, place, result, count)
            elif op == WHERE:
                b, c = room[place[code[k, 3]]], room[place[code[k, 4]]]
                _truth_bounds(op, room[place[first]], b, c, result, count)
                b = result
            else:
                a = room[place[first]]
                b = room[place[code[k, 3]]] if _BINARY[op] else a
                if op < POWER or MIN <= op <= FLOOR:
                    _simple_bounds(op, a, b, result, count)
                elif op == POWER:
                    _power_bounds(a, int(value[k]), result, work, count)
                elif op <= HYPOT or op == MOD:
                    _elementary_bounds(op, a, b, result, work, count)
                else:
                    _truth_bounds(op, a, b, a, result, count)
            _or_nothing(a, b, result, count)
            place[slot], spare = spare, place[slot]
        for i in range(outputs.size):
            result = room[place[outputs[i]]]
            for m in range(count):
                out[0, i, at + m], out[1, i, at + m] = result[0, m], result[1, m]


def play_bounds(
    tape: Tape,
    low: FloatArray,
    high: FloatArray,
    parameters_low: FloatArray,
    parameters_high: FloatArray,
    out: FloatArray,
) -> None:
    """Intervals of a tape over boxes from low to high (M, C), parameters (P,) each, into out (2, K, M).

    Both ends are finite, or both are NaN: then the tape may be undefined somewhere in the box.
    """
    arguments = (tuple(tape), low, high, parameters_low, parameters_high, out)
    if len(low) * len(tape.code) < MANY // 4:
        play_bounds_part(*arguments, 0, len(low))
    else:
        _share_out(play_bounds_part, len(low), *arguments)
