"""Functions read as graphs: what NumPy computes at random points, or a refusal that says what."""

import copy
import dataclasses
import functools
import inspect
import math
import operator
import re
import sys
import threading
import types
import warnings

import graphs
import numba
import numpy as np
import pytest
import scipy.spatial
import scipy.special
from awkward_functions import FUNCTIONS
from numpy import min as minimum_of
from numpy import zeros

from sdhj.formulas import arrays
from sdhj.formulas.arrays import NotTraced, installed
from sdhj.formulas.formula import Formula
from sdhj.formulas.graph import leaves
from sdhj.formulas.gridded import gridded
from sdhj.formulas.tracing import parameter, points_of, rows_for, traced

T, XP = 0.7, np
RNG = np.random.default_rng(0)
POINTS = np.concatenate(
    [
        RNG.uniform(-1.5, 1.5, (60, 2)),
        RNG.choice([-1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5], (40, 2)),
    ]
)
CENTRE, TURN = np.array([0.3, -0.2]), np.array([[0.6, -0.8], [0.8, 0.6]])
with warnings.catch_warnings(action="ignore"):
    MATRIX = np.matrix([[1.0, 2.0]])
MAP = gridded([[0.0, 1.0, 0.5], [2.0, -1.0, 0.25]], [-1.0, -1.0], [2.0, 1.0])


def nodes_of(function, axes=2, shape=()):
    return traced("f", function, 3, lambda rows: [points_of(axes, rows), parameter(0)], shape, True)[0]


def check(function, shape=(), undefined=0.9):
    """The graph is undefined, or what NumPy answers, at all points; undefined at some of them at most."""
    nodes = nodes_of(function, shape=shape)
    with np.errstate(all="ignore"):
        expected = np.asarray(function(POINTS.copy(), T), dtype=np.float64).reshape(len(POINTS), -1)
        found = graphs.values(nodes, POINTS, [T]).T
    assert np.isnan(found).mean() <= undefined
    np.testing.assert_allclose(found[~np.isnan(found)], expected[~np.isnan(found)], rtol=1e-12, atol=1e-12)
    return nodes


def refused(function, words, axes=2):
    with pytest.raises(NotTraced, match=words) as caught:
        nodes_of(function, axes)
    return str(caught.value)


def collected(p, t):
    hit, clear = np.zeros(len(p), dtype=bool), np.ones(len(p), dtype=bool)
    for radius in (0.5, 1.0):
        hit |= np.hypot(p[:, 0] - radius, p[:, 1]) < radius
        clear &= abs(p[:, 1]) > radius
    return np.where(hit, 1.0, np.where(clear, 2.0, t))


def written(p, t):
    out = np.zeros_like(p)
    out[:, 0] = p[:, 1]
    out[:, 1] += 2.0 * p[:, 0]
    out *= 3.0
    return out[:, 0] - out[:, 1]


def written_where(p, t):
    out = np.full(len(p), 2.0)
    out[p[:, 0] > 0.0] = -1.0
    return out * p[:, 1]


def written_truths(p, t):
    out = np.empty(len(p))
    out[:] = p[:, 0] > 0.0
    return out + out + (p[:, 1] > 0.0)


def written_out(p, t):
    out = np.empty(p.shape)
    np.multiply(p, 2.0, out=out)
    np.subtract(out, CENTRE, out=out)
    out[:, 0] **= 2
    return out.sum(axis=1)


def columns_first(p, t):
    out = np.zeros((2, len(p)))
    out[0] = p[:, 0] * t
    out[1, :] = np.cos(p[:, 1])
    return out.T.sum(axis=1)


def raveled_copy(p, t):
    turned = p.T * 2.0  # lies in memory as p does, so that ravel copies
    flat = turned.ravel()
    flat[:] = 5.0
    return turned[0]


def raveled_view(p, t):
    doubled = p * 2.0
    flat = doubled.ravel()
    flat[:] = 5.0
    return doubled[:, 0] + p[:, 1]


def counted_number(p, t):
    begin = t
    t += 1.0  # a number: `begin` is what it was
    total = p[0, 0] * 0.0
    before = total
    total += 1.0
    return p[:, 0] + begin + before + total


def einsum_view(p, t):
    out = np.stack([p, p + t], axis=1)
    np.einsum("mii->mi", out)[:] = 3.0  # a view of the diagonals
    return out.sum(axis=(1, 2))


def number_array(p, t):
    number = np.array(t)  # an array of no dimensions can be written into
    same = number
    same += 1.0
    chosen = np.where(t > 0.0, 1.0, 2.0)
    other = chosen
    other *= 3.0
    return p[:, 0] + number + chosen


def double_loop(p, t):
    return np.array([sum(abs(x) for x in row) + t for row in p])


def generated(p, t):
    return functools.reduce(np.minimum, (np.hypot(*(p - c).T) - 0.3 for c in ([0.0, 0.0], [1.0, t])))


def shallow(p, t):
    out = p[:, 0] * 1.0
    other = copy.copy(out)
    other[:] = 9.0
    return out + copy.deepcopy(out)


