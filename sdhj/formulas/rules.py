"""The closed set of operations of a formula, a record each.

The kernels of a tape (`sdhj.kernels.tape`) hold value and interval of each; a file's text and the checker know it by
name. NaN means undefined: it passes through every operation.
"""

from dataclasses import dataclass

from sdhj.kernels.tape import OPERATIONS


@dataclass(frozen=True)
class Rule:
    """One operation."""

    name: str  # in texts, and the field `op` of a node
    arity: int  # how many operands it has; -1 for one to six
    numpy: str  # the NumPy functions that it stands for
    says: str  # one sentence: what it computes and where it is undefined
    total: bool = True  # whether it is defined wherever its operands are
    truth: bool = False  # whether it gives a truth value


RULES = {
    rule.name: rule
    for rule in (
        Rule("x", 0, "", "A coordinate of the state."),
        Rule("p", 0, "", "A parameter: the time, or a component of the adversary."),
        Rule("const", 0, "", "A number."),
        Rule("add", 2, "add, sum", "The sum."),
        Rule("sub", 2, "subtract, diff", "The difference."),
        Rule("mul", 2, "multiply, prod, matmul, dot, cross, einsum, polyval", "The product."),
        Rule("div", 2, "divide, reciprocal, mean", "The quotient; undefined where the divisor is 0.", total=False),
        Rule("neg", 1, "negative", "The negative."),
        Rule("abs", 1, "absolute, fabs", "The absolute value."),
        Rule("sqr", 1, "square, power, var", "The square."),
        Rule("sqrt", 1, "sqrt, linalg.norm, std", "The square root; undefined below 0.", total=False),
        Rule("power", 1, "power", "A power, its exponent whole and up to 64; undefined at 0 where that is negative."),
        Rule("pow", 2, "float_power, cbrt", "A power of a base above 0, or of 0 to what is above 0.", total=False),
        Rule("exp", 1, "exp, exp2, expm1, sinh, cosh", "The exponential; unbounded where it overflows.", total=False),
        Rule("log", 1, "log, log1p, log2, log10, logaddexp", "The natural logarithm, of what is above 0.", total=False),
        Rule("sin", 1, "sin", "The sine of an angle in radians."),
        Rule("cos", 1, "cos", "The cosine of an angle in radians."),
        Rule("tan", 1, "tan", "The tangent of an angle in radians; unbounded across a pole.", total=False),
        Rule("arctan", 1, "arctan", "The angle in (-pi/2, pi/2) with this tangent."),
        Rule("arctan2", 2, "arctan2", "The angle of (x, y), y first, in [-pi, pi]; zeros have their signs."),
        Rule("tanh", 1, "tanh", "The hyperbolic tangent."),
        Rule("arcsin", 1, "arcsin", "The angle in [-pi/2, pi/2] with this sine; undefined off [-1, 1].", total=False),
        Rule("arccos", 1, "arccos", "The angle in [0, pi] with this cosine; undefined outside [-1, 1].", total=False),
        Rule("hypot", 2, "hypot", "The length of the vector (x, y)."),
        Rule("min", 2, "minimum, fmin, min, clip", "The lesser one; undefined if either is."),
        Rule("max", 2, "maximum, fmax, max, clip", "The greater one; undefined if either is."),
        Rule("floor", 1, "floor, ceil, trunc, rint, round, floor_divide", "The largest whole number not above it."),
        Rule("mod", 2, "mod, divmod", "a less whole multiples of b, signed as b; undefined for b = 0.", total=False),
        Rule("sign", 1, "sign", "-1, 0 or 1."),
        Rule("less", 2, "less, greater", "Whether a < b.", truth=True),
        Rule("lesseq", 2, "less_equal, greater_equal", "Whether a <= b.", truth=True),
        Rule("equal", 2, "equal, not_equal", "Whether a = b.", truth=True),
        Rule("and", 2, "logical_and, &, all", "Whether both are true.", truth=True),
        Rule("or", 2, "logical_or, |, any", "Whether one is true.", truth=True),
        Rule("not", 1, "logical_not, ~", "Whether it is false.", truth=True),
        Rule("share", 2, "divide", "The quotient, cut to [-1, 1]; 0 where the divisor is 0."),
        Rule("where", 3, "where, select", "The second if the first is true, else the third; the other may be NaN."),
        Rule("gridded", -1, "sdhj.gridded, interp", "Multilinear interpolation of a table, held at its ends."),
    )
}
OPCODES = {name: place for place, name in enumerate(OPERATIONS)}
