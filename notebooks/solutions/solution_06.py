"""Solutions of chapter 6, and answers that its checks refuse."""

import numpy as np
from course.chapter_06 import check_disturbance, check_inverse, check_limits, check_samples, check_three_links

# (l1 + l2) v delta + l2 v delta = 0.06
largest_disturbance = 0.06 / ((0.15 + 2 * 0.15) * 0.1)


def inverse(x, y, length=0.15):
    """Two equal links and the line from base to tip make an isosceles triangle."""
    r = np.hypot(x, y)
    bend = 2 * np.arccos(r / (2 * length))
    return tuple((np.arctan2(y, x) - side * bend / 2, side * bend) for side in (1, -1))


def samples_needed(radius, speed, delta, depth):
    """(a / 2)^2 = r^2 - (r - depth)^2 with a = speed delta / (n - 1)."""
    apart = 2 * np.sqrt(radius**2 - (radius - depth) ** 2)
    return max(2, 1 + int(np.ceil(speed * delta / apart - 1e-12)))


def overlap(q):
    """Inside, q2 is within pi - 2.8 of pi: a distance on the circle."""
    return 2.8 - np.abs(np.angle(np.exp(1j * q[:, 1])))


def clearance(q, lengths, half_width, centre, radius):
    """The nearest of three segments, one after the other."""
    angles, start = np.cumsum(q, axis=1), np.zeros((len(q), 2))
    nearest = np.full(len(q), np.inf)
    for link, length in enumerate(lengths):
        along = length * np.stack([np.cos(angles[:, link]), np.sin(angles[:, link])], axis=1)
        theta = np.clip(np.sum((centre - start) * along, axis=1) / length**2, 0.0, 1.0)
        nearest = np.minimum(nearest, np.linalg.norm(centre - start - theta[:, None] * along, axis=1))
        start = start + along
    return nearest - radius - half_width


RIGHT = {
    check_disturbance: largest_disturbance,
    check_inverse: inverse,
    check_samples: samples_needed,
    check_limits: overlap,
    check_three_links: clearance,
}


def _absolute(q, lengths, half_width, centre, radius):
    relative = np.concatenate([q[:, :1], np.diff(q, axis=1)], axis=1)
    return clearance(relative, lengths, half_width, centre, radius)


WRONG = {
    check_disturbance: [2.0, 4.0, 13.3],  # the first joint alone; the second alone; no interval
    check_inverse: [
        lambda x, y: (inverse(x, y)[0], inverse(x, y)[0]),  # one posture twice
        lambda x, y: tuple((a, a + b) for a, b in inverse(x, y)),  # absolute angles
    ],
    check_samples: [
        lambda r, c, delta, depth: samples_needed(r, c, delta, depth) - 1,  # gaps for samples
        lambda r, c, delta, depth: 1 + int(np.ceil(c * delta / (2 * depth))),  # the margin of (6.5)
        lambda r, c, delta, depth: 20,
    ],
    check_limits: [
        lambda q: np.abs(q[:, 1]) - 2.8,  # inside out
        lambda q: 2.8 - np.abs(q[:, 1]),  # not periodic
        lambda q: np.where(np.abs(np.angle(np.exp(1j * q[:, 1]))) > 2.8, -1.0, 1.0),  # a jump
    ],
    check_three_links: [
        _absolute,
        lambda q, lengths, w, c, r: clearance(q, lengths, 0.0, c, r),
        lambda q, lengths, w, c, r: clearance(q[:, :2], lengths[:2], w, c, r),
    ],
}
