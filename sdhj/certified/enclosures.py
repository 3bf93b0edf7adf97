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
from typing import Any, ClassVar

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from sdhj.kernels import FloatArray

try:
    import ival
except ImportError as missing:
    raise ImportError("intervals need crival: pip install 'sdhj[certified]'") from missing


class NotFollowed(TypeError):
    """An operation that no bound is known for, named in the message; kept, for user code may catch it and go on."""

    raised: ClassVar[list["NotFollowed"]] = []

    def __init__(self, what: str) -> None:
        super().__init__(what)
        self.raised.append(self)


def followed(function: Callable[..., Any], *args: Any) -> Any:
    """What a function answers to enclosures; NotFollowed where any operation was refused on the way."""
    NotFollowed.raised.clear()
    answer = function(*args)
    if NotFollowed.raised:
        raise NotFollowed.raised[0]
    return answer


def _plain(value: Any) -> FloatArray:
    """Constants as float64; others than real numbers of at most eight bytes are refused, as they compute otherwise."""
    array = np.asarray(value)
    if array.dtype.kind not in "biuf" or array.dtype.itemsize > 8:
        raise NotFollowed(f"a constant of type {array.dtype}")
    return array.astype(np.float64)


def _low_high(value: Any) -> tuple[FloatArray, FloatArray]:
    if isinstance(value, Enclosure):
        return value.low, value.high
    plain = _plain(value)
    return plain, plain


def _tight(value: Any) -> Any:
    """An `ival.Interval`, made without the checks that ends which come from one need not pass again."""
    interval, (low, high) = object.__new__(ival.Interval), _low_high(value)
    interval.lo, interval.hi = (low, high) if low.ndim else (float(low), float(high))
    return interval


def _enclosure(interval: Any) -> "Enclosure":
    return Enclosure(interval.lo, interval.hi)


class Enclosure(NDArrayOperatorsMixin):
    """All arrays between `low` and `high`, float64 arrays of one shape; NaN where the array may be undefined."""

    dtype: np.dtype[Any] = np.dtype(np.float64)

    def __init__(self, low: Any, high: Any) -> None:
        self.low, self.high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
        if self.high is self.low:  # each is written to
            self.high = self.low.copy()

    # ---- what NumPy asks

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        name = f"numpy.{ufunc.__name__}" + ("" if method == "__call__" else f".{method}")
        if method == "reduce" and ufunc in REDUCED and not set(options) - {"axis", "keepdims"}:
            return REDUCED[ufunc](inputs[0], axis=options.get("axis", 0), keepdims=options.get("keepdims", False))
        if method != "__call__" or ufunc not in UFUNCS or set(options) - {"out"}:
            raise NotFollowed(name + (f" with {', '.join(options)}" if options else ""))
        if not _numbers(ufunc, inputs):
            raise NotFollowed(f"{name} of comparisons (np.where makes numbers of them)")
        answer, (out,) = UFUNCS[ufunc](*inputs), options.get("out", (None,))
        if out is None:
            return answer
        if type(out) is not Enclosure or type(answer) is not Enclosure:
            raise NotFollowed("writing into a plain array (np.zeros_like(points) makes one that takes it)")
        out[...] = answer
        return out

    def __array_function__(self, function: Any, types: Any, args: Any, options: Any) -> Any:
        name, kind = f"numpy.{function.__name__}", options.pop("dtype", None)
        if kind not in (None, float, np.float64) or options.keys() & {"out", "where", "initial", "mode"}:
            raise NotFollowed(f"{name} with {', '.join(['dtype'] * (kind is not None) + list(options))}")
        if function in PLACED:
            return _by_ends(function, args, options)
        if function not in FUNCTIONS:
            raise NotFollowed(name)
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
        return type(self)(self.low[at], self.high[at])

    def __setitem__(self, at: Any, value: Any) -> None:
        self.low[at], self.high[at] = _low_high(value)

    def __iter__(self) -> Any:
        return (self[k] for k in range(len(self)))

    def astype(self, kind: Any, **_: Any) -> "Enclosure":
        if np.dtype(kind) != np.float64:
            raise NotFollowed(f"a conversion to {np.dtype(kind)}")
        return Enclosure(self.low.copy(), self.high.copy())

    def copy(self) -> "Enclosure":
        return type(self)(self.low.copy(), self.high.copy())

    def __getattr__(self, name: str) -> Any:
        if name in METHODS_AS_FUNCTIONS:
            return lambda *args, **options: getattr(np, name)(self, *args, **options)
        if name.startswith("__"):
            raise AttributeError(name)
        raise NotFollowed(f"the attribute {name!r} of an array")


