"""Any robot from the command line: from `sdhj new` to the folder of an export, and what is said where it goes wrong."""

import re
import shutil
import subprocess
import warnings
from pathlib import Path

import numpy as np
import pytest
import zoo
from click.testing import CliRunner

import sdhj
from sdhj.cli import main

ON_ROBOT = Path(__file__).parents[1] / "figures" / "on_robot"


def run(*arguments):
    return CliRunner().invoke(main, [str(a) for a in arguments])


def fine(*arguments):
    result = run(*arguments)
    assert result.exit_code == 0, result.output
    return result.output


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a new robot, its certified table and one on a grid, and nothing else that commands could need."""
    folder = tmp_path_factory.mktemp("robot")
    fine("new", folder / "car.py")
    options = "--method", "certified", "--cells", "30,30,32", "-o", folder / "car.npz"
    assert "target reachable from" in fine("solve", f"{folder / 'car.py'}:problem", *options)
    (folder / "car.py").rename(folder / "away.txt")
    sdhj.solve(zoo.unicycle_problem(steps=1), progress=False, play=False).save(folder / "grid.npz")
    return folder


@pytest.mark.slow
def test_after_solve_nothing_needs_the_module(folder):
    table = sdhj.load(folder / "car.npz")
    start = table.centres(np.argwhere(table.bits(start=0, within=4))[:1])[0]
    state = ",".join(map(str, start))
    assert "x: 41 nodes" in fine("info", folder / "car.npz")
    assert "Certified for step 0" in fine("explain", folder / "car.npz", "--", state)
    assert "not certified" in fine("explain", folder / "car.npz", "--", "-1,0,0")
    said = fine("simulate", folder / "car.npz", f"--start={state}")
    assert re.search(r"0\.000 s .* input \d: \(.+, .+\)", said) and "outcome: reached" in said
    assert "reached" in fine("simulate", folder / "car.npz", "--runs", 20)
    for name, options in (("slice.svg", ["--at", "theta=0.5", "--axes", "y,x"]), ("run.png", [f"--start={state}"])):
        fine("plot", folder / "car.npz", "-o", folder / name, *options)
        assert (folder / name).stat().st_size > 5000
    assert "one step nearer" in fine("verify", folder / "car.npz")


@pytest.mark.slow
def test_export_and_its_proof(folder):
    said = fine("export", folder / "car.npz", "-o", folder / "out", "--check")
    assert "bytes of flash" in said and "exported: filter" in said and "NOT" not in said
    assert {one.name for one in (folder / "out").iterdir()} == {"sdhj_table.bin", "sdhj.h", "sdhj_robot.h"}
    assert "exported: safe" in fine("verify", folder / "out", "--table", folder / "car.npz")
    alone = run("verify", folder / "out")
    assert alone.exit_code == 2 and "--table table.npz" in alone.output
    small = fine("export", folder / "car.npz", "-o", folder / "small", "--only", "select")
    sizes = [int(re.search(r"([\d,]+) bytes", text)[1].replace(",", "")) for text in (said, small)]
    assert sizes[1] < sizes[0] / 2


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["export", "{grid}", "-o", "out"], 'method="certified"'),
        (["export", "{car}", "-o", "out", "--only", "speed"], "only "),
        (["explain", "{car}", "0,0"], "3"),
        (["plot", "{car}", "-o", "x.pdf"], ".png or .svg"),
        (["plot", "{car}", "-o", "x.png", "--axes", "x,z"], "the axes are x, y, theta"),
        (["plot", "{car}", "-o", "x.png", "--at", "theta"], "--at must be numbers"),
        (["solve", "{robot}:problem", "--nodes", "9", "-o", "x.npz"], "--nodes is of the arm"),
        (["solve", "{robot}:problem"], "give -o"),
        (["solve", "{robot}:problems", "-o", "x.npz"], "there is no problems in it"),
        (["solve", "{robot}", "-o", "x.npz"], "file.py:name"),
        (["solve", "{robot}:inputs", "-o", "x.npz"], "failed"),
        (["solve", "{robot}:problem", "--method", "hji", "--seconds", "3", "-o", "x.npz"], "--seconds"),
        (["new", "{robot}"], "exists"),
        (["new", "robot.txt"], "Python file"),
    ],
)
def test_what_is_wrong_is_one_line(folder, tmp_path, monkeypatch, arguments, named):
    monkeypatch.chdir(tmp_path)
    shutil.copy(folder / "away.txt", tmp_path / "car.py")
    names = {"grid": folder / "grid.npz", "car": folder / "car.npz", "robot": tmp_path / "car.py"}
    result = run(*(one.format(**names) for one in arguments))
    assert result.exit_code == 2 and named in result.output and "Traceback" not in result.output
    assert len([line for line in result.output.splitlines() if line.startswith("Error")]) == 1
    assert not {one.name for one in tmp_path.iterdir()} & {"x.npz", "x.png", "x.pdf", "out", "robot.txt"}


# ---- five ways to break the new robot, of which each is one line

GOAL = "np.hypot(p[:, 0] - 1.2, p[:, 1] - 0.8)"
BROKEN = {
    "a typing error": ("u[0] * np.cos(q[:, 2])", "u[0] * np.cosine(q[:, 2])", r"cosine.*\(line \d+ of "),
    "the wrong shape": (", np.full(len(q), u[1])], axis=1)", "], axis=1)", r"drift.*shape"),
    "a missing periodic": ("    periodic=[False, False, True],\n", "", r"theta is a whole turn.*give periodic="),
    "the wrong sign": (f"{GOAL} - 0.4", f"0.4 - {GOAL}", r"the target .* turn the sign"),
}


@pytest.mark.slow
@pytest.mark.parametrize("what", BROKEN)
def test_a_robot_that_is_broken_is_told_so_in_a_line(folder, tmp_path, what):
    old, new, sentence = BROKEN[what]
    text = (folder / "away.txt").read_text()
    assert text.count(old) == 1
    (tmp_path / "car.py").write_text(text.replace(old, new).replace("[41, 41, 32]", "[11, 11, 8]"))
    with warnings.catch_warnings(record=True) as told:  # on a terminal: lines that begin with "Warning"
        warnings.simplefilter("always")
        result = run("solve", f"{tmp_path / 'car.py'}:problem", "-o", tmp_path / "car.npz")
    lines = [*result.output.splitlines(), *(str(one.message) for one in told)]
    assert sum(bool(re.search(sentence, line)) for line in lines) == 1 and "Traceback" not in result.output, lines


def test_advice_about_a_missing_periodic_works(folder, tmp_path):
    (tmp_path / "car.py").write_text((folder / "away.txt").read_text().replace("[41, 41, 32]", "[11, 11, 8]"))
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        fine("solve", f"{tmp_path / 'car.py'}:problem", "-o", tmp_path / "car.npz")
    assert not any("whole turn" in str(one.message) for one in told)


def test_a_problem_in_a_module(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = (folder / "away.txt").read_text().replace("[41, 41, 32]", "[11, 11, 8]")
    (tmp_path / "robot_of_a_test.py").write_text(text + "\n\nmade = problem()\n")
    assert "solved in" in fine("solve", "robot_of_a_test:made", "-o", "car.npz")


@pytest.mark.slow
@pytest.mark.skipif(not (shutil.which("gcc") and shutil.which("make")), reason="there is no gcc, or no make")
def test_no_run_of_the_example_is_lost(tmp_path):
    import sys

    for file in ("Makefile", "loop.c", "judge.py"):
        shutil.copy(ON_ROBOT / file, tmp_path)
    done = subprocess.run(["make", "run", f"PYTHON={sys.executable}"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0 and "1000 reached of 1000" in done.stdout, done.stdout + done.stderr
