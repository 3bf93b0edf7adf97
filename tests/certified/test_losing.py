"""Cells that the adversary wins: closed forms, plain loops, and exact dynamics that bear every claim out."""

import itertools

import judge
import numpy as np
import pytest
from robots import random_robot
from toys import interval_problem, unicycle_problem

import sdhj
from sdhj.certified.bounds import Bounds
from sdhj.certified.cells import cells_of
from sdhj.certified.losing import MOST_VERTICES, LosingProof
from sdhj.certified.table import lost_cells
from sdhj.kernels import read_only
from sdhj.kernels.packed import to_bits, to_words
from sdhj.kernels.stencils import Moves, grow


def solved(problem, **options):
    return sdhj.solve(problem, sdhj.Certified(**options), progress=False)


def test_closed_form_on_a_line():
    """Left of -1 - n (1 - 0.2) 0.5 all is lost: cells of 0.1 tell it to one cell, which never becomes two."""
    table = solved(interval_problem(steps=4), cells=(80,))
    edges = table.axes[0].edges()
    for within in range(5):
        lost, reach = table.losing.bits(start=0, within=within), 1 + 0.4 * within
        assert not (lost & table.bits(start=0, within=within)).any()
        left = lost[:40]
        assert edges[1:41][left].max() == pytest.approx(-reach - 0.1) and left.sum() == round((4 - reach - 0.1) / 0.1)
        assert lost[edges[:-1] > 3.05].all()  # inside the wall
        assert table.unknown(start=0, within=within) <= 5 / 80


def test_closed_form_of_what_cannot_stay():
    """Pushed on at 0.1 to 0.3 into a wall at 3: lost within n steps is what is past 3 - n 0.3 0.5."""
    one = sdhj.Dynamics([[0.1]], [[0.1]], [[1.0]], [0.2])
    problem = interval_problem(steps=4)
    problem = sdhj.ReachAvoidProblem(problem.grid, one, None, problem.unsafe, problem.delta, 4)
    table = solved(problem, cells=(160,))
    edges = table.axes[0].edges()
    for within in range(5):
        lost = table.losing.bits(start=0, within=within)
        least = edges[:-1][lost].min()
        assert 3 - 0.15 * within - 1e-9 <= least <= 3 - 0.15 * within + 0.05 + 1e-9
        assert lost.sum() == round((4 - least) / 0.05)


def test_closed_form_of_what_cannot_stop():
    """A car with brakes of 2 m/s^2 alone, before an unsafe end at 8 m: lost is what is past 8 - v^2 / 4, for ever.

    There is no unsafe set, so no cell is lost at first: those are that leave by a cell in one interval.
    """
    car = sdhj.Dynamics([[-2.0]], lambda q, u: np.stack([q[:, 1], np.full(len(q), u[0])], axis=1), [[0], [0]], [0.0])
    grid = sdhj.Grid([0, 0], [8, 4], [9, 9], ends=["unsafe", "wall"])
    table = solved(sdhj.ReachAvoidProblem(grid, car, None, [], 0.25, None), cells=(160, 64))
    points = np.random.default_rng(0).uniform([0, 0], [8, 4], (20_000, 2))
    past, lost = points[:, 0] - (8 - points[:, 1] ** 2 / 4), table.losing.contains(points)
    assert (past[lost] > 0).all() and lost.mean() > 0.8 * (past > 0).mean()
    assert table.unknown() < 0.1


def test_kernel_does_as_plain_loops_say(rng):
    for staying in (False, True):
        table = solved(unicycle_problem(), cells=(8, 8, 16), parts=2)
        counts, cells = table.shape, read_only(cells_of(table.axes, 2))
        own, following = (rng.random(counts) < share for share in (0.6, 0.8))
        low = rng.integers(-2, 1, (6, 16, 3)).astype(np.int16)
        high = (low + rng.integers(0, 2, low.shape)).astype(np.int16)
        strides, safe = np.array([0, 0, 1]), np.array([[-np.inf] * 3, [np.inf] * 3])
        packed, all_clear = [to_words(one.reshape(64, 16)) for one in (own, following)], np.zeros((0, 0), np.uint8)
        near = rng.random((64, 1)) < 0.9
        grow(near, *packed, read_only(all_clear), read_only(Moves(low, high, strides, safe)), 3, cells, not staying)
        expected = own.copy()
        for cell in np.ndindex(counts):
            if near[8 * cell[0] + cell[1]] and own[cell] != staying:
                lost = True
                for j in range(3):
                    images = []
                    for v in range(2):
                        begin, end = low[2 * j + v, cell[2]], high[2 * j + v, cell[2]]
                        at = [
                            [min(max(c + d, 0), 7) if k < 2 else (c + d) % 16 for d in range(begin[k], end[k] + 1)]
                            for k, c in enumerate(cell)
                        ]
                        images.append(following[np.ix_(*at)].all())
                    lost &= any(images)
                expected[cell] = lost if lost == staying else own[cell] and lost
        assert np.array_equal(to_bits(packed[0], 16).reshape(counts), expected)
        assert (expected != own).any() and expected.any()


