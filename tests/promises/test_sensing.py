"""Measurement error, delay and jitter: the closed form, the slow twin, inclusions, what is refused, attacks."""

import itertools
import multiprocessing
import time
from dataclasses import replace
from functools import cache

import naive_sensing
import numpy as np
import pytest
import zoo

import sdhj
from sdhj import Controller, Dynamics, Grid, HopfLax, Projected, Sensing, TargetSet, UnsafeSet
from sdhj.problem.uncertain import largest_in_error_box
from sdhj.simulation.adversaries import ADVERSARIES
from sdhj.simulation.outcomes import COLLIDED, REACHED
from sdhj.simulation.sensed import Runs
from sdhj.table.beside import predicted
from sdhj.table.files import read_head

EXACT = HopfLax("linear")
PLAYED = Sensing(error=0.03, delay=0.2, jitter=0.05, memory=False)


@cache
def interval_tables(sensing, **options):
    """The robot on a line, solved with and without sensing."""
    problem = zoo.interval_problem(nodes=161, **options)
    return tuple(sdhj.solve(replace(problem, sensing=told), progress=False) for told in (sensing, Sensing()))


def closed_form(sensing, n, b=0.2, delta=0.5):
    """Half-width of W^n, by chapter 16 of the course."""
    box = sensing.error + sensing.delay * b
    return 1.0 - 2 * box + n * ((1.0 - b) * (delta - 2 * sensing.jitter) - 2 * box), box


@pytest.mark.parametrize(
    "sensing",
    [
        Sensing(0.03, memory=False),
        Sensing(delay=0.2, memory=False),
        Sensing(jitter=0.05, memory=False),
        PLAYED,
        Sensing([0.06], 0.1, 0.1, memory=False),
    ],
    ids=["error", "delay", "jitter", "all", "more"],
)
@pytest.mark.parametrize(
    ("method", "less", "more"),
    [(EXACT, 1e-5, 1e-5), ("hji", 0.005, 0.005), (sdhj.Certified(cells=[1600]), 0.0065, 1e-6)],
)
def test_the_closed_form(sensing, method, less, more):
    """Level sets are straight but at kinks that lie deep inside: exact; for differences to a tenth of a cell.

    A proof counts whole cells, of 5 mm: it may have less, and never more.
    """
    problem = replace(zoo.interval_problem(nodes=161), sensing=sensing)
    if sensing.jitter and method is EXACT:
        for refused in (method, Projected([(0,)], EXACT)):
            with pytest.raises(ValueError, match="intervals that end early"):
                sdhj.solve(problem, refused, progress=False)
        return
    table = sdhj.solve(problem, method, progress=False)
    for n in range(6):
        half, _ = closed_form(replace(sensing, error=np.max(sensing.error)), n)
        inside = table.contains([[less - half], [half - less], [-half - more], [half + more]], start=0, within=n)
        assert inside.tolist() == [True, True, False, False]


@pytest.mark.parametrize("ndim", [1, 2])
def test_all_of_the_box_of_a_state_has_to_be_in_the_set(ndim):
    """The one input leads by 0.65 into |x| <= 0.3, so predictions between -0.35 and -0.3 are in no set: a gap in E."""
    problem = (zoo.line, zoo.plane)[ndim - 1](
        [[1.0]],
        drift=np.eye(ndim)[:1],
        **zoo.ALONE,
        lower=[-2.0] * ndim,
        upper=[2.0] * ndim,
        nodes=[161, 11][:ndim],
        target=zoo.goal(0.0, 0.4),
        delta=0.65,
        steps=1,
        sensing=Sensing([0.1, 0.1][:ndim]),
    )
    table = sdhj.solve(problem, EXACT, play=False)
    x = np.array([-0.88, -0.82, -0.48, -0.42, -0.38, -0.33, -0.29, -0.25, -0.22, -0.18, 0.18, 0.22])
    found = table.contains(np.stack([x, 0.0 * x], axis=1)[:, :ndim], start=0, within=1)
    np.testing.assert_array_equal(found, (np.abs(x + 0.65) <= 0.2) | (np.abs(x) <= 0.2))


@pytest.mark.parametrize("method", ["hji", sdhj.Certified(cells=[1600])], ids=["hji", "certified"])
def test_who_has_arrived_is_clear_at_every_instant_of_the_jitter(method):
    """The wall is at 0.9 - 0.4 t and the input may start 0.1 s late: at t_1 = 0.5 s a state needs to be below 0.66."""
    problem = zoo.interval_problem(nodes=161, wall=0.9, rate=-0.4, disturbance=0.0)
    for jitter, wall in ((0.0, 0.7), (0.1, 0.66)):
        table = sdhj.solve(replace(problem, sensing=Sensing(jitter=jitter, memory=False)), method, play=False)
        assert table.contains([[wall - 0.01], [wall + 0.01]], start=1, within=0).tolist() == [True, False]


REST = 2  # the input +1 is held until the first chosen one starts


