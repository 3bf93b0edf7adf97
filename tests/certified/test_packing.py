"""Sets that are packed along another axis while they are made are the same sets."""

from dataclasses import replace

import fleet
import numpy as np
import pytest
from zoo import car, truck

import sdhj
from sdhj.certified import packing


def forklift():
    """Which has to pass a gate that moves."""
    return replace(fleet.FLEET["forklift"]().problem(), steps=3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("problem", "cells", "axis"),
    [
        (car, (18, 70, 13), 1),
        (forklift, (24, 20, 21), 0),
        (lambda: truck(ends="unsafe", steps=4), (17, 20, 12, 7), 1),
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
