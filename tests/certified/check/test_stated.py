"""What the checker reads of a robot: robots of all kinds are proved, forged tables of numbers refused."""

import json
import re
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import zoo
from forged_robots import file_of, hidden, line, plane, ring, veering
from forging import FORGERIES, forged, replaced

import sdhj
from sdhj.certified.check import verify
from sdhj.certified.check.sampled import InMemory
from sdhj.certified.check.stated import BlackBox, Problem, shortened
from sdhj.problem.describing import arrays_of
from sdhj.table.files import make_head


def mixed(q, u, v, t):
    return np.stack([u[0] + np.sin(v[1]) + 0.0 * q[:, 0], q[:, 0] + t * v[0]], axis=1)


LINE = """\
the state, 1 numbers:
  {axis}
3 intervals of 0.5 s{sensed}
3 inputs:
  u0 = (-1)
  u1 = (0)
  u2 = (1)
velocities, drift + gain v with |v| <= bounds:
  |v1| <= 0.2
  dx1/dt: drift -1.0    [u0]
  dx1/dt: drift 0.0    [u1]
  dx1/dt: drift 1.0    [u2]
  dx1/dt: v1 * 1.0
target, target:
  abs(x1) - 1.0 <= 0
{sets}"""
CLOSED = "x1 from -3.14159265 to 3.14159265, closes"
USUAL = {"axis": "x1 from -4 to 4, ends: unsafe, unsafe", "sensed": ""}
MEASURED = "\nmeasured up to 0.012345, late by {:g} s, a clock off by {:g} s; {}"
FORBIDDEN = "unsafe under u2, unsafe:\n  abs(x1 + 2.0) - 0.3 <= 0\nunsafe under u0, u2, unsafe:\n  abs(x1) - 0.3 <= 0"
POSTS = "unsafe, post -3:\n  abs(x1 - (-3.0)) - 0.05 <= 0\nunsafe, post 3:\n  abs(x1 - 3.0) - 0.05 <= 0"
SEAM = "unsafe, behind the seam:\n  x1 - (-3.0) <= 0\nunsafe, before the seam:\n  3.0 - x1 <= 0"
OPAQUE = "a black box, of which what its author states is believed"
PRINTED = {  # what is printed of a problem: all of it
    "forbidden": (
        lambda: line(
            unsafe=[
                sdhj.UnsafeSet((0,), lambda p, t: np.abs(p[:, 0] + 2.0) - 0.3, inputs=[2]),
                sdhj.UnsafeSet((0,), lambda p, t: np.abs(p[:, 0]) - 0.3, inputs=[0, 2]),
            ]
        ),
        LINE.format(**USUAL, sets=FORBIDDEN),
    ),
    "a wall that is a black box": (hidden, LINE.format(**USUAL, sets=f"unsafe, wall:\n  {OPAQUE}")),
    "measured": (
        lambda: line(sensing=sdhj.Sensing(0.012345, 0.1, 0.05, memory=False)),
        LINE.format(**USUAL | {"sensed": MEASURED.format(0.1, 0.05, "does not remember")}, sets=POSTS),
    ),
    "remembered": (
        lambda: replace(ring(), sensing=sdhj.Sensing(0.012345), delta=0.5),
        LINE.format(axis=CLOSED, sensed=MEASURED.format(0, 0, "remembers"), sets=SEAM),
    ),
    "gains that are sums, late and without a target": (
        lambda: replace(veering(), target=None, delta=0.123456, sensing=sdhj.Sensing(0.0, 0.1, memory=False)),
        """\
the state, 2 numbers:
  x1 from -1 to 1, ends: wall, wall
  x2 from -1 to 1, ends: unsafe, unsafe
2 intervals of 0.123456 s
measured up to 0, 0, late by 0.1 s, a clock off by 0 s; does not remember
2 inputs:
  u0 = (-1)
  u1 = (1)
velocities, drift + gain v with |v| <= bounds:
  |v1| <= 0.5
  |v2| <= 0.5
  dx1/dt: drift -1.0    [u0]
  dx1/dt: drift 1.0    [u1]
  dx2/dt: drift 0.0
  dx1/dt: v1 * 0.1
  dx1/dt: v2 * 0.0
  dx2/dt: v1 * 0.0
  dx2/dt: v2 * (0.2 + 0.1 * x1)""",
    ),
    "not linear, with names, and a set on the second axis": (
        lambda: replace(
            plane(drift=None, gain=None, velocity=mixed),
            grid=sdhj.Grid([-2.0, -3.0], [2.0, 3.0], [21, 21], [False, True], ends="wall", names=["east", "n\n"]),
            unsafe=[sdhj.UnsafeSet((1,), lambda p, t: np.abs(e := np.sin(p[:, 0] + t)) + e, name=100 * "a" + "b")],
        ),
        f"""\
the state, 2 numbers:
  east from -2 to 2, ends: wall, wall
  n\\n from -3 to 3, closes
3 intervals of 0.25 s
4 inputs:
  u0 = (1, 0)
  u1 = (-1, 0)
  u2 = (0, 1)
  u3 = (0, -1)
velocities, with |v| <= bounds:
  |v1| <= 0.1
  |v2| <= 0.1
  e1 = sin(v2)
  deast/dt: velocity 1.0 + e1    [u0]
  deast/dt: velocity -1.0 + e1    [u1]
  deast/dt: velocity e1    [u2 to u3]
  dn\\n/dt: velocity east + t * v1
target, target:
  hypot(east - 1.0, n\\n) - 0.5 <= 0
unsafe, {100 * "a"}:
  e1 = sin(n\\n + t)
  abs(e1) + e1 <= 0""",
    ),
    "more lines than are shown, and a black box": (
        lambda: line(
            dynamics=sdhj.Dynamics(
                [[float(u)] for u in range(45)],
                sdhj.BlackBox(lambda q, u, t: u + 0.0 * q, slope=0.0, rate=0.0),
                lambda q, u: np.full((len(q), 1, 1), u[0]),
                [0.2],
            )
        ),
        "\n".join(
            [
                "the state, 1 numbers:",
                "  x1 from -4 to 4, ends: unsafe, unsafe",
                "3 intervals of 0.5 s",
                "45 inputs:",
                *(f"  u{j} = ({j})" for j in range(40)),
                "  and 5 lines more",
                "velocities, drift + gain v with |v| <= bounds:",
                "  |v1| <= 0.2",
                f"  drift: {OPAQUE}",
                *(f"  dx1/dt: v1 * {j}.0    [u{j}]" for j in range(40)),
                "  and 5 lines more",
                "target, target:",
                "  abs(x1) - 1.0 <= 0",
                POSTS,
            ]
        ),
    ),
}


