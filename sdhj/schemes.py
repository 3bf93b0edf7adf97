"""Finite differences for Hamilton-Jacobi-Isaacs equations, in any number of dimensions.

Backward in time, with tau = t_{k+1} - t, the games of App. A.3 all read

    d Phi / d tau = H(x, D Phi),      H(x, p) = sup_v  p . f(x, u_j, v),

optionally followed by Phi <- max(Phi, -g). Space is discretised by upwind differences p- and p+ of order 1, 2 or 3
(first order; essentially non-oscillatory, Osher & Shu 1991), which one of two numerical Hamiltonians combines:

* Where the adversary moves every axis on its own, the velocity set is a box, H(x, p) = sum_i max(a_i p_i, b_i p_i)
  with a_i <= b_i the extreme velocities on axis i, and Godunov's flux is exact and cheap (`flux_coefficients`).
* Lax-Friedrichs: H((p- + p+) / 2) + sum_i alpha_i (p+_i - p-_i) / 2, with alpha_i(x) = max(|a_i|, |b_i|) the local
  bound on |dH / dp_i|: just enough dissipation to be monotone, and it works for coupled velocity sets too.

Time is discretised by the total-variation-diminishing Runge-Kutta schemes of order 1, 2, 3 (Shu & Osher 1988).

`sdhj.stages` does the work, on planes of the last two axes.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from sdhj.grid import FloatArray, Grid
from sdhj.stages import (
    BLOCKS,
    Layout,
    from_planes,
    stage_box_4d,
    stage_constant,
    stage_constant_4d,
    stage_general,
    to_planes,
)

FLUXES = ("godunov", "lax-friedrichs")
ORDERS = (1, 2, 3)
INTEGRATORS = ("euler", "rk2", "rk3")
DTYPES = ("float32", "float64")
RUN = 2048  # nodes in one loop: long enough to vectorise, short enough for the first-level cache
MOST_STEPS = 100_000  # of one PDE; what needs more is a unit mistaken, not a problem
# each stage: (weight kept of the step's start, the rest goes to an Euler step from the stage before; time reached)
STAGES = {
    "euler": ((0.0, 1.0),),
    "rk2": ((0.0, 1.0), (0.5, 1.0)),
    "rk3": ((0.0, 1.0), (0.75, 0.5), (1 / 3, 1.0)),
}


@dataclass(frozen=True)
class Scheme:
    """How the PDE is discretised.

    Parameters
    ----------
    flux : {"godunov", "lax-friedrichs"}
        The numerical Hamiltonian. Godunov is sharper; where the adversary couples axes only Lax-Friedrichs applies
        and is used whatever is asked for.
    order : {2, 1, 3}
        Order of the upwind differences.
    integrator : {"rk2", "euler", "rk3"}
    cfl : float
        Fraction of the largest stable step, in (0, 1].
    frame : {"moving", "fixed"}
        "moving" solves the drift of a state-independent velocity exactly: in coordinates that drift along, the PDE is
        the same for every input, so it is solved once and shifted back by interpolation; the avoid games are solved in
        closed form (`sdhj.hopf_lax`). It applies where all drift is constant and along periodic axes; elsewhere, and
        with "fixed", everything is differenced.
    dtype : {"float32", "float64"}
    """

    flux: str = "godunov"
    order: int = 2
    integrator: str = "rk2"
    cfl: float = 0.75
    frame: str = "moving"
    dtype: str = "float32"

    def __post_init__(self) -> None:
        for name, allowed in (
            ("flux", FLUXES),
            ("order", ORDERS),
            ("integrator", INTEGRATORS),
            ("frame", ("moving", "fixed")),
            ("dtype", DTYPES),
        ):
            if (given := getattr(self, name)) not in allowed or type(given) is not type(allowed[0]):
                raise ValueError(f"{name} must be one of {', '.join(map(str, allowed))}, got {given!r}")
        cfl: Any = self.cfl
        if isinstance(cfl, bool) or not isinstance(cfl, int | float | np.number) or not 0.0 < cfl <= 1.0:
            raise ValueError(f"cfl must be a number in (0, 1], got {cfl!r}: a larger step is unstable")


@dataclass(frozen=True)
class Velocities:
    """The velocity set at every node, as the kernels read it.

    A box [lower, upper] for each axis: arrays (ndim,) where it does not depend on the state, (ndim, *shape) where it
    does. Or, where the adversary couples axes or a coordinate was projected out, `drift` (modes, ndim, *shape) and
    `gain` (modes, ndim, D, *shape) with the bounds multiplied in: H = max over modes of p . drift + sum_d |p . gain_d|.
    """

    lower: FloatArray
    upper: FloatArray
    drift: FloatArray | None = None
    gain: FloatArray | None = None

    @property
    def coupled(self) -> bool:
        return self.drift is not None

    @property
    def nbytes(self) -> int:
        return sum(part.nbytes for part in (self.lower, self.upper, self.drift, self.gain) if part is not None)

    def steps(self, grid: Grid, duration: float, cfl: float) -> int:
        """Number of time steps that the CFL condition dt * sum_i max|v_i| / dx_i <= cfl asks for.

        Raises
        ------
        ValueError
            Where it is more than `MOST_STEPS`.
        """
        speed = np.maximum(np.abs(self.lower), np.abs(self.upper))
        rate = np.tensordot(1.0 / np.array(grid.spacing), speed, axes=1).max()
        count = duration * float(rate) / cfl * (1 - 1e-9)
        if count > MOST_STEPS:
            what = f"time steps for each PDE, at cfl {cfl:g}"
            raise too_fast(grid, speed.reshape(grid.ndim, -1).max(axis=1), duration, count, what)
        return int(np.ceil(count))


def too_fast(grid: Grid, speed: FloatArray, duration: float, count: float, what: str) -> ValueError:
    """The error for an interval that would need `count` of `what`, at speeds (ndim,); names the axis most to blame."""
    axis = int(np.argmax(speed / np.array(grid.spacing)))
    return ValueError(
        f"a sampling interval of delta = {duration:g} needs {count:.1e} {what}, and at most {MOST_STEPS:,} are "
        f"supported: along axis {axis} ({grid.names[axis]}) the velocity is up to {speed[axis]:g} and nodes are "
        f"{grid.spacing[axis]:g} apart; use a shorter delta, lower velocities or fewer nodes, or check their units"
    )


def flux_coefficients(lower: FloatArray, upper: FloatArray, flux: str) -> FloatArray:
    """The numerical Hamiltonian of one axis as data: max(c0 p- + c1 p+, c2 p- + c3 p+, c4), returned as (5, ...).

    Both fluxes have this form for H(p) = max(a p, b p), a = lower <= b = upper (arrays of any shape).
    Godunov, the exact solution of the Riemann problem: each extreme velocity takes its upwind difference, and standing
    still is allowed where the velocity set holds zero (a local maximum then stays). Lax-Friedrichs: H of the mean
    difference plus alpha (p+ - p-) / 2, alpha = max(|a|, |b|).
    """
    never = np.full_like(lower, -np.inf)
    if flux == "godunov":
        still = np.where((lower < 0) & (upper > 0), 0.0, never)
        return np.stack([np.minimum(lower, 0), np.maximum(lower, 0), np.minimum(upper, 0), np.maximum(upper, 0), still])
    alpha = np.maximum(np.abs(lower), np.abs(upper))
    return np.stack([lower - alpha, lower + alpha, upper - alpha, upper + alpha, 2 * never]) / 2


def reduced_flux(grid: Grid, velocities: Velocities, scheme: Scheme) -> tuple[Any, ...]:
    """`flux_coefficients` of constant velocities in four dimensions, as `stage_constant_4d` needs them: fewer.

    With axes mirrored so that velocities lean to the right, a + b >= 0, both fluxes are max(c0 p- + c1 p+, c3 p+, c4);
    where c0 = 0 they need p+ alone.

    Returns
    -------
    (4, 4) c0, c1, c3, c4 divided by dx, (4,) -1 where an axis is mirrored, else 1, both with the one-sided axes first;
    and two tuples, the one-sided axes and the others.
    """
    mirrored = velocities.lower + velocities.upper < 0
    lower = np.where(mirrored, -velocities.upper, velocities.lower)
    upper = np.where(mirrored, -velocities.lower, velocities.upper)
    flux = (flux_coefficients(lower, upper, scheme.flux) / np.array(grid.spacing)).T
    one_sided, two_sided = np.flatnonzero(flux[:, 0] == 0), np.flatnonzero(flux[:, 0])
    order = np.concatenate([one_sided, two_sided])
    flux, sides = flux[order][:, [0, 1, 3, 4]].astype(scheme.dtype), np.where(mirrored, -1, 1)[order]
    return flux, sides, tuple(one_sided.tolist()), tuple(two_sided.tolist())


@lru_cache(maxsize=64)
def layout_of(grid: Grid, order: int) -> Layout:
    """The layout of a grid's functions for differences of some order."""
    leading, ghosts = max(grid.ndim - 2, 0), order
    rows, nodes = (1, *grid.shape)[-2:]
    top = ghosts if grid.ndim > 1 else 0
    width = nodes + 2 * ghosts
    strides = (width, 1) if grid.ndim > 1 else (1,)
    coordinates = np.indices(grid.shape[:leading]).reshape(leading, int(np.prod(grid.shape[:leading])))
    near = np.empty((coordinates.shape[1], leading, 2 * ghosts + 1), np.int64)
    for axis in range(leading):
        for o in range(2 * ghosts + 1):
            there = coordinates.copy()
            there[axis] = _neighbour(there[axis] + o - ghosts, grid, axis)
            near[:, axis, o] = np.ravel_multi_index(tuple(there), grid.shape[:leading])
    source = _neighbour(np.arange(-top, rows + top), grid, -2) if grid.ndim > 1 else np.zeros(1, np.int64)
    chunks = max(1, round(rows * width / RUN))
    return Layout(
        near, source, np.array(strides), rows, top, nodes, width, ghosts, min(chunks, rows), grid.periodic[-1]
    )


