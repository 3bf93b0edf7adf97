"""The checker's intervals: every exact value inside, by fractions and decimals; undefined wherever a value may be."""

import math
from fractions import Fraction
from itertools import product

import naive_formulas as naive
import numpy as np
import pytest
from parameters import but_slow

from sdhj.certified.check import intervals as intervals_module
from sdhj.certified.check.intervals import JUMPS, RULES, UNITS, gridded, sure

ELEMENTARY = ["exp", "log", "sin", "cos", "tan", "arctan", "arctan2", "tanh", "arcsin", "arccos", "hypot"]
TRUTHS = {"and": 2, "or": 2, "not": 1, "where": 1}  # so many operands are truth values
KINKS = np.array([0.0, -0.0, 1.0, -1.0, 0.5, math.pi / 2, math.pi, -math.pi, 2.0, 3.0, -4.0, 5e-324, 1e-160, -1e-200])


def boxes(rng, count):
    """Intervals of all widths and sizes, many of which end at a kink."""
    centre = rng.uniform(-4, 4, count) * 10.0 ** rng.choice([-3, 0, 0, 0, 1, 6], count)
    some = rng.random(count) < 0.4
    centre[some] = rng.choice(KINKS, int(some.sum()))
    width = rng.choice([0.0, 0.0, 1e-15, 1e-3, 0.3, 2.0, 9.0], (2, count)) * rng.choice([0, 1], (2, count))
    return centre - width[0], centre + width[1]


def truths(rng, count):
    low = rng.integers(0, 2, count).astype(float)
    return low, np.maximum(low, rng.integers(0, 2, count))


def beside(rng, some, others):
    """The `others`, of which a sixth each is the box of `some`, begins where that ends, or ends where it begins."""
    (begin, end), (low, high), kind = some, others, rng.integers(0, 6, len(others[0]))
    low, high = (np.select([kind == 0, kind == 1], [a, b], c) for a, b, c in ((begin, end, low), (end, end, high)))
    return np.where(kind == 2, np.minimum(low, begin), low), np.where(kind == 2, begin, np.maximum(low, high))


def check(name, rule, operands, rng, exponent=0):
    """How many of the boxes are known; every sample is inside those, and those in which one is undefined are not."""
    with np.errstate(all="ignore"):
        low, high = (np.broadcast_to(end, operands[0][0].shape) for end in sure(*rule(*operands)))
    assert (np.isnan(low) == np.isnan(high)).all() and not np.isinf([low, high]).any()
    assert (low <= high)[~np.isnan(low)].all()
    for box in range(len(low)):
        ends = [(a[box], b[box]) for a, b in operands]
        inside = [rng.uniform(a, b) for a, b in ends]
        for point in [
            *product(*ends),
            inside,
            [0.0 if a <= 0 <= b else x for (a, b), x in zip(ends, inside, strict=True)],
        ]:
            value = naive.exact(name, list(map(float, point)), exponent)
            if value is None:
                assert np.isnan(low[box]), (name, ends, point)
            elif not np.isnan(low[box]):
                assert naive.lies_within(value, low[box], high[box]), (name, ends, point, value, low[box], high[box])
    return float(np.mean(~np.isnan(low)))


@pytest.mark.parametrize("name", RULES)
def test_every_exact_value_is_inside(name, rng):
    if name == "power":
        for n in (-64, -3, -2, -1, 0, 1, 2, 3, 5, 64):
            assert check(name, lambda a, n=n: RULES[name][1](a, n), [boxes(rng, 60)], rng, n) > 0.3
        return
    count, rule = RULES[name]
    operands = [truths(rng, 150) if k < TRUTHS.get(name, 0) else boxes(rng, 150) for k in range(count)]
    if operands[1:] and name not in TRUTHS:
        operands[1] = beside(rng, *operands)
    known = check(name, rule, operands, rng)
    assert known > (0.15 if name in ("sqrt", "log", "pow", "arcsin", "arccos") else 0.4)


