"""Tracing: a function is called with arrays of nodes, and what it answers is its graph.

Functions that NumPy does not hand on, as np.min([f, g], axis=0) of a list, stand in a module that users' modules
have for numpy while a function is traced; it is as ever for all other arguments and threads.
"""

import itertools
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np
from numba.core.compiler_lock import global_compiler_lock

from sdhj.formulas import arrays
from sdhj.formulas.arrays import FUNCTIONS, REDUCED, TRUTH, NotTraced, Traced, holds_traced, noted, state, traced_array
from sdhj.formulas.graph import Node, leaf, leaves

_numbers = itertools.count(1)

# ---- what is replaced in numpy

LISTS = "min max amin amax sum prod mean var std any all where clip"  # which may be given a list


def _joined(value: Any) -> Any:
    """A list with traced arrays in it as one traced array; anything else as it is."""
    return arrays.stacked(value) if isinstance(value, list | tuple) and holds_traced(value) else value


def _taking_lists(original: Any) -> Callable[..., Any]:
    """A NumPy function, `original`, as one that also takes lists with traced arrays in them."""
    return lambda *args, **options: original(*map(_joined, args), **options)


def _array(value: Any, dtype: Any = None, *, copy: bool | None = True) -> Traced:
    """numpy.array of a traced array or of a list of some, of that dtype, by default its own; without `copy` it
    may be the array itself.
    """
    array = traced_array(value)
    return array.astype(array.dtype if dtype is None else dtype, copy=bool(copy) or not array.ndim)


def _contiguous(value: Any, dtype: Any = None) -> Traced:
    """numpy.ascontiguousarray of a traced array: itself, or a copy in C order, of one dimension at least."""
    array: Any = np.atleast_1d(_array(value, dtype, copy=False))
    return array if array.entries.flags.c_contiguous else array.copy()


def _making_arrays(original: Any, ours: Any) -> Callable[..., Any]:
    """A function that makes arrays: `ours` where the first argument holds something traced, else NumPy's `original`."""
    known = noted(ours)
    return lambda value, *args, **options: (known if holds_traced(value) else original)(value, *args, **options)


def _full(room: Traced, fill_value: Any, dtype: Any = None) -> Any:
    """numpy.full_like of a traced array, `room`, by default of the type of what fills it."""
    return FUNCTIONS[np.full_like](room, fill_value, dtype or np.result_type(arrays.weak_type(fill_value)))


def _allocating(name: str, rows: int, trace: int | None) -> Callable[..., Any]:
    """NumPy's zeros, ones, empty or full (`name`), but, in the trace of this number, traced, so that it can be
    written, where a length is the number of points, `rows`, or an argument is traced.
    """
    original = getattr(np, name)
    filled = noted(_full if name == "full" else FUNCTIONS[getattr(np, f"{name}_like")])

    def make_room(shape: Any, *args: Any, **options: Any) -> Any:
        """NumPy's zeros, ones, empty or full of a shape, with its options: traced where the shape has the number
        of points in it, or an argument is traced.
        """
        lengths = (shape,) if isinstance(shape, int | np.integer) else shape
        kind = options.get("dtype", args[name == "full"] if len(args) > (name == "full") else None)
        if state.trace != trace or kind is object or not (rows in lengths or holds_traced([*args, *options.values()])):
            return original(shape, *args, **options)
        return filled(Traced(np.empty(lengths, object)), *args, **options)

    return make_room


def _repeating(original: Any, rows: int, trace: int | None) -> Callable[..., Any]:
    """NumPy's tile, repeat or broadcast_to, `original`, but, in the trace of this number, a traced answer where
    it has floats and a length is the number of points, `rows`.
    """

    def repeat(*args: Any, **options: Any) -> Any:
        """The original's answer; traced where it has as many rows as there are points."""
        answer = original(*args, **options)
        wanted = state.trace == trace and answer.dtype == np.float64 and rows in answer.shape
        return traced_array(answer) if wanted else answer

    return repeat


class _Joining:
    """Stands for np.c_ or np.r_: what is traced is joined along the last axis, as columns, or along the first."""

    def __init__(self, original: Any) -> None:
        """Stand for `np.r_` or `np.c_`, the original."""
        self.original, self.columns = original, original is np.c_

    def __getitem__(self, at: Any) -> Any:
        """The arrays between the brackets joined: traced if one of them is, else as the original joins them."""
        return self._join(at) if holds_traced([at]) else self.original[at]

    @noted
    def _join(self, at: Any) -> Any:
        """numpy.r_ or numpy.c_ of arrays of which one is traced, or of a single one."""
        parts = [np.atleast_1d(traced_array(one)) for one in (at if isinstance(at, tuple) else (at,))]
        if self.columns:
            parts = [one if one.ndim > 1 else one[:, None] for one in parts]
        return np.concatenate(parts, axis=-self.columns)


