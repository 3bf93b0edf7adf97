"""One input joins a tube: its reach-avoid set, united with those before, and its marks."""

import numpy as np
from numba import prange

from sdhj.kernels.compiling import kernel


@kernel(parallel=True)
def add_input(tube, mask, reach, wall, wall_at, level, bit):
    """tube = min(tube, max(reach, wall, level)); set `bit` of `mask` where that maximum is <= 0. In place.

    tube, mask, reach : (R, B), the grid in rows.
    wall : (r, B); its row `wall_at[i]` belongs to row i of the grid. level : (R,), one value for each row.
    """
    for r in prange(tube.shape[0]):
        _add_row(tube[r], mask[r], reach[r], wall[wall_at[r]], level[r], bit)


@kernel()
def _add_row(tube, mask, reach, wall, level, bit):
    for i in range(reach.size):
        value = reach[i] if reach[i] > wall[i] else wall[i]
        value = value if value > level else level
        mask[i] |= bit if value <= 0 else np.uint8(0)
        tube[i] = value if value < tube[i] else tube[i]
