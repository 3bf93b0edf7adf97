"""The recursion of Theorem 2 (Algorithm 1): from the games of one interval to the look-up table.

    S_k^N = L(t_k) minus G(t_k),        S_k^i = S_k^{i+1}  united with  RA_k^j(S_{k+1}^{i+1})  for all inputs j

With n = N - i steps to go, the entry (k, n) follows from (k, n - 1) and (k + 1, n - 1). `recursion` implements this for
every kind of set: level-set functions on the grid (`GridSets`, for most methods), or cells with a proof.

Without a target, the entry (k, n) contains the states that can stay clear of G for n steps: those that some input keeps
clear for one step and leads into the entry (k + 1, n - 1). S_k^{i+1} is not united with them; the sets shrink with n.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np

from sdhj.kernels import FloatArray
from sdhj.kernels.union import AvoidRows, add_inputs
from sdhj.problem.boxes import Maxima
from sdhj.problem.cost import Cost, begin, multiplied
from sdhj.problem.findings import tell
from sdhj.problem.grid import Grid
from sdhj.problem.memory import require_memory
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sets import LARGEST, UnsafeSet
from sdhj.problem.uncertain import eroded_by_error, must_lead_into
from sdhj.solver.avoid import avoid_tubes_of, dangers, never_met_finding
from sdhj.solver.former import Former, Patch
from sdhj.solver.games import Axes, Games, HJIGames, Pieces, in_eights, past_ends
from sdhj.solver.resolution import check_crossing, check_resolution
from sdhj.solver.slabs import AvoidGame, Plan, Task, bytes_of_games, read_window
from sdhj.table.batches import Table
from sdhj.table.store import Memory, Store
from sdhj.table.table import AvoidTubes, LookupTable

PROCESS = 200_000_000  # bytes that Python, NumPy and the compiled kernels need before anything is solved
STEPS_COUNTED = 8  # steps at which it is looked what games cost that depend on time
LONG = 4096  # nodes: shorter rows are worth being joined, longer ones leave the first caches


class TubeSets(Protocol):
    """All tubes S_k with n steps to go, in some representation: the operations that Theorem 2 needs.

    `recursion` calls `write_goal` once for each step k, then `extend` or `repeat` for n = 1, 2, ... in order, and asks
    `unchanged` only of entries that have been filled in. `finish` is called last, once.

    Attributes
    ----------
    time_invariant : bool
        Whether nothing depends on time. There is then one row, k = 0, and the entry (k, n) is the entry (0, n) for
        every k.
    filled : int
        Only of sets that take problems with steps=None: the largest n that has been filled in.
    changing : float
        Only of sets that take problems with steps=None: the share of the state space, 0 to 1, that the last step
        changed.
    """

    time_invariant: bool

    def write_goal(self, step: int) -> None:
        """Write the entry (step, 0): the target minus the unsafe sets, at the time of the step."""

    def extend(self, step: int, within: int) -> None:
        """Write the entry (step, within) from (step, within - 1), (step + 1, within - 1) and the step's avoid tubes."""

    def unchanged(self, step: int, within: int) -> bool:
        """Whether the entries (step, within) and (step, within - 1), both filled in, are equal; within >= 1."""

    def repeat(self, step: int, within: int) -> None:
        """Make the entry (step, within) the same tube as the entry (step, within - 1), without computing anything."""

    def finish(self, details: Mapping[str, Any]) -> Table:
        """The table of all entries; the items of `details`, plain values by name, are added to the table's details."""


def recursion(sets: TubeSets, steps: int, done: Callable[[], Any]) -> None:
    """Fill in all entries (k, n) of `sets` with k + n <= steps (Theorem 2), in place.

    Rows k come from `steps` down to 0, and in a row n goes upwards. If nothing depends on time, only the row k = 0 is
    filled in. If the entries (k + 1, n - 1) and (k + 1, n - 2) are equal, so are (k, n) and (k, n - 1), and
    `sets.repeat` is called instead of `sets.extend`. A row with a shared entry may grow again, for example if the
    target appears late. `done()` is called, and what it returns is ignored, after each entry with n >= 1.
    """
    for step in (0,) if sets.time_invariant else range(steps, -1, -1):
        sets.write_goal(step)
        for within in range(1, steps - step + 1):
            if within >= 2 and sets.unchanged(step + 1, within - 1):
                sets.repeat(step, within)
            else:
                sets.extend(step, within)
            done()


