"""The closed set of operations that formulas are made of: one record each, from which all else is derived that is known
of an operation.

NaN means undefined and passes through every operation. The functions of a record make nodes by their argument `make`,
which is `sdhj.formulas.graph.make`.
"""

import math
import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sdhj.common.remembering import FloatArray
from sdhj.kernels import tape
from sdhj.kernels.bounds import PI_UP, STEP, TINY
from sdhj.kernels.elementary import INF

Make = Callable[..., Any]  # `graph.make`: make(name of an operation, *operands, value=...) -> the node, simplified


@dataclass(frozen=True)
class Rule:
    """One operation f of operands a, b and c, and all that is known of it.

    Unless kernels have a rule for its interval (`direct`), that follows from the values at the ends of the operands'
    intervals, moved outward by `error`: f rises with every operand, or, if `falls`, falls with the first; if it is
    `absolute`, with their absolute values.
    """

    name: str  # the operation's name in texts of formulas, and the field `op` of a node
    code: int  # its number in the kernels, a constant of `sdhj.kernels.tape`
    arity: int  # how many operands it has; -1: from one to six, one for each axis of a table
    numpy: str  # for people: the NumPy functions that are read as this operation, or as several of which it is one
    says: str  # one sentence: what it computes and where it is undefined
    ufuncs: str = ""  # the names of NumPy's ufuncs that are read as this operation, separated by blanks
    whole: bool = False  # whether the first of `ufuncs` may be given int64 and bool, too, as its answer is exact
    total: bool = True  # whether it is defined wherever all its operands are
    truth: bool = False  # whether it gives a truth value
    truths: int = 0  # how many of its operands must be truth values; those are the first ones
    folded: Callable[..., Any] | None = None  # computes it of Python's floats, with NumPy's bits; None: not folded
    simpler: Callable[..., Any] | None = None  # (make, *operands) -> an equal node that is simpler, or None
    # (make, the node f, its operands, their derivatives) -> the derivative of f; None: `derivative` has its own rule
    derivative: Callable[[Make, Any, Sequence[Any], Sequence[Any]], Any] | None = None
    error: float | None = 0.0  # of a computed value, in units in the last place, beside its rounding; None: exact
    falls: bool = False  # whether it falls with its first operand
    absolute: bool = False  # whether it depends on the absolute values of its operands
    direct: bool = False  # whether the kernels have a rule of their own for its interval
    vanishes: bool = False  # whether a value that is computed as 0 may be another one, by underflow
    least: float = -INF  # no value is below
    most: float = INF  # no value is above
    length: bool = False  # whether it is never negative
    shrinks: bool = False  # whether |f(a)| <= |a|
    chooses: tuple[int, ...] = ()  # positions of the operands of which one is the result
    sign: str = ""  # what stands between its operands in mathematics, as " + "
    binds: int = -1  # how tightly it binds in mathematics, 0 least; -1: it is written as name(operands)


# ---- how nodes are simplified (None: not at all): without a change of a value, or of where it is undefined
# Otherwise than before, and `alike` refuses certified arms and problems that were saved before, wherever it is met.


def is_constant(one: Any, value: float | None = None) -> bool:
    """Whether a node is a constant and, if a value is given, is that one."""
    return bool(one.op == "const" and (value is None or one.value == value))


def _add(make: Make, a: Any, b: Any) -> Any:
    """a + b: 0 + b = b, a + (-b) = a - b."""
    if is_constant(a, 0.0) or is_constant(b, 0.0):
        return b if is_constant(a, 0.0) else a
    return make("sub", a, b.args[0]) if b.op == "neg" else None


def _sub(make: Make, a: Any, b: Any) -> Any:
    """a - b: a - 0 = a, a - a = 0 where a is always defined, 0 - b = -b."""
    if is_constant(b, 0.0):
        return a
    if a is b and a.total:
        return make(value=0.0)
    return make("neg", b) if is_constant(a, 0.0) else None


def _mul(make: Make, a: Any, b: Any) -> Any:
    """a b: 0 b = 0 where b is always defined, 1 b = b, -1 b = -b, a a = a^2."""
    for one, other in ((a, b), (b, a)):
        # only where the other one cannot be undefined: 0 log(x) stays
        if is_constant(one, 0.0) and other.total:
            return make(value=0.0)
        if is_constant(one, 1.0):
            return other
        if is_constant(one, -1.0):
            return make("neg", other)
    return make("sqr", a) if a is b else None


def _where(make: Make, condition: Any, a: Any, b: Any) -> Any:
    """The branch that a constant condition chooses, or that both branches are."""
    if condition.op == "const":
        return condition if math.isnan(condition.value) else a if condition.value else b
    return a if a is b and condition.total else None


