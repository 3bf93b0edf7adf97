"""What an interval does to the cells of the arm, the goals and the recursion, against samples and the slow twin."""

import itertools

import naive_certified as naive
import numpy as np
import pytest
from naive_certified import SMALL

import sdhj
from sdhj.arm.case_studies import scene
from sdhj.certified.cells import as_rounded_fraction, velocity_bounds


@pytest.fixture(scope="module")
def clear(small):
    """For each input the cells from which the pursuer cannot touch the arm: bool (L, n1, n2, nx, ny)."""
    return naive.unpacked(np.array(small.proof.prepare(False)), small.shape[2:])


def images(table, axis):
    """First cell of the image of each cell of an axis and how many there are, for each input, from exact velocities."""
    problem, cells, delta = table.problem, table.axes[axis], as_rounded_fraction(table.problem.delta)
    speeds = [velocity_bounds(problem, axis, j) for j in range(len(problem.inputs))]
    return [cells.image(slow * delta, fast * delta) for slow, fast in speeds]


@pytest.mark.slow
def test_goal_cells_are_inside_the_target(small, rng):
    problem, stage = small.problem, scene(small.problem)
    edges = [axis.edges() for axis in small.axes]
    for step in range(problem.steps + 1):
        cells = np.argwhere(small.bits(start=step, within=0))
        assert len(cells) > 100
        for cell in rng.permutation(cells)[:100]:
            low = np.array([own[i] for own, i in zip(edges, cell, strict=True)])
            high = np.array([own[i + 1] for own, i in zip(edges, cell, strict=True)])
            states = np.array(list(itertools.product(*zip(low, high, strict=True))))
            states = np.concatenate([states, rng.uniform(low, high, (16, 4))])
            t = problem.time(step)
            assert (stage.target_value(states[:, :2], t) < 0).all()
            assert (stage.obstacles_value(states[:, :2], t) > 0).all() and (stage.pursuer_value(states, t) > 0).all()


@pytest.mark.slow
def test_no_goal_cell_is_left_out_by_much(small):
    """A cell whose states are inside the target by 2 mm and clear by 2 mm (at its corners and middle) is certified."""
    problem, stage = small.problem, scene(small.problem)
    mesh = [axis.edges() for axis in small.axes]
    goal = small.bits(start=1, within=0)
    t = problem.time(1)
    for cell in itertools.product(range(0, 31, 3), range(0, 31, 3), range(0, 12, 4), range(0, 12, 4)):
        ends = [np.linspace(own[i], own[i + 1], 5) for own, i in zip(mesh, cell, strict=True)]
        states = np.stack([grid.ravel() for grid in np.meshgrid(*ends)], axis=1)
        deep = stage.target_value(states[:, :2], t).max() < -0.002
        free = min(stage.obstacles_value(states[:, :2], t).min(), stage.pursuer_value(states, t).min()) > 0.002
        assert goal[cell] or not (deep and free)


@pytest.mark.slow
def test_recursion_agrees_with_the_twin(small, clear):
    problem, motion = small.problem, small.proof.motion
    moved = [images(small, axis) for axis in range(4)]
    window = [(own[0][0], own[0][0] + own[0][1] - 1) for own in moved[2:]]
    for step, within in ((0, 1), (0, 2)):
        following = small.bits(start=step + 1, within=within - 1)
        expected = small.bits(start=step, within=within - 1).copy()
        for j in range(len(problem.inputs)):
            first, number = zip(*(moved[axis][j] for axis in range(2)), strict=True)
            found = naive.one_step(following, first, number, window, motion.allowed[step, j], clear[j])
            for cell in found:
                expected[cell] = True
        np.testing.assert_array_equal(small.bits(start=step, within=within), expected)
    assert small.fraction(start=0, within=2) > small.fraction(start=0, within=1) > small.fraction(start=0, within=0) > 0


@pytest.mark.slow
def test_every_certified_state_has_an_input(small, clear, rng):
    """In every certified cell, and exactly the inputs that the recursion found there, but for the halved margin."""
    problem, motion = small.problem, small.proof.motion
    new = small.bits(start=0, within=2) & ~small.bits(start=0, within=1)
    cells, moved = rng.permutation(np.argwhere(new))[:400], [images(small, axis) for axis in range(4)]
    following = small.bits(start=1, within=1)
    edges = [axis.edges() for axis in small.axes]
    for cell in cells:
        state = np.array([(own[i] + own[i + 1]) / 2 for own, i in zip(edges, cell, strict=True)])
        found = set(np.flatnonzero(small.certified_inputs(state[None], 0, 2)[0]))
        expected = set()
        for j in range(len(problem.inputs)):
            boxes = [
                (own[j][0][i] + np.arange(own[j][1][i])) % n for own, i, n in zip(moved, cell, small.shape, strict=True)
            ]
            if motion.allowed[0, j, cell[0], cell[1]] and clear[j][tuple(cell)] and following[np.ix_(*boxes)].all():
                expected.add(j)
        assert expected and expected == found


def test_sizes_beyond_the_margin_are_refused():
    long = {"lengths": (8.0, 8.0), "target": SMALL["target"] | {"radius": 14.0}, "obstacles": ()}
    problem = sdhj.arm_case_study(**(SMALL | long))
    with pytest.raises(ValueError, match="lengths up to"):
        sdhj.Certified().sets(problem)
