"""How many cells each axis gets where nobody says: by what cells lose, and by what they cost.

*What is lost.* Where a set's boundary moves inwards by w along axis k, the set loses the share m_k w of itself: m_k
counts how often lines along the axis cross the boundary, for each unit of length that they are inside. From one step to
the next the boundary of a tube turns as velocities carry it: after n steps m is |exp(n delta J)|^T m, J the Jacobian of
the velocity at a state, a mean over states. |J|_ik is how much wider bounds on the velocity along axis i are in a box
of width 1 along axis k. With cells of width w a step loses m_i delta |J_ik| w_k, as the image of a cell is wider than
the cell, and m_k w_k, as it is rounded out to whole cells. Steps count until a state has crossed its axis. All this is
linear: c_k w_k is lost to the width of axis k. Only where the velocity is the same everywhere is it known
what is rounded out: nothing where cells are aligned with what an interval does, but a pursuer that moves by a tenth of
a cell counts as moving by a whole one, and an input that moves by less than a cell as leading nowhere.

For one number of cells, and with losses that are linear, the sum over k is least where all axes lose alike: where each
has the number n at which what it loses, times a factor that all share, plus log n is least. But for wide cells losses
are not linear; so each is divided by the power 1 - `SHARPNESS` of what a single cell as wide as the axis would lose.

Where a step loses nearly all, no step is of use, and only the target is to be proved. So cells are chosen twice, as if
nothing was rounded out on axes with one velocity, and with that, each for the whole time and for a half, a quarter and
an eighth of it; and those are taken of which more is kept, where a loss of l leaves exp(-`DECAY` l), added up over the
steps.

Where each axis loses more than there is, or all cells move alike, and the target's axes are a problem of their own with
one velocity, as an arm that is pursued, the recursion on these axes alone is run for some numbers of cells
(`sdhj.certified.alone`): it knows which fit the target and what inputs move. The other axes have what can be paid then,
and the cells are taken of which most is kept.

All this changes little by little with the number of cells, but two things leap. Sets are packed along one axis,
64 cells in a word, and a word that is half full takes as long: of the crane with 62 x 50 x 54 x 57 cells .7 % is
proved, with 127 x 50 x 44 x 44, which take as long, 9 %. And cells may be so wide that no input leads anywhere: of the
ferry with 382 x 320 cells the target is proved, with 572 x 192, by inputs that move it along x, three times as much. So
at last the cells are compared, by what they keep, with those of which words are full, of one more and of one less, and
with those that have on one axis just as many as are needed for inputs to lead on.

The shorter an interval, the more steps round out, so an axis that is not aligned has as many more cells as these ask
for, up to `MOST_OF_AN_AXIS`; a truck of unknown mass at 100 Hz has 22,000, and .77 of the states where 4,096 prove .60.

On axes where cells are not aligned with what inputs move, their number is changed a little at last, so that edges of
cells are faces of the target, where it has such: of a crane whose load has to hang still four times as much is proved.

*What is paid.* A count of what is computed, times the seconds that each took on one core where this was written. It is
no clock, so a problem has the same cells on every machine. `python figures/studies/cost_of_cells.py` measures these
seconds again, beside what `costs` says of each part of a solve.
"""

import bisect
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from sdhj.certified.alone import axes_alone, share_proved_alone
from sdhj.certified.arrivals import sites_of
from sdhj.certified.bounds import Bounds
from sdhj.certified.cells import DRIFT, CellAxis, aligned_choices, is_steady, moved_bounds
from sdhj.certified.general_proof import finest, peak_bytes
from sdhj.certified.images import BOXES_OF_A_SET, PIECES_OF_A_CELL, moves_of, place_axes
from sdhj.certified.packing import packed_axis
from sdhj.certified.word_tubes import goes_along, in_words, pieces_of, size_in_words
from sdhj.formulas.formula import BlackBox
from sdhj.formulas.graph import ordered
from sdhj.kernels import FloatArray, read_only
from sdhj.kernels.stencils import SEGMENT
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sets import TargetSet, UnsafeSet

