"""Formulas and black boxes: what a problem knows of a user's function, by one protocol.

Both are called with points and parameters, and have `bounds`, `bounds_by_branch` and `least` over boxes and intervals
of time, `operands_of_min`, `clipped` and `depends_on_time` (whether they depend on the time). Both have `reads`, the
coordinates that they depend on: an array of a formula, what its author gave of a black box. Of a formula this follows
from its graph; of a black box its author declares it.
"""

import reprlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial, reduce
from itertools import chain, product
from typing import Any

import numpy as np
from numba import config

from sdhj.common.checks import axis_numbers, real_array
from sdhj.common.parameters import check_places
from sdhj.common.remembering import FloatArray, Remembering, kept, read_only
from sdhj.formulas.arrays import NotTraced, Traced, entries_of
from sdhj.formulas.graph import Lookup, Node, constant, leaf, leaves, make, ordered, rebuilt
from sdhj.formulas.rules import FACTS, RULES, is_constant
from sdhj.formulas.text import parsed, written
from sdhj.formulas.tracing import parameter, points_of, rows_for, traced
from sdhj.kernels import tape as tapes
from sdhj.kernels.bounds import TINY
from sdhj.kernels.tape import Packable, Tape, packed

WIDE = 1e-6  # of an interval at one point, beside 1 and its value: there is a jump
BESIDE = 1e-7  # of a coordinate, beside 1: so far off is what is not on a line
MOST_JUMPS = 4  # of one function that are taken apart
NEARLY = 1e-12  # 4,500 units in the last place: what hundreds of operations in another order may differ by
ANGLE_ERROR = 2.0**-48  # more than angles and remainders are rounded by, as a share
Ends = tuple[FloatArray, FloatArray]
_play, _play_bounds = tapes.play, tapes.play_bounds
if getattr(config, "DISABLE_JIT", False):  # NumPy's numbers say where they divide by zero, and compiled ones do not
    _play, _play_bounds = np.errstate(all="ignore")(_play), np.errstate(all="ignore")(_play_bounds)


