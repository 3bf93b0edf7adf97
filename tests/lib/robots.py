"""Random robots for the proofs, each function written once: the library and the judge call the same. Imports sdhj."""

from dataclasses import dataclass

import judge
import naive_certified as naive
import numpy as np

import sdhj

ADVERSARIES = ("switching", "up", "down", "outward", "inward")


@dataclass(frozen=True)
class Robot:
    """dx = drift(x, u, t) + gain(x, u, t) v; axes are periodic, or bounded with unsafe ends."""

    grid: sdhj.Grid
    inputs: np.ndarray
    drift: object
    gain: object
    bound: np.ndarray
    target: object  # (states, t), as `unsafe`
    obstacles: tuple  # (axes, level_set, rate)
    delta: float
    steps: int

    def problem(self, **changed):
        everything = tuple(range(self.grid.ndim))
        unsafe = [
            sdhj.UnsafeSet(axes, level_set, name=f"set {k}") for k, (axes, level_set, rate) in enumerate(self.obstacles)
        ]
        dynamics = sdhj.Dynamics(self.inputs, self.drift, self.gain, self.bound)
        target = sdhj.TargetSet(everything, self.target)
        given = {"target": target, "unsafe": unsafe, "delta": self.delta, "steps": self.steps} | changed
        return sdhj.ReachAvoidProblem(grid=self.grid, dynamics=dynamics, **given)

    def wrapped(self, states):
        return naive.held_periodic(self.grid, states)

    def velocity(self, states, places, signs, t):
        states, out = self.wrapped(states), np.empty_like(states)
        for j in np.unique(places):
            own, u = places == j, self.inputs[j]
            push = np.einsum("mid,md->mi", self.gain(states[own], u, t), self.bound * signs[own])
            out[own] = self.drift(states[own], u, t) + push
        return out

    def unsafe(self, states, t):
        """Also past an end, by more than rounding."""
        states, values = self.wrapped(states), [np.full(len(states), np.inf)]
        values += [level_set(states[:, list(axes)], t) for axes, level_set, _ in self.obstacles]
        for axis in np.flatnonzero(~np.array(self.grid.periodic)):
            lower, upper = self.grid.lower[axis], self.grid.upper[axis]
            values.append(np.minimum(states[:, axis] - lower, upper - states[:, axis]) + 1e-9)
        return np.min(values, axis=0)

    def outcomes(self, table, adversary, rng, count):
        """Of runs from random certified states, by any of the inputs certified for them."""
        starts = naive.states_in(table, rng, count)
        middle = (np.array(self.grid.lower) + self.grid.upper) / 2

        def choose(states, step):
            left, places = naive.steps_to_go(table, states, step), np.full(len(states), -1)
            ahead = (left > 0) & (left < 99)
            if ahead.any():
                places[ahead] = naive.chosen_inputs(table, states[ahead], step, rng)
            return places

        def signs(states, inputs, t, end):
            shape = len(states), len(self.bound)
            if adversary == "switching":
                return rng.choice([-1.0, 1.0], shape)
            if adversary in ("up", "down"):
                return np.full(shape, 1.0 if adversary == "up" else -1.0)
            away = np.where(self.wrapped(states) >= middle, 1.0, -1.0) * (1.0 if adversary == "outward" else -1.0)
            return np.sign(np.einsum("mid,mi->md", self.gain(self.wrapped(states), self.inputs[0], t), away))

        target = lambda states, t: self.target(self.wrapped(states), t)  # noqa: E731
        return judge.play(
            choose, self.velocity, signs, target, self.unsafe, starts, delta=self.delta, steps=table.steps
        )


def random_robot(seed):
    """Two or three axes, some periodic; drift and often gains depend on the state, some on time; a disk that moves."""
    rng = np.random.default_rng(seed)
    ndim = int(rng.integers(2, 4))
    periodic = [bool(rng.random() < 0.4) for _ in range(ndim)]
    lower, upper = ([(-np.pi if own else -2.0) for own in periodic], [(np.pi if own else 2.0) for own in periodic])
    grid = sdhj.Grid(lower, upper, [21] * ndim, periodic)
    inputs = np.array([[0.0, 0.0], [1.0, 0.3], [-1.0, 0.3], [0.3, 1.0], [0.3, -1.0]]) * rng.uniform(0.8, 1.4)
    mix = rng.uniform(-1.0, 1.0, (2, ndim)) + np.eye(2, ndim)
    waves, phases = rng.uniform(0.0, 0.5, (ndim, ndim)) * (rng.random((ndim, ndim)) < 0.5), rng.uniform(-3, 3, ndim)
    often = np.array([1.0 if own else 1.3 for own in periodic])
    tide = rng.uniform(0.0, 0.3, ndim) * (rng.random() < 0.4)
    share = rng.uniform(0.0, 0.6) * (rng.random() < 0.6)
    bound = rng.uniform(0.02, 0.12, ndim)

    def drift(x, u, t):
        return u @ mix + np.sin(often * x + phases) @ waves.T + tide * np.sin(3.0 * t)

    def gain(x, u, t):
        return np.eye(ndim) * (1.0 + share * np.cos(often[0] * x[:, 0] + u[0]))[:, None, None]

    centre, radius = rng.uniform(-0.5, 0.5, ndim), rng.uniform(1.0, 1.3)
    place, speed, size = rng.uniform(-1.5, 1.5, 2), rng.uniform(-0.5, 0.5, 2), rng.uniform(0.25, 0.5)

    def apart(x, at, own):
        return np.stack([distance(x[:, k] - at[k], own[k]) for k in range(len(at))], axis=1)

    def target(x, t):
        return np.linalg.norm(apart(x, centre, periodic), axis=1) - radius

    def disk(x, t):
        return np.hypot(*apart(x, [place[k] + speed[k] * t for k in (0, 1)], periodic).T) - size

    return Robot(
        *(grid, inputs, drift, gain, bound, target, (((0, 1), disk, float(np.hypot(*speed))),)),
        delta=0.25,
        steps=int(rng.integers(2, 5)),
    )


def distance(gap, periodic):
    return (gap + np.pi) % (2 * np.pi) - np.pi if periodic else gap
