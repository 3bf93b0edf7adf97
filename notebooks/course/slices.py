"""Slices that follow a slider: sets as everywhere, tubes as pixels, as their contours take 60 ms more (47 ms: 107)."""

from collections.abc import Sequence
from functools import cache, lru_cache
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from sdhj.arm.case_studies import scene
from sdhj.common.remembering import FloatArray
from sdhj.plotting import draw_set, draw_workspace, frame_slice, plane, step_colours
from sdhj.plotting.looks import OUTCOME_INK, UNSAFE_LOOKS, look
from sdhj.problem.grid import Grid
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.table.batches import Table

Extent = tuple[float, float, float, float]
POSTURE = (1.3, 0.9)  # of the arm, where a picture starts, rad
LIVE = 141  # points along each side of an image that follows a slider
COARSE = 81  # of the contours above it
HERE: dict[str, Any] = {"marker": "o", "markersize": 6, "color": OUTCOME_INK, "markeredgecolor": "white"}
HERE |= {"zorder": 8, "gid": "here"}
colours_of = cache(step_colours)  # a colour map takes a while to make


def slice_values(
    grid: Grid, values: FloatArray, through: Sequence[float], axes: Sequence[int], x: FloatArray, y: FloatArray
) -> FloatArray:
    """Multilinear interpolation on the slice of two ascending axes through a state, (len(y), len(x)); as `Plane.of`.

    The axes that are left out are interpolated first, between two nodes, so that only the slice itself is made fine.
    """
    left = {a: _weights(grid, a, (float(through[a]),))[0] for a in range(grid.ndim) if a not in axes}
    nodes = [np.flatnonzero(left[a]) if a in left else np.arange(grid.shape[a]) for a in range(grid.ndim)]
    slab = np.asarray(values)[np.ix_(*nodes)]
    for a in sorted(left, reverse=True):
        slab = sum(left[a][node] * slab[(slice(None),) * a + (place,)] for place, node in enumerate(nodes[a]))
    return _weights(grid, axes[1], tuple(y)) @ slab.T @ _weights(grid, axes[0], tuple(x)).T


@lru_cache(maxsize=64)
def _weights(grid: Grid, axis: int, coordinates: tuple[float, ...]) -> FloatArray:
    """The share of each node in the linear interpolation at each coordinate, (len(coordinates), nodes)."""
    nodes = grid.shape[axis]
    position = (np.array(coordinates) - grid.lower[axis]) / grid.spacing[axis]
    left = np.floor(position).astype(int)
    if not grid.periodic[axis]:
        left = np.clip(left, 0, nodes - 2)
    share = position - left
    weights = np.zeros((len(coordinates), nodes))
    rows = np.arange(len(coordinates))
    np.add.at(weights, (rows, left % nodes), 1.0 - share)
    np.add.at(weights, (rows, (left + 1) % nodes), share)
    return weights


def fewest_steps(table: Table, state: Sequence[float], start: int, within: int) -> float:
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
            texts = [label.get_text().translate(plain) for label in side.get_ticklabels()]
            side.set_ticklabels([text.replace("pi", "π") for text in texts])


def draw_arm_live(ax: Axes, problem: ReachAvoidProblem, state: Sequence[float], time: float) -> None:
    """The workspace without arrows and formulas, and with few ticks: drawing axes is most of the work."""
    draw_workspace(ax, scene(problem), state=state, time=time)
    ticks = (-0.3, 0.0, 0.3)
    ax.set(xlabel="x (m)", ylabel="y (m)", xticks=ticks, yticks=ticks)


