"""Compiled look-ups behind the controller: how many steps to go, which inputs are safe, and by how much.

Serial, without allocation and without Python's lock (`nogil`): a query may run in a thread beside a solve, and a batch
is shared out over threads.

A *span* is the stretch of consecutive nodes on one axis that an interval of coordinates touches; a *block* holds the
values at a product of spans. `grid` is the tuple (lower, spacing, shape, periodic) of `Grid.arrays`.
"""

from typing import Any

import numpy as np
from numba import njit
from numba.core.options import DefaultOptions

FAR = 1e9  # cells; beyond it a coordinate has too few digits left to place it in a cell
SLACK = 1e-6  # cells beyond a wall that still count as on it, as in `sdhj.interpolation`
TINY = 1e-9  # a weight below it is rounding: the state is on the other node
# Numba would count the references to every array: a view made or dropped is an atomic step on a count that all threads
# share, and many loops here are shorter. Without the counts the compiler also refuses whatever would allocate.
# The option is not among Numba's documented ones: a version without it counts, and is a quarter slower.
UNCOUNTED: Any = {"_nrt": False} if hasattr(DefaultOptions, "_nrt") else {}


@njit(cache=True, inline="always", **UNCOUNTED)
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


@njit(cache=True, **UNCOUNTED)
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


@njit(cache=True, **UNCOUNTED)
def _corners(state, axes, grid, index, weight):
    """Flat indices and weights of the nodes around a state on the subgrid of `axes`; returns how many.

    Nodes of no weight are left out. `index` and `weight`, both (2^len(axes),), are modified in place.
    """
    lower, spacing, shape, periodic = grid
    index[0] = 0
    weight[0] = 1.0
    count = 1
    for axis in axes:
        nodes = shape[axis]
        base, _, right, _ = _span(state[axis], state[axis], lower[axis], spacing[axis], nodes, periodic[axis])
        if right > 1.0 - TINY:
            base += 1
            right = 0.0
        elif right < TINY:
            right = 0.0
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


@njit(cache=True, **UNCOUNTED)
def _interpolated(values, index, weight, count):
    total = 0.0
    for c in range(count):
        total += weight[c] * values[index[c]]
    return total


@njit(cache=True, **UNCOUNTED)
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


@njit(cache=True, **UNCOUNTED)
def _spans(state, low, high, boxes, grid, spans):
    """Spans of every interval around a state, and on each axis their union; `spans` is written, see `decide`."""
    number, order, _, _, _ = boxes
    lower, spacing, shape, periodic = grid
    first, counts, near, far, begin, width, _, _ = spans
    for a in range(order.size):
        axis = order[a]
        end = 0
        for g in range(number[a]):
            first[a, g], counts[a, g], near[a, g], far[a, g] = _span(
                state[axis] + low[g, axis],
                state[axis] + high[g, axis],
                lower[axis],
                spacing[axis],
                shape[axis],
                periodic[axis],
            )
            begin[a] = first[a, g] if g == 0 else min(begin[a], first[a, g])
            end = max(end, first[a, g] + counts[a, g]) if g > 0 else first[a, g] + counts[a, g]
        width[a] = end - begin[a]


@njit(cache=True, **UNCOUNTED)
def _gather(values, order, begin, width, shape, offsets, block):
    """Copy flat `values` at the union of the spans to the front of `block`, the axis order[0] slowest."""
    offsets[0] = 0
    size = 1
    for a in range(order.size - 1, -1, -1):
        axis = order[a]
        nodes = shape[axis]
        stride = 1
        for later in range(axis + 1, shape.size):
            stride *= shape[later]
        start = begin[a] % nodes
        for i in range(width[a] - 1, -1, -1):  # the first copy last: all others read it
            node = start + i
            while node >= nodes:
                node -= nodes
            copy = offsets[i * size : (i + 1) * size]
            for c in range(size):
                copy[c] = offsets[c] + node * stride
        size *= width[a]
    for c in range(size):
        block[c] = values[offsets[c]]