def _neighbour(node: FloatArray, grid: Grid, axis: int) -> FloatArray:
    """The node that stands for one beyond an end: wrapped or, at a wall, the last one (constant extrapolation)."""
    n = grid.shape[axis]
    return node % n if grid.periodic[axis] else np.clip(node, 0, n - 1)


def _planes(layout: Layout, values: FloatArray, dtype: str) -> FloatArray:
    """Arrange values (*grid.shape) as (planes, plane)."""
    out = np.empty((layout.near.shape[0], (layout.rows + 2 * layout.top) * layout.width), dtype)
    to_planes(np.ascontiguousarray(values).reshape(-1, layout.rows, layout.nodes), out, layout)
    return out


def _field(layout: Layout, values: FloatArray, leading: int, dtype: str) -> FloatArray:
    """Arrange a velocity field (leading..., *grid.shape) as (leading..., planes, plane); a constant one as one."""
    plane = (layout.rows + 2 * layout.top) * layout.width
    if values.ndim == leading:
        return np.ascontiguousarray(np.broadcast_to(values[..., None, None], (*values.shape, 1, plane)), dtype)
    out = np.empty((*values.shape[:leading], layout.near.shape[0], plane), dtype)
    for place in np.ndindex(*values.shape[:leading]):  # none where the adversary has no components
        out[place] = _planes(layout, values[place], dtype)
    return out


