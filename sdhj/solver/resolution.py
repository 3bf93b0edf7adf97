"""Whether a grid resolves the unsafe sets: a set thinner than a cell may lie between its nodes.

A cell *hides* a part of an unsafe set if the set meets the cell, but contains none of the corners of the cell or of its
neighbours. (If it contains one, the set's boundary is nearby, and the interpolated boundary is off by a part of a cell,
as everywhere.) The change of a level-set function from node to node bounds its values between them; if this bound does
not exclude a hidden part, the least value in the cell is searched for.
"""

import warnings
from itertools import permutations, product
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from sdhj.formulas.formula import Formula
from sdhj.kernels import FloatArray
from sdhj.problem.grid import Grid
from sdhj.problem.memory import available
from sdhj.problem.problem import ReachAvoidProblem, _steepest, beside
from sdhj.problem.sets import UnsafeSet

ROUNDS = 5  # of the search: each finds the least value on a lattice of 3 points an axis, three times as fine as before
SOUGHT = 200_000  # values at most that a search computes
CROSSINGS = 1000  # of the boundary and the lines between nodes along an axis, at which the function is checked
TIMES = 3  # at which a moving set is checked
FOUND = WeakKeyDictionary[Formula, dict[Any, str]]()  # what was found of a set: the next problem may have it too
TURNS = 4  # of cells along all axes: no robot is steered so rarely
ABRUPT = 0.25  # of the change between two nodes: a level-set function that is farther from linear jumps there


class ResolutionWarning(UserWarning):
    """The grid is too coarse for an unsafe set, its level-set function is not a distance, or many runs are lost."""


def check_resolution(problem: "ReachAvoidProblem", stacklevel: int = 2) -> None:
    """Warn of unsafe sets that hide between nodes or are too thin, and of level-set functions that jump at the edge."""
    for part in problem.unsafe:
        if part.sampling == "cell":
            continue
        known = FOUND.setdefault(part.level_set, {}) if isinstance(part.level_set, Formula) else {}
        for t in np.linspace(0.0, problem.most_steps * problem.delta, TIMES if part.moving else 1).tolist():
            key = part.name, part.axes, part.sampling, problem.grid, t
            if key not in known:
                known[key] = _hidden(problem, part, t) or _abrupt(problem, part, t)
            if message := known[key] or too_thin(problem, part, t):
                warnings.warn(message, ResolutionWarning, stacklevel=stacklevel + 1)
                break


def _hidden(problem: "ReachAvoidProblem", part: "UnsafeSet", t: float) -> str:
    """The warning for a part of the set between the nodes; empty if there is none."""
    grid, values = problem.grid.subgrid(part.axes), problem.unsafe_at(part, t)
    spacing = np.array(grid.spacing)
    bound, corners = sum(_steepest(grid, values, axis) for axis in range(grid.ndim)) / 2, values
    for axis in range(grid.ndim):
        corners = np.minimum(*grid.edges(corners, axis))
    seen = corners <= 0
    for axis in range(grid.ndim):
        seen = seen | beside(grid, seen, axis, -1, False) | beside(grid, seen, axis, 1, False)
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
    if least[deepest] > 0:
        return ""
    thickness, thick = -2 * float(least[deepest]), "its level-set function is 0, which gives no thickness,"
    use = "a distance that is negative inside, with sampling='cell', or more nodes"
    names = [problem.grid.names[axis] for axis in part.axes]
    if thickness > 0:
        needed = [int(np.ceil((hi - lo) / thickness)) + 1 for lo, hi in zip(grid.lower, grid.upper, strict=True)]
        use = f"{', '.join(f'{n} nodes along {name}' for n, name in zip(needed, names, strict=True))}, or "
        use += 'UnsafeSet(..., sampling="cell"), which uses the least value in the cells around each node'
        thick = f"it is about {thickness:.2g} thick there,"
    where = ", ".join(f"{name} = {x:.4g}" for name, x in zip(names, centres[deepest], strict=True))
    return (
        f"the unsafe set {part.name!r} hides between the nodes at {where}, t = {t:g}: {thick} and nodes are "
        f"{', '.join(f'{h:.2g}' for h in spacing)} apart, so the table ignores it. Use {use}"
    )


def _abrupt(problem: "ReachAvoidProblem", part: "UnsafeSet", t: float) -> str:
    """The warning for a level-set function that jumps at the set's boundary or ends with its period; else empty."""
    grid, values, off = problem.grid.subgrid(part.axes), problem.unsafe_at(part, t), list[FloatArray]()
    rng = np.random.default_rng(0)
    for axis, name in enumerate(problem.grid.names[axis] for axis in part.axes):
        if grid.periodic[axis]:
            side = grid.points().reshape(*grid.shape, grid.ndim).take(0, axis).reshape(-1, grid.ndim)
            side[:, axis] = np.nextafter(grid.upper[axis], grid.lower[axis])
            before, after = part.level_set(side, t), values.take(0, axis).ravel()
            rounding = 1e-6 * np.abs(values).max()
            if np.any(((before > 0) != (after > 0)) & (np.abs(before - after) > rounding)):
                return (
                    f"the unsafe set {part.name!r} is cut off where the periodic axis {name} ends and begins anew: its "
                    f"level-set function has to be periodic, as np.cos(r) - np.cos({name} - c) is for |{name} - c| <= r"
                )
        here, there = grid.edges(values, axis)
        crossing = np.flatnonzero((here > 0) != (there > 0))
        if crossing.size > CROSSINGS:
            crossing = rng.choice(crossing, CROSSINGS, replace=False)
        if crossing.size:
            one, other = here.ravel()[crossing], there.ravel()[crossing]
            places = np.stack(np.unravel_index(crossing, here.shape), axis=1).astype(float)
            places[:, axis] += one / (one - other)  # where the interpolant is zero
            at = part.level_set(grid.wrapped(np.array(grid.lower) + places * grid.spacing), t)
            off.append(np.abs(at) / np.abs(one - other))
    if not off or np.median(np.concatenate(off)) < ABRUPT:
        return ""
    return (
        f"the level-set function of {part.name!r} jumps at the set's boundary, like an indicator function, so it is "
        "located to half a cell at best; use a distance to the set (sdhj.UnsafeSet.from_map computes one from a map)"
    )


