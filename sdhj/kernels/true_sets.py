"""The compiled look at the true sets (`notebooks/site/code.md`), in rounds.

The queue holds the states that wait for an answer. For each of them `propose` writes the points at which the sets are
evaluated for the input that comes next; `evaluate` fills in their values; and `judge` undoes what these refute, and
gives the input its verdict, `PASSES` or `FAILS`. A state whose input has failed waits for another one. Where the sets
are formulas, `sdhj.kernels.lookup.decide` plays these and does all rounds in one call; what is a black box, Python
evaluates between them.
"""

from typing import Any, NamedTuple

import numpy as np

from sdhj.kernels.compiling import UNCOUNTED, kernel
from sdhj.kernels.interpolation import into_period
from sdhj.kernels.tape import RESULTS, length, part, play_with_scratch
from sdhj.kernels.tubes import AT_FACES, AT_TARGET, AT_UNDER, AT_UNSAFE, CHECK_TIMES, PATH, is_held, unpacked_lattice

CHECKED_INSTANTS = 4  # instants of an interval at which the path without an adversary is looked at, its end among them
UNKNOWN, PASSES, FAILS = range(3)  # an input, by the true sets
# checks, what `lookup.decide` does: by the tubes, by the true sets too, or by the true sets alone
TUBES, TRUE_SETS_TOO, TRUE_SETS_ONLY = range(3)


class SampledSets(NamedTuple):
    """Arrays for the check of R states by the true sets; made by `samples_for`.

    The `count` points of each state that waits stand one behind the other, in the order of the queue.
    """

    # (3, R): [0], the states that wait, as indices into `rows` of the callers; [1], for each state the best input by
    # the tubes; [2], the steps to go after the interval
    queue: Any
    # (R, L): `UNKNOWN`, `PASSES` or `FAILS`, and the interpolated avoid tube, of each input
    verdicts: Any
    hazard: Any
    points: Any  # (R count, ndim + 1): where the sets are evaluated, the time last
    # (R count,): 1 where nothing matters any longer, behind a safe end; -1 where the path is past an unsafe one
    past: Any
    # (sets, R count), (1, R count): the values of the unsafe sets and, at state and corners, of the target
    unsafe_values: Any
    target_values: Any


@kernel(nogil=True)
def samples_for(states, inputs, count, ndim, sets):
    """New `SampledSets` of R states, `target_values` 0; count: 1, or the path, the state, and 2^ndim corners."""
    queue = np.empty((3, states), np.int64)
    verdicts = np.empty((states, inputs), np.int64)
    size = states * count
    points = np.empty((size, ndim + 1))
    past = np.empty(size, np.int64)
    target_values = np.empty((1, size))
    for i in range(size):
        # Where the target is not asked about, `judge` reads 0: inside.
        target_values[0, i] = 0.0
    return SampledSets(queue, verdicts, np.empty((states, inputs)), points, past, np.empty((sets, size)), target_values)


@kernel(**UNCOUNTED)
def _farthest(ends, column, j, corner, axis, spacing, boxed):
    """How far segments lead along an axis at that point of their sum that is farthest, in cells, towards a corner.

    corner : a bit for each axis, the first one highest; 1 is the upper side. boxed : as if each segment were its box.
    """
    far = 0.0
    for k in range(PATH, ends.shape[0]):
        towards = 0.0
        for other in range(spacing.size):
            side = ((corner >> (spacing.size - 1 - other)) & 1) * 2.0 - 1.0
            towards += side * ends[k, j, other, column] / spacing[other] * (other == axis or not boxed)
        far += ends[k, j, axis, column] * (1.0 if towards >= 0.0 else -1.0)
    return far


@kernel(inline="always")
def _clip_and_wrap(x, axis, lattice, faces):
    """A coordinate x clipped between the faces of its axis, and on a periodic axis moved by turns into the period.

    faces (6 ndim,) : for all axes lower faces, upper faces, lower ends, upper ends, lower walls, upper walls.
    """
    x = min(max(x, faces[axis]), faces[lattice.shape.size + axis])
    if lattice.periodic[axis]:
        x = into_period(x, faces[2 * lattice.shape.size + axis], faces[3 * lattice.shape.size + axis])
    return x