def _stage(grid: Grid, layout: Layout, velocities: Velocities, scheme: Scheme) -> Callable[..., None]:
    """The kernel that fits the velocities, with all it reads of them: stage(phi, out, wall, dt, keep)."""
    kind, fused = np.dtype(scheme.dtype).type, (grid.ndim, scheme.order) == (4, 2)
    inverse = 1.0 / np.array(grid.spacing)
    kernel: Any
    reads: tuple[Any, ...]
    if velocities.lower.ndim == 1 and not velocities.coupled:
        if fused:
            kernel, reads = stage_constant_4d, reduced_flux(grid, velocities, scheme)
        else:
            flux = flux_coefficients(velocities.lower, velocities.upper, scheme.flux) * inverse
            flux = flux.T.astype(scheme.dtype, order="C")
            kernel, reads = stage_constant, (flux, _scratch(layout, 1, scheme.dtype))
    else:
        none = np.empty((0, grid.ndim))
        drift = none if velocities.drift is None else velocities.drift
        gain = none[..., None] if velocities.gain is None else velocities.gain
        parts = ((velocities.lower, 1), (velocities.upper, 1), (drift, 2), (gain, 3))
        fields = [_field(layout, part, leading, scheme.dtype) for part, leading in parts]
        inverse, godunov = inverse.astype(scheme.dtype), scheme.flux == "godunov"
        if fused and not velocities.coupled:
            kernel, reads = stage_box_4d, (*fields[:2], inverse, godunov)
        else:
            scratch = _scratch(layout, grid.ndim + 5, scheme.dtype)
            kernel, reads = stage_general, (*fields, inverse, godunov, scratch)

    def stage(phi: FloatArray, out: FloatArray, wall: FloatArray, dt: float, keep: float) -> None:
        kernel(phi, out, wall, *reads, layout, kind(dt), kind(keep))

    return stage


