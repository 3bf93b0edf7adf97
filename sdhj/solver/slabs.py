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
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from sdhj.kernels import FloatArray
from sdhj.kernels.compiling import FEW
from sdhj.problem.boxes import nodes_read
from sdhj.problem.grid import Grid
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.solver.avoid import Danger
from sdhj.solver.games import KEPT, Axes, Games, HJIGames, HopfLaxGames
from sdhj.solver.schemes import Scheme
from sdhj.table.store import Arrays, Runs, Shapes, Slab


class AvoidGame(NamedTuple):
    """How the avoid game of a danger is played slab by slab.

    danger : what is avoided.
    axis : which axis of the danger's own grid is cut; None where the game is played whole, as it does not depend on the
        cut.
    begin : the node of the danger's grid, along `axis`, that is the first node of the problem's grid; a wide grid
        begins earlier.
    halo : how many nodes on both sides of a slab are played on, too, so that the slab is right.
    counted : as in `_OnAxes` of `sdhj.solver.games`.
    """

    danger: Danger
    axis: int | None = None
    begin: int = 0
    halo: int = 0
    counted: Mapping[Axes, Any] = {}


@dataclass(frozen=True, eq=False)
class Plan:
    """How a solve is cut into slabs, and what games are played on them: all that a slab takes but its arrays.

    It is pickled for other processes, without `kept` and what has been made. One slab is the whole grid, in memory.

    Attributes
    ----------
    problem : ReachAvoidProblem
    make_games : callable
        Makes the games of a problem's intervals, as `sdhj.HJI.on` does.
    dtype : {"float32", "float64"}
        Of the tubes.
    games : tuple of AvoidGame
        All avoid games, static and moving.
    axis : int
        The axis of the problem's grid that is cut.
    width : int
        Nodes of a slab along it (the last slab may have fewer); 0: all.
    halo : int
        Nodes on both sides of a slab that reach games are played on, too.
    counted : mapping
        Of reach games, as in `_OnAxes` of `sdhj.solver.games`.
    former : Former, optional
        An earlier solve in this process, from which all that cannot differ is copied.
    kept : dict
        What one process keeps from task to task: "rows", `InputRows` of the only slab, and "patch", the `Patch` of the
        entry that is being solved, or None.
    """

    problem: ReachAvoidProblem
    make_games: Callable[..., Games]
    dtype: str
    games: tuple[AvoidGame, ...]
    axis: int = 0
    width: int = 0
    halo: int = 0
    counted: Mapping[Axes, Any] = field(default_factory=dict)
    former: Any = None
    kept: dict[str, Any] = field(default_factory=dict, init=False)

    def __reduce__(self) -> Any:  # without what was kept
        """Pickled are the fields that were given; `kept` and the games that have been made are not."""
        return Plan, tuple(getattr(self, one.name) for one in fields(self) if one.init)

    @cached_property
    def avoid(self) -> dict[str, list[AvoidGame]]:
        """The avoid games by the array of their tubes: "avoid_static", the same at all steps, and "avoid_moving"."""
        kinds = {"avoid_static": False, "avoid_moving": True}
        return {name: [game for game in self.games if game.danger.moves == moves] for name, moves in kinds.items()}

    @cached_property
    def layout(self) -> Shapes:
        """The shapes of the table's arrays, and how they are cut into slabs along `axis`; computed once."""
        axes = {name: {i for game in games for i in game.danger.axes} for name, games in self.avoid.items()}
        ascending = {name: tuple(sorted(some)) for name, some in axes.items()}
        width = self.width or self.problem.grid.shape[self.axis]
        return Shapes.of(self.problem, self.dtype, self.axis, width, ascending)

    @cached_property
    def whole_games(self) -> Any:
        """The games on the whole, padded grid, made at first use and kept; in a solve with one slab they play it."""
        return self.make_games(self.problem.padded)

    def slab(self, number: int) -> Grid:
        """The grid of slab `number`, without its halo."""
        return slab_window(self.problem.grid, self.axis, self.layout.span(number), 0)[0]

    def window(self, number: int) -> tuple[Grid, slice]:
        """The grid of slab `number` with its halo, and which nodes of it along the cut axis are the slab."""
        return slab_window(self.problem.grid, self.axis, self.layout.span(number), self.halo)

    def games_on_slab(self, number: int) -> tuple[Grid, Any]:
        """The grid of slab `number` with its halo, and games on it, whose results have the nodes of the slab alone.

        With several slabs the games are new at each call. With one it is the problem's grid without padding, and
        `whole_games`, the games on the padded grid.
        """
        if self.layout.slabs == 1:
            return self.problem.grid, self.whole_games
        window, kept = self.window(number)
        return window, self.make_games(self.problem.on(window), counted=self.counted, wanted={self.axis: kept})

    def avoid_games_on_slab(self, game: AvoidGame, number: int) -> tuple[Any, tuple[slice, ...]]:
        """The games by which an avoid game is played on slab `number`, and where the slab lies in their tubes.

        The second is a slice for each axis of the tubes, without that of the inputs.

        An avoid game that is not cut is played on all of its grid, else on the slab with its halo, by new games each
        time. With one slab, avoid games on the padded grid are played by `whole_games`.
        """
        problem, inside = game.danger.problem, game.danger.inside
        if problem is self.problem.padded and self.layout.slabs == 1:
            return self.whole_games, inside
        if game.axis is None:
            return self.make_games(problem), inside
        first, end = self.layout.span(number)
        part, kept = slab_window(problem.grid, game.axis, (game.begin + first, game.begin + end), game.halo)
        cut = game.danger.axes.index(self.axis)
        games = self.make_games(problem.on(part), counted=game.counted, wanted={game.axis: kept})
        return games, (*inside[:cut], slice(None), *inside[cut + 1 :])


