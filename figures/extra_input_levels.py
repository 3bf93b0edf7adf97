"""More input levels enlarge the victory domain, at a cost that grows with their number (Sec. 6.1)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from charts import METHOD_LOOKS, SHARE
from common import Context, command_of
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import sdhj
from sdhj import plotting
from sdhj.cli import compile_kernels

STUDY = True


@dataclass(frozen=True)
class LevelSweep:
    """The victory domain and its price against the levels of each input component.

    Attributes
    ----------
    levels : tuple of int
    inputs : tuple of int
        L, their square.
    fractions, seconds : tuple of float
        Share of the grid inside the tube of step 0 within all steps; wall-clock time of the solution.
    """

    levels: tuple[int, ...]
    inputs: tuple[int, ...]
    fractions: tuple[float, ...]
    seconds: tuple[float, ...]


def sweep_input_levels(levels: Sequence[int] = (3, 5, 7, 9), *, method: str = "hji", **arguments: Any) -> LevelSweep:
    """Solve the arm's case study with more and more inputs; arguments as for `arm_case_study`."""
    compile_kernels([method])  # outside the clock
    problems = [sdhj.arm_case_study(**arguments, input_levels=n) for n in levels]
    tables = [sdhj.solve(problem, method=method, progress=False) for problem in problems]
    return LevelSweep(
        levels=tuple(levels),
        inputs=tuple(len(problem.inputs) for problem in problems),
        fractions=tuple(table.fraction(start=0, within=table.steps) for table in tables),
        seconds=tuple(table.details["seconds"] for table in tables),
    )


def draw(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 3.0)
    draw_input_levels(figure.subplots(1, 2), sweep_input_levels(nodes=context.nodes))
    return figure


def draw_input_levels(axes: Sequence[Axes], sweep: LevelSweep) -> None:
    """Share of C inside against the levels; seconds against L, with a line through."""
    gain, cost = axes
    gain.plot(sweep.levels, sweep.fractions, gid="levels-fraction", **METHOD_LOOKS["hji"])
    gain.set(xlabel="levels of each input component", ylabel=SHARE, xticks=sweep.levels)
    cost.plot(sweep.inputs, sweep.seconds, gid="levels-seconds", **(METHOD_LOOKS["hji"] | {"linestyle": "none"}))
    slope, offset = np.polyfit(sweep.inputs, sweep.seconds, 1)
    ends = np.array([0.0, max(sweep.inputs)])
    looks = {"color": "#8c8c8c", "linestyle": "--", "label": f"{slope:.2g} s for each input"}
    cost.plot(ends, offset + slope * ends, gid="levels-line", **looks)
    cost.legend()
    cost.set(xlabel="number of inputs $L$", ylabel="time to solve (s)", ylim=(0, None), xticks=sweep.inputs)
    for ax in axes:
        ax.grid(axis="y")


if __name__ == "__main__":
    command_of(__file__)()
