"""Unsafe sets that are unsafe under some inputs only: no thrust near a station, a charger that is off for hours."""

import importlib
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import zoo

import sdhj
from sdhj.certified.check import verify
from sdhj.problem.boxes import one_by_one
from sdhj.simulation.adversaries import first_moment
from sdhj.simulation.outcomes import COLLIDED, UNDECIDED, play_interval
from sdhj.solver.joint import Joint
from sdhj.solver.recursion import GridParts

SPEEDS = (0.0, 1.0, 0.4, -1.0)
STATION, FAST = (0.5, 1.1), (1, 3)


def line(inputs=FAST, *, box=False, push=0.1, **given):
    """dx = u + v towards x >= 2, past a station near which the fast inputs are forbidden."""
    levels = [[one] for one in SPEEDS]

    def level(p, t):
        return np.abs(p[:, 0] - sum(STATION) / 2) - (STATION[1] - STATION[0]) / 2

    station = sdhj.BlackBox(level, slope=1.0, rate=0.0) if box else level
    return zoo.line(
        levels,
        push,
        grid=sdhj.Grid([-1.0], [3.0], [161]),
        target=sdhj.TargetSet((0,), lambda p, t: 2.0 - p[:, 0]),
        unsafe=[sdhj.UnsafeSet((0,), station, name="station", inputs=inputs)],
        steps=10,
        **given,
    )


@cache
def by_hand(inputs=FAST, push=0.1, steps=10, delta=0.5):
    """For states 2.5 mm apart the fewest steps, 99 where there are none, and the safe inputs: plain loops."""
    h, states = 0.0025, [round(-1.0 + 0.0025 * i, 6) for i in range(1601)]
    fewest = [0 if x >= 2.0 else 99 for x in states]
    ways = [set() for _ in states]
    for n in range(1, steps + 1):
        found = list(fewest)
        for i, x in enumerate(states):
            for j, u in enumerate(SPEEDS):
                low, high = min(x, x + (u - push) * delta), max(x, x + (u + push) * delta)
                met = j in inputs and high >= STATION[0] and low <= STATION[1]
                a, b = round(((u - push) * delta) / h), round(((u + push) * delta) / h)
                ends = range(i + a, i + b + 1)
                off = ends[0] < 0 or ends[-1] >= len(states)
                if fewest[i] >= n and not met and not off and all(fewest[k] <= n - 1 for k in ends):
                    found[i] = n
                    ways[i].add(j)
        fewest = found
    return np.array(states), np.array(fewest), ways


METHODS = {
    "hji": sdhj.HJI(),
    "joint": Joint(),
    "lax": sdhj.HopfLax(),
    "projected": sdhj.Projected([(0,)]),
    "certified": sdhj.Certified(cells=(800,)),
}


@pytest.mark.parametrize("method", METHODS)
def test_tubes_and_inputs_are_those_of_plain_loops(method):
    """Steps to go agree but within a node of where they change, and no input is safe that is not by hand."""
    states, fewest, ways = by_hand()
    table = sdhj.solve(line(), METHODS[method], progress=False, play=False)
    near = np.array([len(set(fewest[max(i - 10, 0) : i + 11])) > 1 for i in range(len(states))])
    some = np.flatnonzero(~near)[::7]
    batch = table.batch(states[some, None], 0)
    assert (np.where(batch.steps_to_go < 0, 99, batch.steps_to_go) == fewest[some]).mean() >= 0.99
    inside = (states[some] > STATION[0]) & (states[some] < STATION[1])
    assert inside.sum() > 10 and batch.safe[inside].any() and not batch.safe[inside][:, FAST].any()
    for i, safe in zip(some, batch.safe, strict=True):
        assert not 0 < fewest[i] < 99 or set(np.flatnonzero(safe).tolist()) <= ways[i]


