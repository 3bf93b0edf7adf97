"""Derivatives of formulas: no difference within a box exceeds their intervals, and functions that jump have none."""

import numpy as np
import pytest

from sdhj.formulas.derivative import derivative
from sdhj.formulas.formula import Formula
from sdhj.formulas.graph import leaf
from sdhj.formulas.gridded import gridded

WIND = gridded(np.array([[0.0, 1.0, 0.5], [2.0, -1.0, 0.0]]), [-1.0, -1.0], [2.0, 1.0])
STEADY = {
    "waves": lambda p: np.sin(p[:, 0]) * np.cos(2 * p[:, 1]) + np.tanh(p[:, 2]) + np.arctan(p[:, 0] - p[:, 1]),
    "exponentials": lambda p: (
        np.exp(-(p**2).sum(axis=1)) + np.log(5 + 2 * p[:, 0]) + (5 + 2 * p[:, 1]) ** 1.5 + (1 - 2 * p[:, 2]) ** 3
    ),
    "kinks": lambda p: np.abs(p[:, 0] - p[:, 1]) + np.maximum(p[:, 0], p[:, 2]) * np.clip(p[:, 1], -0.5, 0.5),
    "lengths": lambda p: np.hypot(p[:, 0], p[:, 1]) + np.linalg.norm(p, axis=1) + np.sqrt(p[:, 1] ** 2 + p[:, 2] ** 2),
    "meeting": lambda p: np.where(p[:, 0] > 0.5, p[:, 0] - 0.5, np.where(p[:, 0] < -0.5, p[:, 0] + 0.5, 0.0)),
    "meeting twice": lambda p: np.where(~(p[:, 0] * p[:, 2] < p[:, 1]), p[:, 0] * p[:, 2], p[:, 1]),
    "turns": lambda p: (
        np.cos((p[:, 0] + np.pi) % (2 * np.pi) - np.pi - p[:, 1]) + np.sin(-((4 * p[:, 2]) % (2 * np.pi)))
    ),
    "table": lambda p: WIND(p[:, :2]) * p[:, 2],
    "other axis": lambda p: np.where(p[:, 2] > 0, p[:, 0], -p[:, 0]) + np.floor(p[:, 2]) * p[:, 1],
}
JUMPS = {
    "floor": lambda p: np.floor(p[:, 0]),
    "sign": lambda p: np.sign(p[:, 0]) * p[:, 1],
    "mod": lambda p: (p[:, 0] + 1) % 1.0,
    "truth": lambda p: (p[:, 0] > 0) * 2.0,
    "where": lambda p: np.where(p[:, 0] > 0, p[:, 0] + 0.1, p[:, 0]),
    "equal": lambda p: np.where(p[:, 0] == 0, 1.0, 0.0),
    "a side that jumps": lambda p: np.where(np.floor(p[:, 0]) + 0.5 < p[:, 1], p[:, 1], np.floor(p[:, 0]) + 0.5),
    "cut": lambda p: np.arctan2(p[:, 0], -1.0 - p[:, 1] ** 2),
    "root": lambda p: np.sqrt(np.abs(p[:, 0])),
    "pole": lambda p: np.where(p[:, 0] == 0, 0.0, 1 / p[:, 0]),
    "logarithm": lambda p: np.log(np.abs(p[:, 0]) + p[:, 0]),
}


def slopes_of(function, low, high, k=0):
    """Bounds on the magnitude of the derivative along axis k over boxes (M, 3): (M,)."""
    formula = Formula.read("it", lambda p, t: function(p), 3, "t")
    steep = Formula(tuple(derivative(formula.outputs, leaf("x", k))), 3)
    least, most = steep.bounds(low, high, (0.0, 0.0))
    return np.maximum(-least, most)


@pytest.mark.parametrize("name", STEADY)
def test_no_difference_exceeds_the_bound(name, rng):
    """Boxes of all sizes, many with a kink on a face; pairs of points near and far, by plain NumPy."""
    centre = rng.choice([0.0, 0.5, -0.5], (4000, 3)) + rng.normal(0, 0.3, (4000, 3)) * rng.integers(0, 2, (4000, 3))
    half, function = 10.0 ** rng.uniform(-3, -0.3, centre.shape), STEADY[name]
    for k in range(2 if name == "other axis" else 3):
        steep = slopes_of(function, centre - half, centre + half, k)
        assert np.isfinite(steep).mean() > 0.95
        for _ in range(20):
            one = centre + half * rng.uniform(-1, 1, centre.shape)
            other = one.copy()
            other[:, k] = centre[:, k] + half[:, k] * rng.choice([-1.0, 1.0, 0.0, 0.01], len(half))
            off = np.abs(function(one) - function(other)) - steep * np.abs(one - other)[:, k]
            assert off.max() <= 1e-13


def test_bounds_are_close_in_small_boxes(rng):
    centre = rng.uniform(0.6, 1.0, (500, 3))
    for name, function in STEADY.items():
        if name in ("table", "other axis"):
            continue
        steep = slopes_of(function, centre - 1e-7, centre + 1e-7)
        step = np.array([1e-5, 0.0, 0.0])
        found = np.abs(function(centre + step) - function(centre - step)) / 2e-5
        kink = np.abs(steep - found) > 1e-4 * (1 + steep)
        assert kink.mean() < 0.01, name


@pytest.mark.parametrize("name", JUMPS)
def test_there_is_none_where_a_function_jumps(name):
    low, high = np.array([[-1e-6, -0.3, -0.1]]), np.array([[1e-9, 0.4, 0.1]])
    assert np.isinf(slopes_of(JUMPS[name], low, high))
    beside = np.array([0.4, 0.0, 0.0])
    assert np.isfinite(slopes_of(JUMPS[name], low + beside, high + beside))
