"""Slow twins of the compiled kernels, in plain loops and textbook form. Imports nothing from sdhj."""

import itertools
import math

import numpy as np


def ghost(values, index, shape, periodic):
    """Value at a multi-index that may leave the grid: wrapped on a periodic axis, held at a wall."""
    inside = tuple(
        i if 0 <= i < n else i % n if wraps else min(max(i, 0), n - 1)
        for i, n, wraps in zip(index, shape, periodic, strict=True)
    )
    return float(values[inside])


def eno_derivatives(line, order, dx):
    """p- and p+ at the middle of `line` (7 values) by Newton's divided differences with the smoothest stencil.

    Osher & Fedkiw, Level Set Methods and Dynamic Implicit Surfaces (2003), Sec. 3.3.
    """
    centre = 3
    d1 = [(line[i + 1] - line[i]) / dx for i in range(6)]  # at i + 1/2
    d2 = {i: (d1[i] - d1[i - 1]) / (2 * dx) for i in range(1, 6)}  # at i
    d3 = {i: (d2[i + 1] - d2[i]) / (3 * dx) for i in range(1, 5)}  # at i + 1/2
    result = []
    for k in (centre - 1, centre):
        p = d1[k]
        if order >= 2:
            left = abs(d2[k]) < abs(d2[k + 1])
            c = d2[k] if left else d2[k + 1]
            p += c * (2 * (centre - k) - 1) * dx
            if order >= 3:
                start = k - 1 if left else k
                c = d3[start] if abs(d3[start]) < abs(d3[start + 1]) else d3[start + 1]
                p += c * (3 * (centre - start) ** 2 - 6 * (centre - start) + 2) * dx * dx
        result.append(p)
    return result


def axis_hamiltonian(p, a, b):
    return max(a * p, b * p)


def godunov(minus, plus, a, b):
    """Extremum of H over the interval between the two differences: H is piecewise linear, so ends and zero suffice."""
    candidates = [minus, plus] + ([0.0] if min(minus, plus) <= 0.0 <= max(minus, plus) else [])
    values = [axis_hamiltonian(p, a, b) for p in candidates]
    return max(values) if minus <= plus else min(values)


def lax_friedrichs(minus, plus, a, b):
    return axis_hamiltonian((minus + plus) / 2, a, b) + max(abs(a), abs(b)) * (plus - minus) / 2


def derivatives_at(values, index, axis, spacing, periodic, order):
    """The left and the right derivative along one axis at a node, from three nodes to each side."""
    line = []
    for offset in range(-3, 4):
        moved = list(index)
        moved[axis] += offset
        line.append(ghost(values, moved, values.shape, periodic))
    return eno_derivatives(line, order, spacing[axis])


def right_hand_side(values, spacing, periodic, lower, upper, order, flux):
    """H(x, D Phi) at every node; lower, upper (ndim, *shape)."""
    shape = values.shape
    numerical = {"godunov": godunov, "lax-friedrichs": lax_friedrichs}[flux]
    out = np.zeros(shape)
    for index in itertools.product(*(range(n) for n in shape)):
        for axis in range(len(shape)):
            minus, plus = derivatives_at(values, index, axis, spacing, periodic, order)
            out[index] += numerical(minus, plus, lower[(axis, *index)], upper[(axis, *index)])
    return out


def coupled_right_hand_side(values, spacing, periodic, drift, gain, order):
    """Lax-Friedrichs: max over modes of p . drift + sum_d |p . gain_d|; drift (modes, ndim), gain (modes, ndim, D)."""
    shape = values.shape
    ndim = len(shape)
    alpha = [max(abs(f[i]) + np.abs(g[i]).sum() for f, g in zip(drift, gain, strict=True)) for i in range(ndim)]
    out = np.zeros(shape)
    for index in itertools.product(*(range(n) for n in shape)):
        mean, dissipation = np.zeros(ndim), 0.0
        for axis in range(ndim):
            minus, plus = derivatives_at(values, index, axis, spacing, periodic, order)
            mean[axis] = (minus + plus) / 2
            dissipation += alpha[axis] * (plus - minus) / 2
        out[index] = dissipation + max(
            mean @ f + sum(abs(mean @ g[:, d]) for d in range(g.shape[1])) for f, g in zip(drift, gain, strict=True)
        )
    return out


def evolve(values, rhs, duration, steps, integrator, obstacle=None, timed=False):
    """Runge-Kutta in time with rhs(values), or rhs(values, tau) where timed; obstacle(tau): values stay above it."""
    dt = duration / steps

    def euler(phi, tau):
        return phi + dt * (rhs(phi, tau) if timed else rhs(phi))

    def clamp(phi, tau):
        return phi if obstacle is None else np.maximum(phi, obstacle(tau))

    phi = clamp(np.array(values, dtype=float), 0.0)
    for step in range(steps):
        t = step * dt
        if integrator == "euler":
            phi = clamp(euler(phi, t), t + dt)
        elif integrator == "rk2":
            one = clamp(euler(phi, t), t + dt)
            phi = clamp(phi / 2 + euler(one, t + dt) / 2, t + dt)
        else:
            one = clamp(euler(phi, t), t + dt)
            two = clamp(3 / 4 * phi + euler(one, t + dt) / 4, t + dt / 2)
            phi = clamp(phi / 3 + 2 / 3 * euler(two, t + dt / 2), t + dt)
    return phi


