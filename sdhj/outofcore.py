"""Tables larger than memory: the recursion of `sdhj.solver.recursion` on slabs of the grid, kept in a store.

Within one interval nothing travels farther than the differences of all its time steps reach, so a slab of the grid with
as many nodes beside it, its *halo*, is solved alone (`sdhj.solver.slabs`), here or by the workers of a Dask cluster.
"""

import importlib
import json
import math
import os
import reprlib
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from sdhj.kernels.compiling import announced, hidden
from sdhj.problem.checks import whole
from sdhj.problem.cost import Meter, begin
from sdhj.problem.describing import arrays_of
from sdhj.problem.memory import available, require_memory
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.simulation.played import played
from sdhj.solver.avoid import dangers
from sdhj.solver.games import HJIGames
from sdhj.solver.methods import HJI, HopfLax, Method
from sdhj.solver.recursion import PROCESS, GridSets, Slabs, cost_on_grid, recursion, work
from sdhj.solver.resolution import check_resolution
from sdhj.solver.slabs import AvoidGame, Plan, Task, bytes_of_games, in_slabs, reach_halo, slab_window, time_steps
from sdhj.table.files import VERSION, Named, TableFileError, make_head
from sdhj.table.store import (
    STORE_FORMAT,
    Store,
    StoredTable,
    create,
    load_stored,
    opened_store,
    require_free_name,
    warn_of_disk,
)

LEAST_ROOM = 2**28  # bytes for a slab where the system does not say how many it has
ONE_AT_A_TIME = threading.Lock()  # threads of a worker share the memory that one slab may take
INSTEAD = "; leave store= out to solve in memory"
LOOKED_AT = 2**22  # nodes of an unsafe set whose resolution is checked


def solve_stored(
    problem: ReachAvoidProblem,
    asked: Method,
    path: Named,
    progress: bool | None,
    resume: bool,
    client: Any,
    memory: int | None,
    operations: float,
) -> StoredTable:
    """Solve a problem by the method `asked` into a store at `path`, slab by slab, and load the table from there.

    resume : whether a store that is there already goes on from its finished slabs, which are first read and compared
        with its ledger; without it a name that exists is an error.
    operations : a solve that would take more operations (`sdhj.problem.cost`) is refused with ValueError.
    problem, progress, client, memory : the arguments of `sdhj.solve`, which also lists the errors raised.
    """
    if not isinstance(path, str | os.PathLike):
        raise ValueError(f"store must be the name of a folder, got {reprlib.repr(path)}")
    started, path = time.perf_counter(), Path(os.path.abspath(path))
    method = storable_method(problem, asked, resume, client)
    with announced(progress), Meter(method.name, hidden(progress), operations) as meter:
        if again := resume and path.exists():
            store, head, _ = opened_store(path, problem)
            plan = planned(problem, method, cut_of(store, head, method))
            store.check(list(store.finished_slabs))
        else:
            require_free_name(path)
            plan = planned(problem, method, room=slab_memory(memory, client))
        begin(partial(cost_on_grid, plan, PROCESS + task_bytes(plan), plan.layout.nbytes))
        if not again:
            warn_of_disk(path, plan.layout.nbytes)
            store = Store(path, plan.layout, create(path, head_of(plan, method), arrays_of(problem), plan.layout))

        def slabs_done(number: int) -> None:
            """Move the progress bar on by `number` slabs of a tube; without a client do nothing.

            There the games themselves move it.
            """
            if client is not None:
                meter.tick(number * meter.operations_per_tube / plan.layout.slabs)

        sets = GridSets(problem, method, None, Slabs(plan, store, runner(plan, store, client), slabs_done))
        meter.tube()
        recursion(sets, problem.steps, meter.tube)
        details = {"tubes_shared": sets.shared, "slabs": plan.layout.slabs, "seconds": time.perf_counter() - started}
        store.finish(sets.table.index, method.options | details)
    return load_stored(path, problem, check=False, player=played)