@pytest.mark.parametrize("name", PRINTED)
def test_a_problem_is_printed_as_it_was_read(name):
    problem, text = PRINTED[name]
    problem = problem()
    head = json.loads(json.dumps(make_head(problem, "certified", {}, problem.digest)))
    assert str(Problem(head, InMemory(arrays_of(problem)), problem)) == text


def test_as_many_lines_are_printed_as_there_is_room_for():
    assert shortened(["a"] * 40) == ["  a"] * 40
    assert shortened(["a"] * 41) == ["  a"] * 40 + ["  and 1 lines more"]


@pytest.mark.parametrize("forgery", [name for name in FORGERIES if name != "too short"])
def test_a_forged_table_is_refused(forgery, tmp_path):
    (path := tmp_path / "forged.npz").write_bytes(file_of("windy"))
    with forged(path, named=True) as parts:
        replaced("tables/0", FORGERIES[forgery])(*parts)
    if forgery == "too long":  # a table of another robot
        verify(path, samples=10, progress=False)
        return
    with pytest.raises(ValueError, match=r"make no sense"):
        verify(path, progress=False)


@pytest.mark.parametrize("push", [5.0, 40.0])
def test_a_strong_push_is_widened_by_its_own_roundings(push, tmp_path):
    """Moves that are right to the last cell are proved, however far an interval pushes: the product rounds once."""
    problem = zoo.cart(
        grid=sdhj.Grid([-1, -1], [1, 1], [11, 11]),
        dynamics=sdhj.Dynamics(
            [[0.0]], lambda q, u: np.stack([q[:, 1] + u[0], 0 * q[:, 1]], 1), [[0.0], [1.0]], [push]
        ),
        target=zoo.goal(0.0, 0.5),
        delta=0.3,
        steps=1,
    )
    sdhj.solve(problem, sdhj.Certified(cells=(10, 10)), progress=False, play=False).save(tmp_path / "pushed.npz")
    assert (verdict := verify(tmp_path / "pushed.npz", progress=False)).ok, str(verdict)


