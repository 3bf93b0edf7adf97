"""Slow twins of what the projected method does to sets and velocities. Imports nothing from sdhj."""

import itertools

import numpy as np


def pick(index, axes):
    """The part of a multi-index that a function on the subspace `axes` is looked up with."""
    return tuple(index[axis] for axis in axes)


def intersection(shape, reach, walls):
    """max of a function (*shape) and of walls, a list of (axes, values on their subgrid), node by node."""
    both = np.empty(shape)
    for index in itertools.product(*(range(n) for n in shape)):
        both[index] = max(reach[index], *(wall[pick(index, axes)] for axes, wall in walls))
    return both


def inner_projection(values, axes):
    """max over the dropped coordinates, node by node: the worst place to be, for a set to be reached."""
    return _extreme(values, axes, max)


def outer_projection(values, axes):
    """min over the dropped coordinates, node by node: the nearest place of an unsafe set."""
    return _extreme(values, axes, min)


def _extreme(values, axes, better):
    out = {}
    for index, value in np.ndenumerate(values):
        kept = pick(index, axes)
        out[kept] = better(out[kept], float(value)) if kept in out else float(value)
    shape = [values.shape[axis] for axis in axes]
    return np.array([out[index] for index in itertools.product(*(range(n) for n in shape))]).reshape(shape)


def hamiltonian(nodes, axes, kept, p, drift, gain, bounds):
    """sup over the dropped coordinates at their nodes, and over the box of the adversary, of p . f at one kept state.

    nodes: coordinates of every axis; kept: {axis: coordinate}; p: the gradient on the kept axes; drift(state) and
    gain(state) of the whole problem.
    """
    dropped = [axis for axis in range(len(nodes)) if axis not in axes]
    best = -np.inf
    for values in itertools.product(*(nodes[axis] for axis in dropped)):
        state = np.array([{**kept, **dict(zip(dropped, values, strict=True))}[axis] for axis in range(len(nodes))])
        for signs in itertools.product((-1.0, 1.0), repeat=len(bounds)):  # a linear function is extreme at a vertex
            velocity = drift(state) + gain(state) @ (np.array(signs) * bounds)
            best = max(best, sum(g * velocity[axis] for g, axis in zip(p, axes, strict=True)))
    return best


def hausdorff(a, b, periods):
    """Largest distance from a point of one set (A, d) to the other (B, d); periods: a number or None for each axis."""

    def distance(x, y):
        total = 0.0
        for first, second, period in zip(x, y, periods, strict=True):
            gap = abs(first - second)
            if period is not None:
                gap = min(gap % period, period - gap % period)
            total += gap**2
        return total**0.5

    def directed(x, y):
        return max(min(distance(i, j) for j in y) for i in x)

    return max(directed(a, b), directed(b, a))
