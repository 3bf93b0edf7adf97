"""Why the certified sets of a file hold, for any robot: every claim derived anew, box by box, in NumPy.

A cell is a box of states. The file says which cells each of its sets S_k^n has: from every state of such a cell the
target is reached within n intervals from step k on, clear of the unsafe sets at every instant, whatever the adversary
does (without a target: the state stays clear for n intervals). It says why, too: where each input leads (`low`,
`high`), from which cells it is clear (`clear`), and which inputs lead into the target itself (`arrives`). All of this
is proved here, with the numbers of the file and with nothing of the solver; rounding is outward.

To be read in this order; the number is that of the obligation in `sdhj.certified.sets`, and a function ends with what
is refused without it:

1.  `Argument.uncovered`          cells cover each axis, in fractions
2.  `Argument.driven`, `piece`    where the state can be during an interval and at its end (Mueller's theorem)
2.  `Argument.moves_hold`         the cells that an input is said to lead to hold all of that
3.  `Argument.leads`, `not_nearer`  every cell of an image is in the next set, and the input is clear
3.  `Argument.do_not_grow`        S_k^n holds S_k^{n-1}, or without a target is a part of it
4.  `Argument.read_clear`         each unsafe set is asked about on all axes that its tube depends on
4.  `Argument.not_clear`          what is swept in each part of the interval meets no unsafe set and no unsafe end
5.  `Argument.ends`               all states of a cell count: functions are bounded over boxes, never sampled
6.  (of the arm alone: its pursuer is an axis like any other here)
7.  `outward` in `intervals`, and the margins below: every end is rounded outward
8.  `NEAR`, `STICKS`              a state so near to a cell counts as in it; an image may stick out by so little
9.  `Argument.goals_hold`, `arrivals_hold`  a goal, or all of an image, is in the target; goals are outside unsafe sets
10. `Argument.far_off`, `off_at`, `carried_on`  measurements err, come late, at times that are off; what memory keeps

What the file states of the problem is read by `stated`, formulas by `formulas`, which bounds them by the rules of
`intervals`.

What is claimed is what is promised: moves and clear inputs of the cells that some S_k^n with n >= 1 has, without a
target S_k^1; moves of all cells where a controller remembers. What the file says else of other cells serves who has
lost his promise; it is proved with `everywhere`, and counted otherwise.
"""

import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from functools import lru_cache, partial
from itertools import pairwise, product
from typing import Any, NamedTuple

import numpy as np

from sdhj.certified.check.claims import ARRIVE, CLEAR, COVER, GOALS, GROW, MOVES, NEARER, PREDICTED, Claim, Count
from sdhj.certified.check.intervals import Array
from sdhj.certified.check.reading import (
    MOST_COUNTED,
    MOST_ON_AN_AXIS,
    array,
    decimal,
    edges_of,
    expect,
    fraction,
    is_whole,
    reals,
)
from sdhj.certified.check.stated import MOST_INPUTS, Function, Part, Problem, Times, entry, flags, listed

# Shares of the largest coordinate of an axis, of which one rounding is 2^-53 at most: so these hold in any units.
NEAR = 1e-10  # a state so near to a cell counts as in it
STICKS = 2e-13  # of its cells, what an image may; and what rounding here adds
ROUNDED = 1e-15  # a difference of two coordinates
ROOM = 1e-6  # of the spacing of nodes: so near past an unsafe end counts as at it
AT_FIRST = 1e-7  # of an interval, until a state that counts as in a layer is held by the wall
WIDER = 1.02  # than expected, boxes are to hold all that is reached in a piece
TRIES = 30  # to find such boxes
FINENESS = 1, 8, 16  # pieces of a part: as few, as many and more than the solver takes, where it is open
DEEPEST = 10, 8, 6  # times that a box is halved along each axis: of one axis, of two, of more
WHOLE = 3  # the same of all that a tube stays in, before its parts are looked at: an arm takes 2.2 s for 5.2
NEAREST = 8  # times that boxes are halved to tell how near predictions stay
STRIDES = 8  # in which a controller moves a measurement on
TILE = 8  # cells along an axis that are looked at together first: a car takes 1.4 s for 3.3
SLAB = 1 << 15  # boxes that are looked at at once
PLACES = 1 << 16  # whose tubes are in memory at once
MOST_CELLS = 1 << 26  # of all tasks that are looked at together
OUT = np.array([-1.0, 1.0])[:, None, None]  # which way is outward, of the lower and the upper ends of boxes

# of boxes (2, axes, M) to where something holds all over them, and where it nowhere does, both (M,) bool
Holds = Callable[[Array], tuple[Array, Array]]
# of boxes of cells, from first to past, (ndim, M) each, and for each the number of a set, (M,), to whether all cells of
# the box are in that set, (M,) bool
AllIn = Callable[[Array, Array, Array], Array]
# of a step, or None: of any, to the cells of which something is claimed, (*counts) bool
OfStep = Callable[[int | None], Array]
# of what is gone through, what it is called, and how many there are, to the same, shown as it is gone through
Bar = Callable[[Iterable[Any], str, int], Iterable[Any]]


class Tubes(NamedTuple):
    """How far the ends of the boxes at some places move under an input in one interval, rounded outward.

    rows (places,) : the column of a place. swept (parts, 2, ndim, P) : the farthest in each part. whole (2, ndim, P) :
    in all of it. last (2, ndim, P) : at the end, to what is then predicted or carried on.
    """

    rows: Array
    swept: Array
    whole: Array
    last: Array


class Clear(NamedTuple):
    """What a file says of inputs that are clear of some unsafe sets and unsafe ends, by cells of some axes.

    own (ndim,) bool : these axes. ends (ndim,) bool : the axes whose unsafe ends are asked about. bits (starts, cells,
    bytes) uint8 : an input is a bit.
    """

    own: Array
    parts: list[Part]
    ends: Array
    bits: Array


