"""The robust motion planning problem of Sec. 2 and 3, as data.

A `ReachAvoidProblem` is a record, with what is a function of state and time. `consistency` has what is checked when one
is made; what has nodes is made of it by those who solve it (`sdhj.problem.samples`).
"""

import json
import reprlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise, product
from typing import TYPE_CHECKING, Any

import numpy as np

from sdhj.common.checks import number, option, points_array, whole
from sdhj.common.remembering import FloatArray, Remembering, Sealed, kept
from sdhj.formulas.formula import BlackBox, Formula
from sdhj.formulas.graph import MOST_TABLES, Lookup, ordered
from sdhj.formulas.text import written
from sdhj.problem.consistency import (
    check_sensing,
    check_set,
    compared_states,
    compared_times,
    try_goals,
)
from sdhj.problem.describing import LAYOUT, arrays_of, described, digest_of
from sdhj.problem.dynamics import Dynamics
from sdhj.problem.grid import Grid
from sdhj.problem.interval import Interval
from sdhj.problem.sensing import Sensing
from sdhj.problem.sets import ANYWHERE, VIEW_TIMES, TargetSet, UnsafeSet
from sdhj.problem.steepness import growth_bound, lipschitz_bounds
from sdhj.problem.vector_field import VectorField

FOREVER = 1000  # steps at most for a problem without a number of steps
MOST_SAMPLED = 1_000_000  # steps of a problem
MOST_DELTA = 1e15  # s


