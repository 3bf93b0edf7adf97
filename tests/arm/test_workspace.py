"""Arm, paths and swept distances against plain loops, dense sampling and shapely."""

import json
import math

import naive_workspace as naive
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from sdhj.arm.workspace import KINEMATICS, Arm, Circle, Disk, Line, Segment, Still, segment_distance

# Some dozen operations on numbers up to about 4 (coordinates) and 200 (angles before sin and cos).
ROUNDING = 1e-13

PATHS = {
    "still": Still((0.1, -0.2)),
    "line": Line((0.24, -0.02), (-0.1, 0.12)),
    "circle": Circle((0.0, -0.22), 0.07, 2.0, -1.0),
    "backwards": Circle((0.05, 0.1), 0.15, -7.0, 2.5),
}

coordinate = st.floats(-2.0, 2.0) | st.sampled_from([-1.0, 0.0, 0.5, 1.0])
point = st.tuples(coordinate, coordinate)
paths = st.one_of(
    st.builds(Still, point),
    st.builds(Line, point, point),
    st.builds(
        Circle,
        point,
        st.floats(0.0, 2.0) | st.sampled_from([0.5, 1.0]),
        st.floats(-20.0, 20.0) | st.sampled_from([0.0, math.pi, -math.pi / 2, 2 * math.pi]),
        st.floats(-7.0, 7.0) | st.sampled_from([0.0, math.pi / 2, -math.pi]),
    ),
)
times = st.floats(-3.0, 3.0) | st.sampled_from([0.0, 1.0])


def between(a, b):
    """The segments a-b, (M, 2) both."""
    along = np.asarray(b) - a
    length = np.hypot(*along.T)
    direction = np.where(length[:, None] > 0, along / np.where(length > 0, length, 1.0)[:, None], [1.0, 0.0])
    return Segment(np.asarray(a), direction, length)


def swept(path, a, b, t0, t1):
    return float(path.swept_distance(between([a], [b]), t0, t1)[0])


def plain(path):
    return Disk(path, 0.0).describe()["path"]


@pytest.mark.slow
@settings(max_examples=100, deadline=None, derandomize=True)
@given(path=paths, a=point, b=point, t0=times, length=st.floats(0.0, 2.0) | st.sampled_from([0.0, 1.0]))
@example(path=Circle((0.0, 0.0), 1.0, 2 * math.pi, 0.0), a=(0.0, 0.0), b=(0.0, 0.0), t0=0.0, length=1.0)  # at centre
@example(path=Circle((0.0, 0.0), 1.0, 1.0, 0.0), a=(-1.0, 1.0), b=(1.0, 1.0), t0=0.0, length=2.0)  # tangent
@example(path=Line((0.0, 0.0), (1.0, 0.0)), a=(0.5, 0.0), b=(2.0, 0.0), t0=0.0, length=1.0)  # collinear, overlapping
@example(path=Line((0.0, 0.0), (0.0, 0.0)), a=(1.0, -1.0), b=(1.0, 1.0), t0=0.0, length=1.0)  # not moving
def test_swept_distance_is_the_infimum_over_time(path, a, b, t0, length):
    """Never larger than any sample, and smaller than the least of them by at most speed * half a gap."""
    samples = 1001
    least = naive.sampled_distance(a, b, plain(path), t0, t0 + length, samples)
    exact = swept(path, a, b, t0, t0 + length)
    assert exact <= least + ROUNDING
    assert exact >= least - path.speed * length / (samples - 1) / 2 - ROUNDING


@pytest.mark.slow
@pytest.mark.parametrize("path", PATHS.values(), ids=PATHS.keys())
def test_swept_distance_converges_to_dense_sampling(path):
    """Away from a crossing the sampling error is of second order, so it must fall far below the Lipschitz bound."""
    rng = np.random.default_rng(1)
    checked = 0
    for a, b in rng.uniform(-0.5, 0.5, (40, 2, 2)):
        least = naive.sampled_distance(a, b, plain(path), 0.3, 0.9, 4001)
        if least > 0.02:
            step = path.speed * 0.6 / 4000
            # |second derivative of the distance| <= speed**2 / distance + acceleration, at most half a step away
            rate = getattr(path, "rate", 0.0)
            second = step**2 / 8 * (1 / least + (abs(rate) / path.speed if rate else 0.0))
            assert swept(path, a, b, 0.3, 0.9) == pytest.approx(least, abs=second + ROUNDING)
            checked += 1
    assert checked >= 20


