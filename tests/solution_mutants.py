"""Mutants of the solutions of the exercises: a clause dropped, a comparison flipped, a number or a result scaled.

A mutant is a solution with one such change, made by a script and not by hand. `mutants(chapter)` lists those of a
chapter; `played` hands one to its check. What no check can refuse, because it is the same answer, stands in
`EQUIVALENT` with the reason, and `alike` compares it to the solution on inputs that the check does not have.

    python tests/solution_mutants.py [CHAPTER ...]     how many there are of each exercise, and what was not refused
"""

import ast
import copy
import importlib
import re
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from functools import partial, update_wrapper
from itertools import pairwise
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np

import sdhj

NOTEBOOKS = Path(__file__).resolve().parent.parent / "notebooks"
SCALES = (2, 3, 11, 13)
SIZE = (
    20  # whole numbers from here on are sizes, of grids for example, and are only doubled: what is slow stays possible
)
SOLVING = ("4.5", "8.5", "9.4", "12.5", "15.2", "15.5", "16.4", "16.5")  # answers that take a while: likewise
PATIENCE = 60.0  # s for a check; a mutant may well have no end
YES_OR_NO = ("1.5", "3.3", "5.1", "7.2", "7.3", "7.4", "7.5", "13.2")  # their result is turned round, not scaled
NO_NUMBER = ("9.4", "15.2")  # they return problems
COPIED = {"04": ("_slopes", "_rate", "_solve")}  # from the chapter's own cells: nobody is asked to write them
FLIPPED = {ast.Lt: ast.Gt, ast.Gt: ast.Lt, ast.LtE: ast.GtE, ast.GtE: ast.LtE, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq}
EXTREMES = {"maximum", "minimum", "max", "min"}  # the clauses of a set, told by its level-set function


class Endless(BaseException):
    """A mutant that has not come to an end in time."""


@dataclass(frozen=True)
class Mutant:
    """A changed answer to an exercise; `what` says how it was changed, `make` makes it."""

    chapter: str
    check: Any
    what: str
    make: Callable[[], Any]

    @property
    def number(self) -> str:
        return str(self.check.number)


# ---- changes of code


def dropped(node: ast.AST) -> Iterator[ast.AST]:
    """The node without one of its clauses."""
    if isinstance(node, ast.BoolOp):
        for place in range(len(node.values)):
            rest = node.values[:place] + node.values[place + 1 :]
            yield rest[0] if len(rest) == 1 else ast.BoolOp(node.op, rest)
    elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitAnd | ast.BitOr | ast.Add):
        yield from (node.left, node.right)
    elif isinstance(node, ast.IfExp):
        yield from (node.body, node.orelse)
    elif isinstance(node, ast.comprehension):
        for place in range(len(node.ifs)):
            yield ast.comprehension(node.target, node.iter, node.ifs[:place] + node.ifs[place + 1 :], node.is_async)
    elif isinstance(node, ast.Call) and not node.keywords and len(node.args) > 1:
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        if name in EXTREMES:
            for place in range(len(node.args)):
                rest = node.args[:place] + node.args[place + 1 :]
                yield rest[0] if len(rest) == 1 else ast.Call(node.func, rest, [])


def flipped(node: ast.AST) -> Iterator[ast.AST]:
    """A comparison the other way round."""
    if isinstance(node, ast.Compare):
        for place, sign in enumerate(node.ops):
            if type(sign) in FLIPPED:
                signs = [*node.ops[:place], FLIPPED[type(sign)](), *node.ops[place + 1 :]]
                yield ast.Compare(node.left, signs, node.comparators)


def scaled_constant(node: ast.AST, scales: tuple[int, ...]) -> Iterator[ast.AST]:
    """A number times each of the scales."""
    if isinstance(node, ast.Constant) and type(node.value) in (int, float) and node.value:
        size = isinstance(node.value, int) and node.value >= SIZE
        yield from (ast.Constant(node.value * scale) for scale in (scales[:1] if size else scales))


