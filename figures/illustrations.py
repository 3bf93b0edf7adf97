"""Small games to look at (Figs. 4, 6 and 7).

A boat on a lake whose water turns: its state is where it is, its input a velocity that it holds over the interval, the
adversary a wind. With two axes, one input and one interval every construct of Sec. 3.4 and 4.1 is a picture.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sdhj.games import HJISolver, JointSolver
from sdhj.grid import FloatArray, Grid
from sdhj.problem import Dynamics, ReachAvoidProblem, TargetSet, UnsafeSet
from sdhj.schemes import Scheme

SIDE = 1.2  # the lake is [-SIDE, SIDE]^2, m
PIECES = 4  # the wind in a rollout changes at most at these many equal parts of the interval
SUBSTEPS = 10  # Runge-Kutta steps in each part


@dataclass(frozen=True)
class OneStepGame:
    """Level-set functions of the constructs of one interval, each of shape grid.shape, <= 0 inside.

    Attributes
    ----------
    problem : ReachAvoidProblem
        Two axes, one input, one step; its target is S, its unsafe set G.
    reach : array
        The reach set of S (Definition 2).
    avoid : array
        The avoid tube of G (Definition 3).
    cost : array
        The optimal cost V^j of Eq. (6) from the one PDE of Prop. 1; the reach-avoid set is where it is <= 0.
    """

    problem: ReachAvoidProblem
    reach: FloatArray
    avoid: FloatArray
    cost: FloatArray


@dataclass(frozen=True)
class Rollouts:
    """Open-loop runs from one state against many winds: `times` (T,), `paths` (M, T, 2), `costs` (M,) of Eq. (5)."""

    times: FloatArray
    paths: FloatArray
    costs: FloatArray

    @property
    def worst(self) -> int:
        """The run that costs the robot most."""
        return int(np.argmax(self.costs))


def boat_problem(
    *,
    nodes: int = 81,
    hold: float = 0.6,
    heading: Sequence[float] = (1.5, 0.1),
    wind: float = 0.14,
    turn: float = 0.8,
    target: Sequence[float] = (0.55, 0.30, 0.42),
    obstacle: Sequence[float] = (0.05, -0.12, 0.13),
) -> ReachAvoidProblem:
    """The boat: dq/dt = heading + turn * (-y, x) + v, |v|_inf <= wind.

    Parameters
    ----------
    nodes : int
        On each axis.
    hold : float
        Length of the interval, s.
    heading : (float, float)
        The input held, m/s.
    wind : float
        Bound of each component of the adversary, m/s.
    turn : float
        How fast the water turns, rad/s.
    target, obstacle : (x, y, radius)
        The disks S and G, m.
    """
    u = np.array([heading], dtype=np.float64)

    def drift(points: FloatArray, held: FloatArray) -> FloatArray:
        return held + turn * np.stack([-points[:, 1], points[:, 0]], axis=1)

    def disk(x: float, y: float, radius: float) -> object:
        return lambda points, t: np.hypot(points[:, 0] - x, points[:, 1] - y) - radius

    return ReachAvoidProblem(
        grid=Grid((-SIDE, -SIDE), (SIDE, SIDE), (nodes, nodes), names=("x", "y")),
        dynamics=Dynamics(u, drift, np.eye(2), np.array([wind, wind])),
        target=TargetSet((0, 1), disk(*target)),  # type: ignore[arg-type]
        unsafe=(UnsafeSet((0, 1), disk(*obstacle)),),  # type: ignore[arg-type]
        delta=hold,
        steps=1,
        name="boat",
    )


def one_step_game(problem: ReachAvoidProblem, scheme: Scheme | None = None) -> OneStepGame:
    """Solve the games of App. A.3 and the one of Prop. 1 for the first input of a problem over its first interval."""
    scheme = Scheme() if scheme is None else scheme
    solver = HJISolver(problem, scheme)
    goal = problem.grid.points()
    shape = problem.grid.shape
    s = problem.target_value(goal, problem.time(1)).reshape(shape)
    reach = next(values for _, values in solver.reach(s))
    avoid = np.maximum.reduce([solver.avoid(part, 0)[0] for part in problem.unsafe])
    cost = next(values for _, values in JointSolver(problem, scheme).reach_avoid(s, 0))
    return OneStepGame(problem, np.array(reach), avoid, np.array(cost))


def winds(problem: ReachAvoidProblem, count: int, seed: int) -> FloatArray:
    """Adversarial signals (M, PIECES, D): every vertex held throughout, then `count` that pick one for each part."""
    bounds = problem.dynamics.bounds
    signs = np.stack(np.meshgrid(*[(-1.0, 1.0)] * bounds.size, indexing="ij"), axis=-1).reshape(-1, bounds.size)
    held = np.repeat(signs[:, None], PIECES, axis=1)
    picks = np.random.default_rng(seed).integers(len(signs), size=(count, PIECES))
    return np.concatenate([held, signs[picks]]) * bounds


def play(problem: ReachAvoidProblem, start: Sequence[float], *, count: int = 60, seed: int = 0) -> Rollouts:
    """Run the true dynamics under the first input from `start` against every wind of `winds`, and price each run."""
    signals = winds(problem, count, seed)
    state = np.tile(np.asarray(start, dtype=np.float64), (len(signals), 1))
    h = problem.delta / (PIECES * SUBSTEPS)
    path = [state]
    for piece in range(PIECES):
        v = signals[:, piece]
        for _ in range(SUBSTEPS):
            k1 = _velocity(problem, state, v)
            k2 = _velocity(problem, state + h / 2 * k1, v)
            k3 = _velocity(problem, state + h / 2 * k2, v)
            state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + _velocity(problem, state + h * k3, v))
            path.append(state)
    paths = np.stack(path, axis=1)
    times = np.linspace(0.0, problem.delta, paths.shape[1])
    missed = problem.target_value(paths[:, -1], problem.delta)
    hit = np.max([-problem.unsafe_value(paths[:, k], float(t)) for k, t in enumerate(times)], axis=0)
    return Rollouts(times, paths, np.maximum(missed, hit))


@dataclass(frozen=True)
class SampledRun:
    """A sampled-data run of the boat: `times` (T,), `states` (T, 2), and the inputs `held` (K, 2) over intervals."""

    times: FloatArray
    states: FloatArray
    held: FloatArray
    levels: FloatArray
    delta: float


def sampled_run(
    *, delta: float = 0.25, intervals: int = 8, gain: float = 2.2, wind: float = 0.14, turn: float = 0.8, seed: int = 0
) -> SampledRun:
    """The boat steers for (0.5, 0.3) by what it measured at t_k, quantised to five levels, and holds that (Fig. 4).

    The wind, a smooth one within its bound, and the turning water act all the time.
    """
    levels = np.linspace(-1.5, 1.5, 5)
    phases = np.random.default_rng(seed).uniform(0.0, 2 * np.pi, (2, 2))
    rates = np.array([[3.0, 7.0], [4.0, 9.0]])

    def blowing(t: float) -> FloatArray:
        return wind * np.sin(rates * t + phases).mean(axis=1)

    def velocity(q: FloatArray, u: FloatArray, t: float) -> FloatArray:
        return u + turn * np.array([-q[1], q[0]]) + blowing(t)

    parts = PIECES * SUBSTEPS
    h, goal = delta / parts, np.array([0.5, 0.3])
    q, states, held = np.array([-0.8, -0.5]), [], []
    for k in range(intervals):
        wanted = gain * (goal - q) - turn * np.array([-q[1], q[0]])
        u = levels[np.argmin(np.abs(wanted[:, None] - levels), axis=1)]
        held.append(u)
        for part in range(parts):
            states.append(q)
            t = k * delta + part * h
            k1 = velocity(q, u, t)
            k2 = velocity(q + h / 2 * k1, u, t + h / 2)
            k3 = velocity(q + h / 2 * k2, u, t + h / 2)
            q = q + h / 6 * (k1 + 2 * k2 + 2 * k3 + velocity(q + h * k3, u, t + h))
    states.append(q)
    times = np.linspace(0.0, intervals * delta, len(states))
    return SampledRun(times, np.array(states), np.array(held), levels, delta)


def _velocity(problem: ReachAvoidProblem, state: FloatArray, v: FloatArray) -> FloatArray:
    return problem.dynamics.drift_at(state, 0) + np.einsum("mij,mj->mi", problem.dynamics.gain_at(state), v)
