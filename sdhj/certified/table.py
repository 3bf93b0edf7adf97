"""Certified sets behind the interface of a look-up table."""

import hashlib
import os
from dataclasses import dataclass
from typing import Any

import h5py
import numpy as np

from sdhj.certified.sets import CertifiedSets
from sdhj.checks import whole
from sdhj.files import written_table
from sdhj.grid import FloatArray, Grid
from sdhj.problem import ReachAvoidProblem
from sdhj.table import NOT_ADMISSIBLE, Batch, batched, in_a_line

GROUP = "certified"
SLAB = 2**16  # rows of an array that are read at a time for the checksum


@dataclass(frozen=True)
class CertifiedTable:
    """A look-up table whose every answer is proved (`method="certified"`); used like a `LookupTable`.

    The level-set function of S_k^n that it reports is the number of steps in which the target is certified to be
    reached, N - k + 1 where it is not, minus n: whole numbers, <= 0 inside.
    """

    sets: CertifiedSets
    method = GROUP

    def __repr__(self) -> str:
        return in_a_line(self)

    @property
    def problem(self) -> ReachAvoidProblem:
        return self.sets.problem

    @property
    def details(self) -> Any:
        return self.sets.details

    @property
    def grid(self) -> Grid:
        return self.problem.grid

    @property
    def steps(self) -> int:
        return self.problem.steps

    @property
    def nbytes(self) -> int:
        """Bytes that the sets take in memory."""
        return int(self.sets.index.nbytes + self.sets.pool.nbytes)

    def steps_to_go(self, states: FloatArray, step: int) -> FloatArray:
        """Fewest steps certified from each row of `states` (M, ndim) at a step, N - step + 1 where none are: (M,)."""
        return self.sets.steps_to_go(states, step)

    def values(self, *, start: int, within: int) -> FloatArray:
        """Steps to go minus `within` at the nodes of the problem's grid, shape grid.shape, <= 0 where certified."""
        within = min(whole("within", within, least=0), self.steps - whole("start", start, least=0, most=self.steps))
        return (self.steps_to_go(self.grid.points(), start) - within).reshape(self.grid.shape).astype(np.float32)

    def inputs(self, *, start: int, within: int) -> FloatArray:
        """Which inputs are certified at the nodes of the problem's grid: bool, grid.shape + (L,)."""
        marked = self.sets.certified_inputs_many(self.grid.points(), start, within)
        return marked.reshape(*self.grid.shape, len(self.problem.inputs))

    def contains(self, points: FloatArray, *, start: int, within: int) -> FloatArray:
        """Whether each row of `points` (M, ndim) is certified: bool (M,)."""
        return self.sets.contains(points, start=start, within=within)

    def fraction(self, *, start: int, within: int) -> float:
        """Share of the volume of the state space that is certified (of cells, not of nodes)."""
        return self.sets.fraction(start=start, within=within)

    def batch(self, states: FloatArray, step: int) -> Batch:
        """As `LookupTable.batch`, of certified inputs only.

        The margin is the steps to go that the undisturbed successor has, minus those it may have; at most 0 for a
        certified input, and the lower, the sooner the target; +inf for the others. From the target there may be no
        input that is proved to bring the state back into it one step later.
        """
        return batched(self.problem, states, step, self._answer)

    def values_at(self, points: FloatArray, step: int, within: FloatArray) -> FloatArray:
        """Steps to go at points (M, V, ndim) minus within (M,); shape (M, V)."""
        flat = np.ascontiguousarray(points, dtype=np.float64).reshape(-1, self.grid.ndim)
        to_go = self.steps_to_go(flat, step).reshape(points.shape[:2])
        return (to_go - np.asarray(within)[:, None]).astype(np.float64)

    def _answer(self, batch: Batch, rows: FloatArray) -> None:
        states, step = batch.states[rows], batch.step
        to_go = self.steps_to_go(states, step)
        to_go[to_go > self.steps - step] = NOT_ADMISSIBLE
        safe = np.zeros((len(rows), len(self.problem.inputs)), dtype=np.bool_)
        ahead = np.where(to_go == 0, 1, to_go)  # in the target already: inputs that bring the state back into it
        for within in np.unique(ahead[ahead > 0]):
            same = ahead == within
            safe[same] = self.sets.certified_inputs_many(states[same], step, int(within))
        batch.steps_to_go[rows], batch.safe[rows] = to_go, safe
        batch.margins[rows] = self._margins(states, step, ahead, safe)

    def _margins(self, states: FloatArray, step: int, ahead: FloatArray, safe: FloatArray) -> FloatArray:
        margins = np.full(safe.shape, np.inf)
        rows, inputs = np.nonzero(safe)
        if rows.size:
            moves = self.problem.interval(step).displacements(states)
            moved = states[rows] + moves[rows if len(moves) > 1 else 0, inputs]
            successors = self.grid.held(moved)
            margins[rows, inputs] = self.steps_to_go(successors, step + 1) - (ahead[rows] - 1)
        return margins

    def save(self, path: str | os.PathLike[str]) -> None:
        """As `LookupTable.save`."""
        with written_table(path, self) as file:
            group = file.create_group(GROUP)
            self.sets.save(group)
            group.attrs["checksum"] = _checksum(group)

    @classmethod
    def read(cls, file: h5py.File, problem: ReachAvoidProblem) -> "CertifiedTable":
        """The table in an open file; ValueError where it is damaged."""
        group = file[GROUP]
        if group.attrs.get("checksum") != _checksum(group):
            raise ValueError("its contents do not have the checksum they were written with")
        return cls(CertifiedSets.load(group, problem))


def _checksum(group: h5py.Group) -> str:
    """SHA-256 of all attributes and arrays of a group, but for the checksum itself."""
    digest, parts = hashlib.sha256(), [("", group)]
    group.visititems(lambda name, part: parts.append((name, part)))
    for name, part in parts:
        told = {key: np.asarray(part.attrs[key]).tolist() for key in sorted(part.attrs) if key != "checksum"}
        digest.update(repr((name, told)).encode())
        if isinstance(part, h5py.Dataset):
            digest.update(repr((part.dtype.str, part.shape)).encode())
            for begin in range(0, len(part), SLAB):
                digest.update(np.ascontiguousarray(part[begin : begin + SLAB]).data)
    return digest.hexdigest()
