"""Slabs of a grid, and what is done to one.

How far one interval reaches, in nodes along the axis that is cut: a time step of the Runge-Kutta scheme has some
stages, and each reads `order` nodes to either side, so what is d nodes away from where a window ends is right after
floor(d / order) stages. After K time steps of S stages a node is right that is

    h = order * S * K     nodes inside.

A shift by c cells, or the Hopf-Lax maximum over a box of them, reads floor(c) + 2 more: the last of them for the
limited second difference. K is that of the whole grid, from its fastest velocity: a slab with another time step
would be right too, and other bits. A periodic axis is gone around; where a window would meet itself it is the grid.
"""

import math
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sdhj.kernels import FloatArray
from sdhj.kernels.stages import REACH
from sdhj.outofcore.store import CACHE_BYTES, Runs, TableStore
from sdhj.problem.grid import Grid
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.solver.avoid import Danger
from sdhj.solver.games import Axes, HJIGames, HopfLaxGames, Wall
from sdhj.solver.recursion import InputRows
from sdhj.solver.schemes import STAGES
from sdhj.table.table import AvoidTubes

ONE_AT_A_TIME = threading.Lock()  # threads of a worker share the memory that one slab may take
KINDS = "static", "moving"  # avoid tubes


class AvoidGame(NamedTuple):
    """An avoid game in slabs."""

    danger: Danger
    axis: int | None = None  # which axis of the danger's grid is cut; None where the game knows nothing of it
    begin: int = 0  # where the problem's first node lies on it
    halo: int = 0  # nodes beside a slab
    counted: Mapping[Axes, Any] = {}  # as `HJIGames.counted`


