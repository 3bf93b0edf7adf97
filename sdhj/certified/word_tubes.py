"""Which cells' tubes may meet an unsafe set, 64 cells at a time, where all cells along its axes move alike.

Counted boxes (`sdhj.certified.general_proof`) are asked cell by cell. But where no velocity depends on the axes of an
unsafe set, a tube overlaps the same boxes from each cell on: it is met where one of them is, a union of shifted sets.
So boxes are bits, united axis by axis, and what several inputs and parts have in common is united once. An axis along
which only the adversary moves, alike under all inputs, is taken into the boxes.
"""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from sdhj.certified.bounds import Bounds
from sdhj.certified.cells import CellAxis
from sdhj.common.remembering import FloatArray
from sdhj.kernels.packed import to_words
from sdhj.kernels.windows import united_along, united_in_words, with_beyond
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sets import UnsafeSet

LEAST_AXES = 3  # with fewer, boxes are counted
COUNTED = 4_000_000  # boxes that are fine enough when they are counted, at all times together
BOXES = 4_000_000  # in which a level set is asked for, at all times together, or
LEAST_PIECES = 2  # of a cell along each axis on which inputs move it, where that is more
MOST_PIECES = 16
ASKED_AT_ONCE = 1 << 22  # boxes
HALVINGS_OF_A_BOX = 2  # along each axis, where the sign of a set's function is open: 4 pieces
ALIKE = 1e-12  # of the largest coordinate: how far moves under all inputs may differ by rounding


class Lattice(NamedTuple):
    """The boxes in which an unsafe set of d axes is bounded: pieces of cells, each widened."""

    axes: Sequence[CellAxis]  # of the set
    # (d,), where all tubes stick out of their cells by the same, `low` and `high`: a box is a whole cell
    alike: FloatArray
    fine: FloatArray  # (d,), how many equal pieces a cell is cut into; 1 on the axes `alike`
    low: FloatArray  # (d,), how much each box is wider than its piece below
    high: FloatArray  # (d,), and above


def in_words(
    problem: ReachAvoidProblem, depends: FloatArray, cells: Sequence[CellAxis], unsafe_set: UnsafeSet, parts: int
) -> bool:
    """Whether cells along the axes of an unsafe set are looked at 64 at a time: if boxes are many."""
    axes = unsafe_set.axes
    spans = parts * problem.most_steps if unsafe_set.moving else 1
    # of half a cell, at all times
    many = math.prod(cells[k].count for k in axes) * 2 ** len(axes) * spans > COUNTED
    return many and goes_along(problem, depends, axes)


def goes_along(problem: ReachAvoidProblem, depends: FloatArray, axes: Sequence[int]) -> bool:
    """Whether tubes and images are shifted with their cells along `axes`, so that 64 may be looked at at once.

    If there are at least `LEAST_AXES`, the last axis among them, none is an axis of a place and no end is safe.
    """
    # of the axes of an unsafe set, and of all axes where sets are made of one another (`Packing`)
    last = axes[-1] == depends.size - 1
    return len(axes) >= LEAST_AXES and last and not depends[list(axes)].any() and not problem.grid.has("frees")


