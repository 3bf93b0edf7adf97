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
from sdhj.certified.word_tubes import Lattice, far_beyond, goes_along, united, with_margins
from sdhj.kernels import FloatArray, read_only
from sdhj.kernels.packed import Cells, swap_packed, to_bits, to_words
from sdhj.kernels.stencils import Moves, grow, reached_words
from sdhj.kernels.windows import add_led
from sdhj.problem.grid import Grid

FEWEST = 16  # cells of an axis that is packed in place of the last
Changes = tuple[FloatArray, FloatArray] | None  # rows, and their words with cells that changed; None: any may have


def packed_axis(grid: Grid, axes: Sequence[CellAxis], depends: FloatArray, oblique: bool) -> int:
    """The axis along which sets are packed in the recursion: the last, or the longest on which all cells move alike.

    depends : (ndim,) bool, the axes of a place
    oblique : whether images are lines, which are along the last axis
    """
    alike = [k for k, own in enumerate(axes) if not depends[k] and own.count >= FEWEST]
    if not depends[-1] or not alike or oblique or grid.has("frees"):
        return len(axes) - 1
    return max(alike, key=lambda k: axes[k].count)


class _Swapped(NamedTuple):
    """What the recursion is asked with: cells, moves and how far these lead at most, and marks of an interval."""

    cells: Cells
    moves: Moves
    far: FloatArray
    marks: FloatArray


