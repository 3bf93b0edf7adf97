"""Whether a grid sees what it is to avoid: a wall thinner than a cell may pass between its nodes.

A cell *hides* a part of an unsafe set where the set is met inside it, but no node is in the set, neither at its corners
nor at those of the cells around. (Where one is, the set's boundary runs by, and the interpolated one is off by a part
of a cell, as everywhere.) How fast a level-set function changes from node to node bounds what it can do between them;
where that does not exclude it, the least value in the cell is searched for.
"""

import warnings
from collections.abc import Callable
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from sdhj.grid import FloatArray, Grid

if TYPE_CHECKING:
    from sdhj.problem import ReachAvoidProblem, UnsafeSet
    from sdhj.table import LookupTable

ROUNDS = 5  # of the search: each finds the least value on a lattice of 3 points an axis, three times as fine as before
SOUGHT = 200_000  # values at most that a search asks for
FINE = 4  # parts of a cell's edge, where the least value in it is asked for
CROSSINGS = 1000  # of the boundary and the lines between nodes along an axis, at which it is tried
TIMES = 3  # at which a moving set is looked at
ASKED = 4000  # states, whether an input is promised there
BRIEF = 20  # steps, in which a state without one is met in less than half of the runs even where they are 3 % of all
ABRUPT = 0.25  # of the change between two nodes: a level-set function that is farther from linear jumps there


class ResolutionWarning(UserWarning):
    """The grid is too coarse for an unsafe set, or its level-set function is no distance."""


def check_resolution(problem: "ReachAvoidProblem", stacklevel: int = 2) -> None:
    """Warn of unsafe sets that hide between nodes or are too thin, and of level-set functions that jump at the edge."""
    from sdhj.thin import too_thin

    for part in problem.unsafe:
        if part.sampling == "cell":
            continue
        often = TIMES if part.moving else 1
        for t in np.linspace(0.0, problem.most_steps * problem.delta, often).tolist():
            if told := _hidden(problem, part, t) or _abrupt(problem, part, t) or too_thin(problem, part, t):
                warnings.warn(told, ResolutionWarning, stacklevel=stacklevel + 1)
                break


def _hidden(problem: "ReachAvoidProblem", part: "UnsafeSet", t: float) -> str:
    """What to say of a part of the set that no node sees; nothing where there is none."""
    grid, values = problem.grid.subgrid(part.axes), problem.unsafe_at(part, t)
    spacing = np.array(grid.spacing)
    bound, corners = sum(_steepest(grid, values, axis) for axis in range(grid.ndim)) / 2, values
    for axis in range(grid.ndim):
        corners = np.minimum(*grid.edges(corners, axis))
    seen = corners <= 0
    for axis in range(grid.ndim):
        along = np.moveaxis(seen, axis, 0)  # a view
        before = along.copy()
        along[1:] |= before[:-1]
        along[:-1] |= before[1:]
        if grid.periodic[axis]:
            along[[0, -1]] |= before[[-1, 0]]
    suspects = np.flatnonzero((corners <= bound) & ~seen)
    offsets = np.array(list(product((-1.0, 0.0, 1.0), repeat=grid.ndim)))
    most = SOUGHT // (ROUNDS * len(offsets)) + 1
    suspects = suspects[np.argsort(corners.ravel()[suspects], kind="stable")[:most]]
    if not suspects.size:
        return ""
    places = np.stack(np.unravel_index(suspects, corners.shape), axis=1) + 0.5
    centres, reach = np.array(grid.lower) + places * spacing, spacing / 3
    for _ in range(ROUNDS):
        points = centres[:, None] + offsets * reach
        found = part.level_set(grid.wrapped(points.reshape(-1, grid.ndim)), t).reshape(len(points), -1)
        rows, best = np.arange(len(points)), found.argmin(axis=1)
        centres, reach, least = points[rows, best], reach / 3, found[rows, best]
    deepest = int(least.argmin())
    if least[deepest] >= 0:
        return ""
    thickness = -2 * float(least[deepest])
    names = [problem.grid.names[axis] for axis in part.axes]
    needed = [int(np.ceil((hi - lo) / thickness)) + 1 for lo, hi in zip(grid.lower, grid.upper, strict=True)]
    where = ", ".join(f"{name} = {x:.4g}" for name, x in zip(names, centres[deepest], strict=True))
    return (
        f"the unsafe set {part.name!r} hides between the nodes at {where}, t = {t:g}: it is about {thickness:.2g} "
        f"thick there, and nodes are {', '.join(f'{h:.2g}' for h in spacing)} apart, so the table does not know of it. "
        f"Use {', '.join(f'{n} nodes along {name}' for n, name in zip(needed, names, strict=True))}, or "
        'UnsafeSet(..., sampling="cell"), which takes the least value in the cells around each node'
    )


