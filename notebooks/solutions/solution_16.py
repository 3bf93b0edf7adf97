"""Solutions of chapter 16, and answers that its checks refuse."""

from fractions import Fraction

import numpy as np
from course.chapter_16 import check_attack, check_box, check_inputs, check_largest, check_shortest

import sdhj

# (16.4): e_1 + e_2 d + b d^2 / 2 and e_2 + b d
half_widths = Fraction(1, 50) + Fraction(1, 125) + Fraction(1, 100), Fraction(1, 25) + Fraction(1, 10)


def right_inputs(y, kept_by, half):
    """The state may be anywhere in the box, so all of it has to lie in one interval of K(u)."""
    return [u for u, parts in kept_by.items() if any(low <= y - half and y + half <= high for low, high in parts)]


def shortest(error, delay, jitter, push):
    """The bracket of (16.10) is zero at the first; an answer has to come within the shortest interval."""
    return max(2 * (error + delay * push) / (1 - push) + 2 * jitter, delay + 2 * jitter)


def attack(q, error, edges, choose, after):
    """One try in the middle of each piece within reach."""
    cuts = np.concatenate([[q - error], edges[np.abs(edges - q) < error], [q + error]])
    tries = [*(cuts[1:] + cuts[:-1]) / 2 - q, 0.0]
    return max(tries, key=lambda off: after(q, choose(q + off)))


def largest_error(make, state):
    """The larger the error, the less is promised: halve an interval at whose left end the state still is."""

    def promised(error):
        try:
            table = sdhj.solve(make(error), progress=False)
        except ValueError:  # too much is unknown
            return False
        return bool(table.contains(state[None], start=0, within=table.steps)[0])

    low, high = 0.0, 0.2
    while high - low > 5e-4:
        middle = (low + high) / 2
        low, high = (middle, high) if promised(middle) else (low, middle)
    return low


def _most_that_solves(make, state):
    """Asks whether anything is left, of whatever state."""
    low, high = 0.0, 0.2
    while high - low > 5e-4:
        middle = (low + high) / 2
        try:
            make(middle)
            low = middle
        except ValueError:
            high = middle
    return low


def _of_predictions(make, state):
    """Takes the state for its prediction: M in place of W."""
    low, high = 0.0, 0.2
    while high - low > 5e-4:
        middle = (low + high) / 2
        try:
            table = sdhj.solve(make(middle), progress=False)
            inside = sdhj.Controller(table).steps_to_go(state, 0) is not None
        except ValueError:
            inside = False
        low, high = (middle, high) if inside else (low, middle)
    return low


RIGHT = {
    check_box: (half_widths,),
    check_inputs: right_inputs,
    check_shortest: shortest,
    check_attack: attack,
    check_largest: largest_error,
}
WRONG = {
    check_box: [
        ((Fraction(1, 50), Fraction(7, 50)),),  # the place does not move
        ((Fraction(7, 250), Fraction(1, 25)),),  # no wind
        ((0.038, 0.14),),
        ((Fraction(6, 125), Fraction(7, 50)),),  # b d^2, not half of it
    ],
    check_inputs: [
        lambda y, kept_by, half: [u for u, parts in kept_by.items() if any(a <= y <= b for a, b in parts)],
        lambda y, kept_by, half: [  # both ends, in whatever intervals
            u
            for u, parts in kept_by.items()
            if all(any(a <= end <= b for a, b in parts) for end in (y - half, y + half))
        ],
        lambda y, kept_by, half: [  # somewhere in the box
            u for u, parts in kept_by.items() if any(a <= y + half and y - half <= b for a, b in parts)
        ],
    ],
    check_shortest: [
        lambda e, d, j, b: 2 * (e + d * b) / (1 - b) + 2 * j,  # an answer too late
        lambda e, d, j, b: max((e + d * b) / (1 - b) + 2 * j, d + 2 * j),  # shrunk once
        lambda e, d, j, b: max(2 * (e + d) / (1 - b) + 2 * j, d + 2 * j),  # all of the delay unknown
    ],
    check_attack: [
        lambda q, error, edges, choose, after: error,
        lambda q, error, edges, choose, after: max(
            np.linspace(-error, error, 1001), key=lambda off: after(q, choose(q + off))
        ),
        lambda q, error, edges, choose, after: max(
            (edges[1:] + edges[:-1]) / 2 - q, key=lambda off: after(q, choose(q + off))
        ),  # of any size
    ],
    check_largest: [_most_that_solves, _of_predictions, lambda make, state: 0.01],
}
