"""Problems without a target, and without a number of steps: closed forms, and runs judged without the library."""

from dataclasses import replace

import judge
import numpy as np
import pytest
from zoo import cart, interval_problem, line, post, raft

import sdhj
from sdhj import HJI, Controller, Dynamics, Grid, HopfLax, Projected, UnsafeSet
from sdhj.certified.sets import Certified
from sdhj.solver.joint import Joint

BRAKE, DELTA = 3.0, 0.1
INPUTS = np.array([[-BRAKE], [0.0], [BRAKE]])


def double_integrator(steps=None, disturbance=0.0, nodes=(51, 51)):
    """A cart that must stay on |x| <= 1; |v| <= 4 is more than it can brake from."""
    grid = Grid([-1.0, -4.0], [1.0, 4.0], nodes, names=["x", "v"])
    return cart(INPUTS, disturbance, grid=grid, steps=steps)


def too_far(states, disturbance=0.0):
    """How far beyond |x| = 1 full brakes end, <= 0 in the viability kernel.

    Sampling costs nothing: brakes held beyond the standstill move the cart away from the end that it came near.
    """
    x, v = states.T
    way = v**2 / (2 * (BRAKE - disturbance))
    return np.maximum(x + np.where(v > 0, way, 0), -x + np.where(v < 0, way, 0)) - 1


def test_the_viability_kernel_of_the_double_integrator():
    """Wrong only within a cell of the boundary, where the slopes of `too_far` are 1 and v / brake."""
    disturbance, shares = 0.6, []
    for nodes in (51, 101):
        table = sdhj.solve(double_integrator(25, disturbance, (nodes, nodes)), progress=False)
        exact = too_far(table.grid.points(), disturbance)
        inside = table.values(start=0, within=25).ravel() <= 0
        cell = table.grid.spacing[0] + table.grid.spacing[1] * np.sqrt(2 * 2 / (BRAKE - disturbance))
        assert np.abs(exact[inside != (exact <= 0)]).max(initial=0.0) < cell
        shares.append(np.mean(inside != (exact <= 0)))
    assert shares[1] < 0.7 * shares[0] and shares[1] < 0.03


def judged(table, starts, disturbance, rng, steps=100, *, first=0):
    """How runs end on the true cart, asked for step `first` each time (None: the run's); colliding is |x| > 1."""
    controller = Controller(table)

    def velocity(states, inputs, signs, t):
        return np.stack([states[:, 1], INPUTS[np.maximum(inputs, 0), 0] + disturbance * signs[:, 0]], axis=1)

    return judge.play(
        lambda states, step: controller.choose(controller.batch(states, step if first is None else first)),
        velocity,
        lambda states, inputs, t, end: rng.choice([-1.0, 1.0], (len(states), 1)),
        lambda states, t: np.ones(len(states)),
        lambda states, t: 1 - np.abs(states[:, 0]) + 1e-9,
        starts,
        delta=DELTA,
        steps=steps,
    )


def drawn(table, count, rng):
    states = rng.uniform(table.grid.lower, table.grid.upper, (20 * count, 2))
    return states[table.contains(states, start=0, within=table.steps)][:count]


def test_without_a_target_the_sets_shrink_and_settle():
    problem = double_integrator(steps=60)
    table = sdhj.solve(problem, progress=False)
    shares = [table.fraction(start=0, within=n) for n in range(61)]
    assert shares == sorted(shares, reverse=True) and shares[0] == 1.0
    assert shares[30] == shares[60] < shares[5]
    assert len(table.tubes) <= 61 < len(table.index)  # one for each number of steps, however many start


