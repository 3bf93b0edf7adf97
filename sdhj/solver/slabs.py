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
    """How a danger's avoid game is played slab by slab: along which axis its grid is cut, where the problem's
    nodes begin on it, and how many nodes beside a slab are played on, too.
    """

    danger: Danger
    axis: int | None = None  # which axis of the danger's grid is cut; None where the game knows nothing of it
    begin: int = 0  # where the problem's first node lies on it
    halo: int = 0  # nodes beside a slab
    counted: Mapping[Axes, Any] = {}  # as `HJIGames.counted`


@dataclass(frozen=True, eq=False)
class Plan:
    """How a solve is cut into slabs, and what games are played on them: all that solving a slab takes beside its
    arrays. It is sent to other processes, without `kept`, what one process needs time and again.

    make : creates the games of one interval, as `sdhj.HJI.on` does.
    """

    problem: ReachAvoidProblem
    make: Callable[..., Games]
    dtype: str
    games: tuple[AvoidGame, ...]
    axis: int = 0  # that is cut
    width: int = 0  # nodes of a slab; 0: all
    halo: int = 0  # nodes beside it in the games of being in a set
    counted: Mapping[Axes, Any] = field(default_factory=dict)  # as `HJIGames.counted`
    former: Any = None  # an earlier solve in this process, of which what cannot differ is copied
    kept: dict[str, Any] = field(default_factory=dict, init=False)  # what one slab needs time and again

    def __reduce__(self) -> Any:  # without what was kept
        """Pickle the fields that are given; the games that have been made are not sent."""
        return Plan, tuple(getattr(self, one.name) for one in fields(self) if one.init)

    @cached_property
    def avoid(self) -> dict[str, list[AvoidGame]]:
        """The avoid games by the array of their tubes: "avoid_static", which are the same at all steps, and
        "avoid_moving".
        """
        kinds = {"avoid_static": False, "avoid_moving": True}
        return {name: [game for game in self.games if game.danger.moves == moves] for name, moves in kinds.items()}

    @cached_property
    def layout(self) -> Shapes:
        """The shapes of the table's arrays, and how they are cut into slabs along `axis`."""
        axes = {name: {i for game in games for i in game.danger.axes} for name, games in self.avoid.items()}
        ascending = {name: tuple(sorted(some)) for name, some in axes.items()}
        width = self.width or self.problem.grid.shape[self.axis]
        return Shapes.of(self.problem, self.dtype, self.axis, width, ascending)

    @cached_property
    def whole(self) -> Any:
        """The games on the whole, padded grid; made once. They are those of the only slab."""
        return self.make(self.problem.padded)

    def slab(self, number: int) -> Grid:
        """The grid of slab `number`, without its halo."""
        return slab_window(self.problem.grid, self.axis, self.layout.span(number), 0)[0]

    def window(self, number: int) -> tuple[Grid, slice]:
        """The grid of slab `number` with its halo, and where along the cut axis of it the slab is."""
        return slab_window(self.problem.grid, self.axis, self.layout.span(number), self.halo)

    def play(self, number: int) -> tuple[Grid, Any]:
        """The grid of slab `number` with its halo, and new games on it; of the only slab the problem's grid, and
        `whole`, which are kept.
        """
        if self.layout.slabs == 1:
            return self.problem.grid, self.whole
        window, kept = self.window(number)
        return window, self.make(self.problem.on(window), counted=self.counted, wanted={self.axis: kept})

    def play_avoid(self, game: AvoidGame, number: int) -> tuple[Any, tuple[slice, ...]]:
        """The games that an avoid game is played by on slab `number`, on its halo too, and the index of the slab in the
        tubes that they return. Games that know nothing of the cut are played on all of their grid.
        """
        problem, inside = game.danger.problem, game.danger.inside
        if problem is self.problem.padded and self.layout.slabs == 1:
            return self.whole, inside
        if game.axis is None:
            return self.make(problem), inside
        first, end = self.layout.span(number)
        part, kept = slab_window(problem.grid, game.axis, (game.begin + first, game.begin + end), game.halo)
        cut = game.danger.axes.index(self.axis)
        games = self.make(problem.on(part), counted=game.counted, wanted={game.axis: kept})
        return games, (*inside[:cut], slice(None), *inside[cut + 1 :])


