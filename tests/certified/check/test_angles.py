"""Angles that jump by a turn: bounds on either side of the jump, and what is certified of a robot with them.

A distance on a circle is written as |mod(x + pi, 2 pi) - pi|, by arctan2, or by a cosine, which does not jump.
"""

import numpy as np
import pytest
import zoo

import sdhj
from sdhj.certified.check import verify
from sdhj.certified.check.formulas import read
from sdhj.formulas.formula import Formula
from sdhj.formulas.text import written

TURN = 2 * np.pi


def by_mod(x):
    return np.abs(np.mod(x + np.pi, TURN) - np.pi)


def by_arctan2(x):
    return np.abs(np.arctan2(np.sin(x), np.cos(x)))


FUNCTIONS = {
    "mod": lambda p, t: by_mod(p[:, 0] - t) - 0.35,
    "arctan2": lambda p, t: by_arctan2(p[:, 0] - t) - 0.35,
    "two angles": lambda p, t: np.minimum(by_mod(p[:, 0] - t), by_mod(p[:, 1] + 2 * t)) - 0.2,
    "bearing": lambda p, t: np.abs(np.arctan2(p[:, 1] - t, p[:, 0] - 0.1)) ** 2 - 0.3,
    "angle of an angle": lambda p, t: np.hypot(by_mod(np.arctan2(p[:, 1], p[:, 0]) - t), 0.2 * p[:, 0]) - 0.3,
    "both": lambda p, t: np.mod(p[:, 0], 0.7) * np.arctan2(p[:, 1], p[:, 0]) + np.mod(-p[:, 1] * t, 1.3),
    "the middle of a lap": lambda p, t: np.abs(np.mod(p[:, 0], 0.5) - 0.25) + 0.0 * t,
    "other periods": lambda p, t: np.mod(p[:, 0], -0.7) + np.mod(p[:, 1], 2.0 + 0.1 * p[:, 0]),
}


def both(name):
    """The bounds of prover and checker: functions of boxes (M, 2) and a time's ends, which return (2, M)."""
    formula = Formula.read(name, FUNCTIONS[name], 2, "t")
    lines = written(formula.outputs, [])
    checked = read(name, {"coordinates": 2, "parameters": 1, "lines": lines}, 2, 1, lambda number, axes: None)
    return formula.bounds_by_branch, lambda *given: [end[:, 0] for end in checked.bounds(*given)]


def test_the_prover_trusts_no_library_of_the_system(monkeypatch):
    """Its angles are its own: NumPy's could be wrong."""
    low, high = np.array([[-1.0, -0.1], [-1.0, 0.1]]), np.array([[-0.5, 0.1], [-0.9, 0.2]])
    formula = Formula.read("bearing", lambda p, t: np.abs(np.arctan2(p[:, 1], p[:, 0])) - 3.0, 2, "t")
    formula.bounds_by_branch(low, high, (0.0, 0.0))  # compiled with NumPy as it is
    monkeypatch.setattr(np, "arctan2", lambda y, x: np.full(np.broadcast(y, x).shape, 0.5))
    least, most = formula.bounds_by_branch(low, high, (0.0, 0.0))
    np.testing.assert_allclose(least, np.pi - np.array([np.atan(0.2), np.atan(0.2 / 0.9)]) - 3.0, rtol=1e-12)
    np.testing.assert_allclose(most, np.pi - np.array([0.0, np.atan(0.1)]) - 3.0, rtol=1e-12)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_value_is_on_a_side_of_the_jump(name, rng):
    middle, times = rng.uniform(-4, 4, (1000, 2)), (-0.3, -0.2)
    middle[::5] = rng.choice([0.0, 0.5, 1.0, 2.0, -1.0, -2.0], (200, 1)) * [np.pi / 2, 0.0]
    width = 10.0 ** rng.uniform(-12, 0, middle.shape)
    low, high = middle - width * rng.integers(0, 2, middle.shape), middle + width * rng.integers(0, 2, middle.shape)
    found = [bounds(low, high, times) for bounds in both(name)]
    assert np.isfinite(found).mean() > 0.95
    for _ in range(40):
        share = rng.choice([0.0, 1.0, rng.random()], middle.shape)
        points, t = np.clip(low + share * (high - low), low, high) + 0.0, rng.choice([*times, -0.25])
        values = FUNCTIONS[name](points, t)
        rounded = 1e-14 * (1 + np.abs(values))
        for least, most in found:
            assert not ((values < least - rounded) | (most + rounded < values)).any()


@pytest.mark.parametrize("name", ["mod", "arctan2", "two angles"])
def test_half_a_turn_away_is_not_near(name):
    low, times = np.array([[np.pi - 0.1, 2.0], [np.pi + 0.01, 2.0]]), (0.0, 0.05)
    for bounds in both(name):
        least, most = bounds(low, low + 0.1, times)
        assert (least > 1.0).all() and (most - least < 0.21).all()


def robot(distance):
    """A dial that turns at 1 rad/s at most, past a sector that turns as well."""
    return zoo.line(
        grid=sdhj.Grid([0.0], [TURN], [36], periodic=[True]),
        dynamics=sdhj.Dynamics([[-1.0], [0.0], [1.0]], lambda q, u: 0 * q + u, [[1.0]], [0.1]),
        target=sdhj.TargetSet((0,), lambda p, t: distance(p[:, 0] - np.pi, 0.5)),
        unsafe=[sdhj.UnsafeSet((0,), lambda p, t: distance(p[:, 0] - 0.4 * t - 1.0, 0.35), name="sector")],
        delta=0.15,
        steps=12,
    )


@pytest.mark.slow
def test_however_angles_are_written_as_much_is_certified(tmp_path):
    written_as = [
        lambda x, most: by_mod(x) - most,
        lambda x, most: by_arctan2(x) - most,
        lambda x, most: np.cos(most) - np.cos(x),
    ]
    tables = [sdhj.solve(robot(one), sdhj.Certified(cells=[200])) for one in written_as]
    shares = [table.fraction(start=0) for table in tables]
    assert shares == pytest.approx([shares[-1]] * 3, abs=0.01) and shares[-1] > 0.5
    for table in tables[:2]:
        table.save(tmp_path / "angles.npz")
        assert verify(tmp_path / "angles.npz", progress=False).ok
