"""How a run may end, and one interval of it: played in parts, and judged at each of them."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from sdhj.kernels import FloatArray
from sdhj.problem.checks import real_array, sealed
from sdhj.simulation.adversaries import SUBSTEPS, Adversary, Moment

OUTCOMES = ("reached", "collided", "left", "late", "off the grid")
REACHED, COLLIDED, LEFT, LATE, OFF = range(len(OUTCOMES))
UNDECIDED = -1


# After each substep: the moment it began, what was played (M, D), where that led (M, ndim), the clearance there (M,).
Watch = Callable[[Moment, FloatArray, FloatArray, FloatArray], None]


def play_interval(
    begun: Moment, play: Adversary, watch: Watch | None, walls: bool, substeps: range = range(SUBSTEPS)
) -> tuple[FloatArray, FloatArray]:
    """Hold the inputs over some substeps of an interval: the states at their end (M, ndim), and how runs ended (M,)."""
    begun = replace(begun, **{name: sealed(value) for name, value in vars(begun).items()})  # adversaries only read
    states, v, ended = begun.states, begun.previous, np.full(len(begun.states), UNDECIDED)
    lost = ("unsafe",) if walls else ("unsafe", "wall")
    for substep in substeps:
        gone = (substep - substeps.start) * begun.duration
        now, left = begun.time + gone, begun.remaining - gone
        moment = replace(begun, states=sealed(states), substep=substep, time=now, remaining=left, previous=sealed(v))
        v = _checked(play(moment), moment.bounds)
        states = begun.interval.advance(states, begun.inputs, v, now, begun.duration, walls=walls)
        met = begun.problem.grid.clipped(states, "safe")  # what lies beyond a safe end no longer matters
        clearance = begun.problem.unsafe_value(met, now + begun.duration)
        ended[(ended == UNDECIDED) & (clearance <= 0)] = COLLIDED
        ended[(ended == UNDECIDED) & begun.problem.grid.beyond(states, *lost)] = OFF
        if begun.problem.stays:
            ended[(ended == UNDECIDED) & begun.problem.grid.beyond(states, "safe")] = REACHED
        if watch is not None:
            watch(moment, v, states, clearance)
        if (ended != UNDECIDED).all():
            break
    return states, ended


def _checked(v: FloatArray, bounds: FloatArray) -> FloatArray:
    """What an adversary returned, if it keeps to its box, bounds (M, D)."""
    v = real_array("what the adversary returns", v)  # a copy: it is read again
    if v.shape != bounds.shape:
        raise ValueError(f"the adversary must return an array of shape {bounds.shape}, got {v.shape}")
    outside = ~(np.abs(v) <= bounds * (1 + 1e-12))  # also where it is NaN
    if outside.any():
        own = bounds[outside.any(axis=1)][0]
        raise ValueError(f"the adversary must keep each component of v within +-{own.tolist()} and finite")
    return v
