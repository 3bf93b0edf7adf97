"""Robots in other units: nothing that is allowed for rounding has a unit of its own.

A robot is stated in units of length, for each axis, and of time; its tables are those of the same robot in metres and
seconds. By powers of two every number is scaled exactly, so tables are equal bit for bit; by others, within a cell or
a node.
"""

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import zoo

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


MOVES, SETS = 0.5 * np.array(zoo.STEPS), {"target": zoo.goal(0.9, 0.7, 0.5), "unsafe": [zoo.post(0.0, 0.0, 0.3)]}


def plane(**changed):
    """Inputs and gusts along two axes, past a post."""
    return zoo.plane(MOVES, **{"nodes": 21, "delta": 0.25} | SETS | changed)


def turning():
    """A plane that turns about its middle: velocities depend on the state."""
    return plane(drift=lambda q, u: np.stack([u[0] - 0.2 * q[:, 1], u[1] + 0.2 * q[:, 0]], axis=1))


def car():
    """Whose heading has another unit than the plane's."""
    return zoo.car(nodes=[11, 11, 8], target=zoo.goal(1.2, 0.8, 0.6), unsafe=SETS["unsafe"], steps=2)


def cart():
    return zoo.cart(gust=0.3, lower=[-1.0, -4.0], upper=[1.0, 4.0], nodes=21)


def tide():
    """A current that turns with the time, a wall that comes, walls at the ends."""
    return zoo.line(
        (-1.5, 0.0, 1.5),
        0.05,
        drift=lambda q, u, t: u + 1.2 * np.sin(5.0 * t) + 0.0 * q,
        **{"lower": [-3.0], "upper": [3.0], "nodes": 31, "ends": "wall"},
        target=sdhj.TargetSet((0,), lambda p, t: np.abs(p[:, 0] - 0.3 * t) - 0.7),
        unsafe=[sdhj.UnsafeSet((0,), lambda p, t: 2.0 - 0.3 * t - p[:, 0], name="wall")],
        delta=0.4,
    )


SHAKY = sdhj.Sensing([0.01, 0.02], 0.02, 0.01, memory=False)
ROBOTS: dict[str, Any] = {  # the robot, cells, whether a grid is solved, too
    "plane": (plane, [44, 44], True),
    "turning": (turning, [32, 32], True),
    "car": (car, [16, 16, 12], True),
    "cart": (cart, [40, 40], False),
    "tide": (tide, [120], True),
    "sensed": (lambda: plane(sensing=SHAKY), [60, 60], False),
    "staying": (lambda: plane(target=None, steps=None), [40, 40], False),
    "hidden": (plane, [44, 44], False),
}


def stated(name, units):
    """The robot in these units, its level sets in that of the first axis; what is hidden is a black box."""
    problem, lengths, s = ROBOTS[name][0](), np.array(units.lengths), units.time
    rows = dict(zip(map(tuple, problem.inputs), problem.dynamics.drift.rows, strict=True))
    gain, bounds = (
        one(np.zeros((1, lengths.size)), 0.0)[0, 0] for one in (problem.dynamics.gain, problem.dynamics.bounds)
    )

    def level(part):
        own = lengths[list(part.axes)]
        function = lambda p, t: lengths[0] * part.level_set(p / own, t / s)  # noqa: E731
        if name == "hidden" and part is not problem.target:
            function = sdhj.BlackBox(function, slope=lengths[0] / lengths.min(), rate=0.0)
        return replace(part, level_set=function)

    grid, sensing = problem.grid, problem.sensing
    ends = [(np.array(end) * lengths).tolist() for end in (grid.lower, grid.upper)]
    return replace(
        problem,
        grid=sdhj.Grid(*ends, grid.shape, grid.periodic, ends=grid.ends),
        dynamics=sdhj.Dynamics(
            problem.inputs,
            lambda q, u, t: rows[tuple(u)](q / lengths, t / s) * lengths / s,
            gain,
            bounds * (gain.T @ lengths) / s,
        ),
        target=None if problem.has_no_target else level(problem.target),
        unsafe=[level(part) for part in problem.unsafe],
        delta=problem.delta * s,
        sensing=replace(sensing, error=sensing.error * lengths, delay=sensing.delay * s, jitter=sensing.jitter * s),
    )


@cache
def solved(name, units, method):
    cells = ROBOTS[name][1]
    return sdhj.solve(
        stated(name, units),
        sdhj.Certified(cells, parts=3) if method == "certified" else method,
        progress=False,
        play=False,
    )


def in_units(name, length, time=1.0):
    """All axes in other units, each a little other."""
    return Units(tuple(length * 2.0 ** (2 * axis) for axis in range(len(ROBOTS[name][1]))), time)


pytestmark = pytest.mark.filterwarnings("ignore::sdhj.ResolutionWarning")


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


@pytest.mark.parametrize("value", [-1.2, np.pi, 0.1 + 0.2, 1 / 3, 0.0])
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
    problem = zoo.car(
        [(v, w) for v in (0.5, 1.0) for w in (-1.5, 0.0, 1.5)],
        0.05,
        **{"lower": [-1.5, -1.5, -np.pi], "upper": [1.5, 1.5, np.pi], "nodes": [21, 21, 16]},
        target=zoo.goal(0.7, 0.5, 0.5),
        unsafe=[zoo.post(-0.1, -0.2, 0.3)],
        delta=0.175,
        steps=8,
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
    u, h = problem.inputs[first.best], 0.175 / 200

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


def test_borders_may_coincide(tmp_path):
    """A box at the end of the grid is the same however it is written, to the last cell, and for the checker, too."""
    half, centre = 0.25, 1.75
    written = {
        "by its ends": lambda p, t: np.max(np.maximum(centre - half - p, p - (centre + half)), axis=1),
        "by its middle": lambda p, t: np.max(np.abs(p - np.array([centre, centre])), axis=1) - half,
        "by its middle, the other way": lambda p, t: np.max(np.abs(np.array([centre, centre]) - p) - half, axis=1),
    }
    found = []
    for name, box in written.items():
        one = zoo.plane(
            [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]],
            **zoo.ALONE,
            nodes=33,
            ends="wall",
            target=sdhj.TargetSet((0, 1), box),
            delta=0.25,
            steps=4,
        )
        table = sdhj.solve(one, sdhj.Certified([32, 32]), progress=False, play=False)
        table.save(tmp_path / "box.npz")
        assert verify(tmp_path / "box.npz", progress=False).ok, name
        found.append(table)
    cells = int(half * 2 / 0.125)  # in the box; of those along its inner border the shell sticks out
    assert found[0].bits(start=0, within=0).sum() == (cells - 1) ** 2 > 0
    for other in found[1:]:
        assert all(np.array_equal(found[0].bits(start=0, within=n), other.bits(start=0, within=n)) for n in range(5))
