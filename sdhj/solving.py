"""`solve` and `load`: above all rooms, as they know every method."""

import os
import reprlib
import time
from dataclasses import replace
from typing import Any, cast

from tqdm import tqdm

from sdhj.arm.case_studies import problem_of_file
from sdhj.certified.sets import Certified
from sdhj.certified.table import CertifiedTable
from sdhj.kernels.compiling import announced, hidden
from sdhj.problem.problem import ReachAvoidProblem, alike
from sdhj.simulation.played import judged_at_the_end, played
from sdhj.solver.methods import METHODS, Method, method_of
from sdhj.solver.projections import Projected
from sdhj.solver.recursion import Sets, recursion
from sdhj.table.batches import PLAYER, Table
from sdhj.table.files import TableFileError, opened, stored, what_differs
from sdhj.table.table import LookupTable

PLAYER.append(played)
METHODS.update(projected=Projected, certified=Certified)


def solve(
    problem: ReachAvoidProblem,
    method: str | Method = "hji",
    *,
    progress: bool | None = None,
    store: str | os.PathLike[str] | None = None,
    resume: bool = False,
    client: Any = None,
    memory: int | None = None,
    play: bool = True,
) -> Table:
    """Compute every S_k^i and the inputs that are guaranteed to make progress there (Algorithm 1).

    Parameters
    ----------
    problem : ReachAvoidProblem
    method : Method, or "hji", "projected", "lax" or "certified" for one with its usual options
        See `sdhj.HJI`, `sdhj.Projected` (Sec. 5.1), `sdhj.HopfLax` and `sdhj.Certified`.
    progress : bool, optional
        Show a progress bar; by default where standard error is a terminal. Without a number of steps it tells how many
        states still change, and Ctrl-C ends the solve with the table so far.
    store : path, optional
        A folder, as "table.zarr", in which the table is made slab by slab, for tables larger than memory (extra
        `outofcore`). Methods "hji" and "lax"; tubes are equal to the last bit to those made in memory.
    resume : bool
        Go on with a store that an earlier solve of the same problem left unfinished, or begin where there is none.
    client : distributed.Client, optional
        Whose workers solve the slabs, for a store that all of them see under its path (extra `dask`).
    memory : int, optional
        Bytes that a slab may take, by default half of what is available: the grid is cut into slabs that take less.
    play : bool
        Whether some runs are played at the end (not with a store), for a warning and `table.details["played"]`.

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
        from sdhj.outofcore import solve_stored

        return solve_stored(problem, method, store, progress, resume, client, memory)
    if resume or client is not None or memory is not None:
        raise ValueError("resume, client and memory are for a store; give one, as store='table.zarr'")
    method, started = method_of(method), time.perf_counter()
    with announced(progress):
        sets = _filled(problem, method, progress)
        table = sets.finish({"seconds": time.perf_counter() - started})
        played = judged_at_the_end(table, stacklevel=2) if play else {}
        return replace(cast(Any, table), details=dict(table.details) | played) if played else table


def _filled(problem: ReachAvoidProblem, method: Method, progress: bool | None) -> Sets:
    """All sets of the recursion, or where the problem gives no number of steps those before Ctrl-C."""
    sets, steps, endless = cast(Any, method.sets(problem, progress)), problem.most_steps, problem.steps is None
    total = None if endless else steps if sets.timeless else steps * (steps + 1) // 2
    with tqdm(total=total, desc=method.name, unit="tube", disable=hidden(progress)) as bar:

        def done() -> None:
            bar.update()
            if endless:
                bar.set_postfix_str(f"{sets.changing:.2%} of the states change", refresh=False)

        try:
            recursion(sets, steps, done)
        except KeyboardInterrupt:
            if not endless or not sets.filled:
                raise
    return cast(Sets, sets)


def load(path: str | os.PathLike[str], *, problem: ReachAvoidProblem | None = None) -> "Table":
    """Read a table of any method that its `save` wrote.

    Parameters
    ----------
    path : path
    problem : ReachAvoidProblem, optional
        The problem the table was solved for. The case studies are rebuilt from the file; your own problem holds
        functions that no file can hold, so give it here. Its numbers must be those that the table was solved with, to
        the rounding of another machine (`identity` in `sdhj.problem.problem`), and so must its recipe, where both have
        one. Where it gives no number of steps, it is taken with as many as the file says that it took.

    Raises
    ------
    OSError
        Where there is no such file, or it may not be read, or is a folder or a device.
    MemoryError
        Where the table does not fit into what is available.
    TableFileError
        Where the file is damaged, cut short, of another kind or of another version, or the problem is not the one it
        was solved for.
    ValueError
        Where `path` or `problem` is something else.
    """
    if not isinstance(problem, ReachAvoidProblem | None):
        raise ValueError(f"problem must be a ReachAvoidProblem, got {reprlib.repr(problem)}")
    if isinstance(path, str | os.PathLike) and os.path.isfile(os.path.join(path, "zarr.json")):
        from sdhj.outofcore import load_stored

        return load_stored(path, problem)
    with opened(path) as (head, file):
        replaced = "" if problem else "; if parts of it were replaced, give it as load(path, problem=...)"
        problem = problem_of_file(path, head, problem)
        if problem.steps is None and head["details"].get("endless"):
            problem = replace(problem, steps=head["steps"])  # as many as it took
        sums = problem.identity[1]
        if problem.digest != head["digest"] and (
            other := what_differs(
                head, problem, lambda: alike(stored(file, "samples", "float64", (None, sums.shape[1])), sums)
            )
        ):
            raise TableFileError(
                f"{path} was solved for another problem: its digest is {head['digest'][:12]}..., that of "
                f"{problem.name!r} is {problem.digest[:12]}...; {other}{replaced}"
            )
        kind = CertifiedTable if head["method"] == "certified" else LookupTable
        return kind.read(head, file, problem)
