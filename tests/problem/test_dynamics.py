"""What input and adversary can do in one interval: closed forms, slow twins, and every guard tripped."""

import functools
import itertools
import math
import pickle
from dataclasses import replace

import judge
import naive_projections as naive
import numpy as np
import pytest
import zoo
from parameters import but_slow

import sdhj
from sdhj import BlackBox, Dynamics, Grid, TargetSet, UnsafeSet
from sdhj.problem.arguments import arguments
from sdhj.problem.interval import Interval
from sdhj.problem.samples import Samples
from sdhj.solver.games import HJIGames
from sdhj.solver.schemes import Scheme

ROUNDING = 1e-12  # some dozen operations on numbers of order one


def near_zero(p, t):
    return np.abs(p[:, 0]) - 0.5


def problem_of(dynamics, grid=None, **changed):
    grid = grid or Grid([-2.0, -2.0], [2.0, 2.0], [9, 9])
    return zoo.plane(grid=grid, dynamics=dynamics, target=TargetSet((0,), near_zero), **changed)


def tidal(**changes):
    """dx = u + sin(3 t) + (1 + u^2 / 4) v, dy = cos(2 t) - v / 2, |v| <= 0.1 + 0.3 |u| + 0.2 t."""
    parts = {
        "inputs": [[-1.0], [0.0], [2.0]],
        "drift": lambda q, u, t: np.array([u[0] + np.sin(3 * t), np.cos(2 * t)]),
        "gain": lambda q, u: np.array([[1 + u[0] ** 2 / 4], [-0.5]]),
        "bounds": lambda q, u, t: [0.1 + 0.3 * abs(u[0]) + 0.2 * t],
    }
    return Dynamics(**parts | changes)


def tidal_extremes(u, begin, end):
    """Corners of what the state moves by under u from `begin` to `end`, integrated by hand."""
    length, reach = end - begin, (0.1 + 0.3 * abs(u)) * (end - begin) + 0.1 * (end**2 - begin**2)
    middle = np.array(
        [u * length + (math.cos(3 * begin) - math.cos(3 * end)) / 3, (math.sin(2 * end) - math.sin(2 * begin)) / 2]
    )
    spread = reach * np.array([1 + u**2 / 4, 0.5])
    return middle - spread, middle + spread


def turning(**changes):
    """A field that turns at the rate 1 + t, driven along x, the adversary pushing outwards with a slip of |u| / 2."""

    def drift(points, u, t):
        x, y = points.T
        return (1 + t) * np.stack([-y, x], axis=1) + np.array([u[0], 0.0])

    parts = {
        "inputs": [[0.0], [1.0]],
        "drift": drift,
        "gain": lambda points, t: points[:, :, None] * (1 + t),
        "bounds": lambda q, u: [0.2 + abs(u[0]) / 2],
    }
    return Dynamics(**parts | changes)


# ---- which arguments a function takes


class Field:
    def __init__(self):
        self.seen = []

    def __call__(self, points, t):
        return points * t

    def method(self, points, u):
        return points


def with_scale(points, u, scale=2.0):
    return scale * points


@pytest.mark.parametrize(
    ("name", "function", "takes"),
    [
        ("drift", lambda points, u, t: points, ("points", "u", "t")),
        ("drift", lambda points, u: points, ("points", "u")),
        ("drift", lambda whatever, t, u: u, ("points", "t", "u")),
        ("drift", lambda q: q, ("points",)),
        ("drift", with_scale, ("points", "u")),
        ("drift", lambda points, u, t=0.0: points, ("points", "u", "t")),
        ("drift", functools.partial(with_scale, scale=3.0), ("points", "u")),
        ("drift", functools.partial(lambda points, u, t: points, t=1.0), ("points", "u")),
        ("drift", Field(), ("points", "t")),
        ("drift", Field().method, ("points", "u")),
        ("drift", BlackBox(lambda q, u, t: q), ("points", "u", "t")),
        ("gain", lambda points: points, ("points",)),
        ("bounds", lambda t: [t], ("t",)),
        ("bounds", lambda q: q, ("points",)),
        ("bounds", lambda place, t: place, ("points", "t")),
        ("velocity", lambda q, u, v, t: q, ("points", "u", "v", "t")),
    ],
)
def test_functions_say_what_they_take(name, function, takes):
    assert arguments(name, function) == takes


def test_functions_are_called_with_what_they_name():
    """Once for each input, while the problem is made; afterwards nobody calls them."""
    calls = []

    def drift(q, t, u):
        calls.append(u.tolist())
        return [t, u[0]]

    given = Dynamics([[3.0], [4.0]], drift, lambda q, t: [[t], [1.0]], lambda q, u: [u[0] / 8])
    assert calls == []
    dynamics = problem_of(given).dynamics
    made = len(calls)
    assert {tuple(u) for u in calls} == {(3.0,), (4.0,)}
    points = np.array([[0.1, 0.2]])
    assert dynamics.drift_at(points, 1, 0.7).tolist() == [[0.7, 4.0]]
    assert dynamics.gain_at(np.zeros((3, 2)), 0, 0.25).tolist() == [[[0.25], [1.0]]] * 3
    assert dynamics.bounds_at(0, 9.0).tolist() == [0.375] and dynamics.bounds_at(1).tolist() == [0.5]
    assert len(calls) == made
    with pytest.raises(ValueError, match=r"\[3.0\]. problem.dynamics.drift_at\(points, j, t\)"):
        dynamics.drift(points, [3.0])


