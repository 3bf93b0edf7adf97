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
does (`Cells.wall_known`).
"""

import math
import re
import reprlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property, lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sdhj.common.remembering import read_only
from sdhj.kernels.packed import Cells
from sdhj.problem.grid import Grid
from sdhj.problem.problem import ReachAvoidProblem

IndexArray = NDArray[np.int64]

MOST_CELLS = 10**6  # of an axis in a file, and so of a solve
MOST_PIECES = 10_000  # parts of an interval
UNCOUNTABLE = 2.0**40  # cells: farther than any image that is kept
DRIFT = 1e-13  # of an axis's largest coordinate, in one step: 1000 of it are STATE_SLACK, two the checker's STICKS
EXACT_DIGITS = 14  # a decimal with more significant digits than this is a rounded number, such as that of pi
FEW_DIGITS = 8  # and with fewer than these a number that twelve digits of a rounded one are
POWERS = range(-40, 41)  # of two, in which decimals are looked for


def as_fraction(value: float) -> Fraction:
    """The decimal that `value` is written as, as a fraction: 0.3 is three tenths.

    Of all decimals times a power of two that round to this float, the one of fewest digits, so 0.3 / 1024 is three
    tenths over 1024; with more than `EXACT_DIGITS` digits the float itself. The checker's `decimal` has to read alike.
    """
    return _decimal(float(value), "", EXACT_DIGITS) or Fraction(value)


def as_rounded_fraction(value: float) -> Fraction:
    """As `as_fraction`, but the decimal may hold to twelve digits only."""
    short = _decimal(float(value), "", EXACT_DIGITS)
    return short or _decimal(float(value), ".12g", FEW_DIGITS) or Fraction(value)


@lru_cache(maxsize=4096)
def _decimal(value: float, form: str, most: int) -> Fraction | None:
    """The decimal, times a power of two, of fewest digits that a number is written as; None for more than `most`."""
    part, power = math.frexp(value)
    tried = [(value, 0), *((math.ldexp(part, by), power - by) for by in POWERS)]
    found = [(_digits(text := format(one, form) if form else repr(one)), text, by) for one, by in tried]
    digits, text, by = min(found)
    return Fraction(text) * Fraction(2) ** by if digits <= most else None


def _digits(text: str) -> int:
    """How many significant digits the text of a decimal has: 2 of "-0.0120e5"."""
    return len(text.lower().split("e")[0].lstrip("-").replace(".", "").strip("0"))


def period_bounds(lower: float, upper: float) -> tuple[Fraction, Fraction]:
    """The least and the greatest that the period upper - lower may be; equal where both are short decimals."""
    period = as_fraction(upper) - as_fraction(lower)
    short = all(_decimal(float(end), "", EXACT_DIGITS) is not None for end in (lower, upper))
    # on both sides: together far less than files may state (`Argument.uncovered`, `KNOWN_TURN` of an arm)
    doubt = Fraction(0) if short else period / 2**49
    return period - doubt, period + doubt


@dataclass(frozen=True)
class CellAxis:
    """The cells of one axis, from its lower end on; the last one is cut at the upper end.

    Cell i is [lower + i * width, lower + (i + 1) * width]. There may be a layer, a cell of no width, before the first
    and behind the last: with one at the lower end this is cell i + 1.
    """

    lower: Fraction
    # the least and the greatest length of the axis; a period may be known up to an interval only
    extent: tuple[Fraction, Fraction]
    width: Fraction
    periodic: bool
    layers: tuple[int, int] = (0, 0)  # how many there are at the lower and at the upper end, 0 or 1

    def __post_init__(self) -> None:
        if (self.count - sum(self.layers) - 1) * self.width >= self.extent[0]:
            raise ValueError(
                "the last cell is narrower than the doubt about the period; choose another number of cells"
            )

    @cached_property
    def count(self) -> int:
        """The number of cells, layers among them; kept, as the choice of cells asks 70,000 times."""
        return math.ceil(self.extent[1] / self.width) + sum(self.layers)

    @cached_property
    def last_is_narrower(self) -> bool:
        """Whether the last cell of a periodic axis is narrower than the others, by more than `DRIFT`."""
        return self.periodic and abs(float(self.count * self.width - self.extent[1])) > DRIFT * self.scale

    @cached_property
    def scale(self) -> float:
        """The largest absolute coordinate on the axis, of which allowances for rounding are a share."""
        return float(max(abs(self.lower), abs(self.lower + self.extent[1])))

    def edges(self) -> NDArray[np.float64]:
        """The ends of the cells, ascending, (count + 1,), each as the nearest float."""
        return _edges(self)

    def shares(self) -> NDArray[np.float64]:
        """Each cell's share of the length of the axis, (count,); a layer has 0."""
        if any(self.layers):
            return np.diff(self.edges()) / float(self.extent[0])
        lengths = np.full(self.count, float(self.width))
        lengths[-1] = float(sum(self.extent) / 2 - (self.count - 1) * self.width)
        return lengths / lengths.sum()

    def image(self, back: Fraction, ahead: Fraction) -> tuple[IndexArray, IndexArray]:
        """The first of the cells that each may be in after a displacement in [back, ahead], and how many: (count,)."""
        cell = np.arange(self.count)
        # for arms alone; the checker has it in fractions (`overlapped`), and an export must have exactly the same cells
        first, last = (cell + by for by in self.moved(cell, float(back), float(ahead), True))
        if not self.periodic:
            first, last = (np.clip(end, 0, self.count - 1) for end in (first, last))
        return first % self.count, np.minimum(last - first + 1, self.count)

    def moved(self, cell: IndexArray, low: Any, high: Any, known: bool) -> tuple[IndexArray, IndexArray]:
        """The first and the last cell that each cell (M,) overlaps after its ends have moved by low and high: offsets.

        What sticks out of a cell by no more than `DRIFT` of the scale counts as inside it. Offsets are not clipped at
        the ends of the axis, unless there are layers, but to `UNCOUNTABLE`. Where the cell is not `known`, it is any
        cell of full width.
        """
        width, drift = float(self.width), DRIFT * self.scale
        if any(self.layers):
            return self._moved_to_walls(cell, low + drift, high - drift)
        if not known or not self.periodic:
            first, last = np.floor((low + drift) / width), np.ceil((high - drift) / width)
            # One cell at least: what has no width and lies on an edge is in the cell above.
            return _whole_cells(first), _whole_cells(np.maximum(last, first))
        length, edges = float(sum(self.extent) / 2), self.edges() - float(self.lower)
        begin, end = edges[cell] + low + drift, edges[cell + 1] + high - drift
        laps = np.floor(begin / length), np.floor(end / length)
        first = laps[0] * self.count + np.minimum(np.floor((begin - laps[0] * length) / width), self.count - 1)
        last = laps[1] * self.count + np.minimum(np.ceil((end - laps[1] * length) / width), self.count) - 1
        return _whole_cells(first - cell), _whole_cells(np.maximum(last, first) - cell)

    def _moved_to_walls(self, cell: IndexArray, low: Any, high: Any) -> tuple[IndexArray, IndexArray]:
        """`moved` on an axis with layers.

        An image is in the layer at a wall where all of it is held at that wall; no other image overlaps a layer.
        """
        # one length will do: an axis with a wall is not periodic
        width, length, (lower, upper) = float(self.width), float(self.extent[0]), self.layers
        edges, last = self.edges() - float(self.lower), self.count - 1
        begin, end = edges[cell] + low, edges[cell + 1] + high
        a, b = np.floor(begin / width) + lower, np.ceil(end / width) - 1 + lower
        b = np.maximum(a, b)
        if lower:
            a, b = (np.where(end <= 0.0, 0, np.maximum(one, 1)) for one in (a, b))
        if upper:
            a, b = (np.where(begin >= length, last, np.minimum(one, last - 1)) for one in (a, b))
        return _whole_cells(a - cell), _whole_cells(b - cell)