def _abrupt(problem: "ReachAvoidProblem", part: "UnsafeSet", t: float) -> str:
    """What to say of a level-set function that jumps at the set's boundary; nothing where it does not."""
    grid, values = problem.grid.subgrid(part.axes), problem.unsafe_at(part, t)
    off = []
    for axis in range(grid.ndim):
        here, there = grid.edges(values, axis)
        crossing = np.flatnonzero((here > 0) != (there > 0))
        crossing = crossing[:: crossing.size // CROSSINGS + 1]
        if crossing.size:
            one, other = here.ravel()[crossing], there.ravel()[crossing]
            places = np.stack(np.unravel_index(crossing, here.shape), axis=1).astype(float)
            places[:, axis] += one / (one - other)  # where the interpolant is zero
            at = part.level_set(grid.wrapped(np.array(grid.lower) + places * grid.spacing), t)
            off.append(np.abs(at) / np.abs(one - other))
    if not off or np.median(np.concatenate(off)) < ABRUPT:
        return ""
    return (
        f"the level-set function of {part.name!r} jumps at the set's boundary, as an indicator does, so between nodes "
        "the boundary is known to half a cell at best; give a distance to the set (sdhj.UnsafeSet.from_map makes one "
        "of a map)"
    )


def _steepest(grid: Grid, values: FloatArray, axis: int) -> float:
    here, there = grid.edges(values, axis)
    return float(np.abs(there - here).max())


def least_in_cells(grid: Grid, function: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """For each node, a bound from below on a level-set function in all cells that touch it, shape `grid.shape`.

    The least value on a lattice of `FINE` parts a cell, less what the function changes by in half a part along each
    axis. The interpolant of a set sampled so meets it wherever it is met in truth.
    """
    shape = [n * FINE if p else (n - 1) * FINE + 1 for n, p in zip(grid.shape, grid.periodic, strict=True)]
    fine = Grid(grid.lower, grid.upper, shape, grid.periodic)
    values = np.asarray(function(fine.points()), dtype=np.float64).reshape(shape)
    values = values - sum(_steepest(fine, values, axis) for axis in range(grid.ndim)) / 2
    for axis, (n, periodic) in enumerate(zip(shape, grid.periodic, strict=True)):
        at = np.arange(0, n, FINE)[:, None] + np.arange(-FINE, FINE + 1)
        at = at % n if periodic else np.clip(at, 0, n - 1)
        values = np.minimum.reduce([values.take(column, axis) for column in at.T])
    return values


def check_promises(table: "LookupTable", stacklevel: int = 2) -> None:
    """Warn where a run is bound to meet a state for which the table promises no input.

    Between the nodes there are such states for every grid. A run of a few steps meets them rarely, and most of what is
    then chosen leads on; where one is met for certain before the target, runs end by standing there.
    """
    if table.steps < BRIEF or table.problem.stays:
        return
    grid = table.grid
    told = table.batch(np.random.default_rng(0).uniform(grid.lower, grid.upper, (ASKED, grid.ndim)), 0)
    on_the_way = told.steps_to_go > 0
    if not on_the_way.any():
        return
    unsure, steps = float((~told.promised[on_the_way]).mean()), float(told.steps_to_go[on_the_way].mean())
    if unsure * steps > 1:
        warnings.warn(
            f"for {unsure:.1%} of the states that are won no input is sure to lead on, and {steps:.0f} steps are to go "
            "from them on average: runs are bound to meet such a state and may stand there for ever. Use more nodes, "
            'fewer steps, or method="certified"',
            ResolutionWarning,
            stacklevel=stacklevel + 1,
        )
