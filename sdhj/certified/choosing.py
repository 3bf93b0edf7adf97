"""How many cells each axis gets where nobody says: by what cells lose, and by what they cost.

*What is lost.* Where a set's boundary moves inwards by w along axis k, the set loses the share m_k w of itself: m_k
counts how often lines along the axis cross the boundary, for each unit of length that they are inside. From one step to
the next the boundary of a tube turns as velocities carry it, m becomes (1 + delta |J|)^T m, where |J_ik| is how much
wider bounds on the velocity along axis i are in a box of width 1 along axis k. With cells of width w a step loses
m_i delta |J_ik| w_k, as the image of a cell is wider than the cell, and m_k w_k, as it is rounded out to whole cells,
unless cells are aligned with what an interval does. All this is linear: c_k w_k is lost to the width of axis k. For one
number of cells the sum over k is least where all c_k w_k are alike; but for wide cells the loss is no longer linear, so
the numbers of cells are taken by the power `SHARPNESS` of c_k.

*What is paid.* A count of what is computed, times the seconds that each took on one core where this was written. It is
no clock, so a problem has the same cells on every machine.
"""

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from sdhj.certified.bounds import Bounds, known_sets
from sdhj.certified.cells import CellAxis, aligned
from sdhj.certified.general_proof import EVALUATED, FINEST, peak, shapes
from sdhj.certified.images import BOXES_OF_A_SET, place_axes
from sdhj.formulas.formula import BlackBox
from sdhj.formulas.graph import ordered
from sdhj.kernels import FloatArray
from sdhj.problem.problem import ReachAvoidProblem

SPEED_STATES = 256  # states around which velocities are bounded
BOX = 1 / 64  # of an axis, the width of these boxes
SET_NODES = 1_000_000  # at which a set is looked at, at most
TRIALS = 20  # of the numbers of cells
LOSING_STEPS = 10  # over which losses are added up, at most
SHARPNESS = 2 / 3
WORTH = 0.03  # to lose less, by the model, is not worth more cells
MOST_OF_AN_AXIS = 4096
MOST_BYTES = 4_000_000_000  # without the sets that are found
CORES = 1.6  # that two are worth
ENDLESS_STEPS = 100  # steps of a solve without a number of steps
# seconds, in `prepare`: for a part of an interval and an axis of a box, and an operation of the velocities; for a cell,
# an input and a corner of the boxes of a set that stands still, or of one that moves and a part of the interval; for a
# cell and an input at unsafe ends; for an operation of a set and a box
AXIS, OPERATION, STILL_CORNER, MOVING_CORNER, AT_ENDS, BOXED = 1.6e-7, 1.4e-8, 1.2e-8, 5.4e-9, 1.4e-7, 8.8e-9
# in the recursion, for a cell of an entry, a row of its image, and a row that a changed one is reached from
ENTRY, IMAGE, NEAR_ROW = 6e-8, 1.3e-9, 4e-10
BLACK_BOX, LOOK_UP = 100, 40  # operations


class Speeds(NamedTuple):
    """Of states drawn at random and all inputs: mean |J| (ndim, ndim), mean widths (ndim,) and extremes (2, ndim)."""

    wider: FloatArray
    widths: FloatArray
    extremes: FloatArray


def chosen_cells(problem: ReachAvoidProblem, parts: int, seconds: float) -> tuple[int, ...]:
    """The number of cells on each axis, before they are aligned, that takes about so many seconds on two cores."""
    speeds = speeds_of(problem)
    lost = losses(problem, speeds)
    shares = lost * np.subtract(problem.grid.upper, problem.grid.lower)
    shares = np.maximum(shares, 1e-3 * shares.max(initial=1e-300)) ** SHARPNESS

    def counts(factor: float) -> tuple[int, ...]:
        return tuple(np.clip(np.rint(factor * shares), 2, MOST_OF_AN_AXIS).astype(int).tolist())

    least, most = 2 / shares.max(), MOST_OF_AN_AXIS / shares.min()
    for _ in range(TRIALS):
        factor = math.sqrt(least * most)
        axes = aligned(problem, counts(factor))
        wide = float((lost * [float(axis.width) for axis in axes]).sum())
        large = peak(problem, axes, parts, *shapes(problem, axes, place_axes(problem, axes))[1:])
        if wide < WORTH or large > MOST_BYTES or sum(cost(problem, axes, parts, speeds)) > CORES * seconds:
            most = factor
        else:
            least = factor
    return counts(least)


