"""How far disks are from the skeleton of the arm, its two links without their thickness."""

import math

import numpy as np

from sdhj.kernels.compiling import kernel

POINT = np.finfo(np.float64).tiny  # a segment whose squared length is below it counts as a point


@kernel(nogil=True)
def joints(cos_1, sin_1, cos_2, sin_2, lengths, elbow, tip):
    """Positions (M, 2) of the joints of arms whose links point to (cos, sin), each (M,); both are overwritten."""
    for m in range(cos_1.size):
        elbow[m, 0], elbow[m, 1] = lengths[0] * cos_1[m], lengths[0] * sin_1[m]
        tip[m, 0], tip[m, 1] = elbow[m, 0] + lengths[1] * cos_2[m], elbow[m, 1] + lengths[1] * sin_2[m]


@kernel(nogil=True)
def skeleton_distances(elbow, tip, centres, radii, out):
    """`sdhj.arm.workspace.skeleton_clearance` into out (M,), overwritten."""
    for m in range(out.size):
        out[m] = np.inf
        for d in range(radii.size):
            distance = _to_skeleton(elbow[m, 0], elbow[m, 1], tip[m, 0], tip[m, 1], centres[m, d, 0], centres[m, d, 1])
            if not distance - radii[d] >= out[m]:  # so that a NaN comes out as one
                out[m] = distance - radii[d]


@kernel(inline="always")
def _to_skeleton(elbow_x, elbow_y, tip_x, tip_y, x, y):
    """Distance from one point to the links of one arm."""
    least = np.inf
    for link in range(2):
        from_x, from_y = (0.0, 0.0) if link == 0 else (elbow_x, elbow_y)
        to_x, to_y = (elbow_x, elbow_y) if link == 0 else (tip_x, tip_y)
        along_x, along_y = to_x - from_x, to_y - from_y
        square = along_x * along_x + along_y * along_y
        foot = ((x - from_x) * along_x + (y - from_y) * along_y) / (square if square > POINT else np.inf)
        s = min(max(foot, 0.0), 1.0)
        dx, dy = from_x + s * along_x - x, from_y + s * along_y - y
        distance = math.sqrt(dx * dx + dy * dy)
        if not distance >= least:  # so that a NaN comes out as one
            least = distance
    return least
