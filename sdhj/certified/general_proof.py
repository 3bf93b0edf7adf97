"""What one interval does to the cells of any problem, by bounds that its author states.

Reach boxes come from a growth bound. Let |x(t0) - c| <= h hold on every axis, and let F(x, t) = f(x, u_j, t) +
g(x, u_j, t) v, v any share of the adversary's box, change with the state by at most A |x - y| and with time by at most
B |t - s| (A a matrix and B a row of non-negative numbers, the same for every input and share). Let |g v| <= w hold at c
and at s, the middle of a time of length T. Over that time the state moves away from c by at most r with

    r = h + T (|f(c, u_j, s)| + w + B T / 2 + A r),

so its velocity is within A r + w + B T / 2 of f(c, u_j, s) throughout, and the box moves with it. The interval is cut
into parts so that A r stays small. Nothing is integrated and no step is approximate. Walls only hold the state back: a
box is cut at them. What has left over a safe end is out of danger for good, so there too a box is cut, and what is left
of it are the states of which something is still to be proved.
"""

import itertools
import math
import reprlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, NamedTuple

import h5py
import numpy as np
from tqdm import tqdm

from sdhj.certified.cells import MOST_PIECES, CellAxis, measured, velocity_bounds
from sdhj.certified.packed import STATE_SLACK, TOUCHING, cell_masks, covered, to_bits, to_words
from sdhj.checks import real_array, whole
from sdhj.compiling import hidden
from sdhj.files import stored
from sdhj.grid import ENDS, FloatArray
from sdhj.memory import require
from sdhj.problem import ReachAvoidProblem, TargetSet, UnsafeSet
from sdhj.table import entry

if TYPE_CHECKING:
    from sdhj.certified.table import CertifiedTable

SEAM = 1e-6  # a larger difference across the seam of a periodic axis, relative to the values, is a jump
PAIRS = 2000  # of states, by which the bounds along an axis are tried
ALLOWANCE = 1e-9  # for the rounding of a user's function, relative to its value or absolute below one


@dataclass(frozen=True)
class LipschitzBounds:
    """How fast a problem's functions can change with the state, and the dynamics with time.

    Parameters
    ----------
    dynamics : (ndim, ndim) array, optional
        dynamics[i, k] >= |d/dx_k (drift_i + sum_d gain_id v_d)| everywhere, for every input and |v_d| <= bounds_d. Not
        needed (zero) where the dynamics do not depend on the state.
    sets : mapping from the name of a set to a sequence of float
        For the target and each unsafe set: a bound on |d(level set)/dx| for each of its axes.
    time : (ndim,) array, optional
        time[i] >= |d/dt (drift_i + sum_d gain_id r_d bounds_d)| everywhere, for every input and |r_d| <= 1: a bound on
        |d velocity/dt| for each axis. Not needed (zero) where the dynamics do not depend on time.
    """

    dynamics: FloatArray | None = None
    sets: Mapping[str, Sequence[float]] = field(default_factory=dict)
    time: FloatArray | None = None

    def checked(self, problem: ReachAvoidProblem) -> tuple[FloatArray, FloatArray, dict[str, FloatArray]]:
        """`dynamics` (ndim, ndim), `time` (ndim,) and `sets` by name; ValueError where they do not fit the problem."""
        ndim, names = problem.grid.ndim, [part.name for part in known_sets(problem)]
        given_sets: object = self.sets
        if not isinstance(given_sets, Mapping):
            told = reprlib.repr(given_sets)
            raise ValueError(f"sets of LipschitzBounds must be a mapping from the names of sets to bounds, got {told}")
        if len(set(names)) < len(names):
            raise ValueError(f"two of the sets have one name, by which bounds are told; rename one of {names}")
        if missing := [name for name in names if name not in self.sets]:
            raise ValueError(
                f"no Lipschitz bounds for the sets {', '.join(map(repr, missing))}: give bounds=LipschitzBounds(sets="
                "{name: [a bound on |d(level set)/dx| for each axis of the set]}), from sdhj.certified"
            )
        if unknown := sorted(map(repr, set(self.sets) - set(names))):
            raise ValueError(
                f"Lipschitz bounds for {', '.join(unknown)}, but the problem's sets are {', '.join(map(repr, names))}"
            )
        given = (("dynamics", "the state", not problem.dynamics.stateless), ("time", "time", problem.dynamics.timed))
        for name, what, needed in given:
            if needed and getattr(self, name) is None:
                told = f"the dynamics of {problem.name!r} depend on {what}: give LipschitzBounds({name}=...), how fast"
                raise ValueError(told)
        matrix = _bounds("dynamics of LipschitzBounds", self.dynamics, (ndim, ndim))
        axes = {part.name: (len(part.axes),) for part in known_sets(problem)}
        sets = {name: _bounds(f"the bounds of the set {name!r}", self.sets[name], axes[name]) for name in names}
        return matrix, _bounds("time of LipschitzBounds", self.time, (ndim,)), sets


