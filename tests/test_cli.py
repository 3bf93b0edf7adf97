"""The command line: each command on a small grid, and one clear line for everything that is wrong."""

import dataclasses
import json
import os
import re
import shlex
import subprocess
import sys

import numpy as np
import pytest
from click.testing import CliRunner
from zoo import torus_problem, unicycle_problem

import sdhj
from sdhj.cli import METHODS, WARM_CELLS, main, new_robot


def run(*arguments):
    return CliRunner().invoke(main, [str(a) for a in arguments])


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    path = tmp_path_factory.mktemp("tables") / "arm.npz"
    result = run("solve", "--nodes", 9, "--steps", 3, "-o", path)
    assert result.exit_code == 0, result.output
    assert re.search(r"\d+\.\d% of C", result.output)
    return path


def test_solve_writes_a_table_that_loads(saved):
    table = sdhj.load(saved)
    assert table.method == "hji" and table.grid.shape == (9,) * 4 and table.steps == 3


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*is certified")  # few cells: next to nothing is
def test_cells_go_with_the_certified_method(tmp_path):
    path = tmp_path / "certified.npz"
    options = ["--nodes", 9, "--steps", 1, "-o", path]
    result = run("solve", *options, "--method", "certified", "--cells", "42,42,12,12")
    assert result.exit_code == 0, result.output
    assert sdhj.load(path).details["cells"] == [42, 42, 12, 12]
    for wrong in (["--method", "hji", "--cells", "42,42,12,12"], ["--cells", "many"]):
        refused = run("solve", *options, *wrong)
        assert refused.exit_code == 2 and "cells" in refused.output and "Traceback" not in refused.output
    assert run("solve", *options, "--cells", "42,42,12,12").exit_code == 0
    assert sdhj.load(path).method == "certified"  # which --cells means


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["solve", "--nodes", 3, "-o", "x.npz"], "shape"),
        (["solve", "--method", "magic", "-o", "x.npz"], "magic"),
        (["solve", "--steps", 0, "-o", "x.npz"], "steps"),
        (["solve", "-o", "/nonexistent/folder/x.npz"], "folder"),
        (["solve", "-o", "."], "folder"),
        (["info", "missing.npz"], "missing.npz"),
        (["simulate", "missing.npz"], "missing.npz"),
        (["solve", "--nodes", "9" * 400, "-o", "x.npz"], "nodes"),
        (["solve", "--steps", "9" * 400, "-o", "x.npz"], "steps"),
        (["nonsense"], "nonsense"),
    ],
)
def test_what_is_wrong_is_one_line_and_status_2(arguments, named, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = run(*arguments)
    assert result.exit_code == 2
    assert named in result.output and "Traceback" not in result.output
    assert list(tmp_path.iterdir()) == []  # nothing half-written
    (line,) = [line for line in result.output.splitlines() if line.startswith("Error")]
    assert len(line) < 300


def test_options_that_do_not_go_together_are_refused(saved):
    """None of them is dropped without a word."""
    result = run("simulate", saved, "--start", "0,0,0.2,0.2", "--runs", 10)
    assert result.exit_code == 2 and "--start simulates one run" in result.output, result.output


def test_tubes_without_a_proof_are_not_verified(saved):
    result = run("verify", saved)
    assert result.exit_code == 2 and 'proof; solve(problem, "certified") makes' in result.output


def test_damaged_file_is_one_line(tmp_path):
    path = tmp_path / "broken.npz"
    path.write_bytes(b"\x89HDF\r\n\x1a\n then nothing")
    result = run("info", path)
    assert result.exit_code == 2 and "damaged" in result.output and "Traceback" not in result.output


def test_help_explains_each_command_in_a_line():
    result = run("--help")
    assert result.exit_code == 0
    for command in main.commands:
        (line,) = [line for line in result.output.splitlines() if line.strip().startswith(command + " ")]
        assert len(line.split()) > 4
        assert run(command, "--help").exit_code == 0


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    path = tmp_path_factory.mktemp("tables") / "own.npz"
    sdhj.solve(torus_problem(nodes=12, steps=2), progress=False).save(path)
    return path


def test_info_tells_what_is_in_a_file_and_needs_no_functions(own):
    """Dynamics and sets in mathematics."""
    result = run("info", own)
    assert result.exit_code == 0, result.output
    table, lines = sdhj.load(own, problem=torus_problem(nodes=12, steps=2)), result.output.splitlines()
    told = (
        "method hji",
        "x1: 12 nodes on [-3.14159, 3.14159], periodic",
        "2 steps of 0.2 s, 9 inputs",
        sdhj.__version__,
    )
    for text in (*told, table.problem.digest, json.dumps(dict(table.details), sort_keys=True)):
        assert text in result.output
    expected = """
  dynamics under the first of 9 inputs, u = (-2, -2):
    dx1/dt = -2 + v1
    dx2/dt = -2 + v2
    |v1| <= 0.4
    |v2| <= 0.4
  target 'target':
    hypot(mod(x1 + 1 - 0.2 t + 3.14159, 6.28319) - 3.14159, mod(x2 + 3.14159, 6.28319) - 3.14159) - 0.8 <= 0
  unsafe 'orbiting disk':
    hypot(mod(x1 - cos(2 t) + 3.14159, 6.28319) - 3.14159, mod(x2 - sin(2 t) + 3.14159, 6.28319) - 3.14159) - 0.5 <= 0
""".strip("\n").splitlines()
    first = lines.index(expected[0])
    assert lines[first:-1] == expected
    assert lines[-1].startswith("  share of C inside from step 0: 0: ")


def black_car():
    """A car whose speed is a black box, beside a post; the wind does not enter linearly."""
    problem = unicycle_problem(nodes=(9, 9, 8), steps=2)

    def speed(points, u, t):
        return np.stack([np.cos(points[:, 2]), np.sin(points[:, 2]), np.full(len(points), u[0])], axis=1)

    drift = sdhj.BlackBox(speed, reads=[2], slope=1.0, rate=0.0)
    gain = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]])
    (part,) = problem.unsafe
    dynamics = sdhj.Dynamics(problem.inputs, drift, gain, [0.1, 0.0])
    return dataclasses.replace(problem, dynamics=dynamics, unsafe=(dataclasses.replace(part, sampling="steep"),))


