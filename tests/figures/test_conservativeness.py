"""Comparing two tables: volumes, and distances of slices."""

import dataclasses

import naive_projections as naive
import numpy as np
import pytest
import zoo
from extra_conservativeness import compare, hausdorff
from hypothesis import given, settings
from hypothesis.extra.numpy import arrays

import sdhj
from sdhj import Grid
from sdhj.common.remembering import read_only

TORUS = Grid([0.0, -1.0], [1.0, 1.0], [5, 6], [True, False])


@settings(max_examples=30)
@given(a=arrays(bool, (5, 6)), b=arrays(bool, (5, 6)))
def test_hausdorff_is_the_twin_on_a_partly_periodic_grid(a, b):
    found = hausdorff(TORUS, a, b)
    if a.any() and b.any():
        points = TORUS.points()
        assert found == pytest.approx(naive.hausdorff(points[a.ravel()], points[b.ravel()], [1.0, None]), abs=1e-12)
        assert found == hausdorff(TORUS, b, a)
    else:
        assert found == (0.0 if a.any() == b.any() else np.inf)


@pytest.fixture(scope="module")
def tables():
    problem = sdhj.arm_case_study(nodes=9, steps=2)
    return [sdhj.solve(problem, method=method, progress=False) for method in ("hji", "projected")]


def test_the_rows_are_the_volumes_of_the_tables(tables):
    full, inner = tables
    rows = compare(full, inner, [])
    assert [(row.start, row.within) for row in rows] == [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (2, 0)]
    for row in rows:
        assert row.reference == full.fraction(start=row.start, within=row.within)
        assert row.ratio == inner.fraction(start=row.start, within=row.within) / row.reference
        if row.within == 0:
            assert row.ratio == 1.0
    assert rows[2].ratio < 1.0


def test_a_tube_made_smaller_by_a_known_distance_is_that_far_away():
    """|q| <= 1.03 against |q| <= 0.63: 0.4, with the other axis held or left free (the ends lie off the nodes)."""
    problem = zoo.pursued_on_a_line(
        lower=[-2.0, 0.0],
        nodes=[41, 5],
        names=["q", "p"],
        gain=np.eye(2),
        bounds=[0.1, 0.1],
        target=zoo.goal(0.0, 1.03),
        delta=0.1,
        steps=1,
    )
    full = sdhj.solve(problem, sdhj.HopfLax(), progress=False)
    smaller = dataclasses.replace(full, tubes=read_only(full.tubes + 0.4))
    row = compare(full, smaller, [{"p": 0.25}, {}])[0]
    assert row.hausdorff == pytest.approx((0.4, 0.4), abs=1e-12)  # 0.4 is 16 of the finer nodes, 0.1 / 4 apart
    # 21 and 13 nodes inside, each stands for one of the 40 cells
    assert (row.reference, row.inner) == pytest.approx((21 / 40, 13 / 40))
    back = compare(smaller, full, [])[0]
    assert back.depth == pytest.approx(0.37)  # at the node q = 1
    assert back.outside == pytest.approx(8 / 40)


def test_what_does_not_fit_is_refused(tables):
    full = tables[0]
    other = sdhj.solve(sdhj.arm_case_study(nodes=9, steps=1), progress=False)
    with pytest.raises(ValueError, match="different problems"):
        compare(full, other, [])
    for cut, said in (({"pz": 0.0}, "q1, q2, px, py"), ({"px": 1.0}, "from -0.36 to 0.36")):
        with pytest.raises(ValueError, match=said):
            compare(full, full, [cut])
    with pytest.raises(ValueError, match="least one axis free"):
        compare(full, full, [{"q1": 0.0, "q2": 0.0, "px": 0.0, "py": 0.0}])
