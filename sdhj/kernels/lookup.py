"""Compiled look-ups behind the controller: how many steps to go, which inputs are safe, and by how much.

Serial and without Python's lock (`nogil`): a query may run in a thread beside a solve, and a batch is shared out over
threads.

The look at the true sets (`notebooks/site/queries.md`) plays their formulas' tapes at some points of what an input
leads to.

A *span* is the stretch of consecutive nodes on one axis that an interval of coordinates touches; a *block* holds the
values at a product of spans.
"""

from typing import Any, NamedTuple

import numpy as np

from sdhj.kernels.compiling import UNCOUNTED, kernel
from sdhj.kernels.interpolation import Lattice, among, corners, locate, on_grid, turned, weighted
from sdhj.kernels.tape import BLOCK, Tape, play_part

TINY = 1e-9  # a weight below it is rounding: the state is on the other node
FAILS, PASSES, UNKNOWN = range(3)  # an input, by the true sets
LOST, UNDEFINED = 4, 8  # to be added where the state itself is unsafe; a formula has no value
TUBES, LOOKED, ONLY_LOOK = range(3)  # what `decide` does: by the tubes, by the true sets too, or by those alone


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


class Ahead(NamedTuple):
    """What each input can lead to from one step, relative to the state.

    ends (4, L, ndim, 1 or R): the lower and the upper corner of the box that holds all states at the interval's end,
    and two terms of the path without an adversary: after a share s of the interval it is s ends[2] + s^2 ends[3] away.
    Or else `tape` gives them for a state, with `begin` (1,), the time. Maxima are taken along the axis order[0] first:
    where an input's intervals on the leading axes are those of the input before, that is done already.
    """

    ends: Any
    order: Any
    tape: Any
    begin: Any


class Look(NamedTuple):
    """The true sets at one step: tapes of points with the time as one more coordinate; `times`, at which the path is
    looked at, the state and the interval's end among them; faces (4, ndim), where coordinates are clipped, and the ends
    of the grid.
    """

    times: Any
    faces: Any
    unsafe: Any
    target: Any


