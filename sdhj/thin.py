"""Whether what a grid sees of an unsafe set is thick enough to stay there while the games are solved.

A wall that nodes see may still be too *thin*: differences wear its crest down, and the solver leaks through. Measured
with a unicycle and intervals of 1.5 to 4.5 cells of travel, walls whose deepest nodes are half a cell deep or less lose
10 to 40 % of the runs, from three quarters on as few as thick ones; dots lose of what comes their way two to four times
as much as large disks. Where velocities do not depend on the state no more than a percent collides, so nothing is said.
"""

from itertools import permutations
from typing import TYPE_CHECKING

import numpy as np

from sdhj.grid import FloatArray, Grid

if TYPE_CHECKING:
    from sdhj.problem import ReachAvoidProblem, UnsafeSet

DEEP = 0.75  # cells, of the deepest node across a wall
ROOMY = 2 * DEEP + 1  # cells, of a wall so thick that some node is that deep wherever it lies
LEAST_TOLD = 0.1  # cells: the least thickness that is told


def too_thin(problem: "ReachAvoidProblem", part: "UnsafeSet", t: float) -> str:
    """What to say of a wall, three nodes along it or more, or a dot that is too thin; nothing where there is none."""
    if problem.dynamics.stateless or part.sampling == "steep":
        return ""
    grid, values = problem.grid.subgrid(part.axes), problem.unsafe_at(part, t)
    cells = np.array([_thickness(grid, values, axis) for axis in range(grid.ndim)])
    thin = np.isfinite(cells)
    deepest = values
    for axis in range(grid.ndim):
        deepest = np.minimum.reduce([deepest, *(_beside(grid, deepest, axis, by, np.inf) for by in (-1, 1))])
    found = thin.all(axis=0) & (values == deepest)  # dots, not the tips of what is deeper behind
    for across, along in permutations(range(grid.ndim), 2):  # a wall may lie aslant
        near = np.logical_or.reduce([_beside(grid, thin[across], across, by, False) for by in (-1, 0, 1)])
        found |= thin[across] & _beside(grid, near, along, -1, False) & _beside(grid, near, along, 1, False)
    if not found.any():
        return ""
    place = np.unravel_index(np.where(found, cells.min(axis=0), np.inf).argmin(), grid.shape)
    names = [problem.grid.names[axis] for axis in part.axes]
    where = ", ".join(f"{name} = {grid.nodes(axis)[place[axis]]:.4g}" for axis, name in enumerate(names))
    wrong = [axis for axis in range(grid.ndim) if thin[(axis, *place)]]
    told = [f"{float(cells[(axis, *place)]) * grid.spacing[axis]:.2g} along {names[axis]}" for axis in wrong]
    needed = [int(np.ceil((grid.shape[axis] - 1) * ROOMY / cells[(axis, *place)])) + 1 for axis in wrong]
    return (
        f"the unsafe set {part.name!r} is too thin for the grid at {where}, t = {t:g}: it is about {', '.join(told)} "
        "thick there, and differences wear down what is not some cells thick, so the solver may leak through it. Use "
        f"{', '.join(f'{n} nodes along {names[axis]}' for n, axis in zip(needed, wrong, strict=True))}, or "
        'UnsafeSet(..., sampling="steep"), which keeps the crest at the price of a part of a cell'
    )


def _thickness(grid: Grid, values: FloatArray, axis: int) -> FloatArray:
    """Cells from side to side of the set along an axis at the nodes where it is too thin, +inf elsewhere; (shape)."""
    last, before, after, further = (_beside(grid, values, axis, by, -np.inf) for by in (-2, -1, 1, 2))
    thickness = np.full(values.shape, np.inf)
    alone, pairs = (before, values, values, after), ((before, values, after, further), (last, before, values, after))
    with np.errstate(invalid="ignore", divide="ignore"):
        for left, first, second, right in (alone, *pairs):  # from outside to outside
            inside = (left > 0) & (first <= 0) & (second <= 0) & (right > 0)
            thin = inside & (-np.minimum(first, second) < DEEP * np.maximum(left - first, right - second))
            across = first / (first - left) + second / (second - right) + (first is not second)
            thickness = np.where(thin, np.maximum(across, LEAST_TOLD), thickness)
    return thickness


def _beside(grid: Grid, values: FloatArray, axis: int, by: int, past: float) -> FloatArray:
    """For each node the value `by` nodes on along an axis; `past` beyond a bounded end."""
    out = np.roll(values, -by, axis)
    if not grid.periodic[axis]:
        ends = slice(0, -by) if by < 0 else slice(grid.shape[axis] - by, None)
        out[(slice(None),) * axis + (ends,)] = past
    return out
