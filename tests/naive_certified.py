"""Slow twins of the certified kernels, in plain Python, and the arm's geometry by sampling. Imports nothing of sdhj."""

import itertools
import math


def elbow_and_tip(q1, q2, arm):
    """Positions of the arm's elbow and tip; arm is (l1, l2, turn)."""
    l1, l2, turn = arm
    phi = turn * q1 + q2
    elbow = (l1 * math.cos(q1), l1 * math.sin(q1))
    return elbow, (elbow[0] + l2 * math.cos(phi), elbow[1] + l2 * math.sin(phi))


def segment_distance(p, a, b):
    """Distance from a point to a segment."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    square = dx * dx + dy * dy
    s = 0.0 if square == 0 else min(max(((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / square, 0.0), 1.0)
    return math.hypot(a[0] + s * dx - p[0], a[1] + s * dy - p[1])


def arm_distance(p, q1, q2, arm):
    """Distance from a point to the two links."""
    elbow, tip = elbow_and_tip(q1, q2, arm)
    return min(segment_distance(p, (0.0, 0.0), elbow), segment_distance(p, elbow, tip))


def box_polygon_distance(box, corners):
    """Distance from a box (x0, y0, x1, y1) to the convex hull of points: of all pairs of segments, or 0."""
    x0, y0, x1, y1 = box
    edges = [((x0, y0), (x1, y0)), ((x1, y0), (x1, y1)), ((x1, y1), (x0, y1)), ((x0, y1), (x0, y0))]
    if any(x0 <= x <= x1 and y0 <= y <= y1 for x, y in corners) or inside_hull((x0, y0), corners):
        return 0.0
    best = math.inf
    for a, b in itertools.combinations_with_replacement(corners, 2):
        for c, d in edges:
            if crossing(a, b, c, d):
                return 0.0
            best = min(best, segment_distance(a, c, d), segment_distance(b, c, d))
            best = min(best, segment_distance(c, a, b), segment_distance(d, a, b))
    return best


def cross(o, a, b):
    return (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0])


def crossing(a, b, c, d):
    """Whether two segments cross properly."""
    return cross(a, b, c) * cross(a, b, d) < 0 and cross(c, d, a) * cross(c, d, b) < 0


def inside_hull(p, corners):
    """Whether a point is strictly inside a triangle of three of the corners or on its edge."""
    for a, b, c in itertools.combinations(corners, 3):
        signs = [cross(a, b, p), cross(b, c, p), cross(c, a, p)]
        if cross(a, b, c) != 0 and (all(s >= 0 for s in signs) or all(s <= 0 for s in signs)):
            return True
    return False


def one_step(following, first, number, window, allowed, clear):
    """Cells whose image is in `following` under one input, and which are allowed and clear.

    following, clear (n1, n2, nx, ny) bool; first, number (2, n); window (2, 2, n); allowed (n1, n2) bool.
    """
    n1, n2, nx, ny = following.shape
    found = []
    for i1 in range(n1):
        for i2 in range(n2):
            if not allowed[i1, i2]:
                continue
            rows = [(first[0][i1] + a) % n1 for a in range(number[0][i1])]
            columns = [(first[1][i2] + b) % n2 for b in range(number[1][i2])]
            for x in range(nx):
                for y in range(ny):
                    if clear[i1, i2, x, y] and all(
                        following[r, c, v, w]
                        for r in rows
                        for c in columns
                        for v in range(window[0][0][x], window[0][1][x] + 1)
                        for w in range(window[1][0][y], window[1][1][y] + 1)
                    ):
                        found.append((i1, i2, x, y))
    return found
