"""Adversaries: what each plays at a moment, and what one of your own is told and allowed."""

import itertools
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import zoo

import sdhj
from sdhj.simulation.adversaries import ADVERSARIES, Moment, greedy, level_of_unsafe
from sdhj.simulation.runs import SUBSTEPS, admissible_states, monte_carlo, simulate
from sdhj.table.controller import Controller


def moment(controller: Controller, states: np.ndarray, **changes: object) -> Moment:
    """The start of the first interval under input 0, with one step to go after it."""
    problem = controller.problem
    within = np.ones(len(states), dtype=int)
    standard = {
        "problem": problem,
        "states": states,
        "inputs": np.zeros(len(states), dtype=int),
        "steps_to_go": np.full(len(states), 2),
        "step": 0,
        "substep": 0,
        "time": 0.0,
        "remaining": problem.delta,
        "duration": problem.delta / SUBSTEPS,
        "previous": np.zeros((len(states), problem.dynamics.disturbance_dim)),
        "runs": np.arange(len(states)),
        "tube": lambda points: controller.table.values_at(points, 1, within),
        "rng": np.random.default_rng(1),
    }
    return Moment(**(standard | changes))


def test_random_is_constant_over_an_interval_and_fills_its_box() -> None:
    drawn = []

    def watch(m: Moment) -> np.ndarray:
        drawn.append((m.substep, ADVERSARIES["random"](m)))
        return drawn[-1][1]

    monte_carlo(Controller(zoo.interval_table()), 500, watch, progress=False)
    starts = [place for place, (substep, _) in enumerate(drawn) if substep == 0]
    assert len(starts) >= 3
    for place in starts:
        v = drawn[place][1]
        assert all((later == v).all() for _, later in drawn[place : place + SUBSTEPS])
        assert len(np.unique(v)) == len(v)
    first = drawn[0][1]
    assert np.abs(first).max() <= 0.2
    assert first.min() < -0.18 and first.max() > 0.18  # 500 uniform draws miss a tenth of the box with chance 1e-11


def drone() -> sdhj.ReachAvoidProblem:
    """It flies at 12 m/s in gusts of 3, and keeps 300 m from an aircraft of 50 m/s, from which it is seen."""
    turn = np.arange(16) * np.pi / 8
    inputs = np.vstack([[0.0, 0.0], 12 * np.stack([np.cos(turn), np.sin(turn)], axis=1)])
    return zoo.plane(
        inputs,
        3.0,
        drift=inputs - np.array([50.0, 0.0]),
        lower=[-600, -800],
        upper=[1800, 800],
        nodes=[61, 41],
        ends="safe",
        target=None,
        unsafe=[zoo.post(0.0, 0.0, 300.0, name="aircraft")],
        delta=1.0,
        steps=2,
    )


def test_greedy_takes_the_vertex_that_comes_nearest(rng: np.random.Generator) -> None:
    controller = Controller(sdhj.solve(drone(), progress=False))
    q, u = rng.uniform([300, -400], [900, 400], (200, 2)), rng.integers(0, 17, 200)
    now = moment(controller, q, inputs=u)
    found, signs = greedy(now), np.array(list(itertools.product((-1.0, 1.0), repeat=2)))
    assert (np.abs(found) == 3.0).all()
    velocities = controller.problem.inputs[u] - np.array([50.0, 0.0])  # straight, and nearer all the time
    least = np.min([np.hypot(*(q + velocities + 3.0 * sign).T) for sign in signs], axis=0)
    np.testing.assert_allclose(np.hypot(*(q + velocities + found).T), least, rtol=0, atol=1e-9)
    later = replace(now, substep=2, previous=-found)
    np.testing.assert_array_equal(greedy(later), -found)  # it decides at every fourth substep


@pytest.mark.parametrize("way", [-1.0, 1.0])
def test_greedy_looks_at_sets_where_they_are_when_it_comes_there(way: float) -> None:
    """To one side of the robot something appears just before the end of the interval."""
    late = sdhj.UnsafeSet((0,), lambda p, t: np.where(t > 0.45, np.abs(p[:, 0] - way) - 0.1, 5.0))
    controller = Controller(sdhj.solve(zoo.line(ends="wall", unsafe=[late]), progress=False, play=False))
    held = np.ones(1, dtype=int)
    assert controller.problem.inputs[1] == 0.0
    assert greedy(moment(controller, np.zeros((1, 1)), inputs=held)).tolist() == [[0.2 * way]]


