"""Intervals of the checker's own, by NumPy's arithmetic and steps to the next numbers outward.

A function of NumPy that rises with all its arguments has its bounds at their ends; the others are told one by one.
NumPy's functions are off by a few units in the last place at most; `LAST` is more.
"""

from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from sdhj.certified.check.bits import Array

LAST = 2.0**-49  # of a value, by which an answer is widened: sixteen units in the last place

EXACT: dict[Any, Any] = {np.maximum: np.maximum, np.fmax: np.maximum, np.minimum: np.minimum, np.fmin: np.minimum}
EXACT |= {step: step for step in (np.floor, np.ceil, np.trunc, np.sign)} | {np.positive: np.copy}
RISING: set[Any] = {np.exp, np.expm1, np.log, np.log1p, np.log2, np.cbrt, np.arctan, np.arcsin, np.sinh, np.tanh}
RISING |= {np.sqrt, np.add, np.deg2rad, np.radians, np.arcsinh}
LOGIC: dict[Any, Any] = dict.fromkeys((np.logical_or, np.bitwise_or), np.maximum)
LOGIC |= dict.fromkeys((np.logical_and, np.bitwise_and), np.minimum)
NUMBERS = np.logical_or, np.logical_and, np.logical_not  # which take these as well, by whether they are zero
ALIKE = "stack concatenate vstack hstack column_stack broadcast_to broadcast_arrays reshape ravel transpose moveaxis "
ALIKE += "squeeze expand_dims atleast_1d atleast_2d take roll zeros_like ones_like full_like empty_like max min amax "
ALIKE += "amin clip copy flip tile repeat"
BY_ENDS = {getattr(np, name) for name in ALIKE.split()}


def ends_of(value: Any, side: int) -> Any:
    """One end of all spans in arguments; constants as they are, where they are real numbers."""
    if isinstance(value, list | tuple):
        return type(value)(ends_of(one, side) for one in value)
    if isinstance(value, Span):
        return (value.low, value.high)[side]
    kind = np.asarray(value).dtype
    if value is not None and not isinstance(value, str) and (kind.kind not in "biuf" or kind.itemsize > 8):
        raise Refused(f"a constant of type {kind}")
    return value


class Refused(TypeError):
    """What spans do not know; remembered, because a function may catch it and go another way."""

    seen: ClassVar[list["Refused"]] = []

    def __init__(self, what: str) -> None:
        super().__init__(what)
        self.seen.append(self)


def called(function: Callable[..., Any], *args: Any) -> Any:
    """What a function answers to spans; Refused where it met something that they do not know."""
    Refused.seen.clear()
    answer = function(*args)
    if Refused.seen:
        raise Refused.seen[0]
    return answer


def widened(low: Any, high: Any, least: Any = 0.0) -> "Span":
    """Wider by rounding; `least` absolutely."""
    low, high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    return Span(low - LAST * np.abs(low) - least, high + LAST * np.abs(high) + least)


def _hull(*values: Array) -> "Span":
    return widened(np.minimum.reduce(values), np.maximum.reduce(values))


