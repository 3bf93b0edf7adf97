"""Compiled proofs that what moves does not meet the arm, for whole cells and intervals, and the inputs of a state.

Nothing here reads a problem: `sdhj.certified.arm.proof` prepares the arrays.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from sdhj.common.remembering import FloatArray
from sdhj.kernels.arm import links
from sdhj.kernels.arm.links import CONTACT_MARGIN, LINKS, Agent
from sdhj.kernels.compiling import kernel
from sdhj.kernels.packed import BIT, FULL, has_bit, has_bits, set_bits


class Disks(NamedTuple):
    """Moving disks during the intervals of all steps, of which there are 64 at most; m, s."""

    # the length of an interval, and how often it is halved at most; both 0 for an instant
    delta: float
    depth: int
    # (2^(depth + 1) + 1, steps, disks, 2): at evenly spaced instants of each interval, both ends among them
    centres: FloatArray
    # (disks,): the distance between centre and link at contact; bounds on the speed
    radii: FloatArray
    speeds: FloatArray


class ArmMotion(NamedTuple):
    """The images and tubes of the cells of an arm and an agent over one interval, for `arm_inputs`."""

    # (4, L, n): for each axis, input and cell the first cell of its image, and how many; padded to length n
    first: FloatArray
    number: FloatArray
    # (2, L, n, parts, 6): `joint_moves` under each input, padded; (L,), into how many parts the interval is cut
    moves: FloatArray
    parts: FloatArray
    allowed: FloatArray  # (steps, L, n1, n2) bool: of `cells_clear`
    arm: FloatArray  # (3,): see `link_points`
    agent: Agent
    pursued: bool  # whether the agent is a pursuer, which the arm must not touch


# ---- the pursuer


@kernel()
def touch_swept(link, moves1, moves2, arm, agent, scratch, block):
    """Set in block (W,), in place, the bits of the pursuer's cells from which it can meet a link during one interval.

    At the end of part m the pursuer is within prediction_error + speed * (m + 1) * delta / parts of its cell on each
    axis.
    """
    parts = moves2.shape[0]
    rows = (0, agent.nx)
    for part in range(parts):
        n, remainder = links.link_points(link, moves1[part], moves2[part], arm, scratch)
        size = links.convex_hull(n, scratch)
        # To the end of the part, as within it the pursuer is nearer.
        growth = agent.prediction_error + agent.speed * agent.delta * (part + 1) / parts
        radius = agent.radius + CONTACT_MARGIN + remainder
        links.touch_cells(size, radius, growth, agent, rows, scratch, block)


@kernel(parallel=True)
def pursuer_clear(moves1, moves2, arm, agent, out):
    """Write to out (n1, n2, W) the pursuer's cells from which it cannot touch the arm during one interval.

    moves1 (n1, parts, 6), moves2 (n2, parts, 6) : `joint_moves` of the two joints.
    """
    n1, n2, words = out.shape
    bits = agent.nx * agent.ny
    for i1 in prange(n1):
        scratch = links.allocate_scratch()
        first_link = np.zeros(words, np.uint64)
        # Link 1 hangs on the first joint alone: it is looked at once for all of the second.
        touch_swept(0, moves1[i1], moves2[0], arm, agent, scratch, first_link)
        for i2 in range(n2):
            block = first_link.copy()
            touch_swept(1, moves1[i1], moves2[i2], arm, agent, scratch, block)
            for word in range(words):
                out[i1, i2, word] = ~block[word]
            # Bits past the last cell stay 0, as sets are compared and counted word by word.
            if bits % 64:
                out[i1, i2, words - 1] &= (BIT << np.uint64(bits % 64)) - BIT


# ---- disks whose path is known


@kernel(inline="always")
def joints_during(cell, tau0, tau1, scratch):
    """Write `joint_ends` of both joints during [tau0, tau1], s since the interval began, to scratch.ends."""
    for joint in range(2):
        low, high, slow, fast = cell[joint, 0], cell[joint, 1], cell[joint, 2], cell[joint, 3]
        links.joint_ends(low, high, slow, fast, tau0, tau1, scratch.ends[joint])


@kernel(inline="always")
def disks_met(disks, instant, near, wanted, arm, scratch):
    """A word with those of the `wanted` steps, as bits, in which the arm within scratch.ends may meet a disk.

    The disks are within a time `near`, s, of where they are at an `instant`, a number in `Disks.centres`.
    """
    met = np.uint64(0)
    centres, radii, speeds = disks.centres[instant], disks.radii, disks.speeds
    for link in range(LINKS if wanted != 0 else 0):
        n, remainder = links.link_points(link, scratch.ends[0], scratch.ends[1], arm, scratch)
        size = links.convex_hull(n, scratch)
        left, right, low, high = links.box_of(scratch.hull_x, scratch.hull_y, size)
        for step in range(len(centres)):
            bit = BIT << np.uint64(step)
            if wanted & bit == 0:
                continue
            for disk in range(radii.size):
                px, py = centres[step, disk, 0], centres[step, disk, 1]
                gap = radii[disk] + speeds[disk] * near + remainder + CONTACT_MARGIN
                if px < left - gap or px > right + gap or py < low - gap or py > high + gap:
                    continue
                if links.hull_distance(px, py, size, scratch) <= gap:
                    met |= bit
                    break
    return met


@kernel()
def steps_blocked(cell, disks, arm, scratch, wanted):
    """A word of the steps, as bits, in whose interval the arm may meet a disk from a cell (`joints_during`).

    The interval is halved where this stays open. Where already the arm at the middle instant may meet a disk that is
    there, halving would not help. wanted (depth + 1,) : overwritten with the steps that each level has to decide.
    """
    # a step is a bit of one word: `ArmProof.of` refuses more than 64 (`MARKED_STEPS`)
    blocked = np.uint64(0)
    deep, here = 0, 0
    wanted[0] = FULL >> np.uint64(64 - disks.centres.shape[1])
    while here >> deep == 0:  # part `here` of 2^deep is at hand
        span = disks.delta / (1 << deep)
        instant = (2 * here + 1) << (disks.depth - deep)
        left = wanted[deep] & ~blocked
        if left != 0:
            joints_during(cell, span * here, span * (here + 1), scratch)
            left = disks_met(disks, instant, span / 2, left, arm, scratch)
            if deep == disks.depth:
                blocked |= left
            elif left != 0:
                joints_during(cell, span * (here + 0.5), span * (here + 0.5), scratch)
                blocked |= disks_met(disks, instant, 0.0, left, arm, scratch)
            left &= ~blocked
        if left != 0:
            deep, here = deep + 1, 2 * here
            wanted[deep] = left
        else:
            while here & 1:
                deep, here = deep - 1, here >> 1
            here += 1
    return blocked


@kernel(parallel=True)
def cells_clear(ends1, ends2, velocities, disks, arm, out):
    """out[step, j, i1, i2] = whether the arm surely stays clear of moving disks from a cell of the joints under u_j.

    ends1 (n1, 2), ends2 (n2, 2) : the least and the greatest angle of each cell. velocities (2, L, 2) : likewise, of
        both joints under each input. out (steps, L, n1, n2) : overwritten.
    """
    steps, inputs, n1, n2 = out.shape
    for i1 in prange(n1):
        scratch = links.allocate_scratch()
        cell = np.empty((2, 4))
        wanted = np.empty(disks.depth + 1, np.uint64)
        cell[0, 0], cell[0, 1] = ends1[i1, 0], ends1[i1, 1]
        for i2 in range(n2):
            cell[1, 0], cell[1, 1] = ends2[i2, 0], ends2[i2, 1]
            for j in range(inputs):
                for joint in range(2):
                    cell[joint, 2], cell[joint, 3] = velocities[joint, j, 0], velocities[joint, j, 1]
                # All steps at once: the arm is the same in each, and only where disks are differs.
                blocked = steps_blocked(cell, disks, arm, scratch, wanted)
                for step in range(steps):
                    out[step, j, i1, i2] = (blocked >> np.uint64(step)) & BIT == 0


# ---- tips inside the target


@kernel(parallel=True)
def tips_within(moves1, moves2, radius, arm, agent, out):
    """Write to out (n1, n2, W) the cells whose every tip is within `radius` of wherever the agent may be.

    moves1 (n1, 1, 6), moves2 (n2, 1, 6) : `joint_moves` of joints at rest.
    """
    n1, n2, _ = out.shape
    for i1 in prange(n1):
        scratch = links.allocate_scratch()
        for i2 in range(n2):
            out[i1, i2] = 0
            n, remainder = links.link_points(1, moves1[i1, 0], moves2[i2, 0], arm, scratch)
            for bit in range(agent.nx * agent.ny):
                # Wider by E on all sides, as the agent may be off what is predicted of it by that.
                left = agent.x + (bit // agent.ny) * agent.width_x - agent.prediction_error
                low = agent.y + (bit % agent.ny) * agent.width_y - agent.prediction_error
                right, high = (
                    left + agent.width_x + 2 * agent.prediction_error,
                    low + agent.width_y + 2 * agent.prediction_error,
                )
                furthest = 0.0
                # behind the two elbows, which `link_points` writes first; `convex_hull` would sort them
                for corner in range(2, n):
                    dx = max(abs(scratch.x[corner] - left), abs(scratch.x[corner] - right))
                    dy = max(abs(scratch.y[corner] - low), abs(scratch.y[corner] - high))
                    furthest = max(furthest, math.hypot(dx, dy))
                if furthest + remainder + CONTACT_MARGIN <= radius:
                    set_bits(out[i1, i2], bit, bit + 1)


# ---- the inputs of a cell


@kernel()
def image_certified(cell, j, motion, cells, index, pool):
    """Whether the image of a cell (4,) under input j is all in a set, the blocks pool[index]; block 0 is empty."""
    x0, y0 = motion.first[2, j, cell[2]], motion.first[3, j, cell[3]]
    x1, y1 = x0 + motion.number[2, j, cell[2]], y0 + motion.number[3, j, cell[3]]
    n1, n2, ny = cells.counts[0], cells.counts[1], cells.counts[3]
    i1 = motion.first[0, j, cell[0]]
    for _ in range(motion.number[0, j, cell[0]]):
        i2 = motion.first[1, j, cell[1]]
        for _ in range(motion.number[1, j, cell[1]]):
            which = index[i1 * n2 + i2]
            # a pool of `CellSets` has it first
            if which == 0:  # the empty block
                return False
            for x in range(x0, x1):
                if not has_bits(pool[which], x * ny + y0, x * ny + y1):
                    return False
            i2 = i2 + 1 if i2 + 1 < n2 else 0
        i1 = i1 + 1 if i1 + 1 < n1 else 0
    return True


@kernel()
def pursuer_meets(cell, j, motion, scratch, block):
    """Whether the pursuer of a cell (4,) may touch the arm under input j, by half the margin of `pursuer_clear`."""
    # So a difference in rounding between the two never takes from a certified cell the input it was certified with.
    agent = motion.agent
    parts = motion.parts[j]
    rows = (cell[2], cell[2] + 1)
    bit = cell[2] * agent.ny + cell[3]
    left, low = agent.x + cell[2] * agent.width_x, agent.y + cell[3] * agent.width_y
    for part in range(parts):
        growth = agent.prediction_error + agent.speed * agent.delta * (part + 1) / parts
        ends1, ends2 = motion.moves[0, j, cell[0], part], motion.moves[1, j, cell[1], part]
        for link in range(LINKS):
            n, remainder = links.link_points(link, ends1, ends2, motion.arm, scratch)
            radius = agent.radius + 0.5 * CONTACT_MARGIN + remainder
            least_x, most_x, least_y, most_y = links.box_of(scratch.x, scratch.y, n)
            distance = radius + growth
            beside = least_x - distance > left + agent.width_x or most_x + distance < left
            if beside or least_y - distance > low + agent.width_y or most_y + distance < low:
                continue
            block[bit >> 6] = 0
            links.touch_cells(links.convex_hull(n, scratch), radius, growth, agent, rows, scratch, block)
            if has_bit(block, bit):
                return True
    return False


@kernel(nogil=True)
def arm_inputs(some, steps_left, step, cells, motion, sets, pool, out):
    """out[m, j] &= whether input j is certified for the cell some[m] (4,), steps_left[m] steps to go; in place.

    sets, pool, steps_left : as for `certified_inputs`.
    """
    scratch = links.allocate_scratch()
    block = np.empty((motion.agent.nx * motion.agent.ny + 63) // 64, np.uint64)
    for m in range(len(some)):
        cell = some[m]
        # Of step counts beyond the last set, the last one is asked.
        following = max(min(steps_left[m], len(sets)) - 1, 0)
        for j in range(out.shape[1]):
            out[m, j] = out[m, j] and steps_left[m] > 0 and motion.allowed[step, j, cell[0], cell[1]]
            if out[m, j] and len(sets) > 0:
                out[m, j] = image_certified(cell, j, motion, cells, sets[following], pool)
            if out[m, j]:
                out[m, j] = not (motion.pursued and pursuer_meets(cell, j, motion, scratch, block))
