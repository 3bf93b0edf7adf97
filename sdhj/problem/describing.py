"""A problem as plain numbers, text and arrays: what files and digests say of it."""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from sdhj.formulas.text import FORMAT
from sdhj.kernels import FloatArray
from sdhj.problem.dynamics import CUTS

LAYOUT = ("lower", "upper", "shape", "periodic", "names", "ends")  # of a grid, as it stands in a file
VALUES_KEPT = 1000  # values of a black box that a file keeps
BOX_STEPS = 4  # times among them
TOLD = ("problem", "delta", "steps", "view_time", "grid", "inputs", "sensing", "sets", "formulas")  # in a file


def described(problem: Any) -> dict[str, Any]:
    """The problem as plain numbers, lists and text (JSON), for the head of a file.

    The entries of `ReachAvoidProblem.numbers`; "problem", its name; and "formulas", with the entries "format", the
    version of the text; "functions", {name: how many coordinates and parameters, and the lines of text} of each
    formula; "opaque", {name: words on what is declared} of each black box; and "pieces", into how many the range of
    each component of v is cut, only where that matters and is not the default.
    """
    functions = {}
    for name, lines in problem.texts[0].items():
        one: Any = problem.functions[name]
        functions[name] = {"coordinates": one.coordinates, "parameters": one.parameters, "lines": lines}
    formulas = {"format": FORMAT, "functions": functions, "opaque": problem.opaque}
    if problem.dynamics.is_cut and problem.dynamics.pieces != CUTS:
        formulas["pieces"] = problem.dynamics.pieces
    return problem.numbers | {"problem": problem.name, "formulas": formulas}


def arrays_of(problem: Any) -> dict[str, FloatArray]:
    """The arrays that belong to a description, by the names that a file gives them.

    "tables/0", "tables/1", ...: the tables that formulas look up, shared with these. "opaque/NAME": `blackbox_values`
    of each black box, which is called for them.
    """
    tables = {f"tables/{number}": table.values for number, table in enumerate(problem.texts[1])}
    return tables | {f"opaque/{name}": blackbox_values(problem, name) for name in problem.opaque}


def digest_of(head: Mapping[str, Any], arrays: Mapping[str, FloatArray]) -> str:
    """SHA-256, hexadecimal, of the description of a problem and of its arrays: problems that share it have one table.

    head : from `described`; its entries `TOLD` count, names included. One error of measurement for all axes counts as
    the same error given for each. arrays : from `arrays_of`, {name: array}; compared as float64.
    """
    said: dict[str, Any] = {name: head[name] for name in TOLD}
    if "error" in said["sensing"]:
        error = np.broadcast_to(said["sensing"]["error"], len(said["grid"]["shape"])).tolist()
        said["sensing"] = said["sensing"] | {"error": error}
    held = {}
    for name, values in arrays.items():
        numbers: Any = np.ascontiguousarray(values, "<f8")
        held[name] = [list(values.shape), hashlib.sha256(numbers).hexdigest()]
    return hashlib.sha256(json.dumps([said, held], sort_keys=True).encode()).hexdigest()


def blackbox_values(problem: Any, name: str) -> FloatArray:
    """Values of a black box, flattened: by them a file tells it from another function.

    name : of the black box in `ReachAvoidProblem.functions`. It is called at `VALUES_KEPT` / `BOX_STEPS` random states
    on the grid of its axes, drawn with a fixed seed, at each of `BOX_STEPS` times from 0 on, evenly apart within the
    problem's steps: a drift or gain under one input at each time, input 0 first; `swept` over [t, t + delta].
    """
    function, grid, rng = problem.black_box(name), problem.grid, np.random.default_rng(0)
    if name.startswith(("unsafe", "target", "swept")):
        part = problem.target if name == "target" else problem.unsafe[int(name.split()[1])]
        grid = grid.subgrid(part.axes)
    states, found = rng.uniform(grid.lower, grid.upper, (VALUES_KEPT // BOX_STEPS, grid.ndim)), []
    for step in range(BOX_STEPS):
        t = step * problem.delta * problem.most_steps / BOX_STEPS
        given: tuple[Any, ...] = (problem.inputs[step % len(problem.inputs)], t) if name in ("drift", "gain") else (t,)
        given = (t, t + problem.delta) if name.startswith("swept") else given
        found.append(function(states, *given).ravel())
    return np.concatenate(found)