def _but_for(op: str, neutral: float) -> Callable[..., Any]:
    """The `Rule.simpler` of "min", "max", "and" and "or": op(a, a) = a = op(a, neutral)."""

    def simpler(make: Make, a: Any, b: Any) -> Any:
        if a is b or is_constant(b, neutral):
            return a
        # op(op(a, c), d) = op(a, op(c, d)) of constants, which are looked for as second operands alone
        if a.op == op and b.op == "const" and a.args[1].op == "const":
            return make(op, a.args[0], make(op, a.args[1], b))
        return b if is_constant(a, neutral) else None

    return simpler


# ---- derivatives, of a node f whose operands a have the derivatives d


def zero_where_constant(make: Make, one: Any) -> Any:
    """A node of value 0 whose interval over a box is 0 if that of `one` is a single number, and else undefined."""
    return make("div", make(value=0.0), make("sub", make("equal", one, one), make(value=0.5)))


def angle_rate(make: Make, a: Sequence[Any], d: Sequence[Any]) -> Any:
    """(x y' - y x') / (x^2 + y^2), the derivative of arctan2(y, x) off its jump; a = (y, x), d = (y', x')."""
    return make("div", make("sub", a[1] * d[0], a[0] * d[1]), make("sqr", a[1]) + make("sqr", a[0]))


def _step(make: Make, f: Any, _: Sequence[Any], __: Sequence[Any]) -> Any:
    """0, undefined in boxes where f, which is constant between jumps, may jump."""
    return zero_where_constant(make, f)


def _product(make: Make, _: Any, a: Sequence[Any], d: Sequence[Any]) -> Any:
    """(a b)' = a' b + a b'."""
    if (zero := make(value=0.0)) in d:  # 0 a would stay where a may be undefined
        return d[1] * a[0] if d[0] is zero else d[0] * a[1]
    return d[0] * a[1] + a[0] * d[1]


def _quotient(make: Make, f: Any, a: Sequence[Any], d: Sequence[Any]) -> Any:
    """(a / b)' = (a' - f b') / b."""
    return make("div", d[0] if d[1] is make(value=0.0) else make("sub", d[0], f * d[1]), a[1])


def _any_power(make: Make, f: Any, a: Sequence[Any], d: Sequence[Any]) -> Any:
    """(a^b)' = b a^(b - 1) a' + a^b log(a) b'."""
    base = a[1] * make("pow", a[0], make("sub", a[1], make(value=1.0))) * d[0]
    return base if d[1] is make(value=0.0) else base + f * make("log", a[0]) * d[1]


def _angle(make: Make, _: Any, a: Sequence[Any], d: Sequence[Any]) -> Any:
    """arctan2(y, x)' = (x y' - y x') / (x^2 + y^2), undefined on the branch cut y = 0, x <= 0."""
    cut = make("div", make(value=0.0), make("max", a[1], make("abs", a[0])))  # undefined at y = 0, x <= 0
    return angle_rate(make, a, d) + cut


def _remainder(make: Make, _: Any, a: Sequence[Any], d: Sequence[Any]) -> Any:
    """mod(a, b)' = a' - floor(a / b) b', undefined in boxes in which a / b passes a whole number."""
    laps = make("floor", make("div", *a))
    return make("sub", d[0], laps * d[1]) + zero_where_constant(make, laps)


def _chord(make: Make, one: Any) -> Any:
    """sqrt(1 - one^2)."""
    return make("sqrt", make("sub", make(value=1.0), make("sqr", one)))


# ---- the records, whose names stand in files; the checker's `intervals` has a rule of its own for each