def memory_needed(problem: ReachAvoidProblem, dtype: str = "float32") -> int:
    """Upper estimate of the bytes that a solve in memory by a method on the grid needs at its peak, in one slab.

    It includes the process itself, the table, the avoid tubes, samples and intermediate results, but not what the
    problem's own functions allocate. dtype : of the values, "float32" or "float64".
    """
    grid, count, dynamics, found = problem.grid, len(problem.inputs), problem.dynamics, dangers(problem)
    layout = Plan(problem, HJIGames, dtype, tuple(map(AvoidGame, found))).layout
    past, times = past_ends(problem, range(grid.ndim)) if dynamics.constant else (0,) * grid.ndim, 1
    # a game of avoiding the ends of an axis is played on a grid that is as much wider as an interval leads
    wide = [danger.problem.grid for danger in found if danger.problem.grid != grid]
    copied = np.dtype(dtype).itemsize * count * max([0, *(one.size for one in wide)])
    if dynamics.depends_on_time and not dynamics.stateless:  # of an interval at a time, at each of its time steps
        speeds = np.max([problem.interval(step).speeds for step in {0, problem.steps - 1}], axis=0)
        times += math.ceil(2 * problem.interval(0).delta * float(np.sum(speeds / np.array(grid.spacing))))
    arrays = 12 + (count if problem.sensing.jitter else 0)  # the reach sets of all inputs, while an interval may end
    played = (bytes_of_games(problem, one, dtype, arrays, times) for one in (grid.extended(past), *wide))
    return PROCESS + layout.nbytes + copied + max(played)


