"""Numbers and arrays that users give: taken if they fit, else refused with what was expected."""

import reprlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray


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
