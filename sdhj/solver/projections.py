"""Games 2 and 3 on lower-dimensional subspaces (Sec. 5.1, App. A.4 and A.5).

A subspace keeps some axes and drops the others. The dropped coordinates w act as a disturbance that may take any value
on their axes at any time, so a result in the subspace holds in the whole space for every w:

* The set S to be reached gets an inner projection, which contains x if (x, w) is in S for all w:
  s_p(x) = max over w of s(x, w).
* An unsafe set G gets an outer projection, which contains x if (x, w) is in G for some w:
  g_p(x) = min over w of g(x, w).
* Where the velocity of the kept axes depends on w, the Hamiltonian takes the supremum over w as well.

On the grid w runs over the nodes of its axes, which gives the extremes of the linear interpolant.

A solution on the subspace, constant along the dropped axes, is its back-projection. Each subspace gives a reach set and
an avoid tube inside the true ones, so their union over the subspaces, the minimum of the level-set functions, is inside
as well, and larger than any of them. The last display of App. A.5 prints an intersection of complements: that is inside
too, but smaller than each.

The tubes S_k^i live on the whole grid; the recursion projects them anew at each step. An unsafe set that depends only
on axes that one subspace keeps needs no projection and is solved on its own axes, exactly as in the full method.
"""

import math
import reprlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, ClassVar, NamedTuple

import numpy as np

from sdhj.common.checks import Options
from sdhj.common.findings import Finding, ProjectionWarning, tell
from sdhj.common.remembering import FloatArray
from sdhj.formulas.formula import BlackBox
from sdhj.kernels.boxes import maximum_along
from sdhj.kernels.union import PAST
from sdhj.problem.boxes import Maxima, one_by_one
from sdhj.problem.grid import Grid
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.samples import Samples
from sdhj.problem.sets import UnsafeSet
from sdhj.solver.findings import names_apart, projection_findings
from sdhj.solver.games import Axes, Games, HJIGames, HopfLaxGames, ObstacleFunction, Pieces, united
from sdhj.solver.methods import HJI, HopfLax, refuse_jitter
from sdhj.solver.recursion import GridSets

GROWN = "these subspaces are too conservative here"


def default_subspaces(problem: ReachAvoidProblem) -> tuple[Axes, ...]:
    """The subspaces, each the axes that it keeps: each drops one axis that no input drives, or else any one axis."""
    ndim, everything = problem.grid.ndim, tuple(range(problem.grid.ndim))
    if ndim == 1:
        raise ValueError('method="projected" needs a grid of at least 2 axes, one to drop; use method="hji"')
    # without the axes that inputs drive nothing can be steered to the target
    driven = driven_axes(problem)
    dropped = [axis for axis in reversed(everything) if not driven[axis]] or list(reversed(everything))
    return tuple(tuple(axis for axis in everything if axis != drop) for drop in dropped)


def driven_axes(problem: ReachAvoidProblem) -> FloatArray:
    """Whether the choice of the input changes the drift along each axis, (ndim,); all True of a black box."""
    drift, count = problem.dynamics.drift, len(problem.inputs)
    if isinstance(drift, BlackBox):
        return np.ones(problem.grid.ndim, np.bool_)
    each = np.array(drift.outputs, dtype=object).reshape(count, -1)
    # by identity, which is equality of graphs: `sdhj.formulas.graph.interned` makes each node once
    return np.array([any(one is not column[0] for one in column) for column in each.T])


def checked_subspaces(problem: ReachAvoidProblem, subspaces: Sequence[Sequence[int]] | None) -> tuple[Axes, ...]:
    """The subspaces as tuples of ascending axes, by default the `default_subspaces`."""
    if subspaces is None:
        return default_subspaces(problem)
    ndim = problem.grid.ndim
    chosen = [tuple(sorted(axes)) for axes in subspaces]
    for axes in chosen:
        if not axes or len(set(axes)) < len(axes) or not set(axes) <= set(range(ndim)):
            raise ValueError(f"a subspace must be distinct axes of the grid (0 to {ndim - 1}), got {axes}")
    if not chosen or len(set(chosen)) < len(chosen):
        raise ValueError(f"subspaces must be one or more different sets of axes, got {subspaces}")
    return tuple(chosen)


