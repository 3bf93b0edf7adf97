"""What the file of a certified table says, every number of it checked: what follows believes them.

The file begins with three lines: what it is, the SHA-256 of all that follows, and in JSON what it tells; behind them an
HDF5 file begins, of arrays. Nothing reaches the HDF5 library before the digest is right, and no array is read that is
not one of numbers, of the expected shape, inside the file.
"""

import hashlib
import json
import math
import os
import re
import reprlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import h5py
import numpy as np

from sdhj.certified.check.bits import Array
from sdhj.certified.check.separation import DIRECTIONS, World

AGENTS = {"arm_case_study": "pursuer", "evader_case_study": "evader"}
PATHS = {
    "still": {"centre": 2},
    "line": {"start": 2, "velocity": 2},
    "circle": {"centre": 2, "radius": 1, "rate": 1, "phase": 1},
}
ABSURD = 1e6
MOST_COUNTED = 1000  # steps, and levels of an input
LONGEST_LENGTH = 10.0  # also of moves and places: the bound on rounding rests on it
LARGEST_ANGLE = 100.0  # of a disk on its circle
MOST_TEXT = 1 << 24  # bytes that a file tells
MOST_BYTES = 1 << 34  # of an array
MOST_PACKED = 1100  # times as large as it is packed an array may be: gzip does not pack closer
MOST_ON_AN_AXIS = 10**6  # cells
BEGINNING = b"sdhj look-up table, format 4\n"
PLAIN = {h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE}  # ways of packing that are undone
MOST_PARTS = 64  # that an interval is cut into at once


def decimal(value: float) -> Fraction:
    """The decimal that a number is written as."""
    return Fraction(str(value))


def expect(fits: bool, what: str, given: Any) -> None:
    if not fits:
        raise ValueError(f"{what}, got {reprlib.repr(given)}")


def is_whole(value: Any, least: int, most: float = math.inf) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool) and bool(least <= value <= most)


def check_numbers(name: str, given: Any, count: int = 1, least: float = 0.0) -> None:
    """ValueError where that is no number, or no list of `count` of them, from `least` to what no robot exceeds."""
    values = [given] if count == 1 else given
    expect(isinstance(values, list) and len(values) == count, f"{name} must be {count} numbers", given)
    for value in values:
        fits = isinstance(value, int | float) and not isinstance(value, bool) and least <= value <= ABSURD
        expect(fits, f"{name} must be a number from {least:g} to {ABSURD:g}", value)


def check_disk(name: str, given: Any) -> None:
    """ValueError where a disk of a recipe is none."""
    path = given["path"]
    expect(path["kind"] in PATHS, f"the path of {name} must be one of {', '.join(PATHS)}", path["kind"])
    check_numbers(f"radius of {name}", given["radius"])
    for part, count in PATHS[path["kind"]].items():
        check_numbers(f"{part} of {name}", path[part], count, 0.0 if part == "radius" else -ABSURD)


