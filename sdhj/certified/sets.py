"""Certified sets: reach-avoid tubes that hold on a computer, not only on paper.

A grid with interpolation approximates S_k^i; runs that start inside it can fail. Here the state space is cut into
cells (boxes), and a cell is *certified* for (start k, within n) only where a proof says that every state of the cell is
in the tube. The recursion is that of Theorem 2, with sets of cells:

    S_k^0 = cells inside L(t_k) and outside G(t_k)
    S_k^n = S_k^{n-1} and every cell for which some input u_j has (i) an image, everything that can be reached at
            t_{k+1} from anywhere in the cell, covered by cells of S_{k+1}^{n-1}, and (ii) a tube, everywhere the
            state can be during the interval, clear of G(t) at every time.

The obligations of the proof, where each is met, and the test in tests/test_certified.py that fails without it:

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

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any

import h5py
import numpy as np

from sdhj.certified.arm import ArmProof, is_arm
from sdhj.certified.cells import CellAxis, aligned_width, exact, measured, period_bounds
from sdhj.certified.general import GeneralProof, LipschitzBounds
from sdhj.certified.kernels import Cells, contains, count_bits, fewest_steps
from sdhj.checks import whole
from sdhj.grid import FloatArray
from sdhj.problem import ReachAvoidProblem
from sdhj.table import entry

__all__ = ["CertifiedSets", "LipschitzBounds", "certify"]

ARM_CELLS = (419, 419, 72, 72)
GENERAL_CELLS = 64  # on each axis


@dataclass(frozen=True)
class CertifiedSets:
    """Every certified S_k^n, packed. Made by `certify`; all answers are proved.

    Attributes
    ----------
    problem : ReachAvoidProblem
    axes : tuple of CellAxis
    index : (entries, rows) uint32
        For each (start, within) and each cell of the leading axes, which block of the pool holds its cells.
    pool : (blocks, words) uint64
        Blocks of packed cells of the remaining axes; block 0 is empty.
    proof : ArmProof or GeneralProof
        What one interval does to the cells.
    details : mapping
        How it was computed.
    """

    problem: ReachAvoidProblem
    axes: tuple[CellAxis, ...]
    index: FloatArray
    pool: FloatArray
    proof: ArmProof | GeneralProof
    details: Mapping[str, Any]

    @cached_property
    def cells(self) -> Cells:
        """The cells as arrays for compiled code."""
        return cells_of(self.axes, self.proof.rows)

    @property
    def shape(self) -> tuple[int, ...]:
        """How many cells each axis has."""
        return tuple(axis.count for axis in self.axes)

    def _entry(self, start: int, within: int) -> int:
        steps = self.problem.steps
        start = whole("start", start, least=0, most=steps)
        return entry(steps, start, min(whole("within", within, least=0), steps - start))

    def _states(self, states: FloatArray) -> FloatArray:
        states = np.ascontiguousarray(np.atleast_2d(states), dtype=np.float64)
        if states.ndim != 2 or states.shape[1] != len(self.axes):
            raise ValueError(f"states must have shape (M, {len(self.axes)}), got {states.shape}")
        if not np.isfinite(states).all():
            raise ValueError("states has a NaN or an infinity; every coordinate must be a number")
        return states

    def contains(self, states: FloatArray, *, start: int, within: int) -> FloatArray:
        """Whether each row of `states` (M, ndim) is in a certified cell: bool (M,)."""
        states = self._states(states)
        out = np.empty(len(states), np.bool_)
        contains(states, self.cells, self.index[self._entry(start, within)], self.pool, out)
        return out

    def steps_to_go(self, states: FloatArray, step: int) -> FloatArray:
        """Fewest steps certified from each row of `states` (M, ndim) at a step, N - step + 1 where none are: (M,)."""
        states = self._states(states)
        first, longest = self._entry(step, 0), self.problem.steps - step
        out = np.empty(len(states), np.int64)
        fewest_steps(states, self.cells, self.index[first : first + longest + 1], self.pool, out)
        return out

    def certified_inputs(self, state: FloatArray, step: int, within: int) -> FloatArray:
        """Indices of the inputs that are proved to be safe over the interval and to leave `within` - 1 steps to go.

        For a state in a certified cell there is at least one, but for within = 0; for any other state there is none.
        """
        place = self._entry(step, within)
        state = self._states(state)[0]
        if within == 0 or step == self.problem.steps:
            return np.empty(0, np.int64)
        return np.flatnonzero(
            self.proof.inputs_of(state, step, self.cells, self.index, place, self._following(step, within), self.pool)
        )

    def certified_inputs_many(self, states: FloatArray, step: int, within: int) -> FloatArray:
        """`certified_inputs` for states (M, ndim), as bool (M, L)."""
        place = self._entry(step, within)
        states = self._states(states)
        if within == 0 or step == self.problem.steps:
            return np.zeros((len(states), len(self.problem.inputs)), np.bool_)
        return self.proof.inputs_of_many(
            states, step, self.cells, self.index, place, self._following(step, within), self.pool
        )

    def _following(self, step: int, within: int) -> int:
        return self._entry(step + 1, min(within, self.problem.steps - step) - 1)

    def bits(self, *, start: int, within: int) -> FloatArray:
        """The set as bool, one for each cell; shape `shape`. Large: 900 million for the case study."""
        rows, packed = self.shape[: self.proof.rows], self.shape[self.proof.rows :]
        blocks = self.pool[self.index[self._entry(start, within)]]
        return unpack(blocks, int(np.prod(packed, dtype=np.int64))).reshape(*rows, *packed)

    def fraction(self, *, start: int, within: int) -> float:
        """Share of the volume of the state space that is certified."""
        index = self.index[self._entry(start, within)]
        shares = product([axis.shares() for axis in self.axes[: self.proof.rows]])
        return float(np.sum(self._block_measure[index] * shares.ravel()))

    @cached_property
    def _block_measure(self) -> FloatArray:
        """The share of the packed axes that each block of the pool holds, shape (blocks,)."""
        return block_measure(self.pool, self.axes[self.proof.rows :])

    def save(self, group: h5py.Group) -> None:
        """Write everything into a group of an HDF5 file."""
        group.attrs.update(
            kind=self.proof.kind,
            problem=self.problem.name,
            recipe=json.dumps(dict(self.problem.recipe), sort_keys=True),
            digest=self.problem.digest,
            details=json.dumps(dict(self.details), sort_keys=True),
            shape=self.shape,
            widths=[str(axis.width) for axis in self.axes],
            lowers=[str(axis.lower) for axis in self.axes],
            extents=[[str(bound) for bound in axis.extent] for axis in self.axes],
            periodic=[axis.periodic for axis in self.axes],
            rows=self.proof.rows,
        )
        for name in ("index", "pool"):
            data = getattr(self, name)
            chunks = (1, data.shape[1]) if name == "index" else (min(len(data), 4096), data.shape[1])
            group.create_dataset(name, data=data, chunks=chunks, compression="gzip", compression_opts=1, shuffle=True)
        self.proof.save(group)

    @classmethod
    def load(cls, group: h5py.Group, problem: ReachAvoidProblem) -> "CertifiedSets":
        """Read what `save` wrote; `problem` is the problem it was computed for.

        Raises
        ------
        ValueError
            Where it is another problem.
        """
        if problem.digest != group.attrs["digest"]:
            raise ValueError(f"these certified sets are of {group.attrs['problem']!r} with other numbers or functions")
        if json.loads(group.attrs["recipe"]) != dict(problem.recipe):
            raise ValueError("the certified sets tell another recipe than their table; the file is damaged")
        axes = read_axes(group)
        proofs: dict[str, Any] = {"arm": ArmProof, "general": GeneralProof}
        proof = proofs[str(group.attrs["kind"])].load(group, problem, axes)
        return cls(problem, axes, group["index"][()], group["pool"][()], proof, json.loads(group.attrs["details"]))


def read_axes(group: h5py.Group) -> tuple[CellAxis, ...]:
    """The cells that `CertifiedSets.save` described."""
    return tuple(
        CellAxis(Fraction(lower), (Fraction(extent[0]), Fraction(extent[1])), Fraction(width), bool(periodic))
        for lower, extent, width, periodic in zip(
            *(group.attrs[name] for name in ("lowers", "extents", "widths", "periodic")), strict=True
        )
    )


def cells_of(axes: Sequence[CellAxis], rows: int) -> Cells:
    """Cells as arrays for compiled code; the first `rows` axes number the blocks."""
    return Cells(
        lower=np.array([float(axis.lower) for axis in axes]),
        width=np.array([float(axis.width) for axis in axes]),
        length=np.array([float(sum(axis.extent) / 2) for axis in axes]),
        counts=np.array([axis.count for axis in axes], dtype=np.int64),
        periodic=np.array([axis.periodic for axis in axes]),
        rows=rows,
    )


def product(factors: Sequence[FloatArray]) -> FloatArray:
    """Outer product of vectors, one axis for each."""
    total = np.ones(())
    for factor in factors:
        total = total[..., None] * factor
    return total


def unpack(blocks: FloatArray, bits: int) -> FloatArray:
    """Blocks (R, W) as bool (R, bits)."""
    return np.unpackbits(blocks.view(np.uint8), axis=1, count=bits, bitorder="little").view(np.bool_)


def block_measure(pool: FloatArray, axes: Sequence[CellAxis]) -> FloatArray:
    """The share of the volume of `axes` that each block (blocks, words) holds."""
    if all(axis.count * axis.width == axis.extent[0] for axis in axes):  # equal cells: counting is enough
        return count_bits(pool) / float(np.prod([axis.count for axis in axes], dtype=np.int64))
    shares = product([axis.shares() for axis in axes]).ravel()
    return np.concatenate(
        [unpack(chunk, shares.size) @ shares for chunk in np.array_split(pool, 1 + len(pool) // 65536)]
    )


def cell_axes(problem: ReachAvoidProblem, cells: Sequence[int] | None) -> tuple[CellAxis, ...]:
    """About `cells` cells for each axis, aligned with what one interval does to the state where a width is."""
    grid, dynamics = problem.grid, problem.dynamics
    if cells is None:
        cells = ARM_CELLS if is_arm(problem) else (GENERAL_CELLS,) * grid.ndim
    try:
        cells = [whole("cells", n, least=2) for n in cells]
        fits = len(cells) == grid.ndim
    except (ValueError, TypeError):
        fits = False
    if not fits:
        raise ValueError(f"cells must be a whole number of at least 2 for each of the {grid.ndim} axes, got {cells!r}")
    axes = []
    for axis, wish in enumerate(cells):
        lower, upper, periodic = grid.lower[axis], grid.upper[axis], grid.periodic[axis]
        extent = period_bounds(lower, upper) if periodic else (exact(upper) - exact(lower),) * 2
        moves = []
        if dynamics.constant:
            push = [
                abs(measured(g)) * measured(b)
                for g, b in zip(np.asarray(dynamics.gain)[axis], dynamics.bounds, strict=True)
            ]
            moves = [measured(f) * measured(problem.delta) for f in set(np.asarray(dynamics.drift)[:, axis])]
            moves.append(sum(push, Fraction(0)) * measured(problem.delta))
        width = aligned_width(extent[1], not periodic, moves, int(wish))
        axes.append(CellAxis(exact(lower), extent, width, periodic))
    return tuple(axes)


def certify(
    problem: ReachAvoidProblem,
    *,
    cells: Sequence[int] | None = None,
    bounds: LipschitzBounds | None = None,
    parts: int = 10,
    progress: bool | None = None,
) -> CertifiedSets:
    """Compute certified reach-avoid tubes: every answer holds for every state, adversary and time.

    Parameters
    ----------
    problem : ReachAvoidProblem
    cells : sequence of int, optional
        About how many cells each axis gets; the number is moved to one whose cells are aligned with the inputs and the
        disturbance where there is one. More cells, a larger certified set. By default (419, 419, 72, 72) for the arm.
    bounds : LipschitzBounds, optional
        For a problem of your own: how fast its dynamics and level-set functions can change with the state. The case
        studies need none.
    parts : int
        Into how many parts the interval is cut, for the fastest input, to bound the tube.
    progress : bool, optional
        Show a progress bar; by default where standard error is a terminal.

    Raises
    ------
    ValueError
        Where `cells` or `parts` do not fit, or a bound is missing.
    """
    parts = whole("parts", parts, least=1)
    if not isinstance(bounds, LipschitzBounds | None):
        raise ValueError(f"bounds must be LipschitzBounds, got {bounds!r}")
    started = time.perf_counter()
    axes = cell_axes(problem, cells)
    proof: ArmProof | GeneralProof
    if bounds is None and is_arm(problem):
        proof = ArmProof.prepare(problem, axes, parts)
    else:
        proof = GeneralProof.prepare(problem, axes, bounds, parts)
    index, pool = proof.recursion(problem, axes, progress)
    details = {"parts": parts, "cells": [axis.count for axis in axes], "seconds": time.perf_counter() - started}
    return CertifiedSets(problem, axes, index, pool, proof, details)