def test_without_steps_the_target_is_reached_some_time():
    problem, method = interval_problem(), Certified(cells=(80,))
    table = sdhj.solve(replace(problem, steps=None), method, progress=False)
    more = sdhj.solve(replace(problem, steps=table.steps + 7), method, progress=False)
    n = table.steps
    np.testing.assert_array_equal(table.values() <= 0, more.values() <= 0)
    assert 1 < n < 30 and table.fraction(start=0, within=n // 2) < table.fraction(start=0, within=n)


def test_the_controller_and_the_simulation_of_what_stays_clear(rng):
    table = sdhj.solve(double_integrator(steps=30, nodes=(101, 101)), progress=False)
    controller = Controller(table)
    assert controller.steps_to_go([0.0, 0.0], 0) == 30 and controller.steps_to_go([0.9, 2.0], 0) is None
    with pytest.raises(sdhj.NotAdmissible, match="clear for 30 steps"):
        controller.select([0.9, 2.0], 0)
    assert controller.safe_inputs([0.0, 2.3], 0).tolist() == [0]  # brake
    assert controller.filter([0.0, 2.3], 0, 2).inputs == 0
    report = sdhj.monte_carlo(controller, 200, "worst", progress=False)
    assert report.rate("reached") > 0.98 and report.counts["late"] == report.counts["collided"] == 0
    assert report.steps.min() < report.steps.max() == 30


@pytest.mark.parametrize("steps", [20, None])
def test_certified_carts_never_leave(steps, rng):
    """Within 20 steps, and for ever: for a hundred, though the sets have settled after fewer."""
    disturbance = 0.3
    table = sdhj.solve(double_integrator(steps, disturbance), Certified(cells=(100, 100)), progress=False)
    shares = [table.fraction(start=0, within=n) for n in range(table.steps + 1)]
    assert shares == sorted(shares, reverse=True) and shares[-1] > 0.2
    starts = drawn(table, 500, rng)
    assert too_far(starts, disturbance).max() < 0
    outcomes = judged(table, starts, disturbance, rng, steps or 100, first=0 if steps is None else None)
    assert (outcomes == "late").all(), np.unique(outcomes, return_counts=True)


def test_what_leaves_over_a_safe_end_is_out_of_danger():
    """A runner at speed 1 ahead of a wall that closes in from below at 0.8: who reaches the end is safe."""
    grid = Grid([0.0], [4.0], [81], ends=[("unsafe", "safe")])
    wall = UnsafeSet((0,), lambda p, t: p[:, 0] - 0.8 * t, name="wall")
    problem = line((0.0, 1.0), 0.0, grid=grid, target=None, unsafe=(wall,), delta=0.25, steps=20)
    table = sdhj.solve(problem, "lax", progress=False)
    report = sdhj.monte_carlo(Controller(table), 100, "none", progress=False)
    assert report.counts["reached"] == 100 and report.steps.max() < 20


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("method", [HJI(), Joint(), HopfLax(), Projected(), HopfLax("linear")])
def test_every_method_stays_clear_of_a_disk(method, rng):
    """A point that drifts to the right by 0.5 +- 0.2 and steers by 1 up or down: who is too close hits the disk."""
    drift = np.array([[0.5, -1.0], [0.5, 0.0], [0.5, 1.0]])
    usual = {"lower": [-2.0, -2.0], "upper": [2.0, 2.0], "ends": "wall", "delta": 0.2}
    problem = raft(push=0.2, current=0.5, **usual, unsafe=[post(0.0, 0.0, 0.5)])
    table = sdhj.solve(problem, method, progress=False)
    assert 0.5 < table.fraction(start=0, within=5) < table.fraction(start=0, within=0)
    assert not table.contains([[-0.52, 0.0]], start=0, within=5)[0]
    states = rng.uniform(-2, 2, (4000, 2))
    starts = states[table.contains(states, start=0, within=5)]
    report = judge.play(
        lambda states, step: Controller(table).choose(table.batch(states, step)),
        lambda q, u, signs, t: drift[np.maximum(u, 0)] + 0.2 * signs,
        lambda q, u, t, end: rng.choice([-1.0, 1.0], q.shape),
        lambda q, t: np.ones(len(q)),
        lambda q, t: np.hypot(q[:, 0], q[:, 1]) - 0.5,
        starts[np.abs(starts).max(axis=1) < 0.7],  # no wall of the grid is met
        delta=0.2,
        steps=5,
    )
    assert np.mean(report != "late") < 0.02, np.unique(report, return_counts=True)


def test_what_moves_has_no_sets_for_ever():
    """A target that moves has none either: test_errors_advise, which asks for all else that cannot be had."""
    still, moving = (
        Dynamics([[0.0]], [[0.0]], np.eye(1), [0.1]),
        UnsafeSet((0,), lambda p, t: np.abs(p[:, 0] - t) - 0.1),
    )
    with pytest.raises(ValueError, match="depend on time; give"):
        line(dynamics=still, target=None, unsafe=(moving,), steps=None)


def test_certificates_for_ever():
    """What does not move stays where it is: every cell that is clear, with or without a target."""
    still = replace(double_integrator(), dynamics=Dynamics([[0.0]], [[0.0, 0.0]], np.eye(2), [0, 0]))
    table = sdhj.solve(still, Certified((9, 9)), progress=False)
    assert table.steps == 1 and table.fraction(start=0, within=1) == table.fraction(start=0, within=0) > 0.0
