"""What a coupled adversary can do, in plain loops and by brute force; nothing is imported from sdhj."""

import itertools
import math

import naive
import numpy as np


def maximum_over_segment(values, half, lower, spacing, periodic):
    """max over |c| <= 1 of the interpolant at x + c half, at each node x: at its ends and where it crosses nodes."""
    shares = {-1.0, 1.0}
    for reach, h in zip(half, spacing, strict=True):
        cells = abs(reach) / h
        shares |= {m / cells for m in range(-math.floor(cells), math.floor(cells) + 1)} if cells else set()
    out = np.full(values.shape, -np.inf)
    for index in np.ndindex(values.shape):
        x = [low + i * h for low, i, h in zip(lower, index, spacing, strict=True)]
        for c in shares:
            point = [a + c * b for a, b in zip(x, half, strict=True)]
            out[index] = max(out[index], naive.interpolate(values, lower, spacing, periodic, point))
    return out


def vertices(halves):
    """Corners of the sum of the segments from -half to half, halves (K, ndim), and points within: (2^K, ndim)."""
    signs = np.array(list(itertools.product((-1.0, 1.0), repeat=len(halves))))
    return signs @ np.asarray(halves)


def points_of(halves, apart):
    """Points (P, ndim) of that sum: its corners, and points no farther `apart`, one in a square."""
    each = [np.linspace(-1.0, 1.0, 2 + math.ceil(2 * np.abs(half).max() / apart)) for half in halves]
    points = np.array(list(itertools.product(*each))) @ np.asarray(halves)
    some = np.unique(np.round(points / apart), axis=0, return_index=True)[1]
    return np.concatenate([vertices(halves), points[some]])


def polygon(points):
    """The corners of the convex hull of points in the plane, in order (Andrew's monotone chain)."""

    def turn(a, b, c):
        return (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0])

    def half(points):
        chain = []
        for p in points:
            while len(chain) > 1 and turn(chain[-2], chain[-1], p) <= 1e-12:
                chain.pop()
            chain.append(p)
        return chain[:-1]

    points = [np.array(p) for p in sorted(set(map(tuple, np.round(points, 12).tolist())))]
    return np.array(half(points) + half(points[::-1]))


def distance(points, corners):
    """From points (M, 2) to a convex polygon, or a segment, given by its corners in order; 0 within."""
    least, inside = np.full(len(points), np.inf), np.full(len(points), len(corners) > 2)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along, off = b - a, points - a
        share = np.clip(off @ along / (along @ along), 0.0, 1.0)
        least = np.minimum(least, np.hypot(*(off - share[:, None] * along).T))
        inside &= along[0] * off[:, 1] - along[1] * off[:, 0] >= 0.0
    return np.where(inside, 0.0, least)


def interpolated(values, lower, spacing, periodic, points):
    """Bilinear interpolation at points (M, 2); past a bounded end as at the end."""
    shape, base, share = values.shape, [], []
    for axis in range(2):
        at = (points[:, axis] - lower[axis]) / spacing[axis]
        at = at if periodic[axis] else np.clip(at, 0.0, shape[axis] - 1.0)
        left = np.floor(at).astype(int) if periodic[axis] else np.minimum(at.astype(int), shape[axis] - 2)
        base.append(left)
        share.append(at - left)
    total = 0.0
    for i, j in itertools.product((0, 1), repeat=2):
        weight = (share[0] if i else 1 - share[0]) * (share[1] if j else 1 - share[1])
        total = total + weight * values[(base[0] + i) % shape[0], (base[1] + j) % shape[1]]
    return total


def shares_won(lower, upper, shape, periodic, drifts, halves, disks, target, delta, steps):
    """As `shares_of`, where each input adds a drift to the sum of the segments from -half to half, per second."""
    n = [k - (not closed) for k, closed in zip(shape, periodic, strict=True)]
    apart = 0.7 * min((b - a) / k for a, b, k in zip(lower, upper, n, strict=True))
    net, corners = points_of(delta * np.asarray(halves), apart), delta * vertices(halves)
    sets = [(delta * np.asarray(drift) + net, delta * np.asarray(drift) + corners) for drift in drifts]
    return shares_of(lower, upper, shape, periodic, sets, disks, target, steps)


def shares_of(lower, upper, shape, periodic, sets, disks, target, steps):
    """Shares of nodes from which the target is reached within 0 to `steps` intervals, disks never met: brute force.

    sets : for each input a dense net of the displacements (P, 2) that the adversary may bring about, and those at the
        corners of their hull. Nodes look up the next values at the net; the tube of an input is the hull of the state
        and of what it may come to, whose distance to a disk (x, y, radius) is exact. Off a bounded axis all is lost.
    """
    n = [k - (not closed) for k, closed in zip(shape, periodic, strict=True)]
    spacing = [(b - a) / k for a, b, k in zip(lower, upper, n, strict=True)]
    axes = [a + h * np.arange(k) for a, h, k in zip(lower, spacing, shape, strict=True)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    laps = [(0.0, b - a, a - b) if closed else (0.0,) for a, b, closed in zip(lower, upper, periodic, strict=True)]

    def met(cone):  # > 0 where a disk may be met
        levels = [
            r - distance(np.array([x, y]) - nodes - lap, cone) for x, y, r in disks for lap in itertools.product(*laps)
        ]
        return np.max(levels, axis=0)

    walls = []
    for _, reached in sets:
        wall = met(polygon(np.concatenate([reached, [[0.0, 0.0]]])))
        for end in reached:
            gone = (nodes + end < np.array(lower) - 1e-9) | (nodes + end > np.array(upper) + 1e-9)
            wall = np.where((gone & ~np.array(periodic)).any(axis=1), np.maximum(wall, 1.0), wall)
        walls.append(wall)
    here = np.max([r - np.hypot(*(nodes - [x, y]).T) for x, y, r in disks], axis=0)
    won = np.maximum(target(nodes), here)
    shares = [np.mean(won <= 0)]
    for _ in range(steps):
        values, following = won.reshape(shape), won
        for (net, _), wall in zip(sets, walls, strict=True):
            most = np.full(len(nodes), -np.inf)
            for end in net:
                most = np.maximum(most, interpolated(values, lower, spacing, periodic, nodes + end))
            following = np.minimum(following, np.maximum(most, wall))
        won = following
        shares.append(np.mean(won <= 0))
    return shares