def size_in_words(axes: Sequence[CellAxis]) -> int:
    """How many words a set of cells is kept in."""
    return math.prod(axis.count for axis in axes[:-1]) * -(-axes[-1].count // 64)


def pieces_of(axes: Sequence[CellAxis], alike: FloatArray, share: int) -> FloatArray:
    """Into how many pieces a cell is cut along each axis: (d,), 1 on the axes `alike`."""
    cells = share * math.prod(axis.count for axis in axes)
    pieces = int((BOXES / cells) ** (1 / max(int((~alike).sum()), 1)))
    return np.where(alike, 1, min(max(pieces, LEAST_PIECES), MOST_PIECES))


def lattice_for(axes: Sequence[CellAxis], tubes: FloatArray, pushed: FloatArray, share: int) -> Lattice:
    """The `Lattice` for `tubes` (T, parts, d, 2), how far the ends of cells move, and a set of d axes.

    Where an axis is not `alike`, boxes are wider by what the disturbance pushes, `pushed` (d,), if that is less than a
    box.
    """
    least, most = tubes[..., 0].min(axis=1), tubes[..., 1].max(axis=1)
    scale = np.array([axis.scale for axis in axes])
    alike = (np.ptp(least, axis=0) <= ALIKE * scale) & (np.ptp(most, axis=0) <= ALIKE * scale)
    widths, fine = np.array([float(axis.width) for axis in axes]), pieces_of(axes, alike, share)
    # `windows` looks tubes up without it, so that these two go together
    sway = np.where(pushed < widths / fine, pushed, 0.0)
    low = np.where(alike, -least.min(axis=0), sway)
    return Lattice(axes, alike, fine, low, np.where(alike, most.max(axis=0), sway))


def boxes_in_words(
    bounds: Bounds, unsafe_set: UnsafeSet, lattice: Lattice, margin: FloatArray, far: int, times: tuple[float, float]
) -> FloatArray:
    """Which boxes of a lattice, widened by `margin` (d,), may meet a set at some times: (*boxes, fine, more) uint64.

    *boxes are the numbers of boxes on all axes but the last; on the last, box fine i + m is bit i of plane m, with
    margins as `with_margins` adds them.
    """
    low, high = [], []
    for axis, fine, below, above in zip(
        lattice.axes, lattice.fine, lattice.low + margin, lattice.high + margin, strict=True
    ):
        # cells of one width from the lower end on: an axis with a layer is one of a place, which `goes_along` refuses
        corner = float(axis.lower) + float(axis.width) / fine * np.arange(axis.count * fine + 1)
        low.append(corner[:-1] - below)
        high.append(corner[1:] + above)
    last, fine = lattice.axes[-1], int(lattice.fine[-1])
    inner, sizes = math.prod(one.size for one in low[1:]), [one.size for one in low]
    out = np.empty((*sizes[:-1], fine, -(-last.count // 64)), np.uint64)
    for at in (
        slice(i, i + max(ASKED_AT_ONCE // inner, 1)) for i in range(0, sizes[0], max(ASKED_AT_ONCE // inner, 1))
    ):
        own = [low[0][at], *low[1:]], [high[0][at], *high[1:]]
        meets = ~bounds.outside(unsafe_set, *own, times, HALVINGS_OF_A_BOX)
        # Of the last axis, boxes within a cell come before cells, which are packed.
        planes = np.moveaxis(meets.reshape(*meets.shape[:-1], last.count, fine), -1, -2)
        out[at] = to_words(planes)
    return with_margins(out, last, far)


def with_margins(planes: FloatArray, axis: CellAxis, far: int) -> FloatArray:
    """Planes (..., fine, W) of bits with `far` bits more before and behind the cells: (..., fine, more) uint64.

    These are the next period of a periodic axis, and repeat the first or the last box on a bounded one.
    """
    # whole words, half of them before: `united_in_words` and `images_inside` find the cells by that
    more = 2 * -(-far // 64)
    out = np.empty((*planes.shape[:-1], planes.shape[-1] + more), np.uint64)
    wide = out.reshape(-1, *out.shape[-2:])
    with_beyond(planes.reshape(-1, *planes.shape[-2:]), axis.count, far, axis.periodic, wide)
    return out


def windows(lattice: Lattice, narrow: FloatArray, tubes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The first and the last box along each axis that `tubes` (..., d, 2) of cell 0 overlap: two (..., d).

    The tube of cell i overlaps those that lie `fine` i farther. On axes that are not `alike` a tube is made smaller by
    what boxes are wider than their pieces, and by `narrow` (d,), for which the `margin` of `boxes_in_words` makes up.
    """
    pitch = np.array([float(axis.width) for axis in lattice.axes]) / lattice.fine
    first = np.floor((tubes[..., 0] + lattice.low + narrow) / pitch).astype(np.int64)
    last = lattice.fine - 1 + np.ceil((tubes[..., 1] - lattice.high - narrow) / pitch).astype(np.int64)
    return np.where(lattice.alike, 0, first), np.where(lattice.alike, 0, np.maximum(first, last))


def far_beyond(lattice: Lattice, first: FloatArray, last: FloatArray) -> int:
    """How many cells beyond a row of the last axis the windows (T, d) reach, at most."""
    fine = lattice.fine[-1]
    return 0 if lattice.alike[-1] else max(-int(first[:, -1].min() // fine), int(last[:, -1].max() // fine), 0)


def united(
    boxes: FloatArray, lattice: Lattice, first: FloatArray, last: FloatArray, some: FloatArray, axis: int
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield from which cells tubes overlap a box that may meet the set, once for all tubes with the same windows.

    (numbers of these tubes, cells as bits (n1, ..., W) uint64), not to be modified, as later ones may be made of them.
    `boxes` are united along the axes behind `axis`.
    """
    if axis < 0:
        yield some, boxes
        return
    ends = np.stack([first[some, axis], last[some, axis]], axis=1)
    # Tubes with one window along this axis share what is united along it.
    for a, b in np.unique(ends, axis=0).tolist():
        yield from united(
            _along(boxes, lattice, axis, a, b), lattice, first, last, some[(ends == [a, b]).all(axis=1)], axis - 1
        )


def _along(boxes: FloatArray, lattice: Lattice, axis: int, first: int, last: int) -> FloatArray:
    """For each cell along an axis whether one of the boxes of its window, `first` to `last` of cell 0, is set."""
    own, fine = lattice.axes[axis], int(lattice.fine[axis])
    if axis == len(lattice.axes) - 1:
        out = np.empty((*boxes.shape[:-2], -(-own.count // 64)), np.uint64)
        united_in_words(boxes.reshape(-1, *boxes.shape[-2:]), first, last, out.reshape(-1, out.shape[-1]))
        return out
    # Each cell is its own box: nothing to unite.
    if fine == 1 and first == last == 0:
        return boxes
    before, after = math.prod(boxes.shape[:axis]), math.prod(boxes.shape[axis + 1 :])
    out = np.empty((*boxes.shape[:axis], own.count, *boxes.shape[axis + 1 :]), np.uint64)
    wide = boxes.reshape(before, -1, after)
    united_along(wide, first, last, fine, own.periodic, out.reshape(before, own.count, after))
    return out