def links(p, t):
    frames = np.tile(np.eye(3), (len(p), 1, 1))
    for k in range(2):
        turn = np.repeat(np.eye(3)[None], len(p), axis=0)
        turn[:, 0, 0], turn[:, 0, 1] = np.cos(p[:, k]), -np.sin(p[:, k])
        turn[:, 1, 0], turn[:, 1, 1] = np.sin(p[:, k]), np.cos(p[:, k])
        turn[:, 0, 2] = 0.5
        frames = frames @ turn
    rest = np.broadcast_to(np.zeros(2), p.shape).copy()
    rest[:, 0] = frames[:, 1, 2]
    return frames[:, 0, 2] - rest[:, 0] + rest[:, 1]


class Disk:
    def __init__(self, radius):
        self.radius = radius

    def level(self, p, t):
        return np.hypot(p[:, 0], p[:, 1]) - self.radius

    __call__ = level


def moved(function):
    @functools.wraps(function)
    def wrapper(p, t):
        return function(p - CENTRE * t, t)

    return wrapper


def part(p, t, radius, *, sign=1.0):
    return sign * (np.linalg.norm(p, axis=1) - radius)


TRACE = {
    "arithmetic": lambda p, t: 2 * p[:, 0] - p[:, 1] / 3 + (1 - p[:, 0]) * +p[:, 1] - -t,
    "powers": lambda p, t: (
        p[:, 0] ** 2 + p[:, 1] ** 3 - abs(p[:, 0]) ** 1.5 + 2.0 ** p[:, 1] + p[:, 0] ** 0 + p[:, 1] ** 1
    ),
    "negative powers": lambda p, t: p[:, 0] ** -1 + p[:, 1] ** -2 + np.power(p[:, 0], -3.0),
    "powers by columns": lambda p, t: np.power(p, np.array([2, 3])).sum(axis=1) + np.float_power(abs(p[:, 0]), 2.5),
    "ufuncs that are made of others": lambda p, t: (
        np.sinh(p[:, 0]) + np.cosh(p[:, 1]) + np.expm1(p[:, 0]) + np.exp2(p[:, 1]) + np.fabs(t)
    ),
    "logarithms": lambda p, t: (
        np.log(3 + p[:, 0]) + np.log1p(p[:, 1] + 2) + np.log2(3 + p[:, 0]) + np.log10(4 + p[:, 1])
    ),
    "angles": lambda p, t: np.deg2rad(p[:, 0]) + np.degrees(p[:, 1]) + np.arctan2(p[:, 1] + 2, p[:, 0]),
    "floor": lambda p, t: np.floor(3 * p[:, 0]) + np.ceil(3 * p[:, 1]) + np.trunc(4 * p[:, 0]) + np.sign(p[:, 1]),
    "whole parts": lambda p, t: p[:, 0] // 0.1 + (p[:, 1] + 1) // 0.1 + 1 // (p[:, 0] + 2.1) - p[:, 1] // -0.3,
    "rounded": lambda p, t: (
        np.rint(p[:, 0]) + np.round(5 * p[:, 1]) + p[:, 0].round(1) + np.around(p, -1)[:, 1] + np.round(p[:, 0] / 0.3)
    ),
    "polynomials": lambda p, t: np.polyval([t, -2, 1], p[:, 0]) + np.poly1d([1, 0, 3])(p[:, 1]) + np.polyval([], t),
    "columns beside each other": lambda p, t: (
        np.c_[p, np.ones(len(p)), p[:, 0] * t].prod(axis=1)
        + p @ np.c_[[1, 2], [3, 4]][0]
        + np.c_[p[:, :, None], p[:, :, None] * t, p[:, ::-1, None]][:, 1, 2]
    ),
    "arrays behind each other": lambda p, t: np.r_[p.T, [p[:, 0] * t]].sum(axis=0) + np.r_[0.5, p[0, 0] * 0, [t]].sum(),
    "remainders": lambda p, t: p[:, 0] % 0.4 + np.mod(p[:, 1], -0.3) + np.fmod(p[:, 0], 0.4) + np.fmod(p[:, 1], -0.3),
    "wrapped": lambda p, t: (p[:, 0] - t + np.pi) % (2 * np.pi) - np.pi,
    "chosen": lambda p, t: np.where(p[:, 0] > 0, np.log(p[:, 0]), p[:, 1] ** 2),
    "chosen by number": lambda p, t: np.where(p[:, 0], 1.0, -1.0),
    "chosen whole": lambda p, t: np.where(p[:, 0] > 0, 1, -1) * 0.5 + np.where(p[:, 1] > 0, 2, 3),
    "select": lambda p, t: np.select([p[:, 0] > 1, p[:, 0] > 0], [p[:, 1], 2.0], default=t),
    "clip": lambda p, t: (
        np.clip(p[:, 0], -0.5, t) + p[:, 1].clip(0) + np.clip(p[:, 1], None, 0.2) + np.clip(p, 0, 1)[:, 0]
    ),
    "clip by names": lambda p, t: p[:, 0].clip(max=0.1) + p[:, 1].clip(min=-0.5, max=t),
    "interpolated": lambda p, t: np.interp(p[:, 0], [-1.0, -0.5, 0.0, 1.0], [2.0, 1e3, -3.0, 1.0]),
    "compared": lambda p, t: (
        (p[:, 0] > p[:, 1]) * 1.0 + (p[:, 0] >= 0.5) * 2.0 + (p[:, 1] < t) * 4.0 + (0.5 <= p[:, 1]) * 8
    ),
    "equal": lambda p, t: (p[:, 0] == 0.5) * 1.0 + (p[:, 1] != 0.5) * 2.0,
    "truths": lambda p, t: (((p[:, 0] > 0) & (p[:, 1] > 0) | ~(p[:, 0] < -1)) ^ (p[:, 1] < 0.3)) * 1.0,
    "truths added": lambda p, t: ((p[:, 0] > 0) + (p[:, 1] > 0)) * 1.0,
    "truths counted": lambda p, t: (p > 0).sum(axis=1) + np.sum(p > 0.5, axis=1) / 3 + sum([p[:, 0] > 0, p[:, 1] > 0]),
    "truths meant": lambda p, t: np.mean(p > 0, axis=1) + np.prod(p > 0, axis=1) + (p > 0).astype(float)[:, 0],
    "truths multiplied": lambda p, t: (p[:, 0] > 0) * (p[:, 1] > 0) + np.multiply(p[:, 0] > 0, 3),
    "truths in numbers": lambda p, t: (
        np.stack([p[:, 0] > 0, p[:, 1]], axis=1)[:, 0] + np.array([p[:, 0] > 0, p[:, 1]])[0]
    ),
    "numbers for truths": lambda p, t: np.logical_and(p[:, 0], p[:, 1] > 0) * 1.0 + np.logical_xor(p[:, 0], p[:, 1]),
    "truths collected": lambda p, t: collected(p, t) * 2.0,
    "any and all": lambda p, t: np.any(p > 1, axis=1) + 2.0 * (p > 0).all(axis=1) + np.any(p[:, :1], axis=1),
    "reduced truths": lambda p, t: (
        1.0 * np.logical_or.reduce(p[:, :1], axis=1) + np.logical_and.reduce([p[:, 0] > 0, p[:, 1] > 0])
    ),
    "sums": lambda p, t: (
        p.sum(axis=1) + np.prod(p, axis=-1) + np.mean(p, axis=1) + p.mean(1) + np.sum([p[:, 0], p[:, 1]], 0)
    ),
    "extremes": lambda p, t: np.max(p, axis=1) - p.min(axis=1) + np.ptp(p, axis=1) + np.amax(np.abs(p), axis=1),
    "unions": lambda p, t: np.min([p[:, 0], p[:, 1] ** 2, p[:, 0] * 0 + 0.2], axis=0),
    "unions reduced": lambda p, t: np.minimum.reduce([p[:, 0], p[:, 1]]) + np.maximum.reduce((p[:, 0], -p[:, 0])),
    "unions of what is defined": lambda p, t: np.fmin.reduce([p[:, 0], p[:, 1]]) + np.fmax.reduce(p, axis=1),
    "NumPy under another name": lambda p, t: XP.min([p[:, 0], p[:, 1]], axis=0) + XP.zeros(len(p)),
    "reduced": lambda p, t: np.add.reduce(p, axis=1) + np.minimum.reduce(p, axis=1),
    "kept dimensions": lambda p, t: (p / np.sum(abs(p), axis=1, keepdims=True) + p.max(axis=1, keepdims=1))[:, 0],
    "norms": lambda p, t: (
        np.linalg.norm(p - CENTRE, axis=1) + np.linalg.norm(p, 1, 1) + np.linalg.norm(p, np.inf, axis=-1)
    ),
    "norm of a list": lambda p, t: np.linalg.norm([p[:, 0], p[:, 1], p[:, 0] * 0 + t], axis=0),
    "hypot": lambda p, t: np.hypot(*(p - CENTRE).T) - 0.3,
    "matrices": lambda p, t: (p @ TURN)[:, 0] + p @ CENTRE + np.dot(p, CENTRE) + (TURN @ p.T)[1] + p.dot(TURN)[:, 1],
    "einsum": lambda p, t: np.einsum("ij,ij->i", p, p) + np.einsum("ij,mj,mi->m", TURN, p, p),
    "tensors": lambda p, t: np.tensordot(p, TURN, axes=([1], [0]))[:, 1] + np.tensordot(p, TURN, 1)[:, 0],
    "crossed": lambda p, t: np.linalg.norm(np.cross(np.column_stack([p, np.full(len(p), t)]), [0.5, 0.0, 1.0]), axis=1),
    "outer": lambda p, t: np.subtract.outer(p[:, 0], [0.0, 0.5]).min(axis=1) + np.inner(p, CENTRE),
    "differences": lambda p, t: np.diff(p, axis=1)[:, 0] + np.diff(np.hstack([p, p]), 2)[:, 1],
    "centres": lambda p, t: np.linalg.norm(p[:, None] - np.array([[0.0, 1.0], [0.5, t]])[None], axis=2).min(axis=1),
    "stacked": lambda p, t: np.stack([p[:, 1], np.full(len(p), t), np.zeros(len(p))], axis=1).sum(axis=1),
    "joined": lambda p, t: np.concatenate([p, p[:, :1] * t, np.ones((len(p), 1))], axis=1).prod(axis=1),
    "columns joined": lambda p, t: np.column_stack([p[:, 0], p[:, 1] ** 2]).sum(axis=1) + np.hstack([p, p])[:, 3],
    "transposed": lambda p, t: (
        np.array([p[:, 0], p[:, 1]]).T.max(axis=1) + p.transpose(1, 0)[0] + np.moveaxis(p, 0, 1)[1]
    ),
    "reshaped": lambda p, t: p.reshape(-1, 1, 2)[:, 0, 1] + p.reshape(len(p), 2)[:, 0] + np.squeeze(p[:, :1], axis=1),
    "moved along": lambda p, t: (
        np.roll(p, 1, axis=1)[:, 0] + np.flip(p, axis=1)[:, 1] + p[:, ::-1][:, 0] + np.take(p, [1], 1)[:, 0]
    ),
    "ellipsis": lambda p, t: (
        p[..., 0] + p[:, np.newaxis, 1][:, 0] + p[:, [1, 0]][:, 0] + p[:, np.array([True, False])][:, 0]
    ),
    "unpacked": lambda p, t: (lambda x, y: x * y)(*p.T) + operator.itemgetter(0)(p.T),
    "split": lambda p, t: np.split(p, 2, axis=1)[1][:, 0] + np.array_split(p, 2, axis=1)[0][:, 0],
    "diagonals": lambda p, t: np.diagonal(p[:, :, None] * np.eye(2), axis1=1, axis2=2).sum(axis=1),
    "broadcast": lambda p, t: np.broadcast_arrays(p[:, 0], t)[1] + np.broadcast_to(t, p.shape)[:, 1],
    "room": lambda p, t: (
        np.zeros(p.shape[0]) + np.ones_like(p[:, 0]) + np.full_like(p[:, 1], t) + np.full(len(p), 2) / 4
    ),
    "as arrays": lambda p, t: (
        np.asarray(p)[:, 0] + np.array(p, dtype=float)[:, 1] + np.ascontiguousarray(p.T)[0] + np.asarray(t)
    ),
    "types": lambda p, t: p[:, 0].astype(float) + p.astype(np.float64, copy=False)[:, 1] + (p[:, 0] > 0).astype(int),
    "truths of numbers": lambda p, t: p[:, 0].astype(bool) * 2.0,
    "is an array": lambda p, t: p[:, 0] if isinstance(p, np.ndarray) and isinstance(t, float) else -p[:, 0],
    "asks for shape": lambda p, t: p[:, 0] * p.ndim + p.shape[1] + np.ndim(t) + np.zeros(len(p), dtype=p.dtype),
    "time": lambda p, t: p[:, 0] * np.cos(t) + max(0.0, 1.0) * np.where(t > 0.5, t, 0.0),
    "from lists": lambda p, t: p[:, 0] - [0.5] + p[:, 1] * np.float32(0.25) + (p - [1, 2])[:, 1],
    "sums along": lambda p, t: np.cumsum(p, axis=1)[:, 1] + p.cumsum(-1)[:, 0] + np.cumsum(p > 0, axis=1)[:, 1] / 2,
    "spread": lambda p, t: (
        p.std(axis=1) + np.var(p * t, axis=-1, keepdims=True)[:, 0] + np.std([p[:, 0], p[:, 1], p[:, 0] * t], axis=0)
    ),
    "soft maximum": lambda p, t: np.logaddexp(5 * p[:, 0], p[:, 1]) + np.logaddexp(-40.0, p[:, 0] - t),
    "cube roots": lambda p, t: np.cbrt(p[:, 0]) + np.cbrt(1e9 * p[:, 1]) / 300 + np.cbrt(t),
    "quotient and rest": lambda p, t: divmod(p[:, 0], 0.3)[0] + np.divmod(p[:, 1], t)[1] + divmod(2.0, p[:, 1])[1],
    "steps": lambda p, t: np.heaviside(p[:, 0], 0.25) + np.heaviside(p[:, 1], 1),
    "NumPy's numbers": lambda p, t: np.float64(2.0) * p[:, 0] - np.int64(3) ** p[:, 1] + (np.float64(0.5) < p[:, 0]),
    "a truth of NumPy's": lambda p, t: (np.True_ & (p[:, 0] > 0) | np.bool_(False)) * 2.0,
    "einsum's view": einsum_view,
    "counted numbers": counted_number,
    "raised in errstate": lambda p, t: abs(1 / (p[:, 0] + 2)) if np.errstate(all="ignore") else None,
    "gridded": lambda p, t: MAP(p) + MAP(np.stack([p[:, 1], p[:, 0] * t], axis=1)),
    "single precision": lambda p, t: p[:, 0] * np.float32(0.1) + (p - CENTRE.astype(np.float32))[:, 1],
    **{
        f.__name__: f for f in (written, written_where, links, written_truths, written_out, columns_first, raveled_copy)
    },
    **{f.__name__: f for f in (raveled_view, number_array, double_loop, generated, shallow)},
    "method": Disk(0.5).level,
    "callable": Disk(0.25),
    "decorated": moved(Disk(0.5)),
    "partial": functools.partial(part, radius=0.5, sign=-1.0),
    "constant": lambda p, t: -np.ones(len(p)),
    "the argument itself": lambda p, t: p[:, 1],
    "a list": lambda p, t: [abs(x) + y for x, y in p],
}


