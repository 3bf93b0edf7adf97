"""The differential games of one sampling interval (Sec. 4.1, App. A.3), solved for each input.

A solver answers two questions about the interval that starts at step k, for every input u_j held over it:

* `reach(values)`: level-set functions of the reach sets of {values <= 0} (Definition 2; game 3);
* `avoid(part, step)`: level-set functions of the avoid tubes of one unsafe set (Definition 3; games 1 and 2),
  solved on the axes that set depends on.

The reach-avoid set of u_j is the intersection, max(reach, avoid). `JointSolver` solves the reach-avoid game in one PDE
(Prop. 1) instead; the two agree up to scheme error.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

import numpy as np

from sdhj.grid import FloatArray, Grid
from sdhj.hopf_lax import INTERPOLATIONS, maximum_over_boxes
from sdhj.problem import ReachAvoidProblem, UnsafeSet
from sdhj.schemes import Scheme, Velocities, evolve

SHIFT = "limited"  # how functions are moved between frames: no less accurate than the differences it serves


class Solver(Protocol):
    """What the recursion needs of a method."""

    dtype: str

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
        points = grid.points()
        sampled = np.concatenate(
            [
                dynamics.drift_at(points, j)[:, keep, None] * drift,
                dynamics.gain_at(points)[:, keep] * dynamics.bounds,
            ],
            axis=2,
        )
        field = np.moveaxis(sampled, 0, 2).reshape(len(keep), -1, *grid.shape)
        for axis in sorted(set(range(grid.ndim)) - set(keep), reverse=True):
            first = field.take([0], axis=2 + axis)
            if not np.array_equal(np.broadcast_to(first, field.shape), field):
                return None
            field = first.squeeze(2 + axis)
        f, b = field[:, 0], field[:, 1:]
    spread = np.abs(b).sum(axis=1)
    coupled = (np.count_nonzero(b.reshape(*b.shape[:2], -1).any(axis=2), axis=0) > 1).any()
    if coupled:
        return Velocities(f - spread, f + spread, drift=f[None], gain=b[None])
    return Velocities(f - spread, f + spread)


def avoid_axes(problem: ReachAvoidProblem, part: UnsafeSet) -> tuple[int, ...]:
    """The axes on which the avoid game of an unsafe set is solved: its own, or all where those are not autonomous."""
    alone = problem.dynamics.constant or all(
        velocities(problem, j, part.axes) is not None for j in range(len(problem.inputs))
    )
    return part.axes if alone else tuple(range(problem.grid.ndim))


def unsafe_values(problem: ReachAvoidProblem, part: UnsafeSet, axes: Sequence[int], t0: float, t1: float) -> FloatArray:
    """g of one unsafe set on the subgrid of `axes`: at time t0 where t0 = t1, else over [t0, t1] by the problem's view-time."""
    local = [list(axes).index(axis) for axis in part.axes]

    def level_set(points: FloatArray) -> FloatArray:
        if t0 == t1:
            return part.level_set(points[:, local], t0)
        return part.over(points[:, local], t0, t1, problem.view_time)

    return problem.sample(axes, level_set, part.name)


def shifted(grid: Grid, values: FloatArray, by: FloatArray) -> FloatArray:
    """The function x -> values(x + by); `by` (ndim,)."""
    ((_, moved),) = maximum_over_boxes(grid, values, by[None], by[None], SHIFT)
    return moved


class HJISolver:
    """Games 1 to 3 by finite differences (`method="hji"`)."""

    def __init__(self, problem: ReachAvoidProblem, scheme: Scheme) -> None:
        self.problem, self.scheme, self.dtype = problem, scheme, scheme.dtype
        self.everything = tuple(range(problem.grid.ndim))

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
        field = velocities(self.problem, j, self.everything, drift=drift)
        assert field is not None  # all axes leave none out
        return evolve(self.problem.grid, values, field, self.problem.delta, self.scheme)

    def avoid(self, part: UnsafeSet, step: int) -> FloatArray:
        """Level-set functions of the avoid tubes over the interval from `step`, shape (L, *subgrid of avoid_axes)."""
        problem = self.problem
        axes = avoid_axes(problem, part)
        grid = problem.grid.subgrid(axes)
        t0, t1 = problem.time(step), problem.time(step + 1)
        instant = part.moving and problem.view_time == "instantaneous"
        known: dict[float, FloatArray] = {}

        def obstacle(tau: float) -> FloatArray:
            if tau not in known:
                known[tau] = -unsafe_values(problem, part, axes, t1 - tau, t1 - tau)
            return known[tau]

        held = obstacle if instant else (-unsafe_values(problem, part, axes, t0, t1)).astype(self.dtype)
        return self._avoid(grid, axes, held)

    def _avoid(self, grid: Grid, axes: Sequence[int], wall: FloatArray | Callable[[float], FloatArray]) -> FloatArray:
        """Phi >= wall for every input, from Phi = wall; `wall` as `evolve` takes its obstacle."""
        problem, delta = self.problem, self.problem.delta
        fields = [field for j in range(len(problem.inputs)) if (field := velocities(problem, j, axes)) is not None]
        steps = max(field.steps(grid, delta, self.scheme.cfl) for field in fields)
        start = wall(0.0) if callable(wall) else wall
        if not self.moving_frame:
            return np.stack(
                [evolve(grid, start, field, delta, self.scheme, obstacle=wall, steps=steps) for field in fields]
            )
        still = velocities(problem, 0, axes, drift=False)
        assert still is not None
        tubes = np.empty((len(fields), *grid.shape), self.dtype)
        for tube, drift in zip(tubes, np.asarray(problem.dynamics.drift)[:, axes], strict=True):

            def passing(tau: float, drift: FloatArray = drift) -> FloatArray:
                """The wall as it is met tau before the end, seen from where the drift alone leads by then."""
                return shifted(grid, wall(tau) if callable(wall) else wall, -drift * tau)

            end = evolve(grid, start, still, delta, self.scheme, obstacle=passing, steps=steps)
            tube[:] = shifted(grid, end, drift * delta)
        return tubes


