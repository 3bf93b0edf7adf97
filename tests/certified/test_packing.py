"""Sets that are packed along another axis while they are made are the same sets."""

from dataclasses import replace

import fleet
import numpy as np
import pytest
from zoo import car

import sdhj
from sdhj.certified import packing


def forklift():
    """Which has to pass a gate that moves."""
    return replace(fleet.FLEET["forklift"]().problem(), steps=3)


def turned():
    """x, z, pitch, a rate: two axes that no velocity reads, and two others."""
    grid = sdhj.Grid([-1.0, -2.0, -1.0, 0.0], [1.0, 2.0, 1.0, 6.0], [5] * 4, [True, False, False, False])
    drift = lambda q, u: np.stack([np.sin(q[:, 2]), q[:, 3] - 3.0, 0.3 * q[:, 3] - 0.9, u[0] + 0.0 * q[:, 0]], axis=1)  # noqa: E731
    target = sdhj.TargetSet((0, 1), lambda p, t: np.maximum(np.abs(p[:, 0]), np.abs(p[:, 1])) - 0.6)
    return sdhj.ReachAvoidProblem(grid, sdhj.Dynamics([[-4.0], [0.0], [4.0]], drift), target, [], 0.2, 4)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("problem", "cells", "axis"),
    [
        (car, (18, 70, 13), 1),
        (forklift, (24, 20, 21), 0),
        (turned, (17, 20, 7, 9), 1),
        (lambda: replace(car(), target=None, steps=None), (30, 20, 13), 0),
    ],
)
def test_the_sets_are_the_same(monkeypatch, problem, cells, axis):
    problem, method = problem(), sdhj.Certified(cells=cells, parts=3)
    asked, tables, plain = list[int](), list[sdhj.certified.CertifiedTable](), packing.packed_axis

    def packed(*told):
        asked.append(plain(*told))
        return asked[-1]

    monkeypatch.setattr(packing, "packed_axis", packed)
    tables.append(sdhj.solve(problem, method, progress=False, play=False))
    assert asked == [axis]
    monkeypatch.setattr(packing, "packed_axis", lambda grid, axes, *told: len(axes) - 1)
    tables.append(sdhj.solve(problem, method, progress=False, play=False))
    assert np.array_equal(tables[0].index, tables[1].index) and np.array_equal(tables[0].pool, tables[1].pool)
    assert 0.01 < tables[0].fraction() < 0.99


def test_where_sets_stay_as_they_are():
    """The last axis itself, safe ends, few cells, or velocities that read every axis."""
    every = np.array([False, True, False])
    for problem, cells, depends in (
        (car(), (20, 20, 13), every),
        (car(), (20, 15, 13), ~every),
        (car(), (20, 20, 13), every | ~every),
        (fleet.FLEET["crossing"]().problem(), (20, 20, 13), ~every),
    ):
        assert packing.packed_axis(problem.grid, sdhj.Certified(cells=cells).axes(problem), depends) == 2
    assert packing.packed_axis(car().grid, sdhj.Certified(cells=(20, 20, 13)).axes(car()), ~every) == 1
