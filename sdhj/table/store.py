"""The arrays of a table, a slab at a time: in memory, or in a *store*, a folder of plain arrays and a ledger.

    head                  the problem, the method and how the grid is cut
    tubes.npy, marks.npy  the arrays of a `LookupTable`
    avoid_static.npy, avoid_moving.npy
                          ... those on no axes, where there is nothing to avoid, are left out
    tables/, opaque/      what formulas look up, and values of black boxes
    ledger                a line for each finished slab: array, position, slab, SHA-256 of these, the head and the slab
    index                 which entry is which tube, once the table is whole

Head and index are JSON behind a line with its SHA-256, that of the index with the head's. A slab is written, flushed to
the disk and only then entered in the ledger, so what is there is finished: this is all that going on after a crash
needs. No slab can be taken for another, or for one of another store, without its digest telling.
"""

import hashlib
import json
import math
import os
import re
import shutil
import uuid
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import InitVar, dataclass, field
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np

from sdhj.kernels import FloatArray
from sdhj.problem.checks import option, whole
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.table.batches import Player
from sdhj.table.files import (
    Lengths,
    Named,
    TableFileError,
    checked_head,
    fits,
    problem_of_file,
    replaced_whole,
    require_writable,
    unwritable_error,
)
from sdhj.table.table import AvoidTubes, LookupTable, ascending_axes

STORE_FORMAT = 4
NAMES = ("tubes", "marks", "avoid_static", "avoid_moving")
ENTERED = re.compile("(tubes|avoid_static|avoid_moving) ([0-9]{1,9}) ([0-9]{1,9}) ([0-9a-f]{64})")  # of the ledger
Runs = Sequence[tuple[int, int]]


@contextmanager
def readable(path: Path) -> Iterator[None]:
    """A context in which errors in reading a store, or a file of one, at `path` become TableFileError.

    These are OSError, LookupError, ArithmeticError, AttributeError, ValueError and TypeError; the message names the
    path.
    """
    try:
        yield
    except TableFileError:
        raise
    except (OSError, LookupError, ArithmeticError, AttributeError, ValueError, TypeError) as error:
        raise TableFileError(f"{path} is missing, damaged or of another store ({error}); solve it anew") from error


class Slab(NamedTuple):
    """Which part of which arrays is read or written at a time: a slab of a tube with its marks, or of avoid tubes.

    array : "tubes", which stands for the marks too, "avoid_static" or "avoid_moving".
    position : the position of the tube among the stored ones, or the step of moving avoid tubes; 0 for static ones.
    number : of the slab, counted along the axis that is cut; 0 for avoid tubes that do not depend on this axis.
    """

    array: str
    position: int
    number: int

    @property
    def arrays(self) -> tuple[str, ...]:
        """The names of the arrays that are written together: ("tubes", "marks"), or the one that the slab names."""
        return ("tubes", "marks") if self.array == "tubes" else (self.array,)


