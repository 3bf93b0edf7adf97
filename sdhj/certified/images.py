"""What one interval leads boxes and cells to, by bounds on the velocity over boxes (`sdhj.certified.bounds`).

The velocity may depend on some of the axes only, as a car's on its heading. Those are an image's *place*; a cell's
position on the others is carried along, so all cells at a place move alike, and images lie so many cells off.

The interval is cut into pieces. Let the state be in a box X at the begin of one of length h, and let V bound the
velocity in a larger box B. If X + [0, h] V lies inside B, the state stays in B during the piece: it could only leave
where it already has. Its lower end on axis i, say at a, is then at least a + h F, where F bounds the velocity along i
from below in the part of B where x_i is in [a + h min(0, V_i), a + h max(0, V_i)]: as long as the bound is the least
coordinate the state moves no slower than F there, and else it is ahead of the bound (Mueller's theorem on differential
inequalities). Walls only hold the state back: ends are clipped at them. What has left over a safe end is out of danger
for good: once a whole tube is past one, nothing more is asked of it.

From a cell of no width at a wall (`sdhj.certified.cells`) a state moves nothing while it is held there. But the shell
reaches over it, and what is in the shell moves, until the wall has it. So where there are layers the first piece of an
interval is short, `BESIDE_LAYER` of it; and a coordinate that cannot grow within a piece needs no room above its box,
nor one that cannot fall below.

Displacements, not places, are added up, outward rounded, so a state off its cell by the shell stays so near to the
image; and an image may stick out of the cells that it is said to lie in by `DRIFT`, which a thousand steps are allowed.
"""

import itertools
import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from tqdm import tqdm

from sdhj.certified.bounds import Bounds
from sdhj.certified.cells import DRIFT, CellAxis, cells_of, is_steady, prediction_error_along, sees_walls
from sdhj.common.remembering import FloatArray, ReadOnly, kept, read_only
from sdhj.common.showing import hidden
from sdhj.formulas.formula import Ends
from sdhj.kernels.packed import STATE_SLACK, Cells
from sdhj.kernels.pieces import clip_to_walls, guess_enclosure, move_on, narrow_to_face, sweep
from sdhj.kernels.stencils import Moves
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sensing import Sensing
from sdhj.problem.sets import TargetSet, UnsafeSet
from sdhj.table.batches import STRIDES, threads

PIECES = 1 << 14  # that the state space is cut into, along the axes that velocities depend on
PIECES_OF_AN_AXIS = 1024  # on each axis; the checker cuts finer
GUESSES = 40
ROUNDED = 1 + 1e-12
BESIDE_LAYER = 1e-7  # of an interval: the first piece beside a layer
ROUNDED_OFF = 2.0**-50  # of the largest coordinate of an axis: see `Proof.rounding`


def prediction_error(problem: ReachAvoidProblem) -> FloatArray:
    """E (ndim,), how far a prediction may be off along each axis, at most; 0 without sensing.

    With a delay and dynamics that are not constant a box with error + delay * D(E) <= E, D(E) of `_spread`.
    """
    sensing, ndim = problem.sensing, problem.grid.ndim
    if not sensing:
        return np.zeros(ndim)
    if problem.dynamics.constant:
        return np.array([float(prediction_error_along(problem, axis)) for axis in range(ndim)])
    error = np.broadcast_to(np.array(sensing.error), (ndim,)).copy()
    if not sensing.delay:
        return error
    # files state what is found, as "unsure", and `Argument.far_off` of the checker proves it anew
    spread, box = _spread(problem), error
    for _ in range(GUESSES):
        wider = (error + sensing.delay * spread(box)) * ROUNDED
        # What begins in such a box stays in it: E is proved.
        if (wider <= box).all():
            return wider
        box = wider * (1 + 1e-3) + 1e-12 * np.maximum(np.abs(problem.grid.lower), np.abs(problem.grid.upper))
        # Beyond the size of the grid nothing is told from anything else.
        if not (box < np.subtract(problem.grid.upper, problem.grid.lower)).all():
            break
    raise ValueError(f"after a delay of {sensing.delay:g} s nothing is known of the state: the dynamics are too fast")


