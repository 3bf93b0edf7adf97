"""The feedback controller of Sec. 4.3 (Algorithm 2), which reads the look-up table as in Fig. 8.

At step k a state q has n steps to go if n is the fewest for which q is in the tube S_k with n to go; n = 0 is success.
An input u_j keeps the promise if q is in its reach-avoid set of the tube S_{k+1} with n - 1 to go. The table answers
both questions (`notebooks/site/code.md` says how), and a rule selects one of the inputs.
"""

import reprlib
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Any

import numpy as np

from sdhj.common.checks import finite_array, number, plain_array, read_only_view, real_array, states_array, whole
from sdhj.common.remembering import FloatArray
from sdhj.table.batches import NOT_ADMISSIBLE, Batch, Table
from sdhj.table.beside import Fallback, Filtered, commands_of, fallbacks, predicted, squared_distances
from sdhj.table.rules import RULES, Candidates, Rule

PREPARED = 512  # states, of which one in the tube and one outside are asked about before the first query
CLOCK = 1e-9  # rounding of times, of the time and of an interval
SHIELDED = 1 / 3  # cells: what an input must keep on a grid that the filter lets pass


class NotAdmissible(ValueError):
    """No tube of this step contains the state.

    `Controller.fallback` answers for any state, `table.explain(q)` says why.

    Examples
    --------
    >>> import sdhj
    >>> controller = sdhj.Controller(sdhj.solve(sdhj.arm_case_study(nodes=13, steps=3)))
    >>> controller.select([-2.2, -0.9, 0.19, 0.22], 0)  # doctest: +ELLIPSIS
    Traceback (most recent call last):
        ...
    sdhj.table.controller.NotAdmissible: state [...] is not admissible at step 0: ...
    """


def _message_in_target(state: FloatArray, step: int) -> str:
    """The error about a state in the target that no input is proved to lead back into it."""
    return (
        f"state {state.tolist()} is in the target at step {step}, and no input is proved to bring it back into the "
        "target one step later; the task is done, or use fallback()"
    )


@dataclass(frozen=True)
class Action:
    """The answer of `Controller.step`: the input to apply from one delay after the measurement on.

    Attributes
    ----------
    input : int
        Index into problem.inputs.
    step : int
        The sampling time k to which the measurement belongs.
    steps_to_go : int or None
        As `Controller.steps_to_go`, for the prediction.
    promised : bool
        Whether the input is promised to be safe and to make progress.
    late : float
        How long after its sampling time the measurement was taken, s.
    missed : bool
        Whether `late` exceeds the problem's jitter, step - 1 had no measurement or, where the controller remembers,
        this one is farther from what was possible than its error allows. The loop then begins anew, with this
        measurement alone.
    point : (ndim,) array
        What the answer is about, and other queries may be, too: the prediction or the point that the controller carries
        on.
    """

    input: int
    step: int
    steps_to_go: int | None
    promised: bool
    late: float
    missed: bool
    point: FloatArray | None = field(default=None, compare=False, repr=False)

    @property
    def arrived(self) -> bool:
        """Whether the run is over: in the target or, without one, clear with no step left."""
        return self.steps_to_go == 0