@kernel(**UNCOUNTED)
def _place_corners(at, state, j, ends, column, lattice, faces, points, past):
    """Write the 2^ndim corners of the sum of a box and segments of input j around a state to points[at:], in place.

    And to past[at:] 1 where a corner is behind a safe end, else 0. Segments count as boxes where a wall may hold it.
    """
    # A function of its own, as otherwise all boxes would pay for it in `place_points`.
    ndim = state.size
    boxed = is_held(state, ends, column, j, faces[4 * ndim :])
    for corner in range(1 << ndim):
        out = False
        for axis in range(ndim):
            x = state[axis] + ends[(corner >> (ndim - 1 - axis)) & 1, j, axis, column]
            x += _farthest(ends, column, j, corner, axis, lattice.spacing, boxed)
            out |= (x < lattice.safe_ends[axis]) | (x > lattice.safe_ends[ndim + axis])
            points[at + corner, axis] = _clip_and_wrap(x, axis, lattice, faces)
        past[at + corner] = 1 if out else 0


@kernel(**UNCOUNTED)
def _place_cut_corners(at, state, j, ends, column, normals, lattice, faces, points, past):
    """Write where planes first cut the lines from the middle of input j's box to its corners to points[at:], in place.

    2^ndim points; the corner itself where no plane cuts its line, or a wall may hold a state.
    """
    ndim = state.size
    planes = 0 if is_held(state, ends[:PATH], column, j, faces[4 * ndim :]) else normals.shape[0]
    for corner in range(1 << ndim):
        share = 1.0
        out = False
        for k in range(planes):
            room = ends[PATH + k // ndim, j, k % ndim, column]
            towards = 0.0
            for axis in range(ndim):
                low, high = ends[0, j, axis, column], ends[1, j, axis, column]
                side = ((corner >> (ndim - 1 - axis)) & 1) * 2.0 - 1.0
                room -= normals[k, axis] * 0.5 * (low + high)
                towards += normals[k, axis] * 0.5 * (high - low) * side
            # Up to the first plane on the way; a line that leads away from a plane never meets it.
            share = min(share, max(room, 0.0) / towards) if towards > 0.0 else share
        for axis in range(ndim):
            low, high = ends[0, j, axis, column], ends[1, j, axis, column]
            side = ((corner >> (ndim - 1 - axis)) & 1) * 2.0 - 1.0
            x = state[axis] + 0.5 * (low + high) + share * side * 0.5 * (high - low)
            out |= (x < lattice.safe_ends[axis]) | (x > lattice.safe_ends[ndim + axis])
            points[at + corner, axis] = _clip_and_wrap(x, axis, lattice, faces)
        past[at + corner] = 1 if out else 0


@kernel(**UNCOUNTED)
def place_points(at, state, j, ends, column, normals, lattice, times, faces, points, past):
    """Write the points at which the true sets are evaluated for input j from a state, and times, to points[at:].

    The path without an adversary, the state, and the corners of what the input leads to; with one time the state alone.
    past[at:] is 1 from a safe end on, -1 where the path is past an unsafe one.
    """
    # `times` has the order of the points, as `tape_of_problem` makes it, and `judge` and `evaluate` count on it
    ndim = state.size
    last = CHECKED_INSTANTS if times.size > 1 else 0
    gone = False
    for i in range(times.size):  # the state, the path, the corners
        sample = at + (last if i == 0 else i - 1 if i <= last else i)
        share = i / CHECKED_INSTANTS
        out = lost = False
        for axis in range(ndim):
            x = state[axis]
            if i > last:
                x += ends[((i - last - 1) >> (ndim - 1 - axis)) & 1, j, axis, column]
            elif i > 0:
                x += share * ends[2, j, axis, column]
                x += share * share * ends[3, j, axis, column]
                lost |= (x < lattice.least[axis]) | (x > lattice.most[axis])
            out |= (x < lattice.safe_ends[axis]) | (x > lattice.safe_ends[ndim + axis])
            points[sample, axis] = _clip_and_wrap(x, axis, lattice, faces)
        gone |= out & (i <= last)
        past[sample] = 1 if out | (gone & (i <= last)) else -1 if lost else 0
        points[sample, ndim] = times[sample - at]
    if normals.shape[0] > 0:
        if times.size > 1:
            _place_cut_corners(at + last + 1, state, j, ends, column, normals, lattice, faces, points, past)
        return
    if ends.shape[0] > PATH and times.size > 1:
        _place_corners(at + last + 1, state, j, ends, column, lattice, faces, points, past)


@kernel(**UNCOUNTED)
def next_input(known, safe, scores, margins, hazard, first):
    """The number of the input to look at next; if it has a verdict already, it is the answer.

    The safe input of least score that has not failed; else `first`, the best by the tubes; else that of the least of
    the larger of margin and hazard.
    """
    best, least = -1, np.inf
    for j in range(safe.size):
        if safe[j] and known[j] != FAILS:
            better = best < 0 or scores[j] < scores[best]
            if better or (scores[j] == scores[best] and margins[j] < margins[best]):
                best = j
    if best >= 0 or known[first] != FAILS:
        return best if best >= 0 else first
    for j in range(safe.size):
        worse = max(margins[j], hazard[j])
        if known[j] != FAILS and worse < least:
            best, least = j, worse
    return best if best >= 0 else first


@kernel(nogil=True, **UNCOUNTED)
def propose(waiting, within, states, rows, ints, floats, leads, out, samples):
    """Write for each state that waits the input to look at next to `best`, and its points to `samples`, in place.

    Returns how many states still wait, first in the queue then. waiting : -1 at first: all whose to_go is at least 0.
    """
    to_go, safe, margins, best = out
    queue, verdicts, hazard, points, past, _, _ = samples
    ends, scores, normals = leads
    lattice = unpacked_lattice(ints, floats)
    some = 0
    times = part(ints, floats, CHECK_TIMES)
    faces = part(ints, floats, AT_FACES)
    if waiting < 0:
        for r in range(rows.size):
            if to_go[rows[r]] >= 0:
                queue[0, some], queue[1, r], queue[2, r] = r, best[rows[r]], max(to_go[rows[r]], within) - 1
                # without times nothing is to be looked at
                verdicts[r] = UNKNOWN if times.size else PASSES
                hazard[r] = np.inf
                some += 1
        waiting, some = some, 0
    for k in range(waiting):
        r, m = queue[0, k], rows[queue[0, k]]
        j = next_input(verdicts[r], safe[m], scores[m], margins[m], hazard[r], queue[1, r])
        best[m] = j
        queue[1, r] = j if queue[1, r] < 0 else queue[1, r]
        if verdicts[r, j] == UNKNOWN:
            at = some * times.size
            column = r if ends.shape[3] > 1 else 0
            place_points(at, states[m], j, ends, column, normals, lattice, times, faces, points, past)
            # In the place of one that has been read: at most as many wait as did.
            queue[0, some] = r
            some += 1
    return some


@kernel(nogil=True, **UNCOUNTED)
def heed_inputs(waiting, rows, count, under, best, samples):
    """Undo in `samples`, in place, what sets that are unsafe under some inputs say of other inputs and of states.

    The input fails, the state is not lost. under (sets * L,) : for each set and input 1 or 0, or -1 where unsafe under
    all.
    """
    queue, verdicts, past, unsafe_values = samples.queue, samples.verdicts, samples.past, samples.unsafe_values
    last = CHECKED_INSTANTS if count > 1 else 0
    inputs = verdicts.shape[1]
    for p in range(under.size // inputs):
        for k in range(waiting if under[p * inputs] >= 0 else 0):
            first, at = k * count, k * count + last
            if under[p * inputs + best[rows[queue[0, k]]]] == 0:
                for v in range(first, first + count):
                    unsafe_values[p, v] = np.inf
            elif count > 1 and unsafe_values[p, at] <= 0.0 and past[at] == 0:
                unsafe_values[p, first] = unsafe_values[p, at]
                past[first] = min(past[first], 0)
            unsafe_values[p, at] = np.inf


@kernel(nogil=True, **UNCOUNTED)
def judge(waiting, rows, checks, count, out, samples):
    """Undo in `out` what the values in `samples` refute of the first `waiting` states in the queue; note verdicts.

    The input best[m] fails if a point but the state itself is past an unsafe end or in an unsafe set or, at the last, a
    corner is not in the target. A state in an unsafe set is lost: to_go is -1.

    Returns how many wait for another input, first in the queue then.
    """
    to_go, safe, margins, best = out
    queue, verdicts, _, _, past, unsafe_values, target_values = samples
    last = CHECKED_INSTANTS if count > 1 else 0
    some = 0
    for k in range(waiting):
        r, m = queue[0, k], rows[queue[0, k]]
        at = k * count + last
        j = best[m]
        lost, passes = False, True
        for v in range(k * count, (k + 1) * count):
            fine = past[v] >= 0
            for p in range(unsafe_values.shape[0]):
                fine &= unsafe_values[p, v] > 0.0
            if v > at and queue[2, r] == 0:
                fine &= target_values[0, v] <= 0.0
            # what is behind a safe end is fine
            fine |= past[v] > 0
            # At the state itself it is lost; anywhere else the input fails.
            lost, passes = lost | ((v == at) & (not fine)), passes & (fine | (v == at))
        if to_go[m] == 0 and target_values[0, at] > 0.0:
            # it had no steps to go and needs one; with one point there is no interval left
            to_go[m] = 1
            lost = lost | (count == 1)
        verdicts[r, j] = PASSES if passes else FAILS
        if lost:
            to_go[m] = -1
        # by `TRUE_SETS_ONLY` these are the caller's: `fallbacks` wants the best input of a lost state, too
        if lost and checks != TRUE_SETS_ONLY:
            safe[m], margins[m], best[m] = False, np.inf, -1
        elif not passes:
            safe[m, j] = False
            queue[0, some] = r
            some += 1
    return some


@kernel(**UNCOUNTED)
def evaluate(waiting, rows, ints, floats, times, out, samples, work):
    """Play the unsafe sets, and the target where it matters, at the points of the first `waiting` states in the queue.

    Writes `unsafe_values` and `target_values`, with what `heed_inputs` undoes; returns whether all are finite.
    """
    # The type of a constant is the constant, and all that is played would be compiled for it anew: hence `np.int64`.
    queue, points, target_values = samples.queue, samples.points, samples.target_values
    none = np.int64(0)
    unsafe, target = np.int64(AT_UNSAFE), np.int64(AT_TARGET)
    end = waiting * times.size
    count = times.size
    last = CHECKED_INSTANTS if times.size > 1 else 0
    # `times` stands where parameters would: these tapes have none, as t is a coordinate of the points (`_timed`)
    if play_with_scratch(ints, floats, unsafe, points, times, samples.unsafe_values, none, end, work) != 0.0:
        return False
    heed_inputs(waiting, rows, count, part(ints, ints, AT_UNDER), out.best, samples)
    for k in range(waiting if length(ints, np.int64(AT_TARGET + RESULTS)) > 0 else 0):
        # Of a state with no steps to go the target is asked about as well: it may not be there.
        start = k * count + last + (out.to_go[rows[queue[0, k]]] != 0)
        stop = (k + 1) * count if queue[2, queue[0, k]] == 0 else k * count + last + 1
        if start >= stop:
            continue
        if play_with_scratch(ints, floats, target, points, times, target_values, start, stop, work) != 0.0:
            return False
    return True
