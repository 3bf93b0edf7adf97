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

from sdhj.common.remembering import FloatArray, read_only
from sdhj.kernels import bounds, elementary
from sdhj.kernels.bounds import PI_UP, STEP, TINY, farthest, larger, lesser, nearest
from sdhj.kernels.compiling import UNCOUNTED, kernel
from sdhj.kernels.elementary import INF, NAN

# Operations by number, those together that one kernel plays; `sdhj.formulas.rules` has a record of each.
X, P, CONST, GRIDDED = range(4)
ADD, SUB, MUL, DIV, NEG, ABS, SQR, SQRT, MIN, MAX, FLOOR, AND, OR = range(4, 17)  # `_arithmetic`
POWER = 17  # `_power`
POW, EXP, LOG, SIN, COS, TAN, ARCTAN, ARCTAN2, TANH, ARCSIN, ARCCOS, HYPOT, MOD = range(18, 31)  # `_elementary`
SIGN, LESS, LESSEQ, EQUAL, NOT, SHARE, WHERE = range(31, 38)  # `_truths`

BLOCK = 128  # points played at a time: rows of all slots stay in the first-level cache
MOST_NODES = (0, 256, 256, 256, 256, 1024, 4096)  # by axes of a table: so many in a box are looked at, else blocks
MANY = 2**23  # numbers in the program times points; fewer are not shared out to threads
LARGEST = np.finfo(np.float64).max

# Intervals follow from values at ends: an operation falls with its first operand, or rises, or does so with absolute
# values. Then the ends move outward, by a share and by what a tiny result, or 0, may be off.
FALLS, ABSOLUTE, DIRECT, ERROR, NEAR_ZERO, LOWEST, HIGHEST, COLUMNS = range(8)  # columns of what is known


Packable = FloatArray | list[FloatArray]


class Tape(NamedTuple):
    """A formula, ready to be played: seven arrays, `packed`, in this order, by `sdhj.formulas.formula.program`.

    code : (n, 5) int64: operation, slot of its result, slots a, b, c of its operands (b is a where there is one). Of
        `x` and `p`, a is the number of the coordinate or parameter; of `gridded` a row of `lookups`.
    slots : (1,), how many slots there are.
    outputs : (K,), the slots of the results, which may be those of operands.
    lookups : (G, 14): number of axes, 6 slots, 6 numbers of nodes, place of the first entry in `tables`, behind whose
        values its `pyramid` follows.
    value : (n,) float64: of `const`; the exponent of `power`.
    places : (G, 12): 6 times lower, 6 times spacing.
    tables : (T,), the values of all tables.
    """

    ints: FloatArray
    floats: FloatArray


CODE, SLOTS, RESULTS, LOOKUPS, VALUE, _PLACES, TABLES = range(7)


def pyramid(values: FloatArray) -> list[FloatArray]:
    """[least of 4, greatest of 4, least of 16, ...]: extremes in blocks of a table's nodes, until few are left."""
    # `_extremes_of_blocks` finds the levels by their sizes, and stops at the last one at the latest, as few blocks are
    # left there
    found = list[FloatArray]()
    least, greatest = values, values
    while least.size > MOST_NODES[values.ndim]:
        for axis in range(values.ndim):
            begins = np.arange(0, least.shape[axis], 4)
            least, greatest = np.minimum.reduceat(least, begins, axis), np.maximum.reduceat(greatest, begins, axis)
        found += [least, greatest]
    return found


def packed(*arrays: Packable) -> Tape:
    """Arrays one behind the other in a read-only `Tape`: whole numbers in `ints`, floats in `floats`.

    Before the whole numbers stands where each array begins and ends; `part` finds it. A list counts as one array.
    """
    # Python hands over few arrays sooner than many. Lists are copied once: maps are large.
    where = np.zeros((len(arrays), 2), np.int64)
    ends = [2 * len(arrays), 0]
    parts: tuple[list[FloatArray], list[FloatArray]] = ([where.ravel()], [np.zeros(0)])
    for row, given in zip(where, arrays, strict=True):
        some = given if isinstance(given, list) else [given]
        sort = int(some[0].dtype.kind == "f")
        size = sum(one.size for one in some)
        parts[sort].extend(one.ravel() for one in some)
        row[:] = ends[sort], ends[sort] + size
        ends[sort] += size
    return read_only(Tape(np.concatenate(parts[0]).astype(np.int64), np.concatenate(parts[1])))


