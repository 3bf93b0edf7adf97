"""The avoid tubes of the unsafe sets and of the unsafe ends of the grid (games 1 and 2 of App. A.3).

What is beyond the unsafe ends of an axis is an unsafe set like any other, by the distance to the nearer end. On the
grid itself no state could cross an end, so this avoid game is played on a *wide* grid that extends past the ends, as
far as one interval can lead; there the dynamics are those at the end.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from sdhj.common.remembering import FloatArray
from sdhj.problem.samples import Samples
from sdhj.problem.sets import UnsafeSet


class Danger(NamedTuple):
    """What an avoid game is played against: one unsafe set, or the unsafe ends of one axis."""

    axes: tuple[int, ...]  # of the problem's grid on which the avoid tubes depend, ascending
    moves: bool  # whether the avoid tubes differ from step to step
    samples: Samples  # on whose grid the game is played; of ends that grid has `axes` alone, and goes past both
    unsafe_set: UnsafeSet  # of these samples; of ends all that lies past them
    game_axes: tuple[int, ...]  # of its samples' grid on which the game is played, ascending
    inside: tuple[slice, ...]  # for each of `axes` which nodes of the game's grid are nodes of the problem's


def dangers(samples: Samples) -> list[Danger]:
    """The avoid games of a problem: of each unsafe set, then of each axis with unsafe ends."""
    found = []
    for unsafe_set in samples.unsafe:
        axes = samples.avoid_axes(unsafe_set.axes)
        moves = samples.problem.moves(unsafe_set)
        found.append(Danger(axes, moves, samples, unsafe_set, axes, (slice(None),) * len(axes)))
    # the unsafe ends of an axis are one danger, the lower and the upper one together
    unsafe = np.isfinite(samples.grid.faces("fails")).any(axis=0)
    for axis in np.flatnonzero(unsafe).tolist():
        axes, (wide, inside) = samples.avoid_axes([axis]), samples.past_ends(axis)
        (past,) = wide.unsafe
        moves = samples.dynamics.depends_on_time
        found.append(Danger(axes, moves, wide, past, wide.avoid_axes(past.axes), inside))
    return found


def avoid_tubes_of(games: Any, danger: Danger, step: int, out: FloatArray, *some: Sequence[int]) -> FloatArray:
    """The avoid tubes of a danger over the interval from a step, > 0 in danger: (inputs, *subgrid), a view of `out`.

    `games` are those of `danger.samples`; of `some` inputs if they are `apart`, else of all. -inf under inputs that do
    not count.
    """
    if hasattr(games, "grouped_reach_sets"):
        games.avoid(danger.unsafe_set, step, out, *some)
    else:  # games of users
        out[...] = games.avoid(danger.unsafe_set, step)
    inputs = np.array(some[0]) if some else np.arange(len(out))
    # never above 0, so a set is nothing to avoid under these
    out[~danger.unsafe_set.counts(inputs)] = -np.inf
    return out[(slice(None), *danger.inside)]
