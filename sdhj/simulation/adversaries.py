"""Adversaries for closed-loop simulation: they choose the disturbance v within its box, anew at every substep.

An adversary is a function of one `Moment` that returns v for every run, shape (M, D). The built-in adversaries know
the robot's state, its table, and the input it has chosen for the interval.
"""

from collections.abc import Callable, Iterable
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
TURNS = 5  # of an interval: how often the greedy adversary decides
STRIDES = 3  # in which it looks ahead
LOST = np.finfo(np.float64).max  # worse than any level-set value
RECKLESS = 5  # intervals for which a reckless commander looks ahead, twice in each


@dataclass(frozen=True)
class Moment:
    """An adversary's view of M simultaneous runs at the start of a substep.

    An adversary of your own is a function of a `Moment` that returns the disturbance (M, D) of each run during the
    substep, between -`bounds` and `bounds` (M, D); it is given to `sdhj.simulate` or `sdhj.monte_carlo`, which raise
    ValueError where it exceeds them.

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

    Examples
    --------
    With the robot on a line of `help(sdhj)`, a wind to the left:

    >>> def west(moment: sdhj.Moment):
    ...     return np.tile([-1.0], (len(moment.states), 1)) * moment.bounds
    >>> sdhj.monte_carlo(controller, runs=100, adversary=west, progress=False).counts["reached"]
    100
    """

    problem: ReachAvoidProblem
    states: FloatArray  # (M, ndim), the current state of each run
    inputs: FloatArray  # (M,) int, the index in problem.inputs of the input that each robot holds over the interval
    steps_to_go: FloatArray  # (M,) int, at the start of the interval
    step: int  # k, of the interval
    substep: int  # that begins; substep 0 begins at the start of the interval
    time: float  # now, s
    remaining: float  # until the interval's end, s
    duration: float  # of the substep, s
    previous: FloatArray  # (M, D), the disturbance in the previous substep; zeros at the start of an interval
    runs: FloatArray  # (M,) int, the number of the run that each row belongs to; runs that have ended have no row
    # of points (M, V, ndim), V for each run: level-set values (M, V) of the tube that has to hold the interval's end
    tube: Callable[[FloatArray], FloatArray]
    rng: np.random.Generator  # the only source of random numbers, so that runs with the same seed are identical

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
    """The moment at which an interval of M runs begins.

    states (M, ndim); inputs (M,), held over the interval; to_go (M,), the steps to go by which they were chosen; now :
    the time, s, which may be other than t_step; runs (M,) : numbers of the runs. left (M,) : the steps to go of the
    tube that has to hold the end; by default one fewer than `to_go` or, without a target, all that are left.
    """
    if left is None:
        left = np.full(len(to_go), problem.steps - step - 1) if problem.has_no_target else np.maximum(to_go, 1) - 1
    times = now, problem.delta, problem.delta / SUBSTEPS  # now, until the end of the interval, and of a substep
    previous, tube = np.zeros((len(states), problem.dynamics.adversaries)), partial(table.values_at, step=step + 1)
    return Moment(problem, states, inputs, to_go, step, 0, *times, previous, runs, partial(tube, within=left), rng)


def none(moment: Moment) -> FloatArray:
    """v = 0."""
    return np.zeros_like(moment.previous)


def random(moment: Moment) -> FloatArray:
    """v is drawn uniformly from its box at each sampling time and held over the interval (Sec. 5.5)."""
    if moment.substep > 0:
        return np.clip(moment.previous, -moment.bounds, moment.bounds)
    return moment.rng.uniform(-moment.bounds, moment.bounds, moment.previous.shape)


def _effects(moment: Moment, unsafe_set: UnsafeSet, states: FloatArray, t: float, push: FloatArray) -> list[FloatArray]:
    """[g, change_1, ..., change_D], each (M,): the level-set function of an unsafe set at states (M, ndim) and time t,
    and by how much each component of v, set to its bound, changes it.

    g is infinite under inputs under which the set is not unsafe. push (M, ndim, D) : by how much each component moves
    the states, one at a time.
    """
    touching = np.flatnonzero([push[:, list(unsafe_set.axes), d].any() for d in range(push.shape[2])]).tolist()
    trials = np.concatenate([states, *(states + push[:, :, d] for d in touching)])  # evaluated in one call
    value, *moved = moment.problem.value_of(unsafe_set, trials, t).reshape(-1, len(states))
    change = {d: there - value for d, there in zip(touching, moved, strict=True)}
    value = np.where(unsafe_set.counts(moment.inputs), value, np.inf)
    return [value, *(change.get(d, np.zeros(len(states))) for d in range(push.shape[2]))]