@dataclass(frozen=True)
class Formula(Remembering):
    """A function as an expression graph: formula(points (M, coordinates), *parameters) -> values (M, *shape).

    It is immutable, equal to others of the same graph, shape and name, and pickled as text.
    """

    outputs: tuple[Node, ...] = field(repr=False)  # the results for one point, flattened in C order
    coordinates: int  # how many coordinates a point has
    parameters: int = 1  # how many numbers follow the points; the first is the time, or the begin of an interval
    shape: tuple[int, ...] = ()  # of the results for one point
    name: str = "formula"  # what the function is, for messages
    # [the user's function that it was read from]; [] once that has been compared, as it may hold large arrays
    _source: list[Callable[..., Any]] = field(default_factory=list, repr=False, compare=False)

    @classmethod
    def read(cls, name: str, function: Any, coordinates: int, *names: str) -> "Formula | BlackBox":
        """A user's level-set function of points and `names`, traced; it is kept as the `source`.

        A Formula or BlackBox is checked and renamed. ValueError or NotTraced say at which line, and what to write.
        """
        if isinstance(function, BlackBox):
            return function.checked(name, names)
        if isinstance(function, Formula):
            if function.coordinates != coordinates or function.parameters != len(names):
                raise ValueError(f"{name} must be a function of points with {coordinates} coordinates and {names}")
            return replace(function, name=name)
        check_places(name, function, ("points",), names)

        def arguments(rows: int) -> list[Traced]:
            return [points_of(coordinates, rows), *map(parameter, range(len(names)))]

        # the answer is one number for a point, and has an axis for the points
        outputs, _ = traced(name, function, rows_for(coordinates), arguments, (), True)
        return cls(tuple(outputs), coordinates, len(names), (), name, [function])

    @classmethod
    def traced(cls, name: str, function: Callable[..., Any], coordinates: int, parameters: int = 1) -> "Formula":
        """The formula of a function of this package, by one traced call without the checks of `read`.

        The caller vouches that it treats all points in the same way.
        """
        found = function(points_of(coordinates, 1), *map(parameter, range(parameters)))
        return cls(tuple(found.entries.flat), coordinates, parameters, found.shape[1:], name)

    def compare_with_source(self, points: FloatArray, each: Sequence[Sequence[float]]) -> None:
        """`compare` it, for each of some parameters, with the function that it was read from, and forget that one.

        Where it differs that stays, and so the next problem with this formula is refused, too.
        """
        for function, parameters in product(self._source, each):
            compare(self, function, points, *parameters)
        self._source.clear()

    @kept
    def entries(self) -> Any:
        """The results for one point as an object array of nodes, (*shape), read-only."""
        return np.array(self.outputs, dtype=object).reshape(self.shape)

    @cached_property
    def rows(self) -> "tuple[Formula, ...]":
        """A formula for each entry of the first axis of the results."""
        return tuple(replace(self, outputs=tuple(one.flat), shape=self.shape[1:]) for one in self.entries)

    def __call__(self, points: Any, *parameters: Any, finite: bool = True) -> Any:
        """Values (M, *shape) at points (M, coordinates), for parameters that are numbers; traced where an argument is.

        ValueError where a value is undefined or infinite; with finite=False it is returned.
        """
        is_traced = Traced in map(type, (points, *parameters))
        points = points if is_traced else np.ascontiguousarray(points, np.float64)
        fits = len(shape := np.shape(points)) == 2 and shape[1] == self.coordinates
        fits = fits and len(parameters) == self.parameters
        given = np.array(parameters if fits and not is_traced else (), np.float64)
        if not fits or given.ndim != 1:
            more = f" and {self.parameters} more, numbers, the time first" if self.parameters else " alone"
            got = ", ".join([f"points of shape {shape}", *map(reprlib.repr, parameters)])
            under = f"problem.dynamics.{self.name}_at(points, j, t) is under input j"
            columns = "points[:, :1] is a column as points, and points[:, [0, 2]] are two"
            raise ValueError(
                f"{self.name} is a function of points (M, {self.coordinates}){more}; got {got}. "
                f"{under if self.name in ('drift', 'gain') else columns}"
            )
        if is_traced:
            return self._inlined(points, parameters)
        if not points.flags.writeable:  # for what may not be written to, all would be compiled once more
            points = points.copy()
        # a row for each result, as kernels write them; callers get a row for each point
        out = np.empty((len(self.outputs), len(points)))
        # `_play` says whether all values are finite.
        if not _play(self.tape, points, given, out) and finite:
            row = int(np.argmin(np.isfinite(out).all(axis=0)))
            value, when = out[:, row][~np.isfinite(out[:, row])][0], ", ".join(map("{:g}".format, given))
            raise ValueError(
                f"{self.name} is undefined or infinite ({value}) at {points[row].tolist()}, t = {when}; every value "
                "must be finite"
            )
        if not self.shape:
            return out[0]
        return np.ascontiguousarray(out.T).reshape(len(points), *self.shape)

    def bounds(self, low: FloatArray, high: FloatArray, *parameters: tuple[float, float]) -> Ends:
        """Lower and upper bounds, (M, *shape) each, over M boxes and intervals of the parameters, rounded outward.

        Where the function may be undefined, -inf and inf.
        """
        out, ends = np.empty((2, len(self.outputs), len(low))), np.array(parameters, np.float64).reshape(-1, 2).T
        # for what may not be written to, all would be compiled once more
        low, high, ends = (np.require(one, np.float64, ["C", "W"]) for one in (low, high, ends))
        _play_bounds(self.tape, FACTS, low, high, ends, out)
        # so kernels say that it may be undefined; callers compare these ends, and every comparison with NaN is false
        undefined = np.isnan(out[0])
        out[0][undefined], out[1][undefined] = -np.inf, np.inf
        least, greatest = np.moveaxis(out, 2, 1).reshape(2, len(low), *self.shape)
        return least, greatest

    def least(self, points: FloatArray, *parameters: tuple[float, float]) -> FloatArray:
        """Lower bounds (M,) of the one result at points, over intervals of the parameters."""
        return self.bounds_by_branch(points, points, *parameters)[0]

    def bounds_by_branch(self, low: FloatArray, high: FloatArray, *parameters: tuple[float, float]) -> Ends:
        """`bounds` of a formula with one result, (M,) each, narrower at up to `MOST_JUMPS` jumps of angles.

        What lies between the values on the two sides of a jump is no value of the function; of a set on a circle it
        would be a phantom, half a turn away. So the sides are bounded apart.
        """
        # The checker takes jumps apart in the same way and up to the same number (its `formulas`): what is proved by
        # more than that it refuses.
        found, (jumps, operands, rest) = np.array(self.bounds(low, high, *parameters)), self._jumps
        if not 0 < len(jumps) <= MOST_JUMPS:
            return found[0], found[1]
        pairs = np.array(operands.bounds(low, high, *parameters)).transpose(2, 0, 1).reshape(-1, 2, *found.shape)
        with np.errstate(invalid="ignore"):  # where nothing is known
            parts = np.array([_sides(one.op, *pair) for one, pair in zip(jumps, pairs, strict=True)])
        two_branches = (parts[:, 0] != parts[:, 1]).any(axis=(0, 1)) & np.isfinite(parts).all(axis=(0, 1, 2))
        rows = np.flatnonzero(two_branches & np.isfinite(found).all(axis=0))
        each = []
        for sides in product((0, 1), repeat=len(jumps)) if rows.size else ():
            # `rest` reads what jumps as further coordinates, in this order (`_jumps`)
            begins, ends = parts[range(len(jumps)), sides][..., rows].transpose(1, 2, 0)
            boxes = np.column_stack([low[rows], begins]), np.column_stack([high[rows], ends])
            each.append(rest.bounds(*boxes, *parameters))
        if each:
            least, greatest = np.min(each, axis=0)[0], np.max(each, axis=0)[1]
            found[:, rows] = np.maximum(found[0, rows], least), np.minimum(found[1, rows], greatest)
        return found[0], found[1]

    @cached_property
    def operands_of_min(self) -> "tuple[Formula, ...]":
        """The different formulas whose minimum this one is by its form; (self,) where it is no minimum."""
        # certified cells are shown clear of each apart, and the checker finds the same ones by its `least_of`
        found, left = dict[Node, None](), [self.outputs[0]]
        while left:
            one = left.pop()
            if one.op == "min":
                left += one.args[::-1]
            else:
                found[one] = None
        return (self,) if len(found) == 1 else tuple(replace(self, outputs=(one,), _source=[]) for one in found)

    @cached_property
    def _jumps(self) -> "tuple[list[Node], Formula, Formula]":
        """The nodes that jump, a formula of their operands, and one of the results.

        The operands are y and x, or a / b and b for mod(a, b); the results read the nodes as further coordinates.
        """
        found = [one for one in ordered(self.outputs) if one.op in ("arctan2", "mod")]
        # Of another period `_sides` knows no bounds.
        found = [one for one in found if one.op == "arctan2" or (is_constant(one.args[1]) and one.args[1].value > 0)]
        new = {one: leaf("x", self.coordinates + i) for i, one in enumerate(found)}
        rest = replace(self, outputs=tuple(rebuilt(self.outputs, new.get)), coordinates=self.coordinates + len(found))
        # `mod` jumps where its laps, a / b, are whole.
        pairs = [(make("div", *one.args), one.args[1]) if one.op == "mod" else one.args for one in found]
        return found, replace(self, outputs=tuple(chain(*pairs)), shape=(2 * len(found),)), rest

    @kept
    def reads(self) -> FloatArray:
        """Whether each result (flattened) reads each coordinate: (results, coordinates), read-only."""
        out = np.zeros((len(self.outputs), self.coordinates), np.bool_)
        for row, one in enumerate(self.outputs):
            out[row, list(leaves([one], "x"))] = True
        return out

    @cached_property
    def depends_on_time(self) -> bool:
        """Whether a result reads parameter 0: the time, or the begin of an interval."""
        return 0 in leaves(self.outputs, "p")

    def clipped(self, lower: FloatArray, upper: FloatArray) -> "Formula":
        """The function of points whose coordinates are clipped to [lower, upper]."""
        put = dict[Node, Node]()
        for k, (low, high) in enumerate(zip(lower.tolist(), upper.tolist(), strict=True)):
            put[leaf("x", k)] = make("min", make("max", leaf("x", k), constant(low)), constant(high))
        outputs = tuple(rebuilt(self.outputs, put.get))
        # without the source, which answers otherwise beyond the ends
        return Formula(outputs, self.coordinates, self.parameters, self.shape, self.name)

    def restricted(self, axes: Sequence[int]) -> "Formula":
        """The function of points that have the coordinates `axes` alone, which must be all that it reads."""

        known: dict[tuple[int, ...], Formula] = self.remembered("restricted", dict)
        if (key := tuple(axes)) not in known:
            put = {leaf("x", axis): leaf("x", k) for k, axis in enumerate(axes)}
            # a coordinate that is not among `axes` would keep its number, and so read another column
            outputs = tuple(rebuilt(self.outputs, put.get))
            known[key] = Formula(outputs, len(axes), self.parameters, self.shape, self.name)
        return known[key]

    @cached_property
    def tape(self) -> Tape:
        """The formula as the kernels play it (`sdhj.kernels.tape`)."""
        return packed(*program(self.outputs))

    def _inlined(self, points: Any, parameters: Sequence[Any]) -> Traced:
        """The results at points, where an argument is traced: a traced array of the caller's graph."""
        columns = entries_of(points).reshape(-1, self.coordinates)
        given = [entries_of(one)[()] for one in parameters]
        out = np.empty((len(columns), len(self.outputs)), object)
        # For each of the rows with which the caller traces, a copy of the graph with its entries.
        for row, column in enumerate(columns):
            put = {leaf("x", k): entry for k, entry in enumerate(column)}
            put |= {leaf("p", k): one for k, one in enumerate(given)}
            out[row] = rebuilt(self.outputs, put.get)
        return Traced(out.reshape(len(columns), *self.shape))

    def __reduce__(self) -> Any:
        """Pickled as text and tables, without its source."""
        tables: list[Lookup] = []
        lines = written(self.outputs, tables)
        return restored, (lines, tables, self.coordinates, self.parameters, self.shape, self.name)