class Controller:
    """Set-valued feedback from a table, for any state, at or between the nodes or off the grid (Algorithm 2).

    Queries take a state q (ndim,), in the units of the grid's axes, and the step k, from 0 to N, which may be omitted
    if nothing depends on time. Several threads may ask at once.

    With `Sensing`, states are predictions, made by `predict`; `step` does all that a control loop needs and, unless
    memory=False, carries a point on. Other queries then take only this point or, with `first=True`, what is predicted
    of a loop's first measurement.

    All methods raise ValueError where an argument does not fit.

    Parameters
    ----------
    table : Table
        What `sdhj.solve` or `sdhj.load` returns, of any method.
    rule : {"deepest", "effort", "target", "clearance"}, CostToGo or callable (Candidates) -> (P,) scores
        Which safe input `select` returns: that of the least score, and among equals that of the least margin. The
        scores are the margin; the norm of the input; the target's level-set value at the successor; the negative one of
        the unsafe sets there. A rule whose `all_left` is true, as `sdhj.CostToGo`, is asked of all inputs after which
        the target can still be reached by the last step; it needs the step always.

    Attributes
    ----------
    table, problem, rule, all_left
        As given; the problem is that of the table.
    depends_on_time : bool
        Whether the step has to be given.
    last : Action or None
        The last answer of `step`.
    remembered : (array, int) or None
        The point (ndim,) that `step` carries, and its step.

    Raises
    ------
    ValueError
        If the rule is unknown, or `table` is not a table.

    Examples
    --------
    >>> import sdhj
    >>> controller = sdhj.Controller(sdhj.solve(sdhj.arm_case_study(nodes=13, steps=3)))
    >>> state = [0.9, 0.8, -0.3, -0.3]  # rad, rad, m, m
    >>> controller.steps_to_go(state, 0), len(controller.safe_inputs(state, 0))
    (2, 2)
    >>> controller.problem.inputs[controller.select(state, 0)]  # rad/s
    array([-1.5,  3. ])
    """

    last: "Action | None" = None  # the last answer of `step`
    remembered: tuple[FloatArray, int] | None = None  # the point and the step that it was an answer to

    def __init__(self, table: Table, rule: str | Rule = "deepest") -> None:
        if not isinstance(table, Table):
            raise ValueError(f"table must be what sdhj.solve returns, got {type(table).__name__}")
        if not (callable(rule) and not isinstance(rule, type)) and not (isinstance(rule, str) and rule in RULES):
            shown = reprlib.repr(rule)
            raise ValueError(f"rule must be one of {', '.join(RULES)}, or a function of Candidates, got {shown}")
        self.table, self.problem, self.rule = table, table.problem, rule
        self.all_left = bool(getattr(rule, "all_left", False))
        self.depends_on_time = self.all_left or not self.problem.time_invariant  # whether answers depend on the step
        self.remembers = self.problem.sensing.remembers
        self._distances: dict[int, FloatArray] = {}  # of an input from all others
        self._prepare()

    def _prepare(self) -> None:
        """Ask the table what a control loop asks, so that no first answer takes longer."""
        grid, rng, step = self.problem.grid, np.random.default_rng(0), 0
        # compiled code is loaded, and what look-ups read is made; a rule of the user is not asked
        with suppress(Exception):  # what is wrong is said by the query that asks for it
            states = rng.uniform(grid.lower, grid.upper, (PREPARED, grid.ndim))
            values = self.table.values_at(states[:, None], step, np.full(PREPARED, self.table.steps))[:, 0]
            some = states[np.argsort(values, kind="stable")[[-1, 0]]]  # one in no tube, if there is one
            batch = self.table.answers(self.predict(some, step=step), step, 1)
            if isinstance(self.rule, str):
                self.choose(batch)
                self.safe_by_true_sets(batch)
            if self.remembers:
                self.table.next_points(some, np.zeros(len(some), np.int64), step, some)
            for one in some:
                self.fallback(one, step)
                self.filter(one, step, 0, first=True)
            self._explain(some[:1], step)

    # ---- one state

    def steps_to_go(self, q: FloatArray, step: int | None = None, *, first: bool = False) -> int | None:
        """Fewest steps in which the target can be reached safely, or None if no tube contains the state.

        0 in the target; without a target the number of steps left.

        Examples
        --------
        With the robot on a line of `help(sdhj)`:

        >>> controller.steps_to_go([-2.1], 0), controller.steps_to_go([0.5], 0), controller.steps_to_go([3.9], 0)
        (3, 0, None)
        """
        self._require_carried(q, step, first)
        to_go = int(self._query(q, step).steps_to_go[0])
        return None if to_go == NOT_ADMISSIBLE else to_go

    def safe_inputs(self, q: FloatArray, step: int | None = None, *, first: bool = False) -> FloatArray:
        """The inputs that are safe from a state, whatever the adversary does.

        Each leads into the tube of one step less, or from the target back into it.

        Returns
        -------
        (K,) int
            Indices into problem.inputs. Empty at the last step, and sometimes just inside a tube's boundary.

        Raises
        ------
        NotAdmissible
            If no tube of this step contains q.

        Examples
        --------
        With the robot on a line of `help(sdhj)`:

        >>> problem.inputs[controller.safe_inputs([-2.1], 0)]
        array([[1.]])
        """
        self._require_carried(q, step, first)
        return np.flatnonzero(self.safe_by_true_sets(self._admissible(q, step))[0])

    def select(self, q: FloatArray, step: int | None = None, before: int | None = None, *, first: bool = False) -> int:
        """The input to apply until the next measurement: of the safe ones, that of least score by the rule.

        Where `safe_inputs` is empty it is the one closest to being safe, without a promise.

        Parameters
        ----------
        q, step, first
            As `Controller` explains.
        before : int
            Index of the input held until now, which a rule may heed.

        Returns
        -------
        int
            Index into problem.inputs.

        Raises
        ------
        NotAdmissible
            If no tube of this step contains q; for a certified table also in the target, where no input is proved to
            lead back.
        ValueError
            At the last step N, or if a rule of your own does not return a number for each safe input.

        Examples
        --------
        With the robot on a line of `help(sdhj)`:

        >>> problem.inputs[controller.select([-2.1], 0)]
        array([1.])
        """
        self._require_carried(q, step, first)
        batch = self._admissible(q, step)
        if batch.step == self.table.steps:
            if self.table.proved and not self.problem.has_no_target and batch.steps_to_go[0] == 0:
                raise NotAdmissible(_message_in_target(batch.states[0], batch.step))
            raise ValueError(f"step {step} is the last: no interval is left to hold an input over")
        held = None
        if before is not None:
            held = np.array([whole("before", before, least=-1, most=len(self.problem.inputs) - 1)])
        chosen = int(self.choose(batch, held)[0])
        if chosen == NOT_ADMISSIBLE:  # -1 would be taken for the last input
            raise NotAdmissible(_message_in_target(batch.states[0], batch.step))
        return chosen

    def fallback(self, q: FloatArray, step: int | None = None) -> "Fallback":
        """The input that stays clear best in the next interval, for any state, also off the grid.

        Parameters
        ----------
        q, step
            As `Controller` explains.

        Raises
        ------
        ValueError
            At the last step N.

        Examples
        --------
        With the robot on a line of `help(sdhj)`, just before the wall, the way out is to the left:

        >>> answer = controller.fallback([2.95], 0)
        >>> problem.inputs[answer.input], answer.steps
        (array([-1.]), 1)
        """
        state = finite_array("a state", q, (self.problem.grid.ndim,))
        chosen, promised, hazards = fallbacks(self.table, state[None], self._at(step))
        return Fallback(int(chosen[0]), int(promised[0]), float(hazards[0]))

    def _at(self, step: int | None) -> int:
        """The step of a query, by default 0; ValueError where the answer depends on time then."""
        if step is None and self.depends_on_time:
            raise ValueError("the answer depends on time: give the step, for example select(q, step=0)")
        return 0 if step is None else step

    def _within(self, step: int) -> int:
        """The `within` of `Table.batch` for queries of a step: 1, or max(N - step, 1) for a rule with `all_left`."""
        if not self.all_left:
            return 1
        steps = self.table.steps
        return max(steps - whole("step", step, least=0, most=steps), 1)

    def _require_carried(self, q: FloatArray, step: int | None, first: bool) -> None:
        """ValueError where a table for controllers that remember is asked about predictions by themselves."""
        # exported tables refuse the same, by `SDHJ_NOT_CARRIED`
        if first or not self.remembers:
            return
        states, (point, at) = real_array("states", q), self.remembered or (None, None)
        carried = point is not None and states.shape[-1:] == point.shape and bool((states == point).all())
        if not carried or (self.depends_on_time and step != at):
            raise ValueError(
                "this table counts on a controller that remembers, and promises nothing of a prediction by itself: ask "
                "controller.step(measurement, time), or about the point that it carries on (action.point); say "
                "first=True of a loop's first prediction, or solve with Sensing(..., memory=False)"
            )

    def _query(
        self, q: FloatArray, step: int | None, within: int | None = None, scores: FloatArray | None = None
    ) -> Batch:
        """The answers for one state q (ndim,); without `within`, inputs are safe by the rule."""
        state, ndim = real_array("a state", q), self.problem.dynamics.ndim
        if state.shape != (ndim,):
            raise ValueError(f"a state must have shape {(ndim,)}, got {state.shape}; for many states use batch()")
        if not all(map(isfinite, state.tolist())):  # in a fourth of NumPy's time
            finite_array("a state", q)
        step = self._at(step)
        return self.table.answers(state[None], step, self._within(step) if within is None else within, scores)

    def _admissible(self, q: FloatArray, step: int | None) -> Batch:
        """The answers for one state q (ndim,); NotAdmissible, with the reason, if no tube has it."""
        batch = self._query(q, step)
        if batch.steps_to_go[0] == NOT_ADMISSIBLE:
            raise NotAdmissible(self._explain(batch.states, batch.step))
        return batch

    def _explain(self, states: FloatArray, step: int) -> str:
        """Why a state (1, ndim) is not admissible at a step, and what helps."""
        within, details = self.table.steps - step, self.table.details
        # the first that holds is said: an unsafe set before the end of the grid
        if self.problem.surely_in_no_tube(states, step, 1)[0]:
            where = "it is in the unsafe set"
        elif self.problem.grid.beyond(states, "fails", "holds")[0]:
            where = "it is off the grid"
        elif self.problem.grid.beyond(states, "frees")[0]:
            where = "it is past a safe end, where the task is over"
        elif self.table.proved:
            where = "its cell is not certified: table.explain says why"
        else:
            value = self.table.values_at(states[None], step, np.array([within]))[0, 0]
            where = f"its level-set value there is {value:.3g} > 0"
        state = np.array2string(states[0], precision=4, separator=", ")
        if step == self.problem.steps:
            return (
                f"state {state} is not admissible at step {step}, the last sampling time: the run is over then, so "
                f"there is no input to choose, and {where}; ask at a step from 0 to {step - 1}"
            )
        steps = f"{within} step{'s' * (within != 1)}"
        promise = f"stay clear for {steps}" if self.problem.has_no_target else f"reach the target within {steps}"
        finer = "cells" if self.table.proved else "nodes"
        more = f"steps or {finer}"
        if self.problem.has_no_target and details.get("endless"):
            promise, more = "stay clear for ever", finer
        return (
            f"state {state} is not admissible at step {step}: it is "
            f"outside the tube of the states that {promise} ({where}); choose a state "
            f"where table.contains(q, start={step}, within={within}) is true, or solve with more {more}"
        )

    # ---- in a control loop: predictions from measurements, and an answer at every sampling time, late ones included

    def predict(self, measurement: FloatArray, previous: Any = None, step: int | None = None) -> FloatArray:
        """Where a state measured at step k will be one delay later, when the input of step k takes effect.

        With a `Sensing`, tables are solved for these predictions: `select(predict(y, j, k), k)` answers a measurement y
        of step k, while the input j of step k - 1 still acts. `step` does this; a loop of `select` is as good only with
        memory=False.

        Parameters
        ----------
        measurement : (ndim,) or (M, ndim) array
        previous : int or (M,) int, optional
            The input that acts until then, by index; by default `Sensing.rest`.
        step : int, optional

        Returns
        -------
        array of the shape of `measurement`
            The true state will be within `problem.half_widths[0]` of it on each axis.

        Examples
        --------
        With the robot on a line of `help(sdhj)`, without a `Sensing` the state is the measurement:

        >>> controller.predict([-2.1], step=0)
        array([-2.1])
        """
        states, most = real_array("a measurement", measurement), len(self.problem.inputs) - 1
        given = plain_array("previous", self.problem.sensing.rest if previous is None else previous)
        count = 1 if states.ndim == 1 else len(states)
        valid = given.dtype.kind in "iu" and bool(((given >= 0) & (given <= most)).all())
        if not valid or given.shape not in ((), (count,)):
            raise ValueError(f"previous must be an index from 0 to {most}, or one for each measurement, got {given}")
        predictions = predicted(self.problem, np.atleast_2d(states), np.broadcast_to(given, count), self._at(step))
        return predictions[0] if states.ndim == 1 else predictions

    def admissible(self, measurement: FloatArray, previous: Any = None, step: int | None = None) -> Any:
        """Whether a state measured at step k is in the tube of all the remaining steps: what to ask before a run.

        It is asked of the prediction, where the robot has moved on by the delay under the previous input.

        Parameters
        ----------
        measurement, previous, step
            As for `predict`.

        Returns
        -------
        bool, or (M,) bool for many measurements

        Examples
        --------
        With the robot on a line of `help(sdhj)`:

        >>> controller.admissible([[-2.1], [3.9]], step=0)
        array([ True, False])
        """
        states = np.atleast_2d(self.predict(measurement, previous, step))
        batch = self.table.answers(states, self._at(step), self.table.steps - self._at(step))
        found = (batch.steps_to_go != NOT_ADMISSIBLE) & (batch.promised | (batch.steps_to_go == 0))
        return found if np.ndim(measurement) > 1 else bool(found[0])

    def step(self, measurement: FloatArray, time: float, *, fallback: bool = True) -> "Action":
        """Answer a measurement taken `time` seconds after a control loop began: see `Action`.

        The measurement belongs to the nearest sampling time; a time near 0 begins a new loop. If nothing depends on
        time, a loop may run without end; without a target it then stays clear for all of the table's steps from each
        step on or, where that cannot be, for those promised before.

        Parameters
        ----------
        measurement : (ndim,) array
        time : float
            s after the loop began: near 0 for the first.
        fallback : bool
            Whether `Controller.fallback` answers where the prediction is not admissible.

        Returns
        -------
        Action
            At the last step N it says whether the run has `arrived`, and its input is `Sensing.rest`.

        Raises
        ------
        NotAdmissible
            With fallback=False, if no tube of the step contains the prediction.
        ValueError
            If time does not increase from call to call, and after the last step.

        Examples
        --------
        With the robot on a line of `help(sdhj)`:

        >>> action = controller.step([-2.1], 0)
        >>> action.input, action.promised
        (2, True)
        """
        problem, steps = self.problem, self.table.steps
        # `Runs` of `sdhj.simulation.sensed` does the same for many robots at once, and `sdhj_step` in C for one robot,
        # by an exported table
        k, late, missed = self._sampling_time(time)
        last = None if k == 0 else self.last
        step, previous = k if self.depends_on_time else 0, last.input if last else None
        held = None if previous is None or missed else np.array([previous])
        state = self.predict(finite_array("a measurement", measurement, (problem.grid.ndim,)), previous, step)
        if self.remembers and last and not missed and self.remembered:
            kept, lost = self.table.next_points(
                self.remembered[0][None], np.array([last.input]), self.remembered[1], state[None]
            )
            state, missed = kept[0], bool(lost[0])
        batch = self.answers(state[None], step)
        left = last.steps_to_go if last and not missed and not self.depends_on_time and problem.has_no_target else None
        if batch.steps_to_go[0] == NOT_ADMISSIBLE and left is not None and left > 1:
            step = steps + 1 - left  # not for as long again, but for what is left of what was promised
            batch = self.answers(state[None], step)
        chosen, to_go = int(self.choose(batch, held)[0]), int(batch.steps_to_go[0])
        if step == steps:
            chosen = problem.sensing.rest
        elif chosen == NOT_ADMISSIBLE:  # in the target the task is done, and nobody waits for an input
            chosen = (
                self.fallback(state, step).input if fallback or to_go == 0 else self.select(state, step, first=True)
            )
        promised = bool(batch.promised[0]) and not missed
        self.remembered = state, step
        known = None if to_go == NOT_ADMISSIBLE else to_go
        self.last = Action(chosen, k, known, promised, late, missed, read_only_view(state))
        return self.last

    def _sampling_time(self, time: float) -> tuple[int, float, bool]:
        """(k, late, missed): the nearest sampling time, how late `time` is, s, and whether a deadline was missed."""
        problem, most = self.problem, (self.table.steps + 0.5) * self.problem.delta if self.depends_on_time else np.inf
        k = round(number("time", time, least=-problem.delta / 2, most=most) / problem.delta)
        last = None if k == 0 else self.last  # k = 0 begins a new loop
        if last is not None and k <= last.step:
            raise ValueError(
                f"time must increase: step {last.step} has been answered, and {time:g} s belongs to step {k}"
            )
        late = time - k * problem.delta
        after = last.step if last else -1
        return k, late, abs(late) > problem.sensing.jitter + CLOCK * max(problem.delta, time) or k != after + 1

    # ---- many states

    def batch(self, states: FloatArray, step: int | None = None, *, first: bool = False) -> Batch:
        """Steps to go, safe inputs and margins of many states at once.

        Parameters
        ----------
        states : (M, ndim) array
        step, first
            As `Controller` explains.

        Raises
        ------
        ValueError
            If an argument does not fit, or a state is not finite.

        Examples
        --------
        With the robot on a line of `help(sdhj)`:

        >>> controller.batch([[-2.1], [0.5]], 0).steps_to_go
        array([3, 0])
        """
        self._require_carried(states, step, first)
        return self.answers(states, step)

    def answers(self, states: FloatArray, step: int | None = None) -> Batch:
        """As `batch`, but no prediction is refused: for loops that carry points on themselves."""
        step = self._at(step)
        return self.table.batch(states, step, self._within(step))

    def filter(self, q: FloatArray, step: int | None = None, wanted: Any = None, *, first: bool = False) -> "Filtered":
        """The wanted input if it is safe, else the safe input nearest to it, else the fallback: a safety filter.

        An input is safe here if after it the target can still be reached by the last step. What a certified table lets
        pass is proved. On a grid an input passes only if its margin is at most -`SHIELDED` * `Table.change_over_cell`;
        where none does, it is the one of least margin.

        Parameters
        ----------
        q : (ndim,) or (M, ndim) array
            With a delay, what `predict` makes of measurements.
        step, first
            As `Controller` explains; from 0 to N - 1.
        wanted : int or (m,) array, or (M,) int or (M, m) arrays
            An index into problem.inputs or a command for each state, to which the nearest input is by Euclidean
            distance.

        Raises
        ------
        ValueError
            At the last step.

        Examples
        --------
        With the robot on a line of `help(sdhj)`, away from the target is refused:

        >>> answer = controller.filter([-2.9], 0, wanted=0)
        >>> int(answer.inputs), bool(answer.overruled)
        (2, True)
        """
        step = whole("step", self._at(step), least=0, most=self.table.steps - 1)
        self._require_carried(q, step, first)
        if self.table.proved and np.ndim(q) == 1 and (found := self._filtered(q, step, wanted)):
            return found
        q, wanted = real_array("states", q), plain_array("wanted", wanted)
        if single := q.ndim == 1:
            q, wanted = q[None], wanted[None]
        states = states_array("states", q, self.problem.grid.ndim)
        inputs, rows = self.problem.inputs, np.arange(len(states))
        commands, index = commands_of(inputs, wanted, len(rows))
        distances = squared_distances(inputs, commands)  # (M, L)
        if index is not None:
            distances[rows, index] = -1.0  # before another input of the same command
        if self.table.proved:
            batch = self.table.answers(states, step, self.table.steps - step, distances)
            chosen = batch.best
        else:
            batch = self.table.answers(states, step, self.table.steps - step)
            chosen = self.table.preferred(batch, np.where(self.allowed(batch), distances, np.inf))
        promised = batch.promised
        if (lost := chosen == NOT_ADMISSIBLE).any():
            chosen[lost] = fallbacks(self.table, batch.states[lost], step)[0]
        changed = chosen != index if index is not None else (inputs[chosen] != commands).any(axis=1)
        overruled = distances[rows, chosen] > distances.min(axis=1)
        answer: Sequence[Any] = (chosen, inputs[chosen], changed, overruled, promised, ~promised)
        return Filtered(*(field[0] for field in answer) if single else answer)

    def _filtered(self, q: FloatArray, step: int, wanted: Any) -> "Filtered | None":
        """The answer of `filter` for a state of a proved table, in half the time; None leaves it to `filter`."""
        # `filter` and `sdhj_filter_at` of sdhj.h have the same rule: all three have to choose alike
        inputs, index = self.problem.inputs, wanted if type(wanted) is int else None
        if index is None:
            wanted = plain_array("wanted", wanted)
            if wanted.shape != inputs.shape[1:] or wanted.dtype.kind != "f" or not all(map(isfinite, wanted.tolist())):
                return None
            distances = squared_distances(inputs, wanted[None])
        elif not 0 <= index < len(inputs):
            return None
        elif index not in self._distances:
            self._distances[index] = squared_distances(inputs, inputs[index][None])
            self._distances[index][0, index] = -1.0
        distances = distances if index is None else self._distances[index]
        batch = self._query(q, step, self.table.steps - step, distances)
        chosen = batch.best[0]
        if chosen == NOT_ADMISSIBLE:
            return None
        changed = overruled = chosen != index
        if index is None:
            changed = np.bool_(inputs[chosen].tolist() != wanted.tolist())
            least = distances.argmin()  # which is found in a fifth of the time that min takes
            overruled = np.bool_(distances[0, chosen] > distances[0, least])
        return Filtered(chosen, inputs[chosen], changed, overruled, np.True_, np.False_)

    def choose(self, batch: Batch, before: FloatArray | None = None) -> FloatArray:
        """Index of the input that the rule prefers for each state of a batch, (M,); -1 if there is none.

        The safe input of least score that is also safe by the true sets or, if none is, `Batch.best`.

        Parameters
        ----------
        batch : Batch
            Of the controller or of its table.
        before : (M,) int, optional
            The inputs held until now; -1 where none is known.

        Raises
        ------
        ValueError
            If a rule of your own does not return a number for each candidate.

        Examples
        --------
        With the robot on a line of `help(sdhj)`:

        >>> controller.choose(controller.batch([[-2.1], [2.1]], 0))
        array([2, 0])
        """
        # `best` is the safe input of least margin already, or without one the best that there is
        if self.rule == "deepest" or not batch.safe.any():
            return batch.best.copy()
        if self.table.proved and isinstance(self.rule, str):
            return self.table.choose_by_rule(batch, self.rule)
        asked = self.allowed(batch) if self.all_left else batch.safe
        scores = np.full(asked.shape, np.inf)
        rows, inputs = np.nonzero(asked)
        held = np.full(len(rows), -1) if before is None else np.asarray(before)[rows]
        scores[asked] = self.scores(Candidates(self.problem, batch, rows, inputs, held))
        return self.table.preferred(batch, scores)

    def allowed(self, batch: Batch) -> FloatArray:
        """Which safe inputs the filter, and a rule with `all_left`, may choose: (M, L)."""
        if self.table.proved:
            return batch.safe
        margins = np.where(batch.safe, batch.margins, np.inf)
        # those that keep a part of a cell or, where none does, those of the least margin
        return batch.safe & (
            margins <= np.maximum(-SHIELDED * self.table.change_over_cell, margins.min(axis=1, keepdims=True))
        )

    def safe_by_true_sets(self, batch: Batch) -> FloatArray:
        """Which inputs are safe by the tubes and by the true sets: bool (M, L), new."""
        rows, inputs = np.nonzero(batch.safe)  # which the true sets have passed only up to `Batch.best`
        safe = batch.safe.copy()
        safe[rows, inputs] = self.table.passes_true_sets(
            batch.states[rows], inputs, batch.step, batch.steps_after[rows]
        )
        return safe

    def scores(self, candidates: Candidates) -> FloatArray:
        """The rule's score for each of P candidates: (P,)."""
        if callable(self.rule):
            # with read-only arrays, as a user's function could write to them
            answer = self.rule(replace(candidates, batch=candidates.batch.sealed()))
        else:
            answer = RULES[self.rule](candidates)
        scores, shape = real_array(f"the answer of rule {self.rule!r}", answer), candidates.rows.shape
        if scores.shape != shape:
            raise ValueError(
                f"rule {self.rule!r} must return a score for each candidate, shape {shape}, got {scores.shape}"
            )
        if (odd := np.isnan(scores)).any():
            state, j = candidates.states[odd][0], candidates.inputs[odd][0]
            raise ValueError(
                f"rule {self.rule!r} met a NaN, for input {j} in state {state.tolist()}; look at the functions it "
                "calls, for example the level-set functions of the problem"
            )
        return scores
