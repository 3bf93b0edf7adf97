"""Slow twin of the distance between bodies, in plain loops over corners and edges. Imports nothing from sdhj."""

import math

from naive_maps import to_polygon


def placed(vertices, x, y, heading):
    """The corners of a body at a pose."""
    c, s = math.cos(heading), math.sin(heading)
    return [(x + c * a - s * b, y + s * a + c * b) for a, b in vertices]


def hull(points):
    """The corners of the convex hull, counter-clockwise (Andrew's monotone chain)."""
    points, half = sorted(set(points)), []
    for row in (points, points[::-1]):
        chain = []
        for p in row:
            while len(chain) > 1 and turn(chain[-2], chain[-1], p) <= 0:
                chain.pop()
            chain.append(p)
        half += chain[:-1]
    return half or points


def turn(a, b, c):
    """Above 0 where c is to the left of the line from a to b."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def of_convex(one, other):
    """Signed distance of two convex bodies: that of the origin to the hull of all differences of their points.

    Negative where they overlap: then how far one has to be moved until they do not.
    """
    differences = hull([(a - c, b - d) for a, b in one for c, d in other])
    if len(differences) < 3:
        ends = differences[0], differences[-1]
        return to_segment((0.0, 0.0), *ends)
    return to_polygon(0.0, 0.0, differences)


def to_segment(p, a, b):
    """Distance from a point to a segment."""
    length = (b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2
    share = ((p[0] - a[0]) * (b[0] - a[0]) + (p[1] - a[1]) * (b[1] - a[1])) / length if length else 0.0
    share = min(max(share, 0.0), 1.0)
    return math.hypot(p[0] - a[0] - share * (b[0] - a[0]), p[1] - a[1] - share * (b[1] - a[1]))


def apart(one, other):
    """Distance of two simple polygons, 0 where they meet: by their edges, and whether one is inside the other."""
    if to_polygon(*one[0], other) <= 0 or to_polygon(*other[0], one) <= 0:
        return 0.0
    nearest = math.inf
    for a, b in edges(one):
        for c, d in edges(other):
            if turn(a, b, c) * turn(a, b, d) <= 0 and turn(c, d, a) * turn(c, d, b) <= 0:
                return 0.0
            nearest = min(nearest, to_segment(a, c, d), to_segment(b, c, d), to_segment(c, a, b), to_segment(d, a, b))
    return nearest


def edges(polygon):
    return list(zip(polygon, [*polygon[1:], polygon[0]], strict=True))
