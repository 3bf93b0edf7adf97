"""Tracing: a function is called once with arrays whose entries are nodes, and NumPy's operations build the graph.

Arrays are object arrays inside, so shapes, views and writing into them are NumPy's own. What is not known refuses, and a
refusal counts even where the function catches it. Functions that NumPy does not hand on, as np.min([f, g], axis=0) of a
list, are replaced in the module `numpy` while a function is traced; they behave as ever for all other arguments.
"""

import functools
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
from numba.core.compiler_lock import global_compiler_lock
from numpy.lib.mixins import NDArrayOperatorsMixin

from sdhj.formulas.graph import Node, constant, interned, leaf, make, power

ROWS = (3, 5, 7, 11, 13, 17, 19, 23)  # points that a function is traced with: a number that no other length equals
MOST_NODES = 200_000  # entries that one function may compute
HERE = str(Path(__file__).parent)
_state = threading.local()


class NotTraced(ValueError):
    """Something in a function that formulas do not know: what, and how to write it.

    Examples
    --------
    >>> import sdhj
    >>> sdhj.TargetSet((0,), lambda q, t: [abs(x) if x > 0 else x for x in q[:, 0]])  # doctest: +ELLIPSIS
    Traceback (most recent call last):
        ...
    ValueError: ...
    """

    def __init__(self, what: str, instead: str = "") -> None:
        super().__init__(f"{what}; {instead}" if instead else what)
        if getattr(_state, "refused", None) is not None:
            _state.refused.append((self, _place()))


def _place() -> str:
    """File and line of the frame of the user's that is at work."""
    frames = [one for one in traceback.extract_stack() if not one.filename.startswith(HERE)]
    frames = [one for one in frames if f"{Path(np.__file__).parent}" not in one.filename]
    return f"{frames[-1].filename}, line {frames[-1].lineno}" if frames else "an unknown place"


DECIDED = "a decision (if, and, or, min, max, while) or a conversion, which needs the value of one point"
WHERE = "use np.where(condition, one, other), and NumPy's functions in place of math's"


class Traced(NDArrayOperatorsMixin):
    """An array of nodes that behaves as NumPy's array of the values would, or refuses."""

    __array_priority__ = 2000

    def __init__(self, entries: Any) -> None:
        self.entries: Any = entries

    @property
    def truth(self) -> bool:
        return self.entries.size > 0 and all(one.truth for one in self.entries.flat)

    @property
    def dtype(self) -> np.dtype[Any]:
        return np.dtype(np.bool_ if self.truth else np.float64)

    shape = property(lambda self: self.entries.shape)
    ndim = property(lambda self: self.entries.ndim)
    size = property(lambda self: self.entries.size)
    T = property(lambda self: Traced(self.entries.T))
    real = property(lambda self: self)

    def _decided(self, *_: Any, **__: Any) -> Any:
        raise NotTraced(DECIDED, WHERE)

    __bool__ = __int__ = __float__ = __index__ = __complex__ = __round__ = _decided

    def __array__(self, *_: Any, **__: Any) -> Any:
        raise NotTraced("a conversion to a plain array", "np.stack and np.array make arrays of what is computed")

    def __len__(self) -> int:
        return len(self.entries)

    def __iter__(self) -> Iterator["Traced"]:
        return (self[k] for k in range(len(self)))

    def __getitem__(self, at: Any) -> "Traced":
        if _holds_traced(at):
            raise NotTraced("an index or a mask that depends on values", WHERE)
        return _wrapped(self.entries[at])

    def __setitem__(self, at: Any, value: Any) -> None:
        if not self.entries.flags.writeable:
            raise NotTraced("writing into an argument", "write into a copy, for example points = points.copy()")
        value = entries_of(value)
        if isinstance(at, Traced):
            if at.truth is False or value.ndim or at.shape != self.shape:
                raise NotTraced("writing where values say so", WHERE)
            value, at = _each("where", at.entries, value, self.entries), ...
        elif _holds_traced(at):
            raise NotTraced("writing where values say so", WHERE)
        self.entries[at] = value if value.ndim else value[()]

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, out: Any = None, **options: Any) -> Any:
        if method == "reduce" and ufunc in REDUCED:
            return REDUCED[ufunc](*inputs, **{"axis": 0} | _plain(options))
        rule = UFUNCS.get(ufunc)
        options = {name: value for name, value in options.items() if not _default(name, value)}
        if ufunc is np.matmul and method == "__call__" and not options and out is None:
            return _wrapped(np.matmul(*map(entries_of, inputs)))
        if rule is None or method not in ("__call__", "outer") or options:
            raise NotTraced(f"numpy.{ufunc.__name__}{'' if method == '__call__' else '.' + method} {_listed(options)}")
        arrays = [entries_of(one) for one in inputs]
        if method == "outer":
            arrays = [arrays[0].reshape(*arrays[0].shape, *[1] * arrays[1].ndim), arrays[1]]
        answer = rule(*arrays)
        if out is None or out[0] is None:
            return answer
        if not isinstance(out[0], Traced) or (out[0].truth and not answer.truth):
            raise NotTraced("writing a result into a plain array", "let the function return a new one")
        out[0][...] = answer
        return out[0]

    def __array_function__(self, function: Any, types: Any, args: Any, options: Any) -> Any:
        if function in FUNCTIONS:
            return FUNCTIONS[function](*args, **_plain(options))
        if function in PLACED and not options.keys() & {"out", "dtype", "casting", "mode", "where"}:
            return _wrapped(function(*map(_inside, args), **{name: _inside(value) for name, value in options.items()}))
        raise NotTraced(f"numpy.{function.__name__} {_listed(options)}")

    def astype(self, kind: Any, **options: Any) -> "Traced":
        if np.dtype(kind) != np.float64 or options.keys() - {"copy"} or not options.get("copy", True):
            raise NotTraced(f"a conversion to {np.dtype(kind)} {_listed(options)}")
        return _wrapped(_each("add", self.entries, constant(0.0)) if self.truth else self.entries.copy())

    def copy(self, order: str = "C") -> "Traced":
        return Traced(self.entries.copy())

    def __getattr__(self, name: str) -> Any:
        if name in METHODS:
            return functools.partial(
                getattr(np, name if name != "flatten" else "ravel"), self.copy() if name == "flatten" else self
            )
        if name.startswith("__"):
            raise AttributeError(name)
        raise NotTraced(f"the attribute {name!r} of an array")


