"""Problems in files: a problem made again from the head and tables of a file, and how one differs from those."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sdhj.common.remembering import FloatArray
from sdhj.formulas.formula import Formula, restored
from sdhj.formulas.text import CLOSE, FORMAT, alike
from sdhj.problem.describing import LAYOUT, blackbox_values
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sets import TargetSet, UnsafeSet
from sdhj.problem.vector_field import CUTS, VectorField


def tables_of(arrays: Mapping[str, FloatArray]) -> list[FloatArray]:
    """The tables that formulas look up, "tables/0", ... of a file's arrays in order, made read-only in place."""
    found = {int(name.split("/")[1]): values for name, values in arrays.items() if name.startswith("tables/")}
    for values in found.values():
        values.setflags(write=False)  # so that formulas share them (`Lookup.of`)
    return [found[number] for number in range(len(found))]


def problem_from(head: Mapping[str, Any], tables: Sequence[FloatArray]) -> ReachAvoidProblem:
    """The problem that a file describes, made and checked as a new one; ValueError if it is none, or has black boxes.

    head : as `describing.described` writes it, but with a Grid, a Sensing, an array of inputs, and a "recipe".
    """
    formulas = head["formulas"]
    if formulas["format"] != FORMAT:
        raise ValueError(f"its formulas have format {formulas['format']}, and this version reads {FORMAT}")
    if opaque := formulas["opaque"]:
        shown = "; ".join(f"{name}: {why}" for name, why in opaque.items())
        raise ValueError(f"it has black boxes ({shown}), which a file cannot contain: use load(path, problem=...)")
    found = formulas_in(head, tables)
    # a velocity is the drift of a `VectorField` without a gain, as in `ReachAvoidProblem.functions`
    drift = found.get("velocity", found.get("drift"))
    if drift is None or ("gain" in found) == ("velocity" in found):
        raise ValueError("it must have the formulas drift and gain, or velocity")
    target, unsafe = None, list[UnsafeSet]()
    for name, entry in sets_in(head).items():
        if name == "target":
            target = TargetSet(entry["axes"], found[name], entry["name"])
        else:
            swept = found.get(name.replace("unsafe", "swept"))
            # in the order of the fields of `UnsafeSet`
            how = swept, entry["name"], entry["sampling"], entry.get("inputs")
            unsafe.append(UnsafeSet(entry["axes"], found[name], *how))
    parts = drift, found.get("gain"), found["bounds"], formulas.get("pieces", CUTS)
    dynamics = VectorField(head["inputs"], head["grid"].ndim, *parts)
    rest = {name: head[name] for name in ("grid", "delta", "steps", "view_time", "recipe", "sensing")}
    return ReachAvoidProblem(dynamics=dynamics, target=target, unsafe=tuple(unsafe), name=head["problem"], **rest)


def sets_in(head: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """The entries in head["sets"] by the names of their formulas: {"target": ..., "unsafe 0": ..., ...}."""
    unsafe = [one for one in head["sets"] if one["kind"] != "target"]
    target = [one for one in head["sets"] if one["kind"] == "target"]
    return dict(zip(["target"], target, strict=False)) | {f"unsafe {i}": one for i, one in enumerate(unsafe)}


def formulas_in(head: Mapping[str, Any], tables: Sequence[FloatArray]) -> dict[str, Formula]:
    """The formulas that a file describes, by their names in `ReachAvoidProblem.functions`."""
    functions, count, ndim = head["formulas"]["functions"], len(head["inputs"]), head["grid"].ndim
    # the last line is `return` and a number for each result
    components = (len(functions["bounds"]["lines"][-1].split()) - 1) // count
    expected: dict[str, Any] = {"drift": (ndim, 1, (count, ndim)), "velocity": (ndim, 1 + components, (count, ndim))}
    expected |= {"gain": (ndim, 1, (count, ndim, components)), "bounds": (ndim, 1, (count, components))}
    for name, entry in sets_in(head).items():
        expected[name.replace("unsafe", "swept")] = len(entry["axes"]), 2, ()
        expected[name] = len(entry["axes"]), 1, ()
    found = {}
    for name in expected.keys() & functions.keys():  # others are of no part of the problem
        coordinates, parameters, shape = expected[name]
        found[name] = one = restored(functions[name]["lines"], tables, coordinates, parameters, shape, name)
        if len(one.outputs) != math.prod(one.shape):
            raise ValueError(f"the formula {name!r} must have {math.prod(one.shape)} results, got {len(one.outputs)}")
    return found


def what_differs(head: Mapping[str, Any], arrays: Mapping[str, FloatArray], problem: ReachAvoidProblem) -> str:
    """In words, how a problem differs from what a file describes, by more than a machine's rounding; or "".

    With "" `sdhj.table.files.problem_of_file` takes the problem although its digest is another: all that the digest
    is of is compared.
    """
    pairs: dict[str, Any] = {n: (head[n], getattr(problem, n)) for n in ("delta", "steps", "view_time")}
    pairs["sensing"] = head["sensing"].entry_in_head, problem.sensing.entry_in_head
    pairs |= {n: (getattr(head["grid"], n), getattr(problem.grid, n)) for n in LAYOUT}
    pairs |= {"name": (head["problem"], problem.name), "sets": (head["sets"], problem.numbers["sets"])}
    if problem.dynamics.is_cut:
        # Files of dynamics that are not cut have no number of pieces.
        pairs["pieces"] = head["formulas"].get("pieces", CUTS), problem.dynamics.pieces
    found = [f"{name} is {its} there and {ours} here" for name, (its, ours) in pairs.items() if its != ours]
    if not near(head["inputs"], problem.inputs):
        found.append(f"inputs are {head['inputs'].tolist()} there and {problem.inputs.tolist()} here")
    if (opaque := sorted(head["formulas"]["opaque"])) != sorted(problem.opaque):
        found.append(f"its black boxes are {opaque} there and {sorted(problem.opaque)} here")
    formulas = {name: one for name, one in problem.functions.items() if isinstance(one, Formula)}
    theirs = formulas_in(head, tables_of(arrays))
    for name in sorted(theirs.keys() | formulas.keys()):
        one, other = (each[name].outputs if name in each else () for each in (theirs, formulas))
        if not alike(one, other):
            found.append(f"the formula of {name} is another")
    # What a black box computes is not in a file, only its values at some states.
    for name in problem.opaque:
        kept, values = arrays.get(f"opaque/{name}", np.empty(0)), blackbox_values(problem, name)
        if not near(kept, values):
            found.append(f"the values of {name} differ by more than rounding")
    return "; ".join(found)


def near(one: FloatArray, other: FloatArray) -> bool:
    """Whether two arrays have one shape, and columns that differ by `CLOSE` of the largest |number| at most."""
    most = np.abs(other).max(axis=0, initial=0.0)
    return one.shape == other.shape and bool((np.abs(one - other) <= CLOSE * most).all())
