"""A certified table promises what is true: closed forms, and runs of a plant that shares no code with the library."""

from functools import cache

import numpy as np
import pytest
import zoo
from forging import describe, forged
from zoo import interval_problem

import sdhj
from sdhj.certified.check import verify

BRAKE, PUSH, DELTA, STEPS = 3.0, 0.6, 0.1, 20
COMMANDS = np.array([[-BRAKE], [0.0], [BRAKE]])


@cache
def interval():
    return sdhj.solve(interval_problem(), sdhj.Certified([80]), progress=False)


def test_on_a_line_it_is_the_closed_form_but_for_a_cell():
    """With n steps to go all of |q| <= 1 + 0.4 n, short of the wall at 3; what a cell costs is lost once."""
    q, cell = np.linspace(-4.0, 4.0, 8001), 0.1
    for within in range(6):
        farthest = 1.0 + 0.4 * within
        found = interval().contains(q[:, None], start=0, within=within)
        assert not found[(np.abs(q) > farthest + 1e-9) | (q >= 3.0)].any()
        assert found[(np.abs(q) < farthest - cell - 1e-9) & (q < 3.0 - cell - 1e-9)].all()


@cache
def cart():
    """A cart that stays on |x| <= 1 for longer than it takes to stop: v^2 / (2 (BRAKE - PUSH))."""
    problem = zoo.cart(COMMANDS, PUSH, grid=sdhj.Grid([-1.0, -4.0], [1.0, 4.0], [41, 41]), delta=DELTA, steps=STEPS)
    return sdhj.solve(problem, sdhj.Certified([80, 100]), progress=False)


def beyond(states):
    """How far beyond |x| = 1 full brakes end against the strongest push; > 0: the adversary has won."""
    x, v = states.T
    way = v**2 / (2 * (BRAKE - PUSH))
    return np.maximum(x + np.where(v > 0, way, 0), -x + np.where(v < 0, way, 0)) - 1


def test_no_state_is_contained_that_cannot_be_kept(rng):
    states = rng.uniform([-1.0, -4.0], [1.0, 4.0], (40_000, 2))
    found = cart().contains(states, start=0, within=STEPS)
    assert (beyond(states[found]) <= 0).all()
    assert found.sum() > 0.75 * (beyond(states) <= 0).sum()


@pytest.mark.parametrize("push", ["out", "in", "changing"])
def test_no_run_is_lost(push, rng):
    """By the motion under a constant force: it turns once at most, so |x| is largest at an end or where it turns."""
    table, states = cart(), rng.uniform([-1.0, -4.0], [1.0, 4.0], (6000, 2))
    states = states[table.contains(states, start=0, within=STEPS)]
    controller = sdhj.Controller(table)
    for step in range(STEPS):
        batch = controller.batch(states, step)
        assert batch.promised.all()
        u, (x, v) = COMMANDS[controller.choose(batch), 0], states.T
        side = {"out": np.sign(v), "in": -np.sign(x), "changing": rng.choice([-1.0, 1.0], len(x))}[push]
        force = u + PUSH * np.where(side == 0, 1.0, side)
        turn = np.clip(np.where(force == 0, 0.0, -v / np.where(force == 0, 1.0, force)), 0.0, DELTA)
        for t in (turn, DELTA):
            assert (np.abs(x + v * t + force * t**2 / 2) <= 1.0 + 1e-9).all()
        states = np.stack([x + v * DELTA + force * DELTA**2 / 2, v + force * DELTA], axis=1)
    assert len(states) > 1000


LIES = {
    "a stronger adversary": {"disturbance": 0.4},
    "a nearer wall": {"wall": 2.7},
    "ends that are no walls, and cells beside them": {"ends": "unsafe", "disturbance": 0.3},
}


@pytest.mark.parametrize("name", LIES)
def test_the_checker_refuses_the_sets_of_another_robot(name, tmp_path):
    """The same claims, of a robot for which they are false; those of its own are proved."""
    interval().save(tmp_path / "sets.npz")
    assert name != "a nearer wall" or verify(tmp_path / "sets.npz", progress=False).ok
    describe(tmp_path / "sets.npz", interval_problem(**LIES[name]))
    with forged(tmp_path / "sets.npz", named=True) as (told, _):
        told["proof"]["clear"][0]["ends"] = [0] if "ends" in LIES[name] else []
    assert not verify(tmp_path / "sets.npz", progress=False).ok
