"""How much smaller one table's tubes are than another's: the price of projecting, in numbers (Sec. 6.1, Fig. 13).

For every (start, within): the volumes of both tubes as shares of the grid, their ratio, the volume of the inner tube
that lies outside the reference and the largest level-set value of the reference there (both nothing but scheme error
where one under-approximates the other), and the Hausdorff distance of slices: how far the farthest state of one set is
from the other. A slice holds some coordinates fixed; distances are along the axes that are left, in their units, and
go the short way round periodic axes.
"""

import csv
import io
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import distance_transform_edt

from sdhj.grid import FloatArray, Grid
from sdhj.projections import driven_axes
from sdhj.table import LookupTable

REFINE = 4  # nodes of a slice for each cell of the grid
Slice = Mapping[str, float]


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


@dataclass(frozen=True)
class Comparison:
    """The rows of a comparison; `str()` is a table to print.

    Attributes
    ----------
    methods : (str, str)
        Of the reference and of the inner table.
    slices : tuple of mapping
        Name of an axis to the coordinate it is held at.
    rows : tuple of Row
        Every (start, within), in the order of the look-up table.
    """

    methods: tuple[str, str]
    slices: tuple[Slice, ...]
    rows: tuple[Row, ...]

    @property
    def header(self) -> list[str]:
        """Names of the columns."""
        distances = ["hausdorff " + " ".join(f"{name}={value:g}" for name, value in cut.items()) for cut in self.slices]
        return ["start", "within", *self.methods, "ratio", "outside", "depth", *distances]

    def cells(self, row: Row) -> list[float]:
        """One row's numbers, under `header`."""
        return [row.start, row.within, row.reference, row.inner, row.ratio, row.outside, row.depth, *row.hausdorff]

    def entries(self, column: str) -> FloatArray:
        """A column as a triangle (N + 1, N + 1), start by within, NaN where there is no entry.

        Raises
        ------
        ValueError
            Where there is no such column.
        """
        if column not in self.header:
            raise ValueError(f"column must be one of {', '.join(self.header)}, got {column!r}")
        place = self.header.index(column)
        count = max(row.start for row in self.rows) + 1
        out = np.full((count, count), np.nan)
        for row in self.rows:
            out[row.start, row.within] = self.cells(row)[place]
        return out

    def __str__(self) -> str:
        widths = [max(len(name), 9) for name in self.header]
        lines = ["  ".join(name.rjust(width) for name, width in zip(self.header, widths, strict=True))]
        for row in self.rows:
            texts = [_text(value) for value in self.cells(row)]
            lines.append("  ".join(text.rjust(width) for text, width in zip(texts, widths, strict=True)))
        return "\n".join(lines)

    def markdown(self) -> str:
        """The table in Markdown."""
        lines = [self.header, ["---:"] * len(self.header), *([_text(v) for v in self.cells(row)] for row in self.rows)]
        return "\n".join("| " + " | ".join(line) + " |" for line in lines)

    def csv(self) -> str:
        """The table as comma-separated values, every number in full."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.header)
        writer.writerows(self.cells(row) for row in self.rows)
        return text.getvalue()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a CSV file."""
        Path(path).write_text(self.csv(), encoding="utf-8")


def _text(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value:.4f}" if value == 0 or value >= 1e-3 else f"{value:.1e}"


def compare(
    reference: LookupTable, inner: LookupTable, *, slices: Sequence[Slice] | None = None, refine: int = REFINE
) -> Comparison:
    """Compare every tube of two tables of one problem.

    Parameters
    ----------
    reference, inner : LookupTable
        Typically the full solution and a projected one.
    slices : sequence of mapping, optional
        Each from names of axes to the coordinates they are held at; see `default_slices`.
    refine : int
        Distances are measured between nodes this many times finer than the grid's, which is their accuracy.

    Raises
    ------
    ValueError
        For tables of different problems, an unknown axis, a coordinate off the grid or a slice that holds every axis.
    """
    if reference.problem.digest != inner.problem.digest:
        raise ValueError("the tables were solved for different problems; compare two methods on one problem")
    if int(refine) != refine or refine < 1:
        raise ValueError(f"refine must be a whole number of at least 1, got {refine!r}")
    grid = reference.grid
    cuts = tuple(dict(cut) for cut in (default_slices(reference) if slices is None else slices))
    sections = [_section(grid, cut, int(refine)) for cut in cuts]
    rows = []
    for start in range(reference.steps + 1):
        for within in range(reference.steps - start + 1):
            values = [table.values(start=start, within=within) for table in (reference, inner)]
            a, b = (array <= 0 for array in values)
            distances = tuple(_slice_distance(grid, values, fine, points) for fine, points in sections)
            depth = float(values[0].max(where=b, initial=0.0))
            rows.append(Row(start, within, grid.fraction(a), grid.fraction(b), grid.fraction(b & ~a), depth, distances))
    return Comparison((reference.method, inner.method), cuts, tuple(rows))


def default_slices(table: LookupTable) -> list[dict[str, float]]:
    """Hold the axes that no input drives, the pursuer's position in the case study: one after the other at a quarter
    and at three quarters of its length, the rest at their middle. Where inputs drive every axis, nothing is held.
    """
    grid = table.grid
    driven = driven_axes(table.problem)
    held = [axis for axis in range(grid.ndim) if not driven[axis]]
    if not held or len(held) == grid.ndim:
        return [{}]
    middle = {grid.names[axis]: (grid.lower[axis] + grid.upper[axis]) / 2 for axis in held}
    return [
        middle | {grid.names[axis]: grid.lower[axis] + share * (grid.upper[axis] - grid.lower[axis])}
        for axis in held
        for share in (0.25, 0.75)
    ]


def _section(grid: Grid, cut: Slice, refine: int) -> tuple[Grid, FloatArray]:
    """The finer grid of a slice, and its nodes as states (M, ndim) of the whole grid."""
    for name, value in cut.items():
        if name not in grid.names:
            raise ValueError(f"a slice names axes among {', '.join(grid.names)}, got {name!r}")
        axis = grid.names.index(name)
        if not grid.periodic[axis] and not grid.lower[axis] <= value <= grid.upper[axis]:
            raise ValueError(
                f"a slice must be on the grid: {name} from {grid.lower[axis]:g} to {grid.upper[axis]:g}, got {value}"
            )
    free = [axis for axis in range(grid.ndim) if grid.names[axis] not in cut]
    if not free:
        raise ValueError("a slice must leave at least one axis free")
    coarse = grid.subgrid(free)
    shape = [n * refine if p else (n - 1) * refine + 1 for n, p in zip(coarse.shape, coarse.periodic, strict=True)]
    fine = Grid(coarse.lower, coarse.upper, shape, coarse.periodic, coarse.names)
    points = np.empty((fine.size, grid.ndim))
    points[:, free] = fine.points()
    for name, value in cut.items():
        points[:, grid.names.index(name)] = value
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
