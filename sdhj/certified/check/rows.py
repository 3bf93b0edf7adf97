"""All claims of the rows of a file: many of the agent's cells at once where that does, else one by one."""

import math
from typing import NamedTuple

import numpy as np

from sdhj.certified.check.bits import NONE, Array, any_bit, compiled, drop, has, place_of
from sdhj.certified.check.separation import (
    ROUNDING,
    STACK,
    STATE_ERROR,
    clear,
    farthest,
    moved,
    pose_of,
    tip_inside,
)


class Stored(NamedTuple):
    """The sets of the file."""

    steps: int
    places: Array  # (entries, rows): which block of the pool
    pool: Array  # (blocks, words)
    eroded: Array  # (blocks, words): the cells whose agent ends within the block, whatever it does
    allowed: Array  # (steps, L, n1, n2) bool
    ends1: Array  # (L, n1, most) the cells of the first joint that a cell may end in, the last one repeated
    ends2: Array


class Bench(NamedTuple):
    """Room to work on one row: the bounds of its joints and of one of the agent's cells, and scratch."""

    part: Array  # (10,) see `separation`
    low: Array  # (nx,) `beyond`
    high: Array
    stack: Array  # (STACK, 10) boxes


# ---- many questions at once: the agent's cells of a row


@compiled()
def tilted(nx, ny):
    """A unit vector next to (nx, ny), or that one, which is not quite horizontal."""
    ny = ny if abs(ny) > 1e-6 else 1e-6
    length = math.sqrt(nx * nx + ny * ny)
    return nx / length, ny / length


@compiled()
def beyond(nx, ny, bound, grow, edges_x, low, high):
    """Tighten low and high, so that a cell of column x above high[x] or below low[x] is beyond `bound` along n.

    The cell is grown by `grow` on each side. Both are (nx,) and modified in place. ny must not be 0; however small it
    is, dividing by it is harmless: along n an error of the level counts only ny times.
    """
    up = 1.0 if ny > 0.0 else -1.0
    base, slope = (bound + abs(nx) * grow) / ny + up * grow, nx / ny
    shift = 0 if nx > 0.0 else 1  # the edge of the column that is behind
    for x in range(low.size):
        level = base - slope * edges_x[x + shift]
        if up > 0.0:
            high[x] = min(high[x], level)
        else:
            low[x] = max(low[x], level)


@compiled()
def drop_unproved(low, high, edges_y, bits):
    """Clear the bits of all cells that are neither above high[x] nor below low[x]. In place."""
    ny = edges_y.size - 1
    for x in range(low.size):
        first = np.searchsorted(edges_y[1:], low[x])
        stop = np.searchsorted(edges_y[:-1], high[x], side="right")
        if first < stop:
            drop(bits, x * ny + first, x * ny + stop)


@compiled()
def sweep(j, duration, world, bench, bits):
    """Keep of the bits only those of the agent's cells that a few directions prove clear for the whole interval."""
    box, parts = np.empty(10), world.parts[j] if duration > 0.0 else 1
    low, high = bench.low, bench.high
    for part in range(parts):
        bench.part[8], bench.part[9] = duration * part / parts, duration * (part + 1) / parts
        moved(bench.part, world.inputs[j], world, box)
        pose = pose_of(box, world.arm)
        grow = world.agent[0] * box[9] + STATE_ERROR
        for link in range(2):
            low[:], high[:] = -np.inf, np.inf
            for k in range(world.compass.shape[0] + 2):
                if k < world.compass.shape[0]:
                    nx, ny = world.compass[k, 0], world.compass[k, 1]
                else:  # the normals of the link
                    sign = 1.0 if k % 2 else -1.0
                    nx, ny = -sign * pose[1 + 2 * link], sign * pose[2 * link]
                    nx, ny = tilted(nx / world.arm[link], ny / world.arm[link])
                bound = farthest(nx, ny, link, pose, world.arm[2]) + world.agent[1] + ROUNDING
                beyond(nx, ny, bound, grow, world.x, low, high)
            drop_unproved(low, high, world.y, bits)
        if not any_bit(bits):
            break


