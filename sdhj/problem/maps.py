"""Level-set functions of maps and polygons, for `UnsafeSet.from_map` and `UnsafeSet.polygon`.

The whole closed square of every pixel that is not free is unsafe, and so is everything outside the map. Let s be the
signed distance to this set, negative inside, and h half the side of a pixel. At the *nodes*, the corners, middles of
edges and centres of pixels, s is computed exactly: the point of a square nearest to a node is again a node (clipping a
multiple of h to an interval between multiples of h gives one), so the exact Euclidean distance transform finds it.

Between the nodes s is interpolated bilinearly, as the mean of s at the corners X of a cell with the weights of a point
x. It differs from s(x) by at most the mean of |X - x|, because s has slope 1; and (mean |X - x|)^2 is at most
mean |X - x|^2 = (a (1 - a) + b (1 - b)) h^2 <= h^2 / 2. This bound and the robot's radius are subtracted:

    interpolant - h / sqrt(2) - radius  <=  s - radius  <=  interpolant + h / sqrt(2) - radius.

The level-set function, the left-hand side, is <= 0 wherever the robot's disk meets the unsafe set, and within the map
at most half the diagonal of a pixel, sqrt(2) h, below the true one. Along each axis the slope of the interpolant is a
difference of s between neighbours over their distance, at most 1; in any direction it is at most sqrt(2). Outside the
map the function is its value at the nearest point of the map, less the distance to that point: its slope is at most 1
along the normal of the edge and along the edge, so the same bounds hold.

A polygon needs no samples: its distance is the least one to an edge, and whether a point is inside follows from the
sides of the edges' lines on which it is, by a formula with each edge once (`_inside`). Bounds of such a formula over a
box away from the edges are definite also where lines of edges pass through the box. It has some 15 operations an edge.
Where a corner lies on the line of another edge the rule does not hold, and turns around the point are counted instead
(`_around`): as exact, but bounds do not tell inside from outside at the height of a corner.
"""

import math
import os
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sdhj.formulas.gridded import gridded
from sdhj.kernels import FloatArray
from sdhj.problem.checks import finite_array, number, option, whole

KEYS = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")  # that the map server requires
MODES = ("trinary", "scale")
UNKNOWN_GREY = 205  # with which map savers mark unknown pixels
MapLevelSet = Callable[[FloatArray, float], FloatArray]
MISSING = "install it with pip install 'sdhj[maps]'"


def map_level_set(
    source: str | os.PathLike[str] | FloatArray,
    *,
    resolution: float | None = None,
    origin: Sequence[float] = (0.0, 0.0, 0.0),
    radius: float = 0.0,
    name: str = "map",
) -> MapLevelSet:
    """The level-set function of all that a map does not show as free.

    Parameters
    ----------
    source : path of a map server's YAML file, or bool array (rows, columns)
        An array is True where the map is occupied or unknown; row 0 is the top of the map, as in an image.
    resolution : float
        Side of a pixel, m. Required for an array; a file contains it.
    origin : (x, y) or (x, y, yaw)
        Position of the lower left corner of the lower left pixel, m, and the rotation of the map about it, rad. For an
        array only; a file contains it.
    radius : float
        Radius of a disk-shaped robot with centre (x, y), by which everything unsafe is enlarged, m.
    name : str
        Name of an array in error messages.

    Raises
    ------
    ValueError
        If a file cannot be read or is invalid, with its name; if no pixel is free.
    ImportError
        If a package that is needed, of the extra `maps`, is not installed.
    """
    if isinstance(source, str | os.PathLike):
        if resolution is not None or tuple(origin) != (0.0, 0.0, 0.0):
            raise ValueError("resolution and origin are read from the map's file; give them with an array only")
        blocked, resolution, origin = read_map(Path(source))
    else:
        blocked = np.asarray(source)
        if blocked.ndim != 2 or blocked.dtype != np.bool_ or not blocked.size:
            raise ValueError(
                "a map must be the path of a YAML file or a bool array (rows, columns), True where it is occupied or "
                f"unknown, got {type(source).__name__} of {blocked.dtype} of shape {blocked.shape}"
            )
    if blocked.all():
        shown = os.fspath(source) if isinstance(source, str | os.PathLike) else name
        raise ValueError(f"no pixel of the map {shown!r} is free; an array must be True where it is occupied")
    radius, side = number("radius", radius, least=0.0), number("resolution", resolution, above=0.0)
    if np.shape(origin) not in ((2,), (3,)):
        raise ValueError(f"origin must be (x, y) or (x, y, yaw), got {origin!r}")
    x, y, yaw = (*finite_array("origin", origin).tolist(), 0.0)[:3]
    cosine, sine = math.cos(yaw), math.sin(yaw)
    nodes = clearance(blocked, side)
    size = (np.array(nodes.shape) - 1.0) * (side / 2)
    table = gridded(nodes - (side / math.sqrt(8.0) + radius), [0.0, 0.0], [side / 2, side / 2])

    def level_set(points: FloatArray, t: float) -> FloatArray:
        dx, dy = points[:, 0] - x, points[:, 1] - y
        places = np.stack([cosine * dx + sine * dy, cosine * dy - sine * dx], axis=1)
        past = np.maximum(places - size, np.minimum(places, 0.0))  # 0 on the map
        return table(places) - np.hypot(past[:, 0], past[:, 1])

    return level_set