def _whole_cells(cells: NDArray[np.float64]) -> IndexArray:
    """Numbers of cells as int64, clipped to +-`UNCOUNTABLE`, as which NaN counts."""
    # so many are refused by `Images.in_cells`, where NaN, or what int64 does not hold, could pass as few
    return np.nan_to_num(np.clip(cells, -UNCOUNTABLE, UNCOUNTABLE), nan=UNCOUNTABLE).astype(np.int64)


@lru_cache(maxsize=64)
def _edges(axis: CellAxis) -> NDArray[np.float64]:
    """The ends of the cells of an axis, ascending, (count + 1,); a layer has width 0."""
    (lower, upper), end = axis.layers, float(axis.lower + sum(axis.extent) / 2)
    # numerators over one denominator: the same floats as of the fractions, in a fiftieth of the time
    over = math.lcm(axis.lower.denominator, axis.width.denominator)
    begin, step = int(axis.lower * over), int(axis.width * over)
    inner = [(begin + i * step) / over for i in range(axis.count - lower - upper)]
    return read_only(np.array([*inner[:lower], *inner, end, *[end] * upper]))


def axis_of(grid: Grid, axis: int, width: Fraction, layers: tuple[int, int] = (0, 0)) -> CellAxis:
    """The cells of this width on an axis of a grid."""
    lower, upper, periodic = grid.lower[axis], grid.upper[axis], grid.periodic[axis]
    extent = period_bounds(lower, upper) if periodic else (as_fraction(upper) - as_fraction(lower),) * 2
    return CellAxis(as_fraction(lower), extent, width, periodic, layers)


