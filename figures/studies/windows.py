"""Projections that know a window of what they drop (App. A.4, last sentence), for a point that accelerates in space.

`python figures/studies/windows.py` plays the six-dimensional problem of `large.py` in full and by projections that drop
one velocity. The robot measures that velocity at t_k, so it is in one of some windows, and in an interval goes on by
what the input and the gust make of it; a single window is the projection of Sec. 5.1. Each pair of a place and a
velocity moves by itself, so an interval leads to a box, and its game is a maximum over boxes of interpolated values.
Beside the shares stands the processor time of the library's methods on one thread: of windows that of as many
projections onto a space whose dropped axis is as long.
"""

import math
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise

import click
import numba
import numpy as np
from large import BALL, BALL_RADIUS, GUST, PUSH, WORKED, space

import sdhj
from sdhj.kernels import FloatArray

SIGNS = [(0, 0, 0), *((a, b, c) for a in (-1, 1) for b in (-1, 1) for c in (-1, 1))]  # of the inputs
LOST, INSTANTS = np.float32(9.0), 7
Window = tuple[int, int]  # the first and the last node of the dropped velocity


def largest(values: FloatArray, axis: int, low: float, high: float) -> FloatArray | None:
    """The maximum over [low, high] (nodes) along an axis, which it loses; None where that leads off the grid."""
    last = values.shape[axis] - 1
    if low < -1e-9 or high > last + 1e-9:
        return None
    between = map(float, range(math.ceil(low), math.floor(high) + 1))
    return np.max([_at(values, axis, min(max(x, 0.0), last)) for x in (low, high, *between)], axis=0)


def _at(values: FloatArray, axis: int, place: float) -> FloatArray:
    """Values at a place (nodes) of an axis."""
    left = min(int(place), values.shape[axis] - 2)
    weight = np.float32(place - left)
    return (1 - weight) * values.take(left, axis) + weight * values.take(left + 1, axis)


def moved(values: FloatArray, axis: int, low: float, high: float) -> FloatArray:
    """The maximum of what is [low, high] nodes farther along an axis, LOST where that is off the grid."""
    found = [largest(values, axis, node + low, node + high) for node in range(values.shape[axis])]
    none = np.full_like(values.take(0, axis), LOST)
    return np.stack([none if one is None else one for one in found], axis=axis)


class Game:
    """The games of one interval, by axes 0 to 2 of places and 3 to 5 of velocities."""

    def __init__(self, problem: sdhj.ReachAvoidProblem) -> None:
        self.problem, self.grid, self.delta = problem, problem.grid, problem.delta
        self.places, self.speeds = self.grid.nodes(0), self.grid.nodes(3)
        self.steps_of = self.grid.spacing[0], self.grid.spacing[3]

    def path(self, speed: float, sign: float, gust: float, t: float) -> float:
        """How far a point comes in a time."""
        return speed * t + (sign * PUSH + gust * GUST) * t**2 / 2

    def held(self, values: FloatArray, axis: int, at: int, sign: float, window: Window) -> FloatArray:
        """What a place becomes whose velocity, axis `at`, is in a window: without that axis."""
        first, last = window
        low, high = (self.delta * (sign * PUSH + gust * GUST) / self.steps_of[1] for gust in (-1, 1))
        found = largest(values, at, first + low, last + high)
        if found is None:
            return np.full_like(values.take(0, at), LOST)
        ends = [self.path(self.speeds[node], sign, gust, self.delta) for node, gust in ((first, -1), (last, 1))]
        return moved(found, axis, ends[0] / self.steps_of[0], ends[1] / self.steps_of[0])

    def carried(self, values: FloatArray, axis: int, at: int, sign: float) -> FloatArray:
        """The same of each node of the velocity."""
        nodes = range(values.shape[at])
        return np.stack([self.held(values, axis, at, sign, (node, node)) for node in nodes], axis=at)

    def reached(self, values: FloatArray, dropped: int, windows: Sequence[Window]) -> Iterator[FloatArray]:
        """The reach game of each input, of which one velocity is known to a window."""
        one, other = (axis for axis in range(3) if axis != dropped)
        known = {}
        for window in windows:
            for c in (-1, 0, 1):
                kept = self.held(values, dropped, dropped + 3, c, window)  # places, then two velocities
                for b in (-1, 1) if c else (0,):
                    second = self.carried(kept, other, 4, b)
                    for a in (-1, 1) if c else (0,):
                        known[window, a, b, c] = self.carried(second, one, 3, a)
        for sign in SIGNS:
            yield self.spread([known[w, sign[one], sign[other], sign[dropped]] for w in windows], dropped, windows)

    def spread(self, found: Sequence[FloatArray], dropped: int, windows: Sequence[Window]) -> FloatArray:
        """Functions without the dropped velocity, each at all nodes of its window."""
        parts = [
            np.repeat(np.expand_dims(one, dropped + 3), last + 1 - first, axis=dropped + 3)
            for one, (first, last) in zip(found, windows, strict=True)
        ]
        return np.concatenate(parts, axis=dropped + 3)

    def touched(self, sign: Sequence[float], dropped: int, windows: Sequence[Window]) -> FloatArray:
        """The avoid game of an input: the worst of -g at some instants, by the true distance."""
        out = []
        for first, last in windows:
            worst = -np.inf
            for t in np.linspace(0.0, self.delta, INSTANTS):
                squares: FloatArray | float = 0.0
                for axis in range(3):
                    place = self.places.reshape([-1 if i == axis else 1 for i in range(6)])
                    speed = self.speeds.reshape([-1 if i == axis + 3 else 1 for i in range(6)])
                    ends = (self.speeds[first], self.speeds[last]) if axis == dropped else (speed, speed)
                    low, high = (
                        place + self.path(end, sign[axis], gust, t) - BALL[axis]
                        for end, gust in zip(ends, (-1, 1), strict=True)
                    )
                    squares = squares + np.maximum(np.maximum(low, -high), 0.0) ** 2
                worst = np.maximum(worst, BALL_RADIUS - np.sqrt(squares))
            out.append(worst.astype(np.float32).take(0, dropped + 3))
        return self.spread(out, dropped, windows)


