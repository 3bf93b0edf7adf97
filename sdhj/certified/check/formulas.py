"""Formulas of a file: text that is read, refused where it is none, and evaluated over boxes by `intervals`.

A formula is a list of lines, numbered from 0. Each is a coordinate (`x 0`), a parameter (`p 0`), a hexadecimal number
(`const 0x1.8p+0`), or an operation and the numbers of earlier lines (`mul 2 3`); the last line, `return`, has the
numbers of the results. So nothing is recursive, and reading takes time in proportion to the text.
"""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from sdhj.certified.check.intervals import JUMPS, RULES, TRUTHS, Array, Interval, gridded, sure
from sdhj.certified.check.reading import expect

MOST_LINES = 100_000  # of a formula
MOST_EXPONENT = 64
MOST_AXES = 6  # of a table
MOST_JUMPS = 4  # of a function that are taken apart
MOST_NUMBERS = 1 << 23  # in memory at once, while a formula is evaluated
MOST_BOXES = 1 << 13  # at once: one thread takes 1.4 s for 1.8 of an arm, as numbers stay near the processor
WHOLE = re.compile("[0-9]{1,6}")
EXPONENT = re.compile("-?[0-9]{1,2}")
REAL = re.compile(r"nan|-?(inf|0x[01](\.[0-9a-f]{1,13})?p[+-][0-9]{1,4})")

Tables = Callable[[int, int], Array]  # number and axes of a table to its values


@dataclass(frozen=True)
class Node:
    """One line of a formula: an operation by name, the numbers of the nodes that are its operands, and constants.

    given : the number of a coordinate or parameter, the value of a constant, an exponent, or of `gridded` what the
        interpolation needs.
    """

    name: str
    operands: tuple[int, ...] = ()
    given: tuple[Any, ...] = ()


