"""Cells of a certified set, axis by axis, in exact arithmetic.

A certificate must not depend on how a machine rounds 0.3 * 0.1. So the numbers of a problem are read as the decimals
they are written as (times a power of two, so that units of these make no difference), and cells, velocities and moves
are `Fraction`s. Where cells are a whole fraction of what the disturbance moves the state in one interval, the image of
a cell is a whole number of cells and nothing is lost to rounding it outward: `aligned_width` picks such cells. An image
counts as in cells that it exceeds by `DRIFT`.

A periodic axis may have a period that no fraction is, 2 pi. It is then known to lie in an interval, narrow against
`DRIFT`; the cells are whole from the lower end on, and the last one, the *seam cell*, is what is left.

Where a coordinate is held at a wall, as the speed of a car that cannot go back, there is a cell of no width, a *layer*:
the states at the wall itself. Who brakes from the lowest cell ends there, and from there moves nothing; in the lowest
cell, which reaches up to its whole width, it would count as moving on for ever. An image is a layer's only where all of
it is held at the wall.

Where measurements err nobody sees that a state is at a wall, but a controller that remembers may know it: all that its
point can have led to is held there. For it the state of a layer is at the wall, and errs along the other axes alone. A
point is in a layer only if it says so, by lying half a shell behind the wall; a measurement, clipped to the grid, never
does (`Cells.told`).
"""

import math
import re
import reprlib
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sdhj.kernels import read_only
from sdhj.kernels.packed import Cells
from sdhj.problem.grid import Grid
from sdhj.problem.problem import ReachAvoidProblem

IndexArray = NDArray[np.int64]

MOST_CELLS = 10**6  # of an axis in a file
MOST_PIECES = 10_000  # parts of an interval
UNCOUNTABLE = 2.0**40  # cells: farther than any image that is kept
DRIFT = 1e-13  # of the largest coordinate of an axis, in one step; FOREVER steps of it are STATE_SLACK
EXACT_DIGITS = 14  # a decimal with more significant digits than this is a rounded number, such as that of pi
FEW_DIGITS = 8  # and with fewer than these a number that twelve digits of a rounded one are
POWERS = range(-40, 41)  # of two, in which decimals are looked for


def exact(value: float) -> Fraction:
    """The decimal that `value` is written as: 0.3 means three tenths, and 0.3 / 1024 what that divided by 1024 is.

    Of all decimals, times powers of two, that are this number when rounded, the one of fewest digits: so what is
    scaled by a power of two is read as what it was, scaled. The number itself where they all have many digits.
    """
    return _decimal(float(value), "", EXACT_DIGITS) or Fraction(value)


def measured(value: float) -> Fraction:
    """A number exactly, or the short decimal that its twelve digits are: 0.6000000000000001 means six tenths."""
    short = _decimal(float(value), "", EXACT_DIGITS)
    return short or _decimal(float(value), ".12g", FEW_DIGITS) or Fraction(value)


@lru_cache(maxsize=4096)
def _decimal(value: float, form: str, most: int) -> Fraction | None:
    """The decimal, times a power of two, that a number is; None where it has more than `most` significant digits.

    form : how the digits are written (`format`): "" for all of them, ".12g" for twelve.
    A number is off by half a unit in the last place at most where all its digits are written, else by 5e-13 of it.
    """
    part, power = math.frexp(value)
    tried = [(value, 0), *((math.ldexp(part, by), power - by) for by in POWERS)]
    found = [(_digits(text := format(one, form) if form else repr(one)), text, by) for one, by in tried]
    digits, text, by = min(found)
    return Fraction(text) * Fraction(2) ** by if digits <= most else None


def _digits(text: str) -> int:
    """How many significant digits the text of a decimal has, zeros at both ends apart: 2 of "-0.0120e5"."""
    return len(text.lower().split("e")[0].lstrip("-").replace(".", "").strip("0"))


def period_bounds(lower: float, upper: float) -> tuple[Fraction, Fraction]:
    """An interval that holds the period upper - lower; a point where both ends are short decimals."""
    period = exact(upper) - exact(lower)
    short = all(_decimal(float(end), "", EXACT_DIGITS) is not None for end in (lower, upper))
    doubt = Fraction(0) if short else period / 2**49  # obligation 1.4
    return period - doubt, period + doubt


