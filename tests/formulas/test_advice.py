"""What is said of a function that cannot be read helps: written as advised, it is read, and says the same."""

import math

import numpy as np
import pytest
from numba import njit

import sdhj
from sdhj.formulas.formula import Formula

BUFFER = np.zeros(5)  # which NumPy made, not the function
KEPT = []  # of an earlier call
POINTS = np.array([[-1.5], [-0.3], [0.4], [1.2], [2.5]])


def masked(p, t):
    out = p[:, 0] * 1.0
    out[p[:, 0] < 0] = -2 * p[p[:, 0] < 0, 0]
    return out


def unmasked(p, t):
    out = p[:, 0] * 1.0
    return np.where(p[:, 0] < 0, -2 * p[:, 0], out)


def filled(p, t):
    place = np.zeros(2)
    place[0] = float(t)
    return p[:, 0] - place[0]


def written(p, t):
    p[:, 0] -= 1.0
    return p[:, 0]


def copied(p, t):
    p = p.copy()
    p[:, 0] -= 1.0
    return p[:, 0]


def into_plain(p, t):
    np.abs(p[:, 0], out=BUFFER)
    return BUFFER - 1.0


def converted(p, t):
    BUFFER[:] = p[:, 0]
    return BUFFER


def kept(p, t):
    KEPT.append(p[:, 0])
    return KEPT[0]


def deciding(p, t):
    return p[:, 0] - 1.0 if t > 0.5 else p[:, 0] + 1.0


def by_math(p, t):
    return p[:, 0] - math.sin(t)


def by_choice(p, t):
    return np.choose((p[:, 0] > 0).astype(int), [p[:, 0], 2 * p[:, 0]])


@njit
def compiled(x):
    return np.abs(x) - 1.0


def looped(p, t):
    out = np.zeros(len(p))
    for row, (x,) in enumerate(p):
        out[row] = x - 1.0 if x > 0 else -x
    return out


def truths(p, t):
    return np.where(~(t > 0.5), p[:, 0], -p[:, 0])


def many(p, t):
    return np.mean(np.abs(p - np.repeat([-1.0, 0.0, 1.0], 30_000)), axis=1)