@pytest.mark.parametrize("name", ["mul", "div", "pow", "arctan2"])
@pytest.mark.parametrize("ends", [(2.0, 2.0), (-0.5, 3.0), (0.25, 0.5), (0.0, 0.0), (-0.0, 0.0)])
def test_one_interval_for_all_boxes_holds_as_those_of_each(name, ends, rng):
    """As of constants and times, which are no arrays: a number, or two that differ.

    NumPy's powers of a number and of an array may come from other loops: both hold, and differ by what these are off.
    """
    one, many = tuple(map(np.array, ends)), boxes(rng, 40)
    spread = tuple(np.full(40, end) for end in one)
    for order, side in product((1, -1), ((), (0,), (1,)) if name in JUMPS else ((),)):
        with np.errstate(all="ignore"):
            alone, each = (RULES[name][1](*[first, many][::order], *side) for first in (one, spread))
        rounding = {"rtol": 2 * UNITS, "atol": 1e-320} if name in ("pow", "arctan2") else {"rtol": 0.0}
        np.testing.assert_allclose(alone, each, **rounding)
        assert np.isfinite(alone).any() or min(ends) <= 0  # a divisor or a base that may be 0
        if not side:
            check(name, lambda *_, found=alone: found, [spread, many][::order], rng)


@pytest.mark.parametrize("name", JUMPS)
def test_every_exact_value_is_on_one_side_of_the_jump(name, rng):
    """On both sides together, that is; and where there is one jump alone, neither side goes all the way round."""

    def both(*operands):
        ends = [RULES[name][1](*operands, side) for side in (0, 1)]
        return np.minimum(ends[0][0], ends[1][0]), np.maximum(ends[0][1], ends[1][1])

    assert check(name, both, [boxes(rng, 150), boxes(rng, 150)], rng) > 0.4
    near = {"arctan2": ((-0.1, 0.2), (-1.1, -1.0)), "mod": ((1.9, 2.1), (2.0, 2.0))}[name]
    for side in (0, 1):
        low, high = RULES[name][1](*[tuple(map(np.array, one)) for one in near], side)
        assert high - low < 0.21


@pytest.mark.parametrize("name", ["add", "mul", "div", "sqrt", "pow", *ELEMENTARY])
def test_a_point_stays_narrow(name, rng):
    count, rule = RULES[name]
    operands = [(x := rng.uniform(0.1, 0.9, 1000), x) for _ in range(count)]
    low, high = sure(*rule(*operands))
    assert (high - low <= 40 * np.spacing(np.maximum(np.abs(low), np.abs(high)))).all()
    assert ((low < high) | (name == "add")).all()  # twice a number is exact
    if name not in ("add", "mul", "div", "sqrt"):  # eight units at either end: NumPy's own tests allow four
        assert (high - low >= 15.9 * np.spacing(np.minimum(np.abs(low), np.abs(high)))).all()