def clearance(blocked: FloatArray, side: float) -> FloatArray:
    """Signed distance to the blocked pixels and the outside of the map, m, at nodes half a pixel apart.

    blocked : (rows, columns) bool, row 0 at the top; returns (2 columns + 1, 2 rows + 1), x before y, both ascending.
    """
    try:
        from scipy.ndimage import binary_dilation, distance_transform_edt
    except ImportError as error:
        raise ImportError(f"distances on a map need SciPy; {MISSING}") from error

    def closed(cells: FloatArray) -> FloatArray:
        """Whether each node touches one of the cells (n, m): (2 n + 1, 2 m + 1)."""
        centres = np.zeros([2 * n + 1 for n in cells.shape], np.bool_)
        centres[1::2, 1::2] = cells
        return np.asarray(binary_dilation(centres, np.ones((3, 3))))

    cells = blocked[::-1].T
    unsafe, free = closed(cells), closed(~cells)
    unsafe[[0, -1]] = unsafe[:, [0, -1]] = True  # they touch the outside of the map
    return (distance_transform_edt(~unsafe) - distance_transform_edt(~free)) * (side / 2)


def read_map(path: Path) -> tuple[FloatArray, float, Sequence[float]]:
    """The pixels that are not free (rows, columns), the resolution and the origin of a map server's YAML file.

    As for the map server, a pixel is free if its darkness (its lightness with `negate`), from 0 to 1, is below
    `free_thresh`. All other pixels are occupied or unknown, in mode "trinary" and in mode "scale" alike, and so are
    pixels that are not opaque.
    """
    try:
        import yaml
    except ImportError as error:
        raise ImportError(f"reading the file of a map needs PyYAML; {MISSING}") from error
    try:
        entries = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ValueError(f"{path} is not the YAML file of a map: {error}") from error
    if not isinstance(entries, dict) or (lacking := [key for key in KEYS if key not in entries]):
        what = f"it lacks {', '.join(lacking)}" if isinstance(entries, dict) else "it has no keys"
        raise ValueError(f"{path} is not the YAML file of a map, which has the keys {', '.join(KEYS)}: {what}")
    try:
        option("mode", entries.get("mode", MODES[0]), MODES)
        negate = bool(whole("negate", int(entries["negate"]), least=0, most=1))
        free = number("free_thresh", entries["free_thresh"], least=0.0, most=1.0)
        number("occupied_thresh", entries["occupied_thresh"], least=free, most=1.0)
        resolution = number("resolution", entries["resolution"], above=0.0)
        origin = finite_array("origin", entries["origin"], (3,)).tolist()
        if not isinstance(entries["image"], str):
            raise ValueError(f"image must be the name of a file, got {entries['image']!r}")
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path} is not the YAML file of a map: {error}") from error
    grey, opaque = read_image(path.parent / entries["image"])
    darkness = (grey if negate else 255.0 - grey) / 255.0
    blocked = ~((darkness < free) & opaque)
    if (grey[~blocked] == UNKNOWN_GREY).any():
        warnings.warn(
            f"{path} counts the grey {UNKNOWN_GREY}, which usually marks unknown pixels, as free, because its "
            f"free_thresh {free:g} is above {1 - UNKNOWN_GREY / 255:.4f}; lower it if these pixels are unknown",
            stacklevel=4,
        )
    return blocked, resolution, origin


def read_image(path: Path) -> tuple[FloatArray, FloatArray]:
    """Lightness of the pixels of a picture, 0 to 255, and whether they are opaque: both (rows, columns)."""
    try:
        from PIL import Image
    except ImportError as error:
        raise ImportError(f"reading the picture of a map needs Pillow; {MISSING}") from error
    try:
        with Image.open(path) as image:
            if image.mode.startswith("I"):  # 16 bits
                return np.asarray(image, dtype=np.float64) / 257.0, np.ones(image.size[::-1], np.bool_)
            pixels = np.asarray(image.convert("RGBA"), dtype=np.float64)
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise ValueError(f"{path} is not a picture of a map, such as a PGM or PNG file: {error}") from error
    return pixels[..., :3].mean(axis=2), pixels[..., 3] == 255.0


