"""Numbers across many solves or runs: computation times (Fig. 14) and the experiments of Sec. 6.1."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from sdhj.grid import FloatArray
from sdhj.plotting.looks import INK

METHOD_LOOKS: dict[str, dict[str, Any]] = {
    "hji": {"color": "#0b3c5d", "linestyle": "-", "marker": "o"},
    "projected": {"color": "#c44e00", "linestyle": "--", "marker": "s"},
    "lax": {"color": "#2a8c82", "linestyle": "-.", "marker": "^"},
    "certified": {"color": "#8a5a9e", "linestyle": ":", "marker": "D"},
}
METHOD_NAMES = {"hji": "full", "projected": "projected", "lax": "Hopf-Lax", "certified": "certified"}
PAPER_NODES = (25, 30, 35, 40)
PAPER_SECONDS = {"hji": (586.0, 1540.0, 3093.0, 5615.0), "projected": (105.0, 190.0, 347.0, 549.0)}
PAPER_MACHINE = "Intel Xeon W-2145"
BARS = ("#0b3c5d", "#7fb2e5", "#e9eef3", "#c9c9c9")
HATCHES = ("", "////", "....", "xxxx")


def draw_timings(
    axes: Sequence[Axes], measured: Mapping[str, Mapping[int, float]], machine: str = "this machine"
) -> None:
    """Seconds against nodes on each axis beside the paper's, and the ratio of full to projected (Fig. 14).

    Parameters
    ----------
    axes : two Axes
    measured : {method: {nodes: seconds}}
        Setting up the constraints and the whole recursion, as the paper counts.
    machine : str
        What they were measured on, for the legend.
    """
    times, ratio = axes
    times.set_yscale("log")
    for method, seconds in PAPER_SECONDS.items():
        looks = METHOD_LOOKS[method] | {"color": "#9a9a9a", "markerfacecolor": "white"}
        label = f"{METHOD_NAMES[method]}, paper ({PAPER_MACHINE})"
        times.plot(PAPER_NODES, seconds, label=label, gid=f"paper-{method}", **looks)
    for method, by_nodes in measured.items():
        nodes = sorted(by_nodes)
        label = f"{METHOD_NAMES[method]}, {machine}"
        times.plot(nodes, [by_nodes[n] for n in nodes], label=label, gid=f"measured-{method}", **METHOD_LOOKS[method])
    times.set(xlabel="nodes on each axis", ylabel="computation time (s)")
    times.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2 if len(measured) > 1 else 1)
    paper = np.divide(PAPER_SECONDS["hji"], PAPER_SECONDS["projected"])
    ratio.plot(
        PAPER_NODES,
        paper,
        color="#9a9a9a",
        marker="o",
        markerfacecolor="white",
        linestyle="-",
        label="paper",
        gid="paper-ratio",
    )
    if {"hji", "projected"} <= set(measured):
        nodes = sorted(set(measured["hji"]) & set(measured["projected"]))
        ours = [measured["hji"][n] / measured["projected"][n] for n in nodes]
        ratio.plot(nodes, ours, color=INK, marker="o", linestyle="-", label=machine, gid="measured-ratio")
    ratio.set(xlabel="nodes on each axis", ylabel="full / projected", ylim=(0, None))
    ratio.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    ticks = sorted(set(PAPER_NODES) | {n for by_nodes in measured.values() for n in by_nodes})
    for ax in axes:
        ax.set_xticks(ticks)
        ax.minorticks_off()
        ax.grid(axis="y")


def draw_sweep(
    ax: Axes,
    bounds: Sequence[float] | FloatArray,
    fractions: Mapping[str, Sequence[float] | FloatArray],
    *,
    xlabel: str,
    nominal: float | None = None,
) -> None:
    """Share of C from which the robot wins, against a bound of the adversary's; one line for each entry (Sec. 6.1).

    Parameters
    ----------
    bounds : (B,)
    fractions : {label: (B,)}
        Methods by their names, or any other label.
    nominal : float, optional
        The case study's own value, marked.
    """
    for label, values in fractions.items():
        looks = METHOD_LOOKS.get(label, {"marker": "o"})
        ax.plot(bounds, np.asarray(values), label=METHOD_NAMES.get(label, label), gid=f"sweep-{label}", **looks)
    if nominal is not None:
        ax.axvline(nominal, color="#8c8c8c", linestyle=":", linewidth=0.9)
        ax.annotate(
            "case study",
            (nominal, 1.0),
            (2, -2),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            rotation=90,
            va="top",
            ha="left",
            color="#666666",
            fontsize=7,
        )
    ax.set(xlabel=xlabel, ylabel="share of $\\mathcal{C}$ inside", ylim=(0, None))
    ax.grid(axis="y")
    if len(fractions) > 1:
        ax.legend()


def draw_bars(
    ax: Axes, groups: Sequence[str], values: Mapping[str, Sequence[float]], *, ylabel: str, fmt: str = "{:.3g}"
) -> None:
    """Grouped bars with their values above: groups along the axis, in each one bar for each entry of `values`."""
    width = 0.8 / len(values)
    for place, (label, heights) in enumerate(values.items()):
        x = np.arange(len(groups)) + (place - (len(values) - 1) / 2) * width
        bars = ax.bar(
            x,
            heights,
            0.92 * width,
            label=label,
            color=BARS[place % len(BARS)],
            hatch=HATCHES[place % len(HATCHES)],
            edgecolor=INK,
            linewidth=0.7,
            gid=f"bars-{label}",
        )
        ax.bar_label(bars, [fmt.format(height) for height in heights], fontsize=6.5, padding=1.5)
    ax.set_xticks(np.arange(len(groups)), groups)
    ax.tick_params(axis="x", length=0)
    ax.set_ylabel(ylabel)
    ax.margins(y=0.14)
    if len(values) > 1:
        ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(values))


def draw_input_levels(
    axes: Sequence[Axes], levels: Sequence[int], fractions: Sequence[float], seconds: Sequence[float]
) -> None:
    """What more input levels bring and cost (Sec. 6.1): share of C inside; seconds against L, with a line through."""
    gain, cost = axes
    gain.plot(levels, fractions, gid="levels-fraction", **METHOD_LOOKS["hji"])
    gain.set(xlabel="levels of each input component", ylabel="share of $\\mathcal{C}$ inside", xticks=list(levels))
    counts = np.square(np.asarray(levels, dtype=np.float64))
    cost.plot(counts, seconds, gid="levels-seconds", **(METHOD_LOOKS["hji"] | {"linestyle": "none"}))
    if len(counts) > 1:
        slope, offset = np.polyfit(counts, np.asarray(seconds, dtype=np.float64), 1)
        ends = np.array([0.0, counts.max()])
        cost.plot(
            ends,
            offset + slope * ends,
            color="#8c8c8c",
            linestyle="--",
            label=f"{slope:.2g} s for each input",
            gid="levels-line",
        )
        cost.legend()
    cost.set(xlabel="number of inputs $L$", ylabel="time to solve (s)", ylim=(0, None), xticks=counts)
    for ax in axes:
        ax.grid(axis="y")


def draw_cells(ax: Axes, numbers: Sequence[int], fractions: Sequence[float], interpolated: Mapping[str, float]) -> None:
    """Certified share of C against the number of cells, beside what interpolated tables of methods claim."""
    for method, fraction in interpolated.items():
        looks = {key: METHOD_LOOKS[method][key] for key in ("color", "linestyle")}
        ax.axhline(fraction, gid=f"claimed-{method}", label=f"{METHOD_NAMES[method]}, claimed: {fraction:.3f}", **looks)
    ax.semilogx(numbers, fractions, gid="certified", label="certified", **METHOD_LOOKS["certified"])
    for number, fraction in zip(numbers, fractions, strict=True):
        ax.annotate(f"{fraction:.3f}", (number, fraction), (0, -11), textcoords="offset points", fontsize=6.5)
    ax.set(xlabel="cells", ylabel="share of $\\mathcal{C}$ inside", ylim=(0, None))
    ax.margins(x=0.12)
    ax.grid(axis="y")
    ax.legend(loc="lower right")


def draw_entries(
    ax: Axes, values: FloatArray, *, fmt: str = "{:.2f}", label: str = "", cmap: str = "cividis", vmin: float = 0.0
) -> None:
    """One number for each (start, within) as the triangle of Fig. 8, for example the ratio of two tables' volumes.

    `values` (N + 1, N + 1) with NaN where there is no entry; an infinite one is written without a colour.
    """
    import matplotlib as mpl

    top = float(np.max(values, where=np.isfinite(values), initial=vmin))
    mesh = ax.imshow(np.ma.masked_invalid(values), cmap=cmap, vmin=vmin, vmax=max(top, vmin + 1e-12), gid="entries")
    colours = mpl.colormaps[cmap]
    for (k, n), value in np.ndenumerate(values):
        if not np.isnan(value):
            red, green, blue, _ = colours(mesh.norm(value)) if np.isfinite(value) else (1.0, 1.0, 1.0, 1.0)
            dark = 0.2126 * red + 0.7152 * green + 0.0722 * blue < 0.5
            ax.text(
                n,
                k,
                fmt.format(value) if np.isfinite(value) else r"$\infty$",
                ha="center",
                va="center",
                fontsize=6.5,
                color="white" if dark else "black",
            )
    count = len(values)
    ax.set(xticks=range(count), yticks=range(count), xlabel="steps to go, $n$", ylabel="from step $k$", title=label)
    ax.tick_params(length=0)
    for spine in ax.spines.values():
        spine.set_visible(False)


def fraction_curves(ax: Axes, tables: Mapping[str, Sequence[float]]) -> list[Line2D]:
    """Share of C inside against the steps to go, a line for each method."""
    lines = []
    for method, fractions in tables.items():
        looks = METHOD_LOOKS.get(method, {"marker": "o"})
        lines += ax.plot(
            range(len(fractions)), fractions, label=METHOD_NAMES.get(method, method), gid=f"fraction-{method}", **looks
        )
    ax.set(xlabel="steps to go, $n$", ylabel="share of $\\mathcal{C}$ inside", ylim=(0, None))
    ax.grid(axis="y")
    ax.legend()
    return lines
