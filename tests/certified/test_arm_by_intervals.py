"""The case study of the arm as anyone's robot: its level sets in plain NumPy, followed by intervals."""

import time

import numpy as np
import pytest
from plain_arm import plain_arm

import sdhj
from sdhj.arm.case_studies import scene


def test_it_is_the_case_study(rng):
    problem, plain = sdhj.arm_case_study(nodes=9), plain_arm(nodes=9)
    grid, stage = problem.grid, scene(problem)
    states = grid.lower + rng.random((5000, 4)) * (np.array(grid.upper) - grid.lower)
    for t in (0.0, 0.37):
        np.testing.assert_allclose(plain.target_value(states, t), stage.target_value(states[:, :2], t), atol=1e-12)
        np.testing.assert_allclose(plain.unsafe_value(states, t), problem.unsafe_value(states, t), atol=1e-12)


@pytest.mark.bench
@pytest.mark.parametrize("cells", [(42, 42, 12, 12), (84, 84, 36, 36)])
def test_intervals_beside_kernels(cells):
    """`pytest -m bench -s -n 0`: share of C, seconds of one core, megabytes; the finer one lasts minutes."""
    for name, problem in (("kernels", sdhj.arm_case_study()), ("intervals", plain_arm())):
        method, began = sdhj.Certified(cells=cells), time.process_time()
        table = sdhj.solve(problem, method, progress=False)
        seconds, share = time.process_time() - began, table.fraction(start=0, within=8)
        print(f"{name} on {table.shape}: {share:.4f} of C, {seconds:.0f} s, {table.nbytes / 1e6:.0f} MB")
