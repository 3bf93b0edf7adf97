"""What a solved problem answers, whatever its method, and the look-up table of Fig. 8 that most methods make.

A state off the grid is in a tube where the interpolated level-set function is <= 0. Looking ahead from it, the *margin*
of u_j is the largest interpolated value of the tube S_{k+1}, with n - 1 to go, over the box of all states that u_j and
any adversary can lead to. Inputs are safe by the first of these tests that any input passes:

1. every node of the cell around q marks u_j in the look-up table, and its margin is <= 0;
2. the interpolated avoid tube of u_j at q and its margin are <= 0;
3. next to the boundary of a tube no input may pass either. What is then called safe is the best there is, without the
   promise: of the inputs that every node of the cell marks, or of all where none is, the one whose larger of the two is
   least. Its margin is > 0, and `Batch.promised` is False.

Where the adversary couples axes the box is larger than what it can bring about, and the promise is given more rarely.
The look-ahead loses fewer runs than the marks of the nodes alone, and the marks keep inputs that would only graze an
obstacle from the rules that do not ask for depth. The certified method has a guarantee instead.
"""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import h5py
import numpy as np

from sdhj.kernels import FloatArray
from sdhj.kernels.lookup import Reach, Shelf, avoid_values, boxes_at, decide, tube_values
from sdhj.problem.checks import ascending, real_array, sealed, states_array, whole
from sdhj.problem.dynamics import Interval
from sdhj.problem.grid import Grid
from sdhj.problem.problem import ReachAvoidProblem, shrunk, worst_around
from sdhj.table.batches import Batch, Table, batched
from sdhj.table.files import PACKING, stored, written_table

WIDER = 0.01  # cells of the grid
ROOM = 2**26  # bytes that the tables of all steps may take
TRIED = 1000  # states whose boxes a table must hold: between the nodes there may be anything

LookAhead = Callable[[FloatArray, FloatArray], Reach]  # of states (M, ndim), the boxes of some rows (R,)


def look_ahead(interval: Interval, room: float = ROOM) -> LookAhead:
    """What tells the boxes of an interval: from a table of at most `room` bytes, else worked out at each state."""
    grid, axes = interval.grid, np.flatnonzero(interval.reads.any(axis=0))
    if not axes.size:
        shared = _reach(grid, *interval.reachable(np.array([grid.lower])))
        return lambda states, rows: shared
    try:
        with np.errstate(all="ignore"):  # nobody has asked for these states: what fails there is no failure
            return _tabulated(interval, axes, room)
    except ValueError:
        return lambda states, rows: _reach(grid, *interval.reachable(states[rows]))


def _reach(grid: Grid, low: FloatArray, high: FloatArray) -> Reach:
    """One box for all states has the axes with the fewest different intervals first, as in `sdhj.solver.hopf_lax`."""
    order = np.arange(grid.ndim)
    if len(low) == 1:
        different = [len(np.unique([low[0, :, axis], high[0, :, axis]], axis=1).T) for axis in order]
        order = np.argsort(different, kind="stable")
    lowest, highest = low.min(axis=1), high.max(axis=1)
    nodes = np.ceil((highest - lowest) / grid.spacing + 1e-6) + 2  # that it can touch, and one more along each axis
    return Reach(low, high, lowest, highest, order, int(nodes.prod(axis=1).max(initial=0)))


