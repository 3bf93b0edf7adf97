"""Chapter 11, The controller: what it draws, its widgets, and the checks of its exercises."""

import warnings
from collections.abc import Mapping, Sequence
from functools import cache, lru_cache
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

import sdhj
from course.exercises import exercise, expect, expect_close
from course.slices import (
    HERE,
    LIVE,
    POSTURE,
    around,
    colours_of,
    draw_arm_live,
    draw_pixels,
    draw_sets,
    fewest_steps,
    here,
    slice_values,
    steps_image,
)
from course.widgets import Explorer, Numbers, agent_sliders, angle, choice, played, slider
from sdhj.arm.case_studies import scene
from sdhj.common.findings import ResolutionWarning
from sdhj.common.remembering import FloatArray
from sdhj.plotting import draw_path, plane
from sdhj.plotting.looks import FULL_LOOKS, OUTCOME_INK
from sdhj.plotting.trajectories import WAY
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.simulation.adversaries import Adversary, Moment
from sdhj.simulation.runs import SUBSTEPS, Z95
from sdhj.table.batches import Table

# ---- pictures


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
    draw_sets(right, problem, through=state, step=time / problem.delta)
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


# ---- widgets


def explore_run(
    table: Table,
    states: Sequence[Sequence[float]],
    *,
    adversaries: Sequence[str] = ("none", "random", "aggressive", "worst"),
    rules: Sequence[str] | Mapping[str, Any] = ("deepest",),
    progress: int = 60,
) -> Explorer:
    """Play and step through a run from one of `states`, at first at so many % of it; rules by their names."""
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
        "seed": slider("seed, where it is random", 0, 9, 1, 0),
        "moment": played(slider("progress of the run (%)", 0, 100, 5, progress)),
    }

    def idle(adversary: str, **_: Any) -> tuple[str, ...]:
        return () if adversary == "random" else ("seed",)  # the others draw nothing

    return Explorer(
        draw, controls, size=(8.2, 3.7), alt="One moment of a run", process="moment", motion="moment", idle=idle
    )


def _closest(problem: ReachAvoidProblem, run: Any) -> FloatArray:
    """The least clearance up to each time, m, negated: positive after a collision (the second term of Eq. (5))."""
    clearances = [
        problem.unsafe_value(state[None], float(t))[0] for state, t in zip(run.states, run.times, strict=True)
    ]
    return -np.minimum.accumulate(clearances)


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
        "moment": played(slider("progress of the run (%)", 0, 100, 5, 50)),
    }
    alt = "A run with the pursuer where you send it, and its table row"
    return Explorer(draw, controls, size=(6.4, 4.1), alt=alt, motion="moment", process="moment")


# ---- checks


@cache
def _table():
    with warnings.catch_warnings(action="ignore", category=ResolutionWarning):  # rules read it; nobody drives by it
        return sdhj.solve(sdhj.arm_case_study(nodes=15), progress=False)


@cache
def _states():
    table = _table()
    states = np.random.default_rng(3).uniform(table.grid.lower, table.grid.upper, (4000, 4))
    return states[table.contains(states, start=0, within=8)][:300]


@exercise("11.1", "argmax finds the first True of an array of booleans. What does it find where there is none?")
def check_fewest(fewest):
    """Leftmost column with a value <= 0."""
    values = np.array([[0.2, -0.1, 0.3, 0.0], [0.1, -0.2, 0.2, -0.1], [-0.1, -0.3, 0.1, -0.2], [0.1, -0.3, 0.4, -1.0]])
    got = np.asarray(fewest(values))
    expect(got.shape == (4,), "one whole number for each state, that is for each column of `values`.")
    expect(got[1] == 0, "a value below zero in the first row means no steps to go.")
    expect(got[3] == 0, "zero counts as inside (Definition 5).")
    expect(got[2] == -1, "where no row is <= 0 the answer is -1; what does argmax give for a column without True?")
    expect(got[0] == 2, "the leftmost, even where a later set does not hold the state any more.")


@exercise("11.2", "Add the second wish to the first with a factor so small that it only decides between equals.")
def check_rule(calm_shoulder):
    """Least |u_1|, then least margin."""
    table = _table()
    controller = sdhj.Controller(table, rule=calm_shoulder)
    batch = controller.batch(_states(), 0)
    known = batch.safe.any(axis=1)
    chosen = controller.choose(batch)[known]
    turn = np.abs(table.problem.inputs[:, 0])
    least = np.min(np.where(batch.safe[known], turn, np.inf), axis=1)
    expect_close(turn[chosen], least, "the first joint turns more than it has to: inputs[:, 0], its absolute value.")
    equal = batch.safe[known] & (turn == least[:, None])
    deepest = np.min(np.where(equal, batch.margins[known], np.inf), axis=1)
    margins = np.take_along_axis(batch.margins[known], chosen[:, None], axis=1)[:, 0]
    expect_close(margins, deepest, "among equals the deeper one: the least margin.", within=1e-6)


