"""Adversaries for closed-loop simulation: they choose the disturbance v within its box, anew at every substep.

An adversary is a function of one `Moment` that returns v for every run, shape (M, D). The built-in adversaries know
the robot's state, its table, and the input it has chosen for the interval.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np

from sdhj.kernels import FloatArray
from sdhj.problem.interval import Interval
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sets import UnsafeSet
from sdhj.table.batches import Table

SUBSTEPS = 20  # parts of an interval: the adversary decides at the start of each, collisions are checked at its end


@dataclass(frozen=True)
class Moment:
    """What an adversary sees of M simultaneous runs at the start of a substep.

    Attributes
    ----------
    problem : ReachAvoidProblem
    states : (M, ndim) array
        The current state of each run.
    inputs : (M,) int array
        The index in problem.inputs of the input that each robot holds over the interval.
    steps_to_go : (M,) int array
        The steps to go at the start of the interval.
    step, substep : int
        The step k of the interval, and the substep that begins; substep 0 begins at the start of the interval.
    time, remaining, duration : float
        The current time, the time left until the interval's end, and the length of the substep, s.
    previous : (M, D) array
        The disturbance in the previous substep; zeros at the start of an interval.
    runs : (M,) int array
        The number of the run that each row belongs to; runs that have ended have no row.
    tube : callable (points (M, V, ndim)) -> (M, V)
        Level-set value, at V states for each run, of the tube that has to hold the state at the interval's end.
    rng : numpy.random.Generator
        The only source of random numbers, so that runs with the same seed are identical.
    """

    problem: ReachAvoidProblem
    states: FloatArray
    inputs: FloatArray
    steps_to_go: FloatArray
    step: int
    substep: int
    time: float
    remaining: float
    duration: float
    previous: FloatArray
    runs: FloatArray
    tube: Callable[[FloatArray], FloatArray]
    rng: np.random.Generator

    @property
    def interval(self) -> Interval:
        """The velocities and the disturbance bounds of this interval."""
        return self.problem.interval(self.step)

    @property
    def bounds(self) -> FloatArray:
        """Half-widths of the box of admissible disturbances v, shape (M, D)."""
        return self.interval.bounds(self.inputs, self.time)

    def gain(self, states: FloatArray) -> FloatArray:
        """The matrices that map v to its part of the velocity at states (M, ndim), shape (M, ndim, D)."""
        return self.interval.gain(states, self.inputs, self.time)

    def predicted(self) -> FloatArray:
        """The state at the interval's end if v were 0 and the present velocity stayed constant, shape (M, ndim)."""
        return self.states + self.remaining * self.interval.undisturbed(self.states, self.inputs, self.time)


Adversary = Callable[[Moment], FloatArray]


def first_moment(
    table: Table,
    problem: ReachAvoidProblem,
    states: FloatArray,
    inputs: FloatArray,
    to_go: FloatArray,
    step: int,
    now: float,
    runs: FloatArray,
    rng: np.random.Generator,
    left: FloatArray | None = None,
) -> Moment:
    """An interval's first moment; `left` (M,), the steps to go at its end, is by default one fewer than `to_go`."""
    if left is None:
        left = np.full(len(to_go), problem.steps - step - 1) if problem.stays else np.maximum(to_go, 1) - 1
    return Moment(
        problem=problem,
        states=states,
        inputs=inputs,
        steps_to_go=to_go,
        step=step,
        substep=0,
        time=now,
        remaining=problem.delta,
        duration=problem.delta / SUBSTEPS,
        previous=np.zeros((len(states), problem.dynamics.adversaries)),
        runs=runs,
        tube=partial(table.values_at, step=step + 1, within=left),
        rng=rng,
    )


def none(moment: Moment) -> FloatArray:
    """v = 0."""
    return np.zeros_like(moment.previous)


def random(moment: Moment) -> FloatArray:
    """v is drawn uniformly from its box at each sampling time and held over the interval (Sec. 5.5)."""
    if moment.substep > 0:
        return np.clip(moment.previous, -moment.bounds, moment.bounds)
    return moment.rng.uniform(-moment.bounds, moment.bounds, moment.previous.shape)


def _effects(
    moment: Moment, part: UnsafeSet, states: FloatArray, t: float, span: float
) -> tuple[FloatArray, FloatArray]:
    """The level-set function g of an unsafe set at `states`, and its change over `span` by each component of v.

    Shapes (M,) and (M, D). One component of v at a time is set to its bound.
    """
    problem, axes = moment.problem, list(part.axes)
    push = span * moment.gain(states) * moment.bounds[:, None]  # (M, ndim, D)
    touching = np.flatnonzero(push[:, axes].any(axis=(0, 1)))
    trials = np.concatenate([states, *(states + push[:, :, d] for d in touching)])  # evaluated in one call
    value, *moved = problem.value_of(part, trials, t).reshape(-1, len(states))
    change = np.zeros_like(moment.previous)
    for d, there in zip(touching, moved, strict=True):
        change[:, d] = there - value
    return value, change


def aggressive(moment: Moment) -> FloatArray:
    """The pursuer of Sec. 6.1: v is the vertex of its box that most reduces the distance to the unsafe sets now.

    Each component of v reduces the level-set function of the nearest unsafe set that it affects.
    """
    parts = [_effects(moment, part, moment.states, moment.time, moment.duration) for part in moment.problem.unsafe]
    if not parts:
        return np.zeros_like(moment.previous)
    values, changes = (np.stack(arrays) for arrays in zip(*parts, strict=True))
    rows = np.arange(len(moment.states))
    direction = np.zeros_like(moment.previous)
    for nearest in np.argsort(-values, axis=0):  # from the farthest set to the nearest, which takes precedence
        change = changes[nearest, rows]
        direction = np.where(change != 0.0, -np.sign(change), direction)
    return direction * moment.bounds


def worst(moment: Moment) -> FloatArray:
    """v is the vertex of its box that, held until the interval's end, is worst for the robot; chosen at every substep.

    It maximises the larger of the level-set value of the tube to be reached and the negative clearance from the unsafe
    sets (to first order in v). Ties go to the least clearance; they are common where the values are whole steps.
    """
    problem = moment.problem
    signs = np.array(list(product((-1.0, 1.0), repeat=moment.previous.shape[1])))  # (V, D)
    predicted = moment.predicted()
    push = moment.remaining * moment.gain(predicted) @ (signs * moment.bounds[:, None]).swapaxes(1, 2)  # (M, ndim, V)
    tube = moment.tube(predicted[:, None, :] + np.swapaxes(push, 1, 2))
    danger = np.full(tube.shape, -np.finfo(np.float64).max)
    end = moment.time + moment.remaining
    for part in problem.unsafe:
        value, change = _effects(moment, part, predicted, end, moment.remaining)
        danger = np.maximum(danger, -(value[:, None] + change @ signs.T))
    score = np.maximum(tube, danger)
    worst_off = score == score.max(axis=1, keepdims=True)
    return signs[np.argmax(np.where(worst_off, danger, -np.inf), axis=1)] * moment.bounds


ADVERSARIES: dict[str, Adversary] = {"none": none, "random": random, "aggressive": aggressive, "worst": worst}