@dataclass(frozen=True)
class CellAxis:
    """The cells of one axis: [lower + i * width, lower + (i + 1) * width], the last one cut at the upper end.

    A periodic axis may have a length that is known up to an interval only, a bounded one has not. Where there are
    layers, one before the first of these cells, one behind the last, they count as cells.
    """

    lower: Fraction
    extent: tuple[Fraction, Fraction]  # bounds on the length of the axis
    width: Fraction
    periodic: bool
    layers: tuple[int, int] = (0, 0)  # how many there are at the lower and at the upper end

    def __post_init__(self) -> None:
        """ValueError where the cells do not cover the axis with each of them needed."""
        if (self.count - sum(self.layers) - 1) * self.width >= self.extent[0]:
            raise ValueError(
                "the last cell is narrower than the doubt about the period; choose another number of cells"
            )

    @property
    def count(self) -> int:
        """How many cells there are."""
        return math.ceil(self.extent[1] / self.width) + sum(self.layers)

    @cached_property
    def scale(self) -> float:
        """The largest absolute coordinate, to which rounding and all that is allowed for it are relative."""
        return float(max(abs(self.lower), abs(self.lower + self.extent[1])))

    def edges(self) -> NDArray[np.float64]:
        """Edges of the cells, shape (count + 1,), each rounded to the nearest float."""
        return _edges(self)

    def shares(self) -> NDArray[np.float64]:
        """Each cell's share of the length of the axis, shape (count,)."""
        if any(self.layers):
            return np.diff(self.edges()) / float(self.extent[0])
        lengths = np.full(self.count, float(self.width))
        lengths[-1] = float(sum(self.extent) / 2 - (self.count - 1) * self.width)
        return lengths / lengths.sum()

    def image(self, back: Fraction, ahead: Fraction) -> tuple[IndexArray, IndexArray]:
        """Which cells cover everything reachable from each cell that is moved by something in [back, ahead].

        Returns
        -------
        first, number : (count,) int64
            Cell i ends up inside the cells first[i], first[i] + 1, ..., first[i] + number[i] - 1, modulo `count`. At
            the ends of a bounded axis it is clipped.
        """
        cell = np.arange(self.count)
        first, last = (cell + by for by in self.moved(cell, float(back), float(ahead), True))  # obligation 2.23
        if not self.periodic:
            first, last = (np.clip(end, 0, self.count - 1) for end in (first, last))
        return first % self.count, np.minimum(last - first + 1, self.count)

    def moved(self, cell: IndexArray, low: Any, high: Any, known: bool) -> tuple[IndexArray, IndexArray]:
        """The first and the last cell, from its own on, that a cell overlaps whose ends have moved: two (M,) int64.

        low, high : how far the ends of each cell moved, (M,) or alike for all
        known : whether the cells (M,) are these; otherwise any, and the answer is that of a cell of full width
        """
        width, drift = float(self.width), DRIFT * self.scale
        if any(self.layers):
            return self._moved_to_walls(cell, low + drift, high - drift)
        if not known or not self.periodic:  # obligation 2.20
            first, last = np.floor((low + drift) / width), np.ceil((high - drift) / width)  # obligation 2.19
            return _counted(first), _counted(np.maximum(last, first))
        length, edges = float(sum(self.extent) / 2), self.edges() - float(self.lower)
        begin, end = edges[cell] + low + drift, edges[cell + 1] + high - drift
        laps = np.floor(begin / length), np.floor(end / length)
        first = laps[0] * self.count + np.minimum(np.floor((begin - laps[0] * length) / width), self.count - 1)
        # obligation 2.24
        last = laps[1] * self.count + np.minimum(np.ceil((end - laps[1] * length) / width), self.count) - 1
        return _counted(first - cell), _counted(np.maximum(last, first) - cell)

    def _moved_to_walls(self, cell: IndexArray, low: Any, high: Any) -> tuple[IndexArray, IndexArray]:
        """The first and last cell, from its own on, that a cell overlaps whose ends moved by low and high: two (M,).

        `moved`, on an axis with layers: what is held at a wall as a whole is in its layer, and nothing else is.
        """
        width, length, (lower, upper) = float(self.width), float(self.extent[0]), self.layers
        edges, last = self.edges() - float(self.lower), self.count - 1
        begin, end = edges[cell] + low, edges[cell + 1] + high
        a, b = np.floor(begin / width) + lower, np.ceil(end / width) - 1 + lower  # obligation 2.3
        b = np.maximum(a, b)
        if lower:
            a, b = (np.where(end <= 0.0, 0, np.maximum(one, 1)) for one in (a, b))  # obligation 2.1
        if upper:
            a, b = (np.where(begin >= length, last, np.minimum(one, last - 1)) for one in (a, b))  # obligation 2.2
        return _counted(a - cell), _counted(b - cell)


