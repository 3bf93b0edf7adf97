"""Numbers across many solves or runs, drawn by several figures: shares of C against steps or bounds, bars."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from sdhj.common.remembering import FloatArray
from sdhj.plotting.looks import INK

METHOD_LOOKS: dict[str, dict[str, Any]] = {
    "hji": {"color": "#0b3c5d", "linestyle": "-", "marker": "o"},
    "projected": {"color": "#c44e00", "linestyle": "--", "marker": "s"},
    "lax": {"color": "#2a8c82", "linestyle": "-.", "marker": "^"},
    "certified": {"color": "#8a5a9e", "linestyle": ":", "marker": "D"},
}
METHOD_NAMES = {"hji": "full", "projected": "projected", "lax": "Hopf-Lax", "certified": "certified"}
BARS = ("#0b3c5d", "#7fb2e5", "#e9eef3", "#c9c9c9")
HATCHES = ("", "////", "....", "xxxx")
SHARE = "share of $\\mathcal{C}$ inside"


def draw_fractions(ax: Axes, fractions: Mapping[str, Sequence[float]]) -> None:
    """Share of C inside against the steps to go, a line for each method."""
    for method, shares in fractions.items():
        looks = METHOD_LOOKS.get(method, {"marker": "o"})
        ax.plot(range(len(shares)), shares, label=METHOD_NAMES.get(method, method), gid=f"fraction-{method}", **looks)
    ax.set(xlabel="steps to go, $n$", ylabel=SHARE, ylim=(0, None))
    ax.grid(axis="y")
    ax.legend()


def draw_sweep(
    ax: Axes,
    bounds: Sequence[float] | FloatArray,
    fractions: Mapping[str, Sequence[float] | FloatArray],
    *,
    xlabel: str,
    nominal: float | None = None,
) -> None:
    """Share of C inside against what was varied, (B,) `bounds`; one line for each method or other label (Sec. 6.1).

    `nominal` marks the case study's own value.
    """
    for label, values in fractions.items():
        looks = METHOD_LOOKS.get(label, {"marker": "o"})
        ax.plot(bounds, np.asarray(values), label=METHOD_NAMES.get(label, label), gid=f"sweep-{label}", **looks)
    ax.update_datalim([(bounds[0], 0.0)])  # so that room is left above the lines as for all that is shown
    if nominal is not None:
        ax.axvline(nominal, color="#8c8c8c", linestyle=":", linewidth=0.9)
        looks = {"rotation": 90, "va": "top", "ha": "left", "color": "#666666", "fontsize": 7}
        places = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points"}
        ax.annotate("case study", (nominal, 1.0), (2, -2), **places, **looks)
    ax.set(xlabel=xlabel, ylabel=SHARE, ylim=(0, None))
    if all(isinstance(bound, int) for bound in bounds):  # of nodes: a tick at each grid that there is
        ax.set_xticks(bounds)
    ax.grid(axis="y")
    if len(fractions) > 1:
        ax.legend()


def draw_bars(
    ax: Axes,
    groups: Sequence[str],
    values: Mapping[str, Sequence[float]],
    *,
    ylabel: str,
    intervals: Mapping[str, Sequence[tuple[float, float] | FloatArray]] | None = None,
    fmt: str = "{:.3g}",
) -> None:
    """Grouped bars with their values above: groups along the axis, in each one bar for each entry of `values`.

    `intervals`, where given, are the ends of each bar's interval of confidence, and the values stand above these.
    """
    width = 0.8 / len(values)
    for place, (label, heights) in enumerate(values.items()):
        x = np.arange(len(groups)) + (place - (len(values) - 1) / 2) * width
        looks = {"color": BARS[place % len(BARS)], "hatch": HATCHES[place % len(HATCHES)]}
        looks |= {"edgecolor": INK, "linewidth": 0.7}
        if intervals:
            looks["yerr"] = np.abs(np.transpose(intervals[label]) - np.asarray(heights))
            looks["error_kw"] = {"linewidth": 0.8, "capsize": 2.0}
        bars = ax.bar(x, heights, 0.92 * width, label=label, gid=f"bars-{label}", **looks)
        ax.bar_label(bars, [fmt.format(height) for height in heights], fontsize=6.5, padding=1.5)
    ax.set_xticks(np.arange(len(groups)), groups)
    ax.tick_params(axis="x", length=0)
    ax.set_ylabel(ylabel)
    ax.margins(y=0.14)
    if len(values) > 1:
        ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(values))