@kernel(inline="always")  # into kernels that do not count references: those that do take long to compile, all inlined
def part(ints, array, k):
    """The k-th of packed arrays: a flat view of `array`, the `ints` or `floats` that it lies in."""
    return array[ints[2 * k] : ints[2 * k + 1]]


@kernel(**UNCOUNTED)
def length(ints, k):
    """How many numbers the k-th of packed arrays has."""
    return ints[2 * k + 1] - ints[2 * k]


@kernel(**UNCOUNTED)
def slots_of(ints, first):
    """How many slots the tape has whose code is the packed array number `first`; 0 where there is no tape."""
    return ints[ints[2 * (first + SLOTS)]] if length(ints, np.int64(first + SLOTS)) > 0 else 0


@kernel(forceinline=True, **UNCOUNTED)  # at one place
def _arithmetic(op, scratch, i, j, k, count):
    """scratch[k] = op(scratch[i], scratch[j]) at `count` points, op from ADD to OR; NaN for a divisor 0. In place."""
    a, b, out = scratch[i], scratch[j], scratch[k]
    if op == ADD:
        for m in range(count):
            out[m] = a[m] + b[m]
    elif op == SUB:
        for m in range(count):
            out[m] = a[m] - b[m]
    # Truth values are 1 and 0, so AND is a product and OR the larger one.
    elif op == MUL or op == SQR or op == AND:
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
    elif op == SQRT:
        for m in range(count):
            out[m] = np.sqrt(a[m])
    elif op == MIN:
        for m in range(count):
            out[m] = a[m] if (a[m] < b[m]) | (a[m] != a[m]) else b[m]
    elif op == MAX or op == OR:
        for m in range(count):
            out[m] = a[m] if (a[m] > b[m]) | (a[m] != a[m]) else b[m]
    elif op == FLOOR:
        for m in range(count):
            out[m] = np.floor(a[m])


@kernel(**UNCOUNTED)
def _elementary(op, scratch, i, j, k, count):
    """scratch[k] = op(scratch[i], scratch[j]) at `count` points, op from POW to MOD; NaN outside a domain. In place."""
    a, b, out = scratch[i], scratch[j], scratch[k]
    # By `elementary` and not NumPy, whose last digits are others on another machine.
    if op == POW:
        for m in range(count):
            out[m] = elementary.pow(a[m], b[m])
    elif op == EXP:
        for m in range(count):
            out[m] = elementary.exp(a[m])
    elif op == LOG:
        for m in range(count):
            out[m] = elementary.log(a[m])
    elif op == SIN or op == COS:
        for m in range(count):
            out[m] = elementary.sine(a[m], op - SIN)
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


@kernel(**UNCOUNTED)
def _power(scratch, i, n, k, count):
    """scratch[k] = scratch[i]^n at `count` points, n a whole number, k not i; NaN for 0 to a negative power. In place.

    By squares, from the first binary digit of |n| on: the relative error is at most that of |n| roundings.
    """
    a, out = scratch[i], scratch[k]
    digits = 0
    for m in range(count):
        out[m] = 1.0 if a[m] == a[m] else NAN
    while abs(n) >> digits:
        digits += 1
    for digit in range(digits - 1, -1, -1):
        if abs(n) >> digit > 1:
            for m in range(count):
                out[m] *= out[m]
        if (abs(n) >> digit) & 1:
            for m in range(count):
                out[m] *= a[m]
    if n < 0:
        for m in range(count):
            out[m] = 1.0 / out[m] if a[m] != 0.0 else NAN


