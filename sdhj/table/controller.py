"""The feedback controller of Sec. 4.3 (Algorithm 2), read as Fig. 8 is.

At step k a state q has n steps to go, the fewest with q in the tube S_k of that n; n = 0 is success. Every input u_j
whose reach-avoid set holds q, that of the tube S_{k+1} with n - 1 to go, then keeps the promise: all this the table
answers, and `sdhj.table.table` says how. A rule picks one of the inputs.
"""

import reprlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from sdhj.kernels import FloatArray
from sdhj.problem.checks import finite_array, number, plain_array, real_array, sealed, states_array, whole
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.table.ahead import first_passing
from sdhj.table.batches import NOT_ADMISSIBLE, Batch, Table, take_least

STRIDES = 8  # steps of order 4 in which a measurement is moved on
CLOCK = 1e-9  # of times, s


class NotAdmissible(ValueError):
    """No tube of the table holds the state: nothing is known that leads it to the target safely in time."""


@dataclass(frozen=True)
class Candidates:
    """What a rule scores: P pairs of a state of a batch and an input that is safe there, the state's place ascending.

    Attributes
    ----------
    problem : ReachAvoidProblem
    step : int
        The sampling time t_k at which the inputs start.
    rows, inputs : (P,) int array
        Places of the state in the batch and of the input in problem.inputs.
    states : (P, ndim) array
    steps_to_go : (P,) int array
    margins : (P,) array
        The largest level-set value that the adversary can bring about.
    successors : (P, ndim) array
        Where the input leads in one interval without an adversary.
    """

    problem: ReachAvoidProblem
    batch: Batch
    rows: FloatArray
    inputs: FloatArray

    @property
    def step(self) -> int:
        return self.batch.step

    @property
    def states(self) -> FloatArray:
        return self.batch.states[self.rows]

    @property
    def steps_to_go(self) -> FloatArray:
        return self.batch.steps_to_go[self.rows]

    @property
    def margins(self) -> FloatArray:
        return self.batch.margins[self.batch.safe]

    @property
    def successors(self) -> FloatArray:
        moves = self.problem.interval(self.step).displacements(self.batch.states)
        moved = self.states + moves[self.rows if len(moves) > 1 else 0, self.inputs]
        return self.problem.grid.clipped(moved)


Rule = Callable[[Candidates], FloatArray]
RULES: dict[str, Rule] = {  # of the scores (P,) the least wins
    "deepest": lambda among: among.margins,
    "effort": lambda among: np.linalg.norm(among.problem.inputs, axis=1)[among.inputs],
    "target": lambda among: among.problem.target_value(among.successors, among.problem.time(among.step + 1)),
    "clearance": lambda among: -among.problem.unsafe_value(among.successors, among.problem.time(among.step + 1)),
}


@dataclass(frozen=True)
class Action:
    """What to do from the next start of an input on, one delay after the measurement.

    Attributes
    ----------
    input : int
        Index into problem.inputs.
    step : int
        The instant that the measurement was taken for.
    steps_to_go : int or None
        As `Controller.steps_to_go`, of the prediction; 0 is success, None where it is not admissible.
    promised : bool
        Whether the table promises it, `Batch.promised`. Never where the instant was missed.
    late : float
        By how much the measurement came after its instant, s; negative where it came before.
    missed : bool
        Whether that is more than the jitter the table was solved for, or no measurement came at the instant before.
    """

    input: int
    step: int
    steps_to_go: int | None
    promised: bool
    late: float
    missed: bool


@dataclass(frozen=True)
class Fallback:
    """The input that stays clear of the unsafe sets longest, as far as the avoid tubes tell.

    Attributes
    ----------
    input : int
        Index into problem.inputs.
    steps : int
        For how many steps it is promised to stay clear of the unsafe sets, whatever the adversary does: 1 where its
        avoid tube holds the state (up to interpolation; of a certified table by its proof), else 0: nothing is
        promised. Nothing is ever promised off the grid, nor that the target will be reached.
    hazard : float
        The value of that avoid tube at the state: <= 0 inside, -inf where there is no unsafe set.
    """

    input: int
    steps: int
    hazard: float