def test_what_is_nearest_is_a_set_or_an_unsafe_end() -> None:
    assert level_of_unsafe(drone(), np.array([[2000.0, 0.0]]), 0.0, np.array([0])) == np.inf
    joint = zoo.cart(
        grid=sdhj.Grid([-1, -2], [1, 2], [21, 21], ends=["unsafe", "wall"]),
        dynamics=sdhj.Dynamics([[0.0]], [[0.0, 0.0]]),
        steps=1,
    )
    near = level_of_unsafe(joint, np.array([[0.75, 0.0], [-1.5, 0.0]]), 0.0, np.array([0, 0]))
    np.testing.assert_allclose(near, [0.25, -0.5])


def test_aggressive_takes_the_vertex_that_lowers_the_distance_most() -> None:
    controller = Controller(zoo.torus_table())
    problem = controller.problem
    states = np.random.default_rng(4).uniform(-np.pi, np.pi, (200, 2))
    now = moment(controller, states)
    v = ADVERSARIES["aggressive"](now)
    distance = {
        signs: problem.unsafe_value(states + now.duration * 0.4 * np.array(signs), now.time)
        for signs in itertools.product((-1, 1), repeat=2)
    }
    chosen = problem.unsafe_value(states + now.duration * v, now.time)
    # trials move one component at a time: off by second order, for steps of 0.004 on circles of radius 0.1 and more
    near = np.hypot(*zoo.wrapped(states - [1.0, 0.0]).T) > 0.1
    assert (chosen <= np.minimum.reduce(list(distance.values())) + 0.004**2 / 0.1)[near].all()
    assert near.sum() > 190


def test_the_nearest_set_rules_what_it_is_affected_by(rng: np.random.Generator) -> None:
    """The disturbance of the joints pushes towards what is nearer; the pursuer always closes in."""
    problem = sdhj.arm_case_study(nodes=9, steps=1)
    controller = Controller(sdhj.solve(problem, "lax", progress=False))
    states = rng.uniform(problem.grid.lower, problem.grid.upper, (300, 4))
    now = moment(controller, states)
    values, changes = [], []
    for part in problem.unsafe:
        value = part.level_set(states[:, part.axes], 0.0)
        trials = [
            states + now.duration * bound * e for bound, e in zip(problem.dynamics.bounds_at(), np.eye(4), strict=True)
        ]
        values.append(value)
        changes.append([part.level_set(trial[:, part.axes], 0.0) - value for trial in trials])
    nearest, pursuer = np.argmin(values, axis=0), len(problem.unsafe) - 1
    signs = -np.sign(np.array(changes))  # (parts, D, M)
    v = ADVERSARIES["aggressive"](now) / problem.dynamics.bounds_at()
    everyone = np.arange(300)
    felt = signs[nearest, 0, everyone] != 0
    np.testing.assert_array_equal(v[felt, 0], signs[nearest, 0, everyone][felt])
    assert (felt & (signs[pursuer, 0] != signs[nearest, 0, everyone])).sum() > 20  # where the two pull apart
    np.testing.assert_array_equal(v[:, 2:], signs[pursuer, 2:].T)