def _tabulated(interval: Interval, axes: FloatArray, room: float) -> LookAhead:
    """From the coarsest lattice that will do; ValueError where there is none, or where a drift fails on it."""
    grid, cells, finer = interval.grid, np.array(interval.grid.spacing), [1] * interval.grid.ndim
    while True:
        nodes = [n * r if p else (n - 1) * r + 1 for n, r, p in zip(grid.shape, finer, grid.periodic, strict=True)]
        lattice = Grid(grid.lower, grid.upper, nodes, grid.periodic)
        some = lattice.subgrid(axes.tolist())
        if 16 * some.size * len(interval.dynamics.inputs) * grid.ndim > room:
            raise ValueError("no room")
        points = np.tile(np.array(grid.lower), (some.size, 1))
        points[:, axes] = some.points()
        boxes = np.stack(interval.reachable(points))  # (2, size, L, ndim)
        bends = [_bend(boxes.reshape(2, *some.shape, *boxes.shape[2:]), some, axis) for axis in range(some.ndim)]
        if (np.sum(bends, axis=0) < WIDER * cells).all():
            break
        finer[axes[np.argmax([(bend / cells).max() for bend in bends])]] *= 2
    boxes += (np.array([-1.0, 1.0])[:, None, None] * np.sum(bends, axis=0))[:, None]
    tell = partial(_interpolated, boxes, axes, tuple(lattice.arrays), _reach(grid, *boxes).size)
    states = np.random.default_rng(0).uniform(grid.lower, grid.upper, (TRIED, grid.ndim))
    told, (low, high) = tell(states, np.arange(TRIED)), interval.reachable(states)
    if (told.low > low + 1e-12 * cells).any() or (told.high < high - 1e-12 * cells).any():
        raise ValueError("the nodes do not tell")
    return tell


def _bend(values: FloatArray, grid: Grid, axis: int) -> FloatArray:
    """The largest second difference of values (2, *grid.shape, L, ndim) along an axis of the grid: (2, L, ndim)."""
    if grid.periodic[axis]:
        values = np.concatenate([values, values.take([0, 1], axis + 1)], axis + 1)
    return np.abs(np.diff(values, 2, axis + 1)).max(axis=tuple(range(1, grid.ndim + 1)))


def _interpolated(
    table: FloatArray, axes: FloatArray, lattice: Any, size: int, states: FloatArray, rows: FloatArray
) -> Reach:
    boxes, hull = np.empty((2, len(rows), *table.shape[2:])), np.empty((2, len(rows), table.shape[3]))
    boxes_at(states, rows, axes, lattice, table, boxes, hull)
    return Reach(boxes[0], boxes[1], hull[0], hull[1], np.arange(table.shape[3]), size)


class OfProblem:
    """What tables of any method say of their problem; in a line, with the share of the grid that they hold."""

    @property
    def grid(self: Table) -> Grid:
        return self.problem.grid

    @property
    def steps(self: Table) -> int:
        return self.problem.most_steps

    def __repr__(self: Table) -> str:
        problem, nodes = self.problem, " x ".join(map(str, self.grid.shape))
        return (
            f"<{type(self).__name__} of {problem.name!r}, method {self.method!r}: {nodes} nodes, "
            f"{len(problem.inputs)} inputs, {self.steps} steps of {problem.delta:g} s; "
            f"{self.fraction(start=0, within=self.steps):.1%} of the grid's volume within all of them>"
        )

    def entry(self: Table, start: int, within: int) -> int:
        """Checked place of (start, within) in `index`; `within` beyond N - start means N - start."""
        start = whole("start", start, least=0, most=self.steps)
        return entry(self.steps, start, min(whole("within", within, least=0), self.steps - start))

    def place(self: Any, start: int, within: int) -> int:
        """Where what is kept of (start, within) is."""
        return int(self.index[self.entry(start, within)])


NO_CHANGE = 4 * 2.0**-23  # of the largest value of a tube in single precision: less is no change


@dataclass(frozen=True)
class AvoidTubes:
    """Level-set functions of the avoid tubes (Definition 3), <= 0 where u_j is safe over the interval.

    static : (L, *subgrid of static_axes), the same for every step; moving : (steps, L, *subgrid of moving_axes).
    With no axes there is no such unsafe set and the values are -inf: safe everywhere.
    """

    static_axes: tuple[int, ...]
    static: FloatArray
    moving_axes: tuple[int, ...]
    moving: FloatArray


def entry(steps: int, start: int, within: int) -> int:
    """Place of (start, within) in a stack of them all: rows of Fig. 8 one after the other."""
    return start * (steps + 1) - start * (start - 1) // 2 + within


def entries(steps: int) -> FloatArray:
    """Every (start, within), in the order of `entry`: (entries, 2) int64."""
    return np.array([(start, within) for start in range(steps + 1) for within in range(steps - start + 1)])


