"""One sampling interval of the boat: its constructs against runs, and what the pictures hold."""

import numpy as np
import pytest
from boat import (
    OneStepGame,
    boat_problem,
    one_step_game,
    play,
)


@pytest.fixture(scope="module")
def boat() -> OneStepGame:
    return one_step_game(boat_problem(nodes=61))


@pytest.mark.parametrize(
    "start", [(-0.42, 0.30), (-0.42, 0.03), (-0.60, 0.68), (-0.2, 0.2), (-0.3, -0.2), (-0.1, -0.4)]
)
def test_the_cost_bounds_what_winds_can_do(boat, start):
    """V^j is a supremum: no wind does worse, some wind nearly attains it, both up to a scheme error of under a cell."""
    value = boat.problem.grid.interpolate(boat.cost, np.array([start]))[0]
    worst = play(boat.problem, start).costs.max()
    cell = max(boat.problem.grid.spacing)
    assert value - cell < worst < value + cell


def test_reach_avoid_is_reach_and_avoid(boat):
    apart = np.maximum(boat.reach, boat.avoid)
    assert np.abs(apart - boat.cost).max() < max(boat.problem.grid.spacing)
    assert (boat.cost <= 0).sum() < (boat.reach <= 0).sum()
