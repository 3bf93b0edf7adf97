"""What the parameters of a user's function mean: the first is the state, the others are known by their names.

A first parameter that has the name of another, as t, could be read in two ways, so such a function is refused.
"""

import inspect
from collections.abc import Sequence
from typing import Any

KNOWN_NAMES = {"u": "the input", "v": "the disturbance", **dict.fromkeys(("t", "t0", "t1"), "the time")}
STATE_NAMES = ("points", "q", "x", "p", "state", "states")  # what is called so is no input, disturbance or time


def parameters_of(
    name: str, function: Any, signature: inspect.Signature, known: Sequence[str]
) -> list[inspect.Parameter]:
    """The positional parameters of a user's function: the state's first, then all others.

    ValueError where the first has the name of an input, disturbance or time: the message shows both readings.
    """
    every = signature.parameters.values()
    places = [p for p in every if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    given = getattr(function, "keywords", {})  # by a partial
    if lost := [p.name for p in every if p.kind is p.KEYWORD_ONLY and p.name in known and p.name not in given]:
        raise ValueError(f"{name} of {signature} never gets {lost[0]}, which stands behind the *: leave the * out")
    if places and (first := places[0].name) in KNOWN_NAMES:
        rest = [p.name for p in places[1:] if p.name in known]
        both = [one for one in known if one in (first, *rest)]
        state, other = (f"({', '.join(['q', *one])})" for one in (rest or known[:1], both or known))
        instead = f"write {other}, with the state before it"
        if first not in known:
            instead = f"write {other}, which does not depend on it"
            instead = "only a velocity depends on it, as velocity(q, u, v)" if first == "v" else instead
        raise ValueError(
            f"{name} is a function of {signature}, and its first parameter is the state, whatever it is called; but "
            f"{first} is the name of {KNOWN_NAMES[first]}. If it is the state, write {state}; if it is "
            f"{KNOWN_NAMES[first]}, {instead}"
        )
    return places


def check_places(name: str, function: Any, first: Sequence[str], rest: Sequence[str]) -> None:
    """Raise ValueError unless a user's function takes the arguments `first` and then `rest`, all by position.

    The first must not have the name of an input, disturbance or time; what stands in the place of an argument in `rest`
    must be called like it, or by a name that means nothing and without a default.
    """
    takes = (*first, *rest)
    expected = f"{name} must be a function of ({', '.join(takes)})"
    if not callable(function):
        raise ValueError(f"{expected}, got {function!r}")
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):  # some compiled functions have none
        return
    places = parameters_of(name, function, signature, rest)
    try:
        signature.bind(*takes)
    except TypeError:
        raise ValueError(f"{expected}, got a function of {signature}") from None
    for i, (wanted, given) in enumerate(zip(takes, places, strict=False)):
        # a name that means something else or, where an input or a time stands, one of a state or with a default
        other = given.name in KNOWN_NAMES or (
            i >= len(first) and (given.name in STATE_NAMES or given.default is not given.empty)
        )
        if i and given.name != wanted and other:
            raise ValueError(
                f"{expected}, got a function of {signature}, whose {given.name} would be {wanted}: the first parameter "
                f"is the state, whatever it is called, and what stands in the place of {wanted} is {wanted}; call it "
                "so, and let what has a default stand last"
            )
