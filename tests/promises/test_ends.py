"""The ends of an axis say what they are, judged by a plant that knows no grid (`tests/lib/judge.py`)."""

from dataclasses import replace

import judge
import numpy as np
import pytest
from zoo import ALONE, cart, interval_problem, line, plane, post, unicycle_problem

import sdhj
from sdhj import HJI, Controller, Dynamics, Grid, HopfLax, Projected, TargetSet, UnsafeSet
from sdhj.simulation.outcomes import OUTCOMES
from sdhj.solver.joint import Joint

HALF = np.array([1.0, 0.8])
ACCELERATIONS = np.linspace(-3.0, 3.0, 7)


def double_integrator(ends="unsafe", nodes=(41, 33), disturbance=0.0):
    """Position and velocity in [-1, 1] x [-0.8, 0.8]; most fast states leave, whatever is done."""
    target = TargetSet((0, 1), lambda p, t: np.abs(p).max(axis=1) - 0.15)
    return cart(ACCELERATIONS, disturbance, grid=Grid(-HALF, HALF, nodes, ends=ends), target=target, steps=8)


def judged(table, runs, rng, disturbance=0.0):
    """How runs end on the true plant, from states drawn uniformly inside: leaving the box is colliding."""
    controller, starts = Controller(table), rng.uniform(-HALF, HALF, (40 * runs, 2))
    starts = starts[table.contains(starts, start=0, within=8)][:runs]
    assert len(starts) == runs

    def velocity(states, inputs, signs, t):
        u = ACCELERATIONS[np.maximum(inputs, 0)]
        return np.stack([states[:, 1], u + disturbance * signs[:, 0]], axis=1)

    return judge.play(
        lambda states, step: controller.choose(controller.batch(states, step)),
        velocity,
        lambda states, inputs, t, end: rng.choice([-1.0, 1.0], (len(states), 1)),
        lambda states, t: np.abs(states).max(axis=1) - 0.15,
        lambda states, t: (HALF - np.abs(states)).min(axis=1) + 1e-9,
        starts,
        delta=0.1,
        steps=8,
    )


def test_hji_loses_next_to_nothing_where_the_robot_can_leave_the_grid(rng):
    lost = {}
    for ends in ("wall", "unsafe"):
        table = sdhj.solve(double_integrator(ends, disturbance=0.3))
        lost[ends] = (judged(table, 1_500, rng, 0.3) != "reached").mean()
    assert lost["wall"] > 0.2  # the judge sees it
    assert lost["unsafe"] < 0.005


@pytest.mark.slow
def test_no_certified_start_is_lost(rng):
    method, outcomes = sdhj.Certified(cells=(120, 96)), {}
    for ends in ("wall", "unsafe"):
        outcomes[ends] = judged(sdhj.solve(double_integrator(ends, disturbance=0.1), method), 2000, rng, 0.1)
    assert (outcomes["wall"] != "reached").mean() > 0.05 and (outcomes["unsafe"] == "reached").all()


def leaving(ends, lower=-4.0, upper=4.0, nodes=81, part=None):
    """dq = u + v with |v| <= 0.2, u in {-1, 0, 1}; the target is wide enough for the table to reach both ends."""
    problem = interval_problem(steps=8, unsafe=False)
    dynamics = Dynamics([[-2.0], [2.0]], [[-2.0], [2.0]], [[1.0]], [0.2])  # no rest: it has to move
    grid = Grid([lower], [upper], [nodes], ends=ends)
    return replace(problem, grid=grid, dynamics=dynamics, unsafe=() if part is None else (part,), delta=0.25)


METHODS = {
    "hji": HJI(),
    "fixed": HJI(sdhj.Scheme(frame="fixed")),
    "joint": Joint(),
    "lax": HopfLax("linear"),
}


@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
def test_an_unsafe_end_is_an_unsafe_set_that_begins_there(method):
    """On a wider grid the same states are lost to an explicit set beyond +-4; the end itself is safe."""
    beyond = UnsafeSet((0,), lambda p, t: 4.0 - np.abs(p[:, 0]) + 1e-7, name="beyond")
    table = sdhj.solve(leaving("unsafe"), method)
    wide = sdhj.solve(leaving("wall", -6.0, 6.0, 121, beyond), method)
    assert table.avoid.static_axes == (0,)
    inside = slice(20, 101)
    # differences of second order feel the wall of a grid, beyond -6 or farther, by a tenth less at each node
    np.testing.assert_allclose(table.avoid.static, wide.avoid.static[:, inside], rtol=0, atol=1e-6)
    for within in range(9):
        marks = wide.inputs(start=0, within=within)[inside]
        assert np.array_equal(table.inputs(start=0, within=within), marks)
    # under u = 2 and the worst v, 2.2 * 0.25 = 0.55 is travelled in an interval
    safe = table.avoid.static[1] <= 0.0
    assert np.array_equal(safe, table.grid.nodes(0) <= 4.0 - 0.55 + 1e-9)


def test_each_face_is_its_own():
    low, high = (sdhj.solve(leaving([ends])) for ends in (("unsafe", "wall"), ("wall", "unsafe")))
    both, walls = (sdhj.solve(leaving(ends)) for ends in ("unsafe", "wall"))
    assert walls.avoid.static_axes == ()
    for j in range(2):
        assert np.array_equal(np.maximum(low.avoid.static[j], high.avoid.static[j]) <= 0, both.avoid.static[j] <= 0)
    assert (low.avoid.static[1] <= 0).all() and not (high.avoid.static[1] <= 0).all()


