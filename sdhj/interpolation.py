"""Multilinear interpolation on a grid, in any number of dimensions."""

import numpy as np
from numba import prange

from sdhj.compiling import kernel

OUTSIDE = np.inf  # what a level-set function is worth where nothing is known: outside every set


@kernel(inline="always")
def locate(coordinate, lower, spacing, nodes, periodic):
    """Return (left node, right node, weight of the right node) of a coordinate on one axis.

    The left node is -1 where a bounded axis does not hold the coordinate (or it is NaN). A millionth
    of a cell of slack absorbs the rounding of coordinates computed as lower + i * spacing.
    """
    position = (coordinate - lower) / spacing
    if periodic:
        base = np.floor(position)
        weight = position - base
        left = int(base - nodes * np.floor(base / nodes))
        right = left + 1 if left + 1 < nodes else 0
        if not (0.0 <= weight <= 1.0):  # NaN or infinity
            return -1, -1, 0.0
        return left, right, weight
    if not (-1e-6 <= position <= nodes - 1 + 1e-6):
        return -1, -1, 0.0
    left = min(max(int(position), 0), nodes - 2)
    return left, left + 1, min(max(position - left, 0.0), 1.0)


@kernel()
def corners(point, lower, spacing, shape, periodic, index, weight):
    """Fill the 2^ndim flat node indices and weights around a point; return False where it is off the grid.

    `index` (2^ndim,) int64 and `weight` (2^ndim,) float64 are modified in place.
    """
    index[0] = 0
    weight[0] = 1.0
    count = 1
    for axis in range(point.size):
        left, right, fraction = locate(point[axis], lower[axis], spacing[axis], shape[axis], periodic[axis])
        if left < 0:
            return False
        for c in range(count):
            index[count + c] = index[c] * shape[axis] + right
            weight[count + c] = weight[c] * fraction
            index[c] = index[c] * shape[axis] + left
            weight[c] *= 1.0 - fraction
        count *= 2
    return True


@kernel(parallel=True)
def interpolate(values, points, lower, spacing, shape, periodic):
    """Interpolate flat grid `values` (size,) at `points` (M, ndim); `OUTSIDE` off the grid. Returns (M,) float64."""
    count = points.shape[0]
    ndim = points.shape[1]
    out = np.empty(count)
    chunk = 1024  # one pair of scratch rows for each chunk of points
    for block in prange((count + chunk - 1) // chunk):
        index = np.empty(1 << ndim, np.int64)
        weight = np.empty(1 << ndim)
        start = np.int64(block) * chunk
        for m in range(start, min(start + chunk, count)):
            if corners(points[m], lower, spacing, shape, periodic, index, weight):
                total = 0.0
                for c in range(index.size):
                    if weight[c] > 0.0:  # an infinite value beside the point must not make a NaN
                        total += weight[c] * values[index[c]]
                out[m] = total
            else:
                out[m] = OUTSIDE
    return out


@kernel(nogil=True)
def wrap(points, lower, upper, periodic):
    """Turn the coordinates of periodic axes to where they are between the ends, upper left out; `points` is written."""
    for m in range(points.shape[0]):
        for axis in range(points.shape[1]):
            if periodic[axis]:
                turned = lower[axis] + (points[m, axis] - lower[axis]) % (upper[axis] - lower[axis])
                points[m, axis] = turned if turned < upper[axis] else lower[axis]  # rounding may reach the end
