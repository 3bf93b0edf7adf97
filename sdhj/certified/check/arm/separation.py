"""Whether the arm stays clear of one body, for every state of a cell and every time.

Range of the arm along a direction (`farthest`). Let E be the elbow and F the vector from it to the tip in the middle of
a box of joint angles, d1 and d2 the box's half widths, E' and F' the vectors turned by a right angle. Off the middle E
is turned by s, |s| <= d1, and F by t = s + u, |u| <= d2 (or t = u where the second link does not turn with the first:
then E' and F' are not added, and d1 + d2 is d2). Along a unit vector n the tip is at

    n.E cos s + n.F cos t + n.E' sin s + n.F' sin t.

A cosine is in [1 - s^2 / 2, 1], so the first two terms exceed n.E + n.F by at most max(0, -n.E) d1^2 / 2 +
max(0, -n.F) (d1 + d2)^2 / 2. The others are n.(E' + F') sin s + n.F' (sin t - sin s), at most |n.(E' + F')| d1 +
|n.F'| d2, since |sin t - sin s| <= |t - s|. The elbow alone is alike, and a link does not extend beyond its ends.

Arguments. link : 0 or 1. body : the number of an obstacle, or the one after all of them for the agent. part (BOUNDS,) :
bounds of joints, coordinates, times and pushes, as `moved` has them. start : when the interval begins, s. stack (STACK,
BOUNDS) : overwritten.

Rounding. `refuse_large` refuses files with a length, a joint's move in one interval or a place of a disk above 10
(metres, radians), or the angle of a disk on its path above 100. Compared are sums of fewer than 50 products of such
numbers, none of which matters above 100 (to n.E and n.F only positive terms are added, so where one is larger nothing
is proved): off by less than 50 * 100 * 2^-53 < 1e-12. Angles are sums of at most ten numbers below 100, off by 2e-13,
and sine and cosine are within 4 units in the last place: times lengths below 10 that is 3e-12, for E and F together and
for a disk. Directions have length 1 within 1e-14. `ROUNDING` = 1e-11 is more than all of it. No fast-math.
"""

import math
from typing import NamedTuple

import numpy as np

from sdhj.certified.check.arm.bits import UNCOUNTED, Array, any_bit, compiled, drop

ROUNDING = 1e-11  # m: see above
STATE_ERROR = 1e-10  # a state counts as in a cell up to this far from it on each axis
DIRECTIONS = 24  # tried for a whole row, beside the links' normals
TURNS = 16
GRANTED = 2000  # boxes for one question; then it is not proved
STACK = 160
BOUNDS = 14  # of a part


class World(NamedTuple):
    """The problem as numbers; lengths in metres, angles in radians, seconds."""

    arm: Array  # (3,) l1, l2, and 1.0 where the second link turns with the first
    inputs: Array  # (L, 2) joint velocities
    push: float  # the disturbance adds up to this to each of them
    chased: bool  # whether the agent must not touch the arm: a pursuer, not an evader
    agent: Array  # (2,) greatest speed on each axis; distance of its centre from a link at contact
    delta: float
    disks: Array  # (D, 8) obstacles as `disk_at` reads them, the distance at contact last
    target: Array  # (8,) target likewise, its radius last; moves with the agent where that is an evader
    q1: Array  # (n + 1,) edges of the cells of each axis
    q2: Array
    x: Array
    y: Array
    compass: Array  # (DIRECTIONS, 2) unit vectors
    parts: Array  # (L,) into how many parts `sweep` cuts the interval
    off: Array  # (4,) by how much a prediction may be off on each axis
    held: float  # the longest that an input is held
    late: float  # how early or late an interval may begin
    begin: float  # when the first one does


# ---- where the arm, the agent and the disks can be
#
# A *part* (14,) holds bounds of both joints and of the agent's coordinates at the start of an interval, of tau, a time
# since then, and of what the disturbance adds to the velocity of either joint on average until then. A *box* holds in
# its first ten entries bounds of where they are at those times.


@compiled(**UNCOUNTED)
def moved(part, velocity, world, box):
    """Write to `box` all that can be reached from a part under a velocity (2,) of the joints, errors included.

    In place. The middle of the box can be reached from the middle of the part.

    part (BOUNDS,) : bounds of both joints, of the agent's coordinates, of tau and of the two pushes, a low and a high
        one each. box : its first ten entries become bounds of joints, coordinates and tau likewise; others stay.
    """
    tau0, tau1 = part[8], part[9]
    for joint in range(2):
        slow, fast = velocity[joint] + part[10 + 2 * joint], velocity[joint] + part[11 + 2 * joint]
        # By the error of states, and E, to both sides.
        off = world.off[joint] + STATE_ERROR
        box[2 * joint] = part[2 * joint] + min(slow * tau0, slow * tau1) - off
        box[2 * joint + 1] = part[2 * joint + 1] + max(fast * tau0, fast * tau1) + off
    for axis in (2, 3):
        off = world.agent[0] * tau1 + world.off[axis] + STATE_ERROR
        box[2 * axis] = part[2 * axis] - off
        box[2 * axis + 1] = part[2 * axis + 1] + off
    box[8], box[9] = tau0, tau1