@pytest.mark.parametrize("frame", ["moving", "fixed"])
@pytest.mark.parametrize(("begin", "rate", "closest"), [(0.9, -0.4, 0.66), (0.5, 0.4, 0.46)])
def test_an_input_is_clear_from_its_earliest_begin_to_its_latest_end(begin, rate, closest, frame):
    """The robot stands and the wall, at begin + rate t, does not: for 0.5 s, which begin and end up to 0.1 s off."""
    problem = zoo.line(
        [0.0],
        **zoo.ALONE,
        lower=[-1.0],
        upper=[1.0],
        ends="wall",
        target=None,
        unsafe=[UnsafeSet((0,), lambda p, t: begin + rate * t - p[:, 0], name="wall")],
        steps=1,
        sensing=Sensing(jitter=0.1, memory=False),
    )
    table = sdhj.solve(problem, sdhj.HJI(sdhj.Scheme(frame=frame)), play=False)
    assert (table.hazards(np.array([[closest - 0.01], [closest + 0.01]]), 0) <= 0.0).ravel().tolist() == [True, False]


@pytest.mark.parametrize("method", [EXACT, sdhj.Certified(cells=[1600])], ids=["lax", "certified"])
def test_a_measurement_is_asked_where_the_robot_will_be(method):
    """dq = u + v: the prediction y + d u_rest has to be in M^n, which is W^n enlarged by E."""
    delay, b, n = 0.2, 0.2, 5
    sensing = Sensing(0.03, delay, rest=REST, memory=False)
    table = sdhj.solve(replace(zoo.interval_problem(nodes=161), sensing=sensing), method, play=False)
    controller, (half, box) = Controller(table), closed_form(sensing, n)
    boundary = np.array([[-half - box - delay], [half + box - delay]])  # of measurements; certified cells are .005 wide
    inward = np.array([[0.01], [-0.01]])
    assert (
        controller.admissible(boundary + inward, step=0).all()
        and not controller.admissible(boundary - inward, step=0).any()
    )
    assert controller.admissible(boundary[0] + 0.01, step=0) is True

    def lost(y, error, push):
        """Own integration of a run whose first measurement is y: measured with an error, held, pushed away."""
        loop, x, held = Controller(table), y - error, 1.0
        for k in range(n + 1):
            if abs(x) <= 1.0 and k:
                return False
            if k == n:
                return True
            action = loop.step([x + error], k * 0.5)
            x += delay * (held + push * b * np.sign(x))
            held = table.problem.inputs[action.input, 0]
            x += (0.5 - delay) * (held + push * b * np.sign(x))
        return True

    for side, y in zip((-1, 1), boundary[:, 0], strict=True):
        for error, push in ((0.03, 1.0), (-0.03, 1.0), (0.0, 0.5)):
            assert not lost(y - side * 0.01, error, push)
    going_on = boundary[1] + 0.03  # in the set as it is, but the robot goes on by d before it can turn back
    assert table.contains([going_on], start=0, within=n)[0] and not controller.admissible(going_on, step=0)


@pytest.mark.slow
def test_an_unsafe_set_keeps_twice_the_box_away():
    cut, box = interval_tables(PLAYED, wall=1.2)[0], closed_form(PLAYED, 0)[1]
    edge = 1.2 - 2 * box
    assert cut.contains([[edge - 0.005], [edge + 0.005]], start=0, within=5).tolist() == [True, False]


@pytest.mark.parametrize("walls", [[], ["lower"], ["upper"]], ids=str)
@pytest.mark.parametrize("method", [EXACT, "hji"], ids=["lax", "hji"])
def test_an_unsafe_end_keeps_twice_the_box_away(method, walls):
    sensing = PLAYED if method == "hji" else replace(PLAYED, jitter=0.0)
    edge, held = 1.2 - 2 * closed_form(PLAYED, 0)[1], [end in walls for end in ("lower", "upper")]
    grid = Grid([-1.2], [1.2], [97], ends=[["wall" if one else "unsafe" for one in held]])
    problem = replace(zoo.interval_problem(unsafe=False), grid=grid, sensing=sensing)
    table = sdhj.solve(problem, method, progress=False)
    places = [[0.01 - edge], [edge - 0.01], [-0.01 - edge], [edge + 0.01]]
    assert table.contains(places, start=0, within=5).tolist() == [True, True, *held]
    assert (table.hazards(np.array([[-1.2], [1.2]]), 0) <= 0).all(axis=1).tolist() == held  # or past the end already


def lattice_problem(ndim, sensing, *, unsafe=True):
    """A torus of whole nodes, a tick of 1 s that moves by whole nodes; and its functions, for the twin."""
    nodes = [18, 8][ndim - 1]
    turn = 2 * np.pi / nodes

    def target(p, t):
        return 0.4 - np.prod(np.cos(turn * (p - 5.0)), axis=1)

    def danger(p, t):
        return -0.9 - np.cos(turn * p[:, 0]) + 1.4

    moves = np.array([[-2.0], [0.0], [2.0]]) if ndim == 1 else np.array([[-3.0, 1.0], [0.0, 0.0], [1.0, 2.0]])
    problem = (zoo.line, zoo.plane)[ndim - 1](
        moves,
        1.0,
        lower=[0.0] * ndim,
        upper=[float(nodes)] * ndim,
        nodes=nodes,
        periodic=[True] * ndim,
        target=TargetSet(tuple(range(ndim)), target),
        unsafe=(UnsafeSet((0,), danger),) if unsafe else (),
        delta=3.0,
        sensing=sensing,
    )
    points = problem.grid.points()
    wall = -danger(points, 0.0) if unsafe else np.full(len(points), -np.inf)
    return problem, target(points, 0.0).reshape(problem.grid.shape), wall.reshape(problem.grid.shape)