# ---- what is refused, when made and when read


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"drift": lambda p: p * np.nan}, r"\(nan\) at \[1.0, 1.0\]"),
        ({"drift": lambda p: np.log(p - 1)}, "is undefined or infinite"),
        ({"bounds": lambda t: [2.0 - t]}, r">= 0, got \[-0.5\]"),
        ({"bounds": lambda t: [np.sqrt(2.0 - t)]}, "bounds is undefined"),
        ({"bounds": lambda t: [np.nan]}, "bounds is undefined"),
        ({"drift": BlackBox(lambda q, u, t: q * np.nan)}, r"shape \(4, 2\), got"),
        ({"drift": BlackBox(lambda q, u: q[:, 0])}, r"shape \(4, 2\), got"),
        ({"gain": BlackBox(lambda q, u, t: q[:2])}, r"shape \(4, 2, 1\)"),
    ],
)
def test_values_that_are_none_are_refused_when_they_come(change, said):
    arrays = {"inputs": [[1.0]], "drift": [[1.0, 0.0]], "gain": [[1.0], [0.0]], "bounds": [0.1]}
    dynamics, points = Dynamics(**arrays | change).read(2), np.ones((4, 2))
    with pytest.raises(ValueError, match=said):
        dynamics.drift_at(points, 0, 2.5), dynamics.gain_at(points, 0, 2.5), dynamics.bounds_at(0, 2.5)


# ---- what depends on what


@pytest.mark.parametrize(
    ("change", "constant", "stateless", "timed", "shared_gain"),
    [
        ({}, True, True, False, True),
        ({"drift": lambda q, u: [u[0], 0.0]}, True, True, False, True),
        ({"drift": lambda q, u, t: [u[0], t]}, False, True, True, True),
        ({"drift": lambda points, u: points}, False, False, False, True),
        ({"gain": lambda points: points[:, :, None]}, False, False, False, True),
        ({"gain": lambda q, u: [[u[0]], [1.0]]}, True, True, False, True),  # of one input
        (
            {"gain": lambda q, u: [[u[0]], [1.0]], "inputs": [[1.0], [2.0]], "drift": np.eye(2)},
            False,
            True,
            False,
            False,
        ),
        ({"bounds": lambda t: [t]}, False, True, True, True),
        ({"bounds": lambda q, u, t: [t]}, False, True, True, True),
        (
            {"bounds": lambda q, u, t: [t * u[0]], "inputs": [[1.0], [2.0]], "drift": np.eye(2)},
            False,
            True,
            True,
            False,
        ),
        ({"bounds": lambda q: np.abs(q[:, :1])}, False, False, False, True),
        ({"drift": lambda points, u: points - points}, True, True, False, True),
        ({"drift": BlackBox(lambda q, u, t: q)}, False, False, True, True),
        ({"drift": BlackBox(lambda q, u, t: q, rate=0.0)}, False, False, False, True),
    ],
)
def test_what_velocities_depend_on(change, constant, stateless, timed, shared_gain):
    dynamics = Dynamics(
        **{"inputs": [[1.0]], "drift": [[1.0, 0.0]], "gain": [[1.0], [0.0]], "bounds": [0.1]} | change
    ).read(2)
    found = dynamics.constant, dynamics.stateless, dynamics.depends_on_time, dynamics.shared_gain
    assert found == (constant, stateless, timed, shared_gain) and dynamics.disturbance_dim == 1


READS = [  # dynamics on three axes; whether the velocity along axis i (row) depends on coordinate k (column)
    (lambda points, u: points[:, [1, 2, 2]], np.ones((3, 1)), [0.0], ["010", "001", "001"]),
    (lambda points, u: u[0] * points[:, [2, 0, 1]], np.ones((3, 1)), [0.1], ["001", "100", "010"]),
    (lambda points, u: 0 * points, lambda p: p[:, [2, 0, 0], None], [0.1], ["001", "100", "100"]),
    (lambda points, u: 0 * points, lambda p: p[:, [2, 0, 0], None], [0.0], ["000", "000", "000"]),
    (lambda points, u: 0 * points, lambda p, u: p[:, :, None] * (u[0] > 0), [0.1], ["100", "010", "001"]),
    (lambda points, t: points[:, [1, 2, 0]] * (t > 0.4), np.ones((3, 1)), [0.0], ["010", "001", "100"]),
    (lambda points, t: points[:, [1, 2, 0]] * (t > 0.7), np.ones((3, 1)), [0.0], ["010", "001", "100"]),
    (lambda points: points * 0, lambda p: p[:, [1, 2, 0], None], lambda t: [np.maximum(t, 0)], ["010", "001", "100"]),
    (lambda points: points * 0, np.ones((3, 1)), lambda q: q[:, 1:2] ** 2, ["010", "010", "010"]),
    (BlackBox(lambda q, u, t: q, reads=[2]), np.ones((3, 1)), [0.1], ["001", "001", "001"]),
    (BlackBox(lambda q, u, t: q), np.ones((3, 1)), [0.1], ["111", "111", "111"]),
]


