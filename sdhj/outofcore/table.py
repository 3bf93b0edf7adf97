"""A table that stays in its store: what a query needs is read, and some of it kept.

States are looked up by the code of `LookupTable`, on windows of the grid that hold the nodes around them, so answers
are those of the table in memory.
"""

import math
import os
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from sdhj.kernels import FloatArray, Sealed
from sdhj.outofcore.slabs import KINDS, read_window
from sdhj.outofcore.store import Runs, TableStore, blocks
from sdhj.problem.grid import Grid
from sdhj.problem.memory import require
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.table.batches import Batch, Table, entry
from sdhj.table.files import TableFileError, checked_head, problem_of_file
from sdhj.table.table import AvoidTubes, LookupTable

LOOKED_UP = 2**23  # values that are looked up in at a time


def load_stored(path: str | os.PathLike[str], problem: ReachAvoidProblem | None = None) -> "StoredTable":
    """As `sdhj.load`, of a store."""
    store = TableStore(path)
    given = problem_of_file(path, checked_head(store.head), store.functions, problem)
    return StoredTable(given, store)


class StoredTable(Table):
    """A look-up table on disk that reads only the chunks a query needs; for tables larger than memory.

    It is made by `sdhj.solve(problem, store=...)` or `sdhj.load`. Its answers equal those of a `LookupTable`.

    TableFileError if the store is not finished; any method raises it if a chunk that it needs is damaged or missing.
    """

    def __init__(self, problem: ReachAvoidProblem, store: TableStore) -> None:
        if "index" not in store.head:
            raise TableFileError(f"{store.path} is not finished; go on with sdhj.solve(..., store=..., resume=True)")
        self.problem, self.store, self.path = problem, store, store.path
        self.method: str = store.head["method"]
        self.details: Mapping[str, Any] = Sealed(store.head["details"])
        self.index = np.array(store.head["index"], dtype=np.int64)
        self.avoid_axes = {kind: tuple(axes) for kind, axes in store.head["avoid_axes"].items()}

    @property
    def nbytes(self) -> int:
        """Bytes that the whole table would take in memory."""
        return sum(math.prod(array.shape) * array.dtype.itemsize for array in self.store.arrays.values())

    # ---- whole tubes

    def values(self, *, start: int = 0, within: int | None = None) -> FloatArray:
        """The level-set function of a tube on the whole grid, shape grid.shape; MemoryError if it does not fit."""
        return self._whole("tubes", start, within)

    def inputs(self, *, start: int = 0, within: int | None = None) -> FloatArray:
        """Which inputs are safe and make progress at each node, bool grid.shape + (L,); MemoryError if too large."""
        count = len(self.problem.inputs)
        require(count * self.grid.size, "the marks of all nodes", "ask for the states of interest with batch()")
        bits = np.unpackbits(self._whole("masks", start, within), axis=0, count=count, bitorder="little")
        return np.moveaxis(bits, 0, -1).astype(bool)

    def _share(self, start: int, within: int) -> float:
        (axis, width), total, place = self.store.head["cut"], 0.0, self.place(start, within)
        for begin in range(0, self.grid.shape[axis], width):
            window = self.grid.stretch(axis, begin, min(width, self.grid.shape[axis] - begin))
            total += window.fraction(read_window(self.store.read, "tubes", place, window) <= 0)
        return total

    def loaded(self) -> LookupTable:
        """The table as a `LookupTable` in memory; MemoryError if it does not fit."""
        require(self.nbytes, "the table", "leave it in its store")
        avoid_axes = [self.avoid_axes[kind] for kind in KINDS]
        grids = [self.grid, self.grid, *(self.grid.subgrid(axes) if axes else None for axes in avoid_axes)]
        tubes, masks, static, moving = (
            np.stack([read_window(self.store.read, name, lead, grid) for lead in range(array.shape[0])])
            for (name, array), grid in zip(self.store.arrays.items(), grids, strict=True)
        )
        avoid = AvoidTubes(avoid_axes[0], static[0], avoid_axes[1], moving)
        masks = masks.reshape(*masks.shape[:2], -1)
        return LookupTable(self.problem, self.method, self.index, tubes, masks, avoid, self.details)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the table to one file, as `LookupTable.save` does; MemoryError if it does not fit into memory."""
        self.loaded().save(path)

    def _whole(self, name: str, start: int, within: int | None) -> FloatArray:
        array = self.store.arrays[name]
        require(array.dtype.itemsize * math.prod(array.shape[1:]), "a whole tube", "ask for states with contains()")
        return read_window(self.store.read, name, self.place(start, within), self.grid)

    # ---- states

    def _inside(self, points: FloatArray, start: int, within: int) -> FloatArray:
        found, place = np.empty(len(points), np.bool_), self.place(start, within)
        for rows, window in self._windows(points, np.zeros((2, 1, self.grid.ndim)), 1):
            found[rows] = window.interpolate(read_window(self._read, "tubes", place, window), points[rows]) <= 0
        return found

    def _hazards(self, states: FloatArray, step: int) -> FloatArray:
        count = len(self.problem.inputs)
        out = np.empty((len(states), count))
        for rows, window in self._windows(states, np.zeros((2, 1, self.grid.ndim)), 2 * count):
            out[rows] = self._part(window, step, [])._hazards(states[rows], step)
        return out

    def _values_at(self, points: FloatArray, step: int, within: FloatArray) -> FloatArray:
        flat, out = points.reshape(-1, self.grid.ndim), np.empty(points.shape[:2])
        wanted, first = np.repeat(within, points.shape[1]), entry(self.steps, step, 0)
        entries = [first + n for n in np.unique(wanted).tolist()]
        for rows, window in self._windows(flat, np.zeros((2, 1, self.grid.ndim)), len(entries)):
            part = self._part(window, None, entries)
            out.reshape(-1)[rows] = part._values_at(flat[rows][:, None], step, wanted[rows])[:, 0]
        return out

    def _answer(self, batch: Batch, rows: FloatArray, ends: FloatArray) -> None:
        steps, step, states = self.steps, batch.step, batch.states
        following = steps - step if step < steps else 0
        entries = [entry(steps, step, n) for n in range(steps - step + 1)]
        entries += [entry(steps, step + 1, n) for n in range(following)]
        each = len(entries) + 2 * len(self.problem.inputs)
        boxes = np.array([ends[0].min(axis=0).T, ends[1].max(axis=0).T])
        for some, window in self._windows(states[rows], boxes, each):
            of = ends.take(some, axis=-1) if ends.shape[-1] > 1 else ends
            self._part(window, min(step, steps - 1), entries)._answer(batch, rows[some], of)

    # ---- windows

    def _windows(self, states: FloatArray, boxes: FloatArray, each: int) -> Iterator[tuple[FloatArray, Grid]]:
        """Rows of states (M, ndim), and windows with the nodes around them and in their boxes (2, 1 or M, ndim).

        Windows are as small as it takes for `each` values a node to be no more than `LOOKED_UP`.
        """
        grid, shape, periodic = self.grid, np.array(self.grid.shape), np.array(self.grid.periodic)
        with np.errstate(invalid="ignore"):
            at = (grid.wrapped(np.nan_to_num(states)) - np.array(grid.lower)) / np.array(grid.spacing)
        at = np.where(periodic, at, np.clip(at, 0.0, shape - 1.0))
        low, high = (np.minimum(boxes[0], 0.0), np.maximum(boxes[1], 0.0)) / np.array(grid.spacing)
        begin, end = np.floor(at + low).astype(np.int64) - 1, np.floor(at + high).astype(np.int64) + 3
        begin, end = (np.where(periodic, one, np.clip(one, 0, shape)) for one in (begin, end))
        waiting = [np.arange(len(states))] if len(states) else []
        while waiting:
            rows = waiting.pop()
            first, size = begin[rows].min(axis=0), end[rows].max(axis=0) - begin[rows].min(axis=0)
            if len(rows) > 1 and float(np.prod(np.minimum(size, shape), dtype=float)) * each > LOOKED_UP:
                order = rows[np.argsort(at[rows, int(np.argmax(size))], kind="stable")]
                waiting += [order[len(order) // 2 :], order[: len(order) // 2]]
                continue
            around_it = size >= shape
            yield rows, grid.window(np.where(around_it, 0, first % shape).tolist(), np.minimum(size, shape).tolist())

    def _part(self, window: Grid, step: int | None, entries: list[int]) -> LookupTable:
        """The table on a window: some `entries`, and the avoid tubes of a step."""
        places = np.unique(self.index[entries]) if entries else np.zeros(0, np.int64)
        index, count = np.zeros_like(self.index), len(self.problem.inputs)
        index[entries] = np.searchsorted(places, self.index[entries])
        rooms = max(len(places), 1)  # what is not wanted is never looked at, nor takes memory
        tubes = np.empty((rooms, *window.shape), self.store.arrays["tubes"].dtype)
        masks = np.empty((rooms, self.store.arrays["masks"].shape[1], window.size), np.uint8)
        for row, place in enumerate(places.tolist()):
            tubes[row] = read_window(self._read, "tubes", place, window)
            if step is not None:
                masks[row] = read_window(self._read, "masks", place, window).reshape(masks.shape[1:])
        axes = self.avoid_axes["static"], self.avoid_axes["moving"]
        parts = [window.subgrid(some) if some else None for some in axes]
        static, moving = (
            np.empty((*lead, *(part.shape if part else ())), tubes.dtype)
            for lead, part in zip(((count,), (self.steps, count)), parts, strict=True)
        )
        if step is not None:
            static[:] = read_window(self._read, "avoid_static", 0, parts[0])
            moving[step] = read_window(self._read, "avoid_moving", step, parts[1])
        avoid = AvoidTubes(axes[0], static, axes[1], moving)
        return LookupTable(self.problem.on(window), self.method, index, tubes, masks, avoid, {})

    def _read(self, name: str, lead: int, runs: Runs) -> FloatArray:
        """As `TableStore.read`, chunk by chunk of those kept."""
        array = self.store.arrays[name]
        between = array.ndim - len(runs)
        sizes, shape = array.chunks[between:], array.shape[between:]
        out = np.empty((*array.shape[1:between], *(end - begin for begin, end in runs)), array.dtype)
        for place, parts, here in blocks(runs, sizes):
            chunk = tuple((i * n, min((i + 1) * n, m)) for i, n, m in zip(place, sizes, shape, strict=True))
            there: Any = [slice(low - at, high - at) for (low, high), (at, _) in zip(parts, chunk, strict=True)]
            out[here] = self.store.cached(name, lead, chunk)[(..., *there)]
        return out