def cost_on_grid(plan: Plan, nbytes: int, disk: int = 0) -> Cost | None:
    """The cost of a solve by the model of `sdhj.problem.cost`; None if the games have no `operations`.

    The halos of slabs are included. nbytes, disk : the bytes of memory and of disk that the solve takes, only copied
    into the `Cost`. Warns (`check_crossing`) where the state crosses so many cells in an interval that a unit must be
    wrong.
    """
    problem, slabs = plan.problem, plan.layout.slabs
    games: Any = plan.whole_games if slabs == 1 else plan.make_games(problem, counted=plan.counted)
    if not hasattr(games, "operations"):
        return None
    played, steps, timed = problem.padded, problem.steps, problem.dynamics.depends_on_time
    looked = range(0, steps, -(-steps // STEPS_COUNTED)) if timed else range(1)

    def share(grid: Grid, axis: int | None, halo: int) -> float:
        """How much larger all slabs with their halos are than the grid: slabs (width + 2 halo) / nodes along `axis`.

        It is 1 where there is one slab, and where `axis`, along which this grid is cut, is None.
        """
        n = 1 if axis is None or slabs == 1 else grid.shape[axis]
        return 1.0 if n == 1 else slabs * min(plan.layout.width + 2 * halo, n) / n

    tubes, once, crossed = steps if problem.time_invariant else steps * (steps + 1) // 2, 0.0, 0.0
    for danger, axis, _, halo, counted in plan.games:
        own = danger.problem
        playing: Any = games
        if own is not played or slabs > 1:
            playing = plan.make_games(own, counted=counted) if counted else plan.make_games(own)
        each = [playing.operations(own.avoid_axes(danger.unsafe_set), step, avoid=True) for step in looked]
        once += float(np.mean(each)) * share(own.grid, axis, halo) * (steps if danger.moves else 1)
        crossed = max(crossed, playing.crossed)
    whole, shared = tuple(range(problem.grid.ndim)), share(problem.grid, plan.axis, plan.halo)
    each = [games.operations(whole, step) * shared + len(problem.inputs) * problem.grid.size for step in looked]
    crossed = max(crossed, games.crossed)
    check_crossing(problem, crossed)
    why = multiplied(problem, tubes, problem.grid.size, "nodes") + (f", in {slabs} slabs" if slabs > 1 else "")
    return Cost(once + tubes * float(np.mean(each)), nbytes, tubes, once, crossed, why, disk)


def no_avoid_tubes(problem: ReachAvoidProblem, dtype: str) -> AvoidTubes:
    """The avoid tubes of a problem with nothing to avoid: on no axes, -inf; static (L,) and moving (most_steps, L)."""
    count = len(problem.inputs)
    return AvoidTubes((), np.full(count, -np.inf, dtype), (), np.full((problem.most_steps, count), -np.inf, dtype))


class InputRows:
    """The grid and the avoid tubes in the form in which the kernel `add_inputs` reads them; `add` calls it.

    The grid is cut into R rows. A row is all nodes of the last one or more axes. As many axes are joined as the avoid
    tubes allow: each avoid tube depends on all of the joined axes or on none of them, so that in a row it is one value,
    or a row of numbers that other rows of the grid may share.

    Attributes
    ----------
    grid : Grid
    tubes : AvoidTubes
        Those that were given; only `tubes.moving` is read later, by `add`.
    last : int
        How many of the last axes a row joins.
    size : int
        Nodes of a row.
    all_rows : (R,) int array
        The numbers of all rows.
    row_widths : list of int
        For the static and for the moving avoid tubes: numbers that they have for a row, `size` or 1.
    static : (L, parts, row_widths[0]) array
        The static avoid tubes, a view.
    highest : (L, parts) array
        The largest value in each part of `static`.
    static_at, moving_at : (R,) int arrays
        For each row the part of the static or of the moving avoid tubes that belongs to it.
    """

    def __init__(self, grid: Grid, tubes: AvoidTubes) -> None:
        """Choose the rows; more axes are joined only up to half of the axes, or up to `LONG` nodes."""
        self.grid, self.tubes, last = grid, tubes, 1
        axes = tubes.static_axes, tubes.moving_axes
        for more in range(2, grid.ndim + 1):
            trailing = set(range(grid.ndim - more, grid.ndim))
            fits = more <= grid.ndim // 2 or math.prod(grid.shape[-more:]) <= LONG
            if fits and all(trailing <= set(some) or not trailing & set(some) for some in axes):
                last = more
        self.last, self.size = last, math.prod(grid.shape[-last:])
        self.all_rows = np.arange(grid.size // self.size)
        self.row_widths = [self.size if grid.ndim - 1 in some else 1 for some in axes]
        self._known_lines: dict[tuple[tuple[Axes, ...], int], tuple[Any, ...]] = {}
        self.static = tubes.static.reshape(len(tubes.static), -1, self.row_widths[0])
        self.highest = self.static.max(axis=2)
        self.static_at, self.moving_at = (self._part_at(some, last) for some in axes)

    def as_rows(self, values: FloatArray, lead: int = 0) -> FloatArray:
        """A view in rows, (lead..., R, size), of values (lead..., *shape) with `lead` axes before those of the grid."""
        return values.reshape(*values.shape[:lead], -1, self.size)

    def _part_at(self, axes: Axes, last: int = 1) -> FloatArray:
        """For each part of the grid, the number of the part of a function that belongs to it: (parts,) int, new.

        axes : the axes of the grid that the function depends on.
        last : of how many of the grid's last axes a part has all nodes. Parts of the grid are in C order over its other
            axes; parts of the function are numbered in C order over those of these that it depends on.
        """
        leading = self.grid.shape[: self.grid.ndim - last]
        shape = [n if axis in axes else 1 for axis, n in enumerate(leading)]
        numbers = np.arange(math.prod(shape)).reshape(shape)
        # a copy: `add_inputs` would be compiled once more for a view, which may not be written to
        return np.broadcast_to(numbers, leading).flatten()

    def _lines(self, axes: tuple[Axes, ...], number: int) -> tuple[Any, ...]:
        """Where the kernel `add_inputs` finds reach sets that are given in pieces: (begin, at, width, nodes).

        The pieces lie one after the other in a flat array. A line of the grid is all nodes of its last axis or, if
        there is one piece, on all axes, a row; `nodes` is how many. The values of piece p and input j begin at
        begin[p, j]; of them, width[p] (1 or `nodes`) are for one line, and at[p, i] says which these are for line i of
        the grid. Computed once for each pair of arguments.

        axes : for each piece the axes that it depends on. number : of how many inputs each piece has the functions.
        """
        if (axes, number) not in self._known_lines:
            last, whole = self.grid.ndim - 1, axes == (tuple(range(self.grid.ndim)),)
            nodes = self.size if whole else self.grid.shape[-1]
            at = np.arange(self.grid.size // nodes)[None] if whole else np.stack([self._part_at(some) for some in axes])
            sizes = [self.grid.subgrid(some).size for some in axes]
            ends = np.cumsum([0, *(number * size for size in sizes[:-1])])
            starts = ends[:, None] + np.outer(sizes, np.arange(number))
            widths = np.array([nodes if last in some else 1 for some in axes])
            self._known_lines[axes, number] = starts, at, widths, nodes
        return self._known_lines[axes, number]

    def of_planes(self, planes: FloatArray) -> FloatArray:
        """The numbers (R',) of the rows that have nodes in the marked planes, `planes` (*shape[:-2]) bool."""
        axes, lead = self.grid.ndim - self.last, planes.ndim
        if axes > lead:  # lines
            planes = np.broadcast_to(planes[..., None], self.grid.shape[:axes])
        return np.flatnonzero(planes.any(axis=tuple(range(axes, lead))))

    def add(
        self,
        tube: FloatArray,
        marks: FloatArray,
        reach_sets: Maxima | Pieces,
        step: int,
        start: FloatArray,
        some: FloatArray | None = None,
    ) -> None:
        """Write the union of `start` and of the reach-avoid sets of some inputs into `tube`, and mark these inputs.

        The value of input j is max(reach_j, avoid_j), and tube = min(start, values of these inputs). The kernel
        `add_inputs` computes it, in place.

        tube : (*shape), contiguous, written over.
        marks : (bytes, *shape) uint8. Bit j % 8 of byte j // 8 says whether the value of input j is <= 0; the bits of
            these inputs have to be 0 before.
        reach_sets : level-set functions of the reach sets of successive inputs.
        step : the position of the interval's step in `tubes.moving`.
        start : (*shape), may be `tube` itself.
        some : the numbers of the rows in which this is done, by default all; other rows of `tube` and `marks` stay.
        """
        behind = math.prod(self.grid.shape[reach_sets.axis + 1 :]) if isinstance(reach_sets, Maxima) else 0
        if isinstance(reach_sets, Maxima) and behind % self.size:
            reach_sets = Pieces(reach_sets.first, self.grid, [reach_sets.of()], [tuple(range(self.grid.ndim))])
        if isinstance(reach_sets, Maxima):
            found: tuple[Any, ...] = (reach_sets.split, *reach_sets.leaves)
        else:
            flat = reach_sets.pieces[0].reshape(-1) if reach_sets.flat is None else reach_sets.flat
            found = (flat, *self._lines(tuple(reach_sets.axes), reach_sets.number))
        static, moving = self.static, self.tubes.moving[step]
        avoid_rows = AvoidRows(
            self.highest, static, self.static_at, moving.reshape(len(moving), -1, self.row_widths[1]), self.moving_at
        )
        some = self.all_rows if some is None else some
        add_inputs(
            self.as_rows(tube),
            self.as_rows(marks, 1),
            found,
            reach_sets.number,
            reach_sets.first,
            avoid_rows,
            self.as_rows(start),
            some,
        )


def _rows(plan: Plan, arrays: Memory | Store, task: Task) -> tuple[InputRows, int]:
    """The avoid tubes of a task's slab as `InputRows`, and the position of the task's step in their moving tubes.

    In a solve with one slab, `InputRows` of all steps are made once and kept in `plan.kept`; for joint games, whose
    reach sets avoid everything already, without avoid tubes, unless the grid has unsafe ends. In a solve with several,
    those of this slab and step are read from `arrays` for each task, and the position is 0.
    """
    layout, problem = plan.layout, plan.problem
    axes = layout.axes("avoid_static"), layout.axes("avoid_moving")
    if layout.slabs == 1:
        if "rows" not in plan.kept:
            # whether the reach sets avoid everything already: joint games know of no unsafe ends
            joint = getattr(plan.whole_games, "joint", False) and not problem.grid.has("fails")
            plan.kept["rows"] = InputRows(problem.grid, no_avoid_tubes(problem, plan.dtype) if joint else arrays.avoid)
        return plan.kept["rows"], task.step
    static = arrays.read("avoid_static", 0, layout.runs("avoid_static", task.slab))
    moving = arrays.read("avoid_moving", task.step, layout.runs("avoid_moving", task.slab))
    return InputRows(plan.slab(task.slab), AvoidTubes(axes[0], static, axes[1], moving[None])), 0


def work(plan: Plan, arrays: Memory | Store, task: Task) -> tuple[Task, list[bool], str]:
    """Do a task on its slab and write the result into `arrays`. Returns (the task, danger, digest).

    Avoid tubes and earlier entries must be in `arrays` before a task of kind "extend". It may run in another process,
    on a pickled plan; the caller enters the slab in the ledger. danger : for each avoid game of the task's kind whether
    any node of the slab is in danger, [] for other tasks. digest : what `arrays.record_finished` takes.
    """
    met: list[bool] = []
    if task.kind in plan.avoid:
        values, met = _avoid(plan, arrays, task)
    else:
        values = (_goal if task.kind == "goal" else _extend)(plan, arrays, task)
    return task, met, arrays.write(task.written, values)


def _goal(plan: Plan, arrays: Memory | Store, task: Task) -> list[FloatArray]:
    """The entry (step, 0) on a task's slab, the target minus the unsafe sets: [tube, marks], for `arrays.write`.

    With a `Sensing` the tube is eroded by the box E of the prediction error. All marks are 0.
    """
    problem = plan.problem
    part = problem.on(plan.slab(task.slab))
    tube, marks = arrays.buffers(task.written)
    tube[...] = eroded_by_error(part, part.goal(task.step))
    return [tube, marks]


def _extend(plan: Plan, arrays: Memory | Store, task: Task) -> list[FloatArray]:
    """The entry (step, within) of a task on its slab, [tube, marks] as `arrays.write` takes them.

    tube = min(entry with a step less to go, max(reach_j, avoid_j) for all j); without a target max(that entry, min over
    j). Reads the entries `task.before` and `task.after` and the avoid tubes from `arrays`. With `plan.kept["patch"]`
    only the rows that it names are computed, and the others are copied from the former solve.
    """
    problem, runs = plan.problem, plan.layout.runs("tubes", task.slab)
    window, games = plan.games_on_slab(task.slab)
    before, played = arrays.read("tubes", task.before, runs), problem.padded.grid
    values = must_lead_into(problem, read_window(arrays, "tubes", task.after, window))
    if played != problem.grid:
        values = np.pad(values, played.padding, "edge")
    (rows, step), (tube, marks) = _rows(plan, arrays, task), arrays.buffers(task.written)
    start = np.full_like(before, np.inf) if problem.has_no_target else before
    patch: Patch | None = plan.kept.get("patch")
    for some in _reach_sets(problem, games, values, task.step, patch):
        rows.add(tube, marks, some, step, start, rows.of_planes(patch.rows) if patch else None)
        start = tube
    if patch:
        patch.copy_rest(tube, marks)
    if problem.has_no_target:  # what is clear for n steps is for n - 1: so are the nodes, whatever the scheme's error
        np.maximum(tube, before, out=tube)
    return [tube, marks]


def must_write_out(problem: ReachAvoidProblem, games: Any) -> bool:
    """Whether reach sets have to be written out on the grid, input by input, before they are united.

    They have to on a padding, with a `Sensing`, and where the games have no `grouped_reach_sets`.
    """
    padded = problem.padded.grid != problem.grid
    return not hasattr(games, "grouped_reach_sets") or padded or bool(problem.sensing)


def _reach_sets(
    problem: ReachAvoidProblem, games: Any, values: FloatArray, step: int, patch: Patch | None
) -> Iterator[Maxima | Pieces]:
    """Yield the reach sets of all inputs for the set {values <= 0} to be in at the end of the interval from a step.

    Some inputs come at a time, all of one byte of marks together, on the problem's grid without its padding. With a
    `Sensing` that has no memory the reach sets are eroded by the box E of the prediction error.

    games : of `problem.padded`.
    values : (*shape) on the padded grid.
    patch : the part to be solved, for games with `patches`, or None for all; ignored where `must_write_out` is true.
    """
    if not must_write_out(problem, games):
        yield from games.grouped_reach_sets(values, step, *[patch] * bool(patch))
        return
    inner, reach_sets = problem.padded.grid.inner, games.reach(values, step)
    kept = (lambda phi: phi) if problem.sensing.remembers else (lambda phi: eroded_by_error(problem, phi))
    yield from in_eights(problem.grid, ((j, kept(phi[inner])) for j, phi in reach_sets))


def _avoid(plan: Plan, arrays: Memory | Store, task: Task) -> tuple[list[FloatArray], list[bool]]:
    """The avoid tubes of all inputs, of all avoid games of a task's kind, on its slab, and which games have danger.

    Returns [tubes (L, *subgrid)], as `arrays.write` takes it, and for each avoid game of the kind whether any node is
    in danger, that is whether a value is > 0. The tubes are the maximum over the dangers, and with a `Sensing` eroded
    by the box E. Avoid games that do not depend on the cut axis are solved on all of their grid. Where there are
    several games, the tubes of each are also kept in `plan.former`, if that is given.
    """
    problem, layout, kept = plan.problem.padded, plan.layout, plan.layout.axes(task.kind)
    grid = problem.grid if layout.slabs == 1 else plan.slab(task.slab)
    (total,), met, shape = arrays.buffers(task.written), list[bool](), (layout.inputs, *(grid.shape[i] for i in kept))
    if total.shape != shape:  # with a padding
        total = np.empty(shape, plan.dtype)
    keeps = plan.former if len(plan.avoid[task.kind]) > 1 else None
    for game in plan.avoid[task.kind]:
        danger = game.danger
        games, inside = plan.avoid_games_on_slab(game, task.slab)
        found = avoid_tubes_of(games, danger, inside, task.step, keeps)
        first = not met
        met.append(bool(found.max() > 0))
        if first and not keeps and found.flags.carray and (found.shape, found.dtype) == (shape, total.dtype):
            total = found
            continue
        at = [kept.index(i) for i in danger.axes]
        for out, tube in zip(total, found, strict=True):
            lifted = np.expand_dims(tube, [i for i in range(len(kept)) if i not in at])
            np.maximum(lifted if first else out, lifted, out=out)
    for tube in total if problem.sensing else ():
        tube[:] = eroded_by_error(problem, np.maximum(tube, -LARGEST), kept)  # -inf times 0 is no number
    inner = (slice(None) if layout.slabs > 1 else problem.grid.inner[axis] for axis in kept)
    return [np.ascontiguousarray(total[(slice(None), *inner)])], met


class GridMethod(Protocol):
    """A method that plays its games on the grid, as `GridSets` takes it: `HJI`, `HopfLax` and `OnSubspaces`."""

    @property
    def name(self) -> str:
        """The name by which tables and files call it."""

    @property
    def options(self) -> Mapping[str, Any]:
        """The method's options, plain values by name, for the table's details.

        One of them must be "dtype", the type of the numbers in tubes, such as "float32".
        """

    def on(self, problem: ReachAvoidProblem) -> Games:
        """The games of the intervals of a problem, on its whole grid; what they sample is kept with them."""


class Slabs(NamedTuple):
    """How a solve is cut into slabs, where its arrays lie, who does the tasks, and who is told of progress.

    plan : the cut and the games.
    arrays : where tubes are read and written; None: in memory.
    run : does tasks and yields for each, in any order, what `work` returns; None: `work` is called here, one after the
        other.
    tick : called with the number of slabs that have just been done, skipped or shared.
    """

    plan: Plan
    arrays: Memory | Store | None = None
    run: Callable[[list[Task]], Iterable[Any]] | None = None
    tick: Callable[[int], Any] = lambda slabs: None


def _require_steps(problem: ReachAvoidProblem, name: str) -> None:
    """Raise ValueError, with what to do, where a problem has no number of steps; name : of the method on a grid."""
    if problem.steps is None and problem.has_no_target:
        raise ValueError(
            "steps=None asks for ever, and on a grid an error at the boundary adds up from step to step. Use "
            "method='certified' (a BlackBox needs enclosure= or slope= there), or give steps=N: safe for N steps from "
            "step 0, asked at steps 0, 1, ..., N"
        )
    if problem.steps is None:
        raise ValueError(
            f"method {name!r} needs a number of steps: give steps=60, say; steps_to_go tells where fewer are enough. "
            "method='certified' finds the number by itself"
        )


class GridSets:
    """S_k as level-set functions on the grid: `TubeSets` for every method that plays its games there.

    Making it solves all avoid games; then `recursion` fills in the entries, and `finish` gives the table.

    Parameters
    ----------
    problem : ReachAvoidProblem
    method : GridMethod
    former : Former, optional
        An earlier solve in this process, of which all that cannot differ is copied. Only without `slabs`.
    slabs : Slabs, optional
        How the grid is cut, where arrays lie and who works; by default one slab, in memory, in this process.

    Attributes
    ----------
    plan : Plan
    arrays : Memory or Store
    table : LookupTable
        Over `arrays`; entries are undefined until they are filled in.
    shared : int
        Entries that are the tube of another entry.

    Raises
    ------
    ValueError
        If the problem has no number of steps.
    MemoryError
        Without `slabs`, if `memory_needed` exceeds the available memory.
    """

    def __init__(
        self,
        problem: ReachAvoidProblem,
        method: GridMethod,
        former: Former | None = None,
        slabs: "Slabs | None" = None,
    ) -> None:
        """Solve the avoid games; without `slabs` first check memory, state the cost, warn of a coarse grid."""
        _require_steps(problem, method.name)
        self.problem, self.options, self.time_invariant = problem, dict(method.options), problem.time_invariant
        slabs = slabs or Slabs(self._in_memory(problem, method, former))
        plan, self.tick = slabs.plan, slabs.tick
        self.plan, self.arrays = plan, Memory(plan.layout) if slabs.arrays is None else slabs.arrays
        patches = (
            not must_write_out(problem, plan.whole_games) and getattr(plan.whole_games, "patches", False)
            if former
            else False
        )
        self.former = former if patches else None
        # none of its own, which would know `self`: the table would stay until garbage is collected
        self.run = slabs.run
        self._avoid_tubes()
        self.table = self.arrays.table(problem, method.name, LookupTable.unshared_index(problem))
        self.shared = 0

    @property
    def games(self) -> Any:
        """The games on the whole grid, made at first use; in a solve with one slab, those that play it."""
        return self.plan.whole_games

    @staticmethod
    def _in_memory(problem: ReachAvoidProblem, method: GridMethod, former: Former | None) -> Plan:
        """The plan of a solve by a method in memory, in one slab.

        States the cost on the progress bar (`begin`), and warns of what the grid does not resolve. MemoryError if the
        solve does not fit into memory.

        former : an earlier solve, from which what cannot differ is copied; None: none.
        """
        dtype = method.options.get("dtype", "float32")
        needed = memory_needed(problem, dtype) + (former.table.tubes.nbytes if former else 0)  # of what it keeps
        why = multiplied(problem, LookupTable.most_tubes(problem), problem.grid.size, "nodes")
        remedies = "fewer nodes or steps" + ', or dtype "float32"' * (dtype != "float32")
        require_memory(needed, "this solve", f"it has {why}; use {remedies}")
        plan = Plan(problem, method.on, dtype, tuple(map(AvoidGame, dangers(problem.padded))), former=former)
        begin(lambda: cost_on_grid(plan, needed))
        check_resolution(problem)
        return plan

    def _avoid_tubes(self) -> None:
        """Write the avoid tubes into the arrays, static ones once and moving ones for each step.

        If none can differ from those of the former solve, its array is used itself. Slabs that a resumed store already
        has are not solved. Unless there are such slabs, warns of unsafe sets that no node is in danger of.
        """
        met, looked_at = set[UnsafeSet](), True
        for kind, games in self.plan.avoid.items():
            if isinstance(self.arrays, Memory) and games and (same := self._former_avoid_tubes(kind)) is not None:
                self.arrays.arrays[kind] = same
                met |= {game.danger.unsafe_set for game in games}
                continue
            for step in range(self.problem.most_steps if kind == "avoid_moving" else 1) if games else ():
                found = self._do(Task(kind, step, step))
                looked_at &= len(found) == self.plan.layout.slabs_of(kind)
                met |= {game.danger.unsafe_set for one in found for game, has in zip(games, one, strict=True) if has}
        # where nothing was looked at, an earlier solve has seen the others
        for unsafe_set in self.plan.problem.padded.unsafe if looked_at else ():
            if unsafe_set not in met:
                tell(never_met_finding(unsafe_set))

    def _former_avoid_tubes(self, kind: str) -> FloatArray | None:
        """The former solve's avoid tubes of a kind, a view, if none of them can differ; else None, as without a former.

        Where they are taken over, what the former solve kept of each danger is also put into `plan.former.each`.

        kind : "avoid_static" for an array (L, *subgrid), "avoid_moving" for (most_steps, L, *subgrid).
        """
        moves, found = kind == "avoid_moving", [game.danger for game in self.plan.avoid[kind]]
        former, times = self.plan.former, self.problem.most_steps if moves else 1
        same = former.avoid_tubes(found, moves, times) if former else None
        return same if same is None or moves else same[0]

    def _do(self, task: Task) -> list[Any]:
        """Do a task on each slab that is not finished yet, and enter these in the ledger; tick finished ones, too.

        Returns, for each slab that was done now, a list of bool: for each avoid game of the task's kind whether any
        node is in danger; [] for other tasks.

        task : whose `slab` is ignored.
        """
        tasks = [task._replace(slab=slab) for slab in range(self.plan.layout.slabs_of(task.array))]
        todo = [one for one in tasks if not self.arrays.is_finished(one.written)]
        self.tick(len(tasks) - len(todo))
        found = []
        run = self.run or (lambda tasks: (work(self.plan, self.arrays, task) for task in tasks))
        for done, met, digest in run(todo):
            self.arrays.record_finished(done.written, digest)
            found.append(met)
            self.tick(1)
        return found

    def write_goal(self, step: int) -> None:
        """Write the entry (step, 0), S_k^N = L(t_k) minus G(t_k), on all slabs."""
        self._do(Task("goal", step, self.table.tube_index(step, 0)))

    def extend(self, step: int, within: int) -> None:
        """Write the entry (step, within) from (step, within - 1) and (step + 1, within - 1), on all slabs."""
        table = self.table
        places = [table.tube_index(*entry) for entry in ((step, within), (step, within - 1), (step + 1, within - 1))]
        self.plan.kept["patch"] = patch = self.former.patch(table, step, within) if self.former else None
        self._do(Task("extend", step, *places))
        if self.former and patch:
            self.former.keep_frame_solution(patch, step, within)

    def unchanged(self, step: int, within: int) -> bool:
        """Whether the entries (step, within) and (step, within - 1) are equal, bit for bit."""
        one, other = (self.table.value_array(step, n) for n in (within, within - 1))
        return all(map(np.array_equal, one, other))  # row by row, as most differ at once

    def repeat(self, step: int, within: int) -> None:
        """Make the entry (step, within) the same tube as (step, within - 1); counts it, and ticks its slabs."""
        self.table.repeat(step, within)
        self.shared += 1
        self.tick(self.plan.layout.slabs)

    def finish(self, details: Mapping[str, Any]) -> LookupTable:
        """The table. Its details are the method's options, counts of PDEs and shared tubes, and `details`."""
        steps = self.table.steps
        avoid = sum(steps if self.problem.moves(unsafe_set) else 1 for unsafe_set in self.problem.unsafe)
        pdes = len(self.problem.inputs) * (steps * (steps + 1) // 2 + avoid)
        found: dict[str, Any] = {
            "pdes_of_algorithm": pdes,
            "pdes_solved": self.games.solved,
            "tubes_shared": self.shared,
            "shifted": bool(getattr(self.games, "shifted", False)),
        }
        return self.table.finish(self.options | found | dict(details))