def polygon_level_set(vertices: FloatArray, *, radius: float = 0.0) -> MapLevelSet:
    """The signed distance to a simple polygon with vertices (K, 2), m, less a robot's radius.

    Raises
    ------
    ValueError
        If there are fewer than three vertices, or if edges cross.
    ImportError
        If Shapely is not installed.
    """
    try:
        import shapely
    except ImportError as error:
        raise ImportError(f"checking a polygon needs Shapely; {MISSING}") from error
    corners, radius = finite_array("vertices", vertices), number("radius", radius, least=0.0)
    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3:
        raise ValueError(f"vertices must have shape (K, 2), at least three of them, got {corners.shape}")
    shape = shapely.Polygon(corners)
    if not shape.is_valid or shape.area == 0.0:
        raise ValueError(f"vertices must go around a polygon whose edges do not meet: {shapely.is_valid_reason(shape)}")
    corners = corners[(corners != np.roll(corners, -1, axis=0)).any(axis=1)]
    corners = corners if shape.exterior.is_ccw else corners[::-1]
    edges = np.roll(corners, -1, axis=0) - corners
    lengths = np.hypot(*edges.T)
    directions = edges / lengths[:, None]
    general = _general(corners, directions)

    def level_set(points: FloatArray, t: float) -> FloatArray:
        out = points[:, None] - corners
        along = (out * directions).sum(axis=2)
        right = out[..., 0] * directions[:, 1] - out[..., 1] * directions[:, 0]  # of the line of each edge
        past = np.maximum(along - lengths, np.minimum(along, 0.0))  # 0 beside the edge
        distance = np.hypot(past, right).min(axis=1)
        side = _inside(right, corners, directions) if general else _around(right, points[:, 1], corners[:, 1])
        return np.where(side < 0.0, -distance, distance) - radius

    return level_set


def _general(corners: FloatArray, directions: FloatArray) -> bool:
    """Whether no corner lies on the line of an edge that it is no end of."""
    x, y = np.moveaxis(corners[None] - corners[:, None], 2, 0)  # of each corner, from the start of each edge
    off = np.abs(x * directions[:, 1:] - y * directions[:, :1])
    start = np.arange(len(corners))
    off[start, start] = off[start, (start + 1) % len(corners)] = np.inf
    return bool(off.min() > 1e-9 * np.ptp(corners, axis=0).max())


def _around(right: FloatArray, height: FloatArray, heights: FloatArray) -> FloatArray:
    """As `_inside`, for any polygon: by how often it goes around a point; bounds are open at the height of a corner."""
    begin, end, height = heights, np.roll(heights, -1), height[:, None]
    up = (begin <= height) & (height < end) & (right < 0.0)
    down = (end <= height) & (height < begin) & (right > 0.0)
    return 0.5 - np.where(up, 1.0, np.where(down, -1.0, 0.0)).sum(axis=1)


def _inside(right: FloatArray, corners: FloatArray, directions: FloatArray) -> FloatArray:
    """A number (M,) that is < 0 inside a polygon and > 0 outside, of those for each edge's line, right (M, K).

    From its leftmost to its rightmost corner the polygon is two chains, one below and one above, each of which its
    first and last edge prolong to infinity. Such a chain is cut at a corner of its convex hull, where the lines of both
    edges leave the hull for good; left of it is what is left of both parts if it turns left there, else of one of them.
    Every edge comes once. No corner may be on the line of another edge. (Dobkin, Guibas, Hershberger, Snoeyink: An
    efficient algorithm for finding the CSG representation of a simple polygon, Algorithmica 10, 1993.)
    """
    count = len(corners)
    low, *_, high = np.lexsort((corners[:, 1], corners[:, 0])).tolist()
    high += count * (high < low)
    todo: list[Any] = [np.maximum, (low, high), (high, low + count)]  # chains of edges, and what puts two together
    done: list[FloatArray] = []
    while todo:
        one = todo.pop()
        if not isinstance(one, tuple):
            done.append(one(done.pop(), done.pop()))
            continue
        first, last = one
        if last - first == 1:
            done.append(right[:, first % count])
        else:
            corner, turns_left = _cut(first, last, corners, directions)
            todo += [np.maximum if turns_left else np.minimum, (first, corner), (corner, last)]
    return done[0]


def _cut(first: int, last: int, corners: FloatArray, directions: FloatArray) -> tuple[int, bool]:
    """A corner on the convex hull of the chain of edges from `first` to before `last`; whether the chain turns left."""
    count = len(corners)
    ahead, behind = directions[first % count], directions[(last - 1) % count]
    out = ahead - behind  # farthest that way is a corner: both rays go back
    if np.hypot(*out) < 1e-6:  # they are opposite: to the side, to which the other ray does not go
        out = np.array([-ahead[1], ahead[0]])
        out = -out if (out * behind).sum() > 0.0 else out
    between = np.arange(first + 1, last)
    corner = int(between[np.argmax((corners[between % count] * out).sum(axis=1))])
    ways = directions[(corner - 1) % count] + directions[corner % count]
    return corner, bool(out[0] * ways[1] - out[1] * ways[0] > 0.0)
