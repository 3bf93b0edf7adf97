"""The differential games of one sampling interval (Sec. 4.1, App. A.3), solved for each input.

For the interval that starts at step k, and for every input u_j held over it, the games of a method compute

* `reach(values, step)`: level-set functions of the reach sets of {values <= 0} (Definition 2; game 3);
* `avoid(unsafe_set, step)`: level-set functions of the avoid tubes of one unsafe set (Definition 3; games 1 and 2),
  solved on the axes that set depends on.

The reach-avoid set of u_j is the intersection, max(reach, avoid). `JointGames` solve the reach-avoid game in one PDE
(Prop. 1) instead; the two agree up to scheme error.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, partial
from itertools import groupby
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np

from sdhj.kernels import FloatArray
from sdhj.kernels.compiling import FEW
from sdhj.kernels.union import EIGHT
from sdhj.problem.boxes import Maxima, crossings, maxima, one_by_one, operations, out_of_danger
from sdhj.problem.cost import CALL, tick
from sdhj.problem.grid import Grid
from sdhj.problem.interval import INSTANTS, ROUNDING, Interval, Velocities, narrowed
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sets import UnsafeSet
from sdhj.solver.former import Patch, within_boxes, within_stages
from sdhj.solver.hopf_lax import Moved, maxima_over_sets, maximum_over_paths
from sdhj.solver.schemes import (
    Scheme,
    Scratch,
    arranged_bytes,
    checked_travel,
    evolve,
    evolve_each,
    evolve_with_early_end,
    terms_of_inputs,
    too_restless_error,
)

KEPT = 256_000_000  # bytes of sampled velocities that the games keep
PIECES_COUNTED = 5  # pieces of an interval at which it is looked what they cost
A_PIECE = 1e6  # operations that take as long as what a piece of an interval takes besides
GROUPED = 16_000_000  # bytes of sampled velocities up to which inputs are solved together, on copies of these
BEYOND = 4  # nodes past what the disturbance brings to the ends of the moving frame: errors there fall tenfold per node
SHIFT = "limited"  # how the moving frame is brought back: no less accurate than the differences it serves
Axes = tuple[int, ...]
Counted = Mapping[Axes, Sequence[int]]
Wanted = Mapping[int, slice]
NONE: Any = MappingProxyType({})  # no axis has an entry
T = TypeVar("T")


class Games(Protocol):
    """The interface of a method for the recursion: the games of one interval, for each input, on the whole grid.

    The calls are independent of each other; what is sampled is kept between them. Games may also have

    * `grouped_reach_sets(values, step)`: reach sets come some inputs at a time, and need not be written out;
    * `patches` = True: `grouped_reach_sets` takes a `Patch` as third argument;
    * `operations(axes, step, avoid)`, for the estimate of the cost, as `_OnAxes` has it.
    """

    @property
    def dtype(self) -> str:
        """The dtype of the values of level-set functions, "float32" or "float64"."""

    @property
    def solved(self) -> int:
        """How many PDEs have been solved so far; 0 for games by a formula."""

    def reach(self, values: FloatArray, step: int) -> Iterator[tuple[int, FloatArray]]:
        """Yield (j, Phi_j (*shape)) for each input j in turn: the reach set of {values <= 0} (Definition 2).

        Phi_j is the level-set function, at the begin of the interval from a step, of the states that u_j leads into the
        set {values <= 0} (*shape) at its end, without regard to the unsafe sets.
        """

    def avoid(self, unsafe_set: UnsafeSet, step: int) -> FloatArray:
        """For each input the avoid tube of an unsafe set over the interval from a step.

        The result has the shape (L, *subgrid of problem.avoid_axes(unsafe_set)).

        A level-set function: <= 0 where the input stays clear of the set.
        """


class Pieces(NamedTuple):
    """The reach sets of successive inputs, each the minimum of level-set functions on some axes, its pieces.

    Attributes
    ----------
    first : int
        The number of the first input.
    grid : Grid
    pieces : sequence of (inputs, *subgrid) arrays
        For each subspace a function for each of the inputs.
    axes : sequence of tuple of int
        The axes of each subspace, ascending. One subspace with all axes means that the functions are written out.
    flat : 1-D array, or None
        Where there are several subspaces, the array of which the pieces are views, one after the other, with `PAST`
        numbers more at its end, which `add_inputs` may read.
    """

    first: int
    grid: Grid
    pieces: Sequence[FloatArray]
    axes: Sequence[Axes]
    flat: FloatArray | None = None

    @property
    def number(self) -> int:
        """The number of inputs, whose reach sets these are."""
        return len(self.pieces[0])

    def of(self, some: slice = slice(None)) -> FloatArray:
        """The level-set functions of some of these inputs on the whole grid: (inputs, *grid.shape).

        A view where there is one piece on all axes, else a new array.

        some : a slice of the inputs, counted from `first`; by default all.
        """
        if len(self.axes[0]) == self.grid.ndim:  # nothing was dropped, perhaps nodes that nobody wants
            return self.pieces[0][some]
        return united(self.grid, [piece[some] for piece in self.pieces], self.axes)


def united(grid: Grid, pieces: Sequence[FloatArray], axes: Sequence[Axes]) -> FloatArray:
    """The minimum over subspaces of functions that are constant along the other axes: a new array (L, *grid.shape).

    It is the union of their sets. pieces : for each subspace an array (L, *subgrid). axes : the axes of each subspace.
    """
    out = np.empty((len(pieces[0]), *grid.shape), pieces[0].dtype)
    for j, total in enumerate(out):
        first, *others = (grid.lift(piece[j], keep) for piece, keep in zip(pieces, axes, strict=True))
        if not others:
            total[...] = first
        for other in others:
            np.minimum(first, other, out=total)
            first = total
    return out


def in_eights(grid: Grid, reach_sets: Iterable[tuple[int, FloatArray]]) -> Iterator[Pieces]:
    """Yield reach sets that come one by one, (j, values (*grid.shape)) with ascending j, stacked to `Pieces`.

    Successive inputs whose marks are in one byte, that is with the same j // 8, come together. The values are copied.
    """
    for _, run in groupby(enumerate(reach_sets), key=lambda one: (one[1][0] // EIGHT, one[1][0] - one[0])):
        inputs, values = zip(*(found for _, found in run), strict=True)
        yield Pieces(inputs[0], grid, [np.stack(values)], [tuple(range(grid.ndim))])


def past_ends(problem: ReachAvoidProblem, axes: Sequence[int]) -> tuple[int, ...]:
    """By how many nodes the grid of the moving frame goes past both ends of each of some axes, at constant velocities.

    It is 0 for periodic axes and for axes without a drift. For others it is, in nodes and rounded up, as far as the
    disturbance pushes the state in an interval, or as far as the drift leads if that is less, and `BEYOND` nodes more.
    """
    grid, (drift, gain, bounds) = problem.grid, problem.dynamics.arrays
    farthest = np.minimum((np.abs(gain) * bounds).sum(axis=1), np.abs(drift).max(axis=0)) * problem.interval(0).delta
    cells = farthest / grid.spacing
    meets = drift.any(axis=0) & ~np.array(grid.periodic)
    walled = [meets[axis] and np.isfinite(cells[axis]) for axis in axes]  # what is undefined is said later
    return tuple(int(np.ceil(cells[axis])) + BEYOND if walls else 0 for axis, walls in zip(axes, walled, strict=True))


@dataclass(frozen=True)
class ObstacleFunction:
    """The obstacle function -g of an unsafe set, on the subgrid of some axes.

    Attributes
    ----------
    axes : tuple of int
        Of the problem's grid, ascending; those of the set are among them.
    values_over : callable (t0, t1) -> array
        max of -g(., t) over all t in [t0, t1], s: > 0 in what the state must not touch then, (*subgrid), read-only.
    instant : bool
        Whether `values_over` is called for each time step of the interval (view_time="instantaneous"), or once for all
        of it.
    """

    axes: Axes
    values_over: Callable[[float, float], FloatArray]
    instant: bool

    @classmethod
    def of(cls, problem: ReachAvoidProblem, unsafe_set: UnsafeSet, axes: Axes) -> "ObstacleFunction":
        """The obstacle function of an unsafe set of the problem, on `axes`, ascending, which include those of the set.

        With view_time="instantaneous" `values_over` is to be called for each time step of the interval, else once for
        the whole interval.
        """
        instant = unsafe_set.moving and problem.view_time == "instantaneous"
        view_time = "swept" if instant else problem.view_time
        grid, places = problem.grid.subgrid(axes), [axes.index(axis) for axis in unsafe_set.axes]

        # on the set's own axes in memory, of which there may be fewer
        def values_over(t0: float, t1: float) -> FloatArray:
            """max of -g over [t0, t1], s, on the subgrid: (*subgrid), a read-only view, kept on the set's own axes."""
            values = -problem.unsafe_over(unsafe_set, t0, t1, view_time=view_time)
            return np.broadcast_to(grid.lift(values, places), grid.shape)

        return cls(axes, values_over, instant)


