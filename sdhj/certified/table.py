"""The look-up table of the certified method, whose every answer is proved."""

import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import InitVar, dataclass, field, replace
from functools import cached_property, reduce
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar

import numpy as np

from sdhj.arm.case_studies import as_built
from sdhj.certified.arm.proof import ArmProof
from sdhj.certified.cells import DRIFT, CellAxis, axis_in_file
from sdhj.certified.check import Verdict, looked_over
from sdhj.certified.check import verify as check
from sdhj.certified.explaining import explain, on_few_nodes
from sdhj.certified.general_proof import GeneralProof
from sdhj.certified.words import CLEAR, ProvedBatch, Words, preferred
from sdhj.common.checks import number, real_array, states_array, whole
from sdhj.common.findings import Finding, UnsettledWarning, tell
from sdhj.common.remembering import FloatArray, Sealed, kept, read_only
from sdhj.formulas.formula import BlackBox
from sdhj.kernels.packed import TOUCHING, Cells, boxes_in_set, fewest_steps, to_bits
from sdhj.kernels.words import cells_near, fewest_of_cells
from sdhj.problem.describing import arrays_of
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.table.as_sets import ON_TIME
from sdhj.table.batches import NOT_ADMISSIBLE, Batch, Player, Table, entry
from sdhj.table.container import Contents
from sdhj.table.files import TableFileError, make_head, read_array, write_table

SLAB = 2**16  # blocks that are unpacked at a time
STATES_DRAWN = 1 << 18  # states, to estimate a share
MANY, AT_ONCE = 64, 1 << 18  # points around a state that are all looked up; and around all states at a time
PROOFS: dict[str, Any] = {"arm": ArmProof, "enclosed": GeneralProof}


