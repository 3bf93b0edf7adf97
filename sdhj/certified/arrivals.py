"""Inputs that lead into the target itself at the end of an interval, of which cells need not be whole.

Of the target a set of cells has those that are inside, and whoever arrives need not be in one of them. So the image of
a cell over the last interval, a box that ends where bounds say and at no edge of a cell, is judged against the target:

    S_k^1 = S_k^0, every cell that a clear input leads into S_{k+1}^0, and every cell of which a clear input has an
            image inside L(t_{k+1})

The image is outside G, because the tube is clear up to its end. Where it lies depends on the cell's place, and whether
that is in the target on the target's axes: together they are the cell's *site*. With `Sensing` only a cell of S^0 tells
that the target has been reached, so there images are judged by cells alone.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from sdhj.certified.cells import CellAxis
from sdhj.common.remembering import FloatArray
from sdhj.problem.problem import ReachAvoidProblem

HALVINGS = 4  # of an image along each axis: 16 pieces
MOST_PIECES = 1 << 22  # that all images are cut into
SITES_AT_ONCE = 1 << 18


def sites_of(
    problem: ReachAvoidProblem, axes: Sequence[CellAxis], depends: FloatArray
) -> tuple[FloatArray, tuple[int, int, int]]:
    """The strides of sites, (ndim,), and the shape (starts, sites, bytes) of the array `GeneralProof.arrives`.

    All is 0 where images are judged by cells alone, without a target or with `Sensing`. depends (ndim,) bool : the axes
    of a place, as `place_axes` finds them.
    """
    # `Argument.read_proof` works strides and shape out once more, and refuses a file with another shape
    strides = np.zeros(len(axes), np.int64)
    if problem.has_no_target or problem.sensing:
        return strides, (0, 0, 0)
    some = depends.copy()
    some[list(problem.target.axes)] = True
    counts = np.where(some, [axis.count for axis in axes], 1)
    strides[some] = np.cumprod([1, *counts[:0:-1]])[::-1][some]
    starts = problem.steps if problem.dynamics.depends_on_time or problem.target.moving else 1
    return strides, (starts, math.prod(counts.tolist()), -(-len(problem.inputs) // 8))


class Arrivals:
    """Finds which inputs lead all of a cell's image into the target itself, and marks them in `GeneralProof.arrives`.

    `add` is called once for each start, input and range of places.
    """

    def __init__(self, proof: Any) -> None:
        self.proof, self.near = proof, dict[int, FloatArray]()
        starts, count, *_ = proof.low.shape
        self.most = max(MOST_PIECES // (max(starts, len(proof.arrives)) * count), 1 << 12)

    def add(self, start: int, j: int, places: FloatArray, last: FloatArray) -> None:
        """Set the bit of u_j in `proof.arrives` at each site of places (M,) that u_j leads into the target."""
        arrives, proof = self.proof.arrives, self.proof
        if not len(arrives):
            return
        free = [axis for axis in proof.problem.target.axes if not proof.strides[axis]]
        each = max(SITES_AT_ONCE // math.prod(proof.axes[axis].count for axis in free), 1)
        for begin in range(0, len(places), each):
            some = slice(begin, begin + each)
            # where one image serves all steps, all are marked
            for step in range(len(arrives)) if len(proof.low) == 1 else (start,):
                self._mark(step, start, j, places[some], last[some], free)

    def _mark(self, step: int, start: int, j: int, places: FloatArray, last: FloatArray, free: Sequence[int]) -> None:
        """Set the bit of u_j in `proof.arrives`, in place, for places (M,) and the interval from one step.

        It is set where all of the image, with twice the shell around it, is inside the target at the interval's end;
        along the `free` axes every cell is asked about.
        """
        proof, target, t = self.proof, self.proof.problem.target, self.proof.problem.time(step + 1)
        own, near = proof.cells_at(places), self._cells_near_target(step)
        sides = [
            tuple(
                self._moved_indices(axis, own, ends[start, j, places, axis].astype(np.int64), free)
                for axis in target.axes
            )
            for ends in (proof.low, proof.high)
        ]
        shape = [len(places), *(proof.axes[axis].count for axis in free)]
        found = np.nonzero(np.broadcast_to(near[sides[0]] & near[sides[1]], shape))  # of these an image may be inside
        cells = own[found[0]]
        cells[:, free] = np.stack(found[1:], axis=1) if free else cells[:, free]
        low, high = np.empty((2, len(cells), len(target.axes)))
        for column, axis in enumerate(target.axes):
            # once for states near the cell, once for rounding; the checker takes as much (`Argument.arrivals_hold`)
            edges, more = proof.axes[axis].edges(), 2 * proof.shell[axis]
            low[:, column] = edges[cells[:, axis]] + last[found[0], axis, 0] - more
            high[:, column] = edges[cells[:, axis] + 1] + last[found[0], axis, 1] + more
        inside = proof.bounds.inside(target, low, high, (t, t), HALVINGS, self.most)
        proof.arrives[step, cells[inside] @ proof.sites, j // 8] |= np.uint8(1 << j % 8)

    def _moved_indices(self, axis: int, own: FloatArray, by: FloatArray, free: Sequence[int]) -> FloatArray:
        """The indices along one axis of cells (M, ndim), moved on by `by` (M,): broadcasts to (M, *free).

        Along a `free` axis all cells are listed; `_mark` asks `bounds.inside` about these, so that a wrong index can
        lose an arrival and never prove one.
        """
        cells, shape = self.proof.axes[axis], [-1] + [1] * len(free)
        at = (own[:, axis] + by).reshape(shape)
        if axis in free:
            shape[0], shape[1 + list(free).index(axis)] = 1, -1
            at = at + np.arange(cells.count).reshape(shape)
        return at % cells.count if cells.periodic else np.clip(at, 0, cells.count - 1)

    def _cells_near_target(self, step: int) -> FloatArray:
        """Which cells of the target's axes may meet the target at the end of the interval from `step`: (*counts)."""
        if step not in self.near:
            target, t = self.proof.problem.target, self.proof.problem.time(step + 1)
            shape = [self.proof.axes[axis].count for axis in target.axes]
            self.near = {step: (self.proof.over_cells(target, (t, t)) < 1).reshape(shape)}
        return self.near[step]
