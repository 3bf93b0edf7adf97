"""What conditions say in the branches of `where`: the same values, and bounds that hold where there were none."""

import math
import random

import numpy as np
import pytest

from sdhj.formulas import narrowing
from sdhj.formulas.formula import Formula, compare
from sdhj.formulas.graph import constant, interned, leaf, make, ordered
from sdhj.formulas.text import parsed, shown, written

X, Y = leaf("x", 0), leaf("x", 1)
NUMBERS = [constant(c) for c in (-1.0, 0.0, 0.5, 1.0)]
ROOTS = "sqrt sqrt log arcsin arccos abs neg sqr sin".split()


def random_pair(rng):
    """The same expression with branches that are narrowed and with branches that are not.

    Conditions compare what their branches are made of, as people's do.
    """

    def both(op, *operands):
        make_one = {"where": narrowing.where, "div": narrowing.quotient}.get(op, lambda *args: make(op, *args))
        one, other = zip(*operands, strict=True)
        return make_one(*one), interned(op, other) if op == "where" else make(op, *other)

    numbers, pairs = [(c, c) for c in NUMBERS], [(X, X), (Y, Y)]
    for _ in range(rng.choice([1, 1, 2])):
        compared = [rng.choice(pairs[-3:]), rng.choice([*numbers, *numbers, *pairs])]
        compared[0] = rng.choice([compared[0], both(rng.choice(["abs", "neg", "sqr"]), compared[0])])
        if rng.random() < 0.4:
            compared[0] = both(rng.choice(["hypot", "sub"]), compared[0], rng.choice(pairs))
        truths = [both(rng.choice(["less", "lesseq", "equal"]), *rng.sample(compared, 2)) for _ in range(2)]
        condition = rng.choice([truths[0], truths[0], both(rng.choice(["and", "or"]), *truths)])
        condition = rng.choice([condition, both("not", condition)])
        parts = [compared[0], both("sub", *compared), both("sub", *reversed(compared)), *pairs[-2:]]
        branch = both(rng.choice(ROOTS), rng.choice(parts))
        if rng.random() < 0.5:
            branch = both("div", rng.choice([branch, *pairs]), rng.choice(parts))
        pairs.append(both("where", condition, *rng.sample([branch, rng.choice([*numbers, *pairs])], 2)))
    return pairs[-1]


def check_random_branches(seeds):
    """Values are the same, NaN where they were, and lie in bounds that are no wider than without."""
    rng, known = np.random.default_rng(0), np.zeros(2)
    for seed in seeds:
        pair = random_pair(random.Random(seed))
        narrowed, plain = (Formula((one,), 2) for one in pair)
        assert parsed(written(pair[:1], []), [], 2, 0) == pair[:1]
        low, high = np.sort(rng.choice([-2.0, -1.0, -0.3, 0.0, 0.5, 0.7, 1.0, 3.0], (2, 40, 2)), axis=0)
        least, most = narrowed.bounds(low, high, (0.0, 0.0))
        before = plain.bounds(low, high, (0.0, 0.0))
        known += np.isfinite(least).sum(), np.isfinite(before[0]).sum()
        slack = 1e-12 * (1.0 + np.abs(before))
        assert ((before[0] - slack[0] <= least) & (most <= before[1] + slack[1]) | np.isinf(before[0])).all(), seed
        for share in (0.0, 0.5, 1.0, rng.random(low.shape), rng.random(low.shape)):
            points = np.clip(low + share * (high - low), low, high)
            values, expected = (one(points, 0.0, finite=False) for one in (narrowed, plain))
            assert (np.isnan(values) == np.isnan(expected)).all(), seed
            finite = np.isfinite(expected)
            assert values[finite] == pytest.approx(expected[finite], rel=1e-14), seed
            assert ((least <= values) & (values <= most) | ~finite & np.isinf(least)).all(), seed
    assert known[0] > known[1]


@pytest.mark.slow
@pytest.mark.parametrize("first", [0, 4000])
def test_branches_at_random(first):
    check_random_branches(range(first, first + 4000))


