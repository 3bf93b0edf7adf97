"""Solutions of chapter 12, and answers that its checks refuse."""

import numpy as np
from course.chapter_12 import check_chord, check_depth, check_kink, check_search, check_upper

from sdhj.simulation.runs import rollouts

# (12.2) with |s''| <= 9 and h = 0.1
smooth_error = 0.1**2 * 9 / 8
kink_error = 2 * 0.1 / 4  # (12.4) with a slope that jumps by 2


def hidden(x):
    """A dip between the nodes 0 and 0.2."""
    return np.abs(x - 0.1) - 0.05


# (1 - 1/500)^M <= 1/100; the logarithm of what is less than 1 is negative and turns the inequality
runs_to_see = int(np.ceil(np.log(0.01) / np.log(1 - 1 / 500)))


def failures_below(depth, failed, epsilon):
    """A share of those that are kept, not of all; of none there is no share."""
    left = depth <= -epsilon
    return failed[left].mean() if left.any() else np.nan


def search(controller, q, rng, tries=200):
    """All tries at once, each a row of one rollout; corners drawn at random."""
    signs = rng.choice([-1.0, 1.0], size=(controller.problem.steps, tries, 4))

    def play(moment):
        return signs[moment.step, moment.runs] * moment.bounds

    outcomes, _ = rollouts(controller, np.repeat(q[None], tries, axis=0), play, rng)
    beaten = np.flatnonzero(outcomes != 0)
    return signs[:, beaten[0]] if len(beaten) else np.empty((0, 4))


RIGHT = {
    check_chord: (smooth_error, kink_error),
    check_kink: (hidden, "lost island"),
    check_upper: runs_to_see,
    check_depth: failures_below,
    check_search: search,
}
WRONG = {
    check_chord: [(0.045, kink_error), (smooth_error, 0.025), (0.1125, 0.05)],
    check_kink: [
        (hidden, "false island"),
        (lambda x: np.abs(x) - 0.05, "lost island"),  # on a node
        (lambda x: 3 * np.abs(x - 0.1) - 0.05, "lost island"),  # too steep
        (lambda x: np.abs(x - 0.1) + 0.05, "lost island"),  # no island
    ],
    check_upper: [500, 2000, 5000],
    check_depth: [
        lambda depth, failed, epsilon: failed[depth >= -epsilon].mean() if (depth >= -epsilon).any() else np.nan,
        lambda depth, failed, epsilon: (failed & (depth <= -epsilon)).mean() if epsilon < 0.1 else np.nan,
    ],
    check_search: [
        lambda controller, q, rng: np.ones((controller.problem.steps, 4)),  # beats few, and claims all
        lambda controller, q, rng: np.ones((3, 4)),
        lambda controller, q, rng: np.empty((0, 4)),  # gives up
    ],
}
