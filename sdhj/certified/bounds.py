"""Bounds on a problem's own functions over boxes of states and intervals of time: what every proof rests on.

They are those of its formulas (`sdhj.kernels.intervals`), or what the author of a black box declares. Boxes are cut
where an axis ends and where a periodic one closes, so that functions are bounded only where the state can be, and may
jump there. Where a function may be undefined its bounds are infinite, so nothing is proved.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sdhj.formulas.formula import Ends
from sdhj.kernels import FloatArray
from sdhj.problem.grid import Grid
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sets import TargetSet, UnsafeSet

BOXES = 1 << 16  # that a function is bounded over at a time


def known_sets(problem: ReachAvoidProblem) -> list[TargetSet | UnsafeSet]:
    """The target, if there is one, and the unsafe sets."""
    return [*([] if problem.stays else [problem.target]), *problem.unsafe]


@dataclass(frozen=True)
class Bounds:
    """Bounds on the velocity and the level sets of a problem.

    signs (D,) : the one vertex of its box that the adversary keeps to; None: any adversary.
    """

    problem: ReachAvoidProblem
    signs: FloatArray | None = None

    def velocity(self, j: int, low: FloatArray, high: FloatArray, t0: float, t1: float) -> Ends:
        """Least and greatest velocity under u_j, any adversary, in boxes (M, ndim) and [t0, t1]: both (M, ndim)."""
        dynamics, grid = self.problem.dynamics, self.problem.grid
        return _within(grid, range(grid.ndim), low, high, lambda a, b: dynamics.range(j, a, b, (t0, t1), self.signs))

    def level(self, part: TargetSet | UnsafeSet, low: FloatArray, high: FloatArray, t0: float, t1: float) -> Ends:
        """Least and greatest value of a level set in boxes of its axes (M, axes) and in [t0, t1]: both (M,)."""
        return _within(self.problem.grid, part.axes, low, high, lambda a, b: part.level_set.bounds(a, b, (t0, t1)))

    @property
    def reads(self) -> FloatArray:
        """Whether the velocity along axis i depends on coordinate k: (ndim, ndim) bool."""
        return self.problem.dynamics.reads


def _within(
    grid: Grid,
    axes: Sequence[int],
    low: FloatArray,
    high: FloatArray,
    bounded: Callable[[FloatArray, FloatArray], Ends],
) -> Ends:
    """Bounds over boxes (M, axes), which are cut at the ends of their axes and where a periodic one closes."""
    rows, low, high = np.arange(len(low)), low.copy(), high.copy()
    for column, axis in enumerate(axes):
        lower, upper = grid.lower[axis], grid.upper[axis]
        if not grid.periodic[axis]:
            low[:, column], high[:, column] = (np.clip(end[:, column], lower, upper) for end in (low, high))
            continue
        period = upper - lower
        laps, whole = np.floor((low[:, column] - lower) / period), high[:, column] - low[:, column] >= period
        low[:, column] = np.where(whole, lower, np.maximum(low[:, column] - laps * period, lower))
        high[:, column] = np.where(whole, upper, high[:, column] - laps * period)
        over = np.flatnonzero(high[:, column] > upper)
        rows, beyond = np.concatenate([rows, rows[over]]), high[over]
        low, high = (
            np.concatenate([low, low[over]]),
            np.concatenate([np.minimum(high, _room(high, column, upper)), beyond]),
        )
        low[len(low) - over.size :, column] = lower
        high[len(high) - over.size :, column] -= period
    slabs = (slice(begin, begin + BOXES) for begin in range(0, len(rows), BOXES))
    answers = [bounded(low[at], high[at]) for at in slabs]
    least, most = (np.concatenate([np.array(answer[side]) for answer in answers]) for side in (0, 1))
    count = int(rows.max(initial=-1)) + 1
    np.minimum.at(least, rows[count:], least[count:].copy())
    np.maximum.at(most, rows[count:], most[count:].copy())
    return least[:count], most[:count]


def _room(high: FloatArray, column: int, upper: float) -> FloatArray:
    """No bound but on one column."""
    out = np.full(high.shape[1], np.inf)
    out[column] = upper
    return out
