"""The recursion of Theorem 2 (Algorithm 1): from the one-step games to the look-up table."""

import time
import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numba import njit, prange
from tqdm import tqdm

from sdhj.compiling import announced, hidden
from sdhj.games import KEPT, HJISolver, JointSolver, LaxSolver, Solver, avoid_axes, velocity_bytes
from sdhj.grid import FloatArray, Grid
from sdhj.hopf_lax import INTERPOLATIONS
from sdhj.memory import require
from sdhj.problem import ReachAvoidProblem, UnsafeSet
from sdhj.projections import INNER, ProjectedSolver
from sdhj.schemes import Scheme
from sdhj.table import AvoidTubes, LookupTable

if TYPE_CHECKING:
    from sdhj.certified.sets import LipschitzBounds

METHODS = ("hji", "projected", "lax", "certified")
GAMES = ("decomposed", "joint")
OPTIONS = {  # what each stands for where it is not given, and the methods that read it
    "scheme": (None, ("hji", "projected", "lax")),
    "games": ("decomposed", ("hji",)),
    "interpolation": ("limited", ("lax", "projected")),
    "subspaces": (None, ("projected",)),
    "inner": ("hji", ("projected",)),
    "cells": (None, ("certified",)),
    "bounds": (None, ("certified",)),
}
PROCESS = 200_000_000  # bytes that Python, NumPy and the compiled kernels take before anything is solved


@njit(cache=True)
def _take_row(tube, mask, reach, wall, level, bit):
    for i in range(reach.size):
        value = reach[i] if reach[i] > wall[i] else wall[i]
        value = value if value > level else level
        mask[i] |= bit if value <= 0 else np.uint8(0)
        tube[i] = value if value < tube[i] else tube[i]


@njit(cache=True)
def _higher(a, b, size):
    """A row of the maximum of two rows of one length: `size`, or 1 for one value that holds for the whole row."""
    row = np.empty(size, a.dtype)
    for i in range(size):
        at = min(i, a.size - 1)
        row[i] = a[at] if a[at] > b[at] else b[at]
    return row


@njit(cache=True, parallel=True)
def add_input(tube, mask, reach, static, static_at, moving, moving_at, bit):
    """tube = min(tube, max(reach, static, moving)); set `bit` of `mask` where that maximum is <= 0. In place.

    tube, mask, reach : (R, B), the grid in rows.
    static, moving : (r, B), or (r, 1) where they do not depend on the axes within a row; row `static_at[i]` or
        `moving_at[i]` belongs to row i of the grid.
    """
    rows, size = tube.shape
    for r in prange(rows):
        wide, narrow = static[static_at[r]], moving[moving_at[r]]
        if wide.size < narrow.size:
            wide, narrow = narrow, wide
        if wide.size == narrow.size:
            wide = _higher(wide, narrow, size)
        level = narrow[0] if narrow.size < size else tube.dtype.type(-np.inf)
        _take_row(tube[r], mask[r], reach[r], wide, level, bit)


