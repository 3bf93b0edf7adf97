"""Slow twin of `sdhj.problem.sensing`: the game of what a robot knows, played tick by tick on a torus of nodes.

Imports nothing from sdhj. In every tick an input moves the state by whole nodes, and the adversary adds up to `most`
nodes on each axis. A measurement is off by up to `error` nodes. Everything is listed and the worst of it taken.
"""

import itertools
from functools import cache

import numpy as np


def around(shape, index, half):
    """All nodes within `half` nodes of a node on each axis."""
    for offset in itertools.product(*(range(-half, half + 1) for _ in shape)):
        yield tuple((i + o) % n for i, o, n in zip(index, offset, shape, strict=True))


def uncertainty(error, most, delay):
    """How far the state can be from the prediction, in nodes: over all errors and all disturbances of the delay."""
    farthest = 0
    for off in range(-error, error + 1):
        for pushes in itertools.product(range(-most, most + 1), repeat=delay):
            measured = 0 + off  # the state is at 0; without a disturbance both move alike
            farthest = max(farthest, abs(sum(pushes) - measured))
    return farthest


def shrunk(values, half):
    """The worst value within `half` nodes."""
    return np.array(
        [max(values[at] for at in around(values.shape, index, half)) for index in np.ndindex(values.shape)]
    ).reshape(values.shape)


def kept(later, wall, move, most, ticks):
    """K(u): the worst that can come of an input held from a node on, the adversary stopping it after some of `ticks`.

    `later` is met when it stops, `wall` at every tick.
    """
    shape, first, last = later.shape, min(ticks), max(ticks)

    @cache
    def worst(index, tick):
        found = [wall[index]]
        if tick >= first:
            found.append(later[index])
        if tick < last:
            moved = tuple((i + m) % n for i, m, n in zip(index, move, shape, strict=True))
            found += [worst(at, tick + 1) for at in around(shape, moved, most)]
        return max(found)

    return np.array([worst(index, 0) for index in np.ndindex(shape)]).reshape(shape)


def predictions(goal, wall, moves, most, ticks, half, steps):
    """M^n for n = 0 to `steps`, where nothing depends on the time."""
    tubes = [shrunk(np.maximum(goal, wall), half)]
    for _ in range(steps):
        states = shrunk(tubes[-1], half)
        inputs = [shrunk(kept(states, wall, move, most, ticks), half) for move in moves]
        tubes.append(np.minimum.reduce([tubes[-1], *inputs]))
    return tubes
