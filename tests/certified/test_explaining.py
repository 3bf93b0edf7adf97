"""`CertifiedTable.explain` on a line where each answer is known by hand, and what a solve says that proves nothing."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from naive_certified import SMALL
from zoo import car
from zoo import run as line

import sdhj
from sdhj.certified import explaining as explaining_module
from sdhj.certified.explaining import BEYOND, MORE_CELLS
from sdhj.common.findings import ResolutionWarning

POST, GOAL = (3.0, 0.4), (7.0, 1.1)


def table(problem, cells):
    return sdhj.solve(problem, sdhj.Certified(cells=[cells]), progress=False, play=False)


def test_what_is_certified_and_what_cannot_be_asked():
    fine = table(line(), 40)  # cells of 0.25 m, aligned: nothing is lost
    told = fine.explain([5.6], 0, 1)
    assert told.inside and not told.failures and "by inputs [1]" in str(told)
    assert "off the grid" in fine.explain([11.0], 0).says
    assert "unsafe set 'post', whose" in fine.explain([3.1], 0).says
    assert "is 0.3 > 0" in fine.explain([5.6], 0, 0).says
    assert fine.explain([7.0], 0, 0).inside
    for wrong, what in (([1.0, 2.0], "shape"), ([np.nan], "NaN")):
        with pytest.raises(ValueError, match=what):
            fine.explain(wrong)


def test_an_image_that_is_not_covered():
    """From [5, 5.25] the faster input leads into [5.75, 6.5]: a third of that is short of the goal at 6."""
    told = table(line(), 40).explain([5.05], 0, 1)
    first, second = told.failures
    assert not told.inside and "step 0 with 1" in told.says
    assert (first.input, first.by, first.short) == (1, "image", pytest.approx(-1 / 3))
    assert "certified, within x 5.75" in first.says
    assert (second.input, second.short) == (0, -1.0)
    assert told.causes == () and told.helps == (BEYOND,)  # to 5.8 at worst


def test_more_cells_where_the_state_alone_is_won():
    """In cells of 1 m: all of [5, 6] may come to 5.75, but 5.6 to no less than 6.35."""
    told = table(line(), 10).explain([5.6], 0, 1)
    assert told.helps == (MORE_CELLS,) and told.failures[0].short == pytest.approx(-1 / 3)
    assert told.failures[0].by == "rounding" and told.failures[0].says.endswith("the state alone all are")


def test_a_tube_that_may_meet_a_set_or_an_end():
    """From [2, 2.25] the faster input is at 2.6 after 0.28 s at the earliest, in the third part, and may get to 3."""
    fine = table(line(), 40)
    slow, fast = fine.explain([2.1], 0, 1).failures
    assert (slow.input, slow.by) == (0, "image")
    assert (fast.input, fast.by, fast.short) == (1, "post", pytest.approx(-0.4, abs=1e-3))
    assert "0.2 to 0.3 s" in fast.says
    slow, fast = fine.explain([9.9], 0, 1).failures  # in [9.75, 10]
    assert slow.by == fast.by == "the upper end of x" and "0 to 0.1 s" in slow.says
    assert (slow.short, fast.short) == (pytest.approx(-0.25, abs=1e-6), pytest.approx(-1.25, abs=1e-6))
    assert "Not proved" in str(fine.explain([9.9], 0, 1)) and "impossible" not in str(fine.explain([9.9], 0, 1))


def test_bounds_that_are_loose():
    """A drift that is declared to change ten times as much as it does."""
    drift = sdhj.BlackBox(lambda q, u, t: u[0] + 0.01 * q, slope=0.1, rate=0.0)
    problem = line(dynamics=sdhj.Dynamics([[0.0], [1.0]], drift, [[1.0]], [0.0]))
    told = table(problem, 10).explain([4.6], 0, 1)
    assert any("along x, 0.1 wide" in one for one in told.helps)


@pytest.mark.slow
def test_explanations_agree_with_the_table(monkeypatch):
    """An input has a failure where it is not certified; of other robots and an arm with Sensing, over the seam."""
    monkeypatch.setattr(explaining_module, "what_keeps_out", lambda *_: ((), []))  # it is not asked about here
    rng = np.random.default_rng(3)
    sensing = sdhj.Sensing(error=[0.02, 0.02, 0.005, 0.005], delay=0.01, memory=False)
    for problem, cells in (
        (car(), (20, 20, 20)),
        (replace(sdhj.arm_case_study(**SMALL), sensing=sensing), (32, 32, 12, 12)),
    ):
        made = sdhj.solve(problem, sdhj.Certified(cells=cells, parts=4), progress=False, play=False)
        for q in rng.uniform(made.grid.lower, made.grid.upper, (12, made.grid.ndim)):
            told = made.explain(q, 1, 2)
            assert told.inside == made.contains(q[None], start=1, within=2)[0]
            if told.failures:
                assert sorted(one.input for one in told.failures) == list(range(len(problem.inputs)))
                clear = made.hazards(q[None], 1)[0] <= 0
                assert all(
                    (one.by in ("image", "rounding")) == clear[one.input] and one.short <= 0 for one in told.failures
                )


@pytest.mark.slow
def test_next_to_nothing_is_said_at_the_solve(solves_are_played):
    """Where a coarse grid has ten times as much, or no more than the target is there; and nothing where all is well."""
    for problem, cells, words, helps in (
        (replace(car(), steps=8), (12, 12, 12), '"hji"|more than the target', "more cells: "),
        (line(steps=3), (4,), "more than the target", "more cells: "),
    ):
        with pytest.warns(ResolutionWarning, match=words) as seen:
            made = sdhj.solve(problem, sdhj.Certified(cells=cells), progress=False)
        message = str(seen[0].message)
        assert "does not mean that" in message and "table.explain" in message and helps in message
        assert " x ".join(map(str, made.shape)) in message
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sdhj.solve(line(steps=3), sdhj.Certified(cells=[40]), progress=False)
        sdhj.solve(replace(car(), steps=8), sdhj.Certified(cells=(12, 12, 12)), progress=False, play=False)


@pytest.mark.slow
def test_a_state_that_may_be_measured_in_a_cell_that_is_not_certified():
    """Its own cell is certified, and what fails is of the cell where it may be measured; with a scanty table, too."""
    told = table(line(sensing=sdhj.Sensing(0.3, memory=False), steps=2), 40)
    places = np.linspace(0.05, 9.95, 199)[:, None]
    near = (told.steps_to_go(places, 0) <= 2) & ~told.contains(places)
    assert near.any()
    for q in places[near]:
        says = told.explain(q)
        assert not says.inside and "be measured, or predicted" in says.says
        assert all(one.by or "certified" in one.says for one in says.failures) and says.helps
        at = float(says.says.split("[")[1].split("]")[0])
        assert abs(at - q[0]) <= 0.3 + 1e-9 and told.steps_to_go(np.array([[at]]), 0)[0] > 2