METHODS = {
    *("sum", "prod", "mean", "min", "max", "any", "all", "clip", "dot", "flatten", "diagonal", "trace"),
    *("reshape", "ravel", "transpose", "squeeze", "take", "swapaxes", "repeat"),
}


def _default(name: str, value: Any) -> bool:
    """Whether an option says what holds without it."""
    return (
        (name == "dtype" and value in (None, float, np.float64))
        or (name == "where" and value is True)
        or (name in ("out", "initial") and (value is None or value is np._NoValue))
    )


def _plain(options: dict[str, Any]) -> dict[str, Any]:
    """Options without those that say what holds without them; NotTraced where one is not known."""
    return {name: value for name, value in options.items() if not _default(name, value)}


def _listed(options: dict[str, Any]) -> str:
    return f"with {', '.join(sorted(options))}" if options else ""


def _holds_traced(value: Any) -> bool:
    if isinstance(value, list | tuple):
        return any(map(_holds_traced, value))
    return isinstance(value, Traced | Node)


def _inside(value: Any) -> Any:
    """Arguments of a function that moves entries."""
    if isinstance(value, list | tuple):
        return type(value)(map(_inside, value)) if _holds_traced(value) else value
    return value.entries if isinstance(value, Traced) else value


def _wrapped(answer: Any) -> Any:
    if isinstance(answer, list | tuple):
        return type(answer)(map(_wrapped, answer))
    if isinstance(answer, Node):
        entries = np.empty((), object)
        entries[()] = answer
        return Traced(entries)
    if isinstance(answer, np.ndarray) and answer.dtype == object:
        return Traced(answer if all(isinstance(one, Node) for one in answer.flat) else entries_of(answer))
    return answer


def entries_of(value: Any) -> Any:
    """An object array of nodes of what a function computes with."""
    if isinstance(value, Traced):
        return value.entries
    if isinstance(value, Node):
        return _wrapped(value).entries
    if isinstance(value, list | tuple) and _holds_traced(value):
        return np.stack(np.broadcast_arrays(*map(entries_of, value)))
    given = np.asarray(value)
    if given.dtype == object and all(isinstance(one, Node | int | float) for one in given.flat):
        return _nodes_of(given)
    if given.dtype.kind not in "biuf" or given.dtype.itemsize > 8:
        raise NotTraced(f"a constant of type {given.dtype}", "formulas compute with real numbers")
    if given.dtype.kind in "iu" and np.any(np.abs(given.astype(np.float64)) > 2**53):
        raise NotTraced("a whole number above 2^53", "formulas compute in double precision")
    return _nodes_of(given)


