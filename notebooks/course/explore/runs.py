"""Runs of the arm and its look-up table, live."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import sdhj
from course.draw.runs import draw_live_moment, draw_rows
from course.draw.slices import POSTURE
from course.widgets import Explorer, Numbers, agent_sliders, angle, choice, played, slider
from sdhj.kernels import FloatArray
from sdhj.plotting.looks import OUTCOME_INK
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
