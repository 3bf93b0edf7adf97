"""Isosurfaces: closed, oriented, of second order."""

import numpy as np
import pytest
import surfaces

import sdhj


def ball(nodes: int, radius: float = 0.61) -> tuple[np.ndarray, list[np.ndarray]]:
    coordinates = [np.linspace(-1, 1, nodes), np.linspace(-1, 1, nodes), np.linspace(-1, 1, nodes + 2)]
    x, y, z = np.meshgrid(*coordinates, indexing="ij")
    return np.sqrt(x**2 + y**2 + z**2) - radius, coordinates


def edges_of(triangles: np.ndarray) -> np.ndarray:
    """How often each directed edge occurs, and its opposite: rows of two counts."""
    keys = [tuple(map(tuple, np.round(t, 9))) for t in triangles]
    directed: dict = {}
    for a, b, c in keys:
        for edge in ((a, b), (b, c), (c, a)):
            if edge[0] != edge[1]:
                directed[edge] = directed.get(edge, 0) + 1
    return np.array([(count, directed.get(edge[::-1], 0)) for edge, count in directed.items()])


def volume(triangles: np.ndarray) -> float:
    """By the divergence theorem; positive where the normals point out."""
    return float(np.einsum("ti,ti->", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])) / 6)


@pytest.mark.slow
def test_isosurface_of_a_ball():
    errors = []
    for nodes in (15, 29):
        triangles = surfaces.isosurface(*ball(nodes))
        assert np.abs(np.linalg.norm(triangles, axis=2) - 0.61).max() < (2 / (nodes - 1)) ** 2  # h^2 / 8 * 3 / r
        area = np.linalg.norm(surfaces.normals(triangles), axis=1).sum() / 2
        assert area == pytest.approx(4 * np.pi * 0.61**2, rel=0.05)
        errors.append(abs(volume(triangles) - 4 / 3 * np.pi * 0.61**3))
        counts = edges_of(triangles)
        assert (counts[:, 0] == counts[:, 1]).all()  # every edge is passed once each way
    assert errors[1] < errors[0] / 3  # second order: a quarter


def test_a_block_closes_what_leaves_it():
    grid = sdhj.Grid([0, 0, 0], [1, 1, 1], [6, 7, 8])
    values = np.float32(grid.points()[:, 2] - 0.5).reshape(grid.shape)
    triangles = surfaces.isosurface(*surfaces.block(grid, values, (0, 1, 2), (0, 0, 0)))
    assert volume(triangles) == pytest.approx(0.5, abs=5 * surfaces.CAP)
    counts = edges_of(triangles)
    assert (counts[:, 0] == counts[:, 1]).all()
