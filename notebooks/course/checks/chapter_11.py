"""Checks of the exercises of chapter 11."""

import warnings
from functools import cache

import numpy as np

import sdhj
from course.exercises import exercise, expect, expect_close
from sdhj.common.findings import ResolutionWarning
from sdhj.simulation.runs import Z95


@cache
def _table():
    with warnings.catch_warnings(action="ignore", category=ResolutionWarning):  # rules read it; nobody drives by it
        return sdhj.solve(sdhj.arm_case_study(nodes=15), progress=False)


@cache
def _states():
    table = _table()
    states = np.random.default_rng(3).uniform(table.grid.lower, table.grid.upper, (4000, 4))
    return states[table.contains(states, start=0, within=8)][:300]


@exercise("11.1", "argmax finds the first True of an array of booleans. What does it find where there is none?")
def check_fewest(fewest):
    """Leftmost column with a value <= 0."""
    values = np.array([[0.2, -0.1, 0.3, 0.0], [0.1, -0.2, 0.2, -0.1], [-0.1, -0.3, 0.1, -0.2], [0.1, -0.3, 0.4, -1.0]])
    got = np.asarray(fewest(values))
    expect(got.shape == (4,), "one whole number for each state, that is for each column of `values`.")
    expect(got[1] == 0, "a value below zero in the first row means no steps to go.")
    expect(got[3] == 0, "zero counts as inside (Definition 5).")
    expect(got[2] == -1, "where no row is <= 0 the answer is -1; what does argmax give for a column without True?")
    expect(got[0] == 2, "the leftmost, even where a later set does not hold the state any more.")


@exercise("11.2", "Add the second wish to the first with a factor so small that it only decides between equals.")
def check_rule(calm_shoulder):
    """Least |u_1|, then least margin."""
    table = _table()
    controller = sdhj.Controller(table, rule=calm_shoulder)
    batch = controller.batch(_states(), 0)
    known = batch.safe.any(axis=1)
    chosen = controller.choose(batch)[known]
    turn = np.abs(table.problem.inputs[:, 0])
    least = np.min(np.where(batch.safe[known], turn, np.inf), axis=1)
    expect_close(turn[chosen], least, "the first joint turns more than it has to: inputs[:, 0], its absolute value.")
    equal = batch.safe[known] & (turn == least[:, None])
    deepest = np.min(np.where(equal, batch.margins[known], np.inf), axis=1)
    margins = np.take_along_axis(batch.margins[known], chosen[:, None], axis=1)[:, 0]
    expect_close(margins, deepest, "among equals the deeper one: the least margin.", within=1e-6)


@exercise("11.3", "With no failure among M runs the interval of failures ends at z^2 / (M + z^2).")
def check_wilson(wilson, runs_needed):
    """Eq. (11.4), and z^2 / (M + z^2) < 1 / 1000."""
    for successes, runs in ((50, 100), (997, 1000), (0, 30), (30, 30)):
        n, p = runs, successes / runs
        centre = (p + Z95**2 / (2 * n)) / (1 + Z95**2 / n)
        half = Z95 / (1 + Z95**2 / n) * np.sqrt(p * (1 - p) / n + Z95**2 / (4 * n**2))
        hint = f"{successes} of {runs}: the whole of (11.4), z = 1.96."
        expect_close(wilson(successes, runs), (max(centre - half, 0), min(centre + half, 1)), hint, within=2e-4)
    least = Z95**2 * 999
    expect(runs_needed != 4000, "4/M is a rule of thumb; solve z^2 / (M + z^2) < 1/1000.")
    expect(runs_needed > least, "so few runs leave a rate of one in a thousand possible.")
    expect(runs_needed <= least + 2, "fewer runs would do.")


@exercise("11.4", "`controller.safe_inputs` gives the indices that are safe; choose the nearest of them.")
def check_filter(nearest_safe):
    """Among the safe inputs, the nearest in the plane of joint velocities."""
    controller, inputs = sdhj.Controller(_table()), _table().problem.inputs
    rng = np.random.default_rng(0)
    for q in _states()[:60]:
        wanted, safe = rng.uniform(-3, 3, 2), controller.safe_inputs(q, 0)
        if controller.steps_to_go(q, 0) == 0 or not len(safe):  # near the edge of a tube no input may pass every check
            continue
        got = int(nearest_safe(controller, q, 0, wanted))
        expect(got in safe, "an input that is not safe: choose among controller.safe_inputs(q, step).")
        distance = np.linalg.norm(inputs[safe] - wanted, axis=1).min()
        expect_close(np.linalg.norm(inputs[got] - wanted), distance, "another safe input is nearer to what is wanted.")
    try:
        nearest_safe(controller, np.array([0.0, 0.0, 0.1, 0.0]), 0, np.zeros(2))
    except sdhj.NotAdmissible:
        return "The human drives, and cannot leave the tube."
    expect(False, "where no tube holds the state there is nothing to filter: let NotAdmissible through.")
    return None


@exercise(
    "11.5",
    "The moment knows which tube the robot means to be in. Try every corner of the box to the interval's end.",
)
def check_adversary(villain):
    """More failures than "aggressive" among 6,000 runs on 15 nodes."""
    controller = sdhj.Controller(_table())
    known = sdhj.monte_carlo(controller, runs=6000, adversary="aggressive", seed=7)
    yours = sdhj.monte_carlo(controller, runs=6000, adversary=villain, seed=7)
    told = f"yours beats {1 - yours.rate('reached'):.2%} of the runs, aggressive {1 - known.rate('reached'):.2%}"
    expect(yours.interval("reached")[1] < known.interval("reached")[0], f"{told}: that is not more, beyond chance.")
    return told + "."


@exercise("11.6", "Each of the two conditions allows an error of its own; the smaller of the two is allowed by both.")
def check_error(largest_error):
    """min(-m / slope, -a / slope_avoid), at least 0; then with margins and avoid tubes of the arm."""
    margins = np.array([-0.04, -0.04, -0.01, 0.02, -0.03, 0.0, -0.06])
    avoid = np.array([-0.10, -0.01, -0.09, -0.05, 0.01, -0.05, -np.inf])
    wanted = np.array([0.02, 0.004, 0.005, 0.0, 0.0, 0.0, 0.03])
    got = np.asarray(largest_error(margins, avoid, 2.0, 2.5), dtype=np.float64)
    expect(got.shape == margins.shape, "one error for each input.")
    expect(got >= 0, "an error is not below 0: where an input is not right for the measurement itself, return 0.")
    expect(got[1] < 0.02, "a deep margin is about reaching only. How deep is the avoid tube?")
    expect(got[2] < 0.036, "a deep avoid tube is about the way only. How deep is the margin?")
    expect_close(got, wanted, "each value divided by its own slope, and both conditions of (11.3') hold.", within=1e-12)
    table, states = _table(), _states()
    batch, hazards = table.batch(states, 0), table.hazards(states, 0)
    asked = batch.safe & (batch.steps_to_go > 0)[:, None]
    got = np.asarray(largest_error(batch.margins[asked], hazards[asked], 0.3, 0.3))
    by_margin = -batch.margins[asked] / 0.3
    wanted = np.maximum(np.minimum(by_margin, -hazards[asked] / 0.3), 0.0)
    expect_close(got, wanted, "safe inputs of the arm, with slopes of 0.3 m/rad.")
    return f"On 15 nodes the avoid tube is what limits {np.mean(wanted < by_margin):.0%} of the arm's safe inputs."
