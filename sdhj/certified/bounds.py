"""Bounds on a problem's own functions over boxes of states and intervals of time: what every proof rests on.

They are those of its formulas (`sdhj.kernels.intervals`), or what the author of a black box declares. Boxes are cut
where an axis ends and where a periodic one closes, so that functions are bounded only where the state can be, and may
jump there. Where a function may be undefined its bounds are infinite, so nothing is proved.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sdhj.formulas.formula import Ends
from sdhj.kernels import FloatArray
from sdhj.kernels.pieces import cut_boxes
from sdhj.problem.grid import Grid
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sets import TargetSet, UnsafeSet

BOXES = 1 << 16  # that a function is bounded over at a time
TILE = 64  # boxes that are bounded together first
MOST_HALVES = 1 << 20  # pieces that all boxes with an open sign are cut into
Bounded = Callable[[FloatArray, FloatArray], Ends]  # of boxes, both (M, axes), to bounds of a function there


def known_sets(problem: ReachAvoidProblem) -> list[TargetSet | UnsafeSet]:
    """The target, if there is one, and the unsafe sets."""
    return [*([] if problem.has_no_target else [problem.target]), *problem.unsafe]


@dataclass(frozen=True)
class Bounds:
    """Bounds on the velocity and the level sets of a problem.

    vertices (V, D) : of its box, to which the adversary keeps; u_j under vertex v is the input j * V + v. None: any.
    """

    problem: ReachAvoidProblem
    vertices: FloatArray | None = None

    def input(self, j: int) -> int:
        """The number of the problem's input that u_j applies: j itself or, with vertices, j // V."""
        return j if self.vertices is None else j // len(self.vertices)

    def velocity(self, j: int, low: FloatArray, high: FloatArray, t0: float, t1: float) -> FloatArray:
        """Least and greatest velocity under u_j in boxes (M, ndim) and [t0, t1]: (2, M, ndim)."""
        dynamics, grid = self.problem.dynamics, self.problem.grid
        signs = None if self.vertices is None else self.vertices[j % len(self.vertices)]
        j = self.input(j)
        # obligation 2.22
        return within_grid(grid, range(grid.ndim), low, high, lambda a, b: dynamics.range(j, a, b, (t0, t1), signs))

    def fastest(
        self, side: int, axis: int, j: int, low: FloatArray, high: FloatArray, t0: float, t1: float
    ) -> FloatArray:
        """The least (side 0) or greatest (1) velocity along one axis under u_j in boxes (M, ndim) and [t0, t1]: (M,).

        Where it can be, without the other components, which is faster than `velocity`.
        """
        dynamics, grid = self.problem.dynamics, self.problem.grid
        if not dynamics.formulas or dynamics.gain is None or self.vertices is not None:
            return np.ascontiguousarray(self.velocity(j, low, high, t0, t1)[side, :, axis])
        alone = dynamics.component("extremes", j, side * grid.ndim + axis)
        return within_grid(grid, range(grid.ndim), low, high, lambda a, b: alone.bounds(a, b, (t0, t1)))[side]

    def level(self, part: TargetSet | UnsafeSet, low: FloatArray, high: FloatArray, t0: float, t1: float) -> FloatArray:
        """Least and greatest value of a set's function in boxes of its axes (M, axes) and in [t0, t1]: (2, M)."""
        return self._level(part.axes, part.level_set, low, high, t0, t1)

    def _level(
        self, axes: Sequence[int], function: Any, low: FloatArray, high: FloatArray, t0: float, t1: float
    ) -> FloatArray:
        """Least and greatest value of a function of some axes in boxes (M, axes) and in [t0, t1]: (2, M)."""
        return within_grid(self.problem.grid, axes, low, high, lambda a, b: function.bounds_by_branch(a, b, (t0, t1)))

    def signs(
        self,
        part: TargetSet | UnsafeSet,
        low: Sequence[FloatArray],
        high: Sequence[FloatArray],
        times: tuple[float, float],
        halvings: int = 0,
    ) -> FloatArray:
        """1 where a level set is > 0 in all of a box and at all times, -1 where it is <= 0, and 0 elsewhere: int8.

        low, high : some intervals of each axis, in ascending order; all their products are boxes, and the shape is that
            of their numbers. Tiles of many boxes are bounded first, and each box only where that leaves the sign open.
        halvings : how often a box is cut in two along each axis while that may tell more.
        """
        return self._signs(part.axes, part.level_set, low, high, times, halvings)

    def outside(
        self,
        part: UnsafeSet,
        low: Sequence[FloatArray],
        high: Sequence[FloatArray],
        times: tuple[float, float],
        halvings: int = 0,
        asked: FloatArray | bool = True,
    ) -> FloatArray:
        """In which boxes, of those `asked` for, a set's function is > 0 everywhere and at all times: bool.

        low, high, times, halvings : as of `signs`.
        Functions of which it is the least are asked one by one, each only where all before it are > 0.
        """
        out = np.ones([ends.size for ends in low], np.bool_) & asked
        for one in part.level_set.least_of:  # obligation 4.48
            out &= self._signs(part.axes, one, low, high, times, halvings, out) > 0
        return out

    def _signs(
        self,
        axes: Sequence[int],
        function: Any,
        low: Sequence[FloatArray],
        high: Sequence[FloatArray],
        times: tuple[float, float],
        halvings: int,
        asked: FloatArray | bool = True,
    ) -> FloatArray:
        """1 where a function of some axes is > 0 in all of a box and at all times, -1 where it is <= 0, else 0: int8.

        The arguments are those of `signs`. asked : boxes that are bounded themselves; others have the sign of their
        tile.
        """
        sizes, side = [ends.size for ends in low], max(int(TILE ** (1 / len(low))), 2)
        first = [ends[::side] for ends in low]
        # obligation 4.26
        last = [np.append(ends[side - 1 :: side], ends[-1:])[: -(-ends.size // side)] for ends in high]
        out = np.empty([ends.size for ends in first], np.int8)
        for at in _some(np.arange(out.size)):
            there = np.unravel_index(at, out.shape)
            out.ravel()[at] = _sign(self._level(axes, function, picked(first, there), picked(last, there), *times))
        out = out[np.ix_(*[np.arange(n) // side for n in sizes])]
        left = np.flatnonzero((out == 0) & asked)
        for at in _some(left):
            there = np.unravel_index(at, sizes)
            most = MOST_HALVES * at.size // left.size
            ends = picked(low, there), picked(high, there)
            out.ravel()[at] = self._halved(axes, function, *ends, times, halvings, most)
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
        """Whether a level-set function is surely <= 0 in all of boxes (M, axes) and at all times: (M,) bool.

        Boxes for which that is open are cut in two along each axis, `halvings` times and into `most` pieces in all at
        most; what is open then is False.
        """
        out, box = np.ones(len(low), np.bool_), np.arange(len(low))
        for turn in range(halvings + 1 if len(low) else 0):
            middle = (low + high) / 2
            out[box[self.level(part, middle, middle, *times)[0] > 0.0]] = False  # at once, without cutting
            left = np.flatnonzero(out[box] & (self.level(part, low, high, *times)[1] > 0.0))  # obligation 9.12
            box, low, high, middle = box[left], low[left], high[left], middle[left]
            if turn == halvings or not left.size or left.size << low.shape[1] > most:
                break
            for axis in range(low.shape[1]):
                beyond, short = low.copy(), high.copy()
                beyond[:, axis] = short[:, axis] = middle[:, axis]
                low, high = np.concatenate([low, beyond]), np.concatenate([short, high])  # obligation 9.13
                box, middle = np.tile(box, 2), np.concatenate([middle, middle])
        out[box] = False  # obligation 9.14
        return out

    def _halved(
        self,
        axes: Sequence[int],
        function: Any,
        low: FloatArray,
        high: FloatArray,
        times: tuple[float, float],
        halvings: int,
        most: int,
    ) -> FloatArray:
        """1 where a function is > 0 in all of a box and at all times, -1 where it is <= 0, else 0: (M,) int8.

        Boxes (M, axes) for which that is open are cut in two along each axis, `halvings` times and into `most` pieces
        in all at most.
        """
        (above, below), box = np.zeros((2, len(low)), np.bool_), np.arange(len(low))  # some piece is > 0, is <= 0
        for turn in range(halvings + 1):
            sign = _sign(self._level(axes, function, low, high, *times))
            above[box[sign > 0]] = below[box[sign < 0]] = True
            left = (sign == 0) & ~(above & below)[box]
            box, low, high = box[left], low[left], high[left]
            if turn == halvings or not box.size or box.size << low.shape[1] > most:
                break
            for axis in range(low.shape[1]):
                middle = (low[:, axis] + high[:, axis]) / 2
                low, high, box = np.concatenate([low, low]), np.concatenate([high, high]), np.tile(box, 2)
                low[middle.size :, axis] = high[: middle.size, axis] = middle
        known = np.ones(above.size, np.bool_)
        known[box] = False  # obligation 9.2
        return known * (above.astype(np.int8) - below)


def _sign(bounds: FloatArray) -> FloatArray:
    """1 where the least of the values (2, M) is > 0, -1 where the greatest is <= 0, else 0."""
    return (bounds[0] > 0.0).astype(np.int8) - (bounds[1] <= 0.0)


def _some(places: FloatArray) -> Iterator[FloatArray]:
    """The places (n,), one run of at most `BOXES` of them after the other."""
    return (places[at : at + BOXES] for at in range(0, places.size, BOXES))


def picked(ends: Sequence[FloatArray], at: Sequence[FloatArray]) -> FloatArray:
    """The points whose coordinate on axis i is ends[i][at[i]]: (M, axes)."""
    return np.stack([own[places] for own, places in zip(ends, at, strict=True)], axis=1)


def within_grid(grid: Grid, axes: Sequence[int], low: FloatArray, high: FloatArray, bounded: Bounded) -> FloatArray:
    """Least and greatest values (2, M, ...) of a function over boxes (M, axes), where they are on the grid.

    They are cut at the ends of their axes and where a periodic one closes, and `bounded` is asked about the pieces.
    axes : of the grid, those of the boxes.
    """
    own, out = list(axes), np.empty((2, len(low), 0))
    ends, periodic = np.array([grid.lower, grid.upper]).take(own, axis=1), np.array(grid.periodic)[own]
    for begin in range(0, len(low), BOXES):
        some = [np.ascontiguousarray(end[begin : begin + BOXES]) for end in (low, high)]
        size, many = len(some[0]), len(some[0]) << int(periodic.sum())
        cut, rows = np.empty((2, many, len(own))), np.empty(many, np.int64)
        count = cut_boxes(*some, ends, periodic, cut, rows)
        found: Any = [np.asarray(end) for end in bounded(*cut[:, :count])]
        if count > size:
            first = np.searchsorted(rows[:count], np.arange(size))
            found = np.minimum.reduceat(found[0], first), np.maximum.reduceat(found[1], first)  # obligation 4.37
        out = out if begin else np.empty((2, len(low), *found[0].shape[1:]))
        out[0, begin : begin + size], out[1, begin : begin + size] = found
    return out
