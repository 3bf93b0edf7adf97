"""Bodies in three axes, turned: painted by a z-buffer, because a slider waits for them."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from PIL import Image

from course.draw.slices import draw_pixels
from course.paper import LIGHT, block, isosurface
from sdhj.kernels import FloatArray
from sdhj.kernels.compiling import kernel
from sdhj.table.batches import Table

TURNED = {"hji": "#6aa6d6", "projected": "#46ab9f"}  # the colours of Fig. 13
VIEW = 1.85  # half a side of the picture of a turned box, whose half-diagonal is 1.73
SIDE = 390  # pixels of it
CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))
EDGES = np.array([(one, other) for one, other in combinations(CORNERS, 2) if (one != other).sum() == 1])  # of the box
FINE = 2  # parts of a pixel's side, for smooth edges


def turned(points: FloatArray, azimuth: float, elevation: float) -> FloatArray:
    """Points (..., 3) as seen from a direction, degrees: right, up, and towards the viewer."""
    a, e = np.radians((azimuth, elevation))
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    towards = np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
    return points @ np.stack([right, np.cross(towards, right), towards], axis=1)


@dataclass(frozen=True)
class Body:
    """The boundary of a set in a box, scaled to [-1, 1]^3: triangles (T, 3, 3), unit normals (T, 3), share inside."""

    triangles: FloatArray
    normals: FloatArray
    share: float

    @classmethod
    def of(cls, table: Table, through: Sequence[float]) -> "Body":
        """Of the whole tube over (q1, q2, px) through a state."""
        lower, upper = (np.array(ends[:3]) for ends in (table.grid.lower, table.grid.upper))
        values, coordinates = block(table.grid, table.values(start=0, within=table.steps), (0, 1, 2), through)
        triangles = (isosurface(values, coordinates) - (lower + upper) / 2) / ((upper - lower) / 2)
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        length = np.linalg.norm(normals, axis=1)
        kept = length > 1e-12
        share = float((values[1:-2, 1:-2, 1:-1] <= 0).mean())
        return cls(triangles[kept], normals[kept] / length[kept, None], share)


@kernel()
def paint(triangles: FloatArray, colours: FloatArray, image: FloatArray, heights: FloatArray) -> None:
    """Paint triangles (T, 3, 3) of column, row and height in colours (T, 3) into an image (Y, X, 4) by a z-buffer.

    `heights` (Y, X) are of what the image shows; higher is nearer. Both are changed in place. The centre of pixel
    (0, 0) is at column 0 and row 0.
    """
    for t in range(len(triangles)):
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = triangles[t]
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if area == 0.0:  # seen from its side
            continue
        for y in range(max(0, int(np.ceil(min(ay, by, cy)))), min(len(image) - 1, int(max(ay, by, cy))) + 1):
            for x in range(max(0, int(np.ceil(min(ax, bx, cx)))), min(image.shape[1] - 1, int(max(ax, bx, cx))) + 1):
                a = ((bx - x) * (cy - y) - (cx - x) * (by - y)) / area
                b = ((cx - x) * (ay - y) - (ax - x) * (cy - y)) / area
                if a >= 0.0 and b >= 0.0 and a + b <= 1.0:
                    height = cz + a * (az - cz) + b * (bz - cz)
                    if height > heights[y, x]:
                        heights[y, x], image[y, x, 3] = height, 255
                        for channel in range(3):
                            image[y, x, channel] = colours[t, channel]


def draw_turned(ax: Axes, body: Body, *, azimuth: float, elevation: float, colour: str) -> None:
    """A body, turned, in its box."""
    facing = turned(body.normals, azimuth, elevation)[:, 2] > 0
    seen, normals = turned(body.triangles[facing], azimuth, elevation), body.normals[facing]
    light = 0.55 + 0.45 * np.clip(normals @ (LIGHT / np.linalg.norm(LIGHT)), 0.0, 1.0)
    side = SIDE * FINE
    seen[..., :2] = (seen[..., :2] * (1, -1) + VIEW) / (2 * VIEW) * side - 0.5
    image, heights = np.zeros((side, side, 4), dtype=np.uint8), np.full((side, side), -np.inf)
    paint(seen, np.round(255 * light[:, None] * to_rgb(colour)).astype(np.uint8), image, heights)
    smooth = np.asarray(Image.fromarray(image).reduce(FINE))
    draw_pixels(ax, smooth[::-1], (-VIEW, VIEW, -VIEW, VIEW), "surface", zorder=2.0)
    ends = turned(EDGES, azimuth, elevation)
    behind = ends[..., 2].mean(axis=1) < 0
    for edges, layer in ((ends[behind], 1.0), (ends[~behind], 3.0)):  # behind the body and in front of it
        parted = np.pad(edges[..., :2], ((0, 0), (0, 1), (0, 0)), constant_values=np.nan).reshape(-1, 2)
        ax.plot(*parted.T, color="#8c8c8c", linewidth=0.7, linestyle="-", zorder=layer)
    for name, label in zip(("q1", "q2", "px"), turned((2 * np.eye(3) - 1) * 1.14, azimuth, elevation), strict=True):
        ax.text(*label[:2], name, ha="center", va="center", zorder=4.0)
    ax.set(xlim=(-VIEW, VIEW), ylim=(-VIEW, VIEW), aspect="equal")
    ax.axis("off")
