"""Arrays whose entries are nodes: NumPy's operations on them build the graph of what a function computes.

Entries lie in object arrays, so shapes, views, layouts and writing into them are NumPy's own; which type an answer has
(float64, int64 or bool) NumPy says, too. What is not known refuses, and a refusal counts even where the function
catches it.
"""

import functools
import os
import sysconfig
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.array_utils import normalize_axis_tuple
from numpy.lib.mixins import NDArrayOperatorsMixin

from sdhj.formulas import narrowing
from sdhj.formulas.graph import Node, constant, make, power
from sdhj.formulas.rules import RULES

MOST_NODES = 200_000  # entries that one function may compute
HERE = f"{Path(__file__).parent.parent}{os.sep}"  # the package: what is wrong stands in the frames of its users
PACKAGES = tuple(f"{os.sep}{name}{os.sep}" for name in ("site-packages", "dist-packages"))
FLOAT, WHOLE, TRUTH = np.dtype(np.float64), np.dtype(np.int64), np.dtype(np.bool_)
SILENT = np.errstate(all="ignore")  # NumPy looks at the processor's flags, which constants that are NaN may have set


class _State(threading.local):
    """The trace under way in a thread, one call of a user's function."""

    trace: int | None = None  # the trace's number, None outside of a trace; arrays of another trace are refused
    refused: list[tuple[str, str]]  # each refusal in the trace: its message, and the user's file and line
    made = 0  # how many entries the trace has computed; at most `MOST_NODES`


state = _State()


class NotTraced(ValueError):
    """Something in a function that formulas do not know: what, and how to write it.

    Examples
    --------
    A function that decides by a number that is known only later:

    >>> import sdhj
    >>> try:
    ...     sdhj.UnsafeSet((0,), lambda p, t: p[:, 0] if p[0, 0] > 0 else -p[:, 0])
    ... except sdhj.NotTraced as error:
    ...     print("not read")
    not read
    """

    def __init__(self, what: str, instead: str = "") -> None:
        super().__init__(f"{what}; {instead}" if instead else what)
        # also where the function catches it: `_traced_answer` looks at these
        if state.trace is not None:
            state.refused.append((str(self), _users_line()))


@functools.cache
def installed(file: str) -> bool:
    """Whether a file belongs to Python's library or to an installed package."""
    return any(folder in file for folder in PACKAGES) or file.startswith(sysconfig.get_path("stdlib"))


def _users_line() -> str:
    """The words "file NAME, line N" for the innermost frame that is neither this package's nor installed."""
    frames = [one for one in traceback.extract_stack() if not one.filename.startswith((HERE, "<__array_function__"))]
    ours = [one for one in frames if not installed(one.filename)]
    written = [one for one in ours if one.line]  # not what dataclasses have made of a text
    return "file {0.filename}, line {0.lineno}".format((written or ours or frames)[-1])


def raising_not_traced(method: Callable[..., Any]) -> Callable[..., Any]:
    """The method, whose exceptions become `NotTraced`, so that the trace under way counts them as refusals."""

    @functools.wraps(method)
    def watched(*args: Any, **options: Any) -> Any:
        try:
            return method(*args, **options)
        # It has advice of its own.
        except NotTraced:
            raise
        except Exception as error:
            raise NotTraced(f"{type(error).__name__}: {error}", SHAPES if "shape" in str(error) else "") from error

    return watched


