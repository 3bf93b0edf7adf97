"""Checks of the exercises of chapter 13."""

from fractions import Fraction
from itertools import pairwise

import numpy as np
from exercises import exercise, expect


@exercise("13.1")
def check_image(after):
    """[3/5 - 3/10, 13/20 - 1/5]."""
    wanted = Fraction(3, 5) - Fraction(3, 10), Fraction(13, 20) - Fraction(1, 5)
    expect(len(after) == 2, "a pair: the left and the right end.")
    expect(all(isinstance(end, Fraction) for end in after), "as Fractions, so that nothing is rounded.")
    expect(after[0] != Fraction(7, 20) or after[1] != Fraction(2, 5), "that is without the adversary.")
    expect(tuple(after) == wanted, "left end: a + delta (u - 1/5); right end: b + delta (u + 1/5).")


def _truth(a, b, u, wind, post, delta):
    """One side throughout: two linear functions of tau, each positive at both ends of the interval."""
    left, left_rate, right, right_rate = post
    below = (left - b, left + left_rate * delta - b - delta * (u + wind))
    above = (a - right, a + delta * (u - wind) - right - right_rate * delta)
    return min(below) > 0 or min(above) > 0


@exercise("13.2")
def check_clear(stays_clear):
    """Random fractions, those that touch, and those that change sides."""
    delta, wind = Fraction(1, 4), Fraction(1, 5)
    jumped = Fraction(0), Fraction(1, 10), 30, wind, (Fraction(1), Fraction(0), Fraction(2), Fraction(0)), delta
    expect(not stays_clear(*jumped), "a cell that is left of the post at first and right of it in the end has met it.")
    touched = Fraction(0), Fraction(1), 0, Fraction(0), (Fraction(1), Fraction(0), Fraction(2), Fraction(0)), delta
    expect(not stays_clear(*touched), "closed intervals that share a point are not clear of each other.")
    late = Fraction(0), Fraction(1), 0, Fraction(0), (Fraction(2), Fraction(-5), Fraction(9), Fraction(0)), delta
    expect(not stays_clear(*late), "the post may arrive during the interval: look at its end too.")
    rng = np.random.default_rng(0)
    for _ in range(3000):
        a, width, left, thick = (Fraction(int(n), 20) for n in (*rng.integers(-20, 20, 1), *rng.integers(1, 20, 3)))
        rates = [Fraction(int(n), 10) for n in rng.integers(-20, 21, 2)]
        u = int(rng.integers(-1, 2))
        given = a, a + width, u, wind, (left, rates[0], left + thick, rates[1]), delta
        if left + thick + rates[1] * delta < left + rates[0] * delta:
            continue  # the post has turned inside out
        got = stays_clear(*given)
        expect(bool(got) == _truth(*given), f"for a, b, u, wind, post, delta = {given} the answer should be {not got}.")


@exercise("13.3")
def check_aligned(aligned_width):
    """The greatest common divisor of the fractions delta (u +- wind)."""
    for delta, inputs, wind in (
        (Fraction(1, 4), (-1, 0, 1), Fraction(1, 5)),
        (Fraction(1, 10), (Fraction(-3), Fraction(-3, 2), 0, Fraction(3, 2), Fraction(3)), Fraction(3, 10)),
        (Fraction(1, 3), (0, 2), Fraction(1, 7)),
        (Fraction(1, 4), (-1, 1), Fraction(3, 10)),
    ):
        width = Fraction(aligned_width(delta, inputs, wind))
        expect(width > 0, "a width is positive.")
        ways = [delta * (Fraction(u) + sign * wind) for u in inputs for sign in (-1, 1)]
        hint = f"delta {delta}, inputs {[str(u) for u in inputs]}, wind {wind}"
        expect(all((way / width).denominator == 1 for way in ways), f"{hint}: some way is no whole number of widths.")
        wider = [width * factor for factor in (2, 3, 5, 7)]
        fits = [w for w in wider if all((way / w).denominator == 1 for way in ways)]
        expect(not fits, f"{hint}: {fits[0] if fits else ''} is wider and fits as well.")