@pytest.mark.parametrize(
    ("ndim", "error", "delay", "ticks"),
    [(1, 1, 0, [3]), (1, 0, 1, [3]), (1, 1, 1, [3]), (2, 1, 0, [3])],
)
def test_the_slow_twin(ndim, error, delay, ticks):
    """Whole nodes in whole ticks: boxes end at nodes, so what is interpolated linearly is exact."""
    half = naive_sensing.uncertainty(error, 1, delay)
    sensing = Sensing(float(error), float(delay), (max(ticks) - 3) / 2, memory=False)
    free = Sensing() if half == 0 else replace(sensing, error=0.0, delay=0.0, jitter=0.0)
    problem, goal, wall = lattice_problem(ndim, free, unsafe=ndim == 1)
    object.__setattr__(problem, "sensing", sensing)  # without asking whether anything of the target is left
    assert problem.half_widths[0].tolist() == [half] * ndim
    table = sdhj.solve(problem, EXACT, progress=False)
    moves = [tuple(int(m) for m in move) for move in problem.inputs]
    twin = naive_sensing.predictions(goal, wall, moves, 1, ticks, half, 3)
    for n, values in enumerate(twin):
        np.testing.assert_allclose(table.values(start=0, within=n), values, atol=1e-12)
    hazards = table.hazards(problem.grid.points(), 0)
    for j, move in enumerate(moves):  # of all that the state may be, over the longest interval
        clear = naive_sensing.kept(np.full(wall.shape, -np.inf), wall, move, 1, ticks)
        np.testing.assert_allclose(hazards[:, j], naive_sensing.shrunk(clear, half).ravel(), atol=1e-12)
    states = naive_sensing.shrunk(twin[3], half)
    assert (table.contains(problem.grid.points(), start=0, within=3) == (states <= 0).ravel()).all()


def test_more_of_anything_never_enlarges_a_set():
    """Of projections, too, which have no closed form; of the whole the slow twin says more."""
    method = Projected([(0,)], EXACT)
    problem = zoo.torus_problem(nodes=16, steps=2)
    problem = replace(problem, unsafe=(UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 1.0, p[:, 1]) - 0.5),))
    chain = [
        Sensing(),
        Sensing(0.02, memory=False),
        Sensing(0.02, 0.03, memory=False),
        Sensing((0.03, 0.02), 0.04, memory=False),
    ]
    target = TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0] + 1, p[:, 1]) - 0.9)
    before = None
    for sensing in chain:
        table = sdhj.solve(replace(problem, target=target, sensing=sensing), method, progress=False)
        values = np.stack([table.values(start=0, within=n) for n in range(3)])
        assert before is None or ((values >= before - 1e-12).all() and (values > before + 1e-6).any())
        before = values
    assert (before <= 0).any()


def test_a_delay_is_an_error_that_is_known_and_a_later_clock():
    """The tubes are those of the larger box, for sets as they are when the input starts."""
    problem, late = zoo.torus_problem(nodes=16, steps=2), 0.05

    def later(part):
        return replace(part, level_set=lambda p, t: part.level_set(p, t + late))

    other = replace(problem, target=later(problem.target), unsafe=tuple(later(part) for part in problem.unsafe))
    one = sdhj.solve(replace(problem, sensing=Sensing(0.01, late, memory=False)), EXACT, progress=False)
    two = sdhj.solve(replace(other, sensing=Sensing(0.01 + late * 0.4, memory=False)), EXACT, progress=False)
    for n in range(3):
        np.testing.assert_allclose(one.values(start=0, within=n), two.values(start=0, within=n), atol=1e-12)


# ---- predictions


def integrator(sensing=Sensing(), nodes=(31, 31)):  # noqa: B008 - frozen
    """dx = v, dv = u + w, |w| <= 0.1."""
    return zoo.cart(
        (-1.0, 0.0, 1.0),
        0.1,
        grid=Grid([-1.5, -1.5], [1.5, 1.5], nodes, ends="wall"),
        target=TargetSet((0, 1), lambda p, t: np.maximum(np.abs(p[:, 0]), np.abs(p[:, 1])) - 0.6),
        unsafe=(UnsafeSet((0,), lambda p, t: 1.3 - p[:, 0], name="wall"),),
        delta=0.4,
        steps=4,
        sensing=sensing,
    )


def test_the_box_of_a_double_integrator():
    """dw1 = w2, dw2 = b: E = (e1 + e2 d + b d^2 / 2, e2 + b d), and what the next prediction may be off by besides."""
    box, wider = integrator(Sensing((0.02, 0.03), 0.1, 0.05, memory=False)).half_widths
    one, two = 0.02 + 0.03 * 0.1 + 0.1 * 0.1**2 / 2, 0.03 + 0.1 * 0.1
    np.testing.assert_allclose(box, [one, two], rtol=1e-12)
    np.testing.assert_allclose(wider, [2 * one + 0.5 * two, 2 * two], rtol=1e-12)


