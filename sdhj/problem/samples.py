"""A problem's level-set functions, of target and unsafe sets, at the nodes on which games are played."""

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from sdhj.common.remembering import FloatArray, read_only
from sdhj.formulas.formula import Formula
from sdhj.formulas.graph import constant, leaf, make
from sdhj.kernels.interpolation import SLACK
from sdhj.problem.grid import SMALL, Grid
from sdhj.problem.interval import Interval
from sdhj.problem.nodes import checked_values, closed, least_in_cells, least_of_cells, sampled_on
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sets import STEEP, TargetSet, UnsafeSet
from sdhj.problem.vector_field import VectorField
from sdhj.problem.velocities import checked_travel

PADDING = 4  # nodes past a safe end on the grid of the games: the widest stencils use three
MARGIN = 6  # nodes beyond what an interval reaches: errors from the wide grid's end fall tenfold per node


class Samples:
    """A problem on a grid: what it has at the nodes, and the motion there.

    Examples
    --------
    With the robot on a line of `help(sdhj)`:

    >>> from sdhj.problem.samples import Samples
    >>> goal = Samples(problem).goal(0)
    >>> goal.shape, problem.grid.nodes(0)[goal <= 0][[0, -1]]
    ((81,), array([-1.,  1.]))
    """

    def __init__(
        self,
        problem: ReachAvoidProblem,
        grid: Grid | None = None,
        dynamics: VectorField | None = None,
        unsafe: Iterable[UnsafeSet] | None = None,
    ) -> None:
        # the problem's own grid or, with all arguments, another: one that goes past it, or one of other axes
        self.problem, self.grid = problem, problem.grid if grid is None else grid
        self.dynamics = problem.dynamics if dynamics is None else dynamics
        self.unsafe = problem.unsafe if unsafe is None else tuple(unsafe)  # past the problem's ends as at the ends
        self._intervals: dict[int, Interval] = {}
        self._static: dict[Any, FloatArray] = {}  # of sets that do not move, which every step asks for

    @cached_property
    def padded(self) -> "Samples":
        """The samples on the games' grid, with `PADDING` more nodes past each safe end."""
        grid = self.grid
        padding = np.isfinite(grid.faces("frees")).T * PADDING
        if not padding.any():
            return self

        # past a safe end the user's functions may say anything, and games are played on the nodes there
        def as_at_the_end(unsafe_set: UnsafeSet) -> UnsafeSet:
            ends, swept = grid.subgrid(unsafe_set.axes).faces("frees"), unsafe_set.swept
            return replace(
                unsafe_set, level_set=unsafe_set.level_set.clipped(*ends), swept=swept and swept.clipped(*ends)
            )

        dynamics = self.dynamics.clipped(*grid.faces("frees"))
        return Samples(self.problem, grid.wider(padding.tolist(), grid.ends), dynamics, map(as_at_the_end, self.unsafe))

    def past_ends(self, axis: int) -> "tuple[Samples, tuple[slice, ...]]":
        """The samples on a wide grid past both ends of an axis, with all beyond unsafe ends as their one unsafe set.

        That grid has the `avoid_axes` of this one; the slices say which of its nodes are nodes of this grid.
        """
        whole, axes = self.grid, self.avoid_axes([axis])
        place, grid, delta = axes.index(axis), whole.subgrid(axes), self.interval(0).delta
        steps = range(self.problem.steps if self.dynamics.depends_on_time else 1)  # one wide grid serves all
        speeds = np.max([self.interval(step).speeds for step in steps], axis=0)
        # as far as the state comes in an interval; velocities there are those at the end
        more = int(np.ceil(checked_travel(whole, speeds, delta)[axis])) + MARGIN
        by = [(more, more) if i == place else (0, 0) for i in range(len(axes))]
        each = zip(grid.ends, grid.ends_where("frees").T, strict=True)  # who leaves there is out of danger here too
        ends = [[end if free else "wall" for end, free in zip(*one, strict=True)] for one in each]
        slack = SLACK * whole.spacing[axis]  # a state on the end, to rounding, is on the grid
        low, high = (float(face[axis]) for face in whole.faces("fails"))
        x = leaf("x", 0)
        depth = make("min", x - constant(low), constant(high) - x) + constant(slack)
        past = UnsafeSet((place,), Formula((depth,), 1, 1), name=f"the ends of axis {whole.names[axis]}")
        there = self.dynamics.past_ends(axes, whole.lower, whole.upper)
        inside = tuple(slice(extra, extra + n) for (extra, _), n in zip(by, grid.shape, strict=True))
        return Samples(self.problem, grid.wider(by, ends), there, [past]), inside

    def interval(self, step: int) -> Interval:
        """The motion from step k to k + 1 on this grid."""
        if self.grid is self.problem.grid:
            return self.problem.interval(step)
        step = step if self.dynamics.depends_on_time else 0
        if step not in self._intervals:
            known = self.problem.interval(step)
            # only games are played on other grids, and what these lead into is shrunk by `must_lead_into` instead
            self._intervals[step] = replace(known, grid=self.grid, dynamics=self.dynamics, widening=0.0)
        return self._intervals[step]

    def avoid_axes(self, axes: Iterable[int]) -> tuple[int, ...]:
        """The axes of an unsafe set's avoid game: its own, safe ends', and what their velocities read."""
        # a state that has left through a safe end can no longer collide
        safe = np.isfinite(self.grid.faces("frees")).any(axis=0)
        return self.interval(0).self_contained({*axes, *np.flatnonzero(safe).tolist()})

    def sample(
        self, part: TargetSet | UnsafeSet, t0: float, t1: float | None = None, view_time: str | None = None
    ) -> FloatArray:
        """The level-set function of a set, at t0 or over [t0, t1], at the nodes of its axes' subgrid."""
        grid, view_time = self.grid.subgrid(part.axes), view_time or self.problem.view_time
        if part.moving or (part is self.problem.target and grid.size > SMALL):  # would take as much memory as a tube
            return read_only(_at_nodes(part, grid, t0, t1, view_time))
        key = part.level_set, part.axes, getattr(part, "sampling", "")
        if key not in self._static:
            self._static[key] = read_only(_at_nodes(part, grid, t0, None, view_time))
        return self._static[key]

    def goal(self, step: int) -> FloatArray:
        """Level-set function of S_k^N = L(t_k) minus G(t_k) on the grid (first row of Algorithm 1)."""
        problem, grid, target = self.problem, self.grid, self.problem.target
        # `in_goal` of `sdhj.problem.consistency` says the same of any point
        t, jitter, values = problem.time(step), problem.sensing.jitter, np.full((1,) * grid.ndim, -np.inf)
        if not problem.has_no_target:
            values = grid.lift(self.sample(target, t), target.axes)
        for unsafe_set in (one for one in self.unsafe if one.inputs is None):
            g = self.sample(unsafe_set, t - jitter, t + jitter) if jitter else self.sample(unsafe_set, t)
            outside = -grid.lift(g, unsafe_set.axes)
            fits = outside.shape == np.broadcast_shapes(values.shape, outside.shape)
            values = np.maximum(values, outside, out=outside if fits else None)  # fresh memory takes ten times as long
        if problem.has_no_target:
            values = np.maximum(values, -grid.to_ends("fails"))  # L(t_k) is the grid up to its unsafe ends
        return np.ascontiguousarray(np.broadcast_to(values, grid.shape))


def _at_nodes(part: TargetSet | UnsafeSet, grid: Grid, t0: float, t1: float | None, view_time: str) -> FloatArray:
    """The level-set function of a set at t0, or over [t0, t1], at nodes of its grid, by its `sampling`."""

    def function(points: FloatArray) -> FloatArray:
        if t1 is None or not isinstance(part, UnsafeSet):
            return np.asarray(part.level_set(points, t0))
        return part.over(points, t0, t1, view_time)

    if not isinstance(part, UnsafeSet):
        return sampled_on(grid, function, part.name)
    if part.sampling == "cell":
        with suppress(ValueError):  # where a black box declares too little
            found = least_of_cells(grid, partial(part.least, t0=t0, t1=t1, view_time=view_time))
            if np.isfinite(found).all():
                return found
        # Without bounds, the least of values within the cells.
        return least_in_cells(grid, lambda points: checked_values(function(points), points, part.name))
    values = closed(grid, sampled_on(grid, function, part.name), function, part.name)
    # Steeper inside, so that interpolation puts the boundary farther out.
    return np.where(values < 0, STEEP * values, values) if part.sampling == "steep" else values
