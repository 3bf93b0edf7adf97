"""Checks of the exercises of chapter 9."""

import warnings
from functools import cache
from itertools import combinations

import numpy as np

import sdhj
from course.exercises import exercise, expect, expect_close


@exercise("9.1", "For all omega: the worst of them has to be in the set. For some omega: the best of them is.")
def check_direction(project):
    """Maximum for a set to be reached, minimum for one to be avoided."""
    values = np.random.default_rng(0).normal(size=(5, 6, 7, 8))
    got = np.asarray(project(values, (3,), True))
    expect(got.shape == (5, 6, 7), "the dropped axes are gone, the others stay.")
    expect_close(got, values.max(axis=3), "to be reached: x must be in the set for ALL omega. Is that a min or a max?")
    expect_close(
        project(values, (1, 2), False), values.min(axis=(1, 2)), "to be avoided: x is in the shadow for SOME omega."
    )


@cache
def _share(subspaces, nodes):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what a hopeless subspace is told
        table = sdhj.solve(sdhj.arm_case_study(nodes=nodes), sdhj.Projected(subspaces=subspaces), progress=False)
    return table.fraction(start=0, within=8)


@exercise(
    "9.2",
    "`sdhj.Projected(subspaces=[(0, 1, 2)])` is a method for `sdhj.solve`, and `table.fraction` gives shares.",
)
def check_subspace(share):
    """The tube from (q1, q2, px) alone."""
    both, one = _share(((0, 1, 2), (0, 1, 3)), 25), _share(((0, 1, 2),), 25)
    expect(0 < share < 1, "a share of C, between 0 and 1.")
    expect(abs(share - both) > 2e-3, "that is the union of both subspaces.")
    expect_close(share, one, "25 nodes, start=0, within=8, subspaces=[(0, 1, 2)].", within=2e-3)
    return f"Both together give {both:.3f}."


@exercise(
    "9.3",
    "Which x are within the target for every omega, and how far from there does the disturbance drive in one interval?",
)
def check_wave(amplitude):
    """0.3 - a >= 0.3 * 0.2."""
    expect(abs(amplitude - 0.3) > 1e-9, "there the core is a line; can it be hit with the disturbance?")
    expect_close(amplitude, 0.24, "the core is |x - 0.2| <= 0.3 - a; the disturbance takes delta v_1 from either side.")


@exercise("9.4", "Take a target in which omega matters as much as x does, a diagonal strip for example.")
def check_target(hopeless_projection):
    """Full: more than the target within one step or more; projected: nothing."""
    problem = hopeless_projection()
    expect(isinstance(problem, sdhj.ReachAvoidProblem), "return a sdhj.ReachAvoidProblem.")
    expect(problem.grid.ndim == 2 and max(problem.grid.shape) <= 61, "two axes, at most 61 nodes on each.")
    full = sdhj.solve(problem, progress=False)
    goal, tube = (full.fraction(start=0, within=n) for n in (0, full.steps))
    expect(tube > goal, "the full game wins nothing beyond the target: more speed, more steps, less adversary?")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        small = sdhj.solve(problem, sdhj.Projected(subspaces=[(0,)]), progress=False)
    gained = small.fraction(start=0, within=full.steps) - goal
    expect(gained <= 1e-12, "the projection onto x wins something: some x is in the target for every omega.")


@exercise("9.5", "itertools.combinations(range(4), size) lists the axes, and what each adds takes a solve on 15 nodes.")
def check_three(share):
    """The paper's two and up to one more, on 15 nodes."""
    paper = ((0, 1, 2), (0, 1, 3))
    others = [axes for size in (2, 3) for axes in combinations(range(4), size) if axes not in paper]
    best = max(_share((*paper, axes), 15) for axes in others)
    expect(abs(share - _share(paper, 25)) > 1e-4, "that is on 25 nodes; here on 15.")
    expect_close(share, best, "have you tried all subspaces of two and three axes beside the two?", within=1e-4)
    kept = _share(paper, 15)
    return f"The paper's two alone give {kept:.4f}: " + ("no third one helps." if best <= kept + 1e-6 else "one helps.")
