"""Intervals of two floats: what an operation may give for all numbers in its operands, rounded outward.

An interval that is not finite stands for "may be undefined": where a number of the operands lies outside the domain, an
end becomes NaN here, and `sdhj.kernels.tape` then makes NaN of both. It does so for operands that are NaN, too, so that
no function here needs to look for them. Ends are moved outward by more than the error of the operation, so that an
interval has the exact results in it, and those of the rounded operation, whichever numbers of the operands it meets:
a rounded sum, product, quotient or root rises with the exact one, but for an elementary function both errors count.
"""

import math

import numpy as np

from sdhj.kernels.compiling import inlined
from sdhj.kernels.elementary import INF, LAPS, NAN

STEP = 2.0**-52  # a unit in the last place is at most that share of a number
TINY = 2.0**-1020  # more than is lost where a result is too small for all its digits
PI_UP = float.fromhex("0x1.921fb54442d19p+1")  # the next number above pi
LARGE = 1e300  # the reciprocal of a power that is nearly this small has lost digits
TURN = 0.15915494309189533577  # in a radian

_inlined = inlined(error_model="numpy")


@_inlined
def lesser(a, b):
    """The second where one is NaN."""
    return a if a < b else b


@_inlined
def larger(a, b):
    """The second where one is NaN."""
    return a if a > b else b


@_inlined
def nearest(low, high):
    """The least absolute value."""
    return larger(larger(low, -high), 0.0)


@_inlined
def farthest(low, high):
    """The largest absolute value."""
    return larger(-low, high)


@_inlined
def of_sum(low, high):
    """Sums that are tiny are exact, so nothing is added for them: a sum of squares stays >= 0."""
    return low - abs(low) * STEP, high + abs(high) * STEP


@_inlined
def widened(low, high, units, zero):
    """The ends of a function that is at most so many units in the last place off, and by `zero` where it gives 0."""
    share = (2.0 * units + 1.0) * STEP
    less, more = abs(low) * share + (zero if low == 0.0 else TINY), abs(high) * share + (zero if high == 0.0 else TINY)
    return low - less, high + more


@_inlined
def of_signs(low, high, negative, positive):
    """Widened ends of products or quotients, none of them negative, or none positive, where that is so."""
    low, high = low - (abs(low) * STEP + TINY), high + (abs(high) * STEP + TINY)
    return low if negative else larger(0.0, low), high if positive else lesser(0.0, high)


@_inlined
def mul(a, b, c, d):
    p, q, r, s = a * c, a * d, b * c, b * d
    negative, positive = (a < 0.0) & (d > 0.0) | (b > 0.0) & (c < 0.0), (a < 0.0) & (c < 0.0) | (b > 0.0) & (d > 0.0)
    return of_signs(lesser(lesser(p, q), lesser(r, s)), larger(larger(p, q), larger(r, s)), negative, positive)


@_inlined
def div(a, b, c, d):
    p, q, r, s = a / c, a / d, b / c, b / d
    above, below = c > 0.0, d < 0.0
    negative, positive = (a < 0.0) & above | (b > 0.0) & below, (b > 0.0) & above | (a < 0.0) & below
    low, high = of_signs(lesser(lesser(p, q), lesser(r, s)), larger(larger(p, q), larger(r, s)), negative, positive)
    return low if above | below else NAN, high


@_inlined
def sqr(low, high):
    near, far = nearest(low, high), farthest(low, high)
    return of_signs(near * near, far * far, False, far > 0.0)


@_inlined
def sqrt(low, high):
    """Of a negative number it is NaN; roots are no smaller than 1e-162, or exact."""
    p, q = math.sqrt(low), math.sqrt(high)
    return p - p * STEP, q + q * STEP


@_inlined
def _holds_whole(low, high):
    """Whether a whole number lies in an interval, or within the rounding of its ends."""
    slack = 4.0 * STEP * (1.0 + farthest(low, high))
    return np.ceil(low - slack) <= np.floor(high + slack)


@_inlined
def wave(low, high, p, q, shift, units):
    """sin or cos, p and q at the ends: its maxima are at shift, its minima at shift + 1/2, in turns and mod 1."""
    least, most = widened(lesser(p, q), larger(p, q), units, 0.0)
    low, high = low * TURN - shift, high * TURN - shift
    most = 1.0 if _holds_whole(low, high) else lesser(1.0, most)
    least = -1.0 if _holds_whole(low - 0.5, high - 0.5) else larger(-1.0, least)
    return least + 0.0 * (p + q), most  # not beyond where they are defined


@_inlined
def tan(low, high, p, q, units):
    least, most = widened(p, q, units, 0.0)
    low, high = low * (2.0 * TURN) - 0.5, high * (2.0 * TURN) - 0.5
    return NAN if _holds_whole(low, high) else least, most


@_inlined
def mod(a, b, c, d, p, q):
    """p and q: mod(a, c) and mod(b, c). By a constant, and where no lap ends, it rises with its first operand."""
    rises = (c == d) & ((b - a < abs(c)) & (p < q) | (a == b))
    low, high = lesser(c, 0.0), larger(d, 0.0)
    p, q = p - (abs(p) * STEP + TINY), q + (abs(q) * STEP + TINY)
    known = ((c > 0.0) | (d < 0.0)) & (farthest(a, b) / nearest(c, d) <= LAPS)
    return (larger(low, p) if rises else low) if known else NAN, lesser(high, q) if rises else high


@_inlined
def power(low, high, p, q, n):
    """p and q: the least and the largest n-th power of the base's ends, or of its absolute values where n is even."""
    least, most = widened(p, q, 0.5 * abs(n) + 1.0, TINY)
    even = n % 2 == 0
    least = larger(0.0, least) if even | (low >= 0.0) else least
    most = lesser(0.0, most) if (not even) & (high <= 0.0) else most
    most = most if (n >= 0) | (farthest(p, q) < LARGE) else INF
    return least if (n >= 0) | (low > 0.0) | (high < 0.0) else NAN, most
