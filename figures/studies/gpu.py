"""The game of Sec. 4.1 on a graphics card: what the library's own functions take to run there, and how fast they are.

`python figures/studies/gpu.py` plays the arm's case study at 25^4 and at 40^4 nodes by method "hji" on a card of
NVIDIA's, by numba-cuda, and on the processor with several numbers of threads, and compares every mark. Differences,
numerical Hamiltonians and interpolation are the functions of `sdhj.kernels`, compiled for the card as they stand;
written here is what differs there: which thread does what, where arrays lie, and in which order the table is filled in.
All sets of one row of the table, which depend on the row below alone, are solved abreast, and joined to one another in
the end.

The card computes as the processor does once it is told not to fuse multiplications and additions (`as_written`): the
tables then agree to the last bit. `rivals.py` keeps what was measured. Where no card is, NUMBA_ENABLE_CUDASIM=1 and
NUMBA_DISABLE_JIT=1 simulate one, for few nodes.

It is for problems in the moving frame without safe or unsafe ends, of which what moves depends on the leading axes.
"""

import argparse
import functools
import math
import platform
import time
from collections.abc import Callable, Sequence
from importlib import metadata
from typing import Any

import numba
import numpy as np
from numba import cuda

import sdhj
from sdhj.arm.case_studies import arm_case_study
from sdhj.kernels import FloatArray
from sdhj.kernels.boxes import over_interval
from sdhj.kernels.compiling import choice, inlined
from sdhj.kernels.stages import DIFFERENCES, HAMILTONIANS, _kept, _runs_of_axes, _sum_hamiltonians
from sdhj.problem.boxes import _leaves, _maxima_by_axis
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.solver.games import HJIGames, ObstacleFunction
from sdhj.solver.schemes import STAGES, Scheme, layout_of, terms_of
from sdhj.table.table import LookupTable

THREADS = 128  # of a block
RUN = 4  # numbers that a thread takes the maxima of, so that it finds out once where the interval ends
ROOM = 8  # sets that a row of the table has at most
SPECIAL: dict[Any, Any] = {}  # kernels, for the kind of arguments that they are called with
NEAR = 1e-6  # a mark of a value that near to zero may differ where additions are fused
# at link time the two would be fused whatever the compiler was told; `cuda.jit(lto=False)` forgets its option
kernel = cuda.jit if numba.config.ENABLE_CUDASIM else functools.partial(cuda.jit, lto=False)
_inlined = inlined()


# ---- what each thread of the card does: the nodes t, t + threads, ... of some sets, which lie one behind the other


@_inlined
def _source(t, layout):
    """Plane, row and column of the node whose value belongs at place t of padded values: its own, or a ghost's."""
    line = t // layout.width
    column = t - line * layout.width - layout.ghosts
    plane = line // (layout.rows + 2 * layout.top)
    row = layout.source[line - plane * (layout.rows + 2 * layout.top)]
    if layout.periodic:
        return plane, row, (column + layout.nodes) % layout.nodes
    return plane, row, min(max(column, 0), layout.nodes - 1)


@kernel
def pad(out, values, layout, count):
    """Values with ghost nodes, as `sdhj.kernels.stages.Layout` has them."""
    for t in range(cuda.grid(1), count, cuda.gridsize(1)):
        plane, row, column = _source(t, layout)
        out[t] = values[(plane * layout.rows + row) * layout.nodes + column]


@kernel
def inner(out, padded, layout, sets, count):
    """Values without ghost nodes, of all sets side by side at each node."""
    rows, size = layout.rows + 2 * layout.top, padded.size // sets
    for t in range(cuda.grid(1), count, cuda.gridsize(1)):
        node = t // sets
        line = node // layout.nodes
        plane, column = line // layout.rows, node - line * layout.nodes
        row = line - plane * layout.rows + layout.top + plane * rows
        out[t] = padded[(t - node * sets) * size + row * layout.width + layout.ghosts + column]


