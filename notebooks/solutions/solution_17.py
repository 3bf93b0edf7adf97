"""Solutions of chapter 17, and answers that its checks refuse."""

from itertools import product
from math import ceil, log

import numpy as np
from course.chapter_17 import check_count, check_lever, check_motor, check_push, check_worst


def lever(lengths, errors):
    """Joint i turns all links from i on, whose ends are no farther from it than they are long together."""
    return sum(error * sum(lengths[i:]) for i, error in enumerate(errors))


def records_needed(eps, confidence):
    """If another record exceeds with more than eps, n do not with less than (1 - eps)^n."""
    return ceil(log(1 - confidence) / log(1 - eps))


def torque_needed(change, inertia, error, friction):
    """(17.2), solved for the torque that accelerates, and what friction takes."""
    return change**2 * inertia / (2 * error) + friction


def surely(y, u, dt, error):
    """What is left of the largest push when errors of both ends are taken off."""
    return max(0.0, np.abs(np.diff(y) / dt - u).max() - 2 * error / dt)


def worst_commands(peak, u_max, steps):
    """All of them."""
    return max((u_max * np.array(one) for one in product((-1.0, 1.0), repeat=steps)), key=peak)


RIGHT = {
    check_lever: lever,
    check_count: records_needed,
    check_motor: torque_needed,
    check_push: surely,
    check_worst: worst_commands,
}
WRONG = {
    check_lever: [
        lambda lengths, errors: sum(e * length for e, length in zip(errors, lengths, strict=True)),
        lambda lengths, errors: sum(lengths) * max(errors),
        lambda lengths, errors: sum(e * sum(lengths[: i + 1]) for i, e in enumerate(errors)),
    ],
    check_count: [
        lambda eps, confidence: round(3 / eps),
        lambda eps, confidence: log(1 - confidence) / log(1 - eps),
        lambda eps, confidence: ceil(log(confidence) / log(eps)),
    ],
    check_motor: [
        lambda change, inertia, error, friction: change**2 * inertia / (2 * error),
        lambda change, inertia, error, friction: change**2 * inertia / error + friction,
        lambda change, inertia, error, friction: change * inertia / (2 * error) + friction,
    ],
    check_push: [
        lambda y, u, dt, error: np.abs(np.diff(y) / dt - u).max() - 2 * error / dt,
        lambda y, u, dt, error: max(0.0, np.abs(np.diff(y) / dt - u).max() - error / dt),
        lambda y, u, dt, error: max(0.0, (np.diff(y) / dt - u).max() - 2 * error / dt),
    ],
    check_worst: [
        lambda peak, u_max, steps: u_max * np.ones(steps),
        lambda peak, u_max, steps: u_max * (-1.0) ** np.arange(steps),
        lambda peak, u_max, steps: np.zeros(steps),
    ],
}
