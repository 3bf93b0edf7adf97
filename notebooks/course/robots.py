"""Robots of the course that are solved in a moment: a point in the plane, and what holding an input does to it."""

import warnings
from collections.abc import Callable, Sequence

import numpy as np

import sdhj
from course.chapter_01 import canvas
from sdhj.arm.workspace import Disk, Line, Segment, Still
from sdhj.common.findings import ResolutionWarning
from sdhj.common.remembering import FloatArray
from sdhj.problem.dynamics import Dynamics
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.samples import Samples
from sdhj.problem.sets import TargetSet, UnsafeSet
from sdhj.solver.games import HJIGames
from sdhj.solver.schemes import Scheme
from sdhj.table.batches import Table


def away(moving: Disk) -> Callable[[FloatArray, float], FloatArray]:
    """The distance from a disk that moves, as a level-set function of the place."""
    return lambda points, t: np.linalg.norm(points - moving.centre(t), axis=1) - moving.radius


def away_over(moving: Disk) -> Callable[[FloatArray, float, float], FloatArray]:
    """The same for all the disk sweeps from one time to another."""
    return lambda points, t0, t1: moving.path.swept_distance(Segment.point(points), t0, t1) - moving.radius


def point_robot(
    nodes: int = 61,
    steps: int = 4,
    *,
    delta: float = 0.2,
    u_max: float = 1.0,
    v_max: float = 0.25,
    input_levels: int = 3,
    target: Disk | None = None,
    obstacle: Disk | None = None,
) -> ReachAvoidProblem:
    """A point in the plane, dq/dt = u + v, that must reach a disk and avoid a moving one: the paper's game in two axes.

    Parameters
    ----------
    nodes, steps : int
        Nodes on each side of [-1, 1]^2 (walls), and N.
    delta : float
        Sampling interval, s.
    u_max, v_max : float
        Bounds of each component of the input and of the adversary, m/s.
    input_levels : int
        Samples of each input component; an odd number contains standing still.
    target, obstacle : Disk, optional
    """
    target = Disk(Still((0.45, 0.0)), 0.3) if target is None else target
    obstacle = Disk(Line((-0.15, -0.45), (0.0, 0.5)), 0.16) if obstacle is None else obstacle
    levels = np.linspace(-u_max, u_max, input_levels)
    inputs = np.stack(np.meshgrid(levels, levels, indexing="ij"), axis=-1).reshape(-1, 2)
    return ReachAvoidProblem(
        grid=canvas(nodes),
        dynamics=Dynamics(inputs, drift=inputs, gain=np.eye(2), bounds=np.array([v_max, v_max])),
        target=TargetSet((0, 1), away(target)),
        unsafe=(UnsafeSet((0, 1), away(obstacle), away_over(obstacle), name="obstacles"),),
        delta=delta,
        steps=steps,
        name="point robot",
    )


def holding(total: float = 0.8, counts: Sequence[int] = (1, 2, 4, 8), **numbers: float) -> dict[int, Table]:
    """The point robot's tables for one horizon cut into N = 1, 2, 4, ... intervals: the price of holding an input."""
    with warnings.catch_warnings(action="ignore", category=ResolutionWarning):  # how little is won is what is shown
        return {n: sdhj.solve(point_robot(steps=n, delta=total / n, **numbers), progress=False) for n in counts}


def one_interval(problem: ReachAvoidProblem, j: int, start: int = 0, within: int = 1) -> tuple[FloatArray, FloatArray]:
    """Reach set of S and avoid tube of G for one input over the interval from `start` (Definitions 2 and 3).

    S is what the table has for `within` - 1 steps to go one step later; level-set functions on the grid.
    """
    games = HJIGames(Samples(problem), Scheme())
    following = sdhj.solve(problem, progress=False).values(start=start + 1, within=within - 1)
    reach = next(values for i, values in games.reach(following, start) if i == j)
    grid = problem.grid
    tubes = [grid.lift(games.avoid(part, start)[j], Samples(problem).avoid_axes(part.axes)) for part in problem.unsafe]
    return np.array(reach), np.maximum.reduce([np.broadcast_to(tube, grid.shape) for tube in tubes])
