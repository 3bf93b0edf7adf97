"""Exact results of single operations of formulas, in fractions and Arb's balls; imports nothing from sdhj."""

import math
from fractions import Fraction

import flint

PRECISION = 400  # bits


def exact(op, operands, n=0):
    """An operation's exact result at floats, a fraction or Arb's ball; None where it is undefined.

    n: exponent of `power`. Zeros have no signs.
    """
    rational = RATIONAL.get(op)
    if rational is not None:
        if not all(map(math.isfinite, operands)):
            return None
        result = rational(*map(Fraction, operands), n) if op == "power" else rational(*map(Fraction, operands))
        return None if result is None else Fraction(result)
    flint.ctx.prec = PRECISION
    return BALLS[op](*map(flint.arb, operands)) if DOMAINS.get(op, lambda *_: True)(*operands) else None


def lies_within(result, low, high):
    """Whether an exact result is between two floats, as far as 120 digits can tell."""
    if isinstance(result, Fraction):
        return Fraction(low) <= result <= Fraction(high)
    return not (result < flint.arb(low) or result > flint.arb(high))


def units_off(value, result):
    """How many units in the last place a float is from an exact result."""
    if isinstance(result, Fraction):
        return float(abs(Fraction(value) - result) / Fraction(math.ulp(float(result))))
    unit = math.ulp(float(result.mid()))
    return float(((flint.arb(value) - result) / flint.arb(unit)).abs_upper())


def _power(a, n):
    return None if a == 0 and n < 0 else a**n


def _arctan2(y, x):
    return flint.arb(0) if y == 0 and x == 0 else flint.arb.atan2(y, x)


RATIONAL = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: None if b == 0 else a / b,
    "share": lambda a, b: 0 if b == 0 else max(-1, min(1, a / b)),
    "neg": lambda a: -a,
    "abs": abs,
    "sqr": lambda a: a * a,
    "power": _power,
    "min": min,
    "max": max,
    "floor": math.floor,
    "mod": lambda a, b: None if b == 0 else a - math.floor(a / b) * b,
    "sign": lambda a: (a > 0) - (a < 0),
    "less": lambda a, b: a < b,
    "lesseq": lambda a, b: a <= b,
    "equal": lambda a, b: a == b,
    "and": lambda a, b: a * b,
    "or": max,
    "not": lambda a: 1 - a,
    "where": lambda c, a, b: a if c else b,
}
BALLS = {
    "sqrt": lambda a: a.sqrt(),
    "pow": lambda a, b: flint.arb(0) if a == 0 else (b * a.log()).exp(),
    "exp": lambda a: a.exp(),
    "log": lambda a: a.log(),
    "sin": lambda a: a.sin(),
    "cos": lambda a: a.cos(),
    "tan": lambda a: a.tan(),
    "arctan": lambda a: a.atan(),
    "arctan2": _arctan2,
    "tanh": lambda a: a.tanh(),
    "arcsin": lambda a: a.asin(),
    "arccos": lambda a: a.acos(),
    "hypot": lambda a, b: (a * a + b * b).sqrt(),
}
DOMAINS = {
    "sqrt": lambda a: a >= 0,
    "pow": lambda a, b: a > 0 or (a == 0 and b > 0),
    "log": lambda a: a > 0,
    "arcsin": lambda a: abs(a) <= 1,
    "arccos": lambda a: abs(a) <= 1,
}


def interpolated(table, position):
    """Multilinear interpolation of an array at a position in nodes, which is clipped."""
    if len(position) == 0:
        return float(table)
    place = min(max(position[0], 0.0), len(table) - 1.0)
    left = min(int(place), len(table) - 2)
    before, behind = (interpolated(table[left + i], position[1:]) for i in range(2))
    return before + (place - left) * (behind - before)
