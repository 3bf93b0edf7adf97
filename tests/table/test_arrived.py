"""Whoever is in the target itself has arrived, by every answer of a certified table, in Python and in C."""

import ctypes
import shutil
import subprocess
from functools import cache

import numpy as np
import pytest
import zoo

import sdhj
from sdhj.certified.arriving import WRITTEN, arrived_in_c
from sdhj.formulas.graph import ordered

POST, RADIUS, PACE = (0.0, 0.0, 0.4), 0.5, 0.2


def car(pace=PACE, steps=3):
    """The README's, whose goal may move along x."""
    return zoo.car(
        grid=sdhj.Grid([-2, -2, -np.pi], [2, 2, np.pi], [21, 21, 16], periodic=[False, False, True]),
        target=sdhj.TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 0.6 - pace * t, p[:, 1] - 0.2) - RADIUS),
        unsafe=[zoo.post(*POST)],
        steps=steps,
    )


@cache
def solved(pace=PACE):
    return sdhj.solve(car(pace), sdhj.Certified(cells=(40, 40, 32)), progress=False, play=False)


def states_at(step, pace=PACE, count=1000):
    """States anywhere, and the judge's word whether they have arrived; none is on the border itself."""
    q = np.random.default_rng(step).uniform([-2.2, -2.2, -9], [2.2, 2.2, 9], (count, 3))
    there = np.hypot(q[:, 0] - 0.6 - pace * 0.25 * step, q[:, 1] - 0.2) < RADIUS
    there &= (np.hypot(q[:, 0], q[:, 1]) > POST[2]) & (np.abs(q[:, :2]) < 2).all(axis=1)
    return q, there


@pytest.mark.slow
@pytest.mark.parametrize("pace", [0.0, PACE])
def test_every_answer_says_so(pace):
    table = solved(pace)
    controller = sdhj.Controller(table)
    for step in range(4):
        states, there = states_at(step, pace)
        batch, left = controller.batch(states, step), table.steps - step
        assert ((batch.steps_to_go == 0) == there).all()
        assert (table.contains(states, start=step, within=0) == there).all()
        for within in range(1, left + 1):
            inside = table.contains(states, start=step, within=within)
            assert inside[there].all() and not (inside & (batch.steps_to_go < 0)).any()
        for q in states[there][:20]:
            assert controller.steps_to_go(q, step) == 0 and controller.admissible(q, step=step)
        assert (table.steps_to_go(states, step)[there] == 0).all()
        assert table.fraction(start=step, within=0) < there.mean() * (4.4 / 4) ** 2  # of whole cells alone


