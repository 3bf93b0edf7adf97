"""Odd arguments, one at a time, in every public call: answers are right, or a sentence says what does not fit.

Each call counts as *clear* (an answer, or an error of the library's own that names what was odd), *unclear* (any other
exception), *wrong* (an answer to what is no number, or one that the oracle of its kind contradicts) or *hang*. The
sequence of calls is the same in every run; how far it goes is a matter of time: `SDHJ_FUZZ_SECONDS=3600 pytest
-m campaign -n 0 -s tests/campaign/test_fuzz.py` goes on for an hour and prints the counts.
"""

import os
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from zoo import interval_problem, interval_table

import sdhj
from sdhj.certified import Certified
from sdhj.cli import main

SECONDS = float(os.environ.get("SDHJ_FUZZ_SECONDS", "45"))  # for all kinds together
PATIENCE = 60.0  # s that one call may take: the first ones compile kernels that are not in the cache
PACKAGE = str(Path(sdhj.__file__).parent)
SENTENCE = 700  # characters at most


@cache
def a_line() -> sdhj.ReachAvoidProblem:
    return interval_problem(nodes=21, steps=2)


class Enough(Exception):
    """The time is over."""


@dataclass
class Case:
    """A call of the library.

    names : what an error has to name, one of them.
    refused : whether it must not answer.
    right : says of the answer whether it may be.
    """

    call: Callable[[], Any]
    names: tuple[str, ...]
    told: str
    refused: bool = False
    right: Callable[[Any], bool] = field(default=lambda answer: True)


# ---- odd values

NO_NUMBERS = [
    lambda: np.ma.array([0.5, 0.5], mask=[True, False]),
    lambda: np.array([0.5 + 0.5j]),
    lambda: 1j,
    lambda: np.array(["2020-01-01"], "datetime64[D]"),
    lambda: np.timedelta64(3, "s"),
    lambda: "0.5",
    lambda: b"0.5",
    lambda: ["a"],
    lambda: [[1.0], [1.0, 2.0]],
    lambda: [np.zeros(2), np.zeros(3)],
    lambda: np.array([None, 1.0]),
    lambda: {},
    lambda: {"a": 1.0},
    lambda: {1.0, 2.0},
    lambda: object(),
    lambda: ...,
    lambda: np.nan,
    lambda: [np.nan],
    lambda: np.full((2, 1), np.nan),
]
NUMBERS = [
    lambda: None,
    lambda: True,
    lambda: 0,
    lambda: -1,
    lambda: 3,
    lambda: 2.5,
    lambda: 1e308,
    lambda: 1e-308,
    lambda: np.inf,
    lambda: 2**63,
    lambda: 10**400,
    lambda: np.float16(0.5),
    lambda: np.uint8(200),
    lambda: [],
    lambda: (),
    lambda: [0.5],
    lambda: [True],
    lambda: [[0.5]],
    lambda: np.zeros((0, 1)),
    lambda: np.zeros((3, 1)),
    lambda: np.zeros((1, 3)),
    lambda: np.zeros(()),
    lambda: np.zeros((2, 2, 2)),
    lambda: np.arange(3),
    lambda: [1e308, -1e308],
    lambda: range(3),
    lambda: iter([1.0]),
    lambda: slice(3),
    lambda: "hji",
    lambda: "",
    lambda: lambda *anything: None,
]
LABOUR = {"runs": 1000, "cells": 200, "parts": 50, "nodes": 10}  # larger ones are much work, and no hang
SIZES = st.floats(width=64) | st.integers(-(2**70), 2**70)


@st.composite
def odd(draw: Any) -> tuple[Any, bool]:
    """Something, and whether it is no number whatever is asked for."""
    place = draw(st.integers(0, len(NO_NUMBERS) + len(NUMBERS) + 9))
    if place < len(NO_NUMBERS):
        return NO_NUMBERS[place](), True
    if place < len(NO_NUMBERS) + len(NUMBERS):
        return NUMBERS[place - len(NO_NUMBERS)](), False
    value = draw(SIZES | st.lists(SIZES, max_size=3))
    return value, False


