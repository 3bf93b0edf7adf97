"""Problems of one's own: growth boxes, level sets over boxes, closed forms and runs."""

from fractions import Fraction

import naive_certified as naive
import numpy as np
import pytest
from naive_certified import SMALL
from toys import interval_problem, torus_problem, unicycle_problem

import sdhj
from sdhj.certified import LipschitzBounds
from sdhj.certified.general_proof import GeneralProof

UNICYCLE = LipschitzBounds(
    dynamics=np.array([[0, 0, 1.0], [0, 0, 1.0], [0, 0, 0]]), sets={"target": [1.0, 1.0], "pillar": [1.0, 1.0]}
)


def certified(problem, **options):
    return sdhj.solve(problem, sdhj.Certified(**options), progress=False)


@pytest.mark.parametrize("steps", [1, 3, 5])
def test_closed_form_on_a_line(steps):
    """|q| <= 1 + n (1 - 0.2) 0.5, cut where the wall at 3 may be touched: cells of 0.1 tell it to within one cell."""
    problem = interval_problem(steps=steps)
    bounds = LipschitzBounds(sets={"target": [1.0], "wall": [1.0]})
    table = certified(problem, cells=(80,), bounds=bounds)
    assert table.axes[0].width == Fraction(1, 10)
    for within in range(steps + 1):
        inside = table.bits(start=0, within=within)
        edges = table.axes[0].edges()
        low, high = edges[:-1][inside].min(), edges[1:][inside].max()
        reach = 1 + 0.4 * within
        assert inside.sum() == round((high - low) / 0.1)  # no gap
        # the layer of cells that the margin and the target's edge cost, once: nothing is lost from step to step
        assert -reach - 1e-9 <= low <= -reach + 0.1 + 1e-9
        assert min(reach, 3.0) - 0.1 - 1e-9 <= high <= min(reach, 3.0) + 1e-9


def test_moving_obstacle_is_met_between_the_samples(rng):
    problem = torus_problem()
    bounds = LipschitzBounds(sets={"target": [1.0, 1.0], "orbiting disk": [1.0, 1.0]})
    table = certified(problem, cells=(80, 80), bounds=bounds)
    assert table.fraction(start=0, within=3) > 1.5 * table.fraction(start=0, within=0) > 0.01
    naive.assert_runs_succeed(table, naive.states_in(table, rng, 20000), rng)


def test_general_reach_box_holds_every_trajectory(rng):
    problem = unicycle_problem()
    proof = GeneralProof(problem, (), 5, np.asarray(UNICYCLE.dynamics), np.zeros(3), {}, np.empty(0))
    low = rng.uniform([-1.4, -1.4, -3], [1.3, 1.3, 3], (300, 3))
    high = low + rng.uniform(0, 0.1, (300, 3))
    for j in range(3):
        tube, first, last = proof.reached(low.copy(), high.copy(), j, 0.0)
        for _ in range(10):
            states = np.where(rng.random((300, 3)) < 0.5, low, high)
            sign = rng.choice([-1.0, 1.0], (300, 2)) * 0.1
            for part in range(200):  # Euler steps of a thousandth: off by less than 1e-3 in all
                push = np.einsum("mid,md->mi", problem.dynamics.gain_at(states), sign)
                states = states + 0.001 * (problem.dynamics.drift_at(states, j) + push)
                boxes = tube[part * 5 // 200]
                states[:, :2] = np.clip(states[:, :2], -1.5, 1.5)
                assert (np.abs(states - boxes.centre) <= boxes.half + 5e-4).all()
            assert (first - 5e-4 <= states).all() and (states <= last + 5e-4).all()
    # the image of a point is small: twice what the disturbance and the walls explain
    point = np.zeros((1, 3))
    _, first, last = proof.reached(point.copy(), point.copy(), 1, 0.0)
    assert ((last - first)[0] <= 2 * np.array([0.04, 0.04, 1e-6])).all()


def test_general_bounds_hold_over_boxes_and_times(rng):
    """The lower bound of a level set is below its value at every state and time of the boxes."""
    problem = torus_problem()
    disk = problem.unsafe[0]
    proof = GeneralProof(problem, (), 2, np.zeros((2, 2)), np.zeros(2), {}, np.empty(0))
    low = rng.uniform(-3, 3, (500, 2))
    tube, _, _ = proof.reached(low, low + rng.uniform(0, 0.3, (500, 2)), 0, 0.0)
    for boxes in tube:
        bound = boxes.values(problem, disk, np.array([1.0, 1.0]), 0.4)[0]
        for _ in range(30):
            states = boxes.centre + boxes.half * rng.uniform(-1, 1, (500, 2))
            for tau in (boxes.begin, boxes.end):
                assert (bound <= disk.level_set(states, 0.4 + tau)).all()


@pytest.mark.slow
def test_unicycle_runs_succeed(rng):
    problem = unicycle_problem()
    table = certified(problem, cells=(60, 60, 60), bounds=UNICYCLE)
    assert table.fraction(start=0, within=3) > 1.3 * table.fraction(start=0, within=0) > 0.01
    naive.assert_runs_succeed(table, naive.states_in(table, rng, 5000), rng, pieces=4, fine=10)


def test_general_and_arm_agree_on_the_arm():
    """The general method, with Lipschitz bounds of the arm, certifies a part of what the arm's geometry does."""
    arm = [0.30, 0.15]
    bounds = LipschitzBounds(sets={"target": arm, "obstacles": arm, "pursuer": [*arm, 1.0, 1.0]})
    problem = sdhj.arm_case_study(**(SMALL | {"steps": 1}))
    general = certified(problem, cells=(32, 32, 5, 5), bounds=bounds, parts=4)
    special = certified(problem, cells=(32, 32, 5, 5), parts=4)
    for within in (0, 1):
        rough, fine = general.bits(start=0, within=within), special.bits(start=0, within=within)
        assert rough.any() and not (rough & ~fine).any()