class Truth(Enclosure):
    """What a comparison answers: 0 and 0, 1 and 1, or 0 and 1 where it is open. In arithmetic it is no number."""

    dtype = np.dtype(np.bool_)

    def __setitem__(self, at: Any, value: Any) -> None:
        raise NotFollowed("writing into a comparison")


def _numbers(ufunc: Any, inputs: Sequence[Any]) -> bool:
    """Whether NumPy computes with numbers here, or by the rules of logic. One comparison counts 1 and 0 to a number."""
    truths = [
        isinstance(one, Truth) or (not isinstance(one, Enclosure) and np.asarray(one).dtype == bool) for one in inputs
    ]
    if ufunc in (np.bitwise_and, np.bitwise_or, np.invert):
        return all(truths)
    return ufunc in LOGICAL or not any(truths) or (ufunc in (np.add, np.subtract, np.multiply) and not all(truths))


METHODS_AS_FUNCTIONS = {
    *("sum", "prod", "mean", "min", "max", "any", "all", "clip", "dot"),
    *("reshape", "ravel", "transpose", "squeeze", "take", "swapaxes", "repeat"),
}


def _by_ends(function: Callable[..., Any], args: Any, options: Any) -> Any:
    """A function that moves values, or rises with all of them and does not round, of both ends: views where it has."""
    truths: list[bool] = []

    def picked(value: Any, side: int) -> Any:
        if isinstance(value, list | tuple):
            return type(value)(picked(one, side) for one in value)
        if isinstance(value, Enclosure):
            truths.append(isinstance(value, Truth))
            return (value.low, value.high)[side]
        return value

    low, high = (
        function(*picked(args, side), **{key: picked(value, side) for key, value in options.items()}) for side in (0, 1)
    )
    kind: type[Enclosure] = Truth if all(truths) else Enclosure
    if kind is Truth and function in (np.zeros_like, np.ones_like, np.full_like, np.empty_like):
        raise NotFollowed(f"numpy.{function.__name__} of a comparison")
    if isinstance(low, list | tuple):
        return [kind(a, b) for a, b in zip(low, high, strict=True)]
    return kind(low, high)


# ---- operations that no interval library has


def _compared(certain: Callable[..., Any], impossible: Callable[..., Any]) -> Callable[..., Truth]:
    """What the ends (a, b) of one and (c, d) of the other say; nothing where one of them may be undefined."""

    def answer(one: Any, other: Any) -> Truth:
        ends = (*_low_high(one), *_low_high(other))
        return Truth(certain(*ends).astype(np.float64), 1.0 - impossible(*ends))

    return answer


def _less(one: Any, other: Any) -> Truth:
    return _compared(lambda a, b, c, d: b < c, lambda a, b, c, d: a >= d)(one, other)


def _at_most(one: Any, other: Any) -> Truth:
    return _compared(lambda a, b, c, d: b <= c, lambda a, b, c, d: a > d)(one, other)


_equal = _compared(lambda a, b, c, d: (a == d) & (b == c), lambda a, b, c, d: (a > d) | (c > b))


def _truth(value: Any) -> Truth:
    """As NumPy takes a number for a condition: whether it is not zero."""
    if isinstance(value, Truth):
        return value
    return _not(_equal(value, 0.0))


def _both(one: Any, other: Any) -> Truth:
    return Truth(*map(np.minimum, _low_high(_truth(one)), _low_high(_truth(other))))


def _either(one: Any, other: Any) -> Truth:
    return Truth(*map(np.maximum, _low_high(_truth(one)), _low_high(_truth(other))))


def _reduced_truth(function: Callable[..., Any]) -> Callable[..., Any]:
    return lambda array, axis=None, keepdims=False: _by_ends(
        function, (_truth(array),), {"axis": axis, "keepdims": keepdims}
    )


def _maximum(one: Any, other: Any) -> Enclosure:
    return Enclosure(*map(np.maximum, _low_high(one), _low_high(other)))


def _minimum(one: Any, other: Any) -> Enclosure:
    return Enclosure(*map(np.minimum, _low_high(one), _low_high(other)))


def _not(one: Any) -> Truth:
    low, high = _low_high(_truth(one))
    return Truth(1.0 - high, 1.0 - low)  # exact: of 0 and 1