def test_states_stay_in_the_box_around_their_predictions():
    """A car under the corners of its disturbance; between the nodes the sine is a little steeper than between two."""
    sensing = Sensing((0.02, 0.02, 0.1), 0.1, memory=False)
    problem = replace(zoo.unicycle_problem(), sensing=sensing, target=TargetSet((0,), lambda p, t: p[:, 0] - 1.0))
    box, rng, count = problem.half_widths[0], np.random.default_rng(1), 2000
    steepness = np.pi / 16 / np.sin(np.pi / 16)
    states = rng.uniform([-1, -1, -3], [1, 1, 3], (count, 3))
    error = rng.choice([-1.0, 1.0], (count, 3)) * sensing.error
    held = rng.integers(0, 3, count)
    told = predicted(problem, states + error, held)
    v, t = rng.choice([-1.0, 1.0], (count, 2)) * 0.1, problem.time(0) - 0.1
    for part in range(10):
        states = problem.interval(0).advance(states, held, v, t + part * 0.01, 0.01)
    off = np.abs(told - states).max(axis=0)
    assert (off <= box * steepness + 1e-9).all() and (off >= 0.9 * box).all()


# ---- played


@pytest.mark.parametrize(("rule", "adversary"), [("deepest", "worst"), ("effort", "random")])
def test_no_run_is_lost_and_without_sensing_some_are(adversary, rule):
    """This table is exact, so not one run may be lost; the same attack bites where nobody reckoned with it."""
    sure, plain = interval_tables(PLAYED, wall=1.2)
    report = sdhj.monte_carlo(Controller(sure, rule), 800, adversary, progress=False)
    assert report.counts["reached"] == 800
    control = sdhj.monte_carlo(Controller(plain, rule), 800, adversary, sensing=PLAYED, progress=False)
    assert control.counts["reached"] < 800


@pytest.mark.slow
def test_staying_clear_of_unsafe_ends():
    """Without a target too: no run is lost, and without sensing some are."""
    problem = replace(zoo.interval_problem(unsafe=False), target=None, grid=Grid([-1.2], [1.2], [97]))
    proof = sdhj.Certified(cells=[960])
    sure, plain = (sdhj.solve(replace(problem, sensing=told), proof, progress=False) for told in (PLAYED, Sensing()))
    assert 0.5 < sure.fraction(start=0, within=5) < plain.fraction(start=0, within=5)
    for adversary in ("random", "worst"):
        assert sdhj.monte_carlo(Controller(sure), 600, adversary, progress=False).counts["reached"] == 600
    control = sdhj.monte_carlo(Controller(plain), 600, sensing=PLAYED, progress=False)
    assert control.counts["reached"] < 600


@pytest.mark.parametrize("delay", [0.0, 0.25, 0.45])
def test_who_collides_before_the_next_measurement_or_behind_it_has_collided(delay):
    """Of runs that only go ahead, by a table that knows of no wall, all that begin before its far side meet it."""
    problem = zoo.line([1.0], 0.0, grid=Grid([-1.0], [3.0], [41]), sensing=Sensing(delay=delay), steps=6)
    problem = replace(problem, target=TargetSet((0,), lambda p, t: 2.0 - p[:, 0]))
    blind = sdhj.solve(problem, progress=False, play=False)
    table = replace(blind, problem=replace(problem, unsafe=[zoo.post(0.32, 0.02)]))
    report = sdhj.monte_carlo(Controller(table), runs=300, adversary="none", progress=False)
    collided = np.array(sdhj.simulation.outcomes.OUTCOMES)[report.outcomes] == "collided"
    np.testing.assert_array_equal(collided, report.starts[:, 0] <= 0.34)


@pytest.mark.parametrize(("when", "share"), [(0.15, 1 / 3), (0.0, 0.0)])
def test_who_begins_in_a_set_has_collided_at_the_time_when_he_begins(when, share):
    """A delay after time 0, and by a clock that is off early in a third of the runs."""
    flash = UnsafeSet((0,), lambda p, t: np.where(np.abs(t - when) < 1e-6, np.abs(p[:, 0] - 0.5) - 0.2, 1.0))
    problem = zoo.line([0.0, 1.0], 0.0, target=TargetSet((0,), lambda p, t: 2.0 - p[:, 0]), lower=[-1.0], upper=[3.0])
    problem = replace(problem, sensing=Sensing(delay=0.2, jitter=0.05), steps=6)
    table = replace(sdhj.solve(problem, progress=False, play=False), problem=replace(problem, unsafe=[flash]))
    report = sdhj.monte_carlo(Controller(table), runs=800, adversary="random", progress=False)
    there, collided = np.abs(report.starts[:, 0] - 0.5) <= 0.2, report.outcomes == COLLIDED
    assert not collided[~there].any() and there.sum() > 50
    assert abs(collided[there].mean() - share) <= (0.2 if share else 0.0)


