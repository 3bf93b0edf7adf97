"""Compiled look-ups behind the controller: how many steps to go, which inputs are safe, and by how much.

Serial and without Python's lock (`nogil`): a query may run in a thread beside a solve, and a batch is shared out over
threads.

A *span* is the stretch of consecutive nodes on one axis that an interval of coordinates touches; a *block* holds the
values at a product of spans.
"""

from typing import Any, NamedTuple

import numpy as np
from numba.core.options import DefaultOptions

from sdhj.kernels.compiling import kernel
from sdhj.kernels.interpolation import Lattice, corners, locate, on_grid, weighted

TINY = 1e-9  # a weight below it is rounding: the state is on the other node
# Numba would count the references to every array: a view made or dropped is an atomic step on a count that all threads
# share, and many loops here are shorter. Without the counts the compiler also refuses whatever would allocate.
# The option is not among Numba's documented ones: a version without it counts, and takes twice as long.
UNCOUNTED: Any = {"_nrt": False} if hasattr(DefaultOptions, "_nrt") else {}


class Shelf(NamedTuple):
    """A look-up table as compiled code reads it, every function on a grid flat.

    steps; index (entries,), the place of each (start, within) in tubes (T, size) and masks (T, bytes, size); static (L,
    size of the subgrid of static_axes) and moving (steps * L, size of the subgrid of moving_axes), the avoid tubes.
    """

    steps: int
    index: Any
    tubes: Any
    masks: Any
    static: Any
    static_axes: Any
    moving: Any
    moving_axes: Any


class Reach(NamedTuple):
    """Boxes of states that each input can lead to, relative to the state: low, high (1 or R, L, ndim).

    lowest, highest (1 or R, ndim) is the box that holds them all; it touches `size` nodes at most. Maxima are taken
    along the axis order[0] first: where an input's intervals on the leading axes are those of the input before, that is
    done already.
    """

    low: Any
    high: Any
    lowest: Any
    highest: Any
    order: Any
    size: int


class Room(NamedTuple):
    """Room to work in.

    axes (ndim,): all of them; index, weight (2, 2^ndim): nodes around a state; marks (L,): whether they all mark an
    input. Of a block: the first node on each axis in `order`, begin (ndim,); how many nodes that axis and those behind
    it have, rest (ndim + 1,); where they are on the grid, offsets (size,). What is left when the maxima along the axes
    before it are taken begins at values[rest[a]], behind all that is left later: values (2 size,).
    """

    axes: Any
    index: Any
    weight: Any
    marks: Any
    begin: Any
    rest: Any
    offsets: Any
    values: Any


@kernel(**UNCOUNTED)
def _fewest_steps(shelf, first, most, index, weight, count):
    """Fewest n in 0..most whose interpolated tube, entry first + n, is <= 0, or -1. Tubes grow with n: bisection."""
    if not (weighted(shelf.tubes, shelf.index[first + most], index, weight, count) <= 0.0):
        return -1
    low, high = 0, most
    while low < high:
        middle = (low + high) // 2
        if weighted(shelf.tubes, shelf.index[first + middle], index, weight, count) <= 0.0:
            high = middle
        else:
            low = middle + 1
    return low


@kernel(**UNCOUNTED)
def _mark(masks, place, index, count, marks):
    """marks[j] = whether every node around a state marks u_j."""
    for byte in range(masks.shape[1]):
        bits = np.uint8(255)
        for c in range(count):
            bits &= masks[place, byte, index[c]]
        for j in range(8 * byte, min(8 * byte + 8, marks.size)):
            marks[j] = (bits >> np.uint8(j - 8 * byte)) & 1


@kernel(**UNCOUNTED)
def _gather(values, state, reach, own, lattice, room):
    """Copy flat `values` at the nodes that any box touches to room.values[rest[0]:], the axis order[0] slowest."""
    offsets, rest = room.offsets, room.rest
    offsets[0], rest[state.size] = 0, 1
    for a in range(state.size - 1, -1, -1):
        axis = reach.order[a]
        nodes, stride, size = lattice.shape[axis], 1, rest[a + 1]
        for later in range(axis + 1, state.size):
            stride *= lattice.extent[later]
        begin, _ = locate(state[axis] + reach.lowest[own, axis], axis, lattice)
        end, _ = locate(state[axis] + reach.highest[own, axis], axis, lattice)
        for i in range(end + 1 - begin, -1, -1):  # the first copy last: all others read it
            node = (begin + i - lattice.first[axis]) % nodes
            for c in range(size):
                offsets[i * size + c] = offsets[c] + node * stride
        room.begin[a], rest[a] = begin, (end + 2 - begin) * size
    for c in range(rest[0]):
        room.values[rest[0] + c] = values[offsets[c]]


