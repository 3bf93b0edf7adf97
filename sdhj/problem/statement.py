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
from sdhj.problem.steepness import growth_bound, rates

FOREVER = 1000  # steps at most for a problem without a number of steps
LAYOUT = ("lower", "upper", "shape", "periodic", "names", "ends")  # of a grid, as it stands in a file


@dataclass(frozen=True)
class Statement(Remembering):
    """The fields of a `sdhj.ReachAvoidProblem`, which says what they are, and what follows from them; nothing is
    checked here.
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
        """N; for a problem without a number of steps `FOREVER`, the most that are solved."""
        return self.steps or FOREVER

    @property
    def has_no_target(self) -> bool:
        """Whether there is no target, so that the task is only to stay clear of the unsafe sets."""
        return self.target is ANYWHERE

    @property
    def all_sets(self) -> tuple[TargetSet | UnsafeSet, ...]:
        """The target, where there is one, and then the unsafe sets."""
        return *(() if self.has_no_target else (self.target,)), *self.unsafe

    @property
    def inputs(self) -> FloatArray:
        """The inputs u_j that the robot can choose from, (L, m): one in each row, as they were given to `Dynamics`."""
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
        """Earliest begin and latest end of the time in which the input of step k is held, s: `time(k)` less the jitter,
        `time(k + 1)` plus it.
        """
        return self.time(step) - self.sensing.jitter, self.time(step + 1) + self.sensing.jitter

    @kept
    def half_widths(self) -> tuple[FloatArray, FloatArray]:
        """Half-widths of E, the box around a prediction that holds the state, and by how much reachable boxes are
        widened to hold the next prediction; both (ndim,).

        E is the solution w of dw/dt = A w + b with w(0) = error, a delay later (`growth_bound`). With memory, boxes are
        widened to hold the next point that is carried on: by the growth of E, less what the push b does alone. Both 0
        without a `Sensing`; ValueError where black boxes declare too little for A and b.
        """
        sensing, nothing = self.sensing, np.zeros(self.grid.ndim)
        if not sensing:
            return nothing, nothing
        slope, push, jumps = rates(self.grid, self.dynamics, self.time(self.most_steps), self.delta)
        box = growth_bound(slope, push + jumps, nothing + np.array(sensing.error), sensing.delay)
        if sensing.remembers:
            return box, self.error_growth - push * sensing.hold(self.delta)[0]
        return box, box + growth_bound(slope, jumps, box, self.delta + 2 * sensing.jitter)

    @kept
    def error_growth(self) -> FloatArray:
        """By how much the error of a point grows in an interval, (ndim,): w(interval) - E, where dw/dt = A w + b and
        w(0) = E.

        The state, within E of a point c, is within E and that of where c is led under the same input, without a
        disturbance.
        """
        slope, push, jumps = rates(self.grid, self.dynamics, self.time(self.most_steps), self.delta)
        box = growth_bound(
            slope, push + jumps, np.zeros(self.grid.ndim) + np.array(self.sensing.error), self.sensing.delay
        )
        return growth_bound(slope, push + jumps, box, self.sensing.hold(self.delta)[0]) - box

    def interval(self, step: int) -> Interval:
        """The motion from step k to k + 1; one object for all steps if the dynamics do not depend on time. Made once
        and kept.
        """
        step = step if self.dynamics.timed else 0
        if step not in self._intervals:
            lasts = self.sensing.hold(self.delta)
            self._intervals[step] = Interval(self.grid, self.dynamics, self.span(step)[0], *lasts, self.half_widths[1])
        return self._intervals[step]

    def moves(self, unsafe_set: UnsafeSet) -> bool:
        """Whether the avoid tubes of an unsafe set differ from step to step: it moves, or the dynamics depend on
        time.
        """
        return unsafe_set.moving or self.dynamics.timed

    def avoid_axes(self, unsafe_set: UnsafeSet) -> tuple[int, ...]:
        """The axes on which the avoid game of an unsafe set is solved, ascending: the set's, and those their velocities
        depend on.

        Also those with safe ends, because a state that has left through one can no longer collide.
        """
        safe = np.isfinite(self.grid.faces("frees")).any(axis=0)
        return self.interval(0).self_contained({*unsafe_set.axes, *np.flatnonzero(safe).tolist()})

    @cached_property
    def time_invariant(self) -> bool:
        """Whether nothing depends on time: not the dynamics, the target or an unsafe set."""
        return not (self.dynamics.timed or self.target.moving or any(unsafe_set.moving for unsafe_set in self.unsafe))

    @property
    def opaque(self) -> dict[str, str]:
        """Of each function that is a black box, by its name in `functions`, a phrase: what its author declares of
        it.
        """
        boxes = {name: part for name, part in self.functions.items() if isinstance(part, BlackBox)}
        fields = ("reads", "slope", "rate", "enclosure")
        known = {n: ", ".join(one for one in fields if getattr(part, one) is not None) for n, part in boxes.items()}
        return {n: f"a BlackBox {f'with {one}' if one else 'of which nothing is declared'}" for n, one in known.items()}

    def black_box(self, name: str) -> BlackBox:
        """The black box of that name in `functions`; AssertionError if that is a formula."""
        found = self.functions[name]
        assert isinstance(found, BlackBox)
        return found

    @property
    def functions(self) -> "dict[str, Formula | BlackBox]":
        """All functions of the problem, by the names that files give them: "drift" and "gain", or "velocity"; "bounds",
        "target", "unsafe 0", "swept 0", ...
        """
        dynamics = self.dynamics
        named = {"drift" if dynamics.gain is not None else "velocity": dynamics.drift, "gain": dynamics.gain}
        named |= {"bounds": dynamics.bounds, "target": None if self.has_no_target else self.target.level_set}
        for i, part in enumerate(self.unsafe):
            named |= {f"unsafe {i}": part.level_set, f"swept {i}": part.swept}
        return {name: part for name, part in named.items() if part is not None}

    @property
    def texts(self) -> "tuple[dict[str, list[str]], list[Lookup]]":
        """The formulas as lines of text, by their names in `functions`, and a list of the tables that they look up, to
        whose places the lines refer.
        """
        tables: list[Lookup] = []
        found = {n: written(one.outputs, tables) for n, one in self.functions.items() if isinstance(one, Formula)}
        return found, tables

    @property
    def numbers(self) -> dict[str, Any]:
        """Everything that a table depends on beside functions, plain numbers, lists and text, as it stands in the
        head of a file: delta, steps, view_time, grid, inputs, sensing and sets.
        """
        sets: list[dict[str, Any]] = [
            {"name": p.name, "kind": "unsafe", "axes": list(p.axes), "sampling": p.sampling}
            | ({} if p.inputs is None else {"inputs": list(p.inputs)})
            for p in self.unsafe
        ]
        target = (
            [] if self.has_no_target else [{"name": self.target.name, "kind": "target", "axes": list(self.target.axes)}]
        )
        return {
            "delta": self.delta,
            "steps": self.steps,
            "view_time": self.view_time,
            "grid": {name: getattr(self.grid, name) for name in LAYOUT},
            "inputs": self.inputs.tolist(),
            "sensing": self.sensing.told,
            "sets": target + sets,
        }
