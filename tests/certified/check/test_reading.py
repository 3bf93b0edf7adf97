"""What is read of a file: numbers it lets in, and the cells that an image may overlap."""

import json
import math
import os
from fractions import Fraction
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from forged_robots import file_of, plane
from naive_certified import CIRCLE, LINE, SMALL, STILL, TARGET
from naive_certified import sensing as certain

import sdhj
from sdhj.certified.check import reading, stated
from sdhj.certified.check.arm.claims import PI, Scene, overlapped
from sdhj.certified.check.arm.recipe import expect_recipe
from sdhj.certified.check.reading import decimal, edges_of, expect_room, head_and_arrays
from sdhj.certified.check.sampled import InMemory
from sdhj.certified.check.stated import Problem
from sdhj.problem.describing import arrays_of
from sdhj.table.files import make_head


def test_numbers_beyond_the_bound_on_rounding_are_refused(recipe):
    def path(disk, **changes):
        return disk | {"path": disk["path"] | changes}

    def world(changes, sensing, axis, last):
        scene = Scene(recipe | {"arguments": recipe["arguments"] | changes}, certain(**sensing))
        return scene.world([np.linspace(-1, last if axis == own else 1, 9) for own in range(4)])

    assert world({}, {}, 0, 9.9)
    for number, fits, large in (
        *(("obstacles", [own], [other]) for own, other in disks(path)),
        ("target", path(STILL, centre=[0.0, 9.0]), path(STILL, centre=[0.0, 20.0])),
        ("target", STILL | {"radius": 9.0}, STILL | {"radius": 11.0}),
        ("u_max", 40.0, 150.0),
        ("v_d_max", 40.0, 150.0),
        ("v_p_max", 40.0, 150.0),
        ("pursuer_radius", 9.0, 10.0),
        ("half_width", 9.0, 10.0),
        ("lengths", [9.0, 1.0], [11.0, 1.0]),
        ("lengths", [1.0, 9.0], [1.0, 11.0]),
        ("lengths", [0.15, 0.0011], [0.15, 0.0009]),
        ("lengths", [0.0011, 0.15], [0.0009, 0.15]),
    ):
        assert world({number: fits}, {}, 0, 1)
        with pytest.raises(ValueError, match="bound on rounding"):
            world({number: large}, {}, 0, 1)
    for axis in range(4):
        off = [11.0 if own == axis else 0.0 for own in range(4)]
        for sensing, last in (({"error": off}, 1), ({}, 11)):
            with pytest.raises(ValueError, match="bound on rounding"):
                world({}, sensing, axis, last)
    late = {"obstacles": [path(LINE, velocity=[45.0, 0.0])]}  # at 9.24 m after the two steps
    assert world(late, {}, 0, 1)
    for more in ({"steps": 3}, {"delta": 0.15}):
        with pytest.raises(ValueError, match="bound on rounding"):
            world(late | more, {}, 0, 1)
    for sensing in ({"delay": 0.03}, {"jitter": 0.03}):
        with pytest.raises(ValueError, match="bound on rounding"):
            world(late | {"target": STILL}, sensing, 0, 1)


def disks(path):
    """Disks that fit, and ones beyond the bound."""
    yield path(STILL, centre=[9.0, 0.0]), path(STILL, centre=[20.0, 0.0])
    yield path(STILL, centre=[0.0, -9.0]), path(STILL, centre=[0.0, -20.0])
    yield STILL | {"radius": 9.0}, STILL | {"radius": 10.0}
    yield path(LINE, velocity=[0.0, 40.0]), path(LINE, velocity=[0.0, 60.0])
    yield path(CIRCLE, radius=9.0), path(CIRCLE, radius=10.0)
    yield path(CIRCLE, rate=400.0), path(CIRCLE, rate=1000.0)
    yield path(CIRCLE, rate=-400.0), path(CIRCLE, rate=-1000.0)
    yield path(CIRCLE, phase=90.0), path(CIRCLE, phase=101.0)
    yield path(CIRCLE, phase=-90.0), path(CIRCLE, phase=-101.0)


