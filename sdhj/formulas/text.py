"""Formulas as text: the lines of a file, which a person can read, and mathematics to look at.

Each line is one node, named by its number, with the numbers of its operands, which stand above it; numbers are
hexadecimal, so nothing is rounded. The order follows from the graph alone, so equal graphs have equal texts.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from sdhj.formulas.graph import MOST_EXPONENT, Lookup, Node, constant, interned, leaf, ordered
from sdhj.formulas.rules import RULES

FORMAT = 1
MOST_LINES = 100_000
TRUTHS = {"and": 2, "or": 2, "not": 1, "where": 1}  # how many operands are truth values
CLOSE = 1e-12  # relative: constants that users compute with NumPy differ so much between processors at most


def written(outputs: Sequence[Node], tables: list[Lookup]) -> list[str]:
    """The lines of some nodes; look-ups are added to `tables` where they are not in it yet."""
    order = ordered(outputs)
    number = {one: place for place, one in enumerate(order)}
    lines = [" ".join([one.op, *_details(one, [number[arg] for arg in one.args], tables)]) for one in order]
    return [*lines, " ".join(["return", *(str(number[one]) for one in outputs)])]


def _details(one: Node, operands: list[int], tables: list[Lookup]) -> list[str]:
    words = list(map(str, operands))
    if one.op in ("x", "p"):
        return [str(one.value[0])]
    if one.op == "const":
        return [one.value.hex()]
    if one.op == "power":
        return [*words, str(one.value)]
    if one.op == "gridded":
        if one.value not in tables:
            tables.append(one.value)
        ends = (["lower", *map(float.hex, one.value.lower)], ["spacing", *map(float.hex, one.value.spacing)])
        return [str(tables.index(one.value)), *words, *ends[0], *ends[1]]
    return words


def parsed(lines: Sequence[str], tables: Sequence[Any], coordinates: int, parameters: int) -> tuple[Node, ...]:
    """The results of a text.

    Parameters
    ----------
    lines : sequence of str
    tables : sequence of Lookup, or of arrays
    coordinates, parameters : int
        How many there may be.

    Raises
    ------
    ValueError
        With the number of the line, where it is not one that `written` writes.
    """
    if not 2 <= len(lines) <= MOST_LINES:
        raise ValueError(f"a formula must have 2 to {MOST_LINES:,} lines, got {len(lines):,}")
    nodes: list[Node] = []
    limits, lookups = {"x": coordinates, "p": parameters}, dict[tuple[str, ...], Lookup]()
    for place, line in enumerate(lines):
        try:
            op, *words = line.split()
            if place == len(lines) - 1:
                if op != "return" or not words:
                    raise ValueError("the last line must be `return` and the results")
                return tuple(nodes[_index(word, place)] for word in words)
            nodes.append(_node(op, words, nodes, tables, limits, lookups))
        except (ValueError, IndexError, OverflowError, AttributeError) as error:
            raise ValueError(f"line {place} of a formula, {str(line)[:80]!r}, cannot be read: {error}") from None
    raise AssertionError


def _node(
    op: str,
    words: list[str],
    nodes: list[Node],
    tables: Sequence[Any],
    limits: Mapping[str, int],
    lookups: dict[tuple[str, ...], Lookup],
) -> Node:
    if op not in RULES:
        raise ValueError(f"{op!r} is no operation")
    if op in limits:
        (word,) = words
        return leaf(op, _index(word, limits[op]))
    if op == "const":
        (word,) = words
        return constant(float.fromhex(word))
    if op == "power":
        base, exponent = words
        if not abs(int(exponent)) <= MOST_EXPONENT:
            raise ValueError(f"exponents are whole numbers up to {MOST_EXPONENT}")
        return interned(op, (nodes[_index(base, len(nodes))],), int(exponent))
    if op == "gridded":
        return _gridded(words, nodes, tables, lookups)
    if len(words) != RULES[op].arity:
        raise ValueError(f"{op} has {RULES[op].arity} operands")
    operands = tuple(nodes[_index(word, len(nodes))] for word in words)
    if not all(one.truth for one in operands[: TRUTHS.get(op, 0)]):
        raise ValueError(f"{op} needs truth values")
    return interned(op, operands)


def _gridded(
    words: list[str], nodes: list[Node], tables: Sequence[Any], lookups: dict[tuple[str, ...], Lookup]
) -> Node:
    one, two = words.index("lower"), words.index("spacing")
    table = tables[_index(words[0], len(tables))]
    lower, spacing = (list(map(float.fromhex, part)) for part in (words[one + 1 : two], words[two + 1 :]))
    operands = tuple(nodes[_index(word, len(nodes))] for word in words[1:one])
    lookup = lookups.get(key := (words[0], *words[one:]))
    if lookup is None:
        lookup = lookups[key] = Lookup.of(table.values if isinstance(table, Lookup) else table, lower, spacing)
    if len(operands) != lookup.values.ndim:
        raise ValueError(f"a table of {lookup.values.ndim} axes needs as many operands")
    return interned("gridded", operands, lookup)


def _index(word: str, most: int) -> int:
    if not (word.isascii() and word.isdecimal() and len(word) < 10 and int(word) < most):
        raise ValueError(f"{word[:40]!r} must be a whole number below {most}")
    return int(word)


def alike(lines: Sequence[str], others: Sequence[str]) -> bool:
    """Whether two texts are of one structure, and constants agree to `CLOSE`.

    The graphs are followed together: constants that are one node in one text may be two nearly equal ones in the other.
    """
    one, other = [[line.split() for line in text] for text in (lines, others)]
    if not one or not other or len(one[-1]) != len(other[-1]):
        return False
    stack, seen = list(zip(one[-1][1:], other[-1][1:], strict=True)), set[tuple[str, str]]()
    while stack and len(seen) <= len(one) + len(other):  # one structure has no more pairs
        if (pair := stack.pop()) in seen:
            continue
        seen.add(pair)
        operands = _alike(one[int(pair[0])], other[int(pair[1])])
        if operands is None:
            return False
        stack += operands
    return not stack


def _alike(words: list[str], others: list[str]) -> list[tuple[str, str]] | None:
    """The pairs of operands of two lines; None where the lines differ in something else."""
    op = words[0]
    if op != others[0] or len(words) != len(others):
        return None
    first = 2 if op == "gridded" else 1
    last = {"x": 1, "p": 1, "const": 1, "power": 2, "gridded": words.index("lower") if op == "gridded" else 0}
    rest = slice(last.get(op, len(words)), None)
    if words[1:first] != others[1:first]:
        return None
    for a, b in zip(words[rest], others[rest], strict=True):
        if a != b and not ("0x" in a and "0x" in b and _near(float.fromhex(a), float.fromhex(b))):
            return None
    return list(zip(words[first : rest.start], others[first : rest.start], strict=True))


def _near(a: float, b: float) -> bool:
    return math.isclose(a, b, rel_tol=CLOSE, abs_tol=CLOSE)


SIGNS = {"add": " + ", "sub": " - ", "mul": " ", "div": " / ", "less": " < ", "lesseq": " <= ", "equal": " = "}
SIGNS |= {"and": " and ", "or": " or "}
BINDING = ("or", "and", "less lesseq equal", "add sub", "mul div neg", "power sqr")  # the loosest first
RANK = {op: rank for rank, ops in enumerate(BINDING) for op in ops.split()}


def shown(
    outputs: Sequence[Node], names: Sequence[str], parameters: Sequence[str] = ("t",), width: int = 400
) -> list[str]:
    """Results as mathematics; what is used more than once, and is long, gets a letter and a line of its own."""
    order = ordered(outputs)
    uses = {one: sum(arg is one for other in order for arg in other.args) for one in order} if len(order) < 500 else {}
    text: dict[Node, str] = {}
    letters, lines = iter("abcdefghijklmnopqrs"), []
    for one in order:
        text[one] = _shown(one, text, names, parameters)
        if uses.get(one, 0) > 1 and len(text[one]) > 12 and (letter := next(letters, None)):
            lines.append(f"{letter} = {text[one]}")
            text[one] = letter
        if len(text[one]) > width:
            text[one] = f"{text[one][:width]}..."
    return [*lines, *(text[one] for one in outputs)]


def _shown(one: Node, text: Mapping[Node, str], names: Sequence[str], parameters: Sequence[str]) -> str:
    def inside(arg: Node, more: int = 0) -> str:
        whole = arg.op not in RANK or " " not in text[arg]
        return text[arg] if whole or RANK[arg.op] >= RANK[one.op] + more else f"({text[arg]})"

    if one.op in ("x", "p"):
        return (names if one.op == "x" else parameters)[one.value[0]]
    if one.op == "const":
        return format(one.value, ".6g")
    if one.op in SIGNS:
        return f"{inside(one.args[0])}{SIGNS[one.op]}{inside(one.args[1], one.op in ('sub', 'div'))}"
    if one.op in ("sqr", "power"):
        return f"{inside(one.args[0], 1)}^{2 if one.op == 'sqr' else one.value}"
    if one.op == "neg":
        return f"-{inside(one.args[0])}"
    given = ", ".join(text[arg] for arg in one.args)
    return f"|{given}|" if one.op == "abs" else f"{one.op}({given})"
