"""Intervals of the checker: between which ends each operation of a formula lies over whole boxes, rounded outward.

An interval is a pair (low, high) of float64 arrays, one entry a box, or of numbers. Both ends are NaN where the result
may be undefined, or where an end is not finite: nothing is known there, and NaN stays NaN in whatever follows.

Why the ends hold. NumPy's sums, products, quotients and square roots are the nearest numbers (IEEE 754), off by half a
unit in the last place. `UNIT` times an end is one unit at least. What underflows is off by less than `TINY`; sums and
square roots do not, and a zero among them is exact. NumPy's elementary functions are off by a few units (its own tests
allow four), and `UNITS` times an end is eight at least; sines and cosines have room for `NEAR_ZERO` besides. The rest
is where an operation rises and falls.
"""

import math
from collections.abc import Callable
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Interval = tuple[Array, Array]

UNIT = 2.0**-52
UNITS = 2.0**-49
TINY = 5e-324  # the least positive number
NEAR_ZERO = 2.0**-56
ABOVE_PI = math.nextafter(math.pi, 4.0)  # above pi
DOUBT = 1e-14  # of a number of turns: more than its rounding
MOST_NODES = 4096  # of a table in and around a box, up to which it is looked up exactly


def outward(low: Array, high: Array, by: float = UNIT, least: float | Array = 0.0) -> Interval:
    """[low - (by |low| + least), high + (by |high| + least)]: ends moved outward by a share of their size, and more."""
    return low - (by * np.abs(low) + least), high + (by * np.abs(high) + least)


def sure(low: Array, high: Array) -> Interval:
    """[low, high], with NaN at both ends where one of the ends is not finite."""
    if math.isfinite((low - high).sum()):  # so all ends are
        return low, high
    known = np.isfinite(low) & np.isfinite(high)
    return np.where(known, low, np.nan), np.where(known, high, np.nan)


def unless(undefined: Array, low: Array, high: Array) -> Interval:
    """[low, high], with NaN at both ends where `undefined`."""
    return np.where(undefined, np.nan, low), np.where(undefined, np.nan, high)


def above(least: float, low: Array, high: Array) -> Interval:
    """[max(low, least), high], for a function whose values are known to be at least `least`."""
    return np.maximum(low, least), high


# ---- arithmetic


def add(a: Interval, b: Interval) -> Interval:
    """a + b, an end rounded outward only where the rounded sum is not already beyond the exact one.

    So an exact sum stays as it is, and a closed set keeps its border.
    """
    low, high = a[0] + b[0], a[1] + b[1]
    least, most = outward(low, high)
    return np.where(rest(a[0], b[0], low) >= 0.0, low, least), np.where(rest(a[1], b[1], high) <= 0.0, high, most)


def sub(a: Interval, b: Interval) -> Interval:
    """a - b = a + (-b), rounded outward."""
    return add(a, neg(b))


def rest(a: Array, b: Array, total: Array) -> Array:
    """a + b - total, the rounding error of the rounded sum `total`, exactly (Knuth's sum of two); NaN if too large."""
    second = total - a
    return (a - (total - second)) + (b - second)


def hull_at_corners(of: Callable[[Array, Array], Array], a: Interval, b: Interval) -> Interval:
    """The least and the greatest value of a function at the four pairs of ends of a and b, as computed."""
    ends = [of(p, q) for p in a for q in b]
    return reduce(np.minimum, ends), reduce(np.maximum, ends)


def signed(of: Callable[[Array, Array], Array], a: Interval, b: Interval) -> Interval:
    """The hull of the products, or quotients, of the ends of a and b, rounded outward but not across 0.

    of : `np.multiply` or `np.divide`; then b must not hold 0, which is not checked.
    """
    least, most = hull_at_corners(of, a, b)
    low, high = outward(least, most, least=TINY)
    if np.all(least) and np.all(most):  # no end is moved across 0 but from 0
        return low, high
    same_sign = ((a[0] >= 0) & (b[0] >= 0)) | ((a[1] <= 0) & (b[1] <= 0))
    unlike = ((a[0] >= 0) & (b[1] <= 0)) | ((a[1] <= 0) & (b[0] >= 0))
    return np.where(same_sign, np.maximum(low, 0.0), low), np.where(unlike, np.minimum(high, 0.0), high)


