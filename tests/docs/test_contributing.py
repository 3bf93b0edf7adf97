"""What CONTRIBUTING says how to add: its own code is run, and what comes out does what the text says."""

import ast
import dataclasses
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import nbformat
import numpy as np
import pytest

import sdhj
from sdhj.formulas.arrays import MADE
from sdhj.problem.ends import ENDS

ROOT = Path(__file__).parent.parent.parent
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```python\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)
INLINE = [block for block in BLOCKS if not block.startswith("# ")]  # the others begin with the file they belong to


def block(file: str) -> str:
    """The one block that belongs to a file."""
    (found,) = (code for code in BLOCKS if code.startswith(f"# {file}"))
    return found


@pytest.fixture(scope="module")
def names() -> Iterator[dict[str, Any]]:
    """What the blocks define that make up one program; other tests know neither its NumPy function nor its end."""
    defined: dict[str, Any] = {"__name__": "contributing"}
    known = dict(MADE)
    for code in INLINE:
        exec(code, defined)
    yield defined
    del ENDS["door"]
    MADE.clear()
    MADE.update(known)


def run(arguments: list[str], folder: Path, **environment: str) -> str:
    """Run Python in a folder on this package; what it prints."""
    path = os.pathsep.join(filter(None, (environment.pop("PYTHONPATH", str(ROOT)), os.environ.get("PYTHONPATH"))))
    command = [sys.executable, *arguments]
    result = subprocess.run(
        command, cwd=folder, env=os.environ | environment | {"PYTHONPATH": path}, capture_output=True, text=True
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def test_every_promise_has_a_file_with_tests_that_are_always_run() -> None:
    """The table names each file of tests/promises once; in each some test is neither slow nor a campaign."""
    rows = re.findall(r"^\| (.+) \| (test_\w+\.py) \|$", TEXT, re.MULTILINE)
    files = {path.name: path for path in (ROOT / "tests" / "promises").glob("test_*.py")}
    assert len(rows) == len(dict(rows)) > 30 and sorted(name for _, name in rows) == sorted(files)
    for name, path in files.items():
        tree = ast.parse(path.read_text(encoding="utf-8"))
        tests = [one for one in tree.body if isinstance(one, ast.FunctionDef) and one.name.startswith("test_")]
        marks = [{ast.unparse(mark) for mark in one.decorator_list} for one in tests]
        assert not all(each & {"pytest.mark.slow", "pytest.mark.campaign"} for each in marks), name
        assert not re.search(r"^pytestmark\b.*mark\.(slow|campaign)", path.read_text(encoding="utf-8"), re.MULTILINE), (
            name
        )


def test_the_rule_goes_as_far_to_the_right_as_is_safe(names: dict[str, Any]) -> None:
    problem, controller = names["problem"], names["controller"]
    states = np.random.default_rng(1).uniform(problem.grid.lower, problem.grid.upper, (400, 2))
    batch = controller.batch(states, 0)
    rows = np.flatnonzero(batch.safe.any(axis=1))
    assert len(rows) > 50
    chosen = controller.choose(batch)
    for row in rows:
        assert batch.safe[row, chosen[row]]
        assert problem.inputs[chosen[row], 0] == problem.inputs[batch.safe[row], 0].max()
    assert controller.select(states[rows[0]], 0) == chosen[rows[0]]


@pytest.mark.slow
def test_the_steady_rule_changes_the_input_less(names: dict[str, Any]) -> None:
    """In simulated runs, in single queries, and in a control loop: each hands it the input before."""
    problem, table = names["problem"], names["table"]
    seen = list[int]()

    def watched(candidates: Any) -> Any:
        seen.extend(candidates.before.tolist())
        return names["steady"](candidates)

    def changes(rule: Any) -> int:
        controller, total = sdhj.Controller(table, rule), 0
        inside = problem.grid.points()[table.values(start=0, within=8).ravel() < -0.2]
        for start in inside[::8]:
            inputs = sdhj.simulate(controller, start, "worst", seed=0).inputs
            total += int(np.count_nonzero(np.diff(inputs)))
        return total

    assert changes(watched) < changes("deepest") and min(seen) == -1 and max(seen) > 0
    states = problem.grid.points()[::7]
    batch = sdhj.Controller(table).batch(states, 0)
    row = int(np.flatnonzero((batch.safe.sum(axis=1) >= 2) & batch.promised)[0])
    controller = sdhj.Controller(table, names["steady"])
    for j in np.flatnonzero(controller.safe_by_true_sets(batch)[row]).tolist():
        assert controller.select(states[row], 0, before=j) == j
    first = controller.step(states[row], 0.0).input
    again = controller.step(states[row], problem.delta)
    assert again.input == first or first not in controller.safe_inputs(states[row], 1)
    with pytest.raises(ValueError, match="before "):
        controller.select(states[row], 0, before=len(problem.inputs))


def test_the_new_numpy_function_is_read_and_bounded(names: dict[str, Any]) -> None:
    wall, x = names["bent_wall"].level_set, np.linspace(-3.0, 3.0, 61)[:, None]
    np.testing.assert_allclose(wall(x, 0.0), np.arcsinh(x[:, 0]) - 1.0, rtol=0, atol=1e-14)
    low, high = wall.bounds(x - 0.01, x + 0.01, (0.0, 0.0))
    assert (low <= np.arcsinh(x[:, 0]) - 1.0).all() and (np.arcsinh(x[:, 0]) - 1.0 <= high).all()


def test_the_new_end_is_as_the_one_with_its_fate(names: dict[str, Any]) -> None:
    hall, door = names["hall"], names["leaving"]
    grid = sdhj.Grid(hall.grid.lower, hall.grid.upper, hall.grid.shape, ends=[("wall", "safe"), "wall"])
    safe = sdhj.solve(dataclasses.replace(hall, grid=grid), play=False)
    np.testing.assert_array_equal(door.tubes, safe.tubes)
    np.testing.assert_array_equal(door.marks, safe.marks)
    past = np.array([[2.5, 0.0], [-2.5, 0.0]])
    assert hall.grid.beyond(past, "frees").tolist() == [True, False] and hall.grid.clipped(past)[1].tolist() == [-2, 0]
    shut = dataclasses.replace(hall.grid, ends=[("wall", "unsafe"), "wall"])
    closed = sdhj.solve(dataclasses.replace(hall, grid=shut), play=False)
    assert closed.tubes.mean() > door.tubes.mean()  # what is past the end is unsafe


def test_the_wind_blows_as_hard_as_it_may(names: dict[str, Any]) -> None:
    assert sum(names["report"].counts.values()) == 200
    problem, controller = names["problem"], names["controller"]
    inside = problem.grid.points()[controller.table.values(start=0, within=8).ravel() < -0.2]
    trajectory = sdhj.simulate(controller, inside[0], adversary=names["west_wind"], seed=0)
    assert len(trajectory.disturbances) > 1
    assert (trajectory.disturbances == [0.2, 0.0]).all()


def test_the_method_agrees_with_the_exact_one(names: dict[str, Any]) -> None:
    """Corners and samples see less than the Hopf-Lax formula does, so their tubes hold as much and a little more."""
    corners, exact = (
        names["corners"],
        sdhj.solve(names["problem"], sdhj.HopfLax(interpolation="linear"), progress=False),
    )
    assert corners.method == "corners"
    for within in range(9):
        mine, theirs = (table.fraction(start=0, within=within) for table in (corners, exact))
        assert theirs <= mine <= theirs + 0.005
    assert corners.fraction(start=0, within=8) > 2 * corners.fraction(start=0, within=0)
    assert sdhj.monte_carlo(sdhj.Controller(corners), runs=100, adversary="random", seed=0, progress=False)


@pytest.mark.slow  # another package, so everything is compiled anew
def test_the_numerical_hamiltonian_lies_between_the_two_that_are_there(tmp_path: Path) -> None:
    """In a copy of the package: dissipation grows from Godunov's flux over the local one to Lax-Friedrichs."""
    package = shutil.copytree(ROOT / "sdhj", tmp_path / "sdhj", ignore=shutil.ignore_patterns("__pycache__"))
    source = (package / "kernels" / "stages.py").read_text(encoding="utf-8")
    above, below = source.split("\n_differences, _hamiltonian", 1)
    added = f"{above}\n{block('sdhj/kernels/stages.py')}\n_differences, _hamiltonian{below}"
    (package / "kernels" / "stages.py").write_text(added, encoding="utf-8")
    code = INLINE[0].replace("table = sdhj.solve(problem)", "") + (
        "for flux in ('lax-friedrichs', 'local-lax-friedrichs', 'godunov'):\n"
        "    scheme = sdhj.Scheme(flux=flux, frame='fixed', order=1)\n"
        "    print(sdhj.solve(problem, sdhj.HJI(scheme=scheme), progress=False).fraction(start=0, within=8))\n"
    )
    out = run(["-c", code], tmp_path, PYTHONPATH=str(tmp_path), NUMBA_CACHE_DIR=str(tmp_path / "cache"))
    most, local, least = map(float, out.split())
    assert 0.0 < most < local <= least


@pytest.mark.slow
def test_the_figure_is_drawn(tmp_path: Path) -> None:
    folder = shutil.copytree(
        ROOT / "figures", tmp_path / "figures", ignore=shutil.ignore_patterns("__pycache__", "gallery")
    )
    (folder / "extra_widest.py").write_text(block("figures/extra_widest.py"), encoding="utf-8")
    run(["figures/extra_widest.py", "--nodes", "9", "--out", "out"], tmp_path)
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"extra_widest.pdf", "extra_widest.png"}
    assert "beside the target" in run(["figures/extra_widest.py", "--help"], tmp_path)


@pytest.mark.slow
def test_the_chapter_is_executed(tmp_path: Path) -> None:
    (tmp_path / ".ci").mkdir()
    (tmp_path / "notebooks").mkdir()
    shutil.copy(ROOT / ".ci" / "notebooks.py", tmp_path / ".ci")
    (command,) = re.findall(r"^<!-- chapter -->\n```bash\npython (.*)\n```$", TEXT, re.MULTILINE)
    chapter = tmp_path / "notebooks" / command.split()[-1]
    new = nbformat.v4
    nbformat.write(
        new.new_notebook(cells=[new.new_code_cell("def twice(x):\n    return 2 * x\n\n\nprint(twice(21))")]), chapter
    )
    run(command.split(), tmp_path)
    assert nbformat.read(chapter, as_version=4).cells[0].outputs[0].text == "42\n"
    run([command.split()[0], "check"], tmp_path)


def test_the_tests_that_ci_names_are_there() -> None:
    """A file or a test that was renamed makes pytest run none at all."""
    asked = re.findall(r"\btests/[\w/]+(?:\.py(?:::\w+)?)?", (ROOT / ".ci" / "run").read_text(encoding="utf-8"))
    assert len(asked) > 10
    for path, _, name in (each.partition("::") for each in asked):
        assert (ROOT / path).exists(), path
        assert not name or f"def {name}(" in (ROOT / path).read_text(encoding="utf-8"), name
