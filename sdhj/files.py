"""Files: written whole or not at all, and what a table's file says of itself.

A table is an HDF5 file that describes itself: problem, method and conventions in attributes, the arrays as the class of
its table writes them. `load` finds that class by the method, and the builder of a case study by its recipe, as names:
nothing of theirs is imported before a file asks for it.
"""

import hashlib
import importlib
import json
import os
import reprlib
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

import sdhj
from sdhj.grid import FloatArray, Grid
from sdhj.problem import ReachAvoidProblem
from sdhj.sensing import Sensing

if TYPE_CHECKING:
    from sdhj.table import Table

FORMAT = "sdhj look-up table"
FORMAT_VERSION = 2
CONVENTION = "a set is where its function is <= 0; union is min, intersection is max"
LAYOUT = ("lower", "upper", "shape", "periodic", "names", "ends")
GROWTH = 1 << 24  # bytes by which a file grows in memory
PACKING = {"compression": "gzip", "compression_opts": 1, "shuffle": True}  # of large arrays
TABLES = {"certified": "sdhj.certified.table:CertifiedTable"}  # by the method, of tables that are no LookupTable
RECIPES = dict.fromkeys(("arm_case_study", "evader_case_study"), "sdhj.arm.case_studies:rebuild")  # by the builder


class TableFileError(ValueError):
    """A file that is not a whole look-up table of a known version."""


