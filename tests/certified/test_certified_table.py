"""Certified sets behind the table's interface, and a controller that plays them."""

import dataclasses
import os
import subprocess
import sys

import numpy as np
import pytest
from zoo import interval_problem

import sdhj
from sdhj.certified import Certified


@pytest.fixture(scope="module")
def table():
    return sdhj.solve(sdhj.arm_case_study(nodes=9, steps=3), Certified(cells=(84, 84, 24, 24)), progress=False)


@pytest.mark.slow
def test_values_and_contains_agree_and_tubes_grow(table):
    points = table.grid.points()
    inside = [table.values(start=0, within=n).ravel() <= 0 for n in range(4)]
    for n in range(4):
        assert np.array_equal(inside[n], table.contains(points, start=0, within=n))
        assert n == 0 or (inside[n] >= inside[n - 1]).all()
    shares = [table.fraction(start=0, within=n) for n in range(4)]
    assert shares == sorted(shares) and 0 < shares[0] < shares[3] < 1
    assert np.array_equal(table.values(start=0, within=9), table.values(start=0, within=3))


@pytest.mark.slow
def test_steps_to_go_is_the_first_tube_that_holds_the_state(table, rng):
    grid, width = table.grid, np.array([float(axis.width) for axis in table.axes])
    anywhere = rng.uniform(grid.lower, grid.upper, (20_000, 4))
    edges = anywhere.copy()  # on an edge of a cell two cells hold a state, on a corner sixteen
    edges[:, :2] = -np.pi + width[:2] * rng.integers(0, table.shape[0], (20_000, 2))
    for states in (anywhere, edges):
        for step in range(4):
            tubes = [table.contains(states, start=step, within=n) for n in range(4 - step)]
            expected = np.where(np.any(tubes, axis=0), np.argmax(tubes, axis=0), 4 - step)
            np.testing.assert_array_equal(table.steps_to_go(states, step), expected)
            assert step > 0 or set(expected) == {0, 1, 2, 3, 4}


@pytest.mark.slow
def test_runs_share_out_over_threads_on_the_simplest_threading_layer(table, tmp_path):
    """Numba's workqueue layer ends the process where two threads call parallel kernels at once."""
    table.save(tmp_path / "certified.npz")
    code = (
        "import sys, sdhj\nfrom sdhj.table import batches\nfrom sdhj.simulation import runs\n"
        "batches.threads = runs.threads = lambda: 2\n"
        "controller = sdhj.Controller(sdhj.load(sys.argv[1]))\n"
        "print(sdhj.monte_carlo(controller, 3000, 'random', progress=False).counts['reached'])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "certified.npz")],
        env=os.environ | {"NUMBA_THREADING_LAYER": "workqueue", "NUMBA_NUM_THREADS": "2"},
        capture_output=True,
        text=True,
    )
    assert done.stdout.strip() == "3000", done.stderr


@pytest.mark.slow
def test_outside_the_certified_set_it_says_so(table):
    controller, points = sdhj.Controller(table), table.grid.points()
    free = table.problem.unsafe_value(points, 0.0) > 0.0
    with pytest.raises(sdhj.NotAdmissible, match="in the unsafe set"):
        controller.select([3.0, 3.0, 0.0, 0.0], 0)
    with pytest.raises(sdhj.NotAdmissible, match=r"certified: table\.explain says why"):
        controller.select(points[free & ~table.contains(points, start=0)][0], 0)
    assert controller.steps_to_go([3.0, 3.0, 0.0, 0.0], 0) is None
    with pytest.raises(ValueError, match="NaN"):
        controller.steps_to_go([np.nan, 0.0, 0.0, 0.0], 0)


@pytest.mark.slow
def test_in_the_target_inputs_are_those_that_are_proved_to_lead_back(table, rng):
    """As for other tables. An index of -1 would be the last input, proved or not."""
    states = rng.uniform(table.grid.lower, table.grid.upper, (20_000, 4))
    there = states[table.steps_to_go(states, 0) == 0]
    proved = table.certified_inputs(there, 0, 1)
    assert 0 < proved.any(axis=1).sum() < len(there)
    controller = sdhj.Controller(table)
    batch = controller.batch(there, 0)
    assert np.array_equal(batch.safe, proved) and (batch.steps_to_go == 0).all()
    assert (batch.margins[proved] <= 0).all() and np.isinf(batch.margins[~proved]).all()
    held, lost = there[proved.any(axis=1)][0], there[~proved.any(axis=1)][0]
    assert proved[np.flatnonzero((there == held).all(axis=1))[0], controller.select(held, 0)]
    with pytest.raises(sdhj.NotAdmissible, match="target at step 0"):
        controller.select(lost, 0)


@pytest.mark.parametrize("name", ["left/right", "", "a\0b"])
def test_sets_may_have_any_name(tmp_path, name):
    problem = interval_problem(steps=1)
    (part,) = problem.unsafe
    problem = dataclasses.replace(problem, unsafe=(dataclasses.replace(part, name=name),))
    made = sdhj.solve(problem, Certified(cells=[40]), progress=False)
    made.save(tmp_path / "own.npz")
    assert [one.name for one in sdhj.load(tmp_path / "own.npz").problem.unsafe] == [name]


@pytest.mark.parametrize("cells", [40, [np.inf], [1]])
def test_cells_that_are_no_numbers_of_cells(cells):
    with pytest.raises(ValueError, match="whole numbers from 2"):
        Certified(cells=cells)


def test_cells_are_one_number_for_each_axis():
    with pytest.raises(ValueError, match="cells"):
        Certified(cells=[40, 40]).sets(interval_problem(steps=1))
