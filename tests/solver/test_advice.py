"""What a warning says that helps, helps: the advice is followed, and the number falls or the warning goes.

Advice on the resolution is followed in test_resolution, on gaps in test_gaps, on what is suspected in
test_suspected, that of errors in promises/test_errors_advise.
"""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from zoo import interval_problem, pursued_on_a_line, torus_problem, unicycle_problem

import sdhj
from sdhj import Dynamics, Grid, UnsafeSet
from sdhj.common.findings import ResolutionWarning, UnsettledWarning
from sdhj.problem import problem as problem_module


def bars(edge=3.9):
    """Stay on a line between bars at its ends."""
    outside = UnsafeSet((0,), lambda p, t: edge - np.abs(p[:, 0]), name="bars")
    staying = replace(interval_problem(unsafe=False), target=None, grid=Grid([-4.0], [4.0], [81]))
    return replace(staying, unsafe=(outside,))


def quiet(problem, method="hji"):
    """The table, where the solve has nothing to say."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return sdhj.solve(problem, method, progress=False)


def test_a_shorter_delta_where_no_input_stays_clear(solves_are_played):
    """A robot that cannot stand still between bars 2 m apart: in 3 s it has to leave, in 0.5 s it can turn."""
    moving = Dynamics([[-1.0], [1.0]], [[-1.0], [1.0]], [[1.0]], [0.1])
    problem = replace(bars(1.0), dynamics=moving, delta=3.0)
    with pytest.warns(ResolutionWarning, match="stays clear of 'bars'"):
        sdhj.solve(problem, progress=False)
    assert quiet(replace(problem, delta=0.5)).fraction() > 0.05
    still = Dynamics([[0.0]], [[0.0]], [[1.0]], [0.1])  # ... or other inputs
    assert quiet(replace(problem, dynamics=still, steps=2)).fraction() > 0.05


def test_stronger_inputs_where_none_makes_progress(solves_are_played):
    reach = interval_problem(nodes=321, unsafe=False)  # strong inputs make gaps, which coarse nodes would fill
    weak = replace(reach, dynamics=Dynamics(reach.inputs, reach.inputs, [[1.0]], [1.5]))
    with pytest.warns(ResolutionWarning, match="3 inputs makes progress"):
        sdhj.solve(weak, progress=False)
    strong = Dynamics(3 * reach.inputs, 3 * reach.inputs, [[1.0]], [1.5])
    assert quiet(replace(reach, dynamics=strong)).fraction() > 0.3


def test_a_number_of_steps_where_a_set_does_not_settle(monkeypatch):
    monkeypatch.setattr(problem_module, "FOREVER", 3)
    problem = replace(interval_problem(nodes=321, unsafe=False), steps=None)
    with pytest.warns(UnsettledWarning, match="the problem a number"):
        table = sdhj.solve(problem, progress=False, play=False)
    assert quiet(replace(problem, steps=3), sdhj.Certified()).fraction() >= table.fraction() - 1e-12


@pytest.mark.parametrize("make", [unicycle_problem, torus_problem])
@pytest.mark.slow
def test_a_certified_table_where_runs_are_lost(make):
    """The advice that every table on a grid gives: a table of cells loses none."""
    problem = make()
    certified = sdhj.solve(problem, sdhj.Certified(cells=[24] * problem.grid.ndim), play=False)
    assert certified.fraction() > 0 and certified.played(1000).lost == 0


def test_ends_of_an_axis_that_only_the_adversary_moves(solves_are_played):
    """A pursuer that leaves past an unsafe end of its own axis wins by it; a wall, or a longer axis, holds it."""
    problem = pursued_on_a_line()
    table = sdhj.solve(problem, play=False)
    faster = Dynamics(problem.inputs, [[-1.0, 0.0], [1.0, 0.0]], [[0.0], [1.0]], [0.8])  # than the table knows
    found = replace(table, problem=replace(problem, dynamics=faster)).played(500)
    assert 'ends="wall" or "safe" for' in found.advice
    walled = replace(problem, grid=replace(problem.grid, ends=("unsafe", "wall")))
    held = replace(sdhj.solve(walled, play=False), problem=replace(walled, dynamics=faster)).played(500)
    assert held.lost < found.lost / 2
