"""Closed-loop simulation of a robot that measures with an error, acts late, and whose instants jitter.

The adversary then has three things to choose, and may choose them together: the disturbance, at every substep; the
error of every measurement; when the next input starts. A run begins when the first input starts, in a state that is
known to within the box E of `sdhj.problem.sensing`. It ends as in `sdhj.simulation.runs`, but for this: reached is what
the controller knows to be reached, its prediction has no steps to go and the state is truly in the target.

An adversary that is a function of a `Moment` chooses the disturbance alone. One that has methods `mislead(sight)`,
which returns the errors (M, ndim), and `shift(moment)`, which returns -1, 0 or 1 (M,) for the next input to start
early, on time or late by all the jitter, chooses these too; for the named ones `MISLEAD` and `SHIFTING` do, and for
other functions those of "worst".
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
    """What an adversary sees when M states are measured.

    Attributes
    ----------
    problem : ReachAvoidProblem
        The robot's, with the sensing that is played.
    states : (M, ndim) array
        Where each run is.
    box : (ndim,) array
        The most by which the answer may be off.
    step : int
        The instant that it is for.
    starting : (M, ndim) array
        Where each run will be when the input starts, without a disturbance.
    ask : callable (errors (M, ndim)) -> inputs, steps to go
        What the controller would choose, both (M,) int; -1 where it had no answer.
    tube : callable (points (M, ndim), steps to go (M,)) -> (M,)
        Level-set value of the predictions from which they can be kept, one step later.
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
    """Displacements by each vertex of the adversary's box over a span (M,) of time: (vertices, M, ndim)."""
    interval = moment.problem.interval(moment.step)
    gain, bounds = interval.gain(states, inputs, t), interval.bounds(inputs, t)
    signs = np.array(list(product((-1.0, 1.0), repeat=bounds.shape[1])))
    return span[:, None] * np.einsum("mad,vmd->vma", gain, signs[:, None] * bounds)


def mislead_worst(sight: Sight) -> FloatArray:
    """The vertex of the box, or nothing, after which the input that is chosen leaves the true state worst off."""
    problem, count = sight.problem, len(sight.states)
    corners = np.array(list(product(*((-width, width) if width else (0.0,) for width in sight.box))))
    best, worst = np.zeros_like(sight.states), np.full(count, -np.inf)
    t, span = problem.time(sight.step), np.full(count, problem.delta)
    for corner in np.concatenate([np.zeros((1, len(sight.box))), corners]):
        errors = np.tile(corner, (count, 1))
        inputs, to_go = sight.ask(errors)
        held = np.maximum(inputs, 0)
        velocity = problem.interval(sight.step).undisturbed(sight.starting, held, t)
        ends = sight.starting + span[:, None] * velocity + pushes(sight, sight.starting, held, t, span)
        score = np.max([sight.tube(end, np.maximum(to_go, 1) - 1) for end in ends], axis=0)
        score = np.where(inputs < 0, LOST, score)
        best, worst = np.where((score > worst)[:, None], errors, best), np.maximum(worst, score)
    return best


def shift_worst(moment: Moment) -> FloatArray:
    """The end of the interval, of the three, at which the adversary can bring the robot farthest out of its tube."""
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
        self.ever = ever  # asked as of step 0 throughout: nothing depends on time
        name = next((name for name, known in ADVERSARIES.items() if known is play and name in MISLEAD), "worst")
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
        """What the controller makes of its measurements: predictions (M, ndim). With a box the states have started."""
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
            raise ValueError(f"the adversary must keep the errors within +-{errors.tolist()}")
        return predict(off)

    def following(self, step: int) -> int:
        """The step that is asked about next."""
        return 0 if self.ever else step + 1

    def begins(self, step: int, offset: int) -> float:
        return self.problem.time(step) + offset * self.problem.sensing.jitter

    def decide(self, step: int, alive: FloatArray, last: bool) -> Moment | None:
        """End what is reached, or has no answer; the others hold an input over the interval that begins."""
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

    def hold(self, moment: Moment, own: FloatArray, ends: int, watch: Watch | None, walls: bool) -> None:
        """Play some runs of a moment over their interval, with the measurement in it; they begin and end alike."""
        problem, rows = self.problem, moment.runs[own]
        begin, end = self.begins(moment.step, self.offsets[rows[0]]), self.begins(moment.step + 1, ends)
        delay, length = problem.sensing.delay, end - begin
        after = min(max(round(SUBSTEPS * delay / length), 1), SUBSTEPS - 1) if delay and length else 0
        states, inputs, to_go = moment.states[own], moment.inputs[own], moment.steps_to_go[own]
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
    """As `sdhj.simulation.runs.rollouts`, of robots that sense so, whatever the table was solved for."""
    runs, jitter = _Runs(controller, starts, play, rng, sensing, ever=steps is not None), sensing.jitter
    last, step = runs.problem.steps if steps is None else steps, 0
    for offset in (-1, 0, 1):
        own = runs.offsets == offset
        hit = runs.problem.unsafe_value(starts[own], runs.begins(0, offset)) <= 0
        runs.outcomes[np.flatnonzero(own)[hit]] = COLLIDED
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
            own = np.flatnonzero(groups == group)
            runs.hold(moment, own, int(ends[own[0]]), watch, walls)
    runs.outcomes[runs.outcomes == UNDECIDED] = LATE
    return runs.outcomes, runs.taken
