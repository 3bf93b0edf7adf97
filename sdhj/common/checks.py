"""Checks of the numbers and arrays that users pass; errors say what was expected."""

import reprlib
from collections.abc import Sequence
from dataclasses import fields
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

DOUBLE = np.dtype(np.float64)


class Options:
    """Base of dataclasses of options: an unknown keyword is a TypeError that says what to write.

    A field whose default_factory is another class of options is a part of them.
    """

    def __new__(cls, *args: Any, **given: Any) -> Self:
        """A new object, whose fields the dataclass then sets.

        TypeError for a keyword that is none of its fields: it says in which part of the options the keyword belongs,
        with the value checked there, or else lists the fields.
        """
        for name, value in given.items():
            if name not in options_of(cls):
                written = belonging_to(cls, name, value) or f"its options are {', '.join(options_of(cls))}"
                raise TypeError(f"{cls.__name__} has no option {name!r} of its own; {written}")
        return super().__new__(cls)


def options_of(kind: Any) -> dict[str, Any]:
    """The fields of a dataclass that can be given when it is made: {name: dataclasses.Field}."""
    return {one.name: one for one in fields(kind) if one.init}


def belonging_to(kind: Any, name: str, value: Any) -> str:
    """Words on where an option `name` belongs, if a part of `kind` has it: "it belongs to PART=sdhj.CLASS(NAME=...)".

    "" if no part has it. kind : a class of `Options`, whose parts are looked through at any depth. value : what the
    option was given; if the part refuses it, the words go on with why.
    """
    for part in options_of(kind).values():
        inner = part.default_factory
        if not (isinstance(inner, type) and issubclass(inner, Options)):
            continue
        if name in options_of(inner):
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
    """`value` as a finite float with least <= value <= most and value > above; ValueError, naming it, otherwise.

    Booleans, text, dates and arrays are refused, even where they could be converted.
    """
    try:
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
    """`value`, of shape (2,), as two finite floats, each above `above`; ValueError, naming it, otherwise."""
    try:
        fits = np.shape(value) == (2,)
    except ValueError:  # a ragged sequence has no shape
        fits = False
    if not fits:
        raise ValueError(f"{name} must be two numbers, got {reprlib.repr(value)}")
    return number(f"{name}[0]", value[0], above=above), number(f"{name}[1]", value[1], above=above)


def whole(name: str, value: Any, *, least: int, most: int | None = None) -> int:
    """`value` as an int with least <= value <= most (None: no limit); ValueError, naming it, otherwise.

    A float without a fraction counts, 8.0 as 8; a boolean does not.
    """
    if type(value) is int and least <= value and (most is None or value <= most):  # at once
        return value
    fits = isinstance(value, int | np.integer) or (isinstance(value, float | np.floating) and value.is_integer())
    fits = fits and not isinstance(value, bool | np.timedelta64)  # integers to Python and NumPy
    if not fits or value < least or (most is not None and value > most):
        bounds = f"of at least {least:,}" if most is None else f"from {least:,} to {most:,}"
        raise ValueError(f"{name} must be a whole number {bounds}, got {reprlib.repr(value)}")
    return int(value)


def plain_array(name: str, values: Any) -> NDArray[Any]:
    """`values` as NumPy's array of any dtype, the same object if it is one.

    ValueError, naming it, for rows of different lengths, and for masked arrays, whose mask NumPy would drop.
    """
    if isinstance(values, np.ma.MaskedArray):
        raise ValueError(f"{name} must be real numbers, got a masked array; remove the mask, for example by filled()")
    try:
        return np.asarray(values)
    except (ValueError, TypeError):
        raise ValueError(f"{name} must be real numbers in rows of equal length, got {reprlib.repr(values)}") from None


def real_array(name: str, values: Any, shape: tuple[int, ...] | None = None) -> NDArray[np.float64]:
    """A C-contiguous float64 copy of `values`, of that shape if one is given; ValueError, naming it, otherwise.

    Booleans, complex numbers, dates and text are refused, though NumPy would convert some of them. NaN and infinity
    pass.
    """
    given = values if type(values) is np.ndarray else plain_array(name, values)
    if given.dtype.kind not in "fiu":
        kind = f"an array of {given.dtype}" if given.dtype.kind != "O" else reprlib.repr(values)
        raise ValueError(f"{name} must be real numbers, got {kind}")
    if shape is not None and given.shape != shape:
        raise ValueError(f"{name} must have shape {shape}, got {given.shape}")
    return given.copy() if given.dtype is DOUBLE else np.array(given, np.float64, order="C")


