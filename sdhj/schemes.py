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

The kernels run over planes of the last two axes, which carry ghost nodes and so are one long loop, free of branches and
with few arrays in it, which the compiler vectorises; other axes find their neighbouring planes in a table (`Layout`).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numba import njit, prange

from sdhj.grid import FloatArray, Grid

FLUXES = ("godunov", "lax-friedrichs")
ORDERS = (1, 2, 3)
INTEGRATORS = ("euler", "rk2", "rk3")
DTYPES = ("float32", "float64")
RUN = 1024  # nodes in one loop: long enough to vectorise, short enough for the first-level cache
BLOCKS = 64  # pieces that threads share a stage in
MOST_STEPS = 100_000  # of one PDE; what needs more is a unit mistaken, not a problem
# Fused multiply-adds and the sign of zero may vary; NaN and infinity keep their meaning.
MATH = {"contract", "nsz"}
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
        if not isinstance(cfl, int | float | np.number) or not 0.0 < cfl <= 1.0:
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


class Layout(NamedTuple):
    """How a grid function lies in memory: planes of the last two axes (one row, for one axis alone), with ghost nodes.

    A plane is flat: rows + 2 top padded rows of `width` = nodes + 2 ghosts values. The kernels run over `chunks` runs
    of whole rows of it, ghost nodes in between included, because one long loop is faster than many short ones; the
    ghost nodes are set afterwards.
    """

    near: FloatArray  # (planes, ndim - 2, 2 ghosts + 1): the plane o - ghosts nodes along each leading axis
    source: FloatArray  # (rows + 2 top,): the row whose values each padded row holds
    strides: FloatArray  # of the axes within a plane
    rows: int
    top: int
    nodes: int
    width: int
    ghosts: int
    chunks: int
    periodic: bool  # the last axis


@njit(cache=True, inline="always")
def _smaller(a, b):
    return a if abs(a) < abs(b) else b  # a tie goes to b, the inner difference: mirror images stay mirror images


@njit(cache=True, inline="always")
def _upwind2(a2, a1, c, b1, half):
    """Second order: c - a1, corrected by half the smaller of the second differences at a1 and c."""
    d = c - a1
    return d + half * _smaller(d - (a1 - a2), (b1 - c) - d)


@njit(cache=True, inline="always")
def _upwind3(a3, a2, a1, c, b1, b2, half, third, sixth):
    """Third order: the parabola through a2, a1, c or a1, c, b1, whichever bends less, then its smaller cubic term."""
    d, e = c - a1, b1 - c
    left, centre = d - (a1 - a2), e - d
    inner = centre - left
    if abs(left) < abs(centre):
        return d + half * left + third * _smaller(left - ((a1 - a2) - (a2 - a3)), inner)
    return d + half * centre - sixth * _smaller(inner, ((b2 - b1) - e) - centre)


@njit(cache=True, inline="always")
def _larger(a, b):
    return a if a > b else b


@njit(cache=True, fastmath=MATH)
def _add_axis1(rhs, m1, c, p1, f0, f1, f2, f3, f4):
    for i in range(rhs.size):
        minus, plus = c[i] - m1[i], p1[i] - c[i]
        rhs[i] += _larger(_larger(f0 * minus + f1 * plus, f2 * minus + f3 * plus), f4)


@njit(cache=True, fastmath=MATH)
def _add_axis2(rhs, m2, m1, c, p1, p2, f0, f1, f2, f3, f4):
    half = rhs.dtype.type(0.5)
    for i in range(rhs.size):
        left, right = c[i] - m1[i], p1[i] - c[i]
        bend = right - left
        minus = left + half * _smaller(left - (m1[i] - m2[i]), bend)
        plus = right - half * _smaller((p2[i] - p1[i]) - right, bend)
        rhs[i] += _larger(_larger(f0 * minus + f1 * plus, f2 * minus + f3 * plus), f4)