class Packing:
    """The sets of a proof whose moves are known, while the recursion makes them."""

    def __init__(self, proof: Any) -> None:
        """For a proof (`sdhj.certified.images.Images`)."""
        self.proof, last = proof, len(proof.axes) - 1
        oblique = bool(len(proof.lines.normals))
        self.axis = packed_axis(proof.problem.grid, proof.axes, proof.strides > 0, oblique)
        self.alike = not oblique and goes_along(proof.problem, proof.strides > 0, range(last + 1))
        self.order = np.arange(last + 1)
        self.order[[self.axis, last]] = last, self.axis
        self.known: dict[int, _Swapped] = {}  # of one step

    def add(
        self, cells: FloatArray, following: FloatArray, step: int, changed: Changes, marks: FloatArray, groups: int
    ) -> None:
        """Add to `cells` those of which `following` holds the image under a clear input; or, where sets shrink, take
        away those without such an input. In place, all sets (rows, W) uint64.

        Only words are asked whose images may hold a change. changed : by which rows and bits `following` has changed;
        None: all are asked. marks (starts, cells, bytes) uint8 : the bits of clear inputs, or none, and any is.
        groups : into how many groups of moves, one behind the other, inputs fall, each of which needs one that does it.
        """
        some = self._at(step, marks)
        if self.alike and groups == 1 and marks.size:
            self._add_alike(cells, following, some)
            return
        if self.axis == len(self.order) - 1:
            self._grow(cells, following, changed, some, groups)
            return
        if changed is not None:
            whole = np.zeros_like(following)
            whole[changed[0]] = changed[1]
            whole = self._swapped(whole, False)
            rows = np.flatnonzero(whole.any(axis=1))
            changed = rows, whole[rows]
        inside = self._swapped(cells, False)
        self._grow(inside, self._swapped(following, False), changed, some, groups)
        cells[...] = self._swapped(inside, True)

    def _add_alike(self, cells: FloatArray, following: FloatArray, some: _Swapped) -> None:
        """`add` where all cells move alike: what an image may miss is united as what a tube may meet."""
        axes, ones = self.proof.axes, np.ones(len(self.order), np.int64)
        first, last = (one[:, 0].astype(np.int64) for one in (some.moves.low, some.moves.high))  # obligation 3.32
        lattice, count = Lattice(axes, ones == 0, ones, 0.0 * ones, 0.0 * ones), axes[-1].count
        out_of_set = ~following.reshape(*[axis.count for axis in axes[:-1]], 1, -1)
        boxes = with_margins(out_of_set, axes[-1], far_beyond(lattice, first, last))  # obligation 3.35
        led, wanted = np.zeros_like(cells), cells if self.proof.shrinks else ~cells
        for inputs, missing in united(boxes, lattice, first, last, np.arange(len(first)), len(axes) - 1):
            add_led(missing.reshape(cells.shape), some.marks, inputs, wanted, led, count)  # obligation 3.33
        cells[...] = led if self.proof.shrinks else cells | led  # obligation 3.34

    def _grow(self, cells: FloatArray, following: FloatArray, changed: Changes, some: _Swapped, groups: int) -> None:
        """`add`, of sets that are packed as they are asked for."""
        near = np.full(cells.shape, changed is None)
        if changed is not None:
            scratch = np.empty((4, len(self.order) - 1), np.int64), np.empty(cells.shape[1], np.bool_)
            reached_words(*changed, some.far, some.cells, near, *scratch)
        extended = self._extended(following, some)
        grow(near, cells, extended, some.marks, some.moves, groups, some.cells, self.proof.shrinks)

    def _extended(self, following: FloatArray, some: _Swapped) -> FloatArray:
        """A set of cells (rows, W), padded on the packed axis as far as images reach, so that none wraps or is clipped.

        As it is where cells there are not alike, or images reach farther than the axis is long.
        """
        moves, count, periodic = some.moves, int(some.cells.counts[-1]), some.cells.periodic[-1]
        far = max(-int(moves.low[..., -1].min()), int(moves.high[..., -1].max()), 0)
        if moves.strides[-1] or np.isfinite(moves.safe).any() or far > count:
            return following
        margin, mode = 64 * (far // 64 + 1), "wrap" if periodic else "edge"  # obligation 3.6
        return to_words(np.pad(to_bits(following, count), [(0, 0), (margin, margin)], mode=mode))  # type: ignore[call-overload]

    def _at(self, step: int, marks: FloatArray) -> _Swapped:
        """What is asked at a step."""
        proof, at = self.proof, min(step, max(len(marks), len(self.proof.low)) - 1)
        if at not in self.known:
            moves, far = proof.moves(at), proof.farthest_moves[min(at, len(proof.farthest_moves) - 1)]
            some = _Swapped(proof.cells, moves, far, marks[min(at, len(marks) - 1)])
            self.known = {at: some if self.axis == len(self.order) - 1 else self._in_order(some)}
        return self.known[at]

    def _in_order(self, some: _Swapped) -> _Swapped:
        """What is asked, with two axes at each other's place."""
        order, number = self.order, some.marks.shape[-1]

        def in_order(told: Any, names: Sequence[str]) -> Any:
            """A tuple with some of its arrays, which are of axes, in order."""
            ordered = {name: np.ascontiguousarray(getattr(told, name)[..., order]) for name in names}
            return told._replace(**read_only(ordered))

        cells = in_order(some.cells, ("lower", "width", "length", "layers", "counts", "periodic"))
        moves = in_order(some.moves, ("low", "high", "strides", "safe"))
        marks = some.marks
        if marks.size:
            marks = np.swapaxes(marks.reshape(*some.cells.counts, number), self.axis, len(order) - 1)
        marks = np.ascontiguousarray(marks.reshape(-1, number) if marks.size else marks)
        return _Swapped(cells, moves, *read_only((np.ascontiguousarray(some.far[..., order]), marks)))

    def _swapped(self, sets: FloatArray, back: bool) -> FloatArray:
        """Sets packed along the last axis packed along another, which changes places with it; or back."""
        counts = self.proof.cells.counts
        ends = [int(counts[self.axis]), int(counts[-1])]
        first, last = ends[::-1] if back else ends
        out = np.empty((len(sets) // first * last, -(-first // 64)), np.uint64)
        swap_packed(sets, first, math.prod(counts[self.axis + 1 : -1].tolist()), last, out)
        return out
