"""Values of every user function in README, notebooks and figures at 2,000 states.

    python tests/record_functions.py --write     writes tests/data/functions.npz
    python tests/record_functions.py             compares with it to 1e-12, and says what is different

User functions are what README.md, the notebooks with the modules beside them and figures/*.py give to a problem that is
not of the package's own making: level-set functions, what they sweep, drifts, gains, bounds. Nothing is copied here:
the code that makes the problems is run, with `sdhj.solve` put out of action, and every problem is caught as it is made.
A look at the syntax of all these files tells whether each place was come by where a set or dynamics is given.

A function is called as problems call it, with states of the problem's grid, in `PIECES` pieces: each has a time and an
input of its own. All of them are drawn anew each time, from the grid's ends, so that no one has to keep them; times are
between 0 and the last step, inputs any.

The file is small: of the 2,000 values of a function, or of each of its components, it has what single precision keeps,
which tells where something has changed, and in double precision the sums of `GROUP` of them each, with random signs,
which any change of a value changes as much. What several have alike is kept once. With NumPy's own sines the last bits
hang on the processor, so differences are told from 1e-12 of a function's largest value on.

Whoever reads these functions in another way, as expressions for example, has to come by these values.
"""

import argparse
import ast
import contextlib
import importlib
import inspect
import os
import sys
import tempfile
import time
import warnings
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import CodeType
from typing import Any
from unittest import mock

import matplotlib
import nbformat
import numpy as np
from documents import blocks

import sdhj

ROOT = Path(__file__).parents[1]
RECORD = ROOT / "tests" / "data" / "functions.npz"
FOLDERS = [ROOT / "figures", ROOT / "notebooks", ROOT / "notebooks" / "solutions"]
MODULES = [ROOT / "notebooks" / "course" / part for part in ("", "checks", "draw", "explore")]
PACKAGE = str(Path(sdhj.__file__).parent) + os.sep
STATES = 2000
GROUP = 8  # states in a sum
PIECES = 8  # of the states, each at a time and under an input of its own
LONG = 10  # steps whose times are asked about where a problem gives no number of them
CLOSE = 1e-12  # of a function's largest value
PARTS = {sdhj.UnsafeSet: ("level_set", "swept"), sdhj.TargetSet: ("level_set",), sdhj.Dynamics: ()}
OF_DYNAMICS = ("drift", "gain", "bounds", "velocity")


@dataclass(frozen=True)
class Function:
    """A function of a problem.

    Attributes
    ----------
    name : str
        Where its set or its dynamics was made, and what it is.
    kind : {"level_set", "swept", "drift", "gain", "bounds", "velocity"}
    problem : ReachAvoidProblem
    part : UnsafeSet, TargetSet or VectorField
        Whose function it is.
    """

    name: str
    kind: str
    problem: Any
    part: Any

    def values(self) -> Any:
        """At the states, times and inputs that are drawn: (2000,), or with axes of its own behind."""
        problem, grid = self.problem, self.problem.grid
        rng = np.random.default_rng(zlib.crc32(repr((grid.lower, grid.upper)).encode()))
        length = (problem.steps or LONG) * problem.delta
        states = rng.uniform(grid.lower, grid.upper, (STATES, grid.ndim))
        times, inputs = rng.uniform(0.0, length, PIECES), rng.integers(0, len(problem.inputs), PIECES)
        pieces = zip(np.split(states, PIECES), times.tolist(), inputs.tolist(), strict=True)
        return np.concatenate([np.asarray(self._called(*piece), dtype=np.float64) for piece in pieces])

    def _called(self, states: Any, t: float, j: int) -> Any:
        if self.kind in ("drift", "gain"):
            return getattr(self.part, f"{self.kind}_at")(states, j, t)
        if self.kind == "velocity":
            return self.part.extremes(states, j, t)
        if self.kind == "bounds":
            return self.part.bounds_at(j, t)[None]
        points = states[:, list(self.part.axes)]
        if self.kind == "swept":
            return self.part.swept(points, t, t + self.problem.delta)
        return self.part.level_set(points, t)