# fmt: off
RULES = {rule.name: rule for rule in (
    Rule("x", tape.X, 0, "", "A coordinate of the state."),
    Rule("p", tape.P, 0, "", "A parameter: the time, or a component of the adversary."),
    Rule("const", tape.CONST, 0, "", "A number."),
    Rule("add", tape.ADD, 2, "add, sum", "The sum.",
         ufuncs="add", whole=True, direct=True, sign=" + ", binds=3, folded=operator.add, simpler=_add,
         derivative=lambda make, f, a, d: make("add", *d)),
    Rule("sub", tape.SUB, 2, "subtract, diff", "The difference.",
         ufuncs="subtract", whole=True, direct=True, sign=" - ", binds=3, folded=operator.sub,
         simpler=_sub, derivative=lambda make, f, a, d: make("sub", *d)),
    Rule("mul", tape.MUL, 2, "multiply, prod, matmul, dot, cross, einsum, polyval", "The product.",
         ufuncs="multiply", whole=True, direct=True, binds=4, folded=operator.mul, simpler=_mul,
         derivative=_product),
    Rule("div", tape.DIV, 2, "divide, reciprocal, mean", "The quotient; undefined where the divisor is 0.",
         total=False, direct=True, sign=" / ", binds=4, folded=operator.truediv,
         simpler=lambda make, a, b: a if is_constant(b, 1.0) else None, derivative=_quotient),
    Rule("neg", tape.NEG, 1, "negative", "The negative.",
         ufuncs="negative", whole=True, error=None, falls=True, shrinks=True, binds=4,
         folded=operator.neg, simpler=lambda make, a: a.args[0] if a.op == "neg" else None,
         derivative=lambda make, f, a, d: make("neg", *d)),
    Rule("abs", tape.ABS, 1, "absolute, fabs", "The absolute value.",
         ufuncs="absolute fabs", whole=True, error=None, absolute=True, least=0.0, length=True, shrinks=True,
         folded=abs,
         derivative=lambda make, f, a, d: make("where", make("less", a[0], make(value=0.0)), make("neg", d[0]), d[0])),
    Rule("sqr", tape.SQR, 1, "square, power, var", "The square.",
         ufuncs="square", whole=True, absolute=True, vanishes=True, least=0.0, length=True,
         binds=5, folded=lambda a: a * a, derivative=lambda make, f, a, d: make(value=2.0) * a[0] * d[0]),
    Rule("sqrt", tape.SQRT, 1, "sqrt, linalg.norm, std", "The square root; undefined below 0.",
         ufuncs="sqrt", total=False, least=0.0, length=True, folded=math.sqrt,
         derivative=lambda make, f, a, d: make("div", d[0], make(value=2.0) * f)),
    Rule("power", tape.POWER, 1, "power",
         "A power, its exponent whole and up to 64; undefined at 0 where that is negative.", vanishes=True, binds=5,
         derivative=lambda make, f, a, d: make(value=f.value) * make("power", a[0], value=f.value - 1) * d[0]),
    Rule("pow", tape.POW, 2, "float_power, cbrt", "A power of a base above 0, or of 0 to what is above 0.",
         total=False, error=4, vanishes=True, least=0.0, derivative=_any_power),
    Rule("exp", tape.EXP, 1, "exp, exp2, expm1, sinh, cosh", "The exponential; unbounded where it overflows.",
         ufuncs="exp", total=False, error=2, vanishes=True, least=0.0,
         derivative=lambda make, f, a, d: f * d[0]),
    Rule("log", tape.LOG, 1, "log, log1p, log2, log10, logaddexp", "The natural logarithm, of what is above 0.",
         ufuncs="log", total=False, error=2,  # its derivative is undefined below 0, as it is
         derivative=lambda make, f, a, d: make("pow", a[0], make(value=-1.0)) * d[0]),
    Rule("sin", tape.SIN, 1, "sin", "The sine of an angle in radians.",
         ufuncs="sin", error=3, least=-1.0, most=1.0, shrinks=True,
         derivative=lambda make, f, a, d: make("cos", a[0]) * d[0]),
    Rule("cos", tape.COS, 1, "cos", "The cosine of an angle in radians.",
         ufuncs="cos", error=3, least=-1.0, most=1.0,
         derivative=lambda make, f, a, d: make("neg", make("sin", a[0])) * d[0]),
    Rule("tan", tape.TAN, 1, "tan", "The tangent of an angle in radians; unbounded across a pole.",
         ufuncs="tan", total=False, error=6,
         derivative=lambda make, f, a, d: (make(value=1.0) + make("sqr", f)) * d[0]),
    Rule("arctan", tape.ARCTAN, 1, "arctan", "The angle in (-pi/2, pi/2) with this tangent.",
         ufuncs="arctan", error=2, least=-PI_UP / 2, most=PI_UP / 2, shrinks=True,
         derivative=lambda make, f, a, d: make("div", d[0], make(value=1.0) + make("sqr", a[0]))),
    Rule("arctan2", tape.ARCTAN2, 2, "arctan2", "The angle of (x, y), y first, in [-pi, pi]; zeros have their signs.",
         ufuncs="arctan2", error=4, vanishes=True, least=-PI_UP, most=PI_UP, derivative=_angle),
    Rule("tanh", tape.TANH, 1, "tanh", "The hyperbolic tangent.",
         ufuncs="tanh", error=4, least=-1.0, most=1.0, shrinks=True,
         derivative=lambda make, f, a, d: make("sub", make(value=1.0), make("sqr", f)) * d[0]),
    Rule("arcsin", tape.ARCSIN, 1, "arcsin", "The angle in [-pi/2, pi/2] with this sine; undefined off [-1, 1].",
         ufuncs="arcsin", total=False, error=4, least=-PI_UP / 2, most=PI_UP / 2,
         derivative=lambda make, f, a, d: make("div", d[0], _chord(make, a[0]))),
    Rule("arccos", tape.ARCCOS, 1, "arccos", "The angle in [0, pi] with this cosine; undefined outside [-1, 1].",
         ufuncs="arccos", total=False, error=4, falls=True, least=0.0, most=PI_UP,
         derivative=lambda make, f, a, d: make("neg", make("div", d[0], _chord(make, a[0])))),
    Rule("hypot", tape.HYPOT, 2, "hypot", "The length of the vector (x, y).",
         ufuncs="hypot", error=3, absolute=True, least=0.0, length=True,
         derivative=lambda make, f, a, d: make("share", a[0], f) * d[0] + make("share", a[1], f) * d[1]),
    Rule("min", tape.MIN, 2, "minimum, fmin, min, clip", "The lesser one; undefined if either is.",
         ufuncs="minimum fmin", whole=True, error=None, chooses=(0, 1), folded=min,
         simpler=_but_for("min", math.inf), derivative=lambda make, f, a, d: make("where", make("less", *a), *d)),
    Rule("max", tape.MAX, 2, "maximum, fmax, max, clip", "The greater one; undefined if either is.",
         ufuncs="maximum fmax", whole=True, error=None, chooses=(0, 1), folded=max,
         simpler=_but_for("max", -math.inf),
         derivative=lambda make, f, a, d: make("where", make("less", *a), *d[::-1])),
    Rule("floor", tape.FLOOR, 1, "floor, ceil, trunc, rint, round, floor_divide",
         "The largest whole number not above it.",
         ufuncs="floor", error=None, derivative=_step),
    Rule("mod", tape.MOD, 2, "mod, divmod", "a less whole multiples of b, signed as b; undefined for b = 0.",
         ufuncs="remainder", total=False, error=None, derivative=_remainder),
    Rule("sign", tape.SIGN, 1, "sign", "-1, 0 or 1.",
         ufuncs="sign", whole=True, error=None, derivative=_step),
    Rule("less", tape.LESS, 2, "less, greater", "Whether a < b.",
         ufuncs="less", whole=True, truth=True, error=None, falls=True, sign=" < ", binds=2,
         folded=operator.lt, derivative=_step),
    Rule("lesseq", tape.LESSEQ, 2, "less_equal, greater_equal", "Whether a <= b.",
         ufuncs="less_equal", whole=True, truth=True, error=None, falls=True, sign=" <= ", binds=2,
         folded=operator.le, derivative=_step),
    Rule("equal", tape.EQUAL, 2, "equal, not_equal", "Whether a = b.",
         ufuncs="equal", whole=True, truth=True, direct=True, sign=" = ", binds=2,
         folded=operator.eq, derivative=_step),
    Rule("and", tape.AND, 2, "logical_and, &, all", "Whether both are true.",
         ufuncs="logical_and bitwise_and multiply minimum fmin", truth=True, truths=2, error=None,
         sign=" and ", binds=1, folded=lambda a, b: bool(a) and bool(b), simpler=_but_for("and", 1.0),
         derivative=_step),
    Rule("or", tape.OR, 2, "logical_or, |, any", "Whether one is true.",
         ufuncs="logical_or bitwise_or add maximum fmax", truth=True, truths=2, error=None,
         sign=" or ", binds=0, folded=lambda a, b: bool(a) or bool(b), simpler=_but_for("or", 0.0),
         derivative=_step),
    Rule("not", tape.NOT, 1, "logical_not, ~", "Whether it is false.",
         ufuncs="logical_not invert", truth=True, truths=1, error=None, falls=True,
         folded=operator.not_, derivative=_step),
    Rule("share", tape.SHARE, 2, "divide", "The quotient, cut to [-1, 1]; 0 where the divisor is 0.",
         direct=True, sign=" / ", binds=4, derivative=_quotient),
    Rule("where", tape.WHERE, 3, "where, select",
         "The second if the first is true, else the third; the other may be NaN.",
         truths=1, direct=True, chooses=(1, 2), simpler=_where),
    Rule("gridded", tape.GRIDDED, -1, "sdhj.gridded, interp",
         "Multilinear interpolation of a table, held at its ends."),
)}
# fmt: on


def facts(rules: Sequence[Rule]) -> FloatArray:
    """What kernels must know to bound operations by intervals: (rules, `tape.COLUMNS`), row `Rule.code`."""
    out = np.zeros((len(rules), tape.COLUMNS))
    for rule in rules:
        share = 0.0 if rule.error is None else (2 * rule.error + 1) * STEP
        zero = TINY if rule.vanishes else 0.0
        # in the order in which `sdhj.kernels.tape` numbers the columns
        out[rule.code] = rule.falls, rule.absolute, rule.direct, share, zero, rule.least, rule.most
    out.setflags(write=False)
    return out


FACTS = facts(list(RULES.values()))
