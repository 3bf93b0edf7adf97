"""Isosurfaces: closed, oriented, of second order; and drawn from a table."""

import numpy as np
import pytest
import surfaces
import zoo

import sdhj
from sdhj import plotting

THROUGH = (0.0, 0.0, 0.2, 0.2)


@pytest.fixture(scope="module")
def table() -> sdhj.LookupTable:
    return zoo.small_arm_table()


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
    assert errors[1] < errors[0] / 3  # second order: a quarter


def test_isosurface_is_closed_and_oriented():
    counts = edges_of(surfaces.isosurface(*ball(9)))
    assert (counts[:, 0] == counts[:, 1]).all()  # every edge is passed once each way


def test_isosurface_of_nothing():
    assert surfaces.isosurface(np.ones((3, 3, 3)), [np.arange(3.0)] * 3).shape == (0, 3, 3)


def test_a_block_closes_what_leaves_it():
    grid = sdhj.Grid([0, 0, 0], [1, 1, 1], [6, 7, 8])
    values = (grid.points()[:, 2] - 0.5).reshape(grid.shape)
    triangles = surfaces.isosurface(*surfaces.block(grid, values, (0, 1, 2), (0, 0, 0)))
    assert volume(triangles) == pytest.approx(0.5, abs=5 * surfaces.CAP)
    counts = edges_of(triangles)
    assert (counts[:, 0] == counts[:, 1]).all()


def test_draw_isosurface(table):
    figure = plotting.new_figure(4, 4, layout="none")
    ax = figure.add_subplot(projection="3d")
    surfaces.draw_isosurface(ax, table, through=THROUGH, within=3)
    (surface,) = [c for c in ax.collections if c.get_gid() == "surface"]
    assert len(surface.get_facecolor()) > 100
    assert ax.get_zlabel() == "$p_x$ (m)"
    empty = figure.add_subplot(projection="3d")
    surfaces.draw_isosurface(empty, table, through=THROUGH, start=3, within=0, axes=(2, 3, 0))
    assert len(empty.collections) <= 1