class ProjectedGames:
    """Games 2 and 3 on several subspaces, back-projected and united: the results are inside the true ones."""

    def __init__(
        self, samples: Samples, inner: Callable[[Axes], HJIGames | HopfLaxGames], subspaces: tuple[Axes, ...]
    ) -> None:
        self.samples, self.inner, self.subspaces = samples, inner, subspaces
        self._games: dict[Axes, HJIGames | HopfLaxGames] = {}
        # by position in problem.unsafe: the largest share of a subspace that the set's outer projection leaves free
        self.free: dict[int, float] = {}
        self.dtype = self.on(subspaces[0]).dtype

    @property
    def solved(self) -> int:
        """PDEs solved so far, on all subspaces together."""
        return sum(games.solved for games in self._games.values())

    @property
    def shifted(self) -> bool:
        """Whether the games on all subspaces use the moving frame."""
        return all(self.on(axes).shifted for axes in self.subspaces)

    def on(self, axes: Axes) -> HJIGames | HopfLaxGames:
        """The games on the subspace of some axes, kept."""
        if axes not in self._games:
            self._games[axes] = self.inner(axes)
        return self._games[axes]

    def inner_projection(self, values: FloatArray, axes: Axes) -> FloatArray:
        """s_p(x) = max over the dropped coordinates w of s(x, w), at the nodes of the subgrid of `axes`.

        With all axes kept it is `values` itself.
        """
        # the last axis first, so that those before it keep their numbers
        for axis in reversed([axis for axis in range(self.samples.grid.ndim) if axis not in axes]):
            before, after = values.shape[:axis], values.shape[axis + 1 :]
            most = np.empty((math.prod(before), math.prod(after)), values.dtype)
            rows = np.ascontiguousarray(values).reshape(len(most), -1, most.shape[1])
            rows.flags.writeable = False  # as in `Grid.interpolate`
            maximum_along(rows, most)
            values = most.reshape(before + after)
        return values

    def grouped_reach_sets(self, values: FloatArray, step: int) -> Iterator[Pieces]:
        """Yield the reach sets of all inputs at once, as pieces on the subspaces, from the inner projections."""
        grid, count = self.samples.grid, len(self.samples.problem.inputs)
        pieces, end = list[FloatArray](), 0
        whole = tuple(n - low - high for n, (low, high) in zip(grid.shape, grid.padding, strict=True))
        shapes = [(count, *(whole[axis] for axis in axes)) for axes in self.subspaces]
        # with what `add_inputs` may read behind the last piece
        flat = np.empty(sum(map(math.prod, shapes)) + PAST, self.dtype)
        for axes, shape in zip(self.subspaces, shapes, strict=True):
            begin, end = end, end + math.prod(shape)
            pieces.append(flat[begin:end].reshape(shape))
            for some in self.on(axes).grouped_reach_sets(self.inner_projection(values, axes), step):
                these = pieces[-1][some.first : some.first + some.number]
                if isinstance(some, Maxima):
                    some.of(into=these)
                else:
                    these[:] = some.of()
        yield Pieces(0, whole, pieces, self.subspaces, flat)

    def reach(self, values: FloatArray, step: int) -> Iterator[tuple[int, FloatArray]]:
        """Yield (j, Phi_j), on the whole grid: inside the true reach set."""
        return one_by_one(self.grouped_reach_sets(values, step))

    def avoid(self, unsafe_set: UnsafeSet, step: int, out: FloatArray | None = None) -> FloatArray:
        """The avoid tubes of an unsafe set over the interval from a step, inside the true ones."""
        samples = self.samples
        axes = samples.avoid_axes(unsafe_set.axes)
        grid = samples.grid.subgrid(axes)
        if any(set(axes) <= set(subspace) for subspace in self.subspaces):
            # one subspace keeps all that the tubes depend on: nothing is projected
            return self.on(tuple(range(samples.grid.ndim))).avoid(unsafe_set, step, out)
        out = np.empty((len(samples.problem.inputs), *grid.shape), self.dtype) if out is None else out
        obstacle, kept = ObstacleFunction.of(samples, unsafe_set, axes), self._kept(axes)
        sampled: dict[tuple[float, float], dict[Axes, FloatArray]] = {}

        def projected(keep: Axes, t0: float, t1: float) -> FloatArray:
            if (t0, t1) not in sampled:  # once for all subspaces
                sampled[t0, t1] = self.outer_projections(unsafe_set, axes, obstacle.values_over(t0, t1))
            return sampled[t0, t1][keep]

        if not kept:  # all that this set depends on was dropped: it is everywhere, or nowhere
            obstacles = obstacle.values_over(*samples.problem.span(step))
            self._note_free(unsafe_set, float(obstacles.max() < 0))
            out.fill(obstacles.max())
            return out
        tubes = []
        for keep in kept:
            obstacle_on = ObstacleFunction(keep, partial(projected, keep), obstacle.instant)
            tubes.append(self.on(keep).tubes(obstacle_on, step))
        local = [tuple(axes.index(axis) for axis in keep) for keep in kept]
        return united(tubes, local, out)

    def _kept(self, axes: Axes) -> list[Axes]:
        """Which of some axes each subspace keeps, each once, without those that keep none, or less than another."""
        kept = [tuple(axis for axis in axes if axis in subspace) for subspace in self.subspaces]
        return [k for k in dict.fromkeys(kept) if k and not any(set(k) < set(other) for other in kept)]

    def outer_projections(self, unsafe_set: UnsafeSet, axes: Axes, obstacle: FloatArray) -> dict[Axes, FloatArray]:
        """-g_p(x) = max over the dropped coordinates w of -g(x, w), by each of `_kept(axes)`; noted in `free`.

        `obstacle` is -g (*subgrid of axes).
        """
        projected = {}
        for keep in self._kept(axes):
            projected[keep] = obstacle.max(axis=tuple(i for i, axis in enumerate(axes) if axis not in keep))
            self._note_free(unsafe_set, self.samples.grid.subgrid(keep).fraction(projected[keep] < 0))
        return projected

    def _note_free(self, unsafe_set: UnsafeSet, share: float) -> None:
        """Raise the entry of this unsafe set in `free` to a `share` of a subspace."""
        position = next(i for i, known in enumerate(self.samples.unsafe) if known is unsafe_set)
        self.free[position] = max(share, self.free.get(position, 0.0))


