"""What one interval does to the cells of any problem, by bounds that its author states.

Reach boxes come from a growth bound. Let |x(t0) - c| <= h hold on every axis, and let F(x, t) = f(x, u_j, t) +
g(x, u_j, t) v, v any share of the adversary's box, change with the state by at most A |x - y| and with time by at most
B |t - s| (A a matrix and B a row of non-negative numbers, the same for every input and share). Let |g v| <= w hold at c
and at s, the middle of a time of length T. Over that time the state moves away from c by at most r with

    r = h + T (|f(c, u_j, s)| + w + B T / 2 + A r),

so its velocity is within A r + w + B T / 2 of f(c, u_j, s) throughout, and the box moves with it. The interval is cut
into parts so that A r stays small. Nothing is integrated and no step is approximate. Walls only hold the state back: a
box is cut at them.
"""

import itertools
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from sdhj.certified.cells import CellAxis
from sdhj.certified.packed import cell_masks
from sdhj.grid import FloatArray
from sdhj.problem import ReachAvoidProblem, TargetSet, UnsafeSet

if TYPE_CHECKING:
    from sdhj.certified.table import CertifiedTable

SEAM = 1e-6  # a larger difference across the seam of a periodic axis, relative to the values, is a jump
PAIRS = 2000  # of states, by which the bounds along an axis are tried
ALLOWANCE = 1e-9  # for the rounding of a user's function, relative to its value or absolute below one


@dataclass(frozen=True)
class LipschitzBounds:
    """How fast a problem's functions can change with the state, and the dynamics with time.

    Parameters
    ----------
    dynamics : (ndim, ndim) array, optional
        dynamics[i, k] >= |d/dx_k (drift_i + sum_d gain_id v_d)| everywhere, for every input and |v_d| <= bounds_d. Not
        needed (zero) where the dynamics do not depend on the state.
    sets : mapping from the name of a set to a sequence of float
        For the target and each unsafe set: a bound on |d(level set)/dx| for each of its axes.
    time : (ndim,) array, optional
        time[i] >= |d/dt (drift_i + sum_d gain_id r_d bounds_d)| everywhere, for every input and |r_d| <= 1: a bound on
        |d velocity/dt| for each axis. Not needed (zero) where the dynamics do not depend on time.
    """

    dynamics: FloatArray | None = None
    sets: Mapping[str, Sequence[float]] = field(default_factory=dict)
    time: FloatArray | None = None

    def checked(self, problem: ReachAvoidProblem) -> tuple[FloatArray, FloatArray, dict[str, FloatArray]]:
        """`dynamics` (ndim, ndim), `time` (ndim,) and `sets` by name; ValueError where they do not fit the problem."""
        ndim, names = problem.grid.ndim, [part.name for part in known_sets(problem)]
        if len(set(names)) < len(names):
            raise ValueError(f"two of the sets have one name, by which bounds are told; rename one of {names}")
        if missing := [name for name in names if name not in self.sets]:
            raise ValueError(
                f"no Lipschitz bounds for the sets {', '.join(map(repr, missing))}: give bounds=LipschitzBounds(sets="
                "{name: [a bound on |d(level set)/dx| for each axis of the set]}), from sdhj.certified"
            )
        if unknown := sorted(set(self.sets) - set(names)):
            raise ValueError(
                f"Lipschitz bounds for {', '.join(map(repr, unknown))}, but the problem's sets are "
                f"{', '.join(map(repr, names))}"
            )
        dynamics, time = self.dynamics, self.time
        if dynamics is None:
            if not stateless(problem):
                raise ValueError(
                    f"the dynamics of {problem.name!r} depend on the state: give LipschitzBounds(dynamics=...), how fast"
                )
            dynamics = np.zeros((ndim, ndim))
        if time is None:
            if timed(problem):
                raise ValueError(
                    f"the dynamics of {problem.name!r} depend on time: give LipschitzBounds(time=...), a bound on "
                    "|d velocity/dt| for each axis"
                )
            time = np.zeros(ndim)
        matrix = _bounds("dynamics of LipschitzBounds", dynamics, (ndim, ndim))
        axes = {part.name: (len(part.axes),) for part in known_sets(problem)}
        sets = {name: _bounds(f"the bounds of the set {name!r}", self.sets[name], axes[name]) for name in names}
        return matrix, _bounds("time of LipschitzBounds", time, (ndim,)), sets


