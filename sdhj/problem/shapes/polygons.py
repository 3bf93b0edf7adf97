"""Simple polygons: checked, cut into convex parts, and as level-set functions of points, for `UnsafeSet.polygon`.

The distance is the least one to an edge, and a point is inside where it is to the left of all edges of a convex part.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from sdhj.common.checks import finite_array, number
from sdhj.common.remembering import FloatArray

MISSING = "install it with pip install 'sdhj[maps]'"
ROUNDING = 1e-12  # of the size of a polygon: or a point on an edge of two parts could be in neither


def outline(vertices: Any) -> Any:
    """The polygon with these vertices (K, 2), as a simple one of Shapely, counter-clockwise."""
    try:
        import shapely
    except ImportError as error:
        raise ImportError(f"checking a polygon needs Shapely; {MISSING}") from error
    corners = finite_array("vertices", vertices)
    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3:
        raise ValueError(f"vertices must have shape (K, 2), at least three of them, got {corners.shape}")
    shape = shapely.Polygon(corners)
    if not shape.is_valid or shape.area == 0.0:
        raise ValueError(f"vertices must go around a polygon whose edges do not meet: {shapely.is_valid_reason(shape)}")
    # Corners that are said twice would be sides of no length.
    return shapely.orient_polygons(shapely.Polygon(corners[(corners != np.roll(corners, -1, axis=0)).any(axis=1)]))


def triangles(shape: Any) -> list[FloatArray]:
    """The corners (3, 2), counter-clockwise, of triangles of a polygon; of a convex one its own (K, 2)."""
    import shapely

    convex = [shape] if shape.convex_hull.equals(shape) else shapely.constrained_delaunay_triangles(shape).geoms
    return [corners_of(one) for one in convex]


def corners_of(shape: Any) -> FloatArray:
    """The corners (K, 2) of the outer ring of a polygon, counter-clockwise, the first not repeated."""
    import shapely

    return np.array(shapely.orient_polygons(shape).exterior.coords[:-1])


def convex_parts(shape: Any) -> list[FloatArray]:
    """The corners (K, 2) of a few convex polygons that together are polygons of Shapely, also with holes."""
    import shapely

    shapes = [one for one in shapely.get_parts(shape) if one.area]
    left, done = [shapely.Polygon(one) for each in shapes for one in triangles(each)], list[Any]()
    while left:
        one = left.pop()
        for k, other in enumerate(left):
            # two are joined as long as their hull is no larger than both, up to rounding
            hull = shapely.union(one, other).convex_hull
            if hull.area <= (one.area + other.area) * (1.0 + ROUNDING):
                left[k] = hull
                break
        else:
            done.append(one)
    return [corners_of(one) for one in done]


def box_without(shape: Any) -> Any:
    """What lies in the bounding box of a polygon of Shapely, but not in the polygon."""
    import shapely

    return shapely.difference(shapely.box(*shape.bounds), shape)


def polygon_level_set(vertices: FloatArray, radius: float) -> Callable[[FloatArray, float], FloatArray]:
    """Level-set function of a polygon with vertices (K, 2) that is enlarged by a radius: the signed distance, m."""
    shape = outline(vertices)
    corners, parts, radius = corners_of(shape), triangles(shape), number("radius", radius, least=0.0)
    rounding = ROUNDING * np.ptp(corners, axis=0).max()

    def level_set(points: FloatArray, t: float) -> FloatArray:
        along, right, lengths = _along_edges(points, corners)
        past = np.maximum(along - lengths, np.minimum(along, 0.0))  # 0 beside the edge
        distance = np.hypot(past, right).min(axis=1)
        outside = np.min([_outside(points, part) for part in parts], axis=0)
        return np.where(outside <= rounding, -distance, distance) - radius

    return level_set


def _along_edges(points: FloatArray, corners: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """How far points (M, 2) lie along and to the right of each edge, (M, K), and the edges' lengths."""
    edges, out = np.roll(corners, -1, axis=0) - corners, points[:, None] - corners
    lengths = np.hypot(*edges.T)
    x, y = (edges / lengths[:, None]).T
    return out[..., 0] * x + out[..., 1] * y, out[..., 0] * y - out[..., 1] * x, lengths


def _outside(points: FloatArray, corners: FloatArray) -> FloatArray:
    """A number (M,) that is <= 0 at points (M, 2) in a convex polygon, counter-clockwise, and > 0 at others."""
    # the bounding box tightens bounds over boxes at acute corners
    beyond = np.maximum(points - corners.max(axis=0), corners.min(axis=0) - points)
    return np.maximum(_along_edges(points, corners)[1].max(axis=1), beyond.max(axis=1))
