"""What input and adversary can do in one sampling interval.

`Interval` alone defines what may happen from step k on: the velocity sets of the games, the boxes with which the
controller looks ahead, and the plant that the simulation integrates.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial, reduce
from itertools import combinations, product
from typing import Any

import numpy as np

from sdhj.formulas.formula import Formula
from sdhj.kernels import FloatArray, kept, read_only
from sdhj.kernels.tubes import PATH
from sdhj.problem.dynamics import VectorField
from sdhj.problem.grid import Grid
from sdhj.problem.memory import require

NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)  # for means over time of velocities that depend on nothing else
# fractions of an interval at which time-dependent velocities are compared: evenly spaced ones would miss vibrations
INSTANTS = np.concatenate([[0.0], (NODES + 1) / 2, [1.0]])
ROUNDING = 1e-12  # of pushes, relative to the greatest
FAN, MOST_WAYS = 4, 64  # normals of planes in the plane of two axes: so many for each piece of v, and at most
MOST_PIECES = 4096  # of the box of v, of which hulls are made: with more, what they lead to is a box
MOST_STEPS = 100_000  # time steps of one PDE; whatever needs more has a wrong unit


@dataclass(frozen=True)
class Velocities:
    """The velocity set at every node, in the form that the kernels take: v_i in [low_i, high_i].

    low, high : of each axis, its unit per second: arrays (ndim,) if they do not depend on the state, else (ndim,
        *shape), or a list of arrays that broadcast to the shape, each on the axes that it varies along.
    drift, gain : only if the adversary couples axes or a coordinate was projected out: (modes, ndim, *shape) and
        (modes, ndim, D, *shape), the latter times the bounds of v. Then H(p) = max over modes of p . drift + sum_d |p .
        gain_d|.
    shape : of the grid, where it is not that of the arrays.
    terms : what `sdhj.solver.schemes` makes of them for the kernels, by the layout; None: it is not kept.
    """

    low: Any
    high: Any
    drift: FloatArray | None = None
    gain: FloatArray | None = None
    shape: tuple[int, ...] = ()
    terms: dict[Any, Any] | None = field(default=None, repr=False)  # what is made of them for the kernels, if kept

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        read_only((self.low, self.high, self.drift, self.gain))

    def kept(self) -> "Velocities":
        """The same velocities with a dictionary `terms`, in which what is made of them for the kernels is kept, by the
        layout.
        """
        return self if self.terms is not None else replace(self, terms={})

    @property
    def coupled(self) -> bool:
        """Whether the adversary couples axes, so that the velocity set is no box."""
        return self.drift is not None

    @property
    def nbytes(self) -> int:
        """Bytes of low, high, drift and gain; what is in `terms` is not counted."""
        parts = [part for part in (self.low, self.high, self.drift, self.gain) if part is not None]
        return sum(one.nbytes for part in parts for one in ([part] if isinstance(part, np.ndarray) else part))

    def steps(self, grid: Grid, duration: float, cfl: float) -> int:
        """Number of time steps that the CFL condition dt * sum_i max|v_i| / dx_i <= cfl requires, at most `MOST_STEPS`.

        ValueError if it is more.
        """
        speed = [np.maximum(np.abs(low), np.abs(high)) for low, high in zip(self.low, self.high, strict=True)]
        # no BLAS, whose threads would compete with the kernels'
        rate = np.max(sum(along / spacing for along, spacing in zip(speed, grid.spacing, strict=True)))
        count = duration * float(rate) / cfl * (1 - 1e-9)
        if count > MOST_STEPS:
            what = f"time steps for each PDE, at cfl {cfl:g}"
            raise too_fast(grid, np.array([along.max() for along in speed]), duration, count, what)
        return int(np.ceil(count))


def too_fast(grid: Grid, speed: FloatArray, duration: float, count: float, what: str) -> ValueError:
    """A ValueError to be raised for an interval of `duration` s that needs too many (`count`) of `what` at speeds
    (ndim,); it names the axis on which most cells are crossed.
    """
    axis = int(np.argmax(speed / np.array(grid.spacing)))
    return ValueError(
        f"a sampling interval of delta = {duration:g} needs {count:.1e} {what}, and at most {MOST_STEPS:,} are "
        f"supported: along axis {axis} ({grid.names[axis]}) the velocity is up to {speed[axis]:g} and nodes are "
        f"{grid.spacing[axis]:g} apart; use a shorter delta, lower velocities or fewer nodes, or check their units"
    )


def narrowed(low: FloatArray, high: FloatArray, spread: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lower and upper corners of boxes, each moved towards the other by `spread` >= 0 (all broadcast); both in the
    middle where no more than rounding would be left between them.
    """
    if not np.any(spread):
        return low, high
    middle, left = (low + high) / 2, (high - low) / 2 - spread
    left = np.where(left > ROUNDING * spread, left, 0.0)
    return middle - left, middle + left


