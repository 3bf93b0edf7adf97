"""Bounds on a problem's own functions over boxes of states and intervals of time: what every proof rests on.

For each function the first of these that does:

1. its own `enclosure`, an attribute of the function: `enclosure(low, high, t0, t1) -> (low, high)` of a level-set
   function, with boxes (M, axes) and answers (M,); of drift and gain `enclosure(low, high, u, t0, t1)`;
2. the function itself, called with intervals (`sdhj.certified.enclosures`): nothing is promised by anybody;
3. of a set the same at the middle of the time, and its `rate`; of a set or the dynamics a value at the middle of the
   box, and the `LipschitzBounds` that are stated; of a set its `slope`.

Boxes are cut where an axis ends and where a periodic one closes, so that functions are asked only where the state can
be, and may jump there.
"""

import itertools
import reprlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

import numpy as np

from sdhj.kernels import FloatArray
from sdhj.problem.checks import real_array
from sdhj.problem.dynamics import Dynamics
from sdhj.problem.grid import Grid
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sets import TargetSet, UnsafeSet

PAIRS = 2000  # of states, by which the bounds along an axis are tried
ALLOWANCE = 1e-9  # for the rounding of a user's function, relative to its value or absolute below one
SAMPLES = 16  # boxes by which it is told which coordinates the velocity reads
BOXES = 1 << 16  # that a function is called with at a time
COMPARED = 100  # states at which a set is compared with its enclosure
COMPARED_EACH = 20  # the same for the velocity, under each input
UNFOLLOWED = (TypeError, ValueError, AttributeError, LookupError, NotImplementedError, ImportError)

Ends = tuple[FloatArray, FloatArray]


@dataclass(frozen=True)
class LipschitzBounds:
    """Bounds on how fast functions change that interval arithmetic cannot evaluate. Proofs assume that they hold.

    Parameters
    ----------
    dynamics : (ndim, ndim) array, optional
        dynamics[i, k] >= |d/dx_k (drift_i + sum_d gain_id v_d)| everywhere, for every input and |v_d| <= bounds_d.
    sets : mapping from the name of a set to a sequence of float
        For the target or an unsafe set: a bound on |d(level set)/dx| for each of the axes that the set depends on.
    time : (ndim,) array, optional
        time[i] >= |d/dt (drift_i + sum_d gain_id r_d bounds_d)| everywhere, for every input and |r_d| <= 1: a bound on
        |d velocity/dt| for each axis. It is not needed (zero) where the dynamics do not depend on time.
    """

    dynamics: FloatArray | None = None
    sets: Mapping[str, Any] = field(default_factory=dict)
    time: FloatArray | None = None

    def checked(self, problem: ReachAvoidProblem) -> "LipschitzBounds":
        """The bounds as arrays; ValueError if they do not fit the problem, or sampled differences exceed them."""
        ndim, parts = problem.grid.ndim, known_sets(problem)
        axes = {part.name: (len(part.axes),) for part in parts}
        given_sets: object = self.sets
        if not isinstance(given_sets, Mapping):
            told = reprlib.repr(given_sets)
            raise ValueError(f"sets of LipschitzBounds must be a mapping from the names of sets to bounds, got {told}")
        if len(axes) < len(parts) and self.sets:
            raise ValueError(f"two of the sets have one name, by which bounds are told; rename one of {list(axes)}")
        if unknown := sorted(map(repr, set(self.sets) - set(axes))):
            raise ValueError(
                f"Lipschitz bounds for {', '.join(unknown)}, but the problem's sets are {', '.join(map(repr, axes))}"
            )
        sets = {name: _bounds(f"the bounds of the set {name!r}", self.sets[name], axes[name]) for name in self.sets}
        matrix = _bounds("dynamics of LipschitzBounds", self.dynamics, (ndim, ndim))
        checked = LipschitzBounds(matrix, sets, _bounds("time of LipschitzBounds", self.time, (ndim,)))
        check_stated(problem, checked)
        return checked


def _bounds(name: str, given: Any, shape: tuple[int, ...]) -> Any:
    bounds = None if given is None else real_array(name, given)
    if bounds is not None and (bounds.shape != shape or not np.isfinite(bounds).all() or (bounds < 0).any()):
        raise ValueError(f"{name} must be {' x '.join(map(str, shape))} finite numbers >= 0, got {bounds.tolist()}")
    return bounds