def _game():
    """A certificate with true claims and what is needed to judge them; cells of two widths."""
    edges = [Fraction(-1) + Fraction(i, 10) for i in range(15)] + [Fraction(1, 2) + Fraction(i, 20) for i in range(11)]
    edges = sorted(set(edges))
    delta, wind, steps, target = Fraction(1, 4), Fraction(1, 10), 3, (Fraction(-2, 5), Fraction(2, 5))

    def moved(a, b, u):
        return a + delta * (u - wind), b + delta * (u + wind)

    def safe(a, b, u, k):
        return b < Fraction(9, 10) - Fraction(k, 20) and (u is None or moved(a, b, u)[1] < Fraction(9, 10))

    found = {}
    for k in range(steps, -1, -1):
        for c, (a, b) in enumerate(pairwise(edges)):
            if target[0] <= a and b <= target[1] and safe(a, b, None, k):
                found[k, c] = 0, None
        for n in range(1, steps - k + 1):
            for c, (a, b) in enumerate(pairwise(edges)):
                for u in (-1, 0, 1):
                    if (k, c) in found or not safe(a, b, u, k):
                        continue
                    low, high = moved(a, b, u)
                    if low < edges[0] or high > edges[-1]:
                        continue
                    cells = [m for m in range(len(edges) - 1) if edges[m + 1] > low and edges[m] < high]
                    if all((k + 1, m) in found and found[k + 1, m][0] < n for m in cells):
                        found[k, c] = n, u
    return found, edges, target, steps, moved, safe


@exercise("13.4")
def check_claims(claims_that_fail):
    """A true certificate, and forgeries of every kind."""
    true, *rest = _game()
    steps, edges = rest[2], rest[0]
    middle = next(c for c in range(len(edges) - 1) if edges[c] == Fraction(1, 5))
    later = next((k, c) for (k, c), (n, _) in true.items() if n == 2)
    first = next((k, c) for (k, c), (n, _) in true.items() if n == 1)

    def found(certificate):
        return set(claims_that_fail(certificate, *rest))

    expect(found(true) == set(), "a true certificate: nothing is false.")
    outside = next(c for c in range(len(edges) - 1) if (steps, c) not in true)
    expect(found(true | {(steps, outside): (0, None)}) == {(steps, outside)}, "n = 0 outside the target is false.")
    expect(found(true | {first: (1, -true[first][1] or 1)}) >= {first}, "with another input the image lies elsewhere.")
    expect(later in found(true | {later: (1, true[later][1])}), "n = 1 must lead into cells with n = 0.")
    without = {key: claim for key, claim in true.items() if key != (steps, middle)}
    expect(found(without), "a missing cell: whoever leaned on it is false now.")
    expect((steps, 0) in found(true | {(steps, 0): (1, 0)}), "after the last step there is no step: k + n <= steps.")
    edge = {(k, c): (n, u) for (k, c), (n, u) in true.items()} | {(0, 0): (3, -1)}
    expect((0, 0) in found(edge), "an image that leaves the line is covered by no cell.")
    near = next(c for c in range(len(edges) - 1) if edges[c + 1] >= Fraction(9, 10))
    expect((0, near) in found(true | {(0, near): (3, -1)}), "a claim that is not safe on the way is false.")


@exercise("13.5")
def check_outward(outward_image):
    """Contained, and within a few units in the last place."""
    rng = np.random.default_rng(0)
    cases = [tuple(rng.uniform(-1, 1, 5)) for _ in range(2000)]
    cases += [(1e16, 1e16, 1.0, 0.1, 0.1), (0.1, 0.2, -0.3, 1e-17, 0.7), (-1e-300, 1e-300, 1e-8, 1e-12, 0.25)]
    cases += [(1.0, 1.0, 1e-17, 0.0, 1.0), (0.1, 0.3, 0.3, 0.1, 3.0), (0.0, 0.0, 0.0, 0.0, 0.5)]
    for a, width, u, wind, tau in cases:
        b, wind, tau = a + abs(width) if abs(a) < 1e10 else a, abs(wind), abs(tau)
        low, high = outward_image(a, b, u, wind, tau)
        exact_low = Fraction(a) + Fraction(tau) * (Fraction(u) - Fraction(wind))
        exact_high = Fraction(b) + Fraction(tau) * (Fraction(u) + Fraction(wind))
        given = f"a, b, u, wind, tau = {(a, b, u, wind, tau)}"
        expect(Fraction(float(low)) <= exact_low, f"{given}: the left end is inside the exact image.")
        expect(Fraction(float(high)) >= exact_high, f"{given}: the right end is inside the exact image.")
        size = max(abs(a), abs(b), abs(tau * u), abs(tau * wind), 1e-290)
        slack = 16 * Fraction(float(np.spacing(size)))
        expect(exact_low - Fraction(float(low)) <= slack, f"{given}: the left end is farther out than it has to be.")
        expect(Fraction(float(high)) - exact_high <= slack, f"{given}: the right end is farther out than it has to be.")