@pytest.mark.parametrize("name", TRACE)
def test_a_graph_is_what_numpy_computes(name):
    check(TRACE[name])


def test_more_than_one_answer():
    def drift(p, t):
        return np.stack([t * np.cos(p[:, 1]), np.sin(p[:, 0]), np.full(len(p), 2.0)], axis=1)

    nodes = check(drift, (3,))
    assert leaves(nodes[:1], "x") == {1} and leaves(nodes[2:], "x") == set()
    check(lambda p, t: np.eye(2) * (1.0 + p[:, 0])[:, None, None], (2, 2))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_awkward_functions_are_refused_or_right(name):
    try:
        nodes, _ = traced(name, FUNCTIONS[name], 3, lambda rows: [points_of(2, rows)], (), True)
    except NotTraced as error:
        assert "awkward_functions.py, line" in str(error) or "differently" in str(error)
        return
    with np.errstate(all="ignore"), warnings.catch_warnings(action="ignore"):
        expected = np.asarray(FUNCTIONS[name](POINTS.copy()), dtype=np.float64)
        found = graphs.values(nodes, POINTS)[0]
    if name.startswith("cut"):  # an angle is pi or -pi at the cut: signs of zeros are not told apart
        found, expected = np.abs(found), np.abs(expected)
    np.testing.assert_allclose(found[~np.isnan(found)], expected[~np.isnan(found)], rtol=1e-12, atol=1e-12)