FLOW_PARTS = 64  # parts of an interval in which velocities carry a boundary on
SPEED_STATES = 256  # states around which velocities are bounded
BOX = 1 / 64  # of an axis, the width of these boxes
SET_NODES = 1_000_000  # at which a set is looked at, at most
SET_STATES = 20_000  # at which the target is, for the cost
SHORTER = (1 / 2, 1 / 4, 1 / 8)  # of the time, what is tried too
FITTED, ROUNDED = 0.04, 1e-9  # by how much a number of cells is changed for the target; cells
LINES, FLAT = 8, 1e-6  # through a set, and what share of an axis ends of one face may differ by
ON_A_LINE, HALVINGS_OF_A_LINE = 1025, 40  # states on a line, and how often what is between two is halved
TRIALS = 16  # of the numbers of cells
FINER = 1.00766  # times as many cells are wished for along an axis, from one number to the next
LEAP = 1.05  # an axis that gains more from one trial to the next keeps its number, and the others go on
CHANGING = 250  # entries of the recursion that count, at most, as of later ones only what has changed is asked anew
DIRECTIONS = 16  # in which inputs are asked how far they move
SLOWED = 100.0  # how many times a loss counts, at most, because steps lead less far for it
SHARPNESS = 2 / 3
DECAY = 0.4  # tells which of two numbers of cells proves more, of nine robots
TUBES, LEFT = 10.0, 2.0  # likewise where the target's axes are a problem of their own: by eleven solves of two robots
LEADING = 40  # numbers of cells of these that are looked at
IMAGES = 50_000  # for each second, of their cells and inputs: a microsecond each
HELD_UP = 2.0  # times what the best cells of an axis lose, by their number: by more inputs are held up
WORTH = 0.03  # to lose less, by the model, is not worth more cells
MOST_OF_AN_AXIS = 2**15 - 1  # cells, as many as an interval may lead on at most
MOST_OF_A_STEADY_AXIS = 4096  # where steps round nothing out that cells could be aligned with, at any rate
MOST_BYTES = 4_000_000_000  # without the blocks of the sets that are found
BLOCK = 4  # bytes, for the number of a block of a set
# that two are worth, where a solve takes 1.2 times as long as where this was written: of two processors one took 1.45
CORES = 1.6 / 1.2
# seconds, in `prepare`: for a piece of an interval and an axis of a box, an operation of the velocities, and all boxes;
# for a cell and an input at unsafe ends
AXIS, OPERATION, PIECE, AT_ENDS = 1.5e-7, 1.5e-8, 4e-4, 1e-8
# for a box of a set, an operation of the set and a box, and that of a box of words, and of one near the set's boundary
SUMMED, BOXED, BOXED_IN_WORDS, BOXED_BESIDE = 1e-8, 4e-10, 7e-10, 1e-8
# for a cell, an input and a set; for a line of such cells and a part; for a corner of a tube, and what it takes more
# where no cache holds the sums, of about `IN_CACHE` boxes, and a cell is `BESIDE` boxes wide, so none is near the next
CELL, LINE_OF_CELLS, CORNER, FAR_CORNER = 1.4e-8, 4e-8, 1.9e-9, 6.5e-9
IN_CACHE, BESIDE = 4_000_000, 16
GONE = 1.5e-7  # for a cell and an input where ends are safe, as a tube may have left before it meets a set
# for a cell, an input and an axis of the target, to see whether an image is near it; for an image that is
NEAR, ARRIVAL = 8e-9, 1.2e-7
# in the recursion, for a cell of an entry, and for its inputs and the rows of their images, where 64 cells are led at
# once and where each is led by itself: of many most are done with at once, so the root of their number counts. Where
# hardly anything is proved it takes a third of that
ENTRY, ROW, ROW_OF_A_CELL = 1.5e-9, 8.5e-10, 3e-9
# for a cell, all entries together, where sets shrink until they are kept for ever: one that is led by itself, and one
# of 64 where every velocity depends on the state, so images are rounded out along all axes and sets shrink for longer
KEPT, CREEPING = 2e-6, 6e-7
# for an input and 64 cells where these are looked at together, likewise in an entry of the recursion, and for the bit
# of a cell and an input
WORD, IN_WORDS, BIT = 3e-9, 2e-8, 2e-9
BLACK_BOX, LOOK_UP = 100, 50  # operations

Taken = Callable[[tuple[int, ...]], float]  # the seconds that a choice of cells takes, an index for each axis


class Speeds(NamedTuple):
    """What is known of the velocities by `speeds_of`, at states drawn at random and under all inputs."""

    # (ndim, ndim), the mean of |J|: by how much bounds on velocity i widen for each unit of a box along axis k
    wider: FloatArray
    widths: FloatArray  # (ndim,), the mean width of the bounds at a state, which is due to the disturbance
    extremes: FloatArray  # (2, ndim), the least and the greatest of all states, inputs and disturbances
    # (SPEED_STATES, ndim, ndim), J of each state under one input, by differences, without a disturbance
    jacobians: FloatArray
    displacements: Any  # along the axes with one velocity (`Displacements`); None where there is no such axis


def chosen_cells(problem: ReachAvoidProblem, parts: int, seconds: float) -> tuple[int, ...]:
    """The number of cells on each axis, before they are aligned, whose solve takes about `seconds` s on two cores."""
    speeds, every = speeds_of(problem), list(range(problem.grid.ndim))
    steps, most = losing_steps(problem, speeds), MOST_OF_AN_AXIS / max(_lengths_led(problem, speeds), 1.0)
    numbers = 2 * FINER ** np.arange(1 + int(max(math.log(most / 2, FINER), 0.0)))
    wishes = np.unique(np.rint(numbers).astype(int)).tolist()
    cells, rates = [aligned_choices(problem, k, wishes) for k in every], losses(problem, speeds)
    without = rates * [[1.0], [1.0], [0.0]]
    lost, unrounded = (
        np.stack([lost_to(problem, k, some[:, k], own, speeds) for k, own in enumerate(cells)])
        for some in (rates, without)
    )

    def kept(places: list[int]) -> float:
        # what a choice of cells keeps: the sum over n = 0..steps of exp(-DECAY * loss in n steps)
        once = sum(rates[0, k] * float(cells[k][place].width) for k, place in enumerate(places))
        each = (float(lost[every, places].sum()) - once) / steps
        return sum(math.exp(-DECAY * (once + n * each)) for n in range(steps + 1))

    @cache  # a few hundred choices are asked for again and again
    def taken(places: tuple[int, ...]) -> float:
        return _taken(problem, _picked(cells, places), parts, speeds)

    best = partial(_best, problem, taken, seconds, cells)
    models = (without, unrounded), (rates, lost)
    tried = [_Asked(*some, by, {}) for some in models for by in (1.0, *SHORTER)]  # more must not prove less
    places, asked = best(tried, kept)
    others = _words_filled(problem, cells, places) + _not_held_up(cells, lost)
    places, _ = best([asked, *(asked._replace(given=given) for given in others)], kept)
    together = goes_along(problem, place_axes(problem, _picked(cells, places)), every)
    if together or lost[every, places].mean() > 1.0:  # on each axis more than there is: losses are not linear here
        places = _by_axes_alone(problem, taken, seconds, speeds, cells, rates, lost) or places
    return tuple(_fitted(problem, axis, wishes[place]) for axis, place in enumerate(places))