def test_info_says_which_black_boxes_there_are(tmp_path):
    path = tmp_path / "black.npz"
    sdhj.solve(black_car(), progress=False).save(path)
    result = run("info", path)
    assert result.exit_code == 0 and "share of C" not in result.output
    assert "  unsafe 'pillar', sampling steep:\n    hypot(x - 0.8, y) - 0.2 <= 0\n" in result.output
    assert (
        "load(path, problem=...) needs the problem:\n    drift: a BlackBox with reads, slope, rate\n" in result.output
    )
    assert "dx/dt" not in result.output
    refused = run("simulate", path)
    (line,) = refused.output.splitlines()
    assert refused.exit_code == 2 and "boxes (drift: a BlackBox" in line


@pytest.mark.slow
def test_info_says_what_a_promise_rests_on(tmp_path):
    """Which ends count as what, how sets were sampled, what is sensed, that there is no target, and that it lasts."""
    own = unicycle_problem(nodes=(9, 9, 8), steps=1)
    ends, (post,) = ["unsafe", ["wall", "safe"], "unsafe"], own.unsafe
    grid = sdhj.Grid(own.grid.lower, own.grid.upper, own.grid.shape, own.grid.periodic, ends=ends)
    without_target = dataclasses.replace(
        own, grid=grid, target=None, steps=None, unsafe=(dataclasses.replace(post, sampling="cell"),)
    )
    sdhj.solve(without_target, sdhj.Certified(cells=(9, 9, 8)), progress=False, play=False).save(tmp_path / "stays.npz")
    shown = run("info", tmp_path / "stays.npz").output
    for text in (
        "  x1: 9 nodes on [-1.5, 1.5], bounded, unsafe ends\n",
        "  x2: 9 nodes on [-1.5, 1.5], bounded, wall and safe ends\n",
        " steps of 0.2 s (steps=None), 3 inputs",
        "  no target: the robot only has to stay clear\n  unsafe 'pillar', sampling cell:\n",
    ):
        assert text in shown, shown
    sensed = dataclasses.replace(own, sensing=sdhj.Sensing(error=0.01, delay=0.05, jitter=0.02, memory=False))
    sdhj.solve(sensed, progress=False).save(tmp_path / "sensed.npz")
    shown = run("info", tmp_path / "sensed.npz").output
    assert "  sensing: error 0.01, delay 0.05, jitter 0.02, rest 0\n" in shown and "bounded, wall ends" in shown, shown


