"""Tables of problems without a number of steps: kept in files, asked without a step, played for any time."""

from dataclasses import replace

import numpy as np
import pytest
from test_safety import double_integrator, too_far
from zoo import interval_problem

import sdhj
from sdhj import Certified, Controller, UnsafeSet
from sdhj.certified.table import CellSets
from sdhj.common.findings import UnsettledWarning
from sdhj.simulation.runs import FOREVER_PLAYED

CELLS, FEW = Certified(cells=(100, 100)), Certified(cells=(80,))


@pytest.fixture(scope="module")
def staying():
    return sdhj.solve(double_integrator(None, 0.6), CELLS, progress=False)


@pytest.fixture(scope="module")
def reaching():
    return sdhj.solve(replace(interval_problem(), steps=None), FEW, progress=False)


def same(one, other):
    assert one.problem.digest == other.problem.digest and one.details == other.details and one.steps == other.steps
    np.testing.assert_array_equal(one.index, other.index)
    for start, within in ((0, 0), (0, one.steps)):
        for ask in ("values", "inputs"):
            found = (getattr(table, ask)(start=start, within=within) for table in (one, other))
            np.testing.assert_array_equal(*found)


def test_it_is_loaded_for_the_problem_that_it_was_solved_for(staying, reaching, tmp_path):
    for table, problem in (
        (staying, double_integrator(None, 0.6)),
        (reaching, replace(interval_problem(), steps=None)),
    ):
        path = tmp_path / "table.npz"
        table.save(path)
        same(sdhj.load(path, problem=problem), table)
        same(sdhj.load(path, problem=replace(problem, steps=table.steps)), table)
        assert Controller(sdhj.load(path, problem=problem)).steps_to_go(np.zeros(problem.grid.ndim)) is not None


def test_other_problems_are_still_told(staying, reaching, tmp_path):
    path = tmp_path / "table.npz"
    staying.save(path)
    for other in (double_integrator(None, 0.5), double_integrator(7, 0.6)):
        with pytest.raises(sdhj.TableFileError, match="another problem"):
            sdhj.load(path, problem=other)
    finite = sdhj.solve(replace(interval_problem(), steps=reaching.steps), FEW, progress=False)
    finite.save(path)  # what was solved for some steps is no answer for ever
    with pytest.raises(sdhj.TableFileError, match=r"another problem.*steps is"):
        sdhj.load(path, problem=replace(interval_problem(), steps=None))


def test_no_step_is_asked_for(staying):
    controller, q = Controller(staying), np.array([0.0, 2.0])
    assert controller.steps_to_go(q) == controller.steps_to_go(q, 0) == staying.steps
    assert controller.safe_inputs(q).tolist() == controller.safe_inputs(q, 0).tolist() == [0]
    assert controller.select(q) == 0 and controller.filter(q, wanted=2).inputs == 0
    assert controller.fallback(np.array([0.9, 2.0])) == controller.fallback(np.array([0.9, 2.0]), 0)
    np.testing.assert_array_equal(controller.batch(q[None]).safe, controller.batch(q[None], 0).safe)
    with pytest.raises(sdhj.NotAdmissible, match="states that stay clear"):
        controller.select(np.array([0.9, 2.0]))


def test_what_depends_on_time_asks_for_the_step():
    moving = UnsafeSet((0,), lambda p, t: np.abs(p[:, 0] - 3.0 + 0.1 * t) - 0.2, name="moving")
    controller = Controller(sdhj.solve(replace(interval_problem(), unsafe=(moving,)), progress=False))
    q = np.zeros(1)
    assert controller.steps_to_go(q, 0) is not None
    for ask in (controller.steps_to_go, controller.safe_inputs, controller.select, controller.fallback):
        with pytest.raises(ValueError, match="depends on time: give"):
            ask(q)
    for ask in (lambda: controller.batch(q[None]), lambda: controller.filter(q, wanted=0)):
        with pytest.raises(ValueError, match="depends on time: give"):
            ask()
    for play in (lambda: sdhj.simulate(controller, q, steps=9), lambda: sdhj.monte_carlo(controller, 9, steps=9)):
        with pytest.raises(ValueError, match="runs follow the table"):
            play()


