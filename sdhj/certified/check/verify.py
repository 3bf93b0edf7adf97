"""An independent check of certified sets: reads a file and derives its claims anew.

Nothing of the solver is used, neither its code nor its bounds: only the numbers in the file. What is proved, and how:

1.  *The cells cover the axes*, in fractions; the period of an angle is an interval that holds 2 pi. (`cells_cover`)
2.  *Sets grow*: S_k^{n-1} is a part of S_k^n, so that `within` means what it says. (`survey`)
3.  *Reach*: under some input everything that a new cell of S_k^n can lead to lies in cells of S_{k+1}^{n-1}. The cells
    of an axis that the image of a cell may overlap are worked out in fractions, walls included (`overlapped`), and the
    whole product of the four lists has to be in the set. Along the agent's axes that product stays in one block of the
    file's pool, so each block is eroded once (`erode`); along the joints' axes eroded blocks are intersected
    (`reaching`).
4.  *Clearance*: under the same input the arm meets neither the pursuer nor a known obstacle at any time of the closed
    interval. A link and a disk, or a cell of the pursuer grown by what it can move, are further apart than r if along
    some unit vector n every point of the body is more than r ahead of every point of the link. How far a link extends
    along n is bounded for all joint angles of a box at once (`farthest`). For all of the pursuer's
    cells in a row some directions are tried in every part of the interval, and each proves a half plane of cells
    (`sweep`). The cells that this leaves are asked about one by one, each with a direction of its own; where one
    direction does not do, time, angles and cell are halved (`link_clear`).
5.  *Goals*: the cells of S_k^0 are inside the target at t_k (`tip_inside`), and clear of everything at that instant.
6.  *Rounding* is bounded once for all numbers that are let in (`sdhj.certified.check.kernels`), and a state counts as in a cell
    up to 1e-10 from it (`moved`).

A row is the cells of the agent for one pair of joint cells; it is checked with all its claims, for all starts, steps
and inputs. The answer is "proved" or "not proved". A cell whose certificate is right may, in principle, need more
halving than is granted.
"""

import json
import math
import os
import reprlib
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import h5py
import numba
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from sdhj.certified.check.kernels import DIRECTIONS, Sets, World, check_rows, erode, survey

Array = NDArray[Any]

PI = (Fraction(314159265358979323846, 10**20), Fraction(314159265358979323847, 10**20))
AGENTS = {"arm_case_study": "pursuer", "evader_case_study": "evader"}
KINEMATICS = ("relative", "printed")
PATHS = {
    "still": {"centre": 2},
    "line": {"start": 2, "velocity": 2},
    "circle": {"centre": 2, "radius": 1, "rate": 1, "phase": 1},
}
STILL: Mapping[str, Any] = {"path": {"kind": "still", "centre": [0.0, 0.0]}}
ABSURD = 1e6
MOST = 1000  # steps, and levels of an input
LARGEST = 10.0  # lengths, moves and places: the bound on rounding rests on it
LARGEST_ANGLE = 100.0  # of a disk on its circle
MOST_PARTS = 64  # that an interval is cut into at once
SHOWN = 5  # failures listed for each claim
CHUNK = 256  # rows between two signs of life


# --------------------------------------------------------------------------------------------------------------------
# The file
# --------------------------------------------------------------------------------------------------------------------


def decimal(value: float) -> Fraction:
    """The decimal that a number is written as."""
    return Fraction(str(value))


def expect(fits: bool, what: str, given: Any) -> None:
    if not fits:
        raise ValueError(f"{what}, got {reprlib.repr(given)}")


def is_whole(value: Any) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def checked_number(name: str, value: Any, least: float = 0.0) -> float:
    """A number of a recipe from `least` up to a size that no robot exceeds."""
    fits = isinstance(value, int | float) and not isinstance(value, bool) and least <= value <= ABSURD
    expect(fits, f"{name} must be a number from {least:g} to {ABSURD:g}", value)
    return float(value)


