"""Compiled answers from the tubes of a table: steps to go, safe inputs and margins, avoid tubes, values at points.

A *span* is the stretch of consecutive nodes on one axis that an interval of coordinates touches; a *block* holds the
values at a product of spans.
"""

from typing import Any, NamedTuple

import numpy as np

from sdhj.kernels.compiling import UNCOUNTED, kernel
from sdhj.kernels.interpolation import Lattice, locate, nodes_around, on_grid, periodic_index, weighted
from sdhj.kernels.tape import BLOCK, TABLES, part

TINY = 1e-9  # a weight below it is rounding: the state is on the other node
# terms of what inputs lead to, before what there is more of it, segments or planes: corners of a box, and the path
# without an adversary
PATH = 4
A_CELL = 4.0  # intervals between the points at which segments are looked at, for a cell of half their length
SLABS_A_CELL = 4.0  # that what lies between planes is cut into, for a cell
MOST_POINTS = 4096  # of sums of segments, or slabs, that are looked at: of more the box is taken

# What is `packed` of a problem at one step: a `Lattice`; the axes of the avoid tubes; the order of axes in which maxima
# are taken; the times of the V points that are looked at, the path first, then the state and the corners; (6, ndim):
# between what coordinates are clipped, the ends of the grid, and walls at which segments are held; when the interval
# begins; where an unsafe set is unsafe under some inputs only, under which each is (`heed_inputs`); and three tapes:
# what inputs lead to, the unsafe sets and the target, of points with the time as one more coordinate.
AT_STATIC, AT_MOVING, AT_ORDER, CHECK_TIMES, AT_FACES, AT_BEGIN, AT_UNDER, AT_AHEAD = range(
    len(Lattice._fields), len(Lattice._fields) + 8
)
AT_UNSAFE = AT_AHEAD + TABLES + 1
AT_TARGET = AT_UNSAFE + TABLES + 1


class StoredAvoidTubes(NamedTuple):
    """The avoid tubes of a table: of sets that stand still, and of those that move."""

    static: Any  # (L, size of the subgrid)
    static_axes: Any  # the subgrid's
    moving: Any  # (steps * L, size of the subgrid)
    moving_axes: Any


class StoredTubes(NamedTuple):
    """A look-up table as compiled code reads it, every function on a grid flat, in an array of `size` nodes."""

    steps: int  # N
    index: Any  # (entries,): the index of each (start, within) in tubes and marks
    # (T, size): the level-set functions, and (T, bytes, size) uint8, a bit for each input
    tubes: Any
    marks: Any
    avoid: StoredAvoidTubes


class Leads(NamedTuple):
    """What each input can lead to, and which inputs are preferred."""

    # (4 + K, L, ndim, 1 or R): relative to the state, a column for each: the lower and the upper corner of a box that,
    # with K segments, holds all states at the interval's end; two terms of the path without an adversary, which after a
    # share s of the interval is s ends[2] + s^2 ends[3] away; and half of each segment. Where states are between
    # planes: behind the path the greatest n . x for each normal n, `ndim` of these in a term.
    ends: Any
    scores: Any  # (M, L): the safe input of least score is preferred, of equals that of least margin
    normals: Any  # (K', ndim): of the planes, of which there may be none


class Answers(NamedTuple):
    """What look-ups say of M states: written in place."""

    to_go: Any  # (M,): the fewest steps to go, -1 where no tube holds the state
    safe: Any  # (M, L): False there and at the last step
    margins: Any  # (M, L): inf there
    best: Any  # (M,): the preferred input, -1 there


class LookupScratch(NamedTuple):
    """Arrays that a look-up overwrites; made by `working_room`."""

    hull: Any  # (R, 2, ndim): the box that holds the boxes of all inputs, for each state, or one for all
    axes: Any  # (ndim,): the numbers of all axes
    # (3, 2^ndim): nodes around a state, on the axes of the static and the moving avoid tubes, and on all
    index: Any
    weight: Any
    marked: Any  # (L,): whether all of these mark an input
    begin: Any  # (ndim,): of a block the first node on each axis, in `order`
    rest: Any  # (ndim + 1,): how many nodes that axis and those behind it have
    offsets: Any  # (size,): where its nodes are on the grid
    # (2 size,): what is left when the maxima along the axes before axis a are taken begins at values[rest[a]], behind
    # all that is left later
    values: Any
    # (2 + K, L, ndim, 1): with segments the boxes around one point of their sum, and in [2 + k, j, 0] how many points
    # of segment k are looked at; with planes the boxes around one slab, and in [2, j] how many slabs along each axis
    moved: Any
    held: Any  # (2 ndim,): walls


