"""Compiled look-ups behind the controller: by the tubes of a table (`tubes`), then by the true sets (`true_sets`).

Serial and without Python's lock (`nogil`): a query may run in a thread beside a solve, and a batch is shared out over
threads.
"""

from typing import Any, NamedTuple

import numpy as np

from sdhj.kernels.compiling import UNCOUNTED, kernel
from sdhj.kernels.tape import BLOCK, RESULTS, length, part, play_with_scratch, slots_of, work_for
from sdhj.kernels.true_sets import TRUE_SETS_ONLY, TRUE_SETS_TOO, TUBES, evaluate, judge, propose, samples_for
from sdhj.kernels.tubes import (
    AT_AHEAD,
    AT_BEGIN,
    AT_FACES,
    AT_MOVING,
    AT_ORDER,
    AT_STATIC,
    AT_TARGET,
    AT_UNSAFE,
    CHECK_TIMES,
    PATH,
    Answers,
    Leads,
    LookupScratch,
    StoredAvoidTubes,
    StoredTubes,
    by_tubes,
    hazards,
    hull_of,
    unpacked_lattice,
    working_room,
)


@kernel(**UNCOUNTED)
def _check_true_sets(rows, states, step, within, checks, ints, floats, leads, stored_tubes, lattice, room, out):
    """Look at the true sets for some states, and undo in `out` what they refute; False where one is undefined.

    `sdhj.table.ahead.choose_by_true_sets` does the same where a set is a black box: both change together.
    """
    samples = room.samples
    times = part(ints, floats, CHECK_TIMES)
    waiting = propose(np.int64(-1), within, states, rows, ints, floats, leads, out, samples)
    while waiting > 0:
        if not evaluate(waiting, rows, ints, floats, times, out, samples, room.work):
            return False
        waiting = judge(waiting, rows, checks, times.size, out, samples)
        # avoid tubes, for a state of which no input is safe any longer
        for k in range(waiting if checks == TRUE_SETS_TOO else 0):
            r = samples.queue[0, k]
            some = False
            for j in range(out.safe.shape[1]):
                some |= out.safe[rows[r], j]
            if not some:
                hazards(stored_tubes.avoid, step, states[rows[r]], lattice, room.scratch, samples.hazard[r])
        waiting = propose(waiting, within, states, rows, ints, floats, leads, out, samples)
    return True


@kernel(**UNCOUNTED)
def _write_displacement_sets(begin, rows, states, ints, floats, ends, near, boxes, at, hulls, work):
    """Write what inputs lead to from states to `near` (4 + K, L, ndim, R), and hulls of their boxes to `hulls`.

    By the tape for it, whose rows have the order of `near`, or from the columns of `ends` from `begin` on. boxes : the
    first terms of `near`, of which hulls are made.
    Returns how many nodes a hull may touch at most, -1 where formulas are undefined. at (R, ndim) : overwritten.
    """
    ndim = states.shape[1]
    most = 0
    played = length(ints, np.int64(AT_AHEAD + RESULTS))
    if played > 0:
        for r in range(rows.size):
            for axis in range(ndim):
                at[r, axis] = states[rows[r], axis]
        ahead = np.int64(AT_AHEAD)
        begins = part(ints, floats, AT_BEGIN)
        lead = near.reshape(played, near.shape[3])
        if play_with_scratch(ints, floats, ahead, at, begins, lead, np.int64(0), rows.size, work) != 0.0:
            return -1
    elif ends.shape[3] > 1:
        for term in range(near.shape[0]):
            for j in range(near.shape[1]):
                for axis in range(ndim):
                    for r in range(rows.size):
                        near[term, j, axis, r] = ends[term, j, axis, begin + r]
    if played > 0 or ends.shape[3] > 1 or begin == 0:  # else one for all states; on six axes a block may be one state
        for r in range(min(rows.size, near.shape[3])):
            most = max(most, hull_of(boxes, r, part(ints, floats, 1), hulls[r]))
    return most


class Room(NamedTuple):
    """What look-ups overwrite: of `working_room`, `samples_for` and `work_for`."""

    scratch: Any
    samples: Any
    work: Any