def test_info_of_a_store_is_that_of_a_file(tmp_path):
    problem = torus_problem(nodes=12, steps=2)
    sdhj.solve(problem, progress=False, store=tmp_path / "own")
    sdhj.load(tmp_path / "own").save(tmp_path / "own.npz")
    of_store, of_file = (run("info", tmp_path / name).output.splitlines() for name in ("own", "own.npz"))
    assert of_store[0] == of_file[0].replace("own.npz", "own") and of_store[1:] == of_file[1:]


def test_who_stays_clear_reaches_nothing(tmp_path):
    own = unicycle_problem(nodes=(9, 9, 8), steps=1)
    sdhj.solve(dataclasses.replace(own, target=None), progress=False).save(tmp_path / "stays.npz")
    many = run("simulate", tmp_path / "stays.npz", "--runs", 5)
    one = run("simulate", tmp_path / "stays.npz", "--start", "-1,1,0")
    assert "\nstayed clear " in many.output and "1.00 steps on average" in many.output, many.output
    assert one.output.endswith("outcome: stayed clear\n") and "reached" not in many.output + one.output


def test_info_shows_a_disturbance_that_enters_as_it_likes(tmp_path):
    problem = unicycle_problem(nodes=(9, 9, 8), steps=1)

    def velocity(q, u, v):
        heading = q[:, 2] + v[0]
        return np.stack([np.cos(heading), np.sin(heading), np.full(len(q), u[0])], axis=1)

    own = dataclasses.replace(
        problem, unsafe=(), dynamics=sdhj.Dynamics(problem.inputs, velocity=velocity, bounds=[0.1])
    )
    sdhj.solve(own, progress=False).save(tmp_path / "own.npz")
    shown = run("info", tmp_path / "own.npz").output
    for text in ("dx/dt = cos(theta + v1)", "dy/dt = sin(theta + v1)", "dtheta/dt = -2", "|v1| <= 0.1"):
        assert f"    {text}\n" in shown, shown


def test_simulate_plays_your_robot(own, monkeypatch):
    many = run("simulate", own, "--runs", 20, "--adversary", "random")
    assert many.exit_code == 0 and "20 runs" in many.output
    one = run("simulate", own, "--start", "-1.0,0.1")
    assert one.exit_code == 0 and re.search(r"0\.000 s   -1\.0000   \+0\.1000\n", one.output), one.output
    for wrong, named in (
        ("", "numbers separated by commas, got ''"),
        ("north,0.0", "numbers separated by commas, got 'north,0.0'"),
        ("nan,0.0", "must be 2 finite numbers"),
        ("0.1,0.2,0.3", "must be 2 finite numbers"),
        ("1.0,0.0", "admissible"),  # in the disk
    ):
        refused = run("simulate", own, "--start", wrong)
        assert refused.exit_code == 2 and named in refused.output, refused.output


