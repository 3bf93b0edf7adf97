"""The claims of a file, and which of them are proved."""

import os
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numba
import numpy as np
from tqdm import tqdm

from sdhj.certified.check.bits import Array, erode
from sdhj.certified.check.examining import examine
from sdhj.certified.check.reading import File, expect, is_whole, told_and_arrays
from sdhj.certified.check.robots import Robot
from sdhj.certified.check.rows import Stored, check_rows

PI = (Fraction(314159265358979323846, 10**20), Fraction(314159265358979323847, 10**20))
SHOWN = 5  # failures listed for each claim
ROWS_AT_ONCE = 256  # between two signs of life


@dataclass(frozen=True)
class Claim:
    """One kind of claim: how many were made, how many checked, and what was not proved.

    boundary : of the cells that were made and checked, those with a neighbour outside their set; None where it means
    nothing.
    """

    name: str
    made: int
    checked: int
    failures: tuple[str, ...]
    failed: int
    boundary: tuple[int, int] | None = None

    def __str__(self) -> str:
        verdict = "proved" if self.failed == 0 else f"{self.failed:,} NOT proved"
        edge = "" if self.boundary is None else " ({1:,} of {0:,} at the boundary)".format(*self.boundary)
        line = f"{self.name}: {self.checked:,} of {self.made:,} checked{edge}, {verdict}"
        return "\n".join([line, *(f"    {failure}" for failure in self.failures)])


@dataclass(frozen=True)
class Verdict:
    """What `verify` looked at and found."""

    claims: tuple[Claim, ...]

    @property
    def ok(self) -> bool:
        return all(claim.failed == 0 for claim in self.claims)

    def __str__(self) -> str:
        return "\n".join(str(claim) for claim in self.claims)


def verify(
    path: str | os.PathLike[str],
    problem: Any = None,
    *,
    samples: int | None = None,
    seed: int = 0,
    progress: bool | None = None,
) -> Verdict:
    """Check the certified sets in an HDF5 file.

    Parameters
    ----------
    path : path
    problem : ReachAvoidProblem, optional
        Of a robot of one's own with black boxes, whose functions are not in the file: `problem.black_box(name)`. All
        else is in the file.
    samples : int or None
        How many rows are drawn at random, each checked with all its claims; None checks every row. Of a robot of one's
        own: how many cells.
    seed : int
    progress : bool, optional
        Show a progress bar; by default where standard error is a terminal.

    Raises
    ------
    ValueError
        Where the file holds no certified sets of a case study, is damaged, or has numbers that are too large for the
        check; and for samples or a seed that make no sense.
    """
    expect(samples is None or is_whole(samples, 1), "samples must be a positive number", samples)
    expect(is_whole(seed, 0), "seed must be a whole number of at least 0", seed)
    kind, opaque = "arm", {}
    with told_and_arrays(path) as (told, arrays):
        if "cells" in told and (kind := told["cells"].get("kind")) == "arm":
            file = File(told, arrays)
        elif "cells" in told and not ((opaque := dict(told["formulas"]["opaque"])) and problem is None):
            robot = Robot(told, arrays, problem)
    if "cells" not in told:
        raise ValueError(f"{path} holds no certified sets; make them with method='certified'")
    if opaque and problem is None:
        names = ", ".join(f"{name} ({why})" for name, why in opaque.items())
        raise ValueError(
            f"{path} rests on black boxes, whose functions are not in the file: {names}; give the problem, for example "
            "as `sdhj verify --problem module:function`"
        )
    if kind != "arm":
        found = examine(robot, samples, seed, _silent(progress))
        return Verdict(tuple(Claim(name, n, m, tuple(bad[:SHOWN]), len(bad)) for name, n, m, bad in found))
    cover = cells_cover(file)
    if cover.failed:  # nothing else in the file means what it says
        return Verdict((cover,))
    rows = np.random.default_rng(seed).permutation(file.index.shape[1])[:samples]
    return Verdict((cover, *check(file, rows, progress)))


def _silent(progress: bool | None) -> bool:
    return sys.stderr is None or not (sys.stderr.isatty() if progress is None else progress)


def cells_cover(file: Any) -> Claim:
    """The cells of each axis cover it, and the bounds on the period of an angle hold 2 pi."""
    failures, box = [], file.scene.box
    for axis in range(4):
        n, width, extent = file.shape[axis], file.widths[axis], file.extents[axis]
        whole = width > 0 and (n - 1) * width < extent[0] and n * width >= extent[1]
        if axis < 2:
            right = extent[0] <= 2 * PI[0] and extent[1] >= 2 * PI[1] and extent[1] - extent[0] < Fraction(1, 10**13)
        else:
            right = extent == (2 * box, 2 * box) and file.lowers[axis] == -box
        if not (whole and right):
            failures.append(f"axis {axis}: {n} cells of width {float(width):.6g} do not cover it")
    return Claim("cells cover the axes", 4, 4, tuple(failures), len(failures))