@pytest.mark.parametrize("kinematics", ["relative", "printed"])
def test_what_is_sensed_and_held_is_in_the_numbers_of_the_world(recipe, kinematics):
    recipe["arguments"] |= {"kinematics": kinematics, "lengths": [0.1, 0.2], "target": STILL, "obstacles": [LINE]}
    scene = Scene(recipe, certain(error=[0.01, 0.02, 0.03, 0.04], delay=0.05, jitter=0.015))
    world = scene.world([np.linspace(-1, 1, 9)] * 4)
    assert (world.held, world.late, world.begin, world.delta) == (0.13, 0.015, 0.05, 0.1)
    np.testing.assert_allclose(world.off, np.array([0.01, 0.02, 0.03, 0.04]) + 0.05 * np.array([2.0, 2.0, 0.6, 0.6]))
    assert world.arm.tolist() == ([0.1, 0.2, 1.0] if kinematics == "relative" else [0.1, 0.1 + 0.2, 0.0])
    assert world.agent.tolist() == [0.6, 0.04 + 0.01] and world.chased and world.push == 2.0
    assert world.disks.tolist() == [[0.24, -0.02, -0.6, 0.7, 0.0, 0.0, 0.0, 0.04 + 0.01]]
    assert world.target.tolist() == [-0.22, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.06]
    values = (-4.0, 0.0, 4.0)
    assert world.inputs.tolist() == [[one, two] for one in values for two in values]


def other(disk, **path):
    """A disk with another radius, or on another path."""
    return disk | {"path": disk["path"] | path} if path else disk | {"radius": disk["radius"] + 1e-3}


AMONG = [STILL, LINE, CIRCLE]
OTHERS = {
    **{"half_width": 0.011, "u_max": 4.1, "v_d_max": 2.1, "delta": 0.11, "steps": 3, "input_levels": 2},
    **{"lengths": (0.15, 0.151), "kinematics": "printed"},
}
PATHS = {  # an obstacle, and what is other of it
    "its radius": (0, {}),
    "where it is": (0, {"centre": [-0.22, 0.101]}),
    "where it begins": (1, {"start": [0.241, -0.02]}),
    "how fast it goes": (1, {"velocity": [-0.6, 0.71]}),
    "its circle": (2, {"radius": 0.071}),
    "how fast it turns": (2, {"rate": 9.1}),
    "where it turns": (2, {"phase": -0.99}),
}


@pytest.mark.parametrize("built", ["relative", "printed", "evader"])
def test_a_head_is_what_its_recipe_makes_and_no_other(built):
    """At any time; each number of the recipe and of the disks by itself."""
    agent, own = ("evader", {"v_e_max": 0.3, "evader_radius": 0.14}) if built == "evader" else ("pursuer", {})
    small = {name: one for name, one in SMALL.items() if built != "evader" or name not in ("target", "v_p_max")}
    kinematics = {} if built == "evader" else {"kinematics": built}
    make = sdhj.evader_case_study if built == "evader" else sdhj.arm_case_study
    problem = make(**small | own | kinematics | {"obstacles": AMONG})
    head = json.loads(json.dumps(make_head(problem, "certified", {}, problem.digest)))
    robot, made = Problem(head, InMemory({}), None), head["recipe"]
    expect_recipe(robot, Scene(made, robot))
    changes = OTHERS | {f"{agent}_radius": 0.139, f"v_{agent[0]}_max": 0.61, f"{agent}_box": 0.361}
    changes["kinematics"] = "relative" if made["arguments"]["kinematics"] == "printed" else "printed"
    each = [{name: one} for name, one in changes.items()] + [{"obstacles": AMONG[:2]}, {"obstacles": []}]
    each += [{"obstacles": [*AMONG[:at], other(AMONG[at], **path), *AMONG[at + 1 :]]} for at, path in PATHS.values()]
    if built != "evader":
        each += [{"target": other(TARGET)}, {"target": other(TARGET, velocity=[0.1, -0.06])}]
    for change in each:
        with pytest.raises(ValueError, match="of its recipe"):
            expect_recipe(robot, Scene(made | {"arguments": made["arguments"] | change}, robot))


