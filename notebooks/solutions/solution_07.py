"""Solutions of chapter 7, and answers that its checks refuse."""

import numpy as np
from course.chapter_07 import check_in_order, check_inputs, check_pausing, check_rows, check_tubes, check_viable


def entry(N, k, n):
    """Whoever may take more steps than are left takes those that are left."""
    return min(n, N - k)


def _back(step, tube):
    """States from which some input leads into the tube, whatever v: (inputs, m), for each input."""
    return tube[step].all(axis=2)


def finite_tubes(step, goal, unsafe, N):
    """S(n) = S(n - 1), or some input leads to it for all v; and safe now."""
    tubes = [goal & ~unsafe]
    for _ in range(N):
        tubes.append(tubes[-1] | (_back(step, tubes[-1]).any(axis=0) & ~unsafe))
    return np.array(tubes)


def progress_inputs(step, goal, unsafe, N):
    """Of the leftmost tube that holds the state: the inputs that lead into the one before."""
    tubes = finite_tubes(step, goal, unsafe, N)
    inputs = np.zeros(step.shape[:2], bool)
    for n in range(1, N + 1):
        new = tubes[n] & ~tubes[n - 1]
        inputs |= _back(step, tubes[n - 1]) & new
    return inputs


def viable(step, unsafe):
    """Take away what may be driven out, until nothing more is: at most m rounds."""
    kept = ~unsafe
    while True:
        smaller = kept & _back(step, kept).any(axis=0)
        if np.array_equal(smaller, kept):
            return kept
        kept = smaller


def in_order(step, first, second, unsafe, N):
    """States with a flag. Seen: reach the second place. Not seen: reach the first, with steps enough left."""
    seen = finite_tubes(step, second, unsafe, N)
    unseen = first & seen[0]
    for n in range(1, N + 1):
        # a state of the first place is as if it had been seen; others need an input, whatever v
        now = np.where(first, seen[n - 1], unseen)
        unseen = (first & seen[n]) | unseen | (~unsafe & _back(step, now).any(axis=0))
    return unseen


def settled(entries, k, n):
    """Nothing new comes from the row below where its last two entries are equal."""
    return n >= 2 and np.array_equal(entries[k + 1, n - 1], entries[k + 1, n - 2])


def _line(goal_steps):
    """Six states in a row, to walk left, stay or walk right; the first is the goal at some steps of 0 to 4."""
    step = np.clip(np.arange(6) + np.array([[-1], [0], [1]]), 0, 5)[:, :, None]
    goals = np.zeros((5, 6), bool)
    goals[list(goal_steps), 0] = True
    return step, goals, np.zeros(6, bool)


RIGHT = {
    check_rows: entry,
    check_tubes: finite_tubes,
    check_inputs: progress_inputs,
    check_viable: viable,
    check_in_order: in_order,
    check_pausing: (settled, _line([3, 4])),
}


def _lucky(step, goal, unsafe, N):
    tubes = [goal & ~unsafe]
    for _ in range(N):
        tubes.append(tubes[-1] | (tubes[-1][step].any(axis=(0, 2)) & ~unsafe))
    return np.array(tubes)


def _exactly(step, goal, unsafe, N):
    tubes = [goal & ~unsafe]
    for _ in range(N):
        tubes.append(_back(step, tubes[-1]).any(axis=0) & ~unsafe)
    return np.array(tubes)


def _careless(step, goal, unsafe, N):
    tubes = [goal]
    for _ in range(N):
        tubes.append(tubes[-1] | _back(step, tubes[-1]).any(axis=0))
    return np.array(tubes)


WRONG = {
    check_rows: [lambda N, k, n: n, lambda N, k, n: N - k, lambda N, k, n: max(0, n - k)],
    check_tubes: [_lucky, _exactly, _careless],
    check_inputs: [
        lambda step, goal, unsafe, N: _back(step, finite_tubes(step, goal, unsafe, N)[-1]),  # safe, no progress
        lambda step, goal, unsafe, N: progress_inputs(step[:, :, :1], goal, unsafe, N),  # one move of the adversary
    ],
    check_viable: [
        lambda step, unsafe: ~unsafe,  # safe now
        lambda step, unsafe: ~unsafe & _back(step, ~unsafe).any(axis=0),  # one round
        lambda step, unsafe: viable(step[:1], unsafe),  # one input
    ],
    check_in_order: [
        lambda step, a, b, unsafe, N: finite_tubes(step, a, unsafe, N)[-1] & finite_tubes(step, b, unsafe, N)[-1],
        lambda step, a, b, unsafe, N: finite_tubes(step, a & finite_tubes(step, b, unsafe, N)[-1], unsafe, N)[-1],
        lambda step, a, b, unsafe, N: in_order(step, b, a, unsafe, N),
    ],
    check_pausing: [
        (lambda entries, k, n: n >= 2 and np.array_equal(entries[k, n - 1], entries[k, n - 2]), _line([3, 4])),
        (lambda entries, k, n: False, _line([3, 4])),  # never certain
        (settled, _line(range(5))),  # the goal is there all the time
        (settled, _line([])),  # never
    ],
}
