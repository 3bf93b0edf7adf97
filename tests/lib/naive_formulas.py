"""Exact results of single operations of formulas, in fractions or decimals of 110 digits; imports nothing from sdhj."""

import math
from decimal import Context, Decimal, localcontext
from fractions import Fraction
from functools import cache

DIGITS = 110
SURE = Decimal("1e-90")  # of a result: more than is lost in all that it takes
WIDE = Context(prec=DIGITS, Emax=10**6, Emin=-(10**6), traps=[])


def exact(op, operands, n=0):
    """An operation's exact result at floats, a fraction or a decimal; None where it is undefined.

    n: exponent of `power`. Zeros have no signs.
    """
    if not all(map(math.isfinite, operands)):
        return None
    rational = RATIONAL.get(op)
    if rational is not None:
        result = rational(*map(Fraction, operands), n) if op == "power" else rational(*map(Fraction, operands))
        return None if result is None else Fraction(result)
    with localcontext(WIDE):
        return DECIMAL[op](*map(Decimal, operands)) if DOMAINS.get(op, lambda *_: True)(*operands) else None


def lies_within(result, low, high):
    """Whether an exact result is between two floats, as far as 90 digits can tell."""
    if isinstance(result, Fraction):
        return Fraction(low) <= result <= Fraction(high)
    with localcontext(WIDE):
        slack = abs(result) * SURE if result.is_finite() else 0
        return Decimal(low) - slack <= result <= Decimal(high) + slack


def units_off(value, result):
    """How many units in the last place a float is from an exact result."""
    with localcontext(WIDE):
        off = Fraction(value) - result if isinstance(result, Fraction) else Decimal(value) - result
        return float(abs(off)) / math.ulp(float(result))


def _power(a, n):
    return None if a == 0 and n < 0 else a**n


@cache
def pi(digits):
    """By Machin's formula, to so many digits."""

    def arctan_of_inverse(n):
        total = term = 10 ** (digits + 10) // n
        k = 1
        while term:
            term //= -n * n
            total += term // (k := k + 2)
        return total

    with localcontext(WIDE, prec=digits):
        return Decimal(4 * (4 * arctan_of_inverse(5) - arctan_of_inverse(239))).scaleb(-digits - 10)


def _series(first, square, begin):
    """first (1 + square / (begin (begin + 1)) (1 + ...)): a sine or cosine of a small angle, square being -angle^2."""
    total = term = first
    while term and term.adjusted() > total.adjusted() - DIGITS - 5:
        term = term * square / (begin * (begin + 1))
        total, begin = total + term, begin + 2
    return total


def _angle(a, quarters):
    """The sine of a plus so many quarters of a turn."""
    with localcontext(WIDE, prec=2 * DIGITS + max(a.adjusted(), 0)) as context:
        quarter = pi(context.prec) / 2
        turned = (a / quarter).to_integral_value()
        rest, turned = a - turned * quarter, (int(turned) + quarters) % 4
    value = _series(Decimal(1), -rest * rest, 1) if turned % 2 else _series(+rest, -rest * rest, 2)
    return -value if turned > 1 else value


def _arctan(a):
    if abs(a) > 1:
        return pi(DIGITS) / 2 * (1 if a > 0 else -1) - _arctan(1 / a)
    for _ in range(4):
        a = a / (1 + (1 + a * a).sqrt())
    total, power, k = a, a, 1
    while power and power.adjusted() > total.adjusted() - DIGITS - 5:
        power, k = -power * a * a, k + 2
        total += power / k
    return 16 * total


def _arctan2(y, x):
    if x > 0:
        return _arctan(y / x)
    if x < 0:
        return _arctan(y / x) + pi(DIGITS) * (1 if y >= 0 else -1)
    return pi(DIGITS) / 2 * ((y > 0) - (y < 0))


def _tanh(a):
    with localcontext(WIDE, prec=DIGITS + max(-a.adjusted(), 0) if a else DIGITS):
        less = (-2 * abs(a)).exp()
        return ((1 - less) / (1 + less)).copy_sign(a)


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
DECIMAL = {
    "sqrt": Decimal.sqrt,
    "pow": lambda a, b: Decimal(0) if a == 0 else (b * a.ln()).exp(),
    "exp": Decimal.exp,
    "log": Decimal.ln,
    "sin": lambda a: _angle(a, 0),
    "cos": lambda a: _angle(a, 1),
    "tan": lambda a: _angle(a, 0) / _angle(a, 1),
    "arctan": _arctan,
    "arctan2": _arctan2,
    "tanh": _tanh,
    "arcsin": lambda a: _arctan2(a, ((1 - a) * (1 + a)).sqrt()),
    "arccos": lambda a: 2 * _arctan2((1 - a).sqrt(), (1 + a).sqrt()),
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
