"""The problem that a file states, read entry by entry: what it is, and how it is printed.

An entry that is not what it has to be is refused with a sentence (`expect`), and so is one that is not known: nothing
in a file is passed over that could change what its sets mean. What is printed is what was read, so who compares it with
the robot has compared what is proved of it.

Boxes are arrays (2, axes, M), the lower and the upper ends of M of them; a function over boxes has bounds (2, results,
M), NaN where nothing is known.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from typing import Any

import numpy as np

from sdhj.certified.check.formulas import MOST_AXES, Formula, Node, read
from sdhj.certified.check.intervals import TINY, UNIT, Array, outward, sure
from sdhj.certified.check.reading import (
    MOST_COUNTED,
    MOST_ON_AN_AXIS,
    MOST_STEPS,
    MOST_TABLES,
    SMALLEST,
    array,
    expect,
    is_whole,
    real,
    reals,
)

MOST_INPUTS = 1 << 16
BOX_ROUNDED = 1e-9  # of what a black box is, and may change by from zero on: more than it rounds, in any units
ENDS = {"unsafe", "wall", "safe"}
MOST_LINES = 40  # of a function, and of inputs, that are printed

Times = tuple[float, float]


def entry(what: str, given: Any, needed: str, may_have: str = "") -> Mapping[str, Any]:
    """An entry of the head, which must have all fields `needed`, a text of names, and no others but `may_have`."""
    expect(isinstance(given, dict), f"{what} must be an entry with fields", given)
    lacks = [name for name in needed.split() if name not in given]
    expect(not lacks, f"{what} must have the fields {needed.replace(' ', ', ')}", [*given])
    # A field that nobody reads could change what a table means.
    unknown = [name for name in given if name not in f"{needed} {may_have}".split()]
    expect(not unknown, f"{what} must have no unknown field", unknown)
    return dict(given)


def listed(what: str, given: Any, count: int) -> list[Any]:
    """An entry that must be a list of `count` things."""
    expect(isinstance(given, list) and len(given) == count, f"{what} must be a list of {count}", given)
    return list(given)


def flags(what: str, given: Any, count: int) -> Array:
    """An entry that must be a list of `count` truth values."""
    each = listed(what, given, count)
    expect(all(isinstance(one, bool) for one in each), f"{what} must be true or false", given)
    return np.array(each, np.bool_)


def label(given: Any) -> str:
    """A name as it is printed: at most 100 characters, in one line."""
    expect(isinstance(given, str), "a name must be text", given)
    return "".join(one if one.isprintable() else repr(one)[1:-1] for one in given[:100])


class BlackBox:
    """A function that is no formula: its author states how far its values lie apart, and the check believes that."""

    def __init__(self, name: str, given: Any, results: int, components: int, inputs: tuple[Any, ...] = ()) -> None:
        """`inputs` are what the function `given` is called with between points and times."""
        self.name, self.given, self.inputs = name, given, inputs
        self.results, self.components, self.rng = results, components, np.random.default_rng(0)

    @property
    def least_of(self) -> list["BlackBox"]:
        """The functions of which it is the least: itself alone."""
        return [self]

    def reads(self, leaf: str, number: int | None = None) -> bool:
        """Whether it may depend on coordinates, "x": always; or on the time, "p": unless its rate is 0."""
        return leaf == "x" or self.given.rate is None or bool(np.any(self.given.rate))

    def bounds(self, low: Array, high: Array, times: Times) -> tuple[Array, Array]:
        """What its author states of boxes and times; refused where a value is beyond."""
        least, most = self.stated(low, high, times)
        # At a place by chance in each box and at either end of the times: this finds errors and proves nothing.
        for time in times:
            place = low + self.rng.random(low.shape) * (high - low)
            value = self.shaped(self.given(place, *self.inputs, time))
            near = BOX_ROUNDED * (np.abs(value) + np.abs(least) + np.abs(most))
            wrong = np.flatnonzero(((value < least - near) | (value > most + near)).any(axis=1))[:1]
            what = f"what is stated of the black box {self.name} must hold at {time:g} s and {place[wrong].tolist()}"
            expect(not wrong.size, what, value[wrong].tolist())
        return least, most

    def stated(self, low: Array, high: Array, times: Times) -> tuple[Array, Array]:
        """The author's enclosure, or the value in the middle -+ slope |half width| + rate * half the time."""
        if self.given.enclosure is not None:
            least, most = self.given.enclosure(low, high, *self.inputs, *times)
            return sure(self.shaped(least), self.shaped(most))
        slope, rate = self.given.slope, self.given.rate
        stated = slope is not None and (rate is not None or times[0] == times[1])
        expect(stated, f"the black box {self.name} must have an enclosure, or a slope and a rate", (slope, rate))

        def change(by: Array, duration: float) -> Array:
            far = by @ np.atleast_2d(slope).T if np.ndim(slope) else slope * np.linalg.norm(by, axis=1, keepdims=True)
            far = far + duration * (0.0 if rate is None else np.array(rate))
            return np.broadcast_to(far, (len(low), self.components)).repeat(self.results // self.components, axis=1)

        # as `BlackBox.bounds` of the solver does, with as much for rounding
        value = self.shaped(self.given((low + high) / 2, *self.inputs, sum(times) / 2))
        # How large values may be, as rounding is a share of them.
        size = np.abs(value) + change(np.abs(low + high) / 2, abs(sum(times)) / 2)
        each = change((high - low) / 2, (times[1] - times[0]) / 2) * (1 + BOX_ROUNDED) + BOX_ROUNDED * size
        return sure(value - each, value + each)

    def shaped(self, answer: Any) -> Array:
        """What the function returned for M points, (M, results)."""
        return np.asarray(answer, dtype=np.float64).reshape(-1, self.results)


Function = Formula | BlackBox


@dataclass(frozen=True)
class Part:
    """The target or an unsafe set: where its function of the coordinates on `axes`, and of the time, is <= 0.

    inputs : those under which an unsafe set is unsafe; None: under all, and a state in it is unsafe, too.
    """

    name: str
    called: str
    axes: list[int]
    function: Function
    inputs: list[int] | None

    @cached_property
    def moving(self) -> bool:
        """Whether the set depends on the time."""
        return self.function.reads("p")


class Problem:
    """The problem of a file: axes, inputs, interval, sensing, the functions of velocities, target and unsafe sets.

    lower, upper, spacing (ndim,), periodic (ndim,) bool, ends : of each axis, the last the names of both ends.
    delta, steps, count : the interval, s, how many there are, and how many inputs. target, unsafe : of `Part`.
    """

    def __init__(self, head: Mapping[str, Any], arrays: Any, given: Any) -> None:
        """Read a head, with the problem that is `given` beside the file."""
        self.head, self.arrays, self.given = head, arrays, given
        self.tables: dict[int, Array] = {}
        self.read_grid(entry("grid", head["grid"], "lower upper periodic shape ends", "names"))
        self.delta, self.steps = real("delta", head["delta"], SMALLEST), head["steps"]
        expect(is_whole(self.steps, 1, MOST_STEPS), f"steps must be a number up to {MOST_STEPS}", self.steps)
        self.read_inputs(head["inputs"])
        self.read_sensing(entry("sensing", head["sensing"], "", "error delay jitter rest memory"))
        formulas = entry("formulas", head["formulas"], "format functions opaque", "pieces")  # these of other methods
        expect(is_whole(formulas["format"], 1, 1), "formulas must be of format 1", formulas["format"])
        self.texts, self.opaque = dict(formulas["functions"]), dict(formulas["opaque"])
        both = [name for name in self.opaque if name in self.texts]
        expect(not both, "a function is a formula or a black box", both)
        self.read_velocity()
        self.read_sets(head["sets"])
        known = {*self.of, *(part.name for part in self.parts)}
        known |= {f"swept {number}" for number in range(len(self.unsafe))}  # of methods on a grid; not asked here
        unknown = [name for name in {**self.texts, **self.opaque} if name not in known]
        expect(not unknown, "functions must be of velocities, the target or unsafe sets", unknown)

    def read_grid(self, grid: Mapping[str, Any]) -> None:
        """Read the axes: their ends, what is at these, and how far nodes are apart."""
        n = len(grid["lower"])
        fits = 1 <= n <= MOST_AXES and isinstance(grid["lower"], list)
        expect(fits, f"a grid must have 1 to {MOST_AXES} axes", grid["lower"])
        bounds = [*zip(reals("lower", grid["lower"], n), reals("upper", grid["upper"], n), strict=True)]
        # of smaller numbers rounding is no share any more
        expect(all(b - a >= SMALLEST for a, b in bounds), f"upper ends must be {SMALLEST:g} above lower ends", bounds)
        shape = listed("shape", grid["shape"], n)
        expect(all(is_whole(one, 2, MOST_ON_AN_AXIS) for one in shape), "shape must be numbers of nodes", shape)
        self.ends = [listed("the ends of an axis", pair, 2) for pair in listed("ends", grid["ends"], n)]
        names = [end for pair in self.ends for end in pair]
        expect(all(isinstance(end, str) and end in ENDS for end in names), "ends must be of safe, unsafe, wall", names)
        self.ndim, self.periodic = n, flags("periodic", grid["periodic"], n)
        self.lower, self.upper = np.array(bounds).T
        self.spacing = (self.upper - self.lower) / (np.array(shape) - 1)
        self.names = [label(one) for one in listed("names", grid.get("names", [f"x{k + 1}" for k in range(n)]), n)]

    def read_inputs(self, given: Any) -> None:
        """Read the inputs, rows of as many numbers each."""
        fits = isinstance(given, list) and 1 <= len(given) <= MOST_INPUTS
        expect(fits, f"there must be 1 to {MOST_INPUTS} inputs", given)
        size = len(given[0]) if isinstance(given[0], list) else -1
        self.inputs = [reals("an input", one, size) for one in given]
        self.count = len(self.inputs)

    def read_sensing(self, given: Mapping[str, Any]) -> None:
        """Read the errors of measurements, how late inputs act, how far a clock is off, and memory."""
        error = given.get("error", 0.0)
        error = error if isinstance(error, list) else [error] * self.ndim
        self.error = np.array(reals("error", error, self.ndim, 0.0))
        self.delay = real("delay", given.get("delay", 0.0), 0.0, self.delta)
        self.jitter = real("jitter", given.get("jitter", 0.0), 0.0, self.delta / 2)
        both = self.delay + 2 * self.jitter
        expect(both <= self.delta, "delay + 2 jitter must be at most delta: inputs begin in their order", both)
        expect(isinstance(given.get("memory", False), bool), "memory must be true or false", given.get("memory"))
        # only looked at: no claim rests on what was applied before the first step
        rest = given.get("rest", 0)
        expect(is_whole(rest, 0, self.count - 1), "rest must be the number of an input", rest)
        self.sensed = bool(self.error.any()) or self.delay > 0 or self.jitter > 0
        self.memory = given.get("memory", False) and self.sensed

    # ---- functions

    def table(self, number: int, axes: int) -> Array:
        """The table of a formula, read once."""
        if number not in self.tables:
            # All tables together have so much room, however many a file names.
            left = MOST_TABLES - sum(each.nbytes for each in self.tables.values())
            self.tables[number] = array(self.arrays, f"tables/{number}", np.float64, *[None] * axes, most=left)
        found = self.tables[number]
        expect(found.ndim == axes, f"table {number} must have an axis for each operand, {axes}", found.shape)
        return found

    def formula(self, name: str, coordinates: int, parameters: int = 1) -> Formula:
        """The formula of a name, of so many coordinates and parameters."""
        expect(name in self.texts, f"there must be a formula {name}", [*self.texts])
        text = entry(f"the formula {name}", self.texts[name], "coordinates parameters lines")
        return read(name, text, coordinates, parameters, self.table)

    def black_box(self, name: str) -> Any:
        """The black box of a name, of the problem that was given beside the file."""
        try:
            return self.given.black_box(name)
        except (AssertionError, AttributeError, LookupError):
            expect(False, "the problem given must have the black box of the file", name)

    def read_velocity(self) -> None:
        """Read drift + gain v, or velocity(v), and the bounds of v: a function for every input."""
        n, bounds = self.ndim, self.formula("bounds", self.ndim)
        d, rest = divmod(len(bounds.results), self.count)
        expect(not rest and d <= MOST_COUNTED, "bounds must have as many results for each input", len(bounds.results))
        self.linear, self.disturbances = "drift" in self.texts or "drift" in self.opaque, d
        self.of: dict[str, list[Any]] = {"bounds": [bounds.part(j * d, d) for j in range(self.count)]}
        for name, size in (("drift", n), ("gain", n * d)) if self.linear else (("velocity", n),):
            if name in self.opaque and self.linear:
                own = self.black_box(name)
                self.of[name] = [BlackBox(name, own, size, n, (np.array(u, np.float64),)) for u in self.inputs]
                continue
            whole = self.formula(name, n, 1 + d * (name == "velocity"))
            fits = len(whole.results) == self.count * size
            expect(fits, f"{name} must have {self.count * size} results", len(whole.results))
            self.of[name] = [whole.part(j * size, size) for j in range(self.count)]
        every = [one for each in self.of.values() for one in each]
        self.timed = any(one.reads("p", 0) for one in every)
        self.reads = np.zeros((n, n), np.bool_)  # of the velocity along an axis, which coordinates
        for axis in range(n):
            functions = self.along(axis)
            self.reads[axis] = [any(one.reads("x", k) for one in functions) for k in range(n)]
        self.trusted = {name for name in self.of if name in self.opaque}

    def along(self, axis: int) -> list[Function]:
        """The functions, of all inputs, of which the velocity along an axis is made."""
        # results of a gain lie by axes, and of each axis by components of v
        some: list[Function] = []
        for name, each in self.of.items():
            first, count = {
                "bounds": (0, self.disturbances),
                "gain": (axis * self.disturbances, self.disturbances),
            }.get(name, (axis, 1))
            some += [one.part(first, count) if isinstance(one, Formula) else one for one in each]
        return some

    def steady(self, axis: int) -> bool:
        """Whether the velocity along an axis is always in one range, whatever the state and the time."""
        # `is_steady` of the solver, which decides what is no axis of a place, must not say more
        boxed = any(isinstance(one, BlackBox) for each in self.of.values() for one in each)
        plain = self.linear and not self.sensed and not boxed
        some = self.along(axis) if plain else [one for each in self.of.values() for one in each]
        return not self.timed and not any(one.reads("x") for one in some)

    def velocity(self, j: int, low: Array, high: Array, times: Times, pushed: bool) -> tuple[Array, Array]:
        """The least and the greatest velocity under u_j over boxes (ndim, M) and times, both (ndim, M).

        pushed : under any adversary, v from -bounds to bounds; if False, under none, v = 0.
        """

        def of(name: str, *more: Any) -> Array:
            return np.array(self.of[name][j].bounds(low.T, high.T, times, *more)).swapaxes(1, 2)

        half = np.abs(of("bounds")).max(axis=0) if pushed else np.zeros((self.disturbances, len(low.T)))
        if not self.linear:
            least, most = of("velocity", *((-one, one) for one in half))
            return least, most
        least, most = of("drift")
        if not pushed:
            return least, most
        gain = np.abs(of("gain")).max(axis=0).reshape(self.ndim, self.disturbances, len(low.T))
        many = 2 * (1 + self.disturbances)  # roundings, of products and of their sum, with some to spare
        push = (gain * half).sum(axis=1) * (1 + many * UNIT) + many * TINY
        return outward(least - push, most + push)

    def read_sets(self, given: Any) -> None:
        """Read the sets: a target, if there is one, and behind it the unsafe sets."""
        sets = [entry("a set", one, "kind name axes", "inputs sampling") for one in list(given)]
        kinds = [one["kind"] for one in sets]
        # functions have the names that `ReachAvoidProblem.functions` gives them, unsafe sets by their order
        first = int("target" in kinds)
        fits = isinstance(given, list) and kinds == ["target"] * first + ["unsafe"] * (len(kinds) - first)
        expect(fits, "sets must be a target, if there is one, and unsafe sets", kinds)
        self.target = self.part("target", sets[0]) if first else None
        self.unsafe = [self.part(f"unsafe {number}", one) for number, one in enumerate(sets[first:])]
        self.parts = [*([self.target] if self.target else []), *self.unsafe]
        self.trusted |= {part.called for part in self.parts if isinstance(part.function, BlackBox)}

    def part(self, name: str, given: Mapping[str, Any]) -> Part:
        """Read one set, whose function has that name."""
        axes, inputs = given["axes"], given.get("inputs")
        fits = isinstance(axes, list) and len(axes) > 0 and all(is_whole(axis, 0, self.ndim - 1) for axis in axes)
        expect(fits and len({*axes}) == len(axes), "axes of a set must be some of the axes, each once", axes)
        boxed = name in self.opaque
        own: Function = BlackBox(name, self.black_box(name), 1, 1) if boxed else self.formula(name, len(axes))
        expect(not isinstance(own, Formula) or len(own.results) == 1, f"{name} must have one result", own)
        # A target counts under all inputs, so that inputs of one would be read by nobody.
        if inputs is not None:
            fits = isinstance(inputs, list) and len(inputs) > 0 and name != "target"
            fits = fits and all(is_whole(j, 0, self.count - 1) for j in inputs) and len({*inputs}) == len(inputs)
            expect(fits, "inputs of an unsafe set must be numbers of inputs, each once", inputs)
        return Part(name, label(given["name"]), axes, own, inputs)

    # ---- as it is printed

    def __str__(self) -> str:
        """The problem as it was read, for who compares it with the robot."""
        shown = [f"the state, {self.ndim} numbers:"]
        for k, name in enumerate(self.names):
            at = "closes" if self.periodic[k] else "ends: " + ", ".join(self.ends[k])
            shown.append(f"  {name} from {self.lower[k]:.9g} to {self.upper[k]:.9g}, {at}")
        shown.append(f"{self.steps} intervals of {self.delta:.9g} s")
        if self.sensed:
            error = ", ".join(f"{one:.9g}" for one in self.error)
            remembers = "remembers" if self.memory else "does not remember"
            shown.append(
                f"measured up to {error}, late by {self.delay:.9g} s, a clock off by {self.jitter:.9g} s; {remembers}"
            )
        shown.append(f"{self.count} inputs:")
        shown += shortened([f"u{j} = ({', '.join(f'{one:.9g}' for one in u)})" for j, u in enumerate(self.inputs)])
        shown += self.velocity_as_text()
        for part in self.parts:
            when = "" if part.inputs is None else f" under {', '.join(f'u{j}' for j in part.inputs)}"
            kind = "target" if part is self.target else f"unsafe{when}"
            shown.append(f"{kind}, {part.called}:")
            if isinstance(part.function, BlackBox):
                shown.append("  a black box, of which what its author states is believed")
                continue
            letters, (value,) = in_infix(part.function, [self.names[axis] for axis in part.axes], ["t"])
            shown += shortened([*letters, f"{value} <= 0"])
        return "\n".join(shown)

    def velocity_as_text(self) -> list[str]:
        """Lines that say the velocity, of all inputs together where it is the same."""
        v = [f"v{k + 1}" for k in range(self.disturbances)]
        shown = ["velocities, drift + gain v with |v| <= bounds:" if self.linear else "velocities, with |v| <= bounds:"]
        for name, each in self.of.items():
            if isinstance(each[0], BlackBox):
                shown.append(f"  {name}: a black box, of which what its author states is believed")
                continue
            size = len(each[0].results)
            # As one formula, so that what inputs share has one letter.
            whole = Formula(each[0].nodes, tuple(result for one in each for result in one.results))
            letters, values = in_infix(whole, self.names, ["t", *v])
            own = [values[j * size : (j + 1) * size] for j in range(self.count)]
            lines = [*letters]
            for k in range(size):
                # a gain has a result for each axis and component, bounds one for each component, all else for each axis
                axis, component = divmod(k, max(self.disturbances, 1)) if name == "gain" else (k, k)
                what = {
                    "bounds": f"|v{k + 1}| <=",
                    "gain": f"d{self.names[axis % self.ndim]}/dt: v{component + 1} *",
                }.get(name, f"d{self.names[axis % self.ndim]}/dt: {name}")
                # A product with what may be a sum.
                texts = [f"({row[k]})" if name == "gain" and " " in row[k] else row[k] for row in own]
                # Only inputs that follow each other are put together.
                for text, some in groupby(range(self.count), texts.__getitem__):
                    numbers = [*some]
                    under = f"    [u{numbers[0]} to u{numbers[-1]}]" if len(numbers) > 1 else f"    [u{numbers[0]}]"
                    lines.append(f"{what} {text}" + ("" if len(numbers) == self.count else under))
            shown += shortened(lines)
        return shown


def shortened(lines: Sequence[str]) -> list[str]:
    """The lines, indented, and of more than `MOST_LINES` how many are left out."""
    more = len(lines) - MOST_LINES
    return [f"  {line}" for line in lines[:MOST_LINES]] + [f"  and {more} lines more"] * (more > 0)


SIGNS = {  # how strongly it binds, and the sign between the operands
    "or": (0, "or"),
    "and": (1, "and"),
    "less": (2, "<"),
    "lesseq": (2, "<="),
    "equal": (2, "=="),
    "add": (3, "+"),
    "sub": (3, "-"),
    "mul": (4, "*"),
    "div": (4, "/"),
}
LONG = 70  # characters, from which on a part of a formula has a name of its own


def in_infix(formula: Formula, coordinates: Sequence[str], parameters: Sequence[str]) -> tuple[list[str], list[str]]:
    """A formula as people write it: lines that name what is used twice or is long, and its results."""
    uses = [0] * len(formula.nodes)
    for number in formula.needed:
        for operand in formula.nodes[number].operands:
            uses[operand] += 1
    said: dict[int, tuple[int, str]] = {}  # by node how strongly its text binds, and the text
    lines: list[str] = []
    for number in formula.needed:
        node = formula.nodes[number]
        binds, text = written(node, [said[operand] for operand in node.operands], coordinates, parameters)
        if node.operands and (uses[number] > 1 or (len(text) > LONG and uses[number])):
            lines.append(f"e{len(lines) + 1} = {text}")
            binds, text = 9, f"e{len(lines)}"
        said[number] = binds, text
    return lines, [said[number][1] for number in formula.results]


def written(
    node: Node, operands: Sequence[tuple[int, str]], coordinates: Sequence[str], parameters: Sequence[str]
) -> tuple[int, str]:
    """How strongly the text of a node binds, and the text, from those of its operands."""

    def within(k: int, least: int) -> str:
        binds, text = operands[k]
        return text if binds >= least else f"({text})"

    # the larger the number the closer it binds, as in `SIGNS`; with 9 no parentheses are needed anywhere
    if node.name in ("x", "p"):
        return 9, (coordinates if node.name == "x" else parameters)[node.given[0]]
    if node.name == "const":
        return (9 if node.given[0] >= 0 else 3), repr(node.given[0])
    if node.name in SIGNS:
        binds, sign = SIGNS[node.name]
        # Operations of one strength go from left to right: at the right such an operand needs parentheses.
        chained = binds == SIGNS["less"][0]  # a < b < c would be read as both
        return binds, f"{within(0, binds + chained)} {sign} {within(1, binds + 1)}"
    if node.name == "neg":
        return 3, f"-{within(0, 5)}"
    if node.name in ("sqr", "power"):
        return 6, f"{within(0, 7)}^{node.given[0] if node.name == 'power' else 2}"
    if node.name == "gridded":
        table, lower, spacing = node.given
        size = " x ".join(map(str, table.shape))
        return 9, f"table[{size}, from {lower}, by {spacing}]({', '.join(text for _, text in operands)})"
    return 9, f"{node.name}({', '.join(text for _, text in operands)})"
