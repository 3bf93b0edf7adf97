"""The boxes that the controller looks ahead with: where each input and any adversary can lead in one interval.

`Interval.reachable` works them out with the user's own functions, called for one input after another. Where velocities
depend on the state the boxes are therefore tabulated once, on a lattice of the axes that velocities read at the nodes
(of a car its heading), and interpolated. What that errs by is at most the second difference between neighbours, summed
over the axes: at a jump all of it, at a kink half of it, elsewhere an eighth. The boxes are widened by the largest, and
the lattice is made finer until that is less than `WIDER`: a box from the table holds the one of the state, and exceeds
it by less than twice as much. Where there is no room for that, or where some states say otherwise, each state has its
boxes worked out.
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
TRIED = 1000  # states whose boxes the table must hold

LookAhead = Callable[[FloatArray, FloatArray], Reach]  # of states (M, ndim), the boxes of some rows (R,)


def look_ahead(interval: Interval, room: float = ROOM) -> LookAhead:
    """What tells the boxes of an interval; from a table of at most `room` bytes where one is right."""
    grid, axes = interval.grid, np.flatnonzero(interval.reads.any(axis=0))
    if not axes.size:
        shared = _reach(grid, *interval.reachable(np.array([grid.lower])))
        return lambda states, rows: shared
    try:
        with np.errstate(all="ignore"):  # nobody has asked for these states: what fails there is no failure
            table = _tabulated(interval, axes, room)
            if table is not None and _holds(table, interval):
                return table
    except ValueError:
        pass
    return lambda states, rows: _reach(grid, *interval.reachable(states[rows]))


def _reach(grid: Grid, low: FloatArray, high: FloatArray) -> Reach:
    """One box for all states has the axes with the fewest different intervals first, as in `sdhj.hopf_lax`."""
    order = np.arange(grid.ndim)
    if len(low) == 1:
        different = [len(np.unique([low[0, :, axis], high[0, :, axis]], axis=1).T) for axis in order]
        order = np.argsort(different, kind="stable")
    lowest, highest = low.min(axis=1), high.max(axis=1)
    return Reach(low, high, lowest, highest, order, _most_nodes(grid, highest - lowest))


def _most_nodes(grid: Grid, widths: FloatArray) -> int:
    """How many nodes a box of one of the widths (M, ndim) can touch, and one more along each axis."""
    return int((np.ceil(widths / grid.spacing + 1e-6) + 2).prod(axis=1).max(initial=0))


def _tabulated(interval: Interval, axes: FloatArray, room: float) -> LookAhead | None:
    """The table on the coarsest lattice that will do; None where there is no room for it."""
    grid, finer = interval.grid, [1] * interval.grid.ndim
    while True:
        nodes = [n * r if p else (n - 1) * r + 1 for n, r, p in zip(grid.shape, finer, grid.periodic, strict=True)]
        lattice = Grid(grid.lower, grid.upper, nodes, grid.periodic)
        some = lattice.subgrid(axes.tolist())
        if 16 * some.size * len(interval.dynamics.inputs) * grid.ndim > room:
            return None
        points = np.tile(np.array(grid.lower), (some.size, 1))
        points[:, axes] = some.points()
        boxes = np.stack(interval.reachable(points))  # (2, size, L, ndim)
        bends = np.stack([_bend(boxes.reshape(2, *some.shape, -1), some, axis) for axis in range(some.ndim)])
        bends = bends.reshape(some.ndim, 2, *boxes.shape[2:])
        if (bends.sum(axis=0) < WIDER * np.array(grid.spacing)).all():
            break
        finer[axes[(bends / grid.spacing).max(axis=(1, 2, 3)).argmax()]] *= 2
    low, high = bends.sum(axis=0)
    boxes += np.stack([-low, high])[:, None]
    size = _most_nodes(grid, boxes[1].max(axis=1) - boxes[0].min(axis=1))
    return partial(_interpolated, boxes, axes, tuple(lattice.arrays), size)


def _bend(values: FloatArray, grid: Grid, axis: int) -> FloatArray:
    """The largest second difference of values (2, *grid.shape, K) along an axis of the grid, (2, K)."""
    if grid.periodic[axis]:
        values = np.concatenate([values, values.take([0, 1], axis + 1)], axis + 1)
    return np.abs(np.diff(values, 2, axis + 1)).max(axis=tuple(range(1, grid.ndim + 1)))


def _interpolated(
    table: FloatArray, axes: FloatArray, lattice: tuple[Any, ...], size: int, states: FloatArray, rows: FloatArray
) -> Reach:
    inputs, ndim = table.shape[2:]
    boxes, hull = np.empty((2, len(rows), inputs, ndim)), np.empty((2, len(rows), ndim))
    boxes_at(states, rows, axes, lattice, table, boxes, hull)
    return Reach(boxes[0], boxes[1], hull[0], hull[1], np.arange(ndim), size)


def _holds(table: LookAhead, interval: Interval) -> bool:
    """Whether boxes from a table hold those of states drawn anywhere: between the nodes there may be anything."""
    grid = interval.grid
    states = np.random.default_rng(0).uniform(grid.lower, grid.upper, (TRIED, grid.ndim))
    told, (low, high) = table(states, np.arange(TRIED)), interval.reachable(states)
    rounding = 1e-12 * np.array(grid.spacing)
    return bool((told.low <= low + rounding).all() and (told.high >= high - rounding).all())
