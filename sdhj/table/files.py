"""The files of tables, which are written completely or not at all.

A table's file begins with three lines of text: its format and version, the SHA-256 of everything after that line, and
the problem, method and conventions as JSON (the *head* of the file). They are followed by an HDF5 file that contains
only the arrays that the table's class writes. The digest is checked first, so that no damaged bytes reach the HDF5
library. `sdhj.solving.load` chooses the class by the method, and the builder of a case study by its recipe.
"""

import hashlib
import json
import math
import os
import re
import reprlib
import stat
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from io import BufferedReader, BytesIO
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from sdhj.formulas.graph import MOST_TABLES
from sdhj.kernels import FloatArray
from sdhj.problem.checks import finite_array, number, whole
from sdhj.problem.describing import TOLD, arrays_of, described, digest_of
from sdhj.problem.grid import Grid
from sdhj.problem.memory import require_memory
from sdhj.problem.problem import MOST_SAMPLED, ReachAvoidProblem
from sdhj.problem.restoring import problem_from, tables_of, what_differs
from sdhj.problem.sensing import Sensing
from sdhj.problem.statement import LAYOUT
from sdhj.table.batches import Table, entry

TEMPORARIES: set[Path] = set()  # files that are being written
Named = str | os.PathLike[str]
Lengths = tuple[int | set[int], ...]
VERSION = "0.2.0"
FORMAT_VERSION = 5
FIRST_LINE = "sdhj look-up table, format {}\n"
CONVENTION = "a set is where its function is <= 0; union is min, intersection is max"
MOST_HEAD = 1 << 24  # bytes of the head
MOST_PACKED = 1100  # times as large as it is packed an array may be: gzip does not pack closer
MOST_CHUNK = 1 << 24  # numbers that are unpacked at once, or all of the array
PACKING = {"compression": "gzip", "compression_opts": 1, "shuffle": True}  # of large arrays
FILTERS = {h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE}


class TableFileError(ValueError):
    """A file is not a complete look-up table of a supported version, or belongs to another problem.

    Examples
    --------
    >>> import sdhj
    >>> sdhj.load(sdhj.__file__)  # doctest: +ELLIPSIS
    Traceback (most recent call last):
        ...
    sdhj.table.files.TableFileError: ...
    """


# ---- files, complete or absent


@contextmanager
def replaced_whole(path: Named) -> Iterator[Path]:
    """A context with a temporary path, whose file replaces that of `path` at the end unless there is an error.

    No incomplete file is ever visible, not even after a crash: the file is flushed to the disk before it is renamed.
    The suffix, by which writers choose formats, is kept. OSError, with what to do, if nothing can be written there;
    ValueError if `path` is no name.
    """
    path = _regular(path)
    with _temporary(path) as temporary:
        try:
            yield temporary
            with open(temporary, "r+b") as file:
                os.fsync(file.fileno())
            os.replace(temporary, path)
        except OSError as error:
            if error.errno is None or error.filename is not None:  # it has a message already, or concerns another file
                raise
            raise OSError(f"cannot write {path}: {error.strerror}; free some space, or choose another path") from error
        with suppress(OSError):  # not every system opens folders
            folder = os.open(path.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)


@contextmanager
def _temporary(path: Path) -> Iterator[Path]:
    """A context with the path of an empty new file beside `path`, which is deleted at the end if still there.

    Its name is hidden, with the suffix of `path`, and it is in `TEMPORARIES` meanwhile. OSError, with what to do, if it
    cannot be made.
    """
    temporary = path.with_name(f".sdhj-{uuid.uuid4().hex}{path.suffix}")
    TEMPORARIES.add(temporary)
    try:
        try:
            temporary.touch()
        except OSError as error:
            raise unwritable_error(path.parent, error) from error
        yield temporary
    finally:
        with suppress(OSError):
            temporary.unlink()
        TEMPORARIES.discard(temporary)


def writable_file(path: Named) -> Path:
    """The path of a file, links followed, after trying that a file can be written in its folder, which must exist.

    OSError, with what to do, if not; ValueError if `path` is no name. Nothing is left in the folder by trying.
    """
    path = _regular(path)
    require_writable(path.parent, path.name)
    return path


