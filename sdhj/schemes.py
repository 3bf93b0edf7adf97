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

Rows along the last axis are contiguous and carry `GHOSTS` ghost nodes at each end; the inner loops run along them, free
of branches, so that the compiler vectorises them. Other axes find their neighbouring rows in a small table.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit, prange

from sdhj.grid import FloatArray, Grid

GHOSTS = 3  # the third-order stencil reaches three nodes to each side
FLUXES = ("godunov", "lax-friedrichs")
ORDERS = (1, 2, 3)
INTEGRATORS = ("euler", "rk2", "rk3")
DTYPES = ("float32", "float64")
VECTOR = 16  # rows are padded to a multiple of this, so that no vector loop has a remainder
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
        the same for every input, so it is solved once and shifted back by interpolation. It applies where all drift is
        constant and along periodic axes; elsewhere, and with "fixed", the drift is differenced like the rest.
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
            if getattr(self, name) not in allowed:
                raise ValueError(f"{name} must be one of {', '.join(map(str, allowed))}, got {getattr(self, name)!r}")
        if not 0.0 < self.cfl <= 1.0:
            raise ValueError(f"cfl must be in (0, 1], got {self.cfl}: a larger step is unstable")


@dataclass(frozen=True)
class Velocities:
    """The velocity set at every node, as the kernels read it.

    A box [lower, upper] for each axis: arrays (ndim,) where it does not depend on the state, (ndim, *shape) where it
    does. Or, where the adversary couples axes or a coordinate was projected out, `drift` (modes, ndim, *shape) and `gain`
    (modes, ndim, D, *shape) with the bounds multiplied in: H = max over modes of p . drift + sum_d |p . gain_d|.
    """

    lower: FloatArray
    upper: FloatArray
    drift: FloatArray | None = None
    gain: FloatArray | None = None

    @property
    def coupled(self) -> bool:
        return self.drift is not None

    def steps(self, grid: Grid, duration: float, cfl: float) -> int:
        """Number of time steps that the CFL condition dt * sum_i max|v_i| / dx_i <= cfl asks for."""
        speed = np.maximum(np.abs(self.lower), np.abs(self.upper))
        rate = np.tensordot(1.0 / np.array(grid.spacing), speed, axes=1).max()
        return int(np.ceil(duration * rate / cfl * (1 - 1e-9)))


@njit(cache=True, inline="always")
def _smaller(a, b):
    return a if abs(a) < abs(b) else b


@njit(cache=True, inline="always")
def _differences1(m1, c, p1):
    return c - m1, p1 - c


@njit(cache=True, inline="always")
def _differences2(m2, m1, c, p1, p2, half):
    left, right = c - m1, p1 - c
    s = right - left
    return (
        left + half * _smaller(left - (m1 - m2), s),
        right - half * _smaller(s, (p2 - p1) - right),
    )


@njit(cache=True, inline="always")
def _differences3(m3, m2, m1, c, p1, p2, p3, half, third, sixth):
    left, right = c - m1, p1 - c
    s0 = right - left
    sm = left - (m1 - m2)
    sp = (p2 - p1) - right
    smm = (m1 - m2) - (m2 - m3)
    spp = (p3 - p2) - (p2 - p1)
    inner, outer_left, outer_right = s0 - sm, sm - smm, spp - sp
    centre = sp - s0
    # p-: the parabola through i-2, i-1, i or through i-1, i, i+1, whichever bends less, then its smaller cubic term
    bend_left = left + half * sm + third * _smaller(outer_left, inner)
    bend_mid = left + half * s0 - sixth * _smaller(inner, centre)
    minus = bend_left if abs(sm) < abs(s0) else bend_mid
    bend_mid = right - half * s0 - sixth * _smaller(inner, centre)
    bend_right = right - half * sp + third * _smaller(centre, outer_right)
    plus = bend_mid if abs(s0) < abs(sp) else bend_right
    return minus, plus