def check(file: File, rows: Array, progress: bool | None) -> list[Claim]:
    """All claims but that the cells cover the axes; those of single cells in some rows only."""
    world = file.scene.world(file.edges())
    counts, grow = counted(file)
    eroded, still = np.empty_like(file.pool), [Fraction(0)]
    erode_all(file.pool, file.ends(2, still)[0], file.ends(3, still)[0], eroded)
    ends = [file.ends(axis, [pair[axis] for pair in file.scene.inputs()]) for axis in (0, 1)]
    stored = Stored(file.pairs, file.index, file.pool, eroded, file.allowed, *ends)
    failed, example = np.zeros((2, len(rows), file.steps + 2), np.int64)

    def check_part(begin: int) -> int:
        at = slice(begin, begin + ROWS_AT_ONCE)
        check_rows(rows[at], world, stored, failed[at], example[at])
        return len(rows[at])

    shown = tqdm(total=len(rows), desc="verify", unit="row", disable=_silent(progress))
    with shown as bar, ThreadPoolExecutor(numba.get_num_threads()) as threads:
        for done in threads.map(check_part, range(0, len(rows), ROWS_AT_ONCE)):
            bar.update(done)
    return [grow, *claims(file, rows, counts, failed, example)]


def erode_all(pool: Array, along_x: Array, along_y: Array, out: Array) -> None:
    """`erode`, by threads."""
    with ThreadPoolExecutor(numba.get_num_threads()) as threads:
        parts = [slice(begin, begin + ROWS_AT_ONCE) for begin in range(0, len(pool), ROWS_AT_ONCE)]
        list(threads.map(lambda part: erode(pool[part], along_x, along_y, out[part]), parts))


def counted(file: Any) -> tuple[Array, Claim]:
    """Cells that the sets add to each row, (rows, steps + 1, 2): all, those at the boundary. And whether sets grow."""
    index, pool, inner = file.index, file.pool, np.empty_like(file.pool)
    along_x, along_y = (np.clip(np.arange(n)[:, None] + [-1, 0, 1], 0, n - 1) for n in file.shape[2:])
    erode_all(pool, along_x, along_y, inner)
    grid = np.arange(index.shape[1]).reshape(file.shape[:2])
    beside = [np.roll(grid, side, axis).ravel() for axis in (0, 1) for side in (-1, 1)]
    counts, failures = np.zeros((index.shape[1], file.steps + 1, 2), np.int64), []
    for place, (start, within) in enumerate(file.pairs):
        here = index[place]
        less = index[place - 1] if within else np.zeros_like(here)
        rows = np.flatnonzero(here != less) if within else np.arange(here.size)
        new, old = pool[here[rows]], pool[less[rows]]
        if within and (old & ~new).any():
            failures.append(f"start {start}: the set within {within - 1} is not inside the one within {within}")
        new &= ~old if within else ~np.uint64(0)
        deep = inner[here[rows]]
        for other in beside:
            deep &= pool[here[other[rows]]]
        for kind, bits in enumerate((new, new & ~deep)):
            counts[rows, within, kind] += np.bitwise_count(bits).sum(axis=1, dtype=np.int64)
    made = int((file.pairs[:, 1] > 0).sum())
    return counts, Claim("sets grow with the steps to go", made, made, tuple(failures[:SHOWN]), len(failures))


def claims(file: File, rows: Array, counts: Array, failed: Array, example: Array) -> list[Claim]:
    """What came out of the rows; failed, example (R, kinds) as `check_rows` left them."""
    _, n2, nx, ny = file.shape
    bits, inputs = nx * ny, len(file.scene.inputs())

    def named(kind: int) -> list[tuple[int, int]]:
        bad = np.flatnonzero(failed[:, kind])[:SHOWN]
        return list(zip(rows[bad].tolist(), example[bad, kind].tolist(), strict=True))

    flags = file.allowed.reshape(-1, file.index.shape[1])
    names = [f"start {what // inputs}, input {what % inputs}, joints {row // n2}, {row % n2}" for row, what in named(0)]
    made, seen, wrong = flags.sum(), flags[:, rows].sum(), failed.sum(axis=0)
    out = [Claim("clear of the obstacles", int(made), int(seen), tuple(names), int(wrong[0]))]
    for within in range(file.steps + 1):
        names = [
            f"start {what // bits}, within {within}, cell {row // n2, row % n2, what % bits // ny, what % bits % ny}"
            for row, what in named(1 + within)
        ]
        made, outer = counts[:, within].sum(axis=0).tolist()
        seen, seen_outer = counts[rows, within].sum(axis=0).tolist()
        name = f"one step nearer, within {within}" if within else "in the target, and safe"
        out.append(Claim(name, made, seen, tuple(names), int(wrong[1 + within]), (outer, seen_outer)))
    return out
