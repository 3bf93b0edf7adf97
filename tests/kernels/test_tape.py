"""Operations of formulas as compiled kernels play them: values and intervals against NumPy and exact results."""

import math
from fractions import Fraction
from itertools import product

import graphs
import naive_formulas as naive
import numpy as np
import pytest
import tapes
from parameters import but_slow

import sdhj
from sdhj.formulas.formula import Formula
from sdhj.formulas.rules import RULES

ERRORS = {op: rule.error for op, rule in RULES.items() if rule.error}
SCALARS = [(op, 0) for op in tapes.OPERATIONS if op != "power"] + [("power", n) for n in tapes.POWERS]
BITS = ("less", "lesseq", "equal", "and", "or", "not", "where")


@pytest.mark.parametrize("op", sorted(ERRORS))
def test_values_are_as_good_as_promised(op):
    """Against decimals of 110 digits, at random arguments of many sizes and near zeros of sine and cosine."""
    rng = np.random.default_rng(1)
    points = rng.normal(size=(900, tapes.arity(op))) * 10.0 ** rng.integers(-3, 3, (900, 1))
    points[:150, 0] = np.round(rng.uniform(-4e7, 4e7, 150)) * (math.pi / 2)
    points[150:300] = rng.uniform(0.0, 1.0, (150, tapes.arity(op)))
    points[300:450] = np.abs(points[300:450])
    worst = 0.0
    for point, value in zip(points, tapes.values(tapes.of_one(op), points)[0], strict=True):
        if np.isfinite(value) and abs(value) > 1e-300:
            worst = max(worst, naive.units_off(float(value), naive.exact(op, [float(x) for x in point])))
    assert 0.4 < worst <= ERRORS[op]


@pytest.mark.parametrize(("op", "n"), SCALARS)
def test_intervals_hold_what_is_exact(op, n):
    """Of every point: exact results and our own values; an undefined one makes the interval undefined."""
    rng = np.random.default_rng(2)
    tape = tapes.of_one(op, n)
    low, high = tapes.awkward_boxes(op, rng, 200)
    found = tapes.bounds(tape, low, high)[:, 0]
    assert (np.isnan(found[0]) == np.isnan(found[1])).all() and not np.isinf(found).any()
    assert 0.05 < np.isfinite(found[0]).mean()
    with np.errstate(over="ignore", invalid="ignore"):
        inside = low + rng.random(low.shape) * (high - low)
    inside = np.clip(np.where(np.isfinite(inside), inside, low), low, high)
    for points in (low, high, inside, np.where(rng.random(low.shape) < 0.5, low, high), np.clip(0.0, low, high)):
        if op in tapes.TRUTHS:
            points = np.round(points)
        elif op == "where":
            points = np.concatenate([np.round(points[:, :1]), points[:, 1:]], axis=1)
        ours = tapes.values(tape, points)[0]
        for point, value, (least, most) in zip(points.tolist(), ours, found.T, strict=True):
            if np.isfinite(least):
                result = naive.exact(op, point, n)
                assert result is not None and naive.lies_within(result, least, most), (point, least, most, result)
                assert least <= value <= most, (point, least, value, most)


@pytest.mark.parametrize(("op", "n"), SCALARS)
def test_intervals_of_points_are_narrow(op, n):
    """Of boxes of width 0 both ends lie within the promised error of each other, and both are known."""
    rng = np.random.default_rng(3)
    points = rng.normal(size=(2000, tapes.arity(op))) * 10.0 ** rng.integers(-2, 2, (2000, 1))
    if op in tapes.TRUTHS:
        points = np.round(np.abs(np.tanh(points)))
    values, (low, high) = (
        tapes.values(tapes.of_one(op, n), points)[0],
        tapes.bounds(tapes.of_one(op, n), points, points)[:, 0],
    )
    finite = np.isfinite(values)
    assert np.isfinite(low[finite]).mean() > 0.99
    finite &= np.isfinite(low)
    width = (high - low)[finite] / np.spacing(np.abs(values[finite]).clip(1e-290))
    if op in ("neg", "abs", "min", "max", "floor", "sign", *BITS):
        assert (width == 0.0).all()
    else:
        units = 0.5 * abs(n) + 1.0 if op == "power" else ERRORS.get(op, 0.5)
        assert width.max() <= 4.0 * (2.0 * units + 1.0) + 2.0