def marked(bits: Array, step: int, j: int, cells: Any = slice(None)) -> Array:
    """Of which of the cells input j is marked, bool, in bits (starts, cells, bytes), at a step or at all alike."""
    return (bits[min(step, len(bits) - 1), cells, j // 8] >> np.uint8(j % 8) & 1).view(np.bool_)


def silently(through: Iterable[Any], _: str, __: int) -> Iterable[Any]:
    """A `Bar` that shows nothing."""
    return through


def everywhere(holds: Holds, boxes: Array, axes: Sequence[int] | Array, depth: int | None = None) -> Array:
    """Where something holds all over boxes (2, ndim, M), halved along one axis after the other where it is open: (M,).

    depth : how often along each of the axes; what is open then counts as not proved.
    """
    depth = DEEPEST[min(len(axes), len(DEEPEST)) - 1] if depth is None else depth
    out, left = np.ones(boxes.shape[2], np.bool_), [(boxes, np.arange(boxes.shape[2]), depth * len(axes))]
    while left:
        some, of, more = left.pop()
        some, of = some[:, :, out[of]], of[out[of]]
        yes, no = holds(some)
        # At the last depth what is not proved fails; before, only what surely does.
        out[of[no if more else ~yes]] = False
        if not more:
            continue
        # `more` counts down from a multiple of their number, so that axes take turns
        axis = axes[-more % len(axes)]
        some, of = some[:, :, (open_ := ~yes & out[of])], of[open_]
        middle = some[:, axis].mean(axis=0)
        # The two halves, one after the other.
        some, of = np.concatenate([some] * 2, axis=2), np.tile(of, 2)
        some[1, axis, : middle.size] = some[0, axis, middle.size :] = middle
        left += [(some[:, :, at : at + SLAB], of[at : at + SLAB], more - 1) for at in range(0, of.size, SLAB)]
    return out


def left_open(holds: Callable[[Array], Array], some: Array, tiles: Array) -> Array:
    """For which cells, of those that are True in `some`, it is not proved that something holds; bool as `some`.

    Tiles, so many cells along each axis, are looked at first, in one box each; where it is open, smaller ones.
    """
    open_ = np.ones((1,) * some.ndim, np.bool_)
    while True:
        asked = in_tiles(some, tiles)
        asked = asked & spread(open_, asked.shape)
        first = np.array(np.nonzero(asked)) * tiles[:, None]
        last = np.minimum(first + tiles[:, None], np.array(some.shape)[:, None]) - 1
        # What holds of a tile's box holds of each of its cells.
        asked[asked] = ~in_slabs(holds, np.concatenate([first, last]))
        if (tiles == 1).all():
            return asked
        open_, tiles = asked, np.maximum(tiles // 2, 1)


def in_slabs(holds: Callable[[Array], Array], cells: Array) -> Array:
    """holds(cells), (M,) bool, called with at most `SLAB` of the cells (..., M) at once."""
    slabs = np.array_split(cells, -(-cells.shape[-1] // SLAB) or 1, axis=-1)
    return np.concatenate([holds(slab) for slab in slabs])


def failing(holds: Callable[[Array, Tubes], Array], asked: Array, tubes: Tubes) -> Array:
    """For which cells, of those that are True in `asked`, what is asked of their numbers does not hold."""
    bad, numbers = asked.copy(), np.flatnonzero(asked)
    bad[asked] = ~in_slabs(lambda some: holds(some, tubes), numbers)
    return bad


class Asked(NamedTuple):
    """Claims of one kind, of cells on some axes: what they are called, and which of them are open, bool.

    fails(cells, tubes) tells of such an array of truth values for which of its cells it is not proved.
    """

    name: str
    what: str
    axes: Array
    cells: Array
    fails: Callable[[Array, Tubes], Array]


class Argument:
    """What a file says of a robot, and the argument that it holds: `claims` goes through all of it.

    counts (ndim,) : of cells, layers included. known (ndim,) : bool, the axes that a cell's moves depend on; a place is
    the part of a cell on these. low, high (starts, inputs, places, ndim) int16 : the first and the last cell that an
    input leads to, less the cell's own. arrives (starts, sites, bytes) uint8 : an input is a bit. sites (ndim,) :
    strides of the part of a cell that moves and target depend on. off (ndim,) : E. edges : of each axis's cells.
    """

    def __init__(self, head: Mapping[str, Any], arrays: Any, given: Any = None) -> None:
        """Read a file; ValueError with a sentence where something does not fit. given : the problem beside it."""
        # arrays are those of an open file, or at the end of a solve `sampled.InMemory`
        self.problem = Problem(head, arrays, given)
        robot = self.problem
        self.scale = np.maximum(np.abs(robot.lower), np.abs(robot.upper))
        self.near, self.room = NEAR * self.scale, ROOM * robot.spacing
        self.walls, self.safe, self.unsafe = (
            np.array([[end == name for end in pair] for pair in robot.ends]) & ~robot.periodic[:, None]
            for name in ("wall", "safe", "unsafe")
        )
        self.length = robot.delta + 2 * robot.jitter  # of an interval, at most
        self.always = 0.0 - robot.jitter, self.time(robot.steps) + self.length
        expect(not (robot.jitter and robot.timed), "with jitter the velocity must not depend on time", robot.jitter)
        # who leaves there is out of danger, but reaches no target; nor is it certain when a measured state has left
        fits = not self.safe.any() or (robot.target is None and not robot.sensed)
        expect(fits, "safe ends must be of a robot without target and sensing", robot.ends)
        fields = "kind shape lowers widths extents"
        self.read_cells(entry("cells", head["cells"], fields, "layers periodic"), arrays)
        self.read_proof(entry("the proof", head["proof"], "parts own unsure clear", "arrives"), arrays)
        self.read_sets(head, arrays)

    def bytes_needed(self) -> int:
        """About the bytes of memory that `claims` takes."""
        cells, places = math.prod(self.counts.tolist()), min(self.low.shape[2], PLACES)
        looks = sum(one.bits[0, :, 0].size * (len(one.bits) if len(self.low) == 1 else 1) for one in self.clear)
        laps = 1 + int(self.problem.periodic.any())
        tubes = 16 * self.problem.ndim * places * (self.parts + 12)
        # truth values of cells, and sums of a set beside some of it
        each = max(cells * 10 + looks + tubes, cells * (8 + 4 * laps)) + min(cells, SLAB * 8) * 64
        return self.together(MOST_INPUTS) * each

    def together(self, tasks: int) -> int:
        """How many tasks are looked at together: as many as there are cores, but fewer of many cells."""
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        most = max(MOST_CELLS // math.prod(self.counts.tolist()), 1)
        return 1 if self.problem.trusted else min(cores, tasks, most)  # what users wrote may not bear it

    # ---- what the file says

    def read_cells(self, stated: Mapping[str, Any], arrays: Any) -> None:
        """Read the cells of each axis, and the pool of packed rows that sets are made of."""
        n, robot = self.problem.ndim, self.problem
        expect(stated["kind"] == "enclosed", "cells must be those of a robot", stated["kind"])
        closes = stated.get("periodic", robot.periodic.tolist())
        expect(closes == robot.periodic.tolist(), "cells must close where the axes do", closes)
        shape = listed("the numbers of cells", stated["shape"], n)
        expect(all(is_whole(one, 2, MOST_ON_AN_AXIS) for one in shape), "shape must be numbers of cells", shape)
        ends = [listed("an extent", one, 2) for one in listed("extents", stated["extents"], n)]
        columns = listed("lowers", stated["lowers"], n), listed("widths", stated["widths"], n), ends
        self.axes = [(fraction(a), fraction(w), *map(fraction, pair)) for a, w, pair in zip(*columns, strict=True)]
        layers = listed("layers", stated.get("layers", [[0, 0]] * n), n)
        whole = all(is_whole(one, 0, 1) for pair in layers for one in listed("layers of an axis", pair, 2))
        expect(whole, "layers must be 0 or 1 at both ends of each axis", layers)
        self.counts, self.layers = np.array(shape), layers
        self.edges = [edges_of(*one) for one in zip(shape, self.axes, layers, strict=True)]
        self.widths = [float(width) for _, width, *_ in self.axes]
        rows, words = math.prod(shape[:-1]), -(-shape[-1] // 64)
        self.index = array(arrays, "index", np.uint32, None, rows)
        expect(len(self.index) > 0, "there must be sets", self.index.shape)
        self.pool = array(arrays, "pool", np.uint64, int(self.index.max()) + 1, words)
        # Whole words are counted and compared, so that bits past the last cell would count as cells.
        beyond = self.pool[:, -1] >> np.uint64(shape[-1] % 64) if shape[-1] % 64 else np.zeros(1)
        expect(not beyond.any(), "the sets must have no cells that there are not", shape[-1])

    def read_proof(self, stated: Mapping[str, Any], arrays: Any) -> None:
        """Read the parts of an interval, the axes of a place, E, moves, clear inputs and arrivals."""
        robot, self.parts = self.problem, stated["parts"]
        expect(is_whole(self.parts, 1, MOST_COUNTED), f"parts must be a number up to {MOST_COUNTED}", self.parts)
        self.known = flags("axes of a place", stated["own"], robot.ndim)
        self.strides = self.strides_of(self.known)
        self.off = np.array(reals("unsure", stated["unsure"], robot.ndim, 0.0))
        expect(bool((self.off >= robot.error).all()), f"predictions are off by {robot.error} at least", self.off)
        prompt = robot.delay > 0 or bool((self.off == robot.error).all())
        expect(prompt, f"predictions without a delay are off by {robot.error}", self.off)
        # shapes as `moves_of` and `sites_of` of the solver have them, worked out anew
        places = math.prod(self.counts[self.known].tolist())
        starts = robot.steps if robot.timed else 1
        self.low, self.high = (
            array(arrays, name, np.int16, starts, robot.count, places, robot.ndim) for name in ("low", "high")
        )
        expect(bool((self.low <= self.high).all()), "an input must lead to some cell, from low to high", "low > high")
        marks = -(-robot.count // 8)
        self.read_clear(stated["clear"], array(arrays, "clear", np.uint8, None))
        self.arrives, self.sites = np.zeros((0, 0, 0), np.uint8), 0 * self.counts
        arrives = stated.get("arrives", False)
        expect(isinstance(arrives, bool), "arrives must be true or false", arrives)
        if arrives and robot.target is not None and not robot.sensed:
            # It depends on the place, and on where the state is along the target's axes.
            some = self.known.copy()
            some[robot.target.axes] = True
            self.sites, starts = self.strides_of(some), robot.steps if robot.timed or robot.target.moving else 1
            self.arrives = array(arrays, "arrives", np.uint8, starts, math.prod(self.counts[some].tolist()), marks)
        # who measures does not know that he is in the target but by the cells of a goal
        fits = not arrives or len(self.arrives) > 0
        expect(fits, "only states that are known may be led into a target itself", arrives)

    def read_clear(self, stated: Any, given: Array) -> None:
        """Read from which cells inputs are clear, for each unsafe set and unsafe end by cells of the axes it names.

        How far a tube reaches, and when it has left over a safe end, must depend on no other axes.
        """
        robot, begin, self.clear = self.problem, 0, list[Clear]()
        ends = np.logical_or(*self.unsafe.T)
        # What is left of these at the end has been named by no entry.
        left, open_ends = np.ones(len(robot.unsafe), np.bool_), ends.copy()
        expect(isinstance(stated, list), "clear must be a list of sets and ends by axes", stated)
        for each in stated:
            one = entry("what is clear", each, "axes sets ends")
            own = some_of("axes that clear inputs depend on", one["axes"], robot.ndim)
            sets = some_of("sets that inputs are clear of", one["sets"], len(robot.unsafe))
            at_ends = some_of("ends that inputs are clear of", one["ends"], robot.ndim)
            parts = [robot.unsafe[number] for number in np.flatnonzero(sets)]
            needed = at_ends | self.safe.any(axis=1) | robot.reads[own].any(axis=0)
            needed[[axis for part in parts for axis in part.axes]] = True
            expect(bool((own | ~needed).all()), "tubes must depend on no other axes than clear inputs", one["axes"])
            starts = robot.steps if robot.timed or any(part.moving for part in parts) else 1
            shape = starts, math.prod(self.counts[own].tolist()), -(-robot.count // 8)
            bits = given[begin : begin + math.prod(shape)]
            # Shorter where the file's array ends too early.
            fits = bits.size == math.prod(shape)
            expect(fits, "clear must be kept in the file, for each step and cell of its axes", given.shape)
            self.clear.append(Clear(own, parts, at_ends, bits.reshape(shape)))
            begin, left, open_ends = begin + bits.size, left & ~sets, open_ends & ~at_ends
        expect(begin == given.size, "clear must be kept in the file, for each step and cell of its axes", given.shape)
        expect(not (left.any() or open_ends.any()), "inputs must be clear of every unsafe set and unsafe end", stated)

    def read_sets(self, head: Mapping[str, Any], arrays: Any) -> None:
        """See for how many steps there are sets: for each pair (k, n), for each n, or one that holds for ever."""
        robot, steps, entries = self.problem, self.problem.steps, len(self.index)
        self.alike = entries != (steps + 1) * (steps + 2) // 2  # whatever the step
        moving = robot.timed or any(part.moving for part in robot.parts)
        # where nothing moves a controller asks the sets of step 0 at all steps
        fits = entries in (1, steps + 1) and not moving if self.alike else moving
        expect(fits, "there must be sets for each step, or for all alike where nothing moves", self.index.shape)
        endless = dict(head["details"]).get("endless", False)
        expect(isinstance(endless, bool), "endless must be true or false", endless)
        fits = not endless or robot.target is not None or entries == 1
        expect(fits, "sets that hold for ever must be one that leads into itself", self.index.shape)

    def strides_of(self, some: Array) -> Array:
        """The strides of the numbers of what cells are on `some` axes."""
        each = np.where(some, self.counts, 1)
        return np.where(some, np.cumprod([1, *each[:0:-1]])[::-1], 0)

    def time(self, step: int) -> float:
        """When the input of a step begins to act, s, apart from jitter."""
        return step * self.problem.delta + self.problem.delay

    def cuts(self, pieces: int) -> list[float]:
        """Where the interval is cut, s from its begin: each part into so many pieces."""
        whole = self.parts * pieces
        return [self.length * (at / whole) for at in range(whole + 1)]

    def ends(self, cells: Array, wider: Any = 0.0) -> Array:
        """The lower and the upper ends of cells (ndim, M), moved outward by `wider`: (2, ndim, M)."""
        both = [[edge[own + side] for edge, own in zip(self.edges, cells, strict=True)] for side in (0, 1)]
        return np.array(both) + OUT * np.reshape(wider, (-1, 1))

    def cells_at(self, places: Array, strides: Array) -> Array:
        """A cell (ndim, M) at each place or site, with index 0 on the axes that these have not."""
        own = zip(strides.tolist(), self.counts.tolist(), strict=True)
        return np.array([places // stride % n if stride else 0 * places for stride, n in own])

    def number(self, step: int, within: int) -> int:
        """Which of the sets of `index` is S_step^within."""
        # as `sdhj.table.batches.entry` numbers them; `Arm.bits` and `words_hold` have it once more
        number = step * (self.problem.steps + 1) - step * (step - 1) // 2 + within
        return min(within, len(self.index) - 1) if self.alike else number

    def row(self, step: int, within: int) -> Array:
        """Of the set S_step^within the number of the block of each row of cells."""
        return self.index[self.number(step, within)]

    def bits(self, step: int, within: int) -> Array:
        """The set S_step^within of the file: (cells,), the last axis fastest."""
        blocks = self.pool[self.row(step, within)].view(np.uint8)
        return np.unpackbits(blocks, axis=1, count=int(self.counts[-1]), bitorder="little").ravel().view(np.bool_)

    # ---- 1: cells

    def uncovered(self) -> list[str]:
        """What is wrong with the cells of each axis: they must cover it, and move alike where no place is asked."""
        wrong, robot = list[str](), self.problem
        for k, (n, (low, width, least, most)) in enumerate(zip(self.counts.tolist(), self.axes, strict=True)):
            inner, length = n - sum(self.layers[k]), decimal(robot.upper[k]) - decimal(robot.lower[k])
            doubt = length / 2**40 if robot.periodic[k] else Fraction(0)  # a period may be no fraction
            fits = low == decimal(robot.lower[k]) and least <= length <= most and most - least <= doubt
            if not (fits and (inner - 1) * width < least and inner * width >= most):
                wrong.append(f"axis {k}: {inner} cells of width {float(width):.6g} do not cover it")
            if any(layer and not (self.walls[k, side] and self.known[k]) for side, layer in enumerate(self.layers[k])):
                wrong.append(f"axis {k}: a layer where no wall holds")
            if not self.known[k]:
                wrong += [] if self.alike_along(k, inner * width - most) else [f"axis {k}: its cells do not move alike"]
        return wrong

    def alike_along(self, k: int, beyond: Fraction) -> bool:
        """Whether all cells along an axis of no place move alike: as wide, and a wall holds back what has one velocity.

        beyond : how much longer than the axis its cells are together.
        """
        if self.problem.periodic[k]:
            return abs(beyond) <= STICKS * self.scale[k]
        return not self.walls[k].any() or self.problem.steady(k)

    # ---- functions over the parts of boxes that are on the grid

    def on_grid(self, axes: Sequence[int], box: Array, bounds: Callable[[Array, Array], Any]) -> Array:
        """Bounds of a function over boxes (2, axes, M), clipped at ends, in two halves where an axis closes.

        (2, results, M), infinite where nothing is known. bounds : called with lower and upper ends, (axes, M).
        """
        box, count, robot = box.copy(), box.shape[2], self.problem
        of = np.arange(count)
        for row, k in enumerate(axes):
            least, most, (a, b) = robot.lower[k], robot.upper[k], box[:, row]
            if not robot.periodic[k]:
                np.clip(box[:, row], least, most, out=box[:, row])
                continue
            # What goes all around is the whole axis; all else is moved by whole turns.
            full, turns = b - a >= most - least, np.floor((a - least) / (most - least)) * (most - least)
            a[:], b[:] = np.where(full, least, np.clip(a - turns, least, most)), np.where(full, most, b - turns)
            if (over := np.flatnonzero(b > most)).size:
                second = box[:, :, over]
                second[0, row], second[1, row] = least, b[over] - (most - least)
                b[over] = most
                box, of = np.concatenate([box, second], axis=2), np.concatenate([of, of[over]])
        # the first `count` are the boxes themselves, and behind them are parts past a seam, each of box `of`
        found = np.array(bounds(box[0], box[1]))
        # Where a function is not a number nothing is known of it.
        found[0][np.isnan(found[0])], found[1][np.isnan(found[1])] = -np.inf, np.inf
        for row in range(found.shape[1]) if len(of) > count else ():
            np.minimum.at(found[0, row], of[count:], found[0, row, count:])
            np.maximum.at(found[1, row], of[count:], found[1, row, count:])
        return found[:, :, :count]

    def velocity(self, j: int, box: Array, times: Times, pushed: bool = True) -> Array:
        """Bounds of the velocity under u_j over boxes (2, ndim, M) and times: (2, ndim, M)."""
        of = self.problem.velocity
        return self.on_grid(range(len(box[0])), box, lambda low, high: of(j, low, high, times, pushed))

    def value(self, part: Part, one: Function, box: Array, times: Times) -> Array:
        """Bounds of a function of a set over boxes on its axes, (2, axes, M), and times: (2, M)."""
        found = self.on_grid(
            part.axes, box, lambda low, high: np.array(one.bounds(low.T, high.T, times)).swapaxes(1, 2)
        )
        return found[:, 0]

    def outside(self, part: Part, box: Array, times: Times, depth: int | None = None) -> Array:
        """Whether boxes (2, axes, M) are outside a set at all times: all functions that it is the least of are > 0."""
        out = np.ones(box.shape[2], np.bool_)
        for one in part.function.least_of:

            def above(some: Array, one: Any = one) -> tuple[Array, Array]:
                least, most = self.value(part, one, some, times)
                return least > 0, most <= 0

            # Each function is asked only where all before it are > 0.
            left = np.flatnonzero(out)
            out[left] = everywhere(above, box[:, :, left], range(len(box[0])), depth)
        return out

    def inside(self, part: Part, box: Array, times: Times) -> Array:
        """Whether boxes (2, axes, M) are inside a set at all times: its function is <= 0."""

        def below(some: Array) -> tuple[Array, Array]:
            least, most = self.value(part, part.function, some, times)
            return most <= 0, least > 0

        return everywhere(below, box, range(len(box[0])))

    # ---- 2: moves

    def boxes(self, places: Array) -> Array:
        """The states that count as at places (M,), (2, ndim, M): whole axes where a place has none."""
        whole = np.array([self.problem.lower, self.problem.upper])[:, :, None]
        return np.where(self.known[:, None], self.ends(self.cells_at(places, self.strides), self.near), whole)

    def driven(self, places: Array, j: int, start: int, pieces: int) -> tuple[Array, Array]:
        """How far the ends of the boxes at places (M,) move under u_j in an interval: `swept` and `last` of `Tubes`.

        With these added a box holds all that can be reached; infinite where none is found. pieces : of each part.
        """
        robot, at = self.problem, self.boxes(places)
        hold = (self.walls & self.known[:, None]).T[:, :, None]
        bars = np.where(hold[0], robot.lower[:, None], -np.inf), np.where(hold[1], robot.upper[:, None], np.inf)

        # displacements of ends, stopped where a wall is reached, rounded outward
        def held(moved: Array) -> Array:
            stopped = np.clip(at + moved, *bars)
            return np.where(stopped == at + moved, moved, stopped - at + OUT * ROUNDED * self.scale[:, None])

        soonest = self.length - 4 * robot.jitter  # an interval may end from there on
        begun, marks = self.time(start), self.cuts(pieces)
        soon = [self.length * AT_FIRST] * any(map(any, self.layers))
        moved = held(np.zeros_like(at) + OUT * self.off_at(places))
        ending = moved.copy()  # the farthest that its end may be
        swept, gain = np.empty((self.parts, *at.shape)), np.zeros_like(at)
        for number in range(self.parts):
            reached = moved.copy()
            own = marks[number * pieces : (number + 1) * pieces + 1]
            more = [one for one in (*soon, soonest) if own[0] < one < own[-1]]
            for begin, end in pairwise(sorted({*own, *more})):
                # before the earliest end only the last counts
                ending = moved if begin <= soonest else ending
                box, times = at + np.where(self.known[:, None], moved, 0.0), (begun + begin, begun + end)
                after = held(self.piece(box, moved, j, times, end - begin, gain * (end - begin)))
                gain, moved = OUT * np.maximum(OUT * (after - moved) / (end - begin), 0.0), after
                reached = farthest(np.array([reached, moved]))
                ending = farthest(np.array([ending, moved]))
            swept[number] = reached
        last = ending if robot.jitter else moved
        return swept, held(self.carried_on(at, last) if robot.memory else last + OUT * self.off[:, None])

    def tubes(self, places: Array, j: int, start: int, pieces: int) -> Tubes:
        """The `Tubes` from places under u_j in the interval from a step, by so many pieces of each part."""
        rows = np.empty(self.low.shape[2], np.int64)
        rows[places] = np.arange(places.size)
        swept, last = self.driven(places, j, start, pieces)
        return Tubes(rows, swept, farthest(swept), last)

    def piece(self, box: Array, moved: Array, j: int, times: Times, h: float, far: Array) -> Array:
        """How far the ends of boxes have moved after a piece of the interval that is h long, s: (2, ndim, M).

        First an enclosure is looked for that no state leaves in the piece: with every velocity in it the box, moved for
        up to h, stays inside. Then each end moves with the extreme velocity in the enclosure, or along axes whose
        velocity depends on their own coordinate with that in the face of the enclosure that the end passes (Mueller): a
        state is beyond the end only if it was on it before, and was faster there.
        """
        known, h = self.known[:, None], h * (1 + 1e-15)
        some, rounded = OUT * 0.1 * self.near[:, None], ROUNDED * self.scale[:, None]
        far, left = far.copy(), np.arange(box.shape[2])
        for _ in range(TRIES):
            own, reach = box[:, :, left], far[:, :, left]
            enclosure = own + np.where(known, WIDER * reach + some, 0.0)
            found = self.velocity(j, enclosure, times)
            now = np.array([h * np.minimum(found[0], 0.0), h * np.maximum(found[1], 0.0)])
            fits = ~known | (OUT * (enclosure - own - now) > rounded)
            stays = fits.all(axis=(0, 1))
            far[:, :, left] = np.where(stays, now, np.where(fits, reach, 1.3 * now))
            left = left[~stays]
            if not left.size:
                break

        def reached(far: Array) -> Array:  # a coordinate that cannot grow needs no room above, nor one below
            return np.asarray(box + np.where(known, far + some * (far != 0), 0.0))

        out = self.velocity(j, reached(far), times)
        far = np.array([h * np.minimum(out[0], 0.0), h * np.maximum(out[1], 0.0)])  # no more, by what is known now
        enclosure = reached(far)
        for axis, side in product(np.flatnonzero(self.known & self.problem.reads.diagonal()), (0, 1)):
            face = enclosure.copy()
            face[:, axis] = (box[side] + far + some)[:, axis]  # all that the end passes
            out[side, axis] = self.velocity(j, face, times)[side, axis]
        # more than products and the sum are rounded by, 1.2e-16 of each
        after = moved + h * out + OUT * (2e-15 * np.abs(h * out) + 3e-16 * np.abs(moved))
        after[:, :, left] = OUT * np.inf  # of which nothing is known
        return after

    def moves_hold(self, start: int, j: int, places: Array, tubes: Tubes) -> Array:
        """Whether all that cells at places (M,) are led to under u_j lies in the cells that the file says: (M,)."""
        last = tubes.last[:, :, tubes.rows[places]]
        fits, cells, sticks = np.ones(len(places), np.bool_), self.cells_at(places, self.strides), STICKS * self.scale
        for k, (lower, width, least, most) in enumerate(self.axes):
            own, wide, edges = cells[k], self.widths[k], self.edges[k]
            low, high = (moves[start, j, places, k].astype(np.int64) for moves in (self.low, self.high))
            first, past = low * wide, high * wide  # how far those cells are from this one, of cells all alike
            if any(self.layers[k]):  # a layer has no width, but what is past the wall counts as in it
                begin = float(lower - self.layers[k][0] * width)
                first, past = begin + (own + low) * wide - edges[own], begin + (own + high + 1) * wide - edges[own + 1]
                # nothing is behind a layer, or who remembers would go on beside it and not in it
                below, above = np.array(self.layers[k]) * self.problem.memory
                fits &= (own + low >= 0 if below else True) & (own + high < self.counts[k] if above else True)
            if self.problem.periodic[k] and self.known[k]:  # the last cell of a lap may be narrower
                n, lap = self.counts[k], float((least + most) / 2)
                first, past = (
                    edges[at % n] + at // n * lap - edges[own + side]
                    for side, at in enumerate((own + low, own + high + 1))
                )
            fits &= (first <= last[0, k] + sticks[k]) & (last[1, k] <= past + sticks[k])
        return fits

    # ---- 10: measurements that err

    def off_at(self, places: Array) -> Array:
        """How far the state may be off cells at places: E, but 0 for who remembers to be in a layer."""
        cells, layers = self.cells_at(places, self.strides), np.array(self.layers, np.bool_)[:, :, None]
        at_wall = (layers[:, 0] & (cells == 0)) | (layers[:, 1] & (cells == self.counts[:, None] - 1))
        return np.where(at_wall & self.known[:, None] & self.problem.memory, 0.0, self.off[:, None])

    def carried_on(self, at: Array, last: Array) -> Array:
        """How far the ends of boxes `at` move to the points that a controller with memory goes on with: (2, ndim, M).

        They are E inside of what the state is led to, or its middle where that is empty; all of it where it lies in the
        layer at a wall, and only there in a layer.
        """
        robot, near, sticks = self.problem, self.near[:, None], STICKS * self.scale[:, None]
        less = last - OUT * self.off[:, None]
        first, second = at + less
        points = np.where((first > second) & self.known[:, None], (first + second) / 2 - at, less)
        layers = np.array(self.layers, np.bool_)[:, :, None]
        below, above = robot.lower[:, None] + near + sticks, robot.upper[:, None] - near - sticks  # within a layer
        low, high = at + last
        at_wall = (layers[:, 0] & (high <= below)) | (layers[:, 1] & (low >= above))
        points[1] = np.maximum(points[1], np.where(layers[:, 0], below + sticks - at[1], -np.inf))
        points[0] = np.minimum(points[0], np.where(layers[:, 1], above - sticks - at[0], np.inf))
        return np.where(at_wall, last, points)

    def far_off(self) -> list[str]:
        """The inputs under which a prediction may be off by more than the file says, E, after the delay.

        What is measured is moved on in strides by undisturbed velocities. It stays within E if delay * |velocity -
        undisturbed velocity| is at most E less the error of a measurement, wherever state and prediction are within E.
        """
        robot, wrong, stride = self.problem, list[str](), self.problem.delay / STRIDES
        places = np.arange(self.low.shape[2])
        whole = np.array([robot.lower, robot.upper])[:, :, None]
        boxes = np.where(self.known[:, None], self.ends(self.cells_at(places, self.strides)), whole)
        # E may be as much less as it was rounded when it was written.
        allowed = (self.off - robot.error) * (1 + 1e-12) + ROUNDED * self.scale
        begins = [step * robot.delta + stride * at for step in range(robot.steps) for at in range(STRIDES)]
        inputs = range(robot.count if robot.delay else 0)
        for j, begin in product(inputs, begins if robot.timed else begins[:1]):
            times = begin, begin + stride
            slow, fast = self.velocity(j, boxes, times)
            travel = stride * np.array([np.minimum(slow, 0).min(axis=1), np.maximum(fast, 0).max(axis=1)])[:, :, None]

            def near(box: Array, j: int = j, times: Times = times, travel: Array = travel) -> tuple[Array, Array]:
                calm = self.velocity(j, box + travel, times, False)
                wild = self.velocity(j, box + travel + OUT * self.off[:, None], times)
                apart = np.maximum(wild[1] - calm[0], calm[1] - wild[0]) * robot.delay
                yes = (apart <= allowed[:, None]).all(axis=0)
                return yes, np.zeros_like(yes)  # nothing surely fails: it is halved to the last

            if not everywhere(near, boxes, np.flatnonzero(self.known), NEAREST).all():
                wrong.append(f"input {j}, from {begin:.3g} s on")
        return wrong

    # ---- 4: clear

    def not_clear(self, one: Clear, step: int, j: int, asked: Array, tubes: Tubes) -> Array:
        """From which of the cells `asked`, bool, 1 along axes that `one` has not, it is not proved that u_j is clear.

        Cells that differ only on axes that play no part in a question are asked about once.
        """
        bad = np.zeros_like(asked)
        for axes, holds in self.questions(one, step, j, tubes):
            part_of_it = self.known | self.safe.any(axis=1)
            part_of_it[axes] = True
            # Those still open, once for all cells that differ along other axes only.
            some = np.logical_or.reduce(asked > bad, axis=axes_of(~part_of_it), keepdims=True)
            bad |= left_open(holds, some, np.where(self.known | ~part_of_it, 1, TILE))
        return bad & asked

    def questions(
        self, one: Clear, step: int, j: int, tubes: Tubes
    ) -> Iterator[tuple[list[int], Callable[[Array], Array]]]:
        """Yield what has to be asked: on which axes, and what tells of first and last cells if all is well."""
        # for `sampled.clear_of`, too
        for k in axes_of(one.ends):
            yield [k], partial(self.stays, k, tubes)
        for part in one.parts:
            if part.inputs is None or j in part.inputs:
                yield part.axes, partial(self.misses, part, step, tubes)

    def stays(self, k: int, tubes: Tubes, tiles: Array) -> Array:
        """Whether tubes from all cells of tiles pass no unsafe end: (M,)."""
        first, last = np.split(tiles, 2)
        low, high = self.whole(first, last, tubes)[:, k]
        robot, room = self.problem, self.room[k]
        # So near past an end counts as at it, as it does for the solver.
        return ((low >= robot.lower[k] - room) | ~self.unsafe[k, 0]) & (
            (high <= robot.upper[k] + room) | ~self.unsafe[k, 1]
        )

    def misses(self, part: Part, step: int, tubes: Tubes, tiles: Array) -> Array:
        """Whether tubes from all cells of tiles, the first and the last (2 ndim, M), miss an unsafe set: (M,) bool."""
        at, (first, last) = self.time(step), np.split(tiles, 2)
        single = bool((first == last).all())
        cuts = [at + cut for cut in self.cuts(1)] if part.moving else [self.always[0]] * self.parts + [self.always[1]]
        late = self.problem.jitter if part.moving else 0.0
        # once `near` for states that count as in a cell, once for the rounding of these sums
        box = self.whole(first, last, tubes) + OUT * 2 * self.near[:, None]
        good = self.outside(
            part, box[:, part.axes], (cuts[0] - late, cuts[-1] + late), WHOLE * (single and not part.moving)
        )
        if single and (left := np.flatnonzero(~good)).size:
            good[left] = self.misses_in_parts(part, first[:, left], cuts, late, tubes)
        return good

    def misses_in_parts(self, part: Part, cells: Array, cuts: list[float], late: float, tubes: Tubes) -> Array:
        """Whether tubes from cells (ndim, M) miss an unsafe set in each part of the interval: (M,) bool."""
        # What has left over a safe end earlier meets nothing any more.
        good, there = np.ones(cells.shape[1], np.bool_), self.not_gone(cells, tubes)
        ends, rows = self.ends(cells, 2 * self.near), tubes.rows[self.strides @ cells]
        for number, (begin, end) in enumerate(pairwise(cuts)):
            left = np.flatnonzero(good & there[number])
            box = (ends[:, :, left] + tubes.swept[number][:, :, rows[left]])[:, part.axes]
            times = (begin - late, end + late) if part.moving else self.always
            good[left] = self.outside(part, box, times)
        return good

    def whole(self, first: Array, last: Array, tubes: Tubes) -> Array:
        """The boxes (2, ndim, M) that tubes stay in from all cells from first to last, until they leave safely."""
        rows = tubes.rows[self.strides @ first]
        ends = np.array([self.ends(first)[0], self.ends(last)[1]])
        # of many cells as if none were ever gone: boxes are larger then, and less is proved
        if not self.safe.any() or (first != last).any():
            return ends + tubes.whole[:, :, rows]
        there = self.not_gone(first, tubes)[:, None, None]
        return ends + farthest(np.where(there, tubes.swept[..., rows], tubes.swept[:1][..., rows]))

    def not_gone(self, cells: Array, tubes: Tubes) -> Array:
        """In which parts tubes from cells may still be between the safe ends, (parts, M): once gone, gone."""
        gone, robot = np.zeros((self.parts, cells.shape[1]), np.bool_), self.problem
        for k in np.flatnonzero(self.safe.any(axis=1)):
            low, high = tubes.swept[:, :, k][..., tubes.rows[self.strides @ cells]].swapaxes(0, 1)
            # By more than the rounding of a state: so near past an end nothing has left yet.
            gone |= (self.edges[k][cells[k] + 1] + high < robot.lower[k] - self.near[k]) & self.safe[k, 0]
            gone |= (self.edges[k][cells[k]] + low > robot.upper[k] + self.near[k]) & self.safe[k, 1]
        return ~np.logical_or.accumulate(gone, axis=0)

    # ---- 9: the target

    def goals_hold(self, step: int, numbers: Array) -> Array:
        """Whether cells with flat numbers (M,) are inside the target and outside the unsafe sets at a step: (M,) bool.

        A set that is unsafe under some inputs only is not asked about.
        """
        late, at = self.problem.jitter, self.time(step)
        # Where sets are alike at all steps, a goal is proved for all times.
        times = self.always if self.alike else (at - late, at + late)
        box = self.ends(np.array(np.unravel_index(numbers, self.counts)), self.near + self.off)
        out = np.ones(len(numbers), np.bool_)
        for part in self.problem.unsafe:
            out &= part.inputs is not None or self.outside(part, box[:, part.axes], times)
        target = self.problem.target
        return out if target is None else out & self.inside(target, box[:, target.axes], times)

    def arrivals_hold(self, step: int, sites: Array, tubes: Tubes) -> Array:
        """Whether all of what the cells at sites (M,) are led to is in the target at the end of a step's interval."""
        target: Any = self.problem.target
        cells, at = self.cells_at(sites, self.sites), self.time(step + 1)
        moved = tubes.last[:, :, tubes.rows[self.strides @ cells]]
        box = self.ends(cells, 2 * self.near) + moved
        return np.isfinite(moved).all(axis=(0, 1)) & self.inside(target, box[:, target.axes], (at, at))

    # ---- 3: steps

    def do_not_grow(self) -> list[str]:
        """The sets that lack a cell of the one with a step less to go, or without a target have one more."""
        wrong = []
        for step, within in self.pairs:
            if within:
                rows = [self.row(step, within), self.row(step, within - 1)]
                less, more = rows if self.problem.target is None else rows[::-1]
                others = less != more  # the cells of one block are the same
                lacks = (self.pool[less[others]] & ~self.pool[more[others]]).any()
                wrong += [f"start {step}, within {within}"] * bool(lacks)
        return wrong

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """The steps k and the steps to go n of all sets."""
        if len(self.index) == 1:
            return [(0, 0), (0, 1)]
        steps = self.problem.steps
        return [(k, n) for k in range(1 if self.alike else steps + 1) for n in range(steps - k + 1)]

    def not_nearer(self, step: int, within: int, chosen: Array) -> Count:
        """The cells of S_k^n, n > 0, that no clear input leads into S_{k+1}^{n-1}, or the target itself, counted.

        With a target only of cells that S_k^{n-1} has not.
        """
        new = self.bits(step, within)
        if self.problem.target is not None:
            new = new & ~self.bits(step, within - 1)
        asked = new & chosen
        after = self.number(step + 1, within - 1)
        # Sums of a whole set take longest: none where nothing is asked.
        all_in = partial(self.all_in, self.sums(self.bits(step + 1, within - 1)) if asked.any() else None)
        wrong: list[int] = []
        for begin in range(0, new.size, SLAB * 8):
            some = begin + np.flatnonzero(asked[begin : begin + SLAB * 8])
            wrong += some[self.not_led(some, np.full(some.size, after), step, all_in)].tolist()
        return Count(int(new.sum()), int(asked.sum()), wrong, f"start {step}, within {within}, cell ")

    def not_led(self, numbers: Array, into: Array, step: int, all_in: AllIn) -> Array:
        """Which of cells with flat numbers (M,) no input leads into their sets in a step's interval: indices.

        into (M,) : of each cell the number of the set that it has to be led into.
        """
        left = np.arange(numbers.size)
        for j in range(self.problem.count):
            if left.size:
                left = left[~self.leads(numbers[left], into[left], step, j, all_in)]
        return left

    def leads(self, numbers: Array, into: Array, step: int, j: int, all_in: AllIn) -> Array:
        """Whether u_j is clear from cells, as of `not_led`, and leads all of each into its set, or the target: (M,).

        What has wholly left over a safe end by a cell counts as in the set.
        """
        cells = np.array(np.unravel_index(numbers, self.counts))
        out = self.is_clear(step, j, cells)
        left = np.flatnonzero(out)
        cells = cells[:, left]
        start, places = min(step, len(self.low) - 1), self.strides @ cells
        first, past = cells + self.low[start, j, places].T, cells + self.high[start, j, places].T + 1
        inside = all_in(first, past, into[left])
        # What has left over a safe end need not be in a set.
        for k in range(len(cells)):
            n = self.counts[k]
            inside |= (past[k] < 0) & self.safe[k, 0] | (first[k] > n) & self.safe[k, 1]
        if len(self.arrives):
            inside |= marked(self.arrives, step, j, self.sites @ cells)
        out[left] = inside
        return out

    def is_clear(self, step: int, j: int, cells: Array) -> Array:
        """From which of cells (ndim, M) u_j is clear in a step's interval: (M,) bool."""
        out = np.ones(cells.shape[1], np.bool_)
        for one in self.clear:
            out &= marked(one.bits, step, j, self.strides_of(one.own) @ cells)
        return out

    def sums(self, cells: Array) -> Array:
        """How many cells of a set lie below each corner; where an axis closes it goes on."""
        cells = cells.reshape(self.counts)
        for k in axes_of(self.problem.periodic):
            # so far past the seam as the widest image of the file, for `all_in`
            widest = int((self.high[..., k] - self.low[..., k].astype(np.int64)).max()) + 1
            cells = np.concatenate([cells, cells.take(range(min(widest, int(self.counts[k]))), axis=k)], axis=k)
        out = np.zeros([n + 1 for n in cells.shape], np.int32)
        out[(slice(1, None),) * cells.ndim] = cells
        for axis in range(cells.ndim):
            np.cumsum(out, axis=axis, out=out)
        return out

    def all_in(self, sums: Any, first: Array, past: Array, _: Any = None) -> Array:
        """As `AllIn`, of the one set that `sums` are of: it has as many of the cells of a box as there are.

        Boxes end with the grid, and go around where an axis closes.
        """
        # In the order of the corners: a bit of a corner's number tells whether it is the far one along an axis.
        below, size = [np.zeros(first.shape[1], np.int64)], np.ones(first.shape[1], np.int64)
        for k, (n, a, b) in enumerate(zip(self.counts.tolist(), first, past, strict=True)):
            if self.problem.periodic[k]:
                around, turns = b - a > n, a // n * n
                a, b = np.where(around, 0, a - turns), np.where(around, n, b - turns)
            else:
                a, b = np.clip(a, 0, n - 1), np.clip(b, 1, n)
            stride = math.prod(sums.shape[k + 1 :])
            below = [at + side for at in below for side in (a * stride, b * stride)]
            size *= b - a
        flat, counted = sums.ravel(), np.zeros(first.shape[1], np.int64)
        for corner, at in enumerate(below):
            # Inclusion and exclusion over the corners of the box.
            counted += flat[at] * (-1) ** (first.shape[0] - corner.bit_count())
        return counted == size

    # ---- all claims

    def promised(self, step: int | None) -> Array:
        """The cells that some S_k^n with n >= 1 has, without a target S_k^1, of a step k or of any: (*counts) bool."""
        total, one = self.problem.steps, self.problem.target is None
        steps = range(total) if step is None else [step]
        out = np.zeros(math.prod(self.counts.tolist()), np.bool_)
        for k in steps[:1] if self.alike else steps:
            out |= self.bits(k, 1 if one else total - k)  # the largest, as `do_not_grow` says
        return out.reshape(self.counts)

    def moves_claimed(self, step: int | None) -> Array:
        """The cells whose moves are claimed: those that are `promised`, but all where a controller remembers."""
        # the point that it carries on from any cell may lie in one that is promised
        return np.broadcast_to(np.True_, self.counts) if self.problem.memory else self.promised(step)

    def claims(
        self, every: bool = False, samples: int | None = None, seed: int = 0, bar: Bar = silently
    ) -> Iterator[Claim]:
        """Yield all claims, checked; arguments as of `sdhj.certified.check.verify`.

        Only the first where cells do not cover the axes. What needs whole arrays is checked whole, also for samples.
        """
        wrong = self.uncovered()
        yield Claim(COVER, self.problem.ndim, self.problem.ndim, wrong)
        # Of cells that do not cover the grid no other claim would mean anything.
        if wrong:
            return
        # `sampled.claims_made` counts the same claims without looking at them: a kind that is added here is added there
        chosen = np.broadcast_to(np.True_, self.counts)  # which takes no memory
        if samples is not None:
            chosen = np.zeros(self.counts, np.bool_)
            some = np.random.default_rng(seed).choice(chosen.size, min(samples, chosen.size), False)
            chosen.reshape(-1)[some] = True
        if self.problem.sensed:
            yield Claim(PREDICTED, self.problem.count, self.problem.count, self.far_off())
        yield from self.claims_of_inputs(every, chosen, bar)
        yield Claim(GROW, len(self.pairs), len(self.pairs), self.do_not_grow())
        yield from self.claims_of_sets(chosen.reshape(-1), bar)
        if self.problem.trusted:
            yield Claim(f"rests on what is stated of {', '.join(sorted(self.problem.trusted))}", 0, 0, [])

    def claims_of_inputs(self, every: bool, chosen: Array, bar: Bar) -> Iterator[Claim]:
        """Yield the claims of where inputs lead, from where they are clear, and which lead into the target itself."""
        tasks = [*np.ndindex(self.low.shape[:2])]
        found = {MOVES: Count(), CLEAR: Count(), ARRIVE: Count()}
        # the cells of which something is claimed: the same for every input
        of_step = lru_cache(maxsize=4)((lambda _: np.broadcast_to(np.True_, self.counts)) if every else self.promised)
        with ThreadPoolExecutor(self.together(len(tasks))) as pool:
            # Each task counts for itself and is added up here, in one thread.
            made = pool.map(lambda task: self.of_an_input(task[0], task[1], of_step, chosen), tasks)
            for each in bar(made, "moves", len(tasks)):
                for name, one in each.items():
                    found[name].add(one)
        yield from (own.claim(name) for name, own in found.items() if name != ARRIVE or len(self.arrives))

    def of_an_input(self, start: int, j: int, of_step: OfStep, chosen: Array) -> dict[str, Count]:
        """What is claimed of moves, clear inputs and arrivals under u_j from `start` on, counted by name.

        What `take_out` does not prove, by finer and finer pieces of the interval, has failed.
        """
        found = {MOVES: Count(), CLEAR: Count(), ARRIVE: Count()}
        left = self.to_be_asked(start, j, of_step, chosen, found)
        with np.errstate(all="ignore"):
            for pieces in FINENESS:
                self.take_out(start, j, pieces, left)
        for one in left:
            found[one.name].add(Count(failed=np.flatnonzero(one.cells), what=f"{one.what} "))
        return found

    def to_be_asked(
        self, start: int, j: int, of_step: OfStep, chosen: Array, found: Mapping[str, Count]
    ) -> list["Asked"]:
        """What is said of promised and chosen cells, with what is said in all counted into `found`."""
        out = []
        for one, step in self.said(start, j):
            promised = self.moves_claimed(step) if one.name == MOVES and self.problem.memory else of_step(step)
            others = axes_of(~one.axes)
            made = one.cells & promised.any(axis=others, keepdims=True)
            asked = one.cells & (promised & chosen).any(axis=others, keepdims=True)
            count = Count(int(made.sum()), int(asked.sum()))
            count.beside = int(one.cells.sum()) - count.made
            found[one.name].add(count)
            out.append(one._replace(cells=asked))
        return out

    def said(self, start: int, j: int) -> Iterator[tuple["Asked", int | None]]:
        """Yield what the file says of u_j in the interval from `start`, and of which step, or None: of all alike."""

        def each_step(marks: Array) -> Iterator[tuple[int, int | None]]:
            # where moves are the same from each step, of all that there are answers for
            for step in range(len(marks)) if len(self.low) == 1 else [start][: len(marks)]:
                yield step, None if len(marks) == 1 else step

        def asked(name: str, what: str, axes: Array, said: Array, fails: Any) -> Asked:
            return Asked(name, what, axes, said.reshape(np.where(axes, self.counts, 1)), fails)

        places, only = np.ones(self.low.shape[2], np.bool_), None if len(self.low) == 1 else start
        hold = partial(failing, partial(self.moves_hold, start, j))
        yield asked(MOVES, f"start {start}, input {j}, place", self.known, places, hold), only
        for one in self.clear:
            axes = ", ".join(self.problem.names[k] for k in axes_of(one.own))
            for step, only in each_step(one.bits):
                what, fails = f"start {step}, input {j}, cell of {axes}", partial(self.not_clear, one, step, j)
                yield asked(CLEAR, what, one.own, marked(one.bits, step, j), fails), only
        for step, only in each_step(self.arrives):
            fails = partial(failing, partial(self.arrivals_hold, step))
            said = marked(self.arrives, step, j)
            yield asked(ARRIVE, f"start {step}, input {j}, site", self.sites > 0, said, fails), only

    def take_out(self, start: int, j: int, pieces: int, left: Sequence["Asked"]) -> None:
        """Take out of what is open, in place, what bounds so fine prove."""
        needed = np.zeros(self.low.shape[2], np.bool_)
        for one in left:  # cells that are alike are at the first of their places
            at = np.nonzero(one.cells.any(axis=axes_of(~self.known), keepdims=True))
            needed[self.strides @ np.array(at)] = True
        numbers = np.flatnonzero(needed)
        for places in np.array_split(numbers, -(-numbers.size // PLACES)) if numbers.size else ():
            tubes, here = self.tubes(places, j, start, pieces), np.zeros(needed.size, np.bool_)
            here[places] = True
            here = here.reshape(np.where(self.known, self.counts, 1))
            for one in left:
                own = one.cells & here[tuple(slice(None) if k else slice(1) for k in one.axes)]
                if own.any():
                    one.cells[own] = one.fails(own, tubes)[own]

    def claims_of_sets(self, chosen: Array, bar: Bar) -> Iterator[Claim]:
        """Yield the claims of cells."""
        goals, nearer = Count(), Count()
        with ThreadPoolExecutor(self.together(len(self.pairs))) as pool:
            made = pool.map(lambda pair: self.of_a_set(pair[0], pair[1], chosen), self.pairs)
            for (_, within), one in zip(self.pairs, bar(made, "sets", len(self.pairs)), strict=True):
                (nearer if within else goals).add(one)
        yield from (goals.claim(GOALS), nearer.claim(NEARER))

    def of_a_set(self, step: int, within: int, chosen: Array) -> Count:
        """What is claimed of the cells of S_k^n, counted."""
        if within:
            return self.not_nearer(step, within, chosen)
        here = self.bits(step, 0)
        asked = np.flatnonzero(here & chosen)
        # What overflows is not finite and proves nothing, so that nobody need be warned.
        with np.errstate(all="ignore"):
            bad = asked[~in_slabs(partial(self.goals_hold, step), asked)]
        return Count(int(here.sum()), asked.size, bad, f"start {step}, within 0, cell ")


def farthest(swept: Array) -> Array:
    """The farthest displacements (2, ndim, M) of all parts, (parts, 2, ndim, M)."""
    return np.array([swept[:, 0].min(axis=0), swept[:, 1].max(axis=0)])


def some_of(what: str, given: Any, count: int) -> Array:
    """An entry that must be a list of numbers below `count`, each once: which ones."""
    fits = isinstance(given, list) and all(is_whole(one, 0, count - 1) for one in given)
    expect(fits and len({*given}) == len(given), f"{what} must be numbers below {count}, each once", given)
    return np.isin(np.arange(count), given)


def axes_of(some: Array) -> tuple[int, ...]:
    """The axes that are True in `some`."""
    return tuple(np.flatnonzero(some).tolist())


def in_tiles(some: Array, tiles: Array) -> Array:
    """Which tiles have any cell that is True in `some`."""
    for k, size in enumerate(tiles.tolist()):
        if size > 1:
            some = np.logical_or.reduceat(some, np.arange(0, some.shape[k], size), axis=k)
    return some


def spread(tiles: Array, shape: Sequence[int]) -> Array:
    """The truth values of tiles for the smaller ones that they are cut into."""
    for k, n in enumerate(shape):
        tiles = np.repeat(tiles, -(-n // tiles.shape[k]), axis=k)[(slice(None),) * k + (slice(n),)]
    return tiles
