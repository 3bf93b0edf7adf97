"""Reading tables of any method from their files."""

import json
import os
import reprlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

import sdhj
from sdhj.arm.case_studies import rebuild
from sdhj.certified.table import CertifiedTable
from sdhj.grid import Grid
from sdhj.problem import ReachAvoidProblem
from sdhj.table import FORMAT, FORMAT_VERSION, LookupTable, TableFileError

_LAYOUT = ("lower", "upper", "shape", "periodic", "names")


def load(path: str | os.PathLike[str], *, problem: ReachAvoidProblem | None = None) -> LookupTable:
    """Read a table that `LookupTable.save` wrote.

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
        Where the file is damaged, cut short, of another kind or of a newer version, or the problem is not the one it
        was solved for.
    """
    path = Path(path)
    with _opened(path) as file:
        return _read(file, path, problem)


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
    path = Path(path)
    with _opened(path) as file:
        attrs, layout = file.attrs, file["grid"].attrs
        told = {name: attrs[name] for name in ("problem", "digest", "method", "view_time", "sdhj_version")}
        fields = [np.asarray(layout[name]).tolist() for name in _LAYOUT]
        return told | {
            "grid": Grid(*fields),
            "inputs": file["inputs"][()],
            "recipe": dict(json.loads(attrs["recipe"])),
            "details": dict(json.loads(attrs["details"])),
            "delta": float(attrs["delta"]),
            "steps": int(attrs["steps"]),
        }


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
            if attrs["format_version"] > FORMAT_VERSION:
                raise TableFileError(
                    f"{path} has format version {attrs['format_version']}, written by sdhj {attrs['sdhj_version']}; "
                    f"this is sdhj {sdhj.__version__}, which reads up to version {FORMAT_VERSION}: upgrade sdhj"
                )
            yield file
    except TableFileError:
        raise
    except (OSError, LookupError, ArithmeticError, AttributeError, RuntimeError, ValueError, TypeError) as error:
        raise TableFileError(f"{path} is damaged, cut short or no look-up table ({error}); solve it anew") from error


def _read(file: h5py.File, path: Path, problem: ReachAvoidProblem | None) -> LookupTable:
    attrs = file.attrs
    if problem is None:
        recipe = json.loads(attrs["recipe"])
        if not recipe:
            raise TableFileError(
                f"{path} was solved for your own problem {attrs['problem']!r}: give it as load(path, problem=...)"
            )
        problem = rebuild(recipe)
    if problem.digest != (digest := str(attrs["digest"])):
        raise TableFileError(
            f"{path} was solved for another problem: its digest is {digest[:12]}..., that of "
            f"{problem.name!r} is {problem.digest[:12]}...; {_differences(file, problem)}"
        )
    if attrs["method"] == CertifiedTable.method:
        return CertifiedTable.read(file, path, problem)  # type: ignore[return-value]  # the same interface
    return LookupTable.read(file, path, problem)


def _differences(file: h5py.File, problem: ReachAvoidProblem) -> str:
    """What of a problem is not as the file says; its functions are known by their values alone."""
    grid, layout = problem.grid, file["grid"].attrs
    told = {name: (file.attrs[name], getattr(problem, name)) for name in ("delta", "steps", "view_time")}
    told |= {name: (np.asarray(layout[name]).tolist(), list(getattr(grid, name))) for name in _LAYOUT}
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