@exercise("11.3", "With no failure among M runs the interval of failures ends at z^2 / (M + z^2).")
def check_wilson(wilson, runs_needed):
    """Eq. (11.4), and z^2 / (M + z^2) < 1 / 1000."""
    for successes, runs in ((50, 100), (997, 1000), (0, 30), (30, 30)):
        n, p = runs, successes / runs
        centre = (p + Z95**2 / (2 * n)) / (1 + Z95**2 / n)
        half = Z95 / (1 + Z95**2 / n) * np.sqrt(p * (1 - p) / n + Z95**2 / (4 * n**2))
        hint = f"{successes} of {runs}: the whole of (11.4), z = 1.96."
        expect_close(wilson(successes, runs), (max(centre - half, 0), min(centre + half, 1)), hint, within=2e-4)
    least = Z95**2 * 999
    expect(runs_needed != 4000, "4/M is a rule of thumb; solve z^2 / (M + z^2) < 1/1000.")
    expect(runs_needed > least, "so few runs leave a rate of one in a thousand possible.")
    expect(runs_needed <= least + 2, "fewer runs would do.")


@exercise("11.4", "`controller.safe_inputs` gives the indices that are safe; choose the nearest of them.")
def check_filter(nearest_safe):
    """Among the safe inputs, the nearest in the plane of joint velocities."""
    controller, inputs = sdhj.Controller(_table()), _table().problem.inputs
    rng = np.random.default_rng(0)
    for q in _states()[:60]:
        wanted, safe = rng.uniform(-3, 3, 2), controller.safe_inputs(q, 0)
        if controller.steps_to_go(q, 0) == 0 or not len(safe):  # near the edge of a tube no input may pass every check
            continue
        got = int(nearest_safe(controller, q, 0, wanted))
        expect(got in safe, "an input that is not safe: choose among controller.safe_inputs(q, step).")
        distance = np.linalg.norm(inputs[safe] - wanted, axis=1).min()
        expect_close(np.linalg.norm(inputs[got] - wanted), distance, "another safe input is nearer to what is wanted.")
    try:
        nearest_safe(controller, np.array([0.0, 0.0, 0.1, 0.0]), 0, np.zeros(2))
    except sdhj.NotAdmissible:
        return "The human drives, and cannot leave the tube."
    expect(False, "where no tube holds the state there is nothing to filter: let NotAdmissible through.")
    return None


@exercise(
    "11.5",
    "The moment knows which tube the robot means to be in. Try every corner of the box to the interval's end.",
)
def check_adversary(villain):
    """More failures than "aggressive" among 6,000 runs on 15 nodes."""
    controller = sdhj.Controller(_table())
    known = sdhj.monte_carlo(controller, runs=6000, adversary="aggressive", seed=7)
    yours = sdhj.monte_carlo(controller, runs=6000, adversary=villain, seed=7)
    told = f"yours beats {1 - yours.rate('reached'):.2%} of the runs, aggressive {1 - known.rate('reached'):.2%}"
    expect(yours.interval("reached")[1] < known.interval("reached")[0], f"{told}: that is not more, beyond chance.")
    return told + "."


@exercise("11.6", "Each of the two conditions allows an error of its own; the smaller of the two is allowed by both.")
def check_error(largest_error):
    """min(-m / slope, -a / slope_avoid), at least 0; then with margins and avoid tubes of the arm."""
    margins = np.array([-0.04, -0.04, -0.01, 0.02, -0.03, 0.0, -0.06])
    avoid = np.array([-0.10, -0.01, -0.09, -0.05, 0.01, -0.05, -np.inf])
    wanted = np.array([0.02, 0.004, 0.005, 0.0, 0.0, 0.0, 0.03])
    got = np.asarray(largest_error(margins, avoid, 2.0, 2.5), dtype=np.float64)
    expect(got.shape == margins.shape, "one error for each input.")
    expect(got >= 0, "an error is not below 0: where an input is not right for the measurement itself, return 0.")
    expect(got[1] < 0.02, "a deep margin is about reaching only. How deep is the avoid tube?")
    expect(got[2] < 0.036, "a deep avoid tube is about the way only. How deep is the margin?")
    expect_close(got, wanted, "each value divided by its own slope, and both conditions of (11.3') hold.", within=1e-12)
    table, states = _table(), _states()
    batch, hazards = table.batch(states, 0), table.hazards(states, 0)
    asked = batch.safe & (batch.steps_to_go > 0)[:, None]
    got = np.asarray(largest_error(batch.margins[asked], hazards[asked], 0.3, 0.3))
    by_margin = -batch.margins[asked] / 0.3
    wanted = np.maximum(np.minimum(by_margin, -hazards[asked] / 0.3), 0.0)
    expect_close(got, wanted, "safe inputs of the arm, with slopes of 0.3 m/rad.")
    return f"On 15 nodes the avoid tube is what limits {np.mean(wanted < by_margin):.0%} of the arm's safe inputs."