def mul(a: Interval, b: Interval) -> Interval:
    """a b: the hull of the products of the ends, rounded outward."""
    return signed(np.multiply, a, b)


def div(a: Interval, b: Interval) -> Interval:
    """a / b: the hull of the quotients of the ends, rounded outward; NaN where b holds 0."""
    return unless((b[0] <= 0) & (b[1] >= 0), *signed(np.divide, a, b))


def share(a: Interval, b: Interval) -> Interval:
    """a / b clipped to [-1, 1], rounded outward; [-1, 1] where b holds 0, as at b = 0 the operation is 0."""
    known, zero = 0.0 * a[0], (b[0] <= 0.0) & (b[1] >= 0.0)
    low, high = (np.clip(end, -1.0, 1.0) for end in signed(np.divide, a, b))
    return np.where(zero, known - 1.0, low), np.where(zero, known + 1.0, high)


def neg(a: Interval) -> Interval:
    """-[low, high] = [-high, -low], exactly."""
    return -a[1], -a[0]


def size(a: Interval) -> Interval:
    """|[low, high]| = [max(low, -high, 0), max(-low, high)], exactly."""
    return np.maximum(np.maximum(a[0], -a[1]), 0.0), np.maximum(-a[0], a[1])


def raised(x: Array, n: int) -> Interval:
    """Bounds on x^n for numbers x >= 0 and a whole n >= 1, by squares and products, each rounded outward."""
    low = high = x
    # Squared for each binary digit behind the first, and multiplied where it is 1.
    for bit in f"{n:b}"[1:]:
        low, high = above(0.0, *outward(low * low, high * high, least=TINY))
        if bit == "1":
            low, high = above(0.0, *outward(low * x, high * x, least=TINY))
    return low, high


def power(a: Interval, n: int) -> Interval:
    """a^n for a whole n, rounded outward: of even n by |a|, of odd n by the ends, of n < 0 as 1 / a^-n."""
    if n < 0:
        return div((np.array(1.0), np.array(1.0)), power(a, -n))
    if n == 0:
        return a[0] * 0.0 + 1.0, a[1] * 0.0 + 1.0
    if n % 2 == 0:
        least, most = size(a)
        return raised(least, n)[0], raised(most, n)[1]
    (down, up), (below, beyond) = raised(np.abs(a[0]), n), raised(np.abs(a[1]), n)
    return np.where(a[0] < 0, -up, down), np.where(a[1] < 0, -below, beyond)


def pow_(a: Interval, b: Interval) -> Interval:
    """a^b for a > 0, or a = 0 and b > 0, else NaN: the hull of the powers of the ends, rounded outward.

    It rises or falls with each operand alone: the extremes are at corners. (NumPy's 1**NaN and NaN**0 are 1.)
    """
    low, high = above(0.0, *outward(*hull_at_corners(np.power, a, b), UNITS, TINY))
    defined = (a[0] > 0) | ((a[0] == 0) & (b[0] > 0))
    return unless(~defined | np.isnan(b[0]), low, high)


# ---- elementary functions; what NumPy calls undefined at an end is NaN or not finite there, and so at both ends


def rising(
    function: Callable[[Array], Array], least: float = -math.inf, most: float = math.inf
) -> Callable[..., Interval]:
    """The rule of a rising function, right up to `UNITS` and `TINY`, whose values lie from `least` to `most`."""

    def rule(a: Interval) -> Interval:
        low, high = outward(function(a[0]), function(a[1]), UNITS, TINY)
        # Rounded outward it may have left the range of the function.
        return np.maximum(low, least), np.minimum(high, most)

    return rule