def known_sets(problem: ReachAvoidProblem) -> list[TargetSet | UnsafeSet]:
    """The target, if there is one, and the unsafe sets."""
    return [*([] if problem.stays else [problem.target]), *problem.unsafe]


def velocity_terms(
    problem: ReachAvoidProblem, points: FloatArray, j: int, t: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Drift (M, ndim), gain (M, ndim, D) and the adversary's bounds (D,) at points (M, ndim) under u_j at a time."""
    dynamics, points = problem.dynamics, problem.grid.wrapped(points)
    return dynamics.drift_at(points, j, t), dynamics.gain_at(points, j, t), dynamics.bounds_at(j, t)


@dataclass(frozen=True)
class Bounds:
    """Bounds on the velocity and the level sets of a problem; `stated` is what its author promises.

    signs (D,) : the one vertex of its box that the adversary keeps to; None: any adversary.
    """

    problem: ReachAvoidProblem
    stated: LipschitzBounds
    signs: FloatArray | None = None

    def velocity(self, j: int, low: FloatArray, high: FloatArray, t0: float, t1: float) -> Ends:
        """Least and greatest velocity under u_j, any adversary, in boxes (M, ndim) and [t0, t1]: both (M, ndim)."""
        return _within(self.problem.grid, range(self.problem.grid.ndim), low, high, partial(self._velocity, j, t0, t1))

    def level(self, part: TargetSet | UnsafeSet, low: FloatArray, high: FloatArray, t0: float, t1: float) -> Ends:
        """Least and greatest value of a level set in boxes of its axes (M, axes) and in [t0, t1]: both (M,)."""
        return _within(self.problem.grid, part.axes, low, high, partial(self._level, part, t0, t1))

    @cached_property
    def reads(self) -> FloatArray:
        """Whether the velocity along axis i is bounded more closely where coordinate k is known: (ndim, ndim) bool.

        It tells what is worth knowing; that bounds hold does not hang on it.
        """
        grid, rng = self.problem.grid, np.random.default_rng(0)
        lower, upper, reads = np.array(grid.lower), np.array(grid.upper), np.zeros((grid.ndim, grid.ndim), np.bool_)
        points = lower + rng.random((SAMPLES, grid.ndim)) * (upper - lower)
        for j, k in itertools.product(range(len(self.problem.inputs)), range(grid.ndim)):
            here = self.velocity(j, points, points, 0.0, 0.0)
            low, high = points.copy(), points.copy()
            low[:, k], high[:, k] = lower[k], upper[k]
            wide = self.velocity(j, low, high, 0.0, 0.0)
            reads[:, k] |= np.any([(a != b).any(axis=0) for a, b in zip(here, wide, strict=True)], axis=0)
        return reads

    # ---- one way after the other

    def _level(self, part: Any, t0: float, t1: float, low: FloatArray, high: FloatArray) -> Ends:
        function, rate, bounds = part.level_set.function, getattr(part, "rate", None), self.stated.sets.get(part.name)
        half, middle = ((t1 - t0) / 2, (t0 + t1) / 2) if np.isfinite(t1) else (0.0 if rate == 0 else np.inf, t0)
        moved = rate * half if rate and half else 0.0
        ways: list[Callable[[], Ends]] = []
        if (own := getattr(function, "enclosure", None)) is not None:
            ways.append(lambda: _answered(own(low, high, t0, t1), low[:, 0].shape))

        def followed(begin: float, end: float) -> Ends:
            self._compare(part.name, part.axes, COMPARED, lambda q, t: (function(q.copy(), t),) * 2, alone)
            return _followed(function, low, high, (begin, end))

        def alone(points: FloatArray, t: float) -> Ends:
            return _followed(function, points, points, (t, t))

        ways.append(lambda: followed(t0, t1))
        if t1 > t0 and rate is not None:
            ways.append(lambda: _about(followed(middle, middle), moved))
        centre, reach = (low + high) / 2, (high - low) / 2 * (1 + ALLOWANCE)
        if (bounds is not None or getattr(part, "slope", None) is not None) and (t1 == t0 or rate is not None):
            far = reach @ bounds if bounds is not None else part.slope * np.sqrt((reach**2).sum(axis=1))
            ways.append(lambda: _about((part.level_set(centre, middle),) * 2, far + moved, ALLOWANCE))
        told = f"LipschitzBounds(sets={{{part.name!r}: [...]}})"
        return self._first(f"the level set of {part.name!r}", ways, told)

    def _velocity(self, j: int, t0: float, t1: float, low: FloatArray, high: FloatArray) -> Ends:
        ways, dynamics, bounds, ndim = [], self.problem.dynamics, self.stated, self.problem.grid.ndim

        def alone(points: FloatArray, t: float) -> Ends:
            return _followed_velocity(dynamics, j, points, points, (t, t), self.signs)

        def true(q: FloatArray, t: float) -> Ends:
            drift, gain, most = velocity_terms(self.problem, q, j, t)
            signs = np.sign(gain) * np.array([-1.0, 1.0])[:, None, None, None] if self.signs is None else self.signs
            least, greatest = np.broadcast_to(drift + (gain * (most * signs)).sum(axis=-1), (2, *drift.shape))
            return least, greatest

        def followed() -> Ends:
            self._compare(f"velocity {j}", range(ndim), COMPARED_EACH, true, alone)
            return _followed_velocity(dynamics, j, low, high, (t0, t1), self.signs)

        ways.append(followed)
        if bounds.dynamics is not None or (dynamics.stateless and bounds.time is not None):

            def stated() -> Ends:
                drift, gain, most = velocity_terms(self.problem, (low + high) / 2, j, (t0 + t1) / 2)
                matrix = np.zeros((ndim, ndim)) if bounds.dynamics is None else bounds.dynamics
                time = np.zeros(ndim) if bounds.time is None else bounds.time
                change = (high - low) / 2 @ matrix.T + time * ((t1 - t0) / 2)
                if self.signs is not None:
                    drift = drift + gain @ (most * self.signs)
                    return _about((drift, drift), change, ALLOWANCE)
                return _about((drift, drift), np.abs(gain) @ most + change, ALLOWANCE)

            if not dynamics.timed or bounds.time is not None:
                ways.append(stated)
        return self._first(f"the dynamics of {self.problem.name!r}", ways, "LipschitzBounds(dynamics=..., time=...)")

    def _first(self, what: str, ways: Sequence[Callable[[], Ends]], told: str) -> Ends:
        """The answer of the first way that goes through; which one is kept."""
        failed = []
        for place in range(self._chosen.get((what, len(ways)), 0), len(ways)):
            try:
                answer = ways[place]()
            except UNFOLLOWED as error:
                failed.append(error)
                continue
            self._chosen[what, len(ways)] = place
            return answer
        raise ValueError(
            f"{what} cannot be bounded over boxes of states: {failed[0]}. Write it in NumPy functions that intervals "
            f"go through, say how fast it can change, bounds={told}, or give the function an attribute `enclosure` "
            "(sdhj.certified.bounds)"
        ) from failed[0]

    def _compare(
        self, what: str, axes: Sequence[int], count: int, true: Callable[..., Ends], enclosed: Callable[..., Ends]
    ) -> None:
        """Once for each function: at some states, each asked alone, it is between the bounds that are found there.

        So a value depends on its own state and not on others, and intervals do what NumPy does.
        """
        if what in self._agree:
            return
        grid, rng = self.problem.grid.subgrid(tuple(axes)), np.random.default_rng(0)
        points = rng.uniform(grid.lower, grid.upper, (count, grid.ndim))
        points[: count // 5] = np.stack([rng.choice(grid.nodes(axis), count // 5) for axis in range(grid.ndim)], axis=1)
        for t, some in zip((0.0, 0.7 * self.problem.delta), (points[::2], points[1::2]), strict=True):
            least, most = enclosed(some, t)
            for at, q in enumerate(some):
                for value in true(q[None], t):
                    value = np.asarray(value, dtype=np.float64)[0]
                    slack = 1e-14 * (1.0 + np.abs(value))  # of the function's own rounding
                    if not np.isfinite(value).all():
                        raise ValueError(f"it is not a finite number at {q.tolist()}")
                    if not ((least[at] - slack <= value) & (value <= most[at] + slack)).all():
                        raise TypeError(
                            f"at {q.tolist()} it is {value.tolist()} of that state alone, and intervals say "
                            f"{least[at].tolist()} to {most[at].tolist()}: it depends on other states, on the type of "
                            "its argument, or on what intervals cannot see"
                        )
        self._agree.add(what)

    @cached_property
    def _agree(self) -> set[str]:
        return set()

    @cached_property
    def _chosen(self) -> dict[tuple[str, int], int]:
        return {}


def _followed(function: Callable[..., Any], low: FloatArray, high: FloatArray, times: tuple[float, float]) -> Ends:
    """A level-set function called with intervals."""
    from sdhj.certified.enclosures import Enclosure, followed

    t: Any = times[0] if times[0] == times[1] else Enclosure(*times)
    return _answered(followed(function, Enclosure(low.copy(), high.copy()), t), low[:, 0].shape)


def _answered(answer: Any, shape: tuple[int, ...]) -> Ends:
    from sdhj.certified.enclosures import Enclosure, enclosure_of

    told = enclosure_of(Enclosure(*answer) if isinstance(answer, tuple) else answer, shape)
    return told.low, told.high


def _followed_velocity(
    dynamics: Dynamics, j: int, low: FloatArray, high: FloatArray, times: tuple[float, float], signs: FloatArray | None
) -> Ends:
    """Drift and the adversary's push, that of one vertex or any, called with intervals."""
    from sdhj.certified.enclosures import Enclosure, enclosure_of, followed

    t: Any = times[0] if times[0] == times[1] else Enclosure(*times)

    def term(name: str, shape: tuple[int, ...]) -> Any:
        function = getattr(dynamics, name)
        if not callable(function):
            return enclosure_of(function[j] if name == "drift" else function, shape[1:])
        takes = dynamics.takes[name]
        if (own := getattr(function, "enclosure", None)) is not None:
            return enclosure_of(Enclosure(*own(low, high, dynamics.inputs[j], *times)), shape)
        values = {"points": Enclosure(low.copy(), high.copy()), "u": dynamics.inputs[j], "t": t}
        return enclosure_of(
            followed(function, *(values[one] for one in takes)), shape if "points" in takes else shape[1:]
        )

    parts = dynamics.adversaries
    gain, most = term("gain", (*low.shape, parts)), term("bounds", (0, parts))
    if signs is not None:
        return _answered(term("drift", low.shape) + (gain * (most * signs)).sum(axis=-1), low.shape)
    push = (np.abs(gain) * np.abs(most)).sum(axis=-1).high
    return _answered(term("drift", low.shape) + Enclosure(-push, push), low.shape)


def _about(ends: Any, change: Any, rounding: float = 0.0) -> Ends:
    low, high = (np.asarray(end, dtype=np.float64) for end in ends)
    change = np.asarray(change) * (1 + ALLOWANCE) + rounding * (1.0 + np.abs(low) + change)
    return low - change, high + change


def _within(
    grid: Grid,
    axes: Sequence[int],
    low: FloatArray,
    high: FloatArray,
    bounded: Callable[[FloatArray, FloatArray], Ends],
) -> Ends:
    """Bounds over boxes (M, axes), which are cut at the ends of their axes and where a periodic one closes."""
    rows, low, high = np.arange(len(low)), low.copy(), high.copy()
    for column, axis in enumerate(axes):
        lower, upper = grid.lower[axis], grid.upper[axis]
        if not grid.periodic[axis]:
            low[:, column], high[:, column] = (np.clip(end[:, column], lower, upper) for end in (low, high))
            continue
        period = upper - lower
        laps, whole = np.floor((low[:, column] - lower) / period), high[:, column] - low[:, column] >= period
        low[:, column] = np.where(whole, lower, np.maximum(low[:, column] - laps * period, lower))
        high[:, column] = np.where(whole, upper, high[:, column] - laps * period)
        over = np.flatnonzero(high[:, column] > upper)
        rows, beyond = np.concatenate([rows, rows[over]]), high[over]
        low, high = (
            np.concatenate([low, low[over]]),
            np.concatenate([np.minimum(high, _room(high, column, upper)), beyond]),
        )
        low[len(low) - over.size :, column] = lower
        high[len(high) - over.size :, column] -= period
    slabs = (slice(begin, begin + BOXES) for begin in range(0, len(rows), BOXES))
    answers = [bounded(low[at], high[at]) for at in slabs]
    least, most = (np.concatenate([np.array(answer[side]) for answer in answers]) for side in (0, 1))
    count = int(rows.max(initial=-1)) + 1
    np.minimum.at(least, rows[count:], least[count:].copy())
    np.maximum.at(most, rows[count:], most[count:].copy())
    return least[:count], most[:count]


def _room(high: FloatArray, column: int, upper: float) -> FloatArray:
    """No bound but on one column."""
    out = np.full(high.shape[1], np.inf)
    out[column] = upper
    return out


# ---- what of stated bounds can be refuted by looking at the functions


def check_stated(problem: ReachAvoidProblem, stated: LipschitzBounds) -> None:
    """Refuse bounds that differences between a few thousand pairs of states refute; it proves nothing of the others."""
    ndim, timed, rng = problem.grid.ndim, problem.dynamics.timed, np.random.default_rng(0)

    def level(part: Any, points: FloatArray, t: float) -> FloatArray:
        return problem.value_of(part, points, t)[:, None, None]

    def velocity(j: int, points: FloatArray, t: float) -> FloatArray:
        drift, gain, bounds = velocity_terms(problem, points, j, t)
        return np.concatenate([drift[..., None], gain * bounds], axis=2)

    for part in known_sets(problem):
        if part.name in stated.sets:
            bounds = np.zeros((1, ndim))
            bounds[0, list(part.axes)] = stated.sets[part.name]
            names, moving = [f"the level set of {part.name!r}"], getattr(part, "moving", True)
            _try((problem, rng), names, partial(level, part), bounds, None, moving)
    if stated.dynamics is not None or stated.time is not None:
        matrix = np.full((ndim, ndim), np.inf) if stated.dynamics is None else stated.dynamics
        for j in range(len(problem.inputs)):
            names = [f"the velocity along {name!r} under input {j}" for name in problem.grid.names]
            _try((problem, rng), names, partial(velocity, j), matrix, stated.time if timed else None, timed)


def _try(
    given: tuple[ReachAvoidProblem, Any], names: list[str], function: Any, bounds: Any, drifting: Any, moving: bool
) -> None:
    """Try a function of states and a time, (M, rows, terms) whose changes add up: along each axis, and in time."""
    (problem, rng), grid = given, given[0].grid
    span = (problem.steps or 1) * problem.delta
    for axis, share in itertools.product(range(grid.ndim), (0.5, 0.02)):
        step, room = share * grid.spacing[axis], np.array(grid.upper) - grid.lower
        room[axis] -= step  # functions may jump where a periodic axis closes
        points = grid.lower + rng.random((PAIRS, grid.ndim)) * room
        told, later = f"over {step:.3g} along the axis {grid.names[axis]!r}", share * problem.delta
        for t in (0.0, 0.37 * span, span - later) if moving else (0.0,):
            here = function(points, t)
            _refute(names, here, function(points + step * np.eye(grid.ndim)[axis], t), bounds[:, axis], step, told)
            if drifting is not None:
                _refute(names, here, function(points, t + later), drifting, later, f"over {later:.3g} s")


def _refute(names: list[str], here: FloatArray, there: FloatArray, bounds: FloatArray, step: float, told: str) -> None:
    change = np.abs(there - here).sum(axis=2)
    over = change - bounds * step * (1 + ALLOWANCE) - ALLOWANCE * (1.0 + np.abs(here[:, :, 0]))
    worst, row = np.unravel_index(np.argmax(over), over.shape)
    if over[worst, row] > 0.0:
        raise ValueError(
            f"{names[row]} changes by {change[worst, row]:.3g} {told}, and its Lipschitz bound {bounds[row]:g} "
            f"allows {bounds[row] * step:.3g}; give a bound of at least {change[worst, row] / step:.3g}"
        )
