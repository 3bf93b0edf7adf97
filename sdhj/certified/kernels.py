"""Compiled kernels of the certified sets: exact set operations on packed bits, and sound bounds for the arm.

Nothing here reads a problem: `sdhj.certified.sets` prepares arrays of numbers and index tables, and its docstring lists
the proof obligations that these kernels discharge. Every kernel has a slow twin in tests/naive_certified.py. No
kernel uses fast-math: a bound must mean what it says.

A *block* holds the packed cells of one row cell: bit b of the block is bit b % 64 of its word b // 64. Where two
packed axes x and y have nx and ny cells, cell (x, y) is bit x * ny + y.

Geometry is in metres and radians. `MARGIN` is added to every radius that a pursuer, an obstacle or the edge of the
target is tested with. It covers (a) rounding: positions are sums of a few products of numbers below ten, each
operation off by at most 2^-53 of its result and sine and cosine by a few times that, so below 1e-13 m together, and
(b) states off a certified cell by up to `SLACK` on each axis, which move a point of the arm by at most
SLACK * (l1 + 2 l2) and the pursuer by 2 SLACK. Arms are a metre or so; `sdhj.certified.sets` refuses lengths above ten.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

Array = NDArray[Any]

MARGIN = 1e-8  # m
SLACK = 1e-10  # of a state's coordinate: see the docstring of sdhj.certified.sets
LINKS = 2
FULL = np.uint64(0xFFFFFFFFFFFFFFFF)


# --------------------------------------------------------------------------------------------------------------------
# Set operations
# --------------------------------------------------------------------------------------------------------------------


@njit(cache=True, inline="always")
def _shifted_word(block, word, shift):
    """Word `word` of the block moved so that bit b shows bit b + shift (zero beyond the ends)."""
    start = word * 64 + shift
    source = start >> 6  # floor, also for negative numbers
    bit = start & 63
    low = np.uint64(0)
    high = np.uint64(0)
    if 0 <= source < block.size:
        low = block[source] >> np.uint64(bit)
    if bit > 0 and 0 <= source + 1 < block.size:
        high = block[source + 1] << np.uint64(64 - bit)
    return low | high


@njit(cache=True, parallel=True)
def erode_packed(cells, shifts, passes):
    """AND of shifted copies of every block, one packed axis after the other.

    Parameters
    ----------
    cells : (R, W) uint64. To be modified in place.
    shifts : (A, K) int64
        For each packed axis, the shifts in bits; zero entries are skipped.
    passes : (A, K, W) uint64
        Bits whose shifted neighbour lies beyond a wall: they pass.
    """
    rows, words = cells.shape
    for row in prange(rows):
        block = np.empty(words, np.uint64)
        for axis in range(shifts.shape[0]):
            block[:] = cells[row]
            for k in range(shifts.shape[1]):
                shift = shifts[axis, k]
                if shift != 0:
                    for word in range(words):
                        cells[row, word] &= _shifted_word(block, word, shift) | passes[axis, k, word]


@njit(cache=True, parallel=True)
def erode_rows(cells, first, number, out):
    """out[a, i] = AND of cells[a, (first[i] + c) % n] for c < number[i], for the middle axis of (A, n, W) arrays."""
    outer, n, words = cells.shape
    for job in prange(outer * n):
        a = np.int64(job) // n
        i = np.int64(job) % n
        k = first[i]
        out[a, i] = cells[a, k]
        for _ in range(1, number[i]):
            k = k + 1 if k + 1 < n else 0
            for word in range(words):
                out[a, i, word] &= cells[a, k, word]


@njit(cache=True, parallel=True)
def add_certified(cells, first, number, allowed, clear, out, changed):
    """out |= (erosion of `cells` along the middle axis) & clear, for the row cells where `allowed`.

    Parameters
    ----------
    cells, clear, out : (A, n, W) uint64
        `out` is modified in place.
    first, number : (n,) int64
        Which cells the erosion of cell i reads, as in `erode_rows`.
    allowed, changed : (A, n) bool
        Where bits may be set; where this call set some (modified in place, never reset).
    """
    outer, n, words = cells.shape
    for a in prange(outer):
        block = np.empty(words, np.uint64)
        for i in range(n):
            if not allowed[a, i]:
                continue
            k = first[i]
            some = np.uint64(0)
            for word in range(words):
                block[word] = cells[a, k, word] & clear[a, i, word]
                some |= block[word]
            for _ in range(1, number[i]):
                if some == 0:
                    break
                k = k + 1 if k + 1 < n else 0
                some = np.uint64(0)
                for word in range(words):
                    block[word] &= cells[a, k, word]
                    some |= block[word]
            if some != 0:
                for word in range(words):
                    if block[word] & ~out[a, i, word] != 0:
                        changed[a, i] = True
                    out[a, i, word] |= block[word]


@njit(cache=True, parallel=True)
def count_bits(cells):
    """Set bits of each row of a (R, W) uint64 array; shape (R,)."""
    rows, words = cells.shape
    out = np.zeros(rows, np.int64)
    for row in prange(rows):
        total = np.int64(0)
        for word in range(words):
            v = cells[row, word]
            v = v - ((v >> np.uint64(1)) & np.uint64(0x5555555555555555))
            v = (v & np.uint64(0x3333333333333333)) + ((v >> np.uint64(2)) & np.uint64(0x3333333333333333))
            v = (v + (v >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
            v += v >> np.uint64(8)
            v += v >> np.uint64(16)
            v += v >> np.uint64(32)
            total += np.int64(v & np.uint64(127))
        out[row] = total
    return out


# --------------------------------------------------------------------------------------------------------------------
# Where the arm can be
# --------------------------------------------------------------------------------------------------------------------
# A box of joint angles [a1, b1] x [a2, b2] puts link 1 inside the convex hull of the base and the elbows at a1 and b1,
# and link 2 inside the convex hull of those elbows and the tips at the four corners, each thickened by a remainder.
# Proof: write q as the bilinear mean of the corners, that is the mean of a random corner with independent coordinates.
# By Taylor's theorem about q the first-order terms have mean zero, so the mean of the corners' tips is off the tip at q
# by at most half of l1 Var(q1) + l2 Var(phi), phi the angle of link 2, and a variable in an interval of width w has a
# variance of at most w^2 / 4. The elbow is alike with l1 alone, and a point of the link is a mean of elbow and tip.


@njit(cache=True, inline="always")
def joint_ends(low, high, slow, fast, tau0, tau1, ends):
    """Where a joint of [low, high] can be during [tau0, tau1] if its velocity stays in [slow, fast].

    `ends` (6,), modified in place: the lower end, its cosine and sine, the upper end, its cosine and sine.
    """
    ends[0] = low + min(slow * tau0, slow * tau1)
    ends[3] = high + max(fast * tau0, fast * tau1)
    ends[1], ends[2] = math.cos(ends[0]), math.sin(ends[0])
    ends[4], ends[5] = math.cos(ends[3]), math.sin(ends[3])


@njit(cache=True, inline="always")
def link_points(link, ends1, ends2, arm, x, y):
    """Points whose hull holds a link for every q of the box, up to the remainder; return (how many, remainder).

    `arm` is (l1, l2, turn): the second link has length l2 and stands at the angle turn * q1 + q2, turn 0 or 1. x and y,
    (6,), are modified in place.
    """
    l1, l2, turn = arm[0], arm[1], arm[2]
    w1, w2 = ends1[3] - ends1[0], ends2[3] - ends2[0]
    for e1 in range(2):
        x[e1], y[e1] = l1 * ends1[3 * e1 + 1], l1 * ends1[3 * e1 + 2]
    if link == 0:
        x[2], y[2] = 0.0, 0.0
        return 3, l1 * w1 * w1 / 8.0
    for e1 in range(2):
        for e2 in range(2):
            c, s = ends2[3 * e2 + 1], ends2[3 * e2 + 2]
            if turn != 0.0:
                c1, s1 = ends1[3 * e1 + 1], ends1[3 * e1 + 2]
                c, s = c1 * c - s1 * s, s1 * c + c1 * s
            x[2 + 2 * e1 + e2] = x[e1] + l2 * c
            y[2 + 2 * e1 + e2] = y[e1] + l2 * s
    return 6, (l1 * w1 * w1 + l2 * (turn * turn * w1 * w1 + w2 * w2)) / 8.0


@njit(cache=True, inline="always")
def convex_hull(x, y, n, hull_x, hull_y):
    """Counter-clockwise hull of n points (x and y are sorted in place), written to hull_x, hull_y; return its size.

    Andrew's monotone chain. hull_x and hull_y need room for 2 n points.
    """
    for i in range(1, n):
        px, py = x[i], y[i]
        k = i - 1
        while k >= 0 and (x[k] > px or (x[k] == px and y[k] > py)):
            x[k + 1], y[k + 1] = x[k], y[k]
            k -= 1
        x[k + 1], y[k + 1] = px, py
    size = 0
    least = 2  # corners that a chain needs before it can turn
    for i in range(2 * n - 1):
        k = i if i < n else 2 * n - 2 - i
        while size >= least and (
            (hull_x[size - 1] - hull_x[size - 2]) * (y[k] - hull_y[size - 2])
            <= (hull_y[size - 1] - hull_y[size - 2]) * (x[k] - hull_x[size - 2])
        ):
            size -= 1
        hull_x[size], hull_y[size] = x[k], y[k]
        size += 1
        if i == n - 1:
            least = size + 1  # the upper chain starts at the last corner of the lower one
    return max(size - 1, 1)


@njit(cache=True, inline="always")
def hull_distance(px, py, hull_x, hull_y, size):
    """Distance from a point to a convex polygon with counter-clockwise corners; 0 inside."""
    best = np.inf
    inside = size > 2
    for i in range(size):
        k = i + 1 if i + 1 < size else 0
        dx, dy = hull_x[k] - hull_x[i], hull_y[k] - hull_y[i]
        ox, oy = px - hull_x[i], py - hull_y[i]
        if dx * oy - dy * ox < 0.0:
            inside = False
        square = dx * dx + dy * dy
        s = 0.0
        if square > 0.0:
            s = min(max((dx * ox + dy * oy) / square, 0.0), 1.0)
        ox -= s * dx
        oy -= s * dy
        best = min(best, ox * ox + oy * oy)
    return 0.0 if inside else math.sqrt(best)


@njit(cache=True, inline="always")
def thick_chain(first, last, step, sign, radius, hull_x, hull_y, size, pieces):
    """The upper (sign 1) or lower (sign -1) boundary of {hull thickened by radius}, from left to right.

    The corners first, first + step, ..., last of the hull, modulo its size, are the chain: x grows along it. Its
    boundary is, in turn, an arc about a corner and the edge to the next corner moved outward. `pieces`
    (2 corners - 1, 4), modified in place: the x where the piece ends, and for an arc (nan, centre), for an edge (slope,
    a point), y times sign.
    """
    count = 0
    k = after = first
    while after != last:
        after += step
        if after == size:
            after = 0
        elif after < 0:
            after = size - 1
        dx, dy = hull_x[after] - hull_x[k], sign * (hull_y[after] - hull_y[k])
        if dx <= 0.0:  # only rounding makes a step back: the higher of the two corners stays
            k = after if dy > 0.0 else k
            continue
        length = math.sqrt(dx * dx + dy * dy)
        nx, ny = -radius * dy / length, radius * dx / length
        pieces[count, 0], pieces[count, 1] = hull_x[k] + nx, np.nan
        pieces[count, 2], pieces[count, 3] = hull_x[k], sign * hull_y[k]
        pieces[count + 1, 0], pieces[count + 1, 1] = hull_x[after] + nx, dy / dx
        pieces[count + 1, 2], pieces[count + 1, 3] = hull_x[k] + nx, sign * hull_y[k] + ny
        count += 2
        k = after
    pieces[count, 0], pieces[count, 1] = np.inf, np.nan
    pieces[count, 2], pieces[count, 3] = hull_x[k], sign * hull_y[k]


@njit(cache=True, inline="always")
def piece_height(pieces, at, xq, radius):
    """Height, times sign, of one piece of a boundary over xq."""
    off = xq - pieces[at, 2]
    slope = pieces[at, 1]
    if slope == slope:
        return pieces[at, 3] + slope * off
    return pieces[at, 3] + math.sqrt(max(radius * radius - off * off, 0.0))


@njit(cache=True, inline="always")
def block_bits(block, start, stop):
    """Set the bits start..stop-1 of a block. In place."""
    first, last = start >> 6, (stop - 1) >> 6
    head = FULL << np.uint64(start & 63)
    tail = FULL >> np.uint64(63 - ((stop - 1) & 63))
    if first == last:
        block[first] |= head & tail
    else:
        block[first] |= head
        for word in range(first + 1, last):
            block[word] = FULL
        block[last] |= tail


@njit(cache=True, inline="always")
def touch_cells(hull_x, hull_y, size, radius, growth, plane, shape, first_row, last_row, upper, lower, block):
    """Set the bits of the cells which, grown by `growth` on each side, meet the hull thickened by `radius`. In place.

    `plane` is (x of the first cell, y of the first cell, width in x, width in y), `shape` (nx, ny) cells. Only the rows
    of cells first_row <= x < last_row are looked at. The part of a convex shape over a strip has its highest point over
    the point of the strip nearest to the shape's top, so one height of each boundary decides a row of cells. `upper`
    and `lower` (12, 4) are scratch.
    """
    top, bottom = 0, 0
    upper_left, upper_right, lower_left, lower_right = 0, 0, 0, 0
    for i in range(1, size):
        px, py = hull_x[i], hull_y[i]
        top = i if py > hull_y[top] else top
        bottom = i if py < hull_y[bottom] else bottom
        if px < hull_x[upper_left] or (px == hull_x[upper_left] and py > hull_y[upper_left]):
            upper_left = i
        if px > hull_x[upper_right] or (px == hull_x[upper_right] and py > hull_y[upper_right]):
            upper_right = i
        if px < hull_x[lower_left] or (px == hull_x[lower_left] and py < hull_y[lower_left]):
            lower_left = i
        if px > hull_x[lower_right] or (px == hull_x[lower_right] and py < hull_y[lower_right]):
            lower_right = i
    thick_chain(upper_left, upper_right, -1, 1.0, radius, hull_x, hull_y, size, upper)
    thick_chain(lower_left, lower_right, 1, -1.0, radius, hull_x, hull_y, size, lower)
    x_top, x_bottom = hull_x[top], hull_x[bottom]
    x_left, x_right = hull_x[upper_left] - radius, hull_x[upper_right] + radius
    begin = max(math.floor((x_left - growth - plane[0]) / plane[2]), first_row)
    end = min(math.floor((x_right + growth - plane[0]) / plane[2]) + 1, last_row)
    up, down = 0, 0
    for row in range(begin, end):
        low = max(plane[0] + row * plane[2] - growth, x_left)
        high = min(plane[0] + (row + 1) * plane[2] + growth, x_right)
        if low > high:
            continue
        at = min(max(x_top, low), high)
        while at > upper[up, 0]:
            up += 1
        start_at = min(max(x_bottom, low), high)
        while start_at > lower[down, 0]:
            down += 1
        highest = piece_height(upper, up, at, radius)
        lowest = -piece_height(lower, down, start_at, radius)
        start = max(math.floor((lowest - growth - plane[1]) / plane[3]), 0)
        stop = min(math.floor((highest + growth - plane[1]) / plane[3]) + 1, shape[1])
        if start < stop:
            block_bits(block, row * shape[1] + start, row * shape[1] + stop)


@njit(cache=True)
def touch_swept(
    link,
    moves1,
    moves2,
    delta,
    speed,
    radius,
    arm,
    plane,
    shape,
    first_row,
    last_row,
    x,
    y,
    hull_x,
    hull_y,
    upper,
    lower,
    block,
):
    """Set the bits of the pursuer's cells from which it can meet a link during one interval. In place.

    `moves1`, `moves2` (parts, 6) say where the joints can be in each part of the interval (`joint_ends`). At the end of
    part m the pursuer is within speed * (m + 1) * delta / parts of its cell on each axis.
    """
    parts = moves2.shape[0]
    for part in range(parts):
        n, remainder = link_points(link, moves1[part], moves2[part], arm, x, y)
        size = convex_hull(x, y, n, hull_x, hull_y)
        growth = speed * delta * (part + 1) / parts
        touch_cells(
            hull_x, hull_y, size, radius + remainder, growth, plane, shape, first_row, last_row, upper, lower, block
        )


@njit(cache=True)
def joint_moves(edges, slow, fast, delta, parts, out):
    """`joint_ends` of every cell of one joint in every part of the interval; out (n, parts, 6), overwritten."""
    for i in range(out.shape[0]):
        for part in range(parts):
            tau0, tau1 = delta * part / parts, delta * (part + 1) / parts
            joint_ends(edges[i], edges[i + 1], slow, fast, tau0, tau1, out[i, part])


@njit(cache=True, parallel=True)
def pursuer_clear(moves1, moves2, delta, speed, radius, arm, plane, shape, out):
    """Cells of the pursuer which it cannot use to touch the arm during one interval under one input.

    Parameters
    ----------
    moves1 (n1, parts, 6), moves2 (n2, parts, 6) : `joint_moves` of the two joints
    delta : float, length of the interval; 0 for an instant
    speed, radius : the pursuer's greatest speed on each axis; the distance between its centre and a link at contact
    arm, plane, shape : see `link_points` and `touch_cells`
    out : (n1, n2, W) uint64, overwritten
    """
    n1, n2, words = out.shape
    bits = shape[0] * shape[1]
    for i1 in prange(n1):
        x, y = np.empty(6), np.empty(6)
        hull_x, hull_y = np.empty(12), np.empty(12)
        upper, lower = np.empty((12, 4)), np.empty((12, 4))
        block, first_link = np.empty(words, np.uint64), np.zeros(words, np.uint64)
        touch_swept(
            0, moves1[i1], moves2[0], delta, speed, radius + MARGIN, arm, plane, shape, 0, shape[0],
            x, y, hull_x, hull_y, upper, lower, first_link,
        )  # fmt: skip
        for i2 in range(n2):
            block[:] = first_link
            touch_swept(
                1, moves1[i1], moves2[i2], delta, speed, radius + MARGIN, arm, plane, shape, 0, shape[0],
                x, y, hull_x, hull_y, upper, lower, block,
            )  # fmt: skip
            for word in range(words):
                out[i1, i2, word] = ~block[word]
            if bits % 64:
                out[i1, i2, words - 1] &= (np.uint64(1) << np.uint64(bits % 64)) - np.uint64(1)


@njit(cache=True, inline="always")
def box_of(hull_x, hull_y, size):
    """(least x, greatest x, least y, greatest y) of a polygon's corners."""
    left, right, low, high = hull_x[0], hull_x[0], hull_y[0], hull_y[0]
    for i in range(1, size):
        left, right = min(left, hull_x[i]), max(right, hull_x[i])
        low, high = min(low, hull_y[i]), max(high, hull_y[i])
    return left, right, low, high