def test_zeros_and_ends_stay_exact():
    """A sum of squares is >= 0 and so has a root, |x| touches 0, and sin, cos and arcs stay in their ranges."""
    rows = [("x", 0, (0,), 0.0), ("x", 1, (1,), 0.0), ("sqr", 2, (0,), 0.0), ("mul", 3, (1, 1), 0.0)]
    rows += [("add", 4, (2, 2), 0.0), ("sqrt", 5, (4,), 0.0), ("abs", 6, (0,), 0.0), ("sqrt", 7, (6,), 0.0)]
    rows += [("hypot", 8, (0, 1), 0.0), ("sqrt", 9, (8,), 0.0), ("mul", 10, (6, 6), 0.0), ("sqrt", 11, (10,), 0.0)]
    rows += [("sin", 12, (1,), 0.0), ("arcsin", 13, (12,), 0.0), ("exp", 14, (0,), 0.0), ("sqrt", 15, (14,), 0.0)]
    low, high = tapes.bounds(tapes.made(rows, range(16)), [[-1.0, 0.0], [0.0, 0.0]], [[2.0, 9.0], [0.0, 0.0]])
    assert np.isfinite(low).all() and (low[[5, 7, 9, 11, 15], :] >= 0.0).all()
    assert (high[[3, 6, 8, 11], 1] == 0.0).all() and low[12, 0] == -1.0 and high[12, 0] == 1.0


@pytest.mark.parametrize(
    ("op", "n", "low", "high", "least", "most"),
    [
        ("sqr", 0, [-1.0], [2.0], 0.0, 4.0),
        ("power", 4, [-2.0], [1.0], 0.0, 16.0),
        ("power", 3, [-2.0], [1.0], -8.0, 1.0),
        ("power", -2, [-2.0], [-1.0], 0.25, 1.0),
        ("power", -1, [2.0], [4.0], 0.25, 0.5),
        ("hypot", 0, [-3.0, -1.0], [2.0, 4.0], 0.0, 5.0),
        ("hypot", 0, [3.0, 4.0], [6.0, 8.0], 5.0, 10.0),
        ("mod", 0, [7.5, 2.0], [7.75, 2.0], 1.5, 1.75),
        ("mod", 0, [7.5, 2.0], [8.25, 2.0], 0.0, 2.0),
        ("mod", 0, [-0.5, 2.0], [-0.25, 2.0], 1.5, 1.75),
        ("mod", 0, [0.25, -2.0], [0.5, -2.0], -1.75, -1.5),
        ("mod", 0, [0.25, -2.0], [9.0, -2.0], -2.0, 0.0),
        ("mod", 0, [1.0, 2.0], [1.5, 3.0], 0.0, 3.0),
        ("sin", 0, [0.5], [3.0], math.sin(3.0), 1.0),
        ("sin", 0, [3.0], [6.0], -1.0, math.sin(3.0)),
        ("cos", 0, [-0.5], [0.25], math.cos(0.5), 1.0),
        ("cos", 0, [100.0], [200.0], -1.0, 1.0),
        ("tan", 0, [2.0], [4.0], math.tan(2.0), math.tan(4.0)),
        ("arctan2", 0, [1.0, -1.0], [2.0, 1.0], math.pi / 4, 3 * math.pi / 4),
        ("arctan2", 0, [-1.0, 0.5], [1.0, 1.0], -math.atan(2.0), math.atan(2.0)),
        ("arctan2", 0, [0.0, -1.0], [0.0, 1.0], -math.pi, math.pi),
        ("arctan2", 0, [0.0, 0.0], [0.0, 0.0], -math.pi, math.pi),
        ("pow", 0, [0.5, -1.0], [2.0, 2.0], 0.25, 4.0),
        ("pow", 0, [0.0, 0.5], [4.0, 0.5], 0.0, 2.0),
        ("mul", 0, [-1.0, -2.0], [3.0, 1.0], -6.0, 3.0),
        ("div", 0, [-1.0, 2.0], [3.0, 4.0], -0.5, 1.5),
        ("share", 0, [-1.0, 2.0], [3.0, 4.0], -0.5, 1.0),
        ("share", 0, [0.5, 0.0], [0.5, 2.0], -1.0, 1.0),
        ("share", 0, [0.5, 1.0], [0.5, 2.0], 0.25, 0.5),
        ("less", 0, [0.0, 1.0], [1.0, 2.0], 0.0, 1.0),
        ("lesseq", 0, [0.0, 1.0], [1.0, 2.0], 1.0, 1.0),
        ("equal", 0, [1.0, 1.0], [1.0, 1.0], 1.0, 1.0),
        ("where", 0, [0.0, 1.0, 5.0], [1.0, 2.0, 6.0], 1.0, 6.0),
        ("where", 0, [1.0, 1.0, 5.0], [1.0, 2.0, 6.0], 1.0, 2.0),
    ],
)
def test_intervals_are_tight(op, n, low, high, least, most):
    for slot in range(tapes.arity(op)):
        found = tapes.bounds(tapes.of_one(op, n, slot), [low], [high])[:, 0, 0]
        assert found == pytest.approx([least, most], rel=1e-14, abs=1e-13) and found[0] <= least <= most <= found[1]


