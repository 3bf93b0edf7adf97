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

from sdhj.formulas.formula import Formula
from sdhj.kernels import FloatArray
from sdhj.problem.boxes import nodes_read
from sdhj.problem.grid import Grid
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.table.keeping import Kept, Meaning
from sdhj.table.table import LookupTable

PLANE = 2  # axes of a plane


def meaning(function: Any) -> Meaning:
    """A hashable key of what a function computes: equal keys, equal values; a black box has a new key each time,
    which equals none; () for None.
    """
    if function is None:
        return ()
    return function.meaning if isinstance(function, Formula) else (object(),)


def meaning_of_set(part: Any) -> Meaning:
    """A hashable key of what an unsafe set or a target is: its axes, sampling, inputs and functions; not its name
    or its place in the problem.
    """
    how = getattr(part, "sampling", ""), getattr(part, "inputs", None)
    return part.axes, *how, meaning(part.level_set), meaning(getattr(part, "swept", None))


def meaning_around(problem: ReachAvoidProblem) -> Meaning:
    """A hashable key of all that avoid tubes and games of one interval depend on, besides the sets: grid, delta,
    view_time, sensing, inputs and dynamics.
    """
    dynamics, sensing = problem.dynamics, tuple(map(str, vars(problem.sensing).items()))
    inputs = problem.inputs.shape, problem.inputs.tobytes()
    return problem.grid, problem.delta, problem.view_time, sensing, inputs, tuple(map(meaning, dynamics.parts))


def differing(now: FloatArray, then: FloatArray) -> FloatArray:
    """In which planes some bit of two arrays (*shape) of one type differs: (*shape[:-2]) bool."""
    kind = np.dtype(f"u{now.dtype.itemsize}")
    return np.any(now.view(kind) != then.view(kind), axis=tuple(range(now.ndim)[-PLANE:]))


@lru_cache(maxsize=64)
def _neighbours(nodes: int, periodic: bool, by: int) -> FloatArray:
    """Whether two nodes of an axis are at most `by` apart: (nodes, nodes) float32, 1 or 0."""
    distance = np.abs(np.subtract.outer(np.arange(nodes), np.arange(nodes)))
    return ((np.minimum(distance, nodes - distance) if periodic else distance) <= by).astype(np.float32)


def _near_marked(grid: Grid, planes: FloatArray, axis: int, by: int) -> FloatArray:
    """For each plane, whether one of the marked `planes`, (*shape[:-2]) bool, is up to `by` nodes away along an
    axis.
    """
    n, behind = planes.shape[axis], math.prod(planes.shape[axis + 1 :])
    lines = planes.reshape(-1, n, behind).astype(np.float32)
    return np.asarray(_neighbours(n, grid.periodic[axis], by) @ lines > 0).reshape(planes.shape)


def within_stages(grid: Grid, planes: FloatArray, order: int, stages: int) -> FloatArray:
    """The planes whose values depend on a marked one of `planes` (*shape[:-2]) bool after so many stages, each of which
    reads `order` nodes to each side, along one axis only.

    By symmetry also the planes that marked ones depend on.
    """
    for _ in range(stages if planes.any() else 0):
        if planes.all():
            break
        planes = np.logical_or.reduce([planes, *(_near_marked(grid, planes, i, order) for i in range(planes.ndim))])
    return planes


def within_boxes(grid: Grid, planes: FloatArray, cells: FloatArray) -> FloatArray:
    """The planes whose values depend on a marked one of `planes` (*shape[:-2]) bool in a maximum over boxes that
    reach cells[axis] cells along each axis.
    """
    for axis in range(planes.ndim):
        planes = _near_marked(grid, planes, axis, nodes_read(cells[axis]))
    return planes


