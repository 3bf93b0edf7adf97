"""Queries that tables of every method answer, for many states at once.

`notebooks/site/code.md` explains to users how a query is answered; this file, `sdhj.table.ahead` and the kernels of
`sdhj.kernels.lookup` implement it.
"""

import os
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from sdhj.common.checks import finite_array, points_array, read_only_view, real_array, states_array, whole
from sdhj.common.remembering import FloatArray, ReadOnly, Sealed
from sdhj.kernels.tape import Tape
from sdhj.kernels.true_sets import TRUE_SETS_ONLY, TRUE_SETS_TOO
from sdhj.problem.grid import Grid
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.table.ahead import NO_TAPES, choose_by_true_sets, tape_of_problem
from sdhj.table.as_sets import interpolated
from sdhj.table.explaining import Explanation, explain_on_grid

CHUNK = 4096  # states that one thread takes at a time
MOST_KNOWN = 1 << 26  # bytes of what look-ups read of a problem that are kept, for as many steps as that is
NOT_ADMISSIBLE = -1
PROBES = 4096  # states at which the slope of a tube is found
STRIDES = 8  # Runge-Kutta steps with which a prediction is computed; the checker has this number a second time
POINT_ROUNDING = 1e-9  # of the largest coordinate of an axis: rounding of points that are carried on
NOWHERE = np.empty((4, 0, 0, 1))  # where inputs lead, for those who need not know
Player = Callable[..., Any]  # simulates runs of a table: `sdhj.simulation.played.played`


class Batch(NamedTuple):
    """The answers of a table for M states at one step, made by `Table.batch`.

    Attributes
    ----------
    states : (M, ndim) array
    step, within : int
        The step k; and n: an input is safe if it leads into the tube with max(steps_to_go, n) - 1 steps to go.
    steps_to_go : (M,) int array
        Fewest steps in which the target is reached safely(without a target, the steps left); -1 where not admissible.
    safe : (M, L) bool array
        Which inputs are safe according to the table; none in states not admissible and at the last step. Of these only
        `best` is checked with the true sets, too; `Controller.safe_inputs` checks all.
    margins : (M, L) array
        The largest value of the next tube to which the input can lead, or +inf.
    best : (M,) int array
        The safe input of least margin; if there is none, the best one, without a promise, or -1.
    """

    states: FloatArray
    step: int
    within: int
    steps_to_go: FloatArray
    safe: FloatArray
    margins: FloatArray
    best: FloatArray

    @property
    def steps_after(self) -> FloatArray:
        """Steps to go after this interval, by which the inputs of admissible states were judged: (M,)."""
        return np.maximum(self.steps_to_go, self.within) - 1

    def sealed(self) -> "Batch":
        """A batch with read-only views of these arrays, for rules of users."""
        return Batch(*(read_only_view(getattr(self, name)) for name in Batch._fields))

    @property
    def promised(self) -> FloatArray:
        """Whether some input is safe, so that the promise can be kept, up to interpolation: (M,)."""
        return np.logical_or.reduce(self.safe, axis=1)


def entry(steps: int, start: int, within: int) -> int:
    """Position of (start, within) in a list of all entries: k (N + 1) - k (k - 1) / 2 + n."""
    # the kernel `by_tubes` computes it once more, and files keep the order, which `entries` lists
    return start * (steps + 1) - start * (start - 1) // 2 + within


