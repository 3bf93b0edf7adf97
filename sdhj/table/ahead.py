"""What an input can lead to in one interval, and a look at the true sets at a few places of that."""

from collections.abc import Callable
from functools import cache
from itertools import product
from typing import Any

import numpy as np

from sdhj.formulas.formula import tape_of
from sdhj.formulas.graph import Node, leaf, rebuilt
from sdhj.kernels import FloatArray
from sdhj.kernels.lookup import Ahead, Look
from sdhj.problem.interval import Interval
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sets import TargetSet, UnsafeSet

NOTHING = tuple(tape_of(()))  # a tape that computes nothing


def prepared(interval: Interval, ends: FloatArray | None = None) -> tuple[Any, ...]:
    """What inputs lead to, for compiled code: a tape, or what it is for all states, or `Interval.ahead` of some."""
    dynamics, order, begin = interval.dynamics, np.arange(interval.grid.ndim), np.array([interval.begin])
    if ends is None and interval.ahead_formula is not None:
        return tuple(Ahead(np.empty((4, 0, 0, 0)), order, tuple(interval.ahead_formula.tape), begin))
    ends = interval.ahead(np.empty((0, interval.grid.ndim))) if ends is None else ends
    if dynamics.stateless:  # the axes with the fewest different intervals first, as in `sdhj.solver.hopf_lax`
        different = [len(np.unique(ends[0, :2, :, axis], axis=1).T) for axis in order]
        order = np.argsort(different, kind="stable")
    return tuple(Ahead(np.ascontiguousarray(np.moveaxis(ends, 0, -1)), order, NOTHING, begin))


def look(problem: ReachAvoidProblem, step: int, sets: tuple[Any, Any]) -> tuple[Any, ...]:
    """The true sets at a step, for compiled code; `sets` are what `tapes` returns."""
    grid, begin, end = problem.grid, problem.time(step), problem.time(step + 1)
    times = np.array([begin + (end - begin) * part / LOOKED for part in range(LOOKED)] + [end])
    return tuple(Look(times, np.array([*grid.faces("wall", "safe"), grid.lower, grid.upper]), *sets))


def tapes(problem: ReachAvoidProblem) -> tuple[Any, Any]:
    """Of the unsafe sets and of the target: tapes of the whole state, with the time as one more coordinate."""
    sets: list[Any] = [problem.unsafe, () if problem.stays else (problem.target,)]
    unsafe, target = (tuple(tape_of([_timed(part, problem.grid.ndim) for part in parts])) for parts in sets)
    return unsafe, target


def _timed(part: UnsafeSet | TargetSet, time: int) -> Node:
    def put(one: Node) -> Node | None:
        return leaf("x", part.axes[one.value[0]] if one.op == "x" else time) if one.op in ("x", "p") else None

    return rebuilt(part.level_set.outputs, put)[0]


LOOKED = 4  # instants of an interval at which the path without an adversary is looked at, its end among them


def nothing_met(
    problem: ReachAvoidProblem,
    states: FloatArray,
    inputs: FloatArray,
    step: int,
    left: FloatArray,
    ends: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Whether the true sets refute nothing of a state, and nothing of an input in it, at the places looked at.

    Looked at are the state, `LOOKED` instants of its path without an adversary, and the corners of the box that the
    input can lead to at the interval's end. It is a check at these places, no proof. What is past a safe end no longer
    matters.

    Parameters
    ----------
    states, inputs : (M, ndim), (M,) int
    left : (M,) int
        Steps to go after the interval. With 0 the corners have to be in the true target.
    ends : (M, 4, L, ndim) or (1, 4, L, ndim)
        What the inputs lead to (`Interval.ahead`).

    Returns
    -------
    two (M,) bool
    """
    grid, sides = problem.grid, _sides(problem.grid.ndim)
    begin, end = problem.time(step), problem.time(step + 1)
    times = [begin + (end - begin) * part / LOOKED for part in range(LOOKED)] + [end] * (1 + len(sides))
    own = ends[np.arange(len(states)) if len(ends) > 1 else 0, :, inputs]  # (M, 4, ndim)
    corners = states[:, None] + np.where(sides, own[:, 1, None], own[:, 0, None])
    shares = np.arange(1, LOOKED + 1)[:, None] / LOOKED
    path = grid.clipped(states[:, None] + shares * own[:, 2, None] + shares**2 * own[:, 3, None])
    met = np.concatenate([states[:, None], path, corners], axis=1)
    clear = problem.unsafe_along(grid.clipped(met, "wall", "safe"), times) > 0
    if grid.has("unsafe"):
        clear[:, 1 : LOOKED + 1] &= ~grid.beyond(path, "unsafe")
    if not problem.stays and (last := left == 0).any():
        there = problem.target_value(grid.clipped(corners[last]).reshape(-1, grid.ndim), end) <= 0
        clear[last, LOOKED + 1 :] &= there.reshape(-1, len(sides))
    if grid.has("safe"):
        gone = grid.beyond(met, "safe")
        gone[:, : LOOKED + 1] = np.logical_or.accumulate(gone[:, : LOOKED + 1], axis=1)
        clear |= gone
    return clear[:, 0], np.logical_and.reduce(clear[:, 1:], axis=1)


@cache
def _sides(ndim: int) -> FloatArray:
    return np.array(list(product((False, True), repeat=ndim)))


def first_passing(scores: FloatArray, passes: Callable[[FloatArray, FloatArray], FloatArray]) -> FloatArray:
    """For each row of scores (M, L) the place of the least one below +inf that passes, of equals the first; else -1.

    `passes(rows, places)` is asked for one place of a row at a time, the least first. What fails becomes +inf.
    """
    chosen = np.full(len(scores), -1)
    rows = np.arange(len(scores))
    while (rows := rows[(scores[rows] < np.inf).any(axis=1)]).size:
        best = scores[rows].argmin(axis=1)
        good = passes(rows, best)
        chosen[rows[good]] = best[good]
        scores[rows[~good], best[~good]] = np.inf
        rows = rows[~good]
    return chosen
