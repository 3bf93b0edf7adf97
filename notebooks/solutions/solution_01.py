"""Solutions of chapter 1, and answers that its checks refuse."""

import numpy as np
from course.chapter_01 import check_cells, check_gap, check_nodes, check_rectangle, check_swept


def gap(x, y):
    """The large disk without the small one, without a rectangle that begins on the y axis."""
    ring = np.maximum(np.hypot(x, y) - 0.6, 0.3 - np.hypot(x, y))
    opening = np.maximum(np.abs(x - 0.5) - 0.5, np.abs(y) - 0.15)
    return np.maximum(ring, -opening)


# h sqrt(2) / 2 <= 0.01 with h = 2 / (n - 1)
nodes_needed = int(np.ceil(np.sqrt(2) / 0.01)) + 1


def signed_distance(x, y, centre, half_sides):
    """Outside, only the coordinates that stick out count, and they count together."""
    dx, dy = np.abs(x - centre[0]) - half_sides[0], np.abs(y - centre[1]) - half_sides[1]
    return np.hypot(np.maximum(dx, 0), np.maximum(dy, 0)) + np.minimum(np.maximum(dx, dy), 0)


def swept(x, y, begin, end, radius):
    """The nearest point of the segment: the perpendicular's foot, kept between the ends."""
    way = np.asarray(end, dtype=float) - begin
    length = way @ way
    along = (x - begin[0]) * way[0] + (y - begin[1]) * way[1]
    share = np.clip(along / length, 0, 1) if length > 0 else np.zeros_like(x)
    return np.hypot(x - begin[0] - share * way[0], y - begin[1] - share * way[1]) - radius


def surely_outside(values, h):
    """Falling with slope 1 from both nodes, the function is least where the two lines meet: (a0 + a1 - h) / 2."""
    return (values[:-1] + values[1:] - h) / 2 > 0


RIGHT = {
    check_gap: gap,
    check_nodes: nodes_needed,
    check_rectangle: signed_distance,
    check_swept: swept,
    check_cells: surely_outside,
}


def _ring(x, y):
    return np.maximum(np.hypot(x, y) - 0.6, 0.3 - np.hypot(x, y))


WRONG = {
    check_gap: [
        _ring,  # no gap
        lambda x, y: np.maximum(_ring(x, y), 0.15 - np.abs(y)),  # a gap on either side
        lambda x, y: -gap(x, y),  # inside out
        lambda x, y: np.maximum(np.hypot(x, y) - 0.6, np.hypot(x, y) - 0.3),  # intersection for difference
    ],
    check_nodes: [142, 201, 100],  # one spacing short; twice too many; the bound of one dimension
    check_rectangle: [
        lambda x, y, c, s: np.maximum(np.abs(x - c[0]) - s[0], np.abs(y - c[1]) - s[1]),  # box itself
        lambda x, y, c, s: np.hypot(np.maximum(np.abs(x - c[0]) - s[0], 0), np.maximum(np.abs(y - c[1]) - s[1], 0)),
    ],
    check_swept: [
        lambda x, y, b, e, r: np.minimum.reduce(
            [np.hypot(x - b[0] - t * (e[0] - b[0]), y - b[1] - t * (e[1] - b[1])) - r for t in np.linspace(0, 1, 20)]
        ),  # samples
        lambda x, y, b, e, r: (
            np.abs((x - b[0]) * (e[1] - b[1]) - (y - b[1]) * (e[0] - b[0])) / max(np.hypot(*(e - b)), 1e-9) - r
        ),  # the whole line
    ],
    check_cells: [
        lambda values, h: np.minimum(values[:-1], values[1:]) > 0,  # looks at the nodes alone
        lambda values, h: np.minimum(values[:-1], values[1:]) > h,  # safe and too careful
        lambda values, h: np.minimum(values[:-1], values[1:]) > h / 2,  # safe, and nearly sharp
        lambda values, h: values > 0,  # nodes, not cells
    ],
}