def aggressive(moment: Moment) -> FloatArray:
    """The pursuer of Sec. 6.1: v is the vertex of its box that most reduces the distance to the unsafe sets now.

    Each component of v reduces the level-set function of the nearest unsafe set that it affects.
    """
    states, sets = moment.states, moment.problem.unsafe
    if not sets:
        return np.zeros_like(moment.previous)
    push = moment.duration * moment.gain(states) * moment.bounds[:, None]
    effects = np.stack([_effects(moment, part, states, moment.time, push) for part in sets])  # (sets, 1 + D, M)
    direction, rows = np.zeros_like(moment.previous), np.arange(len(states))
    for nearest in np.argsort(-effects[:, 0], axis=0):  # from the farthest set to the nearest, which takes precedence
        change = effects[nearest, 1:, rows]
        direction = np.where(change != 0.0, -np.sign(change), direction)
    return direction * moment.bounds


def worst(moment: Moment) -> FloatArray:
    """v is the vertex of its box that, held until the interval's end, is worst for the robot; chosen at every substep.

    It maximises the larger of the level-set value of the tube to be reached and the negative clearance from the unsafe
    sets (to first order in v). Ties go to the least clearance; they are common where the values are whole steps.
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
    return at_vertices(np.zeros(bounds.shape[1]), np.eye(bounds.shape[1]))[worst_of_all] * bounds


def level_of_unsafe(problem: ReachAvoidProblem, states: FloatArray, t: float, inputs: FloatArray) -> FloatArray:
    """The least of all level-set values of unsafe sets and of the distances to unsafe ends of the grid: (M,).

    At states (M, ndim) and time t, of the sets that are unsafe under inputs (M,). +inf past a safe end, where nothing
    matters any longer.
    """
    grid = problem.grid
    low, high = grid.faces("fails")
    ends = np.minimum(states - low, high - states).min(axis=1)
    found = np.minimum(problem.unsafe_value(grid.clipped(states, "frees"), t, inputs), ends)
    return np.where(grid.beyond(states, "frees"), np.inf, found)


def greedy(moment: Moment) -> FloatArray:
    """v is what, held until the interval's end, comes nearest to what must not be touched: a vertex of its box, or 0.

    It decides five times in an interval, by following each; of equals it takes the first. With 0 it holds a state on a
    ridge of the game's value, as straight ahead of a car.
    """
    if moment.substep % (SUBSTEPS // TURNS):
        return np.clip(moment.previous, -moment.bounds, moment.bounds)
    none, count = np.zeros(moment.bounds.shape[1]), len(moment.states)
    signs = np.concatenate([at_vertices(none, np.eye(len(none))), none[None]])
    held, ahead = np.tile(moment.inputs, len(signs)), np.tile(moment.states, (len(signs), 1))
    v, least = np.concatenate([sign * moment.bounds for sign in signs]), np.full(len(held), np.inf)
    h = moment.remaining / STRIDES
    for stride in range(STRIDES):
        t = moment.time + stride * h
        ahead = moment.interval.advance(ahead, held, v, t, h)
        least = np.minimum(least, level_of_unsafe(moment.problem, ahead, t + h, held))
    return signs[least.reshape(len(signs), count).argmin(axis=0)] * moment.bounds


def reckless(problem: ReachAvoidProblem, states: FloatArray, step: int) -> FloatArray:
    """For each state (M, ndim) the input, by index, that comes nearest to what must not be touched: (M,) int.

    Each is held for five intervals from a step on, without a disturbance; so a commander drives who tests the filter.
    """
    count, inputs, interval = len(states), len(problem.inputs), problem.interval(step)
    held, ahead = np.repeat(np.arange(inputs), count), np.tile(states, (inputs, 1))
    still, least = np.zeros((len(held), problem.dynamics.adversaries)), np.full(len(held), np.inf)
    for half in range(2 * RECKLESS):
        t = problem.time(step) + half * problem.delta / 2
        ahead = interval.advance(ahead, held, still, t, problem.delta / 2)
        least = np.minimum(least, level_of_unsafe(problem, ahead, t + problem.delta / 2, held))
    return least.reshape(inputs, count).argmin(axis=0)


def at_vertices(value: FloatArray, changes: Iterable[FloatArray]) -> FloatArray:
    """value +- each of D changes of its shape, in all combinations: (2^D, *value.shape), the first all minus."""
    out = value[None]
    for change in changes:
        out = np.stack([out - change, out + change], axis=1).reshape(-1, *value.shape)
    return out


# ---- with measurements: how they mislead, and when inputs start


@dataclass(frozen=True)
class Sight:
    """An adversary's view before it chooses the measurement errors of M runs, between -box and box."""

    problem: ReachAvoidProblem  # the robot's problem, with the simulated sensing
    states: FloatArray  # (M, ndim), the current state of each run
    box: FloatArray  # (ndim,), the bounds on the measurement error
    step: int  # that the measurement is for
    starting: FloatArray  # (M, ndim), each state when the next input starts, without a disturbance
    # of errors (M, ndim): the inputs that the controller would choose, and steps to go, both (M,); -1 for no answer
    ask: Callable[[FloatArray], tuple[FloatArray, FloatArray]]
    # of points (M, ndim) and steps to go (M,): level-set values (M,) of the tube of predictions, one step later
    tube: Callable[[FloatArray, FloatArray], FloatArray]
    rng: np.random.Generator


