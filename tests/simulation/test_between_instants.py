"""Collisions between the twenty instants of an interval, with something that is faster than the robot."""

from dataclasses import replace

import numpy as np
import pytest
import zoo

import sdhj
from sdhj.simulation.adversaries import SUBSTEPS, first_moment
from sdhj.simulation.outcomes import COLLIDED, OFF, UNDECIDED, _fast_sets, play_interval


def room(speed=20.0, radius=0.15, *, height=0.0, periodic=False):
    """A robot of 1 m/s, and a ball of so many m/s along the first axis, at (-1.5, height) when t = 0."""

    def ball(p, t):
        x = p[:, 0] + 1.5 - speed * t
        x = (x + 2.0) % 4.0 - 2.0 if periodic else x
        return np.hypot(x, p[:, 1] - height) - radius

    steps = [[0.0, 0.0], [0.0, 1.0], [0.0, -1.0]]
    return zoo.plane(
        steps,
        0.05,
        grid=sdhj.Grid([-2.0, -2.0], [2.0, 2.0], [21, 21], periodic=[periodic, False]),
        target=sdhj.TargetSet((0, 1), lambda p, t: 1.5 - p[:, 1]),
        unsafe=[sdhj.UnsafeSet((0, 1), ball)],
        delta=0.25,
        steps=2,
    )


def begin(problem, starts, inputs):
    table = sdhj.solve(replace(problem, unsafe=()), play=False)
    count = len(starts)
    given = starts, inputs, np.ones(count, np.int64), 0, 0.0, np.arange(count), np.random.default_rng(0)
    return first_moment(table, problem, *given)


def outcomes(problem, starts, inputs):
    return play_interval(begin(problem, starts, inputs), lambda m: np.zeros_like(m.previous), None)[1]


@pytest.mark.parametrize(("speed", "radius", "fast"), [(1.0, 0.15, False), (4.0, 0.15, True), (4.0, 0.6, False)])
def test_what_leads_past_a_quarter_of_its_depth_in_a_substep_is_fast(speed, radius, fast):
    """A ball and a robot of 1 m/s, 12.5 ms: (speed + 1.1) / 80 m of `radius`."""
    assert ((speed + 1.1) / 80 > 0.25 * radius) == fast
    begun = begin(room(speed, radius), np.zeros((1, 2)), np.zeros(1, np.int64))
    assert [one.name for one in _fast_sets(begun)] == ["unsafe"] * fast


@pytest.mark.parametrize("periodic", [False, True])
def test_who_is_passed_by_is_seen_by_a_closed_form(periodic, rng):
    """The ball leads 5 m in an interval, past all that begins at rest near its line: hit where |y| is at most r."""
    starts = np.column_stack([rng.uniform(-1.0, 1.9, 400), rng.uniform(-0.3, 0.3, 400)])
    found = outcomes(room(periodic=periodic), starts, np.zeros(400, np.int64))
    hit, sure = np.abs(starts[:, 1]) <= 0.15, np.abs(np.abs(starts[:, 1]) - 0.15) > 1e-3
    assert np.array_equal((found == COLLIDED)[sure], hit[sure]) and hit.sum() > 100
    # the instants alone miss most of these
    at = np.linspace(0.0, 0.25, SUBSTEPS + 1)
    near = np.hypot(starts[:, :1] + 1.5 - 20.0 * at, starts[:, 1:]).min(axis=1) <= 0.15
    assert periodic or near.sum() < 0.95 * hit.sum()


def test_what_is_behind_a_seam_is_met_there(rng):
    """By robots of 10 m/s; the level sets of the posts are written for coordinates from -2 to 2 m alone."""
    inputs, way = [[10.0], [-10.0]], np.repeat([0, 1], 100)
    problem = zoo.line(
        np.ravel(inputs),
        0.0,
        grid=sdhj.Grid([-2.0], [2.0], [41], [True]),
        unsafe=[zoo.post(-1.94, 0.02), zoo.post(1.94, 0.02)],
        delta=0.25,
    )
    starts = np.where(way == 0, 1.0, -1.0)[:, None] * rng.uniform(1.965, 1.999, (200, 1))
    assert (outcomes(problem, starts, way) == COLLIDED).all()
    at = starts - 2.0 * np.sign(starts) + np.array([[10.0], [-10.0]])[way] * np.linspace(0.0, 0.25, SUBSTEPS + 1)
    assert (np.abs(np.abs(at) - 0.06) <= 0.02).any(axis=1).mean() < 0.5  # what 20 instants see