@pytest.mark.parametrize(("drift", "gain", "bounds", "expected"), READS)
def test_which_coordinates_a_velocity_reads(drift, gain, bounds, expected):
    """At any time and under any input."""
    dynamics = Dynamics([[-1.0], [1.0]], drift, gain, bounds).read(3)
    interval = Interval(Grid([-1.0] * 3, [1.0] * 3, [5, 6, 7]), dynamics, 0.3, 0.3)
    assert ["".join("01"[int(one)] for one in row) for row in dynamics.reads] == expected
    for axes in itertools.chain.from_iterable(itertools.combinations(range(3), n) for n in (1, 2, 3)):
        closed = interval.self_contained(axes)
        assert set(axes) <= set(closed) and list(closed) == sorted(closed)
        assert not any(expected[i][k] == "1" for i in closed for k in range(3) if k not in closed)
        smaller = [set(c) for n in range(len(closed)) for c in itertools.combinations(closed, n) if set(axes) <= set(c)]
        assert all(any(expected[i][k] == "1" for i in c for k in range(3) if k not in c) for c in smaller)


def test_what_only_later_intervals_read_counts_for_the_avoid_game():
    """The third interval alone couples y to x: a wall in y then needs both axes, for every step the same ones."""
    drift = lambda p, t: np.stack([0 * p[:, 0], p[:, 0] * np.maximum(t - 0.65, 0.0)], axis=1)  # noqa: E731
    wall = UnsafeSet((1,), lambda p, t: 1.5 - p[:, 0])
    problem = problem_of(Dynamics([[1.0]], drift, [[1.0], [0.0]], [0.1]), unsafe=(wall,))
    assert [problem.interval(k).self_contained((1,)) for k in range(3)] == [(0, 1)] * 3
    assert Samples(problem).avoid_axes(wall.axes) == (0, 1) and problem.moves(wall) and not wall.moving


# ---- boxes of displacements: the Hopf-Lax formula and the controller's look-ahead


