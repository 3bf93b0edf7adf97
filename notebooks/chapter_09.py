"""The controller against the adversary: runs to play and to step through. Chapters 10 and 11 too."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import ipywidgets
import numpy as np
from matplotlib.figure import Figure
from widgets import Explorer, Numbers, choice, slider

import sdhj
from sdhj.plotting import draw_moment
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
        played = run(number, adversary, rule, seed)
        index = round(moment / 100 * (len(played.times) - 1))
        draw_moment(figure, table, played, index=index)
        return {
            "time (s)": float(played.times[index]),
            "outcome": played.outcome,
            "steps taken": len(played.inputs),
            "cost so far": _closest(table.problem, played, index),
        }

    moment = slider("progress of the run (%)", 0, 100, 4, 60)
    moment.player = ipywidgets.Play(min=0, max=100, step=4, interval=250, show_repeat=True)
    ipywidgets.jslink((moment.player, "value"), (moment, "value"))
    controls = {
        "number": slider("initial state", 0, len(states) - 1, 1, 0)
        if len(states) > 1
        else choice("initial state", (0,), 0),
        "adversary": choice("adversary", adversaries, adversaries[-1]),
        "rule": choice("rule", rules, rules[0]),
        "seed": slider("seed", 0, 9, 1, 0),
        "moment": moment,
    }
    return Explorer(draw, controls, size=(8.2, 3.7), alt="One moment of a run")


def _closest(problem: ReachAvoidProblem, played: Any, index: int) -> float:
    """The least clearance so far, m, negated: positive after a collision (the second term of Eq. (5))."""
    clearances = [problem.unsafe_value(played.states[i : i + 1], float(played.times[i]))[0] for i in range(index + 1)]
    return -float(min(clearances))