@njit(cache=True)
def _add_axis(rhs, phi, near, shift, flux, order):
    """Add one axis's numerical Hamiltonian along a padded row to `rhs`.

    near : (2 GHOSTS + 1,) rows of `phi` that hold the neighbours; `shift` is 1 where the neighbours lie in the row
    itself (the last axis) and 0 elsewhere.
    flux : (5, n) coefficients of `flux_coefficients`, divided by dx.
    """
    half = rhs.dtype.type(0.5)
    third = rhs.dtype.type(1 / 3)
    sixth = rhs.dtype.type(1 / 6)
    r0, r1, r2, r3, r4, r5, r6 = near[0], near[1], near[2], near[3], near[4], near[5], near[6]
    o0, o1, o2 = GHOSTS - 3 * shift, GHOSTS - 2 * shift, GHOSTS - shift
    o4, o5, o6 = GHOSTS + shift, GHOSTS + 2 * shift, GHOSTS + 3 * shift
    if order == 1:
        for i in range(rhs.size):
            minus, plus = _differences1(phi[r2, i + o2], phi[r3, i + GHOSTS], phi[r4, i + o4])
            up = max(flux[0, i] * minus + flux[1, i] * plus, flux[2, i] * minus + flux[3, i] * plus)
            rhs[i] += max(up, flux[4, i])
    elif order == 2:
        for i in range(rhs.size):
            minus, plus = _differences2(
                phi[r1, i + o1], phi[r2, i + o2], phi[r3, i + GHOSTS], phi[r4, i + o4], phi[r5, i + o5], half
            )
            up = max(flux[0, i] * minus + flux[1, i] * plus, flux[2, i] * minus + flux[3, i] * plus)
            rhs[i] += max(up, flux[4, i])
    else:
        for i in range(rhs.size):
            minus, plus = _differences3(
                phi[r0, i + o0],
                phi[r1, i + o1],
                phi[r2, i + o2],
                phi[r3, i + GHOSTS],
                phi[r4, i + o4],
                phi[r5, i + o5],
                phi[r6, i + o6],
                half,
                third,
                sixth,
            )
            up = max(flux[0, i] * minus + flux[1, i] * plus, flux[2, i] * minus + flux[3, i] * plus)
            rhs[i] += max(up, flux[4, i])


@njit(cache=True)
def _fill_ghosts(row, n, periodic):
    """Fill the ghost nodes of one padded row in place, and the padding behind them with something finite."""
    for g in range(GHOSTS):
        if periodic:
            row[g] = row[n + g]
            row[n + GHOSTS + g] = row[GHOSTS + g]
        else:
            row[g] = row[GHOSTS]
            row[n + GHOSTS + g] = row[n + GHOSTS - 1]
    for i in range(n + 2 * GHOSTS, row.size):
        row[i] = row[GHOSTS]


@njit(cache=True)
def _fill_all_ghosts(phi, n, periodic):
    for r in range(phi.shape[0]):
        _fill_ghosts(phi[r], n, periodic)


@njit(cache=True)
def _neighbour_rows(row, shape, table, out):
    """Fill out[axis, o] with the row that lies o - GHOSTS nodes along each leading axis; `table` is made by `_row_table`."""
    out[shape.size - 1, :] = row  # along the last axis the neighbours lie in the row itself
    stride = 1
    rest = row
    for axis in range(shape.size - 2, -1, -1):
        coordinate = rest % shape[axis]
        rest //= shape[axis]
        for o in range(2 * GHOSTS + 1):
            out[axis, o] = row + (table[axis, o, coordinate] - coordinate) * stride
        stride *= shape[axis]


@njit(cache=True, parallel=True)
def stage_box(phi, first, out, flux, obstacle, shape, table, periodic_last, dt, keep, order):
    """One Runge-Kutta stage for box velocities: out = keep * first + (1 - keep) * (phi + dt H(D phi)), then the obstacle.

    phi, first, out : (rows, width + 2 GHOSTS) padded values; `out` is written, ghosts included.
    flux : (ndim, 1 or rows, 5, width) coefficients; one row serves all where they do not depend on the state.
    obstacle : (rows, width), or (0, 0) for none; out >= obstacle afterwards.
    """
    rows = phi.shape[0]
    ndim = shape.size
    width = phi.shape[1] - 2 * GHOSTS
    varies = 1 if flux.shape[1] > 1 else 0
    rest = phi.dtype.type(1.0) - keep
    blocks = min(rows, 64)
    for block in prange(blocks):
        start = np.int64(block) * rows // blocks
        stop = (np.int64(block) + 1) * rows // blocks
        rhs = np.empty(width, phi.dtype)
        near = np.empty((ndim, 2 * GHOSTS + 1), np.int64)
        for r in range(start, stop):
            _neighbour_rows(r, shape, table, near)
            rhs[:] = 0.0
            for axis in range(ndim):
                _add_axis(rhs, phi, near[axis], 1 if axis == ndim - 1 else 0, flux[axis, r * varies], order)
            for i in range(width):
                rhs[i] = keep * first[r, i + GHOSTS] + rest * (phi[r, i + GHOSTS] + dt * rhs[i])
            if obstacle.shape[0] > 0:
                for i in range(width):
                    rhs[i] = max(rhs[i], obstacle[r, i])
            out[r, GHOSTS : GHOSTS + width] = rhs
            _fill_ghosts(out[r], shape[ndim - 1], periodic_last)


