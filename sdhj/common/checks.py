"""Checks of what users pass; errors say what was expected."""

import reprlib
from collections.abc import Sequence
from dataclasses import fields
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

DOUBLE = np.dtype(np.float64)


class Options:
    """Base of dataclasses of options: an unknown keyword is a TypeError that says what to write."""

    # before the dataclass's own, whose TypeError cannot say in which part of the options the keyword belongs
    def __new__(cls, *args: Any, **given: Any) -> Self:
        for name, value in given.items():
            if name not in options_of(cls):
                written = belonging_to(cls, name, value) or f"its options are {', '.join(options_of(cls))}"
                raise TypeError(f"{cls.__name__} has no option {name!r} of its own; {written}")
        return super().__new__(cls)


def options_of(kind: Any) -> dict[str, Any]:
    """The fields of a dataclass that can be given, by name."""
    return {one.name: one for one in fields(kind) if one.init}


def belonging_to(kind: Any, name: str, value: Any) -> str:
    """Where an option belongs that a part of `kind` has, and why the part refuses it; "" if none has."""
    for part in options_of(kind).values():
        # only a field that is made by a class of options of its own can have an option that belongs elsewhere
        inner = part.default_factory
        if not (isinstance(inner, type) and issubclass(inner, Options)):
            continue
        if name in options_of(inner):
            # made once, so that what the part would refuse is said at once
            try:
                inner(**{name: value})
                wrong = ""
            except ValueError as error:
                wrong = f", where {error}"
            return f"it belongs to {part.name}=sdhj.{inner.__name__}({name}=...){wrong}"
        if deeper := belonging_to(inner, name, value):
            return f"{deeper}, in {part.name}=sdhj.{inner.__name__}(...)"
    return ""


def number(name: str, value: Any, *, least: float = -np.inf, above: float = -np.inf, most: float = np.inf) -> float:
    """A finite float with least <= value <= most and value > above, or ValueError, naming it."""
    try:
        # float() converts these, too
        if isinstance(value, bool | np.bool_ | str | bytes | np.ndarray | np.datetime64 | np.timedelta64):
            raise TypeError
        converted = float(value)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be a number, got {reprlib.repr(value)}") from None
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
    """`value`, of shape (2,), as two finite floats above `above`."""
    try:
        fits = np.shape(value) == (2,)
    except ValueError:  # a ragged sequence has no shape
        fits = False
    if not fits:
        raise ValueError(f"{name} must be two numbers, got {reprlib.repr(value)}")
    return number(f"{name}[0]", value[0], above=above), number(f"{name}[1]", value[1], above=above)


def whole(name: str, value: Any, *, least: int, most: int | None = None) -> int:
    """An int with least <= value <= most, a float without a fraction too."""
    if type(value) is int and least <= value and (most is None or value <= most):  # at once
        return value
    fits = isinstance(value, int | np.integer) or (isinstance(value, float | np.floating) and value.is_integer())
    fits = fits and not isinstance(value, bool | np.timedelta64)  # integers to Python and NumPy
    if not fits or value < least or (most is not None and value > most):
        bounds = f"of at least {least:,}" if most is None else f"from {least:,} to {most:,}"
        raise ValueError(f"{name} must be a whole number {bounds}, got {reprlib.repr(value)}")
    return int(value)


def plain_array(name: str, values: Any) -> NDArray[Any]:
    """`values` as NumPy's array of any dtype."""
    if isinstance(values, np.ma.MaskedArray):  # NumPy would drop the mask
        raise ValueError(f"{name} must be real numbers, got a masked array; remove the mask, for example by filled()")
    try:
        return np.asarray(values)
    except (ValueError, TypeError):
        raise ValueError(f"{name} must be real numbers in rows of equal length, got {reprlib.repr(values)}") from None


def real_array(name: str, values: Any, shape: tuple[int, ...] | None = None) -> NDArray[np.float64]:
    """A C-contiguous float64 copy of `values`, in which NaN and infinity pass."""
    given = values if type(values) is np.ndarray else plain_array(name, values)
    if given.dtype.kind not in "fiu":  # NumPy would convert booleans, dates and some text
        kind = f"an array of {given.dtype}" if given.dtype.kind != "O" else reprlib.repr(values)
        raise ValueError(f"{name} must be real numbers, got {kind}")
    if shape is not None and given.shape != shape:
        raise ValueError(f"{name} must have shape {shape}, got {given.shape}")
    return given.copy() if given.dtype is DOUBLE else np.array(given, np.float64, order="C")


def finite_array(name: str, values: Any, shape: tuple[int, ...] | None = None) -> NDArray[np.float64]:
    """A C-contiguous float64 copy of `values`, all finite."""
    array = real_array(name, values, shape)
    if not np.isfinite(array).all():
        raise ValueError(f"{name} has a NaN or an infinity; every value must be finite")
    return array


def points_array(name: str, values: Any, ndim: int) -> NDArray[np.float64]:
    """A float64 copy of points (M, ndim), in which NaN and infinity pass."""
    points = real_array(name, values)
    if points.shape[1:] != (ndim,):
        raise ValueError(f"{name} must have shape (M, {ndim}), got {points.shape}; q[None] is one state")
    return points


def states_array(name: str, values: Any, ndim: int) -> NDArray[np.float64]:
    """A float64 copy of states (M, ndim), all finite."""
    states = points_array(name, values, ndim)
    if not np.isfinite(states).all():
        bad = states[~np.isfinite(states).all(axis=1)][0].tolist()
        raise ValueError(f"{name} has a NaN or an infinity: {bad}; every coordinate must be finite")
    return states


def read_only_view(array: Any) -> Any:
    """A read-only view of an array, which itself stays writable; anything else unchanged."""
    if isinstance(array, np.ndarray):
        array = array.view()
        array.setflags(write=False)
    return array


def option(name: str, value: Any, allowed: Sequence[Any]) -> None:
    """Raise ValueError, naming all that is allowed, unless `value` is one of these, of the first one's type."""
    if type(value) is not type(allowed[0]) or value not in allowed:  # 1 is not True
        raise ValueError(f"{name} must be one of {', '.join(map(str, allowed))}, got {reprlib.repr(value)}")


def one_line(text: str, most: int = 500) -> str:
    """A text that nobody vouches for as one line of at most `most` printable letters."""
    text = " ".join("".join(one if one.isprintable() else " " for one in text).split())
    return text if len(text) <= most else f"{text[: most // 2]} ... {text[-most // 2 :]}"


def sequence(name: str, value: Any) -> Any:
    """`value` if it is a sequence or an array with an axis, but no text."""
    scalar = isinstance(value, np.ndarray) and value.ndim == 0
    if not isinstance(value, Sequence | np.ndarray) or isinstance(value, str | bytes) or scalar:
        shown = reprlib.repr(value)
        raise ValueError(f"{name} must be a sequence with one entry for each axis, for example a list, got {shown}")
    return value


def axis_numbers(axes: Any, name: str) -> tuple[int, ...]:
    """The axes of a set as a tuple of int, which the problem checks further."""
    given = tuple(axes) if np.iterable(axes) else (None,)
    if not all(isinstance(axis, int | np.integer) for axis in given):
        raise ValueError(f"axes of {name!r} must be a sequence of whole numbers, for example (0, 1), got {axes!r}")
    return tuple(int(axis) for axis in given)