WHERE = "use np.where(condition, one, other), np.maximum and np.minimum, and NumPy's functions in place of math's"
MASK = "out[mask] = x[mask] is out = np.where(mask, x, out), and x[mask] alone has no shape that is known"
NUMPYS = "use np.sin, np.floor, ... of it, and np.array([x, y]) in place of writing into np.zeros(2)"
ARRAYS = "use np.stack, or write into np.zeros((len(points), ...)); import numpy at the top of the file"
AT_ONCE = "a function gets all states at once: points are (M, n), column k is points[:, k]"
SHAPES = f"{AT_ONCE}; np.full_like(other, number) has the shape of another"
UNCOMPILED = "let it stand uncompiled"
SINGLE = (
    "one truth value, as t > 1 is, is a number to Python: ~True is -2, and True + True 2; write t <= 1 in place of "
    "~(t > 1), np.logical_not, np.logical_or, or np.where(t > 1, 1.0, 0.0) for a number"
)
DEFINED = "np.where(divisor > 1e-3, number / divisor, other) is defined everywhere, and has bounds"
ADVICE = {
    **dict.fromkeys(("isnan", "isinf", "isfinite", "nan_to_num", "divide"), DEFINED),
    **dict.fromkeys(("argmin", "argmax", "argsort"), "np.min and np.max along an axis are known"),
    **dict.fromkeys(("digitize", "searchsorted"), "a sum of np.where(x >= edge, 1.0, 0.0) counts edges"),
    **dict.fromkeys(("copyto", "putmask", "place", "choose"), WHERE),
    **dict.fromkeys(("copysign", "signbit"), "a zero has no sign here: np.where(b < 0, -abs(a), abs(a))"),
    **dict.fromkeys(("solve", "inv", "det"), "solve it by hand, or outside of the function where it is constant"),
    **dict.fromkeys(("arcsinh", "arccosh", "arctanh"), "np.log is known: arcsinh(x) is np.log(x + np.sqrt(x**2 + 1))"),
    "sinc": "np.where(x != 0, np.sin(np.pi * x) / (np.pi * x), 1) is known",
    "average": "np.sum(weights * x, axis=1) / np.sum(weights) is known",
    "piecewise": "np.select(conditions, values) is known",
    "linspace": "np.linspace(0.0, 1.0, count) * end is known",
    "apply_along_axis": "np.array([f(row) for row in points]) is known",
}  # what to write in place of functions that people use
DEFAULTS = {"out": None, "initial": None, "dtype": None, "where": True}  # options that say what holds without them


def _unknown(name: str, options: dict[str, Any], module: str = "numpy") -> NotTraced:
    """The error for the function `module.name` with these options, with advice from `ADVICE`."""
    given = f" with {', '.join(sorted(options))}" if options else ""
    return NotTraced(f"{module}.{name}{given}", ADVICE.get(name.partition(".")[0], ""))


def _refused(what: str, instead: str) -> Any:
    """A method that raises `NotTraced(what, instead)`, whatever its arguments are."""

    def refuse(*_: Any, **__: Any) -> Any:
        raise NotTraced(what, instead)

    return refuse


