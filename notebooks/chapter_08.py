"""Tubes in four dimensions: slices in the joint angles and in the pursuer's plane, surfaces. Chapters 10 and 14 too."""

from collections.abc import Sequence
from functools import lru_cache

from live_slices import (
    HERE,
    POSTURE,
    draw_arm_live,
    draw_sets_quickly,
    draw_short_bar,
    draw_slice_legend,
    draw_steps,
    fewest_steps,
    here,
    steps_image,
)
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from paper import draw_isosurface
from widgets import Explorer, Numbers, agent_sliders, angle, choice, slider, step_sliders

import sdhj
from sdhj.arm.case_studies import OBSTACLES, scene
from sdhj.arm.workspace import Disk, Still
from sdhj.plotting import draw_arm, draw_workspace
from sdhj.table.batches import Table

TALL = (8.2, 3.8)  # inches, with a legend below
PLANES = {"q1 and q2": (0, 1), "px and py": (2, 3), "q1 and px": (0, 2), "q2 and py": (1, 3)}


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
    draw_workspace(ax, scene(table.problem), time=start * table.problem.delta, arrows=False)
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


def explore_tube(table: Table) -> Explorer:
    """Slice the four-dimensional tube wherever you like."""

    def draw(figure: Figure, axes: str, start: int, within: int, **at: float) -> Numbers:
        state = [at[name] for name in ("q1", "q2", "px", "py")]
        return draw_tube_and_arm(figure, table, state=state, start=start, within=within, axes=PLANES[axes])

    controls = {
        "axes": choice("slice", list(PLANES), "q1 and q2"),
        **agent_sliders(table.problem),
        **step_sliders(table),
        "q1": angle("joint angle q1 (rad)", POSTURE[0]),
        "q2": angle("joint angle q2 (rad)", POSTURE[1]),
    }
    return Explorer(draw, controls, size=TALL, alt="A slice of the tube beside the arm", motion="px")


def explore_pursuer(table: Table) -> Explorer:
    """The other slice: for one posture of the arm, where may the pursuer be?"""

    def draw(figure: Figure, q1: float, q2: float, start: int, within: int) -> Numbers:
        return draw_pursuer_plane(figure.subplots(), table, state=(q1, q2, 0.36, 0.36), start=start, within=within)

    controls = {
        "q1": angle("joint angle q1 (rad)", POSTURE[0]),
        "q2": angle("joint angle q2 (rad)", POSTURE[1]),
        **step_sliders(table),
    }
    return Explorer(draw, controls, size=(4.8, 3.9), alt="Where the pursuer may start", motion="q1")


def explore_arm_game(nodes: int = 15, method: str = "hji") -> Explorer:
    """The arm's game in four dimensions, solved at each change of the adversary, clock, inputs or an obstacle."""

    @lru_cache(maxsize=2)  # a table of 25 nodes takes 180 MB, which the system is slow to hand out
    def solved(v_p: float, v_d: float, delta: float, levels: int, x: float, y: float) -> Table:
        obstacles = (Disk(Still((x, y)), 0.06), *OBSTACLES[1:])
        problem = sdhj.arm_case_study(
            nodes, delta=delta, v_p_max=v_p, v_d_max=v_d, input_levels=levels, obstacles=obstacles
        )
        return sdhj.solve(problem, method=method, progress=False)

    def draw(figure: Figure, v_p: float, v_d: float, delta: float, levels: int, x: float, y: float) -> Numbers:
        return draw_tube_and_arm(figure, solved(v_p, v_d, delta, levels, x, y), state=(*POSTURE, 0.24, 0.24))

    controls = {
        "v_p": slider("pursuer's speed (m/s)", 0.0, 0.8, 0.05, 0.2, live=False),
        "v_d": slider("disturbance (rad/s)", 0.0, 2.0, 0.1, 0.3, live=False),
        "delta": slider("sampling interval (s)", 0.05, 0.2, 0.01, 0.1, live=False),
        "levels": slider("input levels on each axis", 2, 7, 1, 5, live=False),
        "x": slider("static obstacle x (m)", -0.3, 0.3, 0.02, -0.22, live=False),
        "y": slider("static obstacle y (m)", -0.3, 0.3, 0.02, 0.1, live=False),
    }
    return Explorer(draw, controls, size=TALL, slow=True, alt="A slice of the tube, solved anew", motion="v_d")
