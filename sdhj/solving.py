"""`solve` and `load`, in the top layer of the package because they depend on every method."""

import os
import reprlib
import time
import warnings
from dataclasses import replace
from typing import Any, cast

from tqdm import tqdm

from sdhj.certified.explaining import scanty
from sdhj.certified.sets import Certified
from sdhj.certified.table import CertifiedTable
from sdhj.kernels.compiling import announced, hidden
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.simulation.played import judged_at_the_end, played
from sdhj.solver.methods import METHODS, Method, method_of
from sdhj.solver.projections import Projected
from sdhj.solver.recursion import GridSets, Sets, recursion
from sdhj.solver.resolution import ResolutionWarning, check_sets
from sdhj.table.batches import PLAYER, Table
from sdhj.table.files import arrays_in, opened, problem_of_file
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
    """Solve a problem: compute all tubes S_k^i and the inputs that are safe and make progress in them (Algorithm 1).

    Parameters
    ----------
    problem : ReachAvoidProblem
    method : {"hji", "projected", "lax", "certified"}, or Method
        A name stands for the default options of `sdhj.HJI`, `sdhj.Projected` (Sec. 5.1), `sdhj.HopfLax` or
        `sdhj.Certified`, in this order; pass an object of the class for other options.
    progress : bool, optional
        Whether to show a progress bar; by default if standard error is a terminal. For a problem without a number of
        steps it shows the share of states that still change, and Ctrl-C ends the solve and returns the table so far.
    store : path, optional
        A folder, for example "table.zarr", in which the table is built slab by slab, for tables larger than memory
        (extra `outofcore`; methods "hji" and "lax"). The tubes are bit-for-bit identical to an in-memory solve.
    resume : bool
        Continue a store that an earlier solve of the same problem left unfinished; start one if there is none.
    client : distributed.Client, optional
        A Dask client whose workers solve the slabs (extra `dask`). All of them must see the store under the same path.
    memory : int, optional
        Bytes of memory that one slab may use, by default half of what is available; it determines the size of slabs.
    play : bool
        Whether to simulate some runs at the end (not with a store), for `table.details["played"]` and a warning; of a
        certified table whether to warn where it has next to nothing.

    Returns
    -------
    LookupTable; StoredTable if there is a store; CertifiedTable for method "certified"

    Raises
    ------
    ValueError
        If an option is unknown, or the method does not fit the problem or the store.
    MemoryError
        If more memory is needed than is available; raised before anything is solved.
    OSError, TableFileError
        If the store cannot be written, exists already, belongs to another problem or is damaged.
    """
    if not isinstance(problem, ReachAvoidProblem):
        raise ValueError(f"problem must be a ReachAvoidProblem, got {problem!r}")
    if store is not None:
        from sdhj.outofcore import solve_stored

        return solve_stored(problem, method, store, progress, resume, client, memory)
    if resume or client is not None or memory is not None:
        raise ValueError("resume, client and memory apply to a store only; give one, for example store='table.zarr'")
    method, started = method_of(method), time.perf_counter()
    with announced(progress):
        sets = _filled(problem, method, progress)
        table = sets.finish({"seconds": time.perf_counter() - started})
        if play and isinstance(table, CertifiedTable) and (message := scanty(table)):
            warnings.warn(message, ResolutionWarning, stacklevel=2)
        played = judged_at_the_end(table, stacklevel=2) if play and not table.proved else {}
        return replace(cast(Any, table), details=dict(table.details) | played) if played else table


def _filled(problem: ReachAvoidProblem, method: Method, progress: bool | None) -> Sets:
    """All sets of the recursion; if the problem has no number of steps, those computed before Ctrl-C."""
    sets, steps, endless = cast(Any, method.sets(problem, progress)), problem.most_steps, problem.steps is None
    if not isinstance(sets, GridSets):
        check_sets(problem, stacklevel=3)
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
    """Read a table of any method: a file written by its `save`, or the folder of a store.

    Parameters
    ----------
    path : path
    problem : ReachAvoidProblem, optional
        The problem that the table was solved for. It is needed only if it has black boxes (`sdhj.BlackBox`), whose
        functions a file cannot contain. It must be the problem of the solve, up to the rounding of another machine. If
        it has no number of steps, it gets the number in the file.

    Raises
    ------
    OSError
        If there is no such file, if it cannot be read, or if it is a folder or a device.
    MemoryError
        If the table does not fit into the available memory.
    TableFileError
        If the file is damaged, cut short, of another kind or of another version, or was solved for another problem.
    ValueError
        If `path` or `problem` has the wrong type.
    """
    if not isinstance(problem, ReachAvoidProblem | None):
        raise ValueError(f"problem must be a ReachAvoidProblem, got {reprlib.repr(problem)}")
    if isinstance(path, str | os.PathLike) and os.path.isfile(os.path.join(path, "zarr.json")):
        from sdhj.outofcore import load_stored

        return load_stored(path, problem)
    with opened(path) as (head, file):
        problem = problem_of_file(path, head, arrays_in(file), problem)
        kind = CertifiedTable if head["method"] == "certified" else LookupTable
        return kind.read(head, file, problem)
