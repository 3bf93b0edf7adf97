"""How many cells each axis gets where nobody says: by what cells lose, and by what they cost.

*What is lost.* Where a set's boundary moves inwards by w along axis k, the set loses the share m_k w of itself: m_k
counts how often lines along the axis cross the boundary, for each unit of length that they are inside. From one step to
the next the boundary of a tube turns as velocities carry it, m becomes (1 + delta |J|)^T m, where |J_ik| is how much
wider bounds on the velocity along axis i are in a box of width 1 along axis k. With cells of width w a step loses
m_i delta |J_ik| w_k, as the image of a cell is wider than the cell, and m_k w_k, as it is rounded out to whole cells.
All this is linear: c_k w_k is lost to the width of axis k. Only where the velocity is the same everywhere is it known
what is rounded out: nothing where cells are aligned with what an interval does, but a pursuer that moves by a tenth of
a cell counts as moving by a whole one.

For one number of cells, and with losses that are linear, the sum over k is least where all axes lose alike: where each
has the number n at which what it loses, times a factor that all share, plus log n is least. But for wide cells losses
are not linear; so each is divided by the power 1 - `SHARPNESS` of what a single cell as wide as the axis would lose.

Where a step loses nearly all, no step is of use, and only the target is to be proved. So cells are chosen twice, as if
nothing was rounded out on axes with one velocity, and with that; and those are taken of which more is kept, where a
loss of l leaves exp(-`DECAY` l), added up over the steps.

*What is paid.* A count of what is computed, times the seconds that each took on one core where this was written. It is
no clock, so a problem has the same cells on every machine.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from sdhj.certified.bounds import Bounds, known_sets
from sdhj.certified.cells import DRIFT, CellAxis, aligned_choices, is_steady, moved_bounds
from sdhj.certified.general_proof import EVALUATED, FINEST, peak, shapes
from sdhj.certified.images import BOXES_OF_A_SET, place_axes
from sdhj.formulas.formula import BlackBox
from sdhj.formulas.graph import ordered
from sdhj.kernels import FloatArray
from sdhj.problem.cost import ENDLESS_STEPS
from sdhj.problem.problem import ReachAvoidProblem

SPEED_STATES = 256  # states around which velocities are bounded
BOX = 1 / 64  # of an axis, the width of these boxes
SET_NODES = 1_000_000  # at which a set is looked at, at most
TRIALS = 16  # of the numbers of cells
WISHES = 1000  # numbers of cells that an axis may have
LEAP = 1.05  # an axis that gains more from one trial to the next keeps its number, and the others go on
LOSING_STEPS = 10  # over which losses are added up, at most
SHARPNESS = 2 / 3
DECAY = 0.4  # tells which of two numbers of cells proves more, of nine robots
WORTH = 0.03  # to lose less, by the model, is not worth more cells
MOST_OF_AN_AXIS = 4096
MOST_BYTES = 4_000_000_000  # without the sets that are found
CORES = 1.6  # that two are worth
# seconds, in `prepare`: for a part of an interval and an axis of a box, and an operation of the velocities; for a cell,
# an input and a corner of the boxes of a set, and for a line of such cells; for a cell and an input at unsafe ends; for
# an operation of a set and a box
AXIS, OPERATION, CORNER, LINE_OF_CELLS, AT_ENDS, BOXED = 1.1e-7, 1.4e-8, 4e-9, 4e-7, 1e-8, 1e-9
# in the recursion, for a cell of an entry, a row of its image, and a row that a changed one is reached from
ENTRY, IMAGE, NEAR_ROW = 3e-8, 7e-10, 2e-10
BLACK_BOX, LOOK_UP = 100, 40  # operations


class Speeds(NamedTuple):
    """Of states drawn at random and all inputs: mean |J| (ndim, ndim), mean widths (ndim,) and extremes (2, ndim)."""

    wider: FloatArray
    widths: FloatArray
    extremes: FloatArray


def chosen_cells(problem: ReachAvoidProblem, parts: int, seconds: float) -> tuple[int, ...]:
    """The number of cells on each axis, before they are aligned, that takes about so many seconds on two cores."""
    speeds, every, steps = speeds_of(problem), range(problem.grid.ndim), min(problem.most_steps, LOSING_STEPS)
    wishes = np.unique(np.rint(np.geomspace(2, MOST_OF_AN_AXIS, WISHES)).astype(int)).tolist()
    cells, rates = [aligned_choices(problem, k, wishes) for k in every], losses(problem, speeds)

    def kept(places: list[int]) -> float:
        """By the model, of all that is won within 0, 1, ... steps."""
        own = [cells[k][place] for k, place in enumerate(places)]
        once = sum(rates[0, k] * float(axis.width) for k, axis in enumerate(own))
        each = (sum(lost_to(problem, k, rates[:, k], [axis])[0] for k, axis in enumerate(own)) - once) / steps
        return sum(math.exp(-DECAY * (once + n * each)) for n in range(steps + 1))

    without = rates * [[1.0], [1.0], [0.0]]
    places = max((_spread(problem, parts, seconds, speeds, cells, some) for some in (without, rates)), key=kept)
    return tuple(wishes[place] for place in places)


def _spread(
    problem: ReachAvoidProblem,
    parts: int,
    seconds: float,
    speeds: Speeds,
    cells: Sequence[Sequence[CellAxis]],
    rates: FloatArray,
) -> list[int]:
    """Which of the choices of each axis lose least, for what can be paid, at rates (3, ndim) of `losses`."""
    every = np.arange(len(cells))
    shares = rates.sum(axis=0) * np.subtract(problem.grid.upper, problem.grid.lower)
    shares = np.maximum(shares, 1e-3 * shares.max(initial=1e-300))
    lost = np.stack([lost_to(problem, k, rates[:, k], own) for k, own in enumerate(cells)])
    counts = np.array([[axis.count for axis in own] for own in cells])
    lost, crowd = np.maximum(lost, 1e-3 * shares[:, None] / counts), np.log(counts)

    def chosen(factor: float) -> FloatArray:
        """For each axis the choice of least factor lost / share^(SHARPNESS - 1) + crowd."""
        return np.argmin(factor * lost * shares[:, None] ** (SHARPNESS - 1) + crowd, axis=1)

    def fits(places: FloatArray) -> bool:
        """Whether cells of these choices fit into the memory and the time."""
        axes = tuple(own[place] for own, place in zip(cells, places.tolist(), strict=True))
        large = peak(problem, axes, parts, *shapes(problem, axes, place_axes(problem, axes))[1:])
        paid = sum(cost(problem, axes, parts, speeds))
        return bool(lost[every, places].sum() > WORTH and large < MOST_BYTES and paid < CORES * seconds)

    least = 2 / (shares**SHARPNESS).max()
    for _ in every:
        most = MOST_OF_AN_AXIS / (shares**SHARPNESS).min()
        for _ in range(TRIALS):
            factor = math.sqrt(least * most)
            least, most = (factor, most) if fits(chosen(factor)) else (least, factor)
        leaps = counts[every, chosen(most)] / counts[every, chosen(least)]
        if leaps.max() < LEAP:
            break
        crowd[leaps.argmax(), chosen(least)[leaps.argmax()] + 1 :] = np.inf  # the others go on without this axis
    return list(chosen(least).tolist())


def losses(problem: ReachAvoidProblem, speeds: Speeds) -> FloatArray:
    """The loss on each axis, (3, ndim): for each unit of a cell's width at once and in all steps, which is c, and
    for each unit of what `rounded_out` says, in all steps.
    """
    m, turned = _crossings(problem), problem.delta * speeds.wider
    rounded = np.array([not is_steady(problem, axis) for axis in range(m.size)])
    lost = np.stack([m, 0 * m, 0 * m])
    for _ in range(min(problem.most_steps, LOSING_STEPS)):
        lost[1] += m * rounded + m @ turned
        lost[2] += m * ~rounded
        m = m + m @ turned
    return lost


def lost_to(problem: ReachAvoidProblem, axis: int, rates: FloatArray, choices: Sequence[CellAxis]) -> FloatArray:
    """The loss of each choice of the cells of an axis, at its rates (3,) of `losses`."""
    widths = np.array([float(own.width) for own in choices])
    return (rates[0] + rates[1]) * widths + rates[2] * rounded_out(problem, axis, widths)


def rounded_out(problem: ReachAvoidProblem, axis: int, widths: FloatArray) -> FloatArray:
    """By how much images reach too far to each side, for cells of some widths; 0 where the axis is not steady."""
    if not is_steady(problem, axis):
        return np.zeros(len(widths))
    moves = [moved_bounds(problem, axis, j) for j in range(len(problem.inputs))]
    low, high = np.array(moves, dtype=float).T[:, :, None]
    drift = DRIFT * max(abs(problem.grid.lower[axis]), abs(problem.grid.upper[axis]))
    cells = np.ceil((high - drift) / widths) - np.floor((low + drift) / widths)
    return np.asarray((cells * widths - (high - low)).mean(axis=0) / 2)


def _crossings(problem: ReachAvoidProblem) -> FloatArray:
    """m (ndim,), counted between the nodes of the problem's grid, of the sets and the unsafe ends, added up."""
    grid, steps = problem.grid, problem.most_steps
    extent, ends = np.subtract(grid.upper, grid.lower), np.stack(grid.faces("fails"))
    out = np.isfinite(ends).sum(axis=0) / extent
    for part in known_sets(problem):
        own = grid.subgrid(part.axes)
        own = replace(own, shape=tuple(min(n, int(SET_NODES ** (1 / own.ndim))) for n in own.shape))
        times = [problem.time(step) for step in (0, steps // 2, steps)] if part.moving else [0.0]
        inside = np.stack([part.level_set(own.points(), t).reshape(own.shape) <= 0.0 for t in times])
        for i, axis in enumerate(part.axes):
            crossed = np.diff(inside, axis=1 + i).mean() * (own.shape[i] - 1)
            out[axis] += crossed / extent[axis] / max(inside.mean(), 1 / own.size)
    return out


def speeds_of(problem: ReachAvoidProblem) -> Speeds:
    """How velocities are bounded in boxes around states drawn at random, and in these states."""
    grid, bounds, t, count = problem.grid, Bounds(problem), problem.time(0), len(problem.inputs)
    size = BOX * np.subtract(grid.upper, grid.lower)
    states = grid.lower + size * np.random.default_rng(0).uniform(0.0, 1 / BOX - 1, (SPEED_STATES, grid.ndim))
    wider, ends = np.zeros((grid.ndim, grid.ndim)), np.empty((2, count, SPEED_STATES, grid.ndim))
    for j in range(count):
        ends[:, j] = least, most = bounds.velocity(j, states, states, t, t)
        for k in np.flatnonzero(problem.dynamics.reads.any(axis=0)):
            low, high = bounds.velocity(j, states, states + size * (np.arange(grid.ndim) == k), t, t)
            wider[:, k] += np.mean((high - low) - (most - least), axis=0) / size[k] / count
    extremes = np.stack([ends[0].min(axis=(0, 1)), ends[1].max(axis=(0, 1))])
    return Speeds(np.maximum(wider, 0.0), (ends[1] - ends[0]).mean(axis=(0, 1)), extremes)


def cost(problem: ReachAvoidProblem, axes: tuple[CellAxis, ...], parts: int, speeds: Speeds) -> tuple[float, float]:
    """Seconds of one core that preparing and the recursion take."""
    own = place_axes(problem, axes)
    _, moves, clear = shapes(problem, axes, own)
    (starts, count, places, ndim), (times, cells, _) = moves, clear
    entries = (problem.steps or ENDLESS_STEPS) * (1.0 if problem.time_invariant else (problem.most_steps + 1) / 2)
    pieces = min(max(EVALUATED // (places * count * parts * starts * 2), 1), FINEST) * parts * starts * count * places
    drift = problem.dynamics.drift
    velocity = drift if isinstance(drift, BlackBox) else problem.dynamics.each["drift"][0]
    first = pieces * (AXIS * ndim + OPERATION * _operations(velocity))

    def asked(axes_of: Iterable[int]) -> float:
        """Of how many cells an input's tubes are looked at, for what depends on some axes."""
        return cells / math.prod(axis.count for k, axis in enumerate(axes) if not own[k] and k not in axes_of)

    for unsafe_set in problem.unsafe:
        free = [axes[k].count for k in unsafe_set.axes if not own[k]]
        each = CORNER * 2 ** len(unsafe_set.axes) + LINE_OF_CELLS / (free[-1] if free else 1)
        first += each * asked(unsafe_set.axes) * count * (times if unsafe_set.moving else starts)
        first += BOXED * BOXES_OF_A_SET * _operations(unsafe_set.level_set)
    unsafe = np.flatnonzero(np.isfinite(problem.grid.faces("fails")).any(axis=0))
    first += AT_ENDS * asked(unsafe) * count * starts if unsafe.size else 0.0
    widths, delta, counts = np.array([float(axis.width) for axis in axes]), problem.delta, [axis.count for axis in axes]
    image = np.minimum(2 + delta * (speeds.widths + speeds.wider @ widths) / widths, counts)[:-1].prod()
    near = np.minimum(2 + delta * np.ptp(speeds.extremes, axis=0) / widths, counts)[:-1].prod()
    image = float(image) if own[-1] else 0.0  # else words are asked for
    return first, entries * cells * (ENTRY + IMAGE * image + NEAR_ROW * float(near) / counts[-1])


def _operations(function: Any) -> int:
    """How many operations a formula takes for a point."""
    if isinstance(function, BlackBox):
        return BLACK_BOX
    operations = [one.op for one in ordered(function.outputs)]
    return len(operations) + LOOK_UP * operations.count("gridded")
