"""Projected tubes are smaller than full ones: this is by what volume and by what Hausdorff distance.

For every (start, within): the volumes of both tubes as shares of the grid, the volume of the inner tube that lies
outside the reference and the largest level-set value of the reference there (both nothing but scheme error where one
under-approximates the other), and the Hausdorff distance of slices: how far the farthest state of one set is from the
other. A slice holds some coordinates fixed; distances are along the axes that are left, in their units, and go the
short way round periodic axes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import matplotlib as mpl
import numpy as np
from common import PURSUER_AT, Context, command_of
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.ndimage import distance_transform_edt

from sdhj import plotting
from sdhj.common.remembering import FloatArray
from sdhj.problem.grid import Grid
from sdhj.table.batches import Table

LUMA = (0.2126, 0.7152, 0.0722)  # lightness of red, green and blue (Rec. 709)
REFINE = 4  # nodes of a slice for each cell of the grid, which is how accurate distances are
Slice = Mapping[str, float]  # from names of axes to the coordinates that they are held at


@dataclass(frozen=True)
class Row:
    """One (start, within) of a comparison.

    Attributes
    ----------
    start, within : int
    reference, inner : float
        Share of the grid's volume in each tube.
    outside : float
        Share of the grid's volume in the inner tube but not in the reference.
    depth : float
        The reference's largest level-set value in the inner tube, where it is positive: how far outside that is.
    hausdorff : tuple of float
        One for each slice; 0 where both are empty, inf where one is.
    """

    start: int
    within: int
    reference: float
    inner: float
    outside: float
    depth: float
    hausdorff: tuple[float, ...]

    @property
    def ratio(self) -> float:
        """Volume of the inner tube relative to the reference; NaN where that is empty."""
        return self.inner / self.reference if self.reference > 0 else float("nan")


def compare(reference: Table, inner: Table, slices: Sequence[Slice]) -> list[Row]:
    """Compare every tube of two tables of one problem, in the order of the look-up table.

    Raises
    ------
    ValueError
        For tables of different problems, an unknown axis, a coordinate off the grid or a slice that holds every axis.
    """
    if reference.problem.digest != inner.problem.digest:
        raise ValueError("the tables were solved for different problems; compare two methods on one problem")
    grid = reference.grid
    sections = [_section(grid, cut) for cut in slices]
    rows = []
    for start in range(reference.steps + 1):
        for within in range(reference.steps - start + 1):
            values = [table.values(start=start, within=within) for table in (reference, inner)]
            a, b = (array <= 0 for array in values)
            distances = tuple(_slice_distance(grid, values, fine, points) for fine, points in sections)
            depth = float(values[0].max(where=b, initial=0.0))
            rows.append(Row(start, within, grid.fraction(a), grid.fraction(b), grid.fraction(b & ~a), depth, distances))
    return rows


def _section(grid: Grid, cut: Slice) -> tuple[Grid, FloatArray]:
    """The finer grid of a slice, and its nodes as states (M, ndim) of the whole grid."""
    for name, at in cut.items():
        if name not in grid.names:
            raise ValueError(f"a slice names axes among {', '.join(grid.names)}, got {name!r}")
        axis = grid.names.index(name)
        low, high = grid.lower[axis], grid.upper[axis]
        if not grid.periodic[axis] and not low <= at <= high:
            raise ValueError(f"a slice must be on the grid: {name} from {low:g} to {high:g}, got {at}")
    free = [axis for axis in range(grid.ndim) if grid.names[axis] not in cut]
    if not free:
        raise ValueError("a slice must leave at least one axis free")
    coarse = grid.subgrid(free)
    shape = [n * REFINE if p else (n - 1) * REFINE + 1 for n, p in zip(coarse.shape, coarse.periodic, strict=True)]
    fine = Grid(coarse.lower, coarse.upper, shape, coarse.periodic, coarse.names)
    points = np.empty((fine.size, grid.ndim))
    points[:, free] = fine.points()
    for name, at in cut.items():
        points[:, grid.names.index(name)] = at
    return fine, points


def _slice_distance(grid: Grid, values: Sequence[FloatArray], fine: Grid, points: FloatArray) -> float:
    a, b = (grid.interpolate(array, points).reshape(fine.shape) <= 0 for array in values)
    return hausdorff(fine, a, b)


def hausdorff(grid: Grid, a: FloatArray, b: FloatArray) -> float:
    """Hausdorff distance of two sets of nodes, bool (shape), in the units of the axes, periodic axes wrapped.

    The larger of the distances from the farthest node of one set to the other. 0 where both are empty, inf where only
    one is.
    """
    if not a.any() or not b.any():
        return 0.0 if a.any() == b.any() else float("inf")
    return max(float(distance_to(grid, b)[a].max()), float(distance_to(grid, a)[b].max()))


def distance_to(grid: Grid, inside: FloatArray) -> FloatArray:
    """Euclidean distance of every node from a set of nodes, bool (shape) and not empty; periodic axes wrapped."""
    margin = [(n // 2 + 1 if periodic else 0,) * 2 for n, periodic in zip(grid.shape, grid.periodic, strict=True)]
    wrapped = np.pad(inside, margin, mode="wrap")  # the nearest node is never more than half a turn away
    distance = distance_transform_edt(~wrapped, sampling=grid.spacing)
    middle = tuple(slice(m, m + n) for (m, _), n in zip(margin, grid.shape, strict=True))
    return distance[middle]


def value(context: Context) -> float:
    """The volume of the largest projected tube by that of the full one."""
    return compare(context.table("hji"), context.table("projected"), [])[context.problem.steps].ratio


def draw(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 3.3)
    px, py = PURSUER_AT[2:]
    rows = compare(context.table("hji"), context.table("projected"), [{"px": px, "py": py}])
    left, right = figure.subplots(1, 2)
    ratios, distances = (np.full((context.problem.steps + 1,) * 2, np.nan) for _ in range(2))
    for row in rows:
        ratios[row.start, row.within], distances[row.start, row.within] = row.ratio, row.hausdorff[0]
    draw_entries(left, ratios, "volume of the projected tube / full", least=float(np.nanmin(ratios)))
    draw_entries(right, distances, f"Hausdorff distance (rad), pursuer at ({px:.2f}, {py:.2f}) m", "cividis_r")
    return figure


def draw_entries(ax: Axes, values: FloatArray, title: str, cmap: str = "cividis", least: float = 0.0) -> None:
    """One number for each (start, within) as the triangle of Fig. 8, with the bar of its colours from `least` on.

    `values` (N + 1, N + 1) with NaN where there is no entry; an infinite one is written without a colour.
    """
    top = float(np.max(values, where=np.isfinite(values), initial=1e-12))
    mesh = ax.imshow(np.ma.masked_invalid(values), cmap=cmap, vmin=min(least, top), vmax=top, gid="entries")
    ax.figure.colorbar(mesh, ax=ax, shrink=0.75, pad=0.02)
    colours = mpl.colormaps[cmap]
    for (k, n), entry in np.ndenumerate(values):
        if not np.isnan(entry):
            finite = np.isfinite(entry)
            dark = finite and float(np.dot(colours(mesh.norm(entry))[:3], LUMA)) < 0.5
            looks = {"ha": "center", "va": "center", "fontsize": 6.5, "color": "white" if dark else "black"}
            ax.text(n, k, f"{entry:.2f}" if finite else r"$\infty$", **looks)
    places = range(len(values))
    ax.set(xticks=places, yticks=places, xlabel="steps to go, $n$", ylabel="from step $k$", title=title)
    ax.tick_params(length=0)
    for spine in ax.spines.values():
        spine.set_visible(False)


if __name__ == "__main__":
    command_of(__file__)()