class Recorder:
    """Notes where sets and dynamics are made, by which functions, and which problems they are parts of."""

    def __init__(self) -> None:
        self.problems: list[Any] = []
        self.made: dict[int, tuple[Any, str, list[str]]] = {}  # by id: the part itself, so that it lives; place, kinds
        self.places: set[tuple[str, int]] = set()

    @contextlib.contextmanager
    def watching(self) -> Iterator[None]:
        with contextlib.ExitStack() as stack:
            for kind in PARTS:
                stack.enter_context(mock.patch.object(kind, "__init__", self._noting(kind)))
            stack.enter_context(mock.patch.object(sdhj.ReachAvoidProblem, "__init__", self._catching()))
            stack.enter_context(mock.patch.object(sdhj, "solve", lambda *given, **options: Unsolved()))
            yield

    def _noting(self, kind: type) -> Callable[..., None]:
        made = kind.__init__
        _, *names = inspect.signature(made).parameters

        def noting(part: Any, *given: Any, **named: Any) -> None:
            made(part, *given, **named)
            frame = sys._getframe(1)
            place, line = frame.f_code.co_filename, frame.f_lineno
            self.places.add((place, line))
            told = dict(zip(names, given, strict=False)) | named
            kinds = [name for name, value in told.items() if name in (*PARTS[kind], *OF_DYNAMICS) and users(value)]
            self.made[id(part)] = part, place_name(place, frame.f_code), kinds

        return noting

    def _catching(self) -> Callable[..., None]:
        made = sdhj.ReachAvoidProblem.__init__

        def catching(problem: Any, *given: Any, **named: Any) -> None:
            made(problem, *given, **named)
            _, *noted = self.made.get(id(named["dynamics"] if "dynamics" in named else given[1]), (None, "", []))
            self.made.setdefault(id(problem.dynamics), (problem.dynamics, *noted))  # what was read of it
            self.problems.append(problem)

        return catching

    def functions(self) -> dict[str, Function]:
        """Every user function of the problems that were caught, by its name; one for all problems that share it."""
        found: dict[str, Function] = {}
        values: dict[str, Any] = {}
        for problem in self.problems:
            for part in (problem.dynamics, problem.target, *problem.unsafe):
                _, place, kinds = self.made.get(id(part), (part, "", []))
                for kind in kinds:
                    of = f" of {part.name}" if hasattr(part, "name") else ""
                    add(found, values, Function(f"{place}: {kind}{of}", kind, problem, part))
        return found


def add(found: dict[str, Function], values: dict[str, Any], function: Function) -> None:
    """Keep a function; of several with one name those that say something else, with a number behind the name."""
    plain, number = function.name, 1
    while True:
        told = function.values()
        if function.name not in found:
            found[function.name], values[function.name] = function, told
            return
        if np.array_equal(values[function.name], told):
            return
        number += 1
        function = Function(f"{plain} ({number})", function.kind, function.problem, function.part)


class Unsolved:
    """In place of a table, for code that asks for no more than its share."""

    def fraction(self, **asked: int) -> float:
        return 0.0


def users(value: Any) -> bool:
    """Whether what is given is a function, and none of the package's own."""
    code = getattr(getattr(value, "__func__", value), "__code__", None)
    return isinstance(code, CodeType) and not code.co_filename.startswith(PACKAGE)


def place_name(file: str, code: CodeType) -> str:
    """A file or a block, and the function in it."""
    path = Path(file)
    named = str(path.relative_to(ROOT)) if path.is_relative_to(ROOT) else file
    return named if code.co_name in ("<module>", "<lambda>") else f"{named}, {code.co_qualname}"


# ---- the code that makes problems