def one_odd(usual: dict[str, Any], call: Callable[..., Any], numeric: tuple[str, ...] = (), **more: Any) -> Any:
    """Cases of `call(**usual)` with one argument odd; it must be refused where that is no number and should be."""

    @st.composite
    def cases(draw: Any) -> Case:
        name, (value, none) = draw(st.sampled_from(sorted(usual))), draw(odd())
        if name in LABOUR and isinstance(value, int | float) and LABOUR[name] < value <= 10**9:
            value = int(value) % LABOUR[name]
        names = (name, *more.get("also", {}).get(name, ()))
        refused = none and name in numeric
        right = more.get("right", lambda answer: True)
        return Case(partial(call, **usual | {name: value}), names, f"{name}={value!r:.80}", refused, right)

    return cases()


def one_of(*strategies: Any) -> Any:
    return st.one_of(*strategies)


# ---- the kinds


def grids() -> Any:
    usual = {"lower": [-1.0, 0.0], "upper": [1.0, 2.0], "shape": [7, 9], "periodic": [True, False]}
    usual |= {"names": ["a", "b"], "ends": ["wall", "safe"]}
    also = {"lower": ("upper",), "shape": ("axes", "lower", "upper", "periodic", "names", "nodes", "ends")}
    return one_odd(usual, sdhj.Grid, ("lower", "upper", "shape"), also=also)


def dynamics() -> Any:
    usual = {"inputs": [[-1.0], [1.0]], "drift": [[-1.0], [1.0]], "gain": [[1.0]], "bounds": [0.1]}

    def made(**given: Any) -> Any:
        return sdhj.solve(problem_of(dynamics=sdhj.Dynamics(**given)), progress=False)

    @st.composite
    def answers(draw: Any) -> Case:
        name, (value, none) = draw(st.sampled_from(["drift", "gain", "bounds"])), draw(odd())
        function = {"drift": lambda q, u: value, "gain": lambda q, u: value, "bounds": lambda t: value}[name]
        call = partial(made, **usual | {name: function})
        return Case(call, (name, "velocit", "too fast", "delta"), f"{name} answers {value!r:.80}", none)

    also = {"inputs": ("drift",), "gain": ("bounds", "velocit"), "bounds": ("gain", "velocit"), "drift": ("velocit",)}
    return one_of(one_odd(usual, made, tuple(usual), also=also), answers())


def problem_of(**change: Any) -> Any:
    return replace(a_line(), **change)


def sets() -> Any:
    def unsafe(**given: Any) -> Any:
        return problem_of(unsafe=(sdhj.UnsafeSet(**given),))

    def target(**given: Any) -> Any:
        return problem_of(target=sdhj.TargetSet(**given))

    usual = {"axes": (0,), "level_set": lambda p, t: 3.0 - p[:, 0], "name": "odd"}
    own = {"swept": None, "sampling": "nodes"}

    @st.composite
    def answers(draw: Any) -> Case:
        make, (value, none) = draw(st.sampled_from([unsafe, target])), draw(odd())
        call = partial(make, **usual | {"level_set": lambda p, t: value})
        return Case(call, ("level set of", "in the target", "swallow"), f"level set answers {value!r:.80}", none)

    also = {"level_set": ("level set",), "swept": ("level set",), "axes": ("axis",)}
    return one_of(
        one_odd(usual | own, unsafe, ("axes",), also=also),
        one_odd(usual | {"level_set": lambda p, t: np.abs(p[:, 0]) - 1.0}, target, ("axes",), also=also),
        answers(),
    )


def problems() -> Any:
    usual = {
        name: getattr(a_line(), name)
        for name in ("grid", "dynamics", "target", "unsafe", "delta", "steps", "view_time")
    }
    numeric = ("grid", "dynamics", "delta", "steps", "view_time")
    return one_odd(usual, sdhj.ReachAvoidProblem, numeric, also={"unsafe": ("target",), "target": ("unsafe",)})


