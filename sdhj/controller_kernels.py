"""Compiled look-ups behind the controller: how many steps to go, which inputs are safe, and by how much.

Serial, without allocation and without Python's lock (`nogil`): a query may run in a thread beside a solve, and a batch
is shared out over threads.

A *span* is the stretch of consecutive nodes on one axis that an interval of coordinates touches; a *block* holds the
values at a product of spans. `grid` is the tuple (lower, spacing, shape, periodic) of `Grid.arrays`.
"""

import numpy as np
from numba import njit

FAR = 1e9  # cells; beyond it a coordinate has too few digits left to place it in a cell
SLACK = 1e-6  # cells beyond a wall that still count as on it, as in `sdhj.interpolation`


@njit(cache=True, inline="always")
def _span(low, high, origin, spacing, nodes, periodic):
    """(first node, count of nodes, weight of the second node at `low`, weight of the last node at `high`).

    On a periodic axis the nodes are to be taken modulo `nodes`. On a bounded axis the interval is clipped at the walls,
    as the velocity is.
    """
    first = (low - origin) / spacing
    last = (high - origin) / spacing
    if periodic:
        base = int(np.floor(first))
        top = max(base, int(np.ceil(last)) - 1)
    else:
        first = min(max(first, 0.0), nodes - 1.0)
        last = min(max(last, 0.0), nodes - 1.0)
        base = min(int(first), nodes - 2)
        top = max(base, min(int(np.ceil(last)) - 1, nodes - 2))
    return base, top - base + 2, first - base, last - top


@njit(cache=True)
def _on_grid(state, grid):
    """Whether a state is finite and within the walls."""
    lower, spacing, shape, periodic = grid
    for axis in range(state.size):
        position = (state[axis] - lower[axis]) / spacing[axis]
        if not (abs(position) < FAR):
            return False
        if not periodic[axis] and not (-SLACK <= position <= shape[axis] - 1 + SLACK):
            return False
    return True


@njit(cache=True)
def _corners(state, axes, grid, index, weight):
    """Flat indices and weights of the nodes around a state on the subgrid of `axes`; returns how many.

    Nodes of weight zero are left out. `index` and `weight`, both (2^len(axes),), are modified in place.
    """
    lower, spacing, shape, periodic = grid
    index[0] = 0
    weight[0] = 1.0
    count = 1
    for axis in axes:
        nodes = shape[axis]
        base, _, right, _ = _span(state[axis], state[axis], lower[axis], spacing[axis], nodes, periodic[axis])
        here = base % nodes
        there = (base + 1) % nodes
        more = count
        for c in range(count):
            start = index[c] * nodes
            if right > 0.0:
                index[more] = start + there
                weight[more] = weight[c] * right
                more += 1
            index[c] = start + here
            weight[c] *= 1.0 - right
        count = more
    return count


@njit(cache=True)
def _interpolated(values, index, weight, count):
    total = 0.0
    for c in range(count):
        total += weight[c] * values[index[c]]
    return total


@njit(cache=True)
def _fewest_steps(tubes, first, most, index, weight, count):
    """Fewest n in 0..most with an interpolated tubes[first + n] <= 0, or -1. Tubes grow with n: bisection."""
    if not (_interpolated(tubes[first + most], index, weight, count) <= 0.0):
        return -1
    low = 0
    high = most
    while low < high:
        middle = (low + high) // 2
        if _interpolated(tubes[first + middle], index, weight, count) <= 0.0:
            high = middle
        else:
            low = middle + 1
    return low


@njit(cache=True)
def _marked(mask, index, count, wanted):
    """wanted[j] = whether every node around the state marks u_j (`mask` (bytes, size) of the table); how many are."""
    total = 0
    for byte in range(mask.shape[0]):
        bits = np.uint8(255)
        for c in range(count):
            bits &= mask[byte, index[c]]
        for j in range(8 * byte, min(8 * byte + 8, wanted.size)):
            wanted[j] = (bits >> np.uint8(j - 8 * byte)) & 1
            total += wanted[j]
    return total


