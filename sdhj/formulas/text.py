"""Formulas as text: the lines of a file, which a person can read, and mathematics to look at.

Each line is one node, named by its number, with the numbers of its operands, which stand above it; numbers are
hexadecimal, so nothing is rounded. The order follows from the graph alone, so equal graphs have equal texts.
"""

import itertools
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from sdhj.formulas.graph import MOST_EXPONENT, Lookup, Node, constant, interned, leaf, ordered
from sdhj.formulas.rules import RULES

FORMAT = 1
MOST_LINES = 100_000
LONG = 120  # characters of mathematics, from which on a part of it gets a line of its own
CLOSE = 1e-12  # relative: constants that users compute with NumPy differ so much between processors at most


def written(outputs: Sequence[Node], tables: list[Lookup]) -> list[str]:
    """The lines of a formula's results: one for each node, then "return" and the numbers of the results.

    Tables that are looked up are appended to `tables`; lines refer to them by position.
    """
    # `Reader` of the checker's `formulas` reads these lines, too, and digests are of them: other lines, another FORMAT
    order, lines = ordered(outputs), list[str]()
    number = {one: str(i) for i, one in enumerate(order)}
    for one in order:
        words = [number[arg] for arg in one.args]
        if one.op in ("x", "p"):
            words = [str(one.value[0])]
        elif one.op == "const":
            words = [one.value.hex()]
        elif one.op == "power":
            words += [str(one.value)]
        elif one.op == "gridded":
            digests = [table.digest for table in tables]  # of values: where their nodes are stands in the line
            if one.value.digest not in digests:
                tables.append(one.value)
            ends = ["lower", *map(float.hex, one.value.lower), "spacing", *map(float.hex, one.value.spacing)]
            words = [str([*digests, one.value.digest].index(one.value.digest)), *words, *ends]
        lines.append(" ".join([one.op, *words]))
    return [*lines, " ".join(["return", *(number[one] for one in outputs)])]


def parsed(lines: Sequence[str], tables: Sequence[Any], coordinates: int, parameters: int) -> tuple[Node, ...]:
    """The results as nodes, not simplified, from lines that `written` made."""
    # simplified, they would be written as other lines, of another digest
    if not 2 <= len(lines) <= MOST_LINES:
        raise ValueError(f"a formula must have 2 to {MOST_LINES:,} lines, got {len(lines):,}")
    nodes: list[Node] = []
    limits = {"x": coordinates, "p": parameters}

    @cache  # where many nodes look up one table, it is copied and its digest computed once
    def table(number: int) -> Lookup:
        found = tables[number]
        return found if isinstance(found, Lookup) else Lookup.of(found, [0.0] * found.ndim, [1.0] * found.ndim)

    def looked_up(number: str, *ends: str) -> Lookup:
        cut = ends.index("spacing")
        lower, spacing = (list(map(float.fromhex, part)) for part in (ends[1:cut], ends[cut + 1 :]))
        return Lookup.of(table(_index(number, len(tables))), lower, spacing)

    for i, line in enumerate(lines):
        try:
            op, *words = line.split()
            if i == len(lines) - 1:
                if op != "return" or not words:
                    raise ValueError("the last line must be `return` and the results")
                return tuple(nodes[_index(word, i)] for word in words)
            nodes.append(_node(op, words, nodes, looked_up, limits))
        except (ValueError, IndexError, OverflowError, AttributeError) as error:
            raise ValueError(f"line {i} of a formula, {str(line)[:80]!r}, cannot be read: {error}") from None
    raise AssertionError


def _node(op: str, words: list[str], nodes: list[Node], looked_up: Any, limits: Mapping[str, int]) -> Node:
    """The node of one line of text, from those of the lines above."""
    value: Any = None
    if op not in RULES:
        raise ValueError(f"{op!r} is no operation")
    arity = RULES[op].arity + (op in ("x", "p", "const", "power"))  # with a number, or an exponent
    if op == "gridded":
        cut = words.index("lower")
        words, value = words[1:cut], looked_up(words[0], *words[cut:])
        arity = value.values.ndim
    if len(words) != arity:
        raise ValueError(f"{op} has {arity} operands")
    if op in limits:
        return leaf(op, _index(words[0], limits[op]))
    if op == "const":
        return constant(float.fromhex(words[0]))
    if op == "power" and not abs(value := int(words.pop())) <= MOST_EXPONENT:
        raise ValueError(f"exponents are whole numbers up to {MOST_EXPONENT}")
    operands = tuple(nodes[_index(word, len(nodes))] for word in words)
    # kernels compute "and" as a product and "or" as a maximum, which is right of 0 and 1 alone
    if not all(one.truth for one in operands[: RULES[op].truths]):
        raise ValueError(f"{op} needs truth values")
    return interned(op, operands, value)