def losses(problem: ReachAvoidProblem, speeds: Speeds) -> FloatArray:
    """c (ndim,): what is lost for each unit of a cell's width on an axis."""
    m, turned = _crossings(problem), problem.delta * speeds.wider
    rounded = problem.dynamics.reads.any(axis=1) | problem.dynamics.timed
    lost = m.copy()
    for _ in range(min(problem.most_steps, LOSING_STEPS)):
        lost += m * rounded + m @ turned
        m = m + m @ turned
    return lost


def _crossings(problem: ReachAvoidProblem) -> FloatArray:
    """m (ndim,), counted between the nodes of the problem's grid, of the sets and the unsafe ends, added up."""
    grid, steps = problem.grid, problem.most_steps
    extent, ends = np.subtract(grid.upper, grid.lower), np.stack(grid.faces("unsafe"))
    out = np.isfinite(ends).sum(axis=0) / extent
    for part in known_sets(problem):
        own = grid.subgrid(part.axes)
        own = replace(own, shape=tuple(min(n, int(SET_NODES ** (1 / own.ndim))) for n in own.shape))
        times = [problem.time(step) for step in (0, steps // 2, steps)] if part.moving else [0.0]
        inside = np.stack([part.level_set(own.points(), t).reshape(own.shape) <= 0.0 for t in times])
        for place, axis in enumerate(part.axes):
            crossed = np.diff(inside, axis=1 + place).mean() * (own.shape[place] - 1)
            out[axis] += crossed / extent[axis] / max(inside.mean(), 1 / own.size)
    return out


def speeds_of(problem: ReachAvoidProblem) -> Speeds:
    """How velocities are bounded in boxes around states drawn at random, and in these states."""
    grid, bounds, t, count = problem.grid, Bounds(problem), problem.time(0), len(problem.inputs)
    size = BOX * np.subtract(grid.upper, grid.lower)
    states = grid.lower + size * np.random.default_rng(0).uniform(0.0, 1 / BOX - 1, (SPEED_STATES, grid.ndim))
    wider, ends = np.zeros((grid.ndim, grid.ndim)), np.empty((2, count, SPEED_STATES, grid.ndim))
    for j in range(count):
        ends[:, j] = least, most = bounds.velocity(j, states, states, t, t)
        for k in np.flatnonzero(bounds.reads.any(axis=0)):
            low, high = bounds.velocity(j, states, states + size * (np.arange(grid.ndim) == k), t, t)
            wider[:, k] += np.mean((high - low) - (most - least), axis=0) / size[k] / count
    extremes = np.stack([ends[0].min(axis=(0, 1)), ends[1].max(axis=(0, 1))])
    return Speeds(np.maximum(wider, 0.0), (ends[1] - ends[0]).mean(axis=(0, 1)), extremes)


def cost(problem: ReachAvoidProblem, axes: tuple[CellAxis, ...], parts: int, speeds: Speeds) -> tuple[float, float]:
    """Seconds of one core that preparing and the recursion take."""
    own = place_axes(problem, axes)
    _, moves, clear = shapes(problem, axes, own)
    (starts, count, places, ndim), (times, cells, _) = moves, clear
    entries = (problem.steps or ENDLESS_STEPS) * (1.0 if problem.timeless else (problem.most_steps + 1) / 2)
    pieces = min(max(EVALUATED // (places * count * parts * starts * 2), 1), FINEST) * parts * starts * count * places
    drift = problem.dynamics.drift
    velocity = drift if isinstance(drift, BlackBox) else problem.dynamics.each["drift"][0]
    first = pieces * (AXIS * ndim + OPERATION * _operations(velocity))
    for part in problem.unsafe:
        alike = math.prod(axis.count for k, axis in enumerate(axes) if not own[k] and k not in part.axes)
        each = MOVING_CORNER * parts * times if part.moving else STILL_CORNER
        first += each * cells / alike * count * 2 ** len(part.axes)
        first += BOXED * BOXES_OF_A_SET * _operations(part.level_set)
    first += AT_ENDS * cells * count * starts if np.isfinite(problem.grid.faces("unsafe")).any() else 0.0
    widths, delta, counts = np.array([float(axis.width) for axis in axes]), problem.delta, [axis.count for axis in axes]
    image = np.minimum(2 + delta * (speeds.widths + speeds.wider @ widths) / widths, counts)[:-1].prod()
    near = np.minimum(2 + delta * np.ptp(speeds.extremes, axis=0) / widths, counts)[:-1].prod()
    return first, entries * cells * (ENTRY + IMAGE * float(image) + NEAR_ROW * float(near) / counts[-1])


def _operations(function: Any) -> int:
    """How many operations a formula takes for a point."""
    if isinstance(function, BlackBox):
        return BLACK_BOX
    operations = [one.op for one in ordered(function.outputs)]
    return len(operations) + LOOK_UP * operations.count("gridded")
