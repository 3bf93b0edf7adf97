"""The maximum of a grid function over the same interval around every node of one axis (`sdhj.problem.boxes`)."""

from typing import NamedTuple

import numpy as np
from numba import prange

from sdhj.common.remembering import FloatArray
from sdhj.kernels.compiling import FEW, UNCOUNTED, kernel
from sdhj.kernels.stages import raise_to

STRETCH = 1024  # nodes in one loop: long enough to vectorise, short enough for the first-level cache
SHORT = 100  # fewer nodes than this behind an axis: turning rows, so that loops are long, pays
SIDE = 256  # nodes of rows that are turned together


class Leaves(NamedTuple):
    """What `maximum_of_intervals` computes: leaf i is the maximum of function parent[i] over the intervals which[i].

    An interval lies alike around every node of an axis.
    """

    # (leaves,)
    parent: FloatArray
    which: FloatArray
    # (intervals, n, 2, 4): for each node, at each end of the interval, the nodes before, left, right and behind
    taps: FloatArray
    # (intervals, n, 2, 2): at each end the share of the right node and the factor of the second difference
    weight: FloatArray
    # (intervals, n, 2): the first node within the interval and the one behind the last, not taken around
    between: FloatArray
    point: FloatArray  # (intervals,) bool: whether the two ends are one


@kernel(inline="always")
def _limited(a, b):
    """The limited second difference of a and b: the one of lesser magnitude, or 0 where their signs differ."""
    lesser = a if abs(a) < abs(b) else b
    return lesser if a * b > 0 else a - a  # not a * 0: that would be of double precision


@kernel(**UNCOUNTED)
def _interpolate_end(out, values, taps, weight, start, stop, raised):
    """out = a + share (b - a) + bend times the limited second difference, at one end of an interval, in place.

    a, b are rows start to stop of values (n, B). With `raised`, the greater of that and out.
    """
    m, a = values[taps[0], start:stop], values[taps[1], start:stop]
    b, p = values[taps[2], start:stop], values[taps[3], start:stop]
    share, bend = weight[0], weight[1]
    # Linear along the way: no second difference is computed.
    if bend == 0:
        for i in range(out.size):
            value = a[i] + share * (b[i] - a[i])
            out[i] = value if not raised or value > out[i] else out[i]
    else:
        for i in range(out.size):
            rise = b[i] - a[i]
            value = a[i] + share * rise + bend * _limited(rise - (a[i] - m[i]), (p[i] - b[i]) - rise)
            out[i] = value if not raised or value > out[i] else out[i]


@kernel(**UNCOUNTED)
def over_interval(out, values, start, stop, node, kind, leaves, raised):
    """out = the maximum of values[:, start:stop], (n, B), over interval `kind` around a node; if `raised`, or out."""
    taps, weight = leaves.taps[kind, node], leaves.weight[kind, node]
    _interpolate_end(out, values, taps[0], weight[0], start, stop, raised)
    if not leaves.point[kind]:
        _interpolate_end(
            out, values, taps[1], weight[1], start, stop, np.bool_(True)
        )  # True is a type of its own to Numba
        for other in range(leaves.between[kind, node, 0], leaves.between[kind, node, 1]):
            raise_to(out, values[other % values.shape[0], start:stop])


@kernel()
def _maxima_of_turned_rows(out, values, kind, leaves, raised):
    """Write to out (rows, nodes, B) the maximum of values (rows, n, B) over an interval around each node, in place."""
    # All rows are done side by side, as each has few nodes.
    rows, nodes, after = out.shape
    width = rows * after
    last = values.shape[1]
    # Nodes first, so that rows lie side by side and the loop over them vectorises.
    turned = np.empty((last, width), out.dtype)
    found = np.empty(width, out.dtype)
    for node in range(last if after == 1 else 0):  # a loop within the loop would take as long as the rest
        for row in range(rows):
            turned[node, row] = values[row, node, 0]
    for row in range(rows if after > 1 else 0):
        for node in range(last):
            for i in range(after):
                turned[node, row * after + i] = values[row, node, i]
    for node in range(nodes):
        over_interval(found, turned, np.int64(0), width, node, kind, leaves, np.bool_(False))
        for row in range(rows if after == 1 else 0):
            out[row, node, 0] = found[row] if not raised or found[row] > out[row, node, 0] else out[row, node, 0]
        for row in range(rows if after > 1 else 0):
            for i in range(after):
                value = found[row * after + i]
                out[row, node, i] = value if not raised or value > out[row, node, i] else out[row, node, i]


@kernel(parallel=True, least=FEW)
def maximum_of_intervals(values, leaves, raised, out):
    """out[i, a, node, b] = the maximum of values[parent[i], a, :, b] over interval which[i] around the node, in place.

    values (functions, A, n, B), out (leaves, A, nodes, B). With `raised`, the greater of that and out.
    """
    count, before, nodes, after = out.shape
    short = after < SHORT and before > 1
    each = max(1, SIDE // after) if short else 1  # rows at a time
    groups, chunks = (before + each - 1) // each, 1 if short else (after + STRETCH - 1) // STRETCH
    for task in prange(count * groups * chunks):
        group, chunk = np.int64(task) // chunks, np.int64(task) % chunks
        leaf = group // groups
        a = group % groups * each
        kind = leaves.which[leaf]
        parent = leaves.parent[leaf]
        if short:
            _maxima_of_turned_rows(out[leaf, a : a + each], values[parent, a : a + each], kind, leaves, raised)
        else:
            start, stop = after * chunk // chunks, after * (chunk + 1) // chunks
            for node in range(nodes):
                target = out[leaf, a, node, start:stop]
                over_interval(target, values[parent, a], start, stop, node, kind, leaves, raised)


@kernel(parallel=True, least=FEW)
def maximum_along(values, out):
    """out[a, b] = the greatest of values[a, :, b]; values (A, n, B), out (A, B), written in place."""
    before, nodes, after = values.shape
    for a in prange(before):
        # `Projected` takes the inner projection so, axis by axis (`ProjectedGames.inner_projection`).
        if after == 1:
            most = values[a, 0, 0]
            for node in range(1, nodes):
                most = values[a, np.uint64(node), 0] if values[a, np.uint64(node), 0] > most else most
            out[a, 0] = most
        else:
            for i in range(after):
                out[a, i] = values[a, 0, i]
            for node in range(1, nodes):
                raise_to(out[a], values[a, node])