def length(p):
    return np.hypot(p[:, 0], p[:, 1])


def masked(p, t):
    out = np.zeros(len(p))
    out[p[:, 0] > 0.0] = 2.0
    return out


IDIOMS = {  # function; its extremes for |x|, |y| <= 1/2
    "direction": (lambda p, t: np.where(length(p) > 0, p[:, 0] / length(p), 0.0), -1.0, 1.0),
    "direction from norm": (lambda p, t: np.where((n := np.linalg.norm(p, axis=1)) != 0, -p[:, 1] / n, 0.0), -1.0, 1.0),
    "direction from squares": (
        lambda p, t: np.where((s := (p**2).sum(axis=1)) > 0, p[:, 1] / np.sqrt(s), 0.0),
        -1.0,
        1.0,
    ),
    "kept away": (lambda p, t: p[:, 0] / np.maximum(length(p), 1e-9), -1.0, 1.0),
    "moved away": (lambda p, t: np.sin(p[:, 0]) / (1e-9 + np.abs(p[:, 0])), -1.0, 1.0),
    "faster": (lambda p, t: np.where((n := length(p)) > 0, 3.0 * p[:, 0] / n, 0.0), -3.0, 3.0),
    "range rate": (lambda p, t: (p[:, 0] * (2 + t) - p[:, 1] / 2) / np.maximum(length(p), 1e-9), -2.5, 2.5),
    "sinc": (lambda p, t: np.where(p[:, 0] != 0, np.sin(p[:, 0]) / p[:, 0], 1.0), -1.0, 1.0),
    "truth": (lambda p, t: np.where(p[:, 0], np.tanh(p[:, 0]) / p[:, 0], 1.0), -1.0, 1.0),
    "quotient": (lambda p, t: np.where(p[:, 1] > 0.1, p[:, 0] / p[:, 1], 0.0), -5.0, 5.0),
    "root": (lambda p, t: np.where(p[:, 0] >= 0, np.sqrt(p[:, 0]), 0.0), 0.0, math.sqrt(0.5)),
    "other branch": (lambda p, t: np.where(p[:, 0] < 0, 0.0, np.sqrt(p[:, 0])), 0.0, math.sqrt(0.5)),
    "logarithm": (lambda p, t: np.where(~(p[:, 0] <= 0.1), np.log(p[:, 0]), 0.0), math.log(0.1), 0.0),
    "between": (lambda p, t: np.where((p[:, 0] > 0) & (p[:, 0] < 1), np.sqrt(p[:, 0] * (1 - p[:, 0])), 0.0), 0.0, None),
    "size": (lambda p, t: np.where(np.abs(4 * p[:, 0]) <= 1, np.arccos(4 * p[:, 0]), 0.0), 0.0, math.pi),
    "difference": (lambda p, t: np.where(p[:, 0] > p[:, 1], np.sqrt(p[:, 0] - p[:, 1]), 0.0), 0.0, 1.0),
    "selected": (
        lambda p, t: np.select([p[:, 0] < 0, p[:, 0] < 0.1], [0.0, np.sqrt(p[:, 0])], 0.3),
        0.0,
        math.sqrt(0.1),
    ),
    "either": (lambda p, t: np.where((p[:, 0] < 0) | (p[:, 1] < 0), 0.0, np.sqrt(p[:, 0] + p[:, 1])), 0.0, 1.0),
    "masked": (masked, 0.0, 2.0),
}