class Traced(NDArrayOperatorsMixin):
    """An array of nodes that stands for NumPy's array of the values while a function is traced.

    What depends on values, as a decision does, or has no rule, raises NotTraced; so does an array kept from another
    trace.
    """

    __array_priority__ = 2000

    def __init__(self, entries: Any, dtype: Any = FLOAT) -> None:
        if dtype not in (FLOAT, WHOLE, TRUTH):
            raise NotTraced(f"numbers of type {dtype}", "formulas compute with float64: write .astype(float)")
        # an object array of nodes, read-only for an argument of the function, and for a number that is no array
        self.entries = entries
        self.dtype = np.dtype(dtype)  # the type that NumPy's array has
        self.trace = state.trace  # the number of the trace in which it was made; None outside of a trace

    @property  # type: ignore[misc]
    def __class__(self) -> Any:  # isinstance(points, np.ndarray) is true
        """What `isinstance` sees: np.ndarray, or NumPy's scalar type for read-only entries without dimensions."""
        numbers = {FLOAT: np.float64, WHOLE: np.int64, TRUTH: np.bool_}
        return np.ndarray if self.entries.ndim or self.entries.flags.writeable else numbers[self.dtype]

    shape = property(lambda self: self.entries.shape)
    ndim = property(lambda self: self.entries.ndim)
    size = property(lambda self: self.entries.size)
    T = property(lambda self: self._rearranged("transpose"))
    real = property(lambda self: self)

    __bool__ = __contains__ = __hash__ = __reduce_ex__ = _refused(
        "a decision (if, and, or, min, max, while) or a conversion, which needs a value", WHERE
    )
    __int__ = __float__ = __index__ = __complex__ = __round__ = __trunc__ = __floor__ = __ceil__ = _refused(
        "a conversion to a plain number, by math, int, an index or writing into a plain array", NUMPYS
    )
    __array__ = _refused("a conversion to a plain array", ARRAYS)
    __str__ = __format__ = _refused(
        "a text of values, by print or an f-string", "when a function is read, there are none"
    )

    def __repr__(self) -> str:
        return f"<traced array of shape {self.shape}>"

    def __len__(self) -> int:
        return len(self.entries)

    def __iter__(self) -> Iterator["Traced"]:
        return (self[k] for k in range(len(self)))

    @raising_not_traced
    def __getitem__(self, at: Any) -> "Traced":
        """The entries at an index that is not traced: a view or a copy, as NumPy's."""
        if holds_traced(at):
            raise NotTraced("an index or a mask that depends on values", MASK)
        return _wrapped(entries_of(self)[at], self.dtype)

    @raising_not_traced
    def __setitem__(self, at: Any, value: Any) -> None:
        """Write values in place at an index; by a traced mask of this shape, one value, chosen at each entry."""
        if not self.entries.flags.writeable:
            raise NotTraced("writing into an argument", "write into a copy, for example points = points.copy()")
        value = written_as(traced_array(value), self.dtype).entries
        if isinstance(at, Traced):
            if at.dtype != TRUTH or value.ndim or at.shape != self.shape:
                raise NotTraced("writing where values say so", MASK)
            # NumPy would write where the mask is true; here each entry becomes a choice, so all of them are written
            # (`...`)
            value, at = mapped(narrowing.where, entries_of(at), value, self.entries), ...
        elif holds_traced(at):
            raise NotTraced("writing where values say so", MASK)
        self.entries[at] = value if value.ndim else value[()]

    @raising_not_traced
    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, out: Any = None, **options: Any) -> Any:
        """The answer of a NumPy ufunc, made of nodes entry by entry; a pair for np.divmod.

        The method is "__call__", "outer", or "reduce" of ufuncs in `REDUCED`.
        """
        options = _without_defaults(options)
        if not isinstance(ufunc, np.ufunc):
            raise NotTraced("a call of compiled code", UNCOMPILED)
        if method == "reduce" and ufunc in REDUCED and out is None:
            # a ufunc's own reduce has the axis 0 by default, where np.sum and its like take all
            return _reduced(ufunc, *inputs, **{"axis": 0} | options)
        if ufunc is np.divmod and method == "__call__" and not options and out is None:
            return np.floor_divide(*inputs), np.remainder(*inputs)
        if method not in ("__call__", "outer") or options:
            raise _unknown(ufunc.__name__ if method == "__call__" else f"{ufunc.__name__}.{method}", options)
        # Python repeats a list so many times, and asks NumPy where the number is traced.
        whole = any(isinstance(one, Traced) and not one.ndim and one.dtype != FLOAT for one in inputs)
        if ufunc is np.multiply and whole and any(isinstance(one, list | tuple) for one in inputs):
            raise NotTraced("a list times a whole number, which repeats it", "np.array(list) * number multiplies")
        arrays = [traced_array(one) for one in inputs]
        if method == "outer":
            arrays[0] = arrays[0].reshape(*arrays[0].shape, *[1] * arrays[1].ndim)
        answer = _computed(ufunc, arrays, _type_of(ufunc, inputs))
        return _sealed_number(answer) if out is None or out[0] is None else _written_into(answer, out[0])

    @raising_not_traced
    def __array_function__(self, function: Any, types: Any, args: Any, options: Any) -> Any:
        """The answer of a NumPy function that is no ufunc: its substitute's (`FUNCTIONS`), or its own (`PLACED`)."""
        if function in FUNCTIONS:
            try:
                return FUNCTIONS[function](*args, **(options := _without_defaults(options)))
            except TypeError as error:
                raise _unknown(function.__name__, options) from error
        if function not in PLACED or options.keys() & {"out", "dtype", "casting", "mode"}:
            raise _unknown(function.__name__, options, function.__module__)
        # those move entries and compute nothing
        # of what joins arrays the type is that of all together, of the rest that of the array itself
        joined = args[0] if function in JOINING else args[:2] if function is np.append else [self]
        kind = np.result_type(*map(weak_type, joined))
        return _wrapped(
            function(*map(_with_entries, args), **{name: _with_entries(one) for name, one in options.items()}), kind
        )

    @raising_not_traced
    def astype(self, dtype: Any, *, copy: bool = True) -> "Traced":
        """A copy as float64, int64 or bool; the array itself where `copy` is false and it has the type."""
        if not copy and np.dtype(dtype) == self.dtype:
            return self
        return written_as(self, np.dtype(dtype)).copy("K")

    def copy(self, order: Any = "C") -> "Traced":
        """A writable copy of the array in NumPy's memory order."""
        return Traced(entries_of(self).copy(order), self.dtype)

    def __deepcopy__(self, _: Any = None) -> "Traced":
        """A writable copy of the array; its nodes, which are immutable, are shared."""
        return self.copy("K")

    __copy__ = __deepcopy__

    def __getattr__(self, name: str) -> Any:
        """A method of NumPy's arrays, by NumPy's function of that name; others are refused with advice."""
        if name in ("sum", "prod", "cumsum", "mean", "var", "std", "min", "max", "any", "all", "clip", "dot", "round"):
            return functools.partial(getattr(np, name), self)
        if name in ("flatten", "diagonal", "reshape", "ravel", "transpose", "squeeze", "take", "swapaxes", "repeat"):
            return functools.partial(self._rearranged, name)
        # who looks for one of these takes an AttributeError for a no; a NotTraced would count as a refusal
        if name.startswith("__"):
            raise AttributeError(name)
        if name == "_numba_type_":
            raise NotTraced("a call of compiled code", f"{UNCOMPILED}: its py_func attribute is the function")
        raise NotTraced(f"the attribute {name!r} of an array", ADVICE.get(name, ""))

    @raising_not_traced
    def _rearranged(self, name: str, *args: Any, **options: Any) -> "Traced":
        """The answer of a method of NumPy's arrays that moves entries alone."""
        return _wrapped(getattr(entries_of(self), name)(*args, **options), self.dtype)


