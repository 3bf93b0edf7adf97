"""An independent check of certified sets: reads a file and derives its claims anew.

Nothing of the solver is used, neither its code nor its bounds: only the numbers in the file. Where the solver encloses
the arm in convex hulls and scans cells, this checker looks for a *separating direction*: a link and a disk (or a cell
of the pursuer, grown by what it can move) are further apart than r if along some unit vector n = (cos a, sin a) every
point of the body is more than r ahead of every point of the link. Along n the elbow is at l1 cos(q1 - a) and the tip
l2 cos(q1 + q2 - a) further, so a proof needs the range of a cosine over an interval and a few sums, done here in
interval arithmetic that rounds outward. Where one direction does not do, time, angles and the pursuer's cell are
halved.
Reach is checked in fractions.

It answers "proved" or "not proved". A cell whose certificate is right may, in principle, need more halving than is
granted.
"""

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

PI = (Fraction(314159265358979323846, 10**20), Fraction(314159265358979323847, 10**20))
COSINE_ERROR = 4e-15  # NumPy's cosine is within four units in the last place; this is more
TIME_HALVINGS = 6
GRANTED = 20_000  # boxes for one question; then it is not proved
STATE_ERROR = 1e-10  # a state counts as in a cell up to this far from it
SHOWN = 5  # failures listed for each claim
BATCH = 4000


# --------------------------------------------------------------------------------------------------------------------
# Interval arithmetic
# --------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Interval:
    """Arrays of intervals [low, high] that hold the true values; every operation rounds outward."""

    low: Array
    high: Array

    @staticmethod
    def of(value: Any) -> "Interval":
        """A point, taken as it is in floating point."""
        value = np.asarray(value, dtype=np.float64)
        return Interval(value, value)

    @staticmethod
    def _outward(low: Array, high: Array) -> "Interval":
        return Interval(np.nextafter(low, -np.inf), np.nextafter(high, np.inf))

    def __add__(self, other: "Interval") -> "Interval":
        return self._outward(self.low + other.low, self.high + other.high)

    def __neg__(self) -> "Interval":
        return Interval(-self.high, -self.low)

    def __sub__(self, other: "Interval") -> "Interval":
        return self + (-other)

    def __mul__(self, other: "Interval") -> "Interval":
        products = [a * b for a in (self.low, self.high) for b in (other.low, other.high)]
        return self._outward(np.minimum.reduce(products), np.maximum.reduce(products))

    def square(self) -> "Interval":
        """x * x, which is never negative."""
        ends = self * self
        straddles = (self.low <= 0.0) & (self.high >= 0.0)
        low = np.minimum(self.low * self.low, self.high * self.high)
        return Interval(np.where(straddles, 0.0, np.nextafter(low, -np.inf)), ends.high)

    def positive(self) -> "Interval":
        """max(x, 0)."""
        return Interval(np.maximum(self.low, 0.0), np.maximum(self.high, 0.0))

    def cos(self) -> "Interval":
        """Range of the cosine: its ends, and 1 or -1 where the interval may hold a multiple of pi."""
        ends = np.cos(self.low), np.cos(self.high)
        low, high = np.minimum(*ends) - COSINE_ERROR, np.maximum(*ends) + COSINE_ERROR
        doubt = 1e-12 * (1.0 + np.abs(self.low) + np.abs(self.high))
        first = np.ceil((self.low - doubt) / np.pi)  # the first and last multiple that it may hold
        last = np.floor((self.high + doubt) / np.pi)
        even = (last > first) | ((last == first) & (np.mod(first, 2) == 0))
        odd = (last > first) | ((last == first) & (np.mod(first, 2) == 1))
        return Interval(np.maximum(np.where(odd, -1.0, low), -1.0), np.minimum(np.where(even, 1.0, high), 1.0))

    def sin(self) -> "Interval":
        return (self - Interval(np.array(np.nextafter(np.pi / 2, 0)), np.array(np.nextafter(np.pi / 2, 4)))).cos()


