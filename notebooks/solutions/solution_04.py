"""Solutions of chapter 4, and answers that its checks refuse."""

import numpy as np
from course.chapter_04 import check_boat, check_defeat, check_interval, check_longest, check_passing

# The square has a half-side of 0.25 delta, and fits into the disk where its half-diagonal does.
longest_interval = 0.3 / (0.25 * np.sqrt(2))


def in_danger(left, right, u, v_max, delta):
    """All that a state can touch is [q + min(0, (u - v) delta), q + max(0, (u + v) delta)]."""
    return left - max(0.0, (u + v_max) * delta), right - min(0.0, (u - v_max) * delta)


winds = [(0.0, -0.14)]  # the obstacle lies south of the path

start = (-0.38, -0.25)  # passes right through it


def _slopes(values, axis, h):
    v = np.moveaxis(values, axis, -1)
    v = np.pad(v, [(0, 0)] * (v.ndim - 1) + [(2, 2)], mode="edge")
    d = np.diff(v)
    left, inner, right = (np.diff(d)[..., i : i + values.shape[axis]] for i in range(3))
    minus = d[..., 1:-2] + np.where(np.abs(left) < np.abs(inner), left, inner) / 2
    plus = d[..., 2:-1] - np.where(np.abs(right) < np.abs(inner), right, inner) / 2
    return np.moveaxis(minus, -1, axis) / h, np.moveaxis(plus, -1, axis) / h


def _rate(values, low, high, h):
    total = np.zeros_like(values)
    for axis in range(2):
        (minus, plus), a, b = _slopes(values, axis, h), low[axis], high[axis]
        best = np.maximum(a * np.where(a > 0, plus, minus), b * np.where(b > 0, plus, minus))
        total += np.where((a < 0) & (b > 0), np.maximum(best, 0.0), best)
    return total


def _solve(values, low, high, duration, h, wall=-np.inf):
    """The chapter's solver."""
    speed = sum(np.maximum(np.abs(a), np.abs(b)) / h for a, b in zip(low, high, strict=True)).max()
    steps = int(np.ceil(duration * speed / 0.75))
    values = np.maximum(values, wall)
    for _ in range(steps):
        first = np.maximum(values + duration / steps * _rate(values, low, high, h), wall)
        values = np.maximum((values + first + duration / steps * _rate(first, low, high, h)) / 2, wall)
    return values


def boat_tube(x, y, steps, wind=0.14, turn=0.8, watched=True):
    """The best heading against the worst wind, and what was won in fewer steps."""
    h = x[1, 0] - x[0, 0]
    target, obstacle = np.hypot(x - 0.55, y - 0.30) - 0.42, np.hypot(x - 0.05, y + 0.12) - 0.13
    tube = np.maximum(target, -obstacle)
    for _ in range(steps):
        won, wall = [tube], -obstacle if watched else -np.inf
        for angle in np.pi / 4 * np.arange(8):
            drift = np.stack([1.5 * np.cos(angle) - turn * y, 1.5 * np.sin(angle) + turn * x])
            won.append(_solve(tube, drift - wind, drift + wind, 0.2, h, wall))
        tube = np.min(won, axis=0)
    return tube


RIGHT = {
    check_longest: longest_interval,
    check_interval: in_danger,
    check_defeat: (winds,),
    check_passing: (start,),
    check_boat: boat_tube,
}


def _no_obstacle(x, y, steps):
    tube = np.hypot(x - 0.55, y - 0.30) - 0.42
    return tube - 0.1 * steps


WRONG = {
    check_longest: [1.2, 0.6, 1.7],  # sides for corners; the side for half of it; twice too long
    check_interval: [
        lambda left, right, u, v, delta: (left - (u + v) * delta, right - (u - v) * delta),  # the end alone
        lambda left, right, u, v, delta: (left - max(0, u * delta), right - min(0, u * delta)),  # no wind
    ],
    check_defeat: [
        ([(0.0, 0.14)],),  # away from the obstacle
        ([(0.0, -0.5)],),  # a storm
        ([0.1, 0.1, 0.1],),  # numbers for pairs
    ],
    check_passing: [
        ((0.05, -0.12),),  # inside
        ((-0.42, 0.30),),  # never near it
        ((-0.8, -0.3),),  # ends in it
    ],
    check_boat: [
        _no_obstacle,
        lambda x, y, steps: boat_tube(x, y, steps, wind=0.0),
        lambda x, y, steps: boat_tube(x, y, steps, turn=0.0),
        lambda x, y, steps: boat_tube(x, y, steps, watched=False),  # safe at the instants alone
    ],
}
