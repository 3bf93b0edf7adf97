"""Theorem 2 and the look-up table: against a slow twin, closed forms, published fractions, and as the grid refines."""

import dataclasses
import gc
import itertools

import naive
import numpy as np
import pytest
from zoo import cart, interval_problem, torus_problem, unicycle_problem

import sdhj
from sdhj import HJI, HopfLax, Projected, Scheme
from sdhj.problem.samples import Samples
from sdhj.solver.games import HJIGames, HopfLaxGames
from sdhj.solver.joint import Joint
from sdhj.solver.recursion import GridSets, recursion

FIXED = Scheme(frame="fixed")
LINEAR = HopfLax("linear")


class FiniteSets:
    """`sdhj.solver.recursion.TubeSets` of whole numbers: a game on few states that a child could play out.

    goals[k]: the states to be in at step k; leads[k][j][q]: the states that u_j may lead to from q, empty where it is
    not safe there. Where `time_invariant`, all steps are step 0.
    """

    def __init__(self, goals, leads, time_invariant):
        self.goals, self.leads, self.time_invariant = goals, leads, time_invariant
        self.entries, self.calls = {}, []

    def key(self, step, within):
        return (0 if self.time_invariant else step), within

    def begin(self):
        self.entries.clear()

    def write_goal(self, step):
        self.calls.append(("goal", step))
        self.entries[self.key(step, 0)] = frozenset(self.goals[step])

    def extend(self, step, within):
        self.calls.append(("extend", step, within))
        later = self.entries[self.key(step + 1, within - 1)]
        won = {q for lead in self.leads[step] for q, ends in enumerate(lead) if ends and ends <= later}
        self.entries[self.key(step, within)] = self.entries[self.key(step, within - 1)] | won

    def unchanged(self, step, within):
        return self.entries[self.key(step, within)] == self.entries[self.key(step, within - 1)]

    def repeat(self, step, within):
        self.calls.append(("share", step, within))
        self.entries[self.key(step, within)] = self.entries[self.key(step, within - 1)]

    def finish(self, details):
        return self


def random_game(rng, states, inputs, steps, time_invariant):
    rows = 1 if time_invariant else steps + 1
    goals = [set(rng.choice(states, 2, replace=False).tolist()) for _ in range(rows)] * (
        steps + 1 if time_invariant else 1
    )
    leads = [
        [
            [frozenset(rng.choice(states, rng.integers(0, 3), replace=False).tolist()) for _ in range(states)]
            for _ in range(inputs)
        ]
        for _ in range(rows)
    ] * (steps + 1 if time_invariant else 1)
    return goals, leads


