"""Fig. 14: computation times, full against projected."""

import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from charts import METHOD_LOOKS, METHOD_NAMES
from common import PAPER_NODES, Context, command_of
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import sdhj
from sdhj import plotting
from sdhj.cli import compile_kernels
from sdhj.plotting.looks import INK

METHODS = ("hji", "projected")
PAPER_SECONDS = {"hji": (586.0, 1540.0, 3093.0, 5615.0), "projected": (105.0, 190.0, 347.0, 549.0)}
PAPER_MACHINE = "Intel Xeon W-2145"
THEIRS = {"color": "#9a9a9a", "markerfacecolor": "white"}


def draw(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 3.3)
    measured = measure((context.nodes,) if context.coarse else PAPER_NODES, context.say)
    draw_timings(figure.subplots(1, 2, width_ratios=(1.5, 1.0)), measured, machine())
    return figure


def measure(nodes: Sequence[int], say: Callable[[str], Any]) -> dict[str, dict[int, float]]:
    """Seconds that each method takes at each density for constraints and recursion, as the paper counts.

    Compiling is not counted: every method solves a small problem first.
    """
    seconds: dict[str, dict[int, float]] = {method: {} for method in METHODS}
    compile_kernels(METHODS)
    for count in nodes:
        for method in METHODS:  # one after the other, so that what else the machine does weighs on both
            say(f"timing: {method}, {count} nodes on each axis")
            began = time.perf_counter()
            sdhj.solve(sdhj.arm_case_study(nodes=count), method=method)
            seconds[method][count] = time.perf_counter() - began
    return seconds


def machine() -> str:
    """How many cores of what kind."""
    return f"{os.cpu_count()} cores, {platform.machine()}"


def draw_timings(axes: Sequence[Axes], measured: Mapping[str, Mapping[int, float]], named: str) -> None:
    """Seconds {method: {nodes: seconds}} beside the paper's, and the ratio of full to projected, on two axes.

    `named` says on what machine they were measured.
    """
    times, ratio = axes
    times.set_yscale("log")
    for method, seconds in PAPER_SECONDS.items():
        label = f"{METHOD_NAMES[method]}, paper ({PAPER_MACHINE})"
        times.plot(PAPER_NODES, seconds, label=label, gid=f"paper-{method}", **(METHOD_LOOKS[method] | THEIRS))
    for method, by_nodes in measured.items():
        label = f"{METHOD_NAMES[method]}, {named}"
        looks = METHOD_LOOKS[method]
        times.plot(list(by_nodes), list(by_nodes.values()), label=label, gid=f"measured-{method}", **looks)
    times.set(xlabel="nodes on each axis", ylabel="computation time (s)")
    times.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    looks = {"marker": "o", "linestyle": "-"}
    paper = np.divide(PAPER_SECONDS["hji"], PAPER_SECONDS["projected"])
    ratio.plot(PAPER_NODES, paper, label="paper", gid="paper-ratio", **looks, **THEIRS)
    nodes = list(measured["hji"])
    ours = [measured["hji"][n] / measured["projected"][n] for n in nodes]
    ratio.plot(nodes, ours, color=INK, label=named, gid="measured-ratio", **looks)
    ratio.set(xlabel="nodes on each axis", ylabel="full / projected", ylim=(0, None))
    ratio.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    for ax in axes:
        ax.set_xticks(sorted({*PAPER_NODES, *nodes}))
        ax.minorticks_off()
        ax.grid(axis="y")


if __name__ == "__main__":
    command_of(__file__)()
