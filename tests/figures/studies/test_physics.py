"""MuJoCo as a second judge: its distances and contacts against our geometry, and runs that it plays itself."""

import importlib.util
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import zoo
from click.testing import CliRunner

import sdhj
from sdhj.arm.case_studies import OBSTACLES
from sdhj.arm.workspace import Circle, Disk, Line, Still
from sdhj.simulation.runs import SUBSTEPS, admissible_states, simulate
from sdhj.table.controller import Controller

if importlib.util.find_spec("mujoco") is None:
    pytest.skip("MuJoCo is not installed: pip install 'sdhj[physics]'", allow_module_level=True)

import physics
from physics import World, check_runs, frames, mjcf, replay

FIGURES = Path(physics.__file__).parent
# Both sides are closed forms in float64 on lengths below 1 m: a few dozen roundings of 1e-16 each; measured 3e-16.
ROUNDING = 1e-14
DRIFT = 1e-12  # MuJoCo adds 800 moves of a run, we add 160: as many roundings of 1e-16, of angles up to 4 rad


@cache
def table() -> sdhj.LookupTable:
    return sdhj.solve(sdhj.arm_case_study(nodes=9, steps=3), progress=False)


@cache
def certified_table() -> sdhj.LookupTable:
    problem = sdhj.arm_case_study(nodes=9, steps=3)
    return sdhj.solve(problem, sdhj.Certified(cells=(105, 105, 36, 36)), progress=False)


def longest_run() -> tuple[sdhj.ReachAvoidProblem, object]:
    controller = Controller(table())
    starts = admissible_states(controller, 60, np.random.default_rng(3))
    return table().problem, max((simulate(controller, q, "none") for q in starts), key=lambda run: len(run.times))


