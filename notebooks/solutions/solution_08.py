"""Solutions of chapter 8, and answers that its checks refuse."""

import numpy as np
from course.chapter_08 import check_free, check_hamiltonian, check_round, check_shell, check_window

import sdhj


def hamiltonian(p, u, v_d, v_p):
    """The adversary picks the sign of each component of the gradient."""
    return p[:, :2] @ u + v_d * np.abs(p[:, :2]).sum(axis=1) + v_p * np.abs(p[:, 2:]).sum(axis=1)


# 0.8^d < 0.1
dimensions = int(np.ceil(np.log(0.1) / np.log(0.8)))


def window_maximum(row, width):
    """Double the window while it fits; the last step lets two windows overlap."""
    result, size = row, 1
    while 2 * size <= width:
        result, size = np.maximum(result, np.roll(result, -size)), 2 * size
    return result if size == width else np.maximum(result, np.roll(result, -(width - size)))


def share_of_free(states=60_000):
    """A mean over states that are free at t = 0: the colliding ones are lost, so it exceeds the share of C."""
    problem = sdhj.arm_case_study(nodes=25)
    table = sdhj.solve(problem, progress=False)
    q = np.random.default_rng(0).uniform(problem.grid.lower, problem.grid.upper, (states, 4))
    free = problem.unsafe_value(q, 0.0) > 0
    return table.contains(q[free], start=0, within=8).mean()


def round_maximum(grid, values, r):
    """Points on the circle less than 0.003 m apart, and rings within for peaks between centre and circle."""
    points = grid.points()
    angles = np.linspace(0, 2 * np.pi, int(np.ceil(2 * np.pi * r / 0.004)), endpoint=False)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    best = values.ravel().copy()
    for share in np.linspace(0, 1, 31)[1:]:
        for step in share * r * circle:
            best = np.maximum(best, grid.interpolate(values, grid.clipped(points + step)))
    return best.reshape(grid.shape)


RIGHT = {
    check_hamiltonian: hamiltonian,
    check_shell: dimensions,
    check_window: window_maximum,
    check_free: share_of_free(),
    check_round: round_maximum,
}


def _few_points(grid, values, r):
    ends = [grid.clipped(grid.points() + r * np.array(step)) for step in ((1, 0), (-1, 0), (0, 1), (0, -1), (0, 0))]
    return np.max([grid.interpolate(values, end) for end in ends], axis=0).reshape(grid.shape)


def _only_the_circle(grid, values, r):
    ends = [grid.clipped(grid.points() + r * np.array([np.cos(a), np.sin(a)])) for a in np.linspace(0, 2 * np.pi, 600)]
    return np.max([grid.interpolate(values, end) for end in ends], axis=0).reshape(grid.shape)


def _box(grid, values, r):
    ends = [
        grid.clipped(grid.points() + r * np.array([a, b]))
        for a in np.linspace(-1, 1, 31)
        for b in np.linspace(-1, 1, 5)
    ]
    return np.max([grid.interpolate(values, end) for end in ends], axis=0).reshape(grid.shape)


WRONG = {
    check_hamiltonian: [
        lambda p, u, v_d, v_p: (
            p[:, :2] @ u + v_d * np.linalg.norm(p[:, :2], axis=1) + v_p * np.abs(p[:, 2:]).sum(axis=1)
        ),
        lambda p, u, v_d, v_p: p[:, :2] @ u - v_d * np.abs(p[:, :2]).sum(axis=1) - v_p * np.abs(p[:, 2:]).sum(axis=1),
        lambda p, u, v_d, v_p: p[:, :2] @ u + v_d * p[:, :2].sum(axis=1) + v_p * p[:, 2:].sum(axis=1),
    ],
    check_shell: [10, 12, 4],
    check_window: [
        lambda row, width: np.max([np.roll(row, -shift) for shift in range(width)], axis=0),  # right and slow
        lambda row, width: np.max([np.roll(row, shift) for shift in range(width)], axis=0),  # backwards
        lambda row, width: np.maximum(row, np.roll(row, -(width - 1))),  # its two ends
    ],
    check_free: [0.371, 0.2, 37.1],  # the share of C; too small; in per cent
    check_round: [_few_points, _only_the_circle, _box],
}
