"""Compiled look-ups behind the controller: how many steps to go, which inputs are safe, and by how much.

Serial and without Python's lock (`nogil`): a query may run in a thread beside a solve, and a batch is shared out over
threads.

The look at the true sets (`notebooks/site/queries.md`) goes in rounds: `propose` writes the points at which they are
evaluated for the input that comes next, and `judge` undoes what their values refute. Where the sets are formulas,
`decide` plays these and does all rounds in one call; what is a black box, Python evaluates between them.

A *span* is the stretch of consecutive nodes on one axis that an interval of coordinates touches; a *block* holds the
values at a product of spans.
"""

from typing import Any, NamedTuple

import numpy as np

from sdhj.kernels.compiling import UNCOUNTED, kernel
from sdhj.kernels.interpolation import Lattice, among, corners, locate, on_grid, turned, weighted
from sdhj.kernels.tape import BLOCK, RESULTS, TABLES, part, play_part

TINY = 1e-9  # a weight below it is rounding: the state is on the other node
LOOKED = 4  # instants of an interval at which the path without an adversary is looked at, its end among them
UNKNOWN, PASSES, FAILS = range(3)  # an input, by the true sets
TUBES, LOOK, ONLY_LOOK = range(3)  # what `decide` does: by the tubes, by the true sets too, or by those alone

# What is `packed` of a problem at one step: a `Lattice`; the axes of the avoid tubes; the order of axes in which maxima
# are taken; the times of the V points that are looked at, the path first, then the state and the corners; (4, ndim):
# between what coordinates are clipped, and the ends of the grid; when the interval begins; and three tapes: what inputs
# lead to, the unsafe sets and the target, the two of points with the time as one more coordinate.
_STATIC, _MOVING, _ORDER, LOOK_TIMES, _FACES, _BEGIN, _AHEAD = range(len(Lattice._fields), len(Lattice._fields) + 7)
_UNSAFE = _AHEAD + TABLES + 1
_TARGET = _UNSAFE + TABLES + 1


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


