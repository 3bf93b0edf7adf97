"""Small problems and small computations for the teaching notebooks: no grid of four axes, no drawing.

Everything a chapter needs beyond the library itself, so that a notebook holds prose and short calls only.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sdhj.arm.workspace import Disk, Line, Still
from sdhj.games import HJISolver
from sdhj.grid import FloatArray, Grid
from sdhj.problem import Dynamics, ReachAvoidProblem, TargetSet, UnsafeSet
from sdhj.recursion import solve
from sdhj.schemes import Scheme, Velocities, evolve
from sdhj.table import LookupTable

DIFFERENCES = ("left", "central", "right")
OPERATIONS = ("union", "intersection", "difference")

# ----------------------------------------------------------------------------------------------------------------------
# Sets as functions (Definition 5)
# ----------------------------------------------------------------------------------------------------------------------


def canvas(nodes: int = 81) -> Grid:
    """The square [-1, 1]^2 with `nodes` nodes on each side."""
    return Grid((-1.0, -1.0), (1.0, 1.0), (nodes, nodes), names=("x", "y"))


def disk(grid: Grid, centre: Sequence[float], radius: float) -> FloatArray:
    """Signed distance to a disk at the nodes of a plane grid; negative inside."""
    away = grid.points() - np.asarray(centre, dtype=np.float64)
    return (np.hypot(away[:, 0], away[:, 1]) - radius).reshape(grid.shape)


def rectangle(grid: Grid, centre: Sequence[float], half_sides: Sequence[float]) -> FloatArray:
    """A level-set function of a rectangle at the nodes of a plane grid: max of four planes, itself an intersection."""
    away = np.abs(grid.points() - np.asarray(centre, dtype=np.float64)) - np.asarray(half_sides, dtype=np.float64)
    return away.max(axis=1).reshape(grid.shape)


def combine(a: FloatArray, b: FloatArray, operation: str) -> FloatArray:
    """The level-set function of A with B: min, max, or max(a, -b) (below Definition 5).

    Raises
    ------
    ValueError
        For an unknown operation.
    """
    if operation not in OPERATIONS:
        raise ValueError(f"operation must be one of {', '.join(OPERATIONS)}, got {operation!r}")
    return {"union": np.minimum(a, b), "intersection": np.maximum(a, b), "difference": np.maximum(a, -b)}[operation]


def area(grid: Grid, values: FloatArray, fine: int = 1001) -> float:
    """Area of {values <= 0} on a plane grid, of the interpolant between the nodes, counted on fine^2 points."""
    x, y = (np.linspace(grid.lower[axis], grid.upper[axis], fine) for axis in (0, 1))
    points = np.stack([np.repeat(x, fine), np.tile(y, fine)], axis=1)
    whole = (grid.upper[0] - grid.lower[0]) * (grid.upper[1] - grid.lower[1])
    return float(np.mean(grid.interpolate(values, points) <= 0.0) * whole)


# ----------------------------------------------------------------------------------------------------------------------
# Upwinding (the Hamilton-Jacobi equation of Prop. 1 without an obstacle)
# ----------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Profile:
    """A function on a line that was carried along: nodes `x` (n,), values before and after, and time steps taken."""

    x: FloatArray
    start: FloatArray
    computed: FloatArray
    exact: FloatArray
    steps: int

    @property
    def error(self) -> float:
        """The largest difference from the exact profile."""
        return float(np.abs(self.computed - self.exact).max())


def _hat(x: FloatArray) -> FloatArray:
    """Level-set function of |x| <= 0.3 on the periodic line [-1, 1), capped so that it is flat far away."""
    wrapped = np.mod(x + 1.0, 2.0) - 1.0
    return np.clip(np.abs(wrapped) - 0.3, -0.2, 0.2)


def carry(
    difference: str = "right", *, nodes: int = 80, velocity: float = 1.0, duration: float = 0.4, cfl: float = 0.75
) -> Profile:
    """Solve d Phi / d tau = velocity * d Phi / dx on a periodic line with explicit Euler steps.

    The exact solution is Phi(x, tau) = s(x + velocity * tau): what x is worth comes from the side it moves to.

    Parameters
    ----------
    difference : {"left", "central", "right"}
        Which neighbours the derivative is taken from.
    nodes : int
        On the line [-1, 1).
    velocity, duration : float
        m/s and s.
    cfl : float
        The length of a step in units of spacing / |velocity|.

    Raises
    ------
    ValueError
        For an unknown difference.
    """
    if difference not in DIFFERENCES:
        raise ValueError(f"difference must be one of {', '.join(DIFFERENCES)}, got {difference!r}")
    x = -1.0 + 2.0 / nodes * np.arange(nodes)
    spacing = 2.0 / nodes
    steps = max(1, int(np.ceil(duration * abs(velocity) / (spacing * cfl) - 1e-9)))
    start = _hat(x)
    values = start.copy()
    for _ in range(steps):
        left, right = values - np.roll(values, 1), np.roll(values, -1) - values
        slope = {"left": left, "central": (left + right) / 2, "right": right}[difference] / spacing
        values = values + duration / steps * velocity * slope
    return Profile(x, start, values, _hat(x + velocity * duration), steps)


@dataclass(frozen=True)
class Shrunk:
    """A disk to be reached, carried back through one interval: computed and exact values, each (nodes, nodes)."""

    grid: Grid
    start: FloatArray
    computed: FloatArray
    exact: FloatArray
    steps: int

    @property
    def mean_error(self) -> float:
        """Mean error at the nodes near the boundary, abs(Phi) < 0.3, away from the walls."""
        near = (np.abs(self.exact) < 0.3) & (np.abs(self.grid.points()).max(axis=1) < 1.2).reshape(self.grid.shape)
        return float(np.abs(self.computed - self.exact)[near].mean())

    @property
    def wrongly_inside(self) -> int:
        """Nodes that the scheme calls winning and the exact solution does not."""
        return int(np.count_nonzero((self.computed <= 0) & (self.exact > 0)))


def shrink(
    nodes: int = 41,
    scheme: Scheme | None = None,
    *,
    velocity: Sequence[float] = (1.0, 0.5),
    adversary: float = 0.3,
    duration: float = 0.5,
) -> Shrunk:
    """Game 3 for one input in the plane: from where is a disk reached, whatever |v|_inf <= `adversary` does?

    dq/dt = velocity + v, and the exact cost is the largest distance from the disk over the box of places to end in.
    """
    scheme = Scheme(frame="fixed", dtype="float64") if scheme is None else scheme
    grid = Grid((-1.5, -1.5), (1.5, 1.5), (nodes, nodes), names=("x", "y"))
    u, b = np.asarray(velocity, dtype=np.float64), np.full(2, adversary)
    rates = Velocities(u - b, u + b)
    start = disk(grid, (0.3, 0.15), 0.6)
    away = np.abs(grid.points() + u * duration - np.array([0.3, 0.15])) + adversary * duration
    exact = (np.hypot(away[:, 0], away[:, 1]) - 0.6).reshape(grid.shape)
    return Shrunk(
        grid, start, evolve(grid, start, rates, duration, scheme), exact, rates.steps(grid, duration, scheme.cfl)
    )


# ----------------------------------------------------------------------------------------------------------------------
# Robots small enough to solve at once
# ----------------------------------------------------------------------------------------------------------------------


def _away(moving: Disk) -> Callable[[FloatArray, float], FloatArray]:
    return lambda points, t: np.linalg.norm(points - moving.centre(t), axis=1) - moving.radius


def _away_over(moving: Disk) -> Callable[[FloatArray, float, float], FloatArray]:
    return lambda points, t0, t1: moving.path.swept_distance(points, points, t0, t1) - moving.radius


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
        target=TargetSet((0, 1), _away(target)),
        unsafe=(UnsafeSet((0, 1), _away(obstacle), _away_over(obstacle), rate=obstacle.speed, name="obstacles"),),
        delta=delta,
        steps=steps,
        name="point robot",
    )


def holding(total: float = 0.8, counts: Sequence[int] = (1, 2, 4, 8), **numbers: float) -> dict[int, LookupTable]:
    """The point robot's tables for one horizon cut into N = 1, 2, 4, ... intervals: the price of holding an input."""
    return {n: solve(point_robot(steps=n, delta=total / n, **numbers), progress=False) for n in counts}  # type: ignore[arg-type]