@pytest.mark.parametrize(
    ("op", "n", "low", "high"),
    [
        ("div", 0, [1.0, 0.0], [1.0, 1.0]),
        ("sqrt", 0, [-1e-300], [1.0]),
        ("log", 0, [0.0], [1.0]),
        ("pow", 0, [0.0, 0.0], [1.0, 1.0]),
        ("pow", 0, [-0.1, 2.0], [1.0, 2.0]),
        ("power", -2, [-1.0], [1.0]),
        ("arcsin", 0, [0.0], [1.0 + 1e-15]),
        ("arccos", 0, [-1.1], [1.0]),
        ("tan", 0, [1.0], [2.0]),
        ("mod", 0, [1.0, -1.0], [1.0, 1.0]),
        ("mod", 0, [1.0, 1.0], [1e9, 1.0]),
        ("sin", 0, [0.0], [1e9]),
        ("exp", 0, [0.0], [710.0]),
        ("mul", 0, [0.0, 0.0], [1e200, 1e200]),
    ],
)
def test_what_may_be_undefined_or_too_large_is_not_known(op, n, low, high):
    assert np.isnan(tapes.bounds(tapes.of_one(op, n), [low], [high])).all()


@pytest.mark.parametrize(("op", "n"), SCALARS)
def test_what_is_undefined_stays_so(op, n):
    """NaN in any operand, but in the branch that `where` does not take."""
    for place in range(tapes.arity(op)):
        for slot in range(tapes.arity(op)):
            point = [1.0] * tapes.arity(op)
            point[place] = math.nan
            lost = (op, place) != ("where", 2)
            assert np.isnan(tapes.values(tapes.of_one(op, n, slot), [point])[0, 0]) == lost
            assert np.isnan(tapes.bounds(tapes.of_one(op, n, slot), [point], [point])).all() == lost
    infinite = [[math.inf] * tapes.arity(op)]
    if op not in BITS:
        assert np.isnan(tapes.bounds(tapes.of_one(op, n), [[1.0] * tapes.arity(op)], infinite)).all()


def test_where_needs_both_branches_only_while_its_condition_is_open():
    tape, nan = tapes.of_one("where"), math.nan
    low, high = [[0.0, 1.0, nan], [1.0, 1.0, nan], [0.0, nan, 1.0]], [[1.0, 2.0, nan], [1.0, 2.0, nan], [0.0, nan, 2.0]]
    assert np.isnan(tapes.bounds(tape, low, high)[0, 0]).tolist() == [True, False, False]


