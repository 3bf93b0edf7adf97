"""The differential games of one sampling interval (Sec. 4.1, App. A.3), solved for each input.

A solver answers two questions about the interval that starts at step k, for every input u_j held over it:

* `reach(values)`: level-set functions of the reach sets of {values <= 0} (Definition 2; game 3);
* `avoid(part, step)`: level-set functions of the avoid tubes of one unsafe set (Definition 3; games 1 and 2),
  solved on the axes that set depends on.

The reach-avoid set of u_j is the intersection, max(reach, avoid). `JointSolver` solves the reach-avoid game in one PDE
(Prop. 1) instead; the two agree up to scheme error.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import cache
from typing import Protocol

import numpy as np

from sdhj.grid import FloatArray, Grid
from sdhj.hopf_lax import INTERPOLATIONS, maximum_over_boxes
from sdhj.memory import require
from sdhj.problem import ReachAvoidProblem, UnsafeSet
from sdhj.schemes import MOST_STEPS, Scheme, Velocities, evolve, too_fast

KEPT = 256_000_000  # bytes of sampled velocities that a solver keeps
SHIFT = "limited"  # how the moving frame is brought back: no less accurate than the differences it serves


class Solver(Protocol):
    """What the recursion needs of a method."""

    dtype: str

    @property
    def solved(self) -> int: ...  # PDEs so far

    def reach(self, values: FloatArray) -> Iterator[tuple[int, FloatArray]]: ...

    def avoid(self, part: UnsafeSet, step: int) -> FloatArray: ...


def velocities(problem: ReachAvoidProblem, j: int, axes: Sequence[int], *, drift: bool = True) -> Velocities | None:
    """The velocity set under u_j on the subgrid of some axes, or None where it depends on the axes left out.

    drift=False leaves the drift out (the moving frame).
    """
    dynamics, grid = problem.dynamics, problem.grid
    keep = list(axes)
    if dynamics.constant:
        f = dynamics.drift_at(np.zeros((1, grid.ndim)), j)[0][keep] * drift
        b = dynamics.gain_at(np.zeros((1, grid.ndim)))[0][keep] * dynamics.bounds
    else:
        field = sampled_velocities(problem, j, keep)
        field[:, 0] *= drift
        for axis in sorted(set(range(grid.ndim)) - set(keep), reverse=True):
            first = field.take([0], axis=2 + axis)
            if not np.array_equal(np.broadcast_to(first, field.shape), field):
                return None
            field = first.squeeze(2 + axis)
        f, b = field[:, 0], field[:, 1:]
    spread = np.abs(b).sum(axis=1)
    coupled = (np.count_nonzero(b.any(axis=tuple(range(2, b.ndim))), axis=0) > 1).any()
    if coupled:
        return Velocities(f - spread, f + spread, drift=f[None], gain=b[None])
    return Velocities(f - spread, f + spread)


def velocity_bytes(problem: ReachAvoidProblem) -> int:
    """Bytes that the velocities under one input take while they are sampled on the whole grid."""
    return 8 * problem.grid.ndim * (2 * problem.dynamics.bounds.size + 6) * problem.grid.size


def sampled_velocities(problem: ReachAvoidProblem, j: int, keep: list[int]) -> FloatArray:
    """Drift under u_j and gain times bounds of some axes at all nodes, one behind the other: (axes, 1 + D, *shape)."""
    require(velocity_bytes(problem), f"sampling the velocities on {problem.grid.size:.1e} nodes")
    dynamics, grid, points = problem.dynamics, problem.grid, problem.grid.points()
    field = np.empty((len(keep), 1 + dynamics.bounds.size, grid.size))
    field[:, 0] = dynamics.drift_at(points, j).T[keep]
    field[:, 1:] = np.moveaxis(dynamics.gain_at(points), 0, 2)[keep]
    field[:, 1:] *= dynamics.bounds[:, None]
    return field.reshape(*field.shape[:2], *grid.shape)


def checked_travel(grid: Grid, speed: FloatArray, duration: float) -> FloatArray:
    """How many cells each axis crosses in `duration` at speeds (ndim,); ValueError for more than `MOST_STEPS`."""
    cells = [float(v) * duration / dx for v, dx in zip(speed, grid.spacing, strict=True)]
    if max(cells) > MOST_STEPS:
        raise too_fast(grid, speed, duration, max(cells), "cells to be crossed")
    return np.array(cells)


def avoid_axes(problem: ReachAvoidProblem, part: UnsafeSet) -> tuple[int, ...]:
    """The axes on which the avoid game of an unsafe set is solved: its own, or all where those are not autonomous."""
    alone = problem.dynamics.constant or all(
        velocities(problem, j, part.axes) is not None for j in range(len(problem.inputs))
    )
    return part.axes if alone else tuple(range(problem.grid.ndim))


def unsafe_values(
    problem: ReachAvoidProblem, part: UnsafeSet, axes: Sequence[int], t0: float, t1: float, view_time: str
) -> FloatArray:
    """g of one unsafe set over [t0, t1], by a view-time that is not instantaneous, on the subgrid of `axes`."""
    local = [list(axes).index(axis) for axis in part.axes]
    return problem.sample(axes, lambda points: part.over(points[:, local], t0, t1, view_time), part.name)


def walls(
    problem: ReachAvoidProblem, part: UnsafeSet, axes: Sequence[int], step: int, steps: int
) -> Callable[[float], FloatArray]:
    """-g of one unsafe set as a function of tau, the time left of the interval from `step`, solved in `steps` steps.

    An instantaneous set is taken at all times of the time step that ends at tau, or what is fast slips past between two
    of them; at other view-times the answer is the same for all tau.
    """
    t0, t1 = problem.time(step), problem.time(step + 1)
    instant = part.moving and problem.view_time == "instantaneous"

    @cache
    def wall(tau: float) -> FloatArray:
        if not instant:
            return -unsafe_values(problem, part, axes, t0, t1, problem.view_time)
        now = t1 - tau
        return -unsafe_values(problem, part, axes, now, min(now + problem.delta / steps, t1), "swept")

    return wall if instant else lambda tau: wall(0.0)


class HJISolver:
    """Games 1 to 3 by finite differences (`method="hji"`)."""

    def __init__(self, problem: ReachAvoidProblem, scheme: Scheme) -> None:
        self.problem, self.scheme, self.dtype = problem, scheme, scheme.dtype
        self.everything = tuple(range(problem.grid.ndim))
        self.solved = 0
        self._steps: dict[tuple[int, ...], int] = {}
        self._fields: dict[tuple[tuple[int, ...], int], Velocities] = {}
        self._room = KEPT
        if self.moving_frame:
            checked_travel(problem.grid, np.abs(np.asarray(problem.dynamics.drift)).max(axis=0), problem.delta)

    @property
    def moving_frame(self) -> bool:
        """Whether the drift can be solved by a shift: constant, and along periodic axes only."""
        dynamics, periodic = self.problem.dynamics, np.array(self.problem.grid.periodic)
        if self.scheme.frame == "fixed" or not dynamics.constant:
            return False
        return not np.any(np.asarray(dynamics.drift)[:, ~periodic])

    def reach(self, values: FloatArray) -> Iterator[tuple[int, FloatArray]]:
        """Yield (j, Phi_j(t_k)) for every input; `values` is the level-set function of the set to be in at t_{k+1}."""
        problem, grid = self.problem, self.problem.grid
        if self.moving_frame:
            still = self._evolve(values, 0, drift=False)
            shift = np.asarray(problem.dynamics.drift) * problem.delta
            yield from maximum_over_boxes(grid, still, shift, shift, SHIFT)
        else:
            for j in range(len(problem.inputs)):
                yield j, self._evolve(values, j)

    def _evolve(self, values: FloatArray, j: int, drift: bool = True) -> FloatArray:
        self.solved += 1
        field = self.field(j, self.everything, drift)
        return evolve(self.problem.grid, values, field, self.problem.delta, self.scheme)

    def avoid(self, part: UnsafeSet, step: int) -> FloatArray:
        """Level-set functions of the avoid tubes over the interval from `step`, shape (L, *subgrid of avoid_axes).

        Differences wear the crests of -g down, and so find unsafe states safe: where velocities are constant, in the
        moving frame, the tubes come from the Hopf-Lax formula, which does not.
        """
        problem = self.problem
        if self.moving_frame:
            return LaxSolver(problem, SHIFT, self.dtype).avoid(part, step)
        axes = avoid_axes(problem, part)
        grid, steps = problem.grid.subgrid(axes), self.steps(axes)
        wall = walls(problem, part, axes, step, steps)
        held = wall if part.moving and problem.view_time == "instantaneous" else wall(0.0)
        tubes = np.empty((len(problem.inputs), *grid.shape), self.dtype)
        for j, tube in enumerate(tubes):
            tube[:] = evolve(
                grid, wall(0.0), self.field(j, axes), problem.delta, self.scheme, obstacle=held, steps=steps
            )
            self.solved += 1
        return tubes

    def field(self, j: int, axes: Sequence[int], drift: bool = True) -> Velocities:
        """The velocity set under u_j on axes that do not depend on others; kept while there is room."""
        known = self._fields.get((tuple(axes), j)) if drift else None
        if known is not None:
            return known
        field = velocities(self.problem, j, axes, drift=drift)
        assert field is not None
        if drift and field.nbytes <= self._room:
            self._fields[tuple(axes), j] = field
            self._room -= field.nbytes
        return field

    def steps(self, axes: tuple[int, ...]) -> int:
        """Time steps of an interval that are enough for every input."""
        if axes not in self._steps:
            grid, delta, cfl = self.problem.grid.subgrid(axes), self.problem.delta, self.scheme.cfl
            counts = (self.field(j, axes).steps(grid, delta, cfl) for j in range(len(self.problem.inputs)))
            self._steps[axes] = max(1, *counts)
        return self._steps[axes]


class JointSolver(HJISolver):
    """The reach-avoid game of Prop. 1 in one PDE on the whole grid (`games="joint"`)."""

    def reach_avoid(self, values: FloatArray, step: int) -> Iterator[tuple[int, FloatArray]]:
        """Yield (j, Phi_j(t_k)), the level-set functions of the reach-avoid sets (Definition 4)."""
        problem, grid = self.problem, self.problem.grid
        steps = self.steps(self.everything)
        parts = [(walls(problem, part, part.axes, step, steps), part.axes) for part in problem.unsafe]

        @cache
        def union(tau: float) -> FloatArray:
            wall = np.full((1,) * grid.ndim, -np.inf)
            for of_part, axes in parts:
                wall = np.maximum(wall, grid.lift(of_part(tau), axes))
            return np.ascontiguousarray(np.broadcast_to(wall, grid.shape), dtype=self.dtype)

        obstacle = None if not parts else union if problem.view_time == "instantaneous" else union(0.0)
        for j in range(len(problem.inputs)):
            self.solved += 1
            field = self.field(j, self.everything)
            yield j, evolve(grid, values, field, problem.delta, self.scheme, obstacle=obstacle, steps=steps)


class LaxSolver:
    """Games 1 to 3 by the Hopf-Lax formula (`method="lax"`): exact up to interpolation.

    The velocity set must not depend on the state; where the adversary couples axes its bounding box is used, which errs
    to the safe side.
    """

    solved = 0  # a formula in place of PDEs

    def __init__(self, problem: ReachAvoidProblem, interpolation: str, dtype: str) -> None:
        if interpolation not in INTERPOLATIONS:
            raise ValueError(f"interpolation must be one of {', '.join(INTERPOLATIONS)}, got {interpolation!r}")
        if not problem.dynamics.constant:
            raise ValueError('method="lax" needs velocities that do not depend on the state; use method="hji"')
        self.problem, self.interpolation, self.dtype = problem, interpolation, dtype
        spread = np.abs(np.asarray(problem.dynamics.gain)) @ problem.dynamics.bounds
        self.lower = np.asarray(problem.dynamics.drift) - spread
        self.upper = np.asarray(problem.dynamics.drift) + spread
        self.cells = checked_travel(  # that an axis crosses in an interval, at most
            problem.grid, np.maximum(np.abs(self.lower), np.abs(self.upper)).max(axis=0), problem.delta
        )

    def reach(self, values: FloatArray) -> Iterator[tuple[int, FloatArray]]:
        """As `HJISolver.reach`."""
        delta = self.problem.delta
        yield from maximum_over_boxes(
            self.problem.grid,
            np.asarray(values, self.dtype),
            self.lower * delta,
            self.upper * delta,
            self.interpolation,
        )

    def avoid(self, part: UnsafeSet, step: int) -> FloatArray:
        """As `HJISolver.avoid`; each piece of the interval takes the box that holds all states of its duration."""
        problem, axes = self.problem, list(part.axes)
        grid = problem.grid.subgrid(axes)
        pieces = self._pieces(axes)
        times = problem.time(step) + problem.delta * np.arange(pieces + 1) / pieces
        instant = part.moving and problem.view_time == "instantaneous"
        whole = None if instant else -unsafe_values(problem, part, axes, times[0], times[-1], problem.view_time)
        result = np.full((len(problem.inputs), *grid.shape), -np.inf, self.dtype)
        for piece in range(pieces):
            if whole is None:  # what moves within a piece is covered by its swept volume
                t0, t1 = float(times[piece]), float(times[piece + 1])
                g = unsafe_values(problem, part, axes, t0, t1, "swept")
            wall = (-g if whole is None else whole).astype(self.dtype)
            ends = problem.delta * np.array([piece, piece + 1]) / pieces
            low = np.minimum(*(end * self.lower[:, axes] for end in ends))
            high = np.maximum(*(end * self.upper[:, axes] for end in ends))
            for j, values in maximum_over_boxes(grid, wall, low, high, self.interpolation):
                np.maximum(result[j], values, out=result[j])
        return result

    def _pieces(self, axes: list[int]) -> int:
        """Pieces of the interval short enough that no axis moves more than a quarter of a cell."""
        return max(1, int(np.ceil(self.cells[axes].max() * 4)))
