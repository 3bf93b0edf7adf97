"""The claims of the file of an arm: its numbers from the recipe of the case study, its rows by compiled code (`rows`).

The agent is the pursuer or the evader, whose position is in the state. A row is the cells of the agent for one pair of
joint cells; it is checked with all its claims, for all starts, steps and inputs.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from functools import cached_property
from typing import Any

import numba
import numpy as np
from tqdm import tqdm

from sdhj.certified.check.arm.bits import Array, erode
from sdhj.certified.check.arm.recipe import expect_recipe
from sdhj.certified.check.arm.rows import Stored, check_rows
from sdhj.certified.check.arm.separation import DIRECTIONS, World
from sdhj.certified.check.claims import COVER, GOALS, GROW, NEARER, SHOWN, Claim
from sdhj.certified.check.files import Arrays
from sdhj.certified.check.reading import (
    MOST_COUNTED,
    MOST_ON_AN_AXIS,
    array,
    decimal,
    edges_of,
    expect,
    fraction,
    is_whole,
    real,
    reals,
)
from sdhj.certified.check.stated import Problem, listed

AGENTS = {"arm_case_study": "pursuer", "evader_case_study": "evader"}
PI = (Fraction(314159265358979323846, 10**20), Fraction(314159265358979323847, 10**20))
KNOWN_TURN = Fraction(1, 10**13)  # up to so much: half of it and what rounds an angle are below 2e-13 (`separation`)
LONGEST_LENGTH = 10.0  # also of moves and places: the bound on rounding rests on it
LARGEST_ANGLE = 100.0  # of a disk on its circle
MOST_PARTS = 64  # that an interval is cut into at once
ROWS_AT_ONCE = 256  # between two signs of life


def disk(name: str, given: Any, width: float = 0.0) -> Array:
    """A disk of a recipe as numbers (8,), as `separation.disk_at` reads them, its radius grown by `width`."""
    # as `Disk.describe` writes it into a recipe
    path, radius = given["path"], real(f"radius of {name}", given["radius"], 0.0)
    # A disk at rest is one that moves by nothing, so that kernels know one kind.
    kind, begin, velocity, circle = path["kind"], "centre", [0.0] * 2, [0.0] * 3
    expect(kind in ("still", "line", "circle"), f"the path of {name} must be still, line or circle", kind)
    if kind == "line":
        begin, velocity = "start", reals(f"velocity of {name}", path["velocity"], 2)
    elif kind == "circle":
        circle = [real(f"{part} of {name}", path[part]) for part in ("radius", "rate", "phase")]
        expect(circle[0] >= 0.0, f"radius of the path of {name} must be at least 0", circle[0])
    return np.array([*reals(f"{begin} of {name}", path[begin], 2), *velocity, *circle, radius + width])


class Scene:
    """The numbers of a case study, from its recipe, and how the robot senses.

    given : the recipe's arguments. sensing : the file's `Problem`, of which only its sensing is read here.
    disks (D, 8) : the obstacles, as `disk_at` reads them, grown by the links' half width. target (8,) : the target
        likewise; of an evader only its radius counts, as it is where the evader is.
    """

    def __init__(self, recipe: Mapping[str, Any], sensing: Any) -> None:
        """Read a recipe."""
        given, builder = recipe["arguments"], recipe["builder"]
        expect(builder in AGENTS, f"the builder must be one of {', '.join(AGENTS)}", builder)
        agent = AGENTS[builder]
        # as arguments of the case studies are called, v_p_max or v_e_max among them, by which files keep them
        for name in ("half_width", "u_max", "v_d_max", "delta", f"v_{agent[0]}_max", f"{agent}_radius", f"{agent}_box"):
            real(name, given[name], 0.0)
        for name, least in (("steps", 1), ("input_levels", 2)):
            fits = is_whole(given[name], least, MOST_COUNTED)
            expect(fits, f"{name} must be a whole number from {least} to {MOST_COUNTED}", given[name])
        reals("lengths", list(given["lengths"]), 2, 0.0)
        kinds = ("relative", "printed")
        expect(given["kinematics"] in kinds, f"kinematics must be {' or '.join(kinds)}", given["kinematics"])
        expect(isinstance(given["obstacles"], list), "obstacles must be a list", given["obstacles"])
        disks = [disk(f"obstacle {k}", one, given["half_width"]) for k, one in enumerate(given["obstacles"])]
        chased = agent == "pursuer"
        self.given, self.agent, self.disks = given, agent, np.array(disks).reshape(-1, 8)
        self.target = disk("the target", given["target"]) if chased else np.array([0.0] * 7 + [given["evader_radius"]])
        self.sensing = sensing
        still = not chased or given["target"]["path"]["kind"] == "still"
        expect(self.sensing.jitter == 0 or still, "jitter must fit a target at rest", self.sensing.jitter)

    @property
    def box(self) -> Fraction:
        """Half the side of the square that the agent stays in, m, as a fraction."""
        return decimal(self.given[f"{self.agent}_box"])

    def push(self, axis: int) -> Fraction:
        """The most that the adversary changes the velocity along an axis by, as a fraction.

        In rad/s for a joint, axes 0 and 1; in m/s, the agent's greatest speed, for axes 2 and 3.
        """
        return decimal(self.given["v_d_max" if axis < 2 else f"v_{self.agent[0]}_max"])

    def off(self, axis: int) -> Fraction:
        """E along an axis, how far a prediction may be off, as a fraction: error + delay * push, rad or m."""
        return decimal(self.sensing.error[axis]) + decimal(self.sensing.delay) * self.push(axis)

    def spans(self) -> tuple[Fraction, Fraction]:
        """The least and the greatest time that an input is held, fractions, s: delta - 2 jitter, delta + 2 jitter."""
        late = 2 * decimal(self.sensing.jitter)
        return decimal(self.given["delta"]) - late, decimal(self.given["delta"]) + late

    def inputs(self) -> list[tuple[Fraction, Fraction]]:
        """All inputs, velocities of the two joints, rad/s, as fractions; the first component slowest."""
        # bits of the file count them in this order: that of the head, with which `expect_recipe` compares them
        top, n = decimal(self.given["u_max"]), self.given["input_levels"]
        values = [-top + 2 * top * i / (n - 1) for i in range(n)]
        return [(a, b) for a in values for b in values]

    def world(self, edges: Sequence[Array]) -> World:
        """The scene as compiled kernels read it; ValueError where a number is too large for the rounding bound."""
        given, inputs = self.given, np.array(self.inputs(), dtype=np.float64)
        (l1, l2), relative = given["lengths"], given["kinematics"] == "relative"
        arm = np.array([l1, l2 if relative else l1 + l2, relative], dtype=np.float64)
        push, delta, held = float(given["v_d_max"]), float(given["delta"]), float(self.spans()[1])
        agent = np.array([float(self.push(2)), float(given[f"{self.agent}_radius"]) + float(given["half_width"])])
        # How far the tip may be moved in an interval, at most.
        travel = (np.abs(inputs) + push) @ [arm[0] + arm[1], arm[1]] * held
        # for `sweep` alone, where any number is right: more take longer and leave fewer cells over
        parts = np.clip(travel / (edges[2][1] - edges[2][0]), 1, MOST_PARTS).astype(np.int64)
        angles = 2 * np.pi * (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS
        compass = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        off, chased = np.array([float(self.off(axis)) for axis in range(4)]), self.agent == "pursuer"
        known = arm, inputs, push, chased, agent, delta, self.disks, self.target
        times, (q1, q2, x, y) = (held, self.sensing.jitter, self.sensing.delay), edges
        world = World(*known, q1, q2, x, y, compass, parts, off, *times)
        refuse_large(world, given["steps"])
        return world


def refuse_large(world: World, steps: int) -> None:
    """Raise ValueError if a number of the world, until a step, breaks what the bound on rounding supposes.

    At most `LONGEST_LENGTH` (m or rad) may be: links, radii, how far joints and agent move in an interval, E, edges of
    cells, and where disks are until that step; at most `LARGEST_ANGLE` their angles. Links have at least 1 mm.
    """
    # The last instant that any claim is about.
    end = world.delta * steps + world.begin + world.late
    disks = np.vstack([world.disks, world.target[None]])
    moves = [(float(np.abs(world.inputs).max()) + world.push) * world.held, world.agent[0] * world.held, *world.off]
    edges = [float(np.abs(edge).max()) for edge in (world.q1, world.q2, world.x, world.y)]
    places = np.abs(disks) @ np.array([[1, 1, end, end, 1, 0, 0, 0], [0, 0, 0, 0, 0, 0, 0, 1]]).T
    angles = (np.abs(disks[:, 5]) * end + np.abs(disks[:, 6])) * LONGEST_LENGTH / LARGEST_ANGLE
    numbers = np.array([*world.arm, world.agent[1], *moves, *edges, *places.ravel(), *angles])
    least = min(world.delta, world.push, world.agent[0], world.arm[0] - 1e-3, world.arm[1] - 1e-3)
    if not (numbers <= LONGEST_LENGTH).all() or not least >= 0.0:
        raise ValueError(
            f"the check's bound on rounding holds for links of at least 1 mm and lengths, places and moves in one "
            f"interval from 0 to {LONGEST_LENGTH:g} (metres, radians); this file has links of {world.arm[0]:g} and "
            f"{world.arm[1]:g} m and numbers up to {numbers.max():g}"
        )


class Arm:
    """The sets of an arm's file, and from which cells of the joints each input is said to clear the obstacles.

    `claims` checks all that the file says of them. Each set has a block for each row, whose bits are the agent's cells.

    axes : for each axis its lower end, the width of a cell, and the least and the greatest length, as fractions.
    counts (4,) : of cells. index (entries, rows) : for each set and row the number of a block of the pool (blocks,
        words).
    allowed : (steps, L, n1, n2), where inputs are said to be clear of the obstacles.
    pairs : (entries, 2), the start and within of each entry of the index.
    still : whether nothing depends on time; then a controller asks the sets of step 0 at all steps.
    """

    def __init__(self, head: Mapping[str, Any], arrays: Arrays) -> None:
        """Read an arm's file; ValueError where head or arrays do not fit the recipe."""
        self.problem = Problem(head, arrays, None)
        self.scene = Scene(head["recipe"], self.problem)
        expect_recipe(self.problem, self.scene)
        self.steps = self.scene.given["steps"]
        self.still = not any(part.moving for part in self.problem.parts)
        pairs = [(start, within) for start in range(self.steps + 1) for within in range(self.steps + 1 - start)]
        self.pairs = np.array(pairs)
        self.read_cells(head["cells"], arrays)
        flags = (self.steps, len(self.scene.inputs()), *self.counts[:2].tolist())
        packed = array(arrays, "allowed", np.uint8, -(-math.prod(flags) // 8))
        self.allowed = np.unpackbits(packed, count=math.prod(flags), bitorder="little").view(np.bool_).reshape(flags)

    def read_cells(self, stated: Mapping[str, Any], arrays: Arrays) -> None:
        """Read the cells of each axis, and the sets on them."""
        shape, self.layers = listed("the numbers of cells", stated["shape"], 4), stated.get("layers", [[0, 0]] * 4)
        expect(all(is_whole(n, 2, MOST_ON_AN_AXIS) for n in shape), "shape must be numbers of cells", shape)
        expect(self.layers == [[0, 0]] * 4, "cells of an arm have their width", self.layers)
        ends = zip(stated["lowers"], stated["widths"], stated["extents"], strict=True)
        self.axes = [(fraction(low), fraction(width), *map(fraction, extent)) for low, width, extent in ends]
        expect(len(self.axes) == 4, "an arm has 4 axes", stated["lowers"])
        self.counts, packed = np.array(shape), math.prod(shape[2:])
        self.index = array(arrays, "index", np.uint32, len(self.pairs), math.prod(shape[:2]))
        self.pool = array(arrays, "pool", np.uint64, int(self.index.max()) + 1, -(-packed // 64))
        # Whole words are compared and counted: bits past the last cell would count as cells.
        beyond = self.pool[:, -1] >> np.uint64(packed % 64) if packed % 64 else np.zeros(1)
        expect(not beyond.any(), "the sets must have no cells that there are not", packed)
        self.edges = [edges_of(*one) for one in zip(shape, self.axes, self.layers, strict=True)]

    def bits(self, step: int, within: int) -> Array:
        """The set S_step^within of the file: (cells,), the last axis fastest."""
        row = step * (self.steps + 1) - step * (step - 1) // 2 + within
        blocks, cells = self.pool[self.index[row]].view(np.uint8), math.prod(self.counts[2:].tolist())
        return np.unpackbits(blocks, axis=1, count=cells, bitorder="little").ravel().view(np.bool_)

    @staticmethod
    def bytes_needed(arrays: Arrays) -> int:
        """The bytes that a check takes: three copies of the sets, and for each packed flag a byte."""
        return 3 * arrays.nbytes + 8 * arrays.stated["allowed"].size

    def uncovered(self) -> list[str]:
        """A text for each axis that its cells do not cover, or would cover without the last one; of a joint a turn."""
        # `Argument.uncovered` asks the same of other robots' cells
        box, wrong = self.scene.box, list[str]()
        turn = None, 2 * PI[0], 2 * PI[1], KNOWN_TURN  # an angle may begin anywhere
        ends = [turn] * 2 + [(-box, 2 * box, 2 * box, Fraction(0))] * 2
        for axis, (n, (low, width, least, most)) in enumerate(zip(self.counts.tolist(), self.axes, strict=True)):
            begin, shortest, longest, doubt = ends[axis]
            fits = least <= shortest and most >= longest and most - least <= doubt and begin in (None, low)
            if not (fits and (n - 1) * width < least and n * width >= most):
                wrong.append(f"axis {axis}: {n} cells of width {float(width):.6g} do not cover it")
        return wrong

    @cached_property
    def added(self) -> tuple[Array, Claim]:
        """As `cells_added`."""
        return cells_added(self)

    @cached_property
    def made(self) -> Array:
        """How many claims of cells and flags there are in each row."""
        return np.asarray(self.added[0].sum(axis=1) + self.flags)

    @cached_property
    def flags(self) -> Array:
        """How many inputs are said to be clear of the obstacles in each row, of all starts together."""
        return self.allowed.reshape(-1, self.index.shape[1]).sum(axis=0)

    def claims(self, rows: Array, silent: bool) -> Iterator[Claim]:
        """Yield all claims, checked; those of single cells in some rows (R,), by number.

        Only the first where cells do not cover the axes.
        """
        yield Claim(COVER, 4, 4, wrong := self.uncovered())
        if wrong:  # nothing else in the file means what it says
            return
        world, (counts, grow) = self.scene.world(self.edges), self.added
        yield grow
        # By kinds: 0 for flags, and 1 + n for sets with n steps to go (`check_rows`).
        failed, example = self.checked(rows, world, silent)
        (_, n2, nx, ny), inputs = self.counts.tolist(), len(world.inputs)
        for kind in range(self.steps + 2):
            bad = np.flatnonzero(failed[:, kind])[:SHOWN]
            at = [
                (*divmod(row, n2), *divmod(what, inputs if not kind else nx * ny))
                for row, what in zip(rows[bad].tolist(), example[bad, kind].tolist(), strict=True)
            ]
            if not kind:
                wrong = [f"start {start}, input {j}, joints {i1}, {i2}" for i1, i2, start, j in at]
                name, made, seen = "clear of the obstacles", int(self.flags.sum()), int(self.flags[rows].sum())
            else:
                wrong = [f"start {k}, within {kind - 1}, cell {i1, i2, *divmod(xy, ny)}" for i1, i2, k, xy in at]
                name, added = f"{NEARER}, within {kind - 1}" if kind > 1 else GOALS, counts[:, kind - 1]
                made, seen = int(added.sum()), int(added[rows].sum())
            yield Claim(name, made, seen, wrong, int(failed[:, kind].sum()))

    def checked(self, rows: Array, world: World, silent: bool) -> tuple[Array, Array]:
        """How many claims of each kind in rows (R,) are not proved, and an example of each: both (R, steps + 2).

        By `check_rows`, which says what kinds and examples are, in threads.
        """
        stored = self.stored(rows)
        failed, example = np.zeros((2, len(rows), self.steps + 2), np.int64)
        with tqdm(total=len(rows), desc="verify", unit="row", disable=silent) as bar:
            for done in in_threads(len(rows), lambda at: check_rows(rows[at], world, stored, failed[at], example[at])):
                bar.update(done)
        return failed, example

    def stored(self, rows: Array) -> Stored:
        """The sets as compiled code reads them, eroded in the rows that some rows (R,) lead to.

        The agent's own move, which no input changes, is looked at once for each block.
        """
        n2, still = int(self.counts[1]), [Fraction(0)]
        along = self.ends(2, still)[0], self.ends(3, still)[0]
        ends = [self.ends(axis, [pair[axis] for pair in self.scene.inputs()]) for axis in (0, 1)]
        reached, needed = np.zeros(self.index.shape[1], np.bool_), np.zeros(len(self.pool), np.bool_)
        for first, second in zip(*ends, strict=True):  # of each input
            reached[first[rows // n2, :, None] * n2 + second[rows % n2, None]] = True
        needed[self.index[:, reached]] = True
        blocks = np.flatnonzero(needed)
        eroded = np.zeros(self.pool.shape, np.uint64)  # of other blocks nothing is left, which proves nothing

        def work(part: slice) -> None:
            eroded[blocks[part]] = erode(self.pool[blocks[part]], *along)

        sum(in_threads(blocks.size, work))
        return Stored(self.pairs, self.index, self.pool, eroded, self.allowed, *ends)

    def ends(self, axis: int, drifts: Sequence[Fraction]) -> Array:
        """The cells of an axis that each of its cells may lead to, for each drift: (drifts, n, most).

        Where there are fewer than `most` the last one is repeated.
        """
        push = self.scene.push(axis)
        lists = {drift: overlapped(axis, self, drift - push, drift + push) for drift in set(drifts)}
        most = max(len(found) for of_drift in lists.values() for found in of_drift)
        return np.array([[found + found[-1:] * (most - len(found)) for found in lists[drift]] for drift in drifts])


def overlapped(axis: int, arm: Any, slow: Fraction, fast: Fraction) -> list[list[int]]:
    """For each cell of an axis the indices, ascending, of the cells that a prediction may be in after one interval.

    Axes 0 and 1 are periodic; 2 and 3 have walls, where an image ends with the outermost cell.
    """
    # A state that a wall stops is in the outermost cell, which the image overlaps anyway: the state came from there or
    # passed it.
    # an export must have exactly these cells (`_arm_images_agree`), and not only none fewer
    n, (_, *lengths) = int(arm.counts[axis]), arm.axes[axis]
    off = 0 if arm.scene.sensing.memory else 2 * arm.scene.off(axis)  # a point that is carried on moves as the state
    moves = min(slow * span for span in arm.scene.spans()), max(fast * span for span in arm.scene.spans())
    # whole numbers over one denominator, as exact as the fractions, in a twentieth of the time
    over = math.lcm(*(one.denominator for one in (off, *moves, *lengths)))
    off, back, ahead, width, *extent = (int(one * over) for one in (off, *moves, *lengths))
    out = []
    for cell in range(n):
        found: set[int] = set()
        for period in extent:
            low = cell * width + back - off
            high = (period if cell == n - 1 else (cell + 1) * width) + ahead + off
            for lap in (-2, -1, 0, 1, 2) if axis < 2 else (0,):
                start, stop = low - lap * period, high - lap * period
                if stop > 0 and start < period:
                    first, last = max(start // width, 0), min(-(-stop // width) - 1, n - 1)
                    found |= set(range(min(first, n - 1), last + 1))
        out.append(sorted(found))
    return out


def in_threads(count: int, work: Callable[[slice], None]) -> Iterator[int]:
    """Call `work` on slices of `count` rows, `ROWS_AT_ONCE` each, in threads; yield how many rows each slice had."""
    with ThreadPoolExecutor(numba.get_num_threads()) as threads:
        parts = [slice(begin, min(begin + ROWS_AT_ONCE, count)) for begin in range(0, count, ROWS_AT_ONCE)]
        for part, _ in zip(parts, threads.map(work, parts), strict=True):
            yield part.stop - part.start


def cells_added(arm: Any) -> tuple[Array, Claim]:
    """How many cells each set adds to the one with a step less, in each row; and the claim that sets grow, checked.

    The numbers are (rows, steps + 1), of sets within 0, 1, ... steps, summed over all starts.
    """
    index, pool, wrong = arm.index, arm.pool, []
    sizes = np.bitwise_count(pool).sum(axis=1, dtype=np.int64)
    counts = np.zeros((index.shape[1], arm.steps + 1), np.int64)
    for i, (start, within) in enumerate(arm.pairs):
        counts[:, within] += sizes[index[i]]
        if within:
            # the set before is of the same start, in the order of `pairs`
            here, less = index[i], index[i - 1]
            counts[:, within] -= sizes[less]
            rows = np.flatnonzero(here != less)
            if (pool[less[rows]] & ~pool[here[rows]]).any():
                wrong.append(f"start {start}: the set within {within - 1} is not inside the one within {within}")
        first = index[within]  # of step 0, which is asked for that of any where nothing depends on time
        rows = np.flatnonzero((index[i] != first) & arm.still)
        if (pool[index[i][rows]] & ~pool[first[rows]]).any():
            wrong.append(f"start {start}: the set within {within} is not inside that of step 0")
    made = int((arm.pairs[:, 1] > 0).sum())
    return counts, Claim(GROW, made, made, wrong)