class _Replaced:
    """Stands for the module numpy, or something in it: some attributes are replaced, all else is the original's."""

    def __init__(self, original: Any, new: dict[str, Any]) -> None:
        """Stand for a module or function, the original, whose attributes `new` are replaced."""
        vars(self).update(new, _original=original)

    def __getattr__(self, name: str) -> Any:
        """The attribute of that name of the original."""
        return getattr(vars(self)["_original"], name)

    def __call__(self, *args: Any, **options: Any) -> Any:
        """Call the original."""
        return vars(self)["_original"](*args, **options)


def _numpy(rows: int) -> _Replaced:
    """The stand-in for the module numpy while a function is traced with so many rows."""
    as_array = partial(_array, copy=False)
    makers = {"array": _array, "asarray": as_array, "asanyarray": as_array, "ascontiguousarray": _contiguous}
    new: dict[str, Any] = {name: _taking_lists(getattr(np, name)) for name in LISTS.split()}
    new |= {name: _allocating(name, rows, state.trace) for name in ("full", "zeros", "ones", "empty")}
    new |= {name: _repeating(getattr(np, name), rows, state.trace) for name in ("tile", "repeat", "broadcast_to")}
    new |= {name: _Joining(getattr(np, name)) for name in ("c_", "r_")}
    new |= {name: _making_arrays(getattr(np, name), ours) for name, ours in makers.items()}
    new |= {one.__name__: _Replaced(one, {"reduce": _taking_lists(one.reduce)}) for one in REDUCED}
    return _Replaced(np, new | {"linalg": _Replaced(np.linalg, {"norm": _taking_lists(np.linalg.norm)})})


def _globals_of(function: Any) -> list[dict[str, Any]]:
    """The dictionaries of globals in which the name `np` may be looked up by a function or by the user's functions that
    it may call: its own, those of __main__ and of the user's modules.

    Compiled modules are not among them: they take what np.empty gives for an array without a look at it.
    """
    while inner := getattr(function, "__wrapped__", None) or getattr(function, "func", None):
        function = inner
    function = getattr(function, "__func__", function)
    called = function if hasattr(function, "__globals__") else type(function).__call__
    return [getattr(called, "__globals__", {}), vars(sys.modules["__main__"]), *_users_modules()]


_looked: list[Any] = [[], []]  # through which modules; and what was in those of the user


def _users_modules() -> list[dict[str, Any]]:
    """The globals of the user's modules; they are sought again only where a module has come or gone, as that
    takes longer than a trace.
    """
    if _looked[0] != (modules := list(sys.modules.values())):
        _looked[:] = modules, [vars(module) for name, module in list(sys.modules.items()) if _is_users(name, module)]
    return _looked[1]


def _is_users(name: str, module: Any) -> bool:
    """Whether a module is the user's: a Python file that is not installed, nor of this package (but for `sdhj.arm`)."""
    file = getattr(module, "__dict__", {}).get("__file__") or ""
    ours = name.startswith("sdhj.")
    return file.endswith(".py") and (name.startswith("sdhj.arm.") if ours else not arrays.installed(file))


def _places(function: Any) -> list[tuple[dict[str, Any], str]]:
    """(globals, name) of each place at which a function may find the module numpy, under whichever name."""
    return [
        (names, name)
        for names in _globals_of(function)
        for name, value in list(names.items())
        if value is np or (type(value) is _Replaced and value.__dict__["_original"] is np)
    ]


@contextmanager
def _replaced(places: list[tuple[dict[str, Any], str]], rows: int) -> Iterator[None]:
    """Within it the module numpy is replaced at these places by `_numpy(rows)`; no kernel is compiled meanwhile,
    whose code names it.
    """
    with global_compiler_lock:
        new, before = _numpy(rows), [(names, name, names[name]) for names, name in places if name in names]
        try:
            for names, name, _ in before:
                names[name] = new
            yield
        finally:
            for names, name, module in reversed(before):
                names[name] = module


# ---- a function


def points_of(count: int, rows: int) -> Traced:
    """The points that a function is traced with, (rows, count), read-only: entry (row, k) is the leaf of
    coordinate k of that row.
    """
    entries = np.empty((rows, count), object)
    for row in range(rows):
        entries[row] = [leaf("x", k, row) for k in range(count)]
    entries.setflags(write=False)
    return Traced(entries)


def parameter(first: int, count: int | None = None) -> Traced:
    """A traced, read-only number, parameter number `first`; or a row of `count` of them."""
    entries = np.array([leaf("p", first + d) for d in range(count or 1)], dtype=object)
    entries.setflags(write=False)
    return Traced(entries if count is not None else entries.reshape(()))


