"""`explain` of a table on a grid, on a line where each answer is known by hand, and against what the table answers."""

import numpy as np
import pytest
import zoo
from zoo import interval_problem, torus_problem

import sdhj


def line(**changed):
    """The run of the zoo, with fine nodes."""
    return zoo.run(**{"grid": sdhj.Grid([0.0], [10.0], [201], names=["x"]), "steps": 2} | changed)


@pytest.mark.parametrize("method", ["hji", "lax"])
def test_what_keeps_a_state_out_is_named(method):
    table = sdhj.solve(line(), method, play=False)
    assert "The state is off" in str(table.explain([11.0]))
    assert "unsafe set 'post', whose" in table.explain([3.1]).says
    assert "is 0.4 > 0" in table.explain([5.5], 0, 0).says
    told = table.explain([5.5], 0, 1)  # input 1 leads to [6.25, 6.75], in the goal
    assert told.inside and told.says.startswith("In the tube for step 0 with 1 step to go") and "[1]" in told.says
    assert [(one.input, one.by) for one in told.failures] == [(0, "image")]
    told = table.explain([4.7], 0, 1)  # to [5.45, 5.95] at best, .45 short of the goal that begins at 5.9
    assert not told.inside and [(one.input, one.by) for one in told.failures] == [(1, "image"), (0, "image")]
    assert [one.short for one in told.failures] == pytest.approx([-0.45, -1.45], abs=0.05)
    assert len(told.helps) == 1 and "within 2 steps" in told.helps[0]
    assert table.contains([[4.7]], start=0, within=2)[0] and not table.contains([[4.7]], start=0, within=1)[0]
    slow, fast = sorted(table.explain([2.1], 0, 2).failures, key=lambda one: one.input)
    assert (slow.by, fast.by) == ("image", "post") and "it may meet post" in fast.says
    slow, fast = table.explain([9.9], 0, 1).failures
    assert slow.by == fast.by == "the upper end of x"


def test_for_ever_no_steps_are_named():
    problem = line(target=None, steps=None)
    table = sdhj.solve(problem, sdhj.Certified(cells=[100]), play=False)
    told = table.explain([2.5])  # standing still it is pushed into the post some day
    assert not told.inside and "proved at these cells" in told.says


@pytest.mark.parametrize("make", [interval_problem, torus_problem])
def test_an_explanation_agrees_with_the_table(make, rng):
    table = sdhj.solve(make(), play=False)
    for q in rng.uniform(table.grid.lower, table.grid.upper, (40, table.grid.ndim)):
        told = table.explain(q, 1, 2)
        assert told.inside == table.contains(q[None], start=1, within=2)[0]
        if told.failures and told.inside:
            safe = set(range(len(table.problem.inputs))) - {one.input for one in told.failures}
            assert safe <= set(np.flatnonzero(table.batch(q[None], 1, 2).safe[0]).tolist())
        assert all(one.short <= 0 and str(one.input) in str(told) for one in told.failures[:3])


@pytest.mark.parametrize(("wrong", "what"), [([1.0, 2.0], "shape"), ([np.nan], "NaN")])
def test_what_cannot_be_asked(wrong, what):
    with pytest.raises(ValueError, match=what):
        sdhj.solve(interval_problem(), play=False).explain(wrong)
