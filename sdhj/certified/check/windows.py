"""Cells and boxes as bits, united over windows: what tubes of many cells meet at once, and which images leave a set.

Where no place is on the axes of a set, a tube goes along with its cell. It is met where one of the boxes is that it
overlaps, a window of them along each axis: so boxes that may meet the set are united over windows, axis by axis, and
what several tubes have in common is united once. Where all cells are at one place, images are windows of cells, too.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from sdhj.certified.check.bits import Array, compiled, flags_of, numbers_of, packed, unpacked
from sdhj.certified.check.lattice import HoldsAt, Lattice, pieces_united

LEAST_CELLS = 1 << 16  # that one tube goes along with; with fewer, tubes are looked up one by one
PIECES = 2  # of a part of an interval, in which tubes are bounded
MOST_TUBES = 1 << 12  # of all inputs and places

Windows = tuple[Array, Array, Array]  # the first and the last box, both (K, cells), and which of the K a tube has, (M,)


def worth_while(counts: Sequence[int], known: Sequence[bool], inputs: int, sets: Iterable[Sequence[int]]) -> bool:
    """Whether `AtOnce` is worth its memory: few tubes go along with many cells, and no set has an axis that moves read.

    At most `MOST_TUBES` tubes, of `inputs` inputs from every place, and at least `LEAST_CELLS` cells for each place.

    counts (ndim,) : the numbers of cells along each axis. known (ndim,) : whether an axis is one that places are on,
        because moves depend on it. inputs : how many inputs there are. sets : for each unsafe set its axes.
    """
    places = math.prod(n for n, own in zip(counts, known, strict=True) if own)
    many = inputs * places <= MOST_TUBES and math.prod(counts) >= LEAST_CELLS * places
    return many and not any(known[axis] for axes in sets for axis in axes)


@compiled()
def unite(boxes, first, last, out):
    """out[a, i] |= OR of boxes[a, at % n] over `at` from first[i] to last[i], both included; in place.

    boxes (A, n, B), out (A, cells, B) : uint8; `out` is 0 at first. first, last (cells,) : int; an empty range adds
    nothing.
    """
    for a in range(out.shape[0]):
        for i in range(out.shape[1]):
            own = out[a, i]
            for at in range(first[i], last[i] + 1):
                more = boxes[a, at % boxes.shape[1]]  # check 4.64
                for b in range(own.size):
                    own[b] |= more[b]


@compiled()
def unite_bits(boxes, first, last, size, out):
    """Set bit i of out[a] where bit at % size of boxes[a] is set for an `at` from first[i] to last[i]; in place.

    So `unite` along the packed axis. boxes, out (A, bytes) : uint8, the first bit lowest; `out` is 0 at first. size :
    the number of bits in a row of `boxes`. first, last (cells,) : int, both included.
    """
    for a in range(out.shape[0]):
        for i in range(first.size):
            for at in range(first[i], last[i] + 1):
                bit = at % size  # check 4.65
                if (boxes[a, bit >> 3] >> (bit & 7)) & 1:
                    out[a, i >> 3] |= np.uint8(1 << (i & 7))
                    break


@compiled()
def reach(cells, first, last, out):
    """out[a, at % n] |= cells[a, i] for all i, and all `at` from first[i] to last[i], both included; in place.

    cells (A, cells, B), out (A, n, B) : uint8; `out` is 0 at first. first, last (cells,) : int.
    """
    for a in range(out.shape[0]):
        for i in range(first.size):
            own = cells[a, i]
            for at in range(first[i], last[i] + 1):
                more = out[a, at % out.shape[1]]
                for b in range(own.size):
                    more[b] |= own[b]


@compiled()
def reach_bits(cells, first, last, size, out):
    """Set bit at % size of out[a] for all `at` from first[i] to last[i] where bit i of cells[a] is set; in place.

    So `reach` along the packed axis. cells, out (A, bytes) : uint8, the first bit lowest; `out` is 0 at first. size :
    the number of bits in a row of `out`. first, last (cells,) : int, both included.
    """
    for a in range(out.shape[0]):
        for i in range(first.size):
            if (cells[a, i >> 3] >> (i & 7)) & 1:
                for at in range(first[i], last[i] + 1):
                    bit = at % size
                    out[a, bit >> 3] |= np.uint8(1 << (bit & 7))


def along(cells: Array, n: int, axis: int, packs: bool, first: Array, last: Array, back: bool = False) -> Array:
    """Boxes united over the window of each cell along one axis; with `back`, the boxes in the windows of given cells.

    Without `back` an entry of the result is the OR of the boxes from first[i] to last[i], for cell i; with it, the OR
    of the cells in whose window a box is. uint8; the argument itself where the window of each cell is the box of the
    same number.

    cells : uint8, the boxes, n along `axis`; with `back`, the cells. n : how many boxes there are along the axis.
    packs : whether `axis` is the last one, of which eight are in a byte.
    first, last (cells,) : the first and the last box of each cell's window, as of `Lattice.overlapped`.
    """
    if first.size == n and (first == np.arange(n)).all() and (first == last).all():
        return cells
    before, after = math.prod(cells.shape[:axis]), math.prod(cells.shape[axis + 1 :])
    size = n if back else first.size
    out = np.zeros((*cells.shape[:axis], -(-size // 8) if packs else size, *cells.shape[axis + 1 :]), np.uint8)
    if packs:
        (reach_bits if back else unite_bits)(cells.reshape(before, -1), first, last, n, out.reshape(before, -1))
    else:
        given = cells.reshape(before, -1, after), first, last, out.reshape(before, size, after)
        (reach if back else unite)(*given)
    return out


def united(
    boxes: Array, shape: Sequence[int], windows: Sequence[Windows], some: Array
) -> Iterator[tuple[Array, Array]]:
    """Yield groups of tubes whose windows are alike, and the cells from which they overlap a marked box.

    (alike, cells): indices of tubes (m,), each of `some` in one group, and uint8 flags of cells, packed as the boxes
    are. One axis after the other is united, the last one first.

    boxes : uint8 flags, packed along the last axis. shape : the numbers of boxes along all axes.
    windows : for each axis the windows of all tubes (`Windows`). some (n,) : indices of tubes.
    """
    axis = len(windows) - 1
    if axis < 0:
        yield some, boxes
        return
    first, last, of = windows[axis]
    for key in np.unique(of[some]):
        found = along(boxes, shape[axis], axis, axis == len(shape) - 1, first[key], last[key])
        yield from united(found, shape, windows[:axis], some[of[some] == key])  # check 4.66


def overlapped(cells: Any, shape: Sequence[int], windows: Sequence[Windows], some: Array) -> Array:
    """Which boxes tubes overlap from the cells that count for them: uint8 flags, packed along the last axis.

    cells : called with indices of tubes (m,), returns for which cells any of them counts, packed uint8.
    shape : the numbers of boxes along all axes. windows : for each axis the windows of all tubes (`Windows`).
    some (n,) : indices of tubes, at least one.
    """
    axis = len(windows) - 1
    if axis < 0:
        return np.asarray(cells(some))
    (first, last, of), out = windows[axis], np.empty(0)
    for key in np.unique(of[some]):
        own = overlapped(cells, shape, windows[:axis], some[of[some] == key])
        wide = along(own, shape[axis], axis, axis == len(shape) - 1, first[key], last[key], True)
        out = out | wide if out.size else wide
    return out


def each_once(first: Array, last: Array) -> Windows:
    """M windows of each cell as `Windows`: those that are alike once, and which of them each of the M is.

    first, last (M, cells) : int, the first and the last box.
    """
    ends, of = np.unique(np.concatenate([first, last], axis=1), axis=0, return_inverse=True)
    first, last = np.split(ends, 2, axis=1)
    return np.ascontiguousarray(first), np.ascontiguousarray(last), of.ravel()


class AtOnce:
    """What holds of the cells of a `robots.Robot`, asked of all of them at once.

    tubes (inputs * places, parts, 2, ndim) : how far ends of cells move in each part of an interval, input by input;
        empty before `look_at`, and where a tube has no bounds.
    met : by an unsafe set's number and a step what `met_by` returned, for these tubes.
    kept : a step and what `clear_in` returned for it.
    """

    def __init__(self, robot: Any) -> None:
        """Nothing is looked at yet. robot : a `robots.Robot` that has read its cells and its proof."""
        self.robot, self.shape, self.places = robot, robot.counts.tolist(), robot.low.shape[2]
        self.tubes, self.met, self.kept = np.empty(0), dict[tuple[int, int], Array](), (-1, list[Array]())

    # ---- tubes

    def look_at(self, start: int) -> None:
        """Bound the tubes of all inputs and places in the interval that begins at step `start`, and keep them.

        `open_cells` then answers by them. If one has no bounds in `PIECES` pieces, none are kept. What earlier tubes
        met is forgotten.
        """
        of, at = np.arange(self.robot.count).repeat(self.places), np.tile(np.arange(self.places), self.robot.count)
        self.tubes, self.met = np.empty(0), {}
        with suppress(ValueError):  # which is said of a tube that is unbounded in any pieces
            self.tubes = self.robot.driven(at, of, self.robot.time(start), PIECES)[0]

    def open_cells(self, flags: Array, step: int, j: int) -> Array:
        """The numbers of the cells, of those with flags, from which it is open whether u_j is clear in a step: (m,).

        From all others it is proved clear, by the tubes of `look_at`; where none are kept it is open from all.

        flags : uint8, a bit for each cell, packed along the last axis. step : the number of the interval, which must be
            one that `look_at` was called for if anything depends on time.
        """
        if self.tubes.size:
            left = self.past_ends(j)
            for number, part in enumerate(self.robot.unsafe):
                if part.counts(j):  # check 4.69
                    left = left | self.of_all_cells(self.met_by(number, step)[j], part.axes)
            flags = flags & left  # check 4.73
        return numbers_of(flags, self.shape[-1])

    def past_ends(self, j: int) -> Array:
        """From which cells the tube of u_j may get past an unsafe end, as `of_all_cells` returns them."""
        robot, grid, places = self.robot, self.robot.grid, np.arange(self.places)
        out, own = np.zeros([1] * len(self.shape), np.uint8), self.tubes[j * self.places : (j + 1) * self.places]
        whole = np.stack([own[:, :, 0].min(axis=1), own[:, :, 1].max(axis=1)], axis=1)  # check 4.76
        for axis in np.flatnonzero(~robot.periodic & (np.array(grid.ends) == "unsafe").any(axis=1)).tolist():
            low, high = robot.along(axis, places, whole)
            beyond = (low < grid.lower[axis] - robot.room[axis]) & (grid.ends[axis][0] == "unsafe")  # check 4.74
            beyond |= (high > grid.upper[axis] + robot.room[axis]) & (grid.ends[axis][1] == "unsafe")  # check 4.75
            out = out | self.of_all_cells(packed(beyond), [] if robot.known[axis] else [axis])
        return out

    def met_by(self, number: int, step: int) -> Array:
        """From which cells on an unsafe set's axes the tube of each input and place overlaps what may meet the set.

        (inputs, places, *cells, bytes) uint8, the set's last axis packed. Computed once for each set and, where it
        moves, step.

        number : the set's, in `robot.unsafe`. step : the number of the interval.
        """
        part, robot = self.robot.unsafe[number], self.robot
        key, own = (number, step if part.moving else 0), list(part.axes)
        if key not in self.met:
            counts = robot.counts[own].tolist()
            met = np.zeros((len(self.tubes), *counts[:-1], -(-counts[-1] // 8)), np.uint8)
            lattice, every = self.lattice_of(part, step)
            shape = lattice.shape.tolist()
            for piece, signs in enumerate(every):
                # of what stands still boxes are those of the whole interval
                tubes = self.tubes[:, piece : piece + 1] if part.moving else self.tubes  # check 4.70
                some = tubes.reshape(-1, 2, tubes.shape[-1])
                windows = [self.windows(lattice, k, some[:, :, axis], axis) for k, axis in enumerate(own)]
                boxes = lattice.united(signs, self.boxes_asked(own, shape, windows, tubes.shape[1]))
                for alike, found in united(boxes, shape, windows, np.arange(len(some))):
                    met[np.unique(alike // tubes.shape[1])] |= found  # check 4.71
            self.met[key] = met.reshape(robot.count, self.places, *met.shape[1:])
        return self.met[key]

    def boxes_asked(
        self, axes: Sequence[int], shape: Sequence[int], windows: Sequence[Windows], each: int
    ) -> Array | None:
        """The boxes that tubes overlap from cells where their input is said to be clear; nothing else is asked of.

        uint8 flags, packed along the last axis; None, for all boxes, unless the set has all axes.

        axes : the set's. shape : the numbers of boxes along them. windows : for each axis the windows of all tubes.
        each : how many tubes an input has, one behind the other.
        """
        if len(axes) < len(self.shape):
            return None
        ever = np.bitwise_or.reduce(self.robot.clear, axis=0)  # in any step

        def said_clear(some: Array) -> Array:
            """From which cells the input of any of the tubes `some` (m,) is said to be clear: uint8, packed."""
            return np.bitwise_or.reduce([flags_of(ever, j, self.shape) for j in np.unique(some // each).tolist()])

        return overlapped(said_clear, shape, windows, np.arange(len(windows[0][2])))

    def lattice_of(self, part: Any, step: int) -> tuple[Lattice, list[list[HoldsAt]]]:
        """The lattice on an unsafe set's axes for the tubes of `look_at`, and what bounds the set's function there.

        (lattice, every): every[piece] is a list of `HoldsAt`, one for each function of which the set's is the least, at
        the times of a part of the step's interval, jitter included; a set that stands still has one piece, all times.

        part : the set, a `described.Part`. step : the number of the interval.
        """
        robot, own = self.robot, list(part.axes)
        low, high = self.tubes[:, :, 0, own].min(axis=1), self.tubes[:, :, 1, own].max(axis=1)  # check 4.68
        alike = np.maximum(np.ptp(low, axis=0), np.ptp(high, axis=0)) <= robot.near[own]
        times = list(pairwise(robot.cuts(step))) if part.moving else [robot.always]
        pieces = pieces_united(robot.counts[own].tolist(), alike, len(robot.clear) * len(times) if part.moving else 1)
        edges = [robot.edges[axis] for axis in own]
        outermost = np.stack([low.min(axis=0), high.max(axis=0)])
        boxes = Lattice(edges, pieces, robot.periodic[own], robot.near[own], robot.sway[own], alike, outermost)
        when = [(a - robot.jitter, b + robot.jitter) if part.moving else (a, b) for a, b in times]  # check 4.72
        return boxes, [[partial(robot.above_at, part, one, [each]) for one in part.least_of] for each in when]

    def windows(self, lattice: Lattice, k: int, tubes: Array, axis: int) -> Windows:
        """The boxes along an axis that tubes overlap from each cell of it, as `Windows`.

        k : which of the lattice's axes it is. axis : which of the grid's; no place is on it. tubes (M, 2) : how far the
            lower and the upper end of a cell move.
        """
        ends, of = np.unique(tubes, axis=0, return_inverse=True)
        first, last, some = each_once(*lattice.overlapped(k, *self.robot.tubes_of_cells(axis, ends)))
        return first, last, some[of.ravel()]

    def of_all_cells(self, some: Array, axes: Sequence[int]) -> Array:
        """Flags of cells along some axes at each place as flags of all cells: uint8, 1 long along all other axes.

        Packed along the last axis, which is 1 long, 0 or 255, where it is neither one of these nor one of a place.

        some (places, ..., bytes) : uint8, the last of the axes packed; (places, 1) where there are none.
        axes : ascending, none that places are on.
        """
        order, last = [*np.flatnonzero(self.robot.known).tolist(), *axes], len(self.shape) - 1
        shape = [n if axis in order else 1 for axis, n in enumerate(self.shape)]
        if last in axes:  # which it is packed along already
            flags = some.reshape([*(self.shape[axis] for axis in order[:-1]), -1])
            return flags.transpose(np.argsort(order)).reshape(*shape[:-1], -1)
        flags = unpacked(some, self.shape[axes[-1]] if len(axes) else 1).reshape([self.shape[axis] for axis in order])
        flags = flags.transpose(np.argsort(order)).reshape(shape)
        return packed(flags) if last in order else flags * np.uint8(255)

    # ---- steps

    def clear_in(self, step: int) -> list[Array]:
        """From which cells each input is said to be clear in a step: for each a uint8 array, the last axis packed.

        step : an index into `robot.clear`. The last answer is kept.
        """
        if self.kept[0] != step:
            self.kept = step, [flags_of(self.robot.clear[step], j, self.shape) for j in range(self.robot.count)]
        return self.kept[1]

    def leads(self) -> bool:
        """Whether `cells_led_into` knows where inputs lead: all cells alike, into boxes, and past no safe end."""
        return self.places == 1 and not self.robot.safe.any()

    def cells_led_into(self, step: int, following: Array) -> Array:
        """From which cells some input is clear and leads all of the cell into a set, or into the target.

        uint8, a bit for each cell, packed along the last axis. By the file's moves, flags and arrivals; only where
        `leads` is True.

        step : the number of the interval; the last one kept stands for later ones. following : the set, packed
            likewise.
        """
        robot, start, most = self.robot, min(step, len(self.robot.low) - 1), self.robot.counts - 1
        clear = self.clear_in(min(step, len(robot.clear) - 1))
        out = np.zeros_like(clear[0])
        windows = []
        for axis, n in enumerate(self.shape):
            first, last = (np.arange(n) + moves[start, :, 0, axis, None] for moves in (robot.low, robot.high))
            whole = (last - first > most[axis]) if robot.periodic[axis] else first > last
            if not robot.periodic[axis]:
                first, last = np.clip(first, 0, most[axis]), np.clip(last, 0, most[axis])  # check 3.91
            windows.append(each_once(np.where(whole, 0, first), np.where(whole, most[axis], last)))
        missing = ~following.reshape(*self.shape[:-1], -1)
        for alike, left in united(missing, self.shape, windows, np.arange(robot.count)):
            for j in alike:
                out |= clear[j] & ~left  # check 3.92
        for j in range(robot.count if len(robot.arrives) else 0):
            marks = (robot.arrives[min(step, len(robot.arrives) - 1), :, j // 8] >> np.uint8(j % 8)) & 1  # check 3.93
            sites = [n if stride else 1 for n, stride in zip(self.shape, robot.sites.tolist(), strict=True)]
            own = np.broadcast_to(marks.reshape(sites), (*sites[:-1], self.shape[-1]))
            out |= clear[j] & packed(own)  # check 3.90
        return out