class Task(NamedTuple):
    """What is to be computed and written on one slab: a tube, the target's entry, or the avoid tubes of a step.

    kind : "goal", the entry (step, 0); "extend", the entry (step, within); "avoid_static" or "avoid_moving".
    step : the step k; 0 for "avoid_static".
    position : where the result is written: the position of the tube among the stored ones, or the step of avoid tubes.
    before, after : only for "extend": the positions of the tubes (step, within - 1) and (step + 1, within - 1).
    slab : the number of the slab.
    """

    kind: str
    step: int
    position: int
    before: int = 0
    after: int = 0
    slab: int = 0

    @property
    def array(self) -> str:
        """The name of the array that is written: "tubes" (with its marks), "avoid_static" or "avoid_moving"."""
        return "tubes" if self.kind in ("goal", "extend") else self.kind

    @property
    def written(self) -> Slab:
        """Which part of the arrays is written, as `Memory` and `Store` take it."""
        return Slab(self.array, self.position, self.slab)


# ---- how wide a halo is


def nodes_read_in_a_step(scheme: Scheme) -> int:
    """How many nodes to each side a whole time step of a scheme reads: those of a stage times the number of stages."""
    return math.prod(scheme.reads)


def time_steps(method: Any, problem: ReachAvoidProblem, axes: Axes) -> Mapping[Axes, Any]:
    """{axes: time steps (L,) of each input} of games on `axes` on the whole grid, for the `counted` of games on slabs.

    {} for methods other than "hji", and for velocities that do not depend on the state, for which each slab finds the
    same numbers by itself. The whole grid is gone through in parts, to save memory. Velocities must not depend on time.

    method : an `HJI`, or another method with a `name`. problem : on the whole grid, which has `axes`.
    """
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
    """How many nodes on both sides of a slab, along `axis`, reach games read, and so need for right values on it.

    games : those of the whole grid. counted : what `time_steps` returned for their axes, or {}.
    """
    problem = games.problem
    if isinstance(games, HopfLaxGames):
        return nodes_read(float(games.reads[axis]))
    if games.moving_frame:
        steps = games.velocities(0, games.axes, 0, False).steps(games.grid, games.duration, games.scheme.cfl)
        drift, spacing = np.abs(problem.dynamics.arrays[0][:, axis]).max(), games.grid.spacing[axis]
        reached = max(
            nodes_read_in_a_step(games.scheme) * steps,
            nodes_read(float(games.displacement_by_disturbance[axis]) / spacing),
        )
        return reached + nodes_read(float(drift) * games.duration / spacing)
    return nodes_read_in_a_step(games.scheme) * _most_time_steps(games, games.axes, counted)


def avoid_halo(games: HJIGames | HopfLaxGames, axes: Axes, axis: int, counted: Mapping[Axes, Any]) -> int:
    """How many nodes on both sides of a slab, along `axis`, avoid games played on `axes` read, and so need.

    games : those of the whole grid of the danger's problem. counted : what `time_steps` returned for `axes`, or {}.
    """
    if isinstance(games, HopfLaxGames) or games.uses_hopf_lax(axes):
        speed = np.abs(games.problem.interval(0).extremes(0.0))[..., axis].max()
        more = 2 * games.problem.interval(0).segments(axes).shape[1]  # as in `HopfLaxGames.reads`
        return nodes_read(float(speed) * games.duration / games.problem.grid.spacing[axis] + more)
    return nodes_read_in_a_step(games.scheme) * _most_time_steps(games, axes, counted)


