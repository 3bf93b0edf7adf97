"""Robots in other units: nothing that is allowed for rounding has a unit of its own.

A robot is stated in units of length, for each axis, and of time; its tables are those of the same robot in metres and
seconds. By powers of two every number is scaled exactly, so tables are equal bit for bit; by others, within a cell or
a node.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest

import sdhj
from sdhj.certified.cells import as_fraction, as_rounded_fraction
from sdhj.certified.check import verify
from sdhj.certified.check.reading import decimal

POWERS = (-30, 26)  # 9e-10 and 7e7
DECIMALS = (1e-9, 180 / np.pi, 1e8)


@dataclass(frozen=True)
class Units:
    """How many of them a metre or a radian of each axis are, and a second."""

    lengths: tuple[float, ...]
    time: float = 1.0


def axes(units, lower, upper, nodes, **given):
    ends = [(np.array(end) * units.lengths).tolist() for end in (lower, upper)]
    return sdhj.Grid(*ends, nodes, **given)


def plane(units, has_no_target=False, sensing=None, black=False):
    """Inputs and gusts along two axes, past a post."""
    (a, b), s = units.lengths, units.time
    inputs = np.array([[0, 0], [0.5, 0], [-0.5, 0], [0, 0.5], [0, -0.5]]) * units.lengths / s

    def post(p, t):
        return a * (np.hypot(p[:, 0] / a, p[:, 1] / b) - 0.3)

    return sdhj.ReachAvoidProblem(
        axes(units, [-2, -2], [2, 2], [21, 21]),
        sdhj.Dynamics(inputs, inputs, np.eye(2), [0.1 * a / s, 0.1 * b / s]),
        None
        if has_no_target
        else sdhj.TargetSet((0, 1), lambda p, t: a * (np.hypot(p[:, 0] / a - 0.9, p[:, 1] / b - 0.7) - 0.5)),
        [sdhj.UnsafeSet((0, 1), sdhj.BlackBox(post, slope=a / min(a, b), rate=0.0) if black else post, name="post")],
        0.25 * s,
        None if has_no_target else 3,
        sensing=sdhj.Sensing() if sensing is None else sensing(units),
    )


def turning(units):
    """A plane that turns about its middle: velocities depend on the state."""
    (a, b), s = units.lengths, units.time
    inputs = 0.5 * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]]) * units.lengths / s

    def drift(q, u):
        return np.stack([u[0] - 0.2 * a / b / s * q[:, 1], u[1] + 0.2 * b / a / s * q[:, 0]], axis=1)

    return sdhj.ReachAvoidProblem(
        axes(units, [-2, -2], [2, 2], [21, 21]),
        sdhj.Dynamics(inputs, drift, np.eye(2), [0.1 * a / s, 0.1 * b / s]),
        sdhj.TargetSet((0, 1), lambda p, t: a * (np.hypot(p[:, 0] / a - 0.9, p[:, 1] / b - 0.7) - 0.5)),
        [sdhj.UnsafeSet((0, 1), lambda p, t: a * (np.hypot(p[:, 0] / a, p[:, 1] / b) - 0.3))],
        0.25 * s,
        3,
    )


def car(units):
    """A heading of another unit than the plane's, on a circle."""
    (a, b, c), s = units.lengths, units.time

    def drift(q, u):
        heading = q[:, 2] / c
        return np.stack([u[0] * a * np.cos(heading), u[0] * b * np.sin(heading), np.full(len(q), u[1] * c)], axis=1) / s

    return sdhj.ReachAvoidProblem(
        axes(units, [-2, -2, -np.pi], [2, 2, np.pi], [11, 11, 8], periodic=[False, False, True]),
        sdhj.Dynamics(
            [[v, w] for v in (0.5, 1.0) for w in (-1.5, 0.0, 1.5)],
            drift,
            [[1, 0], [0, 1], [0, 0]],
            [0.1 * a / s, 0.1 * b / s],
        ),
        sdhj.TargetSet((0, 1), lambda p, t: a * (np.hypot(p[:, 0] / a - 1.2, p[:, 1] / b - 0.8) - 0.6)),
        [sdhj.UnsafeSet((0, 1), lambda p, t: a * (np.hypot(p[:, 0] / a, p[:, 1] / b) - 0.3))],
        0.25 * s,
        2,
    )


def cart(units):
    """On a rail with unsafe ends, for ever."""
    (a, b), s = units.lengths, units.time
    return sdhj.ReachAvoidProblem(
        axes(units, [-1, -4], [1, 4], [21, 21]),
        sdhj.Dynamics(
            [[-3.0 * b / s], [0.0], [3.0 * b / s]],
            lambda q, u: np.stack([q[:, 1] * (a / b) / s, np.full(len(q), u[0])], axis=1),
            [[0.0], [1.0]],
            [0.3 * b / s],
        ),
        None,
        [],
        0.1 * s,
        None,
    )


