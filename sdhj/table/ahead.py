"""What an input can lead to in one interval, and the look at the true sets at a few places of that."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from sdhj.common.remembering import FloatArray
from sdhj.formulas.formula import program
from sdhj.formulas.graph import Node, leaf, rebuilt
from sdhj.kernels.tape import Packable, Tape, packed
from sdhj.kernels.true_sets import CHECKED_INSTANTS, TRUE_SETS_TOO, heed_inputs, judge, propose, samples_for
from sdhj.kernels.tubes import CHECK_TIMES, Answers, Leads
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sets import TargetSet, UnsafeSet

NO_TAPES = program(()) * 3


def tape_of_problem(
    problem: ReachAvoidProblem, step: int, axes: Sequence[FloatArray], tapes: Sequence[Packable], checks: bool
) -> Tape:
    """What compiled look-ups read of a problem at a step, in the order numbered in `sdhj.kernels.tubes`."""
    grid, begin, end = problem.grid, problem.time(step), problem.time(step + 1)
    interval, order = problem.interval(step), np.arange(grid.ndim)
    if problem.dynamics.stateless:  # the axes with the fewest different intervals first, as in `sdhj.solver.hopf_lax`
        ends = interval.displacement_sets(np.array([grid.lower]))[:2, :, :, 0]
        order = np.argsort([len(np.unique(ends[:, :, axis], axis=1).T) for axis in order], kind="stable")
    path = [begin + (end - begin) * instant / CHECKED_INSTANTS for instant in range(1, CHECKED_INSTANTS)]
    # In the order in which `place_points` writes the points: the path, the state, the corners. At N the begin of an
    # interval is the only instant.
    times = np.array([begin] if step == problem.most_steps else [*path, end, begin, *[end] * 2**grid.ndim])
    faces = np.array([*grid.faces("holds", "frees"), grid.lower, grid.upper, *interval.walls_needing_boxes])
    # without checks there are no instants, and the true sets are not evaluated
    when, inputs = (times if checks else times[:0], faces, np.array([interval.begin])), np.arange(len(problem.inputs))
    under = [0 * inputs - 1 if part.inputs is None else part.counts(inputs) for part in problem.unsafe]
    some = np.array(under, dtype=np.int64) if conditional(problem) else np.zeros(0, np.int64)
    return packed(*grid.arrays, *axes, order, *when, some, *tapes)


def conditional(problem: ReachAvoidProblem) -> bool:
    """Whether some unsafe set is unsafe under some inputs only."""
    return any(part.inputs is not None for part in problem.unsafe)


def tapes_of(problem: ReachAvoidProblem) -> tuple[Packable, ...]:
    """Programs on state and time of the paths' ends, the unsafe sets and the target; empty where one is a black box."""
    ahead, ndim = problem.interval(0).displacement_formula, problem.grid.ndim
    sets = (problem.unsafe, () if problem.has_no_target else (problem.target,))
    unsafe, target = (program([_timed(part, ndim) for part in some]) for some in sets)
    # there may be no formula of the paths; the level-set functions must be formulas
    return *program(ahead.outputs if ahead else ()), *unsafe, *target


def _timed(part: UnsafeSet | TargetSet, time: int) -> Node:
    """A set's level-set function as a graph on the whole state, with t as coordinate `time`."""

    def put(one: Node) -> Node | None:
        return leaf("x", part.axes[one.value[0]] if one.op == "x" else time) if one.op in ("x", "p") else None

    return rebuilt(part.level_set.outputs, put)[0]


def choose_by_true_sets(
    table: Any, batch: Any, rows: FloatArray, ends: FloatArray, scores: FloatArray, checks: int
) -> None:
    """Check some rows (R,) of a batch by the true sets, in place, as the compiled `decide` does for formulas."""
    # Nearly always the first input passes, in 36,868 of 36,878 looks. For a network beside a car with six inputs, the
    # points of all inputs before `decide` would be 5.6 times as many: an estimated 1.6 times the CPU of runs.
    problem, (ints, floats) = table.problem, table.tape_at(batch.step)
    times = floats[slice(*ints[2 * CHECK_TIMES : 2 * CHECK_TIMES + 2])]
    count, here = len(times), CHECKED_INSTANTS if len(times) > 1 else 0  # the place of the state among the points
    out = Answers(batch.steps_to_go, batch.safe, batch.margins, batch.best)
    sets = 1 + conditional(problem)  # all together; and those that are unsafe under some inputs
    under = np.repeat(np.array([-1, 1]), len(problem.inputs))
    samples = samples_for(len(rows), len(problem.inputs), count, problem.grid.ndim, sets)
    queue, _, hazard, points, _, unsafe_values, target_values = samples
    given = batch.within, batch.states, rows, ints, floats, Leads(ends, scores, table.normals), out, samples
    waiting = propose(-1, *given)
    while waiting:
        some, at = queue[0, :waiting], points[: waiting * count].reshape(waiting, count, -1)[:, :, :-1]
        unsafe_values[0, : waiting * count] = problem.unsafe_along(at, times).ravel()
        if sets > 1:
            found = problem.unsafe_along(at, times, batch.best[rows[some]]).ravel()
            # only where this input adds a set: a state in a set of all inputs is lost, which the first row says
            unsafe_values[1, : waiting * count] = np.where(found < unsafe_values[0, : waiting * count], found, np.inf)
            heed_inputs(waiting, rows, count, under, batch.best, samples)
        inside = target_values[0, : waiting * count].reshape(waiting, count)
        for near, first, end in ((queue[2, some] == 0, here + 1, count), (out.to_go[rows[some]] == 0, here, here + 1)):
            if near.any() and not problem.has_no_target:
                met = at[near, first:end]
                found = problem.target_value(met.reshape(-1, problem.grid.ndim), times[first])
                inside[near, first:end] = found.reshape(met.shape[:2])
        waiting = judge(waiting, rows, checks, count, out, samples)
        some = queue[0, :waiting]
        none = some[~batch.safe[rows[some]].any(axis=1)]
        if none.size and checks == TRUE_SETS_TOO:
            hazard[none] = table._hazards(batch.states[rows[none]], batch.step)
        waiting = propose(waiting, *given)
