"""What no grid can be made of is named; what one can be made of gives the nodes it always did."""

import math

import numpy as np
import pytest

from sdhj import Grid


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"lower": ["a", 0]}, "axis 0 must have finite lower < upper, got ['a', 1]"),
        ({"lower": [0, "0"]}, "axis 1 must have finite lower < upper, got ['0', 1]"),
        ({"upper": [1, math.inf]}, "axis 1 must have finite lower < upper, got [0, inf]"),
        ({"upper": [10**400, 1]}, "axis 0 must have finite lower < upper"),
        ({"lower": -1}, "lower must be a sequence with one entry for each axis, for example a list, got -1"),
        ({"upper": None}, "upper must be a sequence"),
        ({"upper": np.array(1.0)}, "upper must be a sequence"),
        ({"shape": 9}, "shape must be a sequence with one entry for each axis, for example a list, got 9"),
        ({"shape": [9, "9"]}, "axis 1 has '9' nodes"),
        ({"shape": [9, math.nan]}, "axis 1 has nan nodes"),
        ({"shape": [9, 9.5]}, "axis 1 has 9.5 nodes"),
        ({"shape": [True, 9]}, "axis 0 has True nodes"),
        ({"shape": [9, 10**300]}, "a whole number of at most 1,000,000,000"),
        ({"periodic": True}, "periodic must be a sequence"),
        ({"periodic": ["no", True]}, "periodic[0] must be True or False, got 'no'"),
        ({"periodic": [True, 0]}, "periodic[1] must be True or False, got 0"),
        ({"names": 5}, "names must be a sequence"),
    ],
)
def test_what_does_not_fit_is_named(change, said):
    with pytest.raises(ValueError) as raised:
        Grid(**{"lower": [0, 0], "upper": [1, 1], "shape": [9, 9]} | change)
    assert said in str(raised.value) and len(str(raised.value)) < 600


def test_numbers_of_any_kind_make_the_same_grid():
    plain = Grid([0.0, -1.0], [1.0, 2.0], [5, 6], [True, False])
    arrays = Grid(np.array([0, -1]), np.array([1, 2], np.float32), np.array([5, 6]), np.array([True, False]))
    assert arrays == plain and Grid((0, -1), (1, 2), (5.0, 6.0), (True, False)) == plain


def test_points_are_those_of_a_mesh():
    grid = Grid([0.0, -1.0, 3.0], [1.0, 1.0, 4.0], [5, 6, 7], [True, False, False])
    mesh = np.meshgrid(*(grid.nodes(axis) for axis in range(3)), indexing="ij")
    assert np.array_equal(grid.points(), np.stack(mesh, axis=-1).reshape(-1, 3))
    assert Grid([0.0] * 4, [1.0] * 4, [10**6] * 4).size == 10**24
