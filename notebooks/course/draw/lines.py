"""Pictures on a line: interpolants, certificates, sets that are shrunk; and what fails and where the limits are."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sdhj.kernels import FloatArray
from sdhj.plotting import step_colours
from sdhj.plotting.looks import FULL_LOOKS, OUTCOME_INK, TARGET_LOOKS, UNSAFE_LOOKS

FALSE, LOST = "#c62828", "#8c8c8c"
Line = tuple[FloatArray, FloatArray, FloatArray, FloatArray]  # nodes, fine places, the function and its interpolant


def draw_interpolant(ax: Axes, line: Line) -> None:
    """A function and its interpolant; below them what is truly inside, and what the interpolant says."""
    nodes, x, exact, chord = line
    ax.axhline(0.0, color="#8c8c8c", linewidth=0.6)
    ax.plot(x, exact, color=OUTCOME_INK, linestyle="--", label="function", gid="exact")
    ax.plot(x, chord, color="#0b3c5d", linestyle="-", label="interpolant", gid="chord")
    ax.plot(nodes, np.interp(nodes, x, exact), "o", color="#0b3c5d", markersize=3)
    both = {
        "inside": ((exact <= 0) & (chord <= 0), FULL_LOOKS["edgecolor"]),
        "falsely inside": ((exact > 1e-12) & (chord <= 0), FALSE),
        "lost": ((exact <= 0) & (chord > 0), LOST),
    }
    low = min(exact.min(), chord.min())
    for label, (where, colour) in both.items():
        bar = np.where(where, low - 0.08, np.nan)
        ax.plot(x, bar, color=colour, linewidth=5, linestyle="-", solid_capstyle="butt", label=label, gid=label)
    ax.set(xlabel="$x$", xlim=(-1, 1))


def draw_interpolants(figure: Figure, cases: Mapping[str, Line]) -> None:
    """Functions on a line and their interpolants, side by side."""
    axes = np.atleast_1d(figure.subplots(1, len(cases)))
    for ax, (title, line) in zip(axes, cases.items(), strict=True):
        draw_interpolant(ax, line)
        ax.set_title(title)
    axes[0].set_ylabel("level-set function")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=5)


def draw_failures(ax: Axes, groups: Sequence[tuple[float, float]]) -> None:
    """Share of runs that fail against how deep in the tube they start: (level-set value in m, share) of each group."""
    depth, share = np.array(groups).T
    ax.plot(depth, 100 * share, marker="o", gid="failures")
    ax.set(xlabel="level-set value at the start (m); 0 is the boundary", ylabel="runs that fail (%)", ylim=(0, None))
    ax.grid(axis="y")


def draw_deficit(ax: Axes, ended: FloatArray, promised: FloatArray) -> None:
    """Values in which intervals ended, of the set they were promised: above zero the promise was broken."""
    bins = np.linspace(-0.06, 0.02, 41)
    for kind, looks in ((promised, {"color": "#0b3c5d"}), (~promised, {"color": FALSE})):
        label = "an input was promised" if looks["color"] != FALSE else "none was"
        ax.hist(np.clip(ended[kind], bins[0], bins[-1]), bins, histtype="stepfilled", alpha=0.75, label=label, **looks)
    ax.axvline(0.0, color="black", linewidth=0.8)
    ax.set(xlabel="value at the end of the interval (m)", ylabel="intervals", yscale="log")
    ax.legend()


Claims = dict[tuple[int, int], tuple[int, int | None]]  # (step, cell): steps to go, input
ENDS, TARGET, DELTA, STEPS = 1.5, 0.3, 0.25, 4
ARROWS = {-1: "<", 0: "·", 1: ">"}


def draw_line(ax: Axes, cells: int, certificate: Claims, post: Callable[[Any], Any]) -> None:
    """Certified cells of each step, coloured by steps to go, over the way of the post; time runs upwards."""
    image, colours = np.zeros((STEPS + 1, cells, 4)), step_colours(STEPS)
    for (k, cell), (n, u) in certificate.items():
        image[k, cell] = colours[n]
        if u is not None and cells <= 60:
            x = -ENDS + (cell + 0.5) * 2 * ENDS / cells
            ax.text(x, k * DELTA, ARROWS[u], ha="center", va="center", fontsize=7, color="white" if n < 2 else "black")
    half = 0.35 * DELTA
    for k in range(STEPS + 1):
        extent = (-ENDS, ENDS, k * DELTA - half, k * DELTA + half)
        ax.imshow(image[k : k + 1], extent=extent, origin="lower", aspect="auto", interpolation="nearest", zorder=2.0)
    times = np.linspace(0, STEPS * DELTA, 2)
    left, right = np.array([[float(end) for end in post(t)] for t in times]).T
    ax.fill_betweenx(times, left, right, zorder=3.0, alpha=0.8, gid="post", **UNSAFE_LOOKS)
    for end in (-TARGET, TARGET):
        ax.axvline(end, color=OUTCOME_INK, linewidth=0.9, linestyle="--", zorder=4.0)
    ax.set(xlim=(-ENDS, ENDS), ylim=(-0.6 * DELTA, (STEPS + 0.6) * DELTA), xlabel="$x$")
    ax.set_yticks(DELTA * np.arange(STEPS + 1), [f"{k}" for k in range(STEPS + 1)])


def draw_line_game(figure: Figure, cases: dict[str, tuple[int, Claims]], post: Callable[[Any], Any]) -> None:
    """Certificates on a line side by side."""
    axes = np.atleast_1d(figure.subplots(1, len(cases), sharey=True))
    for ax, (title, (cells, certificate)) in zip(axes, cases.items(), strict=True):
        draw_line(ax, cells, certificate, post)
        ax.set_title(title)
    axes[0].set_ylabel("step $k$")


def draw_limits(ax: Axes, bounds: FloatArray, shares: FloatArray, limit: float) -> None:
    """Shares of C within 0 and 8 steps, (B, 2), against the disturbance, with the limit that the pencil found."""
    for column, label in enumerate(("in the target", "within 8 steps")):
        ax.plot(bounds, shares[:, column], marker="o", label=label, gid=label)
    ax.axvline(limit, color="#c44e00", linestyle=":", label="predicted limit")
    share = r"share of $\mathcal{C}$ inside"
    ax.set(xlabel="disturbance of the joints (rad/s)", ylabel=share, ylim=(0, 1.05 * float(np.max(shares))))
    ax.grid(axis="y")
    ax.legend()


Row = tuple[str, Sequence[tuple[Any, Any]], str]  # what is written, intervals, and "known" or "true"
COLOURS = {"true": TARGET_LOOKS["facecolor"], "known": "#f2c14e"}


def draw_line_sets(ax: Axes, rows: Sequence[Row], box: float) -> None:
    """Sets of a line, one below the other: sets of states blue, of predictions yellow; the first row is on top."""
    for place, (label, intervals, kind) in enumerate(reversed(rows)):
        for low, high in intervals:
            ax.plot(
                [float(low), float(high)],
                [place, place],
                linewidth=9,
                linestyle="-",
                color=COLOURS[kind],
                solid_capstyle="butt",
                gid=label,
            )
            for end, away in ((float(low), -1), (float(high), 1)):
                ax.annotate(
                    f"{end:.2f}", (end, place), (4 * away, 0), textcoords="offset points", va="center", fontsize=7,
                    ha="left" if away > 0 else "right",
                )  # fmt: skip
    ax.set_yticks(range(len(rows)), [label for label, _, _ in reversed(rows)])
    ax.plot([-box, box], [len(rows) - 0.3] * 2, linewidth=2, linestyle="-", color=OUTCOME_INK, gid="box")
    ax.text(box, len(rows) - 0.3, " the box E", va="center", fontsize=8, color=OUTCOME_INK)
    ax.set(xlabel="q", ylim=(-0.7, len(rows) + 0.1))
    ax.margins(x=0.12)
