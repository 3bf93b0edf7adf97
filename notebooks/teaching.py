"""Pictures for the teaching notebooks that no figure of the paper needs.

As everywhere in `sdhj.plotting`, a function only draws what it is given. Those that take a figure fill it; those that a
slider calls return the numbers that belong under the picture.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from lessons import Profile, Shrunk, union_of_samples
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from sdhj.plotting.workspace import draw_arm, draw_workspace

from sdhj.arm.case_studies import scene
from sdhj.grid import FloatArray, Grid
from sdhj.plotting.looks import FULL, INK, INNER, OUTCOME_INK, TARGET, UNSAFE, look, step_colours
from sdhj.plotting.slices import (
    draw_constraints,
    draw_path,
    draw_set,
    draw_tubes,
    frame_slice,
    plane,
)
from sdhj.plotting.surfaces import draw_isosurface
from sdhj.problem import ReachAvoidProblem, TargetSet, UnsafeSet
from sdhj.table import LookupTable

Numbers = dict[str, float]
Extent = tuple[float, float, float, float]
LIVE = 141  # points along each side of a slice that follows a slider
EXACT: dict[str, Any] = {"color": "#c44e00", "linestyle": (0, (4, 1.5)), "linewidth": 1.6}
HERE: dict[str, Any] = {
    "marker": "o",
    "markersize": 6,
    "color": OUTCOME_INK,
    "markeredgecolor": "white",
    "zorder": 8,
    "gid": "here",
}


# ----------------------------------------------------------------------------------------------------------------------
# Slices that follow a slider: pictures made of pixels, because filled contours cost ten times as much
# ----------------------------------------------------------------------------------------------------------------------


def slice_values(
    grid: Grid, values: FloatArray, through: Sequence[float], axes: Sequence[int], x: FloatArray, y: FloatArray
) -> FloatArray:
    """Multilinear interpolation on the slice of two ascending axes through a state, (len(y), len(x)); as `Plane.of`.

    The axes that are left out are interpolated first, on the nodes, so that only the slice itself is made fine.
    """
    slab = np.asarray(values, dtype=np.float64)
    for axis in reversed(range(grid.ndim)):
        if axis not in axes:
            slab = np.tensordot(_weights(grid, axis, np.array([through[axis]]))[0], slab, axes=(0, axis))
    return _weights(grid, axes[1], y) @ slab.T @ _weights(grid, axes[0], x).T


def _weights(grid: Grid, axis: int, coordinates: FloatArray) -> FloatArray:
    """The share of each node in the linear interpolation at each coordinate, (len(coordinates), nodes)."""
    nodes = grid.shape[axis]
    position = (coordinates - grid.lower[axis]) / grid.spacing[axis]
    left = np.floor(position).astype(int)
    if not grid.periodic[axis]:
        left = np.clip(left, 0, nodes - 2)
    share = position - left
    weights = np.zeros((len(coordinates), nodes))
    rows = np.arange(len(coordinates))
    np.add.at(weights, (rows, left % nodes), 1.0 - share)
    np.add.at(weights, (rows, (left + 1) % nodes), share)
    return weights


def fewest_steps(table: LookupTable, state: Sequence[float], start: int, within: int) -> float:
    """The fewest steps to go of a state, NaN where no tube up to `within` holds it."""
    at = (np.array([state[0]]), np.array([state[1]]))
    for n in range(within + 1):
        if slice_values(table.grid, table.values(start=start, within=n), state, (0, 1), *at)[0, 0] <= 0.0:
            return n
    return float("nan")


def frame_live(ax: Axes, grid: Grid, axes: Sequence[int] = (0, 1)) -> None:
    """As `frame_slice`, with labels in plain text: every new figure parses formulas again, 5 ms for each."""
    frame_slice(ax, grid, axes)
    plain = str.maketrans({"$": "", "\\": "", "_": ""})
    for axis, name in zip(axes, "xy", strict=True):
        side = getattr(ax, f"{name}axis")
        side.set_label_text(side.label.get_text().translate(plain))
        if grid.periodic[axis]:
            side.set_ticklabels(
                [label.get_text().translate(plain).replace("pi", "π") for label in side.get_ticklabels()]
            )


def draw_arm_live(ax: Axes, problem: ReachAvoidProblem, state: Sequence[float], time: float) -> None:
    """The workspace without arrows and formulas, and with few ticks: drawing axes is most of the work."""
    draw_workspace(ax, scene(problem), state=state, time=time, arrows=False)
    ticks = (-0.3, 0.0, 0.3)
    ax.set(xlabel="x (m)", ylabel="y (m)", xticks=ticks, yticks=ticks)


def steps_image(
    table: LookupTable,
    *,
    through: Sequence[float],
    start: int,
    within: int,
    axes: Sequence[int] = (0, 1),
    resolution: int = LIVE,
) -> FloatArray:
    """The fewest steps to go on a slice, (resolution, resolution) int; within + 1 where no tube holds the state."""
    grid = table.grid
    x, y = (np.linspace(grid.lower[axis], grid.upper[axis], resolution) for axis in axes)
    fewest = np.full((resolution, resolution), within + 1)
    for n in range(within, -1, -1):
        fewest[slice_values(grid, table.values(start=start, within=n), through, axes, x, y) <= 0.0] = n
    return fewest


def draw_steps(ax: Axes, table: LookupTable, fewest: FloatArray, *, within: int, axes: Sequence[int] = (0, 1)) -> None:
    """An image of `steps_image` in the colours of the tubes."""
    colours = np.array([*step_colours(table.steps)[: within + 1], (1.0, 1.0, 1.0, 0.0)])
    grid, (first, second) = table.grid, axes
    extent = (grid.lower[first], grid.upper[first], grid.lower[second], grid.upper[second])
    draw_pixels(ax, colours[fewest], extent, "tubes")
    frame_live(ax, grid, axes)


def draw_pixels(ax: Axes, image: FloatArray, extent: Extent, gid: str, zorder: float = 1.0) -> None:
    """Colours (Y, X, 4) as they are, without smoothing."""
    ax.imshow(image, extent=extent, origin="lower", interpolation="nearest", aspect="auto", zorder=zorder, gid=gid)


def draw_sets_quickly(
    ax: Axes,
    problem: ReachAvoidProblem,
    *,
    through: Sequence[float],
    step: float = 0.0,
    filled: bool = True,
    resolution: int = LIVE,
) -> None:
    """As `draw_constraints` on the first two axes, without hatching and with pixels for areas."""
    where = plane(problem.grid, through, resolution=resolution)
    t = step * problem.delta
    extent = (where.x[0], where.x[-1], where.y[0], where.y[-1])
    parts: list[UnsafeSet | TargetSet] = [problem.target, *problem.unsafe]
    for place, part in enumerate(parts):
        values = where.shaped(part.level_set(where.points[:, part.axes], t))
        looks = look(part.name)
        if filled and looks["facecolor"] != "none":
            image = np.zeros((*values.shape, 4))
            image[values <= 0] = to_rgba(looks["facecolor"])
            draw_pixels(ax, image, extent, part.name, zorder=2.0 + place)
        if (filled or part is not problem.target) and values.min() < 0 < values.max():
            edge = {"colors": [looks["edgecolor"]], "linewidths": looks["linewidth"]}
            lines = ax.contour(where.x, where.y, values, levels=[0.0], zorder=5.0, **edge)
            lines.set_linestyle([looks.get("linestyle", "-")])
            lines.set_gid(f"{part.name}-edge")
    frame_live(ax, problem.grid)


def draw_short_bar(ax: Axes, steps: int) -> None:
    """The colours of 0 to `steps` steps to go, from the bottom up."""
    ax.imshow(
        np.array(step_colours(steps))[:, None],
        extent=(0, 1, -0.5, steps + 0.5),
        origin="lower",
        aspect="auto",
        interpolation="nearest",
    )
    ax.set(xticks=[], yticks=[0, steps], title="n")
    ax.yaxis.tick_right()


# ----------------------------------------------------------------------------------------------------------------------
# Sets as functions
# ----------------------------------------------------------------------------------------------------------------------


def draw_functions(figure: Figure, grid: Grid, functions: Mapping[str, FloatArray]) -> None:
    """Level-set functions side by side: thin lines are levels, the bold one is level zero, the set is blue."""
    axes = np.atleast_1d(figure.subplots(1, len(functions), sharey=True))
    levels = [tenth / 10 for tenth in range(-8, 17) if tenth]
    for ax, (title, values) in zip(axes, functions.items(), strict=True):
        where = plane(grid, (0.0, 0.0), resolution=201)
        fine = where.of(grid, values)
        draw_set(ax, where, fine, FULL | {"linewidth": 2.0}, title, zorder=1.0)
        lines = ax.contour(
            where.x, where.y, fine, levels=levels, colors="#8c8c8c", linewidths=0.5, linestyles="-", zorder=2.0
        )
        ax.clabel(lines, lines.levels[::2], fontsize=6, fmt="%.1f")
        frame_slice(ax, grid)
        ax.set_aspect("equal")
        ax.set_title(title)
    for ax in axes[1:]:
        ax.set_ylabel("")


def draw_nodes(figure: Figure, coarse: Grid, values: FloatArray, fine: Grid, exact: FloatArray) -> None:
    """A set held by a coarse grid over the true one: the nodes inside are full, those outside hollow."""
    ax = figure.subplots()
    where = plane(coarse, (0.0, 0.0), resolution=401)
    draw_set(
        ax,
        where,
        where.of(fine, exact),
        {"facecolor": "#f3d9c9", "edgecolor": "#c44e00", "linewidth": 1.2},
        "exact",
        1.0,
    )
    draw_set(
        ax,
        where,
        where.of(coarse, values),
        {"facecolor": "none", "edgecolor": "#0b3c5d", "linewidth": 1.8},
        "held",
        2.0,
    )
    points, inside = coarse.points(), values.ravel() <= 0
    ax.plot(
        *points[~inside].T,
        "o",
        color="none",
        markeredgecolor="#8c8c8c",
        markeredgewidth=0.6,
        markersize=3,
        gid="outside",
    )
    ax.plot(*points[inside].T, "o", color="#0b3c5d", markersize=3.5, gid="inside")
    frame_slice(ax, coarse)
    ax.set_aspect("equal")
    handles = [
        Line2D([], [], color="#c44e00", linewidth=1.2, linestyle="-", label="the set"),
        Line2D([], [], color="#0b3c5d", linewidth=1.8, linestyle="-", label="what the nodes hold"),
        Line2D([], [], color="#0b3c5d", marker="o", linestyle="", label="node inside"),
        Line2D([], [], color="none", marker="o", markeredgecolor="#8c8c8c", linestyle="", label="node outside"),
    ]
    ax.legend(handles=handles, loc="center left", bbox_to_anchor=(1.02, 0.5))


# ----------------------------------------------------------------------------------------------------------------------
# Upwinding
# ----------------------------------------------------------------------------------------------------------------------


def draw_profile(ax: Axes, profile: Profile) -> None:
    """A level-set function on a line that was carried along, and the sets {Phi <= 0} as bars below."""
    ax.axhline(0.0, color="#8c8c8c", linewidth=0.6)
    kinds = (
        ("start", profile.start, "#8c8c8c", 1.0),
        ("exact", profile.exact, "#c44e00", 1.6),
        ("computed", profile.computed, "#0b3c5d", 1.6),
    )
    for row, (name, values, colour, width) in enumerate(kinds):
        marker = "." if name == "computed" else ""
        ax.plot(
            profile.x,
            values,
            color=colour,
            linewidth=width,
            linestyle="-",
            marker=marker,
            markersize=3,
            label=name,
            gid=name,
        )
        inside = np.where(values <= 0, -0.3 - 0.035 * row, np.nan)
        ax.plot(profile.x, inside, color=colour, linewidth=3, linestyle="-", solid_capstyle="butt", gid=f"{name}-set")
    ax.set(xlim=(-1, 1), ylim=(-0.42, 0.42), xlabel="$x$ (m)", ylabel=r"$\Phi(x)$ (m)")
    ax.legend(loc="upper right", ncols=3)


def draw_profiles(figure: Figure, profiles: Mapping[str, Profile]) -> None:
    """Several profiles side by side."""
    axes = np.atleast_1d(figure.subplots(1, len(profiles), sharey=True))
    for ax, (title, profile) in zip(axes, profiles.items(), strict=True):
        draw_profile(ax, profile)
        ax.set_title(title)
        ax.get_legend().remove()
    for ax in axes[1:]:
        ax.set_ylabel("")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)


def draw_shrunk(ax: Axes, shrunk: Shrunk) -> None:
    """A disk carried back through one interval, computed (blue) and exact (dashed); crosses: nodes wrongly inside."""
    grid = shrunk.grid
    where = plane(grid, (0.0, 0.0), resolution=301)
    draw_set(
        ax,
        where,
        where.of(grid, shrunk.start),
        {"facecolor": "none", "edgecolor": "#8c8c8c", "linewidth": 1.0},
        "target",
        1.0,
    )
    draw_set(ax, where, where.of(grid, shrunk.computed), FULL | {"linewidth": 1.8}, "computed", 1.2)
    ax.contour(
        where.x,
        where.y,
        where.of(grid, shrunk.exact),
        levels=[0.0],
        colors=EXACT["color"],
        linewidths=1.6,
        linestyles="--",
        zorder=3,
    )
    wrong = grid.points()[((shrunk.computed <= 0) & (shrunk.exact > 0)).ravel()]
    ax.plot(*wrong.T, "x", color=OUTCOME_INK, markersize=5, zorder=4, gid="wrong")
    frame_slice(ax, grid)
    ax.set_aspect("equal")


def shrunk_legend() -> list[Line2D]:
    """Legend entries of `draw_shrunk`."""
    return [
        Line2D([], [], color="#8c8c8c", linewidth=1.0, linestyle="-", label="to be reached"),
        Line2D([], [], color="#0b3c5d", linewidth=1.8, linestyle="-", label="computed"),
        Line2D([], [], label="exact", **EXACT),
    ]


def draw_orders(figure: Figure, cases: Mapping[str, Shrunk]) -> None:
    """The same answer from several schemes, side by side."""
    axes = np.atleast_1d(figure.subplots(1, len(cases), sharey=True))
    for ax, (title, case) in zip(axes, cases.items(), strict=True):
        draw_shrunk(ax, case)
        ax.set_title(title)
    figure.legend(handles=shrunk_legend(), loc="outside lower center", ncols=3)


def draw_convergence(ax: Axes, spacing: Sequence[float], errors: Mapping[str, Sequence[float]]) -> None:
    """Errors against spacing on logarithmic axes, one line for each scheme; the slope of a line is its order."""
    markers = ("o", "s", "^", "D")
    for marker, (name, values) in zip(markers, errors.items(), strict=False):
        ax.loglog(spacing, values, marker=marker, label=name, gid=name)
    ax.set(xlabel="spacing (m)", ylabel="mean error near the boundary (m)")
    ax.set_xticks(list(spacing), [f"{h:.3f}" for h in spacing])
    ax.minorticks_off()
    ax.grid(True, which="major")
    ax.legend()


# ----------------------------------------------------------------------------------------------------------------------
# Games in the plane
# ----------------------------------------------------------------------------------------------------------------------


def draw_plane_game(
    ax: Axes, table: LookupTable, *, start: int = 0, within: int | None = None, through: Sequence[float] | None = None
) -> None:
    """Tubes of a robot with two axes of position, its target and its obstacle where they are at step `start`."""
    state = np.zeros(table.grid.ndim) if through is None else np.asarray(through, dtype=np.float64)
    draw_tubes(ax, table, through=state, start=start, within=within, unsafe=False)
    draw_constraints(
        ax,
        table.problem,
        through=state,
        step=start,
        parts=[part.name for part in table.problem.unsafe if part.name != "edge"],
    )
    where = plane(table.grid, state, resolution=201)
    target = table.problem.target
    goal = where.shaped(target.level_set(where.points[:, target.axes], start * table.problem.delta))
    draw_set(ax, where, goal, TARGET | {"facecolor": "none"}, "target", zorder=5.0)
    ax.set_aspect("equal")


def draw_plane_games(figure: Figure, tables: Mapping[str, LookupTable]) -> None:
    """Tubes of several games in the plane, side by side, from step 0."""
    axes = np.atleast_1d(figure.subplots(1, len(tables), sharey=True))
    for ax, (title, table) in zip(axes, tables.items(), strict=True):
        draw_plane_game(ax, table)
        ax.set_title(title)
    for ax in axes[1:]:
        ax.set_ylabel("")


def draw_row(ax: Axes, table: LookupTable, *, start: int, point: Sequence[float]) -> Numbers:
    """A row of the look-up table: the tubes from step `start`, the leftmost one that holds `point` framed."""
    most, gap, grid = table.steps - start, 0.15, table.grid
    colours = np.array([(1.0, 1.0, 1.0, 0.0), (0.965, 0.741, 0.659, 1.0)])
    where = plane(grid, point, resolution=LIVE)
    unsafe = where.shaped(table.problem.unsafe_value(where.points, start * table.problem.delta)) <= 0
    side = grid.upper[0] - grid.lower[0]
    first = fewest_steps(table, point, start, most)
    for n in range(most + 1):
        left = n * (side + gap)
        image = colours[unsafe.astype(int)]
        image[slice_values(grid, table.values(start=start, within=n), point, (0, 1), where.x, where.y) <= 0] = (
            step_colours(table.steps)[n]
        )
        chosen = n == first
        ax.imshow(
            image,
            extent=(left, left + side, 0, side),
            origin="lower",
            interpolation="nearest",
            zorder=1.0,
            gid=f"tube-{n}",
        )
        looks: dict[str, Any] = (
            {"linewidth": 2.4, "edgecolor": OUTCOME_INK} if chosen else {"linewidth": 0.6, "edgecolor": "#9a9a9a"}
        )
        ax.add_patch(
            Rectangle(
                (left, 0), side, side, facecolor="none", zorder=3.0, gid="frame" if chosen else f"cell-{n}", **looks
            )
        )
        ax.plot(left + point[0] - grid.lower[0], point[1] - grid.lower[1], **HERE)
        ax.text(left + side / 2, side * 1.04, f"$n = {n}$", ha="center")
    ax.set(xlim=(-0.05, (table.steps + 1) * (side + gap)), ylim=(-0.05, side * 1.2), aspect="equal")
    ax.axis("off")
    return {"fewest steps to go": first, "tubes that hold the point": 0 if np.isnan(first) else most + 1 - int(first)}


# ----------------------------------------------------------------------------------------------------------------------
# The arm
# ----------------------------------------------------------------------------------------------------------------------


def draw_both_spaces(
    figure: Figure, problem: ReachAvoidProblem, *, state: Sequence[float], step: float = 0.0
) -> Numbers:
    """The arm in the workspace and as a point of C-space, with the sets at time step * delta (Fig. 9)."""
    left, right = figure.subplots(1, 2)
    t = step * problem.delta
    draw_arm_live(left, problem, state, t)
    left.set_title(f"workspace, t = {t:.2f} s")
    draw_sets_quickly(right, problem, through=state, step=step)
    right.plot(*_wrapped(state), **HERE)
    right.set_title("configuration space (slice)")
    q = np.asarray([state], dtype=np.float64)
    return {
        "target (m, inside below 0)": float(problem.target_value(q, t)[0]),
        "unsafe sets (m, collision below 0)": float(problem.unsafe_value(q, t)[0]),
    }


def _wrapped(state: Sequence[float]) -> FloatArray:
    return np.mod(np.asarray(state, dtype=np.float64)[:2] + np.pi, 2 * np.pi) - np.pi


def draw_view_time(
    figure: Figure, problem: ReachAvoidProblem, *, step: int = 0, samples: int = 3, pieces: Sequence[float] = (0.0, 1.0)
) -> Numbers:
    """What the moving obstacles sweep over one interval, in C-space, and a union of samples that misses some of it."""
    left, right = figure.subplots(1, 2)
    part = next(part for part in problem.unsafe if part.moving)
    grid = problem.grid.subgrid(part.axes)
    t0, t1 = problem.time(step) + np.asarray(pieces) * problem.delta
    view = scene(problem)
    draw_workspace(left, view, time=t0, trail=np.linspace(t0, t1, max(samples, 2)), arrows=False)
    left.set_title(f"samples of the obstacles, $t$ in [{t0:.1f}, {t1:.1f}] s")
    where = plane(grid, (0.0, 0.0), resolution=241)
    swept = where.shaped(part.over(where.points, t0, t1, "swept"))
    union = where.shaped(union_of_samples(part, where.points, t0, t1, samples))
    draw_set(right, where, swept, UNSAFE, "swept", zorder=1.0)
    draw_set(right, where, union, {"facecolor": "#e2e2e2", "edgecolor": INK, "linewidth": 0.8}, "sampled", zorder=2.0)
    frame_slice(right, grid)
    right.set_title("swept (red, all of it) and sampled (grey)")
    missed = (swept <= 0) & (union > 0)
    return {
        "share of C-space swept": float(np.mean(swept <= 0)),
        "of it missed by the samples": float(missed.sum() / (swept <= 0).sum()),
    }


def draw_kinematics(figure: Figure, problems: Mapping[str, ReachAvoidProblem], *, state: Sequence[float]) -> None:
    """The same joint angles under two readings of Eq. (8), workspace above, C-space below."""
    axes = figure.subplots(2, len(problems))
    for (top, bottom), (title, problem) in zip(axes.T, problems.items(), strict=True):
        draw_workspace(top, scene(problem), state=state, arrows=False)
        top.set_title(title)
        draw_constraints(bottom, problem, through=state)
        bottom.plot(*_wrapped(state), **HERE)


def draw_tube_and_arm(
    figure: Figure, table: LookupTable, *, state: Sequence[float], start: int = 0, within: int | None = None
) -> Numbers:
    """A slice of the four-dimensional tube through a state, beside the arm in that state."""
    within = table.steps - start if within is None else min(within, table.steps - start)
    grid = figure.add_gridspec(1, 3, width_ratios=(1.0, 1.0, 0.05))
    left, right, bar = (figure.add_subplot(grid[0, column]) for column in range(3))
    problem = table.problem
    draw_arm_live(left, problem, state, start * problem.delta)
    left.set_title(f"workspace at step {start}")
    fewest = steps_image(table, through=state, start=start, within=within)
    draw_steps(right, table, fewest, within=within)
    draw_sets_quickly(right, problem, through=state, step=start, filled=False, resolution=81)
    right.plot(*_wrapped(state), **HERE)
    right.set_title(f"from step {start}, within {within} steps")
    draw_short_bar(bar, table.steps)
    return {
        "share of the slice inside": float((fewest[:-1, :-1] <= within).mean()),
        "share of C inside": table.fraction(start=start, within=within),
        "steps to go of this state": fewest_steps(table, state, start, within),
    }


def draw_pursuer_plane(
    ax: Axes, table: LookupTable, *, state: Sequence[float], start: int = 0, within: int | None = None
) -> Numbers:
    """The other slice: joint angles fixed, where may the pursuer be? Tubes in (px, py) with the arm drawn into them."""
    within = table.steps - start if within is None else min(within, table.steps - start)
    draw_workspace(ax, scene(table.problem), time=start * table.problem.delta, arrows=False)
    draw_arm(ax, scene(table.problem), state[:2])
    fewest = steps_image(table, through=state, start=start, within=within, axes=(2, 3))
    draw_steps(ax, table, fewest, within=within, axes=(2, 3))
    ax.set(aspect="equal", title="where the pursuer may be, for this posture")
    return {"share of the pursuer's places": float((fewest <= within).mean())}


def draw_gap(
    figure: Figure,
    full: LookupTable,
    inner: LookupTable,
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
        to_rgba(colour) for colour in (FULL["facecolor"], INNER["facecolor"], OUTCOME_INK)
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


def draw_certified(
    figure: Figure,
    table: LookupTable,
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
    image[said], image[proved] = to_rgba(FULL["facecolor"]), to_rgba(INNER["facecolor"])
    draw_pixels(right, image, (where.x[0], where.x[-1], where.y[0], where.y[-1]), "certified")
    draw_sets_quickly(right, problem, through=state, step=start, filled=False, resolution=81)
    right.set_title(f"dark: proved; light: interpolated only; within {within}")
    return {
        "slice inside by interpolation": float(said.mean()),
        "slice proved": float(proved.mean()),
        "proved and not inside by interpolation": float((proved & ~said).mean()),
    }


def draw_surface(figure: Figure, table: LookupTable, *, through: Sequence[float]) -> None:
    """The boundary of the whole tube from step 0 over the first three axes."""
    ax, grid = figure.add_subplot(projection="3d"), table.grid
    draw_isosurface(ax, table, through=through)
    for axis, name in enumerate("xyz"):
        if not grid.periodic[axis]:
            getattr(ax, f"set_{name}ticks")((grid.lower[axis], 0.0, grid.upper[axis]))
        elif grid.names[axis] == "heading":
            getattr(ax, f"set_{name}label")("heading (rad)", labelpad=-4)
    ax.set_box_aspect(None, zoom=0.92)


def draw_plane_run(ax: Axes, table: LookupTable, run: Any) -> None:
    """A run in the plane over the tubes it starts in."""
    draw_plane_game(ax, table, through=run.states[0])
    draw_path(ax, table.grid, run.states, marks=run.samples)


def draw_failures(ax: Axes, depth: FloatArray, failed: FloatArray, *, bins: int = 8) -> None:
    """Share of runs that fail against how deep in the tube they start (the level-set value, m), in equal groups."""
    order = np.array_split(np.argsort(depth), bins)
    middles = [float(np.median(depth[group])) for group in order]
    ax.plot(middles, [100 * float(failed[group].mean()) for group in order], marker="o", gid="failures")
    ax.set(xlabel="level-set value at the start (m); 0 is the boundary", ylabel="runs that fail (%)", ylim=(0, None))
    ax.grid(axis="y")


def draw_car(ax: Axes, table: LookupTable, *, heading: float, within: int | None = None) -> Numbers:
    """The car's tubes for one heading, with the heading as an arrow; north is up."""
    within = table.steps if within is None else within
    state = (0.0, 0.0, heading)
    draw_plane_game(ax, table, within=within, through=state)
    tip = 0.18 * np.array([np.cos(heading), np.sin(heading)])
    ax.annotate(
        "",
        (-0.75 + tip[0], 0.75 + tip[1]),
        (-0.75 - tip[0], 0.75 - tip[1]),
        arrowprops={"arrowstyle": "-|>", "color": INK, "linewidth": 2},
    )
    where = plane(table.grid, state, resolution=121)
    return {
        "share of places for this heading": float(
            (where.of(table.grid, table.values(start=0, within=within)) <= 0).mean()
        )
    }