def shares(problem: sdhj.ReachAvoidProblem, windows: Sequence[Window], axes: Sequence[int] = (0, 1, 2)) -> list[float]:
    """The share of the tubes within 0, 1, ... steps, united over the axes whose velocity is dropped."""
    game, least = Game(problem), lambda found: np.min(list(found), axis=0)
    avoid = [least(game.touched(sign, axis, windows) for axis in axes) for sign in SIGNS]
    values = problem.goal(0).astype(np.float32)
    out = [problem.grid.fraction(values <= 0)]
    for _ in range(problem.steps):
        reach = zip(*(game.reached(values, axis, windows) for axis in axes), strict=True)
        ways = [np.maximum(least(one), clear) for one, clear in zip(reach, avoid, strict=True)]
        values = np.minimum(values, np.min(ways, axis=0))
        out.append(problem.grid.fraction(values <= 0))
    return out


def cut(nodes: int, count: int) -> list[Window]:
    """The nodes of an axis, cut into so many windows."""
    ends = np.linspace(0, nodes, count + 1).round().astype(int).tolist()
    return [(first, end - 1) for first, end in pairwise(ends)]


def seconds(solve: Callable[[], object]) -> float:
    """Processor time."""
    began = time.process_time()
    solve()
    return time.process_time() - began


def of_windows(problem: sdhj.ReachAvoidProblem, windows: Sequence[Window]) -> float:
    """Processor time of the library's projections: three times that of the last axis, as long as in a window."""
    grid, found = problem.grid, 0.0
    farther = problem.delta * (PUSH + GUST)
    for window in windows:
        low, high = grid.nodes(5)[list(window)]
        ends = max(low - farther, grid.lower[5]), min(high + farther, grid.upper[5])
        nodes = max(round((ends[1] - ends[0]) / grid.spacing[5]) + 1, 5)
        part = sdhj.Grid([*grid.lower[:5], ends[0]], [*grid.upper[:5], ends[1]], [*grid.shape[:5], nodes])
        method = sdhj.Projected(((0, 1, 2, 3, 4),))
        found += 3 * seconds(partial(sdhj.solve, replace(problem, grid=part), method, play=False))
    return found


@click.command(context_settings={"show_default": True})
@click.option("--nodes", default=WORKED["space"].nodes, type=click.IntRange(9), help="Along each place.")
def main(nodes: int) -> None:
    """Print a row for each number of windows, and one of the full game."""
    warnings.simplefilter("ignore")
    numba.set_num_threads(1)
    problem = space(nodes)
    speeds = problem.grid.shape[5]
    whole = seconds(partial(sdhj.solve, problem, play=False))
    click.echo("| windows | share | of the full one | CPU s | of the full ones |\n|---|---|---|---|---|")
    full = shares(problem, [(node, node) for node in range(speeds)], axes=(2,))[-1]
    for count in (1, 2, 3):
        share, took = shares(problem, cut(speeds, count))[-1], of_windows(problem, cut(speeds, count))
        click.echo(f"| {count} | {share:.4f} | {share / full:.0%} | {took:.0f} | {took / whole:.0%} |")
    click.echo(f"| none, in full | {full:.4f} |  | {whole:.0f} |  |")


if __name__ == "__main__":
    main()