def _symmetric(axis: int, pushes: FloatArray) -> bool:
    """Whether the set of segments from -pushes[:, k] to pushes[:, k], pushes (axes, K), is its own mirror image about
    an axis: along each direction as much length as along the mirrored one.
    """
    mirrored = np.where(np.arange(len(pushes)) == axis, -1.0, 1.0)[:, None] * pushes
    lengths = np.sqrt((pushes**2).sum(axis=0))
    same = np.abs(np.abs(pushes.T @ np.hstack([pushes, mirrored])) - np.outer(lengths, np.tile(lengths, 2)))
    along = (same <= 1e-9 * np.outer(lengths, np.tile(lengths, 2))) @ np.diag(np.tile(lengths, 2))
    here, there = np.split(along, 2, axis=1)
    return bool(np.allclose(here.sum(axis=1), there.sum(axis=1), rtol=1e-9, atol=0.0))


def by_input(inputs: FloatArray) -> Iterator[tuple[int, Any]]:
    """Yield each input that occurs among `inputs` (M,), indices, ascending, and the rows where it does: indices, or a
    slice where M is 1.
    """
    if len(inputs) == 1:  # without it a single run takes 1.08 of the time
        yield int(inputs[0]), slice(None)
        return
    for j in np.flatnonzero(np.bincount(inputs)).tolist():
        yield j, np.flatnonzero(inputs == j)


