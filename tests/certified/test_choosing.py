"""Cells that nobody gave: what the model says of losses that are known by hand, and what a solve makes of it."""

import itertools
import math
import tracemalloc
from dataclasses import replace
from fractions import Fraction

import cost_of_cells
import fleet
import large
import numpy as np
import pytest
from robots import car
from test_memory import joint
from toys import interval_problem

import sdhj
from sdhj.certified.alone import axes_alone, share_proved_alone
from sdhj.certified.cells import aligned, aligned_choices, axis_of, moved_bounds
from sdhj.certified.choosing import (
    CORES,
    SLOWED,
    _faces,
    _fitted,
    chosen_cells,
    cost,
    costs,
    in_whole_words,
    losing_steps,
    losses,
    lost_to,
    rounded_out,
    speeds_of,
)


def plane(spin=0.0, **changed):
    """x and y; dx = u + spin y, dy = u, a disk of radius 1 to get to in one step of 0.5 s, walls all around."""
    grid = sdhj.Grid([-4.0, -4.0], [4.0, 4.0], [401, 401], ends="wall")
    dynamics = sdhj.Dynamics(
        [[-1.0], [1.0]],
        lambda q, u: np.stack([u[0] + spin * q[:, 1], u[0] + 0.0 * q[:, 0]], axis=1),
        np.eye(2),
        [0.1, 0.1],
    )
    target = sdhj.TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0], p[:, 1]) - 1.0)
    return sdhj.ReachAvoidProblem(grid, dynamics, target, [], **{"delta": 0.5, "steps": 1} | changed)


def line_of(speed):
    """One axis of 8 m, on which an input moves by half of so much in a step, either way, +- .01 m."""
    moves = [[-speed - 0.1], [speed + 0.1]]
    grid = sdhj.Grid([-4.0], [4.0], [401], ends="wall")
    target = sdhj.TargetSet((0,), lambda p, t: np.abs(p[:, 0]) - 1.0)
    return sdhj.ReachAvoidProblem(grid, sdhj.Dynamics(moves, moves, [[1.0]], [0.1]), target, [], 0.5, 1)


def test_what_widths_lose():
    """A disk of radius 1 is crossed twice in 2 of 8 m, on pi of 64 m^2: m = 4 / pi. Then by hand, step by step."""
    m, known = 4 / math.pi, pytest.approx
    for spin, *expected in (
        (0.0, [m, m], [0.0, 0.0], [m, m]),
        (2.0, [m, m], [m, 0.5 * 2.0 * m], [0.0, m]),  # x is rounded out by any width, y turns x
    ):
        problem = plane(spin)
        speeds = speeds_of(problem)
        assert speeds.wider == known(np.array([[0.0, spin], [0.0, 0.0]]), abs=1e-9)
        assert speeds.widths == known([0.2, 0.2])
        np.testing.assert_allclose(losses(problem, speeds), expected, rtol=0.02)
    problem = plane(2.0, steps=2)  # after a step the boundary is m, m + spin delta m = 2 m
    np.testing.assert_allclose(losses(problem, speeds_of(problem)), [[m, m], [2 * m, 2 * m], [0.0, 3 * m]], rtol=0.02)
    ends = replace(problem.grid, ends="unsafe")
    more = losses(replace(problem, grid=ends), speeds) - losses(problem, speeds)
    assert more[:2, 0].sum() == known(2 / 8 * 3, rel=0.02)


def test_what_images_are_rounded_out_by():
    """Half a second at -1 +- .1 or 1 +- .1 m/s moves both ends by .45 to .55 m, either way."""
    widths = np.array([0.05, 0.3, 0.25])  # nine cells; one of .3 m; one of .25 m
    line = line_of(0.9)
    found = rounded_out(line, 0, widths, speeds_of(line).displacements)
    assert found == pytest.approx([0.0, 0.15 * 0.45 / 0.3, 0.2 * 0.45 / 0.25])  # and so many times as many steps
    rates, speeds = np.array([1.5, 0.5, 3.0]), speeds_of(line)
    lost = lost_to(line, 0, rates, aligned_choices(line, 0, [160]), speeds)
    assert lost == pytest.approx([2 * 0.05])
    nowhere = rounded_out(line, 0, np.array([0.46]), speeds.displacements)[0]  # wider than a step is long
    assert nowhere == pytest.approx(SLOWED * 0.45)


