"""The outcomes of a run, and the simulation of one interval, which checks for an outcome after every substep."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from sdhj.kernels import FloatArray
from sdhj.problem.checks import real_array, sealed
from sdhj.simulation.adversaries import SUBSTEPS, Adversary, Moment

OUTCOMES = ("reached", "collided", "left", "late", "off the grid")
REACHED, COLLIDED, LEFT, LATE, OFF = range(len(OUTCOMES))
UNDECIDED = -1


# Called after each substep with the moment it began, v (M, D), the new states (M, ndim) and their clearance (M,).
Watch = Callable[[Moment, FloatArray, FloatArray, FloatArray], None]


def play_interval(
    begun: Moment, play: Adversary, watch: Watch | None, substeps: range = range(SUBSTEPS)
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Apply the inputs over some substeps of an interval: states (M, ndim) and outcomes (M,) then, and the last v."""
    begun = replace(begun, **{name: sealed(value) for name, value in vars(begun).items()})  # adversaries only read
    states, v, ended = begun.states, begun.previous, np.full(len(begun.states), UNDECIDED)
    for substep in substeps:
        gone = (substep - substeps.start) * begun.duration
        now, left = begun.time + gone, begun.remaining - gone
        moment = replace(begun, states=sealed(states), substep=substep, time=now, remaining=left, previous=sealed(v))
        v = _checked(play(moment), moment.bounds)
        states = begun.interval.advance(states, begun.inputs, v, now, begun.duration)
        met = begun.problem.grid.clipped(states, "frees")  # nothing beyond a safe end is unsafe
        clearance = begun.problem.unsafe_value(met, now + begun.duration)
        ended[(ended == UNDECIDED) & (clearance <= 0)] = COLLIDED
        ended[(ended == UNDECIDED) & begun.problem.grid.beyond(states, "fails")] = OFF
        if begun.problem.has_no_target:
            ended[(ended == UNDECIDED) & begun.problem.grid.beyond(states, "frees")] = REACHED
        if watch is not None:
            watch(moment, v, states, clearance)
        if (ended != UNDECIDED).all():
            break
    return states, ended, v


def _checked(v: FloatArray, bounds: FloatArray) -> FloatArray:
    """The disturbance v that an adversary returned; ValueError where it is outside its box, bounds (M, D)."""
    v = real_array("what the adversary returns", v)  # a copy: it is read again
    if v.shape != bounds.shape:
        raise ValueError(f"the adversary must return an array of shape {bounds.shape}, got {v.shape}")
    outside = ~(np.abs(v) <= bounds * (1 + 1e-12))  # True for NaN as well
    if outside.any():
        most = bounds[outside.any(axis=1)][0]
        raise ValueError(f"the adversary must return finite v with each component within +-{most.tolist()}")
    return v
