"""The recursion of Theorem 2 (Algorithm 1): from the games of one interval to the look-up table.

    S_k^N = L(t_k) minus G(t_k),        S_k^i = S_k^{i+1}  united with  RA_k^j(S_{k+1}^{i+1})  for all inputs j

With n = N - i steps to go, the entry (k, n) follows from (k, n - 1) and (k + 1, n - 1). `recursion` implements this for
every kind of set: level-set functions on the grid (`GridSets`, for most methods), or cells with a proof.

Without a target, the entry (k, n) contains the states that can stay clear of G for n steps: those that some input keeps
clear for one step and leads into the entry (k + 1, n - 1). S_k^{i+1} is not united with them; the sets shrink with n.
"""

import warnings
from collections.abc import Callable, Mapping
from typing import Any, Protocol

import numpy as np

from sdhj.kernels import FloatArray
from sdhj.kernels.union import add_input
from sdhj.problem.grid import Grid
from sdhj.problem.memory import require
from sdhj.problem.problem import ReachAvoidProblem, shrunk
from sdhj.solver.avoid import avoid_tubes, dangers
from sdhj.solver.games import KEPT, Games
from sdhj.solver.resolution import check_resolution
from sdhj.table.batches import Table
from sdhj.table.table import QUIET, AvoidTubes, LookupTable

PROCESS = 200_000_000  # bytes that Python, NumPy and the compiled kernels need before anything is solved


class Sets(Protocol):
    """All tubes S_k with n steps to go, in some representation: the operations that Theorem 2 needs.

    timeless : whether nothing depends on time; there is then one row, and the entry (k, n) is the entry (0, n).
    Sets for problems without a number of steps also have `filled`, the largest n that is filled in, and `changing`, the
    share of the state space that the last step changed.
    """

    timeless: bool

    def goal(self, step: int) -> None:
        """Write the entry (step, 0): the target minus the unsafe sets."""

    def extend(self, step: int, within: int) -> None:
        """Write the entry (step, within), from (step, within - 1) and (step + 1, within - 1)."""

    def stopped(self, step: int, within: int) -> bool:
        """Whether the entries (step, within) and (step, within - 1) are equal."""

    def share(self, step: int, within: int) -> None:
        """Let the entry (step, within) be the entry (step, within - 1)."""

    def finish(self, details: Mapping[str, Any]) -> Table:
        """The table of all entries; `details` are added to its details."""


class UnsettledWarning(UserWarning):
    """The sets of a problem without a number of steps were still changing when the solve ended."""


def unsettled(problem: ReachAvoidProblem, steps: int, share: float, stacklevel: int) -> None:
    """Warn that a solve without a number of steps ended while a `share` of the state space was still changing."""
    holds = "the tube is safe for so many steps, not for ever" if problem.stays else "the tubes hold for so many steps"
    warnings.warn(
        f"after {steps:,} steps {share:.2%} of the nodes or cells had still changed in the last: {holds}. Use more "
        "nodes, a longer delta, or give the problem a number of steps",
        UnsettledWarning,
        stacklevel=stacklevel + 1,
    )


def recursion(sets: Sets, steps: int, done: Callable[[], Any]) -> None:
    """Fill in all entries (Theorem 2): rows k from the last to the first, and in a row one more step to go at a time.

    If nothing depends on time, one row is filled in. If the entries (k + 1, n - 1) and (k + 1, n - 2) are equal, so are
    (k, n) and (k, n - 1), and the entry is shared. A row with a shared entry may grow again, for example if the target
    appears late. `done` is called after each entry.
    """
    for step in (0,) if sets.timeless else range(steps, -1, -1):
        sets.goal(step)
        for within in range(1, steps - step + 1):
            if within >= 2 and sets.stopped(step + 1, within - 1):
                sets.share(step, within)
            else:
                sets.extend(step, within)
            done()