def solve(
    problem: ReachAvoidProblem,
    *,
    method: str = "hji",
    scheme: Scheme | None = None,
    games: str = "decomposed",
    interpolation: str = "limited",
    subspaces: Sequence[Sequence[int]] | None = None,
    inner: str = "hji",
    cells: Sequence[int] | None = None,
    bounds: "LipschitzBounds | None" = None,
    progress: bool | None = None,
) -> LookupTable:
    """Compute every S_k^i and, at every node, the inputs that are guaranteed to make progress (Algorithm 1).

    Parameters
    ----------
    problem : ReachAvoidProblem
    method : {"hji", "projected", "lax", "certified"}
        Finite differences on the whole grid; on lower-dimensional subspaces (Sec. 5.1); the Hopf-Lax formula; or cells
        with a proof (`sdhj.certified.sets.certify`).
    scheme : Scheme, optional
        How "hji" and "projected" discretise; "lax" takes its precision from it.
    games : {"decomposed", "joint"}
        For "hji": reach and avoid apart (App. A.3), or the one PDE of Prop. 1.
    interpolation : {"limited", "linear"}
        For "lax", and for "projected" with inner="lax".
    subspaces : sequence of sequence of int, optional
        For "projected": the axes that each subspace keeps. By default each axis that no input drives is dropped, one at
        a time; for the case studies those are the paper's (0, 1, 2) and (0, 1, 3).
    inner : {"hji", "lax"}
        For "projected": how the games on the subspaces are solved.
    cells : sequence of int, optional
        For "certified": about how many cells each axis gets.
    bounds : sdhj.certified.sets.LipschitzBounds, optional
        For "certified" and a problem of your own: how fast its functions can change with the state.
    progress : bool, optional
        Show a progress bar; by default where standard error is a terminal.

    Returns
    -------
    LookupTable

    Raises
    ------
    ValueError
        For an unknown option, or a method that does not fit the dynamics.
    MemoryError
        Where less memory is available than `memory_needed` says (not for "certified"); before anything is solved.
    """
    told = {"scheme": scheme, "games": games, "interpolation": interpolation, "subspaces": subspaces, "inner": inner}
    _check_options(problem, method, told | {"cells": cells, "bounds": bounds})
    if method == "certified":
        from sdhj.certified.sets import certify
        from sdhj.certified.table import CertifiedTable

        with announced(progress):
            return CertifiedTable(certify(problem, cells=cells, bounds=bounds, progress=progress))  # type: ignore[return-value]  # the same interface
    scheme = Scheme() if scheme is None else scheme
    remedy = 'use fewer nodes, fewer steps, or Scheme(dtype="float32")'
    require(memory_needed(problem, scheme.dtype), "this solve", remedy)
    solver: Solver
    if method == "projected":
        solver = ProjectedSolver(problem, scheme, subspaces, inner=inner, interpolation=interpolation)
    elif method == "lax":
        solver = LaxSolver(problem, interpolation, scheme.dtype)
    else:
        solver = JointSolver(problem, scheme) if games == "joint" else HJISolver(problem, scheme)
    started = time.perf_counter()
    details: dict[str, Any] = {"games": games}
    details |= {"interpolation": interpolation, "dtype": scheme.dtype} if method == "lax" else vars(scheme)
    if isinstance(solver, ProjectedSolver):
        details |= solver.options
    total = problem.steps * (problem.steps + 1) // 2
    bar = tqdm(total=total, desc=method, unit="tube", disable=hidden(progress))
    with bar, announced(progress):
        table = _recursion(problem, solver, method, details, bar)
    details["seconds"] = time.perf_counter() - started
    if isinstance(solver, ProjectedSolver):
        details["projection"] = solver.diagnose(table)
    return table


def _check_options(problem: ReachAvoidProblem, method: str, given: dict[str, Any]) -> None:
    """Raise ValueError for what is unknown, or does not go with the method and so would be passed over."""
    if not isinstance(problem, ReachAvoidProblem):
        raise ValueError(f"problem must be a ReachAvoidProblem, got {problem!r}")
    closed = {"method": METHODS, "games": GAMES, "interpolation": INTERPOLATIONS, "inner": INNER}
    for name, allowed in closed.items():
        if (value := method if name == "method" else given[name]) not in allowed:
            raise ValueError(f"{name} must be one of {', '.join(allowed)}, got {value!r}")
    if not isinstance(given["scheme"], Scheme | None):
        raise ValueError(f"scheme must be a sdhj.Scheme, for example Scheme(order=3), got {given['scheme']!r}")
    for name, (usual, methods) in OPTIONS.items():
        changed = given[name] is not None if usual is None else given[name] != usual
        if changed and method not in methods:
            fitting = " or ".join(f'"{one}"' for one in methods)
            raise ValueError(f"{name}={given[name]!r} goes with method={fitting}, got method={method!r}")
    other = given["interpolation"] != OPTIONS["interpolation"][0]
    if other and method == "projected" and given["inner"] != "lax":
        raise ValueError(f'interpolation={given["interpolation"]!r} goes with inner="lax", got {given["inner"]!r}')