class Room(NamedTuple):
    """Room to work in.

    hull (2, ndim): the box that holds those of all inputs. axes (ndim,): all of them; index, weight (2, 2^ndim):
    nodes around a state; marks (L,): whether they all mark an input. Of a block: the first node on each axis in
    `order`, begin (ndim,); how many nodes that axis and those behind it have, rest (ndim + 1,); where they are on the
    grid, offsets (size,). What is left when the maxima along the axes before it are taken begins at values[rest[a]],
    behind all that is left later: values (2 size,).
    """

    hull: Any
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
def _gather(values, state, order, lattice, room):
    """Copy flat `values` at the nodes that any box touches to room.values[rest[0]:], the axis order[0] slowest."""
    offsets, rest = room.offsets, room.rest
    offsets[0], rest[state.size] = 0, 1
    for a in range(state.size - 1, -1, -1):
        axis = order[a]
        nodes, stride, size = lattice.shape[axis], 1, rest[a + 1]
        for later in range(axis + 1, state.size):
            stride *= lattice.extent[later]
        begin, _ = locate(state[axis] + room.hull[0, axis], axis, lattice)
        end, _ = locate(state[axis] + room.hull[1, axis], axis, lattice)
        room.begin[a], rest[a] = begin, (end + 2 - begin) * size
        for i in range(end + 1 - begin, -1, -1):  # the first copy last: all others read it
            shift = among(begin + i - lattice.first[axis], nodes) * stride
            for c in range(size if a > 0 else 0):
                offsets[i * size + c] = offsets[c] + shift
            for c in range(size if a == 0 else 0):
                room.values[rest[0] + i * size + c] = values[offsets[c] + shift]


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
def _worst_values(values, state, ends, column, order, lattice, room, out):
    """out[j] = maximum of the interpolated `values` over the box of input j around a state.

    The maximum is taken axis by axis as in `sdhj.solver.hopf_lax`, so it errs to the safe side. A box that goes past an
    unsafe end has +inf, one that is past a safe end with all it has -inf.
    """
    _gather(values, state, order, lattice, room)
    low, high, rest = ends[0, :, :, column], ends[1, :, :, column], room.rest
    for j in range(out.size):
        same, lost, left = j > 0, False, False  # as for the input before
        for a in range(order.size):
            axis = order[a]
            same = same and low[j, axis] == low[j - 1, axis] and high[j, axis] == high[j - 1, axis]
            lost = lost or state[axis] + low[j, axis] < lattice.least[axis]
            lost = lost or state[axis] + high[j, axis] > lattice.most[axis]
            left = left or state[axis] + high[j, axis] < lattice.left[axis]
            left = left or state[axis] + low[j, axis] > lattice.left[order.size + axis]
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
def _of_tubes(shelf, step, state, lattice, room, margin, safe):
    """safe[j] from marks and margins, and the best input; see `notebooks/site/queries.md`."""
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
def _by_tubes(m, column, states, when, shelf, ends, space, out):
    """The answers for one state, but for the look at the true sets."""
    (order, lattice, room), (to_go, safe, margins, best), (step, within) = space, out, when
    state, steps, index, weight = states[m], shelf.steps, room.index[0], room.weight[0]
    here = step * (steps + 1) - step * (step - 1) // 2  # the place of (step, 0), see `sdhj.table.table.entry`
    following = here + steps - step + 1  # the place of (step + 1, 0)
    to_go[m], safe[m], margins[m], best[m] = -1, False, np.inf, -1
    if not on_grid(state, lattice):
        return
    count = corners(state, room.axes, lattice, TINY, index, weight)
    to_go[m] = _fewest_steps(shelf, here, steps - step, index, weight, count)
    if to_go[m] < 0 or step == steps:
        return
    n = max(to_go[m], within)  # in the target already: inputs that bring the state back into it
    _mark(shelf.masks, shelf.index[here + n], index, count, room.marks)
    tube = shelf.tubes[shelf.index[following + n - 1]]
    _worst_values(tube, state, ends, column, order, lattice, room, margins[m])
    best[m] = _of_tubes(shelf, step, state, lattice, room, margins[m], safe[m])


@kernel(**UNCOUNTED)
def _hull(ends, column, spacing, hull):
    """Write the box that holds those of all inputs; returns how many nodes it can touch, and one more on each axis."""
    size = 1.0
    for axis in range(ends.shape[2]):
        hull[0, axis], hull[1, axis] = ends[0, 0, axis, column], ends[1, 0, axis, column]
        for j in range(1, ends.shape[1]):
            hull[0, axis] = min(hull[0, axis], ends[0, j, axis, column])
            hull[1, axis] = max(hull[1, axis], ends[1, j, axis, column])
        size *= np.ceil((hull[1, axis] - hull[0, axis]) / spacing[axis] + 1e-6) + 2.0
    return int(size)


@kernel(**UNCOUNTED)
def _hazards(shelf, step, state, lattice, room, out):
    """out[j] = the interpolated avoid tube of u_j at a state."""
    still = corners(state, shelf.static_axes, lattice, TINY, room.index[0], room.weight[0])
    moving = corners(state, shelf.moving_axes, lattice, TINY, room.index[1], room.weight[1])
    for j in range(out.size):
        out[j] = _hazard(shelf, step, j, room, still, moving)


@kernel(inline="always")  # as its caller counts references, or does not
def _lattice(ints, floats):
    """The lattice that is first among packed arrays."""
    lower, spacing, shape = part(ints, floats, 0), part(ints, floats, 1), part(ints, ints, 2)
    periodic, least, most = part(ints, ints, 3), part(ints, floats, 4), part(ints, floats, 5)
    left, first, extent = part(ints, floats, 6), part(ints, ints, 7), part(ints, ints, 8)
    return Lattice(lower, spacing, shape, periodic, least, most, left, first, extent)