def sqrt(a: Interval) -> Interval:
    """[sqrt(low), sqrt(high)], rounded outward but not below 0; NaN at an end that is negative."""
    return above(0.0, *outward(np.sqrt(a[0]), np.sqrt(a[1])))


def arccos(a: Interval) -> Interval:
    """[arccos(high), arccos(low)], rounded outward but not below 0; NaN at an end outside [-1, 1]."""
    return above(0.0, *outward(np.arccos(a[1]), np.arccos(a[0]), UNITS, TINY))


def wave(function: Callable[[Array], Array], hill: float) -> Callable[..., Interval]:
    """The rule of np.sin or np.cos: the hull of the values at the ends, and of 1 and -1 where they may be between.

    hill : where it is 1, in turns; so it is at every whole turn from there, and -1 half a turn from each.
    """

    def rule(a: Interval) -> Interval:
        begin, end = a[0] / (2 * np.pi) - hill, a[1] / (2 * np.pi) - hill
        # A hill as near an end as this counts as within: rounding may hide it.
        doubt = DOUBT * (1.0 + np.maximum(np.abs(begin), np.abs(end)))
        hills = np.floor(end + doubt) >= np.ceil(begin - doubt)
        valleys = np.floor(end + 0.5 + doubt) >= np.ceil(begin + 0.5 - doubt)
        first, last = function(a[0]), function(a[1])
        low, high = outward(np.minimum(first, last), np.maximum(first, last), UNITS, NEAR_ZERO)
        low, high = np.maximum(low, -1.0), np.minimum(high, 1.0)
        return np.where(valleys, -1.0, low), np.where(hills, 1.0, high)

    return rule


def tan(a: Interval) -> Interval:
    """[tan(low), tan(high)], rounded outward; NaN where the interval may hold a pole."""
    begin, end = a[0] / np.pi + 0.5, a[1] / np.pi + 0.5  # whole at a pole
    doubt = DOUBT * (1.0 + np.maximum(np.abs(begin), np.abs(end)))
    pole = np.floor(begin - doubt) != np.floor(end + doubt)
    return unless(pole, *outward(np.tan(a[0]), np.tan(a[1]), UNITS, TINY))


def arctan2(y: Interval, x: Interval, side: int | None = None) -> Interval:
    """The angle of (x, y): of a box that meets the jump, y = 0 and x <= 0, all angles, else the hull of its corners'.

    side : of a box that meets the jump only the part y >= 0 (0), or y <= 0, where the angle is -pi at the jump (1).
    """
    jump = (y[0] <= 0) & (y[1] >= 0) & (x[0] <= 0)
    if side is not None:
        x = np.where(x[0] == 0, -0.0, x[0]), x[1] + 0.0  # a zero of either sign
        upper, below = np.where(jump, 0.0, y[0]), np.where(jump & (y[0] == 0), -0.0, y[0])
        y = (upper, y[1] + 0.0) if side == 0 else (below, np.where(jump, -0.0, y[1]))
        jump = np.array(False)
    low, high = outward(*hull_at_corners(np.arctan2, y, x), UNITS, TINY)
    return np.where(jump, -ABOVE_PI, np.maximum(low, -ABOVE_PI)), np.where(jump, ABOVE_PI, np.minimum(high, ABOVE_PI))


def hypot(a: Interval, b: Interval) -> Interval:
    """sqrt(a^2 + b^2), rounded outward but not below 0; exactly 0 where both are 0, as it does not underflow."""
    (a0, a1), (b0, b1) = size(a), size(b)
    low, high = np.hypot(a0, b0), np.hypot(a1, b1)
    return above(0.0, *outward(low, high, UNITS, np.where(high == 0.0, 0.0, TINY)))


# ---- what jumps, and truth values: (0, 0), (1, 1), or (0, 1) where it is open


