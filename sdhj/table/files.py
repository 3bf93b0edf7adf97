"""The files of tables, which are written completely or not at all.

A table's file, or folder, holds the arrays that the table's class writes and, as its head, the problem, method and
conventions (`sdhj.table.container`). `sdhj.solving.load` chooses the class by the method, and the builder of a case
study by its recipe.
"""

import os
import re
import reprlib
import stat
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from sdhj.common.checks import finite_array, number, whole
from sdhj.common.remembering import FloatArray
from sdhj.formulas.graph import MOST_TABLES
from sdhj.problem.describing import LAYOUT, TOLD, arrays_of, described, digest_of
from sdhj.problem.grid import Grid
from sdhj.problem.problem import MOST_SAMPLED, ReachAvoidProblem
from sdhj.problem.restoring import problem_from, tables_of, what_differs
from sdhj.problem.sensing import Sensing
from sdhj.table.batches import Table, entry
from sdhj.table.container import CHECKED, FORMAT, HEAD, Contents, Damaged, head_text, stated_in, write_zip

TEMPORARIES: set[Path] = set()  # files that are being written; `sdhj.cli` deletes them where a signal ends it
Named = str | os.PathLike[str]
Lengths = tuple[int | set[int], ...]
VERSION = "0.2.0"
CONVENTION = "a set is where its function is <= 0; union is min, intersection is max"


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
    """A context with a temporary path, whose file replaces that of `path` at the end unless there is an error."""
    path = _regular_path(path)
    with _temporary(path) as temporary:
        try:
            yield temporary
            # on the disk before it gets its name: or a crash may leave an empty file there
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
    """A context with the path of an empty new file beside `path`, which is deleted at the end if still there."""
    # hidden, and with the suffix of `path`, by which writers choose formats
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
    """The path of a file, links followed, that can be written."""
    path = _regular_path(path)
    require_writable(path.parent, path.name)
    return path


def _regular_path(path: Named) -> Path:
    """The path of a regular file, or of nothing yet, links followed; else OSError."""
    if not isinstance(path, str | os.PathLike):
        raise ValueError(f"path must be the name of a file, got {reprlib.repr(path)}")
    try:
        # of a link the file that it names: `os.replace` would put a new file in place of the link
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
    """Raise OSError, which says what to do, if a file cannot be written in a folder."""
    with _temporary(folder / name):
        pass


def unwritable_error(folder: Path, error: OSError) -> OSError:
    """An OSError that says that a folder cannot be written, why, and what to do."""
    why = error.strerror or error
    return OSError(f"cannot write in {folder}: {why}; choose a folder that exists and can be written")


# ---- tables


def write_table(path: Named, table: Table, arrays: Mapping[str, FloatArray], compress: bool, **head: Any) -> None:
    """Write a table with these arrays, those of its problem, and `head` besides, in place of an older file."""
    if not isinstance(compress, bool):
        raise ValueError(f"compress must be True or False, got {reprlib.repr(compress)}")
    about = make_head(table.problem, table.method, table.details, table.problem.digest)
    # black boxes are called here: a file keeps some of their values
    arrays = dict(arrays) | arrays_of(table.problem)
    try:
        with replaced_whole(path) as temporary, open(temporary, "wb") as out:
            write_zip(out, about | head, arrays, compress)
    except OSError as error:
        size = 1e-6 * sum(one.nbytes for one in arrays.values())
        raise OSError(f"{error}; the table takes {size:.0f} MB and is still in memory: save it elsewhere") from error


def finish_folder(folder: Path, head: Mapping[str, Any], shapes: Mapping[str, tuple[str, tuple[int, ...]]]) -> None:
    """Make a folder of arrays a table: it gets its problem.json, last of all."""
    text = head_text(head, stated_in(folder, shapes))  # files that were begun longer are cut
    with replaced_whole(folder / HEAD) as temporary:
        temporary.write_bytes(text)


def make_head(problem: ReachAvoidProblem, method: str, details: Mapping[str, Any], digest: str) -> dict[str, Any]:
    """The head of a table's file, for JSON: all that the file says besides its arrays."""
    # files keep these names, and `begun.json` too; `checked_head` and the checker read them
    return {
        "sdhj_version": VERSION,
        "convention": CONVENTION,
        "digest": digest,
        "recipe": dict(problem.recipe),
        "method": method,
        "details": dict(details),
    } | described(problem)