class Table(ReadOnly):
    """A solved problem, whatever its method, of `sdhj.solve` or `sdhj.load`.

    Arguments `start` and `within` select a tube, as `LookupTable` explains; ValueError where an argument does not fit.

    A subclass is a dataclass with the fields `details` and `player`, and implements `problem`, `method`, `index`,
    `values`, `inputs`, `save`, and what is marked "To be implemented" here. Look-ups may be made from several threads.

    Attributes
    ----------
    problem : ReachAvoidProblem
        What was solved; of a problem with steps=None with the number of steps that it took.
    method : str
        Its name.
    details : mapping
        Options and statistics of the solve.
    index : (entries,) int array
        For each (start, within), in the order of `entry`, the position of its tube among the stored ones.
    """

    problem: ReachAvoidProblem
    method: str
    details: Mapping[str, Any]
    index: FloatArray
    proved: ClassVar[bool] = False  # whether the answers are proved, so that checking the true sets adds nothing
    player: Player | None = None  # by which runs are simulated; `sdhj.solving`, which knows one, hands it over
    origin: Any = None  # the file that the arrays are mapped from (`sdhj.table.files.Origin`)
    _axes: Any = (np.zeros(0, np.int64),) * 2  # of the avoid tubes
    _tapes: Any = NO_TAPES
    _explain = explain_on_grid

    def __reduce_ex__(self, protocol: Any) -> Any:
        """Pickled it is the name of the file that its arrays are mapped from, while that is there."""
        return (self.origin and self.origin.reduced(self)) or super().__reduce_ex__(protocol)

    @property
    def grid(self) -> Grid:
        """The problem's grid."""
        return self.problem.grid

    def with_details(self, details: Mapping[str, Any]) -> Self:
        """The same table with other details, sharing what look-ups have kept."""
        out = replace(self, details=Sealed(details))  # type: ignore[type-var]  # each kind of table is a dataclass
        vars(out).update(vars(self) | {"details": out.details})  # where it is mapped from, too
        return out

    @cached_property
    def steps(self) -> int:
        """N, the number of steps; of a problem with steps=None as many as its table has."""
        return self.problem.most_steps

    def __repr__(self) -> str:
        problem, nodes, counts = self.problem, " x ".join(map(str, self.grid.shape)), self.details.get("played")
        lost = f"; {counts['lost']} of {counts['runs']} runs lost" if counts else ""
        # `check_by_runs` has put them there, under these names only where there is a target
        if counts and counts.get("outside", counts["runs"]) < counts["runs"]:
            lost += f", {counts['outside_lost']} of {counts['outside']} from outside the target"
        return (
            f"<{type(self).__name__} of {problem.name!r}, method {self.method!r}: {nodes} nodes, "
            f"{len(problem.inputs)} inputs, {self.steps} steps of {problem.delta:g} s; "
            f"{self.fraction():.1%} of the grid's volume within all of them{lost}>"
        )

    def played(self, runs: int = 1000, adversary: Any = "worst", seed: int = 0, steps: int | None = None) -> Any:
        """Simulate runs from the whole tube, to see how many promises are broken.

        Parameters
        ----------
        runs : int
        adversary, seed, steps
            As for `sdhj.simulate`.

        Returns
        -------
        sdhj.simulation.played.Played
            How many runs were lost, in which way, and what would help.

        Raises
        ------
        ValueError
            If an option is invalid, an adversary exceeds its bounds, or the tube is empty.

        Examples
        --------
        With the robot on a line of `help(sdhj)`:

        >>> played = table.played(runs=200)
        >>> played.lost
        0
        """
        if self.player is None:
            raise ValueError(f"this {type(self).__name__} has no player; use a table of sdhj.solve or sdhj.load")
        return self.player(self, runs, adversary, seed, steps)

    def explain(self, q: FloatArray, step: int = 0, within: int | None = None) -> Explanation:
        """Why a state is in a tube or not: what each input that does not keep the promise may meet or lead out of.

        Parameters
        ----------
        q : (ndim,)
        step, within : int
            The tube, as in `contains`; `step` is its `start`.

        Returns
        -------
        Explanation
            For each input what the state may meet, and when, or by how much it may end outside the next tube; of a
            certified table how many cells that it may lead to are not certified. Whether more cells may do is told by
            method "hji" on few nodes, solved when first asked.

        Examples
        --------
        With the robot on a line of `help(sdhj)`:

        >>> print(str(table.explain([2.95], step=0)).splitlines()[0])
        In the tube for step 0 with 5 steps to go: its level there is -0.05. Safe inputs: [0].
        """
        return self._explain(q, step, within)

    # ---- sets

    def as_level_set(self, within: int | None) -> Callable[[FloatArray, float], FloatArray]:
        """The tube as a level-set function (points, t), 1 between steps: for `from_table`."""
        most = self.steps if within is None else whole("within", within, least=0, most=self.steps)
        steps = range(1) if self.problem.time_invariant else range(self.steps + 1)
        return interpolated(self.problem, [self.values(start=step, within=most) for step in steps])

    def clipped(self, start: int, within: int | None) -> tuple[int, int]:
        """The pair (start, within), checked; `within` is at most N - start, as by default."""
        steps = self.steps
        start = whole("start", start, least=0, most=steps)
        left = steps - start
        return start, left if within is None else min(whole("within", within, least=0), left)

    def tube_index(self, start: int, within: int | None) -> int:
        """Position of the tube (start, within) among the stored ones."""
        return int(self.index[entry(self.steps, *self.clipped(start, within))])

    def contains(self, points: FloatArray, *, start: int = 0, within: int | None = None) -> FloatArray:
        """Whether each of some states is in the tube (start, within): from it the target can be reached, safely.

        Parameters
        ----------
        points : (M, ndim) array
            States, in the units of the grid's axes. With a `Sensing` these are true states when the input of the step
            starts; of a measurement ask `Controller.admissible`.
        start, within : int
            k, from 0 to N; and n, the most steps that it may take, by default all that are left.

        Returns
        -------
        (M,) bool
            False off the grid, in the true unsafe sets and, with within = 0, outside the true target. For a certified
            table True in the true target clear of the unsafe sets, whatever the cell.

        Examples
        --------
        With the robot on a line of `help(sdhj)`:

        >>> table.contains([[-2.1], [2.95]], start=0, within=3)
        array([ True, False])
        """
        points = points_array("points", np.atleast_2d(real_array("points", points)), self.grid.ndim)
        start, within = self.clipped(start, within)
        # an infinite coordinate is off the grid, and in no tube
        if np.isnan(points).any():
            raise ValueError("points has a NaN; every coordinate must be a number")
        found = self._inside(points, start, within)
        if not self.proved and found.any():
            found[found] = ~self.problem.surely_in_no_tube(points[found], start, within)
        return found

    def fraction(self, *, start: int = 0, within: int | None = None) -> float:
        """Share of the state space that is in the tube (start, within), from 0 to 1.

        By volume, counted by nodes, or for a certified table by whole cells.

        Parameters
        ----------
        start, within : int
            The tube, as in `contains`.

        Examples
        --------
        With the robot on a line of `help(sdhj)`:

        >>> [round(table.fraction(start=0, within=n), 3) for n in range(4)]
        [0.263, 0.338, 0.438, 0.537]
        """
        return self._share(*self.clipped(start, within))

    @cached_property
    def change_over_cell(self) -> float:
        """By how much the value of the whole tube, (0, N), changes over a cell at its boundary; 0 if none is found.

        The root of the sum of squares of the medians of |dV/dx_i| h_i over random states near the boundary.
        """
        # `Controller.allowed` measures margins by it: so what a filter lets pass hangs on these random states
        grid, slopes = self.grid, list[float]()
        # states within half a cell of the boundary, along an axis
        states = np.random.default_rng(0).uniform(grid.lower, grid.upper, (PROBES, grid.ndim))
        for half in np.diag(grid.spacing) / 2:
            low, high = self.values_at(np.stack([states - half, states + half], 1), 0, np.full(PROBES, self.steps)).T
            crossed = ((low <= 0) != (high <= 0)) & np.isfinite(low) & np.isfinite(high)
            slopes.append(float(np.median(np.abs(high - low)[crossed])) if crossed.any() else 0.0)
        return float(np.linalg.norm(slopes))

    def _inside(self, points: FloatArray, start: int, within: int) -> FloatArray:
        """To be implemented: whether points (M, ndim), no NaN, are in the tube as computed: (M,)."""
        raise NotImplementedError

    def _share(self, start: int, within: int) -> float:
        """To be implemented: the share, 0 to 1, of the grid's volume in the tube."""
        raise NotImplementedError

    # ---- states

    def batch(self, states: FloatArray, step: int, within: int = 1) -> Batch:
        """Steps to go, safe inputs and margins of many states at one step.

        An input is safe if it leads into the tube with max(steps_to_go, within) - 1 steps to go: by default those that
        make progress, with within = N - step all after which the target can still be reached.

        Parameters
        ----------
        states : (M, ndim) array
        step, within : int
            k, from 0 to N; and n, without a target N - k.

        Raises
        ------
        ValueError
            If an argument does not fit, or a state is not finite.

        Examples
        --------
        With the robot on a line of `help(sdhj)`:

        >>> told = table.batch([[-2.1], [0.5], [3.9]], step=0)
        >>> told.steps_to_go, told.promised
        (array([ 3,  0, -1]), array([ True,  True, False]))
        """
        return self.answers(states_array("states", states, self.grid.ndim), step, within)  # a copy: rules read it later

    def answers(self, states: FloatArray, step: int, within: int = 1, scores: FloatArray | None = None) -> Batch:
        """As `Table.batch`, for finite states, neither checked nor copied.

        `best` is the safe input of least score (M, L), by default the margin, that the true sets pass.
        """
        problem, steps = self.problem, self.steps
        step = whole("step", step, least=0, most=steps)
        # without a target all inputs that stay clear for all that is left
        within = steps - step if problem.has_no_target else min(within, steps - step)
        count, shape = len(states), (len(states), len(problem.inputs))
        to_go, best = np.empty(count, np.int64), np.empty(count, np.int64)
        batch = Batch(states, step, within, to_go, np.empty(shape, np.bool_), np.empty(shape), best)
        scores = batch.margins if scores is None else scores
        share_out(self.grid, states, lambda rows: self._fill_in_and_check(batch, scores, TRUE_SETS_TOO, rows))
        if problem.has_no_target:
            # tubes shrink there: a state in the last one is in all, so that 0 was found
            batch.steps_to_go[batch.steps_to_go >= 0] = steps - step
        return batch

    def _fill_in_and_check(self, batch: Batch, scores: FloatArray, checks: int, rows: FloatArray) -> None:
        """Fill in some rows (R,) of a batch in place, and check them by the true sets; called from several threads.

        `best` becomes the safe input of least score (M, L) that passes; inputs of less score are no longer `safe`.
        `LookupTable` does the same by one compiled call, `decide`, where all sets are formulas: both have to agree.
        """
        ends = NOWHERE if self.proved else self.problem.interval(batch.step).displacement_sets(batch.states[rows])
        if checks == TRUE_SETS_TOO:
            self._fill_in_by_tubes(batch, rows, ends)
        choose_by_true_sets(self, batch, rows, ends, scores, checks)

    @cached_property
    def normals(self) -> FloatArray:
        """Normals (K, ndim) of the planes between which inputs lead; of a proof, which asks for no true set, none."""
        normals = self.problem.interval(0).normals
        return normals[:0] if self.proved else normals

    def tape_at(self, step: int) -> Tape:
        """The problem at a step as compiled look-ups read it."""
        # if nothing depends on time, the last step has a tape, and all others share one
        place = self.steps * (step == self.steps) if self.problem.time_invariant else step
        if (found := self._tape_of_step.get(place)) is None:
            if sum(one.floats.nbytes for one in [*self._tape_of_step.values()]) > MOST_KNOWN:
                self._tape_of_step.clear()
            found = self._tape_of_step[place] = tape_of_problem(
                self.problem, place, self._axes, self._tapes, not self.proved
            )
        return found

    @cached_property
    def _tape_of_step(self) -> dict[int, Tape]:
        return {}

    def _fill_in_by_tubes(self, batch: Batch, rows: FloatArray, ends: FloatArray) -> None:
        """To be implemented: fill in rows (R,) of a batch in place from the tubes alone, `best` by margin.

        `ends` (4 + K, L, ndim, 1 or R) is what inputs lead to (`Interval.displacement_sets`); several threads call it.
        """
        raise NotImplementedError

    def preferred(self, batch: Batch, scores: FloatArray) -> FloatArray:
        """For each state the safe input of least score (M, L) that the true sets pass, else `Batch.best`: (M,)."""
        to_go = np.where(batch.steps_to_go < 0, NOT_ADMISSIBLE, batch.steps_after + 1)
        # so that `propose`, which judges by max(to_go, within) - 1 steps, finds `steps_after` again
        checked = batch._replace(within=1, steps_to_go=to_go, safe=batch.safe.copy(), best=batch.best.copy())
        self._fill_in_and_check(checked, scores, TRUE_SETS_ONLY, np.arange(len(to_go)))
        return checked.best

    def choose_by_rule(self, batch: Batch, rule: str) -> FloatArray:
        """To be implemented by proved tables: the input by a rule of `RULES` for each state, -1 for none: (M,)."""
        raise NotImplementedError

    def bounds_of_next_points(
        self, points: FloatArray, inputs: FloatArray, step: int
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The box in which a controller that remembers goes on, and how far off it the next prediction may be.

        Two corners (M, ndim): ends of undisturbed paths of the longest and the shortest interval, widened by
        `problem.error_growth`; and 2 E.
        """
        # `CertifiedTable` has its own: there the box is of cells, and a state may be known to be at a wall
        problem, interval, ends = self.problem, self.problem.interval(step), []
        still = np.zeros((len(points), problem.dynamics.disturbance_dim))
        # with jitter an interval may be shorter, too (`Sensing.hold`)
        longest, early = problem.sensing.hold(problem.delta)
        for length in sorted({longest, longest - early}):
            states = points
            for part in range(STRIDES):
                t = problem.time(step) + length * part / STRIDES
                states = interval.advance(states, inputs, still, t, length / STRIDES)
            ends.append(states)
        low, high = np.min(ends, axis=0) - problem.error_growth, np.max(ends, axis=0) + problem.error_growth
        return self.grid.clipped(low), self.grid.clipped(high), 2 * problem.half_widths[0]

    def next_points(
        self, points: FloatArray, inputs: FloatArray, step: int, seen: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """The points (M, ndim) with which a controller that remembers goes on, and where it cannot: (M,).

        The predictions `seen`, on any lap, clipped to the box (*Memory* in `sdhj.problem.sensing`).
        """
        # `sdhj_remember` in sdhj.h does the same for an exported table, with ten times the slack of cells for
        # `POINT_ROUNDING`
        low, high, off = self.bounds_of_next_points(points, inputs, step)
        length, periodic = np.subtract(self.grid.upper, self.grid.lower), np.array(self.grid.periodic)
        turns = np.where(periodic, np.floor((seen - (low + high) / 2) / length + 0.5), 0.0) * length
        anywhere, near = periodic & (high - low >= length), seen - turns
        far = off + POINT_ROUNDING * np.maximum(np.abs(self.grid.lower), np.abs(self.grid.upper))
        held = anywhere | ((near >= low - far) & (near <= high + far))  # not where they are unknown
        lost = ~held.all(axis=1)
        return np.where(anywhere | lost[:, None], seen, np.clip(near, low, high)), lost

    def passes_true_sets(self, states: FloatArray, inputs: FloatArray, step: int, left: FloatArray) -> FloatArray:
        """Whether an input for each state passes the true sets, with `left` steps to go after it: (M,)."""
        safe = inputs[:, None] == np.arange(len(self.problem.inputs))
        # with left + 1 steps to go, as `propose` takes one off
        checked = Batch(states, step, 1, left + 1, safe, np.zeros(safe.shape), np.full(len(safe), NOT_ADMISSIBLE))
        self._fill_in_and_check(checked, checked.margins, TRUE_SETS_ONLY, np.arange(len(safe)))
        return safe.any(axis=1)

    def hazards(self, states: FloatArray, step: int) -> FloatArray:
        """Which inputs stay clear of the unsafe sets over the interval from a step, as level-set values.

        Parameters
        ----------
        states : (M, ndim) array
        step : int
            k, from 0 to N - 1.

        Returns
        -------
        (M, L) array
            The value of each input's avoid tube: <= 0 if it stays clear (of a certified table by proof), -inf if no set
            is unsafe under it.

        Examples
        --------
        With the robot on a line of `help(sdhj)`:

        >>> table.hazards(np.array([[2.9]]), 0) <= 0
        array([[ True,  True, False]])
        """
        step = whole("step", step, least=0, most=self.steps - 1)
        return self._hazards(states_array("states", states, self.grid.ndim), step)

    def _hazards(self, states: FloatArray, step: int) -> FloatArray:
        """To be implemented: the avoid tubes' values (M, L), as `hazards` says, at finite states."""
        raise NotImplementedError

    def values_at(self, points: FloatArray, step: int, within: FloatArray) -> FloatArray:
        """Level-set values of tubes at V points for each of M states, as computed, without a look at the true sets: (M,
        V).

        Parameters
        ----------
        points : (M, V, ndim) array
        step : int
            k, from 0 to N.
        within : (M,) int array
            The steps to go of each row's tube.

        Examples
        --------
        With the robot on a line of `help(sdhj)`:

        >>> table.values_at(np.array([[[-2.0], [2.0]]]), 0, np.array([3])) <= 0
        array([[ True,  True]])
        """
        points, step = finite_array("points", points), whole("step", step, least=0, most=self.steps)
        within = np.clip(within, 0, self.steps - step)
        if points.ndim != 3 or points.shape[::2] != (len(within), self.grid.ndim):
            raise ValueError(f"points must have shape ({len(within)}, V, {self.grid.ndim}), got {points.shape}")
        return self._values_at(points, step, within)

    def _values_at(self, points: FloatArray, step: int, within: FloatArray) -> FloatArray:
        """To be implemented: `values_at`, all arguments checked."""
        raise NotImplementedError

    # ---- to be implemented

    @property
    def nbytes(self) -> int:
        """To be implemented: bytes that the table takes in memory or, if it is stored, would take."""
        raise NotImplementedError

    def values(self, *, start: int = 0, within: int | None = None) -> FloatArray:
        """To be implemented: the level-set function of a tube, at nodes or cells: array of grid.shape."""
        raise NotImplementedError

    def inputs(self, *, start: int = 0, within: int | None = None) -> FloatArray:
        """To be implemented: which inputs lead from each node, or cell, into the next tube: bool, grid.shape + (L,)."""
        raise NotImplementedError

    def save(self, path: str | os.PathLike[str], compress: bool = False) -> None:
        """Write a self-describing file, whole or not at all."""
        raise NotImplementedError


def threads() -> int:
    """The number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def share_out(grid: Grid, states: FloatArray, work: Callable[[FloatArray], None]) -> None:
    """Call `work(rows)` for all rows of states, each once, from several threads where they are many."""
    if len(states) <= CHUNK:
        if len(states):
            work(np.arange(len(states)))
        return
    order = _by_cell(grid, states)  # those of a chunk read the same nodes
    with ThreadPoolExecutor(threads()) as pool:
        # an error in `work` is raised here
        list(pool.map(work, [order[begin : begin + CHUNK] for begin in range(0, len(states), CHUNK)]))


def _by_cell(grid: Grid, states: FloatArray) -> FloatArray:
    """An order (M,) of states in which those that read the same nodes are close together."""
    # No answer hangs on the order, only the time. On large grids some successive cells count as one,
    # so that numbers fit into 16 bits, which are sorted ten times as fast.
    lower, spacing, shape = grid.arrays[:3]
    cells = np.clip((states - lower) / spacing, 0, shape - 1).astype(np.int64)
    places = np.ravel_multi_index(tuple(cells.T), grid.shape)
    return np.argsort((places // (grid.size // 2**16 + 1)).astype(np.uint16), kind="stable")