@kernel(**UNCOUNTED)
def _truths(op, scratch, i, j, k, last, count):
    """scratch[k] = op(scratch[i], scratch[j], scratch[last]) at `count` points, op from SIGN to WHERE, in place.

    Truth values are 1 and 0. NaN where an operand that counts is NaN: of `where`, the one that is not chosen does not.
    """
    a, b, c, out = scratch[i], scratch[j], scratch[last], scratch[k]
    # abs(0 a) is 0 for a zero of either sign, and NaN for NaN.
    if op == SIGN:
        for m in range(count):
            out[m] = 1.0 if a[m] > 0.0 else (-1.0 if a[m] < 0.0 else abs(0.0 * a[m]))
    elif op == LESS:
        for m in range(count):
            out[m] = (1.0 if a[m] < b[m] else 0.0) if (a[m] == a[m]) & (b[m] == b[m]) else NAN
    elif op == LESSEQ:
        for m in range(count):
            out[m] = (1.0 if a[m] <= b[m] else 0.0) if (a[m] == a[m]) & (b[m] == b[m]) else NAN
    elif op == EQUAL:
        for m in range(count):
            out[m] = (1.0 if a[m] == b[m] else 0.0) if (a[m] == a[m]) & (b[m] == b[m]) else NAN
    elif op == NOT:
        for m in range(count):
            out[m] = 1.0 - a[m]
    elif op == SHARE:
        for m in range(count):
            out[m] = lesser(1.0, larger(-1.0, a[m] / b[m])) if b[m] != 0.0 else 0.0 * a[m]
    elif op == WHERE:
        for m in range(count):
            out[m] = (b[m] if a[m] != 0.0 else c[m]) if a[m] == a[m] else NAN


@kernel(**UNCOUNTED)
def _values(op, scratch, i, j, k, n, last, count):
    """scratch[k] = op(scratch[i], scratch[j]) at `count` points, op from ADD on, k no operand's row; in place.

    n : the exponent of `power`. last : the row of the third operand of `where`.
    """
    # In the order of the numbers of operations: one that is added stands in the range of its kind.
    if op < POWER:
        _arithmetic(op, scratch, i, j, k, count)
    elif op == POWER:
        _power(scratch, i, n, k, count)
    elif op < SIGN:
        _elementary(op, scratch, i, j, k, count)
    else:
        _truths(op, scratch, i, j, k, last, count)


@kernel(**UNCOUNTED)
def _interpolated(tables, first, lookup, position, corner):
    """(value, largest): a table's interpolant at position (axes,), in nodes, and the greatest |value| of the cell.

    lookup (14,) : the table's row in `Tape`; its values are tables[first:]. corner (64,) : overwritten.
    """
    axes = lookup[0]
    most = 0.0
    for c in range(1 << axes):
        index = 0
        # The first axis is the highest bit of a corner, as values lie in C order.
        for axis in range(axes):
            nodes = lookup[7 + axis]
            index = index * nodes + min(int(position[axis]), nodes - 2) + ((c >> (axes - 1 - axis)) & 1)
        corner[c] = tables[first + index]
        most = max(most, abs(corner[c]))
    size = 1 << axes
    for axis in range(axes):
        size >>= 1
        weight = position[axis] - min(int(position[axis]), lookup[7 + axis] - 2)
        for c in range(size):
            corner[c] = (1.0 - weight) * corner[c] + weight * corner[c + size]
    return corner[0], most


@kernel(**UNCOUNTED)
def _gridded(lookup, places, tables, scratch, place, out, count, position, corner):
    """out[m] = the multilinear interpolant of a table, clipped at its ends, at `count` points; in place.

    scratch, place : the coordinates are the rows place[slot] of scratch, of the slots in `lookup`.
    """
    for m in range(count):
        fine = True
        for axis in range(lookup[0]):
            x = (scratch[place[lookup[1 + axis]], m] - places[axis]) / places[6 + axis]
            position[axis] = min(max(x, 0.0), lookup[7 + axis] - 1.0)
            fine &= x == x
        # Of a coordinate that is NaN nothing is looked up: its node could be any number.
        out[m] = _interpolated(tables, lookup[13], lookup, position, corner)[0] if fine else NAN


