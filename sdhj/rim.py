"""Safe ends: what leaves over one is out of danger for good, at any time of an interval.

The games are played on a grid that goes on past the safe ends by a *rim* of some nodes; out there everything is as at
the end. At every stage of a solution the level-set functions of the sets to be in, and of those that stay clear, are at
most minus the distance past the end on the rim: what gets there has won, whatever would have followed. The value in the
end's own nodes is that of states that have not left.
"""

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from sdhj.grid import FloatArray, Grid
from sdhj.interpolation import SLACK

if TYPE_CHECKING:
    from sdhj.problem import ReachAvoidProblem, UnsafeSet

RIM = 4  # nodes: the widest stencils reach three


def with_rim(problem: "ReachAvoidProblem") -> "ReachAvoidProblem":
    """The problem on a grid with `RIM` nodes past each safe end; itself where there is none."""
    grid = problem.grid
    rim = np.isfinite(grid.faces("safe")).T * RIM  # (ndim, 2)
    if not rim.any():
        return problem
    past, nodes = rim.T * grid.spacing, (rim.sum(axis=1) + grid.shape).tolist()
    ends = (grid.lower - past[0]).tolist(), (grid.upper + past[1]).tolist()
    wide = Grid(*ends, nodes, grid.periodic, grid.names, grid.ends, rim.tolist())

    def as_at_the_end(part: "UnsafeSet") -> "UnsafeSet":
        own, level, swept = grid.subgrid(part.axes), part.level_set, part.swept
        return replace(
            part,
            level_set=lambda points, t: level(own.held(points, "safe"), t),
            swept=swept and (lambda points, t0, t1: swept(own.held(points, "safe"), t0, t1)),
        )

    dynamics = problem.dynamics.restricted(range(grid.ndim), lambda points: grid.held(points, "safe"))
    return replace(problem, grid=wide, dynamics=dynamics, unsafe=tuple(map(as_at_the_end, problem.unsafe)))


@lru_cache(maxsize=64)
def most_on_rim(grid: Grid) -> FloatArray | None:
    """Minus the distance past safe ends, +inf where nothing is past one, (shape); None where that is everywhere."""
    if not np.any(grid.rim):
        return None
    far = np.broadcast_to(grid.to_ends("safe"), grid.shape)
    return np.where(far < -SLACK * min(grid.spacing), far, np.inf)


def out_of_danger(grid: Grid, values: FloatArray) -> FloatArray:
    """Values (shape) held at most at `most_on_rim`."""
    most = most_on_rim(grid)
    return values if most is None else np.minimum(values, most, dtype=values.dtype)
