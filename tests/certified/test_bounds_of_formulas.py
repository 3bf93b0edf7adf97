"""Bounds on formulas of robots: what is easily bounded wrongly is promised by no method.

That functions are read as NumPy computes them, promises/test_tracing says, and that bounds of whatever is read hold,
formulas/test_random_graphs and certified/check/test_two_libraries.
"""

import awkward_functions as awkward
import numpy as np
import pytest
import zoo

import sdhj


def test_a_spike_between_the_samples_is_seen():
    """A wall of 2 mm, steeper than anyone would state: no cell that it may be met from is certified."""
    spike = sdhj.UnsafeSet((0,), lambda p, t: 40.0 * np.abs(p[:, 0] - 1.2345) - 0.04, name="spike")
    problem = zoo.line(
        (-1.0, 1.0),
        0.1,
        grid=sdhj.Grid([0.0], [3.0], [31]),
        target=zoo.goal(2.5, 0.3),
        unsafe=[spike],
        delta=0.2,
        steps=10,
    )
    table = sdhj.solve(problem, sdhj.Certified(cells=[150]), progress=False)
    assert table.contains([[1.3]], start=0, within=10) and not table.contains([[1.2]], start=0, within=10)


def alone(function, states):
    """The values of a function, each state on its own."""
    with np.errstate(all="ignore"):
        return np.array([np.asarray(function(q[None].copy()), dtype=np.float64)[0] for q in states])


def problem_with(function):
    """A cart that must stay clear of a set of its place and its speed."""
    awkward_set = sdhj.UnsafeSet((0, 1), lambda p, t: function(p), name="awkward")
    return zoo.cart(lower=[-1.0, -1.0], upper=[1.0, 1.0], nodes=9, unsafe=[awkward_set], steps=2)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::sdhj.ResolutionWarning")
def test_what_is_easily_bounded_wrongly_is_refused_or_right(rng):
    """Neither method promises a state that is in the set."""
    solved, anywhere = 0, rng.uniform(-1, 1, (1000, 2))
    for name, function in awkward.FUNCTIONS.items():
        with np.errstate(all="ignore"):
            try:
                problem = problem_with(function)
                tables = [sdhj.solve(problem, method, progress=False, play=False) for method in METHODS]
            except ValueError:
                continue  # refused, as test_tracing says
            for table, q in zip(tables, (problem.grid.points(), anywhere), strict=True):
                assert not (table.contains(q, start=0, within=0) & (alone(function, q) <= 0.0)).any(), name
        solved += 1
    assert solved > 15


METHODS = ("hji", sdhj.Certified(cells=[8, 8], parts=2))
