"""The claims of a file for a robot of one's own, derived anew by its formulas over boxes (`intervals`).

1.  *Moves.* From anywhere in the cells at a place each input leads into the cells that the file says: `driven` follows
    the ends of the box in ever shorter pieces until what they reach lies inside.
2.  *Clear.* Where the file says that an input is clear from a cell, every unsafe set's function is above zero in boxes
    that the cell sweeps; boxes for which this is open are halved along each axis, `DEEPEST` times. Blocks of cells that
    move alike are looked at first, and cells one by one where that leaves it open.
3.  *Goals* are inside the target and outside the unsafe sets at t_k, halved as there.
4.  *Into the target itself.* Where the file says so of an input and a cell's site, its part of a cell that moves and
    target depend on, the target's function is at most zero at t_{k+1} in the box that the cell is led into.
5.  *Steps.* For every new cell of S_k^n an input is clear and its cells, counted, are all in S_{k+1}^{n-1}, or it leads
    into the target itself: outside the unsafe sets it then is, being clear at the end of the interval, too.

Of what has wholly left over a safe end nothing more is asked.

A place is the part of a cell that its moves depend on; on the other axes the velocity is bounded wherever the state may
be. A black box is bounded by what its author states of it (`described`), which the verdict says; what is not so at some
state of a box is refused. Nothing that the file itself states of bounds is believed.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from functools import cached_property, partial
from itertools import pairwise, product
from typing import Any

import numpy as np
from tqdm import tqdm

from sdhj.certified.check.bits import Array, flags_of, number_of, numbers_of, packed, unpacked
from sdhj.certified.check.claims import ARRIVE, COVER, GOALS, GROW, NEARER, Claim
from sdhj.certified.check.counts import Spans, flags_at, led_into, spans_of, strides_of, sums, tubes_miss
from sdhj.certified.check.described import BlackBox, Functions, Grid, Part, Times, Velocity
from sdhj.certified.check.files import Arrays
from sdhj.certified.check.formulas import Formula
from sdhj.certified.check.lattice import Lattice, memory, pieces_of
from sdhj.certified.check.reading import (
    MOST_COUNTED,
    MOST_STEPS,
    SMALLEST,
    Sensing,
    Sets,
    array,
    decimal,
    expect,
    is_whole,
    real,
    reals,
)
from sdhj.certified.check.windows import AtOnce, worth_while

# Shares of the largest coordinate of an axis, of which one rounding is 2^-53 at most: so these hold in any units.
NEAR = 1e-10  # a state so near to a cell counts as in it
STICKS_OUT = 2e-13  # of a cell, what an image may; and what rounding here adds  # check 3.27
ROUNDED = 1e-15  # a difference of two coordinates
AT_FIRST = 1e-7  # of an interval, until a state that counts as in a layer is held by the wall
FINENESS = 1, 8  # pieces of a part, at first and where that leaves something open
WIDER = 1.02  # than expected, boxes are to hold all that is reached in a piece
DEEPEST = 6
NEAREST = 8  # times that boxes are halved to tell how near predictions stay
STRIDES = 8  # in which a controller moves a measurement on
BOXES_AT_ONCE = 1 << 16  # boxes
SLAB = 1 << 14  # cells whose tubes are bounded at once
HALVES_AT_ONCE = 1 << 12
NUMBERS_AT_ONCE = 1 << 22  # cells of several inputs
FEW = 8  # cells in one that is looked at are too many to be counted
MOST_INPUTS = 1 << 16
FIELDS = {"parts", "own", "unsure", "arrives"}  # of a proof
ROOM = 1e-6  # of the spacing of nodes: so near past an unsafe end counts as at it  # check 4.37
OUTWARD = np.array([-1.0, 1.0])[:, None, None]

# of boxes (2, M, axes) to where something holds all over them, and where it nowhere does, both (M,) bool
Holds = Callable[[Array], tuple[Array, Array]]
# of boxes, both (M, axes), and their numbers to bounds of a function there
Bounds = Callable[[Array, Array, Array], tuple[Array, Array]]


class Unbounded(ValueError):
    """No bounds were found on where states can be, in pieces of some length."""


def column_major(boxes: Array) -> Array:
    """Boxes (2, M, ndim) with each coordinate of all of them in one piece of memory.

    Results have the layout of their operands; what is one number for all boxes is then applied to long rows.
    """
    return np.ascontiguousarray(boxes.swapaxes(1, 2)).swapaxes(1, 2)


def everywhere(holds: Holds, boxes: Array, along: Array, depth: int) -> Array:
    """Whether something is proved to hold all over boxes (2, M, axes), which stay as they are: (M,) bool.

    holds : called with boxes (2, m, axes); returns where it holds all over, and where it surely does not, (m,) bool
        each (`Holds`). A box for which both are False is halved along each of the axes `along`.
    along (axes,) : bool; if none is True no box is halved. depth : how many times a box is halved along each, at most;
        what is open then counts as not proved.
    """
    count, depth = boxes.shape[1], depth if along.any() else 0
    out, left = np.ones(count, np.bool_), [(boxes, np.arange(count), depth)]
    while left:
        some, of, more = left.pop()
        some, of = some[:, out[of]], of[out[of]]
        yes, no = holds(some)
        out[of[no if more else ~yes]] = False  # check 3.38
        for axis in np.flatnonzero(along) if more else ():
            some, of = some[:, (open_ := ~yes & out[of])], of[open_]
            centre = some.mean(axis=0)[:, axis]
            some, of, yes = np.concatenate([some] * 2, axis=1), np.tile(of, 2), np.zeros(2 * of.size, np.bool_)
            some[1, : centre.size, axis] = some[0, centre.size :, axis] = centre  # check 4.29
        begins = range(0, of.size if more else 0, HALVES_AT_ONCE)
        left += [(some[:, at : at + HALVES_AT_ONCE], of[at : at + HALVES_AT_ONCE], more - 1) for at in begins]
    return out


def by_slabs(holds: Callable[[Array], Array], numbers: Array) -> Array:
    """holds(numbers), (M, ...), called with at most `BOXES_AT_ONCE` of the numbers (M,) at a time, to bound memory.

    holds : from numbers (m,) to an array (m, ...), one entry for each. It is called once with none where M is 0.
    """
    begins = range(0, max(len(numbers), 1), BOXES_AT_ONCE)
    return np.concatenate([holds(numbers[begin : begin + BOXES_AT_ONCE]) for begin in begins])


class Robot(Sets):
    """A robot of one's own as a file describes it: its functions over boxes, its cells, and the sets of these.

    `claims` checks all that the file says of them. ValueError, here or in a method, where the file does not fit
    together.

    known (ndim,) : bool, along which axes the moves depend on the cell. A place is a cell of these axes alone, numbered
        cell @ strides.
    low, high (starts, inputs, places, ndim) int16 : the moves, the first and the last cell that an input leads to, less
        the cell's own index. starts is 1 where the velocity does not depend on time.
    clear (starts, cells, bytes) uint8 : under which inputs the file says that a cell is clear, a bit each.
    off (ndim,) : E, how far a prediction may be off, by the file.
    delta, delay, jitter, length : the interval, what `Sensing` says, and the longest interval, delta + 2 jitter, s.
    near (ndim,) : how far off a cell a state counts as in it.
    room (ndim,) : how far past an unsafe end a tube counts as at it.
    clips (2, ndim) : the ends of the grid along bounded axes, infinite along periodic ones.
    target, unsafe : a `Part` or None, and a list of `Part`.
    trusted : the names of functions of which the check believes what their author states.
    """

    def __init__(self, head: Mapping[str, Any], arrays: Arrays, problem: Any) -> None:
        """Read the problem of a file, its cells, its proof and its sets; ValueError where a part does not fit.

        head, arrays : of the file. problem : has the black boxes (`black_box(name)`), or is None.
        """
        self.grid, self.steps, self.count = Grid(head["grid"]), head["steps"], len(head["inputs"])
        # check 7.36
        expect(is_whole(self.steps, 1, MOST_STEPS), f"steps must be a number up to {MOST_STEPS}", self.steps)
        expect(1 <= self.count <= MOST_INPUTS, f"there must be 1 to {MOST_INPUTS} inputs", self.count)  # check 7.35
        self.delta = real("delta", head["delta"], SMALLEST)
        self.scale = np.maximum(np.abs(self.grid.lower), np.abs(self.grid.upper))
        self.near, self.room = NEAR * self.scale, ROOM * np.array(self.grid.spacing)
        self.sensing = Sensing(head.get("sensing", {}), self.grid.ndim, self.delta)
        functions = Functions(head, arrays, problem)
        self.moves = Velocity(functions, head["inputs"], self.grid)
        self.target, self.unsafe = functions.parts(head["sets"], self.grid.ndim, self.count)
        self.trusted = functions.opaque.keys() & {"drift", "gain", "bounds", "velocity"}  # what is stated of these
        self.delay, self.jitter, self.error = self.sensing.delay, self.sensing.jitter, self.sensing.error
        # check 7.15
        expect(
            not (self.jitter and self.moves.depends_on_time),
            "with jitter the velocity must not depend on time",
            self.jitter,
        )
        self.length = self.delta + 2 * self.jitter  # of an interval, at most  # check 3.14
        self.always = 0.0, self.time(self.steps) + self.jitter
        self.has_no_target, self.periodic = self.target is None, self.grid.periodic
        whole = np.array([self.grid.lower, self.grid.upper])
        self.clips = np.where(self.periodic, np.array([[-np.inf], [np.inf]]), whole)
        self.safe = np.array([[end == "safe" for end in ends] for ends in self.grid.ends])
        super().__init__(head["cells"], arrays, self.grid.ndim, self.grid.ndim - 1, None)
        self.read_proof(head["proof"], arrays, bool(head["details"].get("endless")))
        self.lattices, self.boxes_met = dict[int, Lattice](), dict[tuple[int, int], list[Array]]()
        self.cell_strides = strides_of(tuple(self.counts.tolist()))
        axes = [part.axes for part in self.unsafe]
        many = worth_while(self.counts.tolist(), self.known.tolist(), self.count, axes)
        self.at_once = AtOnce(self) if many else None

    @staticmethod
    def bytes_needed(head: Mapping[str, Any], arrays: Arrays, samples: int | None) -> int:
        """About the bytes of memory that a check takes, by the sizes of cells, places, parts and arrays: an estimate.

        What is measured is less than half as much again. The file is not checked here: LookupError or TypeError where
        an entry is missing or of another kind.

        head, arrays : of the file. samples : how many cells are drawn, None: all are checked.
        """
        # First for moves: for each cell flags, for each that is looked at its number, place and row, some of them
        # twice; for each place what a box sweeps in each part, and for a slab of them all that is made meanwhile; for
        # each site of arrivals flags. Then for sets: for each cell whether it is in some, and sums, doubled where axes
        # close.
        counts, flags, parts = head["cells"]["shape"], head["proof"]["own"], head["proof"]["parts"]
        ndim, cells = len(counts), math.prod(counts)
        places = math.prod(n for n, flag in zip(counts, flags, strict=False) if flag)
        chosen = cells if samples is None else min(samples, cells)
        looks = arrays.shape("clear")[0] if arrays.shape("low")[0] == 1 else 1  # steps that are looked at together
        inputs, boxes = arrays.shape("low")[1], min(places, chosen)
        several = max(boxes, min(boxes * inputs, BOXES_AT_ONCE))
        swept = several * (16 * ndim * (parts + 1) + 32) + min(several, BOXES_AT_ONCE) * 16 * ndim * (parts + 5)
        swept += 4 * arrays.shape("arrives")[1] if head["proof"].get("arrives") else 0
        of_a_set = cells * (7 + 5 * 2 ** sum(map(bool, head["grid"]["periodic"])))
        unsafe = [one["axes"] for one in head["sets"] if one["kind"] == "unsafe"]
        if len(flags) == ndim and worth_while(counts, flags, inputs, unsafe):
            # of each input what is packed of cells, and of some boxes; of sets, too
            of_a_set = cells * (6 if places == 1 else 7 + 5 * 2 ** sum(map(bool, head["grid"]["periodic"])))
            return arrays.nbytes + max(cells * 2 + chosen * 10 + cells // 4 * inputs, of_a_set) + swept
        swept += 8 * min(chosen * looks * inputs, NUMBERS_AT_ONCE) + min(places * inputs, BOXES_AT_ONCE)
        lattices = 0
        for number, one in enumerate(one for one in head["sets"] if one["kind"] == "unsafe"):
            moving = "p 0" in head["formulas"]["functions"].get(f"unsafe {number}", ["p 0"])
            axes = [axis for axis in range(ndim) if axis in one["axes"]]
            laps = sum(bool(head["grid"]["periodic"][axis]) for axis in axes)
            times = arrays.shape("clear")[0] * (parts + 1) if moving else 1
            lattices += memory([counts[axis] for axis in axes], laps, times, parts if moving else 1)
        lattices = (lattices + 40 * chosen) * (chosen * FEW >= cells)  # and numbers, rows of what is looked up, twice
        return arrays.nbytes + max(cells * (3 + looks) + chosen * (28 + 8 * looks), of_a_set) + swept + lattices

    def read_proof(self, stated: Mapping[str, Any], arrays: Arrays, endless: bool) -> None:
        """Read what the proof says of the cells: the axes of a place, moves, clear inputs, arrivals, and E.

        Into the attributes of the class, by `__init__`, after cells and sets. ValueError where an array does not fit
        the problem.

        stated : the proof's part of the head. arrays : the open file. endless : whether sets are said to hold for ever.
        """
        unknown = sorted(stated.keys() - FIELDS)
        expect(not unknown, "the proof must have no unknown field", unknown)  # check 7.50
        ndim, self.parts, flags, timed = self.grid.ndim, stated["parts"], stated["own"], self.moves.depends_on_time
        # check 7.37
        expect(is_whole(self.parts, 1, MOST_COUNTED), f"parts must be a number up to {MOST_COUNTED}", self.parts)
        fits = len(flags) == ndim and {True, False}.issuperset(flags)
        expect(fits, f"the problem has {ndim} axes", flags)  # check 7.40
        self.known = np.array(flags, np.bool_)
        self.strides = np.where(self.known, np.cumprod([1, *np.where(self.known, self.counts, 1)[:0:-1]])[::-1], 0)
        self.off = np.array(reals("unsure", stated["unsure"], ndim, 0.0))  # check 7.41
        # check 7.16
        expect(bool((self.off >= self.error).all()), f"predictions are off by {self.error} at least", self.off)
        moving, pairs = (
            timed or any(unsafe_set.moving for unsafe_set in self.unsafe),
            (self.steps + 1) * (self.steps + 2) // 2,
        )
        moves = self.steps if timed else 1, self.count, math.prod(self.counts[self.known].tolist()), ndim  # check 7.12
        self.low, self.high = (array(arrays, name, np.int16, *moves) for name in ("low", "high"))
        self.sticks = STICKS_OUT
        clear = self.steps if moving else 1, math.prod(self.counts.tolist()), -(-self.count // 8)
        self.clear = array(arrays, "clear", np.uint8, *clear)
        self.sites, self.arrives = self.read_arrivals(stated, arrays)
        self.time_invariant = len(self.index) != pairs
        fits = not self.time_invariant or (not moving and len(self.index) in (1, self.steps + 1))  # check 7.13
        fits = fits and (self.target is not None or not endless or len(self.index) == 1)
        # check 7.14
        expect(bool(fits and (self.low <= self.high).all()), "arrays must be of the problem", self.index.shape)

    def read_arrivals(self, stated: Mapping[str, Any], arrays: Arrays) -> tuple[Array, Array]:
        """The strides of sites (ndim,), and which inputs lead into the target itself, (starts, sites, bytes) uint8.

        A site is the part of a cell on the axes that moves or target depend on, numbered sum(cell * strides); input j
        is bit j % 8 of byte j // 8. Where the proof states none the strides are 0 and the array has length 0.
        ValueError without a target, and with sensing that is uncertain: then nothing may lead into the target itself.

        stated : the proof's part of the head. arrays : the open file.
        """
        if not stated.get("arrives"):
            return np.zeros(len(self.counts), np.int64), np.zeros((0, 0, 0), np.uint8)
        # who measures does not know that he is in the target but by the cells of a goal
        fits = self.target is not None and not self.sensing  # check 7.55
        expect(fits, "only states that are known may be led into a target itself", stated["arrives"])
        assert self.target is not None
        some = self.known.copy()
        some[list(self.target.axes)] = True  # check 5.17
        counts = np.where(some, self.counts, 1)
        starts = self.steps if self.moves.depends_on_time or self.target.moving else 1  # check 5.18
        strides = np.where(some, np.cumprod([1, *counts[:0:-1]])[::-1], 0)
        return strides, array(arrays, "arrives", np.uint8, starts, math.prod(counts.tolist()), -(-self.count // 8))

    def faults_of_cells(self) -> list[str]:
        """The faults of the cells, a text each; [] if there are none.

        Cells must cover every axis, and a layer must be at a wall. The head says which axes moves do not depend on:
        along each of these all cells must be equally wide, and it may end at a wall only where all velocities along it
        are the same in every state.
        """
        grid, ends = self.grid, []
        for lower, upper, periodic in zip(grid.lower, grid.upper, grid.periodic, strict=True):
            length = decimal(upper) - decimal(lower)
            ends.append((decimal(lower), length, length, length / 2**40 if periodic else Fraction(0)))  # check 1.4
        wrong = self.uncovered(ends)
        for k, side in product(range(len(ends)), (0, 1)):
            at_wall = grid.ends[k][side] == "wall" and not grid.periodic[k] and self.known[k]  # check 1.7
            wrong += [] if at_wall or not self.layers[k][side] else [f"axis {k}: a layer where no wall holds"]
        for axis in np.flatnonzero(~self.known):
            n, (_, width, _, most) = int(self.counts[axis]), self.axes[axis]
            free = "wall" not in grid.ends[axis] or self.moves.steady(int(axis), bool(self.sensing))
            # check 1.5
            alike = abs(n * width - most) <= STICKS_OUT * float(self.scale[axis]) if self.periodic[axis] else free
            wrong += [] if alike else [f"axis {axis}: its cells do not move alike"]
        return wrong

    def time(self, step: int) -> float:
        """When the input of a step begins to act, s, apart from jitter: step * delta + delay."""
        return step * self.delta + self.delay  # check 4.41

    def ends(self, cells: Array, wider: Any = 0.0) -> Array:
        """The lower and the upper corners of cells (M, ndim), indices, moved outward by `wider`: (2, M, ndim).

        wider : (ndim,), or a number.
        """
        beside = [[edge[own + side] for edge, own in zip(self.edges, cells.T, strict=True)] for side in (0, 1)]
        return np.array(beside).swapaxes(1, 2) + OUTWARD * wider

    def cells(self, numbers: Array) -> Array:
        """The cells, indices (M, ndim), with flat numbers (M,), the last axis fastest."""
        return np.stack(np.unravel_index(numbers, self.counts), axis=1)

    # ---- functions over boxes (2, M, axes), and times

    def value(self, part: Part, one: Formula | BlackBox, box: Array, times: Any) -> tuple[Array, Array]:
        """Bounds of one function of a set over boxes (2, M, axes) and times, s to s: both (M,), infinite where unknown.

        one : one of `part.least_of`, or `part.function`. If it is a black box, the set's name is added to `trusted`.
        times : from and to, numbers, or arrays (M,); a black box takes numbers only.
        """
        if isinstance(one, BlackBox):
            self.trusted.add(part.name)  # check 1.15

        def bounds(low: Array, high: Array, of: Array) -> tuple[Array, Array]:
            """Of parts of boxes, whose times are those of the boxes."""
            own = tuple(time[of] if np.ndim(time) else time for time in times)
            return one.bounds(low, high, own)

        least, most = self.cut(part.axes, box, bounds)
        return least[:, 0], most[:, 0]

    def velocity(self, j: Any, box: Array, times: Times, pushed: bool = True) -> tuple[Array, Array]:
        """Bounds of the velocity under u_j over boxes (2, M, ndim) and times: both (M, ndim), infinite where unknown.

        times : s to s. j : an index, or (M,). pushed : under any adversary; if False, under none.
        """
        axes, inputs = range(len(self.counts)), np.broadcast_to(j, box.shape[1])
        # check 3.84
        return self.cut(axes, box, lambda low, high, of: self.moves.bounds(inputs[of], low, high, times, pushed))

    def cut(self, axes: Iterable[int], box: Array, bounds: Bounds) -> tuple[Array, Array]:
        """Bounds of a function over the parts of boxes (2, M, axes) that are on the grid: both (M, ...).

        A box is clipped at bounded ends, and bounded in two halves where a periodic axis closes. Infinite where nothing
        is known.

        axes : the axes of the grid that the boxes have, in that order.
        bounds : called with the lower and the upper corners (m, axes) of pieces, and with the index (m,) of the box
            that each belongs to (`Bounds`).
        """
        box, grid, count, halves = box.copy(order="K"), self.grid, box.shape[1], list[tuple[Array, int]]()
        of, columns = np.arange(count), list(axes)
        np.clip(box, self.clips[0, columns], self.clips[1, columns], out=box)
        for column, axis in enumerate(columns):
            if not self.periodic[axis]:
                continue
            least, most, (a, b) = grid.lower[axis], grid.upper[axis], box[:, :, column]
            full, turns = b - a >= most - least, np.floor((a - least) / (most - least)) * (most - least)  # check 4.43
            a[:], b[:] = np.where(full, least, np.maximum(a - turns, least)), np.where(full, most, b - turns)
            if (over := np.flatnonzero(b > most)).size:
                second = box[:, over]
                second[0, :, column], second[1, :, column] = least, b[over] - (most - least)
                b[over] = most
                halves.append((over, len(of)))
                box, of = np.concatenate([box, second], axis=1), np.concatenate([of, of[over]])  # check 3.85
        low, high = bounds(box[0], box[1], of)
        for over, begin in reversed(halves):
            own = slice(begin, begin + len(over))
            # check 4.42
            low[over], high[over] = np.minimum(low[over], low[own]), np.maximum(high[over], high[own])
        low, high = low[:count], high[:count]
        return np.where(np.isnan(low), -np.inf, low), np.where(np.isnan(high), np.inf, high)

    # ---- predictions

    def known_within(self) -> list[str]:
        """A text for each input and stride of the delay in which a prediction may be off by more than the file says.

        [] if there is none, as without a delay. The delay is cut into `STRIDES` strides (`stays_near`).
        """
        # What is measured is moved on in strides, each by an average of undisturbed velocities at points no farther
        # from where the stride began than the fastest state gets meanwhile. The state is as near to what was measured
        # then.
        allowed, wrong, stride = self.off - self.error, [], self.delay / STRIDES  # check 3.37
        places = self.cells_at(np.arange(int(np.prod(self.counts[self.known]))))
        boxes = np.where(self.known, self.ends(places), np.array([self.grid.lower, self.grid.upper])[:, None])
        cuts = [
            (self.time(step) - self.delay + stride * part, self.time(step) - self.delay + stride * (part + 1))
            for step, part in product(range(self.steps), range(STRIDES))
        ]
        inputs = range(self.count if self.delay else 0)  # check 3.41
        for j, times in product(inputs, cuts if self.moves.depends_on_time else cuts[:1]):  # check 3.42
            slow, fast = self.velocity(j, boxes, times)
            travel = [np.minimum(slow, 0).min(axis=0), np.maximum(fast, 0).max(axis=0)]  # check 3.40
            if not self.stays_near(j, boxes, times, allowed, stride * np.array(travel)[:, None]).all():
                wrong.append(f"input {j}, from {times[0]:.3g} s on")
        return wrong

    # ---- moves

    def cells_at(self, places: Array, strides: Array | None = None) -> Array:
        """A cell (M, ndim) at each place (M,): the one with index 0 on the axes that are no place's.

        strides (ndim,) : those by which `places` are numbered; None: the robot's. Those of sites make cells of sites.
        """
        own = zip((self.strides if strides is None else strides).tolist(), self.counts.tolist(), strict=True)
        return np.stack([places // stride % n if stride else 0 * places for stride, n in own], axis=1)

    def boxes(self, places: Array) -> Array:
        """The boxes (2, M, ndim) of states that count as at places (M,): cells with the shell around them.

        Whole, from end to end of the grid, along axes that are no place's.
        """
        whole = np.array([self.grid.lower, self.grid.upper])[:, None]
        return np.where(self.known, self.ends(self.cells_at(places), self.near), whole)  # check 3.26

    def driven(self, places: Array, j: Any, start: float, pieces: int) -> tuple[Array, Array]:
        """How far the ends of the boxes at places (M,) move in the interval from `start`, s: (swept, last).

        Displacements of the lower and the upper ends, rounded outward: with them added a box holds all that can be
        reached, whatever the adversary does. `Unbounded` where no bounds are found.

        swept (M, parts, 2, ndim) : the farthest in each part of the interval.
        last (2, M, ndim) : at the interval's end, whenever that is, to what is then predicted or carried on.
        j (M,) : for each place the index of the input that acts. pieces : into how many each part is cut.
        """
        grid, at = self.grid, column_major(self.boxes(places))
        walls = np.array([[end == "wall" for end in ends] for ends in grid.ends]).T & ~self.periodic & self.known
        bars = np.where(walls[0], grid.lower, -np.inf), np.where(walls[1], grid.upper, np.inf)
        swept = np.moveaxis(np.empty((self.parts, 2, grid.ndim, len(places))), 3, 0)
        marks = np.arange(self.parts * pieces + 1)
        cuts, soonest = self.length * marks / (self.parts * pieces), self.length - 4 * self.jitter  # check 3.15

        def held(moved: Array) -> Array:
            """Displacements (2, M, ndim) of the boxes' ends, stopped where a wall is reached, rounded outward."""
            if not walls.any():
                return moved
            stopped = np.clip(at + moved, *bars)  # check 3.18
            return np.where(stopped == at + moved, moved, stopped - at + OUTWARD * ROUNDED * self.scale)

        off = np.where(self.known_at_wall(places), 0.0, self.off)
        moved = held(np.zeros_like(at) + OUTWARD * off)  # check 3.9
        least, most = moved  # of all that may be its end
        rate = faster = np.zeros_like(moved)  # of the piece before, outward, and by how much more than in that before
        for part in range(self.parts):
            a, b = moved
            own = cuts[part * pieces : (part + 1) * pieces + 1]
            soon = [self.length * AT_FIRST] if part == 0 and any(map(any, self.layers)) else []  # check 1.11
            for begin, end in pairwise(np.unique([*own, *soon, np.clip(soonest, own[0], own[-1])]).tolist()):
                if begin <= soonest:  # check 3.17
                    least, most = moved
                far = OUTWARD * (end - begin) * np.maximum(rate + np.maximum(faster, 0.0), 0.0)
                before = moved
                # check 3.19
                moved = held(self.piece(at + self.known * moved, moved, j, (start + begin, start + end), far))
                now = OUTWARD * (moved - before) / (end - begin)
                rate, faster = now, now - rate
                a, b = np.minimum(a, moved[0]), np.maximum(b, moved[1])  # check 4.28
                least, most = np.minimum(least, moved[0]), np.maximum(most, moved[1])  # check 3.16
            swept[:, part, 0], swept[:, part, 1] = a, b
        last = np.stack([least, most]) if self.jitter else moved
        if not self.sensing.memory:  # check 3.11
            return swept, held(last + OUTWARD * self.off)  # check 3.10
        return swept, held(self.remembered(at, last))

    def remembered(self, at: Array, last: Array) -> Array:
        """How far the ends of the boxes of cells that a controller with memory goes on with have moved: (2, M, ndim).

        It goes on with the box that is E inside of what the state is led to, or with its middle where that is empty;
        with all of it where that lies in the layer at a wall.

        at (2, M, ndim) : the boxes at the interval's begin. last (2, M, ndim) : how far the ends of the boxes that the
            state is led to have moved from there.
        """
        grid = self.grid
        first, second = at + last - OUTWARD * self.off
        middle = (first > second) & self.known  # check 3.13
        points = np.where(middle, (first + second) / 2 - at, last - OUTWARD * self.off)  # check 3.12
        whole = np.array(self.layers, np.bool_).T
        low, high = at + last
        beside = self.near + STICKS_OUT * self.scale  # what is so near to a wall is in its layer
        at_wall = (whole[0] & (high <= grid.lower + beside)) | (whole[1] & (low >= grid.upper - beside))
        beside += STICKS_OUT * self.scale
        points[1] = np.maximum(points[1], np.where(whole[0], grid.lower + beside - at[1], -np.inf))  # check 3.81
        points[0] = np.minimum(points[0], np.where(whole[1], grid.upper - beside - at[0], np.inf))  # check 3.82
        return np.where(at_wall, last, points)

    def known_at_wall(self, places: Array) -> Array:
        """Along which axes a controller that remembers to be in a cell at places (M,) knows the state: (M, ndim) bool.

        It does where the cell is a layer. False everywhere for a controller without memory.
        """
        cells, layers = self.cells_at(places), np.array(self.layers, np.bool_).T
        at_wall = (layers[0] & (cells == 0)) | (layers[1] & (cells == self.counts - 1))  # check 3.80
        return at_wall & self.known & self.sensing.memory

    def piece(self, box: Array, moved: Array, j: Array, times: Times, far: Array) -> Array:
        """How far the ends of boxes have moved after one more piece of the interval: displacements (2, M, ndim).

        They are negative downwards. A box is looked for that the state does not leave during the piece (`Unbounded`
        where none is found); then an end moves with the extreme velocity in that box, along axes whose velocity depends
        on their own coordinate with that in the face of the box on the end's side. Along axes of no place boxes stay
        where they are in this search, and what is returned holds for them anywhere.

        box (2, M, ndim) : the ends when the piece begins. moved (2, M, ndim) : their displacements until then, to which
            those of the piece are added. j (M,) : inputs. times : of the piece, (from, to), s.
        far (2, M, ndim) : a guess of the displacements in the piece, overwritten by what was found.
        """
        h, some, out = (times[1] - times[0]) * (1 + 1e-15), OUTWARD * 0.1 * self.near, np.empty_like(box)
        left: Any = slice(None)
        for _ in range(30):
            own, reached = box[:, left], far[:, left]
            enclosure = own + self.known * (WIDER * reached + some)
            out[:, left] = found = np.stack(self.velocity(j[left], enclosure, times))
            now = np.stack([h * np.minimum(found[0], 0.0), h * np.maximum(found[1], 0.0)])
            fits = ~self.known | (OUTWARD * (enclosure - own - now) > 0)  # check 3.22
            stays = np.logical_and(*fits).all(axis=1)
            far[:, left] = np.where(stays[:, None], now, np.where(fits, reached, 1.3 * now))
            if stays.all():
                break
            left = np.arange(len(j))[left][~stays]
        else:
            raise Unbounded("no box was found that the state stays in for a part of the interval")
        # check 1.12
        more = some * (far != 0)  # a coordinate that cannot grow needs no room above, nor one below
        enclosure = box + self.known * (far + more)  # all that is reached within the piece  # check 3.23
        faces = list(product(np.flatnonzero(self.known & self.moves.reads_itself), (0, 1)))
        every = [enclosure.copy(order="K") for _ in faces]
        for face, (axis, side) in zip(every, faces, strict=True):
            face[:, :, axis] = (box[side] + far + some)[:, :, axis]  # check 3.24
        # for ends that are in no face
        every += [enclosure] * (len(faces) < out[:, 0].size)  # check 3.94
        found = np.stack(self.velocity(np.tile(j, len(every)), np.concatenate(every, axis=1), times))  # check 3.21
        each = np.split(found, len(every), axis=1)
        out = each[-1].copy(order="K")
        for own, (axis, side) in zip(each, faces, strict=False):
            out[side, :, axis] = own[side, :, axis]  # check 3.25
        return moved + h * out + OUTWARD * (2e-15 * np.abs(h * out) + 3e-16 * np.abs(moved))

    def moves_hold(self, places: Array, start: int, j: Any, moved: Array) -> Array:
        """Whether what the cells at places (M,) are led to under u_j lies in the cells of the file's moves: (M,) bool.

        Up to `STICKS_OUT` of the largest coordinate of an axis.

        start : the index of the interval in `low` and `high`. j : an index, or (M,).
        moved (2, M, ndim) : how far the ends of the cells move, the second result of `driven`.
        """
        fits, cells, sticks = np.ones(len(places), np.bool_), self.cells_at(places), STICKS_OUT * self.scale
        for axis, (lower, width, least, most) in enumerate(self.axes):
            low, high = (array[start, j, places, axis].astype(np.int64) for array in (self.low, self.high))
            first, last = low * float(width), high * float(width)
            if any(self.layers[axis]):  # a layer's cells have no width, but what is past the wall counts as in it
                own, begin = cells[:, axis], float(lower - self.layers[axis][0] * width)  # check 1.8
                first = begin + (own + low) * float(width) - self.edges[axis][own]  # check 3.8
                last = begin + (own + high + 1) * float(width) - self.edges[axis][own + 1]
            if self.periodic[axis] and self.known[axis]:  # cells need not be alike  # check 3.29
                own, n, edges, length = cells[:, axis], self.counts[axis], self.edges[axis], float((least + most) / 2)
                sides = enumerate((own + low, own + high + 1))
                first, last = (edges[at % n] + at // n * length - edges[own + side] for side, at in sides)
            # check 3.28
            fits &= (first <= moved[0, :, axis] + sticks[axis]) & (moved[1, :, axis] <= last + sticks[axis])
        return fits

    def stays_near(self, j: int, boxes: Array, times: Times, allowed: Array, travel: Array) -> Array:
        """Whether predictions from measurements in boxes (2, M, ndim) stay within `off` over a delay: (M,) bool.

        delay * |velocity - undisturbed velocity| <= allowed has to hold around each box; where that is open boxes are
        halved, `NEAREST` times at most along each axis of a place.

        j : the index of the input that acts. times : of the stride, s to s. allowed (ndim,) : `off` less the error of a
            measurement. travel (2, 1, ndim) : how far a state may move meanwhile, downward (<= 0) and upward.
        """

        def near(box: Array) -> tuple[Array, Array]:
            """Where velocities around predictions in boxes (2, m, ndim) differ by little enough; and False: (m,) bool.

            So no box is ever said to fail: it is halved to the last.
            """
            calm = self.velocity(j, box + travel, times, False)
            wild = self.velocity(j, box + travel + OUTWARD * self.off, times)  # check 3.39
            difference = np.maximum(wild[1] - calm[0], calm[1] - wild[0])  # check 3.43
            yes = np.all(difference * self.delay <= allowed * (1 + 1e-12) + ROUNDED * self.scale, axis=1)
            return yes, np.zeros_like(yes)

        return everywhere(near, boxes, self.known, NEAREST)

    # ---- tubes and sets

    def outside(self, part: Part, box: Array, times: Times, depth: int = DEEPEST) -> Array:
        """Whether boxes (2, M, axes) are proved to be outside a set at all `times`, s to s: (M,) bool.

        part : the set; boxes are on its axes, in the order of `part.axes`.
        depth : how often a box of open sign is halved along each axis, at most.
        """
        out, every = np.ones(box.shape[1], np.bool_), np.ones(box.shape[2], np.bool_)
        for one in part.least_of:
            left = np.flatnonzero(out)
            out[left] = everywhere(partial(self.above, part, one, times), box[:, left], every, depth)
        return out

    def above(self, part: Part, one: Formula | BlackBox, times: Any, box: Array) -> tuple[Array, Array]:
        """Where a function of a set is proved > 0 all over boxes (2, M, axes), and where <= 0: both (M,) bool.

        At all `times`, s to s, as `value` takes them. part : the set, on whose axes the boxes are. one : one of
        `part.least_of`.
        """
        least, most = self.value(part, one, box, times)
        return least > 0, most <= 0  # check 4.31

    def above_at(
        self, part: Part, one: Formula | BlackBox, times: Sequence[Times], box: Array, at: Array
    ) -> tuple[Array, Array]:
        """What `above` says of boxes (2, M, axes), each at its own of several times: at (M,) says at which."""
        if isinstance(one, Formula):
            return self.above(part, one, np.array(times)[at].T, box)  # check 4.79
        found = np.zeros((2, len(at)), np.bool_)
        for number in np.unique(at):
            own = np.flatnonzero(at == number)
            found[:, own] = self.above(part, one, times[number], box[:, own])  # check 4.80
        return found[0], found[1]

    def inside(self, part: Part, box: Array, times: Times) -> Array:
        """Whether boxes (2, M, axes) are proved to be inside a set at all `times`, s to s: (M,) bool.

        part : the set, on whose axes the boxes are. A box of open sign is halved up to `DEEPEST` times.
        """

        def holds(some: Array) -> tuple[Array, Array]:
            """Where the function is <= 0 all over boxes (2, m, axes), and where it is > 0 all over: both (m,) bool."""
            least, most = self.value(part, part.function, some, times)
            return most <= 0, least > 0  # check 5.17

        return everywhere(holds, box, np.ones(box.shape[2], np.bool_), DEEPEST)

    def clear_holds(self, ends: Array, step: int, j: Any, swept: Array, at: Array, depth: int = DEEPEST) -> Array:
        """Whether tubes under u_j from boxes `ends` are proved clear in the interval from a step: (M,) bool.

        Clear of unsafe ends, and of the sets that are unsafe under u_j; what has wholly left over a safe end is not
        asked about.

        ends (2, M, ndim) : the corners of the boxes that tubes begin from. step : the number of the interval.
        j : an index, or (M,).
        swept (P, parts, 2, ndim) : how far ends of boxes move in each part, the first result of `driven`.
        at (M,) : which of these P is each box's.
        depth : how often a box of open sign is halved along each axis, at most.
        """
        grid, out = self.grid, np.ones(len(at), np.bool_)
        there = self.not_gone(ends, swept, at)
        whole = ends + np.stack([swept[:, :, 0].min(axis=1), swept[:, :, 1].max(axis=1)])[:, at]  # check 4.44
        if not there.all():  # check 4.45
            until = np.where(there[:, :, None, None], swept[at], swept[at, :1])  # check 4.46
            whole = ends + np.stack([until[:, :, 0].min(axis=1), until[:, :, 1].max(axis=1)])
        for axis in np.flatnonzero(~self.periodic):
            room = self.room[axis]
            out &= (whole[0, :, axis] >= grid.lower[axis] - room) | (grid.ends[axis][0] != "unsafe")  # check 4.36
            out &= (whole[1, :, axis] <= grid.upper[axis] + room) | (grid.ends[axis][1] != "unsafe")  # check 4.35
        for unsafe_set in self.unsafe:  # check 4.30
            own, left = list(unsafe_set.axes), np.flatnonzero(out & unsafe_set.counts(j))
            if not unsafe_set.moving:  # often the whole tube at once will do
                # check 4.32
                left = left[
                    ~self.outside(unsafe_set, (whole[:, left] + OUTWARD * 2 * self.near)[..., own], self.always, 0)
                ]
            for piece, times in enumerate(pairwise(self.cuts(step))):
                box = ends[:, left] + swept[at[left], piece].swapaxes(0, 1) + OUTWARD * 2 * self.near  # check 4.33
                when = times[0] - self.jitter, times[1] + self.jitter  # check 4.40
                good = self.outside(unsafe_set, box[..., own], self.always if not unsafe_set.moving else when, depth)
                good |= ~there[left, piece]
                out[left[~good]], left = False, left[good]  # check 4.49
        return out

    def lattice_of(self, number: int) -> Lattice:
        """The lattice of unsafe set `number`, made once and kept; `pieces` must not be 0 for it."""
        if number not in self.lattices:
            part = self.unsafe[number]
            own = list(part.axes)
            edges = [self.edges[axis] for axis in own]
            self.lattices[number] = Lattice(
                edges, self.pieces(part), self.periodic[own], self.near[own], self.sway[own]
            )
        return self.lattices[number]

    def counted(self, number: int, step: int) -> list[Array]:
        """The boxes of an unsafe set's lattice that may meet it, counted (`Lattice.counted`); made once and kept.

        A single array, for all times, where the set stands still; else one for each part of the interval from a step,
        and the last for all of it.

        number : the set's, in `unsafe`.
        """
        part = self.unsafe[number]
        key = number, step if part.moving else 0
        if key not in self.boxes_met:
            times = list(pairwise(self.cuts(step))) if part.moving else [self.always]
            when = [(a - self.jitter, b + self.jitter) if part.moving else (a, b) for a, b in times]  # check 4.58
            signs = [partial(self.above_at, part, one, when) for one in part.least_of]
            self.boxes_met[key] = self.lattice_of(number).counted(signs, len(when))
        return self.boxes_met[key]

    def pieces(self, part: Part) -> int:
        """Into how many pieces cells are cut along each axis for a set's lattice; 0: there are too many cells."""
        times = len(self.clear) * self.parts if part.moving else 1
        return pieces_of(self.counts[list(part.axes)].tolist(), times)

    @cached_property
    def sway(self) -> Array:
        """How far tubes typically stick out of their cells to both sides, by the disturbance and `off`: (ndim,).

        A guess, at the middle of the grid under the first input: nothing that is proved rests on it. Computed once.
        """
        middle, now = np.add(self.grid.lower, self.grid.upper) / 2, (self.time(0), self.time(0))
        slow, fast = self.velocity(0, np.tile(middle, (2, 1, 1)), now)
        return (fast - slow)[0] / 2 * self.length + self.off

    def clear_by_lattice(
        self, j: int, open_: Mapping[int, Array], numbers: Array, places: Array, swept: Array, at: Array
    ) -> dict[int, Array]:
        """By step the cells, of those in `open_`, from which the sets' lattices leave it open whether u_j is clear.

        For these `clear_holds` is to be asked; from the others the tube in the interval from the step is proved clear.

        open_ : by step the cells that are asked about, indices (m,) into `numbers` and `at`.
        numbers (M,) : flat numbers of cells. places (P,), swept (P, parts, 2, ndim) : places, and how far ends of their
            cells move in each part, the first result of `driven`. at (M,) : which of these P is each cell's.
        """
        whole = np.stack([swept[:, :, 0].min(axis=1), swept[:, :, 1].max(axis=1)], axis=1)  # check 4.59
        clear = {step: np.ones(some.size, np.bool_) for step, some in open_.items()}
        for axis, good in self.within_ends(places, whole):
            for step, some in open_.items():
                flags_at(good, self.cell_strides[axis], numbers, at, some, clear[step])
        for number, part in enumerate(self.unsafe):
            if not part.counts(j):  # check 4.62
                continue
            left = {step: np.flatnonzero(good) for step, good in clear.items()}
            for piece in range(-1, self.parts):  # often the whole tube at once will do
                if not any(rows.size for rows in left.values()):
                    break
                tubes = self.spans(number, places, whole if piece < 0 else swept[:, piece])
                for step, rows in left.items():
                    good = self.misses(number, step, piece, tubes, numbers, at, open_[step][rows])
                    if piece < 0:
                        left[step] = rows[~good]
                    else:
                        clear[step][rows[~good]], left[step] = False, rows[good]
        return {step: some[~clear[step]] for step, some in open_.items()}

    def within_ends(self, places: Array, whole: Array) -> Iterator[tuple[int, Array]]:
        """Yield axes, and whether tubes stay within their unsafe ends: (P, n) bool from each cell there, or (P, 1).

        places (P,), whole (P, 2, ndim) : places, and the farthest that ends of their cells move.
        """
        grid = self.grid
        for axis in np.flatnonzero(~self.periodic & (np.array(grid.ends) == "unsafe").any(axis=1)).tolist():
            low, high = self.along(axis, places, whole)
            room = self.room[axis]
            good = (low >= grid.lower[axis] - room) | (grid.ends[axis][0] != "unsafe")  # check 4.60
            good &= (high <= grid.upper[axis] + room) | (grid.ends[axis][1] != "unsafe")  # check 4.61
            yield axis, good

    def spans(self, number: int, places: Array, tube: Array) -> Spans:
        """The boxes of an unsafe set's lattice that tubes overlap along each of its axes.

        number : the set's, in `unsafe`. places (P,), tube (P, 2, ndim) : places, and how far the ends of their cells
            move.
        """
        boxes, axes = self.lattice_of(number), self.unsafe[number].axes
        return spans_of([boxes.overlapped(k, *self.along(axis, places, tube)) for k, axis in enumerate(axes)])

    def misses(self, number: int, step: int, piece: int, tubes: Spans, numbers: Array, at: Array, some: Array) -> Array:
        """Whether the tubes of `some` cells (m,), indices into `numbers`, overlap no box that may meet a set: (m,).

        number : the set's, in `unsafe`. step, piece : the interval, and the part of it; -1: all of it.
        tubes : of each place the tube, what `spans` returned. numbers, at (M,) : the flat numbers of cells, and which
            tube is each one's.
        """
        part, out = self.unsafe[number], np.empty(some.size, np.bool_)
        counted = self.counted(number, step)[piece if part.moving else 0]  # check 4.52
        strides = self.cell_strides[list(part.axes)]
        tubes_miss(counted.ravel(), strides_of(counted.shape), *tubes, strides, numbers, at, some, out)
        return out

    def along(self, axis: Any, places: Array, tube: Array) -> tuple[Array, Array]:
        """The lower and the upper ends of tubes along an axis, with room for the shell: both (P, n), or (P, 1).

        (P, n), from each of the axis's n cells; (P, 1) where the axis is a place's, from the cell of each place.

        places (P,), tube (P, 2, ndim) : places, and how far the ends of their cells move.
        """
        if not self.known[axis]:
            return self.tubes_of_cells(axis, tube[:, :, axis])
        cells, near, edges = self.cells_at(places)[:, axis, None], 2 * self.near[axis], self.edges[axis]
        return edges[cells] + tube[:, 0, axis, None] - near, edges[cells + 1] + tube[:, 1, axis, None] + near

    def tubes_of_cells(self, axis: int, tubes: Array) -> tuple[Array, Array]:
        """The lower and the upper ends of tubes along an axis, from each of its cells: both (M, cells).

        With room for the shell. axis : one on which no place is. tubes (M, 2) : how far both ends of a cell move.
        """
        edges, near = self.edges[axis], 2 * self.near[axis]
        return edges[:-1] + tubes[:, :1] - near, edges[1:] + tubes[:, 1:] + near

    def clear_in_slabs(self, step: int, j: Array, numbers: Array, swept: Array, at: Array) -> Array:
        """Whether tubes under u_j from cells with flat numbers (M,) are proved clear in a step's interval: (M,) bool.

        By `clear_holds`, `SLAB` cells at a time to bound memory.

        j (M,) : inputs. swept (P, parts, 2, ndim) : how far ends of cells move in each part, the first result of
            `driven`. at (M,) : which of these P is each cell's.
        """
        out = np.empty(numbers.size, np.bool_)
        for begin in range(0, numbers.size, SLAB):
            own = slice(begin, begin + SLAB)
            out[own] = self.clear_holds(self.ends(self.cells(numbers[own])), step, j[own], swept, at[own])
        return out

    def cuts(self, step: int) -> list[float]:
        """The times, s, at which the parts of the interval from a step begin and end: a list of parts + 1."""
        return [self.time(step) + piece / self.parts * self.length for piece in range(self.parts + 1)]  # check 4.39

    def not_gone(self, ends: Array, swept: Array, at: Array) -> Array:
        """In which parts the tubes of boxes `ends` (2, M, ndim) may still be between the safe ends: (M, parts) bool.

        Once False, False in all later parts: then all of a tube has left over a safe end.

        swept (P, parts, 2, ndim) : how far ends of boxes move in each part. at (M,) : which of these P is each box's.
        """
        left, grid = np.zeros((len(at), self.parts), np.bool_), self.grid
        for axis in np.flatnonzero(self.safe.any(axis=1)):
            a, b = (ends[side, :, axis, None] + swept[at, :, side, axis] for side in (0, 1))
            left |= (b < grid.lower[axis] - self.near[axis]) & self.safe[axis, 0]  # check 4.47
            left |= (a > grid.upper[axis] + self.near[axis]) & self.safe[axis, 1]  # check 4.48
        return ~np.logical_or.accumulate(left, axis=1)

    def goals_hold(self, numbers: Array, step: int) -> Array:
        """Whether the cells with flat numbers (M,) are proved inside the target and outside the unsafe sets at t_step.

        (M,) bool. With the shell and E around them; at all times where the robot is time-invariant. Sets that are
        unsafe under some inputs only are not asked about. Without a target: outside the unsafe sets.
        """
        # check 5.15
        times = self.always if self.time_invariant else (self.time(step) - self.jitter, self.time(step) + self.jitter)
        box, out = self.ends(self.cells(numbers), self.near + self.off), np.ones(len(numbers), np.bool_)  # check 5.16
        for unsafe_set in (one for one in self.unsafe if one.inputs is None):
            out &= self.outside(unsafe_set, box[..., list(unsafe_set.axes)], times)  # check 5.14
        if self.target is None:
            return out
        return out & self.inside(self.target, box[..., list(self.target.axes)], times)

    def bits(self, step: int, within: int) -> Array:
        """The set S_step^within of the file: (cells,) bool, the last axis fastest.

        step, within : step + within <= steps, which is not checked. Of a time-invariant robot `step` is ignored, and
        the last set that is kept stands for larger `within`.
        """
        return unpacked(self.in_bytes(step, within), int(self.counts[-1])).ravel()

    def in_bytes(self, step: int, within: int) -> Array:
        """The same set, packed along the last axis: (rows, bytes) uint8, no bit set behind the last cell of a row.

        step, within : as for `bits`.
        """
        row = step * (self.steps + 1) - step * (step - 1) // 2 + within
        row = min(within, len(self.index) - 1) if self.time_invariant else row
        blocks = self.pool[self.index[row]].view(np.uint8)
        return np.ascontiguousarray(blocks[:, : -(-int(self.counts[-1]) // 8)])

    def said_to_arrive(self, group: range, step: int, some: Array) -> Array:
        """Which of a group of inputs the file says to lead into the target itself in a step's interval: pairs (m,).

        A pair is of an input and a site, j * sites + site.

        group : inputs. step : an index into `arrives`. some (sites,) : bool, the sites that are looked at.
        """
        size = self.arrives.shape[1]
        flags = (((self.arrives[step, :, j // 8] >> np.uint8(j % 8)) & 1 == 1) & some for j in group)
        return np.concatenate([j * size + np.flatnonzero(own) for j, own in zip(group, flags, strict=True)])

    def sites_of(self, numbers: Array) -> Array:
        """Which sites have any of the cells with flat numbers (M,): (sites,) bool."""
        out = np.full(self.arrives.shape[1], numbers.size == self.clear.shape[1])
        if not out.all():
            out[by_slabs(lambda n: self.cells(n) @ self.sites, numbers)] = True
        return out

    def begins(self, pairs: Array) -> Array:
        """The boxes that inputs begin from at sites, numbered j * places + place: (M,).

        pairs (M,) : of an input and a site, as of `said_to_arrive`.
        """
        inputs, sites = np.divmod(pairs, self.arrives.shape[1])
        return inputs * self.low.shape[2] + self.cells_at(sites, self.sites) @ self.strides  # check 5.23

    def arrivals_hold(self, step: int, pairs: Array, last: Array, at: Array, some: Array) -> Array:
        """Whether inputs lead all of the cells at a site into the target at the end of a step's interval: (m,) bool.

        False, too, where no bounds are found.

        step : the number of the interval. pairs (M,) : of an input and a site, as of `said_to_arrive`.
        last (2, P, ndim) : how far ends of cells move, as `bounded` returns it. at (M,) : which of these P is each
            pair's. some (m,) : indices of the pairs that are asked about.
        """
        assert self.target is not None
        moved = last[:, at[some]]
        known = np.logical_and.reduce(np.isfinite(moved), axis=(0, 2))
        cells, out = self.cells_at(pairs[some[known]] % self.arrives.shape[1], self.sites), known.copy()
        box = self.ends(cells, 2 * self.near) + moved[:, known]  # check 5.19
        times = self.time(step + 1), self.time(step + 1)  # check 5.20
        out[known] = self.inside(self.target, box[..., list(self.target.axes)], times)  # check 5.21
        return out

    def steps_fail(self, asked: Array, step: int, following: Array) -> Array:
        """The flat numbers of the cells that no clear input leads into a set, or into the target: (M,), ascending.

        By what the file says of moves, clear inputs and arrivals.

        asked (rows, bytes) : uint8, the cells that are asked about, packed along the last axis. step : the number of
            the interval. following : packed likewise, the set, of the next step with a step less to go.
        """
        n = int(self.counts[-1])
        if self.at_once is not None and self.at_once.leads():
            return numbers_of(asked & ~self.at_once.cells_led_into(step, following).reshape(asked.shape), n)
        inside = self.sums(unpacked(following, n))

        def hold(some: Array) -> Array:
            """Whether some clear input leads from each of the cells with numbers (m,) into the set: (m,) bool."""
            out = np.zeros(len(some), np.bool_)
            left = np.arange(len(some))
            for j in range(self.low.shape[1]):
                if not left.size:
                    break
                out[left] = self.leads(some[left], step, j, inside)
                left = left[~out[left]]
            return out

        numbers = numbers_of(asked, n)
        return numbers[~by_slabs(hold, numbers)]

    def sums(self, cells: Array) -> Array:
        """How many cells of a set, (cells,) bool, lie below each corner: int32, what `lattice.sums` returns."""
        return sums(cells.reshape(self.counts), self.periodic)

    def leads(self, numbers: Array, step: int, j: int, counted: Array) -> Array:
        """Whether u_j is clear from the cells with flat numbers (M,) and leads all of each into a set, or the target.

        (M,) bool. By the file's flags, moves and arrivals, for the interval from a step. What has wholly left
        over a safe end by a cell counts as in the set.

        step : the number of the interval; the last one kept stands for later ones. counted : what `sums` returns for
            the set.
        """
        start, clear = min(step, len(self.low) - 1), self.clear[min(step, len(self.clear) - 1)]
        out = (clear[numbers, j // 8] >> np.uint8(j % 8)) & 1 == 1  # check 3.45
        left = np.flatnonzero(out)
        if not left.size:
            return out
        inside = np.empty(left.size, np.bool_)
        moves = self.safe, self.low[start, j], self.high[start, j], self.strides
        of_set = counted.ravel(), strides_of(counted.shape), self.counts, self.periodic
        led_into(*of_set, *moves, numbers[left], inside)
        if len(self.arrives):
            some = np.flatnonzero(~inside)
            sites = self.cells(numbers[left[some]]) @ self.sites
            marks = self.arrives[min(step, len(self.arrives) - 1), sites, j // 8]
            inside[some] = (marks >> np.uint8(j % 8)) & 1 == 1  # check 3.77
        out[left] = inside
        return out

    # ---- claims

    def claims(self, samples: int | None, seed: int, silent: bool) -> Iterator[Claim]:
        """Yield all claims, checked; those of single cells for `samples` random cells, or for all if it is None.

        Only the first where cells do not cover the axes. The last one names the functions of which what is stated is
        believed, if there are any.

        samples : at least 1, or None; more than there are cells: all of them. seed : of the cells drawn.
            silent : show no progress bar.
        """
        ndim, wrong = self.grid.ndim, self.faults_of_cells()
        yield Claim(COVER, ndim, ndim, wrong)
        if wrong:
            return
        if self.sensing:  # check 3.36
            yield Claim("predictions are as near as stated", self.count, self.count, self.known_within())
        size = math.prod(self.counts.tolist())
        chosen = np.full(size, samples is None)
        if samples is not None:
            chosen[np.random.default_rng(seed).choice(size, min(samples, size), False)] = True
        yield from self.claims_of_moves(np.flatnonzero(chosen), silent)
        yield from self.claims_of_sets(chosen, silent)
        if self.trusted:
            yield Claim(f"rests on what is stated of {', '.join(sorted(self.trusted))}", 0, 0, [])

    def claims_of_moves(self, numbers: Array, silent: bool) -> Iterator[Claim]:
        """Yield claims, checked for the cells with flat numbers (M,): their moves, and the inputs said to be clear.

        And where the file says of any, the inputs that lead into the target itself from the sites of these cells. What
        is not proved yet is bounded once more, finer (`FINENESS`). numbers : ascending, each once. silent : show no
        progress bar.
        """
        at, (starts, inputs, all_places, _) = np.zeros(numbers.size, np.int64), self.low.shape
        if all_places > 1:
            at = by_slabs(lambda n: self.cells(n) @ self.strides, numbers)
        (taken := np.zeros(all_places, np.bool_))[at] = True
        places = np.flatnonzero(taken)
        wrong: tuple[list[str], list[str], list[str]] = ([], [], [])
        sites, made, checked, arrivals = self.sites_of(numbers), 0, 0, 0
        bar = tqdm(total=starts * inputs, desc="moves", disable=silent)
        looks = max(len(self.clear), len(self.arrives)) if starts == 1 else 1
        at_once = self.at_once if numbers.size == len(self.clear[0]) else None
        for start, group in product(range(starts), self.groups(places.size, numbers.size * looks)):  # check 4.27
            if at_once is not None and group[0] == 0:
                at_once.look_at(start)
            # check 4.38
            clear, arrives = (range(len(each)) if starts == 1 else [start] for each in (self.clear, self.arrives))
            moving, open_ = dict.fromkeys(group, places), {j: dict[int, Array]() for j in group}
            arriving = {step: self.said_to_arrive(group, step, sites) for step in arrives if len(self.arrives)}
            arrivals += sum(pairs.size for pairs in arriving.values())
            for j, step in product(group, clear):
                if at_once is not None:
                    flags = flags_of(self.clear[step], j, at_once.shape)
                    open_[j][step], count = at_once.open_cells(flags, step, j), number_of(flags)
                    made, checked = made + count, checked + count
                    continue
                flags = ((self.clear[step, :, j // 8] >> np.uint8(j % 8)) & 1).view(np.bool_)
                own = flags if numbers.size == flags.size else flags[numbers]
                made, checked = made + int(np.count_nonzero(flags)), checked + int(np.count_nonzero(own))
                open_[j][step] = np.flatnonzero(own)
            for pieces in FINENESS:
                self.narrow(start, pieces, moving, open_, arriving, numbers, at)
            for j in group:
                wrong[0].extend(f"start {start}, input {j}, place {place}" for place in moving[j])
                some = open_[j].items()
                wrong[1].extend(f"start {step}, input {j}, cell {n}" for step, each in some for n in numbers[each])
            for step, pairs in arriving.items():
                wrong[2].extend("start {}, input {}, site {}".format(step, *divmod(n, sites.size)) for n in pairs)
            bar.update(len(group))
        bar.close()
        yield Claim("moves", starts * inputs * all_places, starts * inputs * places.size, wrong[0])
        yield Claim("clear of the unsafe sets", made, checked, wrong[1])
        if len(self.arrives):
            yield Claim(ARRIVE, int(np.bitwise_count(self.arrives).sum()), arrivals, wrong[2])  # check 5.22

    def narrow(
        self,
        start: int,
        pieces: int,
        moving: dict[int, Array],
        open_: dict[int, dict[int, Array]],
        arriving: dict[int, Array],
        numbers: Array,
        at: Array,
    ) -> None:
        """Take out of `moving`, `open_` and `arriving`, in place, what is proved with bounds so fine of `driven`.

        start : the index of the interval in `low` and `high`. pieces : of a part; `Unbounded` for the finest,
            `FINENESS[-1]`, where no bounds are found, and with others nothing is taken out there.
        moving : for each input the places whose moves are not proved yet.
        open_ : for each input and step the cells from which it is not proved clear yet, as indices into numbers and at.
        arriving : for each step the pairs of `said_to_arrive` for which that is not proved yet.
        numbers, at (M,) : the flat numbers of the cells that are checked, and their places.
        """
        size, first = self.low.shape[2], next(iter(moving))
        needed, row = np.zeros((len(moving), size), np.bool_), np.empty(size, np.int64)
        for flags, (j, some) in zip(needed, moving.items(), strict=True):
            for each in (some, *(at[cells] for cells in open_[j].values())):
                flags[each] = True
        begun = {step: by_slabs(self.begins, pairs) - first * size for step, pairs in arriving.items()}
        for each in begun.values():
            needed.ravel()[each] = True
        which, places = np.nonzero(needed)
        swept, last, held = self.bounded(start, pieces, np.array([*moving])[which], places)
        for step, pairs in arriving.items():
            own = np.searchsorted(which * size + places, begun[step])  # check 5.24
            hold = partial(self.arrivals_hold, step, pairs, last, own)
            arriving[step] = pairs[~by_slabs(hold, np.arange(pairs.size))]
        counted = numbers.size * FEW >= self.clear.shape[1] and all(map(self.pieces, self.unsafe)) and not self.at_once
        rows: dict[int, list[Array]] = {}  # by step, of each input's open cells, which of `swept` is theirs
        for j, (begin, end) in zip(moving, pairwise(np.searchsorted(which, np.arange(len(moving) + 1))), strict=True):
            looked_at = places[begin:end]
            row[looked_at] = np.arange(looked_at.size)
            moving[j] = np.intersect1d(moving[j], looked_at[~held[begin:end]])
            if counted:
                open_[j] = self.clear_by_lattice(j, open_[j], numbers, looked_at, swept[begin:end], row[at])
            for step, some in open_[j].items():
                rows.setdefault(step, []).append(begin + row[at[some]])
        for step, of_inputs in rows.items():
            self.take_out_clear(step, open_, numbers, swept, of_inputs)

    def bounded(self, start: int, pieces: int, j: Array, places: Array) -> tuple[Array, Array, Array]:
        """How far ends of the boxes at places (P,) move under u_j, and whether the file's moves hold.

        (swept, last, held). swept (P, parts, 2, ndim), last (2, P, ndim) : what `driven` returns, infinite where no
            bounds are found; then held (P,), bool, is False. With the finest, `FINENESS[-1]`, that is `Unbounded`.
        start : the index of the interval in `low` and `high`. pieces : of a part.
        j (P,) : inputs.
        """
        count = len(places)
        swept = np.moveaxis(np.empty((self.parts, 2, self.grid.ndim, count)), 3, 0)
        last, held = np.moveaxis(np.empty((2, self.grid.ndim, count)), 1, 2), np.empty(count, np.bool_)
        together = BOXES_AT_ONCE // (1 + 2 * int(self.moves.reads_itself.sum()))  # and their faces
        for begin in range(0, count, together):
            own = slice(begin, begin + together)
            try:
                swept[own], last[:, own] = self.driven(places[own], j[own], self.time(start), pieces)  # check 3.20
            except Unbounded:
                if pieces == FINENESS[-1]:
                    raise
                swept[own], last[:, own], held[own] = np.array([-np.inf, np.inf])[:, None], np.inf, False
                continue
            held[own] = self.moves_hold(places[own], start, j[own], last[:, own])  # check 3.30
        return swept, last, held

    def take_out_clear(
        self, step: int, open_: dict[int, dict[int, Array]], numbers: Array, swept: Array, rows: list[Array]
    ) -> None:
        """Take out of `open_`, in place, what `clear_in_slabs` proves clear in a step's interval, of all inputs.

        open_, numbers : as for `narrow`. swept (P, parts, 2, ndim) : how far ends of cells move in each part.
        rows : for each input of `open_`, in its order, which of these P are its open cells'.
        """
        some, counts = np.concatenate([own[step] for own in open_.values()]), [own.size for own in rows]
        inputs = np.array([*open_]).repeat(counts)
        left = ~self.clear_in_slabs(step, inputs, numbers[some], swept, np.concatenate(rows))
        ends = np.cumsum([0, *counts]).tolist()
        for own, (begin, end) in zip(open_.values(), pairwise(ends), strict=True):
            own[step] = some[begin:end][left[begin:end]]

    def groups(self, boxes: int, numbers: int) -> list[range]:
        """All inputs, as ranges of indices, in groups of at least one that are looked at together, as memory allows.

        boxes, numbers : how many boxes, and how many cells, are looked at for each input.
        """
        together = max(min(BOXES_AT_ONCE // max(boxes, 1), NUMBERS_AT_ONCE // max(numbers, 1)), 1)
        return [range(j, min(j + together, self.count)) for j in range(0, self.count, together)]

    def claims_of_sets(self, chosen: Array, silent: bool) -> Iterator[Claim]:
        """Yield three claims, checked for the cells `chosen`, (cells,) bool: sets grow, goals hold, and steps lead on.

        Sets grow with the steps to go, or shrink without a target; cells of a goal are in the target and clear; every
        other new cell has an input that leads it one step nearer. silent : show no progress bar.
        """
        counted = {GOALS: [0, 0], NEARER: [0, 0]}
        failed: dict[str, list[str]] = {name: [] for name in (GROW, GOALS, NEARER)}
        starts = range(1 if self.time_invariant else self.steps + 1)
        if len(self.index) == 1:  # what is safe for ever: it leads into itself
            rows = [(0, 0), (0, 1)]  # check 3.48
        else:
            rows = [(k, n) for k in starts for n in range(self.steps - k + 1)]
        n = int(self.counts[-1])
        looked_at = packed(chosen.reshape(-1, n))
        for step, within in tqdm(rows, desc="sets", disable=silent):
            new = here = self.in_bytes(step, within)
            name = NEARER if within else GOALS
            if within:
                less = self.in_bytes(step, within - 1)
                if ((here & ~less) if self.has_no_target else (less & ~here)).any():  # check 2.2
                    failed[GROW].append(f"start {step}, within {within}")
                new = here if self.has_no_target else here & ~less  # check 3.47
            asked = new & looked_at
            counted[name][0] += number_of(new)
            counted[name][1] += number_of(asked)
            if not within:
                wrong = numbers_of(asked, n)
                wrong = wrong[~by_slabs(partial(self.goals_hold, step=step), wrong)]
            else:
                wrong = self.steps_fail(asked, step, self.in_bytes(step + 1, within - 1))  # check 3.46
            failed[name].extend(f"start {step}, within {within}, cell {number}" for number in wrong)
        yield Claim(GROW, len(rows), len(rows), failed[GROW])
        for name, (made, checked) in counted.items():
            yield Claim(name, made, checked, failed[name])
