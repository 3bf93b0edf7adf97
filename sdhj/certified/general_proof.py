"""Which inputs are clear from which cells of any problem, by bounds on its sets over boxes, and what follows of sets.

Boxes of a lattice that may meet an unsafe set are counted, once for each part of an interval in which it moves; a tube
is clear of the set where it overlaps none of them. Each set is asked about on the axes that it takes, and no others
(`sdhj.certified.dangers`).
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial, reduce
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

from sdhj.certified.arrivals import Arrivals, sites_of
from sdhj.certified.bounds import Bounds
from sdhj.certified.cells import MOST_PIECES, CellAxis, cells_of
from sdhj.certified.dangers import Dangers, dangers_of, kept_together
from sdhj.certified.images import (
    BOXES_OF_A_SET,
    PIECES_OF_A_CELL,
    PLACES,
    SIDES,
    Images,
    moves_of,
    place_axes,
    prediction_error,
)
from sdhj.certified.packing import Changes, Packing
from sdhj.common.checks import whole
from sdhj.common.memory import require_memory
from sdhj.common.remembering import FloatArray, kept, read_only
from sdhj.common.showing import hidden
from sdhj.kernels.interpolation import SLACK
from sdhj.kernels.packed import to_words
from sdhj.kernels.stencils import (
    CELLS_IN_CACHE,
    TOGETHER,
    Boxes,
    Clear,
    Placed,
    add_marked,
    add_up,
    certified_inputs,
    inputs_in_lines,
    mark_collisions,
    mark_exits,
)
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sets import UnsafeSet
from sdhj.table.container import Contents
from sdhj.table.files import read_array

NARROW = 1e-10  # of the largest coordinate of an axis: what a tube may stick out of the boxes that it is looked up in
MARGIN_OF_BOXES = 4e-10  # by so much are those boxes wider: NARROW, STATE_SLACK and room for rounding, some 1e-15


def counted_boxes(
    bounds: Bounds,
    axes: Sequence[CellAxis],
    unsafe_set: UnsafeSet,
    times: Sequence[tuple[float, float]],
    steps: int,
    sway: FloatArray,
    most: int = BOXES_OF_A_SET,
) -> Boxes:
    """Boxes on an unsafe set's axes, and prefix sums of those that may meet the set: `Boxes`.

    A box is a cell, or one of up to `PIECES_OF_A_CELL` equal parts along each axis; layers have none. There is one
    array of sums for each interval of `times`, and of several one more for all together. There are about `most` boxes,
    at all times and for all `steps`.
    """
    # No layers: boxes follow the axes themselves, and cells of a layer have no width.
    own = cells_of([replace(axes[axis], layers=(0, 0)) for axis in unsafe_set.axes], 0)
    # Fewer for more times and steps, as there are sums for each.
    boxes = most / (len(times) * steps * math.prod(own.counts.tolist()))
    fine = min(max(int(boxes ** (1 / len(unsafe_set.axes))), 1), PIECES_OF_A_CELL)
    pitch, sizes = own.width / fine, own.counts * fine
    # where most tubes stick out of their cells by less than a box, boxes are wider by it when the set is bounded, and
    # tubes are looked up without it
    sway = np.where(sway[list(unsafe_set.axes)] < pitch, sway[list(unsafe_set.axes)], 0.0)
    scale = np.array([axes[axis].scale for axis in unsafe_set.axes])
    wider = sway + MARGIN_OF_BOXES * scale
    corner = [begin + side * np.arange(size) for begin, side, size in zip(own.lower, pitch, sizes, strict=True)]
    low = [begin - more for begin, more in zip(corner, wider, strict=True)]
    high = [begin + side + more for begin, side, more in zip(corner, pitch, wider, strict=True)]
    some = [~bounds.outside(unsafe_set, low, high, span, HALVINGS_OF_A_BOX) for span in times]
    # of the whole interval, last, where span 0 of `mark_collisions` finds it
    some += [np.any(some, axis=0)] if len(some) > 1 else []
    sums = np.zeros((len(some), *(sizes + 1)), np.int32)
    for counted, meets in zip(sums, some, strict=True):
        counted[(slice(1, None),) * sizes.size] = meets
        for k, n in enumerate(counted.shape):
            add_up(counted.reshape(-1), n, math.prod(counted.shape[k + 1 :]))
    return Boxes(
        np.array(unsafe_set.axes),
        sizes,
        own.lower,
        pitch,
        own.length,
        own.periodic,
        sway + NARROW * scale,
        sums.reshape(len(sums), -1),
    )


HALVINGS_OF_A_BOX = 2  # along each axis, where the sign of a set's function is open: 4 pieces
NUMBER_OF_A_BLOCK = 4  # bytes, for each row of cells of each set
BYTES_OF_A_BOX, BYTES_OF_A_COUNT = 16, 4  # while the cells in a set are looked for, and as long as boxes are counted
FINEST = 8  # pieces of a part
EVALUATED = 4_000_000  # boxes in which a velocity is asked for, before pieces become as long as parts


def bytes_of_clear(problem: ReachAvoidProblem, axes: tuple[CellAxis, ...]) -> int:
    """The bytes of `GeneralProof.clear`, with these cells of each axis."""
    return sum(math.prod(one.shape(problem, axes)) for one in kept_together(dangers_of(problem)))


def finest(problem: ReachAvoidProblem, parts: int, moves: Sequence[int]) -> float:
    """Into how many pieces a part of an interval is cut, at most: from 1 to `FINEST`, not rounded.

    As many as need about `EVALUATED` boxes for the velocity.
    """
    if problem.dynamics.constant:
        return 1.0
    return min(max(EVALUATED / (math.prod(moves[:-1]) * parts * 2), 1.0), FINEST)


def peak_bytes(problem: ReachAvoidProblem, axes: tuple[CellAxis, ...], parts: int) -> int:
    """The bytes that a solve by a general proof takes at most, but for the blocks of the sets that it finds."""
    own = place_axes(problem, axes)
    # it has to count every array of `of`, `prepare` and `Packing`; `chosen_cells` takes fewer cells where it is large
    moves = moves_of(problem, axes, own)[1]
    boxes = [math.prod(axes[k].count for k in part.axes) for part in problem.all_sets]
    counted, every = 0, problem.most_steps * (parts + 1)  # boxes that are counted, at all times
    for part in problem.unsafe:
        counted += math.prod(axes[k].count for k in part.axes) * (every if part.moving else 1)
    needed = 4 * math.prod(moves) + bytes_of_clear(problem, axes) + 9 * math.prod(axis.count for axis in axes)
    needed += math.prod(sites_of(problem, axes, own)[1])
    if own[-1]:  # once more, as the recursion asks for them
        needed += 4 * math.prod(moves[1:])
    steps = problem.steps or 0  # for ever the last set alone is kept
    entries = steps + 1 if problem.time_invariant else (steps + 1) * (steps + 2) // 2
    needed += NUMBER_OF_A_BLOCK * entries * math.prod(axis.count for axis in axes[:-1])
    needed += BYTES_OF_A_COUNT * counted + BYTES_OF_A_BOX * max(boxes, default=0)
    return needed + 16 * PLACES * len(axes) * parts


class _Asked(NamedTuple):
    """What tubes are tested by, of the cells of some axes: those of `dangers`."""

    dangers: Dangers
    layout: Placed  # the cells in memory, without lines
    # (places,), at which of these cells' places a place is; -1 for one that differs on other axes only
    place: FloatArray
    bits: FloatArray  # (starts, cells, bytes) uint8, as `GeneralProof.clear`


@dataclass(frozen=True)
class GeneralProof(Images):
    """The images and tubes of a robot's cells over one interval, for the recursion and for questions about states.

    Made by `of` and filled by `prepare`, or read by `load`.

    Attributes
    ----------
    clear : (bytes,) uint8
        For each of `dangers`, (starts, cells, bytes) of the cells of its axes. Bit j % 8 of byte j // 8: under u_j all
        states of the cell stay clear over an interval.
    sites : (ndim,) int64
        A cell is at the site with number sum(cell * sites).
    arrives : (starts, sites, bytes) uint8
        Likewise: u_j leads all of a cell at the site into the target itself. (0, 0, 0) where that is not asked.
    """

    clear: FloatArray
    sites: FloatArray
    arrives: FloatArray
    kind = "enclosed"

    @classmethod
    def of(cls, problem: ReachAvoidProblem, axes: tuple[CellAxis, ...], parts: int) -> "GeneralProof":
        """A proof with arrays of the right size, which `prepare` fills."""
        size, own = math.prod(axis.count for axis in axes), place_axes(problem, axes)
        (strides, moves), (sites, arrives) = moves_of(problem, axes, own), sites_of(problem, axes, own)
        # Before any large array is made.
        require_memory(peak_bytes(problem, axes, parts), f"certifying {size:.1e} cells", "use fewer cells")
        low, high = np.zeros((2, *moves), np.int16)
        # All bits set: `prepare` only clears those of `clear` and sets those of `arrives`.
        marks = np.full(bytes_of_clear(problem, axes), 255, np.uint8), sites, np.zeros(arrives, np.uint8)
        return cls(problem, axes, parts, strides, low, high, *marks)

    @property
    def nbytes(self) -> int:
        """The bytes that the proof's arrays take in memory."""
        return sum(part.nbytes for part in vars(self).values() if isinstance(part, np.ndarray))

    @property
    def peak_bytes(self) -> int:
        """The bytes that a solve takes at most, without the sets that it finds."""
        return peak_bytes(self.problem, self.axes, self.parts)

    @cached_property
    def dangers(self) -> tuple[Dangers, ...]:
        """The dangers whose bits are kept together."""
        return kept_together(dangers_of(self.problem))

    @property
    def starts(self) -> int:
        """For how many steps moves or clear inputs are known: 1 where they are those of all."""
        return max([len(self.low), *(one.shape(self.problem, self.axes)[0] for one in self.dangers)])

    @property
    def bits_of_clear(self) -> list[FloatArray]:
        """The parts of `clear`, for each of `dangers`: (starts, cells, bytes), views."""
        # one behind the other, as `clear_at` and `Argument.read_clear` of the checker go through them
        shapes, begin, out = [one.shape(self.problem, self.axes) for one in self.dangers], 0, list[FloatArray]()
        for shape in shapes:
            out.append(self.clear[begin : begin + math.prod(shape)].reshape(shape))
            begin += math.prod(shape)
        return out

    def clear_at(self, step: int) -> Clear:
        """Where the bits of clear inputs are in an interval from a step, as arrays for compiled code."""
        begin, strides, total = list[int](), list[FloatArray](), 0
        for one in self.dangers:
            shape, counts = one.shape(self.problem, self.axes), self.counts_of(one)
            begin.append(total + min(step, shape[0] - 1) * shape[1] * shape[2])
            # 0 along an axis that the dangers do not have: its cells share bytes.
            strides.append(_strides(counts) * (counts > 1) * shape[2])
            total += math.prod(shape)
        ndim = len(self.axes)
        found = np.array(begin, np.int64), np.array(strides, np.int64).reshape(-1, ndim)
        return Clear(self.clear, *read_only(found))

    def counts_of(self, dangers: Dangers) -> FloatArray:
        """How many cells there are along each axis, 1 on those that the dangers do not have."""
        own = np.zeros(len(self.axes), np.bool_)
        own[[*dangers.axes]] = True
        return np.where(own, self.cells.counts, 1)

    def inputs(
        self,
        some: FloatArray,
        steps_left: FloatArray,
        step: int,
        sets: FloatArray,
        pool: FloatArray,
        among: FloatArray,
        lines: bool,
    ) -> FloatArray:
        """Which of some inputs are certified for cells `some` (M, ndim), indices, at a step: (M, L).

        An input is certified if it stays clear and leads all of the cell into the set with a step less, or into the
        target itself.

        steps_left (M,) : 0: no input is certified. sets (n, R), pool : the sets S_{k+1}^0, S_{k+1}^1, ..., each the
        numbers of its rows' blocks in `pool`; n = 0:
            staying clear is enough.
        among : (M, L), the inputs that are asked about; False for all others.
        lines : whether the cells come in lines along the axis `along`, which takes less time.
        """
        out, clear = among.copy(), self.clear_at(step)
        # in lines what is clear first: `inputs_in_lines` does not ask for it
        if len(sets) and lines and self.along >= 0:
            certified_inputs(some, steps_left, self.cells, self.moves(step), clear, sets[:0], pool, out)
            inputs_in_lines(some, steps_left, self.cells, self.moves(step), self.along, sets, pool, out)
        else:
            certified_inputs(some, steps_left, self.cells, self.moves(step), clear, sets, pool, out)
        if len(sets) and len(self.arrives):
            # who arrives needs no cell of a set, however many steps are left
            bits = self.arrives[min(step, len(self.arrives) - 1), some @ self.sites]
            for begin, strides in zip(clear.begin, clear.strides, strict=True):
                bits = bits & clear.bits[(begin + some @ strides)[:, None] + np.arange(bits.shape[1])]
            rows = np.flatnonzero(bits.any(axis=1) & (steps_left > 0))
            every = np.unpackbits(bits[rows], axis=1, count=out.shape[1], bitorder="little").view(np.bool_)
            out[rows] |= every & among[rows]
        return out

    @property
    def entry_in_head(self) -> dict[str, Any]:
        """The proof's part of a file's head, which `load` is handed again."""
        # `Argument.read_proof` of the checker reads these names, too, and `load` refuses others.
        # which axes are those of a place, and E
        told = {"parts": self.parts, "own": (self.strides > 0).tolist(), "unsure": self.prediction_error.tolist()}
        told["clear"] = [one.entry_in_head for one in self.dangers]
        return told | ({"arrives": True} if len(self.arrives) else {})

    @property
    def arrays(self) -> dict[str, FloatArray]:
        """The proof's arrays in a file: "low", "high" and "clear", and "arrives" if any."""
        names = ("low", "high", "clear", *(["arrives"] if len(self.arrives) else []))
        return {name: getattr(self, name) for name in names}

    @classmethod
    def load(
        cls, stated: Mapping[str, Any], file: Contents, problem: ReachAvoidProblem, axes: tuple[CellAxis, ...]
    ) -> "GeneralProof":
        """The proof whose arrays are in an open file; its arrays are read-only.

        What is stated, shapes and types must fit the problem and its cells; the bits of the arrays are not checked, nor
        that `own` is right (the shapes of the arrays rest on it): the checker does. `unsure` has to be the E that a
        controller counts on, as the checker proves what is stated and not that it is no more.
        """
        if unknown := stated.keys() - {"parts", "own", "unsure", "clear", "arrives"}:
            raise ValueError(
                f"its proof has {', '.join(sorted(unknown))}, which this version does not know; solve it anew"
            )
        if len(stated["own"]) != len(axes) or not {True, False}.issuperset(stated["own"]):
            raise ValueError(f"axes of a place must be stated for each axis, got {stated['own']}")
        # The dangers of this problem in their order, as bits of `clear` have no names.
        if stated["clear"] != [one.entry_in_head for one in kept_together(dangers_of(problem))]:
            raise ValueError(f"unsafe sets must be asked about on their own axes, got {stated['clear']}")
        if problem.sensing.delay and not np.allclose(stated["unsure"], prediction_error(problem), rtol=1e-9, atol=0.0):
            raise ValueError(f"predictions must be off by {prediction_error(problem)} at most, got {stated['unsure']}")
        own, clear = np.array(stated["own"], np.bool_), bytes_of_clear(problem, axes)
        (strides, moves), (sites, arrives) = moves_of(problem, axes, own), sites_of(problem, axes, own)
        arrays = read_array(file, "low", "int16", moves), read_array(file, "high", "int16", moves)
        parts = whole("parts", stated["parts"], least=1, most=MOST_PIECES)
        marks = read_array(file, "clear", "uint8", (clear,)), sites, np.zeros((0, 0, 0), np.uint8)
        if stated.get("arrives"):
            marks = *marks[:2], read_array(file, "arrives", "uint8", arrives)
        return cls(problem, axes, parts, strides, *read_only((*arrays, *marks)))

    # ---- the recursion; sets are (rows, W) uint64

    def _asked(self) -> list[_Asked]:
        """An `_Asked` for each of `dangers_of`: its bits are a view of `clear`, or what `_unite` takes into it."""
        edges = np.full((len(self.axes), self.cells.counts.max() + 1), np.nan)
        for axis, cells in enumerate(self.axes):
            edges[axis, : cells.count + 1] = cells.edges()
        safe, nothing = self.open_ends + SIDES[:, 0] * self.shell, np.zeros(0, np.int64)
        clear_bits, out = dict(zip((one.axes for one in self.dangers), self.bits_of_clear, strict=True)), list[_Asked]()
        at_place = self.cells_at(np.arange(self.low.shape[2]))
        for one in dangers_of(self.problem):
            counts = self.counts_of(one)
            begin = _numbers(self.strides > 0, counts)
            others = np.isin(np.arange(len(counts)), one.axes, invert=True)
            first = ~at_place[:, others].any(axis=1)  # of the places that differ on other axes only
            # numbered as places ascend: `_mark_collisions` hands on ranges of these numbers
            place = np.where(first, np.cumsum(first) - 1, -1)
            layout = Placed(*read_only((counts, begin)), nothing, 0, 0, 0, *read_only((edges, safe)))
            # those that are kept with others of more axes are marked in an array of their own, until `_unite`
            unmarked = np.full(() if one.axes in clear_bits else one.shape(self.problem, self.axes), 255, np.uint8)
            out.append(_Asked(one, layout, place, clear_bits.get(one.axes, unmarked)))
        return out

    def prepare(self, progress: bool | None) -> Packing:
        """Fill moves, `clear` and `arrives`, make them read-only, and return the `Packing` that `add` needs; once.

        ValueError as from `Images.fill`.
        """
        arrivals, every = Arrivals(self), self._asked()
        mark = partial(self._mark_collisions, every, self._boxes_of_sets(progress))

        def use(start: int, j: int, some: FloatArray, tubes: FloatArray, last: FloatArray) -> None:
            mark(start, j, some, tubes)
            arrivals.add(start, j, some, last)

        self.fill(int(finest(self.problem, self.parts, self.low.shape)), progress, use)
        # after all marks, and before what is read-only
        self._unite(every)
        read_only((self.low, self.high, self.clear, self.sites, self.arrives))
        return Packing(self)

    def _unite(self, asked: Sequence[_Asked]) -> None:
        """Clear in `clear` what was marked of dangers that are kept with those of more axes."""
        for one, bits in zip(self.dangers, self.bits_of_clear, strict=True):
            every = bits.reshape(len(bits), *self.counts_of(one).tolist(), -1)
            for own in asked:
                part_of_it = {*own.dangers.sets} <= {*one.sets} and {*own.dangers.ends} <= {*one.ends}
                if part_of_it and own.dangers.axes != one.axes:
                    # A bit for a cell of fewer axes holds for all cells of `one` that lie in it.
                    every &= own.bits.reshape(len(own.bits), *own.layout.counts.tolist(), -1)

    def _mark_collisions(
        self,
        every: Sequence[_Asked],
        counted: Mapping[int, list[Boxes]],
        start: int,
        j: int,
        some: FloatArray,
        tubes: FloatArray,
    ) -> None:
        """Clear the bit of u_j in `clear`, in place, for cells whose tube may meet an unsafe set or an unsafe end."""
        for asked in every:
            rows = np.flatnonzero(asked.place[some] >= 0)
            if rows.size:
                # One range, as `_asked` numbers places in ascending order.
                first = int(asked.place[some[rows[0]]])
                own = tubes if rows.size == some.size else np.ascontiguousarray(tubes[rows])
                self._mark_where_met(asked, counted, start, j, (first, first + rows.size), own)

    def _mark_where_met(
        self,
        asked: _Asked,
        counted: Mapping[int, list[Boxes]],
        start: int,
        j: int,
        places: tuple[int, int],
        tubes: FloatArray,
    ) -> None:
        """Clear the bit of u_j in `asked.bits` for all steps with these moves; it numbers the places."""
        dangers, bit = asked.dangers, np.uint8(1 << j % 8)
        # ends and sets that stand still are looked at once for all steps; bits of other inputs stay set
        still = np.full(asked.bits.shape[1], 255, np.uint8)
        if dangers.ends:
            layout = self._in_lines(asked.layout, dangers.ends)
            mark_exits(still, tubes, places, self._faces(dangers.ends), bit, layout)
        own = [number for number in dangers.sets if self.problem.unsafe[number].counts(j)]

        def mark(clear: FloatArray, boxes: Boxes) -> None:
            together = TOGETHER if clear.size > CELLS_IN_CACHE else 1
            layout = self._in_lines(asked.layout, boxes.axes.tolist())
            mark_collisions(clear, tubes, places, boxes, bit, layout, together)

        for boxes in (counted[number][0] for number in own if len(counted[number]) == 1):
            mark(still, boxes)
        for step in range(len(asked.bits)) if len(self.low) == 1 else (start,):
            # A new array, which has what stands still, and of what moves only this step.
            clear = asked.bits[step, :, j // 8] & still
            for number in (number for number in own if len(counted[number]) > 1):
                mark(clear, counted[number][step])
            asked.bits[step, :, j // 8] = clear

    def _faces(self, ends: Sequence[int]) -> FloatArray:
        """The coordinates of the unsafe ends of some axes, a rounding farther out, infinite for others."""
        grid, others = self.problem.grid, np.isin(np.arange(len(self.axes)), ends, invert=True)
        # less than the checker grants by twice the shell (`ROOM`, `Argument.stays`), so that it agrees
        rounding = np.maximum(SLACK * np.array(grid.spacing) - 2 * self.shell, 0.0)
        faces = np.stack(grid.faces("fails")) + np.stack([-rounding, rounding])
        return np.where(others, np.stack([-np.full(others.size, np.inf), np.full(others.size, np.inf)]), faces)

    def _in_lines(self, layout: Placed, axes: Sequence[int]) -> Placed:
        """A layout with its cells in lines along the last of some axes on which cells at a place differ."""
        counts, some = layout.counts, (self.strides == 0) & (layout.counts > 1)
        # `mark_collisions` needs a line along one of the set's axes, be it of a single cell
        along = int([axes[-1], *(axis for axis in axes if some[axis])][-1])
        length, stride = int(counts[along]) if some[along] else 1, math.prod(counts[along + 1 :].tolist())
        some[along] = False  # the line itself goes along it
        return layout._replace(offset=_numbers(some, counts), axis=along, stride=stride, length=length)

    @kept
    def _sway(self) -> FloatArray:
        """About how far the disturbance and errors move a state to each side in an interval, (ndim,)."""
        grid, sensing = self.problem.grid, self.problem.sensing
        # An estimate, which only decides how wide boxes are: what tubes hold does not rest on it.
        middle, t = np.add(grid.lower, grid.upper)[None] / 2, self.problem.time(0)
        pushed = [
            np.ptp(self.bounds.velocity(j, middle, middle, t, t), axis=0)[0] for j in range(len(self.problem.inputs))
        ]
        return np.asarray(np.max(pushed, axis=0) / 2 * sensing.hold(self.problem.delta)[0] + self.prediction_error)

    def _spans(self, unsafe_set: UnsafeSet) -> list[list[tuple[float, float]]]:
        """For each step the (from, to), s, of each part of its interval, widened by the jitter."""
        if not unsafe_set.moving:
            return [[self._all_times]]
        # `Argument.misses` of the checker cuts the interval in the same way
        length, late, out = self.problem.sensing.hold(self.problem.delta)[0], self.problem.sensing.jitter, []
        for begin in map(self.problem.time, range(self.problem.steps)):
            cuts = itertools.pairwise(begin + length * at / self.parts for at in range(self.parts + 1))
            out.append([(t0 - late, t1 + late) for t0, t1 in cuts])
        return out

    def _boxes_of_sets(self, progress: bool | None) -> dict[int, list[Boxes]]:
        """The `counted_boxes` of each unsafe set: one for each step, or one of all steps."""
        made, out = partial(counted_boxes, self.bounds, self.axes), dict[int, list[Boxes]]()
        for number, part in enumerate(tqdm(self.problem.unsafe, "unsafe sets", leave=False, disable=hidden(progress))):
            spans = self._spans(part)
            out[number] = [made(part, times, len(spans), self._sway) for times in spans]
        return out

    def goal(self, step: int) -> FloatArray:
        """S_k^0 for k = step, packed (rows, W) uint64: cells inside the target and outside the unsafe sets at t_k.

        Each cell is widened by the shell and by E, and has to be so at all times that t_k may be. Sets that are unsafe
        under some inputs only do not count.
        """
        problem, t = self.problem, self.problem.time(step)
        times = self._all_times if self.time_invariant else (t - problem.sensing.jitter, t + problem.sensing.jitter)
        out = np.ones([axis.count for axis in self.axes], np.bool_)
        if not problem.has_no_target:
            # < 0 is proved inside, 0 is open
            out &= self.over_cells(problem.target, times) < 0
        # what stands still is asked once: of all cells, unless there is one goal only
        still = self.clear_of(False, self._all_times, out) if self.time_invariant else self._clear_of_still
        out &= still
        out &= self.clear_of(True, times, out)
        return to_words(out.reshape(-1, self.axes[-1].count))

    @kept
    def _clear_of_still(self) -> FloatArray:
        """Which cells are outside the unsafe sets that stand still."""
        return self.clear_of(False, self._all_times, np.ones([axis.count for axis in self.axes], np.bool_))

    def clear_of(self, moving: bool, times: tuple[float, float], asked: FloatArray) -> FloatArray:
        """Which cells `asked` about are outside the unsafe sets that move, or stand still, at all `times`."""
        out = asked.copy()
        for part in self.problem.unsafe:
            if part.moving == moving and part.inputs is None:
                others = tuple(axis for axis in range(len(self.axes)) if axis not in part.axes)
                # Of the set's axes the cells that some cell is still asked about at.
                some = np.asarray(out.any(axis=others))
                out &= self.outside_cells(part, times, some)
        return out

    def add(self, prepared: Packing, cells: FloatArray, following: FloatArray, step: int, changed: Changes) -> None:
        """Turn `cells`, S_k^{n-1}, into S_k^n for k = step, in place, by `following`, S_{k+1}^{n-1}: (rows, W) uint64.

        `changed` are the rows, and their words, in which `following` differs from S_{k+1}^{n-2}; None: any may.
        """
        prepared.add(cells, following, step, changed)

    def add_arriving(self, cells: FloatArray, step: int) -> None:
        """Add to `cells`, S_k^1, those that a clear input leads into the target itself."""
        if len(self.arrives):
            arrives = self.arrives[min(step, len(self.arrives) - 1)]
            add_marked(cells, self.clear_at(step), arrives, self.sites, self.cells.counts)


def _strides(counts: FloatArray) -> FloatArray:
    """By how much the flat number of a cell grows along each axis; counts (ndim,) of cells."""
    return np.cumprod([1, *counts[:0:-1].tolist()])[::-1]


def _numbers(which: FloatArray, counts: FloatArray) -> FloatArray:
    """The numbers (n,) of the cells that have index 0 on all axes but `which`."""
    each = zip(_strides(counts), np.where(which, counts, 1), strict=True)
    return np.asarray(reduce(np.add.outer, [flat * np.arange(count) for flat, count in each])).ravel()
