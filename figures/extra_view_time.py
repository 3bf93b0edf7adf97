"""How a moving obstacle enters the game of one interval decides whether the result is safe (Secs. 5.4 and 6.2.1)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from charts import SHARE, draw_bars
from common import Context, command_of
from experiments import clearances, starts_outside
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import sdhj
from sdhj import plotting
from sdhj.arm.case_studies import OBSTACLES
from sdhj.arm.workspace import Disk, Line
from sdhj.problem.sets import VIEW_TIMES
from sdhj.simulation.runs import SUBSTEPS, score_interval

MAIN_JOB = False
INSTANTS = 400  # of each interval, at which collisions are looked for
BULLET = Disk(Line((0.10, 2.6), (0.0, -20.0)), 0.005)  # crosses the workspace in 0.03 s, within the second interval
WORKSPACES = {"the paper's obstacles": OBSTACLES, "one at 20 m/s": (BULLET,)}


@dataclass(frozen=True)
class ViewTimeOutcome:
    """What one view-time promises and what happens.

    Attributes
    ----------
    view_time : str
    fraction : float
        Share of the grid inside the tube of step 0 within all steps.
    runs : int
        From states that the table calls admissible.
    collided : int
        Runs that truly touched something unsafe.
    rate : float
        Their share.
    deepest : float
        The least clearance of all runs, m; negative where the robot was inside an obstacle.
    """

    view_time: str
    fraction: float
    runs: int
    collided: int
    deepest: float

    @property
    def rate(self) -> float:
        return self.collided / self.runs


def compare_view_times(
    view_times: Sequence[str] = VIEW_TIMES,
    *,
    runs: int,
    seed: int = 0,
    steps: int = 4,
    obstacles: Sequence[Disk] = (BULLET,),
    **arguments: Any,
) -> list[ViewTimeOutcome]:
    """Solve with each view-time and count the collisions that happen although the table promised there would be none.

    By default a small obstacle crosses the workspace at 20 m/s: between two of 20 samples of an interval it moves
    0.1 m, so "sampled" sees gaps in its path that are wider than the arm. Collisions are looked for with the true
    geometry at 400 instants of each interval. The adversary does nothing: what goes wrong is then the table's doing.
    """
    outcomes = []
    for view_time in view_times:
        problem = sdhj.arm_case_study(steps=steps, view_time=view_time, obstacles=obstacles, **arguments)
        table = sdhj.solve(problem, progress=False)
        controller = sdhj.Controller(table, rule="effort")
        starts = starts_outside(table, runs, seed)
        every = [sdhj.simulate(controller, q, "none", seed=seed + i) for i, q in enumerate(starts)]
        least = clearances(problem, every, INSTANTS // SUBSTEPS)
        fraction = table.fraction(start=0, within=steps)
        outcomes.append(ViewTimeOutcome(view_time, fraction, runs, int((least <= 0).sum()), float(least.min())))
    return outcomes


def value(context: Context) -> list[float]:
    """The shares of C inside by each view-time, beside the paper's obstacles."""
    return [outcome.fraction for outcome in compare_view_times(nodes=context.nodes, runs=10, seed=context.seed)]


def draw(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 3.1)
    given: dict[str, Any] = {"nodes": context.nodes, "runs": context.runs, "seed": context.seed}
    found = {name: compare_view_times(obstacles=disks, **given) for name, disks in WORKSPACES.items()}
    draw_view_times(figure.subplots(1, 2), found)
    return figure


def draw_view_times(axes: Sequence[Axes], found: Mapping[str, Sequence[ViewTimeOutcome]]) -> None:
    """What is promised and what happens, by workspace, on two axes; rates with Wilson's 95 % intervals."""
    left, right = axes
    shares = {name: [o.fraction for o in outcomes] for name, outcomes in found.items()}
    draw_bars(left, VIEW_TIMES, shares, ylabel=SHARE)
    rates = {name: [100 * o.rate for o in outcomes] for name, outcomes in found.items()}
    ends = {name: [100 * np.array(score_interval(o.collided, o.runs)) for o in outs] for name, outs in found.items()}
    label = "promised safe, yet collided (%), 95 % interval"
    draw_bars(right, VIEW_TIMES, rates, ylabel=label, intervals=ends)


if __name__ == "__main__":
    command_of(__file__)()