@kernel(**UNCOUNTED)
def _place(at, state, j, box, lattice, look, spots):
    """Write the points, from `at` on, at which the true sets are looked at for u_j, and which of them are past ends."""
    (ends, column), (times, faces), (points, past) = box, look, spots
    ndim, last, gone = state.size, LOOKED if times.size > 1 else 0, False
    for i in range(times.size):  # the state, the path, the corners
        spot, share, out, lost = at + (last if i == 0 else i - 1 if i <= last else i), i / LOOKED, False, False
        for axis in range(ndim):
            x = state[axis]
            if i > last:
                x += ends[((i - last - 1) >> (ndim - 1 - axis)) & 1, j, axis, column]
            elif i > 0:
                x += share * ends[2, j, axis, column]
                x += share * share * ends[3, j, axis, column]
                lost |= (x < lattice.least[axis]) | (x > lattice.most[axis])
            out |= (x < lattice.left[axis]) | (x > lattice.left[ndim + axis])
            x = min(max(x, faces[axis]), faces[ndim + axis])
            if lattice.periodic[axis]:
                x = turned(x, faces[2 * ndim + axis], faces[3 * ndim + axis])
            points[spot, axis] = x
        gone |= out & (i <= last)
        past[spot] = 1 if out | (gone & (i <= last)) else -1 if lost else 0
        points[spot, ndim] = times[spot - at]


@kernel(**UNCOUNTED)
def _next(known, safe, scores, margin, hazard, first):
    """The input to look at next; if it has passed already, or has failed, it is the answer.

    Of the safe ones that of least score, of equals that of least margin; where none is safe, `first`, the best by the
    tubes; where that fails, the one for which the larger of margin and hazard is least; where none passes, `first`.
    """
    best, least = -1, np.inf
    for j in range(safe.size):
        if safe[j] and known[j] != FAILS:
            better = best < 0 or scores[j] < scores[best]
            if better or (scores[j] == scores[best] and margin[j] < margin[best]):
                best = j
    if best >= 0 or known[first] != FAILS:
        return best if best >= 0 else first
    for j in range(safe.size):
        worse = max(margin[j], hazard[j])
        if known[j] != FAILS and worse < least:
            best, least = j, worse
    return best if best >= 0 else first


@kernel(nogil=True, **UNCOUNTED)
def propose(waiting, within, states, rows, packs, ahead, out, spots):
    """Write the input that comes next to best[rows[r]] for each r that waits, and the points at which to look for it.

    waiting : how many wait; -1: not begun, all wait that have steps to go. Where nothing is to be looked at (there are
    no times), all inputs pass. packs, ahead : (ints, floats) and (ends, scores) of `decide`, as the other arguments but
    spots, which is what `spots_for` returns. Returns how many still wait.
    """
    (to_go, safe, margins, best), (slots, known, hazard, points, past, _, _) = out, spots
    (ints, floats), (ends, scores) = packs, ahead
    lattice, times, faces = _lattice(ints, floats), part(ints, floats, LOOK_TIMES), part(ints, floats, _FACES)
    some = 0
    if waiting < 0:
        for r in range(rows.size):
            if to_go[rows[r]] >= 0:
                slots[0, some], slots[1, r], slots[2, r] = r, best[rows[r]], max(to_go[rows[r]], within) - 1
                known[r], hazard[r] = UNKNOWN if times.size else PASSES, np.inf
                some += 1
        waiting, some = some, 0
    for k in range(waiting):
        r, m = slots[0, k], rows[slots[0, k]]
        j = _next(known[r], safe[m], scores[m], margins[m], hazard[r], slots[1, r])
        best[m], slots[1, r] = j, j if slots[1, r] < 0 else slots[1, r]
        if known[r, j] == UNKNOWN:
            box = ends, r if ends.shape[3] > 1 else 0
            _place(some * times.size, states[m], j, box, lattice, (times, faces), (points, past))
            slots[0, some] = r
            some += 1
    return some