class Task(NamedTuple):
    """What is to be computed and written on one slab: a tube (k, n), the target's entry (k, 0), or the avoid
    tubes of a step. Places are those of tubes among the stored ones.
    """

    kind: str  # "goal", "extend", "avoid_static" or "avoid_moving"
    step: int
    place: int  # of the tube (step, within) among the stored ones, or of the avoid tubes
    before: int = 0  # ... (step, within - 1)
    after: int = 0  # ... (step + 1, within - 1)
    slab: int = 0

    @property
    def array(self) -> str:
        """The name of the array that is written: "tubes", "avoid_static" or "avoid_moving"."""
        return "tubes" if self.kind in ("goal", "extend") else self.kind

    @property
    def written(self) -> Slab:
        """The place in the arrays that is written."""
        return Slab(self.array, self.place, self.slab)


# ---- how wide a halo is


def nodes_read_in_a_step(scheme: Scheme) -> int:
    """How many nodes to each side a whole time step of a scheme reads: those of a stage times the number of stages."""
    return math.prod(scheme.reads)


def time_steps(method: Any, problem: ReachAvoidProblem, axes: Axes) -> Mapping[Axes, Any]:
    """{axes: time steps for each input} that games of method "hji" on these axes take on the whole grid, a list (L,);
    {} where each slab finds the same by itself: for other methods, and velocities that do not depend on the state.
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
    """How many nodes beside a slab, along `axis`, `games.reach` needs for right values on it. counted : see
    `HJIGames.counted`.
    """
    problem = games.problem
    if isinstance(games, HopfLaxGames):
        return nodes_read(float(games.reads[axis]))
    if games.moving_frame:
        steps = games.velocities(0, games.axes, 0, False).steps(games.grid, games.duration, games.scheme.cfl)
        drift, spacing = np.abs(problem.dynamics.arrays[0][:, axis]).max(), games.grid.spacing[axis]
        reached = max(nodes_read_in_a_step(games.scheme) * steps, nodes_read(float(games.pushed[axis]) / spacing))
        return reached + nodes_read(float(drift) * games.duration / spacing)
    return nodes_read_in_a_step(games.scheme) * _most_time_steps(games, games.axes, counted)


def avoid_halo(games: HJIGames | HopfLaxGames, axes: Axes, axis: int, counted: Mapping[Axes, Any]) -> int:
    """How many nodes beside a slab, along `axis`, `games.avoid` needs for right values on it, played on `axes`. counted
    : see `HJIGames.counted`.
    """
    if isinstance(games, HopfLaxGames) or games.by_formula(axes):
        speed = np.abs(games.problem.interval(0).extremes(0.0))[..., axis].max()
        more = 2 * games.problem.interval(0).segments(axes).shape[1]  # as in `HopfLaxGames.reads`
        return nodes_read(float(speed) * games.duration / games.problem.grid.spacing[axis] + more)
    return nodes_read_in_a_step(games.scheme) * _most_time_steps(games, axes, counted)


def _most_time_steps(games: HJIGames, axes: Axes, counted: Mapping[Axes, Any]) -> int:
    """The time steps of the input that needs most, on some axes: from `counted` where it has them, else as the games
    find.
    """
    return max(1, *counted[axes]) if axes in counted else games.steps(axes, 0)


def in_slabs(method: Any, problem: ReachAvoidProblem, danger: Danger, axis: int) -> AvoidGame:
    """The avoid game `danger` of a problem, as the method plays it, cut into slabs along an axis of the problem's
    grid: whole where its grid lacks that axis, else with the halo that it needs.
    """
    if axis not in danger.axes:
        return AvoidGame(danger)
    whole, place = danger.problem, danger.axes.index(axis)
    cut, axes = axis if whole is problem else place, whole.avoid_axes(danger.unsafe_set)
    counted = time_steps(method, whole, axes)
    halo = avoid_halo(method.on(whole), axes, cut, counted)
    return AvoidGame(danger, cut, danger.inside[place].start or 0, halo, counted)


def slab_window(grid: Grid, axis: int, span: tuple[int, int], halo: int) -> tuple[Grid, slice]:
    """The window of a slab, the nodes span[0] to span[1] - 1 of an axis, with `halo` nodes on both sides, as far as the
    grid goes; and the slice of the slab in it along the axis. Where a periodic window would meet itself it is the grid.
    """
    (begin, end), n = (span[0] - halo, span[1] + halo), grid.shape[axis]
    if not grid.periodic[axis]:
        begin, end = max(begin, 0), min(end, n)
    if end - begin >= n:
        begin, end = 0, n
    return grid.stretch(axis, begin % n, end - begin), slice(span[0] - begin, span[1] - begin)


def bytes_of_games(problem: ReachAvoidProblem, grid: Grid, dtype: str, arrays: int = 12, times: int = 1) -> int:
    """Upper estimate of the bytes that the games of one interval on `grid` take at their peak.

    That is what is sampled; stages with their ghost nodes and shifted copies, as `arrays` arrays of the grid's size and
    `dtype`; and velocities that depend on the state, which are kept for all inputs, at so many `times`, up to `KEPT`;
    on small grids all inputs are solved at once (`HJIGames.groups`). Never is more stated for a smaller grid.
    """
    dynamics, axes, item, count = problem.dynamics, range(grid.ndim), np.dtype(dtype).itemsize, len(problem.inputs)
    found = grid.sampling_bytes + arrays * item * grid.size
    if not dynamics.stateless:
        whole = not dynamics.formulas or dynamics.gain is None or dynamics.couples(axes)
        each = 8 * (2 * dynamics.adversaries + 6) if whole else 12  # boxes lie on the axes that they read
        each += 8 * (3 + grid.ndim) * (math.prod(dynamics.cuts(axes)) - 1)
        velocities = each * grid.ndim * grid.size
        found += velocities + min(KEPT, count * times * velocities)
        at_once = min(count * grid.size, max(grid.size, count * FEW))
        found += item * (grid.ndim * (3 + dynamics.adversaries) * at_once + arrays * (at_once - grid.size))
    return found


def read_window(arrays: Arrays, array: str, place: int, window: Grid) -> FloatArray:
    """The block `place` of an array (its name: "tubes", ...) at the nodes of a window, around periodic ends too:
    (*window.shape). A view where it is in one piece.
    """
    first = getattr(window, "first", (0,) * window.ndim)
    runs = [(begin, begin + n) for begin, n in zip(first, window.shape, strict=True)]
    return _around_ends(arrays, array, place, runs, getattr(window, "whole", window).shape)


def _around_ends(arrays: Arrays, array: str, place: int, runs: Runs, whole: tuple[int, ...]) -> FloatArray:
    """The part of a block (a place of an array, by its name) with nodes `runs`, (begin, end) of each axis of a
    grid of shape `whole`; an end past the upper one of a periodic axis goes on at its lower one, where pieces are
    joined to a copy.
    """
    for axis, (begin, end) in enumerate(runs):
        if end > whole[axis]:
            parts = ((begin, whole[axis]), (0, end - whole[axis]))
            cut = [[*runs[:axis], part, *runs[axis + 1 :]] for part in parts]
            found = [_around_ends(arrays, array, place, one, whole) for one in cut]
            return np.concatenate(found, axis=axis - len(runs))
    return arrays.read(array, place, runs)