SOLVES = """
import sdhj
from sdhj.certified.check import verify
from sdhj.cli import new_robot
for problem, method in [
    (sdhj.arm_case_study(nodes=9, steps=3), "hji"),
    (sdhj.arm_case_study(nodes=9, steps=3), "projected"),
    (sdhj.arm_case_study(nodes=9, steps=3), "lax"),
    (sdhj.arm_case_study(nodes=9, steps=2), sdhj.Certified(cells=(60, 60, 17, 17))),
    (new_robot(), "hji"),
    (new_robot(), sdhj.Certified(cells=(40, 40, 24))),
]:
    table = sdhj.solve(problem, method, progress=False)
    sdhj.Controller(table).select(table.grid.points()[table.contains(table.grid.points())][0], 0)
    if table.proved:
        table.save("table.npz")
        assert verify("table.npz", samples=10, progress=False).ok
"""


@pytest.mark.slow
def test_warmup_leaves_nothing_to_compile(tmp_path):
    """Two processes find room beside each other in an empty cache, and what users solve then compiles nothing."""
    env = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "numba")}
    done = ran(f"{sys.executable} -m sdhj warmup", env=env)
    assert done.returncode == 0 and all(f" by {method}: " in done.stdout for method in METHODS), done.stderr
    compiled = set(tmp_path.rglob("*.code"))
    assert compiled
    done = ran(f"{sys.executable} -c '{SOLVES}'", env=env, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert set(tmp_path.rglob("*.code")) == compiled


@pytest.mark.slow
def test_what_warms_up_grows_tubes():
    """So that the kernels that join tubes are called."""
    table = sdhj.solve(new_robot(), sdhj.Certified(cells=WARM_CELLS["car"]), progress=False)
    assert table.fraction(start=0, within=0) < table.fraction(start=0, within=1) < table.fraction(start=0, within=2)


def ran(command, **options):
    return subprocess.run(["bash", "-c", command], capture_output=True, text=True, **options)


@pytest.mark.slow
def test_a_reader_that_has_seen_enough_ends_it_quietly(saved):
    done = ran(f"{sys.executable} -m sdhj info {saved} | true; exit ${{PIPESTATUS[0]}}")
    assert done.returncode in (0, 1) and done.stderr == ""  # 0 where all was written before the pipe was closed


@pytest.mark.slow
def test_without_standard_error_it_works_all_the_same(tmp_path):
    """As under pythonw, and for services that close it: Python's sys.stderr is None."""
    path = tmp_path / "table.npz"
    code = f"""
import sys, sdhj
from sdhj.cli import command
assert sys.stderr is None
sys.argv = ["sdhj", "solve", "--nodes", "7", "--steps", "1", "-o", {str(path)!r}]
try:
    command()
except SystemExit as ended:
    assert not ended.code
table = sdhj.load({str(path)!r})
sdhj.solve(table.problem, method="lax")
print(sdhj.monte_carlo(sdhj.Controller(table), runs=5).runs)
"""
    done = ran(f"{sys.executable} -c {shlex.quote(code)} 2>&-")
    assert done.returncode == 0 and "solved in" in done.stdout and done.stdout.endswith("\n5\n"), done.stdout


@pytest.mark.slow
@pytest.mark.parametrize(("option", "status"), [("--version", 1), ("--help", 1), ("info", 2)])
def test_a_full_disk_is_one_line(saved, option, status):
    done = ran(f"{sys.executable} -m sdhj {option} {saved if option == 'info' else ''} > /dev/full")
    assert done.returncode == status and done.stderr.startswith("Error: ") and done.stderr.count("\n") == 1


@pytest.mark.slow
def test_warnings_are_sentences_without_our_source(tmp_path):
    done = ran(f"{sys.executable} -m sdhj solve --nodes 7 --steps 1 -o {tmp_path / 'table.npz'}")
    told = [line for line in done.stderr.splitlines() if "the tube of" in line]
    assert len(told) == 1 and told[0].startswith("Warning: the tube of") and "cli.py" not in done.stderr
