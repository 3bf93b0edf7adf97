"""What limits a certified table, by its problem solved again on few nodes and few cells; each advice followed once."""

from dataclasses import replace

import numpy as np
import pytest
from robots import car
from test_safety import double_integrator

import sdhj
from sdhj.certified.explaining import BEYOND, left_out, what_limits
from sdhj.certified.limits import Limits
from sdhj.certified.table import CellSets
from sdhj.common.findings import ResolutionWarning

SLOW, PUSH = 0.4, 0.2371  # m in an interval
COMPASS = [[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]


def solved(problem, *cells):
    return sdhj.solve(problem, sdhj.Certified(cells=cells), progress=False, play=False)


def drawn(problem):
    """Free states outside the target, at random."""
    q = np.random.default_rng(1).uniform(problem.grid.lower, problem.grid.upper, (4000, problem.grid.ndim))
    q = q[problem.unsafe_value(q, 0.0) > 0]
    return q if problem.has_no_target else q[problem.target_value(q, 0.0) > 0]


def told(table, states=None):
    """Names of causes, and of what was added, over all of these states."""
    states = drawn(table.problem) if states is None else states
    causes, added = table.limits.gains(states[~table.contains(states)], 0, table.steps)
    return [one.name for one in causes], [one.helps for one in added]


def share(problem, *cells, of=None):
    """How many of the states of a problem, or of another, are certified."""
    return solved(problem, *cells).contains(drawn(of or problem)).mean()


def line():
    """x on a line of 10 m that stands or moves on, and cells of which no width fits both; a post, and a goal behind."""
    return sdhj.ReachAvoidProblem(
        grid=sdhj.Grid([0.0], [10.0], [41], names=["x"]),
        dynamics=sdhj.Dynamics([[0.0], [SLOW]], [[0.0], [SLOW]], [[1.0]], [PUSH]),
        target=sdhj.TargetSet((0,), lambda p, t: np.abs(p[:, 0] - 8.03) - 1.3),
        unsafe=[sdhj.UnsafeSet((0,), lambda p, t: np.abs(p[:, 0] - 3.0) - 0.4, name="post")],
        delta=1.0,
        steps=12,
    )


def plane(push=0.2, gap=0.6):
    """A point in the plane that goes at 1 m/s along an axis; behind a wall with a gap the target."""

    def wall(p, t):
        return np.maximum(np.abs(p[:, 0] - 0.7) - 0.2, gap / 2 - np.abs(p[:, 1]))

    return sdhj.ReachAvoidProblem(
        grid=sdhj.Grid([-2, -2], [2, 2], [41, 41]),
        dynamics=sdhj.Dynamics(COMPASS, COMPASS, np.eye(2), [push, push]),
        target=sdhj.TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 1.4, p[:, 1]) - 0.45),
        unsafe=[sdhj.UnsafeSet((0, 1), wall, name="wall")],
        delta=0.3,
        steps=12,
    )


def joint(delta, error=0.0, memory=False):
    """A joint before its stops, to be kept from them for ever; rad, rad/s."""

    def drift(q, u):
        return np.stack([q[:, 1], np.full(len(q), u[0])], axis=1)

    return sdhj.ReachAvoidProblem(
        grid=sdhj.Grid([-1, -2], [1, 2], (51, 41), ends=["unsafe", "wall"], names=["q", "v"]),
        dynamics=sdhj.Dynamics([[-4.0], [0.0], [4.0]], drift, [[0], [1]], [0.1]),
        target=None,
        unsafe=[],
        delta=delta,
        steps=None,
        sensing=sdhj.Sensing((0.1 * error, error), memory=memory),
    )