def test_what_moves_too_is_judged_where_it_is(rng):
    """Against 4,000 instants, of robots that move across."""
    starts = np.column_stack([rng.uniform(-1.0, 1.9, 300), rng.uniform(-0.5, 0.3, 300)])
    found = outcomes(room(radius=0.1), starts, np.ones(300, np.int64))
    at = np.linspace(0.0, 0.25, 4001)
    distance = np.hypot(starts[:, :1] + 1.5 - 20.0 * at, starts[:, 1:] + at).min(axis=1)
    sure = np.abs(distance - 0.1) > 1e-3
    assert np.array_equal((found == COLLIDED)[sure], (distance <= 0.1)[sure]) and (found == UNDECIDED).any()


@pytest.mark.parametrize(("box", "seen"), [({"slope": 1.0, "rate": 20.0}, True), ({"slope": 1.0}, False)])
def test_a_black_box_that_declares_enough_is_judged_too(box, seen):
    starts = np.array([[-1.375, 0.0]])  # between two instants of a small ball
    problem = room(radius=0.05)
    object.__setattr__(problem.unsafe[0], "level_set", sdhj.BlackBox(problem.unsafe[0].level_set, **box))
    assert (outcomes(problem, starts, np.zeros(1, np.int64))[0] == COLLIDED) == seen


def test_of_the_collisions_of_many_runs_all_are_counted():
    """Against a plant of 2,000 instants an interval, of a controller whose table knows nothing of the ball."""
    problem = room(radius=0.1, height=1.25)
    blind = sdhj.solve(replace(problem, unsafe=()), play=False, progress=False)
    controller = sdhj.Controller(replace(blind, problem=problem))
    report = sdhj.monte_carlo(controller, runs=800, adversary="none", progress=False)
    q, nearest, at_instants = report.starts.copy(), np.full(800, np.inf), np.full(800, np.inf)
    for step in range(2):
        going, t = q[:, 1] < 1.5, 0.25 * (step + np.linspace(0.0, 1.0, 2001))
        u = np.where(going[:, None], problem.inputs[controller.choose(controller.batch(q, step))], 0.0)
        x, y = (q[:, axis, None] + u[:, axis, None] * (t - 0.25 * step) for axis in (0, 1))
        distance = np.where(going[:, None], np.hypot(x + 1.5 - 20.0 * t, y - 1.25), np.inf)
        nearest = np.minimum(nearest, distance.min(axis=1))
        at_instants = np.minimum(at_instants, distance[:, :: 2000 // SUBSTEPS].min(axis=1))
        q = q + 0.25 * u
    sure = np.abs(nearest - 0.1) > 1e-3
    hit, counted = nearest <= 0.1, report.outcomes == COLLIDED
    assert np.array_equal(counted[sure], hit[sure]) and hit.sum() > 50
    assert (at_instants <= 0.1).sum() < 0.8 * hit.sum()  # what 20 instants see


@pytest.mark.parametrize("inputs", [None, [0]])
def test_no_run_begins_in_a_set_that_is_unsafe_under_all_inputs(inputs):
    """Whatever the tubes say, which know of none here."""
    problem = zoo.line()
    blind = sdhj.solve(problem, play=False, progress=False)
    part = replace(zoo.post(0.0, 0.5), inputs=inputs)
    controller = sdhj.Controller(replace(blind, problem=replace(problem, unsafe=[part])))
    starts = sdhj.monte_carlo(controller, runs=500, adversary="none", progress=False).starts
    assert (np.abs(starts[:, 0]) <= 0.5).any() == (inputs is not None)


def test_who_meets_a_set_in_the_instant_in_which_he_leaves_the_grid_has_collided():
    """At 1 m/s, past the end at 4 m; the other one leaves at the end where no set is."""
    cliff = sdhj.UnsafeSet((0,), lambda p, t: 4.0 - p[:, 0])
    problem = zoo.line([1.0, -1.0], 0.0, unsafe=[cliff])
    assert outcomes(problem, np.array([[3.99], [-3.99]]), np.array([0, 1])).tolist() == [COLLIDED, OFF]


def test_a_run_stops_where_it_has_left_the_grid():
    """dx = 40 x^3 from .9 passes the end at 1 at once, and every number soon; the other run goes on to the end."""
    dynamics = sdhj.Dynamics([[0.0]], lambda q, u: 40.0 * q**3 + u, np.eye(1), [0.1])
    problem = zoo.line(grid=sdhj.Grid([-1.0], [1.0], [21]), dynamics=dynamics, target=None, delta=0.25, steps=2)
    seen = []
    states, ended, _ = play_interval(
        begin(problem, np.array([[0.0], [0.9]]), np.zeros(2, np.int64)),
        lambda moment: np.zeros_like(moment.previous),
        lambda moment, v, q, clearance: seen.append(q[:, 0]),
    )
    assert ended.tolist() == [UNDECIDED, OFF] and len(seen) == SUBSTEPS
    off = [own for _, own in seen if own > 1.0]
    assert len(off) > SUBSTEPS // 2 and set(off) == {states[1, 0]} and states[1, 0] < 1e3