def program(outputs: Sequence[Node]) -> tuple[Packable, ...]:
    """The seven arrays of a `Tape` whose results are the nodes `outputs`.

    A slot is used again as soon as no later operation reads it. Equal tables are stored once, each followed by its
    `pyramid`.
    """
    order = ordered(outputs)
    last = {arg: i for i, one in enumerate(order) for arg in one.args}
    last |= dict.fromkeys(outputs, len(order))
    slots: dict[Node, int] = {}
    code, value = np.zeros((len(order), 5), np.int64), np.zeros(len(order))
    free, top = list[int](), 0  # slots
    lookups, tables, flat = list[tuple[Node, list[int]]](), dict[str, int](), list[FloatArray]()
    for i, one in enumerate(order):
        used = [slots[arg] for arg in one.args]
        # A slot is free after its last reader; those of results are never.
        for arg in dict.fromkeys(one.args):
            if last[arg] == i:
                free.append(slots[arg])
        # which may be that of an operand: kernels write into a spare row and then swap the two
        if free:
            slots[one] = free.pop()
        else:
            slots[one], top = top, top + 1
        code[i, :2] = RULES[one.op].code, slots[one]
        if one.op == "gridded":
            code[i, 2] = len(lookups)
            lookups.append((one, used))
        else:
            code[i, 2 : 2 + len(used)] = used
            # Operations of one operand are played with it twice.
            if len(used) == 1:
                code[i, 3] = used[0]
        if one.op in ("x", "p"):
            code[i, 2] = one.value[0]
        elif one.op in ("const", "power"):
            value[i] = one.value
    # the columns of `Tape.lookups` and `Tape.places`
    found, places = np.zeros((len(lookups), 14), np.int64), np.zeros((len(lookups), 12))
    for row, (one, used) in enumerate(lookups):
        table, n = one.value, len(used)
        # Tables of the same values lie in the tape once.
        if table.digest not in tables:
            tables[table.digest] = sum(level.size for level in flat)
            flat += [table.values, *tapes.pyramid(table.values)]
        found[row, 0], found[row, 1 : 1 + n], found[row, 7 : 7 + n] = n, used, table.values.shape
        found[row, 13], places[row, :n], places[row, 6 : 6 + n] = tables[table.digest], table.lower, table.spacing
    results = np.array([slots[one] for one in outputs], np.int64)
    # An empty list has no type in compiled code.
    return code, np.array([top]), results, found, value, places, flat or [np.zeros(1)]


