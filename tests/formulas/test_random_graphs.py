"""Random graphs of all operations: all that reads a formula against all else, and against NumPy."""

from dataclasses import replace

import graphs
import numpy as np
import pytest

from sdhj.certified.check import intervals
from sdhj.certified.check.formulas import read
from sdhj.formulas.derivative import derivative, linear
from sdhj.formulas.formula import Formula
from sdhj.formulas.graph import leaf, ordered
from sdhj.formulas.rules import RULES, _but_for
from sdhj.formulas.text import parsed, written

T, PUSHES = 0.7, [leaf("p", 1), leaf("p", 2)]
LINEAR = ["add", "sub", "mul", "div", "neg", "where", "less"]  # of which sums of products are often made


def within(values, bounds, slack=0.0):
    """Whether bounds hold values, which are numbers wherever something is known of them."""
    known = np.isfinite(bounds[0])
    return (~known | (bounds[0] - slack <= values) & (values <= bounds[1] + slack)).all()


def check_graph(seed):
    """All nodes of a graph, simplified and not; how many bounds and differences there were to compare."""
    rng = np.random.default_rng(seed)
    pairs = graphs.random_pairs(rng, int(rng.integers(3, 25)))
    count, simplified, plain = len(pairs), *zip(*pairs, strict=True)
    made, raw = (Formula(nodes, 3, 1, (count,)) for nodes in (simplified, plain))
    for nodes in (simplified, plain):
        lines = written(nodes, [])
        assert parsed(lines, [], 3, 1) == nodes and written(parsed(lines, [], 3, 1), []) == lines
    theirs = read("it", {"coordinates": 3, "parameters": 1, "lines": written(plain, [])}, 3, 1, None)
    low, high = graphs.random_boxes(rng, 60, 3)
    ours, others = (formula.bounds(low, high, (T, T)) for formula in (raw, made))
    checkers = theirs.bounds(low, high, (T, T))
    slopes = Formula(tuple(derivative(simplified, graphs.X[0])), 3, 1, (count,))
    steep, compared = np.maximum(*np.abs(slopes.bounds(low, high, (T, T)))), np.zeros(2)
    last = Formula(plain[-1:], 3, 1)  # its results share slots
    for _ in range(4):
        points = graphs.random_points(rng, low, high)
        values, fewer = (formula(points, T, finite=False) for formula in (raw, made))
        np.testing.assert_array_equal(last(points, T, finite=False), values[:, -1])
        assert ((np.isnan(fewer) == np.isnan(values)) | np.isinf(values)).all()
        at = np.array(raw.bounds(points, points, (T, T)))
        sharp = np.subtract(at[1], at[0], out=np.zeros_like(at[0]), where=np.isfinite(at[0])) + 5e-324
        numpys = graphs.values(plain, points, [T]).T
        assert within(values, at) and within(fewer, at, sharp) and within(numpys, at, sharp)  # rounded otherwise
        assert within(values, ours) and within(fewer, others)
        far = np.isnan(values) & np.isfinite(numpys)  # sines of which kernels say nothing, and the checker [-1, 1]
        assert within(np.where(far, checkers[0], values), checkers)
        moved = points.copy()
        moved[:, 0] = graphs.random_points(rng, low, high)[:, 0]
        off, by = np.abs(made(moved, T, finite=False) - fewer), np.abs(moved - points)[:, :1]
        size = 1.0 + np.abs(fewer) + np.abs(others).max(axis=0)
        known = np.isfinite(steep) & np.isfinite(size)
        assert (off <= steep * by + 1e-12 * size)[known].all()
        compared += np.isfinite(ours[0]).sum(), (known & (by > 0)).sum()
    return compared


def check_graphs(seeds):
    with np.errstate(all="ignore"):
        compared = sum(map(check_graph, seeds))
    assert (compared > len(seeds) * np.array([1000, 400])).all(), compared


@pytest.mark.slow
def test_all_that_reads_a_graph_says_the_same():
    check_graphs(range(150))


@pytest.mark.campaign
@pytest.mark.parametrize("seed", range(1, 5))
def test_of_many_graphs(seed):
    check_graphs(range(1000 * seed, 1000 * seed + 1000))


def _cut(make, a, b):
    return make(value=0.0) if a is b else None


WRONG = {  # of a record, and of the checker's rules
    "undefined less itself": ("sub", {"simpler": _cut}),
    "more than neutral": ("min", {"simpler": _but_for("min", 1.0)}),
    "derivative of a share": ("share", {"derivative": lambda make, f, a, d: make("div", d[0], a[1])}),
    "derivative of a rest": ("mod", {"derivative": lambda make, f, a, d: d[0]}),
    "checker's sums": ("add", lambda a, b: (a[0] + b[0], a[1] + b[1] - 1e-9)),
    "checker's choice": ("where", lambda c, a, b: a),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_found(name, monkeypatch):
    op, wrong = WRONG[name]
    if callable(wrong):
        monkeypatch.setitem(intervals.RULES, op, (RULES[op].arity, wrong))
    else:
        monkeypatch.setitem(RULES, op, replace(RULES[op], **wrong))
    with pytest.raises(AssertionError):
        check_graphs(range(150))


@np.errstate(all="ignore")
def test_what_is_linear_is_the_sum_of_its_parts():
    count = 0
    for seed in range(1500):
        rng = np.random.default_rng(seed)
        *_, (node, _) = graphs.random_pairs(rng, int(rng.integers(1, 9)), LINEAR, (*graphs.X, *PUSHES, *PUSHES))
        found = linear([node], PUSHES) if PUSHES[0] in ordered([node]) or PUSHES[1] in ordered([node]) else None
        if not found:
            continue
        points, push = rng.uniform(-2.0, 2.0, (5, 3)), rng.uniform(-2.0, 2.0, 2)
        whole, parts = (graphs.values(nodes, points, [T, *push]) for nodes in ([node], found[0]))
        terms = parts * np.array([1.0, *push])[:, None]
        known = np.isfinite(whole[0]) & np.isfinite(terms).all(axis=0)
        size = 1.0 + np.abs(terms).sum(axis=0)
        assert (np.abs(whole[0] - terms.sum(axis=0)) <= 1e-9 * size)[known].all(), seed
        count += known.sum()
    assert count > 400