@njit(cache=True, fastmath=MATH)
def _add_axis3(rhs, m3, m2, m1, c, p1, p2, p3, f0, f1, f2, f3, f4):
    half, third, sixth = rhs.dtype.type(0.5), rhs.dtype.type(1 / 3), rhs.dtype.type(1 / 6)
    for i in range(rhs.size):
        left, right = c[i] - m1[i], p1[i] - c[i]
        far_left, far_right = m1[i] - m2[i], p2[i] - p1[i]
        bend_m, bend, bend_p = left - far_left, right - left, far_right - right
        inner_m, inner_p = bend - bend_m, bend_p - bend
        outer_m = bend_m - (far_left - (m2[i] - m3[i]))
        outer_p = ((p3[i] - p2[i]) - far_right) - bend_p
        near_m = half * bend - sixth * _smaller(inner_m, inner_p)
        near_p = half * bend + sixth * _smaller(inner_p, inner_m)
        far_m = half * bend_m + third * _smaller(outer_m, inner_m)
        far_p = half * bend_p - third * _smaller(outer_p, inner_p)
        minus = left + (far_m if abs(bend_m) < abs(bend) else near_m)
        plus = right - (far_p if abs(bend_p) < abs(bend) else near_p)
        rhs[i] += _larger(_larger(f0 * minus + f1 * plus, f2 * minus + f3 * plus), f4)


@njit(cache=True, inline="always")
def _run(phi, layout, plane, axis, offset, start, stop):
    """The values `offset` nodes along an axis from those at start:stop of a plane."""
    leading = layout.near.shape[1]
    if axis < leading:
        return phi[layout.near[plane, axis, offset + layout.ghosts], start:stop]
    shift = offset * layout.strides[axis - leading]
    return phi[plane, start + shift : stop + shift]


@njit(cache=True, fastmath=MATH)
def _add_axis(rhs, phi, layout, plane, axis, start, stop, f):
    """Add one axis's numerical Hamiltonian for constant velocities; f (5,) from `flux_coefficients`, divided by dx."""
    f0, f1, f2, f3, f4 = f[0], f[1], f[2], f[3], f[4]
    order = layout.ghosts
    m1 = _run(phi, layout, plane, axis, -1, start, stop)
    c = phi[plane, start:stop]
    p1 = _run(phi, layout, plane, axis, 1, start, stop)
    if order == 1:
        _add_axis1(rhs, m1, c, p1, f0, f1, f2, f3, f4)
        return
    m2 = _run(phi, layout, plane, axis, -2, start, stop)
    p2 = _run(phi, layout, plane, axis, 2, start, stop)
    if order == 2:
        _add_axis2(rhs, m2, m1, c, p1, p2, f0, f1, f2, f3, f4)
        return
    m3 = _run(phi, layout, plane, axis, -3, start, stop)
    p3 = _run(phi, layout, plane, axis, 3, start, stop)
    _add_axis3(rhs, m3, m2, m1, c, p1, p2, p3, f0, f1, f2, f3, f4)


@njit(cache=True, fastmath=MATH)
def _differences(down, up, phi, layout, plane, axis, start, stop):
    """Upwind differences: down = dx p-, up = -dx p+ (its mirror image). Both are written."""
    order = layout.ghosts
    far, third = min(2, order), min(3, order)  # a low order reads less than it is handed
    m1 = _run(phi, layout, plane, axis, -1, start, stop)
    m2 = _run(phi, layout, plane, axis, -far, start, stop)
    m3 = _run(phi, layout, plane, axis, -third, start, stop)
    c = phi[plane, start:stop]
    p1 = _run(phi, layout, plane, axis, 1, start, stop)
    p2 = _run(phi, layout, plane, axis, far, start, stop)
    p3 = _run(phi, layout, plane, axis, third, start, stop)
    _upwind(down, m3, m2, m1, c, p1, p2, order)
    _upwind(up, p3, p2, p1, c, m1, m2, order)