# The arc of the unit circle from 0 to 90 degrees, and segments whose nearest pair is of each kind.
QUARTER = Circle((0.0, 0.0), 1.0, math.pi / 2, 0.0)
ARC_CASES = {
    "crosses inside the range": ((0.2, 0.2), (2.0, 2.0), 0.0),
    "crosses the circle outside the range": ((-0.2, -0.2), (-2.0, -2.0), math.hypot(1.2, 0.2)),
    "foot of the perpendicular outside": ((2.0, 0.0), (0.0, 2.0), math.sqrt(2.0) - 1.0),
    "tangent": ((math.sqrt(2.0), 0.0), (0.0, math.sqrt(2.0)), 0.0),
    "inside, nearest at its end": ((0.1, 0.1), (0.3, 0.4), 0.5),
    "outside, nearest at its end": ((3.0, 4.0), (6.0, 8.0), 4.0),
    "an end of the arc and the inside of the segment": ((-1.0, 1.5), (1.0, 1.5), 0.5),
    "an end of the arc, segment beyond it": ((1.5, -1.0), (1.5, -0.5), math.hypot(0.5, 0.5)),
    "two crossings, neither in the range": ((-0.5, -2.0), (-0.5, 0.5), math.hypot(0.5, 0.5)),
    "through the centre": ((-0.5, -0.5), (0.5, 0.5), 1.0 - math.sqrt(0.5)),
    "at the centre, a point": ((0.0, 0.0), (0.0, 0.0), 1.0),
    "ends on the arc": ((0.0, 1.0), (0.0, 3.0), 0.0),
}


@pytest.mark.parametrize("name", ARC_CASES)
def test_arc_cases_by_hand(name):
    a, b, expected = ARC_CASES[name]
    backwards = Circle((0.0, 0.0), 1.0, -math.pi / 2, math.pi / 2)
    shifted = Circle((0.0, 0.0), 1.0, math.pi / 2, -40 * math.pi)
    for path in (QUARTER, backwards, shifted):
        assert swept(path, a, b, 0.0, 1.0) == pytest.approx(expected, abs=ROUNDING)
        assert swept(path, b, a, 0.0, 1.0) == pytest.approx(expected, abs=ROUNDING)


def test_an_arc_of_more_than_a_turn_is_the_circle():
    for turns in (1.0, 1.7, 12.0):
        path = Circle((0.0, 0.0), 1.0, 2 * math.pi * turns, 0.4)
        outside = math.hypot(2.0, 0.5) - 1.0
        assert swept(path, (-3.0, -0.5), (-2.0, -0.5), 0.0, 1.0) == pytest.approx(outside, abs=ROUNDING)
        assert swept(path, (0.0, 0.0), (0.0, -0.25), 0.0, 1.0) == pytest.approx(0.75, abs=ROUNDING)
        assert swept(path, (-2.0, 0.1), (2.0, 0.2), 0.0, 1.0) == pytest.approx(0.0, abs=ROUNDING)


@pytest.mark.parametrize("path", PATHS.values(), ids=PATHS.keys())
def test_an_interval_of_no_length_is_the_distance_at_that_time(path):
    arm = Arm()
    q = np.random.default_rng(2).uniform(-4.0, 4.0, (50, 2))
    assert arm.swept_distance(q, path, 0.7, 0.7) == pytest.approx(arm.distance(q, path.at(0.7)), abs=ROUNDING)


def test_segment_distances_match_shapely():
    shapely = pytest.importorskip("shapely")
    rng = np.random.default_rng(4)
    a, b, c, d = rng.uniform(-1.0, 1.0, (4, 300, 2))
    c[:20] = d[:20]  # segments that are points
    a[10:30] = b[10:30]
    expected = shapely.distance(shapely.linestrings(np.stack([a, b], 1)), shapely.linestrings(np.stack([c, d], 1)))
    assert (expected == 0.0).sum() > 20 and (expected > 0.0).sum() > 100
    assert segment_distance(between(a, b), between(c, d)) == pytest.approx(expected, abs=ROUNDING)
    expected = shapely.distance(shapely.linestrings(np.stack([a, b], 1)), shapely.points(c))
    assert between(a, b).distance(c) == pytest.approx(expected, abs=ROUNDING)
    points = Segment.point(a).distance(c), segment_distance(Segment.point(a), Segment.point(c))
    assert points == pytest.approx(np.hypot(*(a - c).T)[None].repeat(2, 0), abs=ROUNDING)


@pytest.mark.parametrize("kinematics", KINEMATICS)
def test_joints_and_distance_match_plain_loops(kinematics):
    arm = Arm((0.15, 0.11), 0.01, kinematics)
    rng = np.random.default_rng(5)
    q, points = rng.uniform(-7.0, 7.0, (200, 2)), rng.uniform(-0.4, 0.4, (200, 2))
    elbow, tip = arm.joints(q)
    each, one = arm.distance(q, points), arm.distance(q, points[0])
    for m in range(200):
        expected_elbow, expected_tip = naive.joints(*q[m], 0.15, 0.11, kinematics)
        assert elbow[m] == pytest.approx(expected_elbow, abs=ROUNDING)
        assert tip[m] == pytest.approx(expected_tip, abs=ROUNDING)
        assert each[m] == pytest.approx(naive.arm_distance(*q[m], points[m], 0.15, 0.11, kinematics), abs=ROUNDING)
        assert one[m] == pytest.approx(naive.arm_distance(*q[m], points[0], 0.15, 0.11, kinematics), abs=ROUNDING)
    assert (arm.tip(q) == tip).all()