def _nodes_of(array: Any) -> Any:
    out = np.empty(array.shape, object)
    out.flat[:] = [one if isinstance(one, Node) else constant(one) for one in array.ravel().tolist()]
    return out


# ---- operations


def _each(op: str, *arrays: Any) -> Any:
    """An operation of each entry, arrays broadcast."""
    arrays = np.broadcast_arrays(*map(entries_of, arrays))
    out = np.empty(arrays[0].shape, object)
    _state.made = getattr(_state, "made", 0) + out.size
    if _state.made > MOST_NODES:
        raise NotTraced(f"more than {MOST_NODES:,} operations", "use sdhj.gridded for a table")
    out.flat[:] = [make(op, *entries) for entries in zip(*(array.flat for array in arrays), strict=True)]
    return out


def _of(op: str, as_truths: str = "") -> Callable[..., Traced]:
    """A ufunc that is one operation; `as_truths` is what it is of truth values, which NumPy does not compute with."""

    def answer(*arrays: Any) -> Traced:
        truths = [bool(array.size) and all(one.truth for one in array.flat) for array in arrays]
        if not all(truths) or op in ("less", "lesseq", "equal"):
            return Traced(_each(op, *arrays))
        if not as_truths:
            raise NotTraced(f"{op} of truth values", "use np.logical_and, np.logical_or or np.where")
        return Traced(_each(as_truths, *arrays))

    return answer


def _true(array: Any) -> Any:
    """Whether entries are not zero, as NumPy takes numbers for conditions."""
    out = np.empty(array.shape, object)
    out.flat[:] = [one if one.truth else make("not", make("equal", one, constant(0.0))) for one in array.flat]
    return out


def _logical(op: str, numbers: bool = True) -> Callable[..., Traced]:
    def answer(*arrays: Any) -> Traced:
        if not numbers and not all(one.truth for array in arrays for one in array.flat):
            raise NotTraced("&, | or ~ of numbers", "compare them first")
        return Traced(_each(op, *map(_true, arrays)))

    return answer


def _made(expression: Callable[..., Any]) -> Callable[..., Traced]:
    """A ufunc as an expression of others."""
    return lambda *arrays: expression(*map(Traced, arrays))


def _power(base: Any, exponent: Any) -> Traced:
    base, exponent = np.broadcast_arrays(base, exponent)
    out = np.empty(base.shape, object)
    out.flat[:] = [power(a, b) for a, b in zip(base.flat, exponent.flat, strict=True)]
    return Traced(out)


def _trunc(a: Any) -> Any:
    return np.where(a < 0.0, np.ceil(a), np.floor(a))


ONE = "sin cos tan exp log sqrt arctan arcsin arccos tanh floor sign square:sqr negative:neg absolute:abs fabs:abs"
TWO = "subtract:sub divide:div hypot arctan2 remainder:mod less less_equal:lesseq equal"
UFUNCS: dict[Any, Callable[..., Traced]] = {
    **{getattr(np, name): _of(op or name) for name, _, op in (one.partition(":") for one in f"{ONE} {TWO}".split())},
    **{np.add: _of("add", "or"), np.multiply: _of("mul", "and")},
    **dict.fromkeys((np.minimum, np.fmin), _of("min", "and")),
    **dict.fromkeys((np.maximum, np.fmax), _of("max", "or")),
    **dict.fromkeys((np.power, np.float_power), _power),
    np.greater: lambda a, b: UFUNCS[np.less](b, a),
    np.greater_equal: lambda a, b: UFUNCS[np.less_equal](b, a),
    np.not_equal: lambda a, b: Traced(_each("not", _each("equal", a, b))),
    **{np.logical_and: _logical("and"), np.logical_or: _logical("or"), np.logical_not: _logical("not")},
    **{np.bitwise_and: _logical("and", False), np.bitwise_or: _logical("or", False), np.invert: _logical("not", False)},
    np.logical_xor: _made(lambda a, b: np.logical_or(a, b) & ~np.logical_and(a, b)),
    np.positive: _made(lambda a: a.copy()),
    np.ceil: _made(lambda a: -np.floor(-a)),
    np.trunc: _made(_trunc),
    np.reciprocal: _made(lambda a: 1.0 / a),
    np.floor_divide: _made(lambda a, b: np.floor(a / b)),
    np.fmod: _made(lambda a, b: a - _trunc(a / b) * b),
    np.sinh: _made(lambda a: (np.exp(a) - np.exp(-a)) / 2.0),
    np.cosh: _made(lambda a: (np.exp(a) + np.exp(-a)) / 2.0),
    np.expm1: _made(lambda a: np.exp(a) - 1.0),
    np.log1p: _made(lambda a: np.log(1.0 + a)),
    **dict.fromkeys((np.deg2rad, np.radians), _made(lambda a: a * (np.pi / 180.0))),
    **dict.fromkeys((np.rad2deg, np.degrees), _made(lambda a: a * (180.0 / np.pi))),
}  # fmt: skip


