"""Bounds, intervals of two floats: what an operation may give for all numbers in its operands, rounded outward.

An interval that is not finite stands for "may be undefined": where a number of the operands lies outside the domain, an
end becomes NaN here, and `sdhj.kernels.tape` then makes NaN of both. It does so for operands that are NaN, too, so that
no function here needs to look for them. Ends are moved outward by more than the error of the operation, so that an
interval has the exact results in it, and those of the rounded operation, whichever numbers of the operands it meets:
a rounded sum, product, quotient or root rises with the exact one, but for an elementary function both errors count.
"""

import numpy as np

from sdhj.kernels.compiling import inlined
from sdhj.kernels.elementary import INF, LAPS, NAN

STEP = 2.0**-52  # a unit in the last place is at most that share of a number
TINY = 2.0**-1020  # more than is lost where a result is too small for all its digits
PI_UP = float.fromhex("0x1.921fb54442d19p+1")  # the next number above pi
LARGE = 1e300  # the reciprocal of a power that is nearly this small has lost digits
TURN = 0.15915494309189533577  # in a radian


@inlined
def lesser(a, b):
    """The lesser of two numbers; the second where one is NaN."""
    return a if a < b else b


@inlined
def larger(a, b):
    """The larger of two numbers; the second where one is NaN."""
    return a if a > b else b


@inlined
def nearest(low, high):
    """The least absolute value of the numbers in [low, high]: 0 where 0 is among them."""
    return larger(larger(low, -high), 0.0)


@inlined
def farthest(low, high):
    """The largest absolute value of the numbers in [low, high]."""
    return larger(-low, high)


@inlined
def hull(p, q, r, s):
    """(least, greatest) of four numbers."""
    return lesser(lesser(p, q), lesser(r, s)), larger(larger(p, q), larger(r, s))


@inlined
def widened(low, high, share, tiny, zero):
    """(low, high) moved outward by `share` of their size and `tiny` more; an end that is 0, by `zero` instead."""
    less, more = zero if low == 0.0 else tiny, zero if high == 0.0 else tiny
    return low - (abs(low) * share + less), high + (abs(high) * share + more)


@inlined
def summed(a, b, c, d):
    """(low, high): the sums a + b and c + d, each moved outward only where it is not already beyond the exact sum.

    So where the border of a set is the end of the grid, that is still in the set.
    """
    low, high = a + b, c + d
    rest_low, rest_high = left_over(a, b, low), left_over(c, d, high)
    low = low if rest_low >= 0.0 else low - abs(low) * STEP
    return low, high if rest_high <= 0.0 else high + abs(high) * STEP


@inlined
def left_over(a, b, total):
    """a + b - total, the rounding error of a sum, exactly (Knuth's sum of two); NaN where numbers are too large."""
    second = total - a
    return (a - (total - second)) + (b - second)


@inlined
def outward_within_sign(low, high, negative, positive):
    """(low, high) of products or quotients, moved outward, but not across 0 if none is negative, or positive."""
    low, high = low - (abs(low) * STEP + TINY), high + (abs(high) * STEP + TINY)
    return low if negative else larger(0.0, low), high if positive else lesser(0.0, high)


@inlined
def mul(a, b, c, d):
    """(low, high) of [a, b] * [c, d]: the hull of the products of the ends, rounded outward."""
    low, high = hull(a * c, a * d, b * c, b * d)
    negative, positive = (a < 0.0) & (d > 0.0) | (b > 0.0) & (c < 0.0), (a < 0.0) & (c < 0.0) | (b > 0.0) & (d > 0.0)
    return outward_within_sign(low, high, negative, positive)


@inlined
def div(a, b, c, d):
    """(low, high) of [a, b] / [c, d]: the hull of the ends' quotients, outward; low is NaN for 0 in [c, d]."""
    above, below = c > 0.0, d < 0.0
    low, high = hull(a / c, a / d, b / c, b / d)
    negative, positive = (a < 0.0) & above | (b > 0.0) & below, (b > 0.0) & above | (a < 0.0) & below
    low, high = outward_within_sign(low, high, negative, positive)
    return low if above | below else NAN, high


@inlined
def _holds_whole(low, high):
    """Whether a whole number lies in [low, high], or so near to it that rounding of the ends may hide it."""
    slack = 4.0 * STEP * (1.0 + farthest(low, high))
    return np.ceil(low - slack) <= np.floor(high + slack)


@inlined
def wave(low, high, p, q, shift):
    """(low, high) of sin or cos over [low, high]: p or q, its values there, or -1 and 1 where an extreme lies within.

    shift : where a maximum is, in turns; minima are half a turn away.
    """
    low, high = low * TURN - shift, high * TURN - shift
    most = 1.0 if _holds_whole(low, high) else larger(p, q)
    least = -1.0 if _holds_whole(low - 0.5, high - 0.5) else lesser(p, q)
    return least + 0.0 * (p + q), most  # NaN where an end is too large


@inlined
def tan(low, high, least):
    """The lower end of tan over [low, high]: `least`, the value at `low`; NaN where a pole may lie within."""
    return NAN if _holds_whole(low * (2.0 * TURN) - 0.5, high * (2.0 * TURN) - 0.5) else least


@inlined
def mod(a, b, c, d, p, q):
    """(low, high) of mod over operands in [a, b] and divisors in [c, d], from p = mod(a, c) and q = mod(b, d).

    Where it rises from p to q, these, rounded outward, else 0 and the divisor; NaN where that may be 0, or beyond LAPS.
    """
    # for a constant divisor, where no lap ends: one that ends between a and b leaves q below p
    rises = (c == d) & ((b - a < abs(c)) & (p < q) | (a == b))
    low, high = lesser(c, 0.0), larger(d, 0.0)
    p, q = p - (abs(p) * STEP + TINY), q + (abs(q) * STEP + TINY)
    known = ((c > 0.0) | (d < 0.0)) & (farthest(a, b) / nearest(c, d) <= LAPS)
    return (larger(low, p) if rises else low) if known else NAN, lesser(high, q) if rises else high


@inlined
def power(low, high, p, q, n):
    """(low, high) of the n-th power over [low, high], from p and q, its least and largest value, widened already.

    Clipped at 0 where the sign is known; NaN where a negative power meets 0.
    """
    p, q = larger(0.0, p) if low >= 0.0 else p, lesser(0.0, q) if (high <= 0.0) & (n % 2 != 0) else q
    q = q if (n >= 0) | (farthest(p, q) < LARGE) else INF
    return p if (n >= 0) | (low > 0.0) | (high < 0.0) else NAN, q