class ProjectedSets(GridSets):
    """`GridSets` of method "projected", whose table also says how much the projections lose.

    Its `losses` are "target_kept", for each subspace the largest share of the goal's volume that the inner projection
    keeps; and "free", the greatest share of a subspace outside a set's outer projection, by name.
    """

    def begin(self) -> None:
        """As `GridSets.begin`; also write the entries (k, 0), which `look_over` projects."""
        super().begin()
        self.goals: dict[int, int] = {}
        # written first, as `look_over` projects them; `recursion` then calls `write_goal`, which only moves them
        for step in self.rows_of_entries:
            super().write_goal(step)
            self.goals[step] = self.place(step, 0)
        self.look_over(lambda step: self.tubes[self.goals[step]], self.parts.games.free)

    def write_goal(self, step: int) -> None:
        """Copy the entry (step, 0), which `begin` has written, to where it lies once tubes before it are shared."""
        if (place := self.place(step, 0)) != self.goals[step]:
            self.tubes[place] = self.tubes[self.goals[step]]

    def look_over(self, goal: Callable[[int], FloatArray], free: Mapping[int, float]) -> None:
        """Find how much the projections lose (`losses`), and warn where nothing is left."""
        games, grid = self.parts.games, self.problem.grid

        def share(values: FloatArray, axes: Axes) -> float:
            # of the volume, before and after
            whole = grid.fraction(values <= 0)
            return grid.subgrid(axes).fraction(games.inner_projection(values, axes) <= 0) / whole if whole > 0 else 0.0

        kept = [0.0] * len(games.subspaces)
        for step in self.rows_of_entries:
            kept = [max(most, share(goal(step), axes)) for most, axes in zip(kept, games.subspaces, strict=True)]
        self.losses: dict[str, Any] = {
            "target_kept": kept,
            "free": {names_apart(self.problem)[at]: one for at, one in sorted(free.items())},
        }
        tell(*projection_findings(self.problem, games.subspaces, self.losses))

    def said_of(self, solved: int, shared: int, goal: FloatArray, last: FloatArray) -> dict[str, Any]:
        """As `GridSets.said_of`; and, as "projection", `losses` and the sentences of all warnings.

        Warns if tubes never grow beyond the target.
        """
        found = projection_findings(self.problem, self.parts.games.subspaces, self.losses)
        # else the cause has been told before
        if not found and np.array_equal(inside := last <= 0, goal <= 0):
            share = self.problem.grid.fraction(inside)
            found = [Finding("the projected tubes never grow beyond the target: ", share, GROWN, ProjectionWarning)]
            tell(found[0])
        own = {"projection": self.losses | {"warnings": [str(one) for one in found]}}
        return super().said_of(solved, shared, goal, last) | own