@compiled(**UNCOUNTED)
def pose_of(box, arm):
    """(ex, ey, fx, fy, d1, d2): elbow E and forearm F in the middle of a box, and half the widths of the joints.

    box (>= 4,) : bounds of both joints. arm (3,) : `World.arm`, with the lengths of the links.
    """
    q1, q2 = (box[0] + box[1]) / 2, (box[2] + box[3]) / 2
    e, f, phi = arm[0], arm[1], arm[2] * q1 + q2
    widths = (box[1] - box[0]) / 2, (box[3] - box[2]) / 2
    return e * math.cos(q1), e * math.sin(q1), f * math.cos(phi), f * math.sin(phi), widths[0], widths[1]


@compiled(**UNCOUNTED)
def farthest(nx, ny, link, pose, turn):
    """An upper bound on n.p over all points p of a link and all joint angles of a box, m.

    Of the elbow it is n.E + |n.E'| d1 + max(0, -n.E) d1^2 / 2, of the tip as the module docstring says, and of a link
    the larger one of its ends. n = (nx, ny) is a unit vector; link 0 ends at the elbow, 1 at the tip; pose : of
    `pose_of`; turn : 1.0 if link 1 turns with link 0, else 0.0.
    """
    ex, ey, fx, fy, d1, d2 = pose
    a, side_a = nx * ex + ny * ey, ny * ex - nx * ey
    # The second-order term of the elbow, by which it may come farther than its tangent says.
    bend = max(-a, 0.0) * d1 * d1 / 2
    elbow = a + abs(side_a) * d1 + bend
    if link == 0:
        return max(elbow, 0.0)
    b, side_b = nx * fx + ny * fy, ny * fx - nx * fy
    tip = a + b + abs(side_a + turn * side_b) * d1 + abs(side_b) * d2
    return max(elbow, tip + bend + max(-b, 0.0) * (turn * d1 + d2) ** 2 / 2)


@compiled(**UNCOUNTED)
def disk_at(disk, t):
    """(x, y, vx, vy), the centre and the velocity of a disk at time t, s.

    The centre is at (x, y) + (vx, vy) t + radius (cos, sin)(rate t + phase). disk (8,) : x, y, vx, vy, radius, rate,
    phase, and a distance that is not used here.
    """
    c, s = disk[4] * math.cos(disk[5] * t + disk[6]), disk[4] * math.sin(disk[5] * t + disk[6])
    return disk[0] + disk[2] * t + c, disk[1] + disk[3] * t + s, disk[2] - disk[5] * s, disk[3] + disk[5] * c


@compiled(**UNCOUNTED)
def body_of(box, body, start, world):
    """The body that a link must not meet, as (x, y, hx, hy, move_x, move_y, bend, distance at contact), in m.

    Its centre is within hx, hy, a multiple in [-1, 1] of the move, and bend of (x, y), for all states and times of the
    box. A disk's centre is within h v + bend of that in the middle of the time, h being half its length, v the velocity
    there and bend = h^2 / 2 times the acceleration on a circle.
    """
    if body == len(world.disks):
        x, y = (box[4] + box[5]) / 2, (box[6] + box[7]) / 2
        return x, y, (box[5] - box[4]) / 2, (box[7] - box[6]) / 2, 0.0, 0.0, 0.0, world.agent[1]
    # A clock that is off makes the time longer on both sides.
    disk, half = world.disks[body], (box[9] - box[8]) / 2 + world.late
    x, y, vx, vy = disk_at(disk, start + (box[8] + box[9]) / 2)
    return x, y, 0.0, 0.0, half * vx, half * vy, abs(disk[4]) * (disk[5] * half) ** 2 / 2, disk[7]


# ---- questions: does the arm stay clear of a body, is its tip inside the target?


@compiled(**UNCOUNTED)
def ahead(nx, ny, link, pose, body, turn):
    """A lower bound on how far a body is ahead of a link along the unit vector n = (nx, ny), for all of a box, m."""
    x, y, hx, hy, move_x, move_y, bend, _ = body
    behind = abs(nx) * hx + abs(ny) * hy + abs(nx * move_x + ny * move_y) + bend
    return nx * x + ny * y - behind - farthest(nx, ny, link, pose, turn)