class Reader:
    """Reads the lines of one function, once: `Reader(...).read(lines)`. ValueErrors name the line and the function."""

    def __init__(self, what: str, coordinates: int, parameters: int, tables: Tables) -> None:
        """For a function of a name, of so many coordinates and parameters."""
        self.what, self.tables, self.line = what, tables, ""
        self.leaves = {"x": coordinates, "p": parameters}
        self.nodes: list[Node] = []
        self.truths: set[int] = set()  # numbers of nodes that are truth values

    def expect(self, fits: bool, wrong: str) -> None:
        """Raise ValueError unless `fits`, with the line being read."""
        if not fits:
            expect(False, f"line {len(self.nodes)} of {self.what}: {wrong}", self.line)

    def whole(self, word: str, below: int, of: str) -> int:
        """A word of the line as a whole number from 0 to below - 1."""
        self.expect(WHOLE.fullmatch(word) is not None and int(word) < below, f"{of} must be a number below {below}")
        return int(word)

    def real(self, word: str) -> float:
        """A word of the line, a hexadecimal number, nan, inf or -inf, as a float."""
        self.expect(REAL.fullmatch(word) is not None, "a number must be hexadecimal, as 0x1.8p+0")
        try:
            return float.fromhex(word)
        except OverflowError:
            self.expect(False, "a number must not be as large")
            raise

    def operands(self, words: list[str]) -> tuple[int, ...]:
        """The words of a line as the numbers of earlier nodes."""
        return tuple(self.whole(word, len(self.nodes), "an operand") for word in words)

    def read(self, lines: Any) -> "Formula":
        """The `Formula` that a list of lines of text describes, the last one `return`."""
        # as `written` in `sdhj.formulas.text` makes them
        fits = isinstance(lines, list) and 1 <= len(lines) <= MOST_LINES
        expect(fits, f"{self.what} must be a list of at most {MOST_LINES:,} lines", lines)
        for line in lines:
            self.line = line
            self.expect(isinstance(line, str), "a line must be text")
            name, *words = line.split(" ")
            if len(self.nodes) == len(lines) - 1:
                self.expect(name == "return", "the last line must be `return` and the numbers of the results")
                return Formula(tuple(self.nodes), self.operands(words))
            node = self.node(name, words)
            if self.is_truth(node):
                self.truths.add(len(self.nodes))
            self.nodes.append(node)
        # Never reached, as the last line returns.
        raise AssertionError

    def node(self, name: str, words: list[str]) -> Node:
        """The node of one line: the operation `name`, and the words behind it. `mul n n` becomes a square."""
        if name in self.leaves or name == "const":
            self.expect(len(words) == 1, f"{name} must be followed by one number")
            if name == "const":
                return Node(name, (), (self.real(words[0]),))
            kind = "a coordinate" if name == "x" else "a parameter"
            return Node(name, (), (self.whole(words[0], self.leaves[name], kind),))
        if name == "gridded":
            return self.gridded(words)
        self.expect(name in RULES, "an operation must be one of those that are known")
        count = RULES[name][0]
        self.expect(len(words) == count + (name == "power"), f"{name} must have {count} operands")
        operands = self.operands(words[:count])
        if name == "power":
            exponent = int(words[1]) if EXPONENT.fullmatch(words[1]) else MOST_EXPONENT + 1
            self.expect(abs(exponent) <= MOST_EXPONENT, f"an exponent must be from -{MOST_EXPONENT} to {MOST_EXPONENT}")
            return Node(name, operands, (exponent,))
        # Other operations may take truth values, as 0 and 1.
        truths = operands[:1] if name == "where" else operands if name in ("and", "or", "not") else ()
        self.expect(self.truths.issuperset(truths), f"{name} must be given truth values")
        # as a product of two unknowns it could seem negative
        same = name == "mul" and operands[0] == operands[1]
        return Node("sqr", operands[:1]) if same else Node(name, operands)

    def is_truth(self, node: Node) -> bool:
        """Whether a node's value is surely 0, 1 or NaN: a comparison, such a constant, or a choice between these."""
        chosen = node.name == "where" and self.truths.issuperset(node.operands[1:])
        known = node.name == "const" and (node.given[0] in (0.0, 1.0) or math.isnan(node.given[0]))
        return node.name in TRUTHS or chosen or known

    def gridded(self, words: list[str]) -> Node:
        """The node of a line `gridded TABLE operands lower ... spacing ...`, with a number each for every operand."""
        # A table's number, `lower` and `spacing`, and three words for each operand.
        axes = (len(words) - 3) // 3
        fits = 1 <= axes <= MOST_AXES and len(words) == 3 + 3 * axes
        fits = fits and (words[1 + axes], words[2 + 2 * axes]) == ("lower", "spacing")
        self.expect(fits, f"gridded must have a table, 1 to {MOST_AXES} operands, `lower`, `spacing`, numbers for each")
        operands = self.operands(words[1 : 1 + axes])
        lower, spacing = [[self.real(word) for word in words[at : at + axes]] for at in (2 + axes, 3 + 2 * axes)]
        finite = all(map(math.isfinite, lower + spacing)) and min(spacing) > 0
        self.expect(finite, "`lower` must be finite and `spacing` above 0")
        table = self.tables(self.whole(words[0], 10**6, "a table"), axes)
        self.expect(min(table.shape) >= 2, "a table must have two nodes on each axis")
        return Node("gridded", operands, (table, lower, spacing))


