"""The robust motion planning problem of Sec. 2 and 3, as data.

All code that solves a problem or uses its table (kernels, games, recursion, controller) sees the robot only through the
arrays that a `ReachAvoidProblem` samples on its grid.
"""

import hashlib
import json
import reprlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from itertools import pairwise, product
from typing import Any
from weakref import WeakValueDictionary

import numpy as np

from sdhj.formulas.formula import BlackBox, Formula, compare
from sdhj.formulas.graph import MOST_TABLES, Lookup
from sdhj.formulas.text import FORMAT, written
from sdhj.kernels import FloatArray, kept, read_only
from sdhj.problem.boxes import maximum_over_boxes
from sdhj.problem.checks import number, option, points_array, whole
from sdhj.problem.dynamics import Dynamics, VectorField
from sdhj.problem.grid import Grid, Window
from sdhj.problem.interval import INSTANTS, Interval
from sdhj.problem.sensing import Sensing
from sdhj.problem.sets import ANYWHERE, LARGEST, STEEP, VIEW_TIMES, TargetSet, UnsafeSet
from sdhj.problem.steepness import rates

SMALLEST = float(np.finfo(np.float32).tiny)  # smaller level-set values become 0, so that nodes outside count as inside
RIM = 4  # nodes past a safe end on the grid of the games: the widest stencils use three
FOREVER = 1000  # steps at most for a problem without a number of steps
MOST_SAMPLED = 1_000_000  # steps of a problem
SAMPLED = WeakValueDictionary[Any, FloatArray]()  # of static sets, for as long as some problem has them
AROUND = 6  # nodes on each side that `closed` depends on
# Shares of the largest value at the corners of the grid (`_size`):
HAIR = 1e-9  # below 0: values so close to 0 count as 0 inside a set
ON_BOUNDARY = 2.0**-90  # below 0, at a node where a function is 0: negative in single precision, negligible
FINE = 4  # parts of a cell's edge, in the search for the least value in the cell
COMPARED_STATES = 200  # at which a formula is compared with the function that it was read from
SWEPT_STATES = 1000  # at which `swept` is compared with the level-set function, each at INSTANTS of every interval
EXCUSED = 1e-9  # of the values: that is no difference
VALUES_KEPT = 1000  # values of a black box that a file keeps
BOX_STEPS = 4  # times among them
TERMS = 60  # of an exponential series
TOLD = ("problem", "delta", "steps", "view_time", "grid", "inputs", "sensing", "sets", "formulas")  # in a file
LAYOUT = ("lower", "upper", "shape", "periodic", "names", "ends")  # of a grid, as it stands in a file


