"""A controller that remembers what the state can be: the joint of a robot before its stops, by plants of our own."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import zoo

import sdhj
from sdhj.certified.check import verify

ERROR = np.array([0.002, 0.02])
LEVELS = np.array([[-4.0], [-2.0], [0.0], [2.0], [4.0]])  # rad/s^2
PUSH = 0.1


def joint(delta, memory=True, steps=None, **sensing):
    """A joint with hard stops at +-1 rad and at most 2 rad/s, for ever; its encoder errs by 2 mrad and 0.02 rad/s."""
    grid = sdhj.Grid([-1, -2], [1, 2], (101, 81), ends=["unsafe", "wall"])
    sensing = sdhj.Sensing(error=tuple(ERROR), memory=memory, **sensing)
    return zoo.cart(LEVELS, PUSH, grid=grid, delta=delta, steps=steps, sensing=sensing)


def solved(delta, cells=(400, 400), **given):
    return sdhj.solve(joint(delta, **given), sdhj.Certified(cells=cells), progress=False, play=False)


@cache
def fine():
    """At 100 Hz, where a table that remembers nothing is empty."""
    return solved(0.01)


@pytest.fixture(scope="module")
def fast():
    """As much as a sixth of the cells leave of it."""
    return solved(0.01, cells=(150, 150))


def moved(states, accelerations, delta, rng, pieces=10):
    """An interval of the plant: the disturbance switches, the speed is held at its walls. Whether a stop was hit."""
    hit, h = np.zeros(len(states), np.bool_), delta / pieces
    for _ in range(pieces):
        push = rng.choice([-PUSH, PUSH], len(states))
        speed = np.clip(states[:, 1] + (accelerations + push) * h, -2, 2)
        states = np.stack([states[:, 0] + (states[:, 1] + speed) / 2 * h, speed], axis=1)
        hit |= np.abs(states[:, 0]) >= 1
    return states, hit


def measured(states, rng):
    return states + rng.choice([-1.0, 0.3, 1.0], states.shape) * ERROR


@pytest.mark.slow
def test_sampling_faster_costs_nothing_any_more():
    assert fine().fraction() > 0.82  # 0.827; of the truth, shrunk by 2 E, 0.905
    assert solved(0.01, memory=False).fraction() == 0.0
    slow = [solved(0.1, memory=memory).fraction() for memory in (False, True)]
    assert slow[1] > slow[0] > 0.87


@pytest.mark.parametrize("delta", [0.1, 0.01])
@pytest.mark.slow
def test_nobody_who_remembers_is_lost(delta):
    """Pushed towards the stop through the filter, and by the rule, with errors at their most: the promise holds."""
    table, rng = fine() if delta == 0.01 else solved(delta), np.random.default_rng(0)
    controller = sdhj.Controller(table)
    q = rng.uniform([-1, -2], [1, 2], (5000, 2))
    q = q[table.contains(q)][:200]
    for wanted in (4, 0, None):
        states, known = q, controller.predict(measured(q, rng), 2, 0)
        for _ in range(int(3 / delta)):
            if wanted is None:
                batch = table.batch(known, 0)
                inputs, promised = controller.choose(batch), batch.promised
            else:
                answer = controller.filter(known, 0, np.full(len(known), wanted), first=True)  # carried on below
                inputs, promised = answer.inputs, answer.promised
            assert promised.all()
            states, hit = moved(states, LEVELS[inputs, 0], delta, rng)
            assert not hit.any()
            seen = controller.predict(measured(states, rng), inputs, 0)
            known, lost = table.next_points(known, inputs, 0, seen)
            assert not lost.any()
            assert (np.abs(known - states) <= ERROR + 1e-12).all()  # c +- E holds the state
        assert wanted is None or np.abs(states[:, 0]).max() > 0.9  # and comes near


def test_step_is_the_loop(fast):
    """`step` carries the point on; a measurement that cannot be is told as missed, and the loop begins anew."""
    rng, controller, state = np.random.default_rng(2), sdhj.Controller(fast), np.array([[0.9, 0.1]])
    for k in range(100):
        action = controller.step(measured(state, rng)[0], time=0.01 * k)
        assert action.promised and not action.missed
        assert (np.abs(controller.remembered[0] - state[0]) <= ERROR + 1e-12).all()
        state, hit = moved(state, LEVELS[[action.input], 0], 0.01, rng)
        assert not hit.any()
    state[0, 0] -= 0.05 * np.sign(state[0, 0])  # somebody has pushed it, towards the middle
    broken = controller.step(state[0], time=1.0)
    assert broken.missed and not broken.promised
    np.testing.assert_array_equal(controller.remembered[0], state[0])
    state, _ = moved(state, LEVELS[[broken.input], 0], 0.01, rng)
    again = controller.step(measured(state, rng)[0], time=1.01)
    assert again.promised and not again.missed


@pytest.mark.parametrize(("sensing", "share"), [({"delay": 0.008}, 0.855), ({"delay": 0.005, "jitter": 0.001}, 0.833)])
@pytest.mark.slow
def test_with_a_delay_and_a_clock_that_is_off(sensing, share, tmp_path):
    table = solved(0.01, cells=(1000, 400), **sensing)
    assert table.fraction() > share
    report = sdhj.monte_carlo(sdhj.Controller(table), 60, adversary="random", seed=0, steps=60, progress=False)
    assert report.rate("reached") == 1.0
    table.save(tmp_path / "table.npz")
    assert (verdict := verify(tmp_path / "table.npz", progress=False)).ok, str(verdict)


@pytest.mark.parametrize("adversary", ["worst", "greedy", "random"])
@pytest.mark.slow
def test_runs_remember(adversary):
    report = sdhj.monte_carlo(sdhj.Controller(fine()), 40, adversary=adversary, seed=1, steps=100, progress=False)
    assert report.rate("reached") == 1.0


def test_a_run_begins_with_a_first_measurement(fast):
    run = sdhj.simulate(sdhj.Controller(fast), [0.5, 0.3], adversary="worst", seed=3, steps=20)
    assert run.outcome == "reached" and len(run.inputs) == 20  # it has stayed clear so long
    with pytest.raises(sdhj.NotAdmissible):
        sdhj.simulate(sdhj.Controller(fast), [0.99, 1.9], adversary="worst", steps=20)


def test_a_file_says_so(fast, tmp_path):
    fast.save(tmp_path / "table.npz")
    again = sdhj.load(tmp_path / "table.npz")
    assert again.problem.sensing == fast.problem.sensing and again.problem.sensing.memory
    assert (verdict := verify(tmp_path / "table.npz", progress=False)).ok, str(verdict)
    assert "memory" not in joint(0.1, memory=False).numbers["sensing"]
    assert joint(0.1).digest != joint(0.1, memory=False).digest


def test_remembering_is_the_default_and_files_from_before_forget(tmp_path):
    assert sdhj.Sensing(0.1).remembers and not sdhj.Sensing().remembers and sdhj.Sensing().entry_in_head == {}
    for memory in (False, True):
        solved(0.1, cells=(20, 20), memory=memory, steps=2).save(tmp_path / "table.npz")
        assert sdhj.load(tmp_path / "table.npz").problem.sensing.remembers == memory
        assert sdhj.load(tmp_path / "table.npz", problem=joint(0.1, memory, 2)).problem.sensing.memory == memory


@pytest.mark.parametrize("rate", [10, 50])
@pytest.mark.slow
def test_grids_remember_too(rate):
    """By the boxes that E and the disturbance make of a point; own play of 3 s."""
    delta, rng = 1 / rate, np.random.default_rng(3)
    problem = replace(joint(delta), grid=sdhj.Grid([-1, -2], [1, 2], (201, 161), ends=["unsafe", "wall"]))
    table = sdhj.solve(problem, progress=False, play=False)
    assert table.fraction() > 0.88
    controller, q = sdhj.Controller(table), rng.uniform([-1, -2], [1, 2], (2000, 2))
    states = q[table.contains(q)][:200]
    known = controller.predict(measured(states, rng), 2, 0)
    for _ in range(3 * rate):
        answer = controller.filter(known, 0, np.full(len(known), 4), first=True)  # carried on below
        assert answer.promised.all()
        states, hit = moved(states, LEVELS[answer.inputs, 0], delta, rng)
        assert not hit.any()
        known, lost = table.next_points(known, answer.inputs, 0, controller.predict(measured(states, rng), 2, 0))
        assert not lost.any() and (np.abs(known - states) <= ERROR + 1e-9).all()


@pytest.mark.slow
def test_round_a_period_and_beside_walls():
    """On a torus with errors: what is carried on holds the state, over the seam, too."""
    problem = replace(zoo.torus_problem(), sensing=sdhj.Sensing(0.05, memory=True))
    table = sdhj.solve(problem, sdhj.Certified(cells=(60, 60)), progress=False, play=False)
    rng, controller, count = np.random.default_rng(4), sdhj.Controller(table), 300
    states = rng.uniform(problem.grid.lower, problem.grid.upper, (count, 2))
    length = np.subtract(problem.grid.upper, problem.grid.lower)
    known, low, high = states.copy(), *problem.interval(0).reachable_boxes(states)
    for _ in range(30):
        inputs = rng.integers(0, len(problem.inputs), count)
        spot = rng.choice([0.0, 1.0], (count, 2))
        by = low[0, inputs] + spot * (high - low)[0, inputs]
        states = problem.grid.wrapped(states + by)
        seen = controller.predict(states + rng.choice([-0.05, 0.05], (count, 2)), 0, 0)
        known, lost = table.next_points(known, inputs, 0, seen)
        apart = np.abs((known - states + length / 2) % length - length / 2)
        assert not lost.any() and (apart <= 0.05 + 1e-9).all()


@pytest.mark.parametrize("method", [sdhj.HJI(), sdhj.Certified(cells=[400])], ids=["hji", "certified"])
@pytest.mark.parametrize(("error", "push"), [(0.0, 0.0), (0.02, 0.1)])
def test_what_is_remembered_where_intervals_may_be_shorter_or_longer(error, push, method):
    """On a line at 1 m/s for 0.5 s, which begin and end up to 0.1 s off: the state is 0.3 to 0.7 m on, give or take."""
    sensing = sdhj.Sensing(error, jitter=0.1)
    problem = zoo.interval_problem(nodes=41, disturbance=push)
    table = sdhj.solve(replace(problem, sensing=sensing), method, play=False)
    forth = int(np.argmax(problem.inputs[:, 0]))
    seen = -0.5 + np.array([0.3, 0.5, 0.7])[:, None]  # where it is, measured exactly
    known, lost = table.next_points(np.full((3, 1), -0.5), np.full(3, forth), 0, seen)
    assert not lost.any() and (np.abs(known - seen) <= error + 1e-9).all()
    reach = 2 * error + 0.7 * push  # what else it may be off by: both errors, and what it was pushed by
    far = -0.5 + np.array([0.3 - reach - 2 * error - 0.03, 0.7 + reach + 2 * error + 0.03])[:, None]
    assert table.next_points(np.full((2, 1), -0.5), np.full(2, forth), 0, far)[1].all()


@pytest.mark.parametrize("method", [sdhj.HJI(), sdhj.HopfLax(), sdhj.Certified(cells=[400])], ids=lambda one: one.name)
def test_a_prediction_is_as_far_off_as_two_errors_explain(method):
    """That of the point carried on and its own, 0.05 m each; and the state is 0.4 to 0.6 m on."""
    problem = replace(zoo.interval_problem(nodes=41), sensing=sdhj.Sensing(0.05))
    table = sdhj.solve(problem, method, progress=False, play=False)
    point, forth = np.array([[-0.501]]), np.array([int(np.argmax(problem.inputs[:, 0]))])
    for way in (-1.0, 1.0):
        (end,), lost = table.next_points(point, forth, 0, np.array([[-0.001 + way * 0.17]]))
        assert not lost and abs(end[0] - way * 0.1) <= (0.021 if table.proved else 0.0011)
        for off, fits in ((0.0999, True), (0.1001, False)):
            seen = end[None] + way * off
            kept, lost = table.next_points(point, forth, 0, seen)
            assert lost[0] != fits and kept[0, 0] == (end[0] if fits else seen[0, 0])


def test_a_prediction_by_itself_is_refused(fast):
    """What an own loop of `select` would ask, which is promised nothing; the point of `step` is answered."""
    rng, controller, state = np.random.default_rng(4), sdhj.Controller(fast), np.array([[0.5, 0.3]])
    asked = {
        "select": lambda q, **given: controller.select(q, **given),
        "steps_to_go": lambda q, **given: controller.steps_to_go(q, **given),
        "safe_inputs": lambda q, **given: controller.safe_inputs(q, **given),
        "filter": lambda q, **given: controller.filter(q, 0, 4, **given),
        "batch": lambda q, **given: controller.batch([q, q], **given),
        "filter of many": lambda q, **given: controller.filter([q, q], 0, [4, 4], **given),
    }
    for ask in asked.values():  # before a loop has begun
        with pytest.raises(ValueError, match="prediction by itself: ask"):
            ask(controller.predict(measured(state, rng)[0]))
        ask(controller.predict(measured(state, rng)[0]), first=True)
    for k in range(30):
        action = controller.step(measured(state, rng)[0], time=0.01 * k)
        assert (np.abs(action.point - state[0]) <= ERROR + 1e-12).all()
        assert controller.select(action.point) == action.input and action.input in controller.safe_inputs(action.point)
        assert not action.point.flags.writeable
        raw = controller.predict(state[0] + rng.uniform(-1, 1, 2) * ERROR, action.input)
        for ask in asked.values():
            ask(action.point)
            with pytest.raises(ValueError, match="a prediction by itself"):
                ask(raw)
        state, hit = moved(state, LEVELS[[action.input], 0], 0.01, rng)
        assert not hit.any()


@pytest.mark.slow
def test_who_remembers_nothing_may_ask_of_every_prediction():
    controller, rng = sdhj.Controller(solved(0.1, memory=False)), np.random.default_rng(5)
    state = np.array([[0.2, 0.1]])
    for _ in range(20):
        chosen = controller.select(controller.predict(measured(state, rng)[0]))
        state, hit = moved(state, LEVELS[[chosen], 0], 0.1, rng)
        assert not hit.any()
