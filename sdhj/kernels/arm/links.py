"""Compiled bounds on where the two links of an arm are for all joint angles of a box, and which cells they touch.

Nothing here reads a problem. No kernel uses fast-math: a bound must mean what it says.

Geometry is in metres and radians. `CONTACT_MARGIN` is added to every radius that a pursuer, an obstacle or the edge of
the target is tested with. It covers (a) rounding: positions are sums of a few products of numbers below ten, each
operation off by at most 2^-53 of its result and sine and cosine by a few times that, so below 1e-13 m together, and
(b) states off a certified cell by up to `STATE_SLACK` on each axis, which move a point of the arm by at most
STATE_SLACK * (l1 + 2 l2) and the pursuer by 2 STATE_SLACK. Arms are a metre or so; `sdhj.certified.arm` refuses
lengths above ten.
"""

import math
from typing import NamedTuple

import numpy as np

from sdhj.common.remembering import FloatArray
from sdhj.kernels.compiling import kernel
from sdhj.kernels.packed import set_bits

CONTACT_MARGIN = 1e-8  # m
LINKS = 2


class Agent(NamedTuple):
    """How the agent moves in an interval, and its cells: where the first begins, how wide one is, how many; m, s."""

    delta: float  # length of the interval; 0 for an instant
    speed: float  # the greatest on each axis
    radius: float  # distance between its centre and a link at contact
    x: float
    y: float
    width_x: float
    width_y: float
    nx: int
    ny: int
    prediction_error: float = 0.0  # by how much it may be out of its cell already


class LinkScratch(NamedTuple):
    """Arrays that are overwritten, for one thread; made by `allocate_scratch`."""

    # (6,), (12,): points, and the corners of their hull
    x: FloatArray
    y: FloatArray
    hull_x: FloatArray
    hull_y: FloatArray
    chains: FloatArray  # (2, 12, 4): the pieces of the upper and the lower boundary of the thick hull (`thick_chain`)
    ends: FloatArray  # (2, 6): of both joints (`joint_ends`)


@kernel(forceinline=True)
def allocate_scratch():
    """A new `LinkScratch`, to be used by one thread."""
    return LinkScratch(np.empty(6), np.empty(6), np.empty(12), np.empty(12), np.empty((2, 12, 4)), np.empty((2, 6)))


# ---- where the arm can be
#
# A box of joint angles [a1, b1] x [a2, b2] puts link 1 inside the convex hull of the base and the elbows at a1 and b1,
# and link 2 inside the convex hull of those elbows and the tips at the four corners, each thickened by a remainder.
# Proof: write q as the bilinear mean of the corners, that is the mean of a random corner with independent coordinates.
# By Taylor's theorem about q the first-order terms have mean zero, so the mean of the corners' tips is off the tip at q
# by at most half of l1 Var(q1) + l2 Var(phi), phi the angle of link 2, and a variable in an interval of width w has a
# variance of at most w^2 / 4. The elbow is alike with l1 alone, and a point of the link is a mean of elbow and tip.


@kernel(inline="always")
def joint_ends(low, high, slow, fast, tau0, tau1, ends):
    """Write to ends (6,) where a joint from [low, high], with a velocity in [slow, fast], can be during [tau0, tau1].

    The lower end, its cosine and sine, the upper end, its cosine and sine.
    """
    ends[0] = low + min(slow * tau0, slow * tau1)
    ends[3] = high + max(fast * tau0, fast * tau1)
    ends[1], ends[2] = math.cos(ends[0]), math.sin(ends[0])
    ends[4], ends[5] = math.cos(ends[3]), math.sin(ends[3])


@kernel()
def joint_moves(ends, slow, fast, delta, parts):
    """`joint_ends` of every cell of one joint, ends (n, 2), in each of equal parts of an interval: (n, parts, 6)."""
    out = np.empty((len(ends), parts, 6))
    for i in range(len(out)):
        for part in range(parts):
            # `ArmProof` keeps them for all cells, as `pursuer_clear`, `tips_within` and `pursuer_meets` ask again and
            # again.
            tau0, tau1 = delta * part / parts, delta * (part + 1) / parts
            joint_ends(ends[i, 0], ends[i, 1], slow, fast, tau0, tau1, out[i, part])
    return out


@kernel(forceinline=True)
def link_points(link, ends1, ends2, arm, scratch):
    """Write points whose hull, thickened by a remainder, holds a link (0 or 1) for all joint angles of a box.

    To scratch.x and scratch.y; returns (how many, remainder, m).
    """
    l1, l2, turn = arm[0], arm[1], arm[2]
    x, y = scratch.x, scratch.y
    w1, w2 = ends1[3] - ends1[0], ends2[3] - ends2[0]
    for e1 in range(2):
        x[e1], y[e1] = l1 * ends1[3 * e1 + 1], l1 * ends1[3 * e1 + 2]
    # For link 1 the base and two elbows; `tips_within` counts on elbows being first.
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


