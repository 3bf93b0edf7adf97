"""Tracing: a user's function is called with traced arrays, whose entries are nodes, and the nodes of its answer are its
graph.

NumPy does not hand every function on to these arrays, as np.min([f, g], axis=0) of a list. So while a function is
traced a stand-in takes the place of the module numpy in the user's modules; for all other arguments, and for other
threads, it behaves as numpy does.
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
from sdhj.formulas.arrays import (
    AT_ONCE,
    FUNCTIONS,
    REDUCED,
    TRUTH,
    NotTraced,
    Traced,
    holds_traced,
    raising_not_traced,
    state,
    traced_array,
)
from sdhj.formulas.graph import Node, leaf, leaves

_numbers = itertools.count(1)
CHANCE = "; noise is a disturbance, whose bounds are given, and no part of a function"

# ---- what is replaced in numpy

LISTS = "min max amin amax sum prod mean var std any all where clip"  # which may be given a list


def _joined(value: Any) -> Any:
    """A list or tuple with traced arrays in it as one traced array with a new first axis."""
    return arrays.stacked(value) if isinstance(value, list | tuple) and holds_traced(value) else value


def _taking_lists(original: Any) -> Callable[..., Any]:
    """A function that does what NumPy's `original` does, and also takes lists with traced arrays."""
    return lambda *args, **options: original(*map(_joined, args), **options)


def _array(value: Any, dtype: Any = None, *, copy: bool | None = True) -> Traced:
    """numpy.array of a traced array, or of a list or tuple with traced arrays in it."""
    array = traced_array(value)
    return array.astype(array.dtype if dtype is None else dtype, copy=bool(copy) or not array.ndim)


def _contiguous(value: Any, dtype: Any = None) -> Traced:
    """numpy.ascontiguousarray of a traced array, or of a list with traced arrays in it."""
    array: Any = np.atleast_1d(_array(value, dtype, copy=False))
    return array if array.entries.flags.c_contiguous else array.copy()


def _making_arrays(original: Any, ours: Any) -> Callable[..., Any]:
    """A function that calls `ours` where its first argument holds a traced array, else `original`."""
    known = raising_not_traced(ours)
    return lambda value, *args, **options: (known if holds_traced(value) else original)(value, *args, **options)


def _full(room: Traced, fill_value: Any, dtype: Any = None) -> Any:
    """numpy.full: a traced array of the shape of `room`, filled with a value."""
    return FUNCTIONS[np.full_like](room, fill_value, dtype or np.result_type(arrays.weak_type(fill_value)))


def _allocating(name: str, rows: int, trace: int | None) -> Callable[..., Any]:
    """The stand-in for np.zeros, ones, empty or full: traced if traced values may be written into it."""
    original = getattr(np, name)
    filled = raising_not_traced(_full if name == "full" else FUNCTIONS[getattr(np, f"{name}_like")])

    def make_room(shape: Any, *args: Any, **options: Any) -> Any:
        lengths = (shape,) if isinstance(shape, int | np.integer) else shape
        # by position a dtype stands behind the shape, of np.full behind the value
        kind = options.get("dtype", args[name == "full"] if len(args) > (name == "full") else None)
        # a guess: an array with a length of `rows`, the number of points, is for their values
        if state.trace != trace or kind is object or not (rows in lengths or holds_traced([*args, *options.values()])):
            return original(shape, *args, **options)
        return filled(Traced(np.empty(lengths, object)), *args, **options)

    return make_room


def _repeating(original: Any, rows: int, trace: int | None) -> Callable[..., Any]:
    """The stand-in for np.tile, repeat or broadcast_to: traced if traced values may be written into it."""

    def repeat(*args: Any, **options: Any) -> Any:
        answer = original(*args, **options)
        wanted = state.trace == trace and answer.dtype == np.float64 and rows in answer.shape
        return traced_array(answer) if wanted else answer

    return repeat


class _Replaced:
    """Stands for the module numpy, or for something in it: some attributes are replaced, all others the original's.

    As np.c_ or np.r_, in np.c_[a, b], it joins traced arrays as columns, or along the first axis.
    """

    def __init__(self, original: Any, **new: Any) -> None:
        vars(self).update(new, _original=original)

    def __getattr__(self, name: str) -> Any:
        return getattr(vars(self)["_original"], name)

    def __call__(self, *args: Any, **options: Any) -> Any:
        return vars(self)["_original"](*args, **options)

    def __getitem__(self, at: Any) -> Any:
        original = vars(self)["_original"]
        return _join(at, original is np.c_) if holds_traced([at]) else original[at]


@raising_not_traced
def _join(at: Any, columns: bool) -> Any:
    """The arrays `at`, one or a tuple, joined: as np.c_ does along the last axis, or as np.r_ along the first."""
    parts = [np.atleast_1d(traced_array(one)) for one in (at if isinstance(at, tuple) else (at,))]
    if columns:
        parts = [one if one.ndim > 1 else one[:, None] for one in parts]
    return np.concatenate(parts, axis=-columns)


