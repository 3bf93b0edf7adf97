"""Solutions of chapter 14, and answers that its checks refuse."""

from fractions import Fraction
from itertools import product

import numpy as np
from course.chapter_14 import check_capture, check_evader_limit, check_nested, check_push, check_tip

# Stretched and both joints the same way: levers l1 + l2 and l2, each at 3 rad/s
top_speed = (0.15 + 2 * 0.15) * 3.0


def push_formula(q2, l1, l2):
    """Columns a and b of J: |a|^2 = l1^2 + l2^2 + 2 l1 l2 cos q2, |b| = l2, a.b = l2^2 + l1 l2 cos q2."""
    inner = l2**2 + l1 * l2 * np.cos(q2)
    return np.sqrt(l1**2 + 2 * l2**2 + 2 * l1 * l2 * np.cos(q2) + 2 * np.abs(inner))


gentlest_angle = np.pi  # a.b = l^2 (1 + cos q2) >= 0, so nu falls with cos q2: folded, nu = l2

# levels -3 + 6 i / (m - 1): those of m are among those of m' where m - 1 divides m' - 1
pairs = {(m, n) for m in range(2, 10) for n in range(m + 1, 10) if (n - 1) % (m - 1) == 0}


def evader_limit(J, rho, delta, v_d):
    """The largest gap is convex in s and s', so corners decide; it grows with v_e, so bisect."""
    corners = np.array(list(product((-1, 1), repeat=2)))
    blur = v_d * corners @ J.T

    def opens(v_e):
        return delta * np.max(np.linalg.norm(blur[:, None] + v_e * corners, axis=-1)) > rho

    low, high = 0.0, rho / delta
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (low, middle) if opens(middle) else (middle, high)
    return low


def capture_set(r, v, delta, n):
    """A step: each interval, shrunk by delta v, moved by delta u; then unite."""
    intervals = [(-r, r)]
    for _ in range(n):
        pieces = list(intervals)
        for (left, right), u in product(intervals, (-1, 0, 1)):
            if right - left >= 2 * delta * v:
                pieces.append((left + delta * (u + v), right + delta * (u - v)))
        intervals = []
        for left, right in sorted(pieces):
            if intervals and left <= intervals[-1][1]:
                intervals[-1] = intervals[-1][0], max(right, intervals[-1][1])
            else:
                intervals.append((left, right))
    return intervals


RIGHT = {
    check_tip: top_speed,
    check_push: (push_formula, gentlest_angle),
    check_nested: pairs,
    check_evader_limit: evader_limit,
    check_capture: capture_set,
}


def _both_worst(J, rho, delta, v_d):
    corners = np.array(list(product((-1, 1), repeat=2)))
    return (rho / delta - v_d * np.max(np.linalg.norm(corners @ J.T, axis=1))) / np.sqrt(2)


def _one_interval(r, v, delta, n):
    """As if the images of the inputs always touched."""
    return [(-r - n * delta * (1 - v), r + n * delta * (1 - v))]


def _grown(r, v, delta, n):
    """The evader runs towards the robot."""
    return [(-r - n * delta * (1 + v), r + n * delta * (1 + v))]


WRONG = {
    check_tip: [0.9, 0.99, 1.485],
    check_push: [
        (lambda q2, l1, l2: np.sqrt(l1**2 + 2 * l2**2 + 2 * l1 * l2 * np.cos(q2)), np.pi),  # no cross term
        (lambda q2, l1, l2: np.linalg.norm([l1 + 2 * l2 * np.cos(q2), 2 * l2 * np.sin(q2)]), np.pi),  # one sign
        (push_formula, 0.0),  # stretched: the worst
    ],
    check_nested: [
        {(m, n) for m in range(2, 10) for n in range(m + 1, 10)},  # more is better
        {(2, 3), (3, 5), (5, 9)},  # doubling only
    ],
    check_evader_limit: [_both_worst, lambda J, rho, delta, v_d: rho / delta],
    check_capture: [_one_interval, _grown, lambda r, v, delta, n: [(-r, r), (Fraction(9), Fraction(10))]],
}
