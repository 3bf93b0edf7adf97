"""Which problem it is: a digest to the last bit, and sums that tell another problem from another machine's rounding.

Mathematical libraries and processors differ in the last bits of sines and roots, so a problem that is built again
elsewhere may have another digest. Its numbers are then compared by sums with random signs: of each part of n numbers
v every one counts as v / (c + |v|), in which an error of one unit in the last place of v or c is at most one of 1, c
being their mean size or that of the grid's ends, whichever is less. Rounding alone cannot move a sum by more than
`ULPS` n such units; a number that is another one by more moves every sum, and several changes would have to hide each
other under all of the signs.
"""

import hashlib
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from sdhj.grid import FloatArray

if TYPE_CHECKING:
    from sdhj.problem import ReachAvoidProblem

ULPS = 16  # units in the last place by which numbers of one problem may differ from machine to machine
SIGNS = 32
ROW = 2**12  # numbers of a row: its signs are those of all rows, each of the SIGNS drawings turned or not


def identity(problem: "ReachAvoidProblem") -> tuple[str, FloatArray]:
    """What tells a problem: two problems with one digest have one table, `alike` sums differ by rounding.

    Returns
    -------
    digest : str
        SHA-256 of everything the solver reads, hexadecimal.
    sums : (parts, 2 + SIGNS)
        Of each part how many numbers it has, so many times the logarithm of c, and the numbers' sums with random signs,
        drawn `SIGNS` times.
    """
    grid, sums = problem.grid, []
    h = hashlib.sha256(f"{problem.view_time} {grid.ends}".encode())
    reach = float(np.abs([grid.lower, grid.upper]).max())
    for part in _parts(problem):
        data = np.ascontiguousarray(part)
        h.update(repr((data.dtype.str, data.shape)).encode())
        h.update(data.data)
        sums.append(_signed(data.ravel().astype(np.float64), reach))
    return h.hexdigest(), np.array(sums)


def alike(sums: FloatArray, others: FloatArray) -> bool:
    """Whether what `identity` adds up differs by no more than rounding, `ULPS` for each number."""
    if sums.shape != others.shape:
        return False
    return bool((np.abs(sums - others) <= ULPS * np.finfo(np.float64).eps * sums[:, :1]).all())


def _signed(values: FloatArray, reach: float) -> list[float]:
    sizes = np.abs(values)
    scale = min(float(sizes.mean()), reach) if sizes.any() else 1.0
    rows = np.zeros((-(-values.size // ROW), ROW))
    np.divide(values, scale + sizes, out=rows.reshape(-1)[: values.size])
    random = np.random.PCG64(0)
    # the signs of a number are those of its column, turned where those of its row are -1
    total = np.sum(rows @ _signs(random, ROW) * _signs(random, len(rows)), axis=0)
    return [float(values.size), float(values.size * np.log(scale)), *total.tolist()]  # the sums do not tell the scale


def _signs(random: np.random.PCG64, count: int) -> FloatArray:
    bits = random.random_raw(count * SIGNS // 64 + 1).astype("<u8").view(np.uint8)
    return 1.0 - 2.0 * np.unpackbits(bits, count=count * SIGNS).reshape(count, SIGNS)


def _parts(problem: "ReachAvoidProblem") -> Iterator[Any]:
    """All numbers that the solver reads, part by part."""
    grid, dynamics, inputs = problem.grid, problem.dynamics, range(len(problem.inputs))
    yield from (grid.lower, grid.upper, grid.shape, grid.periodic, problem.inputs, problem.delta, problem.steps or 0)
    if dynamics.constant:
        yield from (dynamics.bounds, dynamics.drift, dynamics.gain)
    else:
        points, halves = grid.points(), range(2 * problem.steps + 1) if dynamics.timed else range(1)
        for t in (half * problem.delta / 2 + problem.sensing.delay for half in halves):
            yield from (dynamics.drift_at(points, j, t) for j in inputs)
            for j in inputs[:1] if dynamics.alike else inputs:
                yield from (dynamics.gain_at(points, j, t), dynamics.bounds_at(j, t))
    yield problem.target.axes
    yield from (problem.target_at(problem.time(k)) for k in range(1 if problem.timeless else problem.steps + 1))
    for part in problem.unsafe:
        yield from (part.axes, part.rate, problem.unsafe_when(part, 0))
        for step in range(problem.steps) if part.moving else ():
            t0, t1 = problem.span(step)
            # what happens between the samples counts too
            yield from (problem.unsafe_at(part, (t0 + t1) / 2), problem.unsafe_when(part, step + 1))
            yield problem.unsafe_over(part, t0, t1)
    if sensing := problem.sensing:
        yield from (np.broadcast_to(sensing.error, grid.ndim), sensing.delay, sensing.jitter, sensing.rest)