@dataclass(eq=False)
class Patch:
    """The part of one entry (k, n) that is to be solved anew; planes are (*shape[:-2]) bool.

    grid : of the problem.
    changed : planes in which the tube that the games start from differs from the former one.
    besides : planes in which the tube with one step less to go, or an avoid tube, differs.
    former : the former tube and marks.
    was_still : the former solution of the PDE in the moving frame, where it was kept.
    rows : planes to be solved anew, as soon as the games know: then the rest is copied.
    still : the solution of the PDE now.
    """

    grid: Grid
    changed: FloatArray
    besides: FloatArray
    former: tuple[FloatArray, FloatArray]
    was_still: FloatArray | None
    rows: FloatArray = field(init=False)
    still: FloatArray | None = field(default=None, init=False)

    def solve_still(
        self, solve: Callable[[Any], FloatArray], grid: Grid, past: Sequence[int], reads: tuple[int, int], cells: Any
    ) -> FloatArray:
        """The PDE's solution in the moving frame, on a grid that goes past[axis] nodes past the ends: solve(planes)
        where it may differ from the former one, copied elsewhere; solve(None) where that was not kept.

        Sets `still` to it, and `rows` to the planes of the entry that may differ.
        reads : the order and number of stages. cells : how many the disturbance may bring a state, and how many the
            solution is shifted, at most along each axis.
        """
        lead = self.changed.ndim
        around = np.pad(self.changed, [(n, n) for n in past[:lead]], "edge") if lead else self.changed
        planes = within_stages(grid, around, *reads) | within_boxes(grid, around, cells[0])
        was = self.was_still
        if was is None or planes.all():
            still = solve(None)
        else:
            still = solve(planes) if planes.any() else was
            if still is not was:
                rest, shape = np.flatnonzero(~planes), (planes.size, -1)
                still.reshape(shape)[rest] = was.reshape(shape)[rest]
        self.still, moved = still, planes if was is None else differing(still, was)
        inner = tuple(slice(n, n + m) for n, m in zip(past, self.changed.shape, strict=False))
        self.rows = self.besides | within_boxes(grid, moved, cells[1])[inner]
        return still

    def copy_rest(self, tube: FloatArray, marks: FloatArray) -> None:
        """Copy the planes that are not in `rows` from the former entry: into a tube (*shape) and marks (bytes,
        size), in place.
        """
        rest = np.flatnonzero(~self.rows)
        for now, then in ((tube[None], self.former[0]), (marks, self.former[1])):
            own, other = (one.reshape(len(now), self.rows.size, -1) for one in (now, then))
            if len(rest) == self.rows.size:
                own[...] = other
            else:
                own[:, rest] = other[:, rest]