def car(
    nodes: Sequence[int] = (33, 33, 32),
    steps: int = 5,
    *,
    delta: float = 0.25,
    speed: float = 1.0,
    turn: float = 2.0,
    wind: float = 0.15,
    target: Disk | None = None,
    obstacle: Disk | None = None,
) -> ReachAvoidProblem:
    """A car that cannot drive sideways: state (x, y, heading), dx/dt = speed * (cos, sin) + wind, dheading/dt = u.

    It has to reach a disk past a post. The edge of the map is unsafe: the grid ends there, the car would not.

    Parameters
    ----------
    nodes : 3 int
    steps : int
    delta : float
        Sampling interval, s.
    speed, turn, wind : float
        m/s, rad/s, and the bound of each component of the wind, m/s.
    """
    target = Disk(Still((0.55, 0.0)), 0.25) if target is None else target
    obstacle = Disk(Still((0.0, 0.0)), 0.18) if obstacle is None else obstacle

    def drift(q: FloatArray, u: FloatArray) -> FloatArray:
        return np.stack([speed * np.cos(q[:, 2]), speed * np.sin(q[:, 2]), np.full(len(q), u[0])], axis=1)

    def off_the_map(q: FloatArray, t: float) -> FloatArray:
        return 0.95 - np.abs(q).max(axis=1)

    return ReachAvoidProblem(
        grid=Grid((-1.0, -1.0, -np.pi), (1.0, 1.0, np.pi), nodes, (False, False, True), ("x", "y", "heading")),
        dynamics=Dynamics(
            inputs=np.array([[-turn], [0.0], [turn]]),
            drift=drift,
            gain=np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]]),
            bounds=np.array([wind, wind]),
        ),
        target=TargetSet((0, 1), _away(target)),
        unsafe=(UnsafeSet((0, 1), _away(obstacle), name="obstacles"), UnsafeSet((0, 1), off_the_map, name="edge")),
        delta=delta,
        steps=steps,
        name="car",
    )


