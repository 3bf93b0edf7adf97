"""Bounds that are missing, do not fit, or are refuted by a look at the functions, are refused."""

import dataclasses

import naive_certified as naive
import numpy as np
import pytest
from toys import interval_problem, torus_problem, unicycle_problem

import sdhj
from sdhj.certified import LipschitzBounds
from sdhj.certified.bounds import Bounds

UNICYCLE = LipschitzBounds(
    dynamics=np.array([[0, 0, 1.0], [0, 0, 1.0], [0, 0, 0]]), sets={"target": [1.0, 1.0], "pillar": [1.0, 1.0]}
)


def certified(problem, **options):
    return sdhj.solve(problem, sdhj.Certified(**options), progress=False)


def opaque(part):
    """A set whose function intervals do not go through, as an interpolator's."""
    return dataclasses.replace(part, level_set=lambda points, t: part.level_set(np.array(points, dtype=float), t))


def test_nothing_is_asked_for_where_intervals_go_through():
    assert certified(interval_problem(), cells=[80]).fraction(start=0, within=5) > 0.5


def test_bounds_are_asked_for():
    problem = interval_problem()
    hidden = dataclasses.replace(problem, unsafe=tuple(opaque(part) for part in problem.unsafe))
    with pytest.raises(
        ValueError, match=r"level set of 'wall' cannot be bounded .* a conversion to a plain array.*Lip"
    ):
        certified(hidden, cells=[40])
    both = [
        certified(given, cells=[80], bounds=LipschitzBounds(sets={"wall": [1.0]})).bits(start=0, within=5)
        for given in (problem, hidden)
    ]
    assert np.array_equal(*both)
    drift = sdhj.Dynamics([[1.0]], lambda q, u: np.array(q, dtype=float) * 0.1, [[1.0]], [0.1])
    with pytest.raises(ValueError, match="the dynamics of 'problem' cannot be bounded"):
        certified(dataclasses.replace(problem, dynamics=drift), cells=[40])
    with pytest.raises(ValueError, match="dynamics of LipschitzBounds must be 3 x 3 finite numbers"):
        certified(unicycle_problem(), bounds=LipschitzBounds(np.eye(2), UNICYCLE.sets))
    with pytest.raises(ValueError, match="2 finite numbers"):
        certified(
            unicycle_problem(),
            bounds=LipschitzBounds(UNICYCLE.dynamics, {"target": [1.0], "pillar": [1, 1]}),
        )


def test_a_target_that_is_stated_is_asked_at_every_step():
    """That it stands still is promised by nobody: one set for each start, all alike."""
    problem = interval_problem(steps=3)
    hidden = dataclasses.replace(problem, target=opaque(problem.target))
    one, other = (
        certified(given, cells=[80], bounds=LipschitzBounds(sets={"target": [1.0]})) for given in (problem, hidden)
    )
    assert len(one.index) == 4 and len(other.index) == 10
    for start in range(4):
        assert np.array_equal(one.bits(start=start, within=2), other.bits(start=start, within=2))


def test_an_enclosure_of_ones_own():
    problem = interval_problem()
    part = opaque(problem.unsafe[0])
    part.level_set.function.enclosure = lambda low, high, t0, t1: (3.0 - high[:, 0], 3.0 - low[:, 0])
    own = certified(dataclasses.replace(problem, unsafe=(part,)), cells=[80])
    assert np.array_equal(own.bits(start=0, within=5), certified(problem, cells=[80]).bits(start=0, within=5))


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (
            {"sets": {"pillar": [0.9, 1.0]}},
            "'pillar' changes by .* along the axis 'x'.* bound 0.9 allows .* at least 1",
        ),
        ({"sets": {"target": [1.0, 0.0]}}, "'target' changes by .* along the axis 'y'.* bound 0 allows"),
        ({"sets": {"pillars": [1.0, 1.0]}}, "bounds for 'pillars', but the problem's sets are 'target', 'pillar'"),
        ({"dynamics": 0.9}, "velocity along 'x' under input 0 changes by .* along the axis 'theta'.* give a bound"),
    ],
)
def test_bounds_that_a_look_at_the_functions_refutes(change, told):
    sets = dict(UNICYCLE.sets) | change.get("sets", {})
    bounds = LipschitzBounds(np.array(UNICYCLE.dynamics) * change.get("dynamics", 1.0), sets)
    with pytest.raises(ValueError, match=told):
        certified(unicycle_problem(), bounds=bounds)


def test_a_gain_that_depends_on_the_state_counts_in_full():
    """d/dx (v x) is as large as v gets: 0.1."""
    problem = interval_problem()
    dynamics = sdhj.Dynamics([[0.0]], lambda q, u: 0.0 * q, lambda q: q[:, :, None], [0.1])
    problem = dataclasses.replace(problem, dynamics=dynamics)
    for bound in (0.1, 0.099):
        bounds = LipschitzBounds([[bound]], {"target": [1.0], "wall": [1.0]})
        if bound == 0.1:
            assert certified(problem, cells=[40], bounds=bounds).bits(start=0, within=0).any()
        else:
            with pytest.raises(ValueError, match=r"bound 0\.099 allows"):
                certified(problem, cells=[40], bounds=bounds)


@pytest.mark.parametrize("part", ["level set", "velocity"])
def test_a_function_may_jump_at_the_seam(part, rng):
    """A set written for angles as plain numbers ends where the axis closes; tubes reach across, and are cut there."""
    jump = part == "level set"
    problem = sdhj.ReachAvoidProblem(
        sdhj.Grid([-np.pi], [np.pi], [40], [True]),
        sdhj.Dynamics(
            [[-1.0], [1.0]], lambda q, u: u + (0 if jump else 0.1) * q, lambda q: np.ones((len(q), 1, 1)), [0.1]
        ),
        sdhj.TargetSet((0,), lambda q, t: np.abs(q[:, 0]) - 1.0),
        (sdhj.UnsafeSet((0,), lambda q, t: np.abs(q[:, 0] - (2.9 if jump else 0.0)) - 0.2 + 3.0 * (not jump)),),
        0.2,
        6,
    )
    for bounds in (None, LipschitzBounds(dynamics=[[0.1]], sets={"target": [1.0], "unsafe": [1.0]})):
        table = certified(problem, cells=[100], bounds=bounds)
        assert table.fraction(start=0, within=6) > 1.5 * table.fraction(start=0, within=0)
        if jump:  # from the far side of the disk both ways lead through it or are too long
            assert not table.contains([[2.9], [2.75]], start=0, within=6).any()
        naive.assert_runs_succeed(table, naive.states_in(table, rng, 2000), rng)


@pytest.mark.parametrize("slope", [1.0, -1.0])
def test_a_box_across_the_seam_has_values_of_both_sides(slope):
    problem = torus_problem()
    part = sdhj.UnsafeSet((1,), lambda q, t: slope * q[:, 0])
    least, most = Bounds(problem, LipschitzBounds()).level(part, np.array([[3.0]]), np.array([[3.5]]), 0.0, 0.0)
    np.testing.assert_allclose([least[0], most[0]], [-np.pi, np.pi], rtol=1e-15)


def test_bounds_of_two_sets_of_one_name_are_not_told_apart():
    problem = interval_problem(steps=1)
    steep = sdhj.UnsafeSet((0,), lambda p, t: 5.0 * (3.5 + p[:, 0]), name="wall")
    problem = dataclasses.replace(problem, unsafe=(*problem.unsafe, steep))
    with pytest.raises(ValueError, match="two of the sets have one name"):
        certified(problem, cells=[40], bounds=LipschitzBounds(sets={"target": [1.0], "wall": [1.0]}))