@pytest.mark.parametrize("method", [sdhj.HJI(), Joint(), sdhj.Certified(cells=(160,))], ids=lambda one: one.name)
def test_an_interval_that_may_end_early_is_looked_at_to_its_latest_end(method):
    """At 1.1 m/s for 0.6 s at most: the station is met from 0.66 m before it on, and so it is by who goes back."""
    nearly_all = sdhj.TargetSet((0,), lambda p, t: -0.9 - p[:, 0])
    grid = sdhj.Grid([-1.0], [3.0], [161], ends="wall")  # with unsafe ends the joint game is not played alone
    problem = replace(line(), grid=grid, target=nearly_all, steps=1, sensing=sdhj.Sensing(jitter=0.05))
    table, x = sdhj.solve(problem, method, progress=False, play=False), problem.grid.nodes(0)
    forth, back = (table.inputs(start=0, within=1)[:, j] for j in FAST)
    assert not forth[(x >= STATION[0] - 0.65) & (x <= STATION[1])].any()
    assert not back[(x >= STATION[0]) & (x <= STATION[1] + 0.65)].any()
    assert forth[(x > -0.8) & (x < STATION[0] - 0.7)].all() and back[(x > STATION[1] + 0.7) & (x < 2.9)].all()


def test_a_run_that_applies_it_there_has_collided():
    problem = line()
    table = sdhj.solve(problem, progress=False, play=False)
    states, count = np.array([[0.8], [0.8], [-0.3], [0.45]]), 4
    inputs, to_go = np.array([1, 2, 1, 1]), np.ones(count, np.int64)
    begun = first_moment(
        table, problem, states, inputs, to_go, 0, 0.0, np.arange(count), np.random.default_rng(0), to_go
    )
    watched = []
    _, ended, _ = play_interval(begun, lambda m: 0 * m.previous, lambda m, v, q, clear: watched.append(clear))
    assert ended.tolist() == [COLLIDED, UNDECIDED, UNDECIDED, COLLIDED]
    assert watched[0][0] <= 0 < watched[0][2] and np.isinf(watched[0][1])
    report = sdhj.monte_carlo(sdhj.Controller(table), 300, seed=1, progress=False)
    assert report.rate("reached") > 0.98 and report.counts["collided"] == 0


def test_leaving_the_set_within_the_first_instant_is_a_collision_too():
    """The input is forbidden where the interval begins, though the path is out of the set at the first instant."""
    problem = line(push=0.0)
    table = sdhj.solve(problem, progress=False, play=False)
    begun = first_moment(
        table,
        problem,
        np.array([[STATION[1] - 1e-3]]),
        np.array([1]),
        np.array([1]),
        0,
        0.0,
        np.arange(1),
        np.random.default_rng(0),
        np.array([1]),
    )
    assert play_interval(begun, lambda m: 0 * m.previous, None)[1].tolist() == [COLLIDED]


@pytest.mark.parametrize("box", [False, True])
def test_true_sets_undo_inputs_and_not_states(box):
    """Between nodes the true set decides: where the tubes know nothing of it, the input fails and the state is kept."""
    problem = line((1,), box=box, push=0.0)
    table = sdhj.solve(replace(problem, unsafe=()), progress=False, play=False)
    known = replace(table, problem=problem)
    batch = known.batch(np.array([[0.8], [0.2], [1.3]]), 0)
    assert (batch.steps_to_go > 0).all()
    # at the others the path under the first choice meets the station, or begins behind it
    assert batch.best.tolist()[0] != 1 and batch.best.tolist()[1] != 1 and batch.best.tolist()[2] == 1
    told = sdhj.Controller(known).filter(np.array([[0.8]]), 0, np.array([1]))
    assert told.changed[0] and told.inputs[0] != 1


def test_files_stores_and_digests_tell_it(tmp_path):
    problem = line()
    assert len({line(one).digest for one in (None, (1,), FAST)}) == 3
    table = sdhj.solve(problem, progress=False, play=False)
    table.save(tmp_path / "table.npz")
    loaded = sdhj.load(tmp_path / "table.npz")
    assert loaded.problem.unsafe[0].inputs == FAST and loaded.problem.digest == problem.digest
    states = np.linspace(-0.9, 2.9, 77)[:, None]
    assert np.array_equal(loaded.batch(states, 0).safe, table.batch(states, 0).safe)
    with pytest.raises(sdhj.TableFileError, match="sets"):
        sdhj.load(tmp_path / "table.npz", problem=line((1,)))
    stored = sdhj.solve(problem, store=tmp_path / "store", progress=False, play=False)
    assert np.array_equal(stored.values(within=10), table.values(within=10))