@njit(cache=True)
def _gather(values, order, first, counts, grid, offsets, block):
    """Copy `values` at a product of spans into `block`, the axis order[0] slowest. `offsets` is scratch."""
    _, _, shape, _ = grid
    offsets[0] = 0
    size = 1
    for a in range(order.size):
        axis = order[a]
        stride = 1
        for later in range(axis + 1, shape.size):
            stride *= shape[later]
        nodes = counts[a]
        for c in range(size - 1, -1, -1):  # from the back, so that no entry is overwritten before it is used
            start = offsets[c]
            for i in range(nodes - 1, -1, -1):
                offsets[c * nodes + i] = start + (first[a] + i) % shape[axis] * stride
        size *= nodes
    for c in range(size):
        block[c] = values[offsets[c]]


@njit(cache=True)
def _cut(block, first, counts, inner_first, inner_counts, begin, offsets, part):
    """Copy from `block`, whose axes are those from `begin` on, the product of narrower spans into `part`."""
    offsets[0] = 0
    size = 1
    for a in range(begin, counts.size):
        nodes = inner_counts[a]
        for c in range(size - 1, -1, -1):
            start = offsets[c] * counts[a] + inner_first[a] - first[a]
            for i in range(nodes - 1, -1, -1):
                offsets[c * nodes + i] = start + i
        size *= nodes
    for c in range(size):
        part[c] = block[offsets[c]]


@njit(cache=True)
def _reduce(block, counts, near, far, begin, end, rest):
    """Maximum over intervals along the axes begin..end-1 of `block`, the leading ones, one after the other.

    near, far: weights at the two ends of each span; rest: how many values the axes behind `end` have. In place.
    """
    size = rest
    for a in range(begin, end):
        size *= counts[a]
    for a in range(begin, end):
        nodes = counts[a]
        size //= nodes
        last = (nodes - 1) * size
        for i in range(size):
            value = (1.0 - near[a]) * block[i] + near[a] * block[size + i]
            value = max(value, (1.0 - far[a]) * block[last - size + i] + far[a] * block[last + i])
            for node in range(1, nodes - 1):
                value = max(value, block[node * size + i])
            block[i] = value


@njit(cache=True)
def _worst_values(state, values, low, high, order, shared, grid, scratch, wanted, out):
    """out[j] = maximum of the interpolated `values` over the box state + [low[j], high[j]], for the wanted j.

    The maximum is taken axis by axis as in `sdhj.hopf_lax`, so it errs to the safe side. low, high: (L, ndim); order:
    the axes, first the `shared` ones whose interval is the same for all inputs, which are reduced once for all.
    """
    lower, spacing, shape, periodic = grid
    block, part, near, far, offsets, first, counts = scratch
    inputs, ndim = low.shape
    whole = inputs  # the row of `first` and `counts` for the union over all wanted inputs
    rest = 1
    for a in range(ndim):
        axis = order[a]
        begin = 0
        end = 0
        fresh = True
        for j in range(inputs):
            if not wanted[j] or (a < shared and not fresh):
                continue
            base, nodes, near[j, a], far[j, a] = _span(
                state[axis] + low[j, axis],
                state[axis] + high[j, axis],
                lower[axis],
                spacing[axis],
                shape[axis],
                periodic[axis],
            )
            first[j, a] = base
            counts[j, a] = nodes
            if fresh:
                near[whole, a] = near[j, a]
                far[whole, a] = far[j, a]
            begin = base if fresh else min(begin, base)
            end = base + nodes if fresh else max(end, base + nodes)
            fresh = False
        first[whole, a] = begin
        counts[whole, a] = end - begin
        if a >= shared:
            rest *= end - begin
    _gather(values, order, first[whole], counts[whole], grid, offsets, block)
    _reduce(block, counts[whole], near[whole], far[whole], 0, shared, rest)
    for j in range(inputs):
        if wanted[j]:
            _cut(block, first[whole], counts[whole], first[j], counts[j], shared, offsets, part)
            _reduce(part, counts[j], near[j], far[j], shared, ndim, 1)
            out[j] = part[0]


