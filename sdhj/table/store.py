"""The arrays of a table, a slab at a time: in memory, or in a *store*, a folder of plain arrays and a ledger.

    head                  the problem, the method and how the grid is cut
    tubes.npy, marks.npy  the arrays of a `LookupTable`
    avoid_static.npy, avoid_moving.npy
                          ... those on no axes, where there is nothing to avoid, are left out
    tables/, opaque/      what formulas look up, and values of black boxes
    ledger                a line for each finished slab: array, place, slab, SHA-256 of these, the head and the slab
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
    probed,
    problem_of_file,
    replaced_whole,
    unwritable,
)
from sdhj.table.table import AvoidTubes, LookupTable, ascending_axes

STORE_FORMAT = 4
NAMES = ("tubes", "marks", "avoid_static", "avoid_moving")
ENTERED = re.compile("(tubes|avoid_static|avoid_moving) ([0-9]{1,9}) ([0-9]{1,9}) ([0-9a-f]{64})")  # of the ledger
Runs = Sequence[tuple[int, int]]


@contextmanager
def readable(path: Path) -> Iterator[None]:
    """A context in which errors in reading a store, or a file of one, at `path` become TableFileError."""
    try:
        yield
    except TableFileError:
        raise
    except (OSError, LookupError, ArithmeticError, AttributeError, ValueError, TypeError) as error:
        raise TableFileError(f"{path} is missing, damaged or of another store ({error}); solve it anew") from error


class Slab(NamedTuple):
    """Which part of which array: a slab of a tube, with its marks, or of the avoid tubes of a step.

    array : "tubes", "avoid_static" or "avoid_moving". place : which tube, or which step; 0 of the static ones. number :
    which slab, counted along the axis that is cut.
    """

    array: str
    place: int
    number: int

    @property
    def arrays(self) -> tuple[str, ...]:
        """The arrays that are written with it: a tube and its marks, or one."""
        return ("tubes", "marks") if self.array == "tubes" else (self.array,)


@dataclass(frozen=True)
class Shapes:
    """The shapes of a table's arrays, and how they are cut into slabs: `width` nodes of one axis of the grid each."""

    shape: tuple[int, ...]  # of the grid
    inputs: int
    tubes: int  # as many as there is room for
    steps: int
    dtype: str
    axis: int
    width: int
    avoid_axes: Mapping[str, tuple[int, ...]]  # of avoid_static and avoid_moving

    @classmethod
    def of(cls, problem: ReachAvoidProblem, *cut: Any) -> Self:
        """The shapes of a problem's table; `cut` are the fields from `dtype` on."""
        tubes, steps = LookupTable.most_tubes(problem), problem.most_steps
        return cls(problem.grid.shape, len(problem.inputs), tubes, steps, *cut)

    @property
    def slabs(self) -> int:
        """Number of slabs."""
        return -(-self.shape[self.axis] // self.width)

    def axes(self, array: str) -> tuple[int, ...]:
        """The axes of the grid that an array has: all of them, or those that the unsafe sets depend on."""
        return self.avoid_axes.get(array, tuple(range(len(self.shape))))

    def slabs_of(self, array: str) -> int:
        """Number of slabs of an array: one where it knows nothing of the cut."""
        return self.slabs if self.axis in self.axes(array) else 1

    def span(self, number: int) -> tuple[int, int]:
        """The first node of slab `number` along the axis that is cut, and the one behind its last."""
        return number * self.width, min((number + 1) * self.width, self.shape[self.axis])

    def runs(self, array: str, number: int) -> Runs:
        """(begin, end) of slab `number` on each axis of the grid that an array has; of axes not cut all nodes."""
        return [self.span(number) if axis == self.axis else (0, self.shape[axis]) for axis in self.axes(array)]

    def kind(self, array: str) -> Any:
        """The dtype of an array."""
        return np.dtype(np.uint8 if array == "marks" else self.dtype)

    def lead(self, array: str) -> tuple[int, ...]:
        """The lengths of the axes before those of the grid at one place: () of a tube, bytes of marks, L of avoid."""
        return {"tubes": (), "marks": (-(-self.inputs // 8),)}.get(array, (self.inputs,))

    def block(self, array: str) -> tuple[int, ...]:
        """The shape at one place of an array: of one tube, its marks, or the avoid tubes of a step."""
        return self._blocks[array]

    @cached_property
    def _blocks(self) -> dict[str, tuple[int, ...]]:
        """The shape at one place, by the array."""
        return {one: (*self.lead(one), *(self.shape[axis] for axis in self.axes(one))) for one in NAMES}

    def whole(self, array: str) -> tuple[int, ...]:
        """The shape of an array over all places, as a `LookupTable` has it; in marks the nodes are one axis."""
        lead, block = self.lead(array), self.block(array)
        block = (*lead, math.prod(self.shape)) if array == "marks" else block
        return block if array == "avoid_static" else (self.steps if array == "avoid_moving" else self.tubes, *block)

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays."""
        return sum(math.prod(self.whole(array)) * self.kind(array).itemsize for array in NAMES)

    def slabs_with(self, tubes: int) -> Iterator[Slab]:
        """All slabs of a table with so many tubes."""
        for array, places in ("tubes", tubes), ("avoid_static", 1), ("avoid_moving", self.steps):
            if self.axes(array):
                yield from (Slab(array, *one) for one in product(range(places), range(self.slabs_of(array))))


def index_of(runs: Runs) -> Any:
    """The index, for NumPy, of what lies in `runs`, (begin, end) of each of the last axes."""
    return (..., *(slice(*run) for run in runs))


class Arrays:
    """The arrays of a table, read and written a slab at a time; where they are is up to `Memory` and `Store`."""

    layout: Shapes

    def block(self, array: str, place: int) -> FloatArray:
        """The block at a place of an array, as `Shapes.block` says."""
        raise NotImplementedError

    def read(self, array: str, place: int, runs: Runs) -> FloatArray:
        """Part of the block at a place, from begin to end of each axis of the grid: contiguous, a view if it can be."""
        return np.ascontiguousarray(self.block(array, place)[index_of(runs)])

    def whole(self, array: str) -> FloatArray:
        """A whole array, of shape `Shapes.whole`, as a `LookupTable` has it; its values may be filled in later."""
        raise NotImplementedError

    @property
    def avoid(self) -> AvoidTubes:
        """The avoid tubes of all unsafe sets, static and moving, over the whole arrays."""
        static, moving = NAMES[2:]
        axes = self.layout.axes(static), self.layout.axes(moving)
        return AvoidTubes(axes[0], self.whole(static), axes[1], self.whole(moving))

    def table(self, problem: ReachAvoidProblem, method: str, index: FloatArray) -> LookupTable:
        """A `LookupTable` whose arrays are these and whose index is `index` (entries,); it has no details yet."""
        return LookupTable(problem, method, index, self.whole("tubes"), self.whole("marks"), self.avoid, {})

    def buffers(self, slab: Slab) -> list[FloatArray]:
        """Arrays to be filled in with a slab, and to be handed to `write`; marks are 0."""
        found = []
        for array in slab.arrays:
            nodes = (end - begin for begin, end in self.layout.runs(array, slab.number))
            found.append(np.zeros((*self.layout.lead(array), *nodes), self.layout.kind(array)))
        return found


class Memory(Arrays):
    """The arrays of a table in memory; where there is one slab, what is read and written are views of them."""

    def __init__(self, layout: Shapes) -> None:
        """Arrays of a layout, none of which is made yet."""
        self.layout, self.arrays = layout, dict[str, FloatArray]()

    def block(self, array: str, place: int) -> FloatArray:
        """A view of the block at a place of an array, of shape `Shapes.block`."""
        found: FloatArray = self.whole(array).reshape(-1, *self.layout.block(array))[place]
        return found

    def buffers(self, slab: Slab) -> list[FloatArray]:
        """The place itself where there is one slab, else new arrays."""
        one = self.layout.slabs == 1
        return [self.block(array, slab.place) for array in slab.arrays] if one else super().buffers(slab)

    def there(self, slab: Slab) -> bool:
        """Whether a slab is finished already: never, as nothing in memory outlasts a solve."""
        return False

    def write(self, slab: Slab, values: Sequence[FloatArray]) -> str:
        """Keep `values`, the arrays of a slab; a whole array is kept without a copy. Returns an empty digest."""
        for array, one in zip(slab.arrays, values, strict=True):
            if (one.shape, one.dtype) == (self.layout.whole(array), self.layout.kind(array)):
                self.arrays[array] = one  # to copy all avoid tubes would take as long as a game
                continue
            runs = self.layout.runs(array, slab.number)
            part = self.block(array, slab.place)[index_of(runs)]
            if not np.may_share_memory(part, one):
                part[...] = one
        return ""

    def enter(self, slab: Slab, digest: str) -> None:
        """Nothing: in memory no ledger is kept of finished slabs."""

    def whole(self, array: str) -> FloatArray:
        """A whole array; made when first asked for, so that it may take memory that games had before.

        Marks are 0, avoid tubes without an axis -inf, and others undefined until they are written.
        """
        if array not in self.arrays:
            make = np.zeros if array == "marks" else np.empty
            self.arrays[array] = make(self.layout.whole(array), self.layout.kind(array))
            if not self.layout.axes(array):
                self.arrays[array].fill(-np.inf)
        return self.arrays[array]


class Store(Arrays):
    """The arrays of a table in the files of a store: what is read is mapped, what is written goes to its place.

    seal : digest of the head, which is bound into all others. It is pickled without what it has read.
    """

    def __init__(self, path: Path, layout: Shapes, seal: str) -> None:
        """A store at a path, with a layout of its arrays, and as `seal` the digest of its head; nothing is read yet."""
        self.path, self.layout, self.seal = path, layout, seal

    def __reduce__(self) -> Any:
        """Pickled it is its path, layout and seal, from which a worker reads and writes the same files."""
        return Store, (self.path, self.layout, self.seal)

    # ---- the files of arrays

    def file(self, array: str) -> Path:
        """The file of an array."""
        return self.path / f"{array}.npy"

    @cached_property
    def begins(self) -> dict[str, int]:
        """Where in its file each array begins; TableFileError where a file is none of this store."""
        return {array: self._header(array)[0] for array in NAMES if self.layout.axes(array)}

    def _header(self, array: str) -> tuple[int, tuple[int, ...]]:
        """Where an array's data begin in its file, in bytes, and its shape there, which may have fewer tubes.

        TableFileError if the file is missing, cut short or of another dtype or shape.
        """
        file, expected = self.file(array), self.layout.whole(array)
        with readable(file), open(file, "rb") as stream:
            np.lib.format.read_magic(stream)
            shape, fortran, kind = np.lib.format.read_array_header_1_0(stream)
            if fortran or kind != self.layout.kind(array) or shape[1:] != expected[1:] or shape[0] > expected[0]:
                raise ValueError(f"it is {kind} of {shape}, and this store has {self.layout.kind(array)} of {expected}")
            begin: int = stream.tell()
            if file.stat().st_size < begin + math.prod(shape) * kind.itemsize:
                raise ValueError("it is cut short")
        return begin, shape

    def block(self, array: str, place: int) -> FloatArray:
        """The block at a place of an array on disk, mapped read-only, typed as an array in memory."""
        block, kind = self.layout.block(array), self.layout.kind(array)
        if not self.layout.axes(array):
            return np.full(block, -np.inf, kind)
        begin = self.begins[array] + place * math.prod(block) * kind.itemsize
        return np.asarray(np.memmap(self.file(array), kind, "c", begin, block))

    def write(self, slab: Slab, values: Sequence[FloatArray]) -> str:
        """Write the arrays of a slab to their places and flush them to the disk; returns the slab's digest.

        OSError, with what to do, if it cannot be written.
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
        """The parts of a slab's `values` that lie in one piece of the array's file: (offset in bytes, values)."""
        block = self.layout.block(array)
        runs = [*((0, n) for n in self.layout.lead(array)), *self.layout.runs(array, slab.number)]
        cut = next((axis for axis, n in enumerate(block) if runs[axis] != (0, n)), 0)
        first = slab.place * math.prod(block) + runs[cut][0] * math.prod(block[cut + 1 :])
        for number, row in enumerate(np.ascontiguousarray(values).reshape(math.prod(block[:cut]), -1)):
            yield self.begins[array] + (first + number * math.prod(block[cut:])) * row.itemsize, row

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """A context in which an OSError says also what stays and what to do."""
        try:
            yield
        except OSError as error:
            raise OSError(
                f"cannot write in {self.path}: {error.strerror or error}; what is finished stays: make room, or see "
                "who may write there, and solve with resume=True"
            ) from error

    # ---- the ledger

    @cached_property
    def entered(self) -> dict[Slab, str]:
        """The digests of the finished slabs, as the ledger has them; of a line that was cut short nothing."""
        with readable(file := self.path / "ledger"):
            lines = file.read_text(encoding="ascii", errors="replace").splitlines()
        found = {Slab(line[1], int(line[2]), int(line[3])): line[4] for line in map(ENTERED.fullmatch, lines) if line}
        possible = set(self.layout.slabs_with(self.layout.tubes))
        return {slab: digest for slab, digest in found.items() if slab in possible}

    def there(self, slab: Slab) -> bool:
        """Whether the ledger has a line for a slab."""
        return slab in self.entered

    def enter(self, slab: Slab, digest: str) -> None:
        """Add a line for a finished slab to the ledger on disk; it begins anew where the last one was cut short."""
        with self._writing(), open(self.path / "ledger", "ab") as stream:
            stream.write(f"\n{slab.array} {slab.place} {slab.number} {digest}\n".encode())
            stream.flush()
            os.fsync(stream.fileno())
        self.entered[slab] = digest

    def digest(self, slab: Slab, values: Sequence[FloatArray]) -> str:
        """SHA-256 of a slab: of its place and values, bound to the seal of the store."""
        found = hashlib.sha256(f"{self.seal} {slab.array} {slab.place} {slab.number}\n".encode())
        for one in values:
            found.update(np.ascontiguousarray(one).reshape(-1).data)
        return found.hexdigest()

    def check(self, slabs: Sequence[Slab]) -> None:
        """Read slabs; TableFileError where one is not in the ledger, or is not what the ledger says."""
        if missing := [slab for slab in slabs if slab not in self.entered]:
            raise TableFileError(
                f"{len(missing)} slabs of {self.path} are not in its ledger, first {' '.join(map(str, missing[0]))}; "
                "solve with resume=True, which makes them anew"
            )
        for slab in slabs:
            found = [self.read(array, slab.place, self.layout.runs(array, slab.number)) for array in slab.arrays]
            if self.digest(slab, found) != self.entered[slab]:
                line = " ".join(map(str, slab))
                raise TableFileError(
                    f"{self.file(slab.array)} is damaged, or parts of it are not what was written there: place "
                    f"{slab.place}, slab {slab.number}; delete the line that begins {line!r} from "
                    f"{self.path / 'ledger'} and solve with resume=True, which makes it anew"
                )

    # ---- the whole

    def finish(self, index: FloatArray, details: Mapping[str, Any]) -> None:
        """Write the index, by which the store is whole: the tube of each entry (entries,), and details of the solve.

        The files of tubes and marks are cut to as many as the index names. OSError, with what to do.
        """
        with self._writing():
            for array in ("tubes", "marks"):
                with open(self.file(array), "r+b") as stream:
                    write_header(stream, self.layout, array, int(index.max()) + 1)
            with replaced_whole(self.path / "index") as file:
                file.write_text(sealed_text({"index": index.tolist(), "details": dict(details)}, self.seal))

    def whole(self, array: str, kinds: str = "", shape: Lengths | None = None) -> FloatArray:
        """A whole array, mapped read-only, of the type of those in memory; the dtypes `kinds` are not asked.

        TableFileError if its file does not fit the layout, ValueError if it is not of `shape`, a set of lengths or one
        on each axis.
        """
        if not self.layout.axes(array):
            return np.full(self.layout.whole(array), -np.inf, self.layout.dtype)
        begin, found = self._header(array)
        if shape is not None and not fits(found, shape):
            raise ValueError(f"its array {array} must be of shape {shape}, got {found}")
        return np.asarray(np.memmap(self.file(array), self.layout.kind(array), "r", begin, found))


@dataclass(frozen=True, repr=False)
class StoredTable(LookupTable):
    """A `LookupTable` whose arrays are mapped from a store: what is asked for is read, and the system keeps some of it.

    It is made by `sdhj.solve(problem, store=...)` or `sdhj.load`, for tables larger than memory. It is pickled as the
    name of its folder, from which it is loaded again.
    """

    path: Path | None = field(default=None, init=False, compare=False)
    folder: InitVar[Path | None] = None  # `path`; none of what `dataclasses.replace` makes of it

    def __post_init__(self, folder: Path | None) -> None:
        """The folder becomes the `path`."""
        super().__post_init__()
        object.__setattr__(self, "path", folder)

    def __reduce_ex__(self, protocol: Any) -> Any:
        """Pickled it is the name of its folder, with the problem if that has black boxes, which no file contains."""
        opaque = self.problem if self.problem.opaque else None
        return (load_stored, (self.path, opaque, True, self.player)) if self.path else super().__reduce_ex__(protocol)


def is_store(path: Named) -> bool:
    """Whether a name is that of a store, perhaps of one of an earlier version."""
    return any(os.path.isfile(os.path.join(path, name)) for name in ("head", "zarr.json"))


def load_stored(
    path: Named, problem: ReachAvoidProblem | None = None, check: bool = True, player: Player | None = None
) -> StoredTable:
    """The table of a finished store; with `check` all of it is read once and compared with its ledger.

    player : simulates runs for `Table.played`. TableFileError if it is unfinished, damaged or of another problem.
    """
    store, head, problem = opened_store(path, problem)
    if not (store.path / "index").is_file():
        raise TableFileError(f"{path} is not finished; go on with sdhj.solve(..., store=..., resume=True)")
    content = _unsealed(store.path / "index", store.seal)[0]
    with readable(store.path):
        index, fields = np.array(content["index"], dtype=np.int64), {"player": player, "folder": store.path}
        found = StoredTable.of_arrays(head, store.whole, index, problem, **fields)
    if check:
        store.check(list(store.layout.slabs_with(len(found.tubes))))
    return found


def head_of_store(path: Named) -> tuple[dict[str, Any], str]:
    """The head of a store, finished or not, as `checked_head` returns it, and its digest; errors as of `load`."""
    path = Path(path)
    if (path / "zarr.json").is_file():
        raise TableFileError(
            f"{path} is a Zarr store, of an sdhj before there were stores of plain arrays; solve it anew"
        )
    if not (path / "head").is_file():
        raise FileNotFoundError(f"no store {path}; write one with sdhj.solve(problem, store=...)")
    head, seal = _unsealed(path / "head")
    with readable(path):
        if head["store"] != STORE_FORMAT:
            raise ValueError(f"it has store version {head['store']}, and this sdhj reads {STORE_FORMAT}")
        if (path / "index").is_file():
            head["details"] = _unsealed(path / "index", seal)[0]["details"]
        return checked_head(head), seal


def opened_store(
    path: Named, problem: ReachAvoidProblem | None = None
) -> tuple[Store, dict[str, Any], ReachAvoidProblem]:
    """A store, finished or not, its head and its problem; errors are those of `load`."""
    (head, seal), path = head_of_store(path), Path(os.path.abspath(path))
    with readable(path):
        problem = problem_of_file(path, head, functions_of(path), problem)
        return Store(path, shapes_of(problem, head), seal), head, problem


def shapes_of(problem: ReachAvoidProblem, head: Mapping[str, Any]) -> Shapes:
    """How the arrays of a problem's table lie in a store with a head; ValueError if the two do not fit."""
    (axis, width), shape = head["cut"], problem.grid.shape
    axis = whole("the axis that is cut", axis, least=0, most=len(shape) - 1)
    width = whole("the width of slabs", width, least=1, most=shape[axis])
    option("dtype", head["dtype"], ("float32", "float64"))
    names = NAMES[2:]
    axes = {name: ascending_axes(head["avoid_axes"][name.removeprefix("avoid_")], name, problem.grid) for name in names}
    return Shapes.of(problem, head["dtype"], axis, width, axes)


def functions_of(path: Path) -> dict[str, FloatArray]:
    """The tables that formulas look up and the values of black boxes in a store, by name, such as "tables/0"."""
    files = [file for group in ("tables", "opaque") for file in (path / group).glob("*.npy")]
    return {f"{file.parent.name}/{file.stem}": np.load(file, allow_pickle=False) for file in files}


def create(path: Path, head: Mapping[str, Any], functions: Mapping[str, FloatArray], layout: Shapes) -> str:
    """Make a store: a folder with the head, the arrays that formulas look up (`functions`, by name) and empty arrays.

    It appears when it is whole. Returns its seal, the digest of the head. FileExistsError if there is something of that
    name, OSError, with what to do, if it cannot be written.
    """
    probed(path.parent)
    temporary = path.with_name(f".sdhj-{uuid.uuid4().hex}")
    try:
        temporary.mkdir()
        text = sealed_text(head)
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
        free_name(path)
        raise unwritable(path.parent, error) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return text.partition("\n")[0]


def write_header(stream: Any, layout: Shapes, array: str, tubes: int) -> None:
    """Write the header of an array's .npy file, for so many tubes, to a stream at its beginning, and set the length.

    What is not written yet takes no room on the disk.
    """
    shape, kind = layout.whole(array), layout.kind(array)
    shape = (tubes, *shape[1:]) if array in NAMES[:2] else shape
    about = {"descr": np.lib.format.dtype_to_descr(kind), "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(stream, about)  # as long for each number of tubes
    stream.truncate(stream.tell() + math.prod(shape) * kind.itemsize)


def sealed_text(content: Mapping[str, Any], seal: str = "") -> str:
    """A mapping as JSON, behind a line with the SHA-256 of `seal` and itself."""
    text = json.dumps(content, sort_keys=True)
    return f"{hashlib.sha256(f'{seal}{text}'.encode()).hexdigest()}\n{text}\n"


def _unsealed(file: Path, seal: str = "") -> tuple[Any, str]:
    """Read a file of `sealed_text`: its mapping and the digest in its first line; TableFileError if that is wrong."""
    with readable(file):
        text = file.read_text()
        content = json.loads(text.partition("\n")[2])
        if sealed_text(content, seal) != text:
            raise ValueError("its digest is another")
    return content, text.partition("\n")[0]


def free_name(path: Path) -> None:
    """Raise FileExistsError where there is something of that name."""
    if os.path.lexists(path):
        raise FileExistsError(f"{path} exists already; go on with it by resume=True, remove it, or choose another name")


def warn_of_disk(path: Path, needed: int) -> None:
    """Warn where the disk of a path's folder has fewer bytes free than are needed; nothing where it cannot be asked."""
    with suppress(OSError):
        if needed > (free := shutil.disk_usage(path.parent).free):
            warnings.warn(
                f"{path} takes up to {needed / 1e9:.3g} GB, and {free / 1e9:.3g} GB are free; where the disk is full "
                "the solve ends, and goes on with resume=True",
                stacklevel=4,
            )
