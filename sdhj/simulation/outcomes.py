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
    problem, inputs = begun.problem, begun.inputs
    begun = replace(begun, **{name: sealed(value) for name, value in vars(begun).items()})  # adversaries only read
    states, v, ended = begun.states, begun.previous, np.full(len(begun.states), UNDECIDED)
    lowest = np.full(len(states), np.inf)
    if substeps.start == 0 and any(one.inputs is not None for one in problem.unsafe):  # an input may be forbidden here
        lowest = problem.unsafe_value(problem.grid.clipped(states, "safe"), begun.time, inputs)
    for substep in substeps:
        gone = (substep - substeps.start) * begun.duration
        now, left = begun.time + gone, begun.remaining - gone
        moment = replace(begun, states=sealed(states), substep=substep, time=now, remaining=left, previous=sealed(v))
        v = _checked(play(moment), moment.bounds)
        states = begun.interval.advance(states, begun.inputs, v, now, begun.duration)
        met = problem.grid.clipped(states, "safe")  # nothing beyond a safe end is unsafe
        clearance, lowest = np.minimum(problem.unsafe_value(met, now + begun.duration, inputs), lowest), np.inf
        ended[(ended == UNDECIDED) & (clearance <= 0)] = COLLIDED
        ended[(ended == UNDECIDED) & problem.grid.beyond(states, "unsafe")] = OFF
        if problem.has_no_target:
            ended[(ended == UNDECIDED) & problem.grid.beyond(states, "safe")] = REACHED
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
