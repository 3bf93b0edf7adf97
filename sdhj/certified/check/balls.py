"""Values of formulas to some 60 digits, in Arb's arithmetic of balls: a second opinion on `intervals`.

There NumPy's functions are taken to be as exact as they are where this was written. Here that is tried on the machine
at hand: a value at a state must lie within the bounds over a box around it, and within those over the state alone.
python-flint brings Arb (Johansson, IEEE Transactions on Computers 2017, doi 10.1109/TC.2017.2690633); without it
nothing is compared.
"""

from collections.abc import Callable, Sequence
from itertools import product
from typing import Any

import numpy as np

from sdhj.certified.check.bits import Array
from sdhj.certified.check.formulas import Formula, Node

try:
    import flint
except ImportError:
    flint = None  # type: ignore[assignment]

INSTALLED = flint is not None
PRECISION = 200  # bits


def whole(a: Any) -> Any:
    """floor(a), the whole number that all numbers of a ball a are rounded down to, a ball; None: there are several."""
    return a.floor() if a.floor().is_exact() else None


def compared(truth: Callable[[Any, Any], bool], opposite: Callable[[Any, Any], bool]) -> Callable[[Any, Any], Any]:
    """A comparison as a function of two balls, which returns the ball 1 or 0 where it surely holds or fails, else None.

    truth, opposite : whether the comparison, or its opposite, holds for all numbers of two balls.
    """
    return lambda a, b: flint.arb(1) if truth(a, b) else flint.arb(0) if opposite(a, b) else None


def mod(a: Any, b: Any) -> Any:
    """a - b floor(a / b) for balls a and b; None where b may be 0 or the floor is not one number."""
    lap = whole(a / b) if b != 0 else None
    return None if lap is None else a - lap * b


IN_BALLS: dict[str, Callable[..., Any]] = {  # what is None, or not finite, is undefined or not known
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "share": lambda a, b: flint.arb(0) if b == 0 else (a / b).min(1).max(-1),
    "neg": lambda a: -a,
    "abs": abs,
    "sqr": lambda a: a * a,
    "sqrt": lambda a: a.sqrt(),
    "power": lambda a, n: a**n,
    "pow": lambda a, b: flint.arb(0) if a == 0 and b > 0 else (b * a.log()).exp(),
    "exp": lambda a: a.exp(),
    "log": lambda a: a.log(),
    "sin": lambda a: a.sin(),
    "cos": lambda a: a.cos(),
    "tan": lambda a: a.tan(),
    "arctan": lambda a: a.atan(),
    "arctan2": lambda y, x: flint.arb(0) if y == 0 and x == 0 else flint.arb.atan2(y, x),
    "tanh": lambda a: a.tanh(),
    "arcsin": lambda a: a.asin(),
    "arccos": lambda a: a.acos(),
    "hypot": lambda a, b: (a * a + b * b).sqrt(),
    "min": lambda a, b: a.min(b),
    "max": lambda a, b: a.max(b),
    "floor": whole,
    "mod": mod,
    "sign": lambda a: flint.arb((a > 0) - (a < 0)) if a > 0 or a < 0 or a == 0 else None,
    "less": compared(lambda a, b: a < b, lambda a, b: a >= b),
    "lesseq": compared(lambda a, b: a <= b, lambda a, b: a > b),
    "equal": compared(lambda a, b: a == b, lambda a, b: a != b),
    "and": lambda a, b: a * b,
    "or": lambda a, b: a.max(b),
    "not": lambda a: 1 - a,
}


def interpolated(*given: Any) -> Any:
    """The ball of the multilinear interpolation of a table at a point, clipped at the ends of its axes.

    None where a coordinate's ball leaves open between which nodes it lies.

    given : the coordinates, a ball for each axis; then the table, the lists `lower` and `spacing` of its nodes, and one
        more argument that is not used: what a node `gridded` has in `given`.
    """
    *at, table, lower, spacing, _ = given
    places, shares, value = [], [], flint.arb(0)
    for x, begin, step, n in zip(at, lower, spacing, table.shape, strict=True):
        place = ((x - begin) / step).max(0).min(n - 1)
        left = whole(place)
        if left is None:
            return None
        places.append(min(int(left.unique_fmpz()), n - 2))
        shares.append(place - places[-1])
    for side in product((0, 1), repeat=table.ndim):
        weight = flint.arb(1)
        for share, up in zip(shares, side, strict=True):
            weight *= share if up else 1 - share
        value += weight * float(table[tuple(k + up for k, up in zip(places, side, strict=True))])
    return value


def of_node(node: Node, values: dict[int, Any], point: Sequence[float], parameters: Sequence[float]) -> Any:
    """The ball that holds the value of a node, from the balls of its operands; None where undefined or left open.

    None, too, where an operand that counts is None.

    values : by number the balls of all nodes that are its operands. point : the coordinates.
    parameters : the time, and after it the components of a disturbance that the formula reads.
    """
    operands = [values[number] for number in node.operands]
    if node.name in ("x", "p", "const"):
        (given,) = node.given
        return flint.arb(given if node.name == "const" else point[given] if node.name == "x" else parameters[given])
    if node.name == "where" and operands[0] is not None:
        return operands[1] if operands[0] == 1 else operands[2]
    if None in operands:
        return None
    rule = interpolated if node.name == "gridded" else IN_BALLS[node.name]
    return rule(*operands, *node.given)


def values_at(formula: Formula, point: Sequence[float], parameters: Sequence[float]) -> list[Any]:
    """A ball for the value of each result of a formula at a point; None where it is undefined, or left open by balls.

    point : the coordinates. parameters : the time, and after it the components of a disturbance that the formula reads.
    Balls have `PRECISION` bits. python-flint must be installed.
    """
    values: dict[int, Any] = {}
    with flint.ctx.workprec(PRECISION):
        for number in formula.needed:
            found = of_node(formula.nodes[number], values, point, parameters)
            values[number] = None if found is None or not found.is_finite() else found
        return [values[number] for number in formula.results]


def outside(formula: Formula, low: Array, high: Array, times: tuple[float, float], seed: int) -> tuple[int, list[Any]]:
    """Compare a formula's bounds with balls at a random state of each box: (values compared, those beyond the bounds).

    low, high : (M, coordinates), the corners of the boxes. Bounds over the box are compared, and bounds over the state
        alone, which leave room for rounding only. Values for which a ball leaves something open are not counted.
    times : the least and the greatest time, s; one is drawn between them, for all boxes. The components of a
        disturbance that a velocity reads are drawn from -1 to 1, once for all boxes, too. seed : of all that is drawn.

    What is beyond its bounds is returned as (state, ball, least, greatest). python-flint must be installed.
    """
    rng, pushes = np.random.default_rng(seed), max((n.given[0] for n in formula.nodes if n.name == "p"), default=0)
    points = rng.uniform(low, high)
    ends = [times, *[(-1.0, 1.0)] * pushes]
    given = [rng.uniform(*pair) for pair in ends]
    bounds = [formula.bounds(low, high, *ends), formula.bounds(points, points, *[(one, one) for one in given])]
    wrong, count = [], 0
    for row, point in enumerate(points.tolist()):
        for result, ball in enumerate(values_at(formula, point, given)):
            known = [(float(least[row, result]), float(most[row, result])) for least, most in bounds]
            if ball is None or not np.isfinite(known[1]).all():
                continue
            count += 1
            wrong += [(point, ball, a, b) for a, b in known if ball < a or ball > b]
    return count, wrong
