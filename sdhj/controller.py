"""The feedback controller of Sec. 4.3 (Algorithm 2), read as Fig. 8 is.

At step k a state q has n steps to go, the fewest with q in the tube S_k of that n; n = 0 is success. Every input u_j
whose reach-avoid set holds q, that of the tube S_{k+1} with n - 1 to go, then keeps the promise, and a rule picks one.

Off the grid those sets are known by interpolation only, and the promise holds up to its error. Looking ahead from q,
the *margin* of u_j is the largest interpolated value of S_{k+1}, with n - 1 to go, over the box of all states that u_j
and any adversary can lead to. Inputs are safe by the first of these tests that any input passes:

1. every node of the cell around q marks u_j in the look-up table, and its margin is <= 0;
2. the interpolated avoid tube of u_j at q and its margin are <= 0;
3. next to the boundary of a tube no input may pass either. What is then called safe is the best there is, without the
   promise: of the inputs that every node of the cell marks, or of all where none is, the one whose larger of the two is
   least. Its margin is > 0, and `Batch.promised` is False.

Where the adversary couples axes the box is larger than what it can bring about, and the promise is given more rarely.
The look-ahead loses fewer runs than the marks of the nodes alone, and the marks keep inputs that would only graze an
obstacle from the rules that do not ask for depth. The certified method has a guarantee instead.
"""

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from sdhj.checks import whole
from sdhj.grid import FloatArray, Grid
from sdhj.lookup import decide, take_best, tube_values


def clip_to_walls(grid, x): return grid.held(x)
def displacements(problem, states): return problem.interval(0).displacements(states)
def reachable_boxes(problem, states): return problem.interval(0).reachable(states)
from sdhj.problem import ReachAvoidProblem
from sdhj.table import LookupTable

RULES = ("deepest", "effort", "target", "clearance")
CHUNK = 4096  # states that one thread takes at a time
NOT_ADMISSIBLE = -1


class NotAdmissible(ValueError):
    """No tube of the table holds the state: nothing is known that leads it to the target safely in time."""


@dataclass(frozen=True)
class Choice:
    """What a rule of your own decides on: it returns one of `candidates`.

    Attributes
    ----------
    state : (ndim,) array
    step : int
        The sampling time t_k at which the input starts.
    steps_to_go : int
    candidates : (C,) int array
        Indices of the safe inputs in problem.inputs.
    margins : (C,) array
        The margin of each: the largest level-set value the adversary can bring about. The lower, the deeper inside;
        > 0 where nothing is promised.
    problem : ReachAvoidProblem
    """

    state: FloatArray
    step: int
    steps_to_go: int
    candidates: FloatArray
    margins: FloatArray
    problem: ReachAvoidProblem


Rule = Callable[[Choice], int]


@dataclass(frozen=True)
class Batch:
    """The controller's answers for many states at one step.

    Attributes
    ----------
    states : (M, ndim) array
    step : int
    steps_to_go : (M,) int array
        -1 where a state is not admissible.
    safe : (M, L) bool array
        Which inputs are safe; none where a state is not admissible and at the last step.
    margins : (M, L) array
        The margin of every input; where nothing is promised also at least its avoid tube. +inf where a state is not
        admissible and at the last step.
    """

    states: FloatArray
    step: int
    steps_to_go: FloatArray
    safe: FloatArray
    margins: FloatArray

    @property
    def promised(self) -> FloatArray:
        """Where the inputs called safe keep what the tube promises, up to interpolation: (M,) bool.

        Elsewhere the one input called safe is the best of those that fail the look-ahead, or there is none.
        """
        return np.logical_or.reduce(self.safe & (self.margins <= 0.0), axis=1)