@kernel(nogil=True, **UNCOUNTED)
def judge(waiting, rows, looks, count, out, spots):
    """Undo what the values in `spots`, at `count` points each, refute; returns how many wait for another input.

    What is in an unsafe set is not admissible, with `ONLY_LOOK` just its steps to go say so; what is in no target has
    one step to go, or none any longer. An input that fails is not safe.
    """
    (to_go, safe, margins, best), (slots, known, _, _, past, level, there) = out, spots
    last, some = LOOKED if count > 1 else 0, 0
    for k in range(waiting):
        r, m = slots[0, k], rows[slots[0, k]]
        at, j, lost, passes = k * count + last, best[m], False, True
        for v in range(k * count, (k + 1) * count):
            fine = past[v] >= 0
            for p in range(level.shape[0]):
                fine &= level[p, v] > 0.0
            if v > at and slots[2, r] == 0:
                fine &= there[0, v] <= 0.0
            fine |= past[v] > 0
            lost, passes = lost | ((v == at) & (not fine)), passes & (fine | (v == at))
        if to_go[m] == 0 and there[0, at] > 0.0:
            to_go[m], lost = 1, lost | (count == 1)
        known[r, j] = PASSES if passes else FAILS
        if lost:
            to_go[m] = -1
        if lost and looks != ONLY_LOOK:
            safe[m], margins[m], best[m] = False, np.inf, -1
        elif not passes:
            safe[m, j] = False
            slots[0, some] = r
            some += 1
    return some


@kernel(inline="always")
def _evaluate(waiting, rows, ints, floats, to_go, spots):
    """Play the unsafe sets at the points of what waits, the target where it matters; whether all values are finite.

    The type of a constant is the constant, and all that is played would be compiled for it anew: hence `np.int64`.
    """
    (slots, _, _, points, _, level, there), times = spots, part(ints, floats, LOOK_TIMES)
    count, last = times.size, LOOKED if times.size > 1 else 0
    if play_part(ints, floats, np.int64(_UNSAFE), points, times, level, np.int64(0), waiting * count) != 0.0:
        return False
    for k in range(waiting if part(ints, ints, _TARGET + RESULTS).size else 0):
        start = k * count + last + (to_go[rows[slots[0, k]]] != 0)
        stop = (k + 1) * count if slots[2, slots[0, k]] == 0 else k * count + last + 1
        if start < stop and play_part(ints, floats, np.int64(_TARGET), points, times, there, start, stop) != 0.0:
            return False
    return True


@kernel(inline="always")
def _look(rows, when, states, packs, ahead, table, out, spots):
    """The look at the true sets for some rows, by their tapes; False where they are undefined.

    table : (shelf, lattice, room)
    """
    (step, within, _, looks), (ints, floats), (shelf, lattice, room) = when, packs, table
    count = part(ints, floats, LOOK_TIMES).size
    waiting = propose(np.int64(-1), within, states, rows, packs, ahead, out, spots)
    while waiting > 0:
        if not _evaluate(waiting, rows, ints, floats, out[0], spots):
            return False
        waiting = judge(waiting, rows, looks, count, out, spots)
        for k in range(waiting if looks == LOOK else 0):
            r = spots[0][0, k]
            if not out[1][rows[r]].any():
                _hazards(shelf, step, states[rows[r]], lattice, room, spots[2][r])
        waiting = propose(waiting, within, states, rows, packs, ahead, out, spots)
    return True


@kernel()
def _room(ndim, inputs, size):
    """A `Room` for so many inputs and nodes of a block."""
    around, spans = (2, 1 << ndim), np.empty((2, ndim + 1), np.int64)
    nodes = np.arange(ndim), np.empty(around, np.int64), np.empty(around), np.empty(inputs, np.bool_)
    return Room(np.empty((2, ndim)), *nodes, spans[0], spans[1], np.empty(size, np.int64), np.empty(2 * size))


