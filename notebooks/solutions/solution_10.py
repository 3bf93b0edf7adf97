"""Solutions of chapter 10, and answers that its checks refuse."""

import numpy as np
from course.chapter_10 import check_amdahl, check_games, check_kernel, check_memory, check_steps

# L N (N + 1) / 2 with N = 16 intervals of half the length and L = 7 * 7 inputs
games_needed = 49 * 16 * 17 // 2

# 45 tubes, 4 bytes for the value and 25 bits in 4 bytes; 25 avoid tubes of the pursuer, 25 of the obstacles a step
most_nodes = max(m for m in range(100) if 45 * 8 * m**4 + 100 * m**4 + 800 * m**2 <= 1e9)

# The second that was no game, one game of 25, and a shift for each input: the rest soon outweighs the games (Amdahl).
seconds_moving = 1.0 + 7.0 / 25 + 25 * 0.02


def time_steps(spacing, speed, delta, cfl):
    """The sum over the axes, because a step moves along all of them."""
    return int(np.ceil(delta * np.sum(speed / spacing) / cfl))


def step_3d(phi, out, a, b, ratios, periodic):
    """The last axis innermost: neighbours in the loop are neighbours in memory."""
    nx, ny, nz = phi.shape
    for i in range(nx):
        left = i - 1 if i > 0 else (nx - 1 if periodic[0] else 0)
        right = i + 1 if i < nx - 1 else (0 if periodic[0] else nx - 1)
        for j in range(ny):
            front = j - 1 if j > 0 else (ny - 1 if periodic[1] else 0)
            back = j + 1 if j < ny - 1 else (0 if periodic[1] else ny - 1)
            for k in range(nz):
                below = k - 1 if k > 0 else (nz - 1 if periodic[2] else 0)
                above = k + 1 if k < nz - 1 else (0 if periodic[2] else nz - 1)
                c = phi[i, j, k]
                minus = (c - phi[left, j, k], c - phi[i, front, k], c - phi[i, j, below])
                plus = (phi[right, j, k] - c, phi[i, back, k] - c, phi[i, j, above] - c)
                total = 0.0
                for axis in range(3):
                    low = a[axis] * (plus[axis] if a[axis] > 0 else minus[axis])
                    high = b[axis] * (plus[axis] if b[axis] > 0 else minus[axis])
                    best = max(low, high)
                    if a[axis] < 0 < b[axis]:
                        best = max(best, 0.0)
                    total += ratios[axis] * best
                out[i, j, k] = c + total


def _downwind(phi, out, a, b, ratios, periodic):
    step_3d(phi[::-1, ::-1, ::-1], out[::-1, ::-1, ::-1], a, b, ratios, periodic)


def _walls_everywhere(phi, out, a, b, ratios, periodic):
    step_3d(phi, out, a, b, ratios, (False, False, False))


def _in_place(phi, out, a, b, ratios, periodic):
    """Reads what it has just written."""
    out[:] = phi
    step_3d(out, out, a, b, ratios, periodic)


RIGHT = {
    check_games: games_needed,
    check_memory: most_nodes,
    check_amdahl: seconds_moving,
    check_steps: time_steps,
    check_kernel: step_3d,
}
WRONG = {
    check_games: [900, 25 * 136, 49 * 36, 98 * 136],
    check_memory: [40, 39, 37, 100],
    check_amdahl: [0.32, 1.28, 8 / 25 + 0.5],
    check_steps: [
        lambda spacing, speed, delta, cfl: int(np.ceil(delta * np.max(speed / spacing) / cfl)),  # one axis
        lambda spacing, speed, delta, cfl: int(np.ceil(delta * np.sum(speed / spacing) * cfl)),
        lambda spacing, speed, delta, cfl: delta * np.sum(speed / spacing) / cfl,  # not whole
    ],
}


def _plain(step):
    """A wrong kernel that need not be compiled: the check takes what has `py_func` as it is."""
    step.py_func = step
    return step


WRONG[check_kernel] = [_plain(step) for step in (_downwind, _walls_everywhere, _in_place)]