@functools.cache
def squared(t):
    return t**2


KEPT = {}
CALLS = []


def tries(p, t):
    try:
        return p[:, 0] if p[0, 0] > 0 else p[:, 1]
    except Exception:
        return p[:, 0]


def tries_shapes(p, t):
    try:
        return p @ np.ones(3)
    except ValueError:
        return p[:, 0]


def tries_keywords(p, t):
    try:
        return np.sum(p, axis=1, where=[True, False])
    except TypeError:
        return p[:, 0]


def probes(p, t):
    return p[:, 0] if hasattr(p, "flags") else p[:, 1]


def keeps(p, t):
    return KEPT.setdefault("p", p)[: len(p), 0]


def counts(p, t):
    CALLS.append(1)
    return p[:, 0] + len(CALLS)


def single(p, t):
    out = np.full(len(p), -1)
    out[p[:, 0] > 0] = 0.5
    return out


def counts_written(p, t):
    out = np.zeros_like((p > 0).sum(axis=1))
    out[:] = p[:, 0]
    return out


def argument_increased(p, t):
    p += 1.0
    return p[:, 1]


def view_written(p, t):
    p.T[0] = 1.0
    return p[:, 1]


def reduced_into(p, t):
    out = np.zeros(len(p))
    np.add.reduce(p, axis=1, out=out)
    return out


