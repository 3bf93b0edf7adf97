"""What every table answers, whatever its method: the checks, the order of the questions, and many states at once.

`notebooks/site/queries.md` says for users how a query is answered; this file, `sdhj.table.ahead` and the kernels of
`sdhj.kernels.lookup` are that page in code.
"""

import os
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from sdhj.kernels import FloatArray
from sdhj.kernels.lookup import Reach
from sdhj.problem.checks import real_array, states_array, whole
from sdhj.problem.grid import Grid
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.table.ahead import ROOM, LookAhead, first_passing, look_ahead, nothing_met

CHUNK = 4096  # states that one thread takes at a time
NOT_ADMISSIBLE = -1
PLAYER: list[Callable[..., Any]] = []  # what plays runs; `sdhj.solving` adds it, as it stands in a room above


@dataclass(frozen=True)
class Batch:
    """What a table answers for many states at one step.

    Attributes
    ----------
    states : (M, ndim) array
    step, within : int
        When, and the steps to go that inputs are judged by where they are more than the fewest.
    steps_to_go : (M,) int array
        Fewest steps in which the target is reached safely; without a target for how many steps the state may stay, all
        that are left; -1 where a state is not admissible.
    safe : (M, L) bool array
        Which inputs are safe, as far as the table tells; none where a state is not admissible and at the last step. Of
        each state the one of least margin was looked at too (`Table.passes`), the others were not:
        `Controller.safe_inputs` looks at all.
    margins : (M, L) array
        The largest value of the tube that each input has to lead into, over all states that it and any adversary can
        lead to: <= 0 where it leads there. +inf where a state is not admissible and at the last step.
    best : (M,) int array
        The safe input of least margin. Where none is safe the best there is, without a promise; -1 where a state is
        not admissible and at the last step.
    """

    states: FloatArray
    step: int
    within: int
    steps_to_go: FloatArray
    safe: FloatArray
    margins: FloatArray
    best: FloatArray

    @property
    def left(self) -> FloatArray:
        """How many steps an admissible state has to go after the interval, as its inputs were judged: (M,)."""
        return np.maximum(self.steps_to_go, self.within) - 1

    @property
    def promised(self) -> FloatArray:
        """Where an input is safe, so that what the tube promises can be kept, up to interpolation: (M,) bool."""
        return np.logical_or.reduce(self.safe, axis=1)


def entry(steps: int, start: int, within: int) -> int:
    """Place of (start, within) in a stack of them all: rows of Fig. 8 one after the other."""
    return start * (steps + 1) - start * (start - 1) // 2 + within


def take_least(table: "Table", batch: Batch, scores: FloatArray) -> FloatArray:
    """For each state of a batch its safe input of least score that passes a look, of equals the one of least margin.

    scores : one for each safe pair, row after row. (M,) int; where none is safe `Batch.best`, which was looked at.
    """
    chosen, rows = batch.best.copy(), np.flatnonzero(batch.promised)
    ranks = np.full(batch.safe.shape, np.inf)
    ranks[batch.safe] = np.argsort(np.lexsort((batch.margins[batch.safe], scores)))  # of equals the first

    def passes(some: FloatArray, inputs: FloatArray) -> FloatArray:
        at = rows[some]
        good = inputs == chosen[at]
        rest = at[~good]
        good[~good] = table.passes(batch.states[rest], inputs[~good], batch.step, batch.left[rest])
        return good

    chosen[rows] = first_passing(ranks[rows], passes)
    return chosen


