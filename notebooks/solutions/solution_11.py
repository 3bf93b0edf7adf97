"""Solutions of chapter 11, and answers that its checks refuse."""

from itertools import product

import numpy as np
from course.chapter_11 import check_adversary, check_error, check_fewest, check_filter, check_rule, check_wilson

import sdhj


def fewest(values):
    """argmax finds the first True, and 0 where there is none: that has to be told apart."""
    inside = values <= 0
    return np.where(inside.any(axis=0), inside.argmax(axis=0), -1)


def calm_shoulder(among):
    """One number for two wishes: margins are metres, far below the 1.5 rad/s between two levels."""
    return np.abs(among.problem.inputs[among.inputs, 0]) + 1e-3 * among.margins


def wilson(successes, runs):
    """Of all rates, those that are not more than z standard errors *of their own* from what was counted."""
    z, p = 1.96, successes / runs
    half = z * np.sqrt(p * (1 - p) / runs + z**2 / (4 * runs**2))
    low, high = ((p + z**2 / (2 * runs) + sign * half) / (1 + z**2 / runs) for sign in (-1, 1))
    return max(low, 0.0), min(high, 1.0)


# M successes of M: the failures' interval ends at z^2 / (M + z^2), below 1/1000 where M > 999 z^2
runs_needed = int(np.ceil(1.96**2 * 999))


def nearest_safe(controller, q, step, wanted):
    """Only among safe inputs; where there is none nobody is entitled to drive on, so the exception goes through."""
    safe = controller.safe_inputs(q, step)  # raises NotAdmissible
    return safe[np.argmin(np.linalg.norm(controller.problem.inputs[safe] - wanted, axis=1))]


def villain(moment):
    """The corner of the box that puts the robot deepest outside the set it means to be in, if it is kept to the end."""
    signs = np.array(list(product((-1.0, 1.0), repeat=moment.previous.shape[1])))
    ends = moment.predicted()[:, None] + moment.remaining * signs * moment.bounds[:, None]
    return signs[np.argmax(moment.tube(ends), axis=1)] * moment.bounds


def largest_error(margins, avoid, slope, slope_avoid):
    """Both conditions: the smaller of two errors, and none where one of them fails already."""
    return np.maximum(np.minimum(-margins / slope, -avoid / slope_avoid), 0.0)


RIGHT = {
    check_fewest: fewest,
    check_rule: calm_shoulder,
    check_wilson: (wilson, runs_needed),
    check_filter: nearest_safe,
    check_adversary: villain,
    check_error: largest_error,
}


def _normal(successes, runs):
    p = successes / runs
    half = 1.96 * np.sqrt(p * (1 - p) / runs)
    return max(p - half, 0.0), min(p + half, 1.0)


def _ignores_safety(controller, q, step, wanted):
    controller.safe_inputs(q, step)
    return np.argmin(np.linalg.norm(controller.problem.inputs - wanted, axis=1))


def _gives_up(controller, q, step, wanted):
    try:
        return nearest_safe(controller, q, step, wanted)
    except sdhj.NotAdmissible:
        return 12


WRONG = {
    check_fewest: [
        lambda values: (values <= 0).argmax(axis=0),  # 0 where there is none
        lambda values: np.where((values < 0).any(axis=0), (values < 0).argmax(axis=0), -1),  # the boundary is inside
        lambda values: np.where((values <= 0).any(axis=0), (values > 0).sum(axis=0), -1),  # relies on nesting
    ],
    check_rule: [
        lambda among: np.linalg.norm(among.problem.inputs, axis=1)[among.inputs],  # "effort"
        lambda among: among.problem.inputs[among.inputs, 0],  # with its sign
        lambda among: -np.abs(among.problem.inputs[among.inputs, 0]),
    ],
    check_wilson: [(_normal, runs_needed), (wilson, 4000), (wilson, 1000)],
    check_filter: [
        _ignores_safety,
        _gives_up,
        lambda controller, q, step, wanted: controller.select(q, step),  # safe, not near
    ],
    check_adversary: [lambda moment: np.zeros_like(moment.previous), lambda moment: moment.bounds.copy()],
    check_error: [
        lambda margins, avoid, slope, slope_avoid: np.maximum(-margins / slope, 0.0),  # reaching only
        lambda margins, avoid, slope, slope_avoid: np.maximum(-avoid / slope_avoid, 0.0),  # the way only
        lambda margins, avoid, slope, slope_avoid: np.minimum(-margins / slope, -avoid / slope_avoid),  # below 0
        lambda margins, avoid, slope, slope_avoid: np.maximum(-np.maximum(margins, avoid) / slope, 0.0),  # one slope
    ],
}