@numba.vectorize
def doubled(x):
    return 2.0 * x


@numba.njit
def compiled(p, t):
    return p[:, 0] - t


@dataclasses.dataclass
class Place:
    x: object
    y: object = 0.0  # with one field only, Python 3.13 returns what comparing that gives


DECISION, NUMBER = "a decision", "a plain number"
KIND, LONG = "numbers of type|with an answer of", "differently"
REFUSE = {  # what is advised for more is in `test_advice`
    "dataclasses compared": (lambda p, t: p[:, 0] * (Place(p[:, 0]) == Place(p[:, 0] + t)), DECISION),
    "chained comparison": (lambda p, t: np.where(0 < p[:, 0] < 1, 1.0, 2.0), DECISION),
    "and": (lambda p, t: p[:, 0] > 0 and p[:, 1] > 0, DECISION),
    "builtin min": (lambda p, t: min(p[0, 0], 1.0) + p[:, 0], DECISION),
    "builtin max": (lambda p, t: max(0, t) + p[:, 0], f"{DECISION}.*np.maximum"),
    "math trunc": (lambda p, t: math.trunc(t) + p[:, 0], NUMBER),
    "float": (lambda p, t: float(t) + p[:, 0], NUMBER),
    "round": (lambda p, t: round(t) + p[:, 0], NUMBER),
    "np.float64": (lambda p, t: np.float64(t) + p[:, 0], "plain number|conversion"),
    "text": (lambda p, t: p[:, 0] + float(f"{t:.1f}"), "a text of values"),
    "in": (lambda p, t: p[:, 0] + (0.0 in p), DECISION),
    "hash": (lambda p, t: p[:, 0] + {0.7: 1.0}.get(t, 2.0), DECISION),
    "range": (lambda p, t: p[:, 0] + sum(range(t)), NUMBER),
    "mask": (lambda p, t: p[p[:, 0] > 0][:, 0], r"mask.*np.where\(mask, x, out\)"),
    "degrees of freedom": (lambda p, t: p.var(axis=1, ddof=1), "numpy.var with axis, ddof"),
    "quotients written": (lambda p, t: np.divmod(p[:, 0], 0.3, out=(p[:, 0], p[:, 1]))[0], "divmod|more|too many|out"),
    "index": (lambda p, t: np.array([1.0, 2.0])[np.floor(p[:, 0])], "decision|conversion|index"),
    "written by a mask": (lambda p, t: operator.setitem(p.copy(), p[:, 0] > 0, 1.0), "writing where"),
    "where alone": (lambda p, t: np.where(p[:, 0] > 0)[0], "condition alone"),
    "complex": (lambda p, t: abs(p[:, 0] + 1j * p[:, 1]), "real numbers"),
    "imag": (lambda p, t: p[:, 0].imag, "attribute 'imag'"),
    "structured": (lambda p, t: p[:, 0] + np.zeros(1, "f8,f8"), "constant of type"),
    "objects": (lambda p, t: p[:, 0] + np.array([1.0], dtype=object), "constant of type"),
    "object array": (lambda p, t: np.array([p[:, 0], p[:, 1]], dtype=object)[0], "to object"),
    "matrix": (lambda p, t: (p * MATRIX)[:, 0], "matrix"),
    "masked": (lambda p, t: p[:, 0] + np.ma.array([1.0]), "MaskedArray"),
    "text constant": (lambda p, t: p[:, 0] == "a", "str"),
    "rounded counts": (lambda p, t: np.round((p > 0).sum(axis=1)) + p[:, 0], "numpy.round of int64"),
    "joined as text says": (lambda p, t: np.r_["-1", p[:, 0]], "a str in place of numbers"),
    "a plain array": (lambda p, t: np.vectorize(abs)(p[:, 0]), r"np.stack.*np.zeros\(\(len"),
    "single time": (lambda p, t: p[:, 0] + (np.float32([0.1]) * t), "float32"),
    "half": (lambda p, t: np.sqrt(p[:, 0] > 0) + p[:, 1], KIND),
    "whole exponent": (lambda p, t: np.where(p[:, 0] > 0, 1, 2) ** -1, KIND),
    "whole division": (lambda p, t: np.where(p[:, 0] > 0, 1, 2) // 2, KIND),
    "whole written": (single, "float64 to int64"),
    "count written": (counts_written, "float64 to int64"),
    "truths subtracted": (lambda p, t: (p[:, 0] > 0) - (p[:, 1] > 0), "boolean subtract|bool"),
    "truth negated": (lambda p, t: -(p[:, 0] > 0) * 1.0, "bool"),
    "bits": (lambda p, t: (p > 0).sum(axis=1) & 1, "bitwise_and"),
    "numbers and": (lambda p, t: p[:, 0] & p[:, 1], "bitwise_and"),
    "dtype": (lambda p, t: np.add(p[:, 0], 1.0, dtype=np.float32), "dtype"),
    "sum dtype": (lambda p, t: np.sum(p, 1, int), "numpy.sum"),
    "where=": (lambda p, t: np.sqrt(p[:, 0], where=p[:, 0] > 0), "numpy.sqrt with where"),
    "sum where": (lambda p, t: np.sum(p, axis=1, where=[True, False]), "numpy.sum with .*where"),
    "initial": (lambda p, t: np.max(p, axis=1, initial=0.0), "numpy.max with .*initial"),
    "casting": (lambda p, t: np.add(p[:, 0], 1.0, casting="unsafe"), "casting"),
    "axis out of range": (lambda p, t: np.sum(p, axis=2), "out of bounds"),
    "reduced into": (reduced_into, "numpy.add.reduce"),
    "out plain": (lambda p, t: np.add(p[:, 0], 1.0, out=np.zeros(7)), "plain array"),
    "einsum out": (lambda p, t: np.einsum("ij->i", p, dtype=int), "numpy.einsum"),
    "at": (lambda p, t: np.add.at(np.zeros(2), [0], p[0]), "numpy.add.at"),
    "accumulate": (lambda p, t: np.add.accumulate(p, axis=1)[:, 1], "add.accumulate"),
    "sort": (lambda p, t: np.sort(p, axis=1)[:, 0], "numpy.sort with axis"),
    "isnan": (lambda p, t: np.where(np.isnan(p[:, 0]), 1.0, 2.0), r"numpy.isnan; np.where\(divisor > 1e-3"),
    "divide where": (lambda p, t: np.divide(1.0, p[:, 0], where=p[:, 0] > 0), r"divide with where; np.where\(divisor"),
    "nearest": (lambda p, t: p[:, 0] * p.argmin(axis=1), "attribute 'argmin' of an array; np.min and"),
    "vectorize": (lambda p, t: np.vectorize(lambda x: x + 1)(p[:, 0]), "conversion"),
    "stack of different shapes": (lambda p, t: np.stack([p[:, 0], 0.0], axis=1)[:, 0], "shape; a .*; np.full_like"),
    "interp of what is traced": (lambda p, t: np.interp(0.5, p[0], [1.0, 2.0]) + p[:, 0], "numpy.interp"),
    "interp with left": (lambda p, t: np.interp(p[:, 0], [0, 1], [1, 2], left=0.0), "numpy.interp with left"),
    "mean of all": (lambda p, t: p[:, 0] - p[:, 0].mean(), LONG),
    "greatest of all": (lambda p, t: p[:, 0] - np.max(p), LONG),
    "rolled": (lambda p, t: np.roll(p[:, 0], 1), LONG),
    "rolled apart": (lambda p, t: p[:, 0] + (np.roll(p[:, 1], 1) - np.roll(p[:, 1], 2)), LONG),
    "less the first": (lambda p, t: p[:, 0] - p[0, 0], LONG),
    "backwards": (lambda p, t: p[::-1, 0], LONG),
    "numbered": (lambda p, t: p[:, 0] + np.arange(len(p)), LONG),
    "length": (lambda p, t: p[:, 0] + 1.0 / len(p), LONG),
    "random": (lambda p, t: p[:, 0] + np.random.default_rng().random(), LONG),
    "a generator's": (lambda p, t: p[:, 0] + RNG.random(), LONG),
    "a generator's rows": (lambda p, t: p[:, 0] + RNG.random(len(p)), LONG),
    "shuffled": (lambda p, t: RNG.permuted(p, axis=0)[:, 0], "conversion"),
    "product into": (lambda p, t: np.dot(p, CENTRE, np.zeros(7)), "numpy.dot"),
    "single room": (lambda p, t: np.full(len(p), np.float32(1.0)), "float32"),
    "copied into": (lambda p, t: np.copyto(np.zeros(len(p)), p[:, 0]), "numpy.copyto"),
    "not the module's": (lambda p, t: minimum_of([p[:, 0], p[:, 1]], axis=0), "conversion"),
    "not the module's room": (
        lambda p, t: operator.setitem(zeros(len(p)), 0, p[0, 0]),
        "decision|plain",
    ),
    "scipy": (lambda p, t: scipy.special.expit(p[:, 0]), ": expit"),
    "scipy distances": (lambda p, t: scipy.spatial.distance.cdist(p, [[0.0, 0.0]])[:, 0], "conversion"),
    "vectorised by Numba": (lambda p, t: doubled(p[:, 0]), "compiled code; let it stand"),
    "memory": (lambda p, t: p[:, 0] * np.shares_memory(p, p.T), "shares_memory"),
    "strides": (lambda p, t: p[:, 0] * p.strides[0], "attribute 'strides'"),
    "a generator": (lambda p, t: (x for x in p[:, 0]), "generator"),
    "cumsum of points": (lambda p, t: np.cumsum(p, axis=0)[:, 0], LONG),
    "nearest neighbour": (lambda p, t: np.linalg.norm(p[:, None] - p, axis=2).max(axis=1), LONG),
    "cached": (functools.lru_cache(lambda p, t: p[:, 0]), DECISION),
    "cached time": (lambda p, t: p[:, 0] + squared(t), DECISION),
    "split": (lambda p, t: np.concatenate([one - k for k, one in enumerate(np.array_split(p[:, 0], 2))]), LONG),
    "counts calls": (counts, LONG),
    "keeps": (keeps, "kept from another call|differently"),
    "tries": (tries, DECISION),
    "tries shapes": (tries_shapes, "matmul|mismatch|ValueError"),
    "tries keywords": (tries_keywords, "numpy.sum"),
    "probes": (probes, "attribute 'flags'"),
    "argument increased": (argument_increased, "writing into an argument"),
    "view written": (view_written, "writing into an argument"),
    "compiled": (compiled, "compiled code.*py_func"),
}


@pytest.mark.parametrize("name", REFUSE)
def test_what_is_not_known_is_refused_in_words(name):
    function, words = REFUSE[name]
    said = refused(function, words)
    assert "test_tracing.py, line" in said or LONG in said or name == "compiled"
    assert re.search(r"sdhj.BlackBox\([a-z_]+, reads=", said)


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (lambda p, t: p, r"\(M,\), got \(M, 2\)"),
        (lambda p, t: p[:, :1], r"got \(M, 1\)"),
        (lambda p, t: t, r"return shape \(M,\), got"),
        (lambda p, t: None, "return missing"),
        (lambda p, t: np.hypot(p[0], p[1]), r"column k is points\["),
    ],
)
def test_answers_of_another_shape_are_refused(function, words):
    with pytest.raises(ValueError, match=words):
        nodes_of(function)


