"""What an input can lead to in one interval, and a look at the true sets at a few places of that."""

from collections.abc import Callable
from functools import cache, partial
from itertools import product
from typing import Any

import numpy as np

from sdhj.kernels import FloatArray
from sdhj.kernels.lookup import Reach, boxes_at
from sdhj.problem.dynamics import Interval
from sdhj.problem.grid import Grid
from sdhj.problem.problem import ReachAvoidProblem

WIDER = 0.01  # cells of the grid
ROOM = 2**26  # bytes that the tables of all steps may take
TRIED = 1000  # states whose boxes a table must hold: between the nodes there may be anything

LookAhead = Callable[[FloatArray, FloatArray], Reach]  # of states (M, ndim), the boxes of some rows (R,)


def look_ahead(interval: Interval, room: float = ROOM) -> LookAhead:
    """What tells the boxes of an interval: from a table of at most `room` bytes, else worked out at each state."""
    grid, axes = interval.grid, np.flatnonzero(interval.reads.any(axis=0))
    if not axes.size:
        shared = _reach(grid, *interval.reachable(np.array([grid.lower])))
        return lambda states, rows: shared
    try:
        with np.errstate(all="ignore"):  # nobody has asked for these states: what fails there is no failure
            return _tabulated(interval, axes, room)
    except ValueError:
        return lambda states, rows: _reach(grid, *interval.reachable(states[rows]))


def _reach(grid: Grid, low: FloatArray, high: FloatArray) -> Reach:
    """One box for all states has the axes with the fewest different intervals first, as in `sdhj.solver.hopf_lax`."""
    order = np.arange(grid.ndim)
    if len(low) == 1:
        different = [len(np.unique([low[0, :, axis], high[0, :, axis]], axis=1).T) for axis in order]
        order = np.argsort(different, kind="stable")
    lowest, highest = low.min(axis=1), high.max(axis=1)
    nodes = np.ceil((highest - lowest) / grid.spacing + 1e-6) + 2  # that it can touch, and one more along each axis
    return Reach(low, high, lowest, highest, order, int(nodes.prod(axis=1).max(initial=0)))


def _tabulated(interval: Interval, axes: FloatArray, room: float) -> LookAhead:
    """From the coarsest lattice that will do; ValueError where there is none, or where a drift fails on it."""
    grid, cells, finer = interval.grid, np.array(interval.grid.spacing), [1] * interval.grid.ndim
    while True:
        nodes = [n * r if p else (n - 1) * r + 1 for n, r, p in zip(grid.shape, finer, grid.periodic, strict=True)]
        lattice = Grid(grid.lower, grid.upper, nodes, grid.periodic)
        some = lattice.subgrid(axes.tolist())
        if 16 * some.size * len(interval.dynamics.inputs) * grid.ndim > room:
            raise ValueError("no room")
        points = np.tile(np.array(grid.lower), (some.size, 1))
        points[:, axes] = some.points()
        boxes = np.stack(interval.reachable(points))  # (2, size, L, ndim)
        bends = [_bend(boxes.reshape(2, *some.shape, *boxes.shape[2:]), some, axis) for axis in range(some.ndim)]
        if (np.sum(bends, axis=0) < WIDER * cells).all():
            break
        finer[axes[np.argmax([(bend / cells).max() for bend in bends])]] *= 2
    boxes += (np.array([-1.0, 1.0])[:, None, None] * np.sum(bends, axis=0))[:, None]
    tell = partial(_interpolated, boxes, axes, tuple(lattice.arrays), _reach(grid, *boxes).size)
    states = np.random.default_rng(0).uniform(grid.lower, grid.upper, (TRIED, grid.ndim))
    rates, (low, high) = tell(states, np.arange(TRIED)), interval.reachable(states)
    if (rates.low > low + 1e-12 * cells).any() or (rates.high < high - 1e-12 * cells).any():
        raise ValueError("the nodes do not tell")
    return tell


def _bend(values: FloatArray, grid: Grid, axis: int) -> FloatArray:
    """The largest second difference of values (2, *grid.shape, L, ndim) along an axis of the grid: (2, L, ndim)."""
    if grid.periodic[axis]:
        values = np.concatenate([values, values.take([0, 1], axis + 1)], axis + 1)
    return np.abs(np.diff(values, 2, axis + 1)).max(axis=tuple(range(1, grid.ndim + 1)))


def _interpolated(
    table: FloatArray, axes: FloatArray, lattice: Any, size: int, states: FloatArray, rows: FloatArray
) -> Reach:
    boxes, hull = np.empty((2, len(rows), *table.shape[2:])), np.empty((2, len(rows), table.shape[3]))
    boxes_at(states, rows, axes, lattice, table, boxes, hull)
    return Reach(boxes[0], boxes[1], hull[0], hull[1], np.arange(table.shape[3]), size)


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
