"""What a controller does beside selecting: predict, filter what others want, stay clear where nothing is promised."""

from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import Any

import numpy as np

from sdhj.common.checks import finite_array, states_array, whole
from sdhj.common.remembering import FloatArray
from sdhj.kernels.true_sets import TRUE_SETS_ONLY
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.table.batches import NOT_ADMISSIBLE, STRIDES, Batch, Table


@dataclass(frozen=True)
class Fallback:
    """The input that stays clear of the unsafe sets best, for states from which reaching the target is not promised.

    Attributes
    ----------
    input : int
        Index into problem.inputs.
    steps : int
        For how many steps it is promised to stay clear: 1 if the state is in the input's avoid tube, else 0.
    hazard : float
        Level-set value of that avoid tube, -inf if no set is unsafe under the input.
    """

    input: int
    steps: int
    hazard: float


def fallbacks(table: Table, states: FloatArray, step: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """`input`, `steps` and `hazard`, as in `Fallback`, of finite states (M, ndim): (M,) each."""
    step, rows = whole("step", step, least=0, most=table.steps - 1), np.arange(len(states))
    hazards = table._hazards(states, step)
    # among equally deep tubes, as where nothing is unsafe, the least margin decides
    margins = np.zeros(hazards.shape)
    if (tied := (hazards == hazards.min(axis=1, keepdims=True)).sum(axis=1) > 1).any():
        margins[tied] = _margins(table, states[tied], step)
    # two steps to go, as with one the target would have to be reached; -1 afterwards where the state itself is unsafe
    some_way, none = np.full(len(states), 2), np.full(len(states), NOT_ADMISSIBLE)
    checked = Batch(states, step, 1, some_way, np.ones(hazards.shape, np.bool_), margins, none)
    table._fill_in_and_check(checked, hazards, TRUE_SETS_ONLY, rows)  # what fails comes last
    chosen, hazard = checked.best, hazards[rows, checked.best]
    clear = (hazard <= 0.0) & checked.safe[rows, chosen] & ~table.grid.beyond(states, "fails", "holds")
    if table.proved or table.grid.has("frees"):  # not looked at, or not past such an end
        checked.steps_to_go[table.problem.surely_in_no_tube(states, step, 1)] = NOT_ADMISSIBLE
    return chosen, (clear & (checked.steps_to_go > 0)).astype(np.int64), hazard


def _margins(table: Table, states: FloatArray, step: int) -> FloatArray:
    """The largest value of the next step's tube, all steps left, at corners of where each input leads: (M, L)."""
    sides = _sides(table.grid.ndim)
    ends = states[:, None, None] + table.problem.interval(step).reachable_points(states, sides)  # (M, L, corners, ndim)
    left = np.full(len(states), table.steps - step - 1)
    points = np.ascontiguousarray(ends.reshape(len(states), -1, table.grid.ndim))
    ahead = table._values_at(points, step + 1, left)
    return ahead.reshape(len(states), -1, len(sides)).max(axis=2)


@cache  # of an array that nobody writes
def _sides(ndim: int) -> FloatArray:
    """The corners of a box, (2^ndim, ndim), as 0 or 1."""
    return np.array(list(product((0.0, 1.0), repeat=ndim)))


@dataclass(frozen=True)
class Filtered:
    """The answer of `Controller.filter` for M states; for a single state the fields lack the axis of states.

    Attributes
    ----------
    inputs : (M,) int
        Indices into problem.inputs of the inputs to apply.
    commands : (M, m)
        The values of these inputs.
    changed : (M,) bool
        Whether they differ from the wanted ones.
    overruled : (M,) bool
        Whether an input nearer to the wanted one was refused as not safe.
    promised : (M,) bool
        Whether the target is promised by the last step.
    fallback : (M,) bool
        Whether no input is safe: `Batch.best` is applied or `Controller.fallback`.
    """

    inputs: Any
    commands: FloatArray
    changed: Any
    overruled: Any
    promised: Any
    fallback: Any


def squared_distances(inputs: FloatArray, commands: FloatArray) -> FloatArray:
    """Squared Euclidean distances (M, L) from commands (M, m) to inputs (L, m)."""
    # component by component, in one order for any number of states, as `sdhj_filter_at` in C adds them up
    return np.asarray(np.add.reduce(np.square(inputs.T[:, None] - commands.T[:, :, None])))


def commands_of(inputs: FloatArray, given: FloatArray, count: int) -> tuple[FloatArray, FloatArray | None]:
    """What is wanted for `count` states, as commands (count, m), and as indices if these were given."""
    # by shape and type alone: whole numbers, one for each state, are indices also where an input has one component
    if given.shape == (count,) and given.dtype.kind in "iu":
        if not ((given >= 0) & (given < len(inputs))).all():
            raise ValueError(f"wanted must be indices from 0 to {len(inputs) - 1}, got {given.tolist()}")
        return inputs[given], given
    if given.shape != (count, inputs.shape[1]):
        size = f"a command of {inputs.shape[1]} number{'s' * (inputs.shape[1] != 1)}, such as {inputs[0].tolist()}"
        wanted, got = (
            f"the index of an input, from 0 to {len(inputs) - 1}, or {size}",
            f"{given.dtype} of shape {given.shape}",
        )
        if count == 1 and given.dtype.kind != "O" and given.ndim and len(given) == 1:
            got = given[0].tolist()
        else:
            wanted += f": for {count} states an array of int of shape ({count},) or one of ({count}, {inputs.shape[1]})"
        raise ValueError(f"wanted must be {wanted}; got {got}")
    return finite_array("wanted", given), None


def predicted(problem: ReachAvoidProblem, measured: FloatArray, previous: FloatArray, step: int = 0) -> FloatArray:
    """Where measurements (M, ndim) of step k will be after the delay, under the previous inputs (M,)."""
    delay, grid = problem.sensing.delay, problem.grid.walled  # all ends hold, also without a delay
    measured = states_array("a measurement", measured, grid.ndim)
    # `sdhj_seen` in sdhj.h does the same, with the same 1e-9
    states, most = grid.clipped(measured), np.array(problem.sensing.error) * (1 + 1e-9)
    off = (np.abs(measured - states) > most).any(axis=1, keepdims=True)  # by more than an error explains: kept
    if not delay:
        return np.where(off, measured, states)
    interval, parts = problem.interval(step).walled, 1 if problem.dynamics.constant else STRIDES
    still = np.zeros((len(states), problem.dynamics.disturbance_dim))
    for part in range(parts):
        t = problem.time(step) - delay * (1 - part / parts)
        states = interval.advance(states, previous, still, t, delay / parts)
    return np.where(off, measured, states)
