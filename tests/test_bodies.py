"""Bodies: signed distances against plain loops, fences, poses, covers of disks; and a robot that turns out of a corridor."""

import naive_bodies as naive
import numpy as np
import pytest
import shapely
from naive_maps import to_polygon

import sdhj
from sdhj import Body, UnsafeSet
from sdhj.problem.bodies import body_level_set

ROBOT = [[-0.3, -0.25], [0.9, -0.25], [0.9, 0.25], [-0.3, 0.25]]
SHAPES = {
    "point": [[0.2, -0.1]],
    "segment": [[-0.3, 0.1], [0.5, 0.2]],
    "rectangle": ROBOT,
    "needle": [[0.0, 0.0], [1.4, 0.05], [1.4, 0.1]],
    "hexagon": [[np.cos(a), 0.6 * np.sin(a)] for a in np.arange(6) * np.pi / 3],
}


def states(rng, count):
    return np.stack([*rng.uniform(-1.7, 1.7, (2, count)), rng.uniform(-np.pi, np.pi, count)], axis=1)


@pytest.mark.parametrize("robot", SHAPES)
@pytest.mark.parametrize("obstacle", SHAPES)
def test_convex_bodies_have_the_signed_distance_of_plain_loops(robot, obstacle):
    """Inside and out: that of the origin to all differences of their points; less both radii."""
    rng = np.random.default_rng(0)
    place, q = (0.3, -0.2, 0.4), states(rng, 150)
    body = Body(SHAPES[robot], radius=0.02)
    other = Body(SHAPES[obstacle], radius=0.05, pose=lambda p, t: place)
    part = UnsafeSet((0, 1, 2), body_level_set([body], other.parts, other))
    still = naive.placed(SHAPES[obstacle], *place)
    expected = [naive.of_convex(naive.placed(SHAPES[robot], *one), still) - 0.07 for one in q.tolist()]
    np.testing.assert_allclose(part.level_set(q, 0.0), expected, rtol=0, atol=1e-9)
