"""Solutions of chapter 13, and answers that its checks refuse."""

from fractions import Fraction
from math import gcd, lcm

import numpy as np
from course.chapter_13 import check_aligned, check_claims, check_clear, check_image, check_outward

# The slowest push for the left end and the fastest for the right: the image is all between them.
after = (
    Fraction(3, 5) + Fraction(1, 4) * (-1 - Fraction(1, 5)),
    Fraction(13, 20) + Fraction(1, 4) * (-1 + Fraction(1, 5)),
)


def stays_clear(a, b, u, wind, post, delta):
    """Left of it throughout, or right of it throughout: linear functions are positive if they are so at both ends."""
    left, left_rate, right, right_rate = post
    times = (Fraction(0), delta)
    below = all(b + tau * (u + wind) < left + left_rate * tau for tau in times)
    above = all(a + tau * (u - wind) > right + right_rate * tau for tau in times)
    return below or above


def aligned_width(delta, inputs, wind):
    """Over a common denominator the ways are whole numbers."""
    ways = [delta * (Fraction(u) + sign * wind) for u in inputs for sign in (-1, 1)]
    common = lcm(*(way.denominator for way in ways))
    return Fraction(gcd(*(int(way * common) for way in ways)), common)


def claims_that_fail(certificate, edges, target, steps, moved, safe):
    """A claim with n = 0 is about the target, another about what its image meets."""

    def true(k, c, n, u):
        a, b = edges[c], edges[c + 1]
        if n == 0:
            return target[0] <= a and b <= target[1] and safe(a, b, None, k)
        if k + n > steps or not safe(a, b, u, k):
            return False
        low, high = moved(a, b, u)
        if low < edges[0] or high > edges[-1]:
            return False
        met = [m for m in range(len(edges) - 1) if edges[m + 1] > low and edges[m] < high]
        return all(certificate.get((k + 1, m), (n,))[0] < n for m in met)

    return {(k, c) for (k, c), (n, u) in certificate.items() if not true(k, c, n, u)}


def outward_image(a, b, u, wind, tau):
    """After each operation one unit outwards; a product's sign decides nothing, since it is moved after rounding."""
    down, up = (lambda x: np.nextafter(x, -np.inf)), (lambda x: np.nextafter(x, np.inf))
    low = down(a + down(tau * down(u - wind)))
    high = up(b + up(tau * up(u + wind)))
    return low, high


RIGHT = {
    check_image: (after,),
    check_clear: stays_clear,
    check_aligned: aligned_width,
    check_claims: claims_that_fail,
    check_outward: outward_image,
}


def _ends_only(a, b, u, wind, post, delta):
    left, left_rate, right, right_rate = post
    low, high = a + delta * (u - wind), b + delta * (u + wind)
    return high < left + left_rate * delta or low > right + right_rate * delta


def _each_time(a, b, u, wind, post, delta):
    """Clear at both ends, on any side: misses what passes through."""
    left, left_rate, right, right_rate = post
    return all(
        b + tau * (u + wind) < left + left_rate * tau or a + tau * (u - wind) > right + right_rate * tau
        for tau in (0, delta)
    )


def _believes(certificate, edges, target, steps, moved, safe):
    return set()


def _forgets_safety(certificate, edges, target, steps, moved, safe):
    return claims_that_fail(certificate, edges, target, steps, moved, lambda *_: True)


def _forgets_the_instant(certificate, edges, target, steps, moved, safe):
    """A claim with n = 0 is looked at for the target alone."""

    def on_the_way(a, b, u, k):
        return u is None or safe(a, b, u, k)

    return claims_that_fail(certificate, edges, target, steps, moved, on_the_way)


def _any_claim(certificate, edges, target, steps, moved, safe):
    """Does not look at how many steps the cells that are met have to go."""
    easy = {key: (0, None) for key in certificate}
    rest = edges, target, steps, moved, safe
    return {key for key, claim in certificate.items() if key in claims_that_fail(easy | {key: claim}, *rest)}


def _to_nearest(a, b, u, wind, tau):
    return a + tau * (u - wind), b + tau * (u + wind)


def _one_unit(a, b, u, wind, tau):
    low, high = _to_nearest(a, b, u, wind, tau)
    return np.nextafter(low, -np.inf), np.nextafter(high, np.inf)


def _far_too_much(a, b, u, wind, tau):
    low, high = _to_nearest(a, b, u, wind, tau)
    return low - 1e-9, high + 1e-9  # or too little


WRONG = {
    check_image: [
        ((Fraction(7, 20), Fraction(2, 5)),),  # no adversary
        ((Fraction(9, 20), Fraction(3, 10)),),  # ends exchanged
        ((Fraction(2, 5), Fraction(7, 20)),),
    ],
    check_clear: [_ends_only, _each_time],
    check_aligned: [
        *(lambda delta, inputs, wind, n=n: aligned_width(delta, inputs, wind) / n for n in (3, 11, 13)),  # all fit
        lambda delta, inputs, wind: delta * wind,  # fits the wind alone
        lambda delta, inputs, wind: aligned_width(delta, inputs, wind) / 2,  # fits, and is not the largest
        lambda delta, inputs, wind: aligned_width(delta, inputs, Fraction(0)),
    ],
    check_claims: [_believes, _forgets_safety, _forgets_the_instant, _any_claim],
    check_outward: [_to_nearest, _one_unit, _far_too_much],
}