class Former:
    """An earlier table, as the solve of another problem looks at it: nothing is taken from it that could differ. What
    this solve keeps for the next one is in `each` and `still`.

    Parameters
    ----------
    table : LookupTable
        Of `solve` or `resolve`, in this process.
    problem : ReachAvoidProblem
        The one to be solved now.
    method : Method
    dangers : sequence of Danger
        The avoid games of the table's problem.
    """

    def __init__(self, table: LookupTable, problem: ReachAvoidProblem, method: object, dangers: Sequence[Any]) -> None:
        """Find out what the two problems have in common: whether they are `alike`, have the same target, and
        whether entries can be taken over (`has_rows`).
        """
        self.table, self.problem, was = table, problem, table.problem
        self.kept = table.reusable or Kept(None)
        self.alike = self.kept.method == method and meaning_around(was) == meaning_around(problem)
        self.same_target = was.has_no_target == problem.has_no_target and (
            problem.has_no_target or meaning_of_set(was.target) == meaning_of_set(problem.target)
        )
        # the set that is safe for ever has no rows, and without a target they are made otherwise
        self.has_rows = (
            self.alike
            and was.has_no_target == problem.has_no_target
            and not (was.has_no_target and table.details.get("endless"))
        )
        self.keys = [(danger.moves, self.key(danger)) for danger in dangers]
        self.each: dict[Meaning, list[FloatArray]] = {}
        self.still: dict[tuple[int, int], FloatArray] = {}
        self._differing: dict[tuple[int, int, int], FloatArray] = {}
        self._avoid_bounds: dict[int, FloatArray] = {}

    # ---- avoid tubes

    @staticmethod
    def key(danger: Any) -> Meaning:
        """A hashable key of all that the avoid tubes of one danger depend on, in problems that are alike."""
        return danger.axes, danger.moves, danger.problem.grid, meaning_of_set(danger.unsafe_set)

    def same(self, now: Sequence[Any], moves: bool, often: int) -> FloatArray | None:
        """The former avoid tubes of all static dangers together, or of all moving ones (`moves`), if the dangers
        `now` are the same: (often, L, *subgrid) of the first `often` steps; else None. Keeps what was kept of
        each for the next solve.
        """
        if not self.alike or [(moves, self.key(danger)) for danger in now] != [k for k in self.keys if k[0] == moves]:
            return None
        for key in map(self.key, now):
            if key in self.kept.each:
                self.each[key] = list(self.kept.each[key])
        avoid = self.table.avoid
        found: FloatArray = avoid.moving if moves else avoid.static[None]
        return found[:often] if len(found) >= often else None

    def tube(self, danger: Any, step: int) -> FloatArray | None:
        """The former avoid tubes (L, *subgrid) of one danger from a step on, if they were kept and the problems
        are alike; else None.
        """
        found = self.kept.each.get(self.key(danger), ()) if self.alike else ()
        return found[step] if step < len(found) else None

    def keep(self, danger: Any, tube: FloatArray) -> None:
        """Keep the avoid tubes of one danger, those of the next step, for the next solve."""
        self.each.setdefault(self.key(danger), []).append(tube)

    # ---- rows of the recursion

    def patch(self, table: LookupTable, step: int, within: int) -> Patch | None:
        """The patch of the entry (step, within) of a table that is being filled in: where it may differ; None where the
        former solve has no such entry, or was not alike.

        An entry that shares its tube was made when the first that shares it was.
        """
        was = self.table
        if not self.has_rows or step + within > was.steps:
            return None
        made = within
        while made > 1 and was.tube_index(step, made - 1) == was.tube_index(step, within):
            made -= 1
        former = was.value_array(step, made), was.mark_array(step, made)
        besides = self._differs(table, (step, within - 1), made - 1) | self._avoid_differs(table, step, former[0])
        changed = self._differs(table, (step + 1, within - 1), made - 1)
        return Patch(self.problem.grid, changed, besides, former, self.kept.still.get((step, made)))

    def done(self, patch: Patch, step: int, within: int) -> None:
        """Keep the PDE's solution that the games found for the entry (step, within), if they did, for the next
        solve.
        """
        if patch.still is not None:
            self.still[step, within] = patch.still

    def _differs(self, table: LookupTable, entry: tuple[int, int], made: int) -> FloatArray:
        """The planes in which an entry (k, n) of `table` differs from the entry (k, made) of the former one;
        found once.
        """
        if (*entry, made) not in self._differing:
            now, then = table.value_array(*entry), self.table.value_array(entry[0], made)
            self._differing[*entry, made] = differing(now, then)
        return self._differing[*entry, made]

    def _avoid_differs(self, table: LookupTable, step: int, tube: FloatArray) -> FloatArray:
        """The planes in which an avoid tube of a step differs from the former one, and that matters to the entry whose
        former tube (*shape) this is.

        The value of an input, max(reach, avoid), is nowhere below the tube that it is united to. So where the avoid
        tube was and is below that, the reach set alone is the value, as it was. Without a target tubes are intersected,
        and nothing follows.
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
        """At each node the greater of the values now and then, of the inputs whose functions of some axes, (L,
        *subgrid) each, differ there; -inf where none does. Broadcasts to the grid.
        """
        if now.ctypes.data == then.ctypes.data:  # they were taken over
            return np.full((1,) * self.problem.grid.ndim, -np.inf, now.dtype)
        kind = np.dtype(f"u{now.dtype.itemsize}")
        same = now.view(kind) == then.view(kind)
        found = np.where(same, now.dtype.type(-np.inf), np.maximum(now, then)).max(axis=0)
        return self.problem.grid.lift(found, axes)