# --------------------------------------------------------------------------------------------------------------------
# The problem, as the file tells it
# --------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Scene:
    """Numbers of a case study, from its recipe."""

    lengths: tuple[float, float]
    relative: bool
    half_width: float
    speeds: tuple[float, float, float]  # of the input, the disturbance, the agent
    levels: int
    delta: float
    steps: int
    agent: str
    agent_radius: float
    box: float
    target: Mapping[str, Any] | None
    obstacles: Sequence[Mapping[str, Any]]

    @classmethod
    def of(cls, recipe: Mapping[str, Any]) -> "Scene":
        given = recipe["arguments"]
        agent, short = ("pursuer", "p") if recipe["builder"] == "arm_case_study" else ("evader", "e")
        l1, l2 = given["lengths"]
        relative = given["kinematics"] == "relative"
        return cls(
            lengths=(l1, l2 if relative else l1 + l2),
            relative=relative,
            half_width=given["half_width"],
            speeds=(given["u_max"], given["v_d_max"], given[f"v_{short}_max"]),
            levels=given["input_levels"],
            delta=given["delta"],
            steps=given["steps"],
            agent=agent,
            agent_radius=given[f"{agent}_radius"],
            box=given[f"{agent}_box"],
            target=given.get("target"),
            obstacles=given["obstacles"],
        )

    def inputs(self) -> list[tuple[Fraction, Fraction]]:
        """All inputs, exactly, the first component slowest."""
        top, n = decimal(self.speeds[0]), self.levels
        values = [-top + 2 * top * i / (n - 1) for i in range(n)]
        return [(a, b) for a in values for b in values]


def decimal(value: float) -> Fraction:
    """The decimal that a number is written as."""
    return Fraction(str(value))


def centre(disk: Mapping[str, Any], t: Interval) -> tuple[Interval, Interval]:
    """Where the centre of a disk can be during t."""
    path = disk["path"]
    if path["kind"] == "still":
        x, y = (Interval.of(np.full_like(t.low, c)) for c in path["centre"])
    elif path["kind"] == "line":
        x, y = (Interval.of(s) + Interval.of(v) * t for s, v in zip(path["start"], path["velocity"], strict=True))
    else:
        angle = Interval.of(path["rate"]) * t + Interval.of(path["phase"])
        x = Interval.of(path["centre"][0]) + Interval.of(path["radius"]) * angle.cos()
        y = Interval.of(path["centre"][1]) + Interval.of(path["radius"]) * angle.sin()
    return x, y


# --------------------------------------------------------------------------------------------------------------------
# Clearance
# --------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Boxes:
    """Rows of questions: does a link, at joint angles q during tau, stay clear of a body?

    owner (R,) : whose question it is. cell, box (R, 4, 2) : the cell it began with; the joint angles and the agent at
    the times tau (R, 2). speed (R, 2) : velocities of the joints, without the disturbance. link, body (R,) : body 0 is
    the agent, k is obstacle k - 1. start (R,) : time at which tau is 0.
    """

    owner: Array
    cell: Array
    box: Array
    tau: Array
    speed: Array
    link: Array
    body: Array
    start: Array

    def take(self, which: Array) -> "Boxes":
        return Boxes(*(getattr(self, name)[which] for name in self.__dataclass_fields__))

    @staticmethod
    def join(parts: Sequence["Boxes"]) -> "Boxes":
        return Boxes(*(np.concatenate([getattr(p, name) for p in parts]) for name in Boxes.__dataclass_fields__))


