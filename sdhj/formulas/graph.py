"""Expression graphs: what a function computes, as scalar operations on coordinates, parameters and constants.

Equal nodes are one object (hash-consing), so equal subexpressions are shared and comparing two graphs is comparing
objects. A node is simplified when it is made, but no operand that may be undefined is dropped: 0 * log(x) stays.
"""

import math
import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from hashlib import blake2b
from typing import Any
from weakref import WeakValueDictionary

import numpy as np

from sdhj.common.remembering import FloatArray
from sdhj.formulas.rules import RULES, is_constant

# the checker refuses files above the same limits, which it has itself (its `formulas` and `reading`)
MOST_EXPONENT = 64  # of `power`, a whole number
MOST_AXES = 6  # of a table
MOST_TABLES = 1 << 30  # bytes of all tables that a problem looks up: so many does a file have, and are read
MOST_TOTAL = 8  # ... up to which powers are taken not to overflow
_lock = threading.Lock()
_nodes: "WeakValueDictionary[Any, Node]" = WeakValueDictionary()


@dataclass(frozen=True)
class Lookup:
    """A table to be interpolated: values at the nodes lower + i * spacing of a grid."""

    values: FloatArray = field(compare=False, repr=False)  # float64, read-only, 1 to `MOST_AXES` axes
    lower: tuple[float, ...]  # the coordinate of the first node on each axis
    spacing: tuple[float, ...]  # from node to node on each axis, above 0
    digest: str  # of shape and values, hexadecimal

    @classmethod
    def of(cls, values: Any, lower: Any, spacing: Any) -> "Lookup":
        """A checked table; one number `lower` and `spacing` for each axis. Values are shared where that is safe."""
        known = values if isinstance(values, Lookup) else None
        # Before anything is copied.
        if (size := 8 * math.prod(getattr(values, "shape", ()))) > MOST_TABLES:
            raise ValueError(
                f"a table of shape {values.shape} takes {size:,} bytes, and those of a problem at most {MOST_TABLES:,} "
                "together; use fewer nodes"
            )
        try:
            # maps are large: a Lookup's, a read-only array that owns its memory, and a file's are not copied
            array = known.values if known else values if _sealed(values) else np.array(values, np.float64, order="C")
            low, step = (tuple(np.atleast_1d(np.asarray(one, dtype=np.float64)).tolist()) for one in (lower, spacing))
        except (TypeError, ValueError) as error:
            raise ValueError(f"values, lower and spacing of a table must be real numbers: {error}") from None
        fits = len(low) == len(step) == array.ndim and 1 <= array.ndim <= MOST_AXES and min(array.shape) >= 2
        if not fits or not all(np.isfinite(one).all() for one in (array, low, step)) or min(step) <= 0:
            raise ValueError(
                f"values must be finite, on 1 to {MOST_AXES} axes with two nodes at least, with a lower and a spacing "
                f"above 0 for each; got values of shape {array.shape}, {low} and {step}"
            )
        if known:
            return cls(array, low, step, known.digest)
        array.setflags(write=False)
        # With the shape, which the bytes alone do not tell.
        digest = blake2b(repr(array.shape).encode(), digest_size=16)
        digest.update(array.data.cast("B"))
        return cls(array, low, step, digest.hexdigest())


def _sealed(values: Any) -> bool:
    """Whether values can be kept without a copy: read-only, C-contiguous float64, that own memory or map a file's."""
    fits = type(values) is np.ndarray and values.dtype == np.float64 and values.flags.c_contiguous
    held = values
    # A view of another array could change with it, although it is read-only itself.
    while isinstance(held, np.ndarray) and held.base is not None:
        held = held.base
    mapped = isinstance(held, memoryview) and held.readonly
    return fits and (values.flags.owndata or mapped) and not values.flags.writeable


class Node:
    """One operation and its operands, or a leaf: a coordinate, a parameter or a constant.

    Immutable, made by `leaf`, `constant`, `make`, `power` and `interned` alone; compare by `is`. NumPy's products use
    `+`, `-` and `*` of the entries.
    """

    __slots__ = ("__weakref__", "args", "op", "total", "truth", "value")
    op: str  # the name of its rule (`sdhj.formulas.rules`)
    args: "tuple[Node, ...]"  # the operands
    value: Any  # the number of a constant, exponent of a power, `Lookup`, or (index, row) of a leaf; else None
    truth: bool  # whether it is a truth value: 0 or 1 wherever it is defined
    total: bool  # whether it is surely defined, and does not overflow, for all that states and times may be

    def __add__(self, other: Any) -> "Node":  # products in NumPy add, subtract and multiply the entries
        return make("add", self, node(other))

    def __sub__(self, other: Any) -> "Node":
        return make("sub", self, node(other))

    def __mul__(self, other: Any) -> "Node":
        return make("mul", self, node(other))

    __radd__, __rmul__ = __add__, __mul__

    def __reduce__(self) -> Any:
        """Copied and pickled as its parts, of which there is one node in each process."""
        return interned, (self.op, self.args, self.value)

    def __bool__(self) -> bool:
        raise TypeError("an entry of a traced array has no value")

    def __repr__(self) -> str:
        return f"{self.op} of {len(self.args)}" if self.args else f"{self.op} {self.value}"