def _most_time_steps(games: HJIGames, axes: Axes, counted: Mapping[Axes, Any]) -> int:
    """The time steps of the input that needs most: from `counted` if it has these axes, else from the games."""
    return max(1, *counted[axes]) if axes in counted else games.steps(axes, 0)


def in_slabs(method: Any, problem: ReachAvoidProblem, danger: Danger, axis: int) -> AvoidGame:
    """The avoid game of a danger, as the method plays it, cut into slabs along an axis of the problem's grid.

    It is not cut (axis None) where the danger does not depend on that axis; else it has the halo that it needs.
    """
    if axis not in danger.axes:
        return AvoidGame(danger)
    whole, place = danger.problem, danger.axes.index(axis)
    cut, axes = axis if whole is problem else place, whole.avoid_axes(danger.unsafe_set)
    counted = time_steps(method, whole, axes)
    halo = avoid_halo(method.on(whole), axes, cut, counted)
    return AvoidGame(danger, cut, danger.inside[place].start or 0, halo, counted)


def slab_window(grid: Grid, axis: int, span: tuple[int, int], halo: int) -> tuple[Grid, slice]:
    """The window of a slab, with `halo` nodes on both sides, and the slice of the slab in it along `axis`.

    span : (first node, one past the last) of the slab along the axis. A window stops at the ends of a bounded axis and
        continues around a periodic one; where it would meet itself it is the whole grid.
    """
    (begin, end), n = (span[0] - halo, span[1] + halo), grid.shape[axis]
    if not grid.periodic[axis]:
        begin, end = max(begin, 0), min(end, n)
    if end - begin >= n:
        begin, end = 0, n
    return grid.stretch(axis, begin % n, end - begin), slice(span[0] - begin, span[1] - begin)


def bytes_of_games(problem: ReachAvoidProblem, grid: Grid, dtype: str, arrays: int = 12, times: int = 1) -> int:
    """Upper estimate of the bytes that the games of one interval on `grid` take; never more for a smaller grid.

    These are the samples of level-set functions, the work arrays, and velocities that depend on the state, kept for all
    inputs up to `KEPT` bytes. On small grids work arrays and velocities are those of all inputs at once
    (`HJIGames.groups`).

    dtype : "float32" or "float64".
    arrays : how many work arrays of the grid's size and `dtype` there are, such as stages and shifted copies.
    times : at how many times of the interval velocities are kept.
    """
    dynamics, axes, item, count = problem.dynamics, range(grid.ndim), np.dtype(dtype).itemsize, len(problem.inputs)
    found = grid.sampling_bytes + arrays * item * grid.size
    if not dynamics.stateless:
        whole = not dynamics.formulas or dynamics.gain is None or dynamics.couples(axes)
        each = 8 * (2 * dynamics.disturbance_dim + 6) if whole else 12  # boxes lie on the axes that they read
        each += 8 * (3 + grid.ndim) * (math.prod(dynamics.pieces_of_components(axes)) - 1)
        velocities = each * grid.ndim * grid.size
        found += velocities + min(KEPT, count * times * velocities)
        at_once = min(count * grid.size, max(grid.size, count * FEW))
        found += item * (grid.ndim * (3 + dynamics.disturbance_dim) * at_once + arrays * (at_once - grid.size))
    return found


def read_window(arrays: Arrays, array: str, position: int, window: Grid) -> FloatArray:
    """The entry at `position` of an array at the nodes of a window: (*window.shape), to be read only.

    A view where the window lies in one piece, else a copy.

    array : "tubes", or "avoid_static" and "avoid_moving" where these depend on all axes.
    window : a `Grid`, or a part of one (`Grid.stretch`), which may reach around the ends of a periodic axis.
    """
    first = getattr(window, "first", (0,) * window.ndim)
    runs = [(begin, begin + n) for begin, n in zip(first, window.shape, strict=True)]
    return _around_ends(arrays, array, position, runs, getattr(window, "whole", window).shape)


def _around_ends(arrays: Arrays, array: str, position: int, runs: Runs, whole: tuple[int, ...]) -> FloatArray:
    """The nodes `runs` of the entry at `position` of an array, as `sdhj.table.store.Arrays.read` returns them.

    runs : (begin, end) for each axis. Past its length in `whole` an axis goes on at its first node; the pieces are then
        joined to a copy.
    whole : the shape of the grid.
    """
    for axis, (begin, end) in enumerate(runs):
        if end > whole[axis]:
            parts = ((begin, whole[axis]), (0, end - whole[axis]))
            cut = [[*runs[:axis], part, *runs[axis + 1 :]] for part in parts]
            found = [_around_ends(arrays, array, position, one, whole) for one in cut]
            return np.concatenate(found, axis=axis - len(runs))
    return arrays.read(array, position, runs)
