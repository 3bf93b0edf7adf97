"""Bodies: distances against plain loops, fences, poses, covers of disks; a robot that turns out of a corridor."""

from itertools import combinations_with_replacement

import naive_bodies as naive
import numpy as np
import pytest
import shapely
import zoo
from naive_maps import to_polygon
from parameters import but_slow

import sdhj
from sdhj import Body, UnsafeSet
from sdhj.problem.shapes.bodies import body_level_set, covering_disks

ROBOT = [[-0.3, -0.25], [0.9, -0.25], [0.9, 0.25], [-0.3, 0.25]]
SHAPES = {
    "point": [[0.2, -0.1]],
    "segment": [[-0.3, 0.1], [0.5, 0.2]],
    "rectangle": ROBOT,
    "needle": [[0.0, 0.0], [1.4, 0.05], [1.4, 0.1]],
    "hexagon": [[np.cos(a), 0.6 * np.sin(a)] for a in np.arange(6) * np.pi / 3],
}


turns = np.linspace(0, 2 * np.pi, 60)


def states(rng, count):
    return np.stack([*rng.uniform(-1.7, 1.7, (2, count)), rng.uniform(-np.pi, np.pi, count)], axis=1)


@pytest.mark.parametrize(("robot", "obstacle"), combinations_with_replacement(SHAPES, 2))
def test_convex_bodies_have_the_signed_distance_of_plain_loops(robot, obstacle):
    """Inside and out: that of the origin to all differences of their points; less both radii."""
    rng = np.random.default_rng(0)
    place, q = (0.3, -0.2, 0.4), states(rng, 60)
    body = Body(SHAPES[robot], radius=0.02)
    other = Body(SHAPES[obstacle], radius=0.05, pose=lambda p, t: place)
    part = UnsafeSet((0, 1, 2), body_level_set([body], other.parts, other))
    still = naive.placed(SHAPES[obstacle], *place)
    expected = [naive.of_convex(naive.placed(SHAPES[robot], *one), still) - 0.07 for one in q.tolist()]
    np.testing.assert_allclose(part.level_set(q, 0.0), expected, rtol=0, atol=1e-9)


def outlines(rng):
    """A simple polygon that is not convex: a star about the origin."""
    angles = np.sort(rng.uniform(-np.pi, np.pi, 7)) + np.arange(7) * 1e-3
    return np.stack([np.cos(angles), np.sin(angles)], axis=1) * rng.uniform(0.3, 1.2, (7, 1))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_any_polygons_are_apart_by_what_plain_loops_say(seed):
    """The sign everywhere, and the distance outside; a fence is touched by whatever sticks out of it."""
    rng = np.random.default_rng(seed)
    robot, obstacle = 0.5 * outlines(rng), outlines(rng)
    q = states(rng, 150)
    part = UnsafeSet.polygon(obstacle, (0, 1, 2), footprint=robot)
    fence = UnsafeSet.polygon(obstacle, (0, 1, 2), footprint=robot, outside=True)
    found, beyond = part.level_set(q, 0.0), fence.level_set(q * [0.3, 0.3, 1.0], 0.0)
    inner = shapely.Polygon(obstacle)
    for one, value, fenced in zip(q.tolist(), found, beyond, strict=True):
        apart = naive.apart(naive.placed(robot.tolist(), *one), obstacle.tolist())
        assert abs(value - apart) < 1e-9 if apart > 0 else value <= 1e-9
        shape = shapely.Polygon(naive.placed(robot.tolist(), 0.3 * one[0], 0.3 * one[1], one[2]))
        room = shape.distance(inner.exterior) if inner.contains(shape) else 0.0
        assert abs(fenced - room) < 1e-9 if room > 0 else fenced <= 1e-9


def test_a_fence_for_a_point_is_the_complement_of_its_polygon():
    rng = np.random.default_rng(0)
    vertices = outlines(rng)
    q = rng.uniform(-1.3, 1.3, (200, 2))
    found = UnsafeSet.polygon(vertices, outside=True, radius=0.1).level_set(q, 0.0)
    expected = np.array([-to_polygon(*one, vertices.tolist()) for one in q.tolist()])
    assert (found[expected < 0] <= -0.1).all()
    np.testing.assert_allclose(found[expected > 0], expected[expected > 0] - 0.1, rtol=0, atol=1e-9)