@pytest.mark.parametrize(
    "seed", [pytest.param(1, marks=pytest.mark.slow), 6, 11]
)  # those with two axes: bounded, periodic, one of each
def test_every_claim_is_borne_out_by_an_adversary(seed):
    """A lost state is in G, or is not in the target and has, for each input, a vertex that leads to a lost state.

    The vertex may be another for each state; what follows by induction is that no controller wins from a lost cell.
    """
    rng, robot = np.random.default_rng(seed), random_robot(seed)
    problem = robot.problem()
    table = solved(problem, cells=(24, 24), parts=3)
    lower, upper = np.array(problem.grid.lower), np.array(problem.grid.upper)
    points, tried = lower + rng.random((400, problem.grid.ndim)) * (upper - lower), 0
    for step, within in ((0, 0), (0, 1), (0, problem.steps), (1, problem.steps - 1)):
        states = points[table.losing.contains(points, start=step, within=within)]
        assert not table.contains(states, start=step, within=within).any()
        met = robot.unsafe(states, step * robot.delta) <= 0
        assert (met | (robot.target(robot.wrapped(states), step * robot.delta) > 0)).all()
        states = states[~met]
        for j in range(len(robot.inputs)) if within else ():
            answered = np.zeros(len(states), bool)
            for signs in itertools.product((-1.0, 1.0), repeat=len(robot.bound)):
                now, v = states, np.tile(signs, (len(states), 1))
                for sub in range(10):
                    h, places = robot.delta / 10, np.full(len(states), j)
                    velocity = lambda q, t, v=v, places=places: robot.velocity(q, places, v, t)  # noqa: E731
                    now = judge.rk4(velocity, now, step * robot.delta + sub * h, h)
                    answered |= robot.unsafe(now, step * robot.delta + (sub + 1) * h) <= 0
                answered |= table.losing.contains(now, start=step + 1, within=within - 1)
            assert answered.all()
            tried += len(states)
    assert tried > 250 and table.unknown(start=0, within=problem.steps) < 0.9


def test_one_vertex_is_bounded_by_what_is_declared_too(rng):
    """Of a black box: velocities at samples lie between the bounds, which one vertex makes narrower."""
    problem = interval_problem()
    drift = sdhj.BlackBox(lambda q, u, t: np.interp(q, [-4, 0, 4], [-1, 1, 0]), slope=0.5, rate=0.0)
    bent = sdhj.Dynamics([[1.0]], drift, [[0.5]], [0.4])
    problem = sdhj.ReachAvoidProblem(problem.grid, bent, problem.target, problem.unsafe, 0.5, 3)
    low = rng.uniform(-3.9, 3.5, (200, 1))
    widths, exact = [], np.interp(low + 0.15, [-4, 0, 4], [-1, 1, 0])
    for sign in (-1.0, 1.0, None):
        bounds = Bounds(problem, None if sign is None else np.array([[sign]]))
        least, most = bounds.velocity(0, low, low + 0.3, 0.0, 0.0)
        assert all(
            ((least <= exact + s * 0.2) & (exact + s * 0.2 <= most)).all() for s in ((sign,) if sign else (-1, 1))
        )
        widths.append(float((most - least).max()))
    assert widths[0] == pytest.approx(widths[1]) == pytest.approx(widths[2] - 0.4) == pytest.approx(0.15, abs=1e-6)


def test_what_is_refused():
    problem = interval_problem()
    safe = sdhj.ReachAvoidProblem(
        sdhj.Grid([-4.0], [4.0], [81], ends=["safe"]), problem.dynamics, None, problem.unsafe, 0.5, 3
    )
    with pytest.raises(ValueError, match="out of danger"):
        lost_cells(safe, solved(problem, cells=(40,)).axes)
    many = sdhj.Dynamics([[0.0]], [[0.0]], np.ones((1, 7)), [0.1] * 7)
    crowded = sdhj.ReachAvoidProblem(problem.grid, many, problem.target, (), 0.5, 3)
    with pytest.raises(ValueError, match=f"128 vertices; at most {MOST_VERTICES}"):
        LosingProof.against(crowded, solved(problem, cells=(40,)).axes, 4)