def _without_defaults(options: dict[str, Any]) -> dict[str, Any]:
    """The options of a call, without those that are not given (np._NoValue) or equal `DEFAULTS`."""
    left = {name: value for name, value in options.items() if value is not np._NoValue}
    return {name: value for name, value in left.items() if name not in DEFAULTS or value is not DEFAULTS[name]}


def holds_traced(value: Any) -> bool:
    """Whether a value is a traced array, or has one in it at any depth."""
    if isinstance(value, list | tuple):
        return any(map(holds_traced, value))
    return isinstance(value, Traced)


def _with_entries(value: Any) -> Any:
    """An argument with traced arrays as object arrays of nodes: so NumPy's functions move entries."""
    if isinstance(value, list | tuple):
        return type(value)(map(_with_entries, value)) if holds_traced(value) else value
    return entries_of(value) if isinstance(value, Traced) else value


def _wrapped(answer: Any, dtype: Any = FLOAT) -> Any:
    """What a NumPy function made of object arrays, as traced arrays; a single entry becomes a read-only number."""
    if isinstance(answer, list | tuple):
        return type(answer)(_wrapped(one, dtype) for one in answer)
    if isinstance(answer, np.ndarray):
        # What does not hang on entries, as `np.ones_like`, is plain numbers, which become constants.
        nodes = answer.dtype == object and all(isinstance(one, Node) for one in answer.flat)
        return Traced(answer if nodes else _nodes_of(answer), dtype)
    return _sealed_number(Traced(_nodes_of(np.array(answer, dtype=object)), dtype))


def _sealed_number(array: Traced) -> Traced:
    """The same traced array, made read-only if it has no dimensions, as NumPy's numbers are."""
    if not array.ndim:
        array.entries.setflags(write=False)
    return array


def _nodes_of(array: Any) -> Any:
    """A new object array of nodes, of numbers and nodes; -0.0 becomes 0."""
    out = np.empty_like(array, dtype=object, subok=False)
    out.flat[:] = [v if isinstance(v, Node) else constant(v) for v in array.ravel().tolist()]
    return out


def traced_array(value: Any) -> Traced:
    """A value as a traced array: an array, a number or a list of such."""
    if isinstance(value, Traced):
        if value.trace != state.trace:
            raise NotTraced("an array that was kept from another call", "compute it anew")
        return value
    if isinstance(value, list | tuple) and holds_traced(value):
        return stacked(value)
    try:
        given = np.asarray(value)
    except ValueError:
        raise NotTraced("lists of different lengths", SHAPES) from None
    # what only converts itself to an array, as a masked one, may compute otherwise than its numbers do
    if type(value) not in (bool, int, float, list, tuple, np.ndarray) and not isinstance(value, np.generic):
        raise NotTraced(f"a {type(value).__name__} in place of numbers", "formulas compute with real numbers")
    if given.dtype.kind not in "biuf" or given.dtype.itemsize > 8:
        raise NotTraced(f"a constant of type {given.dtype}", "formulas compute with real numbers")
    if given.dtype.kind in "iu" and np.any(np.abs(given.astype(np.float64)) > 2**53):
        raise NotTraced("a whole number above 2^53", "formulas compute in double precision")
    return Traced(_nodes_of(given), {"b": TRUTH, "f": FLOAT}.get(given.dtype.kind, WHOLE))


def stacked(values: Any) -> Traced:
    """A list of values of one shape as one traced array with a new first axis."""
    arrays = list(map(traced_array, values))
    if len({one.shape for one in arrays}) > 1:
        raise NotTraced("a list of arrays of different shapes", SHAPES)
    return Traced(np.stack([one.entries for one in arrays]), np.result_type(*map(weak_type, values)))