def test_disks_and_boxes():
    q = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.5], [1.5, 0.2, 2.0]])
    disk = UnsafeSet.disk([1.0, 0.5], 0.2)
    np.testing.assert_allclose(disk.level_set(q[:, :2], 0.0), np.hypot(q[:, 0] - 1, q[:, 1] - 0.5) - 0.2, atol=1e-12)
    box = UnsafeSet.box([1.0, -1.0], [2.0, 1.0], (0, 1, 2), footprint=ROBOT)
    corners = [[1.0, -1.0], [2.0, -1.0], [2.0, 1.0], [1.0, 1.0]]
    expected = [naive.of_convex(naive.placed(ROBOT, *one), [tuple(c) for c in corners]) for one in q.tolist()]
    np.testing.assert_allclose(box.level_set(q, 0.0), expected, atol=1e-9)


def test_what_moves_is_swept():
    """A disk that drives past a robot that stands: the bounds over an interval hold at all times within it."""
    disk = UnsafeSet.disk([0.0, 0.0], 0.2, (0, 1, 2), footprint=ROBOT, pose=lambda q, t: (1.5 * t - 1.0, 0.6, 0.0))
    q, times = states(np.random.default_rng(0), 60), np.linspace(0.2, 0.7, 41)
    swept, each = disk.over(q, 0.2, 0.7, "swept"), np.array([disk.level_set(q, t) for t in times])
    assert disk.moving and (swept <= each.min(axis=0) + 1e-12).all()
    assert (swept >= each.min(axis=0) - 0.06).all()  # a piece of 1/38 s, of 1.5 m/s, and what a sample misses
    expected = [naive.of_convex(naive.placed(ROBOT, *one), [(-0.25, 0.6)]) - 0.2 for one in q.tolist()]
    np.testing.assert_allclose(disk.level_set(q, 0.5), expected, atol=1e-9)


@pytest.mark.parametrize("tolerance", but_slow([0.1, 0.03], 0.03))
@pytest.mark.parametrize(
    "shape", [ROBOT, SHAPES["segment"], [[0, 0], [0.8, 0], [0.8, 0.3], [0.3, 0.3], [0.3, 0.9], [0, 0.9]]]
)
def test_disks_cover_a_body_and_reach_no_farther_than_allowed(shape, tolerance):
    disks, rng = covering_disks(Body(shape), tolerance), np.random.default_rng(0)
    body = shapely.Polygon(shape) if len(shape) > 2 else shapely.LineString(shape)
    union = shapely.union_all([shapely.Point(x, y).buffer(r, quad_segs=256) for x, y, r in disks])
    assert body.difference(union).area < 1e-12 and body.difference(union).length < 1e-12
    around = disks[:, None, :2] + disks[:, None, 2:] * np.stack([np.cos(turns), np.sin(turns)], axis=-1)[None]
    assert shapely.distance(body, shapely.points(around.reshape(-1, 2))).max() <= tolerance + 1e-9
    inside = rng.uniform(-1, 1, (400, 2))
    inside = inside[shapely.contains_xy(body, *inside.T)]
    assert (np.hypot(*(inside[:, None] - disks[:, :2]).transpose(2, 0, 1)) <= disks[:, 2]).any(axis=1).all()


@pytest.mark.slow
def test_a_footprint_on_a_map_is_seen_whole_and_not_much_larger():
    """<= 0 wherever the robot meets a blocked pixel; below the truth by the tolerance and half a diagonal at most."""
    rng, side, origin = np.random.default_rng(0), 0.1, (-1.0, 0.5, 0.4)
    blocked = rng.random((20, 30)) < 0.02
    part = UnsafeSet.from_map(blocked, (0, 1, 2), resolution=side, origin=origin, footprint=ROBOT, tolerance=0.03)
    local = np.stack([rng.uniform(0, 3, 200), rng.uniform(0, 2, 200), rng.uniform(-3, 3, 200)], axis=1)
    c, s = np.cos(0.4), np.sin(0.4)
    q = np.stack([c * local[:, 0] - s * local[:, 1] - 1, s * local[:, 0] + c * local[:, 1] + 0.5, local[:, 2] + 0.4], 1)
    rows, columns = np.nonzero(blocked[::-1])
    full = shapely.union_all(shapely.box(columns * side, rows * side, columns * side + side, rows * side + side))
    room = shapely.box(0, 0, 3, 2)
    for one, value in zip(local.tolist(), part.level_set(q, 0.0), strict=True):
        robot = shapely.Polygon(naive.placed(ROBOT, *one))
        truth = min(robot.distance(full), robot.distance(room.exterior)) if room.contains(robot) else 0.0
        assert value <= max(truth, 0.0) and (truth == 0.0 or value >= truth - 0.03 - side * np.sqrt(2) / 2 - 1e-9)


