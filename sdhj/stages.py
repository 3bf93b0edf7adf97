"""Compiled kernels behind `sdhj.schemes`: one Runge-Kutta stage of a Hamilton-Jacobi equation on the whole grid.

They run over planes of the last two axes, which carry ghost nodes and so are one long loop, free of branches, which the
compiler vectorises; other axes find their neighbouring planes in a table (`Layout`). `stage_constant` and
`stage_general` serve any dimension and order, with one loop for each axis; `stage_constant_4d` and `stage_box_4d` do
the same in four dimensions at second order, with one loop for everything, which keeps all in registers.

All are parallel over pieces of whole rows, each written by one thread, so results do not depend on how many there are.
"""

from typing import NamedTuple

import numpy as np
from numba import prange

from sdhj.compiling import kernel
from sdhj.grid import FloatArray

BLOCKS = 64  # pieces that threads share a stage in
# Fused multiply-adds and the sign of zero may vary; NaN and infinity keep their meaning.
MATH = {"contract", "nsz"}
EACH, RIGHT = (0, 1, 2, 3), (1, 1, 1, 1)  # all axes of four dimensions, none mirrored


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


@kernel(inline="always")
def _smaller(a, b):
    return a if abs(a) < abs(b) else b  # a tie goes to b, the inner difference: mirror images stay mirror images


@kernel(inline="always")
def _upwind2(a2, a1, c, b1, half):
    """Second order: c - a1, corrected by half the smaller of the second differences at a1 and c."""
    d = c - a1
    return d + half * _smaller(d - (a1 - a2), (b1 - c) - d)


@kernel(inline="always")
def _upwind3(a3, a2, a1, c, b1, b2, half, third, sixth):
    """Third order: the parabola through a2, a1, c or a1, c, b1, whichever bends less, then its smaller cubic term."""
    d, e = c - a1, b1 - c
    left, centre = d - (a1 - a2), e - d
    inner = centre - left
    if abs(left) < abs(centre):
        return d + half * left + third * _smaller(left - ((a1 - a2) - (a2 - a3)), inner)
    return d + half * centre - sixth * _smaller(inner, ((b2 - b1) - e) - centre)


@kernel(inline="always")
def _larger(a, b):
    return a if a > b else b


@kernel(fastmath=MATH)
def _add_axis1(rhs, m1, c, p1, f0, f1, f2, f3, f4):
    for i in range(rhs.size):
        minus, plus = c[i] - m1[i], p1[i] - c[i]
        rhs[i] += _larger(_larger(f0 * minus + f1 * plus, f2 * minus + f3 * plus), f4)


@kernel(inline="always")
def _both2(m2, m1, c, p1, p2, half):
    """The upwind differences of second order on both sides, which share a second difference."""
    left, right = c - m1, p1 - c
    bend = right - left
    return left + half * _smaller(left - (m1 - m2), bend), right - half * _smaller((p2 - p1) - right, bend)


@kernel(fastmath=MATH)
def _add_axis2(rhs, m2, m1, c, p1, p2, f0, f1, f2, f3, f4):
    half = rhs.dtype.type(0.5)
    for i in range(rhs.size):
        minus, plus = _both2(m2[i], m1[i], c[i], p1[i], p2[i], half)
        rhs[i] += _larger(_larger(f0 * minus + f1 * plus, f2 * minus + f3 * plus), f4)


@kernel(fastmath=MATH)
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


@kernel(inline="always")
def _run(phi, layout, plane, axis, offset, start, stop):
    """The values `offset` nodes along an axis from those at start:stop of a plane."""
    leading = layout.near.shape[1]
    if axis < leading:
        return phi[layout.near[plane, axis, offset + layout.ghosts], start:stop]
    shift = offset * layout.strides[axis - leading]
    return phi[plane, start + shift : stop + shift]


@kernel(fastmath=MATH)
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


@kernel(fastmath=MATH)
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


@kernel(fastmath=MATH)
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


