"""Files: written whole or not at all, and what a table's file says of itself.

A table's file begins with three lines of text: what it is and its format, the SHA-256 of all that follows, and in JSON
what it tells of problem, method and conventions. Behind them begins an HDF5 file of arrays and nothing else, as the
class of its table writes them. The digest is looked at before anything else is, so that damage is found and no damaged
bytes reach the HDF5 library. `sdhj.solving.load` finds that class by the method, and the builder of a case study by its
recipe.
"""

import hashlib
import importlib
import json
import os
import re
import reprlib
import stat
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from io import BufferedReader
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from sdhj.kernels import FloatArray
from sdhj.problem.checks import finite_array, number, whole
from sdhj.problem.grid import Grid
from sdhj.problem.memory import require
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sensing import Sensing
from sdhj.table.batches import Table

TEMPORARIES: set[Path] = set()  # files that are being written


VERSION = "0.2.0"
FORMAT_VERSION = 3
FIRST_LINE = "sdhj look-up table, format {}\n"
CONVENTION = "a set is where its function is <= 0; union is min, intersection is max"
LAYOUT = ("lower", "upper", "shape", "periodic", "names", "ends")
MOST_TOLD = 1 << 24  # bytes of text
GROWTH = 1 << 24  # bytes by which a file grows in memory
PACKING = {"compression": "gzip", "compression_opts": 1, "shuffle": True}  # of large arrays
FILTERS = {h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE}


# Without locks of this kind nothing tells what a killed process left from what another one writes, and it stays.
locks: Any = importlib.import_module("fcntl") if os.name == "posix" else None


class TableFileError(ValueError):
    """A file that is not a whole look-up table of a known version."""


# ---- files, whole or not there


