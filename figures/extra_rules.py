"""Selection rules trade effort, clearance and time (Sec. 6.1)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from charts import draw_bars
from common import Context, command_of
from experiments import clearances, starts_outside
from matplotlib.figure import Figure

from sdhj import plotting
from sdhj.kernels import FloatArray
from sdhj.simulation.runs import simulate
from sdhj.table.batches import Table
from sdhj.table.controller import Controller

STUDY = True
RULES = ("deepest", "effort", "target", "clearance")


@dataclass(frozen=True)
class RuleOutcome:
    """What one selection rule does over many runs from the same starts.

    Attributes
    ----------
    rule : str
    runs, reached, collided : int
    effort : float
        Mean over the runs that reached the target of the integral of |u|^2, rad^2 / s.
    clearance : float
        Mean over those of the least distance to anything unsafe on the way, m.
    time : float
        Mean time to the target, s.
    """

    rule: str
    runs: int
    reached: int
    collided: int
    effort: float
    clearance: float
    time: float


def compare_rules(table: Table, runs: int, *, adversary: str = "random", seed: int = 0) -> list[RuleOutcome]:
    """Run every rule from the same starts, drawn from the tube outside the target, against one kind of adversary."""
    problem = table.problem
    starts = starts_outside(table, runs, seed)
    outcomes = []
    for rule in RULES:
        controller = Controller(table, rule=rule)
        every = [simulate(controller, q, adversary, seed=seed + i) for i, q in enumerate(starts)]
        good = [run for run in every if run.outcome == "reached"]
        outcomes.append(
            RuleOutcome(
                rule=rule,
                runs=runs,
                reached=len(good),
                collided=sum(run.outcome == "collided" for run in every),
                effort=_mean([problem.delta * np.square(problem.inputs[run.inputs]).sum() for run in good]),
                clearance=_mean(clearances(problem, good, 1)),
                time=_mean([run.times[-1] for run in good]),
            )
        )
    return outcomes


def _mean(values: Sequence[float] | FloatArray) -> float:
    return float(np.mean(values)) if len(values) else float("nan")


def draw(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 2.9)
    outcomes = compare_rules(context.table("hji"), context.runs, seed=context.seed)
    panels = (
        ("effort", "mean effort (rad$^2$/s)", [o.effort for o in outcomes]),
        ("clearance", "mean least clearance (mm)", [1000 * o.clearance for o in outcomes]),
        ("time", "mean time to the target (s)", [o.time for o in outcomes]),
    )
    for ax, (name, label, values) in zip(figure.subplots(1, 3), panels, strict=True):
        draw_bars(ax, RULES, {name: values}, ylabel=label)
        ax.tick_params(axis="x", rotation=30)
    return figure


if __name__ == "__main__":
    command_of(__file__)()
