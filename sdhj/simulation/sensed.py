"""Closed-loop simulation of a robot with measurement errors, a delay, and jitter of its sampling times.

The adversary then makes three choices: the disturbance, at every substep; the error of every measurement; and when the
next input starts. A run begins when the first input starts, from a state that the controller has measured up to an
error in the box E of `sdhj.problem.sensing`. Runs end as in `sdhj.simulation.runs`, with one difference: a run counts
as reached only when the prediction has no steps to go and the state is in the true target.

An adversary that is a plain function of a `Moment` chooses the disturbance only. An adversary may also have the methods
`mislead(sight)`, which returns the errors (M, ndim), and `shift(moment)`, which returns for each run (M,) -1, 0 or 1:
the next input starts early, on time or late, by the full jitter. The built-in adversaries take them from `MISLEAD` and
`SHIFTING`; functions without these methods use those of "worst".
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from sdhj.kernels import FloatArray
from sdhj.problem.checks import real_array, sealed
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sensing import Sensing
from sdhj.simulation.adversaries import ADVERSARIES, SUBSTEPS, Adversary, Moment, first_moment
from sdhj.simulation.outcomes import COLLIDED, LATE, LEFT, REACHED, UNDECIDED, Watch, play_interval
from sdhj.table.controller import Controller, predicted

LOST = np.finfo(np.float64).max  # worse than any level-set value


@dataclass(frozen=True)
class Sight:
    """What an adversary sees before it chooses the measurement errors of M runs.

    Attributes
    ----------
    problem : ReachAvoidProblem
        The robot's problem, with the simulated sensing.
    states : (M, ndim) array
        The current state of each run.
    box : (ndim,) array
        The bounds on the measurement error.
    step : int
        The step that the measurement is for.
    starting : (M, ndim) array
        The state of each run when the next input starts, without a disturbance.
    ask : callable (errors (M, ndim)) -> inputs, steps to go
        The controller's choice under these errors, both (M,) int; -1 where it has no answer.
    tube : callable (points (M, ndim), steps to go (M,)) -> (M,)
        Level-set value of the tube of predictions, one step later.
    rng : numpy.random.Generator
    """

    problem: ReachAvoidProblem
    states: FloatArray
    box: FloatArray
    step: int
    starting: FloatArray
    ask: Callable[[FloatArray], tuple[FloatArray, FloatArray]]
    tube: Callable[[FloatArray, FloatArray], FloatArray]
    rng: np.random.Generator


def pushes(moment: Moment | Sight, states: FloatArray, inputs: FloatArray, t: float, span: FloatArray) -> FloatArray:
    """Displacements by each vertex of the disturbance box over a time span (M,): (vertices, M, ndim)."""
    interval = moment.problem.interval(moment.step)
    gain, bounds = interval.gain(states, inputs, t), interval.bounds(inputs, t)
    signs = np.array(list(product((-1.0, 1.0), repeat=bounds.shape[1])))
    return span[:, None] * np.einsum("mad,vmd->vma", gain, signs[:, None] * bounds)


def mislead_worst(sight: Sight) -> FloatArray:
    """The measurement error, a vertex of the box or 0, for which the controller's input is worst for the true state."""
    problem, count = sight.problem, len(sight.states)
    corners = np.array(list(product(*((-width, width) if width else (0.0,) for width in sight.box))))
    best, worst = np.zeros_like(sight.states), np.full(count, -np.inf)
    t, span = problem.time(sight.step), np.full(count, problem.delta)
    for corner in np.concatenate([np.zeros((1, len(sight.box))), corners]):
        errors = np.tile(corner, (count, 1))
        inputs, to_go = sight.ask(errors)
        applied = np.maximum(inputs, 0)
        velocity = problem.interval(sight.step).undisturbed(sight.starting, applied, t)
        ends = sight.starting + span[:, None] * velocity + pushes(sight, sight.starting, applied, t, span)
        score = np.max([sight.tube(end, np.maximum(to_go, 1) - 1) for end in ends], axis=0)
        score = np.where(inputs < 0, LOST, score)
        best, worst = np.where((score > worst)[:, None], errors, best), np.maximum(worst, score)
    return best