@njit(cache=True, **UNCOUNTED)
def _reduce(block, source, target, nodes, rest, near, far):
    """Maximum over an interval along the leading axis of block[source:] (nodes, rest), to block[target:] (rest,).

    near and far: weight of the second node at the interval's low end, of the last node at its high end. Views, because
    loops over them vectorise.
    """
    last = source + (nodes - 1) * rest
    first = block[source : source + rest]
    second = block[source + rest : source + 2 * rest]
    before_last = block[last - rest : last]
    final = block[last : last + rest]
    out = block[target : target + rest]
    for i in range(rest):
        low = (1.0 - near) * first[i] + near * second[i]
        high = (1.0 - far) * before_last[i] + far * final[i]
        out[i] = max(low, high)
    for node in range(1, nodes - 1):
        within = block[source + node * rest : source + (node + 1) * rest]
        for i in range(rest):
            out[i] = max(out[i], within[i])


@njit(cache=True, inline="always", **UNCOUNTED)
def _largest(block, source, nodes, near, far):
    """`_reduce` along the last axis, where one value stands behind each node; without a branch up to four nodes."""
    last = source + nodes - 1
    second = block[source + 1]
    before_last = block[last - 1]
    low = (1.0 - near) * block[source] + near * second
    high = (1.0 - far) * before_last + far * block[last]
    ends = max(low, high)
    within = max(second, before_last)
    value = max(ends, within) if nodes > 2 else ends
    for node in range(source + 2, last - 1):
        value = max(value, block[node])
    return value


@njit(cache=True, **UNCOUNTED)
def _worst_values(values, boxes, shape, spans, offsets, block, out):
    """out[j] = maximum of the interpolated `values` over the box of input j, whose spans are given.

    The maximum is taken axis by axis as in `sdhj.hopf_lax`, so it errs to the safe side. Inputs come in an order in
    which neighbours agree on the leading axes, and share the work there.
    """
    _, order, kinds, sequence, agree = boxes
    first, counts, near, far, begin, width, rest, source = spans
    final = order.size - 1
    _gather(values, order, begin, width, shape, offsets, block)
    rest[final] = 1
    for a in range(final, 0, -1):
        rest[a - 1] = rest[a] * width[a]
    source[0] = 0  # where in `block` the values lie that axis order[a] is reduced from
    for a in range(final):
        source[a + 1] = source[a] + rest[a] * width[a]
    for place in range(sequence.size):
        for a in range(agree[place], final):
            g = kinds[place, a]
            start = source[a] + (first[a, g] - begin[a]) * rest[a]
            _reduce(block, start, source[a + 1], counts[a, g], rest[a], near[a, g], far[a, g])
        g = kinds[place, final]
        start = source[final] + first[final, g] - begin[final]
        out[sequence[place]] = _largest(block, start, counts[final, g], near[final, g], far[final, g])


@njit(cache=True, **UNCOUNTED)
def _marked(mask, index, count, marked):
    """marked[j] = whether every node around a state marks u_j; `mask` (bytes, size) as in the look-up table."""
    for byte in range(mask.shape[0]):
        bits = np.uint8(255)
        for c in range(count):
            bits &= mask[byte, index[c]]
        for j in range(8 * byte, min(8 * byte + 8, marked.size)):
            marked[j] = (bits >> np.uint8(j - 8 * byte)) & 1


@njit(cache=True, **UNCOUNTED)
def _avoid_value(static, moving, j, index, weight, counts):
    """The interpolated avoid tube of u_j, <= 0 where it is safe: the larger of the static and the moving one."""
    still = _interpolated(static[j], index[0], weight[0], counts[0])
    return max(still, _interpolated(moving[j], index[1], weight[1], counts[1]))


@njit(cache=True, **UNCOUNTED)
def _take_marked(margin, marked, safe):
    """safe[j] where every node marks u_j, whose interpolated avoid tube is then <= 0 too; whether any input is safe."""
    found = False
    for j in range(margin.size):
        safe[j] = marked[j] and margin[j] <= 0.0
        found = found or safe[j]
    return found