@njit(cache=True, fastmath=MATH)
def _upwind(out, a3, a2, a1, c, b1, b2, order):
    """out = the upwind difference of `order` towards a."""
    half, third, sixth = out.dtype.type(0.5), out.dtype.type(1 / 3), out.dtype.type(1 / 6)
    if order == 1:
        for i in range(out.size):
            out[i] = c[i] - a1[i]
    elif order == 2:
        for i in range(out.size):
            out[i] = _upwind2(a2[i], a1[i], c[i], b1[i], half)
    else:
        for i in range(out.size):
            out[i] = _upwind3(a3[i], a2[i], a1[i], c[i], b1[i], b2[i], half, third, sixth)


@njit(cache=True, fastmath=MATH)
def _add_box(rhs, down, up, low, high, inverse, godunov):
    """Add one axis's numerical Hamiltonian where the velocities [low, high] differ from node to node."""
    half, zero = rhs.dtype.type(0.5), rhs.dtype.type(0.0)
    if godunov:
        for i in range(rhs.size):
            a, b, minus, plus = low[i], high[i], inverse * down[i], -inverse * up[i]
            best = _larger(a * (plus if a > zero else minus), b * (plus if b > zero else minus))
            rhs[i] += _larger(best, zero) if (a < zero) & (b > zero) else best
    else:
        for i in range(rhs.size):
            a, b, minus, plus = low[i], high[i], inverse * down[i], -inverse * up[i]
            mean = half * (minus + plus)
            rhs[i] += _larger(a * mean, b * mean) + half * _larger(abs(a), abs(b)) * (plus - minus)


@njit(cache=True, fastmath=MATH)
def _add_product(total, x, y):
    for i in range(total.size):
        total[i] += x[i] * y[i]


@njit(cache=True, fastmath=MATH)
def _add_coupled(rhs, scratch, drift, gain, plane, start, stop):
    """Add max over modes of p . drift + sum_d |p . gain_d|, p the mean differences in the first rows of `scratch`.

    The last three rows of `scratch` are overwritten. Slices are of one row at a time: they are contiguous.
    """
    n, ndim = rhs.size, drift.shape[1]
    drift_plane, gain_plane = min(plane, drift.shape[2] - 1), min(plane, gain.shape[3] - 1)
    best, value, push = scratch[-3, :n], scratch[-2, :n], scratch[-1, :n]
    best[:] = -np.inf
    for mode in range(drift.shape[0]):
        value[:] = 0.0
        for axis in range(ndim):
            _add_product(value, scratch[axis, :n], drift[mode, axis, drift_plane, start:stop])
        for d in range(gain.shape[2]):
            push[:] = 0.0
            for axis in range(ndim):
                _add_product(push, scratch[axis, :n], gain[mode, axis, d, gain_plane, start:stop])
            for i in range(n):
                value[i] += abs(push[i])
        for i in range(n):
            best[i] = _larger(best[i], value[i])
    for i in range(n):
        rhs[i] += best[i]


@njit(cache=True, fastmath=MATH)
def _mean_and_dissipation(rhs, down, up, low, high, inverse):
    """Turn `down` into the mean difference in place, and add the Lax-Friedrichs dissipation to `rhs`."""
    half = rhs.dtype.type(0.5)
    for i in range(rhs.size):
        minus, plus = inverse * down[i], -inverse * up[i]
        down[i] = half * (minus + plus)
        rhs[i] += half * _larger(abs(low[i]), abs(high[i])) * (plus - minus)


@njit(cache=True, fastmath=MATH)
def _advance(out, first, phi, rhs, dt, keep):
    """out = keep * first + (1 - keep) * (phi + dt * rhs): one Runge-Kutta stage."""
    rest = rhs.dtype.type(1.0) - keep
    for i in range(rhs.size):
        out[i] = keep * first[i] + rest * (phi[i] + dt * rhs[i])


