"""Two-dimensional slices of state space: sets, tubes, and paths cut at periodic ends (Figs. 9b, 10, 11, 13)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from sdhj.common.checks import whole
from sdhj.common.remembering import FloatArray
from sdhj.plotting.looks import OUTCOME_INK, Looks, State, look, step_colours
from sdhj.problem.grid import Grid
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sets import TargetSet, UnsafeSet
from sdhj.table.batches import Table

RESOLUTION = 121  # points along each side of a slice: finer than any grid of the case study, 10 ms to evaluate
AXIS_LABELS = {
    "q1": "joint angle $q_1$ (rad)",
    "q2": "joint angle $q_2$ (rad)",
    "px": "pursuer $p_x$ (m)",
    "py": "pursuer $p_y$ (m)",
}
RIGHT_ANGLES = (-np.pi, -np.pi / 2, 0.0, np.pi / 2, np.pi)
QUARTER_LABELS = (r"$-\pi$", r"$-\pi/2$", "0", r"$\pi/2$", r"$\pi$")


@dataclass(frozen=True)
class Plane:
    """A slice of state space along two axes; made by `plane`.

    A periodic axis includes its upper end, where the states are the same as at its lower end.

    Attributes
    ----------
    axes : (int, int)
        The axes that vary.
    x, y : (X,), (Y,) arrays
        The coordinates along them.
    points : (Y * X, ndim) array
        The states on the slice, x varying fastest.
    """

    axes: tuple[int, int]
    x: FloatArray
    y: FloatArray
    points: FloatArray

    def shaped(self, values: FloatArray) -> FloatArray:
        """Values (Y * X,) at `points` as (Y, X), float64."""
        return np.asarray(values, dtype=np.float64).reshape(len(self.y), len(self.x))

    def of(self, grid: Grid, values: FloatArray) -> FloatArray:
        """Values at the nodes of a grid, interpolated at the points of the slice: (Y, X)."""
        return self.shaped(grid.interpolate(values, self.points))

    def true(self, part: TargetSet | UnsafeSet, t: float) -> FloatArray:
        """The level-set function of a set at time t, s, at the points of the slice: (Y, X)."""
        return self.shaped(part.level_set(self.points[:, part.axes], t))


def plane(grid: Grid, through: State, axes: Sequence[int] = (0, 1), resolution: int = RESOLUTION) -> Plane:
    """The slice along two axes through a state.

    Parameters
    ----------
    grid : Grid
    through : (ndim,) array
        A state, of which the entries on `axes` are ignored.
    axes : (int, int)
        The axes that are shown, ascending.
    resolution : int
        Points a side.

    Raises
    ------
    ValueError
        If `through` is no state or lies outside a bounded axis, or `axes` are not two different axes.

    Examples
    --------
    >>> import sdhj
    >>> from sdhj import plotting
    >>> plotting.plane(sdhj.Grid([0, 0], [1, 2], [5, 5]), [0, 0], resolution=11).points.shape
    (121, 2)
    """
    state = np.asarray(through, dtype=np.float64)
    if state.shape != (grid.ndim,):
        raise ValueError(f"through must be one state of {grid.ndim} numbers, got shape {state.shape}")
    first, second = (whole("each of the two axes of the slice", axis, least=0, most=grid.ndim - 1) for axis in axes)
    if first == second:
        raise ValueError(f"axes must be two different axes of the grid, got {tuple(axes)}")
    for axis in set(range(grid.ndim)) - {first, second}:
        low, high = grid.lower[axis], grid.upper[axis]
        if not np.isfinite(state[axis]) or not (grid.periodic[axis] or low <= state[axis] <= high):
            raise ValueError(f"through must have {grid.names[axis]} in [{low:g}, {high:g}], got {state[axis]:g}")
    # with the upper end also of a periodic axis, so that what is drawn closes there
    x, y = (np.linspace(grid.lower[axis], grid.upper[axis], resolution) for axis in (first, second))
    points = np.tile(state, (len(x) * len(y), 1))
    points[:, first] = np.tile(x, len(y))
    points[:, second] = np.repeat(y, len(x))
    return Plane((first, second), x, y, points)


def draw_set(ax: Axes, where: Plane, values: FloatArray, looks: Looks, gid: str, zorder: float = 2.0) -> None:
    """Fill and outline the set {values <= 0} on a slice.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    where : Plane
        Of `plane`.
    values : (Y, X) array
        As `where.shaped` or `where.of` returns them.
    looks : dict
        "facecolor", "edgecolor", "linewidth" and what else Matplotlib's contours take.
    gid : str
        Of the filled artist; the outline has `gid` + "-edge".
    zorder : float

    Examples
    --------
    >>> import numpy as np
    >>> import sdhj
    >>> from sdhj import plotting
    >>> ax = plotting.new_figure(3, 3).subplots()
    >>> where = plotting.plane(sdhj.Grid([-1, -1], [1, 1], [5, 5]), [0, 0], resolution=31)
    >>> disk = where.shaped(np.hypot(*where.points.T) - 0.5)
    >>> plotting.draw_set(ax, where, disk, {"facecolor": "0.8", "edgecolor": "0.2", "linewidth": 0.8}, "disk")
    """
    low, high = float(values.min()), float(values.max())
    if low > 0.0:
        return
    face, hatch = looks.get("facecolor", "none"), looks.get("hatch") or None
    if face != "none" or hatch:
        # ascending, from below all values: what is filled is where they are <= 0
        levels = [min(low, -1e-9) - 1.0, 0.0]
        filled = ax.contourf(where.x, where.y, values, levels, colors=[face], hatches=[hatch], zorder=zorder)
        filled.set(edgecolor=looks["edgecolor"], linewidth=0.0, gid=gid)
    if low < 0.0 < high:
        line: dict[str, Any] = {"linewidths": looks["linewidth"], "linestyles": [looks.get("linestyle", "-")]}
        line |= {"colors": [looks["edgecolor"]], "zorder": zorder + 0.5}
        ax.contour(where.x, where.y, values, [0.0], **line).set_gid(f"{gid}-edge")


def frame_slice(ax: Axes, grid: Grid, axes: Sequence[int] = (0, 1)) -> None:
    """Set the limits, ticks and labels (with units) of a slice; where both axes are periodic, equal scales.

    Examples
    --------
    >>> import sdhj
    >>> from sdhj import plotting
    >>> ax = plotting.new_figure(3, 3).subplots()
    >>> plotting.frame_slice(ax, sdhj.Grid([0, 0], [1, 2], [5, 5], names=["x (m)", "y (m)"]))
    >>> ax.get_xlabel()
    'x (m)'
    """
    for axis, name in zip(axes, "xy", strict=True):
        ends, label = (grid.lower[axis], grid.upper[axis]), grid.names[axis]
        ax.set(**{f"{name}lim": ends, f"{name}label": AXIS_LABELS.get(label, label)})
        if grid.periodic[axis] and np.allclose(ends, (-np.pi, np.pi)):
            getattr(ax, f"set_{name}ticks")(RIGHT_ANGLES, QUARTER_LABELS)
    ax.spines[:].set_visible(True)  # the full frame: a path that leaves a periodic axis enters at its other end
    if all(grid.periodic[axis] for axis in axes):
        ax.set_aspect("equal")


def draw_constraints(
    ax: Axes,
    problem: ReachAvoidProblem,
    *,
    through: State,
    step: float = 0,
    axes: Sequence[int] = (0, 1),
    parts: Sequence[str] | None = None,
    resolution: int = 2 * RESOLUTION - 1,
) -> None:
    """Draw the true target and unsafe sets at time step * delta on a slice, without interpolation (Fig. 9b).

    Unsafe sets are red and hatched, the target is blue, captures by the pursuer have a bold dotted contour.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    problem : ReachAvoidProblem
    through, axes, resolution
        The slice, as for `plane`.
    step : float
        k.
    parts : sequence of str, optional
        Names of the unsafe sets that are drawn.

    Examples
    --------
    With the paper's arm on a few nodes:

    >>> import sdhj
    >>> from sdhj import plotting
    >>> ax = plotting.new_figure(3, 3).subplots()
    >>> plotting.draw_constraints(ax, sdhj.arm_case_study(nodes=9), through=[0, 0, 0.2, 0.2], resolution=31)
    """
    where = plane(problem.grid, through, axes, resolution)
    for i, part in enumerate(problem.all_sets):
        if parts is None or part.name in parts:
            # the step may be a fraction, as an animation draws between sampling times
            draw_set(ax, where, where.true(part, step * problem.delta), look(part.name), part.name, 2.0 + i)
    frame_slice(ax, problem.grid, axes)


def draw_tubes(
    ax: Axes,
    table: Table,
    *,
    through: State,
    start: int = 0,
    within: int | None = None,
    axes: Sequence[int] = (0, 1),
    unsafe: bool = True,
    resolution: int = RESOLUTION,
) -> None:
    """Draw the nested tubes with 0 to `within` steps to go from step `start`, on a slice (Figs. 10 and 11).

    The tube with n steps to go has the identifier "tube-n".

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    table : Table
    through, axes, resolution
        The slice, as for `plane`.
    start, within : int
        The largest tube, as for `Table.contains`.
    unsafe : bool
        Whether the true unsafe sets are outlined.

    Examples
    --------
    With the paper's arm on a few nodes:

    >>> import sdhj
    >>> from sdhj import plotting
    >>> ax = plotting.new_figure(3, 3).subplots()
    >>> arm = sdhj.solve(sdhj.arm_case_study(nodes=9, steps=1), play=False)
    >>> plotting.draw_tubes(ax, arm, through=[0, 0, 0.24, 0.24], resolution=31)
    >>> sorted({one.get_gid() for one in ax.collections if (one.get_gid() or "").startswith("tube")})[:1]
    ['tube-0']
    """
    grid, most = table.grid, table.steps - whole("start", start, least=0, most=table.steps)
    within = most if within is None else min(within, most)
    where = plane(grid, through, axes, resolution)
    # By all steps of the table, so that n has one colour in all pictures.
    colours = step_colours(table.steps)
    # the largest first, each smaller one above it
    for n in range(within, -1, -1):
        values = where.of(grid, table.values(start=start, within=n))
        looks = {"facecolor": colours[n], "edgecolor": "#333333", "linewidth": 0.45}
        draw_set(ax, where, values, looks, f"tube-{n}", zorder=1.0 + (within - n) / (table.steps + 1))
    if unsafe:
        # Outlines above all tubes, whose orders end at 2.
        for unsafe_set in table.problem.unsafe:
            outline = look(unsafe_set.name) | {"facecolor": "none"}
            draw_set(ax, where, where.true(unsafe_set, start * table.problem.delta), outline, unsafe_set.name, 2.5)
    frame_slice(ax, grid, axes)


def unwrapped(grid: Grid, states: FloatArray, axes: Sequence[int] = (0, 1)) -> FloatArray:
    """The path of states (T, ndim) on a slice, without jumps, once for each lap around periodic axes: (R, 2).

    What all copies have in the frame is the path, cut at the ends of periodic axes.
    """
    low, high, periodic = (np.array(given)[list(axes)] for given in (grid.lower, grid.upper, grid.periodic))
    path, span = np.asarray(states, dtype=np.float64)[:, list(axes)], high - low
    for axis in np.flatnonzero(periodic):
        path[:, axis] = np.unwrap(path[:, axis], period=span[axis])
    # a row of NaN stands between two copies, so that a drawn line breaks there
    laps = np.unique(np.where(periodic, np.floor((path - low) / span), 0.0), axis=0)
    rows = [row for lap in laps for row in (path - lap * span, np.full((1, 2), np.nan))]
    return np.concatenate(rows[:-1])


def draw_path(
    ax: Axes, grid: Grid, states: FloatArray, axes: Sequence[int] = (0, 1), marks: FloatArray | None = None, **line: Any
) -> None:
    """Draw the path of states (T, ndim) on a slice, cut at the ends of periodic axes.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    grid : Grid
    states : (T, ndim) array
        As `Trajectory.states`.
    axes : (int, int)
        As for `plane`.
    marks : (K, ndim) array, optional
        That get a dot, as `Trajectory.samples`.
    line
        Of `matplotlib.lines.Line2D`.

    Examples
    --------
    >>> import numpy as np
    >>> import sdhj
    >>> from sdhj import plotting
    >>> ax = plotting.new_figure(3, 3).subplots()
    >>> grid = sdhj.Grid([0, 0], [1, 1], [5, 5])
    >>> plotting.draw_path(ax, grid, np.array([[0.1, 0.1], [0.5, 0.4]]))
    """
    looks: dict[str, Any] = {"color": OUTCOME_INK, "linestyle": "-", "zorder": 6.0, "gid": "path"} | line
    # The frame stays that of the grid, wherever a path goes.
    ax.plot(*unwrapped(grid, states, axes).T, scalex=False, scaley=False, **looks)
    if marks is not None and len(marks):
        dots: dict[str, Any] = {"markeredgecolor": OUTCOME_INK, "markersize": 3.6, "zorder": 6.5, "gid": "marks"}
        ax.plot(*grid.wrapped(marks)[:, list(axes)].T, "o", color="white", **dots)
