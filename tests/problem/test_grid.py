"""What no grid can be made of is named; what one can be made of gives the nodes it always did."""

import math

import numpy as np
import pytest

from sdhj import Grid


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"lower": ["a", 0]}, "lower[0] must be a number, got 'a'"),
        ({"lower": [0, "0"]}, "lower[1] must be a number, got '0'"),
        ({"upper": [1, math.inf]}, "upper[1] must be finite, got inf"),
        ({"upper": [10**400, 1]}, "upper[0] must be a number below 1e308, got 1000"),
        ({"upper": [1e308, 1]}, "upper[0] must be at most 1e+300, got 1e+308"),
        ({"lower": [0, -1e308]}, "lower[1] must be at least -1e+300, got -1e+308"),
        ({"upper": [1, -1]}, "upper[1] must be greater than 0, got -1"),
        ({"lower": [0, 1]}, "upper[1] must be greater than 1, got 1"),
        ({"lower": -1}, "lower must be a sequence with one entry for each axis, for example a list, got -1"),
        ({"upper": None}, "upper must be a sequence"),
        ({"upper": np.array(1.0)}, "upper must be a sequence"),
        ({"shape": 9}, "shape must be a sequence with one entry for each axis, for example a list, got 9"),
        ({"shape": [9, "9"]}, "shape[1] must be a whole number from 5 to 1,000,000,000, got '9'"),
        ({"shape": [9, math.nan]}, "shape[1] must be a whole number from 5 to 1,000,000,000, got nan"),
        ({"shape": [9, 9.5]}, "shape[1] must be a whole number from 5 to 1,000,000,000, got 9.5"),
        ({"shape": [True, 9]}, "shape[0] must be a whole number from 5 to 1,000,000,000, got True"),
        ({"shape": [9, 10**300]}, "shape[1] must be a whole number from 5 to 1,000,000,000, got 1000"),
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