def _spread(problem: ReachAvoidProblem) -> Callable[[FloatArray], FloatArray]:
    """The function D(half-widths (ndim,) of a box around a prediction): the largest error of the velocity, (ndim,).

    It bounds |f(q, u, v) - f(p, u, 0)| for all predictions p, states q in the box around p, inputs, disturbances and
    times of a delay.
    """
    calm = replace(problem, dynamics=problem.dynamics.undisturbed(), sensing=Sensing())
    grid, timed, delay, disturbed = (
        problem.grid,
        problem.dynamics.depends_on_time,
        problem.sensing.delay,
        Bounds(problem),
    )
    known = problem.dynamics.reads.any(axis=0)
    pieces = np.where(known, min(int(PIECES ** (1 / max(known.sum(), 1))), PIECES_OF_AN_AXIS), 1)
    corners = np.stack([index.ravel() for index in np.indices(pieces.tolist())], axis=1)
    size = np.subtract(grid.upper, grid.lower) / pieces
    low, high = grid.lower + corners * size, grid.lower + (corners + 1) * size
    strides: list[tuple[float, float]] = []
    for step in range(problem.steps if timed else 1):
        # the strides in which `predicted` moves a measurement on; the checker has their number once more
        strides += itertools.pairwise((problem.time(step) - delay * np.arange(STRIDES, -1, -1) / STRIDES).tolist())
    tasks = list(itertools.product(range(len(problem.inputs)), strides if timed else strides[:1]))
    fastest, stride = (disturbed.velocity(j, low, high, *times) for j, times in tasks), delay / STRIDES * ROUNDED
    # With 0, as a state may stand still, or begin to.
    travel = [(np.minimum(a.min(axis=0), 0) * stride, np.maximum(b.max(axis=0), 0) * stride) for a, b in fastest]

    def near(bounds: Bounds, more: FloatArray | float) -> FloatArray:
        # the extremes (2, tasks, pieces, ndim) in pieces of the state space, widened
        each = zip(tasks, travel, strict=True)
        found = [bounds.velocity(j, low + a - more, high + b + more, *times) for (j, times), (a, b) in each]
        return np.stack(found, axis=1)

    slow, fast = near(Bounds(calm), 0.0)

    def spread(box: FloatArray) -> FloatArray:
        least, most = near(disturbed, box)
        return np.maximum(most - slow, fast - least).max(axis=(0, 1))

    return spread


class GrowsTooFast(ValueError):
    """No box is found that states stay in for a part of an interval."""


@dataclass(frozen=True)
class Proof(ReadOnly):
    """What is common to all proofs: the problem, the cells of each axis, and into how many parts an interval is cut.

    `CellSets` calls `prepare` once and then, for each step, `goal`, `add` and `add_arriving`; a table asks `image`,
    `places` and `inputs`. Contracts that are not here are those of `GeneralProof` and of `Images`.
    """

    problem: ReachAvoidProblem
    axes: tuple[CellAxis, ...]
    parts: int
    inputs: ClassVar[Any]  # a method of each

    @cached_property
    def along(self) -> int:
        """The axis along which `inputs` takes less time for cells in lines, or -1."""
        return -1

    def places(self, some: FloatArray) -> FloatArray:
        """The numbers of the places of cells: here all 0."""
        return np.zeros(len(some), np.int64)

    def add_arriving(self, cells: FloatArray, step: int) -> None:
        """Add to `cells` those that an input leads into the target itself; here none."""

    @property
    def rows(self) -> int:
        """How many leading axes number the blocks of packed sets."""
        return len(self.axes) - 1

    @property
    def time_invariant(self) -> bool:
        """Whether one set serves all starts."""
        return self.problem.time_invariant

    @property
    def shrinks(self) -> bool:
        """Whether sets lose cells with every step to go: without a target."""
        return self.problem.has_no_target

    @kept
    def cells(self) -> Cells:
        """The cells as arrays for compiled code."""
        return cells_of(self.axes, self.rows, not sees_walls(self.problem))

    @kept
    def shell(self) -> FloatArray:
        """How far off a cell a state counts as in it, (ndim,): `STATE_SLACK` times each axis's scale."""
        return STATE_SLACK * np.array([axis.scale for axis in self.axes])

    @kept
    def rounding(self) -> FloatArray:
        """How far off its cell rounding may make a state seem that lies on the cell's border, (ndim,).

        To find a state's cell takes a difference and a quotient, off by 8 times 2^-53 of the scale at most.
        """
        return ROUNDED_OFF * np.array([axis.scale for axis in self.axes])

    @kept
    def prediction_error(self) -> FloatArray:
        """E (ndim,), what the function `prediction_error` returns; ValueError where there is no bound."""
        return prediction_error(self.problem)


