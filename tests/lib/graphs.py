"""Graphs of formulas: random ones, and what NumPy makes of a graph, by the names of its functions."""

import naive_formulas as naive
import numpy as np

from sdhj.formulas.graph import constant, interned, leaf, make, ordered, power
from sdhj.formulas.rules import RULES

OPERATIONS = [name for name in RULES if name not in ("x", "p", "const", "gridded")]
X, TIME = [leaf("x", k) for k in range(3)], leaf("p", 0)
NUMBERS = (0.0, 1.0, -1.0, 0.5, np.pi, -0.3, 100.0, -2.0, 1e200, np.inf, np.nan)
UNDEFINED = {  # where NumPy has a number, or an infinite one
    "div": lambda a, b: b == 0.0,
    "log": lambda a: a <= 0.0,
    "power": lambda a, n: (a == 0.0) & (n < 0.0),
    "pow": lambda a, b: (a < 0.0) | (a == 0.0) & (b <= 0.0),
}


@np.errstate(all="ignore")
def numpys(op, *columns):
    """NumPy's result of an operation on columns (M,), by the function's name; NaN where it is undefined."""
    a, b = columns[0], columns[-1]
    if op == "where":
        return np.where(np.isnan(a), a, np.where(a != 0.0, *columns[1:]))
    if op == "share":
        found = np.where(b != 0.0, np.clip(a / b, -1.0, 1.0), 0.0)
    else:
        found = getattr(np, RULES[op].numpy.split(", ")[0])(*columns)
    undefined = UNDEFINED.get(op, lambda *_: False)(*columns)
    return np.where(np.isnan(columns).any(axis=0) | undefined, np.nan, found)


def values(nodes, points, parameters=()):
    """NumPy's values of nodes at points (M, n): (nodes, M)."""
    points, known = np.asarray(points, float), {}
    for one in ordered(nodes):
        columns = [known[arg] for arg in one.args]
        if one.op == "x":
            known[one] = points[:, one.value[0]]
        elif one.op in ("p", "const"):
            known[one] = np.full(len(points), parameters[one.value[0]] if one.op == "p" else one.value)
        elif one.op == "gridded":
            places = (np.array(columns).T - one.value.lower) / one.value.spacing
            known[one] = np.array(
                [np.nan if np.isnan(at).any() else naive.interpolated(one.value.values, at) for at in places]
            )
        else:
            exponent = [np.full(len(points), float(one.value))] if one.op == "power" else []
            known[one] = numpys(one.op, *columns, *exponent)
    return np.array([known[one] for one in nodes])


def random_pairs(rng, count=10, operations=OPERATIONS, leaves=(*X, TIME)):
    """The same random expressions, simplified as they are made and not; they prefer recent operands."""
    pairs = [(one, one) for one in (*leaves, *map(constant, rng.choice(NUMBERS, 3, replace=False)))]
    for _ in range(count):
        op = pairs[-1][1].op  # some again and again
        rule = RULES[op if op in operations and rng.random() < 0.2 else str(rng.choice(operations))]
        truths = [pair for pair in pairs if pair[0].truth and pair[1].truth]
        if rule.truths and not truths:
            continue
        kinds = [truths if k < rule.truths else pairs for k in range(rule.arity)]
        chosen = [kind[-1 - min(int(rng.exponential(6)), len(kind) - 1)] for kind in kinds]
        a, b = ([pair[side] for pair in chosen] for side in (0, 1))
        if rule.name == "power":
            n = int(rng.integers(-5, 7))
            pairs.append((power(a[0], constant(n)), interned("power", tuple(b), n)))
        else:
            pairs.append((make(rule.name, *a), interned(rule.name, tuple(b))))
    return pairs


def random_boxes(rng, count, coordinates):
    """(low, high): small and large, of width 0 in some axes, with zeros and ones among their ends."""
    shape = (count, coordinates)
    centre = rng.normal(size=shape) * 10.0 ** rng.integers(-3, 3, (count, 1))
    centre[rng.random(shape) < 0.2], centre[rng.random(shape) < 0.1] = 0.0, 1.0
    width = np.abs(rng.normal(size=shape)) * 10.0 ** rng.integers(-4, 1, (count, 1)) * (rng.random(shape) < 0.7)
    return centre - width * (rng.random(shape) < 0.7), centre + width


def random_points(rng, low, high):
    """A point in each box, its coordinates often at ends."""
    share = np.clip(rng.uniform(-0.5, 1.5, low.shape), 0.0, 1.0)
    return np.clip(low + share * (high - low), low, high)
