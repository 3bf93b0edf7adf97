"""The avoid tubes of the unsafe sets and of the unsafe ends of the grid (games 1 and 2 of App. A.3).

The region beyond the unsafe ends of an axis is an unsafe set like any other, whose level-set function is the distance
to the nearer end. On the grid itself no state could cross an end, so this avoid game is played on a *wide* grid that
extends past the ends, as far as one interval can lead; there the dynamics are those at the end.
"""

from typing import Any, NamedTuple

import numpy as np

from sdhj.kernels import FloatArray
from sdhj.kernels.interpolation import SLACK
from sdhj.problem.findings import Finding
from sdhj.problem.grid import Grid, PaddedGrid
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sensing import Sensing
from sdhj.problem.sets import ANYWHERE, UnsafeSet
from sdhj.solver.schemes import checked_travel

MARGIN = 6  # nodes beyond what an interval reaches: errors from the wide grid's end fall tenfold per node


class Danger(NamedTuple):
    """What an avoid game is played against: one unsafe set, or the unsafe ends of one axis.

    Attributes
    ----------
    axes : tuple of int
        The axes of the problem's grid on which the avoid tubes depend, ascending.
    moves : bool
        Whether the avoid tubes differ from step to step.
    problem : ReachAvoidProblem
        On whose grid the game is played: the problem that is solved or, for the ends of an axis, one on `axes` alone
        that is made for it, whose grid goes past both ends.
    unsafe_set : UnsafeSet
        The set of this `problem` to be avoided; of the ends of an axis all that lies past them.
    inside : tuple of slice
        For each of `axes` which nodes of the game's grid are nodes of the grid of the problem that is solved.
    """

    axes: tuple[int, ...]
    moves: bool
    problem: ReachAvoidProblem
    unsafe_set: UnsafeSet
    inside: tuple[slice, ...]

    @property
    def game_axes(self) -> tuple[int, ...]:
        """The axes of its problem's grid on which the game is played, ascending."""
        return self.problem.avoid_axes(self.unsafe_set)


def dangers(problem: ReachAvoidProblem) -> list[Danger]:
    """The avoid games of a problem: of each unsafe set, then of the unsafe ends of each axis that has them.

    Found at the first call and kept with the problem; each call returns a new list. ValueError where the state crosses
    more than `sdhj.solver.schemes.MOST_STEPS` cells in an interval towards an unsafe end.
    """
    return list(problem.remembered("dangers", lambda: _dangers(problem)))


def _dangers(problem: ReachAvoidProblem) -> list[Danger]:
    """Find the avoid games that `dangers` returns, without keeping them."""
    found = []
    for unsafe_set in problem.unsafe:
        axes = problem.avoid_axes(unsafe_set)
        found.append(Danger(axes, problem.moves(unsafe_set), problem, unsafe_set, (slice(None),) * len(axes)))
    unsafe = np.isfinite(problem.grid.faces("fails")).any(axis=0)
    return found + [_ends_as_danger(problem, axis) for axis in np.flatnonzero(unsafe).tolist()]


def avoid_tubes_of(games: Any, danger: Danger, step: int, out: FloatArray) -> FloatArray:
    """The avoid tubes of a danger over the interval from a step, one for each input: (L, *subgrid), > 0 in danger.

    -inf for inputs under which the set is not unsafe.

    games : those of `danger.problem`.
    out : (L, *grid of the game), written over; the result is a view of it.
    """
    if hasattr(games, "grouped_reach_sets"):
        games.avoid(danger.unsafe_set, step, out)
    else:  # games of users
        out[...] = games.avoid(danger.unsafe_set, step)
    out[~danger.unsafe_set.counts(np.arange(len(out)))] = -np.inf
    return out[(slice(None), *danger.inside)]


def never_met_finding(unsafe_set: UnsafeSet) -> Finding:
    """The finding that no node is in danger of an unsafe set under any input; the caller has found that none is."""
    return Finding(
        f"no node is ever in danger of the unsafe set {unsafe_set.name!r}, so the table ignores it. ",
        0.0,
        "It lies between the nodes (use more nodes, or enlarge the set), or is out of reach",
        UserWarning,
    )


def _ends_as_danger(problem: ReachAvoidProblem, axis: int) -> Danger:
    """The unsafe ends of an axis as a danger: the unsafe set g = min(x - low, high - x) of a wide problem.

    The wide problem has the axes that the velocity along this axis depends on. Its grid goes past both ends by as many
    nodes as the state crosses in an interval, and `MARGIN` more; velocities there are those at the end. ValueError
    where the state crosses too many cells (`checked_travel`).
    """
    slack = SLACK * problem.grid.spacing[axis]  # a state on the end, to rounding, is on the grid
    low, high = (float(face[axis]) for face in problem.grid.faces("fails"))
    name = f"the ends of axis {problem.grid.names[axis]}"
    axes = problem.avoid_axes(UnsafeSet((axis,), lambda p, t: p[:, 0], name=name))
    place, grid, timed = axes.index(axis), problem.grid.subgrid(axes), problem.dynamics.depends_on_time
    delta = problem.interval(0).delta
    speeds = np.max([problem.interval(step).speeds for step in range(problem.steps if timed else 1)], axis=0)
    more = int(np.ceil(checked_travel(problem.grid, speeds, delta)[axis])) + MARGIN
    widened = np.array([more * (i == place) for i in range(len(axes))])
    frees = grid.ends_where("frees").T  # a state that leaves there is out of danger here too
    each = zip(grid.ends, frees, strict=True)
    ends = [[end if free else "wall" for end, free in zip(*one, strict=True)] for one in each]
    padding = grid.padding + widened[:, None] * frees
    longer = Grid(
        (np.array(grid.lower) - widened * grid.spacing).tolist(),
        (np.array(grid.upper) + widened * grid.spacing).tolist(),
        [n + 2 * int(extra) for n, extra in zip(grid.shape, widened, strict=True)],
        grid.periodic,
        grid.names,
        ends,
    )
    wide = ReachAvoidProblem(
        grid=PaddedGrid(longer, padding.tolist()) if padding.any() else longer,
        dynamics=problem.dynamics.clipped(np.array(problem.grid.lower), np.array(problem.grid.upper)).on_axes(
            axes, np.array(problem.grid.lower)
        ),
        target=ANYWHERE,
        unsafe=(UnsafeSet((place,), lambda p, t: np.minimum(p[:, 0] - low, high - p[:, 0]) + slack, name=name),),
        delta=delta,
        steps=problem.most_steps,
        sensing=Sensing(delay=problem.sensing.delay),  # intervals are longer and begin as late
    )
    inside = tuple(slice(extra, extra + n) for extra, n in zip(widened.tolist(), grid.shape, strict=True))
    return Danger(axes, timed, wide, wide.unsafe[0], inside)