class _Asked(NamedTuple):
    """What `_spread` is asked for: its arguments `rates`, `lost` and `given`, and the share of the seconds."""

    rates: FloatArray
    lost: FloatArray
    share: float
    given: Mapping[int, int]


def _best(
    problem: ReachAvoidProblem,
    taken: Taken,
    seconds: float,
    cells: Sequence[Sequence[CellAxis]],
    tried: Sequence[_Asked],
    kept: Callable[[list[int]], float],
) -> tuple[list[int], _Asked]:
    """Of the choices of cells that `_spread` returns that of which most is kept, and what it was asked for."""
    found = [_spread(problem, taken, seconds * one.share, cells, one.rates, one.lost, one.given) for one in tried]
    # one that is not paid for counts only where none is
    best = max(range(len(found)), key=lambda n: (taken(tuple(found[n])) < seconds, kept(found[n])))
    return found[best], tried[best]


def _words_filled(
    problem: ReachAvoidProblem, cells: Sequence[Sequence[CellAxis]], places: Sequence[int]
) -> list[dict[int, int]]:
    """Choices for the axis along which sets are packed that fill words of 64 cells: {axis: index}, a few."""
    axes = _picked(cells, places)
    depends = place_axes(problem, axes)
    packed = packed_axis(problem.grid, axes, depends)
    if depends[packed] or problem.grid.has("frees"):
        return []
    counts, words = [axis.count for axis in cells[packed]], in_whole_words(axes[packed].count) // 64
    some = [bisect.bisect(counts, 64 * (words + more)) - 1 for more in (-1, 0, 1)]
    return [{packed: place} for place in some if place >= 0]


def _not_held_up(cells: Sequence[Sequence[CellAxis]], lost: FloatArray) -> list[dict[int, int]]:
    """For each axis the fewest cells with which inputs lead on: {axis: index}; no entry where any number does.

    An input that moves by less than a cell leads nowhere: there what is lost times the number of cells, else about
    constant, is more than `HELD_UP` times the least of all choices.
    """
    each = lost * [[axis.count for axis in own] for own in cells]
    first = [int(np.argmax(own <= HELD_UP * own.min())) for own in each]
    return [{axis: place} for axis, place in enumerate(first) if place]


def _fitted(problem: ReachAvoidProblem, axis: int, wish: int) -> int:
    """About as many cells as are wished along an axis, with edges as near to the target's faces as can be."""
    # what is lost at a face is lost again in all steps, as what gets to a smaller set is smaller
    if problem.has_no_target or axis not in problem.target.axes or is_steady(problem, axis):
        return wish
    faces = _faces(problem, axis)
    if not faces:
        return wish
    extent = problem.grid.upper[axis] - problem.grid.lower[axis]
    more = max(round(FITTED * wish), 1)

    def missing(count: int) -> float:
        # the share of the axis in the target, but in none of the cells inside
        low, high = ((face - problem.grid.lower[axis]) / extent * count for face in faces)
        return (math.ceil(low - ROUNDED) - low + high - math.floor(high + ROUNDED)) / count

    some = range(max(wish - more, 2), min(wish + more, in_whole_words(wish)) + 1)
    return min(some, key=lambda count: (round(missing(count), 9), abs(count - wish)))


def _faces(problem: ReachAvoidProblem, axis: int) -> tuple[float, float] | None:
    """Where lines along an axis enter and leave the target, the two coordinates; None if that differs between lines."""
    target, grid, t = problem.target, problem.grid.subgrid(problem.target.axes), problem.time(0)
    drawn = np.random.default_rng(0).uniform(grid.lower, grid.upper, (SET_STATES, grid.ndim))
    # through the deepest of random states
    lines, k = drawn[np.argsort(target.level_set(drawn, t))[:LINES]], target.axes.index(axis)

    def inside(line: FloatArray, places: FloatArray) -> FloatArray:
        states = np.tile(line, (len(places), 1))
        states[:, k] = places
        return np.asarray(target.level_set(states, t) <= 0.0)

    places, found = np.linspace(grid.lower[k], grid.upper[k], ON_A_LINE), []
    for line in lines:
        middle, outside = line[k], places[~inside(line, places)]
        below, above = outside[outside < middle], outside[outside > middle]
        if not inside(line, line[k : k + 1]).any() or not below.size or not above.size:
            return None
        ends = np.array([[below[-1], middle], [above[0], middle]])  # outside and inside
        for _ in range(HALVINGS_OF_A_LINE):
            between = ends.mean(axis=1)
            ends[[0, 1], inside(line, between).astype(int)] = between
        found.append(ends[:, 1])
    flat = bool((np.ptp(found, axis=0) < FLAT * (grid.upper[k] - grid.lower[k])).all())
    return (float(found[0][0]), float(found[0][1])) if flat else None