@njit(cache=True, fastmath=MATH)
def _raise_to(out, wall):
    for i in range(out.size):
        out[i] = _larger(out[i], wall[i])


@njit(cache=True)
def _fill_ghosts(plane, layout, begin, end):
    """Set the ghost nodes of rows begin:end (counted without ghost rows) of a flat plane, and those made of them."""
    n, g, width = layout.nodes, layout.ghosts, layout.width
    for row in range(begin + layout.top, end + layout.top):
        base = row * width
        for o in range(g):
            left, right = (n + o, g + o) if layout.periodic else (g, n + g - 1)
            plane[base + o] = plane[base + left]
            plane[base + n + g + o] = plane[base + right]
    for ghost in range(2 * layout.top):
        row = ghost if ghost < layout.top else ghost + layout.rows
        source = layout.source[row]
        if begin <= source < end:
            base = (source + layout.top) * width
            plane[row * width : (row + 1) * width] = plane[base : base + width]


@njit(cache=True, inline="always")
def _span(layout, task):
    """(plane, first row, last row + 1, start, stop) of a task; start:stop are its first node and behind its last."""
    plane = task // layout.chunks
    chunk = task - plane * layout.chunks
    begin = layout.rows * chunk // layout.chunks
    end = layout.rows * (chunk + 1) // layout.chunks
    start = (begin + layout.top) * layout.width + layout.ghosts
    return plane, begin, end, start, (end + layout.top) * layout.width - layout.ghosts


@njit(cache=True, fastmath=MATH)
def _finish(out, first, phi, rhs, wall, layout, task, dt, keep):
    """Write one task's part of a stage: Runge-Kutta, then the obstacle, then the ghost nodes."""
    plane, begin, end, start, stop = _span(layout, task)
    target = out[plane, start:stop]
    _advance(target, first[plane, start:stop], phi[plane, start:stop], rhs, dt, keep)
    if wall.shape[0] > 0:
        _raise_to(target, wall[plane, start:stop])
    _fill_ghosts(out[plane], layout, begin, end)