def places(tree: ast.AST) -> Iterator[tuple[ast.AST, str, int | None]]:
    """Every node below `tree` that may be changed, by its parent: field, and place in it where it is a list.

    Left alone is what says where something lies in an array and not how large it is: indices, axes and shapes.
    """
    for name, value in ast.iter_fields(tree):
        if (isinstance(tree, ast.Subscript) and name == "slice") or name in ("decorator_list", "annotation", "returns"):
            continue
        if isinstance(tree, ast.keyword) and tree.arg in ("axis", "dtype", "repeat"):
            continue
        for place, child in enumerate(value) if isinstance(value, list) else [(None, value)]:
            if isinstance(child, ast.AST):
                yield tree, name, place
                yield from places(child)


def changes(tree: ast.stmt, scales: tuple[int, ...] = SCALES) -> Iterator[tuple[str, ast.stmt]]:
    """Copies of a statement, each with one change, and what it is."""
    for at, (parent, name, place) in enumerate(list(places(tree))):
        node = getattr(parent, name) if place is None else getattr(parent, name)[place]
        if isinstance(node, ast.Constant) and isinstance(parent, ast.Expr):
            continue
        for new in [*dropped(node), *flipped(node), *scaled_constant(node, scales)]:
            other = copy.deepcopy(tree)
            up, field, where = list(places(other))[at]
            if where is None:
                setattr(up, field, new)
            else:
                getattr(up, field)[where] = new
            yield f"{told(new)} for {told(node)}", ast.fix_missing_locations(other)


def told(node: ast.AST) -> str:
    return f"`{ast.unparse(node)}`" if not isinstance(node, ast.comprehension) else f"`{ast.unparse(node).strip()}`"


# ---- changes of results


def scaled(value: Any, up: int, down: int) -> Any:
    """A number, an array of them or a tuple of these times `up` by `down`; what is no number stays as it is."""
    if isinstance(value, tuple | list | set):
        return type(value)(scaled(part, up, down) for part in value)
    if isinstance(value, Fraction):
        return value * up / down
    number = isinstance(value, int | float | np.number) or (isinstance(value, np.ndarray) and value.dtype != bool)
    if not number or isinstance(value, bool | np.bool_):
        return value
    return value * up if down == 1 else value / down


def with_scaled_result(answer: Any, up: int, down: int) -> Any:
    """An answer, or the result of every call of one, times `up` by `down`."""
    if isinstance(answer, tuple):
        return tuple(with_scaled_result(part, up, down) for part in answer)
    if not callable(answer):
        return scaled(answer, up, down)
    return update_wrapper(lambda *given, **named: scaled(answer(*given, **named), up, down), answer)


def turned_round(answer: Any) -> Any:
    """The opposite of every truth value."""

    def opposite(*given: Any) -> Any:
        value = np.asarray(answer(*given))
        assert value.dtype == bool
        return ~value

    return update_wrapper(opposite, answer)


# ---- mutants of a chapter


def names_in(tree: ast.AST) -> set[str]:
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}


class Solutions:
    """The solutions of a chapter: what stands at the top of the file, and what each answer is made of."""

    def __init__(self, chapter: str) -> None:
        self.chapter = chapter
        self.path = NOTEBOOKS / "solutions" / f"solution_{chapter}.py"
        self.module: ModuleType = importlib.import_module(f"solutions.solution_{chapter}")
        body = ast.parse(self.path.read_text(encoding="utf-8")).body
        self.imports = [part for part in body if isinstance(part, ast.Import | ast.ImportFrom)]
        self.parts: dict[str, ast.stmt] = {}
        for part in body:
            if isinstance(part, ast.FunctionDef):
                self.parts[part.name] = part
            elif isinstance(part, ast.Assign):
                self.parts |= {name: part for target in part.targets for name in names_in(target)}
        self.answers = dict(zip(*self._right(), strict=True))

    def _right(self) -> tuple[list[str], list[ast.expr]]:
        table = self.parts["RIGHT"].value  # type: ignore[attr-defined]
        return [key.id for key in table.keys], table.values

    def needed(self, tree: ast.AST) -> list[ast.stmt]:
        """The parts at the top of the file that an expression leans on, in their order."""
        names, more = set[str](), names_in(tree) & self.parts.keys()
        while more:
            names |= more
            more = set().union(*(names_in(self.parts[name]) for name in more)) & self.parts.keys() - names
        found = {id(self.parts[name]): self.parts[name] for name in names}
        return sorted(found.values(), key=lambda part: part.lineno)

    def made(self, answer: ast.expr, parts: list[ast.stmt]) -> Any:
        """The answer that an expression gives, with these parts before it."""
        last = ast.Assign([ast.Name("ANSWER", ast.Store())], answer)
        tree = ast.Module([*self.imports, *parts, last], [])
        space: dict[str, Any] = {"__name__": f"mutant_{self.chapter}"}
        exec(compile(ast.fix_missing_locations(copy.deepcopy(tree)), str(self.path), "exec"), space)
        return space["ANSWER"]


