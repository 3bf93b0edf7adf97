"""Certified sets of robots that measure with an error, act late and by a clock that is off."""

import tracemalloc
from dataclasses import replace
from functools import cache

import forged_robots
import judge
import numpy as np
import pytest
import zoo
from forging import forged
from zoo import car

import sdhj
from sdhj import Sensing
from sdhj.certified import table as table_module
from sdhj.certified.cells import moved_bounds
from sdhj.certified.general_proof import GeneralProof
from sdhj.certified.table import AT_ONCE
from sdhj.kernels.packed import to_bits
from sdhj.table.beside import predicted

ALL = Sensing(0.005, 0.02, 0.005, memory=False)
PUSHES = ("switching", "to the post", "off the target")


@cache
def solved(sensing=ALL, cells=(48, 48, 45)):
    return sdhj.solve(replace(car(), sensing=sensing), sdhj.Certified(cells=cells, parts=4), progress=False)


# ---- the sets


@pytest.mark.slow
@pytest.mark.parametrize("by_cells", [False, True])
def test_many_cells_in_the_box_of_an_error_take_little_memory(monkeypatch, by_cells):
    """A box holds 200 cells here; all states inside at once would take some 50 MB for each copy of their points.

    by_cells : every cell is asked about, and none left out because its box or a corner tells.
    """
    if by_cells:
        monkeypatch.setattr(table_module, "MANY", 10**9)
    problem = replace(zoo.interval_problem(), sensing=Sensing(0.05))
    table = sdhj.solve(problem, sdhj.Certified((16_000,)), progress=False)
    states = np.random.default_rng(0).uniform(-4.0, 4.0, (60_000, 1))
    few = [table.contains(some, start=0, within=5) for some in np.array_split(states, 100)]
    tracemalloc.start()
    try:
        many = table.contains(states, start=0, within=5)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert np.array_equal(many, np.concatenate(few)) and 0 < many.mean() < 1
    assert peak < 8 * 8 * AT_ONCE  # numbers of 8 bytes, in a few copies


def closing(sensing):
    """Two angles, the target where the second closes."""

    def target(p, t):
        return np.hypot(p[:, 0] + 1, zoo.wrapped(p[:, 1] - np.pi)) - 0.8

    return replace(zoo.torus_problem(), target=sdhj.TargetSet((0, 1), target), sensing=sensing)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("problem", "cells", "region"),
    [
        (
            lambda: replace(car(), sensing=Sensing((0.02, 0.15, 0.12), memory=False)),
            (40, 40, 37),
            ([1.0, 0.6, -np.pi], [1.4, 1.0, np.pi]),
        ),
        (lambda: closing(Sensing((0.05, 0.2), memory=False)), (60, 60), ([-1.8, 2.3], [-0.2, 4.0])),
    ],
    ids=["car", "narrower cells"],
)
def test_states_are_promised_as_plain_loops_say(problem, cells, region, rng):
    """Cell after cell that what is measured may be in; where an angle closes a cell may be narrower."""
    problem = problem()
    table, grid = sdhj.solve(problem, sdhj.Certified(cells), progress=False), problem.grid
    sets, edges = table.bits(start=0, within=table.steps), [axis.edges() for axis in table.axes]
    states = rng.uniform(*region, (3000, grid.ndim))
    promised = table.contains(states, start=0, within=table.steps)
    assert 0.05 < promised.mean() < 0.95
    assert len(set(np.diff(edges[-1]).round(9))) == (1 if grid.ndim == 3 else 2)
    for state, told in zip(states, promised, strict=True):
        near = []
        for axis, (x, off) in enumerate(zip(state, table.proof.prediction_error, strict=True)):
            laps = (-2 * np.pi, 0.0, 2 * np.pi) if grid.periodic[axis] else (0.0,)
            low, high = x - off + 1e-9, x + off - 1e-9
            met = [(edges[axis][:-1] + lap < high) & (low < edges[axis][1:] + lap) for lap in laps]
            near.append(np.flatnonzero(np.any(met, axis=0)))
        assert told == sets[np.ix_(*near)].all(), state


