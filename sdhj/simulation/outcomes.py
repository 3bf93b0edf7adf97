"""The outcomes of a run, and the simulation of one interval, which checks for an outcome after every substep.

Between two substeps something fast may pass (`_fast_sets`). Where bounds over the straight way of a state leave open
whether it is met, the middle is looked at, and both halves in the same way.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from sdhj.common.checks import read_only_view, real_array
from sdhj.common.remembering import FloatArray
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sets import UnsafeSet
from sdhj.simulation.adversaries import SUBSTEPS, Adversary, Moment

OUTCOMES = ("reached", "collided", "left", "late", "off the grid")
REACHED, COLLIDED, LEFT, LATE, OFF = range(len(OUTCOMES))
UNDECIDED = -1
LOOKED_AHEAD = 4  # substeps
HALVINGS = 6  # of a substep, at most: 1,280 instants of an interval
FAST = 0.25  # of how deep a set is, in a substep: of slower ones at most half as much is cut off between two instants
DRAWN = 2048  # states at which that is found out


# Called after each substep with the moment it began, v (M, D), the new states (M, ndim) and their clearance (M,).
Watch = Callable[[Moment, FloatArray, FloatArray, FloatArray], None]


def play_interval(
    first: Moment, play: Adversary, watch: Watch | None, substeps: range = range(SUBSTEPS)
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """States (M, ndim), outcomes (M,) and last disturbances (M, D) of M runs after some substeps of an interval.

    With a delay it is called twice for an interval, and the numbers of the substeps go on: adversaries that decide at
    number 0 keep what they have decided.

    Outcomes are `COLLIDED`, `OFF`, past a safe end without a target `REACHED`, or `UNDECIDED`; runs that are decided go
    on until all are, but stop off the grid, where no velocity is known.
    """
    problem, inputs = first.problem, first.inputs
    # adversaries only read
    first = replace(first, **{name: read_only_view(value) for name, value in vars(first).items()})
    states, v, ended = first.states, first.previous, np.full(len(first.states), UNDECIDED)
    lowest, place = np.full(len(states), np.inf), problem.grid
    if substeps.start == 0 and any(one.inputs is not None for one in problem.unsafe):  # an input may be forbidden here
        lowest = problem.unsafe_value(problem.grid.clipped(states, "frees"), first.time, inputs)
    # found once for a problem, with the substep of the first interval that is played
    fast = problem.remembered("fast sets", lambda: _fast_sets(first))
    ahead = near = [_near(first, unsafe_set, states, first.time, len(substeps)) for unsafe_set in fast]
    for substep in substeps:
        gone = (substep - substeps.start) * first.duration
        now, left = first.time + gone, first.remaining - gone
        seen: Any = {"states": read_only_view(states), "previous": read_only_view(v)}
        moment = replace(first, substep=substep, time=now, remaining=left, **seen)
        v = _checked(play(moment), moment.bounds)
        moved = first.interval.advance(states, inputs, v, now, first.duration)
        gone_off = place.beyond(states, "fails", "frees")
        before, states = place.clipped(states, "frees"), np.where(gone_off[:, None], states, moved)
        met = place.clipped(states, "frees")  # nothing beyond a safe end is unsafe
        clearance = np.minimum(problem.unsafe_value(met, now + first.duration, inputs), lowest)
        lowest = np.full(len(states), np.inf)
        if (substep - substeps.start) % LOOKED_AHEAD == 0:
            near = [
                one & _near(first, unsafe_set, before, now, LOOKED_AHEAD, one)
                for unsafe_set, one in zip(fast, ahead, strict=True)
            ]
        for unsafe_set, one in zip(fast, near, strict=True):
            some = np.flatnonzero(one & (clearance > 0) & (ended == UNDECIDED))
            if some.size:
                way = before[some], met[some] - before[some], now, first.duration
                clearance[some] = np.minimum(clearance[some], _least_between(problem, unsafe_set, *way))
        # in this order: who meets a set in the substep in which it leaves the grid has collided
        ended[(ended == UNDECIDED) & (clearance <= 0)] = COLLIDED
        ended[(ended == UNDECIDED) & problem.grid.beyond(states, "fails")] = OFF
        if problem.has_no_target:
            ended[(ended == UNDECIDED) & problem.grid.beyond(states, "frees")] = REACHED
        if watch is not None:
            watch(moment, v, states, clearance)
        if (ended != UNDECIDED).all():
            break
    return states, ended, v


def _fast_sets(first: Moment) -> list[UnsafeSet]:
    """The unsafe sets that may pass a state between two substeps, unseen at both.

    In a substep g changes by more than `FAST` of max -g, or none of the random states looked at is in the set.
    """
    # the longest substep: what is found holds for all intervals, of which some may be short
    problem, rng = first.problem, np.random.default_rng(0)
    h = problem.sensing.hold(problem.delta)[0] / SUBSTEPS
    grid, found = problem.grid, list[UnsafeSet]()
    for unsafe_set in problem.unsafe:
        deepest = change = 0.0
        for step in {0, problem.most_steps // 2, problem.most_steps - 1}:
            points, t = rng.uniform(grid.lower, grid.upper, (DRAWN, grid.ndim)), problem.time(step)
            # at the greatest speed of each coordinate, in a random direction
            moved = points + h * problem.interval(step).speeds * rng.choice([-1.0, 1.0], points.shape)
            moved = np.where(grid.periodic, moved, np.clip(moved, grid.lower, grid.upper))
            before, after = problem.value_of(unsafe_set, points, t), problem.value_of(unsafe_set, moved, t + h)
            deepest, change = max(deepest, -before.min()), max(change, np.abs(after - before).max())
        if change > FAST * deepest or deepest == 0.0:
            found.append(unsafe_set)
    return found


def _near(
    first: Moment, unsafe_set: UnsafeSet, states: FloatArray, t: float, substeps: int, asked: FloatArray | None = None
) -> FloatArray:
    """Which of M runs, of those `asked`, an unsafe set may come to in so many substeps, by bounds: (M,)."""
    # by default of the runs under whose inputs the set is unsafe
    found = unsafe_set.counts(first.inputs) if asked is None else asked.copy()
    far, some = first.duration * substeps * first.interval.speeds, np.flatnonzero(found)
    start = first.problem.grid.clipped(states[some], "frees") - far
    times = t, t + first.duration * substeps
    found[some] = _may_meet(first.problem, unsafe_set, start, np.broadcast_to(2 * far, start.shape), times)
    return found


def _may_meet(
    problem: ReachAvoidProblem, unsafe_set: UnsafeSet, points: FloatArray, moved: FloatArray, times: tuple[float, float]
) -> FloatArray:
    """Whether bounds leave open that a set is met in the boxes from points to points + moved: (M,)."""
    axes, grid = list(unsafe_set.axes), problem.grid.subgrid(unsafe_set.axes)
    start, by = grid.wrapped(points[:, axes]), moved[:, axes]
    low, high = start + np.minimum(by, 0.0), start + np.maximum(by, 0.0)
    # a box over the end of a periodic axis is left open
    over_seam = np.array(grid.periodic) & ((low < grid.lower) | (high > grid.upper))
    try:
        least = unsafe_set.level_set.bounds_by_branch(low, high, times)[0]
    except ValueError:  # a black box declares too little: nothing is looked for between substeps
        return np.zeros(len(points), np.bool_)
    # NaN, bounds that are undefined, leaves it open, too
    return ~(least > 0.0) | over_seam.any(axis=1)


def _least_between(
    problem: ReachAvoidProblem,
    unsafe_set: UnsafeSet,
    points: FloatArray,
    moved: FloatArray,
    t: float,
    h: float,
    halvings: int = HALVINGS,
) -> FloatArray:
    """The least g found on the straight ways from points at t to points + moved at t + h: (M,).

    Ways are halved while bounds leave open whether the set is met.
    """
    out, left = np.full(len(points), np.inf), np.flatnonzero(_may_meet(problem, unsafe_set, points, moved, (t, t + h)))
    if halvings and left.size:
        half = moved[left] / 2
        out[left] = problem.value_of(unsafe_set, points[left] + half, t + h / 2)
        # where the middle is in the set already, no closer look is needed
        on = out[left] > 0.0
        left, half = left[on], half[on]
        for begin, at in ((points[left], t), (points[left] + half, t + h / 2)):
            out[left] = np.minimum(out[left], _least_between(problem, unsafe_set, begin, half, at, h / 2, halvings - 1))
    return out


def _checked(v: FloatArray, bounds: FloatArray) -> FloatArray:
    """A copy of the v (M, D) of an adversary; ValueError unless |v| <= bounds, up to rounding."""
    v = real_array("what the adversary returns", v)  # a copy: it is read again
    if v.shape != bounds.shape:
        raise ValueError(f"the adversary must return an array of shape {bounds.shape}, got {v.shape}")
    outside = ~(np.abs(v) <= bounds * (1 + 1e-12))  # True for NaN as well
    if outside.any():
        most = bounds[outside.any(axis=1)][0]
        raise ValueError(f"the adversary must return finite v with each component within +-{most.tolist()}")
    return v
