"""The robust motion planning problem of Sec. 2 and 3, as data.

Everything behind this file (kernels, games, recursion, table, controller) knows a robot only through the arrays
that a `ReachAvoidProblem` samples on its grid.
"""

import hashlib
import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, reduce
from typing import Any

import numpy as np

from sdhj.checks import number, whole
from sdhj.grid import FloatArray, Grid

VIEW_TIMES = ("swept", "sampled", "instantaneous")
SUBSAMPLES = 20  # of one sampling interval, for view_time="sampled" (Sec. 6.2.1)

LARGEST = 1e9  # of a level-set function: beyond it, differences in single precision are rounding, and overflow is near
INTERVALS = 8  # in which a swept set is checked
CHECKED = 5000  # nodes at which the rate of a moving set is checked

StaticLevelSet = Callable[[FloatArray, float], FloatArray]
SweptLevelSet = Callable[[FloatArray, float, float], FloatArray]


def _finite(name: str, values: FloatArray, shape: tuple[int, ...] | None = None) -> FloatArray:
    """A copy of `values` as float64, of that shape if one is given, every value finite."""
    given = np.asarray(values)
    if given.dtype.kind not in "fiu":
        raise ValueError(f"{name} must be real numbers, got an array of {given.dtype}")
    values = np.array(given, dtype=np.float64)
    if shape is not None and values.shape != shape:
        raise ValueError(f"{name} must have shape {shape}, got {values.shape}")
    if not np.isfinite(values).all():
        raise ValueError(f"{name} has a NaN or an infinity; every value must be finite")
    return values


def _axes(axes: Any, name: str) -> tuple[int, ...]:
    try:
        given = tuple(axes)
    except TypeError:
        given = (axes,) if isinstance(axes, float) else axes
    if not isinstance(given, tuple) or not all(isinstance(axis, int | np.integer) for axis in given):
        raise ValueError(f"axes of {name!r} must be a sequence of whole numbers, for example (0, 1), got {axes!r}")
    return tuple(int(axis) for axis in given)


def _check_function(name: str, function: Any, *takes: str) -> None:
    """Raise ValueError for what is not a function of those arguments, as far as it tells."""
    expected = f"{name} must be a function of ({', '.join(takes)})"
    if not callable(function):
        raise ValueError(f"{expected}, got {function!r}")
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):  # some compiled functions do not tell
        return
    try:
        signature.bind(*takes)
    except TypeError:
        raise ValueError(f"{expected}, got one of {signature}") from None


@dataclass(frozen=True)
class Dynamics:
    """dq/dt = drift(q, u_j) + gain(q) v with |v_d| <= bounds_d (Eq. 1, input-affine in the adversary).

    Parameters
    ----------
    inputs : (L, m) array
        The quantised inputs u_j.
    drift : (L, ndim) array, or callable (points (M, ndim), u (m,)) -> (M, ndim)
        Velocity of the state under each input; an array where it does not depend on the state.
    gain : (ndim, D) array, or callable (points (M, ndim)) -> (M, ndim, D)
        What the adversary's D components do to the state.
    bounds : (D,) array
        Half-widths of the adversary's box. Where there is no adversary: bounds [0.0] and a gain of zeros (ndim, 1).

    Functions of the state are called with the coordinates of periodic axes between the ends of the grid.
    """

    inputs: FloatArray
    drift: FloatArray | Callable[[FloatArray, FloatArray], FloatArray]
    gain: FloatArray | Callable[[FloatArray], FloatArray]
    bounds: FloatArray

    def __post_init__(self) -> None:
        inputs = _finite("inputs", self.inputs)
        if inputs.ndim != 2 or inputs.shape[0] < 1:
            raise ValueError(f"inputs must have shape (L, m) with at least one row, got {inputs.shape}")
        if inputs.shape[0] > 256:
            raise ValueError(f"{inputs.shape[0]} inputs; at most 256 are supported, so quantise more coarsely")
        object.__setattr__(self, "inputs", inputs)
        bounds = np.atleast_1d(_finite("bounds", np.asarray(self.bounds)))
        if bounds.ndim != 1 or (bounds < 0).any():
            raise ValueError(f"bounds must be a row of half-widths >= 0, got {self.bounds}")
        object.__setattr__(self, "bounds", bounds)
        for name in ("drift", "gain"):
            given = getattr(self, name)
            if callable(given):
                _check_function(name, given, *(("points", "u") if name == "drift" else ("points",)))
            else:
                object.__setattr__(self, name, _finite(name, given))

    @property
    def constant(self) -> bool:
        """Whether neither the drift nor the gain depends on the state."""
        return not callable(self.drift) and not callable(self.gain)

    def drift_at(self, points: FloatArray, j: int) -> FloatArray:
        """Velocity under input j at points (M, ndim), without the adversary; shape (M, ndim)."""
        if callable(self.drift):
            return _finite("drift", self.drift(points, self.inputs[j]), points.shape)
        return np.broadcast_to(self.drift[j], points.shape)

    def gain_at(self, points: FloatArray) -> FloatArray:
        """The adversary's gain matrix at points (M, ndim); shape (M, ndim, D)."""
        shape = (*points.shape, self.bounds.size)
        if callable(self.gain):
            return _finite("gain", self.gain(points), shape)
        return np.broadcast_to(self.gain, shape)


