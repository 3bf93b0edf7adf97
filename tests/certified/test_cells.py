"""Cells and images, in exact arithmetic."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from zoo import line

import sdhj
from sdhj.certified.cells import CellAxis, aligned_width, as_fraction, as_rounded_fraction, period_bounds

PI = (Fraction(314159265358979323846, 10**20), Fraction(314159265358979323847, 10**20))


def angle_axis(width=Fraction(3, 100)):
    return CellAxis(as_fraction(-np.pi), period_bounds(-np.pi, np.pi), width, True)


def test_cells_partition_the_axis():
    for axis in (angle_axis(), CellAxis(as_fraction(-0.36), (Fraction(72, 100),) * 2, Fraction(1, 50), False)):
        edges = axis.edges()
        assert np.all(np.diff(edges) > 0)
        assert edges[0] == float(axis.lower)
        assert edges[-1] == pytest.approx(float(axis.lower + axis.extent[0]), abs=2e-14)  # the doubt about 2 pi
        assert axis.shares().sum() == pytest.approx(1.0, abs=1e-12)
        assert (axis.count - 1) * axis.width < axis.extent[0] <= axis.extent[1] <= axis.count * axis.width
    low, high = angle_axis().extent
    assert low < 2 * PI[0] and 2 * PI[1] < high and high - low < Fraction(1, 10**13)
    assert period_bounds(0.0, 1.0) == (1, 1)  # a period that is a short decimal is exact


def test_cells_are_aligned_where_the_numbers_allow():
    axes = sdhj.Certified(cells=(419, 419, 72, 72)).axes(sdhj.arm_case_study(nodes=5, steps=1))
    assert [axis.width for axis in axes] == [Fraction(3, 200)] * 2 + [Fraction(1, 100)] * 2
    assert aligned_width(Fraction(1), Fraction(1, 3), 10) == Fraction(1, 9)
    assert aligned_width(Fraction(1), Fraction(1, 3000001), 10) == Fraction(1, 10)  # no sensible measure
    assert aligned_width(Fraction(1), Fraction(0), 10) == Fraction(1, 10)


def test_a_period_that_may_be_a_little_more_than_one_is_cut_into_cells():
    problem = line(
        (-1.0, 1.0),
        grid=sdhj.Grid([0.1 + 0.2], [1.3], [11], periodic=[True]),
        target=sdhj.TargetSet((0,), lambda p, t: np.cos(2 * np.pi * p[:, 0]) + 0.5),
        delta=0.1,
    )
    (axis,) = sdhj.Certified(cells=(10,)).axes(problem)
    assert axis.extent[0] < 1 < axis.extent[1] and axis.count == 10


@pytest.mark.slow
@given(
    st.booleans(),
    st.integers(50, 300),
    st.integers(3, 40),
    st.integers(-400, 400),
    st.integers(0, 100),
    st.sampled_from([0, 1]),
)
def test_image_holds_the_worst_adversary(periodic, extent, cells, drift, push, doubt):
    """The ends of the cell, moved by the extreme and the middle velocities, are in the cells of the image."""
    length = Fraction(extent, 100)
    width = length / cells if not periodic else length * 7 / (7 * cells - 3)  # a seam cell of 4/7 of the others
    error = doubt * periodic * length / 2**49  # only a period may be known to some digits
    axis = CellAxis(Fraction(0), (length - error, length + error), width, periodic)
    slow, fast = Fraction(drift - push, 100), Fraction(drift + push, 100)
    first, number = axis.image(slow, fast)
    edges = axis.edges()
    for cell in range(axis.count):
        image = [(first[cell] + c) % axis.count for c in range(number[cell])]
        for x in np.linspace(edges[cell], edges[cell + 1], 4):
            for v in np.linspace(float(slow), float(fast), 3):
                y = x + v
                y = y % float(length) if periodic else min(max(y, 0.0), float(length))
                held = [edges[i] - 1e-9 <= y <= edges[i + 1] + 1e-9 for i in image]
                around = periodic and (y < 1e-9 or y > float(length) - 1e-9)  # either side of the seam
                assert any(held) or around, (cell, x, v)


def test_image_loses_nothing_where_cells_are_aligned():
    axis = angle_axis(Fraction(3, 200))
    first, number = axis.image(as_rounded_fraction(0.12), as_rounded_fraction(0.18))
    inner = slice(0, axis.count - 30)
    np.testing.assert_array_equal(first[inner], np.arange(axis.count - 30) + 8)
    assert set(number[inner]) == {5}
    assert number.max() <= 7  # a cell more to each side across the seam