@dataclass(frozen=True)
class Scene:
    """Numbers of a case study, from its recipe."""

    given: Mapping[str, Any]
    agent: str  # "pursuer" or "evader"
    error: tuple[float, ...]  # of a measurement, on each axis
    delay: float
    jitter: float

    @classmethod
    def of(cls, recipe: Mapping[str, Any], sensing: Mapping[str, Any]) -> "Scene":
        """The scene of a recipe, and how the robot senses.

        ValueError, KeyError or TypeError where something is missing or makes no sense.
        """
        given, builder = recipe["arguments"], recipe["builder"]
        expect(builder in AGENTS, f"the builder must be one of {', '.join(AGENTS)}", builder)
        agent = AGENTS[builder]
        for name in ("half_width", "u_max", "v_d_max", "delta", f"v_{agent[0]}_max", f"{agent}_radius", f"{agent}_box"):
            check_numbers(name, given[name])
        for name, least in (("steps", 1), ("input_levels", 2)):
            fits = is_whole(given[name], least, MOST_COUNTED)
            expect(fits, f"{name} must be a whole number from {least} to {MOST_COUNTED}", given[name])
        check_numbers("lengths", list(given["lengths"]), 2)
        kinds = ("relative", "printed")
        expect(given["kinematics"] in kinds, f"kinematics must be {' or '.join(kinds)}", given["kinematics"])
        expect(isinstance(given["obstacles"], list), "obstacles must be a list", given["obstacles"])
        for number, obstacle in enumerate(given["obstacles"]):
            check_disk(f"obstacle {number}", obstacle)
        if agent == "pursuer":
            check_disk("the target", given["target"])
        error, delay, jitter = (sensing.get(name, 0.0) for name in ("error", "delay", "jitter"))
        error = error if isinstance(error, list) else [error] * 4
        check_numbers("error", error, 4)
        check_numbers("delay", delay)
        check_numbers("jitter", jitter)
        still = agent == "evader" or given["target"]["path"]["kind"] == "still"
        expect(jitter == 0 or (2 * jitter <= given["delta"] and still), "jitter must fit a target at rest", jitter)
        return cls(given, agent, tuple(error), delay, jitter)

    @property
    def agent_speed(self) -> float:
        return float(self.given[f"v_{self.agent[0]}_max"])

    @property
    def box(self) -> Fraction:
        """Half the side of the square that the agent stays in."""
        return decimal(self.given[f"{self.agent}_box"])

    def push(self, axis: int) -> Fraction:
        """The greatest that is added to the velocity of an axis."""
        return decimal(self.given["v_d_max"] if axis < 2 else self.agent_speed)

    def off(self, axis: int) -> Fraction:
        """By how much a prediction may be off."""
        return decimal(self.error[axis]) + decimal(self.delay) * self.push(axis)

    def spans(self) -> tuple[Fraction, Fraction]:
        """How long an input is held at least and at most."""
        late = 2 * decimal(self.jitter)
        return decimal(self.given["delta"]) - late, decimal(self.given["delta"]) + late

    def inputs(self) -> list[tuple[Fraction, Fraction]]:
        """All inputs, exactly, the first component slowest."""
        top, n = decimal(self.given["u_max"]), self.given["input_levels"]
        values = [-top + 2 * top * i / (n - 1) for i in range(n)]
        return [(a, b) for a in values for b in values]

    def world(self, edges: tuple[Array, Array, Array, Array]) -> World:
        """What the compiled kernels read; ValueError where a number is too large for the bound on rounding."""
        given, chased, inputs = self.given, self.agent == "pursuer", np.array(self.inputs(), dtype=np.float64)
        (l1, l2), relative = given["lengths"], given["kinematics"] == "relative"
        arm = np.array([l1, l2 if relative else l1 + l2, relative], dtype=np.float64)
        width, push, delta = float(given["half_width"]), float(given["v_d_max"]), float(given["delta"])
        radius = float(given[f"{self.agent}_radius"])
        goal = disk(given["target"]) if chased else np.array([0.0] * 7 + [radius])
        disks = np.array([disk(each, width) for each in given["obstacles"]]).reshape(-1, 8)
        agent = np.array([self.agent_speed, radius + width])
        off, held = np.array([float(self.off(axis)) for axis in range(4)]), float(self.spans()[1])
        travel = (np.abs(inputs) + push) @ [arm[0] + arm[1], arm[1]] * held
        parts = np.clip(travel / (edges[2][1] - edges[2][0]), 1, MOST_PARTS).astype(np.int64)
        angles = 2 * np.pi * (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS
        compass = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        ways = off, held, float(self.jitter), float(self.delay)
        world = World(arm, inputs, push, chased, agent, delta, disks, goal, *edges, compass, parts, *ways)
        refuse_large(world, given["steps"])
        return world


def disk(given: Mapping[str, Any], width: float = 0.0) -> Array:
    """A disk as `separation.disk_at` reads it, its radius grown by the width of what it must not meet."""
    path = {name: given["path"][name] for name in PATHS[given["path"]["kind"]]}
    place, velocity = path["centre" if "centre" in path else "start"], path.get("velocity", (0.0, 0.0))
    circle = (path.get(name, 0.0) for name in ("radius", "rate", "phase"))
    return np.array([*place, *velocity, *circle, given["radius"] + width], dtype=np.float64)


def refuse_large(world: World, steps: int) -> None:
    """ValueError where a number breaks what the bound on rounding supposes: see `sdhj.certified.check.separation`."""
    end = world.delta * steps + world.begin + world.late
    disks = np.vstack([world.disks, world.goal[None]])
    moves = [(float(np.abs(world.inputs).max()) + world.push) * world.held, world.agent[0] * world.held, *world.off]
    edges = [float(np.abs(edge).max()) for edge in (world.q1, world.q2, world.x, world.y)]
    places = np.abs(disks) @ np.array([[1, 1, end, end, 1, 0, 0, 0], [0, 0, 0, 0, 0, 0, 0, 1]]).T
    angles = (np.abs(disks[:, 5]) * end + np.abs(disks[:, 6])) * LONGEST_LENGTH / LARGEST_ANGLE
    sizes = np.array([*world.arm, world.agent[1], *moves, *edges, *places.ravel(), *angles])
    least = min(world.delta, world.push, world.agent[0], world.arm[0] - 1e-3, world.arm[1] - 1e-3)
    if not (sizes <= LONGEST_LENGTH).all() or not least >= 0.0:
        raise ValueError(
            f"the check's bound on rounding holds for links of at least 1 mm and lengths, places and moves in one "
            f"interval from 0 to {LONGEST_LENGTH:g} (metres, radians); this file has links of {world.arm[0]:g} and "
            f"{world.arm[1]:g} m and numbers up to {sizes.max():g}"
        )


@contextmanager
def told_and_arrays(path: str | os.PathLike[str]) -> Iterator[tuple[dict[str, Any], h5py.File]]:
    """What a file tells and its arrays, its bytes those that were written; ValueError otherwise, OSError without it."""
    if not os.path.isfile(path) and os.path.exists(path):
        raise ValueError(f"{path} is no file")
    with open(path, "rb") as stream:
        first, second = stream.readline(100), stream.readline(100)
        begin = stream.tell()
        if first != BEGINNING or second != b"sha256 %s\n" % hashlib.file_digest(stream, "sha256").hexdigest().encode():
            raise ValueError(f"{path} is damaged, or holds no certified sets in format 4; solve it anew")
        stream.seek(begin)
        try:
            told = dict(json.loads(stream.readline(MOST_TEXT)))
            with h5py.File(stream, "r") as arrays:
                yield told, arrays
        except (OSError, LookupError, TypeError, AttributeError, ArithmeticError, RuntimeError, ValueError) as error:
            raise ValueError(
                f"{path}: its certified sets make no sense ({error}); the file is damaged, or another problem's"
            ) from error


def array(file: h5py.File, name: str, kind: type, *shape: int | None, most: int = MOST_BYTES) -> Array:
    """An array of numbers inside a file, looked at before it is read; None stands for any length."""
    link = file.get(name, getlink=True)
    expect(isinstance(link, h5py.HardLink), f"{name} must be an array of the file itself", link)
    data = file[name]
    expect(isinstance(data, h5py.Dataset) and data.dtype == kind, f"{name} must be an array of {np.dtype(kind)}", data)
    plan = data.id.get_create_plist()
    packed = {plan.get_filter(place)[0] for place in range(plan.get_nfilters())}
    own = data.external is None and not data.is_virtual and packed <= PLAIN
    own = own and data.nbytes <= min(most, MOST_PACKED * (data.id.get_storage_size() + 1000))
    fits = len(data.shape) == len(shape) and all(
        one in (None, other) for one, other in zip(shape, data.shape, strict=True)
    )
    expect(own and fits, f"{name} must be kept in the file, of shape {shape}", data.shape)
    return data[()]


def fraction(text: Any) -> Fraction:
    """A fraction of two whole numbers that are not absurdly long; ValueError where it is none."""
    fits = isinstance(text, str) and re.fullmatch("-?[0-9]{1,300}(/[0-9]{1,300})?", text)
    expect(bool(fits), "cells must be told as fractions", text)
    return Fraction(text)


class File:
    """Cells and bits of a file; ValueError where its parts do not fit together."""

    def __init__(self, told: Mapping[str, Any], arrays: h5py.File) -> None:
        self.scene, cells = Scene.of(told["recipe"], told.get("sensing", {})), told["cells"]
        self.steps = self.scene.given["steps"]
        pairs = [(start, within) for start in range(self.steps + 1) for within in range(self.steps + 1 - start)]
        self.pairs = np.array(pairs)
        self.shape = tuple(cells["shape"])
        fits = len(self.shape) == 4 and all(is_whole(n, 2, MOST_ON_AN_AXIS) for n in self.shape)
        expect(fits, f"shape must be four numbers of cells from 2 to {MOST_ON_AN_AXIS}", self.shape)
        self.widths, self.lowers = ([fraction(w) for w in cells[name]] for name in ("widths", "lowers"))
        self.extents = [(fraction(a), fraction(b)) for a, b in cells["extents"]]
        expect({len(part) for part in (self.widths, self.lowers, self.extents)} == {4}, "axes must be four", cells)
        n1, n2, nx, ny = self.shape
        flags, bits = (self.steps, len(self.scene.inputs()), n1, n2), nx * ny
        self.index = array(arrays, "index", np.uint32, len(pairs), n1 * n2)
        self.pool = array(arrays, "pool", np.uint64, int(self.index.max()) + 1, -(-bits // 64))
        packed = array(arrays, "allowed", np.uint8, -(-math.prod(flags) // 8))
        if bits % 64 and (self.pool[:, -1] >> np.uint64(bits % 64)).any():
            raise ValueError("the certified sets have cells that there are not")
        self.allowed = np.unpackbits(packed, count=math.prod(flags), bitorder="little").view(np.bool_).reshape(flags)

    def edges(self) -> tuple[Array, Array, Array, Array]:
        """Edges of the cells of each axis, (n + 1,), rounded to the nearest number."""
        axes = zip(self.shape, self.widths, self.lowers, self.extents, strict=True)
        q1, q2, x, y = (
            np.array([*(float(lower + i * width) for i in range(n)), float(lower + extent[1])])
            for n, width, lower, extent in axes
        )
        return q1, q2, x, y

    def ends(self, axis: int, drifts: Sequence[Fraction]) -> Array:
        """Cells that each cell of an axis may end in for each drift, (drifts, n, most), the last one repeated."""
        push = self.scene.push(axis)
        lists = {drift: overlapped(axis, self, drift - push, drift + push) for drift in set(drifts)}
        most = max(len(found) for of_drift in lists.values() for found in of_drift)
        return np.array([[found + found[-1:] * (most - len(found)) for found in lists[drift]] for drift in drifts])


def overlapped(axis: int, file: File, slow: Fraction, fast: Fraction) -> list[list[int]]:
    """For each cell of an axis those that a prediction may be in after one interval, slow <= 0 <= fast at walls.

    What a wall stops ends in the outermost cell, which the image overlaps anyway: it came from there or passed it.
    """
    n, width, off = file.shape[axis], file.widths[axis], 2 * file.scene.off(axis)
    back, ahead = min(slow * span for span in file.scene.spans()), max(fast * span for span in file.scene.spans())
    out = []
    for cell in range(n):
        found: set[int] = set()
        for period in file.extents[axis]:
            low = cell * width + back - off
            high = (period if cell == n - 1 else (cell + 1) * width) + ahead + off
            for lap in (-2, -1, 0, 1, 2) if axis < 2 else (0,):
                start, stop = low - lap * period, high - lap * period
                if stop > 0 and start < period:
                    first, last = max(start // width, 0), min(-(-stop // width) - 1, n - 1)
                    found |= set(range(min(int(first), n - 1), int(last) + 1))
        out.append(sorted(found))
    return out
