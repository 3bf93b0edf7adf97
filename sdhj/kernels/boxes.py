"""The maximum of a grid function over the same interval around every node of one axis (`sdhj.problem.boxes`)."""

from typing import NamedTuple

import numpy as np
from numba import prange

from sdhj.kernels import FloatArray
from sdhj.kernels.compiling import FEW, kernel
from sdhj.kernels.stages import raise_to

STRETCH = 1024  # nodes in one loop: long enough to vectorise, short enough for the first-level cache
SHORT = 8  # nodes behind an axis: for fewer a loop of their own costs more than to find each one's neighbours


class Leaves(NamedTuple):
    """Maxima of some functions over intervals along an axis: leaf i is of function parent[i] and interval which[i].

    parent, which (leaves,). For each interval and node taps (intervals, n, 2, 4), nodes around the two ends: before,
    left, right, behind; weight (intervals, n, 2, 2), share of the right node and factor of the limited second
    difference; between (intervals, n, 2), first node within the interval and the one behind the last, periodic axes
    unwrapped. point (intervals,), whether the two ends are one.
    """

    parent: FloatArray
    which: FloatArray
    taps: FloatArray
    weight: FloatArray
    between: FloatArray
    point: FloatArray


@kernel(inline="always")
def _limited(a, b):
    """The lesser of two second differences; nothing where their signs differ."""
    lesser = a if abs(a) < abs(b) else b
    return lesser if a * b > 0 else a * 0


@kernel(inline="always")
def _between_nodes(m, a, b, p, weight, bend):
    """The value between a and b; m and p are those of the nodes next to them."""
    rise = b - a
    line = a + weight * rise
    return line if bend == 0 else line + bend * _limited(rise - (a - m), (p - b) - rise)


@kernel()
def _end(out, values, taps, weight, start, stop):
    m, a = values[taps[0], start:stop], values[taps[1], start:stop]
    b, p = values[taps[2], start:stop], values[taps[3], start:stop]
    share, bend = weight[0], weight[1]
    if bend == 0:
        for i in range(out.size):
            out[i] = a[i] + share * (b[i] - a[i])
    else:
        for i in range(out.size):
            out[i] = _between_nodes(m[i], a[i], b[i], p[i], share, bend)


@kernel()
def over_interval(out, values, start, stop, node, kind, leaves, room):
    """out = max of values[:, start:stop] over interval `kind` of a node; values (n, B), room is scratch like `out`."""
    taps, weight = leaves.taps[kind, node], leaves.weight[kind, node]
    _end(out, values, taps[0], weight[0], start, stop)
    if not leaves.point[kind]:
        _end(room, values, taps[1], weight[1], start, stop)
        raise_to(out, room)
        for other in range(leaves.between[kind, node, 0], leaves.between[kind, node, 1]):
            raise_to(out, values[other % values.shape[0], start:stop])


@kernel()
def _one_by_one(out, values, kind, leaves, raised):
    """As `over_interval`, of all nodes of an axis with few behind it; raised: and what is in `out`."""
    for node in range(out.shape[0]):
        taps, weight = leaves.taps[kind, node], leaves.weight[kind, node]
        for i in range(out.shape[1]):
            most = out[node, i] if raised else values.dtype.type(-np.inf)
            for end in range(1 if leaves.point[kind] else 2):
                m, a = values[taps[end, 0], i], values[taps[end, 1], i]
                b, p = values[taps[end, 2], i], values[taps[end, 3], i]
                value = _between_nodes(m, a, b, p, weight[end, 0], weight[end, 1])
                most = value if value > most else most
            if not leaves.point[kind]:
                for other in range(leaves.between[kind, node, 0], leaves.between[kind, node, 1]):
                    value = values[other % values.shape[0], i]
                    most = value if value > most else most
            out[node, i] = most


@kernel(parallel=True, least=FEW)
def maximum_of_intervals(values, leaves, raised, out):
    """out[i] = leaf i of values (functions, A, n, B); out (leaves, A, nodes, B). raised: and what was in `out`."""
    count, before, nodes, after = out.shape
    chunks = (after + STRETCH - 1) // STRETCH
    for task in prange(count * before * chunks):
        row, chunk = np.int64(task) // chunks, np.int64(task) % chunks
        leaf, a = row // before, row % before
        kind, source, target = leaves.which[leaf], values[leaves.parent[leaf], a], out[leaf, a]
        start, stop = after * chunk // chunks, after * (chunk + 1) // chunks
        found, room = np.empty(stop - start, values.dtype), np.empty(stop - start, values.dtype)
        if after < SHORT:
            _one_by_one(target, source, kind, leaves, raised)
        for node in range(0 if after < SHORT else nodes):
            if raised:
                over_interval(found, source, start, stop, node, kind, leaves, room)
                raise_to(target[node, start:stop], found)
            else:
                over_interval(target[node, start:stop], source, start, stop, node, kind, leaves, room)