@njit(cache=True, **UNCOUNTED)
def _judge(margin, marked, static, moving, index, weight, counts, safe):
    """safe[j] from the worst values in `margin` where no marked input is; see the docstring of `sdhj.controller`."""
    found = False
    for j in range(margin.size):
        safe[j] = margin[j] <= 0.0 and _avoid_value(static, moving, j, index, weight, counts) <= 0.0
        found = found or safe[j]
    if found:
        return
    best = -1
    for j in range(margin.size):
        margin[j] = max(margin[j], _avoid_value(static, moving, j, index, weight, counts))
        if best < 0 or (marked[j] and not marked[best]) or (marked[j] == marked[best] and margin[j] < margin[best]):
            best = j
    safe[best] = True


@njit(cache=True, nogil=True, **UNCOUNTED)
def decide(states, rows, step, table, reach, grid, scratch, out):
    """Steps to go, the safe inputs and their margins, for some of the states (M, ndim) at one step (Algorithm 2).

    Parameters
    ----------
    rows : (R,) int64
        Which states, in the order in which they are looked up: neighbours share what the cache holds.
    table : (steps, tubes (entries, size), masks (entries, bytes, size), static, static_axes, moving, moving_axes)
        Of the look-up table; static (L, size of its subgrid), moving (steps, L, size of its subgrid).
    reach : (low, high (1 or R, G, ndim), boxes)
        Intervals on each axis, relative to the state, and which of them make up the box of states that each input can
        lead to: boxes = (number (ndim,), order (ndim,), kinds (L, ndim), sequence (L,), agree (L,)). Axis order[a] has
        number[a] different intervals. Inputs come in the order of `sequence`; there, input sequence[i] takes the
        interval at kinds[i, a], the same one as the input before it on the first agree[i] of the axes.
    scratch : (index, weight, everything, avoid_index, avoid_weight, spans, offsets, block, marked)
        Room to work in, from `sdhj.controller`.
    out : (to_go (M,), safe (M, L), margin (M, L))
        To be written. to_go is -1 where no tube holds the state; safe is False and margin inf there and at the last
        step.
    """
    steps, tubes, masks, static, static_axes, moving, moving_axes = table
    low, high, boxes = reach
    index, weight, everything, avoid_index, avoid_weight, spans, offsets, block, marked = scratch
    to_go, safe, margin = out
    here = step * (steps + 1) - step * (step - 1) // 2  # the place of (step, 0), see `sdhj.table.entry`
    following = here + steps - step + 1  # the place of (step + 1, 0)
    for r in range(rows.size):
        m = rows[r]
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
        _marked(masks[here + n], index, count, marked)
        own = r if low.shape[0] > 1 else 0
        _spans(state, low[own], high[own], boxes, grid, spans)
        _worst_values(tubes[following + n - 1], boxes, grid[2], spans, offsets, block, margin[m])
        if not _take_marked(margin[m], marked, safe[m]):
            counts = (
                _corners(state, static_axes, grid, avoid_index[0], avoid_weight[0]),
                _corners(state, moving_axes, grid, avoid_index[1], avoid_weight[1]),
            )
            _judge(margin[m], marked, static, moving[step], avoid_index, avoid_weight, counts, safe[m])


@njit(cache=True, nogil=True, **UNCOUNTED)
def take_best(safe, scores, margins, chosen):
    """chosen[m] = the safe input of least score, of equals the one of least margin; kept where no input is safe.

    safe, margins (M, L), scores (one for each safe pair, in their order), chosen (M,). False where a score is NaN.
    """
    place = 0
    for m in range(safe.shape[0]):
        least = np.inf
        for j in range(safe.shape[1]):
            if not safe[m, j]:
                continue
            score, best = scores[place], chosen[m]
            if np.isnan(score):
                return False
            if best < 0 or score < least or (score == least and margins[m, j] < margins[m, best]):
                chosen[m], least = j, score
            place += 1
    return True


@njit(cache=True, nogil=True, **UNCOUNTED)
def tube_values(points, places, tubes, grid, scratch, out):
    """out[m, v] = the interpolated tube tubes[places[m]] at points[m, v]; beyond a wall, its value at the wall.

    points (M, V, ndim), places (M,), tubes (entries, size), out (M, V). Coordinates must be finite.
    """
    index, weight, everything = scratch
    for m in range(points.shape[0]):
        for v in range(points.shape[1]):
            count = _corners(points[m, v], everything, grid, index, weight)
            out[m, v] = _interpolated(tubes[places[m]], index, weight, count)
