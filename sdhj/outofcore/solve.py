"""Theorem 2 on slabs: the recursion of `sdhj.solver.recursion`, whose sets are in a store."""

import copy
import json
import math
import os
import reprlib
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from sdhj.kernels.compiling import announced, hidden
from sdhj.outofcore.slabs import AvoidGame, Plan, Task, around, in_slabs, reach_halo, time_steps, work
from sdhj.outofcore.store import CACHE_BYTES, STORE_FORMAT, TableStore, create, digest, free_name, room_for
from sdhj.outofcore.table import StoredTable
from sdhj.problem.checks import whole
from sdhj.problem.cost import Cost, Meter, begin, multiplied
from sdhj.problem.grid import Grid
from sdhj.problem.memory import available, require
from sdhj.problem.problem import ReachAvoidProblem, arrays_of
from sdhj.solver.avoid import dangers, never_felt
from sdhj.solver.games import KEPT, Axes, HJIGames
from sdhj.solver.methods import HJI, HopfLax, method_of
from sdhj.solver.recursion import PROCESS, recursion
from sdhj.solver.resolution import check_crossing, check_resolution
from sdhj.table.files import VERSION, Named, TableFileError, checked_head, head_of_table, problem_of_file
from sdhj.table.table import AvoidTubes, LookupTable

LEAST_ROOM = 2**28  # bytes for a slab where the system does not say how many it has
PACKED = 2**26  # bytes of chunks on their way through Zarr
LOOKED_AT = 2**22  # nodes of an unsafe set whose resolution is checked


def solve_stored(
    problem: ReachAvoidProblem,
    method: Any,
    path: Named,
    progress: bool | None,
    resume: bool,
    client: Any,
    memory: int | None,
    operations: float,
) -> StoredTable:
    """As `sdhj.solve` with a store: see there."""
    if not isinstance(path, str | os.PathLike):
        raise ValueError(f"store must be the name of a folder, got {reprlib.repr(path)}")
    method, started, path = method_of(method), time.perf_counter(), Path(os.path.abspath(path))
    refuse(problem, method)
    with announced(progress), Meter(method.name, hidden(progress), operations) as meter:
        if again := resume and path.exists():
            cut = cut_of(TableStore(path), problem, method)
            plan = replace(planned(problem, method, cut), path=path)
        else:
            free_name(path)
            plan = replace(planned(problem, method, room=room_of(memory, client)), path=path)
        begin(partial(cost_in_slabs, plan))
        if not again:
            room_for(path, bytes_of(_arrays(plan)))
            create(path, _head_of(plan), arrays_of(problem))

        def slabs_done(number: int) -> None:  # here the games tell, more often
            if client is not None:
                meter.tick(number * meter.each / plan.slabs)

        sets = StoredSets(plan, TableStore(path), runner(plan, client), slabs_done)
        meter.tube()
        recursion(sets, problem.steps, meter.tube)
        return sets.finish({"seconds": time.perf_counter() - started})


def cost_in_slabs(plan: Plan) -> Cost:
    """What a solve costs in slabs, each with its halo, by the model of `sdhj.problem.cost`."""
    problem, method, steps = plan.problem, plan.method, plan.problem.steps

    def game(played: ReachAvoidProblem, axes: Axes, counted: Any, axis: int | None, halo: int, wall: bool) -> float:
        games, n = method.on(played), 1 if axis is None else played.grid.shape[axis]
        games.counted = counted
        once = games.operations(axes, 0, wall)
        crossed.append(games.crossed)
        return once if axis is None else once * sum(min(plan.width + 2 * halo, n) for _ in range(plan.slabs)) / n

    crossed, once = list[float](), 0.0
    for one in plan.games:
        own = one.danger
        found = game(own.problem, own.problem.avoid_axes(own.part), one.counted, one.axis, one.halo, True)
        once += found * (steps if own.moves else 1)
    tubes, every = steps if problem.timeless else steps * (steps + 1) // 2, tuple(range(problem.grid.ndim))
    each = game(problem, every, plan.counted, plan.axis, plan.halo, False) + len(problem.inputs) * problem.grid.size
    check_crossing(problem, max(crossed), stacklevel=6)
    why = multiplied(problem, tubes, problem.grid.size, "nodes") + f", in {plan.slabs} slabs"
    return Cost(once + tubes * each, PROCESS + task_bytes(plan), tubes, once, max(crossed), why)


