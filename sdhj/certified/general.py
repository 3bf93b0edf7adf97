"""Certified sets of any problem, by bounds that its author states.

Reach boxes come from a growth bound. Let |x(t0) - c| <= h hold on every axis, let every component of the velocity
f(x, u_j) + g(x) v change with the state by at most A |x - y| (A a matrix of non-negative numbers, the same for every
input and every |v| <= bounds), and let |g(c) v| <= w. Over a time T the state moves away from c by at most r with

    r = h + T (|f(c, u_j)| + w + A r),

so its velocity is within A r + w of f(c, u_j) throughout, and the box moves with it. The interval is cut into parts so
that A r stays small. Nothing is integrated and no step is approximate. Walls only hold the state back: a box is cut
at them.
"""

import itertools
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import h5py
import numpy as np
from tqdm import tqdm

from sdhj.certified.arm import pack, velocity_bounds
from sdhj.certified.cells import CellAxis, measured
from sdhj.certified.kernels import SLACK, Cells, cells_at, covered, pick, row_and_bit
from sdhj.compiling import hidden
from sdhj.grid import FloatArray
from sdhj.memory import require
from sdhj.problem import ReachAvoidProblem, TargetSet, UnsafeSet
from sdhj.table import entry

SEAM = 1e-6  # a larger difference across the seam of a periodic axis, relative to the values, is a jump
PAIRS = 2000  # of states, by which the bounds along an axis are tried
ROUNDING = 1e-9  # what is granted to the rounding of a user's function, relative to its value or absolute below one


@dataclass(frozen=True)
class LipschitzBounds:
    """How fast a problem's functions can change with the state.

    Parameters
    ----------
    dynamics : (ndim, ndim) array, optional
        dynamics[i, k] >= |d/dx_k (drift_i + sum_d gain_id v_d)| everywhere, for every input and |v_d| <= bounds_d. Not
        needed (zero) where the dynamics do not depend on the state.
    sets : mapping from the name of a set to a sequence of float
        For the target and each unsafe set: a bound on |d(level set)/dx| for each of its axes.
    """

    dynamics: FloatArray | None = None
    sets: Mapping[str, Sequence[float]] = field(default_factory=dict)

    def matrix(self, problem: ReachAvoidProblem) -> FloatArray:
        """`dynamics`, checked, (ndim, ndim)."""
        ndim = problem.grid.ndim
        if self.dynamics is None:
            if problem.dynamics.constant:
                return np.zeros((ndim, ndim))
            raise ValueError(
                f"the dynamics of {problem.name!r} depend on the state: give LipschitzBounds(dynamics=...), how fast"
            )
        matrix = np.asarray(self.dynamics, dtype=np.float64)
        if matrix.shape != (ndim, ndim) or not np.isfinite(matrix).all() or (matrix < 0).any():
            raise ValueError(f"dynamics of LipschitzBounds must be a ({ndim}, {ndim}) matrix of finite numbers >= 0")
        return matrix

    def check_names(self, names: Sequence[str]) -> None:
        """Raise ValueError where a set has no bounds, or bounds no set."""
        if missing := [name for name in names if name not in self.sets]:
            raise ValueError(
                f"no Lipschitz bounds for the sets {', '.join(map(repr, missing))}: give bounds=LipschitzBounds(sets="
                "{name: [a bound on |d(level set)/dx| for each axis of the set]}), from sdhj.certified.sets"
            )
        if unknown := sorted(set(self.sets) - set(names)):
            raise ValueError(
                f"Lipschitz bounds for {', '.join(map(repr, unknown))}, but the problem's sets are "
                f"{', '.join(map(repr, names))}"
            )

    def of(self, name: str, axes: Sequence[int]) -> FloatArray:
        """The bounds of one set, checked, (len(axes),)."""
        bounds = np.asarray(self.sets[name], dtype=np.float64)
        if bounds.shape != (len(axes),) or not np.isfinite(bounds).all() or (bounds < 0).any():
            raise ValueError(f"the bounds of the set {name!r} must be {len(axes)} finite numbers >= 0, got {bounds}")
        return bounds


@dataclass(frozen=True)
class Boxes:
    """Boxes with centres and half-widths, each (M, ndim), over a time [begin, end] of the interval."""

    centre: FloatArray
    half: FloatArray
    begin: float
    end: float