def shift_worst(moment: Moment) -> FloatArray:
    """The end of the interval, of the three, at which the adversary can push the state farthest out of its tube."""
    velocity, scores = moment.interval.undisturbed(moment.states, moment.inputs, moment.time), []
    for late in (-1, 0, 1):
        span = np.full(len(moment.states), moment.remaining + late * moment.problem.sensing.jitter)
        push = pushes(moment, moment.states, moment.inputs, moment.time, span)
        ends = moment.states + span[:, None] * velocity + push
        scores.append(moment.tube(np.moveaxis(ends, 0, 1)).max(axis=1))
    return np.argmax(scores, axis=0) - 1


MISLEAD: dict[str, Callable[[Sight], FloatArray]] = {
    "none": lambda sight: np.zeros_like(sight.states),
    "random": lambda sight: sight.rng.uniform(-sight.box, sight.box, sight.states.shape),
    "worst": mislead_worst,
}
SHIFTING: dict[str, Callable[[Moment], FloatArray]] = {
    "none": lambda moment: np.zeros(len(moment.states), np.int64),
    "random": lambda moment: moment.rng.integers(-1, 2, len(moment.states)),
    "worst": shift_worst,
}


class _Runs:
    """The closed loop of M robots, from where their first inputs start."""

    def __init__(
        self,
        controller: Controller,
        starts: FloatArray,
        play: Adversary,
        rng: np.random.Generator,
        sensing: Sensing,
        ever: bool,
    ) -> None:
        self.ever = ever  # every step uses the tubes of step 0: nothing depends on time
        name = next((name for name, other in ADVERSARIES.items() if other is play and name in MISLEAD), "worst")
        self.mislead = getattr(play, "mislead", MISLEAD[name])
        self.shift = getattr(play, "shift", SHIFTING[name])
        self.controller, self.play, self.rng = controller, play, rng
        self.problem = problem = controller.problem
        if sensing != problem.sensing:
            self.problem = replace(problem, sensing=sensing)
        self.states, count = starts.copy(), len(starts)
        self.offsets = rng.integers(-1, 2, count) * (sensing.jitter > 0) * (name != "none")
        self.outcomes, self.taken = np.full(count, UNDECIDED), np.zeros(count, np.int64)
        self.predictions = self.measured(0, starts, np.zeros(count, np.int64), self.problem.half_widths[0])

    def measured(self, step: int, states: FloatArray, held: FloatArray, box: FloatArray | None = None) -> FloatArray:
        """The controller's predictions (M, ndim) from its measurements; with a `box`, of states where inputs start."""
        problem, begun = self.problem, box is not None
        errors = np.zeros(problem.grid.ndim) + np.array(problem.sensing.error) if box is None else box
        table, last = self.controller.table, step == self.controller.table.steps

        def predict(off: FloatArray) -> FloatArray:
            seen = states + off
            return problem.grid.clipped(seen) if begun else self.controller.predict(seen, held, step)

        def ask(off: FloatArray) -> tuple[FloatArray, FloatArray]:
            batch = self.controller.batch(predict(off), step)
            return (batch.steps_to_go if last else self.controller.choose(batch)), batch.steps_to_go

        def tube(points: FloatArray, left: FloatArray) -> FloatArray:
            return table.values_at(points[:, None], min(step + 1, table.steps), left)[:, 0]

        starting = states if begun else predicted(problem, states, held, step)
        seen, at = (sealed(states), sealed(errors)), min(step, table.steps - 1)  # adversaries only read
        errors_made = self.mislead(Sight(problem, *seen, at, sealed(starting), ask, tube, self.rng))
        off = real_array("the errors that the adversary returns", errors_made, states.shape)
        if not (np.abs(off) <= errors * (1 + 1e-12)).all():
            raise ValueError(f"the adversary must return measurement errors within +-{errors.tolist()}")
        return predict(off)

    def following(self, step: int) -> int:
        """The step whose tubes are used next."""
        return 0 if self.ever else step + 1

    def begins(self, step: int, offset: int) -> float:
        return self.problem.time(step) + offset * self.problem.sensing.jitter

    def decide(self, step: int, alive: FloatArray, last: bool) -> Moment | None:
        """End the runs that have reached the target or have no answer; the first moment of the others' interval."""
        problem, states = self.problem, self.states
        batch = self.controller.batch(self.predictions[alive], step)
        reached = np.full(alive.size, problem.stays and last)
        if not problem.stays:  # with jitter the target stands still
            reached = (batch.steps_to_go == 0) & (problem.target_value(states[alive], problem.time(step)) <= 0)
        self.outcomes[alive[reached]] = REACHED
        if last:
            return None
        inputs = self.controller.choose(batch)
        self.outcomes[alive[(inputs < 0) & ~reached]] = LEFT
        going = (inputs >= 0) & ~reached
        rows, to_go, now, table = alive[going], batch.steps_to_go[going], problem.time(step), self.controller.table
        return first_moment(table, problem, states[rows], inputs[going], to_go, step, now, rows, self.rng)

    def hold(self, moment: Moment, some: FloatArray, ends: int, watch: Watch | None, walls: bool) -> None:
        """Simulate some runs of a moment, whose interval begins and ends alike, with the measurement in it."""
        problem, rows = self.problem, moment.runs[some]
        begin, end = self.begins(moment.step, self.offsets[rows[0]]), self.begins(moment.step + 1, ends)
        delay, length = problem.sensing.delay, end - begin
        after = min(max(round(SUBSTEPS * delay / length), 1), SUBSTEPS - 1) if delay and length else 0
        states, inputs, to_go = moment.states[some], moment.inputs[some], moment.steps_to_go[some]
        begun = first_moment(self.controller.table, problem, states, inputs, to_go, moment.step, begin, rows, self.rng)
        begun = replace(begun, remaining=length, duration=(length - delay) / (SUBSTEPS - after))
        last = {"v": begun.previous}

        def play(now: Moment) -> FloatArray:
            last["v"] = real_array("what the adversary returns", self.play(now))
            return last["v"]

        states, ended = play_interval(begun, play, watch, walls, range(SUBSTEPS - after))
        seen = states
        if after:
            rest: dict[str, Any] = {"time": end - delay, "remaining": delay, "duration": delay / after}
            parts = range(SUBSTEPS - after, SUBSTEPS)
            later = replace(begun, states=states, previous=last["v"], **rest)
            states, then = play_interval(later, play, watch, walls, parts)
            ended = np.where(ended == UNDECIDED, then, ended)
        self.states[rows], self.outcomes[rows], self.offsets[rows] = states, ended, ends
        self.taken[rows] += 1
        on = ended == UNDECIDED
        if on.any():
            self.predictions[rows[on]] = self.measured(self.following(moment.step), seen[on], begun.inputs[on])