def mod(a: Interval, b: Interval, side: int | None = None) -> Interval:
    """a - floor(a / b) * b, between 0 and b; closer where the whole number of laps, floor(a / b), is known.

    side : 0 or 1: only in the first, or in the last, where the box lies in two laps; None: in all.
    """
    laps = div(a, b)
    first, last = np.floor(laps[0]), np.floor(laps[1])
    if side is not None:
        first, last = (np.where(last - first == 1, (first, last)[side], own) for own in (first, last))
    remainder, (least, most) = sub(a, mul((first, last), b)), (np.minimum(b[0], 0.0), np.maximum(b[1], 0.0))
    low = np.where(first == last, np.maximum(remainder[0], least), least)
    high = np.where(first == last, np.minimum(remainder[1], most), most)
    return unless(~np.isfinite(first) | ~np.isfinite(last), low, high)


def truth(certain: Array, never: Array, a: Interval, b: Interval) -> Interval:
    """The interval of a truth value: [1, 1] where `certain`, [0, 0] where `never`, else [0, 1]; NaN where a or b is."""
    return unless(np.isnan(a[0]) | np.isnan(b[0]), np.where(certain, 1.0, 0.0), np.where(never, 0.0, 1.0))


def less(a: Interval, b: Interval) -> Interval:
    """a < b, a truth value."""
    return truth(a[1] < b[0], a[0] >= b[1], a, b)


def lesseq(a: Interval, b: Interval) -> Interval:
    """a <= b, a truth value."""
    return truth(a[1] <= b[0], a[0] > b[1], a, b)


def equal(a: Interval, b: Interval) -> Interval:
    """a == b, a truth value."""
    return truth((a[0] == b[1]) & (a[1] == b[0]), (a[0] > b[1]) | (b[0] > a[1]), a, b)


def where(condition: Interval, a: Interval, b: Interval) -> Interval:
    """a where the condition is [1, 1], b where it is [0, 0], else the hull of both; what is not chosen may be NaN."""
    yes, no = condition[0] == 1.0, condition[1] == 0.0
    low = np.where(yes, a[0], np.where(no, b[0], np.minimum(a[0], b[0])))
    high = np.where(yes, a[1], np.where(no, b[1], np.maximum(a[1], b[1])))
    return unless(np.isnan(condition[0]), low, high)


# ---- interpolation


def gridded(operands: list[Interval], table: Array, lower: list[float], spacing: list[float]) -> Interval:
    """Bounds of the multilinear interpolation of a table with nodes at lower + i * spacing, clipped at its ends.

    The extremes over a box are at points whose coordinates are ends of the box or nodes between; of a box with more
    than `MOST_NODES` of these, the least and the greatest value of the table are taken.
    """
    ends = []
    for (low, high), first, step, nodes in zip(operands, lower, spacing, table.shape, strict=True):
        at = div(sub((low, high), (np.array(first), np.array(first))), (np.array(step), np.array(step)))
        ends += [np.clip(end, 0.0, nodes - 1.0) for end in at]
    whole = np.stack(np.broadcast_arrays(*ends))
    places = whole.reshape(len(ends), -1)  # (2 * axes, M)
    known, out = np.flatnonzero(np.isfinite(places).all(axis=0)), np.full((2, places.shape[1]), np.nan)
    low, high = places[0::2, known], places[1::2, known]
    shape = np.array(table.shape)
    # a box at the last node has the node before it, too, as `at_points` takes two at least
    begin = np.minimum(np.floor(low), shape[:, None] - 2.0)
    sizes = np.maximum(np.ceil(high) - begin + 1.0, 2.0).astype(np.int64)
    few = sizes.prod(axis=0) <= MOST_NODES
    out[:, known[~few]] = np.array([[table.min()], [table.max()]])
    alike = np.where(few, np.ravel_multi_index(tuple(sizes), tuple(shape + 1)), -1)
    for own in (np.flatnonzero(alike == one) for one in np.unique(alike[few])):
        out[:, known[own]] = at_points(table, sizes[:, own[0]].tolist(), low[:, own], high[:, own], begin[:, own])
    rounding = (2.0**table.ndim + 2 * table.ndim) * UNIT  # of sums of products, twice
    least, most = outward(out[0], out[1], rounding)
    return least.reshape(whole.shape[1:]), most.reshape(whole.shape[1:])


