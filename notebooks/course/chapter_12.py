"""Chapter 12, What the grid hides: what it draws, its widgets, and the checks of its exercises."""

from collections.abc import Mapping, Sequence
from functools import cache

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import sdhj
from course.exercises import exercise, expect, expect_close
from course.widgets import Explorer, Numbers, choice, slider
from sdhj.common.remembering import FloatArray
from sdhj.plotting.looks import FULL_LOOKS, OUTCOME_INK
from sdhj.simulation.adversaries import Moment
from sdhj.simulation.runs import rollouts

# ---- pictures

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


# ---- widgets

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


# ---- checks


@exercise("12.1", "theta (1 - theta) is at most 1/4, and J is by how much the slope jumps.")
def check_chord(smooth_error, kink_error):
    """h^2 max|s''| / 8 and |J| h / 4."""
    expect(abs(smooth_error - 9 * 0.01 / 2) > 1e-12, "theta (1 - theta) is at most 1/4.")
    expect_close(smooth_error, 9 * 0.01 / 8, "(12.2) with h = 0.1: s'' = -9 sin 3x is at most 9 in size.")
    expect(abs(kink_error - 0.025) > 1e-12, "the slope of |x| jumps from -1 to 1: J is 2.")
    expect_close(kink_error, 2 * 0.1 / 4, "(12.4) with h = 0.1.")


@exercise(
    "12.2",
    "What lies on a chord lies between its two ends. So what can happen between two nodes that no node sees?",
)
def check_kink(hidden, which):
    """An interpolant of positive numbers is positive, so only the lost island exists."""
    nodes, x = np.linspace(-1, 1, 11), np.linspace(-1, 1, 20_001)
    expect(which in ("false island", "lost island"), 'say "false island" or "lost island".')
    expect(which == "lost island", "the interpolant between two positive numbers: can it be zero?")
    values, at = np.asarray(hidden(x)), np.asarray(hidden(nodes))
    expect(values.shape == x.shape, "one value for each x.")
    expect(np.abs(np.diff(values)) <= np.diff(x) * (1 + 1e-6), "not 1-Lipschitz: somewhere it is steeper than 1.")
    expect(np.min(values) <= 0, "the function is nowhere <= 0: there is no island to be lost.")
    expect(np.min(at) > 0, "a node is in the set, so the interpolant holds a part of it.")
    return "Multilinear interpolation keeps the sign of its corners; what it loses, it loses between them."


@exercise("12.3", "The probability of seeing none is (1 - 1/500)^M.")
def check_upper(runs_to_see):
    """(1 - 1/500)^M <= 0.01."""
    expect(runs_to_see != 500, "500 runs show it with a probability of 63% only.")
    expect((1 - 1 / 500) ** runs_to_see <= 0.01, "too few: (12.7) is still above 1%.")
    expect((1 - 1 / 500) ** (runs_to_see - 2) > 0.01, "fewer would do.")


@exercise("12.4", "A mean over the chosen runs; of none it is not a number.")
def check_depth(failures_below):
    """A mean over what is left."""
    rng = np.random.default_rng(0)
    depth = -rng.uniform(0, 0.1, 5000)
    failed = rng.uniform(size=5000) < 0.3 + depth
    for epsilon in (0.0, 0.02, 0.05):
        got, wanted = failures_below(depth, failed, epsilon), failed[depth <= -epsilon].mean()
        expect(abs(got - failed[depth <= -epsilon].sum() / 5000) > 1e-9 or epsilon == 0, "of those that are left.")
        expect_close(got, wanted, f"epsilon {epsilon}: the starts with depth <= -epsilon, deep is negative.")
    expect(np.isnan(failures_below(depth, failed, 0.2)), "with no start left the share is not a number.")
    return "With the runs of this chapter: try 0.005, 0.01, 0.02, 0.04."


@cache
def _board():
    """The controller of the case study and 40 starts near the boundary that "worst" does not beat."""
    controller = sdhj.Controller(sdhj.solve(sdhj.arm_case_study(nodes=25), progress=False))
    table, grid = controller.table, controller.problem.grid
    states = np.random.default_rng(11).uniform(grid.lower, grid.upper, (40_000, 4))
    values = grid.interpolate(table.values(start=0, within=8), states)
    states = states[(values <= 0) & (values > -0.006)]
    outcomes, _ = rollouts(controller, states, sdhj.simulation.adversaries.worst, np.random.default_rng(0))
    return controller, states[outcomes == 0][:40]


@exercise(
    "12.5",
    "Play some hundred random sequences from the same state at once: repeat the state, and pick the row by "
    "`moment.runs`.",
)
def check_search(search):
    """Corners, one for each interval, that beat a run; replayed here."""
    controller, starts = _board()
    rng, beaten = np.random.default_rng(1), 0
    for q in starts:
        signs = np.asarray(search(controller, q, rng), dtype=np.float64)
        if not signs.size:
            continue
        expect(signs.shape == (controller.problem.steps, 4), "one row of four signs for each of the N intervals.")
        expect(np.abs(signs) <= 1, "signs: within -1 and 1, times the bounds.")

        def play(moment: Moment, signs=signs):
            return np.broadcast_to(signs[moment.step], moment.bounds.shape) * moment.bounds

        outcomes, _ = rollouts(controller, q[None], play, np.random.default_rng(0))
        expect(outcomes[0] != 0, "a sequence that you returned does not beat the robot when it is played again.")
        beaten += 1
    expect(beaten >= 2, f"{beaten} of {len(starts)} beaten; more tries, or tries near those that came close?")
    return f'{beaten} of {len(starts)} starts beaten that "worst" does not beat.'