def sensed_rollouts(
    controller: Controller,
    starts: FloatArray,
    play: Adversary,
    rng: np.random.Generator,
    watch: Watch | None,
    walls: bool,
    steps: int | None,
    sensing: Sensing,
) -> tuple[FloatArray, FloatArray]:
    """As `sdhj.simulation.runs.rollouts`, with the given sensing, whatever the table was solved for."""
    runs, jitter = _Runs(controller, starts, play, rng, sensing, ever=steps is not None), sensing.jitter
    last, step = runs.problem.steps if steps is None else steps, 0
    for offset in (-1, 0, 1):
        some = runs.offsets == offset
        hit = runs.problem.unsafe_value(starts[some], runs.begins(0, offset)) <= 0
        runs.outcomes[np.flatnonzero(some)[hit]] = COLLIDED
    for number in range(last + 1):
        alive = np.flatnonzero(runs.outcomes == UNDECIDED)
        moment = runs.decide(step, alive, number == last) if alive.size else None
        step = runs.following(step)
        if moment is None or not moment.runs.size:
            break
        ends = real_array("what the adversary's shift returns", runs.shift(moment), moment.runs.shape)
        if not np.isin(ends, (-1, 0, 1)).all():
            raise ValueError(f"the adversary's shift must return -1, 0 or 1 for each run, got {ends.tolist()}")
        ends = ends * (jitter > 0)
        groups = 3 * runs.offsets[moment.runs] + ends
        for group in np.unique(groups):
            some = np.flatnonzero(groups == group)
            runs.hold(moment, some, int(ends[some[0]]), watch, walls)
    runs.outcomes[runs.outcomes == UNDECIDED] = LATE
    return runs.outcomes, runs.taken
