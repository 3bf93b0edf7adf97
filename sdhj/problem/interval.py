"""What input and adversary can do in one sampling interval.

`Interval` alone defines what may happen from step k on: the velocity sets of the games, the boxes with which the
controller looks ahead, and the plant that the simulation integrates. In this file j is an input's index, "inputs" (M,)
are indices, and times are in s.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial, reduce
from itertools import combinations, product
from typing import Any

import numpy as np

from sdhj.common.memory import require_memory
from sdhj.common.remembering import FloatArray, ReadOnly, kept
from sdhj.formulas.formula import Formula
from sdhj.kernels.tubes import PATH
from sdhj.problem.grid import Grid
from sdhj.problem.vector_field import VectorField
from sdhj.problem.velocities import Velocities

NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)  # for means over time of velocities that depend on nothing else
# fractions of an interval at which time-dependent velocities are compared: evenly spaced ones would miss vibrations
INSTANTS = np.concatenate([[0.0], (NODES + 1) / 2, [1.0]])
ROUNDING = 1e-12  # of pushes, relative to the greatest
FAN, MOST_NORMALS = 4, 64  # normals of planes in the plane of two axes: so many for each piece of v, and at most
MOST_PIECES = 4096  # of the box of v, of which hulls are made: with more, what they lead to is a box


def narrowed(low: FloatArray, high: FloatArray, spread: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(low + spread, high - spread); the middle twice where nothing is left beyond `ROUNDING`."""
    # a box of displacements without the share of its segments, with which it is the whole again: `_corners`, `HopfLax`
    if not np.any(spread):
        return low, high
    middle, left = (low + high) / 2, (high - low) / 2 - spread
    left = np.where(left > ROUNDING * spread, left, 0.0)
    return middle - left, middle + left


def _symmetric(axis: int, pushes: FloatArray) -> bool:
    """Whether the sum of segments -+pushes[:, k], (axes, K), is its own mirror image about an axis."""
    # so it is if along each direction there is as much length as along the mirrored one
    mirrored = np.where(np.arange(len(pushes)) == axis, -1.0, 1.0)[:, None] * pushes
    lengths = np.sqrt((pushes**2).sum(axis=0))
    same = np.abs(np.abs(pushes.T @ np.hstack([pushes, mirrored])) - np.outer(lengths, np.tile(lengths, 2)))
    along = (same <= 1e-9 * np.outer(lengths, np.tile(lengths, 2))) @ np.diag(np.tile(lengths, 2))
    here, there = np.split(along, 2, axis=1)
    return bool(np.allclose(here.sum(axis=1), there.sum(axis=1), rtol=1e-9, atol=0.0))


def by_input(inputs: FloatArray) -> Iterator[tuple[int, Any]]:
    """Yield (j, rows) for each j that occurs among `inputs` (M,): where it occurs, as an index."""
    if len(inputs) == 1:  # without it a single run takes 1.08 of the time
        yield int(inputs[0]), slice(None)
        return
    for j in np.flatnonzero(np.bincount(inputs)).tolist():
        yield j, np.flatnonzero(inputs == j)


