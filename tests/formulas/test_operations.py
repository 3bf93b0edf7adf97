"""Every record of an operation, all its facets against each other, NumPy, the checker and exact results: none is listed
here."""

from dataclasses import replace

import graphs
import naive_formulas
import numpy as np
import pytest
import tapes

from sdhj.certified.check import intervals
from sdhj.formulas.derivative import derivative
from sdhj.formulas.formula import Formula
from sdhj.formulas.graph import interned, leaf, make
from sdhj.formulas.rules import RULES, facts
from sdhj.formulas.text import parsed, shown, written

LEAVES, EXPONENT = ("x", "p", "const"), 3
PLAYED = [name for name in RULES if name not in (*LEAVES, "gridded")]
X = [leaf("x", k) for k in range(3)]
FAR = dict.fromkeys(["sin", "cos", "tan"], lambda a: np.abs(a) > 1e8)  # which turn it is in is not known
FAR["mod"] = np.errstate(all="ignore")(lambda a, b: ~(np.abs(a / b) < 2.0**24))


def operands(rule, rng, count=400):
    """Points (count, arity) where most operations are defined, some of equal coordinates; truths where they belong."""
    points = np.concatenate([rng.uniform(0.05, 0.95, (count // 2, 3)), rng.uniform(-3.0, 3.0, (count // 2, 3))])
    points[::10, 1] = points[::10, 0]
    points[:, : rule.truths] = points[:, : rule.truths] > 0.5
    return points[:, : rule.arity]


def played(name, points, exponent=EXPONENT):
    return tapes.values(tapes.of_one(name, exponent), points)[0]


@pytest.mark.parametrize("name", PLAYED)
def test_values_are_numpys_by_the_functions_name(name, rng):
    """Within the error of both; undefined where NumPy's is, and where a kernel or the record says so."""
    rule = RULES[name]
    for n in tapes.POWERS if name == "power" else [0]:
        points = np.concatenate([operands(rule, rng), tapes.awkward_boxes(name, rng, 3000)[0]])
        exponent = [np.full(len(points), float(n))] if name == "power" else []
        ours, theirs = played(name, points, n), graphs.numpys(name, *points.T, *exponent)
        known = np.isfinite(theirs)
        assert known.mean() > 0.2 and not np.isfinite(ours[~known]).any()
        assert not np.isnan(theirs).any() or not rule.total or n < 0
        assert (np.isfinite(ours) | ~known | FAR.get(name, lambda *_: False)(*points.T)).all()
        known &= np.isfinite(ours)
        with np.errstate(over="ignore"):
            off = np.abs(ours[known] - theirs[known]) / np.spacing(np.abs(theirs[known]).clip(2.3e-308))
        units = abs(n) + 1.0 if exponent else rule.error or 0.0
        assert off.max() <= units + 4.0 * (units > 0), points[known][off.argmax()]
        assert (ours[known] >= rule.least).all() and (ours[known] <= rule.most).all()


@pytest.mark.parametrize("name", PLAYED)
def test_numpys_functions_are_read_as_it(name, rng):
    """And a formula of each says what NumPy says."""
    rule = RULES[name]
    points = operands(rule, rng)[:200]
    for ufunc in rule.ufuncs.split():

        def function(p, t, ufunc=ufunc):
            given = [p[:, k] > 0.5 if rule.truths else p[:, k] for k in range(rule.arity)]
            return np.where(getattr(np, ufunc)(*given), 1.0, 0.0) if rule.truth else getattr(np, ufunc)(*given)

        formula = Formula.read("it", function, rule.arity, "t")
        assert name in {one.op for one in [*formula.outputs, *formula.outputs[0].args]}, ufunc
        with np.errstate(all="ignore"):
            want = function(points, 0.0)
        np.testing.assert_allclose(formula(points, 0.0, finite=False), want, rtol=1e-14, atol=1e-300)


@pytest.mark.parametrize("name", PLAYED)
def test_what_is_said_of_it_holds(name, rng):
    """Where it falls or rises, what its size is, what it chooses, what Python's numbers make of it."""
    rule = RULES[name]
    points = operands(rule, rng)
    value, size = played(name, points), np.abs(points[:, 0])
    fine = np.isfinite(value)
    assert not rule.length or (value[fine] >= 0).all()
    assert not rule.shrinks or (np.abs(value[fine]) <= size[fine] * (1 + 1e-15)).all()
    assert not rule.truth or np.isin(value[fine], (0.0, 1.0)).all()
    assert not rule.chooses or (value[:, None] == points[:, list(rule.chooses)]).any(axis=1).all()
    if rule.absolute:
        np.testing.assert_array_equal(value, played(name, np.abs(points)))
    if rule.falls:
        more = points + np.eye(rule.arity)[0] * (1.0 - points[:, :1] if rule.truths else 0.1)
        again = played(name, more)
        both = fine & np.isfinite(again)
        assert (again[both] <= value[both]).all() and (again[both] < value[both]).any()
    for point, own in zip(points[:100].tolist(), value, strict=False):
        if rule.folded is not None and np.isfinite(own):
            assert float(rule.folded(*point)) == own


@pytest.mark.parametrize("name", PLAYED)
def test_intervals_hold_it_and_the_checker_agrees(name, rng):
    """Each value, and what is exact, lies within the kernel's interval and the checker's."""
    rule = RULES[name]
    points, exponent = operands(rule, rng, 300), (EXPONENT,) if name == "power" else ()
    far = rng.uniform(0.0, 0.2, points.shape) * (np.arange(rule.arity) >= rule.truths) * rng.integers(0, 2, (300, 1))
    low, high = points - far, points + far
    known, value = facts(list(RULES.values())), played(name, points)
    least, most = tapes.bounds(tapes.of_one(name, EXPONENT), low, high, facts=known)[:, 0]
    with np.errstate(all="ignore"):
        arity, checked = intervals.RULES[name]
        its = intervals.sure(*checked(*((low[:, k], high[:, k]) for k in range(arity)), *exponent))
    assert arity == rule.arity and np.isfinite(least).mean() > 0.2
    for row in range(len(points)):
        if not np.isfinite(least[row]):
            continue
        assert least[row] <= value[row] <= most[row], points[row]
        assert its[0][row] <= value[row] <= its[1][row], points[row]
        result = naive_formulas.exact(name, points[row].tolist(), *exponent)
        assert result is not None
        for ends in ((least, most), its):
            assert naive_formulas.lies_within(result, ends[0][row], ends[1][row]), points[row]


@pytest.mark.parametrize("name", PLAYED)
def test_derivatives_hold_differences(name, rng):
    """In a box in which its derivative is known, no difference exceeds the bound; most know theirs."""
    rule = RULES[name]
    if rule.truths:  # of truth values there are no differences; `where` has a test of its own
        assert rule.derivative is not None or name == "where"
        return
    one = interned(name, tuple(X[: rule.arity]), EXPONENT if name == "power" else None)
    points = np.pad(operands(rule, rng), ((0, 0), (0, 3 - rule.arity)))
    step = np.zeros(3)
    for k in range(rule.arity):
        step[:] = 1e-3 * (np.arange(3) == k)
        slope = Formula(tuple(derivative([one], X[k])), 3)
        least, most = slope.bounds(points, points + step)
        before, after = played(name, points[:, : rule.arity]), played(name, (points + step)[:, : rule.arity])
        known = np.isfinite(least) & np.isfinite(before) & np.isfinite(after)
        assert known.mean() > 0.2
        steep, off = np.maximum(-least, most)[known], np.abs(after - before)[known]
        assert (off <= steep * 1e-3 * (1 + 1e-9) + 1e-14 * (1 + np.abs(after[known]))).all()


@pytest.mark.parametrize("name", PLAYED)
def test_texts_and_mathematics_know_it(name):
    """A line of it is read again, what people see has its name or its sign, and its sentence ends."""
    rule, truth = RULES[name], make("less", X[0], X[1])
    args = tuple(truth if k < rule.truths else X[k] for k in range(rule.arity))
    one = interned(name, args, EXPONENT if name == "power" else None)
    assert parsed(written([one], []), [], 3, 1) == (one,)
    (text,) = shown([one], ["a", "b", "c"])
    marks = {"mul": "a b", "neg": "-a", "abs": "|a|", "sqr": "^2", "power": "^3"}
    assert (marks.get(name) or rule.sign or f"{name}(") in text and rule.says.endswith(".")
    if rule.sign and not rule.truths:
        said = eval(text.replace(" = ", " == "), {"a": 0.3, "b": 0.7})
        assert said == played(name, np.array([[0.3, 0.7]]))[0]


PLANTS = {
    "falls": ("neg", {"falls": False}, "intervals_hold"),
    "even": ("hypot", {"absolute": False}, "intervals_hold"),
    "no error": ("exp", {"error": None}, "intervals_hold"),
    "no interval of its own": ("sub", {"direct": False}, "intervals_hold"),
    "half a range": ("arctan2", {"least": 0.0}, "intervals_hold"),
    "error": ("sin", {"error": 0}, "values_are"),
    "domain": ("log", {"total": True}, "values_are"),
    "another's name": ("arcsin", {"numpy": "arccos"}, "values_are"),
    "another's function": ("tanh", {"ufuncs": "arctan"}, "read_as"),
    "never negative": ("sin", {"length": True}, "said_of"),
    "shrinks": ("exp", {"shrinks": True}, "said_of"),
    "chooses": ("sub", {"chooses": (0, 1)}, "said_of"),
    "folded": ("div", {"folded": lambda a, b: b / a}, "said_of"),
    "no derivative": ("cos", {"derivative": None}, "derivatives_hold"),
    "derivative": ("cos", {"derivative": RULES["sin"].derivative}, "derivatives_hold"),
    "sign": ("add", {"sign": " - "}, "texts"),
}


@pytest.mark.parametrize("name", PLANTS)
def test_a_wrong_facet_is_found(name, monkeypatch, rng):
    op, wrong, test = PLANTS[name]
    monkeypatch.setitem(RULES, op, replace(RULES[op], **wrong))
    (check,) = (one for known, one in globals().items() if known.startswith("test_") and test in known)
    with pytest.raises(AssertionError):
        check(op, *[rng] * (test != "texts"))


def test_there_are_no_others():
    """The checker knows the same operations; codes are all different, and those of the kernels."""
    assert set(intervals.RULES) == set(PLAYED)
    assert sorted(rule.code for rule in RULES.values()) == list(range(len(RULES)))
