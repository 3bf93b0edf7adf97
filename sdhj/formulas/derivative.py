"""Derivatives of formulas, made so that their intervals bound Lipschitz constants.

Along a line in a box in which the derivative is defined, a function changes by at most the bound on its magnitude times
the length. At a kink (abs, min, max, the length of a vector at 0, `where` with branches that meet) both sides count.
Where a function may jump, or be infinitely steep, the interval of its derivative is undefined, however small the step:
what is no more than a difference between two sides would be taken for a slope.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np

from sdhj.formulas.graph import Node, constant, make, ordered, rebuilt
from sdhj.formulas.narrowing import ZERO, squares

ONE = constant(1.0)
EITHER = make("cos", make("arctan2", ZERO, constant(-1.0)))  # on arctan2's cut: its interval is [-1, 1]
TURN = constant(2 * math.pi)
DECISIONS = ("less", "lesseq", "equal")
STEPS = ("floor", "sign", "and", "or", "not", *DECISIONS)
Found = dict[Node, Node]  # derivatives; ZERO of what is not read


def derivative(outputs: Sequence[Node], by: Node) -> list[Node]:
    """The derivatives of some nodes by a coordinate or a parameter."""
    found: Found = {}
    for one in ordered(outputs):
        if one is by:
            found[one] = ONE
        else:
            found[one] = ZERO if all(found[arg] is ZERO for arg in one.args) else _derived(one, found)
    return [found[one] for one in outputs]


def linear(outputs: Sequence[Node], by: Sequence[Node]) -> list[list[Node]] | None:
    """For each output [rest, c_0, c_1, ...] with output = rest + sum c_d by_d; None where it is not of that kind.

    The parts do not read `by`, coordinates or parameters.
    """
    slopes = [derivative(outputs, one) for one in by]
    rest = rebuilt(outputs, lambda one: ZERO if one in by else None)
    read = set(ordered([one for each in slopes for one in each]))
    if EITHER in read or read.intersection(by):  # a slope that is not known, as of a table, or that changes
        return None
    return [list(parts) for parts in zip(rest, *slopes, strict=True)]


def _derived(one: Node, found: Found) -> Node:
    slopes = [found[arg] for arg in one.args]
    if one.op in STEPS:
        return _settled(one)
    if one.op == "where":
        return _branches(one, slopes, found)
    if one.op == "gridded":
        return _interpolated(one, slopes)
    if one.op == "sqrt" and (parts := squares(one.args[0])) is not None:
        return sum((make("share", part, one) * found[part] for part in parts), ZERO)
    if one.op in ("sin", "cos"):
        slopes = [_turning(one.args[0], found)]
    return CHAIN[one.op](one, one.args, slopes)


def _turning(one: Node, found: Found) -> Node:
    """Of an angle of which whole turns do not matter, as those by which `mod` and `arctan2` jump."""
    if found[one] is ZERO:
        return ZERO
    if one.op in ("add", "sub", "neg"):
        return make(one.op, *(_turning(arg, found) for arg in one.args))
    if one.op == "mod" and one.args[1] is TURN:
        return _turning(one.args[0], found)
    return _turned(one.args, [found[arg] for arg in one.args]) if one.op == "arctan2" else found[one]


def _settled(one: Node) -> Node:
    """0 in boxes where the interval of a node is one number, undefined in others."""
    return make("div", ZERO, make("sub", make("equal", one, one), constant(0.5)))


def _interpolated(one: Node, slopes: Sequence[Node]) -> Node:
    """Of a table: up to the largest difference between neighbours, either way, along each axis."""
    terms = list[Node]()
    for axis, slope in enumerate(slopes):
        steepest = float(abs(np.diff(one.value.values, axis=axis)).max()) / one.value.spacing[axis] * (1 + 1e-12)
        terms.append(EITHER * constant(steepest) * slope)
    return sum(terms, ZERO)


def _branches(one: Node, slopes: Sequence[Node], found: Found) -> Node:
    condition, *branches = one.args
    out = make("where", condition, *slopes[1:])
    if found[condition] is ZERO:
        return out  # which branch it is does not change along the line
    compared = _compared(condition)
    if not all(_meet(each, branches) for each in compared):
        return out + _settled(condition)
    return out + sum((ZERO * found[arg] for each in compared for arg in each.args), ZERO)  # they must not jump, too


def _compared(condition: Node) -> list[Node]:
    """The comparisons that a condition consists of; whatever else it consists of is among them."""
    if condition.op not in ("and", "or", "not"):
        return [condition]
    return [each for arg in condition.args for each in _compared(arg)]


def _meet(compared: Node, branches: Sequence[Node]) -> bool:
    """Whether two branches are the same formula where both sides of a comparison are equal."""
    if compared.op not in DECISIONS:
        return False
    for old, new in (compared.args, compared.args[::-1]):
        one, other = rebuilt(branches, lambda part, old=old, new=new: new if part is old else None)  # type: ignore[misc]
        if one is other:
            return True
    return False


def _product(_: Node, a: Sequence[Node], d: Sequence[Node]) -> Node:
    if ZERO in d:  # 0 a would stay where a may be undefined
        return d[1] * a[0] if d[0] is ZERO else d[0] * a[1]
    return d[0] * a[1] + a[0] * d[1]


def _remainder(_: Node, a: Sequence[Node], d: Sequence[Node]) -> Node:
    laps = make("floor", make("div", *a))
    return make("sub", d[0], laps * d[1]) + _settled(laps)


def _angle(_: Node, a: Sequence[Node], d: Sequence[Node]) -> Node:
    cut = make("div", ZERO, make("max", a[1], make("abs", a[0])))  # undefined at y = 0, x <= 0
    return _turned(a, d) + cut


def _turned(a: Sequence[Node], d: Sequence[Node]) -> Node:
    return make("div", make("sub", a[1] * d[0], a[0] * d[1]), make("sqr", a[1]) + make("sqr", a[0]))


def _any_power(f: Node, a: Sequence[Node], d: Sequence[Node]) -> Node:
    base = a[1] * make("pow", a[0], make("sub", a[1], ONE)) * d[0]
    return base if d[1] is ZERO else base + f * make("log", a[0]) * d[1]


# of each operation f of operands a with the derivatives d
CHAIN: dict[str, Callable[[Node, Sequence[Node], Sequence[Node]], Node]] = {
    "add": lambda _, a, d: make("add", *d),
    "sub": lambda _, a, d: make("sub", *d),
    "neg": lambda _, a, d: make("neg", *d),
    "mul": _product,
    **dict.fromkeys(
        ("div", "share"), lambda f, a, d: make("div", d[0] if d[1] is ZERO else make("sub", d[0], f * d[1]), a[1])
    ),
    "sqr": lambda _, a, d: constant(2.0) * a[0] * d[0],
    "sqrt": lambda f, a, d: make("div", d[0], constant(2.0) * f),
    "power": lambda f, a, d: constant(f.value) * make("power", a[0], value=f.value - 1) * d[0],
    "pow": _any_power,
    "exp": lambda f, a, d: f * d[0],
    "log": lambda _, a, d: make("pow", a[0], constant(-1.0)) * d[0],  # undefined below 0, as the logarithm is
    "sin": lambda _, a, d: make("cos", a[0]) * d[0],
    "cos": lambda _, a, d: make("neg", make("sin", a[0])) * d[0],
    "tan": lambda f, a, d: (ONE + make("sqr", f)) * d[0],
    "tanh": lambda f, a, d: make("sub", ONE, make("sqr", f)) * d[0],
    "arctan": lambda _, a, d: make("div", d[0], ONE + make("sqr", a[0])),
    "arctan2": _angle,
    "arcsin": lambda _, a, d: make("div", d[0], make("sqrt", make("sub", ONE, make("sqr", a[0])))),
    "arccos": lambda _, a, d: make("neg", make("div", d[0], make("sqrt", make("sub", ONE, make("sqr", a[0]))))),
    "hypot": lambda f, a, d: make("share", a[0], f) * d[0] + make("share", a[1], f) * d[1],
    "abs": lambda _, a, d: make("where", make("less", a[0], ZERO), make("neg", d[0]), d[0]),
    "min": lambda _, a, d: make("where", make("less", *a), *d),
    "max": lambda _, a, d: make("where", make("less", *a), *d[::-1]),
    "mod": _remainder,
}