def _where(condition: Any, one: Any, other: Any) -> Enclosure:
    """Both where it is open which."""
    some, every = _low_high(_truth(condition))[1] != 0.0, _low_high(_truth(condition))[0] != 0.0
    (a, b), (c, d) = _low_high(one), _low_high(other)
    low = np.where(every, a, np.where(some, np.minimum(a, c), c))
    return Enclosure(low, np.where(every, b, np.where(some, np.maximum(b, d), d)))


def _undefined(where: Any, answer: Any) -> Enclosure:
    """An answer that is nothing where the operation may have no result, or one that is no number."""
    found = _enclosure(answer)
    if np.any(where):
        return Enclosure(np.where(where, np.nan, found.low), np.where(where, np.nan, found.high))
    return found


def _endless(*values: Any) -> Any:
    """Where a value may be infinite: differences and products of such need be no numbers."""
    ends = [end for value in values for end in _low_high(value)]
    return reduce(np.logical_or, (np.isinf(end) for end in ends)) if any(np.isinf(end).any() for end in ends) else False


def _raised(base: Any, exponent: Any) -> Enclosure:
    low, high = _low_high(base)
    if not isinstance(exponent, Enclosure) and np.ndim(exponent) == 0 and float(exponent).is_integer():
        at_zero = (low <= 0.0) & (high >= 0.0) if exponent < 0 else False
        return _undefined(at_zero | _endless(base), ival.pown(_tight(base), int(exponent)))
    return _undefined((low < 0.0) | _endless(base, exponent), ival.pow(_tight(base), _tight(exponent)))


def _product(one: Any, other: Any) -> Enclosure:
    same = isinstance(one, Enclosure) and isinstance(other, Enclosure) and _one_array(one.low, other.low)
    answer = ival.sqr(_tight(one)) if same else _tight(one) * _tight(other)
    return _undefined(_endless(one, other), answer)


def _one_array(one: FloatArray, other: FloatArray) -> bool:
    """Whether two are views of the same numbers in the same order."""
    places = [(a.__array_interface__["data"], a.shape, a.strides) for a in (one, other)]
    return places[0] == places[1]


def _quotient(one: Any, other: Any) -> Enclosure:
    (a, b), (c, d) = _low_high(one), _low_high(other)
    nothing = (a <= 0.0) & (b >= 0.0) & (c <= 0.0) & (d >= 0.0)
    return _undefined(nothing | _endless(one, other), _tight(one) / _tight(other))


def _floor_divide(one: Any, other: Any) -> Enclosure:
    return _enclosure(ival.floor(_tight(_quotient(one, other))))


def _remainder(one: Any, other: Any) -> Enclosure:
    """Python's, with the sign of a divisor that is one number."""
    if isinstance(other, Enclosure) or np.ndim(other) or not float(other):
        raise NotFollowed("numpy.remainder by a divisor that is not one number")
    laps, divisor = _floor_divide(one, other), float(other)
    ends = min(divisor, 0.0), max(divisor, 0.0)
    rest = _enclosure(_tight(one) - _tight(laps) * divisor)
    known = (laps.low == laps.high) | np.isnan(laps.low)
    return Enclosure(
        np.where(known, np.clip(rest.low, *ends), ends[0]), np.where(known, np.clip(rest.high, *ends), ends[1])
    )


def _angle(y: Any, x: Any) -> Enclosure:
    """arctan2; at the cut either side, which hangs on the sign of a zero."""
    (low, high), found = _low_high(y), _enclosure(ival.atan2(_tight(y), _tight(x)))
    cut, half = (low <= 0.0) & (high >= 0.0) & (_low_high(x)[0] <= 0.0), np.nextafter(np.pi, 4.0)
    return Enclosure(np.where(cut, -half, found.low), np.where(cut, half, found.high))


def _along(operation: Callable[[Any, Any], Any]) -> Callable[..., Enclosure]:
    """A sum or the like over one axis or all."""

    def reduced(array: Any, axis: Any = None, keepdims: bool = False) -> Any:
        array = Enclosure(array.low, array.high) if isinstance(array, Truth) else array
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


def _mean(array: Any, axis: Any = None, keepdims: bool = False) -> Any:
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


def _of(name: str, outside: Callable[..., Any] | None = None) -> Callable[..., Enclosure]:
    function = getattr(ival, name)

    def answer(*args: Any) -> Enclosure:
        return _undefined(outside(*_low_high(args[0])) if outside else False, function(*map(_tight, args)))

    return answer


def _sum(one: Any, other: Any) -> Enclosure:
    return _undefined(_endless(one, other), _tight(one) + _tight(other))


def _difference(one: Any, other: Any) -> Enclosure:
    return _undefined(_endless(one, other), _tight(one) - _tight(other))


