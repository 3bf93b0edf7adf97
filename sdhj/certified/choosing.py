"""How many cells each axis gets where nobody says: by a rule, and as many as the seconds and the memory pay for.

Where a set's boundary moves inwards by w along axis k, the set loses the share m_k w of itself: m_k counts how often
lines along the axis cross the boundary, for each unit of length that they are inside. In each step the image of a cell
of width w is wider than the cell, along axis i by delta |J_ik| w, J the Jacobian of the velocity, and it is rounded out
to whole cells, but for axes with one velocity, on which cells are aligned with what an interval does. With S steps, c_k
w is lost to the width of axis k: c_k = m_k + S (m_k + delta sum_i m_i |J_ik|), without the second m_k on those axes.

Where all axes lose alike c_k w_k is the same of all. But losses are not linear where cells are wide: so the numbers of
cells are in proportion to (c_k times the length of the axis) to the power `SHARPNESS`. Two numbers are not free:

- On an axis with one velocity an input that passes 2.9 cells leads 2 cells on. It has the fewest cells of which an
  input that moves it about as far as any passes a whole number.
- Sets are packed, 64 cells in a word, and a word that is half full takes as long. The axis has whole words.

What a solve takes (`seconds_taken`) is a count of what is computed, times the seconds that each took where this was
written. It is no clock, so a problem has the same cells on every machine. `python figures/studies/costs.py counted`
prints it beside the seconds that a solve took.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from sdhj.certified.bounds import Bounds
from sdhj.certified.cells import CellAxis, aligned, is_steady, moved_bounds
from sdhj.certified.dangers import dangers_of
from sdhj.certified.general_proof import finest, peak_bytes
from sdhj.certified.images import moves_of, place_axes
from sdhj.certified.packing import packed_axis
from sdhj.common.remembering import FloatArray, read_only
from sdhj.formulas.formula import BlackBox
from sdhj.formulas.graph import ordered
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sets import TargetSet, UnsafeSet

SPEED_STATES = 256  # states around which velocities are bounded
BOX = 1 / 64  # of an axis, the width of these boxes
SET_NODES = 1_000_000  # at which a set is looked at, at most
SHARPNESS = 2 / 3  # of nine robots
FEWEST, TRIALS = 2, 24  # cells of an axis; halvings
MOST_OF_AN_AXIS = 2**15 - 1  # cells, as many as an interval may lead on at most
FAR = 0.9  # of what the fastest input moves a coordinate: others that move it about as far
ROUNDED = 1.05  # times the seconds may be taken where a number of cells is rounded
WORTH = 0.03  # to lose less is not worth more cells
MOST_BYTES = 4_000_000_000  # without the blocks of the sets that are found
CORES = 1.6 / 1.2  # that two are worth
FOREVER = 50  # steps that count where sets shrink until they are kept
CHANGING = 250  # entries of the recursion that count, at most, as of later ones only what has changed is asked anew
# seconds: for a call, an axis of a box and an operation of the velocities; for a cell, an input and an unsafe set; and
# in the recursion for a cell of an entry, and for the root of the inputs, as most cells are done with at once, where 64
# cells are led at once and where each is led by itself
CALL, AXIS, OPERATION, CLEAR, ENTRY, IN_WORDS, BY_ITSELF = 3e-4, 1.2e-7, 1.2e-8, 3e-8, 1.5e-9, 1e-9, 6e-9
BLACK_BOX, LOOK_UP = 100, 50  # operations


class Speeds(NamedTuple):
    """What is known of the velocities, at random states and under all inputs."""

    # (ndim, ndim), the mean of |J|: by how much bounds on velocity i widen for each unit of a box along axis k
    wider: FloatArray
    fastest: FloatArray  # (ndim,), the greatest of all states, inputs and disturbances


def chosen_cells(problem: ReachAvoidProblem, parts: int, seconds: float) -> tuple[int, ...]:
    """The number of cells on each axis, before they are aligned, whose solve takes about `seconds` s on two cores."""
    fixed, extent = dict[int, int](), np.subtract(problem.grid.upper, problem.grid.lower)
    lost = lost_to_width(problem) * extent  # by one cell as wide as the axis
    # an axis along which nothing is lost counts a little, too: numbers of cells are powers of this
    lost = np.maximum(lost, 1e-3 * lost.max(initial=1e-300))
    most = int(MOST_OF_AN_AXIS / max(_lengths_led(problem), 1.0))

    def pays(cells: tuple[int, ...], seconds: float) -> bool:
        axes = aligned(problem, cells)
        small = peak_bytes(problem, axes, parts) < MOST_BYTES
        return small and sum(seconds_taken(problem, axes, parts)) < CORES * seconds

    def spread(given: Mapping[int, int]) -> tuple[int, ...]:
        # As many cells as are paid for, with the numbers `given` of some axes: by bisection of the exponent of a factor
        # that all axes share. While none are paid for, they are the last that were tried, which are the fewest.
        low, high, paid, cells = -20.0, 40.0, False, tuple[int, ...]()
        for _ in range(TRIALS):
            middle = (low + high) / 2
            wish = np.clip(lost**SHARPNESS * 2**middle, FEWEST, most).round().astype(int).tolist()
            some = tuple(given.get(axis, count) for axis, count in enumerate(wish))
            if float((lost / some).sum()) > WORTH and pays(some, seconds):
                low, paid, cells = middle, True, some
            else:
                high, cells = middle, cells if paid else some
        return cells

    def loses(cells: tuple[int, ...]) -> tuple[bool, float]:
        return not pays(cells, ROUNDED * seconds), float((lost**SHARPNESS / cells).sum())

    cells, led = spread(fixed), _led(problem)
    for axis in sorted(led, key=lambda axis: -cells[axis] * led[axis] / extent[axis]):  # those led most cells on first
        whole = max(round(cells[axis] * led[axis] / extent[axis]), 1)
        given = fixed | {axis: min(math.ceil(whole * extent[axis] / led[axis] * (1 - 1e-9)), most)}
        if pays(some := spread(given), ROUNDED * seconds):
            cells, fixed = some, given
    axes = aligned(problem, cells)
    depends = place_axes(problem, axes)
    packed = packed_axis(problem.grid, axes, depends)
    if packed not in fixed and not depends[packed]:
        words = min(64 * max(round(cells[packed] / 64), 1), most)
        cells = min(cells, spread(fixed | {packed: words}), key=loses)
    return cells


def lost_to_width(problem: ReachAvoidProblem) -> FloatArray:
    """c (ndim,): what a set loses of itself for each unit of the width of an axis's cells, in all steps together."""
    m, steps = _crossings(problem), losing_steps(problem)
    wider = np.where(np.isfinite(speeds_of(problem).wider), speeds_of(problem).wider, 0.0)
    rounded = np.array([not is_steady(problem, axis) for axis in range(m.size)])
    return np.asarray(m + steps * (m * rounded + problem.delta * m @ wider))


