"""Full against projected."""

from collections.abc import Sequence

import numpy as np
from live_slices import LIVE, POSTURE, draw_arm_live, draw_pixels, draw_sets_quickly, slice_values
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from widgets import Explorer, Numbers, agent_sliders, step_sliders

from sdhj.plotting import plane
from sdhj.plotting.looks import FULL_LOOKS, INNER_LOOKS, OUTCOME_INK
from sdhj.table import Table


def draw_gap(
    figure: Figure,
    full: Table,
    inner: Table,
    *,
    state: Sequence[float],
    start: int = 0,
    within: int | None = None,
) -> Numbers:
    """One tube by two methods over each other, through the pursuer in `state` (Fig. 13): `full` light, `inner` dark."""
    within = full.steps - start if within is None else min(within, full.steps - start)
    left, right = figure.subplots(1, 2)
    problem = full.problem
    draw_arm_live(left, problem, state, start * problem.delta)
    left.set_title("workspace")
    where = plane(full.grid, state, resolution=LIVE)
    a, b = (
        slice_values(table.grid, table.values(start=start, within=within), state, (0, 1), where.x, where.y)
        for table in (full, inner)
    )
    image = np.zeros((*a.shape, 4))
    image[a <= 0], image[b <= 0], image[(b <= 0) & (a > 0)] = (
        to_rgba(colour) for colour in (FULL_LOOKS["facecolor"], INNER_LOOKS["facecolor"], OUTCOME_INK)
    )
    extent = (where.x[0], where.x[-1], where.y[0], where.y[-1])
    draw_pixels(right, image, extent, "gap")
    draw_sets_quickly(right, problem, through=state, step=start, filled=False, resolution=81)
    right.set_title(f"light: {full.method}, dark: {inner.method}; within {within}")
    return {
        f"slice inside, {full.method}": float((a <= 0).mean()),
        f"slice inside, {inner.method}": float((b <= 0).mean()),
        f"in {inner.method} and not in {full.method}": float(((b <= 0) & (a > 0)).mean()),
    }


def explore_gap(full: Table, inner: Table) -> Explorer:
    """A tube by two methods over each other."""

    def draw(figure: Figure, px: float, py: float, start: int, within: int) -> Numbers:
        return draw_gap(figure, full, inner, state=(*POSTURE, px, py), start=start, within=within)

    return Explorer(draw, {**agent_sliders(full.problem), **step_sliders(full)}, alt="Two tubes over each other")
