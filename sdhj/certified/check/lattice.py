"""Boxes that may meet an unsafe set, counted: whether a tube is clear of the set takes equally long anywhere.

A lattice is the cells of the set's axes, cut into pieces. Each of its boxes is bounded once, for all inputs: blocks of
many boxes first, and what is in a block only where it is open whether all of that is outside the set or in it. A tube
is clear where it overlaps no box that may meet the set, and how many of these it overlaps is a sum of counts at the
corners of what it overlaps.

Most tubes stick out of their cells to both sides, by what the adversary moves a state meanwhile. So boxes are bounded
`wider`, and tubes are looked up without as much: what is in a tube is that near to a box that is looked up. Along an
axis on which all inputs lead alike, as along those of a pursuer, all of that is in the boxes: these are whole cells,
and a tube overlaps that of its own cell alone.

Where tubes go along with their cells the boxes are not counted, but united (`windows`).
"""

import math
from collections.abc import Callable, Sequence

import numpy as np

from sdhj.certified.check.bits import Array, packed, unpacked
from sdhj.certified.check.counts import sums

MOST_LATTICE = 1 << 21  # boxes that cells are cut into, at all times together
MOST_KEPT = 1 << 28  # boxes; for more cells at all times together there is no lattice
MOST_CUTS = 16  # of a cell, along each axis
MOST_UNITED = 1 << 22  # likewise, where boxes are united; but
LEAST_UNITED = 2  # pieces of a cell, along each axis on which inputs move it
BLOCKS = (16, 4, 2, 1)  # boxes along each axis that are bounded together
AT_ONCE = 1 << 14  # boxes, or tubes
OPEN, OUTSIDE, MET = range(3)
OUTWARD = np.array([-1.0, 1.0])[:, None]

# of boxes (2, M, axes), and at which of several times (M,) each, to where it holds, and where it nowhere does
HoldsAt = Callable[[Array, Array], tuple[Array, Array]]


def pieces_of(counts: Sequence[int], times: int) -> int:
    """Into how many pieces to cut a cell along each axis, 1 to `MOST_CUTS`; 0: there are too many cells for a lattice.

    So that at most `MOST_LATTICE` boxes are made at all times together, unless the cells alone are more.

    counts : the numbers of cells on the set's axes. times : how many intervals of time have counts of their own.
    """
    cells = max(math.prod(counts) * times, 1)
    return 0 if cells > MOST_KEPT else min(max(int((MOST_LATTICE / cells) ** (1 / max(len(counts), 1))), 1), MOST_CUTS)


def pieces_united(counts: Sequence[int], alike: Array, times: int) -> Array:
    """Into how many pieces to cut a cell along each axis where boxes are united: (d,) int, 1 where `alike`.

    Else `LEAST_UNITED` to `MOST_CUTS`, so that about `MOST_UNITED` boxes are made at all times together; more where
    even the least are more.

    counts : the numbers of cells on the set's d axes. alike (d,) : bool, along which all inputs lead alike.
    times : how many intervals of time have boxes of their own.
    """
    cells, some = math.prod(counts) * times, max(int((~alike).sum()), 1)
    pieces = int((MOST_UNITED / max(cells, 1)) ** (1 / some))
    return np.where(alike, 1, min(max(pieces, LEAST_UNITED), MOST_CUTS))


def memory(counts: Sequence[int], laps: int, times: int, parts: int) -> int:
    """The bytes that the lattice of a set takes, with the counts for so many times and what the last ones are made of.

    counts : the numbers of cells on the set's axes. laps : how many of these axes are periodic. times : how many
        intervals of time have counts of their own. parts : of how many of these boxes are looked at together.
    """
    boxes = math.prod(counts) * pieces_of(counts, times) ** len(counts)
    return boxes * ((4 * times << laps) + (2 << laps) + 4 * parts)


