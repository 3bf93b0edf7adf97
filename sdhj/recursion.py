"""The recursion of Theorem 2 (Algorithm 1): from the one-step games to the look-up table."""

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from numba import njit, prange
from tqdm import tqdm

from sdhj.games import HJISolver, JointSolver, LaxSolver, Solver, avoid_axes
from sdhj.grid import FloatArray
from sdhj.problem import ReachAvoidProblem, UnsafeSet
from sdhj.projections import ProjectedSolver
from sdhj.schemes import Scheme
from sdhj.table import AvoidTubes, LookupTable

METHODS = ("hji", "projected", "lax", "certified")
GAMES = ("decomposed", "joint")


@njit(cache=True, parallel=True)
def add_input(tube, mask, reach, avoid, bit):
    """tube = min(tube, max(reach, avoid)); set `bit` of `mask` where that maximum is <= 0. All flat, in place."""
    for i in prange(tube.size):
        value = max(reach[i], avoid[i])
        if value <= 0.0:
            mask[i] |= bit
        tube[i] = min(tube[i], value)


def solve(
    problem: ReachAvoidProblem,
    *,
    method: str = "hji",
    scheme: Scheme | None = None,
    games: str = "decomposed",
    interpolation: str = "limited",
    subspaces: Sequence[Sequence[int]] | None = None,
    inner: str = "hji",
    progress: bool | None = None,
) -> LookupTable:
    """Compute every S_k^i and, at every node, the inputs that are guaranteed to make progress (Algorithm 1).

    Parameters
    ----------
    problem : ReachAvoidProblem
    method : {"hji", "projected", "lax", "certified"}
        Finite differences on the whole grid; on lower-dimensional subspaces (Sec. 5.1); the Hopf-Lax formula; or cells
        with a proof.
    scheme : Scheme, optional
        How "hji" and "projected" discretise; "lax" takes its precision from it.
    games : {"decomposed", "joint"}
        For "hji": reach and avoid apart (App. A.3), or the one PDE of Prop. 1.
    interpolation : {"limited", "linear"}
        For "lax".
    subspaces : sequence of sequence of int, optional
        For "projected": the axes that each subspace keeps. By default each axis that no input drives is dropped, one at
        a time; for the case studies those are the paper's (0, 1, 2) and (0, 1, 3).
    inner : {"hji", "lax"}
        For "projected": how the games on the subspaces are solved.
    progress : bool, optional
        Show a progress bar; by default where standard error is a terminal.

    Returns
    -------
    LookupTable

    Raises
    ------
    ValueError
        For an unknown option, or a method that does not fit the dynamics.
    """
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}, got {method!r}")
    if games not in GAMES:
        raise ValueError(f"games must be one of {', '.join(GAMES)}, got {games!r}")
    if games == "joint" and method != "hji":
        raise ValueError(f'games="joint" goes with method="hji", got method={method!r}')
    scheme = Scheme() if scheme is None else scheme
    if method != "projected" and (subspaces is not None or inner != "hji"):
        raise ValueError(f'subspaces and inner go with method="projected", got method={method!r}')
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
    bar = tqdm(total=problem.steps * (problem.steps + 1) // 2, desc=method, unit="tube", disable=None if progress is None else not progress)
    with bar:
        table = _recursion(problem, solver, method, details, bar)
    details["seconds"] = time.perf_counter() - started
    if isinstance(solver, ProjectedSolver):
        details["projection"] = solver.diagnose(table)
    return table


def avoid_tubes(problem: ReachAvoidProblem, solver: Solver) -> AvoidTubes:
    """Games 1 and 2 for every step and input: static sets once, moving ones for each step."""
    steps, count = problem.steps, len(problem.inputs)

    def merge(parts: list[UnsafeSet], step: int, axes: tuple[int, ...]) -> FloatArray:
        subgrid = problem.grid.subgrid(axes) if axes else None
        merged = np.full((count, *(subgrid.shape if subgrid else ())), -np.inf, solver.dtype)
        for part in parts:
            tubes = solver.avoid(part, step)
            own = [axes.index(axis) for axis in avoid_axes(problem, part)]
            for j in range(count):
                assert subgrid is not None
                np.maximum(merged[j], subgrid.lift(tubes[j], own), out=merged[j])
        return merged

    static = [part for part in problem.unsafe if not part.moving]
    moving = [part for part in problem.unsafe if part.moving]
    axes = [tuple(sorted({axis for part in parts for axis in avoid_axes(problem, part)})) for parts in (static, moving)]
    return AvoidTubes(
        static_axes=axes[0],
        static=merge(static, 0, axes[0]),
        moving_axes=axes[1],
        moving=np.stack([merge(moving, step, axes[1]) for step in range(steps)]),
    )


def _recursion(problem: ReachAvoidProblem, solver: Solver, method: str, details: dict[str, Any], bar: Any) -> LookupTable:
    """Rows k from the last to the first; within a row, one more step to go at a time."""
    steps, count = problem.steps, len(problem.inputs)
    tubes = avoid_tubes(problem, solver)
    table = LookupTable.empty(problem, method, solver.dtype, tubes, details)
    joint = isinstance(solver, JointSolver)
    nothing = np.broadcast_to(np.array(-np.inf, solver.dtype), problem.grid.size)
    for k in range(steps, -1, -1):
        table.value_array(k, 0)[:] = problem.goal(k)
        if isinstance(solver, ProjectedSolver) and k < steps:
            solver.add_row(table, tubes, k)
            bar.update(steps - k)
            continue
        avoid = [] if k == steps or joint else [tubes.lifted(problem.grid, k, j).ravel() for j in range(count)]
        for n in range(1, steps - k + 1):
            tube, mask = table.value_array(k, n), table.mask_array(k, n)
            tube[:] = table.value_array(k, n - 1)
            following = table.value_array(k + 1, n - 1)
            inputs = solver.reach_avoid(following, k) if isinstance(solver, JointSolver) else solver.reach(following)
            for j, reach in inputs:
                add_input(
                    tube.reshape(-1), mask[j // 8], reach.reshape(-1), nothing if joint else avoid[j], np.uint8(1 << j % 8)
                )
            bar.update()
    return table
