"""`solve` and `load`, in the top layer of the package because they depend on every method."""

import os
import reprlib
import sys
import time
from contextlib import suppress
from dataclasses import replace
from typing import Any, cast

from tqdm import tqdm

from sdhj.certified.explaining import scanty_finding
from sdhj.certified.sets import Certified
from sdhj.certified.table import CertifiedTable
from sdhj.kernels.compiling import announced, hidden
from sdhj.outofcore import solve_stored
from sdhj.problem.checks import number
from sdhj.problem.cost import MOST_OPERATIONS, Cost, Meter, Stated
from sdhj.problem.findings import Finding, findings, tell
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.suspected import suspicions
from sdhj.simulation.played import check_by_runs, played
from sdhj.solver.avoid import dangers
from sdhj.solver.former import Former
from sdhj.solver.methods import HJI, HopfLax, Method
from sdhj.solver.projections import Projected
from sdhj.solver.recursion import GridSets, TubeSets, recursion
from sdhj.solver.resolution import check_sets
from sdhj.table.batches import Table
from sdhj.table.files import opened_table, table_in
from sdhj.table.keeping import Kept
from sdhj.table.store import is_store, load_stored
from sdhj.table.table import LookupTable

METHODS = {kind.name: kind for kind in (HJI, Projected, HopfLax, Certified)}  # by which `solve` knows them
SECONDS_FOR_EVER = 10.0  # of `Certified`, where no method is named and there is no number of steps
FOR_EVER = (
    f"steps=None: sdhj.Certified(seconds={SECONDS_FOR_EVER:g}) proves what holds for ever; its kernels are compiled at "
    "first use"
)


def method_of(method: str | Method) -> Method:
    """The method of a name, with default options; an object that is a method is returned as it is.

    Raises
    ------
    ValueError
        If it is neither.
    """
    if isinstance(method, str) and method in METHODS:
        made: Method = METHODS[method]()
        return made
    if isinstance(method, str | type) or not callable(getattr(method, "sets", None)) or not hasattr(method, "name"):
        raise ValueError(
            f"method must be one of {', '.join(METHODS)}, or an object such as sdhj.HJI(scheme=...), got {method!r}"
        )
    return method


def default_method(problem: ReachAvoidProblem) -> Method:
    """The method of a problem for which none is named: `HJI` with a number of steps, else `Certified`."""
    return Certified(seconds=SECONDS_FOR_EVER) if problem.steps is None else HJI()


def solve(
    problem: ReachAvoidProblem,
    method: str | Method | None = None,
    *,
    progress: bool | None = None,
    store: str | os.PathLike[str] | None = None,
    resume: bool = False,
    client: Any = None,
    memory: int | None = None,
    play: bool = True,
    operations: float = MOST_OPERATIONS,
) -> Table:
    """Solve a problem: compute all tubes S_k^i and the inputs that are safe and make progress in them (Algorithm 1).

    Parameters
    ----------
    problem : ReachAvoidProblem
    method : {"hji", "projected", "lax", "certified"}, or Method, optional
        A name stands for the default options of `sdhj.HJI`, `sdhj.Projected` (Sec. 5.1), `sdhj.HopfLax` or
        `sdhj.Certified`, in this order; pass an object of the class for other options. By default "hji" or, for a
        problem without a number of steps, `sdhj.Certified(seconds=10)`: what holds for ever needs a proof.
    progress : bool, optional
        Whether to show a progress bar; by default if standard error is a terminal. It states the cost and counts the
        operations of `estimate`. For a problem without a number of steps it shows the share of states that still
        change, and Ctrl-C ends the solve and returns the table so far.
    store : path, optional
        A folder, for example "table", in which the table is built slab by slab, for tables larger than memory
        (methods "hji" and "lax"). The tubes are bit-for-bit identical to an in-memory solve.
    resume : bool
        Continue a store that an earlier solve of the same problem left unfinished; start one if there is none.
    client : distributed.Client, optional
        A Dask client whose workers solve the slabs (extra `dask`). All of them must see the store under the same path.
    memory : int, optional
        Bytes of memory that one slab may use, by default half of what is available; it determines the size of slabs.
    play : bool
        Whether to simulate some runs at the end (not with a store), for `table.details["played"]` and a warning;
        without a target half of them from within a cell of the tube's boundary, against a greedy adversary. Of a
        certified table whether to warn where it has next
        to nothing, and say why, for about the solve's time more, or a second or two. Whatever this meets (no start, an
        undefined function, Ctrl-C, too little memory) becomes a warning.
    operations : float
        What a solve may take at most, by the model of `estimate`, before it begins; by default some hours on two cores.

    Returns
    -------
    LookupTable; StoredTable if there is a store; CertifiedTable for method "certified"
        What is warned of on the way, also before the solve, is in `table.details["findings"]` (not with a store), each
        as a list of a cause, a number that says how much of it, and what helps.

    Raises
    ------
    ValueError
        If an option is unknown, the method does not fit the problem or the store (only "certified" takes steps=None),
        or the solve takes more `operations` than allowed; the message says what makes it so, for example the cells that
        the state crosses in an interval.
    MemoryError
        If more memory is needed than is available; raised before anything is solved.
    OSError, TableFileError
        If the store cannot be written, exists already, belongs to another problem or is damaged.

    Examples
    --------
    With the robot on a line of `help(sdhj)`:

    >>> round(sdhj.solve(problem).fraction(start=0, within=3), 3)
    0.537
    """
    _require_problem(problem)
    chosen = default_method(problem) if method is None else method_of(method)
    most = number("operations", operations, above=0.0)
    if store is not None:
        tell(*suspicions(problem))
        return solve_stored(problem, chosen, store, progress, resume, client, memory, most)
    if resume or client is not None or memory is not None:
        raise ValueError("resume, client and memory apply to a store only; give one, for example store='table'")
    started = time.perf_counter()
    if method is None and problem.steps is None and not hidden(progress):
        tqdm.write(FOR_EVER, file=sys.stderr)
    with announced(progress), findings() as found:
        tell(*suspicions(problem))
        sets = _filled(problem, chosen, progress, most)
        table = _prepared_for_users(sets.finish({"seconds": time.perf_counter() - started}), chosen)
        said = _simulated_at_the_end(table) if play else {}
        said |= {"findings": [list(one[:3]) for one in found]} if found else {}
        return table.with_details(dict(table.details) | said) if said else table


