"""Leaving over a safe end is winning: closed forms, a wider grid, proofs, and a plant that knows no grid."""

from dataclasses import replace
from functools import cache
from itertools import product

import judge
import numpy as np
import pytest
import zoo
from plain import run_plainly
from zoo import line, post

import sdhj
from sdhj import HJI, Controller, Grid, HopfLax, Projected, Scheme, UnsafeSet
from sdhj.certified.sets import Certified
from sdhj.problem.samples import Samples
from sdhj.solver.joint import Joint

METHODS = {
    "hji": HJI(),
    "fixed": HJI(Scheme(frame="fixed")),
    "fixed, third order": HJI(Scheme(order=3, integrator="rk3", frame="fixed")),
    "joint": Joint(),
    "projected": Projected([(0, 1)]),
    "lax": HopfLax(),
}
# what is compiled for one order alone is slow; of one axis it also runs as plain Python
USED = [pytest.param(name, marks=pytest.mark.slow if "third" in name else ()) for name in METHODS]
CENTRE, RADIUS = np.array([1.0, 1.5]), 0.3  # half of the disk is beyond the end at x = 1


def disk(centre, radius, name="disk"):
    return UnsafeSet((0, 1), lambda p, t: np.hypot(*(p - centre).T) - radius, name=name)


def stream(delta, nodes=(41, 61)):
    """Everything drifts at (1, 1), whatever the input; two seconds are enough to leave."""
    usual = {"upper": [1.0, 2.0], "nodes": nodes, "ends": ["safe", "wall"], "drift": [[1.0, 1.0]]}
    return zoo.raft([0.0], 0.0, **usual, unsafe=[disk(CENTRE, RADIUS)], delta=delta, steps=round(2 / delta))


def swept_away(points):
    """Whether the drift takes states into the disk before x = 1: by the nearest point of each way."""
    way = np.clip(((CENTRE - points) @ [1.0, 1.0]) / 2, 0.0, 1.0 - points[:, 0])
    return np.hypot(*(points + way[:, None] - CENTRE).T) <= RADIUS


def share_swept_away():
    """Of the box, by y - x: the ways that meet the disk left of x = 1, from x = -1 to where they leave it."""
    offset = np.linspace(0.2, 0.5 + RADIUS * np.sqrt(2), 100_001)
    chord = np.sqrt(np.maximum(RADIUS**2 - (offset - 0.5) ** 2 / 2, 0.0) / 2)
    length = np.minimum(1.0, 1.0 - (offset - 0.5) / 2 + chord) + 1.0
    return float(np.trapezoid(length, offset)) / 6


def within_cells(grid, wrong, truth, cells):
    """Whether each of the wrong nodes is that near to states for which the truth is another."""
    points = grid.points()[wrong.ravel()]
    shifts = np.array(list(product(np.linspace(-cells, cells, 4 * cells + 1), repeat=grid.ndim))) * grid.spacing
    around = truth((points + shifts[:, None]).reshape(-1, grid.ndim)).reshape(len(shifts), len(points))
    return (around != truth(points)).any(axis=0).all()


@pytest.mark.parametrize("method", USED)
@pytest.mark.parametrize("delta", [pytest.param(0.1, marks=pytest.mark.slow), 2.0])
def test_a_stream_against_its_closed_form(method, delta):
    """The interval may be as long as the whole way: wrong within a cell of the boundary only, less on finer grids."""
    exact, errors = share_swept_away(), []
    for nodes in ((41, 61), (81, 121)):
        table = sdhj.solve(stream(delta, nodes), METHODS[method], progress=False)
        unsafe, grid = table.values(start=0, within=table.steps) > 0, table.grid
        truth = swept_away(grid.points()).reshape(grid.shape)
        assert within_cells(grid, unsafe & ~truth, swept_away, 2) and within_cells(grid, truth & ~unsafe, swept_away, 1)
        assert grid.fraction(truth & ~unsafe) < 1e-3  # where it errs, it errs to the safe side
        errors.append(grid.fraction(unsafe) - exact)
    assert 0 < errors[1] < 0.01 < 0.02 > errors[0] > errors[1]  # a cell of the coarser: 0.05 * 2 / 6 on each side