@dataclass(frozen=True)
class UnsafeSet:
    """A part of the unsafe set G (Eq. 3), as a level-set function of some of the axes (App. A.3).

    Parameters
    ----------
    axes : sequence of int
        The axes it depends on, ascending. Fewer axes make the avoid game cheaper.
    level_set : callable (points (M, len(axes)), t) -> (M,)
        Negative inside the set at time t, zero on its boundary.
    swept : callable (points, t0, t1) -> (M,), optional
        Negative wherever the set is at any time of [t0, t1] (it may be larger, never smaller).
    rate : float, optional
        A bound on how fast the level-set function changes in time; a moving set needs one. Zero (default): the set
        is static. For a moving set without `swept`, samples lowered by rate * gap / 2 take its place.
    name : str

    The functions are called with the coordinates of periodic axes between the ends of the grid.
    """

    axes: tuple[int, ...]
    level_set: StaticLevelSet
    swept: SweptLevelSet | None = None
    rate: float = 0.0
    name: str = "unsafe"

    def __post_init__(self) -> None:
        object.__setattr__(self, "axes", _axes(self.axes, self.name))
        _check_function(f"level_set of {self.name!r}", self.level_set, "points", "t")
        if self.swept is not None:
            _check_function(f"swept of {self.name!r}", self.swept, "points", "t0", "t1")
        rate = number(f"rate of the unsafe set {self.name!r}", self.rate, least=0.0, most=LARGEST)
        object.__setattr__(self, "rate", rate)

    @property
    def moving(self) -> bool:
        return self.rate > 0.0

    def over(self, points: FloatArray, t0: float, t1: float, view_time: str) -> FloatArray:
        """One static level-set function for the whole interval [t0, t1] (Sec. 5.4 and 6.2.1).

        "swept" contains the set at every time of the interval; "sampled" is the union of 20 samples and does not.
        """
        if not self.moving:
            return self.level_set(points, t0)
        if view_time == "swept" and self.swept is not None:
            return self.swept(points, t0, t1)
        times = np.linspace(t0, t1, SUBSAMPLES)
        union = self.level_set(points, t0)
        for t in times[1:]:
            union = np.minimum(union, self.level_set(points, float(t)))
        # a time between two samples is at most half a gap from one of them
        return union - (self.rate * (times[1] - times[0]) / 2 if view_time == "swept" else 0.0)


