"""Arrays of intervals that plain NumPy functions are called with, to bound their values over whole boxes.

An `Enclosure` stands for every array between its two ends. NumPy hands it each operation (`__array_ufunc__`,
`__array_function__`), and the answer holds every value that the operation can have, rounded outward by `ival`
(IEEE 1788.1, correctly rounded functions). Jumps are handled as they are: where it is open which side of a jump is met,
both are in the answer. So a function that runs to its end has been proved to stay between the ends of its answer.

A comparison is an enclosure of 0 and 1, which `np.where`, `&`, `|`, `~` and arithmetic take. What would need one
answer (`if`, an index, `float()`, functions of other libraries) raises `NotFollowed`.
"""

from collections.abc import Callable, Sequence
from functools import reduce
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from sdhj.kernels import FloatArray

try:
    import ival
except ImportError as missing:
    raise ImportError("intervals need crival: pip install 'sdhj[certified]'") from missing


class NotFollowed(TypeError):
    """An operation that no bound is known for, named in the message."""


def _low_high(value: Any) -> tuple[FloatArray, FloatArray]:
    if isinstance(value, Enclosure):
        return value.low, value.high
    plain = np.asarray(value, dtype=np.float64)
    return plain, plain


def _tight(value: Any) -> Any:
    """An `ival.Interval`, made without the checks that ends which come from one need not pass again."""
    interval, (low, high) = object.__new__(ival.Interval), _low_high(value)
    interval.lo, interval.hi = (low, high) if low.ndim else (float(low), float(high))
    return interval


def _enclosure(interval: Any) -> "Enclosure":
    return Enclosure(interval.lo, interval.hi)


class Enclosure(NDArrayOperatorsMixin):
    """All arrays between `low` and `high`, float64 arrays of one shape."""

    dtype = np.dtype(np.float64)

    def __init__(self, low: Any, high: Any) -> None:
        self.low, self.high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)

    # ---- what NumPy asks

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        if method == "reduce" and ufunc in REDUCED and not set(options) - {"axis", "keepdims", "dtype", "out"}:
            return REDUCED[ufunc](inputs[0], axis=options.get("axis", 0), keepdims=options.get("keepdims", False))
        if method != "__call__" or ufunc not in UFUNCS or set(options) - {"out"}:
            raise NotFollowed(f"numpy.{ufunc.__name__}" + ("" if method == "__call__" else f".{method}"))
        answer, (out,) = UFUNCS[ufunc](*inputs), options.get("out", (None,))
        if out is None:
            return answer
        if not isinstance(out, Enclosure):
            raise NotFollowed("writing into a plain array (np.zeros_like(points) makes one that takes it)")
        out[...] = answer
        return out

    def __array_function__(self, function: Any, types: Any, args: Any, options: Any) -> Any:
        if function in PLACED:
            return _by_ends(function, args, options)
        if function not in FUNCTIONS:
            raise NotFollowed(f"numpy.{function.__name__}")
        return FUNCTIONS[function](*args, **options)

    def _decided(self, *_: Any, **__: Any) -> Any:
        raise NotFollowed("a decision, an index or a conversion, which needs one value where there are many")

    __bool__ = __int__ = __float__ = __index__ = _decided

    def __array__(self, *_: Any, **__: Any) -> Any:
        raise NotFollowed(
            "a conversion to a plain array, as np.array, np.asarray or np.min make of a list (np.stack takes one)"
        )

    # ---- what looks like an array

    shape = property(lambda self: self.low.shape)
    ndim = property(lambda self: self.low.ndim)
    size = property(lambda self: self.low.size)
    T = property(lambda self: np.transpose(self))

    def __len__(self) -> int:
        return len(self.low)

    def __getitem__(self, at: Any) -> "Enclosure":
        return Enclosure(self.low[at], self.high[at])

    def __setitem__(self, at: Any, value: Any) -> None:
        self.low[at], self.high[at] = _low_high(value)

    def __iter__(self) -> Any:
        return (self[k] for k in range(len(self)))

    def astype(self, kind: Any, **_: Any) -> "Enclosure":
        if np.dtype(kind) != np.float64:
            raise NotFollowed(f"a conversion to {np.dtype(kind)}")
        return self

    def copy(self) -> "Enclosure":
        return Enclosure(self.low.copy(), self.high.copy())

    def __getattr__(self, name: str) -> Any:
        if name in METHODS_AS_FUNCTIONS:
            return lambda *args, **options: getattr(np, name)(self, *args, **options)
        if name.startswith("__"):
            raise AttributeError(name)
        raise NotFollowed(f"the attribute {name!r} of an array")