def sources() -> Iterator[tuple[str, list[tuple[str, str]]]]:
    """README, the recipes and those notebooks that make parts of problems: a name, and names and code of the blocks."""
    for name in ("README.md", "notebooks/site/recipes.md"):
        yield name, [(f"{name} {number}", code) for number, code in enumerate(blocks(ROOT / name), 1)]
    for path in sorted((ROOT / "notebooks").glob("[0-9][0-9]_*.ipynb")):
        cells = [(at, cell) for at, cell in enumerate(nbformat.read(path, as_version=4).cells)]
        told = [(f"notebooks/{path.name}, cell {at}", cell.source) for at, cell in cells if cell.cell_type == "code"]
        if any(places_of(code) for _, code in told):
            yield path.name, told


def places_of(code: str) -> list[tuple[int, int]]:
    """First and last line of every call that makes a set or dynamics."""
    calls = (node for node in ast.walk(ast.parse(code)) if isinstance(node, ast.Call))
    names = {kind.__name__ for kind in PARTS}
    return [
        (call.lineno, call.end_lineno or call.lineno)
        for call in calls
        if getattr(call.func, "attr", getattr(call.func, "id", "")) in names
    ]


def run(blocks: Sequence[tuple[str, str]]) -> None:
    """Run blocks of code one after the other, without what only shows or asks; what needs a table goes wrong.

    Whether too much went wrong is told by the places that were not come by.
    """
    names: dict[str, Any] = {}
    for block, code in blocks:
        for statement in ast.parse(code).body:
            if isinstance(statement, ast.Expr | ast.For | ast.While):
                continue
            with contextlib.suppress(Exception):
                exec(compile(ast.Module([statement], []), block, "exec"), names)


def build() -> None:
    """Call what makes problems in the modules of figures/ and notebooks/, on few nodes."""
    boat, fleet, large, maze, shaky = map(importlib.import_module, ("boat", "fleet", "large", "maze", "shaky"))
    for build in fleet.FLEET.values():
        build().problem()
    extra = ("air3d", "dcdc", "losing", "sensing", "worked")
    air3d, dcdc, losing, sensing, worked = (importlib.import_module(f"extra_{name}") for name in extra)
    boat.boat_problem(nodes=21)
    air3d.air3d(nodes=(21, 21, 12))
    dcdc.dcdc(21)
    losing.plain_arm(nodes=7, steps=2)
    for module in (losing, sensing, shaky):
        module.car()
    for one in large.WORKED.values():
        one.problem(9)  # the least for six axes
    for one in worked.WORKED.values():
        one.problem(one.nodes[0])
    maze.maze(31, 12)
    for axes in (1, 2):
        shaky.point(axes)
    robots, check_4, check_15, check_16 = map(
        importlib.import_module,
        ("course.robots", *(f"course.checks.chapter_{chapter}" for chapter in ("04", "15", "16"))),
    )
    robots.point_robot()
    check_4.check_boat(None)
    check_15.reference_car()
    check_15._boat()
    check_16._slider(0.01)
    answers_9, answers_15 = map(importlib.import_module, ("solutions.solution_09", "solutions.solution_15"))
    answers_9.hopeless_projection()
    answers_9._easy()
    answers_15.boat()


def office(folder: Path) -> None:
    """The map that the recipes read: free but for a frame."""
    pixels = np.full((60, 80), 254, np.uint8)
    pixels[[0, -1]] = pixels[:, [0, -1]] = 0
    (folder / "office.pgm").write_bytes(b"P5\n80 60\n255\n" + pixels.tobytes())
    told = "resolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    (folder / "office.yaml").write_text(f"image: office.pgm\n{told}")


def caught() -> tuple[dict[str, Function], list[str]]:
    """Every user function, and the places where one may be given that were not come by."""
    recorder, blocks = Recorder(), dict[str, str]()
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(action="ignore"), recorder.watching():
        office(Path(folder))
        with contextlib.chdir(folder):
            for _, told in sources():
                run(told)
                blocks |= told
            build()
    for path in (path for folder in (*FOLDERS, *MODULES) for path in sorted(folder.glob("*.py"))):
        blocks[str(path)] = path.read_text(encoding="utf-8")
    missed = []
    for block, code in blocks.items():
        lines = {line for place, line in recorder.places if place == block}
        missed += [f"{block}, line {a}" for a, b in places_of(code) if not lines & set(range(a, b + 1))]
    return recorder.functions(), missed