@njit(cache=True, inline="always")
def disks_met(edges, slow, fast, tau0, tau1, wanted, centres, grown, arm, ends, x, y, hull_x, hull_y):
    """Those of the `wanted` steps (bits) in which the arm may meet a disk while its joints move during [tau0, tau1].

    centres (steps, disks, 2) and grown (disks,): where the disks are and how near a link may not come to the centres.
    """
    joint_ends(edges[0], edges[1], slow[0], fast[0], tau0, tau1, ends[0])
    joint_ends(edges[2], edges[3], slow[1], fast[1], tau0, tau1, ends[1])
    met = np.uint64(0)
    for link in range(LINKS):
        n, remainder = link_points(link, ends[0], ends[1], arm, x, y)
        size = convex_hull(x, y, n, hull_x, hull_y)
        left, right, low, high = box_of(hull_x, hull_y, size)
        for step in range(centres.shape[0]):
            bit = np.uint64(1) << np.uint64(step)
            if wanted & bit == 0:
                continue
            for disk in range(grown.size):
                px, py = centres[step, disk, 0], centres[step, disk, 1]
                near = grown[disk] + remainder + MARGIN
                if px < left - near or px > right + near or py < low - near or py > high + near:
                    continue
                if hull_distance(px, py, hull_x, hull_y, size) <= near:
                    met |= bit
                    break
    return met