@njit(cache=True, parallel=True, fastmath=MATH)
def stage_constant(phi, first, out, wall, flux, layout, dt, keep):
    """One Runge-Kutta stage for a box of velocities that does not depend on the state.

    out = keep * first + (1 - keep) * (phi + dt H(D phi)), and at least `wall`.

    phi, first, out : (planes, plane) values as `Layout` has them; `out` is written, ghost nodes included.
    wall : the obstacle, likewise, or (0, 0) for none.
    flux : (ndim, 5) coefficients of `flux_coefficients`, divided by dx.
    """
    tasks = layout.near.shape[0] * layout.chunks
    blocks = min(tasks, BLOCKS)
    for block in prange(blocks):
        scratch = np.empty(phi.shape[1], phi.dtype)
        for task in range(np.int64(block) * tasks // blocks, (np.int64(block) + 1) * tasks // blocks):
            plane, _, _, start, stop = _span(layout, task)
            rhs = scratch[: stop - start]
            rhs[:] = 0.0
            for axis in range(flux.shape[0]):
                _add_axis(rhs, phi, layout, plane, axis, start, stop, flux[axis])
            _finish(out, first, phi, rhs, wall, layout, task, dt, keep)


@njit(cache=True, parallel=True, fastmath=MATH)
def stage_general(phi, first, out, wall, low, high, drift, gain, inverse, layout, dt, keep, godunov):
    """As `stage_constant`, for velocities that depend on the state or are coupled.

    low, high : (ndim, planes, plane), the extreme velocities of each axis.
    drift, gain : (modes, ndim, planes, plane) and (modes, ndim, D, planes, plane): H = max over modes of
        p . drift + sum_d |p . gain_d|, by Lax-Friedrichs; no modes where the velocities are the box [low, high].
    Any of the four has one plane instead of all where it does not depend on the state.
    """
    ndim = low.shape[0]
    tasks = layout.near.shape[0] * layout.chunks
    blocks = min(tasks, BLOCKS)
    for block in prange(blocks):
        scratch = np.empty((ndim + 5, phi.shape[1]), phi.dtype)
        for task in range(np.int64(block) * tasks // blocks, (np.int64(block) + 1) * tasks // blocks):
            plane, _, _, start, stop = _span(layout, task)
            rhs, up = scratch[ndim, : stop - start], scratch[ndim + 1, : stop - start]
            rhs[:] = 0.0
            for axis in range(ndim):
                down = scratch[axis, : stop - start]
                a = low[axis, min(plane, low.shape[1] - 1), start:stop]
                b = high[axis, min(plane, high.shape[1] - 1), start:stop]
                _differences(down, up, phi, layout, plane, axis, start, stop)
                if drift.shape[0] == 0:
                    _add_box(rhs, down, up, a, b, inverse[axis], godunov)
                else:
                    _mean_and_dissipation(rhs, down, up, a, b, inverse[axis])
            if drift.shape[0] > 0:
                _add_coupled(rhs, scratch, drift, gain, plane, start, stop)
            _finish(out, first, phi, rhs, wall, layout, task, dt, keep)


@njit(cache=True, parallel=True)
def to_planes(values, out, layout):
    """Copy values (planes, rows, nodes) into `out` (planes, plane), ghost nodes included."""
    n, g, width = layout.nodes, layout.ghosts, layout.width
    for plane in prange(values.shape[0]):
        for row in range(layout.rows):
            base = (row + layout.top) * width + g
            for i in range(n):
                out[plane, base + i] = values[plane, row, i]
        _fill_ghosts(out[plane], layout, 0, layout.rows)


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
    """The kernel that fits the velocities, with all it reads of them: stage(phi, first, out, wall, dt, keep)."""
    inverse, kind = 1.0 / np.array(grid.spacing), np.dtype(scheme.dtype).type
    lower, upper = velocities.lower, velocities.upper
    if lower.ndim == 1 and not velocities.coupled:
        flux = (flux_coefficients(lower, upper, scheme.flux) * inverse).T.astype(scheme.dtype, order="C")
        return lambda phi, first, out, wall, dt, keep: stage_constant(
            phi, first, out, wall, flux, layout, kind(dt), kind(keep)
        )
    none = np.empty((0, grid.ndim))
    drift = none if velocities.drift is None else velocities.drift
    gain = none[..., None] if velocities.gain is None else velocities.gain
    low, high, drift, gain = (
        _field(layout, part, leading, scheme.dtype) for part, leading in ((lower, 1), (upper, 1), (drift, 2), (gain, 3))
    )
    inverse, godunov = inverse.astype(scheme.dtype), scheme.flux == "godunov"
    return lambda phi, first, out, wall, dt, keep: stage_general(
        phi, first, out, wall, low, high, drift, gain, inverse, layout, kind(dt), kind(keep), godunov
    )


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
    first, spare, seen = np.empty_like(phi), np.empty_like(phi), 0.0
    stage = _stage(grid, layout, velocities, scheme)
    for step in range(steps):
        first, phi = phi, first
        source = first
        for keep, reached in STAGES[scheme.integrator]:
            tau = (step + reached) * dt
            if callable(obstacle) and tau != seen:
                held, seen = wall(tau), tau
            out = phi if source is not phi else spare
            stage(source, first, out, held, dt, keep)
            source = out
        if source is not phi:
            phi, spare = spare, phi
    whole = phi.reshape(-1, layout.rows + 2 * layout.top, layout.width)
    inner = whole[:, layout.top : layout.top + layout.rows, layout.ghosts : layout.ghosts + layout.nodes]
    return np.ascontiguousarray(inner).reshape(grid.shape)