@pytest.mark.parametrize("time_invariant", [False, True])
def test_theorem_2_is_the_game_played_out(rng, time_invariant):
    """Definition 4 by brute force: q wins within n steps where it is in the goal, or an input is safe and leads to
    states all of which win within n - 1 steps from the next step on."""
    steps, states, shared = 6, 12, 0
    for _ in range(30):
        goals, leads = random_game(rng, states, 2, steps, time_invariant)

        def wins(step, q, within, goals=goals, leads=leads):
            if q in goals[step]:
                return True
            ends = [lead[q] for lead in leads[step] if lead[q]] if within else []
            return any(all(wins(step + 1, end, within - 1) for end in each) for each in ends)

        ticks = []
        sets = FiniteSets(goals, leads, time_invariant)
        sets.time_invariant = time_invariant
        recursion(sets, steps, lambda ticks=ticks: ticks.append(1))
        for step in (0,) if time_invariant else range(steps + 1):
            for within in range(steps - step + 1):
                won = {q for q in range(states) if wins(step, q, within)}
                assert sets.entries[step, within] == won, (step, within)
        assert len(ticks) == (steps if time_invariant else steps * (steps + 1) // 2)
        shared += sum(call[0] == "share" for call in sets.calls)
    assert shared > 30  # what has stopped growing is not computed again


@pytest.mark.parametrize("method", ["hji", "lax"])
def test_table_equals_the_slow_recursion(method):
    problem = torus_problem(nodes=9, steps=3)
    table = sdhj.solve(problem, {"hji": HJI(), "lax": LINEAR}[method])
    games = (
        HJIGames(Samples(problem), Scheme()) if method == "hji" else HopfLaxGames(Samples(problem), "linear", "float32")
    )
    steps, count = problem.steps, len(problem.inputs)
    goals = [Samples(problem).goal(k) for k in range(steps + 1)]
    avoid = [games.avoid(problem.unsafe[0], k) for k in range(steps)]

    def reach(values, k):
        found = dict((j, v.copy()) for j, v in games.reach(values, k))
        return [found[j] for j in range(count)]

    tubes, marks = naive.recursion(goals, reach, avoid)
    assert len(tubes) == (steps + 1) * (steps + 2) // 2
    for (k, n), expected in tubes.items():
        # maxima and minima of what is rounded are those that are rounded
        np.testing.assert_array_equal(table.values(start=k, within=n), expected.astype(np.float32))
        if n:
            inputs = table.inputs(start=k, within=n)
            assert inputs.shape == (9, 9, count)
            assert np.array_equal(inputs, np.stack([marks[k, n, j] for j in range(count)], axis=-1))
    assert not table.inputs(start=2, within=0).any()
    assert np.array_equal(table.values(start=2, within=9), table.values(start=2, within=1))  # no more steps are left


@pytest.mark.parametrize("method", [HJI(), HopfLax()], ids=lambda method: method.name)
def test_tubes_in_one_dimension_have_their_closed_form(method):
    """Each step adds (1 - 0.2) * 0.5 on both sides; the wall at 3 caps what may be touched."""
    problem = interval_problem(nodes=321, steps=5)
    table = sdhj.solve(problem, method)
    q, h = problem.grid.nodes(0), problem.grid.spacing[0]
    for k in range(6):
        for n in range(6 - k):
            reach = 1.0 + n * 0.8 * 0.5
            inside = table.values(start=k, within=n) <= 0
            assert inside[np.abs(q) < min(reach, 2.9) - 1.5 * h].all()
            assert not inside[np.abs(q) > reach + 1.5 * h].any()
            assert not inside[q > 3.0].any()


def test_state_dependent_dynamics_make_a_table():
    table = sdhj.solve(unicycle_problem())
    fractions = [table.fraction(start=0, within=n) for n in range(4)]
    assert fractions == sorted(fractions) and fractions[3] > 1.5 * fractions[0] > 0
    # a car heading for the target gets there, one heading away does not
    heading = table.contains([[-0.8, 0.0, 0.0], [-0.8, 0.0, np.pi - 0.01]], start=0, within=2)
    assert heading.tolist() == [True, False]


def node_shares(table):
    return np.array([(table.values(start=0, within=n) <= 0).mean() for n in range(table.steps + 1)])


# Shares of the nodes inside from step 0 within 0..8 steps, by independent prototypes at 25^4.
LAX_SHARES = [0.025, 0.074, 0.156, 0.236, 0.302, 0.338, 0.362, 0.381, 0.398]
LAX_FRIEDRICHS_SHARES = [0.025, 0.061, 0.125, 0.184, 0.248, 0.295, 0.327, 0.346, 0.360]
# The prototypes treat the avoid games' time and walls in their own ways: up to 1% of the set was seen between two
# honest ways of sampling time. A wrong sign, order or input moves these shares by a tenth and more.
SHARE_TOLERANCE = 0.005


@pytest.mark.slow
def test_lax_reproduces_the_published_shares():
    shares = node_shares(sdhj.solve(sdhj.arm_case_study(view_time="instantaneous"), HopfLax("linear")))
    print("lax", shares.round(4))
    np.testing.assert_allclose(shares, LAX_SHARES, rtol=0, atol=SHARE_TOLERANCE)


@pytest.mark.slow
def test_lax_friedrichs_reproduces_the_published_shares():
    """The scheme of the paper: Lax-Friedrichs, second order, the drift differenced like the rest."""
    problem, scheme = sdhj.arm_case_study(view_time="instantaneous"), Scheme(flux="lax-friedrichs", frame="fixed")
    shares = node_shares(sdhj.solve(problem, HJI(scheme)))
    print("Lax-Friedrichs", shares.round(4))
    np.testing.assert_allclose(shares, LAX_FRIEDRICHS_SHARES, rtol=0, atol=SHARE_TOLERANCE)


@pytest.mark.slow
def test_single_precision_moves_the_shares_by_little():
    problem = torus_problem(nodes=64, steps=4)
    single, double = (sdhj.solve(problem, HJI(Scheme(dtype=dtype))) for dtype in ("float32", "float64"))
    disagree = ((single.values(start=0, within=4) <= 0) != (double.values(start=0, within=4) <= 0)).mean()
    print(f"float32 and float64 disagree on {disagree:.1e} of the nodes")
    assert disagree < 2e-3 and (single.values(start=0, within=4) != double.values(start=0, within=4)).any()


@pytest.mark.parametrize(
    ("made", "named"),
    [
        (lambda: Joint(scheme="hji"), "got 'hji'"),
        (lambda: HJI(scheme="hji"), "got 'hji'"),
        (lambda: HJI(scheme={"order": 2}), "sdhj.Scheme"),
        (lambda: HopfLax(dtype="float16"), "dtype"),
        (lambda: Projected(inner="lax"), "a sdhj.HopfLax, got 'lax'"),
        (lambda: Projected(inner=Joint()), "a sdhj.HopfLax, got Joint"),
    ],
)
def test_unknown_options_are_named(made, named):
    with pytest.raises(ValueError, match=named):
        made()


@pytest.mark.parametrize("method", ["hji", "lax"])
def test_units_that_cannot_be_meant_are_named(method):
    """At 10^10 m/s the ends of the axis would be played on 10^11 nodes."""
    inputs = [[1e10], [0.0]]
    problem = dataclasses.replace(
        interval_problem(unsafe=False),
        grid=sdhj.Grid([-2.0], [2.0], [41]),
        dynamics=sdhj.Dynamics(inputs, inputs, [[1.0]], [0.1]),
    )
    with pytest.raises(ValueError, match=r"is up to 1e\+10"):
        sdhj.solve(problem, method, progress=False)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["hji", "projected", "lax"])
def test_a_table_is_freed_with_its_last_name(method: str) -> None:
    """Without the collector: else two tables are in memory where a solve is repeated."""
    gc.collect()
    gc.disable()
    try:
        sdhj.solve(sdhj.arm_case_study(nodes=9), method, progress=False, play=False)
        assert not [one for one in gc.get_objects() if type(one) is GridSets]
    finally:
        gc.enable()


def test_what_is_clear_for_more_steps_is_for_fewer_at_every_node() -> None:
    """Whatever the scheme's error: without that rule some nodes of this robot are safe for more steps alone."""
    problem = cart((-1.0, 0.0, 1.0), 0.9, grid=sdhj.Grid([-2.0, -2.0], [2.0, 2.0], [21, 21]), delta=0.3, steps=6)
    table = sdhj.solve(problem, progress=False, play=False)
    tubes = [table.values(start=0, within=n) for n in range(7)]
    assert all((more >= fewer).all() for fewer, more in itertools.pairwise(tubes))