@contextmanager
def replaced_whole(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A path beside `path` to write to; what stands there takes the name at the end, or is gone after an error.

    Nobody ever sees half a file. The suffix is kept, from which writers tell the format.

    Raises
    ------
    OSError
        Where nothing can be written there, with what to do about it.
    """
    path = _regular(path)
    temporary = path.with_name(f".{path.stem}-{uuid.uuid4().hex}{path.suffix}")
    try:
        temporary.touch()
    except OSError as error:
        raise unwritable(path.parent, error) from error
    try:
        yield temporary
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def writable_file(path: str | os.PathLike[str]) -> Path:
    """The path of a file that can be written; its folder must exist.

    Raises
    ------
    OSError
        Where it cannot be written, with what to do about it.
    """
    path = _regular(path)
    probed(path.parent)
    return path


def _regular(path: str | os.PathLike[str]) -> Path:
    """The file that a name stands for, links followed; OSError where something else than a file has that name."""
    path = Path(os.path.realpath(path))
    if path.is_dir():
        raise OSError(f"{path} is a folder; name a file")
    if path.exists() and not path.is_file():
        raise OSError(f"{path} is a device or a pipe, which would be replaced; name a file")
    return path


def probed(folder: Path) -> None:
    probe = folder / f".sdhj-{uuid.uuid4().hex}"
    try:
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise unwritable(folder, error) from error


def unwritable(folder: Path, error: OSError) -> OSError:
    return OSError(
        f"cannot write in {folder}: {error.strerror or error}; choose a folder that exists and can be written"
    )


@contextmanager
def written_table(path: str | os.PathLike[str], table: "Table") -> Iterator[h5py.File]:
    """An HDF5 file that says what table it is of, for its class to write the arrays to.

    It is made in memory and put on disk at the end, in place of an older one: the HDF5 library does not survive a full
    disk.

    Raises
    ------
    OSError
        Where the folder does not exist or cannot be written, or the disk is full.
    """
    with h5py.File("image", "w", driver="core", backing_store=False, block_size=GROWTH) as file:
        _write_header(file, table)
        yield file
        file.flush()
        image = file.id.get_file_image()
    with replaced_whole(path) as temporary:
        try:
            temporary.write_bytes(image)
        except OSError as error:
            raise OSError(f"cannot write {path}: {error.strerror}; free {len(image) / 1e6:.0f} MB") from error


def _write_header(file: h5py.File, table: "Table") -> None:
    problem = table.problem
    file.attrs.update(
        format=FORMAT,
        format_version=FORMAT_VERSION,
        sdhj_version=sdhj.__version__,
        convention=CONVENTION,
        problem=problem.name,
        digest=problem.digest,
        recipe=json.dumps(dict(problem.recipe), sort_keys=True),
        method=table.method,
        details=json.dumps(dict(table.details), sort_keys=True),
        delta=problem.delta,
        steps=problem.steps,
        view_time=problem.view_time,
        sensing=json.dumps(vars(problem.sensing)),
    )
    file.create_group("grid").attrs.update({name: getattr(problem.grid, name) for name in LAYOUT})
    file["inputs"] = problem.inputs


def checksum(told: Any, *arrays: FloatArray) -> str:
    """SHA-256 of what JSON can tell and of arrays, hexadecimal."""
    h = hashlib.sha256(json.dumps(told, sort_keys=True).encode())
    for array in arrays:
        h.update(repr((array.dtype.str, array.shape)).encode())
        h.update(np.ascontiguousarray(array).data)
    return h.hexdigest()


def header(path: str | os.PathLike[str]) -> dict[str, Any]:
    """What a file says of its table, without the problem's functions; the arrays are not read.

    Returns
    -------
    dict
        "grid" (a Grid), "inputs" (L, m), "recipe" and "details" (mappings; an own problem has an empty recipe), and as
        they are in the file: "problem", "digest", "method", "delta", "steps", "view_time", "sdhj_version".

    Raises
    ------
    FileNotFoundError
    TableFileError
        As `load`.
    """
    with _opened(Path(path)) as file:
        attrs, layout = file.attrs, file["grid"].attrs
        told = {name: attrs[name] for name in ("problem", "digest", "method", "view_time", "sdhj_version")}
        fields = [np.asarray(layout[name]).tolist() for name in LAYOUT]
        return told | {
            "grid": Grid(*fields),
            "inputs": file["inputs"][()],
            "recipe": dict(json.loads(attrs["recipe"])),
            "details": dict(json.loads(attrs["details"])),
            "delta": float(attrs["delta"]),
            "steps": int(attrs["steps"]),
        }


def load(path: str | os.PathLike[str], *, problem: ReachAvoidProblem | None = None) -> "Table":
    """Read a table of any method that its `save` wrote.

    Parameters
    ----------
    path : path
    problem : ReachAvoidProblem, optional
        The problem the table was solved for. The case studies are rebuilt from the file; your own problem holds
        functions that no file can hold, so give it here. It must have the digest that the file records.

    Raises
    ------
    FileNotFoundError
    TableFileError
        Where the file is damaged, cut short, of another kind or of another version, or the problem is not the one it
        was solved for.
    """
    path = Path(path)
    with _opened(path) as file:
        attrs = file.attrs
        if problem is None:
            recipe = json.loads(attrs["recipe"])
            if (rebuild := RECIPES.get(recipe.get("builder"))) is None:
                raise TableFileError(
                    f"{path} was solved for your own problem {attrs['problem']!r}: give it as load(path, problem=...)"
                )
            problem = imported(rebuild)(recipe)
            sensing = Sensing(**json.loads(attrs.get("sensing", "{}")))
            problem = replace(problem, sensing=sensing) if sensing else problem
        if problem.digest != (digest := str(attrs["digest"])):
            raise TableFileError(
                f"{path} was solved for another problem: its digest is {digest[:12]}..., that of "
                f"{problem.name!r} is {problem.digest[:12]}...; {_what_differs(file, problem)}"
            )
        return imported(TABLES.get(attrs["method"], "sdhj.table:LookupTable")).read(file, problem)


def imported(name: str) -> Any:
    """What "module:attribute" names."""
    module, attribute = name.split(":")
    return getattr(importlib.import_module(module), attribute)


@contextmanager
def _opened(path: Path) -> Iterator[h5py.File]:
    """The file, where it is a table of a known version; whatever else fails while it is read is damage to it."""
    if not path.is_file():
        raise FileNotFoundError(f"no file {path}; write one with table.save or `sdhj solve -o {path}`")
    try:
        with h5py.File(path, "r") as file:
            attrs = file.attrs
            if attrs.get("format") != FORMAT:
                raise TableFileError(f"{path} is an HDF5 file but no look-up table of sdhj")
            if (version := attrs["format_version"]) != FORMAT_VERSION:
                raise TableFileError(
                    f"{path} has format version {version}, written by sdhj {attrs['sdhj_version']}; this is sdhj "
                    f"{sdhj.__version__}, which reads version {FORMAT_VERSION}: "
                    + ("upgrade sdhj" if version > FORMAT_VERSION else "solve it anew")
                )
            yield file
    except TableFileError:
        raise
    except (OSError, LookupError, ArithmeticError, AttributeError, RuntimeError, ValueError, TypeError) as error:
        raise TableFileError(f"{path} is damaged, cut short or no look-up table ({error}); solve it anew") from error


def _what_differs(file: h5py.File, problem: ReachAvoidProblem) -> str:
    """What of a problem is not as the file says; its functions are known by their values alone."""
    grid, layout = problem.grid, file["grid"].attrs
    told = {name: (file.attrs[name], getattr(problem, name)) for name in ("delta", "steps", "view_time")}
    told |= {name: (np.asarray(layout[name]).tolist(), np.asarray(getattr(grid, name)).tolist()) for name in LAYOUT}
    told["sensing"] = file.attrs.get("sensing", json.dumps(vars(Sensing()))), json.dumps(vars(problem.sensing))
    told["inputs"] = file["inputs"][()].tolist(), problem.inputs.tolist()
    found = [
        f"{name} is {reprlib.repr(its)} there and {reprlib.repr(own)} here"
        for name, (its, own) in told.items()
        if its != own
    ]
    if found:
        return "; ".join(found)
    return (
        "what differs are the values of its functions, to the last bit: use those it was solved with, or solve it anew"
    )
