"""The look-up table in memory: what it stores once, what it says of nodes and of states between them."""

import dataclasses

import numpy as np
import pytest
from zoo import interval_problem, one_row, small_torus_table, torus_problem

import sdhj
from sdhj import Dynamics
from sdhj.solver.recursion import GridSets
from sdhj.table.controller import Controller
from sdhj.table.table import entries, entry


@pytest.fixture(scope="module")
def table():
    return small_torus_table()


def test_values_cannot_be_modified_and_indices_are_checked(table):
    with pytest.raises(ValueError):
        table.values(start=0, within=1)[0, 0] = 1.0
    for bad in (
        {"start": 4, "within": 0},
        {"start": 0, "within": -1},
        {"start": 0.5, "within": 1},
        {"start": 0, "within": np.inf},
        {"start": True, "within": 1},
    ):
        with pytest.raises(ValueError, match=r"start|within"):
            table.values(**bad)


def test_contains_on_and_off_the_grid(table):
    grid = table.grid
    inside = table.values(start=0, within=2).ravel() <= 0
    assert np.array_equal(table.contains(grid.points(), start=0, within=2), inside)
    turned = grid.points() + np.array([2 * np.pi, -4 * np.pi])
    safely = np.abs(table.values(start=0, within=2).ravel()) > 1e-5
    assert np.array_equal(table.contains(turned, start=0, within=2)[safely], inside[safely])
    assert not table.contains([[1e300, 0.0], [0.0, -np.inf]], start=0, within=2).any()  # no digits left to place it by
    with pytest.raises(ValueError, match="NaN"):
        table.contains([[np.nan, 0.0]], start=0, within=1)
    with pytest.raises(ValueError, match="shape"):
        table.contains([[0.0, 0.0, 0.0]], start=0, within=1)


def test_off_a_bounded_axis_nothing_is_contained():
    table = sdhj.solve(interval_problem(steps=2, unsafe=False))
    assert table.contains([[0.0], [4.1], [-4.1]], start=0, within=2).tolist() == [True, False, False]


def test_fraction_is_a_share_of_volume(table):
    assert table.fraction(start=0, within=2) == pytest.approx((table.values(start=0, within=2) <= 0).mean())
    bounded = sdhj.solve(interval_problem(nodes=9, steps=1, unsafe=False))
    # nodes -4, -3, ..., 4; the target |q| <= 1 holds three of the eight cells' worth
    assert bounded.fraction(start=0, within=0) == pytest.approx(3 / 8)


def test_digest_sees_every_part_of_a_problem():
    problem = torus_problem(nodes=8)
    (part,) = problem.unsafe
    changed = [
        dataclasses.replace(problem, delta=0.21),
        dataclasses.replace(problem, steps=4),
        dataclasses.replace(problem, view_time="sampled"),
        dataclasses.replace(problem, unsafe=()),
        dataclasses.replace(problem, unsafe=(dataclasses.replace(part, sampling="steep"),)),
        dataclasses.replace(problem, unsafe=(dataclasses.replace(part, swept=lambda p, t0, t1: 0.0 * p[:, 0] - 1.0),)),
        dataclasses.replace(problem, dynamics=Dynamics(problem.inputs, problem.inputs, np.eye(2), [0.4, 0.5])),
        dataclasses.replace(problem, dynamics=Dynamics(problem.inputs, problem.inputs, 2 * np.eye(2), [0.4, 0.4])),
        dataclasses.replace(problem, target=dataclasses.replace(problem.target, level_set=lambda p, t: p[:, 0])),
        torus_problem(nodes=9),
    ]
    digests = {p.digest for p in changed}
    assert len(digests) == len(changed) and problem.digest not in digests
    assert torus_problem(nodes=8).digest == problem.digest


# ---- equal tubes are stored once


def sets_of(steps, *, time_invariant):
    rate = 0.0 if time_invariant else 0.1  # of the wall
    problem = interval_problem(nodes=9, steps=steps, rate=rate)
    assert problem.time_invariant == time_invariant
    sets = GridSets(problem, sdhj.HopfLax("linear", "float64"))
    sets.begin()
    return sets


def test_entries_come_in_the_order_of_their_places():
    assert entries(3).tolist() == [[0, 0], [0, 1], [0, 2], [0, 3], [1, 0], [1, 1], [1, 2], [2, 0], [2, 1], [3, 0]]
    assert [entry(3, start, within) for start, within in entries(3).tolist()] == list(range(10))