def memory_needed(problem: ReachAvoidProblem, dtype: str = "float32") -> int:
    """Bytes that `solve` takes at its peak, estimated from above, for every method but "certified".

    The table, the avoid tubes, and what is sampled and solved at a time; not what the problem's own functions take.
    """
    grid, count, item = problem.grid, len(problem.inputs), np.dtype(dtype).itemsize
    entries = (problem.steps + 1) * (problem.steps + 2) // 2
    table = entries * grid.size * (item + -(-count // 8))

    def avoid(moving: bool) -> int:
        axes = {axis for part in problem.unsafe if part.moving == moving for axis in avoid_axes(problem, part)}
        return item * count * grid.subgrid(sorted(axes)).size * (problem.steps if moving else 1) if axes else 0

    sampled = grid.sampling_bytes
    solved = 12 * item * grid.size  # stages with their ghost nodes, shifted copies
    if not problem.dynamics.constant:  # the velocities of one input at a time
        sampled += velocity_bytes(problem) + min(KEPT, count * velocity_bytes(problem))
        solved += item * grid.ndim * (3 + problem.dynamics.bounds.size) * grid.size
    return PROCESS + table + avoid(False) + avoid(True) + sampled + solved


def avoid_tubes(problem: ReachAvoidProblem, solver: Solver) -> AvoidTubes:
    """Games 1 and 2 for every step and input: static sets once, moving ones for each step."""
    steps, count = problem.steps, len(problem.inputs)

    def merge(parts: list[UnsafeSet], step: int, axes: tuple[int, ...]) -> FloatArray:
        if len(parts) == 1:
            return tubes_of(parts[0], step)
        subgrid = problem.grid.subgrid(axes) if axes else None
        merged = np.full((count, *(subgrid.shape if subgrid else ())), -np.inf, solver.dtype)
        for part in parts:
            tubes = tubes_of(part, step)
            own = [axes.index(axis) for axis in avoid_axes(problem, part)]
            for j in range(count):
                assert subgrid is not None
                np.maximum(merged[j], subgrid.lift(tubes[j], own), out=merged[j])
        return merged

    seen: set[int] = set()

    def tubes_of(part: UnsafeSet, step: int) -> FloatArray:
        tubes = solver.avoid(part, step)
        if (tubes > 0).any():
            seen.add(id(part))
        return tubes

    static = [part for part in problem.unsafe if not part.moving]
    moving = [part for part in problem.unsafe if part.moving]
    axes = [tuple(sorted({axis for part in parts for axis in avoid_axes(problem, part)})) for parts in (static, moving)]
    tubes = AvoidTubes(
        static_axes=axes[0],
        static=merge(static, 0, axes[0]),
        moving_axes=axes[1],
        moving=np.stack([merge(moving, step, axes[1]) for step in range(steps)]),
    )
    for part in problem.unsafe:
        if id(part) not in seen:
            told = (
                f"no node is ever in danger of the unsafe set {part.name!r}: the table does not know of it. It falls "
            )
            warnings.warn(told + "between the nodes (use more, or enlarge it), or is out of reach", stacklevel=4)
    return tubes


class _Rows:
    """Avoid tubes as `add_input` reads them: rows of the last axes, looked up by the rows of the whole grid."""

    def __init__(self, grid: Grid, tubes: AvoidTubes) -> None:
        whole = set(range(grid.ndim))
        used = [set(tubes.static_axes), set(tubes.moving_axes)]
        self.last = 1  # axes in a row: each tube depends on all of them or on none
        for last in range(2, max(1, grid.ndim // 2) + 1):
            trailing = set(range(grid.ndim - last, grid.ndim))
            if all(trailing <= axes or not trailing & axes for axes in used):
                self.last = last
        self.size = int(np.prod(grid.shape[-self.last :]))
        trailing = set(range(grid.ndim - self.last, grid.ndim))
        self.inside = [trailing <= axes for axes in used]
        self.at = [self._lookup(grid, sorted(axes & (whole - trailing))) for axes in used]
        self.tubes = tubes

    def _lookup(self, grid: Grid, axes: list[int]) -> FloatArray:
        """For each row of the grid the row of a tube on `axes` and those within the row."""
        leading = grid.shape[: grid.ndim - self.last]
        own = np.arange(int(np.prod([grid.shape[axis] for axis in axes])))
        shape = [n if axis in axes else 1 for axis, n in enumerate(leading)]
        return np.ascontiguousarray(np.broadcast_to(own.reshape(shape), leading)).ravel()

    def of(self, values: FloatArray) -> FloatArray:
        return values.reshape(-1, self.size)

    def walls(self, step: int, j: int) -> tuple[FloatArray, ...]:
        """static, static_at, moving, moving_at of `add_input`."""
        parts = (self.tubes.static[j], self.tubes.moving[step, j])
        rows = [part.reshape(-1, self.size if inside else 1) for part, inside in zip(parts, self.inside, strict=True)]
        return rows[0], self.at[0], rows[1], self.at[1]


def _known_already(table: LookupTable, k: int, n: int) -> tuple[int, int] | None:
    """The entry (k', n') that S_k with n to go must equal, because all that it is made of is equal; or None."""

    def same(one: tuple[int, int], other: tuple[int, int]) -> bool:
        return np.array_equal(table.value_array(*one), table.value_array(*other))

    if n >= 2 and same((k + 1, n - 1), (k + 1, n - 2)):  # the next tube has stopped growing, so has this one
        return k, n - 1
    timeless = not any(part.moving for part in table.problem.unsafe)
    alike = timeless and k + 1 + n <= table.steps
    if alike and same((k, n - 1), (k + 1, n - 1)) and same((k + 1, n - 1), (k + 2, n - 1)):
        return k + 1, n
    return None


def _recursion(
    problem: ReachAvoidProblem, solver: Solver, method: str, details: dict[str, Any], bar: Any
) -> LookupTable:
    """Rows k from the last to the first; within a row, one more step to go at a time."""
    steps = problem.steps
    tubes = avoid_tubes(problem, solver)
    table = LookupTable.empty(problem, method, solver.dtype, tubes, details)
    rows = _Rows(problem.grid, tubes)
    details |= {"pdes_of_algorithm": _games(problem), "tubes_copied": 0}
    for k in range(steps, -1, -1):
        table.value_array(k, 0)[:] = problem.goal(k)
        if isinstance(solver, ProjectedSolver) and k < steps:
            solver.add_row(table, tubes, k)
            bar.update(steps - k)
            continue
        for n in range(1, steps - k + 1):
            if (known := _known_already(table, k, n)) == (k, n - 1):
                table.share(k, n)
                details["tubes_copied"] += 1
            elif known:
                table.value_array(k, n)[:] = table.value_array(*known)
                table.mask_array(k, n)[:] = table.mask_array(*known)
                details["tubes_copied"] += 1
            else:
                _fill(table, solver, rows, k, n)
            bar.update()
    details["pdes_solved"] = solver.solved
    return table.finish(details)


def _games(problem: ReachAvoidProblem) -> int:
    """How many PDEs Algorithm 1 asks for: reach games for every tube, avoid games for every unsafe set and step."""
    steps = problem.steps
    avoid = sum(steps if part.moving else 1 for part in problem.unsafe)
    return len(problem.inputs) * (steps * (steps + 1) // 2 + avoid)


def _fill(table: LookupTable, solver: Solver, rows: _Rows, k: int, n: int) -> None:
    """S_k with n to go, from S_k with n - 1 and S_{k+1} with n - 1 to go (Theorem 2)."""
    tube, mask, following = table.value_array(k, n), table.mask_array(k, n), table.value_array(k + 1, n - 1)
    tube[:] = table.value_array(k, n - 1)
    joint = isinstance(solver, JointSolver)
    nothing = (np.full((1, 1), -np.inf, solver.dtype), np.zeros(len(rows.at[0]), np.int64)) * 2
    for j, reach in solver.reach_avoid(following, k) if isinstance(solver, JointSolver) else solver.reach(following):
        static, static_at, moving, moving_at = nothing if joint else rows.walls(k, j)
        bit, marked = np.uint8(1 << j % 8), rows.of(mask[j // 8])
        add_input(rows.of(tube), marked, rows.of(reach), static, static_at, moving, moving_at, bit)
