"""How near each part of a solve is to what the machine can do: bytes moved and operations against its limits.

The limits are measured beside the solve, on one thread: a triad a = b + s c on arrays that no cache holds, and a loop
of fused multiplications and additions, which count as two. The parts are the compiled kernels that a solve calls, and
NumPy where it goes through whole grids. The bytes of each number that a part is given or writes count once, and the
operations are those of the formulas, a maximum, a comparison or an absolute value being one; so a part comes near its
limit only if it reads nothing twice and computes nothing else. What Python does has no limit.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any, NamedTuple
from unittest.mock import patch

import numba
import numpy as np
from numba import njit

import sdhj
from sdhj.formulas.formula import Formula
from sdhj.formulas.graph import ordered
from sdhj.kernels import FloatArray
from sdhj.kernels.boxes import Leaves
from sdhj.problem import boxes
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.solver import projections, recursion, schemes

CLOCK = time.process_time
FLOWS = 64  # sums that do not wait for each other
# by order of the differences: both of an axis; by name: a numerical Hamiltonian of an axis
DIFFERENCES, HAMILTONIANS = {1: 2, 2: 17, 3: 47}, {"godunov": 8, "lax-friedrichs": 12}
JOINED = 4  # an input at a node: raised to a level, compared with the tube and with zero, marked
REST = "the rest, in Python"


class Part(NamedTuple):
    """Processor time in s, bytes and operations of one part of a solve."""

    seconds: float
    bytes: float
    operations: float

    def times(self, both: tuple[float, float]) -> float:
        """How many times as long as the slower of `both` limits allows; NaN where nothing was counted."""
        least = max(self.bytes / both[0], self.operations / both[1])
        return self.seconds / least if least else np.nan


@njit(fastmath={"contract"})
def _triad(a: FloatArray, b: FloatArray, c: FloatArray) -> None:
    for i in range(a.size):
        a[i] = b[i] + np.float32(0.5) * c[i]


@njit(fastmath={"contract", "reassoc"})
def _fused(sums: FloatArray, rounds: int) -> None:
    for _ in range(rounds):
        for i in range(FLOWS):
            sums[i] = sums[i] * np.float32(0.5) + np.float32(1.0)


def limits(repeats: int = 5) -> tuple[float, float]:
    """Bytes and operations in float32 that one thread of this machine can do in a second, the best of some rounds."""
    a, b, c, sums, rounds = *np.ones((3, 2**24), np.float32), np.ones(FLOWS, np.float32), 2**18
    found = []
    for _ in range(repeats + 1):  # the first one compiles
        begin = CLOCK()
        _triad(a, b, c)
        middle = CLOCK()
        _fused(sums, rounds)
        found.append((3 * a.nbytes / (middle - begin), 2 * FLOWS * rounds / (CLOCK() - middle)))
    return tuple(np.max(found[1:], axis=0).tolist())


def _between(leaves: Any) -> float:
    """Operations at a node for a maximum over intervals, on average: at their ends and at the nodes between them."""
    bent, ends = np.mean(leaves.weight[..., 1] != 0), 2 - leaves.point[leaves.which].mean()
    inner = np.where(leaves.point[:, None], 0, np.diff(leaves.between, axis=-1)[..., 0])
    return float(ends * (3 + 9 * bent) + ends - 1 + inner[leaves.which].mean())


def _of_stage(out: Any, phi: Any, after: Any, wall: Any, velocities: Any, order: Any, flux: Any, *_: Any) -> Any:
    axis = list(DIFFERENCES.values())[len(order)] + list(HAMILTONIANS.values())[len(flux)] + 1
    coupled = len(velocities) * len(velocities[2]) * 2 if len(velocities) == 4 else 0
    moved = phi.nbytes + 2 * after.nbytes + wall.nbytes + sum(one.nbytes for one in velocities)
    return moved, phi.size * (axis * phi.ndim + 5 + coupled)


def _of_union(out: Any, tube: Any, marks: Any, reach: Any, count: int, first: int, walls: Any, *_: Any) -> Any:
    wide = [wall for wall in (walls.static, walls.moving) if wall.shape[2] > 1]
    made = _between(Leaves(*reach[1:])) if len(reach) == 7 else len(reach[1])
    moved = 2 * tube.nbytes + marks.nbytes * count // len(marks) // 4 + reach[0].nbytes
    moved += sum(wall[:count].nbytes for wall in (walls.static, walls.moving))
    return moved, tube.size * count * (made + JOINED + len(wide))


def _of_maxima(out: Any, values: Any, leaves: Any, raised: bool, into: Any) -> Any:
    return values.nbytes + (1 + raised) * into.nbytes, into.size * (_between(leaves) + raised)


def _of_formula(out: Any, formula: Any, points: Any, *_: Any, **__: Any) -> Any:
    rows = len(points) if isinstance(points, np.ndarray) else 0
    return 8 * rows * (formula.coordinates + len(formula.outputs)), rows * len(ordered(formula.outputs))


MEASURED: tuple[tuple[Any, str, str, Callable[..., Any]], ...] = (
    (Formula, "__call__", "sampling", _of_formula),
    (ReachAvoidProblem, "unsafe_over", "sampling", lambda out, *_, **__: (8 * out.size, 0)),
    (ReachAvoidProblem, "goal", "sampling", lambda out, *_: (8 * out.size, 0)),
    (recursion.GridParts, "write_avoid", "avoid tubes", lambda out, parts, name, step, into: (3 * into.nbytes, 0)),
    (schemes, "stage", "stages", _of_stage),
    (schemes, "_with_ghosts", "stages", lambda out, grid, layout, values, _: (values.nbytes + out.nbytes, 0)),
    (schemes, "_without_ghosts", "stages", lambda out, layout, padded, values: (values.nbytes + padded.nbytes, 0)),
    (boxes, "maximum_of_intervals", "Hopf-Lax", _of_maxima),
    (recursion, "add_inputs", "shift and union", _of_union),
    (projections, "maximum_along", "projections", lambda out, v, most: (v.nbytes + most.nbytes, v.size)),
)


@contextmanager
def measured(found: dict[str, Part]) -> Iterator[None]:
    """Within it what every part takes is added to `found`; a kernel that computes avoid tubes counts as theirs."""
    inside, nested = list[str](), [0.0]

    def wrapped(call: Callable[..., Any], part: str, count: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*given: Any, **named: Any) -> Any:
            mine = "avoid tubes" if "avoid tubes" in inside and part != "sampling" else part
            inside.append(part)
            outer, nested[0], begin = nested[0], 0.0, CLOCK()
            out = call(*given, **named)
            spent = CLOCK() - begin - nested[0]
            inside.pop()
            added = (spent, *count(out, *given, **named))
            found[mine] = Part(*np.add(found.get(mine, (0.0, 0.0, 0.0)), added).tolist())
            nested[0] = outer + CLOCK() - begin
            return out

        return timed

    with ExitStack() as changed:
        for owner, name, part, count in MEASURED:
            changed.enter_context(patch.object(owner, name, wrapped(getattr(owner, name), part, count)))
        yield


def parts(problem: ReachAvoidProblem, method: str) -> dict[str, Part]:
    """What the parts of a solve take on one thread, kernels compiled before; the last one has no limit."""
    threads, found = numba.get_num_threads(), dict[str, Part]()
    numba.set_num_threads(1)
    try:
        sdhj.solve(problem, method, progress=False, play=False)
        begin = CLOCK()
        with measured(found):
            sdhj.solve(problem, method, progress=False, play=False)
        rest = CLOCK() - begin - sum(part.seconds for part in found.values())
    finally:
        numba.set_num_threads(threads)
    return found | {REST: Part(rest, 0.0, 0.0)}


def table(problem: ReachAvoidProblem, methods: tuple[str, ...]) -> str:
    """The parts of a solve by each method and the limits of the machine, as lines of text."""
    most = limits()
    lines = [f"one thread can move {most[0] / 1e9:.1f} GB/s and do {most[1] / 1e9:.1f} Gop/s (float32)", ""]
    lines.append(f"{'method':<12}{'part':<22}{'ms':>9}{'GB/s':>8}{'Gop/s':>8}{'x limit':>9}")
    for method in methods:
        for name, part in parts(problem, method).items():
            seconds = max(part.seconds, 1e-9)
            rates = f"{part.bytes / seconds / 1e9:>8.2f}{part.operations / seconds / 1e9:>8.2f}"
            rates = f"{rates}{part.times(most):>9.1f}" if name != REST else ""
            lines.append(f"{method:<12}{name:<22}{1e3 * part.seconds:>9.1f}{rates}")
    return "\n".join(lines)