class Work(NamedTuple):
    """Arrays that playing a tape overwrites; made by `work_for`."""

    rows: Any  # (slots + 1, points): of numbers
    place: Any  # (slots,): which row each slot is
    # (6,), (64,): for look-ups in tables
    position: Any
    corner: Any


@kernel(nogil=True)
def work_for(slots, points):
    """A new `Work` to play tapes with at most so many slots at so many points at a time."""
    return Work(np.empty((slots + 1, points)), np.empty(slots, np.int64), np.empty(6), np.empty(64))


@kernel(**UNCOUNTED)
def play_with_scratch(ints, floats, first, points, parameters, out, start, stop, work):
    """Write the values of a tape at the points start to stop - 1 of points (M, C) to out[:, start:stop], (K, M).

    Returns 0 where all are finite, else NaN. first : the number of the tape's code among packed arrays.
    """
    # A result is written to a row that no slot has, which then becomes the row of its slot: operands are never
    # overwritten.
    scratch, place = work.rows, work.place
    spare = slots_of(ints, np.int64(first))
    total = 0.0
    for slot in range(spare):
        place[slot] = slot
    code, outputs = part(ints, ints, first + CODE), part(ints, ints, first + RESULTS)
    lookups, places = part(ints, ints, first + LOOKUPS), part(ints, floats, first + _PLACES)
    value, tables = part(ints, floats, first + VALUE), part(ints, floats, first + TABLES)
    for at in range(start, stop, BLOCK):
        count = min(BLOCK, stop - at)
        for k in range(value.size):
            op, slot, a = code[5 * k], code[5 * k + 1], code[5 * k + 2]
            if op == X:
                for m in range(count):
                    scratch[spare, m] = points[at + m, a]
            elif op == P or op == CONST:
                number = parameters[a] if op == P else value[k]
                for m in range(count):
                    scratch[spare, m] = number
            elif op == GRIDDED:
                lookup, there = lookups[14 * a : 14 * a + 14], places[12 * a : 12 * a + 12]
                _gridded(lookup, there, tables, scratch, place, scratch[spare], count, work.position, work.corner)
            else:
                i = place[a]
                last = place[code[5 * k + 4]] if op == WHERE else 0
                _values(op, scratch, i, place[code[5 * k + 3]], spare, int(value[k]), last, count)
            place[slot], spare = spare, place[slot]
        for i in range(outputs.size):
            for m in range(count):
                result = scratch[place[outputs[i]], m]
                out[i, at + m] = result
                total += 0.0 * result
    return total


@kernel(nogil=True)
def play_part(ints, floats, first, points, parameters, out, start, stop):
    """`play_with_scratch` with scratch of its own."""
    work = work_for(slots_of(ints, np.int64(first)), min(BLOCK, stop - start))
    return play_with_scratch(ints, floats, first, points, parameters, out, start, stop, work)


def play(tape: Tape, points: FloatArray, parameters: FloatArray, out: FloatArray) -> bool:
    """Write the values of a tape at points (M, C) with parameters (P,) to out (K, M); returns whether all are finite.

    Many points are shared out to threads. `parameters` becomes read-only.
    """
    ints, floats = tape
    parameters = read_only(parameters)  # as those are that compiled look-ups give
    if len(points) * len(ints) < MANY:
        return bool(play_part(ints, floats, 0, points, parameters, out, 0, len(points)) == 0.0)
    return sum(_share_out(play_part, len(points), ints, floats, 0, points, parameters, out)) == 0.0


def _share_out(work: Any, count: int, *arguments: Any) -> list[Any]:
    """What a kernel without Python's lock returns for equal ranges of 0 to count, each in a thread."""
    # A parallel kernel in place of threads would compile everything once more.
    if (threads := get_num_threads()) == 1:
        return [work(*arguments, 0, count)]
    ends = pairwise(count * i // threads for i in range(threads + 1))
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(lambda part_ends: work(*arguments, *part_ends), ends))


@kernel(nogil=True)
def _magnitudes(scratch, i, k, count):
    """Write the interval of |a| at `count` boxes to rows 2 k and 2 k + 1 of scratch; a's is in rows 2 i and 2 i + 1."""
    a, out = scratch[2 * i : 2 * i + 2], scratch[2 * k : 2 * k + 2]
    for m in range(count):
        out[0, m], out[1, m] = nearest(a[0, m], a[1, m]), farthest(a[0, m], a[1, m])