def _reduced(ufunc: Any, array: Any, axis: Any = None, keepdims: bool = False) -> Traced:
    """A sum or the like along one axis, several, or all."""
    entries = entries_of(array)
    places = range(entries.ndim) if axis is None else np.atleast_1d(axis).tolist()
    counts = ufunc.__name__ in ("add", "multiply")
    if counts and entries.size and all(one.truth for one in entries.flat):
        entries = _each("where", entries, 1.0, 0.0)  # NumPy counts
    for place in sorted((one % entries.ndim for one in places), reverse=True):
        if not entries.shape[place] and not counts:
            raise NotTraced(f"numpy.{ufunc.__name__}.reduce of nothing")
        slices = [_wrapped(one) for one in np.moveaxis(entries, place, 0)]
        whole = reduce(ufunc, slices) if slices else constant(float(ufunc.__name__ == "multiply"))
        rest = np.broadcast_to(entries_of(whole), np.delete(entries.shape, place))
        entries = np.expand_dims(rest, place) if keepdims else rest
    return Traced(entries.copy())


def _reducing(ufunc: Any) -> Callable[..., Traced]:
    return lambda array, axis=None, keepdims=False: _reduced(ufunc, array, axis, bool(keepdims is True))


def _condition(ufunc: Any) -> Callable[..., Traced]:
    return lambda array, axis=None, keepdims=False: _reduced(
        ufunc, Traced(_true(entries_of(array))), axis, keepdims is True
    )