@dataclass(frozen=True, eq=False)
class Plan:
    """What whoever solves a slab needs to know; it is sent to other processes."""

    problem: ReachAvoidProblem
    method: Any
    path: Path
    axis: int  # that is cut
    width: int  # nodes of a slab
    halo: int  # nodes beside it in the games of being in a set
    counted: Mapping[Axes, Any]  # as `HJIGames.counted`
    games: tuple[AvoidGame, ...]

    @cached_property
    def avoid(self) -> Mapping[str, list[AvoidGame]]:
        """The avoid games whose tubes are the same at all steps, and the others."""
        return {kind: [game for game in self.games if game.danger.moves == (kind == "moving")] for kind in KINDS}

    @cached_property
    def avoid_axes(self) -> Mapping[str, Axes]:
        """The axes of the avoid tubes."""
        axes = {kind: {i for game in games for i in game.danger.axes} for kind, games in self.avoid.items()}
        return {kind: tuple(sorted(some)) for kind, some in axes.items()}

    @cached_property
    def whole(self) -> Any:
        """The games of the only slab, which are not sampled each time."""
        return self.method.on(self.problem)

    @cached_property
    def store(self) -> TableStore:
        """The store, open; where there is one slab it keeps the tubes from which the next ones follow."""
        store = TableStore(self.path)
        store.cache_room = CACHE_BYTES + store.arrays["avoid_static"].nbytes if self.slabs == 1 else 0
        return store

    @property
    def slabs(self) -> int:
        return -(-self.problem.grid.shape[self.axis] // self.width)

    def span(self, slab: int) -> tuple[int, int]:
        """The first node of a slab and the one behind its last."""
        return slab * self.width, min((slab + 1) * self.width, self.problem.grid.shape[self.axis])

    def runs(self, slab: int, axes: Axes | None = None) -> Runs:
        """Begin and end of a slab on each axis of the grid, or on some axes."""
        shape = self.problem.grid.shape
        axes = tuple(range(len(shape))) if axes is None else axes
        return [self.span(slab) if axis == self.axis else (0, shape[axis]) for axis in axes]

    def cuts(self, kind: str) -> bool:
        """Whether the avoid tubes of a kind differ from slab to slab."""
        return self.axis in self.avoid_axes[kind]


class Task(NamedTuple):
    """A slab to be worked on."""

    kind: str  # "goal", "extend", "static" or "moving"
    slab: int
    step: int = 0
    place: int = 0  # of the tube (step, within) in the store
    before: int = 0  # ... (step, within - 1)
    after: int = 0  # ... (step + 1, within - 1)


# ---- how wide a halo is


def depth(scheme: Any) -> int:
    """Nodes that a time step of a scheme reads to each side."""
    return min(scheme.order, REACH) * len(STAGES[scheme.integrator])


def crossed(cells: float) -> int:
    """Nodes that a shift by up to so many cells reads to each side; none where nothing moves."""
    return math.floor(cells + 1e-9) + 2 if cells else 0


def time_steps(method: Any, problem: ReachAvoidProblem, axes: Axes) -> Mapping[Axes, Any]:
    """Time steps for each input, of games on some axes of the whole grid; nothing where each slab finds the same."""
    if method.name != "hji" or problem.dynamics.stateless:
        return {}
    most = np.zeros(len(problem.inputs), np.int64)
    for piece in problem.pieces():
        games = method.on(piece)
        grid, cfl = piece.grid.subgrid(axes), method.scheme.cfl
        most = np.maximum(
            most, [games.velocities(j, axes, 0).steps(grid, games.duration, cfl) for j in range(len(most))]
        )
    return {axes: most.tolist()}


def reach_halo(games: Any, axis: int, counted: Mapping[Axes, Any]) -> int:
    """Nodes beside a slab that `games.reach` needs."""
    problem = games.problem
    if isinstance(games, HopfLaxGames):
        return crossed(float(games.cells[axis]))
    if games.moving_frame:
        steps = games.velocities(0, games.axes, 0, False).steps(games.grid, games.duration, games.scheme.cfl)
        drift, spacing = np.abs(problem.dynamics.arrays[0][:, axis]).max(), games.grid.spacing[axis]
        reached = max(depth(games.scheme) * steps, crossed(float(games.brought[axis]) / spacing))
        return reached + crossed(float(drift) * games.duration / spacing)
    return depth(games.scheme) * _most(games, games.axes, counted)


def avoid_halo(games: Any, axes: Axes, axis: int, counted: Mapping[Axes, Any]) -> int:
    """Nodes beside a slab that `games.avoid` needs, on some axes."""
    if isinstance(games, HopfLaxGames) or games.by_formula(axes):
        speed = np.abs(games.problem.interval(0).extremes(0.0))[..., axis].max()
        return crossed(float(speed) * games.duration / games.problem.grid.spacing[axis])
    return depth(games.scheme) * _most(games, axes, counted)


def _most(games: HJIGames, axes: Axes, counted: Mapping[Axes, Any]) -> int:
    """Time steps of the input that needs most."""
    return max(1, *counted[axes]) if axes in counted else games.steps(axes, 0)


def in_slabs(method: Any, problem: ReachAvoidProblem, danger: Danger, axis: int) -> AvoidGame:
    """An avoid game of a problem in slabs of an axis of its grid."""
    if axis not in danger.axes:
        return AvoidGame(danger)
    whole, place = danger.problem, danger.axes.index(axis)
    cut, axes = axis if whole is problem else place, whole.avoid_axes(danger.part)
    counted = time_steps(method, whole, axes)
    halo = avoid_halo(method.on(whole), axes, cut, counted)
    return AvoidGame(danger, cut, danger.inside[place].start or 0, halo, counted)


def around(grid: Grid, axis: int, span: tuple[int, int], halo: int) -> tuple[Grid, slice]:
    """The window of a slab with its halo, and where in it the slab is."""
    (begin, end), n = (span[0] - halo, span[1] + halo), grid.shape[axis]
    if not grid.periodic[axis]:
        begin, end = max(begin, 0), min(end, n)
    if end - begin >= n:
        begin, end = 0, n
    return grid.stretch(axis, begin % n, end - begin), slice(span[0] - begin, span[1] - begin)


# ---- what is done to a slab


def _games(plan: Plan, playing: ReachAvoidProblem, counted: Mapping[Axes, Any], wanted: Mapping[int, slice]) -> Any:
    if plan.slabs == 1 and playing is plan.problem:
        return plan.whole
    games = plan.method.on(playing)
    games.counted, games.wanted = counted, wanted
    return games


def work(plan: Plan, task: Task) -> Any:
    """Do a task and write what comes of it; returns what `_extend` and `_avoid` do."""
    with ONE_AT_A_TIME:
        return {"goal": _goal, "extend": _extend}.get(task.kind, _avoid)(plan, plan.store, task)


def _goal(plan: Plan, store: TableStore, task: Task) -> None:
    runs, problem = plan.runs(task.slab), plan.problem
    window, _ = around(problem.grid, plan.axis, plan.span(task.slab), 0)
    values = problem.on(window).goal(task.step).astype(store.arrays["tubes"].dtype)
    store.write("masks", task.place, runs, np.zeros((store.arrays["masks"].shape[1], *window.shape), np.uint8))
    store.write("tubes", task.place, runs, values)


def _avoid(plan: Plan, store: TableStore, task: Task) -> list[bool]:
    """The avoid tubes of one slab, or of all where they know nothing of the cut: see `sdhj.solver.avoid.avoid_tubes`.

    Returns of each game whether any node is in danger.
    """
    kept, problem = plan.avoid_axes[task.kind], plan.problem
    runs, window = plan.runs(task.slab, kept), problem.grid
    if kept:
        window = window.subgrid(kept).window(*zip(*((begin, end - begin) for begin, end in runs), strict=True))
    dtype, felt = store.arrays["tubes"].dtype, []
    total = np.full((len(problem.inputs), *(end - begin for begin, end in runs)), -np.inf, dtype)
    for game in plan.avoid[task.kind]:
        danger, cut = game.danger, [*game.danger.inside]
        playing, wanted = danger.problem, {}
        if game.axis is not None:
            span = [game.begin + node for node in plan.span(task.slab)]
            part, inner = around(playing.grid, game.axis, (span[0], span[1]), game.halo)
            playing, wanted[game.axis], cut[danger.axes.index(plan.axis)] = playing.on(part), inner, slice(None)
        wall, at = Wall.of(playing, danger.part, playing.avoid_axes(danger.part)), [kept.index(i) for i in danger.axes]
        felt.append(False)
        for j, tube in _games(plan, playing, game.counted, wanted).each_tube(wall, task.step):
            felt[-1] |= bool((tube := tube[tuple(cut)]).max() > 0)
            np.maximum(total[j], window.lift(tube, at), out=total[j])
    store.write(f"avoid_{task.kind}", task.step, runs, total)
    return felt


def _extend(plan: Plan, store: TableStore, task: Task) -> bool:
    """As `GridSets.extend`, on one slab. Returns whether the tube is the one before."""
    problem, span, runs = plan.problem, plan.span(task.slab), plan.runs(task.slab)
    window, kept = around(problem.grid, plan.axis, span, plan.halo)
    games = _games(plan, problem if plan.slabs == 1 else problem.on(window), plan.counted, {plan.axis: kept})
    before, values = store.cached("tubes", task.before, runs), read_window(store.cached, "tubes", task.after, window)
    tube = np.full_like(before, np.inf) if problem.stays else before.copy()
    mask = np.zeros((store.arrays["masks"].shape[1], *tube.shape), np.uint8)
    axes = plan.avoid_axes["static"], plan.avoid_axes["moving"]
    static = store.cached("avoid_static", 0, plan.runs(task.slab, axes[0]))
    moving = store.cached("avoid_moving", task.step, plan.runs(task.slab, axes[1]))[None]
    slab = problem.grid.stretch(plan.axis, span[0], span[1] - span[0])
    rows = InputRows(slab, AvoidTubes(axes[0], static, axes[1], moving))
    for some in games.reaches(values, task.step):
        rows.add(tube, mask, some, 0, tube)
    if problem.stays:
        np.maximum(tube, before, out=tube)
    store.write("masks", task.place, runs, mask)
    store.write("tubes", task.place, runs, tube)  # behind the marks: with it the slab is finished
    return np.array_equal(tube, before)


def read_window(read: Callable[[str, int, Runs], FloatArray], name: str, lead: int, window: Grid | None) -> FloatArray:
    """What `read`, as `TableStore.read`, finds at the nodes of a window, around periodic ends too; None: of no axes."""
    if window is None:
        return read(name, lead, ())
    whole = getattr(window, "whole", window).shape

    def around_ends(runs: Runs) -> FloatArray:
        for axis, (begin, end) in enumerate(runs):
            if end > whole[axis]:
                parts = ((begin, whole[axis]), (0, end - whole[axis]))
                found = [around_ends([*runs[:axis], part, *runs[axis + 1 :]]) for part in parts]
                return np.concatenate(found, axis=axis - len(runs))
        return read(name, lead, runs)

    first = getattr(window, "first", (0,) * window.ndim)
    return around_ends([(begin, begin + n) for begin, n in zip(first, window.shape, strict=True)])
