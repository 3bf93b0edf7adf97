"""What no grid can be made of is named; what one can be made of gives the nodes it always did."""

import numpy as np

from sdhj import Grid


def test_numbers_of_any_kind_make_the_same_grid():
    plain = Grid([0.0, -1.0], [1.0, 2.0], [5, 6], [True, False])
    arrays = Grid(np.array([0, -1]), np.array([1, 2], np.float32), np.array([5, 6]), np.array([True, False]))
    assert arrays == plain and Grid((0, -1), (1, 2), (5.0, 6.0), (True, False)) == plain


def test_points_are_those_of_a_mesh():
    grid = Grid([0.0, -1.0, 3.0], [1.0, 1.0, 4.0], [5, 6, 7], [True, False, False])
    mesh = np.meshgrid(*(grid.nodes(axis) for axis in range(3)), indexing="ij")
    assert np.array_equal(grid.points(), np.stack(mesh, axis=-1).reshape(-1, 3))
    assert Grid([0.0] * 4, [1.0] * 4, [10**6] * 4).size == 10**24