class _OnAxes:
    """Base of games on some axes of a problem; other coordinates that enter the velocities are disturbances (App. A.4).

    A subclass has `dtype`, `solved` and `shifted`, and implements `grouped_reach_sets`, `operations`, and either
    `each_tube` or `tubes`; `reach` and `avoid` follow.

    Attributes
    ----------
    patches : bool
        Whether `grouped_reach_sets` takes a `Patch` into account.
    problem : ReachAvoidProblem
    axes : tuple of int
        Those of the problem's grid on which reach games are played.
    grid : Grid
        Their subgrid.
    counted : mapping from axes to sequence of int
        Where the grid is a window of a larger one: for games on these axes, the time steps of each input on the whole
        grid; {} otherwise.
    wanted : mapping from int to slice
        By the axis, which nodes of a window are needed; results have these nodes alone. Axes without entry: all.
    count : int
        L, the number of inputs.
    duration, early : float
        The length of the longest interval, and by how much it may end earlier, s.
    crossed : float
        The most cells that the state crosses in an interval, as `operations` has found; 0 before.
    """

    dtype: str
    patches = True  # whether `grouped_reach_sets` heeds a patch

    def __init__(
        self, problem: ReachAvoidProblem, axes: Sequence[int] | None, counted: Counted = NONE, wanted: Wanted = NONE
    ) -> None:
        """Games on `axes` of the problem's grid, None for all; counted, wanted : attributes of the class."""
        self.problem, self.counted, self.wanted = problem, counted, wanted
        self.axes: Axes = tuple(range(problem.grid.ndim)) if axes is None else tuple(axes)
        self.grid = problem.grid if axes is None else problem.grid.subgrid(axes)
        interval, self.count = problem.interval(0), len(problem.inputs)
        self.duration, self.early = interval.delta, interval.early
        self.crossed = 0.0

    def wanted_on(self, axes: Axes) -> tuple[slice, ...]:
        """For each of some axes the slice of the nodes whose values are needed, an index for a subgrid."""
        return tuple(self.wanted.get(axis, slice(None)) for axis in axes)

    def grouped_reach_sets(
        self, values: FloatArray, step: int, patch: Patch | None = None
    ) -> Iterator[Maxima | Pieces]:
        """To be implemented: yield the reach sets of all inputs, groups of successive inputs at a time.

        The reach set of an input is that of the states that it leads into {values <= 0} at the end of the interval from
        a step. Inputs whose marks are in one byte, that is with the same j // 8, are in one group.

        values : (*shape).
        patch : None, or what is to be solved: `patch.rows` is set before anything is yielded, and only these planes of
            the reach sets are right; nothing is yielded if there are none. Ignored by games without `patches`.
        """
        raise NotImplementedError

    def operations(self, axes: Axes, step: int, avoid: bool = False) -> float:
        """To be implemented: an estimate of the operations (`sdhj.problem.cost`) of all inputs in one interval.

        Raises the attribute `crossed` to the number of cells that the state crosses in the interval, if that is more.

        axes : the axes on which the game is played. step : at which the interval begins.
        avoid : whether it is an avoid game; else it is a reach game.
        """
        raise NotImplementedError

    def reach(self, values: FloatArray, step: int) -> Iterator[tuple[int, FloatArray]]:
        """Yield (j, Phi_j) for every input j in turn: the level-set function of its reach set, at the wanted nodes.

        Phi_j is at the begin of the interval from `step`; {values <= 0}, values (*shape), is the set to be in at its
        end.
        """
        return one_by_one(self.grouped_reach_sets(values, step))

    def avoid(self, unsafe_set: UnsafeSet, step: int) -> FloatArray:
        """The avoid tubes of an unsafe set over the interval from a step: (L, *subgrid of problem.avoid_axes), new."""
        return self.tubes(ObstacleFunction.of(self.problem, unsafe_set, self.problem.avoid_axes(unsafe_set)), step)

    def tubes(self, obstacle: ObstacleFunction, step: int) -> FloatArray:
        """The avoid tubes of an obstacle function over the interval from a step: (L, ...), a new array, > 0 in danger.

        ... are those nodes of the subgrid of obstacle.axes that are wanted (`no_tubes`). For each input the maximum of
        what `each_tube` yields; -inf where it yields nothing.
        """
        tubes = self.no_tubes(obstacle)
        for j, tube in self.each_tube(obstacle, step):
            np.maximum(tubes[j], tube, out=tubes[j])
        return tubes

    def no_tubes(self, obstacle: ObstacleFunction) -> FloatArray:
        """A new array for avoid tubes where nothing is to be avoided: filled with -inf.

        It is (L, *subgrid of obstacle.axes), the wanted nodes alone.
        """
        nodes = zip(self.problem.grid.subgrid(obstacle.axes).shape, self.wanted_on(obstacle.axes), strict=True)
        return np.full((self.count, *(len(range(n)[some]) for n, some in nodes)), -np.inf, self.dtype)

    def each_tube(self, obstacle: ObstacleFunction, step: int) -> Iterator[tuple[int, FloatArray]]:
        """Yield (j, part of the avoid tube of u_j) over the interval from a step; the tube is the maximum of its parts.

        A part is on the subgrid of obstacle.axes, wanted nodes alone. Inputs may come in any order, and several times.
        """
        raise NotImplementedError