@kernel(inline="always")
def _godunov(minus, plus, a, b, zero):
    """Godunov's flux for max(a p, b p), a <= b; minus and plus are p- and p+."""
    best = _larger(a * (plus if a > zero else minus), b * (plus if b > zero else minus))
    return _larger(best, zero) if (a < zero) & (b > zero) else best


@kernel(inline="always")
def _lax_friedrichs(minus, plus, a, b, half):
    mean = half * (minus + plus)
    return _larger(a * mean, b * mean) + half * _larger(abs(a), abs(b)) * (plus - minus)


@kernel(fastmath=MATH)
def _add_box(rhs, down, up, low, high, inverse, godunov):
    """Add one axis's numerical Hamiltonian where the velocities [low, high] differ from node to node."""
    half, zero = rhs.dtype.type(0.5), rhs.dtype.type(0.0)
    if godunov:
        for i in range(rhs.size):
            rhs[i] += _godunov(inverse * down[i], -inverse * up[i], low[i], high[i], zero)
    else:
        for i in range(rhs.size):
            rhs[i] += _lax_friedrichs(inverse * down[i], -inverse * up[i], low[i], high[i], half)


@kernel(fastmath=MATH)
def _add_product(total, x, y):
    for i in range(total.size):
        total[i] += x[i] * y[i]


@kernel(fastmath=MATH)
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


@kernel(fastmath=MATH)
def _mean_and_dissipation(rhs, down, up, low, high, inverse):
    """Turn `down` into the mean difference in place, and add the Lax-Friedrichs dissipation to `rhs`."""
    half = rhs.dtype.type(0.5)
    for i in range(rhs.size):
        minus, plus = inverse * down[i], -inverse * up[i]
        down[i] = half * (minus + plus)
        rhs[i] += half * _larger(abs(low[i]), abs(high[i])) * (plus - minus)


@kernel(inline="always")
def _kept(keep, old):
    """keep * old, and 0 where nothing is kept: what was there need not even be a number."""
    return keep * (old if keep > 0 else keep)


@kernel(fastmath=MATH)
def _advance(out, phi, rhs, dt, keep):
    """out = keep * out + (1 - keep) * (phi + dt * rhs): one Runge-Kutta stage."""
    rest = rhs.dtype.type(1.0) - keep
    for i in range(rhs.size):
        out[i] = _kept(keep, out[i]) + rest * (phi[i] + dt * rhs[i])


@kernel(fastmath=MATH)
def _raise_to(out, wall):
    for i in range(out.size):
        out[i] = _larger(out[i], wall[i])


@kernel()
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


@kernel(inline="always")
def _span(layout, task):
    """(plane, first row, last row + 1, start, stop) of a task; start:stop are its first node and behind its last."""
    plane = task // layout.chunks
    chunk = task - plane * layout.chunks
    begin = layout.rows * chunk // layout.chunks
    end = layout.rows * (chunk + 1) // layout.chunks
    start = (begin + layout.top) * layout.width + layout.ghosts
    return plane, begin, end, start, (end + layout.top) * layout.width - layout.ghosts


@kernel(fastmath=MATH)
def _finish(out, wall, layout, span):
    """End one task's part of a stage: the obstacle, then the ghost nodes."""
    plane, begin, end, start, stop = span
    if wall.shape[0] > 0:
        _raise_to(out[plane, start:stop], wall[plane, start:stop])
    _fill_ghosts(out[plane], layout, begin, end)


@kernel(inline="always")
def _around(layout, plane, axis, side, start, size):
    """Where the nodes -2, -1, 1, 2 along an axis from `start` in a plane are, in all planes behind one another.

    side : 1, or -1 for the axis's mirror image.
    """
    if axis < 2:
        n = layout.near[plane, axis]
        m2, m1, p1, p2 = n[2 - 2 * side] * size, n[2 - side] * size, n[2 + side] * size, n[2 + 2 * side] * size
    else:
        here, stride = plane * size, side * layout.strides[axis - 2]
        m2, m1, p1, p2 = here - 2 * stride, here - stride, here + stride, here + 2 * stride
    return np.uint64(m2 + start), np.uint64(m1 + start), np.uint64(p1 + start), np.uint64(p2 + start)