def test_closed_forms():
    """Hills, valleys, laps and jumps, by hand."""

    def of(name, *operands):
        with np.errstate(all="ignore"):
            return np.array(sure(*RULES[name][1](*[tuple(map(np.array, map(float, one))) for one in operands])))

    np.testing.assert_allclose(of("sin", (1, 2)), [math.sin(1), 1.0], rtol=1e-14)
    np.testing.assert_allclose(of("sin", (3, 8)), [-1.0, 1.0], rtol=1e-14)
    np.testing.assert_allclose(of("cos", (-1, 0.5)), [math.cos(1), 1.0], rtol=1e-14)
    np.testing.assert_allclose(of("cos", (3, 3.3)), [-1.0, math.cos(3.3)], rtol=1e-14)
    np.testing.assert_allclose(of("sin", (1e17, 1e17)), [-1.0, 1.0])  # nothing is known of the angle
    np.testing.assert_allclose(of("mod", (-2.8, -2.6), (1, 1)), [0.2, 0.4], atol=1e-14)
    assert of("mod", (0.9, 1.1), (1, 1)).tolist() == [0.0, 1.0] and of("mod", (0.9, 1.1), (-1, -1)).tolist() == [-1, 0]
    assert np.isnan(of("mod", (0.9, 1.1), (0, 1))).all() and np.isnan(of("tan", (1, 2))).all()
    assert of("share", (1, 2), (0, 1)).tolist() == [-1, 1] and of("share", (1, 1), (2, 4)).round(9).tolist() == [
        0.25,
        0.5,
    ]
    assert np.isnan(of("div", (1, 2), (-1, 1))).all() and np.isnan(of("div", (1, 2), (0, 0))).all()
    assert of("arctan2", (-1, 1), (-1, 1)).tolist() == of("arctan2", (0, 0), (-2, -1)).tolist()
    assert of("arctan2", (0, 0), (-2, -1))[1] > math.pi > of("arctan2", (0, 1), (1, 2))[1]
    assert np.isnan(of("sqrt", (-5e-324, 1))).all() and of("sqrt", (0, 4))[0] == 0.0
    assert np.isnan(of("exp", (0, 800))).all() and of("exp", (-800, -800))[0] == 0.0 < of("exp", (-800, -800))[1]
    assert of("sqrt", of("add", of("sqr", (0, 1)), of("sqr", (-1, 0))))[0] == 0.0  # no rounding below zero
    assert of("sqrt", of("mul", (0, 1), (0, 1)))[0] == 0.0 == of("sqrt", of("div", (-1, 0), (-2, -1)))[0]
    assert of("mul", (-1, 0), (2, 3))[1] == 0.0 == of("div", (-1, 0), (2, 3))[1]
    assert of("sin", (math.pi, math.pi))[1] - of("sin", (math.pi, math.pi))[0] >= 2.0**-55  # next to nothing, but where
    assert of("hypot", (0, 0), (0, 0)).tolist() == [0.0, 0.0] and of("hypot", (0, 5e-324), (0, 0))[1] > 5e-324
    assert of("sqr", (-2, 3))[0] == 0.0 and of("mod", (0, 5), (2, 3)).tolist() == [0.0, 3.0]
    assert of("where", (0, 1), (2, 3), (5, 6)).tolist() == [2.0, 6.0] and of("less", (0, 1), (1, 2)).tolist() == [0, 1]
    assert of("less", (0, 1), (2, 3)).tolist() == [1, 1] and of("less", (1, 2), (0, 1)).tolist() == [0, 0]
    assert of("equal", (0, 1), (0, 2)).tolist() == [0, 1]
    assert of("equal", (1, 1), (1, 1)).tolist() == [1, 1] and of("equal", (0, 1), (1, 2)).tolist() == [0, 1]


def far_out(rng, part):
    """Narrow boxes about whole numbers of turns, and a part of one: the two numbers next to it, and wider ones."""
    turns = np.concatenate([rng.integers(-(10**n), 10**n, 200) for n in range(2, 13)]).tolist()
    exact = [2 * Fraction(naive.pi(60)) * (k + Fraction(part)) for k in turns]
    near = np.array(list(map(float, exact)))
    beyond = np.array([Fraction(one) >= own for one, own in zip(near.tolist(), exact, strict=True)])
    low, high = np.where(beyond, np.nextafter(near, -np.inf), near), np.where(beyond, near, np.nextafter(near, np.inf))
    wider = np.spacing(np.abs(near)) * rng.choice([0.0, 0.0, 1.0, 8.0], (2, near.size))
    return low - wider[0], high + wider[1]


@pytest.mark.parametrize("name", ["sin", "cos"])
def test_hills_far_out_are_met(name, rng):
    """And valleys, where an angle is known to few digits of a turn."""
    hill = 0.25 if name == "sin" else 0.0
    for end, exact, part in ((1, 1.0, hill), (0, -1.0, hill + 0.5)):
        assert (RULES[name][1](far_out(rng, part))[end] == exact).all()


def test_poles_far_out_are_met(rng):
    for part in (0.25, 0.75):
        assert np.isnan(RULES["tan"][1](far_out(rng, part))).all()
    for low, high in ((0.1, 1.5), (-1.5, 1.5), (1.6, 4.6)):
        found = RULES["tan"][1]((np.array(low), np.array(high)))
        np.testing.assert_allclose(found, np.tan([low, high]), rtol=1e-14)


