"""Checks of the numbers, arrays and functions that users pass; errors say what was expected."""

import inspect
import reprlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

DOUBLE = np.dtype(np.float64)
ARGUMENTS = {"drift": ("points", "u", "t"), "gain": ("points", "u", "t"), "bounds": ("u", "t")}
USUAL = {"drift": ("points", "u"), "gain": ("points",), "bounds": ("t",)}  # for functions without a signature


def number(name: str, value: Any, *, least: float = -np.inf, above: float = -np.inf, most: float = np.inf) -> float:
    """`value` as a finite float with least <= value <= most and value > above; ValueError naming it otherwise."""
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
    """`value` as two finite floats; ValueError naming it otherwise."""
    try:
        fits = np.shape(value) == (2,)
    except ValueError:  # a ragged sequence has no shape
        fits = False
    if not fits:
        raise ValueError(f"{name} must be two numbers, got {reprlib.repr(value)}")
    return number(f"{name}[0]", value[0], above=above), number(f"{name}[1]", value[1], above=above)


def whole(name: str, value: Any, *, least: int, most: int | None = None) -> int:
    """`value` as an int from `least` to `most`, both included; ValueError naming it otherwise. 8.0 counts as 8."""
    fits = isinstance(value, int | np.integer) or (isinstance(value, float | np.floating) and value.is_integer())
    fits = fits and not isinstance(value, bool | np.timedelta64)  # integers to Python and NumPy
    if not fits or value < least or (most is not None and value > most):
        bounds = f"of at least {least:,}" if most is None else f"from {least:,} to {most:,}"
        raise ValueError(f"{name} must be a whole number {bounds}, got {reprlib.repr(value)}")
    return int(value)


def plain_array(name: str, values: Any) -> NDArray[Any]:
    """`values` as an array; ValueError for ragged sequences, and for masked arrays, whose mask NumPy would drop."""
    if isinstance(values, np.ma.MaskedArray):
        raise ValueError(f"{name} must be real numbers, got a masked array; remove the mask, for example by filled()")
    try:
        return np.asarray(values)
    except (ValueError, TypeError):
        raise ValueError(f"{name} must be real numbers in rows of equal length, got {reprlib.repr(values)}") from None


def real_array(name: str, values: Any, shape: tuple[int, ...] | None = None) -> NDArray[np.float64]:
    """A C-contiguous copy of `values` as float64, of that shape if one is given; ValueError otherwise.

    Complex numbers, dates and text are refused, though NumPy would convert some of them.
    """
    given = values if type(values) is np.ndarray else plain_array(name, values)
    if given.dtype.kind not in "fiu":
        kind = f"an array of {given.dtype}" if given.dtype.kind != "O" else reprlib.repr(values)
        raise ValueError(f"{name} must be real numbers, got {kind}")
    if shape is not None and given.shape != shape:
        raise ValueError(f"{name} must have shape {shape}, got {given.shape}")
    return given.copy() if given.dtype is DOUBLE else np.array(given, np.float64, order="C")


def all_finite(array: NDArray[np.float64]) -> bool:
    """Whether an array has no NaN and no infinity."""
    return bool(np.isfinite(array).all())


def finite_array(name: str, values: Any, shape: tuple[int, ...] | None = None) -> NDArray[np.float64]:
    """As `real_array`, every value finite."""
    array = real_array(name, values, shape)
    if not all_finite(array):
        raise ValueError(f"{name} has a NaN or an infinity; every value must be finite")
    return array


def points_array(name: str, values: Any, ndim: int) -> NDArray[np.float64]:
    """A copy of points (M, ndim) as float64; ValueError otherwise."""
    points = real_array(name, values)
    if points.shape[1:] != (ndim,):
        raise ValueError(f"{name} must have shape (M, {ndim}), got {points.shape}; q[None] is one state")
    return points


def states_array(name: str, values: Any, ndim: int) -> NDArray[np.float64]:
    """As `points_array`, every value finite; ValueError naming the first state that is not."""
    states = points_array(name, values, ndim)
    if not all_finite(states):
        bad = states[~np.isfinite(states).all(axis=1)][0].tolist()
        raise ValueError(f"{name} has a NaN or an infinity: {bad}; every coordinate must be finite")
    return states


def sealed(array: Any) -> Any:
    """A read-only view of an array; anything else unchanged."""
    if isinstance(array, np.ndarray):
        array = array.view()
        array.setflags(write=False)
    return array