@kernel(**UNCOUNTED)
def _reduce(values, source, nodes, rest, near, far):
    """Maximum over an interval along the leading axis of values[source:] (nodes, rest), to values[rest:] (rest,).

    near and far: weight of the second node at the interval's low end, of the last node at its high end. Views, because
    loops over them vectorise.
    """
    last = source + (nodes - 1) * rest
    first, second = values[source : source + rest], values[source + rest : source + 2 * rest]
    before_last, final = values[last - rest : last], values[last : last + rest]
    out = values[rest : 2 * rest]
    for i in range(rest):
        low = (1.0 - near) * first[i] + near * second[i]
        high = (1.0 - far) * before_last[i] + far * final[i]
        out[i] = max(low, high)
    for node in range(1, nodes - 1):
        within = values[source + node * rest : source + (node + 1) * rest]
        for i in range(rest):
            out[i] = max(out[i], within[i])


@kernel(**UNCOUNTED)
def _worst_values(values, state, reach, own, lattice, room, out):
    """out[j] = maximum of the interpolated `values` over the box of input j around a state.

    The maximum is taken axis by axis as in `sdhj.solver.hopf_lax`, so it errs to the safe side. A box that goes past an
    unsafe end has +inf, one that is past a safe end with all it has -inf.
    """
    _gather(values, state, reach, own, lattice, room)
    low, high, order, rest = reach.low[own], reach.high[own], reach.order, room.rest
    for j in range(out.size):
        same, lost, left = j > 0, False, False  # as for the input before
        for a in range(order.size):
            axis = order[a]
            same = same and low[j, axis] == low[j - 1, axis] and high[j, axis] == high[j - 1, axis]
            lost = lost or state[axis] + low[j, axis] < lattice.least[axis]
            lost = lost or state[axis] + high[j, axis] > lattice.most[axis]
            left = left or state[axis] + high[j, axis] < lattice.left[0, axis]
            left = left or state[axis] + low[j, axis] > lattice.left[1, axis]
            if not same:
                first, near = locate(state[axis] + low[j, axis], axis, lattice)
                last, far = locate(state[axis] + high[j, axis], axis, lattice)
                source = rest[a] + (first - room.begin[a]) * rest[a + 1]
                _reduce(room.values, source, last - first + 2, rest[a + 1], near, far)
        out[j] = np.inf if lost else -np.inf if left else room.values[1]


@kernel(**UNCOUNTED)
def _hazard(shelf, step, j, room, still, moving):
    """The interpolated avoid tube of u_j, <= 0 where it is safe: the larger of the static and the moving one."""
    value = weighted(shelf.static, j, room.index[0], room.weight[0], still)
    place = step * room.marks.size + j
    return max(value, weighted(shelf.moving, place, room.index[1], room.weight[1], moving))


@kernel(**UNCOUNTED)
def _judge(shelf, step, state, lattice, room, margin, safe):
    """safe[j] from marks and margins, and the best input; see the docstring of `sdhj.table.table`."""
    best = -1
    for j in range(safe.size):  # the interpolated avoid tube of a marked input is <= 0 too
        safe[j] = room.marks[j] and margin[j] <= 0.0
        if safe[j] and (best < 0 or margin[j] < margin[best]):
            best = j
    if best >= 0:
        return best
    still = corners(state, shelf.static_axes, lattice, TINY, room.index[0], room.weight[0])
    moving = corners(state, shelf.moving_axes, lattice, TINY, room.index[1], room.weight[1])
    for j in range(safe.size):
        safe[j] = margin[j] <= 0.0 and _hazard(shelf, step, j, room, still, moving) <= 0.0
        if safe[j] and (best < 0 or margin[j] < margin[best]):
            best = j
    if best >= 0:
        return best
    best, least = 0, np.inf
    for j in range(safe.size):
        worse = max(margin[j], _hazard(shelf, step, j, room, still, moving))
        if room.marks[j] > room.marks[best] or (room.marks[j] == room.marks[best] and worse < least):
            best, least = j, worse
    return best