def _index(word: str, most: int) -> int:
    """The whole number below `most` that a word spells in decimal digits."""
    if not (word.isascii() and word.isdecimal() and len(word) < 10 and int(word) < most):
        raise ValueError(f"{word[:40]!r} must be a whole number below {most}")
    return int(word)


def alike(outputs: Sequence[Node], others: Sequence[Node]) -> bool:
    """Whether two lists of nodes have graphs of one structure, whose constants and tables agree to `CLOSE`."""
    # from the results downward: what is one node here may be two there, whose constants are nearly equal
    pairs, seen = list(zip(outputs, others, strict=False)), set[tuple[Node, Node]]()
    most = len(ordered(outputs)) + len(ordered(others))  # one structure has no more pairs
    while pairs and len(seen) <= most:
        one, other = pair = pairs.pop()
        if one is other or pair in seen:
            continue
        seen.add(pair)
        if one.op != other.op or len(one.args) != len(other.args) or not _near(one.value, other.value):
            return False
        pairs += zip(one.args, other.args, strict=True)
    return not pairs and len(outputs) == len(others)


def _near(one: Any, other: Any) -> bool:
    """Whether the `value`s of two nodes agree: numbers and tables to `CLOSE`, anything else exactly."""
    if isinstance(one, Lookup) and isinstance(other, Lookup) and one.values.shape == other.values.shape:
        each = ((one.values, other.values), (one.lower, other.lower), (one.spacing, other.spacing))
        return all(np.allclose(a, b, rtol=CLOSE, atol=CLOSE * float(np.abs(b).max())) for a, b in each)
    return one == other or (isinstance(one, float) and math.isclose(one, other, rel_tol=CLOSE))


def shown(outputs: Sequence[Node], names: Sequence[str], parameters: Sequence[str] = ("t",)) -> list[str]:
    """Results as mathematics to read: lines "name = ...", last one line for each result, without a name.

    `names` and `parameters` say what coordinates and parameters are called.
    """
    order = ordered(outputs)
    uses = Counter(arg for one in order for arg in one.args)
    text: dict[Node, str] = {}
    # up to s, as t and v have a meaning
    letters, numbers = iter("abcdefghijklmnopqrs"), itertools.count(1)
    lines, named = list[str](), set[str]()

    def inside(arg: Node, rank: int) -> str:
        # A negative number binds as a minus before it does.
        op = "neg" if arg.op == "const" and arg.value < 0 else arg.op
        binds = -1 if text[arg] in named else RULES[op].binds
        return text[arg] if binds < 0 or binds >= rank else f"({text[arg]})"

    for one in order:
        rule, rank, given = RULES[one.op], max(RULES[one.op].binds, 0), [text[arg] for arg in one.args]
        if one.op in ("x", "p"):
            text[one] = (names if one.op == "x" else parameters)[one.value[0]]
        elif one.op == "const":
            text[one] = format(one.value, ".6g")
        elif one.op == "mul":  # numbers first; to people a / b c is a / (b c), and a -b a difference
            a, b = one.args if one.args[1].op != "const" else one.args[::-1]
            second = inside(b, rank + text[b].startswith("-"))
            text[one] = f"{inside(a, rank + (' / ' in text[a]))} {second}"
        elif rule.sign:
            second, sign = inside(one.args[1], rank + (one.op in ("sub", "div", "share"))), rule.sign
            if one.op in ("add", "sub") and second.startswith("-"):
                second, sign = second[1:], RULES["sub" if one.op == "add" else "add"].sign
            text[one] = f"{inside(one.args[0], rank)}{sign}{second}"
        elif one.op in ("sqr", "power"):
            text[one] = f"{inside(one.args[0], rank + 1)}^{2 if one.op == 'sqr' else one.value}"
        elif one.op == "neg":
            text[one] = f"-{inside(one.args[0], rank)}"
        else:
            bars = one.op == "abs" and "|" not in given[0]
            text[one] = f"|{given[0]}|" if bars else f"{one.op}({', '.join(given)})"
        # what is used more than once gets a letter, while there are letters, and what is long a number
        name = next(letters, None) if uses[one] > 1 and len(text[one]) > 12 else None
        if name is None and len(text[one]) > LONG and uses[one]:
            name = f"[{next(numbers)}]"
        if name is not None:
            lines.append(f"{name} = {text[one]}")
            named.add(name)
            text[one] = name
    return [*lines, *(text[one] for one in outputs)]