LEVELS = {
    "a decision": ("use np.where", deciding, lambda p, t: np.where(t > 0.5, p[:, 0] - 1.0, p[:, 0] + 1.0)),
    "a mask": ("out = np.where\\(mask, x, out\\)", masked, unmasked),
    "math": ("np.sin, np.floor", by_math, lambda p, t: p[:, 0] - np.sin(t)),
    "a plain number": ("np.array\\(\\[x, y\\]\\)", filled, lambda p, t: p[:, 0] - np.array([t, 0.0])[0]),
    "an argument": ("points = points.copy", written, copied),
    "out=": ("return a new", into_plain, lambda p, t: np.abs(p[:, 0]) - 1.0),
    "compiled": ("its py_func attribute", lambda p, t: compiled(p[:, 0]), lambda p, t: compiled.py_func(p[:, 0])),
    "shapes": (
        "np.full_like\\(other, number\\)",
        lambda p, t: np.sum(np.array([p[:, 0], 1.0]), axis=0),
        lambda p, t: np.sum(np.array([p[:, 0], np.full_like(p[:, 0], 1.0)]), axis=0),
    ),
    "a plain array": ("np.stack.*np.zeros", converted, lambda p, t: np.stack([p[:, 0]])[0]),
    "kept": ("compute it anew", kept, lambda p, t: p[:, 0]),
    "not": ("write t <= 1 in place", truths, lambda p, t: np.where(t <= 0.5, p[:, 0], -p[:, 0])),
    "float32": (
        "write .astype\\(float\\)|compute with float64",
        lambda p, t: p[:, 0].astype(np.float32),
        lambda p, t: p[:, 0].astype(float),
    ),
    "whole": (
        "np.floor or np.trunc",
        lambda p, t: p[:, 0].astype(int) - 0.5,
        lambda p, t: np.trunc(p[:, 0]) - 0.5,
    ),
    "a list times": (
        "np.array\\(list\\) \\* number",
        lambda p, t: [1.0] * np.where(t > 0.5, 2, 1) * p[:, 0],
        lambda p, t: np.array([1.0]) * np.where(t > 0.5, 2, 1) * p[:, 0],
    ),
    "a truth as a number": (
        "np.where\\(condition, 1.0, 0.0\\)",
        lambda p, t: p[:, 0] - np.stack([p[:, 0] > 0, p[:, 0] > 1]).T @ np.array([True, True]),
        lambda p, t: p[:, 0] - np.where(p[:, 0] > 0, 1.0, 0.0),
    ),
    "isnan": (
        "np.where\\(divisor > 1e-3, number / divisor, other\\)",
        lambda p, t: np.nan_to_num(1.0 / np.maximum(p[:, 0], 0.1), nan=2.0),
        lambda p, t: np.where(np.maximum(p[:, 0], 0.1) > 1e-3, 1.0 / np.maximum(p[:, 0], 0.1), 2.0),
    ),
    "argmin": (
        "np.min and np.max",
        lambda p, t: np.take_along_axis(np.hstack([p, -p]), np.argmin(np.hstack([p, -p]), axis=1)[:, None], 1)[:, 0],
        lambda p, t: np.min(np.hstack([p, -p]), axis=1),
    ),
    "digitize": (
        "np.where\\(x >= edge, 1.0, 0.0\\)",
        lambda p, t: np.digitize(p[:, 0], [0.0, 1.0]) - 0.5,
        lambda p, t: np.where(p[:, 0] >= 0.0, 1.0, 0.0) + np.where(p[:, 0] >= 1.0, 1.0, 0.0) - 0.5,
    ),
    "choose": ("use np.where", by_choice, lambda p, t: np.where(p[:, 0] > 0, 2 * p[:, 0], p[:, 0])),
    "copysign": (
        "np.where\\(b < 0, -abs\\(a\\), abs\\(a\\)\\)",
        lambda p, t: np.copysign(2.0, p[:, 0]),
        lambda p, t: np.where(p[:, 0] < 0, -abs(2.0), abs(2.0)),
    ),
    "solve": (
        "by hand, or outside",
        lambda p, t: p[:, 0] - np.linalg.solve(np.array([[2.0 + 0 * t]]), np.array([1.0]))[0],
        lambda p, t: p[:, 0] - 1.0 / 2.0,
    ),
    "arcsinh": (
        "arcsinh\\(x\\) is np.log",
        lambda p, t: np.arcsinh(p[:, 0]),
        lambda p, t: np.log(p[:, 0] + np.sqrt(p[:, 0] ** 2 + 1)),
    ),
    "sinc": (
        "np.where\\(x != 0, np.sin",
        lambda p, t: np.sinc(p[:, 0]),
        lambda p, t: np.where(p[:, 0] != 0, np.sin(np.pi * p[:, 0]) / (np.pi * p[:, 0]), 1),
    ),
    "average": (
        "np.sum\\(weights \\* x, axis=1\\) / np.sum\\(weights\\)",
        lambda p, t: np.average(np.hstack([p, 2 * p]), axis=1, weights=np.array([1.0, 3.0])),
        lambda p, t: np.sum(np.array([1.0, 3.0]) * np.hstack([p, 2 * p]), axis=1) / np.sum(np.array([1.0, 3.0])),
    ),
    "piecewise": (
        "np.select\\(conditions, values\\)",
        lambda p, t: np.piecewise(p[:, 0], [p[:, 0] < 0, p[:, 0] >= 0], [-1.0, 1.0]),
        lambda p, t: np.select([p[:, 0] < 0, p[:, 0] >= 0], [-1.0, 1.0]),
    ),
    "linspace": (
        "np.linspace\\(0.0, 1.0, count\\) \\* end",
        lambda p, t: p[:, 0] - np.sum(np.linspace(0.0, t, 4)),
        lambda p, t: p[:, 0] - np.sum(np.linspace(0.0, 1.0, 4) * t),
    ),
    "apply_along_axis": (
        "np.array\\(\\[f\\(row\\) for row in points\\]\\)",
        lambda p, t: np.apply_along_axis(lambda row: row[0] - 1.0, 1, p),
        lambda p, t: np.array([(lambda row: row[0] - 1.0)(row) for row in p]),
    ),
    "select": (
        "compare them first",
        lambda p, t: np.select([np.where(p[:, 0] > 0, 1, 0)], [p[:, 0]], 2.0),
        lambda p, t: np.select([np.where(p[:, 0] > 0, 1, 0) > 0], [p[:, 0]], 2.0),
    ),
    "a loop that decides": (
        "is wrapped, .* sdhj.BlackBox\\(looped",
        looped,
        sdhj.BlackBox(looped, slope=1.0, rate=0.0),
    ),
    "operations": (
        "sdhj.gridded",
        many,
        lambda p, t: sdhj.gridded(many(np.arange(-4.0, 5.0)[:, None], 0.0), [-4.0], [1.0])(p),
    ),
}


OTHERWISE = {
    "not": "~True is -2 to Python, which is true: that is why it is refused",
    "float32": "single precision rounds",
    "select": "NumPy refuses it, too",
    "shapes": "NumPy refuses it, too",
}


@pytest.mark.parametrize("name", LEVELS)
def test_what_is_advised_is_read_and_says_the_same(name):
    pattern, refused, advised = LEVELS[name]
    with pytest.raises(ValueError, match=pattern):
        Formula.read("level", refused, 1, "t")
    KEPT.clear()
    for t in (0.25, 1.0):
        found = Formula.read("level", advised, 1, "t")(POINTS, t)
        said = (advised if name in OTHERWISE else refused)(POINTS.copy(), t)
        np.testing.assert_allclose(found, said, rtol=1e-12, atol=1e-12)