@kernel(nogil=True)
def _values_at_extremes(op, fact, scratch, i, j, k, n, count):
    """Write an operation's values where it is least and greatest, not rounded, to rows 2 k and 2 k + 1 of scratch.

    The operands' intervals are in rows 2 i and 2 j and the next ones. The last four rows of scratch are overwritten.
    """
    # `play_bounds_part` has these rows behind those of all slots and the spare one
    work = scratch.shape[0] // 2 - 2
    if fact[ABSOLUTE] != 0.0 or (op == POWER and n % 2 == 0):
        _magnitudes(scratch, i, work, count)
        _magnitudes(scratch, j, work + 1, count)
        i, j = work, work + 1
    falls = 1 if op == POWER and n < 0 else int(fact[FALLS])
    twice = op == POW or op == ARCTAN2  # they rise with an operand, or fall, as the other one is
    for end in range(4 if twice else 2):
        first, second = (falls ^ end, end) if end < 2 else (end - 2, 3 - end)
        row = 2 * k + end if end < 2 else 2 * work + end - 2
        _values(op, scratch, 2 * i + first, 2 * j + second, row, n, row, count)
    if twice:
        out, other = scratch[2 * k : 2 * k + 2], scratch[2 * work : 2 * work + 2]
        for m in range(count):
            out[0, m], out[1, m] = bounds.hull(out[0, m], out[1, m], other[0, m], other[1, m])


@kernel(nogil=True)
def _outward(op, fact, scratch, i, j, k, n, count):
    """Make of what `_values_at_extremes` left in rows 2 k and 2 k + 1 intervals that are rounded outward, in place.

    With extremes that lie between the ends, as those of sin; an end is NaN where the operation may be undefined.
    """
    a, b, out = scratch[2 * i : 2 * i + 2], scratch[2 * j : 2 * j + 2], scratch[2 * k : 2 * k + 2]
    if op == SIN or op == COS:
        for m in range(count):
            shift = 0.25 if op == SIN else 0.0
            out[0, m], out[1, m] = bounds.wave(a[0, m], a[1, m], out[0, m], out[1, m], shift)
    share = fact[ERROR] if op != POWER else (abs(n) + 3.0) * STEP
    tiny = TINY if fact[ERROR] > 0.0 else 0.0
    zero = fact[NEAR_ZERO]
    lowest, highest = fact[LOWEST] if op != POWER or n % 2 != 0 else 0.0, fact[HIGHEST]
    for m in range(count):
        low, high = bounds.widened(out[0, m], out[1, m], share, tiny, zero)
        out[0, m], out[1, m] = larger(lowest, low), lesser(highest, high)
    if op == TAN:
        for m in range(count):
            out[0, m] = bounds.tan(a[0, m], a[1, m], out[0, m])
    elif op == POWER:
        for m in range(count):
            out[0, m], out[1, m] = bounds.power(a[0, m], a[1, m], out[0, m], out[1, m], n)
    elif op == MOD:
        for m in range(count):
            out[0, m], out[1, m] = bounds.mod(a[0, m], a[1, m], b[0, m], b[1, m], out[0, m], out[1, m])
    elif op == POW:
        for m in range(count):
            out[0, m] = out[0, m] if (a[0, m] > 0.0) | (a[0, m] == 0.0) & (b[0, m] > 0.0) else NAN
    elif op == ARCTAN2:
        for m in range(count):
            cut = (a[0, m] <= 0.0) & (a[1, m] >= 0.0) & (b[0, m] <= 0.0)  # or the origin
            out[0, m], out[1, m] = -PI_UP if cut else out[0, m], PI_UP if cut else out[1, m]