@pytest.mark.parametrize("when", [0.0, 1.0, None])
def test_what_is_stated_of_a_black_box_is_tried_at_either_end_of_the_times(when):
    """A wall that is half a metre nearer at one instant, of which its author says that it hardly moves."""
    wall = sdhj.BlackBox(lambda p, t: p[:, 0] - (0.5 if t == when else 0.0), slope=1.0, rate=0.1)
    low, high = np.zeros((3, 1)), np.full((3, 1), 0.2)
    with pytest.raises(ValueError, match="wall") if when is not None else nullcontext():
        least, most = BlackBox("wall", wall, 1, 1).bounds(low, high, (0.0, 1.0))
        assert (least <= -0.05).all() and (most >= 0.25).all()


class Declared(SimpleNamespace):
    """A function and what is declared of it, as the checker asks for both."""

    def __call__(self, *given):
        return self.function(*given)


def test_values_of_a_black_box_are_widened_by_slope_rate_and_rounding():
    """Of a gain of two axes and two components, whose lines differ: about the middle, by hand."""
    low, high, times = np.array([[1.0, -2.0], [0.0, 5.0]]), np.array([[1.5, -1.0], [0.0, 5.0]]), (2.0, 2.5)
    slope, rate = [[1.0, 2.0], [0.0, 3.0]], [0.5, 0.25]

    def gain(q, u, t):
        return np.stack([q[:, 0] - 0.5 * t, u[0] - q[:, 1], 0.0 * q[:, 0], q[:, 1] - 5.0], axis=1).reshape(-1, 2, 2)

    given = Declared(function=gain, slope=slope, rate=rate, enclosure=None)
    found = BlackBox("gain", given, 4, 2, (np.array([4.0]),)).bounds(low, high, times)
    middle = np.array([[1.25 - 1.125, 4.0 + 1.5, 0.0, -6.5], [-1.125, -1.0, 0.0, 0.0]])
    half = np.array([[1.25 + 0.125] * 2 + [1.5 + 0.0625] * 2, [0.125] * 2 + [0.0625] * 2])
    # what there may be from zero on: |slope| of the middle, and the rate for all the time
    far = [[1.25 + 3.0 + 1.125] * 2 + [4.5 + 0.5625] * 2, [10.0 + 1.125] * 2 + [15.0 + 0.5625] * 2]
    size = np.abs(middle) + np.array(far)
    for end, own in zip((-1, 1), found, strict=True):
        more = end * (own - middle) - half
        assert (more > 0.9e-9 * size).all() and (more < 1.1e-9 * (size + half)).all(), (end, more / size)


def test_a_number_as_slope_is_of_all_axes_and_a_time_needs_no_rate():
    low, high = np.array([[0.0, 0.0]]), np.array([[6.0, 8.0]])
    level = BlackBox("wall", sdhj.BlackBox(lambda p, t: p[:, 0], slope=1.0), 1, 1)
    least, most = level.bounds(low, high, (1.0, 1.0))
    np.testing.assert_allclose([least, most], [[[3.0 - 5.0]], [[3.0 + 5.0]]], atol=1e-7)
    assert level.reads("x", 7) and level.reads("p")
    assert not BlackBox("wall", sdhj.BlackBox(lambda p, t: p[:, 0], slope=1.0, rate=[0.0]), 1, 1).reads("p")
    with pytest.raises(ValueError, match="a slope and a rate"):
        level.bounds(low, high, (1.0, 2.0))


@pytest.mark.parametrize(
    "given",
    [
        {"slope": 1e308, "rate": 0.0},
        {"enclosure": lambda low, high, *times: (np.full(len(low), -np.inf), high[:, 0])},
        {"enclosure": lambda low, high, *times: (low[:, 0], np.full(len(low), np.nan))},
    ],
)
def test_of_a_black_box_without_finite_bounds_nothing_is_known(given):
    with np.errstate(all="ignore"):
        found = BlackBox("wall", sdhj.BlackBox(lambda p, t: p[:, 0], **given), 1, 1).bounds(
            np.zeros((1, 1)), np.full((1, 1), 9.0), (0.0, 1.0)
        )
    assert np.isnan(found).all()