def methods() -> Any:
    scheme = {"flux": "godunov", "order": 2, "integrator": "rk2", "cfl": 0.75, "frame": "moving", "dtype": "float32"}

    def certified(**given: Any) -> Any:
        return sdhj.solve(a_line(), Certified(**{"cells": [16]} | given), progress=False)

    def growing(table: Any) -> bool:
        return table.fraction(start=0, within=0) <= table.fraction(start=0, within=2) <= 0.875

    def solved(maker: Any, **given: Any) -> Any:
        return sdhj.solve(a_line(), maker(**given), progress=False)

    return one_of(
        one_odd(scheme, lambda **given: sdhj.HJI(sdhj.Scheme(**given)), tuple(scheme)),
        one_odd({"scheme": sdhj.Scheme()}, partial(solved, sdhj.HJI), ("scheme",)),
        one_odd({"interpolation": "linear", "dtype": "float64"}, partial(solved, sdhj.HopfLax), ("dtype",)),
        one_odd({"subspaces": [(0,)], "inner": sdhj.HJI()}, sdhj.Projected, ("subspaces", "inner")),
        one_odd(
            {"cells": [16], "parts": 2}, certified, ("cells", "parts"), right=growing, also={"cells": ("certifying",)}
        ),
        one_odd({"method": "hji", "problem": a_line()}, partial(sdhj.solve, progress=False), ("method", "problem")),
    )


def states() -> Any:
    table = interval_table()
    controller, q = sdhj.Controller(table), np.array([1.5])
    one, many, when = {"q": q, "step": 0}, {"states": q[None], "step": 0}, ("step", "state", "states")
    kinds = {"start": 0, "within": 2}
    whole_table = [table.values, table.inputs, table.fraction]
    return one_of(
        *(
            one_odd(one, call, ("q", "step"), also={"q": ("state",)})
            for call in (controller.steps_to_go, controller.safe_inputs, controller.select, controller.fallback)
        ),
        one_odd(many, controller.batch, when),
        one_odd(one | {"wanted": 1}, controller.filter, ("q", "step", "wanted"), also={"q": ("state", "wanted")}),
        one_odd({"points": q[None]} | kinds, table.contains, ("points", *kinds)),
        *(one_odd(kinds, call, tuple(kinds)) for call in whole_table),
        one_odd(
            {"points": q[None], "t": 0.0}, table.problem.unsafe_value, ("points", "t"), also={"points": ("level set",)}
        ),
    )


def rules() -> Any:
    table, q = interval_table(), np.array([1.5])

    def chosen(rule: Any) -> int:
        return sdhj.Controller(table, rule).select(q, 0)

    @st.composite
    def answers(draw: Any) -> Case:
        value, none = draw(odd())
        return Case(partial(chosen, lambda among: value), ("rule",), f"rule answers {value!r:.80}", none)

    controllers = one_odd({"table": table, "rule": "effort"}, sdhj.Controller, ("table",))
    return one_of(controllers, answers())


def runs() -> Any:
    controller, q = sdhj.Controller(interval_table()), np.array([1.5])

    def counted(report: Any) -> bool:
        low, high = report.starts.min(), report.starts.max()  # the tube within 5 steps is [-3, 3]
        return sum(report.counts.values()) == report.runs and low >= -3.01 and high <= 3.01

    @st.composite
    def answers(draw: Any) -> Case:
        value, none = draw(odd())
        call = partial(sdhj.simulate, controller, q, lambda moment: value)
        return Case(call, ("adversary",), f"adversary answers {value!r:.80}", none)

    many: dict[str, Any] = {"controller": controller, "runs": 10, "adversary": "worst", "seed": 0}
    once = {"controller": controller, "q0": q, "adversary": "worst", "seed": 0}
    return one_of(
        one_odd(many, partial(sdhj.monte_carlo, progress=False), ("controller", "runs", "seed"), right=counted),
        one_odd(once, sdhj.simulate, ("controller", "q0", "seed"), also={"q0": ("state",)}),
        answers(),
    )