def sees_walls(problem: ReachAvoidProblem) -> bool:
    """Whether measurements show that a state is at a wall: without an error and without a delay."""
    return not (np.any(problem.sensing.error) or problem.sensing.delay)


def layers_of(problem: ReachAvoidProblem, axis: int) -> tuple[int, int]:
    """The numbers of layers (lower, upper) of an axis: 1 at a wall if a velocity depends on this coordinate."""
    # as a velocity reads it, it is an axis of a place: `Argument.uncovered` asks that of each axis with a layer
    # else nobody can know that a state is at the wall
    known = (problem.sensing.remembers or sees_walls(problem)) and problem.dynamics.reads[:, axis].any()
    lower, upper = (int(known and holds) for holds in problem.grid.ends_where("holds")[:, axis])
    return lower, upper


def axis_in_file(grid: Grid, axis: int, width: Any, count: Any, layers: Any = (0, 0)) -> CellAxis:
    """The cells of an axis of a grid as a file states them, which may be anything."""
    walls = grid.ends_where("holds")[:, axis].tolist()
    if not isinstance(layers, list | tuple) or [*layers] not in [
        [a, b] for a in range(1 + walls[0]) for b in range(1 + walls[1])
    ]:
        raise ValueError(
            f"layers must be 0 or 1 at each wall of axis {axis}, and 0 elsewhere, got {reprlib.repr(layers)}"
        )
    lower, upper = map(int, layers)
    # At most 300 digits, as numbers of any length would be read from a file at any cost.
    if not isinstance(width, str) or not re.fullmatch("[0-9]{1,300}(/[0-9]{1,300})?", width) or not Fraction(width):
        raise ValueError(f"the width of cells must be a positive fraction, got {reprlib.repr(width)}")
    extent = as_fraction(grid.upper[axis]) - as_fraction(grid.lower[axis])
    # Before cells are counted, as the width that a file states may be any fraction.
    fits = 0.5 <= extent / Fraction(width) <= MOST_CELLS
    if not fits or axis_of(grid, axis, Fraction(width), (lower, upper)).count != count:
        raise ValueError(f"{reprlib.repr(count)} cells of width {reprlib.repr(width)} do not cover axis {axis}")
    return axis_of(grid, axis, Fraction(width), (lower, upper))


def cells_of(axes: Sequence[CellAxis], rows: int, wall_known: bool = False) -> Cells:
    """The cells of all axes as arrays for compiled code, those of all but `rows` leading axes packed into bits."""
    return Cells(
        # A layer has no width, but here it counts as a cell beyond its end. Exports have these numbers (`file_of`), and
        # the checker works them out once more, in `differences`.
        lower=np.array([float(axis.lower - axis.layers[0] * axis.width) for axis in axes]),
        width=np.array([float(axis.width) for axis in axes]),
        length=np.array([float(sum(axis.extent) / 2 + sum(axis.layers) * axis.width) for axis in axes]),
        layers=np.array([axis.layers for axis in axes], dtype=np.int64).T.copy(),
        counts=np.array([axis.count for axis in axes], dtype=np.int64),
        periodic=np.array([axis.periodic for axis in axes]),
        rows=rows,
        wall_known=wall_known,
    )


def is_steady(problem: ReachAvoidProblem, axis: int) -> bool:
    """Whether the velocity along an axis depends on the input and the disturbance alone."""
    dynamics = problem.dynamics
    # The checker has its own of it, `Problem.steady`, for walls on axes of no place: where this says more, a file is
    # refused.
    known = not problem.sensing or problem.sensing.remembers  # what a prediction may be off by does not add up
    return dynamics.constant or (
        bool(dynamics.formulas) and known and not (dynamics.reads[axis].any() or dynamics.depends_on_time)
    )


def velocity_bounds(problem: ReachAvoidProblem, axis: int, j: int) -> tuple[Fraction, Fraction]:
    """The least and the greatest velocity along a steady axis under input j.

    Of constant dynamics drift -+ sum |gain| bounds, of the numbers as `as_rounded_fraction` reads them.
    """
    return problem.remembered(("velocity bounds", axis, j), partial(_velocity_bounds, problem, axis, j))