@njit(cache=True)
def _raise_to_avoid(state, values, axes, grid, index, weight, wanted, out):
    """out[j] = max(out[j], interpolated avoid tube of u_j), wanted j only; values (L, size of the subgrid of axes)."""
    count = _corners(state, axes, grid, index, weight)
    for j in range(out.size):
        if wanted[j]:
            out[j] = max(out[j], _interpolated(values[j], index, weight, count))


@njit(cache=True)
def _judge(wanted, margin, safe):
    """safe[j] = wanted and margin <= 0; returns whether any is."""
    found = False
    for j in range(wanted.size):
        safe[j] = wanted[j] and margin[j] <= 0.0
        found = found or safe[j]
    return found


@njit(cache=True, nogil=True)
def decide(states, step, table, reach, grid, scratch, out):
    """Steps to go, the safe inputs and their margins, for states (M, ndim) at one step (Algorithm 2).

    Parameters
    ----------
    table : (steps, tubes (entries, size), masks (entries, bytes, size), static, static_axes, moving, moving_axes)
        Of the look-up table; static (L, size of its subgrid), moving (steps, L, size of its subgrid).
    reach : (low, high (1 or M, L, ndim), order (ndim,), shared)
        Where each input can take a state until the next sampling time, relative to it; see `_worst_values`.
    scratch : (index, weight, everything, wanted, box)
        Room to work in, from `sdhj.controller`; `everything` is np.arange(ndim).
    out : (to_go (M,), safe (M, L), margin (M, L))
        To be written. to_go is -1 where no tube holds the state; margin is inf where it was not needed.
    """
    steps, tubes, masks, static, static_axes, moving, moving_axes = table
    low, high, order, shared = reach
    index, weight, everything, wanted, box = scratch
    to_go, safe, margin = out
    here = step * (steps + 1) - step * (step - 1) // 2  # the place of (step, 0), see `sdhj.table.entry`
    following = here + steps - step + 1  # the place of (step + 1, 0)
    for m in range(states.shape[0]):
        state = states[m]
        to_go[m] = -1
        safe[m] = False
        margin[m] = np.inf
        if not _on_grid(state, grid):
            continue
        count = _corners(state, everything, grid, index, weight)
        to_go[m] = _fewest_steps(tubes, here, steps - step, index, weight, count)
        if to_go[m] < 0 or step == steps:
            continue
        n = max(to_go[m], 1)  # in the target already: inputs that bring the state back into it
        own = m if low.shape[0] > 1 else 0
        marked = _marked(masks[here + n], index, count, wanted)
        for attempt in range(2):  # the marked inputs first, all of them where none of those will do
            if attempt == 1:
                wanted[:] = True
            elif marked == 0:
                continue
            ahead = tubes[following + n - 1]
            _worst_values(state, ahead, low[own], high[own], order, shared, grid, box, wanted, margin[m])
            _raise_to_avoid(state, static, static_axes, grid, index, weight, wanted, margin[m])
            _raise_to_avoid(state, moving[step], moving_axes, grid, index, weight, wanted, margin[m])
            if _judge(wanted, margin[m], safe[m]):
                break
        else:
            safe[m, np.argmin(margin[m])] = True


@njit(cache=True, nogil=True)
def tube_values(points, places, tubes, grid, scratch, out):
    """out[m, v] = the interpolated tube tubes[places[m]] at points[m, v]; beyond a wall, its value at the wall.

    points (M, V, ndim), places (M,), tubes (entries, size), out (M, V). Coordinates must be finite.
    """
    index, weight, everything = scratch
    for m in range(points.shape[0]):
        for v in range(points.shape[1]):
            count = _corners(points[m, v], everything, grid, index, weight)
            out[m, v] = _interpolated(tubes[places[m]], index, weight, count)
