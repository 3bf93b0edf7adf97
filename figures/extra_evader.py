"""A target that flees needs no other method, but it cannot be projected (Sec. 6.1)."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from charts import draw_bars
from common import Context, command_of, longest_run
from experiments import share_won
from fig10_tubes import draw_steps_bar
from fig12_trajectory import draw_workspace_run
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

import sdhj
from sdhj import plotting
from sdhj.common.findings import ProjectionWarning
from sdhj.plotting.trajectories import WAY
from sdhj.simulation.outcomes import OUTCOMES
from sdhj.simulation.runs import Report, Trajectory
from sdhj.table.batches import Table

MAIN_JOB = False
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
    chase : Trajectory
        The longest of some, against the evader that flees optimally.
    """

    full: Table
    won: float
    projected_won: float
    warnings: tuple[str, ...]
    reports: Mapping[str, Report]
    chase: Trajectory


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
        chase=longest_run(full, "worst", seed),
    )


def value(context: Context) -> list[float]:
    """The shares of C won by the full method and by projections."""
    found = evading_target(nodes=context.nodes, runs=10, seed=context.seed)
    return [found.won, found.projected_won]


def draw(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 6.6)
    found = evading_target(nodes=context.nodes, runs=10 * context.runs, seed=context.seed)
    tiles = [["tubes", "chase"], ["bar", "chase"], ["ends", "ends"]]
    parts = figure.subplot_mosaic(tiles, height_ratios=(1.0, 0.05, 0.75))
    plotting.draw_tubes(parts["tubes"], found.full, through=EVADER_AT)
    nodes = found.full.grid.shape[0]
    parts["tubes"].set_title(f"(a) evader at ({EVADER_AT[2]:.2f}, {EVADER_AT[3]:.2f}) m, {nodes} nodes an axis")
    draw_steps_bar(parts["bar"], found.full.steps, "steps to go, $n$; 0: it is caught")
    draw_workspace_run(parts["chase"], found.full.problem, found.chase)
    parts["chase"].set_title(f"(b) a chase of {found.chase.times[-1]:.1f} s, the worst evader")
    draw_ends(parts["ends"], found.reports)
    said = f"(c) chases that are lost, of {10 * context.runs:,} each; won: full {found.won:.1%}"
    parts["ends"].set_title(said + rf", projected {found.projected_won:.1%} of $\mathcal{{C}}$", pad=20)
    way = Line2D([], [], markerfacecolor="white", marker="o", markersize=3.6, label="end-effector, at $t_k$", **WAY)
    flight = Line2D([], [], color="black", linestyle=":", linewidth=1.0, label="the evader's way")
    entries = [plotting.patch("obstacles", "known obstacles"), plotting.patch("evader", "evader"), way, flight]
    figure.legend(handles=entries, loc="outside upper center", ncols=4, handleheight=1.1)
    return figure


def draw_ends(ax: Axes, reports: Mapping[str, Report]) -> None:
    """Shares of the ways in which runs were lost against each evader, with Wilson's 95 % intervals."""
    met = [o for o in OUTCOMES if o != "reached" and any(report.rate(o) for report in reports.values())]
    rates = {name: [100 * report.rate(outcome) for outcome in met] for name, report in reports.items()}
    ends = {name: [100 * np.array(report.interval(o)) for o in met] for name, report in reports.items()}
    draw_bars(ax, met, rates, ylabel="runs (%), 95 % intervals", intervals=ends)


if __name__ == "__main__":
    command_of(__file__)()