def place_axes(problem: ReachAvoidProblem, axes: tuple[CellAxis, ...]) -> FloatArray:
    """The axes of a place, (ndim,) bool: those on which a cell's index decides how far its image lies off.

    The axes that a velocity depends on, those whose cells are not all of one width, and those with a wall, unless the
    velocity along it is always in one range: there the image is clipped.
    """
    depends: FloatArray = np.logical_or.reduce(problem.dynamics.reads, axis=0)
    held = np.logical_or.reduce(problem.grid.ends_where("holds"), axis=0)
    for i, axis in enumerate(axes):
        depends[i] |= axis.last_is_narrower
        if held[i]:
            # no more than `Argument.alike_along` of the checker takes for alike, else the file is refused: where v is
            # not linear, it takes the components of the velocity together
            together = problem.dynamics.gain is None and problem.dynamics.reads.any()
            alike = problem.dynamics.constant or not (problem.sensing or together)
            depends[i] |= not (is_steady(problem, i) and alike)
    return depends


def moves_of(
    problem: ReachAvoidProblem, axes: tuple[CellAxis, ...], depends: FloatArray
) -> tuple[FloatArray, tuple[int, ...]]:
    """The strides of places, (ndim,), and the shape (starts, L, places, ndim) of moves.

    A cell is at the place with number sum(cell * strides). starts is N where the dynamics depend on time, else 1.
    """
    # the last axis of a place counts fastest, as in `Argument.strides_of` of the checker, which refuses other shapes
    counts, strides = np.array([axis.count for axis in axes]), np.zeros(len(axes), np.int64)
    strides[depends] = np.cumprod([1, *counts[depends][:0:-1]])[::-1] if depends.any() else 0
    timed = problem.steps if problem.dynamics.depends_on_time else 1
    return strides, (timed, len(problem.inputs), math.prod(counts[depends].tolist()), len(axes))


SIDES = np.array([-1.0, 1.0])[:, None, None]
PLACES = 1 << 13  # whose tubes are in memory at once, and what is computed of them in the caches
BOXES_OF_A_SET = 4_000_000  # in which a level set is asked for, at all times together
PIECES_OF_A_CELL = 16  # on each axis, at most
HALVINGS_OF_A_CELL = 4  # of a cell along each axis: 16 pieces
TRIES = 12  # to find a box that the state stays in


