"""Functions that the library reads, and their text that the checker reads: both say the same of boxes, and truly."""

import numpy as np
import pytest
import zoo

import sdhj
from sdhj.certified.check.formulas import read
from sdhj.problem.describing import arrays_of, described


def assigned(p, t):
    out = np.zeros_like(p)
    out[:, 0] = 2.0 * p[:, 1]
    out[:, 1] = np.full(len(p), 0.4)
    return (out[:, 0] - out[:, 1]) / (1.5 + np.sin(p[:, 2]))


WIND = sdhj.gridded(np.arange(60.0).reshape(5, 4, 3) % 7, [-2.0, -2.0, -2.0], [1.0, 1.5, 2.0])
FUNCTIONS = {
    "disk": lambda p, t: np.hypot(p[:, 0] - 0.2 * t, p[:, 1] - 0.8) - 0.4,
    "where": lambda p, t: np.where(p[:, 0] > 0.5, np.sin(p[:, 1]) ** 2, p[:, 2] ** 3 - p[:, 1] * p[:, 0]),
    "other": lambda p, t: np.tanh(p[:, 0]) + np.log(5 + p[:, 1]) + np.arcsin(p[:, 2] / 4) + np.floor(p[:, 0]),
    "table": lambda p, t: WIND(p) - 2.0,
    "assigned": assigned,
    "direction": lambda p, t: (
        np.where((r := np.hypot(p[:, 0], p[:, 1])) > 0, p[:, 0] / r, 0.0) - np.where(p[:, 2] > 0.1, np.log(p[:, 2]), t)
    ),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_sample_is_inside(name, rng):
    """By both libraries, which agree."""
    problem = zoo.chase(unsafe=[sdhj.UnsafeSet((0, 1, 2), FUNCTIONS[name])])
    told, arrays = described(problem)["formulas"]["functions"]["unsafe 0"], arrays_of(problem)
    checked = read("unsafe 0", told, 3, 1, lambda number, axes: arrays[f"tables/{number}"])
    centre = rng.uniform(-2, 2, (3000, 3))
    half = rng.uniform(0, 0.2, centre.shape) * rng.choice([0.0, 1.0, 5.0], centre.shape, p=[0.2, 0.7, 0.1])
    low, high = checked.bounds(centre - half, centre + half, (0.2, 0.3))
    ours = problem.unsafe[0].level_set.bounds(centre - half, centre + half, (0.2, 0.3))
    known = np.isfinite(low[:, 0])
    assert known.mean() > 0.9
    for one, other in zip((low[:, 0], high[:, 0]), ours, strict=True):
        assert np.isclose(one, other, rtol=1e-9, atol=1e-9)[known].mean() > 0.99
    for _ in range(20):
        t, share = rng.uniform(0.2, 0.3), rng.choice([-1.0, 1.0, 0.3, 0.0], centre.shape)
        with np.errstate(all="ignore"):  # of what `where` does not take
            value = FUNCTIONS[name](centre + half * share, t)
        slack = 1e-14 * (1.0 + np.abs(value))  # the samples' own rounding
        assert ((low[:, 0] <= value + slack) & (value - slack <= high[:, 0]))[known].all()