def read_head(path: Named) -> dict[str, Any]:
    """The head of a table's file; the errors are those of `sdhj.load`."""
    with opened_table(path) as (head, _):
        return head


def read_array(file: Contents, name: str, kinds: str, shape: Lengths | None, most: int | None = None) -> FloatArray:
    """An array of a file if it has one of the dtypes `kinds`, this shape, and at most `most` bytes."""
    one = file.stated.get(name)
    if one is None:
        raise ValueError(f"it contains no array {name}")
    if not (shape is None or fits(one.shape, shape)) or one.kind not in kinds.split():
        raise ValueError(f"its array {name} must be {kinds} of shape {shape}, got {one.kind} of {one.shape}")
    if most is not None and one.nbytes > most:
        raise ValueError(f"its array {name} has {one.nbytes:,} bytes, and at most {most:,} are read")
    # only now it is read, or unpacked
    return file.array(name)


def fits(found: tuple[int, ...], shape: Lengths) -> bool:
    """Whether a shape is allowed: `shape` has for each axis the length, or a set of lengths."""
    allowed = [one if isinstance(one, set) else {one} for one in shape]
    return len(found) == len(allowed) and all(n in some for n, some in zip(found, allowed, strict=True))


@contextmanager
def opened_table(path: Named, check: bool | None = None) -> Iterator[tuple[dict[str, Any], Contents]]:
    """A context with the checked head of a table's file or folder, and its arrays.

    Whatever goes wrong, also inside, becomes one of the errors that `sdhj.load` promises.
    """
    path = _table_path(path)
    if not isinstance(check, bool | None):
        raise ValueError(f"check must be True, False or None, got {reprlib.repr(check)}")
    try:
        file = Contents(path)
        if check or (check is None and file.nbytes < CHECKED):  # the arrays' digests
            file.check()
        yield checked_head(file.head), file
    except TableFileError:
        raise
    # a ValueError too, as is `TableFileError`: so both come before the last clause
    except Damaged as error:
        raise TableFileError(_no_table(path)) from error
    except FileNotFoundError:
        if path.is_dir():
            raise TableFileError(_no_table(path)) from None
        raise FileNotFoundError(f"no file {path}; write one with table.save or `sdhj solve -o {path}`") from None
    except PermissionError as error:
        raise type(error)(f"cannot read {path}: {error.strerror}; check the permissions") from error
    except (OSError, LookupError, ArithmeticError, AttributeError, RuntimeError, ValueError, TypeError) as error:
        raise TableFileError(
            f"{path} is undamaged, but not a look-up table that can be read ({error}); solve it anew"
        ) from error


def _table_path(path: Named) -> Path:
    """The path of a file or a folder that a name refers to, links followed."""
    try:
        return _regular_path(path)
    except IsADirectoryError:
        return Path(os.path.realpath(path))


def _no_table(path: Path) -> str:
    """Why a file or a folder is no table, by its first bytes, and what to do."""
    file, begin = path / HEAD if path.is_dir() else path, b""
    # What cannot be read is told as damaged, at the end.
    with suppress(OSError), open(file, "rb") as stream:
        begin = stream.read(400)
    if begin.startswith((b"\x89HDF", b"sdhj look-up table, format")):
        return f"{path} is an HDF5 file, of an earlier sdhj, and sdhj {VERSION} reads NumPy's arrays; solve it anew"
    version = re.search(rb'\{"format": ([0-9]{1,9}), "sha256": ', begin)
    if version and int(version[1]) != FORMAT:
        what = "upgrade sdhj" if int(version[1]) > FORMAT else "solve it anew"
        return f"{path} has format version {int(version[1])}; this is sdhj {VERSION}, which reads {FORMAT}: {what}"
    if path.is_dir() and not begin:
        return f"{path} is a folder without {HEAD}: name the file or folder of a table, or solve on with resume=True"
    return f"{path} is damaged, cut short or not a look-up table; solve it anew"


