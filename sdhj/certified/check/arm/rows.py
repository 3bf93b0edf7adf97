"""All claims of the rows of a file: many of the agent's cells at once where that does, else one by one."""

from typing import NamedTuple

import numpy as np

from sdhj.certified.check.arm.bits import NONE, ONE, Array, any_bit, compiled, drop, has
from sdhj.certified.check.arm.separation import BOUNDS, STACK, Bench, clear, sweep, tip_inside


class Stored(NamedTuple):
    """The sets of the file, as compiled code reads them."""

    pairs: Array  # (entries, 2): start and within, in the order of the index
    places: Array  # (entries, rows): which block of the pool
    pool: Array  # (blocks, words)
    eroded: Array  # (blocks, words): the cells whose agent ends within the block, whatever it does
    allowed: Array  # (steps, L, n1, n2) bool
    ends1: Array  # (L, n1, most) the cells of the first joint that a cell may end in, the last one repeated
    ends2: Array


@compiled()
def agent_cell(bit, duration, world, part):
    """Write the bounds of the agent's cell number `bit`, and times from 0 to `duration`, s, to `part` (14,), in place.

    `separation` says what a part is.
    """
    ny = world.y.size - 1
    part[4:6], part[6:8] = world.x[bit // ny : bit // ny + 2], world.y[bit % ny : bit % ny + 2]
    part[8], part[9] = 0.0, duration


@compiled()
def drop_unproved(velocity, duration, world, bench, bits):
    """Drop from bits (words,), in place, the agent's cells from which it is not proved that the arm stays clear.

    Clear of the agent, for `duration`, s, under a velocity (2,) of the joints; cells are asked about one by one.
    """
    # The agent is the body behind all disks.
    agent = (len(world.disks), len(world.disks) + 1)
    for bit in range(64 * bits.size):
        if has(bits, bit):
            agent_cell(bit, duration, world, bench.part)
            if not clear(agent, bench.part, velocity, 0.0, world, bench.stack):
                drop(bits, bit, bit + 1)


# ---- a row and all of its claims


@compiled()
def bench_of(i1, i2, world):
    """A new `Bench` for the row of joint cells i1, i2; their bounds and those of pushes are in its `part`."""
    nx = world.x.size - 1
    part = np.zeros(BOUNDS)
    part[0:2], part[2:4] = world.q1[i1 : i1 + 2], world.q2[i2 : i2 + 2]
    part[10], part[11], part[12], part[13] = -world.push, world.push, -world.push, world.push
    return Bench(part, np.empty(nx), np.empty(nx), np.empty((STACK, BOUNDS)))


@compiled()
def check_flags(i1, i2, world, stored):
    """Check the flags of joint cells i1, i2: that the arm clears all obstacles from a start, under an input.

    Returns how many are not proved, and one of these as start * L + j.
    """
    bench = bench_of(i1, i2, world)
    failed, example = 0, 0
    # For as long as the input is held; the begin of the part stays 0.
    bench.part[9] = world.held
    for start in range(len(stored.allowed)):
        for j in range(len(world.inputs)):
            if stored.allowed[start, j, i1, i2]:
                t = start * world.delta + world.begin
                if not clear((0, len(world.disks)), bench.part, world.inputs[j], t, world, bench.stack):
                    failed, example = failed + 1, start * len(world.inputs) + j
    return failed, example


@compiled()
def check_goals(world, stored, bench, todo):
    """Drop from todo (entries, words), in place, what is proved of S_k^0: in the target, and clear of all else at t_k.

    todo : for each entry of the index the agent's cells, as bits, that are to be proved in that row.
    """
    need = np.zeros_like(todo[0])
    still = world.inputs[0]
    for place in range(len(todo)):
        if stored.pairs[place, 1] == 0:
            # Of all goals at once, as where the agent is does not depend on the time.
            need |= todo[place]
    if not any_bit(need):
        return
    if world.chased:
        near = need.copy()
        sweep(0, 0.0, world, bench, near)
        need &= ~near
        drop_unproved(still, 0.0, world, bench, need)
        need |= near
    else:
        for bit in range(64 * need.size):
            if has(need, bit):
                agent_cell(bit, 0.0, world, bench.part)
                if not tip_inside(bench.part, 0.0, world, bench.stack):
                    drop(need, bit, bit + 1)
    for place in range(len(todo)):
        if stored.pairs[place, 1] == 0 and any_bit(todo[place]):
            # `sweep` and `agent_cell` with no duration leave the times of the part at 0, so that this is asked at t
            t = stored.pairs[place, 0] * world.delta + world.begin
            if clear((0, len(world.disks)), bench.part, still, t, world, bench.stack):
                if not world.chased or tip_inside(bench.part, t, world, bench.stack):
                    todo[place] &= ~need


@compiled()
def reaching(ends1, ends2, blocks, n2, eroded, bits):
    """Drop from bits (words,), in place, the agent's cells from which something that can be reached is not in a set.

    bits : uint64. ends1, ends2 (most,) : the joints' cells that may be reached, the last one repeated.
    blocks (rows,), eroded (blocks, words) : the set's blocks, by number, and each block eroded for all that the agent
        may do.
    """
    for a in range(ends1.size):
        for b in range(ends2.size):
            # Rows that come twice in a list are asked about once.
            if (a > 0 and ends1[a] == ends1[a - 1]) or (b > 0 and ends2[b] == ends2[b - 1]):
                continue
            bits &= eroded[blocks[ends1[a] * n2 + ends2[b]]]
        if not any_bit(bits):
            return


@compiled()
def check_steps(i1, i2, world, stored, bench, todo):
    """Drop from todo (entries, words), in place, what is proved of S_k^n: a clear input leads into S_{k+1}^{n-1}.

    The flags that say which inputs clear the obstacles are believed here (`check_flags`).

    todo : for each entry of the index the agent's cells, as bits, that are to be proved in the row.
    """
    steps, n2 = len(stored.allowed), world.q2.size - 1
    able, need = np.zeros_like(todo), np.empty_like(todo[0])
    for careful in range(2):  # first many cells at once, then what is left one by one
        for j in range(len(world.inputs)):
            able[:] = NONE
            need[:] = NONE
            for place in range(len(todo)):
                start, within = stored.pairs[place, 0], stored.pairs[place, 1]
                if within > 0 and stored.allowed[start, j, i1, i2] and any_bit(todo[place]):
                    able[place] = todo[place]
                    after = stored.places[place + steps - start]  # S_{k+1}^{n-1}
                    reaching(stored.ends1[j, i1], stored.ends2[j, i2], after, n2, stored.eroded, able[place])
                    need |= able[place]
            if not any_bit(need):
                continue
            if world.chased and careful:
                drop_unproved(world.inputs[j], world.held, world, bench, need)
            elif world.chased:
                sweep(j, world.held, world, bench, need)
            for place in range(len(todo)):
                todo[place] &= ~(able[place] & need)


@compiled()
def unproved(i1, i2, world, stored):
    """The agent's cells that sets add in the row of joint cells i1, i2 and that are not proved: (entries, words)."""
    bench = bench_of(i1, i2, world)
    row = i1 * (world.q2.size - 1) + i2
    todo = np.empty((stored.places.shape[0], stored.pool.shape[1]), np.uint64)
    for place in range(len(todo)):
        todo[place] = stored.pool[stored.places[place, row]]
        if stored.pairs[place, 1] > 0:
            # Only what a step more adds: the rest has been proved with fewer.
            todo[place] &= ~stored.pool[stored.places[place - 1, row]]
    check_goals(world, stored, bench, todo)
    check_steps(i1, i2, world, stored, bench, todo)
    return todo


@compiled(nogil=True)
def check_rows(rows, world, stored, failed, example):
    """Check all claims of rows (R,), numbers of pairs of joint cells; threads may share the rows out.

    failed, example (R, kinds), modified in place : how many claims of each kind are not proved, and one of these as a
        number. Kind 0 are the flags, numbered start * L + j; kind 1 + n are the cells that sets within n steps add,
        numbered start * (the agent's cells) + cell.
    """
    # `Arm.claims` gives names to kinds and examples by these numbers
    n2, cells = world.q2.size - 1, (world.x.size - 1) * (world.y.size - 1)
    for number in range(len(rows)):
        i1, i2 = rows[number] // n2, rows[number] % n2
        failed[number, 0], example[number, 0] = check_flags(i1, i2, world, stored)
        left = unproved(i1, i2, world, stored)
        for place in range(len(left)):
            for bit in range(cells if any_bit(left[place]) else 0):
                if has(left[place], bit):
                    kind = 1 + stored.pairs[place, 1]
                    failed[number, kind] += 1
                    example[number, kind] = stored.pairs[place, 0] * cells + bit


# ---- words of an exported table


@compiled()
def clear_of_claims(row, j, ids, marks, world, bench, bits):
    """Write to bits (words,), in place, the agent's cells of a row from which u_j is claimed and the arm proved clear.

    Claimed by the word of any start, and clear of the agent for the whole interval; obstacles are not looked at. bits :
    uint64, overwritten.
    """
    bits[:] = NONE
    for start in range(len(ids)):
        for bit in range(ids.shape[2]):
            word = ids[start, row, bit]
            if marks[0, word, j] or marks[1, word, j] or marks[2, word, j] or marks[3, word, j]:
                bits[bit >> 6] |= ONE << np.uint64(bit & 63)
    # What `sweep` proves needs no closer look. An evader is nothing to stay clear of.
    if world.chased and any_bit(bits):
        near = bits.copy()
        sweep(j, world.held, world, bench, near)
        bits &= ~near
        drop_unproved(world.inputs[j], world.held, world, bench, bits)
        bits |= near


@compiled(nogil=True)
def words_hold(rows, ids, ahead, marks, world, stored, made, failed):
    """Check every input that exported words claim in rows (R,); threads may share the rows out.

    ids (starts, all rows, cells) : the number of each cell's word.
    ahead (2, starts, all rows, cells) : the steps to go by which a claim of the first two kinds is meant, and one of
        the third.
    marks (4, words, L) bool : the inputs that a word claims, in four kinds: selected, safe, safe by all steps, and
        clear. made, failed (R, 4), in place : how many claims of each kind there are, and are not proved, are added.
    """
    n2 = world.q2.size - 1
    steps = len(stored.allowed)
    room, able = np.empty_like(stored.pool[0]), np.empty_like(stored.pool[0])
    for number in range(len(rows)):
        row = rows[number]
        i1, i2 = row // n2, row % n2
        bench = bench_of(i1, i2, world)
        for j in range(len(world.inputs)):
            clear_of_claims(row, j, ids, marks, world, bench, room)
            ends1, ends2 = stored.ends1[j, i1], stored.ends2[j, i2]
            for start, kind in np.ndindex(len(ids), 4):
                known = -1
                for bit in range(ids.shape[2]):
                    if not marks[kind, ids[start, row, bit], j]:
                        continue
                    good = start < steps and stored.allowed[start, j, i1, i2] and has(room, bit)
                    if good and kind < 3:
                        within = ahead[kind // 2, start, row, bit]
                        if within != known and within > 0:
                            # of S_{k+1}^{n-1}, as `Argument.row` numbers sets
                            place = (start + 1) * (steps + 1) - (start + 1) * start // 2 + within - 1
                            able[:] = ~NONE
                            reaching(ends1, ends2, stored.places[place], n2, stored.eroded, able)
                            known = within
                        good = within > 0 and has(able, bit)
                    made[number, kind] += 1
                    failed[number, kind] += not good