def test_constant_velocities_reach_boxes_in_closed_form():
    problem = zoo.torus_problem(nodes=8)
    interval, u = problem.interval(0), problem.inputs
    low, high = interval.displacement_boxes(0.05, 0.2)
    np.testing.assert_allclose(low, 0.15 * (u - 0.4), rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(high, 0.15 * (u + 0.4), rtol=0, atol=ROUNDING)
    corners = interval.reachable_boxes(np.ones((5, 2)))
    for corner, sign in zip(corners, (-1, 1), strict=True):
        np.testing.assert_allclose(corner, 0.2 * (u + sign * 0.4)[None], rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(interval.displacements(np.ones((5, 2))), 0.2 * u[None], rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("step", [0, 2])
def test_velocities_in_time_reach_boxes_in_closed_form(step):
    """Sines, cosines and a bound that grows with time and with |u|: Gauss's rule is exact to rounding for all of it."""
    interval = problem_of(tidal()).interval(step)
    for begin, end in ((0.0, 0.3), (0.1, 0.25), (0.2, 0.2)):
        corners = interval.displacement_boxes(begin, end)
        for j, u in enumerate([-1.0, 0.0, 2.0]):
            exact = tidal_extremes(u, interval.begin + begin, interval.begin + end)
            for corner, its in zip(corners, exact, strict=True):
                np.testing.assert_allclose(corner[j], its, rtol=0, atol=ROUNDING)
    low, high = interval.reachable_boxes(np.ones((4, 2)))
    assert low.shape == high.shape == (1, 3, 2)
    np.testing.assert_array_equal([low[0], high[0]], interval.displacement_boxes(0.0, 0.3))


def test_extremes_are_those_of_all_vertices():
    dynamics, t = tidal(gain=[[1.0, -2.0], [0.5, 1.0]], bounds=lambda q, u, t: [0.1 + t, abs(u[0])]), 0.37
    extremes = problem_of(dynamics).interval(1).extremes(t)
    for j, u in enumerate([-1.0, 0.0, 2.0]):
        drift = np.array([u + math.sin(3 * t), math.cos(2 * t)])
        vertices = np.array(list(itertools.product((-0.1 - t, 0.1 + t), (-abs(u), abs(u)))))
        velocities = drift + vertices @ np.array([[1.0, -2.0], [0.5, 1.0]]).T
        np.testing.assert_allclose(extremes[0, j], velocities.min(axis=0), rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(extremes[1, j], velocities.max(axis=0), rtol=0, atol=ROUNDING)


def test_boxes_hold_a_push_that_grows_within_the_interval():
    """dq = q / 10 + v, |v| <= 1/2 + 2 t: in 1/2 s from 0 as far as 1/4 + 1/4 and more, by the first push alone 1/4."""
    dynamics = Dynamics([[0.0]], lambda q, u: q / 10, [[1.0]], lambda t: [0.5 + 2 * t])
    interval = Interval(Grid([-9.0], [9.0], [9]), dynamics.read(1), 0.0, 0.5)
    low, high = interval.reachable_boxes(np.zeros((1, 1)))
    far = 0.5 * 10 * np.expm1(0.05) + 2 * 100 * (np.expm1(0.05) - 0.05)  # the integral of e^((1/2 - t) / 10) |v|
    assert far > 0.5 and high[0, 0, 0] >= far and low[0, 0, 0] <= -far


@pytest.mark.parametrize("begin", [0.0, 0.6])
def test_state_dependent_boxes_hold_what_the_adversary_can_do(begin, rng):
    """A field that turns: 400 paths of switching adversaries for each state and input, integrated by hand.

    The box takes the gain (1 + t) q at the start, which changes by at most 10 a second here: exact to second order.
    """
    delta, parts = 0.05, 50
    interval = Interval(Grid([-9.0, -9.0], [9.0, 9.0], [9, 9]), turning().read(2), begin, delta)
    states = rng.uniform(-1, 1, (6, 2))
    low, high = interval.reachable_boxes(states)
    assert low.shape == high.shape == (6, 2, 2)
    np.testing.assert_allclose((low + high) / 2, interval.displacements(states), rtol=0, atol=ROUNDING)
    for (j, u), (m, start) in itertools.product(enumerate([0.0, 1.0]), enumerate(states)):
        bound, q = 0.2 + u / 2, np.tile(start, (400, 1))
        pushes = rng.choice([-bound, bound], (parts // 10, 400, 1))
        for part in range(parts):
            pace, half = 1 + begin + (part + 0.5) * delta / parts, q
            for span in (delta / parts / 2, delta / parts):  # the midpoint rule
                turned = np.stack([-half[:, 1], half[:, 0]], axis=1) + half * pushes[part // 10]
                half = q + span * (pace * turned + [u, 0.0])
            q = half
        moved, slack = q - start, delta**2 / 2 * 10 * bound
        assert (moved >= low[m, j] - slack).all() and (moved <= high[m, j] + slack).all()
        assert (moved.min(axis=0) <= low[m, j] + slack).all() and (moved.max(axis=0) >= high[m, j] - slack).all()


def test_displacements_of_turning_fields_are_of_second_order():
    """The midpoint rule errs by a third power of the duration: half as long, an eighth of the error."""
    states, errors, durations = np.array([[0.7, -0.3], [0.2, 0.9]]), [], np.array([0.4, 0.2, 0.1])
    for duration in durations:
        interval = Interval(Grid([-9.0, -9.0], [9.0, 9.0], [9, 9]), turning().read(2), 0.5, duration)
        angle = duration + ((0.5 + duration) ** 2 - 0.5**2) / 2  # under input 0 the state turns about the origin
        turned = states @ np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
        errors.append(np.abs(interval.displacements(states)[:, 0] - (turned - states)).max())
    order = np.polyfit(np.log(durations), np.log(errors), 1)[0]
    print(f"fitted order of the displacements' error {order:.2f}")
    assert 2.7 < order < 3.4


# ---- the plant


def test_constant_velocities_move_on_lines_and_stop_at_walls():
    problem = sdhj.arm_case_study(nodes=7, steps=1)
    states = np.array([[0.1, 0.2, 0.0, 0.35], [3.1, -3.1, -0.36, 0.0]])
    v = np.array([[0.3, -0.3, 0.2, 0.2], [0.0, 0.0, -0.2, 0.1]])
    inputs = np.array([24, 0])  # (3, 3) and (-3, -3) rad/s
    after = problem.interval(0).advance(states, inputs, v, 0.0, 0.1)
    expected = [[0.1 + 0.33, 0.2 + 0.27, 0.02, 0.36], [3.1 - 0.3, -3.1 - 0.3, -0.36, 0.01]]
    np.testing.assert_allclose(after, expected, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(problem.grid.clipped(after), after)


def growth_problem():
    """dq = u q + v q: drift and gain depend on the state; q(t) = q(0) exp((u + v) t)."""
    dynamics = Dynamics([[-1.0], [1.0]], lambda p, u: u[0] * p, lambda p: p[:, :, None], [0.5])
    return zoo.line(grid=Grid([0.1], [9.0], [33]), dynamics=dynamics, target=zoo.goal(1.0, 0.2), delta=0.1)


def season_problem():
    """dq = u q cos t + v q (1 + t): q(t) = q(0) exp(u (sin t - sin t0) + v (t - t0 + (t^2 - t0^2) / 2))."""
    dynamics = Dynamics(
        [[-1.0], [1.0]],
        lambda p, u, t: u[0] * p * np.cos(t),
        lambda p, t: p[:, :, None] * (1 + t),
        lambda t: [0.5 + t],
    )
    return zoo.line(grid=Grid([0.1], [40.1], [401]), dynamics=dynamics, target=zoo.goal(1.0, 0.2), delta=0.1)


@pytest.mark.parametrize(
    ("make", "t0", "exact"),
    [
        (growth_problem, 0.0, 1.5 * math.exp((1.0 + 0.4) * 1.2)),
        (season_problem, 0.3, 1.5 * math.exp(math.sin(1.5) - math.sin(0.3) + 0.4 * (1.2 + (1.5**2 - 0.3**2) / 2))),
    ],
)
def test_curved_paths_are_integrated_to_fourth_order(make, t0, exact):
    problem, counts, errors = make(), np.array([4, 8, 16, 32]), []
    for count in counts:
        state, duration = np.array([[1.5]]), 1.2 / count
        for part in range(count):
            v = np.array([[0.4]])
            state = problem.interval(0).advance(state, np.array([1]), v, t0 + part * duration, duration)
        errors.append(abs(state[0, 0] - exact))
    order = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    print(f"fitted order of the plant {order:.2f}")
    assert 3.8 < order < 4.2


def test_a_car_turns_on_a_circle():
    """x = x0 + (sin(th0 + 2 t) - sin th0) / 2 + v1 t, and so on; 20 steps of 0.01 s are good to 1e-9."""
    interval = zoo.unicycle_problem().interval(0)
    start, v, t = np.array([[-0.3, 0.2, 0.4]]), np.array([[0.1, -0.05]]), 0.2
    turned = 0.4 + 2 * t
    east, north = (np.sin(turned) - np.sin(0.4)) / 2, (np.cos(0.4) - np.cos(turned)) / 2
    state = start
    for part in range(20):
        state = interval.advance(state, np.array([2]), v, part * t / 20, t / 20)
    np.testing.assert_allclose(state, start + np.array([[east + 0.1 * t, north - 0.05 * t, 2 * t]]), rtol=0, atol=1e-9)


def test_each_run_has_the_gain_and_the_bounds_of_its_own_input(rng):
    """Against one state at a time, the user's functions called by hand; periodic coordinates wrapped for them."""
    dynamics = Dynamics(
        [[-1.0], [0.5], [2.0]],
        lambda points, u, t: points * u[0] + t,
        lambda points, u, t: points[:, :, None] * np.array([1.0, u[0]]) + t,
        lambda q, u, t: [abs(u[0]), 0.5 + t],
    )
    grid = Grid([-1.0, -1.0], [1.0, 1.0], [8, 8], [True, False])
    interval, t = Interval(grid, dynamics.read(2), 0.2, 0.4), 0.3
    states, inputs = rng.uniform([1, -1], [3, 1], (20, 2)), rng.integers(0, 3, 20)
    gain, bounds = interval.gain(states, inputs, t), interval.bounds(inputs, t)
    drift = interval.undisturbed(states, inputs, t)
    moved = interval.advance(states, inputs, 0.1 * bounds, t, 1e-6)
    for m, (q, j) in enumerate(zip(states, inputs, strict=True)):
        inside, u = q - [2.0, 0.0], [-1.0, 0.5, 2.0][j]
        own = inside[:, None] * np.array([1.0, u]) + t
        np.testing.assert_allclose(gain[m], own, rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(bounds[m], [abs(u), 0.5 + t], rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(drift[m], inside * u + t, rtol=0, atol=ROUNDING)
        velocity = inside * u + t + own @ (0.1 * np.array([abs(u), 0.5 + t]))
        np.testing.assert_allclose((moved[m] - q) / 1e-6, velocity, rtol=0, atol=1e-5)
    with_array = Interval(grid, replace(dynamics, gain=np.eye(2)).read(2), 0.2, 0.4)
    np.testing.assert_array_equal(with_array.gain(states, inputs, t), np.tile(np.eye(2), (20, 1, 1)))


# ---- velocity sets on the grid, for the games


def supremum(field, p, index):
    """H of a velocity set at one node."""
    if zoo.ends_of(field)[0].ndim == 1:
        lower, upper = zoo.ends_of(field)
    else:
        lower, upper = (end[(..., *index)] for end in zoo.ends_of(field))
    if not field.coupled:
        return np.maximum(lower * p, upper * p).sum()
    drift, gain = (part[(..., *index)] if part.ndim > 3 else part for part in (field.drift, field.gain))
    assert (np.abs(drift[:, :, None] + gain).max(axis=(0, 2)) <= np.maximum(-lower, upper) + ROUNDING).all()
    return max(p @ f + np.abs(p @ b).sum() for f, b in zip(drift, gain, strict=True))


FIELDS = {
    "turning": (turning, [(0, 1), (0,), (1,)]),
    "two components that pull on both axes": (
        lambda: turning(gain=lambda points, u: np.stack([points, u[0] - points], axis=2), bounds=lambda t: [t, 0.3]),
        [(0, 1), (1,)],
    ),
    "one axis moved by the other": (
        lambda: turning(
            drift=lambda points, u, t: np.stack([t * points[:, 1] + u[0], 0 * points[:, 0]], axis=1),
            gain=np.eye(2),
            bounds=lambda q, u, t: [0.2 + t, abs(u[0])],
        ),
        [(0,), (0, 1), (1,)],
    ),
}


@pytest.mark.parametrize("t", [0.0, 0.45])
@pytest.mark.parametrize("name", FIELDS)
def test_velocity_sets_are_the_supremum_over_adversary_and_dropped_nodes(name, t, rng):
    """The slow twin tries every vertex of the box and every node of the axes that were left out, at that time."""
    make, subspaces = FIELDS[name]
    grid = Grid([-1.0, -1.5], [1.0, 1.5], [5, 6], [False, True])
    interval, nodes = Interval(grid, make().read(2), 0.0, 0.5), [grid.nodes(0), grid.nodes(1)]
    for axes, j in itertools.product(subspaces, (0, 1)):
        field = interval.velocities(j, axes, t)
        for index in itertools.product(*(range(grid.shape[axis]) for axis in axes)):
            p = rng.normal(size=len(axes))
            expected = naive.hamiltonian(
                nodes,
                axes,
                {axis: nodes[axis][i] for axis, i in zip(axes, index, strict=True)},
                p,
                lambda q, j=j: interval.dynamics.drift_at(q[None], j, t)[0],
                lambda q, j=j: interval.dynamics.gain_at(q[None], j, t)[0],
                interval.dynamics.bounds_at(j, t),
            )
            assert supremum(field, p, index) == pytest.approx(expected, abs=ROUNDING), (axes, j, index)


def test_velocity_sets_without_the_state_are_numbers():
    interval, t = problem_of(tidal()).interval(1), 0.37
    for j, u in enumerate([-1.0, 0.0, 2.0]):
        bound = 0.1 + 0.3 * abs(u) + 0.2 * t
        field, still = interval.velocities(j, (0, 1), t), interval.velocities(j, (0, 1), t, drift=False)
        drift, spread = np.array([u + math.sin(3 * t), math.cos(2 * t)]), bound * np.array([1 + u**2 / 4, 0.5])
        assert field.coupled and zoo.ends_of(field)[0].shape == (2,)  # one v moves both axes
        np.testing.assert_allclose(zoo.ends_of(field), [drift - spread, drift + spread], rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(zoo.ends_of(still), [-spread, spread], rtol=0, atol=ROUNDING)
        alone = interval.velocities(j, (1,), t)
        assert not alone.coupled
        np.testing.assert_array_equal(
            [zoo.ends_of(alone)[0][0], zoo.ends_of(alone)[1][0]],
            [zoo.ends_of(field)[0][1], zoo.ends_of(field)[1][1]],
        )


def test_velocity_sets_in_time_are_counted_back_from_the_end():
    problem = problem_of(tidal())
    field = HJIGames(Samples(problem), Scheme()).velocities(1, (0,), 2)
    for tau in (0.0, 0.1, 0.3):
        now = problem.interval(2).velocities(1, (0,), 0.9 - tau)
        np.testing.assert_allclose(zoo.ends_of(field(tau))[0], zoo.ends_of(now)[0], rtol=0, atol=ROUNDING)
    still = problem_of(tidal(drift=lambda q, u: [u[0], 0.0], bounds=[0.1]))
    fields = HJIGames(Samples(still), Scheme()).velocities(1, (0,), 2), still.interval(2).velocities(1, (0,))
    assert zoo.ends_of(fields[0])[1].tolist() == zoo.ends_of(fields[1])[1].tolist()


# ---- velocities that the disturbance enters as it likes


LINEAR = {
    "constant": (
        lambda q, u, v, t: np.stack([0 * q[:, 0] + u[0] + v[0], 0 * q[:, 1] + v[1] - 0.5 * v[0]], axis=1),
        lambda q, u, t: np.tile([u[0], 0.0], (len(q), 1)),
        lambda q, u, t: np.tile([[1.0, 0.0], [-0.5, 1.0]], (len(q), 1, 1)),
    ),
    "state, input and time": (
        lambda q, u, v, t: np.stack([u[0] * q[:, 1] * (1 + v[0]), (v[1] * q[:, 0] - v[0]) / (2 + t)], axis=1),
        lambda q, u, t: np.stack([u[0] * q[:, 1], 0 * q[:, 0]], axis=1),
        lambda q, u, t: np.stack(
            [u[0] * q[:, 1], 0 * q[:, 0], -1 / (2 + t) + 0 * q[:, 0], q[:, 0] / (2 + t)], axis=1
        ).reshape(-1, 2, 2),
    ),
    "where it blows": (
        lambda q, u, v, t: np.where(q[:, :1] > 0, q * u[0] + v * [1.0, 2.0], q * u[0] - v),
        lambda q, u, t: q * u[0],
        lambda q, u, t: np.where(q[:, :1, None] > 0, np.diag([1.0, 2.0]), -np.eye(2)),
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", LINEAR)
def test_a_velocity_that_is_linear_in_the_disturbance_is_a_drift_and_a_gain(name, rng):
    velocity, drift, gain = LINEAR[name]
    inputs, bounds = [[-1.0], [1.0]], [0.2, 0.3]
    one = problem_of(Dynamics(inputs, velocity=velocity, bounds=bounds))
    two = problem_of(Dynamics(inputs, drift, gain, bounds))
    points = rng.uniform(-2, 2, (50, 2))
    for j, t in itertools.product((0, 1), (0.0, 0.7)):
        u = np.array(inputs[j])
        np.testing.assert_allclose(one.dynamics.drift_at(points, j, t), drift(points, u, t), rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(one.dynamics.gain_at(points, j, t), gain(points, u, t), rtol=0, atol=ROUNDING)
    assert one.dynamics.depends_on_time == two.dynamics.depends_on_time
    assert (one.dynamics.reads == two.dynamics.reads).all()
    tables = [sdhj.solve(problem, progress=False) for problem in (one, two)]
    for start, within in itertools.combinations_with_replacement(range(4), 2):
        values = [table.values(start=start, within=within - start) for table in tables]
        np.testing.assert_allclose(*values, rtol=0, atol=1e-6)


BENT = {  # of two coordinates and two components
    "sine": lambda q, u, v, t: (u[0] + 0.5 * np.sin(3 * v[0]), u[1] + 0.5 * np.cos(q[:, 0]) * np.sin(v[1])),
    "square": lambda q, u, v, t: (u[0] + 0.3 * v[0] ** 2 - v[1], u[1] - 0.2 * v[1] ** 2),
    "product": lambda q, u, v, t: (u[0] + u[0] * v[0] * v[1], u[1] + q[:, 1] * v[0] * v[1] * (1 + t)),
    "size": lambda q, u, v, t: (u[0] - np.abs(v[0]) * q[:, 0], u[1] + np.maximum(v[0], v[1])),
}
COMMANDS = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
MOST = np.array([0.4, 0.3])  # of the disturbance


def bent(name, q, u, v, t):
    """The velocity in plain NumPy; u and v may be rows of numbers, one for each state."""
    return np.stack([0.0 * q[:, 0] + one for one in BENT[name](q, u, v, t)], axis=1)


def bent_dynamics(name):
    return Dynamics(COMMANDS, velocity=lambda q, u, v, t: bent(name, q, u, v, t), bounds=MOST)


@pytest.mark.parametrize("name", BENT)
def test_ranges_hold_whatever_the_disturbance(name, rng):
    """At points, in boxes of states and times, and of the boxes that a state can reach."""
    problem = problem_of(bent_dynamics(name))
    dynamics, interval, nodes = problem.dynamics, problem.interval(1), problem.grid.points()
    assert dynamics.gain is None and not dynamics.constant and not dynamics.couples((0, 1))
    low = rng.uniform(-2, 1.5, (200, 2))
    high = low + rng.uniform(0, 0.5, low.shape)
    for j, _ in itertools.product(range(4), range(20)):
        v, t, points = rng.uniform(-MOST, MOST), rng.uniform(0.3, 0.6), rng.uniform(low, high)
        v = np.where(rng.random(2) < 0.3, np.sign(v) * MOST, v)
        true = bent(name, points, COMMANDS[j], v, t)
        np.testing.assert_allclose(dynamics.velocity_at(points, j, v, t), true, rtol=0, atol=ROUNDING)
        least, greatest = dynamics.velocity_bounds(j, low, high, (0.3, 0.6))
        assert (least <= true).all() and (true <= greatest).all()
        ends = dynamics.extremes(points, j, t)
        assert (ends[:, 0] <= true).all() and (true <= ends[:, 1]).all()
        field, there = interval.velocities(j, (0, 1), t), bent(name, nodes, COMMANDS[j], v, t).T.reshape(2, 9, 9)
        lower, upper = (
            end.reshape(2, *end.shape[1:] or (1, 1)) for end in (zoo.ends_of(field)[0], zoo.ends_of(field)[1])
        )
        assert (lower <= there).all() and (there <= upper).all() and field.coupled == dynamics.is_cut


def bent_problem(name):
    """A boat that a wind pushes as `BENT` says; a buoy, and edges of the grid to stay within."""
    return zoo.plane(
        dynamics=bent_dynamics(name),
        target=zoo.goal(0.6, 0.0, 0.8),
        unsafe=(zoo.post(-0.7, -0.5, 0.25, name="buoy"),),
        delta=0.2,
        steps=4,
    )


@pytest.mark.parametrize("method", ["hji", sdhj.Certified(cells=(80, 80))], ids=["hji", "certified"])
@pytest.mark.parametrize("name", but_slow(BENT, "product"))
@pytest.mark.slow
def test_no_run_is_lost_to_a_disturbance_that_enters_as_it_likes(name, method, rng):
    """Plant and adversaries of the test's own: anywhere in its box or at corners, switching within the step."""
    table = sdhj.solve(bent_problem(name), method, progress=False)
    controller, states = sdhj.Controller(table), rng.uniform(-1.9, 1.9, (4000, 2))
    outside = ~table.contains(states, start=0, within=0)
    starts = states[outside & table.contains(states, start=0, within=4)]
    assert len(starts) > 150

    def velocity(q, u, signs, t):
        return bent(name, q, COMMANDS[np.maximum(u, 0)].T, (signs * MOST).T, t)

    for signs in (
        lambda q, u, t, end: rng.uniform(-1, 1, q.shape),
        lambda q, u, t, end: rng.choice([-1.0, 1.0], q.shape),
    ):
        outcomes = judge.play(
            lambda q, step: controller.choose(controller.batch(q, step)),
            velocity,
            signs,
            lambda q, t: np.hypot(q[:, 0] - 0.6, q[:, 1]) - 0.8,
            lambda q, t: np.minimum(np.hypot(q[:, 0] + 0.7, q[:, 1] + 0.5) - 0.25, 2.0 - np.abs(q).max(axis=1)),
            starts,
            delta=0.2,
            steps=4,
        )
        assert (outcomes == "reached").all(), starts[outcomes != "reached"]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["gain", "velocity"])
def test_bounds_that_depend_on_the_state_scale_the_disturbance(kind, rng):
    """As if the gain were larger where more is allowed; and outside of a strip nothing pushes at all."""

    def allowed(q, u, t):
        return np.stack([0.1 + q[:, 1] ** 2 * np.abs(u[0]), np.maximum(0.3 * t - q[:, 0], 0.0)], axis=1)

    def pushing(q, u, t):
        return np.eye(2) * allowed(q, u, t)[:, None]

    inputs, drift = [[-1.0], [0.5]], lambda q, u: np.stack([0 * q[:, 0] + u[0], 0 * q[:, 1]], axis=1)
    given = {
        "gain": Dynamics(inputs, drift, np.eye(2), allowed),
        "velocity": Dynamics(inputs, velocity=lambda q, u, v: drift(q, u) + v, bounds=allowed),
    }
    one, two = problem_of(given[kind]), problem_of(Dynamics(inputs, drift, pushing, [1.0, 1.0]))
    points = rng.uniform(-2, 2, (60, 2))
    for j, t in itertools.product((0, 1), (0.0, 0.4)):
        gain = one.dynamics.gain_at(points, j, t) * one.dynamics.bounds_at(j, t)
        np.testing.assert_allclose(np.abs(gain), pushing(points, np.array(inputs[j]), t), rtol=0, atol=ROUNDING)
    assert one.dynamics.depends_on_time and one.dynamics.reads.tolist() == [[False, True], [True, False]]
    for pair in zip(one.interval(1).reachable_boxes(points), two.interval(1).reachable_boxes(points), strict=True):
        np.testing.assert_allclose(*pair, rtol=0, atol=ROUNDING)
    tables = [sdhj.solve(problem, progress=False) for problem in (one, two)]
    np.testing.assert_allclose(*(table.values(start=0, within=3) for table in tables), rtol=0, atol=1e-6)


# ---- black boxes, and what becomes of functions


def decided(q, u, t):
    """The car's drift in a way that nothing can read, state by state."""
    return np.array([[math.cos(theta), math.sin(theta), u[0]] for _, _, theta in q.tolist()])


def disk(q, t):
    return np.array([math.hypot(x, y) - 0.5 for x, y in q.tolist()])


def pillar(q, t):
    return np.array([max(math.hypot(x - 0.8, y) - 0.2, -1.0) for x, y in q.tolist()])


def opaque_car():
    car = zoo.unicycle_problem(nodes=(13, 13, 12))
    gain = np.eye(3)[:, :2]
    return car, replace(
        car,
        dynamics=Dynamics(car.inputs, BlackBox(decided, reads=[2], rate=0.0), gain, [0.1, 0.1]),
        target=TargetSet((0, 1), BlackBox(disk, slope=1.0, rate=0.0)),
        unsafe=(UnsafeSet((0, 1), BlackBox(pillar, rate=0.0), name="pillar"),),
    )


@pytest.mark.parametrize("velocity", [lambda q, u, v: np.sqrt(v + 0 * q), lambda q, u, v: u / (v + 0.1 + 0 * q)])
def test_a_velocity_that_may_be_undefined_for_a_disturbance_is_refused(velocity):
    problem = zoo.line(
        grid=Grid([-1.0], [1.0], [15]), dynamics=Dynamics([[1.0]], velocity=velocity, bounds=[0.2]), delta=0.1
    )
    with pytest.raises(ValueError, match="velocity under input 0"):
        sdhj.solve(problem)


@pytest.mark.slow
def test_black_boxes_are_solved_and_simulated():
    car, opaque = opaque_car()
    assert opaque.time_invariant and opaque.dynamics.reads.tolist() == [[False, False, True]] * 3
    assert car.opaque == {} and opaque.opaque == {
        "drift": "a BlackBox with reads, rate",
        "target": "a BlackBox with slope, rate",
        "unsafe 0": "a BlackBox with rate",
    }
    known, table = (sdhj.solve(problem, progress=False) for problem in (car, opaque))
    for within in range(4):
        np.testing.assert_allclose(*(one.values(start=0, within=within) for one in (known, table)), rtol=0, atol=1e-5)
    reports = [sdhj.monte_carlo(sdhj.Controller(one), 200, "random", progress=False) for one in (known, table)]
    assert all(report.rate("reached") > 0.9 for report in reports)
    assert len(sdhj.simulate(sdhj.Controller(table), [-0.8, 0.0, 0.0], "worst").inputs) >= 1


def test_black_boxes_of_which_nothing_is_declared_are_taken_at_their_worst():
    wild = Dynamics([[1.0]], BlackBox(lambda q, u: q), BlackBox(lambda q: q[:, :, None]), [0.1]).read(3)
    assert wild.depends_on_time and wild.reads.all() and wild.pushes.all() and wild.couples((0, 1))
    with pytest.raises(ValueError, match="BlackBox without a slope"):
        wild.velocity_bounds(0, -np.ones((1, 3)), np.ones((1, 3)), (0.0, 0.0))
    problem = problem_of(Dynamics([[1.0]], BlackBox(lambda q, u: 0 * q + u[0]), [[1.0], [0.0]], [0.1]))
    assert "nothing" in problem.opaque["drift"]


@pytest.mark.parametrize(
    "make",
    [lambda: bent_problem("sine"), lambda: opaque_car()[1]],
    ids=["sine", "black boxes"],
)
def test_problems_pickle(make, rng):
    """Functions that nobody could pickle are not in them; black boxes are, if they can be."""
    problem = make()
    again = pickle.loads(pickle.dumps(problem))
    assert again.digest == problem.digest and again.opaque == problem.opaque
    points = rng.uniform(problem.grid.lower, problem.grid.upper, (20, problem.grid.ndim))
    v, inputs = 0.1 * np.ones((20, problem.dynamics.disturbance_dim)), rng.integers(0, len(problem.inputs), 20)
    moved = [one.interval(0).advance(points, inputs, v, 0.1, 0.1) for one in (problem, again)]
    np.testing.assert_array_equal(*moved)
    np.testing.assert_array_equal(problem.unsafe_value(points, 0.3), again.unsafe_value(points, 0.3))


def test_what_changes_after_a_problem_was_made_changes_nothing():
    scale, table = [1.0], np.array([0.5, 0.5])

    def drift(q, u):
        return scale[0] * q + u[0] * table

    problem = problem_of(
        Dynamics([[1.0]], drift, [[1.0], [0.0]], lambda t: [0.1 * scale[0]]),
        unsafe=(UnsafeSet((0,), lambda p, t: p[:, 0] + 3.0 * scale[0]),),
    )
    points, before = np.array([[0.2, -0.4]]), problem.digest
    scale[0], table[:] = 5.0, -1.0
    np.testing.assert_allclose(problem.dynamics.drift_at(points, 0), [[0.7, 0.1]], rtol=0, atol=ROUNDING)
    assert problem.dynamics.bounds_at().tolist() == [0.1]
    assert problem.unsafe_value(points, 0.0).tolist() == [3.2]
    assert problem.digest == before != problem_of(Dynamics([[1.0]], drift, [[1.0], [0.0]], [0.5])).digest


def test_a_callable_that_has_a_function_is_called_itself():
    """Not the function that it happens to keep under that name."""

    class Wind:
        function = staticmethod(lambda one, two, three, four: None)

        def __call__(self, q, u):
            return u + 0.0 * q

    dynamics = sdhj.Dynamics([[0.5]], Wind(), [[1.0]], [0.1])
    assert dynamics.read(1).drift_at(np.array([[2.0]]), 0).tolist() == [[0.5]]
