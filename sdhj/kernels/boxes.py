"""The maximum of a grid function over the same interval around every node of one axis (`sdhj.problem.boxes`)."""

import numpy as np
from numba import prange

from sdhj.kernels.compiling import kernel
from sdhj.kernels.stages import raise_to

STRETCH = 1024  # nodes in one loop: long enough to vectorise, short enough for the first-level cache


@kernel(inline="always")
def _limited(a, b):
    """The lesser of two second differences; nothing where their signs differ."""
    lesser = a if abs(a) < abs(b) else b
    return lesser if a * b > 0 else a * 0


@kernel()
def _between_nodes(out, m, a, b, p, weight, bend):
    """out = the value between a and b; m and p are the nodes next to them."""
    if bend == 0:
        for i in range(out.size):
            out[i] = a[i] + weight * (b[i] - a[i])
    else:
        for i in range(out.size):
            rise = b[i] - a[i]
            out[i] = a[i] + weight * rise + bend * _limited(rise - (a[i] - m[i]), (p[i] - b[i]) - rise)


@kernel()
def _end(out, values, taps, weight, start, stop):
    m, a = values[taps[0], start:stop], values[taps[1], start:stop]
    b, p = values[taps[2], start:stop], values[taps[3], start:stop]
    _between_nodes(out, m, a, b, p, weight[0], weight[1])


@kernel(parallel=True)
def maximum_of_intervals(values, taps, weight, between, point, out):
    """out[a, i] = max of values[a] over the interval of node i; values, out (A, n, B), the rest as in `Intervals`."""
    before, n, after = values.shape
    chunks = (after + STRETCH - 1) // STRETCH
    for task in prange(before * n * chunks):
        row, chunk = np.int64(task) // chunks, np.int64(task) % chunks
        a, i = row // n, row % n
        start, stop = after * chunk // chunks, after * (chunk + 1) // chunks
        target = out[a, i, start:stop]
        _end(target, values[a], taps[i, 0], weight[i, 0], start, stop)
        if not point:
            other = np.empty(stop - start, values.dtype)
            _end(other, values[a], taps[i, 1], weight[i, 1], start, stop)
            raise_to(target, other)
            for node in range(between[i, 0], between[i, 1]):
                raise_to(target, values[a, node % n, start:stop])
