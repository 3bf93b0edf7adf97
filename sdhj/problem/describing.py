"""A problem as plain numbers, text and arrays: what files and digests say of it."""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from sdhj.common.remembering import FloatArray
from sdhj.formulas.text import FORMAT
from sdhj.problem.vector_field import CUTS

LAYOUT = ("lower", "upper", "shape", "periodic", "names", "ends")  # of a grid, as it stands in a file
VALUES_KEPT = 1000  # values of a black box that a file keeps
BOX_STEPS = 4  # times among them
TOLD = ("problem", "delta", "steps", "view_time", "grid", "inputs", "sensing", "sets", "formulas")  # in a file


def described(problem: Any) -> dict[str, Any]:
    """The problem as plain numbers, lists and text (JSON), for the head of a file."""
    # Stands in every file, where `restoring` and the checker read it: another entry is another format.
    functions = {}
    for name, lines in problem.texts[0].items():
        one: Any = problem.functions[name]
        functions[name] = {"coordinates": one.coordinates, "parameters": one.parameters, "lines": lines}
    formulas = {"format": FORMAT, "functions": functions, "opaque": problem.opaque}
    if problem.dynamics.is_cut and problem.dynamics.pieces != CUTS:
        formulas["pieces"] = problem.dynamics.pieces
    return problem.numbers | {"problem": problem.name, "formulas": formulas}


def arrays_of(problem: Any) -> dict[str, FloatArray]:
    """The arrays of a description, by a file's names: tables of formulas, and values of black boxes, called anew."""
    tables = {f"tables/{number}": table.values for number, table in enumerate(problem.texts[1])}
    return tables | {f"opaque/{name}": blackbox_values(problem, name) for name in problem.opaque}


def digest_of(head: Mapping[str, Any], arrays: Mapping[str, FloatArray]) -> str:
    """SHA-256 of a description's entries `TOLD` and its arrays: problems that share it have one table."""
    # Files name it, and are refused where it differs: computed otherwise, it refuses all that were written before.
    said: dict[str, Any] = {name: head[name] for name in TOLD}
    if "error" in said["sensing"]:  # one for all axes is the same as one given for each
        error = np.broadcast_to(said["sensing"]["error"], len(said["grid"]["shape"])).tolist()
        said["sensing"] = said["sensing"] | {"error": error}
    hashed = {}
    for name, values in arrays.items():
        numbers: Any = np.ascontiguousarray(values, "<f8")
        hashed[name] = [list(values.shape), hashlib.sha256(numbers).hexdigest()]
    return hashlib.sha256(json.dumps([said, hashed], sort_keys=True).encode()).hexdigest()


def blackbox_values(problem: Any, name: str) -> FloatArray:
    """Values of a black box at seeded states and times: by them a file tells it from another function."""
    # Files keep the values: with another seed, number or order none would be of the black box that it was made with.
    function, grid, rng = problem.black_box(name), problem.grid, np.random.default_rng(0)
    if name.startswith(("unsafe", "target", "swept")):
        part = problem.target if name == "target" else problem.unsafe[int(name.split()[1])]
        grid = grid.subgrid(part.axes)
    states, found = rng.uniform(grid.lower, grid.upper, (VALUES_KEPT // BOX_STEPS, grid.ndim)), []
    for step in range(BOX_STEPS):
        t = step * problem.delta * problem.most_steps / BOX_STEPS
        # a drift or gain under another input each time, `swept` over one interval
        given: tuple[Any, ...] = (problem.inputs[step % len(problem.inputs)], t) if name in ("drift", "gain") else (t,)
        given = (t, t + problem.delta) if name.startswith("swept") else given
        found.append(function(states, *given).ravel())
    return np.concatenate(found)
