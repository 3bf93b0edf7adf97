"""Selection rules trade effort, clearance and time (Sec. 6.1).

All rules play the same runs, from the same starts against the same random adversary; so what a rule changes is
measured run by run: the mean of the differences to "deepest", of the runs that reached the target by every rule.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from charts import draw_bars
from common import Context, command_of
from experiments import clearances, mean_interval, starts_outside
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from sdhj import plotting
from sdhj.common.remembering import FloatArray
from sdhj.plotting.looks import INK
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
    runs, collided : int
    arrived : array of bool
        Which of the runs reached the target.
    effort, clearance, time : array
        Of each run that reached the target: the integral of |u|^2, rad^2 / s; the least distance to anything unsafe on
        the way, m; the time it took, s.
    """

    rule: str
    runs: int
    collided: int
    arrived: NDArray[np.bool_]
    effort: FloatArray
    clearance: FloatArray
    time: FloatArray

    @property
    def reached(self) -> int:
        return int(self.arrived.sum())


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
                collided=sum(run.outcome == "collided" for run in every),
                arrived=np.array([run.outcome == "reached" for run in every]),
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
    outcomes = compare_rules(context.table("hji"), 5 * context.runs, seed=context.seed)
    draw_rules(figure.subplots(1, 3), outcomes)
    figure.suptitle(f"{outcomes[0].runs:,} runs by each rule, the same for all; {context.nodes} nodes an axis")
    return figure


def differences(outcomes: Sequence[RuleOutcome], kind: str) -> dict[str, FloatArray]:
    """What each rule but the first changes in "effort", "clearance" or "time", in each run that all end well."""
    both = np.logical_and.reduce([outcome.arrived for outcome in outcomes])
    first, *others = (getattr(outcome, kind)[both[outcome.arrived]] for outcome in outcomes)
    return {outcome.rule: values - first for outcome, values in zip(outcomes[1:], others, strict=True)}


def draw_rules(axes: Sequence[Axes], outcomes: Sequence[RuleOutcome]) -> None:
    """Mean differences in effort, clearance and time to the first rule, with their 95 % intervals, on three axes."""
    panels = (("effort", 1.0, "rad$^2$/s"), ("clearance", 1000.0, "mm"), ("time", 1.0, "s"))
    for ax, (kind, scale, unit) in zip(axes, panels, strict=True):
        changed = {rule: scale * values for rule, values in differences(outcomes, kind).items()}
        means = [float(np.mean(values)) for values in changed.values()]
        intervals = [mean_interval(values) for values in changed.values()]
        draw_bars(ax, [*changed], {kind: means}, ylabel=f"mean change ({unit})", intervals={kind: intervals})
        first = scale * float(np.mean(getattr(outcomes[0], kind)))
        ax.set_title(f"{kind}; {outcomes[0].rule}: {first:.3g} {unit}", fontsize=8)
        ax.axhline(0.0, color=INK, linewidth=0.8)


if __name__ == "__main__":
    command_of(__file__)()
