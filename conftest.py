"""Doctests are collected where what a module needs is installed; the summary names tests that should be marked slow."""

import os
import re
import sys
from collections.abc import Callable, Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from numba.core.event import Event, Listener, register

collect_ignore = [] if find_spec("gymnasium") else ["sdhj/simulation/environment.py"]

# Rewriting the tests for pytest's assertions takes half of what collecting them does, so it is kept, as Python keeps
# what it compiles: in __pycache__, also where PYTHONDONTWRITEBYTECODE is set. Later runs and tests' processes read it.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


@cache
def robot_on_a_line() -> dict[str, Any]:
    """What the example in `help(sdhj)` defines; other examples use its problem, table and controller."""
    text = (Path(__file__).parent / "sdhj" / "__init__.py").read_text("utf-8").split('"""')[1]
    names: dict[str, Any] = {}
    exec("\n".join(re.findall(r"^(?:>>>|\.\.\.) (.*)$", text, re.MULTILINE)), names)
    return names


@pytest.fixture(autouse=True)
def as_a_reader_would_run_it(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """An example alone: no name of its module, the robot on a line where it says so, and `solve` warns as it does."""
    if (example := getattr(request.node, "dtest", None)) is None:
        return
    import sdhj.solving
    from sdhj.certified.explaining import scanty_finding
    from sdhj.simulation.played import check_by_runs

    example.globs.clear()
    if "With the robot on a line" in example.docstring:
        example.globs.update(robot_on_a_line())
    monkeypatch.setattr(sdhj.solving, "check_by_runs", check_by_runs)  # which tests/conftest.py leaves out
    monkeypatch.setattr(sdhj.solving, "scanty_finding", scanty_finding)


FAST = 0.25  # s of CPU that a test may take, compiling not counted, unless it is marked or keeps a promise
MARKED = ("slow", "campaign", "bench", "browser")


class Compiling(Listener):
    """The CPU time that Numba has compiled for in this process: one kernel's includes that of those it calls."""

    depth, began, seconds = 0, 0.0, 0.0

    def on_start(self, event: Event) -> None:
        if self.depth == 0:
            self.began = cpu()
        self.depth += 1

    def on_end(self, event: Event) -> None:
        self.depth -= 1
        if self.depth == 0:
            self.seconds += cpu() - self.began


def cpu() -> float:
    """The CPU time of this process and of those it has waited for, s: no clock, which misleads where others work."""
    return sum(os.times()[:4])


compiled = Compiling()
register("numba:compile", compiled)


def timed(phase: str) -> Callable[[pytest.Item], Iterator[object]]:
    """A hook that notes how long a phase of a test takes; a fixture that tests share counts for the first of them."""

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def hook(item: pytest.Item) -> Iterator[object]:
        before = cpu() - compiled.seconds
        try:
            return (yield)
        finally:
            item.user_properties.append((f"CPU s of {phase}", round(cpu() - compiled.seconds - before, 3)))

    return hook


pytest_runtest_setup, pytest_runtest_call = timed("setup"), timed("call")


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Name the tests that README's command waits for though they are not fast; only the clock of a CPU is asked."""
    long = []
    for report in terminalreporter.getreports(""):
        if getattr(report, "when", "") != "teardown" or report.nodeid.startswith("tests/promises/"):
            continue
        times = [x for name, x in report.user_properties if name.startswith("CPU s of ")]
        if sum(times) > FAST and not any(mark in report.keywords for mark in MARKED):
            long.append((sum(times), times[0], report.nodeid))
    if long:
        terminalreporter.section(f"more than {FAST} s of CPU, compiling not counted: to be marked slow, or made faster")
    for total, setup, name in sorted(long, reverse=True):
        terminalreporter.line(f"{total:6.2f} s, {setup:5.2f} s of it for fixtures: {name}")
