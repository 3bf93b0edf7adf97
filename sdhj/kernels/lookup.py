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
from sdhj.kernels.tape import BLOCK, RESULTS, TABLES, length, part, play_in_room, slots_of, work_for

TINY = 1e-9  # a weight below it is rounding: the state is on the other node
CENTRE = 0.25  # of the depth of an input for ever: the share that the game's value at the centre of its box has
LOOKED = 4  # instants of an interval at which the path without an adversary is looked at, its end among them
PATH = 4  # terms of what inputs lead to, before the segments: corners of a box, and the path without an adversary
A_CELL = 4.0  # intervals between the points at which segments are looked at, for a cell of half their length
MOST_POINTS = 4096  # of sums of segments that are looked at: of more the box is taken
UNKNOWN, PASSES, FAILS = range(3)  # an input, by the true sets
TUBES, LOOK, ONLY_LOOK = range(3)  # what `decide` does: by the tubes, by the true sets too, or by those alone

# What is `packed` of a problem at one step: a `Lattice`; the axes of the avoid tubes; the order of axes in which maxima
# are taken; the times of the V points that are looked at, the path first, then the state and the corners; (6, ndim):
# between what coordinates are clipped, the ends of the grid, and walls at which segments are held; when the interval begins; and three tapes: what inputs
# lead to, the unsafe sets and the target, the two of points with the time as one more coordinate.
_STATIC, _MOVING, _ORDER, LOOK_TIMES, _FACES, _BEGIN, _AHEAD = range(len(Lattice._fields), len(Lattice._fields) + 7)
_UNSAFE = _AHEAD + TABLES + 1
_TARGET = _UNSAFE + TABLES + 1


class Shelf(NamedTuple):
    """A look-up table as compiled code reads it, every function on a grid flat.

    steps; game, the place in tubes of the values by which inputs are selected, -1 where those of the next tube are;
    index (entries,), the place of each (start, within) in tubes (T, size) and masks (T, bytes, size); static (L, size
    of the subgrid of static_axes) and moving (steps * L, size of the subgrid of moving_axes), the avoid tubes.
    """

    steps: int
    game: int
    index: Any
    tubes: Any
    masks: Any
    static: Any
    static_axes: Any
    moving: Any
    moving_axes: Any