def _bounds(name: str, given: Any, shape: tuple[int, ...]) -> FloatArray:
    bounds = np.asarray(given, dtype=np.float64)
    if bounds.shape != shape or not np.isfinite(bounds).all() or (bounds < 0).any():
        raise ValueError(f"{name} must be {' x '.join(map(str, shape))} finite numbers >= 0, got {bounds.tolist()}")
    return bounds


def known_sets(problem: ReachAvoidProblem) -> list[TargetSet | UnsafeSet]:
    """The target and the unsafe sets."""
    return [problem.target, *problem.unsafe]


def stateless(problem: ReachAvoidProblem) -> bool:
    return bool(getattr(problem.dynamics, "stateless", problem.dynamics.constant))


def timed(problem: ReachAvoidProblem) -> bool:
    return bool(getattr(problem.dynamics, "timed", False))


def velocity_terms(
    problem: ReachAvoidProblem, points: FloatArray, j: int, t: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Drift (M, ndim), gain (M, ndim, D) and the adversary's bounds (D,) at points (M, ndim) under input j at a time."""
    dynamics, points = problem.dynamics, problem.grid.wrapped(points)
    if timed(problem):
        return dynamics.drift_at(points, j, t), dynamics.gain_at(points, j, t), dynamics.bounds_at(j, t)
    return dynamics.drift_at(points, j), dynamics.gain_at(points), dynamics.bounds


@dataclass(frozen=True)
class Boxes:
    """Boxes with centres and half-widths, each (M, ndim), over a time [begin, end] of the interval."""

    centre: FloatArray
    half: FloatArray
    begin: float
    end: float

    def least(self, problem: ReachAvoidProblem, part: UnsafeSet, bounds: FloatArray, start: float) -> FloatArray:
        """Lower bound of an unsafe set's level-set function over the boxes and their times of the interval, (M,)."""
        middle = start + (self.begin + self.end) / 2
        value = np.asarray(problem.value_of(part, self.centre, middle), dtype=np.float64)
        change = self.half[:, list(part.axes)] @ bounds
        return value - change - part.rate * (self.end - self.begin) / 2 - ALLOWANCE * (1.0 + np.abs(value))


class Reach:
    """What can be reached from boxes within one interval: the boxes of each part, and the last one."""

    def __init__(self, problem: ReachAvoidProblem, matrix: FloatArray, drifting: FloatArray, parts: int) -> None:
        self.problem, self.matrix, self.drifting, self.parts = problem, matrix, drifting, parts
        self.time = problem.delta / parts
        system = np.eye(len(matrix)) - self.time * matrix
        if (self.time * matrix).sum(axis=1).max() > 0.5:  # the inverse is non-negative below 1
            raise ValueError("the dynamics change too fast for this interval: use more parts")
        self.inverse = np.linalg.inv(system)

    def run(
        self, low: FloatArray, high: FloatArray, j: int, start: float = 0.0
    ) -> tuple[list[Boxes], FloatArray, FloatArray]:
        """Tube (a `Boxes` for each part) and image (low, high) of boxes low..high (M, ndim) under input j from `start`.

        The interval begins at the time `start`.
        """
        tube = []
        for part in range(self.parts):
            middle = start + (part + 0.5) * self.time
            slow, fast = self._velocities((low + high) / 2, (high - low) / 2, j, middle)
            after_low, after_high = self._held(low + self.time * slow), self._held(high + self.time * fast)
            least, most = np.minimum(low, after_low), np.maximum(high, after_high)
            tube.append(Boxes((least + most) / 2, (most - least) / 2, part * self.time, (part + 1) * self.time))
            low, high = after_low, after_high
        return tube, low, high

    def _velocities(self, centre: FloatArray, half: FloatArray, j: int, t: float) -> tuple[FloatArray, FloatArray]:
        """Bounds on the velocity over one part, t its middle, from boxes; each (M, ndim)."""
        drift, gain, bounds = velocity_terms(self.problem, centre, j, t)
        push = np.abs(gain) @ bounds + self.drifting * (self.time / 2)
        push = push + ALLOWANCE * (1.0 + np.abs(drift) + push)
        away = (half + self.time * (np.abs(drift) + push)) @ self.inverse.T * (1 + ALLOWANCE)
        slack = away @ self.matrix.T + push
        return drift - slack, drift + slack

    def _held(self, points: FloatArray) -> FloatArray:
        """Points cut at the walls of bounded axes."""
        low, high = self.problem.grid.walls
        return np.clip(points, low, high)


@dataclass(frozen=True)
class GeneralProof:
    """Which inputs are certified in which cells, for a problem without special geometry.

    Attributes
    ----------
    masks : (entries, bytes, cells) uint8
        Bit j % 8 of byte j // 8: the input u_j is certified for the cell.
    rows : int
        Leading axes that number the blocks of the packed sets: all but the last.
    matrix, drifting, sets : what `LipschitzBounds.checked` returns
    parts : int
        Parts of the interval.
    count : int
        L, how many inputs there are.
    """

    masks: FloatArray
    rows: int
    matrix: FloatArray
    drifting: FloatArray
    sets: Mapping[str, FloatArray]
    parts: int
    count: int
    kind = "general"

    @property
    def nbytes(self) -> int:
        """Bytes that the masks take in memory."""
        return int(self.masks.nbytes)

    def inputs(self, table: "CertifiedTable", states: FloatArray, step: int, places: tuple[int, int]) -> FloatArray:
        """Which inputs are certified for states (M, ndim), bool (M, L); places of S_k^n and S_{k+1}^{n-1}."""
        out = np.empty((len(states), self.masks.shape[1]), np.uint8)
        cell_masks(states, table.cells, self.masks[places[0]], out)
        return np.unpackbits(out, axis=1, count=self.count, bitorder="little").view(np.bool_)

    def save(self, group: h5py.Group) -> None:
        """Write the inputs and the bounds that they rest on."""
        group.attrs["parts"] = self.parts
        group["matrix"], group["drifting"] = self.matrix, self.drifting
        # a name may be anything, also what is a path to HDF5
        group.attrs["sets"] = json.dumps({name: bounds.tolist() for name, bounds in self.sets.items()})
        group.create_dataset("masks", data=self.masks, compression="gzip", shuffle=True)

    @classmethod
    def load(cls, group: h5py.Group, problem: ReachAvoidProblem, axes: Sequence[CellAxis]) -> "GeneralProof":
        """Read what `save` wrote."""
        sets = {name: np.array(bounds) for name, bounds in json.loads(group.attrs["sets"]).items()}
        masks, matrix, drifting = (group[name][()] for name in ("masks", "matrix", "drifting"))
        return cls(masks, len(axes) - 1, matrix, drifting, sets, int(group.attrs["parts"]), len(problem.inputs))


# ---- what of the bounds can be refuted by looking at the functions


def functions_of(problem: ReachAvoidProblem, times: Sequence[float]) -> Iterator[tuple[str, Callable[..., Any]]]:
    """Name and function of points (M, ndim) of every unsafe set, drift and gain, at the times that make a difference."""
    for part in problem.unsafe:
        for t in times if part.moving else times[:1]:
            yield f"level set of {part.name!r} at t = {t:g}", partial(problem.value_of, part, t=t)
    if problem.dynamics.constant:
        return
    for t, j in itertools.product(times if timed(problem) else times[:1], range(len(problem.inputs))):
        told = f" under input {j}" + (f" at t = {t:g}" if timed(problem) else "")
        for term, name in enumerate(("drift", "gain")):
            yield name + told, lambda q, j=j, t=t, term=term: velocity_terms(problem, q, j, t)[term]


def check_seams(problem: ReachAvoidProblem, parts: int) -> None:
    """Refuse functions that jump where a periodic axis closes, at any node: no Lipschitz bound holds across a jump.

    Boxes of tubes reach across that seam; cells of the goal do not, so the target may jump there. What moves may jump
    at some times only: it is tried at the middles of all parts, where it is evaluated, and between them.
    """
    times = (np.arange(2 * parts * problem.steps + 1) * problem.delta / (2 * parts)).tolist()
    grid = problem.grid
    for axis in np.flatnonzero(grid.periodic):
        points = grid.points()[np.indices(grid.shape)[axis].ravel() == 0]
        other = points.copy()
        other[:, axis] = grid.upper[axis] - 1e-9 * (grid.upper[axis] - grid.lower[axis])
        for name, function in functions_of(problem, times):
            here, there = (np.asarray(function(q), dtype=np.float64) for q in (points, other))
            if (jump := float(np.abs(here - there).max(initial=0.0))) > SEAM * (1.0 + float(np.abs(here).max())):
                raise ValueError(
                    f"{name} jumps by {jump:.3g} where the periodic axis {grid.names[axis]!r} closes, so no Lipschitz "
                    f"bound holds there; make it periodic, for example in the sine and cosine of the coordinate"
                )


def check_bounds(problem: ReachAvoidProblem, proof: GeneralProof) -> None:
    """Refuse bounds that differences between a few thousand pairs of states refute; it proves nothing of the others."""
    grid, span, moving = problem.grid, problem.steps * problem.delta, timed(problem)
    low, rng, times = np.array(grid.lower), np.random.default_rng(0), (0.0, 0.37 * span, span)
    inputs = range(0 if problem.dynamics.constant else len(problem.inputs))
    for axis, share in itertools.product(range(grid.ndim), (0.5, 0.02)):
        step = share * grid.spacing[axis]
        room = np.array(grid.upper) - low
        room[axis] -= step  # seams are looked at elsewhere, and the target may jump there
        points = low + rng.random((PAIRS, grid.ndim)) * room
        beside = points.copy()
        beside[:, axis] += step
        told = f"over {step:.3g} along the axis {grid.names[axis]!r}"
        for part, t in itertools.product(known_sets(problem), times):
            bound = float(proof.sets[part.name][part.axes.index(axis)]) if axis in part.axes else 0.0
            here, there = (np.asarray(problem.value_of(part, q, t)) for q in (points, beside))
            _refute(f"the level-set function of {part.name!r}", np.abs(there - here), here, bound, step, told)
        for j, t in itertools.product(inputs, times if moving else times[:1]):
            _refute_velocities(problem, j, [(points, t), (beside, t)], proof.matrix[:, axis], step, told)
            if moving:
                later, before = share * problem.delta, max(t - share * problem.delta, 0.0)
                pair = [(points, before), (points, before + later)]
                _refute_velocities(problem, j, pair, proof.drifting, later, f"over {later:.3g} s at t = {before:.3g}")


def _refute_velocities(
    problem: ReachAvoidProblem, j: int, pair: Sequence[Any], bounds: FloatArray, step: float, told: str
) -> None:
    """Refuse bounds (ndim,) that the velocities at a pair of (states, time), `step` apart, refute."""
    (f, g, b), (f_there, g_there, b_there) = (velocity_terms(problem, q, j, t) for q, t in pair)
    change = np.abs(f_there - f) + np.abs(g_there * b_there - g * b).sum(axis=2)
    for row, name in enumerate(problem.grid.names):
        told_row = f"the velocity along {name!r} under input {j}"
        _refute(told_row, change[:, row], f[:, row], float(bounds[row]), step, told)


def _refute(name: str, change: FloatArray, values: FloatArray, bound: float, step: float, told: str) -> None:
    worst = int(np.argmax(change))
    if change[worst] > bound * step * (1 + ALLOWANCE) + ALLOWANCE * (1.0 + abs(values[worst])):
        raise ValueError(
            f"{name} changes by {change[worst]:.3g} {told}, and its Lipschitz bound {bound:g} allows "
            f"{bound * step:.3g}; give a bound of at least {change[worst] / step:.3g}"
        )


def cover(low: FloatArray, high: FloatArray, axis: CellAxis) -> tuple[FloatArray, FloatArray]:
    """First cell and number of cells that hold [low, high] with room for rounding; int64 each."""
    width, length, count = float(axis.width), float(sum(axis.extent) / 2), axis.count
    low, high = low - float(axis.lower) - ALLOWANCE, high - float(axis.lower) + ALLOWANCE
    laps = (np.floor(low / length), np.floor(high / length)) if axis.periodic else (0.0, 0.0)
    least = -np.inf if axis.periodic else 0
    begin = laps[0] * count + np.clip(np.floor((low - laps[0] * length) / width), least, count - 1)
    end = laps[1] * count + np.minimum(np.ceil((high - laps[1] * length) / width), count)
    begin, end = begin.astype(np.int64), np.maximum(end, begin + 1).astype(np.int64)
    return begin % count, np.minimum(end - begin, count)
