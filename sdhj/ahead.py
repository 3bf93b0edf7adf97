"""The boxes that the controller looks ahead with: where each input and any adversary can lead in one interval.

`Interval.reachable` asks the user's functions, one input after another. Where velocities depend on the state the boxes
are therefore tabulated, on a lattice of the axes that velocities read at the nodes (of a car its heading), and
interpolated. What that errs by is at most the second difference between neighbours, summed over the axes: at a jump all
of it, at a kink half of it, elsewhere an eighth. The boxes are widened by the largest, and the lattice is made finer
until that is less than `WIDER`: they hold the boxes of the state and exceed them by less than twice as much.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from sdhj.dynamics import Interval
from sdhj.grid import FloatArray, Grid
from sdhj.lookup import Reach, boxes_at

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
    """One box for all states has the axes with the fewest different intervals first, as in `sdhj.hopf_lax`."""
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
    told, (low, high) = tell(states, np.arange(TRIED)), interval.reachable(states)
    if (told.low > low + 1e-12 * cells).any() or (told.high < high - 1e-12 * cells).any():
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