def resolve(
    table: Table,
    problem: ReachAvoidProblem,
    method: str | Method = "hji",
    *,
    progress: bool | None = False,
    operations: float = MOST_OPERATIONS,
) -> Table:
    """Solve a problem anew that is mostly the one of a table, as when a robot sees an obstacle elsewhere.

    The result is, bit for bit, that of `solve(problem, method, play=False)`: whatever could differ is computed, and the
    rest is taken from the table. What it is depends on what differs (`sdhj.solver.former`): avoid tubes of sets that
    are still the same, if grid, dynamics, bounds, inputs, interval and sensing are; and then those planes of the last
    two axes in which no tube that they follow from has changed. Nothing is taken by the methods "projected",
    "certified" and games="joint", and of tables that are of another method, are certified, stored or loaded, or came
    from another process; avoid tubes only with `Sensing` or safe ends of the grid; of black boxes never anything.
    Unsafe sets whose avoid tubes are taken are not warned of again for being in nobody's way, nor axes and a target
    for being unusual where all but the unsafe sets is as it was.

    Parameters
    ----------
    table : Table
        Of `solve` or `resolve`; it stays as it is. One of `resolve` has more to take from: it keeps also the solutions
        between the tubes, which take as much memory as these, and the avoid tubes of each set.
    problem : ReachAvoidProblem
        What is solved now.
    method : Method or {"hji", "lax", "projected", "certified"}
        The one that `table` is of, or nothing is taken.
    progress : bool, optional
        Whether to show a progress bar; by default where standard error is a terminal.
    operations : float
        More than so many are refused, as hours are usually meant to be a smaller grid.

    Returns
    -------
    LookupTable; CertifiedTable for method "certified"

    Raises
    ------
    ValueError
        If `table` is none, an option does not fit the problem, or it takes too many operations.
    MemoryError
        If there is not enough memory.

    Examples
    --------
    >>> import numpy as np
    >>> import sdhj
    >>> def seen_at(x):
    ...     steps = [[1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]
    ...     return sdhj.ReachAvoidProblem(
    ...         grid=sdhj.Grid([0.0, -1.0], [4.0, 1.0], [81, 41]),
    ...         dynamics=sdhj.Dynamics(inputs=steps, drift=steps, gain=np.eye(2), bounds=[0.1, 0.1]),
    ...         target=sdhj.TargetSet((0,), lambda p, t: 3.0 - p[:, 0]),
    ...         unsafe=[sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0] - x, p[:, 1]) - 0.3)],
    ...         delta=0.3,
    ...         steps=12,
    ...     )
    >>> table = sdhj.resolve(sdhj.solve(seen_at(1.0)), seen_at(1.5))
    >>> np.array_equal(table.tubes, sdhj.solve(seen_at(1.5)).tubes)
    True
    """
    if not isinstance(table, Table):
        raise ValueError(f"table must be what sdhj.solve or sdhj.resolve returns, got {reprlib.repr(table)}")
    _require_problem(problem)
    most, chosen, former = number("operations", operations, above=0.0), method_of(method), None
    if isinstance(table, LookupTable) and table.reusable is not None and isinstance(chosen, HJI | HopfLax):
        former = Former(table, problem, chosen, dangers(table.problem.padded))
    if not (former and former.alike and former.same_target):
        tell(*suspicions(problem))
    started = time.perf_counter()
    with announced(progress):
        sets = _filled(problem, chosen, progress, most, former)
        return _prepared_for_users(sets.finish({"seconds": time.perf_counter() - started}), chosen, former)


def _require_problem(problem: Any) -> None:
    """Raise ValueError unless `problem` is a ReachAvoidProblem."""
    if not isinstance(problem, ReachAvoidProblem):
        raise ValueError(f"problem must be a ReachAvoidProblem, got {problem!r}")


