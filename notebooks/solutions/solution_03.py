"""Solutions of chapter 3, and answers that its checks refuse."""

import numpy as np
from course.chapter_03 import check_avoid_tube, check_ball, check_order, check_sampled, check_touch


def hamiltonian(p, u, v_max):
    """The adversary pushes along p."""
    return p @ u + v_max * np.linalg.norm(p, axis=1)


def orders(table):
    """Commits first: the best row of the costliest columns. Answers: the worst column of the cheapest rows."""
    return table.max(axis=1).min(), table.min(axis=0).max()


def passes(rate, p, side):
    """From above the candidate may not rise faster than the equation allows, from below not more slowly (3.7)."""
    return rate <= abs(p) if side == "above" else rate >= abs(p)


def avoid_value(x, low, high, centre, radius, T):
    """By time T the state may have touched every point from x + min(0, T low) to x + max(0, T high)."""
    nearest = np.clip(centre, x + min(0.0, T * low), x + max(0.0, T * high))
    return radius - np.abs(nearest - centre)


def sampled_value(x, N):
    """Dynamic programming on a fine line: the largest value within the push's reach, then the best input."""
    nodes = np.linspace(-3.0, 3.0, 2401)
    delta = 0.8 / N
    pushes = np.linspace(-0.5 * delta, 0.5 * delta, 81)
    values = np.abs(nodes) - 0.3
    for _ in range(N):
        worst = np.max([np.interp(nodes + push, nodes, values) for push in pushes], axis=0)
        values = np.min([np.interp(nodes + u * delta, nodes, worst) for u in (-1, 0, 1)], axis=0)
    return np.interp(x, nodes, values)


RIGHT = {
    check_ball: hamiltonian,
    check_order: orders,
    check_touch: passes,
    check_avoid_tube: avoid_value,
    check_sampled: sampled_value,
}


def _adversary_first(x, N):
    nodes, delta = np.linspace(-3.0, 3.0, 2401), 0.8 / N
    values = np.abs(nodes) - 0.3
    for _ in range(N):
        best = np.min([np.interp(nodes + u * delta, nodes, values) for u in (-1, 0, 1)], axis=0)
        pushes = np.linspace(-0.5 * delta, 0.5 * delta, 81)
        answers = [
            np.min([np.interp(nodes + u * delta + push, nodes, values) for u in (-1, 0, 1)], axis=0) for push in pushes
        ]
        values = np.maximum(np.max(answers, axis=0), best)
    return np.interp(x, nodes, values)


WRONG = {
    check_ball: [
        lambda p, u, v_max: p @ u + v_max * np.abs(p).sum(axis=1),  # a box
        lambda p, u, v_max: p @ u - v_max * np.linalg.norm(p, axis=1),  # the adversary helps
        lambda p, u, v_max: p @ u + v_max,  # the slope forgotten
    ],
    check_order: [
        lambda table: (table.min(axis=0).max(), table.max(axis=1).min()),  # exchanged
        lambda table: (table.max(axis=0).min(), table.min(axis=1).max()),  # rows for columns
    ],
    check_touch: [
        lambda rate, p, side: rate == abs(p),  # almost everywhere is not enough
        lambda rate, p, side: rate >= abs(p) if side == "above" else rate <= abs(p),  # sides exchanged
    ],
    check_avoid_tube: [
        lambda x, a, b, c, r, T: r - np.abs(np.clip(c, x + T * a, x + T * b) - c),  # the end alone
        lambda x, a, b, c, r, T: np.abs(np.clip(c, x + min(0, T * a), x + max(0, T * b)) - c) - r,  # g, not -g
    ],
    check_sampled: [
        lambda x, N: np.min([np.abs(x + 0.8 * u) for u in (-1, 0, 1)], axis=0) + 0.4 - 0.3,  # one choice for all time
        lambda x, N: np.maximum(np.abs(x) - 0.4, 0.0) - 0.3,  # the limit
        _adversary_first,
    ],
}