@pytest.mark.parametrize("share", [0.3, 1.0])
def test_shared_tubes_are_the_ones_before_and_take_no_room(share, rng):
    """Each tube is filled with a number of its own, or shared; a dictionary keeps book."""
    sets, told = sets_of(6, time_invariant=False), {}
    for k in range(6, -1, -1):
        for n in range(7 - k):
            if n >= 2 and rng.random() < share:
                sets.repeat(k, n)
                told[k, n] = told[k, n - 1]
            else:
                told[k, n] = len(told)
                sets.tubes[sets.place(k, n)] = sets.marks[sets.place(k, n)] = told[k, n]
    done = sets.finish({"seconds": 1.0})
    assert done.details["seconds"] == 1.0 and len(done.index) == len(told) == 28
    for (k, n), number in told.items():
        assert (done.values(start=k, within=n) == number).all() and (done.mark_array(k, n) == number).all()
    stored = len(set(told.values()))
    assert len(done.tubes) == len(done.marks) == stored and done.tubes.nbytes + done.marks.nbytes == stored * 81


def test_without_time_there_is_one_tube_for_each_number_of_steps():
    """A row finds the tubes of the next one filled in; its one new tube is filled in, or shared by all that follow."""
    sets = sets_of(5, time_invariant=True)
    assert len(sets.tubes) == 6
    for k in range(5, -1, -1):
        for n in range(6 - k):
            if n >= 3:  # as if the tube had stopped growing there: it grows no more
                sets.repeat(k, n)
            elif n == 5 - k:
                sets.tubes[sets.place(k, n)] = n
    done = sets.finish({})
    assert len(done.tubes) == 3
    for start, within in entries(5).tolist():
        assert (done.values(start=start, within=within) == (0, 1, 2, 2, 2, 2)[within]).all()


def test_a_shared_tube_answers_as_one_stored_for_itself(rng):
    table = one_row(sdhj.solve(interval_problem(nodes=41, steps=6, rate=-0.3), progress=False))
    assert len(table.tubes) == 7 and len(table.index) == 28
    apart = dataclasses.replace(
        table, index=np.arange(28), tubes=table.tubes[table.index], marks=table.marks[table.index]
    )
    states, batches = rng.uniform(-4, 4, (500, 1)), []
    for one in (table, apart):
        batches.append([Controller(one).batch(states, step) for step in range(7)])
    assert len({n for batch in batches[0] for n in batch.steps_to_go.tolist()}) >= 6
    for shared, other in zip(*batches, strict=True):
        for name in ("steps_to_go", "safe", "margins"):
            np.testing.assert_array_equal(getattr(shared, name), getattr(other, name))
    assert 4 * (table.tubes.nbytes + table.marks.nbytes) == apart.tubes.nbytes + apart.marks.nbytes


def test_nbytes_are_those_of_every_array():
    for table in (sdhj.solve(interval_problem(rate=-0.3), method, progress=False) for method in ("hji", "lax")):
        held = [*vars(table).values(), *vars(table.avoid).values()]
        assert table.nbytes == sum(one.nbytes for one in held if isinstance(one, np.ndarray))


# ---- states between the nodes


def test_values_at_are_the_interpolated_tubes_and_those_at_a_wall_beyond_it(rng):
    table = sdhj.solve(interval_problem(nodes=41, steps=4), progress=False)
    points, within = rng.uniform(-4.0, 4.0, (60, 3, 1)), rng.integers(0, 4, 60)
    values = table.values_at(points, 1, within)
    for n in range(4):
        expected = table.grid.interpolate(table.values(start=1, within=n), points[within == n].reshape(-1, 1))
        np.testing.assert_array_equal(values[within == n].ravel(), expected)
    beyond, wall = (table.values_at(np.full((1, 1, 1), q), 1, np.array([3])) for q in (9.0, 4.0))
    assert beyond == wall
    most = table.values_at(points, 1, np.full(60, 3))
    np.testing.assert_array_equal(table.values_at(points, 1, np.full(60, 99)), most)  # as `values` takes it
    assert table.values_at(np.empty((0, 2, 1)), 0, np.empty(0, int)).shape == (0, 2)


@pytest.mark.parametrize("shape", [(5, 2, 2), (4, 2, 1)])
def test_values_at_checks_its_points(shape):
    table = sdhj.solve(interval_problem(nodes=9, steps=1), progress=False)
    with pytest.raises(ValueError, match=r"shape \(5, V, 1\)"):
        table.values_at(np.zeros(shape), 0, np.zeros(5, int))
    with pytest.raises(ValueError, match=r"start|step"):
        table.values_at(np.zeros((5, 1, 1)), 2, np.zeros(5, int))