@dataclass(frozen=True, repr=False)
class CertifiedTable(Table):
    """All certified tubes S_k^n, as sets of cells; made by `sdhj.solve` with the method `Certified`.

    It is used like a `LookupTable`. The level-set function of S_k^n is the number of steps within which the target is
    certified to be reached (N - k + 1 if it is not) minus n: a whole number, <= 0 inside.

    Attributes
    ----------
    proof : ArmProof or GeneralProof
        The reach sets and swept tubes of the cells over one interval.
    index : (entries, rows) uint32
        For each (start, within) and each cell of the leading axes, the block of `pool`. Where nothing depends on time,
        there is one entry for each `within`, or the last one alone.
    pool : (blocks, words) uint64
        Cells of the remaining axes, a bit each; block 0 is empty.
    details : mapping
        Options and statistics of the solve.
    """

    proof: ArmProof | GeneralProof
    index: FloatArray
    pool: FloatArray
    details: Mapping[str, Any]
    player: Player | None = field(default=None, compare=False)
    mapped_from: InitVar[Any] = None  # `origin`; nothing of what `dataclasses.replace` makes of it
    method: ClassVar[str] = "certified"  # type: ignore[misc]  # of all of them
    proved: ClassVar[bool] = True
    _explain = explain

    def __post_init__(self, mapped_from: Any) -> None:
        read_only((self.index, self.pool))
        object.__setattr__(self, "details", Sealed(self.details))
        object.__setattr__(self, "origin", mapped_from)

    @property
    def problem(self) -> ReachAvoidProblem:  # type: ignore[override]  # that of the proof
        """The problem of the proof."""
        return self.proof.problem

    def __repr__(self) -> str:
        """As of any table, and how many of its claims were checked."""
        looked, made = self.details.get("checked", (0, 0))
        return f"{super().__repr__()[:-1]}; {looked:,} of {made:,} claims checked>" if made else super().__repr__()

    @property
    def axes(self) -> tuple[CellAxis, ...]:
        """The cells of each axis."""
        return self.proof.axes

    @property
    def cells(self) -> Cells:
        """Where the cells are and how they are packed, for compiled code."""
        return self.proof.cells

    @property
    def shape(self) -> tuple[int, ...]:
        """The number of cells on each axis."""
        return tuple(axis.count for axis in self.axes)

    @property
    def nbytes(self) -> int:
        """The bytes that the sets and the proof's arrays take in memory."""
        return int(self.index.nbytes + self.pool.nbytes) + self.proof.nbytes

    def tube_index(self, start: int, within: int | None) -> int:
        """The row of `index` for the tube (start, within)."""
        start, within = self.clipped(start, within)
        # it has a row for each (k, n), for each n, or one that holds for ever: the checker numbers them alike
        # (`Argument.row`)
        several = len(self.index) > self.steps + 1
        return entry(self.steps, start, within) if several else min(within, len(self.index) - 1)

    def _first_set(self, states: FloatArray, first: int, last: int, slack: FloatArray) -> FloatArray:
        """The first set in rows first to last of `index`, each inside the next, that a state (M, ndim) is in: (M,).

        last - first + 1 for none.
        """
        states = states_array("states", np.atleast_2d(real_array("states", states)), len(self.axes))
        out = np.empty(len(states), np.int64)
        fewest_steps(states, self.cells, slack, self.index[first : last + 1], self.pool, out)
        return out

    def steps_to_go(self, states: FloatArray, step: int) -> FloatArray:
        """The fewest steps within which states (M, ndim) at a step are certified to reach the target: (M,).

        N - step + 1 where none is certified.
        """
        found = self.steps_by_cells(states, step)
        found[self.arrived(np.atleast_2d(real_array("states", states)), step)] = 0
        return found

    def arrived(self, states: FloatArray, step: int) -> FloatArray:
        """The numbers (R,) of states that are in the target itself and clear, in any cell."""
        # by the level-set functions; of none that is off the grid by more than the shell
        rows = self.problem.arrived(states, step)
        return rows[~np.logical_or(*self.past_ends(states[rows])).any(axis=1)] if rows.size else rows

    def past_ends(self, states: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Whether states are past the lower, and the upper end of each axis by more than the shell: (M, ndim) each.

        By the same operations as `sdhj_place_of` in C.
        """
        cells, shell = self.cells, self.proof.shell
        offset = np.where(cells.periodic, 0.0, states - cells.lower)
        begin, end = cells.layers[0] * cells.width, cells.length - cells.layers[1] * cells.width
        return offset < begin - shell, offset > end + shell

    def steps_by_cells(self, states: FloatArray, step: int) -> FloatArray:
        """The fewest steps certified of the cells that states (M, ndim) at a step are in: (M,), N - step + 1 for none.

        Without a target 0 where a state is certified to stay clear for all steps left.
        """
        last = self.tube_index(step, self.steps)
        if self.problem.has_no_target:
            return self._first_set(states, last, last, self.proof.shell) * (self.steps - step + 1)
        return self._first_set(states, self.tube_index(step, 0), last, self.proof.shell)

    def _inside(self, points: FloatArray, start: int, within: int) -> FloatArray:
        """Whether states are in the tube (start, within), in its cells or `arrived`."""
        out = self.in_cells(points, start, within)
        out[self.arrived(np.atleast_2d(points), start)] = True
        return out

    def in_cells(self, points: FloatArray, start: int, within: int) -> FloatArray:
        """Whether states (M, ndim) are in the closed cells of the tube (start, within), no shell: (M,).

        With sensing, all of the box E around it.
        """
        place = self.tube_index(start, within)
        out = self._first_set(points, place, place, self.proof.rounding) == 0  # the shell is a run's reserve
        if self.problem.sensing:
            out[out] = self._inside_around(np.atleast_2d(points)[out], start, within)
        return out

    def _inside_around(self, states: FloatArray, start: int, within: int) -> FloatArray:
        """Whether all that may be measured of states is in the tube (start, within)."""
        off, ndim = self.proof.prediction_error, len(self.axes)
        many = math.prod(math.ceil(2 * e / float(own.width)) + 2 for e, own in zip(off, self.axes, strict=True))
        found, asked = np.ones(len(states), np.bool_), np.arange(len(states))
        # few are asked in full: not those of which a corner is outside, or a box of cells has all
        if many > MANY:
            corners = [
                self.grid.clipped(states + side * off, "holds", "fails")
                for side in np.indices([2] * ndim).reshape(ndim, -1).T * 2 - 1
            ]
            for corner in corners:
                found &= ~self.outside(corner, start, within)
            # boxes count as certified even if they exceed cells by this
            spare = self.proof.shell + 2 * DRIFT * np.array([axis.scale for axis in self.axes])
            sure = self.certified_boxes(corners[0] - spare, corners[-1] + spare, start=start, within=within)[0]
            asked = np.flatnonzero(found & ~sure)
        for some in np.array_split(asked, math.ceil(len(asked) * many / AT_ONCE) or 1):
            around = self.points_of_error_box(states[some])
            inside = ~self.outside(around.reshape(-1, ndim), start, within)
            found[some] = inside.reshape(around.shape[:2]).all(axis=1)
        return found

    def outside(self, points: FloatArray, start: int, within: int) -> FloatArray:
        """Whether points, measured or predicted, are in no closed cell of the tube."""
        place = self.tube_index(start, within)
        return self._first_set(points, place, place, self.proof.rounding) > 0

    def holds(self, cell: FloatArray, start: int, within: int) -> bool:
        """Whether the cell with indices (ndim,) is certified for the tube (start, within)."""
        place, out = self.tube_index(start, within), np.empty(1, np.int64)
        fewest_of_cells(cell[None], self.cells, self.index[place : place + 1], self.pool, out)
        return bool(out[0] == 0)

    def points_of_error_box(self, states: FloatArray) -> FloatArray:
        """Points (M, V, ndim) of the box E around each state (M, ndim), one at least in every cell that it overlaps.

        Where all of them are in a set, so is whatever may be measured.
        """
        columns = []
        for axis, (own, off) in enumerate(zip(self.axes, self.proof.prediction_error, strict=True)):
            width, x = float(own.width), states[:, axis, None]
            column = x + np.linspace(-off, off, math.ceil(2 * off / width) + 1 if off else 1)
            if own.periodic and off:  # the last cell may be narrower than what lies between two of these
                length, last = float(sum(own.extent) / 2), own.edges()[-2:].mean()
                to_last = (last - x + length / 2) % length - length / 2
                column = np.concatenate([column, x + np.clip(to_last, -off, off)], axis=1)
            columns.append(column)
        places = np.indices([column.shape[1] for column in columns]).reshape(len(columns), -1)
        found = np.stack([column[:, place] for column, place in zip(columns, places, strict=True)], axis=-1)
        return self.grid.clipped(found, "holds", "fails")

    def as_level_set(self, within: int | None) -> BlackBox:
        """A level-set function that is -1 in the cells certified within `within` steps, by default N, and 1 elsewhere.

        A `BlackBox`, for a set of another problem. At t_k it is that of the tube of step k, else 1 everywhere, unless
        nothing depends on time.
        """
        return _level_set_of_cells(
            self, self.steps if within is None else whole("within", within, least=0, most=self.steps)
        )

    def certified_boxes(self, low: FloatArray, high: FloatArray, *, start: int, within: int) -> FloatArray:
        """Whether all, and whether any, states of boxes from low to high (M, ndim) are in a tube's cells: (2, M).

        A box may exceed the cells by the shell plus twice `DRIFT` of the scale. One that crosses the end of an axis
        counts as certified in part.
        """
        cells, index, out = self.cells, self.index[self.tube_index(start, within)], np.empty((2, 2, len(low)), np.bool_)
        # for `_inside_around`, and for bounds of `as_level_set`, on which the proof of another problem may rest
        shell, drift = self.proof.shell, DRIFT * np.array([axis.scale for axis in self.axes])
        begin, end = cells.layers[0] * cells.width, cells.length - cells.layers[1] * cells.width
        known = ((low - cells.lower > begin - 2 * shell) & (high - cells.lower < end + 2 * shell)).all(axis=1)
        for spare, answer in zip((shell + 2 * drift, -shell), out, strict=True):
            first = np.floor((low - cells.lower + spare) / cells.width)
            last = np.ceil((high - cells.lower - spare) / cells.width) - 1
            first = np.clip(first, 0, cells.counts - 1).astype(np.int64)
            last = np.clip(last, first, cells.counts - 1).astype(np.int64)
            if (
                spare[0] > 0 and not cells.wall_known
            ):  # all of a box that is no wider than a layer's shell is in the layer
                at_walls = high - cells.lower <= begin + spare, low - cells.lower >= end - spare
                for at_wall, layer, place in zip(
                    at_walls, cells.layers, (0 * cells.counts, cells.counts - 1), strict=True
                ):
                    first, last = (np.where(at_wall & (layer > 0), place, one) for one in (first, last))
            boxes_in_set(first, last, cells, index, self.pool, answer)
        return np.stack([out[0, 0] & known, out[1, 1] | ~known])

    def certified_inputs(self, states: FloatArray, step: int, within: int) -> FloatArray:
        """Which inputs are proved safe and to leave `within` - 1 steps to go, from states (M, ndim): (M, L)."""
        place, within = self.tube_index(step, within), min(within, self.steps - step)

        def asked(cells: FloatArray) -> FloatArray:
            # none from those not in this tube
            first = np.empty(len(cells), np.int64)
            fewest_of_cells(cells, self.cells, self.index[place : place + 1], self.pool, first)
            return self.inputs_of(cells, np.where(first == 0, within, 0), step)

        return self._inputs_of_near_cells(states, asked)

    def _inputs_of_near_cells(self, states: FloatArray, asked: Callable[[FloatArray], FloatArray]) -> FloatArray:
        """For each state (M, ndim) the OR of asked(cell) over all cells within the shell of the state: (M, L)."""
        rows, cells = self.near_cells(states)
        out = np.zeros((len(states), len(self.problem.inputs)), np.bool_)
        np.logical_or.at(out, rows, asked(cells))
        return out

    def near_cells(self, states: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The cells within whose shell states (M, ndim) lie: of which state, (n,) in order, and indices (n, ndim)."""
        ndim = len(self.axes)
        # Room for all cells that a state may be near: two along each axis.
        rows, cells = np.empty(len(states) << ndim, np.int64), np.empty((len(states) << ndim, ndim), np.int64)
        count = cells_near(np.ascontiguousarray(states), self.cells, self.proof.shell, rows, cells)
        return rows[:count], cells[:count]

    def fewest(self, cells: FloatArray, step: int) -> FloatArray:
        """The fewest steps certified for all states of each cell (M, ndim), indices: (M,), N - step + 1 for none."""
        last, out = self.tube_index(step, self.steps), np.empty(len(cells), np.int64)
        first = last if self.problem.has_no_target else self.tube_index(step, 0)
        fewest_of_cells(cells, self.cells, self.index[first : last + 1], self.pool, out)
        return out * (self.steps - step + 1) if self.problem.has_no_target else out

    def inputs_of(
        self, cells: FloatArray, steps_left: FloatArray, step: int, among: FloatArray | None = None, lines: bool = False
    ) -> FloatArray:
        """Which inputs are certified from all states of cells (M, ndim), indices, at a step: (M, L).

        An input is certified if it leads into the set with `steps_left` (M,) - 1; 0: none is. Only those `among` (M, L)
        are asked about; cells in `lines` along `proof.along` take less time.
        """
        among = np.ones((len(cells), len(self.problem.inputs)), np.bool_) if among is None else among
        if step == self.steps:
            return np.zeros_like(among)
        # All sets of step k + 1, of which `steps_left` - 1 picks one.
        sets = self.index[self.tube_index(step + 1, 0) : self.tube_index(step + 1, self.steps) + 1]
        return self.proof.inputs(cells, steps_left, step, sets, self.pool, among, lines)

    def clear_inputs(self, cells: FloatArray, step: int) -> FloatArray:
        """Which inputs are proved to stay clear over the interval from all states of cells: (M, L)."""
        every = np.ones((len(cells), len(self.problem.inputs)), np.bool_)
        return self.proof.inputs(cells, np.ones(len(cells), np.int64), step, self.index[:0], self.pool, every, False)

    def bounds_of_next_points(
        self, points: FloatArray, inputs: FloatArray, step: int
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The boxes in which a controller that remembers goes on, and how far from them the next measurement may be.

        Three (M, ndim): the ends of the cells that points are led to under inputs (M,), or a point half a shell behind
        a wall where all of them are its layer, NaN off the grid; and 2 E, or E where both corners are the same.
        """
        # for `next_points`, as `sdhj_applied` has it in C, with `sdhj_edge` and `sdhj_behind`
        low, high = np.full((2, *points.shape), np.nan)  # off the grid
        rows, begin, end = self.image_cells(points, inputs, step)
        low[rows], high[rows] = self._edge(begin), self._edge(end + 1)
        cells, behind = self.cells, 0.5 * self.proof.shell  # a wall: the one point of a layer
        lower, length = cells.lower + cells.layers[0] * cells.width, cells.length - cells.layers[1] * cells.width
        for layer, cell, point in ((0, 0, lower - behind), (1, cells.counts - 1, cells.lower + length + behind)):
            known = (cells.layers[layer] == 1) & (begin == cell) & (end == cell)
            low[rows], high[rows] = (np.where(known, point, one[rows]) for one in (low, high))
        return low, high, np.where(low == high, 1.0, 2.0) * self.proof.prediction_error

    def image_cells(
        self, points: FloatArray, inputs: FloatArray, step: int
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The cells that points (M, ndim) at a step are led to under inputs (M,): (rows, first, last)."""
        (rows, cells), left = self.near_cells(points), self.steps - step
        fewest, each = self.fewest(cells, step), np.arange(len(rows))
        certified = fewest <= left
        steps_tried = (
            [np.full(len(rows), left)]
            if self.problem.has_no_target
            else [np.maximum(fewest, 1), np.full(len(rows), left)]
        )
        good = [
            self.inputs_of(cells, np.where(certified, steps_left, 0), step)[each, inputs[rows]]
            for steps_left in steps_tried
        ]
        nearest = np.where(good[0], steps_tried[0], left + 1)
        # of several cells within the shell: from which the input is proved, with the fewest steps to go
        # `sdhj_claimed` takes the same cell
        order = np.lexsort([each, ~np.logical_or.reduce(good), nearest, rows])
        firsts = order[np.unique(rows[order], return_index=True)[1]]
        return rows[firsts], *self.proof.image(cells[firsts], inputs[rows[firsts]], step)

    def _edge(self, numbers: FloatArray) -> FloatArray:
        """The lower ends of cells with indices (M, ndim), which may lie beyond the ends of axes: (M, ndim)."""
        cells, counts = self.cells, self.cells.counts
        laps = np.where(cells.periodic, numbers // counts, 0)
        # in the order of `sdhj_edge`, so that C has the same number
        edges = cells.lower + laps * cells.length + (numbers - laps * counts) * cells.width
        return np.where(cells.periodic, edges, np.clip(edges, self.grid.lower, self.grid.upper))

    def centres(self, cells: FloatArray) -> FloatArray:
        """The states in the middle of cells (M, ndim), indices; along an axis of a layer, at the wall."""
        edges = [axis.edges() for axis in self.axes]
        return np.stack([(one[k] + one[k + 1]) / 2 for one, k in zip(edges, cells.T, strict=True)], axis=1)

    def values(self, *, start: int = 0, within: int | None = None) -> FloatArray:
        """Certified steps to go minus `within` at the nodes of the problem's grid, float32, <= 0 in the tube: (*shape).

        N - start + 1 - within at nodes in no tube, without a target 0 in the tube and 1 outside.
        """
        start, within = self.clipped(start, within)
        # Without a target only membership is asked: there is no step count to return.
        if self.problem.has_no_target:
            outside = ~self.contains(self.grid.points(), start=start, within=within)
            return outside.reshape(self.grid.shape).astype(np.float32)
        fewest = self._first_set(
            self.grid.points(), self.tube_index(start, 0), self.tube_index(start, self.steps), self.proof.rounding
        )
        fewest[self.arrived(self.grid.points(), start)] = 0
        return (fewest - within).reshape(self.grid.shape).astype(np.float32)

    def inputs(self, *, start: int = 0, within: int | None = None) -> FloatArray:
        """Which inputs are certified for the tube (start, within) at the nodes of the grid: bool, grid.shape + (L,)."""
        return self.certified_inputs(self.grid.points(), *self.clipped(start, within)).reshape(*self.grid.shape, -1)

    def _values_at(self, points: FloatArray, step: int, within: FloatArray) -> FloatArray:
        """Certified steps to go of points (M, V, ndim) minus `within`: <= 0 in the tube or its shell."""
        to_go = self.steps_by_cells(points.reshape(-1, self.grid.ndim), step).reshape(points.shape[:2])
        return (to_go - within[:, None]).astype(np.float64)

    def _hazards(self, states: FloatArray, step: int) -> FloatArray:
        """Values (M, L): < 0 where an input is proved to stay clear from the cell of a state (M, ndim), else > 0.

        The magnitude is the distance of where the input leads without an adversary; it proves nothing. The sign is that
        of the proof, and `sdhj.table.beside.fallbacks` promises a step only where it is not above 0.
        """
        clear = self._words.look_up(self, states, step, CLEAR, None)[1]
        moved = states[:, None] + self.problem.interval(step).displacements(states)
        # At the end of the interval alone: it ranks inputs, and what is met before is in the sign.
        ends = self.grid.clipped(moved.reshape(-1, len(self.axes)))
        inputs = np.tile(np.arange(clear.shape[1]), len(states))
        near = -self.problem.unsafe_value(ends, self.problem.time(step + 1), inputs).reshape(clear.shape)
        return np.where(clear, np.minimum(near, -TOUCHING), np.maximum(near, TOUCHING))

    def answers(self, states: FloatArray, step: int, within: int = 1, scores: FloatArray | None = None) -> Batch:
        """The answers for states (M, ndim) at a step, a `ProvedBatch`; only certified inputs are safe.

        Inputs are judged by the tube of the fewest steps to go, but of `within` where that is more. With `scores` (M,
        L) the first safe input of least score is the best, else the one that "deepest" prefers at the centre of the
        cell; -1 where none is safe.
        """
        step = whole("step", step, least=0, most=self.steps)
        left = self.steps - step
        within = left if self.problem.has_no_target else min(within, left)
        rule = "deepest" if scores is None else None
        to_go, safe, best = self._words.look_up(self, states, step, within, rule)
        if self.problem.has_no_target:
            to_go[to_go >= 0] = left
        elif (there := self.arrived(states, step)).size:
            away = there[to_go[there] > within]  # proved for more steps than a state in the target is asked about
            # there may be no input that is proved to bring it back one step later
            to_go[there], safe[away], best[away] = 0, False, NOT_ADMISSIBLE
        if scores is not None:
            none, best = best < 0, np.where(safe, scores, np.inf).argmin(axis=1)
            best[none] = NOT_ADMISSIBLE
        batch = ProvedBatch(states, step, within, to_go, safe, None, best)  # type: ignore[arg-type]  # when it is read
        batch.table = self
        return batch

    def choose_by_rule(self, batch: Batch, rule: str) -> FloatArray:
        """The input that a built-in rule prefers at the centre of each state's cell, or -1: (M,)."""
        if rule == "deepest":
            return batch.best.copy()
        found = self._words.look_up(self, batch.states, batch.step, batch.within, rule)[2]
        return np.where(batch.best < 0, NOT_ADMISSIBLE, found)

    def preferred(self, batch: Batch, scores: FloatArray) -> FloatArray:
        """For each state of a batch the safe input of least score (M, L), of equals that of least margin: (M,).

        Where no input is safe, it is `batch.best`.
        """
        found = preferred(np.where(batch.safe, scores, np.inf), batch.margins)
        return np.where(batch.safe.any(axis=1), found, batch.best)

    def passes_true_sets(self, states: FloatArray, inputs: FloatArray, step: int, left: FloatArray) -> FloatArray:
        """All True, as safe inputs are proved."""
        return np.ones(len(inputs), np.bool_)

    @cached_property
    def _words(self) -> Words:
        """The words of the cells that have been asked about, not copied with the table."""
        return Words()

    def bits(self, *, start: int, within: int) -> FloatArray:
        """Which cells are in the tube (start, within): bool of shape `shape`, a byte for each cell, layers among them.

        900 MB for the arm's case study.
        """
        packed = int(np.prod(self.shape[self.proof.rows :], dtype=np.int64))
        return to_bits(self.pool[self.index[self.tube_index(start, within)]], packed).reshape(self.shape)

    def _share(self, start: int, within: int) -> float:
        """The share of the state space in the tube, by the volume of its cells."""
        if self.problem.sensing:
            # an estimate: not all of a cell is in the tube
            drawn = np.random.default_rng(0).uniform(self.grid.lower, self.grid.upper, (STATES_DRAWN, self.grid.ndim))
            return float(self.contains(drawn, start=start, within=within).mean())
        shares = _outer_product([axis.shares() for axis in self.axes[: self.proof.rows]])
        return float(np.sum(self._block_volumes[self.index[self.tube_index(start, within)]] * shares))

    @kept
    def _block_volumes(self) -> FloatArray:
        """The share of the packed axes' volume that each block of the pool holds, (blocks,)."""
        axes, slabs = self.axes[self.proof.rows :], (self.pool[at : at + SLAB] for at in range(0, len(self.pool), SLAB))
        shares = _outer_product([axis.shares() for axis in axes])
        if all(axis.count * axis.width == axis.extent[0] for axis in axes):  # equal cells: counting is enough
            return np.concatenate([np.bitwise_count(slab).sum(axis=1, dtype=np.int64) for slab in slabs]) / shares.size
        return np.concatenate([to_bits(slab, shares.size) @ shares for slab in slabs])

    @cached_property
    def on_few_nodes(self) -> Any:
        """The table of the problem on few nodes, or None; solved when first asked about."""
        return on_few_nodes(self)

    def steps_of_rounding(self, rounding: float = 1e-14) -> int:
        """For how many steps a run from a state that `contains` surely finds an answer, however numbers are rounded.

        `contains` counts closed cells; later states may be off a cell by the shell, 1e-10 of the largest coordinate of
        an axis (of an arm 1e-10 m and rad). In a step an image may stick out by twice `DRIFT`, 2e-13 of it, and the
        robot's own state is rounded. A table for ever holds for so many steps in which all of that falls to one side.

        Parameters
        ----------
        rounding : float
            Of the robot in a step, as a share of the largest coordinate.

        Returns
        -------
        int
            shell / (2 DRIFT + rounding), the least of all axes: some 476 for any robot but the arm.
        """
        each = (2 * DRIFT + number("rounding", rounding, least=0.0)) * np.array([axis.scale for axis in self.axes])
        return int((self.proof.shell / each).min() * (1 + 1e-12))  # 499.99... by rounding alone is 500

    def verify(self, *, everywhere: bool = False, samples: int | None = None, progress: bool | None = None) -> Verdict:
        """Check what the table claims by code that shares nothing with the solver, as `sdhj verify` checks a file.

        Parameters
        ----------
        everywhere : bool
            Whether moves and clear inputs are proved of all cells, not of promised ones alone.
        samples : int, optional
            Random cells in place of all, which proves nothing of the others.
        progress : bool, optional
            By default where standard error is a terminal.

        Returns
        -------
        Verdict
            All claims, with what was not proved of each: `ok` if nothing failed.

        Raises
        ------
        OSError
            Where the folder for temporary files has no room for the table's.
        MemoryError
            Where the check takes more memory than is free.

        Examples
        --------
        With the robot on a line of `help(sdhj)`, certified:

        >>> proved = sdhj.solve(problem, sdhj.Certified(cells=[80]))
        >>> proved.verify().ok
        True
        """
        with TemporaryDirectory() as folder:
            self.save(path := Path(folder) / "table.npz", compress=False)
            given = self.problem if self.problem.opaque else None
            return check(path, given, everywhere=everywhere, samples=samples, progress=progress)

    def looked_over(self) -> tuple[int, int]:
        """How many claims the checker has looked at, all of few and a sample of many, and how many there are."""
        # As a file has them, so that the checker reads here what it would read there.
        arrays, given = self._arrays | arrays_of(self.problem), self.problem if self.problem.opaque else None
        looked, made, wrong = looked_over(self._head, arrays, given)
        if wrong:
            raise RuntimeError(
                f"the solve claims what its check does not prove: {'; '.join(wrong)}. No table is returned, as none of "
                "it can be trusted; more parts, sdhj.Certified(parts=...), may help. Please report the problem"
            )
        return looked, made

    def save(self, path: str | os.PathLike[str], compress: bool = True) -> None:
        """Write the table to a file, as `LookupTable.save` does, which is replaced, whole or not at all.

        Arrays that are not packed are mapped when the file is loaded.
        """
        write_table(path, self, self._arrays, compress, **self._entries)

    @property
    def _head(self) -> dict[str, Any]:
        """The head of a file of the table, but for digests."""
        head = make_head(self.problem, self.method, self.details, "") | self._entries
        # through JSON, as the checker expects the lists of a file and refuses tuples
        return dict(json.loads(json.dumps(head)))

    @property
    def _arrays(self) -> dict[str, FloatArray]:
        """The arrays that a file of the table has, by name, but those of its problem."""
        return {"index": self.index, "pool": self.pool} | self.proof.arrays

    @property
    def _entries(self) -> dict[str, Any]:
        """What the head of a file says of cells and proof."""
        cells = {
            "kind": self.proof.kind,
            "shape": self.shape,
            "widths": [str(axis.width) for axis in self.axes],
            # from here on for the checker, which believes no rule of the solver: `read` works them out of the grid
            "lowers": [str(axis.lower) for axis in self.axes],
            "extents": [[str(bound) for bound in axis.extent] for axis in self.axes],
            "periodic": [axis.periodic for axis in self.axes],
        }
        if self.cells.layers.any():
            cells["layers"] = [list(axis.layers) for axis in self.axes]
        return {"cells": cells, "proof": self.proof.entry_in_head}

    @classmethod
    def read(
        cls, head: Mapping[str, Any], file: Contents, problem: ReachAvoidProblem, **fields: Any
    ) -> "CertifiedTable":
        """The table in an open file with this head, for a problem that has been read from it; nothing is proved anew.

        ValueError if the cells do not cover the axes, arrays have other shapes or types, or there are bits of no cell.
        """
        cells = head["cells"]
        every, layers = range(problem.grid.ndim), cells.get("layers", [(0, 0)] * problem.grid.ndim)
        each = zip(every, cells["widths"], cells["shape"], layers, strict=True)
        axes = tuple(axis_in_file(problem.grid, *one) for one in each)
        if cells["kind"] == ArmProof.kind and not as_built(problem):  # the checker goes by the recipe
            raise TableFileError(
                "its recipe is that of another problem than its formulas: it was solved for another problem"
            )
        proof = PROOFS[cells["kind"]].load(head["proof"], file, problem, axes)
        rows, packed = (math.prod(axis.count for axis in part) for part in (axes[: proof.rows], axes[proof.rows :]))
        # one set for all steps, or N + 1 by steps to go alone; where something moves, and of arms, one for each (k, n)
        alike = problem.time_invariant and proof.time_invariant
        allowed = {1, problem.steps + 1} if alike else {entry(problem.steps, problem.steps, 0) + 1}
        index = read_array(file, "index", "uint32", (allowed, rows))
        pool = read_array(file, "pool", "uint64", (int(index.max()) + 1, -(-packed // 64)))
        if problem.has_no_target and head["details"].get("endless") and len(index) > 1:
            raise ValueError("it says to be for ever, and its sets are for some steps")
        if "checked" in head["details"]:
            looked, made = head["details"]["checked"]
            whole("checked", looked, least=0, most=whole("checked", made, least=0))
        # Block 0 is that of no cells.
        if pool[0].any() or (packed % 64 and (pool[:, -1] >> np.uint64(packed % 64)).any()):
            raise ValueError("its pool has cells that there are not")
        return cls(proof, index, pool, head["details"], **fields)


def _outer_product(factors: Sequence[FloatArray]) -> FloatArray:
    """The outer product of vectors of lengths n1, n2, ..., flat: (n1 n2 ...,), the last index fastest."""
    return reduce(np.multiply.outer, factors, np.ones(())).ravel()


class CellSets:
    """All sets S_k^n as packed blocks (rows, words), as the recursion asks for them: `sdhj.solver.recursion.TubeSets`.

    Only `cells`, the S_k^n at hand, and `following`, S_{k+1}^{n-1}, are whole in memory; of every entry the rows are
    kept that it adds. So entries have to be computed in the order of `recursion`.
    """

    def __init__(self, proof: Any, progress: bool | None) -> None:
        """Prepare a `Proof`, which takes about half of the time of a solve."""
        counts = [axis.count for axis in proof.axes]
        self.filled, self.changing, self.settled, self.time_invariant = 0, 1.0, False, proof.time_invariant
        self.proof, self.prepared = proof, proof.prepare(progress)
        self.shape = math.prod(counts[: proof.rows]), -(-math.prod(counts[proof.rows :]) // 64)
        self.added: dict[tuple[int, int], tuple[FloatArray, FloatArray]] = {}  # which rows, and their blocks

    def begin(self) -> None:
        """Nothing: the proof is prepared when the sets are made."""

    def write_goal(self, step: int) -> None:
        """Begin row k = step with S_k^0, the cells inside L(t_k) and outside G(t_k)."""
        self.following, self.cells = np.zeros(self.shape, np.uint64), self.proof.goal(step)
        self._keep(step, 0, np.logical_or.reduce(self.cells != 0, axis=1))

    def extend(self, step: int, within: int) -> None:
        """Compute and keep the entry (step, within), from (step, within - 1) and (step + 1, within - 1)."""
        # (step, within - 1) was kept last, and `following` is S_{k+1}^{n-2}, as `recursion` has it
        rows, blocks = self._added(step + 1, within - 1)
        changed, before = (rows, self.following[rows] ^ blocks), self.cells.copy()
        self.following[rows] = blocks
        every = self.proof.shrinks and within == 1
        self.proof.add(self.prepared, self.cells, self.following, step, None if every else changed)
        if within == 1:
            self.proof.add_arriving(self.cells, step)
        self._keep(step, within, (self.cells != before).any(axis=1))
        if self.proof.problem.steps is None:
            self.filled, self.changing = within, float(np.bitwise_count(self.cells ^ before).mean() / 64)

    def unchanged(self, step: int, within: int) -> bool:
        """Whether the entry (step, within) is the same set as (step, within - 1)."""
        return not self._added(step, within)[0].size

    def repeat(self, step: int, within: int) -> None:
        """Let the entry (step, within) be the set of (step, within - 1); note that sets have settled."""
        self._keep(step, within, np.zeros(self.shape[0], np.bool_))
        self.settled = True

    def _keep(self, step: int, within: int, changed: FloatArray) -> None:
        """Keep the rows of `cells` that have `changed` as what the entry adds."""
        rows = np.flatnonzero(changed)
        self.added[step, within] = rows, self.cells[rows]

    def _added(self, step: int, within: int) -> tuple[FloatArray, FloatArray]:
        """The rows (R,) in which an entry differs from the one with a step less, and their words."""
        return self.added[0 if self.time_invariant else step, within]

    def finish(self, details: Mapping[str, Any]) -> CertifiedTable:
        """The table of all entries, with `details` and facts about its cells; called once."""
        proof, problem = self.proof, self.proof.problem
        facts = {"parts": proof.parts, "cells": [axis.count for axis in proof.axes]} | dict(details)
        if problem.steps is None:
            # it has as many entries as changed a set
            changed = [within for (_, within), (rows, _) in self.added.items() if within and rows.size]
            last = max(changed, default=1)
            facts |= {"endless": True} if self.settled or not problem.has_no_target else {}
            if not self.settled:
                tell(unsettled_finding(problem, last, self.changing))
            proof = replace(proof, problem=replace(problem, steps=last))
        # for ever, what follows the last one that changed something is the same
        # by step and steps to go, as `entry` and so `tube_index` number them
        entries = sorted(self.added) if problem.steps else sorted(self.added)[: last + 1]
        every = problem.steps or not (problem.has_no_target and self.settled)  # else only what stays clear for ever
        index = np.zeros((len(entries) if every else 1, self.shape[0]), np.uint32)
        pool, used = [np.zeros((1, self.shape[1]), np.uint64)], 1  # its first block is empty
        for i, (step, within) in enumerate(entries):
            rows, blocks = self.added.pop((step, within))
            if every:
                # the blocks of the entry with a step less, but for the rows that this one changes
                index[i] = index[i - 1] if within else 0
            index[i if every else 0, rows] = np.arange(used, used + rows.size)
            pool.append(blocks)
            used += rows.size
        return CertifiedTable(proof, index, np.concatenate(pool), facts)


def unsettled_finding(problem: ReachAvoidProblem, steps: int, share: float) -> Finding:
    """The finding that the last step of a solve with steps=None still changed a share of the cells."""
    holds = "the tube is safe for so many steps, not for ever"
    holds = holds if problem.has_no_target else "the tubes hold for so many steps"
    return Finding(
        f"after {steps:,} steps {share:.2%} of the cells had still changed in the last: {holds}. ",
        share,
        "Use more cells, a longer delta, or give the problem a number of steps",
        UnsettledWarning,
    )


def _level_set_of_cells(table: CertifiedTable, within: int) -> BlackBox:
    """The `BlackBox` of `CertifiedTable.as_level_set`, with bounds over boxes, from which a proof can go on."""
    problem = table.problem

    def step_at(t: float) -> int | None:
        # the step whose sampling time t is, to `ON_TIME` of an interval
        step = 0 if problem.time_invariant else max(round((t - problem.time(0)) / problem.delta), 0)
        on_time = problem.time_invariant or abs(problem.time(step) - t) <= ON_TIME * problem.delta
        return step if on_time and step <= table.steps else None

    def level_set(points: FloatArray, t: float) -> FloatArray:
        step = step_at(t)
        if step is None:
            return np.ones(len(points))
        # a point that rounding has put beside a wall is at it, as a box is (`certified_boxes`)
        at_wall, _ = table.certified_boxes(points, points, start=step, within=within)
        return np.where(table.contains(points, start=step, within=within) | at_wall, -1.0, 1.0)

    def enclosure(low: FloatArray, high: FloatArray, t0: float, t1: float) -> tuple[FloatArray, FloatArray]:
        if t0 != t1 and not problem.time_invariant:
            raise ValueError(f"the tube of {problem.name!r} depends on time, so it has no bounds over an interval")
        step = step_at(t0)
        if step is None:
            return np.ones(len(low)), np.ones(len(low))
        off = table.proof.prediction_error  # with sensing the certified states are predictions
        every, some = table.certified_boxes(low - off, high + off, start=step, within=within)
        return np.where(some, -1.0, 1.0), np.where(every, -1.0, 1.0)

    # a rate of 0 says that the set does not move; with None it may at any time
    rate = 0.0 if problem.time_invariant else None
    return BlackBox(level_set, rate=rate, enclosure=enclosure, name=f"the tube of {problem.name!r}")