def _velocity_bounds(problem: ReachAvoidProblem, axis: int, j: int) -> tuple[Fraction, Fraction]:
    dynamics = problem.dynamics
    if not dynamics.constant:
        # The bounds are rounded outward, and taken for the short decimals that they are near: obligation 8 of
        # `sdhj.certified.sets` counts by how much.
        anywhere = np.array(problem.grid.lower)[None]
        least, most = dynamics.velocity_bounds(j, anywhere, anywhere, (0.0, 0.0))
        return as_rounded_fraction(least[0, axis]), as_rounded_fraction(most[0, axis])
    pushes = zip(dynamics.arrays[1][axis], dynamics.arrays[2], strict=True)
    push = sum((abs(as_rounded_fraction(g)) * as_rounded_fraction(b) for g, b in pushes), Fraction(0))
    drift = as_rounded_fraction(dynamics.arrays[0][j, axis])
    return drift - push, drift + push


def prediction_error_along(problem: ReachAvoidProblem, axis: int) -> Fraction:
    """E along one axis of constant dynamics, exactly: error + delay (fast - slow) / 2."""
    if not problem.sensing:
        return Fraction(0)
    # Only constant dynamics come here: of others `is_steady` wants no sensing, or a memory, with which `moved_bounds`
    # does not ask.
    sensing, (slow, fast) = problem.sensing, velocity_bounds(problem, axis, 0)  # all inputs are disturbed alike
    error = np.broadcast_to(np.array(sensing.error), (problem.grid.ndim,))[axis]
    return as_rounded_fraction(error) + as_rounded_fraction(sensing.delay) * (fast - slow) / 2


def moved_bounds(problem: ReachAvoidProblem, axis: int, j: int) -> tuple[Fraction, Fraction]:
    """The least and the greatest displacement of a prediction along a steady axis in an interval under input j.

    Velocity times any length that the interval may have, widened by 2 E, unless the controller remembers.
    """
    # images of arms are made of this (`ArmProof.of`, `overlapped` in the checker); of others it chooses widths alone
    (slow, fast), memory = velocity_bounds(problem, axis, j), problem.sensing.remembers
    off = 0 if memory else 2 * prediction_error_along(problem, axis)
    late = 2 * as_rounded_fraction(problem.sensing.jitter)
    spans = as_rounded_fraction(problem.delta) - late, as_rounded_fraction(problem.delta) + late
    return min(slow * span for span in spans) - off, max(fast * span for span in spans) + off


def common_measure(lengths: Sequence[Fraction]) -> Fraction:
    """The greatest length of which each of `lengths` is a whole number; 0 if all are 0."""
    pieces = math.lcm(*(length.denominator for length in lengths))  # of one: every length is a number of such
    return Fraction(math.gcd(*(int(length * pieces) for length in lengths)), pieces)


def aligned_width(extent: Fraction, measure: Fraction, wish: int) -> Fraction:
    """A cell width that divides `measure`, for about `wish` cells on an axis of length `extent`."""
    if not measure:
        return extent / wish
    parts = round(measure * wish / extent)
    # the largest width that divides it would make more than twice the cells; this is sound as well, but every image is
    # rounded out to whole cells
    if parts < 1 and measure * wish * 2 < extent:
        return extent / wish
    return measure / max(parts, 1)


def aligned(problem: ReachAvoidProblem, cells: Sequence[int]) -> tuple[CellAxis, ...]:
    """The cells of all axes, about cells[k] along axis k."""
    return tuple(aligned_choices(problem, axis, [wish])[0] for axis, wish in enumerate(cells))


def aligned_choices(problem: ReachAvoidProblem, axis: int, wishes: Sequence[int]) -> list[CellAxis]:
    """The cells of one axis, with its layers, for each of `wishes`, about how many there are to be, each at least 1.

    Where the axis `is_steady`, widths divide what inputs and disturbance move a state by and, unless it is periodic,
    the axis.
    """
    grid, layers, moves = problem.grid, layers_of(problem, axis), set()
    single = axis_of(grid, axis, 2 * Fraction(grid.upper[axis] - grid.lower[axis]), layers)  # a cell that is too wide
    extent = single.extent[1]
    for j in range(len(problem.inputs)) if is_steady(problem, axis) else ():
        back, ahead = moved_bounds(problem, axis, j)
        moves |= {back, ahead}
    measure = common_measure([*moves] if grid.periodic[axis] else [*moves, extent])
    return [replace(single, width=aligned_width(extent, measure, wish)) for wish in wishes]