def _mean(array: Any, axis: Any = None, keepdims: bool = False) -> Traced:
    total = np.sum(array, axis=axis, keepdims=keepdims)
    return total / (array.size // max(total.size, 1))


def _norm(array: Any, ord: Any = None, axis: Any = None, keepdims: bool = False) -> Any:
    array = Traced(entries_of(array))
    vector = isinstance(axis, int) or (axis is None and (array.ndim == 1 or ord is None))
    if not vector or ord not in (None, 1, 2, np.inf):
        raise NotTraced(f"numpy.linalg.norm of order {ord} along {axis}")
    if ord in (1, np.inf):
        return (np.sum if ord == 1 else np.max)(abs(array), axis=axis, keepdims=keepdims)
    return np.sqrt(np.sum(np.square(array), axis=axis, keepdims=keepdims))


def _where(condition: Any, *branches: Any) -> Traced:
    if len(branches) != 2:
        raise NotTraced("numpy.where of a condition alone", WHERE)
    return Traced(_each("where", _true(entries_of(condition)), *branches))


def _clip(array: Any, a_min: Any = None, a_max: Any = None, *, min: Any = None, max: Any = None) -> Any:
    least, most = (b if a is None else a for a, b in ((a_min, min), (a_max, max)))
    array = array if least is None else np.maximum(array, least)
    return array if most is None else np.minimum(array, most)


def _select(conditions: Any, choices: Any, default: Any = 0.0) -> Any:
    return reduce(
        lambda rest, pair: _where(pair[0], pair[1], rest), reversed([*zip(conditions, choices, strict=True)]), default
    )


def _interp(x: Any, xp: Any, fp: Any) -> Any:
    xp, fp = np.asarray(xp, dtype=np.float64), np.asarray(fp, dtype=np.float64)
    out = fp[0] + 0.0 * x
    for k in range(len(xp) - 1):
        out = out + (fp[k + 1] - fp[k]) / (xp[k + 1] - xp[k]) * (np.clip(x, xp[k], xp[k + 1]) - xp[k])
    return out


def _diff(array: Any, n: int = 1, axis: int = -1) -> Any:
    for _ in range(n):
        size = array.shape[axis]
        array = np.take(array, range(1, size), axis) - np.take(array, range(size - 1), axis)
    return array


def _filled(value: Any) -> Callable[..., Traced]:
    return lambda array, *given: Traced(np.broadcast_to(entries_of(given[0] if given else value), array.shape).copy())


def _by_entries(function: Any) -> Callable[..., Any]:
    """A product of matrices: NumPy's own, which adds and multiplies entries."""
    return lambda *args, **options: _wrapped(
        function(*(one if isinstance(one, str) else entries_of(one) for one in args), **options)
    )


FUNCTIONS: dict[Any, Callable[..., Any]] = {
    **{np.sum: _reducing(np.add), np.prod: _reducing(np.multiply), np.mean: _mean, np.linalg.norm: _norm},
    **dict.fromkeys((np.min, np.amin), _reducing(np.minimum)),
    **dict.fromkeys((np.max, np.amax), _reducing(np.maximum)),
    **{np.any: _condition(np.logical_or), np.all: _condition(np.logical_and)},
    **{np.where: _where, np.clip: _clip, np.select: _select, np.interp: _interp, np.diff: _diff},
    np.ptp: lambda array, axis=None: np.max(array, axis=axis) - np.min(array, axis=axis),
    **{np.zeros_like: _filled(0.0), np.ones_like: _filled(1.0), np.empty_like: _filled(np.nan), np.full_like: _filled(np.nan)},
    **{function: _by_entries(function) for function in (np.dot, np.einsum, np.tensordot, np.inner, np.outer, np.cross)},
    **{np.shape: lambda array: array.shape, np.ndim: lambda array: array.ndim, np.size: lambda array: array.size},
}  # fmt: skip
REDUCED = {
    ufunc: functools.partial(_reduced, ufunc)
    for ufunc in (np.add, np.multiply, np.minimum, np.maximum, np.logical_or, np.logical_and)
}
MOVING = "stack concatenate vstack hstack dstack column_stack broadcast_to broadcast_arrays reshape ravel transpose moveaxis "
MOVING += "swapaxes squeeze expand_dims atleast_1d atleast_2d take roll repeat tile flip split array_split copy delete append "
MOVING += "diagonal trace diag permute_dims concat unstack"
PLACED = {getattr(np, name) for name in MOVING.split() if hasattr(np, name)}
LISTS = "min max amin amax sum prod mean any all where clip"  # which may be given a list


def _array(value: Any, dtype: Any = None, *, copy: bool | None = True, ndmin: int = 0) -> Traced:
    if dtype not in (None, float, np.float64) or ndmin:
        raise NotTraced(f"numpy.array of {dtype}")
    entries = entries_of(value)
    return Traced(entries.copy() if copy else entries)


def _as_array(value: Any, dtype: Any = None) -> Traced:
    return _array(value, dtype, copy=False)


def _room(name: str, rows: int) -> Callable[..., Any]:
    """zeros, ones, empty or full, with entries that can be written where the first length is that of the points."""
    original, first = getattr(np, name), name == "full"

    def make_room(shape: Any, *args: Any, **options: Any) -> Any:
        dtype = options.get("dtype", args[first] if len(args) > first else None)
        lengths = (shape,) if isinstance(shape, int | np.integer) else tuple(shape)
        value = options.get("fill_value", args[0] if args else None) if first else FILLED[name]
        if dtype is object or (lengths[:1] != (rows,) and not _holds_traced(value)):
            return original(shape, *args, **options)
        if dtype not in (None, float, np.float64):
            raise NotTraced(f"an array of {np.dtype(dtype)}", "formulas compute with real numbers")
        return Traced(np.broadcast_to(entries_of(value), lengths).copy())

    return make_room


FILLED = {"zeros": 0.0, "ones": 1.0, "empty": np.nan}


class _Ufunc:
    """np.minimum and others, whose `reduce` may be given a list."""

    def __init__(self, ufunc: Any) -> None:
        self.ufunc = ufunc

    def __call__(self, *args: Any, **options: Any) -> Any:
        return self.ufunc(*args, **options)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.ufunc, name)

    def reduce(self, array: Any, *args: Any, **options: Any) -> Any:
        return self.ufunc.reduce(_joined(array), *args, **options)


def _joined(value: Any) -> Any:
    return Traced(entries_of(value)) if isinstance(value, list | tuple) and _holds_traced(value) else value


def _listing(original: Any) -> Callable[..., Any]:
    return lambda *args, **options: original(*map(_joined, args), **options)


def _making(original: Any, ours: Any) -> Callable[..., Any]:
    return lambda value, *args, **options: (ours if _holds_traced(value) else original)(value, *args, **options)


