"""Chapter 8, Four dimensions: what it draws, its widgets, and the checks of its exercises."""

from collections.abc import Sequence
from functools import cache, lru_cache
from unittest.mock import patch

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import sdhj
from course.exercises import exercise, expect, expect_close
from course.paper import draw_isosurface
from course.slices import (
    HERE,
    POSTURE,
    draw_arm_live,
    draw_sets,
    draw_short_bar,
    draw_slice_legend,
    draw_steps,
    fewest_steps,
    here,
    steps_image,
)
from course.widgets import Explorer, Numbers, agent_sliders, angle, choice, played, slider, step_sliders
from sdhj.arm.case_studies import OBSTACLES, scene
from sdhj.arm.workspace import Disk, Still
from sdhj.plotting import draw_arm, draw_workspace
from sdhj.problem.grid import Grid
from sdhj.simulation.runs import Z95
from sdhj.table.batches import Table

# ---- pictures

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
    draw_sets(right, problem, through=state, step=start, axes=axes, filled=False)
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


# ---- widgets

PLANES = {"q1 and q2": (0, 1), "px and py": (2, 3), "q1 and px": (0, 2), "q2 and py": (1, 3)}


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


def explore_growing(steps: int = 20) -> Explorer:
    """The tube while it grows from the target: the case study's 0.8 s, cut into more and shorter intervals."""
    problem = sdhj.arm_case_study((25, 25, 13, 13), steps, delta=0.8 / steps)  # all axes at 25: 0.6 GB of tables
    table = sdhj.solve(problem, progress=False, play=False)

    def draw(figure: Figure, within: int, px: float, py: float) -> Numbers:
        return draw_tube_and_arm(figure, table, state=(*POSTURE, px, py), within=within)

    controls = {
        "within": played(slider("within, steps to go n", 0, steps, 1, steps // 2)),
        **agent_sliders(problem),
    }
    return Explorer(draw, controls, size=TALL, alt="The tube as it grows, step by step", process="within")


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


def explore_arm_game(nodes: int = 25, method: str = "hji") -> Explorer:
    """The arm's game in four dimensions, solved at each change of the adversary, clock, inputs or an obstacle."""

    @lru_cache(maxsize=2)  # a table of 25 nodes takes 180 MB, which the system is slow to hand out
    def solved(v_p: float, v_d: float, delta: float, levels: int, x: float, y: float) -> Table:
        obstacles = (Disk(Still((x, y)), 0.06), *OBSTACLES[1:])
        problem = sdhj.arm_case_study(
            nodes, delta=delta, v_p_max=v_p, v_d_max=v_d, input_levels=levels, obstacles=obstacles
        )
        return sdhj.solve(problem, method=method, progress=False, play=False)

    def draw(figure: Figure, v_p: float, v_d: float, delta: float, levels: int, x: float, y: float) -> Numbers:
        return draw_tube_and_arm(figure, solved(v_p, v_d, delta, levels, x, y), state=(*POSTURE, 0.24, 0.24))

    controls = {
        "v_p": slider("pursuer's speed (m/s)", 0.0, 0.8, 0.05, 0.2, live=False),
        "v_d": slider("disturbance (rad/s)", 0.0, 3.0, 0.15, 0.3, live=False),
        "delta": slider("sampling interval (s)", 0.05, 0.2, 0.01, 0.1, live=False),
        "levels": slider("input levels on each axis", 2, 7, 1, 5, live=False),
        "x": slider("static obstacle x (m)", -0.3, 0.3, 0.02, -0.22, live=False),
        "y": slider("static obstacle y (m)", -0.3, 0.3, 0.02, 0.1, live=False),
    }
    return Explorer(
        draw,
        controls,
        size=TALL,
        slow="solving the arm's game anew, 36 tubes for all inputs",
        alt="A slice of the tube, solved anew",
        motion="v_d",
    )


# ---- checks


@exercise("8.1", "A linear function on a box is greatest at a corner: an absolute value for each axis.")
def check_hamiltonian(hamiltonian):
    """u . p_r + v_d |p_r|_1 + v_p |p_p|_1."""
    p = np.random.default_rng(0).normal(size=(50, 4))
    u = np.array([1.5, -3.0])
    got = np.asarray(hamiltonian(p, u, 0.0, 0.0))
    expect(got.shape == (50,), "one value for each row of p.")
    expect_close(got, p[:, :2] @ u, "without an adversary only u . p_r is left, p_r the first two components.")
    got = np.asarray(hamiltonian(p, u, 0.3, 0.0)) - p[:, :2] @ u
    expect_close(got, 0.3 * np.abs(p[:, :2]).sum(axis=1), "the disturbance: the adversary maximises on each axis.")
    got = np.asarray(hamiltonian(p, u, 0.0, 0.2)) - p[:, :2] @ u
    expect_close(got, 0.2 * np.abs(p[:, 2:]).sum(axis=1), "the pursuer moves the last two axes, each on its own.")


@exercise("8.2", "The ball of 0.8 r has 0.8^d of the volume.")
def check_shell(dimensions):
    """1 - 0.8^d > 0.9."""
    expect(1 - 0.8**dimensions > 0.9, "(8.7) with h / r = 0.2 is not above 0.9 there.")
    expect(1 - 0.8 ** (dimensions - 1) <= 0.9, "one dimension fewer would do.")


@exercise("8.3")
def check_window(window_maximum):
    """Maximum over `width` nodes of a periodic row, by doubling."""
    row = np.random.default_rng(1).normal(size=997)
    for width in (1, 2, 5, 8, 100):
        with patch.object(np, "maximum", wraps=np.maximum) as counted:
            got = np.asarray(window_maximum(row.copy(), width))
        wanted = np.max([np.roll(row, -shift) for shift in range(width)], axis=0)
        expect_close(got, wanted, f"width {width}: the window of i begins at i, ends at i + width - 1, and wraps.")
        if width > 1:
            expect(
                counted.call_count > 0, "np.maximum was never called: a window of copies costs width times the room."
            )
            most = 2 * int(np.ceil(np.log2(width)))
            expect(counted.call_count <= most, f"{counted.call_count} calls for width {width}, {most} are enough.")


@cache
def _free_share():
    problem = sdhj.arm_case_study(nodes=25)
    table = sdhj.solve(problem, progress=False)
    states = np.random.default_rng(5).uniform(problem.grid.lower, problem.grid.upper, (60_000, 4))
    free = problem.unsafe_value(states, 0.0) > 0
    return free.sum(), table.contains(states[free], start=0, within=8).mean(), free.mean()


@exercise(
    "8.4",
    "Draw states from the grid's box, keep those with `unsafe_value` above zero, and take the mean of `contains` "
    "over them.",
)
def check_free(share):
    """Of the states that are free at t = 0, the share in the tube; four standard errors of both estimates."""
    count, wanted, free = _free_share()
    expect(0 <= share <= 1, "a share, between 0 and 1.")
    off = 2 * Z95 * np.sqrt(wanted * (1 - wanted) * (1 / count + 1 / 5000))
    expect(abs(share - wanted * free) > off, "that is the share of all configurations: divide by the free ones.")
    expect(abs(share - wanted) <= off, "with 5,000 states or more it should be nearer to ours; is within=8, start=0?")
    return f"A share of {free:.2f} of C is free at t = 0."


@exercise(
    "8.5",
    "A peak may lie inside the disk, so the circle is not enough. How far from the next point may a place be, if "
    "values change by at most 1 m in a metre?",
)
def check_round(round_maximum):
    """Against a polar lattice of 200 x 16 points; sharp functions of either sign."""
    grid = Grid((-1.0, -1.0), (1.0, 1.0), (21, 21), ends="wall")
    points, r = grid.points(), 0.23
    angles = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    lattice = np.concatenate([share * r * circle for share in np.linspace(0, 1, 16)])
    for name, values in (
        ("a target, a convex function", np.hypot(*(points - (0.2, 0.1)).T) - 0.3),
        ("an obstacle's complement, with a peak inside the disk", 0.3 - np.hypot(*(points - (0.2, 0.1)).T)),
    ):
        values = values.reshape(grid.shape)
        ends = grid.clipped((points[:, None] + lattice).reshape(-1, 2))
        wanted = grid.interpolate(values, ends).reshape(len(points), -1).max(axis=1).reshape(grid.shape)
        got = np.asarray(round_maximum(grid, values, r))
        expect(got.shape == grid.shape, "one value for each node, in the grid's shape.")
        expect(got >= wanted - 0.01 * 0.3, f"{name}: too small somewhere by more than 1% of 0.3 m. Enough points? r?")
        expect(got <= wanted + 0.01, f"{name}: too large somewhere: are all points within r, and clipped at walls?")
    return "The disk lies in the box, so the adversary has less, and the robot's set is larger."