def _by_axes_alone(
    problem: ReachAvoidProblem,
    taken: Taken,
    seconds: float,
    speeds: Speeds,
    cells: Sequence[Sequence[CellAxis]],
    rates: FloatArray,
    lost: FloatArray,
) -> list[int]:
    """The choice of cells, an index for each axis, by which most is kept of what the target's axes prove by themselves.

    Kept is what the recursion on these axes proves, times exp(-l). In l their widths count `TUBES` times, since tubes
    of wide cells meet unsafe sets, and losses on the others `LEFT` times. [] where nothing is kept.
    """
    alone, steps = axes_alone(problem), losing_steps(problem, speeds)
    if not alone:
        return []
    best, most, m = list[int](), 0.0, _crossings(problem, left=True)
    widths = np.array([[float(axis.width) for axis in own] for own in cells])
    lost = lost * (m / np.maximum(rates[0], 1e-300))[:, None] * LEFT
    lost[alone] = TUBES * m[alone, None] * widths[alone]
    for given in _led_far(problem, cells, alone, rates[0], IMAGES * seconds):
        places = _spread(problem, taken, seconds, cells, rates, lost, given)
        if taken(tuple(places)) > seconds:
            break
        axes = _picked(cells, places)
        proved = share_proved_alone(problem, [axes[k] for k in alone], steps)
        kept = proved * math.exp(-lost[range(len(axes)), places].sum())
        best, most = (places, kept) if kept > most else (best, most)
    return best


def _picked(cells: Sequence[Sequence[CellAxis]], places: Iterable[int]) -> tuple[CellAxis, ...]:
    """The chosen cells of every axis: cells[k][places[k]] for axis k."""
    return tuple(own[place] for own, place in zip(cells, places, strict=True))


