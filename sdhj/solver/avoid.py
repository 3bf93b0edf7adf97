"""The avoid tubes of the unsafe sets and of the unsafe ends of the grid (games 1 and 2 of App. A.3).

The region beyond the unsafe ends of an axis is an unsafe set like any other, whose level-set function is the distance
to the nearer end. On the grid itself no state could cross an end, so this avoid game is played on a *wide* grid that
extends past the ends, as far as one interval can lead; there the dynamics are those at the end.
"""

import warnings
from collections.abc import Callable
from itertools import groupby, product
from typing import NamedTuple

import numpy as np

from sdhj.kernels import FloatArray
from sdhj.kernels.interpolation import SLACK
from sdhj.problem.grid import Grid
from sdhj.problem.problem import ReachAvoidProblem, shrunk
from sdhj.problem.sensing import Sensing
from sdhj.problem.sets import ANYWHERE, UnsafeSet
from sdhj.solver.former import Former
from sdhj.solver.games import Games
from sdhj.solver.schemes import checked_travel
from sdhj.table.table import AvoidTubes

MARGIN = 6  # nodes beyond what an interval reaches: errors from the wide grid's end fall tenfold per node


class Danger(NamedTuple):
    """An avoid game.

    axes : the axes of its tubes, ascending.
    moves : whether the tubes differ from step to step.
    problem, part : a problem and its unsafe set; for the ends of an axis they are a wide problem and its only set.
    inside : index of the subgrid of `axes` in the grid on which the game is played.
    """

    axes: tuple[int, ...]
    moves: bool
    problem: ReachAvoidProblem
    part: UnsafeSet
    inside: tuple[slice, ...]


def dangers(problem: ReachAvoidProblem) -> list[Danger]:
    """The avoid games of a problem: of each unsafe set, and of the unsafe ends of each axis. Found once, and kept."""
    if (found := vars(problem).get("_dangers")) is None:
        found = [
            Danger(axes := problem.avoid_axes(part), problem.moves(part), problem, part, (slice(None),) * len(axes))
            for part in problem.unsafe
        ]
        unsafe = np.isfinite(problem.grid.faces("unsafe")).any(axis=0)
        found += [_ends(problem, axis) for axis in np.flatnonzero(unsafe).tolist()]
        vars(problem)["_dangers"] = found
    return list(found)


def avoid_tubes(
    problem: ReachAvoidProblem,
    make: Callable[[ReachAvoidProblem], Games],
    games: Games,
    former: Former | None = None,
) -> AvoidTubes:
    """The avoid tubes for every input: once for static unsafe sets, for each step for moving ones.

    `games` are those of the problem, with a rim if it has safe ends; `make` creates those of a wide problem. What a
    former solve has of them is not solved again; of its sets that are still there nothing is warned of.
    """
    count, felt, everything = len(problem.inputs), set[int](), dangers(problem)
    kinds = [[danger for danger in everything if danger.moves == moves] for moves in (False, True)]
    axes = [tuple(sorted({axis for danger in alike for axis in danger.axes})) for alike in kinds]
    made = []
    for moves, alike, kept, often in zip((False, True), kinds, axes, (1, problem.most_steps), strict=True):
        if former and (same := former.same(alike, moves, often)) is not None:
            made.append(same)
            felt.update(id(danger.part) for danger in alike)
            continue
        keeps = former if former and len(alike) > 1 else None
        tubes = np.empty((often, count, *(problem.grid.shape[axis] for axis in kept)), games.dtype)
        if not alike:
            tubes.fill(-np.inf)
        # a step at a time, at which games that are played on one grid share velocities that depend on time
        for _, together in groupby(enumerate(alike), key=lambda one: id(one[1].problem)):
            some = list(together)
            playing = games if some[0][1].problem is problem else make(some[0][1].problem)
            for step, (number, danger) in product(range(often), some):
                at = [kept.index(i) for i in danger.axes]
                found = _tube(playing, danger, step, keeps)
                if id(danger.part) not in felt and found.max() > 0:
                    felt.add(id(danger.part))
                fits = found.flags.carray and (found.shape, found.dtype) == (tubes[step].shape, tubes.dtype)
                if number == 0 and often == 1 and fits and not keeps:
                    tubes = found[None]  # to copy them all would take as long as a game
                    continue
                for total, tube in zip(tubes[step], found, strict=True):
                    lifted = problem.grid.subgrid(kept).lift(tube, at)
                    np.maximum(total if number else lifted, lifted, out=total)
        for tube in tubes.reshape(-1, *tubes.shape[2:]) if kept and problem.sensing else ():
            tube[:] = shrunk(problem, tube, kept)
        inner = (problem.grid.inner[axis] for axis in kept)
        made.append(np.ascontiguousarray(tubes[(slice(None), slice(None), *inner)]))
    for part in problem.unsafe:
        if id(part) not in felt:
            warnings.warn(never_felt(part), stacklevel=6)
    return AvoidTubes(axes[0], made[0][0], axes[1], made[1])


def _tube(games: Games, danger: Danger, step: int, former: Former | None) -> FloatArray:
    """The tubes of a danger from a step on, (L, *subgrid), which a former solve may have, and the next one may want."""
    found = former.tube(danger, step) if former else None
    if found is None:
        found = games.avoid(danger.part, step)[(slice(None), *danger.inside)]
    if former:
        former.keep(danger, found)
    return found


def never_felt(part: UnsafeSet) -> str:
    """The warning for an unsafe set that no node is in danger of."""
    return (
        f"no node is ever in danger of the unsafe set {part.name!r}, so the table ignores it. It lies between the "
        "nodes (use more nodes, or enlarge the set), or is out of reach"
    )


def _ends(problem: ReachAvoidProblem, axis: int) -> Danger:
    """The unsafe ends of an axis, as the unsafe set of a problem on the axes that its velocity depends on."""
    slack = SLACK * problem.grid.spacing[axis]  # a state on the end, to rounding, is on the grid
    low, high = (float(face[axis]) for face in problem.grid.faces("unsafe"))
    name = f"the ends of axis {problem.grid.names[axis]}"
    axes = problem.avoid_axes(UnsafeSet((axis,), lambda p, t: p[:, 0], name=name))
    place, grid, timed = axes.index(axis), problem.grid.subgrid(axes), problem.dynamics.timed
    delta = problem.interval(0).delta
    speeds = np.max([problem.interval(step).speeds for step in range(problem.steps if timed else 1)], axis=0)
    more = int(np.ceil(checked_travel(problem.grid, speeds, delta)[axis])) + MARGIN
    widened = np.array([more * (i == place) for i in range(len(axes))])
    # a state that leaves through a safe end is out of danger here too
    ends = [tuple("safe" if end == "safe" else "wall" for end in pair) for pair in grid.ends]
    rim = [
        (a + more * (i == place and ends[i][0] == "safe"), b + more * (i == place and ends[i][1] == "safe"))
        for i, (a, b) in enumerate(grid.rim)
    ]
    wide = ReachAvoidProblem(
        grid=Grid(
            (np.array(grid.lower) - widened * grid.spacing).tolist(),
            (np.array(grid.upper) + widened * grid.spacing).tolist(),
            [n + 2 * int(extra) for n, extra in zip(grid.shape, widened, strict=True)],
            grid.periodic,
            grid.names,
            ends,
            rim,
        ),
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