def pushed(seen: Moment | Sight, states: FloatArray, inputs: FloatArray, t: float, span: FloatArray) -> FloatArray:
    """Where states (M, ndim) are after time spans (M,), s, at each vertex of the disturbance box: (2^D, M, ndim).

    To first order: with the velocities at time t under inputs (M,), `seen` giving problem and step.
    """
    interval = seen.problem.interval(seen.step)
    push = span[:, None, None] * interval.gain(states, inputs, t) * interval.bounds(inputs, t)[:, None]
    return at_vertices(states + span[:, None] * interval.undisturbed(states, inputs, t), np.moveaxis(push, 2, 0))


def mislead_worst(sight: Sight) -> FloatArray:
    """The measurement errors (M, ndim), each 0 or a vertex of the box, for which the input chosen is worst.

    Worst is no input at all, or that under which the tube's value at the interval's end, at the worst vertex of the
    disturbance box, is largest.
    """
    problem, count = sight.problem, len(sight.states)
    vertices = np.array(list(product(*((-width, width) if width else (0.0,) for width in sight.box))))
    best, worst = np.zeros_like(sight.states), np.full(count, -np.inf)
    t, span = problem.time(sight.step), np.full(count, problem.delta)
    for vertex in np.concatenate([np.zeros((1, len(sight.box))), vertices]):
        errors = np.tile(vertex, (count, 1))
        inputs, to_go = sight.ask(errors)
        ends = pushed(sight, sight.starting, np.maximum(inputs, 0), t, span)
        score = np.max([sight.tube(end, np.maximum(to_go, 1) - 1) for end in ends], axis=0)
        score = np.where(inputs < 0, LOST, score)
        best, worst = np.where((score > worst)[:, None], errors, best), np.maximum(worst, score)
    return best


def shift_worst(moment: Moment) -> FloatArray:
    """-1, 0 or 1 for each run, (M,): the end of the interval, early, on time or late, that is worst for the robot.

    There the tube's value, at the worst vertex of the disturbance box, is largest.
    """
    scores = []
    for late in (-1, 0, 1):
        span = np.full(len(moment.states), moment.remaining + late * moment.problem.sensing.jitter)
        ends = pushed(moment, moment.states, moment.inputs, moment.time, span)
        scores.append(moment.tube(np.moveaxis(ends, 0, 1)).max(axis=1))
    return np.argmax(scores, axis=0) - 1


# ---- the records


@dataclass(frozen=True)
class BuiltIn:
    """An adversary that has a name: its three choices. Without `Sensing` it makes the first alone."""

    name: str
    push: Adversary  # the disturbances (M, D)
    mislead: Callable[[Sight], FloatArray]  # the errors of measurements (M, ndim)
    shift: Callable[[Moment], FloatArray]  # -1, 0 or 1 (M,): the next input starts early, on time or late

    def __call__(self, moment: Moment) -> FloatArray:
        """The disturbances of M runs at a moment, (M, D)."""
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