def runner(plan: Plan, store: Store, client: Any) -> Callable[[list[Task]], Iterator[Any]]:
    """A function of a list of tasks that does them and yields, in any order, what `work` returns for each.

    Results are written to `store`. Without a client (None) tasks are done in this process, one after the other, as the
    results are asked for. With a Dask client its workers do them at the same time: tasks and digests go through Dask's
    scheduler, arrays through the store, which every worker has to see under the same path. A worker that dies leaves no
    line in the store's ledger, and another worker gets its task.
    """

    def shared_out(tasks: list[Task]) -> Iterator[Any]:
        """Have the workers of the Dask client do tasks, and yield what `work` returns for each, the first done first.

        An error of a worker is raised here, with a note on how to go on. At the end, after an error too, the tasks that
        are not done are cancelled.
        """
        futures = [client.submit(work_alone, plan, store, task, pure=False) for task in tasks]
        try:
            for future in importlib.import_module("distributed").as_completed(futures):
                yield future.result()
        except Exception as error:
            more = "with more memory for the workers if that is what ended them"
            error.add_note(f"what is finished stays in {store.path}: solve with resume=True, {more}")
            raise
        finally:
            client.cancel([future for future in futures if not future.done()])

    return shared_out if client is not None else lambda tasks: (work(plan, store, task) for task in tasks)


def work_alone(plan: Plan, store: Store, task: Task) -> Any:
    """As `sdhj.solver.recursion.work`, in a worker of a Dask client: one task of a process at a time.

    Its other threads wait, as `memory` is planned for one slab.
    """
    with ONE_AT_A_TIME:
        return work(plan, store, task)


def storable_method(problem: ReachAvoidProblem, method: Method, resume: Any, client: Any) -> HJI | HopfLax:
    """The method itself, if it and the problem can be solved into a store.

    ValueError for methods other than `HJI` and `HopfLax`, for joint games, and for problems with steps=None, a
    `Sensing`, safe ends or dynamics that depend on time; also if `resume` is not a bool, or `client` is not None and no
    Dask client.
    """
    if not isinstance(resume, bool):
        raise ValueError(f"resume must be True or False, got {reprlib.repr(resume)}")
    if client is not None and not (callable(getattr(client, "submit", None)) and hasattr(client, "scheduler_info")):
        raise ValueError(f"client must be a distributed.Client, got {reprlib.repr(client)}")
    if not isinstance(method, HJI | HopfLax):
        raise ValueError(f"a store does not take method {method.name!r}, but sdhj.HJI and sdhj.HopfLax{INSTEAD}")
    reasons = {
        'games="joint"': isinstance(method, HJI) and method.games == "joint",
        "steps=None": problem.steps is None,
        "sensing": problem.sensing,
        "dynamics that depend on time": problem.dynamics.depends_on_time,
        "safe ends": problem.grid.has("frees"),
    }
    if reason := next((reason for reason, applies in reasons.items() if applies), None):
        raise ValueError(f"a store does not take {reason}{INSTEAD}")
    return method


# ---- the plan


