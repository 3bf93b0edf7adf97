"""Whether the tubes of a problem may be separate pieces that a grid does not keep apart.

Under input u_j a target S is reached from S less what the disturbance undoes, moved back by the displacement d_j: a
copy of S for each input, thinner than S by what the disturbance pushes. Copies whose neighbours are farther apart than
they are thick leave gaps. The equations keep gaps open, but errors of the scheme close them in two ways:

* at each step the edges of a gap move inwards by a part of a cell, and only what the disturbance pushes moves them
  back: it has to push a cell in an interval, or eight by differences, which smear all the way;
* a gap of a few cells is lost at once, however far the disturbance pushes.
"""

import math
from typing import NamedTuple

import numpy as np

from sdhj.kernels import FloatArray
from sdhj.problem.grid import Grid
from sdhj.problem.nodes import neighbour
from sdhj.problem.problem import ReachAvoidProblem

# cells that the disturbance has to push and that a gap has to be wide, if shifted and by differences: of what a line of
# gaps promises .001 to .002 is wrong at such a push, and less than .02 at such a width, for pushes of 1/4 to 32 cells
ENOUGH = {True: (1.0, 8.0), False: (8.0, 16.0)}
PARTS = 16  # of a displacement, at whose ends the target is asked
MOST_PAIRS = 5_000  # pairs of displacements at most
MIDDLES = 64  # of the middle of the target, with other coordinates drawn at random
LARGEST = 2**22  # nodes of a target that is looked at
RARE = 0.1  # of the states in the middle of the target, or of the gaps: fewer may be a corner of it


class _Gaps(NamedTuple):
    """The gaps between pieces of a tube along one axis, the worst of those that were looked at.

    push : how far the disturbance pushes along the axis in an interval, at least, in the axis's unit; inf if there is
        no gap.
    width : how wide the gaps are, in the axis's unit; inf if there is none.
    """

    push: float
    width: float


