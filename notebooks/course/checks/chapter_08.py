"""Checks of the exercises of chapter 8."""

from functools import cache
from unittest.mock import patch

import numpy as np

import sdhj
from course.exercises import exercise, expect, expect_close
from sdhj.problem.grid import Grid
from sdhj.simulation.runs import Z95


@exercise("8.1", "A linear function on a box is greatest at a corner: an absolute value for each axis.")
def check_hamiltonian(hamiltonian):
    """u . p_r + v_d |p_r|_1 + v_p |p_p|_1."""
    p = np.random.default_rng(0).normal(size=(50, 4))
    u = np.array([1.5, -3.0])
    got = np.asarray(hamiltonian(p, u, 0.0, 0.0))
    expect(got.shape == (50,), "one value for each row of p.")
    expect_close(got, p[:, :2] @ u, "without an adversary only u . p_r is left, p_r the first two components.")
    got = np.asarray(hamiltonian(p, u, 0.3, 0.0)) - p[:, :2] @ u
    expect_close(got, 0.3 * np.abs(p[:, :2]).sum(axis=1), "the disturbance: the adversary maximises on each axis.")
    got = np.asarray(hamiltonian(p, u, 0.0, 0.2)) - p[:, :2] @ u
    expect_close(got, 0.2 * np.abs(p[:, 2:]).sum(axis=1), "the pursuer moves the last two axes, each on its own.")


@exercise("8.2", "The ball of 0.8 r has 0.8^d of the volume.")
def check_shell(dimensions):
    """1 - 0.8^d > 0.9."""
    expect(1 - 0.8**dimensions > 0.9, "(8.7) with h / r = 0.2 is not above 0.9 there.")
    expect(1 - 0.8 ** (dimensions - 1) <= 0.9, "one dimension fewer would do.")


@exercise("8.3")
def check_window(window_maximum):
    """Maximum over `width` nodes of a periodic row, by doubling."""
    row = np.random.default_rng(1).normal(size=997)
    for width in (1, 2, 5, 8, 100):
        with patch.object(np, "maximum", wraps=np.maximum) as counted:
            got = np.asarray(window_maximum(row.copy(), width))
        wanted = np.max([np.roll(row, -shift) for shift in range(width)], axis=0)
        expect_close(got, wanted, f"width {width}: the window of i begins at i, ends at i + width - 1, and wraps.")
        if width > 1:
            expect(
                counted.call_count > 0, "np.maximum was never called: a window of copies costs width times the room."
            )
            most = 2 * int(np.ceil(np.log2(width)))
            expect(counted.call_count <= most, f"{counted.call_count} calls for width {width}, {most} are enough.")


@cache
def _free_share():
    problem = sdhj.arm_case_study(nodes=25)
    table = sdhj.solve(problem, progress=False)
    states = np.random.default_rng(5).uniform(problem.grid.lower, problem.grid.upper, (60_000, 4))
    free = problem.unsafe_value(states, 0.0) > 0
    return free.sum(), table.contains(states[free], start=0, within=8).mean(), free.mean()


@exercise(
    "8.4",
    "Draw states from the grid's box, keep those with `unsafe_value` above zero, and take the mean of `contains` "
    "over them.",
)
def check_free(share):
    """Of the states that are free at t = 0, the share in the tube; four standard errors of both estimates."""
    count, wanted, free = _free_share()
    expect(0 <= share <= 1, "a share, between 0 and 1.")
    off = 2 * Z95 * np.sqrt(wanted * (1 - wanted) * (1 / count + 1 / 5000))
    expect(abs(share - wanted * free) > off, "that is the share of all configurations: divide by the free ones.")
    expect(abs(share - wanted) <= off, "with 5,000 states or more it should be nearer to ours; is within=8, start=0?")
    return f"A share of {free:.2f} of C is free at t = 0."


@exercise(
    "8.5",
    "A peak may lie inside the disk, so the circle is not enough. How far from the next point may a place be, if "
    "values change by at most 1 m in a metre?",
)
def check_round(round_maximum):
    """Against a polar lattice of 200 x 16 points; sharp functions of either sign."""
    grid = Grid((-1.0, -1.0), (1.0, 1.0), (21, 21), ends="wall")
    points, r = grid.points(), 0.23
    angles = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    lattice = np.concatenate([share * r * circle for share in np.linspace(0, 1, 16)])
    for name, values in (
        ("a target, a convex function", np.hypot(*(points - (0.2, 0.1)).T) - 0.3),
        ("an obstacle's complement, with a peak inside the disk", 0.3 - np.hypot(*(points - (0.2, 0.1)).T)),
    ):
        values = values.reshape(grid.shape)
        ends = grid.clipped((points[:, None] + lattice).reshape(-1, 2))
        wanted = grid.interpolate(values, ends).reshape(len(points), -1).max(axis=1).reshape(grid.shape)
        got = np.asarray(round_maximum(grid, values, r))
        expect(got.shape == grid.shape, "one value for each node, in the grid's shape.")
        expect(got >= wanted - 0.01 * 0.3, f"{name}: too small somewhere by more than 1% of 0.3 m. Enough points? r?")
        expect(got <= wanted + 0.01, f"{name}: too large somewhere: are all points within r, and clipped at walls?")
    return "The disk lies in the box, so the adversary has less, and the robot's set is larger."
