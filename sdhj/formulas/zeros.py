"""The signs of zeros: NumPy's zeros have them, and of all that a formula may do arctan2 alone depends on them: pi or
-pi, 0 or pi.

Where y or x is 0 on a line or at a point only, a formula has an answer for both signs, as they come, and its bounds
hold all of these. Where y is 0 in a whole region, as np.maximum(y, 0.0) is, the sign is that of a computed zero, which
formulas do not keep: they add no zeros, and 0 times x is 0 to them. `signs` says whether there can be such a region,
and which sign is beyond doubt there.

While a function is traced the constant `ZERO_OF_ANY_SIGN` stands in place of 0 where a zero may be -0.0;
`with_unsigned_zeros` removes it from the finished formula.
"""

import math
from collections.abc import Callable, Sequence
from itertools import product
from typing import Any

import numpy as np

from sdhj.formulas.graph import Node, constant, interned, ordered, rebuilt
from sdhj.formulas.narrowing import ZERO
from sdhj.formulas.rules import RULES
from sdhj.kernels import FloatArray

ZERO_OF_ANY_SIGN = interned("const", (), -0.0)
MOST_CHOSEN = 256  # variants of a node that are tried
POINTS = 64  # at which each is tried, half of them within 1 and half within 10
Values = Callable[[Sequence[Node]], FloatArray]  # of nodes, at some points: (nodes, points)


def is_negative_zero(value: Any) -> bool:
    """Whether a value is a Python or NumPy float that is -0.0; no other negative number counts."""
    return isinstance(value, float) and value == 0.0 and math.copysign(1.0, value) < 0


def with_unsigned_zeros(outputs: Sequence[Node]) -> list[Node]:
    """The nodes with 0 in place of `ZERO_OF_ANY_SIGN`, wherever they contain it."""
    return rebuilt(outputs, {ZERO_OF_ANY_SIGN: ZERO}.get) if ZERO_OF_ANY_SIGN in ordered(outputs) else list(outputs)


def signs(one: Node, values: Values) -> set[float]:
    """The signs that NumPy's zeros of a node may have where the node is 0 in a whole region: a subset of {1.0, -1.0}.

    It has both where the sign is in doubt. It is empty where no region of zeros is found, and for a node with more than
    `MOST_CHOSEN` variants, of which nothing is known.

    values : a function that evaluates a list of nodes at random points, (nodes, points). While each of its operations
    makes one choice a node is smooth, so it is 0 in a region only where one of its `_variants` is 0 at random points.
    """
    if one.op != "const" and not any(RULES[each.op].pieces for each in ordered([one])):
        return set()
    variants = _variants(one)
    found = values(variants) if len(variants) <= MOST_CHOSEN else np.ones((0, 1))
    zero = found == 0.0
    doubtful = any(
        row.any() and any("kept" not in RULES[each.op].zeros for each in ordered([variant]))
        for variant, row in zip(variants, zero, strict=False)
    )
    return {1.0, -1.0} if doubtful else set(np.copysign(1.0, found[zero]).tolist())


def _variants(one: Node) -> list[Node]:
    """The variants of a node: what it becomes for each combination of the choices that its operations have.

    At most `MOST_CHOSEN` + 1 nodes, the others being left out. The choices: one operand of `Rule.chooses`, 0 or 1 of a
    truth value, the rounded number or 0 of "floor", the interpolated number or 0 of a table with zeros. Nodes are
    neither simplified nor computed.
    """
    found = dict[Node, list[Node]]()
    for each in ordered([one]):
        rule = RULES[each.op]
        if rule.chooses:
            variants = [variant for place in rule.chooses for variant in found[each.args[place]]]
        elif rule.truth:
            variants = [ZERO, constant(1.0)]
        else:
            operands = product(*(found[arg] for arg in each.args))
            variants = [
                interned(each.op, args, each.value) for args, _ in zip(operands, range(MOST_CHOSEN + 1), strict=False)
            ]
            if each.op == "floor":
                variants.append(ZERO)
            if each.op == "gridded" and (zero := each.value.values == 0.0).any():
                variants.append(ZERO_OF_ANY_SIGN if np.signbit(each.value.values[zero]).any() else ZERO)
        found[each] = list(dict.fromkeys(variants))[: MOST_CHOSEN + 1]
    return found[one]
