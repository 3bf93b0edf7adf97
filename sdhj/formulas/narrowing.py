"""What a condition says of numbers, in the branches of `where`: their bounds need to hold only where they are taken.

There x is the maximum of x and 1 if the condition is x > 1: the same number, with a narrower interval. A component
divided by a length is a share, which has bounds however small the length is.
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping
from typing import Any

from sdhj.formulas.graph import Node, constant, make, ordered
from sdhj.formulas.rules import RULES, is_constant

MOST_NARROWED = 100  # operations of a branch: what both branches share is copied, and a loop may double it each time
ZERO = constant(0.0)


def where(condition: Node, one: Node, other: Node) -> Node:
    """The node "one if condition else other", with branches that may be undefined narrowed by the condition."""
    if one is not other:
        one, other = _narrowed(one, condition, True), _narrowed(other, condition, False)
    return make("where", condition, one, other)


def quotient(a: Node, b: Node) -> Node:
    """The node a / b, of "share"s where the parts of a are at most |b| and b is plainly above 0."""
    # the maximum of a constant above 0 and something, or the sum of one and what is never negative
    has_positive = any(is_constant(arg) and arg.value > 0 for arg in b.args)
    above_zero = has_positive and (b.op == "max" or (b.op == "add" and all(map(_is_length, b.args))))
    share = _shares(a, b, {}) if above_zero else None
    return make("div", a, b) if share is None else share


def squares(one: Node) -> list[Node] | None:
    """The nodes that are squared in a sum of squares and constants >= 0; None where it is no such sum."""
    left, found = [one], list[Node]()
    while left:
        one = left.pop()
        if one.op == "add":
            left += one.args[::-1]
        elif one.op == "sqr":
            found += one.args
        # What is left are constants, which are added to the squares.
        elif not _is_length(one) or one.args:
            return None
    return found


def _narrowed(branch: Node, condition: Node, holds: bool) -> Node:
    """A node equal to `branch` wherever the condition holds (or does not), with narrower intervals.

    Each inequality that is then true cuts nodes by "min" and "max", and makes "share"s by divisors off 0.
    """
    # what is defined everywhere needs no narrower operands
    if branch.total or not (order := ordered([branch], MOST_NARROWED)):
        return branch
    cuts, nonzero = defaultdict[Node, list[tuple[str, Node]]](list), set[Node]()  # what is not 0
    for a, b, strict in _ordered_pairs(condition, holds):
        for cut, op, bound in _cuts(a, b):
            cuts[cut].append((op, bound))
        nonzero |= {b} if is_constant(a) and (a.value > 0 or (strict and a is ZERO)) else set()
        nonzero |= {a} if is_constant(b) and (b.value < 0 or (strict and b is ZERO)) else set()
    new = dict[Node, Node]()
    for one in order:
        divided = one.op == "div" and _is_nonzero(one.args[1], nonzero)
        share = _shares(one.args[0], one.args[1], new) if divided else None
        args = [new[arg] for arg in one.args]
        new[one] = one if not args else share if share is not None else make(one.op, *args, value=one.value)
        for op, bound in () if one.truth or one.op == "const" else cuts.get(one, ()):
            new[one] = make(op, new[one], bound)
    return new[branch]


def _cuts(a: Node, b: Node) -> list[tuple[Node, str, Node]]:
    """(node, "min" or "max", bound) for each cut that changes no value where a <= b."""
    if is_constant(b):
        inner = [(a.args[0], "min", b), (a.args[0], "max", make("neg", b))] if a.op == "abs" else []
        return [(a, "min", b), *inner]
    if is_constant(a):
        return [] if _is_length(b) and a.value <= 0 else [(b, "max", a)]
    # both differences, as a branch may have either
    return [(make("sub", b, a), "max", ZERO), (make("sub", a, b), "min", ZERO)]


def _ordered_pairs(condition: Node, holds: bool) -> Iterator[tuple[Node, Node, bool]]:
    """Yield (a, b, strict) for each a < b or a <= b that is sure where the condition holds, or does not."""
    left, seen = [(condition, holds)], set[tuple[Node, bool]]()
    while left:
        one, holds = said = left.pop()
        if said in seen:
            continue
        seen.add(said)
        if one.op == "not" or one.op == ("and" if holds else "or"):
            left += [(arg, holds != (one.op == "not")) for arg in one.args]
        elif one.op in ("less", "lesseq"):
            a, b = one.args if holds else one.args[::-1]
            yield a, b, (one.op == "less") == holds
        # z != 0 is 0 < |z|
        elif one.op == "equal" and not holds and ZERO in one.args:
            yield ZERO, make("abs", one.args[one.args[0] is ZERO]), True


def _is_length(one: Node) -> bool:
    """Whether a node is never negative by its operation, as an absolute value or a root."""
    return RULES[one.op].length or (one.op == "const" and one.value >= 0)


def _is_nonzero(one: Node, nonzero: set[Node]) -> bool:
    """Whether a divisor is surely not 0, from nodes that are not."""
    inner = one.op in ("abs", "neg", "sqrt") and _is_nonzero(one.args[0], nonzero)
    return inner or one in nonzero or make("abs", one) in nonzero


def _shares(a: Node, b: Node, new: Mapping[Node, Node]) -> Node | None:
    """The quotient a / b, b not 0, made of "share"s where each part of a is plainly at most |b|, else None.

    `new` has the nodes to be put in place of those below.
    """
    found = dict[Node, Any]()
    for one in ordered([a], MOST_NARROWED):
        parts: list[Any] = [found.get(arg) for arg in one.args]
        rest = [new.get(arg, arg) for arg in one.args]
        if at_most(one, b):
            found[one] = make("share", new.get(one, one), new.get(b, b))
        # A sum may be more than |b| where each part is not: parts are divided one by one.
        elif one.op in ("add", "sub") and None not in parts:
            found[one] = make(one.op, *parts)
        elif one.op in ("mul", "div") and parts[0] is not None:
            found[one] = make(one.op, parts[0], rest[1])
        elif one.op == "mul" and parts[1] is not None:
            found[one] = make("mul", rest[0], parts[1])
    return found.get(a)


def at_most(a: Node, b: Node) -> bool:
    """Whether |a| <= |b| is plain from the form of the two nodes, wherever both are defined."""
    sizes, left, seen = {a}, [b], set[Node]()  # nodes whose size is at least that of a; at most that of b
    # As long as an operation is never larger than its operand.
    while RULES[a.op].shrinks:
        a = a.args[0]
        sizes.add(a)
    while left:
        one = left.pop()
        if one in sizes:
            return True
        if one in seen:
            continue
        seen.add(one)
        if one.op in ("hypot", "abs", "neg"):
            left += one.args
        elif one.op == "sqrt":
            left += squares(one.args[0]) or []
        elif one.op == "max" or (one.op == "add" and all(map(_is_length, one.args))):
            left += filter(_is_length, one.args)
    return False
