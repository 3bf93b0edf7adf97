"""Methods: how the sets of Theorem 2 are represented and computed, as objects that hold their options.

A method has a name and `sets(problem, progress)`, which returns what `sdhj.recursion.recursion` fills; a method of your
own is an object with these two, given to `solve` in place of one from here.
"""

import importlib
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol

from tqdm import tqdm

from sdhj.checks import option
from sdhj.compiling import announced, hidden
from sdhj.games import HJIGames, HopfLaxGames, JointGames
from sdhj.hopf_lax import INTERPOLATIONS
from sdhj.problem import ReachAvoidProblem
from sdhj.recursion import GridSets, Sets, recursion
from sdhj.schemes import DTYPES, Scheme
from sdhj.table import Table


class Method(Protocol):
    """What `solve` needs of a method."""

    @property
    def name(self) -> str: ...

    def sets(self, problem: ReachAvoidProblem, progress: bool | None = None) -> Sets: ...


@dataclass(frozen=True)
class HJI:
    """Finite differences for the Hamilton-Jacobi-Isaacs equations of each interval, on the whole grid.

    Parameters
    ----------
    scheme : Scheme
        How the equations are discretised.
    games : {"decomposed", "joint"}
        Reach and avoid apart (App. A.3), or the one PDE of Prop. 1.
    """

    scheme: Scheme = field(default_factory=Scheme)
    games: str = "decomposed"
    name: ClassVar[str] = "hji"

    def __post_init__(self) -> None:
        option("games", self.games, ("decomposed", "joint"))
        if not isinstance(self.scheme, Scheme):
            raise ValueError(f"scheme must be a sdhj.Scheme, for example Scheme(order=3), got {self.scheme!r}")

    @property
    def told(self) -> dict[str, Any]:
        """The options, for a table's details."""
        return {"games": self.games} | vars(self.scheme)

    def on(self, problem: ReachAvoidProblem, axes: Sequence[int] | None = None) -> HJIGames:
        """The games on some axes of a problem, by default all."""
        return (JointGames if self.games == "joint" else HJIGames)(problem, self.scheme, axes)

    def sets(self, problem: ReachAvoidProblem, progress: bool | None = None) -> GridSets:
        return GridSets(problem, self.name, self.on, self.scheme.dtype, self.told)


@dataclass(frozen=True)
class HopfLax:
    """The Hopf-Lax formula (`sdhj.hopf_lax`), where the velocity set does not depend on the state.

    Parameters
    ----------
    interpolation : {"limited", "linear"}
        What a function is between nodes.
    dtype : {"float32", "float64"}
    """

    interpolation: str = "limited"
    dtype: str = "float32"
    name: ClassVar[str] = "lax"

    def __post_init__(self) -> None:
        option("interpolation", self.interpolation, INTERPOLATIONS)
        option("dtype", self.dtype, DTYPES)

    @property
    def told(self) -> dict[str, Any]:
        """The options, for a table's details."""
        return {"interpolation": self.interpolation, "dtype": self.dtype}

    def on(self, problem: ReachAvoidProblem, axes: Sequence[int] | None = None) -> HopfLaxGames:
        """The games on some axes of a problem, by default all."""
        return HopfLaxGames(problem, self.interpolation, self.dtype, axes)

    def sets(self, problem: ReachAvoidProblem, progress: bool | None = None) -> GridSets:
        return GridSets(problem, self.name, self.on, self.dtype, self.told)


METHODS: dict[str, Any] = {  # by their short forms; named are those that are imported when they are asked for
    "hji": HJI,
    "lax": HopfLax,
    "projected": "sdhj.projections:Projected",
    "certified": "sdhj.certified:Certified",
}


def method_of(method: str | Method) -> Method:
    """The method that a short form stands for; a method itself is returned.

    Raises
    ------
    ValueError
        Where it is neither.
    """
    from sdhj.files import imported

    if isinstance(method, str) and method in METHODS:
        made = METHODS[method]
        return (imported(made) if isinstance(made, str) else made)()
    if isinstance(method, str | type) or not callable(getattr(method, "sets", None)) or not hasattr(method, "name"):
        raise ValueError(
            f"method must be one of {', '.join(METHODS)}, or an object such as sdhj.HJI(scheme=...), got {method!r}"
        )
    return method


def solve(
    problem: ReachAvoidProblem,
    method: str | Method = "hji",
    *,
    progress: bool | None = None,
    store: str | os.PathLike[str] | None = None,
    resume: bool = False,
    client: Any = None,
    memory: int | None = None,
) -> Table:
    """Compute every S_k^i and the inputs that are guaranteed to make progress there (Algorithm 1).

    Parameters
    ----------
    problem : ReachAvoidProblem
    method : Method, or "hji", "projected", "lax" or "certified" for one with its usual options
        `sdhj.HJI`: finite differences on the whole grid; `sdhj.Projected`: on lower-dimensional subspaces (Sec. 5.1);
        `sdhj.HopfLax`: the Hopf-Lax formula; `sdhj.Certified`: cells with a proof.
    progress : bool, optional
        Show a progress bar; by default where standard error is a terminal.
    store : path, optional
        A folder, as "table.zarr", in which the table is made slab by slab, for tables larger than memory (extra
        `outofcore`). Methods "hji" and "lax"; tubes are equal to the last bit to those made in memory.
    resume : bool
        Go on with a store that an earlier solve of the same problem left unfinished, or begin where there is none.
    client : distributed.Client, optional
        Whose workers solve the slabs, for a store that all of them see under its path (extra `dask`).
    memory : int, optional
        Bytes that a slab may take, by default half of what is available: the grid is cut into slabs that take less.

    Returns
    -------
    LookupTable, StoredTable where there is a store, or CertifiedTable for a certified method

    Raises
    ------
    ValueError
        For an unknown option, or a method that does not fit the problem or a store.
    MemoryError
        Where less memory is available than is needed; before anything is solved.
    OSError, TableFileError
        Where a store cannot be written, is there already, belongs to another problem or is damaged.
    """
    if not isinstance(problem, ReachAvoidProblem):
        raise ValueError(f"problem must be a ReachAvoidProblem, got {problem!r}")
    if store is not None:
        solve_stored: Any = importlib.import_module("sdhj.outofcore").solve_stored
        stored: Table = solve_stored(problem, method, store, progress, resume, client, memory)
        return stored
    if resume or client is not None or memory is not None:
        raise ValueError("resume, client and memory are for a store; give one, as store='table.zarr'")
    method, started = method_of(method), time.perf_counter()
    with announced(progress):
        sets, steps = method.sets(problem, progress), problem.most_steps
        total = None if problem.steps is None else steps if sets.timeless else steps * (steps + 1) // 2
        with tqdm(total=total, desc=method.name, unit="tube", disable=hidden(progress)) as bar:
            recursion(sets, steps, bar.update)
        return sets.finish({"seconds": time.perf_counter() - started})
