"""Where unsafe sets may be met: boxes on the axes that a set depends on, counted."""

import math
from collections.abc import Sequence

import numpy as np

from sdhj.certified.bounds import Bounds
from sdhj.certified.cells import CellAxis
from sdhj.certified.stencils import Boxes
from sdhj.problem import UnsafeSet

NARROW = 1e-10  # what a tube may stick out of the boxes that it is looked up in
MARGIN_OF_BOXES = 4e-10  # by so much are those boxes wider: NARROW, STATE_SLACK and room for rounding
BOXES_OF_A_SET = 1_000_000  # in which a level set is asked for, at all times together
PIECES_OF_A_CELL = 16  # on each axis, at most


def lattice_of(
    bounds: Bounds, axes: Sequence[CellAxis], part: UnsafeSet, times: Sequence[tuple[float, float]], steps: int
) -> Boxes:
    """The boxes that may meet an unsafe set in each of some times, counted; for how many steps it is asked."""
    own = [axes[axis] for axis in part.axes]
    room = BOXES_OF_A_SET / (len(times) * steps * math.prod(axis.count for axis in own))
    fine = min(max(int(room ** (1 / len(own))), 1), PIECES_OF_A_CELL)
    pitch = np.array([float(axis.width) / fine for axis in own])
    sizes = np.array([axis.count * fine for axis in own])
    lower = np.array([float(axis.lower) for axis in own])
    length = np.array([float(sum(axis.extent) / 2) for axis in own])
    periodic = np.array([axis.periodic for axis in own])
    corner = lower + pitch * np.stack([one.ravel() for one in np.indices(sizes.tolist())], axis=1)
    sums = []
    for t0, t1 in times:
        least, _ = bounds.level(part, corner - MARGIN_OF_BOXES, corner + pitch + MARGIN_OF_BOXES, t0, t1)
        meets = ~(least > 0.0).reshape(sizes)
        for k in np.flatnonzero(periodic).tolist():
            meets = np.concatenate([meets, meets], axis=k)
        counted = np.pad(meets, [(1, 0)] * len(own)).astype(np.int32)
        for k in range(len(own)):
            np.cumsum(counted, axis=k, out=counted)
        sums.append(counted.ravel())
    laps = sizes * np.where(periodic, 2, 1)
    return Boxes(np.array(part.axes), laps, lower, pitch, length, periodic, np.stack(sums))