def test_what_no_input_moves_is_rounded_out_on_both_sides():
    """A pursuer at up to .24 m/s, .12 m in a step: on cells of .1 m it counts as .2 m, on .12 m it is exact."""
    pursued = sdhj.ReachAvoidProblem(
        sdhj.Grid([-4.0, -4.0], [4.0, 4.0], [41, 41]),
        sdhj.Dynamics([[-1.0], [1.0]], [[-1.0, 0.0], [1.0, 0.0]], [[0.0], [1.0]], [0.24]),
        None,
        [sdhj.UnsafeSet((0, 1), lambda p, t: np.abs(p[:, 0] - p[:, 1]) - 0.2)],
        0.5,
        2,
    )
    found = rounded_out(pursued, 1, np.array([0.1, 0.12]), speeds_of(pursued).displacements)
    assert found == pytest.approx([0.08, 0.0])


def test_of_many_directions_the_best_in_whole_cells_counts():
    """By hand, of a ferry that moves .3 m in 8 directions, on cells of .29 m."""
    angles = np.pi / 4 * np.arange(8)
    moves = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ferry = sdhj.ReachAvoidProblem(
        sdhj.Grid([-4.0, -4.0], [4.0, 4.0], [41, 41]),
        sdhj.Dynamics(moves, moves, np.eye(2), [0.0, 0.0]),
        sdhj.TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0], p[:, 1]) - 1.0),
        [],
        0.3,
        9,
    )
    displaced, width = speeds_of(ferry).displacements, 0.29
    cells = np.floor(0.3 * moves[:, None] * np.sign(displaced.directions) / width + 1e-9) * width  # in whole cells
    whole = 0.3 * moves[:, None] * np.sign(displaced.directions)
    away = np.abs(displaced.directions)
    most, reached = ((away * one).sum(axis=2).max(axis=0) for one in (whole, cells))
    expected = (away[:, 0] ** 2 * (most - reached) * most / reached).sum() / away[:, 0].sum()
    assert rounded_out(ferry, 0, np.array([width]), displaced)[0] == pytest.approx(expected)


def test_what_turns_back_and_forth_does_not_grow():
    """A pendulum of .5 rad/s: a boundary turns, and is never longer than sqrt(2) of itself in units of its axes."""
    swings = plane()
    spring = sdhj.Dynamics(
        [[0.0]], lambda q, u: np.stack([0.5 * q[:, 1], -0.5 * q[:, 0] + u[0]], axis=1), np.eye(2), [0.1, 0.1]
    )
    swings = replace(swings, dynamics=spring, steps=20)
    speeds, m = speeds_of(swings), 4 / math.pi
    each = losses(swings, speeds)[1] / losing_steps(swings, speeds)
    assert losing_steps(swings, speeds) > 7  # until 8 m are crossed at 2 m/s: 2 rad, a factor of 6 by |J| alone
    assert (each < math.sqrt(2) * m * (1 + 0.5 * 0.5) * 1.03).all()


@pytest.mark.slow
def test_more_time_is_not_spent_on_less():
    """A ferry in 32 directions: by the model what takes longer loses less, and no step leads nowhere."""
    ferry = fleet.FLEET["256 inputs"]().problem()
    fastest = ferry.inputs[-32:]  # of 256: only these lead farthest
    ferry = replace(ferry, dynamics=sdhj.Dynamics(fastest, fastest, np.eye(2), [0.18, 0.18]))
    speeds = speeds_of(ferry)
    rates, lost = losses(ferry, speeds), []
    for seconds in (0.1, 0.4, 1.0, 1.5, 2.0, 4.0, 8.0, 16.0, 60.0):
        own = zip(rates.T, aligned(ferry, chosen_cells(ferry, 10, seconds)), strict=True)
        lost.append(sum(lost_to(ferry, k, some, [axis], speeds)[0] for k, (some, axis) in enumerate(own)))
    assert lost == sorted(lost, reverse=True) and lost[-1] < 2.0 < 100.0 < lost[0]