def _numpy(rows: int) -> _Replaced:
    """The stand-in for the module numpy in the trace under way, of a function called with `rows` points."""
    as_array = partial(_array, copy=False)
    makers = {"array": _array, "asarray": as_array, "asanyarray": as_array, "ascontiguousarray": _contiguous}
    # made anew for each trace: what makes arrays has to know the trace and its number of points
    new: dict[str, Any] = {name: _taking_lists(getattr(np, name)) for name in LISTS.split()}
    new |= {name: _allocating(name, rows, state.trace) for name in ("full", "zeros", "ones", "empty")}
    new |= {name: _repeating(getattr(np, name), rows, state.trace) for name in ("tile", "repeat", "broadcast_to")}
    new |= {name: _Replaced(getattr(np, name)) for name in ("c_", "r_")}
    new |= {name: _making_arrays(getattr(np, name), ours) for name, ours in makers.items()}
    new |= {one.__name__: _Replaced(one, reduce=_taking_lists(one.reduce)) for one in REDUCED}
    return _Replaced(np, linalg=_Replaced(np.linalg, norm=_taking_lists(np.linalg.norm)), **new)


_looked: list[Any] = [[], []]  # through which modules; and what was in those of the user


def _users_modules() -> list[dict[str, Any]]:
    """The globals of the user's modules: Python files neither installed nor of this package but for `sdhj.arm`.

    They are kept until a module has come or gone: the search takes longer than a trace.
    """
    if _looked[0] != (modules := list(sys.modules.values())):
        found = []
        for name, module in list(sys.modules.items()):
            # of a compiled module, which is left out, np.empty has to return an array: it does not ask
            file = getattr(module, "__dict__", {}).get("__file__") or ""
            # the functions of `sdhj.arm` call np.min of lists of traced arrays, as those of users may
            users = name.startswith("sdhj.arm.") if name.startswith("sdhj.") else not arrays.installed(file)
            if file.endswith(".py") and users:
                found.append(vars(module))
        _looked[:] = modules, found
    return _looked[1]


def _names_of_numpy(function: Any) -> list[tuple[dict[str, Any], str]]:
    """(globals, name) for each global name by which a user's function, or what it calls, may find numpy."""
    while inner := getattr(function, "__wrapped__", None) or getattr(function, "func", None):
        function = inner
    function = getattr(function, "__func__", function)
    called = function if hasattr(function, "__globals__") else type(function).__call__
    return [
        (names, name)
        for names in (getattr(called, "__globals__", {}), vars(sys.modules["__main__"]), *_users_modules())
        for name, value in list(names.items())
        # one trace within another replaces the stand-in, too
        if value is np or (type(value) is _Replaced and value.__dict__["_original"] is np)
    ]


@contextmanager
def _replaced(places: list[tuple[dict[str, Any], str]], rows: int) -> Iterator[None]:
    """A context in which `_numpy(rows)` stands for numpy in the entries `places` of `_names_of_numpy`.

    Numba's compiler lock is held meanwhile, so that no kernel is compiled whose code names numpy.
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
    """The points with which a function of `count` coordinates is traced, read-only (rows, count)."""
    entries = np.empty((rows, count), object)
    for row in range(rows):
        entries[row] = [leaf("x", k, row) for k in range(count)]
    entries.setflags(write=False)
    return Traced(entries)


def parameter(first: int, count: int | None = None) -> Traced:
    """Parameter number `first` as a read-only traced number; with a count, an array (count,) from it on."""
    entries = np.array([leaf("p", first + d) for d in range(count or 1)], dtype=object)
    entries.setflags(write=False)
    return Traced(entries if count is not None else entries.reshape(()))


def rows_for(*lengths: int) -> int:
    """How many points to trace with: neither it nor the next one is the length of an axis."""
    return next(rows for rows in itertools.count(3) if not {rows, rows + 1}.intersection(lengths))


def traced(
    name: str,
    function: Callable[..., Any],
    rows: int,  # from `rows_for`
    arguments: Callable[[int], Sequence[Any]],  # of the number of points
    shape: Sequence[int] | None,  # of the answer for one point; () for a level set, None for any
    per_point: bool,  # whether the answer has a leading axis for the points
    again: bool = True,
) -> tuple[list[Node], tuple[int, ...]]:
    """The nodes of a function's answer for one point, flattened, and the shape of that answer.

    The answer must not depend on the number of points (`rows`, and one more `again`), on chance or on earlier calls,
    nor may that for one point depend on another point.
    """
    found, places = list[list[Node]](), _names_of_numpy(function)
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
                columns = f"; {AT_ONCE}" if per_point else ""
                shapes = f"shape {wanted}, got {shown}".replace("'M'", "M")
                raise ValueError(f"{name} must return {shapes}{columns}")
            answer = answer.reshape(count if per_point else 1, -1)
            if not all(_alike(answer[0], nodes, row) for row, nodes in enumerate(answer)):
                raise NotTraced(
                    f"{name} treats points differently: what it answers for one may depend on no other{CHANCE}"
                )
            found.append(list(answer[0]))
        if found[0] != found[-1]:
            when = "when it is called again, or with another number of points"
            raise NotTraced(f"{name} answers differently {when}{CHANCE}")
    except NotTraced as error:
        called = getattr(function, "__name__", "function").replace("<lambda>", "function")
        raise NotTraced(
            f"{error}. What cannot be written so is wrapped, with what is known of it: "
            f"sdhj.BlackBox({called}, reads=..., slope=..., rate=...)"
        ) from None
    return found[0], one


def _alike(first: Sequence[Node], other: Sequence[Node], row: int) -> bool:
    """Whether a function answers for point `row` as for point 0, each with its own coordinates."""
    # known: the counterpart of each node of point 0, which is one node, as nodes are interned: `is` compares graphs
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
    """A user's function's answer, of one call, as an object array of nodes.

    NotTraced where anything was refused meanwhile, else the function's own exception, with a note.
    """
    # put back at the end, as a function that is traced may itself make a set, which traces another
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
