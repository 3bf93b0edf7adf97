"""The recursion of Theorem 2 (Algorithm 1): from the games of one interval to the look-up table.

    S_k^N = L(t_k) minus G(t_k),        S_k^i = S_k^{i+1}  united with  RA_k^j(S_{k+1}^{i+1})  for all inputs j

With n = N - i steps to go, the entry (k, n) follows from (k, n - 1) and (k + 1, n - 1). `recursion` implements this for
every kind of set: level-set functions on the grid (`GridSets`, for most methods), or cells with a proof.

Without a target, the entry (k, n) contains the states that can stay clear of G for n steps: those that some input keeps
clear for one step and leads into the entry (k + 1, n - 1). S_k^{i+1} is not united with them; the sets shrink with n.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from sdhj.common.findings import tell
from sdhj.common.memory import require_memory
from sdhj.common.remembering import FloatArray, read_only
from sdhj.kernels.union import AvoidRows, InPieces, add_inputs
from sdhj.problem.boxes import Maxima, one_by_one
from sdhj.problem.grid import Grid
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.samples import Samples
from sdhj.problem.sets import LARGEST
from sdhj.problem.uncertain import eroded_by_error, must_lead_into
from sdhj.solver.avoid import avoid_tubes_of, dangers
from sdhj.solver.findings import check_resolution, never_met_finding
from sdhj.solver.games import KEPT, Axes, Games, Pieces, in_eights, nodes_past_ends
from sdhj.table.batches import Table, entry
from sdhj.table.table import AvoidTubes, LookupTable, entries

ARRAYS = "tubes", "marks", "avoid_static", "avoid_moving"  # of a table
PROCESS = 200_000_000  # bytes that Python, NumPy and the compiled kernels need before anything is solved
AT_WORK = 12  # arrays of a tube's size in which the games of an interval are played
LONG = 4096  # nodes: shorter rows are worth being joined, longer ones leave the first caches


class TubeSets(Protocol):
    """All tubes S_k with n steps to go, in some representation: the operations that Theorem 2 needs.

    `recursion` calls `begin` first, once, then `write_goal` once for each step k, and `extend` or `repeat` for n = 1,
    2, ... in order. It asks `unchanged` only of entries that have been filled in. `finish` is called last, once.

    Attributes
    ----------
    time_invariant : bool
        Whether nothing depends on time. There is then one row, k = 0, and the entry (k, n) is the entry (0, n) for
        every k.
    filled : int
        For steps=None: the largest n that has been filled in.
    changing : float
        For steps=None: the share of the state space that the last step changed.
    """

    time_invariant: bool

    def begin(self) -> None:
        """Prepare what does not belong to one entry, such as avoid tubes."""

    def write_goal(self, step: int) -> None:
        """Write the entry (step, 0): the target minus the unsafe sets."""

    def extend(self, step: int, within: int) -> None:
        """Write the entry (step, within) from (step, within - 1), (step + 1, within - 1) and the step's avoid tubes."""

    def unchanged(self, step: int, within: int) -> bool:
        """Whether the entries (step, within) and (step, within - 1), both filled in, are equal."""

    def repeat(self, step: int, within: int) -> None:
        """Make the entry (step, within) the same tube as (step, within - 1), without computing anything."""

    def finish(self, details: Mapping[str, Any]) -> Table:
        """The table of all entries; `details` are added to its own."""


def recursion(sets: TubeSets, steps: int, done: Callable[[], Any]) -> None:
    """Fill in all entries (k, n) of `sets` with k + n <= steps (Theorem 2), in place.

    Rows k come from `steps` down to 0, and in a row n goes upwards. If the entries (k + 1, n - 1) and (k + 1, n - 2)
    are equal, so are (k, n) and (k, n - 1), and `sets.repeat` is called. A row with a shared entry may grow again, for
    example if the target appears late. `done()` is called after each entry with n >= 1.
    """
    # into a folder `sdhj.solver.entries.fill` goes through the same rows
    sets.begin()
    for step in (0,) if sets.time_invariant else range(steps, -1, -1):
        sets.write_goal(step)
        for within in range(1, steps - step + 1):
            if within >= 2 and sets.unchanged(step + 1, within - 1):
                sets.repeat(step, within)
            else:
                sets.extend(step, within)
            done()