# ---- comparing


@dataclass(frozen=True)
class Kept:
    """What is kept of a function: a row for each of its components.

    Attributes
    ----------
    values : (components, 2000) float32
    sums : (components, 2000 / GROUP)
    """

    values: Any
    sums: Any

    @classmethod
    def of(cls, values: Any) -> "Kept":
        values = values if len(values) == STATES else np.repeat(values, STATES // len(values), axis=0)  # for all states
        rows = np.ascontiguousarray(values.reshape(STATES, -1).T)
        signs = np.random.default_rng(0).choice([-1.0, 1.0], STATES)
        return cls(rows.astype(np.float32), (signs * rows).reshape(len(rows), -1, GROUP).sum(axis=2))


def difference(before: Kept, now: Kept) -> str:
    """What is not as it was, in words; nothing where all is."""
    if before.values.shape != now.values.shape:
        return f"has {len(now.values)} components, and had {len(before.values)}"
    largest = max(float(np.abs(before.values).max()), 1e-300)
    change = np.abs(before.sums - now.sums) / largest
    if (change <= CLOSE).all():
        return ""
    worst = np.abs(before.values.astype(np.float64) - now.values).max(axis=0)
    where = f"most at state {int(np.argmax(worst))}" if worst.max() > 1e-6 * largest else "less than one sees singly"
    return f"changed by up to {float(change.max()):.2g} of its largest value, {where}"


def differences(before: dict[str, Kept], now: dict[str, Kept]) -> list[str]:
    """One line for every function that is not as it was recorded."""
    lines = [f"{name}: recorded, and no longer there" for name in before if name not in now]
    for name, kept in now.items():
        told = difference(before[name], kept) if name in before else "nothing is recorded of it"
        lines += [f"{name}: {told}"] if told else []
    return lines


def write(functions: dict[str, Kept]) -> None:
    """Record functions; rows that several have alike once, and in `rows` which are whose."""
    known: dict[bytes, int] = {}
    values, sums, rows = [], [], []
    for kept in functions.values():
        own = []
        for value, total in zip(kept.values, kept.sums, strict=True):
            key = value.tobytes() + total.tobytes()
            if key not in known:
                known[key] = len(values)
                values.append(value)
                sums.append(total)
            own.append(known[key])
        rows.append(own)
    most = max(map(len, rows))
    padded = np.array([own + [-1] * (most - len(own)) for own in rows], np.int16)
    RECORD.parent.mkdir(exist_ok=True)
    np.savez_compressed(RECORD, names=list(functions), rows=padded, values=np.array(values), sums=np.array(sums))


def recorded() -> dict[str, Kept]:
    with np.load(RECORD) as file:
        names, rows, values, sums = (file[name] for name in ("names", "rows", "values", "sums"))
    own = [row[row >= 0] for row in rows]
    return {str(name): Kept(values[at], sums[at]) for name, at in zip(names, own, strict=True)}


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="record what is found")
    parser.add_argument("--names", action="store_true", help="print the names of the functions")
    given = parser.parse_args(arguments)
    began = time.perf_counter()
    functions, missed = caught()
    now = {name: Kept.of(function.values()) for name, function in functions.items()}
    if given.names:
        print(*now, sep="\n")
    lines = [f"{place}: a set or dynamics is made here, and was not come by" for place in missed]
    if given.write:
        write(now)
    else:
        lines += differences(recorded(), now)
    print(*lines, sep="\n", end="\n" if lines else "")
    told = f"{len(lines)} differences" if lines else "nothing has changed"
    print(f"{len(now)} functions in {time.perf_counter() - began:.0f} s; {'written' if given.write else told}")
    return 1 if lines else 0


if __name__ == "__main__":
    matplotlib.use("Agg")
    sys.path[:0] = map(str, (ROOT / "tests", *FOLDERS[:2]))  # as pytest has it
    sys.exit(main())