@pytest.mark.slow
def test_leaves_and_blocks():
    """Coordinates, parameters and constants of more points than a block has, with no points, and with many."""
    rows = [
        ("x", 0, (1,), 0.0),
        ("p", 1, (1,), 0.0),
        ("const", 2, (), 2.5),
        ("add", 0, (0, 1), 0.0),
        ("mul", 1, (0, 2), 0.0),
    ]
    tape = tapes.made(rows, [1, 0, 2])
    for count in (0, 1, 127, 128, 129, 1000, 600_000):
        points = np.arange(2.0 * count).reshape(count, 2)
        expected = [2.5 * (points[:, 1] + 4.0), points[:, 1] + 4.0, np.full(count, 2.5)]
        assert np.array_equal(tapes.values(tape, points, [0.0, 4.0]), expected)
        low, high = tapes.bounds(tape, points, points + 1.0, [0.0, 4.0], [0.0, 5.0])
        assert np.allclose(low, expected, rtol=1e-15, atol=0) and (low <= expected).all()
        assert np.allclose(high[1], expected[1] + 2.0, rtol=1e-15, atol=0)


def random_tables(rng, axes):
    nodes = rng.integers(2, 5, axes)
    lower, spacing = rng.normal(size=axes), rng.uniform(0.1, 1.0, axes)
    table = rng.normal(size=nodes)
    fill = [0] * (6 - axes)
    rows = [("x", k, (k,), 0.0) for k in range(axes)] + [("gridded", 0, (0,), 0.0)]
    lookup = [axes, *range(axes), *fill, *nodes, *fill, 3]
    tape = tapes.made(rows, [0], None, [lookup], [[*lower, *fill, *spacing, *fill]], [7.0, 8.0, 9.0, *table.ravel()])
    return tape, table, lower, spacing


@pytest.mark.parametrize("axes", but_slow(range(1, 7), 6))
def test_gridded(axes):
    """Values against a slow twin, intervals against samples: they hold them and are no wider than their hull."""
    rng = np.random.default_rng(axes)
    tape, table, lower, spacing = random_tables(rng, axes)
    ends = lower + spacing * (np.array(table.shape) - 1)
    low, high = np.sort(rng.uniform(lower - 0.3, ends + 0.3, (2, 60, axes)), axis=0)
    low[::3] = high[::3]
    found = tapes.bounds(tape, low, high)[:, 0]
    nodes = np.array(
        list(product(*[low_ + step * np.arange(n) for low_, step, n in zip(lower, spacing, table.shape, strict=True)]))
    )
    least, most = np.full(60, np.inf), np.full(60, -np.inf)
    sides = [np.where(pick, high, low) for pick in product([False, True], repeat=axes)]
    for points in sides + [np.clip(node, low, high) for node in nodes] + [rng.uniform(low, high) for _ in range(20)]:
        values = tapes.values(tape, points)[0]
        assert ((found[0] <= values) & (values <= found[1])).all()
        least, most = np.minimum(least, values), np.maximum(most, values)
        expected = [naive.interpolated(table, (p - lower) / spacing) for p in points[:3]]
        assert np.allclose(values[:3], expected, rtol=0, atol=1e-13)
    assert np.allclose(found, [least, most], rtol=0, atol=1e-12)
    low[0, axes - 1] = np.nan
    assert np.isnan(tapes.values(tape, low)[0]).tolist() == [True] + [False] * 59
    assert np.isnan(tapes.bounds(tape, low, high)[0, 0]).tolist() == [True] + [False] * 59


@pytest.mark.parametrize("axes", range(1, 4))
def test_intervals_of_tables_hold_what_is_exact(axes):
    """At single points, in fractions."""
    rng = np.random.default_rng(axes)
    tape, table, lower, spacing = random_tables(rng, axes)
    points = rng.uniform(lower, lower + spacing * (np.array(table.shape) - 1), (300, axes))
    exact = [np.vectorize(Fraction, otypes=[object])(part) for part in (points, lower, spacing, table)]
    for (least, most), point in zip(tapes.bounds(tape, points, points)[:, 0].T, exact[0], strict=True):
        place = (point - exact[1]) / exact[2]
        left = [min(int(x), n - 2) for x, n in zip(place, table.shape, strict=True)]
        value = Fraction(0)
        for corner in product((0, 1), repeat=axes):
            shares = [x - n if side else 1 - x + n for x, n, side in zip(place, left, corner, strict=True)]
            value += math.prod(shares) * exact[3][tuple(n + side for n, side in zip(left, corner, strict=True))]
        assert least <= value <= most