@pytest.mark.slow
def test_where_cells_cannot_be_paid_that_lead_everywhere_they_lead_along_an_axis():
    """The ferry moves by a cell of about 1 / 572 of x, 1 / 428 of y; with fewer of both .042, the target."""
    ferry = fleet.FLEET["256 inputs"]().problem()
    cells = aligned(ferry, chosen_cells(ferry, 10, 2.0))
    assert 570 < cells[0].count < 573 and cells[1].count < 300
    table = sdhj.solve(ferry, sdhj.Certified(seconds=2.0), progress=False, play=False)
    assert table.fraction() > 0.11


@pytest.mark.slow
def test_words_along_which_sets_are_packed_are_full():
    """A crane: one word of x or two take as long where other axes have as many; two prove more at 8 s."""
    crane = cost_of_cells.crane()
    assert [chosen_cells(crane, 10, seconds)[0] for seconds in (2.0, 8.0)] == [62, 127]


def test_marking_takes_longer_where_more_is_unsafe():
    """By what is met and by what is beside a boundary, cells being the same: of the fence and of a small hole alone."""
    fence = cost_of_cells.fence()
    axes, speeds = aligned(fence, (100, 100, 14, 14)), speeds_of(fence)
    marking = [costs(replace(fence, unsafe=[one]), axes, 10, speeds)["unsafe sets"] for one in fence.unsafe]
    assert marking[0] > 1.5 * marking[1]


@pytest.mark.slow
@pytest.mark.parametrize("delta", [0.01, 0.005])
def test_cells_fit_the_rate(delta):
    """The joint that remembers, at 100 and 200 Hz: an input moves by a cell at least; .8365 and 0 without that."""
    problem = joint(delta)
    axes = sdhj.Certified(seconds=0.5).axes(problem)
    assert float(axes[1].width) <= 3.9 * delta * (1 + 1e-9)
    table = sdhj.solve(problem, sdhj.Certified(seconds=0.5), progress=False, play=False)
    assert table.fraction() > 0.857  # of .905, in half a second


@pytest.mark.slow
def test_cells_are_taken_that_a_pursuer_does_not_leave():
    """It moves by .12 m in a step. On 33 cells of .121 m that is a cell, on 34 of .118 m two, on 7 a cell of .57 m."""
    problem = large.car(25)
    speeds, few = speeds_of(problem), (144, 144, 64, 8, 8)  # as dear: as many as the widths alone ask for

    def lost(cells):
        own = zip(losses(problem, speeds).T, aligned(problem, cells), strict=True)
        return [lost_to(problem, k, rates, [axis], speeds)[0] for k, (rates, axis) in enumerate(own)]

    assert lost((30, 30, 21, 33, 33))[3] < 0.4 * lost((30, 30, 21, 34, 34))[3]
    cells = chosen_cells(problem, 10, 10.0)
    paid = [sum(cost(problem, aligned(problem, some), 10, speeds)) for some in (cells, few)]
    assert 0.9 * 10.0 * CORES < paid[0] < 10.0 * CORES < paid[1]
    assert sum(lost(cells)) < sum(lost(few)) and max(lost(cells)[3:]) < 0.5 * lost(few)[3]


@pytest.mark.slow
def test_the_same_cells_everywhere_and_more_for_more_time():
    problem = replace(car(), steps=8)
    method, counts = sdhj.Certified(), chosen_cells(problem, 10, 60.0)
    assert [axis.count for axis in method.axes(problem)] == [axis.count for axis in aligned(problem, counts)]
    assert counts == chosen_cells(problem, 10, 60.0) and counts[1] > 1.5 * counts[2]
    assert in_whole_words(counts[0]) < 1.01 * counts[0]  # full words
    # alike but for these words: along x one more than the mean of both needs, and y pays for it
    mean = math.sqrt(counts[0] * counts[1])
    assert mean <= counts[0] <= in_whole_words(math.ceil(mean)) + 64
    assert 5e7 < math.prod(counts) < 2.1e8  # README's car: .30 of the states
    paid = [sum(cost(problem, aligned(problem, chosen_cells(problem, 10, s)), 10, speeds_of(problem))) for s in (3, 30)]
    assert 3 * CORES >= paid[0] > 2 and 30 * CORES >= paid[1] > 20
    few = sdhj.Certified(seconds=0.2, parts=4)
    table = sdhj.solve(problem, few, progress=False, play=False)
    assert table.details["cells"] == list(table.shape) == [axis.count for axis in few.axes(problem)]
    again = sdhj.solve(problem, sdhj.Certified(cells=table.details["cells"], parts=4), progress=False, play=False)
    assert again.shape == table.shape and np.array_equal(again.pool, table.pool)


