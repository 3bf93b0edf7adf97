"""Selection rules trade effort, clearance and time (Sec. 6.1)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from charts import draw_bars
from common import Context, command_of
from experiments import clearances, mean_interval, starts_outside
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sdhj import plotting
from sdhj.kernels import FloatArray
from sdhj.simulation.runs import simulate
from sdhj.table.batches import Table
from sdhj.table.controller import Controller

MAIN_JOB = False
RULES = ("deepest", "effort", "target", "clearance")


@dataclass(frozen=True)
class RuleOutcome:
    """What one selection rule does over many runs from the same starts.

    Attributes
    ----------
    rule : str
    runs, reached, collided : int
    effort, clearance, time : array
        Of each run that reached the target: the integral of |u|^2, rad^2 / s; the least distance to anything unsafe on
        the way, m; the time it took, s.
    """

    rule: str
    runs: int
    reached: int
    collided: int
    effort: FloatArray
    clearance: FloatArray
    time: FloatArray


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
                effort=np.array([problem.delta * np.square(problem.inputs[run.inputs]).sum() for run in good]),
                clearance=clearances(problem, good, 1),
                time=np.array([run.times[-1] for run in good]),
            )
        )
    return outcomes


def value(context: Context) -> list[float]:
    """The mean effort by each rule."""
    return [float(outcome.effort.mean()) for outcome in compare_rules(context.table("hji"), 20, seed=context.seed)]


def draw(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 2.9)
    outcomes = compare_rules(context.table("hji"), context.runs, seed=context.seed)
    draw_rules(figure.subplots(1, 3), outcomes)
    return figure


def draw_rules(axes: Sequence[Axes], outcomes: Sequence[RuleOutcome]) -> None:
    """Means of effort, clearance and time with their 95 % intervals, on three axes."""
    panels = (
        ("mean effort (rad$^2$/s)", [o.effort for o in outcomes]),
        ("mean least clearance (mm)", [1000 * o.clearance for o in outcomes]),
        ("mean time to the target (s)", [o.time for o in outcomes]),
    )
    for ax, (label, samples) in zip(axes, panels, strict=True):
        means = [float(np.mean(values)) if len(values) else float("nan") for values in samples]
        intervals = [mean_interval(values) for values in samples]
        draw_bars(ax, [o.rule for o in outcomes], {label: means}, ylabel=label, intervals={label: intervals})
        ax.tick_params(axis="x", rotation=30)
    axes[0].set_title(f"{outcomes[0].runs} runs of each rule; 95 % intervals of the means")


if __name__ == "__main__":
    command_of(__file__)()