def test_points_are_carried_on_by_the_current_of_their_own_interval():
    """What is not pushed keeps the error of its first measurement, whatever is measured later."""
    inputs = [[0.0], [0.5]]
    dynamics = Dynamics(inputs, lambda q, u, t: u + 1.5 * np.cos(4.0 * t) + 0.0 * q)
    problem = zoo.line(dynamics=dynamics, nodes=41, sensing=Sensing(0.05), steps=4)
    controller, states = (
        Controller(sdhj.solve(problem, progress=False, play=False)),
        np.linspace(-2.0, 2.0, 30)[:, None],
    )
    given = ADVERSARIES["random"], np.random.default_rng(0), problem.sensing, None
    runs, rows = Runs(controller, states, *given, False, False), np.arange(30)
    errors = runs.predictions - runs.states
    assert np.ptp(errors) > 0.05
    for number in range(3):
        runs.simulate_inputs(number, rows, rows % 2, np.ones(30, np.int64))
        np.testing.assert_allclose(runs.predictions - runs.states, errors, rtol=0, atol=1e-5)


def test_every_run_is_played_between_its_own_times():
    """At 0.5 m/s, or standing, for as long as lies between a begin and an end that are early, on time or late."""
    problem = zoo.line([0.0, 0.5], 0.0, sensing=Sensing(jitter=0.1, memory=False), steps=4)
    controller = Controller(sdhj.solve(problem, progress=False, play=False))
    given = ADVERSARIES["random"], np.random.default_rng(0), problem.sensing, None
    runs, rows = Runs(controller, np.linspace(-3.0, 1.0, 90)[:, None], *given, False, False), np.arange(90)
    for number in range(3):
        before, begins = runs.states[:, 0].copy(), runs.offsets.copy()
        runs.simulate_inputs(number, rows, rows % 2, np.ones(90, np.int64))
        lasted = 0.5 + 0.1 * (runs.offsets - begins)
        np.testing.assert_allclose(runs.states[:, 0] - before, 0.5 * (rows % 2) * lasted, rtol=0, atol=1e-12)
        assert len({*zip(begins.tolist(), runs.offsets.tolist(), strict=True)}) == 9


@pytest.mark.parametrize(("begin", "growth"), [(0.1, 0.2), (0.5, -0.2)])
def test_predictions_are_as_far_off_as_the_strongest_gusts_of_all_steps_make_them(begin, growth):
    """|v| <= begin + growth t until 1.6 s, for 0.1 s; and a point that is carried on, for 0.5 s more."""
    dynamics = Dynamics([[-1.0], [1.0]], [[-1.0], [1.0]], [[1.0]], lambda t: np.stack([begin + growth * t]))
    problem, most = zoo.line(dynamics=dynamics, sensing=Sensing(0.05, 0.1)), max(begin, begin + 1.6 * growth)
    np.testing.assert_allclose(problem.half_widths[0], [0.05 + 0.1 * most], rtol=2e-3)
    np.testing.assert_allclose(problem.error_growth, [0.5 * most], rtol=2e-3)
    assert problem.half_widths[0][0] >= 0.05 + 0.1 * most - 1e-12


@pytest.mark.parametrize("error", [0.03, 0.07, 0.1, 0.25, 0.33])
@pytest.mark.parametrize("ndim", [1, 2])
def test_the_largest_value_in_a_box_is_that_of_many_points_of_it(ndim, error, rng):
    """Of noise, whose largest values are at nodes, anywhere in the box."""
    wide = zoo.goal(*[0.0] * ndim, 1.9)
    problem = (zoo.line, zoo.plane)[ndim - 1](nodes=21, target=wide, sensing=Sensing(error, memory=False))
    grid, values = problem.grid, rng.normal(size=(21,) * ndim)
    points = rng.uniform(np.array(grid.lower) + 0.4, np.array(grid.upper) - 0.4, (60, ndim))
    along = np.linspace(-error, error, 401 if ndim == 1 else 41)
    off = np.stack(np.meshgrid(*[along] * ndim), axis=-1).reshape(-1, ndim)
    dense = grid.interpolate(values, (points[:, None] + off).reshape(-1, ndim)).reshape(60, -1).max(axis=1)
    found = largest_in_error_box(problem, values, points)
    assert (found >= dense - 1e-12).all() and np.median(found - dense) < 0.1


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_run_is_over_where_the_robot_knows_that_it_has_arrived(side):
    """In the target, and measured in it by so much as an error may be: 0.05 m twice."""

    class Beside:
        def __call__(self, moment):
            return np.zeros_like(moment.previous)

        def mislead(self, sight):
            return np.full(sight.states.shape, side) * sight.box

    controller = Controller(interval_tables(Sensing(0.05, memory=False))[0])
    states = np.linspace(-1.095, 1.095, 40)[:, None]
    runs = Runs(controller, states, Beside(), np.random.default_rng(0), controller.problem.sensing, None, False)
    left = runs.end_reached(0, False)
    known = (np.abs(states[:, 0]) <= 1.0) & (np.abs(states[:, 0] + side * 0.05) <= 0.95)
    assert np.array_equal(runs.outcomes == REACHED, known) and np.array_equal(left, np.flatnonzero(~known))