def _prepared_for_users(table: Table, method: Method, former: Former | None = None) -> Table:
    """A copy of the table as users get it: with a `player`, which simulates its runs, and with what `resolve` needs.

    Only a `LookupTable` has the latter (`Kept`): the method and, if `former` is given, the avoid tubes of each set and
    the solutions of the PDE that it has collected in this solve.
    """
    kept = Kept(method, former.avoid_tubes_by_danger, former.frame_solutions) if former else Kept(method)
    fields = {"reusable": kept} if isinstance(table, LookupTable) else {}
    return cast(Table, replace(cast(Any, table), player=played, **fields))


def _simulated_at_the_end(table: Table) -> dict[str, Any]:
    """Simulate runs of a solved table, warn of broken promises, and return {"played": counts} for its details.

    {} for a certified table, of which no runs are simulated; a warning says if next to nothing is certified. Whatever
    the runs raise, Ctrl-C too, becomes a warning, and {} is returned, so that the table is not lost. Only a warning
    that the caller has turned into an error is raised.
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


def estimate(problem: ReachAvoidProblem, method: str | Method = "hji") -> Cost:
    """State what `solve` in memory would cost, by the model by which it refuses what is too long, and solve nothing.

    Parameters
    ----------
    problem : ReachAvoidProblem
    method : Method or {"hji", "lax", "projected", "certified"}

    Returns
    -------
    Cost
        `operations`, `nbytes` of memory, `tubes` and more; `print` shows them in a line.

    Raises
    ------
    ValueError
        If the method does not fit the problem, or does not say what it costs.
    MemoryError
        If `solve` would not fit into memory; the message says how much it needs.

    Examples
    --------
    What moves makes a solve N (N + 1) / 2 tubes long instead of N:

    >>> import sdhj
    >>> sdhj.estimate(sdhj.arm_case_study(nodes=13, steps=8)).tubes
    36
    """
    chosen = method_of(method)
    with Meter(chosen.name, True, only_stated=True) as meter, suppress(Stated):
        chosen.sets(problem, False)
    if meter.cost is None:
        raise ValueError(f"method {chosen.name!r} does not say what it costs: see sdhj.problem.cost")
    return meter.cost


def _filled(
    problem: ReachAvoidProblem, method: Method, progress: bool | None, most: float, former: Former | None = None
) -> TubeSets:
    """The sets of a method, with all tubes computed by the recursion; with steps=None, those before Ctrl-C.

    Warns of what is wrong with unsafe sets and targets. Ctrl-C with a number of steps, or before the first tube, is
    raised.

    progress : whether to show a progress bar; None: if standard error is a terminal.
    most : the operations that the solve may take (`sdhj.problem.cost`), else ValueError.
    former : an earlier solve, from which what cannot differ is taken; only for methods "hji" and "lax".

    MemoryError where it does not fit into memory.
    """
    steps, endless = problem.most_steps, problem.steps is None
    with Meter(method.name, hidden(progress), most) as meter:
        if proving := isinstance(method, Certified):  # whose sets take half the time of a solve
            check_sets(problem)
        sets = cast(Any, method).sets(problem, progress, *[former] * bool(former))
        if not (proving or isinstance(sets, GridSets)):
            check_sets(problem)
        meter.tube()

        def done() -> None:
            """Tell the progress bar of one more tube and, with steps=None, what share of the states changes."""
            meter.tube()
            if endless:
                meter.bar.set_postfix_str(f"{sets.changing:.2%} of the states change", refresh=False)

        try:
            recursion(sets, steps, done)
        except KeyboardInterrupt:
            if not endless or not sets.filled:
                raise
    return cast(TubeSets, sets)


def load(
    path: str | os.PathLike[str], *, problem: ReachAvoidProblem | None = None, check: bool | None = None
) -> "Table":
    """Read a table of any method: a file that its `save` wrote, or a folder that it was solved into.

    Its arrays are mapped, that is read when they are asked for, unless they are compressed.

    Parameters
    ----------
    path : path
    problem : ReachAvoidProblem, optional
        The problem that the table was solved for. It is needed only if it has black boxes (`sdhj.BlackBox`), whose
        functions a file cannot contain. It must be the problem of the solve, up to the rounding of another machine. If
        it has no number of steps, it gets the number in the file.
    check : bool, optional
        Whether all arrays are read and compared with their digests, by which damage is found; by default of a table of
        less than 1 GB. Head, names, types and shapes always are.

    Returns
    -------
    LookupTable or CertifiedTable
        Of the class that was saved.

    Raises
    ------
    OSError
        If there is no such file, if it cannot be read, or if it is a device.
    MemoryError
        If a compressed table does not fit into the available memory.
    TableFileError
        If the file is damaged, cut short, of another kind or of another version, or was solved for another problem.
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
    if isinstance(path, str | os.PathLike) and is_store(path):
        return load_stored(path, problem, player=played)
    with opened_table(path, check) as (head, file):
        kind = CertifiedTable if head["method"] == "certified" else LookupTable
        return cast(Table, table_in(kind, path, head, file, problem, played))