def entries_of(value: Any) -> Any:
    """The object array of nodes of a value, not copied."""
    return traced_array(value).entries


def weak_type(value: Any) -> Any:
    """What np.result_type must be given for an operand, so that types are promoted as in the untraced call.

    Of Python's numbers, and of the time, which is one then, it takes the kind alone.
    """
    # the time is a Python number when points are plain; no other number without axes loses by it, as formulas have no
    # narrower floats (`written_as`)
    if isinstance(value, Traced):
        return value.dtype if value.ndim or value.dtype != FLOAT else 0.0
    if isinstance(value, list | tuple) and holds_traced(value):
        return traced_array(value).dtype
    return value if type(value) in (int, float) else np.asarray(value).dtype


def _type_of(ufunc: Any, inputs: Sequence[Any]) -> Any:
    """The dtype of a ufunc's answer for these inputs, the last of several."""
    # as np.matmul has one
    if ufunc.signature is not None:
        return np.result_type(*map(weak_type, inputs))
    kinds = [type(one) if isinstance(one, int | float) else one for one in map(weak_type, inputs)]
    return ufunc.resolve_dtypes((*kinds, *[None] * ufunc.nout))[-1]


def written_as(array: Traced, dtype: Any) -> Traced:
    """A traced array converted to a dtype, as NumPy does when it writes into an array."""
    # Numbers of a narrower dtype are nodes already, so nothing is computed.
    if array.dtype == dtype or (array.dtype, dtype) in ((TRUTH, WHOLE), (TRUTH, FLOAT), (WHOLE, FLOAT)):
        return Traced(array.entries, dtype)
    if dtype == TRUTH:
        return Traced(_truths(array), TRUTH)
    instead = "np.floor or np.trunc makes a number whole" if dtype == WHOLE else "formulas compute with float64"
    raise NotTraced(f"a conversion of {array.dtype} to {dtype}", instead)


def _written_into(answer: Traced, out: Any) -> Traced:
    """Write an answer into `out` in place, as out= and += do; of a read-only number the answer."""
    if not isinstance(out, Traced):
        raise NotTraced("writing a result into a plain array", "let the function return a new one")
    if not out.ndim and not out.entries.flags.writeable:  # x += 1 of a number
        return _sealed_number(answer)
    if not np.can_cast(answer.dtype, out.dtype, "same_kind"):
        raise NotTraced(f"writing numbers of type {answer.dtype} into an array of {out.dtype}")
    out[...] = answer
    return out


# ---- operations


@SILENT
def mapped(function: Callable[..., Node], *arrays: Any) -> Any:
    """A function of nodes applied to the entries of object arrays, broadcast and counted."""
    if state.trace is not None:  # not what is made of formulas, of which a process makes any number
        state.made += np.broadcast(*arrays).size
    if state.made > MOST_NODES:
        raise NotTraced(f"more than {MOST_NODES:,} operations", "use sdhj.gridded for a table")
    return np.asarray(np.frompyfunc(function, len(arrays), 1)(*arrays), dtype=object)


def _truths(array: Any) -> Any:
    """Truth nodes: of each entry whether it is not 0."""
    zero = constant(0.0)
    return mapped(lambda one: one if one.truth else make("not", make("equal", one, zero)), traced_array(array).entries)


def _computed(ufunc: Any, arrays: Sequence[Traced], dtype: Any) -> Traced:
    """The answer, of this dtype, of a ufunc of traced arrays, entry by entry; of np.matmul the product."""
    if ufunc in COUNTING and all(one.dtype == TRUTH and not one.ndim for one in arrays):
        raise NotTraced(f"numpy.{ufunc.__name__} of {'truth values' if len(arrays) > 1 else 'a truth value'}", SINGLE)
    if ufunc is np.matmul:
        return _summed(np.matmul, *arrays)
    if dtype == TRUTH and ufunc in LOGICAL:
        return Traced(mapped(LOGICAL[ufunc], *map(_truths, arrays)), TRUTH)
    if dtype == TRUTH and ufunc in COMPARED:
        return COMPARED[ufunc](*arrays)
    # Whole numbers are computed as floats, so only where that is exact (`Rule.whole`).
    if ufunc in OPERATIONS and (dtype == FLOAT or ufunc in EXACT):
        return Traced(mapped(OPERATIONS[ufunc], *(one.entries for one in arrays)), dtype)
    if ufunc in MADE and dtype == FLOAT:
        return MADE[ufunc](*(Traced(one.entries) for one in arrays))
    name = f"{'numpy.' * hasattr(np, ufunc.__name__)}{ufunc.__name__}"
    if ufunc not in LOGICAL.keys() | COMPARED.keys() | OPERATIONS.keys() | MADE.keys():
        raise NotTraced(name, ADVICE.get(ufunc.__name__, ""))
    # it has a rule, but none for an answer of this type
    kinds = ", ".join(str(one.dtype) for one in arrays)
    what = f"{name} of {kinds} with an answer of {dtype}"
    raise NotTraced(what, "np.where(condition, 1.0, 0.0) is a number, and 1.0 in place of 1")


