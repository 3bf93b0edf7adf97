"""`solve` and `load`, in the top layer of the package because they depend on every method."""

import os
import reprlib
import sys
import time
from dataclasses import replace
from typing import Any, cast

from tqdm import tqdm

from sdhj.certified.explaining import scanty_finding
from sdhj.certified.sets import Certified
from sdhj.certified.table import CertifiedTable
from sdhj.common.findings import Finding, findings, tell
from sdhj.common.showing import announced, hidden
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.simulation.played import check_by_runs, played
from sdhj.solver.entries import solve_stored
from sdhj.solver.findings import check_sets, suspicions
from sdhj.solver.methods import HJI, HopfLax, Method
from sdhj.solver.projections import Projected
from sdhj.solver.recursion import GridSets, recursion
from sdhj.table.batches import Table
from sdhj.table.files import opened_table, table_in
from sdhj.table.table import LookupTable

METHODS = {kind.name: kind for kind in (HJI, Projected, HopfLax, Certified)}  # by which `solve` knows them
SECONDS_FOR_EVER = 10.0  # of `Certified`, where no method is named and there is no number of steps
FOR_EVER = (
    f"steps=None: sdhj.Certified(seconds={SECONDS_FOR_EVER:g}) proves what holds for ever; its kernels are compiled at "
    "first use"
)


def method_of(method: str | Method) -> Method:
    """The method of a name, with default options; an object that is a method is returned as it is."""
    if isinstance(method, str) and method in METHODS:
        made: Method = METHODS[method]()
        return made
    # a class, as sdhj.HJI without its brackets, has a function `sets`, too
    if isinstance(method, str | type) or not callable(getattr(method, "sets", None)) or not hasattr(method, "name"):
        raise ValueError(
            f"method must be one of {', '.join(METHODS)}, or an object such as sdhj.HJI(scheme=...), got {method!r}"
        )
    return method


def default_method(problem: ReachAvoidProblem) -> Method:
    """`HJI` with a number of steps, else `Certified`."""
    return Certified(seconds=SECONDS_FOR_EVER) if problem.steps is None else HJI()


def solve(
    problem: ReachAvoidProblem,
    method: str | Method | None = None,
    *,
    progress: bool | None = None,
    store: str | os.PathLike[str] | None = None,
    resume: bool = False,
    client: Any = None,
    play: bool = True,
) -> Table:
    """Solve a problem: compute all tubes S_k^i and the inputs that are safe and make progress in them (Algorithm 1).

    Parameters
    ----------
    problem : ReachAvoidProblem
    method : {"hji", "projected", "lax", "certified"}, or Method, optional
        A name stands for `sdhj.HJI()`, `sdhj.Projected()` (Sec. 5.1), `sdhj.HopfLax()` or `sdhj.Certified()`. By
        default "hji" or, without a number of steps, `sdhj.Certified(seconds=10)`: what holds for ever needs a proof.
    progress : bool, optional
        By default if standard error is a terminal. Without a number of steps the bar shows the share of states that
        still change, and Ctrl-C returns the table so far.
    store : path, optional
        A folder in which the table is built entry by entry, for those larger than memory, which has to hold some 17
        tubes. Not for the method "certified" and for `sdhj.solver.joint.Joint`.
    resume : bool
        Go on in a folder that an earlier solve left unfinished, if there is one.
    client : distributed.Client, optional
        Of Dask (extra `dask`), whose workers solve the entries; all see the folder by one path.
    play : bool
        Whether to simulate some runs at the end (not with a store), for `table.details["played"]` and a warning; of a
        certified table whether to warn, by "hji" on few nodes, where it has next to nothing.

    Returns
    -------
    LookupTable; CertifiedTable for method "certified"
        `table.details["findings"]` (not with a store) has what is warned of: a cause, how much of it, and what helps.

    Raises
    ------
    ValueError
        If the method does not fit the problem or the store (only "certified" takes steps=None), or an input takes more
        than 100,000 time steps in one interval.
    MemoryError
        Before anything is solved, if more memory is needed than is available.
    RuntimeError
        If the checker does not prove a claim of a certified table: all of up to 200,000 are looked at, else some
        hundred thousand, as `table.details["checked"]` says.
    OSError, TableFileError
        If the store cannot be written, exists already, belongs to another problem or is damaged.

    Examples
    --------
    With the robot on a line of `help(sdhj)`:

    >>> round(sdhj.solve(problem).fraction(start=0, within=3), 3)
    0.537
    """
    if not isinstance(problem, ReachAvoidProblem):
        raise ValueError(f"problem must be a ReachAvoidProblem, got {problem!r}")
    if store is None and (resume or client is not None):
        raise ValueError("resume and client apply to a store only; give one, for example store='table'")
    chosen, started = default_method(problem) if method is None else method_of(method), time.perf_counter()
    if method is None and problem.steps is None and not hidden(progress):
        tqdm.write(FOR_EVER, file=sys.stderr)
    with announced(progress), findings() as found:
        tell(*suspicions(problem))
        no_store = f"a store does not take method {chosen.name!r}; leave store= out to solve in memory"
        if store is not None and isinstance(chosen, Certified):  # before it prepares, for as long as a solve may take
            raise ValueError(no_store)
        sets, steps = _checked_sets(problem, chosen, progress), problem.steps
        if store is not None and not (isinstance(sets, GridSets) and sets.storable):
            raise ValueError(no_store)
        tubes = steps if steps is None or problem.time_invariant else steps * (steps + 1) // 2
        with tqdm(desc=chosen.name, total=tubes, unit="tube", disable=hidden(progress)) as bar:
            if store is not None:
                solve_stored(sets, store, resume, client, bar.update)
            elif steps is None:
                _fill_until_settled(sets, problem.most_steps, bar)
            else:
                recursion(sets, steps, bar.update)
        if store is not None:  # it has just been written
            return load(store, problem=problem if problem.opaque else None, check=False)
        table = replace(sets.finish({"seconds": time.perf_counter() - started}), player=played)
        said: dict[str, Any] = {}
        if isinstance(table, CertifiedTable):
            said = {"checked": [*table.looked_over()], "seconds": time.perf_counter() - started}
        said |= _simulated_at_the_end(table) if play else {}
        # Without the class of the warning, which JSON does not write.
        said |= {"findings": [list(one[:3]) for one in found]} if found else {}
        return table.with_details(dict(table.details) | said) if said else table