@dataclass(frozen=True, repr=False)
class LookupTable(OfProblem):
    """Every reach-avoid tube S_k^i, with n = N - i steps to go written `within`, and the inputs that realise it.

    Made by `sdhj.solve` or `sdhj.load`. Tubes that are equal are stored once.

    Attributes
    ----------
    index : (entries,) int64
        For each (start, within), in the order of `entry`, which of the T stored tubes it is.
    tubes : (T, *grid.shape)
    masks : (T, bytes, size) uint8
        Bit j % 8 of byte j // 8 stands for u_j.
    avoid : AvoidTubes
    details : mapping
        How it was computed.
    """

    problem: ReachAvoidProblem
    method: str
    index: FloatArray
    tubes: FloatArray
    masks: FloatArray
    avoid: AvoidTubes
    details: Mapping[str, Any]

    # ---- filling it in

    @classmethod
    def empty(cls, problem: ReachAvoidProblem, method: str, dtype: str, avoid: AvoidTubes) -> "LookupTable":
        """A table to be filled in, tube by tube in the order of Theorem 2: k from N to 0, in a row n from 0 to N - k.

        There is room for every tube, or, where nothing depends on the time, for each n. Room that is never written to
        takes no memory.
        """
        index, room = cls.places(problem), cls.rooms(problem)
        tubes = np.empty((room, *problem.grid.shape), dtype)
        masks = np.zeros((room, -(-len(problem.inputs) // 8), problem.grid.size), np.uint8)
        return cls(problem, method, index, tubes, masks, avoid, {})

    @staticmethod
    def places(problem: ReachAvoidProblem) -> FloatArray:
        """The index of a table in which every tube has a place of its own."""
        start, index = entries(problem.most_steps).T.copy()
        if not problem.timeless:  # one behind the other as they are filled in
            index += (problem.most_steps - start) * (problem.most_steps - start + 1) // 2
        return index

    @staticmethod
    def rooms(problem: ReachAvoidProblem) -> int:
        """T, how many tubes there are at most."""
        return problem.most_steps + 1 if problem.timeless else entry(problem.steps, problem.steps, 0) + 1

    def value_array(self, start: int, within: int) -> FloatArray:
        """Where the tube stands, shape grid.shape; to be written while the table is filled in."""
        return self.tubes[self.place(start, within)]

    def mask_array(self, start: int, within: int) -> FloatArray:
        """Where the marks of its inputs stand, (bytes, size); to be written likewise."""
        return self.masks[self.place(start, within)]

    def share(self, start: int, within: int) -> None:
        """Make (start, within) the tube (start, within - 1), marks included; what comes later moves up by one place."""
        place = self.place(start, within)
        if place != self.place(start, within - 1):
            self.index[self.index >= place] -= 1

    def unchanged(self, start: int, within: int) -> bool:
        """Whether (start, within) is (start, within - 1) but for rounding: the nodes in it, their inputs, its boundary.

        Deep inside, where no sign hangs on them, values may creep for long by the scheme's error.
        """
        tube, before = self.value_array(start, within), self.value_array(start, within - 1)
        inside, change = tube <= 0, np.abs(tube - before)
        masks = np.array_equal(self.mask_array(start, within), self.mask_array(start, within - 1)) or within == 1
        if not masks or not np.array_equal(inside, before <= 0):
            return False
        most = 0.0
        for axis in range(self.grid.ndim):
            one, other = self.grid.edges(inside, axis)
            beside = one != other
            most = max(most, *(float(part[beside].max(initial=0.0)) for part in self.grid.edges(change, axis)))
        return most <= NO_CHANGE * float(np.abs(tube).max())

    def settled(self) -> "LookupTable":
        """The table up to the step after which nothing changes: without a target only what stays clear for ever.

        Raises
        ------
        ValueError
            Where everything still changes.
        """
        stored = self.place(0, self.steps)  # the last is as the one before
        if stored == self.steps:
            raise ValueError(f"the tubes still change after {stored:,} steps; give the problem a number of steps")
        last, stays = max(stored - 1, 1), self.problem.stays
        # a copy: look-ups would be compiled once more for a column of an array
        index, kept = entries(last)[:, 1].copy(), slice(last, last + 1) if stays else slice(0, last + 1)
        return replace(
            self,
            problem=replace(self.problem, steps=last),
            index=np.zeros_like(index) if stays else index,
            tubes=self.tubes[kept].copy(),  # the room for all others is given back
            masks=self.masks[kept].copy(),
            avoid=replace(self.avoid, moving=self.avoid.moving[:last]),
        )

    def finish(self, details: Mapping[str, Any]) -> "LookupTable":
        """The table without the room that was not needed."""
        stored = int(self.index.max()) + 1
        return replace(self, tubes=self.tubes[:stored], masks=self.masks[:stored], details=details)

    # ---- what it says of the grid

    def values(self, *, start: int, within: int) -> FloatArray:
        """Level-set function of the states that reach the target within `within` steps from step `start`.

        Shape grid.shape, <= 0 inside; a view, not to be modified. With `Sensing` of predictions.
        """
        return sealed(self.value_array(start, within))

    def inputs(self, *, start: int, within: int) -> FloatArray:
        """Which inputs are safe and make progress at each node: bool, grid.shape + (L,).

        u_j is marked where, held over the interval from `start`, it avoids the unsafe sets and ends in the tube with
        `within` - 1 steps to go, whatever the adversary does. Nothing is marked for within = 0.
        """
        count = len(self.problem.inputs)
        bits = np.unpackbits(self.mask_array(start, within), axis=0, count=count, bitorder="little")
        return np.moveaxis(bits.reshape(count, *self.grid.shape), 0, -1).astype(bool)

    def contains(self, points: FloatArray, *, start: int, within: int) -> FloatArray:
        """Whether each row of `points` (M, ndim) is in the tube with all it may be taken for (`Sensing`): bool (M,).

        A state in the true unsafe set is in none, whatever is interpolated, nor with no steps to go one off the target.
        """
        points = np.atleast_2d(real_array("points", points))
        if np.isnan(points).any():
            raise ValueError("points has a NaN; every coordinate must be a number")
        found: FloatArray = worst_around(self.problem, self.value_array(start, within), points) <= 0
        found[found] = ~self.problem.refuted(points[found], start, min(within, self.steps - start))
        return found

    def fraction(self, *, start: int, within: int) -> float:
        """Share of the grid's volume inside the tube, by the nodes; `contains` also asks the true functions."""
        return self.grid.fraction(shrunk(self.problem, self.value_array(start, within)) <= 0)

    @property
    def nbytes(self) -> int:
        """Bytes that the tubes, the masks and the avoid tubes take in memory."""
        return sum(a.nbytes for a in (self.index, self.tubes, self.masks, self.avoid.static, self.avoid.moving))

    # ---- what it says of states between the nodes

    def batch(self, states: FloatArray, step: int, within: int = 1) -> Batch:
        """Steps to go, safe inputs and margins of states (M, ndim) at one step, on all cores.

        Inputs are judged by the tube of the fewest steps to go, or of `within` where that is more: those that are safe
        with N - step are all from which the target can still be reached.

        Raises
        ------
        ValueError
            Where a state is NaN or infinite, or shape or step do not fit.
        """
        return batched(self.problem, states, step, partial(self._answer, within=within))

    def hazards(self, states: FloatArray, step: int) -> FloatArray:
        """Interpolated avoid tube of every input at states (M, ndim) over the interval from `step`: (M, L).

        <= 0 where the input stays clear of the unsafe sets, -inf where there are none. Beyond a wall, that at the wall.
        """
        states = states_array("states", states, self.grid.ndim)
        out = np.empty((len(states), len(self.problem.inputs)))
        avoid_values(states, step, tuple(self._shelf), tuple(self.grid.arrays), out)
        return out

    def values_at(self, points: FloatArray, step: int, within: FloatArray) -> FloatArray:
        """Interpolated level-set values at points (M, V, ndim) of the tubes (step, within[m]): (M, V).

        Beyond a wall, that at the wall. `within` (M,) is clipped to what there is, 0 to N - step.
        """
        points = real_array("points", points)
        first, within = self.entry(step, 0), np.clip(within, 0, self.steps - step)
        if points.ndim != 3 or points.shape[::2] != (len(within), self.grid.ndim):
            raise ValueError(f"points must have shape ({len(within)}, V, {self.grid.ndim}), got {points.shape}")
        out = np.empty(points.shape[:2])
        tube_values(points, self.index[first + within], self._shelf.tubes, self.grid.arrays, out)
        return out

    def _answer(self, batch: Batch, rows: FloatArray, within: int) -> None:
        out = (batch.steps_to_go, batch.safe, batch.margins)
        within = self.steps if self.problem.stays else within  # to stay clear is to stay clear for all that is left
        when = batch.step, min(within, self.steps - batch.step)
        steps = self.steps if self.problem.dynamics.timed else 1
        if (step := min(batch.step, steps - 1)) not in self._ahead:
            self._ahead[step] = look_ahead(self.problem.interval(step), ROOM / steps)
        reach = self._ahead[step](batch.states, rows)
        decide(batch.states, rows, when, tuple(self._shelf), tuple(reach), tuple(self.grid.arrays), out)

    @cached_property
    def _shelf(self) -> Shelf:
        avoid, inputs = self.avoid, len(self.problem.inputs)
        static, moving = avoid.static.reshape(inputs, -1), avoid.moving.reshape(self.steps * inputs, -1)
        axes = [np.array(axes, dtype=np.int64) for axes in (avoid.static_axes, avoid.moving_axes)]
        tubes = self.tubes.reshape(len(self.tubes), -1)
        return Shelf(self.steps, self.index, tubes, self.masks, static, axes[0], moving, axes[1])

    @cached_property
    def _ahead(self) -> dict[int, LookAhead]:
        """What tells the boxes of each step so far asked for, of step 0 where all are alike."""
        return {}

    # ---- on disk

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write an HDF5 file that describes itself, or raise OSError; an older one stays until the new one is whole."""
        axes = {name: getattr(self.avoid, f"{name}_axes") for name in ("static", "moving")}
        with written_table(path, self, avoid_axes=axes, entries="start and within of each entry of the index") as file:
            file["entries"] = entries(self.steps)
            file["index"] = self.index
            file.create_dataset("tubes", data=self.tubes, chunks=(1, *self.grid.shape), **PACKING)
            file.create_dataset("masks", data=self.masks, chunks=(1, 1, self.grid.size), **PACKING)
            for name in ("static", "moving"):
                file.create_dataset(f"avoid_{name}", data=getattr(self.avoid, name), chunks=True, **PACKING)

    @classmethod
    def read(cls, told: Mapping[str, Any], file: h5py.File, problem: ReachAvoidProblem) -> "LookupTable":
        """The table in an open file of this problem that tells so; ValueError where they do not fit together."""
        grid, count, steps = problem.grid, len(problem.inputs), problem.most_steps
        index = stored(file, "index", "int64", (len(entries(steps)),))
        most = int(index.max()) + 1
        if index.min() < 0:
            raise ValueError("its index points before the first tube")
        tubes = stored(file, "tubes", "float32 float64", (most, *grid.shape))
        masks = stored(file, "masks", "uint8", (most, -(-count // 8), grid.size))
        avoid: list[Any] = []
        for name, lead in (("static", (count,)), ("moving", (steps, count))):
            axes = ascending(told["avoid_axes"][name], f"avoid_{name}")
            if list(axes) != sorted(set(axes) & set(range(grid.ndim))):
                raise ValueError(f"the axes of avoid_{name} must be ascending axes of the grid, got {axes}")
            shape = tuple(grid.shape[axis] for axis in axes)
            avoid += [axes, stored(file, f"avoid_{name}", "float32 float64", (*lead, *shape))]
        return cls(problem, told["method"], index, tubes, masks, AvoidTubes(*avoid), told["details"])