def _scratch(layout: Layout, rows: int, dtype: str) -> FloatArray:
    """Room for every block of a stage to work in: (blocks, rows, longest run)."""
    blocks = min(layout.near.shape[0] * layout.chunks, BLOCKS)
    return np.empty((blocks, rows, -(-layout.rows // layout.chunks) * layout.width), dtype)


def evolve(
    grid: Grid,
    values: FloatArray,
    velocities: Velocities,
    duration: float,
    scheme: Scheme,
    *,
    obstacle: FloatArray | Callable[[float], FloatArray] | None = None,
    steps: int | None = None,
) -> FloatArray:
    """Solve d Phi / d tau = H(x, D Phi), Phi(tau = 0) = values, with Phi >= obstacle if one is given.

    Parameters
    ----------
    values : (shape) array
        Level-set function at the end of the sampling interval.
    velocities : Velocities
    duration : float
        Length of the interval, s.
    obstacle : (shape) array, or callable tau -> (shape) array, optional
        Phi is kept above it at every stage: -g for an avoid game (App. A.3), tau counted back from the interval's end.
    steps : int, optional
        Number of time steps; by default what the CFL condition asks for.

    Returns
    -------
    (shape) array of the scheme's dtype
    """
    steps = velocities.steps(grid, duration, scheme.cfl) if steps is None else steps
    dt = duration / max(steps, 1)
    layout = layout_of(grid, scheme.order)

    def wall(tau: float) -> FloatArray:
        if obstacle is None:
            return np.empty((0, 0), scheme.dtype)
        return _planes(layout, np.asarray(obstacle(tau) if callable(obstacle) else obstacle), scheme.dtype)

    phi, held = _planes(layout, np.asarray(values), scheme.dtype), wall(0.0)
    if held.size:
        np.maximum(phi, held, out=phi)
    stages, seen = STAGES[scheme.integrator], 0.0
    work, spare = np.empty_like(phi), np.empty_like(phi)  # what is never written takes no memory
    stage = _stage(grid, layout, velocities, scheme)
    for step in range(steps):
        source = phi
        for number, (keep, reached) in enumerate(stages, 1):
            tau = (step + reached) * dt
            if callable(obstacle) and tau != seen:
                held, seen = wall(tau), tau
            out = phi if number == len(stages) > 1 else spare if source is work else work
            if keep and out is not phi:
                np.copyto(out, phi)
            stage(source, out, held, dt, keep)
            source = out
        if source is not phi:
            phi, work = work, phi
    inner = work.ravel()[: grid.size]  # no longer needed: fresh memory would cost a tenth of a solve
    from_planes(phi, inner.reshape(-1, layout.rows, layout.nodes), layout)
    return inner.reshape(grid.shape)