def _regular(path: Named) -> Path:
    """The path that a name refers to, links followed: of a regular file, or of nothing yet.

    ValueError if `path` is no name, OSError if it is that of a folder, a device or a pipe, or cannot be a name.
    """
    if not isinstance(path, str | os.PathLike):
        raise ValueError(f"path must be the name of a file, got {reprlib.repr(path)}")
    try:
        path = Path(os.path.realpath(path))
        mode = os.stat(path).st_mode
    except (FileNotFoundError, NotADirectoryError, PermissionError):
        return Path(path)
    except (OSError, ValueError) as error:
        shown, why = reprlib.repr(os.fspath(path)), getattr(error, "strerror", error)
        raise OSError(f"cannot use the name {shown}: {why}") from error
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(f"{path} is a folder; name a file")
    if not stat.S_ISREG(mode):
        raise OSError(f"{path} is a device or a pipe, which is neither read nor replaced; name a file")
    return path


def require_writable(folder: Path, name: str = "probe") -> None:
    """Raise OSError, with a message that says what to do, if a file cannot be written in a folder.

    An empty file with a hidden name is made there and deleted.

    name : of the file that is to be written; the one that is tried has the same suffix.
    """
    with _temporary(folder / name):
        pass


def unwritable_error(folder: Path, error: OSError) -> OSError:
    """An OSError, which the caller raises, that says that a folder cannot be written, why, and what to do."""
    why = error.strerror or error
    return OSError(f"cannot write in {folder}: {why}; choose a folder that exists and can be written")


# ---- tables


@contextmanager
def written_table(path: Named, table: "Table", **head: Any) -> Iterator[h5py.File]:
    """A context with an open HDF5 file, to which the class of a table writes its arrays; `path` is written at its end.

    The file is built in memory, with the arrays of the problem, and written to disk as a whole in place of an older
    one, because the HDF5 library does not survive a full disk. Nothing is written if the context ends by an error.

    head : further entries of the file's head, plain values (JSON).

    OSError if the file cannot be written; ValueError if the head is too long.
    """
    about = make_head(table.problem, table.method, table.details, table.problem.digest)
    text = json.dumps(about | head, sort_keys=True).encode() + b"\n"
    if len(text) > MOST_HEAD:
        raise ValueError(f"recipe, details and inputs take {len(text):,} bytes as text, and at most {MOST_HEAD:,} fit")
    first = FIRST_LINE.format(FORMAT_VERSION).encode()
    before = len(first) + len("sha256 \n") + 64
    block = max(512, 1 << (before + len(text) - 1).bit_length())  # HDF5 looks for its beginning at powers of two
    image = BytesIO()  # not a file of HDF5's core driver, which two threads could not have open by one name
    with h5py.File(image, "w", userblock_size=block) as file:
        for name, values in arrays_of(table.problem).items():
            file[name] = values
        yield file
    text, arrays = text.ljust(block - before), image.getbuffer()[block:]
    digest = hashlib.sha256(text)
    digest.update(arrays)
    try:
        with replaced_whole(path) as temporary, open(temporary, "wb") as out:
            for part in (first, f"sha256 {digest.hexdigest()}\n".encode(), text, arrays):
                out.write(part)
    except OSError as error:
        size = 1e-6 * len(arrays)
        raise OSError(f"{error}; the table takes {size:.0f} MB and is still in memory: save it elsewhere") from error


def make_head(problem: ReachAvoidProblem, method: str, details: Mapping[str, Any], digest: str) -> dict[str, Any]:
    """The head of a table's file, for JSON: version, method, details, problem and digest; all but the arrays.

    digest : of the problem, `problem.digest`.
    """
    return {
        "sdhj_version": VERSION,
        "convention": CONVENTION,
        "digest": digest,
        "recipe": dict(problem.recipe),
        "method": method,
        "details": dict(details),
    } | described(problem)


def read_head(path: Named) -> dict[str, Any]:
    """The head of a table's file, as `checked_head` returns it; the arrays are not read.

    The errors are those of `sdhj.load`: OSError, TableFileError, MemoryError, and ValueError if `path` is no name.
    """
    with opened_table(path) as (head, _):
        return head