@kernel(inline="always")
def _around_4d(layout, plane, axes, sides, start, size):
    return (
        _around(layout, plane, axes[0], sides[0], start, size),
        _around(layout, plane, axes[1], sides[1], start, size),
        _around(layout, plane, axes[2], sides[2], start, size),
        _around(layout, plane, axes[3], sides[3], start, size),
    )


@kernel(inline="always")
def _both_at(phi, c, i, near, half):
    """The upwind differences along one axis at one node; near from `_around`."""
    return _both2(phi[near[0] + i], phi[near[1] + i], c, phi[near[2] + i], phi[near[3] + i], half)


@kernel(inline="always")
def _constant_at(phi, c, i, near, f, one_sided, half):
    """One axis's numerical Hamiltonian; f from `schemes.reduced_flux`. `one_sided` is known when this is compiled."""
    if one_sided:
        m1, p1, p2 = phi[near[1] + i], phi[near[2] + i], phi[near[3] + i]
        right = p1 - c
        plus = right - half * _smaller((p2 - p1) - right, right - (c - m1))
        return _larger(f[1] * plus, f[2] * plus)
    minus, plus = _both_at(phi, c, i, near, half)
    return _larger(_larger(f[0] * minus + f[1] * plus, f[2] * plus), f[3])


@kernel(inline="always")
def _godunov_at(phi, c, i, near, low, high, at, inverse, half, zero):
    minus, plus = _both_at(phi, c, i, near, half)
    return _godunov(inverse * minus, inverse * plus, low[at + i], high[at + i], zero)


@kernel(inline="always")
def _lax_friedrichs_at(phi, c, i, near, low, high, at, inverse, half):
    minus, plus = _both_at(phi, c, i, near, half)
    return _lax_friedrichs(inverse * minus, inverse * plus, low[at + i], high[at + i], half)


@kernel(inline="always")
def _four(flux, axis):
    return flux[axis, 0], flux[axis, 1], flux[axis, 2], flux[axis, 3]


# A stage in four dimensions, at `count` nodes from `here` on: everything in one loop, so that it stays in registers.
# Arrays are flat, and indices unsigned: the compiler then need not wonder whether they are negative, and vectorises.
@kernel(fastmath=MATH)
def _advance_constant_4d(out, phi, count, here, near, flux, one_sided, dt, keep):
    """For constant velocities; near: four tuples of `_around`, those of the `one_sided` axes first."""
    half, rest, ones = phi.dtype.type(0.5), phi.dtype.type(1.0) - keep, len(one_sided)
    near0, near1, near2, near3 = near
    f0, f1, f2, f3 = _four(flux, 0), _four(flux, 1), _four(flux, 2), _four(flux, 3)
    for node in range(count):
        i = np.uint64(node)
        c = phi[here + i]
        rhs = _constant_at(phi, c, i, near0, f0, ones > 0, half) + _constant_at(phi, c, i, near1, f1, ones > 1, half)
        rhs += _constant_at(phi, c, i, near2, f2, ones > 2, half)
        rhs += _constant_at(phi, c, i, near3, f3, ones > 3, half)
        out[here + i] = _kept(keep, out[here + i]) + rest * (c + dt * rhs)


@kernel(fastmath=MATH)
def _advance_godunov_4d(out, phi, count, here, near, low, high, whole, inverse, dt, keep):
    """For a box of velocities at each node; in low and high each axis has a `whole` grid."""
    half, zero, rest = phi.dtype.type(0.5), phi.dtype.type(0.0), phi.dtype.type(1.0) - keep
    near0, near1, near2, near3 = near
    at1, at2, at3 = here + whole, here + whole + whole, here + whole + whole + whole
    s0, s1, s2, s3 = inverse[0], inverse[1], inverse[2], inverse[3]
    for node in range(count):
        i = np.uint64(node)
        c = phi[here + i]
        rhs = _godunov_at(phi, c, i, near0, low, high, here, s0, half, zero)
        rhs += _godunov_at(phi, c, i, near1, low, high, at1, s1, half, zero)
        rhs += _godunov_at(phi, c, i, near2, low, high, at2, s2, half, zero)
        rhs += _godunov_at(phi, c, i, near3, low, high, at3, s3, half, zero)
        out[here + i] = _kept(keep, out[here + i]) + rest * (c + dt * rhs)