def test_the_two_kinematics_by_hand():
    q = np.array([[math.pi / 2, -math.pi / 2], [0.0, math.pi]])
    assert Arm((0.2, 0.1)).tip(q) == pytest.approx(np.array([[0.1, 0.2], [0.1, 0.0]]), abs=ROUNDING)
    printed = Arm((0.2, 0.1), kinematics="printed")
    assert printed.tip(q) == pytest.approx(np.array([[0.0, 0.2 - 0.3], [0.2 - 0.3, 0.0]]), abs=ROUNDING)
    assert printed.joints(q)[0] == pytest.approx(Arm((0.2, 0.1)).joints(q)[0], abs=ROUNDING)


@pytest.mark.parametrize("path", PATHS.values(), ids=PATHS.keys())
def test_paths_in_time(path):
    times = np.linspace(-1.0, 2.0, 301)
    track = path.at(times)
    assert track.shape == (301, 2) and path.at(0.5).shape == (2,)
    for t, centre in zip(times, track, strict=True):
        assert centre == pytest.approx(naive.position(plain(path), t), abs=ROUNDING)
    moved = np.linalg.norm(np.diff(track, axis=0), axis=1)
    assert (moved <= path.speed * 0.01 + ROUNDING).all()
    assert moved.max() >= 0.99 * path.speed * 0.01  # the bound is not idle


@pytest.mark.parametrize("path", PATHS.values(), ids=PATHS.keys())
def test_a_disk_survives_json(path):
    disk = Disk(path, 0.1 / 3)
    assert Disk.of(json.loads(json.dumps(disk.describe()))) == disk
    assert Disk.of(disk) is disk
    assert disk.centre(0.4) == pytest.approx(path.at(0.4), abs=0.0)


@pytest.mark.parametrize("kinematics", KINEMATICS)
def test_the_outline_is_where_the_clearance_is_zero(kinematics):
    pytest.importorskip("shapely")
    arm = Arm(half_width=0.01, kinematics=kinematics)
    for q in ([0.3, 1.2], [-2.0, 3.1], [1.0, 0.0]):
        outline = arm.outline(q, arc_points=12)
        assert (outline[0] == outline[-1]).all()
        drawn = np.vstack([outline, (outline[1:] + outline[:-1]) / 2])  # the middles of the edges lie deepest
        depth = 0.01 - arm.distance(np.broadcast_to(q, drawn.shape), drawn)
        assert depth.min() >= -ROUNDING
        assert depth.max() <= 0.01 * (math.pi / 48) ** 2
    thin = Arm(half_width=0.0).outline([0.3, 1.2])
    assert thin.shape == (5, 2) and (thin[2] == Arm().tip(np.array([0.3, 1.2]))).all()


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Still((0.0, math.nan)), r"centre\[1\]"),
        (lambda: Line((0.0, 0.0), (math.inf, 0.0)), r"velocity\[0\]"),
        (lambda: Line(("a", 0.0), (0.0, 0.0)), r"start\[0\]"),
        (lambda: Circle((0.0, 0.0), -0.1, 1.0), "radius"),
        (lambda: Circle((0.0, 0.0), 0.1, math.nan), "rate"),
        (lambda: Disk(Still((0.0, 0.0)), -0.1), "radius"),
        (lambda: Disk((0.0, 0.0), 0.1), "Still, Line or Circle"),
        (lambda: Disk.of({"radius": 0.1, "path": {"kind": "spiral"}}), "of still, line, circle"),
        (lambda: Disk.of({"radius": 0.1, "path": {"kind": "still", "start": [0.0, 0.0]}}), "a disk "),
        (lambda: Disk.of(0.3), "got 0.3"),
        (lambda: Arm((0.15, 0.0)), r"lengths\[1\]"),
        (lambda: Arm(half_width=-0.01), "half_width"),
        (lambda: Arm(kinematics="scara"), "kinematics"),
        (lambda: Arm().joints(np.zeros((4, 3))), r"2\), got \(4, 3\)"),
        (lambda: Arm().distance(np.zeros((4, 2)), np.zeros((3, 2))), r"\(2,\) or \(4, 2\)"),
    ],
)
def test_bad_input_is_refused(build, message):
    with pytest.raises(ValueError, match=message):
        build()


@pytest.mark.parametrize("bad", [0, 1])
def test_a_nan_stays_one(bad):
    """It must not read as far from everything."""
    q, point = np.zeros((3, 2)), np.array([0.1, 0.1])
    q[1, bad] = np.nan
    assert np.isnan(Arm().distance(q, point)).tolist() == [False, True, False]
    point[bad] = np.nan
    assert np.isnan(Arm().distance(np.zeros((1, 2)), point)).all()
