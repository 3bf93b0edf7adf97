"""Robots of one's own: played by the judge, checked by other code, and faults planted in their files.

`SDHJ_ROBOTS=50 pytest -m slow tests/certified/test_any_robot.py` does so with fifty random ones (20 minutes).
"""

import os
import re
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import zoo
from click.testing import CliRunner

import sdhj
from sdhj.certified.check import verify
from sdhj.cli import main

CELLS = {2: (50, 50), 3: (24, 24, 24)}
GROWING = (1, 10)  # seeds of robots whose certified sets grow
SEEDS = range(int(os.environ.get("SDHJ_ROBOTS", "0"))) or GROWING


def play_and_check(seed, tmp_path, runs):
    robot = zoo.random_robot(seed)
    problem = robot.problem()
    table = sdhj.solve(problem, sdhj.Certified(cells=CELLS[robot.grid.ndim], parts=4), progress=False)
    if table.fraction(start=0, within=robot.steps) == 0.0:
        return False
    for adversary in zoo.ADVERSARIES:
        outcomes = robot.outcomes(table, adversary, np.random.default_rng(seed), runs)
        assert set(outcomes) == {"reached"}, (seed, adversary)
    table.save(tmp_path / "robot.npz")
    assert (verdict := verify(tmp_path / "robot.npz", samples=300, progress=False)).ok, f"{seed}: {verdict}"
    return table.fraction(start=0, within=robot.steps) > 1.1 * table.fraction(start=0, within=0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_random_robots_lose_no_run(seed, tmp_path):
    assert play_and_check(seed, tmp_path, 4000) or seed not in GROWING


@pytest.mark.slow
def test_a_hill_pushes_outward_from_its_top(tmp_path):
    """A direction is divided by a length that is 0 at the top; the proof needs its bounds there, too."""

    def drift(q, u):
        r = np.linalg.norm(q, axis=1)[:, None]
        return np.where(r > 0, 0.3 * q / r, 0.0) + u

    problem = zoo.plane(
        grid=sdhj.Grid([-2.0, -2.0], [2.0, 2.0], [21, 21]),
        dynamics=sdhj.Dynamics(zoo.STEPS, drift, np.eye(2), [0.05, 0.05]),
        target=zoo.goal(1.2, 0.0, 0.5),
        steps=6,
    )
    table = sdhj.solve(problem, sdhj.Certified(cells=[32, 32]), progress=False, play=False)
    assert table.contains([[0.6, 0.0]], start=0) and not table.contains([[-1.8, 0.0]], start=0)
    table.save(tmp_path / "hill.npz")
    assert (verdict := verify(tmp_path / "hill.npz", progress=False)).ok, str(verdict)
    report = sdhj.monte_carlo(sdhj.Controller(table), 500, "worst", seed=0, progress=False)
    assert report.counts["reached"] == 500


def test_the_command_checks_a_robot_of_ones_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setitem(
        sys.modules, "lines", SimpleNamespace(problem=hidden, number=lambda: 3, broken=lambda: 1 / 0, far=far)
    )

    def asked(path, *options):
        return CliRunner().invoke(main, ["verify", str(path), "--samples", "300", *options])

    path = tmp_path / "line.npz"
    sdhj.solve(zoo.interval_problem(), sdhj.Certified(cells=[80]), progress=False).save(path)
    done = asked(path)
    assert done.exit_code == 0 and "moves: " in done.output and "NOT proved" not in done.output, done.output
    of_all = [line for line in done.output.splitlines() if line.endswith("proved")]
    assert all(re.search(r": ([\d,]+) of \1 checked", line) for line in of_all)  # of a sample that is not said
    sdhj.solve(hidden(), sdhj.Certified(cells=[80]), progress=False).save(path)
    done = asked(path, "--problem", "lines:problem")
    assert done.exit_code == 0 and "is stated of wall" in done.output, done.output
    for wrong, told in {
        "lines": "file.py:name",
        "nowhere:problem": "failed with ModuleNotFoundError",
        "lines:none": "failed with AttributeError",
        "lines:broken": "failed with ZeroDivisionError",
        "lines:number": "a ReachAvoidProblem",
        "lines:far": "another problem",
    }.items():
        done = asked(path, "--problem", wrong)
        assert done.exit_code == 2 and told in done.output and "Traceback" not in done.output, done.output
    done = asked(path)
    assert done.exit_code == 2 and "--problem module:function" in done.output


def test_a_velocity_that_is_undefined_somewhere_is_named_with_its_place():
    """Towards the origin at 1 m/s: divided by a distance that is 0 there, or by one that is not."""

    def problem(least):
        def drift(q, u):
            return u[0] * q / np.maximum(np.hypot(q[:, 0], q[:, 1]), least)[:, None]

        return zoo.plane(
            grid=sdhj.Grid([-1.0, -1.0], [1.0, 1.0], [10, 10]),
            dynamics=sdhj.Dynamics([[-1.0], [0.0]], drift),
            target=zoo.goal(0.0, 0.0, 0.5),
            delta=0.1,
            steps=2,
        )

    with pytest.raises(ValueError, match=r"between \[-0\.\d+, -0\.\d+\] and"):
        sdhj.solve(problem(0.0), sdhj.Certified(cells=[15, 15]), progress=False)
    assert sdhj.solve(problem(0.05), sdhj.Certified(cells=[15, 15]), progress=False).fraction(start=0) > 0.0


def far():
    """Another wall, of which all that is claimed of the other one is true."""
    box = sdhj.BlackBox(lambda p, t: 4.0 - p[:, 0], slope=1.0, rate=0.0)
    return replace(hidden(), unsafe=(sdhj.UnsafeSet((0,), box, name="wall"),))


def hidden(**declared):
    """A wall that nobody can look into: its author states how steep it is."""
    problem = zoo.interval_problem(steps=2)
    wall = sdhj.BlackBox(lambda p, t: [3.0 - float(x) for (x,) in p], **({"slope": 1.0, "rate": 0.0} | declared))
    return replace(problem, unsafe=(sdhj.UnsafeSet((0,), wall, name="wall"),))


def test_a_black_box_may_have_an_enclosure(tmp_path):
    def declared(low, high, t0, t1):
        return 3.0 - high[:, 0], 3.0 - low[:, 0]

    path = tmp_path / "line.npz"
    given = hidden(enclosure=declared, slope=None)
    sdhj.solve(given, sdhj.Certified(cells=[80]), progress=False).save(path)
    verdict = verify(path, given, progress=False)
    assert verdict.ok and "is stated of wall" in str(verdict)