@kernel
def stage(out, phi, shape, velocities, scheme, layout, step, count):
    """As `sdhj.kernels.stages.stage`. A ghost node is computed like the node that it stands for, by another thread."""
    (dt, keep), planes, zero = step, layout.near.shape[0], step[0] - step[0]
    size = (layout.rows + 2 * layout.top) * layout.width
    for t in range(cuda.grid(1), count, cuda.gridsize(1)):
        place, row, column = _source(t, layout)
        first, plane = place // planes * planes * size, place % planes
        start = first + (row + layout.top) * layout.width + column + layout.ghosts
        c, node = phi[start + plane * size], np.uint64(0)
        axes = _runs_of_axes(shape, layout.near[plane], start, start - first + plane * size, velocities)
        raised = c + dt * _sum_hamiltonians(axes, zero, phi, velocities[0], scheme, c, node)
        out[t] = _kept(keep, out[t]) + (type(dt)(1.0) - keep) * raised


@kernel
def maxima(out, values, leaves, raised, count):
    """As `maximum_of_intervals`, with all sets side by side behind the axis; some numbers for each thread."""
    _, before, nodes, behind = out.shape
    runs = (behind + RUN - 1) // RUN
    for t in range(cuda.grid(1), count, cuda.gridsize(1)):
        line = t // runs
        row, start = line // nodes, (t - line * runs) * RUN
        node, leaf, stop = line - row * nodes, row // before, min(start + RUN, behind)
        a = row - leaf * before
        source, found = values[leaves.parent[leaf], a], out[leaf, a, node]
        over_interval(found[start:stop], source, start, stop, node, leaves.which[leaf], leaves, raised)


@kernel
def union(tubes, marks, values, leaves, static, moving, step, edge, count):
    """As `add_inputs` of all inputs, of all sets of a row: tubes (1 + sets, nodes), of which the first is not written.

    marks (sets, bytes, nodes), values (functions, A, n, B sets), static (L, nodes), moving (L, leading nodes, steps).
    """
    found, least = cuda.local.array(ROOM, np.float32), cuda.local.array(ROOM, np.float32)
    byte, (sets, _, size), number = cuda.local.array(ROOM, np.uint8), marks.shape, leaves.parent.size
    n, behind, apart = values.shape[2], values.shape[3] // sets, size // moving.shape[1]
    for node in range(cuda.grid(1), count, cuda.gridsize(1)):
        line = node // behind
        start, a, place = (node - line * behind) * sets, line // n, node // apart
        for one in range(sets):
            least[one], byte[one] = np.inf, 0
        for j in range(number):
            source, stop = values[leaves.parent[j], a], start + sets
            over_interval(found[:sets], source, start, stop, line - a * n, leaves.which[j], leaves, np.bool_(False))
            obstacle = max(static[j, node], moving[j, place, step])
            for one in range(sets):
                value = max(found[one], obstacle)
                least[one] = min(least[one], value)
                byte[one] |= np.uint8(1 << (j & 7)) if value <= edge else np.uint8(0)
            for one in range(sets if j & 7 == 7 or j == number - 1 else 0):
                marks[one, j >> 3, node], byte[one] = byte[one], 0
        tube = tubes[0, node]
        for one in range(sets):
            tube = min(tube, least[one])
            tubes[1 + one, node] = tube


# ---- what is asked of the card


def as_written() -> None:
    """Let no multiplication and addition be fused from now on: the option has to be handed past Numba."""
    if not numba.config.ENABLE_CUDASIM:
        from numba.cuda.cudadrv import nvvm

        nvvm.compile_ir = functools.partial(nvvm.compile_ir, fma=False)