def restored(lines: Sequence[str], tables: Any, coordinates: int, parameters: int, shape: Any, name: str) -> Formula:
    """The formula with these lines of text, as files keep it."""
    return Formula(parsed(lines, tables, coordinates, parameters), coordinates, parameters, tuple(shape), name)


def compare(formula: Formula, function: Callable[..., Any], points: FloatArray, *parameters: float) -> None:
    """Raise ValueError where a user's function is not its formula at points (M, n).

    Where the formula is undefined, nothing is compared; where a value may jump, points beside it may agree, too.
    """
    values, own, good, differs = _compared(formula, function, points, parameters)
    if (some := differs.any(axis=1)).any():
        beside = np.random.default_rng(0).uniform(-BESIDE, BESIDE, points[some].shape) * (1.0 + np.abs(points[some]))
        good[some] &= ~_compared(formula, function, points[some] + beside, parameters)[3]
    if not good.all():
        row, column = np.argwhere(~good)[0]
        raise ValueError(
            f"{formula.name} is {values[row, column]} at {points[row].tolist()} and its formula says "
            f"{own[row, column]}: it hangs on something else than its arguments, or on their type; write it in NumPy's "
            "functions of the arguments alone, or wrap it in sdhj.BlackBox"
        )


def _compared(formula: Formula, function: Callable[..., Any], points: FloatArray, parameters: Sequence[float]) -> Any:
    """Values of the function and the formula, whether they agree, and whether at a jump they do not: (M, results)."""
    given = points.copy()
    given.setflags(write=False)
    with np.errstate(all="ignore"):
        values = np.asarray(function(given, *parameters), dtype=np.float64).reshape(len(points), -1)
        own = formula(points, *parameters, finite=False).reshape(len(points), -1)
        # NumPy may add in another order: values differ by up to `NEARLY` of the largest
        largest = np.abs(np.where(np.isfinite(own), own, 0.0)).max(axis=0, initial=0.0)
        differs = np.isfinite(own) & ~(np.abs(own - values) <= NEARLY * largest)
        if not differs.any():
            return values, own, ~differs, differs
        # only here, because compiling this takes seconds; an interval as wide as `WIDE` has a jump in it
        ends = formula.bounds(points, points, *((t, t) for t in parameters))
        low, high = (end.reshape(len(points), -1) for end in ends)
        slack = 4 * np.spacing(np.maximum(np.abs(low), np.abs(high))) + (high - low)
        good = ~np.isfinite(low) | ((low - slack <= values) & (values <= high + slack))
        return values, own, good, differs & (high - low > WIDE * (1.0 + np.abs(own)))


