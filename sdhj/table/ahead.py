"""What an input can lead to in one interval, and the look at the true sets at a few places of that."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from sdhj.formulas.formula import program
from sdhj.formulas.graph import Node, leaf, rebuilt
from sdhj.kernels import FloatArray
from sdhj.kernels.tape import Tape, packed
from sdhj.kernels.true_sets import LOOK, LOOKED, judge, propose, spots_for
from sdhj.kernels.tubes import LOOK_TIMES
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sets import TargetSet, UnsafeSet

NO_TAPES = program(()) * 3


def prepared(
    problem: ReachAvoidProblem, step: int, axes: Sequence[FloatArray], tapes: Sequence[FloatArray], looks: bool
) -> Tape:
    """What `sdhj.kernels.lookup` reads of a problem at a step, packed.

    axes : those of the avoid tubes. tapes : `tapes_of` the problem, or `NO_TAPES`. looks : whether at the true sets.
    """
    grid, begin, end = problem.grid, problem.time(step), problem.time(step + 1)
    interval, order = problem.interval(step), np.arange(grid.ndim)
    if problem.dynamics.stateless:  # the axes with the fewest different intervals first, as in `sdhj.solver.hopf_lax`
        ends = interval.ahead(np.array([grid.lower]))[:2, :, :, 0]
        order = np.argsort([len(np.unique(ends[:, :, axis], axis=1).T) for axis in order], kind="stable")
    path = [begin + (end - begin) * part / LOOKED for part in range(1, LOOKED)]
    times = np.array([begin] if step == problem.most_steps else [*path, end, begin, *[end] * 2**grid.ndim])
    faces = np.array([*grid.faces("wall", "safe"), grid.lower, grid.upper, *interval.held])
    return packed(*grid.arrays, *axes, order, times if looks else times[:0], faces, np.array([interval.begin]), *tapes)


def tapes_of(problem: ReachAvoidProblem) -> tuple[FloatArray, ...]:
    """What inputs lead to as a tape, and the unsafe sets and the target, of the whole state and the time after it."""
    ahead, ndim = problem.interval(0).ahead_formula, problem.grid.ndim
    sets = (problem.unsafe, () if problem.stays else (problem.target,))
    unsafe, target = (program([_timed(part, ndim) for part in some]) for some in sets)
    return *program(ahead.outputs if ahead else ()), *unsafe, *target


def _timed(part: UnsafeSet | TargetSet, time: int) -> Node:
    def put(one: Node) -> Node | None:
        return leaf("x", part.axes[one.value[0]] if one.op == "x" else time) if one.op in ("x", "p") else None

    return rebuilt(part.level_set.outputs, put)[0]


def settle(table: Any, batch: Any, rows: FloatArray, ends: FloatArray, scores: FloatArray, looks: int) -> None:
    """The look at the true sets as in `sdhj.kernels.lookup.decide`, for some rows of a batch and sets of any kind.

    ends (4 + K, L, ndim, 1 or R), scores (M, L) and looks are those of `decide`.
    """
    problem, (ints, floats) = table.problem, table.known(batch.step)
    times = floats[slice(*ints[2 * LOOK_TIMES : 2 * LOOK_TIMES + 2])]
    count, here = len(times), LOOKED if len(times) > 1 else 0  # the place of the state among the points
    out = batch.steps_to_go, batch.safe, batch.margins, batch.best, batch.depths
    spots = spots_for(len(rows), len(problem.inputs), count, problem.grid.ndim, 1)
    slots, _, hazard, points, _, level, there = spots
    given = batch.within, batch.states, rows, (ints, floats), (ends, scores), out, spots
    waiting = propose(-1, *given)
    while waiting:
        some, at = slots[0, :waiting], points[: waiting * count].reshape(waiting, count, -1)[:, :, :-1]
        level[0, : waiting * count] = problem.unsafe_along(at, times).ravel()
        inside = there[0, : waiting * count].reshape(waiting, count)
        for near, first, end in ((slots[2, some] == 0, here + 1, count), (out[0][rows[some]] == 0, here, here + 1)):
            if near.any() and not problem.stays:
                met = at[near, first:end]
                found = problem.target_value(met.reshape(-1, problem.grid.ndim), times[first])
                inside[near, first:end] = found.reshape(met.shape[:2])
        waiting = judge(waiting, rows, looks, count, out, spots)
        some = slots[0, :waiting]
        none = some[~batch.safe[rows[some]].any(axis=1)]
        if none.size and looks == LOOK:
            hazard[none] = table._hazards(batch.states[rows[none]], batch.step)
        waiting = propose(waiting, *given)