@kernel(nogil=True)
def _direct_bounds(op, scratch, i, j, k, last, count):
    """Write intervals of operations that are `DIRECT`, rounded outward, to rows 2 k and 2 k + 1 of scratch.

    The operands' are in rows 2 i and 2 j and the next ones, that of the third operand of `where` in 2 last.
    """
    a, b = scratch[2 * i : 2 * i + 2], scratch[2 * j : 2 * j + 2]
    c, out = scratch[2 * last : 2 * last + 2], scratch[2 * k : 2 * k + 2]
    if op == ADD:
        for m in range(count):
            out[0, m], out[1, m] = bounds.summed(a[0, m], b[0, m], a[1, m], b[1, m])
    elif op == SUB:
        for m in range(count):
            out[0, m], out[1, m] = bounds.summed(a[0, m], -b[1, m], a[1, m], -b[0, m])
    elif op == MUL:
        for m in range(count):
            out[0, m], out[1, m] = bounds.mul(a[0, m], a[1, m], b[0, m], b[1, m])
    elif op == DIV:
        for m in range(count):
            out[0, m], out[1, m] = bounds.div(a[0, m], a[1, m], b[0, m], b[1, m])
    elif op == SHARE:
        for m in range(count):
            low, high = bounds.div(a[0, m], a[1, m], b[0, m], b[1, m])
            low, high = lesser(1.0, larger(-1.0, low)), lesser(1.0, larger(-1.0, high))
            # Where the divisor may be 0, a share is anything from -1 to 1.
            zero = (b[0, m] <= 0.0) & (b[1, m] >= 0.0)
            out[0, m], out[1, m] = -1.0 if zero else low, 1.0 if zero else high
    elif op == EQUAL:
        for m in range(count):
            out[0, m] = 1.0 if (a[0, m] == b[1, m]) & (a[1, m] == b[0, m]) else 0.0
            out[1, m] = 1.0 if (a[0, m] <= b[1, m]) & (b[0, m] <= a[1, m]) else 0.0
    elif op == WHERE:
        for m in range(count):
            # A branch that is surely not taken may even be undefined.
            sure, never = a[0, m] > 0.0, a[1, m] <= 0.0
            low = b[0, m] if sure else (c[0, m] if never else lesser(b[0, m], c[0, m]))
            high = b[1, m] if sure else (c[1, m] if never else larger(b[1, m], c[1, m]))
            fine = (a[0, m] == a[0, m]) & ((b[0, m] == b[0, m]) & (c[0, m] == c[0, m]) | sure | never)
            out[0, m], out[1, m] = low if fine else NAN, high


@kernel(nogil=True)
def _copy_nodes(lookup, tables, first, last, block, at):
    """Copy a table's values at the nodes first to last (axes,), included, to block (nodes,); returns how many."""
    at[:] = first
    axes = lookup[0]
    place = 0
    while at[0] <= last[0]:
        index = np.int64(0)
        for axis in range(axes):
            index = index * lookup[7 + axis] + at[axis]
        # Along the last axis nodes lie together: they are copied as a run.
        row = lookup[13] + index - at[axes - 1]
        for k in range(first[axes - 1], last[axes - 1] + 1):
            block[place] = tables[row + k]
            place += 1
        if axes == 1:
            break
        at[axes - 2] += 1
        for axis in range(axes - 2, 0, -1):
            if at[axis] > last[axis]:
                at[axis] = first[axis]
                at[axis - 1] += 1
    return place


@kernel(nogil=True)
def _interpolate_ends(block, before, count, behind, low, high):
    """Replace a block's values at the first and the last of `count` nodes along an axis by those at two ends, in place.

    block (before, count, behind), flat; `low` and `high` are parts of a cell behind the first node and the last but
    one.
    """
    for row in range(before):
        begin, end = row * count * behind, (row * count + count - 2) * behind
        for k in range(behind):
            # Both before either is written, as of two nodes each is read for both.
            first = (1.0 - low) * block[begin + k] + low * block[begin + behind + k]
            last = (1.0 - high) * block[end + k] + high * block[end + behind + k]
            block[begin + k], block[end + behind + k] = first, last