def _led(problem: ReachAvoidProblem) -> dict[int, float]:
    """{axis: a distance}, of each axis with one velocity that is surely moved.

    It is the least distance that an input is sure to lead it in an interval, of those that move it at least `FAR` times
    as far as the fastest.
    """
    out = dict[int, float]()
    for axis in (k for k in range(problem.grid.ndim) if is_steady(problem, k)):
        ends = np.array([moved_bounds(problem, axis, j) for j in range(len(problem.inputs))], float)
        # Twice the distance in the middle, by which inputs that hardly move the axis are left out.
        far = np.abs(ends.sum(axis=1))
        # Below 0 where it may be moved either way: then it is not surely led.
        sure = np.maximum(ends[:, 0], -ends[:, 1])[far >= FAR * far.max()].min()
        out |= {axis: float(sure)} if sure > 1e-9 * (problem.grid.upper[axis] - problem.grid.lower[axis]) else {}
    return out


def losing_steps(problem: ReachAvoidProblem) -> int:
    """The number of steps over which losses are added up: until the slowest moving coordinate has crossed its axis."""
    fastest, extent = speeds_of(problem).fastest, np.subtract(problem.grid.upper, problem.grid.lower)
    longest = (extent / np.where(fastest > 0, fastest, np.inf)).max() / problem.delta
    # refused where its bounds are asked for
    if not math.isfinite(longest):
        return 1
    return int(min(problem.most_steps, max(math.ceil(longest), 1)))


def _lengths_led(problem: ReachAvoidProblem) -> float:
    """How many times its axis a coordinate moves in an interval, about twice of the most."""
    extent = np.subtract(problem.grid.upper, problem.grid.lower)
    led = 2 * problem.delta * float((speeds_of(problem).fastest / extent).max())
    return led if math.isfinite(led) else 0.0