def require_entries(head: Mapping[str, Any], file: Contents) -> None:
    """Check that a file's index has as many entries as its steps take, before anything is made for so many."""
    shape, steps = (file.stated["index"].shape if "index" in file.stated else ()) or (0,), head["steps"]
    if shape[0] not in (allowed := {1, steps + 1, entry(steps, steps, 0) + 1}):
        raise ValueError(f"its array index must have {' or '.join(map(str, sorted(allowed)))} entries, got {shape[0]}")


def checked_head(head: Any) -> dict[str, Any]:
    """A copy of the head with its values checked and converted: `Grid`, `Sensing`, inputs (L, m)."""
    # what does not fit raises errors of many kinds, which `opened_table` translates
    words = ("problem", "digest", "method", "view_time", "sdhj_version")
    if not all(isinstance(head[name], str) for name in words) or not isinstance(head["recipe"], dict):
        raise ValueError(f"{', '.join(words)} must be text, the recipe a mapping")
    inputs = finite_array("inputs", head["inputs"])
    if inputs.ndim != 2:
        raise ValueError(f"inputs must have shape (L, m), got {inputs.shape}")
    return head | {
        "told": {name: head[name] for name in TOLD},  # unconverted: of these the digest is
        "grid": Grid(*(head["grid"][name] for name in LAYOUT)),
        "inputs": inputs,
        "details": dict(head["details"]),
        "delta": number("delta", head["delta"], above=0.0),
        "steps": whole("steps", head["steps"], least=1, most=MOST_SAMPLED),
        # files that say nothing of a memory were solved without one
        "sensing": Sensing(**{"memory": False} | head["sensing"]) if head["sensing"] else Sensing(),
        "sets": list(head["sets"]),
        "formulas": {**head["formulas"], "opaque": dict(head["formulas"]["opaque"])},
    }


def arrays_in(file: Contents) -> dict[str, FloatArray]:
    """The arrays of formulas and of black boxes in a file, by names such as "tables/0"."""
    found: dict[str, FloatArray] = {}
    for group in ("tables/", "opaque/"):
        # together they may take as much as the tables of a problem
        left = MOST_TABLES
        for name in (one for one in file.stated if one.startswith(group)):
            found[name] = read_array(file, name, "float64", None, left)
            left -= found[name].nbytes
    return found


def problem_of_file(
    path: Named, head: Mapping[str, Any], arrays: Mapping[str, FloatArray], problem: ReachAvoidProblem | None
) -> ReachAvoidProblem:
    """The problem that head and arrays describe, or `problem`, if it is given and the same."""
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


# ---- tables of files


class Origin:
    """The file or folder that a table's arrays are mapped from, as which it is pickled."""

    def __init__(self, path: Path, sha256: str) -> None:
        self.path, self.sha256 = Path(os.path.abspath(path)), sha256

    def reduced(self, table: Any) -> Any:
        """How pickle makes the table again: from the file, and the problem if it has black boxes."""
        try:
            unchanged = Contents(self.path).sha256 == self.sha256
        except (OSError, ValueError, LookupError, TypeError):
            unchanged = False
        # with None `Table.__reduce_ex__` pickles the arrays themselves
        opaque = table.problem if table.problem.opaque else None
        return (reopened, (type(table), self.path, self.sha256, opaque, table.player)) if unchanged else None


def table_in(
    kind: Any, path: Named, head: dict[str, Any], file: Contents, problem: ReachAvoidProblem | None, player: Any
) -> Any:
    """The table of a class in an open file; errors as from `sdhj.load`."""
    require_entries(head, file)
    # what was packed lies in memory, so there is no file as which the table could be pickled
    packed = any(one.packed for one in file.stated.values())
    fields = {"player": player, "mapped_from": None if packed else Origin(file.path, file.sha256)}
    return kind.read(head, file, problem_of_file(path, head, arrays_in(file), problem), **fields)


def reopened(kind: Any, path: Path, sha256: str, problem: ReachAvoidProblem | None, player: Any) -> Any:
    """The table that was pickled as the name of its file, unless that has another content now."""
    # pickles have this function's name and arguments in order: renamed, those made before do not load
    with opened_table(path) as (head, file):
        if file.sha256 != sha256:
            raise TableFileError(f"{path} has changed since the table was pickled as its name; load it anew")
        return table_in(kind, path, head, file, problem, player)
