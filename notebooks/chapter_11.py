"""The controller against the adversary: runs to play and to step through. Chapters 12 and 14 too."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from widgets import Explorer, Numbers, choice, played, slider

import sdhj
from sdhj.arm.case_studies import scene
from sdhj.plotting import draw_moment, draw_path
from sdhj.plotting.looks import OUTCOME_INK
from sdhj.problem import ReachAvoidProblem
from sdhj.table import Table


def explore_run(
    table: Table,
    states: Sequence[Sequence[float]],
    *,
    adversaries: Sequence[str] = ("none", "random", "aggressive", "worst"),
    rules: Sequence[str] = ("deepest",),
) -> Explorer:
    """Play and step through a run from one of `states` against an adversary of your choice."""
    controllers = {rule: sdhj.Controller(table, rule=rule) for rule in rules}

    @lru_cache(maxsize=64)
    def run(number: int, adversary: str, rule: str, seed: int) -> Any:
        return sdhj.simulate(
            controllers[rule], np.asarray(states[number], dtype=np.float64), adversary=adversary, seed=seed
        )

    def draw(figure: Figure, number: int, adversary: str, rule: str, seed: int, moment: float) -> Numbers:
        one = run(number, adversary, rule, seed)
        index = round(moment / 100 * (len(one.times) - 1))
        draw_moment(figure, table, one, index=index)
        draw_way(figure, table.problem, one)
        return {
            "time (s)": float(one.times[index]),
            "outcome": one.outcome,
            "steps taken": len(one.inputs),
            "cost so far": _closest(table.problem, one, index),
        }

    controls = {
        "number": slider("initial state", 0, len(states) - 1, 1, 0)
        if len(states) > 1
        else choice("initial state", (0,), 0),
        "adversary": choice("adversary", adversaries, adversaries[-1]),
        "rule": choice("rule", rules, rules[0]),
        "seed": slider("seed", 0, 9, 1, 0),
        "moment": played(slider("progress of the run (%)", 0, 100, 4, 60)),
    }
    return Explorer(draw, controls, size=(8.2, 3.7), alt="One moment of a run")


def draw_way(figure: Figure, problem: ReachAvoidProblem, run: Any) -> None:
    """The whole run, faint, over the pictures of one moment: which run it is shows at every moment."""
    left, right = figure.axes
    tips = scene(problem).arm.tip(run.states[:, :2])
    looks = {"color": OUTCOME_INK, "linewidth": 0.8, "alpha": 0.45, "zorder": 5.5}
    left.plot(*tips.T, linestyle="-", gid="whole-tip-path", **looks)
    left.plot(*run.states[:, 2:4].T, linestyle=":", gid="whole-agent-path", **looks | {"color": "black"})
    draw_path(right, problem.grid, run.states, gid="whole-path", **looks)


def _closest(problem: ReachAvoidProblem, played: Any, index: int) -> float:
    """The least clearance so far, m, negated: positive after a collision (the second term of Eq. (5))."""
    clearances = [problem.unsafe_value(played.states[i : i + 1], float(played.times[i]))[0] for i in range(index + 1)]
    return -float(min(clearances))