def test_cells_of_a_word_take_as_long_as_a_whole_one():
    """Sets of README's car are packed along x, 64 cells in a word: one cell more costs more than the next 63."""
    problem = replace(car(), steps=8)
    speeds = speeds_of(problem)
    seconds = [costs(problem, aligned(problem, (n, 40, 40)), 10, speeds)["recursion"] for n in (64, 65, 128)]
    assert seconds[1] - seconds[0] > seconds[2] - seconds[1] > 0


def test_cells_are_worth_their_time():
    """On a line no more than what is lost asks for; the arm's case study has its own."""
    cells = sdhj.Certified().axes(interval_problem())
    assert 50 < cells[0].count <= 4096
    arm = sdhj.Certified().axes(sdhj.arm_case_study(nodes=5, steps=1))
    assert [axis.count for axis in arm] == [419, 419, 72, 72]
    with pytest.raises(ValueError, match="seconds"):
        sdhj.Certified(seconds=-1.0)


def test_an_axis_is_aligned_where_its_velocity_reads_nothing():
    """Half a rad in a step: a whole number of cells, though x and y depend on the heading."""
    axes = aligned(car(), (40, 40, 40))
    assert axes[0].count == 40 and (0.5 / float(axes[2].width)) == pytest.approx(round(0.5 / float(axes[2].width)))


@pytest.mark.slow
def test_fewer_cells_that_are_aligned_prove_more(monkeypatch):
    """Of 40 cells that are asked for along the heading 38 are aligned with what inputs turn: .153 for .134."""
    problem, method = replace(car(), steps=8), sdhj.Certified(cells=(40, 40, 40))
    tables = [sdhj.solve(problem, method, progress=False, play=False)]
    with monkeypatch.context() as patch:
        patch.setattr("sdhj.certified.cells.is_steady", lambda problem, axis: False)
        axes = aligned(problem, method.cells)
    monkeypatch.setattr("sdhj.certified.sets.aligned", lambda *told: axes)
    tables.append(sdhj.solve(problem, method, progress=False, play=False))
    assert [table.shape[2] for table in tables] == [38, 40]
    assert tables[0].fraction() > 1.1 * tables[1].fraction()


@pytest.mark.slow
def test_where_steps_gain_nothing_the_target_counts():
    """In six dimensions in 10 s a step loses more than there is: cells go to x, y, z, the axes of target and ball."""
    cells = chosen_cells(large.WORKED["space"].problem(17), 10, 10.0)
    assert min(cells[:3]) > 2 * max(cells[3:])


def hanging(turned=0.0):
    """Of an axis of 5 m the target is from 3.7 to 4.3 m; of another one, of 12 degrees, the third in the middle."""
    cos, sin = math.cos(turned), math.sin(turned)

    def level(p, t):
        x, angle = p[:, 0] - 3.0, p[:, 1]
        return np.maximum(np.abs(cos * x - sin * angle) - 0.3, np.abs(sin * x + cos * angle) / 2 - 1.0)

    return sdhj.ReachAvoidProblem(
        sdhj.Grid([-1.0, -6.0, 0.0], [4.0, 6.0, 1.0], [11, 11, 11]),
        sdhj.Dynamics([[-1.0], [1.0]], lambda q, u: np.stack([q[:, 1], u[0] - q[:, 0], u[0] + 0.0 * q[:, 2]], axis=1)),
        sdhj.TargetSet((0, 1), level),
        [],
        0.1,
        5,
    )


def test_edges_of_cells_are_faces_of_the_target():
    """57 cells have a third in the middle, 56 have not; of 85 cells 62.9 to 73.1 are the target, of 83 61.4 to 71.4."""
    problem = hanging()
    assert _faces(problem, 0) == pytest.approx((2.7, 3.3), abs=1e-9)
    assert _faces(problem, 1) == pytest.approx((-2.0, 2.0), abs=1e-9)
    assert [_fitted(problem, axis, wish) for axis, wish in enumerate((83, 56, 10))] == [85, 57, 10]
    assert _fitted(problem, 1, 30) == 30
    assert _faces(hanging(0.1), 1) is None and _fitted(hanging(0.1), 1, 56) == 56  # it has none along an axis
    assert _fitted(two_joints(), 0, 28) == 28  # aligned with what inputs move