def tide(units):
    """A current that turns with the time, a wall that comes, walls at the ends."""
    (a,), s = units.lengths, units.time
    levels = [[-1.5 * a / s], [0.0], [1.5 * a / s]]
    return sdhj.ReachAvoidProblem(
        axes(units, [-3], [3], [31], ends="wall"),
        sdhj.Dynamics(levels, lambda q, u, t: u + 1.2 * a / s * np.sin(5.0 * t / s) + 0.0 * q, [[1.0]], [0.05 * a / s]),
        sdhj.TargetSet((0,), lambda p, t: a * (np.abs(p[:, 0] / a - 0.3 * t / s) - 0.7)),
        [sdhj.UnsafeSet((0,), lambda p, t: a * (2.0 - 0.3 * t / s - p[:, 0] / a), name="wall")],
        0.4 * s,
        3,
    )


def shaky(units):
    return sdhj.Sensing(
        [0.01 * units.lengths[0], 0.02 * units.lengths[1]], 0.02 * units.time, 0.01 * units.time, memory=False
    )


ROBOTS: dict[str, Any] = {  # the robot, its axes, cells, whether a grid is solved, too
    "plane": (plane, 2, [44, 44], True),
    "turning": (turning, 2, [32, 32], True),
    "car": (car, 3, [16, 16, 12], True),
    "cart": (cart, 2, [40, 40], False),
    "tide": (tide, 1, [120], True),
    "sensed": (lambda units: plane(units, sensing=shaky), 2, [60, 60], False),
    "staying": (lambda units: plane(units, has_no_target=True), 2, [40, 40], False),
    "hidden": (lambda units: plane(units, black=True), 2, [44, 44], False),
}


@cache
def solved(name, units, method):
    make, _, cells, _ = ROBOTS[name]
    return sdhj.solve(
        make(units), sdhj.Certified(cells, parts=3) if method == "certified" else method, progress=False, play=False
    )


def in_units(name, length, time=1.0):
    """All axes in other units, each a little other."""
    count = ROBOTS[name][1]
    return Units(tuple(length * 2.0 ** (2 * axis) for axis in range(count)), time)


