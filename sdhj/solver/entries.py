"""A table on disk, an entry at a time: whole entries of the recursion in a folder, here or on many machines.

    begun.json     the problem and the method, until the table is complete
    tubes.npy, marks.npy, avoid_static.npy, avoid_moving.npy, ...
                   the arrays of a `LookupTable`, as `sdhj.table.container` has them
    done/          a *mark* for each part that is complete: an entry, or the avoid tubes of a step
    shares/        tubes of some inputs alone, which are still to be united
    problem.json   the head of the table, with the digests of all arrays; with it the table is complete

A part is computed as in memory (`GridParts`), on arrays that are mapped for reading, written to its place, flushed to
the disk, and only then marked: this is all that going on after a crash needs. The mark of an entry holds its *place*,
the number of the tube that it has. An entry that cannot differ from the one before it has the place of that one and
writes nothing, as in `sdhj.solver.recursion.recursion`.
"""

import importlib
import json
import math
import os
import reprlib
import shutil
import tempfile
import threading
import time
import uuid
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

try:
    import fcntl
except ImportError:  # as on Windows
    fcntl = None  # type: ignore[assignment]

from sdhj.common.findings import tell
from sdhj.common.memory import require_memory
from sdhj.common.remembering import FloatArray
from sdhj.problem.describing import arrays_of
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.solver.findings import check_resolution, never_met_finding
from sdhj.solver.recursion import (
    ARRAYS,
    GridMethod,
    GridParts,
    GridSets,
    InputRows,
    bytes_of_entry,
    unshared_index,
    why_large,
)
from sdhj.table import container
from sdhj.table.batches import entry
from sdhj.table.files import (
    VERSION,
    Named,
    TableFileError,
    arrays_in,
    checked_head,
    finish_folder,
    make_head,
    opened_table,
    problem_of_file,
    replaced_whole,
    require_writable,
    unwritable_error,
)
from sdhj.table.table import AvoidTubes, entries

BEGUN, DONE, SHARES = "begun.json", "done", "shares"
SCRATCH = 2**26  # bytes of an array from which on it lies in a file while avoid tubes are put together
LOOKED_AT = 2**22  # nodes of an unsafe set whose resolution is checked
IN_FLIGHT = 2  # rows of entries that workers have at a time
ONE_AT_A_TIME = threading.Lock()  # threads of a worker share the memory that one part may take


class Part(NamedTuple):
    """What is computed and written at a time: the avoid tubes of a step, an entry (also a goal), or a share of one."""

    # "avoid_static", "avoid_moving", "entry" or "share": an entry by some inputs, which the entry's own part unites
    kind: str
    step: int
    within: int = 0  # n of an entry or a share
    share: int = 0  # which of the shares of an entry or of avoid tubes
    shares: int = 0  # into how many the inputs are shared out; 0 of what is computed as a whole

    @property
    def name(self) -> str:
        """The name of its mark or, of a share of an entry, of its file."""
        # a solve that goes on knows parts by this name: under another one all are computed again
        of = f"-{self.share}-of-{self.shares}" if self.shares and self.kind != "entry" else ""
        return f"{self.kind}-{self.step}-{self.within}{of}"


def shares_of(part: Part) -> list[Part]:
    """The shares of an entry."""
    return [part._replace(kind="share", share=share) for share in range(part.shares)]