@pytest.mark.parametrize("result", [0, 1])
def test_one_false_value_of_a_black_box_is_named_with_its_place(result):
    """In the second of three boxes, of one of two results."""
    low = np.array([[0.0], [1.0], [0.0]])

    def drift(q, u, t):
        return np.stack([3.0 * q[:, 0] if k == result else 0.0 * q[:, 0] for k in range(2)], axis=1)

    given = Declared(function=drift, enclosure=lambda low, *_: (np.full((3, 2), -1.0), np.full((3, 2), 1.0)))
    with pytest.raises(ValueError, match="black box drift must hold") as refused:
        BlackBox("drift", given, 2, 2, (np.zeros(1),)).bounds(low, low + 0.1, (0.5, 0.5))
    place, values = re.search(r"at 0.5 s and \[\[(.*)\]\], got \[\[(.*)\]\]", str(refused.value)).groups()
    assert 1.0 <= float(place) <= 1.1
    assert [*map(float, values.split(", "))] == [3.0 * float(place) * (k == result) for k in range(2)]


def driven(second=0.0, gain=(1.0, 0.0, 0.0, 1.0)):
    """A robot in the plane: dx = u + gain v, dy = second + gain v, where all may be functions of q and t."""

    def of(one, q, t=0.0):
        return one(q, t) if callable(one) else np.full(len(q), one)

    return plane(
        drift=lambda q, u, t: np.stack([np.full(len(q), u[0]), of(second, q, t)], axis=1),
        gain=lambda q: np.stack([of(one, q) for one in gain], axis=1).reshape(-1, 2, 2),
    )


READS = {  # a robot, by axes which coordinates its velocity reads, and whether it is always in one range
    "nothing": (driven, [[0, 0], [0, 0]], [1, 1]),
    "a drift": (lambda: driven(second=lambda q, t: np.sin(q[:, 0])), [[0, 0], [1, 0]], [1, 0]),
    "a gain": (lambda: driven(gain=(0.0, lambda q, t: q[:, 1], 1.0, 0.0)), [[0, 1], [0, 0]], [0, 1]),
    "a gain, further on": (lambda: driven(gain=(1.0, 0.0, 0.0, lambda q, t: q[:, 0])), [[0, 0], [1, 0]], [1, 0]),
    "a bound that the library would have as a gain": (driven, [[0, 1], [0, 1]], [0, 0]),
    "the time": (lambda: driven(second=lambda q, t: np.full(len(q), t)), [[0, 0], [0, 0]], [0, 0]),
    "not linear": (
        lambda: plane(
            drift=None,
            gain=None,
            velocity=lambda q, u, v: np.stack([np.full(len(q), u[0] + v[0]), q[:, 1] * v[1] ** 2], axis=1),
        ),
        [[0, 0], [0, 1]],
        [0, 0],
    ),
    "measured": (
        lambda: replace(driven(second=lambda q, t: q[:, 1]), sensing=sdhj.Sensing(0.01)),
        [[0, 0], [0, 1]],
        [0, 0],
    ),
    "a black box": (
        lambda: plane(gain=sdhj.BlackBox(lambda q, u, t: np.tile(np.eye(2), (len(q), 1, 1)), slope=0.0, rate=0.0)),
        [[1, 1], [1, 1]],
        [0, 0],
    ),
}


@pytest.mark.parametrize("name", READS)
def test_which_coordinates_a_velocity_reads(name):
    problem, reads, steady = READS[name]
    problem = problem()
    head = json.loads(json.dumps(make_head(problem, "certified", {}, problem.digest)))
    if name.startswith("a bound"):
        head["formulas"]["functions"]["bounds"]["lines"] = ["const 0x1p-4", "x 1", "return" + 4 * " 0 1"]
    robot = Problem(head, InMemory(arrays_of(problem)), problem)
    assert robot.reads.astype(int).tolist() == reads
    assert [int(robot.steady(axis)) for axis in (0, 1)] == steady
    assert robot.timed == (name == "the time")