@kernel(nogil=True)
def _extremes_of_blocks(lookup, tables, first, last):
    """(least, greatest) of a table in few blocks of its `pyramid` that cover the nodes first to last (axes,)."""
    axes = lookup[0]
    start = lookup[13]
    level = 0
    size, total = np.int64(1), np.int64(MOST_NODES[6] + 1)
    for axis in range(axes):
        size *= lookup[7 + axis]
    # Coarser and coarser, until there are few enough; at the last level there always are.
    while total > MOST_NODES[axes]:
        start += size * (2 if level else 1)  # behind the values, or the least and greatest of smaller blocks
        level = level + 2
        size, total = np.int64(1), np.int64(1)
        for axis in range(axes):
            size *= ((lookup[7 + axis] - 1) >> level) + 1
            total *= (last[axis] >> level) - (first[axis] >> level) + 1
    low, high = INF, -INF
    for number in range(total):
        index = np.int64(0)
        rest = np.int64(number)
        step = np.int64(1)
        for axis in range(axes - 1, -1, -1):
            begin = first[axis] >> level
            nodes = ((lookup[7 + axis] - 1) >> level) + 1
            many = (last[axis] >> level) - begin + 1
            index += step * (begin + rest % many)
            rest = rest // many
            step = step * nodes
        low, high = min(low, tables[start + index]), max(high, tables[start + size + index])
    return low, high


@kernel(nogil=True)
def _gridded_bounds(lookup, places, tables, scratch, place, out, count):
    """out[0, m], out[1, m] = bounds, rounded outward, of a table's interpolant over box m, for `count` boxes, in place.

    The extremes are among the ends of the box and the nodes inside; many are bounded by blocks (`pyramid`).
    """
    axes = lookup[0]
    block = np.empty(MOST_NODES[lookup[0]])
    ends = np.empty((2, 6))
    first, last, at = np.empty((3, 6), np.int64)
    for m in range(count):
        fine = True
        total = np.int64(1)
        for axis in range(axes):
            row = 2 * place[lookup[1 + axis]]
            most = lookup[7 + axis] - 1
            lower, spacing = places[axis], places[6 + axis]
            low, high = (scratch[row, m] - lower) / spacing, (scratch[row + 1, m] - lower) / spacing
            low, high = bounds.widened(low, high, 3.0 * STEP, TINY, TINY)
            fine &= (low == low) & (high == high)
            ends[0, axis], ends[1, axis] = min(max(low, 0.0), most), min(max(high, 0.0), most)
            first[axis] = min(int(ends[0, axis]), most - 1) if fine else 0
            last[axis] = max(int(np.ceil(ends[1, axis])), first[axis] + 1) if fine else 1
            total *= last[axis] - first[axis] + 1
        least, greatest = INF if fine else NAN, -INF
        if fine and total > MOST_NODES[axes]:
            least, greatest = _extremes_of_blocks(lookup, tables, first, last)
        largest = max(abs(least), abs(greatest)) if total > MOST_NODES[axes] else 0.0
        if fine and total <= MOST_NODES[axes]:
            _copy_nodes(lookup, tables, first, last, block, at)
            for k in range(total):
                largest = max(largest, abs(block[k]))
            before, behind = np.int64(1), total
            for axis in range(axes):
                nodes = last[axis] - first[axis] + 1
                behind //= nodes
                _interpolate_ends(
                    block, before, nodes, behind, ends[0, axis] - first[axis], ends[1, axis] - last[axis] + 1.0
                )
                before *= nodes
            for k in range(total):
                least, greatest = lesser(block[k], least), larger(block[k], greatest)
        slack = (4.0 * lookup[0] + 2.0) * (STEP * largest) + TINY  # each axis: three roundings, of two numbers
        out[0, m], out[1, m] = least - slack if fine else NAN, greatest + slack


@kernel(nogil=True)
def _undefined_to_nan(scratch, i, j, k, count):
    """Make the intervals in rows 2 k and 2 k + 1 NaN, in place, where an end is not finite or an operand NaN."""
    a, b, out = scratch[2 * i], scratch[2 * j], scratch[2 * k : 2 * k + 2]
    for m in range(count):
        # What is not finite is no bound: callers are told so by NaN.
        fine = (out[0, m] >= -LARGEST) & (out[1, m] <= LARGEST) & (a[m] == a[m]) & (b[m] == b[m])
        out[0, m], out[1, m] = out[0, m] if fine else NAN, out[1, m] if fine else NAN