def one_interval(problem: ReachAvoidProblem, j: int, start: int = 0, within: int = 1) -> tuple[FloatArray, FloatArray]:
    """Reach set of S and avoid tube of G for one input over the interval from `start` (Definitions 2 and 3).

    S is what the table has for `within` - 1 steps to go one step later; level-set functions on the grid.
    """
    scheme = Scheme()
    solver = HJISolver(problem, scheme)
    following = solve(problem, progress=False).values(start=start + 1, within=within - 1)
    reach = next(values for i, values in solver.reach(following) if i == j)
    grid = problem.grid
    avoid = np.maximum.reduce(
        [np.broadcast_to(grid.lift(solver.avoid(part, start)[j], part.axes), grid.shape) for part in problem.unsafe]
    )
    return np.array(reach), avoid


# ----------------------------------------------------------------------------------------------------------------------
# View-time (Sec. 5.4 and 6.2.1)
# ----------------------------------------------------------------------------------------------------------------------


def union_of_samples(part: UnsafeSet, points: FloatArray, t0: float, t1: float, samples: int) -> FloatArray:
    """Union of a moving unsafe set at `samples` times of [t0, t1]: the paper's view-time, any number of samples."""
    times = np.linspace(t0, t1, samples) if samples > 1 else np.array([t0])
    return np.minimum.reduce([part.level_set(points, float(t)) for t in times])