def _read_as(truths: bool) -> dict[Any, Callable[..., Node]]:
    """{NumPy's ufunc: what makes its node}, of the operations whose operands are truth values, or of all others."""
    rules = [rule for rule in RULES.values() if bool(rule.truths) == truths]
    return {getattr(np, name): functools.partial(make, rule.name) for rule in rules for name in rule.ufuncs.split()}


OPERATIONS = _read_as(False) | {np.divide: narrowing.quotient, np.power: power, np.float_power: power}
LOGICAL = _read_as(True)
EXACT = {getattr(np, rule.ufuncs.split()[0]) for rule in RULES.values() if rule.whole}


def _rint(a: Any) -> Any:
    """The nearest whole number, the even one of two; the clipping keeps intervals narrow and changes no value."""
    whole = np.floor(a)
    part = a - whole
    nearest = np.where(part < 0.5, whole, np.where(part > 0.5, whole + 1.0, whole + np.remainder(whole, 2.0)))
    return np.clip(nearest, whole, np.ceil(a))


COMPARED: dict[Any, Callable[..., Any]] = {
    **{
        np.greater: lambda a, b: b < a,
        np.greater_equal: lambda a, b: b <= a,
        np.not_equal: lambda a, b: np.logical_not(a == b),
    },
    **{np.bitwise_xor: lambda a, b: a != b, np.logical_xor: lambda a, b: a.astype(bool) != b.astype(bool)},
}
MADE: dict[Any, Callable[..., Any]] = {
    np.positive: lambda a: a.copy("K"),
    np.ceil: lambda a: -np.floor(-a),
    np.rint: _rint,
    np.trunc: lambda a: np.where(a < 0.0, -np.floor(-a), np.floor(a)),
    np.reciprocal: lambda a: 1.0 / a,
    np.heaviside: lambda a, at_zero: np.where(a < 0.0, 0.0, np.where(a > 0.0, 1.0, at_zero)),
    np.floor_divide: lambda a, b: np.floor((a - np.remainder(a, b)) / b + 0.5),  # 1 // 0.1 is 9
    np.fmod: lambda a, b: np.where(a < 0.0, -np.remainder(-a, abs(b)), np.remainder(a, abs(b))),
    np.sinh: lambda a: (np.exp(a) - np.exp(-a)) / 2.0,
    np.cosh: lambda a: (np.exp(a) + np.exp(-a)) / 2.0,
    np.exp2: lambda a: 2.0**a,
    np.expm1: lambda a: np.exp(a) - 1.0,
    np.log1p: lambda a: np.log(1.0 + a),
    np.log2: lambda a: np.log(a) / np.log(2.0),
    np.log10: lambda a: np.log(a) / np.log(10.0),
    np.logaddexp: lambda a, b: np.maximum(a, b) + np.log1p(np.exp(-abs(a - b))),
    np.cbrt: lambda a: np.sign(a) * abs(a) ** (1 / 3) * abs(a) ** 1.850371707708594e-17,  # 1/3 and what it is short of
    **dict.fromkeys((np.deg2rad, np.radians), lambda a: a * (np.pi / 180.0)),
    **dict.fromkeys((np.rad2deg, np.degrees), lambda a: a * (180.0 / np.pi)),
}
COUNTING = {np.invert, np.add}  # of Python's truth values, which comparisons of the time are: ~True is -2
REDUCED = (np.add, np.multiply, np.minimum, np.maximum, np.fmin, np.fmax, np.logical_or, np.logical_and)


def _counted(array: Traced) -> Traced:
    """Truth values as int64, as NumPy does before it sums them."""
    return array.astype(np.int64) if array.dtype == TRUTH else array


