"""One sampling interval: the boat's games, and a point robot that must hold its input. Chapters 7 and 15 use both."""

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache

import numpy as np
from chapter_01 import canvas
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from paper import boat
from widgets import Explorer, Numbers, choice, slider

import sdhj
from sdhj.arm.workspace import Disk, Line, Still
from sdhj.kernels import FloatArray
from sdhj.plotting import draw_constraints, draw_set, draw_tubes, plane
from sdhj.plotting.looks import FULL_LOOKS, TARGET_LOOKS
from sdhj.problem.problem import Dynamics, ReachAvoidProblem
from sdhj.problem.sets import TargetSet, UnsafeSet
from sdhj.solver.games import HJIGames
from sdhj.solver.resolution import ResolutionWarning
from sdhj.solver.schemes import Scheme
from sdhj.table.batches import Table


def away(moving: Disk) -> Callable[[FloatArray, float], FloatArray]:
    """The distance from a disk that moves, as a level-set function of the place."""
    return lambda points, t: np.linalg.norm(points - moving.centre(t), axis=1) - moving.radius


def away_over(moving: Disk) -> Callable[[FloatArray, float, float], FloatArray]:
    """The same for all the disk sweeps from one time to another."""
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
        target=TargetSet((0, 1), away(target)),
        unsafe=(UnsafeSet((0, 1), away(obstacle), away_over(obstacle), rate=obstacle.speed, name="obstacles"),),
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
    games = HJIGames(problem, Scheme())
    following = sdhj.solve(problem, progress=False).values(start=start + 1, within=within - 1)
    reach = next(values for i, values in games.reach(following, start) if i == j)
    grid = problem.grid
    tubes = [grid.lift(games.avoid(part, start)[j], problem.avoid_axes(part)) for part in problem.unsafe]
    return np.array(reach), np.maximum.reduce([np.broadcast_to(tube, grid.shape) for tube in tubes])


def draw_plane_game(
    ax: Axes, table: Table, *, start: int = 0, within: int | None = None, through: Sequence[float] | None = None
) -> None:
    """Tubes of a robot with two axes of position, its target and its obstacle where they are at step `start`."""
    state = np.zeros(table.grid.ndim) if through is None else np.asarray(through, dtype=np.float64)
    draw_tubes(ax, table, through=state, start=start, within=within, unsafe=False)
    shown = [part.name for part in table.problem.unsafe if part.name != "edge"]
    draw_constraints(ax, table.problem, through=state, step=start, parts=shown)
    where = plane(table.grid, state, resolution=201)
    target = table.problem.target
    goal = where.shaped(target.level_set(where.points[:, target.axes], start * table.problem.delta))
    draw_set(ax, where, goal, TARGET_LOOKS | {"facecolor": "none"}, "target", zorder=5.0)
    ax.set_aspect("equal")


def draw_plane_games(figure: Figure, tables: Mapping[str, Table]) -> None:
    """Tubes of several games in the plane, side by side, from step 0."""
    axes = np.atleast_1d(figure.subplots(1, len(tables), sharey=True))
    for ax, (title, table) in zip(axes, tables.items(), strict=True):
        draw_plane_game(ax, table)
        ax.set_title(title)
    for ax in axes[1:]:
        ax.set_ylabel("")


def draw_safe_twice(ax: Axes, problem: ReachAvoidProblem, at_instants: FloatArray, always: FloatArray) -> None:
    """States of the boat that are safe at both ends of the interval (blue), and those of them that are hit between."""
    where = boat.draw_lake(ax, boat.OneStepGame(problem, at_instants, always, always))
    instants, tube = where.of(problem.grid, at_instants), where.of(problem.grid, always)
    draw_set(ax, where, instants, FULL_LOOKS, "at-instants", zorder=0.5)
    between = np.maximum(instants, -tube)
    draw_set(
        ax, where, between, {"facecolor": "#d9480f", "edgecolor": "#8a2b06", "linewidth": 0.8}, "between", zorder=0.8
    )


def explore_interval(nodes: int = 49) -> Explorer:
    """A boat that holds a heading for one interval, in turning water and wind: solved and played at each change."""

    @lru_cache(maxsize=64)
    def solved(nodes: int, hold: float, wind: float, heading: float) -> boat.OneStepGame:
        u = (1.5 * math.cos(heading), 1.5 * math.sin(heading))
        return boat.one_step_game(boat.boat_problem(nodes=nodes, hold=hold, wind=wind, heading=u))

    def draw(figure: Figure, show: str, hold: float, wind: float, heading: float, x: float, y: float) -> Numbers:
        game, coarse = (solved(count, hold, wind, heading) for count in (nodes, nodes // 2 + 1))
        played = boat.play(game.problem, (x, y))
        boat.draw_one_step(figure.subplots(), game, show=show, starts=[("$q$", played)])
        q, won = np.array([[x, y]]), played.costs <= 0
        cost, rough = (float(one.problem.grid.interpolate(one.cost, q)[0]) for one in (game, coarse))
        values, name = {
            "reach": (game.reach, "reach set"),
            "avoid": (game.avoid, "avoid tube"),
            "reach-avoid": (game.cost, "reach-avoid set"),
        }[show]
        return {
            f"share of the lake in the {name}": game.problem.grid.fraction(values <= 0),
            "cost of q, Eq. (6)": cost,
            "on half the nodes": rough,
            "dearest run": float(played.costs.max()),
            "runs won": f"{int(won.sum())} of {won.size}",
        }

    controls = {
        "show": choice("show", boat.CONSTRUCTS, "reach-avoid"),
        "hold": slider("length of the interval (s)", 0.1, 0.9, 0.05, 0.6, live=False),
        "wind": slider("wind, at most (m/s)", 0.0, 0.5, 0.02, 0.14, live=False),
        "heading": slider("heading held (rad)", -1.0, 1.0, 0.05, 0.05, live=False),
        "x": slider("start x (m)", -0.9, 0.6, 0.02, -0.4),
        "y": slider("start y (m)", -0.5, 0.8, 0.02, 0.2),
    }
    alt = "Reach-avoid set of one interval with runs against many winds"
    return Explorer(draw, controls, size=(6.6, 4.2), slow=True, alt=alt, motion="wind")


def explore_holding(nodes: int = 41) -> Explorer:
    """One horizon of 0.8 s cut into 1 to 8 intervals: what it costs to hold an input and not to look."""

    def draw(figure: Figure, intervals: int, v_max: float, input_levels: int) -> Numbers:
        problem = point_robot(nodes, intervals, delta=0.8 / intervals, v_max=v_max, input_levels=input_levels)
        table = sdhj.solve(problem, progress=False)
        ax = figure.subplots()
        draw_plane_game(ax, table)
        ax.set_title(f"{intervals} intervals of {0.8 / intervals:.2f} s")
        return {
            "share of the square inside": table.fraction(start=0, within=intervals),
            "one-step games solved": len(problem.inputs) * intervals * (intervals + 1) // 2,
        }

    controls = {
        "intervals": slider("intervals in 0.8 s", 1, 8, 1, 4, live=False),
        "v_max": slider("adversary's speed (m/s)", 0.0, 0.9, 0.05, 0.25, live=False),
        "input_levels": slider("input levels on each axis", 2, 5, 1, 3, live=False),
    }
    return Explorer(draw, controls, size=(4.8, 3.9), slow=True, alt="Tubes of the point robot", motion="intervals")