def test_the_ends_of_a_subspace_count_in_the_projected_method(rng):
    """Three axes of a unicycle, of which only x and y can be left; projections are inside the full tubes."""

    problem = replace(
        unicycle_problem(steps=4),
        grid=Grid([-1.5, -1.5, -np.pi], [1.5, 1.5, np.pi], (25, 25, 24), [False, False, True]),
        unsafe=(),
    )
    full, projected = sdhj.solve(problem), sdhj.solve(problem, Projected([(0, 1, 2)]))
    np.testing.assert_allclose(projected.avoid.static, full.avoid.static, rtol=0, atol=1e-6)
    at_the_edge = np.array([[1.4, 0.0, 0.0], [-1.4, 0.0, np.pi - 0.1]])  # heading out: 0.2 m in an interval
    assert not Controller(full).batch(at_the_edge, 0).promised.any()


@pytest.mark.parametrize(
    "method", [HJI(), HopfLax("linear"), sdhj.Certified(cells=[200], parts=20)], ids=["hji", "lax", "certified"]
)
def test_of_a_current_each_step_has_ends_of_its_own(method):
    """Who is carried past an end at an instant of the interval is lost; the current's way is added up, by instants."""
    current = lambda t: t * np.sin(4.0 * np.pi * t)  # noqa: E731  # out and back
    problem = line(
        [0.0], lower=[-1.0], upper=[1.0], drift=lambda q, u, t: u + current(t) + 0.0 * q, target=None, **ALONE
    )
    table = sdhj.solve(problem, method, play=False)
    for step in range(3):
        times = np.linspace(0.5 * step, 0.5 * (step + 1), 10_001)
        way = np.cumsum(current(times)) * 0.5 / 10_000
        ends = np.array([-1.0 - min(way.min(), 0.0), 1.0 - max(way.max(), 0.0)])
        inside = table.contains(np.concatenate([ends - 0.02, ends + 0.02])[:, None], start=step, within=1)
        assert inside.tolist() == [False, True, True, False]


@pytest.mark.parametrize("end", ["unsafe", "safe"])
@pytest.mark.parametrize(("axis", "side"), [(0, 1.0), (1, -1.0)])
def test_margins_tell_where_what_an_input_leads_to_is_past_an_end(end, axis, side):
    """Inputs lead 0.1 m on, up to 0.05 m off; past an unsafe end a part is too much, past a safe one all has won."""
    ends = [["wall", "wall"], ["wall", "wall"]]
    ends[axis][int(side > 0)] = end
    problem = plane(
        push=0.5,
        lower=[-1.0, -1.0],
        upper=[1.0, 1.0],
        nodes=21,
        ends=ends,
        target=None,
        unsafe=[post(-0.5, -0.5, 0.2)],
        delta=0.1,
        steps=1,
    )
    table = sdhj.solve(problem, HJI(), play=False)
    states = np.zeros((5, 2))
    states[:, axis] = side * np.array([0.5, 0.84, 0.86, 0.94, 0.96])
    told, middle = table.batch(states, 0), np.abs(states[:, axis, None] + 0.1 * problem.inputs[:, axis])
    assert told.promised.all()
    np.testing.assert_array_equal(told.margins == np.inf, (middle + 0.05 > 1.0) & (end == "unsafe"))
    np.testing.assert_array_equal(told.margins == -np.inf, (middle - 0.05 > 1.0) & (end == "safe"))


def test_runs_that_leave_the_grid_are_counted_apart():
    """Also where a table for calm days is played in a storm: past unsafe ends runs are lost, at walls they stop."""
    walled, cautious = (Controller(sdhj.solve(double_integrator(ends))) for ends in ("wall", "unsafe"))
    assert sdhj.monte_carlo(walled, 500).counts["off the grid"] == 0
    assert sdhj.monte_carlo(cautious, 500).rate("off the grid") < 0.005
    storms = (double_integrator(ends, disturbance=4.0) for ends in ("wall", "unsafe"))
    walled, lost = (Controller(replace(cautious.table, problem=storm)) for storm in storms)
    report = sdhj.monte_carlo(lost, 500)
    assert report.rate("off the grid") > 0.2 and sdhj.monte_carlo(walled, 500).counts["off the grid"] == 0
    start = report.starts[report.outcomes == OUTCOMES.index("off the grid")][0]
    run = sdhj.simulate(lost, start)
    assert run.outcome == "off the grid" and (np.abs(run.states[-1]) > HALF).any()
    assert (np.abs(sdhj.simulate(walled, start).states) <= HALF).all()


def test_ends_are_kept_in_files_and_tell_problems_apart(tmp_path):
    problem = leaving([("unsafe", "wall")])
    path = tmp_path / "table.npz"
    sdhj.solve(problem).save(path)
    assert sdhj.load(path, problem=problem).grid.ends == (("unsafe", "wall"),)
    with pytest.raises(sdhj.TableFileError, match="another problem"):
        sdhj.load(path, problem=leaving("unsafe"))
    assert problem.digest != leaving("wall").digest


@pytest.mark.parametrize("ends", ["open", ["wall", "wall"], [("wall", "wall", "safe")], 7])
def test_ends_that_are_none_are_refused(ends):
    with pytest.raises(ValueError, match="ends "):
        Grid([0.0], [1.0], [9], ends=ends)


def test_periodic_axes_have_no_ends():
    low, high = Grid([0.0, 0.0], [1.0, 1.0], [9, 9], [True, False]).faces("fails")
    assert low.tolist() == [-np.inf, 0.0] and high.tolist() == [np.inf, 1.0]