def mutants(chapter: str) -> Iterator[Mutant]:
    """All mutants of a chapter's solutions; a part that serves several exercises is changed for the first of them."""
    solutions, done = Solutions(chapter), set[int]()
    for name, expression in solutions.answers.items():
        counted: Counter[str] = Counter()
        check = getattr(solutions.module, name)
        answer = solutions.module.RIGHT[check]
        if check.number in YES_OR_NO:
            yield Mutant(chapter, check, "result turned round", partial(turned_round, answer))
        elif check.number not in NO_NUMBER:
            yield Mutant(chapter, check, "sign turned", partial(with_scaled_result, answer, -1, 1))
            for scale in SCALES:
                yield Mutant(chapter, check, f"result times {scale}", partial(with_scaled_result, answer, scale, 1))
                yield Mutant(chapter, check, f"result by {scale}", partial(with_scaled_result, answer, 1, scale))
        parts = solutions.needed(expression)
        if isinstance(expression, ast.Call):  # a number that takes a solve
            continue
        for place, part in enumerate(parts):
            if id(part) in done or getattr(part, "name", "") in COPIED.get(chapter, ()):
                continue
            done.add(id(part))
            for what, changed in changes(part, SCALES[:1] if check.number in SOLVING else SCALES):
                counted[what] += 1
                what = f"{what} ({counted[what]})" if counted[what] > 1 else what
                others = [*parts[:place], changed, *parts[place + 1 :]]
                yield Mutant(chapter, check, what, partial(solutions.made, expression, others))


@contextmanager
def patience(seconds: float) -> Iterator[None]:
    """Raise `Endless` in what takes longer."""

    def over(*_: Any) -> None:
        raise Endless

    before = signal.signal(signal.SIGALRM, over)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def played(mutant: Mutant, seconds: float = PATIENCE) -> tuple[str, str]:
    """What the check says of a mutant: "refused", "accepted", or "endless", and its words."""
    try:
        with patience(seconds), np.errstate(all="ignore"):
            answer = mutant.make()
            verdict = mutant.check(*(answer if isinstance(answer, tuple) else (answer,)))
    except Endless:
        return "endless", ""
    except Exception as error:  # a line at the top of the file that fails, as in the reader's cell
        return "refused", f"{type(error).__name__}: {error}"
    return ("accepted" if verdict else "refused"), str(verdict)


# ---- what is the same answer