def test_worst_takes_the_vertex_with_the_worst_score() -> None:
    """Scores of all four vertices: a tube's level or the distance to the first order in v, each the larger of some."""
    controller = Controller(zoo.torus_table())
    problem, end = controller.problem, controller.problem.delta
    states = admissible_states(controller, 100, np.random.default_rng(2))

    def level(points: np.ndarray) -> np.ndarray:
        return -2.0 + np.sin(points[..., 0] + 2.0 * points[..., 1])

    v = ADVERSARIES["worst"](moment(controller, states, tube=level))
    vertices = [0.4 * np.array(signs) for signs in itertools.product((-1.0, 1.0), repeat=2)]
    middle = states + end * problem.dynamics.arrays[0][0]
    distance = problem.unsafe_value(middle, end)
    slopes = [problem.unsafe_value(middle + end * 0.4 * e, end) - distance for e in np.eye(2)]
    levels = np.array([level(middle + end * vertex) for vertex in vertices])
    danger = -np.array([distance + sum(s * np.sign(x) for s, x in zip(slopes, row, strict=True)) for row in vertices])
    scores = np.maximum(levels, danger)
    played = [int(np.flatnonzero([(row == vertex).all() for vertex in vertices])[0]) for row in v]
    np.testing.assert_allclose(scores[played, np.arange(100)], scores.max(axis=0), rtol=0, atol=1e-12)
    assert len(set(played)) == 4 and 0.2 < (levels > danger).mean() < 0.8


@cache
def slipping_controller() -> Controller:
    """The torus with a second component of v that grows with the input and a box that shrinks with time."""
    problem = zoo.torus_problem(nodes=16)
    dynamics = sdhj.Dynamics(
        problem.inputs,
        problem.inputs,
        gain=lambda q, u: np.array([[1.0, 0.0], [0.5, 1.0 + abs(u[0])]]),
        bounds=lambda q, u, t: [0.2 + 0.1 * abs(u[1]), 0.4 - 0.6 * t],
    )
    return Controller(sdhj.solve(replace(problem, dynamics=dynamics), "lax", progress=False))


def test_each_run_is_pushed_as_its_own_input_allows(rng: np.random.Generator) -> None:
    """The worst vertex by trying each of them, run by run, with that input's gain and bounds at that time."""
    controller, time = slipping_controller(), 0.1
    problem, signs = controller.problem, np.array(list(itertools.product((-1.0, 1.0), repeat=2)))
    states, inputs = rng.uniform(-np.pi, np.pi, (60, 2)), rng.integers(0, 9, 60)
    now = moment(controller, states, inputs=inputs, time=time, remaining=problem.delta - time)
    worst, aggressive, left = ADVERSARIES["worst"](now), ADVERSARIES["aggressive"](now), problem.delta - time
    table = controller.table.values(start=1, within=1)
    for m, j in enumerate(inputs):
        u = problem.inputs[j]
        bounds = np.array([0.2 + 0.1 * abs(u[1]), 0.4 - 0.6 * time])
        np.testing.assert_allclose(np.abs(worst[m]), bounds, rtol=0, atol=1e-15)
        np.testing.assert_allclose(np.abs(aggressive[m]), bounds, rtol=0, atol=1e-15)
        gain, middle = np.array([[1.0, 0.0], [0.5, 1.0 + abs(u[0])]]), states[m] + left * u
        trials = middle + np.vstack([np.zeros(2), left * (gain * bounds).T])  # each component of v at its bound
        values = problem.unsafe_value(trials, problem.delta)
        clearance, changes = values[0], values[1:] - values[0]
        scores = []
        for sign in signs:
            tube = problem.grid.interpolate(table, middle[None] + left * gain @ (sign * bounds))[0]
            scores.append(max(tube, -(clearance + sign @ changes)))
        played = int(np.flatnonzero((signs == np.sign(worst[m])).all(axis=1))[0])
        assert scores[played] == pytest.approx(max(scores), abs=1e-12)


def test_an_interval_ends_when_that_is_worst() -> None:
    """Of a tube from which the state is led away late, of one to which it is led early; of equals at the earliest."""
    problem = replace(zoo.interval_problem(), sensing=sdhj.Sensing(jitter=0.1))
    controller = Controller(sdhj.solve(problem, progress=False, play=False))
    inputs = np.array([int(np.flatnonzero(problem.inputs[:, 0] == one)[0]) for one in (1.0, -1.0, 0.0)])
    for name in ("worst", "greedy", "aggressive"):
        for way, expected in ((1.0, [1, -1]), (-1.0, [-1, 1])):
            seen = moment(
                controller, np.zeros((3, 1)), inputs=inputs, tube=lambda points, way=way: way * points[..., 0]
            )
            assert ADVERSARIES[name].shift(seen)[:2].tolist() == expected
        calm = replace(problem, dynamics=problem.dynamics.undisturbed())
        assert ADVERSARIES[name].shift(replace(seen, problem=calm))[2] == -1
    assert ADVERSARIES["none"].shift(seen).tolist() == [0, 0, 0]