@dataclass(frozen=True)
class Images(Proof):
    """Where each input leads the cells at each place in one interval: boxes of cells, as offsets in cells.

    Attributes
    ----------
    strides : (ndim,) int64
        A cell is at the place with number sum(cell * strides); 0 on an axis that is no place's.
    low, high : (starts, L, places, ndim) int16
        The first and the last cell of the image, less the cell's own index. starts is 1 where the dynamics do not
        depend on time.
    """

    strides: FloatArray
    low: FloatArray
    high: FloatArray

    def __post_init__(self) -> None:
        read_only(self.strides)

    @cached_property
    def bounds(self) -> Bounds:
        """The `Bounds` of the problem on its velocity and its level-set functions."""
        return Bounds(self.problem)

    @cached_property
    def has_layers(self) -> bool:
        """Whether any axis has layers."""
        return any(any(axis.layers) for axis in self.axes)

    @kept
    def layers(self) -> FloatArray:
        """The coordinates of the layers at lower and upper ends, (2, ndim), else -+inf."""
        edges = np.array([axis.edges()[[0, -1]] for axis in self.axes]).T
        return np.where(self.cells.layers == 1, edges, [[-np.inf], [np.inf]])

    @property
    def _all_times(self) -> tuple[float, float]:
        """Times, s, between which all intervals lie: 0 and t_N, or infinity."""
        return 0.0, np.inf if self.problem.steps is None else self.problem.time(self.problem.steps)

    @kept
    def open_ends(self) -> FloatArray:
        """The safe ends of axes, (2, ndim), past which nothing is asked; infinite for others."""
        return np.stack(self.problem.grid.faces("frees"))

    def moves(self, step: int) -> Moves:
        """The images of the interval from a step as arrays for compiled code."""
        start = min(step, len(self.low) - 1)
        return Moves(self.low[start], self.high[start], self.strides, self.open_ends)

    @cached_property
    def along(self) -> int:
        """The last axis before the packed one that is no place's and has no safe end, or -1."""
        shift_invariant = np.flatnonzero((self.strides[:-1] == 0) & ~np.isfinite(self.open_ends[:, :-1]).any(axis=0))
        return int(shift_invariant[-1]) if shift_invariant.size else -1

    def places(self, some: FloatArray) -> FloatArray:
        """The numbers of the places of cells `some` (M, ndim), sum(cell * strides): (M,)."""
        return np.asarray(some @ self.strides)

    @kept
    def depends(self) -> FloatArray:
        """depends[i, k]: whether the offset of images along axis i varies with the index along axis k."""
        ndim, own = len(self.axes), self.strides > 0
        # `images_of` writes it into exports: by these axes alone C looks an image up
        moves = np.stack([self.low, self.high], axis=-1).reshape(
            *self.low.shape[:2], *np.where(own, self.cells.counts, 1), ndim, 2
        )
        out = np.zeros((ndim, ndim), np.bool_)
        for k in np.flatnonzero(own).tolist():
            out[:, k] = (moves != moves.take([0], 2 + k)).any(axis=(*range(2 + ndim), ndim + 3))
        return out

    def image(self, some: FloatArray, inputs: Any, step: int) -> Ends:
        """The first and the last cell of the boxes that cells are led into by inputs, (M, ndim) each, not clipped."""
        moves, places = self.moves(step), self.places(some)
        return some + moves.low[inputs, places], some + moves.high[inputs, places]

    @kept
    def farthest_moves(self) -> FloatArray:
        """The box of offsets that holds all images, from any place and input: (starts, 2, ndim)."""
        return np.stack([self.low.min(axis=(1, 2)), self.high.max(axis=(1, 2))], axis=1).astype(np.int64)

    def fill(
        self, pieces: int, progress: bool | None, use: Callable[[int, int, FloatArray, FloatArray, FloatArray], None]
    ) -> None:
        """Write the images of all places under all inputs from all starts into `low` and `high`, in threads.

        For each slab of at most `PLACES` places `use(start, j, places (M,), tubes (M, parts, ndim, 2), last (M, ndim,
        2))` is called in this thread, with what `swept` returns. ValueError where no bound on a velocity is found, or
        an interval leads more than 32,767 cells on.
        """
        starts, count, size, _ = self.low.shape
        n, work = threads(), list(np.ndindex(starts, count, -(-size // PLACES)))

        def moved(start: int, j: int, slab: int) -> tuple[FloatArray, Ends]:
            places = np.arange(slab * PLACES, min((slab + 1) * PLACES, size))
            return places, self.tubes_of_places(places, j, self.problem.time(start), pieces)

        with (
            tqdm(total=len(work), desc="intervals", leave=False, disable=hidden(progress)) as bar,
            ThreadPoolExecutor(n) as pool,
        ):
            # images in threads, `use` in this one alone: several inputs share a byte of what it marks
            for some in (work[at : at + n] for at in range(0, len(work), n)):
                found = pool.map(moved, *zip(*some, strict=True))
                for (start, j, _), (places, (tubes, last)) in zip(some, found, strict=True):
                    self.low[start, j, places], self.high[start, j, places] = self.in_cells(places, last)
                    use(start, j, places, tubes, last)
                    bar.update()

    def cells_at(self, places: FloatArray) -> FloatArray:
        """A cell (M, ndim) at each place (M,), with index 0 on the axes that are no place's."""
        own = zip(self.strides.tolist(), self.axes, strict=True)
        return np.stack([places // stride % axis.count if stride else 0 * places for stride, axis in own], axis=1)

    def tubes_of_places(self, places: FloatArray, j: int, time: float, pieces: int) -> Ends:
        """What `Images.swept` returns for the cells at places, widened by the shell, under u_j."""
        return self.swept(self.boxes(places), j, time, pieces)

    def boxes(self, places: FloatArray) -> FloatArray:
        """The lower and the upper corners of the cells at places (M,), widened by the shell: (2, M, ndim)."""
        grid, shift_invariant, cells = self.problem.grid, self.strides == 0, self.cells_at(places)
        start = np.empty((2, *cells.shape))
        for k, (axis, own) in enumerate(zip(self.axes, cells.T, strict=True)):
            # The whole axis where velocities do not depend on it: all cells along it move alike.
            start[0, :, k] = grid.lower[k] if shift_invariant[k] else axis.edges()[own] - self.shell[k]
            start[1, :, k] = grid.upper[k] if shift_invariant[k] else axis.edges()[own + 1] + self.shell[k]
        return start

    def swept(self, start: FloatArray, j: int, time: float, pieces: int) -> Ends:
        """How far the ends of M boxes, `start` (2, M, ndim), move under u_j in the interval from `time`, s.

        Returns displacements of the lower and the upper ends: the extremes during each part, (M, parts, ndim, 2), and
        at the interval's end, whenever that is, (M, ndim, 2); rounded outward, clipped at walls, and with sensing
        widened by E. For a controller that remembers, the second is that of the points it carries on (`_clipped`).
        """
        # `Argument.driven` of the checker goes the same way by pieces of its own: what counts there has to count here
        (_, many, ndim), before = start.shape, np.zeros(start.shape)
        off = SIDES * self._prediction_error(start)
        tubes, moved = (
            np.empty((many, self.parts, ndim, 2)),
            self._clipped_at_walls(start, before + off),
        )
        length, early = self.problem.sensing.hold(self.problem.delta)
        ends, soonest = [], length - early  # where they are from the earliest end of the interval on
        for number in range(self.parts):
            tube = [moved[0], moved[1]]
            cuts = [length * at / (self.parts * pieces) for at in range(number * pieces, (number + 1) * pieces + 1)]
            if number == 0 and self.has_layers:
                cuts.insert(1, length * BESIDE_LAYER)
            if cuts[0] < soonest < cuts[-1]:
                cuts = sorted({*cuts, soonest})
            for begin, end in itertools.pairwise(cuts):
                after = self._piece(start, moved, before, j, (time + begin, time + end))
                if begin >= soonest:
                    ends.append(moved)
                moved, before = after, after - moved  # what a piece added is a good guess for the next
                tube = [np.minimum(tube[0], moved[0]), np.maximum(tube[1], moved[1])]
            tubes[:, number, :, 0], tubes[:, number, :, 1] = tube
        ends.append(moved)
        last = np.stack([np.min([end[0] for end in ends], axis=0), np.max([end[1] for end in ends], axis=0)])
        last = self._clipped(start, last) if self.problem.sensing.remembers else last + SIDES * self.prediction_error
        return tubes, np.moveaxis(self._clipped_at_walls(start, last), 0, 2)

    def _prediction_error(self, start: FloatArray) -> FloatArray:
        """How far a state may be off a prediction in boxes `start` (2, M, ndim), along each axis: E, (M, ndim).

        For a controller that remembers, 0 along an axis on which the box is a layer: the state is known to be at the
        wall.
        """
        if not self.problem.sensing.remembers:
            return np.broadcast_to(self.prediction_error, start.shape[1:])
        in_layer = (start[1] <= self.layers[0] + self.shell) | (start[0] >= self.layers[1] - self.shell)
        return np.where(in_layer, 0.0, self.prediction_error)

    def _clipped(self, start: FloatArray, last: FloatArray) -> FloatArray:
        """The displacements (2, M, ndim) of the ends of boxes to the points that a controller with memory carries on.

        E is taken off the image of the states, at both ends, to its middle at most. An image that is held at a wall as
        a whole stays, and no other comes as near to a wall as a layer.
        """
        # as `Argument.carried_on` of the checker, whose points have to lie in the cells that are found of these
        (low, high), walls, drift = start + last, self.layers, DRIFT * np.array([axis.scale for axis in self.axes])
        held = (high <= walls[0] + self.shell + drift) | (low >= walls[1] - self.shell - drift)
        less = last - SIDES * self.prediction_error
        low, high = start + less
        middle = (low + high) / 2 - start
        less = np.where((low > high) & (self.strides > 0), middle, less)
        beside = self.shell + 2 * drift
        less[1] = np.maximum(less[1], walls[0] + beside - start[1])
        less[0] = np.minimum(less[0], walls[1] - beside - start[0])
        return np.where(held, last, less)

    def _piece(
        self, start: FloatArray, moved: FloatArray, before: FloatArray, j: int, times: tuple[float, float]
    ) -> FloatArray:
        """The displacements of both ends of boxes `start` at the end of a piece of an interval under u_j: (2, M, ndim).

        moved + h F, rounded outward and clipped at walls, F the bound on the velocity in the end's face of a box that
        the states stay in. `before` is what the piece before added, for a first guess.
        """
        # up, so that rounded lengths of all pieces leave nothing of the interval out
        h = np.nextafter(times[1] - times[0], np.inf)
        ends, enclosure = self._enclosure(start, moved, before, j, times, h)
        velocity = self.bounds.velocity(j, enclosure[0], enclosure[1], *times)
        fastest = velocity.copy()
        for axis in np.flatnonzero(np.diag(self.problem.dynamics.reads) & (self.strides > 0)).tolist():
            for side in (0, 1):  # in the face of the box where the state can be the first or the last of all
                face = enclosure.copy()
                narrow_to_face(ends, velocity, h, side, axis, self.shell[axis], face)
                fastest[side, :, axis] = self.bounds.fastest(side, axis, j, face[0], face[1], *times)
        after = moved.copy()
        move_on(after, fastest, h)
        return self._clipped_at_walls(start, after)

    def _clipped_at_walls(self, start: FloatArray, moved: FloatArray) -> FloatArray:
        """Clip `moved` so that start + moved ends at walls, rounded outward, and return it."""
        clip_to_walls(start, moved, self.strides == 0, np.stack(self.problem.grid.faces("holds")))
        return moved

    def _enclosure(
        self, start: FloatArray, moved: FloatArray, before: FloatArray, j: int, times: tuple[float, float], h: float
    ) -> tuple[FloatArray, FloatArray]:
        """Where boxes are at the begin of a piece, start + moved, and boxes that states stay in: two (2, M, ndim).

        The second is found by trying larger boxes until X + [0, h] V lies inside, `TRIES` times.
        """
        shift_invariant, (ends, enclosure, out) = self.strides == 0, np.empty((3, *start.shape))
        guess_enclosure(start, moved, before, shift_invariant, self.shell, ends, enclosure)
        for _ in range(TRIES):
            velocity = self.bounds.velocity(j, enclosure[0], enclosure[1], *times)
            if sweep(ends, velocity, h, shift_invariant, self.shell, enclosure, out):
                if self.has_layers:
                    # What surely moves away from an end of the box does not pass it.
                    out[0] = np.where(~shift_invariant & (velocity[0] >= 0.0), ends[0], out[0])
                    out[1] = np.where(~shift_invariant & (velocity[1] <= 0.0), ends[1], out[1])
                return ends, out
            # From what the last guess lets states reach, not from that guess.
            wider = 0.1 * (out[1] - out[0]) + self.shell
            wider_enclosure = np.where(shift_invariant, ends, out + SIDES * wider)
            if not np.isfinite(wider_enclosure).all():
                break
            enclosure = wider_enclosure
        raise self._unbounded_error(j, ends, enclosure, times)

    def _unbounded_error(
        self, j: int, ends: FloatArray, enclosure: FloatArray, times: tuple[float, float]
    ) -> ValueError:
        """The ValueError for boxes `ends` for which no larger ones are found that states stay in.

        It names the velocity under u_j that has no bound, or else the widest of the boxes.
        """
        names, u = self.problem.grid.names, f"input {j}"
        for boxes in (ends, enclosure):
            unknown = ~np.isfinite(self.bounds.velocity(j, boxes[0], boxes[1], *times)).all(axis=0)
            if unknown.any():
                row, axis = np.argwhere(unknown)[0]
                first, last = (np.array2string(end[row], precision=4, separator=", ") for end in boxes)
                # `Certified.sets` tries more parts after a `GrowsTooFast`; none help where the box itself has no bound
                return (ValueError if boxes is ends else GrowsTooFast)(
                    f"the velocity along {names[axis]} under {u} may be undefined or unbounded between {first} and "
                    f"{last}, where the states of a cell may come within an interval, and then nothing can be proved; "
                    "bound what it is divided by, for example np.maximum(distance, 0.01)"
                )
        widest = int(np.argmax((enclosure[1] - enclosure[0]).max(axis=1)))
        first, last = (np.array2string(end[widest], precision=4, separator=", ") for end in enclosure)
        return GrowsTooFast(
            f"the velocity under {u} grows too fast between {first} and {last}: within {times[1] - times[0]:.3g} s the "
            "states of a cell there may be anywhere, and nothing can be proved; limit it, for example by np.minimum"
        )

    def in_cells(self, places: FloatArray, moved: FloatArray) -> Ends:
        """The first and the last cell that hold the cells at places (M,) after their ends have moved: two (M, ndim).

        As offsets from a cell's own index, neither clipped nor taken around. ValueError beyond 32,767 cells.
        """
        low, high = np.empty((2, len(moved), len(self.axes)), np.int64)
        for axis, (own, cell) in enumerate(zip(self.axes, self.cells_at(places).T, strict=True)):
            known = bool(self.strides[axis] > 0)
            low[:, axis], high[:, axis] = own.moved(cell, moved[:, axis, 0], moved[:, axis, 1], known)
        # int16 in memory, in files and in exports (`sdhj_image`)
        if max(-low.min(), high.max()) > np.iinfo(np.int16).max:
            raise ValueError("an interval moves the state by more than 32,767 cells; use fewer cells")
        return low, high

    def over_cells(self, part: TargetSet | UnsafeSet, times: tuple[float, float]) -> FloatArray:
        """The sign of a set's level-set function in all of each cell at all `times`: 1 where > 0, -1 where <= 0, or 0.

        Cells are widened by the shell and E. The shape is that of the cells of all axes, with 1 for axes that the set
        does not depend on.
        """
        found = self.bounds.signs(part, *self._ends_along(part), times, HALVINGS_OF_A_CELL)
        return found.reshape([axis.count if i in part.axes else 1 for i, axis in enumerate(self.axes)])

    def outside_cells(self, part: UnsafeSet, times: tuple[float, float], asked: FloatArray) -> FloatArray:
        """Whether each cell `asked` about is proved outside a set at all `times`."""
        found = self.bounds.outside(part, *self._ends_along(part), times, HALVINGS_OF_A_CELL, asked)
        return found.reshape([axis.count if i in part.axes else 1 for i, axis in enumerate(self.axes)])

    def _ends_along(self, part: TargetSet | UnsafeSet) -> tuple[list[FloatArray], list[FloatArray]]:
        """Lower and upper ends of the cells along each axis of a set, widened by shell and E."""
        edges = [(self.axes[axis].edges(), self.shell[axis] + self.prediction_error[axis]) for axis in part.axes]
        return [own[:-1] - more for own, more in edges], [own[1:] + more for own, more in edges]