def launch(one: Any, count: int, *arguments: Any) -> None:
    """Run a kernel with so many threads; a simulated card has one.

    Each is called with one kind of arguments only: to look at them again would take ten times as long as the launch.
    """
    if numba.config.ENABLE_CUDASIM:
        one[1, 1](*arguments, count)
        return
    if one not in SPECIAL:
        SPECIAL[one] = one.specialize(*arguments, count)
    SPECIAL[one][-(-count // THREADS), THREADS](*arguments, count)


def on_card(some: Any) -> Any:
    """A named tuple with its arrays on the card."""
    return type(some)(*(cuda.to_device(one) if isinstance(one, np.ndarray) else one for one in some))


class Game:
    """The arm's whole game on the card: samples of the sets, what it reads otherwise, and room for what it writes."""

    def __init__(self, problem: ReachAvoidProblem, scheme: Scheme | None = None) -> None:
        self.problem, self.grid, self.scheme = problem, problem.grid, scheme or Scheme()
        self.games = games = HJIGames(problem, self.scheme)
        assert games.shifted and games.uses_hopf_lax(games.axes) and not problem.has_no_target and not problem.sensing
        assert not any(self.grid.has(fate) for fate in ("frees", "fails")) and problem.view_time == "swept"
        self.steps, self.count, self.size = problem.steps or 0, len(problem.inputs), self.grid.size
        still: Any = games.velocities(0, games.axes, 0, drift=False)
        layout = layout_of(self.grid, self.scheme.order)
        terms = terms_of(self.grid, layout, still, self.scheme.dtype)
        self.pieces, self.time_steps = (
            games.formula.pieces(list(games.axes)),
            still.steps(self.grid, games.duration, self.scheme.cfl),
        )
        self.padded = layout.near.shape[0] * (layout.rows + 2 * layout.top) * layout.width
        self.layout, self.velocities = on_card(layout), tuple(map(cuda.to_device, terms))
        self.known: dict[Any, Any] = {}
        self.room: dict[tuple[Any, ...], Any] = {}

    def sample(self) -> None:
        """Sample the sets on the processor: targets, and of each step what is to be avoided."""
        problem, steps = self.problem, range(self.steps)
        self.goals = [problem.goal(step).astype(np.float32).reshape(1, -1) for step in range(self.steps + 1)]
        (moves,), (still,) = (
            [part for part in problem.unsafe if problem.moves(part) == kind] for kind in (True, False)
        )
        obstacles = [ObstacleFunction.of(problem, part, problem.avoid_axes(part)) for part in (moves, still)]
        assert obstacles[0].axes == tuple(range(len(obstacles[0].axes))) and obstacles[1].axes == self.games.axes
        # rounded alike
        lasts = self.games.duration * (pieces := self.games.formula.pieces([*obstacles[0].axes])) / pieces
        begun = [problem.span(step)[0] for step in steps]
        spans = [[(t, t + lasts) for t in begun], [problem.span(0)]]
        self.walls = [
            (obstacle.axes, np.stack([obstacle.values_over(*span) for span in some]).astype(np.float32))
            for obstacle, some in zip(obstacles, spans, strict=True)
        ]

    def upload(self) -> None:
        """Copy the samples to the card."""
        flat = [(axes, np.ascontiguousarray(values.reshape(len(values), -1).T)) for axes, values in self.walls]
        self.sampled = [(axes, cuda.to_device(values.reshape(-1))) for axes, values in flat]
        self.tubes = [self._room("tubes", step, (1 + self.steps - step) * self.size) for step in range(self.steps + 1)]
        for tubes, goal in zip(self.tubes, self.goals, strict=True):
            tubes[: self.size].copy_to_device(goal.reshape(-1))

    def play(self, edge: float = 0.0) -> None:
        """The avoid tubes, and the table row by row; an input is marked where its value is at most `edge`."""
        self.avoid()
        for step in reversed(range(self.steps)):
            self.unite(step, self.evolve(self.tubes[step + 1], self.steps - step), edge)

    def avoid(self) -> None:
        """The avoid tubes: moving (L, leading nodes, steps), static (L, nodes)."""
        (axes, moving), (every, static) = self.sampled
        self.moving = self._avoid(self.steps, axes, moving).reshape(self.count, -1, self.steps)
        self.static = self._avoid(1, every, static).reshape(self.count, -1)

    def unite(self, step: int, still: Any, edge: float = 0.0) -> None:
        """A row of the table, of its reach games in the moving frame."""
        sets, shift = self.steps - step, self.games.drift * self.games.duration
        (leaves, _), values = self._most(still, sets, self.games.axes, shift, shift)
        tubes, obstacles = self.tubes[step].reshape(1 + sets, self.size), (self.static, self.moving, step)
        launch(union, self.size, tubes, self.marks(step), values, leaves, *obstacles, np.float32(edge))

    def evolve(self, values: Any, sets: int) -> Any:
        """The reach game of some sets without the drift."""
        phi, work = (self._room(name, 0, self.padded * self.steps) for name in ("phi", "work"))
        out, stages = self._room("still", 0, self.size * self.steps), STAGES[self.scheme.integrator]
        assert stages == STAGES["rk2"]
        launch(pad, sets * self.padded, phi, values, self.layout)
        for _ in range(self.time_steps):
            self.stage(work, phi, 0.0, sets)
            self.stage(phi, work, 0.5, sets)
        launch(inner, sets * self.size, out, phi[: sets * self.padded], self.layout, sets)
        return out

    def stage(self, out: Any, phi: Any, keep: float, sets: int) -> None:
        """One Runge-Kutta stage of some sets."""
        scheme = choice(DIFFERENCES, self.scheme.order), choice(HAMILTONIANS, self.scheme.flux)
        step = np.float32(self.games.duration / self.time_steps), np.float32(keep)
        launch(stage, sets * self.padded, out, phi, self.grid.shape, self.velocities, scheme, self.layout, step)

    def _avoid(self, sets: int, axes: Sequence[int], values: Any) -> Any:
        """The avoid tubes of sampled sets by the Hopf-Lax formula, as `HopfLaxGames` has them."""
        formula, interval, pieces = self.games.formula, self.problem.interval(0), self.games.formula.pieces(list(axes))
        out = self._room("avoid", len(axes), self.count * sets * self.grid.subgrid(axes).size)
        for piece in range(pieces):
            low, high, halves = formula._displacement_sets_in_piece(interval, list(axes), piece, pieces)
            assert not halves.any()  # no component of v moves several axes
            (leaves, axis), found = self._most(values, sets, axes, low, high)
            self._maxima(self._split(out, self.count, sets, axes, axis), found, leaves, piece > 0)
        return out

    def _most(self, values: Any, sets: int, axes: Sequence[int], low: FloatArray, high: FloatArray) -> Any:
        """Maxima over boxes, done but for the last level, as `sdhj.problem.boxes.maxima`: the level, and the values."""
        ((_, levels),) = _maxima_by_axis(np.stack([low, high], axis=2).astype(float).tobytes(), self.count, 2**30)
        functions, grid = 1, self.grid.subgrid(axes)
        for depth, level in enumerate(levels):
            if (key := (level, tuple(axes))) not in self.known:
                self.known[key] = on_card(_leaves(level, grid, True, "<f4", 0, grid.shape[level.axis]))
            leaves, split = self.known[key], self._split(values, functions, sets, axes, level.axis)
            if level is levels[-1]:
                return (leaves, level.axis), split
            functions = len(level.parent)
            values = self._room("level", (depth, len(axes)), functions * sets * grid.size)
            self._maxima(self._split(values, functions, sets, axes, level.axis), split, leaves, False)

    def _maxima(self, out: Any, values: Any, leaves: Any, raised: bool) -> None:
        launch(maxima, math.prod(out.shape[:3]) * -(-out.shape[3] // RUN), out, values, leaves, np.bool_(raised))

    def _split(self, values: Any, number: int, sets: int, axes: Sequence[int], axis: int) -> Any:
        """So many functions of each set, with what lies before and behind an axis: (number, A, n, B sets)."""
        shape = [self.grid.shape[one] for one in axes]
        before, behind = math.prod(shape[:axis]), math.prod(shape[axis + 1 :]) * sets
        return values[: number * math.prod(shape) * sets].reshape(number, before, shape[axis], behind)

    def _room(self, name: str, kind: Any, size: int, dtype: Any = np.float32) -> Any:
        """An array of the card that is kept."""
        if (found := self.room.get((name, kind))) is None or found.size < size:
            found = self.room[name, kind] = cuda.device_array(size, dtype)
        return found

    def marks(self, step: int) -> Any:
        """The marks of a row of the table: (sets, bytes, nodes)."""
        shape = self.steps - step, -(-self.count // 8), self.size
        return self._room("marks", step, math.prod(shape), np.uint8).reshape(shape)


# ---- how long it takes, and whether it is right


def differing(game: Game, table: LookupTable) -> dict[str, float]:
    """How many marks of the processor's table the card's lack or have besides, and by how much tubes differ."""
    found: dict[str, float] = dict.fromkeys(("marks", "differ", "beyond", "by"), 0)
    rows = []
    for edge in (-NEAR, NEAR, 0.0):
        game.play(edge)
        rows.append([game.marks(step).copy_to_host() for step in range(game.steps)])
    for step, (least, most, marks) in enumerate(zip(*rows, strict=True)):
        tubes = game.tubes[step].copy_to_host().reshape(-1, *table.grid.shape)
        for within in range(1, game.steps - step + 1):
            mask = table.mark_array(step, within)
            beyond = (least[within - 1] & ~mask) | (mask & ~most[within - 1])
            found["marks"] += game.count * game.size
            found["differ"] += int(np.unpackbits(marks[within - 1] ^ mask).sum())
            found["beyond"] += int(np.unpackbits(beyond).sum())
            found["by"] = max(found["by"], float(np.abs(tubes[within] - table.value_array(step, within)).max()))
    return found


def seconds(call: Callable[..., Any], *arguments: Any, repeats: int = 20) -> tuple[float, float]:
    """Median seconds of a call, by the card's clock and by the processor's."""
    found = []
    for _ in range(repeats + 1):  # the first one compiles
        cuda.synchronize()
        events, started = (cuda.event(), cuda.event()), time.perf_counter()
        events[0].record()
        call(*arguments)
        events[1].record()
        events[1].synchronize()
        found.append((events[0].elapsed_time(events[1]) / 1e3, time.perf_counter() - started))
    card, clock = np.median(found[1:], axis=0).tolist()
    return card, clock


def many(call: Callable[..., Any], *arguments: Any, times: int = 100) -> float:
    """Seconds of one of many calls in a row, for those that take less than to ask for them: then of the asking."""
    return seconds(lambda: [call(*arguments) for _ in range(times)], repeats=3)[0] / times


def processor(problem: ReachAvoidProblem, threads: int, repeats: int) -> tuple[float, LookupTable]:
    """Median seconds of the library's solve with so many threads, and the table."""
    numba.set_num_threads(threads)
    found = []
    for _ in range(repeats):
        started = time.perf_counter()
        table = sdhj.solve(problem, progress=False, play=False)
        found.append(time.perf_counter() - started)
    return float(np.median(found)), table


def measure(nodes: int, threads: Sequence[int]) -> None:
    """Print a line for each thing that takes time, and the comparison."""
    problem = arm_case_study(nodes)
    game, last = Game(problem), problem.steps - 1
    started = time.perf_counter()
    game.sample()
    print(f"{nodes}^4: sets sampled {time.perf_counter() - started:.3f} s; {game.time_steps} time steps", flush=True)
    upload, play = seconds(game.upload, repeats=3), seconds(game.play)
    print(f"  upload {upload[1] * 1e3:.2f} ms, game {play[0] * 1e3:.2f} ms (clock {play[1] * 1e3:.2f})")
    back = seconds(lambda: [game.tubes[k].copy_to_host() for k in range(last)], repeats=2)
    print(f"  avoid tubes {seconds(game.avoid)[0] * 1e3:.2f} ms, tubes back {back[1] * 1e3:.1f} ms")
    for step in (last, 0):
        still = game.evolve(game.tubes[step + 1], last + 1 - step)
        phi, work = game.room["phi", 0], game.room["work", 0]
        one = many(game.stage, work, phi, 0.0, last + 1 - step)
        joined = many(game.unite, step, still)
        print(
            f"  {last + 1 - step} sets: a stage {one * 1e6:.1f} us, maxima and union {joined * 1e6:.1f} us", flush=True
        )
    for number in threads:
        took, table = processor(problem, number, 3)
        print(f"  processor, {number} threads: {took:.3f} s", flush=True)
    print(f"  {differing(game, table)}", flush=True)


def main() -> None:
    """Measure all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("nodes", type=int, nargs="*", default=[25, 40], help="nodes on each axis")
    parser.add_argument("--fused", action="store_true", help="let multiplications and additions be fused")
    given = parser.parse_args()
    if not given.fused:
        as_written()
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("numba", "numba-cuda", "numpy"))
    print(f"{cuda.get_current_device().name}, Python {platform.python_version()}, {versions}", flush=True)
    for nodes in given.nodes:
        measure(nodes, sorted({1, 2, numba.config.NUMBA_NUM_THREADS}))  # type: ignore[attr-defined]


if __name__ == "__main__":
    main()