class Table:
    """What a solved problem answers: `sdhj.solve` and `sdhj.load` return one, `sdhj.Controller` plays any.

    `start` is the step k at which a question is asked, `within` the n steps in which the target has to be reached, or
    without a target for which the state has to stay clear; by default step 0, and all steps that are left.

    A table of a method of its own gives `problem`, `method`, `details`, `values` and `inputs`, `save`, and what is
    written here as "of each method".
    """

    problem: ReachAvoidProblem
    method: str
    details: Mapping[str, Any]
    index: FloatArray
    proved: ClassVar[bool] = False  # whether the answers are, so that looking at the true sets adds nothing

    @property
    def grid(self) -> Grid:
        return self.problem.grid

    @property
    def steps(self) -> int:
        return self.problem.most_steps

    def __repr__(self) -> str:
        problem, nodes = self.problem, " x ".join(map(str, self.grid.shape))
        return (
            f"<{type(self).__name__} of {problem.name!r}, method {self.method!r}: {nodes} nodes, "
            f"{len(problem.inputs)} inputs, {self.steps} steps of {problem.delta:g} s; "
            f"{self.fraction():.1%} of the grid's volume within all of them{self._lost}>"
        )

    @property
    def _lost(self) -> str:
        counts = self.details.get("played")
        return f"; {counts['lost']} of {counts['runs']} runs lost" if counts else ""

    def played(self, runs: int = 1000, adversary: Any = "worst", seed: int = 0, steps: int | None = None) -> Any:
        """Play runs from the whole tube and say how many are lost: see `sdhj.simulation.played.played`."""
        return PLAYER[0](self, runs, adversary, seed, steps)

    # ---- sets

    def clipped(self, start: int, within: int | None) -> tuple[int, int]:
        """start and within, checked; None and what is more than N - start are N - start."""
        start = whole("start", start, least=0, most=self.steps)
        left = self.steps - start
        return start, left if within is None else min(whole("within", within, least=0), left)

    def place(self, start: int, within: int | None) -> int:
        """Where what is kept of (start, within) is."""
        return int(self.index[entry(self.steps, *self.clipped(start, within))])

    def contains(self, points: FloatArray, *, start: int = 0, within: int | None = None) -> FloatArray:
        """Whether each row of `points` (M, ndim) is in the tube with all it may be taken for (`Sensing`): bool (M,).

        A state in the true unsafe set is in none, whatever is interpolated, nor with no steps to go one off the target.
        """
        points, (start, within) = np.atleast_2d(real_array("points", points)), self.clipped(start, within)
        if points.ndim != 2 or points.shape[1] != self.grid.ndim:
            raise ValueError(f"points must have shape (M, {self.grid.ndim}), got {points.shape}")
        if np.isnan(points).any():
            raise ValueError("points has a NaN; every coordinate must be a number")
        found = self._inside(points, start, within)
        if not self.proved and found.any():
            found[found] = ~self.problem.refuted(points[found], start, within)
        return found

    def fraction(self, *, start: int = 0, within: int | None = None) -> float:
        """Share of the volume of the state space in the tube: by the nodes; of a certified table by its cells."""
        return self._share(*self.clipped(start, within))

    def _inside(self, points: FloatArray, start: int, within: int) -> FloatArray:
        """Of each method: whether points (M, ndim) are in the tube as it was computed, (M,) bool."""
        raise NotImplementedError

    def _share(self, start: int, within: int) -> float:
        """Of each method: `fraction`."""
        raise NotImplementedError

    # ---- states

    def batch(self, states: FloatArray, step: int, within: int = 1) -> Batch:
        """Steps to go, safe inputs and margins of states (M, ndim) at one step, on all cores.

        Inputs are judged by the tube of the fewest steps to go, or of `within` where that is more: those that are safe
        with N - step are all from which the target can still be reached. Without a target all steps left count.

        Raises
        ------
        ValueError
            Where a state is NaN or infinite, or shape or step do not fit.
        """
        step = whole("step", step, least=0, most=self.steps)
        states = states_array("states", states, self.grid.ndim)  # a copy: rules look at it later
        within = self.steps - step if self.problem.stays else min(within, self.steps - step)
        count, shape = len(states), (len(states), len(self.problem.inputs))
        batch = Batch(
            states,
            step,
            within,
            np.empty(count, np.int64),
            np.empty(shape, np.bool_),
            np.empty(shape),
            np.empty(count, np.int64),
        )
        share_out(self.grid, states, lambda rows: self._decide(batch, rows))
        return batch

    def _decide(self, batch: Batch, rows: FloatArray) -> None:
        reach = None if self.proved else self.ahead(batch.step)(batch.states, rows)
        self._answer(batch, rows, reach)
        if reach is not None:
            self._look(batch, rows, reach)
        if self.problem.stays:
            batch.steps_to_go[rows[batch.steps_to_go[rows] >= 0]] = self.steps - batch.step

    def _answer(self, batch: Batch, rows: FloatArray, reach: Reach | None) -> None:
        """Of each method: fill in some rows of a batch by what was computed; `reach` is what inputs lead to there.

        Without a target steps_to_go is 0 where a state may stay.
        """
        raise NotImplementedError

    def _look(self, batch: Batch, rows: FloatArray, reach: Reach) -> None:
        """Take back what the true sets refute: of states in the unsafe set all, of others inputs, from the best on."""
        step, to_go = batch.step, batch.steps_to_go
        known = np.flatnonzero(to_go[rows] >= 0)
        if not (rows := rows[known]).size:
            return
        states, lost = batch.states[rows], np.zeros(len(rows), np.bool_)
        if not self.problem.stays and (near := np.flatnonzero(to_go[rows] == 0)).size:
            off = self.problem.target_value(states[near], self.problem.time(step)) > 0.0
            to_go[rows[near[off]]], lost[near[off]] = 1, step == self.steps
        if step == self.steps:
            lost |= self.problem.refuted(states, step, 1)
            again = rows[:0]
        else:
            held, good = nothing_met(self.problem, states, batch.best[rows], step, batch.left[rows], reach, known)
            lost |= ~held
            again = rows[held & ~good]
        to_go[rows[lost]], batch.best[rows[lost]] = NOT_ADMISSIBLE, NOT_ADMISSIBLE
        batch.safe[rows[lost]], batch.margins[rows[lost]] = False, np.inf
        if again.size:
            self._next_best(batch, again)

    def _next_best(self, batch: Batch, rows: FloatArray) -> None:
        """Where a look has refuted the best input: take it back, and all others up to the next that passes."""
        states, best, margins = batch.states[rows], batch.best[rows], batch.margins[rows]
        batch.safe[rows, best] = False

        def passes(some: FloatArray, inputs: FloatArray) -> FloatArray:
            return self.passes(states[some], inputs, batch.step, batch.left[rows[some]])

        scores = np.where(batch.safe[rows], margins, np.inf)
        chosen = first_passing(scores, passes)
        batch.safe[rows] &= scores < np.inf
        if (none := np.flatnonzero(chosen < 0)).size:  # is safe: the best that passes; where none does, the best
            worst = np.maximum(margins[none], self._hazards(states[none], batch.step))
            worst[np.arange(len(none)), best[none]] = np.inf
            other = first_passing(worst, lambda some, inputs: passes(none[some], inputs))
            chosen[none] = np.where(other < 0, best[none], other)
        batch.best[rows] = chosen

    def passes(self, states: FloatArray, inputs: FloatArray, step: int, left: FloatArray) -> FloatArray:
        """Whether a look at the true sets refutes nothing of an input (M,) for each of the states (M, ndim): bool (M,).

        Looked at are some instants of the path without an adversary, and the corners of what the input can lead to with
        `left` (M,) steps to go then: see `sdhj.table.ahead.nothing_met`. A proof needs no look.
        """
        if self.proved or not len(states):
            return np.ones(len(states), np.bool_)
        rows = np.arange(len(states))
        return nothing_met(self.problem, states, inputs, step, left, self.ahead(step)(states, rows), rows)[1]

    def ahead(self, step: int) -> LookAhead:
        """What tells the boxes of states that inputs can lead to from a step."""
        steps = self.steps if self.problem.dynamics.timed else 1
        if (step := min(step, steps - 1)) not in self._ahead:
            self._ahead[step] = look_ahead(self.problem.interval(step), ROOM / steps)
        return self._ahead[step]

    @cached_property
    def _ahead(self) -> dict[int, LookAhead]:
        """What tells the boxes of each step so far asked for, of step 0 where all are alike."""
        return {}

    def hazards(self, states: FloatArray, step: int) -> FloatArray:
        """The avoid tube of every input at states (M, ndim) over the interval from `step`: (M, L).

        <= 0 where the input stays clear of the unsafe sets, -inf where there are none. Of a table on a grid it is
        interpolated, beyond a wall that at the wall; of a certified one <= 0 only where there is a proof.
        """
        step = whole("step", step, least=0, most=self.steps - 1)
        return self._hazards(states_array("states", states, self.grid.ndim), step)

    def _hazards(self, states: FloatArray, step: int) -> FloatArray:
        """Of each method: `hazards`."""
        raise NotImplementedError

    def values_at(self, points: FloatArray, step: int, within: FloatArray) -> FloatArray:
        """Level-set values at points (M, V, ndim) of the tubes (step, within[m]), as computed: (M, V).

        Of a table on a grid interpolated, beyond a wall that at the wall; the true sets are not asked. `within` (M,)
        is clipped to what there is, 0 to N - step.
        """
        points, step = real_array("points", points), whole("step", step, least=0, most=self.steps)
        within = np.clip(within, 0, self.steps - step)
        if points.ndim != 3 or points.shape[::2] != (len(within), self.grid.ndim):
            raise ValueError(f"points must have shape ({len(within)}, V, {self.grid.ndim}), got {points.shape}")
        return self._values_at(points, step, within)

    def _values_at(self, points: FloatArray, step: int, within: FloatArray) -> FloatArray:
        """Of each method: `values_at`."""
        raise NotImplementedError

    # ---- what each method has of its own

    @property
    def nbytes(self) -> int:
        """Bytes that the table takes in memory; of a stored one that it would take."""
        raise NotImplementedError

    def values(self, *, start: int = 0, within: int | None = None) -> FloatArray:
        """Level-set function of a tube at the nodes, shape grid.shape, as computed; see `LookupTable.values`."""
        raise NotImplementedError

    def inputs(self, *, start: int = 0, within: int | None = None) -> FloatArray:
        """Which inputs are safe at the nodes, bool, grid.shape + (L,); see `LookupTable.inputs`."""
        raise NotImplementedError

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write an HDF5 file that describes itself, or raise OSError; an older one stays until the new one is whole."""
        raise NotImplementedError


def threads() -> int:
    """How many threads share out a batch: the cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def share_out(grid: Grid, states: FloatArray, work: Callable[[FloatArray], None]) -> None:
    """Call `work(rows)` until every row of states (M, ndim) has had its turn, on all cores where they are many."""
    if len(states) <= CHUNK:
        if len(states):
            work(np.arange(len(states)))
        return
    order = _by_cell(grid, states)
    with ThreadPoolExecutor(threads()) as pool:
        list(pool.map(work, [order[begin : begin + CHUNK] for begin in range(0, len(states), CHUNK)]))


def _by_cell(grid: Grid, states: FloatArray) -> FloatArray:
    """The order that brings states of neighbouring cells together: they read the same nodes.

    Which cells count as one follows from their places fitting in 16 bits, which are sorted ten times as fast.
    """
    lower, spacing, shape = grid.arrays[:3]
    cells = np.clip((states - lower) / spacing, 0, shape - 1).astype(np.int64)
    places = np.ravel_multi_index(tuple(cells.T), grid.shape)
    return np.argsort((places // (grid.size // 2**16 + 1)).astype(np.uint16), kind="stable")