@dataclass(frozen=True, eq=False)
class Interval(ReadOnly):
    """The motion from one sampling time to the next, under a constant input and any disturbance.

    States may have any coordinates on periodic axes. It is immutable; what is found once is kept with it.
    """

    grid: Grid
    dynamics: VectorField
    begin: float  # when it begins, s
    delta: float  # how long it lasts, s
    early: float = 0.0  # how much sooner the adversary may end it, s
    widening: FloatArray | float = 0.0  # of boxes of `displacement_sets`, to each side: (ndim,), or 0

    @property
    def end(self) -> float:
        """The latest time at which the interval ends, s; the adversary may end it up to `early` sooner."""
        return self.begin + self.delta

    @cached_property
    def walled(self) -> "Interval":
        """The same interval on a grid whose bounded ends are all walls."""
        return replace(self, grid=self.grid.walled)

    # ---- of single states: the controller, the adversaries, the plant

    def drift(self, states: Any, j: int, t: Any) -> Any:
        """Velocity of states (M, ndim), also traced, under input j without the adversary at time t."""
        return self.dynamics.drift_at(self.grid.wrapped(states), j, t)

    def gain(self, states: FloatArray, inputs: FloatArray, t: float) -> FloatArray:
        """The gain of v for each state (M, ndim) under its own input: (M, ndim, D)."""
        points = self.grid.wrapped(states)
        if self.dynamics.shared_gain:
            return self.dynamics.gain_at(points, 0, t)
        gain = np.empty((*states.shape, self.dynamics.disturbance_dim))
        for j, rows in by_input(inputs):
            gain[rows] = self.dynamics.gain_at(points[rows], j, t)
        return gain

    def bounds(self, inputs: FloatArray, t: float) -> FloatArray:
        """Half-widths of the box of v under each of the inputs (M,): (M, D)."""
        if self.dynamics.shared_gain:
            return np.broadcast_to(self.dynamics.bounds_at(0, t), (len(inputs), self.dynamics.disturbance_dim))
        table = np.stack([self.dynamics.bounds_at(j, t) for j in range(len(self.dynamics.inputs))])
        return table[inputs]

    def undisturbed(self, states: FloatArray, inputs: FloatArray, t: float) -> FloatArray:
        """Velocity of each state (M, ndim) under its input (M,) without v at time t."""
        if self.dynamics.constant:
            return self.dynamics.arrays[0][inputs]
        velocity = np.empty_like(states)
        for j, rows in by_input(inputs):
            velocity[rows] = self.drift(states[rows], j, t)
        return velocity

    def advance(self, states: FloatArray, inputs: FloatArray, v: FloatArray, t: float, duration: float) -> FloatArray:
        """States (M, ndim), moved for `duration` s under inputs (M,) and v (M, D); clipped at walls, not wrapped."""
        if self.dynamics.constant:  # exact; else long durations need several calls
            moved = states + duration * (self.dynamics.arrays[0][inputs] + v @ self.dynamics.arrays[1].T)
            return self.grid.clipped(moved)
        out, states_and_v = np.empty_like(states), np.concatenate([states, v], axis=1)
        for j, rows in by_input(inputs):
            step = self._as_formula(("step", j), partial(self._runge_kutta, j), states_and_v.shape[1], 2)
            out[rows] = step(states_and_v[rows], t, duration)
        return out

    def _runge_kutta(self, j: int, states_and_v: Any, t: Any, duration: Any) -> Any:
        """One Runge-Kutta step of order 4 under input j from states and v side by side: (M, ndim)."""
        # proofs of E (`_spread` of `sdhj.certified.images`, the checker) rest on weights of the mean that are >= 0
        # one array, as formulas take it
        states, v = states_and_v[:, : self.grid.ndim], states_and_v[:, self.grid.ndim :]

        def velocity(q: Any, now: Any) -> Any:
            return self.dynamics.velocity_at(self.grid.wrapped(q), j, v, now)

        def moved(span: Any, slope: Any) -> Any:
            return self.grid.clipped(states + span * slope)

        k1 = velocity(states, t)
        k2 = velocity(moved(duration / 2, k1), t + duration / 2)
        k3 = velocity(moved(duration / 2, k2), t + duration / 2)
        k4 = velocity(moved(duration, k3), t + duration)
        return moved(duration, (k1 + 2 * k2 + 2 * k3 + k4) / 6)

    def _as_formula(self, what: tuple[Any, ...], function: Any, coordinates: int, parameters: int = 1) -> Any:
        """A function as one formula, which is faster, kept by `what` and the grid; itself if there are black boxes."""
        if not self.dynamics.formulas:
            return function
        grid = self.grid
        # The dynamics keep it, for all intervals that differ in their begin alone: what else it hangs on is in the key.
        key, name = (*what, grid.lower, grid.upper, grid.periodic, grid.ends), "where the state moves to"
        return self.dynamics.remembered(key, lambda: Formula.traced(name, function, coordinates, parameters))

    def displacements(self, states: FloatArray) -> FloatArray:
        """Where every input leads without an adversary, by the midpoint rule, relative to states: (M, L, ndim)."""
        _, _, moved, more = self.displacement_sets(states)[:PATH]
        return np.moveaxis(moved + more, -1, 0)

    def _displacements_by_two_rules(self, states: Any, begin: Any) -> tuple[Any, Any]:
        """Displacements without an adversary, by Euler's and by the midpoint rule: (M, L, ndim) each."""
        moves, later = [], []
        for j in range(len(self.dynamics.inputs)):
            moves.append(self.delta * self.drift(states, j, begin))
            halfway = self.grid.clipped(states + moves[-1] / 2)
            later.append(self.delta * self.drift(halfway, j, begin + self.delta / 2))
        # of both `displacement_sets` makes the path without an adversary: the first is a, the difference is b
        return np.stack(moves, axis=1), np.stack(later, axis=1)

    def reachable_boxes(self, states: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Boxes around all that `displacement_sets` has: lower and upper corners, (M, L, ndim)."""
        low, high, _, _, *halves = np.moveaxis(self.displacement_sets(states), -1, 1)
        spread = np.abs(halves).sum(axis=0) if halves and not self.normals.size else 0.0
        return low - spread, high + spread

    def reachable_points(self, states: FloatArray, sides: FloatArray) -> FloatArray:
        """States in `reachable_boxes` that the adversary can bring about, relative to states: (M, L, P, ndim).

        One towards each of the points `sides` (P, ndim) of the unit box: the point of the box without segments, plus as
        large a share of each segment; or, where v is cut, the last on the way there beyond no plane of `normals`.
        """
        low, high, _, _, *halves = np.moveaxis(self.displacement_sets(states), -1, 1)[..., None, :]
        # `place_points` in `sdhj.kernels.true_sets` has such points for compiled look-ups: both change together
        points = low * (1 - sides) + high * sides
        if (normals := self.normals).size:
            middle, way = (low + high) / 2, points - (low + high) / 2
            left = np.concatenate(halves, axis=-1)[..., : len(normals)] - middle @ normals.T
            towards = way @ normals.T
            share = np.where(towards > 0, np.maximum(left, 0.0), 1.0) / np.where(towards > 0, towards, 1.0)
            return np.asarray(middle + np.minimum(share, 1.0).min(axis=-1, keepdims=True) * way)
        for half in halves:
            towards = ((2 * sides - 1) * half / self.grid.spacing).sum(axis=-1, keepdims=True)
            far = np.abs(2 * sides - 1).max(axis=-1, keepdims=True)
            points = points + np.where(towards >= 0, far, -far) * half
        return np.asarray(points)

    def displacement_sets(self, states: FloatArray) -> FloatArray:
        """Where each input leads at the interval's end, relative to states (M, ndim): (4 + K, L, ndim, M), M perhaps 1.

        [0], [1] : corners of a box; exact where velocities do not depend on the state (larger where v is cut), else
        estimates. [2], [3] : a and b of the path without an adversary, x + s a + s^2 b, 0 <= s <= 1; exact for a
        constant drift, else to second order. [4:] : half of the segment of each component in `VectorField.oblique`; or,
        in C order, the greatest n . x at the end for each of the `normals` n, and zeros.
        """
        # `sdhj.kernels.tubes` reads all of it by these places
        if self.dynamics.stateless:
            return self._constant_displacement_sets.copy()  # compiled look-ups take it in place of what they write
        found = (self.displacement_formula or self._displacement_sets)(states, self.begin)
        return np.ascontiguousarray(np.moveaxis(found, 0, -1))

    @kept
    def _constant_displacement_sets(self) -> FloatArray:
        """`displacement_sets` where it is the same for all states: (4 + K, L, ndim, 1)."""
        return np.ascontiguousarray(
            np.moveaxis(self._displacement_sets(np.array([self.grid.lower]), self.begin), 0, -1)
        )

    @property
    def displacement_formula(self) -> Formula | None:
        """`displacement_sets` as one formula of states and the begin, (4 + K, L, ndim), if there is one."""
        dynamics = self.dynamics
        if dynamics.stateless or not dynamics.formulas or dynamics.gain is None:
            return None
        # All that it depends on besides the dynamics, which keep it.
        what = "displacement_sets", self.delta, self.early, *np.ravel(self.widening).tolist()
        found: Formula = self._as_formula(what, self._displacement_sets, self.grid.ndim)
        return found

    def _displacement_sets(self, states: Any, begin: Any) -> Any:
        """`displacement_sets` of an interval from `begin`, also traced: (M, 4 + K, L, ndim)."""
        # the hull over three of the ends that the adversary may choose: now, in the middle and at the latest
        lasting = [self.delta - by * self.early for by in ((0.0, 0.5, 1.0) if self.early else (0.0,))]
        if (normals := self.normals).size:
            directions = np.concatenate([-np.eye(self.grid.ndim), np.eye(self.grid.ndim), normals])
            ends = [replace(self, delta=delta)._greatest_along(states, begin, directions) for delta in lasting]
            far = np.maximum.reduce(ends) + np.abs(directions) @ (self.widening + np.zeros(self.grid.ndim))
            moved, later = self._displacements_by_two_rules(states, begin)
            # In rows of `ndim` numbers, of which the last is filled up with zeros.
            terms = np.pad(far, [(0, 0), (0, 0), (0, -far.shape[2] % self.grid.ndim)])
            low, high, *more = np.split(terms, terms.shape[2] // self.grid.ndim, axis=2)
            return np.stack([-low, high, *np.broadcast_arrays(moved, later - moved), *more], axis=1)
        corners = [replace(self, delta=delta)._corners(states, begin) for delta in lasting]
        low, high = (reduce(*one) for one in zip((np.minimum, np.maximum), zip(*corners, strict=True), strict=True))
        moved, later = self._displacements_by_two_rules(states, begin)
        segments = [self.delta * half for half in self._half_segments(states, begin)]
        return np.stack([low - self.widening, high + self.widening, moved, later - moved, *segments], axis=1)

    @kept
    def normals(self) -> FloatArray:
        """Normals (K, ndim) of the planes, beside the axes, that bound where states may end where v is cut."""
        # The mean of v's velocities over an interval lies in the hull of those of the pieces, whose greatest part along
        # each normal is known.
        #
        # Look-ups take any planes, in the order of `displacement_sets`: more of them hold less, and take longer.
        dynamics, ndim, found = self.dynamics, self.grid.ndim, list[FloatArray]()
        pieces = math.prod(dynamics.pieces_of_components(range(ndim)))
        for pair in combinations(range(ndim), 2) if 1 < pieces <= MOST_PIECES else ():
            most = max(dynamics.pieces_of_components(pair))
            count = min(FAN * most, MOST_NORMALS)  # evenly apart if axes are measured in cells
            for k in range(count if most > 1 else 0):
                if 4 * k % count:  # not along an axis
                    normal = np.zeros(ndim)
                    normal[list(pair)] = np.cos(angle := 2 * np.pi * k / count), np.sin(angle)
                    found.append(normal / self.grid.spacing)
        return np.array(found).reshape(-1, ndim)

    def _greatest_along(self, states: FloatArray, begin: float, directions: FloatArray) -> FloatArray:
        """The greatest n @ (x(end) - x) over v, which is cut, or an estimate, for directions n: (M, L, K).

        M is 1 where velocities do not depend on the state; there it is an upper bound, and else an estimate.
        """
        dynamics, count = self.dynamics, range(len(self.dynamics.inputs))
        if dynamics.stateless:
            times = self.begin + self.delta * (NODES + 1) / 2 if dynamics.depends_on_time else np.array([self.begin])
            shares = self.delta * (WEIGHTS / 2 if dynamics.depends_on_time else np.ones(1))
            nothing = np.zeros((1, self.grid.ndim))
            each = [[dynamics.greatest_along(nothing, j, t, directions) for t in times.tolist()] for j in count]
            return np.tensordot(shares, np.array(each), axes=(0, 1)).swapaxes(0, 1)
        # an estimate: delta times the greatest velocity beyond the drift at some instants, added to the midpoint rule
        instants = [begin] if not dynamics.depends_on_time else [begin, begin + self.delta / 2, begin + self.delta]
        (moved, centre), far = self._displacements_by_two_rules(states, begin), []
        for j in count:
            # where the state is halfway without an adversary: velocities at the begin alone would err to first order
            points = self.grid.wrapped(self.grid.clipped(states + moved[:, j] / 2))
            beyond = [
                dynamics.greatest_along(points, j, t, directions) - dynamics.drift_at(points, j, t) @ directions.T
                for t in instants
            ]
            far.append(centre[:, j] @ directions.T + self.delta * np.maximum.reduce(beyond))
        return np.stack(far, axis=1)

    def _half_segments(self, states: Any, begin: Any) -> list[Any]:
        """gain_d bounds_d for each d in `VectorField.oblique`, at states: a list of (M, L, ndim)."""
        dynamics, points, count = self.dynamics, self.grid.wrapped(states), range(len(self.dynamics.inputs))
        if not dynamics.oblique:
            return []
        gains = [dynamics.gain_at(points, j, begin) for j in count]
        # at a number, as `begin` may be traced: what `oblique` has depends on no time
        bounds = [dynamics.bounds_at(j, self.begin) for j in count]
        return [np.stack([gains[j][:, :, d] * bounds[j][d] for j in count], axis=1) for d in dynamics.oblique]

    def _corners(self, states: Any, begin: Any) -> tuple[Any, Any]:
        """Corners (M, L, ndim) of the box of displacements by all but `VectorField.oblique`."""
        dynamics = self.dynamics
        if dynamics.stateless:
            low, high = self.displacement_boxes(0.0, self.delta)
            spread = sum((np.abs(half[0]) for half in self._half_segments(states, begin)), np.zeros_like(low))
            low, high = narrowed(low, high, self.delta * spread)
            return low[None], high[None]
        # an estimate: around the midpoint rule, delta times the greatest deviation by v at some instants
        centre, points = self._displacements_by_two_rules(states, begin)[1], self.grid.wrapped(states)
        times = [begin] if not dynamics.depends_on_time else [begin, begin + self.delta / 2, begin + self.delta]
        lows, highs = [], []
        for j in range(len(dynamics.inputs)):
            if dynamics.oblique:
                # What is oblique is not in the box: `_half_segments` has it.
                some = dynamics.bounds_at(j, self.begin) * ~np.isin(
                    np.arange(dynamics.disturbance_dim), dynamics.oblique
                )
                lows.append((np.abs(dynamics.gain_at(points, j, begin)) * some).sum(axis=2))
                highs.append(lows[-1])
                continue
            drift, ends = dynamics.drift_at(points, j, begin), [dynamics.extremes(points, j, t) for t in times]
            middle = [drift if t is begin else dynamics.drift_at(points, j, t) for t in times]
            lows.append(reduce(np.maximum, [one - end[:, 0] for one, end in zip(middle, ends, strict=True)]))
            highs.append(reduce(np.maximum, [end[:, 1] - one for one, end in zip(middle, ends, strict=True)]))
        below, above = (self.delta * np.stack(one, axis=1) for one in (lows, highs))
        return centre - below, centre + above

    # ---- of velocities that do not depend on the state: the Hopf-Lax formula

    def extremes(self, t: float) -> FloatArray:
        """Least and greatest velocity, where it does not depend on the state, at time t: (2, L, ndim)."""
        nothing = np.zeros((1, self.grid.ndim))
        each = [self.dynamics.extremes(nothing, j, t)[0] for j in range(len(self.dynamics.inputs))]
        return np.stack(each, axis=1)

    @kept
    def _constant_extremes(self) -> FloatArray:
        """`extremes` at the begin, where velocities depend neither on state nor time."""
        return self.extremes(self.begin)

    def displacement_boxes(self, begin: float, end: float) -> tuple[FloatArray, FloatArray]:
        """Corners (L, ndim) of the box of displacements from `begin` to `end`, s, at the mean `extremes`."""
        if self.dynamics.depends_on_time:  # by Gauss's rule, not exact
            times = self.begin + begin + (end - begin) * (NODES + 1) / 2
            mean = np.tensordot(WEIGHTS / 2, np.stack([self.extremes(t) for t in times]), axes=1)
        else:
            mean = self._constant_extremes
        low, high = (end - begin) * mean
        return low, high

    def segments(self, axes: Sequence[int]) -> FloatArray:
        """gain_d bounds_d along `axes` for each component d of v that moves several of these: (L, K, axes)."""
        dynamics, own, grid = self.dynamics, list(axes), self.grid
        fixed = dynamics.gain is not None and not (dynamics.gain.depends_on_time or dynamics.bounds.depends_on_time)
        if not fixed or not dynamics.couples(own):
            return np.zeros((len(dynamics.inputs), 0, len(own)))
        nothing, count = np.zeros((1, grid.ndim)), range(len(dynamics.inputs))
        # as `_half_segments`, which is for look-ups; for games, on their axes, and without what a wall makes wrong
        pushes = np.stack([dynamics.gain_at(nothing, j, self.begin)[0] * dynamics.bounds_at(j) for j in count])[:, own]
        some = np.abs(pushes) > ROUNDING * np.abs(pushes).max()  # the rest is rounding, as of a gain that is a rotation
        pushes *= some
        oblique = (some.sum(axis=1) > 1).any(axis=0)
        for i, axis in enumerate(own):  # what is held at the wall may end elsewhere
            if self._may_leave_at_wall(axis, i, pushes[:, :, oblique]):
                oblique &= ~some[:, i].any(axis=0)
        # a displacement over tau is that of the box less the segments' share, plus tau times any point of each
        return np.ascontiguousarray(np.swapaxes(pushes[:, :, oblique], 1, 2))

    def _may_leave_at_wall(self, axis: int, row: int, pushes: FloatArray) -> bool:
        """Whether states held at a wall may end outside the sum of the segments `pushes` (L, axes, K)."""
        nothing, dynamics = np.zeros((1, self.grid.ndim)), self.dynamics
        if not self.grid.ends_where("holds")[:, axis].any():
            return False
        # where something drifts along the axis, or the segments are not symmetric about it
        drifts = (dynamics.drift_at(nothing, j, self.begin)[0, axis] for j in range(len(dynamics.inputs)))
        return dynamics.drift.depends_on_time or any(drifts) or not all(map(partial(_symmetric, row), pushes))

    @property
    def walls_needing_boxes(self) -> FloatArray:
        """Coordinates (2, ndim) of walls at which states may end outside segments or planes; -+inf elsewhere."""
        # there compiled look-ups take a box that holds the segments, or planes, instead
        dynamics, walls, axes = self.dynamics, np.array(self.grid.faces("holds")), range(self.grid.ndim)
        if self.normals.size:
            walls = np.where(self.normals.any(axis=0), walls, np.array([[-np.inf], [np.inf]]))
        if dynamics.oblique and dynamics.stateless:
            pushes = np.stack(self._half_segments(np.zeros((1, len(axes))), self.begin), axis=-1)[0]
            past = np.array([[-np.inf], [np.inf]])
            walls = np.where([self._may_leave_at_wall(axis, axis, pushes) for axis in axes], walls, past)
        return walls

    # ---- on the grid: velocity sets for the games

    def _values_at_nodes(self, formula: Formula, seen: Sequence[int], t: float) -> FloatArray:
        """The values of a formula at nodes of the axes it reads, which broadcast to the subgrid `seen`."""
        read = [axis for axis in seen if formula.reads[0, axis]]
        if not read:
            return formula(np.array([self.grid.lower]), t).reshape((1,) * len(seen))
        # on the axes that it reads alone: a function of one coordinate is evaluated at the nodes of one axis
        grid, some = self.grid.subgrid(read), formula.restricted(read)
        values = np.concatenate([some(points, t) for points in grid.pieces()]).reshape(grid.shape)
        return self.grid.subgrid(seen).lift(values, [seen.index(axis) for axis in read])

    @kept
    def speeds(self) -> FloatArray:
        """The greatest |velocity| along each axis over nodes, inputs and v, at some instants only: (ndim,)."""
        # an estimate: by it avoid games get nodes past ends, a solve is said to take memory, runs are looked at closely
        dynamics, ndim, most = self.dynamics, self.grid.ndim, np.zeros(self.grid.ndim)
        instants = self.begin + self.delta * (INSTANTS[::4] if dynamics.depends_on_time else INSTANTS[:1])
        for j, t in product(range(len(dynamics.inputs)), instants.tolist()):
            if dynamics.formulas and dynamics.gain is not None:
                rows = [dynamics.component("extremes", j, row) for row in range(2 * ndim)]
                ends = [np.abs(self._values_at_nodes(one, range(ndim), t)).max() for one in rows]
                most = np.maximum(most, np.reshape(ends, (2, ndim)).max(axis=0))
            else:
                for points in self.grid.pieces():
                    most = np.maximum(most, np.abs(dynamics.extremes(points, j, t)).max(axis=(0, 1)))
        return most

    def self_contained(self, axes: Iterable[int]) -> tuple[int, ...]:
        """The smallest set of axes with `axes` in it whose velocities depend on no other coordinate."""
        found = set(axes)
        while grown := {int(k) for i in found for k in np.flatnonzero(self.dynamics.reads[i])} - found:
            found |= grown
        return tuple(sorted(found))

    def velocities(self, j: int, axes: Sequence[int], t: float | None = None, *, drift: bool = True) -> Velocities:
        """The velocity set under input j along some axes at time t, by default the begin, on their subgrid.

        Coordinates left out that matter are taken at all their nodes (App. A.4): each combination is a mode.
        drift=False is for a frame that moves with the drift.
        """
        dynamics, axes, t = self.dynamics, list(axes), self.begin if t is None else t
        if dynamics.stateless and dynamics.gain is not None:
            nothing = np.zeros((1, self.grid.ndim))
            f = dynamics.drift_at(nothing, j, t)[:, axes] * drift
            b = dynamics.gain_at(nothing, j, t)[:, axes] * dynamics.bounds_at(j, t)
        elif (box := self._hull(j, axes, t)) is not None:
            return box
        elif dynamics.gain is None:
            return self._boxes_of_pieces(j, axes, t)
        else:
            f, b = self._modes(j, axes, t)
        # The box around all that v may do.
        spread = np.abs(b).sum(axis=2)
        lower, upper = f - spread, f + spread
        hull = lower.min(axis=0), upper.max(axis=0)
        swayed = [((lower[:, i] != hull[0][i]) | (upper[:, i] != hull[1][i])).any() for i in range(len(axes))]
        coupled = (np.count_nonzero(dynamics.pushes[j][axes], axis=0) > 1).any()
        # where one axis is swayed the hull has the same H: cheaper, with the sharper flux
        return Velocities(*hull) if sum(swayed) <= 1 and not coupled else Velocities(*hull, drift=f, gain=b)

    def _with_axes_read(self, axes: list[int]) -> tuple[list[int], tuple[int, ...]]:
        """These axes and those that their velocities read, and where the latter stand among them."""
        seen = sorted({*axes, *np.flatnonzero(self.dynamics.reads[axes].any(axis=0)).tolist()})
        return seen, tuple(i for i, axis in enumerate(seen) if axis not in axes)

    def _hull(self, j: int, axes: list[int], t: float) -> Velocities | None:
        """The velocity set under input j as a box of arrays on the axes they read; None where that is larger."""
        dynamics, (seen, outside) = self.dynamics, self._with_axes_read(axes)
        if not dynamics.formulas or dynamics.gain is None:
            return None
        if (np.count_nonzero(dynamics.pushes[j][axes], axis=0) > 1).any():
            return None
        dynamics.bounds_at(j, t)  # refuses what is below 0
        lows, highs, swayed = list[FloatArray](), list[FloatArray](), 0
        for axis in axes:
            both = (dynamics.component("extremes", j, row) for row in (axis, axis + dynamics.ndim))
            low, high = (self._values_at_nodes(one, seen, t) for one in both)
            lows.append(low.min(axis=outside))
            highs.append(high.max(axis=outside))
            swayed += bool(np.ptp(low, axis=outside).any() or np.ptp(high, axis=outside).any())
        # by the rule of `velocities`, which takes modes where more than one axis is swayed
        return Velocities(lows, highs, shape=self.grid.subgrid(axes).shape) if swayed <= 1 else None

    def _points_of_axes(self, seen: list[int]) -> FloatArray:
        """States (M, ndim) at the nodes of the subgrid `seen`, the other coordinates at lower ends."""
        grid = self.grid.subgrid(seen)
        points = np.tile(np.array(self.grid.lower), (grid.size, 1))
        points[:, seen] = grid.points()
        return points

    def _boxes_of_pieces(self, j: int, axes: list[int], t: float) -> Velocities:
        """The velocity set under input j as modes, a box for each piece of v that does not enter linearly."""
        dynamics, (seen, outside), cuts = (
            self.dynamics,
            self._with_axes_read(axes),
            self.dynamics.pieces_of_components(axes),
        )
        grid, places, count = self.grid.subgrid(seen), tuple(1 + place for place in outside), math.prod(cuts)
        # Before the first of them is computed.
        if count > 1:
            require_memory(8 * count * len(axes) * (3 + len(axes)) * grid.size, f"velocities of {count} pieces of v")
        points, lows, highs = self._points_of_axes(seen), list[FloatArray](), list[FloatArray]()
        ends = dynamics.disturbance_bounds(j, points, points, (t, t))
        edges = [np.linspace(end[0], end[1], cut + 1) for end, cut in zip(ends.T, cuts, strict=True)]
        # each velocity is in the box of some piece, so the true H is at most the maximum over them
        for at in product(*map(range, cuts)):
            v = [(float(one[i]), float(one[i + 1])) for one, i in zip(edges, at, strict=True)]
            found = dynamics.functions_by_input["drift"][j].bounds(points, points, (t, t), *v)
            low, high = (end[:, axes].T.reshape(-1, *grid.shape) for end in found)
            lows.append(low.min(axis=places))
            highs.append(high.max(axis=places))
        if count == 1:
            return Velocities(lows[0], highs[0])
        low, high = np.array(lows), np.array(highs)
        # A box is its middle, and a gain of half of its width along each axis.
        gain = np.zeros((count, len(axes), *low.shape[1:]))
        for axis in range(len(axes)):
            gain[:, axis, axis] = (high[:, axis] - low[:, axis]) / 2
        return Velocities(low.min(axis=0), high.max(axis=0), drift=(low + high) / 2, gain=gain)

    def _modes(self, j: int, axes: list[int], t: float) -> tuple[FloatArray, FloatArray]:
        """Drift (modes, axes, *subgrid) and gain times bounds (modes, axes, D, *subgrid) under input j."""
        dynamics, (seen, outside) = self.dynamics, self._with_axes_read(axes)
        grid, count = self.grid.subgrid(seen), dynamics.disturbance_dim
        require_memory(8 * len(axes) * grid.size * (count + 3), "sampling the velocities")
        sampled = np.zeros((len(axes), 1 + count, *grid.shape))
        bounds = dynamics.bounds_at(j, t)
        if dynamics.formulas:
            # Component by component, as each is computed on the axes that it reads alone.
            for row, axis in enumerate(axes):
                sampled[row, 0] = self._values_at_nodes(dynamics.component("drift", j, axis), seen, t)
                for d in np.flatnonzero(dynamics.pushes[j, axis]).tolist():
                    push = dynamics.component("gain", j, axis * count + d)
                    sampled[row, 1 + d] = bounds[d] * self._values_at_nodes(push, seen, t)
        else:
            points = self._points_of_axes(seen)
            gain = dynamics.gain_at(points, j, t)[:, axes] * bounds
            parts = np.concatenate([dynamics.drift_at(points, j, t)[:, axes, None], gain], axis=2)
            sampled = np.moveaxis(parts, 0, 2).reshape(sampled.shape)
        # a mode for each combination of nodes of the coordinates left out
        sampled = np.moveaxis(sampled, [2 + place for place in outside], range(len(outside)))
        sampled = sampled.reshape(-1, *sampled.shape[len(outside) :])
        return sampled[:, :, 0], sampled[:, :, 1:]
