"""What cells prove of the axes of the target by themselves: nothing is unsafe there, and no other axis is looked at.

Where velocities along these axes depend on no state, that is a problem of its own with few cells: a robot without its
pursuer. Its recursion is the certified one: images rounded out to whole cells, and arrivals in the target itself. So it
knows what no count of boundaries does, that an image of two cells fits into a target of three, and that an input of
which the image is k cells away leads as far as one of k + 1/2.
"""

from collections.abc import Sequence
from fractions import Fraction
from functools import reduce

import numpy as np

from sdhj.certified.arrivals import HALVINGS, MOST_PIECES
from sdhj.certified.bounds import Bounds
from sdhj.certified.cells import CellAxis, is_steady, moved_bounds
from sdhj.kernels import FloatArray
from sdhj.problem.problem import ReachAvoidProblem

Displacement = tuple[tuple[Fraction, Fraction], ...]  # the least and the greatest along each axis


def axes_alone(problem: ReachAvoidProblem) -> list[int]:
    """The target's axes, if these are a problem of their own, all steady, and not all axes; else []."""
    own = [] if problem.has_no_target else list(problem.target.axes)
    return own if len(own) < problem.grid.ndim and all(is_steady(problem, axis) for axis in own) else []


def share_proved_alone(problem: ReachAvoidProblem, axes: Sequence[CellAxis], steps: int) -> float:
    """The share of the states at step 0 that are proved to reach the target within `steps` steps by its axes alone.

    Nothing is unsafe.
    """
    moves = list(dict.fromkeys(_displacement(problem, j) for j in range(len(problem.inputs))))
    bounds, still = Bounds(problem), ((Fraction(0), Fraction(0)),) * len(axes)
    times = [problem.time(step) for step in range(steps + 1 if problem.target.moving else 1)]
    sets = [_in_target(bounds, axes, still, t) for t in times]
    shares = reduce(np.multiply, np.ix_(*[axis.shares() for axis in axes]))
    for step in range(steps):
        later = sets[1:] or sets
        some = [now | _cells_leading_into(axes, moves, then) for now, then in zip(sets, later, strict=False)]
        # cells that are led into the target itself in the last interval count as well
        if step == 0 and not problem.sensing:  # with `Sensing` nobody arrives but by cells
            for now, t in zip(some, times[1:] or times, strict=True):
                for move in moves:
                    now |= _in_target(bounds, axes, move, t)
        sets = some
    return float(shares[sets[0]].sum())


def _displacement(problem: ReachAvoidProblem, j: int) -> Displacement:
    """The least and the greatest displacement in one interval under u_j along each of the target's axes."""
    return tuple(moved_bounds(problem, axis, j) for axis in problem.target.axes)


def _in_target(bounds: Bounds, axes: Sequence[CellAxis], move: Displacement, t: float) -> FloatArray:
    """Whether each cell, displaced by `move`, is proved to lie in the target at time t: (*counts)."""
    edges = [axis.edges() for axis in axes]
    sides = [[own[:-1] + float(back) for own, (back, _) in zip(edges, move, strict=True)]]
    sides += [[own[1:] + float(ahead) for own, (_, ahead) in zip(edges, move, strict=True)]]
    low, high = (np.stack(np.meshgrid(*side, indexing="ij"), axis=-1).reshape(-1, len(axes)) for side in sides)
    inside = bounds.inside(bounds.problem.target, low, high, (t, t), HALVINGS, MOST_PIECES)
    return inside.reshape([axis.count for axis in axes])


def _cells_leading_into(axes: Sequence[CellAxis], moves: Sequence[Displacement], inside: FloatArray) -> FloatArray:
    """Which cells at least one of `moves` leads into the set `inside`, with images of whole cells: (*counts)."""
    led: dict[Displacement, FloatArray] = {(): inside}
    for move in moves:
        for k, axis in enumerate(axes):
            if move[: k + 1] not in led:
                first, number = axis.image(*move[k])
                # an image is a product over the axes: the set is eroded along one after the other
                ends = ((first + np.minimum(by, number - 1)) % axis.count for by in range(number.max()))
                led[move[: k + 1]] = np.logical_and.reduce([led[move[:k]].take(end, axis=k) for end in ends])
    return np.logical_or.reduce([led[move] for move in moves])