def test_what_is_no_footprint_is_refused():
    with pytest.raises(ValueError, match="needs three axes"):
        UnsafeSet.box([0, 0], [1, 1], footprint=ROBOT)
    with pytest.raises(ValueError, match="x, y and heading"):
        UnsafeSet.disk([0, 0], 1, footprint=Body(ROBOT, pose=lambda q, t: q[:, 0]))
    with pytest.raises(ValueError, match="allow a greater tolerance"):
        covering_disks(Body(ROBOT), 1e-4)
    with pytest.raises(ValueError, match="lower must be below"):
        UnsafeSet.box([0, 0], [0, 1])
    with pytest.raises(ValueError, match="whose edges do not"):
        Body([[0, 0], [1, 1], [1, 0], [0, 1]])
    still = UnsafeSet.box([0, 0], [1, 1], footprint=Body(ROBOT, pose=lambda q, t: (q[:, 0], q[:, 1], 0.0)))
    assert still.level_set([[-0.95, 0.5]], 0.0).round(9).tolist() == [0.05]  # as the error advises


def corridor():
    """A robot of 1.2 m by .5 m, its wheels .3 m behind its middle, in a corridor of 1 m that opens into a room."""
    room = [[0, 1], [3, 1], [3, 0], [6, 0], [6, 3], [3, 3], [3, 2], [0, 2]]

    def goal(q, t):  # in the corridor, looking out
        ahead = 1.5 * (np.cos(0.35) - np.cos(q[:, 2]))
        return np.maximum(np.maximum(np.abs(q[:, 0] - 1.2) - 0.4, np.abs(q[:, 1] - 1.5) - 0.15), ahead)

    return zoo.car(
        [(v, w) for v in (-0.5, 0.0, 0.5) for w in (-0.8, 0.0, 0.8)],
        0.01,
        **{"lower": [0, 0, -np.pi], "upper": [6, 3, np.pi], "nodes": (61, 31, 48)},
        target=sdhj.TargetSet((0, 1, 2), goal),
        unsafe=[UnsafeSet.polygon(room, (0, 1, 2), footprint=ROBOT, outside=True, name="walls")],
        delta=0.4,
        steps=None,
    ), shapely.Polygon(room)


@pytest.mark.slow
def test_a_long_robot_turns_out_of_a_corridor():
    """Proved from where it looks at the corridor's end; in exact geometry none of 1,000 runs touches a wall."""
    problem, room = corridor()
    table = sdhj.solve(problem, sdhj.Certified(cells=(179, 210, 79)), play=False)
    start = np.array([1.0, 1.5, np.pi - 1e-6])
    assert table.fraction() >= 0.19 and table.contains(start[None])[0]
    rng, controller = np.random.default_rng(0), sdhj.Controller(table)
    q = rng.uniform([0, 0, -np.pi], [6, 3, np.pi], (20_000, 3))
    q = np.concatenate([start[None], q[table.contains(q)][:999]])
    alive = np.ones(len(q), bool)
    for _ in range(table.steps):
        alive &= problem.target.level_set(q, 0.0) > 0
        u = problem.inputs[controller.choose(controller.batch(q[alive], 0))]
        v = rng.choice([-0.01, 0.01], (alive.sum(), 2))
        for _ in range(8):
            one = q[alive]
            for _ in range(5):
                drift = np.stack(
                    [u[:, 0] * np.cos(one[:, 2]) + v[:, 0], u[:, 0] * np.sin(one[:, 2]) + v[:, 1], u[:, 1]], 1
                )
                one = one + 0.01 * drift
            q[alive] = one
            c, s = np.cos(one[:, 2:]), np.sin(one[:, 2:])
            x, y = np.array(ROBOT).T
            there = np.stack([one[:, :1] + c * x - s * y, one[:, 1:2] + s * x + c * y], axis=2)
            assert shapely.contains(room, shapely.polygons(there)).all()
    assert not alive.any()