def memory_needed(problem: ReachAvoidProblem, dtype: str = "float32") -> int:
    """Upper estimate of the bytes that a solve on the grid needs at its peak.

    It includes the table, the avoid tubes, samples and intermediate results, but not what the problem's functions need.
    """
    grid, count, item = problem.grid, len(problem.inputs), np.dtype(dtype).itemsize
    tubes = LookupTable.rooms(problem) if problem.steps else 3  # without a number of steps each is asked for in turn
    table = tubes * grid.size * (item + -(-count // 8))

    found = dangers(problem)

    def avoid(moving: bool) -> int:
        axes = {axis for danger in found if danger.moves == moving for axis in danger.axes}
        return item * count * grid.subgrid(sorted(axes)).size * (problem.most_steps if moving else 1) if axes else 0

    sampled = grid.sampling_bytes
    kept = count if problem.sensing.jitter else 0  # the reach sets of all inputs, while an interval may end
    solved = (12 + kept) * item * grid.size  # stages with their ghost nodes, shifted copies
    if not problem.dynamics.stateless:  # the velocities of one input at a time
        velocities = problem.interval(0).sampling_bytes
        sampled += velocities + min(KEPT, count * velocities)
        solved += item * grid.ndim * (3 + problem.dynamics.adversaries) * grid.size
    return PROCESS + table + avoid(False) + avoid(True) + sampled + solved


class InputRows:
    """Avoid tubes as `add_input` reads them: the grid in rows of its last axes, of which each tube has all or none.

    What a tube says of a row is then one value, or a row of its own that other rows of the grid may share.
    """

    def __init__(self, grid: Grid, tubes: AvoidTubes) -> None:
        axes, self.last = [set(tubes.static_axes), set(tubes.moving_axes)], 1
        for last in range(2, max(1, grid.ndim // 2) + 1):
            trailing = set(range(grid.ndim - last, grid.ndim))
            if all(trailing <= own or not trailing & own for own in axes):
                self.last = last
        self.size, leading = int(np.prod(grid.shape[-self.last :])), grid.shape[: grid.ndim - self.last]
        self.at, self.wide, self.tubes = [], [], tubes
        for own in axes:
            shape = [n if axis in own else 1 for axis, n in enumerate(leading)]
            places = np.arange(np.prod(shape, dtype=np.int64)).reshape(shape)
            # a copy: `add_input` would be compiled once more for a view, which may not be written to
            self.at.append(np.broadcast_to(places, leading).flatten())
            self.wide.append(grid.ndim - 1 in own)

    def of(self, values: FloatArray) -> FloatArray:
        return values.reshape(-1, self.size)

    def nothing(self, dtype: Any) -> tuple[FloatArray, ...]:
        """wall, wall_at and level of `add_input` where there is nothing to avoid."""
        rows = len(self.at[0])
        return np.full((1, self.size), -np.inf, dtype), np.zeros(rows, np.int64), np.full(rows, -np.inf, dtype)

    def walls(self, step: int, j: int) -> tuple[FloatArray, ...]:
        """wall, wall_at and level of `add_input`."""
        wall, wall_at, level = self.nothing(self.tubes.static.dtype)
        for tube, at, wide in zip((self.tubes.static[j], self.tubes.moving[step, j]), self.at, self.wide, strict=True):
            if not wide:
                level = np.maximum(level, tube.reshape(-1)[at])
            elif len(wall) == 1:
                wall, wall_at = self.of(tube), at
            else:
                wall, wall_at = np.maximum(wall[wall_at], self.of(tube)[at]), np.arange(len(at))
        return wall, wall_at, level


class GridSets:
    """S_k as level-set functions on the grid: `Sets` for every method that plays its games there.

    Parameters
    ----------
    problem : ReachAvoidProblem
    method : str
        Name of the method, for the table.
    games : callable (problem) -> Games
        Creates the games; called after the check of memory.
    dtype : {"float32", "float64"}
    options : mapping
        The method's options, for the table's details.

    Raises
    ------
    MemoryError
        If `memory_needed` exceeds the available memory.
    """

    def __init__(
        self,
        problem: ReachAvoidProblem,
        method: str,
        games: Callable[[ReachAvoidProblem], Games],
        dtype: str = "float32",
        options: Mapping[str, Any] | None = None,
    ) -> None:
        require(memory_needed(problem, dtype), "this solve", 'use fewer nodes, fewer steps, or dtype "float32"')
        check_resolution(problem, stacklevel=5)
        self.timeless = problem.timeless
        self.problem, self.games, self.options = problem, games(problem.rimmed), dict(options or {})
        tubes = avoid_tubes(problem.rimmed, games, self.games)
        # whether the reach sets avoid everything already: joint games know of no unsafe ends
        self.joint = getattr(self.games, "joint", False) and not problem.grid.has("unsafe")
        self.rows = InputRows(problem.grid, tubes)
        self.table = LookupTable.empty(problem, method, dtype, tubes)
        self.shared, self.filled, self.changing = 0, 0, 1.0

    def goal(self, step: int) -> None:
        self.table.value_array(step, 0)[:] = shrunk(self.problem, self.problem.goal(step))

    def extend(self, step: int, within: int) -> None:
        """As `Sets.extend`: level-set functions united by the minimum, intersected by the maximum."""
        table, rows, endless = self.table, self.rows, self.problem.steps is None
        if endless:
            require(table.tubes[0].nbytes + table.masks[0].nbytes, f"step {within}", "give a number of steps")
        tube, mask = table.value_array(step, within), table.mask_array(step, within)
        before, stays = table.value_array(step, within - 1), self.problem.stays
        tube[:] = np.inf if stays else before
        played, values = self.problem.rimmed.grid, shrunk(self.problem, table.value_array(step + 1, within - 1))
        if played is not self.problem.grid:
            values = np.pad(values, played.rim, "edge")
        for j, phi in self.games.reach(values, step):
            reach = shrunk(self.problem, phi[played.inner])
            walls = rows.nothing(tube.dtype) if self.joint else rows.walls(step, j)
            add_input(rows.of(tube), rows.of(mask[j // 8]), rows.of(reach), *walls, np.uint8(1 << j % 8))
        if stays:  # what is clear for n steps is for n - 1: so are the nodes, whatever the scheme's error
            np.maximum(tube, before, out=tube)
        if endless:
            self.filled, self.changing = within, float(np.mean((tube <= 0) != (before <= 0)))

    def stopped(self, step: int, within: int) -> bool:
        if self.problem.steps is None:
            return self.table.unchanged(step, within)
        return np.array_equal(self.table.value_array(step, within), self.table.value_array(step, within - 1))

    def share(self, step: int, within: int) -> None:
        self.table.share(step, within)
        self.shared += 1

    def finish(self, details: Mapping[str, Any]) -> LookupTable:
        """The table, settled where N is not given; its details tell the options and how many PDEs were solved."""
        table, endless = self.table, self.problem.steps is None
        if endless:
            share, settled = table.fraction(within=self.filled), self.shared > 0
            table = table.settled(self.filled - QUIET if settled and not self.problem.stays else self.filled)
            if not settled:
                unsettled(self.problem, self.filled, self.changing, stacklevel=3)
        steps = table.steps
        avoid = sum(steps if self.problem.moves(part) else 1 for part in self.problem.unsafe)
        asked = len(self.problem.inputs) * (steps * (steps + 1) // 2 + avoid)
        found: dict[str, Any] = {
            "pdes_of_algorithm": asked,
            "pdes_solved": self.games.solved,
            "tubes_shared": self.shared,
        }
        if endless:
            found |= {"endless": True, "settled": settled, "given_up": share - table.fraction(start=0)}
        return table.finish(self.options | found | dict(details))