@compiled(**UNCOUNTED)
def separated(link, pose, body, turn):
    """Whether some direction proves that a link stays clear of a body; and their distance in the middle of the box, m.

    The first direction tried is that from the link to the body there, which is then turned while that helps.
    """
    ax, ay, fx, fy = (0.0, 0.0, pose[0], pose[1]) if link == 0 else (pose[0], pose[1], pose[2], pose[3])
    # From the nearest point of the link in its middle pose: a first guess, as any direction may prove it.
    s = ((body[0] - ax) * fx + (body[1] - ay) * fy) / (fx * fx + fy * fy)
    s = min(max(s, 0.0), 1.0)
    gx, gy = body[0] - ax - s * fx, body[1] - ay - s * fy
    gap = math.sqrt(gx * gx + gy * gy)
    nx, ny = (gx / gap, gy / gap) if gap > 1e-6 else (1.0, 0.0)
    best = ahead(nx, ny, link, pose, body, turn)
    step = 0.2
    for _ in range(TURNS):
        if best > body[7] + ROUNDING:
            break
        length = math.sqrt(1.0 + step * step)
        tx, ty = (nx - step * ny) / length, (ny + step * nx) / length
        further = ahead(tx, ty, link, pose, body, turn)
        if further > best:
            nx, ny, best = tx, ty, further
        else:  # try the other way, less far
            step *= -0.6
    return best > body[7] + ROUNDING, gap


@compiled(**UNCOUNTED)
def copy(source, target):
    """target[k] = source[k] for all k, in place."""
    for k in range(source.size):
        target[k] = source[k]


@compiled(**UNCOUNTED)
def halve(part, weights, first, second):
    """Cut a part in two across its widest pair of bounds, and write the halves to `first` and `second`.

    The width of the k-th pair counts weights[k] times; pairs without a weight are not cut.
    """
    axis, widest = 0, 0.0
    for k in range(len(weights)):
        # `weights` make bounds of different units comparable.
        size = (part[2 * k + 1] - part[2 * k]) * weights[k]
        if size > widest:
            axis, widest = k, size
    for k in range(part.size):
        first[k] = second[k] = part[k]
    first[2 * axis + 1] = second[2 * axis] = (part[2 * axis] + part[2 * axis + 1]) / 2


@compiled(**UNCOUNTED)
def link_clear(link, body, part, velocity, start, world, stack):
    """Whether it is proved that a link stays clear of a body, from anywhere in a part and at all its times.

    False, too, where they touch, and where more than `GRANTED` boxes, or more room than `stack` has, would be needed.
    """
    l1, l2, agent = world.arm[0] + world.arm[1], world.arm[1] * link, 1.0 if body == len(world.disks) else 0.0
    fastest = (abs(velocity[0]) + world.push) * l1 + (abs(velocity[1]) + world.push) * l2 + agent * world.agent[0]
    if body < len(world.disks):
        disk = world.disks[body]
        fastest += abs(disk[2]) + abs(disk[3]) + abs(disk[4] * disk[5])
    # the last two rows of the stack are no parts: what is left stays below them, to which `size` is held
    tau, size, box, piece = part[9], 1, stack[STACK - 1], stack[STACK - 2]
    # how far a point of the arm, or the body, moves for a unit of each pair: joints, coordinates, time, pushes
    weights = l1, l2, agent, agent, fastest, l1 * tau, l2 * tau
    copy(part, stack[0])
    for _ in range(GRANTED):
        if size == 0:
            return True
        size -= 1
        copy(stack[size], piece)
        moved(piece, velocity, world, box)
        bounds = body_of(box, body, start, world)
        proved, gap = separated(link, pose_of(box, world.arm), bounds, world.arm[2])
        if proved:
            continue
        if gap <= bounds[7] or size + 4 >= STACK:  # they touch in the middle of the box: no halving will help
            return False
        halve(piece, weights, stack[size], stack[size + 1])
        size += 2
    return False


@compiled(**UNCOUNTED)
def clear(bodies, part, velocity, start, world, stack):
    """Whether it is proved that both links stay clear of the bodies with numbers bodies[0] to bodies[1] - 1.

    From anywhere in a part and at all its times. True without bodies.
    """
    # The first that stays open decides.
    for body in range(bodies[0], bodies[1]):
        for link in range(2):
            if not link_clear(link, body, part, velocity, start, world, stack):
                return False
    return True