class Clearance:
    """Proves that the arm stays clear of the obstacles and the pursuer."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.bodies = [0] if scene.agent == "pursuer" else []
        self.bodies += [k + 1 for k in range(len(scene.obstacles))]

    def prove(self, cells: Array, speeds: Array, starts: Array, duration: float, bodies: Sequence[int]) -> Array:
        """For which rows it is proved, (M,) bool.

        cells (M, 4, 2) : bounds of the cells. speeds (M, 2) : the inputs. starts (M,) : t_k. duration : of the
        interval, 0 for an instant. bodies : which of them.
        """
        proved, spent = np.ones(len(cells), np.bool_), np.zeros(len(cells), np.int64)
        todo = self._questions(cells, speeds, starts, duration, bodies)
        while len(todo.owner):
            spent += np.bincount(todo.owner, minlength=len(cells))
            todo = todo.take(~self._separated(todo))
            proved[todo.owner[self._touching(todo)]] = False
            proved[todo.owner[spent[todo.owner] > GRANTED]] = False
            todo = self._halved(todo.take(proved[todo.owner]), duration)
        return proved

    def _questions(self, cells: Array, speeds: Array, starts: Array, duration: float, bodies: Sequence[int]) -> Boxes:
        count = len(cells)
        parts = []
        for link in (0, 1):
            for body in bodies:
                same = np.full(count, link), np.full(count, body), starts
                tau = np.tile([0.0, duration], (count, 1))
                parts.append(Boxes(np.arange(count), cells, cells, tau, speeds, *same))
        none = np.zeros(0, np.int64)
        empty = Boxes(none, cells[:0], cells[:0], np.zeros((0, 2)), speeds[:0], none, none, starts[:0])
        return self._moved(Boxes.join([*parts, empty]))

    def _moved(self, rows: Boxes) -> Boxes:
        """The boxes where the joints and the agent are during tau."""
        box = rows.cell.copy()
        _, push, agent = self.scene.speeds
        for axis in range(2):
            slow, fast = rows.speed[:, axis] - push, rows.speed[:, axis] + push
            back = np.minimum(slow * rows.tau[:, 0], slow * rows.tau[:, 1])
            ahead = np.maximum(fast * rows.tau[:, 0], fast * rows.tau[:, 1])
            box[:, axis] += np.stack([back, ahead], axis=1)
        box[:, 2:, 0] -= agent * rows.tau[:, 1, None]
        box[:, 2:, 1] += agent * rows.tau[:, 1, None]
        box[:, :, 0] -= STATE_ERROR + 1e-14  # states beside their cell, and the rounding of the lines above
        box[:, :, 1] += STATE_ERROR + 1e-14
        return Boxes(rows.owner, rows.cell, box, rows.tau, rows.speed, rows.link, rows.body, rows.start)

    def _contact(self, rows: Boxes) -> Array:
        """The distance between link and centre at contact, (R,), rounded up."""
        radii = [self.scene.agent_radius, *(disk["radius"] for disk in self.scene.obstacles)]
        return np.nextafter(np.array(radii)[rows.body] + self.scene.half_width, np.inf)

    def _body(self, rows: Boxes) -> tuple[Interval, Interval]:
        """Where the centre of each row's body can be."""
        x = Interval(rows.box[:, 2, 0], rows.box[:, 2, 1])
        y = Interval(rows.box[:, 3, 0], rows.box[:, 3, 1])
        t = Interval.of(rows.start) + Interval(rows.tau[:, 0], rows.tau[:, 1])
        for k, disk in enumerate(self.scene.obstacles):
            at = rows.body == k + 1
            if at.any():
                own = centre(disk, t)
                x = Interval(np.where(at, own[0].low, x.low), np.where(at, own[0].high, x.high))
                y = Interval(np.where(at, own[1].low, y.low), np.where(at, own[1].high, y.high))
        return x, y

    def _separated(self, rows: Boxes) -> Array:
        """Whether one direction proves the row."""
        a = Interval.of(self._direction(rows))
        x, y = self._body(rows)
        body = x * a.cos() + y * a.sin()
        for k, disk in enumerate(self.scene.obstacles):  # along a circle both coordinates vary together
            at = rows.body == k + 1
            if at.any() and disk["path"]["kind"] == "circle":
                body = merge(at, self._on_circle(disk, rows, a), body)
        l1, l2 = (Interval.of(length) for length in self.scene.lengths)
        q1, q2 = (Interval(rows.box[:, axis, 0], rows.box[:, axis, 1]) for axis in (0, 1))
        elbow = l1 * (q1 - a).cos()
        second = (l2 * ((q1 + q2 if self.scene.relative else q2) - a).cos()).positive()
        link = merge(rows.link == 0, elbow.positive(), elbow + second)
        return (body - link).low > self._contact(rows)

    def _on_circle(self, disk: Mapping[str, Any], rows: Boxes, a: Interval) -> Interval:
        path = disk["path"]
        t = Interval.of(rows.start) + Interval(rows.tau[:, 0], rows.tau[:, 1])
        angle = Interval.of(path["rate"]) * t + Interval.of(path["phase"]) - a
        x, y = (Interval.of(c) for c in path["centre"])
        return x * a.cos() + y * a.sin() + Interval.of(path["radius"]) * angle.cos()

    def _pose(self, rows: Boxes) -> tuple[Array, Array, Array, Array]:
        """In the middle of each box: the link's ends and the body's centre and half-size, each (R, 2). Not a bound."""
        q = rows.box[:, :2].mean(axis=2)
        l1, l2 = self.scene.lengths
        phi = q.sum(axis=1) if self.scene.relative else q[:, 1]
        elbow = l1 * np.stack([np.cos(q[:, 0]), np.sin(q[:, 0])], axis=1)
        tip = elbow + l2 * np.stack([np.cos(phi), np.sin(phi)], axis=1)
        first = (rows.link == 0)[:, None]
        body = [(part.low + part.high) / 2 for part in self._body(rows)]
        size = np.where((rows.body == 0)[:, None], (rows.box[:, 2:, 1] - rows.box[:, 2:, 0]) / 2, 0.0)
        return np.where(first, 0.0, elbow), np.where(first, elbow, tip), np.stack(body, axis=1), size

    def _direction(self, rows: Boxes) -> Array:
        """A direction worth trying: from the link to the nearest point of the body, in the middle of the box."""
        start, end, body, size = self._pose(rows)
        best, gap = np.full(len(start), np.inf), np.zeros_like(start)
        pairs = [(point, np.clip(point, body - size, body + size)) for point in (start, end)]
        for sx in (-1.0, 1.0):
            for sy in (-1.0, 1.0):
                corner = body + size * np.array([sx, sy])
                pairs.append((nearest_on_segment(corner, start, end), corner))
        for here, there in pairs:
            distance = np.hypot(*(there - here).T)
            closer = distance < best
            best = np.where(closer, distance, best)
            gap = np.where(closer[:, None], there - here, gap)
        return np.arctan2(gap[:, 1], gap[:, 0])

    def _touching(self, rows: Boxes) -> Array:
        """Whether the row is hopeless: link and body touch in the middle of the box."""
        start, end, body, _ = self._pose(rows)
        return np.hypot(*(nearest_on_segment(body, start, end) - body).T) <= self._contact(rows)

    def _halved(self, rows: Boxes, duration: float) -> Boxes:
        """Every row in two: first in time, then where the box is widest in metres."""
        length = rows.tau[:, 1] - rows.tau[:, 0]
        late = (length > duration * 0.75 / 2**TIME_HALVINGS) & (duration > 0)
        middle = rows.tau.mean(axis=1)
        soon, after = rows.take(late), rows.take(late)
        first = np.stack([soon.tau[:, 0], middle[late]], axis=1)
        second = np.stack([middle[late], soon.tau[:, 1]], axis=1)
        parts = [self._moved(with_tau(soon, first)), self._moved(with_tau(after, second))]
        wide = rows.take(~late)
        reach = np.array([sum(self.scene.lengths), self.scene.lengths[1], 1.0, 1.0])
        sizes = (wide.box[:, :, 1] - wide.box[:, :, 0]) * reach
        sizes[wide.body > 0, 2:] = 0.0
        axis, place = sizes.argmax(axis=1), np.arange(len(wide.owner))
        cut = wide.box[place, axis].mean(axis=1)
        for side in (0, 1):
            box = wide.box.copy()
            box[place, axis, 1 - side] = cut
            parts.append(Boxes(wide.owner, wide.cell, box, wide.tau, wide.speed, wide.link, wide.body, wide.start))
        return Boxes.join(parts)