def read_array(file: h5py.File, name: str, kinds: str, shape: Lengths | None, most: int | None = None) -> FloatArray:
    """Read an array of a file, after checking that the file contains it, its dtype and its shape.

    kinds : the names of the allowed dtypes in one string, separated by spaces.
    shape : for each axis the length, or a set of allowed lengths; None allows any shape.
    most : how many bytes the array may have; None: any number.

    ValueError if the array does not fit, and for what forged files may have: links, text, data in other files, or data
    packed closer than sdhj writes them. MemoryError if it does not fit into memory.
    """
    if not isinstance(file.get(name, getlink=True), h5py.HardLink) or file.get(name, getclass=True) != h5py.Dataset:
        raise ValueError(f"it contains no array {name}")
    data = file[name]
    plan = data.id.get_create_plist()
    filters = {plan.get_filter(place)[0] for place in range(plan.get_nfilters())}
    if data.is_virtual or data.external is not None or not filters <= FILTERS:
        raise ValueError(f"its array {name} lies in another file or has another compression")
    if not (shape is None or fits(data.shape or (), shape)) or data.dtype not in map(np.dtype, kinds.split()):
        raise ValueError(f"its array {name} must be {kinds} of shape {shape}, got {data.dtype} of {data.shape}")
    packed = data.nbytes > MOST_PACKED * (data.id.get_storage_size() + 1000)
    if packed or math.prod(data.chunks or ()) > max(data.size, MOST_CHUNK):
        raise ValueError(f"its array {name} of {data.nbytes:,} bytes has too few of them in the file, or large chunks")
    if most is not None and data.nbytes > most:
        raise ValueError(f"its array {name} has {data.nbytes:,} bytes, and at most {most:,} are read")
    require_memory(data.nbytes, f"the array {name} of the file", "close other programs")
    return data[()]


def fits(found: tuple[int, ...], shape: Lengths) -> bool:
    """Whether the shape `found` is allowed: `shape` has for each axis the length, or a set of lengths."""
    allowed = [one if isinstance(one, set) else {one} for one in shape]
    return len(found) == len(allowed) and all(n in some for n, some in zip(found, allowed, strict=True))


@contextmanager
def opened_table(path: Named) -> Iterator[tuple[dict[str, Any], h5py.File]]:
    """A context with the head of a table's file, as `checked_head` returns it, and its HDF5 file, open for reading.

    The digest of the file is checked before anything else is read. FileNotFoundError or OSError if it cannot be read,
    MemoryError if its arrays do not fit; whatever else goes wrong, also inside the context, becomes a TableFileError.
    """
    path = _regular(path)
    try:
        stream = open(path, "rb")
    except FileNotFoundError:
        raise FileNotFoundError(f"no file {path}; write one with table.save or `sdhj solve -o {path}`") from None
    except OSError as error:
        raise type(error)(f"cannot read {path}: {error.strerror}; check the permissions") from error
    with stream:
        text = _head_text(path, stream)
        try:
            head = checked_head(json.loads(text))
            with h5py.File(stream, "r") as file:
                _require_memory(file)
                yield head, file
        except TableFileError:
            raise
        except (OSError, LookupError, ArithmeticError, AttributeError, RuntimeError, ValueError, TypeError) as error:
            raise TableFileError(
                f"{path} is undamaged, but not a look-up table that can be read ({error}); solve it anew"
            ) from error


def _require_memory(file: h5py.File) -> None:
    """Raise MemoryError, before anything is read, where all arrays of a file together do not fit into memory."""
    needed: list[int] = []
    file.visititems(lambda name, one: needed.append(one.nbytes if isinstance(one, h5py.Dataset) else 0))
    require_memory(sum(needed), "all that is in the file", "close other programs, or use a machine with more memory")


def require_entries(head: Mapping[str, Any], file: h5py.File) -> None:
    """Check that the index of a file has as many entries as its steps take, before anything is made for so many.

    head : as `checked_head` returns it. ValueError if it has not.
    """
    one = file["index"] if isinstance(file.get("index", getlink=True), h5py.HardLink) else None
    shape, steps = getattr(one, "shape", None) or (0,), head["steps"]
    if shape[0] not in (allowed := {1, steps + 1, entry(steps, steps, 0) + 1}):
        raise ValueError(f"its array index must have {' or '.join(map(str, sorted(allowed)))} entries, got {shape[0]}")


def _head_text(path: Path, stream: BufferedReader) -> bytes:
    """The head of a file, as JSON text, after checking that the file's bytes are those that were written.

    stream : the file at its beginning; it is read to its end for this. TableFileError for another version or a wrong
        digest.
    """
    first = stream.readline(100)
    version = re.fullmatch(re.escape(FIRST_LINE).replace(r"\{\}", "([0-9]{1,9})").encode(), first)
    if version and int(version[1]) != FORMAT_VERSION:
        raise TableFileError(
            f"{path} has format version {int(version[1])}; this is sdhj {VERSION}, which reads version "
            f"{FORMAT_VERSION}: " + ("upgrade sdhj" if int(version[1]) > FORMAT_VERSION else "solve it anew")
        )
    second = stream.readline(100)
    begin = stream.tell()
    if not version or second != f"sha256 {hashlib.file_digest(stream, 'sha256').hexdigest()}\n".encode():
        raise TableFileError(f"{path} is damaged, cut short or not a look-up table; solve it anew")
    stream.seek(begin)
    return stream.readline(MOST_HEAD)