def seconds_taken(problem: ReachAvoidProblem, axes: tuple[CellAxis, ...], parts: int) -> tuple[float, float, float]:
    """The seconds of one core that images, clear inputs and the recursion of a solve with cells `axes` take."""
    depends, count = place_axes(problem, axes), len(problem.inputs)
    moves = moves_of(problem, axes, depends)[1]
    starts, _, places, ndim = moves
    calls, pieces = (parts * starts * count * finest(problem, parts, (starts, count, n, ndim)) for n in (1, places))
    velocity = problem.dynamics.drift
    if not isinstance(velocity, BlackBox):
        # of input 0, as those of others take about as long
        velocity = problem.dynamics.functions_by_input["drift"][0]
    images = CALL * calls + pieces * places * (AXIS * ndim + OPERATION * _operations(velocity))
    asked, most = 0, problem.most_steps
    for one in dangers_of(problem):
        times = [most if problem.unsafe[number].moving else starts for number in one.sets] + [starts] * bool(one.ends)
        asked += math.prod(axes[k].count for k in one.axes) * sum(times)
    steps = problem.steps or FOREVER
    entries = min(steps, CHANGING) if problem.time_invariant else steps * (steps + 1) / 2
    cells, packed = math.prod(axis.count for axis in axes), packed_axis(problem.grid, axes, depends)
    alone = depends[packed] or problem.grid.has("frees")
    at_once = cells if alone else cells // axes[packed].count * -(-axes[packed].count // 64) * 64  # in whole words
    each = at_once * (BY_ITSELF if alone else IN_WORDS) * math.sqrt(count)
    return images, CLEAR * count * asked, entries * (ENTRY * cells + each)


def _operations(function: Any) -> int:
    """How many operations a function costs for a point: those of its graph, a look-up in a table as `LOOK_UP` more."""
    if isinstance(function, BlackBox):
        return BLACK_BOX

    # Kept with the function, as many numbers of cells are compared and it costs a walk over its graph.
    def counted() -> int:
        operations = [one.op for one in ordered(function.outputs)]
        return len(operations) + LOOK_UP * operations.count("gridded")

    return int(function.remembered("operations", counted))


def _crossings(problem: ReachAvoidProblem) -> FloatArray:
    """m (ndim,): how often lines along each axis cross the boundary of a set, for each unit of length inside it."""
    grid = problem.grid
    out = np.isfinite(np.stack(grid.faces("fails"))).sum(axis=0) / np.subtract(grid.upper, grid.lower)
    for part in problem.all_sets:
        out[list(part.axes)] += problem.remembered(("crossings", part), partial(_crossings_of, problem, part))
    return np.asarray(out)


def _crossings_of(problem: ReachAvoidProblem, part: TargetSet | UnsafeSet) -> FloatArray:
    """m of one set, (d,), counted between nodes of the grid of its axes, or of a coarser one of `SET_NODES`."""
    own, steps = problem.grid.subgrid(part.axes), problem.most_steps
    own = replace(own, shape=tuple(min(n, int(SET_NODES ** (1 / own.ndim))) for n in own.shape))
    times = [problem.time(step) for step in (0, steps // 2, steps)] if part.moving else [0.0]
    inside = np.stack([part.level_set(own.points(), t).reshape(own.shape) <= 0.0 for t in times])
    crossed = [np.diff(inside, axis=1 + i).mean() * (n - 1) for i, n in enumerate(own.shape)]
    # A set that no node is in counts as one of one node.
    return read_only(crossed / np.subtract(own.upper, own.lower) / max(inside.mean(), 1 / own.size))


def speeds_of(problem: ReachAvoidProblem) -> Speeds:
    """The `Speeds` of a problem, at `SPEED_STATES` random states and in small boxes there."""
    return problem.remembered("speeds", lambda: read_only(_speeds_of(problem)))


def _speeds_of(problem: ReachAvoidProblem) -> Speeds:
    grid, bounds, t, count = problem.grid, Bounds(problem), problem.time(0), len(problem.inputs)
    size = BOX * np.subtract(grid.upper, grid.lower)
    # always the same, so that a problem has the same cells at each solve
    states = grid.lower + size * np.random.default_rng(0).uniform(0.0, 1 / BOX - 1, (SPEED_STATES, grid.ndim))
    wider, fastest, unit = np.zeros((grid.ndim, grid.ndim)), np.zeros(grid.ndim), np.eye(grid.ndim)
    for j in range(count):
        least, most = bounds.velocity(j, states, states, t, t)
        fastest = np.maximum(fastest, np.maximum(np.abs(least), np.abs(most)).max(axis=0))
        for k in np.flatnonzero(problem.dynamics.reads.any(axis=0)):
            low, high = bounds.velocity(j, states, states + size * unit[k], t, t)
            wider[:, k] += np.mean((high - low) - (most - least), axis=0) / size[k] / count
    return Speeds(np.maximum(wider, 0.0), fastest)
