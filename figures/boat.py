"""One sampling interval in the plane: reach set, avoid tube, the game, its cost, and runs (Figs. 6 and 7).

A boat on a lake whose water turns: its state is where it is, its input a velocity that it holds over the interval, the
adversary a wind. With two axes, one input and one interval every construct of Sec. 3.4 and 4.1 is a picture.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from sdhj.common.remembering import FloatArray
from sdhj.plotting.looks import FULL_LOOKS, INK, OUTCOME_INK, UNSAFE_LOOKS, patch
from sdhj.plotting.slices import Plane, draw_constraints, draw_set, plane
from sdhj.problem.dynamics import Dynamics
from sdhj.problem.grid import Grid
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.samples import Samples
from sdhj.problem.sets import TargetSet, UnsafeSet
from sdhj.solver.games import HJIGames
from sdhj.solver.joint import JointGames
from sdhj.solver.schemes import Scheme

SIDE = 1.2  # the lake is [-SIDE, SIDE]^2, m
PIECES = 4  # the wind in a rollout changes at most at these many equal parts of the interval
SUBSTEPS = 10  # Runge-Kutta steps in each part
STARTS = (("$q$", (-0.42, 0.30)), ("$q'$", (-0.42, 0.03)), ("$q''$", (-0.60, 0.68)))  # won, blocked, too far
CONSTRUCTS = ("reach", "avoid", "reach-avoid")
WIN, THIN_WIN, THIN_LOSS = "#12492f", "#5f9b7d", "#d59a70"
OUTLINE = {"facecolor": "none", "edgecolor": "#0b3c5d", "linewidth": 1.0, "linestyle": (0, (5, 2))}


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

    def drift(points: FloatArray, u: FloatArray) -> FloatArray:
        return u + turn * np.stack([-points[:, 1], points[:, 0]], axis=1)

    def disk(x: float, y: float, radius: float) -> Callable[[FloatArray, float], FloatArray]:
        return lambda points, t: np.hypot(points[:, 0] - x, points[:, 1] - y) - radius

    return ReachAvoidProblem(
        grid=Grid((-SIDE, -SIDE), (SIDE, SIDE), (nodes, nodes), names=("x", "y"), ends="wall"),
        dynamics=Dynamics([heading], drift, np.eye(2), np.array([wind, wind])),
        target=TargetSet((0, 1), disk(*target)),
        unsafe=(UnsafeSet((0, 1), disk(*obstacle)),),
        delta=hold,
        steps=1,
        name="boat",
    )


def one_step_game(problem: ReachAvoidProblem, scheme: Scheme | None = None) -> OneStepGame:
    """Solve the games of App. A.3 and the one of Prop. 1 for the first input of a problem over its first interval."""
    scheme = Scheme() if scheme is None else scheme
    games = HJIGames(Samples(problem), scheme)
    goal = problem.grid.points()
    shape = problem.grid.shape
    s = problem.target_value(goal, problem.time(1)).reshape(shape)
    reach = next(values for _, values in games.reach(s, 0))
    avoid = np.maximum.reduce([games.avoid(part, 0)[0] for part in problem.unsafe])
    cost = next(values for _, values in JointGames(Samples(problem), scheme).reach(s, 0))
    return OneStepGame(problem, np.array(reach), avoid, np.array(cost))


@cache
def shown_game() -> OneStepGame:
    """The game of Figs. 6 and 7."""
    return one_step_game(boat_problem())


def winds(problem: ReachAvoidProblem, count: int, seed: int) -> FloatArray:
    """Adversarial signals (M, PIECES, D): every vertex held throughout, then `count` that pick one for each part."""
    bounds = problem.dynamics.bounds_at()
    signs = np.stack(np.meshgrid(*[(-1.0, 1.0)] * bounds.size, indexing="ij"), axis=-1).reshape(-1, bounds.size)
    held = np.repeat(signs[:, None], PIECES, axis=1)
    picks = np.random.default_rng(seed).integers(len(signs), size=(count, PIECES))
    return np.concatenate([held, signs[picks]]) * bounds


def play(problem: ReachAvoidProblem, start: Sequence[float], *, count: int = 60, seed: int = 0) -> Rollouts:
    """Run the true dynamics under the first input from `start` against every wind of `winds`, and price each run."""
    signals = winds(problem, count, seed)
    state = np.tile(np.asarray(start, dtype=np.float64), (len(signals), 1))
    held, interval, h = np.zeros(len(signals), np.int64), problem.interval(0), problem.delta / (PIECES * SUBSTEPS)
    path = [state]
    for v in np.repeat(signals, SUBSTEPS, axis=1).swapaxes(0, 1):
        state = interval.advance(state, held, v, 0.0, h)
        path.append(state)
    paths = np.stack(path, axis=1)
    times = np.linspace(0.0, problem.delta, paths.shape[1])
    missed = problem.target_value(paths[:, -1], problem.delta)
    hit = np.max([-problem.unsafe_value(paths[:, k], float(t)) for k, t in enumerate(times)], axis=0)
    return Rollouts(times, paths, np.maximum(missed, hit))


# --------------------------------------------------------------------------------------------------------------------
# Pictures
# --------------------------------------------------------------------------------------------------------------------


def draw_lake(ax: Axes, game: OneStepGame, *, unsafe: bool = True) -> Plane:
    """Target, unsafe set and axes in metres; returns the slice."""
    parts = None if unsafe else [game.problem.target.name]
    draw_constraints(ax, game.problem, through=(0.0, 0.0), step=1, parts=parts)
    ax.set(xlim=(-0.9, 1.05), ylim=(-0.5, 0.85), xlabel="$x$ (m)", ylabel="$y$ (m)", aspect="equal")
    return plane(game.problem.grid, (0.0, 0.0), resolution=201)


def draw_rollouts(ax: Axes, rollouts: Rollouts, label: str) -> None:
    """Runs from one state against many winds: the worst one bold, red and dashed if the robot loses it."""
    for path, cost in zip(rollouts.paths, rollouts.costs, strict=True):
        ax.plot(*path.T, color=THIN_WIN if cost <= 0 else THIN_LOSS, linestyle="-", linewidth=0.4, zorder=5)
    worst, lost = rollouts.paths[rollouts.worst], rollouts.costs.max() > 0
    colour, dashes, end, gid = (OUTCOME_INK, (0, (4, 1.2)), "X", "defeat") if lost else (WIN, "-", "o", "win")
    ax.plot(*worst.T, color=colour, linestyle=dashes, linewidth=1.5, zorder=6, gid=gid)
    ax.plot(*worst[-1], marker=end, color=colour, markersize=5, zorder=7)
    ax.plot(*worst[0], "o", color=INK, markersize=4.5, zorder=7, gid="start")
    ax.annotate(label, worst[0], (2, -5), textcoords="offset points", ha="center", va="top", zorder=8, fontsize=9)


def draw_one_step(
    ax: Axes, game: OneStepGame, *, show: str = "reach", starts: Sequence[tuple[str, Rollouts]] = ()
) -> None:
    """A construct of one interval and runs that show why states are in it or not (Figs. 6 and 7).

    `show` is one of `CONSTRUCTS`, ValueError otherwise; with "reach" the unsafe set plays no part and is left out.
    """
    if show not in CONSTRUCTS:
        raise ValueError(f"construct must be one of {', '.join(CONSTRUCTS)}, got {show!r}")
    values = {"reach": game.reach, "avoid": game.avoid, "reach-avoid": game.cost}[show]
    where = draw_lake(ax, game, unsafe=show != "reach")
    draw_set(ax, where, where.of(game.problem.grid, values), FULL_LOOKS, show, zorder=1.0)
    if show == "reach-avoid":  # what the reach set was without the obstacle
        draw_set(ax, where, where.of(game.problem.grid, game.reach), OUTLINE, "reach", zorder=1.6)
    for label, rollouts in starts:
        draw_rollouts(ax, rollouts, label)


def one_step_legend(show: str) -> list[Patch | Line2D]:
    """Legend entries of `draw_one_step`."""
    names = {"reach": r"reach set $\underline{\mathcal{R}}_k^j(\mathcal{S})$", "avoid": r"avoid tube $\mathcal{A}_k^j$"}
    shown = names.get(show, r"reach-avoid set, $V^j \leq 0$")
    entries: list[Patch | Line2D] = [
        Patch(**FULL_LOOKS, label=shown),
        patch("target", r"$\mathcal{S}$, to be in at $t_{k+1}$"),
    ]
    if show != "reach":
        entries.append(Patch(**UNSAFE_LOOKS, label=r"unsafe $\mathcal{G}$"))
    if show == "reach-avoid":
        entries.append(Line2D([], [], color="#0b3c5d", linestyle=(0, (5, 2)), linewidth=1.0, label="reach set alone"))
    entries.append(Line2D([], [], color=WIN, linestyle="-", marker="o", label="worst run, the robot wins"))
    entries.append(Line2D([], [], color=OUTCOME_INK, linestyle=(0, (4, 1.2)), marker="X", label="defeating run"))
    entries.append(Line2D([], [], color=THIN_WIN, linestyle="-", linewidth=0.8, label="runs against other winds"))
    return entries
