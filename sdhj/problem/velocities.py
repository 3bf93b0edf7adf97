"""Velocity sets at the nodes of a grid, as games take them, and how many time steps they ask for."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sdhj.common.remembering import FloatArray, ReadOnly
from sdhj.problem.grid import Grid

MOST_STEPS = 100_000  # time steps of one PDE; whatever needs more has a wrong unit


@dataclass(frozen=True)
class Velocities(ReadOnly):
    """The velocity set under one input at every node, as the kernels take it: low_i <= v_i <= high_i on axis i.

    Where it is no box, `drift` and `gain` have it as modes, and low and high are their hull: H(p) = max over modes of p
    . drift + sum_d |p . gain_d|. Arrays are made read-only in place.
    """

    # per second: (ndim,) where they do not depend on the state, (ndim, *shape), or lists of ndim arrays that broadcast
    low: Any
    high: Any
    # (modes, ndim, *shape), without `shape` where they depend on no state; None where the set is a box
    drift: FloatArray | None = None
    gain: FloatArray | None = None  # (modes, ndim, D, *shape), times the bounds of v
    shape: tuple[int, ...] = ()  # of the grid, where low and high are lists
    # what `sdhj.solver.schemes` makes of them for the kernels, filled there in place; None: it is not kept
    terms: dict[Any, Any] | None = field(default=None, repr=False)

    @property
    def coupled(self) -> bool:
        """Whether it has modes: the adversary couples axes, or coordinates left out move several."""
        return self.drift is not None

    @property
    def nbytes(self) -> int:
        """Bytes of low, high, drift and gain; `terms` are not counted."""
        parts = [part for part in (self.low, self.high, self.drift, self.gain) if part is not None]
        return sum(one.nbytes for part in parts for one in ([part] if isinstance(part, np.ndarray) else part))

    def steps(self, grid: Grid, duration: float, cfl: float) -> int:
        """How many equal time steps dt the CFL condition asks for: dt max over nodes of sum_i |v_i| / dx_i <= cfl."""
        speed = [np.maximum(np.abs(low), np.abs(high)) for low, high in zip(self.low, self.high, strict=True)]
        # no BLAS, whose threads would compete with the kernels'
        rate = np.max(sum(along / spacing for along, spacing in zip(speed, grid.spacing, strict=True)))
        count = duration * float(rate) / cfl * (1 - 1e-9)  # a whole number stays one after rounding
        if count > MOST_STEPS:
            what = f"time steps for each PDE, at cfl {cfl:g}"
            raise too_fast_error(grid, np.array([along.max() for along in speed]), duration, count, what)
        return int(np.ceil(count))


def checked_travel(grid: Grid, speed: FloatArray, duration: float) -> FloatArray:
    """How many cells are crossed along each axis in `duration` s; ValueError above `MOST_STEPS`."""
    cells = [float(v) * duration / dx for v, dx in zip(speed, grid.spacing, strict=True)]
    if max(cells) > MOST_STEPS:
        raise too_fast_error(grid, speed, duration, max(cells), "cells to be crossed")
    return np.array(cells)


def too_fast_error(grid: Grid, speed: FloatArray, duration: float, count: float, what: str) -> ValueError:
    """The ValueError for an interval that needs more than `MOST_STEPS` at speeds (ndim,)."""
    # The axis that asks for the most steps.
    axis = int(np.argmax(speed / np.array(grid.spacing)))
    return ValueError(
        f"a sampling interval of delta = {duration:g} needs {count:.1e} {what}, and at most {MOST_STEPS:,} are "
        f"supported: along axis {axis} ({grid.names[axis]}) the velocity is up to {speed[axis]:g} and nodes are "
        f"{grid.spacing[axis]:g} apart; use a shorter delta, lower velocities or fewer nodes, or check their units"
    )
