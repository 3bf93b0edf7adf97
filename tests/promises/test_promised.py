"""Promised means promised: from every state that a certified table contains some input is, by every measure of it."""

from dataclasses import replace

import forged_robots
import numpy as np
import pytest
from fleet import FLEET
from naive_certified import CIRCLE, LINE, SMALL, STILL, assert_all_that_follows
from parameters import but_slow
from zoo import car, random_robot

import sdhj

DRAWN, DRAWN_OF_SMALL = 6_000, 2_000
DRAWN_FAST = [(6, ("unsafe", "unsafe")), (1, ("wall", "wall")), (1, ("safe", "unsafe"))]


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


# one of each kind of ends, among them some of three axes and some with time; what else is drawn is slow
FAST = {"car", "car, stays", "crossing", *(f"random {seed}, {end}" for seed, end in DRAWN_FAST)}

SHAKY = sdhj.Sensing((0.005, 0.005, 0.002, 0.002), 0.005, memory=False)
ARMS = {
    "arm": (lambda: sdhj.arm_case_study(**SMALL), (48, 48, 16, 16)),
    "arm among disks": (
        lambda: sdhj.arm_case_study(**(SMALL | {"obstacles": [STILL, LINE, CIRCLE]})),
        (48, 48, 16, 16),
    ),
    "arm that errs": (lambda: replace(sdhj.arm_case_study(**SMALL), sensing=SHAKY), (64, 64, 32, 32)),
}


def states_of(grid, rng, count):
    """Random states, many of them near the ends."""
    drawn = rng.uniform(grid.lower, grid.upper, (count, grid.ndim))
    for axis in range(grid.ndim):
        some = rng.integers(0, count, count // 4)
        end = np.where(rng.random(some.size) < 0.5, grid.lower[axis], grid.upper[axis])
        width = rng.uniform(0.0, 0.1, some.size) * (grid.upper[axis] - grid.lower[axis])
        drawn[some, axis] = np.clip(
            end + np.where(end > grid.lower[axis], -width, width), grid.lower[axis], grid.upper[axis]
        )
    return drawn


def contained(table, count):
    """How many of some random states are contained, each with a promised input unless it has arrived."""
    rng, problem, grid, seen = np.random.default_rng(0), table.problem, table.grid, 0
    drawn = states_of(grid, rng, count)
    for step in {0, table.steps // 2, table.steps - 1}:
        within = table.steps - step
        states = drawn[table.contains(drawn, start=step, within=within)]
        if problem.sensing:  # what is asked about is a prediction
            off = table.proof.prediction_error * rng.choice([-1.0, 0.0, 1.0], states.shape)
            states = grid.clipped(states + off, "holds", "fails")
        batch = table.batch(states, step, within)
        ahead = problem.has_no_target | (batch.steps_to_go > 0)  # who is in the target has arrived
        seen += len(states)
        assert (batch.steps_to_go >= 0).all() and batch.promised[ahead].all()
        assert (batch.margins[batch.safe] <= 0).all() and np.isinf(batch.margins[~batch.safe]).all()
        assert batch.safe[np.flatnonzero(ahead), batch.best[ahead]].all()
    return seen


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in FAST else pytest.mark.slow) for name in ROBOTS]
)
def test_every_state_that_is_contained_has_a_promised_input(name):
    build, cells = ROBOTS[name]
    problem = build()
    method = sdhj.Certified(cells or (12,) * problem.grid.ndim, parts=3)
    assert contained(sdhj.solve(problem, method, progress=False, play=False), DRAWN) > 100


FEW_CELLS = [name for name in forged_robots.ROBOTS if name not in ("windy", "rail")]
PURSUED = ["pursued", "pursued where it must not go up", "pursued without a target"]
LONG = ["turning", "standing", "standing soon", "standing unsafely", "noisy", "bent rail", "cornered", "plane"]
LONG += ["to the left", *PURSUED]


def small(name):
    if name not in ARMS:
        return forged_robots.solved(name)
    build, cells = ARMS[name]
    return sdhj.solve(build(), sdhj.Certified(cells, parts=4), progress=False, play=False)


@pytest.mark.parametrize("name", but_slow([*forged_robots.ROBOTS, *ARMS], *PURSUED, *ARMS))
def test_of_small_robots_too(name):
    """All whose files are forged elsewhere: ends of all kinds, black boxes, sensing, for ever; and the arm."""
    assert contained(small(name), DRAWN_OF_SMALL) > 0


@pytest.mark.parametrize("name", but_slow(FEW_CELLS, *LONG))
def test_sets_and_inputs_are_all_that_follows(name):
    """From the moves and clear inputs of their tables, by plain loops, and no more."""
    assert_all_that_follows(small(name))
