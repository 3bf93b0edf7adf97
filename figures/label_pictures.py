"""Slices that show what of a tube is certified."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.patches import Patch

from sdhj.certified.table import CertifiedTable
from labels import LABELS, labels
from sdhj.plotting.looks import FULL, INK, INNER
from sdhj.plotting.slices import RESOLUTION, State, draw_set, frame_slice, plane
from sdhj.table import LookupTable

COLOURS = (INNER["facecolor"], "#f2c14e", "#ffffff")  # also apart in grey


def draw_labels(
    ax: Axes,
    table: LookupTable,
    certified: CertifiedTable,
    *,
    through: State,
    start: int = 0,
    within: int | None = None,
    axes: Sequence[int] = (0, 1),
    resolution: int = RESOLUTION,
) -> None:
    """A slice in the colours of `labels.LABELS`, with the outline of the table's own tube."""
    within = table.steps - start if within is None else within
    where = plane(table.grid, through, axes, resolution)
    found = where.shaped(labels(table, certified, where.points, start=start, within=within))
    image = ax.pcolormesh(
        where.x,
        where.y,
        found,
        cmap=ListedColormap(COLOURS),
        norm=BoundaryNorm(np.arange(-0.5, len(LABELS)), len(LABELS)),
        shading="nearest",
        rasterized=True,
    )
    image.set_gid("labels")
    outline = FULL | {"facecolor": "none", "hatch": "", "edgecolor": INK}
    values = where.of(table.grid, table.values(start=start, within=within))
    draw_set(ax, where, values, outline, "tube", 3.0)
    frame_slice(ax, table.grid, axes)


def label_legend() -> list[Patch]:
    """Legend entries of `draw_labels`."""
    return [
        Patch(facecolor=colour, edgecolor=INK, linewidth=0.6, label=label)
        for colour, label in zip(COLOURS, LABELS, strict=True)
    ]