METHODS_AS_FUNCTIONS = {
    *("sum", "prod", "mean", "min", "max", "any", "all", "clip", "dot"),
    *("reshape", "ravel", "transpose", "squeeze", "take", "swapaxes", "repeat"),
}


def _by_ends(function: Callable[..., Any], args: Any, options: Any) -> Any:
    """A function that moves values, or rises with all of them and does not round, of both ends."""

    def picked(value: Any, side: int) -> Any:
        if isinstance(value, list | tuple):
            return type(value)(picked(one, side) for one in value)
        return _low_high(value)[side] if isinstance(value, Enclosure) else value

    low, high = (
        function(*picked(args, side), **{key: picked(value, side) for key, value in options.items()}) for side in (0, 1)
    )
    if isinstance(low, list | tuple):
        return [Enclosure(np.array(a), np.array(b)) for a, b in zip(low, high, strict=True)]
    return Enclosure(np.array(low), np.array(high))  # of its own, to be written to


# ---- operations that no interval library has


def _compared(certain: Callable[..., Any], possible: Callable[..., Any]) -> Callable[..., Enclosure]:
    """0 or 1 by what the ends (a, b) of one and (c, d) of the other say."""

    def answer(one: Any, other: Any) -> Enclosure:
        ends = (*_low_high(one), *_low_high(other))
        return Enclosure(certain(*ends).astype(np.float64), possible(*ends).astype(np.float64))

    return answer


def _less(one: Any, other: Any) -> Enclosure:
    return _compared(lambda a, b, c, d: b < c, lambda a, b, c, d: a < d)(one, other)


def _at_most(one: Any, other: Any) -> Enclosure:
    return _compared(lambda a, b, c, d: b <= c, lambda a, b, c, d: a <= d)(one, other)


_equal = _compared(lambda a, b, c, d: (a == d) & (b == c), lambda a, b, c, d: (a <= d) & (c <= b))


def _maximum(one: Any, other: Any) -> Enclosure:
    return Enclosure(*map(np.maximum, _low_high(one), _low_high(other)))


def _minimum(one: Any, other: Any) -> Enclosure:
    return Enclosure(*map(np.minimum, _low_high(one), _low_high(other)))


def _not(one: Any) -> Enclosure:
    low, high = _low_high(one)
    return Enclosure(1.0 - high, 1.0 - low)  # exact: of 0 and 1


def _where(condition: Any, one: Any, other: Any) -> Enclosure:
    """Both where it is open which."""
    some, every = _low_high(condition)[1] != 0.0, _low_high(condition)[0] != 0.0
    (a, b), (c, d) = _low_high(one), _low_high(other)
    low = np.where(every, a, np.where(some, np.minimum(a, c), c))
    return Enclosure(low, np.where(every, b, np.where(some, np.maximum(b, d), d)))


def _raised(base: Any, exponent: Any) -> Enclosure:
    if not isinstance(exponent, Enclosure) and np.ndim(exponent) == 0 and float(exponent).is_integer():
        return _enclosure(ival.pown(_tight(base), int(exponent)))
    return _enclosure(ival.pow(_tight(base), _tight(exponent)))


def _floor_divide(one: Any, other: Any) -> Enclosure:
    return _enclosure(ival.floor(_tight(one) / _tight(other)))


def _remainder(one: Any, other: Any) -> Enclosure:
    """Python's, with the sign of a divisor that is one number."""
    if isinstance(other, Enclosure) or np.ndim(other):
        raise NotFollowed("numpy.remainder by a divisor that is not one number")
    laps, divisor = _floor_divide(one, other), float(other)
    ends = min(divisor, 0.0), max(divisor, 0.0)
    rest = _enclosure(_tight(one) - _tight(laps) * divisor)
    known = laps.low == laps.high
    return Enclosure(
        np.where(known, np.clip(rest.low, *ends), ends[0]), np.where(known, np.clip(rest.high, *ends), ends[1])
    )


def _along(operation: Callable[[Any, Any], Any]) -> Callable[..., Enclosure]:
    """A sum or the like over one axis or all."""

    def reduced(array: Any, axis: Any = None, keepdims: bool = False, **_: Any) -> Any:
        if isinstance(axis, tuple):
            for own in sorted((own % array.ndim for own in axis), reverse=True):
                array = reduced(array, own, keepdims)
            return array
        if axis is None:
            return np.reshape(reduced(np.reshape(array, -1), 0), (1,) * (array.ndim * keepdims))
        slices = np.moveaxis(array, axis, 0)
        out = reduce(operation, slices) if len(slices) > 1 else slices[0]
        return np.expand_dims(out, axis) if keepdims else out

    return reduced


_summed, _prod = _along(np.add), _along(np.multiply)