@cache
def text_of_small_head():
    problem = sdhj.arm_case_study(**SMALL | {"obstacles": AMONG})
    return json.dumps(make_head(problem, "certified", {}, problem.digest))


def also_reads(name, line):
    """A formula of the velocity reads one thing more, which is 0 at the origin at time 0."""

    def forge(head):
        own = head["formulas"]["functions"][name]
        *lines, (_, first, *others) = *own["lines"][:-1], own["lines"][-1].split()
        own["lines"] = [*lines, line, f"add {first} {len(lines)}", " ".join(["return", str(len(lines) + 1), *others])]

    return forge


OF_ANOTHER = {  # what a head says, which is of another robot than its recipe's
    **{
        f"{name} reads {line}": also_reads(name, line)
        for name in ("drift", "gain", "bounds")
        for line in ("p 0", "x 2")
    },
    "obstacles under some inputs": lambda head: head["sets"][1].update(inputs=[0]),
    "a pursuer under some inputs": lambda head: head["sets"][2].update(inputs=[1, 2]),
    "no target": lambda head: [head["sets"].pop(0), head["formulas"]["functions"].pop("target")],
    "no pursuer": lambda head: [head["sets"].pop(2), head["formulas"]["functions"].pop("unsafe 1")],
    "another interval": lambda head: head.update(delta=0.11),
    "another step": lambda head: head.update(steps=3),
    "another input": lambda head: head["inputs"][4].__setitem__(1, 1e-8),
    "another square": lambda head: head["grid"]["upper"].__setitem__(3, 0.361),
    "its other side": lambda head: head["grid"]["lower"].__setitem__(2, -0.361),
    "a square that closes": lambda head: head["grid"]["periodic"].__setitem__(3, True),
    "a joint that does not": lambda head: head["grid"]["periodic"].__setitem__(0, False),
    "no walls": lambda head: head["grid"]["ends"].__setitem__(2, ["wall", "unsafe"]),
}


@pytest.mark.parametrize("change", OF_ANOTHER)
def test_a_head_of_another_robot_is_not_what_its_recipe_makes(change):
    head = json.loads(text_of_small_head())
    OF_ANOTHER[change](head)
    robot = Problem(head, InMemory({}), None)
    with pytest.raises(ValueError, match="must be those of its recipe"):
        expect_recipe(robot, Scene(head["recipe"], robot))


@pytest.mark.parametrize("axis", [0, 2])
@pytest.mark.parametrize("memory", [False, True])
def test_image_lists_are_of_what_overlaps(axis, memory, recipe):
    """To both sides, past the last cell, which is half as wide, once around, and by just a cell.

    A point that is carried on moves as the state does; what is predicted of a measurement is twice E off.
    """
    recipe["arguments"]["target"] = STILL
    scene = Scene(recipe, certain(error=[0.02, 0.0, 0.01, 0.0], delay=0.03, jitter=0.01, memory=memory))
    fastest = Fraction(str(recipe["arguments"]["v_d_max" if axis == 0 else "v_p_max"]))
    size = 2 * PI[1] if axis == 0 else 2 * scene.box
    off = 0 if memory else Fraction(4 - axis, 100) + 2 * Fraction(3, 100) * fastest
    spans = Fraction(8, 100), Fraction(12, 100)
    for n, part in ((13, Fraction(25, 2)), (12, 12)):
        width = size / part
        file = SimpleNamespace(scene=scene, counts=(n,) * 4, axes=[(0, width, size, size)] * 4)
        by_a_cell = (width + off) / spans[1]
        pairs = [(Fraction(-17, 10), Fraction(23, 10)), (-by_a_cell, by_a_cell)]
        pairs += [(Fraction(9, 10), Fraction(23, 10)), (Fraction(-23, 10), Fraction(-9, 10)), (70, 75), (-75, -70)]
        for slow, fast in pairs if axis == 0 else pairs[:2]:
            low = min(slow * span for span in spans) - off
            high = max(fast * span for span in spans) + off
            laps = [lap * size for lap in range(-3, 4)] if axis == 0 else [0]
            ends = [(m * width, min((m + 1) * width, size)) for m in range(n)]
            expected = [
                [m for m, (a, b) in enumerate(ends) if any(begin + low + t < b and a < end + high + t for t in laps)]
                for begin, end in ends
            ]
            assert overlapped(axis, file, slow, fast) == expected