@SILENT
def _reduced(ufunc: Any, array: Any, axis: Any = None, keepdims: bool = False) -> Traced:
    """The reduction of an array by a ufunc of `REDUCED`, along one axis, several, or all (None)."""
    array = traced_array(array)
    if ufunc in (np.logical_or, np.logical_and):
        array = array.astype(bool)
    elif ufunc in (np.add, np.multiply):
        array = _counted(array)
    places = range(array.ndim) if axis is None else normalize_axis_tuple(axis, array.ndim)
    join = (LOGICAL if array.dtype == TRUTH else OPERATIONS)[ufunc]
    # without an identity, as of min and max, NumPy refuses to reduce an axis of length 0
    nothing = {np.add: constant(0.0), np.multiply: constant(1.0)}.get(ufunc)
    joined, entries = np.frompyfunc(join, 2, 1, identity=nothing), array.entries.copy("K")
    # the last axis first, so that the numbers of those that are left stay right
    for place in sorted(places, reverse=True):
        entries = np.asarray(joined.reduce(entries, axis=place, keepdims=keepdims), dtype=object)
    return _sealed_number(Traced(entries, array.dtype))


def _reducing(ufunc: Any) -> Callable[..., Traced]:
    """A function that reduces by a ufunc of `REDUCED`, as np.sum does by np.add."""
    return lambda a, axis=None, *, keepdims=False: _reduced(ufunc, a, axis, keepdims)


def _mean(a: Any, axis: Any = None, *, keepdims: bool = False) -> Traced:
    """numpy.mean: sum(a) / n over one axis, several, or, for None, all."""
    total = _reduced(np.add, a, axis, keepdims)
    return total / (np.float64(traced_array(a).size) / total.size)


def _norm(x: Any, ord: Any = None, axis: Any = None, keepdims: bool = False) -> Any:
    """numpy.linalg.norm along one axis, or of all entries: sqrt(sum x^2), sum |x| (1) or max |x| (inf)."""
    array = traced_array(x)
    # a matrix without an axis has norms of other kinds, but the one of order None is that of all its entries
    vector = (axis is not None and not isinstance(axis, tuple)) or (axis is None and (array.ndim == 1 or ord is None))
    if not vector or ord not in (None, 1, 2, np.inf):
        raise NotTraced(f"numpy.linalg.norm of order {ord} along {axis}")
    array = array.astype(np.float64)
    if ord in (1, np.inf):
        return _reduced(np.add if ord == 1 else np.maximum, abs(array), axis, keepdims)
    return np.sqrt(_reduced(np.add, np.square(array), axis, keepdims))


def _where(condition: Any, *branches: Any) -> Traced:
    """numpy.where; numbers as a condition are true where they are not 0."""
    if len(branches) != 2:
        raise NotTraced("numpy.where of a condition alone", WHERE)
    entries = mapped(narrowing.where, _truths(condition), *map(entries_of, branches))
    return Traced(entries, np.result_type(*map(weak_type, branches)))


def _clip(a: Any, a_min: Any = None, a_max: Any = None, *, min: Any = None, max: Any = None) -> Any:
    """numpy.clip: min(max(a, least), most), a bound that is None left out."""
    least, most = (b if a is None else a for a, b in ((a_min, min), (a_max, max)))
    if least is None and most is None:
        raise NotTraced("numpy.clip without bounds")
    a = a if least is None else np.maximum(a, least)
    return a if most is None else np.minimum(a, most)


def _select(condlist: Any, choicelist: Any, default: Any = 0.0) -> Any:
    """numpy.select: the choice that belongs to the first true condition, else the default."""
    if any(traced_array(one).dtype != TRUTH for one in condlist):
        raise NotTraced("numpy.select by numbers", "compare them first")
    kind = np.result_type(*map(weak_type, [*choicelist, default]))
    pairs = reversed([*zip(condlist, choicelist, strict=True)])
    return Traced(reduce(lambda rest, pair: _where(*pair, rest), pairs, default).entries, kind)


def _round(a: Any, decimals: int = 0) -> Any:
    """numpy.round of traced floats: rint(a 10^decimals) / 10^decimals."""
    if a.dtype != FLOAT or holds_traced(decimals):
        raise NotTraced(f"numpy.round of {a.dtype}")
    # a power of ten below 1 is not exact, so for negative decimals it divides first, as NumPy does
    scale = 10.0 ** abs(decimals)
    return np.rint(a * scale) / scale if decimals >= 0 else np.rint(a / scale) * scale


