"""Numbers, arrays and functions that users give: taken if they fit, else refused with what was expected."""

import inspect
import reprlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

ARGUMENTS = {"drift": ("points", "u", "t"), "gain": ("points", "u", "t"), "bounds": ("u", "t")}
USUAL = {"drift": ("points", "u"), "gain": ("points",), "bounds": ("t",)}  # of compiled functions that do not tell


def number(name: str, value: Any, *, least: float = -np.inf, above: float = -np.inf, most: float = np.inf) -> float:
    """`value` as a finite float with least <= value <= most and value > above; ValueError naming it otherwise."""
    try:
        if isinstance(value, bool | np.bool_ | str | bytes):
            raise TypeError
        converted = float(value)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be a number, got {value!r}") from None
    except OverflowError:
        raise ValueError(f"{name} must be a number below 1e308, got {reprlib.repr(value)}") from None
    if not np.isfinite(converted):
        raise ValueError(f"{name} must be finite, got {value}")
    if converted < least:
        raise ValueError(f"{name} must be at least {least:g}, got {value}")
    if converted <= above:
        raise ValueError(f"{name} must be greater than {above:g}, got {value}")
    if converted > most:
        raise ValueError(f"{name} must be at most {most:g}, got {value}")
    return converted


def pair(name: str, value: Any, *, above: float = -np.inf) -> tuple[float, float]:
    """`value` as two finite floats; ValueError naming it otherwise."""
    try:
        fits = np.shape(value) == (2,)
    except ValueError:  # a ragged sequence has no shape
        fits = False
    if not fits:
        raise ValueError(f"{name} must be two numbers, got {value!r}")
    return number(f"{name}[0]", value[0], above=above), number(f"{name}[1]", value[1], above=above)


def whole(name: str, value: Any, *, least: int, most: int | None = None) -> int:
    """`value` as an int from `least` to `most`, both included; ValueError naming it otherwise. 8.0 counts as 8."""
    fits = isinstance(value, int | np.integer) or (isinstance(value, float | np.floating) and value.is_integer())
    if not fits or isinstance(value, bool) or value < least or (most is not None and value > most):
        bounds = f"of at least {least:,}" if most is None else f"from {least:,} to {most:,}"
        raise ValueError(f"{name} must be a whole number {bounds}, got {reprlib.repr(value)}")
    return int(value)


def finite_array(name: str, values: Any, shape: tuple[int, ...] | None = None) -> NDArray[np.float64]:
    """A copy of `values` as float64, of that shape if one is given, every value finite; ValueError otherwise."""
    given = np.asarray(values)
    if given.dtype.kind not in "fiu":
        raise ValueError(f"{name} must be real numbers, got an array of {given.dtype}")
    values = np.array(given, dtype=np.float64)
    if shape is not None and values.shape != shape:
        raise ValueError(f"{name} must have shape {shape}, got {values.shape}")
    if not np.isfinite(values).all():
        raise ValueError(f"{name} has a NaN or an infinity; every value must be finite")
    return values


def option(name: str, value: Any, allowed: Sequence[Any]) -> None:
    """Raise ValueError where `value` is not one of a closed set of options."""
    if value not in allowed or type(value) is not type(allowed[0]):
        raise ValueError(f"{name} must be one of {', '.join(map(str, allowed))}, got {value!r}")


def sequence(name: str, value: Any) -> Any:
    """`value` if it is a list or the like with an entry for each axis; ValueError naming it otherwise."""
    if not isinstance(value, Sequence | np.ndarray) or isinstance(value, str) or np.ndim(value) == 0:
        raise ValueError(f"{name} must be a sequence with one entry for each axis, for example a list, got {value!r}")
    return value


def ascending(axes: Any, name: str) -> tuple[int, ...]:
    """The axes of a set as a tuple of int; ValueError naming the set where they are no whole numbers."""
    try:
        given = tuple(axes)
    except TypeError:
        given = (axes,) if isinstance(axes, float) else axes
    if not isinstance(given, tuple) or not all(isinstance(axis, int | np.integer) for axis in given):
        raise ValueError(f"axes of {name!r} must be a sequence of whole numbers, for example (0, 1), got {axes!r}")
    return tuple(int(axis) for axis in given)


def check_function(name: str, function: Any, *takes: str) -> None:
    """Raise ValueError for what is not a function of those arguments, as far as it tells."""
    expected = f"{name} must be a function of ({', '.join(takes)})"
    if not callable(function):
        raise ValueError(f"{expected}, got {function!r}")
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):  # some compiled functions do not tell
        return
    try:
        signature.bind(*takes)
    except TypeError:
        raise ValueError(f"{expected}, got one of {signature}") from None


def arguments(name: str, function: Any) -> tuple[str, ...]:
    """Which of `ARGUMENTS[name]` a function takes, in its own order.

    Parameters called points, u or t are those; others take the first place that is left. What else has a default is the
    function's own.

    Raises
    ------
    ValueError
        Where it takes others, or is no function.
    """
    possible = ARGUMENTS[name]
    expected = f"{name} must be an array or a function of ({', '.join(possible)}), those it does not need left out"
    if not callable(function):
        raise ValueError(f"{expected}, got {function!r}")
    try:
        given = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        return USUAL[name]
    places = [p for p in given if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    taken = [p.name for p in places if p.default is p.empty or p.name in possible]
    free = [one for one in possible if one not in taken]
    named = tuple(one if one in possible else (free.pop(0) if free else "") for one in taken)
    lost = any(p.kind is p.KEYWORD_ONLY and p.default is p.empty for p in given)
    if not named or "" in named or lost or taken != [p.name for p in places[: len(taken)]]:  # they are given by place
        raise ValueError(f"{expected}, got one of {inspect.signature(function)}")
    return named