def test_an_adversary_of_ones_own_and_what_it_may_not():
    class Own:
        def __init__(self, size):
            self.size, self.ends, self.measured = size, set(), []

        def __call__(self, moment):
            self.ends.add((moment.step, round(float(moment.time + moment.remaining), 9)))
            return moment.bounds

        def mislead(self, sight):
            self.measured.append(sight.step)
            return np.full(sight.states.shape, self.size) * sight.box

        def shift(self, moment):
            return np.full(len(moment.states), 1 if moment.step % 2 else -1)

    controller, own = Controller(interval_tables(PLAYED)[0]), Own(1.0)
    run = sdhj.simulate(controller, [-1.7], own)
    assert run.outcome == "reached" and len(run.times) == 1 + 20 * len(run.inputs)
    np.testing.assert_allclose(run.times[20], 0.2 + 0.5 - 0.05)
    np.testing.assert_allclose(run.times[40], 0.2 + 1.0 + 0.05)
    assert own.measured[:3] == [0, 1, 2]  # of each input its own
    with pytest.raises(ValueError, match="return measurement errors within"):
        sdhj.simulate(controller, [-1.7], Own(1.5))


# ---- a real loop


def test_a_loop_against_a_clock():
    """A clock that is off by up to the jitter, but for every 100th instant, which is early or late: those are told."""
    table = interval_tables(PLAYED)[0]
    assert table.problem.time_invariant
    controller, rng, state, held = Controller(table), np.random.default_rng(0), np.array([-1.5]), 1
    missed = []
    for k in range(1000):
        late = (0.12 if k % 200 == 50 else -0.12) if k % 100 == 50 else rng.uniform(-0.05, 0.05) * (k > 0)
        action = controller.step(state + rng.uniform(-0.03, 0.03, 1), k * 0.5 + late)
        assert action.step == k and action.late == pytest.approx(late, abs=1e-9)
        missed += [k] if action.missed else []
        assert action.promised != action.missed
        interval = table.problem.interval(0)
        state = interval.advance(state[None], np.array([held]), rng.uniform(-0.2, 0.2, (1, 1)), 0.0, 0.2)[0]
        held = action.input
        state = interval.advance(state[None], np.array([held]), rng.uniform(-0.2, 0.2, (1, 1)), 0.0, 0.3)[0]
        assert abs(state[0]) < 1.7
    assert missed == list(range(50, 1000, 100))
    assert controller.step(state, 510.0).missed  # many instants had no measurement
    with pytest.raises(ValueError, match="time must increase: step"):
        controller.step(state, 510.1)
    assert controller.step(state, 0.0).step == 0  # a new loop


def ticking(pipe, delta, jitter, count):
    """A process that measures: it sleeps, wakes up when the system lets it, and says when that was."""
    rng, begin, k = np.random.default_rng(0), time.perf_counter(), 0
    for _ in range(count):
        now = time.perf_counter() - begin
        time.sleep(max(0.0, k * delta + rng.uniform(-jitter, jitter) * (k > 0) - now))
        woken = time.perf_counter() - begin
        pipe.send(woken)
        k = max(k, round(woken / delta)) + 1
    pipe.close()


@pytest.mark.slow
def test_a_loop_against_a_real_clock():
    """10,000 instants, 2 ms apart, in a process of their own: the missed ones are counted, no more and no fewer."""
    delta, jitter, count = 0.002, 0.0004, 10_000
    problem = replace(zoo.interval_problem(), delta=delta, sensing=Sensing(0.001, 0.0005, jitter, memory=False))
    controller = Controller(sdhj.solve(problem, progress=False))
    controller.step([0.0], 0.0)  # compiled
    here, there = multiprocessing.get_context("spawn").Pipe()
    clock = multiprocessing.get_context("spawn").Process(target=ticking, args=(there, delta, jitter / 2, count))
    clock.start()
    there.close()
    times, actions = [], []
    for _ in range(count):
        times.append(here.recv())
        actions.append(controller.step([0.0], times[-1]))
    clock.join()
    places = np.round(np.array(times) / delta)
    late = np.abs(np.array(times) - places * delta) > jitter
    missed = np.array([action.missed for action in actions])
    assert (missed == (late | (np.diff(places, prepend=-1) != 1))).all()
    assert 0 < missed.sum() < count
    print(f"missed {missed.sum()} of {count}, of these late {late.sum()}")


def test_a_loop_falls_back_or_says_so():
    controller = Controller(interval_tables(PLAYED)[0])
    action = controller.step([3.5], 0.0)
    assert action.steps_to_go is None and not action.promised
    with pytest.raises(sdhj.NotAdmissible):
        controller.step([3.5], 0.5, fallback=False)


@pytest.mark.parametrize("has_no_target", [False, True], ids=["a target", "staying clear"])
def test_at_the_last_step_a_loop_hears_whether_it_has_arrived(has_no_target):
    """The target is about (0.2 t - 1, 0): at step 2, after 0.4 s, (-0.92, 0) is in it and (2, 2) is not."""
    problem = zoo.torus_problem(steps=2)
    problem = replace(problem, target=None) if has_no_target else problem
    problem = replace(problem, sensing=Sensing(rest=REST))
    controller = Controller(sdhj.solve(problem, EXACT, progress=False))
    inside = [2.0, 2.0] if has_no_target else [-0.92, 0.0]
    for k in (0, 1):
        assert controller.step(inside, 0.2 * k).arrived == (not has_no_target)
    last = controller.step(inside, 0.4)
    assert last.arrived and last.steps_to_go == 0 and last.step == 2 and not last.missed
    assert last.input == REST and not last.promised
    outside = [np.cos(0.8), np.sin(0.8)] if has_no_target else [2.0, 2.0]  # in the obstacle
    controller.step(inside, 0.0), controller.step(inside, 0.2)
    for fallback in (True, False):
        last = Controller(controller.table).step(outside, 0.4, fallback=fallback)
        assert not last.arrived and last.steps_to_go is None and not last.promised
    with pytest.raises(ValueError, match="time "):
        controller.step(inside, 0.6)