def at_points(table: Array, sizes: list[int], low: Array, high: Array, first: Array) -> Array:
    """The least and the greatest value of a table's interpolant in boxes (axes, M) with so many nodes around: (2, M).

    Widened by a bound on its rounding, by which `gridded` then widens once more. first (axes, M) : of the nodes around
    each box; values at the first and the last along an axis are replaced by those at the ends of the box.
    """
    nodes = [own + np.arange(n)[:, None] for own, n in zip(first.astype(np.int64), sizes, strict=True)]
    shapes = np.where(np.eye(len(sizes), dtype=np.bool_), sizes, 1).tolist()
    values = table[tuple(own.reshape(*shape, -1) for own, shape in zip(nodes, shapes, strict=True))]
    each = tuple(range(len(sizes)))
    slack = (2.0 ** len(sizes) + 2 * len(sizes)) * UNIT * np.abs(values).max(axis=each)
    for axis, n in enumerate(sizes):
        along = np.moveaxis(values, axis, 0)
        begin, end = low[axis] - first[axis], high[axis] - first[axis] - (n - 2)
        least = (1.0 - begin) * along[0] + begin * along[1]
        # in one statement: of two nodes own[-2] is own[0], which has to be read before it is replaced
        along[0], along[-1] = least, (1.0 - end) * along[-2] + end * along[-1]
    return np.stack([values.min(axis=each) - slack, values.max(axis=each) + slack])


RULES: dict[str, tuple[int, Callable[..., Interval]]] = {  # name: number of operands, rule
    "add": (2, add),
    "sub": (2, sub),
    "mul": (2, mul),
    "div": (2, div),
    "share": (2, share),
    "neg": (1, neg),
    "abs": (1, size),
    "sqr": (1, lambda a: power(a, 2)),
    "sqrt": (1, sqrt),
    "power": (1, power),
    "pow": (2, pow_),
    "exp": (1, rising(np.exp, 0.0)),
    "log": (1, rising(np.log)),
    "sin": (1, wave(np.sin, 0.25)),
    "cos": (1, wave(np.cos, 0.0)),
    "tan": (1, tan),
    "arctan": (1, rising(np.arctan)),
    "arctan2": (2, arctan2),
    "tanh": (1, rising(np.tanh, -1.0, 1.0)),
    "arcsin": (1, rising(np.arcsin)),
    "arccos": (1, arccos),
    "hypot": (2, hypot),
    "min": (2, lambda a, b: (np.minimum(a[0], b[0]), np.minimum(a[1], b[1]))),
    "max": (2, lambda a, b: (np.maximum(a[0], b[0]), np.maximum(a[1], b[1]))),
    "floor": (1, lambda a: (np.floor(a[0]), np.floor(a[1]))),
    "mod": (2, mod),
    "sign": (1, lambda a: (np.sign(a[0]), np.sign(a[1]))),
    "less": (2, less),
    "lesseq": (2, lesseq),
    "equal": (2, equal),
    "and": (2, lambda a, b: (np.minimum(a[0], b[0]), np.minimum(a[1], b[1]))),
    "or": (2, lambda a, b: (np.maximum(a[0], b[0]), np.maximum(a[1], b[1]))),
    "not": (1, lambda a: (1.0 - a[1], 1.0 - a[0])),
    "where": (3, where),
}
JUMPS = ("arctan2", "mod")  # operations that jump: by a whole turn, as a rule, which is nothing to an angle
TRUTHS = ("less", "lesseq", "equal", "and", "or", "not")  # operations whose result is a truth value
