"""What the head of a file says of a robot of one's own: its axes, sets, sensing, and functions, every part checked.

A function is a formula (`formulas`), or a black box: then the head says why, and it is taken from the problem that was
given beside the file.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from sdhj.certified.check import intervals
from sdhj.certified.check.bits import Array
from sdhj.certified.check.files import Arrays
from sdhj.certified.check.formulas import MOST_AXES, Formula, read
from sdhj.certified.check.reading import MOST_COUNTED, MOST_ON_AN_AXIS, MOST_TABLES, array, expect, is_whole, real

BOX_ROUNDED = 1e-9  # of what a black box is, and may change by from zero on: more than it rounds, in any units
ENDS = {"unsafe", "wall", "safe"}

Times = tuple[float, float]


class Grid:
    """The axes of the state: lists `lower`, `upper` and `spacing`, the ends of each axis and the spacing of its nodes.

    periodic : (ndim,) bool.
    ends : for each axis the names of its lower and its upper end, "unsafe", "wall" or "safe".
    """

    def __init__(self, head: Mapping[str, Any]) -> None:
        """Read a grid; ValueError where it is none. head : the entry "grid" of the head of a file."""
        lower, upper, periodic, shape = (head[name] for name in ("lower", "upper", "periodic", "shape"))
        ends = tuple((low, high) for low, high in head["ends"])
        # check 7.28
        fits = 1 <= len(lower) <= MOST_AXES and len({len(part) for part in (lower, upper, periodic, shape, ends)}) == 1
        expect(fits, f"a grid must have 1 to {MOST_AXES} axes", head)
        bounds = [(real("lower", a), real("upper", b)) for a, b in zip(lower, upper, strict=True)]
        expect(all(a < b for a, b in bounds), "lower ends must be below upper ends", bounds)  # check 7.27
        # check 7.31
        expect(all(flag in (True, False) for flag in periodic), "periodic must be true or false", periodic)
        expect(all({*pair} <= ENDS for pair in ends), f"ends must be of {', '.join(sorted(ENDS))}", ends)  # check 7.26
        # check 7.30
        expect(all(is_whole(n, 2, MOST_ON_AN_AXIS) for n in shape), "shape must be numbers of nodes", shape)
        self.lower, self.upper = np.array(bounds).T.tolist()
        self.spacing = [(b - a) / (n - 1) for (a, b), n in zip(bounds, shape, strict=True)]
        self.periodic, self.ends, self.ndim = np.array(periodic, np.bool_), ends, len(lower)


class BlackBox:
    """A function that is no formula, bounded by what its author states of it.

    name : in errors.
    given : the function, callable with points, an input if there is one, and a time. Its attributes are `enclosure`, a
        function of low, high, an input if there is one, and two times, or None; `slope`, None, a number, one for each
        axis, or a row of these for each component; and `rate`, None, a number, or one for each component.
    results, components : how many numbers it returns for a point, in how many components.
    inputs : for drift and gain a tuple of the one input, which is handed over before the times; else empty.
    """

    def __init__(
        self, name: str, given: Any, results: int = 1, components: int = 1, inputs: tuple[Any, ...] = ()
    ) -> None:
        """Keep the arguments, which the class describes; a generator of states, seeded with 0, is made."""
        self.name, self.given, self.inputs = name, given, inputs
        self.results, self.components, self.rng = results, components, np.random.default_rng(0)

    def reads(self, leaf: str, number: int | None = None) -> bool:
        """Whether it may depend on the coordinates, leaf "x": always; or on the time, leaf "p": unless its rate is 0.

        number : ignored; there for `Formula.reads`, which is asked of one coordinate or parameter.
        """
        return leaf == "x" or self.given.rate is None or bool(np.any(self.given.rate))

    def bounds(self, low: Array, high: Array, times: Times) -> tuple[Array, Array]:
        """The least and the greatest values, as its author states them, over boxes and times: both (M, results).

        They are tried at a random state of each box, at both times; ValueError where a value is beyond them, and where
        neither an enclosure nor slope and rate are stated. NaN where a bound is not finite.

        low, high : the boxes, (M, coordinates). times : from s to s.
        """
        least, most = self.stated(low, high, times)
        for time in times:
            place = low + self.rng.random(low.shape) * (high - low)
            value = self.shaped(self.given(place, *self.inputs, time))
            near = BOX_ROUNDED * (np.abs(value) + np.abs(least) + np.abs(most))
            wrong = np.flatnonzero(((value < least - near) | (value > most + near)).any(axis=1))[:1]  # check 7.10
            what = f"what is stated of the black box {self.name} must hold at {time:g} s and {place[wrong].tolist()}"
            expect(not wrong.size, what, value[wrong].tolist())  # check 7.9
        return least, most

    def stated(self, low: Array, high: Array, times: Times) -> tuple[Array, Array]:
        """The bounds over boxes and times that the author states, by an enclosure or else by slope and rate.

        Both (M, results). By slope and rate: the value in the middle of the box and of the times, +- slope |half width|
        + rate * half the duration, rounded outward. NaN where a bound is not finite. ValueError where neither is
        stated; the rate may be missing where both times are the same.

        low, high : the boxes, (M, coordinates). times : from s to s.
        """
        if self.given.enclosure is not None:
            least, most = self.given.enclosure(low, high, *self.inputs, *times)
            return intervals.sure(self.shaped(least), self.shaped(most))
        slope, rate, half = self.given.slope, self.given.rate, (high - low) / 2
        stated = slope is not None and (rate is not None or times[0] == times[1])
        expect(stated, f"the black box {self.name} must have an enclosure, or a slope and a rate", (slope, rate))

        def change(by: Array, duration: float) -> Array:
            """At most how far values change over displacements `by` (M, coordinates) and a duration, s: (M, results).

            slope |by| + rate * duration, with the length of `by` where the slope is a number. by : not below 0.
            """
            # check 1.13
            far = by @ np.atleast_2d(slope).T if np.ndim(slope) else slope * np.linalg.norm(by, axis=1, keepdims=True)
            far = far + duration * (0.0 if rate is None else np.array(rate))  # check 1.14
            return np.broadcast_to(far, (len(low), self.components)).repeat(self.results // self.components, axis=1)

        value = self.shaped(self.given((low + high) / 2, *self.inputs, sum(times) / 2))
        size = np.abs(value) + change(np.abs(low + high) / 2, abs(sum(times)) / 2)
        each = change(half, (times[1] - times[0]) / 2) * (1 + BOX_ROUNDED) + BOX_ROUNDED * size
        return intervals.sure(value - each, value + each)

    def shaped(self, answer: Any) -> Array:
        """What the function has returned for M points as float64 (M, results); ValueError for another number."""
        return np.asarray(answer, dtype=np.float64).reshape(-1, self.results)


class OfInputs:
    """A function of which every input has its own, such as the drift: bounds over boxes of many inputs at once.

    each : for every input a `Formula` or a `BlackBox`. results : how many results each has.
    """

    def __init__(self, each: Sequence[Any], results: int) -> None:
        """Keep the arguments, which the class describes."""
        self.each, self.results = each, results

    def bounds(self, inputs: Array, low: Array, high: Array, *parameters: Any) -> tuple[Array, Array]:
        """The least and the greatest values under inputs (M,) over boxes (M, coordinates): both (M, results).

        NaN where nothing is known.

        parameters : a pair of numbers or arrays (M,) for each parameter, its least and greatest value; the first is the
            time, which must be numbers for a black box, the only one that it has.
        """
        found = np.empty((2, self.results, len(inputs))).swapaxes(1, 2)
        for j in np.flatnonzero(np.bincount(inputs, minlength=len(self.each))).tolist():
            own = np.flatnonzero(inputs == j)  # check 3.83
            given = [(a[own], b[own]) if np.ndim(a) else (a, b) for a, b in parameters]
            found[0, own], found[1, own] = self.each[j].bounds(low[own], high[own], *given)
        return found[0], found[1]


@dataclass(frozen=True)
class Part:
    """The target or an unsafe set: where its function of the coordinates on `axes`, and of the time, is <= 0.

    name : in claims and errors.
    inputs : the indices of the inputs under which an unsafe set is unsafe; None: under all, and a state in it is
        unsafe, too.
    """

    name: str
    axes: tuple[int, ...]
    function: Formula | BlackBox
    inputs: tuple[int, ...] | None = None  # under which an unsafe set is unsafe; None: under all, and a state in it too

    def counts(self, j: Any) -> Any:
        """Whether the set is unsafe under input j: bool, or (M,) bool for indices (M,)."""
        return self.inputs is None or np.isin(j, self.inputs)  # check 4.50

    @property
    def least_of(self) -> Sequence[Formula | BlackBox]:
        """The functions of which the set's function is the least: the operands of `min`, or a list of it alone."""
        return self.function.least_of if isinstance(self.function, Formula) else [self.function]

    @cached_property
    def moving(self) -> bool:
        """Whether the level-set function depends on the time; computed once."""
        return self.function.reads("p")


