"""Compiled kernels behind `sdhj.solver.schemes`: one Runge-Kutta stage of a Hamilton-Jacobi equation on the whole grid.

`stage` serves any number of dimensions, order of differences and numerical Hamiltonian. What belongs to an axis stands
in a tuple with one entry for each; functions that go through it by calling themselves with what is left of it are
unrolled when compiled (`sdhj.kernels.compiling.inlined`), so all that happens at a node is one loop without branches,
in registers. The loop runs over planes of the last two axes, which carry ghost nodes and so are one long row that the
compiler vectorises; other axes find their neighbouring planes in a table (`Layout`).

Pieces of whole rows are shared by threads, each written by one, so results do not depend on how many there are.
"""

from typing import NamedTuple

import numpy as np
from numba import prange

from sdhj.common.remembering import FloatArray
from sdhj.kernels.compiling import FEW, UNCOUNTED, chosen, inlined, kernel

STENCIL_RADIUS = 3  # nodes to each side that the kernels can read: `_runs_of_axes` has so many runs
BLOCKS = 64  # pieces that threads share a stage in


class Layout(NamedTuple):
    """How a grid function lies in memory: planes of the last two axes (one row, for one axis alone), with ghost nodes.

    A plane is flat: rows + 2 top padded rows of `width` = nodes + 2 ghosts values. Kernels run over `chunks` runs of
    whole rows, ghost nodes included, as one long loop is faster than many short ones; these are set afterwards.
    """

    near: FloatArray  # (planes, ndim, 6): where a plane begins when moved 1, 2, 3 nodes left or right along each axis
    source: FloatArray  # (rows + 2 top,): the row whose values each padded row holds
    rows: int
    top: int
    nodes: int
    width: int
    ghosts: int
    chunks: int
    periodic: bool  # the last axis


@inlined
def _smaller(a, b):
    """Of two numbers the one of smaller magnitude; b where magnitudes are equal."""
    return a if abs(a) < abs(b) else b  # a tie goes to b, the inner difference: mirror images stay mirror images


@inlined
def _larger(a, b):
    """The larger of two numbers."""
    return a if a > b else b


# Upwind differences: dx p- and dx p+ from the value at a node and those 1, 2 and 3 nodes to the left and right of it.
@inlined
def first_order(c, left, right):
    """(dx p-, dx p+), the first differences: phi_i - phi_{i-1} and phi_{i+1} - phi_i."""
    return c - left[0], right[0] - c


@inlined
def second_order(c, left, right):
    """(dx p-, dx p+): first differences, corrected by half the smaller of the second differences at their nodes."""
    half = type(c)(0.5)
    (m1, m2, _), (p1, p2, _) = left, right
    minus, plus = c - m1, p1 - c
    bend = plus - minus
    return minus + half * _smaller(minus - (m1 - m2), bend), plus - half * _smaller((p2 - p1) - plus, bend)


@inlined
def third_order(c, left, right):
    """(dx p-, dx p+): slopes of parabolas, corrected by a third difference (ENO, Osher & Shu 1991).

    The parabola that bends less of two, and the smaller of two third differences.
    """
    half, third, sixth = type(c)(0.5), type(c)(1 / 3), type(c)(1 / 6)
    (m1, m2, m3), (p1, p2, p3) = left, right
    minus, plus = c - m1, p1 - c
    far_minus, far_plus = m1 - m2, p2 - p1
    bend_m, bend, bend_p = minus - far_minus, plus - minus, far_plus - plus
    inner_m, inner_p = bend - bend_m, bend_p - bend
    outer_m, outer_p = bend_m - (far_minus - (m2 - m3)), ((p3 - p2) - far_plus) - bend_p
    near_m = half * bend - sixth * _smaller(inner_m, inner_p)
    near_p = half * bend + sixth * _smaller(inner_p, inner_m)
    far_m = half * bend_m + third * _smaller(outer_m, inner_m)
    far_p = half * bend_p - third * _smaller(outer_p, inner_p)
    return minus + (far_m if abs(bend_m) < abs(bend) else near_m), plus - (far_p if abs(bend_p) < abs(bend) else near_p)


# Numerical Hamiltonians of one axis, H(p) = max(low p, high p) with low <= high, given p- and p+.
@inlined
def godunov(minus, plus, low, high):
    """max(low p, high p), each velocity with its upwind difference; at least 0 where low < 0 < high: standing still."""
    zero = type(low)(0.0)
    best = _larger(low * (plus if low > zero else minus), high * (plus if high > zero else minus))
    return _larger(best, zero) if (low < zero) & (high > zero) else best


@inlined
def lax_friedrichs(minus, plus, low, high):
    """H((p- + p+) / 2) + max(|low|, |high|) (p+ - p-) / 2, of H(p) = max(low p, high p): just enough dissipation."""
    half = type(low)(0.5)
    mean = half * (minus + plus)
    return _larger(low * mean, high * mean) + half * _larger(abs(low), abs(high)) * (plus - minus)


