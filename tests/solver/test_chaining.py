"""A table as the target of another problem: by the principle of dynamic programming, by plain loops, by the judge."""

import dataclasses

import judge
import numpy as np
import pytest
from zoo import interval_problem, plane, unicycle_problem

import sdhj
from sdhj.formulas.graph import ordered

CERTIFIED = sdhj.Certified(cells=(80,))


def chained(problem, table, within=None, **changed):
    return dataclasses.replace(problem, target=sdhj.TargetSet.from_table(table, within), **changed)


@pytest.mark.parametrize("rate", [0.0, -0.3])
@pytest.mark.parametrize("method", ["hji", CERTIFIED])
def test_the_way_to_a_tube_and_on_is_the_tube_of_the_whole_way(method, rate):
    """S_k^{n + m} is what reaches S^n within m steps, with one clock where a wall comes nearer."""
    problem = interval_problem(steps=5, rate=rate, ends="unsafe")
    whole = sdhj.solve(problem, method, progress=False)
    second = sdhj.solve(chained(problem, whole, within=2), method, progress=False)
    grown = False
    for start, within in ((0, 0), (0, 1), (0, 3), (1, 1), (2, 1)):
        told = whole, (start, within + 2), second, (start, within)
        if method == "hji":
            one, other = (table.values(start=k, within=n) for table, (k, n) in (told[:2], told[2:]))
            # where in the tube's grid a node lies is known to a rounding of 4 m: more than that of a value next to 0
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-15)
        else:
            one, other = (table.bits(start=k, within=n) for table, (k, n) in (told[:2], told[2:]))
            assert np.array_equal(one, other) and one.any() and not one.all()
        grown |= bool(within) and second.fraction(start=0, within=within) > second.fraction(start=0, within=0)
    assert grown


@pytest.mark.parametrize("delay", [0.0, 0.1])
@pytest.mark.parametrize("method", ["hji", CERTIFIED])
def test_the_target_is_empty_between_the_samples_and_after_the_last(method, delay):
    """With a delay the inputs of a step begin so much later, and of these times tubes are."""
    problem = dataclasses.replace(interval_problem(steps=3, rate=-0.3), sensing=sdhj.Sensing(delay=delay))
    table = sdhj.solve(problem, method, progress=False)
    target, points = sdhj.TargetSet.from_table(table), np.array([[0.03], [0.85], [3.9], [9.0]])
    here = [True, True, False, False]
    for t, expected in ((0.5, here), (1.5, here), (0.25, []), (2.0, []), *[(0.5 - delay, [])] * (delay > 0)):
        t += delay
        inside = target.level_set(points, t) <= 0
        assert inside.tolist() == (expected or [False] * 4)
        if method is CERTIFIED:
            low, high = target.level_set.enclosure(points - 1e-3, points + 1e-3, t, t)
            assert ((high <= 0) == inside).all() and ((low <= 0) == inside)[:3].all()
    if method is CERTIFIED:
        with pytest.raises(ValueError, match="depends on time"):
            target.level_set.enclosure(points, points, 0.0, 0.5)


@pytest.mark.parametrize(
    "problem", [lambda: interval_problem(steps=3, rate=-0.3), unicycle_problem], ids=["timed", "turning"]
)
def test_the_tube_of_a_grid_table_is_a_formula(problem, rng):
    """Interpolated as the grid does, outside of it nothing; a look-up for each step at most."""
    problem = problem()
    table, grid = sdhj.solve(problem, progress=False), problem.grid
    tube = sdhj.TargetSet.from_table(table, within=1).level_set
    lower, upper = np.array(grid.lower), np.array(grid.upper)
    points = grid.wrapped(rng.uniform(lower - 0.3, upper + 0.3, (2000, grid.ndim)))
    for step in range(table.steps + 1):
        values = table.values(start=0 if problem.time_invariant else step, within=1)
        expected = np.minimum(grid.interpolate(values, points), max(values.max(), 1.0))
        np.testing.assert_allclose(tube(points, problem.time(step)), expected, rtol=0, atol=1e-14)
        assert (expected <= 0).any() and (expected > 0).any()
    assert tube.depends_on_time != problem.time_invariant and tube.reads.all()
    assert sum(one.op == "gridded" for one in ordered(tube.outputs)) <= (
        1 if problem.time_invariant else table.steps + 1
    )
    low, high = tube.bounds(points - 0.01, points + 0.01, (problem.time(0), problem.time(0)))
    inside = tube(points + rng.uniform(-0.01, 0.01, points.shape), problem.time(0))
    assert (low <= inside).all() and (inside <= high).all()


def test_a_box_that_only_touches_a_cell_may_have_states_of_it():
    """Cells are closed: a point on the border of two is in both, and so is what begins or ends there."""
    table = sdhj.solve(interval_problem(steps=3), CERTIFIED, progress=False)
    bits, edges = table.bits(start=0, within=1), table.axes[0].edges()
    assert 0.1 < bits.mean() < 0.9
    for number, edge in enumerate(edges[1:-1].tolist(), 1):
        below, above = bits[number - 1], bits[number]
        low, high = np.array([[edge], [edge], [edge - 0.01]]), np.array([[edge], [edge + 0.01], [edge]])
        every, some = table.certified_boxes(low, high, start=0, within=1)
        assert some.all() == (below or above) and not every[~some].any()
        assert every[1:].tolist() == [above, below]


