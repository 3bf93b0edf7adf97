"""Tubes of the arm in four dimensions: slices beside the arm, one method over another, surfaces."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from course.draw.slices import (
    HERE,
    LIVE,
    around,
    draw_arm_live,
    draw_pixels,
    draw_sets_quickly,
    draw_short_bar,
    draw_slice_legend,
    draw_steps,
    fewest_steps,
    here,
    slice_values,
    steps_image,
)
from course.paper import draw_isosurface
from course.widgets import Numbers
from sdhj.arm.case_studies import scene
from sdhj.kernels import FloatArray
from sdhj.plotting import draw_arm, draw_workspace, plane
from sdhj.plotting.looks import FULL_LOOKS, INNER_LOOKS, OUTCOME_INK
from sdhj.plotting.slices import Plane
from sdhj.problem.grid import Grid
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.table.batches import Table

TALL = (8.2, 3.8)  # inches, with a legend below


def draw_tube_and_arm(
    figure: Figure,
    table: Table,
    *,
    state: Sequence[float],
    start: int = 0,
    within: int | None = None,
    axes: Sequence[int] = (0, 1),
) -> Numbers:
    """A slice of the four-dimensional tube through a state, beside the arm in that state."""
    within = table.steps - start if within is None else min(within, table.steps - start)
    grid = figure.add_gridspec(1, 3, width_ratios=(1.0, 1.0, 0.05))
    left, right, bar = (figure.add_subplot(grid[0, column]) for column in range(3))
    problem = table.problem
    draw_arm_live(left, problem, state, start * problem.delta)
    left.set_title(f"workspace at step {start}")
    fewest = steps_image(table, through=state, start=start, within=within, axes=axes)
    draw_steps(right, table, fewest, within=within, axes=axes)
    draw_sets_quickly(right, problem, through=state, step=start, axes=axes, filled=False, resolution=81)
    right.plot(*here(table.grid, state, axes), **HERE)
    right.set_title(f"from step {start}, within {within} steps")
    draw_short_bar(bar, table.steps)
    draw_slice_legend(figure, problem)
    return {
        "share of the slice inside": float((fewest[:-1, :-1] <= within).mean()),
        "share of C inside": table.fraction(start=start, within=within),
        "steps to go of this state": fewest_steps(table, state, start, within),
    }


def draw_pursuer_plane(
    ax: Axes, table: Table, *, state: Sequence[float], start: int = 0, within: int | None = None
) -> Numbers:
    """The other slice: joint angles fixed, where may the pursuer be? Tubes in (px, py) with the arm drawn into them."""
    within = table.steps - start if within is None else min(within, table.steps - start)
    draw_workspace(ax, scene(table.problem), time=start * table.problem.delta)
    draw_arm(ax, scene(table.problem), state[:2])
    fewest = steps_image(table, through=state, start=start, within=within, axes=(2, 3))
    draw_steps(ax, table, fewest, within=within, axes=(2, 3))
    ax.set(aspect="equal", title="where the pursuer may be, for this posture")
    return {"share of the pursuer's places": float((fewest <= within).mean())}


def draw_surface(figure: Figure, table: Table, *, through: Sequence[float]) -> None:
    """The boundary of the whole tube from step 0 over the first three axes."""
    ax, grid = figure.add_subplot(projection="3d"), table.grid
    draw_isosurface(ax, table, through=through)
    for axis, name in enumerate("xyz"):
        if not grid.periodic[axis]:
            getattr(ax, f"set_{name}ticks")((grid.lower[axis], 0.0, grid.upper[axis]))
        elif grid.names[axis] == "heading":
            getattr(ax, f"set_{name}label")("heading (rad)", labelpad=-4)
    ax.set_box_aspect(None, zoom=0.92)


def draw_over(
    figure: Figure, problem: ReachAvoidProblem, where: Plane, state: Sequence[float], start: int, masks: Sequence[Any]
) -> Axes:
    """The workspace in `state`, and beside it sets of a slice over each other: light, dark, orange. Its axes."""
    left, right = figure.subplots(1, 2)
    draw_arm_live(left, problem, state, start * problem.delta)
    left.set_title("workspace")
    image = np.zeros((*masks[0].shape, 4))
    for mask, colour in zip(masks, (FULL_LOOKS["facecolor"], INNER_LOOKS["facecolor"], OUTCOME_INK), strict=False):
        image[mask] = to_rgba(colour)
    draw_pixels(right, image, around(where.x, where.y), "sets")
    draw_sets_quickly(right, problem, through=state, step=start, filled=False, resolution=81)
    return right


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
    where = plane(full.grid, state, resolution=LIVE)
    a, b = (
        slice_values(table.grid, table.values(start=start, within=within), state, (0, 1), where.x, where.y)
        for table in (full, inner)
    )
    right = draw_over(figure, full.problem, where, state, start, (a <= 0, b <= 0, (b <= 0) & (a > 0)))
    right.set_title(f"light: {full.method}, dark: {inner.method}; within {within}")
    return {
        f"slice inside, {full.method}": float((a <= 0).mean()),
        f"slice inside, {inner.method}": float((b <= 0).mean()),
        f"in {inner.method} and not in {full.method}": float(((b <= 0) & (a > 0)).mean()),
    }


def draw_toy(figure: Figure, grid: Grid, cases: Mapping[str, tuple[FloatArray, FloatArray]]) -> None:
    """Reach sets in the plane (light) under what comes back from the line (dark); orange where that is wrong."""
    axes = figure.subplots(1, len(cases), sharey=True)
    for ax, (title, (full, line)) in zip(axes, cases.items(), strict=True):
        claimed = np.broadcast_to(line[:, None] <= 0, grid.shape)
        image = np.zeros((*grid.shape, 4))
        image[full <= 0] = to_rgba(FULL_LOOKS["facecolor"])
        image[claimed] = to_rgba(INNER_LOOKS["facecolor"])
        image[claimed & (full > 1e-9)] = to_rgba(OUTCOME_INK)
        extent = (grid.lower[0], grid.upper[0], grid.lower[1], grid.upper[1])
        draw_pixels(ax, image.swapaxes(0, 1), extent, "toy")
        ax.contour(grid.nodes(0), grid.nodes(1), full.T, levels=[0.0], colors=[FULL_LOOKS["edgecolor"]], linewidths=1.0)
        ax.set(title=title, xlabel="kept, $x$", xlim=(-1, 1))
    axes[0].set_ylabel(r"dropped, $\omega$")


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
    where = plane(table.grid, state, resolution=LIVE)
    said, proved = (where.shaped(t.contains(where.points, start=start, within=within)) > 0 for t in (table, certified))
    right = draw_over(figure, table.problem, where, state, start, (said, proved))
    right.plot(*here(table.grid, state), **HERE)
    right.set_title(f"from step {start}, within {within} steps")
    areas = (FULL_LOOKS, "inside by interpolation only"), (INNER_LOOKS, "proved")
    draw_slice_legend(
        figure, table.problem, *(Patch(facecolor=looks["facecolor"], label=told) for looks, told in areas)
    )
    return {
        "slice inside by interpolation": float(said.mean()),
        "slice proved": float(proved.mean()),
        "proved and not inside by interpolation": float((proved & ~said).mean()),
    }