HIGH, HUB, HOLE = np.array([1.0, 0.9]), np.array([-0.8, 0.0]), 0.15


def whirl(nodes=(61, 55), delta=1.5):
    """A turn about the origin at 1 rad/s: what goes over a safe end is brought back by it, and no longer counts."""
    return zoo.plane(
        [[0.0]],
        drift=lambda p: np.stack([-p[:, 1], p[:, 0]], axis=1),
        **zoo.ALONE,
        lower=-HIGH,
        upper=HIGH,
        nodes=nodes,
        ends="safe",
        target=None,
        unsafe=[disk(HUB, HOLE)],
        delta=delta,
        steps=4,
    )


def turned_into(points, time=6.0):
    """Whether states meet the disk before they leave; by many instants of the exact motion."""
    met, there = np.zeros(len(points), bool), np.ones(len(points), bool)
    for angle in np.linspace(0.0, time, 600):
        c, s = np.cos(angle), np.sin(angle)
        now = points @ np.array([[c, s], [-s, c]])
        there &= (np.abs(now) <= HIGH + 1e-9).all(axis=1)
        met |= there & (np.hypot(*(now - HUB).T) <= HOLE)
    return met


@cache
def turned_into_at_nodes():
    grid = whirl().grid
    return turned_into(grid.points()).reshape(grid.shape)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in USED if name.values[0] != "lax"])
def test_what_has_left_does_not_come_back(name):
    problem = whirl()
    table = sdhj.solve(problem, METHODS[name], progress=False)
    unsafe, truth = table.values(start=0, within=4) > 0, turned_into_at_nodes()
    assert within_cells(table.grid, unsafe != truth, turned_into, 2)
    assert np.mean(unsafe != truth) < 0.1 * truth.mean()
    outside = np.hypot(*table.grid.points().T).reshape(table.grid.shape) > 0.96  # met only after having left
    assert not unsafe[outside].any() and truth.mean() > 0.1


@pytest.mark.parametrize("delta", [pytest.param(0.1, marks=pytest.mark.slow), 1.0])
def test_a_proof_counts_what_has_left(delta, rng):
    """Nothing of the stream that meets the disk is certified, and nothing but some layers of cells is missing."""
    missing = []
    for cells, parts in (((40, 60), 10), ((80, 120), 80)):
        table = sdhj.solve(stream(delta), Certified(cells=cells, parts=parts), progress=False)
        states = rng.uniform(table.grid.lower, table.grid.upper, (100_000, 2))
        inside = table.contains(states, start=0, within=table.steps)
        assert not (inside & swept_away(states)).any()
        missing.append(np.mean(~inside & ~swept_away(states)))
    assert missing[1] < 0.05 and missing[1] < 0.7 * missing[0]


@pytest.mark.slow
def test_a_proof_for_the_whirl(rng):
    table = sdhj.solve(whirl(delta=0.5), Certified(cells=(120, 108), parts=12), progress=False)
    states = rng.uniform(-HIGH, HIGH, (5_000, 2))
    inside, met = table.contains(states, start=0, within=4), turned_into(states, 2.0)
    assert not (inside & met).any() and inside.mean() > 0.5
    gone = states[:, 0] > 0.97  # up and over the end y = 0.9, or x = 1 before
    assert gone.any() and inside[gone].all()


CRAFT = np.array([[1.0, -1.0], [1.0, 0.0], [1.0, 1.0]])


def craft(side, nodes, **changed):
    """The raft, +- 0.3 either way, between unsafe banks, on as much of the river."""
    return zoo.raft(lower=[-side, -1.0], upper=[side, 1.0], nodes=nodes, ends=["safe", "unsafe"], **changed)


