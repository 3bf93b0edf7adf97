"""How states move under held inputs: what the controller predicts with and the simulation integrates."""

import numpy as np

from sdhj.grid import FloatArray, Grid
from sdhj.problem import ReachAvoidProblem


def clip_to_walls(grid: Grid, states: FloatArray) -> FloatArray:
    """States (M, ndim) with the coordinates of bounded axes clipped to the walls, as `Grid` says."""
    free = np.array(grid.periodic)
    return np.clip(states, np.where(free, -np.inf, grid.lower), np.where(free, np.inf, grid.upper))


def drift(problem: ReachAvoidProblem, states: FloatArray, inputs: FloatArray) -> FloatArray:
    """Velocity of each state (M, ndim) under its own input, given by its index (M,), no adversary: (M, ndim)."""
    dynamics = problem.dynamics
    if not callable(dynamics.drift):
        return np.asarray(dynamics.drift)[inputs]
    velocity = np.empty_like(states)
    for j in np.unique(inputs):
        rows = inputs == j
        velocity[rows] = dynamics.drift_at(states[rows], int(j))
    return velocity


def push(problem: ReachAvoidProblem, states: FloatArray, v: FloatArray) -> FloatArray:
    """What the adversary's v (M, D) adds to the velocity of states (M, ndim): (M, ndim)."""
    gain = problem.dynamics.gain
    if not callable(gain):
        return v @ np.asarray(gain).T
    return np.einsum("mad,md->ma", problem.dynamics.gain_at(states), v)


def advance(
    problem: ReachAvoidProblem, states: FloatArray, inputs: FloatArray, v: FloatArray, duration: float
) -> FloatArray:
    """States after `duration` (s) under held inputs (M,) and v (M, D), the velocity clipped at walls.

    Exact for constant velocities, else one Runge-Kutta step of order 4.
    """

    def velocity(q: FloatArray) -> FloatArray:
        return drift(problem, q, inputs) + push(problem, q, v)

    def moved(span: float, slope: FloatArray) -> FloatArray:
        return clip_to_walls(problem.grid, states + span * slope)

    k1 = velocity(states)
    if problem.dynamics.constant:
        return moved(duration, k1)
    k2 = velocity(moved(duration / 2, k1))
    k3 = velocity(moved(duration / 2, k2))
    k4 = velocity(moved(duration, k3))
    return moved(duration, (k1 + 2 * k2 + 2 * k3 + k4) / 6)


def displacements(problem: ReachAvoidProblem, states: FloatArray) -> FloatArray:
    """Where every input takes each state (M, ndim) in one interval without an adversary, relative to it.

    Shape (M, L, ndim), or (1, L, ndim) where it is the same for all states. Exact for a constant drift, else by the
    midpoint rule.
    """
    dynamics, delta = problem.dynamics, problem.delta
    if not callable(dynamics.drift):
        return delta * np.asarray(dynamics.drift)[None]
    moves = []
    for j in range(len(problem.inputs)):
        middle = clip_to_walls(problem.grid, states + delta / 2 * dynamics.drift_at(states, j))
        moves.append(delta * dynamics.drift_at(middle, j))
    return np.stack(moves, axis=1)


def reachable_boxes(problem: ReachAvoidProblem, states: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, int]:
    """Boxes that hold the states at the end of one interval under each input and any adversary, relative to the states.

    Exact where velocities do not depend on the state; else the adversary's gain is that at the start.

    Returns
    -------
    low, high : (M, L, ndim) arrays, or (1, L, ndim) where they are the same for all states
    order : (ndim,) int array
        The axes, those first whose interval is the same for every input.
    shared : int
        How many axes those are; 0 where boxes depend on the state.
    """
    dynamics = problem.dynamics
    if dynamics.constant:
        states = states[:1]
    centre = displacements(problem, states)
    spread = problem.delta * np.abs(dynamics.gain_at(states)) @ dynamics.bounds  # (M, ndim)
    low, high = centre - spread[:, None], centre + spread[:, None]
    same = np.zeros(problem.grid.ndim, dtype=bool)
    if dynamics.constant:
        same = (low == low[:, :1]).all(axis=(0, 1)) & (high == high[:, :1]).all(axis=(0, 1))
    return low, high, np.argsort(~same, kind="stable"), int(same.sum())


def block_size(grid: Grid, low: FloatArray, high: FloatArray) -> int:
    """How many nodes, at most, the boxes of one state (all its inputs together) touch."""
    cells = (high.max(axis=1) - low.min(axis=1)) / np.array(grid.spacing)
    return int(np.prod(np.ceil(cells + 1e-6) + 2, axis=1).max())
