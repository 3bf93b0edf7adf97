"""Lattices of boxes against plain loops, in fractions where they must cover something."""

from fractions import Fraction

import numpy as np
import pytest

from sdhj.certified.check.counts import RUN, spans_of, strides_of, sums, tubes_miss
from sdhj.certified.check.lattice import Lattice

NEAR, SWAY = np.array([1e-10, 2e-10]), np.array([0.0101, 9.0])  # of which the second is more than a box


def lattice(pieces=3, periodic=(True, False)):
    """Cells of some widths, one of them a layer of none; two edges are rounded more than an end beside them is."""
    edges = [np.array([-1.0, -0.255, 0.13, 0.9, 1.0]), np.array([0.0, 0.0, 0.7, 1.4, 2.0])]
    return Lattice(edges, pieces, np.array(periodic), NEAR, SWAY)


def tubes(rng, edges):
    """Ends of some intervals, of which many end at edges, or nearly, and some are longer than the axis."""
    low = rng.choice(np.append(edges, rng.uniform(-3, 3, edges.size)), 400) + rng.choice([0.0, -1e-10, 1e-10, 0.3], 400)
    high = np.maximum(low, rng.choice(np.append(edges, rng.uniform(-3, 3, edges.size)), 400))
    return low, high + rng.choice([0.0, 1e-10, 0.004, 0.02, 3.0], 400)


def ends_at_rounding(edges, without):
    """Ends of intervals that are looked up at an edge exactly, and some units of rounding beside it."""
    units = np.arange(-3, 4)[:, None]
    low, high = (at + units * np.spacing(at) for at in (edges - without, edges + without))
    return np.append(low, high - 0.1), np.append(low + 0.1, high)


@pytest.mark.parametrize("axis", [0, 1])
def test_boxes_cover_what_is_looked_up(axis, rng):
    """Every tube lies in the wider boxes that it is said to overlap, exactly; and each of them is near to it."""
    for own in (lattice(), lattice(1, (False, False))):
        edges = own.edges[axis]
        drawn, rounded = tubes(rng, edges), ends_at_rounding(edges, own.without[axis])
        low, high = (np.append(some, more) for some, more in zip(drawn, rounded, strict=True))
        first, last = own.overlapped(axis, low, high)
        n, begin, end = edges.size - 1, Fraction(edges[0]), Fraction(edges[-1])
        wide = own.boxes(np.tile(np.arange(n)[:, None], 2) % own.shape, 1)[:, :, axis]
        wide[:, np.arange(n) >= own.shape[axis]] = np.nan
        for a, b, i, j in zip(low.tolist(), high.tolist(), first.tolist(), last.tolist(), strict=True):
            a, b = Fraction(a), Fraction(b)
            if own.periodic[axis]:
                assert 0 <= i < n and i <= j < 2 * n
                turns = (a + Fraction(own.without[axis]) - begin) // (end - begin) * (end - begin)
                a, b = a - turns, b - turns
                if (i, j) == (0, n - 1) and b - a >= (end - begin):
                    continue
                a, b = (a - end + begin, b - end + begin) if i == 0 and a > (begin + end) / 2 and j < n - 1 else (a, b)
            else:
                assert 0 <= i <= j < n
                a, b = min(max(a, begin), end), min(max(b, begin), end)
            lower = Fraction(float(wide[0, i]))
            upper = Fraction(float(wide[1, j % n])) + (end - begin) * (j // n)
            slack = Fraction(1, 10**14) if own.periodic[axis] else 0
            assert lower <= a + slack and b <= upper + slack
            few = Fraction(2 * own.wider[0, axis] + 4 * NEAR[axis])
            assert i == j or (a <= Fraction(float(wide[1, i])) + few and b >= Fraction(float(wide[0, j % n])) - few)


def test_boxes_that_may_meet_a_set_are_counted(rng):
    """Those of a set made of two, box by box; and tubes overlap as many as loops count."""
    own = lattice(40)
    centres, radii = np.array([[0.95, 1.0], [-0.2, 1.7]]), np.array([0.25, 0.1])

    def sign(centre, radius, box):
        """Of a disk, the two ends of the distance to a box, less the radius."""
        gap = np.maximum(np.maximum(box[0] - centre, centre - box[1]), 0.0)
        far = np.maximum(np.abs(box[0] - centre), np.abs(box[1] - centre))
        return np.hypot(*gap.T) > radius, np.hypot(*far.T) <= radius

    functions = [lambda box, at, one=one: sign(*one, box) for one in zip(centres, radii, strict=True)]
    (counts,) = own.counted(functions, 1)
    every = np.stack(np.unravel_index(np.arange(own.shape.prod()), own.shape), axis=1)
    met = ~np.all([one(own.boxes(every, 1), None)[0] for one in functions], axis=0).reshape(own.shape)
    assert 0.01 < met.mean() < 0.5 and np.array_equal(np.diff(np.diff(counts, axis=0), axis=1)[: own.shape[0]], met)

    def moving(box, at):
        """The first disk at the first time, and the second at the second."""
        ends = np.array([one(box, at) for one in functions])
        return tuple(ends[at, :, np.arange(len(at))].T)

    one, other, ever = own.counted([moving], 2)
    assert np.array_equal(ever, counts) and not np.array_equal(one, ever) and not np.array_equal(other, ever)
    ends = [own.overlapped(axis, *tubes(rng, own.edges[axis])) for axis in range(2)]
    spans, every = spans_of([(first[:, None], last[:, None]) for first, last in ends]), np.arange(400)
    twice = np.concatenate([met, met])
    (a, b), (c, d) = ends
    free = [not twice[a[k] : b[k] + 1, c[k] : d[k] + 1].any() for k in range(400)]
    for some in (every, np.repeat(np.flatnonzero(free), RUN)):  # tubes that all miss are looked up together
        found = np.empty(some.size, np.bool_)
        tubes_miss(counts.ravel(), strides_of(counts.shape), *spans, np.ones(2, int), 0 * every, every, some, found)
        assert np.array_equal(found, np.array(free)[some]) and found.any()


def test_tubes_from_cells_are_looked_up_in_any_order(rng):
    """Whose index along each of three axes, of which the tubes know two, plain division gives."""
    shape, sizes = (5, 4, 6), np.array([5, 6])
    met = rng.random(sizes) < 0.1
    counts = sums(met, np.array([False, False]))
    first = [rng.integers(0, n, (3, n)) for n in sizes]
    last = [np.minimum(low + rng.integers(0, 2, low.shape), n - 1) for low, n in zip(first, sizes, strict=True)]
    numbers, some = rng.permutation(120), rng.integers(0, 120, 500)
    found, tube = np.empty(500, np.bool_), rng.integers(0, 3, 120)
    spans = spans_of(list(zip(first, last, strict=True)))
    tubes_miss(counts.ravel(), strides_of(counts.shape), *spans, np.array([24, 1]), numbers, tube, some, found)
    for one, said in zip(some.tolist(), found.tolist(), strict=True):
        x, _, z = np.unravel_index(numbers[one], shape)
        (a, c), (b, d) = ([ends[k][tube[one], at] for k, at in enumerate((x, z))] for ends in (first, last))
        assert said == (not met[a : b + 1, c : d + 1].any())
    assert 0.1 < found.mean() < 0.95
