"""Many states at once: what a table answers for them, shared out among threads, and the best input for each."""

import os
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from sdhj.kernels import FloatArray
from sdhj.problem.checks import states_array, whole
from sdhj.problem.grid import Grid
from sdhj.problem.problem import ReachAvoidProblem

CHUNK = 4096  # states that one thread takes at a time
NOT_ADMISSIBLE = -1


@dataclass(frozen=True)
class Batch:
    """What a table answers for many states at one step.

    Attributes
    ----------
    states : (M, ndim) array
    step : int
    steps_to_go : (M,) int array
        Fewest steps in which the target is reached safely; -1 where a state is not admissible.
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


class Table(Protocol):
    """What a solved problem answers: `sdhj.solve` and `sdhj.load` return one, `sdhj.Controller` plays any.

    Sets, inputs and states are asked for as of a `LookupTable`, whose docstrings say what each answer is.
    """

    @property
    def problem(self) -> ReachAvoidProblem: ...
    @property
    def method(self) -> str: ...
    @property
    def details(self) -> Mapping[str, Any]: ...
    @property
    def grid(self) -> Grid: ...
    @property
    def steps(self) -> int: ...
    @property
    def nbytes(self) -> int: ...
    def values(self, *, start: int, within: int) -> FloatArray: ...
    def inputs(self, *, start: int, within: int) -> FloatArray: ...
    def contains(self, points: FloatArray, *, start: int, within: int) -> FloatArray: ...
    def fraction(self, *, start: int, within: int) -> float: ...
    def batch(self, states: FloatArray, step: int, within: int = 1) -> Batch: ...
    def hazards(self, states: FloatArray, step: int) -> FloatArray: ...
    def values_at(self, points: FloatArray, step: int, within: FloatArray) -> FloatArray: ...
    def save(self, path: str | os.PathLike[str]) -> None: ...


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


def batched(
    problem: ReachAvoidProblem, states: FloatArray, step: int, answer: Callable[[Batch, FloatArray], None]
) -> Batch:
    """The batch of states (M, ndim) at a step, checked, that `answer(batch, rows)` fills in on all cores."""
    grid, step = problem.grid, whole("step", step, least=0, most=problem.steps)
    states = states_array("states", states, grid.ndim)  # a copy: rules look at it later
    count, shape = len(states), (len(states), len(problem.inputs))
    batch = Batch(states, step, np.empty(count, np.int64), np.empty(shape, np.bool_), np.empty(shape))
    share_out(grid, states, lambda rows: answer(batch, rows))
    return batch
