"""The robust motion planning problem of Sec. 2 and 3, as data.

All code that solves a problem or uses its table (kernels, games, recursion, controller) sees the robot only through the
arrays that a `ReachAvoidProblem` samples on its grid: `statement` has its fields and what follows from them, `sampled`
the level-set functions at nodes and states, `consistency` what is checked when one is made.
"""

import json
import reprlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from sdhj.formulas.graph import MOST_TABLES
from sdhj.kernels import Sealed
from sdhj.problem.checks import number, option, whole
from sdhj.problem.consistency import (
    check_inputs,
    check_sensing,
    check_swept,
    compare_set,
    compared_states,
    compared_times,
    try_goals,
)
from sdhj.problem.describing import arrays_of, described, digest_of
from sdhj.problem.dynamics import Dynamics, VectorField
from sdhj.problem.grid import Grid
from sdhj.problem.sampled import Sampled
from sdhj.problem.sensing import Sensing
from sdhj.problem.sets import ANYWHERE, VIEW_TIMES, TargetSet, UnsafeSet

MOST_SAMPLED = 1_000_000  # steps of a problem
MOST_DELTA = 1e15  # s


@dataclass(frozen=True)
class ReachAvoidProblem(Sampled):
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
        target eventually or to stay safe for ever, by method "certified"; nothing may then depend on time. The table's
        problem has the number.
        Where anything depends on time there are N (N + 1) / 2 tubes instead of N.
    view_time : {"swept", "sampled", "instantaneous"}
        How a moving unsafe set enters the game of one interval (Sec. 5.4): as a static set that contains it at all
        times (safe), as the union of 20 samples, as in the paper (not safe), or as it is at each time.
    name : str
        One line of text, for messages and files.
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
        """Read the functions, and check that all parts fit one another (`sdhj.problem.consistency`).

        Fields are replaced by what is made of them: dynamics by a `VectorField`, a target of None by `ANYWHERE`,
        numbers by float and int. Functions are called at some states and times, and the target and unsafe sets are
        sampled at nodes. ValueError where something does not fit, NotTraced where a function cannot be read.
        """
        self._check_parts()
        option("view_time", self.view_time, VIEW_TIMES)
        object.__setattr__(self, "delta", number("delta", self.delta, above=0.0, most=MOST_DELTA))
        if self.steps is not None:
            object.__setattr__(self, "steps", whole("steps", self.steps, least=1, most=MOST_SAMPLED))
        ndim = self.grid.ndim
        if isinstance(given := self.dynamics, Dynamics):
            object.__setattr__(self, "dynamics", given.read(ndim))
            given.compare(self.dynamics, compared_states(self.grid), compared_times(self))
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
        check_inputs(self)
        if self.steps is None and not self.time_invariant:
            raise ValueError(
                "steps=None solves until nothing changes from step to step, but the dynamics, an unsafe set or the "
                "target depend on time; give a number of steps"
            )
        for part in parts:
            compare_set(self, part)
        for j, step in product(
            range(len(self.inputs)), range((self.steps or 0) + 1) if self.dynamics.depends_on_time else [0]
        ):
            self.dynamics.bounds_at(j, self.time(step))
        for part in self.unsafe:
            corner = np.array([[self.grid.lower[axis] for axis in part.axes]])
            between = "swept" if self.view_time == "instantaneous" else self.view_time  # as games sweep time steps
            part.over(corner, 0.0, self.delta, between)  # refuses a black box of which too little is known
            if part.moving and part.swept is not None and self.view_time == "swept":
                check_swept(self, part)
        try_goals(self)
        if self.sensing:
            check_sensing(self)

    def _check_parts(self) -> None:
        """Check the types of the fields but delta, steps and view_time, and that there is a target or a danger.

        In place, a target of None becomes `ANYWHERE`, the unsafe sets a tuple, and the recipe read-only. ValueError
        where a type is wrong, where there is neither a target, an unsafe set nor an unsafe end, and for a target with
        "safe" ends.
        """
        if not (isinstance(self.name, str) and self.name.isprintable()):
            raise ValueError(f"name must be text in one line, without control characters, got {self.name!r}")
        try:
            json.dumps(dict(self.recipe), allow_nan=False)
            object.__setattr__(self, "recipe", Sealed(self.recipe))
        except (TypeError, ValueError) as error:
            raise ValueError(f"recipe must be a mapping that can be written as JSON, or left out: {error}") from None
        target: Any = self.target
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
        """Whether the other is a problem with the same `digest`, as a copy of this one is."""
        return self is other or (isinstance(other, ReachAvoidProblem) and self.digest == other.digest)

    def __hash__(self) -> int:
        """Of the `digest`."""
        return hash(self.digest)

    @cached_property
    def digest(self) -> str:
        """SHA-256, hexadecimal, of everything that a table depends on, and of all names (`digest_of`).

        Made once, black boxes being called.
        """
        return digest_of(described(self), arrays_of(self))
