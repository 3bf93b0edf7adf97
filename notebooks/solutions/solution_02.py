"""Solutions of chapter 2, and answers that its checks refuse."""

import numpy as np
from course.chapter_02 import check_amplification, check_filled, check_help, check_steps, check_third, check_wall

# 0.5 s, speeds 1.3 and 0.8 m/s, spacing 3 / 40 m, a CFL number of 0.75
steps_needed = int(np.ceil(0.5 * (1.3 + 0.8) / (3 / 40) / 0.75))


def amplification(courant, theta):
    """Half of what there was, half of two Euler steps: (1 + (1 + z)^2) / 2 = 1 + z + z^2 / 2."""
    z = courant * (np.exp(1j * theta) - 1)
    return np.abs((1 + (1 + z) ** 2) / 2)


def helper(minus, plus, low, high):
    """As `godunov`, with the minimum: each velocity looks where it leads, and standing still is allowed."""
    best = np.minimum(low * (plus if low > 0 else minus), high * (plus if high > 0 else minus))
    return np.minimum(best, 0.0) if low < 0 < high else best


def at_the_wall(x, tau):
    """The state moves right and stops at 1."""
    return np.minimum(x + tau, 1.0)


def _smaller(a, b):
    return np.where(np.abs(a) < np.abs(b), a, b)


def eno3(values, h):
    """Divided differences: the parabola that bends less, then the cubic that adds less."""
    first = np.roll(values, -1) - values  # D at i + 1/2
    bend = first - np.roll(first, 1)  # B at i
    third = np.roll(bend, -1) - bend  # C at i + 1/2

    def at(array, shift):
        return np.roll(array, -shift)

    def correction(base, sign):
        """Second- and third-order terms for the slope at node i from D at base + 1/2, where base is -1 or 0."""
        left, right = at(bend, base), at(bend, base + 1)  # B at the two ends of that interval
        inner_is = np.abs(left) < np.abs(right)
        second = sign * _smaller(left, right) / 2
        from_left = _smaller(at(third, base - 1), at(third, base))
        from_right = _smaller(at(third, base), at(third, base + 1))
        # the cubic's slope at node i: (i - a)(i - b) / 6 with a, b the other two nodes of the parabola's three
        if sign > 0:  # base = -1: nodes i-1, i and one more
            return second + np.where(inner_is, from_left / 3, -from_right / 6)
        return second + np.where(inner_is, -from_left / 6, from_right / 3)

    return (at(first, -1) + correction(-1, 1)) / h, (first + correction(0, -1)) / h


def lowered(values):
    """Where the function is concave: the second difference is negative."""
    return np.roll(values, -1) - 2 * values + np.roll(values, 1) < 0


def _parts(x, *intervals):
    return np.min([np.maximum(left - x, x - right) for left, right in intervals], axis=0)


def filled(x):
    """Two intervals with a gap of three cells: its crest, 0.04 high, is worn down by about 0.04."""
    return _parts(np.mod(x + 1.0, 2.0) - 1.0, (-0.4, 0.001), (0.08, 0.4))


RIGHT = {
    check_steps: steps_needed,
    check_amplification: amplification,
    check_help: helper,
    check_wall: at_the_wall,
    check_third: eno3,
    check_filled: (lowered, filled),
}


def _first_order(values, h):
    right = np.roll(values, -1) - values
    return np.roll(right, 1) / h, right / h


def _second_order(values, h):
    right = np.roll(values, -1) - values
    left = np.roll(right, 1)
    bend = right - left
    minus = left + _smaller(np.roll(bend, 1), bend) / 2
    return minus / h, (right - _smaller(np.roll(bend, -1), bend) / 2) / h


def _fixed_stencil(values, h):
    """Third order, always from the same nodes: it looks across kinks."""
    m2, m1, p1, p2 = (np.roll(values, shift) for shift in (2, 1, -1, -2))
    return (m2 - 6 * m1 + 3 * values + 2 * p1) / (6 * h), (-2 * m1 - 3 * values + 6 * p1 - p2) / (6 * h)


WRONG = {
    check_steps: [18, 14, 20, 12],  # rounded down; no adversary; 40 nodes; one axis
    check_amplification: [
        lambda c, theta: np.abs(1 + c * (np.exp(1j * theta) - 1)),  # Euler
        lambda c, theta: np.abs(1 + c * (np.exp(1j * theta) - 1)) ** 2,  # no mean
        lambda c, theta: (1 + (1 + c * (np.exp(1j * theta) - 1)) ** 2) / 2,  # G, not its size
    ],
    check_help: [
        lambda minus, plus, low, high: np.minimum(low * (minus + plus) / 2, high * (minus + plus) / 2),  # mean slope
        lambda minus, plus, low, high: np.minimum(
            low * (plus if low > 0 else minus), high * (plus if high > 0 else minus)
        ),
        lambda minus, plus, low, high: np.minimum(
            low * (minus if low > 0 else plus), high * (minus if high > 0 else plus)
        ),
    ],
    check_wall: [
        lambda x, tau: x + tau,
        lambda x, tau: np.where(x + tau > 1, np.inf, x + tau),
        lambda x, tau: np.minimum(x, 1),
    ],
    check_third: [_first_order, _second_order, _fixed_stencil],
    check_filled: [
        (lambda values: ~lowered(values), filled),  # where it is raised
        (lambda values: np.gradient(values) < 0, filled),  # where the function falls
        (lowered, lambda x: _parts(x, (-0.4, 0.4))),  # one part: nothing is claimed in error
        (lowered, lambda x: _parts(x, (-0.8, -0.2), (0.2, 0.8))),  # the gap is too wide
        (lowered, lambda x: np.where(_parts(x, (-0.4, 0.0), (0.08, 0.4)) <= 0, -1.0, 1.0)),  # slopes of more than one
    ],
}
