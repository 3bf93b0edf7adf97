"""Compiled kernels of the independent checker; `sdhj.certified.check.verify` says what they prove. Nothing of the solver is used.

A *block* holds the bits of the agent's cells for one pair of joint cells (a *row*): cell (x, y) of nx times ny is bit
x * ny + y, bit b is bit b % 64 of word b // 64.

Range of the arm along a direction (`farthest`). Let E be the elbow and F the vector from it to the tip in the middle of
a box of joint angles, d1 and d2 the box's half widths, E' and F' the vectors turned by a right angle. Off the middle E
is turned by s, |s| <= d1, and F by t = s + u, |u| <= d2 (or t = u where the second link does not turn with the first:
then E' and F' are not added, and d1 + d2 is d2). Along a unit vector n the tip is at

    n.E cos s + n.F cos t + n.E' sin s + n.F' sin t.

A cosine is in [1 - s^2 / 2, 1], so the first two terms exceed n.E + n.F by at most max(0, -n.E) d1^2 / 2 +
max(0, -n.F) (d1 + d2)^2 / 2. The others are n.(E' + F') sin s + n.F' (sin t - sin s), at most |n.(E' + F')| d1 +
|n.F'| d2, since |sin t - sin s| <= |t - s|. The elbow alone is alike, and a link does not extend beyond its ends.

Rounding. `sdhj.certified.check.verify` refuses files with a length, a joint's move in one interval or a place of a disk above 10
(metres, radians), or the angle of a disk on its path above 100. Compared are sums of fewer than 50 products of such
numbers, none of which matters above 100 (to n.E and n.F only positive terms are added, so where one is larger nothing
is proved): off by less than 50 * 100 * 2^-53 < 1e-12. Angles are sums of at most ten numbers below 100, off by 2e-13,
and sine and cosine are within 4 units in the last place: times lengths below 10 that is 3e-12, for E and F together and
for a disk. Directions have length 1 within 1e-14. `ROUNDING` = 1e-11 is more than all of it. No fast-math.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

Array = NDArray[Any]

ROUNDING = 1e-11  # m: see above
STATE_ERROR = 1e-10  # a state counts as in a cell up to this far from it on each axis
DIRECTIONS = 24  # tried for a whole row, beside the links' normals
TIME_HALVINGS = 6
TURNS = 20
GRANTED = 2000  # boxes for one question; then it is not proved
STACK = 160
ONE = np.uint64(1)
NONE = np.uint64(0)


class World(NamedTuple):
    """The problem as numbers; lengths in metres, angles in radians, seconds."""

    arm: Array  # (3,) l1, l2, and 1.0 where the second link turns with the first
    inputs: Array  # (L, 2) joint velocities
    push: float  # the disturbance adds up to this to each of them
    chased: bool  # whether the agent must not touch the arm: a pursuer, not an evader
    agent: Array  # (2,) greatest speed on each axis; distance of its centre from a link at contact
    delta: float
    disks: Array  # (D, 8) obstacles as `place_of` reads them, the distance at contact last
    goal: Array  # (8,) target likewise, its radius last; moves with the agent where that is an evader
    q1: Array  # (n + 1,) edges of the cells of each axis
    q2: Array
    x: Array
    y: Array
    compass: Array  # (DIRECTIONS, 2) unit vectors
    parts: Array  # (L,) into how many parts `sweep` cuts the interval


class Sets(NamedTuple):
    """The sets of the file."""

    steps: int
    places: Array  # (entries, rows): which block of the pool
    pool: Array  # (blocks, words)
    eroded: Array  # (blocks, words): the cells whose agent ends within the block, whatever it does
    allowed: Array  # (steps, L, n1, n2) bool
    ends1: Array  # (L, n1, most) the cells of the first joint that a cell may end in, the last one repeated
    ends2: Array


# --------------------------------------------------------------------------------------------------------------------
# Bits
# --------------------------------------------------------------------------------------------------------------------


@njit(cache=True)
def has(block, bit):
    return (block[bit >> 6] >> np.uint64(bit & 63)) & ONE != NONE


@njit(cache=True)
def drop(block, bit):
    """Clear a bit, in place."""
    block[bit >> 6] &= ~(ONE << np.uint64(bit & 63))


@njit(cache=True)
def drop_range(block, start, stop):
    """Clear the bits start..stop-1, in place."""
    for word in range(start >> 6, ((stop - 1) >> 6) + 1):
        mask = ~NONE
        if word == start >> 6:
            mask &= ~NONE << np.uint64(start & 63)
        if word == (stop - 1) >> 6:
            mask &= ~NONE >> np.uint64(63 - ((stop - 1) & 63))
        block[word] &= ~mask


@njit(cache=True)
def any_bit(block):
    for word in block:
        if word != NONE:
            return True
    return False


@njit(cache=True)
def count(word):
    """Set bits of a word."""
    total = 0
    while word != NONE:
        word &= word - ONE
        total += 1
    return total


@njit(cache=True)
def entry(steps, start, within):
    """Which entry of the index holds S_start^within."""
    return start * (steps + 1) - start * (start - 1) // 2 + within


@njit(cache=True)
def bits_from(block, start, number):
    """The bits start..start+number-1, at most 64, as one word."""
    word, shift = start >> 6, np.uint64(start & 63)
    value = block[word] >> shift
    if (start & 63) + number > 64:
        value |= block[word + 1] << (np.uint64(64) - shift)
    return value & (~NONE >> np.uint64(64 - number))


@njit(cache=True)
def add_bits(block, start, value):
    """Set the bits of one word from a bit on, in place."""
    word, shift = start >> 6, np.uint64(start & 63)
    block[word] |= value << shift
    if start & 63 and value >> (np.uint64(64) - shift) != NONE:
        block[word + 1] |= value >> (np.uint64(64) - shift)


@njit(cache=True, parallel=True)
def erode(pool, along_x, along_y, out):
    """For every block the cells (x, y) for which it holds all of along_x[x] times along_y[y]; written to `out`.

    along_x (nx, most), along_y (ny, most) : cells, the last one repeated
    """
    nx, ny = along_x.shape[0], along_y.shape[0]
    words = (ny + 63) // 64
    wanted = np.zeros((ny, words), np.uint64)
    for y in range(ny):
        for other in along_y[y]:
            wanted[y, other >> 6] |= ONE << np.uint64(other & 63)
    for number in prange(pool.shape[0]):
        block, kept = pool[number], out[number]
        kept[:] = NONE
        columns, column = np.empty((nx, words), np.uint64), np.empty(words, np.uint64)
        for x in range(nx):
            for word in range(words):
                columns[x, word] = bits_from(block, x * ny + 64 * word, min(64, ny - 64 * word))
        for x in range(nx):
            column[:] = ~NONE
            for other in along_x[x]:
                for word in range(words):
                    column[word] &= columns[other, word]
            if not any_bit(column):
                continue
            for first in range(0, ny, 64):
                value = NONE
                for y in range(first, min(first + 64, ny)):
                    inside = True
                    for word in range(words):
                        inside &= column[word] & wanted[y, word] == wanted[y, word]
                    value |= np.uint64(inside) << np.uint64(y - first)
                add_bits(kept, x * ny + first, value)


@njit(cache=True)
def survey_row(row, steps, shape, index, pool, inner, counts, shrinks):
    """`survey` of one row; counts (steps + 1, 2), shrinks (entries,)."""
    n1, n2 = shape[0], shape[1]
    i1, i2 = row // n2, row % n2
    after, before = (i1 + 1) % n1 * n2, (i1 + n1 - 1) % n1 * n2
    beside = (after + i2, before + i2, i1 * n2 + (i2 + 1) % n2, i1 * n2 + (i2 + n2 - 1) % n2)
    for start in range(steps + 1):
        for within in range(steps - start + 1):
            place = entry(steps, start, within)
            here = index[place, row]
            less = index[place - 1, row] if within > 0 else here
            for word in range(pool.shape[1]):
                new = pool[here, word]
                if within > 0:
                    shrinks[place] |= pool[less, word] & ~new != NONE
                    new &= ~pool[less, word]
                if new == NONE:
                    continue
                counts[within, 0] += count(new)
                deep = inner[here, word]
                for other in beside:
                    deep &= pool[index[place, other], word]
                counts[within, 1] += count(new & ~deep)


@njit(cache=True, parallel=True)
def survey(steps, shape, index, pool, inner, counts, shrinks):
    """Count what the sets of each row add to those with a step less, and find rows where they shrink instead.

    inner (blocks, words) : cells all of whose neighbours are in the block, those across a corner included.
    counts (rows, steps + 1, 2), added to : cells that the sets within n add, and how many of them have a neighbour
    outside the set. shrinks (rows, entries) bool, set where a set shrinks.
    """
    for row in prange(len(counts)):
        survey_row(np.int64(row), steps, shape, index, pool, inner, counts[row], shrinks[row])


# --------------------------------------------------------------------------------------------------------------------
# Where the arm, the agent and the disks can be
# --------------------------------------------------------------------------------------------------------------------
# A *box* (10,) holds bounds of both joints and of the agent's coordinates while tau, the time since the start of the
# interval, is in its last two entries.


@njit(cache=True)
def moved(cell, velocity, tau0, tau1, world, box):
    """The box of everything that can be reached from a cell (8,) during [tau0, tau1]; written to `box`."""
    for joint in range(2):
        slow, fast = velocity[joint] - world.push, velocity[joint] + world.push
        box[2 * joint] = cell[2 * joint] + min(slow * tau0, slow * tau1) - STATE_ERROR
        box[2 * joint + 1] = cell[2 * joint + 1] + max(fast * tau0, fast * tau1) + STATE_ERROR
    for side in (4, 6):
        box[side] = cell[side] - world.agent[0] * tau1 - STATE_ERROR
        box[side + 1] = cell[side + 1] + world.agent[0] * tau1 + STATE_ERROR
    box[8], box[9] = tau0, tau1


@njit(cache=True)
def pose_of(box, arm):
    """Elbow E, forearm F and half widths (d1, d2) of the joints of a box."""
    q1, q2 = (box[0] + box[1]) / 2, (box[2] + box[3]) / 2
    phi = arm[2] * q1 + q2
    return (
        arm[0] * math.cos(q1),
        arm[0] * math.sin(q1),
        arm[1] * math.cos(phi),
        arm[1] * math.sin(phi),
        (box[1] - box[0]) / 2,
        (box[3] - box[2]) / 2,
    )


@njit(cache=True)
def farthest(nx, ny, link, pose, turn):
    """An upper bound on n.p over all points p of a link and all joint angles of the box: see the module docstring."""
    ex, ey, fx, fy, d1, d2 = pose
    a, side_a = nx * ex + ny * ey, ny * ex - nx * ey
    bend = max(-a, 0.0) * d1 * d1 / 2
    elbow = a + abs(side_a) * d1 + bend
    if link == 0:
        return max(elbow, 0.0)
    b, side_b = nx * fx + ny * fy, ny * fx - nx * fy
    tip = a + b + abs(side_a + turn * side_b) * d1 + abs(side_b) * d2
    return max(elbow, tip + bend + max(-b, 0.0) * (turn * d1 + d2) ** 2 / 2)


@njit(cache=True)
def place_of(disk, t):
    """Centre and velocity at time t of a disk whose centre is (x, y) + (vx, vy) t + radius (cos, sin)(rate t + phase).

    `disk` holds x, y, vx, vy, radius, rate, phase and a distance that is not used here.
    """
    c, s = disk[4] * math.cos(disk[5] * t + disk[6]), disk[4] * math.sin(disk[5] * t + disk[6])
    return disk[0] + disk[2] * t + c, disk[1] + disk[3] * t + s, disk[2] - disk[5] * s, disk[3] + disk[5] * c


@njit(cache=True)
def body_of(box, body, start, world):
    """What a link must not meet: centre, half sizes of the box it is in, moves around it, and distance at contact.

    body : the number of an obstacle, or the one after them for the agent. A disk's centre is within h v + bend of the
    one in the middle of the time, h being half its length, v the velocity there and bend = h^2 / 2 times the
    acceleration on a circle.
    """
    if body == len(world.disks):
        x, y = (box[4] + box[5]) / 2, (box[6] + box[7]) / 2
        return x, y, (box[5] - box[4]) / 2, (box[7] - box[6]) / 2, 0.0, 0.0, 0.0, world.agent[1]
    disk = world.disks[body]
    half = (box[9] - box[8]) / 2
    x, y, vx, vy = place_of(disk, start + (box[8] + box[9]) / 2)
    return x, y, 0.0, 0.0, half * vx, half * vy, abs(disk[4]) * (disk[5] * half) ** 2 / 2, disk[7]


# --------------------------------------------------------------------------------------------------------------------
# One question: does the arm stay clear of one body?
# --------------------------------------------------------------------------------------------------------------------


@njit(cache=True)
def nearest(px, py, ax, ay, fx, fy):
    """The vector to a point from the nearest point of the segment that leads from (ax, ay) along (fx, fy)."""
    s = ((px - ax) * fx + (py - ay) * fy) / (fx * fx + fy * fy)
    s = min(max(s, 0.0), 1.0)
    return px - ax - s * fx, py - ay - s * fy


@njit(cache=True)
def gap_of(link, pose, body):
    """The shortest vector from a link, in the middle of the box, to the body's box. A good direction, not a bound."""
    ex, ey, fx, fy, _, _ = pose
    x, y, hx, hy = body[0], body[1], body[2], body[3]
    ax, ay = (0.0, 0.0) if link == 0 else (ex, ey)
    if link == 0:
        fx, fy = ex, ey
    if hx == 0.0 and hy == 0.0:
        return nearest(x, y, ax, ay, fx, fy)
    best_x, best_y = np.inf, np.inf
    for k in range(6):
        if k < 2:  # from the ends of the link to the box
            px, py = ax + k * fx, ay + k * fy
            gx, gy = min(max(px, x - hx), x + hx) - px, min(max(py, y - hy), y + hy) - py
        else:  # from the link to the corners of the box
            gx, gy = nearest(x + hx * (1 - 2 * (k % 2)), y + hy * (1 - 2 * (k // 4)), ax, ay, fx, fy)
        if gx * gx + gy * gy < best_x * best_x + best_y * best_y:
            best_x, best_y = gx, gy
    return best_x, best_y


@njit(cache=True)
def ahead(nx, ny, link, pose, body, turn):
    """How far a body is at least ahead of a link along n, for everything in the box."""
    x, y, hx, hy, move_x, move_y, bend, _ = body
    behind = abs(nx) * hx + abs(ny) * hy + abs(nx * move_x + ny * move_y) + bend
    return nx * x + ny * y - behind - farthest(nx, ny, link, pose, turn)


@njit(cache=True)
def separated(link, pose, body, turn):
    """Whether one direction proves that a link stays clear of a body: the shortest gap's, turned while that helps."""
    needed = body[7] + ROUNDING
    nx, ny = gap_of(link, pose, body)
    length = math.sqrt(nx * nx + ny * ny)
    if length < 1e-6:
        return False
    nx, ny = nx / length, ny / length
    best, step = ahead(nx, ny, link, pose, body, turn), 0.2
    for _ in range(TURNS):
        if best > needed:
            return True
        length = math.sqrt(1.0 + step * step)
        tx, ty = (nx - step * ny) / length, (ny + step * nx) / length
        gap = ahead(tx, ty, link, pose, body, turn)
        if gap > best:
            nx, ny, best = tx, ty, gap
        else:  # try the other way, less far
            step *= -0.6
    return best > needed


@njit(cache=True)
def touching(link, pose, body):
    """Whether link and body touch in the middle of the box, so that no halving of the box will help."""
    point = (body[0], body[1], 0.0, 0.0, 0.0, 0.0, 0.0, body[7])
    gx, gy = gap_of(link, pose, point)
    return gx * gx + gy * gy <= body[7] * body[7]


@njit(cache=True)
def halve(box, arm, agent, first, second):
    """Cut a box where it is widest in metres; `agent` says whether its coordinates count."""
    reach = (arm[0] + arm[1], arm[1], 1.0, 1.0)
    axis, widest = 0, 0.0
    for k in range(4 if agent else 2):
        size = (box[2 * k + 1] - box[2 * k]) * reach[k]
        if size > widest:
            axis, widest = k, size
    middle = (box[2 * axis] + box[2 * axis + 1]) / 2
    for k in range(box.size):
        first[k] = second[k] = box[k]
    first[2 * axis + 1] = second[2 * axis] = middle


@njit(cache=True)
def link_clear(link, body, cell, velocity, start, duration, world, stack):
    """Whether it is proved that a link stays clear of a body, from anywhere in a cell (8,), at all times.

    velocity (2,) : the input. start, duration : of the interval; 0 for an instant. stack (STACK, 10) : scratch.
    """
    shortest = duration * 1.5 / 2**TIME_HALVINGS
    moved(cell, velocity, 0.0, duration, world, stack[0])
    size, box = 1, stack[STACK - 1]
    for _ in range(GRANTED):
        if size == 0:
            return True
        size -= 1
        box[:] = stack[size]
        pose, bounds = pose_of(box, world.arm), body_of(box, body, start, world)
        if separated(link, pose, bounds, world.arm[2]):
            continue
        if size + 2 >= STACK:
            return False
        if box[9] - box[8] > shortest:
            middle = (box[8] + box[9]) / 2
            moved(cell, velocity, middle, box[9], world, stack[size])
            moved(cell, velocity, box[8], middle, world, stack[size + 1])
        elif touching(link, pose, bounds):
            return False
        else:
            halve(box, world.arm, body == len(world.disks), stack[size], stack[size + 1])
        size += 2
    return False


@njit(cache=True)
def clear(body, cell, velocity, start, duration, world, stack):
    """`link_clear` for both links."""
    for link in range(2):
        if not link_clear(link, body, cell, velocity, start, duration, world, stack):
            return False
    return True


@njit(cache=True)
def disks_clear(cell, velocity, start, duration, world, stack):
    """`clear` for every obstacle."""
    for body in range(len(world.disks)):
        if not clear(body, cell, velocity, start, duration, world, stack):
            return False
    return True


@njit(cache=True)
def tip_inside(cell, t, world, stack):
    """Whether every tip of a cell is inside the target at time t.

    The tip is off T + (linear terms) by at most half of l1 d1^2 + l2 (d1 + d2)^2, and a distance is largest at a corner
    of a parallelogram, or of the agent's cell where that is the target.
    """
    moved(cell, world.inputs[0], 0.0, 0.0, world, stack[0])
    size, box, turn = 1, stack[STACK - 1], world.arm[2]
    for _ in range(GRANTED):
        if size == 0:
            return True
        size -= 1
        box[:] = stack[size]
        ex, ey, fx, fy, d1, d2 = pose_of(box, world.arm)
        x, y, _, _ = place_of(world.goal, t)
        hx, hy = 0.0, 0.0
        if not world.chased:
            x, y, hx, hy = (box[4] + box[5]) / 2, (box[6] + box[7]) / 2, (box[5] - box[4]) / 2, (box[7] - box[6]) / 2
        furthest = 0.0
        for turned in (-d1, d1):
            for bent in (-d2, d2):
                off_x = ex + fx - x - (ey + turn * fy) * turned - fy * bent
                off_y = ey + fy - y + (ex + turn * fx) * turned + fx * bent
                furthest = max(furthest, math.hypot(abs(off_x) + hx, abs(off_y) + hy))
        rest = (world.arm[0] * d1 * d1 + world.arm[1] * (turn * d1 + d2) ** 2) / 2
        if furthest + rest + ROUNDING <= world.goal[7]:
            continue
        outside = math.hypot(abs(ex + fx - x) + hx, abs(ey + fy - y) + hy) > world.goal[7]
        if outside or size + 2 >= STACK:
            return False
        halve(box, world.arm, False, stack[size], stack[size + 1])
        size += 2
    return False


# --------------------------------------------------------------------------------------------------------------------
# Many questions at once: the agent's cells of a row
# --------------------------------------------------------------------------------------------------------------------


@njit(cache=True)
def tilted(nx, ny):
    """A unit vector next to (nx, ny), or that one, which is not quite horizontal."""
    ny = ny if abs(ny) > 1e-6 else 1e-6
    length = math.sqrt(nx * nx + ny * ny)
    return nx / length, ny / length


@njit(cache=True)
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


@njit(cache=True)
def drop_unproved(low, high, edges_y, bits):
    """Clear the bits of all cells that are neither above high[x] nor below low[x]. In place."""
    ny = edges_y.size - 1
    for x in range(low.size):
        first = np.searchsorted(edges_y[1:], low[x])
        stop = np.searchsorted(edges_y[:-1], high[x], side="right")
        if first < stop:
            drop_range(bits, x * ny + first, x * ny + stop)


@njit(cache=True)
def sweep(cell, j, duration, world, low, high, bits):
    """Keep of the bits only those of the agent's cells that a few directions prove clear for the whole interval."""
    box, parts = np.empty(10), world.parts[j] if duration > 0.0 else 1
    for part in range(parts):
        moved(cell, world.inputs[j], duration * part / parts, duration * (part + 1) / parts, world, box)
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


@njit(cache=True)
def settle(cell, velocity, duration, world, stack, bits):
    """Keep of the bits only those of the agent's cells that are proved clear one by one."""
    for word in range(bits.size):
        for bit in range(64 * word, 64 * word + 64):
            if bits[word] != NONE and has(bits, bit):
                agent_cell(bit, world, cell)
                if not clear(len(world.disks), cell, velocity, 0.0, duration, world, stack):
                    drop(bits, bit)


@njit(cache=True)
def agent_cell(bit, world, cell):
    """Write the bounds of one of the agent's cells into a cell (8,)."""
    ny = world.y.size - 1
    cell[4], cell[5] = world.x[bit // ny], world.x[bit // ny + 1]
    cell[6], cell[7] = world.y[bit % ny], world.y[bit % ny + 1]


# --------------------------------------------------------------------------------------------------------------------
# A row and all of its claims
# --------------------------------------------------------------------------------------------------------------------


@njit(cache=True)
def joint_cell(i1, i2, world, cell):
    """Write the bounds of a row into a cell (8,)."""
    cell[0], cell[1] = world.q1[i1], world.q1[i1 + 1]
    cell[2], cell[3] = world.q2[i2], world.q2[i2 + 1]


@njit(cache=True)
def check_flags(i1, i2, world, sets):
    """Of the flags that say an input is clear of the obstacles throughout the interval: (how many are wrong, one)."""
    stack, cell = np.empty((STACK, 10)), np.zeros(8)
    joint_cell(i1, i2, world, cell)
    failed, example = 0, 0
    for start in range(sets.steps):
        for j in range(len(world.inputs)):
            if sets.allowed[start, j, i1, i2]:
                if not disks_clear(cell, world.inputs[j], start * world.delta, world.delta, world, stack):
                    failed, example = failed + 1, start * len(world.inputs) + j
    return failed, example


@njit(cache=True)
def check_goals(cell, world, sets, stack, low, high, todo):
    """Drop from todo (entries, words) what is proved of S_k^0: inside the target and outside the unsafe set at t_k."""
    need, near = np.zeros_like(todo[0]), np.zeros_like(todo[0])
    for start in range(sets.steps + 1):
        need |= todo[entry(sets.steps, start, 0)]
    if not any_bit(need):
        return
    if world.chased:
        near[:] = need
        sweep(cell, 0, 0.0, world, low, high, near)
        need &= ~near
        settle(cell, world.inputs[0], 0.0, world, stack, need)
        need |= near
    else:
        for bit in range(64 * need.size):
            if has(need, bit):
                agent_cell(bit, world, cell)
                if not tip_inside(cell, 0.0, world, stack):
                    drop(need, bit)
    for start in range(sets.steps + 1):
        bits, t = todo[entry(sets.steps, start, 0)], start * world.delta
        if any_bit(bits) and disks_clear(cell, world.inputs[0], t, 0.0, world, stack):
            if not world.chased or tip_inside(cell, t, world, stack):
                bits &= ~need


@njit(cache=True)
def reaching(i1, i2, j, place, n2, sets, bits):
    """Keep of the bits those from which everything that can be reached under input j is in one set."""
    ends1, ends2 = sets.ends1[j, i1], sets.ends2[j, i2]
    for a in range(ends1.size):
        for b in range(ends2.size):
            if (a > 0 and ends1[a] == ends1[a - 1]) or (b > 0 and ends2[b] == ends2[b - 1]):
                continue
            bits &= sets.eroded[sets.places[place, ends1[a] * n2 + ends2[b]]]
        if not any_bit(bits):
            return


@njit(cache=True)
def check_steps(i1, i2, n2, cell, world, sets, stack, low, high, todo):
    """Drop from todo (entries, words) what is proved of S_k^n: some input is safe and ends in S_{k+1}^{n-1}."""
    steps = sets.steps
    able, need = np.zeros_like(todo), np.empty_like(todo[0])
    for careful in range(2):  # first many cells at once, then what is left one by one
        for j in range(len(world.inputs)):
            able[:] = NONE
            need[:] = NONE
            for start in range(steps):
                if not sets.allowed[start, j, i1, i2]:
                    continue
                for within in range(1, steps - start + 1):
                    place = entry(steps, start, within)
                    if any_bit(todo[place]):
                        able[place] = todo[place]
                        reaching(i1, i2, j, entry(steps, start + 1, within - 1), n2, sets, able[place])
                        need |= able[place]
            if not any_bit(need):
                continue
            if world.chased and careful:
                settle(cell, world.inputs[j], world.delta, world, stack, need)
            elif world.chased:
                sweep(cell, j, world.delta, world, low, high, need)
            for place in range(len(todo)):
                todo[place] &= ~(able[place] & need)


@njit(cache=True)
def unproved(row, shape, world, sets):
    """What is not proved of the cells that each set adds in a row; (entries, words)."""
    i1, i2 = row // shape[1], row % shape[1]
    low, high = np.empty(shape[2]), np.empty(shape[2])
    stack, cell = np.empty((STACK, 10)), np.zeros(8)
    joint_cell(i1, i2, world, cell)
    todo = np.empty((sets.places.shape[0], sets.pool.shape[1]), np.uint64)
    for start in range(sets.steps + 1):
        for within in range(sets.steps - start + 1):
            place = entry(sets.steps, start, within)
            todo[place] = sets.pool[sets.places[place, row]]
            if within > 0:
                todo[place] &= ~sets.pool[sets.places[place - 1, row]]
    check_goals(cell, world, sets, stack, low, high, todo)
    check_steps(i1, i2, shape[1], cell, world, sets, stack, low, high, todo)
    return todo


@njit(cache=True, nogil=True)
def check_rows(rows, shape, world, sets, failed, example):
    """Check all claims of some rows; threads may share the rows out.

    failed, example (R, kinds), modified in place: how many claims of each kind are not proved, and a number that names
    one of them. Kind 0 are the flags, 1 + n the cells that the sets within n add.
    """
    for number in range(len(rows)):
        row = rows[number]
        flag = check_flags(row // shape[1], row % shape[1], world, sets)
        left = unproved(row, shape, world, sets)
        failed[number, 0], example[number, 0] = flag
        for start in range(sets.steps + 1):
            for within in range(sets.steps - start + 1):
                place = entry(sets.steps, start, within)
                for bit in range(shape[2] * shape[3]):
                    if has(left[place], bit):
                        failed[number, 1 + within] += 1
                        example[number, 1 + within] = start * shape[2] * shape[3] + bit
