"""Cells that nobody gave: what the rule says of losses that are known by hand, and what a solve makes of it."""

import math
import tracemalloc
from dataclasses import replace
from fractions import Fraction

import costs
import large
import numpy as np
import pytest
import zoo
from test_memory import joint
from zoo import car, interval_problem

import sdhj
from sdhj.certified.cells import aligned, aligned_choices, moved_bounds
from sdhj.certified.choosing import CORES, chosen_cells, losing_steps, lost_to_width, seconds_taken


def plane(spin=0.0, **changed):
    """x and y; dx = u + spin y, dy = u, a disk of radius 1 to get to in one step of 0.5 s, walls all around."""
    drift = lambda q, u: np.stack([u[0] + spin * q[:, 1], u[0] + 0.0 * q[:, 0]], axis=1)  # noqa: E731
    usual = {
        "grid": sdhj.Grid([-4.0, -4.0], [4.0, 4.0], [401, 401], ends="wall"),
        "dynamics": sdhj.Dynamics([[-1.0], [1.0]], drift, np.eye(2), [0.1, 0.1]),
        "target": zoo.goal(0.0, 0.0, 1.0),
        "delta": 0.5,
        "steps": 1,
    }
    return zoo.plane(**usual | changed)


@pytest.mark.slow
def test_what_widths_lose():
    """A disk of radius 1 is crossed twice in 2 of 8 m, on pi of 64 m^2: m = 4 / pi. Then by hand, for each step."""
    m, still = 4 / math.pi, lost_to_width(plane(steps=3))
    np.testing.assert_allclose(still, [m, m], rtol=0.02)  # aligned: nothing but the boundary
    # x is rounded out by any width, y turns x: 2 m / s for each m, half a second
    np.testing.assert_allclose(lost_to_width(plane(2.0, steps=3)), [m + 3 * m, m + 3 * 0.5 * 2.0 * m], rtol=0.02)
    unsafe = replace(plane(steps=3), grid=replace(plane().grid, ends="unsafe"))
    np.testing.assert_allclose(lost_to_width(unsafe) - still, [2 / 8, 2 / 8], rtol=1e-9)


def test_an_input_leads_a_whole_number_of_cells():
    """Half a second at .9 to 1.1 m/s, either way: .45 m at least are so many cells, and hardly more."""
    grid = sdhj.Grid([-4.0, -4.0], [4.0, 4.0], [81, 81])
    moves = [[-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0], [0.5, 0.0]]
    plain = zoo.plane(moves, (math.sqrt(0.01), 0.1), grid=grid, target=zoo.goal(0.0, 0.0, 1.0), delta=0.5, steps=9)
    for seconds in (0.02, 0.1, 1.0):
        for cells in chosen_cells(plain, 10, seconds):
            assert 0.0 <= 0.45 / (8.0 / cells) % 1.0 < 0.06


def test_the_same_cells_everywhere_and_more_for_more_time():
    problem = replace(car(), steps=8)
    method, counts = sdhj.Certified(), chosen_cells(problem, 10, 60.0)
    assert [axis.count for axis in method.axes(problem)] == [axis.count for axis in aligned(problem, counts)]
    assert counts == chosen_cells(problem, 10, 60.0) and counts[0] > 1.5 * counts[2]
    taken = [sum(seconds_taken(problem, aligned(problem, chosen_cells(problem, 10, s)), 10)) for s in (3, 30)]
    assert 3.2 * CORES >= taken[0] > 2.4 and 32 * CORES >= taken[1] > 24


@pytest.mark.slow
def test_words_along_which_sets_are_packed_are_full():
    """A crane: 65 cells of x take as long as 128. A pursuer's last axis, of 14 cells, is not worth a word."""
    crane = costs.crane()
    assert [chosen_cells(crane, 10, seconds)[0] for seconds in (0.5, 2.0, 8.0)] == [64, 128, 128]
    assert chosen_cells(large.WORKED["arm"].problem(9), 10, 2.0)[4] < 32


@pytest.mark.slow
@pytest.mark.parametrize("delta", [0.01, 0.005])
def test_cells_fit_the_rate(delta):
    """The joint that remembers, at 100 and 200 Hz: an input moves by a cell at least; .8365 and 0 without that."""
    problem = joint(delta)
    axes = sdhj.Certified(seconds=0.5).axes(problem)
    assert float(axes[1].width) <= 3.9 * delta * (1 + 1e-9)
    table = sdhj.solve(problem, sdhj.Certified(seconds=0.5), progress=False, play=False)
    assert table.fraction() > 0.857  # of .905, in half a second


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
def test_where_steps_gain_nothing_the_target_counts():
    """In six dimensions in 10 s a step loses more than there is: cells go to x, y, z, the axes of target and ball."""
    cells = chosen_cells(large.WORKED["space"].problem(17), 10, 10.0)
    assert min(cells[:3]) > 2 * max(cells[3:])


def truck(delta):
    """Before something that stands 100 m on, up to 15 m/s; a push on brake and throttle of up to a third: its mass."""
    dynamics = sdhj.Dynamics(
        [[-4.0], [-2.0], [0.0], [2.0]],
        lambda q, u: np.stack([q[:, 1], 0.75 * u[0] + 0.0 * q[:, 1]], axis=1),
        lambda q, u: np.stack([0.0 * q[:, :1], 0.0 * q[:, :1] + u[0]], axis=1),
        [0.25],
    )
    grid = sdhj.Grid([0.0, 0.0], [100.0, 15.0], (201, 61), ends=["unsafe", "wall"])
    return zoo.cart(grid=grid, dynamics=dynamics, delta=delta, sensing=sdhj.Sensing((0.1, 0.05)))


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
    steps = losing_steps(truck(0.01))
    assert 667 <= steps < 700  # of random states the fastest has about 15 m/s


@pytest.mark.slow
def test_a_coordinate_that_goes_round_many_times_has_fewer_cells():
    """An interval may lead 32,767 cells on: a wheel that turns 16 times in one has 1,023 cells at most."""
    wheel = zoo.cart(
        grid=sdhj.Grid([0.0, -1.0], [1.0, 1.0], (21, 21), periodic=[True, False], ends=["unsafe", "wall"]),
        dynamics=sdhj.Dynamics(
            [[-1.0], [1.0]], lambda q, u: np.stack([16.0 + 0.1 * q[:, 1], u[0] + 0.0 * q[:, 0]], axis=1), None, None
        ),
        target=zoo.goal(0.5, 0.2),
        delta=1.0,
        steps=3,
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