SAME = "sinh cosh tanh exp expm1 exp2 cbrt floor ceil trunc sign hypot"
OTHERS = {"arctan": "atan", "arcsinh": "asinh", "square": "sqr", "rint": "roundeven"}
DOMAINS: dict[str, tuple[str, Callable[..., Any]]] = {  # NumPy's name, ival's, and where the function may be undefined
    **{name: (name, lambda low, high: np.isinf(low) | np.isinf(high)) for name in ("sin", "cos", "tan")},
    **{name: (name, lambda low, high: low < 0.0) for name in ("sqrt", "log", "log2", "log10")},
    **{
        name: (ours, lambda low, high: (low < -1.0) | (high > 1.0))
        for name, ours in (("arcsin", "asin"), ("arccos", "acos"))
    },
    **{"log1p": ("log1p", lambda low, high: low < -1.0), "arccosh": ("acosh", lambda low, high: low < 1.0)},
    "arctanh": ("atanh", lambda low, high: (low <= -1.0) | (high >= 1.0)),
}
LOGICAL = {np.logical_and, np.logical_or, np.logical_not}
UFUNCS: dict[Any, Callable[..., Any]] = {
    **{getattr(np, name): _of(OTHERS.get(name, name)) for name in (*SAME.split(), *OTHERS)},
    **{getattr(np, name): _of(*domain) for name, domain in DOMAINS.items()},
    **{np.add: _sum, np.subtract: _difference, np.multiply: _product, np.divide: _quotient, np.arctan2: _angle},
    **{np.power: _raised, np.float_power: _raised, np.reciprocal: lambda one: _quotient(1.0, one)},
    np.negative: lambda one: Enclosure(-one.high, -one.low),
    np.positive: lambda one: one.copy(),
    **dict.fromkeys((np.absolute, np.fabs), lambda one: _enclosure(abs(_tight(one)))),
    **dict.fromkeys((np.deg2rad, np.radians), lambda one: one * (_enclosure(ival.acos(ival.Interval(-1.0))) / 180.0)),
    **dict.fromkeys((np.maximum, np.fmax), _maximum),
    **dict.fromkeys((np.minimum, np.fmin), _minimum),
    **dict.fromkeys((np.logical_and, np.bitwise_and), _both),
    **dict.fromkeys((np.logical_or, np.bitwise_or), _either),
    **dict.fromkeys((np.logical_not, np.invert), _not),
    **{np.less: _less, np.less_equal: _at_most},
    **{np.greater: lambda one, other: _less(other, one), np.greater_equal: lambda one, other: _at_most(other, one)},
    **{np.equal: _equal, np.not_equal: lambda one, other: _not(_equal(one, other))},
    **{np.remainder: _remainder, np.floor_divide: _floor_divide, np.matmul: _matmul},
}
REDUCED: dict[Any, Callable[..., Any]] = {
    **{np.add: _summed, np.multiply: _prod, np.maximum: np.max, np.minimum: np.min},
    **{np.logical_or: _reduced_truth(np.max), np.logical_and: _reduced_truth(np.min)},
}
FUNCTIONS: dict[Any, Callable[..., Any]] = {
    **{np.sum: _summed, np.prod: _prod, np.mean: _mean, np.where: _where, np.linalg.norm: _norm_of, np.dot: _matmul},
    **{np.any: _reduced_truth(np.max), np.all: _reduced_truth(np.min)},
    **{np.shape: lambda array: array.shape, np.ndim: lambda array: array.ndim, np.size: lambda array: array.size},
}
MOVING = "stack concatenate vstack hstack column_stack broadcast_to broadcast_arrays reshape ravel transpose moveaxis "
MOVING += "swapaxes squeeze expand_dims atleast_1d atleast_2d take roll repeat tile flip split array_split copy "
MOVING += "zeros_like ones_like full_like empty_like max min amax amin clip"
PLACED = {getattr(np, name) for name in MOVING.split()}


def enclosure_of(answer: Any, shape: Sequence[int]) -> Enclosure:
    """What a function answered, as an enclosure of `shape`: without bounds where it may be undefined."""
    low, high = _low_high(answer)
    try:
        low, high = np.broadcast_to(low, shape), np.broadcast_to(high, shape)
    except ValueError:
        raise ValueError(f"it must return shape {tuple(shape)}, got {low.shape}") from None
    open_ = np.isnan(low) | np.isnan(high)
    return Enclosure(np.where(open_, -np.inf, low), np.where(open_, np.inf, high))