def test_quotients_are_proved_around_zero_as_the_advice_says():
    box = np.full((1, 2), -0.5), np.full((1, 2), 0.5)
    kept_away = (
        lambda p, t: np.where(p[:, 1] > 1e-3, p[:, 0] / p[:, 1], 7.0),
        lambda p, t: p[:, 0] / np.maximum(np.square(p[:, 1]), 1e-3),
    )
    for function in kept_away:
        least, greatest = Formula.read("f", function, 2, "t").bounds(*box, (0.0, 1.0))
        np.testing.assert_allclose([least[0], greatest[0]], [-500.0, 500.0], rtol=1e-9)
    assert "divisor > 1e-3" in refused(lambda p, t: np.nan_to_num(p[:, 0] / p[:, 1]), "nan_to_num")


def test_errors_of_the_function_are_its_own_and_numpy_is_as_before():
    before = {name: getattr(np, name) for name in dir(np) if name != "__warningregistry__"}

    def broken(p, t):
        raise ZeroDivisionError("mine")

    with pytest.raises(ZeroDivisionError, match="mine"):
        nodes_of(broken)
    refused(lambda p, t: p[:, 0] if t > 0 else t, DECISION)
    assert {name: getattr(np, name) for name in before} == before
    assert nodes_of(lambda p, t: p[:, 0])[0].op == "x"


