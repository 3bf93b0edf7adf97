"""A problem as it was stated: its fields, and what follows from them without looking at a grid's nodes."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from sdhj.formulas.formula import BlackBox, Formula
from sdhj.formulas.graph import Lookup
from sdhj.formulas.remembering import Remembering
from sdhj.formulas.text import written
from sdhj.kernels import FloatArray, kept
from sdhj.problem.dynamics import VectorField
from sdhj.problem.grid import Grid
from sdhj.problem.interval import Interval
from sdhj.problem.sensing import Sensing
from sdhj.problem.sets import ANYWHERE, TargetSet, UnsafeSet
from sdhj.problem.steepness import growth_bound, lipschitz_bounds

ENDLESS_STEPS = 100  # that are counted where a problem has no number of steps
FOREVER = 1000  # steps at most for a problem without a number of steps
LAYOUT = ("lower", "upper", "shape", "periodic", "names", "ends")  # of a grid, as it stands in a file


@dataclass(frozen=True)
class Statement(Remembering):
    """The fields of a `sdhj.ReachAvoidProblem`, which says what they are, and what follows from them.

    It is the base of `Sampled` and `ReachAvoidProblem`; nothing is checked here. What is said to be made once is kept
    with the object.

    Attributes
    ----------
    dynamics : VectorField
        As `Dynamics.read` made it.
    target : TargetSet
        `ANYWHERE`, the same object, where there is no target.
    steps : int or None
        N; None for a problem without a number of steps.
    _intervals : dict
        {step: the Interval that `interval` has made}; under 0 for all steps where the dynamics do not depend on time.
    _static : dict
        {(level-set function, sampling, grid): samples} of sets that do not move, filled by `Sampled`.
    """

    grid: Grid
    dynamics: VectorField
    target: TargetSet
    unsafe: tuple[UnsafeSet, ...]
    delta: float
    steps: int | Any
    view_time: str = "swept"
    name: str = "problem"
    recipe: Mapping[str, Any] = field(default_factory=dict)
    sensing: Sensing = field(default_factory=Sensing)
    _intervals: dict[int, Interval] = field(default_factory=dict, init=False, repr=False, compare=False)
    _static: dict[Any, FloatArray] = field(default_factory=dict, init=False, repr=False, compare=False)

    @property
    def most_steps(self) -> int:
        """N, the number of steps; `FOREVER`, the most that are solved, for a problem without a number of steps."""
        return self.steps or FOREVER

    @property
    def has_no_target(self) -> bool:
        """Whether the task is only to stay clear of the unsafe sets, for all steps."""
        return self.target is ANYWHERE

    @property
    def all_sets(self) -> tuple[TargetSet | UnsafeSet, ...]:
        """The target, where there is one, and then the unsafe sets."""
        return *(() if self.has_no_target else (self.target,)), *self.unsafe

    @property
    def inputs(self) -> FloatArray:
        """The inputs u_j that the robot can choose from, (L, m), one in each row, as they were given to `Dynamics`.

        Read-only.
        """
        return self.dynamics.inputs

    def time(self, step: int) -> float:
        """Time at which the input of step k takes effect, in s: k delta, plus the delay if there is a `Sensing`.

        Parameters
        ----------
        step : float
            k, from 0 to N; parts of a step count.

        Examples
        --------
        With the robot on a line of `help(sdhj)`:

        >>> problem.time(2)
        1.0
        """
        return step * self.delta + self.sensing.delay

    def span(self, step: int) -> tuple[float, float]:
        """Earliest begin and latest end, s, of the time in which the input of step k is held: time(k) - jitter, time(k
        + 1) + jitter.
        """
        return self.time(step) - self.sensing.jitter, self.time(step + 1) + self.sensing.jitter

    @kept
    def half_widths(self) -> tuple[FloatArray, FloatArray]:
        """Half-widths of E, the box around a prediction that holds the state, and by how much reachable boxes are
        widened.

        (ndim,) each, in the units of the axes; both 0 without a `Sensing`; read-only, made once. E = w(delay) of dw/dt
        = A w + b + jumps, w(0) = error (`steepness.lipschitz_bounds`, `growth_bound`). Boxes of reachable states are
        widened so that they hold the next prediction too: by E + w(h), where dw/dt = A w + jumps, w(0) = E, and h is
        the longest hold (`Sensing.hold`). With memory they are widened so that they hold the next point that the
        controller carries on: by `error_growth` - b h.

        ValueError where black boxes declare too little for A and b.
        """
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
        """By how much the error of a point grows while an input is held, in the units of the axes: (ndim,).

        w(h) - E, where dw/dt = A w + b + jumps, w(0) = E (`steepness.lipschitz_bounds`, `growth_bound`), and h = delta
        + 2 jitter is the longest hold. A state within E of a point c is then within E + this of where c is led under
        the same input without a disturbance. Read-only, made once. ValueError where black boxes declare too little for
        A and b, or a velocity may be undefined.
        """
        slope, push, jumps = lipschitz_bounds(self.grid, self.dynamics, self.time(self.most_steps), self.delta)
        box = growth_bound(
            slope, push + jumps, np.zeros(self.grid.ndim) + np.array(self.sensing.error), self.sensing.delay
        )
        return growth_bound(slope, push + jumps, box, self.sensing.hold(self.delta)[0]) - box

    def interval(self, step: int) -> Interval:
        """The motion from step k to k + 1, for the time in which an input may be held; made once.

        One object for all steps if the dynamics do not depend on time; then `step` is ignored. Its boxes are widened by
        half_widths[1]. step : k >= 0, also beyond N. ValueError where `half_widths` raises it.
        """
        step = step if self.dynamics.depends_on_time else 0
        if step not in self._intervals:
            lasts = self.sensing.hold(self.delta)
            self._intervals[step] = Interval(self.grid, self.dynamics, self.span(step)[0], *lasts, self.half_widths[1])
        return self._intervals[step]

    def moves(self, unsafe_set: UnsafeSet) -> bool:
        """Whether the avoid tubes of an unsafe set differ from step to step: the set moves, or the dynamics depend on
        time.
        """
        return unsafe_set.moving or self.dynamics.depends_on_time

    def avoid_axes(self, unsafe_set: UnsafeSet) -> tuple[int, ...]:
        """The axes on which the avoid game of an unsafe set is solved, ascending.

        They are the set's axes, axes with safe ends, because a state that has left through one can no longer collide,
        and all that the velocities along these depend on.
        """
        safe = np.isfinite(self.grid.faces("frees")).any(axis=0)
        return self.interval(0).self_contained({*unsafe_set.axes, *np.flatnonzero(safe).tolist()})

    @cached_property
    def time_invariant(self) -> bool:
        """Whether nothing depends on time: neither the dynamics nor the target nor an unsafe set; made once."""
        return not (
            self.dynamics.depends_on_time or self.target.moving or any(unsafe_set.moving for unsafe_set in self.unsafe)
        )

    @property
    def opaque(self) -> dict[str, str]:
        """{name in `functions`: words on what its author declares} for each function that is a black box."""
        boxes = {name: part for name, part in self.functions.items() if isinstance(part, BlackBox)}
        fields = ("reads", "slope", "rate", "enclosure")
        known = {n: ", ".join(one for one in fields if getattr(part, one) is not None) for n, part in boxes.items()}
        return {n: f"a BlackBox {f'with {one}' if one else 'of which nothing is declared'}" for n, one in known.items()}

    def black_box(self, name: str) -> BlackBox:
        """The black box of that name in `functions`; AssertionError if it is a formula, KeyError if there is none."""
        found = self.functions[name]
        assert isinstance(found, BlackBox)
        return found

    @property
    def functions(self) -> "dict[str, Formula | BlackBox]":
        """All functions of the problem that there are, by the names that files give them.

        "drift" and "gain", or "velocity" where v does not enter linearly; "bounds", "target", and for each unsafe set i
        "unsafe i" and "swept i".
        """
        dynamics = self.dynamics
        named = {"drift" if dynamics.gain is not None else "velocity": dynamics.drift, "gain": dynamics.gain}
        named |= {"bounds": dynamics.bounds, "target": None if self.has_no_target else self.target.level_set}
        for i, part in enumerate(self.unsafe):
            named |= {f"unsafe {i}": part.level_set, f"swept {i}": part.swept}
        return {name: part for name, part in named.items() if part is not None}

    @property
    def texts(self) -> "tuple[dict[str, list[str]], list[Lookup]]":
        """{name in `functions`: lines of text} for each formula, and the list of the tables that formulas look up.

        The lines refer to tables by their position in the list (`sdhj.formulas.text.written`). Made anew each time.
        """
        tables: list[Lookup] = []
        found = {n: written(one.outputs, tables) for n, one in self.functions.items() if isinstance(one, Formula)}
        return found, tables

    @property
    def numbers(self) -> dict[str, Any]:
        """Everything that a table depends on beside functions, as plain numbers, lists and text for the head of a file.

        Keys: delta, steps, view_time, grid, inputs, sensing and sets, the target, if there is one, before the unsafe
        sets.
        """
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