def ask(name: str, function: Callable[..., Any], *given: Any) -> Any:
    """The result of calling a user's function, with read-only views of the arrays.

    Compiled functions get copies, because those with declared types do not accept read-only arrays.
    """
    if hasattr(function, "py_func"):
        return function(*[one.copy() if isinstance(one, np.ndarray) else one for one in given])
    try:
        return function(*[sealed(one) for one in given])
    except ValueError as error:
        if "read-only" not in str(error) and "WRITEABLE" not in str(error):
            raise
        raise ValueError(
            f"{name} writes to an array that is passed to it and used again by the library; write to a copy instead, "
            f"for example points = points.copy()"
        ) from error


@dataclass(frozen=True)
class CheckedFunction:
    """A user's level-set function with checked results: a new float64 array with one finite number for each point.

    Attributes
    ----------
    name : str
        Name in error messages.
    function : callable (points (M, n), *times) -> (M,)
        The user's function.
    """

    name: str
    function: Callable[..., Any]

    @classmethod
    def of(cls, name: str, function: Any, *takes: str) -> "CheckedFunction":
        """From a function, checked by `check_function`, or from a `CheckedFunction`, which is renamed."""
        function = function.function if isinstance(function, cls) else function
        check_function(name, function, *takes)
        return cls(name.replace("_", " ", 1), function)

    def __call__(self, points: NDArray[Any], *times: float) -> NDArray[np.float64]:
        values = real_array(self.name, ask(self.name, self.function, points, *times), (len(points),))
        if not all_finite(values):
            worst = int(np.argmin(np.isfinite(values)))
            raise ValueError(
                f"{self.name} is {values[worst]}, a NaN or an infinity, at {points[worst].tolist()}, t = "
                f"{', '.join(format(t, 'g') for t in times)}; every value must be finite"
            )
        return values


def repeated(name: str, first: NDArray[Any], again: NDArray[Any]) -> None:
    """Raise ValueError if two results of a function for the same arguments differ."""
    if not np.array_equal(first, again):
        raise ValueError(
            f"{name} returns different values, by up to {np.abs(first - again).max():.3g}, when it is called again "
            "with the same arguments; its results must depend on its arguments only"
        )


def option(name: str, value: Any, allowed: Sequence[Any]) -> None:
    """Raise ValueError if `value` is not one of the allowed options."""
    if type(value) is not type(allowed[0]) or value not in allowed:
        raise ValueError(f"{name} must be one of {', '.join(map(str, allowed))}, got {reprlib.repr(value)}")


def sequence(name: str, value: Any) -> Any:
    """`value` if it is a sequence or an array; ValueError naming it otherwise."""
    scalar = isinstance(value, np.ndarray) and value.ndim == 0
    if not isinstance(value, Sequence | np.ndarray) or isinstance(value, str | bytes) or scalar:
        shown = reprlib.repr(value)
        raise ValueError(f"{name} must be a sequence with one entry for each axis, for example a list, got {shown}")
    return value


def ascending(axes: Any, name: str) -> tuple[int, ...]:
    """The axes of a set as a tuple of int; ValueError naming the set if they are not whole numbers."""
    try:
        given = tuple(axes)
    except TypeError:
        given = (axes,) if isinstance(axes, float) else axes
    if not isinstance(given, tuple) or not all(isinstance(axis, int | np.integer) for axis in given):
        raise ValueError(f"axes of {name!r} must be a sequence of whole numbers, for example (0, 1), got {axes!r}")
    return tuple(int(axis) for axis in given)


def check_function(name: str, function: Any, *takes: str) -> None:
    """Raise ValueError if something is no function, or its signature does not accept the arguments."""
    expected = f"{name} must be a function of ({', '.join(takes)})"
    if not callable(function):
        raise ValueError(f"{expected}, got {function!r}")
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):  # some compiled functions have no signature
        return
    try:
        signature.bind(*takes)
    except TypeError:
        raise ValueError(f"{expected}, got a function of {signature}") from None


def arguments(name: str, function: Any) -> tuple[str, ...]:
    """Which of `ARGUMENTS[name]` a function takes, in the function's order.

    Parameters are matched by the names points, u and t; others get the first argument that is left. Parameters with
    defaults and other names are left alone.

    Raises
    ------
    ValueError
        If it takes other arguments, or is not a function.
    """
    possible = ARGUMENTS[name]
    expected = f"{name} must be an array or a function of ({', '.join(possible)}), or of some of these"
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
        raise ValueError(f"{expected}, got a function of {inspect.signature(function)}")
    return named
