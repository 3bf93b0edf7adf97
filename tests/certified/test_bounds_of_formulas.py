"""Functions called with intervals: every sampled value inside, closed forms, what cannot be followed is told.

Both libraries of intervals, the proof's and the checker's, are held against samples and against each other.
"""

import awkward_functions as awkward
import numpy as np
import pytest

import sdhj
from sdhj.certified.bounds import Bounds, LipschitzBounds
from sdhj.certified.check import verify
from sdhj.certified.check.spans import Span, called
from sdhj.certified.enclosures import Enclosure, NotFollowed, followed


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


@pytest.mark.parametrize("kind", [Enclosure, Span])
@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_sample_is_inside(name, kind, rng):
    function, centre = FUNCTIONS[name], rng.uniform(-3, 3, (20_000, 3))
    half = rng.uniform(0, 0.2, centre.shape) * rng.choice([0.0, 1.0, 10.0], centre.shape, p=[0.2, 0.7, 0.1])
    bound = function(kind(centre - half, centre + half))
    assert bound.shape == (20_000,) and np.isfinite([bound.low, bound.high]).mean() > 0.9
    for _ in range(20):
        value = function(centre + half * rng.choice([-1.0, 1.0, 0.3, 0.0], centre.shape))
        slack = 1e-15 * (1.0 + np.abs(value))  # the samples' own rounding
        out = (value + slack < bound.low) | (bound.high < value - slack)  # never where it may be undefined
        assert not out.any()


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_two_libraries_agree(name, rng):
    low = rng.uniform(-3, 3, (5000, 3))
    one, other = (FUNCTIONS[name](kind(low, low + 0.1)) for kind in (Enclosure, Span))
    for a, b in ((one.low, other.low), (one.high, other.high)):
        same = np.isclose(a, b, rtol=1e-12, atol=1e-12) | (np.abs(b) > 1e3)
        assert same.mean() > 0.99


@pytest.mark.parametrize("kind", [Enclosure, Span])
def test_closed_forms(kind):
    """What is known by hand, to rounding: distances of boxes, hills and valleys of a sine, a jump that is met."""
    box = kind([[-1.0, 2.0], [0.5, 0.5]], [[1.0, 3.0], [1.0, 2.0]])
    away = np.hypot(box[:, 0], box[:, 1])
    np.testing.assert_allclose([away.low, away.high], [[2.0, np.sqrt(0.5)], [np.sqrt(10.0), np.sqrt(5.0)]], rtol=1e-14)
    wave = np.sin(kind([0.0, 1.0, 3.0, -1.0], [0.5, 2.0, 8.0, 100.0]))
    np.testing.assert_allclose(wave.low, [0.0, np.sin(1.0), -1.0, -1.0], atol=1e-14)
    np.testing.assert_allclose(wave.high, [np.sin(0.5), 1.0, 1.0, 1.0], atol=1e-14)
    rest = kind([0.1, 0.9, -2.8, 3.1], [0.2, 1.1, -2.6, 3.3]) % 1.0  # as close on every lap
    np.testing.assert_allclose([rest.low, rest.high], [[0.1, 0.0, 0.2, 0.1], [0.2, 1.0, 0.4, 0.3]], atol=1e-14)
    flags = kind([0.0, 1.0, 2.0], [0.5, 3.0, 3.0]) > 1.5
    assert flags.low.tolist() == [0, 0, 1] and flags.high.tolist() == [0, 1, 1]


def test_rounding_is_outward():
    """0.1 + 0.2 is not 0.3 in floating point; the exact sum of the two numbers is between the ends."""
    for kind in (Enclosure, Span):
        total = kind(0.1, 0.1) + 0.2
        assert total.low < total.high and total.low <= 0.30000000000000004 <= total.high


@pytest.mark.parametrize(
    ("function", "told"),
    [
        (lambda p: np.interp(p[:, 0], [0, 1], [0, 1]), "numpy.interp"),
        (lambda p: np.min([p[:, 0], p[:, 1]], axis=0), "np.stack takes one"),
        (lambda p: p[:, 0] if p[0, 0] > 0 else p[:, 1], "a decision"),
        (lambda p: p[p[:, 0] > 0], "a decision|conversion"),
        (lambda p: p.cumsum(), "'cumsum'"),
    ],
)
def test_what_cannot_be_followed_is_told(function, told):
    with pytest.raises(NotFollowed, match=told):
        function(Enclosure(np.zeros((4, 2)), np.ones((4, 2))))


@pytest.mark.parametrize("kind", [Enclosure, Span])
@pytest.mark.parametrize("order", [0, 1, np.inf])
def test_no_other_norm_is_taken_for_the_euclidean_one(kind, order):
    with pytest.raises((NotFollowed, TypeError)):
        np.linalg.norm(kind(np.zeros(4), np.ones(4)), order)


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


@pytest.mark.parametrize(("kind", "asked"), [(Enclosure, followed), (Span, called)])
@pytest.mark.parametrize("name", sorted(awkward.FUNCTIONS.keys() - set(awkward.MIXED)))
def test_what_is_easily_bounded_wrongly_is_refused_or_right(name, kind, asked, rng):
    function = awkward.FUNCTIONS[name]
    for low, high, states in samples_of_boxes(rng):
        try:
            bound = asked(function, kind(low, high))
        except (TypeError, AttributeError):
            return  # refused
        for q in states:
            assert inside(np.broadcast_to(bound.low, 200), np.broadcast_to(bound.high, 200), alone(function, q))


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


@pytest.mark.parametrize("name", awkward.MIXED)
def test_what_mixes_states_is_not_bounded(name):
    """Some are refused when the problem is made, by a look at pieces of points."""
    with np.errstate(all="ignore"), pytest.raises(ValueError, match=r"of that state alone|its coordinates alone"):
        problem = problem_with(lambda p: awkward.FUNCTIONS[name](p) + 1.5)
        bounds, box = Bounds(problem, LipschitzBounds()), np.zeros((1, 2))
        bounds.level(problem.unsafe[0], box, box + 0.1, 0.0, 0.0)


@pytest.mark.filterwarnings("ignore")
def test_the_checker_does_not_lean_on_the_comparison_of_the_solver(tmp_path, monkeypatch):
    """A proof that was fooled is not believed."""
    problem = problem_with(lambda p: awkward.FUNCTIONS["isinst"](p) + 1.5)
    monkeypatch.setattr(Bounds, "_compare", lambda *_: None)
    sdhj.solve(problem, sdhj.Certified(cells=[8, 8]), progress=False, play=False).save(tmp_path / "fooled.h5")
    with pytest.raises(ValueError, match="outside of what spans say"):
        verify(tmp_path / "fooled.h5", problem, progress=False)