@dataclass(frozen=True, eq=False)
class BlackBox:
    """A function that cannot be read as a formula, such as a network, with what its author declares of it.

    What is not declared is taken at its worst, or refused where a proof needs it.

    Parameters
    ----------
    function : callable
        A level set of (points, t), or a drift or gain of (points, u, t); all are passed.
    reads : sequence of int, optional
        The coordinates that the answer depends on; by default all.
    slope : float, or one for each coordinate, or (ndim, ndim) array for a drift, optional
        Bound on how much the answer changes for each unit of distance, along each coordinate, or, in row i, component i
        of the drift along each coordinate.
    rate : float, or one for each component, optional
        Bound on how much the answer changes in a second; 0: it does not depend on the time.
    enclosure : callable, optional
        Of a level set (low, high, t0, t1) -> (least, greatest), with boxes (M, axes) and answers (M,), which bound the
        function in the box and in [t0, t1]; of a drift or gain (low, high, u, t0, t1). Used in place of `slope` and
        `rate`.

    Examples
    --------
    Distance to a wall by a function that decides, so that it cannot be read:

    >>> import numpy as np
    >>> import sdhj
    >>> def distance(points, t):
    ...     return np.array([abs(x) - 0.5 if x > 0 else -x - 0.5 for (x,) in points])
    >>> wall = sdhj.UnsafeSet((0,), sdhj.BlackBox(distance, slope=1.0, rate=0.0))
    >>> wall.level_set(np.array([[0.0], [2.0]]), 0.0)
    array([-0.5,  1.5])
    """

    function: Callable[..., Any]
    reads: Any = None
    slope: Any = None
    rate: Any = None
    enclosure: Callable[..., Any] | None = None
    name: str = field(default="black box", repr=False)  # what the function is, for messages
    shape: tuple[int, ...] = field(default=(), repr=False)  # of the answer for one point

    def __post_init__(self) -> None:
        """Check what is declared, and make its arrays read-only copies."""
        for name in ("function", "enclosure"):
            if not (callable(given := getattr(self, name)) or (given is None and name == "enclosure")):
                raise ValueError(f"{name} of a BlackBox must be a function, got {given!r}")
        for name in ("slope", "rate"):
            given = getattr(self, name)
            # None states nothing, and is checked as 0.
            array = real_array(f"{name} of a BlackBox", 0.0 if given is None else given)
            if not (np.isfinite(array).all() and (array >= 0).all()):
                raise ValueError(f"{name} of a BlackBox must be finite and at least 0, got {given!r}")
            if np.ndim(given):
                object.__setattr__(self, name, read_only(array))
        if self.reads is not None:
            object.__setattr__(self, "reads", axis_numbers(self.reads, "BlackBox(reads=...)"))

    def checked(self, name: str, rest: Sequence[str], takes: Sequence[str] = ()) -> "BlackBox":
        """A copy under this name, if the function takes `rest` after a state and the enclosure `takes` after a box."""
        # where the enclosure takes other arguments than t0 and t1, the caller has checked the function
        if not takes:
            check_places(name, self.function, ("points",), rest)
        if self.enclosure is not None:
            times = takes or ("t0", "t1")
            check_places(f"enclosure of {name}", self.enclosure, ("low", "high"), times)
        return replace(self, name=name)

    @property
    def depends_on_time(self) -> bool:
        """Whether the answer may depend on the time: unless a `rate` of 0 is declared."""
        return self.rate is None or bool(np.any(self.rate))

    def clipped(self, lower: FloatArray, upper: FloatArray) -> "BlackBox":
        """The black box whose points, and corners of boxes, are first clipped to [lower, upper]."""

        def cut(function: Any, count: int) -> Any:
            return lambda *given: function(*np.clip(given[:count], lower, upper), *given[count:])

        return replace(self, function=cut(self.function, 1), enclosure=self.enclosure and cut(self.enclosure, 2))

    def under(self, u: FloatArray) -> "BlackBox":
        """A drift or a gain under one input u, as a black box of (points, t)."""
        enclosure = self.enclosure and partial(_with_input, self.enclosure, 2, u)
        return replace(self, function=partial(_with_input, self.function, 1, u), enclosure=enclosure)

    def bounds(self, low: FloatArray, high: FloatArray, time: tuple[float, float]) -> Ends:
        """Lower and upper bounds, (M, *shape) each, over M boxes and an interval of time.

        What the enclosure says, or value in the middle -+ (slope |half of the box| + rate times half of the duration).
        """
        if self.enclosure is not None:
            least, greatest = (np.asarray(end, dtype=np.float64) for end in self.enclosure(low, high, *time))
            return least, greatest
        if self.slope is None or (time[0] != time[1] and self.rate is None):
            what = "a slope" if self.slope is None else "a rate"
            raise ValueError(f"{self.name} is a BlackBox without {what} or an enclosure, which a proof needs")
        centre, middle = (low + high) / 2, sum(time) / 2
        value = np.asarray(self(centre, middle))
        # of a drift or a gain, which have a shape, a row for each component; of a level set as it was declared
        slope = np.broadcast_to(self.slope, (centre.shape[1],) * 2) if self.shape else np.asarray(self.slope)

        def change(by: FloatArray, duration: float) -> FloatArray:
            # of a slope that is one number |by| is the distance, else changes along the coordinates are summed
            far = by @ slope.T if slope.ndim else slope * np.sqrt((by**2).sum(axis=1))
            far = far + duration * (0.0 if self.rate is None else np.asarray(self.rate))
            return far.reshape(far.shape + (1,) * (value.ndim - far.ndim))  # of a gain: for each of its columns

        # How it is rounded nobody says: a millionth of a thousandth of what it is and may change by from zero on is
        # ten million roundings of numbers of that size, in any units. `stated` of the checker's BlackBox has the same.
        size = np.abs(value) + change(np.abs(centre), abs(middle))
        far = change((high - low) / 2, (time[1] - time[0]) / 2) * (1 + 1e-9) + 1e-9 * size
        return value - far, value + far

    bounds_by_branch = bounds  # it is as its author says

    @property
    def operands_of_min(self) -> "tuple[BlackBox, ...]":
        """(self,), because what it is made of is not known."""
        return (self,)

    def least(self, points: FloatArray, time: tuple[float, float]) -> FloatArray:
        """Lower bounds (M,) of a level set at points over an interval of time."""
        if self.enclosure is not None:
            return self.bounds(points, points, time)[0]
        if self.rate is None:
            raise ValueError(
                f"{self.name} is a BlackBox that may depend on time: say how fast it changes, BlackBox(..., rate=0.0) "
                "if it does not, or use view_time='sampled'"
            )
        # The value in the middle, as far down as it may change in half of the time.
        return np.asarray(self(points, sum(time) / 2) - self.rate * (time[1] - time[0]) / 2)

    def __call__(self, points: Any, *others: Any) -> Any:
        """The function's values as float64 (M, *shape); ValueError where they are not finite."""
        # In a function that is traced, a black box would need values where there are only nodes.
        if isinstance(points, Traced):
            raise NotTraced("a black box within a function", "wrap the whole function in sdhj.BlackBox")
        values = np.array(self.function(points, *others), dtype=np.float64)
        if values.shape != (shape := (len(points), *self.shape)) or not np.isfinite(values).all():
            raise ValueError(f"{self.name} must return finite numbers of shape {shape}, got {reprlib.repr(values)}")
        return values