@pytest.mark.parametrize("method", [sdhj.HJI(), sdhj.Certified(cells=[200])], ids=["hji", "certified"])
def test_a_loop_keeps_to_the_steps_that_were_promised(method):
    """Gusts are the stronger: whoever stays clear for four steps does so for three after the first, not for four."""
    problem = zoo.line((-0.5, 0.5), 1.0, grid=sdhj.Grid([-1.0], [1.0], [81]), target=None, delta=0.2, steps=4)
    table = sdhj.solve(problem, method, play=False)
    controller, q = sdhj.Controller(table), 0.57
    assert table.contains([[q]], start=0)[0] and not table.contains([[q + 0.1]], start=0)[0]
    for k in range(4):
        answer = controller.step([q], 0.2 * k)
        assert answer.promised and answer.steps_to_go == 4 - k
        q += 0.2 * (problem.inputs[answer.input, 0] + 1.0)
        assert q <= 1.0
    assert controller.step([0.0], 0.8).steps_to_go == 4  # for all steps again, from where that can be


def test_a_prediction_follows_the_current_of_its_own_time():
    """In a current that grows by 0.3 m/s in a second, from the measurement to the input's start: in closed form."""
    problem = zoo.line(delta=0.5, sensing=Sensing(delay=0.2, memory=False))
    moving = Dynamics(
        problem.inputs, lambda q, u, t: np.stack([u[0] + 0.3 * t + 0.0 * q[:, 0]], axis=1), [[1.0]], [0.1]
    )
    controller = Controller(sdhj.solve(replace(problem, dynamics=moving), play=False, progress=False))
    for step, j in itertools.product(range(4), range(3)):
        expected = 0.3 + 0.2 * problem.inputs[j, 0] + 0.3 * 0.2 * (0.5 * step + 0.1)
        assert controller.predict([0.3], j, step) == pytest.approx([expected], abs=1e-12)


def test_a_prediction_is_the_measurement_moved_on():
    controller = Controller(interval_tables(PLAYED)[0])
    np.testing.assert_allclose(controller.predict([1.0], 2), [1.2])
    np.testing.assert_allclose(controller.predict([1.0]), [0.8])  # the rest input, number 0
    np.testing.assert_allclose(controller.predict([[1.0], [3.9]], [1, 2]), [[1.0], [4.0]])  # held at the wall
    assert Controller(zoo.interval_table()).predict([1.0], 2).tolist() == [1.0]


@pytest.mark.parametrize(
    ("sensing", "ends", "method"),
    [
        (Sensing(), "unsafe", "hji"),
        (PLAYED, "wall", "hji"),
        (Sensing(), "wall", sdhj.Certified(cells=[60])),
        (PLAYED, "unsafe", sdhj.Certified(cells=[60])),
    ],
)
def test_nothing_is_promised_to_a_state_that_is_off_the_grid(sensing, ends, method):
    """A measurement may be off the grid by its error, no more: then the state is, which no tube contains."""
    problem = replace(zoo.interval_problem(unsafe=False), grid=Grid([-1.2], [1.2], [97], ends=ends), sensing=sensing)
    controller = Controller(sdhj.solve(replace(problem, steps=4), method, progress=False))
    may, off = 1.2 + sensing.error, 1.2 + sensing.error + 1e-3
    assert controller.predict([may], 0)[0] <= 1.2 and controller.predict([-may], 0)[0] >= -1.2
    assert not controller.table.contains([[1.2 + 1e-3], [-1.2 - 1e-3], [6.0]], start=0).any()  # a state, not measured
    for q in ([off], [-off], [6.0]):
        assert controller.predict(q, 0).tolist() == q
        action = controller.step(q, 0.0)
        assert action.steps_to_go is None and not action.promised
        with pytest.raises(sdhj.NotAdmissible, match="off the grid"):
            controller.step(q, 0.0, fallback=False)


# ---- what does not fit, files


def test_what_is_refused_of_problems():
    problem = zoo.interval_problem()
    with pytest.raises(ValueError, match=r"sdhj\.Sensing"):
        replace(problem, sensing=0.1)
    drift = sdhj.Dynamics(problem.inputs, lambda points, u, t: u + 0.1 * np.sin(t) + 0.0 * points, [[1.0]], [0.2])
    moving = TargetSet((0,), lambda p, t: np.abs(p[:, 0] - 0.1 * t) - 1.0)
    for other in ({"view_time": "instantaneous"}, {"dynamics": drift}, {"target": moving}):
        replace(problem, **other, sensing=Sensing(0.01, 0.02, memory=False))
        with pytest.raises(ValueError, match="sampling times are uncertain"):
            replace(problem, **other, sensing=Sensing(jitter=0.1, memory=False))
    with pytest.raises(ValueError, match='may be "safe"'):
        staying = replace(problem, target=None, grid=Grid([-4.0], [4.0], [81], ends="safe"))
        replace(staying, sensing=Sensing(0.1, memory=False))