@kernel(nogil=True)
def spots_for(states, inputs, count, ndim, sets):
    """Room for the look at the true sets: for R states `count` points of each that waits, one behind the other.

    slots (3, R): the numbers of those that wait; of each state the best input by the tubes, and the steps to go after
    the interval. known, hazard (R, L): what is known of the inputs. points (R count, ndim + 1), the time last; past
    (R count,): 1 where nothing matters any longer, behind a safe end, -1 where the path is past an unsafe one; level
    (sets, R count) and there (1, R count): the values of the unsafe sets and, at state and corners, of the target.
    """
    slots, known, size = np.empty((3, states), np.int64), np.empty((states, inputs), np.int64), states * count
    points, past = np.empty((size, ndim + 1)), np.empty(size, np.int64)
    return slots, known, np.empty((states, inputs)), points, past, np.empty((sets, size)), np.zeros((1, size))


@kernel(nogil=True)
def decide(states, rows, when, packs, stored, ends, scores, out):
    """Steps to go, the safe inputs and their margins, for some of the states (M, ndim) at one step (Algorithm 2).

    Parameters
    ----------
    rows : (R,) int64
        Which states, in the order in which they are looked up: neighbours share what the cache holds.
    when : (step, within, steps, looks)
        Inputs are judged by the tube of the fewest steps to go, but of `within`, at least 1, where that is more. looks:
        `TUBES`, `LOOK` or `ONLY_LOOK`, which begins with what is in `out`.
    packs, stored : (ints, floats), (index, tubes, masks, static, moving)
        What is packed (above); of a `Shelf`.
    ends : (4, L, ndim, 1 or R)
        What each input can lead to, relative to the state: the lower and the upper corner of the box that holds all
        states at the interval's end, and two terms of the path without an adversary, which after a share s of the
        interval is s ends[2] + s^2 ends[3] away. Where there is a tape for it, it is played, and `ends` is not read.
    scores : (M, L)
        Which safe input is preferred as `best`: that of least score, of equals that of least margin.
    out : (to_go (M,), safe (M, L), margins (M, L), best (M,))
        To be written. to_go is -1 where no tube holds the state; safe is False, margins inf and best -1 there and at
        the last step.

    Returns
    -------
    bool
        Whether all formulas have values wherever they were evaluated; else the answers are worthless.
    """
    (step, within, steps, looks), (ints, floats), (index, tubes, masks, static, moving) = when, packs, stored
    axes, lattice = (part(ints, ints, _STATIC).copy(), part(ints, ints, _MOVING).copy()), _lattice(ints, floats)
    shelf = Shelf(steps, index, tubes, masks, static, axes[0], moving, axes[1])
    order, times = part(ints, ints, _ORDER), part(ints, floats, LOOK_TIMES)
    ndim, inputs, count = states.shape[1], out[1].shape[1], times.size
    played, time = part(ints, ints, _AHEAD + RESULTS).size, part(ints, floats, _BEGIN)
    width, size = max(1, min(BLOCK // max(count, 1), rows.size)), 64  # states at a time, nodes of a block
    alike, sets = played == 0 and ends.shape[3] == 1, part(ints, ints, _UNSAFE + RESULTS).size
    room, at = _room(ndim, inputs, size), np.empty((width, ndim))
    spots = spots_for(width if looks != TUBES else 0, inputs, count, ndim, sets)
    near = ends if alike else np.empty((4, inputs, ndim, width))
    for begin in range(0, rows.size, width):
        some = rows[begin : begin + width]
        if played:
            for r in range(some.size):
                for axis in range(ndim):
                    at[r, axis] = states[some[r], axis]
            lead = near.reshape(played, width)
            if play_part(ints, floats, np.int64(_AHEAD), at, time, lead, np.int64(0), some.size) != 0.0:
                return False
        elif not alike:
            for term, j, axis in np.ndindex(near.shape[:3]):
                for r in range(some.size):
                    near[term, j, axis, r] = ends[term, j, axis, begin + r]
        for r in range(some.size if looks != ONLY_LOOK else 0):
            column = 0 if alike else r
            if not alike or begin + r == 0:
                needed = _hull(near, column, lattice.spacing, room.hull)
                if needed > size:
                    size, block = 2 * needed, (np.empty(2 * needed, np.int64), np.empty(4 * needed))
                    room = Room(*room[:7], *block)  # type: ignore[call-arg]
            _by_tubes(some[r], column, states, (step, within), shelf, near, (order, lattice, room), out)
        table, ahead = (shelf, lattice, room), (near, scores)
        if looks != TUBES and not _look(some, when, states, packs, ahead, table, out, spots):
            return False
    return True


@kernel(nogil=True)
def avoid_values(states, step, ints, floats, static, moving, out):
    """out[m, j] = the interpolated avoid tube of u_j at states[m] over the interval from a step, at a wall beyond it.

    states (M, ndim), what is packed and stored as for `decide`, out (M, L). Coordinates must be finite.
    """
    axes, lattice = (part(ints, ints, _STATIC).copy(), part(ints, ints, _MOVING).copy()), _lattice(ints, floats)
    nothing = axes[0], static, static  # in place of index, tubes and masks, which nobody reads here
    shelf = Shelf(0, *nothing, static, axes[0], moving, axes[1])
    room = _room(states.shape[1], out.shape[1], 0)
    for m in range(out.shape[0]):
        _hazards(shelf, step, states[m], lattice, room, out[m])


@kernel(**UNCOUNTED)
def _interpolated(where, row, tubes, lattice, room, found):
    """found[m] = the interpolated tubes[row[m]] at where[m], as by `corners` and `weighted`: loops that vectorise."""
    (sides, index), (share, weight) = room
    here, there, count = sides[0], sides[1], found.size
    index[0, :count], weight[0, :count], found[:] = 0, 1.0, 0.0
    for axis in range(where.shape[1]):
        for m in range(count):
            left, right = locate(where[m, axis], axis, lattice)
            left += right >= 1.0 - TINY
            share[0, m] = right if TINY <= right < 1.0 - TINY else 0.0
            here[m] = among(left - lattice.first[axis], lattice.shape[axis])
            there[m] = among(left + 1 - lattice.first[axis], lattice.shape[axis])
        for c in range(1 << axis):
            other = c + (1 << axis)
            for m in range(count):
                start, whole = index[c, m] * lattice.extent[axis], weight[c, m]
                index[c, m], index[other, m] = start + here[m], start + there[m]
                weight[c, m], weight[other, m] = whole * (1.0 - share[0, m]), whole * share[0, m]
    for c in range(1 << where.shape[1]):
        for m in range(count):
            found[m] += weight[c, m] * tubes[row[m], index[c, m]] if weight[c, m] > 0.0 else 0.0


@kernel(nogil=True)
def tube_values(points, places, tubes, ints, floats, out):
    """out[m, v] = the interpolated tubes[places[m]] at points[m, v]; beyond a wall, its value at the wall.

    points (M, V, ndim), places (M,), tubes (T, size), a lattice packed, out (M, V). Coordinates must be finite.
    """
    (_, each, ndim), lattice = points.shape, _lattice(ints, floats)
    where, found, row = points.reshape(-1, ndim), out.reshape(-1), np.empty(BLOCK, np.int64)
    whole, shares = np.empty((2 + (1 << ndim), BLOCK), np.int64), np.empty((1 + (1 << ndim), BLOCK))
    room = (whole[:2], whole[2:]), (shares[:1], shares[1:])
    for at in range(0, found.size, BLOCK):
        end = min(at + BLOCK, found.size)
        for m in range(end - at):
            row[m] = places[(at + m) // each]
        _interpolated(where[at:end], row, tubes, lattice, room, found[at:end])
