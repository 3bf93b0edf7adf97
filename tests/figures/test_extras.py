"""The experiments of Sec. 6.1 on small grids: what they claim has to show in their data."""

from dataclasses import replace

import numpy as np
import pytest
import zoo
from artists import axes
from experiments import clearances, mean_interval, starts_outside
from extra_adversary import least_disturbance, sweep_adversary
from extra_evader import evading_target
from extra_input_levels import sweep_input_levels
from extra_rules import compare_rules, draw_rules
from extra_sensing import Promise, car, largest, limits, promised, sweep_sensing
from extra_view_time import compare_view_times
from matplotlib.container import BarContainer

import sdhj
from sdhj.arm.workspace import Disk, Still
from sdhj.simulation.runs import simulate


@pytest.mark.slow
@pytest.mark.parametrize("bound", ["v_p_max", "v_d_max"])
def test_a_stronger_adversary_leaves_less_until_nothing(bound):
    """Larger boxes for the adversary hold the smaller ones, so the maximum over them grows; steps this wide hide what
    interpolation adds."""
    values = (0.0, 0.8, 5.0)
    sweep = sweep_adversary(bound, values, "lax", nodes=9, steps=2)
    assert sweep.values == values
    assert all(np.diff(sweep.fractions) <= 0) and sweep.won[0] > 0.02 and sweep.won[-1] == 0.0
    assert sweep.extinct == values[sweep.won.index(0.0)]
    gained = np.subtract(sweep.fractions, sweep.won)
    np.testing.assert_allclose(gained, gained[-1], atol=1e-12)  # the target itself does not depend on the adversary
    assert sweep_adversary(bound, values[:1], "lax", nodes=9, steps=2).extinct is None


def test_the_disturbance_that_leaves_nothing_by_hand():
    """The product of Jacobian and push by differences, where the target will be: 1.87 rad/s of chapter 14."""
    problem, tip = sdhj.arm_case_study(nodes=5), lambda q: np.array([np.cos(q).sum(), np.sin(q).sum()]) * 0.15
    least = []
    for k in range(1, 9):
        far = np.hypot(0.05 + 0.1 * 0.1 * k, 0.2 - 0.05 * 0.1 * k)
        q = np.array([0.0, np.arccos((far**2 - 2 * 0.15**2) / (2 * 0.15**2))])  # angles of both links to the first axis
        signs = (1.0, 1.0 + 1.0), (1.0, 1.0 - 1.0)  # how fast these turn if the joints turn at 1, and 1 or -1, rad/s
        pushes = [np.linalg.norm(tip(q + 1e-6 * np.array(s)) - tip(q - 1e-6 * np.array(s))) / 2e-6 for s in signs]
        least.append(0.06 / (0.1 * max(pushes)))
    assert least_disturbance(problem) == pytest.approx(max(least), rel=1e-6) == pytest.approx(1.87, abs=0.005)


@pytest.mark.slow
def test_more_input_levels_never_lose_and_cost_in_proportion():
    """The samples with 3 levels are among those with 5 and with 7, and those with 5 among those with 9."""
    sweep = sweep_input_levels((3, 5, 7, 9), method="lax", nodes=9, steps=2)
    three, five, seven, nine = sweep.fractions
    assert three <= five <= nine and three <= seven and nine > three
    assert sweep.inputs == (9, 25, 49, 81)
    assert all(least > 0 for seconds in sweep.seconds.values() for least in seconds)
    assert sweep.seconds.keys() == {"paper's scheme", "default"}


@pytest.fixture(scope="module")
def table():
    return zoo.arm_table()


@pytest.fixture(scope="module")
def compared(table):
    return compare_rules(table, 60)


@pytest.mark.slow
def test_rules_trade_effort_clearance_and_time(compared):
    outcomes = {outcome.rule: outcome for outcome in compared}
    assert set(outcomes) == {"deepest", "effort", "target", "clearance"}
    assert all(outcome.reached > 50 for outcome in outcomes.values())
    assert min(outcomes.values(), key=lambda o: o.effort.mean()).rule == "effort"
    assert max(outcomes.values(), key=lambda o: o.clearance.mean()).rule == "clearance"
    assert outcomes["target"].time.mean() <= outcomes["effort"].time.mean()
    assert outcomes["effort"].effort.mean() < 0.9 * outcomes["target"].effort.mean()


def test_clearances_are_those_of_the_true_geometry(table):
    problem = table.problem
    q0 = starts_outside(table, 1, 3)[0]
    run = simulate(sdhj.Controller(table), q0, "random", seed=3)
    coarse, fine = (clearances(problem, [run], finer)[0] for finer in (1, 7))
    values = [problem.unsafe_value(q[None], t)[0] for q, t in zip(run.states, run.times, strict=True)]
    assert coarse == pytest.approx(min(values), abs=1e-12)  # rounding of times
    assert fine <= coarse
    assert clearances(problem, [], 1).shape == (0,)