@pytest.mark.slow
@pytest.mark.parametrize("rule", ["deepest", "effort", lambda among: -among.problem.inputs[among.inputs, 0]])
def test_inputs_in_the_target_lead_back_into_it_or_there_is_none(rule):
    """Judge: the car itself, whose wind is held or turned, from the target under what `select` says."""
    table = solved()
    controller, rng, tried = sdhj.Controller(table, rule=rule), np.random.default_rng(0), 0
    for step in range(3):
        states, there = states_at(step)
        states = states[there][:150]
        batch = controller.batch(states, step)
        chosen = controller.choose(batch)
        assert (chosen[~batch.safe.any(axis=1)] == -1).all() and batch.safe[chosen >= 0, chosen[chosen >= 0]].all()
        for q, j in zip(states, chosen.tolist(), strict=True):
            if j < 0:
                with pytest.raises(sdhj.NotAdmissible, match="the target at step"):
                    controller.select(q, step)
                continue
            assert controller.select(q, step) == j
            for wind in 0.1 * np.array([[1, 1], [-1, 1], [1, -1], [-1, -1]]) * rng.choice([1, -1], (40, 4, 1)):
                x = q.copy()
                for part in range(100):
                    v = wind[part // 25 % 4]
                    x = x + 0.0025 * np.array(
                        [
                            zoo.INPUTS[j][0] * np.cos(x[2]) + v[0],
                            zoo.INPUTS[j][0] * np.sin(x[2]) + v[1],
                            zoo.INPUTS[j][1],
                        ]
                    )
                assert np.hypot(x[0] - 0.6 - PACE * 0.25 * (step + 1), x[1] - 0.2) < RADIUS + 0.01
                tried += 1
                break
    assert tried


@pytest.mark.slow
def test_a_step_and_the_filter_say_so():
    controller = sdhj.Controller(solved())
    states, there = states_at(1)
    answers = controller.filter(states[there], 1, np.zeros(there.sum(), int))
    batch = controller.table.batch(states[there], 1, 2)
    assert (batch.steps_to_go == 0).all() and np.array_equal(answers.promised, batch.safe.any(axis=1))
    for q in states[there][:10]:
        controller.step([-1.0, 1.0, 0.0], 0.0)
        action = controller.step(q, 0.25, fallback=False)
        assert action.arrived and action.steps_to_go == 0
    for q in states[~there][:10]:
        controller.step([-1.0, 1.0, 0.0], 0.0)
        assert not controller.step(q, 0.25).arrived


@pytest.mark.slow
def test_runs_that_arrive_are_told_so_by_every_answer():
    """A loop as the README's, by `select`, against the judge's wind: whoever stops has arrived."""
    table, rng = solved(), np.random.default_rng(3)
    controller = sdhj.Controller(table)
    q, _ = states_at(0)
    starts, arrived = q[table.contains(q)][:60], 0
    for x in starts:
        for step in range(4):
            there = np.hypot(x[0] - 0.6 - PACE * 0.25 * step, x[1] - 0.2) < RADIUS
            assert (controller.steps_to_go(x, step) == 0) == there
            if there:
                arrived += 1
                break
            speed, turn = zoo.INPUTS[controller.select(x, step)]
            wind = rng.choice([-0.1, 0.1], 2)
            for _ in range(50):
                x = x + 0.005 * np.array([speed * np.cos(x[2]) + wind[0], speed * np.sin(x[2]) + wind[1], turn])
        assert there
    assert arrived == len(starts) > 20


@pytest.mark.skipif(not shutil.which("gcc"), reason="there is no gcc")
@pytest.mark.parametrize("pace", [0.0, PACE])
@pytest.mark.slow
def test_c_says_so(tmp_path, pace):
    table = solved(pace)
    c, controller = sdhj.export_c(table, tmp_path, progress=False), sdhj.Controller(table)
    assert c.selftest() == 0
    for step in range(3 if pace else 1):  # where nothing depends on time, C ignores steps
        states, there = states_at(step, pace)
        status, steps = c.steps_to_go(states, step)
        assert ((status == 0) & (steps == 0) == there).all()
        batch = controller.batch(states, step)
        for what, found in (("select", batch.best >= 0), ("safe_inputs", batch.safe.any(axis=1))):
            status = c.ask(what, states, step)[0]
            assert np.array_equal(status == 0, found) and (status[there & ~found] == 1).all()
        asked = controller.filter(states, step, np.full(len(states), 2))
        status, inputs = c.filter(states, step, np.full(len(states), 2))
        assert np.array_equal(status == 0, asked.promised) and (status[there & ~asked.promised] == 1).all()
        assert np.array_equal(inputs[status == 0], asked.inputs[status == 0])
    states, there = states_at(3, pace)
    assert ((c.steps_to_go(states, 3)[1] == 0) == there).all()


@pytest.mark.parametrize("pace", [0.0, -0.2])
def test_whoever_is_in_an_unsafe_set_as_well_has_not_arrived(pace):
    """A wall stands in the target, or comes nearer: by the closed form who is at it is lost, at every step."""
    wall = sdhj.UnsafeSet((0,), lambda p, t: 0.8 + pace * t - p[:, 0])
    problem = zoo.line(target=zoo.goal(0.0, 1.0), unsafe=[wall])
    table = sdhj.solve(problem, sdhj.Certified(cells=(80,)), progress=False, play=False)
    controller, states = sdhj.Controller(table), np.linspace(-1.2, 1.2, 238)[:, None]  # none on a border
    for step in range(4):
        x, edge = states[:, 0], 0.8 + pace * 0.5 * step
        there, lost = (np.abs(x) < 1.0) & (x < edge), x > edge
        assert (controller.batch(states, step).steps_to_go[lost] == -1).all()
        assert (table.steps_to_go(states, step) == 0).tolist() == there.tolist()
        for within in range(table.steps - step + 1):
            inside = table.contains(states, start=step, within=within)
            assert inside[there].all() and not inside[lost].any()
        assert controller.steps_to_go([edge + 0.05], step) is None


def test_what_cannot_be_seen_is_not_claimed(tmp_path):
    """With errors of measurement nobody knows that the state has arrived."""
    noisy = zoo.line(push=0.08, target=zoo.goal(0.0, 0.95), sensing=sdhj.Sensing(error=0.02, memory=False))
    table = sdhj.solve(noisy, sdhj.Certified(cells=(80,), parts=1), progress=False, play=False)
    assert not table.contains([[0.94]], within=0)[0] and table.contains([[0.5]], within=0)[0]
    sdhj.export_c(table, tmp_path, progress=False)
    assert "#define SDHJ_ROBOT_ARRIVES 0" in (tmp_path / "sdhj_robot.h").read_text()


def test_whoever_is_past_an_end_has_not_arrived():
    """The target reaches beyond the grid, which ends at 4."""
    problem = zoo.line(target=zoo.goal(4.0, 1.0), ends="unsafe")
    table = sdhj.solve(problem, sdhj.Certified(cells=(80,)), progress=False, play=False)
    states = np.array([[3.99], [4.0], [4.0 + 1e-7], [4.2]])
    assert sdhj.Controller(table).batch(states, 0).steps_to_go.tolist() == [0, 0, -1, -1]
    assert table.contains(states, within=0).tolist() == [True, True, False, False]


def either(met):
    return np.where(met, -1.0, 1.0)


TARGETS = (
    lambda x, t: np.minimum(abs(x + 2), abs(x - t)) * 2 - 1,
    lambda x, t: np.maximum(-x, x / (t + 0.25)) - 1,
    lambda x, t: np.sqrt(abs(x)) - np.log(x + 5) + x**3 - x * x,
    lambda x, t: abs(x) ** (t + 0.5) - np.exp(x) + np.tanh(x) - 0.1,
    lambda x, t: np.sin(x) - np.cos(3 * x) + np.tan(x / 3),
    lambda x, t: np.arctan(x) + np.arctan2(x, t) - np.hypot(x, t) + 1,
    lambda x, t: np.arcsin(x / 5) - np.arccos(x / 6) + t,
    lambda x, t: np.mod(x, t + 0.5) - 0.3,
    lambda x, t: x / (abs(x) + 1) - np.sign(x - t) / 2,
    lambda x, t: either(np.floor(x) == 2 * t),
    lambda x, t: either(np.floor(x) <= 2 * t),
    lambda x, t: either(np.floor(x) < 2 * t),
    lambda x, t: either((x < t) & (x > -2)),
    lambda x, t: either((x > t) | ~(x > -2)),
)


@pytest.mark.skipif(not shutil.which("gcc"), reason="there is no gcc")
def test_c_computes_what_numpy_does(tmp_path):
    """Each operation that a target may have; no table need be solved for it."""
    written, text = set(), "#include <math.h>\n#include <stdint.h>\n"
    for n, level in enumerate(TARGETS):
        problem = zoo.line(target=sdhj.TargetSet((0,), lambda p, t, level=level: level(p[:, 0], t)))
        written |= {one.op for one in ordered(problem.target.level_set.outputs)}
        text += "\n".join(arrived_in_c(problem)).replace("static inline int sdhj_robot_arrived", f"\nint of_{n}")
    assert written >= set(WRITTEN)
    (tmp_path / "all.c").write_text(text + "\n")
    subprocess.run(["gcc", "-shared", "-fPIC", "-o", tmp_path / "all.so", tmp_path / "all.c", "-lm"], check=True)
    library, x = ctypes.CDLL(str(tmp_path / "all.so")), np.random.default_rng(0).uniform(-4, 4, 200)
    for n, level in enumerate(TARGETS):
        for step in range(4):
            said = [getattr(library, f"of_{n}")(step, ctypes.byref(ctypes.c_double(one))) for one in x]
            assert said == (level(x, step / 2) <= 0).tolist(), (n, step)