def interned(op: str, args: tuple[Node, ...] = (), value: Any = None) -> Node:
    """The one node of this operation, operands and value, not simplified; threads may call it at once."""
    key = (op, args, repr(value) if isinstance(value, float) else value)  # NaN is NaN
    found = _nodes.get(key)
    if found is None:
        found, rule = Node(), RULES[op]
        found.op, found.args, found.value, found.truth = op, args, value, rule.truth
        found.total = rule.total and all(arg.total for arg in args)
        if op == "where":
            found.truth = args[1].truth and args[2].truth
        elif op == "const":
            found.truth, found.total = value in (0.0, 1.0) or math.isnan(value), math.isfinite(value)
        elif op == "power":
            found.total = found.total and 0 <= value <= MOST_TOTAL
        # two threads may each have made one: the node is the one that was kept first
        with _lock:
            found = _nodes.setdefault(key, found)
    return found


def leaf(kind: str, index: int, row: int = 0) -> Node:
    """The node of coordinate (kind "x") or parameter (kind "p", of which 0 is the time) number `index`."""
    # row: the point's number, while a function is traced with several
    return interned(kind, (), (index, row))


def constant(value: float) -> Node:
    """The node of a number; -0.0 becomes 0.0."""
    return interned("const", (), float(value) + 0.0)  # a zero has no sign


def node(value: Any) -> Node:
    return value if isinstance(value, Node) else constant(value)


def make(op: str = "const", *args: Node, value: Any = None) -> Node:
    """The node of operation `op` with these operands, simplified.

    Constants are folded, and nodes replaced (`Rule.simpler`), only where that changes neither a value, to the last bit,
    nor where it is undefined.
    """
    if not args:
        return constant(value)
    rule = RULES[op]
    if args[-1].op == "const" and rule.folded and all(is_constant(arg) and not math.isnan(arg.value) for arg in args):
        try:
            return constant(rule.folded(*(arg.value for arg in args)))
        except (ArithmeticError, ValueError):  # undefined: left to be evaluated
            return interned(op, args)
    simpler = rule.simpler(make, *args) if rule.simpler else None
    return interned(op, args, value) if simpler is None else simpler


def power(a: Node, b: Node) -> Node:
    """The node a^b by the cheapest operation: that of a constant exponent, or "pow"."""
    if not is_constant(b):
        return make("pow", a, b)
    exponent = float(b.value)
    cheap = {1.0: lambda: a, 2.0: lambda: make("sqr", a), 0.5: lambda: make("sqrt", a)}
    if exponent in cheap:
        return cheap[exponent]()
    if exponent == -1.0:
        return make("div", constant(1.0), a)
    if exponent.is_integer() and abs(exponent) <= MOST_EXPONENT:
        # also 0 to the power of 0 is 1, but where a is undefined its power has to be, too
        return constant(1.0) if exponent == 0.0 and a.total else make("power", a, value=int(exponent))
    return make("pow", a, b)


def ordered(outputs: Iterable[Node], most: float = math.inf) -> list[Node]:
    """The nodes of a graph, each once, operands first; their order depends on the graph alone.

    It is empty where there are more than `most`, to keep callers fast, and may be where there are nearly as many.
    """
    # `written` has this order, and digests are of what it writes
    done: dict[Node, None] = {}
    stack = [(one, False) for one in reversed(list(outputs))]
    while stack and len(stack) + len(done) <= most:
        one, opened = stack.pop()
        if opened:
            done[one] = None
        elif one not in done:
            stack.append((one, True))
            stack.extend((arg, False) for arg in reversed(one.args))
    return [] if stack else list(done)


def rebuilt(outputs: Sequence[Node], replaced: Callable[[Node], Node | None]) -> list[Node]:
    """The outputs with nodes replaced where `replaced` returns another, and those above made anew by `make`.

    `replaced` is called once for each node, operands first.
    """
    new: dict[Node, Node] = {}
    for one in ordered(outputs):
        put, args = replaced(one), tuple(new[arg] for arg in one.args)
        if put is None:
            # what has not changed stays the object that it was, and is not simplified once more
            put = one if args == one.args else make(one.op, *args, value=one.value)
        new[one] = put
    return [new[one] for one in outputs]


def leaves(outputs: Iterable[Node], kind: str) -> set[int]:
    """The indices of all coordinates (kind "x") or parameters (kind "p") that `outputs` read."""
    return {one.value[0] for one in ordered(outputs) if one.op == kind}