@pytest.mark.parametrize("name", RULES)
def test_what_is_undefined_stays_so(name):
    """NaN in any one operand; but not in the branch that `where` does not take."""
    count, rule = RULES[name]
    for place in range(count):
        operands = [(np.array([1.0]), np.array([1.0])) for _ in range(count)]
        operands[place] = np.array([np.nan]), np.array([np.nan])
        with np.errstate(all="ignore"):
            found = sure(*(rule(*operands, 0) if name == "power" else rule(*operands)))
        assert np.isnan(found).all() == (name != "where" or place < 2), (name, place)


def exact_lookup(table, lower, spacing, point):
    """In fractions, from the definition."""
    value, at = Fraction(0), []
    for x, low, step, nodes in zip(point, lower, spacing, table.shape, strict=True):
        at.append(min(max((Fraction(x) - Fraction(low)) / Fraction(step), Fraction(0)), Fraction(nodes - 1)))
    first = [min(int(place), nodes - 2) for place, nodes in zip(at, table.shape, strict=True)]
    for corner in product((0, 1), repeat=table.ndim):
        weight = math.prod(p - n if up else 1 - p + n for p, n, up in zip(at, first, corner, strict=True))
        value += weight * Fraction(table[tuple(n + up for n, up in zip(first, corner, strict=True))])
    return value


@pytest.mark.parametrize("ends", [(-np.inf, 1.0), (0.0, np.inf), (-np.inf, np.inf), (np.inf, np.inf), (np.nan, 1.0)])
@pytest.mark.parametrize("large", [1.0, 1.7e308])
def test_an_end_that_is_not_finite_makes_both_unknown(ends, large):
    """In its box alone; boxes so large that no sum of their widths is finite stay as they are."""
    low, high = np.array([-large, ends[0], -large]), np.array([large, ends[1], large])
    with np.errstate(all="ignore"):
        found = sure(low, high)
    assert np.isnan([end[1] for end in found]).all()
    np.testing.assert_array_equal([end[[0, 2]] for end in found], [[-large] * 2, [large] * 2])
    with np.errstate(all="ignore"):
        kept = sure(low[[0, 2]], high[[0, 2]])
    np.testing.assert_array_equal(kept, [[-large] * 2, [large] * 2])


@pytest.mark.parametrize("exact", [4, 256])
@pytest.mark.parametrize("shape", but_slow([(9,), (7, 12), (2, 5, 4), (2, 3, 2, 2)], (2, 3, 2, 2)))
def test_tables_are_interpolated(shape, exact, rng, monkeypatch):
    """Inside; and of a box with few nodes, the extremes are attained at a corner or a node."""
    monkeypatch.setattr(intervals_module, "MOST_NODES", exact)
    table, n = rng.normal(size=shape), len(shape)
    lower, spacing = rng.normal(size=n).tolist(), rng.uniform(0.1, 0.4, n).tolist()
    length = np.array(spacing) * (np.array(shape) - 1)
    centre = lower + length * rng.uniform(-0.2, 1.2, (25, n))
    half = length * rng.choice([0.0, 0.01, 0.1, 0.4, 2.0], (25, 1)) * rng.random((25, n))
    low, high = centre - half, centre + half
    least, most = gridded(list(zip(low.T, high.T, strict=True)), table, lower, spacing)
    for box in range(25):
        own = [[low[box, k], high[box, k]] for k in range(n)]
        for k in range(n):
            own[k] += [x for x in lower[k] + spacing[k] * np.arange(shape[k]) if low[box, k] < x < high[box, k]]
        found = [exact_lookup(table, lower, spacing, point) for point in product(*own)]
        assert least[box] <= min(found) and max(found) <= most[box]
        if exact == 256:
            assert min(found) - 1e-12 <= least[box] and most[box] <= max(found) + 1e-12
    undefined = gridded([(np.array([np.nan]),) * 2] * n, table, lower, spacing)
    assert np.isnan(undefined).all()