def swing():
    """A pendulum that a weak motor has to stop where it hangs, across the seam of its angle; rad, rad/s."""

    def drift(q, u):
        return np.stack([q[:, 1], 9.81 * np.sin(q[:, 0]) + u[0]], axis=1)

    return sdhj.ReachAvoidProblem(
        grid=sdhj.Grid([-np.pi, -8], [np.pi, 8], (61, 61), periodic=[True, False], names=["a", "w"]),
        dynamics=sdhj.Dynamics([[-4.0], [0.0], [4.0]], drift, [[0.0], [1.0]], [0.3]),
        target=sdhj.TargetSet((0, 1), lambda p, t: np.maximum(np.cos(p[:, 0]) + 0.9, np.abs(p[:, 1]) - 1.4)),
        unsafe=[],
        delta=0.1,
        steps=8,
    )


# ---- what is said, and followed


@pytest.mark.slow
@pytest.mark.parametrize(
    ("problem", "cells"),
    [
        (swing, (40, 40)),
        (lambda: joint(0.1), (50, 40)),
        (plane, (40, 40)),
        (line, (17,)),
        (lambda: replace(car(), steps=8), (28, 28, 26)),
    ],
    ids=["swing", "joint", "plane", "line", "car"],
)
def test_no_other_cause_alone_where_finer_cells_would_do(problem, cells):
    """Four times the cells along each axis tell; of 60 states that these have at most 2 are told otherwise."""
    problem = problem()
    table = solved(problem, *cells)
    fine = solved(problem, *(4 * n for n in table.shape))
    states = drawn(problem)
    states = states[~table.contains(states)]
    states = np.concatenate([some[:60] for some in (states[fine.contains(states)], states[~fine.contains(states)])])
    wrong, told, finer = 0, 0, fine.contains(states)
    for q, has in zip(states, finer, strict=True):
        helps = what_limits(table.limits, q[None], 0, table.steps)[1]
        cells_named = any("more cells" in one or "more than twice" in one for one in helps if one != BEYOND)
        wrong += has and not cells_named
        told += not has and not cells_named
    assert wrong <= 2 and finer.sum() == 60 and told >= 0.5 * (~finer).sum()


def test_a_push_that_is_too_strong():
    """No number of cells helps, and none is advised."""
    strong = solved(plane(push=1.1), 40, 40)
    causes, added = told(strong)
    assert causes == ["push"] and not added
    says = strong.explain([1.4, 1.0])
    assert says.causes == ("push",) and says.helps[0] == "a smaller disturbance or stronger inputs"
    assert "What keeps it out: push" in str(says)
    followed = share(plane(push=0.3), 40, 40, of=plane(push=1.1))
    assert followed > 0.1 > share(plane(push=1.1), 80, 80, of=plane(push=1.1))


def test_a_gap_that_is_too_narrow():
    """The wall is named, and a wider gap gains what more cells do not."""
    narrow = plane(gap=0.05)
    before = drawn(narrow)[drawn(narrow)[:, 0] < 0.4]
    causes, added = told(solved(narrow, 160, 160), before)
    assert causes[0] == "clearance of 'wall'" and not any("more cells" in one for one in added)
    assert not solved(narrow, 160, 160).contains(before).any()
    assert solved(plane(gap=1.0), 160, 160).contains(before).mean() > 0.3


@pytest.mark.slow
def test_noise_and_a_controller_that_remembers():
    noisy = joint(0.02, 0.05)
    table = solved(noisy, 120, 120)
    causes, added = told(table)
    assert "noise" in causes and "Sensing(..., memory=True) and Controller.step" in added
    before, remembers = share(noisy, 120, 120), share(joint(0.02, 0.05, True), 120, 120)
    assert remembers > before + 0.3 and share(joint(0.02, 0.01), 120, 120) > before + 0.3


@pytest.mark.slow
def test_creep():
    """What moves less than a cell in an interval is rounded out; a longer interval helps, and cells along one axis."""
    fast = joint(0.01)
    causes, added = told(solved(fast, 80, 80))
    assert causes == ["creep"]
    assert {"inputs held for two periods, delta=0.02", "more cells along v"} <= set(added)
    before = share(fast, 80, 80)
    assert (
        share(joint(0.02), 80, 80) > before + 0.3 and share(fast, 80, 160) > before + 0.3 and not share(fast, 160, 80)
    )