def slab_memory(memory: int | None, client: Any) -> int:
    """Bytes that a slab may take: `memory`; if that is None, half of the least that is free, here and in each worker.

    Where the system does not say what is free, it is `LEAST_ROOM`. ValueError if `memory` is no whole number from 1 on.
    """
    if memory is not None:
        return whole("memory", memory, least=1)
    free = available()
    workers = [one["memory_limit"] for one in client.scheduler_info()["workers"].values()] if client else []
    return min([free[0] // 2 if free else LEAST_ROOM, *(limit // 2 for limit in workers if limit)])


def planned(
    problem: ReachAvoidProblem, method: HJI | HopfLax, cut: tuple[int, int] | None = None, room: int = LEAST_ROOM
) -> Plan:
    """The plan of a solve into a store: along which axis the grid is cut, how wide slabs are, and how wide their halos.

    The axis is the one whose halo is the smallest share of it, and slabs are as wide as `room`, in bytes, lets them be.
    Where there are three axes or more none of the last two is cut: slabs of those would be rounded otherwise than the
    whole grid. Warns where the grid is too coarse. With several slabs the problem forgets the samples of its functions
    on the whole grid.

    method : by which the problem is solved; the halo depends on it.
    cut : (axis, width) of a store that was begun before, which is kept whatever `room` says; None: to be chosen.
    room : bytes that a slab may take.

    MemoryError if a slab of one node takes more than `room`, or a slab more than is free.
    """
    check_resolution(problem, most=LOOKED_AT)
    shape, found, dtype = problem.grid.shape, dangers(problem), method.options["dtype"]
    axis, width = cut or (0, shape[0])
    plan = Plan(problem, method.on, dtype, tuple(map(AvoidGame, found)), axis, width)  # in one piece: without a halo
    if width < shape[axis] or (not cut and task_bytes(plan) > room):
        counted = time_steps(method, problem, tuple(range(problem.grid.ndim)))
        axes: Any = [axis] if cut else range(max(1, problem.grid.ndim - 2))
        halos = {axis: reach_halo(method.on(problem), axis, counted) for axis in axes}
        axis = min(axes, key=lambda axis: halos[axis] / shape[axis])
        width, halo = width if cut else shape[axis], halos[axis]
        games = tuple(in_slabs(method, problem, danger, axis) for danger in found)
        plan = Plan(problem, method.on, dtype, games, axis, width, halo, counted)
    for slabs in range(2, 2 if cut else shape[axis] + 1):
        if task_bytes(plan) <= room:
            break
        plan = replace(plan, width=-(-shape[axis] // slabs))
    if plan.layout.slabs > 1:
        problem.forget_samples()  # what has been sampled of the whole grid is neither kept nor sent
    require_memory(needed := task_bytes(plan), f"a slab of {plan.width} of {shape[axis]} nodes along axis {axis}")
    if not cut and needed > room:
        raise MemoryError(
            f"a slab of one node along axis {axis} takes {needed / 1e9:.3g} GB with the {plan.halo} beside it on "
            f"either side, and {room / 1e9:.3g} GB are allowed; give more as memory=, or use fewer nodes"
        )
    return plan


def task_bytes(plan: Plan) -> int:
    """An upper bound on the bytes that one task of a plan takes at its peak, besides what the process takes anyway."""
    problem, layout = plan.problem, plan.layout
    item, count = np.dtype(plan.dtype).itemsize, len(problem.inputs)
    reaching, middle = plan.make_games(problem), (layout.slabs - 1) // 2  # whose halos no end of the grid cuts short
    windows, tubes = [plan.window(middle)[0]], 0
    if isinstance(reaching, HJIGames) and reaching.shifted:
        windows[0] = windows[0].extended(reaching.moving_grid[1])
    for kind, games in plan.avoid.items():
        tubes += item * count * math.prod(end - begin for begin, end in layout.runs(kind, 0))
        for game in games:
            grid = game.danger.problem.grid
            if game.axis is not None:
                first, end = layout.span(middle)
                grid, _ = slab_window(grid, game.axis, (game.begin + first, game.begin + end), game.halo)
            windows.append(grid.subgrid(game.danger.problem.avoid_axes(game.danger.unsafe_set)))
    written = math.prod(end - begin for begin, end in layout.runs("tubes", 0)) * (4 * item + 2 * -(-count // 8))
    differences = isinstance(reaching, HJIGames)  # else maxima over the first axes are kept
    needed = (bytes_of_games(problem, one, plan.dtype, 12 if differences else one.ndim + 4) for one in windows)
    return max(needed) + 2 * tubes + written  # a tube of several games is there twice


# ---- which problem it is


def head_of(plan: Plan, method: HJI | HopfLax) -> dict[str, Any]:
    """The head of a new store: problem, method with options, and how the grid is cut, as JSON gives it back.

    It differs from that of a file in having no details of the solve, and the entries "store", "options", "dtype", "cut"
    and "avoid_axes".
    """
    head = make_head(plan.problem, method.name, {}, plan.problem.digest) | {
        "store": STORE_FORMAT,
        "options": method.options,
        "dtype": plan.dtype,
        "cut": [plan.axis, plan.layout.width],
        "avoid_axes": {kind.removeprefix("avoid_"): list(plan.layout.axes(kind)) for kind in plan.avoid},
    }
    return dict(json.loads(json.dumps(head)))


def cut_of(store: Store, head: dict[str, Any], method: HJI | HopfLax) -> tuple[int, int]:
    """The axis along which a store is cut, and how many nodes a slab has along it, to go on with the store.

    head : the store's, as `sdhj.table.store.head_of_store` returns it.
    method : of the solve that goes on.

    TableFileError if another version of sdhj, another method or other options have begun the store.
    """
    if (its := head["sdhj_version"]) != VERSION:
        raise TableFileError(
            f"{store.path} was begun by sdhj {its}, and this is {VERSION}, which may round otherwise; solve it anew"
        )
    options = json.loads(json.dumps(method.options))
    if head["method"] != method.name or head["options"] != options:
        its = f"method {head['method']!r} with {head['options']}"
        raise TableFileError(f"{store.path} is being solved by {its}, and this is {method.name!r} with {options}")
    return store.layout.axis, store.layout.width
