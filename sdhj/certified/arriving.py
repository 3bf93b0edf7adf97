"""Whether a state has arrived, as C for a robot: the formulas of its target and of its unsafe sets, written out.

Words say what is proved of a whole cell; that a state is in the target itself only the target can say.
"""

from collections.abc import Iterator, Sequence
from math import isfinite, isnan
from typing import Any

from sdhj.formulas.formula import Formula
from sdhj.formulas.graph import Node, ordered
from sdhj.problem.problem import ReachAvoidProblem

MOST_NODES = 5000  # of all formulas: so many are written out
EXACT = "(({0} != {0}) | ({1} != {1}) ? (double)NAN : {0} {2} {1} ? 1.0 : 0.0)"  # of a comparison
WRITTEN = {  # of an operation as C, with its operands; what is undefined is no number
    "add": "{0} + {1}",
    "sub": "{0} - {1}",
    "mul": "{0} * {1}",
    "div": "{1} != 0.0 ? {0} / {1} : (double)NAN",
    "neg": "-{0}",
    "abs": "fabs({0})",
    "sqr": "{0} * {0}",
    "sqrt": "sqrt({0})",
    "pow": "{0} > 0.0 || ({0} <= 0.0 && {0} >= 0.0 && {1} > 0.0) ? pow({0}, {1}) : (double)NAN",
    "exp": "exp({0})",
    "log": "{0} > 0.0 ? log({0}) : (double)NAN",
    "sin": "sin({0})",
    "cos": "cos({0})",
    "tan": "tan({0})",
    "arctan": "atan({0})",
    "arctan2": "atan2({0}, {1})",
    "tanh": "tanh({0})",
    "arcsin": "asin({0})",
    "arccos": "acos({0})",
    "hypot": "hypot({0}, {1})",
    "min": "{0} < {1} || {0} != {0} ? {0} : {1}",
    "max": "{0} > {1} || {0} != {0} ? {0} : {1}",
    "floor": "floor({0})",
    "mod": "{1} != 0.0 ? {0} - floor({0} / {1}) * {1} : (double)NAN",
    "sign": "{0} > 0.0 ? 1.0 : {0} < 0.0 ? -1.0 : fabs(0.0 * {0})",
    "less": EXACT.replace("{2}", "<"),
    "lesseq": EXACT.replace("{2}", "<="),
    "equal": "({0} != {0}) | ({1} != {1}) ? (double)NAN : {0} <= {1} && {0} >= {1} ? 1.0 : 0.0",
    "and": "{0} * {1}",
    "or": "{0} > {1} || {0} != {0} ? {0} : {1}",
    "not": "1.0 - {0}",
    "share": "{1} != 0.0 ? fmin(1.0, fmax(-1.0, {0} / {1})) : 0.0 * {0}",
    "where": "{0} != {0} ? (double)NAN : {0} != 0.0 ? {1} : {2}",
}


def arrived_in_c(problem: ReachAvoidProblem) -> list[str]:
    """Lines of C that define `sdhj_robot_arrived`, as `ReachAvoidProblem.arrived` says it of a state; or none."""
    sets: list[tuple[Any, str]] = [
        (problem.target, "<="),
        *((one, ">") for one in problem.unsafe if one.inputs is None),
    ]
    formulas = [one.level_set for one, _ in sets]
    # nobody arrives so, or black boxes cannot be written out
    if problem.has_no_target or problem.sensing or not all(isinstance(one, Formula) for one in formulas):
        return []
    nodes = [node for one in formulas for node in ordered(one.outputs)]
    if len(nodes) > MOST_NODES or any(one.op not in {*WRITTEN, "x", "p", "const", "power"} for one in nodes):
        return []
    grid, body = problem.grid, list[str]()
    ends = zip(grid.lower, grid.upper, grid.periodic, strict=True)
    for axis, (low, high, periodic) in enumerate(ends):
        body.append(f"  double q{axis} = state[{axis}];")
        if periodic:
            # as `into_period` wraps it in Python, up to rounding
            length, at = high - low, f"q{axis}"
            body.append(f"  {at} -= {low!r}; {at} -= floor({at} / {length!r}) * {length!r}; {at} += {low!r};")
            body.append(f"  if ({at} >= {high!r}) {at} = {low!r};")
    for number, (part, sign) in enumerate(sets):
        *lines, last = _lines(part.level_set, part.axes, f"s{number}n")
        body += [f"  const double {line};" for line in lines]
        # where the function is no number nobody has arrived, as in Python
        body.append(f"  if (!({last} {sign} 0.0)) return 0;")
    unused = [f"  (void)q{axis};" for axis in range(grid.ndim)]
    return [
        "/* Whether a state on the grid is in the target and in no unsafe set, whatever its cell: for table.arrived */",
        "static inline int sdhj_robot_arrived(uint32_t step, const double *state) {",
        # the time of the step, as there is no delay: with `Sensing` nothing is written
        f"  const double t = (double)step * {problem.delta!r};",
        *body,
        "  (void)t;",
        *unused,
        "  return 1;",
        "}",
    ]


def _lines(formula: Formula, axes: Sequence[int], name: str) -> Iterator[str]:
    """Yield "name = expression" for each operation of a formula of these axes, and last the name of its value."""
    # By node, as several operations may read one: it is computed once in C.
    names = dict[Node, str]()
    for one in ordered(formula.outputs):
        given = [names[arg] for arg in one.args]
        if one.op == "const":
            names[one] = _number(one.value)
        elif one.op in ("x", "p"):
            names[one] = f"q{axes[one.value[0]]}" if one.op == "x" else "t"
        else:
            found = f"pow({given[0]}, {one.value!r}.0)" if one.op == "power" else WRITTEN[one.op].format(*given)
            names[one] = f"{name}{len(names)}"
            yield f"{names[one]} = {found}"
    yield names[formula.outputs[0]]


def _number(value: float) -> str:
    """A number as C has it, in parentheses where it is negative."""
    # `repr` has as many digits as it takes to read the same number again.
    said = (
        "(double)NAN"
        if isnan(value)
        else repr(value)
        if isfinite(value)
        else "(double)INFINITY"
        if value > 0
        else "-(double)INFINITY"
    )
    # In parentheses, as `--1.0` would be another operator in C.
    return f"({said})" if said.startswith("-") else said