class Room(NamedTuple):
    """Room to work in.

    hull (R, 2, ndim): the box that holds those of all inputs, of each state, or one for all. axes (ndim,): all of them;
    index, weight (2, 2^ndim): nodes around a state; marks (L,): whether they all mark an input. Of a block: the first
    node on each axis in `order`, begin (ndim,); how many nodes that axis and those behind it have, rest (ndim + 1,);
    where they are on the grid, offsets (size,). What is left when the maxima along the axes before it are taken begins
    at values[rest[a]], behind all that is left later: values (2 size,). centre (ndim,): of the box of an input.
    Of segments: looks (L, K), how many points of each are looked at; the boxes around one point of their sum, moved
    (2, L, ndim, 1), and what is worst in them, worst (L,); held (2 ndim,): walls.
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
    centre: Any
    looks: Any
    moved: Any
    worst: Any
    held: Any


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
def _gather(values, state, column, order, lattice, room):
    """Copy flat `values` at the nodes that any box touches to room.values[rest[0]:], the axis order[0] slowest."""
    offsets, rest = room.offsets, room.rest
    offsets[0], rest[state.size] = 0, 1
    for a in range(state.size - 1, -1, -1):
        axis = order[a]
        nodes, stride, size = lattice.shape[axis], 1, rest[a + 1]
        for later in range(axis + 1, state.size):
            stride *= lattice.extent[later]
        begin, _ = locate(state[axis] + room.hull[column, 0, axis], axis, lattice)
        end, _ = locate(state[axis] + room.hull[column, 1, axis], axis, lattice)
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
def _spread(ends, column, j, axis):
    """How far the segments of an input lead along an axis, all of them."""
    far = 0.0
    for k in range(PATH, ends.shape[0]):
        far += abs(ends[k, j, axis, column])
    return far


@kernel(**UNCOUNTED)
def _is_held(state, ends, column, j, held):
    """Whether the segments of an input lead past a wall, where the state may end outside their sum."""
    for axis in range(state.size):
        far = _spread(ends, column, j, axis)
        low, high = state[axis] + ends[0, j, axis, column] - far, state[axis] + ends[1, j, axis, column] + far
        if far > 0.0 and (low < held[axis] or high > held[state.size + axis]):
            return True
    return False


@kernel(**UNCOUNTED)
def _looks_at(state, ends, column, lattice, room):
    """Write how many points of each segment are looked at, 0 where its box is; returns the most of their sums."""
    most, looks = 1, room.looks
    for j in range(ends.shape[1]):
        points = 1
        for k in range(looks.shape[1]):
            cells = 0.0
            for axis in range(state.size):
                cells = max(cells, abs(ends[PATH + k, j, axis, column]) / lattice.spacing[axis])
            looks[j, k] = 1 + int(np.ceil(min(A_CELL * cells, MOST_POINTS)))
            points = min(points * looks[j, k], MOST_POINTS + 1)
        if points > MOST_POINTS or _is_held(state, ends, column, j, room.held):
            looks[j], points = 0, 1
        most = max(most, points)
    return most


@kernel(**UNCOUNTED)
def _move(point, ends, column, room):
    """Write the boxes of all inputs around a point of the sum of their segments, by its number."""
    for j in range(ends.shape[1]):
        for axis in range(ends.shape[2]):
            room.moved[0, j, axis, 0], room.moved[1, j, axis, 0] = ends[0, j, axis, column], ends[1, j, axis, column]
        left = point
        for k in range(room.looks.shape[1]):
            looks, share, wider = room.looks[j, k], 0.0, 1.0
            if looks > 0:
                share, wider = 2.0 * (left % looks) / max(looks - 1, 1) - (looks > 1), 0.0
                left //= looks
            for axis in range(ends.shape[2]):
                half = ends[PATH + k, j, axis, column]
                room.moved[0, j, axis, 0] += share * half - wider * abs(half)
                room.moved[1, j, axis, 0] += share * half + wider * abs(half)


@kernel(**UNCOUNTED)
def _worst_values(values, state, ends, column, order, lattice, room, out):
    """out[j] = maximum of the interpolated `values` over what input j leads to from a state.

    That is a box or, where something moves several axes, the sum of a box and segments, points of which are looked at,
    no more than half a cell apart along each; where they are held at a wall, or too many, the box around it.
    """
    _gather(values, state, column, order, lattice, room)
    if ends.shape[0] == PATH:
        _worst_in_boxes(state, ends, column, order, lattice, room, out)
        return
    out[:] = -np.inf
    for point in range(_looks_at(state, ends, column, lattice, room)):
        _move(point, ends, column, room)
        _worst_in_boxes(state, room.moved, 0, order, lattice, room, room.worst)
        for j in range(out.size):
            out[j] = max(out[j], room.worst[j])


@kernel(**UNCOUNTED)
def _worst_in_boxes(state, ends, column, order, lattice, room, out):
    """out[j] = maximum of the interpolated values that were gathered over the box of input j around a state.

    The maximum is taken axis by axis as in `sdhj.solver.hopf_lax`, so it errs to the safe side. A box that goes past an
    unsafe end has +inf, one that is past a safe end with all it has -inf.
    """
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
def _depths(shelf, state, ends, column, order, lattice, room, out):
    """out[j] = (1 - CENTRE) times the largest value of the game in the box of input j, CENTRE times that at its centre.

    Where the adversary can bring the state back to a ridge of the value in every interval, all that leads off the ridge
    has a worse largest value than what stays on it, although each step along it is lost. The centre tells them apart.
    """
    _worst_values(shelf.tubes[shelf.game], state, ends, column, order, lattice, room, out)
    centre, index, weight = room.centre, room.index[1], room.weight[1]
    for j in range(out.size):
        for axis in range(state.size):
            centre[axis] = state[axis] + 0.5 * (ends[0, j, axis, column] + ends[1, j, axis, column])
        count = corners(centre, room.axes, lattice, TINY, index, weight)
        out[j] = (1.0 - CENTRE) * out[j] + CENTRE * weighted(shelf.tubes, shelf.game, index, weight, count)


@kernel(**UNCOUNTED)
def _hazard(shelf, step, j, room, still, moving):
    """The interpolated avoid tube of u_j, <= 0 where it is safe: the larger of the static and the moving one."""
    value = weighted(shelf.static, j, room.index[0], room.weight[0], still)
    place = step * room.marks.size + j
    return max(value, weighted(shelf.moving, place, room.index[1], room.weight[1], moving))


@kernel(**UNCOUNTED)
def _of_tubes(shelf, step, state, lattice, room, margin, safe, depth):
    """safe[j] from marks and margins, and the best input by depth; see `notebooks/site/queries.md`."""
    best = -1
    for j in range(safe.size):  # the interpolated avoid tube of a marked input is <= 0 too
        safe[j] = room.marks[j] and margin[j] <= 0.0
        if safe[j] and (best < 0 or depth[j] < depth[best]):
            best = j
    if best >= 0:
        return best
    still = corners(state, shelf.static_axes, lattice, TINY, room.index[0], room.weight[0])
    moving = corners(state, shelf.moving_axes, lattice, TINY, room.index[1], room.weight[1])
    for j in range(safe.size):
        safe[j] = margin[j] <= 0.0 and _hazard(shelf, step, j, room, still, moving) <= 0.0
        if safe[j] and (best < 0 or depth[j] < depth[best]):
            best = j
    if best >= 0:
        return best
    best, least = 0, np.inf
    for j in range(safe.size):
        worse = max(depth[j], _hazard(shelf, step, j, room, still, moving))
        one, other = shelf.game < 0 and room.marks[j], shelf.game < 0 and room.marks[best]
        if one > other or (one == other and worse < least):
            best, least = j, worse
    return best


@kernel(**UNCOUNTED)
def _by_tubes(m, column, states, when, shelf, ends, space, out):
    """The answers for one state, but for the look at the true sets."""
    (order, lattice, room), (to_go, safe, margins, best, depths), (step, within) = space, out, when
    state, steps, index, weight = states[m], shelf.steps, room.index[0], room.weight[0]
    here = step * (steps + 1) - step * (step - 1) // 2  # the place of (step, 0), see `sdhj.table.table.entry`
    following = here + steps - step + 1  # the place of (step + 1, 0)
    to_go[m], safe[m], margins[m], best[m], depths[m] = -1, False, np.inf, -1, np.inf
    if not on_grid(state, lattice):
        return
    count = corners(state, room.axes, lattice, TINY, index, weight)
    if shelf.game < 0:
        to_go[m] = _fewest_steps(shelf, here, steps - step, index, weight, count)
    elif weighted(shelf.tubes, shelf.game, index, weight, count) <= 0.0:
        to_go[m] = steps - step
    if to_go[m] < 0 or step == steps:
        return
    n = max(to_go[m], within)  # in the target already: inputs that bring the state back into it
    _mark(shelf.masks, shelf.index[here + n], index, count, room.marks)
    tube = shelf.tubes[shelf.index[following + n - 1]]
    _worst_values(tube, state, ends, column, order, lattice, room, margins[m])
    if shelf.game >= 0:
        _depths(shelf, state, ends, column, order, lattice, room, depths[m])
    best[m] = _of_tubes(shelf, step, state, lattice, room, margins[m], safe[m], depths[m])


@kernel(**UNCOUNTED)
def _hull(ends, column, spacing, hull):
    """Write the box that holds those of all inputs; returns how many nodes it can touch, and one more on each axis."""
    size = 1.0
    for axis in range(ends.shape[2]):
        hull[0, axis], hull[1, axis] = np.inf, -np.inf
        for j in range(ends.shape[1]):
            far = _spread(ends, column, j, axis)
            hull[0, axis] = min(hull[0, axis], ends[0, j, axis, column] - far)
            hull[1, axis] = max(hull[1, axis], ends[1, j, axis, column] + far)
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
def _farthest(ends, column, j, corner, axis, spacing, boxed):
    """How far segments lead along an axis at the point of their sum that lies farthest towards a corner of the box."""
    far = 0.0
    for k in range(PATH, ends.shape[0]):
        towards = 0.0
        for other in range(spacing.size):
            side = ((corner >> (spacing.size - 1 - other)) & 1) * 2.0 - 1.0
            towards += side * ends[k, j, other, column] / spacing[other] * (other == axis or not boxed)
        far += ends[k, j, axis, column] * (1.0 if towards >= 0.0 else -1.0)
    return far


@kernel(**UNCOUNTED)
def _place(at, state, j, box, lattice, look, spots):
    """Write the points, from `at` on, at which the true sets are looked at for u_j, and which of them are past ends."""
    (ends, column), (times, faces), (points, past) = box, look, spots
    ndim, last, gone = state.size, LOOKED if times.size > 1 else 0, False
    sums = ends.shape[0] > PATH
    boxed = sums and _is_held(state, ends, column, j, faces[4 * ndim :])
    for i in range(times.size):  # the state, the path, the corners
        spot, share, out, lost = at + (last if i == 0 else i - 1 if i <= last else i), i / LOOKED, False, False
        for axis in range(ndim):
            x = state[axis]
            if i > last:
                x += ends[((i - last - 1) >> (ndim - 1 - axis)) & 1, j, axis, column]
                if sums:
                    x += _farthest(ends, column, j, i - last - 1, axis, lattice.spacing, boxed)
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
def _next(known, safe, scores, depth, hazard, first):
    """The input to look at next; if it has passed already, or has failed, it is the answer.

    Of the safe ones that of least score, of equals that of least depth; where none is safe, `first`, the best by the
    tubes; where that fails, the one for which the larger of depth and hazard is least; where none passes, `first`.
    """
    best, least = -1, np.inf
    for j in range(safe.size):
        if safe[j] and known[j] != FAILS:
            better = best < 0 or scores[j] < scores[best]
            if better or (scores[j] == scores[best] and depth[j] < depth[best]):
                best = j
    if best >= 0 or known[first] != FAILS:
        return best if best >= 0 else first
    for j in range(safe.size):
        worse = max(depth[j], hazard[j])
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
    (to_go, safe, _, best, depths), (slots, known, hazard, points, past, _, _) = out, spots
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
        j = _next(known[r], safe[m], scores[m], depths[m], hazard[r], slots[1, r])
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
    (to_go, safe, margins, best, depths), (slots, known, _, _, past, level, there) = out, spots
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
            safe[m], margins[m], best[m], depths[m] = False, np.inf, -1, np.inf
        elif not passes:
            safe[m, j] = False
            slots[0, some] = r
            some += 1
    return some


@kernel(**UNCOUNTED)
def _evaluate(waiting, rows, packs, times, to_go, spots, work):
    """Play the unsafe sets at the points of what waits, the target where it matters; whether all values are finite.

    The type of a constant is the constant, and all that is played would be compiled for it anew: hence `np.int64`.
    """
    (ints, floats), (slots, _, _, points, _, level, there) = packs, spots
    count, last = times.size, LOOKED if times.size > 1 else 0
    unsafe, target = (ints, floats, np.int64(_UNSAFE)), (ints, floats, np.int64(_TARGET))
    if play_in_room(unsafe, points, times, level, np.int64(0), waiting * count, work) != 0.0:
        return False
    for k in range(waiting if length(ints, np.int64(_TARGET + RESULTS)) > 0 else 0):
        start = k * count + last + (to_go[rows[slots[0, k]]] != 0)
        stop = (k + 1) * count if slots[2, slots[0, k]] == 0 else k * count + last + 1
        if start < stop and play_in_room(target, points, times, there, start, stop, work) != 0.0:
            return False
    return True


@kernel(**UNCOUNTED)
def _look(rows, when, states, packs, ahead, table, space, out):
    """The look at the true sets for some rows, by their tapes; False where they are undefined.

    table : (shelf, lattice). space : (room, spots, work)
    """
    (step, within, _, _, looks), (ints, floats), (shelf, lattice), (room, spots, work) = when, packs, table, space
    times = part(ints, floats, LOOK_TIMES)
    waiting = propose(np.int64(-1), within, states, rows, packs, ahead, out, spots)
    while waiting > 0:
        if not _evaluate(waiting, rows, packs, times, out[0], spots, work):
            return False
        waiting = judge(waiting, rows, looks, times.size, out, spots)
        for k in range(waiting if looks == LOOK else 0):
            r, some = spots[0][0, k], False
            for j in range(out[1].shape[1]):
                some |= out[1][rows[r], j]
            if not some:
                _hazards(shelf, step, states[rows[r]], lattice, room, spots[2][r])
        waiting = propose(waiting, within, states, rows, packs, ahead, out, spots)
    return True


@kernel(**UNCOUNTED)
def _lead(begin, rows, states, packs, ends, found, work):
    """Write what inputs lead to from states rows[begin:], and hulls; how many nodes these may touch, -1: undefined.

    found : near (4 + K, L, ndim, R), which may be `ends` if that is one for all states; at (R, ndim), overwritten; hulls
    """
    (ints, floats), (near, at, hulls), ndim, most = packs, found, states.shape[1], 0
    played = length(ints, np.int64(_AHEAD + RESULTS))
    if played > 0:
        for r in range(rows.size):
            for axis in range(ndim):
                at[r, axis] = states[rows[r], axis]
        tape, lead = (ints, floats, np.int64(_AHEAD)), near.reshape(played, near.shape[3])
        if play_in_room(tape, at, part(ints, floats, _BEGIN), lead, np.int64(0), rows.size, work) != 0.0:
            return -1
    elif ends.shape[3] > 1:
        for term in range(near.shape[0]):
            for j in range(near.shape[1]):
                for axis in range(ndim):
                    for r in range(rows.size):
                        near[term, j, axis, r] = ends[term, j, axis, begin + r]
    if played > 0 or ends.shape[3] > 1 or begin == 0:  # else one for all states; on six axes a block may be one state
        for r in range(min(rows.size, near.shape[3])):
            most = max(most, _hull(near, r, part(ints, floats, 1), hulls[r]))
    return most


@kernel(**UNCOUNTED)
def _answer(rows, states, when, packs, stored, ahead, space, out):
    """The answers for some states; False where formulas are undefined."""
    (step, within, steps, game, looks), (ints, floats), (index, tubes, masks, static, moving) = when, packs, stored
    lattice, order = _lattice(ints, floats), part(ints, ints, _ORDER)
    still, timed = part(ints, ints, _STATIC), part(ints, ints, _MOVING)
    shelf = Shelf(steps, game, index, tubes, masks, static, still, moving, timed)
    for r in range(rows.size if looks != ONLY_LOOK else 0):
        column = r if ahead[0].shape[3] > 1 else 0
        _by_tubes(rows[r], column, states, (step, within), shelf, ahead[0], (order, lattice, space[0]), out)
    return looks == TUBES or _look(rows, when, states, packs, ahead, (shelf, lattice), space, out)


@kernel()
def _room(columns, ndim, inputs, size, segments, held):
    """A `Room` for so many hulls, inputs, nodes of a block and segments, and walls."""
    around, spans, axes = (2, 1 << ndim), np.empty((2, ndim + 1), np.int64), np.empty(ndim, np.int64)
    for axis in range(ndim):
        axes[axis] = axis
    nodes = axes, np.empty(around, np.int64), np.empty(around), np.empty(inputs, np.bool_)
    block = np.empty(size, np.int64), np.empty(2 * size)
    sums = np.empty((inputs, segments), np.int64), np.empty((2, inputs, ndim, 1)), np.empty(inputs), held
    return Room(np.empty((columns, 2, ndim)), *nodes, spans[0], spans[1], *block, np.empty(ndim), *sums)


@kernel(nogil=True)
def spots_for(states, inputs, count, ndim, sets):
    """Room for the look at the true sets: for R states `count` points of each that waits, one behind the other.

    slots (3, R): the numbers of those that wait; of each state the best input by the tubes, and the steps to go after
    the interval. known, hazard (R, L): what is known of the inputs. points (R count, ndim + 1), the time last; past
    (R count,): 1 where nothing matters any longer, behind a safe end, -1 where the path is past an unsafe one; level
    (sets, R count) and there (1, R count): the values of the unsafe sets and, at state and corners, of the target.
    """
    slots, known, size = np.empty((3, states), np.int64), np.empty((states, inputs), np.int64), states * count
    points, past, there = np.empty((size, ndim + 1)), np.empty(size, np.int64), np.empty((1, size))
    for i in range(size):
        there[0, i] = 0.0
    return slots, known, np.empty((states, inputs)), points, past, np.empty((sets, size)), there


@kernel(nogil=True)
def decide(states, rows, when, packs, stored, ends, scores, out):
    """Steps to go, the safe inputs and their margins, for some of the states (M, ndim) at one step (Algorithm 2).

    Parameters
    ----------
    rows : (R,) int64
        Which states, in the order in which they are looked up: neighbours share what the cache holds.
    when : (step, within, steps, game, looks)
        Inputs are judged by the tube of the fewest steps to go, but of `within`, at least 1, where that is more. game:
        as in `Shelf`. looks: `TUBES`, `LOOK` or `ONLY_LOOK`, which begins with what is in `out`.
    packs, stored : (ints, floats), (index, tubes, masks, static, moving)
        What is packed (above); of a `Shelf`.
    ends : (4 + K, L, ndim, 1 or R)
        What each input can lead to, relative to the state: the lower and the upper corner of a box that, with K
        segments, holds all states at the interval's end; two terms of the path without an adversary, which after a
        share s of the interval is s ends[2] + s^2 ends[3] away; and half of each segment. Where there is a tape for it, it is played, and `ends` is not read.
    scores : (M, L)
        Which safe input is preferred as `best`: that of least score, of equals that of least depth.
    out : (to_go (M,), safe (M, L), margins (M, L), best (M,), depths (M, L))
        To be written. to_go is -1 where no tube holds the state; safe is False, margins and depths inf and best -1
        there and at the last step. Without a `game`, depths is the array margins.

    Returns
    -------
    bool
        Whether all formulas have values wherever they were evaluated; else the answers are worthless.
    """
    ints, inputs, ndim, slots = packs[0], out[1].shape[1], states.shape[1], 1
    count, sets = length(ints, np.int64(LOOK_TIMES)), length(ints, np.int64(_UNSAFE + RESULTS))
    width, size = max(1, min(BLOCK // max(count, 1), rows.size)), 64  # states at a time, nodes of a block
    played, faces = length(ints, np.int64(_AHEAD + RESULTS)), part(ints, packs[1], _FACES)
    terms = played // (inputs * ndim) if played > 0 else ends.shape[0]
    alike = played == 0 and ends.shape[3] == 1
    near, at = ends if alike else np.empty((terms, inputs, ndim, width)), np.empty((width, ndim))
    room = _room(near.shape[3], ndim, inputs, size, terms - PATH, faces[4 * ndim :])
    spots = spots_for(width if when[4] != TUBES else 0, inputs, count, ndim, sets)
    for first in (_AHEAD, _UNSAFE, _TARGET):
        slots = max(slots, slots_of(ints, np.int64(first)))
    work = work_for(slots, min(BLOCK, width * max(count, 1)))
    for begin in range(0, rows.size, width):
        some = rows[begin : begin + width]
        needed = _lead(begin, some, states, packs, ends, (near, at, room.hull), work)
        if needed > size:
            size, block = 2 * needed, (np.empty(2 * needed, np.int64), np.empty(4 * needed))
            room = Room(*room[:7], *block, *room[9:])  # type: ignore[call-arg]
        if needed < 0 or not _answer(some, states, when, packs, stored, (near, scores), (room, spots, work), out):
            return False
    return True


@kernel(nogil=True)
def avoid_values(states, step, ints, floats, static, moving, out):
    """out[m, j] = the interpolated avoid tube of u_j at states[m] over the interval from a step, at a wall beyond it.

    states (M, ndim), what is packed and stored as for `decide`, out (M, L). Coordinates must be finite.
    """
    axes, lattice = (part(ints, ints, _STATIC), part(ints, ints, _MOVING)), _lattice(ints, floats)
    nothing = axes[0], static, static  # in place of index, tubes and masks, which nobody reads here
    shelf = Shelf(0, -1, *nothing, static, axes[0], moving, axes[1])
    room = _room(1, states.shape[1], out.shape[1], 0, 0, part(ints, floats, _FACES))
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