def gaps(problem: ReachAvoidProblem, shifted: bool) -> str:
    """Advice in sentences, if tubes may be separate pieces that the grid does not keep apart; else "".

    The target is looked at, at the first, the middle and the last step if it moves, from random states (of seed 0). ""
    also without a target, and where its axes have more than `LARGEST` nodes.

    shifted : whether reach sets are computed by a shift or a formula; by differences more nodes are needed (`ENOUGH`).
    """
    grid, axes = problem.grid, list(problem.target.axes)
    if problem.has_no_target or grid.subgrid(axes).size > LARGEST:
        return ""
    found: dict[int, _Gaps] = {}  # by the axis
    for step in (0, problem.most_steps // 2, problem.most_steps) if problem.target.moving else (0,):
        for axis, here in _gaps_along(problem, step).items():
            found[axis] = _Gaps(*np.minimum(here, found.get(axis, here)).tolist())
    cells = {axis: np.array(there) / grid.spacing[axis] for axis, there in found.items()}
    with np.errstate(divide="ignore"):  # without a disturbance no number of nodes is enough
        finer = {axis: float(np.max(ENOUGH[shifted] / has)) * (1 - 1e-9) for axis, has in cells.items()}
    short = [axis for axis in sorted(finer) if finer[axis] > 1]
    if not short:
        return ""
    nodes = []
    for axis in sorted(finer):
        # where pieces touch along an axis a gap along another is a hole, which is filled from all sides
        factor = finer[axis] or max(finer.values())
        if 1 < factor < math.inf:
            ends = not grid.periodic[axis]
            nodes.append(f"{math.ceil((grid.shape[axis] - ends) * factor) + ends:,} nodes along {grid.names[axis]}")
    known, (pushes, widths) = (
        " and ".join(grid.names[axis] for axis in short),
        (" and ".join(f"{cells[axis][which]:.2g}" for axis in short) for which in (0, 1)),
    )
    lax = "sdhj.HopfLax(), which needs fewer nodes; " if not shifted and problem.dynamics.stateless else ""
    return (
        f"The tubes may be separate pieces along {known}, because a step is longer than the target is thick, and the "
        f"grid fills the gaps between them: the disturbance pushes {pushes} cells in a step, and the gaps are {widths} "
        "cells wide, which should be {:g} and {:g}. What helps: ".format(*ENOUGH[shifted])
        + (f"{' and '.join(nodes)}; " if nodes else "")
        + f"{lax}a shorter delta, or slower inputs beside these, so that steps are shorter than the target is thick"
    )


def _gaps_along(problem: ReachAvoidProblem, step: int) -> dict[int, _Gaps]:
    """The gaps at a step along the axes that inputs move the target along, by the axis; {} if tubes are one piece.

    Looked for at random states (of seed 0) in the middle of the target, between neighbouring displacements of the
    inputs (`_pairs`): the width of a gap is the distance of the two, less what the target reaches between them and what
    the disturbance pushes. For each axis the least push and a small width (the quantile `RARE`) are returned; inf for
    both where inputs move the target along the axis without a gap. {} also where gaps are found at less than a share
    `RARE` of the states, or the target contains no node.
    """
    grid, axes, count, t = problem.grid, list(problem.target.axes), len(problem.inputs), problem.time(step)
    some, rng = grid.subgrid(axes), np.random.default_rng(0)
    middle = _middle(problem, some, t)
    if not len(middle):
        return {}
    points = rng.uniform(grid.lower, grid.upper, (MIDDLES if count < MIDDLES else MIDDLES // 16, grid.ndim))
    points[:, axes] = middle[rng.permutation(len(middle))[np.arange(len(points)) % len(middle)]]
    interval = problem.interval(min(step, problem.most_steps - 1))
    low, high = (end[..., axes] for end in interval.reachable_boxes(points))
    push = np.broadcast_to(((high - low) / 2).max(axis=1), (len(points), len(axes)))
    moves = np.zeros((len(points), 1 + count, len(axes)))  # the first is that of the target itself
    moves[:, 1:] = interval.displacements(points)[..., axes]
    state, one, other = _pairs(moves / some.spacing, rng)
    e, centres = moves[state, other] - moves[state, one], points[state][:, axes]
    length = np.abs(e) / some.spacing
    along = (length > 0) & (length >= length.max(axis=1, keepdims=True) / 2)
    taken_off = np.max(push[state] / np.where(along, np.abs(e), np.inf), axis=1)
    taken_off *= np.where((moves[state, one] == 0).all(axis=1) | (moves[state, other] == 0).all(axis=1), 1, 2)
    longer = e * (1.0 + taken_off)[:, None]
    ways = _share_inside(problem, centres, longer, t) + _share_inside(problem, centres, -longer, t)
    alone, widths = ways < 1.0, np.abs(longer) * (1.0 - ways)[:, None]
    if len(np.unique(state[alone])) < RARE * len(points):
        return {}
    hit = along & alone[:, None]
    found = {axis: _Gaps(math.inf, math.inf) for axis, moved in zip(axes, along.T, strict=True) if moved.any()}
    for i, axis in enumerate(axes):
        if (here := hit[:, i]).any():
            width = np.quantile(widths[here, i], RARE, method="lower")
            found[axis] = _Gaps(float(push[state[here], i].min()), float(width))
    return found


def _pairs(displacements: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Pairs of neighbours among the K displacements of each of M states; at most `MOST_PAIRS`, drawn by `rng`.

    Returns three int arrays (pairs,): the state of each pair, and the indices of its first and second displacement,
    first < second. Two displacements are neighbours if they differ and no third is nearer to both than they are to each
    other (the relative neighbourhood graph, Toussaint 1980).

    displacements : (M, K, axes), in cells.
    """
    distances = np.sqrt(((displacements[:, :, None] - displacements[:, None]) ** 2).sum(axis=3))
    far = np.triu(distances > 0)
    for third in range(displacements.shape[1]):
        far &= np.maximum(distances[:, :, third, None], distances[:, None, third]) >= distances * (1 - 1e-9)
    found = np.argwhere(far)
    some = found[np.sort(rng.permutation(len(found))[:MOST_PAIRS])]
    return some[:, 0], some[:, 1], some[:, 2]


def _middle(problem: ReachAvoidProblem, some: Grid, t: float) -> FloatArray:
    """The nodes in the target at time t that are as deep in it as all their neighbours: states (M, axes), M may be 0.

    some : the subgrid of the target's axes.
    """
    values = problem.target.level_set(some.points(), t).reshape(some.shape)
    deepest = values
    for axis in range(some.ndim):
        deepest = np.minimum.reduce([deepest, *(neighbour(some, deepest, axis, by, np.inf) for by in (-1, 1))])
    inside = np.argwhere((values <= 0) & (values == deepest))
    return np.array(some.lower) + inside * some.spacing


def _share_inside(problem: ReachAvoidProblem, centres: FloatArray, e: FloatArray, t: float) -> FloatArray:
    """How far the target at time t continues from states in it along e, as a share of e, 0 to 1: (M,).

    centres, e : (M, axes) on the target's axes, in their units. The level-set function is evaluated at `PARTS` points
        of the way, and taken to be linear between them.
    """
    grid, shares = problem.grid.subgrid(problem.target.axes), np.arange(PARTS + 1) / PARTS
    points = centres[:, None] + shares[:, None] * e[:, None]
    values = problem.target.level_set(grid.wrapped(points.reshape(-1, grid.ndim)), t).reshape(len(e), len(shares))
    first = np.where((values > 0).any(axis=1), (values > 0).argmax(axis=1), len(shares) - 1)
    rows = np.arange(len(e))
    inner, outer = np.minimum(values[rows, first - 1], 0.0), np.maximum(values[rows, first], 0.0)
    return (first - 1 + inner / np.where(outer > inner, inner - outer, -1.0)) / PARTS