@kernel(**UNCOUNTED)
def _fewest_steps(stored_tubes, first, most, index, weight, count):
    """The fewest n <= most whose interpolated tube, entry first + n, is <= 0, or -1; by bisection: tubes grow."""
    # Asked this way round, so that NaN is in no tube.
    if not (weighted(stored_tubes.tubes, stored_tubes.index[first + most], index, weight, count) <= 0.0):
        return -1
    low, high = 0, most
    while low < high:
        middle = (low + high) // 2
        if weighted(stored_tubes.tubes, stored_tubes.index[first + middle], index, weight, count) <= 0.0:
            high = middle
        else:
            low = middle + 1
    return low


@kernel(**UNCOUNTED)
def _marked_by_all(marks, place, index, count, marked):
    """marked[j] = whether each of `count` nodes around a state marks u_j in marks[place], (bytes, size); in place."""
    for byte in range(marks.shape[1]):
        bits = np.uint8(255)
        for c in range(count):
            # Eight inputs at once.
            bits &= marks[place, byte, index[c]]
        for j in range(8 * byte, min(8 * byte + 8, marked.size)):
            marked[j] = (bits >> np.uint8(j - 8 * byte)) & 1


@kernel(**UNCOUNTED)
def _gather(values, state, column, order, lattice, scratch):
    """Copy values (size,) at the nodes that the box hull[column] around a state touches to scratch.values[rest[0]:].

    The axis order[0] is slowest. Sets begin, rest and offsets as well.
    """
    offsets, rest = scratch.offsets, scratch.rest
    offsets[0], rest[state.size] = 0, 1
    for a in range(state.size - 1, -1, -1):
        axis = order[a]
        nodes = lattice.shape[axis]
        stride = 1
        size = rest[a + 1]
        for later in range(axis + 1, state.size):
            stride *= lattice.extent[later]
        begin, _ = locate(state[axis] + scratch.hull[column, 0, axis], axis, lattice)
        end, _ = locate(state[axis] + scratch.hull[column, 1, axis], axis, lattice)
        scratch.begin[a], rest[a] = begin, (end + 2 - begin) * size
        for i in range(end + 1 - begin, -1, -1):  # the first copy last: all others read it
            shift = periodic_index(begin + i - lattice.first[axis], nodes) * stride
            for c in range(size if a > 0 else 0):
                offsets[i * size + c] = offsets[c] + shift
            for c in range(size if a == 0 else 0):
                scratch.values[rest[0] + i * size + c] = values[offsets[c] + shift]


@kernel(**UNCOUNTED)
def _maximum_along_axis(values, source, nodes, rest, near, far):
    """The maximum of the interpolant over an interval along the leading axis of values[source:], (nodes, rest), flat.

    Written to values[rest:], (rest,). near, far : the weight of the second node at the interval's low end, and of the
    last node at its high end.
    """
    # views, because loops over them vectorise
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
    """How far the segments of input j together lead along an axis to either side: sum of |half|, 0 without any."""
    far = 0.0
    for k in range(PATH, ends.shape[0]):
        far += abs(ends[k, j, axis, column])
    return far


@kernel(**UNCOUNTED)
def is_held(state, ends, column, j, held):
    """Whether input j may lead past a wall: then a state may end outside the sum of its segments, or its planes.

    held (2 ndim,) : lower walls, then upper ones, infinite for none.
    """
    for axis in range(state.size):
        far = _spread(ends, column, j, axis)
        low, high = state[axis] + ends[0, j, axis, column] - far, state[axis] + ends[1, j, axis, column] + far
        if (far > 0.0 or ends.shape[0] == PATH) and (low < held[axis] or high > held[state.size + axis]):
            return True
    return False


@kernel(**UNCOUNTED)
def _count_points(state, ends, column, lattice, scratch):
    """Write to scratch.moved[2:] how many points of each segment of each input are looked at, 0 where its box is taken.

    Returns the most points of one input, no farther apart than half a cell. The box is taken for more than
    `MOST_POINTS`, or where a wall may hold a state.
    """
    most = 1.0
    checks = scratch.moved[2:]
    for j in range(ends.shape[1]):
        points = 1.0
        for k in range(checks.shape[0]):
            cells = 0.0
            for axis in range(state.size):
                cells = max(cells, abs(ends[PATH + k, j, axis, column]) / lattice.spacing[axis])
            checks[k, j, 0, 0] = 1.0 + np.ceil(min(A_CELL * cells, MOST_POINTS))
            points = min(points * checks[k, j, 0, 0], MOST_POINTS + 1.0)
        if points > MOST_POINTS or is_held(state, ends, column, j, scratch.held):
            checks[:, j] = 0.0
            points = 1.0
        most = max(most, points)
    return int(most)