def case_studies() -> Any:
    usual: dict[str, Any] = {"nodes": 5, "steps": 1, "delta": 0.1, "lengths": (0.15, 0.15), "half_width": 0.01}
    usual |= {"u_max": 3.0, "v_d_max": 0.3, "v_p_max": 0.2, "input_levels": 3, "view_time": "swept"}
    usual |= {"kinematics": "relative", "pursuer_radius": 0.04, "pursuer_box": 0.36, "obstacles": []}
    also = {name: ("target", "grid node", "unsafe", "inputs", "shape", name.split("_")[-1]) for name in usual}
    also["half_width"] = also["pursuer_radius"] = ("target", "level set")
    also["obstacles"] = ("disk", "target")
    also["lengths"] = ("arm", "links", "target", "level set")
    also["pursuer_box"] = ("upper", "lower", "spacing", "target", "level set")
    return one_odd(usual, sdhj.arm_case_study, ("nodes", "steps", "delta", "u_max", "input_levels"), also=also)


def files(folder: Path) -> Any:
    table, path = interval_table(), folder / "table.npz"
    table.save(path)
    paths = st.sampled_from(
        ["", ".", "..", "/", "/nonexistent/x.npz", "/dev/null", "a\0b", "x" * 300, "/dev/full", "y.npz"]
    )

    @st.composite
    def saved(draw: Any) -> Case:
        name = draw(paths | st.text(max_size=20).filter(lambda text: "/" not in text))
        place = folder / name if name not in ("", "a\0b") else name
        return Case(lambda: table.save(place), (str(place), "path", "name", "file", "folder"), f"save({place!r:.80})")

    def back(read: Any) -> bool:
        return bool(np.array_equal(read.tubes, table.tubes))

    wrong = one_odd({"path": path, "problem": table.problem}, sdhj.load, right=back, also={"path": ("file",)})
    return one_of(saved(), wrong)


def signals(folder: Path) -> Any:
    """`sdhj solve` stopped at any time: a table that loads or none, no litter, no traceback, the signal's status."""

    def stopped(number: int, after: float) -> bool:
        with tempfile.TemporaryDirectory(dir=folder) as own:
            command = [sys.executable, "-X", "importtime", "-m", "sdhj", "solve", "--nodes", "9", "--steps", "2"]
            command += ["-o", f"{own}/arm.npz"]
            process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
            assert process.stderr is not None
            while "sdhj.cli" not in process.stderr.readline():  # from there on the command can act
                assert process.poll() is None
            try:
                said = process.communicate(timeout=after)[1]
            except subprocess.TimeoutExpired:
                process.send_signal(number)
                said = process.communicate()[1]
            left = [entry.name for entry in Path(own).iterdir()]
            if left == ["arm.npz"]:
                sdhj.load(f"{own}/arm.npz")
            plain = "Traceback" not in said and process.returncode in (0, 128 + number, -number)
            return plain and left in ([], ["arm.npz"])

    return st.builds(
        lambda number, after: Case(
            partial(stopped, number, after), (), f"signal {number} after {after:.3f} s", right=lambda tidy: tidy
        ),
        st.sampled_from([signal.SIGINT, signal.SIGTERM]),
        st.floats(0.05, 4.0),  # the handler is set a moment after that line
    )


def command_line(folder: Path) -> Any:
    path = folder / "arm.npz"
    if not path.exists():
        sdhj.solve(sdhj.arm_case_study(nodes=5, steps=1), progress=False).save(path)
    commands = {
        "solve": ["--nodes", "--steps", "--method", "--view-time", "--kinematics", "--cells"],
        "simulate": ["--runs", "--adversary", "--rule", "--seed", "--start"],
        "verify": ["--samples", "--seed"],
        "info": ["--help"],
    }
    values = st.sampled_from(
        ["0", "-1", "5", "1e9", "9" * 400, "nan", "", "x", "hji", "certified", "5,5,5,5", "é\u2028", "a.npz"]
    )

    @st.composite
    def called(draw: Any) -> Case:
        command = draw(st.sampled_from(sorted(commands)))
        option, value = draw(st.sampled_from(commands[command])), draw(values)
        usual = ["--nodes", "5", "--steps", "1", "-o", str(folder / "out.npz")] if command == "solve" else [str(path)]
        usual += ["--runs", "10"] if command == "simulate" and option not in ("--runs", "--start") else []
        typed = [command, *usual, option, *([value] if option != "--help" else [])]
        return Case(partial(typed_in, typed), (option.strip("-"), "-o", "FILE", value[:9]), " ".join(typed)[-90:])

    return called()


