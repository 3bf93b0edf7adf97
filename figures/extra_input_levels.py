"""More input levels enlarge the victory domain, at a cost that grows with their number (Sec. 6.1)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from charts import METHOD_LOOKS, SHARE
from common import Context, command_of
from fig14_timing import SCHEMES, seconds_of_a_thread
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import sdhj
from sdhj import plotting

MAIN_JOB = False


@dataclass(frozen=True)
class LevelSweep:
    """The victory domain and its price against the levels of each input component.

    Attributes
    ----------
    levels : tuple of int
    inputs : tuple of int
        L, their square.
    fractions : tuple of float
        Share of the grid inside the tube of step 0 within all steps.
    seconds : mapping of scheme to tuple of float
        Processor time of one thread, as Fig. 14 measures it.
    """

    levels: tuple[int, ...]
    inputs: tuple[int, ...]
    fractions: tuple[float, ...]
    seconds: Mapping[str, tuple[float, ...]]


def sweep_input_levels(levels: Sequence[int] = (3, 5, 7, 9), *, method: str = "hji", **arguments: Any) -> LevelSweep:
    """Solve the arm's case study with more and more inputs; arguments as for `arm_case_study`."""
    problems = [sdhj.arm_case_study(**arguments, input_levels=n) for n in levels]
    tables = [sdhj.solve(problem, method=method, progress=False) for problem in problems]
    seconds = {}
    for name, methods in SCHEMES.items():
        seconds_of_a_thread(sdhj.arm_case_study(nodes=9, steps=1), methods["hji"])  # compile
        seconds[name] = tuple(seconds_of_a_thread(problem, methods["hji"]) for problem in problems)
    return LevelSweep(
        levels=tuple(levels),
        inputs=tuple(len(problem.inputs) for problem in problems),
        fractions=tuple(table.fraction(start=0, within=table.steps) for table in tables),
        seconds=seconds,
    )


def value(context: Context) -> list[float]:
    """The shares of C inside with 3 and with 5 levels."""
    return list(sweep_input_levels((3, 5), nodes=context.nodes).fractions)


def draw(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 3.0)
    draw_input_levels(figure.subplots(1, 2), sweep_input_levels(nodes=context.nodes))
    return figure


def draw_input_levels(axes: Sequence[Axes], sweep: LevelSweep) -> None:
    """Share of C inside against the levels; seconds against L."""
    gain, cost = axes
    gain.plot(sweep.levels, sweep.fractions, gid="levels-fraction", **METHOD_LOOKS["hji"])
    gain.set(xlabel="levels of each input component", ylabel=SHARE, xticks=sweep.levels)
    for (name, seconds), looks in zip(sweep.seconds.items(), METHOD_LOOKS.values(), strict=False):
        solved = "one PDE for each input" if name != "default" else "one PDE for all"
        cost.plot(sweep.inputs, seconds, label=f"{name}: {solved}", gid=f"levels-{name}", **looks)
    cost.legend(loc="upper left")
    cost.set(xlabel="number of inputs $L$", ylabel="processor time, one thread (s)", xticks=sweep.inputs)
    for ax, most in ((gain, max(sweep.fractions)), (cost, max(map(max, sweep.seconds.values())))):
        ax.set(xlim=(0, None), ylim=(0, 1.25 * most))
        ax.grid(axis="y")


if __name__ == "__main__":
    command_of(__file__)()
