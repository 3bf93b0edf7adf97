"""The value function on a line, and runs against many signals."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sdhj.kernels import FloatArray
from sdhj.plotting.looks import OUTCOME_INK

BLUE, GREY, GREEN, RED = "#0b3c5d", "#8c8c8c", "#2e7d32", "#e8b4a0"


def draw_curves(
    ax: Axes, x: FloatArray, curves: Mapping[str, FloatArray], sets: bool = True, legend: str = "upper center"
) -> None:
    """Level-set functions on a line, and the sets where they are <= 0 as bars below."""
    ax.axhline(0.0, color=GREY, linewidth=0.6)
    looks = [(GREY, "-", 1.0), (BLUE, "-", 1.8), ("#c44e00", "--", 1.6), (GREEN, ":", 2.0)]
    lowest = min(float(np.min(values)) for values in curves.values())
    for row, ((name, values), (colour, dashes, width)) in enumerate(zip(curves.items(), looks, strict=False)):
        ax.plot(x, values, color=colour, linestyle=dashes, linewidth=width, label=name, gid=name)
        if sets:
            bar = np.where(values <= 0, lowest - 0.08 - 0.05 * row, np.nan)
            ax.plot(x, bar, color=colour, linewidth=3, linestyle="-", solid_capstyle="butt")
    ax.set(xlim=(x[0], x[-1]), xlabel="$x$ (m)", ylabel="cost (m)")
    ax.legend(loc=legend)


def draw_rides(
    ax: Axes, times: FloatArray, paths: FloatArray, costs: FloatArray, target: FloatArray, unsafe: FloatArray
) -> None:
    """Runs (M, T) over time, the costliest bold; the target is a bar at the end, the unsafe set a band."""
    if unsafe.size:
        ax.axhspan(unsafe.min(), unsafe.max(), color=RED, linewidth=0, zorder=0, gid="unsafe")
    ax.plot(
        np.full(target.size, times[-1] * 1.03), target, color=GREEN, linewidth=5, solid_capstyle="butt", gid="target"
    )
    for path in paths[:: max(1, len(paths) // 80)]:
        ax.plot(times, path, color=GREY, linewidth=0.5, linestyle="-")
    worst = int(np.argmax(costs))
    ax.plot(
        times, paths[worst], color=OUTCOME_INK if costs[worst] > 0 else BLUE, linewidth=2, linestyle="-", gid="worst"
    )
    ax.plot(0.0, paths[0, 0], "o", color=BLUE)
    ax.set(xlabel="time since $t_k$ (s)", ylabel="$x$ (m)", xlim=(-0.02, times[-1] * 1.06))


def draw_games_on_a_line(figure: Figure, shown: Mapping[str, Any]) -> None:
    """Runs from one start on the left, cost and value of all starts on the right."""
    left, right = figure.subplots(1, 2)
    draw_rides(left, *(shown[name] for name in ("times", "paths", "costs", "target", "unsafe")))
    draw_curves(right, shown["x"], shown["curves"])