@kernel(**UNCOUNTED)
def _write_boxes_at_point(point, ends, column, scratch):
    """Write to scratch.moved[:2] the boxes of all inputs around point number `point` of the sum of their segments.

    An input with fewer points is looked at again at earlier ones; where its box is taken, around all its segments.
    """
    for j in range(ends.shape[1]):
        for axis in range(ends.shape[2]):
            for side in range(2):
                scratch.moved[side, j, axis, 0] = ends[side, j, axis, column]
        left = point
        for k in range(ends.shape[0] - PATH):
            checks = int(scratch.moved[2 + k, j, 0, 0])
            share, wider = 0.0, 1.0
            if checks > 0:
                share, wider = 2.0 * (left % checks) / max(checks - 1, 1) - (checks > 1), 0.0
                # Points are numbered with the first segment fastest.
                left //= checks
            for axis in range(ends.shape[2]):
                half = ends[PATH + k, j, axis, column]
                scratch.moved[0, j, axis, 0] += share * half - wider * abs(half)
                scratch.moved[1, j, axis, 0] += share * half + wider * abs(half)


@kernel(**UNCOUNTED)
def _count_slabs(state, ends, normals, column, lattice, scratch):
    """Write to scratch.moved[2] into how many slabs what lies between planes is cut along each axis, for each input.

    Returns (last, most): the last axis that a plane is not parallel to, with one slab, and the most slabs of an input.
    """
    most = 1.0
    cuts = scratch.moved[2]
    last = 0
    for k in range(normals.shape[0]):
        for axis in range(state.size):
            last = max(last, axis if normals[k, axis] != 0.0 else 0)
    for j in range(ends.shape[1]):
        slabs = 1.0
        for axis in range(state.size):
            cells = (ends[1, j, axis, column] - ends[0, j, axis, column]) / lattice.spacing[axis]
            cut = False
            for k in range(normals.shape[0]):
                cut |= normals[k, axis] != 0.0 and axis < last
            cuts[j, axis, 0] = max(np.ceil(SLABS_A_CELL * min(cells, MOST_POINTS)), 1.0) if cut else 1.0
            slabs = min(slabs * cuts[j, axis, 0], MOST_POINTS + 1.0)
        if slabs > MOST_POINTS or is_held(state, ends[:PATH], column, j, scratch.held):
            cuts[j] = 0.0
            slabs = 1.0
        most = max(most, slabs)
    return last, int(most)


