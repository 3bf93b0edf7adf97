"""Where the links are for all joint angles of a box, and which cells they touch, against samples and distances."""

import itertools

import naive_certified as naive
import numpy as np
import pytest

from sdhj.kernels.arm import links

pytestmark = pytest.mark.slow  # the arm's own kernels are compiled

ARM = np.array([0.15, 0.15, 1.0])
PRINTED = np.array([0.15, 0.30, 0.0])


@pytest.mark.parametrize("arm", [ARM, PRINTED], ids=["relative", "printed"])
def test_hulls_hold_the_links(arm, rng):
    """Points of the links at random joint angles of a box lie in the hull thickened by the remainder, and need it."""
    needed, room = 0.0, links.allocate_scratch()
    for _ in range(40):
        low, width = rng.uniform(-4, 4, 2), rng.uniform(0.0, 0.4, 2)
        ends = np.empty((2, 6))
        for axis in range(2):
            links.joint_ends(low[axis], low[axis] + width[axis], 0.0, 0.0, 0.0, 0.0, ends[axis])
        for link in range(2):
            n, remainder = links.link_points(link, ends[0], ends[1], arm, room)
            size = links.convex_hull(n, room)
            for q1, q2, s in itertools.product(*(np.linspace(low, low + width, 5).T), (0.0, 0.6, 1.0)):
                elbow, tip = naive.elbow_and_tip(q1, q2, arm)
                a, b = ((0.0, 0.0), elbow) if link == 0 else (elbow, tip)
                point = (a[0] + s * (b[0] - a[0]), a[1] + s * (b[1] - a[1]))
                off = links.hull_distance(*point, size, room)
                assert off <= remainder + 1e-12  # rounding of a few sums of numbers below one
                needed = max(needed, off / max(remainder, 1e-300))
    assert needed > 0.5  # the remainder is no larger than it has to be by a factor of two


def cells_touched(points, radius, growth, agent):
    room, block = links.allocate_scratch(), np.zeros(-(-agent.nx * agent.ny // 64), np.uint64)
    room.x[: len(points)], room.y[: len(points)] = points.T
    size = links.convex_hull(len(points), room)
    links.touch_cells(size, radius, growth, agent, (0, agent.nx), room, block)
    return naive.unpacked(block[None], (agent.nx, agent.ny))[0]


@pytest.mark.slow
def test_pursuer_is_met_wherever_it_can_meet(rng):
    """The cells that touch a thick hull are those whose distance to it says so, for hulls of any kind of points."""
    for trial in range(120):
        points = rng.normal(size=(rng.integers(1, 7), 2)) * 0.15
        if trial % 3 == 0:
            points = points.round(1)  # many on one line, or equal
        shape = tuple(int(n) for n in rng.integers(4, 9, 2))
        plane = (-0.36, -0.36, 0.72 / shape[0], 0.72 / shape[1])
        radius, growth = rng.uniform(0.02, 0.1), rng.choice([0.0, 0.013])
        found = cells_touched(points, radius, growth, links.Agent(0.0, 0.0, 0.0, *plane, *shape))
        for i, k in itertools.product(range(shape[0]), range(shape[1])):
            x0, y0 = plane[0] + i * plane[2] - growth, plane[1] + k * plane[3] - growth
            box = (x0, y0, x0 + plane[2] + 2 * growth, y0 + plane[3] + 2 * growth)
            distance = naive.box_polygon_distance(box, [tuple(p) for p in points])
            if abs(distance - radius) > 1e-9:  # nearer than that, rounding may decide
                assert found[i, k] == (distance < radius)
