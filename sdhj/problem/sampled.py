"""A problem's level-set functions, of target and unsafe sets, at the nodes of its grid and at any state."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from itertools import pairwise
from typing import Any, Self
from weakref import WeakValueDictionary

import numpy as np

from sdhj.formulas.formula import Formula
from sdhj.kernels import FloatArray, read_only
from sdhj.problem.checks import number, points_array
from sdhj.problem.grid import SMALL, Grid, PaddedGrid, Window
from sdhj.problem.interval import Interval
from sdhj.problem.nodes import HAIR, checked_values_at, closed, least_in_cells, sampled_on, size_of, with_nodes_around
from sdhj.problem.sets import STEEP, TargetSet, UnsafeSet
from sdhj.problem.statement import Statement

PADDING = 4  # nodes past a safe end on the grid of the games: the widest stencils use three


@dataclass(frozen=True)
class Sampled(Statement):
    """A problem whose functions are evaluated at the nodes of its grid, or at any state without interpolation.

    At nodes by `sample`, `goal`, `target_at`, `unsafe_at` and `unsafe_over`; at states by `target_value`,
    `unsafe_value` and `unsafe_along`. `on` is the problem on a window of its grid, `padded` that on the games' grid.
    Samples of sets that do not move are kept.
    """

    @cached_property
    def padded(self) -> Self:
        """The problem on the games' grid, with `PADDING` more nodes past each safe end; itself if there is no safe end.

        Made once. Past a safe end dynamics and unsafe sets are as at the end.
        """
        grid = self.grid
        padding = np.isfinite(grid.faces("frees")).T * PADDING  # (ndim, 2)
        if not padding.any():
            return self
        past, nodes = padding.T * grid.spacing, (padding.sum(axis=1) + grid.shape).tolist()
        ends = (grid.lower - past[0]).tolist(), (grid.upper + past[1]).tolist()
        wide = PaddedGrid(Grid(*ends, nodes, grid.periodic, grid.names, grid.ends), padding.tolist())

        def as_at_the_end(unsafe_set: "UnsafeSet") -> "UnsafeSet":
            """The unsafe set whose level-set function, and `swept` if it has one, do not change past safe ends."""
            ends, swept = grid.subgrid(unsafe_set.axes).faces("frees"), unsafe_set.swept
            return replace(
                unsafe_set, level_set=unsafe_set.level_set.clipped(*ends), swept=swept and swept.clipped(*ends)
            )

        dynamics = self.dynamics.clipped(*grid.faces("frees"))
        return replace(self, grid=wide, dynamics=dynamics, unsafe=tuple(map(as_at_the_end, self.unsafe)))

    def on(self, grid: Grid) -> "Sampled":
        """The problem on a window of its grid, an `OnWindow`, without new checks; itself for its own grid.

        grid : a window of `self.grid`, which is not checked. `half_widths`, `error_growth` and `Interval.speeds` stay
        those of the whole grid (`OnWindow.interval` says where speeds do not).
        """
        if grid == self.grid:
            return self
        known = {one.name: getattr(self, one.name) for one in fields(Statement) if one.init}
        return OnWindow(**known | {"grid": grid}, whole=self)

    def sample(self, axes: Sequence[int], function: Callable[[FloatArray], FloatArray], name: str) -> FloatArray:
        """Values of a level-set function of points (M, len(axes)) at the nodes of the subgrid of these axes, float64.

        ValueError, with the set's `name`, where a value is not finite or out of the range of single precision.
        """
        return sampled_on(self.grid.subgrid(axes), function, name)

    def unsafe_at(self, unsafe_set: UnsafeSet, t: float) -> FloatArray:
        """The level-set function g of one unsafe set at time t, s, at the nodes of its axes' subgrid; read-only.

        Made `nodes.closed`, and according to the set's `sampling`. A set that does not move is sampled once; t is then
        ignored. ValueError where a value is not finite or out of the range of single precision.
        """
        return self._kept_samples(
            unsafe_set, lambda: self._sampled(unsafe_set, lambda points: unsafe_set.level_set(points, t))
        )

    def _kept_samples(self, part: TargetSet | UnsafeSet, sample: Callable[[], FloatArray]) -> FloatArray:
        """The samples of a set, read-only, from sample(), which for a set that does not move is called once.

        part : the set. sample : a function without arguments, called each time if the set moves. Samples of a formula
        are shared by all problems that have this set on the same grid, as long as one of them keeps them; those of a
        black box are this problem's alone.
        """
        if part.moving:
            return read_only(sample())
        level_set, how = part.level_set, (getattr(part, "sampling", ""), self.grid.subgrid(part.axes))
        if (level_set, *how) not in self._static:
            shared = isinstance(level_set, Formula)
            known = level_set.remembered("samples", WeakValueDictionary[Any, FloatArray]) if shared else {}
            found = known.get(how)
            known[how] = self._static[level_set, *how] = read_only(sample()) if found is None else found
        return self._static[level_set, *how]

    def unsafe_over(
        self, unsafe_set: UnsafeSet, t0: float, t1: float, *, axes: Sequence[int] = (), view_time: str | None = None
    ) -> FloatArray:
        """One level-set function of an unsafe set for all of [t0, t1], s (`UnsafeSet.over`), at nodes; read-only.

        Made `nodes.closed`, and according to the set's `sampling`; of shape subgrid(axes).shape.

        axes : ascending, with all of the set's among them; by default the set's. view_time : one of `VIEW_TIMES`, by
        default the problem's. ValueError where a value is not finite or out of the range of single precision, or a
        black box declares too little.
        """
        axes, view_time = tuple(axes) or unsafe_set.axes, view_time or self.view_time
        swept = partial(unsafe_set.over, t0=t0, t1=t1, view_time=view_time)
        values = self._sampled(unsafe_set, swept) if unsafe_set.moving else self.unsafe_at(unsafe_set, t0)
        grid = self.grid.subgrid(axes)
        return np.broadcast_to(grid.lift(values, [axes.index(axis) for axis in unsafe_set.axes]), grid.shape)

    def _sampled(self, unsafe_set: UnsafeSet, function: Callable[[FloatArray], FloatArray]) -> FloatArray:
        """The values of a level-set function at the nodes of an unsafe set's subgrid, according to its `sampling`.

        "nodes": the values, made `nodes.closed`. "steep": the same, times `STEEP` inside the set. "cell": lower bounds
        in the cells around each node (`nodes.least_in_cells`). On a window the values are those that the whole grid has
        there. function : of points (M, axes of the set) -> (M,), the set's at one time or over an interval.
        """
        grid, size = self.grid.subgrid(unsafe_set.axes), size_of(self.grid.subgrid(unsafe_set.axes), function)
        if unsafe_set.sampling == "cell":
            whole = grid.whole if isinstance(grid, Window) else grid
            values = least_in_cells(whole, lambda points: checked_values_at(function, points, unsafe_set.name))
            values = values[np.ix_(*map(grid.places, range(grid.ndim)))] if isinstance(grid, Window) else values
        else:
            values = sampled_on(grid, function, unsafe_set.name)
            if isinstance(grid, Window) and ((values <= 0.0) & (values >= -HAIR * size)).any():
                more, middle = with_nodes_around(grid)
                values = closed(more, sampled_on(more, function, unsafe_set.name), size)[middle]
            else:
                values = closed(grid, values, size)
        return np.where(values < 0, STEEP * values, values) if unsafe_set.sampling == "steep" else values

    def goal(self, step: int) -> FloatArray:
        """Level-set function of S_k^N = L(t_k) minus G(t_k) on the grid (first row of Algorithm 1).

        Without a target, L(t_k) is the grid up to its unsafe ends.

        Parameters
        ----------
        step : int
            k, from 0 to N.

        Returns
        -------
        array of shape grid.shape
            <= 0 in the set.

        Examples
        --------
        With the robot on a line of `help(sdhj)`:

        >>> goal = problem.goal(0)
        >>> goal.shape, problem.grid.nodes(0)[goal <= 0][[0, -1]]
        ((81,), array([-1.,  1.]))
        """
        t, jitter, grid = self.time(step), self.sensing.jitter, self.grid
        values = self.target_at(t)
        for unsafe_set in (one for one in self.unsafe if one.inputs is None):
            g = self.unsafe_over(unsafe_set, t - jitter, t + jitter) if jitter else self.unsafe_at(unsafe_set, t)
            outside = -grid.lift(g, unsafe_set.axes)
            fits = outside.shape == np.broadcast_shapes(values.shape, outside.shape)
            values = np.maximum(values, outside, out=outside if fits else None)  # fresh memory takes ten times as long
        if self.has_no_target:
            values = np.maximum(values, -grid.to_ends("fails"))
        return np.ascontiguousarray(np.broadcast_to(values, self.grid.shape))

    def target_at(self, t: float) -> FloatArray:
        """Level-set function of the target at time t, s, at the nodes of its axes, in a shape that broadcasts to the
        grid's.

        -inf where there is no target. The samples of a target that does not move are kept if they are at most `SMALL`.
        """
        target = self.target
        if self.has_no_target:
            return np.full((1,) * self.grid.ndim, -np.inf)
        sample = partial(self.sample, target.axes, lambda points: target.level_set(points, t), target.name)
        large = self.grid.subgrid(target.axes).size > SMALL  # then it would take as much memory as a tube
        return self.grid.lift(sample() if large else self._kept_samples(target, sample), target.axes)

    def value_of(self, part: TargetSet | UnsafeSet, points: FloatArray, t: float) -> FloatArray:
        """Level-set function of one set at states (M, ndim) and time t, s, without interpolation: (M,).

        part : the set, of this grid's axes. Coordinates on periodic axes are wrapped. The shape of the states is not
        checked.
        """
        return part.level_set(self.grid.wrapped(points).take(part.axes, axis=1), t)

    def target_value(self, points: FloatArray, t: float) -> FloatArray:
        """Level-set function of the target at states (M, ndim), without interpolation: (M,).

        Parameters
        ----------
        points : (M, ndim) array
            States, in the units of the grid's axes.
        t : float
            The time, s.

        Returns
        -------
        (M,) array
            In the unit of the target's function, m if it is a distance; <= 0 in the target. Without a target, -1.

        Raises
        ------
        ValueError
            If the states have another shape or are no numbers, if t is not a finite number, or if the function is
            undefined at a state.

        Examples
        --------
        With the robot on a line of `help(sdhj)`:

        >>> problem.target_value([[0.25], [2.0]], 0.0)
        array([-0.75,  1.  ])
        """
        return self.value_of(self.target, points_array("points", points, self.grid.ndim), number("t", t))

    def unsafe_value(self, points: FloatArray, t: float, inputs: FloatArray | None = None) -> FloatArray:
        """Level-set function of G(t) at states (M, ndim), without interpolation: (M,); <= 0 is a collision.

        Parameters
        ----------
        points : (M, ndim) array
            States, in the units of the grid's axes.
        t : float
            The time, s.
        inputs : (M,) int array, optional
            Indices into problem.inputs of what is applied there, for sets that are unsafe under some inputs only. By
            default the sets count that are unsafe under all.

        Returns
        -------
        (M,) array
            In the unit of the sets' functions, m if these are distances; <= 0 is a collision. +inf where no set counts.

        Raises
        ------
        ValueError
            If the states have another shape or are no numbers, if t is not a finite number, or if a function is
            undefined at a state.

        Examples
        --------
        With the robot on a line of `help(sdhj)`:

        >>> problem.unsafe_value([[2.5], [3.5]], 0.0)
        array([ 0.5, -0.5])
        """
        points = points_array("points", points, self.grid.ndim)
        return self.unsafe_along(points[:, None], [number("t", t)], inputs)[:, 0]

    def unsafe_along(self, points: FloatArray, times: Sequence[float], inputs: FloatArray | None = None) -> FloatArray:
        """Level-set function of G along M paths of T states, without interpolation: (M, T); +inf where no set counts.

        points (M, T, ndim) : states, column i at times[i], s. times : ascending; equal ones are evaluated together.
        inputs (M,) : the index of the input that acts on each path, whose sets count; without it those that are unsafe
        under all inputs.
        """
        ndim, out = self.grid.ndim, np.full(points.shape[:2], np.inf)
        wrapped = self.grid.wrapped(points.reshape(-1, ndim)).reshape(points.shape)
        firsts = [0, *(i for i in range(1, len(times)) if times[i] != times[i - 1]), len(times)]
        for unsafe_set in self.unsafe:
            counts = unsafe_set.counts(inputs)
            for begin, end in (pairwise(firsts) if unsafe_set.moving else [(0, len(times))]) if counts.any() else ():
                at = wrapped[:, begin:end].take(unsafe_set.axes, axis=2).reshape(-1, len(unsafe_set.axes))
                value = unsafe_set.level_set(at, times[begin]).reshape(len(points), end - begin)
                np.minimum(out[:, begin:end], value, out=out[:, begin:end], where=counts.reshape(-1, 1))
        return out

    def arrived(self, states: FloatArray, step: int) -> FloatArray:
        """Which of states (M, ndim) at a step are in the target and in no unsafe set, by the level-set functions.

        Their numbers, (R,) int64, ascending. None where a function is undefined, off the grid, and with a `Sensing`,
        where the true state is not known.
        """
        level_set, axes, t = self.target.level_set, self.target.axes, self.time(step)
        if self.has_no_target or self.sensing:
            return np.zeros(0, np.int64)
        points, rows = self.grid.wrapped(states), None
        if isinstance(level_set, Formula):  # in a third of the time; it has values off the grid, too
            rows = np.flatnonzero(level_set(points.take(axes, axis=1), t, finite=False) <= 0.0)
            if not rows.size:
                return rows
        known = np.isfinite(states).all(axis=1) & ~self.grid.beyond(states, "fails", "holds", "frees")
        rows = np.flatnonzero(known) if rows is None else rows[known[rows]]
        there = points[rows]
        return rows[(self.value_of(self.target, there, t) <= 0.0) & (self.unsafe_value(there, t) > 0.0)]

    def surely_in_no_tube(self, points: FloatArray, step: int, within: int) -> FloatArray:
        """Whether states (M, ndim) are surely in no tube (step, within), whatever was computed: bool (M,).

        A state is in none if it is in G at the step's time, where those sets count that are unsafe under all inputs; or
        if within = 0, there is a target, and the state is not in it. By the level-set functions without interpolation.
        """
        t = self.time(step)
        lost = self.unsafe_value(points, t) <= 0.0
        return lost if within or self.has_no_target else lost | (self.target_value(points, t) > 0.0)


@dataclass(frozen=True)
class OnWindow(Sampled):
    """A problem on a window of its grid, made by `Sampled.on`; not checked, as the `whole` problem has been."""

    whole: Sampled = field(kw_only=True)

    @property
    def half_widths(self) -> tuple[FloatArray, FloatArray]:
        """`Statement.half_widths` of the whole problem."""
        return self.whole.half_widths

    @property
    def error_growth(self) -> FloatArray:
        """`Statement.error_growth` of the whole problem."""
        return self.whole.error_growth

    def interval(self, step: int) -> Interval:
        """The interval from step k on the window.

        As `Statement.interval`: the motion from step k to k + 1, made once. Its `speeds` are those of the whole grid
        where velocities depend on the state alone, and those of the window where they depend on time or not on the
        state.
        """
        if self.dynamics.depends_on_time or self.dynamics.stateless:
            return super().interval(step)
        if 0 not in self._intervals:
            self._intervals[0] = self.whole.interval(0).on(self.grid)
        return self._intervals[0]
