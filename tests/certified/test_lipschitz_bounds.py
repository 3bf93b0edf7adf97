"""Bounds that are missing, do not fit, or are refuted by a look at the functions, are refused."""

import dataclasses

import numpy as np
import pytest
from toys import interval_problem, unicycle_problem

import sdhj
from sdhj.certified import LipschitzBounds

UNICYCLE = LipschitzBounds(
    dynamics=np.array([[0, 0, 1.0], [0, 0, 1.0], [0, 0, 0]]), sets={"target": [1.0, 1.0], "pillar": [1.0, 1.0]}
)


def certified(problem, **options):
    return sdhj.solve(problem, sdhj.Certified(**options), progress=False)


def test_bounds_are_asked_for():
    with pytest.raises(ValueError, match="no Lipschitz bounds for the sets 'target', 'wall': give"):
        certified(interval_problem())
    with pytest.raises(ValueError, match="depend on the state"):
        certified(unicycle_problem(), bounds=LipschitzBounds(sets=UNICYCLE.sets))
    with pytest.raises(ValueError, match="dynamics of LipschitzBounds must be 3 x 3 finite numbers"):
        certified(unicycle_problem(), bounds=LipschitzBounds(np.eye(2), UNICYCLE.sets))
    with pytest.raises(ValueError, match="2 finite numbers"):
        certified(
            unicycle_problem(),
            bounds=LipschitzBounds(UNICYCLE.dynamics, {"target": [1.0], "pillar": [1, 1]}),
        )
    with pytest.raises(ValueError, match="more parts"):
        certified(unicycle_problem(), bounds=LipschitzBounds(np.full((3, 3), 9.0), UNICYCLE.sets), parts=1)


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
def test_no_lipschitz_bound_holds_across_a_jump_at_the_seam(part):
    """A set written for angles as plain numbers ends where the axis closes; boxes of tubes reach across."""
    jump = part == "level set"
    problem = sdhj.ReachAvoidProblem(
        sdhj.Grid([-np.pi], [np.pi], [40], [True]),
        sdhj.Dynamics(
            [[-1.0], [1.0]], lambda q, u: u + (0 if jump else 0.1) * q, lambda q: np.ones((len(q), 1, 1)), [0.1]
        ),
        sdhj.TargetSet((0,), lambda q, t: np.abs(q[:, 0]) - 1.0),
        (sdhj.UnsafeSet((0,), lambda q, t: np.abs(q[:, 0] - (2.9 if jump else 0.0)) - 0.2 + 3.0 * (not jump)),),
        0.2,
        2,
    )
    bounds = LipschitzBounds(dynamics=[[0.1]], sets={"target": [1.0], "unsafe": [1.0]})
    with pytest.raises(ValueError, match=f"{part}.*jumps by .* periodic axis 'x1' closes"):
        certified(problem, cells=[50], bounds=bounds)


def test_a_set_that_jumps_at_the_seam_at_some_times_only_is_refused():
    """Its centre is at the middle of the axis at every t_k, where the distance that nobody wrapped is periodic."""
    part = sdhj.UnsafeSet(
        (0,), lambda p, t: np.abs(p[:, 0] - 2.9 * np.sin(np.pi * t)) - 0.3, rate=2.9 * np.pi, name="disk"
    )
    target = sdhj.TargetSet((0,), lambda p, t: np.maximum(2.0 - np.abs(p[:, 0]), 0.5 - t))
    dynamics = sdhj.Dynamics([[0.0]], [[0.0]], [[1.0]], [0.1])
    problem = sdhj.ReachAvoidProblem(sdhj.Grid([-np.pi], [np.pi], [64], [True]), dynamics, target, (part,), 1.0, 1)
    bounds = LipschitzBounds(sets={"target": [1.0], "disk": [1.0]})
    with pytest.raises(ValueError, match=r"'disk' at t = .* jumps by .* periodic axis 'x1' closes"):
        certified(problem, cells=[400], bounds=bounds)


def test_bounds_of_two_sets_of_one_name_are_not_told_apart():
    problem = interval_problem(steps=1)
    steep = sdhj.UnsafeSet((0,), lambda p, t: 5.0 * (3.5 + p[:, 0]), name="wall")
    problem = dataclasses.replace(problem, unsafe=(*problem.unsafe, steep))
    with pytest.raises(ValueError, match="two of the sets have one name"):
        certified(problem, cells=[40], bounds=LipschitzBounds(sets={"target": [1.0], "wall": [1.0]}))