class HJIGames(_OnAxes):
    """Games 1 to 3 of App. A.3 by finite differences, in the moving frame where that applies (`moving_frame`).

    Avoid tubes are computed by the Hopf-Lax formula where it applies (`uses_hopf_lax`). `_OnAxes` has the attributes;
    here also

    Attributes
    ----------
    scheme : Scheme
    dtype : str
        That of the scheme.
    solved : int
        PDEs solved so far; one in the moving frame counts once for all inputs.
    joint : bool
        Whether the reach sets avoid the unsafe sets already.
    """

    joint = False

    def __init__(
        self, problem: ReachAvoidProblem, scheme: Scheme, axes: Sequence[int] | None = None, **window: Any
    ) -> None:
        """Games on `axes` of the problem's grid, None for all, by a scheme.

        window : the keywords `counted` and `wanted`, attributes of `_OnAxes`.

        ValueError where, in the moving frame, the drift crosses more than `sdhj.solver.schemes.MOST_STEPS` cells in an
        interval.
        """
        super().__init__(problem, axes, **window)
        self.scheme, self.dtype, self.solved = scheme, scheme.dtype, 0
        self._steps: dict[tuple[Axes, int], int] = {}
        self._fields: dict[tuple[int, Axes, bool, float], Velocities] = {}
        self._bytes_left, self._begun = KEPT, problem.interval(0).begin
        self._scratch: Scratch = {}
        self._groups: dict[tuple[Axes, int | None], list[tuple[list[int], Any, int]]] = {}
        if self.moving_frame:
            checked_travel(self.grid, np.abs(self.drift).max(axis=0), self.duration)

    @property
    def drift(self) -> FloatArray:
        """The velocity under each input along the games' axes: (L, axes); only where it is constant."""
        return self.problem.dynamics.arrays[0][:, self.axes]

    @property
    def push(self) -> FloatArray:
        """max |gain_id v_d| = |gain_id| bounds_d along each of the games' axes: (axes, D); only where constant."""
        _, gain, bounds = self.problem.dynamics.arrays
        return np.abs(gain[list(self.axes)]) * bounds

    @cached_property
    def moving_frame(self) -> bool:
        """Whether games may be played in the moving frame, coordinates that move with the drift; computed once.

        There the PDE has the disturbance alone, so that one solution, shifted by the drift under each input, serves for
        all inputs. The frame applies if the scheme allows it and velocities are constant, unless some axis with a drift

        * has an unsafe end, and there is no target; or
        * has a wall, a component of v that moves several axes moves this one, and v may be stronger than the drift
          under some input.
        """
        # At a wall the shift is clipped: the state without the wall is moved back to the wall at the end of the
        # interval. This is right where the disturbance moves the axis on its own, and where the state never turns back
        # from the wall; a state that has slid along the wall and left it again is somewhere else.
        #
        # Without a target, where sets shrink away from unsafe ends step by step, finite differences are kept, because
        # tables for ever have been tested with them. On a line shifts would be better: after 30 steps of a fifth of a
        # cell, at 41 nodes, 0.067 of the set is promised wrongly by differences and 0.057 by shifts.
        if self.scheme.frame == "fixed" or not self.problem.dynamics.constant:
            return False
        wall, push = np.isfinite(self.grid.faces("holds")).any(axis=0), self.push
        several = np.count_nonzero(push > ROUNDING * push.max(initial=0.0), axis=0) > 1
        coupled = push[:, several].any(axis=1) & wall & self.drift.any(axis=0)
        shrinks = (
            self.problem.has_no_target & np.isfinite(self.grid.faces("fails")).any(axis=0) & self.drift.any(axis=0)
        )
        return not (shrinks | (coupled & (push.sum(axis=1) > np.abs(self.drift).min(axis=0)))).any()

    @cached_property
    def displacement_by_disturbance(self) -> FloatArray:
        """How far the disturbance moves a state along each axis in an interval, in the axis's unit: (axes,).

        0 along an axis for less than a cell, and along all where a component of the disturbance moves several axes.
        Computed once; only where velocities are constant.
        """
        # Differences erode narrow maxima, which are gaps between pieces of a tube; the maximum over this box keeps
        # them. Below a cell the box contains no other node, and interpolation alone would wear sets down. Where a
        # component moves several axes, not all of a box can be reached.
        far = self.push.sum(axis=1) * self.duration
        return (
            far * (far >= np.array(self.grid.spacing) * (1 - ROUNDING)) * (not self.problem.dynamics.couples(self.axes))
        )

    @property
    def shifted(self) -> bool:
        """Whether reach sets are computed in the moving frame: `moving_frame`, and intervals may not end early.

        With intervals that may end early there would be many shifts.
        """
        return self.moving_frame and not self.early

    @cached_property
    def moving_grid(self) -> tuple[Grid, tuple[int, ...]]:
        """The grid of the moving frame, and by how many nodes it goes past the ends of each axis; computed once.

        Past an end the values at the end continue: at a wall the state stays there, past a safe end it has won, and
        from an unsafe end it cannot come, which the avoid games see to.
        """
        past = past_ends(self.problem, self.axes)
        return self.grid.extended(past) if any(past) else self.grid, past

    def grouped_reach_sets(
        self, values: FloatArray, step: int, patch: Patch | None = None
    ) -> Iterator[Maxima | Pieces]:
        """As `_OnAxes.grouped_reach_sets`: yield the reach sets of all inputs, some inputs at a time.

        In the moving frame they are shifts of one PDE's solution; else each input has its PDE, on small grids all
        solved at once.

        values : (*shape); {values <= 0} is the set to be in at the end of the interval from a step.
        patch : the part to be solved, whose `rows` are set before anything is yielded; None: all.
        """
        wanted, planes = self.wanted_on(self.axes), None
        if self.shifted:
            yield from self._shifts(values, step, patch)
            return
        if patch:
            planes = patch.rows = patch.other_changes | within_stages(self.grid, patch.changed, *self._reads(step))
            if not planes.any():
                return
        if groups := self.groups(self.axes):
            self.solved += self.count
            given = self.grid, values, groups, self.duration, self.scheme
            phis = evolve_each(*given, scratch=self._scratch, planes=planes)
            yield Pieces(0, self.grid, [phis[(slice(None), *wanted)]], [tuple(range(self.grid.ndim))])
        else:
            each = ((j, self._evolve(values, j, step, planes)[wanted]) for j in range(self.count))
            yield from in_eights(self.grid, each)

    def _reads(self, step: int, still: Velocities | None = None) -> tuple[int, int]:
        """How many nodes to each side a stage reads, and how many stages the interval from a step has at most.

        `sdhj.solver.former.within_stages` takes both.

        still : the velocities of the PDE in the moving frame, if that PDE is meant; None: the PDEs of all inputs.
        """
        if still is None:
            steps = self.steps(self.axes, step)
        else:
            steps = still.steps(self.moving_grid[0], self.duration, self.scheme.cfl)
        nodes, stages = self.scheme.reads
        return nodes, steps * stages

    def operations(self, axes: Axes, step: int, avoid: bool = False) -> float:
        """As `_OnAxes.operations`: an estimate of the operations of all inputs in the interval from a step.

        They are nodes x time steps x stages, and what calls of kernels cost; in the moving frame those of one PDE, and
        the shifts.

        axes : the axes on which the game is played. avoid : whether it is an avoid game; else it is a reach game.
        """
        if avoid and self.uses_hopf_lax(axes):
            found = self.formula.operations(axes, step, avoid)
            self.crossed = max(self.crossed, self.formula.crossed)
            return found
        moving, timed = self.shifted and not avoid, self.problem.dynamics.depends_on_time
        grid = self.moving_grid[0] if moving else self.problem.grid.subgrid(axes)
        begin = self.problem.interval(step).begin
        if avoid or timed or (self.joint and not moving):
            steps = [self.steps(axes, step)] * self.count
        else:
            fields = (self._field(j, axes, step, begin, not moving) for j in range(1 if moving else self.count))
            known = None if moving else self.counted.get(axes)
            steps = list(known or [one.steps(grid, self.duration, self.scheme.cfl) for one in fields])
        together = grid.size < FEW and not (self.early or timed or (self.joint and not avoid))
        calls = sum(set(steps)) if together else sum(steps)
        self.crossed = max(self.crossed, max(steps) * self.scheme.cfl)
        more = 0.0
        if moving:
            shift = self.problem.dynamics.arrays[0][:, axes] * self.duration
            far = self.displacement_by_disturbance[None]
            more = operations(grid, shift, shift) + (operations(grid, -far, far) if far.any() else 0.0)
        if timed and sum(steps) * arranged_bytes(grid, self.scheme) > KEPT:  # velocities are laid out time and again
            more += 2 * grid.ndim * sum(steps) * grid.size
        return self.scheme.reads[1] * (sum(steps) * grid.size + calls * CALL) + more

    def _shifts(self, values: FloatArray, step: int, patch: Patch | None = None) -> Iterator[Maxima]:
        """Yield the reach sets in the moving frame: Phi_j(x) = Psi(x + delta f_j), with f_j the drift under u_j.

        Psi is the reach set under the disturbance alone: the greater of the solution by differences and of the maximum
        over the box that the disturbance moves a state in (`displacement_by_disturbance`).

        values : (*shape), the level-set function of the set to be in at the end of the interval from `step`.
        patch : the part to be solved, whose `rows` are set before anything is yielded; None: all.
        """
        (grid, past), shift, wanted = self.moving_grid, self.drift * self.duration, self.wanted_on(self.axes)
        if any(past):
            values = np.pad(out_of_danger(self.grid, np.asarray(values)), [(n, n) for n in past], "edge")
            inner = (range(n)[some] for n, some in zip(self.grid.shape, wanted, strict=True))
            wanted = tuple(slice(n + one.start, n + one.stop) for n, one in zip(past, inner, strict=True))
        pushes = self._field(0, self.axes, step, self.problem.interval(step).begin, drift=False)
        far = self.displacement_by_disturbance

        def solve(planes: FloatArray | None) -> FloatArray:
            """Psi on the grid of the moving frame, right at least in these planes (None: all); counted in `solved`."""
            self.solved += 1
            still = evolve(grid, values, pushes, self.duration, self.scheme, planes=planes)
            if far.any():  # differences would fill narrow gaps
                np.maximum(still, next(maxima(grid, values, -far[None], far[None], SHIFT)).of()[0], out=still)
            return still

        if patch:
            cells = far / grid.spacing, np.abs(shift).max(axis=0) / grid.spacing
            still = patch.solve_in_frame(solve, grid, past, self._reads(step, pushes), cells)
            if not patch.rows.any():
                return
        else:
            still = solve(None)
        yield from maxima(grid, still, shift, shift, SHIFT, wanted)

    def _evolve(self, values: FloatArray, j: int, step: int, planes: FloatArray | None = None) -> FloatArray:
        """Phi_j (*shape) at the begin of the interval from a step, by the HJI equation of game 3; counted in `solved`.

        values : (*shape) at the interval's end. j : the index of the input.
        planes : (*shape[:-2]) bool, where the solution is needed, undefined elsewhere; None: everywhere. Ignored if
            intervals may end early.
        """
        self.solved += 1
        velocities = self.velocities(j, self.axes, step)
        counts = self.counted.get(self.axes)
        steps = self.steps(self.axes, step) if callable(velocities) else counts[j] if counts else None
        given = self.grid, values, velocities, self.duration, self.scheme
        if self.early:
            return evolve_with_early_end(*given, self.early, steps=steps)
        return evolve(*given, steps=steps, planes=planes)

    def groups(self, axes: Axes, steps: int | None = None) -> list[tuple[list[int], Any, int]]:
        """All inputs in groups as `evolve_each` takes them, for games on some axes; kept for the next call.

        A group is (the numbers of the inputs that need equally many time steps, their velocities by
        `sdhj.solver.schemes.terms_of_inputs`, how many time steps that is); with `steps` all inputs are one group of so
        many. [] where inputs are to be solved one by one: where intervals may end early or velocities depend on time,
        where the grid is large, or where the velocities would take too much memory.
        """
        grid, few = self.problem.grid.subgrid(axes), self.problem.grid.subgrid(axes).size < FEW
        if (axes, steps) not in self._groups and few and not self.early and not self.problem.dynamics.depends_on_time:
            fields: list[Any] = [self.velocities(j, axes, 0) for j in range(self.count)]
            each = self.counted.get(axes) or [one.steps(grid, self.duration, self.scheme.cfl) for one in fields]
            alike = [(number, np.flatnonzero(np.equal(each, number)).tolist()) for number in sorted(set(each))]
            found = [(steps, list(range(self.count)))] if steps else alike
            little = sum(max(one.nbytes, 16 * grid.ndim * math.prod(one.shape)) for one in fields) <= GROUPED
            parts = [
                (some, terms_of_inputs(grid, [fields[j] for j in some], self.scheme), n) for n, some in found if little
            ]
            self._groups[axes, steps] = parts if all(terms is not None for _, terms, _ in parts) else []
        return self._groups.get((axes, steps), [])

    def uses_hopf_lax(self, axes: Axes) -> bool:
        """Whether the avoid tubes on some axes are computed by the Hopf-Lax formula.

        Finite differences erode the maxima of -g, so that unsafe states look safe; the formula does not. It applies in
        the moving frame, if no drift is along a bounded axis and each component of the disturbance moves one axis only:
        for others it would use the bounding box of the velocities, and would not converge. Where the state drifts along
        bounded axes it takes more pieces of the interval than differences take time steps, and would cost twice as
        much.
        """
        along = self.moving_frame and not self.drift[:, ~np.array(self.grid.periodic)].any()
        return along and not self.problem.dynamics.couples(axes)

    @cached_property
    def formula(self) -> "HopfLaxGames":
        """The games of the same problem and axes by the Hopf-Lax formula, made once; only where these exist."""
        return HopfLaxGames(self.problem, SHIFT, self.dtype, self.axes, wanted=self.wanted)

    def tubes(self, obstacle: ObstacleFunction, step: int) -> FloatArray:
        """The avoid tubes over the interval from a step, (L, *subgrid of obstacle.axes), wanted nodes alone.

        By the Hopf-Lax formula where it applies (`uses_hopf_lax`), else by differences.
        """
        if not self.uses_hopf_lax(obstacle.axes):
            return super().tubes(obstacle, step)
        return self.formula.tubes(obstacle, step)

    def each_tube(self, obstacle: ObstacleFunction, step: int) -> Iterator[tuple[int, FloatArray]]:
        """Yield (j, avoid tube of u_j) for every input, by differences with -g as obstacle; counts PDEs in `solved`.

        The tubes are on the subgrid of obstacle.axes, wanted nodes alone.
        """
        grid, steps = self.problem.grid.subgrid(obstacle.axes), self.steps(obstacle.axes, step)
        at = self.obstacle_at(obstacle, step, steps)
        keywords: dict[str, Any] = {"obstacle": at if obstacle.instant else at(0.0), "steps": steps}
        groups = [] if obstacle.instant else self.groups(obstacle.axes, steps)
        if groups:
            self.solved += self.count
            tubes = evolve_each(grid, at(0.0), groups, self.duration, self.scheme, at(0.0), self._scratch)
            yield from enumerate(tubes[(slice(None), *self.wanted_on(obstacle.axes))])
            return
        for j in range(self.count):
            self.solved += 1
            tube = evolve(
                grid, at(0.0), self.velocities(j, obstacle.axes, step), self.duration, self.scheme, **keywords
            )
            yield j, tube[self.wanted_on(obstacle.axes)]

    def obstacle_at(self, obstacle: ObstacleFunction, step: int, steps: int) -> Callable[[float], FloatArray]:
        """The obstacle function as a function of tau, s, the time left in the interval from `step`: tau -> (*subgrid).

        At each tau it is swept over the time step that begins there, of `steps` in the interval; or, where the obstacle
        is not `instant`, over the whole interval. Values are kept as long as the function.
        """
        t0, t1 = self.problem.span(step)

        @cache
        def at(tau: float) -> FloatArray:
            """max of -g over the time step that begins tau s before the interval's end; or over the whole interval."""
            if not obstacle.instant:
                return obstacle.values_over(t0, t1)
            return obstacle.values_over(t1 - tau, min(t1 - tau + self.duration / steps, t1))

        return at if obstacle.instant else lambda tau: at(0.0)

    def velocities(
        self, j: int, axes: Axes, step: int, drift: bool = True
    ) -> Velocities | Callable[[float], Velocities]:
        """The velocity set of u_j along some axes in the interval from a step, as `evolve` takes it.

        It is a `Velocities` or, if velocities depend on time, a function of tau, s, counted back from the interval's
        end, that returns one; it raises ValueError where velocities change too fast within the interval. Up to `KEPT`
        bytes of velocities are kept for the next call; if they depend on time, those of one interval.

        drift : False leaves the drift out.
        """
        interval = self.problem.interval(step)
        if not self.problem.dynamics.depends_on_time:
            return self._field(j, axes, step, interval.begin, drift)
        if interval.begin != self._begun:
            self._fields.clear()
            self._bytes_left, self._begun = KEPT, interval.begin
        return lambda tau: self._field(j, axes, step, interval.end - tau, drift)

    def _field(self, j: int, axes: Axes, step: int, t: float, drift: bool) -> Velocities:
        """The velocity set of u_j along some axes at time t, s, of the interval from a step; kept while there is room.

        drift : False leaves the drift out. ValueError if velocities change so fast within the interval that the time
            steps, which `steps` counts, are too long at t.
        """
        if (key := (j, axes, drift, t)) not in self._fields:
            field = self.problem.interval(step).velocities(j, axes, t, drift=drift)
            own = self.problem.grid.subgrid(axes)
            if (
                self.problem.dynamics.depends_on_time
                and field.steps(own, self.duration / self.steps(axes, step), 1.0) > 1
            ):
                raise too_restless_error(self.duration)
            laid_out = 0 if field.coupled else arranged_bytes(own, self.scheme)  # what the kernels read of it
            if (left_over := self._bytes_left - field.nbytes - laid_out) < 0:
                return field
            self._fields[key], self._bytes_left = field if field.coupled else field.with_terms(), left_over
        return self._fields[key]

    def steps(self, axes: Axes, step: int) -> int:
        """How many time steps of the interval from a step are enough for every input, at least 1.

        It is the most that `counted` has for these axes; else the most that the CFL condition asks for, at `INSTANTS`
        of the interval if velocities depend on time. Computed once for each interval that differs.

        axes : the axes on which the game is played.
        """
        if axes in self.counted:
            return max(1, *self.counted[axes])
        key = axes, step if self.problem.dynamics.depends_on_time else 0
        if key not in self._steps:
            grid, delta, cfl = self.problem.grid.subgrid(axes), self.duration, self.scheme.cfl
            most = 1
            for j in range(self.count):
                field, interval = self.velocities(j, axes, step), self.problem.interval(step)
                times = interval.begin + delta * INSTANTS
                fields = [interval.velocities(j, axes, t) for t in times] if callable(field) else [field]
                most = max(most, *(one.steps(grid, delta, cfl) for one in fields))
            self._steps[key] = most
        return self._steps[key]


