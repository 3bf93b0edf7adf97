"""Solutions of chapter 9, and answers that its checks refuse."""

import warnings
from itertools import combinations

import numpy as np
from course.chapter_09 import check_direction, check_subspace, check_target, check_three, check_wave

import sdhj


def project(values, dropped, reached):
    """For all omega: the worst. For some omega: the best for the obstacle, the least."""
    return values.max(axis=dropped) if reached else values.min(axis=dropped)


def one_eye():
    """One subspace alone: what is won whatever py is, for the pursuer may be anywhere on the axis that is dropped."""
    table = sdhj.solve(sdhj.arm_case_study(nodes=25), sdhj.Projected(subspaces=[(0, 1, 2)]), progress=False)
    return table.fraction(start=0, within=8)


# the core |x - 0.2| <= 0.3 - a has to be as wide as what the disturbance can do: 0.3 - a = 0.3 * 0.2
amplitude = 0.3 - 0.3 * 0.2


def hopeless_projection():
    """A diagonal strip to be reached: for every x some omega lies outside it."""
    return sdhj.ReachAvoidProblem(
        grid=sdhj.Grid([-1, -1], [1, 1], [41, 41]),
        dynamics=sdhj.Dynamics(
            inputs=[[-1.0], [0.0], [1.0]],
            drift=[[-1.0, 0.0], [0.0, 0.0], [1.0, 0.0]],
            gain=np.eye(2),
            bounds=[0.1, 0.1],
        ),
        target=sdhj.TargetSet((0, 1), lambda q, t: np.abs(q[:, 0] - q[:, 1]) - 0.25),
        unsafe=(),
        delta=0.2,
        steps=3,
    )


def best_share():
    """Try all: a third subspace must keep both joints, or nothing can be steered into the target."""
    problem, paper = sdhj.arm_case_study(nodes=15), [(0, 1, 2), (0, 1, 3)]
    found = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for axes in (axes for size in (2, 3) for axes in combinations(range(4), size) if axes not in paper):
            table = sdhj.solve(problem, sdhj.Projected(subspaces=[*paper, axes]), progress=False)
            found.append(table.fraction(start=0, within=8))
    return max(found)


def _easy():
    problem = hopeless_projection()
    return sdhj.ReachAvoidProblem(
        grid=problem.grid,
        dynamics=problem.dynamics,
        target=sdhj.TargetSet((0,), lambda q, t: np.abs(q[:, 0]) - 0.25),
        unsafe=(),
        delta=0.2,
        steps=3,
    )


RIGHT = {
    check_direction: project,
    check_subspace: one_eye(),
    check_wave: amplitude,
    check_target: hopeless_projection,
    check_three: best_share(),
}
WRONG = {
    check_direction: [
        lambda values, dropped, reached: values.min(axis=dropped),  # as printed
        lambda values, dropped, reached: values.min(axis=dropped) if reached else values.max(axis=dropped),
        lambda values, dropped, reached: values.max(axis=dropped, keepdims=True),
    ],
    check_subspace: [0.3376, 0.371, 33.8],  # both eyes; the full game; per cent
    check_wave: [0.3, 0.36],  # the core alone; the wrong side
    check_target: [_easy, lambda: sdhj.arm_case_study(nodes=9)],
    check_three: [0.3376, 0.5],
}
