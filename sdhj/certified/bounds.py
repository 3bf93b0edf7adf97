"""Bounds on a problem's own functions over boxes of states and intervals of time: what every proof rests on.

They are those of its formulas (`sdhj.kernels.bounds`), or what the author of a black box declares. Boxes are cut
where an axis ends and where a periodic one closes, so that functions are bounded only where the state can be, and may
jump there. Where a function may be undefined its bounds are infinite, so nothing is proved.
"""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from sdhj.common.remembering import FloatArray
from sdhj.formulas.formula import Ends
from sdhj.kernels.pieces import boxes_of_product, cut_boxes
from sdhj.problem.grid import Grid
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sets import TargetSet, UnsafeSet

BOXES = 1 << 16  # that a function is bounded over at a time
TILE = 64  # boxes that are bounded together first
MOST_HALVES = 1 << 20  # pieces that all boxes with an open sign are cut into
Bounded = Callable[[FloatArray, FloatArray], Ends]  # of boxes, both (M, axes), to bounds of a function there


@dataclass(frozen=True)
class Bounds:
    """Bounds on the velocity and on the level-set functions of a problem, over boxes of states and intervals of time.

    Only the part of a box that is on the grid counts. Bounds are infinite where a function may be undefined.
    """

    problem: ReachAvoidProblem

    def velocity(self, j: int, low: FloatArray, high: FloatArray, t0: float, t1: float) -> FloatArray:
        """The least and the greatest velocity under u_j in boxes (M, ndim) from time t0 to t1, s: (2, M, ndim)."""
        dynamics, grid = self.problem.dynamics, self.problem.grid
        return within_grid(grid, range(grid.ndim), low, high, lambda a, b: dynamics.velocity_bounds(j, a, b, (t0, t1)))

    def fastest(
        self, side: int, axis: int, j: int, low: FloatArray, high: FloatArray, t0: float, t1: float
    ) -> FloatArray:
        """The entry [side, :, axis] of `velocity`: (M,)."""
        dynamics, grid = self.problem.dynamics, self.problem.grid
        if not dynamics.formulas or dynamics.gain is None:
            return np.ascontiguousarray(self.velocity(j, low, high, t0, t1)[side, :, axis])
        # without the other components this is faster
        # of its results the first ndim are the least velocities, the others the greatest
        alone = dynamics.component("extremes", j, side * grid.ndim + axis)
        return within_grid(grid, range(grid.ndim), low, high, lambda a, b: alone.bounds(a, b, (t0, t1)))[side]

    def bounds_of_level_set(
        self, part: TargetSet | UnsafeSet, low: FloatArray, high: FloatArray, t0: float, t1: float, function: Any = None
    ) -> FloatArray:
        """Lower and upper bounds of a set's level-set function over boxes (M, axes) of its axes, t0 to t1: (2, M)."""
        bounded = (function or part.level_set).bounds_by_branch
        return within_grid(self.problem.grid, part.axes, low, high, lambda a, b: bounded(a, b, (t0, t1)))

    def signs(
        self,
        part: TargetSet | UnsafeSet,
        low: Sequence[FloatArray],
        high: Sequence[FloatArray],
        times: tuple[float, float],
        halvings: int = 0,
        asked: FloatArray | bool = True,
        function: Any = None,
    ) -> FloatArray:
        """The sign that a level-set function has in all of a box at all times: 1 where > 0, -1 where <= 0, else 0.

        int8 (n1, n2, ...), for the products of ascending intervals `low` to `high` along the set's axes. A box of open
        sign is cut in two along each axis, `halvings` times at most; one that is not `asked` has the sign of its tile.
        """
        level = partial(self.bounds_of_level_set, part, t0=times[0], t1=times[1], function=function)
        sizes, side = [ends.size for ends in low], max(int(TILE ** (1 / len(low))), 2)
        last = [np.append(ends[side - 1 :: side], ends[-1:])[: -(-ends.size // side)] for ends in high]
        # tiles of many boxes first, single boxes where these are open
        out = np.empty([ends.size for ends in last], np.int8)
        for at, lower, upper in _boxes_in_batches(np.arange(out.size), [ends[::side] for ends in low], last):
            out.ravel()[at] = _sign(level(lower, upper))
        # What holds of a tile holds of all its boxes.
        out = out[np.ix_(*[np.arange(n) // side for n in sizes])]
        left = np.flatnonzero((out == 0) & asked)
        for at, lower, upper in _boxes_in_batches(left, low, high):
            # Each batch may halve as much as its share of the open boxes.
            out.ravel()[at] = _sign_by_halving(level, lower, upper, halvings, MOST_HALVES * at.size // left.size)
        return out

    def outside(
        self,
        part: UnsafeSet,
        low: Sequence[FloatArray],
        high: Sequence[FloatArray],
        times: tuple[float, float],
        halvings: int = 0,
        asked: FloatArray | bool = True,
    ) -> FloatArray:
        """In which of the boxes of `signs` a set's level-set function is proved > 0 everywhere, at all times: bool."""
        out = np.ones([ends.size for ends in low], np.bool_) & asked
        # each is asked where all before it are > 0
        for one in part.level_set.operands_of_min:
            out &= self.signs(part, low, high, times, halvings, out, one) > 0
        return out

    def inside(
        self,
        part: TargetSet | UnsafeSet,
        low: FloatArray,
        high: FloatArray,
        times: tuple[float, float],
        halvings: int,
        most: int,
    ) -> FloatArray:
        """Whether a level-set function is proved <= 0 in all of each box (M, axes) and at all `times`, s: (M,).

        A box of open sign is cut in two along each axis, `halvings` times, to `most` pieces together; then it is False.
        """
        # for `Arrivals` alone; `box` has for each piece the number of the box that it is of
        out, box = np.ones(len(low), np.bool_), np.arange(len(low))
        for turn in range(halvings + 1 if len(low) else 0):
            middle = (low + high) / 2
            above = self.bounds_of_level_set(part, middle, middle, *times)[0] > 0.0
            out[box[above]] = False  # at once, without cutting
            above = self.bounds_of_level_set(part, low, high, *times)[1] > 0.0
            left = np.flatnonzero(out[box] & above)
            if not turn:  # most that stick out do so at a corner, which pieces would find late
                some = self._sticking_out(part, low[left], high[left], times)
                out[box[left[some]]], left = False, left[~some]
            box, low, high, middle = box[left], low[left], high[left], middle[left]
            if turn == halvings or not left.size or left.size << low.shape[1] > most:
                break
            for axis in range(low.shape[1]):
                beyond, short = low.copy(), high.copy()
                beyond[:, axis] = short[:, axis] = middle[:, axis]
                low, high = np.concatenate([low, beyond]), np.concatenate([short, high])
                box, middle = np.tile(box, 2), np.concatenate([middle, middle])
        out[box] = False
        return out

    def _sticking_out(
        self, part: TargetSet | UnsafeSet, low: FloatArray, high: FloatArray, times: tuple[float, float]
    ) -> FloatArray:
        """Whether a level-set function is proved > 0 at some corner of each box (M, axes), at all times: (M,)."""
        out = np.zeros(len(low), np.bool_)
        for upper in itertools.product((False, True), repeat=low.shape[1]):
            left = np.flatnonzero(~out)
            if left.size:
                corner = np.where(upper, high[left], low[left])
                # A corner surely outside shows that the box is not inside; without one the answer stays open.
                out[left] = self.bounds_of_level_set(part, corner, corner, *times)[0] > 0.0
        return out


def _sign_by_halving(
    level: Callable[[FloatArray, FloatArray], FloatArray], low: FloatArray, high: FloatArray, halvings: int, most: int
) -> FloatArray:
    """As `_sign` of `level` over boxes (M, axes), open ones cut on all axes `halvings` times, to `most` pieces."""
    if not halvings:
        return _sign(level(low, high))
    (above, below), box = np.zeros((2, len(low)), np.bool_), np.arange(len(low))  # some piece is > 0, is <= 0
    for turn in range(halvings + 1):
        sign = _sign(level(low, high))
        above[box[sign > 0]] = below[box[sign < 0]] = True
        left = (sign == 0) & ~(above & below)[box]
        box, low, high = box[left], low[left], high[left]
        if turn == halvings or not box.size or box.size << low.shape[1] > most:
            break
        for axis in range(low.shape[1]):
            middle = (low[:, axis] + high[:, axis]) / 2
            low, high, box = np.concatenate([low, low]), np.concatenate([high, high]), np.tile(box, 2)
            low[middle.size :, axis] = high[: middle.size, axis] = middle
    # 0 where pieces are left open, and where some are > 0 and some <= 0
    known = np.ones(above.size, np.bool_)
    known[box] = False
    return known * (above.astype(np.int8) - below)


def _sign(bounds: FloatArray) -> FloatArray:
    """The sign that bounds (2, M) prove: 1 where the least value is > 0, -1 where the greatest is <= 0, else 0."""
    return (bounds[0] > 0.0).astype(np.int8) - (bounds[1] <= 0.0)


def _boxes_in_batches(
    places: FloatArray, low: Sequence[FloatArray], high: Sequence[FloatArray]
) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
    """Yield (at, lower, upper) for runs of at most `BOXES` of the flat numbers `places` (n,), one after the other."""
    sizes = np.array([ends.size for ends in low])
    # Padded to the most intervals of an axis, as `boxes_of_product` takes one array.
    padded = np.zeros((2, len(low), sizes.max()))
    for side, k in np.ndindex(2, len(low)):
        padded[side, k, : sizes[k]] = (low, high)[side][k]
    for begin in range(0, places.size, BOXES):
        at = places[begin : begin + BOXES]
        boxes_of_product(at, padded, sizes, boxes := np.empty((2, at.size, len(low))))
        yield at, boxes[0], boxes[1]


def within_grid(grid: Grid, axes: Sequence[int], low: FloatArray, high: FloatArray, bounded: Bounded) -> FloatArray:
    """The least and the greatest values of a function over the parts of boxes (M, axes) on the grid: (2, M, ...)."""
    own, out = list(axes), np.empty((2, len(low), 0))
    ends, periodic = np.array([grid.lower, grid.upper]).take(own, axis=1), np.array(grid.periodic)[own]
    for begin in range(0, len(low), BOXES):
        some = [np.ascontiguousarray(end[begin : begin + BOXES]) for end in (low, high)]
        size, many = len(some[0]), len(some[0]) << int(periodic.sum())
        cut, rows = np.empty((2, many, len(own))), np.empty(many, np.int64)
        count = cut_boxes(*some, ends, periodic, cut, rows)
        found: Any = [np.asarray(end) for end in bounded(*cut[:, :count])]
        if count > size:
            # `cut_boxes` writes the pieces of a box one after the other, on which `reduceat` rests
            first = np.flatnonzero(np.diff(rows[:count], prepend=-1))
            found = np.minimum.reduceat(found[0], first), np.maximum.reduceat(found[1], first)
        # Only now it is known what shape values of the function have.
        out = out if begin else np.empty((2, len(low), *found[0].shape[1:]))
        out[0, begin : begin + size], out[1, begin : begin + size] = found
    return out
