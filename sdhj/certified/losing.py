"""The other side of a certified table: cells from which the adversary surely wins, so that what is left is unknown.

A state is lost at step k with n to go where it is in G(t_k), or where it is not in the target and, with n > 0, the
adversary has an answer to every input: something it may do for the interval after which the state is lost at step k + 1
with n - 1 to go. It knows the state and the input, as in the game that is solved. Of cells this is

    Lost_k^0 = cells inside G(t_k), and cells outside L(t_k)
    Lost_k^n = cells inside G(t_k), and every cell of Lost_k^{n-1} where for each u_j some v among the vertices of the
               adversary's box, held for the interval, has an image, everything that u_j and v can lead to from anywhere
               in the cell, covered by cells of Lost_{k+1}^{n-1}.

Each line is a sufficient condition for all states of a cell, so no state of a lost cell is won, whatever the controller
does: in the first everything is bounded over the whole cell, with the shell around it; in the second one v serves
every state of the cell, and by induction all states of the image are lost. The target is asked about at n = 0 and then
again in Lost^{n-1}. What has left over an unsafe end is lost, so of an image only the part between the ends is looked
at, and nothing where all of it is past one by a cell. The adversary's other choices, and hits between two sampling
times, would only add cells, now among the unknown. Without a target Lost_k^n is all of Lost_k^{n-1} and what is
led into Lost_{k+1}^{n-1}, from Lost_k^0 = cells inside G(t_k).
"""

import itertools
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import Any

import numpy as np

from sdhj.certified.bounds import Bounds
from sdhj.certified.cells import CellAxis
from sdhj.certified.images import Changes, Images, moves_of, place_axes
from sdhj.formulas.graph import is_constant
from sdhj.kernels import FloatArray, kept, read_only
from sdhj.kernels.packed import to_words
from sdhj.problem.memory import require
from sdhj.problem.problem import ReachAvoidProblem

MOST_VERTICES = 64


@dataclass(frozen=True)
class LosingProof(Images):
    """The images of cells over one interval where the adversary chooses; the recursion asks it what it asks of a proof.

    Its moves are (starts, L * V, places, ndim), those of u_j under vertex v at j * V + v.
    """

    vertices: FloatArray  # (V, D), the signs of the adversary's components
    kind = "losing"

    @property
    def shrinks(self) -> bool:
        """Whether sets lose cells with every step to go."""
        return not self.problem.has_no_target

    @classmethod
    def against(cls, problem: ReachAvoidProblem, axes: tuple[CellAxis, ...], parts: int) -> "LosingProof":
        """A proof with room for its moves, which `prepare` fills, of a problem's cells and `parts` of an interval.

        ValueError where the adversary has too many vertices or ends are safe, MemoryError where moves do not fit.
        """
        if problem.grid.has("frees"):
            raise ValueError('nothing is known to be lost where ends are "safe": who leaves there is out of danger')
        bounds = np.array(problem.dynamics.bounds.outputs, dtype=object).reshape(problem.dynamics.bounds.shape)
        still = [all(is_constant(one, 0.0) for one in column) for column in bounds.T]
        vertices = np.array(list(itertools.product(*((1.0,) if none else (-1.0, 1.0) for none in still))))
        if len(vertices) > MOST_VERTICES:
            raise ValueError(f"the adversary's box has {len(vertices)} vertices; at most {MOST_VERTICES} are tried")
        strides, (starts, count, *rest) = moves_of(problem, axes, place_axes(problem, axes))
        shape = (starts, count * len(vertices), *rest)
        require(6 * int(np.prod(shape)), "looking for what is lost", "use fewer cells")
        low, high = np.zeros((2, *shape), np.int16)
        return cls(problem, axes, parts, strides, low, high, read_only(vertices))

    @cached_property
    def bounds(self) -> Bounds:
        """Bounds on the velocity at the vertices of the box of v."""
        return Bounds(self.problem, self.vertices)

    @kept
    def past(self) -> FloatArray:
        """Unsafe ends of axes, (2, ndim), past which a state is lost; infinite where there are none."""
        return np.stack(self.problem.grid.faces("fails"))

    def prepare(self, progress: bool | None) -> None:
        """Fill the moves of every input and vertex."""
        self.fill(1, progress, lambda *_: None)
        read_only((self.low, self.high))

    @kept
    def inside(self) -> list[FloatArray]:
        """Cells wholly inside the unsafe sets at each t_k, each (rows, W) uint64; one for all where no set moves."""
        always = [part for part in self.problem.unsafe if part.inputs is None]  # of others a state is not lost
        moving = [part for part in always if part.moving]
        still = np.zeros([axis.count for axis in self.axes], np.bool_)
        for part in always:
            still |= False if part.moving else self.over_cells(part, self._always) < 0
        out = []
        for t in (self.problem.time(step) for step in range(self.problem.steps + 1 if moving else 1)):
            met = [self.over_cells(part, (t, t)) < 0 for part in moving]
            out.append(to_words(reduce(np.logical_or, met, still).reshape(-1, self.axes[-1].count)))
        return out

    def goal(self, step: int) -> FloatArray:
        """Lost_k^0, packed (rows, W) uint64: cells inside G(t_k), and those outside L(t_k).

        At all times, where nothing depends on time.
        """
        inside, t = self.inside[min(step, len(self.inside) - 1)].copy(), self.problem.time(step)
        if self.problem.has_no_target:
            return inside
        outside = self.over_cells(self.problem.target, self._always if self.time_invariant else (t, t)) > 0
        whole = np.broadcast_to(outside, [axis.count for axis in self.axes]).reshape(-1, self.axes[-1].count)
        return inside | to_words(whole)

    def add(self, prepared: Any, cells: FloatArray, following: FloatArray, step: int, changed: Changes) -> None:
        """Turn `cells`, Lost_k^{n-1}, into Lost_k^n, in place; both and `following` are packed, (rows, W) uint64.

        following : Lost_{k+1}^{n-1}. changed : by which rows and bits it differs from Lost_{k+1}^{n-2}. prepared is not
        used.
        """
        inside = self.inside[min(step, len(self.inside) - 1)]
        if self.shrinks:
            cells &= ~inside  # is lost wherever it is led
        self.add_predecessors(cells, following, step, changed, np.zeros((0, 0), np.uint8), len(self.problem.inputs))
        cells |= inside
