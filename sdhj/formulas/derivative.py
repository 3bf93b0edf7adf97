"""Derivatives of formulas, made so that their intervals bound Lipschitz constants.

Along a line in a box in which the derivative is defined, a function changes by at most the bound on its magnitude times
the length. At a kink (abs, min, max, the length of a vector at 0, `where` with branches that meet) both sides count.
Where a function may jump, or be infinitely steep, the interval of its derivative is undefined, however small the step:
what is no more than a difference between two sides would be taken for a slope.
"""

import math
from collections.abc import Sequence

import numpy as np

from sdhj.formulas.graph import Node, constant, make, ordered, rebuilt
from sdhj.formulas.narrowing import ZERO, at_most, squares
from sdhj.formulas.rules import RULES, angle_rate, zero_where_constant

ONE = constant(1.0)
EITHER = make("cos", make("arctan2", ZERO, constant(-1.0)))  # on arctan2's cut: its interval is [-1, 1]
TURN = constant(2 * math.pi)
Found = dict[Node, Node]  # derivatives; ZERO of what is not read


def derivative(outputs: Sequence[Node], by: Node) -> list[Node]:
    """The derivatives of the nodes `outputs` by the leaf `by`, as nodes.

    Their intervals over a box bound every slope in it; they are undefined where an output may jump.
    """
    # asked by `lipschitz_bounds`, for intervals, and by `linear`; a value may be no derivative, see `_interpolated`
    found: Found = {}
    for one in ordered(outputs):
        if one is by:
            found[one] = ONE
        else:
            found[one] = ZERO if all(found[arg] is ZERO for arg in one.args) else _derived(one, found)
    return [found[one] for one in outputs]


def linear(outputs: Sequence[Node], by: Sequence[Node]) -> list[list[Node]] | None:
    """[rest, c_0, c_1, ...] for each output rest + sum_d c_d by[d]; None where one is not plainly linear."""
    slopes = [derivative(outputs, one) for one in by]
    rest = rebuilt(outputs, lambda one: ZERO if one in by else None)
    read = set(ordered([one for each in slopes for one in each]))
    if EITHER in read or read.intersection(by):  # a slope that is not known, as of a table, or that changes
        return None
    return [list(parts) for parts in zip(rest, *slopes, strict=True)]


def _derived(one: Node, found: Found) -> Node:
    """The derivative of a node by the chain rule, from those of all nodes below it."""
    slopes = [found[arg] for arg in one.args]
    if one.op == "where":
        return _branches(one, slopes, found)
    if one.op == "gridded":
        return _interpolated(one, slopes)
    # the length of a vector: what its parts are divided by it are shares, which have bounds also where it is 0
    if one.op == "sqrt" and (parts := squares(one.args[0])) is not None:
        return sum((make("share", part, one) * found[part] for part in parts), ZERO)
    if one.op in ("sin", "cos"):
        slopes = [_derived_angle(one.args[0], found)]
    rule = RULES[one.op].derivative
    assert rule is not None, f"{one.op} has no derivative in its record"
    slope: Node = rule(make, one, one.args, slopes)
    if one.op == "share" and not at_most(*one.args):  # where it is cut it does not change; it jumps at a divisor of 0
        cut = make("less", make("abs", one.args[1]), make("abs", one.args[0]))
        slope = make("where", cut, ZERO, slope) + ZERO * slope
    return slope


def _derived_angle(one: Node, found: Found) -> Node:
    """The derivative of an angle that only a sine or cosine reads, so that its jumps by 2 pi do not matter."""
    if found[one] is ZERO:
        return ZERO
    # not of products: a multiple of an angle may jump by other than whole turns
    if one.op in ("add", "sub", "neg"):
        return make(one.op, *(_derived_angle(arg, found) for arg in one.args))
    if one.op == "mod" and one.args[1] is TURN:
        return _derived_angle(one.args[0], found)
    if one.op == "arctan2":
        turn: Node = angle_rate(make, one.args, [found[arg] for arg in one.args])
        return turn
    return found[one]


def _interpolated(one: Node, slopes: Sequence[Node]) -> Node:
    """A node whose interval bounds the derivative of a table, by its steepest differences; its value does not."""
    terms = list[Node]()
    for axis, slope in enumerate(slopes):
        steepest = float(abs(np.diff(one.value.values, axis=axis)).max()) / one.value.spacing[axis] * (1 + 1e-12)
        # EITHER is anything in [-1, 1]
        terms.append(EITHER * constant(steepest) * slope)
    return sum(terms, ZERO)


def _branches(one: Node, slopes: Sequence[Node], found: Found) -> Node:
    """The derivative of a node `where`: that of the branch taken, undefined where it may change by a jump."""
    condition, *branches = one.args
    out = make("where", condition, *slopes[1:])
    if found[condition] is ZERO:
        return out  # which branch it is does not change along the line
    compared = _compared(condition)
    if not all(_equal_at_border(each, branches) for each in compared):
        return out + zero_where_constant(make, condition)
    return out + sum((ZERO * found[arg] for each in compared for arg in each.args), ZERO)  # they must not jump, too


def _compared(condition: Node) -> list[Node]:
    """The truth values that "and", "or" and "not" join to a condition."""
    if not RULES[condition.op].truths:
        return [condition]
    return [each for arg in condition.args for each in _compared(arg)]


def _equal_at_border(compared: Node, branches: Sequence[Node]) -> bool:
    """Whether two branches are the same node once one side of a comparison is put in place of the other."""
    if not RULES[compared.op].truth:
        return False
    # either side may stand in the branches; two forms of one number are not found to be equal, and count as a jump
    for old, new in (compared.args, compared.args[::-1]):
        one, other = rebuilt(branches, lambda one, old=old, new=new: new if one is old else None)  # type: ignore[misc]
        if one is other:
            return True
    return False
