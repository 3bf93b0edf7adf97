"""The case study of the arm as anyone's robot: its level sets in plain NumPy, followed by intervals."""

import time
from dataclasses import replace

import numpy as np
import pytest

import sdhj
from sdhj.arm.case_studies import OBSTACLES, TARGET, scene
from sdhj.arm.workspace import Circle, Line

LENGTH, HALF_WIDTH, PURSUER = 0.15, 0.01, 0.04


def gap(cos, sin, x, y):
    """Distance of (x, y) from a link at the origin: seen from the link, so that each coordinate occurs once."""
    along, across = cos * x + sin * y, cos * y - sin * x
    return np.hypot(along - np.clip(along, 0.0, LENGTH), across)


def clearance(q, x, y):
    """Distance from the links to points; that from the second in two frames, of which the larger bound holds."""
    first, second, both = q[:, 0], q[:, 1], q[:, 0] + q[:, 1]
    cos, sin = np.cos(first), np.sin(first)
    along, across = cos * x + sin * y, cos * y - sin * x
    one = gap(np.cos(both), np.sin(both), x - LENGTH * cos, y - LENGTH * sin)
    other = gap(np.cos(second), np.sin(second), along - LENGTH, across)
    return np.minimum(gap(cos, sin, x, y), np.maximum(one, other)) - HALF_WIDTH


def centre(path, t):
    if isinstance(path, Line):
        return path.start[0] + path.velocity[0] * t, path.start[1] + path.velocity[1] * t
    if isinstance(path, Circle):
        angle = path.rate * t + path.phase
        return path.centre[0] + path.radius * np.cos(angle), path.centre[1] + path.radius * np.sin(angle)
    return path.centre


def plain_arm(**options):
    """The case study without its recipe: nothing tells that it is an arm."""

    def target(q, t):
        x, y = centre(TARGET.path, t)
        tip = [LENGTH * (turn(q[:, 0]) + turn(q[:, 0] + q[:, 1])) for turn in (np.cos, np.sin)]
        return np.hypot(tip[0] - x, tip[1] - y) - TARGET.radius

    unsafe = [sdhj.UnsafeSet((0, 1, 2, 3), lambda q, t: clearance(q, q[:, 2], q[:, 3]) - PURSUER, name="pursuer")]
    for k, disk in enumerate(OBSTACLES):
        apart = lambda q, t, disk=disk: clearance(q, *centre(disk.path, t)) - disk.radius  # noqa: E731
        unsafe.append(sdhj.UnsafeSet((0, 1), apart, rate=disk.speed, name=f"disk {k}"))
    problem = sdhj.arm_case_study(**options)
    return replace(problem, target=sdhj.TargetSet((0, 1), target), unsafe=unsafe, recipe={})


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