class JointGames(HJIGames):
    """The reach-avoid game of Prop. 1 in one PDE for each input: its reach sets avoid all unsafe sets already.

    They do not avoid the unsafe ends of axes. The attributes are those of `HJIGames`.
    """

    joint = True
    patches = False

    @property
    def shifted(self) -> bool:
        """Whether the moving frame is used: as for `HJIGames`, but never with unsafe sets, which would move in it."""
        return super().shifted and not self.problem.unsafe

    def grouped_reach_sets(
        self, values: FloatArray, step: int, patch: Patch | None = None
    ) -> Iterator[Maxima | Pieces]:
        """Yield level-set functions of the reach-avoid sets (Definition 4), some inputs at a time.

        For each input a PDE is solved, with -g of the sets that are unsafe under this input as obstacle. Without unsafe
        sets they are reach sets, in the moving frame where that applies.

        values : (*shape); {values <= 0} is the set to be in at the end of the interval from a step.
        patch : ignored; all planes are solved.
        """
        problem, grid = self.problem, self.grid
        if self.shifted:
            yield from self._shifts(values, step)
            return
        steps = self.steps(self.axes, step)
        obstacles = [ObstacleFunction.of(problem, unsafe_set, unsafe_set.axes) for unsafe_set in problem.unsafe]
        unsafe = [self.obstacle_at(obstacle, step, steps) for obstacle in obstacles]

        @cache
        def union(some: tuple[int, ...], tau: float) -> FloatArray:
            """The maximum of -g over some unsafe sets, given by their positions, at tau s left: (*shape), kept."""
            values = np.full((1,) * grid.ndim, -np.inf)
            for place in some:
                values = np.maximum(values, grid.lift(unsafe[place](tau), obstacles[place].axes))
            return np.ascontiguousarray(np.broadcast_to(values, grid.shape), dtype=self.dtype)

        def solved() -> Iterator[tuple[int, FloatArray]]:
            """Yield (j, level-set function (*shape) of its reach-avoid set) for every input j; counted in `solved`."""
            for j in range(self.count):
                self.solved += 1
                velocities = self.velocities(j, self.axes, step)
                some = tuple(place for place, one in enumerate(problem.unsafe) if one.counts(j))
                instant = problem.view_time == "instantaneous"
                met: Any = None if not some else partial(union, some) if instant else union(some, 0.0)
                keywords: dict[str, Any] = {"obstacle": met, "steps": steps}
                yield (
                    j,
                    evolve_with_early_end(grid, values, velocities, self.duration, self.scheme, self.early, **keywords),
                )

        yield from in_eights(grid, solved())


