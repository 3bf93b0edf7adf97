"""Signs of zeros: what depends on them agrees with NumPy, in values, bounds and the checker, or is told."""

import itertools

import numpy as np
import pytest
import zoo

import sdhj
from sdhj.certified.check.formulas import read
from sdhj.formulas.formula import Formula, compare
from sdhj.formulas.text import written

GRID = sdhj.Grid([-2.0, -2.0], [2.0, 2.0], [40, 40])
ZEROS = np.array(list(itertools.product((-1.3, -0.0, 0.0, 0.7), repeat=2)))
TABLE = sdhj.gridded([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 1.0]], [-2.0, -2.0], [2.0, 2.0])
FLAT = {  # y, or y and x, are 0 in a region: of what sign decides
    "stopped": lambda p: np.arctan2(np.maximum(p[:, 1], 0), -np.maximum(p[:, 0], 0)),
    "stopped, below": lambda p: np.arctan2(-np.maximum(p[:, 1], 0), p[:, 0]),
    "stopped, by minima": lambda p: np.arctan2(np.minimum(-p[:, 1], 0.0) * -1.0, -np.abs(p[:, 0])),
    "a minus zero": lambda p: np.arctan2(np.maximum(p[:, 1], -0.0), p[:, 0]),
    "minus zeros": lambda p: np.arctan2(np.where(p[:, 1] > 0.5, p[:, 1], -np.zeros(len(p))), p[:, 0]),
    "a zero of either": lambda p: np.arctan2(np.maximum(np.minimum(p[:, 1], 0.0) * -2.0, 0.0), p[:, 0]),
    "nought times": lambda p: np.arctan2(0.0 * p[:, 1], p[:, 0]),
    "times nought": lambda p: np.arctan2(np.maximum(p[:, 1], p[:, 0] * 0.0), p[:, 0]),
    "nought and more": lambda p: np.arctan2(np.maximum(p[:, 1], 0.0) * p[:, 0], p[:, 0] - 1.0),
    "nought divided": lambda p: np.arctan2(np.maximum(p[:, 1], 0.0) / (p[:, 0] - 5.0), p[:, 0]),
    "chosen": lambda p: np.arctan2(-np.where(p[:, 1] > 0, p[:, 1], 0.0), p[:, 0]),
    "selected": lambda p: np.arctan2(-np.select([p[:, 1] > 0], [p[:, 1]]), p[:, 0]),
    "cut off": lambda p: np.arctan2(-np.clip(p[:, 1], 0.0, 1.0), p[:, 0]),
    "rounded up": lambda p: np.arctan2(np.ceil(p[:, 1]), p[:, 0]),
    "rounded": lambda p: np.arctan2(np.rint(p[:, 1]), p[:, 0]),
    "truncated": lambda p: np.arctan2(np.trunc(p[:, 1]), p[:, 0]),
    "a root": lambda p: np.arctan2(np.sqrt(-np.maximum(p[:, 1], 0.0) * 0.0), p[:, 0]),
    "a sine": lambda p: np.arctan2(np.sin(-np.maximum(p[:, 1], 0.0)), p[:, 0]),
    "an angle of one": lambda p: np.arctan2(-np.arctan2(np.maximum(p[:, 1], 0.0), np.abs(p[:, 0]) + 1), p[:, 0]),
    "a truth": lambda p: np.arctan2(-((p[:, 1] > 0) * p[:, 1]), p[:, 0]),
    "a table": lambda p: np.arctan2(-TABLE(p), p[:, 0]),
    "less itself": lambda p: np.arctan2(-(np.abs(p[:, 1]) - p[:, 1]), p[:, 0]),
    "of the mirrored": lambda p: np.arctan2(p[:, 1] - np.abs(p[:, 1]), -np.maximum(p[:, 0], 0)),
    "cube": lambda p: np.arctan2((-np.maximum(p[:, 1], 0.0)) ** 3, p[:, 0]),
    "written": lambda p: np.arctan2(written_over(p), p[:, 0]),
    "a product": lambda p: np.arctan2(np.einsum("i,i->i", -np.maximum(p[:, 1], 0.0), np.abs(p[:, 0])), p[:, 0]),
    "small": lambda p: np.arctan2(-np.maximum(np.hypot(p[:, 0] + 1.0, p[:, 1]) - 0.01, 0.0), p[:, 0]),
}
FINE = {  # what users write
    "bearing": lambda p: np.arctan2(p[:, 1], p[:, 0]),
    "bearing back": lambda p: np.arctan2(-p[:, 1], -p[:, 0]),
    "bearing of something": lambda p: np.arctan2(p[:, 1] - 0.3, p[:, 0] + 0.2),
    "turned": lambda p: np.arctan2(np.sin(p[:, 0] - 0.4), np.cos(p[:, 0] - 0.4)),
    "elbow": lambda p: np.arctan2(np.sqrt(np.maximum(1.0 - p[:, 0] ** 2, 0.0)), p[:, 0]),
    "upper half": lambda p: np.arctan2(np.maximum(p[:, 1], 0.0), p[:, 0]),
    "clipped above": lambda p: np.arctan2(np.clip(p[:, 1], 0.0, 1.0), p[:, 0]),
    "kept off": lambda p: np.arctan2(np.maximum(p[:, 1], 1e-9), -np.maximum(p[:, 0], 0)),
    "ahead": lambda p: np.arctan2(-np.maximum(p[:, 1], 0.0), np.abs(p[:, 0]) + 0.1),
    "elevation": lambda p: np.arctan2(np.hypot(p[:, 0], p[:, 1]), p[:, 0]),
    "either": lambda p: np.arctan2(np.where(p[:, 0] > 0, p[:, 1], -p[:, 1]), np.where(p[:, 0] > 0, p[:, 0], p[:, 1])),
    "steps": lambda p: np.arctan2(np.floor(p[:, 1]), p[:, 0]),
    "wrapped": lambda p: np.arctan2(np.mod(p[:, 1], 2.0) - 1.0, p[:, 0]),
    "one over": lambda p: np.arctan2(1.0 / (p[:, 1] - 3.0), p[:, 0]),
    "dead zone": lambda p: np.arctan2(p[:, 1] - np.clip(p[:, 1], -0.5, 0.5), p[:, 0]),
    "a number": lambda p: np.arctan2(0.0, -1.0 - np.abs(p[:, 0])),
}


