"""A slow twin of formulas: a graph in plain floats, one point at a time, by the rules. Imports nothing of sdhj."""

import math
from itertools import product

NAN = math.nan


def value(node, point, parameters, known=None):
    """The number that a node is at one point; NaN where it is undefined."""
    known = {} if known is None else known
    stack = [node]
    while stack:
        one = stack[-1]
        waiting = [arg for arg in one.args if arg not in known]
        if waiting:
            stack += waiting
            continue
        known[stack.pop()] = _value(one, [known[arg] for arg in one.args], point, parameters)
    return known[node]


def values(nodes, point, parameters):
    known = {}
    return [value(node, point, parameters, known) for node in nodes]


def _value(one, args, point, parameters):
    if one.op == "x":
        return float(point[one.value[0]])
    if one.op == "p":
        return float(parameters[one.value[0]])
    if one.op == "const":
        return float(one.value)
    if one.op == "where":
        condition, a, b = args
        return NAN if math.isnan(condition) else a if condition else b
    if any(map(math.isnan, args)):
        return NAN
    try:
        if one.op == "gridded":
            return looked_up(one.value, args)
        return float(RULES[one.op](*args, *([one.value] if one.op == "power" else [])))
    except (ValueError, ZeroDivisionError):
        return NAN
    except OverflowError:
        return math.inf


def looked_up(table, places):
    """Multilinear, clipped to the grid."""
    first, share = [], []
    for k, place in enumerate(places):
        at = min(max((place - table.lower[k]) / table.spacing[k], 0.0), table.values.shape[k] - 1.0)
        first.append(min(int(at), table.values.shape[k] - 2))
        share.append(at - first[k])
    total = 0.0
    for corner in product((0, 1), repeat=len(places)):
        weight = math.prod(s if c else 1.0 - s for s, c in zip(share, corner, strict=True))
        total += weight * float(table.values[tuple(f + c for f, c in zip(first, corner, strict=True))])
    return total


def _pow(a, b):
    if a > 0 or (a == 0 and b > 0):
        return a**b
    raise ValueError


def _log(a):
    return math.inf if a == math.inf else math.log(a)


def _mod(a, b):
    if math.isinf(a):
        raise ValueError
    return a % b


def _truth(*args):
    assert all(one in (0.0, 1.0) for one in args), "`and`, `or` and `not` get truth values only"
    return [bool(one) for one in args]


RULES = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "share": lambda a, b: max(-1.0, min(1.0, a / b)) if b else 0.0,
    "neg": lambda a: -a,
    "abs": abs,
    "sqr": lambda a: a * a,
    "sqrt": math.sqrt,
    "power": lambda a, n: a**n,
    "pow": _pow,
    "exp": math.exp,
    "log": _log,
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "arctan": math.atan,
    "arctan2": lambda y, x: math.atan2(y + 0.0, x) if y or x else 0.0,
    "tanh": math.tanh,
    "arcsin": math.asin,
    "arccos": math.acos,
    "hypot": math.hypot,
    "min": min,
    "max": max,
    "floor": lambda a: a if math.isinf(a) else math.floor(a),
    "mod": _mod,
    "sign": lambda a: (a > 0) - (a < 0),
    "less": lambda a, b: a < b,
    "lesseq": lambda a, b: a <= b,
    "equal": lambda a, b: a == b,
    "and": lambda a, b: all(_truth(a, b)),
    "or": lambda a, b: any(_truth(a, b)),
    "not": lambda a: not _truth(a)[0],
}