def with_tau(rows: Boxes, tau: Array) -> Boxes:
    return Boxes(rows.owner, rows.cell, rows.box, tau, rows.speed, rows.link, rows.body, rows.start)


def merge(where: Array, a: Interval, b: Interval) -> Interval:
    return Interval(np.where(where, a.low, b.low), np.where(where, a.high, b.high))


def nearest_on_segment(points: Array, start: Array, end: Array) -> Array:
    """The nearest point of each segment, (R, 2)."""
    along = end - start
    square = np.maximum((along**2).sum(axis=1), 1e-300)
    s = np.clip(((points - start) * along).sum(axis=1) / square, 0.0, 1.0)
    return start + s[:, None] * along


def tips_inside(scene: Scene, cells: Array, t: Array) -> Array:
    """Whether every tip of each cell (M, 4, 2) is inside the target at its time t (M,)."""
    proved, spent = np.ones(len(cells), np.bool_), np.zeros(len(cells), np.int64)
    owner, box = np.arange(len(cells)), cells.copy()
    box[:, :, 0] -= STATE_ERROR
    box[:, :, 1] += STATE_ERROR
    reach = np.array([sum(scene.lengths), scene.lengths[1], 1.0, 1.0])
    if scene.target is not None:
        reach[2:] = 0.0  # the agent's cell plays no part
    while len(owner):
        spent += np.bincount(owner, minlength=len(cells))
        far = ~_tip_inside(scene, box, t[owner])
        owner, box = owner[far], box[far]
        middle = np.repeat(box.mean(axis=2, keepdims=True), 2, axis=2)
        proved[owner[~_tip_inside(scene, middle, t[owner])]] = False
        proved[owner[spent[owner] > GRANTED]] = False
        owner, box = owner[proved[owner]], box[proved[owner]]
        axis, place = ((box[:, :, 1] - box[:, :, 0]) * reach).argmax(axis=1), np.arange(len(owner))
        halves = [box.copy(), box.copy()]
        for side in (0, 1):
            halves[side][place, axis, 1 - side] = box[place, axis].mean(axis=1)
        owner, box = np.concatenate([owner, owner]), np.concatenate(halves)
    return proved