@dataclass(frozen=True)
class ReachAvoidProblem(Remembering):
    """The task to reach a target within N steps and never touch an unsafe set, against any adversary (Definition 1).

    Parameters
    ----------
    grid : Grid
    dynamics : Dynamics
    target : TargetSet, or None
        None: only stay clear of the unsafe sets, and of the unsafe ends of the grid, for all N steps.
    unsafe : sequence of UnsafeSet
    delta : float
        The sampling interval, s.
    steps : int, or None
        N. None: as many as it takes until one more changes nothing, to reach the target eventually or to stay safe for
        ever, by method "certified"; nothing may then depend on time, and the table's problem has the number. Where
        anything depends on time there are N (N + 1) / 2 tubes instead of N.
    view_time : {"swept", "sampled", "instantaneous"}
        How a moving unsafe set enters the game of one interval (Sec. 5.4): as a static set that contains it at all
        times (safe), as 20 samples, as in the paper (not safe), or as it is at each time.
    name : str
        One line of text, for messages and files.
    recipe : mapping, optional
        {"builder": name, "arguments": {...}} from which a case study is rebuilt.
    sensing : Sensing
        By default none; `sdhj.problem.sensing` says what the sets then mean.

    Raises
    ------
    ValueError
        If no grid node is both in the target and safe at any step.

    Examples
    --------
    A robot that is to stay between the two ends of its track for ever, so without a target; an input is stronger than
    the push:

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
    >>> sdhj.solve(problem).contains([[0.0], [0.99], [1.01]], start=0)
    array([ True,  True, False])
    """

    grid: Grid
    dynamics: VectorField  # as `Dynamics.read` made it
    target: TargetSet  # `ANYWHERE`, the same object, where there is no target
    unsafe: tuple[UnsafeSet, ...]
    delta: float
    steps: int | Any  # N; None for a problem without a number of steps
    view_time: str = "swept"
    name: str = "problem"
    recipe: Mapping[str, Any] = field(default_factory=dict)
    sensing: Sensing = field(default_factory=Sensing)
    # {step: what `interval` has made}; under 0 for all steps if the dynamics do not depend on time
    _intervals: dict[int, Interval] = field(default_factory=dict, init=False, repr=False)

    if TYPE_CHECKING:  # what is given, where the fields are what is made of it

        def __init__(
            self,
            grid: Grid,
            dynamics: Dynamics | VectorField,
            target: TargetSet | None,
            unsafe: Sequence[UnsafeSet],
            delta: float,
            steps: int | None,
            view_time: str = ...,
            name: str = ...,
            recipe: Mapping[str, Any] = ...,
            sensing: Sensing = ...,
        ) -> None:
            """Make a problem; the arguments are those of the class."""

    def __post_init__(self) -> None:
        """Replace the fields by what is made of them, and check that all fit one another."""
        self._check_parts()
        option("view_time", self.view_time, VIEW_TIMES)
        object.__setattr__(self, "delta", number("delta", self.delta, above=0.0, most=MOST_DELTA))
        if self.steps is not None:
            object.__setattr__(self, "steps", whole("steps", self.steps, least=1, most=MOST_SAMPLED))
        ndim = self.grid.ndim
        if isinstance(given := self.dynamics, Dynamics):
            object.__setattr__(self, "dynamics", given.read(ndim))
            given.compare(self.dynamics, compared_states(self.grid), compared_times(self))
        # only from here on is every field what is made of it: cached properties must not be asked above
        if self.dynamics.ndim != ndim:
            raise ValueError(f"the dynamics are of {self.dynamics.ndim} coordinates, and the grid has {ndim} axes")
        for j, step in product(
            range(len(self.inputs)), range((self.steps or 0) + 1) if self.dynamics.depends_on_time else [0]
        ):
            self.dynamics.bounds_at(j, self.time(step))
        nodes = ordered(node for one in self.functions.values() if isinstance(one, Formula) for node in one.outputs)
        tables = {one.value.digest: one.value.values.nbytes for one in nodes if one.op == "gridded"}
        if (size := sum(tables.values())) > MOST_TABLES:
            raise ValueError(
                f"the tables that the problem looks up, of maps too, take {size:,} bytes together, and at most "
                f"{MOST_TABLES:,} can be kept in a file; use fewer nodes or pixels"
            )
        if self.steps is None and not self.time_invariant:
            raise ValueError(
                "steps=None solves until nothing changes from step to step, but the dynamics, an unsafe set or the "
                "target depend on time; give a number of steps"
            )
        check_set(self, self.target)
        for part in self.unsafe:
            check_set(self, part)
        try_goals(self)
        if self.sensing:
            check_sensing(self)  # last, as E rests on all that was checked

    def _check_parts(self) -> None:
        """Check the types of most fields, and make a target of None `ANYWHERE` and the recipe read-only."""
        if not (isinstance(self.name, str) and self.name.isprintable()):
            raise ValueError(f"name must be text in one line, without control characters, got {self.name!r}")
        try:
            json.dumps(dict(self.recipe), allow_nan=False)
            object.__setattr__(self, "recipe", Sealed(self.recipe))
        except (TypeError, ValueError) as error:
            raise ValueError(f"recipe must be a mapping that can be written as JSON, or left out: {error}") from None
        target: Any = self.target
        # the one object, as `has_no_target` asks for identity
        if target is None:
            object.__setattr__(self, "target", ANYWHERE)
        if not isinstance(self.grid, Grid):
            raise ValueError(f"grid must be a sdhj.Grid, got {reprlib.repr(self.grid)}")
        if not isinstance(self.dynamics, Dynamics | VectorField):
            raise ValueError(f"dynamics must be a sdhj.Dynamics, got {reprlib.repr(self.dynamics)}")
        if not isinstance(self.target, TargetSet):
            raise ValueError(f"target must be a TargetSet, or None to stay safe, got {reprlib.repr(self.target)}")
        if not isinstance(self.sensing, Sensing):
            raise ValueError(f"sensing must be a sdhj.Sensing(error=..., ...), got {reprlib.repr(self.sensing)}")
        given: Any = self.unsafe
        unsafe = tuple(given) if isinstance(given, Sequence) else (given,)
        if not isinstance(given, Sequence) or not all(isinstance(part, UnsafeSet) for part in unsafe):
            shown = reprlib.repr(given)
            raise ValueError(f"unsafe must be a sequence of UnsafeSet, empty if nothing is unsafe, got {shown}")
        object.__setattr__(self, "unsafe", unsafe)
        if not self.has_no_target and self.grid.has("frees"):
            raise ValueError('"safe" ends need a problem without a target: a state that leaves there cannot reach one')
        if self.has_no_target and not unsafe and not self.grid.has("fails"):
            raise ValueError("there is no target and nothing to stay clear of; give an unsafe set or an unsafe end")

    def __eq__(self, other: object) -> bool:
        return self is other or (isinstance(other, ReachAvoidProblem) and self.digest == other.digest)

    def __hash__(self) -> int:
        return hash(self.digest)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of everything that a table depends on; black boxes are called."""
        return digest_of(described(self), arrays_of(self))

    # ---- numbers, steps and times

    @property
    def most_steps(self) -> int:
        """N, or `FOREVER`, the most that are solved without a number of steps."""
        return self.steps or FOREVER

    @cached_property
    def time_invariant(self) -> bool:
        """Whether neither the dynamics nor the target nor an unsafe set depends on time."""
        return not (
            self.dynamics.depends_on_time or self.target.moving or any(unsafe_set.moving for unsafe_set in self.unsafe)
        )

    @property
    def has_no_target(self) -> bool:
        """Whether the task is only to stay clear of the unsafe sets."""
        return self.target is ANYWHERE

    @property
    def all_sets(self) -> tuple[TargetSet | UnsafeSet, ...]:
        """The target, where there is one, and then the unsafe sets."""
        return *(() if self.has_no_target else (self.target,)), *self.unsafe

    @property
    def inputs(self) -> FloatArray:
        """The inputs u_j, (L, m), read-only."""
        return self.dynamics.inputs

    def time(self, step: int) -> float:
        """Time at which the input of step k, or of a part of one, takes effect, s: k delta, plus a `Sensing`'s delay.

        Examples
        --------
        With the robot on a line of `help(sdhj)`:

        >>> problem.time(2)
        1.0
        """
        return step * self.delta + self.sensing.delay

    def span(self, step: int) -> tuple[float, float]:
        """Earliest begin and latest end, s, of the time in which the input of step k is held, jitter counted in."""
        return self.time(step) - self.sensing.jitter, self.time(step + 1) + self.sensing.jitter

    @kept
    def half_widths(self) -> tuple[FloatArray, FloatArray]:
        """Half-widths of E, the box around a prediction that holds the state, and by how much boxes are widened.

        (ndim,) each, 0 without a `Sensing`. E = w(delay) of dw/dt = A w + b + jumps, w(0) = error (`growth_bound`).
        Boxes of reachable states are widened to hold the next prediction: by E + w(h), dw/dt = A w + jumps, w(0) = E,
        for the longest hold h; or with memory the next point: by `error_growth` - b h.
        """
        # With memory b h is left out as the boxes have it: what v does to a state in that time (*Memory* in
        # `sdhj.problem.sensing`).
        #
        # Cells have an E of their own, `sdhj.certified.images.prediction_error`: their file has it as "unsure", and the
        # checker proves it.
        sensing, nothing = self.sensing, np.zeros(self.grid.ndim)
        if not sensing:
            return nothing, nothing
        slope, push, jumps = lipschitz_bounds(self.grid, self.dynamics, self.time(self.most_steps), self.delta)
        box = growth_bound(slope, push + jumps, nothing + np.array(sensing.error), sensing.delay)
        if sensing.remembers:
            return box, self.error_growth - push * sensing.hold(self.delta)[0]
        return box, box + growth_bound(slope, jumps, box, self.delta + 2 * sensing.jitter)

    @kept
    def error_growth(self) -> FloatArray:
        """w(h) - E, (ndim,), dw/dt = A w + b + jumps, w(0) = E: what a point's error gains over the longest hold h."""
        slope, push, jumps = lipschitz_bounds(self.grid, self.dynamics, self.time(self.most_steps), self.delta)
        box = growth_bound(
            slope, push + jumps, np.zeros(self.grid.ndim) + np.array(self.sensing.error), self.sensing.delay
        )
        return growth_bound(slope, push + jumps, box, self.sensing.hold(self.delta)[0]) - box

    def interval(self, step: int) -> Interval:
        """The motion from step k to k + 1, one object for all steps if the dynamics do not depend on time."""
        step = step if self.dynamics.depends_on_time else 0
        if step not in (known := self._intervals):
            lasts = self.sensing.hold(self.delta)
            known[step] = Interval(self.grid, self.dynamics, self.span(step)[0], *lasts, self.half_widths[1])
        return known[step]

    def moves(self, unsafe_set: UnsafeSet) -> bool:
        """Whether the avoid tubes of an unsafe set differ from step to step."""
        return unsafe_set.moving or self.dynamics.depends_on_time

    # ---- the sets at states

    def value_of(self, part: TargetSet | UnsafeSet, points: FloatArray, t: float) -> FloatArray:
        """Level-set function of one set at states (M, ndim) and time t, s: (M,)."""
        return part.level_set(self.grid.wrapped(points).take(part.axes, axis=1), t)

    def target_value(self, points: FloatArray, t: float) -> FloatArray:
        """Level-set function of the target at states (M, ndim) and a time t, s, without interpolation: (M,).

        <= 0 in the target; -1 without one. ValueError if the function is undefined at a state.

        Examples
        --------
        With the robot on a line of `help(sdhj)`:

        >>> problem.target_value([[0.25], [2.0]], 0.0)
        array([-0.75,  1.  ])
        """
        return self.value_of(self.target, points_array("points", points, self.grid.ndim), number("t", t))

    def unsafe_value(self, points: FloatArray, t: float, inputs: FloatArray | None = None) -> FloatArray:
        """Level-set function of G(t) at states (M, ndim), without interpolation: (M,); <= 0 is a collision.

        Parameters
        ----------
        points, t
            As for `target_value`.
        inputs : (M,) int array, optional
            What is applied there, by index, for sets that are unsafe under some inputs only. By default those count
            that are unsafe under all; +inf where none counts.

        Examples
        --------
        With the robot on a line of `help(sdhj)`:

        >>> problem.unsafe_value([[2.5], [3.5]], 0.0)
        array([ 0.5, -0.5])
        """
        points = points_array("points", points, self.grid.ndim)
        return self.unsafe_along(points[:, None], [number("t", t)], inputs)[:, 0]

    def unsafe_along(self, points: FloatArray, times: Sequence[float], inputs: FloatArray | None = None) -> FloatArray:
        """Level-set function of G along paths of states (M, T, ndim), under inputs (M,): (M, T)."""
        # compiled look-ups evaluate sets that are formulas themselves; they ask this where one is a black box
        ndim, out = self.grid.ndim, np.full(points.shape[:2], np.inf)
        wrapped = self.grid.wrapped(points.reshape(-1, ndim)).reshape(points.shape)
        firsts = [0, *(i for i in range(1, len(times)) if times[i] != times[i - 1]), len(times)]
        for unsafe_set in self.unsafe:  # equal times are evaluated together; where no set counts it stays +inf
            counts = unsafe_set.counts(inputs)
            for begin, end in (pairwise(firsts) if unsafe_set.moving else [(0, len(times))]) if counts.any() else ():
                at = wrapped[:, begin:end].take(unsafe_set.axes, axis=2).reshape(-1, len(unsafe_set.axes))
                value = unsafe_set.level_set(at, times[begin]).reshape(len(points), end - begin)
                np.minimum(out[:, begin:end], value, out=out[:, begin:end], where=counts.reshape(-1, 1))
        return out

    def arrived(self, states: FloatArray, step: int) -> FloatArray:
        """The numbers of those states that are known to be in the target and no unsafe set at a step."""
        level_set, axes, t = self.target.level_set, self.target.axes, self.time(step)
        # certified tables ask, and promise such a state whatever its cell is
        if self.has_no_target or self.sensing:
            return np.zeros(0, np.int64)  # with a `Sensing` the true state is not known
        points, rows = self.grid.wrapped(states), None
        if isinstance(level_set, Formula):  # in a third of the time; it has values off the grid, too
            rows = np.flatnonzero(level_set(points.take(axes, axis=1), t, finite=False) <= 0.0)
            if not rows.size:
                return rows
        known = np.isfinite(states).all(axis=1) & ~self.grid.beyond(states, "fails", "holds", "frees")
        rows = np.flatnonzero(known) if rows is None else rows[known[rows]]
        there = points[rows]
        return rows[(self.value_of(self.target, there, t) <= 0.0) & (self.unsafe_value(there, t) > 0.0)]

    def surely_in_no_tube(self, points: FloatArray, step: int, within: int) -> FloatArray:
        """Whether states are in no tube (step, within), by the sets alone: (M,)."""
        t = self.time(step)
        lost = self.unsafe_value(points, t) <= 0.0
        return lost if within or self.has_no_target else lost | (self.target_value(points, t) > 0.0)

    # ---- what files and digests have of it

    @property
    def opaque(self) -> dict[str, str]:
        """For each function that is a black box its name, with words on what its author declares."""
        boxes = {name: part for name, part in self.functions.items() if isinstance(part, BlackBox)}
        fields = ("reads", "slope", "rate", "enclosure")
        known = {n: ", ".join(one for one in fields if getattr(part, one) is not None) for n, part in boxes.items()}
        return {n: f"a BlackBox {f'with {one}' if one else 'of which nothing is declared'}" for n, one in known.items()}

    def black_box(self, name: str) -> BlackBox:
        """The black box of that name in `functions`."""
        found = self.functions[name]
        assert isinstance(found, BlackBox)
        return found

    @property
    def functions(self) -> "dict[str, Formula | BlackBox]":
        """All functions of the problem, by the names that files give them."""
        dynamics = self.dynamics
        # `formulas_in`, `blackbox_values`, `in_mathematics` of `sdhj.cli` and the checker's `Problem` know these names
        named = {"drift" if dynamics.gain is not None else "velocity": dynamics.drift, "gain": dynamics.gain}
        named |= {"bounds": dynamics.bounds, "target": None if self.has_no_target else self.target.level_set}
        for i, part in enumerate(self.unsafe):
            named |= {f"unsafe {i}": part.level_set, f"swept {i}": part.swept}
        return {name: part for name, part in named.items() if part is not None}

    @property
    def texts(self) -> "tuple[dict[str, list[str]], list[Lookup]]":
        """Lines of text for each formula in `functions`, and the tables that they refer to by position."""
        tables: list[Lookup] = []
        found = {n: written(one.outputs, tables) for n, one in self.functions.items() if isinstance(one, Formula)}
        return found, tables

    @property
    def numbers(self) -> dict[str, Any]:
        """Everything that a table depends on beside functions, as plain numbers, lists and text."""
        # `inputs` are left out where there are none: an entry of None would change the digests of all such files.
        # The checker refuses a field that it does not know (`entry` in `sdhj.certified.check.stated`).
        sets: list[dict[str, Any]] = [
            {"name": p.name, "kind": "unsafe", "axes": list(p.axes), "sampling": p.sampling}
            | ({} if p.inputs is None else {"inputs": list(p.inputs)})
            for p in self.unsafe
        ]
        if not self.has_no_target:
            sets.insert(0, {"name": self.target.name, "kind": "target", "axes": list(self.target.axes)})
        return {
            "delta": self.delta,
            "steps": self.steps,
            "view_time": self.view_time,
            "grid": {name: getattr(self.grid, name) for name in LAYOUT},
            "inputs": self.inputs.tolist(),
            "sensing": self.sensing.entry_in_head,
            "sets": sets,
        }
