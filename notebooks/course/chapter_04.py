"""Chapter 4, One sampling interval: what it draws, its widgets, and the checks of its exercises."""

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import sdhj
from course.exercises import exercise, expect, expect_close
from course.paper import boat
from course.robots import point_robot
from course.widgets import Explorer, Numbers, choice, slider
from sdhj.common.remembering import FloatArray
from sdhj.plotting import draw_constraints, draw_set, draw_tubes, plane
from sdhj.plotting.looks import FULL_LOOKS, TARGET_LOOKS
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.table.batches import Table

# ---- pictures


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


# ---- widgets


def explore_interval(nodes: int = 49) -> Explorer:
    """A boat that holds a heading for one interval, in turning water and wind: solved and played at each change."""

    @lru_cache(maxsize=64)
    def solved(nodes: int, hold: float, wind: float, heading: float) -> boat.OneStepGame:
        u = (1.5 * math.cos(heading), 1.5 * math.sin(heading))
        return boat.one_step_game(boat.boat_problem(nodes=nodes, hold=hold, wind=wind, heading=u))

    def draw(figure: Figure, show: str, hold: float, wind: float, heading: float, x: float, y: float) -> Numbers:
        game, coarse = (solved(count, hold, wind, heading) for count in (nodes, nodes // 2 + 1))
        runs = boat.play(game.problem, (x, y))
        boat.draw_one_step(figure.subplots(), game, show=show, starts=[("$q$", runs)])
        q, won = np.array([[x, y]]), runs.costs <= 0
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
            "costliest run": float(runs.costs.max()),
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
    return Explorer(draw, controls, size=(6.6, 4.2), slow="solving", alt=alt, motion="wind", process="hold")


def explore_holding(nodes: int = 41) -> Explorer:
    """One horizon of 0.8 s cut into 1 to 20 intervals: what it costs to hold an input and not to look."""

    def draw(figure: Figure, intervals: int, v_max: float, input_levels: int) -> Numbers:
        problem = point_robot(nodes, intervals, delta=0.8 / intervals, v_max=v_max, input_levels=input_levels)
        table = sdhj.solve(problem, progress=False)
        ax = figure.subplots()
        draw_plane_game(ax, table)
        ax.set_title(f"{intervals} interval{'s' * (intervals > 1)} of {0.8 / intervals:.2f} s")
        return {
            "share of the square inside": table.fraction(start=0, within=intervals),
            "one-step games solved": len(problem.inputs) * intervals * (intervals + 1) // 2,
        }

    controls = {
        "intervals": slider("intervals in 0.8 s", 1, 20, 1, 4, live=False),
        "v_max": slider("adversary's speed (m/s)", 0.0, 0.9, 0.05, 0.25, live=False),
        "input_levels": slider("input levels on each axis", 2, 5, 1, 3, live=False),
    }
    return Explorer(draw, controls, size=(4.8, 3.9), slow="solving", alt="Tubes of the point robot", motion="intervals")


# ---- checks

HOLD, WIND = 0.6, 0.14  # s, m/s


@exercise("4.1", "How far is a corner of the square from its middle?")
def check_longest(longest):
    """0.3 / (sqrt(2) 0.25)."""
    expect(abs(longest - 1.2) > 1e-3, "the corners of the square are farther from its middle than its sides.")
    expect(abs(longest - 0.6) > 1e-3, "the square's half-side is 0.25 delta, not its side.")
    expect_close(longest, 0.3 / (0.25 * np.sqrt(2)), "the square's half-diagonal must not exceed 0.3 m.", within=1e-3)


@exercise(
    "4.2",
    "Which states left of the obstacle can still reach its left end, with the fastest velocity there is? None, "
    "if that is negative.",
)
def check_interval(in_danger):
    """[l - max(0, (u + v) delta), r - min(0, (u - v) delta)]."""
    rng = np.random.default_rng(0)
    for u in (-1.0, -0.2, 0.0, 0.2, 1.0):
        left, v_max, delta = rng.uniform(-1, 1), rng.uniform(0.0, 0.5), rng.uniform(0.1, 1.0)
        right = left + rng.uniform(0.05, 0.4)
        low, high = in_danger(left, right, u, v_max, delta)
        at = f"u = {u}, v_max = {v_max:.2f}"
        expect(low <= left + 1e-12 and high >= right - 1e-12, f"{at}: who starts inside the obstacle touches it.")
        wanted = left - max(0.0, (u + v_max) * delta), right - min(0.0, (u - v_max) * delta)
        expect_close(
            low, wanted[0], f"{at}: from the left it is met by who moves right fastest, or by who stands there."
        )
        expect_close(
            high, wanted[1], f"{at}: from the right it is met by who moves left fastest, or by who stands there."
        )


def _sail(start, winds, substeps=200):
    """States of the boat on its way, (T, 2), under a wind that is constant on equal parts of the interval."""
    q, h = np.array(start, dtype=np.float64), HOLD / (len(winds) * substeps)

    def f(q, v):
        return np.array([1.5 - 0.8 * q[1], 0.1 + 0.8 * q[0]]) + v

    states = [q]
    for v in np.asarray(winds, dtype=np.float64):
        for _ in range(substeps):
            k1 = f(q, v)
            k2 = f(q + h / 2 * k1, v)
            k3 = f(q + h / 2 * k2, v)
            q = q + h / 6 * (k1 + 2 * k2 + 2 * k3 + f(q + h * k3, v))
            states.append(q)
    return np.array(states)


def _clearance(q):
    return np.hypot(q[..., 0] - 0.05, q[..., 1] + 0.12) - 0.13


@exercise("4.3", "Draw the path without wind. One pair at full strength, towards the obstacle, is enough.")
def check_defeat(winds):
    """A wind within the bounds under which the boat hits or misses."""
    winds = np.atleast_2d(np.asarray(winds, dtype=np.float64))
    expect(winds.shape[1] == 2, "each part of the wind is a pair (v1, v2).")
    expect(np.abs(winds) <= WIND + 1e-12, f"the wind is at most {WIND} m/s along each axis.")
    path = _sail((-0.42, 0.03), winds)
    missed = np.hypot(path[-1, 0] - 0.55, path[-1, 1] - 0.30) - 0.42
    cost = max(missed, -_clearance(path).min())
    look = f"the boat wins this run, by {-cost:.3f} m. In which direction is the obstacle from its path?"
    expect(cost > 0, look)
    return f"The run costs {cost:.3f} m."


@exercise("4.4", "The boat moves about 0.9 m in an interval: start where the obstacle lies halfway.")
def check_passing(start):
    """Outside at both ends, whatever the wind; hit between."""
    start = np.asarray(start, dtype=np.float64)
    expect(start.shape == (2,), "a start is a pair (x, y).")
    expect(_clearance(start) > 0, "that start lies in the obstacle.")
    corners = [(a, b) for a in (-WIND, WIND) for b in (-WIND, WIND)]
    paths = [
        _sail(start, winds) for winds in [[corner] for corner in corners] + [[a, b] for a in corners for b in corners]
    ]
    expect(
        min(_clearance(path[-1]) for path in paths) > 0.005,
        "some wind leaves it in the obstacle, or nearly, at the end.",
    )
    expect(
        min(_clearance(path).min() for path in paths) < 0,
        "no wind that was tried makes it touch the obstacle on the way.",
    )


@exercise(
    "4.5",
    "For each heading the least and greatest velocity are drift - wind and drift + wind. Take the maximum with "
    "-obstacle after every time step, and the minimum over headings and the tube before.",
)
def check_boat(boat_tube):
    """Against the library's recursion."""
    problem = boat.boat_problem(nodes=61, hold=0.2)
    angles = np.pi / 4 * np.arange(8)
    headings = 1.5 * np.stack([np.cos(angles), np.sin(angles)], axis=1)

    def drift(points, u):
        return u + 0.8 * np.stack([-points[:, 1], points[:, 0]], axis=1)

    steered = sdhj.ReachAvoidProblem(
        grid=problem.grid,
        dynamics=sdhj.Dynamics(headings, drift, np.eye(2), np.array([WIND, WIND])),
        target=problem.target,
        unsafe=problem.unsafe,
        delta=0.2,
        steps=3,
    )
    table = sdhj.solve(steered, progress=False)
    x, y = problem.grid.points().T.reshape(2, *problem.grid.shape)
    shares = []
    for steps in range(4):
        got, wanted = np.asarray(boat_tube(x, y, steps)), table.values(start=0, within=steps)
        expect(got.shape == x.shape, "one value for each node of the lake.")
        inside, right = got <= 0, wanted <= 0
        at = f"within {steps} steps"
        if steps == 0:
            expect((inside == right).mean() > 0.99, f"{at}: the target, less the obstacle.")
        expect(~(inside & (_clearance(np.stack([x, y], axis=-1)) < 0)), f"{at}: it holds states inside the obstacle.")
        both, either = (inside & right).sum(), (inside | right).sum()
        much = "too much" if inside.sum() > right.sum() else "too little"
        look = "does the wind blow, and the water turn, in each step? Is the obstacle avoided on the way, too?"
        expect(both > 0.97 * either, f"{at}: {much} is won; it shares {both / either:.2f} of what either holds. {look}")
        shares.append(problem.grid.fraction(inside))
    return "Won of the lake: " + ", ".join(f"{share:.2f}" for share in shares) + " within 0 to 3 steps."