def _sides(op: str, a: FloatArray, b: FloatArray) -> FloatArray:
    """Bounds of `mod` or `arctan2` over M boxes, on both sides of its jump: [side][lower, upper][box].

    a, b (2, M) : bounds of the laps and the period, or of y and x, where the jump is at y = 0, x <= 0. Without a jump
    both sides are equal; `mod` with more than one has all of [0, period].
    """
    if op == "mod":
        laps = np.floor(a)
        ends = np.clip(a - laps[:, None], 0.0, 1.0) * b[0]
        ends = np.where(laps[1] - laps[0] > 1, np.array([[[0.0], [1.0]]]) * b[0], ends)
    else:
        cut = (a[0] <= 0) & (a[1] >= 0) & (b[0] <= 0)
        # zeros have signs: -0.0 is the side below the jump, on which arctan2 is -pi
        below = np.where(cut & (a[0] == 0), -0.0, a[0]), np.where(cut, -0.0, a[1])
        y = np.array([[np.where(cut, 0.0, a[0]), a[1] + 0.0], below])[:, :, None]
        x = np.array([np.where(b[0] == 0, -0.0, b[0]), b[1] + 0.0])  # a zero of either sign
        places = np.stack(np.broadcast_arrays(y, x), axis=-1)
        corners = ANGLE(places.reshape(-1, 2), finite=False).reshape(places.shape[:-1])
        ends = np.stack([corners.min(axis=(1, 2)), corners.max(axis=(1, 2))], axis=1)
    return ends + np.array([[-1.0], [1.0]]) * (np.abs(ends) * ANGLE_ERROR + TINY)


