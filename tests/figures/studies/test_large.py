"""Five and six dimensions: the judge's robots are those of the problems, and tables keep what they promise."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from fleet import CATCH, REACH, TIP, TIP_RADIUS, ArmPursued
from large import WORKED, judged, main, promised, row

import sdhj


@pytest.mark.parametrize("name", WORKED)
def test_the_judge_plays_the_robot_of_the_problem(name: str, rng: np.random.Generator) -> None:
    """Velocities, the target and what is lost, at random states away from the walls (distances of arms: below)."""
    robot = WORKED[name]
    problem = robot.problem(9)
    dynamics, grid = problem.dynamics, problem.grid
    q = 0.9 * rng.uniform(grid.lower, grid.upper, (200, grid.ndim))
    signs = rng.choice([-1.0, 1.0], (200, dynamics.disturbance_dim))
    for j, u in enumerate(problem.inputs):
        own = robot.velocity(q, np.tile(u, (200, 1)), signs, 0.0)
        gain = np.broadcast_to(dynamics.gain_at(q, j, 0.0), (200, grid.ndim, dynamics.disturbance_dim))
        pushed = np.einsum("mad,md->ma", gain, signs * dynamics.bounds_at(j, 0.0))
        np.testing.assert_allclose(own, dynamics.drift_at(q, j, 0.0) + pushed, atol=1e-12)
    for t in (0.0, 0.7):
        inside = robot.target(q, t) <= 0
        np.testing.assert_array_equal(inside, problem.target_value(q, t) <= 0)
        np.testing.assert_array_equal(robot.unsafe(q, t) <= 0, problem.unsafe_value(q, t) <= 0)
    assert inside.any()


def test_the_arm_is_as_far_away_as_the_nearest_of_many_points_of_its_links(rng: np.random.Generator) -> None:
    q = rng.uniform(-3, 3, (300, 3))
    x, y = rng.uniform(-0.36, 0.36, (2, 300))
    arm = ArmPursued(3, 1)
    ends = np.array(arm.joints(q))
    shares = np.linspace(0, 1, 201)[:, None, None, None]
    points = (1 - shares) * ends[:-1] + shares * ends[1:]
    nearest = np.hypot(points[..., 0, :] - x, points[..., 1, :] - y).min(axis=(0, 1))
    found = arm.clear_of(q, x, y)
    assert (found <= nearest + 1e-12).all() and (found >= nearest - REACH / 1200).all() and CATCH < found.max()


def test_the_tip_of_the_arm_is_where_its_links_end(rng: np.random.Generator) -> None:
    q = rng.uniform(-3, 3, (300, 5))
    tip = REACH / 3 * np.exp(1j * np.cumsum(q[:, :3], axis=1)).sum(axis=1)
    np.testing.assert_allclose(ArmPursued(3, 1).target(q, 0.0), abs(tip - complex(*TIP)) - TIP_RADIUS, atol=1e-14)


@pytest.mark.slow
def test_a_row_prints_the_cells_that_there_are() -> None:
    """An interval turns the car by .6 rad: of 24 cells along its heading that are asked for there are 21 of .3 rad."""
    table = sdhj.solve(WORKED["car"].problem(9), sdhj.Certified(cells=(8, 8, 24, 2, 2)), progress=False, play=False)
    assert row("car", table, 1.0, 0, 0).split(" | ")[1:3] == ["certified", "8 x 8 x 21 x 2 x 2"]


@pytest.mark.slow
def test_in_five_dimensions_sets_grow_past_the_target_and_none_is_lost() -> None:
    robot: Any = WORKED["car"]
    table = sdhj.solve(robot.problem(9), sdhj.Certified(cells=(24, 24, 18, 10, 10)), progress=False)
    shares = [table.fraction(start=0, within=n) for n in range(5)]
    assert min(np.diff(shares)) > 0 and shares[-1] > 1.4 * shares[0]
    starts = promised(table, 2000, 0)
    assert judged(robot, table, starts) == {"reached": 2000}


@pytest.mark.slow
def test_the_table_and_the_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(WORKED, "arm", dataclasses.replace(WORKED["arm"], cells=()))  # a minute and a half of work
    picture = tmp_path / "large.png"
    arguments = ["--robot", "arm", "--nodes", "9", "--runs", "300", "-o", str(picture), "--store", str(tmp_path)]
    done = CliRunner().invoke(main, arguments)
    assert done.exit_code == 0, done.output
    rows = [line.split(" | ") for line in done.output.splitlines() if line.startswith("| arm")]
    full, inner = (float(row[4]) for row in rows)
    assert 0.3 < inner < full < 0.9 and [row[5] for row in rows] == ["300", "300"]
    assert picture.read_bytes().startswith(b"\x89PNG") and (tmp_path / "arm").is_dir()