def _bounds(name: str, given: Any, shape: tuple[int, ...]) -> FloatArray:
    bounds = np.zeros(shape) if given is None else real_array(name, given)
    if bounds.shape != shape or not np.isfinite(bounds).all() or (bounds < 0).any():
        raise ValueError(f"{name} must be {' x '.join(map(str, shape))} finite numbers >= 0, got {bounds.tolist()}")
    return bounds


def known_sets(problem: ReachAvoidProblem) -> list[TargetSet | UnsafeSet]:
    """The target, if there is one, and the unsafe sets."""
    return [*([] if problem.stays else [problem.target]), *problem.unsafe]


def velocity_terms(
    problem: ReachAvoidProblem, points: FloatArray, j: int, t: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Drift (M, ndim), gain (M, ndim, D) and the adversary's bounds (D,) at points (M, ndim) under u_j at a time."""
    dynamics, points = problem.dynamics, problem.grid.wrapped(points)
    return dynamics.drift_at(points, j, t), dynamics.gain_at(points, j, t), dynamics.bounds_at(j, t)


@dataclass(frozen=True)
class Boxes:
    """Boxes with centres and half-widths, each (M, ndim), over a time [begin, end] of the interval.

    `left` (M,) bool tells those that had left over a safe end before.
    """

    centre: FloatArray
    half: FloatArray
    begin: float
    end: float
    left: Any = False

    def values(self, problem: ReachAvoidProblem, part: Any, bounds: FloatArray, start: float) -> list[FloatArray]:
        """Bounds of a level-set function over the boxes and their times, in the interval from `start`: two (M,)."""
        centre, middle = problem.grid.held(self.centre, *ENDS), start + (self.begin + self.end) / 2
        value = problem.value_of(part, centre, middle)
        change, rounding = self.half[:, list(part.axes)] @ bounds, ALLOWANCE * (1.0 + np.abs(value))
        moved = part.rate * (self.end - self.begin) / 2 if self.end > self.begin else 0.0
        return [value - change - moved - rounding, value + change + moved + rounding]


@dataclass(frozen=True)
class GeneralProof:
    """What one interval does to the cells, for the recursion and for questions about states.

    Attributes
    ----------
    problem : ReachAvoidProblem
    axes : tuple of CellAxis
    parts : int
        Parts of the interval.
    matrix, drifting, sets : what `LipschitzBounds.checked` returns
    masks : (entries, bytes, cells) uint8
        Bit j % 8 of byte j // 8: the input u_j is certified for the cell. Filled by the recursion.
    """

    problem: ReachAvoidProblem
    axes: tuple[CellAxis, ...]
    parts: int
    matrix: FloatArray
    drifting: FloatArray
    sets: Mapping[str, FloatArray]
    masks: FloatArray
    kind = "general"

    @classmethod
    def of(
        cls, problem: ReachAvoidProblem, axes: tuple[CellAxis, ...], parts: int, bounds: LipschitzBounds
    ) -> "GeneralProof":
        """Check the bounds and make room."""
        (matrix, drifting, sets), count = bounds.checked(problem), len(problem.inputs)
        if (problem.delta / parts * matrix).sum(
            axis=1
        ).max() > 0.5:  # what `inverse` inverts is far from singular below
            raise ValueError("the dynamics change too fast for this interval: use more parts")
        entries, size = entry(problem.steps, problem.steps, 0) + 1, math.prod(axis.count for axis in axes)
        images = count * (problem.steps if problem.dynamics.timed else 1)
        # masks, where each input is clear, images, and the tube of one input
        each = entries * -(-count // 8) + problem.steps * count + 16 * len(axes) * (images + parts + 2)
        require(size * each, f"certifying {size:.1e} cells", "use fewer cells")
        masks = np.zeros((entries, -(-count // 8), size), np.uint8)
        proof = cls(problem, axes, parts, matrix, drifting, sets, masks)
        check_bounds(proof)
        return proof

    @property
    def rows(self) -> int:
        """Leading axes that number the blocks of the packed sets: all but the last."""
        return len(self.axes) - 1

    @property
    def nbytes(self) -> int:
        """Bytes that the masks take in memory."""
        return int(self.masks.nbytes)

    def inputs(self, table: "CertifiedTable", states: FloatArray, step: int, places: tuple[int, int]) -> FloatArray:
        """Which inputs are certified for states (M, ndim), bool (M, L); places of S_k^n and S_{k+1}^{n-1}."""
        out = np.empty((len(states), self.masks.shape[1]), np.uint8)
        cell_masks(states, table.cells, self.masks[places[0]], out)
        return np.unpackbits(out, axis=1, count=len(self.problem.inputs), bitorder="little").view(np.bool_)

    def hazards(self, table: "CertifiedTable", states: FloatArray, step: int) -> FloatArray:
        """Minus what is proved of the clearance on the way of every input from states (M, ndim): (M, L), < 0 if clear.

        By the tube of the state itself, as `prepare` asks of its cell.
        """
        start, shape = self.problem.time(step), (len(self.problem.inputs), len(states))
        clear, out = np.ones(shape, np.bool_), np.full(shape, -np.inf)
        for j in range(len(clear)):
            for boxes in self.reached(states - STATE_SLACK, states + STATE_SLACK, j, start)[0]:
                clear[j] &= self._clear(boxes, start)
                for part in self.problem.unsafe:
                    least, _ = boxes.values(self.problem, part, self.sets[part.name], start)
                    np.maximum(out[j], -least, out=out[j])
        return np.where(clear, np.minimum(out, -TOUCHING), np.maximum(out, TOUCHING)).T

    @property
    def told(self) -> dict[str, Any]:
        """What a file tells of it: the bounds that the inputs rest on."""
        sets = {name: bounds.tolist() for name, bounds in self.sets.items()}
        matrix, time = self.matrix.tolist(), self.drifting.tolist()
        return {"parts": self.parts, "dynamics": matrix, "time": time, "sets": sets}

    def save(self, file: h5py.File) -> None:
        """Write the inputs."""
        file.create_dataset("masks", data=self.masks, compression="gzip", shuffle=True)

    @classmethod
    def load(
        cls, told: Mapping[str, Any], file: h5py.File, problem: ReachAvoidProblem, axes: tuple[CellAxis, ...]
    ) -> "GeneralProof":
        """Read what `save` wrote and `told` tells; ValueError where it does not fit the problem."""
        matrix, drifting, sets = LipschitzBounds(told["dynamics"], told["sets"], told["time"]).checked(problem)
        size, entries = math.prod(axis.count for axis in axes), entry(problem.steps, problem.steps, 0) + 1
        masks = stored(file, "masks", "uint8", (entries, -(-len(problem.inputs) // 8), size))
        parts = whole("parts", told["parts"], least=1, most=MOST_PIECES)
        return cls(problem, axes, parts, matrix, drifting, sets, masks)

    # ---- the recursion; sets are (rows, W) uint64

    @cached_property
    def ends(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper ends of all cells, the last axis fastest, each (cells, ndim)."""
        edges = [axis.edges() for axis in self.axes]
        low, high = (np.meshgrid(*(own[side : own.size - 1 + side] for own in edges), indexing="ij") for side in (0, 1))
        return np.stack([own.ravel() for own in low], axis=1), np.stack([own.ravel() for own in high], axis=1)

    @cached_property
    def inverse(self) -> FloatArray:
        """Of 1 - T A, T the time of a part: non-negative."""
        return np.linalg.inv(np.eye(len(self.matrix)) - self.problem.delta / self.parts * self.matrix)

    def reached(
        self, low: FloatArray, high: FloatArray, j: int, start: float
    ) -> tuple[list[Boxes], FloatArray, FloatArray]:
        """Tube (`Boxes` for each part) and image of boxes low..high (M, ndim) under u_j from `start` on.

        Of what has all left over a safe end the image is empty: its lower end is above the upper one.
        """
        tube, held, time = [], self.problem.grid.held, self.problem.delta / self.parts
        safe, left = self.problem.grid.faces("safe"), np.zeros(len(low), np.bool_)
        for part in range(self.parts):
            centre, half = (low + high) / 2, (high - low) / 2
            # past an unsafe end, where nothing is certified, the user's functions are not asked
            within = self.problem.grid.held(centre, *ENDS)
            drift, gain, bounds = velocity_terms(self.problem, within, j, start + (part + 0.5) * time)
            push = np.abs(gain) @ bounds + self.drifting * (time / 2)
            push = push + ALLOWANCE * (1.0 + np.abs(drift) + push)
            away = (half + time * (np.abs(drift) + push)) @ self.inverse.T * (1 + ALLOWANCE)
            slack = away @ self.matrix.T + push
            after = held(low + time * (drift - slack)), held(high + time * (drift + slack))
            least, most = held(np.minimum(low, after[0]), "safe"), held(np.maximum(high, after[1]), "safe")
            tube.append(Boxes((least + most) / 2, (most - least) / 2, part * time, (part + 1) * time, left))
            left = left | ((after[0] > safe[1]) | (after[1] < safe[0])).any(axis=1)
            low, high = held(after[0], "safe"), held(after[1], "safe")
        return tube, low, np.where(left[:, None], low - 1.0, high)

    def prepare(self, progress: bool | None) -> tuple[dict[tuple[int, int], Any], FloatArray]:
        """For each start and input the cells that cover each image; where tubes are clear, bool (steps, L, cells)."""
        problem, (low, high), images = self.problem, self.ends, {}
        clear = np.ones((problem.steps, len(problem.inputs), len(low)), np.bool_)
        starts, timed = range(problem.steps if problem.dynamics.timed else 1), problem.dynamics.timed
        pairs = list(itertools.product(starts, range(len(problem.inputs))))
        for start, j in tqdm(pairs, desc="intervals", disable=hidden(progress)):
            tube, first, last = self.reached(low - STATE_SLACK, high + STATE_SLACK, j, problem.time(start))
            images[start, j] = self._cover(first, last, j)
            for step, boxes in itertools.product([start] if timed else range(problem.steps), tube):
                clear[step, j] &= self._clear(boxes, problem.time(step))
        return images, clear

    def _clear(self, boxes: Boxes, start: float) -> FloatArray:
        """Whether boxes are outside every unsafe set and between the unsafe ends at all their times, (M,)."""
        out, beyond = np.ones(len(boxes.centre), np.bool_), self.problem.grid.beyond
        for corner in (boxes.centre - boxes.half, boxes.centre + boxes.half):
            out &= ~beyond(corner, "unsafe")
        for part in self.problem.unsafe:
            out &= boxes.values(self.problem, part, self.sets[part.name], start)[0] > 0.0
        return out | boxes.left

    def _cover(self, low: FloatArray, high: FloatArray, j: int) -> tuple[FloatArray, FloatArray]:
        """First cell and number of cells that cover each image, on each axis: two (ndim, cells) int64 arrays."""
        first, number = np.empty((2, len(self.axes), len(low)), np.int64)
        own, delta = np.indices([axis.count for axis in self.axes]), measured(self.problem.delta)
        for axis, cells in enumerate(self.axes):
            if self.problem.dynamics.constant:  # exactly
                tables = cells.image(*velocity_bounds(self.problem, axis, j), delta)
                first[axis], number[axis] = (table[own[axis].ravel()] for table in tables)
            else:
                first[axis], number[axis] = cover(low[:, axis], high[:, axis], cells)
        number[:, (low > high).any(axis=1)] = 0  # of what has left no cell is asked for
        return first, number

    def add(self, prepared: Any, cells: FloatArray, following: FloatArray, step: int, within: int) -> None:
        """Add to `cells`, S_k^{n-1}, those that an input takes into `following`, S_{k+1}^{n-1}."""
        (images, clear), shape = prepared, np.array([axis.count for axis in self.axes])
        inside, start = to_bits(following, shape[-1]).ravel(), step if self.problem.dynamics.timed else 0
        reached, new = np.empty_like(inside), np.zeros_like(inside)
        masks = self.masks[entry(self.problem.steps, step, within)]
        for j in range(len(self.problem.inputs)):
            covered(inside, *images[start, j], shape, clear[step, j], reached)
            masks[j // 8] |= reached.astype(np.uint8) << np.uint8(j % 8)
            new |= reached
        cells |= to_words(new.reshape(-1, shape[-1]))

    def goal(self, step: int) -> FloatArray:
        """Cells inside the target and outside the unsafe set at t_k."""
        (low, high), target, t = self.ends, self.problem.target, self.problem.time(step)
        boxes = Boxes((low + high) / 2, (high - low) / 2 + STATE_SLACK, 0.0, 0.0)
        inside = self._clear(boxes, t)
        if not self.problem.stays:
            inside &= boxes.values(self.problem, target, self.sets[target.name], t)[1] <= 0.0
        return to_words(inside.reshape(-1, self.axes[-1].count))

    def share(self, step: int, within: int) -> None:
        """The inputs of entry (step, within) are those of (step, within - 1)."""
        place = entry(self.problem.steps, step, within)
        self.masks[place] = self.masks[place - 1]


# ---- what of the bounds can be refuted by looking at the functions


class Known(NamedTuple):
    """A function that has bounds, of states (M, ndim) and a time: (M, rows, terms), whose changes add up."""

    names: list[str]  # of the rows
    function: Callable[[FloatArray, float], FloatArray]
    bounds: FloatArray  # (rows, ndim)
    drifting: FloatArray | None  # (rows,) bounds in time, where they are not looked at elsewhere
    moving: bool
    seamless: bool  # whether it may not jump where a periodic axis closes


def known_functions(proof: GeneralProof) -> Iterator[Known]:
    """The level sets, and the velocity under each input."""
    problem = proof.problem

    def level(part: Any, points: FloatArray, t: float) -> FloatArray:
        return problem.value_of(part, points, t)[:, None, None]

    def velocity(j: int, points: FloatArray, t: float) -> FloatArray:
        drift, gain, bounds = velocity_terms(problem, points, j, t)
        return np.concatenate([drift[..., None], gain * bounds], axis=2)

    for part in known_sets(problem):
        bounds, unsafe = np.zeros((1, problem.grid.ndim)), isinstance(part, UnsafeSet)
        bounds[0, list(part.axes)] = proof.sets[part.name]
        names, moving = [f"the level set of {part.name!r}"], getattr(part, "moving", True)
        yield Known(names, partial(level, part), bounds, None, moving, unsafe)
    for j in range(0 if problem.dynamics.constant else len(problem.inputs)):
        names = [f"the velocity along {name!r} under input {j}" for name in problem.grid.names]
        yield Known(names, partial(velocity, j), proof.matrix, proof.drifting, problem.dynamics.timed, True)


def check_bounds(proof: GeneralProof) -> None:
    """Refuse bounds that differences between a few thousand pairs of states refute; it proves nothing of the others.

    And functions that jump where a periodic axis closes, at any node: no Lipschitz bound holds across a jump. Boxes of
    tubes reach across that seam; cells of the goal do not, so the target may jump there. What moves may jump at some
    times only: it is tried at the middles of all parts, where it is evaluated, and between them.
    """
    problem, grid, rng = proof.problem, proof.problem.grid, np.random.default_rng(0)
    span, often = problem.steps * problem.delta, 2 * proof.parts * problem.steps + 1
    for known in known_functions(proof):
        for axis in np.flatnonzero(grid.periodic).tolist() if known.seamless else ():
            points = grid.points()[np.indices(grid.shape)[axis].ravel() == 0]
            other = points.copy()
            other[:, axis] = grid.upper[axis] - 1e-9 * (grid.upper[axis] - grid.lower[axis])
            for t in np.linspace(0.0, span, often).tolist() if known.moving else (0.0,):
                _refuse_jump(known, points, other, t, grid.names[axis])
        for axis, share in itertools.product(range(grid.ndim), (0.5, 0.02)):
            step, room = share * grid.spacing[axis], np.array(grid.upper) - grid.lower
            room[axis] -= step  # the target may jump at the seam
            points = grid.lower + rng.random((PAIRS, grid.ndim)) * room
            beside = points + step * np.eye(grid.ndim)[axis]
            told, later = f"over {step:.3g} along the axis {grid.names[axis]!r}", share * problem.delta
            for t in (0.0, 0.37 * span, span - later) if known.moving else (0.0,):
                _refute(known, (points, t), (beside, t), known.bounds[:, axis], step, told)
                if known.drifting is not None and known.moving:
                    _refute(known, (points, t), (points, t + later), known.drifting, later, f"over {later:.3g} s")


def _refuse_jump(known: Known, points: FloatArray, other: FloatArray, t: float, axis: str) -> None:
    here, there = known.function(points, t), known.function(other, t)
    jumps = np.abs(here - there).sum(axis=2).max(axis=0)
    if (jump := jumps.max()) > SEAM * (1.0 + np.abs(here).max()):
        raise ValueError(
            f"{known.names[jumps.argmax()]} at t = {t:g} jumps by {jump:.3g} where the periodic axis {axis!r} closes, "
            "so no Lipschitz bound holds there; make it periodic, for example in the sine and cosine of the coordinate"
        )


def _refute(known: Known, one: Any, other: Any, bounds: FloatArray, step: float, told: str) -> None:
    here, there = known.function(*one), known.function(*other)
    change = np.abs(there - here).sum(axis=2)
    over = change - bounds * step * (1 + ALLOWANCE) - ALLOWANCE * (1.0 + np.abs(here[:, :, 0]))
    worst, row = np.unravel_index(np.argmax(over), over.shape)
    if over[worst, row] > 0.0:
        raise ValueError(
            f"{known.names[row]} changes by {change[worst, row]:.3g} {told}, and its Lipschitz bound {bounds[row]:g} "
            f"allows {bounds[row] * step:.3g}; give a bound of at least {change[worst, row] / step:.3g}"
        )


def cover(low: FloatArray, high: FloatArray, axis: CellAxis) -> tuple[FloatArray, FloatArray]:
    """First cell and number of cells that hold [low, high] with room for rounding; int64 each."""
    width, length, count = float(axis.width), float(sum(axis.extent) / 2), axis.count
    low, high = low - float(axis.lower) - ALLOWANCE, high - float(axis.lower) + ALLOWANCE
    laps = (np.floor(low / length), np.floor(high / length)) if axis.periodic else (0.0, 0.0)
    least = -np.inf if axis.periodic else 0
    begin = laps[0] * count + np.clip(np.floor((low - laps[0] * length) / width), least, count - 1)
    end = laps[1] * count + np.minimum(np.ceil((high - laps[1] * length) / width), count)
    begin, end = begin.astype(np.int64), np.maximum(end, begin + 1).astype(np.int64)
    return begin % count, np.minimum(end - begin, count)