def _led_far(
    problem: ReachAvoidProblem, cells: Sequence[Sequence[CellAxis]], alone: Sequence[int], m: FloatArray, most: float
) -> list[dict[int, int]]:
    """Choices of cells for the axes `alone`, from few cells to many: {axis: index of its choice in cells[axis]}.

    Along an axis those are the widest cells of which the farthest displacement passes k whole cells, for k = 1, 2, ...;
    those are combined that lose about alike by `m` (ndim,), with at most `most` images.
    """
    some, out = {}, list[dict[int, int]]()
    for axis in alone:
        moves = [moved_bounds(problem, axis, j) for j in range(len(problem.inputs))]
        far = max(max(low, -high) for low, high in moves)
        whole = [far // own.width for own in cells[axis]]
        some[axis] = [i for i in range(1, len(whole)) if whole[i] > max(whole[i - 1], 0)] or [*range(len(whole))]

    def lost(axis: int, place: int) -> float:
        return m[axis] * float(cells[axis][place].width)

    for factor in np.geomspace(1.0, MOST_OF_AN_AXIS, LEADING) / m[alone].max(initial=1e-300):
        crowd = {k: [factor * lost(k, i) + math.log(cells[k][i].count) for i in own] for k, own in some.items()}
        chosen = {k: some[k][int(np.argmin(own))] for k, own in crowd.items()}
        images = math.prod(cells[k][i].count for k, i in chosen.items()) * len(problem.inputs)
        out += [chosen] if chosen not in out and images < most else []
    return out


def _spread(
    problem: ReachAvoidProblem,
    taken: Taken,
    seconds: float,
    cells: Sequence[Sequence[CellAxis]],
    rates: FloatArray,
    lost: FloatArray,
    given: Mapping[int, int] = MappingProxyType({}),
) -> list[int]:
    """The choice of cells, an index for each axis, that loses least of all that `seconds` and memory pay for.

    Each axis has the choice of least factor * lost / share^(1 - SHARPNESS) + log(number of cells), share being what a
    single cell would lose; the factor is found by bisection. Axes in `given` have their choice.
    """
    every = np.arange(len(cells))
    shares = rates.sum(axis=0) * np.subtract(problem.grid.upper, problem.grid.lower)
    shares = np.maximum(shares, 1e-3 * shares.max(initial=1e-300))
    counts = np.array([[axis.count for axis in own] for own in cells])
    lost, crowd = np.maximum(lost, 1e-3 * shares[:, None] / counts), np.log(counts)
    limits = np.where([is_steady(problem, k) for k in every.tolist()], MOST_OF_A_STEADY_AXIS, MOST_OF_AN_AXIS)
    limits = limits / (shares**SHARPNESS).min()
    for axis, place in given.items():
        crowd[axis, np.arange(counts.shape[1]) != place] = np.inf

    def chosen(factor: float) -> FloatArray:
        each = np.minimum(factor, limits)[:, None]
        return np.argmin(each * lost * shares[:, None] ** (SHARPNESS - 1) + crowd, axis=1)

    def fits(places: FloatArray) -> bool:
        return lost[every, places].sum() > WORTH and taken(tuple(places.tolist())) < seconds

    least = 2 / (shares**SHARPNESS).max()
    for _ in every:
        most = limits.max()
        for _ in range(TRIALS):
            factor = math.sqrt(least * most)
            least, most = (factor, most) if fits(chosen(factor)) else (least, factor)
        leaps = counts[every, chosen(most)] / counts[every, chosen(least)]
        if leaps.max() < LEAP:
            break
        crowd[leaps.argmax(), chosen(least)[leaps.argmax()] + 1 :] = np.inf  # the others go on without this axis
    return list(chosen(least).tolist())


def _taken(problem: ReachAvoidProblem, axes: tuple[CellAxis, ...], parts: int, speeds: Speeds) -> float:
    """The seconds that a solve with cells `axes` takes on two cores; infinite for `MOST_BYTES` of memory or more."""
    large = peak_bytes(problem, axes, parts, moves_of(problem, axes, place_axes(problem, axes))[1])
    steps = problem.steps or losing_steps(problem, speeds)
    entries = steps + 1 if problem.time_invariant else (steps + 1) * (steps + 2) // 2
    large += BLOCK * entries * math.prod(axis.count for axis in axes[:-1])
    return sum(cost(problem, axes, parts, speeds)) / CORES if large < MOST_BYTES else math.inf


def losing_steps(problem: ReachAvoidProblem, speeds: Speeds) -> int:
    """The number of steps over which losses are added up: until the slowest moving coordinate has crossed its axis."""
    fastest = np.abs(speeds.extremes).max(axis=0)
    extent = np.subtract(problem.grid.upper, problem.grid.lower)
    longest = (extent / np.where(fastest > 0, fastest, np.inf)).max() / problem.delta
    # refused where its bounds are asked for
    if not math.isfinite(longest):
        return 1
    return int(min(problem.most_steps, max(math.ceil(longest), 1)))


def _lengths_led(problem: ReachAvoidProblem, speeds: Speeds) -> float:
    """How many times its axis a coordinate moves in an interval, about twice of the most."""
    extent = np.subtract(problem.grid.upper, problem.grid.lower)
    led = 2 * problem.delta * float((np.abs(speeds.extremes).max(axis=0) / extent).max())
    return led if math.isfinite(led) else 0.0


def losses(problem: ReachAvoidProblem, speeds: Speeds) -> FloatArray:
    """What a set loses of itself to the cells of each axis, in `losing_steps` steps: (3, ndim).

    Rows 0 and 1 are for each unit of a cell's width, at once and in all steps together; their sum is c of the module
    docstring. Row 2 is for each unit of `rounded_out`.
    """
    m, turned = _crossings(problem), problem.delta * speeds.wider
    rounded = np.array([not is_steady(problem, axis) for axis in range(m.size)])
    extent = np.subtract(problem.grid.upper, problem.grid.lower)
    farthest = extent[:, None] / extent  # a coordinate goes no farther than its axis
    lost, first = np.stack([m, 0 * m, 0 * m]), m
    one = np.eye(m.size) + problem.delta / FLOW_PARTS * speeds.jacobians
    one = np.linalg.matrix_power(one, FLOW_PARTS)
    carried = np.broadcast_to(np.eye(m.size), one.shape)
    for _ in range(losing_steps(problem, speeds)):
        lost[1] += m * rounded + m @ turned
        lost[2] += m * ~rounded
        carried = np.clip(carried @ one, -farthest, farthest)
        m = first @ np.abs(carried).mean(axis=0)
    return lost


def lost_to(
    problem: ReachAvoidProblem, axis: int, rates: FloatArray, choices: Sequence[CellAxis], speeds: Speeds
) -> FloatArray:
    """The share of a set, perhaps more than 1, that is lost to each of n choices of the cells of one axis: (n,)."""
    widths = np.array([float(own.width) for own in choices])
    if not rates[2]:
        return np.asarray((rates[0] + rates[1]) * widths)
    return (rates[0] + rates[1]) * widths + rates[2] * rounded_out(problem, axis, widths, speeds.displacements)


def rounded_out(problem: ReachAvoidProblem, axis: int, widths: FloatArray, displaced: "Displacements") -> FloatArray:
    """By how much images in whole cells fall short of the displacements by the inputs along a steady axis: (n,).

    A mean over directions. Along each let the input that leads farthest lead by P, and in whole cells by P': then P -
    P' is lost, in P / P' times as many steps, at most `SLOWED` times. Where the velocity depends on the coordinate and
    there is a target, what the image ends too late by is added. Where all inputs move the coordinate alike, it is half
    of what rounding adds to both ends.
    """
    drift, out = DRIFT * max(abs(problem.grid.lower[axis]), abs(problem.grid.upper[axis])), np.zeros(len(widths))
    at = displaced.axes.index(axis)
    if not displaced.scales[at]:  # no input moves it, but what cannot be chosen
        low, high = displaced.moves[at, 0]
        ends = np.ceil((high - drift) / widths) * widths - high, low - np.floor((low + drift) / widths) * widths
        return np.maximum(sum(ends), 0.0) / 2
    some = np.flatnonzero(displaced.scales)
    scales, moves = displaced.scales[some], displaced.moves[some] / displaced.scales[some, None, None]
    own, each = some.tolist().index(at), np.arange(len(displaced.directions))
    share, sign = np.abs(displaced.directions[:, some]), displaced.directions[:, some] > 0
    near = np.where(sign.T[:, :, None], moves[:, None, :, 0], -moves[:, None, :, 1])  # (axes, directions, inputs)
    far = np.where(sign[:, own, None], moves[own, :, 1], -moves[own, :, 0])  # (directions, inputs)
    most = np.einsum("wa,awj->wj", share, near).max(axis=1)
    late = float(not problem.has_no_target and bool(problem.dynamics.reads[:, axis].any()))
    for i, width in enumerate(widths / scales[own]):  # all axes cut alike, in units of what inputs move on them
        told = np.floor(near / width + 1e-9) * width
        along = np.einsum("wa,awj->wj", share, told)
        best = along.argmax(axis=1)
        reached = along[each, best]
        slowed = np.divide(most, np.maximum(reached, most / SLOWED), out=np.ones_like(most), where=most > 0.0)
        soon = share[:, own] ** 2 * np.maximum(most - reached, 0.0) * np.maximum(slowed, 1.0)
        end = far[each, best]
        behind = share[:, own] * (np.ceil(end / width - 1e-9) * width - end)
        out[i] = (soon.sum() + late * behind.sum()) / share[:, own].sum()
    return out * scales[own]


class Displacements(NamedTuple):
    """The inputs' displacements in one interval along the axes with one velocity, and directions to compare them in."""

    axes: list[int]  # the a axes along which the velocity is the same everywhere (`is_steady`)
    # (a, L', 2), the least and the greatest along each by each input, in its unit; alike ones count once
    moves: FloatArray
    scales: FloatArray  # (a,), the range of the inputs' mean displacements; 0 where all inputs are alike
    directions: FloatArray  # (2 n, a), unit vectors in units of these scales, n drawn at random, then their opposites


def _displacements(problem: ReachAvoidProblem) -> Displacements | None:
    """The `Displacements` of a problem, n being `DIRECTIONS`, or 1 along one axis, or None."""
    axes = [axis for axis in range(problem.grid.ndim) if is_steady(problem, axis)]
    if not axes:
        return None
    every = range(len(problem.inputs))
    moves = np.array([[moved_bounds(problem, axis, j) for j in every] for axis in axes], dtype=float)
    moves = np.unique(moves, axis=1)
    scales = np.ptp(moves.mean(axis=2), axis=1)
    scales = np.where(scales > 1e-9 * np.abs(moves).max(axis=(1, 2)), scales, 0.0)
    many = DIRECTIONS if (scales > 0).sum() > 1 else 1
    drawn = np.random.default_rng(0).normal(size=(many, len(axes))) * (scales > 0)
    drawn /= np.maximum(np.linalg.norm(drawn, axis=1, keepdims=True), 1e-300)
    return Displacements(axes, moves, scales, np.concatenate([drawn, -drawn]))


def _crossings(problem: ReachAvoidProblem, left: bool = False) -> FloatArray:
    """m (ndim,): how often lines along each axis cross the boundary of a set, for each unit of length inside it.

    Of what is `left`, unsafe sets alone, for each unit outside.
    """
    grid, out = problem.grid, np.zeros(problem.grid.ndim)
    if not left:
        out = np.isfinite(np.stack(grid.faces("fails"))).sum(axis=0) / np.subtract(grid.upper, grid.lower)
    for part in problem.unsafe if left else problem.all_sets:
        border = _border(problem, part)
        out[list(part.axes)] += border.crossings / max(1.0 - border.inside if left else border.inside, border.least)
    return out


class _Border(NamedTuple):
    """How much of its axes a set takes, and how often lines cross its boundary."""

    inside: float  # the share of the states that are in the set
    crossings: FloatArray  # (d,), for each unit of length along each of the set's axes
    least: float  # the share of a single node at which the set was looked at


def _border(problem: ReachAvoidProblem, part: TargetSet | UnsafeSet) -> _Border:
    """The `_Border` of a set of a problem, counted between nodes of its grid, or of a coarser one of `SET_NODES`."""

    def counted() -> _Border:
        own, steps = problem.grid.subgrid(part.axes), problem.most_steps
        own = replace(own, shape=tuple(min(n, int(SET_NODES ** (1 / own.ndim))) for n in own.shape))
        times = [problem.time(step) for step in (0, steps // 2, steps)] if part.moving else [0.0]
        inside = np.stack([part.level_set(own.points(), t).reshape(own.shape) <= 0.0 for t in times])
        crossed = [np.diff(inside, axis=1 + i).mean() * (n - 1) for i, n in enumerate(own.shape)]
        return read_only(_Border(inside.mean(), crossed / np.subtract(own.upper, own.lower), 1 / own.size))

    return problem.remembered(("border", part), counted)


def speeds_of(problem: ReachAvoidProblem) -> Speeds:
    """The `Speeds` of a problem: bounds on the velocity at `SPEED_STATES` random states and in small boxes there.

    Entries are not finite where a velocity is undefined.
    """
    return problem.remembered("speeds", lambda: read_only(_speeds_of(problem)))


def _speeds_of(problem: ReachAvoidProblem) -> Speeds:
    grid, bounds, t, count = problem.grid, Bounds(problem), problem.time(0), len(problem.inputs)
    size = BOX * np.subtract(grid.upper, grid.lower)
    states = grid.lower + size * np.random.default_rng(0).uniform(0.0, 1 / BOX - 1, (SPEED_STATES, grid.ndim))
    wider, ends = np.zeros((grid.ndim, grid.ndim)), np.empty((2, count, SPEED_STATES, grid.ndim))
    jacobians, unit = np.zeros((SPEED_STATES, grid.ndim, grid.ndim)), np.eye(grid.ndim)
    for j in range(count):
        own = slice(j, None, count)  # of some states, under this input
        at, here = states[own], ends[:, j, own]
        ends[:, j] = least, most = bounds.velocity(j, states, states, t, t)
        for k in np.flatnonzero(problem.dynamics.reads.any(axis=0)):
            low, high = bounds.velocity(j, states, states + size * unit[k], t, t)
            wider[:, k] += np.mean((high - low) - (most - least), axis=0) / size[k] / count
            if len(at):
                there = np.array(bounds.velocity(j, at + size * unit[k], at + size * unit[k], t, t))
                jacobians[own, :, k] = (there - here).mean(axis=0) / size[k]
    extremes = np.stack([ends[0].min(axis=(0, 1)), ends[1].max(axis=(0, 1))])
    widths = (ends[1] - ends[0]).mean(axis=(0, 1))
    return Speeds(np.maximum(wider, 0.0), widths, extremes, jacobians, _displacements(problem))


def cost(problem: ReachAvoidProblem, axes: tuple[CellAxis, ...], parts: int, speeds: Speeds) -> tuple[float, float]:
    """The seconds of one core that preparing a proof takes, and those of the recursion."""
    each = costs(problem, axes, parts, speeds)
    return each["intervals"] + each["unsafe sets"] + each["arrivals"], each["recursion"]


def costs(problem: ReachAvoidProblem, axes: tuple[CellAxis, ...], parts: int, speeds: Speeds) -> dict[str, float]:
    """Seconds of one core that each part of a solve takes: "intervals", "unsafe sets", "arrivals", "recursion".

    Counts of operations times the constants of this module, so the same on every machine.
    """
    depends = place_axes(problem, axes)
    moves = moves_of(problem, axes, depends)[1]
    starts, count, places, ndim = moves
    times = problem.most_steps if any(one.moving for one in problem.unsafe) else starts
    each = parts * starts * count
    calls, pieces = (each * finest(problem, parts, some) for some in ((starts, count, 1, ndim), moves))
    drift = problem.dynamics.drift
    velocity = drift if isinstance(drift, BlackBox) else problem.dynamics.functions_by_input["drift"][0]
    return {
        # as many calls as of a single place, so that more cells never cost less
        "intervals": PIECE * calls + pieces * places * (AXIS * ndim + OPERATION * _operations(velocity)),
        "unsafe sets": _cost_of_sets(problem, axes, depends, (starts, times, parts), speeds),
        "arrivals": _cost_of_arrivals(problem, axes, depends),
        "recursion": _cost_of_recursion(problem, axes, depends, speeds),
    }


def _cost_of_sets(
    problem: ReachAvoidProblem,
    axes: tuple[CellAxis, ...],
    depends: FloatArray,
    often: tuple[int, int, int],
    speeds: Speeds,
) -> float:
    """Seconds to mark the cells of which tubes may meet an unsafe set, or leave by an unsafe end."""
    # of moves, of clear inputs, and of an interval
    (starts, times, parts), count, out = often, len(problem.inputs), 0.0
    cells = math.prod(axis.count for axis in axes)

    def asked(axes_of: Iterable[int]) -> float:
        # one of those that are alike
        return cells / math.prod(axis.count for k, axis in enumerate(axes) if not depends[k] and k not in axes_of)

    for unsafe_set in problem.unsafe:
        if in_words(problem, depends, axes, unsafe_set, parts):
            out += _cost_in_words(problem, axes, unsafe_set, often, speeds)
            continue
        tubes = asked(unsafe_set.axes) * count * (times if unsafe_set.moving else starts)
        out += _cost_by_cells(problem, axes, depends, unsafe_set, parts, speeds, tubes)
    out += GONE * cells * count * starts if problem.grid.has("frees") else 0.0
    unsafe = np.flatnonzero(np.isfinite(problem.grid.faces("fails")).any(axis=0))
    return out + (AT_ENDS * asked(unsafe) * count * starts if unsafe.size else 0.0)


def _cost_by_cells(
    problem: ReachAvoidProblem,
    axes: tuple[CellAxis, ...],
    depends: FloatArray,
    unsafe_set: UnsafeSet,
    parts: int,
    speeds: Speeds,
    tubes: float,
) -> float:
    """Seconds to mark the cells of which `tubes` may meet an unsafe set, by the corners of tubes in sums of boxes."""
    own, border = list(unsafe_set.axes), _border(problem, unsafe_set)
    spans = parts * problem.most_steps if unsafe_set.moving else 1  # of which each has boxes of its own
    counts, widths = np.array([axes[k].count for k in own]), np.array([float(axes[k].width) for k in own])
    summed = float(counts.prod() * spans)
    summed = max(min(BOXES_OF_A_SET, summed * PIECES_OF_A_CELL ** len(own)), summed)
    free = np.flatnonzero(~depends[own])
    length = int(counts[free[-1]]) if free.size else 1
    segment = min(SEGMENT, length)
    moved = problem.delta / 4 * np.abs(speeds.extremes[:, own]).max(axis=0)  # half of the farthest, half of them away
    beside = min(float(border.crossings @ (moved + widths)), 1.0)
    close = float((border.crossings * widths)[free[-1]]) * (segment - 1) if free.size else 0.0
    met = [min(border.inside + beside + more, 1.0) for more in (close, 0.0)]
    corners = 2 ** len(own) * (1 / segment + sum(met) + (parts - 1) / 2 * beside)  # until they are met
    along = 1 + (parts - 1) * min(beside * length / segment, 1.0)  # how often a line is looked at
    far = min(summed / spans / IN_CACHE, 1.0) * min((summed / spans / counts.prod()) ** (1 / len(own)) / BESIDE, 1.0)
    out = CELL + LINE_OF_CELLS * along / length + corners * (CORNER + FAR_CORNER * far)
    return float(out * tubes) + summed * (SUMMED + BOXED * _operations(unsafe_set.level_set))


def _cost_in_words(
    problem: ReachAvoidProblem,
    axes: tuple[CellAxis, ...],
    unsafe_set: UnsafeSet,
    often: tuple[int, int, int],
    speeds: Speeds,
) -> float:
    """Seconds to mark the cells of which tubes may meet an unsafe set, 64 at a time (`word_tubes.in_words`)."""
    # as in `_cost_of_sets`
    (starts, times, parts), count, cells = often, len(problem.inputs), math.prod(axis.count for axis in axes)
    spans = times * parts if unsafe_set.moving else 1
    own, alike = [axes[k] for k in unsafe_set.axes], np.isin(unsafe_set.axes, _moved_alike(speeds))
    boxes = math.prod(axis.count for axis in own) * spans * math.prod(pieces_of(own, alike, spans).tolist())
    bits = BIT * cells * count * (times if unsafe_set.moving else starts)
    # blocks of boxes are bounded first, and what is in them where they hold a part of the boundary
    beside = min(float(_border(problem, unsafe_set).crossings @ [float(axis.width) for axis in own]), 1.0)
    each = (BOXED_IN_WORDS + BOXED_BESIDE * beside) * _operations(unsafe_set.level_set)
    return each * boxes + WORD * size_in_words(axes) * count * parts * starts + bits


def _cost_of_arrivals(problem: ReachAvoidProblem, axes: tuple[CellAxis, ...], depends: FloatArray) -> float:
    """Seconds to judge which images lie in the target; 0 where images are judged by cells alone."""
    times, sites, _ = sites_of(problem, axes, depends)[1]
    if not times:
        return 0.0
    each = NEAR * len(problem.target.axes) + ARRIVAL * _share_inside(problem)
    return sites * times * len(problem.inputs) * each


def _share_inside(problem: ReachAvoidProblem) -> float:
    """The share of the states, from 0 to 1, that are in the target at the first time; by `SET_STATES` random states."""

    def found() -> float:
        own = problem.grid.subgrid(problem.target.axes)
        points = np.random.default_rng(0).uniform(own.lower, own.upper, (SET_STATES, own.ndim))
        return float((problem.target.level_set(points, problem.time(0)) <= 0.0).mean())

    return problem.remembered("share inside the target", found)


def _cost_of_recursion(
    problem: ReachAvoidProblem, axes: tuple[CellAxis, ...], depends: FloatArray, speeds: Speeds
) -> float:
    """Seconds of the recursion: in each entry every cell, and the rows of its image, or of that of 64 in a word."""
    steps = problem.steps or losing_steps(problem, speeds)
    entries = float(min(steps, CHANGING)) if problem.time_invariant else steps * (steps + 1) / 2
    cells = math.prod(axis.count for axis in axes)
    if goes_along(problem, depends, range(len(axes))):
        return entries * IN_WORDS * size_in_words(axes) * len(problem.inputs)
    packed = packed_axis(problem.grid, axes, depends)
    alone = depends[packed] or problem.grid.has("frees")
    widths, counts = np.array([float(axis.width) for axis in axes]), [axis.count for axis in axes]
    whole = cells / counts[packed] * in_whole_words(counts[packed])  # part of a word takes as long
    # for ever
    if problem.steps is None and (alone or problem.dynamics.reads.any(axis=1).all()):
        return cells * KEPT if alone else whole * CREEPING
    image = np.minimum(2 + problem.delta * (speeds.widths + speeds.wider @ widths) / widths, counts)
    rows = math.sqrt(len(problem.inputs) * float(np.delete(image, packed).prod()))
    return entries * (cells * ENTRY + (cells * ROW_OF_A_CELL if alone else whole * ROW) * rows)


def in_whole_words(count: int) -> int:
    """A number of cells rounded up to whole words of 64: of 65 cells 128."""
    return -(-count // 64) * 64


def _moved_alike(speeds: Speeds) -> list[int]:
    """The numbers of the axes along which there is one velocity, the same under all inputs."""
    some = speeds.displacements
    return [] if some is None else [axis for axis, scale in zip(some.axes, some.scales, strict=True) if not scale]


def _operations(function: Any) -> int:
    """How many operations a function costs for a point: those of its graph, a look-up in a table as `LOOK_UP` more."""
    if isinstance(function, BlackBox):
        return BLACK_BOX

    def counted() -> int:
        operations = [one.op for one in ordered(function.outputs)]
        return len(operations) + LOOK_UP * operations.count("gridded")

    return int(function.remembered("operations", counted))
