"""How the recursion packs its sets: along an axis that no image depends on, so that 64 cells are led at once.

Sets are kept, looked up and stored with the cells of the last axis in words. Where images depend on that axis, as on
the heading of a car (x, y, heading), each of its cells has an image of its own to ask for. But all cells of a line
along x move alike. So while sets are made these two axes change places, and back once a step is made, which takes a
hundredth of its time.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from sdhj.certified.cells import CellAxis
from sdhj.common.remembering import FloatArray, read_only
from sdhj.kernels.packed import Cells, swap_packed, with_beyond
from sdhj.kernels.stencils import Clear, Moves, grow
from sdhj.problem.grid import Grid

FEWEST = 16  # cells of an axis that is packed in place of the last
# rows (n,) of a packed set, and words (n, W), in which each cell that has changed is a set bit; None: any may have
Changes = tuple[FloatArray, FloatArray] | None


def packed_axis(grid: Grid, axes: Sequence[CellAxis], depends: FloatArray) -> int:
    """The number of the axis along which sets are packed in the recursion.

    The longest of at least `FEWEST` cells that is no axis of a place (`depends`). The last axis instead if it is none
    itself, there is no such axis, or an end of the grid is safe.
    """
    # `chosen_cells` asks, too: it gives this axis whole words, and counts what a solve takes by them
    alike = [k for k, own in enumerate(axes) if not depends[k] and own.count >= FEWEST]
    if not depends[-1] or not alike or grid.has("frees"):
        return len(axes) - 1
    return max(alike, key=lambda k: axes[k].count)


class _Swapped(NamedTuple):
    """What `Packing.add` hands to compiled code about one step; sets are packed along the last axis."""

    cells: Cells
    moves: Moves
    far: FloatArray  # (2, ndim), the box of `Images.farthest_moves` for this interval
    clear: Clear


class Packing:
    """Makes the sets of one step from those of the next, packed along the axis that takes least time."""

    def __init__(self, proof: Any) -> None:
        self.proof, last = proof, len(proof.axes) - 1
        self.axis = packed_axis(proof.problem.grid, proof.axes, proof.strides > 0)
        # `axis` and the last in each other's place
        self.order = np.arange(last + 1)
        self.order[[self.axis, last]] = last, self.axis
        self.known: dict[int, _Swapped] = {}  # the last that was asked for

    def add(self, cells: FloatArray, following: FloatArray, step: int, changed: Changes) -> None:
        """Add to `cells` (rows, W) each cell whose image under a clear input is in `following` (rows, W), in place.

        Where sets shrink, instead take away each cell that has no such input. `changed` is what differs from the set
        that was `following` when `cells` was made.
        """
        some = self._at(step)
        # Packed along the last axis already, as tables keep sets.
        if self.axis == len(self.order) - 1:
            self._grow(cells, following, changed, some)
            return
        # Rows along another axis are others, so that a change goes through a whole set.
        if changed is not None:
            whole = np.zeros_like(following)
            whole[changed[0]] = changed[1]
            whole = self._swapped(whole, False)
            rows = np.flatnonzero(whole.any(axis=1))
            changed = rows, whole[rows]
        inside = self._swapped(cells, False)
        self._grow(inside, self._swapped(following, False), changed, some)
        cells[...] = self._swapped(inside, True)

    def _grow(self, cells: FloatArray, following: FloatArray, changed: Changes, some: _Swapped) -> None:
        """`add` for sets that are packed along `axis` already."""
        # only words of cells whose images may hold a change are looked at
        near = np.full(cells.shape, True) if changed is None else reached_words(*changed, some.far, some.cells)
        extended = self._extended(following, some)
        grow(near, cells, extended, some.clear, some.moves, some.cells, self.proof.shrinks)

    def _extended(self, following: FloatArray, some: _Swapped) -> FloatArray:
        """The set `following` (rows, W), with a margin of whole words before and behind each row: (rows, W') uint64."""
        moves, counts = some.moves, some.cells.counts
        far = max(-int(moves.low[..., -1].min()), int(moves.high[..., -1].max()), 1)
        # a place depends on the packed axis, an end is safe, or images reach farther than the axis is long
        if moves.strides[-1] or np.isfinite(moves.safe).any() or far > counts[-1]:
            return following
        # whole words, half of them before: `images_inside` finds the cells by that
        out = np.empty((len(following), following.shape[1] + 2 * -(-far // 64)), np.uint64)
        with_beyond(following, int(counts[-1]), far, bool(some.cells.periodic[-1]), out)
        return out

    def _at(self, step: int) -> _Swapped:
        """What compiled code is handed at a step, in the order of axes `order`."""
        proof, at = self.proof, min(step, self.proof.starts - 1)
        if at not in self.known:
            moves, far = proof.moves(at), proof.farthest_moves[min(at, len(proof.farthest_moves) - 1)]
            some = _Swapped(proof.cells, moves, far, proof.clear_at(at))
            # Of one step alone, as the recursion goes from step to step.
            self.known = {at: some if self.axis == len(self.order) - 1 else self._in_order(some)}
        return self.known[at]

    def _in_order(self, some: _Swapped) -> _Swapped:
        """What `some` has, with `axis` and the last axis exchanged, as new arrays."""
        order = self.order
        # each field of `Cells`, `Moves` and `Clear` whose last axis is that of the axes has to be named below

        def in_order(told: Any, names: Sequence[str]) -> Any:
            # contiguous as those of the proof are: for views kernels would be compiled once more
            ordered = {name: np.ascontiguousarray(getattr(told, name)[..., order]) for name in names}
            return told._replace(**read_only(ordered))

        cells = in_order(some.cells, ("lower", "width", "length", "layers", "counts", "periodic"))
        moves = in_order(some.moves, ("low", "high", "strides", "safe"))
        clear = in_order(some.clear, ("strides",))
        return _Swapped(cells, moves, read_only(np.ascontiguousarray(some.far[..., order])), clear)

    def _swapped(self, sets: FloatArray, back: bool) -> FloatArray:
        """The set `sets`, packed along `axis` in place of the last axis, or `back`: new."""
        counts = self.proof.cells.counts
        ends = [int(counts[self.axis]), int(counts[-1])]
        # `last` is the axis that `sets` is packed along, `first` the one the result is.
        first, last = ends[::-1] if back else ends
        out = np.empty((len(sets) // first * last, -(-first // 64)), np.uint64)
        swap_packed(sets, first, math.prod(counts[self.axis + 1 : -1].tolist()), last, out)
        return out


def reached_words(rows: FloatArray, changed: FloatArray, far: FloatArray, cells: Cells) -> FloatArray:
    """The words with cells whose image under some input may hold a cell that has changed: (R, W).

    `rows` (n,) and their words `changed` (n, W) have the changes; `far` (2, ndim) the first and the last cell that
    inputs lead to from any place.
    """
    counts = cells.counts.tolist()
    out = np.zeros((math.prod(counts[:-1]), changed.shape[1]), np.bool_)
    out[rows] = changed != 0
    out = out.reshape(*counts[:-1], -1)
    for axis, count in enumerate(counts):
        together = 64 if axis == len(counts) - 1 else 1  # cells of an entry of `out`
        # of each entry the cells that its first and its last cell may lead to
        begin = np.arange(0, count, together)
        first, last = begin + far[0, axis], np.minimum(begin + together, count) - 1 + far[1, axis]
        if cells.periodic[axis]:
            laps, last = first // count * count, np.minimum(last, first + count - 1)
            first, last = first - laps, last - laps
        else:
            first, last = np.clip(first, 0, count - 1), np.clip(last, 0, count - 1)
        again = np.where(last < count, 0, (last - count) // together + 1)  # behind the seam
        before = np.insert(np.cumsum(out, axis=axis, dtype=np.int32), 0, 0, axis=axis)  # how many changed
        first, last = first // together, np.minimum(last, count - 1) // together + 1
        out = (before.take(last, axis) - before.take(first, axis) + before.take(again, axis)) != 0
    return out.reshape(-1, changed.shape[1])