@njit(cache=True, parallel=True)
def disks_clear(edges1, edges2, slow, fast, delta, centres, radii, speeds, depth, arm, out):
    """Cells of the joint angles from which the arm stays clear of moving disks at every time of an interval.

    The interval is halved where it does not decide, `depth` times at most. A part whose middle instant alone is not
    clear is not halved further.

    Parameters
    ----------
    edges1, edges2, arm : as in `pursuer_clear`
    slow, fast : (L, 2) the joints' least and greatest velocity under each input
    delta : float, length of the interval; 0 with depth 0 for an instant
    centres : (2^(depth + 1) + 1, steps, disks, 2) the disks' centres, the interval of each step cut evenly
    radii, speeds : (disks,) the distance between centre and link at contact; bounds on the speed
    out : (steps, L, n1, n2) bool, overwritten; at most 64 steps
    """
    steps, inputs, n1, n2 = out.shape
    every = FULL >> np.uint64(64 - steps)
    for i1 in prange(n1):
        x, y = np.empty(6), np.empty(6)
        hull_x, hull_y = np.empty(12), np.empty(12)
        edges, ends, grown = np.empty(4), np.empty((2, 6)), np.empty(radii.size)
        part, level, open_steps = (
            np.empty(depth + 2, np.int64),
            np.empty(depth + 2, np.int64),
            np.empty(depth + 2, np.uint64),
        )
        edges[0], edges[1] = edges1[i1], edges1[i1 + 1]
        for i2 in range(n2):
            edges[2], edges[3] = edges2[i2], edges2[i2 + 1]
            for j in range(inputs):
                blocked = np.uint64(0)
                part[0], level[0], open_steps[0] = 0, 0, every
                todo = 1
                while todo > 0:
                    todo -= 1
                    here, deep, wanted = part[todo], level[todo], open_steps[todo] & ~blocked
                    pieces = 1 << deep
                    middle = (2 * here + 1) << (depth - deep)
                    for disk in range(radii.size):
                        grown[disk] = radii[disk] + speeds[disk] * delta / (2 * pieces)
                    tau0, tau1 = delta * here / pieces, delta * (here + 1) / pieces
                    wanted = disks_met(
                        edges,
                        slow[j],
                        fast[j],
                        tau0,
                        tau1,
                        wanted,
                        centres[middle],
                        grown,
                        arm,
                        ends,
                        x,
                        y,
                        hull_x,
                        hull_y,
                    )
                    if wanted == 0:
                        continue
                    if deep == depth:
                        blocked |= wanted
                        continue
                    tau = delta * (2 * here + 1) / (2 * pieces)
                    touched = disks_met(
                        edges,
                        slow[j],
                        fast[j],
                        tau,
                        tau,
                        wanted,
                        centres[middle],
                        radii,
                        arm,
                        ends,
                        x,
                        y,
                        hull_x,
                        hull_y,
                    )
                    blocked |= touched
                    wanted &= ~touched
                    if wanted != 0:
                        for half in range(2):
                            part[todo], level[todo], open_steps[todo] = 2 * here + half, deep + 1, wanted
                            todo += 1
                for step in range(steps):
                    out[step, j, i1, i2] = (blocked >> np.uint64(step)) & np.uint64(1) == 0