def test_intervals_of_means_are_1_96_standard_errors():
    values = [1.0, 2.0, 3.0, 6.0]  # mean 3, standard deviation sqrt(14 / 3)
    half = 1.959964 * np.sqrt(14 / 3) / 2
    assert mean_interval(values) == pytest.approx((3 - half, 3 + half), rel=1e-6)
    assert np.isnan(mean_interval([1.0])).all()


@pytest.mark.slow
def test_rules_are_drawn_with_their_intervals(compared):
    axs = axes(ncols=3)
    draw_rules(axs, compared)
    (bars,) = (container for container in axs[2].containers if isinstance(container, BarContainer))
    good = np.logical_and.reduce([outcome.arrived for outcome in compared])
    times = np.full((len(compared), len(good)), np.nan)
    for row, outcome in zip(times, compared, strict=True):
        row[outcome.arrived] = outcome.time
    changed = (times[1:] - times[0])[:, good]
    assert good.sum() > 50 and [bar.get_height() for bar in bars] == pytest.approx(changed.mean(axis=1))
    ends = [stroke[:, 1] for stroke in bars.errorbar[2][0].get_segments()]
    np.testing.assert_allclose(ends, [mean_interval(values) for values in changed])


@pytest.mark.slow
def test_sampled_obstacles_let_collisions_through():
    """A thin obstacle at 20 m/s: the gaps between 20 samples are wider than the arm, and runs end in them."""
    nodes = (25, 25, 5, 5)  # the pursuer's axes matter little here
    swept, sampled = compare_view_times(("swept", "sampled"), nodes=nodes, steps=2, runs=80)
    assert swept.fraction < sampled.fraction
    assert sampled.deepest < 0 and sampled.rate > 0.1
    assert sampled.collided > 5 * swept.collided  # those of the grid's own error
    assert swept.runs == sampled.runs == 80


@pytest.mark.slow
def test_without_an_obstacle_that_moves_view_times_agree():
    still = Disk(Still((-0.22, 0.10)), 0.06)
    outcomes = compare_view_times(nodes=9, steps=1, runs=10, obstacles=[still])
    assert len({(outcome.fraction, outcome.collided, outcome.deepest) for outcome in outcomes}) == 1


@pytest.mark.slow
def test_the_evader_is_caught_by_the_full_method_and_lost_by_projection():
    found = evading_target(nodes=13, steps=3, runs=200)
    assert found.won > 0.01 and found.projected_won == 0.0
    assert found.full.fraction(start=0, within=3) > found.won
    assert len(found.warnings) == 2 and "target depends on py" in found.warnings[0]
    assert set(found.reports) == {"random", "worst"}
    assert found.chase.outcome == "reached" and len(found.chase.inputs) > 0
    assert found.reports["random"].rate("reached") > 0.8
    assert found.reports["worst"].rate("reached") <= found.reports["random"].rate("reached")


@pytest.mark.slow
def test_nothing_to_simulate_is_an_error():
    hopeless = sdhj.solve(sdhj.arm_case_study(nodes=9, steps=1, v_d_max=5.0), progress=False)
    with pytest.raises(ValueError, match="nothing but the target"):
        compare_rules(hopeless, 2)


@pytest.fixture(scope="module")
def small_car():
    return replace(car(), grid=sdhj.Grid([-2, -2, -np.pi], [2, 2, np.pi], [21, 21, 16], [False, False, True]), steps=2)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["error", "delay", "jitter"])
def test_more_uncertainty_promises_less(small_car, kind):
    """Sets shrink, as `sdhj.problem.sensing` says; the first value is that of the perfect robot."""
    methods = {"hji": "hji", "certified": sdhj.Certified(cells=(28, 28, 26), parts=2)}
    perfect = {}
    found = sweep_sensing(small_car, methods, kind, (0.0, 0.02, 0.05), perfect)
    assert {(small_car.digest, name): promises[0] for name, promises in found.items()} == perfect
    for name, promises in found.items():
        shares = [promise.share for promise in promises]
        assert shares[0] > shares[-1] and shares == sorted(shares, reverse=True), name
        assert all(promise.beyond >= 0 for promise in promises)
    plain = sdhj.solve(small_car, progress=False)
    assert found["hji"][0].share == plain.fraction(start=0, within=2)


@pytest.mark.slow
def test_what_leaves_anything_is_found_by_halving(small_car):
    """The target is a disk of radius 0.4: E is taken off twice, on both axes, around some node."""
    assert [round(end, 3) for end in largest(lambda value: value < 0.3, 1.0, 10)] == [0.3, 0.301]
    assert largest(lambda value: True, 0.25) == (0.25, 0.25)
    (low, high), (less, more) = limits(small_car, "hji", "error", 0.5)
    assert 0.4 / np.sqrt(8) - 0.15 < low <= high < 0.4 / np.sqrt(8) + 0.01  # the diagonal of 2 E; nodes are 0.2 apart
    assert less <= more <= high
    assert promised(small_car, "hji", "error", high) == Promise()
    assert promised(small_car, "hji", "error", less).share > 0  # at `low` what is left lies between nodes
    with pytest.raises(ValueError, match=r"delay \+ 2 jitter"):
        promised(small_car, "hji", "delay", 1.0)