# An order or a numerical Hamiltonian of your own is a function like those above and an entry in its table here.
DIFFERENCES = {1: first_order, 2: second_order, 3: third_order}
HAMILTONIANS = {"godunov": godunov, "lax-friedrichs": lax_friedrichs}
_differences, _hamiltonian = chosen(DIFFERENCES), chosen(HAMILTONIANS)


@inlined
def _runs_of_axes(rest, near, start, first, velocities):
    """For each axis a tuple of where the three runs to its left and the three to its right begin, and its `_velocity`.

    Before the loop and kept in registers: for all the compiler knows, the loop may write to any array.
    """
    if len(rest) == 0:
        return ()
    axis = len(near) - len(rest)
    at = near[axis]
    left = np.uint64(at[0] + start), np.uint64(at[1] + start), np.uint64(at[2] + start)
    right = np.uint64(at[3] + start), np.uint64(at[4] + start), np.uint64(at[5] + start)
    this = left, right, _velocity(velocities, axis, len(near), first)
    return (this, *_runs_of_axes(rest[1:], near, start, first, velocities))


@inlined
def _velocity(velocities, axis, ndim, first):
    """(low, high) of an axis over dx; of velocities that depend on the state, their places in the box, and 1 / dx."""
    box = velocities[0]
    if len(velocities) == 1:
        return box[axis], box[ndim + axis]
    size = box.size // (2 * ndim)
    at = first % size  # there may be one plane for all
    return np.uint64(axis * size + at), np.uint64((ndim + axis) * size + at), velocities[1][axis]


@inlined
def _upwind(phi, axis, box, order, c, i):
    """(p-, p+, low, high) of one axis (`_runs_of_axes`) at node i of a run, where phi is c."""
    (l1, l2, l3), (r1, r2, r3), velocity = axis
    left, right = (phi[l1 + i], phi[l2 + i], phi[l3 + i]), (phi[r1 + i], phi[r2 + i], phi[r3 + i])
    return _scaled(*_differences(order, c, left, right), velocity, box, i)


@inlined
def _scaled(minus, plus, velocity, box, i):
    """(p-, p+, low, high) of an axis at node i: the differences times 1 / dx, unless the `_velocity` has it."""
    if len(velocity) == 2:  # constants, which have been divided by dx
        return minus, plus, velocity[0], velocity[1]
    low, high, inverse = velocity
    return inverse * minus, inverse * plus, box[low + i], box[high + i]


@inlined
def _sum_hamiltonians(axes, total, phi, box, order, flux, c, i):
    """`total` plus the numerical Hamiltonians of axes at node i, where phi is c, added one after the other."""
    if len(axes) == 0:
        return total
    total += _hamiltonian(flux, *_upwind(phi, axes[0], box, order, c, i))
    return _sum_hamiltonians(axes[1:], total, phi, box, order, flux, c, i)


@inlined
def _dot(rest, total, p, field, at, stride, i):
    """`total` plus the sum over axes of p[axis, i] field[at + axis stride + i]."""
    if len(rest) == 0:
        return total
    total += p[len(p) - len(rest), i] * field[at + i]
    return _dot(rest[1:], total, p, field, at + stride, stride, i)


@inlined
def _kept(keep, old):
    """keep * old, but 0 where keep is 0: what was there need not even be a number."""
    return keep * (old if keep > 0 else keep)


@kernel(**UNCOUNTED)
def _advance_box(out, phi, here, count, axes, box, order, flux, dt, keep):
    """out = keep out + (1 - keep) (phi + dt H) at `count` nodes from `here` on, in place; flat arrays."""
    # Indices are unsigned: the compiler then need not wonder whether they are negative, and vectorises.
    zero = phi.dtype.type(0.0)
    rest = phi.dtype.type(1.0) - keep
    for node in range(count):
        i = np.uint64(node)
        c = phi[here + i]
        out[here + i] = _kept(keep, out[here + i]) + rest * (
            c + dt * _sum_hamiltonians(axes, zero, phi, box, order, flux, c, i)
        )


@kernel(**UNCOUNTED)
def _mean_and_dissipation(mean, rhs, phi, here, axis, box, order):
    """mean = (p- + p+) / 2 along one axis, and rhs += max(|low|, |high|) (p+ - p-) / 2, (count,) each, in place."""
    half = phi.dtype.type(0.5)
    for node in range(mean.size):
        i = np.uint64(node)
        # Of the hull of all modes, so that one dissipation is enough for each.
        minus, plus, low, high = _upwind(phi, axis, box, order, phi[here + i], i)
        mean[i] = half * (minus + plus)
        rhs[i] += half * _larger(abs(low), abs(high)) * (plus - minus)


@kernel(**UNCOUNTED)
def raise_to(out, bound):
    """out[i] = max(out[i], bound[i]), in place; out, bound (n,)."""
    for i in range(out.size):
        out[i] = _larger(out[i], bound[i])


