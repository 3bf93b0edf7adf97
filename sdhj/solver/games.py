"""The differential games of one sampling interval (Sec. 4.1, App. A.3), solved for each input.

For the interval that starts at step k, and for every input u_j held over it, the games of a method compute

* `reach(values, step)`: level-set functions of the reach sets of {values <= 0} (Definition 2; game 3);
* `avoid(unsafe_set, step)`: level-set functions of the avoid tubes of one unsafe set (Definition 3; games 1 and 2),
  solved on the axes that set depends on.

The reach-avoid set of u_j is the intersection, max(reach, avoid).
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import groupby
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np

from sdhj.common.remembering import FloatArray
from sdhj.kernels.union import EIGHT
from sdhj.problem.boxes import Maxima, maxima, one_by_one, out_of_danger
from sdhj.problem.grid import Grid
from sdhj.problem.interval import INSTANTS, ROUNDING, Interval, narrowed
from sdhj.problem.samples import Samples
from sdhj.problem.sets import UnsafeSet
from sdhj.problem.velocities import Velocities, checked_travel
from sdhj.solver.hopf_lax import Moved, maxima_over_sets
from sdhj.solver.schemes import (
    Scheme,
    arranged_bytes,
    evolve,
    evolve_with_early_end,
    too_restless_error,
)

KEPT = 256_000_000  # bytes of sampled velocities that the games keep; `bytes_of_entry` counts them
BEYOND = 4  # nodes past what the disturbance brings to the ends of the moving frame: errors there fall tenfold per node
SHIFT = "limited"  # how the moving frame is brought back: no less accurate than the differences it serves
Axes = tuple[int, ...]
T = TypeVar("T")


class Games(Protocol):
    """The interface of a method for the recursion: the games of one interval, for each input.

    Games may also have

    * `grouped_reach_sets(values, step)`: reach sets come some inputs at a time, and are made where they are read, at
      the nodes of the grid without its padding (`sdhj.problem.boxes`); then `avoid` has a third argument `out`, the
      array to write to;
    * `apart` = True: inputs can be asked for, ascending, as a last argument of `grouped_reach_sets` and of `avoid`.
    """

    @property
    def dtype(self) -> str:
        """The dtype of the values of level-set functions, "float32" or "float64"."""

    @property
    def solved(self) -> int:
        """How many PDEs have been solved so far; 0 for games by a formula."""

    def reach(self, values: FloatArray, step: int) -> Iterator[tuple[int, FloatArray]]:
        """Yield (j, Phi_j (*shape)) for each input j in turn: the reach set of {values <= 0} (Definition 2).

        That is, of the states that u_j leads into it by the interval's end, without regard to the unsafe sets.
        """

    def avoid(self, unsafe_set: UnsafeSet, step: int) -> FloatArray:
        """The avoid tube of an unsafe set over the interval from a step for each input: <= 0 where it stays clear.

        (L, *subgrid of samples.avoid_axes(unsafe_set.axes)).
        """


class Pieces(NamedTuple):
    """The reach sets of successive inputs, each the minimum of level-set functions on some axes, its pieces."""

    first: int  # number of the first input
    shape: Sequence[int]  # of the whole grid
    pieces: Sequence[FloatArray]  # for each subspace (inputs, *subgrid)
    axes: Sequence[Axes]  # of each subspace, ascending; one with all axes means that the functions are written out
    # what several pieces are views of, one after the other, with `PAST` numbers more that `add_inputs` may read
    flat: FloatArray | None = None

    @property
    def number(self) -> int:
        """How many inputs these are."""
        return len(self.pieces[0])

    def of(self, some: slice = slice(None)) -> FloatArray:
        """The level-set functions of some of these inputs, counted from `first`: (inputs, *shape).

        A view where there is one piece on all axes.
        """
        if len(self.axes[0]) == len(self.shape):
            return self.pieces[0][some]
        pieces = [piece[some] for piece in self.pieces]
        return united(pieces, self.axes, np.empty((len(pieces[0]), *self.shape), pieces[0].dtype))


def united(pieces: Sequence[FloatArray], axes: Sequence[Axes], out: FloatArray) -> FloatArray:
    """Write the minimum of `pieces` (L, *subgrid of its `axes`) into `out` (L, *shape), and return it."""
    for j, total in enumerate(out):
        lengths = ([n if axis in keep else 1 for axis, n in enumerate(total.shape)] for keep in axes)
        first, *others = (piece[j].reshape(one) for piece, one in zip(pieces, lengths, strict=True))
        # of one piece there is no minimum to take
        if not others:
            total[...] = first
        for other in others:
            np.minimum(first, other, out=total)
            first = total
    return out


def in_eights(reach_sets: Iterable[tuple[int, FloatArray]]) -> Iterator[Pieces]:
    """Yield reach sets (j, values), ascending, stacked to `Pieces`: the inputs whose marks are in one byte."""
    # a run also ends where an input is left out, as `Pieces` has the first number alone
    for _, run in groupby(enumerate(reach_sets), key=lambda one: (one[1][0] // EIGHT, one[1][0] - one[0])):
        inputs, values = zip(*(found for _, found in run), strict=True)
        yield Pieces(inputs[0], values[0].shape, [np.stack(values)], [tuple(range(values[0].ndim))])


def nodes_past_ends(samples: Samples, axes: Sequence[int]) -> tuple[int, ...]:
    """By how many nodes the grid of the moving frame goes past both ends of each of some axes.

    That is as far as the disturbance pushes the state in an interval, or the drift leads if that is less, and `BEYOND`
    more; 0 for periodic axes and for those without a drift.
    """
    # `bytes_of_entry` asks it as well, so that the memory of this grid is counted
    grid, (drift, gain, bounds) = samples.grid, samples.dynamics.arrays
    farthest = np.minimum((np.abs(gain) * bounds).sum(axis=1), np.abs(drift).max(axis=0)) * samples.interval(0).delta
    cells = farthest / grid.spacing
    meets = drift.any(axis=0) & ~np.array(grid.periodic)
    walled = [meets[axis] and np.isfinite(cells[axis]) for axis in axes]  # what is undefined is said later
    return tuple(int(np.ceil(cells[axis])) + BEYOND if walls else 0 for axis, walls in zip(axes, walled, strict=True))


@dataclass(frozen=True)
class ObstacleFunction:
    """The obstacle function -g of an unsafe set, on the subgrid of `axes`, those of the set among them."""

    axes: Axes  # of the problem's grid, ascending
    # max of -g(., t) over t in [t0, t1], s: (*subgrid), read-only, > 0 in what must not be touched
    values_over: Callable[[float, float], FloatArray]
    # whether to ask for each time step of the interval (view_time="instantaneous"), or once for all of it
    instant: bool

    @classmethod
    def of(cls, samples: Samples, unsafe_set: UnsafeSet, axes: Axes) -> "ObstacleFunction":
        """The obstacle function of an unsafe set, on ascending `axes` that include those of the set."""
        instant = unsafe_set.moving and samples.problem.view_time == "instantaneous"
        view_time = "swept" if instant else None
        grid, places = samples.grid.subgrid(axes), [axes.index(axis) for axis in unsafe_set.axes]

        # on the set's own axes in memory, of which there may be fewer
        def values_over(t0: float, t1: float) -> FloatArray:
            return np.broadcast_to(grid.lift(-samples.sample(unsafe_set, t0, t1, view_time), places), grid.shape)

        return cls(axes, values_over, instant)


class _OnAxes:
    """Base of games on some axes; other coordinates that enter the velocities are disturbances (App. A.4).

    A subclass has `dtype`, `solved` and `shifted`, and implements `grouped_reach_sets` and `write_tubes`; `reach` and
    `avoid` follow.
    """

    dtype: str

    def __init__(self, samples: Samples, axes: Sequence[int] | None) -> None:
        self.samples = samples
        self.axes: Axes = tuple(range(samples.grid.ndim)) if axes is None else tuple(axes)
        self.grid = samples.grid if axes is None else samples.grid.subgrid(axes)
        interval, self.count = samples.interval(0), len(samples.problem.inputs)
        self.duration, self.early = interval.delta, interval.early

    def grouped_reach_sets(self, values: FloatArray, step: int) -> Iterator[Maxima | Pieces]:
        """To be implemented: yield the reach sets of {values <= 0}, some successive inputs at a time.

        Inputs come ascending, at the nodes of the grid without its padding; those whose marks are in one byte together,
        or one by one where segments differ: `add_inputs` adds bits to a byte that has been begun.
        """
        raise NotImplementedError

    def reach(self, values: FloatArray, step: int) -> Iterator[tuple[int, FloatArray]]:
        """As `Games.reach`, without a padding."""
        return one_by_one(self.grouped_reach_sets(values, step))

    def avoid(
        self, unsafe_set: UnsafeSet, step: int, out: FloatArray | None = None, some: Sequence[int] | None = None
    ) -> FloatArray:
        """As `Games.avoid`, in `out` or a new array, of `some` inputs or of all."""
        axes = self.samples.avoid_axes(unsafe_set.axes)
        return self.tubes(ObstacleFunction.of(self.samples, unsafe_set, axes), step, out, some)

    def tubes(
        self,
        obstacle: ObstacleFunction,
        step: int,
        out: FloatArray | None = None,
        some: Sequence[int] | None = None,
    ) -> FloatArray:
        """The avoid tubes over the interval from a step: (inputs, *subgrid of obstacle.axes), as `avoid` has them."""
        inputs = range(self.count) if some is None else some
        if out is None:
            out = np.empty((len(inputs), *self.samples.grid.subgrid(obstacle.axes).shape), self.dtype)
        self.write_tubes(obstacle, step, out, inputs)
        return out

    def write_tubes(self, obstacle: ObstacleFunction, step: int, out: FloatArray, inputs: Sequence[int]) -> None:
        """To be implemented: write the avoid tubes of some inputs over the interval from a step to `out`."""
        raise NotImplementedError


class HJIGames(_OnAxes):
    """Games 1 to 3 of App. A.3 by finite differences, or by shifts and the Hopf-Lax formula where these apply.

    ValueError where, in the moving frame, the drift crosses more than `sdhj.problem.velocities.MOST_STEPS` cells in an
    interval.
    """

    def __init__(self, samples: Samples, scheme: Scheme, axes: Sequence[int] | None = None) -> None:
        super().__init__(samples, axes)
        # a PDE in the moving frame counts once for all inputs
        self.scheme, self.dtype, self.solved = scheme, scheme.dtype, 0
        self._steps: dict[tuple[Axes, int], int] = {}
        self._fields: dict[tuple[int, Axes, bool, float], Velocities] = {}
        self._bytes_left, self._begun = KEPT, samples.interval(0).begin
        if self.moving_frame:
            checked_travel(self.grid, np.abs(self.drift).max(axis=0), self.duration)

    @property
    def drift(self) -> FloatArray:
        """The velocity under each input along the games' axes, which is constant: (L, axes)."""
        return self.samples.dynamics.arrays[0][:, self.axes]

    @property
    def push(self) -> FloatArray:
        """max |gain_id v_d| along each of the games' axes, where constant: (axes, D)."""
        _, gain, bounds = self.samples.dynamics.arrays
        return np.abs(gain[list(self.axes)]) * bounds

    @cached_property
    def moving_frame(self) -> bool:
        """Whether games may be played in the moving frame, coordinates that move with the drift.

        There the PDE has the disturbance alone, so that one solution, shifted by the drift under each input, serves for
        all inputs. The frame applies if the scheme allows it and velocities are constant, unless some axis with a drift

        * has an unsafe end, and there is no target; or
        * has a wall, a component of v that moves several axes moves this one, and v may be stronger than the drift.
        """
        # At a wall the shift is clipped: the state without the wall is moved back to the wall at the end of the
        # interval. This is right where the disturbance moves the axis on its own, and where the state never turns back
        # from the wall; a state that has slid along the wall and left it again is somewhere else.
        #
        # Without a target, where sets shrink away from unsafe ends step by step, finite differences are kept, though on
        # a line shifts would be better: after 30 steps of a fifth of a cell, at 41 nodes, 0.067 of the set is promised
        # wrongly by differences and 0.057 by shifts.
        if self.scheme.frame == "fixed" or not self.samples.dynamics.constant:
            return False
        wall, push = np.isfinite(self.grid.faces("holds")).any(axis=0), self.push
        several = np.count_nonzero(push > ROUNDING * push.max(initial=0.0), axis=0) > 1
        coupled = push[:, several].any(axis=1) & wall & self.drift.any(axis=0)
        shrinks = (
            self.samples.problem.has_no_target
            & np.isfinite(self.grid.faces("fails")).any(axis=0)
            & self.drift.any(axis=0)
        )
        return not (shrinks | (coupled & (push.sum(axis=1) > np.abs(self.drift).min(axis=0)))).any()

    @cached_property
    def displacement_by_disturbance(self) -> FloatArray:
        """How far the disturbance moves a state along each axis in an interval: (axes,)."""
        # Differences erode narrow maxima, which are gaps between pieces of a tube; the maximum over this box keeps
        # them. Below a cell the box contains no other node, and interpolation alone would wear sets down. Where a
        # component moves several axes, not all of a box can be reached.
        far = self.push.sum(axis=1) * self.duration
        return (
            far * (far >= np.array(self.grid.spacing) * (1 - ROUNDING)) * (not self.samples.dynamics.couples(self.axes))
        )

    @property
    def shifted(self) -> bool:
        """Whether reach sets are computed in the moving frame; intervals that may end early would need many shifts."""
        return self.moving_frame and not self.early

    @cached_property
    def moving_grid(self) -> tuple[Grid, tuple[int, ...]]:
        """The grid of the moving frame, and by how many nodes it goes past the ends of each axis."""
        past = nodes_past_ends(self.samples, self.axes)
        # Past an end the values at the end continue: at a wall the state stays there, past a safe end it has won, and
        # from an unsafe end it cannot come, which the avoid games see to.
        return self.grid.wider([(n, n) for n in past]) if any(past) else self.grid, past

    @property
    def apart(self) -> bool:
        """Whether each input has games of its own, so that some can be asked for in `grouped_reach_sets`."""
        return not self.shifted

    def grouped_reach_sets(
        self, values: FloatArray, step: int, some: Sequence[int] | None = None
    ) -> Iterator[Maxima | Pieces]:
        """As `_OnAxes.grouped_reach_sets`, of `some` inputs where they are `apart`."""
        if self.shifted:
            yield from self._shifts(values, step)
        else:
            # without the padding, as `InputRows` has the nodes of the problem's grid
            inner, inputs = self.grid.inner, range(self.count) if some is None else some
            yield from in_eights((j, self._evolve(values, j, step)[inner]) for j in inputs)

    def _shifts(self, values: FloatArray, step: int) -> Iterator[Maxima]:
        """Yield the reach sets in the moving frame: Phi_j(x) = Psi(x + delta f_j), with f_j the drift under u_j.

        Psi is the reach set under the disturbance alone: the greater of the solution by differences and of the maximum
        over the box of `displacement_by_disturbance`.
        """
        (grid, past), shift, inner = self.moving_grid, self.drift * self.duration, self.grid.inner
        if any(past):
            values = np.pad(out_of_danger(self.grid, np.asarray(values)), [(n, n) for n in past], "edge")
            nodes = (range(n)[some] for n, some in zip(self.grid.shape, inner, strict=True))
            inner = tuple(slice(n + some.start, n + some.stop) for n, some in zip(past, nodes, strict=True))
        # input 0 stands for all: without the drift, gain and bounds are those of every input
        pushes = self._field(0, self.axes, step, self.samples.interval(step).begin, drift=False)
        far = self.displacement_by_disturbance

        self.solved += 1
        still = evolve(grid, values, pushes, self.duration, self.scheme)
        if far.any():  # differences would fill narrow gaps
            np.maximum(still, next(maxima(grid, values, -far[None], far[None], SHIFT)).of()[0], out=still)
        yield from maxima(grid, still, shift, shift, SHIFT, inner)

    def _evolve(self, values: FloatArray, j: int, step: int) -> FloatArray:
        """Phi_j at the begin of the interval from a step, by the HJI equation of game 3."""
        self.solved += 1
        velocities = self.velocities(j, self.axes, step)
        # where they depend on time; else `evolve` counts the time steps of this input by itself
        steps = self.steps(self.axes, step) if callable(velocities) else None
        given = self.grid, values, velocities, self.duration, self.scheme
        if self.early:
            return evolve_with_early_end(*given, self.early, steps=steps)
        return evolve(*given, steps=steps)

    def uses_hopf_lax(self, axes: Axes) -> bool:
        """Whether the avoid tubes on some axes are computed by the Hopf-Lax formula.

        It applies in the moving frame, if no drift is along a bounded axis and each component of v moves one axis only.
        """
        # Finite differences erode the maxima, so that unsafe states look safe. For components that move several axes
        # the formula would use the bounding box of the velocities, and not converge. Where the state drifts along
        # bounded axes it takes more pieces of the interval than differences take time steps, and would cost twice as
        # much.
        along = self.moving_frame and not self.drift[:, ~np.array(self.grid.periodic)].any()
        return along and not self.samples.dynamics.couples(axes)

    @cached_property
    def formula(self) -> "HopfLaxGames":
        """The games of the same problem and axes by the Hopf-Lax formula, where these exist."""
        return HopfLaxGames(self.samples, SHIFT, self.dtype, self.axes)

    def write_tubes(self, obstacle: ObstacleFunction, step: int, out: FloatArray, inputs: Sequence[int]) -> None:
        """As `_OnAxes.write_tubes`: by the Hopf-Lax formula where it applies, else by differences, -g as obstacle."""
        if self.uses_hopf_lax(obstacle.axes):
            self.formula.write_tubes(obstacle, step, out, inputs)
            return
        grid, steps = self.samples.grid.subgrid(obstacle.axes), self.steps(obstacle.axes, step)
        least = self.obstacle_at(obstacle, step, steps)
        # of the interval's end, tau = 0, from which the PDE begins
        first = least(0.0) if callable(least) else least
        for j, tube in zip(inputs, out, strict=True):
            self.solved += 1
            velocities = self.velocities(j, obstacle.axes, step)
            tube[...] = evolve(grid, first, velocities, self.duration, self.scheme, obstacle=least, steps=steps)

    def obstacle_at(
        self, obstacle: ObstacleFunction, step: int, steps: int
    ) -> FloatArray | Callable[[float], FloatArray]:
        """The obstacle function in the interval from `step` as `evolve` takes it: (*subgrid), swept over all of it.

        If `instant` it is a function of tau, s, the time left, swept over the time step of `steps` that begins there.
        """
        t0, t1 = self.samples.problem.span(step)
        if not obstacle.instant:
            return obstacle.values_over(t0, t1)
        # kept, as the PDEs of all inputs ask for the same tau
        return cache(lambda tau: obstacle.values_over(t1 - tau, min(t1 - tau + self.duration / steps, t1)))

    def velocities(
        self, j: int, axes: Axes, step: int, drift: bool = True
    ) -> Velocities | Callable[[float], Velocities]:
        """The velocity set of u_j along some axes in the interval from a step, as `evolve` takes it.

        If velocities depend on time it is a function of tau, s, counted back from the interval's end.
        """
        interval = self.samples.interval(step)
        if not self.samples.dynamics.depends_on_time:
            return self._field(j, axes, step, interval.begin, drift)
        # velocities of one interval are kept
        if interval.begin != self._begun:
            self._fields.clear()
            self._bytes_left, self._begun = KEPT, interval.begin
        return lambda tau: self._field(j, axes, step, interval.end - tau, drift)

    def _field(self, j: int, axes: Axes, step: int, t: float, drift: bool) -> Velocities:
        """The velocity set of u_j along some axes at time t of the interval from a step; `KEPT` bytes are kept."""
        if (key := (j, axes, drift, t)) not in self._fields:
            field = self.samples.interval(step).velocities(j, axes, t, drift=drift)
            own = self.samples.grid.subgrid(axes)
            if (
                self.samples.dynamics.depends_on_time
                and field.steps(own, self.duration / self.steps(axes, step), 1.0) > 1
            ):
                # the time steps, which were counted at some instants, are too long at t
                raise too_restless_error(self.duration)
            laid_out = 0 if field.coupled else arranged_bytes(own, self.scheme)  # what the kernels read of it
            if (left_over := self._bytes_left - field.nbytes - laid_out) < 0:
                return field
            self._fields[key], self._bytes_left = field if field.coupled else replace(field, terms={}), left_over
        return self._fields[key]

    def steps(self, axes: Axes, step: int) -> int:
        """The most time steps that the CFL condition asks for under any input in the interval from a step."""
        key = axes, step if self.samples.dynamics.depends_on_time else 0
        if key not in self._steps:
            grid, delta, cfl = self.samples.grid.subgrid(axes), self.duration, self.scheme.cfl
            most = 1
            for j in range(self.count):
                field, interval = self.velocities(j, axes, step), self.samples.interval(step)
                # where velocities do not depend on time, one instant is enough
                times = interval.begin + delta * INSTANTS
                fields = [interval.velocities(j, axes, t) for t in times] if callable(field) else [field]
                most = max(most, *(one.steps(grid, delta, cfl) for one in fields))
            self._steps[key] = most
        return self._steps[key]