@dataclass(frozen=True)
class Projected(Options):
    """Method "projected": games on lower-dimensional subspaces, united after back-projection (Sec. 5.1, App. A.4, A.5).

    The tubes lie inside those of the full method, and cost less: little less on four axes, where `HJI` is the one to
    take; from five axes on a twelfth to a half of the time in the problems of `notebooks/site/numbers.md`. A target
    that depends on a dropped coordinate, as in `evader_case_study`, keeps what is in it for *every* value of that; a
    `ProjectionWarning` says where it is empty. The shadow of a disk is that of the square around it: a disturbance that
    moves several axes gains nothing.

    Parameters
    ----------
    subspaces : sequence of sequence of int, optional
        The axes that each subspace keeps. Default: each drops one axis that no input drives; in the case studies these
        are the paper's (0, 1, 2) and (0, 1, 3).
    inner : HJI or HopfLax, optional
        The method that solves the games on the subspaces.

    Raises
    ------
    ValueError
        By `sdhj.solve` if the grid has one axis, or not those of `subspaces`.

    Examples
    --------
    Beside the games on the whole grid, which take longer and win more:

    >>> import sdhj
    >>> problem = sdhj.arm_case_study(nodes=13, steps=3)
    >>> methods = sdhj.HJI(), sdhj.Projected()
    >>> [round(sdhj.solve(problem, method).fraction(start=0, within=3), 2) for method in methods]
    [0.18, 0.16]
    """

    subspaces: Sequence[Sequence[int]] | None = None
    inner: HJI | HopfLax = field(default_factory=HJI)
    name: ClassVar[str] = "projected"

    def __post_init__(self) -> None:
        if not isinstance(self.inner, HJI | HopfLax):
            raise ValueError(f"inner must be a sdhj.HJI or a sdhj.HopfLax, got {reprlib.repr(self.inner)}")
        if self.subspaces is None:
            return
        given: Any = self.subspaces
        given = given.tolist() if isinstance(given, np.ndarray) else given
        collection = given if isinstance(given, Sequence) else [None]
        # numbers alone: which axes there are `checked_subspaces` asks, when there is a problem
        whole = all(
            isinstance(axes, Sequence | np.ndarray) and all(isinstance(axis, int | np.integer) for axis in axes)
            for axes in collection
        )
        if not whole or any(isinstance(axis, bool | np.bool_) for axes in given for axis in axes):
            raise ValueError(
                "subspaces must be a sequence of sequences of axes, which are whole numbers, for example "
                f"[(0, 1, 2), (0, 1, 3)], got {reprlib.repr(given)}"
            )
        object.__setattr__(self, "subspaces", tuple(tuple(int(axis) for axis in axes) for axes in given))

    def sets(self, problem: ReachAvoidProblem, progress: bool | None = None) -> "ProjectedSets":
        """The tubes on the whole grid, by games on subspaces, filled in by `recursion`."""
        # as the inner method's own `sets`, which would refuse it, is never called
        if isinstance(self.inner, HopfLax):
            refuse_jitter(problem)
        subspaces = checked_subspaces(problem, self.subspaces)
        options = {"subspaces": [list(axes) for axes in subspaces], "inner": self.inner.name} | self.inner.options
        return ProjectedSets(
            problem, OnSubspaces(self.name, options, self.inner, subspaces, Samples(problem).padded.grid)
        )


class OnSubspaces(NamedTuple):
    """The method "projected" for one problem, as `GridSets` takes it."""

    name: str
    options: dict[str, Any]
    inner: HJI | HopfLax
    subspaces: tuple[Axes, ...]
    grid: Grid  # of the games, of which subspaces are taken

    def on(self, samples: Samples) -> Games:
        """`ProjectedGames` on the grid of the games; on the wide grid of an axis's ends the inner method's games."""
        # by value, as workers of a Dask client have a copy of this object
        if samples.grid != self.grid:
            return self.inner.on(samples)
        return ProjectedGames(samples, lambda axes: self.inner.on(samples, axes), self.subspaces)