def typed_in(arguments: list[str]) -> str:
    """What a command prints; its refusal as ValueError, whatever else it ends with as RuntimeError."""
    done = CliRunner().invoke(main, arguments)
    if done.exit_code == 0:
        return str(done.output)
    lines = [line for line in done.output.splitlines() if line.startswith("Error")]
    if done.exit_code != 2 or len(lines) != 1 or "Traceback" in done.output:
        raise RuntimeError(f"exit {done.exit_code}: {done.output[-300:]}, {done.exception!r}")
    raise sdhj.cli.Refusal(lines[0])


KINDS: dict[str, Callable[..., Any]] = {
    "grids": grids,
    "dynamics": dynamics,
    "sets": sets,
    "problems": problems,
    "methods": methods,
    "states": states,
    "rules": rules,
    "runs": runs,
    "case studies": case_studies,
    "files": files,
    "signals": signals,
    "command line": command_line,
}


# ---- the judge


class Endless(BaseException):
    """A call that has not come to an end in time."""


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


def judged(case: Case) -> tuple[str, str]:
    """The verdict, and what was said."""
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"), patience(PATIENCE):
            warnings.simplefilter("ignore")
            answer = case.call()
    except Endless:
        return "hang", ""
    except (ValueError, OSError, MemoryError, sdhj.cli.Refusal) as error:
        *_, last = traceback.extract_tb(error.__traceback__)
        said = str(error) or str(getattr(error, "message", ""))
        ours = last.filename.startswith(PACKAGE) or isinstance(error, sdhj.cli.Refusal)
        named = any(name and name in said for name in case.names)
        return "clear" if ours and named and len(
            said
        ) < SENTENCE else "unclear", f"{type(error).__name__}: {said[:300]}"
    except Exception as error:
        return "unclear", f"{type(error).__name__}: {str(error)[:200]} {traceback.format_exc()[-300:]}"
    return ("wrong", f"answered {answer!r:.100}") if case.refused or not case.right(answer) else ("clear", "")


@pytest.mark.campaign
@pytest.mark.usefixtures("signals_are_heard")
@pytest.mark.parametrize("kind", KINDS)
def test_odd_arguments_are_answered_or_named(kind: str, tmp_path: Path) -> None:
    sdhj.monte_carlo(sdhj.Controller(sdhj.solve(a_line(), progress=False)), 10, progress=False)  # compiles the kernels
    sdhj.monte_carlo(sdhj.Controller(interval_table(), "effort"), 10, progress=False)
    counts: Counter[str] = Counter()
    found: dict[tuple[str, str], str] = {}
    strategy = KINDS[kind](tmp_path) if kind in ("files", "signals", "command line") else KINDS[kind]()
    end, least = time.monotonic() + SECONDS / len(KINDS), 1 if kind == "signals" else 5

    @settings(
        max_examples=int(60 * SECONDS),
        derandomize=True,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(case=strategy)
    def one(case: Case) -> None:
        if time.monotonic() > end and counts.total() > least:
            raise Enough
        verdict, said = judged(case)
        counts[verdict] += 1
        if verdict != "clear":
            found.setdefault((verdict, case.told[:40]), f"{verdict}: {case.told} -> {said}")

    with suppress(Enough):
        one()
    print(
        f"\n{kind}: " + ", ".join(f"{counts[verdict]} {verdict}" for verdict in ("clear", "unclear", "wrong", "hang"))
    )
    assert counts["clear"] > least
    assert not found, "\n".join(list(found.values())[:40])
