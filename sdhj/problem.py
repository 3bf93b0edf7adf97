"""The robust motion planning problem of Sec. 2 and 3, as data.

Everything behind this file (kernels, games, recursion, table, controller) knows a robot only through the arrays
that a `ReachAvoidProblem` samples on its grid.
"""

import importlib
import json
import reprlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property, reduce
from typing import Any

import numpy as np

from sdhj.checks import Asked, ascending, finite_array, number, option, points_array, whole
from sdhj.dynamics import Dynamics, Interval
from sdhj.grid import FloatArray, Grid, Window
from sdhj.resolution import least_in_cells
from sdhj.rim import with_rim
from sdhj.sensing import Sensing, half_widths

VIEW_TIMES = ("swept", "sampled", "instantaneous")
STEEP = 10.0  # times as deep inside, by sampling="steep": in figures/maze.py 3 loses 2 % of the starts, 5 1 %, 10 none
SUBSAMPLES = 20  # of one sampling interval, for view_time="sampled" (Sec. 6.2.1)

LARGEST = 1e9  # of a level-set function: beyond it, differences in single precision are rounding, and overflow is near
SMALLEST = float(np.finfo(np.float32).tiny)  # below it they are taken for 0, and what is outside for inside
FOREVER = 1000  # steps that are tried where a problem gives no number of them
MOST_SAMPLED = 1_000_000  # steps of a problem

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
        object.__setattr__(self, "level_set", Asked.of(f"level_set of {self.name!r}", self.level_set, "points", "t"))
        if self.swept is not None:
            swept = Asked.of(f"swept of {self.name!r}", self.swept, "points", "t0", "t1")
            object.__setattr__(self, "swept", swept)
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
        object.__setattr__(self, "level_set", Asked.of(f"level_set of {self.name!r}", self.level_set, "points", "t"))

    @classmethod
    def from_table(cls, table: Any, within: int | None = None) -> "TargetSet":
        """The states from which a solved table reaches its own target in time: see `sdhj.chaining.from_table`."""
        return importlib.import_module("sdhj.chaining").from_table(table, within)


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
        self.grid.require_room(each=8)
        option("view_time", self.view_time, VIEW_TIMES)
        object.__setattr__(self, "delta", number("delta", self.delta, above=0.0, most=LARGEST))
        if self.steps is not None:
            object.__setattr__(self, "steps", whole("steps", self.steps, least=1, most=MOST_SAMPLED))
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
        importlib.import_module("sdhj.trials").tried(self)
        self.sensing.check(self)

    def _check_parts(self) -> None:
        if not (isinstance(self.name, str) and self.name.isprintable()):
            raise ValueError(f"name must be text in one line, without control characters, got {self.name!r}")
        try:
            json.dumps(dict(self.recipe), allow_nan=False)
        except (TypeError, ValueError) as error:
            raise ValueError(f"recipe must be a mapping that JSON can tell, or left out: {error}") from None
        if self.target is None:
            object.__setattr__(self, "target", ANYWHERE)
        for name, kind in (("grid", Grid), ("dynamics", Dynamics)):
            if not isinstance(given := getattr(self, name), kind):
                raise ValueError(f"{name} must be a sdhj.{kind.__name__}, got {reprlib.repr(given)}")
        if not isinstance(self.target, TargetSet):
            raise ValueError(f"target must be a TargetSet, or None to stay safe, got {reprlib.repr(self.target)}")
        if not isinstance(self.sensing, Sensing):
            raise ValueError(
                f"sensing must be a sdhj.Sensing, as Sensing(error=0.01), got {reprlib.repr(self.sensing)}"
            )
        unsafe = tuple(self.unsafe) if isinstance(self.unsafe, Sequence) else (self.unsafe,)
        if not isinstance(self.unsafe, Sequence) or not all(isinstance(part, UnsafeSet) for part in unsafe):
            told = reprlib.repr(self.unsafe)
            raise ValueError(f"unsafe must be a sequence of UnsafeSet, empty where nothing is, got {told}")
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

    @cached_property
    def rimmed(self) -> "ReachAvoidProblem":
        """This problem as the games are played: on a grid that goes on past its safe ends (`sdhj.rim`)."""
        return with_rim(self)

    def moves(self, part: UnsafeSet) -> bool:
        """Whether the avoid tubes of an unsafe set differ from step to step."""
        return part.moving or self.dynamics.timed

    def avoid_axes(self, part: UnsafeSet) -> tuple[int, ...]:
        """The axes on which the avoid game of an unsafe set is solved: its own and those that their velocities need.

        And those with safe ends: who has left over one is met by nothing.
        """
        safe = np.isfinite(self.grid.faces("safe")).any(axis=0)
        axes: tuple[int, ...] = tuple(sorted({*part.axes, *np.flatnonzero(safe).tolist()}))
        intervals = [self.interval(step) for step in range(self.steps if self.dynamics.timed else 1)]
        while (grown := reduce(lambda known, interval: interval.closed(known), intervals, axes)) != axes:
            axes = grown
        return axes

    @cached_property
    def timeless(self) -> bool:
        """Whether nothing depends on time: dynamics, unsafe sets and, at the nodes, the target."""
        if self.dynamics.timed or any(part.moving for part in self.unsafe):
            return False
        first, steps = self.target_at(self.time(0)), range(1, (self.steps or SUBSAMPLES) + 1)
        return all(np.array_equal(self.target_at(self.time(k)), first) for k in steps)

    def on(self, grid: Grid) -> "ReachAvoidProblem":
        """The problem on a window of its grid; what depends on the whole grid is as there."""
        if grid is self.grid:
            return self
        part = object.__new__(ReachAvoidProblem)  # its functions have been tried
        part.__dict__.update({one.name: getattr(self, one.name) for one in fields(self)}, grid=grid)
        if not (self.dynamics.timed or self.dynamics.stateless):
            part._intervals[0] = self.interval(0).on(grid)
        if "timeless" in self.__dict__:
            part.__dict__["timeless"] = self.timeless
        return part

    def pieces(self) -> "Iterator[ReachAvoidProblem]":
        """The problem on windows that are small enough to sample functions on: see `Grid.pieces`."""
        return map(self.on, self.grid.pieces())

    def sample(self, axes: Sequence[int], function: Callable[[FloatArray], FloatArray], name: str) -> FloatArray:
        """A function of some axes at the nodes of their subgrid, shape of the subgrid, float64, checked finite."""
        subgrid = self.grid.subgrid(axes)
        values = [self._checked(function(piece.points()), name, piece.size) for piece in subgrid.pieces()]
        return np.concatenate(values).reshape(subgrid.shape)

    def _checked(self, values: FloatArray, name: str, size: int | None = None) -> FloatArray:
        values = finite_array(f"level set of {name!r}", values, None if size is None else (size,))
        if (largest := float(np.abs(values).max())) > LARGEST:
            raise ValueError(
                f"level set of {name!r} reaches {largest:.3g}, and single precision needs at most {LARGEST:g}; far "
                "from the boundary only the sign counts, so clip it"
            )
        if (lost := values[(values != 0) & (np.abs(values) < SMALLEST)]).size:
            raise ValueError(
                f"level set of {name!r} is {lost[0]:.3g} at a node, and single precision takes what is nearer to 0 "
                f"than {SMALLEST:.2g} for 0, which would be another set; scale the function, or let it be 0 there"
            )
        return values

    def target_at(self, t: float) -> FloatArray:
        """Level-set function of the target at time t, on the subgrid of its axes."""
        return self.sample(self.target.axes, lambda points: self.target.level_set(points, t), self.target.name)

    def unsafe_at(self, part: UnsafeSet, t: float) -> FloatArray:
        """g of one unsafe set at time t, on the subgrid of its axes; a static set is sampled once."""
        known = [values for one, values in self._static if one is part]
        if not known:
            known = [self._sampled(part, lambda points: part.level_set(points, t))]
            self._static.extend((part, values) for values in known if not part.moving)
        return known[0]

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
            grid = self.grid.subgrid(part.axes)
            whole = grid.whole if isinstance(grid, Window) else grid
            least = least_in_cells(whole, lambda points: self._checked(function(points), part.name))
            return least[np.ix_(*map(grid.places, range(grid.ndim)))] if isinstance(grid, Window) else least
        values = self.sample(part.axes, function, part.name)
        return np.where(values < 0, STEEP * values, values) if part.sampling == "steep" else values

    @cached_property
    def _static(self) -> list[tuple[UnsafeSet, FloatArray]]:
        return []

    def unsafe_when(self, part: UnsafeSet, step: int) -> FloatArray:
        """As `unsafe_at` at t_k; with jitter at every time that t_k may be."""
        t, j = self.time(step), self.sensing.jitter
        return self.unsafe_over(part, t - j, t + j) if j and part.moving else self.unsafe_at(part, t)

    def goal(self, step: int) -> FloatArray:
        """Level-set function of S_k^N = L(t_k) minus G(t_k) on the grid (first row of Algorithm 1).

        Without a target that of the complement of G(t_k) and of what lies beyond unsafe ends.
        """
        t, grid = self.time(step), self.grid
        values = np.full((1,) * grid.ndim, -np.inf) if self.stays else grid.lift(self.target_at(t), self.target.axes)
        for part in self.unsafe:
            values = np.maximum(values, -grid.lift(self.unsafe_when(part, step), part.axes))
        if self.stays:
            values = np.maximum(values, -grid.to_ends("unsafe"))
        return np.ascontiguousarray(np.broadcast_to(values, self.grid.shape))

    def value_of(self, part: TargetSet | UnsafeSet, points: FloatArray, t: float) -> FloatArray:
        """True level-set function of one set at states (M, ndim), periodic axes wrapped: (M,)."""
        return part.level_set(self.grid.wrapped(points).take(part.axes, axis=1), t)

    def target_value(self, points: FloatArray, t: float) -> FloatArray:
        """True level-set function of the target at states (M, ndim), no grid involved."""
        return self.value_of(self.target, points_array("points", points, self.grid.ndim), number("t", t))

    def unsafe_value(self, points: FloatArray, t: float) -> FloatArray:
        """True level-set function of G(t) at states (M, ndim), no grid involved; <= 0 is a collision."""
        points, t = self.grid.wrapped(points_array("points", points, self.grid.ndim)), number("t", t)
        values = [part.level_set(points.take(part.axes, axis=1), t) for part in self.unsafe]
        return reduce(np.minimum, values) if values else np.full(len(points), np.inf)

    @property
    def digest(self) -> str:
        """SHA-256 of everything the solver reads, hexadecimal: two problems with one digest have one table."""
        return self.identity[0]

    @cached_property
    def identity(self) -> tuple[str, FloatArray]:
        """The digest, and sums that tell another problem from another machine's rounding: see `sdhj.identity`."""
        from sdhj.identity import identity  # which files alone ask for

        return identity(self)
