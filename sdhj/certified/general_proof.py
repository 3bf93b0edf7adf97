"""What one interval does to the cells of any problem, by bounds on its functions over boxes (`sdhj.certified.bounds`).

The velocity may depend on some of the axes only, as a car's on its heading. Those are an image's *place*; a cell's
position on the others is carried along, so all cells at a place move alike, and where an image lies is told in cells.

The interval is cut into pieces. Let the state be in a box X at the begin of one of length h, and let V bound the
velocity in a larger box B. If X + [0, h] V lies inside B, the state stays in B during the piece: it could only leave
where it already has. Its lower end on axis i, say at a, is then at least a + h F, where F bounds the velocity along i
from below in the part of B where x_i is in [a + h min(0, V_i), a + h max(0, V_i)]: as long as the bound is the least
coordinate the state moves no slower than F there, and else it is ahead of the bound (Mueller's theorem on differential
inequalities). No integration is approximate. Walls only hold the state back: ends are clipped at them. What has left
over a safe end is out of danger for good: once a whole tube is past one, nothing more is asked of it.

Displacements, not places, are added up, outward rounded, so a state off its cell by STATE_SLACK stays so near to the
image; and an image may stick out of the cells that it is said to lie in by `DRIFT`, which a thousand steps are allowed.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import h5py
import numpy as np
from tqdm import tqdm

from sdhj.certified.bounds import Bounds, known_sets
from sdhj.certified.cells import DRIFT, MOST_PIECES, CellAxis, CellTable, cells_of, moved_cells, unknown
from sdhj.formulas.formula import Ends
from sdhj.kernels import FloatArray
from sdhj.kernels.compiling import hidden
from sdhj.kernels.interpolation import SLACK
from sdhj.kernels.packed import STATE_SLACK, TOUCHING, Cells, to_words
from sdhj.kernels.stencils import Boxes, Moves, Placed, certified_inputs, grow, reached_rows, strike, strike_ends
from sdhj.problem.checks import whole
from sdhj.problem.memory import require
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sensing import Sensing
from sdhj.problem.sets import UnsafeSet
from sdhj.table.batches import threads
from sdhj.table.controller import STRIDES
from sdhj.table.files import stored

PIECES = 1 << 14  # that the state space is cut into, along the axes that velocities depend on
PIECES_OF_AN_AXIS = 1024  # on each axis; the checker cuts finer
GUESSES = 40
ROUNDED = 1 + 1e-12


def unsure(problem: ReachAvoidProblem) -> FloatArray:
    """E (ndim,); ValueError where no bound is found."""
    sensing, ndim = problem.sensing, problem.grid.ndim
    if not sensing:
        return np.zeros(ndim)
    if problem.dynamics.constant:
        return np.array([float(unknown(problem, axis)) for axis in range(ndim)])
    error = np.broadcast_to(np.array(sensing.error), (ndim,)).copy()
    if not sensing.delay:
        return error
    spread, box = _Spread(problem), error
    for _ in range(GUESSES):
        wider = (error + sensing.delay * spread(box)) * ROUNDED
        if (wider <= box).all():
            return wider
        box = wider * (1 + 1e-3) + 1e-12
        if not (box < np.subtract(problem.grid.upper, problem.grid.lower)).all():
            break
    raise ValueError(f"after a delay of {sensing.delay:g} s nothing is known of the state: the dynamics are too fast")


class _Spread:
    """D: how far velocities may be from those without an adversary, within a box."""

    def __init__(self, problem: ReachAvoidProblem) -> None:
        calm = replace(problem, dynamics=problem.dynamics.undisturbed(), sensing=Sensing())
        self.problem, self.any, self.calm = problem, Bounds(problem), Bounds(calm)
        grid, known = problem.grid, self.any.reads.any(axis=0)
        pieces = np.where(known, min(int(PIECES ** (1 / max(known.sum(), 1))), PIECES_OF_AN_AXIS), 1)
        corners = np.stack([index.ravel() for index in np.indices(pieces.tolist())], axis=1)
        size = np.subtract(grid.upper, grid.lower) / pieces
        self.low, self.high = grid.lower + corners * size, grid.lower + (corners + 1) * size
        self.strides = []
        for step in range(problem.steps if problem.dynamics.timed else 1):
            cuts = problem.time(step) - problem.sensing.delay * np.arange(STRIDES, -1, -1) / STRIDES
            self.strides += list(zip(cuts[:-1].tolist(), cuts[1:].tolist(), strict=True))
        self.strides = self.strides if problem.dynamics.timed else self.strides[:1]
        nowhere = np.zeros(self.low[:1].shape)
        self.travel = [(nowhere, nowhere)] * (len(self.strides) * len(problem.inputs))
        fastest = zip(*self._ends(self.any, 0.0), strict=True)
        stride = problem.sensing.delay / STRIDES * ROUNDED
        self.travel = [
            (np.minimum(a.min(axis=0), 0) * stride, np.maximum(b.max(axis=0), 0) * stride) for a, b in fastest
        ]

    def _ends(self, bounds: Bounds, more: FloatArray | float) -> FloatArray:
        """Least and greatest velocity near each box, (2, inputs * strides, boxes, ndim)."""
        asked = zip(itertools.product(range(len(self.problem.inputs)), self.strides), self.travel, strict=True)
        found = [
            np.stack(bounds.velocity(j, self.low + back - more, self.high + ahead + more, *times))
            for (j, times), (back, ahead) in asked
        ]
        return np.stack(found, axis=1)

    def __call__(self, box: FloatArray) -> FloatArray:
        least, most = self._ends(self.any, box)
        slow, fast = self._ends(self.calm, 0.0)
        return np.maximum(most - slow, fast - least).max(axis=(0, 1))


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


SIDES = np.array([-1.0, 1.0])[:, None, None]
TRIES = 12  # to find a box that the state stays in
FINEST = 8  # pieces of a part
EVALUATED = 4_000_000  # boxes in which a velocity is asked for, before pieces become as long as parts


@dataclass(frozen=True)
class GeneralProof:
    """What one interval does to the cells, for the recursion and for questions about states.

    Attributes
    ----------
    problem : ReachAvoidProblem
    axes : tuple of CellAxis
    parts : int
        Parts of the interval.
    strides : (ndim,) int64
        A cell is at the place sum(cell * strides).
    low, high : (starts, L, places, ndim) int16
        The cells that hold the image of a cell, from its own on; starts is 1 where the dynamics do not depend on time.
    clear : (starts, cells, bytes) uint8
        Bit j % 8 of byte j // 8: u_j is safe from anywhere in the cell; starts is 1 where nothing depends on time.
    """

    problem: ReachAvoidProblem
    axes: tuple[CellAxis, ...]
    parts: int
    strides: FloatArray
    low: FloatArray
    high: FloatArray
    clear: FloatArray
    kind = "enclosed"

    @classmethod
    def of(cls, problem: ReachAvoidProblem, axes: tuple[CellAxis, ...], parts: int) -> "GeneralProof":
        """Make room; `prepare` fills it."""
        size = math.prod(axis.count for axis in axes)
        strides, moves, clear = shapes(problem, axes, place_axes(problem, axes, Bounds(problem)))
        require(peak(problem, axes, parts, moves, clear), f"certifying {size:.1e} cells", "use fewer cells")
        low, high = np.zeros((2, *moves), np.int16)
        return cls(problem, axes, parts, strides, low, high, np.full(clear, 255, np.uint8))

    @property
    def rows(self) -> int:
        """Leading axes that number the blocks of the packed sets: all but the last."""
        return len(self.axes) - 1

    @property
    def nbytes(self) -> int:
        """Bytes that the arrays take in memory."""
        arrays = [*vars(self).values(), *self.layout]
        return sum(part.nbytes for part in arrays if isinstance(part, np.ndarray))

    @property
    def pieces(self) -> int:
        """Into how many pieces `prepare` cuts its work."""
        return self.low.shape[0] * self.low.shape[1] * -(-self.low.shape[2] // PLACES)

    @property
    def peak(self) -> int:
        """Bytes that a solve takes at most, the sets that it finds apart."""
        return peak(self.problem, self.axes, self.parts, self.low.shape, self.clear.shape)

    def _at(self, step: int) -> tuple[Moves, FloatArray]:
        """Moves, and which inputs are clear, of the interval from a step."""
        start = min(step, len(self.low) - 1)
        moves = Moves(self.low[start], self.high[start], self.strides, self.layout.safe)
        return moves, self.clear[min(step, len(self.clear) - 1)]

    def image(self, cell: FloatArray, j: int, step: int) -> Ends:
        """The first and the last cell (ndim,) of what a cell can lead to under u_j."""
        (moves, _), place = self._at(step), int(cell @ self.strides)
        return cell + moves.low[j, place], cell + moves.high[j, place]

    def inputs(self, table: CellTable, states: FloatArray, step: int, places: tuple[int, int]) -> FloatArray:
        """Which inputs are certified for states (M, ndim), bool (M, L); places of S_k^n and S_{k+1}^{n-1}."""
        return self._inputs(states, step, table.index[places[1]], table.pool)

    def _inputs(self, states: FloatArray, step: int, index: FloatArray, pool: FloatArray) -> FloatArray:
        out = np.empty((len(states), len(self.problem.inputs)), np.bool_)
        certified_inputs(np.ascontiguousarray(states), self.cells, *self._at(step), index, pool, out)
        return out

    def hazards(self, table: CellTable, states: FloatArray, step: int) -> FloatArray:
        """< 0 where an input is proved to stay clear from the cell of a state (M, ndim), else > 0: (M, L).

        How clear is told by the level-set functions where the input leads without an adversary; it proves nothing.
        """
        safe = self._inputs(states, step, table.index[0], table.pool[:0])
        moved = states[:, None] + self.problem.interval(step).displacements(states)
        ends = self.problem.grid.clipped(moved.reshape(-1, len(self.axes)))
        near = -self.problem.unsafe_value(ends, self.problem.time(step + 1)).reshape(safe.shape)
        return np.where(safe, np.minimum(near, -TOUCHING), np.maximum(near, TOUCHING))

    @property
    def told(self) -> dict[str, Any]:
        """What a file says of it: the parts of an interval, the axes of a place, and E."""
        return {"parts": self.parts, "own": (self.strides > 0).tolist(), "unsure": self.unsure.tolist()}

    def save(self, file: h5py.File) -> None:
        """Write the moves, and the inputs that are clear."""
        for name in ("low", "high", "clear"):
            file.create_dataset(name, data=getattr(self, name), compression="gzip", shuffle=True)

    @classmethod
    def load(
        cls, told: Mapping[str, Any], file: h5py.File, problem: ReachAvoidProblem, axes: tuple[CellAxis, ...]
    ) -> "GeneralProof":
        """Read what `save` wrote and `told` tells; ValueError where it does not fit the problem."""
        if len(told["own"]) != len(axes) or not {True, False}.issuperset(told["own"]):
            raise ValueError(f"axes of a place must be told for each axis, got {told['own']}")
        strides, moves, clear = shapes(problem, axes, np.array(told["own"], np.bool_))
        arrays = stored(file, "low", "int16", moves), stored(file, "high", "int16", moves)
        parts = whole("parts", told["parts"], least=1, most=MOST_PIECES)
        return cls(problem, axes, parts, strides, *arrays, stored(file, "clear", "uint8", clear))

    # ---- the recursion; sets are (rows, W) uint64

    @cached_property
    def bounds(self) -> Bounds:
        return Bounds(self.problem)

    @cached_property
    def unsure(self) -> FloatArray:
        """By how much a prediction may be off, (ndim,)."""
        return unsure(self.problem)

    @cached_property
    def cells(self) -> Cells:
        """The cells as arrays for compiled code."""
        return cells_of(self.axes, self.rows)

    @cached_property
    def layout(self) -> Placed:
        """Cells by place."""
        counts, own = np.array([axis.count for axis in self.axes]), self.strides > 0
        flat = np.cumprod([1, *counts[:0:-1]])[::-1].copy()
        edges = np.full((len(counts), counts.max() + 1), np.nan)
        for axis, cells in enumerate(self.axes):
            edges[axis, : cells.count + 1] = cells.edges()

        def numbers(which: FloatArray) -> FloatArray:
            if not which.any():
                return np.zeros(1, np.int64)
            return flat[which] @ np.indices(counts[which].tolist()).reshape(int(which.sum()), -1)

        free, safe = numbers(~own), np.stack(self.problem.grid.faces("safe"))
        return Placed(counts, numbers(own), free, free.size, edges, safe)

    def prepare(self, progress: bool | None, share: float = 1.0) -> None:
        """Fill moves and clear, or a share of them: where every input takes every place, where it is safe from."""
        starts, count, size, _ = self.low.shape
        n, finest = threads(), EVALUATED // (size * count * self.parts * len(self.low) * 2)
        lattices, work = self._lattices(progress), list(np.ndindex(starts, count, -(-size // PLACES)))
        work = work[: math.ceil(share * len(work))]

        def moved(start: int, j: int, slab: int) -> Ends:
            places = np.arange(slab * PLACES, min((slab + 1) * PLACES, size))
            return self.reached(places, j, self.problem.time(start), min(max(finest, 1), FINEST))

        with tqdm(total=len(work), desc="intervals", disable=hidden(progress)) as bar, ThreadPoolExecutor(n) as pool:
            for some in (work[at : at + n] for at in range(0, len(work), n)):
                for (start, j, slab), (tubes, last) in zip(
                    some, pool.map(moved, *zip(*some, strict=True)), strict=True
                ):
                    places = slab * PLACES, min((slab + 1) * PLACES, size)
                    self.low[start, j, slice(*places)], self.high[start, j, slice(*places)] = self._in_cells(
                        places, last
                    )
                    steps = range(len(self.clear)) if len(self.low) == 1 else range(start, start + 1)
                    self._strike(steps, j, places, tubes, lattices)
                    bar.update()

    def reached(self, places: FloatArray, j: int, start: float, pieces: int) -> Ends:
        """`swept` of cells at some places (M,). On the axes that are carried along they may be anywhere."""
        grid, carried, layout = self.problem.grid, self.strides == 0, self.layout
        cells = np.stack(np.unravel_index(layout.begin[places], layout.counts), axis=1)
        edges = layout.edges[np.arange(grid.ndim), cells], layout.edges[np.arange(grid.ndim), cells + 1]
        low, high = (
            np.where(carried, grid.lower, edges[0] - STATE_SLACK),
            np.where(carried, grid.upper, edges[1] + STATE_SLACK),
        )
        return self.swept(low, high, j, start, pieces)

    def swept(self, low: FloatArray, high: FloatArray, j: int, start: float, pieces: int) -> Ends:
        """How far the ends of boxes (M, ndim) move under u_j from a time on, with so many pieces a part.

        During each part, (M, parts, ndim, 2), and in the whole interval, (M, ndim, 2). On the axes that are
        carried along a cell begins as a point and the velocity is bounded wherever it may be.
        """
        tubes, before = np.empty((len(low), self.parts, *low.shape[1:], 2)), np.zeros((2, *low.shape))
        moved = self._held(low, high, before + SIDES * self.unsure)
        length, early = self.problem.sensing.hold(self.problem.delta)
        ends, soonest = [], length - early  # where they are from the earliest end of the interval on
        for part in range(self.parts):
            tube = [moved[0], moved[1]]
            cuts = [length * at / (self.parts * pieces) for at in range(part * pieces, (part + 1) * pieces + 1)]
            if cuts[0] < soonest < cuts[-1]:
                cuts = sorted({*cuts, soonest})
            for begin, end in itertools.pairwise(cuts):
                after = self._piece(low, high, moved, before, j, [start + begin, start + end])
                if begin >= soonest:
                    ends.append(moved)
                moved, before = after, after - moved  # what a piece added is a good guess for the next
                tube = [np.minimum(tube[0], moved[0]), np.maximum(tube[1], moved[1])]
            tubes[:, part, :, 0], tubes[:, part, :, 1] = tube
        ends.append(moved)
        last = np.stack([np.min([end[0] for end in ends], axis=0), np.max([end[1] for end in ends], axis=0)])
        return tubes, np.moveaxis(self._held(low, high, last + SIDES * self.unsure), 0, 2)

    def _piece(
        self, low: FloatArray, high: FloatArray, moved: FloatArray, before: FloatArray, j: int, times: Sequence[float]
    ) -> FloatArray:
        """What the ends of boxes low..high, moved by `moved`, have moved by at the end of a piece: (2, M, ndim)."""
        carried = self.strides == 0
        ends = [np.where(carried, end, end + by) for end, by in zip((low, high), moved, strict=True)]
        h = np.nextafter(times[1] - times[0], np.inf)
        box, velocity = self._room(ends, before, j, times, h)
        for axis in np.flatnonzero(np.diag(self.bounds.reads) & ~carried):
            for side in (0, 1):  # in the face of the box where the state can be the first or the last of all
                face = [box[0].copy(), box[1].copy()]
                face[0][:, axis] = ends[side][:, axis] + h * np.minimum(velocity[0][:, axis], 0.0) - STATE_SLACK / 8
                face[1][:, axis] = ends[side][:, axis] + h * np.maximum(velocity[1][:, axis], 0.0) + STATE_SLACK / 8
                least_most = self.bounds.velocity(j, face[0], face[1], times[0], times[1])
                velocity[2 + side][:, axis] = least_most[side][:, axis]
        added = enumerate(zip(moved, velocity[2:], strict=True))
        return self._held(low, high, np.stack([_added(by, h, v, side) for side, (by, v) in added]))

    def _held(self, low: FloatArray, high: FloatArray, moved: FloatArray) -> FloatArray:
        """`moved` where walls hold back the ends of boxes low..high."""
        carried, walls, out = self.strides == 0, self.problem.grid.faces("wall"), moved.copy()
        for side, end in enumerate((low, high)):
            place = end + out[side]
            held = ~carried & ((place < walls[0]) | (place > walls[1]))
            at_wall = np.nextafter(np.clip(place, *walls) - end, np.inf if side else -np.inf)
            out[side] = np.where(held, at_wall, out[side])
        return out

    def _room(
        self, ends: list[FloatArray], before: FloatArray, j: int, times: Sequence[float], h: float
    ) -> tuple[list[FloatArray], list[FloatArray]]:
        """A box that the state stays in for a piece of length h, and bounds on the velocity in it, twice."""
        carried, spread = self.strides == 0, 0.2 * np.abs(before) + STATE_SLACK
        box = [
            np.where(carried, ends[0], ends[0] + np.minimum(before[0], 0.0) - spread[0]),
            np.where(carried, ends[1], ends[1] + np.maximum(before[1], 0.0) + spread[1]),
        ]
        for _ in range(TRIES):
            velocity = self.bounds.velocity(j, box[0], box[1], times[0], times[1])
            reached = [
                np.where(carried, ends[0], np.minimum(ends[0], ends[0] + h * velocity[0]) - STATE_SLACK / 4),
                np.where(carried, ends[1], np.maximum(ends[1], ends[1] + h * velocity[1]) + STATE_SLACK / 4),
            ]
            if ((reached[0] > box[0]) | carried).all() and ((reached[1] < box[1]) | carried).all():
                velocity = self.bounds.velocity(j, reached[0], reached[1], times[0], times[1])
                return reached, [*velocity, *(v.copy() for v in velocity)]
            wider = 0.1 * (reached[1] - reached[0]) + STATE_SLACK
            box = [np.where(carried, ends[0], reached[0] - wider), np.where(carried, ends[1], reached[1] + wider)]
            if not all(np.isfinite(end).all() for end in box):
                break
        raise ValueError("the dynamics change too fast for this interval: use more parts")

    def _in_cells(self, places: tuple[int, int], moved: FloatArray) -> Ends:
        """The cells, from their own on, that hold cells at places begin..end-1 whose ends have moved: two (M, ndim)."""
        low, high = np.empty((2, len(moved), len(self.axes)), np.int64)
        cells = np.unravel_index(self.layout.begin[slice(*places)], self.layout.counts)
        for axis, (own, cell) in enumerate(zip(self.axes, cells, strict=True)):
            known = bool(self.strides[axis] > 0)
            low[:, axis], high[:, axis] = moved_cells(own, cell, moved[:, axis, 0], moved[:, axis, 1], known)
        if max(-low.min(), high.max()) > np.iinfo(np.int16).max:
            raise ValueError("an interval moves the state by more than 32,767 cells; use fewer cells")
        return low, high

    def _strike(
        self, steps: range, j: int, places: tuple[int, int], tubes: FloatArray, lattices: list[list[Boxes]]
    ) -> None:
        """Take away the bit of u_j where its tube may meet an unsafe set or leave by an unsafe end, in some steps.

        What stands still is met in all of them alike.
        """
        grid, bit = self.problem.grid, np.uint8(1 << j % 8)
        still = np.full(self.clear.shape[1], 255, np.uint8)
        room = np.maximum(SLACK * np.array(grid.spacing) - 2 * STATE_SLACK, 0.0)
        least, most = grid.faces("unsafe")
        if np.isfinite([least, most]).any():
            strike_ends(still, tubes, places, np.stack([least - room, most + room]), bit, self.layout)
        for known in (one for one in lattices if len(one) == 1):
            self._met(still, tubes, places, known[0], bit)
        for step in steps:
            clear = self.clear[step, :, j // 8] & still
            for known in (one for one in lattices if len(one) > 1):
                self._met(clear, tubes, places, known[step], bit)
            self.clear[step, :, j // 8] = clear

    def _met(self, clear: FloatArray, tubes: FloatArray, places: tuple[int, int], known: Boxes, bit: Any) -> None:
        """`strike`, once for all cells that differ on axes alone that neither the set nor the image depends on."""
        counts, alike = self.layout.counts, self.strides == 0
        alike[known.axes] = False
        if not alike.any() or np.isfinite(self.layout.safe).any():
            strike(clear, tubes, places, known, bit, self.layout, NARROW)
            return
        first = np.full(clear.size, 255, np.uint8)
        cells = np.stack(np.unravel_index(self.layout.offset, counts))
        some = self.layout.offset[(cells[alike] == 0).all(axis=0)]
        strike(first, tubes, places, known, bit, self.layout._replace(offset=some, free=some.size), NARROW)
        one = first.reshape(counts)[tuple(slice(1 if own else None) for own in alike)]
        clear &= np.broadcast_to(one, counts).ravel()

    # ---- sets over boxes and times

    @property
    def _always(self) -> tuple[float, float]:
        return 0.0, np.inf if self.problem.steps is None else self.problem.time(self.problem.steps)

    @cached_property
    def timeless(self) -> bool:
        """Whether one set stands for all starts, because nothing depends on time."""
        return self.problem.timeless

    def _lattices(self, progress: bool | None) -> list[list[Boxes]]:
        """For each unsafe set a lattice for each step, or one for all where it stands still."""
        out: list[list[Boxes]] = []
        for part in tqdm(self.problem.unsafe, desc="unsafe sets", disable=hidden(progress)):
            if not part.moving:
                out.append([lattice_of(self.bounds, self.axes, part, [self._always], 1)])
                continue
            out.append([])
            (length, _), late = self.problem.sensing.hold(self.problem.delta), self.problem.sensing.jitter
            for begin in map(self.problem.time, range(self.problem.steps)):
                cuts = itertools.pairwise(begin + length * at / self.parts for at in range(self.parts + 1))
                times = [(t0 - late, t1 + late) for t0, t1 in cuts]
                out[-1].append(lattice_of(self.bounds, self.axes, part, times, self.problem.steps))
        return out

    def goal(self, step: int) -> FloatArray:
        """Cells inside the target and outside the unsafe set at t_k; at all times where nothing depends on time.

        With all that a prediction in the cell may stand for, at all times that t_k may be.
        """
        problem, t, out = self.problem, self.problem.time(step), self._clear_of_still.copy()
        times = self._always if self.timeless else (t - problem.sensing.jitter, t + problem.sensing.jitter)
        for part in problem.unsafe:
            if part.moving:
                out &= self._over_cells(part, times)[0] > 0.0
        if not problem.stays:
            out &= self._over_cells(problem.target, times)[1] <= 0.0
        return to_words(out.reshape(-1, self.axes[-1].count))

    @cached_property
    def _clear_of_still(self) -> FloatArray:
        """Cells outside the unsafe sets that stand still."""
        out = np.ones([axis.count for axis in self.axes], np.bool_)
        for part in self.problem.unsafe:
            if not part.moving:
                out &= self._over_cells(part, self._always)[0] > 0.0
        return out

    def _over_cells(self, part: Any, times: tuple[float, float]) -> list[FloatArray]:
        """Least and greatest value of a level set in every cell, broadcastable to the cells."""
        edges = [self.axes[axis].edges() for axis in part.axes]
        low, high = (
            np.stack(np.meshgrid(*(own[side : own.size - 1 + side] for own in edges), indexing="ij"), axis=-1)
            for side in (0, 1)
        )
        more = STATE_SLACK + self.unsure[list(part.axes)]
        ends = self.bounds.level(part, low.reshape(-1, len(edges)) - more, high.reshape(-1, len(edges)) + more, *times)
        shape = [axis.count if place in part.axes else 1 for place, axis in enumerate(self.axes)]
        return [end.reshape(shape) for end in ends]

    def add(
        self, prepared: Any, cells: FloatArray, following: FloatArray, step: int, changed: FloatArray | None
    ) -> None:
        """Make `cells`, S_k^{n-1}, S_k^n; following is S_{k+1}^{n-1}, which differs from S_{k+1}^{n-2} in some rows.

        Without a target S_k^n is what of S_k^{n-1} an input takes into `following`.
        """
        (moves, clear), near = self._at(step), np.ones(len(cells), np.bool_)
        if changed is not None:
            near[:] = False
            reach = np.stack([moves.low.min(axis=(0, 1)), moves.high.max(axis=(0, 1))]).astype(np.int64)
            reached_rows(changed, reach, self.cells, near)
        grow(np.flatnonzero(near), cells, following, clear, moves, self.cells, self.problem.stays)


def _added(moved: FloatArray, h: float, velocity: FloatArray, up: int) -> FloatArray:
    """moved + h * velocity, rounded up or down; exactly `moved` where nothing moves."""
    way = np.inf if up else -np.inf
    step = h * velocity
    step = step + (1e-15 if up else -1e-15) * np.abs(step)  # h is off the length of the piece by less
    return np.where(step == 0.0, moved, np.nextafter(moved + step, way))