@pytest.mark.parametrize("shape", [(900,), (130, 45), (31, 5, 40)])
def test_bounds_of_boxes_with_many_nodes(shape):
    """They hold all values in a box, and are those of a box that is longer by at most a quarter of its longest side."""
    rng = np.random.default_rng(len(shape))
    steps = [
        np.cumsum(rng.normal(size=n)).reshape([-1 if k == axis else 1 for k in range(len(shape))])
        for axis, n in enumerate(shape)
    ]
    table, last = sum(steps) + rng.normal(size=shape), np.array(shape) - 1.0
    formula = Formula.traced("a table", sdhj.gridded(table, [-1.0] * len(shape), [0.5] * len(shape)), len(shape), 0)
    low, high = np.sort(rng.uniform(-0.1, 1.1, (2, 300, len(shape))), axis=0) * last
    found = tapes.bounds(formula.tape, low / 2 - 1.0, high / 2 - 1.0)[:, 0]
    many = 0
    for a, b, least, most in zip(low, high, *found, strict=True):
        a, b = np.clip(a, 0.0, last), np.clip(b, 0.0, last)
        nodes = table[tuple(slice(int(np.ceil(x)), int(np.floor(y)) + 1) for x, y in zip(a, b, strict=True))]
        room = (b - a).max() / 4 + 1
        begin, end = np.floor(np.maximum(a - room, 0)), np.ceil(np.minimum(b + room, last))
        around = table[tuple(slice(int(x), int(y) + 1) for x, y in zip(begin, end, strict=True))]
        values = formula(rng.uniform(a, b, (20, len(shape))) / 2 - 1.0)
        assert least <= min(nodes.min(initial=np.inf), values.min())
        assert most >= max(nodes.max(initial=-np.inf), values.max())
        assert least >= around.min() - 1e-9 and most <= around.max() + 1e-9
        many += nodes.size > 300
    assert many > 30


def test_threads_play_the_same():
    """Many points are shared out to threads, and each has the bits it has alone."""
    rng = np.random.default_rng(5)
    nodes = tuple(node for _, node in graphs.random_pairs(rng, 60, leaves=graphs.X)[-3:])
    tape, points = Formula(nodes, 3, 0, (3,)).tape, rng.normal(size=(40_001, 3))
    values, found = tapes.values(tape, points), tapes.bounds(tape, points, points + 0.01)
    few = [*range(0, 40_001, 997), 40_000]
    np.testing.assert_array_equal(tapes.values(tape, points[few]), values[:, few])
    np.testing.assert_array_equal(tapes.bounds(tape, points[few], points[few] + 0.01), found[..., few])


@pytest.mark.parametrize("seed", range(6))
def test_boxes_that_share_coordinates_have_the_bounds_of_each(seed):
    """What all boxes of a block share is bounded once: the same bits as in any order, at zeros of both signs, too."""
    rng = np.random.default_rng(seed)
    nodes = tuple(node for _, node in graphs.random_pairs(rng, 60, leaves=graphs.X))
    tape = Formula(nodes, 3, 0, (len(nodes),)).tape
    sides = [[0.0, -0.0, *rng.choice(tapes.AWKWARD, 2)], [-0.0, 0.0, 0.7], rng.normal(size=300)]
    low = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3)
    high, order = low + np.array([0.25, 0.0, 0.01]), rng.permutation(len(low))
    found, mixed = tapes.bounds(tape, low, high), tapes.bounds(tape, low[order], high[order])
    np.testing.assert_array_equal(found[..., order].view(np.int64), mixed.view(np.int64))
    assert 0.1 < np.isfinite(found).mean()