def written_over(p):
    out = -np.zeros(len(p))
    out[p[:, 1] > 0.2] = 0.5
    return out


def checked(formula):
    """The checker's formula."""
    tables = []
    lines = written(formula.outputs, tables)
    return read("it", {"coordinates": 2, "parameters": 1, "lines": lines}, 2, 1, lambda at, _: tables[at].values)


@pytest.mark.parametrize("name", FINE)
def test_all_others_agree_with_numpy_on_zeros_of_both_signs(name, rng):
    """Values at random states and at zeros of both signs; bounds of boxes and the checker's hold what NumPy says."""
    function = FINE[name]
    formula = sdhj.TargetSet((0, 1), lambda p, t: function(p)).level_set
    states = np.concatenate([rng.uniform(-2, 2, (400, 2)), ZEROS])
    ties = "clip" in name or name == "upper half"  # the greater of 0.0 and -0.0 is either, to NumPy
    states = states[~((states[:, 1] == 0) & np.signbit(states[:, 1]))] if ties else states
    np.testing.assert_allclose(formula(states, 0.0), function(states), rtol=1e-14, atol=1e-14)
    low, high = states - rng.uniform(0, 0.3, states.shape), states + rng.uniform(0, 0.3, states.shape)
    low[::3], high[::5] = states[::3], states[::5]
    for begin, end in ((low, high), (states, high), (low, states)):
        inside = rng.uniform(begin, end)
        bounds = (
            formula.bounds_by_branch(begin, end, (0.0, 0.0)),
            [one[:, 0] for one in checked(formula).bounds(begin, end, (0, 0))],
        )
        for (least, most), points in itertools.product(bounds, (states, inside, begin, end)):
            for signed in (points, np.where(points == 0, -0.0, points), points + 0.0):
                values = function(signed)
                assert ((least <= values + 1e-15) & (values - 1e-15 <= most))[np.isfinite(least)].all()


@pytest.mark.parametrize("name", FLAT)
def test_bounds_hold_either_sign_even_where_nobody_asked(name, rng):
    """A file may have such a formula: prover and checker prove nothing of it that NumPy denies."""
    outputs, _ = sdhj.formulas.tracing.traced(
        name, FLAT[name], 5, lambda rows: [sdhj.formulas.tracing.points_of(2, rows)], (), True
    )
    formula = Formula(tuple(outputs), 2)
    low = np.concatenate([rng.uniform(-2, 2, (300, 2)), ZEROS])
    high = low + rng.uniform(0, 0.2, low.shape) * rng.integers(0, 2, low.shape)
    for least, most in (
        formula.bounds_by_branch(low, high, (0, 0)),
        [one[:, 0] for one in checked(formula).bounds(low, high, (0, 0))],
    ):
        for points in (low, high, rng.uniform(low, high)):
            values = FLAT[name](points)
            assert ((least <= values + 1e-15) & (values - 1e-15 <= most))[np.isfinite(least)].all()


@pytest.mark.parametrize("name", ["stopped", "nought times", "a minus zero"])
def test_the_comparison_tells_them_too(name, rng):
    outputs, _ = sdhj.formulas.tracing.traced(
        name, FLAT[name], 5, lambda rows: [sdhj.formulas.tracing.points_of(2, rows)], (), True
    )
    formula = Formula(tuple(outputs), 2)
    agrees = np.allclose(formula(states := rng.uniform(-2, 2, (200, 2)), 0.0), FLAT[name](states))
    if agrees:
        compare(formula, lambda p, t: FLAT[name](p), states, 0.0)
    else:
        with pytest.raises(ValueError, match="its formula says"):
            compare(formula, lambda p, t: FLAT[name](p), states, 0.0)
    with pytest.raises(ValueError, match="its formula says"):
        compare(formula, lambda p, t: -FLAT[name](p), states, 0.0)


@pytest.mark.parametrize("nodes", [40, 41])
def test_a_bearing_on_a_grid_with_a_node_in_its_origin_is_solved(nodes):
    problem = zoo.plane(
        0.5 * np.array(zoo.STEPS),
        (0.07, 0.1),
        grid=sdhj.Grid([-2.0, -2.0], [2.0, 2.0], [nodes, nodes]),
        target=sdhj.TargetSet((0, 1), lambda p, t: np.abs(np.arctan2(p[:, 1], p[:, 0])) - 0.5),
        unsafe=[sdhj.UnsafeSet((0, 1), lambda p, t: np.abs(np.arctan2(-p[:, 1], -p[:, 0])) - 0.3, name="o")],
        delta=0.25,
        steps=4,
    )
    for method in ("hji", sdhj.Certified([40, 40])):
        assert sdhj.solve(problem, method, play=False, progress=False).fraction(start=0) > 0.1