@njit(cache=True)
def _difference_rows(minus, plus, phi, near, shift, inverse, order):
    """Upwind differences p-, p+ along a padded row; `minus` and `plus` (width,) are written."""
    half = phi.dtype.type(0.5)
    third = phi.dtype.type(1 / 3)
    sixth = phi.dtype.type(1 / 6)
    for i in range(minus.size):
        c = i + GHOSTS
        m1, p1 = phi[near[2], c - shift], phi[near[4], c + shift]
        if order == 1:
            left, right = _differences1(m1, phi[near[3], c], p1)
        else:
            m2, p2 = phi[near[1], c - 2 * shift], phi[near[5], c + 2 * shift]
            if order == 2:
                left, right = _differences2(m2, m1, phi[near[3], c], p1, p2, half)
            else:
                m3, p3 = phi[near[0], c - 3 * shift], phi[near[6], c + 3 * shift]
                left, right = _differences3(m3, m2, m1, phi[near[3], c], p1, p2, p3, half, third, sixth)
        minus[i] = inverse * left
        plus[i] = inverse * right


@njit(cache=True, parallel=True)
def stage_coupled(phi, first, out, drift, gain, speed, inverse, obstacle, shape, table, periodic_last, dt, keep, order):
    """One Lax-Friedrichs stage for coupled velocities: H = max over modes of p . drift + sum_d |p . gain_d|.

    drift (modes, ndim, 1 or rows, width), gain (modes, ndim, D, 1 or rows, width); speed (ndim, 1 or rows, width) bounds
    |dH / dp_i| and sets the dissipation. The rest as in `stage_box`.
    """
    rows = phi.shape[0]
    ndim = shape.size
    width = phi.shape[1] - 2 * GHOSTS
    drift_varies = 1 if drift.shape[2] > 1 else 0
    gain_varies = 1 if gain.shape[3] > 1 else 0
    speed_varies = 1 if speed.shape[1] > 1 else 0
    half = phi.dtype.type(0.5)
    zero = phi.dtype.type(0.0)
    blocks = min(rows, 64)
    for block in prange(blocks):
        start = np.int64(block) * rows // blocks
        stop = (np.int64(block) + 1) * rows // blocks
        minus = np.empty((ndim, width), phi.dtype)
        plus = np.empty((ndim, width), phi.dtype)
        near = np.empty((ndim, 2 * GHOSTS + 1), np.int64)
        for r in range(start, stop):
            _neighbour_rows(r, shape, table, near)
            for axis in range(ndim):
                _difference_rows(
                    minus[axis], plus[axis], phi, near[axis], 1 if axis == ndim - 1 else 0, inverse[axis], order
                )
            for i in range(width):
                best = phi.dtype.type(-np.inf)
                for mode in range(drift.shape[0]):
                    value = zero
                    for axis in range(ndim):
                        value += half * (minus[axis, i] + plus[axis, i]) * drift[mode, axis, r * drift_varies, i]
                    for d in range(gain.shape[2]):
                        push = zero
                        for axis in range(ndim):
                            push += half * (minus[axis, i] + plus[axis, i]) * gain[mode, axis, d, r * gain_varies, i]
                        value += abs(push)
                    best = max(best, value)
                for axis in range(ndim):
                    best += half * speed[axis, r * speed_varies, i] * (plus[axis, i] - minus[axis, i])
                value = phi[r, GHOSTS + i] + dt * best
                value = keep * first[r, GHOSTS + i] + (phi.dtype.type(1.0) - keep) * value
                out[r, GHOSTS + i] = value if obstacle.shape[0] == 0 else max(value, obstacle[r, i])
            _fill_ghosts(out[r], shape[ndim - 1], periodic_last)


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