def test_edges_are_the_floats_nearest_to_fractions(rng):
    for _ in range(200):
        below, powers, numbers = rng.integers(1, 10**9, 3).tolist(), rng.integers(1, 30, 3).tolist(), range(2, 90)
        low, width, more = (Fraction(a - 5 * 10**8, 7**b * 10**9) for a, b in zip(below, powers, strict=True))
        axis = low, abs(width) + Fraction(1, 10 ** (10 * powers[0])), abs(more), abs(more) + Fraction(1, 10**20)
        cells, layers = int(rng.choice(numbers)), rng.integers(0, 2, 2).tolist()
        inner = [float(low + i * axis[1]) for i in range(cells - sum(layers))]
        ends = [float(low)] * layers[0] + inner + [float(low + (axis[2] + axis[3]) / 2)] * (1 + layers[1])
        assert edges_of(cells, axis, layers).tolist() == ends


def test_a_decimal_is_the_shortest_that_is_read_as_the_number(rng):
    """Of up to eleven digits, times powers of two and ten; the number itself, of those that have no such decimal."""
    for _ in range(100):
        digits = int(rng.integers(1, 10 ** int(rng.integers(1, 12)))) * (-1) ** int(rng.integers(2))
        for tens, twos in ((rng.integers(-11, 1), rng.integers(-30, 31)), (rng.integers(-90, 90), 0)):
            value = digits * Fraction(10) ** int(tens) * Fraction(2) ** int(twos)
            assert decimal(float(value)) == value
    # a few have one of 14 digits by chance
    assert np.mean([decimal(value) == Fraction(value) for value in rng.uniform(1, 9, 100)]) > 0.8
    assert decimal(math.pi) == Fraction(math.pi) and decimal(2 * math.pi) == Fraction(2 * math.pi)


@pytest.mark.parametrize(
    "error",
    [KeyError, IndexError, TypeError, AttributeError, ZeroDivisionError, OverflowError, RuntimeError, ValueError],
)
def test_whatever_goes_wrong_with_a_file_is_told_of_it(error, tmp_path):
    (path := tmp_path / "line.npz").write_bytes(file_of("line"))
    with pytest.raises(ValueError, match=r"line.npz: its certified sets make no sense .*mine"), head_and_arrays(path):
        raise error("mine")


