"""The closed loop of many robots at once, with or without measurement errors, delay and jitter.

With these the adversary makes three choices: the disturbance, at every substep; the error of every measurement; and
when the next input starts. A run begins when the first input starts, from a state that the controller has measured up
to an error in the box E of `sdhj.problem.sensing`. Runs end as `sdhj.simulation.runs` says, but for one difference: a
run counts as reached only when the prediction has no steps to go and the state is in the true target.

An adversary that is a plain function of a `Moment` chooses the disturbance only. An adversary may also have the methods
`mislead(sight)`, which returns the errors (M, ndim), and `shift(moment)`, which returns for each run (M,) -1, 0 or 1:
the next input starts early, on time or late, by the full jitter.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from sdhj.common.checks import read_only_view, real_array
from sdhj.common.remembering import FloatArray
from sdhj.problem.sensing import Sensing
from sdhj.simulation.adversaries import ADVERSARIES, SUBSTEPS, Adversary, Moment, Sight, first_moment
from sdhj.simulation.outcomes import COLLIDED, LATE, LEFT, REACHED, UNDECIDED, Watch, play_interval
from sdhj.table.beside import predicted
from sdhj.table.controller import Controller


class Runs:
    """The closed loop of M robots: their states, outcomes and predictions, an interval at a time.

    It begins where their first inputs start, at step 0. Then `simulate_interval` is called for number 0, 1, ..., last;
    whoever chooses inputs otherwise (`ReachAvoidEnv`) calls `simulate_inputs` and then `end_reached`. A run is over
    when its outcome is not `UNDECIDED`.

    Attributes
    ----------
    states, predictions : (M, ndim) array
        When the next interval begins. Without a `Sensing` it is one array.
    outcomes : (M,) int array
        Indices into `OUTCOMES`, or `UNDECIDED`; never `LATE`.
    intervals_played : (M,) int array
    previous_inputs : (M,) int array
        By index; -1 before the first.
    offsets : (M,) int array
        -1, 0 or 1: the next interval begins early, on time or late, by the jitter.
    problem : ReachAvoidProblem
        The controller's, with the sensing that is simulated.
    mislead, shift : callable
        Of the adversary, or those of "worst".
    """

    def __init__(
        self,
        controller: Controller,
        starts: FloatArray,
        play: Adversary,
        rng: np.random.Generator,
        sensing: Sensing,
        watch: Watch | None,
        first_tubes_only: bool,  # every step uses the tubes of step 0, as nothing depends on time
        controller_chooses: bool = True,  # else adversaries play against the tubes of all steps that are left
    ) -> None:
        """Runs from starts (M, ndim), copied, and measured at once if there is a `Sensing`."""
        self.controller_chooses, self.first_tubes_only = controller_chooses, first_tubes_only
        self.watch = watch
        self.mislead = getattr(play, "mislead", ADVERSARIES["worst"].mislead)
        self.shift = getattr(play, "shift", ADVERSARIES["worst"].shift)
        self.controller, self.play, self.rng = controller, play, rng
        count = len(starts)
        same = sensing == controller.problem.sensing
        self.remembers = controller.remembers
        self.problem = controller.problem if same else replace(controller.problem, sensing=sensing)
        self.states, self.offsets = starts.copy(), np.zeros(count, np.int64)
        self.outcomes, self.intervals_played = np.full(count, UNDECIDED), np.zeros(count, np.int64)
        self.previous_inputs = np.full(count, -1)  # the inputs before
        self.predictions = self.states  # the same array: nothing is measured without sensing
        if sensing:
            # the first interval of each run begins early, on time or late at random
            self.offsets = rng.integers(-1, 2, count) * (sensing.jitter > 0) * (play != ADVERSARIES["none"])
            self.predictions = self.predict_from_measurements(
                0, starts, self.intervals_played, self.problem.half_widths[0]
            )

    def predict_from_measurements(
        self,
        step: int,
        states: FloatArray,
        before: FloatArray,
        box: FloatArray | None = None,  # at a run's start: how far predictions are off, which need no measurement
        known: tuple[FloatArray, int] | None = None,
    ) -> FloatArray:
        """The controllers' predictions (M, ndim) at a step, from measurements whose errors the adversary chooses.

        `before` are the inputs held until the next ones start; `known` the points that controllers carry, and their
        step.
        """
        problem, begun = self.problem, box is not None
        errors = np.zeros(problem.grid.ndim) + np.array(problem.sensing.error) if box is None else box
        table, last = self.controller.table, step == self.controller.table.steps

        def predict(off: FloatArray) -> FloatArray:
            seen = states + off
            found = problem.grid.clipped(seen) if begun else self.controller.predict(seen, before, step)
            return table.next_points(known[0], before, known[1], found)[0] if known else found

        def ask(off: FloatArray) -> tuple[FloatArray, FloatArray]:
            batch = self.controller.answers(predict(off), step)
            # at the last step no input is chosen
            chosen = batch.steps_to_go if last else self.controller.choose(batch, None if begun else before)
            return chosen, np.where(batch.steps_to_go > 0, batch.steps_after + 1, batch.steps_to_go)

        def tube(points: FloatArray, left: FloatArray) -> FloatArray:
            return table.values_at(points[:, None], min(step + 1, table.steps), left)[:, 0]

        starting = states if begun else predicted(problem, states, before, step)
        seen, at = (read_only_view(states), read_only_view(errors)), min(step, table.steps - 1)  # adversaries only read
        errors_made = self.mislead(Sight(problem, *seen, at, read_only_view(starting), ask, tube, self.rng))
        off = real_array("the errors that the adversary returns", errors_made, states.shape)
        if not (np.abs(off) <= errors * (1 + 1e-12)).all():
            raise ValueError(f"the adversary must return measurement errors within +-{errors.tolist()}")
        return predict(off)

    def begin_time(self, number: int, offset: int) -> float:
        """When the interval of that number begins, s: t_number + offset * jitter."""
        return self.problem.time(number) + offset * self.problem.sensing.jitter

    def first_moment(
        self, number: int, begin: float, rows: FloatArray, inputs: FloatArray, to_go: FloatArray
    ) -> Moment:
        """What the adversary sees of the runs `rows` (R,) when their interval begins."""
        step, table = 0 if self.first_tubes_only else number, self.controller.table
        every = self.controller.all_left or not self.controller_chooses
        # who may use all the steps left is judged by the tube of these, not by that of the fewest
        left: FloatArray | None = np.full(len(rows), table.steps - step - 1) if every else None
        return first_moment(table, self.problem, self.states[rows], inputs, to_go, step, begin, rows, self.rng, left)

    def end_reached(self, number: int, last: bool) -> FloatArray:
        """End, as `REACHED`, the runs that are in the target at a sampling time; the others, (R,), are returned.

        Without a target all that go on end so at the `last` sampling time.
        """
        problem, alive, step = (
            self.problem,
            np.flatnonzero(self.outcomes == UNDECIDED),
            0 if self.first_tubes_only else number,
        )
        reached = np.full(alive.size, problem.has_no_target and last)
        if alive.size and not problem.has_no_target:
            reached = problem.target_value(self.states[alive], problem.time(number)) <= 0
            if problem.sensing:  # the robot has to know; with jitter the target stands still
                known = self.controller.answers(self.predictions[alive[reached]], step).steps_to_go == 0
                reached[reached] = known
        self.outcomes[alive[reached]] = REACHED
        return alive[~reached]

    def simulate_interval(self, number: int, last: bool) -> None:
        """End the runs that are over at a sampling time, and simulate the others, unless it is the `last`, for an
        interval.
        """
        alive, step = self.end_reached(number, last), 0 if self.first_tubes_only else number
        if last or not alive.size:
            return
        batch = self.controller.answers(self.predictions[alive], step)
        inputs = self.controller.choose(batch, self.previous_inputs[alive])
        # Below 0 where no input is safe.
        self.outcomes[alive[inputs < 0]] = LEFT
        self.simulate_inputs(number, alive[inputs >= 0], inputs[inputs >= 0], batch.steps_to_go[inputs >= 0])

    def simulate_inputs(self, number: int, rows: FloatArray, inputs: FloatArray, to_go: FloatArray) -> None:
        """Simulate the runs `rows` (R,) for an interval under these inputs (R,)."""
        problem = self.problem
        next_offsets: FloatArray = np.zeros(rows.size, np.int64)
        if problem.sensing and rows.size:  # the adversary says when the next inputs start
            answer = self.shift(self.first_moment(number, problem.time(number), rows, inputs, to_go))
            next_offsets = real_array("what the adversary's shift returns", answer, rows.shape)
            if not np.isin(next_offsets, (-1, 0, 1)).all():
                raise ValueError(
                    f"the adversary's shift must return -1, 0 or 1 for each run, got {next_offsets.tolist()}"
                )
            next_offsets = next_offsets * (problem.sensing.jitter > 0)
        # all runs of a group begin, and end, at one time, as `play_interval` needs
        groups = 3 * self.offsets[rows] + next_offsets
        for group in np.unique(groups):
            some = groups == group
            self.simulate_group(number, rows[some], inputs[some], to_go[some], int(next_offsets[some][0]))

    def simulate_group(
        self, number: int, rows: FloatArray, inputs: FloatArray, to_go: FloatArray, next_offset: int
    ) -> None:
        """Simulate the runs `rows` for an interval that begins, and ends, at one time for all of them.

        With a `Sensing` `predictions` are made of those that go on, measured one delay before its end.
        """
        sensing, begin, after = self.problem.sensing, self.begin_time(number, self.offsets[rows[0]]), 0
        begun = self.first_moment(number, begin, rows, inputs, to_go)
        if sensing:
            end, delay = self.begin_time(number + 1, next_offset), sensing.delay
            length = end - begin
            # At least one substep on each side of the measurement.
            after = min(max(round(SUBSTEPS * delay / length), 1), SUBSTEPS - 1) if delay and length else 0
            begun = replace(begun, remaining=length, duration=(length - delay) / (SUBSTEPS - after))
        states, ended, v = play_interval(begun, self.play, self.watch, range(SUBSTEPS - after))
        seen = states
        if after:
            rest: dict[str, Any] = {"time": end - delay, "remaining": delay, "duration": delay / after}
            later = replace(begun, states=states, previous=v, **rest)
            states, then, _ = play_interval(later, self.play, self.watch, range(SUBSTEPS - after, SUBSTEPS))
            # What has ended before the measurement has ended so.
            ended = np.where(ended == UNDECIDED, then, ended)
        self.states[rows], self.outcomes[rows], self.offsets[rows], self.previous_inputs[rows] = (
            states,
            ended,
            next_offset,
            inputs,
        )
        self.intervals_played[rows] += 1
        # `seen` is from one delay before the end, when the next input's measurement is taken
        on = ended == UNDECIDED
        if sensing and on.any():
            known = (self.predictions[rows[on]], 0 if self.first_tubes_only else number) if self.remembers else None
            step = 0 if self.first_tubes_only else number + 1
            self.predictions[rows[on]] = self.predict_from_measurements(step, seen[on], inputs[on], known=known)


def rollouts(
    controller: Controller,
    starts: FloatArray,
    play: Adversary,
    rng: np.random.Generator,
    watch: Watch | None = None,
    *,
    steps: int | None = None,  # all by the tubes of step 0; None: all steps of the problem in order
    sensing: Sensing | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Outcomes, indices into `OUTCOMES`, and numbers of intervals of a run from each start: (M,) each."""
    sensing = controller.problem.sensing if sensing is None else sensing
    runs = Runs(controller, starts, play, rng, sensing, watch, first_tubes_only=steps is not None)
    # By offsets, as sets may move and runs of another offset begin at another time.
    for offset in np.unique(runs.offsets):
        some = np.flatnonzero(runs.offsets == offset)
        runs.outcomes[some[runs.problem.unsafe_value(starts[some], runs.begin_time(0, offset)) <= 0]] = COLLIDED
    last = runs.problem.steps if steps is None else steps
    for number in range(last + 1):
        runs.simulate_interval(number, number == last)
    runs.outcomes[runs.outcomes == UNDECIDED] = LATE
    return runs.outcomes, runs.intervals_played
