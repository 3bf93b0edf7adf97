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
"""

from collections.abc import Iterator

import numpy as np

from sdhj.kernels import FloatArray
from sdhj.problem.boxes import Nodes, maximum_over_boxes
from sdhj.problem.grid import Grid


def maximum_over_paths(
    grid: Grid, values: FloatArray, boxes: FloatArray, interpolation: str, wanted: Nodes | None = None
) -> Iterator[tuple[int, FloatArray]]:
    """Yield (j, max of `values` over x + all boxes of a path): boxes (P, 2, L, ndim), lower and upper corners.

    Between two boxes the corners move on straight lines, within the smallest box that contains both.
    """
    found: dict[int, FloatArray] = {}
    for low, high in zip(np.minimum(boxes[:-1, 0], boxes[1:, 0]), np.maximum(boxes[:-1, 1], boxes[1:, 1]), strict=True):
        for j, most in maximum_over_boxes(grid, values, low, high, interpolation, wanted):
            found[j] = np.maximum(found.get(j, most), most)
    yield from found.items()
