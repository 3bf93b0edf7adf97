"""Checks of the exercises of chapter 1."""

import numpy as np

from course.exercises import exercise, expect, expect_close


@exercise(
    "1.1",
    "Take the ring as a large disk less a small one, and from it a rectangle that begins at x = 0: a difference "
    "is max(a, -b).",
)
def check_gap(gap):
    """A ring with radii 0.3 and 0.6, open where x > 0 and |y| < 0.15."""
    x, y = np.random.default_rng(0).uniform(-1, 1, (2, 20_000))
    r = np.hypot(x, y)
    values = np.asarray(gap(x, y))
    expect(values.shape == x.shape, "the function is given arrays and must return one value for each point.")
    sure = (np.abs(r - 0.3) > 1e-3) & (np.abs(r - 0.6) > 1e-3) & (np.abs(np.abs(y) - 0.15) > 1e-3) & (np.abs(x) > 1e-3)
    inside = values <= 0
    opening = (x > 0) & (np.abs(y) < 0.15)
    expect(~inside[sure & (r > 0.6)], "points outside the outer circle must not be in the set: is inside negative?")
    expect(~inside[sure & (r < 0.3)], "the hole in the middle: a difference is max(a, -b).")
    body = sure & (r > 0.3) & (r < 0.6)
    expect(inside[body & ~opening], "points of the ring away from the gap must be in the set, those at x < 0 too.")
    expect(~inside[body & opening], "the gap: is it at x > 0, and is all of |y| < 0.15 open?")
    return "Its area is that of the ring less the gap's; area(grid, gap(x, y)) tells."


@exercise("1.2", "The spacing is 2 / (n - 1). Solve for n, and round up.")
def check_nodes(nodes):
    """The least n with (2 / (n - 1)) sqrt(2) / 2 <= 0.01."""
    expect(nodes > 2, "a number of nodes on each side.")
    h = 2.0 / (nodes - 1)
    expect(
        h * np.sqrt(2) / 2 <= 0.01,
        "h sqrt(n) / 2 with n = 2 axes and h = 2 / (nodes - 1) is above 0.01.",
    )
    finer = 2.0 / (nodes - 2)
    expect(finer * np.sqrt(2) / 2 > 0.01, "one node fewer would do as well.")
    expect(int(nodes) == nodes, "nodes come whole.")
    return f"In four dimensions that would be {int(nodes) ** 4:.1e} values."


def _distance_to_rectangle(x, y, centre, half_sides):
    dx, dy = np.abs(x - centre[0]) - half_sides[0], np.abs(y - centre[1]) - half_sides[1]
    return np.hypot(np.maximum(dx, 0), np.maximum(dy, 0)) + np.minimum(np.maximum(dx, dy), 0)


@exercise(
    "1.3",
    "With dx = |x - c_x| - a, and dy alike: inside max(dx, dy) counts, outside the length of (max(dx, 0), max(dy, 0)).",
)
def check_rectangle(signed_distance):
    """The signed distance to a rectangle."""
    x, y = np.random.default_rng(1).uniform(-2, 2, (2, 5000))
    centre, half = (0.3, -0.2), (0.8, 0.4)
    got, wanted = np.asarray(signed_distance(x, y, centre, half)), _distance_to_rectangle(x, y, centre, half)
    expect(got.shape == x.shape, "one value for each point.")
    dx, dy = np.abs(x - centre[0]) - half[0], np.abs(y - centre[1]) - half[1]
    inside = wanted <= 0
    expect_close(got[inside], wanted[inside], "inside, the nearest edge decides, and the value is negative.")
    beside = ~inside & ((dx <= 0) | (dy <= 0))
    expect_close(got[beside], wanted[beside], "straight out from an edge the distance is that to the edge.")
    corner = (dx > 0) & (dy > 0)
    expect_close(got[corner], wanted[corner], "beyond a corner the nearest point is the corner: a Euclidean distance.")


@exercise(
    "1.4",
    "Drop a perpendicular on the line and clip its foot to the segment before you take the distance. A segment "
    "may have no length.",
)
def check_swept(swept):
    """The signed distance to a capsule."""
    x, y = np.random.default_rng(2).uniform(-2, 2, (2, 2000))
    begin, end, radius = np.array([-0.6, -0.3]), np.array([0.6, 0.2]), 0.15
    got = np.asarray(swept(x, y, begin, end, radius))
    expect(got.shape == x.shape, "one value for each point.")
    way = (end - begin) / np.linalg.norm(end - begin)
    along = (x - begin[0]) * way[0] + (y - begin[1]) * way[1]
    beyond = (along < 0) | (along > np.linalg.norm(end - begin))
    share = np.clip(along / np.linalg.norm(end - begin), 0, 1)
    wanted = np.hypot(x - begin[0] - share * 1.2, y - begin[1] - share * 0.5) - radius
    expect_close(got[~beyond], wanted[~beyond], "beside the segment: drop a perpendicular on it.")
    expect_close(got[beyond], wanted[beyond], "beyond its ends: the nearest point of the segment is an end.")
    still = swept(x, y, begin, begin, radius)
    expect_close(still, np.hypot(x - begin[0], y - begin[1]) - radius, "a disk that stands still: begin equals end.")


@exercise("1.5")
def check_cells(surely_outside):
    """Sound and sharp: the least value in a cell is (a0 + a1 - h) / 2."""
    rng = np.random.default_rng(3)
    for h in (0.1, 0.5):
        zeros = np.sort(rng.uniform(0, 20, 12))
        nodes = np.arange(0, 20, h)
        values = np.min(np.abs(nodes[:, None] - zeros), axis=1) - 0.02
        said = np.asarray(surely_outside(values, h))
        expect(said.shape == (len(nodes) - 1,), "n nodes have n - 1 cells between them.")
        said = said.astype(bool)
        least = (values[1:] + values[:-1] - h) / 2
        wrong = said & (least <= -1e-12)
        expect(
            ~wrong,
            "a cell was called free where a function can dip to zero between its nodes.",
        )
        missed = ~said & (least > 1e-12)
        expect(~missed, "safe, but not sharp: some cell is certainly free and you did not say so.")
    return "This is a certificate: a statement about all points of a cell from two numbers."