@kernel(nogil=True)
def _is_constant(row):
    """Whether all numbers of a row are one, and not zeros, which have two signs; the last first, as most rows rise."""
    for back in range(row.size):
        if row[row.size - 1 - back] != row[0]:
            return False
    return row[0] != 0.0


@kernel(nogil=True)
def play_bounds_part(ints, floats, facts, low, high, ends, out, start, stop):
    """Write intervals of a tape over the boxes start to stop - 1 to out[:, :, start:stop], as `play_bounds` does."""
    code, lookups = part(ints, ints, CODE).reshape(-1, 5), part(ints, ints, LOOKUPS).reshape(-1, 14)
    slots = part(ints, ints, SLOTS)[0]
    outputs, places = part(ints, ints, RESULTS), part(ints, floats, _PLACES)
    value, tables = part(ints, floats, VALUE), part(ints, floats, TABLES)
    width = min(BLOCK, stop - start)
    places = places.reshape(-1, 12)
    scratch = np.empty((2 * slots + 6, width))
    place = np.arange(slots)
    spare = slots
    i, j = 0, 0
    alike = np.zeros(slots + 3, np.bool_)  # rows with one interval for all boxes of a block: it is bounded once
    for at in range(start, stop, BLOCK):
        count = min(BLOCK, stop - at)
        for k in range(code.shape[0]):
            op, slot, first = code[k, 0], code[k, 1], code[k, 2]
            result = scratch[2 * spare : 2 * spare + 2]
            once = op == P or op == CONST
            n = count
            if op == X:
                for m in range(count):
                    result[0, m], result[1, m] = low[at + m, first], high[at + m, first]
                once = _is_constant(result[0, :count]) and _is_constant(result[1, :count])
            elif op == P or op == CONST:
                least, most = (ends[0, first], ends[1, first]) if op == P else (value[k], value[k])
                for m in range(count):
                    result[0, m], result[1, m] = least, most
            elif op == GRIDDED:
                _gridded_bounds(lookups[first], places[first], tables, scratch, place, result, count)
            else:
                i = place[first]
                last = place[code[k, 4]] if op == WHERE else 0
                j = place[code[k, 3]]
                fact = facts[op]
                once = alike[i] and alike[j] and (op != WHERE or alike[last])
                n = 1 if once else count
                if fact[DIRECT] != 0.0:
                    _direct_bounds(op, scratch, i, j, spare, last, n)
                else:
                    _values_at_extremes(op, fact, scratch, i, j, spare, int(value[k]), n)
                    _outward(op, fact, scratch, i, j, spare, int(value[k]), n)
            # Leaves have no operand, and `where` may have one that is undefined and not taken: these ask about
            # themselves.
            if op < ADD or op == WHERE:
                i, j = spare, spare
            _undefined_to_nan(scratch, i, j, spare, n)
            for m in range(n, count):
                result[0, m], result[1, m] = result[0, 0], result[1, 0]
            alike[spare] = once
            place[slot], spare = spare, place[slot]
        for i in range(outputs.size):
            row = 2 * place[outputs[i]]
            for m in range(count):
                out[0, i, at + m], out[1, i, at + m] = scratch[row, m], scratch[row + 1, m]


def play_bounds(
    tape: Tape, facts: FloatArray, low: FloatArray, high: FloatArray, ends: FloatArray, out: FloatArray
) -> None:
    """Write intervals of a tape over boxes from low to high (M, C) to out (2, K, M), rounded outward, or NaN twice.

    facts (operations, COLUMNS) : what is known of each operation. ends (2, P) : the least and the greatest value of
        each parameter. Many boxes are shared out to threads.
    """
    arguments = (*tape, facts, low, high, ends, out)
    if len(low) * len(tape.ints) < MANY // 4:
        play_bounds_part(*arguments, 0, len(low))
    else:
        _share_out(play_bounds_part, len(low), *arguments)
