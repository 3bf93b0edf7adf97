"""What the head of a file says of a robot of one's own: its axes, sets, sensing, and functions, every part checked.

A function is a formula (`formulas`), or a black box: then the head says why, and it is taken from the problem that was
given beside the file.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import h5py
import numpy as np

from sdhj.certified.check import intervals
from sdhj.certified.check.bits import Array
from sdhj.certified.check.formulas import MOST_AXES, Formula, read
from sdhj.certified.check.reading import MOST_COUNTED, MOST_ON_AN_AXIS, array, expect, is_whole

LARGEST = 1e9  # of a number in the head
MOST_TABLE = 1 << 27  # bytes of a table
MOST_TABLES = 1 << 30  # of all together
ENDS = {"unsafe", "wall", "safe"}

Times = tuple[float, float]


def real(name: str, value: Any, least: float = -LARGEST, most: float = LARGEST) -> float:
    """A number of the head, from `least` to `most`."""
    fits = isinstance(value, int | float) and not isinstance(value, bool) and least <= value <= most
    expect(fits, f"{name} must be a number from {least:g} to {most:g}", value)
    return float(value)


@dataclass(frozen=True)
class Grid:
    """The axes of the state; `ends` are pairs of "unsafe", "wall" or "safe", `spacing` is that of the nodes."""

    lower: tuple[float, ...]
    upper: tuple[float, ...]
    spacing: tuple[float, ...]
    periodic: tuple[bool, ...]
    ends: tuple[tuple[str, str], ...]

    @classmethod
    def of(cls, told: Mapping[str, Any]) -> "Grid":
        lower, upper, periodic, shape = (told[name] for name in ("lower", "upper", "periodic", "shape"))
        ends = tuple((low, high) for low, high in told["ends"])
        fits = 1 <= len(lower) <= MOST_AXES and len({len(part) for part in (lower, upper, periodic, shape, ends)}) == 1
        expect(fits, f"a grid must have 1 to {MOST_AXES} axes", told)
        bounds = [(real("lower", a), real("upper", b)) for a, b in zip(lower, upper, strict=True)]
        expect(all(a < b for a, b in bounds), "lower ends must be below upper ends", bounds)
        expect(all(flag in (True, False) for flag in periodic), "periodic must be true or false", periodic)
        expect(all({*pair} <= ENDS for pair in ends), f"ends must be of {', '.join(sorted(ENDS))}", ends)
        expect(all(is_whole(n, 2, MOST_ON_AN_AXIS) for n in shape), "shape must be numbers of nodes", shape)
        spacing = tuple((b - a) / (n - 1) for (a, b), n in zip(bounds, shape, strict=True))
        return cls(tuple(a for a, _ in bounds), tuple(b for _, b in bounds), spacing, tuple(map(bool, periodic)), ends)

    @property
    def ndim(self) -> int:
        return len(self.lower)


class BlackBox:
    """A function that is no formula, by what its author states of it; some of its results only.

    given : has `enclosure(low, high, t0, t1)` or None, `slope` (a number, one for each axis, or None) and `rate` (a
    number or None), and is callable with points and a time.
    """

    def __init__(self, name: str, given: Any, own: slice = slice(None)) -> None:
        expect(given is not None, "the problem given must have the black box of the file", name)
        self.name, self.given, self.own = name, given, own

    def part(self, first: int, count: int) -> "BlackBox":
        return BlackBox(self.name, self.given, slice(first, first + count))

    def reads(self, leaf: str, number: int | None = None) -> bool:
        """Whether it may read a coordinate, "x", or the time, "p"."""
        return leaf == "x" or self.given.rate != 0

    def bounds(self, low: Array, high: Array, times: Times) -> tuple[Array, Array]:
        """As those of a formula: both (M, results)."""
        if self.given.enclosure is not None:
            ends = [
                np.asarray(end, dtype=np.float64).reshape(len(low), -1)
                for end in self.given.enclosure(low, high, *times)
            ]
            least, most = intervals.sure(ends[0], ends[1])
            return least[:, self.own], most[:, self.own]
        slope, rate = self.given.slope, self.given.rate
        stated = slope is not None and (rate is not None or times[0] == times[1])
        expect(stated, f"the black box {self.name} must have an enclosure, or a slope and a rate", (slope, rate))
        value = np.asarray(self.given((low + high) / 2, sum(times) / 2), dtype=np.float64).reshape(-1, 1)
        half = (high - low) / 2
        far = half @ np.array(slope) if np.ndim(slope) else slope * np.sqrt((half**2).sum(axis=1))
        far = (far[:, None] + (rate or 0.0) * (times[1] - times[0]) / 2) * (1 + 1e-9) + 1e-9 * (1 + np.abs(value))
        return intervals.sure(value - far, value + far)


@dataclass(frozen=True)
class Part:
    """The target or an unsafe set, and perhaps a function that is nowhere above its own from a time to another."""

    name: str
    axes: tuple[int, ...]
    function: Formula | BlackBox
    swept: Formula | None

    @property
    def moving(self) -> bool:
        return self.function.reads("p")


class Functions:
    """The formulas and the black boxes of a file."""

    def __init__(self, told: Mapping[str, Any], arrays: h5py.File, problem: Any) -> None:
        formulas = told["formulas"]
        expect(formulas["format"] == 1, "formulas must be of format 1", formulas["format"])
        self.told, self.opaque, self.arrays, self.problem = (
            formulas["functions"],
            dict(formulas["opaque"]),
            arrays,
            problem,
        )
        expect(not self.told.keys() & self.opaque.keys(), "a function is a formula or a black box", [*self.opaque])
        self.tables: dict[int, Array] = {}

    def __contains__(self, name: str) -> bool:
        return name in self.told or name in self.opaque

    def table(self, number: int, axes: int) -> Array:
        """A table of the file, on so many axes."""
        if number not in self.tables:
            group = self.arrays.get("tables", getlink=True)
            expect(isinstance(group, h5py.HardLink), "tables must be in the file itself", group)
            table = array(self.arrays, f"tables/{number}", np.float64, *[None] * axes, most=MOST_TABLE)
            self.tables[number] = table
            size = sum(each.nbytes for each in self.tables.values())
            expect(size <= MOST_TABLES, f"tables must take at most {MOST_TABLES} bytes", size)
        found = self.tables[number]
        expect(found.ndim == axes, f"table {number} must have an axis for each operand, {axes}", found.shape)
        return found

    def get(self, name: str, coordinates: int, parameters: int = 1) -> Formula | BlackBox:
        if name in self.opaque:
            return BlackBox(name, self.problem.black_box(name))
        expect(name in self.told, f"there must be a function {name}", [*self.told])
        return read(name, self.told[name], coordinates, parameters, self.table)

    def part(self, name: str, number: int, given: Mapping[str, Any], ndim: int) -> Part:
        """A set, by its name among the functions and what the head says."""
        axes = given["axes"]
        fits = isinstance(axes, list) and all(is_whole(axis, 0, ndim - 1) for axis in axes)
        expect(fits and axes and all(a < b for a, b in pairwise(sorted(axes))), "axes of a set must be some", axes)
        function, swept = self.get(name, len(axes)), None
        if name != "target" and f"swept {number}" in self.told:
            swept = read(f"swept {number}", self.told[f"swept {number}"], len(axes), 2, self.table)
        for one in (function, swept):
            if isinstance(one, Formula):
                expect(len(one.results) == 1, f"{name} must have one result", one.results)
        return Part(str(given["name"]), tuple(axes), function, swept)

    def parts(self, told: Any, ndim: int) -> tuple[Part | None, list[Part]]:
        """The target, if there is one, and the unsafe sets, by what the head says of sets."""
        kinds = [given["kind"] for given in told]
        first = int("target" in kinds)
        fits = kinds == ["target"] * first + ["unsafe"] * (len(kinds) - first)
        expect(fits, "sets must be a target, if there is one, and unsafe sets", kinds)
        target = self.part("target", 0, told[0], ndim) if first else None
        return target, [self.part(f"unsafe {k}", k, given, ndim) for k, given in enumerate(told[first:])]


class Velocity:
    """What the velocity can be: by the formulas of drift, gain and bounds, or of velocity and bounds."""

    def __init__(self, functions: Functions, inputs: int, grid: Grid) -> None:
        n = self.ndim = grid.ndim
        corner = np.array([grid.lower])

        def read_one(name: str, parameters: int = 1) -> tuple[Formula | BlackBox, int]:
            found = functions.get(name, n, parameters)
            if isinstance(found, Formula):
                return found, len(found.results)
            expect(found.given.enclosure is not None, "a black box of the velocity must have an enclosure", name)
            return found, found.bounds(corner, corner, (0.0, 0.0))[0].shape[1]

        bounds, count = read_one("bounds")
        d = self.adversaries = count // inputs
        expect(count == d * inputs and d <= MOST_COUNTED, "bounds must have as many results for each input", count)
        self.linear = "drift" in functions
        shapes = {"drift": n, "gain": n * d} if self.linear else {"velocity": n}
        self.own = {"bounds": [bounds.part(j * d, d) for j in range(inputs)]}
        self.all = [bounds]
        for name, each in shapes.items():
            found, count = read_one(name, 1 + d * (name == "velocity"))
            expect(count == inputs * each, f"{name} must have {inputs * each} results", count)
            expect(name != "velocity" or isinstance(found, Formula), "velocity must be a formula", name)
            self.own[name] = [found.part(j * each, each) for j in range(inputs)]
            self.all.append(found)

    @property
    def timed(self) -> bool:
        return any(one.reads("p", 0) for one in self.all)

    @property
    def constant(self) -> bool:
        return not self.timed and not any(one.reads("x") for one in self.all)

    def bounds(self, j: int, low: Array, high: Array, times: Times, pushed: bool) -> tuple[Array, Array]:
        """Least and greatest velocity under u_j and any adversary, or none, over boxes (M, ndim): both (M, ndim)."""
        half = np.zeros((len(low), self.adversaries))
        if pushed:
            half = np.maximum(*map(np.abs, self.own["bounds"][j].bounds(low, high, times)))
        if not self.linear:
            velocity: Any = self.own["velocity"][j]
            found: tuple[Array, Array] = velocity.bounds(low, high, times, *((-one, one) for one in half.T))
            return found
        least, most = self.own["drift"][j].bounds(low, high, times)
        if not pushed:
            return least, most
        gain = np.maximum(*map(np.abs, self.own["gain"][j].bounds(low, high, times)))
        pushes = gain.reshape(len(low), self.ndim, self.adversaries) * half[:, None]
        push = pushes.sum(axis=2) * (1 + MOST_COUNTED * intervals.UNIT) + MOST_COUNTED * intervals.TINY
        return intervals.outward(least - push, most + push)


@dataclass(frozen=True)
class Sensing:
    """How the robot senses; `error` for each axis."""

    error: Array
    delay: float
    jitter: float

    @classmethod
    def of(cls, told: Mapping[str, Any], ndim: int, delta: float) -> "Sensing":
        error = told.get("error", 0.0)
        errors = error if isinstance(error, list) else [error] * ndim
        expect(len(errors) == ndim, f"error must be {ndim} numbers", error)
        delay = real("delay", told.get("delay", 0.0), 0.0, delta)
        jitter = real("jitter", told.get("jitter", 0.0), 0.0, delta / 2)
        return cls(np.array([real("error", one, 0.0) for one in errors]), delay, jitter)

    def __bool__(self) -> bool:
        return bool(self.error.any()) or self.delay > 0 or self.jitter > 0