class Functions:
    """The functions of a file by name, formulas and black boxes; what is no formula is taken from the problem given.

    texts : the head's entry of each formula. opaque : for each black box why it is one. problem : has
        `black_box(name)`, or is None.
    """

    def __init__(self, head: Mapping[str, Any], arrays: Arrays, problem: Any) -> None:
        """Read which functions are formulas and which are black boxes; ValueError where a name is both.

        Formulas are read when they are asked for.

        head : of the file. arrays : the open file, for tables of formulas. problem : the problem given beside the file,
            or None.
        """
        formulas = head["formulas"]
        expect(formulas["format"] == 1, "formulas must be of format 1", formulas["format"])  # check 7.17
        self.texts, self.opaque = formulas["functions"], dict(formulas["opaque"])
        self.arrays, self.problem = arrays, problem
        expect(not self.texts.keys() & self.opaque.keys(), "a function is a formula or a black box", [*self.opaque])
        self.tables: dict[int, Array] = {}

    def __contains__(self, name: str) -> bool:
        """Whether the file has a function of that name, as a formula or as a black box."""
        return name in self.texts or name in self.opaque

    def table(self, number: int, axes: int) -> Array:
        """The array of the table with this number in the file, float64, read once and kept.

        ValueError unless it has `axes` axes, or where all tables together have more than `MOST_TABLES` bytes.
        """
        if number not in self.tables:
            left = MOST_TABLES - sum(each.nbytes for each in self.tables.values())
            self.tables[number] = array(self.arrays, f"tables/{number}", np.float64, *[None] * axes, most=left)
        found = self.tables[number]
        # check 7.48
        expect(found.ndim == axes, f"table {number} must have an axis for each operand, {axes}", found.shape)
        return found

    def formula(self, name: str, coordinates: int, parameters: int = 1) -> Formula:
        """Read the formula of a name; ValueError unless the file has one of so many coordinates and parameters."""
        expect(name in self.texts, f"there must be a formula {name}", [*self.texts])  # check 7.18
        return read(name, self.texts[name], coordinates, parameters, self.table)

    def black_box(self, name: str) -> Any:
        """The black box of that name, from the problem that was given; ValueError if that problem has none."""
        try:
            return self.problem.black_box(name)
        except (AssertionError, AttributeError, LookupError):
            expect(False, "the problem given must have the black box of the file", name)

    def part(self, name: str, given: Mapping[str, Any], ndim: int, count: int = 0) -> Part:
        """Read a set; ValueError where something of it is wrong.

        name : its function's name in the file, such as "target" or "unsafe 0". given : the head's entry for the set.
        ndim : the number of axes. count : the number of inputs; with 0 the set must not name any.
        """
        axes = given["axes"]
        fits = isinstance(axes, list) and 0 < len(axes) == len({*axes})  # check 7.24
        fits = fits and all(is_whole(axis, 0, ndim - 1) for axis in axes)  # check 7.23
        expect(fits, "axes of a set must be some of the axes, each once", axes)
        own = BlackBox(name, self.black_box(name)) if name in self.opaque else self.formula(name, len(axes))
        expect(not isinstance(own, Formula) or len(own.results) == 1, f"{name} must have one result", own)  # check 7.21
        if (inputs := given.get("inputs")) is None:
            return Part(str(given["name"]), tuple(axes), own)
        fits = isinstance(inputs, list) and 0 < len(inputs) == len({*inputs})
        fits = fits and all(is_whole(j, 0, count - 1) for j in inputs)  # check 7.49
        expect(fits, "inputs of an unsafe set must be numbers of inputs, each once", inputs)
        return Part(str(given["name"]), tuple(axes), own, tuple(inputs))

    def parts(self, head: Any, ndim: int, count: int) -> tuple[Part | None, list[Part]]:
        """Read the target, None if there is none, and the list of the unsafe sets; ValueError where something is wrong.

        head : the head's list of sets, the target first. ndim, count : the numbers of axes and of inputs.
        """
        kinds = [given["kind"] for given in head]
        first = int("target" in kinds)
        fits = kinds == ["target"] * first + ["unsafe"] * (len(kinds) - first)  # check 7.25
        expect(fits, "sets must be a target, if there is one, and unsafe sets", kinds)
        target = self.part("target", head[0], ndim) if first else None
        return target, [self.part(f"unsafe {k}", given, ndim, count) for k, given in enumerate(head[first:])]