def test_what_an_interval_does_to_predictions():
    """A robot on a line, by hand; nothing is solved."""
    sensing = Sensing(0.03, 0.2, 0.05, memory=False)
    problem, method = replace(zoo.interval_problem(), sensing=sensing), sdhj.Certified((2000,))
    proof, off = GeneralProof.of(problem, method.axes(problem), 10), 0.03 + 0.2 * 0.2
    tubes, last = proof.tubes_of_places(np.array([0]), 2, 0.2, 2)  # at 0.8 to 1.2, for 0.4 to 0.6 s
    np.testing.assert_allclose(last[0, 0], [0.8 * 0.4 - 2 * off, 1.2 * 0.6 + 2 * off], atol=1e-8)
    np.testing.assert_allclose(tubes[0, :, 0, 0], -off + 0.8 * 0.06 * np.arange(10), atol=1e-8)
    np.testing.assert_allclose(tubes[0, :, 0, 1], off + 1.2 * 0.06 * np.arange(1, 11), atol=1e-8)
    assert [float(end) for end in moved_bounds(problem, 0, 2)] == pytest.approx(last[0, 0].tolist(), abs=1e-8)
    (axis,), goal = proof.axes, to_bits(proof.goal(0), proof.axes[0].count)[0]
    held = axis.edges()[np.flatnonzero(goal)[[0, -1]] + [0, 1]]
    assert (np.abs(held) <= 1.0 - off).all() and (np.abs(held) > 1.0 - off - 1.01 * float(axis.width)).all()


# ---- predictions


@pytest.mark.parametrize("sensing", [Sensing(0.01, 0.1, memory=False), Sensing((0.0, 0.03, 0.02), 0.2, memory=False)])
def test_no_prediction_is_farther_off_than_proved(sensing, rng):
    """Errors at corners, an adversary who pushes steadily or switches; and it is proved to no more than it should be.

    In a stride of an eighth of the delay the car, at 1 m/s and 2 rad/s, turns by a quarter of the delay.
    """
    problem = replace(car(), sensing=sensing)
    proof, count = sdhj.Certified(cells=(20, 20, 19)).proof(problem), 2000
    states = rng.uniform([-1.5, -1.5, -np.pi], [1.5, 1.5, np.pi], (count, 3))
    places, worst = rng.integers(0, 6, count), np.zeros(3)
    for steady in (True, False):
        errors = np.broadcast_to(sensing.error, (count, 3)) * rng.choice([-1.0, 1.0], (count, 3))
        seen = predicted(problem, states + errors, places)
        now, v = states, rng.choice([-0.1, 0.1], (count, 2))
        for _ in range(10):
            v = v if steady else rng.choice([-0.1, 0.1], (count, 2))
            now = judge.rk4(lambda q, t, v=v: drive(q, places, v / 0.1), now, 0.0, sensing.delay / 10)
        worst = np.maximum(worst, np.abs(now - seen).max(axis=0))
    x, y, turned = np.zeros(3) + sensing.error
    known = [e + sensing.delay * (0.1 + turned + sensing.delay / 4) for e in (x, y)]
    assert (worst <= proof.prediction_error + 1e-12).all()
    assert (proof.prediction_error[:2] <= 1.05 * np.array(known)).all() and proof.prediction_error[2] == pytest.approx(
        turned
    )


# ---- played: a plant that shares nothing with the library


