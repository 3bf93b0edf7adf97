"""How much room the proof of a robot of one's own takes: the shapes of its arrays, and bytes in all."""

import math
from collections.abc import Sequence

import numpy as np

from sdhj.certified.bounds import Bounds, known_sets
from sdhj.certified.cells import DRIFT, CellAxis
from sdhj.grid import FloatArray
from sdhj.problem import ReachAvoidProblem

BYTES_OF_A_BOX = 80  # on each axis, while the cells in a set are looked for: ends, copies, bounds
PLACES = 1 << 15  # whose tubes are in memory at once


def shapes(
    problem: ReachAvoidProblem, axes: tuple[CellAxis, ...], own: FloatArray
) -> tuple[FloatArray, tuple[int, ...], tuple[int, ...]]:
    """Strides, and the shapes of moves and of `clear`, where the axes `own` (ndim,) bool are those of a place."""
    counts, count, strides = np.array([axis.count for axis in axes]), len(problem.inputs), np.zeros(len(axes), np.int64)
    strides[own] = np.cumprod([1, *counts[own][:0:-1]])[::-1] if own.any() else 0
    timed = problem.steps if problem.dynamics.timed else 1
    times = problem.steps if any(part.moving for part in problem.unsafe) else timed
    return (
        strides,
        (timed, count, math.prod(counts[own].tolist()), len(axes)),
        (times, math.prod(counts.tolist()), -(-count // 8)),
    )


def peak(
    problem: ReachAvoidProblem, axes: tuple[CellAxis, ...], parts: int, moves: Sequence[int], clear: Sequence[int]
) -> int:
    """See `GeneralProof.peak`; moves and clear are shapes."""
    boxes = [math.prod(axes[k].count for k in part.axes) * len(part.axes) for part in known_sets(problem)]
    needed = 4 * math.prod(moves) + math.prod(clear) + 9 * math.prod(axis.count for axis in axes)
    return needed + 16 * PLACES * len(axes) * parts + BYTES_OF_A_BOX * max(boxes, default=0)


def place_axes(problem: ReachAvoidProblem, axes: tuple[CellAxis, ...], bounds: Bounds) -> FloatArray:
    """Which axes an image depends on, (ndim,) bool.

    Those that a velocity reads, those on which cells are not alike, and those with a wall that the state may come to
    and leave again within an interval.
    """
    own: FloatArray = np.logical_or.reduce(bounds.reads, axis=0)
    for place, axis in enumerate(axes):
        own[place] |= axis.periodic and abs(float(axis.count * axis.width - axis.extent[1])) > DRIFT
        own[place] |= not problem.dynamics.constant and "wall" in problem.grid.ends[place] and not axis.periodic
    return own
