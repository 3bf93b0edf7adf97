"""Slow twin of distances on a map, in plain loops over squares. Imports nothing from sdhj."""

import math


def to_square(x, y, i, j, side):
    """Distance from a point to the closed square of column i, row j counted from the bottom; 0 inside."""
    nearest_x, nearest_y = min(max(x, i * side), (i + 1) * side), min(max(y, j * side), (j + 1) * side)
    return math.hypot(x - nearest_x, y - nearest_y)


def signed_distance(x, y, blocked, side):
    """Of a point, in the map's own frame, to the blocked squares and the outside, negative inside those.

    blocked : list of rows of bool, the first row the top one.
    """
    rows, columns = len(blocked), len(blocked[0])
    width, height = columns * side, rows * side
    squares = [(i, j, blocked[rows - 1 - j][i]) for j in range(rows) for i in range(columns)]
    outside = max(min(x, width - x, y, height - y), 0.0)
    unsafe = min([outside, *(to_square(x, y, i, j, side) for i, j, full in squares if full)])
    free = min(to_square(x, y, i, j, side) for i, j, full in squares if not full)
    return unsafe - free


def to_polygon(x, y, vertices):
    """Signed distance to a simple polygon, negative inside: the nearest edge, and whether a ray crosses oddly often."""
    nearest, inside = math.inf, False
    for (ax, ay), (bx, by) in zip(vertices, [*vertices[1:], vertices[0]], strict=True):
        share = ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / ((bx - ax) ** 2 + (by - ay) ** 2)
        share = min(max(share, 0.0), 1.0)
        nearest = min(nearest, math.hypot(x - ax - share * (bx - ax), y - ay - share * (by - ay)))
        if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
            inside = not inside
    return -nearest if inside else nearest