def bytes_of(arrays: Mapping[str, Any]) -> int:
    """Bytes that the arrays of a store take before they are compressed."""
    return sum(math.prod(shape) * np.dtype(kind).itemsize for shape, kind in arrays.values())


def runner(plan: Plan, client: Any) -> Callable[[list[Task]], Iterator[Any]]:
    """What does tasks and yields what `slabs.work` returns: this process, or the workers of a Dask client.

    Tasks and yes or no go through Dask's scheduler, arrays through the store, which every worker has to see under the
    same path. A worker that dies leaves nothing half written, and what it had in hand goes to another.
    """

    def shared_out(tasks: list[Task]) -> Iterator[Any]:
        futures = [client.submit(work, plan, task, pure=False) for task in tasks]
        try:
            for future in futures:
                yield future.result()
        except Exception as error:
            more = "with more memory for the workers if that is what ended them"
            error.add_note(f"what is finished stays in {plan.path}: solve with resume=True, {more}")
            raise
        finally:
            client.cancel([future for future in futures if not future.done()])

    return shared_out if client is not None else lambda tasks: (work(plan, task) for task in tasks)


def refuse(problem: ReachAvoidProblem, method: Any) -> None:
    """Raise ValueError for what is not solved out of core."""
    dynamics = problem.dynamics
    reasons = {
        f"method {method.name!r}, but sdhj.HJI and sdhj.HopfLax": not isinstance(method, HJI | HopfLax),
        'games="joint"': isinstance(method, HJI) and method.games == "joint",
        "steps=None": problem.steps is None,
        "sensing": problem.sensing,
        "dynamics that depend on time": dynamics.timed,
        "safe ends": problem.grid.has("safe"),
    }
    if reason := next((reason for reason, applies in reasons.items() if applies), None):
        raise ValueError(f"a store does not take {reason}; leave store= out to solve in memory")


# ---- the plan