@pytest.mark.slow
def test_boxes_are_in_a_set_as_plain_loops_say(rng):
    table = sdhj.solve(unicycle_problem(), sdhj.Certified(cells=(16, 16, 20), parts=4), progress=False)
    bits, edges = table.bits(start=0, within=1), [axis.edges() for axis in table.axes]
    low = rng.uniform([-1.2, -1.2, -3.0], [1.0, 1.0, 2.5], (3000, 3))
    high = low + rng.uniform(0.0, 0.5, low.shape)
    every, some = table.certified_boxes(low, high, start=0, within=1)
    for m in range(len(low)):
        touched = [(edges[k][:-1] < high[m, k]) & (edges[k][1:] > low[m, k]) for k in range(3)]
        part = bits[np.ix_(*touched)]
        assert (every[m], some[m]) == (part.all(), part.any())
    assert 0.005 < every.mean() < some.mean() < 0.9
    past = table.certified_boxes(np.array([[-0.1, -0.1, 3.0]]), np.array([[0.1, 0.1, 3.2]]), start=0, within=1)
    assert past.tolist() == [[False], [True]]


def test_the_way_to_a_grid_tables_tube_is_proved_and_what_is_no_table_refused():
    problem = interval_problem()
    table = sdhj.solve(problem, progress=False)
    second = sdhj.solve(chained(problem, table, within=1), CERTIFIED, progress=False)
    cells = second.bits(start=0, within=0)
    middles = (second.axes[0].edges()[1:] + second.axes[0].edges()[:-1])[:, None] / 2
    assert cells.any() and table.contains(middles[cells], start=0, within=1).all()
    with pytest.raises(ValueError, match=r"what sdhj\.solve returns"):
        sdhj.TargetSet.from_table(problem)
    with pytest.raises(ValueError, match="within"):
        sdhj.TargetSet.from_table(table, within=6)


# ---- a relay, judged: first the fast one that cannot stop, then the slow one, past a disk that moves

STEPS, DELTA = 6, 0.25
INPUTS = (
    np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]),
    np.array([[1.6, 0.5], [1.6, -0.5], [0.0, 1.6]]),
)
WIND = (0.05, 0.1)


def goal(p, t):
    return np.hypot(p[:, 0] - 1.6, p[:, 1]) - 0.7


def disk(p, t):
    return np.hypot(p[:, 0] + 0.6, p[:, 1] + 1.0 - 0.8 * t) - 0.35


def leg(place, **changed):
    usual = {"lower": [-2.5, -1.5], "upper": [2.5, 1.5], "nodes": (51, 31), "delta": DELTA, "steps": STEPS}
    usual |= {"target": sdhj.TargetSet((0, 1), goal), "unsafe": [sdhj.UnsafeSet((0, 1), disk, name="disk")]}
    drift = lambda p, u: u + 0.1 * np.sin(p[:, ::-1])  # noqa: E731
    return plane(INPUTS[place], WIND[place], drift=drift, **usual | changed)


@pytest.mark.slow
def test_no_run_of_two_certified_legs_is_lost(rng):
    method = sdhj.Certified(cells=(100, 60), parts=4)
    first = sdhj.solve(leg(0), method, progress=False)
    second = sdhj.solve(leg(1, target=sdhj.TargetSet.from_table(first)), method, progress=False)
    assert second.fraction(start=0, within=STEPS) > first.fraction(start=0, within=STEPS) + 0.05
    controllers = sdhj.Controller(second), sdhj.Controller(first)
    points = rng.uniform([-2.5, -1.5], [2.5, 1.5], (3000, 2))
    starts = points[second.contains(points, start=0, within=STEPS)]
    played = set()

    def choose(states, step):
        legs = np.full((len(states), 2), -1)
        for leg_number, controller in enumerate(controllers):  # the last one that knows of the state acts
            batch = controller.batch(states, step)
            known = batch.steps_to_go >= 0
            legs[known] = np.stack([np.full(known.sum(), leg_number), controller.choose(batch)[known]], axis=1)
        played.update(legs[:, 0].tolist())
        return np.where((legs < 0).any(axis=1), -1, 10 * legs[:, 0] + legs[:, 1])

    def velocity(states, places, signs, t):
        last = places // 10 == 1
        moved = np.where(last[:, None], INPUTS[0][np.minimum(places % 10, 4)], INPUTS[1][np.minimum(places % 10, 2)])
        wind = np.where(last, WIND[0], WIND[1])[:, None] * signs
        return moved + 0.1 * np.sin(states[:, ::-1]) + wind

    def unsafe(states, t):
        inside = np.minimum(2.5 - np.abs(states[:, 0]), 1.5 - np.abs(states[:, 1])) + 1e-9
        return np.minimum(disk(states, t), inside)

    for signs in (
        lambda states, places, t, end: rng.choice([-1.0, 1.0], states.shape),
        lambda states, places, t, end: np.sign(states - [1.6, 0.0]),
        lambda states, places, t, end: np.sign([-0.6, 0.8 * t - 1.0] - states),
    ):
        outcomes = judge.play(choose, velocity, signs, goal, unsafe, starts, delta=DELTA, steps=STEPS)
        assert len(outcomes) > 400 and (outcomes == "reached").all(), np.unique(outcomes, return_counts=True)
    assert played >= {0, 1}
