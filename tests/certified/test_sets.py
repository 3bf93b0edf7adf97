"""The method and its options, and what its tables promise: runs, whatever the adversary does."""

import dataclasses
import math

import naive_certified as naive
import numpy as np
import pytest
from naive_certified import SMALL

import sdhj

pytestmark = pytest.mark.slow  # the arm's own kernels are compiled


def test_runs_from_certified_states_succeed(small, rng):
    naive.assert_runs_succeed(small, naive.states_in(small, rng, 20000), rng)


def test_runs_from_edges_of_cells_succeed(small, rng):
    """With adversaries at their bounds the states stay on edges of cells, up to rounding."""
    edges = [axis.edges() for axis in small.axes]
    states = np.stack([rng.choice(own[:-1], 40000) for own in edges], axis=1)
    states = states[small.contains(states, start=0, within=2)]
    assert len(states) > 1000
    naive.assert_runs_succeed(small, states, rng, pieces=1, fine=1)


def test_outside_is_said(small):
    far = np.array([[0.0, 0.0, 1.0, 0.0]])
    assert not small.contains(far, start=0, within=2).any()
    assert not small.certified_inputs(far, 0, 2).any()
    with pytest.raises(ValueError, match="NaN"):
        small.contains(np.full((1, 4), np.nan), start=0, within=2)
    with pytest.raises(ValueError, match=r"shape \(M, 4\)"):
        small.contains(np.zeros((1, 3)), start=0, within=2)
    with pytest.raises(ValueError, match="start"):
        small.contains(far, start=3, within=0)
    with pytest.raises(ValueError, match="within"):
        small.contains(far, start=0, within=-1)


def test_angles_wrap(small, rng):
    states = naive.states_in(small, rng, 500)
    turned = states + np.array([2 * np.pi, -2 * np.pi, 0.0, 0.0])
    assert small.contains(turned, start=0, within=2).all()


def test_fractions_are_shares_of_volume(small, rng):
    grid = small.problem.grid
    states = rng.uniform(grid.lower, grid.upper, (100_000, 4))
    share = small.in_cells(states, 0, 2).mean()
    assert share == pytest.approx(small.fraction(start=0, within=2), abs=4 * math.sqrt(0.25 / 100_000))


@pytest.mark.slow
def test_a_case_study_that_was_changed_is_proved_as_any_robot(rng):
    """The arm's own proof would be of what the recipe says: with a target, without the set added here."""
    arm = sdhj.arm_case_study(**SMALL)
    wall = sdhj.UnsafeSet((0,), lambda p, t: np.abs(p[:, 0]) - 0.3, name="wall")
    still = sdhj.arm_case_study(**(SMALL | {"nodes": 9, "u_max": 0.5, "v_d_max": 0.1, "v_p_max": 0.1, "steps": 1}))
    for changed in (dataclasses.replace(still, target=None), dataclasses.replace(arm, unsafe=(*arm.unsafe, wall))):
        table = sdhj.solve(changed, sdhj.Certified(cells=(24, 24, 10, 10), parts=4), progress=False)
        assert table.proof.kind == "enclosed" and table.fraction(start=0, within=1) > 0.001
        states = naive.states_in(table, rng, 600)
        assert (changed.unsafe_value(states, 0.0) > 0).all()
        naive.assert_runs_succeed(table, states, rng, pieces=4)
    assert (np.abs(states[:, 0]) > 0.3).all()