@pytest.mark.parametrize("name", IDIOMS)
def test_idioms_have_bounds(name):
    function, least, most = IDIOMS[name]
    formula = Formula.read(name, function, 2, "t")
    low, high = formula.bounds(np.full((1, 2), -0.5), np.full((1, 2), 0.5), (0.0, 0.0))
    assert low == pytest.approx(least, abs=1e-12) and (most is None or high == pytest.approx(most, abs=1e-12))
    assert np.isfinite(high)
    rng = np.random.default_rng(0)
    for scale in (1e-300, 1e-12, 1e-3, 1.0):
        centre, half = scale * rng.normal(size=(300, 2)), scale * rng.exponential(size=(300, 2))
        centre[:20], half[20:40], centre[40:60, 0] = 0.0, 0.0, 0.0
        low, high = formula.bounds(centre - half, centre + half, (0.0, 0.0))
        for share in (-1.0, 0.0, 1.0, rng.uniform(-1, 1, centre.shape)):
            points = centre + share * half
            with np.errstate(all="ignore"):
                values = function(points, 0.0)
            slack = 1e-14 * (1.0 + np.abs(values))
            assert ((low <= values + slack) & (values <= high + slack)).all()
            compare(formula, function, points, 0.0)


def test_what_may_be_undefined_or_unbounded_has_no_bounds():
    """Where the branch that is taken may be undefined, or grows beyond all bounds."""
    box = np.full((1, 2), -0.5), np.full((1, 2), 0.5)
    for function in (
        lambda p: np.where(p[:, 0] >= -0.1, np.sqrt(p[:, 0]), 0.0),
        lambda p: np.where(p[:, 0] > 0.0, 0.0, np.sqrt(p[:, 0])),
        lambda p: np.where((p[:, 0] > 0) | (p[:, 1] > 0), np.sqrt(p[:, 0]), 0.0),
        lambda p: np.where(p[:, 0] > 0.0, 1.0 / p[:, 0], 0.0),
        lambda p: np.where(p[:, 0] > 0.0, np.log(p[:, 0]), 0.0),
        lambda p: np.where(p[:, 0] > 0.0, p[:, 1] / p[:, 0], 0.0),
        lambda p: np.where(length(p) >= 0.0, p[:, 0] / length(p), 0.0),
        lambda p: np.where(np.sqrt(p[:, 0]) >= 0.0, 1.0, 0.0),
    ):
        assert np.isinf(Formula.read("f", lambda p, t, f=function: f(p), 2, "t").bounds(*box, (0.0, 0.0))).all()


def test_a_length_may_be_made_of_many():
    """Each is used twice: there are 2^3000 ways from the last to x."""
    length = make("abs", X)
    for _ in range(3000):
        length = make("hypot", length, length)
    kept = make("max", length, NUMBERS[3])
    assert narrowing.quotient(X, kept) is make("share", X, kept)
    assert narrowing.quotient(Y, kept) is make("div", Y, kept)


def test_a_condition_may_be_made_of_many():
    both = make("less", NUMBERS[1], X)
    for number in range(1, 1000):
        both = make("and", both, make("and", make("less", constant(-float(number)), Y), both))
    assert shown([narrowing.where(both, make("sqrt", X), Y).args[1]], "xy") == ["sqrt(max(x, 0))"]


def test_only_what_may_be_undefined_is_narrowed():
    kept = make("where", make("less", X, NUMBERS[1]), make("neg", X), X)
    assert narrowing.where(*kept.args) is kept
    assert shown([narrowing.where(make("less", X, NUMBERS[1]), Y, make("sqrt", X))], "xy") == [
        "where(x < 0, y, sqrt(max(x, 0)))"
    ]


def test_truth_values_stay_truth_values():
    """A comparison that is compared with a number is not cut at it: `and` takes truth values alone."""
    compared, other = make("less", X, Y), make("less", Y, NUMBERS[2])
    branch = make("where", make("and", compared, other), make("sqrt", X), Y)
    found = narrowing.where(make("less", compared, NUMBERS[2]), branch, X)
    assert parsed(written([found], []), [], 2, 0) == (found,)


def test_many_pieces_stay_few_operations():
    """Each piece is cut at its own ends alone: a hundred pieces do not have a hundred cuts each."""
    conditions = [make("less", X, constant(k)) for k in range(100)]
    piece = X
    for k, condition in reversed(list(enumerate(conditions))):
        piece = narrowing.where(condition, make("sqrt", make("add", X, constant(k))), piece)
    assert len(ordered([piece])) < 1000