def test_random_stays_within_a_box_that_shrinks() -> None:
    """From a bound of 0.4 to 0.28 within the first interval: what was drawn is kept as far as the box allows."""
    run = simulate(slipping_controller(), [-2.4, 0.3], "random", seed=2)
    bounds = 0.4 - 0.6 * run.times[:-1]
    assert len(run.inputs) and (np.abs(run.disturbances[:, 1]) <= bounds + 1e-12).all()
    for k in range(len(run.inputs)):
        held = run.disturbances[k * SUBSTEPS : (k + 1) * SUBSTEPS, 1]
        own = bounds[k * SUBSTEPS : (k + 1) * SUBSTEPS]
        np.testing.assert_allclose(held, np.clip(held[0], -own, own), rtol=0, atol=1e-12)


def test_worst_takes_the_least_clearance_where_the_tube_tells_nothing() -> None:
    """A certified table counts whole steps, so that all vertices may leave the robot equally well off."""
    controller = Controller(zoo.torus_table())
    states = admissible_states(controller, 100, np.random.default_rng(2))
    now = moment(controller, states, tube=lambda points: np.zeros(points.shape[:2]))
    problem, end = controller.problem, controller.problem.delta
    middle = now.predicted()
    assert (problem.unsafe_value(middle, end) > 2 * end * 0.4).all()  # no vertex collides, so the tube decides
    v = ADVERSARIES["worst"](now)
    slopes = [problem.unsafe_value(middle + end * 0.4 * e, end) - problem.unsafe_value(middle, end) for e in np.eye(2)]
    felt = np.abs(slopes) > 1e-12
    np.testing.assert_array_equal(np.sign(v.T)[felt], -np.sign(slopes)[felt])
    assert felt.mean() > 0.9 and len(np.unique(v, axis=0)) >= 3


@pytest.mark.slow
def test_worst_may_switch_within_an_interval() -> None:
    controller = Controller(zoo.arm_table())
    starts = admissible_states(controller, 40, np.random.default_rng(5))
    switches = 0
    for q in starts:
        run = simulate(controller, q, "worst")
        for k in range(len(run.inputs)):
            held = run.disturbances[k * SUBSTEPS : (k + 1) * SUBSTEPS]
            assert (np.abs(held) == controller.problem.dynamics.bounds_at()).all()  # always a vertex
            switches += int((np.diff(held, axis=0) != 0).any())
    assert switches > 0


def test_own_adversary_is_told_everything_and_kept_to_its_box() -> None:
    controller = Controller(zoo.interval_table())
    seen: list[Moment] = []

    def mine(m: Moment) -> np.ndarray:
        seen.append(m)
        return np.full((len(m.states), 1), 0.1)

    run = simulate(controller, [-2.0], mine)
    assert (run.disturbances == 0.1).all()
    assert [m.substep for m in seen[:SUBSTEPS]] == list(range(SUBSTEPS))
    last = seen[SUBSTEPS - 1]
    assert last.time + last.duration == pytest.approx(0.5) and last.remaining == pytest.approx(last.duration)
    assert seen[0].inputs.tolist() == [run.inputs[0]] and seen[1].previous.tolist() == [[0.1]]
    np.testing.assert_allclose(seen[0].predicted(), [[-1.5]])
    assert seen[0].tube(np.array([[[-1.5]]]))[0, 0] == pytest.approx(0.5 - 2 * 0.4)  # |q| - 1 two steps earlier

    for bad, message in (
        (lambda m: np.zeros(3), r"shape \(1, 1\), got \(3,\)"),
        (lambda m: np.full((1, 1), 0.3), r"within \+-\[0.2\]"),
        (lambda m: np.full((1, 1), np.nan), "finite"),
    ):
        with pytest.raises(ValueError, match=message):
            simulate(controller, [-2.0], bad)
