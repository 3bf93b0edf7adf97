"""The ends of the grid: leaving through an unsafe end is losing, as nothing is known of what lies beyond.

The set of what lies beyond the unsafe ends of an axis has a level-set function, the distance to the nearer end, and its
avoid game is played like that of any unsafe set; but on a grid that goes on past the ends, far enough for one interval,
where the state can be seen to cross. What the dynamics are out there makes no difference; they are taken from the end.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sdhj.dynamics import Dynamics
from sdhj.games import Games
from sdhj.grid import FloatArray, Grid
from sdhj.problem import ReachAvoidProblem, TargetSet, UnsafeSet

MARGIN = 3  # nodes beyond what an interval reaches: the widest stencil


@dataclass(frozen=True)
class Edge:
    """The unsafe ends of one axis.

    Attributes
    ----------
    axis : int
    axes : tuple of int
        The axes on which its avoid game is played: this one and those that its velocity needs.
    wide : ReachAvoidProblem
        The robot on those axes, past the ends, with what lies beyond them as its only unsafe set.
    inside : tuple of slice
        Where the grid lies in the wide one.
    """

    axis: int
    axes: tuple[int, ...]
    wide: ReachAvoidProblem
    inside: tuple[slice, ...]

    def tubes(self, games: Callable[[ReachAvoidProblem], Games], step: int) -> FloatArray:
        """Level-set functions of staying between the ends over the interval from `step`, (L, *subgrid of axes)."""
        return games(self.wide).avoid(self.wide.unsafe[0], step)[(slice(None), *self.inside)]


def edges(problem: ReachAvoidProblem) -> list[Edge]:
    """The unsafe ends of all axes that can be left."""
    low, high = problem.grid.faces("unsafe")
    return [_edge(problem, axis) for axis in np.flatnonzero(np.isfinite(low) | np.isfinite(high)).tolist()]


def _edge(problem: ReachAvoidProblem, axis: int) -> Edge:
    name = f"the ends of axis {problem.grid.names[axis]}"
    low, high = (float(face[axis]) for face in problem.grid.faces("unsafe"))
    everywhere = TargetSet((axis,), lambda points, t: np.full(len(points), -1.0), "everything")
    distance = UnsafeSet((axis,), lambda p, t: np.minimum(p[:, 0] - low, high - p[:, 0]), name=name)
    axes = problem.avoid_axes(distance)
    own, grid = axes.index(axis), problem.grid.subgrid(axes)
    speed = max(problem.interval(step).speeds[axis] for step in range(problem.steps if problem.dynamics.timed else 1))
    more = int(np.ceil(speed * problem.delta / grid.spacing[own])) + MARGIN
    wide = Grid(
        [end - more * grid.spacing[own] * (i == own) for i, end in enumerate(grid.lower)],
        [end + more * grid.spacing[own] * (i == own) for i, end in enumerate(grid.upper)],
        [n + 2 * more * (i == own) for i, n in enumerate(grid.shape)],
        grid.periodic,
        grid.names,
        ends="wall",
    )
    return Edge(
        axis=axis,
        axes=axes,
        wide=ReachAvoidProblem(
            grid=wide,
            dynamics=_on_axes(problem, axes),
            target=TargetSet((own,), everywhere.level_set, everywhere.name),
            unsafe=(UnsafeSet((own,), distance.level_set, name=name),),
            delta=problem.delta,
            steps=problem.steps,
            view_time=problem.view_time,
            name=name,
        ),
        inside=tuple(slice(more, -more) if i == own else slice(None) for i in range(len(axes))),
    )


def _on_axes(problem: ReachAvoidProblem, axes: tuple[int, ...]) -> Dynamics:
    """The dynamics of some axes, which need no others; what is past an end moves as at the end."""
    keep, grid = list(axes), problem.grid
    low, high = np.array(grid.lower), np.array(grid.upper)

    def embedded(points: FloatArray) -> FloatArray:
        full = np.tile(low, (len(points), 1))
        full[:, keep] = points
        return np.minimum(np.maximum(full, low), high)

    return problem.dynamics.restricted(keep, embedded)
