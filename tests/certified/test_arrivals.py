"""Images inside the target itself: against plain samples, a closed form, and runs that end there."""

import itertools

import numpy as np
import pytest
import zoo
from forged_robots import solved

import sdhj
from sdhj.certified.arrivals import HALVINGS, MOST_PIECES
from sdhj.certified.bounds import Bounds


def unaligned(target=0.0, pace=0.0, push=0.08, **given):
    """On a line, dx = u + v, to a target whose ends are in the middle of cells."""
    level = lambda p, t: np.abs(p[:, 0] - target - pace * t) - 0.95  # noqa: E731
    return zoo.line(push=push, target=sdhj.TargetSet((0,), level), **given)


def proved(problem, cells=(80,)):
    return sdhj.solve(problem, sdhj.Certified(cells=cells, parts=1), progress=False, play=False)


def marked(table, step, j):
    """Which sites have the bit of an input: (sites,) bool."""
    arrives = table.proof.arrives
    return (arrives[min(step, len(arrives) - 1), :, j // 8] >> (j % 8) & 1).astype(bool)


@pytest.mark.parametrize("pace", [0.0, 0.3])
def test_arrivals_on_a_line_are_those_of_the_closed_form(pace):
    """From [a, b] under u all states come to [a, b] + u delta + [-1, 1] push delta."""
    table = proved(unaligned(pace=pace))
    edges = table.axes[0].edges()
    for step, j in itertools.product(range(3 if pace else 1), range(3)):
        middle = edges + (j - 1) * 0.5 - pace * 0.5 * (step + 1)
        inside = (middle[:-1] - 0.04 > -0.95) & (middle[1:] + 0.04 < 0.95)
        assert np.array_equal(marked(table, step, j), inside)
    if not pace:  # [-0.9, 0.9], and [-1.4, 1.4], whose last cell comes to [-0.94, -0.76]; by whole cells [-1.3, 1.3]
        assert [int(table.bits(start=0, within=n).sum()) for n in (0, 1)] == [18, 28]


@pytest.mark.parametrize("name", ["plane", "tide", "sliding", "surge", "to the left"])
def test_no_state_of_a_cell_that_arrives_is_outside_the_target(name):
    """Adversaries at the corners of their box, held or turned in the middle, by many short steps."""
    table, rng = solved(name), np.random.default_rng(0)
    problem, proof = table.problem, table.proof
    every = np.indices(table.shape).reshape(len(table.shape), -1).T
    for step, j in itertools.product(range(len(proof.arrives)), range(len(problem.inputs))):
        cells = every[marked(table, step, j)[every @ proof.sites]]
        cells = cells[rng.integers(0, len(cells), min(len(cells), 80))] if len(cells) else cells
        ends = [
            np.stack([axis.edges()[own + side] for axis, own in zip(table.axes, cells.T, strict=True)], 1)
            for side in (0, 1)
        ]
        if not len(cells):
            continue
        for turned in (1.0, -1.0):
            states = np.where(rng.random(cells.shape) < 0.5, *ends)
            push = rng.choice([-1.0, 1.0], (len(cells), problem.dynamics.disturbance_dim))
            for part in range(100):
                t = problem.time(step) + problem.delta * part / 100
                v = push * problem.dynamics.bounds_at(j, t) * (turned if part >= 50 else 1.0)
                states = states + problem.delta / 100 * problem.dynamics.velocity_at(states, j, v, t)
                states = problem.grid.clipped(states, "holds")
            assert (problem.target_value(states, problem.time(step + 1)) <= 0.02 * problem.delta).all()


def test_whoever_arrives_in_a_cell_that_is_not_whole_has_arrived():
    """0.93 is in the target, and its cell [0.9, 1] is not, wholly."""
    controller = sdhj.Controller(proved(unaligned()))
    assert controller.table.contains([[0.93]], within=0)[0]
    first, then = controller.step([1.38], 0.0), controller.step([0.93], 0.5)
    assert (first.steps_to_go, first.arrived, then.steps_to_go, then.arrived) == (1, False, 0, True)
    assert not controller.step([0.97], 1.0).arrived  # beside the target
    assert sdhj.monte_carlo(controller, runs=50, progress=False).counts["reached"] == 50


def test_a_loop_of_select_ends_where_it_has_arrived():
    """0.93 at the last step is in no set of cells, and in the target."""
    controller = sdhj.Controller(proved(unaligned(pace=1e-9)))
    assert (controller.steps_to_go([1.38], 2), controller.steps_to_go([0.93], 3)) == (1, 0)
    assert controller.steps_to_go([0.97], 3) is None
    with pytest.raises(sdhj.NotAdmissible, match="target at step 3"):
        controller.select([0.93], 3)
    with pytest.raises(sdhj.NotAdmissible, match="is not admissible"):
        controller.select([0.97], 3)


def test_predictions_arrive_in_cells_of_the_goal_alone():
    assert proved(unaligned(sensing=sdhj.Sensing(error=0.01)), (400,)).proof.arrives.size == 0


def test_arrivals_are_kept_in_a_file_and_older_files_have_none(tmp_path):
    table = proved(unaligned())
    table.save(tmp_path / "table.npz")
    loaded = sdhj.load(tmp_path / "table.npz")
    assert np.array_equal(loaded.proof.arrives, table.proof.arrives)
    states = np.linspace(-3.9, 3.9, 301)[:, None]
    assert np.array_equal(loaded.certified_inputs(states, 0, 2), table.certified_inputs(states, 0, 2))
    assert loaded.certified_inputs(states, 0, 3).any(axis=1).sum() >= loaded.contains(states).sum() - 2


def test_a_box_that_sticks_out_of_the_target_is_found_at_its_corners(monkeypatch):
    """Of a cube in four dimensions by comparing ends; pieces, 65,536 of a box, would be looked at for most of them."""
    target = sdhj.TargetSet((0, 1, 2, 3), lambda p, t: np.max(np.abs(p), axis=1) - 1.0)
    bounds = Bounds(zoo.chain(lower=[-2.0] * 4, upper=[2.0] * 4, target=target))
    low = np.random.default_rng(0).uniform(-1.2, 1.1, (500, 4))
    asked, level = [], Bounds.bounds_of_level_set
    monkeypatch.setattr(
        Bounds, "bounds_of_level_set", lambda self, part, a, *more: asked.append(len(a)) or level(self, part, a, *more)
    )
    found = bounds.inside(target, low, low + 0.15, (0.0, 0.0), HALVINGS, MOST_PIECES)
    inside = ((low >= -1.0) & (low + 0.15 <= 1.0)).all(axis=1)
    assert np.array_equal(found, inside) and 0 < inside.sum() < 300
    assert sum(asked) < (2 + 16) * len(low)
