"""Which of state, input, disturbance and time a user's function of the dynamics takes."""

import inspect
from typing import Any

from sdhj.common.parameters import KNOWN_NAMES, STATE_NAMES, parameters_of
from sdhj.formulas.formula import BlackBox

KNOWN = {name: ("points", "u", "t") for name in ("drift", "gain", "bounds")} | {"velocity": ("points", "u", "v", "t")}


def arguments(name: str, function: Any) -> tuple[str, ...]:
    """What a user's function takes, in order: "points", whatever it is called, then some of u, v, t; bounds may take t
    alone.
    """
    known = KNOWN[name]
    expected = f"{name} must be a function of the state first and then of {', '.join(known[1:])}, or of some of these"
    function = function.function if isinstance(function, BlackBox) else function
    if not callable(function):
        raise ValueError(f"{expected}, got {function!r}")
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):
        raise ValueError(f"{expected}; this one does not say what it takes: wrap it in a lambda") from None
    if name in ("drift", "gain") and "v" in list(signature.parameters)[1:]:
        raise ValueError(
            f"{name} does not take the disturbance v, got {signature}: give velocity=f(q, u, v), with bounds for v, in "
            "place of drift and gain; or leave v out, and gain= and bounds= say how it moves the state"
        )
    places = [p for p in signature.parameters.values() if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    lost = any(p.kind is p.KEYWORD_ONLY and p.default is p.empty for p in signature.parameters.values())
    # a function of t alone, whose first parameter is no state: only bounds may be one
    if (
        name == "bounds"
        and [p.name for p in places if p.name in KNOWN_NAMES or p.default is p.empty] == ["t"]
        and not lost
    ):
        return ("t",)
    # what is returned is what `_arguments_taken` of `sdhj.problem.dynamics` passes, by position and in this order
    places = parameters_of(name, function, signature, known[1:])
    taken = [p.name for i, p in enumerate(places) if not i or p.name in known[1:] or p.default is p.empty]
    fits = bool(taken) and not lost and taken == [p.name for p in places[: len(taken)]]
    if (
        not fits
        or not set(taken[1:]) <= set(known[1:])
        or (name == "bounds" and len(taken) == 1 and taken[0] not in STATE_NAMES)
    ):
        raise ValueError(f"{expected}; these are the names that are known, got {signature}")
    return ("points", *taken[1:])