@kernel(fastmath=MATH)
def _advance_lax_friedrichs_4d(out, phi, count, here, near, low, high, whole, inverse, dt, keep):
    """As `_advance_godunov_4d`."""
    half, rest = phi.dtype.type(0.5), phi.dtype.type(1.0) - keep
    near0, near1, near2, near3 = near
    at1, at2, at3 = here + whole, here + whole + whole, here + whole + whole + whole
    s0, s1, s2, s3 = inverse[0], inverse[1], inverse[2], inverse[3]
    for node in range(count):
        i = np.uint64(node)
        c = phi[here + i]
        rhs = _lax_friedrichs_at(phi, c, i, near0, low, high, here, s0, half)
        rhs += _lax_friedrichs_at(phi, c, i, near1, low, high, at1, s1, half)
        rhs += _lax_friedrichs_at(phi, c, i, near2, low, high, at2, s2, half)
        rhs += _lax_friedrichs_at(phi, c, i, near3, low, high, at3, s3, half)
        out[here + i] = _kept(keep, out[here + i]) + rest * (c + dt * rhs)


@kernel(parallel=True, fastmath=MATH)
def stage_constant(phi, out, wall, flux, scratch, layout, dt, keep):
    """One Runge-Kutta stage for a box of velocities that does not depend on the state.

    out = keep * out + (1 - keep) * (phi + dt H(D phi)), and at least `wall`.

    phi, out : (planes, plane) values as `Layout` has them; `out` is modified in place, ghost nodes included.
    wall : the obstacle, likewise, or (0, 0) for none.
    flux : (ndim, 5) coefficients of `flux_coefficients`, divided by dx.
    scratch : (blocks, 1, longest run), to be overwritten.
    """
    tasks = layout.near.shape[0] * layout.chunks
    blocks = min(tasks, BLOCKS)
    for block in prange(blocks):
        for task in range(np.int64(block) * tasks // blocks, (np.int64(block) + 1) * tasks // blocks):
            span = _span(layout, task)
            plane, _, _, start, stop = span
            rhs = scratch[block, 0, : stop - start]
            rhs[:] = 0.0
            for axis in range(flux.shape[0]):
                _add_axis(rhs, phi, layout, plane, axis, start, stop, flux[axis])
            _advance(out[plane, start:stop], phi[plane, start:stop], rhs, dt, keep)
            _finish(out, wall, layout, span)


@kernel(parallel=True, fastmath=MATH)
def stage_general(phi, out, wall, low, high, drift, gain, inverse, godunov, scratch, layout, dt, keep):
    """As `stage_constant`, for velocities that depend on the state or are coupled.

    low, high : (ndim, planes, plane), the extreme velocities of each axis.
    drift, gain : (modes, ndim, planes, plane) and (modes, ndim, D, planes, plane): H = max over modes of
        p . drift + sum_d |p . gain_d|, by Lax-Friedrichs; no modes where the velocities are the box [low, high].
    Any of the four has one plane instead of all where it does not depend on the state.
    scratch : as for `stage_constant`, (blocks, ndim + 5, longest run).
    """
    ndim = low.shape[0]
    tasks = layout.near.shape[0] * layout.chunks
    blocks = min(tasks, BLOCKS)
    for block in prange(blocks):
        own = scratch[block]
        for task in range(np.int64(block) * tasks // blocks, (np.int64(block) + 1) * tasks // blocks):
            span = _span(layout, task)
            plane, _, _, start, stop = span
            rhs, up = own[ndim, : stop - start], own[ndim + 1, : stop - start]
            rhs[:] = 0.0
            for axis in range(ndim):
                down = own[axis, : stop - start]
                a = low[axis, min(plane, low.shape[1] - 1), start:stop]
                b = high[axis, min(plane, high.shape[1] - 1), start:stop]
                _differences(down, up, phi, layout, plane, axis, start, stop)
                if drift.shape[0] == 0:
                    _add_box(rhs, down, up, a, b, inverse[axis], godunov)
                else:
                    _mean_and_dissipation(rhs, down, up, a, b, inverse[axis])
            if drift.shape[0] > 0:
                _add_coupled(rhs, own, drift, gain, plane, start, stop)
            _advance(out[plane, start:stop], phi[plane, start:stop], rhs, dt, keep)
            _finish(out, wall, layout, span)


@kernel(parallel=True, fastmath=MATH)
def stage_constant_4d(phi, out, wall, flux, sides, one_sided, two_sided, layout, dt, keep):
    """`stage_constant` in four dimensions at second order.

    flux, sides : (4, 4) and (4,), of `schemes.reduced_flux`, the one-sided axes first.
    one_sided, two_sided : tuples of axes. How many there are is part of their type: each number is compiled apart.
    """
    size = phi.shape[1]
    flat = out.ravel(), phi.ravel()
    tasks = layout.near.shape[0] * layout.chunks
    blocks = min(tasks, BLOCKS)
    for block in prange(blocks):
        for task in range(np.int64(block) * tasks // blocks, (np.int64(block) + 1) * tasks // blocks):
            span = _span(layout, task)
            plane, _, _, start, stop = span
            here = np.uint64(plane * size + start)
            near = _around_4d(layout, plane, one_sided + two_sided, sides, start, size)
            _advance_constant_4d(*flat, stop - start, here, near, flux, one_sided, dt, keep)
            _finish(out, wall, layout, span)


@kernel(parallel=True, fastmath=MATH)
def stage_box_4d(phi, out, wall, low, high, inverse, godunov, layout, dt, keep):
    """`stage_general` in four dimensions at second order, for boxes; low and high have all planes."""
    size = phi.shape[1]
    flat = out.ravel(), phi.ravel()
    flat_low, flat_high, whole = low.ravel(), high.ravel(), np.uint64(phi.size)
    tasks = layout.near.shape[0] * layout.chunks
    blocks = min(tasks, BLOCKS)
    for block in prange(blocks):
        for task in range(np.int64(block) * tasks // blocks, (np.int64(block) + 1) * tasks // blocks):
            span = _span(layout, task)
            plane, _, _, start, stop = span
            here, near = np.uint64(plane * size + start), _around_4d(layout, plane, EACH, RIGHT, start, size)
            field = flat_low, flat_high, whole, inverse
            if godunov:
                _advance_godunov_4d(*flat, stop - start, here, near, *field, dt, keep)
            else:
                _advance_lax_friedrichs_4d(*flat, stop - start, here, near, *field, dt, keep)
            _finish(out, wall, layout, span)


@kernel(parallel=True)
def to_planes(values, out, layout):
    """Copy values (planes, rows, nodes) into `out` (planes, plane), ghost nodes included."""
    for plane in prange(values.shape[0]):
        _pad(values[plane], out[plane], layout)
        _fill_ghosts(out[plane], layout, 0, layout.rows)


@kernel()
def _pad(values, plane, layout):
    """Copy values (rows, nodes) to where they belong in a flat plane."""
    for row in range(layout.rows):
        base = (row + layout.top) * layout.width + layout.ghosts
        for i in range(layout.nodes):
            plane[base + i] = values[row, i]


@kernel(parallel=True)
def from_planes(phi, out, layout):
    """Copy phi (planes, plane) into `out` (planes, rows, nodes), without the ghost nodes."""
    for plane in prange(out.shape[0]):
        _unpad(phi[plane], out[plane], layout)


@kernel()
def _unpad(plane, values, layout):
    """Copy them back."""
    for row in range(layout.rows):
        base = (row + layout.top) * layout.width + layout.ghosts
        for i in range(layout.nodes):
            values[row, i] = plane[base + i]