@kernel()
def _raise_to_mode(best, p, axes, drift, gain, first):
    """best = max(best, p . drift + sum_d |p . gain_d|) for one mode, at the nodes from `first` on, in place.

    best (count,), p (ndim, count), drift (ndim, nodes), gain (ndim, D, nodes), at all nodes or of one plane for all.
    """
    value = np.empty_like(best)
    zero = best.dtype.type(0.0)
    size = drift.shape[1]
    at, stride = np.uint64(first % size), np.uint64(size)
    flat = drift.ravel()
    for node in range(value.size):
        i = np.uint64(node)
        value[i] = _dot(axes, zero, p, flat, at, stride, i)
    for d in range(gain.shape[1]):
        size = gain.shape[2]
        flat = gain.ravel()
        at, stride = np.uint64(d * size + first % size), np.uint64(gain.shape[1] * size)
        for node in range(value.size):
            i = np.uint64(node)
            value[i] += abs(_dot(axes, zero, p, flat, at, stride, i))
    raise_to(best, value)


@kernel()
def _advance_coupled(out, phi, here, count, axes, velocities, order, dt, keep):
    """out = keep out + (1 - keep) (phi + dt (H + dissipation)) at `count` nodes from `here` on, in place; flat arrays.

    H = max over modes of p . drift + sum_d |p . gain_d| at the mean differences p. In several loops: there are too many
    velocities for the registers.
    """
    box, _, drift, gain = velocities
    rest = phi.dtype.type(1.0) - keep
    like = phi[:count]
    p = np.empty((len(axes), count), phi.dtype)
    rhs = np.zeros_like(like)
    best = np.full_like(like, -np.inf)
    for axis in range(len(axes)):
        _mean_and_dissipation(p[axis], rhs, phi, here, axes[axis], box, order)
    for mode in range(len(drift)):
        _raise_to_mode(best, p, axes, drift[mode], gain[mode], np.int64(here))
    for node in range(count):
        i = np.uint64(node)
        out[here + i] = _kept(keep, out[here + i]) + rest * (phi[here + i] + dt * (rhs[i] + best[i]))


@kernel(**UNCOUNTED)
def _fill_ghosts(plane, layout, begin, end):
    """Set, in place, the ghost nodes of rows begin:end of a flat plane, and the ghost rows that copy these."""
    # by the rule by which `_with_ghosts` in `sdhj.solver.schemes` makes them at first
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
        for i in range(width if begin <= source < end else 0):  # slices bring an error message, seconds of compiling
            plane[row * width + i] = plane[(source + layout.top) * width + i]


@kernel()  # where references are not counted, neither are those of what is called, and `_advance_coupled` allocates
def _stage_share(phi, out, obstacle, velocities, order, flux, layout, dt, keep, share, shares):
    """One thread's share of `stage`, number `share` of `shares`: some of the chunks of all planes, in place."""
    flat, ahead, least = phi.ravel(), out.ravel(), obstacle.ravel()
    size = (layout.rows + 2 * layout.top) * layout.width
    tasks = layout.near.shape[0] * layout.chunks
    for task in range(share * tasks // shares, (share + 1) * tasks // shares):
        plane = task // layout.chunks
        chunk = task - plane * layout.chunks
        begin, end = layout.rows * chunk // layout.chunks, layout.rows * (chunk + 1) // layout.chunks
        start = (begin + layout.top) * layout.width + layout.ghosts
        first, count = plane * size + start, (end - begin) * layout.width - 2 * layout.ghosts
        axes = _runs_of_axes(phi.shape, layout.near[plane], start, first, velocities)
        if len(velocities) == 4:
            _advance_coupled(ahead, flat, np.uint64(first), count, axes, velocities, order, dt, keep)
        else:
            _advance_box(ahead, flat, np.uint64(first), count, axes, velocities[0], order, flux, dt, keep)
        # Without an obstacle its array is empty.
        if least.size > 0:
            raise_to(ahead[first : first + count], least[first : first + count])
        _fill_ghosts(ahead[plane * size : (plane + 1) * size], layout, begin, end)


@kernel(parallel=True, least=FEW)
def stage(phi, out, obstacle, velocities, order, flux, layout, dt, keep):
    """One Runge-Kutta stage: out = keep * out + (1 - keep) * (phi + dt H(D phi)), raised to `obstacle`; in place.

    phi, out : values as `Layout` has them, an axis of the array for each of the grid; ghost nodes of out are set.
    obstacle : likewise; or (0,). velocities : a tuple, whose length says what is in it.
        (box,): the lower velocities of all axes, then the upper ones, divided by dx.
        (box, inverse): the same, not divided, each at all nodes as `phi` has them, all in a row; and 1 / dx.
        (box, inverse, drift, gain): coupled velocities, (modes, ndim, nodes) and (modes, ndim, D, nodes), by
        Lax-Friedrichs; the box gives the dissipation.
        Any of them has one plane instead of all where it does not depend on the state.
    order, flux : choices (`choice`) of `DIFFERENCES` and of `HAMILTONIANS`.
    """
    blocks = min(layout.near.shape[0] * layout.chunks, BLOCKS)
    for block in prange(blocks):
        _stage_share(phi, out, obstacle, velocities, order, flux, layout, dt, keep, np.int64(block), blocks)
