"""Answers for any state and any commander: the fallback where no tube holds the state, and the filter of commands.

Imported when it is asked for: these are `Controller.fallback` and `Controller.filter`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from sdhj.batches import NOT_ADMISSIBLE, take_best
from sdhj.checks import finite_array, plain_array, real_array, whole
from sdhj.grid import FloatArray
from sdhj.table import Table


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
        Whether no input is known to be safe, so that the one of `Controller.fallback` is applied, without a promise.
    """

    inputs: Any
    commands: FloatArray
    changed: Any
    overruled: Any
    promised: Any
    fallback: Any


def fallbacks(table: Table, states: FloatArray, step: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """For states (M, ndim) the input of the deepest avoid tube, the steps promised and that tube's value: each (M,).

    Of tubes equally deep, as where nothing is unsafe, the input of the least look-ahead margin: the largest value of
    the tube with all steps left over the corners of the box that it and any adversary can lead to.
    """
    step = whole("step", step, least=0, most=table.steps - 1)
    hazards = table.hazards(states, step)
    margins = np.zeros(hazards.shape)
    tied = (hazards == hazards.min(axis=1, keepdims=True)).sum(axis=1) > 1
    if tied.any():
        margins[tied] = _margins(table, states[tied], step)
    chosen = np.full(len(states), NOT_ADMISSIBLE)
    take_best(np.ones(hazards.shape, np.bool_), hazards.ravel(), margins, chosen)
    deepest = hazards[np.arange(len(states)), chosen]
    promised = (deepest <= 0.0) & ~table.grid.beyond(table.grid.wrapped(states), "unsafe", "wall")
    return chosen, promised.astype(np.int64), deepest


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
    chosen = np.full(len(rows), NOT_ADMISSIBLE)
    take_best(batch.safe, distances[batch.safe], batch.margins, chosen)
    promised, lost = batch.promised, chosen == NOT_ADMISSIBLE
    if lost.any():
        chosen[lost] = fallbacks(table, batch.states[lost], step)[0]
    changed = chosen != index if index is not None else (inputs[chosen] != commands).any(axis=1)
    overruled = distances[rows, chosen] > distances.min(axis=1)
    answer: Sequence[Any] = (chosen, inputs[chosen], changed, overruled, promised, lost)
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
