"""The judge of promises is judged by closed forms; its robots are built; the page says what it says."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from fleet import FLEET, Hazard, Robot, many_inputs
from judge import ADVERSARIES, Answer, Moment, advanced, reckless, trial, vertices
from promises import HEAD, MARK, ROBOTS, bounds, heading, main, rows

PAGE = Path(__file__).parents[3] / "notebooks" / "site" / "numbers.md"
BRAKE, PUSH = 1.0, 0.2  # m/s^2, of `fleet.double_integrator`


def nowhere(points, step, left):
    """The level of a tube that holds everything."""
    return np.full(points.shape[:2], -1.0)


def rightward(points, step, left):
    """The level of a tube that holds what is left of 0."""
    return points[:, :, 0]


def steered(inputs, promised=True):
    """Answers of a robot whose inputs are a function of the states, or one for all."""

    def ask(states, step):
        chosen = inputs(states) if callable(inputs) else np.full(len(states), inputs)
        kept = promised(step) if callable(promised) else promised
        return Answer(chosen, np.full(len(states), kept), np.zeros(len(states), int))

    return ask


def braking(side):
    """As hard as it can against a motion to one side, and then slowly back, of `fleet.double_integrator`."""
    return lambda states: np.where(side * states[:, 1] > -0.3, 1 - int(side), 1)


def play(robot, ask, begun, adversary="none", steps=20, tube=nowhere):
    return trial(robot, ask, tube, ADVERSARIES[adversary], begun, steps, np.random.default_rng(0))


def line(hazards, delta=1.0, **changed):
    """A point that goes to the right at 1 m/s, come what may."""
    given = {"lower": [-2.0], "upper": [9.0], "nodes": [12], "inputs": np.array([[1.0]]), "gain": np.eye(1)}
    given |= {"drift": lambda q, u: 0.0 * q + u, "bounds": np.array([0.0]), "delta": delta, "steps": 3}
    return Robot(hazards=hazards, **(given | changed))


# ---- the judge


@pytest.mark.slow
@pytest.mark.parametrize("adversary", ["none", "worst", "nearer", "outward"])
@pytest.mark.parametrize("side", [1, -1])
def test_who_starts_beyond_its_braking_distance_is_lost_and_who_starts_before_is_not(adversary, side):
    """Braking from speed v takes v^2 / 2b, with b less what pushes: a tenth of a millimetre decides, and no grid."""
    robot, speeds = FLEET["double integrator"](), np.linspace(0.3, 1.6, 14)
    way = speeds**2 / 2 / (BRAKE if adversary == "none" else BRAKE - PUSH)
    for off, outcome in ((1e-4, "off the grid"), (-1e-4, "won")):
        begun = side * np.stack([1.0 - way + off, speeds], axis=1)
        outcomes, _ = play(robot, steered(braking(side)), begun, adversary, 25, lambda q, step, left: side * q[:, :, 0])
        assert (outcomes == outcome).all()


def test_a_collision_between_two_instants_is_seen():
    """Post and door are clear at every sampling time; the door is shut for a twentieth of an interval."""
    post = Hazard((0,), lambda p, t: np.abs(p[:, 0] - 0.5) - 0.1, "post")
    door = Hazard(
        (0,), lambda p, t: np.abs(p[:, 0] - 1.5) - 0.6 + 10 * np.maximum(np.abs(t - 1.5) - 0.025, 0.0), "door"
    )
    for hazard in (post, door):
        outcomes, _ = play(line([hazard]), steered(0), [[0.0], [0.7]], steps=3)
        assert outcomes.tolist() == ["collided", "won"]


def test_who_starts_in_what_is_unsafe_is_lost_at_once():
    post = Hazard((0,), lambda p, t: np.abs(p[:, 0] - 0.5) - 0.1, "post")
    outcomes, promised = play(line([post]), steered(0), [[0.5]])
    assert outcomes.tolist() == ["collided"] and not promised.any()


def test_ends_are_what_they_stand_for():
    """Past an unsafe one is lost, past a safe one is won; a wall holds, as brakes do at a standstill."""
    robot = line([], upper=[2.5])
    assert play(robot, steered(0), [[0.0], [-1.0]], steps=3)[0].tolist() == ["off the grid", "won"]
    robot = line([Hazard((0,), lambda p, t: 3.0 - p[:, 0], "beyond")], upper=[2.5], ends=[("unsafe", "safe")])
    assert play(robot, steered(0), [[0.0]], steps=9)[0].tolist() == ["won"]
    car, q = FLEET["crossing"](), np.array([[-20.0, 1.0, -20.0]])
    for _ in range(80):
        q = advanced(car, q, np.array([[-1.5]]), np.zeros((1, 2)), 0.0, 0.0125)
    np.testing.assert_allclose(q, [[-20.0 + 1 / 3, 0.0, -12.0]], atol=0.01)


def test_who_is_late_is_lost_and_who_arrives_is_not():
    robot = line([], target=((0,), lambda p, t: np.abs(p[:, 0] - 3.0 - t) - 0.5))  # which flees as fast
    outcomes, promised = play(robot, steered(0), [[0.0], [2.8]], steps=3)
    assert outcomes.tolist() == ["late", "won"] and promised.tolist() == [True, False]  # it never had to be asked


def test_a_promise_counts_until_the_run_is_lost():
    robot, begun = line([], upper=[2.5]), [[0.0]]
    assert play(robot, steered(0), begun)[1].all()
    assert not play(robot, steered(0, lambda step: step != 1), begun)[1].any()
    assert play(robot, steered(0, lambda step: step < 3), begun)[1].all()  # it is off before
    none = steered(lambda states: np.where(states[:, 0] > 0.5, -1, 0), lambda step: step < 1)
    outcomes, promised = play(robot, none, [[0.0], [1.0]])
    assert outcomes.tolist() == ["no answer"] * 2
    assert promised.tolist() == [True, False]  # the second was never promised anything


def test_motion_is_that_of_the_equation():
    """A pendulum about where it hangs is as good as linear; a step of the judge's is as good as exact."""
    robot = replace(FLEET["pendulum"](), inputs=np.array([[0.0]]))
    q, h = np.array([[1e-5, 0.0]]), robot.delta / 40
    for k in range(400):
        q = advanced(robot, q, np.zeros((1, 1)), np.zeros((1, 1)), k * h, h)
    np.testing.assert_allclose(q[0, 0], 1e-5 * np.cosh(np.sqrt(9.81) * 400 * h), rtol=1e-7)