@dataclass(frozen=True)
class TargetSet:
    """The target L (Eq. 3): `level_set(points (M, len(axes)), t)` is negative inside at time t."""

    axes: tuple[int, ...]
    level_set: StaticLevelSet
    name: str = "target"

    def __post_init__(self) -> None:
        object.__setattr__(self, "axes", _axes(self.axes, self.name))
        _check_function(f"level_set of {self.name!r}", self.level_set, "points", "t")


@dataclass(frozen=True)
class ReachAvoidProblem:
    """Reach the target within N steps and never touch the unsafe sets, whatever the adversary does (Definition 1).

    Parameters
    ----------
    grid : Grid
    dynamics : Dynamics
    target : TargetSet
    unsafe : sequence of UnsafeSet
    delta : float
        Length of a sampling interval, s.
    steps : int
        N, how many of them.
    view_time : {"swept", "sampled", "instantaneous"}
        How a moving unsafe set enters the game of one interval: as a static set that contains it at all times
        (safe), as the union of 20 samples (the paper's, not safe), or as it is at each time.
    recipe : mapping, optional
        {"builder": name, "arguments": {...}} with which a saved table rebuilds its problem; set by the case studies.

    Raises
    ------
    ValueError
        Where shapes, options or numbers do not fit, or the target is unreachable because the unsafe sets hold it.
    """

    grid: Grid
    dynamics: Dynamics
    target: TargetSet
    unsafe: tuple[UnsafeSet, ...]
    delta: float
    steps: int
    view_time: str = "swept"
    name: str = "problem"
    recipe: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._check_parts()
        self.grid.require_room()
        if self.view_time not in VIEW_TIMES:
            raise ValueError(f"view_time must be one of {', '.join(VIEW_TIMES)}, got {self.view_time!r}")
        object.__setattr__(self, "delta", number("delta", self.delta, above=0.0, most=LARGEST))
        object.__setattr__(self, "steps", whole("steps", self.steps, least=1))
        ndim, dynamics = self.grid.ndim, self.dynamics
        if not callable(dynamics.drift):
            _finite("drift", dynamics.drift, (dynamics.inputs.shape[0], ndim))
        if not callable(dynamics.gain):
            if dynamics.gain.shape[:1] == (ndim,) and dynamics.gain.shape != (ndim, dynamics.bounds.size):
                raise ValueError(
                    f"bounds must have one half-width for each column of the gain, which has shape "
                    f"{dynamics.gain.shape}; got {dynamics.bounds.tolist()}"
                )
            _finite("gain", dynamics.gain, (ndim, dynamics.bounds.size))
        parts: list[TargetSet | UnsafeSet] = [self.target, *self.unsafe]
        for part in parts:
            if not part.axes or list(part.axes) != sorted(set(part.axes)) or not set(part.axes) <= set(range(ndim)):
                raise ValueError(
                    f"axes of {part.name!r} must be ascending axes of the grid (0 to {ndim - 1}), got {part.axes}"
                )
        for part in self.unsafe:
            points = self._some_points(part)
            self._check_rate(part, points)
            if part.moving and part.swept is not None and self.view_time == "swept":
                self._check_swept(part, points)
        steps = range(self.steps + 1)
        if not any((self.goal(step) <= 0).any() for step in steps):
            if not any((self._target_at(self.time(step)) <= 0).any() for step in steps):
                raise ValueError(
                    "no grid node is in the target at any step: it lies off the grid or falls between nodes, or its "
                    "level-set function has the wrong sign (negative is inside); move or enlarge it, or use more nodes"
                )
            raise ValueError(
                "no grid node is in the target and safe at any step: the unsafe sets swallow the target; move it, or "
                "check the sign of their level-set functions (negative is inside)"
            )

    def _check_parts(self) -> None:
        if not isinstance(self.target, TargetSet):
            raise ValueError(f"target must be a TargetSet, got {self.target!r}")
        unsafe = tuple(self.unsafe) if isinstance(self.unsafe, Sequence) else (self.unsafe,)
        if not isinstance(self.unsafe, Sequence) or not all(isinstance(part, UnsafeSet) for part in unsafe):
            raise ValueError(f"unsafe must be a sequence of UnsafeSet, empty where nothing is, got {self.unsafe!r}")
        object.__setattr__(self, "unsafe", unsafe)

    def _some_points(self, part: UnsafeSet) -> FloatArray:
        """Nodes, at most `CHECKED` of them, of the axes that a set depends on, (M, axes)."""
        subgrid = self.grid.subgrid(part.axes)
        nodes = np.unique(np.linspace(0, subgrid.size - 1, min(subgrid.size, CHECKED)).astype(np.int64))
        places = np.stack(np.unravel_index(nodes, subgrid.shape), axis=1)
        return np.array(subgrid.lower) + places * np.array(subgrid.spacing)

    def _check_rate(self, part: UnsafeSet, points: FloatArray) -> None:
        """At some nodes and times: a set that moves faster than it says would be met where nobody expects it."""
        times = [0.0, 0.37 * self.delta, 0.61 * self.delta * self.steps, self.delta * self.steps]
        values = [_finite(f"level set of {part.name!r}", part.level_set(points, t), (len(points),)) for t in times]
        for k in range(1, len(times)):
            changed, span = float(np.abs(values[k] - values[k - 1]).max()), times[k] - times[k - 1]
            if changed > part.rate * span + 1e-9 * (1.0 + float(np.abs(values[k]).max())):
                raise ValueError(
                    f"the level-set function of {part.name!r} changes by {changed:.3g} within {span:.3g} s, more than "
                    f"its rate {part.rate:g} allows; give a rate of at least {changed / span:.3g}"
                )

    def _check_swept(self, part: UnsafeSet, points: FloatArray) -> None:
        """At some nodes, in some intervals: a `swept` that leaves out a part of the set leads the robot into it."""
        assert part.swept is not None
        for step in np.unique(np.linspace(0, self.steps - 1, min(self.steps, INTERVALS)).astype(int)).tolist():
            t0, t1 = self.time(step), self.time(step + 1)
            swept = _finite(f"swept of {part.name!r}", part.swept(points, t0, t1), (len(points),))
            for t in np.linspace(t0, t1, 5).tolist():
                excess = swept - part.level_set(points, t)
                if excess.max() > 1e-9 * (1.0 + float(np.abs(swept).max())):
                    worst = points[int(excess.argmax())].tolist()
                    raise ValueError(
                        f"swept of {part.name!r} over [{t0:g}, {t1:g}] is {excess.max():.3g} above the level-set "
                        f"function at t = {t:g}, at the node {worst}; it must be at most that at every time of the "
                        "interval, or leave it out: the library then sweeps the set itself"
                    )

    @property
    def inputs(self) -> FloatArray:
        """The quantised inputs u_j, shape (L, m)."""
        return self.dynamics.inputs

    def time(self, step: int) -> float:
        """t_k of a step, s."""
        return step * self.delta

    def sample(self, axes: Sequence[int], function: Callable[[FloatArray], FloatArray], name: str) -> FloatArray:
        """A function of some axes at the nodes of their subgrid, shape of the subgrid, float64, checked finite."""
        subgrid = self.grid.subgrid(axes)
        values = _finite(f"level set of {name!r}", function(subgrid.points()), (subgrid.size,))
        if (largest := float(np.abs(values).max())) > LARGEST:
            raise ValueError(
                f"level set of {name!r} reaches {largest:.3g}, and single precision needs at most {LARGEST:g}; far "
                "from the boundary only the sign counts, so clip it"
            )
        return values.reshape(subgrid.shape)

    def _target_at(self, t: float) -> FloatArray:
        return self.sample(self.target.axes, lambda points: self.target.level_set(points, t), self.target.name)

    def _unsafe_at(self, part: UnsafeSet, t: float) -> FloatArray:
        """A static set is sampled once: on a fine grid of many axes that is the costly part."""
        if not part.moving:
            for known, values in self._static:
                if known is part:
                    return values
        values = self.sample(part.axes, lambda points: part.level_set(points, t), part.name)
        if not part.moving:
            self._static.append((part, values))
        return values

    def _unsafe_over(self, part: UnsafeSet, t0: float, t1: float) -> FloatArray:
        return self.sample(part.axes, lambda points: part.over(points, t0, t1, self.view_time), part.name)

    @cached_property
    def _static(self) -> list[tuple[UnsafeSet, FloatArray]]:
        return []

    def goal(self, step: int) -> FloatArray:
        """Level-set function of S_k^N = L(t_k) minus G(t_k) on the grid (first row of Algorithm 1)."""
        t = self.time(step)
        values = self.grid.lift(self._target_at(t), self.target.axes)
        for part in self.unsafe:
            values = np.maximum(values, -self.grid.lift(self._unsafe_at(part, t), part.axes))
        return np.ascontiguousarray(np.broadcast_to(values, self.grid.shape))

    def value_of(self, part: TargetSet | UnsafeSet, points: FloatArray, t: float) -> FloatArray:
        """True level-set function of one set at states (M, ndim), periodic axes wrapped: (M,)."""
        return part.level_set(self.grid.wrapped(points).take(part.axes, axis=1), t)

    def drift_at(self, points: FloatArray, j: int) -> FloatArray:
        """`Dynamics.drift_at`, periodic axes wrapped."""
        return self.dynamics.drift_at(self.grid.wrapped(points), j)

    def gain_at(self, points: FloatArray) -> FloatArray:
        """`Dynamics.gain_at`, periodic axes wrapped."""
        return self.dynamics.gain_at(self.grid.wrapped(points))

    def target_value(self, points: FloatArray, t: float) -> FloatArray:
        """True level-set function of the target at states (M, ndim), no grid involved."""
        self._check_states(points)
        return self.value_of(self.target, points, t)

    def unsafe_value(self, points: FloatArray, t: float) -> FloatArray:
        """True level-set function of G(t) at states (M, ndim), no grid involved; <= 0 is a collision."""
        self._check_states(points)
        points = self.grid.wrapped(points)
        values = [part.level_set(points.take(part.axes, axis=1), t) for part in self.unsafe]
        return reduce(np.minimum, values) if values else np.full(len(points), np.inf)

    def _check_states(self, points: FloatArray) -> None:
        if np.ndim(points) != 2:
            raise ValueError(
                f"points must have shape (M, {self.grid.ndim}), got {np.shape(points)}; q[None] is one state"
            )

    @cached_property
    def digest(self) -> str:
        """SHA-256 of everything the solver reads, hexadecimal: two problems with one digest have one table."""
        h = hashlib.sha256()

        def add(*parts: Any) -> None:
            for part in parts:
                data = np.ascontiguousarray(part)
                h.update(repr((data.dtype.str, data.shape)).encode())
                h.update(data.tobytes())

        grid, points = self.grid, self.grid.points()
        add(
            grid.lower, grid.upper, grid.shape, grid.periodic, self.inputs, self.dynamics.bounds, self.delta, self.steps
        )
        h.update(self.view_time.encode())
        if self.dynamics.constant:
            add(self.dynamics.drift, self.dynamics.gain)
        else:
            add(self.dynamics.gain_at(points), *(self.dynamics.drift_at(points, j) for j in range(len(self.inputs))))
        add(self.target.axes, *(self._target_at(self.time(step)) for step in range(self.steps + 1)))
        for part in self.unsafe:
            add(part.axes, part.rate, self._unsafe_at(part, 0.0))
            for step in range(self.steps) if part.moving else ():
                t0, t1 = self.time(step), self.time(step + 1)
                # what happens between the samples counts too
                add(self._unsafe_at(part, (t0 + t1) / 2), self._unsafe_at(part, t1), self._unsafe_over(part, t0, t1))
        return h.hexdigest()