def _counted(cells: NDArray[np.float64]) -> IndexArray:
    """Numbers of cells as integers; what is too large for one, which has no defined integer, as `UNCOUNTABLE`."""
    return np.nan_to_num(np.clip(cells, -UNCOUNTABLE, UNCOUNTABLE), nan=UNCOUNTABLE).astype(np.int64)


@lru_cache(maxsize=64)
def _edges(axis: CellAxis) -> NDArray[np.float64]:
    """The ends of the cells of an axis, ascending, (count + 1,); layers have width 0."""
    (lower, upper), end = axis.layers, float(axis.lower + sum(axis.extent) / 2)
    inner = [float(axis.lower + i * axis.width) for i in range(axis.count - lower - upper)]
    return read_only(np.array([*inner[:lower], *inner, end, *[end] * upper]))


def axis_of(grid: Grid, axis: int, width: Fraction, layers: tuple[int, int] = (0, 0)) -> CellAxis:
    """The cells of a width on an axis of a grid, with that many layers at its ends; ValueError as of `CellAxis`."""
    lower, upper, periodic = grid.lower[axis], grid.upper[axis], grid.periodic[axis]
    extent = period_bounds(lower, upper) if periodic else (exact(upper) - exact(lower),) * 2
    return CellAxis(exact(lower), extent, width, periodic, layers)


def sees_walls(problem: ReachAvoidProblem) -> bool:
    """Whether a controller sees that a state is at a wall: nothing that it measures is off."""
    return not (np.any(problem.sensing.error) or problem.sensing.delay)


def layers_of(problem: ReachAvoidProblem, axis: int) -> tuple[int, int]:
    """How many layers there are at the lower and upper end of an axis: 1 at each wall where a velocity depends on it.

    0 where measurements err and nobody remembers: then it is not known whether a state is at the wall.
    """
    grid, known = (
        problem.grid,
        (problem.sensing.remembers or sees_walls(problem)) and problem.dynamics.reads[:, axis].any(),
    )
    # obligation 1.3
    lower, upper = (int(known and holds) for holds in grid.ends_where("holds")[:, axis])
    return lower, upper


def axis_in_file(grid: Grid, axis: int, width: Any, count: Any, layers: Any = (0, 0)) -> CellAxis:
    """The cells of an axis that a file states: their width, a text such as "1/3", how many, and layers at both ends.

    ValueError where they do not cover the axis, are more than `MOST_CELLS`, or have layers at an end that is no wall.
    """
    walls = grid.ends_where("holds")[:, axis].tolist()
    if not isinstance(layers, list | tuple) or [*layers] not in [
        [a, b] for a in range(1 + walls[0]) for b in range(1 + walls[1])
    ]:
        raise ValueError(
            f"layers must be 0 or 1 at each wall of axis {axis}, and 0 elsewhere, got {reprlib.repr(layers)}"
        )
    lower, upper = map(int, layers)
    if not isinstance(width, str) or not re.fullmatch("[0-9]{1,300}(/[0-9]{1,300})?", width) or not Fraction(width):
        raise ValueError(f"the width of cells must be a positive fraction, got {reprlib.repr(width)}")
    extent = exact(grid.upper[axis]) - exact(grid.lower[axis])
    fits = 0.5 <= extent / Fraction(width) <= MOST_CELLS
    if not fits or axis_of(grid, axis, Fraction(width), (lower, upper)).count != count:
        raise ValueError(f"{reprlib.repr(count)} cells of width {reprlib.repr(width)} do not cover axis {axis}")
    return axis_of(grid, axis, Fraction(width), (lower, upper))


def cells_of(axes: Sequence[CellAxis], rows: int, told: bool = False) -> Cells:
    """The cells of all axes as arrays for compiled code.

    rows : how many axes number the blocks. told : whether a state is in a layer only where it says so (`Cells`). A
    layer is a cell like any other there, outside the wall: states at the wall are on its border.
    """
    return Cells(
        lower=np.array([float(axis.lower - axis.layers[0] * axis.width) for axis in axes]),
        width=np.array([float(axis.width) for axis in axes]),
        length=np.array([float(sum(axis.extent) / 2 + sum(axis.layers) * axis.width) for axis in axes]),
        layers=np.array([axis.layers for axis in axes], dtype=np.int64).T.copy(),
        counts=np.array([axis.count for axis in axes], dtype=np.int64),
        periodic=np.array([axis.periodic for axis in axes]),
        rows=rows,
        told=told,
    )


def is_steady(problem: ReachAvoidProblem, axis: int) -> bool:
    """Whether the velocity along an axis depends on input and disturbance alone, so that `moved_bounds` has a value.

    With sensing, and dynamics that are not constant, only where the controller remembers.
    """
    dynamics = problem.dynamics
    known = not problem.sensing or problem.sensing.remembers  # what a prediction may be off by does not add up
    return dynamics.constant or (
        bool(dynamics.formulas) and known and not (dynamics.reads[axis].any() or dynamics.timed)
    )


