"""Adversaries for closed-loop simulation: they choose the disturbance v within its box, anew at every substep.

An adversary is a function of one `Moment` that returns v for every run, shape (M, D). The built-in ones know the
robot's state, its table, and the input it has chosen.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np

from sdhj.common.remembering import FloatArray
from sdhj.problem.interval import Interval
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sets import UnsafeSet
from sdhj.table.batches import Table

SUBSTEPS = 20  # parts of an interval: the adversary decides at the start of each, collisions are checked at its end
TURNS = 5  # of an interval: how often the greedy adversary decides
STRIDES = 3  # in which it looks ahead
LOST = np.finfo(np.float64).max  # worse than any level-set value


@dataclass(frozen=True)
class Moment:
    """An adversary's view of M simultaneous runs at the start of a substep.

    An adversary of your own is a function of a `Moment` that returns the disturbance (M, D) of each run during the
    substep, between -`bounds` and `bounds`; it is given to `sdhj.simulate` or `sdhj.monte_carlo`.

    Attributes
    ----------
    problem : ReachAvoidProblem
    states : (M, ndim) array
        The current state of each run.
    inputs, steps_to_go : (M,) int arrays
        The input that each robot holds over the interval, by index, and the steps to go at its start.
    step, substep : int
        k, and the substep that begins, from 0 on.
    time, remaining, duration : float
        Now, until the interval's end, and of the substep, s.
    previous : (M, D) array
        The disturbance in the previous substep.
    runs : (M,) int array
        The number of each row's run.
    tube : callable (points (M, V, ndim)) -> (M, V)
        Level-set values of the tube that has to hold the state at the interval's end.
    rng : numpy.random.Generator
        The only source of random numbers.

    Examples
    --------
    With the robot on a line of `help(sdhj)`, a wind to the left:

    >>> def west(moment: sdhj.Moment):
    ...     return np.tile([-1.0], (len(moment.states), 1)) * moment.bounds
    >>> sdhj.monte_carlo(controller, runs=100, adversary=west, progress=False).counts["reached"]
    100
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
        """The problem's interval with number `step`: its velocities and disturbance bounds."""
        return self.problem.interval(self.step)

    @property
    def bounds(self) -> FloatArray:
        """Half-widths of the box of v, under the input of each run, now: (M, D)."""
        return self.interval.bounds(self.inputs, self.time)

    def gain(self, states: FloatArray) -> FloatArray:
        """The matrices (M, ndim, D) from v to velocity, under the input of each run, now."""
        return self.interval.gain(states, self.inputs, self.time)

    def predicted(self) -> FloatArray:
        """Where the state would be at the interval's end with v = 0 and the present velocity: (M, ndim)."""
        return self.states + self.remaining * self.interval.undisturbed(self.states, self.inputs, self.time)


Adversary = Callable[[Moment], FloatArray]


def first_moment(
    table: Table,
    problem: ReachAvoidProblem,
    states: FloatArray,
    inputs: FloatArray,
    to_go: FloatArray,
    step: int,
    now: float,  # which with jitter is other than t_step
    runs: FloatArray,
    rng: np.random.Generator,
    left: FloatArray | None = None,  # the steps to go of the tube that has to hold the state at the end
) -> Moment:
    """The moment at which an interval of M runs begins, with v = 0 before."""
    if left is None:
        left = np.full(len(to_go), problem.steps - step - 1) if problem.has_no_target else np.maximum(to_go, 1) - 1
    times = now, problem.delta, problem.delta / SUBSTEPS  # now, until the end of the interval, and of a substep
    previous, tube = np.zeros((len(states), problem.dynamics.disturbance_dim)), partial(table.values_at, step=step + 1)
    return Moment(problem, states, inputs, to_go, step, 0, *times, previous, runs, partial(tube, within=left), rng)


def none(moment: Moment) -> FloatArray:
    """The disturbance 0 for each run: (M, D)."""
    return np.zeros_like(moment.previous)


def random(moment: Moment) -> FloatArray:
    """A disturbance drawn uniformly at each sampling time, held over the interval (Sec. 5.5): (M, D)."""
    if moment.substep > 0:
        # the box may shrink within the interval
        return np.clip(moment.previous, -moment.bounds, moment.bounds)
    return moment.rng.uniform(-moment.bounds, moment.bounds, moment.previous.shape)


