"""Robots that a component of the disturbance moves along several axes, and their cells."""

from dataclasses import replace

import numpy as np

import sdhj

POST = sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0], p[:, 1] - 0.3) - 0.15, name="post")
AHEAD = sdhj.TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 0.55, p[:, 1]) - 0.3)
WAYS = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0], [0.0, 0.0]])


def gust(*, ends="unsafe", periodic=True, steps=4):
    """A robot that is pushed about along a diagonal."""
    grid = sdhj.Grid([-1, -1], [1, 1], [41, 41], periodic=[periodic] * 2, ends=ends)
    dynamics = sdhj.Dynamics(WAYS, WAYS, np.array([[1.0], [1.0]]) / np.sqrt(2), [0.9])
    return sdhj.ReachAvoidProblem(grid, dynamics, AHEAD, [POST], 0.1, steps)


def turned():
    """A robot whose direction is off by up to .6 rad."""

    def velocity(q, u, v):
        c, s = np.cos(v[0]), np.sin(v[0])
        return np.stack([u[0] * c - u[1] * s + 0 * q[:, 0], u[0] * s + u[1] * c + 0 * q[:, 0]], axis=1)

    grid = sdhj.Grid([-1, -1], [1, 1], [41, 41], periodic=[True, True])
    return sdhj.ReachAvoidProblem(
        grid,
        sdhj.Dynamics(0.8 * WAYS @ np.array([[1, 1], [-1, 1]]) / np.sqrt(2), velocity=velocity, bounds=[0.6]),
        AHEAD,
        [POST],
        0.1,
        4,
    )


def car():
    """A car that gusts from its side push about: the normals are a fan, and the last axis is none of theirs."""

    def drift(q, u):
        return np.stack([np.cos(q[:, 2]), np.sin(q[:, 2]), u[0] + 0 * q[:, 0]], axis=1)

    def gain(q):
        return np.stack([-np.sin(q[:, 2]), np.cos(q[:, 2]), 0 * q[:, 0]], axis=1)[:, :, None]

    grid = sdhj.Grid([-1, -1, -np.pi], [1, 1, np.pi], [21] * 3, periodic=[False, False, True])
    dynamics = sdhj.Dynamics([[-3.0], [0.0], [3.0]], drift, gain, [0.5])
    return sdhj.ReachAvoidProblem(grid, dynamics, AHEAD, [POST], 0.15, 3)


def timed():
    """A robot that is pushed about along a line that turns with time."""

    def gain(q, t):
        return np.stack([np.cos(2 * t) + 0 * q[:, 0], np.sin(2 * t) + 0 * q[:, 0]], axis=1)[:, :, None]

    return replace(gust(steps=2), dynamics=sdhj.Dynamics(WAYS, WAYS, gain, lambda t: np.array([0.2 + 6 * t])))


def in_a_corner():
    """A target in the corner of two walls."""
    target = sdhj.TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 0.85, p[:, 1] - 0.85) - 0.3)
    return replace(gust(ends="wall", periodic=False), target=target)


def over_the_seam():
    """Posts beside where the last axis closes, and nothing to reach."""
    posts = [sdhj.UnsafeSet((0, 1), lambda p, t, y=y: np.hypot(p[:, 0], p[:, 1] - y) - 0.3) for y in (-0.65, 0.1)]
    grid = sdhj.Grid([-1, -1], [1, 1], [41, 41], periodic=[False, True], ends="safe")
    return sdhj.ReachAvoidProblem(grid, gust().dynamics, None, posts, 0.1, 3)


ROBOTS = {
    "gust": (gust, (96, 96)),
    "between unsafe ends": (lambda: gust(periodic=False), (96, 96)),
    "between walls": (lambda: gust(periodic=False, ends="wall"), (96, 96)),
    "turned": (turned, (80, 80)),
    "car": (car, (40, 40, 36)),
}
OTHERS = {
    "timed": (timed, (160, 160)),
    "in a corner": (in_a_corner, (96, 96)),
    "over the seam": (over_the_seam, (40, 40)),
}
