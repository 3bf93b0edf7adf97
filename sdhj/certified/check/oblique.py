"""Lines: what a file says of images that are no boxes, derived anew.

Of each row of cells in a move's box, on the axes that a normal has a part along but the last, a line says which cells
along the last axis an image may hold. An image lies between planes: on axes that no velocity depends on, everything
from a cell moves by an integral of velocities, along a normal n by at most that of the greatest n . f, whatever the
adversary does meanwhile. The normals are the file's: any will do. How far the planes are is bounded here.
"""

from collections.abc import Iterator, Mapping
from itertools import pairwise, product
from typing import Any

import numpy as np

from sdhj.certified.check.bits import Array
from sdhj.certified.check.described import Times, Velocity
from sdhj.certified.check.files import Arrays
from sdhj.certified.check.reading import MOST_COUNTED, array, expect, is_whole, reals

MOST_NORMALS = 64
SHORTEST = 1e-100  # normal: products with it are numbers whose rounding is relative
MOST_CUT = 4096  # pieces of the adversary's box
ROUNDED = 1e-15  # of the terms that are added up


def spread(normals: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """The least and the greatest n . x over boxes from low to high, for K normals n: both (M, K), rounded outward.

    normals : (K, ndim). low, high (M, ndim) : a bound is NaN where an end is that it rests on.
    """
    out = np.zeros((2, len(low), len(normals)))
    for k, normal in enumerate(normals):
        for axis in np.flatnonzero(normal):
            ends = normal[axis] * np.stack([low[:, axis], high[:, axis]])
            more = ROUNDED * np.abs(ends).max(axis=0)
            out[0, :, k] += ends.min(axis=0) - more  # check 3.72
            out[1, :, k] += ends.max(axis=0) + more  # check 3.73
    return out[0], out[1]


def rates_along(
    velocity: Velocity, normals: Array, inputs: Array, low: Array, high: Array, times: Times, cuts: int
) -> tuple[Array, Array]:
    """The least and the greatest n . f under inputs and any adversary over boxes: both (M, K), rounded outward.

    f is the velocity, n one of K normals; the bounds hold for all `times`, s to s.

    velocity : the robot's. normals : (K, ndim). inputs (M,) : their indices. low, high : the boxes, (M, ndim).
    cuts : into how many pieces the range of each component of v is cut, at most, where the velocity is not drift + gain
        v; fewer where all pieces together would be more than `MOST_CUT`.
    """
    half = np.maximum(*map(np.abs, velocity.of["bounds"].bounds(inputs, low, high, times)))
    if velocity.linear:
        least, most = spread(normals, *velocity.of["drift"].bounds(inputs, low, high, times))
        shape = -1, velocity.ndim, velocity.disturbance_dim
        gain = [end.reshape(shape) for end in velocity.of["gain"].bounds(inputs, low, high, times)]
        for d in range(velocity.disturbance_dim):
            far = np.maximum(*map(np.abs, spread(normals, gain[0][:, :, d], gain[1][:, :, d])))
            push = far * half[:, d, None] * (1 + ROUNDED)
            least, most = least - push, most + push  # check 3.52
        return least, most
    half = np.broadcast_to(half, (len(low), velocity.disturbance_dim))
    each = max(min(cuts, int(MOST_CUT ** (1 / max(velocity.disturbance_dim, 1)))), 1)
    least, most = np.full((len(low), len(normals)), np.inf), np.full((len(low), len(normals)), -np.inf)
    for at in product(range(each), repeat=velocity.disturbance_dim):
        shares = [(2 * i / each - 1, 2 * (i + 1) / each - 1) for i in at]
        pieces = [(a * one, b * one) for (a, b), one in zip(shares, half.T, strict=True)]
        a, b = spread(normals, *velocity.of["velocity"].bounds(inputs, low, high, times, *pieces))
        least, most = np.minimum(least, a), np.maximum(most, b)  # check 3.74
    return least, most


class Lines:
    """The lines that a file states, and the normals of their planes (see the module).

    each : (starts, L, places, rows, 2) int16, the first and the last cell along the last axis, less the cell's own
        index.
    normals : (K, ndim).
    halo : (2, ndim) int, how many cells there have to be between a cell and the lower, and the upper, end of each axis
        for it to have lines; see `far_from_ends`.
    oblique : (ndim,) bool, the axes that a normal has a part along; leading : the numbers of these axes, but the last
        axis, over which rows are counted.
    """

    def __init__(self, robot: Any, stated: Mapping[str, Any], arrays: Arrays) -> None:
        """Read the lines; ValueError where they do not fit the robot's moves.

        robot : the `Robot`, whose moves `low` and `high` are read already. stated : the proof's part of the head.
            arrays : the open file.
        """
        ndim = robot.grid.ndim
        given, halo = stated["normals"], stated["halo"]
        fits = isinstance(given, list) and 0 < len(given) <= MOST_NORMALS  # check 7.50
        expect(fits, f"normals must be 1 to {MOST_NORMALS}", given)
        self.normals = np.array([reals("normals", one, ndim) for one in given])
        # check 7.52
        expect(bool((np.abs(self.normals).max(axis=1) >= SHORTEST).all()), f"normals must be {SHORTEST:g} long", given)
        self.oblique: Any = self.normals.any(axis=0)
        # check 7.51
        expect(not (self.oblique & robot.known).any(), "normals must be along axes that cells move alike on", given)
        # check 7.53
        expect(not robot.sensing, "images of what is measured must be boxes", robot.sensing.error)
        fits = isinstance(halo, list) and len(halo) == 2 and all(len(one) == ndim for one in halo)
        fits = fits and all(is_whole(one, 0, MOST_COUNTED**3) for side in halo for one in side)
        expect(fits, "halo must be whole numbers for both ends of each axis", halo)
        self.halo, self.width = np.array(halo), np.array([float(width) for _, width, *_ in robot.axes])
        self.bounded, self.scale, self.near = self.oblique & ~robot.periodic, robot.scale, 2 * robot.near
        self.leading = np.flatnonzero(np.array(self.oblique)[:-1])
        numbers = robot.high[..., self.leading].astype(np.int64) - robot.low[..., self.leading] + 1
        laps = ~robot.periodic[self.leading] | (numbers <= robot.counts[self.leading])
        # check 7.54
        expect(bool(laps.all()), "moves that are lines must be less than once around", numbers.tolist())
        rows = int(numbers.prod(axis=-1).max())
        self.each = array(arrays, "lines", np.int16, *robot.low.shape[:3], rows, 2)

    def far_from_ends(self, cells: Array, counts: Array) -> Array:
        """Which cells (M, ndim) have lines, because they are as far from all ends as `halo` says: (M,) bool.

        counts (ndim,) : the numbers of cells along each axis.
        """
        # check 3.75
        return np.all((cells >= self.halo[0]) & (cells < counts - self.halo[1]), axis=1)

    def rows(self, low: Array, high: Array) -> Iterator[tuple[int, Array, Array]]:
        """Yield the rows of boxes of cells: (number, at, there).

        low, high (M, ndim) : the first and the last cell of each box, included.

        number : of the row, over the leading axes, as in `each`.
        at (M, ndim) : the cell at which the row stands, of which only the leading axes count.
        there (M,) : bool, which boxes have a row of that number.
        """
        numbers = (high - low + 1)[:, self.leading]
        for row in range(self.each.shape[3]):
            at, rest = low.copy(), np.full(len(low), row)
            for place in range(len(self.leading) - 1, -1, -1):
                at[:, self.leading[place]] += rest % numbers[:, place]
                rest //= numbers[:, place]
            yield row, at, rest == 0

    def changes(
        self, robot: Any, boxes: Array, inputs: Array, swept: Array, start: float, cuts: int
    ) -> tuple[Array, Array]:
        """By how much n . x changes at least and at most in an interval, for each normal n: both (M, K).

        For all states of boxes (2, M, ndim), and rounded outward.

        robot : the `Robot`. inputs (M,) : the indices of the inputs that act.
        swept (M, parts, 2, ndim) : how far the ends of the boxes move in each part.
        start : when the interval begins, s. cuts : into how many pieces the range of each component of the adversary's
            v is cut, at most, where the velocity is not drift + gain v.
        """
        out = np.zeros((2, boxes.shape[1], len(self.normals)))
        times = [start + robot.length * part / robot.parts for part in range(robot.parts + 1)]
        for part, when in enumerate(pairwise(times)):
            box = boxes + robot.known * np.moveaxis(swept[:, part], 1, 0)  # check 3.69

            def bounds(low: Array, high: Array, of: Array, when: Times = when) -> tuple[Array, Array]:
                """The least and the greatest n . f over boxes (m, ndim): both (m, K).

                of (m,) : the row of `boxes` that each is a piece of. when : the times of this turn of the loop.
                """
                return rates_along(robot.moves, self.normals, inputs[of], low, high, when, cuts)  # check 3.71

            # what it takes is no difference of times, which are rounded as late as they are
            # check 3.70
            found = np.stack(robot.cut(range(robot.grid.ndim), box, bounds)) * (robot.length / robot.parts)
            out += found + ROUNDED * np.array([[[-1.0]], [[1.0]]]) * (np.abs(found) + np.abs(out))
        return out[0], out[1]

    def hold(self, robot: Any, boxes: Array, places: Array, start: int, j: Array, swept: Array, cuts: int) -> Array:
        """Whether the lines hold all that lies between the planes, and `halo` is wide enough: (M,) bool.

        For M pairs of a place and an input: every cell of the image that is between all planes has to be on a line, and
        nothing gets farther beyond a cell than `halo`.

        robot : the `Robot`. boxes (2, M, ndim) : of the cells at the places.
        places, j (M,) : the places and the inputs. start : the index of the interval in the robot's `low` and `high`.
        swept (M, parts, 2, ndim) : how far the ends of the boxes move in each part.
        cuts : into how many pieces the range of each component of the adversary's v is cut, at most.
        """
        low, high = (moves[start, j, places].astype(np.int64) for moves in (robot.low, robot.high))
        back, ahead = self.near - swept[:, :, 0].min(axis=1), self.near + swept[:, :, 1].max(axis=1)
        # check 3.57
        fits = np.all(~self.bounded | ((back <= self.halo[0] * self.width) & (-low <= self.halo[0])), axis=1)
        # check 3.58
        fits &= np.all(~self.bounded | ((ahead <= (self.halo[1] - 1) * self.width) & (high <= self.halo[1])), axis=1)
        least, most = self.changes(robot, boxes, j, swept, robot.time(start), cuts)
        sticks, width, n = robot.sticks * self.scale, self.width, self.normals
        first, past = low[:, -1] * width[-1] - sticks[-1], (high[:, -1] + 1) * width[-1] + sticks[-1]
        for row, at, there in self.rows(low, high):
            begin, end, empty = first.copy(), past.copy(), np.zeros(len(places), np.bool_)
            a = (at * width - np.where(at == low, sticks, 0.0))[:, self.leading]
            b = ((at + 1) * width + np.where(at == high, sticks, 0.0))[:, self.leading]
            for k, way in product(range(len(n)), (-1.0, 1.0)):
                slope = way * n[k]
                slack = most[:, k] if way > 0 else -least[:, k]
                slack = slack + np.maximum(slope * width, 0.0).sum()  # of the cell itself  # check 3.61
                terms = np.stack([slope[self.leading] * a, slope[self.leading] * b])
                slack += 4 * ROUNDED * (np.abs(slack) + np.abs(terms).max(axis=0).sum(axis=1))
                slack -= terms.min(axis=0).sum(axis=1)  # check 3.62
                if slope[-1] > 0:
                    end = np.minimum(end, slack / slope[-1])
                elif slope[-1] < 0:
                    begin = np.maximum(begin, slack / slope[-1])
                else:
                    empty |= slack < 0
            lines = self.each[start, j, places, row].astype(np.int64)
            # check 3.63
            good = (lines[:, 0] * width[-1] <= begin + sticks[-1]) | (lines[:, 0] <= low[:, -1])
            # check 3.64
            good &= (end <= (lines[:, 1] + 1) * width[-1] + sticks[-1]) | (lines[:, 1] >= high[:, -1])
            fits &= good | empty | (end < begin) | ~there
        return fits

    def inside(self, robot: Any, cells: Array, start: int, j: int, sums: Array) -> Array:
        """Whether all cells on the lines of cells (M, ndim) under u_j are in a set: (M,) bool.

        All of the cells must be `far_from_ends`. A line whose last cell is before its first is empty.

        robot : the `Robot`. start : the index of the interval in its `low` and `high`. sums : what `Robot.sums` returns
            for the set.
        """
        places, out = cells @ robot.strides, np.ones(len(cells), np.bool_)
        low, high = (moves[start, j, places].astype(np.int64) for moves in (robot.low, robot.high))
        for row, at, there in self.rows(low, high):
            lines = self.each[start, j, places, row].astype(np.int64)
            left = np.flatnonzero(out & there & (lines[:, 0] <= lines[:, 1]))
            one, other = at[left], np.where(self.oblique, at[left], high[left])
            one[:, -1], other[:, -1] = lines[left].T
            out[left] = robot.box_inside(cells[left] + one, cells[left] + other, sums)  # check 3.76
        return out