def test_modules_that_come_and_go_between_traces_are_the_users_too(monkeypatch, tmp_path):
    """A notebook imports and reloads: what the function calls is in another module at each trace, of the same name."""
    for sign in (1, -1, 1):
        helpers = types.ModuleType("helpers_of_a_robot")
        helpers.__file__ = str(tmp_path / "helpers_of_a_robot.py")
        exec(f"import numpy as np\ndef worse(a, b): return {sign} * np.max([a, b], axis=0)", vars(helpers))
        monkeypatch.setitem(sys.modules, helpers.__name__, helpers)
        check(lambda p, t, worse=helpers.worse: worse(p[:, 0], p[:, 1]), undefined=0.0)
        assert helpers.np is np


def test_a_trace_within_a_trace():
    inner = []

    def outer(p, t):
        inner.append(nodes_of(lambda q, s: np.min([q[:, 0], q[:, 1]], axis=0)))
        return np.max([p[:, 0], p[:, 1]], axis=0)

    check(outer)
    assert inner[0][0].op == "min"
    refused(lambda p, t: tries(p, nodes_of(TRACE["time"])), DECISION)
    refused(lambda p, t: p[:, 0] + (0.0 if nodes_of(lambda q, s: q[:, 0] + t) else 1.0), "kept from another call")


