"""What a solve says of its own promises: runs from the whole tube, what emptied it, warnings that can be followed."""

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fleet import FLEET
from zoo import ALONE, car, chase, goal, interval_problem, post, torus_problem, unicycle_problem

import sdhj
import sdhj.simulation.played
from sdhj import Controller, UnsafeSet
from sdhj.common.findings import ProjectionWarning, ResolutionWarning
from sdhj.common.remembering import read_only
from sdhj.simulation.played import FEWEST_PLAYED, MOST_PLAYED
from sdhj.solver.recursion import GridSets


def test_runs_are_counted_as_monte_carlo_counts_them() -> None:
    table = sdhj.solve(torus_problem(), progress=False)
    found = table.played(400, seed=3)
    report = sdhj.monte_carlo(Controller(table), 400, seed=3, progress=False)
    assert found.runs == 400 and found.lost == sum(found.ways.values())
    low, high = found.interval
    assert low <= 1 - report.rate("reached") <= high  # other draws of the same rate
    assert table.played(400, seed=3) == found and str(found.lost) in str(found)


def test_who_won_is_named() -> None:
    """Stripes thinner than what a look sees, which the table does not know of: it says who won, and what helps."""
    table = sdhj.solve(torus_problem(), progress=False)
    stripes = UnsafeSet((0,), lambda p, t: np.abs((p[:, 0] + 0.05) % 0.1 - 0.05) - 0.004, name="stripes")
    blind = replace(table, problem=replace(table.problem, unsafe=(*table.problem.unsafe, stripes)))
    found = blind.played(300)
    assert found.lost > 0 and "collided with stripes" in found.ways and "What helps" in found.advice


def test_a_solve_is_played_at_its_end(solves_are_played: None) -> None:
    problem = interval_problem()
    table = sdhj.solve(problem, progress=False)
    counts = table.details["played"]
    assert FEWEST_PLAYED <= counts["runs"] <= MOST_PLAYED and counts["lost"] == 0 and "0 of 200 runs" in repr(table)
    assert "played" not in sdhj.solve(problem, progress=False, play=False).details
    certified = sdhj.solve(problem, sdhj.Certified(cells=[80]), progress=False)
    assert "played" not in certified.details  # nothing can be lost