def _simulated_at_the_end(table: Table) -> dict[str, Any]:
    """Counts of simulated runs of a solved table, with a warning of broken promises; {} without runs.

    Whatever the runs raise, Ctrl-C too, becomes a warning, so that the table is not lost.
    """
    try:
        if isinstance(table, CertifiedTable):
            tell(scanty_finding(table))
        return {} if table.proved else check_by_runs(table)
    except Warning:  # where the caller made warnings errors
        raise
    except (Exception, KeyboardInterrupt) as error:
        why = "they were interrupted" if isinstance(error, KeyboardInterrupt) else f"{type(error).__name__}: {error}"
        cause = f"the table is complete, but the runs that are simulated at the end of a solve did not finish: {why}. "
        tell(Finding(cause, 0.0, "With play=False they are left out"))
        return {}


def _checked_sets(problem: ReachAvoidProblem, method: Method, progress: bool | None) -> Any:
    """The sets of a method, nothing of them solved, with warnings of what is wrong with unsafe sets and targets."""
    if certified := isinstance(method, Certified):  # whose sets take half the time of a solve
        check_sets(problem)
    sets = method.sets(problem, progress)
    if not (certified or isinstance(sets, GridSets)):  # sets on a grid check as they sample
        check_sets(problem)
    return sets


def _fill_until_settled(sets: Any, most: int, bar: Any) -> None:
    """Compute up to `most` tubes of a problem without a number of steps, or those before Ctrl-C, and move the bar."""

    def told() -> None:
        bar.update()
        bar.set_postfix_str(f"{sets.changing:.2%} of the states change", refresh=False)

    try:
        recursion(sets, most, told)
    except KeyboardInterrupt:
        if not sets.filled:
            raise


def load(
    path: str | os.PathLike[str], *, problem: ReachAvoidProblem | None = None, check: bool | None = None
) -> "Table":
    """Read a table of any method: a file that its `save` wrote, or a folder that it was solved into.

    Its arrays are read when they are asked for, unless they are compressed.

    Parameters
    ----------
    path : path
    problem : ReachAvoidProblem, optional
        That of the solve, up to the rounding of another machine; needed only if it has black boxes. If it has no number
        of steps, it gets the file's.
    check : bool, optional
        Whether to compare all arrays with their digests, by which damage is found; by default of a table of less than 1
        GB.

    Raises
    ------
    OSError
        If the file cannot be read.
    MemoryError
        If a compressed table does not fit.
    TableFileError
        If the file is damaged, of another kind or version, or was solved for another problem.
    ValueError
        If an argument has the wrong type.

    Examples
    --------
    With the robot on a line of `help(sdhj)`:

    >>> import tempfile, pathlib
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "line.npz"
    >>> table.save(path)
    >>> sdhj.load(path).contains([[-2.1]], start=0, within=3)
    array([ True])
    """
    if not isinstance(problem, ReachAvoidProblem | None):
        raise ValueError(f"problem must be a ReachAvoidProblem, got {reprlib.repr(problem)}")
    with opened_table(path, check) as (head, file):
        kind = CertifiedTable if head["method"] == "certified" else LookupTable
        return cast(Table, table_in(kind, path, head, file, problem, played))