SIGN = "only the sign is asked for"
EQUIVALENT: dict[str, dict[str, str]] = {  # exercise -> what was changed, "…" for anything -> why it is the same
    "1.1": {"result …": SIGN},
    "1.5": {"… for `2`": "half of a number is above zero where twice or a sixth of it is"},
    "2.6": {
        "result by …": "flatter, with the same sign: it is still 1-Lipschitz",
        "… for `1.0`": "the same two parts elsewhere on the closed line",
        "`x` for `x + 1.0`": "the same two parts elsewhere on the closed line",
        "… for `2.0`": "x + 1 is below 2, and below what is more, at every place of the line",
        "`0.0… for `0.001`": "a gap a little narrower",
    },
    "3.5": {
        "`6.0` for `3.0`…": "a longer line of nodes, coarser and still within the 0.01 that are asked for",
        "`9.0` for `3.0`…": "a longer line of nodes, coarser and still within the 0.01 that are asked for",
        "`33.0` for `3.0`…": "a longer line of nodes, coarser and still within the 0.01 that are asked for",
        "`4802` for `2401`": "a finer line of nodes",
        "`162` for `81`": "more pushes, of which the ends decide",
    },
    "4.3": {f"result by {by}": "a weaker wind that still defeats the boat" for by in (2, 3)},
    "4.4": {f"result by {by}": "another start from which it is hit between two looks" for by in (2, 3)},
    "4.5": {
        "result …": SIGN,
        "`target` for …": "target and obstacle do not meet in this lake",
        "`-obstacle` for `-obstacle if …": "the check asks for the tube that watches the obstacle",
        "`16` for `8`": "each heading twice",
    },
    "6.3": {
        "`1 + int(…` for `max(2, …": "a positive way asks for at least one gap, so for two samples",
        "… for `1e-12`": "a guard against rounding: no interval of the check is a whole number of gaps",
    },
    "6.4": {"result by …": "flatter, with the same sign: it is still 1-Lipschitz"},
    "7.6": {
        f"`{number}` for `1`{place}": "longer strides to one side: another game whose row pauses and grows again"
        for number in SCALES
        for place in ("", " (2)")
    },
    "7.5": {"`first & seen[n]` for `first & seen[n] | unseen`": "the sets are nested without it, by induction on n"},
    "8.3": {"`np.maximum(…` for `result if size == width else…": "a window united with itself"},
    "8.5": {"`62` for `31`": "more rings", "`4` for `2` (2)": "more points on each circle"},
    "9.4": {
        what: "another problem of the kind: it wins more than its target, and its projection is empty"
        for what in (
            *("`2` for `1`", "`2` for `1` (2)", "`2` for `1` (3)", "`2` for `1` (4)"),
            *("`2.0` …", "`0.2` …", "`0.5` …", "`0.4` …", "`6` …"),
        )
    },
    "10.2": {
        what: "the same whole number of nodes: these terms are small beside the tubes"
        for what in ("`200` for `100`", "`45 * 8 * m ** 4 + 100 * m ** 4` for …", "`1600` for `800`")
    },
    "11.2": {
        "`np.abs(…` for `np.abs(… + 0.001 * …": "of equals the table takes the least margin itself",
        "result …": "the least of the scores is the least of them scaled",
        "… for `0.001`": "still far too little to outweigh a level of the first joint",
    },
    "11.3": {
        "`low` for `max(low, 0.0)`": "Wilson's interval does not leave [0, 1]",
        "`high` for `min(high, 1.0)`": "Wilson's interval does not leave [0, 1]",
        "… for `1.0`": "Wilson's interval does not leave [0, 1]",
    },
    "12.2": {
        "result by …": "flatter, with the same sign",
        "`0.30000000000000004` for `0.1`": "the dip is between two other nodes",
    },
    "12.4": {"`failed[left].mean()` for …": "NumPy's mean of nothing is not a number either, and warns"},
    "12.5": {"`400` for `200`": "more tries", "`8` for `4` (2)": "an array without rows is empty, however wide it is"},
    "15.5": {"`8` for `4` (3)": "within more steps than there are is within all of them"},
    "14.3": {"… for `10`": "the inner range ends at 9, so a larger m has no partner"},
    "14.4": {"`120` for `60`": "sixty halvings are as far as a double goes"},
    "16.5": {"`0.001` for `0.0005`": "the interval's left end is within 0.001, as asked for"},
}


def why_same(mutant: Mutant) -> str:
    """Why a mutant is the same answer; empty where nothing says so."""
    for pattern, reason in EQUIVALENT.get(mutant.number, {}).items():
        if re.fullmatch(".*".join(map(re.escape, pattern.split("…"))), mutant.what, re.DOTALL):
            return reason
    return ""