class Controller:
    """Set-valued feedback from a look-up table, for any state, on or off the grid (Algorithm 2).

    Queries of one state may come from several threads at once, also while a solve runs. Where neither target nor unsafe
    sets depend on the time, `select(q, 0)` is right at any time, so a robot may run for as long as it likes.

    Parameters
    ----------
    table : LookupTable
    rule : {"deepest", "effort", "target", "clearance"} or callable (Choice) -> int
        Which safe input `select` takes: the one of least margin; the smallest in norm; the one whose successor is
        nearest to the target, or farthest from the unsafe sets, without an adversary; or what your function returns.
        "target" and "clearance" call the problem's own level-set functions, and last as long as those do.

    Raises
    ------
    ValueError
        For an unknown rule.
    """

    kinds: ClassVar[dict[str, type["Controller"]]] = {}  # by the method of tables that have a controller of their own

    def __new__(cls, table: LookupTable, rule: str | Rule = "deepest") -> "Controller":
        kind = Controller.kinds.get(getattr(table, "method", ""), cls)
        return super().__new__(kind if cls is Controller else cls)

    def __init__(self, table: LookupTable, rule: str | Rule = "deepest") -> None:
        self._set_up(table, rule)
        problem, avoid = table.problem, table.avoid
        inputs, steps = len(problem.inputs), table.steps
        self._table = (
            steps,
            table.tubes.reshape(len(table.tubes), -1),
            table.masks,
            avoid.static.reshape(inputs, -1),
            np.array(avoid.static_axes, dtype=np.int64),
            avoid.moving.reshape(steps, inputs, -1),
            np.array(avoid.moving_axes, dtype=np.int64),
        )
        constant = problem.dynamics.constant
        self._reach = (
            _shared_intervals(*reachable_boxes(problem, np.zeros((1, problem.grid.ndim)))) if constant else None
        )
        self._room = _room(problem.grid, self._reach) if self._reach else 0
        self._local = threading.local()

    def _set_up(self, table: LookupTable, rule: str | Rule) -> None:
        if not hasattr(table, "method"):
            raise ValueError(f"table must be what sdhj.solve returns, got {type(table).__name__}")
        if not callable(rule) and rule not in RULES:
            raise ValueError(f"rule must be one of {', '.join(RULES)}, or a function of a Choice, got {rule!r}")
        self.table, self.problem, self.rule = table, table.problem, rule
        object.__setattr__(table, '_c', self)
        self._effort = np.linalg.norm(self.problem.inputs, axis=1)

    # ---- one state

    def steps_to_go(self, q: FloatArray, step: int) -> int | None:
        """Fewest steps in which the target is reached safely from state q (ndim,) at a step; None if not admissible."""
        batch = self._query(q, step)
        return None if batch.steps_to_go[0] == NOT_ADMISSIBLE else int(batch.steps_to_go[0])

    def safe_inputs(self, q: FloatArray, step: int) -> FloatArray:
        """Indices into problem.inputs of the inputs that are safe and make progress from q (ndim,) at a step.

        With no steps to go they bring the state back into the target one step later. None at the last step. Where no
        input passes the look-ahead it is the best there is, without a promise: see `Batch.promised`.

        Raises
        ------
        NotAdmissible
            Where no tube holds q.
        """
        return np.flatnonzero(self._admissible(q, step).safe[0])

    def select(self, q: FloatArray, step: int) -> int:
        """Index into problem.inputs of the safe input that the rule prefers.

        Raises
        ------
        NotAdmissible
            Where no tube holds q; of a certified table also in the target, where no input is proved to bring q back.
        ValueError
            At the last step, where no interval is left, and where your own rule returns no candidate.
        """
        batch = self._admissible(q, step)
        if step == self.table.steps:
            raise ValueError(f"step {step} is the last: no interval is left to hold an input over")
        chosen = int(self.choose(batch)[0])
        if chosen == NOT_ADMISSIBLE:  # an index all the same, of the last input
            raise NotAdmissible(
                f"state {batch.states[0].tolist()} is in the target at step {step}, and no input is proved to bring it "
                "back into the target one step later"
            )
        return chosen

    def _query(self, q: FloatArray, step: int) -> Batch:
        state = np.array(q, dtype=np.float64)
        ndim = self.problem.grid.ndim
        if state.shape != (ndim,):
            raise ValueError(f"a state must have shape ({ndim},), got {state.shape}; for many states use batch()")
        return self._decide(state[None], self._checked_step(step))

    def _admissible(self, q: FloatArray, step: int) -> Batch:
        batch = self._query(q, step)
        if batch.steps_to_go[0] == NOT_ADMISSIBLE:
            raise NotAdmissible(self._explain(batch.states[0], batch.step))
        return batch

    def _explain(self, state: FloatArray, step: int) -> str:
        within = self.table.steps - step
        if np.array_equal(clip_to_walls(self.problem.grid, state), state):
            value = self.tube_values(state[None, None], step, np.array([within]))[0, 0]
            where = f"its level-set value there is {value:.3g} > 0"
        else:
            where = "it is off the grid"
        return (
            f"state {np.array2string(state, precision=4, separator=', ')} is not admissible at step {step}: it is "
            f"outside the tube of the states that reach the target within {within} steps ({where}); choose a state "
            f"where table.contains(q, start={step}, within={within}) is true, or solve with more steps or nodes"
        )

    # ---- many states

    def batch(self, states: FloatArray, step: int) -> Batch:
        """Steps to go and safe inputs of states (M, ndim) at one step, on all cores.

        Raises
        ------
        ValueError
            Where a state is NaN or infinite, or shape or step do not fit.
        """
        states = np.array(states, dtype=np.float64, order="C")  # a copy: `choose` and own rules look at it later
        ndim = self.problem.grid.ndim
        if states.ndim != 2 or states.shape[1] != ndim:
            raise ValueError(f"states must have shape (M, {ndim}), got {states.shape}")
        return self._decide(states, self._checked_step(step))

    def choose(self, batch: Batch) -> FloatArray:
        """Index of the input that the rule prefers for each state of a batch, (M,); -1 where there is none."""
        chosen = np.full(len(batch.states), NOT_ADMISSIBLE)
        if callable(self.rule):
            for row in np.flatnonzero(batch.safe.any(axis=1)):
                chosen[row] = self._own_rule(batch, int(row))
        elif not take_best(batch.safe, self._score(batch), batch.margins, chosen):
            raise ValueError(f"rule {self.rule!r} met a NaN in the level-set functions of the problem")
        return chosen

    def _own_rule(self, batch: Batch, row: int) -> int:
        candidates = np.flatnonzero(batch.safe[row])
        choice = Choice(
            state=batch.states[row],
            step=batch.step,
            steps_to_go=int(batch.steps_to_go[row]),
            candidates=candidates,
            margins=batch.margins[row, candidates],
            problem=self.problem,
        )
        index = self.rule(choice)  # type: ignore[operator]
        if np.ndim(index) > 0 or index not in candidates:
            raise ValueError(f"the rule returned {index!r}, not one of choice.candidates, here {candidates.tolist()}")
        return int(index)

    def _score(self, batch: Batch) -> FloatArray:
        """What a named rule minimises, for every safe pair of a state and an input."""
        if self.rule == "deepest":
            return batch.margins[batch.safe]
        rows, inputs = np.nonzero(batch.safe)
        if self.rule == "effort":
            return self._effort[inputs]
        if not rows.size:  # nor is there a state whose successors to ask for
            return np.empty(0)
        moves = displacements(self.problem, batch.states)
        moved = batch.states[rows] + moves[rows if len(moves) > 1 else 0, inputs]
        successors = clip_to_walls(self.problem.grid, moved)  # without an adversary
        end = self.problem.time(batch.step + 1)
        if self.rule == "target":
            return self.problem.target_value(successors, end)
        return -self.problem.unsafe_value(successors, end)

    def tube_values(self, points: FloatArray, step: int, within: FloatArray) -> FloatArray:
        """Interpolated level-set values at points (M, V, ndim) of the tubes (step, within[m]); shape (M, V)."""
        points = np.ascontiguousarray(points, dtype=np.float64)
        out = np.empty(points.shape[:2])
        places = self.table.entry(step, 0) + within
        tube_values(points, places, self._table[1], self.problem.grid.arrays, self._scratch()[:3], out)
        return out

    # ---- the kernel

    def _checked_step(self, step: int) -> int:
        return whole("step", step, least=0, most=self.table.steps)

    @staticmethod
    def _refuse_nan(states: FloatArray) -> None:
        if not np.isfinite(states).all():
            bad = states[~np.isfinite(states).all(axis=1)][0]
            raise ValueError(f"a state has a NaN or an infinity: {bad.tolist()}; every coordinate must be finite")

    def _decide(self, states: FloatArray, step: int) -> Batch:
        self._refuse_nan(states)
        count = len(states)
        safe = np.empty((count, len(self.problem.inputs)), dtype=np.bool_)
        batch = Batch(states, step, np.empty(count, dtype=np.int64), safe, np.empty(safe.shape))
        if count <= CHUNK:
            if count:
                self._decide_rows(batch, np.arange(count))
        else:
            order = self._by_cell(states)
            parts = [order[begin : begin + CHUNK] for begin in range(0, count, CHUNK)]
            with ThreadPoolExecutor(threads()) as pool:
                list(pool.map(lambda part: self._decide_rows(batch, part), parts))
        return batch

    def _by_cell(self, states: FloatArray) -> FloatArray:
        """The order that brings states of neighbouring cells together: they read the same nodes.

        Which cells count as one follows from their places fitting in 16 bits, which are sorted ten times as fast.
        """
        lower, spacing, shape, _ = self.problem.grid.arrays
        cells = np.clip((states - lower) / spacing, 0, shape - 1).astype(np.int64)
        places = np.ravel_multi_index(tuple(cells.T), tuple(shape))
        return np.argsort((places // (self.problem.grid.size // 2**16 + 1)).astype(np.uint16), kind="stable")

    def _decide_rows(self, batch: Batch, rows: FloatArray) -> None:
        reach = self._reach or _own_intervals(*reachable_boxes(self.problem, batch.states[rows]))
        out = (batch.steps_to_go, batch.safe, batch.margins)
        decide(batch.states, rows, batch.step, self._table, reach, self.problem.grid.arrays, self._scratch(reach), out)

    def _scratch(self, reach: tuple[Any, ...] | None = None) -> tuple[Any, ...]:
        """This thread's room to work in, made anew only where larger boxes need more of it."""
        room = 0 if reach is None else self._room or _room(self.problem.grid, reach)
        if getattr(self._local, "room", -1) < room:
            ndim, inputs = self.problem.grid.ndim, len(self.problem.inputs)
            whole, real = (lambda *shape: np.empty(shape, np.int64)), (lambda *shape: np.empty(shape))
            corners = (whole(1 << ndim), real(1 << ndim), np.arange(ndim), whole(2, 1 << ndim), real(2, 1 << ndim))
            each = (ndim, inputs)
            unions = (whole(ndim), whole(ndim), whole(ndim), whole(ndim + 1))
            spans = (whole(*each), whole(*each), real(*each), real(*each), *unions)
            self._local.scratch = (*corners, spans, whole(room), real(2 * room), np.empty(inputs, dtype=np.bool_))
            self._local.room = room
        return self._local.scratch


def _shared_intervals(low: FloatArray, high: FloatArray) -> tuple[Any, ...]:
    """Boxes (1, L, ndim) that are the same for all states, as `decide` reads them: each different interval once."""
    inputs, ndim = low.shape[1:]
    pairs = np.stack([low[0], high[0]], axis=-1)
    intervals, places = [], np.empty((inputs, ndim), dtype=np.int64)
    for axis in range(ndim):
        different, place = np.unique(pairs[:, axis], axis=0, return_inverse=True)
        intervals.append(different)
        places[:, axis] = place.ravel()
    number = np.array([len(different) for different in intervals])
    order = np.argsort(number, kind="stable")
    filled = np.zeros((2, 1, number.max(), ndim))
    for axis in range(ndim):
        filled[:, 0, : number[axis], axis] = intervals[axis].T
    sequence = np.lexsort(places[:, order[::-1]].T)
    kinds = np.ascontiguousarray(places[np.ix_(sequence, order)])
    agree = np.zeros(inputs, dtype=np.int64)
    agree[1:] = np.cumprod(kinds[1:] == kinds[:-1], axis=1).sum(axis=1)
    return filled[0], filled[1], (number[order], order, kinds, sequence, agree)


def _own_intervals(low: FloatArray, high: FloatArray) -> tuple[Any, ...]:
    """Boxes (M, L, ndim) that depend on the state, as `decide` reads them: every input has intervals of its own."""
    inputs, ndim = low.shape[1:]
    every = np.arange(inputs)
    kinds = np.ascontiguousarray(np.broadcast_to(every[:, None], (inputs, ndim)))
    return low, high, (np.full(ndim, inputs), np.arange(ndim), kinds, every, np.zeros(inputs, dtype=np.int64))


def _room(grid: Grid, reach: tuple[Any, ...]) -> int:
    """How many nodes, at most, the boxes of one state touch, all inputs together."""
    low, high, (number, order, _, _, _) = reach
    room = np.ones(low.shape[0])
    for a, axis in enumerate(order):
        extent = high[:, : number[a], axis].max(axis=1) - low[:, : number[a], axis].min(axis=1)
        room *= np.ceil(extent / grid.spacing[axis] + 1e-6) + 2  # cells it can touch, and one node more
    return int(room.max())


def threads() -> int:
    """How many threads share out a batch: the cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
