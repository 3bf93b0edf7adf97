"""How far a prediction may be off, proved: the box E of `sdhj.prediction` for certified sets.

The controller moves a measurement on by the delay d in STRIDES steps of Runge and Kutta, each of which adds an average
of velocities without an adversary at points that are as near to where it began as the fastest moves in a stride. Let D
bound how much faster or slower than these the state can be, wherever it is within E + that of where the stride began:

    E >= e + d D(E)

then bounds the error, stride by stride. Walls hold both back, and bring them no farther apart. For velocities that do
not depend on the state D is the adversary's push, and E exactly e + d b.
"""

import itertools
from dataclasses import replace

import numpy as np

from sdhj.certified.bounds import Bounds, LipschitzBounds
from sdhj.certified.cells import unknown
from sdhj.grid import FloatArray
from sdhj.prediction import STRIDES
from sdhj.problem import ReachAvoidProblem
from sdhj.sensing import Sensing

PIECES = 1 << 14  # that the state space is cut into, along the axes that velocities depend on
PIECES_OF_AN_AXIS = 1024  # on each axis; the checker cuts finer
GUESSES = 40
ROUNDED = 1 + 1e-12


def unsure(problem: ReachAvoidProblem, stated: LipschitzBounds) -> FloatArray:
    """E (ndim,); ValueError where no bound is found."""
    sensing, ndim = problem.sensing, problem.grid.ndim
    if not sensing:
        return np.zeros(ndim)
    if problem.dynamics.constant:
        return np.array([float(unknown(problem, axis)) for axis in range(ndim)])
    error = np.broadcast_to(np.array(sensing.error), (ndim,)).copy()
    if not sensing.delay:
        return error
    spread, box = _Spread(problem, stated), error
    for _ in range(GUESSES):
        wider = (error + sensing.delay * spread(box)) * ROUNDED
        if (wider <= box).all():
            return wider
        box = wider * (1 + 1e-3) + 1e-12
        if not (box < np.subtract(problem.grid.upper, problem.grid.lower)).all():
            break
    raise ValueError(f"after a delay of {sensing.delay:g} s nothing is known of the state: the dynamics are too fast")


class _Spread:
    """D: how far velocities may be from those without an adversary, within a box."""

    def __init__(self, problem: ReachAvoidProblem, stated: LipschitzBounds) -> None:
        still = np.zeros(problem.dynamics.adversaries)
        calm = replace(problem, dynamics=replace(problem.dynamics, bounds=still), sensing=Sensing())
        self.problem, self.any, self.calm = problem, Bounds(problem, stated), Bounds(calm, stated)
        grid, known = problem.grid, self.any.reads.any(axis=0)
        pieces = np.where(known, min(int(PIECES ** (1 / max(known.sum(), 1))), PIECES_OF_AN_AXIS), 1)
        corners = np.stack([index.ravel() for index in np.indices(pieces.tolist())], axis=1)
        size = np.subtract(grid.upper, grid.lower) / pieces
        self.low, self.high = grid.lower + corners * size, grid.lower + (corners + 1) * size
        self.strides = []
        for step in range(problem.steps if problem.dynamics.timed else 1):
            cuts = problem.time(step) - problem.sensing.delay * np.arange(STRIDES, -1, -1) / STRIDES
            self.strides += list(zip(cuts[:-1].tolist(), cuts[1:].tolist(), strict=True))
        self.strides = self.strides if problem.dynamics.timed else self.strides[:1]
        nowhere = np.zeros(self.low[:1].shape)
        self.travel = [(nowhere, nowhere)] * (len(self.strides) * len(problem.inputs))
        fastest = zip(*self._ends(self.any, 0.0), strict=True)
        stride = problem.sensing.delay / STRIDES * ROUNDED
        self.travel = [
            (np.minimum(a.min(axis=0), 0) * stride, np.maximum(b.max(axis=0), 0) * stride) for a, b in fastest
        ]

    def _ends(self, bounds: Bounds, more: FloatArray | float) -> FloatArray:
        """Least and greatest velocity near each box, (2, inputs * strides, boxes, ndim)."""
        asked = zip(itertools.product(range(len(self.problem.inputs)), self.strides), self.travel, strict=True)
        found = [
            np.stack(bounds.velocity(j, self.low + back - more, self.high + ahead + more, *times))
            for (j, times), (back, ahead) in asked
        ]
        return np.stack(found, axis=1)

    def __call__(self, box: FloatArray) -> FloatArray:
        least, most = self._ends(self.any, box)
        slow, fast = self._ends(self.calm, 0.0)
        return np.maximum(most - slow, fast - least).max(axis=(0, 1))