@kernel(**UNCOUNTED)
def _write_boxes_at_slab(slab, last, ends, normals, column, lattice, moved):
    """Write to moved[:2] the boxes of all inputs around slab number `slab` of what lies between their planes.

    Where nothing lies in the slab, the middle of the box, which is always between the planes.
    """
    for j in range(ends.shape[1]):
        left = slab
        planes = normals.shape[0] if moved[2, j, last, 0] > 0.0 else 0
        empty = False
        for axis in range(ends.shape[2]):
            low, high = ends[0, j, axis, column], ends[1, j, axis, column]
            cuts = max(int(moved[2, j, axis, 0]), 1)
            place = left % cuts
            wide = (high - low) / cuts
            moved[0, j, axis, 0] = low + place * wide
            moved[1, j, axis, 0] = high if place == cuts - 1 else low + (place + 1) * wide
            left //= cuts
        low, high = moved[0, j, last, 0], moved[1, j, last, 0]
        for k in range(planes):
            rest = ends[PATH + k // ends.shape[2], j, k % ends.shape[2], column]
            along = normals[k, last]
            for axis in range(last):
                rest -= normals[k, axis] * moved[0 if normals[k, axis] > 0.0 else 1, j, axis, 0]
            if along > 0.0:
                high = min(high, rest / along)
            elif along < 0.0:
                low = max(low, rest / along)
            else:
                empty |= rest < 0.0
        # by rounding they may be the wrong way round, but not past the box, whose nodes alone were gathered
        moved[0, j, last, 0] = max(min(low, high), ends[0, j, last, column])
        moved[1, j, last, 0] = min(max(low, high), ends[1, j, last, column])
        if empty or low - high > TINY * lattice.spacing[last]:
            for axis in range(ends.shape[2]):
                middle = 0.5 * (ends[0, j, axis, column] + ends[1, j, axis, column])
                moved[0, j, axis, 0], moved[1, j, axis, 0] = middle, middle


@kernel(**UNCOUNTED)
def _worst_values(values, state, ends, column, normals, order, lattice, scratch, out):
    """out[j] = the maximum of the interpolated values (size,) over what input j leads to from a state: its margin.

    That is a box, with points of segments, or slabs between planes; the box around these where a wall may hold a state,
    or there are too many. inf where that may be past an unsafe end, -inf wholly past a safe one. `hull_of` has written
    scratch.hull[column] before: only the nodes that it touches are gathered.
    """
    _gather(values, state, column, order, lattice, scratch)
    # Raised by each of the boxes.
    out[:] = -np.inf
    if normals.shape[0] > 0:
        last, slabs = _count_slabs(state, ends, normals, column, lattice, scratch)
        for slab in range(slabs):  # the type of 0 is 0 itself, and would have a kernel of its own: hence `np.int64`
            _write_boxes_at_slab(slab, last, ends, normals, column, lattice, scratch.moved)
            _raise_to_worst_in_boxes(state, scratch.moved, np.int64(0), order, lattice, scratch, out)
        return
    alone = ends.shape[0] == PATH
    for point in range(1 if alone else _count_points(state, ends, column, lattice, scratch)):
        if not alone:
            _write_boxes_at_point(point, ends, column, scratch)
        boxes, of = (ends, column) if alone else (scratch.moved, np.int64(0))
        _raise_to_worst_in_boxes(state, boxes, of, order, lattice, scratch, out)


@kernel(**UNCOUNTED)
def _raise_to_worst_in_boxes(state, ends, column, order, lattice, scratch, out):
    """Raise out[j] to the maximum, over the box of input j around a state, of the values that `_gather` has copied.

    Axis by axis, as in `sdhj.solver.hopf_lax`, so it errs to the safe side.
    """
    low, high = ends[0, :, :, column], ends[1, :, :, column]
    rest = scratch.rest
    for j in range(out.size):
        # as for the input before
        same = j > 0
        lost, gone = False, False
        for a in range(order.size):
            axis = order[a]
            same = same and low[j, axis] == low[j - 1, axis] and high[j, axis] == high[j - 1, axis]
            lost = lost or state[axis] + low[j, axis] < lattice.least[axis]
            lost = lost or state[axis] + high[j, axis] > lattice.most[axis]
            gone = gone or state[axis] + high[j, axis] < lattice.safe_ends[axis]
            gone = gone or state[axis] + low[j, axis] > lattice.safe_ends[order.size + axis]
            # Inputs mostly differ along few axes; what was made of those before stays in scratch.
            if not same:
                first, near = locate(state[axis] + low[j, axis], axis, lattice)
                last, far = locate(state[axis] + high[j, axis], axis, lattice)
                source = rest[a] + (first - scratch.begin[a]) * rest[a + 1]
                _maximum_along_axis(scratch.values, source, last - first + 2, rest[a + 1], near, far)
        out[j] = np.inf if lost else out[j] if gone else max(out[j], scratch.values[1])


@kernel(**UNCOUNTED)
def _hazard(avoid, step, j, scratch, still, moving):
    """The interpolated avoid tube of input j over the interval from a step: <= 0 where the input is safe.

    still, moving : how many nodes scratch.index and scratch.weight have for the static and the moving one.
    """
    value = weighted(avoid.static, j, scratch.index[0], scratch.weight[0], still)
    place = step * scratch.marked.size + j
    return max(value, weighted(avoid.moving, place, scratch.index[1], scratch.weight[1], moving))


@kernel(**UNCOUNTED)
def _safe_and_best(avoid, step, state, lattice, scratch, margin, safe):
    """Write whether each input is safe to safe (L,), for a state at a step, and return the best input.

    By marks and margins; where none is, by margins and the interpolated avoid tubes. The best is the safe one of least
    margin, else the one whose larger of margin and avoid tube is least, marked ones first.
    """
    best = -1
    for j in range(safe.size):  # the interpolated avoid tube of a marked input is <= 0 too
        safe[j] = scratch.marked[j] and margin[j] <= 0.0
        if safe[j] and (best < 0 or margin[j] < margin[best]):
            best = j
    if best >= 0:
        return best
    still = nodes_around(state, avoid.static_axes, lattice, TINY, scratch.index[0], scratch.weight[0])
    moving = nodes_around(state, avoid.moving_axes, lattice, TINY, scratch.index[1], scratch.weight[1])
    for j in range(safe.size):
        safe[j] = margin[j] <= 0.0 and _hazard(avoid, step, j, scratch, still, moving) <= 0.0
        if safe[j] and (best < 0 or margin[j] < margin[best]):
            best = j
    if best >= 0:
        return best
    best, least = 0, np.inf
    for j in range(safe.size):
        # No input is safe: the one that is hoped to fail least.
        worse = max(margin[j], _hazard(avoid, step, j, scratch, still, moving))
        one, other = scratch.marked[j], scratch.marked[best]
        if one > other or (one == other and worse < least):
            best, least = j, worse
    return best


@kernel(**UNCOUNTED)
def by_tubes(m, states, step, within, stored_tubes, ends, column, normals, order, lattice, scratch, out):
    """Write to entry m of `out` the answers for states[m] by the tubes alone, not by the true sets; within >= 1."""
    to_go, safe, margins, best = out
    state = states[m]
    steps = stored_tubes.steps
    index, weight = scratch.index[2], scratch.weight[2]
    here = step * (steps + 1) - step * (step - 1) // 2  # the place of (step, 0), see `sdhj.table.batches.entry`
    following = here + steps - step + 1  # the place of (step + 1, 0)
    to_go[m], safe[m], margins[m], best[m] = -1, False, np.inf, -1
    if not on_grid(state, lattice):
        return
    count = nodes_around(state, scratch.axes, lattice, TINY, index, weight)
    to_go[m] = _fewest_steps(stored_tubes, here, steps - step, index, weight, count)
    if to_go[m] < 0 or step == steps:
        return
    n = max(to_go[m], within)  # in the target already: inputs that bring the state back into it
    # Just inside its boundary a tube may hold a state and no input be safe, as each is interpolated by itself: with one
    # step more there nearly always is one, and the state then has n + 1 to go. If there is none, all is as for n.
    for more in (0, 1, 0):
        _marked_by_all(stored_tubes.marks, stored_tubes.index[here + n + more], index, count, scratch.marked)
        tube = stored_tubes.tubes[stored_tubes.index[following + n + more - 1]]
        _worst_values(tube, state, ends, column, normals, order, lattice, scratch, margins[m])
        best[m] = _safe_and_best(stored_tubes.avoid, step, state, lattice, scratch, margins[m], safe[m])
        if safe[m, best[m]] or not to_go[m] == n < steps - step:
            to_go[m] += more
            break


@kernel(**UNCOUNTED)
def hull_of(ends, column, spacing, hull):
    """Write to hull (2, ndim) the box that holds those of all inputs, segments included; for planes of `PATH` terms.

    Returns an upper bound on how many nodes it touches, with one more on each axis; spacing (ndim,) : of the nodes.
    """
    size = 1.0
    for axis in range(ends.shape[2]):
        hull[0, axis], hull[1, axis] = np.inf, -np.inf
        for j in range(ends.shape[1]):
            far = _spread(ends, column, j, axis)
            far += TINY * spacing[axis] if far > 0.0 else 0.0  # of another order of sums
            hull[0, axis] = min(hull[0, axis], ends[0, j, axis, column] - far)
            hull[1, axis] = max(hull[1, axis], ends[1, j, axis, column] + far)
        size *= np.ceil((hull[1, axis] - hull[0, axis]) / spacing[axis] + 1e-6) + 2.0
    return int(size)


@kernel(**UNCOUNTED)
def hazards(avoid, step, state, lattice, scratch, out):
    """out[j] = the interpolated avoid tube of u_j at a finite state over an interval, in place; <= 0: safe."""
    still = nodes_around(state, avoid.static_axes, lattice, TINY, scratch.index[0], scratch.weight[0])
    moving = nodes_around(state, avoid.moving_axes, lattice, TINY, scratch.index[1], scratch.weight[1])
    for j in range(out.size):
        # For `next_input`, which chooses among inputs that are not safe, and for `avoid_values`.
        out[j] = _hazard(avoid, step, j, scratch, still, moving)


@kernel(inline="always")  # as its caller counts references, or does not
def unpacked_lattice(ints, floats):
    """The `Lattice` whose arrays are the first nine of those packed in ints and floats: views."""
    # `Grid.arrays` has them in this order, and `tape_of_problem` packs them first
    lower, spacing, shape = part(ints, floats, 0), part(ints, floats, 1), part(ints, ints, 2)
    periodic, least, most = part(ints, ints, 3), part(ints, floats, 4), part(ints, floats, 5)
    left, first, extent = part(ints, floats, 6), part(ints, ints, 7), part(ints, ints, 8)
    return Lattice(lower, spacing, shape, periodic, least, most, left, first, extent)


@kernel()
def working_room(columns, ndim, inputs, size, segments, held):
    """A `LookupScratch` for so many columns of boxes; `held` says past which ends states are held (`Lattice`)."""
    around = (3, 1 << ndim)
    spans = np.empty((2, ndim + 1), np.int64)
    axes = np.empty(ndim, np.int64)
    for axis in range(ndim):
        axes[axis] = axis
    nodes = axes, np.empty(around, np.int64), np.empty(around), np.empty(inputs, np.bool_)
    block = np.empty(size, np.int64), np.empty(2 * size)
    sums = np.empty((2 + segments, inputs, ndim, 1)), held
    return LookupScratch(np.empty((columns, 2, ndim)), *nodes, spans[0], spans[1], *block, *sums)


@kernel(nogil=True)
def avoid_values(states, step, ints, floats, static, moving, out):
    """out[m, j] = the interpolated avoid tube of u_j at states[m] over the interval from a step; out (M, L), in place.

    states (M, ndim) : finite. Beyond an end of the grid, that at the end. static, moving : as in `StoredAvoidTubes`.
    """
    lattice = unpacked_lattice(ints, floats)
    avoid = StoredAvoidTubes(static, part(ints, ints, AT_STATIC), moving, part(ints, ints, AT_MOVING))
    one, none = np.int64(1), np.int64(0)
    scratch = working_room(one, states.shape[1], out.shape[1], none, none, part(ints, floats, AT_FACES))
    for m in range(out.shape[0]):
        hazards(avoid, step, states[m], lattice, scratch, out[m])


@kernel(**UNCOUNTED)
def _interpolated(where, row, tubes, lattice, sides, index, share, weight, found):
    """found[m] = the interpolated tubes[row[m]] at where[m], of at most BLOCK points, in loops that vectorise."""
    # what `nodes_around` and `weighted` do for one point: both count a weight below TINY as rounding
    here, there = sides[0], sides[1]
    count = found.size
    index[0, :count], weight[0, :count] = 0, 1.0
    found[:] = 0.0
    for axis in range(where.shape[1]):
        for m in range(count):
            left, right = locate(where[m, axis], axis, lattice)
            left += right >= 1.0 - TINY
            share[0, m] = right if TINY <= right < 1.0 - TINY else 0.0
            here[m] = periodic_index(left - lattice.first[axis], lattice.shape[axis])
            there[m] = periodic_index(left + 1 - lattice.first[axis], lattice.shape[axis])
        for c in range(1 << axis):
            # A node for each choice of sides: along each axis there are twice as many.
            other = c + (1 << axis)
            for m in range(count):
                start = index[c, m] * lattice.extent[axis]
                whole = weight[c, m]
                index[c, m], index[other, m] = start + here[m], start + there[m]
                weight[c, m], weight[other, m] = whole * (1.0 - share[0, m]), whole * share[0, m]
    for c in range(1 << where.shape[1]):
        for m in range(count):
            found[m] += weight[c, m] * tubes[row[m], index[c, m]] if weight[c, m] > 0.0 else 0.0


@kernel(nogil=True)
def tube_values(points, places, tubes, ints, floats, out):
    """out[m, v] = the interpolated tubes[places[m]] at points[m, v], finite; beyond an end of the grid, at the end.

    points (M, V, ndim), tubes (T, size), out (M, V), in place. ints, floats : in which a lattice is packed.
    """
    _, each, ndim = points.shape
    lattice = unpacked_lattice(ints, floats)
    where, found = points.reshape(-1, ndim), out.reshape(-1)
    row = np.empty(BLOCK, np.int64)
    sides = np.empty((2, BLOCK), np.int64)
    index = np.empty((1 << ndim, BLOCK), np.int64)
    share, weight = np.empty((1, BLOCK)), np.empty((1 << ndim, BLOCK))
    # In blocks, so that scratch is small and points of several states go together.
    for at in range(0, found.size, BLOCK):
        end = min(at + BLOCK, found.size)
        for m in range(end - at):
            row[m] = places[(at + m) // each]
        _interpolated(where[at:end], row, tubes, lattice, sides, index, share, weight, found[at:end])