class Room(NamedTuple):
    """Room to work in.

    hull (2, ndim): the box that holds those of all inputs. axes (ndim,): all of them; index, weight (2, 2^ndim):
    nodes around a state; marks (L,): whether they all mark an input. Of a block: the first node on each axis in
    `order`, begin (ndim,); how many nodes that axis and those behind it have, rest (ndim + 1,); where they are on the
    grid, offsets (size,). What is left when the maxima along the axes before it are taken begins at values[rest[a]],
    behind all that is left later: values (2 size,). For the look: points (V, ndim + 1), the time last, past (V,) and
    level (sets, V); known, hazard (L,) of the inputs.
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
    points: Any
    past: Any
    level: Any
    known: Any
    hazard: Any


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
        for i in range(end + 1 - begin, -1, -1):  # the first copy last: all others read it
            node = among(begin + i - lattice.first[axis], nodes)
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
def _worst_values(values, state, ends, own, order, lattice, room, out):
    """out[j] = maximum of the interpolated `values` over the box of input j around a state.

    The maximum is taken axis by axis as in `sdhj.solver.hopf_lax`, so it errs to the safe side. A box that goes past an
    unsafe end has +inf, one that is past a safe end with all it has -inf.
    """
    _gather(values, state, order, lattice, room)
    low, high, rest = ends[0, :, :, own], ends[1, :, :, own], room.rest
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
def _by_tubes(m, own, states, when, shelf, ends, order, lattice, room, out):
    """The answers for one state, but for the look at the true sets."""
    to_go, safe, margins, best = out
    step, within = when
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
    _worst_values(tube, state, ends, own, order, lattice, room, margins[m])
    best[m] = _judge(shelf, step, state, lattice, room, margins[m], safe[m])


@kernel(**UNCOUNTED)
def _hull(ends, own, spacing, hull):
    """Write the box that holds those of all inputs; returns how many nodes it can touch, and one more on each axis."""
    size = 1.0
    for axis in range(ends.shape[2]):
        hull[0, axis], hull[1, axis] = ends[0, 0, axis, own], ends[1, 0, axis, own]
        for j in range(1, ends.shape[1]):
            hull[0, axis] = min(hull[0, axis], ends[0, j, axis, own])
            hull[1, axis] = max(hull[1, axis], ends[1, j, axis, own])
        size *= np.ceil((hull[1, axis] - hull[0, axis]) / spacing[axis] + 1e-6) + 2.0
    return int(size)


@kernel(**UNCOUNTED)
def _place(at, count, state, ends, own, j, lattice, look, room):
    """Write `count` points at which the true sets are looked at for u_j: the state, its path, the corners of the box.

    past: 1 where nothing matters any longer, behind a safe end; -1 where the path is past an unsafe one.
    """
    ndim, last, faces, gone = state.size, look.times.size - 1, look.faces, False
    for v in range(count):
        out, lost, share = False, False, v / last
        for axis in range(ndim):
            x = state[axis]
            if v > last:
                x += ends[((v - last - 1) >> (ndim - 1 - axis)) & 1, j, axis, own]
            elif v > 0:
                x += share * ends[2, j, axis, own]
                x += share * share * ends[3, j, axis, own]
                lost |= (x < lattice.least[axis]) | (x > lattice.most[axis])
            out |= (x < lattice.left[0, axis]) | (x > lattice.left[1, axis])
            x = min(max(x, faces[0, axis]), faces[1, axis])
            if lattice.periodic[axis]:
                x = turned(x, faces[2, axis], faces[3, axis])
            room.points[at + v, axis] = x
        gone |= out & (v <= last)
        room.past[at + v] = 1 if out | (gone & (v <= last)) else -1 if lost else 0
        room.points[at + v, ndim] = look.times[min(v, last)]


@kernel(**UNCOUNTED)
def _clear(room, sets, at, count):
    """Whether no set of `level` has one of the points; `LOST` is added where one has the first, the state."""
    found = PASSES
    for v in range(at, at + count):
        fine = room.past[v] >= 0
        for p in range(sets):
            fine &= room.level[p, v] > 0.0
        if not (fine | (room.past[v] > 0)):
            found = found | LOST if v == at else found & LOST
    return found


@kernel()
def _verdict(at, count, left, look, room):
    """What the true sets say of the points of a state and an input, whose unsafe sets have been played.

    left : steps to go after the interval.
    """
    found, corner = _clear(room, look.unsafe.outputs.size, at, count), at + look.times.size
    if not found & PASSES or left != 0 or count == 1 or look.target.outputs.size == 0:
        return found
    if play_part(look.target, room.points, look.times, room.level, corner, at + count) != 0.0:
        return UNDEFINED
    for v in range(corner, at + count):
        found = found & LOST if room.level[0, v] > 0.0 else found
    return found


@kernel(**UNCOUNTED)
def _settled(first, safe, margin, room):
    """The best input by what is known of them, or the one to look at next; -1 where hazards are wanted."""
    known, hazard, best, least = room.known, room.hazard, -1, np.inf
    if known[first] != FAILS:
        return first
    for j in range(safe.size):
        safe[j] = safe[j] and known[j] != FAILS
        if safe[j] and (best < 0 or margin[j] < least):
            best, least = j, margin[j]
    if best >= 0 or not (hazard[0] == hazard[0]):
        return best
    for j in range(safe.size):
        worse = max(margin[j], hazard[j])
        if known[j] != FAILS and worse < least:
            best, least = j, worse
    return best if best >= 0 else first


@kernel(**UNCOUNTED)
def _preferred(scores, safe, margin, known):
    """The safe input of least score that does not fail, of equals that of least margin; -1: none is safe."""
    best = -1
    for j in range(scores.size):
        if safe[j] and known[j] != FAILS:
            better = best < 0 or scores[j] < scores[best]
            if better or (scores[j] == scores[best] and margin[j] < margin[best]):
                best = j
    return best


@kernel(**UNCOUNTED)
def _hazards(shelf, step, state, lattice, room, out):
    """out[j] = the interpolated avoid tube of u_j at a state."""
    still = corners(state, shelf.static_axes, lattice, TINY, room.index[0], room.weight[0])
    moving = corners(state, shelf.moving_axes, lattice, TINY, room.index[1], room.weight[1])
    for j in range(out.size):
        out[j] = _hazard(shelf, step, j, room, still, moving)


@kernel()
def _checked(at, count, m, own, states, when, shelf, ends, lattice, look, room, scores, out):
    """Undo what the true sets refute of the answers for a state in a tube; False where a formula has no value.

    The unsafe sets have been played at the points of its best input.
    """
    to_go, safe, margins, best = out
    state, (step, within), final, first, settled = states[m], when, count == 1, best[m], False
    left = max(to_go[m], within) - 1
    room.known[:], room.hazard[0] = UNKNOWN, np.nan
    found = room.known[first] = _verdict(at, count, left, look, room)
    while not final and found < LOST:
        j = _preferred(scores[m], safe[m], margins[m], room.known) if settled else -1
        best[m] = j = j if j >= 0 else _settled(first, safe[m], margins[m], room)
        if j < 0:
            _hazards(shelf, step, state, lattice, room, room.hazard)
        elif room.known[j] == UNKNOWN:
            _place(at, count, state, ends, own, j, lattice, look, room)
            if play_part(look.unsafe, room.points, look.times, room.level, at, at + count) != 0.0:
                return False
            found = room.known[j] = _verdict(at, count, left, look, room)
        elif settled or scores.shape[0] == 0:
            break
        else:
            settled = True
    if to_go[m] == 0 and found < LOST and look.target.outputs.size > 0:
        if play_part(look.target, room.points, look.times, room.level, at, at + 1) != 0.0:
            return False
        if room.level[0, at] > 0.0:
            to_go[m], found = 1, LOST if final else found
    if found >= LOST:
        to_go[m], safe[m], margins[m], best[m] = -1, False, np.inf, -1
    return found != UNDEFINED


@kernel()
def _room(ndim, inputs, points, sets, size):
    """A `Room` for so many inputs, points, unsafe sets, and nodes of a block."""
    around, spans = (2, 1 << ndim), np.empty((2, ndim + 1), np.int64)
    nodes = np.arange(ndim), np.empty(around, np.int64), np.empty(around), np.empty(inputs, np.bool_)
    block = spans[0], spans[1], np.empty(size, np.int64), np.empty(2 * size)
    spots = np.empty((points, ndim + 1)), np.empty(points, np.int64), np.empty((max(sets, 1), points))
    return Room(np.empty((2, ndim)), *nodes, *block, *spots, np.empty(inputs, np.int64), np.empty(inputs))


@kernel(nogil=True)
def decide(states, rows, when, shelf, lattice, ahead, look, looks, scores, out):
    """Steps to go, the safe inputs and their margins, for some of the states (M, ndim) at one step (Algorithm 2).

    Parameters
    ----------
    rows : (R,) int64
        Which states, in the order in which they are looked up: neighbours share what the cache holds.
    when : (step, within)
        Inputs are judged by the tube of the fewest steps to go, but of `within`, at least 1, where that is more.
    shelf, lattice, ahead, look : tuples
        The fields of a `Shelf`, a `Lattice`, an `Ahead` and a `Look`, tapes too: plain tuples get into compiled code in
        half the time of named ones.
    looks : `TUBES`, `LOOKED` or `ONLY_LOOK`
        The last judges the inputs `best` with `to_go` steps to go afterwards, and writes what it finds to `to_go`.
    scores : (M, L) or (0, L)
        Which safe input is preferred as `best`, if any is: that of least score, of equals that of least margin.
    out : (to_go (M,), safe (M, L), margins (M, L), best (M,))
        To be written. to_go is -1 where no tube holds the state; safe is False, margins inf and best -1 there and at
        the last step.

    Returns
    -------
    bool
        Whether all formulas have values wherever they were evaluated; else the answers are worthless.
    """
    shelf, lattice, ahead = Shelf(*shelf), Lattice(*lattice), Ahead(ahead[0], ahead[1], Tape(*ahead[2]), ahead[3])
    look, tape = Look(look[0], look[1], Tape(*look[2]), Tape(*look[3])), ahead.tape
    ndim, inputs, played, sets = states.shape[1], out[1].shape[1], tape.outputs.size > 0, look.unsafe.outputs.size
    count, size = 1 if when[0] == shelf.steps else look.times.size + (1 << ndim), 64
    width = max(1, min(BLOCK // count, rows.size))  # states at a time
    room, slots = _room(ndim, inputs, width * count, sets, size), np.empty(width, np.int64)
    at, flat = np.empty((width, ndim)), np.empty((tape.outputs.size, width))
    ends = flat.reshape(4, inputs, ndim, width) if played else ahead.ends
    shift = 0 if played or ends.shape[3] == 1 else 1
    for begin in range(0, rows.size, width):
        some, found = rows[begin : begin + width], 0
        for r in range(some.size if played else 0):
            at[r] = states[some[r]]
        if played and play_part(tape, at, ahead.begin, flat, 0, some.size) != 0.0:
            return False
        for r in range(some.size):
            m, own = some[r], r if played else shift * (begin + r)
            if looks != ONLY_LOOK:
                if ends.shape[3] > 1 or begin + r == 0:
                    needed = _hull(ends, own, lattice.spacing, room.hull)
                    if needed > size:
                        size, block = 2 * needed, (np.empty(2 * needed, np.int64), np.empty(4 * needed))
                        room = Room(*room[:7], *block, *room[9:])  # type: ignore[call-arg]
                _by_tubes(m, own, states, when, shelf, ends, ahead.order, lattice, room, out)
            if looks != TUBES and out[0][m] >= 0:
                _place(found * count, count, states[m], ends, own, max(out[3][m], 0), lattice, look, room)
                slots[found], found = r, found + 1
        if found > 0 and play_part(look.unsafe, room.points, look.times, room.level, 0, found * count) != 0.0:
            return False
        for k in range(found):
            m, own = some[slots[k]], slots[k] if played else shift * (begin + slots[k])
            if looks == ONLY_LOOK:
                out[0][m] = _verdict(k * count, count, out[0][m], look, room)
                fine = out[0][m] != UNDEFINED
            else:
                fine = _checked(k * count, count, m, own, states, when, shelf, ends, lattice, look, room, scores, out)
            if not fine:
                return False
    return True


@kernel(nogil=True)
def avoid_values(states, step, shelf, lattice, out):
    """out[m, j] = the interpolated avoid tube of u_j at states[m] over the interval from a step, at a wall beyond it.

    states (M, ndim), shelf and lattice as for `decide`, out (M, L). Coordinates must be finite.
    """
    shelf, lattice, room = Shelf(*shelf), Lattice(*lattice), _room(states.shape[1], out.shape[1], 0, 0, 0)
    for m in range(out.shape[0]):
        _hazards(shelf, step, states[m], lattice, room, out[m])


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