@compiled()
def agent_cell(bit, duration, world, part):
    """Write the bounds of one of the agent's cells, and those of a whole interval, into a part."""
    ny = world.y.size - 1
    part[4:6], part[6:8] = world.x[bit // ny : bit // ny + 2], world.y[bit % ny : bit % ny + 2]
    part[8], part[9] = 0.0, duration


@compiled()
def settle(velocity, duration, world, bench, bits):
    """Keep of the bits only those of the agent's cells that are proved clear one by one."""
    agent = (len(world.disks), len(world.disks) + 1)
    for bit in range(64 * bits.size):
        if has(bits, bit):
            agent_cell(bit, duration, world, bench.part)
            if not clear(agent, bench.part, velocity, 0.0, world, bench.stack):
                drop(bits, bit, bit + 1)


# ---- a row and all of its claims


@compiled()
def bench_of(i1, i2, world):
    """Room to work on the row of two joint cells."""
    nx, part = world.x.size - 1, np.zeros(10)
    part[0:2], part[2:4] = world.q1[i1 : i1 + 2], world.q2[i2 : i2 + 2]
    return Bench(part, np.empty(nx), np.empty(nx), np.empty((STACK, 10)))


@compiled()
def check_flags(i1, i2, world, stored):
    """Of the flags that say an input is clear of the obstacles throughout the interval: (how many are wrong, one)."""
    bench, failed, example = bench_of(i1, i2, world), 0, 0
    bench.part[9] = world.delta
    for start in range(stored.steps):
        for j in range(len(world.inputs)):
            if stored.allowed[start, j, i1, i2]:
                t = start * world.delta
                if not clear((0, len(world.disks)), bench.part, world.inputs[j], t, world, bench.stack):
                    failed, example = failed + 1, start * len(world.inputs) + j
    return failed, example


@compiled()
def check_goals(world, stored, bench, todo):
    """Drop from todo (entries, words) what is proved of S_k^0: inside the target and outside the unsafe set at t_k."""
    need, steps, still = np.zeros_like(todo[0]), stored.steps, world.inputs[0]
    for start in range(steps + 1):
        need |= todo[place_of(steps, start, 0)]
    if not any_bit(need):
        return
    if world.chased:
        near = need.copy()
        sweep(0, 0.0, world, bench, near)
        need &= ~near
        settle(still, 0.0, world, bench, need)
        need |= near
    else:
        for bit in range(64 * need.size):
            if has(need, bit):
                agent_cell(bit, 0.0, world, bench.part)
                if not tip_inside(bench.part, 0.0, world, bench.stack):
                    drop(need, bit, bit + 1)
    for start in range(steps + 1):
        bits, t = todo[place_of(steps, start, 0)], start * world.delta
        if any_bit(bits) and clear((0, len(world.disks)), bench.part, still, t, world, bench.stack):
            if not world.chased or tip_inside(bench.part, t, world, bench.stack):
                bits &= ~need


@compiled()
def reaching(ends1, ends2, place, n2, stored, bits):
    """Keep of the bits those from which everything that can be reached is in one set, at the ends of both joints."""
    for a in range(ends1.size):
        for b in range(ends2.size):
            if (a > 0 and ends1[a] == ends1[a - 1]) or (b > 0 and ends2[b] == ends2[b - 1]):
                continue
            bits &= stored.eroded[stored.places[place, ends1[a] * n2 + ends2[b]]]
        if not any_bit(bits):
            return


@compiled()
def check_steps(i1, i2, world, stored, bench, todo):
    """Drop from todo (entries, words) what is proved of S_k^n: some input is safe and ends in S_{k+1}^{n-1}."""
    steps, n2 = stored.steps, world.q2.size - 1
    able, need = np.zeros_like(todo), np.empty_like(todo[0])
    for careful in range(2):  # first many cells at once, then what is left one by one
        for j in range(len(world.inputs)):
            able[:] = NONE
            need[:] = NONE
            for start in range(steps):
                if not stored.allowed[start, j, i1, i2]:
                    continue
                for within in range(1, steps - start + 1):
                    place, after = place_of(steps, start, within), place_of(steps, start + 1, within - 1)
                    if any_bit(todo[place]):
                        able[place] = todo[place]
                        reaching(stored.ends1[j, i1], stored.ends2[j, i2], after, n2, stored, able[place])
                        need |= able[place]
            if not any_bit(need):
                continue
            if world.chased and careful:
                settle(world.inputs[j], world.delta, world, bench, need)
            elif world.chased:
                sweep(j, world.delta, world, bench, need)
            for place in range(len(todo)):
                todo[place] &= ~(able[place] & need)


@compiled()
def unproved(i1, i2, world, stored):
    """What is not proved of the cells that each set adds in a row; (entries, words)."""
    bench, row = bench_of(i1, i2, world), i1 * (world.q2.size - 1) + i2
    todo = np.empty((stored.places.shape[0], stored.pool.shape[1]), np.uint64)
    for start in range(stored.steps + 1):
        for within in range(stored.steps - start + 1):
            place = place_of(stored.steps, start, within)
            todo[place] = stored.pool[stored.places[place, row]]
            if within > 0:
                todo[place] &= ~stored.pool[stored.places[place - 1, row]]
    check_goals(world, stored, bench, todo)
    check_steps(i1, i2, world, stored, bench, todo)
    return todo


@compiled(nogil=True)
def check_rows(rows, world, stored, failed, example):
    """Check all claims of some rows; threads may share the rows out.

    failed, example (R, kinds), modified in place: how many claims of each kind are not proved, and a number that names
    one of them. Kind 0 are the flags, 1 + n the cells that the sets within n add.
    """
    n2, cells = world.q2.size - 1, (world.x.size - 1) * (world.y.size - 1)
    for number in range(len(rows)):
        i1, i2 = rows[number] // n2, rows[number] % n2
        failed[number, 0], example[number, 0] = check_flags(i1, i2, world, stored)
        left = unproved(i1, i2, world, stored)
        for start in range(stored.steps + 1):
            for within in range(stored.steps - start + 1):
                bits = left[place_of(stored.steps, start, within)]
                for bit in range(cells if any_bit(bits) else 0):
                    if has(bits, bit):
                        failed[number, 1 + within] += 1
                        example[number, 1 + within] = start * cells + bit