def known_disk(name: str, given: Any) -> None:
    """ValueError where a disk of a recipe is none."""
    path = given["path"]
    expect(path["kind"] in PATHS, f"the path of {name} must be one of {', '.join(PATHS)}", path["kind"])
    checked_number(f"radius of {name}", given["radius"])
    for part, numbers in PATHS[path["kind"]].items():
        values = path[part] if numbers == 2 else [path[part]]
        expect(isinstance(values, list) and len(values) == numbers, f"{part} of {name} must be two numbers", values)
        for value in values:
            checked_number(f"{part} of {name}", value, 0.0 if part == "radius" else -ABSURD)


@dataclass(frozen=True)
class Scene:
    """Numbers of a case study, from its recipe."""

    given: Mapping[str, Any]
    agent: str  # "pursuer" or "evader"

    @classmethod
    def of(cls, recipe: Mapping[str, Any]) -> "Scene":
        """The scene of a recipe, every number of which is checked: what follows believes them.

        Raises
        ------
        ValueError, KeyError, TypeError
            Where something in it is missing or makes no sense.
        """
        given, builder = recipe["arguments"], recipe["builder"]
        expect(builder in AGENTS, f"the builder must be one of {', '.join(AGENTS)}", builder)
        agent = AGENTS[builder]
        for name in ("half_width", "u_max", "v_d_max", "delta", f"v_{agent[0]}_max", f"{agent}_radius", f"{agent}_box"):
            checked_number(name, given[name])
        for name, least in (("steps", 1), ("input_levels", 2)):
            fits = is_whole(given[name]) and least <= given[name] <= MOST
            expect(fits, f"{name} must be a whole number from {least} to {MOST}", given[name])
        expect(len(given["lengths"]) == 2, "lengths must be two numbers", given["lengths"])
        for length in given["lengths"]:
            checked_number("lengths", length)
        expect(given["kinematics"] in KINEMATICS, f"kinematics must be {' or '.join(KINEMATICS)}", given["kinematics"])
        expect(isinstance(given["obstacles"], list), "obstacles must be a list", given["obstacles"])
        for number, obstacle in enumerate(given["obstacles"]):
            known_disk(f"obstacle {number}", obstacle)
        if agent == "pursuer":
            known_disk("the target", given["target"])
        return cls(given, agent)

    @property
    def agent_speed(self) -> float:
        return float(self.given[f"v_{self.agent[0]}_max"])

    @property
    def box(self) -> Fraction:
        """Half the side of the square that the agent stays in."""
        return decimal(self.given[f"{self.agent}_box"])

    def inputs(self) -> list[tuple[Fraction, Fraction]]:
        """All inputs, exactly, the first component slowest."""
        top, n = decimal(self.given["u_max"]), self.given["input_levels"]
        values = [-top + 2 * top * i / (n - 1) for i in range(n)]
        return [(a, b) for a in values for b in values]

    def world(self, edges: tuple[Array, Array, Array, Array]) -> World:
        """What the compiled kernels read.

        Raises
        ------
        ValueError
            Where a number is too large for the bound on rounding.
        """
        given = self.given
        l1, l2 = given["lengths"]
        relative = given["kinematics"] == "relative"
        width, radius = given["half_width"], given[f"{self.agent}_radius"]
        target = given["target"] if self.agent == "pursuer" else {**STILL, "radius": radius}
        inputs = np.array([[float(u) for u in pair] for pair in self.inputs()])
        arm = np.array([l1, l2 if relative else l1 + l2, relative], dtype=np.float64)
        travel = (np.abs(inputs) + given["v_d_max"]) @ [arm[0] + arm[1], arm[1]] * given["delta"]
        angles = 2 * np.pi * (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS
        world = World(
            arm=arm,
            inputs=inputs,
            push=float(given["v_d_max"]),
            chased=self.agent == "pursuer",
            agent=np.array([self.agent_speed, radius + width]),
            delta=float(given["delta"]),
            disks=np.array([disk(d, d["radius"] + width) for d in given["obstacles"]]).reshape(-1, 8),
            goal=np.array(disk(target, target["radius"])),
            q1=edges[0],
            q2=edges[1],
            x=edges[2],
            y=edges[3],
            compass=np.stack([np.cos(angles), np.sin(angles)], axis=1),
            parts=np.clip(travel / (edges[2][1] - edges[2][0]), 1, MOST_PARTS).astype(np.int64),
        )
        refuse_large(world, given["steps"])
        return world


def disk(given: Mapping[str, Any], distance: float) -> list[float]:
    """A disk as x, y, vx, vy, radius, rate and phase of its path, and a distance from its centre."""
    path = given["path"]
    if path["kind"] == "circle":
        return [*path["centre"], 0.0, 0.0, path["radius"], path["rate"], path["phase"], distance]
    if path["kind"] == "line":
        return [*path["start"], *path["velocity"], 0.0, 0.0, 0.0, distance]
    return [*path["centre"], 0.0, 0.0, 0.0, 0.0, 0.0, distance]


def refuse_large(world: World, steps: int) -> None:
    """ValueError where a number breaks what the bound on rounding supposes: see `sdhj.certified.check.kernels`."""
    end = world.delta * steps
    disks = np.vstack([world.disks, world.goal[None]])
    moves = [(float(np.abs(world.inputs).max()) + world.push) * world.delta, world.agent[0] * world.delta]
    lengths = [
        *world.arm,
        world.agent[1],
        *moves,
        *(float(np.abs(edge).max()) for edge in (world.q1, world.q2, world.x, world.y)),
    ]
    places = np.abs(disks) @ np.array([[1, 1, end, end, 1, 0, 0, 0], [0, 0, 0, 0, 0, 0, 0, 1]]).T
    angles = np.abs(disks[:, 5]) * end + np.abs(disks[:, 6])
    sizes = np.array([*lengths, *places.ravel(), *(angles * LARGEST / LARGEST_ANGLE)])
    least = min(world.delta, world.push, world.agent[0], world.arm[0] - 1e-3, world.arm[1] - 1e-3)
    if not (sizes <= LARGEST).all() or not least >= 0.0:
        raise ValueError(
            f"the check's bound on rounding holds for links of at least 1 mm and lengths, places and moves in one "
            f"interval from 0 to {LARGEST:g} (metres, radians); this file has links of {world.arm[0]:g} and "
            f"{world.arm[1]:g} m and numbers up to {sizes.max():g}"
        )


class File:
    """Cells and bits of a file.

    Raises
    ------
    ValueError
        Where its parts do not fit together.
    """

    def __init__(self, group: h5py.Group) -> None:
        self.scene = Scene.of(json.loads(group.parent.attrs["recipe"]))
        self.steps = self.scene.given["steps"]
        self.shape = tuple(int(n) for n in group.attrs["shape"])
        expect(len(self.shape) == 4 and min(self.shape) >= 2, "shape must be four numbers of cells", self.shape)
        self.widths = [Fraction(w) for w in group.attrs["widths"]]
        self.lowers = [Fraction(w) for w in group.attrs["lowers"]]
        self.extents = [(Fraction(a), Fraction(b)) for a, b in group.attrs["extents"]]
        for name, kind in (("index", np.uint32), ("pool", np.uint64), ("allowed", np.uint8)):
            expect(group[name].dtype == kind, f"{name} must be of {np.dtype(kind)}", group[name].dtype)
        self.index, self.pool, packed = group["index"][()], group["pool"][()], group["allowed"][()]
        n1, n2, nx, ny = self.shape
        flags = (self.steps, len(self.scene.inputs()), n1, n2)
        bits = nx * ny
        entries = (self.steps + 1) * (self.steps + 2) // 2
        fits = (
            {len(part) for part in (self.widths, self.lowers, self.extents)} == {4}
            and len(self.pool) > 0
            and packed.ndim == 1
            and self.index.shape == (entries, n1 * n2)
            and self.pool.shape[1:] == (-(-bits // 64),)
            and packed.size == -(-math.prod(flags) // 8)
            and self.index.max() < len(self.pool)
            and (bits % 64 == 0 or not (self.pool[:, -1] >> np.uint64(bits % 64)).any())
        )
        if not fits:
            raise ValueError("the arrays of the certified sets do not fit their numbers; the file is damaged")
        self.allowed = np.unpackbits(packed, count=math.prod(flags), bitorder="little").view(np.bool_).reshape(flags)

    def edges(self) -> tuple[Array, Array, Array, Array]:
        """Edges of the cells of each axis, (n + 1,), rounded to the nearest number."""
        first, second, third, fourth = (
            np.array([float(lower + i * width) for i in range(n)] + [float(lower + extent[1])])
            for n, width, lower, extent in zip(self.shape, self.widths, self.lowers, self.extents, strict=True)
        )
        return first, second, third, fourth

    def ends(self, axis: int, drifts: Sequence[Fraction]) -> Array:
        """Cells that each cell of an axis may end in for each drift, (drifts, n, most), the last one repeated."""
        push = decimal(self.scene.given["v_d_max"] if axis < 2 else self.scene.agent_speed)
        lists = {drift: overlapped(axis, self, drift - push, drift + push) for drift in set(drifts)}
        most = max(len(found) for of_drift in lists.values() for found in of_drift)
        return np.array([[found + found[-1:] * (most - len(found)) for found in lists[drift]] for drift in drifts])


def overlapped(axis: int, file: File, slow: Fraction, fast: Fraction) -> list[list[int]]:
    """For each cell of an axis the cells that its image may overlap after one interval, slow <= 0 <= fast at walls.

    What a wall stops ends in the outermost cell, which the image overlaps anyway: it came from there or passed it.
    """
    n, width, extent = file.shape[axis], file.widths[axis], file.extents[axis]
    delta = decimal(file.scene.given["delta"])
    out = []
    for cell in range(n):
        found: set[int] = set()
        for period in extent:
            low = cell * width + slow * delta
            high = (period if cell == n - 1 else (cell + 1) * width) + fast * delta
            for lap in (-2, -1, 0, 1, 2) if axis < 2 else (0,):
                found |= overlap(low, high, lap * period, n, width, period)
        out.append(sorted(found))
    return out


def overlap(low: Fraction, high: Fraction, offset: Fraction, n: int, width: Fraction, period: Fraction) -> set[int]:
    """Cells i = 0..n-1, from `offset` on, that overlap [low, high]; the last one ends at offset + period."""
    if high <= offset or low >= offset + period:
        return set()
    first = max((low - offset) // width, 0)
    last = min(-((offset - high) // width) - 1, n - 1)
    return set(range(min(int(first), n - 1), int(last) + 1))


# --------------------------------------------------------------------------------------------------------------------
# The check
# --------------------------------------------------------------------------------------------------------------------


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
class Report:
    """What `verify` looked at and found."""

    claims: tuple[Claim, ...]

    @property
    def ok(self) -> bool:
        return all(claim.failed == 0 for claim in self.claims)

    def __str__(self) -> str:
        return "\n".join(str(claim) for claim in self.claims)


def verify(
    path: str | os.PathLike[str],
    *,
    samples: int | None = None,
    seed: int = 0,
    group: str = "certified",
    progress: bool | None = None,
) -> Report:
    """Check the certified sets in an HDF5 file.

    Parameters
    ----------
    path : path
    samples : int or None
        How many rows are drawn at random, each checked with all its claims; None checks every row.
    seed : int
    group : str
        The group of the file that holds the sets.
    progress : bool, optional
        Show a progress bar; by default where standard error is a terminal.

    Raises
    ------
    ValueError
        Where the file holds no certified sets of a case study, is damaged, or has numbers that are too large for the
        check; and for samples or a seed that make no sense.
    """
    expect(samples is None or (is_whole(samples) and samples > 0), "samples must be a positive number", samples)
    expect(is_whole(seed) and seed >= 0, "seed must be a whole number of at least 0", seed)
    with h5py.File(path, "r") as opened:
        if group not in opened:
            raise ValueError(f"{path} holds no certified sets; make them with method='certified'")
        if opened[group].attrs.get("kind") != "arm":
            raise ValueError(
                f"{path} holds certified sets of a problem of your own, whose functions are not in the file; only "
                "the arm's case study can be checked from a file alone"
            )
        try:
            file = File(opened[group])
        except (ValueError, KeyError, TypeError, IndexError, AttributeError, ArithmeticError) as error:
            raise ValueError(f"{path}: its certified sets make no sense ({error}); the file is damaged") from error
    cover = cells_cover(file)
    if cover.failed:  # nothing else in the file means what it says
        return Report((cover,))
    rows = np.random.default_rng(seed).permutation(file.index.shape[1])[:samples]
    return Report((cover, *check(file, rows, progress)))


def cells_cover(file: File) -> Claim:
    """The cells of each axis cover it, and the bounds on the period of an angle hold 2 pi."""
    failures = []
    box = file.scene.box
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
    eroded = np.empty_like(file.pool)
    still = [Fraction(0)]
    erode(file.pool, file.ends(2, still)[0], file.ends(3, still)[0], eroded)
    ends = [file.ends(axis, [pair[axis] for pair in file.scene.inputs()]) for axis in (0, 1)]
    sets = Sets(file.steps, file.index, file.pool, eroded, file.allowed, *ends)
    failed = np.zeros((len(rows), file.steps + 2), np.int64)
    example = np.zeros_like(failed)
    chunks = [slice(begin, begin + CHUNK) for begin in range(0, len(rows), CHUNK)]

    def check_chunk(at: slice) -> int:
        check_rows(rows[at], file.shape, world, sets, failed[at], example[at])
        return len(rows[at])

    hidden = sys.stderr is None or not (sys.stderr.isatty() if progress is None else progress)
    shown = tqdm(total=len(rows), desc="verify", unit="row", disable=hidden)
    with shown as bar, ThreadPoolExecutor(numba.get_num_threads()) as threads:
        for done in threads.map(check_chunk, chunks):
            bar.update(done)
    return [grow, *claims(file, rows, counts, failed, example)]


def counted(file: File) -> tuple[Array, Claim]:
    """Cells that the sets add to each row, (rows, steps + 1, 2): all, those at the boundary. And whether sets grow."""
    beside_x, beside_y = (np.clip(np.arange(n)[:, None] + [-1, 0, 1], 0, n - 1) for n in file.shape[2:])
    inner = np.empty_like(file.pool)
    erode(file.pool, beside_x, beside_y, inner)
    entries, rows = file.index.shape
    counts, shrinks = np.zeros((rows, file.steps + 1, 2), np.int64), np.zeros((rows, entries), np.bool_)
    survey(file.steps, file.shape, file.index, file.pool, inner, counts, shrinks)
    pairs = [(start, within) for start in range(file.steps + 1) for within in range(file.steps - start + 1)]
    failures = tuple(
        f"start {start}: the set within {within - 1} is not inside the one within {within}"
        for (start, within), bad in zip(pairs, np.any(shrinks, axis=0, keepdims=True)[0], strict=True)
        if bad
    )
    made = entries - file.steps - 1
    return counts, Claim("sets grow with the steps to go", made, made, failures[:SHOWN], len(failures))


def claims(file: File, rows: Array, counts: Array, failed: Array, example: Array) -> list[Claim]:
    """What came out of the rows; failed, example (R, kinds) as `check_rows` left them."""
    _, n2, nx, ny = file.shape
    bits, inputs = nx * ny, len(file.scene.inputs())
    checked = int(file.allowed.reshape(-1, file.index.shape[1])[:, rows].sum())
    bad = np.flatnonzero(failed[:, 0])[:SHOWN]
    names = [
        f"start {what // inputs}, input {what % inputs}, joints {row // n2}, {row % n2}"
        for row, what in zip(rows[bad], example[bad, 0], strict=True)
    ]
    out = [Claim("clear of the obstacles", int(file.allowed.sum()), checked, tuple(names), int(failed[:, 0].sum()))]
    for within in range(file.steps + 1):
        bad = np.flatnonzero(failed[:, 1 + within])[:SHOWN]
        names = [
            f"start {what // bits}, within {within}, cell {row // n2, row % n2, what % bits // ny, what % bits % ny}"
            for row, what in zip(rows[bad].tolist(), example[bad, 1 + within].tolist(), strict=True)
        ]
        made, outer = counts[:, within].sum(axis=0).tolist()
        seen, seen_outer = counts[rows, within].sum(axis=0).tolist()
        name = f"one step nearer, within {within}" if within else "in the target, and safe"
        out.append(Claim(name, made, seen, tuple(names), int(failed[:, 1 + within].sum()), (outer, seen_outer)))
    return out
