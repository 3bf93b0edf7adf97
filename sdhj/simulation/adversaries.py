"""Adversaries for closed-loop simulation: they choose v within its box, again at every substep.

An adversary is a function of one `Moment` that returns v for every run, shape (M, D). The named ones know everything
the robot knows, and the input it has chosen for the interval.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np

from sdhj.kernels import FloatArray
from sdhj.problem.dynamics import Interval
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sets import UnsafeSet
from sdhj.table.batches import Table

SUBSTEPS = 20  # instants of an interval at which the adversary decides and collisions are looked for


@dataclass(frozen=True)
class Moment:
    """What an adversary sees in M runs at once, at the start of a substep.

    Attributes
    ----------
    problem : ReachAvoidProblem
    states : (M, ndim) array
        Where each run is.
    inputs : (M,) int array
        The index of the input that each robot holds over the interval.
    steps_to_go : (M,) int array
        What the controller promised at the interval's start.
    step, substep : int
        The interval, and the part of it that begins; substep 0 is the sampling time itself.
    time, remaining, duration : float
        Now; until the interval's end; of this substep, s.
    previous : (M, D) array
        What the adversary played in the substep before; zeros at the start of an interval.
    runs : (M,) int array
        Which of the runs that started together each row is; rows of runs that have ended are gone.
    tube : callable (points (M, V, ndim)) -> (M, V)
        Level-set value, at V states for each run, of the set that the robot means to be in at the interval's end.
    rng : numpy.random.Generator
        The only source of chance, so that a seed fixes the run.
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
        """What may happen in it."""
        return self.problem.interval(self.step)

    @property
    def bounds(self) -> FloatArray:
        """Half-widths of the box that v has to stay in, shape (M, D)."""
        return self.interval.bounds(self.inputs, self.time)

    def gain(self, states: FloatArray) -> FloatArray:
        """What v does to the velocity at states (M, ndim), shape (M, ndim, D)."""
        return self.interval.gain(states, self.inputs, self.time)

    def predicted(self) -> FloatArray:
        """Where each run would be at the interval's end without the adversary, at the present velocity: (M, ndim)."""
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
    """An interval's first moment; `left` (M,), steps to go at its end, are by default as promised."""
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
    """Drawn uniformly from the box at each sampling time and kept over the interval, within the box (Sec. 5.5)."""
    if moment.substep > 0:
        return np.clip(moment.previous, -moment.bounds, moment.bounds)
    return moment.rng.uniform(-moment.bounds, moment.bounds, moment.previous.shape)


def _effects(
    moment: Moment, part: UnsafeSet, states: FloatArray, t: float, span: float
) -> tuple[FloatArray, FloatArray]:
    """A part's level-set function g at `states`, and how each component of v at its bound changes it over `span`.

    Shapes (M,) and (M, D): trial displacements, one component at a time.
    """
    problem, axes = moment.problem, list(part.axes)
    push = span * moment.gain(states) * moment.bounds[:, None]  # (M, ndim, D)
    touching = np.flatnonzero(push[:, axes].any(axis=(0, 1)))
    trials = np.concatenate([states, *(states + push[:, :, d] for d in touching)])  # asked for at once
    value, *moved = problem.value_of(part, trials, t).reshape(-1, len(states))
    change = np.zeros_like(moment.previous)
    for d, there in zip(touching, moved, strict=True):
        change[:, d] = there - value
    return value, change


def aggressive(moment: Moment) -> FloatArray:
    """The pursuer of Sec. 6.1: the vertex of the box that lowers the distance to the unsafe sets most, right now.

    Each component goes the way that lowers the nearest unsafe set it has an effect on.
    """
    parts = [_effects(moment, part, moment.states, moment.time, moment.duration) for part in moment.problem.unsafe]
    if not parts:
        return np.zeros_like(moment.previous)
    values, changes = (np.stack(arrays) for arrays in zip(*parts, strict=True))
    rows = np.arange(len(moment.states))
    direction = np.zeros_like(moment.previous)
    for nearest in np.argsort(-values, axis=0):  # from the farthest part to the nearest, which has the last word
        change = changes[nearest, rows]
        direction = np.where(change != 0.0, -np.sign(change), direction)
    return direction * moment.bounds


def worst(moment: Moment) -> FloatArray:
    """The vertex that, kept until the interval's end, leaves the robot worst off there; it may switch at every substep.

    Worst is the largest of the level-set value of the set the robot means to reach and of minus its clearance, the
    latter to first order in v; the least clearance among equals, as where the values are whole steps.
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
