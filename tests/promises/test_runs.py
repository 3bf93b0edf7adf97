"""Closed-loop simulation: single runs, the judgement by true geometry, and the rates."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import zoo

import sdhj
from sdhj.common.remembering import read_only
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.simulation import runs as simulation
from sdhj.simulation.adversaries import Moment
from sdhj.simulation.outcomes import OUTCOMES
from sdhj.simulation.runs import SUBSTEPS, admissible_states, monte_carlo, simulate
from sdhj.table.controller import Controller
from sdhj.table.table import LookupTable

PLAYERS = ("none", "random", "aggressive", "worst")


@cache
def unicycle_table() -> LookupTable:
    return sdhj.solve(zoo.unicycle_problem(), progress=False)


def judged_by(table: LookupTable, **changes: object) -> Controller:
    """A controller that believes the table while the true problem is another one."""
    controller = Controller(table)
    controller.problem = replace(table.problem, **changes)
    return controller


# ---- one run


def test_a_trajectory_is_what_happened() -> None:
    controller = Controller(zoo.interval_table())
    run = simulate(controller, [-2.5], adversary="random", seed=3)
    problem = controller.problem
    assert run.outcome == "reached"
    intervals = len(run.inputs)
    assert run.times.shape == (intervals * SUBSTEPS + 1,) and run.states.shape == (len(run.times), 1)
    np.testing.assert_allclose(run.times, np.arange(len(run.times)) * problem.delta / SUBSTEPS, atol=1e-12)
    assert run.disturbances.shape == (len(run.times) - 1, 1) and run.samples.shape == (intervals + 1, 1)
    velocity = np.repeat(problem.inputs[run.inputs], SUBSTEPS, axis=0) + run.disturbances
    np.testing.assert_allclose(np.diff(run.states, axis=0), velocity * problem.delta / SUBSTEPS, atol=1e-12)
    for step in range(intervals):
        assert run.inputs[step] == controller.select(run.samples[step], step)
        assert run.steps_to_go[step] == controller.steps_to_go(run.samples[step], step)
    assert abs(run.states[-1, 0]) <= 1.0 and (np.abs(run.samples[:-1]) > 1.0).all()
    assert (np.diff(run.steps_to_go) <= -1).all() and run.steps_to_go[0] == 4


def test_a_start_in_the_target_has_arrived() -> None:
    run = simulate(Controller(zoo.interval_table()), [0.5])
    assert run.outcome == "reached" and run.inputs.size == 0
    assert run.states.tolist() == [[0.5]] and run.times.tolist() == [0.0] and run.disturbances.shape == (0, 1)


@pytest.mark.slow
def test_angles_run_on_without_jumps() -> None:
    controller = Controller(zoo.arm_table())
    starts = admissible_states(controller, 12, np.random.default_rng(0))
    longest = max((simulate(controller, q, "worst") for q in starts), key=lambda run: len(run.times))
    assert len(longest.inputs) >= 2
    fastest = (3.0 + 0.3) * controller.problem.delta / SUBSTEPS
    assert np.abs(np.diff(longest.states[:, :2], axis=0)).max() <= fastest * (1 + 1e-9)


# ---- the judgement: truth, not the table


def test_a_collision_that_the_table_does_not_know_is_seen() -> None:
    """A thin wall between two sampling times: only the instants between them can see it."""
    thin = sdhj.UnsafeSet((0,), lambda p, t: np.abs(p[:, 0] + 1.3) - 0.02, name="thin wall")
    run = simulate(judged_by(zoo.interval_table(), unsafe=(thin,)), [-2.0], adversary="none")
    assert run.outcome == "collided"
    assert abs(run.states[-1, 0] + 1.3) <= 0.02 and len(run.times) < 2 * SUBSTEPS
    assert (np.abs(run.states[:-1] + 1.3) > 0.02).all()  # the run ends where it happened
    assert np.abs(run.samples + 1.3).min() > 0.02


def test_a_start_in_an_unsafe_set_has_collided() -> None:
    wall = sdhj.UnsafeSet((0,), lambda p, t: p[:, 0] + 1.9, name="wall")
    run = simulate(judged_by(zoo.interval_table(), unsafe=(wall,)), [-2.0])
    assert run.outcome == "collided" and run.times.tolist() == [0.0] and run.inputs.size == 0
    inside = sdhj.UnsafeSet((0,), lambda p, t: np.abs(p[:, 0] - 0.9) - 0.1, name="in the target")
    assert simulate(judged_by(zoo.interval_table(), unsafe=(inside,)), [0.9]).outcome == "collided"


def test_moving_sets_are_judged_at_their_time() -> None:
    """A wall that arrives after 0.3 s: a run that is in the target by then has reached it, a later one has collided."""
    wall = sdhj.UnsafeSet((0,), lambda p, t: np.full(len(p), 0.3 - t), name="late wall")
    controller = judged_by(zoo.interval_table(), unsafe=(wall,))
    assert simulate(controller, [0.9], adversary="none").outcome == "reached"
    run = simulate(controller, [-1.3], adversary="none")
    assert run.outcome == "collided" and run.times[-1] == pytest.approx(0.3)


def test_success_needs_the_true_target_not_the_table_s() -> None:
    """The table says 0 steps to go at 0.8; the true target ends at 0.5. The run goes on until it is truly inside."""
    smaller = sdhj.TargetSet((0,), lambda p, t: np.abs(p[:, 0]) - 0.5)
    controller = judged_by(zoo.interval_table(), target=smaller)
    assert controller.steps_to_go([0.8], 0) == 0
    run = simulate(controller, [0.8], adversary="none")
    assert run.outcome == "reached" and len(run.inputs) >= 1 and run.steps_to_go[0] == 0
    assert abs(run.states[-1, 0]) <= 0.5


def test_running_out_of_steps_is_late() -> None:
    elsewhere = sdhj.TargetSet((0,), lambda p, t: np.abs(p[:, 0] - 3.5) - 0.5)
    run = simulate(judged_by(zoo.interval_table(), target=elsewhere, unsafe=()), [0.0], adversary="random")
    assert run.outcome == "late" and len(run.inputs) == 5 and len(run.times) == 5 * SUBSTEPS + 1


def test_an_adversary_stronger_than_solved_for_drives_the_state_out() -> None:
    """|v| <= 2 against |u| <= 1: pushed away from the target, out of every tube."""
    table = zoo.interval_table()
    inputs = table.problem.inputs
    stronger = sdhj.Dynamics(inputs, inputs, [[1.0]], [2.0])
    controller = judged_by(table, dynamics=stronger)
    run = simulate(controller, [-2.0], adversary=lambda m: np.full((len(m.states), 1), -2.0))
    assert run.outcome == "left" and len(run.inputs) < 5
    assert controller.steps_to_go(run.states[-1], len(run.inputs)) is None


# ---- the rates


@pytest.mark.parametrize(
    ("adversary", "rule"),
    [*((name, "deepest") for name in PLAYERS), *(("worst", rule) for rule in ("effort", "target", "clearance"))],
)
def test_where_the_table_is_exact_every_run_succeeds(adversary: str, rule: str) -> None:
    """On the interval tubes are piecewise linear with kinks at nodes, so interpolation is exact: no run may fail."""
    report = monte_carlo(Controller(zoo.interval_table(), rule), 2000, adversary, progress=False)
    assert report.counts == {"reached": 2000, "collided": 0, "left": 0, "late": 0, "off the grid": 0}


def test_starts_fill_the_tube_evenly() -> None:
    """The tube of step 0 is [-3, 3]: five steps of 0.4 beyond the target, and the wall stands at 3."""
    controller = Controller(zoo.interval_table())
    starts = admissible_states(controller, 4000, np.random.default_rng(1))[:, 0]
    assert np.abs(starts).max() <= 3.0
    share = np.histogram(starts, np.linspace(-3, 3, 9))[0] / 4000
    assert np.abs(share - 1 / 8).max() < 5 * np.sqrt(1 / 8 * 7 / 8 / 4000)  # five standard deviations


def test_state_dependent_velocities_in_the_loop() -> None:
    """A Dubins car on a coarse grid: of 4,000 runs 0.5% failed under the random and 0.9% under the worst adversary."""
    for adversary, least in (("random", 0.98), ("worst", 0.97)):
        report = monte_carlo(Controller(unicycle_table()), 1000, adversary, progress=False)
        assert report.rate("reached") >= least, str(report)


# ---- monte_carlo


def test_a_seed_fixes_everything(monkeypatch: pytest.MonkeyPatch) -> None:
    controller, runs = Controller(zoo.torus_table()), 150
    monkeypatch.setattr(simulation, "CHUNK", 100)
    one = monte_carlo(controller, runs, "random", seed=7, progress=False)
    monkeypatch.setattr(simulation, "threads", lambda: 1)
    two = monte_carlo(controller, runs, "random", seed=7, progress=False)
    other = monte_carlo(controller, runs, "random", seed=8, progress=False)
    np.testing.assert_array_equal(one.starts, two.starts)
    np.testing.assert_array_equal(one.outcomes, two.outcomes)
    np.testing.assert_array_equal(one.steps, two.steps)
    assert (one.starts != other.starts).all()
    assert len(np.unique(one.starts, axis=0)) == runs  # chunks do not repeat each other
    q = one.starts[0]
    first, again, different = (simulate(controller, q, "random", seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.states, again.states)
    assert first.states.shape != different.states.shape or (first.states[1] != different.states[1]).any()


def test_report_adds_up_and_reads_as_a_table() -> None:
    report = monte_carlo(Controller(zoo.torus_table()), 1500, "worst", progress=False)
    assert tuple(report.counts) == OUTCOMES and sum(report.counts.values()) == report.runs == 1500
    assert report.starts.shape == (1500, 2) and report.outcomes.shape == report.steps.shape == (1500,)
    for place, outcome in enumerate(OUTCOMES):
        assert (report.outcomes == place).sum() == report.counts[outcome]
        assert report.rate(outcome) == report.counts[outcome] / 1500
        share, (low, high) = report.rate(outcome), report.interval(outcome)
        assert 0 <= low <= share <= high <= 1 and low < high
        for end in (low, high):  # Wilson's: what is seen lies 1.96 standard deviations from what an end would give
            assert (end - share) ** 2 == pytest.approx(1.959963984540054**2 * end * (1 - end) / 1500, abs=1e-12)
    lines = str(report).splitlines()
    assert "1500 runs, lax table" in lines[0]
    assert all(line.startswith(outcome) for line, outcome in zip(lines[2:7], OUTCOMES, strict=True))
    assert lines[2].split()[1] == str(report.counts["reached"])


def test_own_functions_are_named_in_the_report() -> None:
    def still(m: Moment) -> np.ndarray:
        return np.zeros_like(m.previous)

    def first(candidates: "sdhj.table.rules.Candidates") -> np.ndarray:
        return candidates.inputs

    report = monte_carlo(Controller(zoo.interval_table(), first), 50, still, progress=False)
    assert (report.adversary, report.rule) == ("still", "first") and report.rate("reached") == 1.0


# ---- guards


@pytest.mark.parametrize("bad", [0, 2.5, True, None, 10**8 + 1, 10**400])
def test_runs_must_be_a_count(bad: object) -> None:
    with pytest.raises(ValueError, match="runs"):
        monte_carlo(Controller(zoo.interval_table()), bad)


@pytest.mark.parametrize("bad", [-1, 0.5])
def test_seed_must_be_a_count(bad: object) -> None:
    controller = Controller(zoo.interval_table())
    for run in (lambda: simulate(controller, [0.0], seed=bad), lambda: monte_carlo(controller, 10, seed=bad)):
        with pytest.raises(ValueError, match="seed"):
            run()


def test_a_start_that_is_not_admissible() -> None:
    controller = Controller(zoo.interval_table())
    with pytest.raises(sdhj.NotAdmissible, match="admissible at step 0"):
        simulate(controller, [3.5])
    with pytest.raises(ValueError, match=r"shape \(1,\)"):
        simulate(controller, [0.0, 0.0])


@pytest.mark.slow
def test_an_empty_tube_has_no_starts() -> None:
    table = zoo.interval_table()
    nothing = Controller(replace(table, tubes=read_only(np.ones_like(table.tubes))))
    with pytest.raises(ValueError, match="0 within 5 steps"):
        monte_carlo(nothing, 10, progress=False)
    staying = replace(table.problem, target=None)  # where there is no target, none can be larger
    with pytest.raises(ValueError, match="stronger inputs, more nodes"):
        monte_carlo(Controller(replace(nothing.table, problem=staying)), 10, progress=False)


def test_problem_without_unsafe_sets() -> None:
    problem: ReachAvoidProblem = zoo.interval_problem(unsafe=False)
    controller = Controller(sdhj.solve(problem, sdhj.HopfLax(), progress=False))
    for adversary in PLAYERS:
        assert monte_carlo(controller, 300, adversary, progress=False).rate("reached") == 1.0


def test_a_table_is_no_controller() -> None:
    table = sdhj.solve(zoo.interval_problem(steps=1), "lax", progress=False)
    for play in (sdhj.monte_carlo, lambda it: sdhj.simulate(it, [0.0])):
        with pytest.raises(ValueError, match=r"example Controller\(table\), got LookupTable"):
            play(table)


def test_one_state_is_not_taken_for_many() -> None:
    problem = zoo.interval_problem(steps=1)
    for value in (problem.target_value, problem.unsafe_value):
        with pytest.raises(ValueError, match=r"1\), got \(1,\); q\[None\]"):
            value(np.zeros(1), 0.0)