def _mean(array: Any, axis: Any = None, keepdims: bool = False, **_: Any) -> Any:
    total = _summed(array, axis, keepdims)
    return total / (array.size // max(total.size, 1))


def _norm_of(array: Any, ord: Any = None, axis: Any = None, keepdims: bool = False) -> Any:
    if ord not in (None, 2) or (axis is None and array.ndim > 1 and ord is not None):
        raise NotFollowed(f"numpy.linalg.norm of order {ord}")
    return np.sqrt(_summed(np.square(array), axis, keepdims))


def _matmul(one: Any, other: Any) -> Any:
    if one.ndim > 2 or other.ndim > 2:
        raise NotFollowed("numpy.matmul of stacks of matrices")
    left, right = (one[None] if one.ndim == 1 else one), (other[:, None] if other.ndim == 1 else other)
    out = _summed(np.multiply(left[:, :, None], right[None]), axis=1)
    out = out[0] if one.ndim == 1 else out
    return out[..., 0] if other.ndim == 1 else out


def _of(name: str) -> Callable[..., Enclosure]:
    function = getattr(ival, name)
    return lambda *args: _enclosure(function(*map(_tight, args)))


def _operator(name: str) -> Callable[..., Enclosure]:
    return lambda one, other: _enclosure(getattr(_tight(one), name)(_tight(other)))


SAME = "sin cos tan sinh cosh tanh exp expm1 exp2 log log1p log2 log10 sqrt cbrt floor ceil trunc sign hypot"
OTHERS = {
    **{"arcsin": "asin", "arccos": "acos", "arctan": "atan", "arctan2": "atan2", "arcsinh": "asinh"},
    **{"arccosh": "acosh", "arctanh": "atanh", "square": "sqr", "reciprocal": "recip", "rint": "roundeven"},
}
UFUNCS: dict[Any, Callable[..., Any]] = {
    **{getattr(np, name): _of(OTHERS.get(name, name)) for name in (*SAME.split(), *OTHERS)},
    **{np.add: _operator("__add__"), np.subtract: _operator("__sub__"), np.multiply: _operator("__mul__")},
    **{np.divide: _operator("__truediv__"), np.power: _raised, np.float_power: _raised},
    np.negative: lambda one: Enclosure(-one.high, -one.low),
    np.positive: lambda one: one,
    **dict.fromkeys((np.absolute, np.fabs), lambda one: _enclosure(abs(_tight(one)))),
    **dict.fromkeys((np.deg2rad, np.radians), lambda one: one * (_enclosure(ival.acos(ival.Interval(-1.0))) / 180.0)),
    **dict.fromkeys((np.maximum, np.fmax, np.logical_or, np.bitwise_or), _maximum),
    **dict.fromkeys((np.minimum, np.fmin, np.logical_and, np.bitwise_and), _minimum),
    **dict.fromkeys((np.logical_not, np.invert), _not),
    **{np.less: _less, np.less_equal: _at_most},
    **{np.greater: lambda one, other: _less(other, one), np.greater_equal: lambda one, other: _at_most(other, one)},
    **{np.equal: _equal, np.not_equal: lambda one, other: _not(_equal(one, other))},
    **{np.remainder: _remainder, np.floor_divide: _floor_divide, np.matmul: _matmul},
}
REDUCED: dict[Any, Callable[..., Any]] = {
    **{np.add: _summed, np.multiply: _prod, np.maximum: np.max, np.minimum: np.min},
    **{np.logical_or: np.max, np.logical_and: np.min},
}
FUNCTIONS: dict[Any, Callable[..., Any]] = {
    **{np.sum: _summed, np.prod: _prod, np.mean: _mean, np.where: _where, np.linalg.norm: _norm_of, np.dot: _matmul},
    **{np.shape: lambda array: array.shape, np.ndim: lambda array: array.ndim, np.size: lambda array: array.size},
}
MOVING = "stack concatenate vstack hstack column_stack broadcast_to broadcast_arrays reshape ravel transpose moveaxis "
MOVING += "swapaxes squeeze expand_dims atleast_1d atleast_2d take roll repeat tile flip split array_split copy "
MOVING += "zeros_like ones_like full_like empty_like max min amax amin clip any all"
PLACED = {getattr(np, name) for name in MOVING.split()}


def enclosure_of(answer: Any, shape: Sequence[int]) -> Enclosure:
    """What a function answered, as an enclosure of `shape`; ValueError where it has none or is nowhere defined."""
    low, high = _low_high(answer)
    try:
        low, high = np.broadcast_to(low, shape), np.broadcast_to(high, shape)
    except ValueError:
        raise ValueError(f"it must return shape {tuple(shape)}, got {low.shape}") from None
    if np.isnan(low).any() or np.isnan(high).any():
        raise ValueError("it is not defined everywhere in the state space")
    return Enclosure(low, high)
