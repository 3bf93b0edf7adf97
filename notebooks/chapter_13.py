"""Certificates: a game on a line with its proof, and what of the arm's tube is proved."""

from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from live_slices import (
    HERE,
    LIVE,
    POSTURE,
    around,
    draw_arm_live,
    draw_pixels,
    draw_sets_quickly,
    draw_slice_legend,
    here,
)
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from widgets import Explorer, Numbers, agent_sliders, slider, step_sliders

from sdhj.plotting import plane, step_colours
from sdhj.plotting.looks import FULL_LOOKS, INNER_LOOKS, OUTCOME_INK, UNSAFE_LOOKS
from sdhj.table.batches import Table


def draw_certified(
    figure: Figure,
    table: Table,
    certified: Any,
    *,
    state: Sequence[float],
    start: int = 0,
    within: int | None = None,
) -> Numbers:
    """What is proved (dark) of what interpolation says (light), on a slice through the pursuer in `state`."""
    within = table.steps - start if within is None else min(within, table.steps - start)
    left, right = figure.subplots(1, 2)
    problem = table.problem
    draw_arm_live(left, problem, state, start * problem.delta)
    left.set_title("workspace")
    where = plane(table.grid, state, resolution=LIVE)
    said, proved = (where.shaped(t.contains(where.points, start=start, within=within)) > 0 for t in (table, certified))
    image = np.zeros((*said.shape, 4))
    image[said], image[proved] = to_rgba(FULL_LOOKS["facecolor"]), to_rgba(INNER_LOOKS["facecolor"])
    draw_pixels(right, image, around(where.x, where.y), "certified")
    draw_sets_quickly(right, problem, through=state, step=start, filled=False, resolution=81)
    right.plot(*here(table.grid, state), **HERE)
    right.set_title(f"from step {start}, within {within} steps")
    areas = (FULL_LOOKS, "inside by interpolation only"), (INNER_LOOKS, "proved")
    draw_slice_legend(figure, problem, *(Patch(facecolor=looks["facecolor"], label=told) for looks, told in areas))
    return {
        "slice inside by interpolation": float(said.mean()),
        "slice proved": float(proved.mean()),
        "proved and not inside by interpolation": float((proved & ~said).mean()),
    }


def explore_certified(table: Table, certified: Any) -> Explorer:
    """What of an interpolated table is certified, slice by slice."""

    def draw(figure: Figure, px: float, py: float, start: int, within: int) -> Numbers:
        return draw_certified(figure, table, certified, state=(*POSTURE, px, py), start=start, within=within)

    return Explorer(
        draw,
        {**agent_sliders(table.problem), **step_sliders(table)},
        size=(8.6, 3.8),
        alt="Certified and interpolated tube",
        motion="px",
    )


# ----------------------------------------------------------------------------------------------------------------------
# The game on a line
# ----------------------------------------------------------------------------------------------------------------------

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


def explore_line(certify: Callable[..., Claims], post: Callable[[Any], Any]) -> Explorer:
    """The certificate on a line for any number of cells and any wind, by the function that the chapter wrote."""

    def draw(figure: Figure, cells: int, wind: int) -> Numbers:
        certificate = certify(cells, Fraction(wind, 100))
        draw_line(figure.subplots(), cells, certificate, post)
        return {
            "certified from step 0": sum(k == 0 for k, _ in certificate) / cells,
            "claims": len(certificate),
            "a wind's way, in cells": 0.25 * wind / 100 * cells / (2 * ENDS),
        }

    controls = {
        "cells": slider("cells", 20, 240, 1, 60),
        "wind": slider("wind, at most (1/100)", 0, 80, 5, 20),
    }
    return Explorer(draw, controls, size=(6.4, 3.2), alt="Certified cells of a line at steps 0 to 4", motion="cells")