def checked_head(head: Any) -> dict[str, Any]:
    """A copy of the head of a file, given as JSON gives it, with its values checked and converted.

    "grid" becomes a Grid, "sensing" a Sensing, "inputs" an array (L, m). "recipe" is a dict, empty unless a case study
    built the problem. "told" is added: the head's own entries on the problem, unconverted, of which "digest" is the
    digest. If the head is invalid, one of various errors is raised (KeyError, TypeError, ValueError, ...), which
    `opened_table` turns into TableFileError.
    """
    words = ("problem", "digest", "method", "view_time", "sdhj_version")
    if not all(isinstance(head[name], str) for name in words) or not isinstance(head["recipe"], dict):
        raise ValueError(f"{', '.join(words)} must be text, the recipe a mapping")
    inputs = finite_array("inputs", head["inputs"])
    if inputs.ndim != 2:
        raise ValueError(f"inputs must have shape (L, m), got {inputs.shape}")
    return head | {
        "told": {name: head[name] for name in TOLD},
        "grid": Grid(*(head["grid"][name] for name in LAYOUT)),
        "inputs": inputs,
        "details": dict(head["details"]),
        "delta": number("delta", head["delta"], above=0.0),
        "steps": whole("steps", head["steps"], least=1, most=MOST_SAMPLED),
        "sensing": Sensing(**{"memory": False} | head["sensing"]) if head["sensing"] else Sensing(),
        "sets": list(head["sets"]),
        "formulas": {**head["formulas"], "opaque": dict(head["formulas"]["opaque"])},
    }


def arrays_in(file: h5py.File) -> dict[str, FloatArray]:
    """The arrays that formulas look up, and the values of black boxes, in a file, by names such as "tables/0".

    ValueError if what has the name of a group is no group, if an array is not float64, or if those of a group take more
    than `MOST_TABLES` bytes.
    """
    found: dict[str, FloatArray] = {}
    for group in ("tables", "opaque"):
        if file.get(group, getlink=True) is None:
            continue
        if not isinstance(file.get(group, getlink=True), h5py.HardLink) or file.get(group, getclass=True) != h5py.Group:
            raise ValueError(f"its {group} are no group of arrays")
        left = MOST_TABLES
        for name in (f"{group}/{one}" for one in file[group]):
            found[name] = read_array(file, name, "float64", None, left)
            left -= found[name].nbytes
    return found


def problem_of_file(
    path: Named, head: Mapping[str, Any], arrays: Mapping[str, FloatArray], problem: ReachAvoidProblem | None
) -> ReachAvoidProblem:
    """The problem that the head and the arrays of a file describe; or `problem`, if it is given and is the same.

    The file itself is not opened: `path` is only for messages. The head must have been checked (`checked_head`).

    arrays : what the file's formulas look up, and values of black boxes, by name, as `arrays_in` returns them for a
        file, and `sdhj.table.store.functions_of` for a store.
    problem : None, or the problem that the file should be of. If it has steps=None, and the file is of such a solve, it
        is returned with the number of steps of the file.

    TableFileError if `problem` is another one, if it is None and the file has black boxes or cannot be read, or if the
    digest in the head is not that of what the head and the arrays describe.
    """
    if head["digest"] != (found := digest_of(head["told"], arrays)):
        raise TableFileError(
            f"{path} was changed after it was written: its head names the problem {head['digest'][:12]}..., and what "
            f"it describes is {found[:12]}...; solve it anew"
        )
    if problem is None:
        try:
            return problem_from(head, tables_of(arrays))
        except (ValueError, KeyError, TypeError, AttributeError, IndexError) as error:
            raise TableFileError(f"the problem of {path} cannot be read: {error}") from error
    if problem.steps is None and head["details"].get("endless"):
        problem = replace(problem, steps=head["steps"])  # as many as it took
    if problem.digest != head["digest"] and (other := what_differs(head, arrays, problem)):
        raise TableFileError(
            f"{path} was solved for another problem: its digest is {head['digest'][:12]}..., that of "
            f"{problem.name!r} is {problem.digest[:12]}...; {other}"
        )
    return problem