def finite_array(name: str, values: Any, shape: tuple[int, ...] | None = None) -> NDArray[np.float64]:
    """A C-contiguous float64 copy of `values`, all of which must be finite.

    shape : which it must have; None for any. ValueError, with the `name`, for another shape, for a NaN or an infinity,
    and for what `real_array` refuses: booleans, complex numbers, dates and text.
    """
    array = real_array(name, values, shape)
    if not np.isfinite(array).all():
        raise ValueError(f"{name} has a NaN or an infinity; every value must be finite")
    return array


def points_array(name: str, values: Any, ndim: int) -> NDArray[np.float64]:
    """A float64 copy of points (M, ndim), which may have NaN and infinities.

    ValueError, with the `name`, for another shape, such as that of a single state, (ndim,), and for what are no real
    numbers.
    """
    points = real_array(name, values)
    if points.shape[1:] != (ndim,):
        raise ValueError(f"{name} must have shape (M, {ndim}), got {points.shape}; q[None] is one state")
    return points


def states_array(name: str, values: Any, ndim: int) -> NDArray[np.float64]:
    """A float64 copy of states (M, ndim), all of whose coordinates must be finite.

    ValueError, with the `name`, for another shape, for what are no real numbers, and, with the first such state, where
    a coordinate is NaN or infinite.
    """
    states = points_array(name, values, ndim)
    if not np.isfinite(states).all():
        bad = states[~np.isfinite(states).all(axis=1)][0].tolist()
        raise ValueError(f"{name} has a NaN or an infinity: {bad}; every coordinate must be finite")
    return states


def read_only_view(array: Any) -> Any:
    """A read-only view of an array, which itself stays writable; anything else is returned unchanged."""
    if isinstance(array, np.ndarray):
        array = array.view()
        array.setflags(write=False)
    return array


def option(name: str, value: Any, allowed: Sequence[Any]) -> None:
    """Raise ValueError, naming it and all that is `allowed`, unless `value` is one of these.

    It must also have the type of the first of them, so 1 is not True.
    """
    if type(value) is not type(allowed[0]) or value not in allowed:
        raise ValueError(f"{name} must be one of {', '.join(map(str, allowed))}, got {reprlib.repr(value)}")


def one_line(text: str, most: int = 500) -> str:
    """A text, which may come from a file that nobody vouches for, as one line of printable characters.

    What is not printable becomes a blank, and blanks are joined. A text of more than `most` characters is cut to its
    first and last most / 2, with " ... " between.
    """
    text = " ".join("".join(one if one.isprintable() else " " for one in text).split())
    return text if len(text) <= most else f"{text[: most // 2]} ... {text[-most // 2 :]}"


def sequence(name: str, value: Any) -> Any:
    """`value`, unchanged, if it is a sequence, or an array with at least one axis.

    ValueError, naming it, otherwise; text counts as no sequence.
    """
    scalar = isinstance(value, np.ndarray) and value.ndim == 0
    if not isinstance(value, Sequence | np.ndarray) or isinstance(value, str | bytes) or scalar:
        shown = reprlib.repr(value)
        raise ValueError(f"{name} must be a sequence with one entry for each axis, for example a list, got {shown}")
    return value


def axis_numbers(axes: Any, name: str) -> tuple[int, ...]:
    """The axes of a set as a tuple of int.

    ValueError, with the set's `name`, unless they are a sequence of whole numbers. An empty one passes; whether the
    grid has such axes is not checked, nor whether an axis occurs twice.
    """
    given = tuple(axes) if np.iterable(axes) else (None,)
    if not all(isinstance(axis, int | np.integer) for axis in given):
        raise ValueError(f"axes of {name!r} must be a sequence of whole numbers, for example (0, 1), got {axes!r}")
    return tuple(int(axis) for axis in given)