def test_what_is_no_file_is_not_opened(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(ValueError, match="pipe is no file"), head_and_arrays(tmp_path / "pipe"):
        pass
    with pytest.raises(FileNotFoundError, match=r"no file .*nowhere"), head_and_arrays(tmp_path / "nowhere"):
        pass


def test_room_is_asked_for_in_gigabytes_and_all_that_is_free_may_be_taken(monkeypatch):
    monkeypatch.setattr(reading, "free_memory", lambda: iter([5e10, 2.5e9, 4e9]))
    expect_room(0)
    expect_room(2_500_000_000)
    for needed, said in (
        (2_500_000_001, "takes 2.5 GB of memory, and 2.5 GB are free"),
        (10**400, r"takes 10\^400 bytes"),
    ):
        with pytest.raises(MemoryError, match=said):
            expect_room(needed)


def test_memory_is_free_by_each_limit_that_the_system_tells(monkeypatch):
    """The machine's, less what a group uses of its own, less the pages that the process has, by hand."""
    resource = pytest.importorskip("resource")
    told = {
        "/proc/meminfo": "MemTotal: 9000 kB\nMemAvailable:    1000 kB\n",
        "/sys/fs/cgroup/memory.max": "5000\n",
        "/sys/fs/cgroup/memory.current": "3000\n",
        "/sys/fs/cgroup/memory.stat": "anon 1\ninactive_file 500\n",
        "/proc/self/statm": "7 3 2 1 0 1 0\n",
    }

    class Told:
        def __init__(self, path):
            self.path = path

        def read_text(self, encoding):
            if self.path not in told:
                raise FileNotFoundError(self.path)
            return told[self.path]

    monkeypatch.setattr(reading, "Path", Told)
    monkeypatch.setattr(resource, "getrlimit", lambda which: (10**6, 10**9) if which == resource.RLIMIT_AS else (0, 0))
    pages = 7 * resource.getpagesize()
    assert [*reading.free_memory()] == [math.inf, 1000 * 1024, 5000 - 3000 + 500, 10**6 - pages]
    told["/sys/fs/cgroup/memory.max"] = "max\n"
    del told["/proc/meminfo"]
    monkeypatch.setattr(resource, "getrlimit", lambda which: (resource.RLIM_INFINITY,) * 2)
    assert [*reading.free_memory()] == [math.inf, math.inf]


def test_tables_of_formulas_have_so_much_room_together(monkeypatch):
    both = object.__new__(Problem)
    both.tables, both.arrays = {}, InMemory({"tables/0": np.zeros(4), "tables/1": np.ones(4)})
    monkeypatch.setattr(stated, "MOST_TABLES", 2 * 32)
    assert [both.table(number, 1).tolist() for number in (0, 1, 0)] == [[0.0] * 4, [1.0] * 4, [0.0] * 4]
    both.tables = {}
    monkeypatch.setattr(stated, "MOST_TABLES", 2 * 32 - 1)
    both.table(0, 1)
    with pytest.raises(ValueError, match="tables/1 must be kept"):
        both.table(1, 1)


SENSING = {  # whether measurements are no states, and are remembered
    "nothing": ({}, False, False),
    "no errors": ({"error": 0.0, "memory": True}, False, False),
    "an error on one axis": ({"error": [0.0, 0.1], "memory": False}, True, False),
    "one error for all": ({"error": 0.1, "memory": True}, True, True),
    "a delay": ({"delay": 0.25}, True, False),
    "jitter": ({"jitter": 0.125, "memory": True}, True, True),
    "all of an interval": ({"delay": 0.05, "jitter": 0.1, "rest": 3}, True, False),
}


@pytest.mark.parametrize("name", SENSING)
def test_what_is_sensed(name):
    sensing, sensed, remembered = SENSING[name]
    problem = plane()
    head = json.loads(json.dumps(make_head(problem, "certified", {}, problem.digest))) | {"sensing": sensing}
    head["grid"].pop("names", None)
    robot = Problem(head, InMemory(arrays_of(problem)), None)
    assert (robot.sensed, robot.memory, robot.names) == (sensed, remembered, ["x1", "x2"])
    assert robot.error.tolist() == {float: [sensing.get("error")] * 2, list: sensing.get("error")}.get(
        type(sensing.get("error")), [0.0] * 2
    )
    np.testing.assert_allclose(robot.spacing, [0.2, 0.2])


def test_a_gain_that_is_a_black_box_has_values_for_axes_and_components():
    gain = sdhj.BlackBox(
        lambda q, u, t: np.tile([[0.5, 0.0], [2.0, 3.0]], (len(q), 1, 1)), slope=[[0.0, 0.0], [1.0, 0.0]], rate=0.0
    )
    problem = plane(gain=gain)
    head = json.loads(json.dumps(make_head(problem, "certified", {}, problem.digest)))
    robot = Problem(head, InMemory(arrays_of(problem)), problem)
    low = np.array([[-1.0], [0.0]])
    found = np.array(robot.velocity(0, low, low + 0.2, (0.0, 1.0), True))[:, :, 0]
    # with a slope of 0.1 for the half of a box, on the second axis
    np.testing.assert_allclose(found, [[1.0 - 0.05, -0.1 * (2.1 + 3.1)], [1.0 + 0.05, 0.1 * (2.1 + 3.1)]], atol=1e-7)
    assert robot.trusted == {"gain"}
