"""The game on a card, which Numba simulates, beside the library's."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import sdhj
from sdhj.arm.case_studies import arm_case_study
from sdhj.arm.workspace import Disk, Line, Still
from sdhj.problem.problem import ReachAvoidProblem

SIMULATED = """
import sys
import numpy as np
import gpu
from test_gpu import problem

game = gpu.Game(problem())
assert game.time_steps > 1
game.sample()
game.upload()
game.play()
rows = range(game.steps)
np.savez(sys.argv[1], *(game.tubes[k].copy_to_host() for k in rows), *(game.marks(k).copy_to_host() for k in rows))
"""


def problem() -> ReachAvoidProblem:
    """A game of the arm for a few hundred nodes, in which both players count."""
    target, obstacle = Disk(Still((0.15, 0.1)), 0.15), Disk(Line((0.24, -0.02), (-0.1, 0.12)), 0.07)
    return arm_case_study(
        (6, 6, 5, 5), steps=2, input_levels=2, delta=0.2, v_d_max=0.8, target=target, obstacles=[obstacle]
    )


@pytest.mark.slow
def test_card_and_processor_agree_to_the_last_bit(tmp_path: Path) -> None:
    """Every number of every tube, and every mark: without fused operations both compute the same."""
    path, root = tmp_path / "found.npz", Path(__file__).parents[3]
    env = os.environ | {"NUMBA_ENABLE_CUDASIM": "1", "NUMBA_DISABLE_JIT": "1"}
    env["PYTHONPATH"] = os.pathsep.join(
        str(folder) for folder in (root, root / "figures" / "studies", Path(__file__).parent)
    )
    subprocess.run([sys.executable, "-W", "ignore", "-c", SIMULATED, path], env=env, check=True)
    table, steps = sdhj.solve(problem(), progress=False, play=False), 2
    with np.load(path) as found:
        tubes, marks = [found[f"arr_{k}"] for k in range(steps)], [found[f"arr_{steps + k}"] for k in range(steps)]
    for step in range(steps):
        for within, tube in enumerate(tubes[step].reshape(-1, *table.grid.shape)[1:], 1):
            np.testing.assert_array_equal(tube, table.value_array(step, within))
            np.testing.assert_array_equal(marks[step][within - 1], table.mark_array(step, within))
    assert 0.05 < np.mean(marks[0][-1] > 0) < 0.8