def _interp(x: Any, xp: Any, fp: Any) -> Any:
    """numpy.interp of a table of constants: linear between ascending points xp, constant beyond them."""
    if holds_traced([xp, fp]) or not (np.diff(xp) > 0).all():
        raise NotTraced("numpy.interp of a table that is not ascending constants")
    xp, fp = np.asarray(xp, dtype=np.float64), np.asarray(fp, dtype=np.float64)
    x = np.clip(x, xp[0], xp[-1])
    slopes, out = np.diff(fp) / np.diff(xp), fp[-1]
    # x is clipped to its piece once more, as bounds over a box would else be those of the piece's whole line
    for k in reversed(range(len(slopes))):
        out = np.where(x < xp[k + 1], fp[k] + slopes[k] * (np.clip(x, xp[k], xp[k + 1]) - xp[k]), out)
    return out


def _full_like(a: Any, fill_value: Any, dtype: Any = None) -> Traced:
    """numpy.full_like of a traced array."""
    room, fill = np.empty_like(entries_of(a)), traced_array(fill_value)
    fill = written_as(fill, np.dtype(dtype or traced_array(a).dtype))
    room[...] = fill.entries if fill.ndim else fill.entries[()]
    return Traced(room, fill.dtype)


@SILENT
def _summed(function: Any, *args: Any) -> Any:
    """The traced answer of a NumPy function that only multiplies, adds and subtracts, as np.dot."""
    kind = np.result_type(*(weak_type(one) for one in args if not isinstance(one, str)))
    if kind == TRUTH:
        raise NotTraced("a product or difference of truth values", "np.where(condition, 1.0, 0.0) is a number")
    # NumPy calls `+`, `-` and `*` of the nodes: a function that does anything else with entries fails
    answer = _wrapped(function(*(one if isinstance(one, str) else entries_of(one) for one in args)), kind)
    return _sealed_number(answer)


FUNCTIONS: dict[Any, Callable[..., Any]] = {
    **{np.sum: _reducing(np.add), np.prod: _reducing(np.multiply), np.mean: _mean, np.linalg.norm: _norm},
    **dict.fromkeys((np.min, np.amin), _reducing(np.minimum)),
    **dict.fromkeys((np.max, np.amax), _reducing(np.maximum)),
    **{np.any: _reducing(np.logical_or), np.all: _reducing(np.logical_and), np.full_like: _full_like},
    **{np.where: _where, np.clip: _clip, np.select: _select, np.interp: _interp},
    np.var: lambda a, axis=None, *, keepdims=False: np.mean(
        np.square(a - np.mean(a, axis=axis, keepdims=True)), axis=axis, keepdims=keepdims
    ),
    np.std: lambda a, axis=None, *, keepdims=False: np.sqrt(np.var(a, axis=axis, keepdims=keepdims)),
    np.ptp: lambda a, axis=None: np.max(a, axis=axis) - np.min(a, axis=axis),
    np.zeros_like: lambda a, dtype=None: _full_like(a, 0, dtype),
    np.ones_like: lambda a, dtype=None: _full_like(a, 1, dtype),
    # of what is undefined until it is written
    np.empty_like: lambda a, dtype=None: Traced(_full_like(a, np.nan, FLOAT).entries, dtype or traced_array(a).dtype),
    **{one: lambda a, b, one=one: _summed(one, a, b) for one in (np.dot, np.inner, np.outer, np.cross)},
    np.einsum: lambda *args, optimize=False: _summed(np.einsum, *args),
    np.tensordot: lambda a, b, axes=2: _summed(functools.partial(np.tensordot, axes=axes), a, b),
    np.diff: lambda a, n=1, axis=-1: _summed(functools.partial(np.diff, n=n, axis=axis), a),
    np.cumsum: lambda a, axis=None: _summed(functools.partial(np.cumsum, axis=axis), _counted(traced_array(a))),
    np.broadcast_arrays: lambda *args: tuple(
        _wrapped(one, np.result_type(weak_type(given)))
        for one, given in zip(np.broadcast_arrays(*map(entries_of, args)), args, strict=True)
    ),
    **dict.fromkeys((np.round, np.around), _round),
    np.polyval: lambda p, x: reduce(lambda value, coefficient: value * x + coefficient, p, np.zeros_like(x)),
    **{np.shape: lambda a: a.shape, np.ndim: lambda a: a.ndim, np.size: lambda a: a.size},
}
MOVING = "reshape ravel transpose moveaxis swapaxes squeeze expand_dims atleast_1d atleast_2d broadcast_to take roll "
MOVING += "repeat tile flip split hsplit vsplit array_split copy delete append diagonal diag permute_dims unstack "
JOINS = "stack concatenate vstack hstack dstack column_stack concat"
PLACED = {getattr(np, name) for name in (MOVING + JOINS).split() if hasattr(np, name)}
JOINING = {getattr(np, name) for name in JOINS.split() if hasattr(np, name)}