class HopfLaxGames(_OnAxes):
    """Games 1 to 3 of App. A.3 by the Hopf-Lax formula (`sdhj.solver.hopf_lax`), exact up to interpolation.

    The velocity set must not depend on the state. A component of v that moves several axes moves the state along a
    segment; where `Interval.segments` has none for it, the bounding box of the velocities is used, which is
    conservative.

    `_OnAxes` has the attributes; here also

    Attributes
    ----------
    interpolation : {"limited", "linear"}
    dtype : {"float32", "float64"}
    cells : (ndim,) array
        How many cells the state crosses along each axis of the problem's grid in an interval, at most.
    """

    solved = 0  # a formula in place of PDEs
    shifted = True  # as `HJIGames.shifted`

    def __init__(
        self, problem: ReachAvoidProblem, interpolation: str, dtype: str, axes: Any = None, **window: Any
    ) -> None:
        """Games on `axes` of the problem's grid, None for all; the other arguments are attributes of the class.

        window : the keywords `counted`, which is not used, and `wanted`, attributes of `_OnAxes`.

        ValueError where velocities depend on the state, cross more than `sdhj.solver.schemes.MOST_STEPS` cells in an
        interval, or change too fast within an interval.
        """
        super().__init__(problem, axes, **window)
        if not problem.dynamics.stateless:
            raise ValueError('method="lax" needs velocities that do not depend on the state; use method="hji"')
        self.interpolation, self.dtype = interpolation, dtype
        timed, speed = problem.dynamics.depends_on_time, np.zeros(problem.grid.ndim)
        for interval in (problem.interval(step) for step in range(problem.steps if timed else 1)):
            for t in interval.begin + self.duration * (INSTANTS if timed else INSTANTS[:1]):
                speed = np.maximum(speed, np.abs(interval.extremes(float(t))).max(axis=(0, 1)))
            parts = (0, self.duration), (0, self.duration / 2), (self.duration / 2, self.duration)
            whole, first, second = (np.array(interval.displacement_boxes(*part)) for part in parts)
            if (np.abs(whole - first - second) > np.array(problem.grid.spacing) / 100).any():
                raise too_restless_error(self.duration)
        self.cells = checked_travel(problem.grid, speed, self.duration)
        self._about: tuple[Interval | None, dict[Any, Any]] = None, {}

    def _kept_for_interval(self, interval: Interval, key: Any, find: Callable[[], T]) -> T:
        """The value of `find()`, computed once for each `key` and kept until another interval is asked for.

        Where velocities do not depend on time all steps have one interval. key : hashable, what the value depends on
        besides the interval.
        """
        if self._about[0] is not interval:
            self._about = interval, {}
        if key not in self._about[1]:
            self._about[1][key] = find()
        found: T = self._about[1][key]
        return found

    @property
    def reads(self) -> FloatArray:
        """How many cells along each axis of the problem's grid values are read at most: (ndim,).

        Each segment of the disturbance interpolates on its own, and so reads two nodes more.
        """
        return self.cells + 2 * self.problem.interval(0).segments(self.axes).shape[1]

    def grouped_reach_sets(
        self, values: FloatArray, step: int, patch: Patch | None = None
    ) -> Iterator[Maxima | Pieces]:
        """As `_OnAxes.grouped_reach_sets`: yield the reach sets of all inputs, some inputs at a time.

        They are maxima of `values` over the set that each input leads to at the end of the interval from a step; or,
        where the interval may end early, over a hull of the sets at all times at which it may end.

        values : (*shape); {values <= 0} is the set to be in at the end of the interval from a step.
        patch : the part to be solved, whose `rows` are set before anything is yielded; None: all.
        """
        if patch:
            patch.rows = patch.other_changes | within_boxes(self.grid, patch.changed, self.reads)
            if not patch.rows.any():
                return
        interval, parts = self.problem.interval(step), self.pieces(list(self.axes), self.early / self.duration)
        ends = (self.duration - self.early * np.linspace(0.0, 1.0, parts + 1 if self.early else 1)).tolist()
        some = list(self.axes)
        path = self._kept_for_interval(
            interval, "path", lambda: [self._displacement_sets(interval, some, [end]) for end in ends]
        )
        values, wanted = np.asarray(values, self.dtype), self.wanted_on(self.axes)
        if self.early:
            yield from in_eights(self.grid, maximum_over_paths(self.grid, values, path, self.interpolation, wanted))
        else:
            yield from maxima_over_sets(self.grid, values, path[0], self.interpolation, wanted)

    def tubes(self, obstacle: ObstacleFunction, step: int) -> FloatArray:
        """The avoid tubes over the interval from a step: (L, *subgrid of obstacle.axes), wanted nodes alone, new.

        For each input the maximum of -g over all that the state may reach in the interval, one piece of it after
        another.
        """
        tubes = self.no_tubes(obstacle)
        for some in self._tube_maxima(obstacle, step):
            some.of(into=tubes[some.first : some.first + some.number], raised=True)
        return tubes

    def _tube_maxima(self, obstacle: ObstacleFunction, step: int) -> Iterator[Maxima]:
        """Yield, for each piece of the interval from a step, the maxima of -g over all that the state may reach in it.

        They come some inputs at a time, over a box and segments for each input. Tells the meter of each piece (`tick`).
        """
        problem, axes, wanted = self.problem, list(obstacle.axes), self.wanted_on(obstacle.axes)
        grid, pieces, interval = problem.grid.subgrid(axes), self.pieces(axes), problem.interval(step)
        times = problem.span(step)[0] + self.duration * np.arange(pieces + 1) / pieces
        whole = None if obstacle.instant else obstacle.values_over(times[0], times[-1])
        for piece in range(pieces):  # what moves within a piece is covered by its swept volume
            values = obstacle.values_over(float(times[piece]), float(times[piece + 1])) if whole is None else whole
            moved, cost = self._displacement_sets_in_piece(interval, axes, piece, pieces)
            yield from maxima_over_sets(grid, values.astype(self.dtype), moved, self.interpolation, wanted)
            tick(cost)

    def _displacement_sets_in_piece(
        self, interval: Interval, axes: list[int], piece: int, pieces: int
    ) -> tuple[Moved, float]:
        """For each input a box and segments that hold all its displacements in one piece of an interval, and a cost.

        The cost is that of maxima over all of them, in operations, for the progress bar. Both are kept
        (`_kept_for_interval`).

        piece : which of `pieces` equal pieces, from 0 on.
        axes : the axes of the problem's grid along which displacements are returned, in this order.
        """

        def find() -> tuple[Moved, float]:
            """The sets and the cost, computed anew."""
            ends = (
                self.duration
                * np.linspace(piece, piece + 1, 5 if self.problem.dynamics.depends_on_time else 2)
                / pieces
            )
            moved = self._displacement_sets(interval, axes, ends.tolist())
            return moved, _operations(self.problem.grid.subgrid(axes), moved) + A_PIECE

        return self._kept_for_interval(interval, (*axes, piece, pieces), find)

    def _displacement_sets(self, interval: Interval, axes: list[int], ends: list[float]) -> Moved:
        """For each input a box and segments whose sum holds its displacements at all times in `ends`.

        axes : the axes of the problem's grid along which displacements are returned, in this order.
        ends : s from the interval's begin, ascending, at least one.
        """
        boxes = np.array([interval.displacement_boxes(0.0, end) for end in ends])[..., axes]
        halves = interval.segments(axes)
        farthest = np.array(ends)[:, None, None] * np.abs(halves).sum(axis=1)
        low, high = narrowed(boxes[:, 0], boxes[:, 1], farthest)
        return Moved(low.min(axis=0), high.max(axis=0), ends[-1] * halves)

    def operations(self, axes: Axes, step: int, avoid: bool = False) -> float:
        """As `_OnAxes.operations`: an estimate of the operations of all inputs in the interval from a step.

        It is the mean of `PIECES_COUNTED` pieces of the interval, times the number of pieces. `crossed` is set here,
        also if it was larger.

        axes : the axes on which the game is played. avoid : whether it is an avoid game; else it is a reach game.
        """
        some, interval, self.crossed = list(axes), self.problem.interval(step), float(self.cells.max())
        grid, pieces = self.problem.grid.subgrid(axes), self.pieces(some, 1.0 if avoid else self.early / self.duration)
        if not avoid and not self.early:
            return _operations(grid, self._displacement_sets(interval, some, [self.duration])) + A_PIECE
        looked = np.unique(np.linspace(0, pieces - 1, PIECES_COUNTED).astype(int)).tolist()
        each = [self._displacement_sets_in_piece(interval, some, piece, pieces)[1] for piece in looked]
        return pieces * float(np.mean(each))

    def pieces(self, axes: list[int], share: float = 1.0) -> int:
        """Into how many pieces a share, 0 to 1, of the interval is cut, at least 1.

        So many that in each the state moves at most a quarter of a cell along any of `axes`.
        """
        return max(1, int(np.ceil(self.cells[axes].max() * 4 * share)))


def _operations(grid: Grid, moved: Moved) -> float:
    """The operations (`sdhj.problem.cost`) of taking maxima on `grid` over the boxes and segments of all inputs."""
    each = [crossings(half / grid.spacing) * grid.spacing for first, _ in moved.runs() for half in moved.halves[first]]
    return operations(grid, moved.low, moved.high) + sum(operations(grid, points, points) for points in each)