class Reach:
    """What can be reached from boxes within one interval: the boxes of each part, and the last one."""

    def __init__(self, problem: ReachAvoidProblem, matrix: FloatArray, parts: int) -> None:
        self.problem, self.matrix, self.parts = problem, matrix, parts
        self.time = problem.delta / parts
        system = np.eye(len(matrix)) - self.time * matrix
        if (self.time * matrix).sum(axis=1).max() > 0.5:  # the inverse is non-negative below 1
            raise ValueError("the dynamics change too fast for this interval: use more parts")
        self.inverse = np.linalg.inv(system)
        self.walls = [axis for axis, periodic in enumerate(problem.grid.periodic) if not periodic]

    def run(self, low: FloatArray, high: FloatArray, j: int) -> tuple[list[Boxes], FloatArray, FloatArray]:
        """Tube (a `Boxes` for each part) and image (low, high) of boxes low..high (M, ndim) under input j."""
        tube = []
        for part in range(self.parts):
            slow, fast = self._velocities((low + high) / 2, (high - low) / 2, j)
            after_low, after_high = self._held(low + self.time * slow), self._held(high + self.time * fast)
            least, most = np.minimum(low, after_low), np.maximum(high, after_high)
            tube.append(Boxes((least + most) / 2, (most - least) / 2, part * self.time, (part + 1) * self.time))
            low, high = after_low, after_high
        return tube, low, high

    def _velocities(self, centre: FloatArray, half: FloatArray, j: int) -> tuple[FloatArray, FloatArray]:
        """Bounds on the velocity over one part from boxes, each (M, ndim)."""
        dynamics = self.problem.dynamics
        inside = self.problem.grid.wrapped(centre)
        drift = dynamics.drift_at(inside, j)
        push = np.abs(dynamics.gain_at(inside)) @ dynamics.bounds
        push = push + ROUNDING * (1.0 + np.abs(drift) + push)
        away = (half + self.time * (np.abs(drift) + push)) @ self.inverse.T * (1 + ROUNDING)
        slack = away @ self.matrix.T + push
        return drift - slack, drift + slack

    def _held(self, points: FloatArray) -> FloatArray:
        """Points cut at the walls of bounded axes."""
        grid = self.problem.grid
        for axis in self.walls:
            points[:, axis] = np.clip(points[:, axis], grid.lower[axis], grid.upper[axis])
        return points

    def least(self, part: Any, boxes: Boxes, bounds: FloatArray, begin: float, rate: float) -> FloatArray:
        """Lower bound of a level-set function over boxes and their times, (M,)."""
        axes = list(part.axes)
        middle = begin + (boxes.begin + boxes.end) / 2
        value = np.asarray(part.level_set(self.problem.grid.wrapped(boxes.centre)[:, axes], middle), dtype=np.float64)
        return (
            value
            - boxes.half[:, axes] @ bounds
            - rate * (boxes.end - boxes.begin) / 2
            - ROUNDING * (1.0 + np.abs(value))
        )


