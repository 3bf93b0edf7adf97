"""Compiled look-ups behind the controller: by the tubes of a table (`tubes`), then by the true sets (`true_sets`).

Serial and without Python's lock (`nogil`): a query may run in a thread beside a solve, and a batch is shared out over
threads.
"""

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
    LookupScratch,
    StoredTubes,
    by_tubes,
    hazards,
    hull_of,
    unpacked_lattice,
    working_room,
)


@kernel(**UNCOUNTED)
def _check_true_sets(rows, when, states, packs, reach_and_scores, table, space, out):
    """Do the look at the true sets for some states, and undo in `out` what they refute; False where one is undefined.

    The sets are played as tapes. With `TRUE_SETS_TOO`, avoid tubes are looked up for a state of which no input is safe
    any longer.

    rows : the numbers of the states at hand in states (M, ndim). when, packs, reach_and_scores, out : the arguments of
        `decide`.
    table : (stored_tubes, lattice), a `StoredTubes` and the grid's `Lattice`.
    space : (scratch, samples, work), overwritten, of `working_room`, `samples_for` and `work_for`.
    """
    (step, within, _, checks), (ints, floats), (stored_tubes, lattice) = when, packs, table
    scratch, samples, work = space
    times = part(ints, floats, CHECK_TIMES)
    waiting = propose(np.int64(-1), within, states, rows, packs, reach_and_scores, out, samples)
    while waiting > 0:
        if not evaluate(waiting, rows, packs, times, out, samples, work):
            return False
        waiting = judge(waiting, rows, checks, times.size, out, samples)
        for k in range(waiting if checks == TRUE_SETS_TOO else 0):
            r, some = samples[0][0, k], False
            for j in range(out[1].shape[1]):
                some |= out[1][rows[r], j]
            if not some:
                hazards(stored_tubes, step, states[rows[r]], lattice, scratch, samples[2][r])
        waiting = propose(waiting, within, states, rows, packs, reach_and_scores, out, samples)
    return True


@kernel(**UNCOUNTED)
def _write_displacement_sets(begin, rows, states, packs, ends, found, work):
    """Write what inputs lead to from the states rows[begin:], and the hulls of their boxes, to `found`.

    By the tape for it, or from `ends`. Returns how many nodes a hull may touch at most, -1 where formulas are
    undefined.

    rows : the numbers of the states at hand. begin : how many were done before, the column of the first in `ends`.
    packs, ends : of `decide`, (ints, floats) and reach_and_scores[0].
    found : (near, boxes, at, hulls): near (4 + K, L, ndim, R), what inputs lead to, which may be `ends` if these are
        one for all; boxes, the leading terms of it that make hulls; at (R, ndim), scratch; hulls (R, 2, ndim).
    work : of `work_for`, overwritten.
    """
    (ints, floats), (near, boxes, at, hulls), ndim, most = packs, found, states.shape[1], 0
    played = length(ints, np.int64(AT_AHEAD + RESULTS))
    if played > 0:
        for r in range(rows.size):
            for axis in range(ndim):
                at[r, axis] = states[rows[r], axis]
        tape, lead = (ints, floats, np.int64(AT_AHEAD)), near.reshape(played, near.shape[3])
        if play_with_scratch(tape, at, part(ints, floats, AT_BEGIN), lead, np.int64(0), rows.size, work) != 0.0:
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


@kernel(**UNCOUNTED)
def _answer(rows, states, when, packs, stored, reach_and_scores, space, out):
    """Write to `out` the answers for the states with numbers `rows`; returns False where formulas are undefined.

    when, packs, stored, reach_and_scores, out : the arguments of `decide`; column r of reach_and_scores[0] is that of
        states[rows[r]].
    space : (scratch, samples, work), overwritten, of `working_room`, `samples_for` and `work_for`.
    """
    (step, within, steps, checks), (ints, floats), (index, tubes, marks, static, moving) = when, packs, stored
    lattice, order = unpacked_lattice(ints, floats), part(ints, ints, AT_ORDER)
    still, timed = part(ints, ints, AT_STATIC), part(ints, ints, AT_MOVING)
    stored_tubes = StoredTubes(steps, index, tubes, marks, static, still, moving, timed)
    for r in range(rows.size if checks != TRUE_SETS_ONLY else 0):
        box, room = (reach_and_scores[0], r if reach_and_scores[0].shape[3] > 1 else 0), (order, lattice, space[0])
        by_tubes(rows[r], states, (step, within), stored_tubes, box, reach_and_scores[2], room, out)
    return checks == TUBES or _check_true_sets(
        rows, when, states, packs, reach_and_scores, (stored_tubes, lattice), space, out
    )