@compiled(**UNCOUNTED)
def tip_inside(part, t, world, stack):
    """Whether it is proved that the tip is inside the target at time t, s, for all states of a part.

    The tip is off its middle plus linear terms by at most half of l1 d1^2 + l2 (d1 + d2)^2, and a distance is largest
    at a corner of a parallelogram, or of the agent's cell where the agent, an evader, is the target. False, too, where
    more than `GRANTED` boxes would be needed.
    """
    moved(part, world.inputs[0], world, stack[0])  # by the error of states
    l1, l2, turn = world.arm[0], world.arm[1], world.arm[2]
    size = 1
    box = stack[STACK - 1]
    weights = (l1 + l2, l2)
    for _ in range(GRANTED):
        if size == 0:
            return True
        size -= 1
        copy(stack[size], box)
        ex, ey, fx, fy, d1, d2 = pose_of(box, world.arm)
        x, y, _, _ = disk_at(world.target, t)
        hx, hy = 0.0, 0.0
        if not world.chased:
            x, y, hx, hy = (box[4] + box[5]) / 2, (box[6] + box[7]) / 2, (box[5] - box[4]) / 2, (box[7] - box[6]) / 2
        furthest = 0.0
        for turned in (-d1, d1):
            for bent in (-d2, d2):
                off_x = ex + fx - x - (ey + turn * fy) * turned - fy * bent
                off_y = ey + fy - y + (ex + turn * fx) * turned + fx * bent
                furthest = max(furthest, math.hypot(abs(off_x) + hx, abs(off_y) + hy))
        rest = (l1 * d1 * d1 + l2 * (turn * d1 + d2) ** 2) / 2
        if furthest + rest + ROUNDING <= world.target[7]:
            continue
        outside = math.hypot(abs(ex + fx - x) + hx, abs(ey + fy - y) + hy) > world.target[7]
        if outside or size + 2 >= STACK:
            return False
        # by its joints alone: of the agent's cell all corners are counted
        halve(box, weights, stack[size], stack[size + 1])
        size += 2
    return False


# ---- the same question about many cells of the agent at once


class Bench(NamedTuple):
    """Room to work on a row: bounds of its joints and of one of the agent's cells, and arrays that are overwritten."""

    part: Array  # (BOUNDS,) see above
    low: Array  # (nx,) `beyond`
    high: Array
    stack: Array  # (STACK, BOUNDS)


@compiled(**UNCOUNTED)
def beyond(nx, ny, bound, grow, edges_x, low, high):
    """Tighten low and high (nx,), in place, so that the agent's cells above high[x] or below low[x] are beyond a link.

    A cell of column x, grown by `grow` on each side, is then more than `bound` along n = (nx, ny). ny must not be 0.
    """
    # However small ny is, dividing by it is harmless: along n an error of the level counts only ny times.
    up = 1.0 if ny > 0.0 else -1.0
    base, slope = (bound + abs(nx) * grow) / ny + up * grow, nx / ny
    shift = 0 if nx > 0.0 else 1  # the edge of the column that is behind
    if up > 0.0:
        for x in range(low.size):
            level = base - slope * edges_x[x + shift]
            high[x] = level if level < high[x] else high[x]
    else:
        for x in range(low.size):
            level = base - slope * edges_x[x + shift]
            low[x] = level if level > low[x] else low[x]


@compiled(**UNCOUNTED)
def sweep(j, duration, world, bench, bits):
    """Drop from bits (words,), in place, the agent's cells that a few directions do not prove clear of the arm.

    Under u_j, from time 0 to `duration`, s, in world.parts[j] parts, for the joints' cells of the bench.
    """
    box, parts, part = bench.stack[0], world.parts[j] if duration > 0.0 else 1, bench.part
    low, high, y, cells = bench.low, bench.high, world.y, world.y.size - 1
    for k in range(parts):
        part[8], part[9] = duration * k / parts, duration * (k + 1) / parts
        moved(part, world.inputs[j], world, box)
        pose, grow = pose_of(box, world.arm), world.agent[0] * box[9] + max(world.off[2], world.off[3]) + STATE_ERROR
        for link in range(2):
            for x in range(low.size):
                low[x], high[x] = -np.inf, np.inf
            for n in range(world.compass.shape[0] + 2):
                if n < world.compass.shape[0]:
                    nx, ny = world.compass[n, 0], world.compass[n, 1]
                else:  # the normals of the link
                    length = world.arm[link] if n % 2 else -world.arm[link]
                    nx, ny = -pose[1 + 2 * link] / length, pose[2 * link] / length
                if abs(ny) > 1e-6:
                    bound = farthest(nx, ny, link, pose, world.arm[2]) + world.agent[1] + ROUNDING
                    beyond(nx, ny, bound, grow, world.x, low, high)
            # kept from column to column, as the borders of neighbours lie near one another
            first, stop = 0, 0
            for x in range(low.size):  # of this column the cells that are neither above high[x] nor below low[x]
                while first < cells and y[first + 1] < low[x]:
                    first += 1
                while first > 0 and y[first] >= low[x]:
                    first -= 1
                while stop < cells and y[stop] <= high[x]:
                    stop += 1
                while stop > 0 and y[stop - 1] > high[x]:
                    stop -= 1
                if first < stop:
                    drop(bits, x * cells + first, x * cells + stop)
        if not any_bit(bits):
            break