@dataclass(frozen=True)
class GeneralProof:
    """Which inputs are certified in which cells, for a problem without special geometry.

    Attributes
    ----------
    masks : (entries, bytes, cells) uint8
        Bit j % 8 of byte j // 8: the input u_j is certified for the cell.
    rows : int
        Leading axes that number the blocks of the packed sets: all but the last.
    matrix, sets : the checked `LipschitzBounds`
    parts : int
        Parts of the interval.
    count : int
        L, how many inputs there are.
    """

    masks: FloatArray
    rows: int
    matrix: FloatArray
    sets: Mapping[str, FloatArray]
    parts: int
    count: int
    kind = "general"

    @classmethod
    def prepare(
        cls, problem: ReachAvoidProblem, axes: Sequence[CellAxis], bounds: LipschitzBounds | None, parts: int
    ) -> "GeneralProof":
        """Check the bounds and make room."""
        bounds = LipschitzBounds() if bounds is None else bounds
        known = _sets(problem)
        names = [part.name for part in known]
        if len(set(names)) < len(names):
            raise ValueError(f"two of the sets have one name, by which bounds are told; rename one of {names}")
        bounds.check_names(names)
        sets = {part.name: bounds.of(part.name, part.axes) for part in known}
        matrix = bounds.matrix(problem)
        _check_seams(problem, parts)
        _check_bounds(problem, matrix, sets)
        entries = entry(problem.steps, problem.steps, 0) + 1
        size, count = math.prod(axis.count for axis in axes), len(problem.inputs)
        # masks, where each input is clear, images, and the tube of one input
        each = entries * -(-count // 8) + problem.steps * count + 16 * len(axes) * (count + parts + 2)
        require(size * each, f"certifying {size:.1e} cells", "use fewer cells")
        masks = np.zeros((entries, -(-count // 8), size), np.uint8)
        return cls(masks, len(axes) - 1, matrix, sets, parts, len(problem.inputs))

    def recursion(
        self, problem: ReachAvoidProblem, axes: Sequence[CellAxis], progress: bool | None
    ) -> tuple[FloatArray, FloatArray]:
        """Index and pool of all S_k^n; fills `masks`."""
        return GeneralRecursion(problem, axes, self).run(progress)

    def inputs_of(
        self,
        state: FloatArray,
        step: int,
        cells: Cells,
        index: FloatArray,
        place: int,
        following: int,
        pool: FloatArray,
    ) -> FloatArray:
        """Which inputs are certified for one state (ndim,), bool (L,)."""
        return self.inputs_of_many(state[None], step, cells, index, place, following, pool)[0]

    def inputs_of_many(
        self,
        states: FloatArray,
        step: int,
        cells: Cells,
        index: FloatArray,
        place: int,
        following: int,
        pool: FloatArray,
    ) -> FloatArray:
        """Which inputs are certified for states (M, ndim), bool (M, L)."""
        masks = self.masks[place]
        found, cell = np.empty((2, states.shape[1]), np.int64), np.empty(states.shape[1], np.int64)
        out = np.zeros((len(states), masks.shape[0]), np.uint8)
        for m, state in enumerate(states):
            if cells_at(state, cells, found):
                for choice in range(1 << cell.size):
                    if pick(found, choice, cell):
                        row, bit = row_and_bit(cell, cells)
                        out[m] |= masks[:, row * cells.counts[-1] + bit]
        return np.unpackbits(out, axis=1, count=self.count, bitorder="little").view(np.bool_)

    def save(self, group: h5py.Group) -> None:
        """Write the inputs and the bounds that they rest on."""
        group.attrs["parts"] = self.parts
        group["matrix"] = self.matrix
        # a name may be anything, also what is a path to HDF5
        group.attrs["sets"] = json.dumps({name: bounds.tolist() for name, bounds in self.sets.items()})
        group.create_dataset("masks", data=self.masks, compression="gzip", shuffle=True)

    @classmethod
    def load(cls, group: h5py.Group, problem: ReachAvoidProblem, axes: Sequence[CellAxis]) -> "GeneralProof":
        """Read what `save` wrote."""
        sets = {name: np.array(bounds) for name, bounds in json.loads(group.attrs["sets"]).items()}
        count = len(problem.inputs)
        return cls(group["masks"][()], len(axes) - 1, group["matrix"][()], sets, int(group.attrs["parts"]), count)


class GeneralRecursion:
    """Theorem 2 on cells of any shape, one bool for each."""

    def __init__(self, problem: ReachAvoidProblem, axes: Sequence[CellAxis], proof: GeneralProof) -> None:
        self.problem, self.axes, self.proof = problem, tuple(axes), proof
        self.shape = np.array([axis.count for axis in axes], dtype=np.int64)
        edges = [axis.edges() for axis in axes]
        self.low, self.high = (mesh([own[side : own.size - 1 + side] for own in edges]) for side in (0, 1))
        self.reach = Reach(problem, proof.matrix, proof.parts)

    def run(self, progress: bool | None) -> tuple[FloatArray, FloatArray]:
        """Index and pool of all sets."""
        steps, count = self.problem.steps, len(self.problem.inputs)
        index, chunks = [], [np.zeros((1, -(-int(self.shape[-1]) // 64)), np.uint64)]
        sets: list[FloatArray] = []
        with tqdm(total=count + steps * (steps + 1) // 2, desc="certified", disable=hidden(progress)) as bar:
            images, clear = self._intervals(bar)
            for step in range(steps, -1, -1):
                row = [self.goal(step)]
                for within in range(1, steps - step + 1):
                    row.append(self._add_step(row[-1], sets[within - 1], step, within, images, clear))
                    bar.update()
                sets = row
                blocks, places = packed(row, self.shape, sum(len(chunk) for chunk in chunks))
                chunks.append(blocks)
                index.append(places)
        return np.concatenate(index[::-1]), np.concatenate(chunks)

    def _intervals(self, bar: Any) -> tuple[list[tuple[FloatArray, FloatArray]], FloatArray]:
        """For each input the cells that cover each image, and where the tube is clear: (steps, L, cells)."""
        problem = self.problem
        clear = np.ones((problem.steps, len(problem.inputs), len(self.low)), np.bool_)
        images = []
        for j in range(len(problem.inputs)):
            tube, low, high = self.reach.run(self.low - SLACK, self.high + SLACK, j)
            images.append(self._cover(low, high, j))
            for step in range(problem.steps):
                for boxes in tube:
                    clear[step, j] &= self._clear(boxes, problem.time(step))
            bar.update()
        return images, clear

    def _clear(self, boxes: Boxes, begin: float) -> FloatArray:
        """Whether boxes are outside every unsafe set at all their times, (M,)."""
        out = np.ones(len(boxes.centre), np.bool_)
        for part in self.problem.unsafe:
            out &= self.reach.least(part, boxes, self.proof.sets[part.name], begin, part.rate) > 0.0
        return out

    def _cover(self, low: FloatArray, high: FloatArray, j: int) -> tuple[FloatArray, FloatArray]:
        """First cell and number of cells that cover each image, on each axis: two (ndim, cells) int64 arrays."""
        first, number = np.empty((2, len(self.axes), len(low)), np.int64)
        for axis, cells in enumerate(self.axes):
            if self.problem.dynamics.constant:  # exactly
                tables = cells.image(*velocity_bounds(self.problem, axis, j), measured(self.problem.delta))
                own = np.indices(tuple(int(n) for n in self.shape))[axis].ravel()
                first[axis], number[axis] = tables[0][own], tables[1][own]
            else:
                begin, end = cover(low[:, axis], high[:, axis], cells)
                first[axis], number[axis] = begin % cells.count, np.minimum(end - begin, cells.count)
        return first, number

    def _add_step(
        self,
        before: FloatArray,
        following: FloatArray,
        step: int,
        within: int,
        images: Sequence[Any],
        clear: FloatArray,
    ) -> FloatArray:
        """S_k^n from S_k^{n-1} and S_{k+1}^{n-1}, each (cells,) bool; sets the masks."""
        out, reached = before.copy(), np.empty_like(before)
        masks = self.proof.masks[entry(self.problem.steps, step, within)]
        for j, (first, number) in enumerate(images):
            covered(following, first, number, self.shape, clear[step, j], reached)
            masks[j // 8] |= reached.astype(np.uint8) << np.uint8(j % 8)
            out |= reached
        return out

    def goal(self, step: int) -> FloatArray:
        """S_k^0: cells inside the target and outside the unsafe set at t_k, (cells,) bool."""
        problem, t = self.problem, self.problem.time(step)
        half = (self.high - self.low) / 2 + SLACK
        boxes = Boxes((self.low + self.high) / 2, half, 0.0, 0.0)
        axes = list(problem.target.axes)
        value = np.asarray(problem.target.level_set(boxes.centre[:, axes], t), dtype=np.float64)
        most = value + half[:, axes] @ self.proof.sets[problem.target.name] + ROUNDING * (1.0 + np.abs(value))
        return (most <= 0.0) & self._clear(boxes, t)


def _check_seams(problem: ReachAvoidProblem, parts: int) -> None:
    """Refuse functions that jump where a periodic axis closes, at any node: no Lipschitz bound holds across a jump.

    Boxes of tubes reach across that seam; cells of the goal do not, so the target may jump there. A moving set may jump
    at some times only: it is tried at the middles of all parts, where it is evaluated, and between them.
    """
    times = np.arange(2 * parts * problem.steps + 1) * problem.delta / (2 * parts)
    grid, dynamics = problem.grid, problem.dynamics
    for axis in np.flatnonzero(grid.periodic):
        points = grid.points()[np.indices(grid.shape)[axis].ravel() == 0]
        other = points.copy()
        other[:, axis] = grid.upper[axis] - 1e-9 * (grid.upper[axis] - grid.lower[axis])
        functions: dict[str, Callable[[FloatArray], FloatArray]] = {}
        for part in problem.unsafe:
            for t in times if part.moving else times[:1]:
                told = f"level set of {part.name!r} at t = {t:g}"
                functions[told] = partial(problem.value_of, part, t=float(t))
        for j in range(len(problem.inputs)) if not dynamics.constant else ():
            functions[f"drift under input {j}"] = partial(problem.drift_at, j=j)
        if not dynamics.constant:
            functions["gain"] = problem.gain_at
        for name, function in functions.items():
            here, there = (np.asarray(function(q), dtype=np.float64) for q in (points, other))
            if (jump := float(np.abs(here - there).max(initial=0.0))) > SEAM * (1.0 + float(np.abs(here).max())):
                raise ValueError(
                    f"{name} jumps by {jump:.3g} where the periodic axis {grid.names[axis]!r} closes, so no Lipschitz "
                    f"bound holds there; make it periodic, for example in the sine and cosine of the coordinate"
                )


def _sets(problem: ReachAvoidProblem) -> list[TargetSet | UnsafeSet]:
    return [problem.target, *problem.unsafe]


def _check_bounds(problem: ReachAvoidProblem, matrix: FloatArray, sets: Mapping[str, FloatArray]) -> None:
    """Refuse bounds that differences between a few thousand pairs of states refute; it proves nothing of the others."""
    grid, dynamics = problem.grid, problem.dynamics
    low, spacing = np.array(grid.lower), np.array(grid.spacing)
    rng, span = np.random.default_rng(0), problem.steps * problem.delta
    for axis, share in itertools.product(range(grid.ndim), (0.5, 0.02)):
        step = share * spacing[axis]
        room = np.array(grid.upper) - low
        room[axis] -= step  # seams are looked at elsewhere, and the target may jump there
        points = low + rng.random((PAIRS, grid.ndim)) * room
        beside = points.copy()
        beside[:, axis] += step
        told = f"over {step:.3g} along the axis {grid.names[axis]!r}"
        for part in _sets(problem):
            bound = float(sets[part.name][part.axes.index(axis)]) if axis in part.axes else 0.0
            for t in (0.0, 0.37 * span, span):
                here, there = (np.asarray(problem.value_of(part, q, t)) for q in (points, beside))
                _refute(f"the level-set function of {part.name!r}", np.abs(there - here), here, bound, step, told)
        for j in range(0 if dynamics.constant else len(problem.inputs)):
            here, there = (problem.drift_at(q, j) for q in (points, beside))
            push = np.abs(problem.gain_at(beside) - problem.gain_at(points)) @ dynamics.bounds
            for row in range(grid.ndim):
                change = np.abs(there - here)[:, row] + push[:, row]
                name = f"the velocity along {grid.names[row]!r} under input {j}"
                _refute(name, change, here[:, row], matrix[row, axis], step, told)


def _refute(name: str, change: FloatArray, values: FloatArray, bound: float, step: float, told: str) -> None:
    worst = int(np.argmax(change))
    if change[worst] > bound * step * (1 + ROUNDING) + ROUNDING * (1.0 + abs(values[worst])):
        raise ValueError(
            f"{name} changes by {change[worst]:.3g} {told}, and its Lipschitz bound {bound:g} allows "
            f"{bound * step:.3g}; give a bound of at least {change[worst] / step:.3g}"
        )


def mesh(coordinates: Sequence[FloatArray]) -> FloatArray:
    """All combinations of the axes' coordinates, the last axis fastest, (M, ndim)."""
    return np.stack([grid.ravel() for grid in np.meshgrid(*coordinates, indexing="ij")], axis=1)


def cover(low: FloatArray, high: FloatArray, axis: CellAxis) -> tuple[FloatArray, FloatArray]:
    """First cell and last cell + 1 that hold [low, high] with room for rounding, counted on over laps; int64 each."""
    width, length, count = float(axis.width), float(sum(axis.extent) / 2), axis.count
    low, high = low - float(axis.lower) - ROUNDING, high - float(axis.lower) + ROUNDING
    if not axis.periodic:
        begin = np.clip(np.floor(low / width), 0, count - 1)
        return begin.astype(np.int64), np.clip(np.ceil(high / width), begin + 1, count).astype(np.int64)
    laps = np.floor(low / length), np.floor(high / length)
    begin = laps[0] * count + np.minimum(np.floor((low - laps[0] * length) / width), count - 1)
    end = laps[1] * count + np.minimum(np.ceil((high - laps[1] * length) / width), count)
    return begin.astype(np.int64), np.maximum(end, begin + 1).astype(np.int64)


def packed(row: Sequence[FloatArray], shape: FloatArray, used: int) -> tuple[FloatArray, FloatArray]:
    """Sets (cells,) bool as blocks of the last axis, and which block each row of each set is; `used` blocks exist."""
    bits = np.stack(row).reshape(len(row), -1, int(shape[-1]))
    padded = np.zeros((*bits.shape[:2], -(-bits.shape[2] // 64) * 64), np.bool_)
    padded[..., : bits.shape[2]] = bits
    some = bits.any(axis=2)
    places = np.zeros(some.shape, np.uint32)
    places[some] = used + np.arange(some.sum())
    return pack(padded)[some], places