def rows_for(*lengths: int) -> int:
    """How many points to trace with: the least number from 3 on such that neither it nor the next one is among
    these lengths.
    """
    return next(rows for rows in itertools.count(3) if not {rows, rows + 1}.intersection(lengths))


def traced(
    name: str,
    function: Callable[..., Any],
    rows: int,
    arguments: Callable[[int], Sequence[Any]],
    shape: Sequence[int] | None,
    per_point: bool,
    again: bool = True,
) -> tuple[list[Node], tuple[int, ...]]:
    """The nodes of what a function answers for one point, flattened, and the shape of that; name : of the function, for
    messages.

    It is called with `arguments(rows)`: traced arrays, and numbers or read-only arrays. Its answer has a leading
    dimension where it is `per_point`, which may lack where it reads no point, and then that `shape`, or any for None;
    of a level set, (), it may not. Called `again` with one point more it answers differently where it hangs on their
    number, on chance, or on earlier calls.

    NotTraced where the function does something that formulas do not know, or treats points differently; ValueError
    where its answer has another shape.
    """
    found, places = list[list[Node]](), _places(function)
    try:
        for count in (rows, rows + 1) if again else (rows,):
            answer = _traced_answer(name, function, count, arguments, places)
            alone = answer.ndim == 1 if shape is None else bool(shape) and answer.shape == tuple(shape)
            if per_point and alone and not leaves(answer.flat, "x"):  # one value for all points
                answer = np.broadcast_to(answer, (count, *answer.shape))
            one = answer.shape[1:] if per_point else answer.shape
            if (shape is not None and one != tuple(shape)) or (per_point and answer.shape[:1] != (count,)):
                shown = tuple("M" if per_point and not k and n == count else n for k, n in enumerate(answer.shape))
                wanted = ("M",) * per_point + tuple(shape or ())
                columns = "; points have shape (M, n), and their column k is points[:, k]" if per_point else ""
                shapes = f"shape {wanted}, got {shown}".replace("'M'", "M")
                raise ValueError(f"{name} must return {shapes}{columns}")
            answer = answer.reshape(count if per_point else 1, -1)
            if not all(_alike(answer[0], nodes, row) for row, nodes in enumerate(answer)):
                raise NotTraced(f"{name} treats points differently: what it answers for one may depend on no other")
            found.append(list(answer[0]))
        if found[0] != found[-1]:
            raise NotTraced(f"{name} answers differently when it is called again, or with another number of points")
    except NotTraced as error:
        called = getattr(function, "__name__", "function").replace("<lambda>", "function")
        raise NotTraced(
            f"{error}. What cannot be written so is wrapped, with what is known of it: "
            f"sdhj.BlackBox({called}, reads=..., slope=..., rate=...)"
        ) from None
    return found[0], one


def _alike(first: Sequence[Node], other: Sequence[Node], row: int) -> bool:
    """Whether the nodes `other`, of point number `row`, are those of point 0, `first`, with the coordinates of
    that point, and read no third one.
    """
    pairs, known = [*zip(first, other, strict=True)], dict[Node, Node]()
    for one, its in pairs:  # to which operands are added
        if known.get(one) is its:
            continue
        same = one is its or (bool(one.args) and (one.op, one.value) == (its.op, its.value))
        if one.op == "x":
            same = not one.value[1] and its is leaf("x", one.value[0], row)
        if one in known or not same:
            return False
        known[one] = its
        pairs += zip(one.args, its.args, strict=True)
    return True


def _traced_answer(
    name: str,
    function: Callable[..., Any],
    rows: int,
    arguments: Callable[[int], Sequence[Any]],
    places: list[tuple[dict[str, Any], str]],
) -> Any:
    """The entries, an object array of nodes, of what a function answers to `arguments(rows)`, NumPy replaced at
    `places`.

    NotTraced where anything has refused meanwhile; the function's own errors, with a note; ValueError for None and for
    truth values. name : for messages.
    """
    before = dict(vars(state))
    state.trace, state.refused, state.made = next(_numbers), [], 0
    try:
        with _replaced(places, rows):
            answer = function(*arguments(rows))
        if answer is None:
            raise ValueError(f"{name} must return an array, got None: is its return missing?")
        answer, error = traced_array(answer), None
    except Exception as failed:
        error = failed
    finally:
        refused = state.refused
        vars(state).clear()
        vars(state).update(before)
    if refused:  # also where the function has caught it and gone another way
        what, place = refused[0]
        raise NotTraced(f"{name} cannot be read as a formula: {place}: {what}") from error
    if error is not None:
        error.add_note(f"while {name} was read as a formula")
        raise error
    if answer.dtype == TRUTH:
        raise ValueError(f"{name} must return real numbers, negative inside a set, got bool: a comparison")
    return answer.entries