@dataclass(frozen=True)
class Shapes:
    """The shapes of a table's arrays, and how they are cut into slabs along one axis of the grid.

    Arrays are named by "tubes", "marks", "avoid_static" and "avoid_moving" (`NAMES`).

    Attributes
    ----------
    shape : tuple of int
        Of the grid.
    inputs : int
        L, the number of inputs.
    tubes : int
        For how many tubes there is room.
    steps : int
        N, the number of steps.
    dtype : {"float32", "float64"}
        Of all arrays but marks.
    axis : int
        The axis of the grid that is cut.
    width : int
        Nodes of a slab along this axis; the last slab may have fewer.
    avoid_axes : mapping
        For "avoid_static" and "avoid_moving" the axes of the grid on which these tubes depend, ascending; () if there
        is nothing to avoid.
    """

    shape: tuple[int, ...]
    inputs: int
    tubes: int
    steps: int
    dtype: str
    axis: int
    width: int
    avoid_axes: Mapping[str, tuple[int, ...]]

    @classmethod
    def of(cls, problem: ReachAvoidProblem, *cut: Any) -> Self:
        """The shapes of a problem's table; cut : the fields dtype, axis, width and avoid_axes, in this order."""
        tubes, steps = LookupTable.most_tubes(problem), problem.most_steps
        return cls(problem.grid.shape, len(problem.inputs), tubes, steps, *cut)

    @property
    def slabs(self) -> int:
        """The number of slabs that the grid is cut into."""
        return -(-self.shape[self.axis] // self.width)

    def axes(self, array: str) -> tuple[int, ...]:
        """The axes of the grid that an array has, ascending: all of tubes and marks, else those of `avoid_axes`."""
        return self.avoid_axes.get(array, tuple(range(len(self.shape))))

    def slabs_of(self, array: str) -> int:
        """The number of slabs of an array: one if it does not have the axis that is cut."""
        return self.slabs if self.axis in self.axes(array) else 1

    def span(self, number: int) -> tuple[int, int]:
        """The first node of slab `number` along the axis that is cut, and the one after its last."""
        return number * self.width, min((number + 1) * self.width, self.shape[self.axis])

    def runs(self, array: str, number: int) -> Runs:
        """The nodes (begin, end) of slab `number` on each axis that an array has; on axes not cut all nodes."""
        return [self.span(number) if axis == self.axis else (0, self.shape[axis]) for axis in self.axes(array)]

    def dtype_of(self, array: str) -> Any:
        """The dtype of an array: uint8 for marks, else `dtype`."""
        return np.dtype(np.uint8 if array == "marks" else self.dtype)

    def leading_shape(self, array: str) -> tuple[int, ...]:
        """The lengths of the axes before those of the grid in one entry of an array, all inputs together.

        () of a tube, (bytes,) of marks, one bit for each input, and (L,) of avoid tubes.
        """
        return {"tubes": (), "marks": (-(-self.inputs // 8),)}.get(array, (self.inputs,))

    def entry_shape(self, array: str) -> tuple[int, ...]:
        """The shape of one entry of an array on the whole grid: of one tube, its marks, or the avoid tubes of a step.

        That is (*shape), (bytes, *shape), or (L, *subgrid).
        """
        return *self.leading_shape(array), *(self.shape[axis] for axis in self.axes(array))

    def array_shape(self, array: str) -> tuple[int, ...]:
        """The shape of a whole array as a `LookupTable` has it: its entries, one after the other.

        (tubes, *shape), (tubes, bytes, nodes), where the grid is one axis, (L, *subgrid) for static and (steps, L,
        *subgrid) for moving avoid tubes.
        """
        lead, block = self.leading_shape(array), self.entry_shape(array)
        block = (*lead, math.prod(self.shape)) if array == "marks" else block
        return block if array == "avoid_static" else (self.steps if array == "avoid_moving" else self.tubes, *block)

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays."""
        return sum(math.prod(self.array_shape(array)) * self.dtype_of(array).itemsize for array in NAMES)

    def slabs_with(self, tubes: int) -> Iterator[Slab]:
        """All slabs of a table with so many tubes, in the order tubes, static and moving avoid tubes.

        Avoid tubes on no axes have none.
        """
        for array, places in ("tubes", tubes), ("avoid_static", 1), ("avoid_moving", self.steps):
            if self.axes(array):
                yield from (Slab(array, *one) for one in product(range(places), range(self.slabs_of(array))))


def index_of(runs: Runs) -> Any:
    """The index, for NumPy, of the nodes `runs` of an array, (begin, end) on each of its last axes."""
    return (..., *(slice(*run) for run in runs))


class Arrays:
    """The arrays of a table, read and written a slab at a time: base of `Memory` and `Store`.

    To write a slab: fill in what `buffers` returns, hand it to `write`, and the digest that this returns to
    `record_finished`, in the process that keeps the ledger; `is_finished` then says that the slab is finished. A
    subclass implements `entry`, `whole`, `write`, `record_finished` and `is_finished`.

    Attributes
    ----------
    layout : Shapes
    """

    layout: Shapes

    def entry(self, array: str, position: int) -> FloatArray:
        """To be implemented: the entry at `position` of an array on the whole grid, of shape `Shapes.entry_shape`."""
        raise NotImplementedError

    def read(self, array: str, position: int, runs: Runs) -> FloatArray:
        """The nodes `runs`, (begin, end) on each axis of the grid, of the entry at `position` of an array.

        A view if it is contiguous, else a copy; it should not be written.
        """
        return np.ascontiguousarray(self.entry(array, position)[index_of(runs)])

    def whole(self, array: str) -> FloatArray:
        """To be implemented: a whole array, as a `LookupTable` has it; later writes appear in it."""
        raise NotImplementedError

    @property
    def avoid(self) -> AvoidTubes:
        """The avoid tubes of all unsafe sets, static and moving: over the whole arrays, without a copy."""
        static, moving = NAMES[2:]
        axes = self.layout.axes(static), self.layout.axes(moving)
        return AvoidTubes(axes[0], self.whole(static), axes[1], self.whole(moving))

    def table(self, problem: ReachAvoidProblem, method: str, index: FloatArray) -> LookupTable:
        """A `LookupTable` over the whole arrays, not copied, with the index (entries,) int64 and no details."""
        return LookupTable(problem, method, index, self.whole("tubes"), self.whole("marks"), self.avoid, {})

    def buffers(self, slab: Slab) -> list[FloatArray]:
        """An array for each of `slab.arrays`, to be filled in with the slab and handed to `write`: new, all zeros.

        The shapes are those of the slab: `Shapes.leading_shape`, followed by the slab's nodes on each axis.
        """
        found = []
        for array in slab.arrays:
            nodes = (end - begin for begin, end in self.layout.runs(array, slab.number))
            found.append(np.zeros((*self.layout.leading_shape(array), *nodes), self.layout.dtype_of(array)))
        return found


class Memory(Arrays):
    """The arrays of a table in memory. Where there is one slab, what is read and written are views of them.

    Attributes
    ----------
    layout : Shapes
    arrays : dict
        The whole arrays by name, those that have been made or put there.
    """

    def __init__(self, layout: Shapes) -> None:
        """Arrays of a layout; none is made before it is asked for."""
        self.layout, self.arrays = layout, dict[str, FloatArray]()

    def entry(self, array: str, position: int) -> FloatArray:
        """A view of the entry at a position of an array, on the whole grid; writing to it writes to the array."""
        found: FloatArray = self.whole(array).reshape(-1, *self.layout.entry_shape(array))[position]
        return found

    def buffers(self, slab: Slab) -> list[FloatArray]:
        """As `Arrays.buffers`: an array for each of `slab.arrays`, to be filled in and handed to `write`.

        If the grid is one slab, they are views of the whole arrays, of which only marks are 0 at first; what is filled
        in is written already. Else they are new arrays of zeros.
        """
        one = self.layout.slabs == 1
        return [self.entry(array, slab.position) for array in slab.arrays] if one else super().buffers(slab)

    def is_finished(self, slab: Slab) -> bool:
        """Whether a slab is finished already: always False, as nothing in memory outlasts a solve."""
        return False

    def write(self, slab: Slab, values: Sequence[FloatArray]) -> str:
        """Copy the arrays of a slab to where it lies in the whole arrays; returns "", as there is no digest.

        values : one array for each of `slab.arrays`, of the shapes of `buffers`. Views of where the slab lies are not
            copied. An array that has the shape and dtype of the whole array is not copied either, but takes its place.
        """
        for array, one in zip(slab.arrays, values, strict=True):
            if (one.shape, one.dtype) == (self.layout.array_shape(array), self.layout.dtype_of(array)):
                self.arrays[array] = one  # to copy all avoid tubes would take as long as a game
                continue
            runs = self.layout.runs(array, slab.number)
            part = self.entry(array, slab.position)[index_of(runs)]
            if not np.may_share_memory(part, one):
                part[...] = one
        return ""

    def record_finished(self, slab: Slab, digest: str) -> None:
        """Do nothing: in memory no ledger is kept of finished slabs."""

    def whole(self, array: str) -> FloatArray:
        """A whole array; made when it is first asked for, so that it may take memory that games had before.

        Marks are 0 then, avoid tubes on no axes -inf, and all others undefined until they are written.
        """
        if array not in self.arrays:
            make = np.zeros if array == "marks" else np.empty
            self.arrays[array] = make(self.layout.array_shape(array), self.layout.dtype_of(array))
            if not self.layout.axes(array):
                self.arrays[array].fill(-np.inf)
        return self.arrays[array]


class Store(Arrays):
    """The arrays of a table in the files of a store: what is read is mapped, what is written goes to its place on disk.

    Attributes
    ----------
    path : Path
        The folder.
    layout : Shapes
    head_digest : str
        The digest of the head, which goes into all other digests.
    begins : dict
        The offset in bytes at which each array begins in its file; read at first use.
    finished_slabs : dict
        The digest of each finished slab (`Slab`); the ledger, read at first use and kept up to date by
        `record_finished`.
    """

    def __init__(self, path: Path, layout: Shapes, head_digest: str) -> None:
        """A store that exists at a path, of this layout, with the digest of its head; nothing is read yet."""
        self.path, self.layout, self.head_digest = path, layout, head_digest

    def __reduce__(self) -> Any:
        """Pickled are path, layout and `head_digest`, from which a worker reads and writes the same files."""
        return Store, (self.path, self.layout, self.head_digest)

    # ---- the files of arrays

    def file(self, array: str) -> Path:
        """The path of the file of an array."""
        return self.path / f"{array}.npy"

    @cached_property
    def begins(self) -> dict[str, int]:
        """The offset in bytes at which each array begins in its file; TableFileError for files that do not fit."""
        return {array: self._header(array)[0] for array in NAMES if self.layout.axes(array)}

    def _header(self, array: str) -> tuple[int, tuple[int, ...]]:
        """Where an array's data begin in its file, in bytes, and its shape there.

        The first axis may be shorter than in the layout, with fewer tubes. TableFileError if the file is missing, cut
        short, or of another dtype or shape.
        """
        file, expected = self.file(array), self.layout.array_shape(array)
        with readable(file), open(file, "rb") as stream:
            np.lib.format.read_magic(stream)
            shape, fortran, kind = np.lib.format.read_array_header_1_0(stream)
            if fortran or kind != self.layout.dtype_of(array) or shape[1:] != expected[1:] or shape[0] > expected[0]:
                raise ValueError(
                    f"it is {kind} of {shape}, and this store has {self.layout.dtype_of(array)} of {expected}"
                )
            begin: int = stream.tell()
            if file.stat().st_size < begin + math.prod(shape) * kind.itemsize:
                raise ValueError("it is cut short")
        return begin, shape

    def entry(self, array: str, position: int) -> FloatArray:
        """The entry at a position of an array on disk, mapped: writing to it would not reach the file.

        -inf, in memory, for avoid tubes on no axes. The type is a plain array.
        """
        block, kind = self.layout.entry_shape(array), self.layout.dtype_of(array)
        if not self.layout.axes(array):
            return np.full(block, -np.inf, kind)
        begin = self.begins[array] + position * math.prod(block) * kind.itemsize
        return np.asarray(np.memmap(self.file(array), kind, "c", begin, block))

    def write(self, slab: Slab, values: Sequence[FloatArray]) -> str:
        """Write the arrays of a slab to the files and flush them to the disk; returns the slab's digest.

        It is not yet entered in the ledger (`record_finished`). OSError, with what to do, if it cannot be written.
        """
        with self._writing():
            for array, one in zip(slab.arrays, values, strict=True):
                with open(self.file(array), "r+b") as stream:
                    for begin, row in self._rows(slab, array, one):
                        stream.seek(begin)
                        stream.write(row.data)
                    stream.flush()
                    os.fsync(stream.fileno())
        return self.digest(slab, values)

    def _rows(self, slab: Slab, array: str, values: FloatArray) -> Iterator[tuple[int, FloatArray]]:
        """Yield the parts of a slab's `values` that are contiguous in the array's file: (offset in bytes, 1-D array).

        values : the slab of this one array, of the shape that `buffers` returns.
        """
        block = self.layout.entry_shape(array)
        runs = [*((0, n) for n in self.layout.leading_shape(array)), *self.layout.runs(array, slab.number)]
        cut = next((axis for axis, n in enumerate(block) if runs[axis] != (0, n)), 0)
        first = slab.position * math.prod(block) + runs[cut][0] * math.prod(block[cut + 1 :])
        for number, row in enumerate(np.ascontiguousarray(values).reshape(math.prod(block[:cut]), -1)):
            yield self.begins[array] + (first + number * math.prod(block[cut:])) * row.itemsize, row

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """A context in which the message of an OSError also says what stays in the store and what to do."""
        try:
            yield
        except OSError as error:
            raise OSError(
                f"cannot write in {self.path}: {error.strerror or error}; what is finished stays: make room, or see "
                "who may write there, and solve with resume=True"
            ) from error

    # ---- the ledger

    @cached_property
    def finished_slabs(self) -> dict[Slab, str]:
        """The digests of the finished slabs, as the ledger has them; read once.

        Lines that were cut short, and lines for slabs that the layout does not have, are ignored; of a slab with
        several lines the last counts.
        """
        with readable(file := self.path / "ledger"):
            lines = file.read_text(encoding="ascii", errors="replace").splitlines()
        found = {Slab(line[1], int(line[2]), int(line[3])): line[4] for line in map(ENTERED.fullmatch, lines) if line}
        possible = set(self.layout.slabs_with(self.layout.tubes))
        return {slab: digest for slab, digest in found.items() if slab in possible}

    def is_finished(self, slab: Slab) -> bool:
        """Whether the ledger has a line for a slab, that is whether the slab is finished."""
        return slab in self.finished_slabs

    def record_finished(self, slab: Slab, digest: str) -> None:
        """Add a line for a finished slab to the ledger, flush it to the disk, and add it to `finished_slabs`.

        A line break comes first, as the line before may have been cut short. OSError, with what to do.
        """
        with self._writing(), open(self.path / "ledger", "ab") as stream:
            stream.write(f"\n{slab.array} {slab.position} {slab.number} {digest}\n".encode())
            stream.flush()
            os.fsync(stream.fileno())
        self.finished_slabs[slab] = digest

    def digest(self, slab: Slab, values: Sequence[FloatArray]) -> str:
        """SHA-256, in hexadecimal, of `head_digest`, the slab's array, position and number, and its values."""
        found = hashlib.sha256(f"{self.head_digest} {slab.array} {slab.position} {slab.number}\n".encode())
        for one in values:
            found.update(np.ascontiguousarray(one).reshape(-1).data)
        return found.hexdigest()

    def check(self, slabs: Sequence[Slab]) -> None:
        """Read some slabs from the files, and compare their digests with those in the ledger.

        TableFileError if a slab is not in the ledger, or if its digest is another; the message says what to delete.
        """
        if missing := [slab for slab in slabs if slab not in self.finished_slabs]:
            raise TableFileError(
                f"{len(missing)} slabs of {self.path} are not in its ledger, first {' '.join(map(str, missing[0]))}; "
                "solve with resume=True, which makes them anew"
            )
        for slab in slabs:
            found = [self.read(array, slab.position, self.layout.runs(array, slab.number)) for array in slab.arrays]
            if self.digest(slab, found) != self.finished_slabs[slab]:
                line = " ".join(map(str, slab))
                raise TableFileError(
                    f"{self.file(slab.array)} is damaged, or parts of it are not what was written there: place "
                    f"{slab.position}, slab {slab.number}; delete the line that begins {line!r} from "
                    f"{self.path / 'ledger'} and solve with resume=True, which makes it anew"
                )

    # ---- the whole

    def finish(self, index: FloatArray, details: Mapping[str, Any]) -> None:
        """Write the index file, last of all: it has the index (entries,) int of the table and details of the solve.

        With it the store is whole. The files of tubes and marks are first cut to as many tubes as the index names.
        OSError, with what to do.
        """
        with self._writing():
            for array in ("tubes", "marks"):
                with open(self.file(array), "r+b") as stream:
                    write_header(stream, self.layout, array, int(index.max()) + 1)
            with replaced_whole(self.path / "index") as file:
                file.write_text(text_with_digest({"index": index.tolist(), "details": dict(details)}, self.head_digest))

    def whole(self, array: str, kinds: str = "", shape: Lengths | None = None) -> FloatArray:
        """A whole array, mapped read-only; -inf, in memory, for avoid tubes on no axes.

        TableFileError if the file does not fit the layout, ValueError if the array is not of `shape`.

        kinds : ignored, as the layout says which dtype it is; `LookupTable.of_arrays` gives it for files.
        shape : for each axis the length, or a set of allowed lengths; None allows any shape.
        """
        if not self.layout.axes(array):
            return np.full(self.layout.array_shape(array), -np.inf, self.layout.dtype)
        begin, found = self._header(array)
        if shape is not None and not fits(found, shape):
            raise ValueError(f"its array {array} must be of shape {shape}, got {found}")
        return np.asarray(np.memmap(self.file(array), self.layout.dtype_of(array), "r", begin, found))


@dataclass(frozen=True, repr=False)
class StoredTable(LookupTable):
    """A `LookupTable` whose arrays are mapped from a store: what is asked for is read, and the system keeps some of it.

    It is made by `sdhj.solve(problem, store=...)` or `sdhj.load`, for tables larger than memory. It is pickled as the
    name of its folder, from which it is loaded again, and checked against its ledger.

    Attributes
    ----------
    path : Path or None
        The folder; None for what `dataclasses.replace` makes of the table, which is pickled with its arrays.
    """

    path: Path | None = field(default=None, init=False, compare=False)
    folder: InitVar[Path | None] = None  # `path`; none of what `dataclasses.replace` makes of it

    def __post_init__(self, mapped_from: Any, folder: Path | None) -> None:
        """Keep the folder, an argument of the constructor only, as `path`."""
        super().__post_init__(mapped_from)
        object.__setattr__(self, "path", folder)

    def __reduce_ex__(self, protocol: Any) -> Any:
        """Pickled it is the name of its folder, and the problem if it has black boxes, which no file contains.

        Without a `path` it is pickled as any table.
        """
        opaque = self.problem if self.problem.opaque else None
        return (load_stored, (self.path, opaque, True, self.player)) if self.path else super().__reduce_ex__(protocol)


def is_store(path: Named) -> bool:
    """Whether a name is that of a store, which may be of an earlier version."""
    return any(os.path.isfile(os.path.join(path, name)) for name in ("head", "zarr.json"))


def load_stored(
    path: Named, problem: ReachAvoidProblem | None = None, check: bool = True, player: Player | None = None
) -> StoredTable:
    """The table of a finished store. Errors are those of `sdhj.load`, which calls this.

    problem : needed if it has black boxes; otherwise None, or it is compared with the store's.
    check : whether all arrays are read once and compared with the ledger.
    player : simulates runs for `Table.played`.

    TableFileError if the store is unfinished, damaged or of another problem.
    """
    store, head, problem = opened_store(path, problem)
    if not (store.path / "index").is_file():
        raise TableFileError(f"{path} is not finished; go on with sdhj.solve(..., store=..., resume=True)")
    content = _content_of_text(store.path / "index", store.head_digest)[0]
    with readable(store.path):
        index, fields = np.array(content["index"], dtype=np.int64), {"player": player, "folder": store.path}
        found = StoredTable.of_arrays(head, store.whole, index, problem, **fields)
    if check:
        store.check(list(store.layout.slabs_with(len(found.tubes))))
    return found


def head_of_store(path: Named) -> tuple[dict[str, Any], str]:
    """The head of a store, finished or not, as `checked_head` returns it, and its digest.

    If the store is finished, "details" are those of the solve. FileNotFoundError if there is none at `path`;
    TableFileError if it is damaged or of another version.
    """
    path = Path(path)
    if (path / "zarr.json").is_file():
        raise TableFileError(
            f"{path} is a Zarr store, of an sdhj before there were stores of plain arrays; solve it anew"
        )
    if not (path / "head").is_file():
        raise FileNotFoundError(f"no store {path}; write one with sdhj.solve(problem, store=...)")
    head, head_digest = _content_of_text(path / "head")
    with readable(path):
        if head["store"] != STORE_FORMAT:
            raise ValueError(f"it has store version {head['store']}, and this sdhj reads {STORE_FORMAT}")
        if (path / "index").is_file():
            head["details"] = _content_of_text(path / "index", head_digest)[0]["details"]
        return checked_head(head), head_digest


def opened_store(
    path: Named, problem: ReachAvoidProblem | None = None
) -> tuple[Store, dict[str, Any], ReachAvoidProblem]:
    """A store, finished or not, its head as `head_of_store` returns it, and its problem; arrays are not read.

    problem : needed if it has black boxes. Errors are those of `sdhj.load`.
    """
    (head, head_digest), path = head_of_store(path), Path(os.path.abspath(path))
    with readable(path):
        problem = problem_of_file(path, head, functions_of(path), problem)
        return Store(path, shapes_of(problem, head), head_digest), head, problem


def shapes_of(problem: ReachAvoidProblem, head: Mapping[str, Any]) -> Shapes:
    """The layout of a problem's table in a store with this head; ValueError if the two do not fit."""
    (axis, width), shape = head["cut"], problem.grid.shape
    axis = whole("the axis that is cut", axis, least=0, most=len(shape) - 1)
    width = whole("the width of slabs", width, least=1, most=shape[axis])
    option("dtype", head["dtype"], ("float32", "float64"))
    names = NAMES[2:]
    axes = {name: ascending_axes(head["avoid_axes"][name.removeprefix("avoid_")], name, problem.grid) for name in names}
    return Shapes.of(problem, head["dtype"], axis, width, axes)


def functions_of(path: Path) -> dict[str, FloatArray]:
    """The arrays that formulas look up, and the values of black boxes, in a store, by names such as "tables/0"."""
    files = [file for group in ("tables", "opaque") for file in (path / group).glob("*.npy")]
    return {f"{file.parent.name}/{file.stem}": np.load(file, allow_pickle=False) for file in files}


def create(path: Path, head: Mapping[str, Any], functions: Mapping[str, FloatArray], layout: Shapes) -> str:
    """Make a new store: a folder with head, empty arrays, empty ledger and `functions`. Returns the head's digest.

    It is made under a temporary name and appears when it is complete. functions : the arrays that formulas look up and
    the values of black boxes, by name. FileExistsError if there is something of that name, OSError, with what to do, if
    it cannot be written.
    """
    require_writable(path.parent)
    temporary = path.with_name(f".sdhj-{uuid.uuid4().hex}")
    try:
        temporary.mkdir()
        text = text_with_digest(head)
        (temporary / "head").write_text(text)
        (temporary / "ledger").touch()
        for name, values in functions.items():
            (temporary / name).parent.mkdir(exist_ok=True)
            np.save(temporary / f"{name}.npy", values)
        for array in NAMES:
            if layout.axes(array):
                with open(temporary / f"{array}.npy", "wb") as stream:
                    write_header(stream, layout, array, layout.tubes)
        os.rename(temporary, path)
    except OSError as error:
        require_free_name(path)
        raise unwritable_error(path.parent, error) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return text.partition("\n")[0]


def write_header(stream: Any, layout: Shapes, array: str, tubes: int) -> None:
    """Write the header of an array's .npy file for so many tubes to a stream, and set the file's length.

    The header has the same length for any number of tubes, so that it can be written again for fewer. What is not
    written yet takes no room on the disk where the file system allows that.

    stream : a binary file, at its beginning. array : one of `NAMES`. tubes : how many; ignored for avoid tubes.
    """
    shape, kind = layout.array_shape(array), layout.dtype_of(array)
    shape = (tubes, *shape[1:]) if array in NAMES[:2] else shape
    about = {"descr": np.lib.format.dtype_to_descr(kind), "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(stream, about)  # as long for each number of tubes
    stream.truncate(stream.tell() + math.prod(shape) * kind.itemsize)


def text_with_digest(content: Mapping[str, Any], head_digest: str = "") -> str:
    """A mapping as JSON, after a line with the SHA-256 of `head_digest` and that JSON."""
    text = json.dumps(content, sort_keys=True)
    return f"{hashlib.sha256(f'{head_digest}{text}'.encode()).hexdigest()}\n{text}\n"


def _content_of_text(file: Path, head_digest: str = "") -> tuple[Any, str]:
    """The mapping in a file of `text_with_digest`, and the digest in its first line.

    TableFileError if the file cannot be read, or its digest is not that of `head_digest` and its JSON.
    """
    with readable(file):
        text = file.read_text()
        content = json.loads(text.partition("\n")[2])
        if text_with_digest(content, head_digest) != text:
            raise ValueError("its digest is another")
    return content, text.partition("\n")[0]


def require_free_name(path: Path) -> None:
    """Raise FileExistsError, with what to do, if there is anything at this path, also a link that leads nowhere."""
    if os.path.lexists(path):
        raise FileExistsError(f"{path} exists already; go on with it by resume=True, remove it, or choose another name")


def warn_of_disk(path: Path, needed: int) -> None:
    """Warn if the disk has fewer bytes free than are needed at `path`; silent where the system does not say."""
    with suppress(OSError):
        if needed > (free := shutil.disk_usage(path.parent).free):
            warnings.warn(
                f"{path} takes up to {needed / 1e9:.3g} GB, and {free / 1e9:.3g} GB are free; where the disk is full "
                "the solve ends, and goes on with resume=True",
                stacklevel=4,
            )
