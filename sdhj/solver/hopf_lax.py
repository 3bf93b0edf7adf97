"""The Hopf-Lax formula for velocities that do not depend on the state.

Under input u_j the state at the end of an interval of length tau ranges over a box around its start, so game 3 of
App. A.3 has the closed form

    Phi_j(x) = max over y in [x + tau a_j, x + tau b_j] of s(y),

a_j, b_j the extreme velocities on each axis. On a grid the maximum is taken axis by axis: over the two ends of the
interval, by interpolation, and over the nodes between them. At a wall the interval is clipped, as the velocity is.
Between two nodes, at the fraction t of the way, s is taken

* "linear"ly. Those points then hold the maximum of the interpolant on each axis; going axis by axis can only raise the
  result (interpolating a maximum bounds the maximum of interpolants), so where s is convex between nodes, as a
  signed distance to the outside mostly is, sets come out too small, by a tenth on coarse grids;
* "limited": linearly, less t (1 - t) / 2 times the lesser of the second differences at the two nodes, or nothing where
  their signs differ. That is third order where s is smooth, and across a kink the correction never goes beyond the
  kink, as a polynomial through more nodes does: for s with one kink between two nodes the result lies between the line
  and s itself. It is not monotone: raising s at one node may lower the result beside it, by a part of what was added.

With an interval of width 0 the same operator shifts a function, which the moving frame of `schemes.Scheme` needs.

Where a component of v moves several axes, what it adds is a segment, and the state ranges over the Minkowski sum of a
box and K segments, a zonotope:

    Phi_j(x) = max over y in [x + tau a_j, x + tau b_j] of s_K(y),   s_k(y) = max over |c| <= 1 of s_k-1(y + c tau h_k),

s_0 = s. Of a segment its ends are looked at, and where it crosses planes of nodes, by interpolation. That is exact but
for interpolation, which is not one-sided then: between two crossings the interpolant may be higher, along a ridge, and
what is interpolated again is lower, in a bowl.
"""

from collections.abc import Iterator
from typing import NamedTuple

from sdhj.common.remembering import FloatArray
from sdhj.problem.boxes import Maxima, Nodes, maxima, maximum_over_segments
from sdhj.problem.grid import Grid


class Moved(NamedTuple):
    """The displacements to which each of L inputs leads: the sum of a box and of K segments from -half to half."""

    low: FloatArray  # (L, ndim), the box's lower corner relative to the state, in the axes' units
    high: FloatArray  # (L, ndim), its upper corner
    halves: FloatArray  # (L, K, ndim)


def maxima_over_sets(
    grid: Grid, values: FloatArray, moved: Moved, interpolation: str, wanted: Nodes | None = None
) -> Iterator[Maxima]:
    """Yield the maxima of `values` over x + the set `moved` of each input, successive inputs at a time.

    The maximum is taken over the segments first, at all nodes.
    """
    if not moved.halves.any():
        yield from maxima(grid, values, moved.low, moved.high, interpolation, wanted)
        return
    # with walls for ends, so that nobody is out of danger past a safe end after the segments, half of the way
    count, lasting = len(moved.low), grid.wider([(0, 0)] * grid.ndim)
    together = count if (moved.halves == moved.halves[0]).all() else 1
    for first in range(0, count, together):
        raised, end = maximum_over_segments(grid, values, moved.halves[first], interpolation), first + together
        for some in maxima(lasting, raised, moved.low[first:end], moved.high[first:end], interpolation, wanted):
            yield some._replace(first=first + some.first)
