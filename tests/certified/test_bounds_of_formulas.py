"""Bounds on formulas over boxes: every sampled value inside, closed forms, what cannot be read is refused."""

import awkward_functions as awkward
import numpy as np
import pytest

import sdhj
from sdhj.certified.bounds import Bounds
from sdhj.formulas.formula import Formula


def bounds_of(function, low, high):
    """Of a function of points alone."""
    low, high = (np.array(end, dtype=float).reshape(len(low), -1) for end in (low, high))
    return Formula.read("it", lambda p, t: function(p), low.shape[1], "t").bounds(low, high, (0.0, 0.0))


def assigned(p):
    out = np.zeros_like(p)
    out[:, 0] = 2.0 * p[:, 1]
    out[:, 1] = np.full(len(p), 0.4)
    return (out[:, 0] - out[:, 1]) / (1.5 + np.sin(p[:, 2]))


FUNCTIONS = {
    "disk": lambda p: np.hypot(p[:, 0] - 1.2, p[:, 1] - 0.8) - 0.4,
    "norm": lambda p: np.linalg.norm(p - [0.1, 0.2, 0.3], axis=1) - 1.0,
    "box": lambda p: np.max(np.maximum(-1.0 - p, p - [1.0, 0.5, 2.0]), axis=1),
    "where": lambda p: np.where(p[:, 0] > 0.5, np.sin(p[:, 1]) ** 2, p[:, 2] ** 3 - p[:, 1] * p[:, 0]),
    "wrapped": lambda p: np.abs((p[:, 0] + np.pi) % (2 * np.pi) - np.pi) - 0.3,
    "masks": lambda p: np.max(np.abs(p), axis=1) * ((p[:, 1] < 0) | ~(p[:, 0] <= 1)),
    "matrix": lambda p: (p @ np.array([[1.0, 2.0], [3.0, -1.0], [0.0, 0.3]])).sum(axis=1),
    "angle": lambda p: np.arctan2(p[:, 1], p[:, 0]) + np.arctan(p[:, 2]),
    "bump": lambda p: np.exp(-(p**2).sum(axis=1)) / (1 + p[:, 2] ** 2) + np.clip(p[:, 0], -1, 1).astype(float),
    "stacked": lambda p: np.min(np.stack([p[:, 0] - k * np.cos(p[:, 1]) for k in range(4)]), axis=0),
    "tangent": lambda p: p[:, 2] * np.tan(p[:, 1] / 3) + np.sqrt(np.abs(p[:, 0])) + np.cos(4 * p[:, 0]),
    "assigned": assigned,
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_sample_is_inside(name, rng):
    function, centre = FUNCTIONS[name], rng.uniform(-3, 3, (20_000, 3))
    half = rng.uniform(0, 0.2, centre.shape) * rng.choice([0.0, 1.0, 10.0], centre.shape, p=[0.2, 0.7, 0.1])
    low, high = bounds_of(function, centre - half, centre + half)
    assert low.shape == (20_000,) and np.isfinite([low, high]).mean() > 0.9
    for _ in range(20):
        value = function(centre + half * rng.choice([-1.0, 1.0, 0.3, 0.0], centre.shape))
        slack = 1e-15 * (1.0 + np.abs(value))  # the samples' own rounding
        out = (value + slack < low) | (high < value - slack)  # never where it may be undefined
        assert not out.any()


def test_closed_forms():
    """What is known by hand, to rounding: distances of boxes, hills and valleys of a sine, a jump that is met."""
    away = bounds_of(lambda p: np.hypot(p[:, 0], p[:, 1]), [[-1.0, 2.0], [0.5, 0.5]], [[1.0, 3.0], [1.0, 2.0]])
    np.testing.assert_allclose(away, [[2.0, np.sqrt(0.5)], [np.sqrt(10.0), np.sqrt(5.0)]], rtol=1e-14)
    least, most = bounds_of(lambda p: np.sin(p[:, 0]), [0.0, 1.0, 3.0, -1.0], [0.5, 2.0, 8.0, 100.0])
    np.testing.assert_allclose(least, [0.0, np.sin(1.0), -1.0, -1.0], atol=1e-14)
    np.testing.assert_allclose(most, [np.sin(0.5), 1.0, 1.0, 1.0], atol=1e-14)
    rest = bounds_of(lambda p: p[:, 0] % 1.0, [0.1, 0.9, -2.8, 3.1], [0.2, 1.1, -2.6, 3.3])  # as close on every lap
    np.testing.assert_allclose(rest, [[0.1, 0.0, 0.2, 0.1], [0.2, 1.0, 0.4, 0.3]], atol=1e-14)
    flags = bounds_of(lambda p: (p[:, 0] > 1.5) - 0.5, [0.0, 1.0, 2.0], [0.5, 3.0, 3.0])
    np.testing.assert_allclose(flags, [[-0.5, -0.5, 0.5], [-0.5, 0.5, 0.5]], rtol=1e-15)


def test_rounding_is_outward():
    """0.1 + 0.2 is not 0.3 in floating point; the exact sum of the two numbers is between the ends."""
    least, most = bounds_of(lambda p: p[:, 0] + 0.2, [0.1], [0.1])
    assert least < most and least <= 0.30000000000000004 <= most


@pytest.mark.parametrize(
    ("function", "told"),
    [
        (lambda p: p[:, 0] if p[0, 0] > 0 else p[:, 1], "where"),
        (lambda p: p[p[:, 0] > 0], "line"),
        (lambda p: p.cumprod(), "cumprod"),
        (lambda p: np.array([abs(x) for x, _ in p.tolist()]), "tolist"),
    ],
)
def test_what_cannot_be_read_is_told(function, told):
    with pytest.raises(ValueError, match=rf"{told}[\s\S]*sdhj.BlackBox\("):
        bounds_of(function, np.zeros((4, 2)), np.ones((4, 2)))


@pytest.mark.parametrize("order", [0, 1, np.inf])
def test_no_other_norm_is_taken_for_the_euclidean_one(order):
    low, high = np.array([[1.0, 2.0]]), np.array([[1.5, 2.5]])
    try:
        least, most = bounds_of(lambda p: np.linalg.norm(p, order, axis=1), low, high)
    except ValueError:
        return  # refused
    assert least <= np.linalg.norm(low[0], order) and np.linalg.norm(high[0], order) <= most


def test_a_spike_between_the_samples_is_seen():
    """A wall of 2 mm, steeper than anyone would state: no cell that it may be met from is certified."""
    spike = sdhj.UnsafeSet((0,), lambda p, t: 40.0 * np.abs(p[:, 0] - 1.2345) - 0.04, name="spike")
    problem = sdhj.ReachAvoidProblem(
        sdhj.Grid([0.0], [3.0], [31]),
        sdhj.Dynamics([[-1.0], [1.0]], [[-1.0], [1.0]], [[1.0]], [0.1]),
        sdhj.TargetSet((0,), lambda p, t: np.abs(p[:, 0] - 2.5) - 0.3),
        [spike],
        0.2,
        10,
    )
    table = sdhj.solve(problem, sdhj.Certified(cells=[150]), progress=False)
    assert table.contains([[1.3]], start=0, within=10) and not table.contains([[1.2]], start=0, within=10)


def samples_of_boxes(rng):
    """Boxes of all widths, some about zero, where much jumps; and states of each."""
    for width in (0.0, 0.02, 0.3, 1.5):
        centre = rng.uniform(-1, 1, (200, 2))
        centre[:20], centre[20:40, 0] = 0.0, 0.0
        low, high = centre - width / 2, centre + width / 2
        yield low, high, [low + (high - low) * rng.choice([0.0, 0.5, 1.0, rng.uniform()], low.shape) for _ in range(5)]


def alone(function, states):
    """The values of a function, each state on its own."""
    with np.errstate(all="ignore"):
        return np.array([np.asarray(function(q[None].copy()), dtype=np.float64)[0] for q in states])


def inside(low, high, values):
    """Whether bounds hold; none are given where a value may be undefined."""
    open_ = np.isnan(low) | (np.isinf(low) & np.isinf(high))
    return bool((open_ | ((low - 1e-12 <= values) & (values <= high + 1e-12))).all())


def problem_with(function):
    """A slider that must stay clear of a set of its place and its speed."""
    return sdhj.ReachAvoidProblem(
        sdhj.Grid([-1.0, -1.0], [1.0, 1.0], [9, 9]),
        sdhj.Dynamics(
            [[-1.0], [0.0], [1.0]],
            lambda q, u: np.stack([0.3 * q[:, 1], u + 0.0 * q[:, 0]], axis=1),
            [[0.0], [1.0]],
            [0.1],
        ),
        None,
        [sdhj.UnsafeSet((0, 1), lambda p, t: function(p), name="awkward")],
        0.1,
        2,
    )


@pytest.mark.filterwarnings("ignore::sdhj.problem.findings.ResolutionWarning")
@pytest.mark.parametrize("name", sorted(awkward.FUNCTIONS.keys() - set(awkward.MIXED)))
def test_what_is_easily_bounded_wrongly_is_refused_or_right(name, rng):
    """Bounds hold at every sample, and neither method promises a state that is in the set."""
    function = awkward.FUNCTIONS[name]
    with np.errstate(all="ignore"):
        try:
            problem = problem_with(function)
            tables = [sdhj.solve(problem, method, progress=False, play=False) for method in METHODS]
        except ValueError:
            return  # refused
        for low, high, states in samples_of_boxes(rng):
            low, high = (np.clip(end, -1.0, 1.0) for end in (low, high))
            least, most = Bounds(problem).bounds_of_level_set(problem.unsafe[0], low, high, 0.0, 0.1)
            for q in states:
                assert inside(least, most, alone(function, np.clip(q, -1.0, 1.0)))
        nodes, anywhere = problem.grid.points(), rng.uniform(-1, 1, (1000, 2))
        for table, q in zip(tables, (nodes, anywhere), strict=True):
            assert not (table.contains(q, start=0, within=0) & (alone(function, q) <= 0.0)).any()


METHODS = (sdhj.HopfLax(), sdhj.Certified(cells=[8, 8], parts=2))


@pytest.mark.parametrize("name", awkward.MIXED)
def test_what_mixes_states_is_refused(name):
    with np.errstate(all="ignore"), pytest.raises(ValueError, match=r"sdhj.BlackBox|differently"):
        problem_with(lambda p: awkward.FUNCTIONS[name](p) + 1.5)