@pytest.mark.parametrize("some", [[0, 2], [3]])
def test_games_of_some_inputs_are_those_of_all(some):
    """As workers share them out: inputs count by their own numbers, not by those among the ones of a share."""
    parts = GridParts(line(), sdhj.HJI(sdhj.Scheme(frame="fixed")))
    every = np.empty(parts.shape("avoid_static"), parts.dtype)
    own, values = np.empty_like(every[some]), parts.samples.goal(0).astype(parts.dtype)
    parts.write_avoid("avoid_static", 0, every)
    parts.write_avoid("avoid_static", 0, own, some)
    assert np.array_equal(own, every[some]) and not np.array_equal(every[0], every[1])
    led, led_by_some = (dict(one_by_one(parts.games.grouped_reach_sets(values, 0, *own))) for own in ([], [some]))
    assert [*led_by_some] == some and all(np.array_equal(one, led[j]) for j, one in led_by_some.items())


@pytest.mark.slow
def test_certified_is_checked_and_another_list_is_refused(tmp_path):
    from forging import describe

    table = sdhj.solve(line((1,)), sdhj.Certified(cells=(200,)), progress=False, play=False)
    table.save(path := tmp_path / "table.npz")
    assert verify(path, progress=False).ok
    assert sdhj.load(path).problem.unsafe[0].inputs == (1,)
    describe(path, line((1, 2)))
    (failed,) = (one.name for one in verify(path, progress=False).claims if one.failed)
    assert "clear" in failed
    describe(path, line(None))
    assert not verify(path, progress=False).ok


@pytest.mark.slow
@pytest.mark.parametrize("method", ["hji", sdhj.Certified(cells=(200,))])
def test_explain_names_the_set_for_those_inputs_alone(method):
    problem = line(FAST, push=0.3)
    table = sdhj.solve(problem, method, progress=False, play=False)
    q = np.array([0.8])
    met = {one.input for within in (1, 2) for one in table.explain(q, 0, within=within).failures if one.by == "station"}
    assert met == set(FAST)
    assert "unsafe set" not in table.explain(q, 0, within=1).says


def test_with_sensing_the_others_stay_numbers():
    problem = line(sensing=sdhj.Sensing(0.01, 0.05, memory=False))
    table = sdhj.solve(problem, progress=False, play=False)
    assert not np.isnan(table.avoid.static).any() and not np.isnan(table.values()).any()
    assert sdhj.monte_carlo(sdhj.Controller(table), 200, progress=False).counts["collided"] == 0


def test_a_charger_that_is_off_for_some_hours():
    """The battery is used for 18 h and must not fall to 20 %; the charger is off from 8 to 11 h."""
    problem = zoo.line(
        (0.0, 0.1),  # per hour
        0.02,
        grid=sdhj.Grid([0.0], [1.0], [101], names=["charge"]),
        target=None,
        unsafe=[
            sdhj.UnsafeSet((0,), lambda p, t: np.abs(t - 9.5) - 1.49 + 0.0 * p[:, 0], name="off", inputs=[1]),
            sdhj.UnsafeSet((0,), lambda p, t: p[:, 0] - 0.2, name="empty"),
        ],
        delta=1.0,
        steps=18,
    )
    table = sdhj.solve(problem, progress=False, play=False)
    states = np.array([[0.5]])
    assert [bool(table.batch(states, k).safe[0, 1]) for k in (6, 7, 8, 10, 11)] == [True, True, False, False, True]
    assert table.contains([[0.28]], start=8)[0] and not table.contains([[0.25]], start=8)[0]  # .02 an hour until 11


def test_gymnasium_masks_it():
    pytest.importorskip("gymnasium", reason="Gymnasium is not installed: pip install 'sdhj[gym]'")
    gym = importlib.import_module("sdhj.simulation.environment")
    env = gym.ReachAvoidEnv(sdhj.solve(line(), progress=False, play=False), shield=False)
    _, info = env.reset(seed=0, options={"state": [0.8]})
    assert not info["action_mask"][list(FAST)].any() and info["action_mask"].any()
    assert env.step(1)[4]["outcome"] == "collided"


@pytest.mark.parametrize("inputs", [[], [1, 1], [0.5], 3])
def test_what_are_no_numbers_of_inputs_is_refused(inputs):
    with pytest.raises(ValueError, match="inputs of 'unsafe'"):
        sdhj.UnsafeSet((0,), lambda p, t: p[:, 0], inputs=inputs)


def test_numbers_of_no_inputs_are_refused():
    with pytest.raises(ValueError, match="from 0 to 3"):
        line((4,))