def planes(rng: Any) -> Iterator[tuple[Any, ...]]:
    for _ in range(20):
        yield tuple(rng.uniform(-1, 1, (2, 2000)))


def nodes_of_a_line(rng: Any) -> Iterator[tuple[Any, ...]]:
    for _ in range(100):
        yield rng.uniform(-0.2, 1.0, 30), float(rng.uniform(0.05, 0.6))


def samples(rng: Any) -> Iterator[tuple[Any, ...]]:
    for _ in range(300):
        radius = rng.uniform(0.02, 0.2)
        yield radius, rng.uniform(0.05, 2.0), rng.uniform(0.05, 0.5), radius * rng.uniform(0.001, 0.9)


def games(rng: Any) -> Iterator[tuple[Any, ...]]:
    for most in (0, 1, 2, 3, 4, 6) * 20:
        step = rng.integers(0, 9, (2, 9, 2))
        yield step, rng.random(9) < 0.3, rng.random(9) < 0.3, rng.random(9) < 0.15, most


def lakes(rng: Any) -> Iterator[tuple[Any, ...]]:
    x, y = np.meshgrid(np.linspace(-1.2, 1.2, 31), np.linspace(-1.2, 1.2, 31), indexing="ij")
    yield from ((x, y, steps) for steps in (0, 1))


def postures(rng: Any) -> Iterator[tuple[Any, ...]]:
    for _ in range(50):
        yield rng.normal(size=(2, 2)) * 0.1, 0.08, 0.1, float(rng.uniform(0, 0.3))


def sensors(rng: Any) -> Iterator[tuple[Any, ...]]:
    make = importlib.import_module("course.checks.chapter_16")._slider
    yield from ((make, np.array(state)) for state in ((0.2, 0.0), (-0.3, 0.1)))


def rows(rng: Any) -> Iterator[tuple[Any, ...]]:
    yield from ((rng.normal(size=64), width) for width in range(1, 30))


def small_grids(rng: Any) -> Iterator[tuple[Any, ...]]:
    grid = sdhj.Grid((-0.5, -0.5), (0.5, 0.5), (9, 9), ends="wall")
    yield grid, np.hypot(*grid.points().T).reshape(grid.shape) - 0.2, 0.1


def rows_below(rng: Any) -> Iterator[tuple[Any, ...]]:
    """Entries of the rows 1 to 4, one state each, and a place (k, n) whose row k + 1 is known."""
    for k, n in ((row, m) for row in range(4) for m in range(1, 5 - row)):
        yield {(row, m): rng.random(1) < 0.5 for row in range(5) for m in range(5)}, k, n


def candidates(rng: Any) -> Iterator[tuple[Any, ...]]:
    inputs = np.array([(a, b) for a in np.linspace(-3, 3, 5) for b in np.linspace(-3, 3, 5)])
    for _ in range(50):
        margins = -rng.uniform(0, 0.1, 25)
        yield (SimpleNamespace(problem=SimpleNamespace(inputs=inputs), inputs=rng.permutation(25), margins=margins),)


def counts(rng: Any) -> Iterator[tuple[Any, ...]]:
    for runs in (1, 2, 7, 50, 1234):
        yield from ((int(successes), runs) for successes in {0, runs, *rng.integers(0, runs + 1, 5)})


def failures(rng: Any) -> Iterator[tuple[Any, ...]]:
    for epsilon in (0.0, 0.01, 0.5):
        yield -rng.uniform(0, 0.1, 300), rng.random(300) < 0.4, epsilon


def no_input(rng: Any) -> Iterator[tuple[Any, ...]]:
    yield ()


def as_wide_a_gain(ours: Any, theirs: Any) -> bool:
    """For every x some omega lies outside the target, and the full game wins more than the target by another method."""
    table = sdhj.solve(theirs, "lax", progress=False)
    values = theirs.target_value(theirs.grid.points(), 0.0).reshape(theirs.grid.shape)
    gained = table.fraction(start=0, within=theirs.steps) - table.fraction(start=0, within=0)
    return bool((values.max(axis=1) > 0).all() and gained > 0)


