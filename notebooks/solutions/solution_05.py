"""Solutions of chapter 5, and answers that its checks refuse."""

import numpy as np
from course.chapter_05 import check_axes, check_claims, check_count, check_evader, check_two

from sdhj import Scheme
from sdhj.problem.velocities import Velocities
from sdhj.solver.schemes import evolve


def claimed_in_error(reach, avoid):
    """Claimed: some input reaches and some avoids. Won: one does both."""
    claimed = np.maximum(reach.min(axis=0), avoid.min(axis=0)) <= 0
    return claimed & (np.maximum(reach, avoid).min(axis=0) > 0)


def equations(L, N, moving, static):
    """To reach: for each input and entry. To avoid: for each input, and each step where something moves."""
    return L * (N * (N + 1) // 2 + moving * N + static)


def needed(axes, reads):
    """Add what the known axes read, until nothing is new."""
    known = set(axes)
    while more := {k for i in known for k in range(len(reads)) if reads[i][k]} - known:
        known |= more
    return tuple(sorted(known))


# The disks know nothing of the evader: the two joints. End-effector to evader: two joints and two coordinates.
axes_to_avoid, axes_to_reach = 2, 4


def avoid_two(grid, u, v_d, v_p, delta):
    """One tube in the plane serves both: on (q_r, q_a) and on (q_r, q_b)."""
    q_r, q_p = grid.points().T.reshape(2, *grid.shape)
    wall = 0.12 - np.abs(q_r - q_p)
    box = Velocities(np.array([u - v_d, -v_p]), np.array([u + v_d, v_p]))
    tube = evolve(grid, wall, box, delta, Scheme(frame="fixed", dtype="float64"), obstacle=wall)
    return np.maximum(tube[:, :, None], tube[:, None, :])


RIGHT = {
    check_claims: claimed_in_error,
    check_count: equations,
    check_axes: needed,
    check_evader: (axes_to_avoid, axes_to_reach),
    check_two: avoid_two,
}


def _either(grid, u, v_d, v_p, delta):
    tube = avoid_two(grid, u, v_d, v_p, delta)[:, np.arange(grid.shape[1]), np.arange(grid.shape[1])]
    return np.minimum(tube[:, :, None], tube[:, None, :])


WRONG = {
    check_claims: [
        lambda reach, avoid: np.maximum(reach.min(axis=0), avoid.min(axis=0)) <= 0,  # claimed, rightly or not
        lambda reach, avoid: np.maximum(reach, avoid).min(axis=0) > 0,  # not won, claimed or not
        lambda reach, avoid: np.maximum(reach.min(axis=1), avoid.min(axis=1)) <= 0,  # the wrong axis
    ],
    check_count: [
        lambda L, N, moving, static: L * N * (N + 1) // 2 * (1 + moving + static),  # for each entry
        lambda L, N, moving, static: L * (N * (N + 1) // 2 + N * (moving + static)),  # static ones anew
        lambda L, N, moving, static: L * N * N,
    ],
    check_axes: [
        lambda axes, reads: tuple(
            sorted({*axes, *(k for i in axes for k in range(len(reads)) if reads[i][k])})
        ),  # once
        lambda axes, reads: needed(axes, np.asarray(reads).T),  # the other way round
        lambda axes, reads: tuple(range(len(reads))),  # all of them
    ],
    check_evader: [(4, 4), (2, 2), (4, 2)],
    check_two: [
        _either,  # safe from one of them
        lambda grid, u, v_d, v_p, delta: avoid_two(grid, u, v_d, 0.0, delta),  # pursuers that stand still
        lambda grid, u, v_d, v_p, delta: avoid_two(grid, u, v_d, v_p, delta)[:, :, 0],  # no third axis
    ],
}