class Folder:
    """The folder of a table that is being solved, as one process sees it."""

    def __init__(self, path: Path, problem: ReachAvoidProblem, method: GridMethod) -> None:
        self.path, self.parts = path, GridParts(problem, method, self.scratch)

    # ---- arrays

    def file(self, name: str) -> Path:
        """The path of an array's file."""
        return self.path / container.file_name(name)

    def scratch(self, shape: Sequence[int], dtype: str) -> FloatArray:
        """An array for intermediate results, in a file without a name if it is large."""
        size = math.prod(shape) * np.dtype(dtype).itemsize
        if size <= SCRATCH:
            return np.empty(shape, dtype)
        # the file has no name, and is gone as soon as nobody has the array
        with tempfile.TemporaryFile(dir=self.path) as stream:
            stream.truncate(size)
            return np.asarray(np.memmap(stream, dtype, "r+", shape=tuple(shape)))

    def write(self, name: str, values: Iterable[FloatArray], positions: Sequence[int] = (0,)) -> None:
        """Write values of one size to an array's file, each so many times this size behind its first, and flush it."""
        try:
            with open(self.file(name), "r+b", buffering=0) as out:
                for position, one in zip(positions, values, strict=True):
                    data = np.ascontiguousarray(one).reshape(-1).view(np.uint8).data
                    # the file is there already, at its full size: `container.begin_array` has made it
                    out.seek(container.HEADER + position * len(data))
                    while data:
                        data = data[out.write(data) :]
                os.fsync(out.fileno())
        except OSError as error:
            raise type(error)(
                error.errno,
                f"cannot write {self.file(name)}: {error.strerror or error}; what is complete stays: make room, and "
                "solve with resume=True",
            ) from error

    def tube(self, place: int) -> FloatArray:
        """The stored tube at a place, mapped: nobody may write it."""
        shape, dtype = self.parts.problem.grid.shape, np.dtype(self.parts.dtype)
        offset = container.HEADER + place * math.prod(shape) * dtype.itemsize
        # what may not be written has another type, for which kernels would be compiled once more
        return np.asarray(np.memmap(self.file("tubes"), dtype, "c", offset, shape))

    @cached_property
    def rows(self) -> InputRows:
        """The avoid tubes, mapped, as entries are intersected with them; all have to be complete."""
        parts = self.parts
        # static before moving, in the order of `GridParts.axes`, as `AvoidTubes` takes them
        static, moving = (
            np.asarray(np.memmap(self.file(name), parts.kind(name), "r", container.HEADER, parts.shape(name)))
            for name in parts.axes
        )
        tubes = AvoidTubes(parts.axes["avoid_static"], static, parts.axes["avoid_moving"], moving)
        return InputRows(parts.problem.grid, tubes)

    # ---- marks

    def mark(self, part: Part) -> dict[str, Any] | None:
        """What the mark of a part tells; None if it is not complete."""
        try:
            found = json.loads((self.path / DONE / part.name).read_text())
            # a mark that was changed could name a place that the file of tubes does not have
            if part.kind not in self.parts.axes and not 0 <= found["place"] < self.parts.shape("tubes")[0]:
                raise ValueError
            return dict(found)
        except FileNotFoundError:
            return None
        except (ValueError, TypeError, LookupError):
            wrong = self.path / DONE / part.name
            raise TableFileError(f"{wrong} is damaged; remove it, and solve with resume=True") from None

    def set_mark(self, part: Part, **told: Any) -> None:
        """Mark a part as complete."""
        # after `write` has flushed what it says: a mark is believed, and nobody looks at the numbers again
        with replaced_whole(self.path / DONE / part.name) as temporary:
            temporary.write_text(json.dumps(told))

    def place(self, step: int, within: int) -> int:
        """The place of the tube that a complete entry has."""
        told = self.mark(Part("entry", 0 if self.parts.problem.time_invariant else step, within))
        if told is None:
            raise TableFileError(f"the entry of step {step} within {within} is missing in {self.path}: solve it anew")
        return int(told["place"])

    # ---- parts

    def complete(self, part: Part) -> None:
        """Compute, write and mark a part, unless it is complete; what it follows from has to be."""
        # a share has no mark: it is complete where its entry is
        if self.mark(part._replace(kind="entry") if part.kind == "share" else part) is not None:
            return
        solved = getattr(self.parts.games, "solved", 0)
        if part.kind == "share":
            self._share(part)
        else:
            told = (self._avoid if part.kind in self.parts.axes else self._entry)(part)
            self.set_mark(part, **{"solved": getattr(self.parts.games, "solved", 0) - solved} | told)
            # now, as an entry that is not marked may have to be united once more
            for share in shares_of(part):
                (self.path / SHARES / share.name).unlink(missing_ok=True)

    def _avoid(self, part: Part) -> dict[str, Any]:
        """Write the avoid tubes of a step; returns what its mark tells: the sets that are met, the games' notes."""
        shape, inputs = self.parts.shape(part.kind)[part.kind == "avoid_moving" :], self.inputs_of(part)
        out = self.scratch((len(inputs), *shape[1:]), self.parts.dtype)
        met = self.parts.write_avoid(part.kind, part.step, out, *[inputs] * bool(part.shares))
        self.write(part.kind, out, [part.step * shape[0] + j for j in inputs])
        return {"met": sorted(met), "free": dict(getattr(self.parts.games, "free", {}))}

    def inputs_of(self, part: Part) -> list[int]:
        """The inputs by which a part is computed, ascending: those of a share, or all."""
        # runs of inputs by turns: as many for each share, and as fast, where those side by side are alike
        count, shares = len(self.parts.problem.inputs), max(1, part.shares)
        run = max(1, count // (2 * shares))
        return [j for j in range(count) if j // run % shares == part.share]

    def repeated(self, part: Part) -> bool:
        """Whether an entry cannot differ from the one before it: whether those that it follows from are equal."""
        if part.within < 2:
            return False
        one, other = (self.place(part.step + 1, part.within - n) for n in (1, 2))
        return one == other or all(map(np.array_equal, self.tube(one), self.tube(other)))

    def _entry(self, part: Part) -> dict[str, Any]:
        """Write an entry, or unite its shares; returns its place, and whether it is the tube of the one before it."""
        # `GridSets` does the same in memory, by `extend` and `repeat`: both have to give the same bits
        parts, step, within = self.parts, part.step, part.within
        if self.repeated(part):
            return {"place": self.place(step, within - 1), "shared": True}
        own, tube, told = self.own_place(part), np.empty(parts.problem.grid.shape, parts.dtype), dict[str, Any]()
        marks, shares = np.zeros(parts.shape("marks")[1:], np.uint8), shares_of(part)
        if within == 0:
            parts.write_goal(step, tube)
        elif shares:
            tube.fill(np.inf)
            # one PDE for each input, by those who made the shares
            told = {"solved": len(parts.problem.inputs)}
            for share in shares:
                with open(self.path / SHARES / share.name, "rb") as stream:
                    np.minimum(tube, np.load(stream), out=tube)
                    np.bitwise_or(marks, np.load(stream), out=marks)
        else:
            self._compute(part, tube, marks)
        if within:
            self.write("marks", [marks], [own])
        self.write("tubes", [tube], [own])
        return told | {"place": own, "shared": False}

    def _share(self, part: Part) -> None:
        """Write an entry by the inputs of a share, its tube and marks, to a file of its own."""
        if self.repeated(part):
            return
        tube = np.empty(self.parts.problem.grid.shape, self.parts.dtype)
        marks = np.zeros(self.parts.shape("marks")[1:], np.uint8)
        self._compute(part, tube, marks, self.inputs_of(part))
        # not flushed: a solve that goes on begins without shares
        temporary, target = self.path / SHARES / uuid.uuid4().hex, self.path / SHARES / part.name
        with open(temporary, "wb") as stream:
            np.save(stream, tube)
            np.save(stream, marks)
        os.replace(temporary, target)

    def _compute(self, part: Part, tube: FloatArray, marks: FloatArray, *some: Sequence[int]) -> None:
        """Write an entry, by some inputs or by all, to `tube` (*shape) and `marks` (bytes, nodes), 0 at first."""
        before, after = self.place(part.step, part.within - 1), self.place(part.step + 1, part.within - 1)
        self.parts.write_entry(self.rows, part.step, self.tube(before), self.tube(after), tube, marks, *some)

    @cached_property
    def _unshared(self) -> FloatArray:
        """Where the tube of each entry is written, if it has one of its own: (entries,)."""
        return unshared_index(self.parts.problem)

    def own_place(self, part: Part) -> int:
        """Where the tube of an entry is written, if it has one of its own."""
        return int(self._unshared[entry(self.parts.problem.steps, part.step, part.within)])

    # ---- the whole

    def told(self, parts: Sequence[Part]) -> list[dict[str, Any]]:
        """What the marks of some parts tell; TableFileError where one is missing."""
        found = {part.name: self.mark(part) for part in parts}
        if missing := [name for name, one in found.items() if one is None]:
            raise TableFileError(f"{missing[0]} is missing in {self.path / DONE}: solve it anew with resume=True")
        return [one for one in found.values() if one is not None]

    @property
    def places(self) -> FloatArray:
        """The places of all entries, which have to be complete, in the order of the table's index."""
        return np.array([self.place(*one) for one in entries(self.parts.problem.steps).tolist()])

    @property
    def moved(self) -> int:
        """How many tubes `closed_up` has looked after."""
        file = self.path / DONE / "moved"
        return int(file.read_text()) if file.exists() else 0

    def closed_up(self) -> FloatArray:
        """The table's index, after tubes behind entries that have none of their own were moved up."""
        size, places = self.parts.shape("marks")[1:], self.places
        # ascending: where a tube moves to lies nothing that is still to be moved
        for number, place in enumerate(np.unique(places).tolist()):
            # each is flushed and noted before the next, so that this too goes on where it was stopped
            if number < place and number >= self.moved:
                offset = container.HEADER + place * math.prod(size)
                self.write("marks", [np.memmap(self.file("marks"), np.uint8, "r", offset, size)], [number])
                self.write("tubes", [self.tube(place)], [number])
                with replaced_whole(self.path / DONE / "moved") as temporary:
                    temporary.write_text(str(number + 1))
        return np.searchsorted(np.unique(places), places).astype(np.int64)

    def goal(self, step: int) -> FloatArray:
        """The entry (step, 0), which is complete, mapped, also where tubes have been moved up."""
        # `look_over` asks for it also in a solve that goes on after it was stopped in `closed_up`
        place = self.place(step, 0)
        if moved := self.moved:
            number = int(np.searchsorted(np.unique(self.places), place))
            place = number if number < moved else place
        return self.tube(place)

    def finish(self, index: FloatArray, details: Mapping[str, Any]) -> None:
        """Make the folder a table with this index and these details, and remove what only the solve needed."""
        parts, stored = self.parts, int(index.max()) + 1
        every = entries(parts.problem.steps)
        arrays = {"index": index, "entries": every} | dict(arrays_of(parts.problem))
        for name, values in arrays.items():
            container.begin_array(self.path, name, values.dtype.name, values.shape)
            self.write(name, [values])
        shapes = {name: (values.dtype.name, values.shape) for name, values in arrays.items()}
        # Of tubes and marks as many as the index names, as equal ones are shared.
        for name in ARRAYS:
            shape = parts.shape(name)
            shapes[name] = parts.kind(name).name, (stored, *shape[1:]) if name in ("tubes", "marks") else shape
        told = make_head(parts.problem, parts.method.name, details, parts.problem.digest)
        axes = {name.removeprefix("avoid_"): list(some) for name, some in parts.axes.items()}
        finish_folder(self.path, told | {"avoid_axes": axes}, shapes)
        # only behind problem.json: where both are there `alone_in` takes the folder for finished
        (self.path / BEGUN).unlink(missing_ok=True)
        for name in (DONE, SHARES):
            shutil.rmtree(self.path / name, ignore_errors=True)


# ---- who works


def completed_here(folder: Folder, rows: Iterable[list[Part]], needs: Any) -> Iterator[Part]:
    """Complete parts in this process, and yield each when it is."""
    # `needs`, which `completed_by` asks, is not asked here: the rows are in an order that is enough
    for row in rows:
        for part in row:
            folder.complete(part)
            yield part


@lru_cache(maxsize=1)
def folder_of(pickled: bytes) -> Folder:
    """The folder of a pickled (name, path, problem, method), made once in a worker."""
    _, *given = importlib.import_module("cloudpickle").loads(pickled)
    return Folder(*given)


def complete_alone(pickled: bytes, part: Part, *needed: Any) -> None:
    """Complete a part in a worker of a Dask client; what is `needed` was waited for."""
    with ONE_AT_A_TIME:
        folder_of(pickled).complete(part)


def completed_by(
    client: Any, folder: Folder, rows: Iterable[list[Part]], needs: Callable[[Part], list[Part]]
) -> Iterator[Part]:
    """Have the workers of a Dask client complete parts, `IN_FLIGHT` rows at a time, yielding each.

    Arrays go through the folder, which every worker has to see under the same path. A worker that dies leaves no mark,
    and another one gets its part; of an error what has not begun is cancelled.
    """
    workers = list(client.nthreads())  # of all: some versions of `scheduler_info` tell of five
    # by a name of its own, made anew for entries: games keep velocities, and those of the avoid tubes are of all inputs
    given = uuid.uuid4().hex, folder.path, folder.parts.problem, folder.parts.method
    pickled = importlib.import_module("cloudpickle").dumps(given)
    flying, left = importlib.import_module("distributed").as_completed(), list[int]()
    futures, came_from = dict[Part, Any](), dict[str, tuple[Part, int]]()

    def landed() -> Part:
        future = next(flying)
        future.result()
        part, row = came_from.pop(future.key)
        left[row] -= 1
        return part

    try:
        for number, row in enumerate(rows):
            while sum(map(bool, left)) >= IN_FLIGHT:
                yield landed()
            left.append(len(row))
            for part in row:
                # what is in no row is complete
                waited = [futures[one] for one in needs(part) if one in futures]
                # or one worker would be given all, as Dask prefers the one that had what a part waits for
                placed = bool(workers) and bool(waited or part.shares)
                at = [workers[(number + part.share) % len(workers)]] if placed else None
                future = client.submit(
                    complete_alone, pickled, part, *waited, workers=at, allow_other_workers=bool(at), pure=False
                )
                futures[part], came_from[future.key] = future, (part, number)
                flying.add(future)
        while came_from:
            yield landed()
    except Exception as error:
        more = "with more memory for the workers if that is what ended them"
        error.add_note(f"what is complete stays in {folder.path}: solve with resume=True, {more}")
        raise
    finally:
        client.cancel([future for future in futures.values() if not future.done()])


# ---- a solve


def solve_stored(sets: GridSets, path: Named, resume: bool, client: Any, done: Callable[[], Any]) -> None:
    """Solve into a folder, entry by entry, and call `done` after each with n >= 1.

    Nothing of `sets` has been solved; `client` None is this process.
    """
    folder = opened(sets, path, resume, client)
    with alone_in(folder.path) as unfinished:
        if unfinished:
            fill(sets, folder, client, done)


@contextmanager
def alone_in(path: Path) -> Iterator[bool]:
    """A context with whether a folder's solve is unfinished; others of this machine wait for its end."""
    try:
        stream = open(path / BEGUN, "rb")
    except FileNotFoundError:
        yield False
        return
    with stream:
        if fcntl is not None:
            # of begun.json itself, so that the lock ends with the process, and with the solve
            fcntl.flock(stream, fcntl.LOCK_EX)
        yield not (path / container.HEAD).exists()


def fill(sets: GridSets, folder: Folder, client: Any, done: Callable[[], Any]) -> None:
    """Complete all parts of a folder, and make it a table."""
    started, problem = time.perf_counter(), sets.problem
    # of a solve that was stopped: with as many workers as there are now they may have other inputs
    for share in (folder.path / SHARES).iterdir():
        share.unlink()
    completed = completed_here if client is None else partial(completed_by, client)
    static, moving = folder.parts.axes.values()
    # among how many workers inputs are shared out, where each has games of its own
    apart = client is not None and getattr(folder.parts.games, "apart", False)
    shares = min(len(client.nthreads()), len(problem.inputs)) if apart else 0
    shares *= shares > 1
    avoid = [whole := Part("avoid_static", 0)] * bool(static)
    if shares and avoid and folder.mark(whole) is None:
        avoid = [whole._replace(share=share, shares=shares) for share in range(shares)]
    avoid += [Part("avoid_moving", step) for step in range(problem.steps if moving else 0)]
    goals = [Part("entry", step) for step in sets.rows_of_entries]
    for _ in completed(folder, [[*avoid, *goals]], lambda part: []):
        pass
    free: dict[int, float] = {}
    for one in (told := folder.told(avoid)):
        free |= {int(at): max(fraction, free.get(int(at), 0.0)) for at, fraction in one["free"].items()}
    met = {position for one in told for position in one["met"]}
    tell(*(never_met_finding(one) for position, one in enumerate(problem.unsafe) if position not in met))
    sets.look_over(folder.goal, free)

    def row(step: int) -> list[Part]:
        # Those with n >= 1, each behind its shares: one row is a chain, so that machines help only within an entry.
        within = shares if problem.time_invariant else 0
        each = [Part("entry", step, n, shares=within) for n in range(1, problem.steps - step + 1)]
        return [part for one in each for part in (*shares_of(one), one)]

    def needs(part: Part) -> list[Part]:
        # an entry follows from two others, and is united of its shares
        later = 0 if problem.time_invariant else part.step + 1
        before = part._replace(kind="entry", within=part.within - 1, share=0)
        return [*(shares_of(part) if part.kind == "entry" else []), before, *{before._replace(step=later)} - {before}]

    for part in completed(folder, map(row, sets.rows_of_entries), needs):
        if part.kind == "entry":
            done()
    told = folder.told([*avoid, *goals, *(one for k in sets.rows_of_entries for one in row(k) if one.kind == "entry")])
    index = folder.closed_up()
    solved, shared = sum(one["solved"] for one in told), sum(one.get("shared", False) for one in told)
    tubes = (folder.tube(int(index[entry(problem.steps, 0, within)])) for within in (0, problem.steps))
    folder.finish(index, sets.said_of(solved, shared, *tubes) | {"seconds": time.perf_counter() - started})


def opened(sets: GridSets, path: Named, resume: Any, client: Any) -> Folder:
    """The folder of a solve, new or one that goes on; memory and disk are looked at before."""
    if not isinstance(path, str | os.PathLike):
        raise ValueError(f"store must be the name of a folder, got {reprlib.repr(path)}")
    if not isinstance(resume, bool):
        raise ValueError(f"resume must be True or False, got {reprlib.repr(resume)}")
    if client is not None and not (callable(getattr(client, "submit", None)) and hasattr(client, "scheduler_info")):
        raise ValueError(f"client must be a distributed.Client, got {reprlib.repr(client)}")
    problem, found = sets.problem, Folder(Path(os.path.abspath(path)), sets.problem, sets.parts.method)
    if (there := os.path.lexists(found.path)) and not resume:
        raise FileExistsError(
            f"{found.path} exists already; go on with it by resume=True, remove it, or choose another name"
        )
    if there and (found.path / container.HEAD).exists():
        # Finished already: there is nothing to solve.
        check_finished(found, sets)
        return found
    if there:
        check_begun(found, sets)
    said = why_large(problem, found.parts.dtype)
    # before the folder is made: what does not fit leaves nothing behind
    require_memory(needed := bytes_of_entry(found.parts), "an entry of this solve", said)
    # by default some versions tell of five workers
    for name, one in (client.scheduler_info(n_workers=-1)["workers"] if client is not None else {}).items():
        if 0 < (limit := one.get("memory_limit") or 0) < needed:
            few = f"{needed / 1e9:.3g} GB, and the worker {name} has {limit / 1e9:.3g} GB"
            raise MemoryError(f"an entry of this solve needs about {few}; {said}")
    check_resolution(sets.parts.samples, LOOKED_AT)
    if not there:
        begin(found, sets)
    return found


def head_of(sets: GridSets) -> dict[str, Any]:
    """What begun.json has: the head of a table without details, and the method's options."""
    head = make_head(sets.problem, sets.parts.method.name, {}, sets.problem.digest) | {"options": sets.options}
    # through JSON and back, so that it is compared with a file's: there tuples are lists
    return dict(json.loads(json.dumps(head)))


def begin(folder: Folder, sets: GridSets) -> None:
    """Make the folder of a new solve: empty arrays, then begun.json."""
    path, parts = folder.path, folder.parts
    require_writable(path.parent)
    needed = sum(math.prod(parts.shape(name)) * parts.kind(name).itemsize for name in ARRAYS)
    with suppress(OSError):
        # where the disk has too little room this is warned of
        if needed > (free := shutil.disk_usage(path.parent).free):
            warnings.warn(
                f"{path} takes up to {needed / 1e9:.3g} GB, and {free / 1e9:.3g} GB are free; where the disk is full "
                "the solve ends, and goes on with resume=True",
                stacklevel=5,  # at the line that calls `sdhj.solve`
            )
    temporary = path.with_name(f".sdhj-{uuid.uuid4().hex}")
    try:
        for name in (DONE, SHARES):
            (temporary / name).mkdir(parents=True)
        for name in ARRAYS:
            container.begin_array(temporary, name, parts.kind(name).name, parts.shape(name))
            if not parts.axes.get(name, True):  # nothing to avoid
                nothing = np.full(parts.shape(name), -np.inf, parts.dtype)
                Folder(temporary, parts.problem, parts.method).write(name, [nothing])
        (temporary / BEGUN).write_text(json.dumps(head_of(sets)))
        os.rename(temporary, path)
    except OSError as error:
        raise unwritable_error(path.parent, error) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def check_begun(folder: Folder, sets: GridSets) -> None:
    """TableFileError unless a folder was begun for this problem, method and version."""
    try:
        head = json.loads((folder.path / BEGUN).read_text())
        # Whatever is wrong with a head that somebody wrote, only the folder is refused.
        checked = checked_head(head)
    except (OSError, LookupError, ArithmeticError, AttributeError, ValueError, TypeError) as error:
        raise TableFileError(f"{folder.path} is no folder of a solve ({error}); choose another name") from error
    if (its := head["sdhj_version"]) != VERSION:
        raise TableFileError(
            f"{folder.path} was begun by sdhj {its}, and this is {VERSION}, which may round otherwise; solve it anew"
        )
    now = head_of(sets)
    if (head["method"], head.get("options")) != (now["method"], now["options"]):
        its = f"method {head['method']!r} with {head.get('options')}"
        raise TableFileError(
            f"{folder.path} is being solved by {its}, and this is {now['method']!r} with {now['options']}"
        )
    # Last, as it may compare formulas and values.
    problem_of_file(folder.path, checked, arrays_of(sets.problem), sets.problem)


def check_finished(folder: Folder, sets: GridSets) -> None:
    """TableFileError unless a folder has the table of this problem by this method, with these options."""
    with opened_table(folder.path, check=False) as (head, file):
        # a table's details have the options of its method under the same names (`fill`)
        options = {name: head["details"].get(name) for name in sets.options}
        now = head_of(sets)
        if (head["method"], options) != (now["method"], now["options"]):
            raise TableFileError(
                f"{folder.path} was solved by method {head['method']!r} with {options}, and this is {now['method']!r} "
                f"with {now['options']}"
            )
        problem_of_file(folder.path, head, arrays_in(file), sets.problem)
