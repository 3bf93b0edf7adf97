"""What the grid hides, and what a certificate repairs."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from live_slices import LIVE, POSTURE, draw_arm_live, draw_pixels, draw_sets_quickly
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from widgets import Explorer, Numbers, agent_sliders, step_sliders

from sdhj.grid import FloatArray
from sdhj.plotting import plane
from sdhj.plotting.looks import FULL_LOOKS, INNER_LOOKS
from sdhj.table import Table


def draw_failures(ax: Axes, depth: FloatArray, failed: FloatArray, *, bins: int = 8) -> None:
    """Share of runs that fail against how deep in the tube they start (the level-set value, m), in equal groups."""
    order = np.array_split(np.argsort(depth), bins)
    middles = [float(np.median(depth[group])) for group in order]
    ax.plot(middles, [100 * float(failed[group].mean()) for group in order], marker="o", gid="failures")
    ax.set(xlabel="level-set value at the start (m); 0 is the boundary", ylabel="runs that fail (%)", ylim=(0, None))
    ax.grid(axis="y")


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
    draw_pixels(right, image, (where.x[0], where.x[-1], where.y[0], where.y[-1]), "certified")
    draw_sets_quickly(right, problem, through=state, step=start, filled=False, resolution=81)
    right.set_title(f"dark: proved; light: interpolated only; within {within}")
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
        draw, {**agent_sliders(table.problem), **step_sliders(table)}, alt="Certified and interpolated tube"
    )