def room_of(memory: int | None, client: Any) -> int:
    """Bytes that a slab may take: what is given, or half of what is available here and of what a worker may use."""
    if memory is not None:
        return whole("memory", memory, least=1)
    free = available()
    workers = [one["memory_limit"] for one in client.scheduler_info()["workers"].values()] if client else []
    return min([free[0] // 2 if free else LEAST_ROOM, *(limit // 2 for limit in workers if limit)])


def planned(
    problem: ReachAvoidProblem, method: Any, cut: tuple[int, int] | None = None, room: int = LEAST_ROOM
) -> Plan:
    """The axis along which slabs need least beside them, cut as thick as there is room for; or a `cut` made before.

    Where there are three axes or more it is none of the last two: on those a slab's nodes would come to lie in the
    vector loops of the kernels otherwise than those of the whole grid.
    """
    some = copy.copy(problem)  # with the unsafe sets that fit into memory on the axes that they depend on
    kept = tuple(part for part in problem.unsafe if problem.grid.subgrid(part.axes).size <= LOOKED_AT)
    some.__dict__.update(unsafe=kept)
    check_resolution(some, stacklevel=4)
    shape, found = problem.grid.shape, dangers(problem)
    axis, width = cut or (0, shape[0])
    games = tuple(map(AvoidGame, found))
    plan = Plan(problem, method, Path(), axis, width, 0, {}, games)  # in one piece, which needs no halo
    if width < shape[axis] or (not cut and task_bytes(plan) > room):
        counted = time_steps(method, problem, tuple(range(problem.grid.ndim)))
        axes: Any = [axis] if cut else range(max(1, problem.grid.ndim - 2))
        halos = {axis: reach_halo(method.on(problem), axis, counted) for axis in axes}
        axis = min(axes, key=lambda axis: halos[axis] / shape[axis])
        width, halo = width if cut else shape[axis], halos[axis]
        games = tuple(in_slabs(method, problem, danger, axis) for danger in found)
        plan = Plan(problem, method, Path(), axis, width, halo, counted, games)
    for slabs in range(2, 2 if cut else shape[axis] + 1):
        if task_bytes(plan) <= room:
            break
        plan = replace(plan, width=-(-shape[axis] // slabs))
    if plan.slabs > 1:
        problem._static.clear()  # what has been sampled of the whole grid is neither kept nor sent
    require(needed := task_bytes(plan), f"a slab of {plan.width} of {shape[axis]} nodes along axis {axis}")
    if not cut and needed > room:
        raise MemoryError(
            f"a slab of one node along axis {axis} takes {needed / 1e9:.3g} GB with the {plan.halo} beside it on "
            f"either side, and {room / 1e9:.3g} GB are allowed; give more as memory=, or use fewer nodes"
        )
    return plan


def task_bytes(plan: Plan) -> int:
    """Bytes that the largest task of a plan takes at its peak, beside what the process takes; from above."""
    problem, dynamics = plan.problem, plan.problem.dynamics
    item, count = np.dtype(plan.method.options["dtype"]).itemsize, len(problem.inputs)

    def played(window: Grid) -> int:
        """The games of one input on a window: what is sampled, stages with their ghost nodes, shifted copies."""
        arrays = 12 if isinstance(plan.method, HJI) else window.ndim + 4  # maxima over the first axes are kept
        most = window.sampling_bytes + arrays * item * window.size
        if not dynamics.stateless:
            whole = not dynamics.formulas or dynamics.gain is None or dynamics.couples(range(window.ndim))
            each = 8 * (2 * dynamics.adversaries + 6) if whole else 12  # boxes lie on the axes that they read
            velocities = each * window.ndim * window.size
            most += velocities + min(KEPT, count * velocities)
            most += item * window.ndim * (3 + dynamics.adversaries) * window.size
        return most

    middle = plan.span((plan.slabs - 1) // 2)  # whose halos no end of the grid cuts short
    windows, tubes = [around(problem.grid, plan.axis, middle, plan.halo)[0]], 0
    reaching = plan.method.on(problem)
    if isinstance(reaching, HJIGames) and reaching.shifted:
        windows[0] = windows[0].continued(reaching.around[1])
    for kind, games in plan.avoid.items():
        tubes += item * count * math.prod(end - begin for begin, end in plan.runs(0, plan.avoid_axes[kind]))
        for game in games:
            grid = game.danger.problem.grid
            if game.axis is not None:
                grid, _ = around(grid, game.axis, (game.begin + middle[0], game.begin + middle[1]), game.halo)
            windows.append(grid.subgrid(game.danger.problem.avoid_axes(game.danger.part)))
    written = math.prod(end - begin for begin, end in plan.runs(0)) * (4 * item + 2 * -(-count // 8))
    cached = min(CACHE_BYTES, bytes_of(_arrays(plan))) if plan.slabs == 1 else 0
    return max(map(played, windows)) + 2 * tubes + written + PACKED + cached  # tubes are there twice while packed


# ---- which problem it is


def _head_of(plan: Plan) -> dict[str, Any]:
    """The head of a store: its problem, its method and its arrays."""
    problem, method = plan.problem, plan.method
    head = head_of_table(problem, method.name, {}, problem.digest) | {
        "store": STORE_FORMAT,
        "options": method.options,
        "cut": [plan.axis, plan.width],
        "halo": plan.halo,
        "avoid_axes": {kind: list(axes) for kind, axes in plan.avoid_axes.items()},
        "functions": {name: digest(values) for name, values in arrays_of(problem).items()},
        "arrays": _arrays(plan),
    }
    return dict(json.loads(json.dumps(head)))


def _arrays(plan: Plan) -> dict[str, Any]:
    """Shapes and kinds of the arrays of a store."""
    shape, count, dtype = plan.problem.grid.shape, len(plan.problem.inputs), plan.method.options["dtype"]
    rooms = LookupTable.rooms(plan.problem)
    static, moving = ([count, *(shape[axis] for axis in plan.avoid_axes[kind])] for kind in ("static", "moving"))
    avoid = {"avoid_static": [[1, *static], dtype], "avoid_moving": [[plan.problem.steps, *moving], dtype]}
    return {"tubes": [[rooms, *shape], dtype], "masks": [[rooms, -(-count // 8), *shape], "uint8"]} | avoid


def cut_of(store: TableStore, problem: ReachAvoidProblem, method: Any) -> tuple[int, int]:
    """How a store is cut that a solve may go on with; TableFileError where it belongs to another one."""
    path, head = store.path, store.head
    if (its := head["sdhj_version"]) != VERSION:
        raise TableFileError(
            f"{path} was begun by sdhj {its}, and this is {VERSION}, which may round otherwise; solve it anew"
        )
    options = json.loads(json.dumps(method.options))
    if head["method"] != method.name or head["options"] != options:
        its = f"method {head['method']!r} with {head['options']}"
        raise TableFileError(f"{path} is being solved by {its}, and this is {method.name!r} with {options}")
    problem_of_file(path, checked_head(head), store.functions, problem)
    axis, width = head["cut"]
    return axis, width


# ---- the recursion


class StoredSets:
    """S_k with n steps to go in a store: `recursion.Sets`, a slab at a time.

    `run` yields what `slabs.work` returns of tasks, in any order; `tick` gets how many slabs are done.
    """

    def __init__(self, plan: Plan, store: TableStore, run: Any, tick: Callable[[int], Any]) -> None:
        self.plan, self.store, self.run, self.tick = plan, store, run, tick
        self.problem, self.timeless, self.shared = plan.problem, plan.problem.timeless, 0
        none, index = np.empty(0), LookupTable.places(plan.problem)
        avoid = AvoidTubes((), none, (), none)
        self.table = LookupTable(plan.problem, plan.method.name, index, none, none, avoid, {})  # its index alone
        self.same: dict[tuple[int, int], bool] = {}
        for kind, steps in (("static", 1), ("moving", self.problem.steps)):
            found = [self._do(Task(kind, 0, step), f"avoid_{kind}", step) for step in range(steps)]
            self._warn_unless_felt(kind, list(chain(*found)))

    def goal(self, step: int) -> None:
        self._do(Task("goal", 0, step, place := self.table.place(step, 0)), "tubes", place)

    def extend(self, step: int, within: int) -> None:
        place, before = self.table.place(step, within), self.table.place(step, within - 1)
        after = self.table.place(step + 1, within - 1)
        found = self._do(Task("extend", 0, step, place, before, after), "tubes", place)
        if len(found) == self.plan.slabs:
            self.same[place, before] = all(found)

    def stopped(self, step: int, within: int) -> bool:
        one, other = pair = self.table.place(step, within), self.table.place(step, within - 1)
        if pair not in self.same:  # of an earlier solve
            slabs, read = map(self.plan.runs, range(self.plan.slabs)), partial(self.store.read, "tubes")
            self.same[pair] = one == other or all(np.array_equal(read(one, slab), read(other, slab)) for slab in slabs)
        return self.same[pair]

    def share(self, step: int, within: int) -> None:
        self.table.share(step, within)
        self.shared += 1
        self.tick(self.plan.slabs)

    def finish(self, details: Mapping[str, Any]) -> StoredTable:
        whole = self.plan.method.options | {"tubes_shared": self.shared, "slabs": self.plan.slabs} | dict(details)
        self.store.finish(self.table.index, whole)
        return StoredTable(self.problem, TableStore(self.store.path))

    def _do(self, task: Task, name: str, lead: int) -> list[Any]:
        """Have a task done on all slabs where it is not; what those return."""
        axes = None if name == "tubes" else self.plan.avoid_axes[task.kind]
        names = [name, "masks"] if name == "tubes" else [name]
        slabs = range(self.plan.slabs if name == "tubes" or self.plan.cuts(task.kind) else 1)
        runs = [self.plan.runs(slab, axes) for slab in slabs]
        todo = [slab for slab in slabs if not all(self.store.there(one, lead, runs[slab]) for one in names)]
        self.tick(len(slabs) - len(todo))
        done = []
        for one in self.run([task._replace(slab=slab) for slab in todo]):
            done.append(one)
            self.tick(1)
        return done

    def _warn_unless_felt(self, kind: str, found: list[list[bool]]) -> None:
        """As `avoid.avoid_tubes` warns, of what this solve has looked at from end to end."""
        slabs = (self.plan.slabs if self.plan.cuts(kind) else 1) * (self.problem.steps if kind == "moving" else 1)
        if len(found) < slabs:
            return
        for game, felt in zip(self.plan.avoid[kind], np.any(found, axis=0), strict=True):
            if not felt and any(game.danger.part is part for part in self.problem.unsafe):
                warnings.warn(never_felt(game.danger.part), stacklevel=5)