def velocity_bounds(problem: ReachAvoidProblem, axis: int, j: int) -> tuple[Fraction, Fraction]:
    """Least and greatest velocity on one axis under input j, exactly, where the axis `is_steady`; found once."""
    return problem.remembered(("velocity bounds", axis, j), partial(_velocity_bounds, problem, axis, j))


def _velocity_bounds(problem: ReachAvoidProblem, axis: int, j: int) -> tuple[Fraction, Fraction]:
    """See `velocity_bounds`."""
    dynamics = problem.dynamics
    if not dynamics.constant:
        anywhere = np.array(problem.grid.lower)[None]
        least, most = dynamics.range(j, anywhere, anywhere, (0.0, 0.0))
        return measured(least[0, axis]), measured(most[0, axis])
    pushes = zip(dynamics.arrays[1][axis], dynamics.arrays[2], strict=True)
    push = sum((abs(measured(g)) * measured(b) for g, b in pushes), Fraction(0))
    drift = measured(dynamics.arrays[0][j, axis])
    return drift - push, drift + push


def unknown(problem: ReachAvoidProblem, axis: int) -> Fraction:
    """E on one axis, by how much a prediction may be off, exactly: error + delay (fast - slow) / 2; 0 without sensing.

    For constant dynamics, whose velocity under any input lies between slow and fast, as far apart for all.
    """
    if not problem.sensing:
        return Fraction(0)
    sensing, (slow, fast) = problem.sensing, velocity_bounds(problem, axis, 0)  # all inputs are disturbed alike
    error = np.broadcast_to(np.array(sensing.error), (problem.grid.ndim,))[axis]
    return measured(error) + measured(sensing.delay) * (fast - slow) / 2  # obligation 10.1


def moved_bounds(problem: ReachAvoidProblem, axis: int, j: int) -> tuple[Fraction, Fraction]:
    """How far one interval moves a prediction on one axis under input j, at least and at most, exactly, where the axis
    `is_steady`: velocity times any length of the interval, widened by 2 E.

    From the prediction at its begin to any at its end, whenever it ends; with memory, to any that is then carried on,
    which adds no E.
    """
    (slow, fast), memory = velocity_bounds(problem, axis, j), problem.sensing.remembers
    off = 0 if memory else 2 * unknown(problem, axis)
    late = 2 * measured(problem.sensing.jitter)
    spans = measured(problem.delta) - late, measured(problem.delta) + late  # obligation 10.8
    return min(slow * span for span in spans) - off, max(fast * span for span in spans) + off


def aligned_width(extent: Fraction, whole: bool, moves: list[Fraction], wish: int) -> Fraction:
    """A cell width that divides every length in `moves` (and `extent` where `whole`), for about `wish` cells in all.

    Where the lengths have no common measure that gives a sensible number of cells, extent / wish: sound as well, but
    every image is rounded out to whole cells.
    """
    lengths = [abs(move) for move in [*moves, *([extent] if whole else [])] if move != 0]
    if not lengths:
        return extent / wish
    pieces = math.lcm(*(length.denominator for length in lengths))  # of one: every length is a number of such
    measure = Fraction(math.gcd(*(int(length * pieces) for length in lengths)), pieces)
    parts = round(measure * wish / extent)
    if parts < 1 and measure * wish * 2 < extent:
        return extent / wish
    return measure / max(parts, 1)


def aligned(problem: ReachAvoidProblem, cells: Sequence[int]) -> tuple[CellAxis, ...]:
    """The cells of each axis, about so many, of a width that divides how far an interval moves a state, if any does."""
    return tuple(aligned_choices(problem, axis, [wish])[0] for axis, wish in enumerate(cells))


def aligned_choices(problem: ReachAvoidProblem, axis: int, wishes: Sequence[int]) -> list[CellAxis]:
    """The cells of one axis for each wish, about how many there are to be; their width as of `aligned`."""
    grid, moves = problem.grid, set()
    extent = axis_of(grid, axis, Fraction(1)).extent[1]
    for j in range(len(problem.inputs)) if is_steady(problem, axis) else ():
        back, ahead = moved_bounds(problem, axis, j)
        moves |= {(back + ahead) / 2, (ahead - back) / 2}
    widths = [aligned_width(extent, not grid.periodic[axis], list(moves), wish) for wish in wishes]
    return [axis_of(grid, axis, width, layers_of(problem, axis)) for width in widths]