def as_hidden(ours: Any, theirs: Any) -> bool:
    """At most zero somewhere, above zero at every fifth of the places, and nowhere steeper than 1."""
    steep = np.abs(np.diff(theirs)).max() / (2 / (len(theirs) - 1))
    return bool(theirs.min() <= 0 < theirs[:: len(theirs) // 10].min() and steep <= 1 + 1e-9)


def as_filled(ours: Any, theirs: Any) -> bool:
    """The same nodes are lowered; or two parts with a narrow gap, on 2001 places of [-1, 1], slopes of at most 1."""
    if theirs.dtype == bool:
        return np.array_equal(ours, theirs)
    ends = np.flatnonzero(np.diff((theirs <= 0).astype(int)))  # before the first, within, and after the last part
    gaps = [right - left for left, right in pairwise(ends) if theirs[left + 1] > 0]
    steep = np.abs(np.diff(theirs)).max() / (2 / (len(theirs) - 1))
    return bool(len(gaps) >= 1 and min(gaps) <= 80 and steep <= 1 + 1e-9)


def same_order(ours: Any, theirs: Any) -> bool:
    """Of two rules: no pair of inputs stands the other way round, where equals may stand in any order."""
    return not np.any(np.subtract.outer(ours, ours) * np.subtract.outer(theirs, theirs) < 0)


def starts(rng: Any) -> Iterator[tuple[Any, ...]]:
    """A small table's controller, and states from its tube."""
    table = sdhj.solve(sdhj.arm_case_study(nodes=9, steps=3), progress=False)
    states = rng.uniform(table.grid.lower, table.grid.upper, (2000, 4))
    for q in states[table.contains(states, start=0, within=3)][:5]:
        yield sdhj.Controller(table), q, np.random.default_rng(0)


def as_sought(ours: Any, theirs: Any) -> bool:
    """Nothing, or a row of four signs for each interval: whether these beat the robot is what the check plays."""
    return theirs.size == 0 or (theirs.shape == (3, 4) and bool((np.abs(theirs) == 1).all()))


def clearances(start: Any, winds: Any) -> tuple[Any, Any]:
    """Of the boat on its way, from the obstacle; and its end. By the rule of the midpoint, in small steps."""
    q, parts = np.array(start, dtype=np.float64), np.repeat(np.atleast_2d(winds), 4000 // len(winds), axis=0)
    found, h = [np.hypot(q[0] - 0.05, q[1] + 0.12) - 0.13], 0.6 / len(parts)
    for v in parts:
        middle = q + h / 2 * (np.array([1.5 - 0.8 * q[1], 0.1 + 0.8 * q[0]]) + v)
        q = q + h * (np.array([1.5 - 0.8 * middle[1], 0.1 + 0.8 * middle[0]]) + v)
        found.append(np.hypot(q[0] - 0.05, q[1] + 0.12) - 0.13)
    return np.array(found), q


def still_defeats(_: Any, winds: Any) -> bool:
    way, end = clearances((-0.42, 0.03), winds)
    return bool(np.abs(winds).max() <= 0.14 and (way.min() < 0 or np.hypot(end[0] - 0.55, end[1] - 0.30) > 0.42))


def still_passes(_: Any, start: Any) -> bool:
    ways = [clearances(start, [(a, b)])[0] for a in (-0.14, 0.14) for b in (-0.14, 0.14)]
    return min(min(way[0], way[-1]) for way in ways) > 0 > min(way.min() for way in ways)


def still_pauses(_: Any, game: Any) -> bool:
    """Row 0 of the game stands still at a column and grows at a later one; by sets, in plain loops."""
    step, goals, unsafe = (np.asarray(part).tolist() for part in game)
    row = [{s for s, there in enumerate(goal) if there and not unsafe[s]} for goal in goals]  # entries (k, 0)
    sizes = [len(row[0])]
    for _ in range(len(goals) - 1):  # entry (k, n) from (k, n - 1) and (k + 1, n - 1)
        leads = [
            {s for s, bad in enumerate(unsafe) if not bad and any(set(u[s]) <= to for u in step)} for to in row[1:]
        ]
        row = [entry | more for entry, more in zip(row, leads, strict=False)]
        sizes.append(len(row[0]))
    grew = [after > before for before, after in pairwise(sizes)]
    return any(not still and any(grew[at:]) for at, still in enumerate(grew))


def as_near(within: float) -> Callable[[Any, Any], bool]:
    return lambda ours, theirs: bool(np.all(np.abs(np.asarray(ours) - np.asarray(theirs)) <= within))


def same_set(ours: Any, theirs: Any) -> bool:
    """Two level-set functions of one set."""
    return np.array_equal(np.asarray(ours) <= 0, np.asarray(theirs) <= 0)


GIVEN: dict[str, tuple[Callable[[Any], Iterator[tuple[Any, ...]]], Callable[[Any, Any], bool]]] = {
    "1.1": (planes, same_set),
    "1.5": (nodes_of_a_line, np.array_equal),
    "2.6": (lambda rng: ((np.linspace(-1, 1, 2001),),), as_filled),
    "3.5": (lambda rng: ((rng.uniform(-1.2, 1.2, 30), number) for number in (1, 3, 5, 6)), as_near(0.01)),
    "4.5": (lakes, same_set),
    "6.3": (samples, np.array_equal),
    "6.4": (lambda rng: ((rng.uniform(-9, 9, (200, 2)),) for _ in range(20)), same_set),
    "7.5": (games, np.array_equal),
    "7.6": (rows_below, np.array_equal),
    "8.3": (rows, np.array_equal),
    "8.5": (small_grids, as_near(0.01)),
    "9.4": (no_input, as_wide_a_gain),
    "11.2": (candidates, same_order),
    "11.3": (counts, as_near(1e-12)),
    "12.2": (lambda rng: ((np.linspace(-1, 1, 2001),),), as_hidden),
    "12.4": (failures, lambda ours, theirs: np.array_equal(ours, theirs, equal_nan=True)),
    "12.5": (starts, as_sought),
    "15.5": (no_input, lambda ours, theirs: ours[1] == theirs[1]),
    "14.4": (postures, as_near(1e-9)),
    "16.5": (sensors, as_near(1e-3)),
}


ANSWERS = {
    "4.3": still_defeats,
    "4.4": still_passes,
    "7.6": still_pauses,
}  # answers that are no functions, and of which there are many


def alike(mutant: Mutant) -> bool:
    """Whether a mutant answers as the solution does, on inputs that the check does not have."""
    ours, theirs = Solutions(mutant.chapter).module.RIGHT[mutant.check], mutant.make()
    inputs, same = GIVEN.get(mutant.number, (no_input, np.array_equal))
    for mine, other in zip(parts_of(ours), parts_of(theirs), strict=True):
        if not callable(mine):
            if not ANSWERS.get(mutant.number, np.array_equal)(mine, other):
                return False
            continue
        for given in inputs(np.random.default_rng(2020)):
            with np.errstate(all="ignore"):  # as when it is played
                if not same(mine(*given), other(*given)):
                    return False
    return True


def parts_of(answer: Any) -> tuple[Any, ...]:
    return answer if isinstance(answer, tuple) else (answer,)


def main(chapters: list[str]) -> int:
    """Print what became of the mutants of each exercise; how many were accepted and are not known to be the same."""
    bad = 0
    for chapter in chapters or sorted(path.stem[-2:] for path in (NOTEBOOKS / "solutions").glob("solution_*.py")):
        for mutant in mutants(chapter):
            began = time.perf_counter()
            state, said = played(mutant)
            same = why_same(mutant)
            bad += (state == "accepted") != bool(same)
            mark = f"same, and {state}" if same else state
            print(f"{mutant.number}\t{mark}\t{time.perf_counter() - began:.2f}\t{mutant.what}\t{said}", flush=True)
    return bad


if __name__ == "__main__":
    sys.path[:0] = [str(NOTEBOOKS), str(NOTEBOOKS.parent / "figures")]
    sys.exit(min(main(sys.argv[1:]), 1))
