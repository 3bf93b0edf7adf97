"""Promised means promised: from every state that a certified table contains some input is, by every measure of it."""

from dataclasses import replace

import numpy as np
import pytest
from fleet import FLEET
from robots import car, random_robot

import sdhj

DRAWN = 20_000


def ended(problem, end):
    """The problem without its target, with such ends on all bounded axes."""
    grid, target = problem.grid, problem.target
    ends = [("unsafe", "unsafe") if one else end for one in grid.periodic]
    return replace(problem, grid=replace(grid, ends=ends), target=None if "safe" in end else target)


def drawn_robots(end, seeds):
    return {
        f"random {seed}, {end}": (lambda seed=seed: ended(random_robot(seed).problem(), end), None) for seed in seeds
    }


ROBOTS = {
    "car": (car, (24, 24, 24)),
    "car, stays": (lambda: ended(car(), ("safe", "safe")), (24, 24, 24)),
    **drawn_robots(("unsafe", "unsafe"), range(8)),
    **drawn_robots(("wall", "wall"), range(4)),
    **drawn_robots(("safe", "unsafe"), range(4)),
    "crossing": (FLEET["crossing"]().problem, (44, 24, 28)),
    "air3d": (FLEET["air3d"]().problem, (52, 40, 36)),
}


@pytest.mark.parametrize("name", ROBOTS)
def test_every_state_that_is_contained_has_a_promised_input(name):
    build, cells = ROBOTS[name]
    problem = build()
    table = sdhj.solve(problem, sdhj.Certified(cells or (20,) * problem.grid.ndim, parts=4), progress=False, play=False)
    rng, grid, seen = np.random.default_rng(0), problem.grid, 0
    drawn = rng.uniform(grid.lower, grid.upper, (DRAWN, grid.ndim))
    for axis in range(grid.ndim):  # many near the ends
        some = rng.integers(0, DRAWN, DRAWN // 4)
        end = np.where(rng.random(some.size) < 0.5, grid.lower[axis], grid.upper[axis])
        width = rng.uniform(0.0, 0.1, some.size) * (grid.upper[axis] - grid.lower[axis])
        drawn[some, axis] = np.clip(
            end + np.where(end > grid.lower[axis], -width, width), grid.lower[axis], grid.upper[axis]
        )
    for step in {0, table.steps // 2, table.steps - 1}:
        within = table.steps - step
        states = drawn[table.contains(drawn, start=step, within=within)]
        batch = table.batch(states, step, within)
        ahead = problem.stays | (batch.steps_to_go > 0)  # who is in the target has arrived
        seen += len(states)
        assert (batch.steps_to_go >= 0).all() and batch.promised[ahead].all()
        assert (batch.margins[batch.safe] <= 0).all() and np.isinf(batch.margins[~batch.safe]).all()
        assert batch.safe[np.flatnonzero(ahead), batch.best[ahead]].all()
    assert seen > 100