class Span(NDArrayOperatorsMixin):
    """Everything between two arrays; NaN where a value may be no number."""

    def __init__(self, low: Any, high: Any) -> None:
        self.low, self.high = np.array(low, dtype=np.float64), np.array(high, dtype=np.float64)

    shape = property(lambda self: self.low.shape)
    ndim = property(lambda self: self.low.ndim)
    size = property(lambda self: self.low.size)
    T = property(lambda self: np.transpose(self))

    def __len__(self) -> int:
        return len(self.low)

    def __getitem__(self, at: Any) -> "Span":
        return part_of(self, self.low[at], self.high[at])

    def __setitem__(self, at: Any, value: Any) -> None:
        self.low[at], self.high[at] = ends_of(value, 0), ends_of(value, 1)

    def __getattr__(self, name: str) -> Any:
        if name in ATTRIBUTES:
            return lambda *args, **options: getattr(np, name)(self, *args, **options)
        if name.startswith("__"):
            raise AttributeError(name)
        raise Refused(f"the attribute {name}")

    def astype(self, kind: Any) -> "Span":
        if np.dtype(kind) != np.float64:
            raise Refused(f"a conversion to {np.dtype(kind)}")
        return Span(self.low, self.high)

    def __bool__(self) -> bool:
        raise Refused("a decision, which needs one value")

    __float__ = __int__ = __index__ = __array__ = __bool__

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        if method == "reduce" and not options.keys() - {"axis", "keepdims"} and ufunc.__name__ in REDUCTIONS:
            return getattr(np, REDUCTIONS[ufunc.__name__])(*inputs, **{"axis": 0} | options)
        logical = [
            isinstance(one, Flags) or (not isinstance(one, Span) and np.asarray(one).dtype == bool) for one in inputs
        ]
        fits = all(logical) if ufunc in (np.bitwise_or, np.bitwise_and, np.invert) else ufunc in NUMBERS
        fits |= not any(logical) or (ufunc in (np.add, np.subtract, np.multiply) and not all(logical))
        if (
            method != "__call__"
            or options
            or not fits
            or ufunc not in EXACT.keys() | RISING | OTHER.keys() | LOGIC.keys()
        ):
            raise Refused(f"numpy.{ufunc.__name__} {' '.join(options)}")
        with np.errstate(all="ignore"):
            if ufunc in LOGIC:
                return Flags(*(LOGIC[ufunc](*ends_of([_flags(one) for one in inputs], side)) for side in (0, 1)))
            if ufunc in EXACT:
                return Span(*(EXACT[ufunc](*ends_of(inputs, side)) for side in (0, 1)))
            if ufunc in RISING:
                return _sure(widened(ufunc(*ends_of(inputs, 0)), ufunc(*ends_of(inputs, 1))))
            return OTHER[ufunc](*inputs)

    def __array_function__(self, function: Any, types: Any, args: Any, options: Any) -> Any:
        kind = options.pop("dtype", None)
        if kind not in (None, float, np.float64) or options.keys() & {"out", "where", "initial", "mode"}:
            raise Refused(f"numpy.{function.__name__} with {' '.join(options)}")
        if function in BY_ENDS:
            low, high = (function(*ends_of(args, i), **{k: ends_of(v, i) for k, v in options.items()}) for i in (0, 1))
            pairs = zip(low, high, strict=True) if isinstance(low, list | tuple) else [(low, high)]
            parts = [part_of(args[0], *pair) for pair in pairs]
            return parts if isinstance(low, list | tuple) else parts[0]
        if function in (np.sum, np.mean):
            most = np.sum(np.maximum(np.abs(args[0].low), np.abs(args[0].high)), *args[1:], **options)
            low, high = (function(end, *args[1:], **options) for end in (args[0].low, args[0].high))
            out = _sure(widened(low, high, args[0].size // max(np.size(low), 1) * LAST * most))
            return np.maximum(out, 0.0) if (args[0].low >= 0).all() else out
        if function in (np.any, np.all):
            return (np.max if function is np.any else np.min)(_flags(args[0]), *args[1:], **options)
        if function is np.where:
            return _chosen(*args)
        if function is np.linalg.norm and len(args) == 1 and options.keys() <= {"axis", "keepdims"}:  # Euclidean
            return np.sqrt(np.sum(np.square(args[0]), **options))
        raise Refused(f"numpy.{function.__name__}")


class Flags(Span):
    """What a comparison says: 0, 1, or from 0 to 1 where that is open."""

    def __setitem__(self, at: Any, value: Any) -> None:
        raise Refused("writing into a comparison")


ATTRIBUTES = "sum max min mean reshape ravel clip any all take transpose squeeze".split()
REDUCTIONS = {"add": "sum", "maximum": "max", "minimum": "min"}


def part_of(whole: Any, low: Any, high: Any) -> Span:
    """Ends that were moved and not computed: views as NumPy has them, of a comparison again one."""
    first = whole[0] if isinstance(whole, list | tuple) else whole
    out: Span = object.__new__(Flags if isinstance(first, Flags) else Span)
    out.low, out.high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    return out


def _flags(value: Any) -> Span:
    """Whether a value is not zero, as NumPy takes numbers for conditions."""
    return value if isinstance(value, Flags) else np.not_equal(value, 0.0)


def _sure(out: Span) -> Span:
    """What was computed; no number where an end is none, or endless: what comes of that need not be one."""
    open_ = ~np.isfinite(out.low) | ~np.isfinite(out.high)
    return Span(np.where(open_, np.nan, out.low), np.where(open_, np.nan, out.high)) if open_.any() else out


def _all_ends(*values: Any) -> tuple[Array, ...]:
    return tuple(np.asarray(ends_of(value, side), dtype=np.float64) for value in values for side in (0, 1))


def _times(one: Any, other: Any) -> Span:
    a, b, c, d = _all_ends(one, other)
    if isinstance(one, Span) and isinstance(other, Span) and _same_place(one.low, other.low):
        return _power(one, 2)
    return _sure(_hull(*(p * q for p in (a, b) for q in (c, d))))


def _same_place(one: Array, other: Array) -> bool:
    first, second = one.__array_interface__, other.__array_interface__
    return bool(first["data"] == second["data"] and one.shape == other.shape and one.strides == other.strides)


def _inverse(one: Any) -> Span:
    a, b = _all_ends(one)
    whole = (a <= 0) & (b >= 0)
    return _sure(widened(np.where(whole, -np.inf, 1 / b), np.where(whole, np.inf, 1 / a)))


def _size(one: Any) -> Span:
    a, b = _all_ends(one)
    return Span(np.maximum(np.maximum(a, -b), 0.0), np.maximum(-a, b))


def _power(one: Any, to: Any) -> Any:
    if isinstance(to, Span) or not float(to).is_integer():
        return np.exp(to * np.log(one))
    if to < 0:
        return _inverse(_power(one, -to))
    base = _size(one) if to % 2 == 0 else one
    low, high = (end**to for end in _all_ends(base))
    out: Any = _sure(widened(low, high, 1e-300))
    return np.maximum(out, 0.0) if to % 2 == 0 else out


def _sine(one: Any, turn: float = 0.0) -> Span:
    """sin(x + turn * pi / 2): its ends and the hills and valleys between them."""
    a, b = _all_ends(one)
    quarter = (np.array([a, b]) / (np.pi / 2) + turn - 1.0) / 4.0  # whole at a hill, and a half at a valley
    doubt = 1e-14 * (1.0 + np.abs(quarter).max(axis=0))
    hill = np.floor(quarter[1] + doubt) >= np.ceil(quarter[0] - doubt)
    valley = np.floor(quarter[1] + 0.5 + doubt) >= np.ceil(quarter[0] + 0.5 - doubt)
    ends = [(np.cos if turn else np.sin)(end) for end in (a, b)]
    known = np.isfinite(a) & np.isfinite(b)
    out = widened(np.minimum(*ends), np.maximum(*ends), 1e-15)
    low, high = np.where(valley, -1.0, out.low), np.where(hill, 1.0, out.high)
    return Span(np.where(known, low, np.nan), np.where(known, high, np.nan))


def _tangent(one: Any) -> Span:
    a, b = _all_ends(one)
    pole = np.floor(a / np.pi + 0.5 - 1e-14) != np.floor(b / np.pi + 0.5 + 1e-14)
    return _sure(widened(np.where(pole, -np.inf, np.tan(a)), np.where(pole, np.inf, np.tan(b)), 1e-15))


def _angle(y: Any, x: Any) -> Span:
    (a, b), (c, d) = _all_ends(y), _all_ends(x)
    corners = _hull(*(np.arctan2(p, q) for p in (a, b) for q in (c, d)))
    cut = (a <= 0) & (b >= 0) & (c <= 0)
    known = np.isfinite(corners.low)
    return widened(np.where(cut & known, -np.pi, corners.low), np.where(cut & known, np.pi, corners.high))


def _rest(one: Any, by: Any) -> Span:
    lap = np.floor(one / by) if np.ndim(by) == 0 and not isinstance(by, Span) and by else one
    if isinstance(by, Span) or np.ndim(by) or not by:
        raise Refused("numpy.remainder by what is not one number")
    rest, known = one - lap * by, (lap.low == lap.high) | np.isnan(lap.low)
    low, high = min(by, 0.0), max(by, 0.0)
    return Span(np.where(known, np.maximum(rest.low, low), low), np.where(known, np.minimum(rest.high, high), high))


def _truth(sure: Callable[..., Any], never: Callable[..., Any]) -> Callable[..., Flags]:
    """By the ends (a, b) and (c, d): it is open where one is no number."""
    return lambda one, other: Flags(sure(*_all_ends(one, other)), ~never(*_all_ends(one, other)))


def _not(one: Any) -> Flags:
    found = _flags(one)
    return Flags(1.0 - found.high, 1.0 - found.low)


def _chosen(condition: Any, one: Any, other: Any) -> Span:
    sure, possible = (end != 0 for end in _all_ends(_flags(condition)))
    a, b, c, d = _all_ends(one, other)
    low = np.where(sure, a, np.where(possible, np.minimum(a, c), c))
    return Span(low, np.where(sure, b, np.where(possible, np.maximum(b, d), d)))


_before = _truth(lambda a, b, c, d: b < c, lambda a, b, c, d: a >= d)
_not_after = _truth(lambda a, b, c, d: b <= c, lambda a, b, c, d: a > d)
_same = _truth(lambda a, b, c, d: (a == d) & (b == c), lambda a, b, c, d: (a > d) | (c > b))
OTHER: dict[Any, Callable[..., Any]] = {
    np.negative: lambda one: Span(-one.high, -one.low),
    np.subtract: lambda one, other: np.add(one, np.negative(Span(*_all_ends(other)))),
    np.multiply: _times,
    np.divide: lambda one, other: _times(one, _inverse(other)),
    np.reciprocal: _inverse,
    **dict.fromkeys((np.absolute, np.fabs), _size),
    np.square: lambda one: _power(one, 2),
    np.power: _power,
    np.hypot: lambda one, other: widened(*(np.hypot(*ends_of((_size(one), _size(other)), side)) for side in (0, 1))),
    np.sin: _sine,
    np.cos: lambda one: _sine(one, 1.0),
    np.tan: _tangent,
    np.arctan2: _angle,
    np.arccos: lambda one: widened(np.arccos(one.high), np.arccos(one.low)),
    np.cosh: lambda one: widened(*(np.cosh(end) for end in _all_ends(_size(one)))),
    np.remainder: _rest,
    np.matmul: lambda one, other: np.sum(_times(one[:, :, None], np.asarray(other)[None]), axis=1),
    **{np.less: _before, np.less_equal: _not_after, np.equal: _same},
    np.not_equal: lambda one, other: _not(_same(one, other)),
    **{np.greater: lambda one, other: _before(other, one), np.greater_equal: lambda one, other: _not_after(other, one)},
    **dict.fromkeys((np.logical_not, np.invert), _not),
}