@dataclass(frozen=True, eq=False)
class Interval:
    """The motion from one sampling time to the next, under a constant input and any disturbance.

    Made by `ReachAvoidProblem.interval`. It moves states (`advance`), bounds where they may be at the end (`ahead`,
    `reachable_boxes`), and has the velocity sets of the games (`velocities`, `displacement_boxes`). States may have any
    coordinates on periodic axes.
    """

    grid: Grid
    dynamics: VectorField
    begin: float  # when it begins, s
    delta: float  # how long it lasts, s
    early: float = 0.0  # how much sooner the adversary may end it, s
    wider: FloatArray | float = 0.0  # (ndim,), by how much boxes of what is reachable are widened
    whole: "Interval | None" = None  # of a window of a grid: that on all of it

    @property
    def end(self) -> float:
        """The time at which the interval ends, s: begin + delta."""
        return self.begin + self.delta

    @cached_property
    def walled(self) -> "Interval":
        """The same interval on a grid with walls at all ends, at which states are then clipped."""
        return replace(self, grid=self.grid.walled)

    # ---- of single states: the controller, the adversaries, the plant

    def drift(self, states: Any, j: int, t: Any) -> Any:
        """Velocity of states (M, ndim) under input j without the adversary at time t, s: (M, ndim). Traced arrays may
        be given, too.
        """
        return self.dynamics.drift_at(self.grid.wrapped(states), j, t)

    def gain(self, states: FloatArray, inputs: FloatArray, t: float) -> FloatArray:
        """The gain for each state (M, ndim) under its input, indices (M,), at time t: (M, ndim, D); see
        `VectorField.gain_at`.
        """
        points = self.grid.wrapped(states)
        if self.dynamics.alike:
            return self.dynamics.gain_at(points, 0, t)
        gain = np.empty((*states.shape, self.dynamics.adversaries))
        for j, rows in by_input(inputs):
            gain[rows] = self.dynamics.gain_at(points[rows], j, t)
        return gain

    def bounds(self, inputs: FloatArray, t: float) -> FloatArray:
        """Half-widths of the adversary's box under each of the inputs (M,), indices, at time t: (M, D)."""
        if self.dynamics.alike:
            return np.broadcast_to(self.dynamics.bounds_at(0, t), (len(inputs), self.dynamics.adversaries))
        table = np.stack([self.dynamics.bounds_at(j, t) for j in range(len(self.dynamics.inputs))])
        return table[inputs]

    def undisturbed(self, states: FloatArray, inputs: FloatArray, t: float) -> FloatArray:
        """Velocity of each state (M, ndim) under its input, indices (M,), without an adversary at time t: (M, ndim)."""
        if self.dynamics.constant:
            return self.dynamics.arrays[0][inputs]
        velocity = np.empty_like(states)
        for j, rows in by_input(inputs):
            velocity[rows] = self.drift(states[rows], j, t)
        return velocity

    def advance(self, states: FloatArray, inputs: FloatArray, v: FloatArray, t: float, duration: float) -> FloatArray:
        """States `duration` s after t under constant inputs (M,) and v (M, D), clipped at the walls of the grid.

        Exact for constant velocities, else one Runge-Kutta step of order 4.
        """
        if self.dynamics.constant:
            moved = states + duration * (self.dynamics.arrays[0][inputs] + v @ self.dynamics.arrays[1].T)
            return self.grid.clipped(moved)
        out, whole = np.empty_like(states), np.concatenate([states, v], axis=1)
        for j, rows in by_input(inputs):
            step = self._as_formula(("step", j), partial(self._runge_kutta, j), whole.shape[1], 2)
            out[rows] = step(whole[rows], t, duration)
        return out

    def _runge_kutta(self, j: int, whole: Any, t: Any, duration: Any) -> Any:
        """One Runge-Kutta step of order 4 under input j, from time t, clipped at walls at each stage: states and
        disturbances side by side, (M, ndim + D), to the states `duration` s later, (M, ndim).
        """
        states, v = whole[:, : self.grid.ndim], whole[:, self.grid.ndim :]

        def velocity(q: Any, now: Any) -> Any:
            """The velocity at states q (M, ndim) and time `now`, s, under input j and v."""
            return self.dynamics.velocity_at(self.grid.wrapped(q), j, v, now)

        def moved(span: Any, slope: Any) -> Any:
            """`states` moved for a time `span` at a velocity `slope` (M, ndim), clipped at walls."""
            return self.grid.clipped(states + span * slope)

        k1 = velocity(states, t)
        k2 = velocity(moved(duration / 2, k1), t + duration / 2)
        k3 = velocity(moved(duration / 2, k2), t + duration / 2)
        k4 = velocity(moved(duration, k3), t + duration)
        return moved(duration, (k1 + 2 * k2 + 2 * k3 + k4) / 6)

    def _as_formula(self, what: tuple[Any, ...], function: Any, coordinates: int, parameters: int = 1) -> Any:
        """A function of points (M, coordinates), and of so many parameters of which the first is the time, as one
        formula, made once for `what` on this grid; the function itself where the dynamics have black boxes.
        """
        if not self.dynamics.formulas:
            return function
        grid = self.grid
        key = "where the state moves to", *what, grid.lower, grid.upper, grid.periodic, grid.ends
        return self.dynamics.made_once(key, function, coordinates, parameters)

    def displacements(self, states: FloatArray) -> FloatArray:
        """Where every input takes each state (M, ndim) in the interval without an adversary, relative to it.

        Shape (M, L, ndim), or (1, L, ndim) where it is the same for all states. Exact for a constant drift, else by the
        midpoint rule.
        """
        _, _, moved, more = self.ahead(states)[:PATH]
        return np.moveaxis(moved + more, -1, 0)

    def _moves(self, states: Any, begin: Any) -> tuple[Any, Any]:
        """Where every input j takes the states without an adversary, relative to them, both (M, L, ndim): delta f(x,
        t), and by the midpoint rule delta f(x + delta f / 2, t + delta / 2). `begin` is t, s.
        """
        moves, later = [], []
        for j in range(len(self.dynamics.inputs)):
            moves.append(self.delta * self.drift(states, j, begin))
            halfway = self.grid.clipped(states + moves[-1] / 2)
            later.append(self.delta * self.drift(halfway, j, begin + self.delta / 2))
        return np.stack(moves, axis=1), np.stack(later, axis=1)

    def reachable_boxes(self, states: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Boxes that hold the states at the interval's end under each input and any adversary, relative to the states.

        Lower and upper corners, both (M, L, ndim), or (1, L, ndim) where they are the same for all states. Exact where
        velocities do not depend on the state; else the adversary's gain is that at the start, and pieces of v have
        the velocities halfway.
        """
        low, high, _, _, *halves = np.moveaxis(self.ahead(states), -1, 1)
        spread = np.abs(halves).sum(axis=0) if halves and not self.normals.size else 0.0
        return low - spread, high + spread

    def reaches(self, states: FloatArray, sides: FloatArray) -> FloatArray:
        """Some of the states of `reachable_boxes` that the adversary can bring about, relative to the states: (M, L, P,
        ndim), or (1, L, P, ndim).

        sides (P, ndim), each from 0 to 1: of a box the points there, as if its corners were 0 and 1. Where components
        of v move several axes, each is at the end that lies farther in this direction from the middle; between planes,
        where the way from the middle of the box to the point leaves them.
        """
        low, high, _, _, *halves = np.moveaxis(self.ahead(states), -1, 1)[..., None, :]
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

    def ahead(self, states: FloatArray) -> FloatArray:
        """Boxes and paths that each input leads to, relative to the states: (4 + K, L, ndim, M or 1 if alike for all).

        [0], [1]: lower and upper corners of a box. [2] and [3], a and b: the path without an adversary, x(t + s delta)
        = x + s a + s^2 b for 0 <= s <= 1. Exact for a constant drift, else to second order. Behind them, half of each
        segment that components of v which move several axes add to the box (`VectorField.oblique`); or the greatest n .
        x of the states x at the end for each of the `normals` n, ndim of them in a term.
        """
        if self.dynamics.stateless:
            return self._ahead_everywhere.copy()  # compiled look-ups take it in place of what they write
        found = (self.ahead_formula or self._ahead)(states, self.begin)
        return np.ascontiguousarray(np.moveaxis(found, 0, -1))

    @kept
    def _ahead_everywhere(self) -> FloatArray:
        """`ahead` where it is the same for all states, (4 + K, L, ndim, 1)."""
        return np.ascontiguousarray(np.moveaxis(self._ahead(np.array([self.grid.lower]), self.begin), 0, -1))

    @property
    def ahead_formula(self) -> Formula | None:
        """`ahead` as one formula of states and the time of the interval's begin, (4 + K, L, ndim) for each state.

        None where it is the same for all states, where the dynamics have a black box, or where v does not enter
        linearly.
        """
        dynamics = self.dynamics
        if dynamics.stateless or not dynamics.formulas or dynamics.gain is None:
            return None
        what = "ahead", self.delta, self.early, *np.ravel(self.wider).tolist()
        found: Formula = self._as_formula(what, self._ahead, self.grid.ndim)
        return found

    def _ahead(self, states: Any, begin: Any) -> Any:
        """`ahead` of states (M, ndim) of an interval that begins at `begin`, s, with the states first: (M, 4 + K, L,
        ndim).

        The boxes are hulls over the ends that the adversary may choose (now, in the middle and at the latest), widened
        by `wider`. States may be traced.
        """
        lasting = [self.delta - by * self.early for by in ((0.0, 0.5, 1.0) if self.early else (0.0,))]
        if (normals := self.normals).size:
            ways = np.concatenate([-np.eye(self.grid.ndim), np.eye(self.grid.ndim), normals])
            ends = [replace(self, delta=delta)._greatest_along(states, begin, ways) for delta in lasting]
            far = np.maximum.reduce(ends) + np.abs(ways) @ (self.wider + np.zeros(self.grid.ndim))
            moved, later = self._moves(states, begin)
            terms = np.pad(far, [(0, 0), (0, 0), (0, -far.shape[2] % self.grid.ndim)])
            low, high, *more = np.split(terms, terms.shape[2] // self.grid.ndim, axis=2)
            return np.stack([-low, high, *np.broadcast_arrays(moved, later - moved), *more], axis=1)
        corners = [replace(self, delta=delta)._corners(states, begin) for delta in lasting]
        low, high = (reduce(*one) for one in zip((np.minimum, np.maximum), zip(*corners, strict=True), strict=True))
        moved, later = self._moves(states, begin)
        segments = [self.delta * half for half in self._half_segments(states, begin)]
        return np.stack([low - self.wider, high + self.wider, moved, later - moved, *segments], axis=1)

    @kept
    def normals(self) -> FloatArray:
        """Normals of the planes that states end between where v is cut into pieces, (K, ndim), apart from the axes.

        In the plane of each two axes that a component moves, `FAN` for each of its pieces, evenly apart as nodes are.
        The mean of v's velocities over an interval lies in the hull of those of the pieces, whose greatest part along
        each normal is known; the more pieces, the less is between the planes beside that hull.
        """
        dynamics, ndim, found = self.dynamics, self.grid.ndim, list[FloatArray]()
        pieces = math.prod(dynamics.cuts(range(ndim)))
        for pair in combinations(range(ndim), 2) if 1 < pieces <= MOST_PIECES else ():
            most = max(dynamics.cuts(pair))
            ways = min(FAN * most, MOST_WAYS)
            for k in range(ways if most > 1 else 0):
                if 4 * k % ways:  # not along an axis
                    normal = np.zeros(ndim)
                    normal[list(pair)] = np.cos(angle := 2 * np.pi * k / ways), np.sin(angle)
                    found.append(normal / self.grid.spacing)
        return np.array(found).reshape(-1, ndim)

    def _greatest_along(self, states: FloatArray, begin: float, ways: FloatArray) -> FloatArray:
        """The greatest n . (x(end) - x) over all v for each way n (K, ndim), under each input: (M, L, K). States (M,
        ndim); the interval begins at `begin`, s.

        Exact where velocities do not depend on the state; else delta times the greatest velocity beyond the drift
        halfway, at the begin, middle and end.
        """
        dynamics, count = self.dynamics, range(len(self.dynamics.inputs))
        if dynamics.stateless:
            times = self.begin + self.delta * (NODES + 1) / 2 if dynamics.timed else np.array([self.begin])
            shares = self.delta * (WEIGHTS / 2 if dynamics.timed else np.ones(1))
            nothing = np.zeros((1, self.grid.ndim))
            each = [[dynamics.along(nothing, j, t, ways) for t in times.tolist()] for j in count]
            return np.tensordot(shares, np.array(each), axes=(0, 1)).swapaxes(0, 1)
        instants = [begin] if not dynamics.timed else [begin, begin + self.delta / 2, begin + self.delta]
        (moved, centre), far = self._moves(states, begin), []
        for j in count:
            # where the state is halfway without an adversary: velocities at the begin alone would err to first order
            points = self.grid.wrapped(self.grid.clipped(states + moved[:, j] / 2))
            beyond = [dynamics.along(points, j, t, ways) - dynamics.drift_at(points, j, t) @ ways.T for t in instants]
            far.append(centre[:, j] @ ways.T + self.delta * np.maximum.reduce(beyond))
        return np.stack(far, axis=1)

    def _half_segments(self, states: Any, begin: Any) -> list[Any]:
        """For each component d of v in `VectorField.oblique`: gain_d bounds_d under each input, (M, L, ndim), which is
        half of the segment that it adds to the velocity of states (M, ndim); a list.
        """
        dynamics, points, count = self.dynamics, self.grid.wrapped(states), range(len(self.dynamics.inputs))
        if not dynamics.oblique:
            return []
        gains = [dynamics.gain_at(points, j, begin) for j in count]
        bounds = [dynamics.bounds_at(j, self.begin) for j in count]
        return [np.stack([gains[j][:, :, d] * bounds[j][d] for j in count], axis=1) for d in dynamics.oblique]

    def _corners(self, states: Any, begin: Any) -> tuple[Any, Any]:
        """Lower and upper corners at the end, relative to the states (M, ndim), of what the drift and those components
        of v that move one axis add: both (M, L, ndim), or (1, L, ndim) where velocities do not depend on the state.

        Exact there; else the drift by the midpoint rule, and around it delta times the greatest deviation by v, at the
        begin and, if anything depends on time, in the middle and at the end. `begin` is the time, s, at which the
        interval begins.
        """
        dynamics = self.dynamics
        if dynamics.stateless:
            low, high = self.displacement_boxes(0.0, self.delta)
            spread = sum((np.abs(half[0]) for half in self._half_segments(states, begin)), np.zeros_like(low))
            low, high = narrowed(low, high, self.delta * spread)
            return low[None], high[None]
        centre, points = self._moves(states, begin)[1], self.grid.wrapped(states)
        times = [begin] if not dynamics.timed else [begin, begin + self.delta / 2, begin + self.delta]
        lows, highs = [], []
        for j in range(len(dynamics.inputs)):
            if dynamics.oblique:
                some = dynamics.bounds_at(j, self.begin) * ~np.isin(np.arange(dynamics.adversaries), dynamics.oblique)
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
        """The least and the greatest velocity along each axis under each input at time t: (2, L, ndim)."""
        nothing = np.zeros((1, self.grid.ndim))
        each = [self.dynamics.extremes(nothing, j, t)[0] for j in range(len(self.dynamics.inputs))]
        return np.stack(each, axis=1)

    @kept
    def _constant_extremes(self) -> FloatArray:
        """`extremes` where they do not depend on time, found once."""
        return self.extremes(self.begin)

    def displacement_boxes(self, begin: float, end: float) -> tuple[FloatArray, FloatArray]:
        """Lower and upper corners, (L, ndim) each, of the displacements under each input from `begin` to `end`, s into
        the interval.

        (end - begin) times the mean over time of the least and the greatest velocity. For velocities that do not depend
        on the state; exact where they do not depend on time, else by Gauss's rule with 8 nodes.
        """
        if self.dynamics.timed:
            times = self.begin + begin + (end - begin) * (NODES + 1) / 2
            mean = np.tensordot(WEIGHTS / 2, np.stack([self.extremes(t) for t in times]), axes=1)
        else:
            mean = self._constant_extremes
        low, high = (end - begin) * mean
        return low, high

    def segments(self, axes: Sequence[int]) -> FloatArray:
        """Of components of v that move several of some axes, half the segment that each adds to the velocity, gain_d
        bounds_d: (L, K, axes).

        The displacement over tau is that of the box less their share, plus any point of each segment times tau. None (K
        = 0) where gain or bounds depend on time, and none of those that move an axis with a wall, unless nothing drifts
        along it and the set of segments is symmetric about it: what is held at a wall may end elsewhere. For velocities
        that do not depend on the state.
        """
        dynamics, own, grid = self.dynamics, list(axes), self.grid
        fixed = dynamics.gain is not None and not (dynamics.gain.timed or dynamics.bounds.timed)
        if not fixed or not dynamics.couples(own):
            return np.zeros((len(dynamics.inputs), 0, len(own)))
        nothing, count = np.zeros((1, grid.ndim)), range(len(dynamics.inputs))
        pushes = np.stack([dynamics.gain_at(nothing, j, self.begin)[0] * dynamics.bounds_at(j) for j in count])[:, own]
        some = np.abs(pushes) > ROUNDING * np.abs(pushes).max()  # the rest is rounding, as of a gain that is a rotation
        pushes *= some
        oblique = (some.sum(axis=1) > 1).any(axis=0)
        for i, axis in enumerate(own):
            if self._holds(axis, i, pushes[:, :, oblique]):
                oblique &= ~some[:, i].any(axis=0)
        return np.ascontiguousarray(np.swapaxes(pushes[:, :, oblique], 1, 2))

    def _holds(self, axis: int, place: int, pushes: FloatArray) -> bool:
        """Whether an axis has a wall at which states may be held and then end outside the sum of segments, pushes (L,
        axes, K) with this axis at `place`: where something drifts along it, or they are not symmetric about it.
        """
        nothing, dynamics = np.zeros((1, self.grid.ndim)), self.dynamics
        if not self.grid.ends_where("holds")[:, axis].any():
            return False
        drifts = (dynamics.drift_at(nothing, j, self.begin)[0, axis] for j in range(len(dynamics.inputs)))
        return dynamics.drift.timed or any(drifts) or not all(map(partial(_symmetric, place), pushes))

    @property
    def held(self) -> FloatArray:
        """Coordinates of the lower and upper walls at which states may end outside the sum of segments or past the
        planes, (2, ndim); -inf and inf for other ends.
        """
        dynamics, walls, axes = self.dynamics, np.array(self.grid.faces("holds")), range(self.grid.ndim)
        if self.normals.size:
            walls = np.where(self.normals.any(axis=0), walls, np.array([[-np.inf], [np.inf]]))
        if dynamics.oblique and dynamics.stateless:
            pushes = np.stack(self._half_segments(np.zeros((1, len(axes))), self.begin), axis=-1)[0]
            past = np.array([[-np.inf], [np.inf]])
            walls = np.where([self._holds(axis, axis, pushes) for axis in axes], walls, past)
        return walls

    # ---- on the grid: velocity sets for the games

    def _sampled(self, formula: Formula, seen: Sequence[int], t: float) -> FloatArray:
        """A formula of one result at the nodes of the axes that it reads, time t; broadcastable over the subgrid of the
        axes `seen`, which are these and others.
        """
        read = [axis for axis in seen if formula.reads[0, axis]]
        if not read:
            return formula(np.array([self.grid.lower]), t).reshape((1,) * len(seen))
        grid, some = self.grid.subgrid(read), formula.restricted(read)
        values = np.concatenate([some(piece.points(), t) for piece in grid.pieces()]).reshape(grid.shape)
        return self.grid.subgrid(seen).lift(values, [seen.index(axis) for axis in read])

    def ends_at_nodes(self, j: int, t: float) -> tuple[list[FloatArray], list[FloatArray]]:
        """The least and the greatest velocity along each axis under u_j over all v at the nodes, time t: two lists of
        ndim arrays that broadcast to the grid's shape, each on the axes that it reads.
        """
        dynamics, everything, ndim = self.dynamics, list(range(self.grid.ndim)), self.grid.ndim
        if dynamics.formulas and dynamics.gain is not None:
            found = [self._sampled(dynamics.component("extremes", j, row), everything, t) for row in range(2 * ndim)]
            return found[:ndim], found[ndim:]
        pieces = [dynamics.extremes(piece.points(), j, t) for piece in self.grid.pieces()]
        least, greatest = np.moveaxis(np.concatenate(pieces), 0, 2).reshape(2, ndim, *self.grid.shape)
        return list(least), list(greatest)

    @kept
    def speeds(self) -> FloatArray:
        """The greatest |velocity| along each axis over all nodes, inputs and v: (ndim,); of what depends on time at
        some instants of the interval. On a window that of the whole grid.
        """
        if self.whole is not None:
            return self.whole.speeds
        instants = self.begin + self.delta * (INSTANTS[::4] if self.dynamics.timed else INSTANTS[:1])
        ends = [self.ends_at_nodes(j, t) for j, t in product(range(len(self.dynamics.inputs)), instants.tolist())]
        return np.max([[max(-low.min(), high.max()) for low, high in zip(*pair, strict=True)] for pair in ends], axis=0)

    def on(self, grid: Grid) -> "Interval":
        """The interval on a window of its grid; what is said of the whole grid (`speeds`) stays as it is there."""
        return replace(self, grid=grid, whole=self)

    def self_contained(self, axes: Iterable[int]) -> tuple[int, ...]:
        """The smallest set of axes, ascending, that holds `axes` and whose velocities depend on no other coordinate."""
        found = set(axes)
        while grown := {int(k) for i in found for k in np.flatnonzero(self.dynamics.reads[i])} - found:
            found |= grown
        return tuple(sorted(found))

    def velocities(self, j: int, axes: Sequence[int], t: float | None = None, *, drift: bool = True) -> Velocities:
        """The velocity set under u_j along some axes at time t, by default at the begin, on their subgrid.

        Coordinates left out that enter are taken at all their nodes (App. A.4): each is one mode, H = max over modes.
        Where they move the velocity of one axis at most and the adversary does not couple axes, the hull of the modes'
        boxes has the same H: it is again a box, cheaper and with the sharper flux. drift=False leaves the drift out
        (the moving frame).
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
        spread = np.abs(b).sum(axis=2)
        lower, upper = f - spread, f + spread
        hull = lower.min(axis=0), upper.max(axis=0)
        swayed = [((lower[:, i] != hull[0][i]) | (upper[:, i] != hull[1][i])).any() for i in range(len(axes))]
        coupled = (np.count_nonzero(dynamics.pushes[j][axes], axis=0) > 1).any()
        return Velocities(*hull) if sum(swayed) <= 1 and not coupled else Velocities(*hull, drift=f, gain=b)

    def _with_axes_read(self, axes: list[int]) -> tuple[list[int], tuple[int, ...]]:
        """Some axes and all those that their velocities read, ascending; and the places in this list of the axes that
        were added.
        """
        seen = sorted({*axes, *np.flatnonzero(self.dynamics.reads[axes].any(axis=0)).tolist()})
        return seen, tuple(i for i, axis in enumerate(seen) if axis not in axes)

    def _hull(self, j: int, axes: list[int], t: float) -> Velocities | None:
        """The velocity set under u_j along some axes at time t as a box, each end sampled on the axes that it reads and
        its extreme taken over coordinates left out.

        None where a box would be larger than the set: where the adversary couples the axes, or left-out coordinates
        move the velocity of several; and where it cannot be sampled so, with black boxes or v that does not enter
        linearly. ValueError where a bound is below 0.
        """
        dynamics, (seen, outside) = self.dynamics, self._with_axes_read(axes)
        if not dynamics.formulas or dynamics.gain is None:
            return None
        if (np.count_nonzero(dynamics.pushes[j][axes], axis=0) > 1).any():
            return None
        dynamics.bounds_at(j, t)  # refuses what is below 0
        lows, highs, swayed = list[FloatArray](), list[FloatArray](), 0
        for axis in axes:
            both = (dynamics.component("extremes", j, row) for row in (axis, axis + dynamics.ndim))
            low, high = (self._sampled(one, seen, t) for one in both)
            lows.append(low.min(axis=outside))
            highs.append(high.max(axis=outside))
            swayed += bool(np.ptp(low, axis=outside).any() or np.ptp(high, axis=outside).any())
        return Velocities(lows, highs, shape=self.grid.subgrid(axes).shape) if swayed <= 1 else None

    def _points_of_axes(self, seen: list[int]) -> FloatArray:
        """States (M, ndim) at the nodes of the subgrid of the axes `seen`, the other coordinates at their lower
        ends.
        """
        grid = self.grid.subgrid(seen)
        points = np.tile(np.array(self.grid.lower), (grid.size, 1))
        points[:, seen] = grid.points()
        return points

    def _boxes_of_pieces(self, j: int, axes: list[int], t: float) -> Velocities:
        """The velocity set under u_j along some axes at time t where v does not enter linearly: a box, or one for each
        piece of v's range, as modes whose gain is diagonal.

        A velocity is in the box of some piece, so that H is at most the maximum over them, and no less than that of a
        box over the whole range. Boxes hold all coordinates that are left out. MemoryError where the pieces do not fit.
        """
        dynamics, (seen, outside), cuts = self.dynamics, self._with_axes_read(axes), self.dynamics.cuts(axes)
        grid, places, count = self.grid.subgrid(seen), tuple(1 + place for place in outside), math.prod(cuts)
        if count > 1:
            require(8 * count * len(axes) * (3 + len(axes)) * grid.size, f"velocities of {count} pieces of v")
        points, lows, highs = self._points_of_axes(seen), list[FloatArray](), list[FloatArray]()
        ends = dynamics.disturbance(j, points, points, (t, t))
        nodes = [np.linspace(end[0], end[1], cut + 1) for end, cut in zip(ends.T, cuts, strict=True)]
        for at in product(*map(range, cuts)):
            v = [(float(one[i]), float(one[i + 1])) for one, i in zip(nodes, at, strict=True)]
            found = dynamics.each["drift"][j].bounds(points, points, (t, t), *v)
            low, high = (end[:, axes].T.reshape(-1, *grid.shape) for end in found)
            lows.append(low.min(axis=places))
            highs.append(high.max(axis=places))
        if count == 1:
            return Velocities(lows[0], highs[0])
        low, high = np.array(lows), np.array(highs)
        gain = np.zeros((count, len(axes), *low.shape[1:]))
        for axis in range(len(axes)):
            gain[:, axis, axis] = (high[:, axis] - low[:, axis]) / 2
        return Velocities(low.min(axis=0), high.max(axis=0), drift=(low + high) / 2, gain=gain)

    def _modes(self, j: int, axes: list[int], t: float) -> tuple[FloatArray, FloatArray]:
        """Drift (modes, axes, *subgrid) and gain times bounds (modes, axes, D, *subgrid) under u_j along some axes at
        time t: a mode for each combination of nodes of the coordinates left out that enter. MemoryError if they do not
        fit.
        """
        dynamics, (seen, outside) = self.dynamics, self._with_axes_read(axes)
        grid, count = self.grid.subgrid(seen), dynamics.adversaries
        require(8 * len(axes) * grid.size * (count + 3), "sampling the velocities")
        sampled = np.zeros((len(axes), 1 + count, *grid.shape))
        bounds = dynamics.bounds_at(j, t)
        if dynamics.formulas:
            for row, axis in enumerate(axes):
                sampled[row, 0] = self._sampled(dynamics.component("drift", j, axis), seen, t)
                for d in np.flatnonzero(dynamics.pushes[j, axis]).tolist():
                    push = dynamics.component("gain", j, axis * count + d)
                    sampled[row, 1 + d] = bounds[d] * self._sampled(push, seen, t)
        else:
            points = self._points_of_axes(seen)
            gain = dynamics.gain_at(points, j, t)[:, axes] * bounds
            parts = np.concatenate([dynamics.drift_at(points, j, t)[:, axes, None], gain], axis=2)
            sampled = np.moveaxis(parts, 0, 2).reshape(sampled.shape)
        sampled = np.moveaxis(sampled, [2 + place for place in outside], range(len(outside)))
        sampled = sampled.reshape(-1, *sampled.shape[len(outside) :])
        return sampled[:, :, 0], sampled[:, :, 1:]