@pytest.mark.slow
@pytest.mark.parametrize("method", USED)
@pytest.mark.parametrize("moving", [False, True])
def test_the_grid_may_as_well_go_on(method, moving):
    """The river is the same on a grid with 40 cells more on each side, where nothing is in the way; for a moving disk
    too.
    """
    boat = UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 0.5 + 0.4 * t, p[:, 1]) - 0.45, name="boat")
    moved = {"unsafe": [boat]} if moving else {}
    near = sdhj.solve(craft(1.0, 41, **moved), METHODS[method], progress=False)
    far = sdhj.solve(craft(3.0, (121, 41), **moved), METHODS[method], progress=False)
    one, other = (table.values(start=0, within=table.steps) <= 0 for table in (near, far))
    other = other[40:-40]
    assert 0.2 < one.mean() < 0.6
    assert (one & ~other).mean() < 0.003 and (other & ~one).mean() < 0.01, (
        (one & ~other).mean(),
        (other & ~one).mean(),
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hji", "lax"])
def test_runs_on_the_true_river_are_not_lost(name, rng):
    table = sdhj.solve(craft(1.0, 81), METHODS[name], progress=False)
    controller, states = Controller(table), rng.uniform(-1, 1, (6_000, 2))
    starts = states[table.contains(states, start=0, within=table.steps)]

    def choose(q, step):
        chosen = controller.choose(controller.batch(q, step))
        return np.where(np.abs(q[:, 0]) > 1.0, 1, chosen)  # out of danger: straight on

    def danger(q, t):
        inside = np.minimum(np.hypot(q[:, 0] - 0.5, q[:, 1]) - 0.45, 1.0 + 1e-9 - np.abs(q[:, 1]))
        return np.where(q[:, 0] > 1.0, 1.0, inside)

    outcomes = judge.play(
        choose,
        lambda q, u, v, t: np.where(q[:, :1] > 1.0, 0.0, CRAFT[np.maximum(u, 0)] + 0.3 * v),  # out: for good
        lambda q, u, t, end: rng.choice([-1.0, 1.0], q.shape),
        lambda q, t: np.ones(len(q)),
        danger,
        starts,
        delta=0.4,
        steps=table.steps,
    )
    assert len(starts) > 1500 and np.mean(outcomes != "late") < 0.005, np.unique(outcomes, return_counts=True)
    # by the worst adversary the channels of few cells lose more, at |x| <= 1 as many as on a grid that goes on to 3
    assert sdhj.monte_carlo(controller, 1000, progress=False).rate("reached") > 0.96


def test_what_is_past_a_safe_end_after_the_interval_has_all_margin():
    table = sdhj.solve(stream(0.5), "lax", progress=False)
    batch = Controller(table).batch(np.array([[0.9, -0.5], [0.3, -0.5], [0.9, 1.2], [-0.95, -0.5]]), 0)
    assert batch.margins[0, 0] == -np.inf and -np.inf < batch.margins[1, 0] <= 0
    assert batch.promised.tolist() == [True, True, False, False]
    with pytest.raises(sdhj.NotAdmissible, match="past a safe end"):
        Controller(table).select([1.2, 0.0], 0)


@pytest.mark.slow
def test_one_end_safe_and_the_other_unsafe(monkeypatch):
    """A runner at 1 +- 0.5 to either side, on [0, 4]: only the upper end lets it go, and it must turn in time."""
    problem = line(
        (-1.0, 1.0),
        0.5,
        grid=Grid([0.0], [4.0], (81,), ends=[("unsafe", "safe")]),
        target=None,
        unsafe=[post(1.0, 0.3)],
        steps=30,
    )
    for method in sorted(METHODS, key=lambda name: "third" in name):
        if "third" in method:
            run_plainly(monkeypatch)
        if method != "projected":
            table = sdhj.solve(problem, METHODS[method], progress=False)
            inside, x = table.values(start=0, within=30) <= 0, table.grid.nodes(0)
            # below the gap there is no room: 1.5 * 0.5 in an interval; above it everything escapes
            assert not inside[x < 1.2].any() and inside[x > 1.35].all()
    assert Samples(replace(problem, steps=3)).padded.grid.inner == (slice(0, 81),)
