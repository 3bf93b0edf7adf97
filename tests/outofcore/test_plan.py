"""How much the largest slab of a plan takes."""

import numpy as np
import pytest

import sdhj
from sdhj import outofcore


def drifting(method, *, periodic):
    """A plan of a line of 240 nodes in slabs of 8, closed or with ends."""
    problem = sdhj.ReachAvoidProblem(
        grid=sdhj.Grid([0.0, 0.0], [2.4 if periodic else 2.39, 1.0], [240, 15], [periodic, False], ends="wall"),
        dynamics=sdhj.Dynamics([[1.0]], [[0.3, 0.0]], np.eye(2), [0.1, 0.1]),
        target=sdhj.TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 1.2, p[:, 1] - 0.5) - 0.3),
        unsafe=[sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 0.6, p[:, 1] - 0.5) - 0.2, name="disk")],
        delta=0.3,
        steps=2,
    )
    return outofcore.planned(problem, method, (0, 8))


@pytest.mark.parametrize("method", [sdhj.HJI(scheme=sdhj.Scheme(frame="fixed")), sdhj.HopfLax()], ids=["hji", "lax"])
def test_the_largest_slab_is_stated(method):
    """Where a grid ends the halo does too, but for the slabs in the middle."""
    ended, closed = drifting(method, periodic=False), drifting(method, periodic=True)
    assert ended.halo == closed.halo
    assert 8 < ended.halo < 100  # more than a slab, and no window is the grid
    assert outofcore.task_bytes(ended) == outofcore.task_bytes(closed)