@dataclass(frozen=True)
class Filtered:
    """What to apply in place of what was wanted, for M states; for one state each is a number, or one command.

    Attributes
    ----------
    inputs : (M,) int
        Indices into problem.inputs of what to apply.
    commands : (M, m)
        These inputs.
    changed : (M,) bool
        Whether that is anything else than was wanted. A command between the quantised inputs always is: safety is
        proved for those only.
    overruled : (M,) bool
        Whether an input nearer to what was wanted was refused.
    promised : (M,) bool
        Whether the target can still be reached safely by the last step, as the table promises it.
    fallback : (M,) bool
        Whether no input is known to be safe, so that the best there is is applied without a promise: that of
        `Batch.best` where the state is admissible, else that of `Controller.fallback`.
    """

    inputs: Any
    commands: FloatArray
    changed: Any
    overruled: Any
    promised: Any
    fallback: Any


class Controller:
    """Set-valued feedback from a table, for any state, on or off the grid (Algorithm 2).

    Queries of one state may come from several threads at once, also while a solve runs. Where nothing depends on time
    the step may be left out: what is right at step 0 is at any time, so a robot may run for as long as it likes.
    With `Sensing` the states asked for are predictions, made by `predict`; `step` does all that a loop needs.

    Parameters
    ----------
    table : Table
        What `sdhj.solve` or `sdhj.load` returns, of any method.
    rule : {"deepest", "effort", "target", "clearance"} or callable (Candidates) -> (P,) scores
        Which safe input `select` takes: that of least score, of equals the one of least margin. The named rules: least
        margin; least norm; the successor, without an adversary, nearest to the target, or farthest from the unsafe
        sets. "target" and "clearance" call the problem's own level-set functions, and last as long as those do.

    Raises
    ------
    ValueError
        For an unknown rule, or what is no table.
    """

    last: "Action | None" = None  # what `step` answered last

    def __init__(self, table: Table, rule: str | Rule = "deepest") -> None:
        if not isinstance(table, Table):
            raise ValueError(f"table must be what sdhj.solve returns, got {type(table).__name__}")
        if not callable(rule) and not (isinstance(rule, str) and rule in RULES):
            shown = reprlib.repr(rule)
            raise ValueError(f"rule must be one of {', '.join(RULES)}, or a function of Candidates, got {shown}")
        self.table, self.problem, self.rule = table, table.problem, rule

    # ---- one state

    def steps_to_go(self, q: FloatArray, step: int | None = None) -> int | None:
        """Fewest steps in which the target is reached safely from state q (ndim,) at a step; None if not admissible.

        0 is in the target. Without a target: for how many steps q may stay, which are all that are left.
        """
        to_go = int(self._query(q, step).steps_to_go[0])
        return None if to_go == NOT_ADMISSIBLE else to_go

    def safe_inputs(self, q: FloatArray, step: int | None = None) -> FloatArray:
        """Indices into problem.inputs of the inputs that are safe and make progress from q (ndim,) at a step.

        With no steps to go they bring the state back into the target one step later. Each has been looked at
        (`Table.passes`). None at the last step, and where none is known to be safe, as there may be next to the
        boundary of a tube: `select` then takes the best there is.

        Raises
        ------
        NotAdmissible
            Where no tube holds q.
        """
        return np.flatnonzero(self.checked(self._admissible(q, step))[0])

    def select(self, q: FloatArray, step: int | None = None) -> int:
        """Index into problem.inputs of the safe input that the rule prefers; where none is safe, of the best there is.

        Raises
        ------
        NotAdmissible
            Where no tube holds q; of a certified table also in the target, where no input is proved to bring q back.
        ValueError
            At the last step, where no interval is left, and where a rule does not give a number for each candidate.
        """
        batch = self._admissible(q, step)
        if batch.step == self.table.steps:
            raise ValueError(f"step {step} is the last: no interval is left to hold an input over")
        chosen = int(self.choose(batch)[0])
        if chosen == NOT_ADMISSIBLE:  # an index all the same, of the last input
            raise NotAdmissible(
                f"state {batch.states[0].tolist()} is in the target at step {step}, and no input is proved to bring it "
                "back into the target one step later"
            )
        return chosen

    def fallback(self, q: FloatArray, step: int | None = None) -> "Fallback":
        """The input that stays clear of the unsafe sets longest from any q (ndim,): see `Fallback`."""
        return fallback(self.table, q, self._at(step))

    def _at(self, step: int | None) -> int:
        if step is None and not self.problem.timeless:
            raise ValueError("the answer depends on time: say at which step, for example select(q, step=0)")
        return 0 if step is None else step

    def _query(self, q: FloatArray, step: int | None) -> Batch:
        state, shape = real_array("a state", q), (self.problem.grid.ndim,)
        if state.shape != shape:
            raise ValueError(f"a state must have shape {shape}, got {state.shape}; for many states use batch()")
        return self.batch(state[None], step)

    def _admissible(self, q: FloatArray, step: int | None) -> Batch:
        batch = self._query(q, step)
        if batch.steps_to_go[0] == NOT_ADMISSIBLE:
            raise NotAdmissible(self._explain(batch.states, batch.step))
        return batch

    def _explain(self, states: FloatArray, step: int) -> str:
        within = self.table.steps - step
        if self.problem.refuted(states, step, 1)[0]:
            where = "it is in the unsafe set"
        elif np.array_equal(self.problem.grid.clipped(states), states):
            value = self.table.values_at(states[None], step, np.array([within]))[0, 0]
            where = f"its level-set value there is {value:.3g} > 0"
        else:
            where = "it is off the grid"
        promise = "stay clear for" if self.problem.stays else "reach the target within"
        return (
            f"state {np.array2string(states[0], precision=4, separator=', ')} is not admissible at step {step}: it is "
            f"outside the tube of the states that {promise} {within} steps ({where}); choose a state "
            f"where table.contains(q, start={step}, within={within}) is true, or solve with more steps or nodes"
        )

    # ---- in a loop: what a measurement says of the state, and an answer for every instant, late ones too

    def predict(self, measurement: FloatArray, previous: Any = None, step: int | None = None) -> FloatArray:
        """Where states measured at t_k will be when the next input starts, without an adversary: of the same shape.

        measurement is (ndim,) or (M, ndim); previous, an index or (M,) of them, the input held until then, by default
        the rest input; step, k, may be left out where nothing depends on time. The state then is within
        `problem.half_widths[0]` of it on each axis.
        """
        states, most = real_array("a measurement", measurement), len(self.problem.inputs) - 1
        given = plain_array("previous", self.problem.sensing.rest if previous is None else previous)
        count = 1 if states.ndim == 1 else len(states)
        known = given.dtype.kind in "iu" and bool(((given >= 0) & (given <= most)).all())
        if not known or given.shape not in ((), (count,)):
            raise ValueError(f"previous must be an index from 0 to {most}, or one for each measurement, got {given}")
        predictions = predicted(self.problem, np.atleast_2d(states), np.broadcast_to(given, count), self._at(step))
        return predictions[0] if states.ndim == 1 else predictions

    def step(self, measurement: FloatArray, time: float, *, fallback: bool = True) -> "Action":
        """The answer to a measurement (ndim,) taken `time` s after the loop began: see `Action`.

        The measurement is for the instant that it comes nearest to, and the loop begins anew with a time next to 0. The
        controller remembers the input before. Where nothing depends on time a loop may go on for ever: every instant is
        asked about as the first. What is not admissible gets the input of `Controller.fallback`, or NotAdmissible.

        Raises
        ------
        NotAdmissible
        ValueError
            For what is no state or no time, where time does not go on, and after the last step.
        """
        self.last = acted(self, measurement, time, fallback)
        return self.last

    # ---- many states

    def batch(self, states: FloatArray, step: int | None = None) -> Batch:
        """Steps to go and safe inputs of states (M, ndim) at one step, on all cores: see `Table.batch`."""
        return self.table.batch(states, self._at(step))

    def filter(self, q: FloatArray, step: int | None = None, wanted: Any = None) -> "Filtered":
        """What a commander wants where it is safe, else the nearest safe input, else the fallback.

        Safe is every input after which the target can still be reached by the last step, not only in the fewest. For
        one state (ndim,) or many (M, ndim); `wanted` are indices, int or (M,), or commands in the space of the inputs,
        (m,) or (M, m), of which the nearest quantised one is taken (Euclidean). See `Filtered`. ValueError
        at the last step, or for what is no command.
        """
        return filtered(self.table, q, self._at(step), wanted)

    def choose(self, batch: Batch) -> FloatArray:
        """Index of the input that the rule prefers for each state of a batch, (M,); -1 where there is none.

        Of the safe inputs the one of least score that passes a look (`Table.passes`), and where none is safe
        `Batch.best`.
        """
        if self.rule == "deepest" or not batch.safe.any():
            return batch.best.copy()
        candidates = Candidates(self.problem, batch, *np.nonzero(batch.safe))
        return take_least(self.table, batch, self._scores(candidates))

    def checked(self, batch: Batch) -> FloatArray:
        """Which inputs of a batch are safe and pass a look (`Table.passes`): bool (M, L)."""
        rows, inputs = np.nonzero(batch.safe)
        safe = batch.safe.copy()
        safe[rows, inputs] = self.table.passes(batch.states[rows], inputs, batch.step, batch.left[rows])
        return safe

    def _scores(self, candidates: Candidates) -> FloatArray:
        if callable(self.rule):
            batch = replace(candidates.batch, **{name: sealed(value) for name, value in vars(candidates.batch).items()})
            answer = self.rule(replace(candidates, batch=batch))
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


