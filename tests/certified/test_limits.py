"""What limits a certified table, by its problem solved again on few nodes; each advice followed once."""

from dataclasses import replace

import numpy as np
import pytest
import zoo
from test_safety import double_integrator

import sdhj
from sdhj.certified import explaining as explaining_module
from sdhj.certified import table as table_module
from sdhj.certified.explaining import BEYOND, MORE_CELLS, UNDECIDED, UNKNOWN, advice_to_leave_out
from sdhj.common.findings import ResolutionWarning

SLOW, PUSH = 0.4, 0.2371  # m in an interval


def solved(problem, *cells):
    return sdhj.solve(problem, sdhj.Certified(cells=cells), progress=False, play=False)


def line():
    """x on a line of 10 m that stands or moves on, and cells of which no width fits both; a post, and a goal behind."""
    return zoo.run(dynamics=zoo.line((0.0, SLOW), PUSH).dynamics, target=zoo.goal(8.03, 1.3), steps=12)


def plane(push=0.2, gap=0.6):
    """A point in the plane that goes at 1 m/s along an axis; behind a wall with a gap the target."""

    def wall(p, t):
        return np.maximum(np.abs(p[:, 0] - 0.7) - 0.2, gap / 2 - np.abs(p[:, 1]))

    return zoo.plane(push=push, target=zoo.goal(1.4, 0.0, 0.45), unsafe=[sdhj.UnsafeSet((0, 1), wall)], steps=12)


def joint(delta, error=0.0, memory=False):
    """A joint before its stops, to be kept from them for ever; rad, rad/s."""
    grid = sdhj.Grid([-1, -2], [1, 2], (51, 41), ends=["unsafe", "wall"], names=["q", "v"])
    sensing = sdhj.Sensing((0.1 * error, error), memory=memory)
    return zoo.cart((-4.0, 0.0, 4.0), 0.1, grid=grid, delta=delta, sensing=sensing)


# ---- what is said, and followed


@pytest.mark.slow
def test_whole_cells_keep_it_out():
    """What moves less than a cell in an interval is rounded out; the grid has the state, and so have finer cells."""
    fast = joint(0.01)
    says = solved(fast, 20, 20).explain([0.0, 0.0])
    assert says.causes == ("creep",) and says.helps[0] == MORE_CELLS and "keeps it out: creep" in str(says)
    assert any("more cells along v" in one for one in says.helps) and not any("along q" in one for one in says.helps)
    assert solved(fast, 80, 160).contains([[0.0, 0.0]])[0] and not solved(fast, 160, 80).fraction()
    says = solved(line(), 17).explain([5.4])  # on this side of where the push lets it come from, 4.77
    assert says.causes == ("rounding",) and says.helps == (MORE_CELLS,)
    assert solved(line(), 400).contains([[5.4]])[0]


@pytest.mark.slow
def test_no_cells_are_advised_where_a_grid_lacks_the_state():
    """A push that is too strong: no number of cells helps."""
    says = solved(plane(push=1.1), 40, 40).explain([1.4, 1.0])
    assert not says.causes and says.helps[0] == BEYOND
    assert not solved(plane(push=1.1), 80, 80).contains([[1.4, 1.0]])[0]
    assert solved(plane(push=0.3), 40, 40).contains([[1.4, 1.0]])[0]


def test_near_its_boundary_a_grid_does_not_tell():
    table, places = solved(line(), 17), np.arange(3.4, 6.7, 0.01)
    first = np.flatnonzero(table.on_few_nodes.contains(places[:, None]))[0]
    assert first > 0 and table.explain([places[first - 1]]).helps == (UNDECIDED,)


@pytest.mark.slow
def test_an_empty_set_for_ever_says_how_long_to_hold_an_input(solves_are_played):
    """A cart that moves a part of a cell in 20 ms: an input held for three periods is as good as finer cells."""
    cart, cells = replace(double_integrator(None, 0.6), delta=0.02), sdhj.Certified(cells=(80, 80))
    with pytest.warns(ResolutionWarning, match=r"periods, delta=0\.04 or 0\.06"):
        assert sdhj.solve(cart, cells, progress=False).fraction() == 0.0
    assert sdhj.solve(replace(cart, delta=0.06), cells, progress=False).fraction() > 0.35