def test_what_is_lost_is_a_warning_that_helps(solves_are_played: None, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {"ALARMING": 0.0, "FEWEST_PLAYED": 1000, "MOST_PLAYED": 1000}.items():  # any that is lost
        monkeypatch.setattr(sdhj.simulation.played, name, value)
    with pytest.warns(ResolutionWarning, match="lost to adversary worst"):
        table = sdhj.solve(unicycle_problem(nodes=(9, 9, 8)), progress=False)
    assert table.details["played"]["lost"] > 0


def test_near_extinction_what_is_lost_outside_the_target_is_told(solves_are_played: None) -> None:
    """A disturbance that moves the state farther in an interval than the target reaches: nothing is won beyond it.

    The worst run starts within a grid's error of the target. Against a weaker one, which an input can make up for, the
    advice is another; runs from within the target end where they begin, and hide the rate.
    """
    strong = sdhj.Dynamics([[-1.0], [0.0], [1.0]], [[-1.0], [0.0], [1.0]], [[1.0]], [1.3])
    problem = replace(interval_problem(unsafe=False), dynamics=strong)
    problem = replace(problem, target=sdhj.TargetSet((0,), lambda p, t: np.abs(p[:, 0]) - 1.25 * 0.5))
    table = sdhj.solve(problem, progress=False, play=False)
    far = replace(table, tubes=read_only(table.tubes - 0.3))  # what errors of the scheme do on a coarse grid
    found = far.played(400)
    assert 0 < found.outside_lost == found.lost <= found.outside < 400
    assert f"{found.lost} of {found.outside} from outside the target" in str(found)
    assert found.advice.startswith("From none") and "more nodes" not in found.advice
    weak = replace(far.problem, dynamics=sdhj.Dynamics(strong.inputs, strong.inputs, [[1.0]], [0.6]))
    assert not replace(far, problem=weak).played(400).advice.startswith("From none")


def test_an_empty_tube_says_what_emptied_it(solves_are_played: None) -> None:
    problem = replace(interval_problem(unsafe=False), target=None, grid=sdhj.Grid([-4.0], [4.0], [81]))
    weak = sdhj.Dynamics(problem.inputs, problem.inputs, [[1.0]], [1.5])
    with pytest.warns(ResolutionWarning, match="from 94%.*one interval.*stronger inputs"):
        sdhj.solve(replace(problem, dynamics=weak, steps=40), progress=False)
    blurred = replace(problem, steps=40, sensing=sdhj.Sensing(error=0.5, memory=False))
    with pytest.warns(ResolutionWarning, match="an input changes x1") as seen:
        none = sdhj.solve(blurred, progress=False)
    assert "memory=True" in str(seen[-1].message) and "nodes" not in str(seen[-1].message)
    followed = sdhj.solve(replace(blurred, sensing=sdhj.Sensing(error=0.5)), progress=False)
    assert followed.fraction() > 0.3 > none.fraction() == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("shape", [(100, 100, 5), (142, 142, 5)])
def test_an_empty_tube_is_looked_into_at_states_of_all_axes(solves_are_played: None, shape: tuple[int, ...]) -> None:
    """All is carried out of the box at 1 m/s; but for the lowest layer and the last 0.1 m, one interval is clear."""
    problem = chase(
        lower=[0.0] * 3,
        upper=[4.0] * 3,
        nodes=shape,
        inputs=[[0.0]],
        drift=[[1.0, 0.0, 0.0]],
        **ALONE,
        target=None,
        unsafe=[UnsafeSet((2,), lambda p, t: p[:, 0] - 0.5, name="low")],
        delta=0.1,
        steps=60,
    )
    with pytest.warns(ResolutionWarning, match="states some input stays"):
        sdhj.solve(problem, progress=False)


def test_the_filter_cannot_be_passed_by(rng: np.random.Generator) -> None:
    """For one state and for many, by index and by command: an input of the problem, looked at, or the fallback."""
    for problem in (torus_problem(), replace(FLEET["rail"]().problem(), steps=4)):
        table = sdhj.solve(problem, progress=False)
        controller, inputs = Controller(table), problem.inputs
        states = rng.uniform(table.grid.lower, table.grid.upper, (300, table.grid.ndim))
        near = inputs[rng.integers(0, len(inputs), 300)] + rng.normal(0, 0.3, (300, inputs.shape[1]))
        for wanted in (rng.integers(0, len(inputs), 300), near, near.astype(np.float32)):
            told = controller.filter(states, 0, wanted)
            np.testing.assert_array_equal(told.commands, inputs[told.inputs])
            passes = table.passes_true_sets(states, told.inputs, 0, np.ones(300, np.int64))
            assert passes[told.promised].all() and (told.promised | told.fallback).all()
            for m in range(0, 300, 30):
                one = controller.filter(states[m], 0, wanted[m])
                assert one.inputs == told.inputs[m] and (one.commands == told.commands[m]).all()
            batch = table.batch(states, 0, table.steps)
            assert not (told.promised & (batch.steps_to_go < 0)).any()
            lost = problem.unsafe_value(states, 0.0) <= 0
            assert not told.promised[lost].any()


def parking(tolerance: float) -> sdhj.ReachAvoidProblem:
    """A car that is to park to within a tolerance, on cells of 0.25 m."""
    return car(
        ((0.5, -2.0), (0.5, 0.0), (0.5, 2.0)),
        grid=sdhj.Grid([-2, -2, -np.pi], [2, 2, np.pi], [17, 17, 12], [False, False, True]),
        target=goal(0.0, 0.0, tolerance),
        unsafe=[post(1.0, 0.0, 0.4)],
        steps=2,
    )


def test_a_finished_table_is_returned_whatever_the_runs_at_its_end_meet(
    solves_are_played: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.warns(ResolutionWarning, match="the table is complete"):
        table = sdhj.solve(parking(0.01), progress=False)
    assert table.fraction(start=0, within=2) > 0 and "played" not in table.details
    whole = sdhj.solve(parking(0.5), progress=False, play=False)
    simulated = sdhj.simulation.played
    for met, says in ((KeyboardInterrupt(), "interrupted"), (MemoryError("too little"), "MemoryError: too little")):

        def fails(*_: object, met: BaseException = met, **__: object) -> None:
            raise met

        monkeypatch.setattr(simulated, "rollouts", fails)
        with pytest.warns(ResolutionWarning, match=f"did not finish: .*{says}. With play=False"):
            table = sdhj.solve(parking(0.5), progress=False)
        np.testing.assert_array_equal(table.values(), whole.values())


def test_what_a_solve_warns_of_is_kept_in_one_list(solves_are_played: None, tmp_path: Path) -> None:
    """Cause, number and remedy make the sentence; in the order in which they were told, before the solve and after."""
    thin = UnsafeSet((0,), lambda p, t: np.abs(p[:, 0] - 0.51) - 0.004, name="thread")
    problem = replace(interval_problem(steps=2), unsafe=(thin,))
    with pytest.warns(ResolutionWarning) as told:
        table = sdhj.solve(problem, progress=False)
    found = table.details["findings"]
    assert [cause + remedy for cause, _, remedy in found] == [str(one.message) for one in told]
    assert "thread" in found[0][0] and found[0][1] == pytest.approx(0.008, rel=0.1) and "nodes" in found[0][2]
    assert {one.filename for one in told} == {__file__}  # the line that called solve
    table.save(tmp_path / "t.npz")
    assert sdhj.load(tmp_path / "t.npz").details["findings"] == found
    assert "findings" not in sdhj.solve(interval_problem(steps=2), progress=False).details


def test_empty_projections_are_warned_of_before_the_recursion(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(GridSets, "extend", lambda *given: pytest.fail("the recursion has begun"))
    problem = sdhj.evader_case_study(nodes=9, steps=2)
    with pytest.warns(ProjectionWarning, match="leaves nothing of the"), pytest.raises(pytest.fail.Exception):
        sdhj.solve(problem, "projected", progress=False)


def test_solved_and_loaded_tables_play_and_others_say_that_they_cannot(tmp_path):
    problem = interval_problem()
    table = sdhj.solve(problem, "lax", play=False, progress=False)
    table.save(tmp_path / "table.npz")
    stored = sdhj.solve(problem, "lax", store=tmp_path / "table", progress=False)
    tables = (
        sdhj.load(tmp_path / "table.npz"),
        stored,
        pickle.loads(pickle.dumps(stored)),
        sdhj.load(tmp_path / "table"),
    )
    tables += pickle.loads(pickle.dumps(table)), replace(stored, details={})
    found = table.played(10)
    for other in tables:
        assert other.played(10) == found
    with pytest.raises(ValueError, match="player; use a table"):
        replace(table, player=None).played()
