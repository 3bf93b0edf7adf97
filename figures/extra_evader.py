"""An evading target takes no other method, but cannot be projected (Sec. 6.1)."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from charts import draw_bars
from common import Context, command_of
from experiments import share_won
from matplotlib.figure import Figure

import sdhj
from sdhj import plotting
from sdhj.simulation.outcomes import OUTCOMES
from sdhj.simulation.runs import Report
from sdhj.solver.projections import ProjectionWarning
from sdhj.table.batches import Table

STUDY = True
EVADER_AT = (0.0, 0.0, 0.12, 0.12)


@dataclass(frozen=True)
class EvaderOutcome:
    """The evading target, full and projected, and how chases end.

    Attributes
    ----------
    full : Table
    won, projected_won : float
        Share of the grid from which it is caught, without the target itself: in full, and by projections, nothing.
    warnings : tuple of str
        Why that is nothing.
    reports : mapping of adversary to Report
    """

    full: Table
    won: float
    projected_won: float
    warnings: tuple[str, ...]
    reports: Mapping[str, Report]


def evading_target(
    adversaries: Sequence[str] = ("random", "worst"), *, runs: int, seed: int = 0, **arguments: Any
) -> EvaderOutcome:
    """Solve the evader's case study both ways and chase evaders that move at random and that flee optimally.

    Projecting along a coordinate of the evader asks that the end-effector be on it wherever, along that axis, it is;
    no state is. The projected method therefore finds the target alone, and says so.
    """
    problem = sdhj.evader_case_study(**arguments)
    full = sdhj.solve(problem, progress=False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ProjectionWarning)  # reported in the result
        projected = sdhj.solve(problem, method="projected", progress=False)
    controller = sdhj.Controller(full)
    return EvaderOutcome(
        full=full,
        won=share_won(full),
        projected_won=share_won(projected),
        warnings=tuple(projected.details["projection"]["warnings"]),
        reports={name: sdhj.monte_carlo(controller, runs, name, seed, progress=False) for name in adversaries},
    )


def draw(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 3.5)
    chased = evading_target(nodes=context.nodes, runs=10 * context.runs, seed=context.seed)
    left, right = figure.subplots(1, 2)
    plotting.draw_tubes(left, chased.full, through=EVADER_AT)
    left.set_title(f"evader at ({EVADER_AT[2]:.2f}, {EVADER_AT[3]:.2f}) m; dark is near")
    rates = {name: [100 * report.rate(outcome) for outcome in OUTCOMES] for name, report in chased.reports.items()}
    draw_bars(right, OUTCOMES, rates, ylabel="runs (%)")
    right.set_title(f"won: full {chased.won:.1%}, projected {chased.projected_won:.1%} of $\\mathcal{{C}}$", pad=20)
    return figure


if __name__ == "__main__":
    command_of(__file__)()
