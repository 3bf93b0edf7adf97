"""What the grid hides: interpolants on a line, runs that fail, promises that are broken."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from widgets import Explorer, Numbers, choice, slider

from sdhj.kernels import FloatArray
from sdhj.plotting.looks import FULL_LOOKS, OUTCOME_INK

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


KINDS = {
    "one target": lambda x, shift: (x - shift) ** 2 - 0.1,
    "union of two": lambda x, shift: np.minimum(np.abs(x + 0.4 - shift), np.abs(x - 0.4 - shift)) - 0.3,
    "a thin post": lambda x, shift: 0.06 - np.abs(x - shift),
}


def explore_interpolation() -> Explorer:
    """A function on a line and its interpolant: what is falsely inside, and what is lost."""

    def draw(figure: Figure, kind: str, cells: int, shift: float) -> Numbers:
        nodes, x = np.linspace(-1, 1, cells + 1), np.linspace(-1, 1, 4001)
        exact = KINDS[kind](x, shift)
        chord = np.interp(x, nodes, KINDS[kind](nodes, shift))
        draw_interpolant(ax := figure.subplots(), (nodes, x, exact, chord))
        ax.legend(loc="upper right", ncols=5)
        return {
            "largest error": float(np.abs(chord - exact).max()),
            "falsely inside": float(np.mean((chord <= 0) & (exact > 1e-12))),
            "lost": float(np.mean((chord > 0) & (exact <= 0))),
        }

    controls = {
        "kind": choice("function", list(KINDS), "union of two"),
        "cells": slider("cells", 4, 40, 1, 10),
        "shift": slider("shift", -0.3, 0.3, 0.01, 0.05),
    }
    return Explorer(draw, controls, size=(6.6, 3.2), alt="A function on a line and its interpolant", motion="shift")


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