def pole(axes):
    """A cart with a pole, for ever, on some of the axes x (m), v (m/s), angle (rad) and rate (rad/s): x is not read."""

    def drift(q, u):
        v, angle, rate = (q[:, axes.index(k)] for k in (1, 2, 3))
        sin, cos = np.sin(angle), np.cos(angle)
        whole = (u[0] + 0.1 * rate**2 * sin) / 1.2
        turn = (9.81 * sin - cos * whole) / (0.5 * (4 / 3 - 0.2 * cos**2 / 1.2))
        rates = {0: v, 1: whole - 0.1 * turn * cos / 1.2, 2: rate, 3: turn}
        return np.stack([rates[k] for k in axes], axis=1)

    ends, nodes = np.array([1.5, 2.5, 0.5, 2.5])[axes], np.array([17, 17, 21, 21])[axes].tolist()
    grid = sdhj.Grid(-ends, ends, nodes, names=[("x", "v", "angle", "rate")[k] for k in axes])
    inputs = [[-10.0], [-5.0], [0.0], [5.0], [10.0]]
    dynamics = sdhj.Dynamics(inputs, drift, np.eye(4)[axes][:, 3:], [0.2])
    return zoo.cart(grid=grid, dynamics=dynamics)


def test_an_axis_may_be_left_out_for_which_nothing_is_promised_then():
    (told,) = advice_to_leave_out(pole([0, 1, 2, 3]))
    assert "between -1.5 and 1.5" in told
    (told,) = advice_to_leave_out(pole([1, 2, 3]))
    assert told.startswith("v left out") and advice_to_leave_out(joint(0.01)) == []


@pytest.mark.slow
def test_a_pole_is_kept_upright_where_the_track_is_left_out():
    """Six seconds prove nothing with the track, and half of the states without."""
    with_track, without = (
        sdhj.solve(pole(axes), sdhj.Certified(seconds=6), progress=False, play=False).fraction()
        for axes in ([0, 1, 2, 3], [1, 2, 3])
    )
    assert with_track == 0.0 and without > 0.5


def test_nothing_is_paid_where_nothing_is_said(solves_are_played):
    """A table that is not scanty has no copies, until it is asked why."""
    table = sdhj.solve(line(), sdhj.Certified(cells=[200]), progress=False)
    assert "on_few_nodes" not in vars(table) and "findings" not in table.details
    assert table.explain([0.5]).failures and "on_few_nodes" in vars(table)


def test_where_there_is_no_grid(monkeypatch):
    """Where a grid takes no black box: what is not tried is not claimed."""

    def refused(*_):
        raise ValueError

    monkeypatch.setattr(explaining_module.HJI, "sets", refused)
    table = solved(line(), 17)
    for q in ([5.4], [4.0]):
        says = table.explain(q)
        assert not says.causes and says.helps == (UNKNOWN,)


def test_states_at_any_step():
    """Of a target that comes later, and of every step: the grid answers for the entry that is asked for."""
    steps = 3
    moving = replace(
        line(),
        target=sdhj.TargetSet((0,), lambda p, t: np.abs(p[:, 0] - 6.0 - 0.3 * t) - 1.3),
        steps=steps,
    )
    table = solved(moving, 30)
    for step in range(steps):
        for within in range(1, steps - step + 1):
            says = table.explain([0.5], step, within)
            assert not says.inside and says.helps


@pytest.mark.parametrize("memory", [True, False])
def test_what_may_be_measured_is_looked_up_by_boxes_too(monkeypatch, memory):
    """Where there are many cells around a state: the same states as by every cell, at walls and over a seam as well."""

    def turning(q, u):
        return np.stack([np.cos(q[:, 1]), np.full(len(q), u[0])], axis=1)

    turns = zoo.plane(
        grid=sdhj.Grid([-2, -np.pi], [2, np.pi], (41, 32), periodic=[False, True]),
        dynamics=sdhj.Dynamics([[-1.5], [0.0], [1.5]], turning, [[1], [0]], [0.05]),
        target=zoo.goal(0.0, 0.9),
        delta=0.2,
        steps=6,
        sensing=sdhj.Sensing((0.1, 0.15), memory=memory),
    )
    for problem in (turns, joint(0.05, 0.02, memory)):
        table = solved(problem, 60, 50)
        q = np.random.default_rng(2).uniform(problem.grid.lower, problem.grid.upper, (300, 2))
        by_boxes, by_cells = [], []
        for most, found in ((0, by_boxes), (10**9, by_cells)):
            monkeypatch.setattr(table_module, "MANY", most)
            found.append(table.contains(q))
        assert (by_boxes[0] == by_cells[0]).all() and 0 < by_cells[0].mean() < 1