@contextmanager
def _replaced(rows: int) -> Iterator[None]:
    """NumPy's module with functions that know traced arrays; no kernel is compiled meanwhile, whose code names them."""
    new: dict[str, Any] = {name: _listing(getattr(np, name)) for name in LISTS.split()}
    new |= {name: _room(name, rows) for name in ("full", *FILLED)}
    new |= {name: _making(getattr(np, name), _as_array) for name in ("asarray", "asanyarray", "ascontiguousarray")}
    new |= {"array": _making(np.array, _array)}
    new |= {one.__name__: _Ufunc(one) for one in (np.minimum, np.maximum, np.add, np.logical_or, np.logical_and)}
    with global_compiler_lock:
        before = {name: getattr(np, name) for name in new}
        try:
            vars(np).update(new)
            yield
        finally:
            vars(np).update(before)


# ---- a function


def points_of(count: int, rows: int) -> Traced:
    """The points that a function is traced with, (rows, count), read-only."""
    entries = np.empty((rows, count), object)
    for row in range(rows):
        entries[row] = [leaf("x", k, row) for k in range(count)]
    entries.setflags(write=False)
    return Traced(entries)


def parameter(first: int, count: int | None = None) -> Traced:
    """A parameter, or a row of `count` of them."""
    entries = _nodes_of(np.array([leaf("p", first + d) for d in range(count or 1)], dtype=object))
    return Traced(entries if count is not None else entries[0:1].reshape(()))


def rows_for(*lengths: int) -> int:
    """How many points to trace with: a number that is none of the lengths of a problem."""
    return next(rows for rows in ROWS if rows not in lengths)


def traced(
    name: str,
    function: Callable[..., Any],
    rows: int,
    arguments: Sequence[Any],
    shape: Sequence[int] | None,
    per_point: bool,
) -> tuple[list[Node], tuple[int, ...]]:
    """The nodes of what a function answers for one point, in the order of `shape`, flattened.

    Parameters
    ----------
    name : str
        Of the function, in errors.
    rows : int
        How many points are among the arguments.
    shape : of the answer for one point.
    per_point : bool
        Whether the answer has a leading dimension for the points.

    Raises
    ------
    NotTraced
        Where the function does something that formulas do not know, treats points differently, or answers another shape.
    """
    _state.refused, _state.made = [], 0
    failed: Exception | None = None
    try:
        with _replaced(rows):
            answer = entries_of(function(*arguments))
    except Exception as error:
        failed = error
    finally:
        refused, _state.refused = _state.refused, None
    if refused:  # also where the function has caught it and gone another way
        what, place = refused[0]
        raise NotTraced(f"{name} cannot be read as a formula: {place}: {what}") from None
    if failed is not None:
        raise failed
    one = answer.shape[1:] if per_point else answer.shape
    if (shape is not None and one != tuple(shape)) or (per_point and answer.shape[:1] != (rows,)):
        shown = tuple("M" if per_point and not k and n == rows else n for k, n in enumerate(answer.shape))
        raise ValueError(f"{name} must return shape {('M', *(shape or ('...',))) if per_point else shape}, got {shown}")
    answer = answer.reshape(rows if per_point else 1, -1)
    for row in range(1, len(answer)):
        if not _alike(answer[0], answer[row], row):
            raise NotTraced(f"{name} treats points differently: what it answers for one must depend on that one alone")
    return list(answer[0]), one


def _alike(first: Any, other: Any, row: int) -> bool:
    """Whether the nodes of another row are those of the first with its coordinates."""
    seen, stack = set(), list(zip(first, other, strict=True))
    while stack:
        a, b = pair = stack.pop()
        if pair in seen:
            continue
        seen.add(pair)
        if a.op == "x":
            if b.op != "x" or a.value[1] != 0 or b.value != (a.value[0], row):
                return False
        elif a.op != b.op or len(a.args) != len(b.args) or (a.value is not b.value and repr(a.value) != repr(b.value)):
            return False
        stack.extend(zip(a.args, b.args, strict=True))
    return True


def gridded_entries(columns: Sequence[Any], table: Any) -> Any:
    """A look-up at traced coordinates."""
    arrays = np.broadcast_arrays(*map(entries_of, columns))
    out = np.empty(arrays[0].shape, object)
    out.flat[:] = [
        interned("gridded", entries, table) for entries in zip(*(array.flat for array in arrays), strict=True)
    ]
    return Traced(out)