def _row_table(grid: Grid) -> FloatArray:
    """table[axis, o, c]: the node o - GHOSTS along a leading axis from node c, wrapped or, at a wall, held (constant)."""
    table = np.zeros((max(grid.ndim - 1, 1), 2 * GHOSTS + 1, max(grid.shape)), np.int64)
    for axis in range(grid.ndim - 1):
        n = grid.shape[axis]
        for o in range(2 * GHOSTS + 1):
            moved = np.arange(n) + o - GHOSTS
            table[axis, o, :n] = moved % n if grid.periodic[axis] else np.clip(moved, 0, n - 1)
    return table


def _rows(grid: Grid, values: FloatArray, leading: int, dtype: str) -> FloatArray:
    """Arrange (leading..., *grid.shape), or (leading...,) where the state does not matter, as (leading..., rows or 1, width).

    The width is the last axis rounded up to whole vectors; what lies behind the nodes is copied from the last one.
    """
    n = grid.shape[-1]
    head = values.shape[:leading]
    rows = np.broadcast_to(values[..., None, None], (*head, 1, n)) if values.ndim == leading else values.reshape(*head, -1, n)
    fill = [(0, 0)] * (leading + 1) + [(0, -n % VECTOR)]
    return np.ascontiguousarray(np.pad(rows, fill, mode="edge"), dtype=dtype)


def _pad(grid: Grid, values: FloatArray, dtype: str) -> FloatArray:
    """Rows with ghost nodes and padding, shape (rows, width + 2 GHOSTS)."""
    rows = np.pad(_rows(grid, values, 0, dtype), ((0, 0), (GHOSTS, GHOSTS)))
    _fill_all_ghosts(rows, grid.shape[-1], grid.periodic[-1])
    return rows


def _prepare(grid: Grid, velocities: Velocities, scheme: Scheme) -> tuple[FloatArray, ...]:
    """What the stage kernel reads of the velocities, in the scheme's precision."""
    inverse = 1.0 / np.array(grid.spacing)
    if velocities.drift is None or velocities.gain is None:
        flux = np.moveaxis(flux_coefficients(velocities.lower, velocities.upper, scheme.flux), 0, 1)  # (ndim, 5, ...)
        flux = flux * inverse.reshape(-1, *[1] * (flux.ndim - 1))
        return (np.ascontiguousarray(np.moveaxis(_rows(grid, flux, 2, scheme.dtype), 1, 2)),)
    speed = np.maximum(np.abs(velocities.lower), np.abs(velocities.upper))
    parts = ((velocities.drift, 2), (velocities.gain, 3), (speed, 1))
    return (*(_rows(grid, part, leading, scheme.dtype) for part, leading in parts), inverse.astype(scheme.dtype))


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
    dtype = scheme.dtype
    kind: Any = np.dtype(dtype).type
    steps = velocities.steps(grid, duration, scheme.cfl) if steps is None else steps
    dt = duration / max(steps, 1)

    def wall(tau: float) -> FloatArray:
        if obstacle is None:
            return np.empty((0, 0), dtype)
        return _rows(grid, np.asarray(obstacle(tau) if callable(obstacle) else obstacle), 0, dtype)

    held = wall(0.0)
    if held.size:
        values = np.maximum(values, held[:, : grid.shape[-1]].reshape(grid.shape))
    phi = _pad(grid, values, dtype)
    first, spare = np.empty_like(phi), np.empty_like(phi)
    rates = _prepare(grid, velocities, scheme)
    geometry = (np.array(grid.shape), _row_table(grid), grid.periodic[-1])
    kernel = stage_coupled if velocities.coupled else stage_box
    for step in range(steps):
        first, phi = phi, first
        source = first
        for keep, reached in STAGES[scheme.integrator]:
            if callable(obstacle):
                held = wall((step + reached) * dt)
            out = phi if source is not phi else spare
            kernel(source, first, out, *rates, held, *geometry, kind(dt), kind(keep), scheme.order)
            source = out
        if source is not phi:
            phi, spare = spare, phi
    return np.ascontiguousarray(phi[:, GHOSTS : GHOSTS + grid.shape[-1]]).reshape(grid.shape)
