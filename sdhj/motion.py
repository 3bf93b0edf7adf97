"""How states move under held inputs: what the controller predicts with and the simulation integrates."""

import numpy as np

from sdhj.grid import FloatArray, Grid
from sdhj.problem import ReachAvoidProblem


def clip_to_walls(grid: Grid, states: FloatArray) -> FloatArray:
    """States (M, ndim) with the coordinates of bounded axes clipped to the walls, as `Grid` says."""
    low, high = grid.walls
    return np.minimum(np.maximum(states, low), high)


def drift(problem: ReachAvoidProblem, states: FloatArray, inputs: FloatArray) -> FloatArray:
    """Velocity of each state (M, ndim) under its own input, given by its index (M,), no adversary: (M, ndim)."""
    dynamics = problem.dynamics
    if not callable(dynamics.drift):
        return np.asarray(dynamics.drift)[inputs]
    velocity = np.empty_like(states)
    for j in np.unique(inputs):
        rows = inputs == j
        velocity[rows] = problem.drift_at(states[rows], int(j))
    return velocity


def push(problem: ReachAvoidProblem, states: FloatArray, v: FloatArray) -> FloatArray:
    """What the adversary's v (M, D) adds to the velocity of states (M, ndim): (M, ndim)."""
    gain = problem.dynamics.gain
    if not callable(gain):
        return v @ np.asarray(gain).T
    return np.einsum("mad,md->ma", problem.gain_at(states), v)


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
        middle = clip_to_walls(problem.grid, states + delta / 2 * problem.drift_at(states, j))
        moves.append(delta * problem.drift_at(middle, j))
    return np.stack(moves, axis=1)


def reachable_boxes(problem: ReachAvoidProblem, states: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Boxes that hold the states at the end of one interval under each input and any adversary, relative to the states.

    Lower and upper corners, both (M, L, ndim), or (1, L, ndim) where they are the same for all states. Exact where
    velocities do not depend on the state; else the adversary's gain is that at the start.
    """
    dynamics = problem.dynamics
    if dynamics.constant:
        states = states[:1]
    centre = displacements(problem, states)
    spread = problem.delta * np.abs(problem.gain_at(states)) @ dynamics.bounds  # (M, ndim)
    return centre - spread[:, None], centre + spread[:, None]
