"""The controller against the adversary: runs to play and to step through. Chapters 12 and 14 too."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from live_slices import (
    HERE,
    LIVE,
    POSTURE,
    around,
    colours_of,
    draw_arm_live,
    draw_pixels,
    draw_sets_quickly,
    fewest_steps,
    here,
    slice_values,
    steps_image,
)
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from widgets import Explorer, Numbers, agent_sliders, angle, choice, played, slider

import sdhj
from sdhj.arm.case_studies import scene
from sdhj.kernels import FloatArray
from sdhj.plotting import draw_path, plane
from sdhj.plotting.looks import FULL_LOOKS, OUTCOME_INK
from sdhj.plotting.trajectories import WAY
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.simulation.adversaries import Adversary, Moment
from sdhj.simulation.runs import SUBSTEPS
from sdhj.table.batches import Table


def explore_run(
    table: Table,
    states: Sequence[Sequence[float]],
    *,
    adversaries: Sequence[str] = ("none", "random", "aggressive", "worst"),
    rules: Sequence[str] | Mapping[str, Any] = ("deepest",),
) -> Explorer:
    """Play and step through a run from one of `states` against an adversary of your choice; rules by their names."""
    given = dict(rules) if isinstance(rules, Mapping) else {rule: rule for rule in rules}
    controllers = {name: sdhj.Controller(table, rule=rule) for name, rule in given.items()}

    @lru_cache(maxsize=64)
    def run(number: int, adversary: str, rule: str, seed: int) -> Any:
        one = sdhj.simulate(
            controllers[rule], np.asarray(states[number], dtype=np.float64), adversary=adversary, seed=seed
        )
        return one, _closest(table.problem, one)

    def draw(figure: Figure, number: int, adversary: str, rule: str, seed: int, moment: float) -> Numbers:
        one, cost = run(number, adversary, rule, seed)
        index = round(moment / 100 * (len(one.times) - 1))
        draw_live_moment(figure.subplots(1, 2), table, one, index)
        return {
            "time (s)": float(one.times[index]),
            "outcome": one.outcome,
            "steps taken": len(one.inputs),
            "cost so far": float(cost[index]),
        }

    controls = {
        "number": slider("initial state", 0, len(states) - 1, 1, 0)
        if len(states) > 1
        else choice("initial state", (0,), 0),
        "adversary": choice("adversary", adversaries, adversaries[-1]),
        "rule": choice("rule", tuple(given), next(iter(given))),
        "seed": slider("seed of the random adversary", 0, 9, 1, 0),
        "moment": played(slider("progress of the run (%)", 0, 100, 4, 60)),
    }

    def idle(adversary: str, **_: Any) -> tuple[str, ...]:
        return () if adversary == "random" else ("seed",)  # the others draw nothing

    return Explorer(draw, controls, size=(8.2, 3.7), alt="One moment of a run", motion="moment", idle=idle)


def draw_live_moment(axes: Sequence[Axes], table: Table, run: Any, index: int, *, tube: bool = True) -> None:
    """As `sdhj.plotting.draw_moment`, without formulas and hatching; the whole run is there, faint."""
    (left, right), problem = axes, table.problem
    state, time = run.states[index], float(run.times[index])
    step = min(int(time / problem.delta + 1e-6), max(len(run.inputs) - 1, 0))
    n = int(run.steps_to_go[step]) if len(run.inputs) else 0
    draw_arm_live(left, problem, state, time)
    left.set_title(f"t = {time:.2f} s, step {step}")
    if tube:
        where = plane(problem.grid, state, resolution=LIVE)
        goal = {"start": step + 1, "within": max(n - 1, 0)} if len(run.inputs) else {"start": 0, "within": 0}
        inside = slice_values(problem.grid, table.values(**goal), state, (0, 1), where.x, where.y) <= 0
        image = np.array([(1.0, 1.0, 1.0, 0.0), to_rgba(FULL_LOOKS["facecolor"])])[inside.astype(int)]
        draw_pixels(right, image, around(where.x, where.y), "tube")
    draw_sets_quickly(right, problem, through=state, step=time / problem.delta, resolution=81)
    draw_way((left, right), problem, run)
    done = run.states[: index + 1]
    left.plot(*scene(problem).arm.tip(done[:, :2]).T, zorder=6, gid="tip-path", **WAY)
    draw_path(right, problem.grid, done)
    right.plot(*here(problem.grid, state), **HERE)
    right.set_title(f"{n} step{'' if n == 1 else 's'} to go" if index < len(run.times) - 1 else run.outcome)


def draw_way(axes: Sequence[Axes], problem: ReachAvoidProblem, run: Any) -> None:
    """The whole run, faint, over the pictures of one moment: which run it is shows at every moment."""
    left, right = axes
    tips = scene(problem).arm.tip(run.states[:, :2])
    looks = {"color": OUTCOME_INK, "linewidth": 0.8, "alpha": 0.45, "zorder": 5.5}
    left.plot(*tips.T, linestyle="-", gid="whole-tip-path", **looks)
    left.plot(*run.states[:, 2:4].T, linestyle=":", gid="whole-agent-path", **looks | {"color": "black"})
    draw_path(right, problem.grid, run.states, gid="whole-path", **looks)


def _closest(problem: ReachAvoidProblem, played: Any) -> FloatArray:
    """The least clearance up to each time, m, negated: positive after a collision (the second term of Eq. (5))."""
    clearances = [
        problem.unsafe_value(state[None], float(t))[0] for state, t in zip(played.states, played.times, strict=True)
    ]
    return -np.minimum.accumulate(clearances)


# ----------------------------------------------------------------------------------------------------------------------
# The look-up table, live (Fig. 8)
# ----------------------------------------------------------------------------------------------------------------------

CELL = 45  # points along each side of a cell
GAP = 5  # points between two cells
BARE = (1.0, 1.0, 1.0, 0.0)


def row_image(table: Table, state: Sequence[float], start: int) -> tuple[FloatArray, int | None]:
    """Row `start` of the table as one picture of cells, and the column of the leftmost set that holds the state."""
    most, grid, colours = table.steps - start, table.grid, colours_of(table.steps)
    fewest = steps_image(table, through=state, start=start, within=most, resolution=CELL)
    where = plane(grid, state, resolution=CELL)
    unsafe = where.shaped(table.problem.unsafe_value(where.points, table.problem.time(start))) <= 0
    image = np.full((CELL + GAP, (table.steps + 1) * (CELL + GAP), 4), BARE)
    for n in range(most + 1):
        cell = np.where(unsafe[..., None], (0.91, 0.91, 0.91, 1.0), (0.985, 0.985, 0.985, 1.0))
        cell[fewest <= n] = colours[n]
        image[:CELL, n * (CELL + GAP) : n * (CELL + GAP) + CELL] = cell
    held = fewest_steps(table, state, start, most)
    return image, None if np.isnan(held) else int(held)


def draw_rows(ax: Axes, table: Table, states: Mapping[int, Sequence[float]]) -> dict[int, int | None]:
    """Rows of the look-up table from the top down, each through a state, which is dotted; its set is framed."""
    found, images, grid, side = {}, [], table.grid, CELL + GAP
    for place, (start, state) in enumerate(states.items()):
        image, found[start] = row_image(table, state, start)
        images.insert(0, image)
        bottom = -(place + 1) * side
        dot = (here(grid, state) - grid.lower[:2]) / (np.array(grid.upper[:2]) - grid.lower[:2]) * CELL
        columns = side * np.arange(table.steps - start + 1)
        looks = HERE | {"linestyle": "none", "markersize": 3.2, "markeredgewidth": 0.4}
        ax.plot(columns + dot[0], np.full(len(columns), bottom + dot[1]), **looks)
        if (n := found[start]) is not None:
            looks = {"facecolor": "none", "edgecolor": OUTCOME_INK, "linewidth": 1.8, "gid": f"frame-{start}"}
            ax.add_patch(Rectangle((n * side, bottom), CELL, CELL, zorder=6.0, **looks))
    draw_pixels(ax, np.concatenate(images), (0, (table.steps + 1) * side, -len(images) * side, 0), "rows")
    ax.set(xlim=(-1, (table.steps + 1) * side), ylim=(-len(states) * side - 2, 1), aspect="equal")
    # labels of rows and columns as ticks, which a live figure draws once
    ax.set_yticks(-side * np.arange(len(states)) - GAP - CELL / 2, [f"k = {start}" for start in states])
    ax.set_xticks(side * np.arange(table.steps + 1) + CELL / 2, [f"n = {n}" for n in range(table.steps + 1)])
    ax.tick_params(length=0, top=False, labeltop=True, labelbottom=False)
    ax.spines[:].set_visible(False)
    return found


def explore_lookup(table: Table) -> Explorer:
    """The whole look-up table for one state: which set of each row is the leftmost that holds it (Fig. 8)."""

    def draw(figure: Figure, **state: float) -> Numbers:
        q = [state[name] for name in ("q1", "q2", "px", "py")]
        found = draw_rows(figure.subplots(), table, dict.fromkeys(range(table.steps + 1), q))
        return {f"steps to go from step {k}": "none" if n is None else n for k, n in found.items() if k % 2 == 0}

    controls = {
        **agent_sliders(table.problem),
        "q1": angle("joint angle q1 (rad)", POSTURE[0]),
        "q2": angle("joint angle q2 (rad)", POSTURE[1]),
    }
    return Explorer(
        draw, controls, size=(6.6, 6.9), alt="The look-up table, the leftmost set of each row framed", motion="q1"
    )


def running_at(aim: Sequence[float], disturbance: str) -> Adversary:
    """A pursuer that runs straight at a place, and a disturbance of the joints: "none", "random" or "steady"."""

    def play(moment: Moment) -> FloatArray:
        v = np.zeros_like(moment.previous)
        v[:, 2:] = (np.asarray(aim) - moment.states[:, 2:]) / moment.duration
        if disturbance == "steady":
            v[:, :2] = moment.bounds[:, :2]
        elif disturbance == "random" and moment.substep:
            v[:, :2] = moment.previous[:, :2]
        elif disturbance == "random":
            v[:, :2] = moment.rng.uniform(-1, 1, (len(v), 2)) * moment.bounds[:, :2]
        return np.clip(v, -moment.bounds, moment.bounds)

    return play


def explore_pursuit(table: Table, states: Sequence[Sequence[float]]) -> Explorer:
    """A run with the pursuer where you send it, and the row of the table at the moment shown (Figs. 8, 10 and 12)."""
    controller = sdhj.Controller(table)

    @lru_cache(maxsize=64)
    def run(number: int, x: float, y: float, disturbance: str) -> Any:
        start = np.asarray(states[number], dtype=np.float64)
        return sdhj.simulate(controller, start, adversary=running_at((x, y), disturbance), seed=0)

    def draw(figure: Figure, number: int, x: float, y: float, disturbance: str, moment: int) -> Numbers:
        one = run(number, x, y, disturbance)
        index = round(moment / 100 * (len(one.times) - 1))
        step = min(index // SUBSTEPS, table.steps)
        grid = figure.add_gridspec(2, 2, height_ratios=(1.0, 0.36))
        left, right, below = (figure.add_subplot(grid[place]) for place in ((0, 0), (0, 1), (1, slice(None))))
        state, time = one.states[index], float(one.times[index])
        draw_live_moment((left, right), table, one, index, tube=False)
        left.plot(x, y, "x", color=OUTCOME_INK, markersize=7, zorder=7)
        right.set_title("the joints' way (Fig. 12b)")
        measured = one.states[step * SUBSTEPS]
        found = draw_rows(below, table, {step: measured})
        return {
            "time (s)": time,
            "outcome": one.outcome,
            "steps to go at this step": "none" if found[step] is None else found[step],
            "clearance now (m)": float(table.problem.unsafe_value(state[None], time)[0]),
        }

    controls = {
        "number": slider("initial state", 0, len(states) - 1, 1, 0),
        **{
            name: slider(f"pursuer runs at {name} (m)", -0.36, 0.36, 0.02, value)
            for name, value in (("x", 0.06), ("y", 0.2))
        },
        "disturbance": choice("disturbance of the joints", ("none", "random", "steady"), "random"),
        "moment": played(slider("progress of the run (%)", 0, 100, 4, 48)),
    }
    alt = "A run with the pursuer where you send it, and its table row"
    return Explorer(draw, controls, size=(6.4, 4.1), alt=alt, motion="moment")
