"""What a solve takes over from an earlier one: `sdhj.resolve`.

The recursion is a function of the sets: the entry (k, n) follows from (k, n - 1), (k + 1, n - 1) and the avoid tubes
of step k. Where these have, to the last bit, the values that they had in an earlier solve with the same grid, dynamics
and method, so has the entry, and it is copied. Differences are looked for in *planes*, the nodes of the last two axes,
in which the kernels of the games run through a grid: a choice (*grid.shape[:-2]) says which planes are meant.

What differs spreads as far as a stage of the Runge-Kutta scheme reads (`Scheme.reads`), and shifts and maxima over
boxes do (`nodes_read`); in the moving frame, whose PDE was kept, only as far as its solution does differ.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from sdhj.formulas.formula import BlackBox, Formula
from sdhj.kernels import FloatArray
from sdhj.problem.boxes import nodes_read
from sdhj.problem.grid import Grid
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sets import TargetSet, UnsafeSet
from sdhj.table.keeping import Kept, Meaning
from sdhj.table.table import LookupTable

PLANE = 2  # axes of a plane


def meaning(function: Formula | BlackBox | None) -> Meaning:
    """A hashable key of what a function computes: functions with equal keys have equal values, to the last bit.

    A black box has a new key at each call, which equals no other; None has the key ().
    """
    if function is None:
        return ()
    return function.meaning if isinstance(function, Formula) else (object(),)


def meaning_of_set(part: TargetSet | UnsafeSet) -> Meaning:
    """A hashable key of an unsafe set or a target: its axes, sampling, inputs and functions, but not its name."""
    how = getattr(part, "sampling", ""), getattr(part, "inputs", None)
    return part.axes, *how, meaning(part.level_set), meaning(getattr(part, "swept", None))


def meaning_around(problem: ReachAvoidProblem) -> Meaning:
    """A hashable key of all that the games of an interval depend on besides the sets.

    That is the grid, delta, view_time, sensing, inputs and dynamics; a black box among these makes the key unlike any
    other.
    """
    dynamics, sensing = problem.dynamics, tuple(map(str, vars(problem.sensing).items()))
    inputs = problem.inputs.shape, problem.inputs.tobytes()
    return problem.grid, problem.delta, problem.view_time, sensing, inputs, tuple(map(meaning, dynamics.parts))


def differing(now: FloatArray, then: FloatArray) -> FloatArray:
    """In which planes of the last two axes any bit of two arrays (*shape) differs: (*shape[:-2]) bool.

    The arrays have one dtype.
    """
    kind = np.dtype(f"u{now.dtype.itemsize}")
    return np.any(now.view(kind) != then.view(kind), axis=tuple(range(now.ndim)[-PLANE:]))


@lru_cache(maxsize=64)
def _neighbours(nodes: int, periodic: bool, by: int) -> FloatArray:
    """Whether two nodes of an axis are at most `by` apart, around a periodic axis: (nodes, nodes) float32, 1 or 0.

    Cached: the array is shared and must not be written.
    """
    distance = np.abs(np.subtract.outer(np.arange(nodes), np.arange(nodes)))
    return ((np.minimum(distance, nodes - distance) if periodic else distance) <= by).astype(np.float32)


def _near_marked(grid: Grid, planes: FloatArray, axis: int, by: int) -> FloatArray:
    """Which planes are at most `by` nodes, along a grid's `axis`, from a marked one: a new bool array like `planes`.

    planes : (*shape[:-2]) bool, the marked ones; each is near itself. axis : one of the first ndim - 2.
    """
    n, behind = planes.shape[axis], math.prod(planes.shape[axis + 1 :])
    lines = planes.reshape(-1, n, behind).astype(np.float32)
    return np.asarray(_neighbours(n, grid.periodic[axis], by) @ lines > 0).reshape(planes.shape)


def within_stages(grid: Grid, planes: FloatArray, order: int, stages: int) -> FloatArray:
    """Which planes depend on a marked one of `planes` (*shape[:-2]) bool after some stages of finite differences.

    A stage reads `order` nodes to each side, along one axis at a time. As reading is symmetric, these are also the
    planes that marked ones depend on. Returns `planes` itself if none or all are marked, else a new array.
    """
    for _ in range(stages if planes.any() else 0):
        if planes.all():
            break
        planes = np.logical_or.reduce([planes, *(_near_marked(grid, planes, i, order) for i in range(planes.ndim))])
    return planes


def within_boxes(grid: Grid, planes: FloatArray, cells: FloatArray) -> FloatArray:
    """Which planes have a node whose maximum over a box around it reads a marked plane: (*shape[:-2]) bool.

    planes : (*shape[:-2]) bool, the marked ones, which are not changed. cells : (ndim,), how many cells a box reaches
        along each axis, a whole number or not; the last two are not used.
    """
    for axis in range(planes.ndim):
        planes = _near_marked(grid, planes, axis, nodes_read(cells[axis]))
    return planes


@dataclass(eq=False)
class Patch:
    """The part of one entry (k, n) that has to be solved anew, where an earlier solve has the rest.

    `Former.patch` makes it. The games set `rows`, in `grouped_reach_sets`, before they yield anything; only there are
    their reach sets right. `copy_rest` then copies the other planes. Arrays of planes are (*shape[:-2]) bool, a plane
    being the nodes of the last two axes.

    Attributes
    ----------
    grid : Grid
        The problem's.
    changed : array of planes
        Where the tube (k + 1, n - 1), from which the games start, differs from the former one.
    other_changes : array of planes
        Where the tube (k, n - 1) or an avoid tube differs in a way that matters to the entry.
    former : pair of arrays
        The former tube (*shape) and its marks (bytes, size).
    former_frame_solution : (*shape) array, or None
        The former solution of the PDE in the moving frame, on the games' grid there; None if it was not kept.
    rows : array of planes
        Which planes of the entry are solved anew; set by the games.
    frame_solution : (*shape) array, or None
        The solution of the PDE in the moving frame now; set by `solve_in_frame`.
    """

    grid: Grid
    changed: FloatArray
    other_changes: FloatArray
    former: tuple[FloatArray, FloatArray]
    former_frame_solution: FloatArray | None
    rows: FloatArray = field(init=False)
    frame_solution: FloatArray | None = field(default=None, init=False)

    def solve_in_frame(
        self, solve: Callable[[Any], FloatArray], grid: Grid, past: Sequence[int], reads: tuple[int, int], cells: Any
    ) -> FloatArray:
        """The solution (*grid.shape) of the PDE in the moving frame: new where it may differ, else the former one.

        Sets `frame_solution` to the solution, and `rows` to the planes of the entry that may differ. Where nothing can
        differ, the former array itself is returned.

        solve : solve(planes) returns the solution (*grid.shape), a new array that needs to be right only in these
            planes of `grid`; solve(None) returns all of it. It is called once at most.
        grid : the problem's, extended by past[axis] nodes past both ends of each axis.
        reads : how many nodes to each side a stage of the time steps reads, and the number of stages.
        cells : two arrays (ndim,): by how many cells at most the disturbance moves a state, and by how many the
            solution is shifted.
        """
        lead = self.changed.ndim
        around = np.pad(self.changed, [(n, n) for n in past[:lead]], "edge") if lead else self.changed
        planes = within_stages(grid, around, *reads) | within_boxes(grid, around, cells[0])
        was = self.former_frame_solution
        if was is None or planes.all():
            solution = solve(None)
        else:
            solution = solve(planes) if planes.any() else was
            if solution is not was:
                rest, shape = np.flatnonzero(~planes), (planes.size, -1)
                solution.reshape(shape)[rest] = was.reshape(shape)[rest]
        self.frame_solution, moved = solution, planes if was is None else differing(solution, was)
        inner = tuple(slice(n, n + m) for n, m in zip(past, self.changed.shape, strict=False))
        self.rows = self.other_changes | within_boxes(grid, moved, cells[1])[inner]
        return solution

    def copy_rest(self, tube: FloatArray, marks: FloatArray) -> None:
        """Copy the planes that are not marked in `rows` from the former entry, tube and marks, in place.

        tube : (*shape), contiguous. marks : (bytes, *shape) or (bytes, size) uint8. Both are written only in these
            planes. `rows` has to be set.
        """
        rest = np.flatnonzero(~self.rows)
        for now, then in ((tube[None], self.former[0]), (marks, self.former[1])):
            own, other = (one.reshape(len(now), self.rows.size, -1) for one in (now, then))
            if len(rest) == self.rows.size:
                own[...] = other
            else:
                own[:, rest] = other[:, rest]


class Former:
    """An earlier table, as the solve of a similar problem looks at it; nothing is copied that could differ.

    `avoid_tubes` and `tube` give avoid tubes, `patch` says what is left to solve of an entry, in the order of
    `recursion`. What this solve hands to the next one is collected in `avoid_tubes_by_danger` and `frame_solutions` on
    the way.

    Parameters
    ----------
    table : LookupTable
        Made by `solve` or `resolve` in this process.
    problem : ReachAvoidProblem
        The one to be solved now.
    method : Method
        By which it is solved now.
    dangers : sequence of Danger
        The avoid games of the table's problem.

    Attributes
    ----------
    kept : Kept
        What the earlier solve has kept; empty, of method None, if it has kept nothing.
    alike : bool
        Whether method, grid, delta, dynamics and all else but target and unsafe sets are equal. If not, nothing is
        copied.
    same_target : bool
        Whether the targets are equal, or both problems have none.
    entries_may_be_copied : bool
        Whether entries of the recursion may be copied: the problems are alike, and both have a target or neither
        has.
    keys : list of (bool, key)
        For each danger of the table's problem whether it moves, and its `key`.
    avoid_tubes_by_danger : dict
        By the key of a danger, its avoid tubes (L, *subgrid) of steps 0, 1, ...: for the next solve.
    frame_solutions : dict
        By (step, within), the PDE's solution in the moving frame: for the next solve.
    """

    def __init__(self, table: LookupTable, problem: ReachAvoidProblem, method: object, dangers: Sequence[Any]) -> None:
        """Compare the problems, set `alike`, `same_target` and `entries_may_be_copied`; nothing is copied yet."""
        self.table, self.problem, was = table, problem, table.problem
        self.kept = table.reusable or Kept(None)
        self.alike = self.kept.method == method and meaning_around(was) == meaning_around(problem)
        both = was.has_no_target == problem.has_no_target  # a target, or none
        self.same_target = both and (
            problem.has_no_target or meaning_of_set(was.target) == meaning_of_set(problem.target)
        )
        self.entries_may_be_copied = self.alike and both  # without a target they are made otherwise
        self.keys = [(danger.moves, self.key(danger)) for danger in dangers]
        self.avoid_tubes_by_danger: dict[Meaning, list[FloatArray]] = {}
        self.frame_solutions: dict[tuple[int, int], FloatArray] = {}
        self._differing: dict[tuple[int, int, int], FloatArray] = {}
        self._avoid_bounds: dict[int, FloatArray] = {}

    # ---- avoid tubes

    @staticmethod
    def key(danger: Any) -> Meaning:
        """A hashable key of all that the avoid tubes of a danger depend on, among problems that are alike."""
        return danger.axes, danger.moves, danger.problem.grid, meaning_of_set(danger.unsafe_set)

    def avoid_tubes(self, now: Sequence[Any], moves: bool, often: int) -> FloatArray | None:
        """The former avoid tubes of all static dangers united, or of all moving ones, or None: (steps, L, *subgrid).

        A view of the former table's array. None if the problems are not alike, if the dangers `now` are not the earlier
        ones in the same order, or if the former table has fewer steps. If the dangers are the same, what was kept of
        each of them is also put into `avoid_tubes_by_danger`.

        now : the dangers of the problem now, all static or all moving ones.
        moves : whether they are the moving ones.
        often : the number of steps wanted; 1 for static ones.
        """
        if not self.alike or [(moves, self.key(danger)) for danger in now] != [k for k in self.keys if k[0] == moves]:
            return None
        for key in map(self.key, now):
            if key in self.kept.avoid_tubes_by_danger:
                self.avoid_tubes_by_danger[key] = list(self.kept.avoid_tubes_by_danger[key])
        avoid = self.table.avoid
        found: FloatArray = avoid.moving if moves else avoid.static[None]
        return found[:often] if len(found) >= often else None

    def tube(self, danger: Any, step: int) -> FloatArray | None:
        """The former avoid tubes (L, *subgrid) of one danger over the interval from a step, to be read only; or None.

        None if the problems are not alike, or if the tubes of each danger were not kept.
        """
        found = self.kept.avoid_tubes_by_danger.get(self.key(danger), ()) if self.alike else ()
        return found[step] if step < len(found) else None

    def keep(self, danger: Any, tube: FloatArray) -> None:
        """Append a danger's avoid tubes (L, *subgrid) to `avoid_tubes_by_danger`; steps have to come in order."""
        self.avoid_tubes_by_danger.setdefault(self.key(danger), []).append(tube)

    # ---- rows of the recursion

    def patch(self, table: LookupTable, step: int, within: int) -> Patch | None:
        """What of the entry (step, within) of `table` has to be solved anew, or None for all of it.

        The entries (step, within - 1) and (step + 1, within - 1) and the avoid tubes of `table`, which is being filled
        in, must be there. None if the former table has no such entry, or if no entries may be copied
        (`entries_may_be_copied`). Where the former entry shares the tube of one with fewer steps to go, it is compared
        with what that one was made from.
        """
        was = self.table
        if not self.entries_may_be_copied or step + within > was.steps:
            return None
        made = within
        while made > 1 and was.tube_index(step, made - 1) == was.tube_index(step, within):
            made -= 1
        former = was.value_array(step, made), was.mark_array(step, made)
        other_changes = self._differs(table, (step, within - 1), made - 1) | self._avoid_differs(table, step, former[0])
        changed = self._differs(table, (step + 1, within - 1), made - 1)
        return Patch(self.problem.grid, changed, other_changes, former, self.kept.frame_solutions.get((step, made)))

    def keep_frame_solution(self, patch: Patch, step: int, within: int) -> None:
        """Put the solution of the PDE in the moving frame for the entry (step, within) into `frame_solutions`.

        Nothing is done if the games did not set `patch.frame_solution`.
        """
        if patch.frame_solution is not None:
            self.frame_solutions[step, within] = patch.frame_solution

    def _differs(self, table: LookupTable, entry: tuple[int, int], made: int) -> FloatArray:
        """In which planes the tube of an entry (k, n) of `table` differs from the former one: (*shape[:-2]) bool.

        entry : (k, n). made : the steps to go of the former tube, at step k. Found once for each k, n, made.
        """
        if (*entry, made) not in self._differing:
            now, then = table.value_array(*entry), self.table.value_array(entry[0], made)
            self._differing[*entry, made] = differing(now, then)
        return self._differing[*entry, made]

    def _avoid_differs(self, table: LookupTable, step: int, tube: FloatArray) -> FloatArray:
        """In which planes a step's avoid tubes differ from the former ones in a way that matters: (*shape[:-2]) bool.

        A difference matters where the old or the new value is at least that of `tube`: below it the value of the input,
        max(reach, avoid) >= tube, is that of the reach set alone. Without a target every difference matters. All planes
        are True where the avoid tubes depend on other axes than before.

        tube : (*shape), the former tube of the entry. The avoid tubes of `table` at this step must be there.
        """
        now, then = table.avoid, self.table.avoid
        if (now.static_axes, now.moving_axes) != (then.static_axes, then.moving_axes):
            return np.ones(tube.shape[:-PLANE], bool)
        if step not in self._avoid_bounds:
            static = self._avoid_bounds.setdefault(-1, self._highest(now.static, then.static, now.static_axes))
            moving = self._highest(now.moving[step], then.moving[step], now.moving_axes)
            self._avoid_bounds[step] = np.maximum(static, moving)
        bounds = self._avoid_bounds[step]
        tells = bounds > -np.inf if self.problem.has_no_target else (bounds > -np.inf) & (bounds >= tube)
        lead = max(tube.ndim - PLANE, 0)
        return np.asarray(np.broadcast_to(tells, tube.shape).any(axis=tuple(range(lead, tube.ndim))))

    def _highest(self, now: FloatArray, then: FloatArray, axes: Sequence[int]) -> FloatArray:
        """At each node the greatest value, now or then, of the avoid tubes that differ there in some bit, else -inf.

        The result has the dimensions of the grid, with length 1 along axes that it does not depend on.

        now, then : (L, *subgrid of `axes`), of one dtype. axes : of the grid, ascending.
        """
        if now.ctypes.data == then.ctypes.data:  # they were taken over
            return np.full((1,) * self.problem.grid.ndim, -np.inf, now.dtype)
        kind = np.dtype(f"u{now.dtype.itemsize}")
        same = now.view(kind) == then.view(kind)
        found = np.where(same, now.dtype.type(-np.inf), np.maximum(now, then)).max(axis=0)
        return self.problem.grid.lift(found, axes)