def two_joints():
    """Two at 1.5 rad/s, .2 s at a time: an input moves one by .3 +- .02 rad; and what drifts along a third axis."""
    levels = [[a, b] for a in (-1.5, 0.0, 1.5) for b in (-1.5, 0.0, 1.5)]
    return sdhj.ReachAvoidProblem(
        sdhj.Grid([0.0, 0.0, -1.0], [4.0, 4.0, 1.0], [21] * 3, periodic=[True, False, False]),
        sdhj.Dynamics(levels, np.pad(levels, ((0, 0), (0, 1))), np.eye(3), [0.1, 0.1, 0.05]),
        sdhj.TargetSet((0, 1), lambda p, t: np.maximum(abs(p[:, 0] - 1.0 - 0.1 * t), abs(p[:, 1] - 2.0)) - 0.25),
        [sdhj.UnsafeSet((0, 1, 2), lambda p, t: np.abs(p - [2.0, 2.0, 0.0]).max(axis=1) - 0.1)],
        0.2,
        3,
    )


def by_loops(problem, axes):
    """What `share_proved_alone` says, cell by cell, in fractions; the target is the box above."""
    moves = [(0, 0), *dict.fromkeys(moved_bounds(problem, 0, j) for j in range(len(problem.inputs)))]  # alike on both
    cells, steps = list(itertools.product(*[range(axis.count) for axis in axes])), range(problem.steps + 1)

    def image(axis, i, move, step):
        """The cells that a cell comes to along an axis, and whether that is in the target then."""
        low, high = (axis.lower + (i + by) * axis.width + end for by, end in enumerate(move))
        middle = 1 + Fraction(step, 50) if axis is axes[0] else Fraction(2)
        some = range(math.floor((low - axis.lower) / axis.width), math.ceil((high - axis.lower) / axis.width))
        ahead = [j % axis.count if axis.periodic else min(max(j, 0), axis.count - 1) for j in some]
        return ahead, middle - Fraction(1, 4) <= low and high <= middle + Fraction(1, 4)

    images = {
        key: image(axes[key[0]], *key[1:])
        for axis in (0, 1)
        for key in itertools.product([axis], range(axes[axis].count), moves, steps)
    }

    def leads(cell, step, sets):
        """Whether some input leads a cell into a set of cells, or into the target where it is a step later."""
        for way in itertools.product(moves[1:], repeat=2):
            (a, in_a), (b, in_b) = (images[axis, cell[axis], way[axis], step + 1] for axis in (0, 1))
            if (in_a and in_b) or set(itertools.product(a, b)) <= sets:
                return True
        return False

    sets = [{cell for cell in cells if all(images[k, cell[k], (0, 0), step][1] for k in (0, 1))} for step in steps]
    shares = [len(sets[0]) / len(cells)]
    for _ in range(problem.steps):  # who arrives in the target's cells or in it: after a step more, in those who do
        sets = [
            now | {cell for cell in cells if leads(cell, step, then)}
            for step, (now, then) in enumerate(itertools.pairwise(sets))
        ]
        shares.append(len(sets[0]) / len(cells))
    return shares


@pytest.mark.slow
def test_what_the_axes_of_the_target_prove_alone():
    """Cell by cell in fractions: a moving target of two axes, of which the first closes."""
    problem = two_joints()
    assert axes_alone(problem) == [0, 1]
    axes = [axis_of(problem.grid, axis, width) for axis, width in enumerate((Fraction(1, 10), Fraction(1, 8)))]
    found = [share_proved_alone(problem, axes, steps) for steps in range(problem.steps + 1)]
    np.testing.assert_allclose(found, by_loops(problem, axes), rtol=1e-9)
    assert 0 < found[0] < found[1]
    for other in (car(), fleet.FLEET["256 inputs"]().problem(), large.car(9)):  # turns; has no axis else; turns
        assert not axes_alone(other)


