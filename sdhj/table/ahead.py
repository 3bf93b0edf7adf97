"""What an input can lead to in one interval, and a look at the true sets at a few places of that."""

from collections.abc import Callable
from functools import cache
from itertools import product

import numpy as np

from sdhj.kernels import FloatArray
from sdhj.kernels.lookup import Reach
from sdhj.problem.grid import Grid
from sdhj.problem.interval import Interval
from sdhj.problem.problem import ReachAvoidProblem

LookAhead = Callable[[FloatArray, FloatArray], Reach]  # of states (M, ndim), the boxes of some rows (R,)


def look_ahead(interval: Interval) -> LookAhead:
    """What tells the boxes of an interval."""
    grid, order = interval.grid, np.arange(interval.grid.ndim)
    if not interval.dynamics.stateless:
        return lambda states, rows: _reach(grid, *interval.reachable(states[rows]), order)
    # one box for all states: the axes with the fewest different intervals first, as in `sdhj.solver.hopf_lax`
    low, high = interval.reachable(np.array([grid.lower]))
    different = [len(np.unique([low[0, :, axis], high[0, :, axis]], axis=1).T) for axis in order]
    shared = _reach(grid, low, high, np.argsort(different, kind="stable"))
    return lambda states, rows: shared


def _reach(grid: Grid, low: FloatArray, high: FloatArray, order: FloatArray) -> Reach:
    lowest, highest = low.min(axis=1), high.max(axis=1)
    nodes = np.ceil((highest - lowest) / grid.spacing + 1e-6) + 2  # that it can touch, and one more along each axis
    return Reach(low, high, lowest, highest, order, int(nodes.prod(axis=1).max(initial=0)))


LOOKED = 4  # instants of an interval at which the path without an adversary is looked at, its end among them


def nothing_met(
    problem: ReachAvoidProblem,
    states: FloatArray,
    inputs: FloatArray,
    step: int,
    left: FloatArray,
    reach: Reach,
    rows: FloatArray,
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
    reach, rows : Reach, (M,) int
        What the inputs can lead to, and which of its rows the states have.

    Returns
    -------
    two (M,) bool
    """
    grid, sides = problem.grid, _sides(problem.grid.ndim)
    begin, end = problem.time(step), problem.time(step + 1)
    times = [begin + (end - begin) * part / LOOKED for part in range(LOOKED)] + [end] * (1 + len(sides))
    of = rows if len(reach.low) > 1 else 0
    low, high = reach.low[of, inputs], reach.high[of, inputs]
    corners = states[:, None] + np.where(sides, high[:, None], low[:, None])
    path = problem.interval(step).path(states, inputs, LOOKED)
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