pytestmark = pytest.mark.filterwarnings("ignore::sdhj.common.findings.ResolutionWarning")


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("power", POWERS)
def test_powers_of_two_make_no_difference(name, power, tmp_path):
    """Certified sets, moves and tubes bit for bit, and proved."""
    units = in_units(name, 2.0**power, 2.0 ** (-power // 2))
    plain, other = solved(name, in_units(name, 1.0), "certified"), solved(name, units, "certified")
    assert np.array_equal(plain.index, other.index) and np.array_equal(plain.pool, other.pool)
    for part in ("low", "high", "clear"):
        assert np.array_equal(getattr(plain.proof, part), getattr(other.proof, part)), part
    assert 0.0 < plain.fraction(start=0) == other.fraction(start=0)
    other.save(tmp_path / "other.npz")
    given = other.problem if other.problem.opaque else None
    assert (verdict := verify(tmp_path / "other.npz", given, progress=False)).ok, str(verdict)


GRIDS = [name for name, (*_, grid) in ROBOTS.items() if grid]


@pytest.mark.slow
@pytest.mark.parametrize("name", GRIDS)
def test_powers_of_two_scale_the_tubes_of_a_grid(name):
    """Level-set functions are in units of the first axis, and in cells where a table for ever has settled."""
    plain = solved(name, in_units(name, 1.0), "hji")
    for power in POWERS:
        other = solved(name, in_units(name, 2.0**power, 2.0 ** (-power // 2)), "hji")
        assert plain.steps == other.steps
        for within in range(plain.steps + 1):
            unit = 1.0 if other.problem.has_no_target else 2.0**power
            assert np.array_equal(plain.values(within=within), other.values(within=within) / unit)
            assert np.array_equal(plain.inputs(within=within), other.inputs(within=within))


@pytest.mark.slow
@pytest.mark.parametrize("name", GRIDS)
def test_other_units_make_a_node_of_difference(name):
    plain = solved(name, in_units(name, 1.0), "hji")
    for unit in DECIMALS:
        other = solved(name, in_units(name, unit, unit), "hji")
        differ = (plain.values() <= 0) != (other.values() <= 0)
        assert plain.steps == other.steps and differ.mean() < 0.5 / max(plain.grid.shape)


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("unit", DECIMALS)
def test_other_units_make_a_cell_of_difference(name, unit, tmp_path):
    """Sets are those of metres within a cell, and proved."""
    plain, other = solved(name, in_units(name, 1.0), "certified"), solved(name, in_units(name, unit, unit), "certified")
    other.save(tmp_path / "other.npz")
    given = other.problem if other.problem.opaque else None
    assert (verdict := verify(tmp_path / "other.npz", given, progress=False)).ok, str(verdict)
    ends = sum(2.0 / count for count in plain.shape)  # a layer of cells at the ends of each axis
    assert abs(plain.fraction(start=0) - other.fraction(start=0)) <= ends * max(plain.fraction(start=0), 0.05)


@pytest.mark.parametrize("value", [0.3, -1.2, np.pi, -np.pi, 0.1 + 0.2, 12345.678, 9.25, 1 / 3, 0.0])
def test_numbers_are_read_alike_at_every_power_of_two(value):
    """The prover and the checker, which reads them by itself; no reading is off by more than it says."""
    for power in (-35, -30, -1, 0, 1, 7, 26, 35):
        scaled = value * 2.0**power
        assert as_fraction(scaled) == decimal(scaled) == as_fraction(value) * as_fraction(2.0**power)
        assert as_rounded_fraction(scaled) == as_rounded_fraction(value) * as_fraction(2.0**power)
        assert float(as_fraction(scaled)) == scaled
        assert abs(float(as_rounded_fraction(scaled)) - scaled) <= 5e-13 * abs(scaled)


# ---- a reserve for rounding


@pytest.mark.slow
def test_a_promised_run_has_a_reserve_for_rounding():
    """From states bisected to the boundary of what `contains` says, none is without an answer after a step."""
    inputs = np.array([[v, w] for v in (0.5, 1.0) for w in (-1.5, 0.0, 1.5)])

    def drift(q, u):
        return np.stack([u[0] * np.cos(q[:, 2]), u[0] * np.sin(q[:, 2]), np.full(len(q), u[1])], axis=1)

    problem = sdhj.ReachAvoidProblem(
        sdhj.Grid([-1.5, -1.5, -np.pi], [1.5, 1.5, np.pi], [21, 21, 16], [False, False, True]),
        sdhj.Dynamics(inputs, drift, [[1, 0], [0, 1], [0, 0]], [0.05, 0.05]),
        sdhj.TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 0.7, p[:, 1] - 0.5) - 0.5),
        [sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0] + 0.1, p[:, 1] + 0.2) - 0.3)],
        0.175,
        8,
    )
    table, rng = sdhj.solve(problem, sdhj.Certified([40, 40, 36]), play=False), np.random.default_rng(0)
    controller, grid = sdhj.Controller(table), problem.grid
    states = rng.uniform(grid.lower, grid.upper, (40_000, 3))
    inside = rng.choice(states[table.contains(states, start=0)], 3000)
    beyond = inside + [0.0, 0.0, 0.4] * rng.normal(size=(3000, 1))
    some = ~table.contains(grid.wrapped(beyond), start=0)
    inside, beyond = inside[some], beyond[some]
    for _ in range(55):
        middle = (inside + beyond) / 2
        held = table.contains(grid.wrapped(middle), start=0)[:, None]
        inside, beyond = np.where(held, middle, inside), np.where(held, beyond, middle)
    first = controller.batch(grid.wrapped(inside), 0)
    assert len(inside) > 200 and first.promised[first.steps_to_go > 0].all()
    pushes, at = 0.05 * np.sign(rng.normal(size=(len(inside), 2))), grid.wrapped(inside)
    u, h = inputs[first.best], 0.175 / 200

    def velocity(z):
        moved = [u[:, 0] * np.cos(z[:, 2]) + pushes[:, 0], u[:, 0] * np.sin(z[:, 2]) + pushes[:, 1], u[:, 1]]
        return np.stack(moved, axis=1)

    for _ in range(200):
        a = velocity(at)
        b = velocity(at + h / 2 * a)
        c = velocity(at + h / 2 * b)
        at = at + h / 6 * (a + 2 * b + 2 * c + velocity(at + h * c))
    second = controller.batch(grid.wrapped(at), 1)
    arrived = (first.steps_to_go == 1) & (problem.target_value(grid.wrapped(at), 0.175) <= 0)  # in whatever cell
    assert ((second.steps_to_go >= 0) | arrived)[first.steps_to_go > 0].all()
    assert 400 < table.steps_of_rounding() < 500 == table.steps_of_rounding(0.0)
    with pytest.raises(ValueError, match="rounding"):
        table.steps_of_rounding(-1.0)


@pytest.mark.parametrize("half", [0.25, 0.5])
def test_borders_may_coincide(half, tmp_path):
    """A box at the end of the grid is the same however it is written, to the last cell, and for the checker, too."""
    centre = 2.0 - half
    written = {
        "by its ends": lambda p, t: np.max(np.maximum(centre - half - p, p - (centre + half)), axis=1),
        "by its middle": lambda p, t: np.max(np.abs(p - np.array([centre, centre])), axis=1) - half,
        "by its middle, the other way": lambda p, t: np.max(np.abs(np.array([centre, centre]) - p) - half, axis=1),
    }
    found = []
    for name, box in written.items():
        one = sdhj.ReachAvoidProblem(
            sdhj.Grid([-2, -2], [2, 2], [33, 33], ends="wall"),
            sdhj.Dynamics([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]], [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]]),
            sdhj.TargetSet((0, 1), box),
            [],
            0.25,
            4,
        )
        table = sdhj.solve(one, sdhj.Certified([32, 32]), progress=False, play=False)
        table.save(tmp_path / "box.npz")
        assert verify(tmp_path / "box.npz", progress=False).ok, name
        found.append(table)
    cells = int(half * 2 / 0.125)  # in the box; of those along its inner border the shell sticks out
    assert found[0].bits(start=0, within=0).sum() == (cells - 1) ** 2 > 0
    for other in found[1:]:
        assert all(np.array_equal(found[0].bits(start=0, within=n), other.bits(start=0, within=n)) for n in range(5))