ANGLE = Formula((make("arctan2", leaf("x", 0), leaf("x", 1)),), 2, 0)  # of y and x


def _with_input(function: Callable[..., Any], place: int, u: FloatArray, *given: Any) -> Any:
    """The answer of function(*given), with the input u inserted as argument number `place`."""
    return function(*given[:place], u, *given[place:])


def union(*functions: Any) -> Any:
    """The level-set function of the union of sets: min over the functions f of f(points, t).

    Parameters
    ----------
    functions : callable (points (M, axes), t) -> (M,)
        <= 0 in the sets, all of the same axes.

    Examples
    --------
    >>> import numpy as np
    >>> import sdhj
    >>> left, right = (lambda q, t: abs(q[:, 0] + 1.0) - 0.5), (lambda q, t: abs(q[:, 0] - 1.0) - 0.5)
    >>> sdhj.union(left, right)(np.array([[-1.0], [0.0]]), 0.0)
    array([-0.5,  0.5])
    """
    _check_sets("union", functions)
    return lambda points, t: reduce(np.minimum, [function(points, t) for function in functions])


def intersection(*functions: Any) -> Any:
    """The level-set function of the intersection of sets: max over the functions f of f(points, t).

    Parameters
    ----------
    functions : callable (points (M, axes), t) -> (M,)
        As for `union`.

    Examples
    --------
    >>> import numpy as np
    >>> import sdhj
    >>> above, below = (lambda q, t: -q[:, 0]), (lambda q, t: q[:, 0] - 1.0)
    >>> sdhj.intersection(above, below)(np.array([[0.25], [2.0]]), 0.0)
    array([-0.25,  1.  ])
    """
    _check_sets("intersection", functions)
    return lambda points, t: reduce(np.maximum, [function(points, t) for function in functions])


def complement(function: Any) -> Any:
    """The level-set function of all that is not in a set: -f(points, t).

    The boundary, where f is 0, belongs to both.

    Parameters
    ----------
    function : callable (points (M, axes), t) -> (M,)
        <= 0 in the set.

    Examples
    --------
    All but the inside of 0.5 m around the origin:

    >>> import numpy as np
    >>> import sdhj
    >>> outside = sdhj.complement(lambda q, t: abs(q[:, 0]) - 0.5)
    >>> outside(np.array([[0.0], [2.0]]), 0.0)
    array([ 0.5, -1.5])
    """
    _check_sets("complement", (function,))
    return lambda points, t: -function(points, t)


def _check_sets(name: str, functions: Sequence[Any]) -> None:
    """Raise ValueError where an argument of sdhj.NAME is no function of (points, t)."""
    for function in functions:
        check_places(f"a level-set function of sdhj.{name}", function, ("points",), ("t",))
