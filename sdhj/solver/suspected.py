"""What a problem may have got wrong without being invalid: a sign, or the unit or the ends of an angle."""

import math
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from sdhj.common.findings import Finding
from sdhj.kernels import FloatArray
from sdhj.problem.grid import SMALL, Grid
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sets import TargetSet, UnsafeSet

TURNS = {"radians": 2.0 * math.pi, "degrees": 360.0}
MOST_TURNS = 4  # of an axis in radians; from 30 degrees on an axis in degrees has more
TRIED_STATES = 100  # at which functions are compared with themselves a turn on
ALIKE = 1e-9  # relative to the values, or absolute below one


def suspicions(problem: ReachAvoidProblem) -> Iterator[Finding]:
    """Yield a `Finding` for each thing that is unusual in a problem, with what to do if it was not meant.

    The findings are a target whose level-set function may have the wrong sign, and axes that may be angles with wrong
    ends or units. No warning is given.
    """
    yield from _wrong_sign_of_target(problem)
    for axis in range(problem.grid.ndim):
        yield from _angle(problem, axis)


def _wrong_sign_of_target(problem: ReachAvoidProblem) -> Iterator[Finding]:
    """Yield a finding where the target's level-set function may have the wrong sign.

    So it may where the target fills more than half of its axes' grid, but not all of it, and has all nodes at the ends
    of bounded axes. Judged at step 0, on at most about `SMALL` nodes. It yields nothing without a target, and where all
    of the target's axes are periodic.
    """
    grid = problem.grid.subgrid(problem.target.axes)
    if problem.has_no_target or all(grid.periodic):
        return
    if grid.size > SMALL:  # fewer nodes show it as well
        most = int(SMALL ** (1 / grid.ndim))
        grid = Grid(grid.lower, grid.upper, [min(n, most) for n in grid.shape], grid.periodic)
    inside = problem.target.level_set(grid.points(), problem.time(0)).reshape(grid.shape) <= 0
    ends = [inside.take(end, axis) for axis in range(grid.ndim) if not grid.periodic[axis] for end in (0, -1)]
    if 0.5 < (share := grid.fraction(inside)) and not inside.all() and all(end.all() for end in ends):
        yield Finding(
            f"the target {problem.target.name!r} is all but a region in the midst of its axes, {share:.1%} of them: ",
            share,
            "a level-set function is negative inside the target; if that region was meant, turn the sign",
        )


def _angle(problem: ReachAvoidProblem, axis: int) -> Iterator[Finding]:
    """Yield findings of an axis that may be an angle, because all functions repeat after a whole turn, of 2 pi or 360.

    They are: it is many turns of 2 pi long; it is a turn long and has ends, though neither `periodic` nor `ends` was
    given; an input moves the state along it by more than a turn in an interval.
    """
    grid = problem.grid
    length, spacing, name = grid.upper[axis] - grid.lower[axis], grid.spacing[axis], grid.names[axis]
    if length > MOST_TURNS * TURNS["radians"] and _repeats(problem, axis, TURNS["radians"]):
        yield Finding(
            f"the functions of the problem repeat every 2 pi along {name}, which has {length / 2 / math.pi:.3g} turns "
            f"from {grid.lower[axis]:g} to {grid.upper[axis]:g}: ",
            length / 2 / math.pi,
            "if it is in degrees, convert it by np.deg2rad where it enters a sine or cosine",
        )
    for unit, turn in TURNS.items():
        if not math.isclose(length, turn, abs_tol=1.01 * spacing) or not _repeats(problem, axis, turn):
            continue
        if grid.ends_not_given and not grid.periodic[axis]:
            yield Finding(
                f"the axis {name} is a whole turn, after which the functions of the problem repeat, but it has ends, "
                "beyond which the robot has failed: ",
                1.0,
                f'if it is an angle, give periodic=, True for {name}; if it has stops, give ends="unsafe" or "wall"',
            )
        speeds = problem.remembered("speeds at some states", partial(_fastest, problem))
        if (turns := float(speeds[axis]) * problem.delta / turn) > 1:
            yield Finding(
                f"some input moves {name} by {turns:.3g} turns within one interval of {problem.delta:g} s: ",
                turns,
                f"its rates have to be in {unit} per second, and delta in seconds",
            )


def _fastest(problem: ReachAvoidProblem) -> FloatArray:
    """The greatest speed along each axis at `_states` under any input: (ndim,), in the axes' units per second.

    v is the upper vertex of its box, and the time that of step 0. Where velocities do not depend on the state, one
    state is enough.
    """
    states = _states(problem)[: 1 if problem.dynamics.stateless else None]
    return np.max([np.abs(function(states)).max(axis=0) for function in _velocities(problem)], axis=0)


def _repeats(problem: ReachAvoidProblem, axis: int, turn: float) -> bool:
    """Whether all functions that read an axis have the same values, to `ALIKE`, a `turn` further on, and some change
    along it.

    Judged at `_states`. turn : in the axis's unit. False where a function is undefined a turn on, and for problems with
    black boxes, of which nothing is known off the grid.
    """
    if problem.opaque:
        return False
    states, depends = _states(problem), False
    further, elsewhere = states.copy(), states.copy()
    further[:, axis] += turn
    elsewhere[:, axis] = np.roll(states[:, axis], 1)
    together = np.concatenate([states, further, elsewhere])
    for function in _functions(problem, axis):
        try:
            here, there, other = np.split(function(together), 3)
        except (ValueError, ArithmeticError):  # undefined a turn on
            return False
        scale = 1.0 + np.abs(here)
        if (np.abs(there - here) > ALIKE * scale).any():
            return False
        depends |= bool((np.abs(other - here) > ALIKE * scale).any())
    return depends


def _states(problem: ReachAvoidProblem) -> FloatArray:
    """Random states on the grid, (`TRIED_STATES`, ndim); always the same."""
    grid = problem.grid
    return np.random.default_rng(0).uniform(grid.lower, grid.upper, (TRIED_STATES, grid.ndim))


def _functions(problem: ReachAvoidProblem, axis: int) -> Iterator[Callable[[FloatArray], FloatArray]]:
    """Yield the functions of states (M, ndim) that may depend on an axis.

    They are the velocities under each input, (M, ndim), if the dynamics read the axis, and the level-set functions,
    (M,), of the target and of unsafe sets that have it among their axes.
    """
    if problem.dynamics.reads[:, axis].any():
        yield from _velocities(problem)
    for part in problem.all_sets:
        if axis in part.axes:
            yield partial(_level_set_values, problem, part)


def _velocities(problem: ReachAvoidProblem) -> Iterator[Callable[[FloatArray], FloatArray]]:
    """Yield for each input the function of states (M, ndim) that is the velocity at the first step, (M, ndim), per
    second.

    v is the upper vertex of its box.
    """
    t, dynamics = problem.time(0), problem.dynamics
    for j in range(len(problem.inputs)):
        yield partial(dynamics.velocity_at, j=j, v=dynamics.bounds_at(j, t), t=t)


def _level_set_values(problem: ReachAvoidProblem, part: TargetSet | UnsafeSet, states: FloatArray) -> FloatArray:
    """Level-set values (M,) of a set at states (M, ndim) at the time of step 0.

    The states are not wrapped into the grid.
    """
    return np.asarray(part.level_set(states.take(part.axes, axis=1), problem.time(0)))  # not wrapped into the grid