class HopfLaxGames(_OnAxes):
    """Games 1 to 3 of App. A.3 by the Hopf-Lax formula (`sdhj.solver.hopf_lax`), exact up to interpolation.

    A component of v that moves several axes moves the state along a segment; where `Interval.segments` has none for it,
    the bounding box of the velocities is used, which is conservative.
    """

    solved = 0  # a formula in place of PDEs
    shifted = True  # as `HJIGames.shifted`

    def __init__(self, samples: Samples, interpolation: str, dtype: str, axes: Any = None) -> None:
        super().__init__(samples, axes)
        if not samples.dynamics.stateless:
            raise ValueError('method="lax" needs velocities that do not depend on the state; use method="hji"')
        self.interpolation, self.dtype = interpolation, dtype
        timed, speed = samples.dynamics.depends_on_time, np.zeros(samples.grid.ndim)
        for interval in (samples.interval(step) for step in range(samples.problem.steps if timed else 1)):
            for t in interval.begin + self.duration * (INSTANTS if timed else INSTANTS[:1]):
                speed = np.maximum(speed, np.abs(interval.extremes(float(t))).max(axis=(0, 1)))
            parts = (0, self.duration), (0, self.duration / 2), (self.duration / 2, self.duration)
            whole, first, second = (np.array(interval.displacement_boxes(*part)) for part in parts)
            # What the whole and its two halves differ by, instants have missed.
            if (np.abs(whole - first - second) > np.array(samples.grid.spacing) / 100).any():
                raise too_restless_error(self.duration)
        # crossed along each axis of the samples' grid in an interval
        self.cells = checked_travel(samples.grid, speed, self.duration)
        self._about: tuple[Interval | None, dict[Any, Any]] = None, {}

    def _kept_for_interval(self, interval: Interval, key: Any, find: Callable[[], T]) -> T:
        """The value of `find()`, kept under `key` until another interval is asked for."""
        # where velocities do not depend on time all steps have one interval
        if self._about[0] is not interval:
            self._about = interval, {}
        if key not in self._about[1]:
            self._about[1][key] = find()
        found: T = self._about[1][key]
        return found

    def grouped_reach_sets(self, values: FloatArray, step: int) -> Iterator[Maxima | Pieces]:
        """Maxima of `values` over the set that each input leads to."""
        interval, axes = self.samples.interval(step), list(self.axes)
        # at one time: a reach set asks where a state is at the interval's end
        moved = self._kept_for_interval(
            interval, "reach", lambda: self._displacement_sets(interval, axes, [self.duration])
        )
        yield from maxima_over_sets(
            self.grid, np.asarray(values, self.dtype), moved, self.interpolation, self.grid.inner
        )

    def write_tubes(self, obstacle: ObstacleFunction, step: int, out: FloatArray, inputs: Sequence[int]) -> None:
        """As `_OnAxes.write_tubes`: maxima of -g over all that the state may reach, one piece of time after another."""
        # with raised=True what is greater stays: so it begins with the least
        out.fill(-np.inf)
        for some in self._tube_maxima(obstacle, step, inputs):
            some.of(into=out[some.first : some.first + some.number], raised=True)

    def _tube_maxima(self, obstacle: ObstacleFunction, step: int, inputs: Sequence[int]) -> Iterator[Maxima]:
        """Yield the maxima of -g over all that the state may reach in each piece, under inputs counted anew from 0."""
        samples, axes = self.samples, list(obstacle.axes)
        grid, pieces, interval = samples.grid.subgrid(axes), self.parts_of_interval(axes), samples.interval(step)
        times = samples.problem.span(step)[0] + self.duration * np.arange(pieces + 1) / pieces
        whole = None if obstacle.instant else obstacle.values_over(times[0], times[-1])
        for piece in range(pieces):  # what moves within a piece is covered by its swept volume
            values = obstacle.values_over(float(times[piece]), float(times[piece + 1])) if whole is None else whole
            moved = self._displacement_sets_in_piece(interval, axes, piece, pieces)
            some = Moved(*(part[list(inputs)] for part in moved))
            yield from maxima_over_sets(grid, values.astype(self.dtype), some, self.interpolation)

    def _displacement_sets_in_piece(self, interval: Interval, axes: list[int], piece: int, pieces: int) -> Moved:
        """For each input a box and segments that hold all its displacements in one piece of an interval."""
        parts = 5 if self.samples.dynamics.depends_on_time else 2
        ends = (self.duration * np.linspace(piece, piece + 1, parts) / pieces).tolist()
        return self._kept_for_interval(
            interval, (*axes, piece, pieces), lambda: self._displacement_sets(interval, axes, ends)
        )

    def _displacement_sets(self, interval: Interval, axes: list[int], ends: list[float]) -> Moved:
        """For each input a box and segments along `axes` whose sum holds its displacements at all times in `ends`.

        `ends` are in s from the interval's begin, ascending.
        """
        boxes = np.array([interval.displacement_boxes(0.0, end) for end in ends])[..., axes]
        halves = interval.segments(axes)
        farthest = np.array(ends)[:, None, None] * np.abs(halves).sum(axis=1)
        low, high = narrowed(boxes[:, 0], boxes[:, 1], farthest)
        return Moved(low.min(axis=0), high.max(axis=0), ends[-1] * halves)

    def parts_of_interval(self, axes: list[int]) -> int:
        """Into how many pieces the interval is cut, in each of which the state moves at most a quarter of a cell."""
        return max(1, int(np.ceil(self.cells[axes].max() * 4)))