def steps_image(
    table: Table,
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


def draw_steps(ax: Axes, table: Table, fewest: FloatArray, *, within: int, axes: Sequence[int] = (0, 1)) -> None:
    """An image of `steps_image` in the colours of the tubes."""
    colours = np.array([*colours_of(table.steps)[: within + 1], (1.0, 1.0, 1.0, 0.0)])
    grid = table.grid
    x, y = (np.linspace(grid.lower[axis], grid.upper[axis], len(fewest)) for axis in axes)
    draw_pixels(ax, colours[fewest], around(x, y), "tubes")
    frame_live(ax, grid, axes)


class Pixels(Artist):
    """Colours (Y, X, 4), uint8, from the bottom up, that fill a rectangle of the plane.

    In a tenth of the time of Matplotlib's own image, which weighs, masks and smooths.
    """

    def __init__(self, image: Any, extent: Extent) -> None:
        super().__init__()
        self.extent = extent
        self.image = np.ascontiguousarray(image).view(np.uint32)[..., 0]  # a colour is a number: quicker to pick

    def draw(self, renderer: Any) -> None:
        ends = self.axes.transData.transform(np.reshape(self.extent, (2, 2)).T)
        seen = np.round(np.clip(ends, *self.axes.bbox.extents.reshape(2, 2))).astype(int)
        picked = self.image
        for side in range(2):
            pixels = np.arange(*seen[:, side]) + 0.5 - ends[0, side]
            place = pixels / np.ptp(ends[:, side]) * self.image.shape[1 - side]
            picked = picked.take(np.clip(place.astype(int), 0, self.image.shape[1 - side] - 1), axis=1 - side)
        context = renderer.new_gc()
        self._set_gc_clip(context)
        renderer.draw_image(context, *seen[0], picked[..., None].view(np.uint8))
        context.restore()


def around(x: FloatArray, y: FloatArray) -> Extent:
    """Where an image ends whose pixels have these centres."""
    dx, dy = (x[1] - x[0]) / 2, (y[1] - y[0]) / 2
    return x[0] - dx, x[-1] + dx, y[0] - dy, y[-1] + dy


def draw_pixels(ax: Axes, image: FloatArray, extent: Extent, gid: str, zorder: float = 1.0) -> None:
    """Colours (Y, X, 4) as they are, without smoothing; the axes end where the image does until told otherwise."""
    pixels = Pixels(image if image.dtype == np.uint8 else (image * 255).astype(np.uint8), extent)
    pixels.set(zorder=zorder, gid=gid)
    ax.add_artist(pixels)
    ax.set(xlim=extent[:2], ylim=extent[2:])


def draw_sets(
    ax: Axes,
    problem: ReachAvoidProblem,
    *,
    through: Sequence[float],
    step: float = 0.0,
    axes: Sequence[int] = (0, 1),
    filled: bool = True,
) -> None:
    """As `draw_constraints`, or the outlines of the unsafe sets alone; says of a slice that all of it is in one."""
    where = plane(problem.grid, through, axes, COARSE)
    for place, part in enumerate(problem.all_sets if filled else problem.unsafe):
        values = where.true(part, step * problem.delta)
        looks = look(part.name) | ({} if filled else {"facecolor": "none", "hatch": None})
        draw_set(ax, where, values, looks, part.name, 2.0 + place)
        if part is not problem.target and values.max() <= 0:
            draw_full(ax, part.name)
    frame_live(ax, problem.grid, axes)


def draw_full(ax: Axes, name: str) -> None:
    """Say of a slice that all of it is in one unsafe set: it has no outline then, and would look free."""
    colours = {key: UNSAFE_LOOKS[key] for key in ("facecolor", "edgecolor")}
    looks = colours | {"hatch": "//", "linewidth": 0.0}
    ax.add_patch(Rectangle((0, 0), 1, 1, transform=ax.transAxes, zorder=4.5, gid=f"{name}-full", **looks))
    for spine in ax.spines.values():  # the frame stays in sight
        spine.set_zorder(6.0)
    said = {"ha": "center", "va": "center", "zorder": 9.0, "bbox": {"facecolor": "white", "edgecolor": "none"}}
    ax.text(0.5, 0.5, f"all of this slice collides: {name}", transform=ax.transAxes, **said)


def draw_slice_legend(figure: Figure, problem: ReachAvoidProblem, *areas: Patch) -> None:
    """What lines and dots mean on a slice and in the workspace beside it, below both; `areas` come first."""
    handles: list[Any] = [*areas, Patch(**look(problem.target.name), label=problem.target.name)]
    for part in problem.unsafe:
        looks = look(part.name)
        edge = {key: looks.get(key, "-") for key in ("linewidth", "linestyle")}
        handles.append(Line2D([], [], color=looks["edgecolor"], label=f"{part.name}: collision", **edge))
    dot = {key: value for key, value in HERE.items() if key not in ("gid", "zorder")}
    handles.append(Line2D([], [], linestyle="none", label="the state on the left", **dot))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))


def draw_short_bar(ax: Axes, steps: int) -> None:
    """The colours of 0 to `steps` steps to go, from the bottom up."""
    draw_pixels(ax, np.array(colours_of(steps))[:, None], (0, 1, -0.5, steps + 0.5), "colours")
    ax.set(xticks=[], yticks=[0, steps], title="n")
    ax.yaxis.tick_right()


def here(grid: Grid, state: Sequence[float], axes: Sequence[int] = (0, 1)) -> FloatArray:
    """Where a state lies on a slice of two axes, angles between the ends of the grid: (2,)."""
    return grid.wrapped(np.asarray(state, dtype=np.float64)[None])[0, list(axes)]


def wrapped(state: Sequence[float]) -> FloatArray:
    """The joint angles (2,) of a state in [-pi, pi)."""
    return np.mod(np.asarray(state, dtype=np.float64)[:2] + np.pi, 2 * np.pi) - np.pi