@dataclass(frozen=True)
class ReachAvoidProblem:
    """The task to reach a target within N steps and never touch an unsafe set, against any adversary (Definition 1).

    Parameters
    ----------
    grid : Grid
    dynamics : Dynamics
    target : TargetSet, or None
        None: only stay clear of the unsafe sets, and of the unsafe ends of the grid, for all N steps.
    unsafe : sequence of UnsafeSet
    delta : float
        Length of a sampling interval, s.
    steps : int, or None
        N, the number of sampling intervals. None: as many as it takes until one more changes nothing, to reach the
        target eventually or to stay safe for ever; nothing may then depend on time. The table's problem has the number.
        Where anything depends on time there are N (N + 1) / 2 tubes instead of N: `sdhj.estimate` says what that costs.
    view_time : {"swept", "sampled", "instantaneous"}
        How a moving unsafe set enters the game of one interval (Sec. 5.4): as a static set that contains it at all
        times (safe), as the union of 20 samples, as in the paper (not safe), or as it is at each time.
    recipe : mapping, optional
        {"builder": name, "arguments": {...}} from which a saved table rebuilds its problem; set by the case studies.
    sensing : Sensing
        Measurement error, delay and jitter, by default none; `sdhj.problem.sensing` says what the sets then mean.

    Raises
    ------
    ValueError
        If shapes, options or numbers do not fit, or if no grid node is both in the target and safe at any step.

    Examples
    --------
    A robot that is to stay between the two ends of its track for ever, so without a target:

    >>> import sdhj
    >>> speeds = [[-1.0], [1.0]]  # m/s
    >>> problem = sdhj.ReachAvoidProblem(
    ...     grid=sdhj.Grid([-1.0], [1.0], [41]),
    ...     dynamics=sdhj.Dynamics(inputs=speeds, drift=speeds, gain=[[1.0]], bounds=[0.2]),
    ...     target=None,
    ...     unsafe=[],
    ...     delta=0.1,
    ...     steps=None,
    ... )
    >>> sdhj.solve(problem).contains([[0.0], [0.99]], start=0)
    array([ True, False])
    """

    grid: Grid
    dynamics: Any
    target: TargetSet | Any
    unsafe: tuple[UnsafeSet, ...]
    delta: float
    steps: int | Any
    view_time: str = "swept"
    name: str = "problem"
    recipe: Mapping[str, Any] = field(default_factory=dict)
    sensing: Sensing = field(default_factory=Sensing)
    _intervals: dict[int, Interval] = field(default_factory=dict, init=False, repr=False, compare=False)
    _static: dict[Any, FloatArray] = field(default_factory=dict, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        self._check_parts()
        self.grid.require_room(each=8)
        option("view_time", self.view_time, VIEW_TIMES)
        object.__setattr__(self, "delta", number("delta", self.delta, above=0.0, most=LARGEST))
        if self.steps is not None:
            object.__setattr__(self, "steps", whole("steps", self.steps, least=1, most=MOST_SAMPLED))
        ndim = self.grid.ndim
        if isinstance(given := self.dynamics, Dynamics):
            object.__setattr__(self, "dynamics", given.read(ndim))
            given.compare(self.dynamics, _states(self.grid), _times(self))
        if self.dynamics.ndim != ndim:
            raise ValueError(f"the dynamics are of {self.dynamics.ndim} coordinates, and the grid has {ndim} axes")
        parts: list[TargetSet | UnsafeSet] = [self.target, *self.unsafe]
        if (size := sum(one.values.nbytes for one in self.texts[1])) > MOST_TABLES:
            raise ValueError(
                f"the tables that the problem looks up, of maps too, take {size:,} bytes together, and at most "
                f"{MOST_TABLES:,} can be kept in a file; use fewer nodes or pixels"
            )
        for part in parts:
            if not part.axes or list(part.axes) != sorted(set(part.axes)) or not set(part.axes) <= set(range(ndim)):
                where = f"axes of the grid, from 0 to {ndim - 1}, ascending"
                raise ValueError(f"axes of {part.name!r} must be {where}, got {part.axes}")
        if self.steps is None and not self.timeless:
            raise ValueError(
                "steps=None solves until nothing changes from step to step, but the dynamics, an unsafe set or the "
                "target depend on time; give a number of steps"
            )
        for part in parts:
            _compare_set(self, part)
        for j, step in product(range(len(self.inputs)), range((self.steps or 0) + 1) if self.dynamics.timed else [0]):
            self.dynamics.bounds_at(j, self.time(step))
        for part in self.unsafe:
            corner = np.array([[self.grid.lower[axis] for axis in part.axes]])
            between = "swept" if self.view_time == "instantaneous" else self.view_time  # as games sweep time steps
            part.over(corner, 0.0, self.delta, between)  # refuses a black box of which too little is known
            if part.moving and part.swept is not None and self.view_time == "swept":
                _check_swept(self, part)
        _try_goals(self)
        if self.sensing:
            check_sensing(self)

    def _check_parts(self) -> None:
        if not (isinstance(self.name, str) and self.name.isprintable()):
            raise ValueError(f"name must be text in one line, without control characters, got {self.name!r}")
        try:
            json.dumps(dict(self.recipe), allow_nan=False)
        except (TypeError, ValueError) as error:
            raise ValueError(f"recipe must be a mapping that can be written as JSON, or left out: {error}") from None
        if self.target is None:
            object.__setattr__(self, "target", ANYWHERE)
        if not isinstance(self.grid, Grid):
            raise ValueError(f"grid must be a sdhj.Grid, got {reprlib.repr(self.grid)}")
        if not isinstance(self.dynamics, Dynamics | VectorField):
            raise ValueError(f"dynamics must be a sdhj.Dynamics, got {reprlib.repr(self.dynamics)}")
        if not isinstance(self.target, TargetSet):
            raise ValueError(f"target must be a TargetSet, or None to stay safe, got {reprlib.repr(self.target)}")
        if not isinstance(self.sensing, Sensing):
            raise ValueError(f"sensing must be a sdhj.Sensing(error=..., ...), got {reprlib.repr(self.sensing)}")
        unsafe = tuple(self.unsafe) if isinstance(self.unsafe, Sequence) else (self.unsafe,)
        if not isinstance(self.unsafe, Sequence) or not all(isinstance(part, UnsafeSet) for part in unsafe):
            shown = reprlib.repr(self.unsafe)
            raise ValueError(f"unsafe must be a sequence of UnsafeSet, empty if nothing is unsafe, got {shown}")
        object.__setattr__(self, "unsafe", unsafe)
        if not self.stays and self.grid.has("safe"):
            raise ValueError('"safe" ends need a problem without a target: a state that leaves there cannot reach one')
        if self.stays and not unsafe and not self.grid.has("unsafe"):
            raise ValueError("there is no target and nothing to stay clear of; give an unsafe set or an unsafe end")

    @property
    def most_steps(self) -> int:
        """N, or the most steps that are solved for a problem without a number of steps."""
        return self.steps or FOREVER

    @property
    def stays(self) -> bool:
        """Whether there is no target, so that the task is only to stay clear of the unsafe sets."""
        return self.target is ANYWHERE

    @property
    def inputs(self) -> FloatArray:
        """The inputs u_j that the robot can choose from, (L, m): one in each row, as they were given to `Dynamics`."""
        return self.dynamics.inputs

    def time(self, step: int) -> float:
        """Time at which the input of step k takes effect, in s: k delta, plus the delay if there is a `Sensing`."""
        return step * self.delta + self.sensing.delay

    def span(self, step: int) -> tuple[float, float]:
        """Earliest start and latest end of the input of step k, s, including jitter."""
        return self.time(step) - self.sensing.jitter, self.time(step + 1) + self.sensing.jitter

    @kept
    def half_widths(self) -> tuple[FloatArray, FloatArray]:
        """Half-widths of E, and how much it widens the reachable box to hold the next prediction; both (ndim,).

        With memory to hold the next point that is carried on: by what E grows, and by what a push does in the end.
        """
        sensing, nothing = self.sensing, np.zeros(self.grid.ndim)
        if not sensing:
            return nothing, nothing
        slope, push, jumps = rates(self.grid, self.dynamics, self.time(self.most_steps), self.delta)
        box = carried(slope, push + jumps, nothing + np.array(sensing.error), sensing.delay)
        if sensing.memory:
            return box, self.spread - push * sensing.hold(self.delta)[0]
        return box, box + carried(slope, jumps, box, self.delta + 2 * sensing.jitter)

    @kept
    def spread(self) -> FloatArray:
        """By how much more than E a state of c +- E is off where c alone is led, an interval later: (ndim,)."""
        slope, push, jumps = rates(self.grid, self.dynamics, self.time(self.most_steps), self.delta)
        box = carried(slope, push + jumps, np.zeros(self.grid.ndim) + np.array(self.sensing.error), self.sensing.delay)
        return carried(slope, push + jumps, box, self.sensing.hold(self.delta)[0]) - box

    def interval(self, step: int) -> Interval:
        """What input and adversary can do from step k; one object for all steps if dynamics do not depend on time."""
        step = step if self.dynamics.timed else 0
        if step not in self._intervals:
            lasts = self.sensing.hold(self.delta)
            self._intervals[step] = Interval(self.grid, self.dynamics, self.span(step)[0], *lasts, self.half_widths[1])
        return self._intervals[step]

    @cached_property
    def rimmed(self) -> "ReachAvoidProblem":
        """The problem on the games' grid, with `RIM` more nodes past each safe end; itself if there is none."""
        grid = self.grid
        rim = np.isfinite(grid.faces("safe")).T * RIM  # (ndim, 2)
        if not rim.any():
            return self
        past, nodes = rim.T * grid.spacing, (rim.sum(axis=1) + grid.shape).tolist()
        ends = (grid.lower - past[0]).tolist(), (grid.upper + past[1]).tolist()
        wide = Grid(*ends, nodes, grid.periodic, grid.names, grid.ends, rim.tolist())

        def as_at_the_end(part: "UnsafeSet") -> "UnsafeSet":
            ends, swept = grid.subgrid(part.axes).faces("safe"), part.swept
            return replace(part, level_set=part.level_set.clipped(*ends), swept=swept and swept.clipped(*ends))

        dynamics = self.dynamics.clipped(*grid.faces("safe"))
        return replace(self, grid=wide, dynamics=dynamics, unsafe=tuple(map(as_at_the_end, self.unsafe)))

    def moves(self, part: UnsafeSet) -> bool:
        """Whether the avoid tubes of an unsafe set differ from step to step."""
        return part.moving or self.dynamics.timed

    def avoid_axes(self, part: UnsafeSet) -> tuple[int, ...]:
        """The axes on which the avoid game of an unsafe set is solved: the set's, and those their velocities depend on.

        Also those with safe ends, because a state that has left through one can no longer collide.
        """
        safe = np.isfinite(self.grid.faces("safe")).any(axis=0)
        return self.interval(0).closed({*part.axes, *np.flatnonzero(safe).tolist()})

    @cached_property
    def timeless(self) -> bool:
        """Whether nothing depends on time: not the dynamics, the target or an unsafe set."""
        return not (self.dynamics.timed or self.target.moving or any(part.moving for part in self.unsafe))

    def on(self, grid: Grid) -> "ReachAvoidProblem":
        """The problem on a window of its grid; properties of the whole grid keep their values."""
        if grid is self.grid:
            return self
        part = object.__new__(ReachAvoidProblem)  # its functions have been checked
        kept = {one.name for one in fields(self)} | {"half_widths", "spread"}
        part.__dict__.update({name: one for name, one in vars(self).items() if name in kept})
        part.__dict__.update(grid=grid, _intervals={}, _static={})
        if not (self.dynamics.timed or self.dynamics.stateless):
            part._intervals[0] = self.interval(0).on(grid)
        return part

    def pieces(self) -> "Iterator[ReachAvoidProblem]":
        """The problem on windows small enough to sample functions on: see `Grid.pieces`."""
        return map(self.on, self.grid.pieces())

    def sample(self, axes: Sequence[int], function: Callable[[FloatArray], FloatArray], name: str) -> FloatArray:
        """Values of a function of some axes at the nodes of their subgrid, float64, checked to be finite."""
        return _sampled_on(self.grid.subgrid(axes), function, name)

    def unsafe_at(self, part: UnsafeSet, t: float) -> FloatArray:
        """g of one unsafe set at time t, on the subgrid of its axes; a static set is sampled once."""
        key = part.level_set, part.sampling, self.grid.subgrid(part.axes)
        known: Any = SAMPLED if isinstance(part.level_set, Formula) else self._static  # black boxes may change
        values = known.get(key)
        if values is None:
            values = read_only(self._sampled(part, lambda points: part.level_set(points, t)))
        if not part.moving:
            known[key] = self._static[key] = values
        return values

    def unsafe_over(
        self, part: UnsafeSet, t0: float, t1: float, *, axes: Sequence[int] = (), view_time: str | None = None
    ) -> FloatArray:
        """g of one unsafe set over [t0, t1], on the subgrid of its axes, or of `axes`, which include them."""
        axes, view_time = tuple(axes) or part.axes, view_time or self.view_time
        over = partial(part.over, t0=t0, t1=t1, view_time=view_time)
        values = self._sampled(part, over) if part.moving else self.unsafe_at(part, t0)
        grid = self.grid.subgrid(axes)
        return np.broadcast_to(grid.lift(values, [axes.index(axis) for axis in part.axes]), grid.shape)

    def _sampled(self, part: UnsafeSet, function: Callable[[FloatArray], FloatArray]) -> FloatArray:
        """An unsafe set's function at the nodes, made `closed`, according to its `sampling`."""
        grid, size = self.grid.subgrid(part.axes), _size(self.grid.subgrid(part.axes), function)
        if part.sampling == "cell":
            whole = grid.whole if isinstance(grid, Window) else grid
            values = least_in_cells(whole, lambda points: _checked(function, points, part.name))
            values = values[np.ix_(*map(grid.places, range(grid.ndim)))] if isinstance(grid, Window) else values
        else:
            values = _sampled_on(grid, function, part.name)
            if isinstance(grid, Window) and ((values <= 0.0) & (values >= -HAIR * size)).any():
                more, middle = _with_nodes_around(grid)
                values = closed(more, _sampled_on(more, function, part.name), size)[middle]
            else:
                values = closed(grid, values, size)
        return np.where(values < 0, STEEP * values, values) if part.sampling == "steep" else values

    def goal(self, step: int) -> FloatArray:
        """Level-set function of S_k^N = L(t_k) minus G(t_k) on the grid (first row of Algorithm 1).

        Without a target, L(t_k) is the grid up to its unsafe ends.
        """
        t, jitter, grid = self.time(step), self.sensing.jitter, self.grid
        values = self._target_at(t)
        for part in self.unsafe:
            over = self.unsafe_over(part, t - jitter, t + jitter) if jitter and part.moving else self.unsafe_at(part, t)
            values = np.maximum(values, -grid.lift(over, part.axes))
        if self.stays:
            values = np.maximum(values, -grid.to_ends("unsafe"))
        return np.ascontiguousarray(np.broadcast_to(values, self.grid.shape))

    def _target_at(self, t: float) -> FloatArray:
        """Level-set function of the target, in a shape that broadcasts to the grid's; -inf where there is none."""
        grid, target = self.grid, self.target
        if self.stays:
            return np.full((1,) * grid.ndim, -np.inf)
        found = self.sample(target.axes, lambda points: target.level_set(points, t), target.name)
        return grid.lift(found, target.axes)

    def value_of(self, part: TargetSet | UnsafeSet, points: FloatArray, t: float) -> FloatArray:
        """Level-set function of one set at states (M, ndim), periodic axes wrapped, without interpolation: (M,)."""
        return part.level_set(self.grid.wrapped(points).take(part.axes, axis=1), t)

    def target_value(self, points: FloatArray, t: float) -> FloatArray:
        """Level-set function of the target at states (M, ndim), without interpolation: (M,)."""
        return self.value_of(self.target, points_array("points", points, self.grid.ndim), number("t", t))

    def unsafe_value(self, points: FloatArray, t: float) -> FloatArray:
        """Level-set function of G(t) at states (M, ndim), without interpolation: (M,); <= 0 is a collision."""
        points = points_array("points", points, self.grid.ndim)
        return self.unsafe_along(points[:, None], [number("t", t)])[:, 0]

    def unsafe_along(self, points: FloatArray, times: Sequence[float]) -> FloatArray:
        """As `unsafe_value` at points (M, T, ndim), column i at times[i], times ascending: (M, T)."""
        ndim, out = self.grid.ndim, np.full(points.shape[:2], np.inf)
        wrapped = self.grid.wrapped(points.reshape(-1, ndim)).reshape(points.shape)
        firsts = [0, *(i for i in range(1, len(times)) if times[i] != times[i - 1]), len(times)]
        for part in self.unsafe:
            for begin, end in pairwise(firsts) if part.moving else [(0, len(times))]:
                at = wrapped[:, begin:end].take(part.axes, axis=2).reshape(-1, len(part.axes))
                value = part.level_set(at, times[begin]).reshape(len(points), end - begin)
                np.minimum(out[:, begin:end], value, out=out[:, begin:end])
        return out

    def refuted(self, points: FloatArray, step: int, within: int) -> FloatArray:
        """Whether points (M, ndim) are in no tube (step, within), whatever was computed: bool (M,).

        They are in G, or within = 0 and they are not in the target, by the level-set functions without interpolation.
        """
        t = self.time(step)
        lost = self.unsafe_value(points, t) <= 0.0
        return lost if within or self.stays else lost | (self.target_value(points, t) > 0.0)

    @property
    def opaque(self) -> dict[str, str]:
        """Of each function that is a black box its name, and what its author declares of it."""
        boxes = {name: part for name, part in self.functions.items() if isinstance(part, BlackBox)}
        fields = ("reads", "slope", "rate", "enclosure")
        known = {n: ", ".join(one for one in fields if getattr(part, one) is not None) for n, part in boxes.items()}
        return {n: f"a BlackBox {f'with {one}' if one else 'of which nothing is declared'}" for n, one in known.items()}

    def black_box(self, name: str) -> BlackBox:
        """The black box of that name."""
        found = self.functions[name]
        assert isinstance(found, BlackBox)
        return found

    @property
    def functions(self) -> "dict[str, Formula | BlackBox]":
        """All functions of the problem, by the names that files give them."""
        dynamics = self.dynamics
        named = {"drift" if dynamics.gain is not None else "velocity": dynamics.drift, "gain": dynamics.gain}
        named |= {"bounds": dynamics.bounds, "target": None if self.stays else self.target.level_set}
        for place, part in enumerate(self.unsafe):
            named |= {f"unsafe {place}": part.level_set, f"swept {place}": part.swept}
        return {name: part for name, part in named.items() if part is not None}

    @property
    def texts(self) -> "tuple[dict[str, list[str]], list[Lookup]]":
        """The formulas as lines, by name, and the tables that they look up."""
        tables: list[Lookup] = []
        found = {n: written(one.outputs, tables) for n, one in self.functions.items() if isinstance(one, Formula)}
        return found, tables

    @property
    def numbers(self) -> dict[str, Any]:
        """Everything that a table depends on beside functions, as it stands in the head of a file."""
        sets = [{"name": p.name, "kind": "unsafe", "axes": list(p.axes), "sampling": p.sampling} for p in self.unsafe]
        target = [] if self.stays else [{"name": self.target.name, "kind": "target", "axes": list(self.target.axes)}]
        return {
            "delta": self.delta,
            "steps": self.steps,
            "view_time": self.view_time,
            "grid": {name: getattr(self.grid, name) for name in LAYOUT},
            "inputs": self.inputs.tolist(),
            "sensing": self.sensing.told,
            "sets": target + sets,
        }

    @cached_property
    def digest(self) -> str:
        """SHA-256 of everything that a table depends on, and all names, hexadecimal (`digest_of`)."""
        return digest_of(described(self), arrays_of(self))


def described(problem: ReachAvoidProblem) -> dict[str, Any]:
    """The problem as plain numbers, lists and text (JSON), for the head of a file."""
    functions = {}
    for name, lines in problem.texts[0].items():
        one: Any = problem.functions[name]
        functions[name] = {"coordinates": one.coordinates, "parameters": one.parameters, "lines": lines}
    formulas = {"format": FORMAT, "functions": functions, "opaque": problem.opaque}
    return problem.numbers | {"problem": problem.name, "formulas": formulas}


def arrays_of(problem: ReachAvoidProblem) -> dict[str, FloatArray]:
    """The arrays that belong to a description, by the names that a file gives them."""
    tables = {f"tables/{number}": table.values for number, table in enumerate(problem.texts[1])}
    return tables | {f"opaque/{name}": blackbox_values(problem, name) for name in problem.opaque}


def digest_of(told: Mapping[str, Any], arrays: Mapping[str, FloatArray]) -> str:
    """SHA-256, hexadecimal, of what the head of a file says of a problem, names included, and of its arrays.

    The error of measurements may be stated once for all axes. Two problems with one digest have one table.
    """
    said: dict[str, Any] = {name: told[name] for name in TOLD}
    if "error" in said["sensing"]:
        error = np.broadcast_to(said["sensing"]["error"], len(said["grid"]["shape"])).tolist()
        said["sensing"] = said["sensing"] | {"error": error}
    held = {}
    for name, values in arrays.items():
        numbers: Any = np.ascontiguousarray(values, "<f8")
        held[name] = [list(values.shape), hashlib.sha256(numbers).hexdigest()]
    return hashlib.sha256(json.dumps([said, held], sort_keys=True).encode()).hexdigest()


def _sampled_on(grid: Grid, function: Callable[[FloatArray], FloatArray], name: str) -> FloatArray:
    values = [_checked(function, piece.points(), name) for piece in grid.pieces()]
    return np.concatenate(values).reshape(grid.shape)


def _checked(function: Callable[[FloatArray], FloatArray], points: FloatArray, name: str) -> FloatArray:
    """Values of a level-set function at nodes; ValueError where single precision does not support them."""
    values = function(points)
    if not (finite := np.isfinite(values)).all():  # not of values at one time, which say so themselves
        raise ValueError(
            f"level set of {name!r} may be undefined or infinite at {points[int(np.argmin(finite))].tolist()}, by the "
            "bounds over pieces of an interval of time, which are wider than its values; keep what is under a root or "
            "divides from 0, as in np.sqrt(np.maximum(x, 0.0)), give swept=, or use view_time='sampled'"
        )
    if (largest := float(np.abs(values).max())) > LARGEST:
        raise ValueError(
            f"level set of {name!r} reaches {largest:.3g}, and single precision supports at most {LARGEST:g}; clip "
            "it, because far from the boundary only the sign matters"
        )
    if (lost := values[(values != 0) & (np.abs(values) < SMALLEST)]).size:
        raise ValueError(
            f"level set of {name!r} is {lost[0]:.3g} at a node, and single precision rounds magnitudes below "
            f"{SMALLEST:.2g} to 0, which would change the set; scale the function, or return 0 there"
        )
    return values


def check_sensing(problem: ReachAvoidProblem) -> None:
    """Raise ValueError if a problem does not fit its sensing."""
    sensing, grid, delta = problem.sensing, problem.grid, problem.delta
    if isinstance(sensing.error, tuple) and len(sensing.error) != grid.ndim:
        raise ValueError(f"error must be one number or {grid.ndim}, one for each axis, got {len(sensing.error)}")
    whole("rest", sensing.rest, least=0, most=len(problem.inputs) - 1)
    if sensing.delay + 2 * sensing.jitter > delta:
        raise ValueError(
            f"delay + 2 jitter must be at most delta, {delta:g} s, or a measurement could come before the previous "
            f"input has started; got {sensing.delay:g} + 2 x {sensing.jitter:g}"
        )
    steps, j = range((problem.steps or 0) + 1), sensing.jitter
    if j and (problem.target.moving or problem.dynamics.timed or problem.view_time == "instantaneous"):
        raise ValueError(
            "with jitter sampling times are uncertain: neither dynamics nor target may depend on time, and view_time "
            'must be "swept" or "sampled"'
        )
    if grid.has("safe"):
        raise ValueError('with sensing no end of the grid may be "safe": it is uncertain when the state has passed it')
    goals = (problem.goal(step) for step in steps)
    if not any((shrunk(problem, shrunk(problem, goal)) <= 0).any() for goal in goals):
        raise ValueError(
            f"the state is known to within {np.round(problem.half_widths[0], 6).tolist()} only, and no box of twice "
            "that around a grid node is in the target and safe; reduce error or delay, or enlarge the target"
        )


def carried(slope: FloatArray, push: FloatArray | float, box: FloatArray, duration: float) -> FloatArray:
    """Solution w(duration) of dw/dt = slope w + push, w(0) = box, (ndim,), by a series without negative terms."""
    ndim = len(box)
    rate, term = np.zeros((ndim + 1, ndim + 1)), np.array([*box, 1.0])
    rate[:ndim, :ndim], rate[:ndim, ndim] = slope, push
    total = term.copy()
    for place in range(1, TERMS):
        term = rate @ term * (duration / place)
        total += term
    return total[:ndim]


def shrunk(problem: ReachAvoidProblem, values: FloatArray, axes: Sequence[int] | None = None) -> FloatArray:
    """Level-set function of the points around which the whole box E is in {values <= 0}, on the grid of some axes."""
    axes = range(problem.grid.ndim) if axes is None else axes
    grid, box = problem.grid.subgrid(axes), problem.half_widths[0][list(axes)]
    if not box.any():
        return values
    ((_, out),) = maximum_over_boxes(grid, values, -box[None], box[None], "linear")
    for axis, (low, high) in enumerate(zip(*grid.faces("unsafe"), strict=True)):
        nodes = grid.nodes(axis)
        beyond = grid.lift(box[axis] - np.minimum(nodes - low, high - nodes), (axis,))  # -inf where no end is unsafe
        out = np.maximum(out, beyond.astype(out.dtype))
    return out


def led_into(problem: ReachAvoidProblem, values: FloatArray) -> FloatArray:
    """Level-set function of the points that an interval has to lead to so that what follows is in {values <= 0}.

    That are all predictions, E around; with memory all points that may be carried on, which E alone spreads.
    """
    grown = problem.half_widths[1]
    if not problem.sensing.memory:
        return shrunk(problem, values)
    if not grown.any():
        return values
    ((_, out),) = maximum_over_boxes(problem.grid, values, -grown[None], grown[None], "linear")
    return out


def worst_around(problem: ReachAvoidProblem, values: FloatArray, points: FloatArray) -> FloatArray:
    """The largest value of an interpolated grid function over the box E around each of the points (M, ndim): (M,).

    It is at one of the ends of the box and the nodes in between on each axis, clipped at walls, or at the point.
    """
    grid, columns = problem.grid, []
    if not problem.half_widths[0].any():
        return grid.interpolate(values, points)
    for axis, (width, lower, h) in enumerate(zip(problem.half_widths[0], grid.lower, grid.spacing, strict=True)):
        x = points[:, axis, None]
        nodes = lower + h * (np.ceil((x - width - lower) / h) + np.arange(int(2 * width / h) + 1))
        between = [x - width, np.minimum(nodes, x + width), x + width]
        columns.append(np.concatenate(between, axis=1) if width else x)
    places = np.indices([column.shape[1] for column in columns]).reshape(len(columns), -1)
    found = np.stack([column[:, place] for column, place in zip(columns, places, strict=True)], axis=-1)
    around = np.concatenate([points[:, None], grid.clipped(found)], axis=1)
    return grid.interpolate(values, around.reshape(-1, grid.ndim)).reshape(around.shape[:2]).max(axis=1)


def _steepest(grid: Grid, values: FloatArray, axis: int) -> float:
    """The largest difference between neighbours along an axis; 0 where there is one node, as values are alike there."""
    here, there = grid.edges(values, axis)
    return float(np.abs(there - here).max(initial=0.0)) if values.shape[axis] > 1 else 0.0


def beside(grid: Grid, values: FloatArray, axis: int, by: int, past: float) -> FloatArray:
    """For each node, or cell, the value `by` on along an axis; `past` beyond a bounded end."""
    out = np.roll(values, -by, axis)
    if not grid.periodic[axis]:
        ends = slice(0, -by) if by < 0 else slice(values.shape[axis] - by, None)
        out[(slice(None),) * axis + (ends,)] = past
    return out


def _size(grid: Grid, function: Callable[[FloatArray], FloatArray]) -> float:
    """The largest value of a level-set function at the corners of a grid, of a window that of the whole grid.

    What counts as rounding is relative to it, so that neither the unit nor the cut of the grid makes a difference. 1
    where they all are 0 or undefined.
    """
    ends = [whole.nodes(axis)[[0, -1]] for whole in [getattr(grid, "whole", grid)] for axis in range(grid.ndim)]
    corners = np.stack([one.ravel() for one in np.meshgrid(*ends, indexing="ij")], axis=1)
    return float(np.abs(np.nan_to_num(function(corners), posinf=0.0, neginf=0.0)).max()) or 1.0


def closed(grid: Grid, values: FloatArray, size: float = 1.0) -> FloatArray:
    """Values of an unsafe set, shape grid.shape, made negative at all nodes where they are <= 0, as G is closed.

    A node on the boundary gets minus `ON_BOUNDARY`. A function that is 0, up to `HAIR`, in the whole set (an unsigned
    distance, a positive part, 1 - occupancy) does not say where between two nodes the set ends. It is therefore
    extrapolated into the set with its slope just outside, which puts the boundary of a distance where it belongs. If
    the slope at the set is steeper than before, as where the function jumps or is cut off, the set is assumed to end
    next to the outer node. The value at a node depends on those up to `AROUND` nodes away.
    """
    inside = np.nonzero(values <= 0.0)
    level, steps = values[inside], [(axis, by) for axis in range(grid.ndim) for by in (-1, 1)]
    near = [_moved(grid, values, inside, axis, by) for axis, by in steps]  # NaN past an end, which nothing finds
    flat = (level >= -HAIR * size) & ~np.any([one < level for one in near], axis=0)
    rim = flat & np.any([one > 0.0 for one in near], axis=0)
    out = np.where(values == 0.0, -ON_BOUNDARY * size, values)
    if not rim.any():
        return out
    at, depth, fallen = tuple(index[rim] for index in inside), out[inside][rim], np.zeros(np.count_nonzero(rim))
    for (axis, by), first in zip(steps, near, strict=True):
        first, second = first[rim], _moved(grid, values, at, axis, 2 * by)
        drop, rate = first - level[rim], second - first
        fall = np.where(rate >= drop * (1.0 - 1e-6), np.maximum(rate, drop), (1.0 + STEEP) * drop)
        depth = np.where(first > 0.0, np.minimum(depth, first - fall), depth)
        fallen = np.where(first > 0.0, np.maximum(fallen, fall), fallen)
    step = np.zeros(values.shape)
    out[at], step[at] = depth, fallen
    rest = tuple(index[flat & ~rim] for index in inside)
    for _ in range(AROUND - 2):  # deeper in by as much again, or differences would wear down what is but a shell
        falls = np.nan_to_num([_moved(grid, step, rest, *one) for one in steps])
        there = (_moved(grid, out, rest, *one) for one in steps)
        depths = [np.where(fall > 0.0, one - fall, -np.inf) for one, fall in zip(there, falls, strict=True)]
        found = falls.max(axis=0) > 0.0
        at = tuple(index[found] for index in rest)
        out[at], step[at] = np.max(depths, axis=0)[found], falls.max(axis=0)[found]
        rest = tuple(index[~found] for index in rest)
    return out


def _moved(grid: Grid, values: FloatArray, at: tuple[FloatArray, ...], axis: int, by: int) -> FloatArray:
    """Values at the nodes that are `by` nodes further along an axis than some nodes; NaN past a bounded end."""
    n, moved = grid.shape[axis], at[axis] + by
    found = values[(*at[:axis], moved % n, *at[axis + 1 :])]
    return found if grid.periodic[axis] else np.where((moved >= 0) & (moved < n), found, np.nan)


def _with_nodes_around(grid: Window) -> tuple[Grid, tuple[FloatArray, ...]]:
    """A window enlarged by `AROUND` nodes on each side, and the index of the original window in its arrays."""
    first, shape, places = [], [], []
    for n, begin, count, periodic in zip(grid.whole.shape, grid.first, grid.shape, grid.periodic, strict=True):
        low, high = begin - AROUND, begin + count + AROUND
        low, high = (low, high) if periodic else (max(low, 0), min(high, n))
        low, high = (0, n) if high - low >= n else (low, high)
        first.append(low % n)
        shape.append(high - low)
        places.append((begin + np.arange(count) - low) % n)
    return grid.whole.window(first, shape), np.ix_(*places)


def least_in_cells(grid: Grid, function: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """For each node, a lower bound on a level-set function in all cells that touch it, shape `grid.shape`.

    It is the least, over the points z of a lattice of `FINE` parts per cell, of

        f(z) - 1/2 sum over the axes of the largest |f(z') - f(z'')|,

    with z' and z'' neighbours along the axis, both at most one part from z: so a steep function far away costs nothing.
    The set of the interpolated bounds contains the true set. The lattice has points at both ends of a periodic axis, as
    a function that is not periodic jumps between the two and not before them.
    """
    lines = [
        np.linspace(low, np.nextafter(high, low) if periodic else high, (n if periodic else n - 1) * FINE + 1)
        for low, high, n, periodic in zip(grid.lower, grid.upper, grid.shape, grid.periodic, strict=True)
    ]
    points = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, grid.ndim)
    values = np.asarray(function(points), dtype=np.float64).reshape([len(line) for line in lines])
    values = values - sum(_change_nearby(values, axis) for axis in range(grid.ndim)) / 2
    for axis, periodic in enumerate(grid.periodic):
        parts = values.shape[axis] - 1
        around = np.clip(np.arange(0, parts + 1, FINE) + np.arange(-FINE, FINE + 1)[:, None], 0, parts)
        values = np.minimum.reduce([values.take(places, axis) for places in around])
        if periodic:  # its two ends are one node
            first, last = values.take([0], axis), values.take([-1], axis)
            values = np.concatenate([np.minimum(first, last), values.take(range(1, grid.shape[axis]), axis)], axis)
    return np.where(values == 0.0, -ON_BOUNDARY, values)


def _change_nearby(values: FloatArray, axis: int) -> FloatArray:
    """For each point of a lattice the largest change between neighbours along an axis, both at most one point away."""
    change = np.abs(np.diff(values, axis=axis))
    change = np.maximum(
        change.take([0, *range(change.shape[axis])], axis), change.take([*range(change.shape[axis]), -1], axis)
    )
    for other in set(range(values.ndim)) - {axis}:
        last = values.shape[other] - 1
        shifted = (np.clip(np.arange(last + 1) + by, 0, last) for by in (-1, 0, 1))
        change = np.maximum.reduce([change.take(places, other) for places in shifted])
    return np.asarray(change)


def blackbox_values(problem: "ReachAvoidProblem", name: str) -> FloatArray:
    """Values of a black box at random states and some times: what tells one from another, (values,)."""
    function, grid, rng = problem.black_box(name), problem.grid, np.random.default_rng(0)
    if name.startswith(("unsafe", "target", "swept")):
        part = problem.target if name == "target" else problem.unsafe[int(name.split()[1])]
        grid = grid.subgrid(part.axes)
    states, found = rng.uniform(grid.lower, grid.upper, (VALUES_KEPT // BOX_STEPS, grid.ndim)), []
    for step in range(BOX_STEPS):
        t = step * problem.delta * problem.most_steps / BOX_STEPS
        given: tuple[Any, ...] = (problem.inputs[step % len(problem.inputs)], t) if name in ("drift", "gain") else (t,)
        given = (t, t + problem.delta) if name.startswith("swept") else given
        found.append(function(states, *given).ravel())
    return np.concatenate(found)


def _states(grid: Grid) -> FloatArray:
    """Random states on a grid, a tenth of them at nodes, ends and zeros: (COMPARED_STATES, ndim)."""
    rng = np.random.default_rng(0)
    states = rng.uniform(grid.lower, grid.upper, (COMPARED_STATES, grid.ndim))
    for axis in range(grid.ndim):
        inside = [0.0, -0.0] if grid.lower[axis] <= 0.0 <= grid.upper[axis] else []
        kinds = np.concatenate([grid.nodes(axis), [grid.lower[axis], grid.upper[axis]], inside])
        states[: COMPARED_STATES // 10, axis] = rng.choice(kinds, COMPARED_STATES // 10)
    return grid.wrapped(states)


def _times(problem: "ReachAvoidProblem") -> list[float]:
    """Times at which functions are compared, from the first to after the last; numbers, as the time is."""
    return [share * problem.delta for share in (0.0, 0.7)] + [
        share * problem.delta * problem.most_steps for share in (0.31, 0.59, 0.83, 1.01)
    ]


def _compare_set(problem: "ReachAvoidProblem", part: "TargetSet | UnsafeSet") -> None:
    """Compare the formulas of a set with the functions that they were read from, which are then forgotten."""
    states, times = _states(problem.grid.subgrid(part.axes)), _times(problem)
    spans = [(t, t + problem.delta) for t in times]
    for formula, each in ((part.level_set, [(t,) for t in times]), (getattr(part, "swept", None), spans)):
        if isinstance(formula, Formula) and formula.source is not None:
            for when in each:
                compare(formula, formula.source, states, *when)
            object.__setattr__(formula, "source", None)


def _check_swept(problem: "ReachAvoidProblem", part: "UnsafeSet") -> None:
    """Raise ValueError where `swept` is above the level-set function at a time of its interval."""
    grid, rng = problem.grid.subgrid(part.axes), np.random.default_rng(0)
    points = rng.uniform(grid.lower, grid.upper, (SWEPT_STATES, grid.ndim))
    lasting = problem.sensing.hold(problem.delta)[0]
    for step in np.unique(np.linspace(0, problem.steps - 1, min(problem.steps, SWEPT_STATES)).astype(int)).tolist():
        t0, t1 = problem.span(step)
        swept = part.swept(points, t0, t1)
        for t in (t0 + INSTANTS * lasting).tolist():
            excess = swept - part.level_set(points, t)
            if excess.max() > EXCUSED * float(np.abs(swept).max()):
                worst = points[int(excess.argmax())].tolist()
                raise ValueError(
                    f"swept of {part.name!r} over [{t0:g}, {t1:g}] is {excess.max():.3g} above the level-set "
                    f"function at t = {t:g}, at {worst}; it must be at most that at every time of the interval, or "
                    "leave it out: the library then sweeps the set itself"
                )


def _try_goals(problem: "ReachAvoidProblem") -> None:
    """Raise ValueError where no node is in the target and safe; a function may be undefined or out of range at one."""
    steps, target = range((problem.steps or 0) + 1), problem.target
    for part, step in product(problem.pieces(), steps):
        if (part._target_at(problem.time(step)) <= 0).any() and (part.goal(step) <= 0).any():
            return
    if problem.stays:
        raise ValueError("every grid node is in an unsafe set: check the signs (negative is inside)")
    points = problem.grid.subgrid(target.axes).points()
    if not any((target.level_set(points, problem.time(step)) <= 0).any() for step in steps):
        raise ValueError(
            "no grid node is in the target at any step: it lies off the grid or falls between nodes, or its "
            "level-set function has the wrong sign (negative is inside); move or enlarge it, or use more nodes"
        )
    raise ValueError(
        "no grid node is in the target and safe at any step: the unsafe sets swallow the target; move it, or "
        "check the sign of their level-set functions (negative is inside)"
    )