def predicted(problem: ReachAvoidProblem, measured: FloatArray, previous: FloatArray, step: int = 0) -> FloatArray:
    """Measurements (M, ndim) of t_k moved on by the delay with the inputs held meanwhile (M,): (M, ndim).

    Held at all ends of the grid, where the state is, and without an adversary.
    """
    delay, grid = problem.sensing.delay, replace(problem.grid, ends=(("wall", "wall"),) * problem.grid.ndim)
    states = grid.clipped(states_array("a measurement", measured, grid.ndim))
    if not delay:
        return states
    interval, parts = replace(problem.interval(step), grid=grid), 1 if problem.dynamics.constant else STRIDES
    still = np.zeros((len(states), problem.dynamics.adversaries))
    for part in range(parts):
        t = problem.time(step) - delay * (1 - part / parts)
        states = interval.advance(states, previous, still, t, delay / parts)
    return states


def acted(controller: "Controller", measurement: FloatArray, time: float, fallback: bool) -> Action:
    """As `Controller.step`, which keeps the answer as `controller.last`."""
    problem, last = controller.problem, controller.last
    k = round(number("time", time, least=-problem.delta / 2) / problem.delta)
    last = None if k == 0 else last
    if last is not None and k <= last.step:
        raise ValueError(f"time must go on: instant {last.step} has been answered, and {time:g} s is for instant {k}")
    late = time - k * problem.delta
    missed = abs(late) > problem.sensing.jitter + CLOCK * max(1.0, time) or k != (last.step if last else -1) + 1
    step, held = 0 if problem.timeless else k, last.input if last else None
    state = controller.predict(finite_array("a measurement", measurement, (problem.grid.ndim,)), held, step)
    batch = controller.batch(state[None], step)
    if step == controller.table.steps:
        raise ValueError(f"step {step} is the last: no interval is left to hold an input over")
    chosen, to_go = int(controller.choose(batch)[0]), int(batch.steps_to_go[0])
    if chosen == NOT_ADMISSIBLE:
        chosen = controller.fallback(state, step).input if fallback else controller.select(state, step)
    return Action(
        chosen, k, None if to_go == NOT_ADMISSIBLE else to_go, bool(batch.promised[0]) and not missed, late, missed
    )