# ---- the adversaries


def moment(robot, states, rng, tube=nowhere, parts=0):
    count, left = len(states), robot.delta * (1 - parts / 8)
    commands = np.tile(robot.inputs[0], (count, 1))
    return Moment(robot, states, commands, np.arange(count), 0, 0.0, left, np.zeros(count, int), tube, rng)


@pytest.mark.parametrize("name", FLEET)
def test_adversaries_stay_in_their_box_and_use_it(name, rng):
    robot = FLEET[name]()
    states = rng.uniform(robot.lower, robot.upper, (30, robot.ndim))
    for label, adversary in ADVERSARIES.items():
        pushes = adversary(moment(robot, states, rng, rightward))
        assert pushes.shape == (30, len(robot.bounds)) and (np.abs(pushes) <= robot.bounds).all()
        assert (np.abs(pushes) == (0.0 if label == "none" else robot.bounds)).all()


def test_adversaries_push_where_they_should(rng):
    robot = FLEET["double integrator"]()
    states = np.array([[0.8, 0.5], [-0.8, -0.5]])
    for name, tube in (("nearer", nowhere), ("worst", nowhere)):
        assert ADVERSARIES[name](moment(robot, states, rng, tube)).ravel().tolist() == [PUSH, -PUSH], name
    for name in ("outward", "worst"):
        assert ADVERSARIES[name](moment(robot, states, rng, rightward)).ravel().tolist() == [PUSH, PUSH], name


def test_who_switches_does_and_who_keeps_on_does(rng):
    robot = many_inputs()
    states = np.tile([[1.0, 1.0]], (64, 1))
    pushes = [ADVERSARIES["random"](moment(robot, states, rng)) for _ in range(2)]
    kept = [ADVERSARIES["push"](moment(robot, states, rng)) for _ in range(2)]
    assert (pushes[0] != pushes[1]).any() and (kept[0] == kept[1]).all()
    assert len(np.unique(kept[0], axis=0)) == len(vertices(robot)) == 4


def test_who_leaves_its_box_is_told():
    with pytest.raises(ValueError, match="left its box"):
        trial(line([]), steered(0), nowhere, lambda seen: np.ones((1, 1)), [[0.0]], 2, np.random.default_rng(0))


def test_the_reckless_commander_drives_at_what_is_near():
    robot = FLEET["double integrator"]()
    assert reckless(robot, np.array([[0.5, 0.3], [-0.5, -0.3]]), 0.0).tolist() == [2, 0]


# ---- the robots