def _effects(moment: Moment, unsafe_set: UnsafeSet, states: FloatArray, t: float, push: FloatArray) -> list[FloatArray]:
    """[g, change_1, ..., change_D], (M,) each: an unsafe set's level, and what each push[:, :, d] adds to it.

    The level is inf for runs under whose input the set is not unsafe.
    """
    touching = np.flatnonzero([push[:, list(unsafe_set.axes), d].any() for d in range(push.shape[2])]).tolist()
    trials = np.concatenate([states, *(states + push[:, :, d] for d in touching)])  # evaluated in one call
    value, *moved = moment.problem.value_of(unsafe_set, trials, t).reshape(-1, len(states))
    change = {d: there - value for d, there in zip(touching, moved, strict=True)}
    value = np.where(unsafe_set.counts(moment.inputs), value, np.inf)
    return [value, *(change.get(d, np.zeros(len(states))) for d in range(push.shape[2]))]


def aggressive(moment: Moment) -> FloatArray:
    """The pursuer of Sec. 6.1: the vertex of the box of v that most reduces the distance to the unsafe sets now."""
    states, sets = moment.states, moment.problem.unsafe
    if not sets:
        return np.zeros_like(moment.previous)
    push = moment.duration * moment.gain(states) * moment.bounds[:, None]
    effects = np.stack([_effects(moment, part, states, moment.time, push) for part in sets])  # (sets, 1 + D, M)
    # each component has the sign that reduces the function of the nearest set that it affects
    direction, rows = np.zeros_like(moment.previous), np.arange(len(states))
    for nearest in np.argsort(-effects[:, 0], axis=0):  # from the farthest set to the nearest, which takes precedence
        change = effects[nearest, 1:, rows]
        direction = np.where(change != 0.0, -np.sign(change), direction)
    return direction * moment.bounds


def worst(moment: Moment) -> FloatArray:
    """The vertex of the box of v that, held until the interval's end, is worst for the robot: (M, D).

    It maximises, to first order in v, the larger of the tube's level there and of the negative least level of the
    unsafe sets; of equals it is that of the least clearance.
    """
    predicted, bounds, end = moment.predicted(), moment.bounds, moment.time + moment.remaining
    push = moment.remaining * moment.gain(predicted) * bounds[:, None]  # (M, ndim, D)
    corners = at_vertices(predicted, np.moveaxis(push, 2, 0))
    danger = np.full(corners.shape[:2], -np.finfo(np.float64).max)  # vertices first: so the maxima below are fast
    for unsafe_set in moment.problem.unsafe:
        value, *changes = _effects(moment, unsafe_set, predicted, end, push)
        danger = np.maximum(danger, -at_vertices(value, changes))
    score = np.maximum(moment.tube(corners.swapaxes(0, 1)).T, danger)
    worst_of_all = np.argmax(np.where(score == score.max(axis=0), danger, -np.inf), axis=0)
    # the signs of the vertices, in the order of `corners` above
    return at_vertices(np.zeros(bounds.shape[1]), np.eye(bounds.shape[1]))[worst_of_all] * bounds


def level_of_unsafe(problem: ReachAvoidProblem, states: FloatArray, t: float, inputs: FloatArray) -> FloatArray:
    """The least of the unsafe sets' level-set values and of the distances to unsafe ends: (M,)."""
    grid = problem.grid
    low, high = grid.faces("fails")
    ends = np.minimum(states - low, high - states).min(axis=1)
    found = np.minimum(problem.unsafe_value(grid.clipped(states, "frees"), t, inputs), ends)
    return np.where(grid.beyond(states, "frees"), np.inf, found)  # past a safe end nothing matters any longer


