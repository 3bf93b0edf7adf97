"""The worked problems that no other file judges: the paper's arm, both ways round, the README's car and the boat.

Their geometry and motion are written here once more, from the README and the paper; of the library the controller's
inputs are asked for, nothing else. (Aircraft and converter: figures/test_safety_examples; carts: test_ends and
test_safety; the maze: figures/studies/test_maze; the skater: test_shield; what depends on time: test_timed.)
"""

import re
from pathlib import Path

import judge
import numpy as np
import pytest
from boat import boat_problem

import sdhj
from sdhj import Controller

LINK, HALF_WIDTH, BOX = 0.15, 0.01, 0.36
STRIDE = 0.1 / judge.PARTS / judge.SUBSTEPS  # s, of the judge's integration
LEVELS = np.linspace(-3.0, 3.0, 5)
JOINT_SPEEDS = np.stack(np.meshgrid(LEVELS, LEVELS, indexing="ij"), axis=-1).reshape(-1, 2)  # the first slowest


def joints(q):
    """Elbow and tip of states (M, 4): two (M, 2)."""
    elbow = LINK * np.stack([np.cos(q[:, 0]), np.sin(q[:, 0])], axis=1)
    both = q[:, 0] + q[:, 1]
    return elbow, elbow + LINK * np.stack([np.cos(both), np.sin(both)], axis=1)


def clearance(q, centre, radius):
    """Of the arm from disks with centres (M, 2) or (2,)."""
    elbow, tip = joints(q)
    nearest = np.full(len(q), np.inf)
    for begin, end in ((np.zeros_like(elbow), elbow), (elbow, tip)):
        along = np.einsum("ij,ij->i", centre - begin, end - begin) / LINK**2
        foot = begin + np.clip(along, 0.0, 1.0)[:, None] * (end - begin)
        nearest = np.minimum(nearest, np.hypot(*(centre - foot).T))
    return nearest - radius - HALF_WIDTH


def obstacles(q, t):
    turned = 2.0 * t - 1.0
    disks = (
        ((-0.22, 0.10), 0.06),
        ((0.24 - 0.10 * t, -0.02 + 0.12 * t), 0.04),
        ((0.07 * np.cos(turned), -0.22 + 0.07 * np.sin(turned)), 0.04),
    )
    return np.minimum.reduce([clearance(q, np.array(centre), radius) for centre, radius in disks])


def moved(agent_speed):
    def velocity(q, inputs, signs, t):
        agent = agent_speed * signs[:, 2:]
        agent = np.where(np.abs(q[:, 2:] + STRIDE * agent) > BOX, 0.0, agent)  # it stays in its box
        return np.hstack([JOINT_SPEEDS[np.maximum(inputs, 0)] + 0.3 * signs[:, :2], agent])

    return velocity


CHASED = {
    "velocity": moved(0.2),
    "target": lambda q, t: np.hypot(*(joints(q)[1] - [0.05 + 0.10 * t, 0.20 - 0.05 * t]).T) - 0.06,
    "unsafe": lambda q, t: np.minimum(obstacles(q, t), clearance(q, q[:, 2:], 0.04)),
}
CHASING = {
    "velocity": moved(0.1),
    "target": lambda q, t: np.hypot(*(joints(q)[1] - q[:, 2:]).T) - 0.06,
    "unsafe": obstacles,
}
CAR = np.array([[speed, turn] for speed in (0.5, 1.0) for turn in (-2.0, 0.0, 2.0)])


def driven(q, inputs, signs, t):
    speed, turn = CAR[np.maximum(inputs, 0)].T
    return np.stack([speed * np.cos(q[:, 2]), speed * np.sin(q[:, 2]), turn], axis=1) + 0.1 * signs * [1, 1, 0]


DRIVING = {
    "velocity": driven,
    "target": lambda q, t: np.hypot(q[:, 0] - 1.2, q[:, 1] - 0.8) - 0.4,
    "unsafe": lambda q, t: np.minimum(np.hypot(q[:, 0], q[:, 1]) - 0.4, 2.0 + 1e-9 - np.abs(q[:, :2]).max(axis=1)),
}
SAILING = {
    "velocity": lambda q, u, v, t: [1.5, 0.1] + 0.8 * np.stack([-q[:, 1], q[:, 0]], axis=1) + 0.14 * v,
    "target": lambda q, t: np.hypot(q[:, 0] - 0.55, q[:, 1] - 0.30) - 0.42,
    "unsafe": lambda q, t: np.hypot(q[:, 0] - 0.05, q[:, 1] + 0.12) - 0.13,
}


def car():
    """The problem of the README's second program, as it stands there."""
    text = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
    (code,) = (code for code in re.findall(r"^```python\n(.*?)^```$", text, re.M | re.S) if '"post"' in code)
    names = {}
    exec(code[: code.index("for method in")], names)
    return names["problem"]


def lost(table, true, rng, runs=3000):
    """Share of runs that do not reach the target, by adversaries at corners of their box that switch or do not."""
    controller, problem, shares = Controller(table), table.problem, []
    states = rng.uniform(problem.grid.lower, problem.grid.upper, (40 * runs, problem.grid.ndim))
    starts = states[table.contains(states, start=0, within=table.steps)][:runs]
    assert len(starts) == runs
    wind = problem.dynamics.disturbance_dim if problem.name != "problem" else problem.grid.ndim
    kept = rng.choice([-1.0, 1.0], (runs, wind))
    for signs in (lambda q, u, t, end: rng.choice([-1.0, 1.0], (runs, wind)), lambda q, u, t, end: kept):
        outcomes = judge.play(
            lambda q, step: controller.choose(controller.batch(q, step)),
            signs=signs,
            starts=starts,
            delta=problem.delta,
            steps=problem.steps,
            **true,
        )
        print(problem.name, table.method, dict(zip(*np.unique(outcomes, return_counts=True), strict=True)))
        shares.append(np.mean(outcomes != "reached"))
    return max(shares)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["hji", "lax", "projected"])
def test_the_arm(method, rng):
    """25 nodes are coarse: an exact recursion with linear interpolation loses 1.2 to 5 % of the runs."""
    assert lost(sdhj.solve(sdhj.arm_case_study(), method, progress=False), CHASED, rng) < 0.05


@pytest.mark.slow
def test_the_arm_with_a_proof(rng):
    method = sdhj.Certified(cells=(126, 126, 36, 36))
    assert lost(sdhj.solve(sdhj.arm_case_study(), method, progress=False), CHASED, rng) == 0.0


@pytest.mark.slow
def test_the_arm_that_chases(rng):
    assert lost(sdhj.solve(sdhj.evader_case_study(), progress=False), CHASING, rng) < 0.05


@pytest.mark.slow
def test_the_car_of_the_readme(rng):
    assert lost(sdhj.solve(car(), progress=False), DRIVING, rng) < 0.03


def test_the_boat(rng):
    """One interval; states within a cell of the boundary may be lost."""
    assert lost(sdhj.solve(boat_problem(), progress=False), SAILING, rng) < 0.02


def test_the_geometry_here_is_that_of_the_case_studies(rng):
    for problem, true in ((sdhj.arm_case_study(nodes=9), CHASED), (sdhj.evader_case_study(nodes=9), CHASING)):
        states = rng.uniform(problem.grid.lower, problem.grid.upper, (2000, 4))
        for t in (0.0, 0.37):
            np.testing.assert_allclose(problem.target_value(states, t), true["target"](states, t), atol=1e-12)
            np.testing.assert_allclose(problem.unsafe_value(states, t), true["unsafe"](states, t), atol=1e-12)