@njit(cache=True, parallel=True)
def tip_inside(moves1, moves2, centre, radius, arm, out):
    """Cells of the joint angles whose every tip is inside a disk; out (n1, n2) bool, overwritten.

    moves1 (n1, 1, 6), moves2 (n2, 1, 6) : `joint_moves` of joints at rest
    """
    n1, n2 = out.shape
    for i1 in prange(n1):
        x, y = np.empty(6), np.empty(6)
        for i2 in range(n2):
            n, remainder = link_points(1, moves1[i1, 0], moves2[i2, 0], arm, x, y)
            furthest = 0.0
            for corner in range(2, n):
                furthest = max(furthest, math.hypot(x[corner] - centre[0], y[corner] - centre[1]))
            out[i1, i2] = furthest + remainder + MARGIN <= radius


@njit(cache=True, parallel=True)
def tip_near_cells(moves1, moves2, radius, arm, plane, shape, out):
    """Cells of all four axes whose every tip is within `radius` of every point of the agent's cell.

    moves1, moves2 as in `tip_inside`; plane, shape as in `touch_cells`; out (n1, n2, W) uint64, overwritten.
    """
    n1, n2, _ = out.shape
    for i1 in prange(n1):
        x, y = np.empty(6), np.empty(6)
        for i2 in range(n2):
            out[i1, i2] = 0
            n, remainder = link_points(1, moves1[i1, 0], moves2[i2, 0], arm, x, y)
            for bit in range(shape[0] * shape[1]):
                left = plane[0] + (bit // shape[1]) * plane[2]
                low = plane[1] + (bit % shape[1]) * plane[3]
                furthest = 0.0
                for corner in range(2, n):
                    dx = max(abs(x[corner] - left), abs(x[corner] - left - plane[2]))
                    dy = max(abs(y[corner] - low), abs(y[corner] - low - plane[3]))
                    furthest = max(furthest, math.hypot(dx, dy))
                if furthest + remainder + MARGIN <= radius:
                    out[i1, i2, bit >> 6] |= np.uint64(1) << np.uint64(bit & 63)


# --------------------------------------------------------------------------------------------------------------------
# Questions about states
#
# Serial and without Python's lock: the controller shares batches out over threads, and only some of Numba's threading
# layers take calls of parallel kernels from several threads at once.
# --------------------------------------------------------------------------------------------------------------------


class Cells(NamedTuple):
    """The cells of every axis as arrays of shape (ndim,), and how blocks are packed."""

    lower: Array
    width: Array
    length: Array
    counts: Array
    periodic: Array
    rows: int  # leading axes that number the blocks; the others are packed


class ArmMotion(NamedTuple):
    """What one interval does to the cells of an arm and a pursuer, for `arm_inputs`.

    first, number (2, L, n) : cells that cover the image of each cell of the two joints, padded to one length
    window (2, 2, n) : first and last cell that covers the image of each cell of the pursuer's axes, padded
    moves (2, L, n, parts, 6), parts (L,) : `joint_moves` under each input, padded, and how many parts
    allowed (steps, L, n1, n2) : `disks_clear`
    delta, speed, radius, arm, plane, shape : as in `pursuer_clear`
    pursuer : False where no pursuer can touch the arm
    """

    first: Array
    number: Array
    window: Array
    moves: Array
    parts: Array
    allowed: Array
    delta: float
    speed: float
    radius: float
    arm: Array
    plane: Array
    shape: Array
    pursuer: bool


@njit(cache=True)
def cells_at(state, cells, found):
    """The cells within SLACK of a state: found[0] and found[1], (ndim,), the ones to its two sides on each axis.

    Returns False off a bounded axis.
    """
    for axis in range(state.size):
        count, length, width = cells.counts[axis], cells.length[axis], cells.width[axis]
        offset = state[axis] - cells.lower[axis]
        if cells.periodic[axis]:
            offset -= length * math.floor(offset / length)
        elif offset < -SLACK or offset > length + SLACK:
            return False
        below, above = offset - SLACK, offset + SLACK
        found[0, axis] = min(max(math.floor(below / width), 0), count - 1)
        found[1, axis] = min(max(math.floor(above / width), 0), count - 1)
        if cells.periodic[axis] and below < 0.0:
            found[0, axis] = count - 1
        if cells.periodic[axis] and above >= length:
            found[1, axis] = 0
    return True


@njit(cache=True, inline="always")
def pick(found, choice, cell):
    """One of the 2^ndim cells that `cells_at` found; False where a smaller `choice` is the same cell."""
    for axis in range(cell.size):
        side = (choice >> axis) & 1
        if side == 1 and found[0, axis] == found[1, axis]:
            return False
        cell[axis] = found[side, axis]
    return True


@njit(cache=True, inline="always")
def row_and_bit(cell, cells):
    """(row, bit) of a cell."""
    row, bit = 0, 0
    for axis in range(cell.size):
        if axis < cells.rows:
            row = row * cells.counts[axis] + cell[axis]
        else:
            bit = bit * cells.counts[axis] + cell[axis]
    return row, bit


@njit(cache=True, inline="always")
def has_bit(block, bit):
    return (block[bit >> 6] >> np.uint64(bit & 63)) & np.uint64(1) != 0


@njit(cache=True, inline="always")
def has_bits(block, start, stop):
    """Whether the bits start..stop-1 are all set."""
    for word in range(start >> 6, ((stop - 1) >> 6) + 1):
        wanted = FULL
        if word == start >> 6:
            wanted &= FULL << np.uint64(start & 63)
        if word == (stop - 1) >> 6:
            wanted &= FULL >> np.uint64(63 - ((stop - 1) & 63))
        if block[word] & wanted != wanted:
            return False
    return True


@njit(cache=True, nogil=True)
def contains(states, cells, index, pool, out):
    """Whether a certified cell is within SLACK of each of the states (M, ndim). out (M,) bool, overwritten.

    index (R,), pool (B, W) : the block of each row of the set, and the blocks
    """
    found = np.empty((2, states.shape[1]), np.int64)
    cell = np.empty(states.shape[1], np.int64)
    for m in range(states.shape[0]):
        out[m] = False
        if cells_at(states[m], cells, found):
            for choice in range(1 << cell.size):
                if pick(found, choice, cell):
                    row, bit = row_and_bit(cell, cells)
                    if has_bit(pool[index[row]], bit):
                        out[m] = True
                        break


@njit(cache=True, nogil=True)
def fewest_steps(states, cells, index, pool, out):
    """The first of nested sets with a certified cell within SLACK of each of the states (M, ndim).

    index (n, R), pool (B, W) : the blocks of each row of the n sets, each inside the next
    out (M,) int64 : 0 to n - 1, or n where none holds the state. Overwritten.
    """
    found = np.empty((2, states.shape[1]), np.int64)
    cell = np.empty(states.shape[1], np.int64)
    for m in range(states.shape[0]):
        out[m] = index.shape[0]
        if not cells_at(states[m], cells, found):
            continue
        for choice in range(1 << cell.size):
            if pick(found, choice, cell):
                row, bit = row_and_bit(cell, cells)
                least, most = 0, out[m]  # bisection: the sets before `least` do not hold the cell, `most` may
                while least < most:
                    middle = (least + most) // 2
                    if has_bit(pool[index[middle, row]], bit):
                        most = middle
                    else:
                        least = middle + 1
                out[m] = most


@njit(cache=True)
def image_certified(cell, j, motion, cells, index, pool):
    """Whether the cells that cover the image of a cell under input j are all in the set (index, pool)."""
    x0, x1 = motion.window[0, 0, cell[2]], motion.window[0, 1, cell[2]]
    y0, y1 = motion.window[1, 0, cell[3]], motion.window[1, 1, cell[3]]
    n1, n2, ny = cells.counts[0], cells.counts[1], cells.counts[3]
    i1 = motion.first[0, j, cell[0]]
    for _ in range(motion.number[0, j, cell[0]]):
        i2 = motion.first[1, j, cell[1]]
        for _ in range(motion.number[1, j, cell[1]]):
            which = index[i1 * n2 + i2]
            if which == 0:  # the empty block
                return False
            for x in range(x0, x1 + 1):
                if not has_bits(pool[which], x * ny + y0, x * ny + y1 + 1):
                    return False
            i2 = i2 + 1 if i2 + 1 < n2 else 0
        i1 = i1 + 1 if i1 + 1 < n1 else 0
    return True


@njit(cache=True)
def pursuer_meets(cell, j, motion, x, y, hull_x, hull_y, upper, lower, block):
    """Whether the pursuer of one cell can touch the arm under input j: what `pursuer_clear` says, for one cell.

    Half the margin of `pursuer_clear` is enough, and makes sure that a difference in rounding between the two never
    takes from a certified cell the input it was certified with.
    """
    radius = motion.radius + 0.5 * MARGIN
    plane, shape = motion.plane, motion.shape
    bit = cell[2] * shape[1] + cell[3]
    left = plane[0] + cell[2] * plane[2]
    low = plane[1] + cell[3] * plane[3]
    for part in range(motion.parts[j]):
        growth = motion.speed * motion.delta * (part + 1) / motion.parts[j]
        for link in range(LINKS):
            n, remainder = link_points(
                link, motion.moves[0, j, cell[0], part], motion.moves[1, j, cell[1], part], motion.arm, x, y
            )
            least_x, most_x, least_y, most_y = box_of(x, y, n)
            reach = radius + remainder + growth
            if (
                least_x - reach > left + plane[2]
                or most_x + reach < left
                or least_y - reach > low + plane[3]
                or most_y + reach < low
            ):
                continue
            size = convex_hull(x, y, n, hull_x, hull_y)
            block[bit >> 6] = 0
            touch_cells(
                hull_x,
                hull_y,
                size,
                radius + remainder,
                growth,
                plane,
                shape,
                cell[2],
                cell[2] + 1,
                upper,
                lower,
                block,
            )
            if has_bit(block, bit):
                return True
    return False


@njit(cache=True)
def arm_inputs(
    state, step, cells, motion, index, following, pool, found, cell, x, y, hull_x, hull_y, upper, lower, block, out
):
    """The inputs certified for a state: out (L,) bool, overwritten; returns whether a certified cell holds the state.

    index and following (R,) : blocks of S_k^n and S_{k+1}^{n-1} in the pool. The arrays from `found` on are scratch.
    """
    out[:] = False
    inside = False
    if not cells_at(state, cells, found):
        return False
    for choice in range(1 << cell.size):
        if not pick(found, choice, cell):
            continue
        row, bit = row_and_bit(cell, cells)
        if not has_bit(pool[index[row]], bit):
            continue
        inside = True
        for j in range(out.size):
            if out[j] or not motion.allowed[step, j, cell[0], cell[1]]:
                continue
            if not image_certified(cell, j, motion, cells, following, pool):
                continue
            if motion.pursuer and pursuer_meets(cell, j, motion, x, y, hull_x, hull_y, upper, lower, block):
                continue
            out[j] = True
    return inside


@njit(cache=True)
def arm_inputs_one(state, step, cells, motion, index, following, pool, out):
    """`arm_inputs` with scratch of its own."""
    found, cell = np.empty((2, 4), np.int64), np.empty(4, np.int64)
    x, y, hull_x, hull_y = np.empty(6), np.empty(6), np.empty(12), np.empty(12)
    upper, lower, block = np.empty((12, 4)), np.empty((12, 4)), np.empty(pool.shape[1], np.uint64)
    return arm_inputs(
        state, step, cells, motion, index, following, pool, found, cell, x, y, hull_x, hull_y, upper, lower, block, out
    )


@njit(cache=True, nogil=True)
def arm_inputs_many(states, step, cells, motion, index, following, pool, inside, out):
    """`arm_inputs` for states (M, 4): inside (M,) and out (M, L) bool, overwritten."""
    found, cell = np.empty((2, 4), np.int64), np.empty(4, np.int64)
    x, y, hull_x, hull_y = np.empty(6), np.empty(6), np.empty(12), np.empty(12)
    upper, lower, block = np.empty((12, 4)), np.empty((12, 4)), np.empty(pool.shape[1], np.uint64)
    for m in range(states.shape[0]):
        inside[m] = arm_inputs(
            states[m], step, cells, motion, index, following, pool,
            found, cell, x, y, hull_x, hull_y, upper, lower, block, out[m],
        )  # fmt: skip


# --------------------------------------------------------------------------------------------------------------------
# Any dynamics
# --------------------------------------------------------------------------------------------------------------------


@njit(cache=True, parallel=True)
def covered(inside, first, number, shape, wanted, out):
    """Whether every cell of each index box is in a set.

    inside (cells,) bool, flat; first and number (ndim, cells) int64 say which cells cover the image of each cell,
    modulo the shape; only where wanted (cells,), False elsewhere. out (cells,) bool, overwritten.
    """
    ndim = shape.size
    for i in prange(out.size):
        out[i] = False
        if not wanted[i]:
            continue
        total = 1
        for axis in range(ndim):
            total *= number[axis, i]
        fine = True
        for code in range(total):
            rest, flat, stride = code, 0, 1
            for back in range(ndim):
                axis = ndim - 1 - back
                flat += ((first[axis, i] + rest % number[axis, i]) % shape[axis]) * stride
                rest //= number[axis, i]
                stride *= shape[axis]
            if not inside[flat]:
                fine = False
                break
        out[i] = fine