DEEP = 0.75  # cells, of the deepest node across a wall
ROOMY = 2 * DEEP + 1  # cells, of a wall so thick that some node is that deep wherever it lies
LEAST_SHOWN = 0.1  # cells: a message names no thickness below this


def too_thin(problem: "ReachAvoidProblem", part: "UnsafeSet", t: float) -> str:
    """The warning for a wall, three nodes along it or more, or a dot that is too thin; empty if there is none."""
    if problem.dynamics.stateless or part.sampling == "steep":
        return ""
    grid, values = problem.grid.subgrid(part.axes), problem.unsafe_at(part, t)
    cells = np.array([_thickness(grid, values, axis) for axis in range(grid.ndim)])
    thin = np.isfinite(cells)
    deepest = values
    for axis in range(grid.ndim):
        deepest = np.minimum.reduce([deepest, *(beside(grid, deepest, axis, by, np.inf) for by in (-1, 1))])
    found = thin.all(axis=0) & (values == deepest)  # dots, not the tips of what is deeper behind
    for across, along in permutations(range(grid.ndim), 2):  # a wall may lie aslant
        near = np.logical_or.reduce([beside(grid, thin[across], across, by, False) for by in (-1, 0, 1)])
        found |= thin[across] & beside(grid, near, along, -1, False) & beside(grid, near, along, 1, False)
    for axis in range(grid.ndim):  # a chord that grazes what is thick beside it is no wall
        thick = (values <= 0) & ~thin[axis]
        for along, by in product(range(grid.ndim), (1, 2)):
            thick = thick | beside(grid, thick, along, -by, False) | beside(grid, thick, along, by, False)
        thin[axis] &= ~thick
    found &= thin.any(axis=0)
    if not found.any():
        return ""
    place = np.unravel_index(np.where(found, cells.min(axis=0), np.inf).argmin(), grid.shape)
    names = [problem.grid.names[axis] for axis in part.axes]
    where = ", ".join(f"{name} = {grid.nodes(axis)[place[axis]]:.4g}" for axis, name in enumerate(names))
    wrong = [axis for axis in range(grid.ndim) if thin[(axis, *place)]]
    thick = [f"{float(cells[(axis, *place)]) * grid.spacing[axis]:.2g} along {names[axis]}" for axis in wrong]
    needed = [int(np.ceil((grid.shape[axis] - 1) * ROOMY / cells[(axis, *place)])) + 1 for axis in wrong]
    steep = 'UnsafeSet(..., sampling="steep"), which prevents that and enlarges the set by less than a cell'
    more = " and ".join(f"{n} nodes along {names[axis]}" for n, axis in zip(needed, wrong, strict=True))
    nodes = problem.grid.size * float(np.prod([n / grid.shape[axis] for n, axis in zip(needed, wrong, strict=True)]))
    fits = 8 * nodes * problem.most_steps < (available() or [np.inf])[0]
    return (
        f"the unsafe set {part.name!r} is too thin for the grid at {where}, t = {t:g}: it is about {', '.join(thick)} "
        "thick there, and finite differences erode a set that is not some cells thick, so the tubes may leak through "
        "it. Use " + (f"{more}, or {steep}" if fits else f"{steep}; {more} would need more memory than is available")
    )


def _thickness(grid: Grid, values: FloatArray, axis: int) -> FloatArray:
    """Thickness of the set along an axis, in cells, at the nodes where it is too thin, +inf elsewhere; (shape)."""
    last, before, after, further = (beside(grid, values, axis, by, -np.inf) for by in (-2, -1, 1, 2))
    thickness = np.full(values.shape, np.inf)
    alone, pairs = (before, values, values, after), ((before, values, after, further), (last, before, values, after))
    with np.errstate(invalid="ignore", divide="ignore"):
        for left, first, second, right in (alone, *pairs):  # from outside to outside
            inside = (left > 0) & (first <= 0) & (second <= 0) & (right > 0)
            thin = inside & (-np.minimum(first, second) < DEEP * np.maximum(left - first, right - second))
            across = first / (first - left) + second / (second - right) + (first is not second)
            thickness = np.where(thin, np.maximum(across, LEAST_SHOWN), thickness)
    return thickness


def check_crossing(problem: "ReachAvoidProblem", crossed: float, stacklevel: int = 2) -> None:
    """Warn where a unit must be wrong: in an interval `TURNS` times as many cells are crossed as all axes have."""
    if crossed > TURNS * sum(problem.grid.shape):
        warnings.warn(
            f"in a sampling interval of {problem.delta:g} s the state crosses up to {crossed:,.0f} cells, and all axes "
            f"together have {sum(problem.grid.shape):,}; check the units of delta and of the velocities",
            ResolutionWarning,
            stacklevel=stacklevel + 1,
        )