@pytest.mark.slow
def test_cells_fit_what_inputs_move():
    """.28 rad at least are 2 of 29 cells, and less than 2 of 28; with these one does not get everywhere in 8 steps."""
    problem = replace(two_joints(), steps=8)
    assert chosen_cells(problem, 10, 0.16)[:2] == (29, 29)
    proved = [share_proved_alone(problem, aligned(problem, (n, n, 2))[:2], 8) for n in (28, 29)]
    assert proved[0] < 0.9 < proved[1]


def truck(delta):
    """Before something that stands 100 m on, up to 15 m/s; a push on brake and throttle of up to a third: its mass."""
    dynamics = sdhj.Dynamics(
        [[-4.0], [-2.0], [0.0], [2.0]],
        lambda q, u: np.stack([q[:, 1], 0.75 * u[0] + 0.0 * q[:, 1]], axis=1),
        lambda q, u: np.stack([0.0 * q[:, :1], 0.0 * q[:, :1] + u[0]], axis=1),
        [0.25],
    )
    grid = sdhj.Grid([0.0, 0.0], [100.0, 15.0], (201, 61), ends=["unsafe", "wall"])
    return sdhj.ReachAvoidProblem(grid, dynamics, None, [], delta, None, sensing=sdhj.Sensing((0.1, 0.05)))


@pytest.mark.slow
def test_ends_that_are_whole_cells_are_aligned():
    """At 100 Hz an input adds .01 to .02 m/s, another takes .02 to .04: cells of .01 m/s round nothing out."""
    axis = aligned_choices(truck(0.01), 1, [750])[0]
    assert axis.width == Fraction(1, 100)
    moves = [moved_bounds(truck(0.01), 1, j) for j in range(4)]
    assert all(end % axis.width == 0 for ends in moves for end in ends)


@pytest.mark.slow
def test_more_cells_at_a_higher_rate():
    """In some 670 steps of 10 ms a place is rounded out as often: .768 of .800 with so many cells, .60 with 4,096."""
    counts = [sdhj.Certified().axes(truck(delta))[0].count for delta in (0.1, 0.01)]
    assert counts[1] > 2 * counts[0] and counts[1] > 15_000
    steps = losing_steps(truck(0.01), speeds_of(truck(0.01)))
    assert 667 <= steps < 700  # of random states the fastest has about 15 m/s


@pytest.mark.slow
def test_a_coordinate_that_goes_round_many_times_has_fewer_cells():
    """An interval may lead 32,767 cells on: a wheel that turns 16 times in one has 1,023 cells at most."""
    wheel = sdhj.ReachAvoidProblem(
        sdhj.Grid([0.0, -1.0], [1.0, 1.0], (21, 21), periodic=[True, False], ends=["unsafe", "wall"]),
        sdhj.Dynamics(
            [[-1.0], [1.0]], lambda q, u: np.stack([16.0 + 0.1 * q[:, 1], u[0] + 0.0 * q[:, 0]], axis=1), None, None
        ),
        sdhj.TargetSet((0,), lambda p, t: np.abs(p[:, 0] - 0.5) - 0.2),
        [],
        1.0,
        3,
    )
    axes = sdhj.Certified(seconds=600.0).axes(wheel)
    assert axes[0].count * 16.1 < 32_767
    assert sdhj.solve(wheel, sdhj.Certified(seconds=1.0), progress=False, play=False).fraction() > 0


def test_numbers_of_blocks_fit_into_memory():
    """A table of 100,000 steps has 4 bytes a step for each cell of its leading axis: at most 10,000 of these."""
    problem = replace(truck(0.01), steps=100_000)
    assert 1000 < sdhj.Certified(seconds=1e6).axes(problem)[0].count <= 10_000


@pytest.mark.slow
def test_what_is_for_ever_takes_no_memory_for_each_step():
    """1,001 entries of 20,000 rows would be 80 MB of numbers of blocks; only the last set's are kept."""
    tracemalloc.start()
    table = sdhj.solve(joint(0.1), sdhj.Certified(cells=(20_000, 40)), progress=False, play=False)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert table.details["endless"] and len(table.index) == 1 and table.fraction() > 0.8
    assert peak < 60e6 < 4 * 1001 * 20_000