@kernel(nogil=True)
def decide(states, rows, when, packs, stored, reach_and_scores, out):
    """Steps to go, the safe inputs and their margins, for some of the states (M, ndim) at one step (Algorithm 2).

    Parameters
    ----------

    rows : (R,) int64
        Which states, in the order in which they are looked up: neighbours share what the cache holds.
    when : (step, within, steps, checks)
        step: k. within: inputs are judged by the tube of the fewest steps to go, but by that of `within` steps, at
        least 1, where this is more. steps: N. checks: `TUBES`, the tubes alone; `TRUE_SETS_TOO`, then the look at the
        true sets; or `TRUE_SETS_ONLY`, that look alone, which begins with what is in `out`.
    packs : (ints, floats)
        What is `packed` of the problem at this step (`sdhj.kernels.tubes` says what).
    stored : (index, tubes, marks, static, moving)
        As in `StoredTubes`.
    reach_and_scores : (ends (4 + K, L, ndim, 1 or R), scores (M, L), normals (K', ndim) or None)
        ends: what each input can lead to, relative to the state: the lower and the upper corner of a box that, with K
        segments, holds all states at the interval's end; two terms of the path without an adversary, which after a
        share s of the interval is s ends[2] + s^2 ends[3] away; and half of each segment. Where packs has a tape for
        these, it is played, and `ends` is not read. scores: which safe input is preferred: that of least
        score, of equals that of least margin. normals: those of the planes that states end between, where states are in
        no sum of a box and segments; behind the path `ends` then has the greatest n . x for each normal n, `ndim` of
        these in a term.
    out : (to_go (M,), safe (M, L), margins (M, L), best (M,))
        Written in place for the given rows. to_go is -1 where no tube holds the state; safe is False, margins inf
        and best -1 there and at the last step.

    Returns
    -------
    bool
        Whether all formulas have values wherever they were evaluated; else what is in `out` is worthless.
    """
    (ends, scores, normals), ints, inputs, ndim, slots = reach_and_scores, packs[0], out[1].shape[1], states.shape[1], 1
    count, sets = length(ints, np.int64(CHECK_TIMES)), length(ints, np.int64(AT_UNSAFE + RESULTS))
    width, size = max(1, min(BLOCK // max(count, 1), rows.size)), 64  # states at a time, nodes of a block
    played, faces = length(ints, np.int64(AT_AHEAD + RESULTS)), part(ints, packs[1], AT_FACES)
    terms = played // (inputs * ndim) if played > 0 else ends.shape[0]
    alike = played == 0 and ends.shape[3] == 1
    near, at = ends if alike else np.empty((terms, inputs, ndim, width)), np.empty((width, ndim))
    scratch = working_room(near.shape[3], ndim, inputs, size, terms - PATH, faces[4 * ndim :])
    boxes = near[: terms if normals is None else PATH]
    samples = samples_for(width if when[3] != TUBES else 0, inputs, count, ndim, sets)
    for first in (AT_AHEAD, AT_UNSAFE, AT_TARGET):
        slots = max(slots, slots_of(ints, np.int64(first)))
    work = work_for(slots, min(BLOCK, width * max(count, 1)))
    for begin in range(0, rows.size, width):
        some = rows[begin : begin + width]
        needed = _write_displacement_sets(begin, some, states, packs, ends, (near, boxes, at, scratch.hull), work)
        if needed > size:
            size, block = 2 * needed, (np.empty(2 * needed, np.int64), np.empty(4 * needed))
            scratch = LookupScratch(*scratch[:7], *block, *scratch[9:])  # type: ignore[call-arg]
        space, leads = (scratch, samples, work), (near, scores, normals)
        if needed < 0 or not _answer(some, states, when, packs, stored, leads, space, out):
            return False
    return True