@kernel(forceinline=True)
def convex_hull(n, scratch):
    """Write the counter-clockwise hull of the first n points to scratch.hull_x and hull_y; how many corners it has.

    Andrew's monotone chain, from the leftmost, lowest point; scratch.x, y are sorted in place.
    """
    x, y = scratch.x, scratch.y
    hull_x, hull_y = scratch.hull_x, scratch.hull_y
    # Sorted by insertion: there are six points at most.
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
    # `touch_cells` counts on the first corner being the leftmost, lowest one
    return max(size - 1, 1)


@kernel(forceinline=True)
def box_of(x, y, n):
    """(least x, greatest x, least y, greatest y) of the first n points."""
    left, right, low, high = x[0], x[0], y[0], y[0]
    for i in range(1, n):
        left, right = min(left, x[i]), max(right, x[i])
        low, high = min(low, y[i]), max(high, y[i])
    return left, right, low, high


@kernel(forceinline=True)
def hull_distance(px, py, size, scratch):
    """The distance of the point (px, py) from the hull with `size` corners that `convex_hull` left; 0 inside."""
    hull_x, hull_y = scratch.hull_x, scratch.hull_y
    best = np.inf
    inside = size > 2
    for i in range(size):
        k = i + 1 if i + 1 < size else 0
        dx, dy = hull_x[k] - hull_x[i], hull_y[k] - hull_y[i]
        ox, oy = px - hull_x[i], py - hull_y[i]
        # Corners go counter-clockwise, so a point inside is at the left of every edge.
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


# ---- the pursuer's cells that the thick hull touches


@kernel(forceinline=True)
def thick_chain(first, last, step, radius, size, scratch, pieces):
    """Write the upper (step -1) or lower (step 1) boundary of a hull thickened by `radius` to pieces, left to right.

    The corners first, first + step, ..., last of the hull, modulo its size, along which x grows: in turn an arc about a
    corner and the edge to the next one moved outward. pieces (2 corners - 1, 4) : the x where the piece ends, and for
    an arc (nan, centre), for an edge (slope, a point), y times -step.
    """
    hull_x, hull_y = scratch.hull_x, scratch.hull_y
    sign = -float(step)
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


@kernel(inline="always")
def piece_height(pieces, at, xq, radius):
    """The height over xq, times the sign of its chain, of piece number `at` of `thick_chain`, an edge or an arc."""
    off = xq - pieces[at, 2]
    slope = pieces[at, 1]
    if slope == slope:
        return pieces[at, 3] + slope * off
    return pieces[at, 3] + math.sqrt(max(radius * radius - off * off, 0.0))


@kernel(forceinline=True)
def touch_cells(size, radius, growth, agent, rows, scratch, block):
    """Set in block (W,), in place, the agent's cells that, grown by `growth`, meet a hull thickened by `radius`.

    Only rows[0] <= x < rows[1] are looked at. The part of a convex shape over a strip is highest nearest to the shape's
    top, so one height of each boundary decides a row of cells.
    """
    hull_x, hull_y = scratch.hull_x, scratch.hull_y
    upper, lower = scratch.chains[0], scratch.chains[1]
    top, bottom, lower_right, upper_right = 0, 0, 0, 0  # the hull begins at its lower left corner
    for i in range(1, size):
        top = i if hull_y[i] > hull_y[top] else top
        bottom = i if hull_y[i] < hull_y[bottom] else bottom
        lower_right = i if hull_x[i] > hull_x[lower_right] else lower_right
        upper_right = i if hull_x[i] >= hull_x[upper_right] else upper_right
    thick_chain(size - 1 if hull_x[size - 1] == hull_x[0] else 0, upper_right, -1, radius, size, scratch, upper)
    thick_chain(0, lower_right, 1, radius, size, scratch, lower)
    x_left, x_right = hull_x[0] - radius, hull_x[upper_right] + radius
    begin = max(math.floor((x_left - growth - agent.x) / agent.width_x), rows[0])
    end = min(math.floor((x_right + growth - agent.x) / agent.width_x) + 1, rows[1])
    up, down = 0, 0
    for row in range(begin, end):
        low = max(agent.x + row * agent.width_x - growth, x_left)
        high = min(agent.x + (row + 1) * agent.width_x + growth, x_right)
        if low > high:
            continue
        x_top, x_bottom = min(max(hull_x[top], low), high), min(max(hull_x[bottom], low), high)
        # Rows go from left to right, and so do the pieces under them: none is looked at twice.
        while x_top > upper[up, 0]:
            up += 1
        while x_bottom > lower[down, 0]:
            down += 1
        highest = piece_height(upper, up, x_top, radius)
        lowest = -piece_height(lower, down, x_bottom, radius)
        start = max(math.floor((lowest - growth - agent.y) / agent.width_y), 0)
        stop = min(math.floor((highest + growth - agent.y) / agent.width_y) + 1, agent.ny)
        if start < stop:
            set_bits(block, row * agent.ny + start, row * agent.ny + stop)