def greedy(moment: Moment) -> FloatArray:
    """The vertex of the box of v, or 0, that comes nearest to what is unsafe if held to the interval's end: (M, D)."""
    # with 0 it holds a state on a ridge of the game's value, as straight ahead of a car
    if moment.substep % (SUBSTEPS // TURNS):  # in between it keeps what it has decided
        return np.clip(moment.previous, -moment.bounds, moment.bounds)
    still, count = np.zeros(moment.bounds.shape[1]), len(moment.states)
    signs = np.concatenate([at_vertices(still, np.eye(len(still))), still[None]])
    held, ahead = np.tile(moment.inputs, len(signs)), np.tile(moment.states, (len(signs), 1))
    v, least = np.concatenate([sign * moment.bounds for sign in signs]), np.full(len(held), np.inf)
    h = moment.remaining / STRIDES
    for stride in range(STRIDES):
        t = moment.time + stride * h
        ahead = moment.interval.advance(ahead, held, v, t, h)
        least = np.minimum(least, level_of_unsafe(moment.problem, ahead, t + h, held))
    return signs[least.reshape(len(signs), count).argmin(axis=0)] * moment.bounds


def at_vertices(value: FloatArray, changes: Iterable[FloatArray]) -> FloatArray:
    """value +- each of D changes of its shape, in all combinations: (2^D, *value.shape), new.

    The first is all minus; the last sign alternates fastest.
    """
    out = value[None]
    for change in changes:
        out = np.stack([out - change, out + change], axis=1).reshape(-1, *value.shape)
    return out


# ---- with measurements: how they mislead, and when inputs start


@dataclass(frozen=True)
class Sight:
    """What an adversary's method `mislead` sees before it returns the measurement errors (M, ndim), between -box and
    box.

    Attributes
    ----------
    problem : ReachAvoidProblem
        With the sensing that is simulated.
    states : (M, ndim) array
        When they are measured.
    box : (ndim,) array
        The bounds on the measurement error.
    step : int
        k, at most N - 1.
    starting : (M, ndim) array
        Each state when the next input starts, without a disturbance.
    ask : callable
        ask(errors (M, ndim)) returns the inputs that the controller would choose with these errors, by index, and the
        steps to go, both (M,); -1 for none.
    tube : callable
        tube(points (M, ndim), left (M,)) returns level-set values (M,), one step later, of the tube with so many steps
        to go.
    rng : numpy.random.Generator
        The only source of random numbers.
    """

    problem: ReachAvoidProblem
    states: FloatArray
    box: FloatArray
    step: int
    starting: FloatArray
    ask: Callable[[FloatArray], tuple[FloatArray, FloatArray]]
    tube: Callable[[FloatArray, FloatArray], FloatArray]
    rng: np.random.Generator


def states_under_vertices(
    seen: Moment | Sight, states: FloatArray, inputs: FloatArray, t: float, span: FloatArray
) -> FloatArray:
    """Where states are after time spans (M,) at each vertex of the box of v, to first order: (2^D, M, ndim)."""
    interval = seen.problem.interval(seen.step)
    push = span[:, None, None] * interval.gain(states, inputs, t) * interval.bounds(inputs, t)[:, None]
    return at_vertices(states + span[:, None] * interval.undisturbed(states, inputs, t), np.moveaxis(push, 2, 0))


def mislead_worst(sight: Sight) -> FloatArray:
    """The measurement errors (M, ndim), 0 or a vertex of the box, for which the controller's input is worst.

    Worst is no input, or else that of the largest value of the tube at the interval's end, at the worst v.
    """
    problem, count = sight.problem, len(sight.states)
    vertices = np.array(list(product(*((-width, width) if width else (0.0,) for width in sight.box))))
    best, score_of_best = np.zeros_like(sight.states), np.full(count, -np.inf)
    t, span = problem.time(sight.step), np.full(count, problem.delta)
    # of errors that are equally bad the first counts, 0 before the vertices
    for vertex in np.concatenate([np.zeros((1, len(sight.box))), vertices]):
        errors = np.tile(vertex, (count, 1))
        inputs, to_go = sight.ask(errors)
        ends = states_under_vertices(sight, sight.starting, np.maximum(inputs, 0), t, span)
        score = np.max([sight.tube(end, np.maximum(to_go, 1) - 1) for end in ends], axis=0)
        score = np.where(inputs < 0, LOST, score)
        best, score_of_best = np.where((score > score_of_best)[:, None], errors, best), np.maximum(score_of_best, score)
    return best


def shift_worst(moment: Moment) -> FloatArray:
    """-1, 0 or 1 for each run, (M,): the end of the interval, early, on time or late, that is worst for the robot.

    There the tube's value, at the worst vertex of the box of v, is largest; of equals it is the earliest.
    """
    scores = []
    for late in (-1, 0, 1):
        span = np.full(len(moment.states), moment.remaining + late * moment.problem.sensing.jitter)
        ends = states_under_vertices(moment, moment.states, moment.inputs, moment.time, span)
        scores.append(moment.tube(np.moveaxis(ends, 0, 1)).max(axis=1))
    return np.argmax(scores, axis=0) - 1


# ---- the records


@dataclass(frozen=True)
class BuiltIn:
    """An adversary that has a name, with its three choices."""

    name: str
    push: Adversary
    mislead: Callable[[Sight], FloatArray]  # the errors of the measurements (M, ndim)
    shift: Callable[[Moment], FloatArray]  # -1, 0 or 1, (M,): the next input starts early, on time or late

    def __call__(self, moment: Moment) -> FloatArray:
        """The disturbances (M, D) of M runs at a moment."""
        return self.push(moment)


ADVERSARIES = {
    one.name: one
    for one in (
        BuiltIn(
            "none",
            none,
            lambda sight: np.zeros_like(sight.states),
            lambda moment: np.zeros(len(moment.states), np.int64),
        ),
        BuiltIn(
            "random",
            random,
            lambda sight: sight.rng.uniform(-sight.box, sight.box, sight.states.shape),
            lambda moment: moment.rng.integers(-1, 2, len(moment.states)),
        ),
        BuiltIn("aggressive", aggressive, mislead_worst, shift_worst),
        BuiltIn("worst", worst, mislead_worst, shift_worst),
        BuiltIn("greedy", greedy, mislead_worst, shift_worst),
    )
}
