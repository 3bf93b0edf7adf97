"""The feedback controller of Sec. 4.3 (Algorithm 2), read as Fig. 8 is.

At step k a state q has n steps to go, the fewest with q in the tube S_k of that n; n = 0 is success. Every input u_j
whose reach-avoid set holds q, that of the tube S_{k+1} with n - 1 to go, then keeps the promise: all this the table
answers, and `sdhj.table` says how. A rule picks one of the inputs.
"""

import reprlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sdhj.batches import NOT_ADMISSIBLE, Batch, take_best
from sdhj.checks import real_array, sealed
from sdhj.grid import FloatArray
from sdhj.problem import ReachAvoidProblem
from sdhj.realtime import RealTime
from sdhj.table import Table

if TYPE_CHECKING:
    from sdhj.shield import Fallback, Filtered


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
        The largest level-set value that the adversary can bring about; > 0 where nothing is promised.
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
        return self.problem.grid.held(moved)


Rule = Callable[[Candidates], FloatArray]
RULES: dict[str, Rule] = {  # of the scores (P,) the least wins
    "deepest": lambda among: among.margins,
    "effort": lambda among: np.linalg.norm(among.problem.inputs, axis=1)[among.inputs],
    "target": lambda among: among.problem.target_value(among.successors, among.problem.time(among.step + 1)),
    "clearance": lambda among: -among.problem.unsafe_value(among.successors, among.problem.time(among.step + 1)),
}


class Controller(RealTime):
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

    def __init__(self, table: Table, rule: str | Rule = "deepest") -> None:
        if not hasattr(table, "values_at"):
            raise ValueError(f"table must be what sdhj.solve returns, got {type(table).__name__}")
        if not callable(rule) and not (isinstance(rule, str) and rule in RULES):
            told = reprlib.repr(rule)
            raise ValueError(f"rule must be one of {', '.join(RULES)}, or a function of Candidates, got {told}")
        self.table, self.problem, self.rule = table, table.problem, rule

    # ---- one state

    def steps_to_go(self, q: FloatArray, step: int | None = None) -> int | None:
        """Fewest steps in which the target is reached safely from state q (ndim,) at a step; None if not admissible."""
        to_go = int(self._query(q, step).steps_to_go[0])
        return None if to_go == NOT_ADMISSIBLE else to_go

    def safe_inputs(self, q: FloatArray, step: int | None = None) -> FloatArray:
        """Indices into problem.inputs of the inputs that are safe and make progress from q (ndim,) at a step.

        With no steps to go they bring the state back into the target one step later. None at the last step. Where no
        input passes the look-ahead it is the best there is, without a promise: see `Batch.promised`.

        Raises
        ------
        NotAdmissible
            Where no tube holds q.
        """
        return np.flatnonzero(self._admissible(q, step).safe[0])

    def select(self, q: FloatArray, step: int | None = None) -> int:
        """Index into problem.inputs of the safe input that the rule prefers.

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
        """The input that stays clear of the unsafe sets longest from any q (ndim,): see `sdhj.shield.Fallback`."""
        from sdhj.shield import fallback

        return fallback(self.table, q, self._at(step))

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
        if np.array_equal(self.problem.grid.held(states), states):
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

    # ---- many states

    def batch(self, states: FloatArray, step: int | None = None) -> Batch:
        """Steps to go and safe inputs of states (M, ndim) at one step, on all cores: see `Table.batch`."""
        return self.table.batch(states, self._at(step))

    def filter(self, q: FloatArray, step: int | None = None, wanted: Any = None) -> "Filtered":
        """What a commander wants where it is safe, else the nearest safe input, else the fallback.

        Safe is every input after which the target can still be reached by the last step, not only in the fewest. For
        one state (ndim,) or many (M, ndim); `wanted` are indices, int or (M,), or commands in the space of the inputs,
        (m,) or (M, m), of which the nearest quantised one is taken (Euclidean). See `sdhj.shield.Filtered`. ValueError
        at the last step, or for what is no command.
        """
        from sdhj.shield import filtered

        return filtered(self.table, q, self._at(step), wanted)

    def choose(self, batch: Batch) -> FloatArray:
        """Index of the input that the rule prefers for each state of a batch, (M,); -1 where there is none."""
        chosen = np.full(len(batch.states), NOT_ADMISSIBLE)
        candidates = Candidates(self.problem, batch, *np.nonzero(batch.safe))
        if candidates.rows.size:
            take_best(batch.safe, self._scores(candidates), batch.margins, chosen)
        return chosen

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