def drive(q, places, signs):
    """The car's velocity, written again."""
    speed, turn = np.array([0.5, 1.0])[places // 3], np.array([-2.0, 0.0, 2.0])[places % 3]
    wind = 0.1 * signs
    return np.stack([speed * np.cos(q[:, 2]) + wind[:, 0], speed * np.sin(q[:, 2]) + wind[:, 1], turn], axis=1)


def judged(table, sensing, push, rng, count=1000):
    """The outcomes of runs of a robot that senses so, and is promised something by the table."""
    controller = sdhj.Controller(table)
    if sensing != table.problem.sensing:  # a table that knows nothing of it: its controller predicts all the same
        knows = replace(table.problem, sensing=sensing)
    else:
        knows = table.problem

    def choose(measured, held, step):
        batch = controller.batch(predicted(knows, measured, held, step), step)
        inputs = np.full(len(measured), -1) if step == table.steps else controller.choose(batch)
        return inputs, batch.steps_to_go == 0

    def signs(q, held):
        if push == "switching":
            return rng.choice([-1.0, 1.0], (len(q), 2))
        away = np.array([1.2, 0.8]) if push == "off the target" else np.zeros(2)
        way = q[:, :2] - away
        return np.where(way > 0, 1.0, -1.0) * (1 if push == "off the target" else -1)

    corner = rng.choice([-1.0, 1.0], (count, 3)) * np.broadcast_to(sensing.error, (count, 3))

    def mislead(q):
        return q + (corner if push != "switching" else corner * rng.choice([-1.0, 1.0], q.shape))

    def unsafe(q):
        ends = np.min(2.0 - np.abs(q[:, :2]), axis=1) + 1e-9
        return np.minimum(np.hypot(q[:, 0], q[:, 1]) - 0.4, ends)

    late = rng.choice([-1.0, 1.0], (table.steps + 1, count)) * sensing.jitter
    return judge.play_sensed(
        choose,
        drive,
        signs,
        mislead,
        lambda q: np.hypot(q[:, 0] - 1.2, q[:, 1] - 0.8) - 0.4,
        unsafe,
        lambda q: table.contains(q, start=0, within=table.steps),
        rng.uniform([0.0, -0.6, -np.pi], [2.0, 2.0, np.pi], (count, 3)),
        late,
        delta=0.25,
        delay=sensing.delay,
        steps=table.steps,
    )


@pytest.mark.slow
@pytest.mark.parametrize("push", PUSHES)
def test_no_run_is_lost_and_without_sensing_some_are(push, rng):
    outcomes = judged(solved(), ALL, push, rng)
    assert set(outcomes) == {"reached", "nothing promised"} and (outcomes == "reached").sum() > 50
    harsh = Sensing(0.02, 0.1, 0.02, memory=False)
    control = judged(solved(Sensing()), harsh, push, rng)
    assert np.isin(control, ["left", "late", "wrong", "collided"]).sum() > 3


# ---- the arm


@cache
def arm(sensing, agent):
    from sdhj.arm.workspace import Disk, Still

    if agent == "pursuer":
        problem = sdhj.arm_case_study(nodes=9, steps=2, target=Disk(Still((0.1, 0.15)), 0.08))
    else:
        problem = sdhj.evader_case_study(nodes=9, steps=2, evader_radius=0.1)
    return sdhj.solve(replace(problem, sensing=sensing), sdhj.Certified(cells=(105, 105, 24, 24)), progress=False)


SHAKY = Sensing((0.01, 0.01, 0.004, 0.004), 0.01, 0.004, memory=False)


@pytest.mark.slow
@pytest.mark.parametrize("agent", ["pursuer", "evader"])
def test_the_arm(agent):
    sure, plain = arm(SHAKY, agent), arm(Sensing(), agent)
    off = 0.004 + 0.01 * (0.2 if agent == "pursuer" else 0.1)
    np.testing.assert_allclose(sure.proof.prediction_error, [0.013, 0.013, off, off])
    shares = [table.fraction(start=0, within=2) for table in (sure, plain)]
    assert 0.002 < shares[0] < 0.8 * shares[1]
    for adversary in ("random", "worst"):
        assert sdhj.monte_carlo(sdhj.Controller(sure), 2000, adversary, progress=False).counts["reached"] == 2000
    control = sdhj.monte_carlo(sdhj.Controller(plain), 2000, sensing=SHAKY, progress=False)
    assert control.counts["reached"] < 1950


def test_a_file_of_larger_errors_than_a_controller_counts_on_is_not_loaded(tmp_path):
    """It would take what is measured for too far off, and begin anew where nothing is promised."""
    path = tmp_path / "table.npz"
    path.write_bytes(forged_robots.file_of("spread and remembered"))
    assert sdhj.load(path).fraction() > 0.0
    with forged(path) as (told, _):
        told["proof"]["unsure"] = [1.001 * off for off in told["proof"]["unsure"]]
    with pytest.raises(ValueError, match="predictions must be off by"):
        sdhj.load(path)


def test_sets_of_each_step_are_not_loaded_where_nothing_moves(tmp_path):
    """All steps are asked about as step 0 is, whose sets need not hold those of step 1."""
    path = forged_robots.FORGERIES["sets of each step where nothing moves"].write(
        forged_robots.file_of("line"), tmp_path / "table.npz"
    )
    with pytest.raises(ValueError, match="its array index"):
        sdhj.load(path)