@pytest.mark.slow
def test_runs_are_as_long_as_one_likes(staying):
    controller = Controller(staying)
    assert staying.steps < FOREVER_PLAYED == 100
    run = sdhj.simulate(controller, [0.2, 0.5], steps=3 * staying.steps)
    assert run.outcome == "reached" and len(run.inputs) == 3 * staying.steps
    assert run.times[-1] == pytest.approx(3 * staying.steps * 0.1) and too_far(run.states, 0.6).max() < 0
    assert len(sdhj.simulate(controller, [0.2, 0.5]).inputs) == 100
    report = sdhj.monte_carlo(controller, 5, steps=110, progress=False)
    assert report.steps.max() == 110 and report.counts["reached"] == 5
    assert sdhj.monte_carlo(controller, 5, progress=False).steps.max() == 100
    for steps in (0, 2.5, True):
        with pytest.raises(ValueError, match="steps "):
            sdhj.simulate(controller, [0.0, 0.0], steps=steps)


def test_a_target_may_be_reached_later_than_the_table_is_long(reaching):
    """Pushed out again and again by what the table does not know of, the robot still has an answer."""

    def push(moment):  # within its bounds, but for the first steps everything is undone
        return moment.bounds

    far = np.linspace(*reaching.grid.lower, *reaching.grid.upper, 400)[:, None]
    start = far[reaching.contains(far, start=0, within=reaching.steps)][0]
    run, report = sdhj.simulate(Controller(reaching), start, push), sdhj.monte_carlo(Controller(reaching), 300)
    assert run.outcome == "reached" and len(run.inputs) <= reaching.steps and report.rate("reached") > 0.97
    few = sdhj.simulate(Controller(reaching), start, push, steps=1)
    assert few.outcome == "late" and len(few.inputs) == 1
    assert (run.steps_to_go[:-1] >= run.steps_to_go[1:]).all()


def test_ctrl_c_ends_a_solve_with_what_there_is(monkeypatch):
    """With a target a table of fewer steps is a true one; without, it says that it holds for so many steps only."""
    extend = CellSets.extend

    def interrupted(self, step, within):
        if within == 3:
            raise KeyboardInterrupt
        extend(self, step, within)

    whole = sdhj.solve(replace(interval_problem(), steps=2), FEW, progress=False)
    monkeypatch.setattr(CellSets, "extend", interrupted)
    with pytest.warns(UnsettledWarning, match="after 2 steps"):
        table = sdhj.solve(replace(interval_problem(), steps=None), FEW, progress=False)
    assert table.steps == 2
    np.testing.assert_array_equal(table.values(), whole.values())
    with pytest.warns(UnsettledWarning, match="not for ever"):
        staying = sdhj.solve(double_integrator(None, 0.6), Certified(cells=(40, 40)), progress=False)
    assert not staying.details.get("endless")
    with pytest.raises(KeyboardInterrupt):  # before its last step a table of a number of steps is none
        sdhj.solve(replace(interval_problem(), steps=4), FEW, progress=False)


@pytest.mark.slow
def test_what_never_settles_ends_at_the_cap(monkeypatch):
    monkeypatch.setattr(sdhj.problem.problem, "FOREVER", 4)
    for problem, method in ((replace(interval_problem(), steps=None), FEW), (double_integrator(None, 0.6), CELLS)):
        with pytest.warns(UnsettledWarning, match="after 4 steps"):
            table = sdhj.solve(problem, method, progress=False)
        assert table.steps == 4 and sdhj.monte_carlo(Controller(table), 20, steps=4, progress=False).runs == 20
