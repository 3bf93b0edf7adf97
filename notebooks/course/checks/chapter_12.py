"""Checks of the exercises of chapter 12."""

from functools import cache

import numpy as np

import sdhj
from course.exercises import exercise, expect, expect_close
from sdhj.simulation.adversaries import Moment
from sdhj.simulation.runs import rollouts


@exercise("12.1", "theta (1 - theta) is at most 1/4, and J is by how much the slope jumps.")
def check_chord(smooth_error, kink_error):
    """h^2 max|s''| / 8 and |J| h / 4."""
    expect(abs(smooth_error - 9 * 0.01 / 2) > 1e-12, "theta (1 - theta) is at most 1/4.")
    expect_close(smooth_error, 9 * 0.01 / 8, "(12.2) with h = 0.1: s'' = -9 sin 3x is at most 9 in size.")
    expect(abs(kink_error - 0.025) > 1e-12, "the slope of |x| jumps from -1 to 1: J is 2.")
    expect_close(kink_error, 2 * 0.1 / 4, "(12.4) with h = 0.1.")


@exercise(
    "12.2",
    "What lies on a chord lies between its two ends. So what can happen between two nodes that no node sees?",
)
def check_kink(hidden, which):
    """An interpolant of positive numbers is positive, so only the lost island exists."""
    nodes, x = np.linspace(-1, 1, 11), np.linspace(-1, 1, 20_001)
    expect(which in ("false island", "lost island"), 'say "false island" or "lost island".')
    expect(which == "lost island", "the interpolant between two positive numbers: can it be zero?")
    values, at = np.asarray(hidden(x)), np.asarray(hidden(nodes))
    expect(values.shape == x.shape, "one value for each x.")
    expect(np.abs(np.diff(values)) <= np.diff(x) * (1 + 1e-6), "not 1-Lipschitz: somewhere it is steeper than 1.")
    expect(np.min(values) <= 0, "the function is nowhere <= 0: there is no island to be lost.")
    expect(np.min(at) > 0, "a node is in the set, so the interpolant holds a part of it.")
    return "Multilinear interpolation keeps the sign of its corners; what it loses, it loses between them."


@exercise("12.3", "The probability of seeing none is (1 - 1/500)^M.")
def check_upper(runs_to_see):
    """(1 - 1/500)^M <= 0.01."""
    expect(runs_to_see != 500, "500 runs show it with a probability of 63% only.")
    expect((1 - 1 / 500) ** runs_to_see <= 0.01, "too few: (12.7) is still above 1%.")
    expect((1 - 1 / 500) ** (runs_to_see - 2) > 0.01, "fewer would do.")


@exercise("12.4", "A mean over the chosen runs; of none it is not a number.")
def check_depth(failures_below):
    """A mean over what is left."""
    rng = np.random.default_rng(0)
    depth = -rng.uniform(0, 0.1, 5000)
    failed = rng.uniform(size=5000) < 0.3 + depth
    for epsilon in (0.0, 0.02, 0.05):
        got, wanted = failures_below(depth, failed, epsilon), failed[depth <= -epsilon].mean()
        expect(abs(got - failed[depth <= -epsilon].sum() / 5000) > 1e-9 or epsilon == 0, "of those that are left.")
        expect_close(got, wanted, f"epsilon {epsilon}: the starts with depth <= -epsilon, deep is negative.")
    expect(np.isnan(failures_below(depth, failed, 0.2)), "with no start left the share is not a number.")
    return "With the runs of this chapter: try 0.005, 0.01, 0.02, 0.04."


@cache
def _board():
    """The controller of the case study and 40 starts near the boundary that "worst" does not beat."""
    controller = sdhj.Controller(sdhj.solve(sdhj.arm_case_study(nodes=25), progress=False))
    table, grid = controller.table, controller.problem.grid
    states = np.random.default_rng(11).uniform(grid.lower, grid.upper, (40_000, 4))
    values = grid.interpolate(table.values(start=0, within=8), states)
    states = states[(values <= 0) & (values > -0.006)]
    outcomes, _ = rollouts(controller, states, sdhj.simulation.adversaries.worst, np.random.default_rng(0))
    return controller, states[outcomes == 0][:40]


@exercise(
    "12.5",
    "Play some hundred random sequences from the same state at once: repeat the state, and pick the row by "
    "`moment.runs`.",
)
def check_search(search):
    """Corners, one for each interval, that beat a run; replayed here."""
    controller, starts = _board()
    rng, beaten = np.random.default_rng(1), 0
    for q in starts:
        signs = np.asarray(search(controller, q, rng), dtype=np.float64)
        if not signs.size:
            continue
        expect(signs.shape == (controller.problem.steps, 4), "one row of four signs for each of the N intervals.")
        expect(np.abs(signs) <= 1, "signs: within -1 and 1, times the bounds.")

        def play(moment: Moment, signs=signs):
            return np.broadcast_to(signs[moment.step], moment.bounds.shape) * moment.bounds

        outcomes, _ = rollouts(controller, q[None], play, np.random.default_rng(0))
        expect(outcomes[0] != 0, "a sequence that you returned does not beat the robot when it is played again.")
        beaten += 1
    expect(beaten >= 2, f"{beaten} of {len(starts)} beaten; more tries, or tries near those that came close?")
    return f'{beaten} of {len(starts)} starts beaten that "worst" does not beat.'
