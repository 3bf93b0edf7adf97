"""Problems in files: their formulas as text, and the problem read again from them."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from sdhj.formulas.formula import restored
from sdhj.formulas.text import FORMAT, alike
from sdhj.kernels import FloatArray
from sdhj.problem.dynamics import VectorField
from sdhj.problem.problem import LAYOUT, ReachAvoidProblem, blackbox_values
from sdhj.problem.sets import TargetSet, UnsafeSet

SIZES = {"drift": ("L", "ndim"), "velocity": ("L", "ndim"), "gain": ("L", "ndim", "D"), "bounds": ("L", "D")}


def described(problem: ReachAvoidProblem) -> dict[str, Any]:
    """The problem as plain numbers, lists and text (JSON), for the head of a file."""
    functions = {}
    for name, lines in problem.texts[0].items():
        one: Any = problem.functions[name]
        functions[name] = {"coordinates": one.coordinates, "parameters": one.parameters, "lines": lines}
    return problem.numbers | {"formulas": {"format": FORMAT, "functions": functions, "opaque": problem.opaque}}


def arrays_of(problem: ReachAvoidProblem) -> dict[str, FloatArray]:
    """The arrays that belong to a description, by the names that a file gives them."""
    tables = {f"tables/{number}": table.values for number, table in enumerate(problem.texts[1])}
    return tables | {f"opaque/{name}": blackbox_values(problem, name) for name in problem.opaque}


def problem_from(head: Mapping[str, Any], tables: Sequence[FloatArray]) -> ReachAvoidProblem:
    """The problem that a head describes.

    Raises
    ------
    ValueError
        If it has black boxes, whose functions a file cannot contain, or is not one that `described` writes.
    """
    formulas = head["formulas"]
    if formulas["format"] != FORMAT:
        raise ValueError(f"its formulas have format {formulas['format']}, and this version reads {FORMAT}")
    if opaque := formulas["opaque"]:
        shown = "; ".join(f"{name}: {why}" for name, why in opaque.items())
        raise ValueError(f"it has black boxes ({shown}), which a file cannot contain: use load(path, problem=...)")
    functions, sizes = formulas["functions"], {"L": len(head["inputs"]), "ndim": head["grid"].ndim}

    def formula(name: str, coordinates: int, parameters: int, shape: Sequence[int] = ()) -> Any:
        if name not in functions:
            return None
        lines = functions[name]["lines"]
        found = restored(list(lines), tables, coordinates, parameters, tuple(shape), name)
        if len(found.outputs) != int(np.prod(shape)):
            raise ValueError(f"the formula {name!r} must have {int(np.prod(shape))} results, got {len(found.outputs)}")
        return found

    ndim, count = sizes["ndim"], sizes["L"]
    components = len(functions["bounds"]["lines"][-1].split()) - 1
    sizes["D"] = components // count
    parts = {
        name: formula(name, ndim, 1 + (sizes["D"] if name == "velocity" else 0), [sizes[one] for one in size])
        for name, size in SIZES.items()
    }
    drift = parts["velocity"] if parts["drift"] is None else parts["drift"]
    if drift is None or (parts["gain"] is None) == (parts["velocity"] is None):
        raise ValueError("it must have the formulas drift and gain, or velocity")
    target, unsafe = _sets(head["sets"], formula)
    return ReachAvoidProblem(
        grid=head["grid"],
        dynamics=VectorField(head["inputs"], ndim, drift, parts["gain"], parts["bounds"]),
        target=target,
        unsafe=unsafe,
        delta=head["delta"],
        steps=head["steps"],
        view_time=head["view_time"],
        name=head["problem"],
        recipe=head["recipe"],
        sensing=head["sensing"],
    )


def _sets(
    entries: Sequence[Mapping[str, Any]], formula: Callable[[str, int, int], Any]
) -> tuple[TargetSet | None, tuple[UnsafeSet, ...]]:
    """The target, None where there is none, and the unsafe sets of a head."""
    target, unsafe = None, list[UnsafeSet]()
    for entry in entries:
        axes = tuple(entry["axes"])
        if entry["kind"] == "target":
            target = TargetSet(axes, formula("target", len(axes), 1), entry["name"])
            continue
        level, swept = (formula(f"{kind} {len(unsafe)}", len(axes), n) for kind, n in (("unsafe", 1), ("swept", 2)))
        unsafe.append(UnsafeSet(axes, level, swept, entry["name"], entry["sampling"]))
    return target, tuple(unsafe)


def what_differs(head: Mapping[str, Any], arrays: Mapping[str, FloatArray], problem: ReachAvoidProblem) -> str:
    """How a problem differs from what a file describes, by more than the rounding of another machine; "" if not at all.

    Structures of formulas must be equal, and constants agree to 1e-12 (`sdhj.formulas.text`).
    """
    pairs: dict[str, tuple[Any, Any]] = {}
    for name in ("delta", "steps", "view_time", "sensing"):
        pairs[name] = head[name], getattr(problem, name)
    for name in LAYOUT:
        if name != "names":  # which are labels
            pairs[name] = getattr(head["grid"], name), getattr(problem.grid, name)
    pairs["sets"] = _unnamed(head["sets"]), _unnamed(problem.numbers["sets"])
    found = [f"{name} is {its} there and {ours} here" for name, (its, ours) in pairs.items() if its != ours]
    if head["inputs"].shape != problem.inputs.shape or not _near(head["inputs"], problem.inputs):
        found.append(f"inputs are {head['inputs'].tolist()} there and {problem.inputs.tolist()} here")
    texts, ours = head["formulas"], described(problem)["formulas"]
    if sorted(texts["opaque"]) != sorted(ours["opaque"]):
        found.append(f"its black boxes are {sorted(texts['opaque'])} there and {sorted(ours['opaque'])} here")
    for name in sorted({*texts["functions"], *ours["functions"]}):
        one, other = (each["functions"].get(name, {"lines": []})["lines"] for each in (texts, ours))
        if not alike(one, other):
            found.append(f"the formula of {name} is another")
    for name, values in arrays_of(problem).items():
        if name not in arrays or arrays[name].shape != values.shape or not _near(arrays[name], values):
            found.append(f"the values of {name} differ by more than rounding")
    return "; ".join(found)


def _unnamed(sets: Sequence[Mapping[str, Any]]) -> list[Any]:
    return [{key: value for key, value in one.items() if key != "name"} for one in sets]


def _near(one: FloatArray, other: FloatArray) -> bool:
    return bool(np.allclose(one, other, rtol=1e-12, atol=1e-12))
