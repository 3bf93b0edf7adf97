"""Multilinear interpolation on a grid, in any number of dimensions, and what compiled look-ups share with it."""

from typing import Any, NamedTuple

import numpy as np
from numba import prange

from sdhj.kernels.compiling import kernel

OUTSIDE = np.inf  # what a level-set function is worth where nothing is known: outside every set
SLACK = 1e-6  # cells beyond a wall that still count as on it: the rounding of lower + i * spacing
FAR = 1e9  # cells; beyond it a coordinate has too few digits left to place it in one


class Lattice(NamedTuple):
    """A grid as compiled code reads it: arrays (ndim,).

    What is looked up may be stored at some nodes only, along each axis at `extent` nodes from the node `first`.
    """

    lower: Any
    spacing: Any
    shape: Any
    periodic: Any
    least: Any  # coordinates past which a state is lost, through an unsafe end; infinite where there is none
    most: Any
    safe_ends: Any  # coordinates past which it is out of danger, through a safe end, below and above: (2 ndim,)
    first: Any
    extent: Any


@kernel()
def periodic_index(node, count):
    """node modulo count. A division is made only where it is needed: it costs as much as all the rest."""
    return node if 0 <= node < count else node % count


@kernel()
def locate(coordinate, axis, lattice):
    """(left, share): the node at or left of a coordinate along an axis of the lattice, and the weight of the next node.

    Beyond an end of a bounded axis, those of the end. Nodes of a periodic axis are to be taken modulo its shape.
    """
    # of finite coordinates: of NaN the node could be any number, so callers have to ask `on_grid` or be handed finite
    # ones
    position = (coordinate - lattice.lower[axis]) / lattice.spacing[axis]
    if lattice.periodic[axis]:
        left = int(np.floor(position))
    else:
        position = min(max(position, 0.0), lattice.shape[axis] - 1.0)
        left = min(int(position), lattice.shape[axis] - 2)
    return left, position - left


@kernel()
def on_grid(point, lattice):
    """Whether a point (ndim,) is finite and, to `SLACK` cells, between the ends of the lattice's bounded axes."""
    for axis in range(point.size):
        position = (point[axis] - lattice.lower[axis]) / lattice.spacing[axis]
        # Asked this way round, as comparisons with NaN are false.
        if not (abs(position) < FAR):
            return False
        if not lattice.periodic[axis] and not (-SLACK <= position <= lattice.shape[axis] - 1 + SLACK):
            return False
    return True


@kernel()
def nodes_around(point, axes, lattice, tiny, index, weight):
    """Write flat indices and weights of the nodes around a point on a subgrid (`axes`); returns how many nodes.

    index, weight (2^len(axes),) : overwritten. A weight below `tiny` is rounding: the point is on the other node.
    """
    index[0] = 0
    weight[0] = 1.0
    count = 1
    for axis in axes:
        nodes = lattice.shape[axis]
        left, right = locate(point[axis], axis, lattice)
        if right >= 1.0 - tiny:
            left += 1
            right = 0.0
        elif right < tiny:
            right = 0.0
        here = periodic_index(left - lattice.first[axis], nodes)
        there = periodic_index(left + 1 - lattice.first[axis], nodes)
        more = count
        # Each node so far becomes two, or stays one where the point is on a node.
        for c in range(count):
            start = index[c] * lattice.extent[axis]
            if right > 0.0:
                index[more] = start + there
                weight[more] = weight[c] * right
                more += 1
            index[c] = start + here
            weight[c] *= 1.0 - right
        count = more
    return count


@kernel()
def weighted(values, row, index, weight, count):
    """The sum of weight[c] * values[row, index[c]] over c < count, of `nodes_around`; values (rows, size)."""
    total = 0.0
    for c in range(count):
        total += weight[c] * values[row, index[c]]
    return total


@kernel(parallel=True)
def interpolate(values, points, lattice):
    """Grid values (1, size), flat, interpolated at points (M, ndim): (M,) float64; `OUTSIDE` off the grid."""
    count, ndim = points.shape
    out = np.empty(count)
    chunk = 1024  # one pair of scratch rows for each chunk of points
    for block in prange((count + chunk - 1) // chunk):
        index = np.empty(1 << ndim, np.int64)
        weight = np.empty(1 << ndim)
        axes = np.arange(ndim)
        start = np.int64(block) * chunk
        for m in range(start, min(start + chunk, count)):
            # Before `locate`, which must not be given what is not finite.
            if on_grid(points[m], lattice):
                out[m] = weighted(values, 0, index, weight, nodes_around(points[m], axes, lattice, 0.0, index, weight))
            else:
                out[m] = OUTSIDE
    return out


@kernel()
def into_period(x, lower, upper):
    """A coordinate x of a periodic axis, moved by whole turns into [lower, upper)."""
    past = x - lower
    if not 0.0 <= past < upper - lower:  # a division costs as much as all the rest
        past %= upper - lower
    return lower + past if lower + past < upper else lower  # rounding may reach the end


@kernel(nogil=True)
def wrap(points, lower, upper, periodic):
    """Move points (M, ndim) on periodic axes by whole turns into [lower, upper), in place."""
    for m in range(points.shape[0]):
        for axis in range(points.shape[1]):
            if periodic[axis]:
                points[m, axis] = into_period(points[m, axis], lower[axis], upper[axis])