class Lattice:
    """Boxes on a set's axes, the cells there cut into pieces, and which of them a tube overlaps.

    edges : for each axis the ends of the boxes, (boxes + 1,), ascending. shape (axes,) : the numbers of boxes.
    wider (2, axes) : how far boxes are moved outward, below and above, when the set's function is bounded in them.
    without (axes,) : how much tubes are moved inward at both ends before they are looked up; less than `wider`.
    alike (axes,) : bool, axes along which a tube overlaps the box of its own cell alone.
    """

    def __init__(
        self,
        edges: list[Array],
        pieces: int | Array,
        periodic: Array,
        near: Array,
        sway: Array,
        alike: Array | None = None,
        tubes: Array | None = None,
    ) -> None:
        """Cut the cells into pieces of equal width.

        edges : for each axis the ends of its cells, (n + 1,). pieces : into how many a cell is cut, a number for all
            axes, or one for each; 1 along axes that are `alike`. periodic (axes,) : bool.
        near (axes,) : how far off a cell a state counts as in it.
        sway (axes,) : how far most tubes stick out of their cells to both sides; not used along an axis where it is
            not less than the widest box.
        alike (axes,) : bool, the axes along which boxes are whole cells, widened by all that tubes stick out of them;
            None: there are none.
        tubes (2, axes) : the least and the greatest that ends of tubes move; needed where `alike` is given.
        """
        cuts = np.broadcast_to(pieces, len(edges)).tolist()
        self.edges = [
            np.unique([*(own[:-1, None] + np.diff(own)[:, None] * np.arange(n) / n).ravel(), own[-1]])
            for own, n in zip(edges, cuts, strict=True)
        ]
        self.periodic, pitch = periodic, np.array([np.diff(own).max() for own in self.edges])
        self.without = np.where(sway < pitch, sway, 0.0) + 3 * near
        self.wider = np.stack([self.without + near] * 2)  # check 4.51
        self.alike = np.zeros(len(edges), np.bool_) if alike is None else alike
        if tubes is not None:
            self.wider = np.where(self.alike, OUTWARD * tubes + 3 * near, self.wider)  # check 4.67
        self.shape = np.array([own.size - 1 for own in self.edges])

    def united(self, every: Sequence[HoldsAt], asked: Array | None = None) -> Array:
        """Which boxes may meet a set: uint8 flags, packed along the last axis; made by parts, to bound memory.

        every : for each function of which the set's is the least a `HoldsAt`: whether it is > 0 all over boxes, and
            whether it is <= 0.
        asked : which boxes are asked about, packed likewise, None: all; others are taken to meet the set.
        """
        many, n = BLOCKS[0] if self.shape.size > 1 else int(self.shape[0]), int(self.shape[-1])
        out = []
        for at in range(0, int(self.shape[0]), many):
            some = None if asked is None else unpacked(asked[at : at + many], n)
            out.append(packed(self.met(every, 1, at, at + many, some)[0]))
        return np.concatenate(out)

    def counted(self, every: Sequence[HoldsAt], times: int) -> list[Array]:
        """How many boxes that may meet a set lie below each corner of boxes: of int32 arrays as `sums` returns them.

        One for each interval of time; where there are several, one more, of the boxes that may meet it in any of them.

        every : for each function of which the set's is the least a `HoldsAt`: whether it is > 0 all over boxes, and
            whether it is <= 0. times : how many intervals there are.
        """
        met = self.met(every, times, 0, int(self.shape[0]))
        ever = [met.any(axis=0)] if times > 1 else []  # check 4.77
        return [sums(own, self.periodic) for own in [*met, *ever]]

    def met(self, every: Sequence[HoldsAt], times: int, begin: int, end: int, asked: Array | None = None) -> Array:
        """Which boxes may meet a set, of those from `begin` to `end` - 1 along the first axis: (times, *boxes) bool.

        Blocks of many boxes are bounded first, single ones where that leaves it open. False is proved: all functions
        of `every` are above 0 all over the box.

        every : for each function of which the set's is the least a `HoldsAt`: whether it is > 0 all over boxes, and
            whether it is <= 0. times : how many intervals of time there are, for each of which boxes are told.
        end : may be past the last box. asked : bool, of these boxes, which are asked about, None: all; others count
            as met.
        """
        some, start = self.shape.copy(), 0 * self.shape
        some[0], start[0] = min(end, int(self.shape[0])) - begin, begin
        met = np.zeros((times, *some), np.bool_)
        met |= False if asked is None else ~asked
        for holds in every:
            blocks, larger = np.full((times, *-(-some // BLOCKS[0])), OPEN, np.int8), BLOCKS[0]
            for side in BLOCKS:
                for axis, n in enumerate(shape := (times, *(-(-some // side)).tolist())):
                    if axis:
                        blocks = blocks.repeat(larger // side, axis)[(*[slice(None)] * axis, slice(n))]
                larger, known = side, np.ascontiguousarray(blocks).ravel()
                known[all_of(met, side).ravel()] = MET
                left = np.flatnonzero(known == OPEN)
                for at in range(0, left.size, AT_ONCE):
                    own = left[at : at + AT_ONCE]
                    time, *first = np.unravel_index(own, shape)
                    outside, inside = holds(self.boxes(start + np.stack(first, axis=1) * side, side), time)
                    known[own] = np.where(outside, OUTSIDE, np.where(inside, MET, OPEN))
                blocks = known.reshape(shape)
            met |= blocks != OUTSIDE  # check 4.53
        return met

    def boxes(self, first: Array, side: int) -> Array:
        """The ends of blocks of boxes, moved outward by `wider`: (2, M, axes).

        A block has `side` boxes along each axis, or those up to the end; first (M, axes) : the first of them.
        """
        past = np.minimum(first + side, self.shape)  # check 4.54
        ends = [[own[at] for own, at in zip(self.edges, each.T, strict=True)] for each in (first, past)]
        low, high = np.array(ends).swapaxes(1, 2)
        return np.stack([low - self.wider[0], high + self.wider[1]])  # check 4.55

    def overlapped(self, axis: int, low: Array, high: Array) -> tuple[Array, Array]:
        """The first and the last box along an axis that tubes overlap: (first, last), int, of the shape of `low`.

        last >= first. On a periodic axis the first is in the first lap, the last may be in the second: it is less than
        twice the number of boxes. Tubes past the end of a bounded axis overlap the box there. Tubes are moved inward by
        `without` first, as boxes are bounded wider.

        axis : which of the lattice's. low, high : where tubes begin and end, of one shape; (M, cells) along an axis
            that is `alike`, where both results are the box of the cell itself, and values are not looked at.
        """
        if self.alike[axis]:
            own = np.broadcast_to(np.arange(self.shape[axis]), low.shape)
            return own, own
        edges, (begin, end) = self.edges[axis], self.edges[axis][[0, -1]]
        low, high = low + self.without[axis], high - self.without[axis]
        whole = high - low >= end - begin
        if self.periodic[axis]:
            turns = np.floor((low - begin) / (end - begin)) * (end - begin)
            low, high = low - turns, high - turns
        beyond = self.periodic[axis] & (high > end)
        high = np.where(beyond, high - (end - begin), high)
        most = edges.size - 2
        first = np.clip(np.searchsorted(edges, low, "right") - 1, 0, most)
        last = np.clip(np.searchsorted(edges, high, "left") - 1, 0, most) + beyond * (most + 1)  # check 4.56
        last = np.maximum(first, last)  # of a tube that is narrower than that, too
        whole &= self.periodic[axis]
        return np.where(whole, 0, first), np.where(whole, most, last)  # check 4.57


def all_of(flags: Array, side: int) -> Array:
    """Whether all flags in blocks of `side` along each axis but the first are set: bool, ceil(n / side) along each.

    flags : bool.
    """
    for axis in range(1, flags.ndim if side > 1 else 0):
        flags = np.logical_and.reduceat(flags, np.arange(0, flags.shape[axis], side), axis)
    return flags