@pytest.mark.slow
def test_runs_follow_the_steps_of_the_table():
    sure, plain = interval_tables(PLAYED)
    few = sdhj.monte_carlo(Controller(sure), 300, steps=2, progress=False)  # fewer than the table has
    assert few.steps.max() <= 2 and 0 < few.counts["late"] < 300
    proof = sdhj.Certified(cells=(320,))
    endless = sdhj.solve(replace(sure.problem, steps=None), proof, progress=False)
    assert sdhj.monte_carlo(Controller(endless), 300, progress=False).counts["reached"] == 300
    staying = sdhj.solve(replace(sure.problem, target=None, steps=None), proof, progress=False)
    ever = sdhj.monte_carlo(Controller(staying), 60, steps=60, progress=False)
    assert ever.counts["reached"] == 60 and ever.steps.min() == 60
    ends = replace(plain.problem, target=None, grid=Grid([-4.0], [4.0], [161], ends="safe"))
    safe = sdhj.solve(ends, EXACT, progress=False)
    with pytest.raises(ValueError, match='may be "safe"'):
        sdhj.monte_carlo(Controller(safe), 10, sensing=PLAYED, progress=False)


def test_what_a_loop_and_an_adversary_may_not_say():
    controller = Controller(interval_tables(PLAYED)[0])
    for previous in (3, 0.5, [0, 1]):
        with pytest.raises(ValueError, match="from 0 to 2"):
            controller.predict([1.0], previous)
    with pytest.raises(ValueError, match="measurement must have shape"):
        controller.predict([1.0, 2.0])
    with pytest.raises(ValueError, match="answer depends on time"):
        Controller(sdhj.solve(zoo.torus_problem(steps=1), EXACT, progress=False)).predict([0.0, 0.0])

    class Own:
        def __call__(self, moment):
            return moment.bounds

        def mislead(self, sight):
            return 0.0 * sight.states

        def shift(self, moment):
            return np.full(len(moment.states), 2)

    with pytest.raises(ValueError, match="-1, 0 or 1"):
        sdhj.simulate(controller, [-1.7], Own())
    Own.mislead = lambda self, sight: sight.states.fill(0.0)
    with pytest.raises(ValueError, match="read-only"):
        sdhj.simulate(controller, [-1.7], Own())


def test_a_problem_that_senses_is_another_one():
    """All of it counts, and what senses exactly is what it was."""
    problem = zoo.torus_problem(nodes=16, steps=2)
    told = [
        Sensing(),
        Sensing(0.01, memory=False),
        Sensing(0.01, 0.02, memory=False),
        Sensing(0.01, 0.03, memory=False),
        Sensing(0.01, 0.02, rest=1, memory=False),
    ]
    assert len({replace(problem, sensing=sensing).digest for sensing in told}) == len(told)
    assert (
        replace(problem, sensing=Sensing([0.01, 0.01], memory=False)).digest == replace(problem, sensing=told[1]).digest
    )
    assert replace(problem, sensing=Sensing(rest=1)).digest == problem.digest


def test_a_file_knows_what_it_was_solved_for(tmp_path):
    table, path = interval_tables(PLAYED)[0], tmp_path / "table.npz"
    table.save(path)
    assert read_head(path)["sensing"] == PLAYED
    assert sdhj.load(path, problem=table.problem).fraction(start=0, within=3) == table.fraction(start=0, within=3)
    with pytest.raises(sdhj.TableFileError, match="sensing is"):
        sdhj.load(path, problem=replace(table.problem, sensing=Sensing()))


@pytest.mark.parametrize("read", [0.0, 1.0], ids=["constant", "read"])
def test_what_inputs_lead_to_reckons_with_every_end_of_an_interval(read: float) -> None:
    """From 0.3 to 0.7 s on; where velocities read the state, up to the error of a box around the midpoint rule."""
    inputs = np.array([[-1.0], [0.0], [1.0]])
    dynamics = Dynamics(inputs, lambda q, u: u + read * 0.01 * np.sin(q), [[1.0]], [0.2])
    problem = zoo.line(dynamics=dynamics, sensing=Sensing(jitter=0.1))
    low, high = problem.interval(0).displacement_sets(np.zeros((1, 1)))[:2, :, 0, 0]
    ends = np.array([0.3, 0.7])[:, None] * (inputs[:, 0] + np.array([-0.2, 0.2])[:, None, None])
    np.testing.assert_allclose([low, high], [ends.min(axis=(0, 1)), ends.max(axis=(0, 1))], atol=read * 0.01)


def test_what_inputs_lead_to_reckons_with_the_error_now_and_at_the_next_step() -> None:
    """Without a memory: twice E = error + delay times the push; the controller looks up no less."""
    exact = zoo.interval_problem()
    sensed = replace(exact, sensing=sdhj.Sensing(0.05, 0.1, memory=False))
    boxes = [one.interval(0).displacement_sets(np.zeros((1, 1)))[:2, :, 0, 0] for one in (exact, sensed)]
    wider = 2 * (0.05 + 0.2 * 0.1)  # |v| <= 0.2
    np.testing.assert_allclose(boxes[1], boxes[0] + [[-wider], [wider]], atol=1e-12)