def test_an_empty_set_for_ever_says_how_long_to_hold_an_input(solves_are_played):
    """A cart that moves a part of a cell in 20 ms: an input held for three periods is as good as finer cells."""
    cart, cells = replace(double_integrator(None, 0.6), delta=0.02), sdhj.Certified(cells=(80, 80))
    with pytest.warns(ResolutionWarning, match=r"inputs held for three periods, delta=0\.06"):
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
    return sdhj.ReachAvoidProblem(grid, dynamics, None, [], 0.1, None)


def test_an_axis_may_be_left_out_for_which_nothing_is_promised_then():
    (told,) = left_out(pole([0, 1, 2, 3]))
    assert told == "x left out, which no velocity depends on; then it is not promised to stay between -1.5 and 1.5"
    (told,) = left_out(pole([1, 2, 3]))
    assert told.startswith("v left out") and left_out(joint(0.01)) == []


@pytest.mark.slow
def test_a_pole_is_kept_upright_where_the_track_is_left_out():
    """Six seconds prove nothing with the track, and half of the states without."""
    with_track, without = (
        sdhj.solve(pole(axes), sdhj.Certified(seconds=6), progress=False, play=False).fraction()
        for axes in ([0, 1, 2, 3], [1, 2, 3])
    )
    assert with_track == 0.0 and without > 0.5


@pytest.mark.slow
def test_more_than_twice_the_cells():
    """Where twice the cells along an axis still prove nothing, and eight times as many do."""
    says = solved(joint(0.01), 20, 20).explain([0.0, 0.0])
    assert (
        says.causes == ("creep",)
        and "more than twice the cells" in says.helps[-1]
        and "copies of 20 x " in says.helps[-1]
    )
    assert solved(joint(0.01), 80, 160).contains([[0.0, 0.0]])[0]


@pytest.mark.slow
def test_more_cells_along_an_axis():
    """README's car, on few cells: rounding is the cause, and cells that are said to help do."""
    problem = replace(car(), steps=8)
    coarse = solved(problem, 32, 32, 31)
    causes, added = told(coarse)
    assert causes[0] == "rounding" and added[0].startswith("more cells along")
    each = zip((32, 32, 31), problem.grid.names, strict=True)
    cells = [n * (1 + any(one.endswith(name) for one in added)) for n, name in each]
    assert cells != [32, 32, 31] and share(problem, *cells) > coarse.contains(drawn(problem)).mean() + 0.05


def test_nothing_is_paid_where_nothing_is_said(solves_are_played):
    """A table that is not scanty has no copies, until it is asked why."""
    table = sdhj.solve(line(), sdhj.Certified(cells=[200]), progress=False)
    assert "limits" not in vars(table) and "findings" not in table.details
    assert table.explain([0.5]).failures and "limits" in vars(table)


def test_of_many_cells_there_are_only_so_many_nodes(monkeypatch):
    table, nodes = solved(plane(), 1000, 1000), []
    for most in (1_000_000, 6000):
        monkeypatch.setattr("sdhj.certified.limits.MOST_NODES", most)
        nodes.append(Limits(table, CellSets).grid.problem.grid.size)
    assert nodes == [101 * 101, 78 * 78]


def test_where_there_are_no_copies(monkeypatch):
    """Where intervals cannot evaluate a function, or a grid takes no black box: what is not tried is not claimed."""

    def refused(*_):
        raise ValueError

    won, lost = [5.4], [4.0]  # on this side of where the push lets it come from, 4.77, and on the other
    monkeypatch.setattr("sdhj.certified.limits.CoarseProof.prepare", refused)
    assert solved(line(), 17).explain(won).causes == ("rounding",)
    assert "cannot be tried" in solved(line(), 17).explain(won).helps[0]
    assert solved(line(), 17).explain(lost).causes == ("push",)
    monkeypatch.setattr("sdhj.certified.limits.HJI.sets", refused)
    for q in (won, lost):
        says = solved(line(), 17).explain(q)
        assert not says.causes and "not known whether more cells" in says.helps[0]