@kernel(**UNCOUNTED)
def _answer(rows, states, step, within, checks, ints, floats, stored_tubes, leads, room, out):
    """Write to `out` the answers for the states with numbers `rows`; False where formulas are undefined.

    Column r of leads.ends is that of states[rows[r]].
    """
    lattice = unpacked_lattice(ints, floats)
    order = part(ints, ints, AT_ORDER)
    ends, normals = leads.ends, leads.normals
    scratch = room.scratch
    for r in range(rows.size if checks != TRUE_SETS_ONLY else 0):
        column = r if ends.shape[3] > 1 else 0
        by_tubes(rows[r], states, step, within, stored_tubes, ends, column, normals, order, lattice, scratch, out)
    return checks == TUBES or _check_true_sets(
        rows, states, step, within, checks, ints, floats, leads, stored_tubes, lattice, room, out
    )


@kernel(nogil=True)
def decide(
    states, rows, step, within, checks, ints, floats, steps, index, tubes, marks, static, moving,
    ends, scores, normals, to_go, safe, margins, best,
):  # fmt: skip
    """Steps to go, the safe inputs and their margins, for some of the states (M, ndim) at one step (Algorithm 2).

    Returns whether all formulas had values; else what is written is worthless.

    rows (R,) : which states, neighbours one after the other. step, within : k; and inputs are judged by the tube of the
    fewest steps to go, but of `within`, at least 1, if more. checks : `TUBES`, `TRUE_SETS_TOO`, or `TRUE_SETS_ONLY`,
    which begins with what is in to_go, safe, margins and best. ints, floats : what is `packed` of the problem at this
    step (`sdhj.kernels.tubes`). If it has a tape for what inputs
        lead to, that is played, and `ends` not read.
    steps, index, tubes, marks : as in `StoredTubes`; static, moving : as in `StoredAvoidTubes`.
    ends, scores, normals : as in `Leads`.
    to_go, safe, margins, best : `Answers`, written in place for the given rows.
    """
    inputs, ndim = safe.shape[1], states.shape[1]
    slots = 1
    out = Answers(to_go, safe, margins, best)
    count = length(ints, np.int64(CHECK_TIMES))
    sets = length(ints, np.int64(AT_UNSAFE + RESULTS))
    width = max(1, min(BLOCK // max(count, 1), rows.size))  # states at a time
    size = np.int64(64)  # nodes of a block; 64 itself would be a type of its own
    played = length(ints, np.int64(AT_AHEAD + RESULTS))
    faces = part(ints, floats, AT_FACES)
    avoid = StoredAvoidTubes(static, part(ints, ints, AT_STATIC), moving, part(ints, ints, AT_MOVING))
    stored_tubes = StoredTubes(steps, index, tubes, marks, avoid)
    terms = played // (inputs * ndim) if played > 0 else ends.shape[0]
    alike = played == 0 and ends.shape[3] == 1
    near = ends if alike else np.empty((terms, inputs, ndim, width))
    at = np.empty((width, ndim))
    scratch = working_room(near.shape[3], ndim, inputs, size, terms - PATH, faces[4 * ndim :])
    boxes = near[: PATH if normals.shape[0] > 0 else terms]
    samples = samples_for(width if checks != TUBES else 0, inputs, count, ndim, sets)
    for first in (AT_AHEAD, AT_UNSAFE, AT_TARGET):
        slots = max(slots, slots_of(ints, np.int64(first)))
    work = work_for(slots, min(BLOCK, width * max(count, 1)))
    for begin in range(0, rows.size, width):
        some = rows[begin : begin + width]
        hulls = scratch.hull
        needed = _write_displacement_sets(begin, some, states, ints, floats, ends, near, boxes, at, hulls, work)
        if needed > size:
            size = 2 * needed
            block = (np.empty(2 * needed, np.int64), np.empty(4 * needed))
            # by place: fields 7 and 8 are `offsets` and `values`, which alone hang on the size
            scratch = LookupScratch(*scratch[:7], *block, *scratch[9:])  # type: ignore[call-arg]
        led = Leads(near, scores, normals)
        room = Room(scratch, samples, work)
        if needed < 0:
            return False
        if not _answer(some, states, step, within, checks, ints, floats, stored_tubes, led, room, out):
            return False
    return True