@pytest.mark.parametrize("name", FLEET)
def test_a_problem_is_built_of_what_the_judge_knows(name, rng):
    robot, problem = FLEET[name](), ROBOTS[name]()
    states = rng.uniform(robot.lower, robot.upper, (500, robot.ndim))
    places, v = rng.integers(len(robot.inputs), size=500), rng.uniform(-1, 1, (500, len(robot.bounds))) * robot.bounds
    interval = problem.interval(0)
    theirs = interval.undisturbed(states, places, 0.0) + np.einsum("mad,md->ma", problem.dynamics.gain_at(states), v)
    np.testing.assert_allclose(robot.velocity(states, robot.inputs[places], v), theirs, atol=1e-9)
    for t in (0.0, 0.7):
        if problem.unsafe:
            assert np.array_equal(robot.unsafe(states, t) <= 0, problem.unsafe_value(states, t) <= 0)
        if robot.target:
            assert np.array_equal(robot.reached(states, t), problem.target_value(states, t) <= 0)
    for kind, fate in (("unsafe", "fails"), ("safe", "frees"), ("wall", "holds")):
        np.testing.assert_array_equal(robot.faces[kind], problem.grid.faces(fate))
    turns = np.where(robot.periodic or [False] * robot.ndim, np.array(robot.upper) - robot.lower, 0.0)
    np.testing.assert_allclose(robot.unsafe(states + turns, 0.0), robot.unsafe(states, 0.0), atol=1e-9)
    np.testing.assert_allclose(
        robot.velocity(states + turns, robot.inputs[places], v),
        robot.velocity(states, robot.inputs[places], v),
        atol=1e-9,
    )


# ---- the table


def test_bounds_of_rates_are_exact():
    assert bounds(0, 100) == pytest.approx((0.0, 1 - 0.025 ** (1 / 100)))
    assert bounds(100, 100) == pytest.approx((0.025 ** (1 / 100), 1.0))
    low, high = bounds(5, 50)
    assert bounds(45, 50) == pytest.approx((1 - high, 1 - low)) and low < 0.1 < high


@pytest.mark.slow
def test_the_command_writes_its_table(tmp_path):
    options = ["--robot", "rail", "--method", "hji, 60 steps", "--runs", "20", "--out", str(tmp_path)]
    done = CliRunner().invoke(main, options)
    assert done.exit_code == 0, done.output
    lines = (tmp_path / "promises.md").read_text(encoding="utf-8").splitlines()
    assert (
        lines[:2] == heading() and lines[2].startswith("| rail | 81 x 81 |") and "hji, 60 steps, filtered" in lines[3]
    )
    with open(tmp_path / "promises.csv", encoding="utf-8") as file:
        found = list(csv.DictReader(file))
    assert [row["runs"] for row in found] == ["120", "120"] and float(found[0]["solved"]) > 0


def told():
    """The rows of the page: (robot, method) -> dict."""
    lines = PAGE.read_text(encoding="utf-8").split(MARK)[1].strip().split("\n\n")[0].splitlines()
    assert lines[:2] == heading()
    found = [dict(zip(HEAD, line.strip("| ").split(" | "), strict=True)) for line in lines[2:]]
    return {(row["robot"], row["method"]): row for row in found}


def number(text):
    return int(text.replace(",", ""))


PLAYED = 500  # starts, as the page says


DOUBT = 1e-4  # of each of the two bounds below


def divergence(p, q):
    """Of two coins, D(p || q): n throws of coin q show at least a share p > q with probability exp(-n D) at most."""
    p, q = np.clip(p, 1e-12, 1 - 1e-12), np.clip(q, 1e-12, 1 - 1e-12)
    return p * np.log(p / q) + (1 - p) * np.log((1 - p) / (1 - q))


def allowed(share, seen, again):
    """The share that may be lost of the runs from `again` starts where `share` was lost of those from `seen`.

    Starts are independent, the six runs from each are not. Their mean lies in [0, 1], so by Hoeffding it is at most as
    spread as a coin, and Chernoff's bound holds twice: for what the true rate is at most, and for what few starts show.
    """
    rates = np.linspace(0.0, 1.0, 100_001)
    above = rates[rates >= share]
    true = above[seen * divergence(share, above) <= -np.log(DOUBT)].max(initial=share)
    above = rates[rates >= true]
    return above[again * divergence(above, true) <= -np.log(DOUBT)].max(initial=true)


@pytest.mark.slow
@pytest.mark.parametrize("name", FLEET)
@pytest.mark.filterwarnings("ignore:::sdhj")
def test_no_more_is_lost_than_the_page_says(name):
    """Of fewer starts, others, and for ever is shorter, in which no more is lost; of certified tables nothing is."""
    said, starts = told(), 100
    for row in rows([name], starts, 60, 1):
        print(row)
        page = said[name, row.method]
        assert row.share == pytest.approx(float(page["share promised"][:-1]) / 100, abs=0.001)
        for lost, seen in ((row.lost, page["lost"]), (row.promised, page["lost while promised"])):
            if row.method.startswith("certified"):
                assert lost == 0
            else:
                assert lost / row.runs <= allowed(number(seen) / number(page["runs"]), PLAYED, starts)