def test_threads_trace_at_the_same_time_and_others_do_not_notice():
    wrong, done = [], threading.Event()

    def trace():
        for _ in range(8):
            try:
                check(TRACE["room"])
            except Exception as error:
                wrong.append(error)

    def compute():
        while not done.is_set():
            if type(np.zeros(3)) is not np.ndarray or type(np.min([[1.0, 2.0]], axis=0)) is not np.ndarray:
                wrong.append("plain arrays")

    other, tracers = threading.Thread(target=compute), [threading.Thread(target=trace) for _ in range(2)]
    for thread in (other, *tracers):
        thread.start()
    for thread in tracers:
        thread.join()
    done.set()
    other.join()
    assert not wrong


def test_what_is_drawn_alike_each_time_is_a_constant():
    check(lambda p, t: p[:, 0] + np.random.default_rng(0).random())


def test_formulas_are_called_with_all_that_they_read():
    disk = Formula.read("disk", lambda p, t: np.hypot(p[:, 0] - t, p[:, 1]), 2, "t")
    several = (POINTS, T, T), (POINTS, [1.0]), (POINTS, np.array([1.0])), (POINTS, np.zeros((2, 0)))
    for given in [(POINTS,), (POINTS[:, :1], T), (POINTS[0], T), (np.hstack([POINTS, POINTS]), T), *several]:
        with pytest.raises(ValueError, match=r"2\) and 1 more"):
            disk(*given)
    assert disk(POINTS, np.array(T)).shape == (len(POINTS),)
    with pytest.raises(ValueError, match=r"\(M, 1\) alone; got"):
        nodes_of(lambda p, t: gridded([0.0, 1.0], [0.0], [1.0])(p[:, 0]))
    with pytest.raises(ValueError, match="disk is a function"):
        nodes_of(lambda p, t: disk(p[:, :1], t))


def test_rows_equal_no_other_length():
    assert rows_for(2) == 3 and rows_for(2, 4) == 5 and rows_for(3, 5, 2) == 6


def test_where_packages_are_installed_does_not_matter():
    """Those of another environment on the path, as of a system's Python, are no functions of the user's either."""
    for folder in ("/usr/lib/python3/dist-packages/numpy", "/elsewhere/lib/python3.11/site-packages/scipy"):
        assert installed(f"{folder}/some.py")
    assert installed(np.__file__) and installed(inspect.__file__) and not installed(__file__)


def test_a_process_may_make_any_number_of_formulas(monkeypatch):
    """The limit is of one function, and what is made of formulas does not count."""
    disk = Formula.read("disk", lambda p, t: np.hypot(p[:, 0], p[:, 1]) - 0.5, 2, "t")
    monkeypatch.setattr(arrays, "MOST_NODES", 40)
    for count in range(50):
        moved = Formula.traced("moved", lambda p, t, by=count: disk(p + by, t), 2)
        assert moved(np.full((1, 2), -count), 0.0) == -0.5
    with pytest.raises(NotTraced, match="more than 40 operations"):
        Formula.read("many", lambda p, t: sum(p[:, 0] * k for k in range(30)), 2, "t")