class InputRows:
    """The grid and the avoid tubes in the form in which the kernel `add_inputs` reads them; `add` calls it.

    The grid is cut into R rows, all nodes of the last one or more axes: as many as each avoid tube depends on all or
    none of, so that in a row it is one value, or a row of numbers that other rows may share.
    """

    def __init__(self, grid: Grid, tubes: AvoidTubes) -> None:
        self.grid, self.tubes, last = grid, tubes, 1
        axes = tubes.static_axes, tubes.moving_axes
        for more in range(2, grid.ndim + 1):
            trailing = set(range(grid.ndim - more, grid.ndim))
            fits = more <= grid.ndim // 2 or math.prod(grid.shape[-more:]) <= LONG
            if fits and all(trailing <= set(some) or not trailing & set(some) for some in axes):
                last = more
        # joined axes, nodes of a row, and numbers that static and moving avoid tubes have for it
        self.last, self.size = last, math.prod(grid.shape[-last:])
        self.row_widths = [self.size if grid.ndim - 1 in some else 1 for some in axes]
        self._known_lines: dict[tuple[tuple[Axes, ...], int], tuple[Any, ...]] = {}
        # (L, parts, width), their maxima (L, parts), and each row's part: (R,) int
        self.static = tubes.static.reshape(len(tubes.static), -1, self.row_widths[0])
        self.highest = self.static.max(axis=2)
        self.static_at, self.moving_at = (self._part_at(some, last) for some in axes)

    def as_rows(self, values: FloatArray, lead: int = 0) -> FloatArray:
        """A view in rows, (lead..., R, size), of values (lead..., *shape)."""
        return values.reshape(*values.shape[:lead], -1, self.size)

    def _part_at(self, axes: Axes, last: int = 1) -> FloatArray:
        """For each part of the grid, all nodes of its `last` axes, which part of a function of `axes` belongs to it.

        Parts of both are in C order over the other axes: (parts,).
        """
        leading = self.grid.shape[: self.grid.ndim - last]
        shape = [n if axis in axes else 1 for axis, n in enumerate(leading)]
        numbers = np.arange(math.prod(shape)).reshape(shape)
        # a copy: `add_inputs` would be compiled once more for a view, which may not be written to
        return np.broadcast_to(numbers, leading).flatten()

    def _lines(self, axes: tuple[Axes, ...], number: int) -> tuple[Any, ...]:
        """Where the kernel `add_inputs` finds reach sets in pieces: `InPieces` without its values.

        The pieces, of a `number` of inputs each, lie one after the other in a flat array.
        """
        if (axes, number) not in self._known_lines:
            last, whole = self.grid.ndim - 1, axes == (tuple(range(self.grid.ndim)),)
            # a line is all nodes of the last axis or, of one piece on all axes, a row
            nodes = self.size if whole else self.grid.shape[-1]
            at = np.arange(self.grid.size // nodes)[None] if whole else np.stack([self._part_at(some) for some in axes])
            sizes = [self.grid.subgrid(some).size for some in axes]
            ends = np.cumsum([0, *(number * size for size in sizes[:-1])])
            starts = ends[:, None] + np.outer(sizes, np.arange(number))
            widths = np.array([nodes if last in some else 1 for some in axes])
            self._known_lines[axes, number] = starts, at, widths, nodes
        return self._known_lines[axes, number]

    def add(
        self,
        tube: FloatArray,
        marks: FloatArray,
        reach_sets: Maxima | Pieces,
        step: int,
        start: FloatArray,
    ) -> None:
        """Write tube = min(start, max(reach_j, avoid_j) for these inputs j), and mark those that are <= 0.

        Bit j % 8 of byte j // 8 of `marks` (bytes, *shape) has to be 0 before; `step` is the position in
        `tubes.moving`; `start` may be `tube`.
        """
        behind = math.prod(self.grid.shape[reach_sets.axis + 1 :]) if isinstance(reach_sets, Maxima) else 0
        # the kernel makes rows that are parts of what lies behind the axis (`add_inputs`); else they are written out
        # here
        if isinstance(reach_sets, Maxima) and behind % self.size:
            reach_sets = Pieces(reach_sets.first, self.grid.shape, [reach_sets.of()], [tuple(range(self.grid.ndim))])
        if isinstance(reach_sets, Maxima):
            found: tuple[Any, ...] = (reach_sets.split, *reach_sets.leaves)
        else:
            flat = reach_sets.pieces[0].reshape(-1) if reach_sets.flat is None else reach_sets.flat
            found = InPieces(flat, *self._lines(tuple(reach_sets.axes), reach_sets.number))
        static, moving = self.static, self.tubes.moving[step]
        avoid_rows = AvoidRows(
            self.highest, static, self.static_at, moving.reshape(len(moving), -1, self.row_widths[1]), self.moving_at
        )
        add_inputs(
            self.as_rows(tube),
            self.as_rows(marks, 1),
            found,
            reach_sets.number,
            reach_sets.first,
            avoid_rows,
            self.as_rows(start),
        )


class GridMethod(Protocol):
    """A method that plays its games on the grid: `HJI`, `HopfLax` and `OnSubspaces`."""

    @property
    def name(self) -> str:
        """The name by which tables and files call it."""

    @property
    def options(self) -> Mapping[str, Any]:
        """The method's options, plain values by name, among them "dtype", the type of the numbers in tubes."""

    def on(self, samples: Samples) -> Games:
        """The games of the intervals on the whole grid of samples."""


class GridParts:
    """The parts of a table that one process computes: avoid tubes, goals and entries, each on the whole grid.

    Games are played on its `samples` when `padded`; `empty` makes the arrays of avoid tubes.
    """

    def __init__(self, problem: ReachAvoidProblem, method: GridMethod, empty: Callable[..., Any] = np.empty) -> None:
        self.problem, self.method, self.empty = problem, method, empty
        # kept for the next solve, of which the samples of the arm's pursuer are a fiftieth
        self.samples: Samples = problem.remembered("samples", lambda: Samples(problem))
        self.dtype: str = method.options.get("dtype", "float32")
        kinds, found = {"avoid_static": False, "avoid_moving": True}, dangers(self.samples.padded)
        # by the name of the array that has their tubes, and below the axes on which these depend
        self.dangers = {name: [one for one in found if one.moves == moves] for name, moves in kinds.items()}
        self.axes = {name: tuple(sorted({i for one in some for i in one.axes})) for name, some in self.dangers.items()}

    @cached_property
    def games(self) -> Any:
        """The games of the method on the problem's grid with its padding."""
        return self.method.on(self.samples.padded)

    def shape(self, name: str) -> tuple[int, ...]:
        """The shape of "tubes", "marks", "avoid_static" or "avoid_moving" of the table."""
        grid, count, steps = self.problem.grid, len(self.problem.inputs), self.problem.steps
        if name in self.axes:
            return *(steps,) * (name == "avoid_moving"), count, *(grid.shape[axis] for axis in self.axes[name])
        tubes = steps + 1 if self.problem.time_invariant else entry(steps, steps, 0) + 1
        return (tubes, *grid.shape) if name == "tubes" else (tubes, -(-count // 8), grid.size)

    def kind(self, name: str) -> Any:
        """The dtype of an array of the table."""
        return np.dtype("uint8" if name == "marks" else self.dtype)

    def write_avoid(self, name: str, step: int, out: FloatArray, *some: Sequence[int]) -> set[int]:
        """Write the avoid tubes of a step to `out` (inputs, *subgrid); returns which unsafe sets are met.

        The tubes are the maximum over all dangers of this name, with a `Sensing` eroded by the box E. some : inputs,
        for games that are `apart`; by default all.
        """
        problem, samples, axes = self.problem, self.samples.padded, self.axes[name]
        met = set[int]()
        wide = len(out), *samples.grid.subgrid(axes).shape
        total = out if out.shape == wide else self.empty(wide, self.dtype)
        # One on all axes and on this grid comes first and is played into `total` itself; of every other one there is an
        # array, to which `total` is raised. Ends, which are on a wide grid, count as no set that is met.
        each = sorted(self.dangers[name], key=lambda one: one.axes != axes or one.samples is not samples)
        for number, danger in enumerate(each):
            own = danger.samples is samples
            if direct := own and danger.axes == axes and not number:
                into = total
            else:
                into = self.empty((len(out), *danger.samples.grid.subgrid(danger.game_axes).shape), self.dtype)
            if not (direct or number):
                total.fill(-np.inf)
            tubes = avoid_tubes_of(self.games if own else self.method.on(danger.samples), danger, step, into, *some)
            if tubes.max() > 0:
                met |= {i for i, unsafe_set in enumerate(samples.unsafe) if unsafe_set == danger.unsafe_set}
            for one, tube in zip(total, tubes, strict=True) if not direct else ():
                lifted = np.expand_dims(tube, [place for place, axis in enumerate(axes) if axis not in danger.axes])
                np.maximum(one, lifted, out=one)
        for tube in total if problem.sensing else ():
            tube[:] = eroded_by_error(problem, np.maximum(tube, -LARGEST), axes)  # -inf times 0 is no number
        if total is not out:
            out[...] = total[(slice(None), *(samples.grid.inner[axis] for axis in axes))]
        return met

    def write_goal(self, step: int, tube: FloatArray) -> None:
        """Write the entry (step, 0), S_k^N = L(t_k) minus G(t_k), to `tube`."""
        tube[...] = eroded_by_error(self.problem, self.samples.goal(step))

    def write_entry(
        self,
        rows: "InputRows",
        step: int,
        before: FloatArray,
        after: FloatArray,
        tube: FloatArray,
        marks: FloatArray,
        *some: Sequence[int],
    ) -> None:
        """Write an entry, tube = the least of `before` and max(reach_j, avoid_j) for all inputs j, and its marks.

        Without a target it is the greatest of `before` and the least of these. before, after : the entries (step,
        within - 1) and (step + 1, within - 1). marks (bytes, nodes) : 0 at first. some : inputs, for games that are
        `apart`; by default all.
        """
        problem, values = self.problem, must_lead_into(self.problem, after)
        if (padding := self.samples.padded.grid.padding) != problem.grid.padding:
            values = np.pad(values, padding, "edge")
        start = np.full(tube.shape, np.inf, tube.dtype) if problem.has_no_target else before
        games, inner = self.games, self.samples.padded.grid.inner
        # all inputs of one byte of marks together, at the nodes without a padding
        if hasattr(games, "grouped_reach_sets"):
            found: Iterator[Maxima | Pieces] = games.grouped_reach_sets(values, step, *some)
        else:
            found = in_eights((j, np.asarray(phi)[inner]) for j, phi in games.reach(values, step))
        # by the box E of the prediction error
        if problem.sensing and not problem.sensing.remembers:
            found = in_eights((j, eroded_by_error(problem, phi)) for j, phi in one_by_one(found))
        for reach_sets in found:
            rows.add(tube, marks, reach_sets, step, start)
            # From the second group of inputs on, the tube is lowered further.
            start = tube
        # what is clear for n steps is for n - 1: so are the nodes, whatever the scheme's error
        if problem.has_no_target:
            np.maximum(tube, before, out=tube)


def bytes_of_entry(parts: GridParts) -> int:
    """Upper estimate of the bytes of a solve beside its table, and the process itself."""
    # a solve is refused by it before anything is computed (`require_memory`, `opened`): too little here, and it fails
    # halfway
    problem, dynamics, item = parts.problem, parts.problem.dynamics, np.dtype(parts.dtype).itemsize
    games = parts.samples.padded.grid
    count, axes = len(problem.inputs), range(problem.grid.ndim)
    past = nodes_past_ends(parts.samples, axes) if dynamics.constant else (0,) * problem.grid.ndim
    played = {one.samples.grid for some in parts.dangers.values() for one in some}
    each, times = 0, 1
    if not dynamics.stateless:
        whole = not dynamics.formulas or dynamics.gain is None or dynamics.couples(axes)
        each = 8 * (2 * dynamics.disturbance_dim + 6) if whole else 12  # boxes lie on the axes that they read
        each += 8 * (3 + problem.grid.ndim) * (math.prod(dynamics.pieces_of_components(axes)) - 1)
        if dynamics.depends_on_time:
            speeds = np.max([problem.interval(step).speeds for step in {0, problem.steps - 1}], axis=0)
            crossed = speeds * problem.interval(0).delta / np.array(problem.grid.spacing)
            times += math.ceil(2 * float(np.sum(crossed)))
    most = 0
    for grid in (games.wider([(n, n) for n in past]), *(played - {games})):
        # kept for all inputs up to `KEPT` bytes, at each time step if they depend on time
        velocities = each * grid.ndim * grid.size
        # as many more as there are inputs while an interval may end early
        arrays = (AT_WORK + count * bool(problem.sensing.jitter)) * item * grid.size
        most = max(most, grid.sampling_bytes + arrays + velocities + min(KEPT, count * times * velocities))
    # what functions of the problem allocate is not counted
    return PROCESS + most


def bytes_of_solve(parts: GridParts) -> int:
    """Upper estimate of the bytes of a solve in memory."""
    found = sum(math.prod(parts.shape(name)) * parts.kind(name).itemsize for name in ARRAYS)
    most, padded = 0, parts.samples.padded
    for name, some in parts.dangers.items():
        # what `write_avoid` makes beside the arrays of the table: one danger's tubes, and the sum of all before it is
        # cut
        direct = [one.axes == parts.axes[name] and one.samples is padded for one in some]
        for number, one in enumerate(some):
            grid, wide = one.samples.grid, padded.grid.subgrid(parts.axes[name]).size
            beside = 0 if direct[number] and not any(direct[:number]) else grid.subgrid(one.game_axes).size
            most = max(most, beside + wide * (padded.grid != parts.problem.grid))
    return bytes_of_entry(parts) + found + most * len(parts.problem.inputs) * np.dtype(parts.dtype).itemsize


class GridSets:
    """S_k as level-set functions on the grid: `TubeSets` for every method that plays its games there.

    `begin` solves all avoid games; then `recursion` fills in the entries, and `finish` gives the table.

    Attributes
    ----------
    problem : ReachAvoidProblem
    parts : GridParts
    storable : bool
        Whether `sdhj.solver.entries` can fill them in on disk.
    index, tubes, marks, avoid : arrays, AvoidTubes
        As `LookupTable` has them; undefined until they are filled in.
    shared : int
        Entries that are the tube of another entry.
    """

    storable = True

    def __init__(self, problem: ReachAvoidProblem, method: GridMethod) -> None:
        _require_steps(problem, method.name)
        self.problem, self.options, self.time_invariant = problem, dict(method.options), problem.time_invariant
        self.parts, self.shared = GridParts(problem, method), 0

    def begin(self) -> None:
        """Make the arrays and solve the avoid games; warns of what the grid does not resolve, and of sets never met."""
        parts, problem = self.parts, self.problem
        shapes = {name: parts.shape(name) for name in ARRAYS}
        # before any array is made
        require_memory(bytes_of_solve(parts), "this solve", why_large(problem, parts.dtype))
        check_resolution(parts.samples)
        met, avoid = set[int](), dict[str, FloatArray]()
        for name in parts.axes:
            avoid[name] = np.empty(shapes[name], parts.dtype)
            # Without such sets nothing is ever met.
            if not parts.axes[name]:
                avoid[name].fill(-np.inf)
                continue
            for step, out in enumerate(avoid[name] if name == "avoid_moving" else [avoid[name]]):
                met |= parts.write_avoid(name, step, out)
        tell(*(never_met_finding(one) for position, one in enumerate(problem.unsafe) if position not in met))
        static, moving = parts.axes.values()
        self.avoid = AvoidTubes(static, avoid["avoid_static"], moving, avoid["avoid_moving"])
        self.rows = InputRows(problem.grid, self.avoid)
        self.index = unshared_index(problem)
        self.tubes, self.marks = np.empty(shapes["tubes"], parts.dtype), np.zeros(shapes["marks"], np.uint8)

    @property
    def rows_of_entries(self) -> range:
        """The steps k that have entries (k, n) of their own, the last first; 0 alone if nothing depends on time."""
        return range(0 if self.time_invariant else self.problem.steps, -1, -1)

    def place(self, step: int, within: int) -> int:
        """The position of an entry among the stored tubes."""
        return int(self.index[entry(self.problem.steps, step, within)])

    def write_goal(self, step: int) -> None:
        """Write the entry (step, 0), S_k^N = L(t_k) minus G(t_k)."""
        self.parts.write_goal(step, self.tubes[self.place(step, 0)])

    def extend(self, step: int, within: int) -> None:
        """Write the entry (step, within) from (step, within - 1) and (step + 1, within - 1)."""
        at, before, after = (self.place(*one) for one in ((step, within), (step, within - 1), (step + 1, within - 1)))
        self.parts.write_entry(self.rows, step, self.tubes[before], self.tubes[after], self.tubes[at], self.marks[at])

    def unchanged(self, step: int, within: int) -> bool:
        """Whether the entries (step, within) and (step, within - 1) are equal, bit for bit."""
        one, other = (self.tubes[self.place(step, n)] for n in (within, within - 1))
        return all(map(np.array_equal, one, other))  # row by row, as most differ at once

    def repeat(self, step: int, within: int) -> None:
        """Make the entry (step, within) the same tube as (step, within - 1), with its marks."""
        self.shared += 1
        if (place := self.place(step, within)) == self.place(step, within - 1):
            return
        # later tubes move up by one, as none of them has been computed; in one row all entries with more steps share it
        if self.time_invariant:
            np.minimum(self.index, place - 1, out=self.index)
        else:
            self.index[self.index >= place] -= 1

    def finish(self, details: Mapping[str, Any]) -> LookupTable:
        """The table, whose arrays become read-only, with the method's options, counts, and `details`."""
        stored = int(self.index.max()) + 1
        arrays = read_only((self.index, self.tubes[:stored], self.marks[:stored]))
        tubes = (self.tubes[self.place(0, within)] for within in (0, self.problem.steps))
        found = self.said_of(self.parts.games.solved, self.shared, *tubes) | dict(details)
        return LookupTable(self.problem, self.parts.method.name, *arrays, self.avoid, found)

    def look_over(self, goal: Callable[[int], FloatArray], free: Mapping[int, float]) -> None:
        """What a method does between the avoid games and the first entry with n >= 1: nothing."""
        # on disk `sdhj.solver.entries.fill` calls it; in memory a method's own `begin` has to

    def said_of(self, solved: int, shared: int, goal: FloatArray, last: FloatArray) -> dict[str, Any]:
        """The method's options, and what a table's details say of its solve.

        solved, shared : PDEs, and entries that are the tube of another. goal, last : the entries (0, 0) and (0, N).
        """
        # `sdhj.simulation.played` reads "pdes_solved" and "shifted" by these names, and files keep all of them
        problem, steps = self.problem, self.problem.steps
        avoid = sum(steps if problem.moves(unsafe_set) else 1 for unsafe_set in problem.unsafe)
        return self.options | {
            "pdes_of_algorithm": len(problem.inputs) * (steps * (steps + 1) // 2 + avoid),
            "pdes_solved": solved,
            "tubes_shared": shared,
            "shifted": bool(getattr(self.parts.games, "shifted", False)),
        }


def unshared_index(problem: ReachAvoidProblem) -> FloatArray:
    """The index of a table in which no tubes are shared: the position of each (start, within)."""
    # Solves in memory and in a folder write there, into the arrays of `GridParts.shape`. If nothing depends on time the
    # position is `within`, for every start.
    start, index = entries(problem.steps).T.copy()
    if not problem.time_invariant:  # one behind the other as they are filled in
        index += (problem.steps - start) * (problem.steps - start + 1) // 2
    return index


def why_large(problem: ReachAvoidProblem, dtype: str) -> str:
    """What makes a solve large, and what helps: the end of a sentence that says that it does not fit."""
    steps, moving = problem.steps, [repr(part.name) for part in problem.all_sets if part.moving]
    moving += ["the dynamics"] * problem.dynamics.depends_on_time
    depends = moving[0] + (f" and {len(moving) - 1} more depend" if moving[1:] else " depends") if moving else ""
    why = f" (N (N + 1) / 2 in place of N = {steps:,}, because {depends} on time)" if moving else ""
    tubes = steps * (steps + 1) // 2 if moving else steps
    remedies = "fewer nodes or steps" + ', or dtype "float32"' * (dtype != "float32")
    # the end of what `require_memory` says, and of what `opened` says of a worker
    return (
        f"it has {tubes:,} tubes{why} of {problem.grid.size:,} nodes for {len(problem.inputs)} inputs; use {remedies}, "
        "or store='folder', which keeps the table on disk"
    )


def _require_steps(problem: ReachAvoidProblem, name: str) -> None:
    """Raise ValueError where a problem has no number of steps."""
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
