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

import numpy as np

from sdhj.certified.bounds import Bounds
from sdhj.certified.cells import CellAxis
from sdhj.certified.images import Images, moves_of, place_axes
from sdhj.certified.packing import Changes, Packing
from sdhj.formulas.graph import is_constant
from sdhj.kernels import FloatArray, kept, read_only
from sdhj.kernels.packed import to_words
from sdhj.problem.memory import require_memory
from sdhj.problem.problem import ReachAvoidProblem

MOST_VERTICES = 64


@dataclass(frozen=True)
class LosingProof(Images):
    """The images of cells over one interval where the adversary chooses; `CellSets` asks it what it asks of any proof.

    Its moves are (starts, L * V, places, ndim), those of u_j under vertex v of the adversary's box at j * V + v. Made
    by `against` and filled by `prepare`. For its other attributes see `Images`.

    Attributes
    ----------
    vertices : (V, D)
        The vertices of the adversary's box, as signs of its D components: -1 or 1; of a component that is always 0 only
        1.
    """

    vertices: FloatArray
    kind = "losing"

    @property
    def shrinks(self) -> bool:
        """Whether sets of lost cells lose cells, rather than gain them, with every step to go: with a target."""
        return not self.problem.has_no_target

    @property
    def all_at_first(self) -> bool:
        """Whether all cells are asked about for Lost_k^1: yes, as who leaves over an unsafe end is led into no cell."""
        return True

    @classmethod
    def against(cls, problem: ReachAvoidProblem, axes: tuple[CellAxis, ...], parts: int) -> "LosingProof":
        """A proof with room for its moves, which `prepare` fills.

        axes : the cells of each axis. parts : into which an interval is cut. ValueError where the adversary's box has
            more than `MOST_VERTICES` vertices or an end is safe, MemoryError where the moves do not fit into memory.
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
        require_memory(6 * int(np.prod(shape)), "looking for what is lost", "use fewer cells")
        low, high = np.zeros((2, *shape), np.int16)
        return cls(problem, axes, parts, strides, low, high, read_only(vertices))

    @cached_property
    def bounds(self) -> Bounds:
        """Bounds on the velocity under each input at each vertex of the adversary's box; made once, at first use."""
        return Bounds(self.problem, self.vertices)

    @kept
    def open_ends(self) -> FloatArray:
        """The unsafe ends of axes, lower and upper, (2, ndim), past which a state is lost; infinite for other ends."""
        return np.stack(self.problem.grid.faces("fails"))

    def prepare(self, progress: bool | None) -> Packing:
        """Fill the moves of every input and vertex, make them read-only, and return the `Packing` that `add` needs.

        progress : whether to show a bar, as for `sdhj.solve`. ValueError where no bound on a velocity is found, or an
        interval leads too many cells on (`Images.fill`).
        """
        self.fill(1, progress, lambda *_: None)
        read_only((self.low, self.high))
        return Packing(self)

    @kept
    def inside(self) -> list[FloatArray]:
        """For each step k the cells wholly inside the unsafe sets at t_k, (rows, W) uint64; one entry if no set moves.

        Sets that are unsafe under some inputs only do not count. Computed once, at first use.
        """
        always = [part for part in self.problem.unsafe if part.inputs is None]  # of others a state is not lost
        moving = [part for part in always if part.moving]
        still = np.zeros([axis.count for axis in self.axes], np.bool_)
        for part in always:
            still |= False if part.moving else self.over_cells(part, self._all_times) < 0
        out = []
        for t in (self.problem.time(step) for step in range(self.problem.steps + 1 if moving else 1)):
            met = [self.over_cells(part, (t, t)) < 0 for part in moving]
            out.append(to_words(reduce(np.logical_or, met, still).reshape(-1, self.axes[-1].count)))
        return out

    def goal(self, step: int) -> FloatArray:
        """Lost_k^0 for k = step, packed (rows, W) uint64: cells inside G(t_k) and, with a target, those outside L(t_k).

        If nothing depends on time, at all times, and `step` is not used.
        """
        inside, t = self.inside[min(step, len(self.inside) - 1)].copy(), self.problem.time(step)
        if self.problem.has_no_target:
            return inside
        outside = self.over_cells(self.problem.target, self._all_times if self.time_invariant else (t, t)) > 0
        whole = np.broadcast_to(outside, [axis.count for axis in self.axes]).reshape(-1, self.axes[-1].count)
        return inside | to_words(whole)

    def add(self, prepared: Packing, cells: FloatArray, following: FloatArray, step: int, changed: Changes) -> None:
        """Turn `cells`, Lost_k^{n-1}, into Lost_k^n for k = step, in place; all sets are packed, (rows, W) uint64.

        With a target, cells are taken away from which some input has no vertex that leads into `following`; without
        one, the others are added. Cells inside the unsafe sets are always among them.

        prepared : the `Packing` that `prepare` returned.
        following : Lost_{k+1}^{n-1}.
        changed : the rows, and their words, in which `following` differs from Lost_{k+1}^{n-2}; only cells whose images
            may be there are looked at. None: all are.
        """
        inside = self.inside[min(step, len(self.inside) - 1)]
        if self.shrinks:
            cells &= ~inside  # is lost wherever it is led
        prepared.add(cells, following, step, changed, np.zeros((1, 0, 0), np.uint8), len(self.problem.inputs))
        cells |= inside