def _tip_inside(scene: Scene, box: Array, t: Array) -> Array:
    """Whether interval arithmetic alone proves that every tip of each box is inside the target."""
    l1, l2 = (Interval.of(length) for length in scene.lengths)
    q1, q2, px, py = (Interval(box[:, axis, 0], box[:, axis, 1]) for axis in range(4))
    phi = q1 + q2 if scene.relative else q2
    x, y = l1 * q1.cos() + l2 * phi.cos(), l1 * q1.sin() + l2 * phi.sin()
    cx, cy = (px, py) if scene.target is None else centre(scene.target, Interval.of(t))
    radius = Interval.of(scene.agent_radius if scene.target is None else scene.target["radius"]).square()
    return ((x - cx).square() + (y - cy).square()).high <= radius.low


# --------------------------------------------------------------------------------------------------------------------
# The sets, as the file tells them
# --------------------------------------------------------------------------------------------------------------------


class Sets:
    """Cells and bits of a file."""

    def __init__(self, group: h5py.Group) -> None:
        self.scene = Scene.of(json.loads(group.attrs["recipe"]))
        self.shape = tuple(int(n) for n in group.attrs["shape"])
        self.widths = [Fraction(w) for w in group.attrs["widths"]]
        self.lowers = [Fraction(w) for w in group.attrs["lowers"]]
        self.extents = [(Fraction(a), Fraction(b)) for a, b in group.attrs["extents"]]
        self.index, self.pool = group["index"][()], group["pool"][()]
        shape = tuple(int(n) for n in group.attrs["allowed_shape"])
        bits = np.unpackbits(group["allowed"][()], count=int(np.prod(shape)), bitorder="little")
        self.allowed = bits.astype(np.bool_).reshape(shape)

    def place(self, start: int, within: int) -> int:
        return sum(self.scene.steps - k + 1 for k in range(start)) + within

    def has(self, start: int, within: int, cells: Array) -> Array:
        """Whether cells (..., 4) are in a set."""
        _, n2, _, ny = self.shape
        block = self.index[self.place(start, within), cells[..., 0] * n2 + cells[..., 1]]
        bit = cells[..., 2] * ny + cells[..., 3]
        return (self.pool[block, bit // 64] >> (bit % 64).astype(np.uint64)) & np.uint64(1) == 1

    def members(self, start: int, within: int) -> tuple[Array, Array]:
        """For every row cell its bits: (rows, words), and those of the same set with one step less, or none."""
        here = self.pool[self.index[self.place(start, within)]]
        before = self.pool[self.index[self.place(start, within - 1)]] if within else np.zeros_like(here)
        return here, before

    def cells(self, rows: Array, bits: Array) -> Array:
        """Cells (M, 4) from their row and bit."""
        _, n2, _, ny = self.shape
        return np.stack([rows // n2, rows % n2, bits // ny, bits % ny], axis=1)

    def bounds(self, cells: Array) -> Array:
        """Bounds of cells (M, 4, 2) in floating point, rounded outward by more than a rounding."""
        out = np.empty((*cells.shape, 2))
        for axis in range(4):
            n, width, lower = self.shape[axis], self.widths[axis], self.lowers[axis]
            edges = np.array([float(lower + i * width) for i in range(n)] + [float(lower + self.extents[axis][1])])
            out[:, axis, 0], out[:, axis, 1] = edges[cells[:, axis]] - 1e-15, edges[cells[:, axis] + 1] + 1e-15
        return out


def overlapped(axis: int, sets: Sets, slow: Fraction, fast: Fraction) -> list[list[int]]:
    """For each cell of an axis the cells that its image may overlap after one interval."""
    n, width, extent = sets.shape[axis], sets.widths[axis], sets.extents[axis]
    delta = decimal(sets.scene.delta)
    out = []
    for cell in range(n):
        found: set[int] = set()
        for period in extent if axis < 2 else extent[:1]:
            low = cell * width + slow * delta
            high = (period if cell == n - 1 else (cell + 1) * width) + fast * delta
            if axis >= 2:  # walls
                low, high = max(low, Fraction(0)), min(high, period)
                found |= overlap(low, high, Fraction(0), n, width, period)
            else:
                for lap in (-2, -1, 0, 1, 2):
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
    """One kind of claim: how many were made, how many checked, and what was not proved."""

    name: str
    made: int
    checked: int
    failures: tuple[str, ...]
    failed: int


@dataclass(frozen=True)
class Report:
    """What `verify` looked at and found."""

    claims: tuple[Claim, ...]

    @property
    def ok(self) -> bool:
        return all(claim.failed == 0 for claim in self.claims)

    def __str__(self) -> str:
        lines = []
        for claim in self.claims:
            verdict = "proved" if claim.failed == 0 else f"{claim.failed} NOT proved"
            lines.append(f"{claim.name}: {claim.checked:,} of {claim.made:,} checked, {verdict}")
            lines += [f"    {failure}" for failure in claim.failures]
        return "\n".join(lines)


def verify(
    path: str | os.PathLike[str], *, samples: int | None = 2000, seed: int = 0, group: str = "certified"
) -> Report:
    """Check the certified sets in an HDF5 file.

    Parameters
    ----------
    path : path
    samples : int or None
        How many claims of each kind are drawn at random, half of the cells of a set from its boundary; None checks all.
    seed : int
    group : str
        The group of the file that holds the sets.

    Raises
    ------
    ValueError
        Where the file holds no certified sets of a case study.
    """
    with h5py.File(path, "r") as file:
        if group not in file:
            raise ValueError(f"{path} holds no certified sets; make them with method='certified'")
        if file[group].attrs.get("kind") != "arm":
            raise ValueError(
                f"{path} holds certified sets of a problem of your own, whose functions are not in the file; only "
                "the arm's case study can be checked from a file alone"
            )
        sets = Sets(file[group])
    return Report(tuple(Checker(sets, samples, np.random.default_rng(seed)).run()))


class Checker:
    """Goes through the claims of a file."""

    def __init__(self, sets: Sets, samples: int | None, rng: np.random.Generator) -> None:
        self.sets, self.samples, self.rng = sets, samples, rng
        self.scene = sets.scene
        self.clearance = Clearance(self.scene)
        self.inputs = self.scene.inputs()
        self.speeds = np.array([[float(u) for u in pair] for pair in self.inputs])

    def run(self) -> list[Claim]:
        cover = self.cells_cover()
        if cover.failed:  # nothing else in the file means what it says
            return [cover]
        return [cover, self.sets_grow(), self.obstacles(), *self.goals(), *self.steps()]

    def cells_cover(self) -> Claim:
        """The cells of each axis cover it, and the bounds on the period of an angle hold 2 pi."""
        failures = []
        box = decimal(self.scene.box)
        for axis in range(4):
            n, width, extent = self.sets.shape[axis], self.sets.widths[axis], self.sets.extents[axis]
            whole = width > 0 and (n - 1) * width < extent[0] and n * width >= extent[1]
            if axis < 2:
                right = (
                    extent[0] <= 2 * PI[0] and extent[1] >= 2 * PI[1] and extent[1] - extent[0] < Fraction(1, 10**13)
                )
            else:
                right = extent == (2 * box, 2 * box) and self.sets.lowers[axis] == -box
            if not (whole and right):
                failures.append(f"axis {axis}: {n} cells of width {float(width):.6g} do not cover it")
        return claim("cells cover the axes", 4, 4, failures)

    def sets_grow(self) -> Claim:
        """S_k^{n-1} is a part of S_k^n, so that `within` means what it says."""
        failures, count = [], 0
        for k in range(self.scene.steps + 1):
            for n in range(1, self.scene.steps - k + 1):
                count += 1
                here, before = self.sets.members(k, n)
                if (before & ~here).any():
                    failures.append(f"start {k}: the set within {n - 1} is not inside the one within {n}")
        return claim("sets grow with the steps to go", count, count, failures)

    def obstacles(self) -> Claim:
        """Where an input is marked as clear of the obstacles it is so throughout the interval."""
        made = np.flatnonzero(self.sets.allowed)
        chosen = self._some(made)
        step, j, i1, i2 = np.unravel_index(chosen, self.sets.allowed.shape)
        cells = np.stack([i1, i2, 0 * i1, 0 * i1], axis=1)
        known = [body for body in self.clearance.bodies if body > 0]
        proved = self._clear(cells, j, step * self.scene.delta, self.scene.delta, known)
        names = [
            f"start {s}, input {u}, joints {a}, {b}"
            for s, u, a, b in zip(*(v[~proved] for v in (step, j, i1, i2)), strict=True)
        ]
        return claim("clear of the obstacles", made.size, chosen.size, names)

    def goals(self) -> list[Claim]:
        """S_k^0 is inside the target and outside the unsafe set at t_k."""
        made, chosen = self._draw(0)
        proved = (
            np.concatenate([self._goal(k, cells) for k, cells in chosen.items()]) if chosen else np.ones(0, np.bool_)
        )
        return [self._claim("in the target, and safe", made, chosen, proved, 0)]

    def steps(self) -> list[Claim]:
        """Every cell that S_k^n adds to S_k^{n-1} has an input that is safe and ends in S_{k+1}^{n-1}."""
        out = []
        for n in range(1, self.scene.steps + 1):
            made, chosen = self._draw(n)
            proved = [self._step(k, n, cells) for k, cells in chosen.items()]
            out.append(
                self._claim(
                    f"one step nearer, within {n}", made, chosen, np.concatenate([*proved, np.ones(0, np.bool_)]), n
                )
            )
        return out

    def _claim(self, name: str, made: int, chosen: Mapping[int, Array], proved: Array, within: int) -> Claim:
        labels = [
            f"start {k}, within {within}, cell {tuple(int(i) for i in cell)}"
            for k, cells in chosen.items()
            for cell in cells
        ]
        failures = [label for label, fine in zip(labels, proved, strict=True) if not fine]
        return claim(name, made, len(labels), failures)

    def _some(self, items: Array) -> Array:
        if self.samples is None or items.size <= self.samples:
            return items
        return self.rng.choice(items, self.samples, replace=False)

    def _draw(self, n: int) -> tuple[int, dict[int, Array]]:
        """How many cells the sets within n add, and some of them for each start."""
        starts = self.scene.steps - n + 1
        total, chosen = 0, {}
        for k in range(starts):
            here, before = self.sets.members(k, n)
            new = here & ~before
            sizes = np.bitwise_count(new).sum(axis=1).astype(np.int64)
            total += int(sizes.sum())
            share = None if self.samples is None else -(-self.samples // starts)
            if sizes.sum():
                chosen[k] = self._pick(k, n, new, sizes, share)
        return total, chosen

    def _pick(self, k: int, n: int, new: Array, sizes: Array, share: int | None) -> Array:
        """Cells (M, 4) among the set bits: all, or `share` of them, half from the boundary of the set."""
        bits = self.sets.shape[2] * self.sets.shape[3]
        if share is None or sizes.sum() <= share:
            rows, places = np.nonzero(np.unpackbits(new.view(np.uint8), axis=1, count=bits, bitorder="little"))
            return self.sets.cells(rows, places)
        many = 8 * share  # enough to find boundary cells among
        rows = self.rng.choice(len(new), many, p=sizes / sizes.sum())
        unpacked = np.unpackbits(new[rows].view(np.uint8), axis=1, count=bits, bitorder="little")
        places = (unpacked * self.rng.random(unpacked.shape, dtype=np.float32)).argmax(axis=1)
        cells = np.unique(self.sets.cells(rows, places), axis=0)
        edge = self._on_boundary(k, n, cells)
        inner, outer = self.rng.permutation(cells[~edge]), self.rng.permutation(cells[edge])
        outer = outer[: max(share // 2, share - len(inner))]
        return np.concatenate([outer, inner[: share - len(outer)]])

    def _on_boundary(self, k: int, n: int, cells: Array) -> Array:
        """Whether a cell has a neighbour that is not in the set."""
        out = np.zeros(len(cells), np.bool_)
        for axis in range(4):
            for side in (-1, 1):
                beside = cells.copy()
                beside[:, axis] += side
                size = self.sets.shape[axis]
                beside[:, axis] = beside[:, axis] % size if axis < 2 else np.clip(beside[:, axis], 0, size - 1)
                out |= ~self.sets.has(k, n, beside)
        return out

    def _clear(self, cells: Array, j: Array, starts: Array, duration: float, bodies: Sequence[int]) -> Array:
        bounds, speeds = self.sets.bounds(cells), self.speeds[j]
        parts = [
            self.clearance.prove(bounds[at], speeds[at], starts[at], duration, bodies)
            for at in (slice(begin, begin + BATCH) for begin in range(0, len(cells), BATCH))
        ]
        return np.concatenate([*parts, np.ones(0, np.bool_)])

    def _goal(self, k: int, cells: Array) -> Array:
        times = np.full(len(cells), k * self.scene.delta)
        inside = tips_inside(self.scene, self.sets.bounds(cells), times)
        still = np.zeros(len(cells), np.int64)
        return inside & self._clear(cells, still, times, 0.0, self.clearance.bodies)

    def _step(self, k: int, n: int, cells: Array) -> Array:
        """Whether some input works for each cell."""
        proved = np.zeros(len(cells), np.bool_)
        for j in range(len(self.inputs)):
            able = ~proved & self.sets.allowed[k, j, cells[:, 0], cells[:, 1]]
            able[able] = self._reaches(k, n, j, cells[able])
            if able.any():
                starts = np.full(int(able.sum()), k * self.scene.delta)
                which = np.full(starts.size, j)
                proved[able] = self._clear(cells[able], which, starts, self.scene.delta, self.clearance.bodies)
        return proved

    def _reaches(self, k: int, n: int, j: int, cells: Array) -> Array:
        """Whether everything that can be reached under input j is in S_{k+1}^{n-1}."""
        tables = [self._table(axis, j) for axis in range(4)]
        out = np.ones(len(cells), np.bool_)
        parts = [tables[axis][cells[:, axis]] for axis in range(4)]
        for a in range(parts[0].shape[1]):
            for b in range(parts[1].shape[1]):
                for c in range(parts[2].shape[1]):
                    for d in range(parts[3].shape[1]):
                        at = np.stack([parts[0][:, a], parts[1][:, b], parts[2][:, c], parts[3][:, d]], axis=1)
                        out[out] &= self.sets.has(k + 1, n - 1, at[out])
        return out

    def _table(self, axis: int, j: int) -> Array:
        """Cells that each cell of an axis may end in, (n, most), repeated to one length."""
        push = decimal(self.scene.speeds[1] if axis < 2 else self.scene.speeds[2])
        drift = self.inputs[j][axis] if axis < 2 else Fraction(0)
        key = (axis, drift)
        if key not in self._tables:
            lists = overlapped(axis, self.sets, drift - push, drift + push)
            most = max(len(found) for found in lists)
            self._tables[key] = np.array([found + found[-1:] * (most - len(found)) for found in lists])
        return self._tables[key]

    @property
    def _tables(self) -> dict[tuple[int, Fraction], Array]:
        return self.__dict__.setdefault("_table_cache", {})


def claim(name: str, made: int, checked: int, failures: Sequence[str]) -> Claim:
    return Claim(name, made, checked, tuple(failures[:SHOWN]), len(failures))