@kernel(**UNCOUNTED)
def _decide(states, rows, when, shelf, reach, lattice, room, out):
    """`decide` with room to work in."""
    to_go, safe, margins, best = out
    step, within = when
    steps, index, weight = shelf.steps, room.index[0], room.weight[0]
    here = step * (steps + 1) - step * (step - 1) // 2  # the place of (step, 0), see `sdhj.table.table.entry`
    following = here + steps - step + 1  # the place of (step + 1, 0)
    for r in range(rows.size):
        m = rows[r]
        state = states[m]
        to_go[m], safe[m], margins[m], best[m] = -1, False, np.inf, -1
        if not on_grid(state, lattice):
            continue
        count = corners(state, room.axes, lattice, TINY, index, weight)
        to_go[m] = _fewest_steps(shelf, here, steps - step, index, weight, count)
        if to_go[m] < 0 or step == steps:
            continue
        n = max(to_go[m], within)  # in the target already: inputs that bring the state back into it
        _mark(shelf.masks, shelf.index[here + n], index, count, room.marks)
        own = r if reach.low.shape[0] > 1 else 0
        _worst_values(shelf.tubes[shelf.index[following + n - 1]], state, reach, own, lattice, room, margins[m])
        best[m] = _judge(shelf, step, state, lattice, room, margins[m], safe[m])


@kernel(nogil=True)
def decide(states, rows, when, shelf, reach, lattice, out):
    """Steps to go, the safe inputs and their margins, for some of the states (M, ndim) at one step (Algorithm 2).

    Parameters
    ----------
    rows : (R,) int64
        Which states, in the order in which they are looked up: neighbours share what the cache holds.
    when : (step, within)
        Inputs are judged by the tube of the fewest steps to go, but of `within`, at least 1, where that is more.
    shelf, reach, lattice : tuples
        The fields of a `Shelf`, a `Reach` and a `Lattice`: plain tuples get into compiled code 3 us sooner.
    out : (to_go (M,), safe (M, L), margins (M, L), best (M,))
        To be written. to_go is -1 where no tube holds the state; safe is False, margins inf and best -1 there and at
        the last step.
    """
    reach, lattice = Reach(*reach), Lattice(*lattice)
    ndim, around = states.shape[1], (2, 1 << states.shape[1])
    marks, spans = np.empty(reach.low.shape[1], np.bool_), np.empty((2, ndim + 1), np.int64)
    block = np.empty(reach.size, np.int64), np.empty(2 * reach.size)
    room = Room(np.arange(ndim), np.empty(around, np.int64), np.empty(around), marks, spans[0], spans[1], *block)
    _decide(states, rows, when, Shelf(*shelf), reach, lattice, room, out)


@kernel(nogil=True)
def avoid_values(states, step, shelf, lattice, out):
    """out[m, j] = the interpolated avoid tube of u_j at states[m] over the interval from a step, at a wall beyond it.

    states (M, ndim), shelf and lattice as for `decide`, out (M, L). Coordinates must be finite.
    """
    shelf, lattice, around, none = Shelf(*shelf), Lattice(*lattice), (2, 1 << states.shape[1]), np.empty(0, np.int64)
    index, weight, marks = np.empty(around, np.int64), np.empty(around), np.empty(out.shape[1], np.bool_)
    room = Room(none, index, weight, marks, none, none, none, np.empty(0))
    for m in range(out.shape[0]):
        still = corners(states[m], shelf.static_axes, lattice, TINY, index[0], weight[0])
        moving = corners(states[m], shelf.moving_axes, lattice, TINY, index[1], weight[1])
        for j in range(out.shape[1]):
            out[m, j] = _hazard(shelf, step, j, room, still, moving)


@kernel(nogil=True)
def tube_values(points, places, tubes, lattice, out):
    """out[m, v] = the interpolated tubes[places[m]] at points[m, v]; beyond a wall, its value at the wall.

    points (M, V, ndim), places (M,), tubes (T, size), out (M, V). Coordinates must be finite.
    """
    ndim = points.shape[2]
    axes, index, weight = np.arange(ndim), np.empty(1 << ndim, np.int64), np.empty(1 << ndim)
    for m in range(points.shape[0]):
        for v in range(points.shape[1]):
            count = corners(points[m, v], axes, lattice, TINY, index, weight)
            out[m, v] = weighted(tubes, places[m], index, weight, count)