def test_what_is_out_of_reach():
    """A state 1.23 m before the target, which has 2 steps of 0.4 m: more steps, or stronger inputs, and no cells."""
    calm = sdhj.Dynamics([[0.0], [SLOW]], [[0.0], [SLOW]])
    near = replace(line(), dynamics=calm, unsafe=[], steps=2)
    says = solved(near, 100).explain([5.5])
    assert says.causes == ("few steps",) and says.helps == ("more steps",)
    assert solved(replace(near, steps=8), 100).contains([[5.5]])[0]
    far = solved(near, 100).explain([0.5])
    assert not far.causes and "nothing that was tried" in far.helps[0]


def test_inputs_that_are_twice_as_strong():
    """About their mean: as plain numbers have it, of constants and of a function of the state."""
    for problem in (line(), car()):
        q = np.random.default_rng(0).uniform(problem.grid.lower, problem.grid.upper, (50, problem.grid.ndim))
        strong = problem.dynamics.stronger()
        drifts = np.stack([problem.dynamics.drift_at(q, j) for j in range(len(problem.inputs))])
        for j, drift in enumerate(drifts):
            assert np.allclose(strong.drift_at(q, j), 2 * drift - drifts.mean(axis=0), atol=1e-12)


@pytest.mark.parametrize("steps", [3, 4])
def test_states_at_any_step(steps):
    """Of a target that comes later, and of every step: copies answer for the entry that is asked for."""
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


def test_what_cannot_be_tried_is_left_out():
    """A problem needs something to stay clear of; so its only set is not taken away, and what else can be tried is."""
    problem = sdhj.ReachAvoidProblem(
        grid=sdhj.Grid([0.0], [10.0], [41], periodic=[True]),
        dynamics=sdhj.Dynamics([[0.0], [1.0]], [[0.3], [1.0]], [[1.0]], [0.2]),
        target=None,
        unsafe=[sdhj.UnsafeSet((0,), lambda p, t: np.abs(p[:, 0] - 3.0) - 0.4, name="post")],
        delta=1.0,
        steps=20,
    )
    table = solved(problem, 20)
    assert not table.fraction() and table.explain([7.0]).helps
    tried = [cause or helps for cause, helps in table.limits.tried]
    assert "push" in tried
    with pytest.raises(ValueError, match="unsafe"):
        replace(problem, unsafe=[])
    assert "clearance of 'post'" not in tried


@pytest.mark.parametrize("memory", [True, False])
def test_what_may_be_measured_is_looked_up_by_boxes_too(monkeypatch, memory):
    """Where there are many cells around a state: the same states as by every cell, at walls and over a seam as well."""

    def turning(q, u):
        return np.stack([np.cos(q[:, 1]), np.full(len(q), u[0])], axis=1)

    turns = sdhj.ReachAvoidProblem(
        grid=sdhj.Grid([-2, -np.pi], [2, np.pi], (41, 32), periodic=[False, True]),
        dynamics=sdhj.Dynamics([[-1.5], [0.0], [1.5]], turning, [[1], [0]], [0.05]),
        target=sdhj.TargetSet((0,), lambda p, t: np.abs(p[:, 0]) - 0.9),
        unsafe=[],
        delta=0.2,
        steps=6,
        sensing=sdhj.Sensing((0.1, 0.15), memory=memory),
    )
    for problem in (turns, joint(0.05, 0.02, memory)):
        table = solved(problem, 90, 70)
        q = np.random.default_rng(2).uniform(problem.grid.lower, problem.grid.upper, (3000, 2))
        by_boxes, by_cells = [], []
        for most, found in ((0, by_boxes), (10**9, by_cells)):
            monkeypatch.setattr("sdhj.certified.table.MANY", most)
            found.append(table.contains(q))
        assert (by_boxes[0] == by_cells[0]).all() and 0 < by_cells[0].mean() < 1