@dataclass(frozen=True)
class Formula:
    """A function as a tuple of nodes, each after its operands, and the numbers of those that are its results.

    Of each parameter the least and the greatest value is given; `sides` has, by the number of a node that jumps, 0 or 1
    if only that side of its jump counts.
    """

    nodes: tuple[Node, ...]
    results: tuple[int, ...]

    def part(self, first: int, count: int) -> "Formula":
        """The formula of `count` of the results, from number `first` on; the same nodes."""
        return Formula(self.nodes, self.results[first : first + count])

    @cached_property
    def least_of(self) -> list["Formula"]:
        """Formulas of one result each, of whose values the first result is the least."""
        found, left = list[int](), [self.results[0]]
        while left:
            node = self.nodes[number := left.pop()]
            if node.name == "min":
                # A node may be an operand of several: it is asked about once.
                left += {*node.operands}
            elif number not in found:
                found.append(number)
        return [Formula(self.nodes, (number,)) for number in found]

    @cached_property
    def needed(self) -> list[int]:
        """The numbers of the nodes that the results rest on, ascending."""
        found, left = set(self.results), list(set(self.results))
        while left:
            new = set(self.nodes[left.pop()].operands) - found
            found |= new
            left += new
        return sorted(found)

    def reads(self, leaf: str, number: int | None = None) -> bool:
        """Whether a result depends on a coordinate (leaf "x") or a parameter (leaf "p") of that number, or any."""
        found = (self.nodes[n] for n in self.needed)
        return any(node.name == leaf and number in (None, *node.given) for node in found)

    @cached_property
    def jumps(self) -> list[int]:
        """The numbers of the nodes whose operations jump (`JUMPS`); [] for more than `MOST_JUMPS`."""
        found = [number for number in self.needed if self.nodes[number].name in JUMPS]
        return found if len(found) <= MOST_JUMPS else []

    @staticmethod
    def value(node: Node, operands: list[Interval], low: Array, high: Array, parameters: Any, *side: int) -> Interval:
        """The interval of one node over boxes, from those of its operands; side : of a jump, if only one counts."""
        if node.name == "x":
            return low[:, node.given[0]], high[:, node.given[0]]
        if node.name in ("p", "const"):
            # A constant is the least and the greatest of itself.
            least, most = parameters[node.given[0]] if node.name == "p" else node.given * 2
            return np.array(least), np.array(most)
        if node.name == "gridded":
            return gridded(operands, *node.given)
        return RULES[node.name][1](*operands, *node.given, *side)

    def bounds(self, low: Array, high: Array, *parameters: tuple[Any, Any]) -> tuple[Array, Array]:
        """The least and the greatest values of the results over boxes (M, coordinates): both (M, results).

        NaN where nothing is known. Where angles jump, bounds are those of all sides together if that is closer.
        parameters : for each a pair of its least and greatest value, numbers or arrays (M,).
        """
        found = self.once(low, high, parameters, {})
        every = [dict(zip(self.jumps, sides, strict=True)) for sides in product((0, 1), repeat=len(self.jumps))]
        if self.jumps:
            first = self.once(low, high, parameters, every[0])
            # where one side makes no difference there is no jump in the box
            rows = np.flatnonzero((first != found).any(axis=(0, 2)))
            own = [(a[rows], b[rows]) if np.ndim(a) else (a, b) for a, b in parameters]
            each = [first[:, rows], *(self.once(low[rows], high[rows], own, sides) for sides in every[1:])]
            found[0, rows], found[1, rows] = np.min(each, axis=0)[0], np.max(each, axis=0)[1]
        return found[0], found[1]

    def once(self, low: Array, high: Array, parameters: Sequence[Any], sides: Mapping[int, int]) -> Array:
        """Bounds (2, M, results) over boxes, so many at a time that all values of nodes fit into memory.

        sides : by the number of a node that jumps, 0 or 1: only that side of its jump counts.
        """
        out = np.empty((2, len(self.results), len(low)))
        at_once = max(min(MOST_BOXES, MOST_NUMBERS // (2 * len(self.needed))), 1)
        with np.errstate(all="ignore"):
            for begin in range(0, len(low), at_once):
                own, values = slice(begin, begin + at_once), dict[int, Interval]()
                given = [(a[own], b[own]) if np.ndim(a) else (a, b) for a, b in parameters]
                for number in self.needed:
                    node = self.nodes[number]
                    # Operands are earlier nodes, so their values are there.
                    operands, side = [values[n] for n in node.operands], [sides[number]] if number in sides else []
                    values[number] = sure(*self.value(node, operands, low[own], high[own], given, *side))
                for i, number in enumerate(self.results):
                    out[0, i, own], out[1, i, own] = values[number]
        return out.swapaxes(1, 2)


def read(what: str, given: Mapping[str, Any], coordinates: int, parameters: int, tables: Tables) -> Formula:
    """Read the formula of a function from the head's entry for it; of so many coordinates and parameters."""
    for name, count in (("coordinates", coordinates), ("parameters", parameters)):
        expect(given[name] == count, f"{what} must have {count} {name}", given[name])
    return Reader(what, coordinates, parameters, tables).read(given["lines"])
