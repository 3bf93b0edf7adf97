"""The robust motion planning problem of Sec. 2 and 3, as data.

Everything behind this file (kernels, games, recursion, table, controller) knows a robot only through the arrays
that a `ReachAvoidProblem` samples on its grid.
"""

import hashlib
import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, reduce
from typing import Any

import numpy as np

from sdhj.checks import ascending, check_function, finite_array, number, option, whole
from sdhj.dynamics import Dynamics, Interval
from sdhj.grid import FloatArray, Grid
from sdhj.resolution import least_in_cells
from sdhj.sensing import Sensing, half_widths

VIEW_TIMES = ("swept", "sampled", "instantaneous")
STEEP = 10.0  # times as deep inside, by sampling="steep": in figures/maze.py 3 loses 2 % of the starts, 5 1 %, 10 none
SUBSAMPLES = 20  # of one sampling interval, for view_time="sampled" (Sec. 6.2.1)

LARGEST = 1e9  # of a level-set function: beyond it, differences in single precision are rounding, and overflow is near
INTERVALS = 8  # in which a swept set is checked
FOREVER = 1000  # steps that are tried where a problem gives no number of them
CHECKED = 5000  # nodes at which the rate of a moving set is checked

StaticLevelSet = Callable[[FloatArray, float], FloatArray]
SweptLevelSet = Callable[[FloatArray, float, float], FloatArray]


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
    slope : float, optional
        A bound on how fast the level-set function changes with the state, per unit of distance.
    sampling : {"nodes", "steep", "cell"}
        What a node of the grid knows of the set: the value there; the value, but inside the set times `STEEP`, so that
        errors of differences and of interpolation, which are worst where the set is a node or two thick, make it larger
        (by less than a cell) and never smaller; or a bound from below on the values in all cells that touch the node,
        with which nothing thin is lost and all is a cell larger (`sdhj.resolution`).

    The functions are called with the coordinates of periodic axes between the ends of the grid.
    """

    axes: tuple[int, ...]
    level_set: StaticLevelSet
    swept: SweptLevelSet | None = None
    rate: float = 0.0
    name: str = "unsafe"
    slope: float | None = None
    sampling: str = "nodes"

    def __post_init__(self) -> None:
        option(f"sampling of the unsafe set {self.name!r}", self.sampling, ("nodes", "steep", "cell"))
        object.__setattr__(self, "axes", ascending(self.axes, self.name))
        check_function(f"level_set of {self.name!r}", self.level_set, "points", "t")
        if self.swept is not None:
            check_function(f"swept of {self.name!r}", self.swept, "points", "t0", "t1")
        if self.slope is not None:
            object.__setattr__(self, "slope", number(f"slope of {self.name!r}", self.slope, least=0.0))
        rate = number(f"rate of the unsafe set {self.name!r}", self.rate, least=0.0, most=LARGEST)
        object.__setattr__(self, "rate", rate)

    @classmethod
    def from_map(cls, source: Any, axes: Sequence[int] = (0, 1), **options: Any) -> "UnsafeSet":
        """What a robot's map does not show as free, from a map server's file or an array: see `sdhj.maps.from_map`."""
        return importlib.import_module("sdhj.maps").from_map(source, axes, **options)

    @classmethod
    def polygon(cls, vertices: FloatArray, axes: Sequence[int] = (0, 1), **options: Any) -> "UnsafeSet":
        """A polygon with vertices (K, 2): see `sdhj.maps.polygon`."""
        return importlib.import_module("sdhj.maps").polygon(vertices, axes, **options)

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
        object.__setattr__(self, "axes", ascending(self.axes, self.name))
        check_function(f"level_set of {self.name!r}", self.level_set, "points", "t")


ANYWHERE = TargetSet((0,), lambda points, t: np.full(len(points), -1.0), "anywhere")


@dataclass(frozen=True)
class ReachAvoidProblem:
    """Reach the target within N steps and never touch the unsafe sets, whatever the adversary does (Definition 1).

    Parameters
    ----------
    grid : Grid
    dynamics : Dynamics
    target : TargetSet, or None
        None: stay clear of the unsafe sets, and of the unsafe ends of the grid, for all N steps (`ANYWHERE`).
    unsafe : sequence of UnsafeSet
    delta : float
        Length of a sampling interval, s.
    steps : int, or None
        N, how many of them. None: as many as it takes until no further one changes anything, to reach the target some
        time or to stay clear for ever; where nothing depends on time. The problem of the table has that number.
    view_time : {"swept", "sampled", "instantaneous"}
        How a moving unsafe set enters the game of one interval: as a static set that contains it at all times
        (safe), as the union of 20 samples (the paper's, not safe), or as it is at each time.
    recipe : mapping, optional
        {"builder": name, "arguments": {...}} with which a saved table rebuilds its problem; set by the case studies.
    sensing : Sensing
        Measurement error, delay and jitter, by default none; `sdhj.prediction` says what the sets then mean.

    Raises
    ------
    ValueError
        Where shapes, options or numbers do not fit, or the target is unreachable because the unsafe sets hold it.
    """

    grid: Grid
    dynamics: Dynamics
    target: TargetSet | Any
    unsafe: tuple[UnsafeSet, ...]
    delta: float
    steps: int | Any
    view_time: str = "swept"
    name: str = "problem"
    recipe: Mapping[str, Any] = field(default_factory=dict)
    sensing: Sensing = field(default_factory=Sensing)

    def __post_init__(self) -> None:
        self._check_parts()
        self.grid.require_room()
        if self.view_time not in VIEW_TIMES:
            raise ValueError(f"view_time must be one of {', '.join(VIEW_TIMES)}, got {self.view_time!r}")
        object.__setattr__(self, "delta", number("delta", self.delta, above=0.0, most=LARGEST))
        if self.steps is not None:
            object.__setattr__(self, "steps", whole("steps", self.steps, least=1))
        ndim = self.grid.ndim
        self.dynamics.check(ndim)
        parts: list[TargetSet | UnsafeSet] = [self.target, *self.unsafe]
        for part in parts:
            if not part.axes or list(part.axes) != sorted(set(part.axes)) or not set(part.axes) <= set(range(ndim)):
                raise ValueError(
                    f"axes of {part.name!r} must be ascending axes of the grid (0 to {ndim - 1}), got {part.axes}"
                )
        if self.steps is None and not self.timeless:
            raise ValueError(
                "steps=None asks for as many steps as it takes until nothing changes, but the dynamics, an unsafe set "
                "or the target depend on time; give a number of steps"
            )
        for part in self.unsafe:
            points = self._some_points(part)
            self._check_rate(part, points)
            if part.moving and part.swept is not None and self.view_time == "swept":
                self._check_swept(part, points)
        self._check_goals()
        self.sensing.check(self)

    def _check_goals(self) -> None:
        steps = range((self.steps or 0) + 1)
        if any((self.goal(step) <= 0).any() for step in steps):
            return
        if self.stays:
            raise ValueError("every grid node is in an unsafe set: check the signs (negative is inside)")
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
        if self.target is None:
            object.__setattr__(self, "target", ANYWHERE)
        if not isinstance(self.target, TargetSet):
            raise ValueError(f"target must be a TargetSet, or None to stay safe, got {self.target!r}")
        if not isinstance(self.sensing, Sensing):
            raise ValueError(f"sensing must be a sdhj.Sensing, for example Sensing(error=0.01), got {self.sensing!r}")
        unsafe = tuple(self.unsafe) if isinstance(self.unsafe, Sequence) else (self.unsafe,)
        if not isinstance(self.unsafe, Sequence) or not all(isinstance(part, UnsafeSet) for part in unsafe):
            raise ValueError(f"unsafe must be a sequence of UnsafeSet, empty where nothing is, got {self.unsafe!r}")
        object.__setattr__(self, "unsafe", unsafe)
        if not self.stays and any(np.isfinite(face).any() for face in self.grid.faces("safe")):
            raise ValueError('"safe" ends are for problems without a target: what leaves there never comes to one')
        if self.stays and not unsafe and not any(np.isfinite(face).any() for face in self.grid.faces("unsafe")):
            raise ValueError("there is no target, and nothing to stay clear of: no unsafe set and no unsafe end")

    @property
    def most_steps(self) -> int:
        """N, or how many steps are tried where none is given."""
        return self.steps or FOREVER

    @property
    def stays(self) -> bool:
        """Whether there is no target: what is asked for is to stay clear of the unsafe sets."""
        return self.target is ANYWHERE

    def _some_points(self, part: UnsafeSet) -> FloatArray:
        """Nodes, at most `CHECKED` of them, of the axes that a set depends on, (M, axes)."""
        subgrid = self.grid.subgrid(part.axes)
        nodes = np.unique(np.linspace(0, subgrid.size - 1, min(subgrid.size, CHECKED)).astype(np.int64))
        places = np.stack(np.unravel_index(nodes, subgrid.shape), axis=1)
        return np.array(subgrid.lower) + places * np.array(subgrid.spacing)

    def _check_rate(self, part: UnsafeSet, points: FloatArray) -> None:
        """At some nodes and times: a set that moves faster than it says would be met where nobody expects it."""
        span = self.delta * (self.steps or SUBSAMPLES)
        times = [0.0, 0.37 * self.delta, 0.61 * span, span]
        values = [finite_array(f"level set of {part.name!r}", part.level_set(points, t), (len(points),)) for t in times]
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
            t0, t1 = self.span(step)
            swept = finite_array(f"swept of {part.name!r}", part.swept(points, t0, t1), (len(points),))
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
        """t_k of a step, s; where there is a delay s_k, when its input starts."""
        return step * self.delta + self.sensing.delay

    def span(self, step: int) -> tuple[float, float]:
        """When the input of a step may start and end, s, with all jitter."""
        return self.time(step) - self.sensing.jitter, self.time(step + 1) + self.sensing.jitter

    half_widths = cached_property(half_widths)

    def interval(self, step: int) -> Interval:
        """What input and adversary can do from step k; one object for all steps where the dynamics ignore time."""
        step = step if self.dynamics.timed else 0
        if step not in self._intervals:
            held = self.sensing.held(self.delta)
            self._intervals[step] = Interval(self.grid, self.dynamics, self.span(step)[0], *held, self.half_widths[1])
        return self._intervals[step]

    @cached_property
    def _intervals(self) -> dict[int, Interval]:
        return {}

    def moves(self, part: UnsafeSet) -> bool:
        """Whether the avoid tubes of an unsafe set differ from step to step."""
        return part.moving or self.dynamics.timed

    def avoid_axes(self, part: UnsafeSet) -> tuple[int, ...]:
        """The axes on which the avoid game of an unsafe set is solved: its own and those that their velocities need."""
        axes: tuple[int, ...] = part.axes
        intervals = [self.interval(step) for step in range(self.steps if self.dynamics.timed else 1)]
        while (grown := reduce(lambda known, interval: interval.closed(known), intervals, axes)) != axes:
            axes = grown
        return axes

    @cached_property
    def timeless(self) -> bool:
        """Whether nothing depends on time: dynamics, unsafe sets and, at the nodes, the safe target."""
        if self.dynamics.timed or any(part.moving for part in self.unsafe):
            return False
        return all(np.array_equal(self.goal(k), self.goal(0)) for k in range(1, (self.steps or SUBSAMPLES) + 1))

    def sample(self, axes: Sequence[int], function: Callable[[FloatArray], FloatArray], name: str) -> FloatArray:
        """A function of some axes at the nodes of their subgrid, shape of the subgrid, float64, checked finite."""
        subgrid = self.grid.subgrid(axes)
        return self._checked(function(subgrid.points()), name, subgrid.size).reshape(subgrid.shape)

    def _checked(self, values: FloatArray, name: str, size: int | None = None) -> FloatArray:
        values = finite_array(f"level set of {name!r}", values, None if size is None else (size,))
        if (largest := float(np.abs(values).max())) > LARGEST:
            raise ValueError(
                f"level set of {name!r} reaches {largest:.3g}, and single precision needs at most {LARGEST:g}; far "
                "from the boundary only the sign counts, so clip it"
            )
        return values

    def _target_at(self, t: float) -> FloatArray:
        return self.sample(self.target.axes, lambda points: self.target.level_set(points, t), self.target.name)

    def unsafe_at(self, part: UnsafeSet, t: float) -> FloatArray:
        """g of one unsafe set at time t, on the subgrid of its axes; a static set is sampled once."""
        if not part.moving:
            for known, values in self._static:
                if known is part:
                    return values
        values = self._sampled(part, lambda points: part.level_set(points, t))
        if not part.moving:
            self._static.append((part, values))
        return values

    def unsafe_over(
        self, part: UnsafeSet, t0: float, t1: float, *, axes: Sequence[int] = (), view_time: str | None = None
    ) -> FloatArray:
        """g of one unsafe set over [t0, t1], on the subgrid of its axes or of `axes`, which hold them."""
        axes, view_time = tuple(axes) or part.axes, view_time or self.view_time
        values = self._sampled(part, lambda points: part.over(points, t0, t1, view_time))
        grid = self.grid.subgrid(axes)
        return np.broadcast_to(grid.lift(values, [axes.index(axis) for axis in part.axes]), grid.shape)

    def _sampled(self, part: UnsafeSet, function: Callable[[FloatArray], FloatArray]) -> FloatArray:
        if part.sampling == "cell":
            return least_in_cells(
                self.grid.subgrid(part.axes), lambda points: self._checked(function(points), part.name)
            )
        values = self.sample(part.axes, function, part.name)
        return np.where(values < 0, STEEP * values, values) if part.sampling == "steep" else values

    @cached_property
    def _static(self) -> list[tuple[UnsafeSet, FloatArray]]:
        return []

    def goal(self, step: int) -> FloatArray:
        """Level-set function of S_k^N = L(t_k) minus G(t_k) on the grid (first row of Algorithm 1).

        Without a target that of the complement of G(t_k) and of what lies beyond unsafe ends, with what lies beyond
        safe ones.
        """
        t, j, grid, values = self.time(step), self.sensing.jitter, self.grid, np.full((1,) * self.grid.ndim, -np.inf)
        for at in () if self.stays else (t - j, t, t + j) if j else (t,):
            values = np.maximum(values, grid.lift(self._target_at(at), self.target.axes))
        for part in self.unsafe:
            g = self.unsafe_over(part, t - j, t + j) if j and part.moving else self.unsafe_at(part, t)
            values = np.maximum(values, -grid.lift(g, part.axes))
        if self.stays:
            values = np.minimum(np.maximum(values, -self.to_ends("unsafe")), self.to_ends("safe"))
        return np.ascontiguousarray(np.broadcast_to(values, self.grid.shape))

    def to_ends(self, kind: str) -> FloatArray:
        """Distance to the nearest end of a kind, < 0 beyond, +inf where there is none; broadcasts to the grid."""
        grid, out = self.grid, np.full((1,) * self.grid.ndim, np.inf)
        for axis, (low, high) in enumerate(zip(*grid.faces(kind), strict=True)):
            nodes = grid.nodes(axis)
            out = np.minimum(out, grid.lift(np.minimum(nodes - low, high - nodes), (axis,)))
        return out

    def value_of(self, part: TargetSet | UnsafeSet, points: FloatArray, t: float) -> FloatArray:
        """True level-set function of one set at states (M, ndim), periodic axes wrapped: (M,)."""
        return part.level_set(self.grid.wrapped(points).take(part.axes, axis=1), t)

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

        grid, dynamics, inputs = self.grid, self.dynamics, range(len(self.inputs))
        add(grid.lower, grid.upper, grid.shape, grid.periodic, self.inputs, self.delta, self.steps)
        h.update(f"{self.view_time} {grid.ends}{self.sensing or ''}".encode())
        if dynamics.constant:
            add(dynamics.bounds, dynamics.drift, dynamics.gain)
        else:
            points, halves = grid.points(), range(2 * self.steps + 1) if dynamics.timed else range(1)
            for t in (half * self.delta / 2 + self.sensing.delay for half in halves):
                add(*(dynamics.drift_at(points, j, t) for j in inputs))
                for j in inputs[:1] if dynamics.alike else inputs:
                    add(dynamics.gain_at(points, j, t), dynamics.bounds_at(j, t))
        add(
            self.target.axes,
            *(self._target_at(self.time(step)) for step in range(1 if self.timeless else self.steps + 1)),
        )
        for part in self.unsafe:
            add(part.axes, part.rate, self.unsafe_at(part, 0.0))
            for step in range(self.steps) if part.moving else ():
                t0, t1 = self.time(step), self.time(step + 1)
                # what happens between the samples counts too
                add(self.unsafe_at(part, (t0 + t1) / 2), self.unsafe_at(part, t1), self.unsafe_over(part, t0, t1))
        return h.hexdigest()