def interpolate(values, lower, spacing, periodic, point):
    """Multilinear interpolation at one point."""
    shape = values.shape
    total = 0.0
    position = [(x - lo) / h for x, lo, h in zip(point, lower, spacing, strict=True)]
    base = [math.floor(s) for s in position]
    for bits in itertools.product((0, 1), repeat=len(shape)):
        weight, index = 1.0, []
        for s, b, bit in zip(position, base, bits, strict=True):
            weight *= (s - b) if bit else 1 - (s - b)
            index.append(b + bit)
        if weight > 0:
            total += weight * ghost(values, index, shape, periodic)
    return total


def maximum_over_interval(line, low, high, periodic):
    """max over y in [i + low, i + high] (in cells) of the linear interpolant of a 1-D array, for each node i."""
    n = len(line)
    out = np.empty(n)
    for i in range(n):
        a, b = i + low, i + high
        if not periodic:
            a, b = min(max(a, 0), n - 1), min(max(b, 0), n - 1)
        candidates = [a, b, *range(math.ceil(a), math.floor(b) + 1)]
        out[i] = max(interpolate(line, [0.0], [1.0], [periodic], [y]) for y in candidates)
    return out


def recursion(goals, reach, avoid):
    """Algorithm 1, k <= i: goals[k]; reach(values, k) -> list of L; avoid[k][j]. Gives tubes[k, n], marks[k, n, j]."""
    steps = len(goals) - 1
    tubes, marks = {}, {}
    for i in range(steps, -1, -1):
        for k in range(0, i + 1):
            n = min(steps - i, steps - k)
            if n == 0:
                tubes[k, 0] = goals[k]
                continue
            tube = tubes[k, n - 1]
            for j, values in enumerate(reach(tubes[k + 1, n - 1], k)):
                both = np.maximum(values, avoid[k][j])
                marks[k, n, j] = both <= 0
                tube = np.minimum(tube, both)
            tubes[k, n] = tube
    return tubes, marks


# ---- games on one axis in closed form: dx = f(t) + b(t) v, |v| <= c(t); sets are lists of disjoint intervals (a, b)


def displacements(velocity, begin, end, parts=1000):
    """Integral of velocity(t) from `begin` to every `parts`-th of the way to `end`, by Simpson's rule: parts + 1."""
    h, total, found = (end - begin) / parts, 0.0, [0.0]
    for part in range(parts):
        t = begin + part * h
        total += h / 6 * (velocity(t) + 4 * velocity(t + h / 2) + velocity(t + h))
        found.append(total)
    return found


def united(intervals):
    """The union of intervals as disjoint ones, ascending."""
    merged = []
    for a, b in sorted(intervals):
        if merged and a <= merged[-1][1]:
            merged[-1] = (merged[-1][0], max(b, merged[-1][1]))
        else:
            merged.append((a, b))
    return merged


def interval_game(goals, low, high, wall):
    """Theorem 2 with intervals: goals[k] a list of them; low[k][j], high[k][j] the extreme displacements under u_j at
    some times from step k to step k + 1, and wall[k] where the wall is: unsafe is x >= wall. Returns tubes[k, n] and
    marked[k, n, j], both lists of intervals.

    All x from which u_j leads into (a, b) whatever the adversary does: x + low > a and x + high < b at the end; and
    clear of the wall: x + high < wall at all times.
    """
    steps = len(goals) - 1
    tubes, marked = {}, {}
    for k in range(steps, -1, -1):
        now = wall[k][0] if k < steps else wall[k - 1][-1]
        tubes[k, 0] = united((a, min(b, now)) for a, b in goals[k] if a < now)
        for n in range(1, steps - k + 1):
            union = list(tubes[k, n - 1])
            for j in range(len(low[k])):
                clear = min(there - move for there, move in zip(wall[k], high[k][j], strict=True))
                moved = [(a - low[k][j][-1], min(b - high[k][j][-1], clear)) for a, b in tubes[k + 1, n - 1]]
                marked[k, n, j] = [(a, b) for a, b in moved if a < b]
                union += marked[k, n, j]
            tubes[k, n] = united(union)
    return tubes, marked


def depth(intervals, x):
    """How far inside a union of intervals x is; negative outside."""
    return max((min(x - a, b - x) for a, b in intervals), default=-math.inf)


def lattice_game(goals, low, high):
    """Theorem 2 on a torus of nodes: values goals[k] (*shape); under u_j the state moves by any whole number of nodes
    from low[k][j] to high[k][j] on each axis. Returns tubes[k, n]."""
    steps, shape = len(goals) - 1, goals[0].shape
    tubes = {}
    for k in range(steps, -1, -1):
        tubes[k, 0] = goals[k]
        for n in range(1, steps - k + 1):
            tube, later = np.array(tubes[k, n - 1]), tubes[k + 1, n - 1]
            for index in itertools.product(*(range(size) for size in shape)):
                for below, above in zip(low[k], high[k], strict=True):
                    ends = itertools.product(*(range(a, b + 1) for a, b in zip(below, above, strict=True)))
                    worst = max(
                        later[tuple((i + move) % size for i, move, size in zip(index, end, shape, strict=True))]
                        for end in ends
                    )
                    tube[index] = min(tube[index], worst)
            tubes[k, n] = tube
    return tubes
