"""Doctests are collected where what a module needs is installed; a test that cannot be imported is an error."""

import os
import re
import sys
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

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
