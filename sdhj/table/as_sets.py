"""The tube of a table on a grid as a level-set function, for `TargetSet.from_table`."""

from collections.abc import Callable, Sequence

import numpy as np

from sdhj.common.remembering import FloatArray
from sdhj.formulas.gridded import gridded
from sdhj.kernels.interpolation import SLACK
from sdhj.problem.grid import Grid
from sdhj.problem.problem import ReachAvoidProblem

ON_TIME = 1e-9  # of a sampling interval: what rounding may move a sampling time by


def interpolated(problem: ReachAvoidProblem, values: Sequence[FloatArray]) -> Callable[[FloatArray, float], FloatArray]:
    """A level-set function (points, t): the interpolated tube of the step whose time t is."""
    tubes = [_tube(problem.grid, one) for one in values]  # of the steps 0 to N; one if nothing depends on time

    def level_set(points: FloatArray, t: float) -> FloatArray:
        if problem.time_invariant:
            return tubes[0](points)
        value = np.ones(len(points))  # between sampling times nothing is inside
        for step, tube in enumerate(tubes):
            value = np.where(np.abs(t - problem.time(step)) <= ON_TIME * problem.delta, tube(points), value)
        return value

    return level_set


def _tube(grid: Grid, values: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """The function of points (M, ndim) that interpolates values (*grid.shape), which are copied."""
    beyond = max(float(values.max()), 1.0)  # outside: off a bounded axis by more than `SLACK` of a cell
    periodic, spacing = np.array(grid.periodic), np.array(grid.spacing)
    # the first node once more behind a periodic axis, as a table in a formula is clipped at its ends and not wrapped
    table = gridded(np.pad(values, [(0, int(turns)) for turns in periodic], mode="wrap"), grid.lower, spacing)
    bounded = np.flatnonzero(~periodic)
    least, greatest = (grid.lower - SLACK * spacing)[bounded], (grid.upper + SLACK * spacing)[bounded]

    def tube(points: FloatArray) -> FloatArray:
        places = points[:, bounded]
        outside = ((places < least) | (places > greatest)).any(axis=1)
        return np.where(outside, beyond, table(points)) if bounded.size else table(points)

    return tube