OTHER_ARM = {"lengths": (0.2, 0.1), "half_width": 0.02, "obstacles": [Disk(Line((0.1, 0.2), (0.0, 0.0)), 0.03)]}
PROBLEMS = {  # made by the test: nothing is compiled while tests are collected
    "standard": lambda: sdhj.arm_case_study(nodes=9),
    "printed": lambda: sdhj.arm_case_study(nodes=9, kinematics="printed"),
    "other arm": lambda: sdhj.arm_case_study(nodes=9, **OTHER_ARM),
    "pursuer alone": lambda: sdhj.arm_case_study(nodes=9, obstacles=[]),
    "evader": lambda: sdhj.evader_case_study(nodes=9, obstacles=[Disk(Circle((0.1, 0.1), 0.1, -3.0, 0.5), 0.05)]),
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_distances_are_ours(name, rng) -> None:
    """On random states at random times, deep inside obstacles and far from them; contacts are where the distance
    is not positive."""
    problem = PROBLEMS[name]()
    world = World(problem)
    states = rng.uniform(problem.grid.lower, problem.grid.upper, (200, 4))
    touched = 0
    for state, t in zip(states, rng.uniform(0.0, 0.8, 200), strict=True):
        world.place(state, t)
        ours = problem.unsafe_value(state[None], t)[0]
        assert world.distance() == pytest.approx(ours, abs=ROUNDING)
        assert world.touched() == (ours <= 0) or abs(ours) < ROUNDING
        np.testing.assert_allclose(world.state, state, rtol=0, atol=ROUNDING)
        touched += world.touched()
    assert 8 < touched < 192


@pytest.mark.slow
def test_mujoco_moves_as_we_do() -> None:
    controller = Controller(table())
    for adversary, start in (("aggressive", 0), ("worst", 1), ("random", 2)):
        starts = admissible_states(controller, 40, np.random.default_rng(start))
        runs = [simulate(controller, q, adversary, seed=start) for q in starts]
        run = max(runs, key=lambda run: len(run.times))
        seen = replay(World(controller.problem), run, finer=3)
        assert len(run.inputs) >= 2 and len(seen.times) == 3 * (len(run.times) - 1) + 1
        assert seen.drift < DRIFT and seen.difference < DRIFT
        np.testing.assert_allclose(seen.times[::3], run.times, rtol=0, atol=DRIFT)


def test_the_pursuer_stops_at_the_wall() -> None:
    world = World(sdhj.arm_case_study(nodes=9))
    world.place(np.array([0.0, 1.0, 0.35, -0.355]), 0.0)
    world.move(np.array([1.0, -2.0, 0.2, -0.2]), 0.1)
    np.testing.assert_allclose(world.state, [0.1, 0.8, 0.36, -0.36], rtol=0, atol=ROUNDING)


@pytest.mark.slow
def test_a_planted_collision_is_seen() -> None:
    """The table does not know of a disk in the way of the tip; MuJoCo does."""
    _, run = longest_run()
    middle = run.states[SUBSTEPS]
    tip = World(sdhj.arm_case_study(nodes=9)).given["lengths"][0] * np.array(
        [np.cos(middle[0]) + np.cos(middle[:2].sum()), np.sin(middle[0]) + np.sin(middle[:2].sum())]
    )
    planted = sdhj.arm_case_study(nodes=9, steps=3, obstacles=[*OBSTACLES, Disk(Still(tuple(tip)), 0.005)])
    assert not replay(World(table().problem), run).touched.any()
    seen = replay(World(planted), run)
    assert seen.touched[SUBSTEPS * 5] and not seen.touched.all()
    np.testing.assert_array_equal(seen.touched, seen.distances <= 0)
    ours = [planted.unsafe_value(q[None], t)[0] for q, t in zip(run.states, run.times, strict=True)]
    assert seen.distances.min() == pytest.approx(min(ours), abs=0.005)  # the tip passes 3.3 rad/s * 0.3 m * 5 ms
    blind = Controller(table())
    blind.problem = planted  # the plant's alone
    report = check_runs(blind, 30, "none", progress=False)
    assert report.touched >= report.collided > 0 and report.disagree == report.touched - report.collided
    assert report.closest < 0


@pytest.mark.slow
def test_runs_of_a_certified_table_touch_nothing() -> None:
    for adversary in ("aggressive", "worst"):
        report = check_runs(Controller(certified_table()), 40, adversary, seed=1, progress=False)
        assert report.touched == report.collided == report.disagree == 0
        assert report.closest > 0 and report.instants > 40 * 100
        assert report.difference < DRIFT and report.drift < DRIFT
        assert f"contacts in MuJoCo: 0 runs, looked at {report.instants} instants" in str(report)


def test_what_cannot_be_modelled_is_refused() -> None:
    with pytest.raises(ValueError, match="no case study"):
        mjcf(zoo.torus_problem())
    with pytest.raises(ValueError, match=r"link1 has 0\.0"):
        mjcf(sdhj.arm_case_study(nodes=9, half_width=0.0))
    with pytest.raises(ValueError, match="finer "):
        check_runs(Controller(table()), 5, finer=0)


@pytest.mark.slow
def test_pictures_and_the_command_line(tmp_path) -> None:
    problem, run = longest_run()
    try:
        pictures = frames(World(problem), run, count=3, size=120)
    except ValueError as error:
        pytest.skip(str(error))
    assert [t for t, _ in pictures] == pytest.approx([0.0, run.times[len(run.times) // 2], run.times[-1]])
    for _, image in pictures:
        assert image.shape == (120, 120, 3)
        red, green, blue = (image[..., c].astype(int) for c in range(3))
        assert (red > green + 60).sum() > 100 and (blue > red + 60).sum() > 50  # obstacles and arm
    assert (pictures[0][1] != pictures[2][1]).mean() > 0.01
    certified_table().save(tmp_path / "proved.npz")
    arguments = [str(tmp_path / "proved.npz"), "--runs", "5", "-o", str(tmp_path / "strip.png")]
    done = CliRunner().invoke(physics.main, arguments)
    assert done.exit_code == 0, done.output
    assert "contacts in MuJoCo: 0" in done.output and (tmp_path / "strip.png").stat().st_size > 20_000


@pytest.mark.slow
@pytest.mark.parametrize("script", ["physics", "experiment"])
def test_without_mujoco_one_line_says_what_to_install(script) -> None:
    code = f"import sys; sys.modules['mujoco'] = None; from {script} import main; main(['any.npz'])"
    done = subprocess.run([sys.executable, "-c", code], cwd=FIGURES, capture_output=True, text=True)
    assert done.returncode == 2 and "sdhj[physics]" in done.stderr and "Traceback" not in done.stderr


def test_pictures_of_a_run_are_png_files(tmp_path) -> None:
    done = CliRunner().invoke(physics.main, [str(tmp_path / "missing.npz"), "-o", str(tmp_path / "x.txt")])
    assert done.exit_code == 2 and "x.txt must end in" in done.output
