"""Certified sets: reach-avoid tubes that hold on a computer, not only on paper.

A grid with interpolation approximates S_k^i; runs that start inside it can fail. Here the state space is cut into
cells (boxes), and a cell is *certified* for (start k, within n) only where a proof says that every state of the cell is
in the tube. The recursion is that of Theorem 2, with sets of cells:

    S_k^0 = cells inside L(t_k) and outside G(t_k)
    S_k^n = S_k^{n-1} and every cell for which some input u_j has (i) an image, everything that can be reached at
            t_{k+1} from anywhere in the cell, covered by cells of S_{k+1}^{n-1}, and (ii) a tube, everywhere the
            state can be during the interval, clear of G(t) at every time.

The obligations of the proof, where each is met, and the test in tests/certified that fails without it:

1.  *The cells cover the state space, and their edges are exact.* `CellAxis`; numbers are the decimals they are written
    as, the period of an angle is an interval around 2 pi. [test_cells_partition_the_axis]
2.  *The image is outside what can be reached.* For dynamics that do not depend on the state: `CellAxis.image`, in
    fractions, with the adversary's worst velocities, clipped at walls. [test_image_holds_the_worst_adversary] For the
    others: `sdhj.certified.general.Reach`, by the Lipschitz bounds that the user states.
    [test_general_reach_box_holds_every_trajectory]
3.  *Every cell that the image needs is certified.* `erode_packed`, `erode_rows`, `add_certified`, `covered`.
    [test_recursion_agrees_with_the_twin]
4.  *All times count, not samples.* The joints are bounded over each part of the interval (`joint_ends`), the pursuer by
    its reach at the part's end (`touch_swept`), a disk by its speed (`disks_clear`). [test_no_time_is_left_out]
5.  *All states of the cell count, not its corners.* The remainder of `link_points`. [test_hulls_hold_the_links]
6.  *A cell of the pursuer counts whole.* `touch_cells`. [test_pursuer_is_met_wherever_it_can_meet]
7.  *Rounding is outward.* `MARGIN`, added to every radius. [test_contact_within_rounding_is_not_clear]
8.  *States and plants are in floating point too.* A state within `SLACK` = 1e-10 of a certified cell counts as in it.
    Under an input certified for that cell the next state is within SLACK, plus what the plant rounds, of a certified
    cell, and the tube as near to a clear one: `MARGIN` covers both. So a run that starts in a certified cell may drift
    by 1e-10 in all, through the plant's rounding or because a velocity is not the decimal that `measured` takes it for;
    both are below 1e-12 in a step. [test_state_on_an_edge]
9.  *The target is reached by every state of the cell, outside G.* `tip_inside` and the tests of an instant.
    [test_goal_cells_are_inside_the_target]
10. *The controller finds an input wherever the set promises one.* `arm_inputs` asks the same questions of the same cell
    with half the margin. [test_every_certified_state_has_an_input]

The proof is for the problem as data: arm, disks, speeds, bounds. The unsafe set counts at every instant, so `view_time`
makes no difference here. Images lose nothing where cells are aligned (`sdhj.certified.cells`); what is lost against the
exact set is a layer of cells along the target, the obstacles and the pursuer.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar

import numpy as np
from tqdm import tqdm

from sdhj.arm.case_studies import scene
from sdhj.certified.arm_proof import ArmProof, at_rest, is_arm, known_disks, packed_window
from sdhj.certified.cells import CellAxis, aligned_width, exact, measured, period_bounds, velocity_bounds
from sdhj.certified.contact import cells_clear, pursuer_clear, tip_in_disk, tip_near_cells
from sdhj.certified.general_proof import (
    ALLOWANCE,
    Boxes,
    GeneralProof,
    LipschitzBounds,
    Reach,
    check_bounds,
    check_seams,
    cover,
    timed,
)
from sdhj.certified.packed import STATE_SLACK, add_certified, covered, erode_packed, erode_rows, to_bits, to_words
from sdhj.certified.table import CertifiedTable
from sdhj.checks import whole
from sdhj.compiling import hidden
from sdhj.grid import FloatArray
from sdhj.memory import require
from sdhj.problem import ReachAvoidProblem
from sdhj.table import entry

ARM_CELLS = (419, 419, 72, 72)
GENERAL_CELLS = 64  # on each axis


@dataclass(frozen=True)
class Certified:
    """The method that proves what it says: every answer holds for every state, adversary and time.

    Parameters
    ----------
    cells : sequence of int, optional
        About how many cells each axis gets; the number is moved to one whose cells are aligned with the inputs and the
        disturbance where there is one. More cells, a larger certified set. By default (419, 419, 72, 72) for the arm.
    bounds : LipschitzBounds, optional
        For a problem of your own: how fast its dynamics and level-set functions can change. The case studies need none.
    parts : int
        Into how many parts the interval is cut, for the fastest input, to bound the tube.

    Raises
    ------
    ValueError
        Where an option does not fit; in `sets` also where it does not fit the problem, or a bound is missing.
    """

    cells: Sequence[int] | None = None
    bounds: LipschitzBounds | None = None
    parts: int = 10
    name: ClassVar[str] = "certified"

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", whole("parts", self.parts, least=1))
        if not isinstance(self.bounds, LipschitzBounds | None):
            raise ValueError(f"bounds must be LipschitzBounds, got {self.bounds!r}")
        if self.cells is not None:
            try:
                object.__setattr__(self, "cells", tuple(whole("cells", n, least=2) for n in self.cells))
            except (ValueError, TypeError):
                told = f"cells must be whole numbers of at least 2, one for each axis, got {self.cells!r}"
                raise ValueError(told) from None

    def sets(self, problem: ReachAvoidProblem, progress: bool | None = None) -> "CellSets":
        """The sets of a problem, ready for the recursion; it takes as long to prepare them as to compute them."""
        axes = self.axes(problem)
        if self.bounds is None and is_arm(problem):
            return ArmSets(problem, axes, self.parts, progress)
        return GeneralSets(problem, axes, self.bounds or LipschitzBounds(), self.parts, progress)

    def axes(self, problem: ReachAvoidProblem) -> tuple[CellAxis, ...]:
        """About `cells` cells for each axis, aligned with what one interval does to the state where a width is."""
        grid, delta, cells = problem.grid, measured(problem.delta), self.cells
        if cells is None:
            cells = ARM_CELLS if is_arm(problem) else (GENERAL_CELLS,) * grid.ndim
        if len(cells) != grid.ndim:
            raise ValueError(f"cells must be one number for each of the {grid.ndim} axes, got {list(cells)}")
        axes = []
        for axis, wish in enumerate(cells):
            lower, upper, periodic = grid.lower[axis], grid.upper[axis], grid.periodic[axis]
            extent = period_bounds(lower, upper) if periodic else (exact(upper) - exact(lower),) * 2
            moves: list[Fraction] = []
            for j in range(len(problem.inputs)) if problem.dynamics.constant else ():
                slow, fast = velocity_bounds(problem, axis, j)
                moves += [delta * (slow + fast) / 2, delta * (fast - slow) / 2]
            width = aligned_width(extent[1], not periodic, moves, wish)
            axes.append(CellAxis(exact(lower), extent, width, periodic))
        return tuple(axes)


class CellSets:
    """Every S_k^n as packed blocks; what the recursion asks of them.

    Two sets are kept whole, S_k^n at hand and S_{k+1}^{n-1}; of all others only the rows that they add to the set with
    a step less.
    """

    proof: ArmProof | GeneralProof

    def __init__(self, problem: ReachAvoidProblem, axes: Sequence[CellAxis], parts: int, rows: int) -> None:
        self.problem, self.axes, self.parts = problem, tuple(axes), parts
        self.shape = tuple(axis.count for axis in axes)
        self.bits = math.prod(self.shape[rows:])  # in a block
        self.blocks = math.prod(self.shape[:rows]), -(-self.bits // 64)
        self.added: dict[tuple[int, int], tuple[FloatArray, FloatArray]] = {}  # which rows, and their blocks

    def goal(self, step: int) -> None:
        """S_k^N = L(t_k) minus G(t_k)."""
        self.following = np.zeros(self.blocks, np.uint64)
        self.cells = self.goal_cells(step)
        self._keep(step, 0, self.cells.any(axis=1))

    def extend(self, step: int, within: int) -> None:
        """Entry (step, within) from (step, within - 1) and (step + 1, within - 1)."""
        rows, blocks = self.added[step + 1, within - 1]
        self.following[rows] = blocks
        before = self.cells.copy()
        self.add_cells(step, within)
        self._keep(step, within, (self.cells != before).any(axis=1))

    def stopped(self, step: int, within: int) -> bool:
        """Whether entry (step, within) is the one of (step, within - 1)."""
        return not self.added[step, within][0].size

    def share(self, step: int, within: int) -> None:
        """Entry (step, within) is the one of (step, within - 1)."""
        self._keep(step, within, np.zeros(self.blocks[0], np.bool_))

    def _keep(self, step: int, within: int, changed: FloatArray) -> None:
        rows = np.flatnonzero(changed)
        self.added[step, within] = rows, self.cells[rows]

    def finish(self, details: dict[str, Any]) -> CertifiedTable:
        """The table; `details` get what there is to say of the cells."""
        details |= {"parts": self.parts, "cells": list(self.shape)}
        index = np.zeros((len(self.added), self.blocks[0]), np.uint32)
        pool, used = [np.zeros((1, self.blocks[1]), np.uint64)], 1  # its first block is empty
        for place, (step, within) in enumerate(sorted(self.added)):
            rows, blocks = self.added.pop((step, within))
            index[place] = index[place - 1] if within else 0
            index[place, rows] = np.arange(used, used + rows.size)
            pool.append(blocks)
            used += rows.size
        return CertifiedTable(self.problem, self.axes, index, np.concatenate(pool), self.proof, details)

    def goal_cells(self, step: int) -> FloatArray:
        """Cells inside the target and outside the unsafe set at t_k, as `blocks`."""
        raise NotImplementedError

    def add_cells(self, step: int, within: int) -> None:
        """Add to `cells`, which holds S_k^{n-1}, those that an input takes into `following`."""
        raise NotImplementedError


class ArmSets(CellSets):
    """Of an arm: the agent's part of an image is one erosion for all inputs, the joints' parts two more."""

    def __init__(
        self, problem: ReachAvoidProblem, axes: Sequence[CellAxis], parts: int, progress: bool | None
    ) -> None:
        super().__init__(problem, axes, parts, ArmProof.rows)
        held = len(problem.inputs) + 6  # where each input is clear, two sets, scratch
        needed = 8 * held * math.prod(self.blocks)
        require(needed, f"certifying {math.prod(self.shape):.1e} cells", "use fewer cells")
        self.proof = ArmProof.of(problem, axes, parts)
        self.motion = self.proof.motion
        self.whole = (*self.shape[:2], self.blocks[1])
        self.shifts, self.passes = packed_window(self.motion.window, *self.shape[2:])
        self.clear = list(self._clear_of_agent(progress))

    def _clear_of_agent(self, progress: bool | None) -> Iterator[FloatArray]:
        """For each input the cells from which the agent cannot touch the arm during one interval, each (n1, n2, W)."""
        motion, everything = self.motion, to_words(np.ones(self.bits, np.bool_))
        for j in tqdm(range(motion.parts.size), desc="intervals", disable=hidden(progress)):
            if not motion.pursued:
                yield np.broadcast_to(everything, self.whole)
                continue
            moves = [
                np.ascontiguousarray(motion.moves[axis, j, : self.shape[axis], : motion.parts[j]]) for axis in (0, 1)
            ]
            clear = np.empty(self.whole, np.uint64)
            pursuer_clear(*moves, motion.arm, motion.agent, clear)
            yield clear

    def add_cells(self, step: int, within: int) -> None:
        motion, (n1, n2, words) = self.motion, self.whole
        eroded = self.following.copy()
        erode_packed(eroded, self.shifts, self.passes)
        scratch = np.empty((n1, n2 * words), np.uint64)
        tables = np.stack([motion.first[0, :, :n1], motion.number[0, :, :n1]], axis=1)
        for table in np.unique(tables, axis=0):  # inputs that move the first joint alike
            erode_rows(eroded.reshape(n1, n2 * words), *table, scratch)
            for j in np.flatnonzero((tables == table).all(axis=(1, 2))):
                first, number = motion.first[1, j, :n2], motion.number[1, j, :n2]
                allowed, out = motion.allowed[step, j], self.cells.reshape(self.whole)
                add_certified(scratch.reshape(self.whole), first, number, allowed, self.clear[j], out)

    def goal_cells(self, step: int) -> FloatArray:
        motion, t = self.motion, self.problem.time(step)
        stage, agent = scene(self.problem), motion.agent
        out, (n1, n2) = np.empty(self.whole, np.uint64), self.shape[:2]
        edges = [axis.edges() for axis in self.axes[:2]]
        still = [at_rest(own) for own in edges]
        if stage.target is None:
            tip_near_cells(*still, stage.agent_radius, motion.arm, agent, out)
        else:
            pursuer_clear(*still, motion.arm, agent._replace(delta=0.0, speed=0.0), out)
            inside = np.empty((n1, n2), np.bool_)
            tip_in_disk(*still, stage.target.centre(t), stage.target.radius, motion.arm, inside)
            out *= inside[:, :, None].astype(np.uint64)
        if stage.obstacles:
            clear = np.empty((1, 1, n1, n2), np.bool_)
            known = known_disks(stage, np.full((3, 1), t), 0.0, 0)
            cells_clear(*edges, np.zeros((2, 1, 2)), known, motion.arm, clear)
            out *= clear[0, 0, :, :, None].astype(np.uint64)
        return out.reshape(self.blocks)


class GeneralSets(CellSets):
    """Of any problem: images and tubes of all cells are computed in advance, by Lipschitz bounds."""

    proof: GeneralProof

    def __init__(
        self,
        problem: ReachAvoidProblem,
        axes: Sequence[CellAxis],
        bounds: LipschitzBounds,
        parts: int,
        progress: bool | None,
    ) -> None:
        super().__init__(problem, axes, parts, len(axes) - 1)
        matrix, drifting, sets = bounds.checked(problem)
        check_seams(problem, parts)
        entries, count = entry(problem.steps, problem.steps, 0) + 1, len(problem.inputs)
        starts = range(problem.steps if timed(problem) else 1)
        size = math.prod(self.shape)
        # masks, where each input is clear, images, and the tube of one input
        each = entries * -(-count // 8) + problem.steps * count + 16 * len(axes) * (count * len(starts) + parts + 2)
        require(size * each, f"certifying {size:.1e} cells", "use fewer cells")
        masks = np.zeros((entries, -(-count // 8), size), np.uint8)
        self.proof = GeneralProof(masks, len(axes) - 1, matrix, drifting, sets, parts, count)
        check_bounds(problem, self.proof)
        edges = [axis.edges() for axis in axes]
        self.low, self.high = (_mesh([own[side : own.size - 1 + side] for own in edges]) for side in (0, 1))
        self.clear = np.ones((problem.steps, count, size), np.bool_)
        self.images: dict[tuple[int, int], tuple[FloatArray, FloatArray]] = {}
        reach = Reach(problem, matrix, drifting, parts)
        pairs = list(itertools.product(starts, range(count)))
        for start, j in tqdm(pairs, desc="intervals", disable=hidden(progress)):
            tube, low, high = reach.run(self.low - STATE_SLACK, self.high + STATE_SLACK, j, problem.time(start))
            self.images[start, j] = self._cover(low, high, j)
            for step in [start] if timed(problem) else range(problem.steps):
                for boxes in tube:
                    self.clear[step, j] &= self._clear(boxes, problem.time(step))

    def _clear(self, boxes: Boxes, begin: float) -> FloatArray:
        """Whether boxes are outside every unsafe set at all their times, (M,)."""
        out = np.ones(len(boxes.centre), np.bool_)
        for part in self.problem.unsafe:
            out &= boxes.least(self.problem, part, self.proof.sets[part.name], begin) > 0.0
        return out

    def _cover(self, low: FloatArray, high: FloatArray, j: int) -> tuple[FloatArray, FloatArray]:
        """First cell and number of cells that cover each image, on each axis: two (ndim, cells) int64 arrays."""
        first, number = np.empty((2, len(self.axes), len(low)), np.int64)
        own, delta = np.indices(self.shape).reshape(len(self.axes), -1), measured(self.problem.delta)
        for axis, cells in enumerate(self.axes):
            if self.problem.dynamics.constant:  # exactly
                tables = cells.image(*velocity_bounds(self.problem, axis, j), delta)
                first[axis], number[axis] = (table[own[axis]] for table in tables)
            else:
                first[axis], number[axis] = cover(low[:, axis], high[:, axis], cells)
        return first, number

    def add_cells(self, step: int, within: int) -> None:
        inside = to_bits(self.following, self.bits).ravel()
        reached, new = np.empty_like(inside), np.zeros_like(inside)
        masks = self.proof.masks[entry(self.problem.steps, step, within)]
        for j in range(len(self.problem.inputs)):
            first, number = self.images[step if timed(self.problem) else 0, j]
            covered(inside, first, number, np.array(self.shape), self.clear[step, j], reached)
            masks[j // 8] |= reached.astype(np.uint8) << np.uint8(j % 8)
            new |= reached
        self.cells |= to_words(new.reshape(-1, self.bits))

    def share(self, step: int, within: int) -> None:
        super().share(step, within)
        place = entry(self.problem.steps, step, within)
        self.proof.masks[place] = self.proof.masks[place - 1]

    def goal_cells(self, step: int) -> FloatArray:
        problem, t = self.problem, self.problem.time(step)
        target, half = problem.target, (self.high - self.low) / 2 + STATE_SLACK
        boxes = Boxes((self.low + self.high) / 2, half, 0.0, 0.0)
        axes = list(target.axes)
        value = np.asarray(target.level_set(boxes.centre[:, axes], t), dtype=np.float64)
        most = value + half[:, axes] @ self.proof.sets[target.name] + ALLOWANCE * (1.0 + np.abs(value))
        inside = (most <= 0.0) & self._clear(boxes, t)
        return to_words(inside.reshape(-1, self.bits))


def _mesh(coordinates: Sequence[FloatArray]) -> FloatArray:
    """All combinations of the axes' coordinates, the last axis fastest, (M, ndim)."""
    return np.stack([grid.ravel() for grid in np.meshgrid(*coordinates, indexing="ij")], axis=1)