class JointSolver(HJISolver):
    """The reach-avoid game of Prop. 1 in one PDE on the whole grid (`games="joint"`)."""

    def reach_avoid(self, values: FloatArray, step: int) -> Iterator[tuple[int, FloatArray]]:
        """Yield (j, Phi_j(t_k)), the level-set functions of the reach-avoid sets (Definition 4)."""
        problem, grid = self.problem, self.problem.grid
        t0, t1 = problem.time(step), problem.time(step + 1)
        instant = problem.view_time == "instantaneous"
        known: dict[float, FloatArray] = {}

        def union(tau: float) -> FloatArray:
            if tau not in known:
                wall = np.full((1,) * grid.ndim, -np.inf)
                for part in problem.unsafe:
                    now = t1 - tau
                    span = (now, now) if instant and part.moving else (t0, t1)
                    wall = np.maximum(wall, -grid.lift(unsafe_values(problem, part, part.axes, *span), part.axes))
                known[tau] = np.ascontiguousarray(np.broadcast_to(wall, grid.shape), dtype=self.dtype)
            return known[tau]

        obstacle = None if not problem.unsafe else union if instant else union(0.0)
        fields = [velocities(problem, j, self.everything) for j in range(len(problem.inputs))]
        steps = max(field.steps(grid, problem.delta, self.scheme.cfl) for field in fields if field is not None)
        for j, field in enumerate(fields):
            assert field is not None
            yield j, evolve(grid, values, field, problem.delta, self.scheme, obstacle=obstacle, steps=steps)


class LaxSolver:
    """Games 1 to 3 by the Hopf-Lax formula (`method="lax"`): exact up to interpolation.

    The velocity set must not depend on the state; where the adversary couples axes its bounding box is used, which errs
    to the safe side.
    """

    def __init__(self, problem: ReachAvoidProblem, interpolation: str, dtype: str) -> None:
        if interpolation not in INTERPOLATIONS:
            raise ValueError(f"interpolation must be one of {', '.join(INTERPOLATIONS)}, got {interpolation!r}")
        if not problem.dynamics.constant:
            raise ValueError('method="lax" needs velocities that do not depend on the state; use method="hji"')
        self.problem, self.interpolation, self.dtype = problem, interpolation, dtype
        spread = np.abs(np.asarray(problem.dynamics.gain)) @ problem.dynamics.bounds
        self.lower = np.asarray(problem.dynamics.drift) - spread
        self.upper = np.asarray(problem.dynamics.drift) + spread

    def reach(self, values: FloatArray) -> Iterator[tuple[int, FloatArray]]:
        """As `HJISolver.reach`."""
        delta = self.problem.delta
        yield from maximum_over_boxes(
            self.problem.grid, np.asarray(values, self.dtype), self.lower * delta, self.upper * delta, self.interpolation
        )

    def avoid(self, part: UnsafeSet, step: int) -> FloatArray:
        """As `HJISolver.avoid`; each piece of the interval takes the box that holds all states of its duration."""
        problem, axes = self.problem, list(part.axes)
        grid = problem.grid.subgrid(axes)
        pieces = self._pieces(grid, axes)
        times = problem.time(step) + problem.delta * np.arange(pieces + 1) / pieces
        instant = part.moving and problem.view_time == "instantaneous"
        whole = None if instant else -unsafe_values(problem, part, axes, times[0], times[-1])
        result = np.full((len(problem.inputs), *grid.shape), -np.inf, self.dtype)
        for piece in range(pieces):
            if whole is None:  # what moves within a piece is covered by its swept volume
                t0, t1 = float(times[piece]), float(times[piece + 1])
                g = problem.sample(axes, lambda p, t0=t0, t1=t1: part.over(p, t0, t1, "swept"), part.name)  # type: ignore[misc]
            wall = (-g if whole is None else whole).astype(self.dtype)
            ends = problem.delta * np.array([piece, piece + 1]) / pieces
            low = np.minimum(*(end * self.lower[:, axes] for end in ends))
            high = np.maximum(*(end * self.upper[:, axes] for end in ends))
            for j, values in maximum_over_boxes(grid, wall, low, high, self.interpolation):
                np.maximum(result[j], values, out=result[j])
        return result

    def _pieces(self, grid: Grid, axes: list[int]) -> int:
        """Pieces of the interval short enough that no axis moves more than a quarter of a cell."""
        travel = np.maximum(np.abs(self.lower), np.abs(self.upper))[:, axes].max(axis=0) * self.problem.delta
        return max(1, int(np.ceil((travel / np.array(grid.spacing)).max() * 4)))