def fallbacks(table: Table, states: FloatArray, step: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """For states (M, ndim) the input of the deepest avoid tube, the steps promised and that tube's value: each (M,).

    An input that a look refutes (`Table.passes`) comes after all others. Of tubes equally deep, as where nothing is
    unsafe, the input of the least look-ahead margin: the largest value of the tube with all steps left over the corners
    of the box that it and any adversary can lead to.
    """
    hazards = table.hazards(states, step)
    margins = np.zeros(hazards.shape)
    tied = (hazards == hazards.min(axis=1, keepdims=True)).sum(axis=1) > 1
    if tied.any():
        margins[tied] = _margins(table, states[tied], step)
    order = np.lexsort((margins, hazards))

    def passes(rows: FloatArray, inputs: FloatArray) -> FloatArray:
        some_way = np.ones(len(rows), np.int64)  # is to go afterwards: the target does not matter
        return table.passes(states[rows], inputs, step, some_way)

    passing = first_passing(np.argsort(order, axis=1).astype(np.float64), passes)
    chosen = np.where(passing == NOT_ADMISSIBLE, order[:, 0], passing)
    hazard = hazards[np.arange(len(states)), chosen]
    clear = (hazard <= 0.0) & ~table.grid.beyond(table.grid.wrapped(states), "unsafe", "wall")
    clear &= (passing >= 0) & ~table.problem.refuted(states, step, 1)
    return chosen, clear.astype(np.int64), hazard


def _margins(table: Table, states: FloatArray, step: int) -> FloatArray:
    low, high = table.problem.interval(step).reachable(states)
    corners = np.array(list(product((False, True), repeat=table.grid.ndim)))
    ends = states[:, None, None] + np.where(corners, high[:, :, None], low[:, :, None])  # (M, L, corners, ndim)
    left = np.full(len(states), table.steps - step - 1)
    ahead = table.values_at(ends.reshape(len(states), -1, table.grid.ndim), step + 1, left)
    return ahead.reshape(len(states), -1, len(corners)).max(axis=2)


def fallback(table: Table, q: FloatArray, step: int) -> Fallback:
    """As `Controller.fallback`; ValueError at the last step, or for what is no state."""
    state = finite_array("a state", q, (table.grid.ndim,))
    chosen, promised, hazards = fallbacks(table, state[None], step)
    return Fallback(int(chosen[0]), int(promised[0]), float(hazards[0]))


def filtered(table: Table, q: FloatArray, step: int, wanted: Any) -> Filtered:
    """As `Controller.filter`."""
    step = whole("step", step, least=0, most=table.steps - 1)
    q = real_array("states", q)
    wanted = plain_array("wanted", wanted)
    if single := q.ndim == 1:
        q, wanted = q[None], wanted[None]
    batch = table.batch(q, step, table.steps - step)
    inputs, rows = table.problem.inputs, np.arange(len(batch.states))
    commands, index = _commands(inputs, wanted, len(rows))
    distances = np.linalg.norm(inputs - commands[:, None], axis=2)  # (M, L)
    if index is not None:
        distances[rows, index] = -1.0  # before another input of the same command
    chosen, promised = take_least(table, batch, distances[batch.safe]), batch.promised
    if (lost := chosen == NOT_ADMISSIBLE).any():
        chosen[lost] = fallbacks(table, batch.states[lost], step)[0]
    changed = chosen != index if index is not None else (inputs[chosen] != commands).any(axis=1)
    overruled = distances[rows, chosen] > distances.min(axis=1)
    answer: Sequence[Any] = (chosen, inputs[chosen], changed, overruled, promised, ~promised)
    return Filtered(*(field[0] for field in answer) if single else answer)


def _commands(inputs: FloatArray, given: FloatArray, count: int) -> tuple[FloatArray, FloatArray | None]:
    """What is wanted as commands (count, m), and its indices (count,) where it was given by those."""
    if given.shape == (count,) and given.dtype.kind in "iu":
        if not ((given >= 0) & (given < len(inputs))).all():
            raise ValueError(f"wanted must be indices from 0 to {len(inputs) - 1}, got {given.tolist()}")
        return inputs[given], given
    if given.shape != (count, inputs.shape[1]):
        raise ValueError(
            f"wanted must be, for each state, the index of an input or a command of {inputs.shape[1]} numbers: an "
            f"array of int of shape ({count},) or one of shape ({count}, {inputs.shape[1]}), got {given.dtype} of "
            f"shape {given.shape}"
        )
    return finite_array("wanted", given), None


class Relay:
    """Controllers one after the other: of those that admit a state, the last plays.

    Give them in the order in which their tables are needed: Relay(Controller(second), Controller(first)), where `first`
    was the target of the problem of `second`.
    """

    def __init__(self, *controllers: Controller) -> None:
        self.controllers = controllers

    def choose(self, states: FloatArray, step: int) -> FloatArray:
        """Which controller plays from each of the states (M, ndim) at a step, and the index of its input: (M, 2) int.

        -1 for both where none admits the state; for the input where the state is in the last target already, and none
        is known that brings it back.
        """
        states = np.asarray(states, dtype=np.float64)
        out = np.full((len(states), 2), -1)
        for place, controller in enumerate(self.controllers):
            at = 0 if controller.problem.timeless else step
            if at <= controller.table.steps:
                batch = controller.batch(states, at)
                held = batch.steps_to_go >= 0
                out[held] = np.stack([np.full(held.sum(), place), controller.choose(batch)[held]], axis=1)
        return out