@contextmanager
def replaced_whole(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A path beside `path` to write to; what stands there takes the name at the end, or is gone after an error.

    Nobody ever sees half a file, a crash of the system included. The suffix is kept, from which writers tell the
    format.

    Raises
    ------
    OSError
        Where nothing can be written there, with what to do about it.
    """
    path = _regular(path)
    with _temporary(path) as temporary:
        try:
            yield temporary
            with open(temporary, "r+b") as file:
                os.fsync(file.fileno())
            os.replace(temporary, path)
        except OSError as error:
            if error.errno is None or error.filename is not None:  # it has words already, or is about another file
                raise
            raise OSError(f"cannot write {path}: {error.strerror}; make room, or choose another place") from error
        with suppress(OSError):  # not every system opens folders
            folder = os.open(path.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)


@contextmanager
def _temporary(path: Path) -> Iterator[Path]:
    """An empty file in the folder of `path`, gone at the end; what killed processes left there is gone as well.

    Whoever writes one holds a lock on it, which ends with the process.
    """
    lock, temporary = None, path.with_name(f".sdhj-{uuid.uuid4().hex}{path.suffix}")
    try:
        for left in path.parent.glob(".sdhj-*") if locks else ():
            with suppress(OSError), open(left, "r+b") as other:
                locks.flock(other, locks.LOCK_EX | locks.LOCK_NB)
                left.unlink()
        TEMPORARIES.add(temporary)
        while lock is None or not temporary.exists():  # another process may have cleaned up before it was locked
            lock = open(temporary, "w")
            if locks:
                locks.flock(lock, locks.LOCK_EX)
            else:
                lock.close()
    except OSError as error:
        TEMPORARIES.discard(temporary)
        raise unwritable(path.parent, error) from error
    try:
        yield temporary
    finally:
        temporary.unlink(missing_ok=True)
        TEMPORARIES.discard(temporary)
        lock.close()


def writable_file(path: str | os.PathLike[str]) -> Path:
    """The path of a file that can be written; its folder must exist.

    Raises
    ------
    OSError
        Where it cannot be written, with what to do about it.
    """
    path = _regular(path)
    probed(path.parent, path.name)
    return path


def _regular(path: str | os.PathLike[str]) -> Path:
    """The file that a name stands for, links followed; OSError where something else than a file has that name."""
    if not isinstance(path, str | os.PathLike):
        raise ValueError(f"path must be the name of a file, got {reprlib.repr(path)}")
    try:
        path = Path(os.path.realpath(path))
        mode = os.stat(path).st_mode
    except (FileNotFoundError, NotADirectoryError, PermissionError):
        return Path(path)
    except (OSError, ValueError) as error:
        raise OSError(f"cannot use the name {os.fspath(path)!r}: {getattr(error, 'strerror', error)}") from error
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(f"{path} is a folder; name a file")
    if not stat.S_ISREG(mode):
        raise OSError(f"{path} is a device or a pipe, which is neither read nor replaced; name a file")
    return path


def probed(folder: Path, name: str = "probe") -> None:
    """OSError, with what to do about it, where a file of that name cannot be written in a folder."""
    with _temporary(folder / name):
        pass


def unwritable(folder: Path, error: OSError) -> OSError:
    return OSError(
        f"cannot write in {folder}: {error.strerror or error}; choose a folder that exists and can be written"
    )


# ---- tables


@contextmanager
def written_table(path: str | os.PathLike[str], table: "Table", **head: Any) -> Iterator[h5py.File]:
    """An HDF5 file for the class of a table to write its arrays to; what else it tells goes by name.

    It is made in memory and put on disk at the end, in place of an older one: the HDF5 library does not survive a full
    disk.

    Raises
    ------
    OSError
        Where the folder does not exist or cannot be written, or the disk is full.
    """
    about = head_of_table(table.problem, table.method, table.details, table.problem.digest)
    text = json.dumps(about | head, sort_keys=True).encode() + b"\n"
    if len(text) > MOST_TOLD:
        raise ValueError(f"recipe, details and inputs take {len(text):,} bytes as text, and {MOST_TOLD:,} are allowed")
    first = FIRST_LINE.format(FORMAT_VERSION).encode()
    before = len(first) + len("sha256 \n") + 64
    block = max(512, 1 << (before + len(text) - 1).bit_length())  # HDF5 looks for its beginning at powers of two
    with h5py.File("image", "w", driver="core", backing_store=False, block_size=GROWTH, userblock_size=block) as file:
        file["samples"] = table.problem.identity[1]
        yield file
        file.flush()
        image = file.id.get_file_image()
    text = text.ljust(block - before)
    digest = hashlib.sha256(text)
    digest.update(image)
    try:
        with replaced_whole(path) as temporary, open(temporary, "wb") as out:
            for part in (first, f"sha256 {digest.hexdigest()}\n".encode(), text, image):
                out.write(part)
    except OSError as error:
        size = 1e-6 * len(image)
        raise OSError(f"{error}; the table takes {size:.0f} MB, and is still in memory: save it elsewhere") from error


def head_of_table(problem: ReachAvoidProblem, method: str, details: Mapping[str, Any], digest: str) -> dict[str, Any]:
    """What a file says of a table beside its arrays."""
    return {
        "sdhj_version": VERSION,
        "convention": CONVENTION,
        "problem": problem.name,
        "digest": digest,
        "recipe": dict(problem.recipe),
        "method": method,
        "details": dict(details),
        "delta": problem.delta,
        "steps": problem.steps,
        "view_time": problem.view_time,
        "grid": {name: getattr(problem.grid, name) for name in LAYOUT},
        "inputs": problem.inputs.tolist(),
    } | ({"sensing": vars(problem.sensing)} if problem.sensing else {})


def header(path: str | os.PathLike[str]) -> dict[str, Any]:
    """What a file says of its table, without the problem's functions; the arrays are not read.

    Returns
    -------
    dict
        "grid" (a Grid), "sensing" (a Sensing), "inputs" (L, m), "recipe" and "details" (mappings; an own problem has an
        empty recipe), and as they are in the file: "problem", "digest", "method", "delta", "steps", "view_time",
        "sdhj_version".

    Raises
    ------
    OSError
    TableFileError
        As `load`.
    """
    with opened(path) as (head, _):
        return head


def stored(file: h5py.File, name: str, kinds: str, shape: tuple[int | set[int] | None, ...]) -> FloatArray:
    """An array of a file, read once it is what it has to be: numbers of its own, of one of some kinds, of that shape.

    A length of None may be any, one of a set must be in it. What a file can be forged with is refused: links, data in
    other files, text.

    Raises
    ------
    ValueError, MemoryError
    """
    if not isinstance(file.get(name, getlink=True), h5py.HardLink) or file.get(name, getclass=True) != h5py.Dataset:
        raise ValueError(f"it has no array {name} of its own")
    data = file[name]
    plan = data.id.get_create_plist()
    filters = {plan.get_filter(place)[0] for place in range(plan.get_nfilters())}
    if data.is_virtual or data.external is not None or not filters <= FILTERS:
        raise ValueError(f"its array {name} lies in another file or is packed in another way")
    fits = len(data.shape or ()) == len(shape) and all(
        one is None or other in (one if isinstance(one, set) else {one})
        for one, other in zip(shape, data.shape, strict=True)
    )
    if not fits or data.dtype not in map(np.dtype, kinds.split()):
        raise ValueError(f"its array {name} must be {kinds} of shape {shape}, got {data.dtype} of {data.shape}")
    require(data.nbytes, f"the array {name} of the file", "close other programs")
    return data[()]


@contextmanager
def opened(path: str | os.PathLike[str]) -> Iterator[tuple[dict[str, Any], h5py.File]]:
    """What a file tells, as `header` returns it, and its arrays; what fails while it is read is the file's fault."""
    path = _regular(path)
    try:
        stream = open(path, "rb")
    except FileNotFoundError:
        raise FileNotFoundError(f"no file {path}; write one with table.save or `sdhj solve -o {path}`") from None
    except OSError as error:
        raise type(error)(f"cannot read {path}: {error.strerror}; see who may read it") from error
    with stream:
        text = _whole(path, stream)
        try:
            head = checked_head(json.loads(text))
            with h5py.File(stream, "r") as file:
                yield head, file
        except TableFileError:
            raise
        except (OSError, LookupError, ArithmeticError, AttributeError, RuntimeError, ValueError, TypeError) as error:
            raise TableFileError(
                f"{path} is as it was written, but no look-up table that can be read ({error}); solve it anew"
            ) from error


def _whole(path: Path, stream: BufferedReader) -> bytes:
    """What a file tells, as text, once its bytes are known to be those that were written."""
    first = stream.readline(100)
    version = re.fullmatch(re.escape(FIRST_LINE).replace(r"\{\}", "([0-9]{1,9})").encode(), first)
    if version is None and first.startswith(b"\x89HDF"):
        raise TableFileError(
            f"{path} is an HDF5 file that does not begin as a table does: an older sdhj wrote it, or it is no "
            "look-up table; solve it anew"
        )
    if version and int(version[1]) != FORMAT_VERSION:
        raise TableFileError(
            f"{path} has format version {int(version[1])}; this is sdhj {VERSION}, which reads version "
            f"{FORMAT_VERSION}: " + ("upgrade sdhj" if int(version[1]) > FORMAT_VERSION else "solve it anew")
        )
    second = stream.readline(100)
    begin = stream.tell()
    if not version or second != f"sha256 {hashlib.file_digest(stream, 'sha256').hexdigest()}\n".encode():
        raise TableFileError(f"{path} is damaged, cut short or no look-up table; solve it anew")
    stream.seek(begin)
    return stream.readline(MOST_TOLD)


def checked_head(head: Any) -> dict[str, Any]:
    """What a file tells with its numbers checked; what an error is raised for makes no sense."""
    words = ("problem", "digest", "method", "view_time", "sdhj_version")
    if not all(isinstance(head[name], str) for name in words) or not isinstance(head["recipe"], dict):
        raise ValueError(f"{', '.join(words)} must be text, the recipe a mapping")
    inputs = finite_array("inputs", head["inputs"])
    if inputs.ndim != 2:
        raise ValueError(f"inputs must have shape (L, m), got {inputs.shape}")
    return head | {
        "grid": Grid(*(head["grid"][name] for name in LAYOUT)),
        "inputs": inputs,
        "details": dict(head["details"]),
        "delta": number("delta", head["delta"], above=0.0),
        "steps": whole("steps", head["steps"], least=1),
        "sensing": Sensing(**head.get("sensing", {})),
    }


def what_differs(head: Mapping[str, Any], problem: ReachAvoidProblem, same_values: Callable[[], bool]) -> str:
    """What of a problem differs from what a file says, beyond rounding; functions count by their values."""
    pairs = {name: (head[name], getattr(problem, name)) for name in ("delta", "steps", "view_time", "sensing")}
    layout = (name for name in LAYOUT if name != "names")  # which are labels
    pairs |= {name: (getattr(head["grid"], name), getattr(problem.grid, name)) for name in layout}
    if head["recipe"] and problem.recipe:
        pairs["recipe"] = head["recipe"], json.loads(json.dumps(dict(problem.recipe)))
    pairs = {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}
    if not pairs:
        if same_values():
            return ""
        if not np.array_equal(head["inputs"], problem.inputs):
            pairs["inputs"] = head["inputs"].tolist(), problem.inputs.tolist()
    found = [f"{name} is {reprlib.repr(its)} there and {reprlib.repr(own)} here" for name, (its, own) in pairs.items()]
    return "; ".join(found) or "what differs are the values of its functions, by more than rounding"