class Velocity:
    """Bounds on the velocity under each input: drift + gain v, or velocity(v), with |v| <= bounds in each component.

    linear : whether it is drift + gain v. disturbance_dim : the number of components of v.
    own : for each of the names "bounds", "drift" and "gain", or "velocity", the function of every input. of : for each
        name an `OfInputs` of these. all : all functions in a list.
    """

    def __init__(self, functions: Functions, inputs: list[Any], grid: Grid) -> None:
        """Read the functions for each of the inputs; ValueError where one has a wrong number of results.

        functions : the file's `Functions`. inputs : the head's list of inputs, at least one. grid : the robot's.
        """
        n, bounds = grid.ndim, functions.formula("bounds", grid.ndim)
        d = len(bounds.results) // len(inputs)
        fits = len(bounds.results) == d * len(inputs) and d <= MOST_COUNTED  # check 7.19
        expect(fits, "bounds must have as many results for each input", len(bounds.results))
        self.ndim, self.disturbance_dim, self.linear = n, d, "drift" in functions
        self.own: dict[str, list[Any]] = {"bounds": [bounds.part(j * d, d) for j in range(len(inputs))]}
        for name, each in {"drift": n, "gain": n * d}.items() if self.linear else [("velocity", n)]:
            if name in functions.opaque and self.linear:
                given = functions.black_box(name)
                self.own[name] = [BlackBox(name, given, each, n, (np.array(u, dtype=np.float64),)) for u in inputs]
                continue
            found = functions.formula(name, n, 1 + d * (name == "velocity"))
            fits = len(found.results) == len(inputs) * each  # check 7.20
            expect(fits, f"{name} must have {len(inputs) * each} results", len(found.results))
            self.own[name] = [found.part(j * each, each) for j in range(len(inputs))]
        self.all = [one for parts in self.own.values() for one in parts]
        sizes = {"bounds": d, "drift": n, "gain": n * d, "velocity": n}
        self.of = {name: OfInputs(each, sizes[name]) for name, each in self.own.items()}

    def along(self, axis: int) -> list[Any]:
        """The functions, of all inputs, that the velocity along an axis is made of: a list.

        Of formulas those of this axis alone, but the bounds of v; a black box as a whole.
        """
        d, some = self.disturbance_dim, list[Any]()
        for name, each in self.own.items():
            first, count = {"bounds": (0, d), "gain": (axis * d, d)}.get(name, (axis, 1))
            some += [one.part(first, count) if isinstance(one, Formula) else one for one in each]
        return some

    @cached_property
    def reads_itself(self) -> Array:
        """Along which axes the velocity may depend on the coordinate itself: (ndim,) bool. Computed once."""
        each = map(self.along, range(self.ndim))
        return np.array([any(one.reads("x", axis) for one in some) for axis, some in enumerate(each)])

    @property
    def depends_on_time(self) -> bool:
        """Whether any of the functions depends on the time."""
        return any(one.reads("p", 0) for one in self.all)

    def steady(self, axis: int, sensed: bool) -> bool:
        """Whether the velocity along an axis always lies in one range, whatever the state and the time.

        Asked of the velocity along all axes where measurements err (`sensed`), where a function is a black box, and if
        the velocity is not drift + gain v.
        """
        # Then a state that a wall holds back is where it would be without the wall, clipped.
        some = self.all
        if self.linear and not sensed and not any(isinstance(one, BlackBox) for one in self.all):
            some = self.along(axis)
        return not self.depends_on_time and not any(one.reads("x") for one in some)  # check 1.6

    def bounds(self, inputs: Array, low: Array, high: Array, times: Times, pushed: bool) -> tuple[Array, Array]:
        """The least and the greatest velocity under inputs (M,) over boxes (M, ndim) and times: both (M, ndim).

        NaN where nothing is known.

        inputs : their indices. low, high : the boxes, (M, ndim). times : from s to s. pushed : under any adversary; if
            False, under none, v = 0.
        """
        half = np.zeros((1, self.disturbance_dim))
        if pushed:  # check 3.31
            half = np.maximum(*map(np.abs, self.of["bounds"].bounds(inputs, low, high, times)))  # check 3.32
        if not self.linear:
            half = np.broadcast_to(half, (len(low), self.disturbance_dim))
            pushes = ((-one, one) for one in half.T)  # check 3.34
            return self.of["velocity"].bounds(inputs, low, high, times, *pushes)
        least, most = self.of["drift"].bounds(inputs, low, high, times)
        if not pushed:
            return least, most
        gain = np.maximum(*map(np.abs, self.of["gain"].bounds(inputs, low, high, times)))  # check 3.33
        each = gain.reshape(-1, self.ndim, self.disturbance_dim) * half[:, None]
        many = 2 * (1 + self.disturbance_dim)  # roundings, of products and of their sum, with some to spare
        push = each.sum(axis=2) * (1 + many * intervals.UNIT) + many * intervals.TINY  # check 3.35
        return intervals.outward(least - push, most + push)
