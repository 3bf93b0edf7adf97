"""How much velocities may differ between two states: closed forms, differences on fine grids, jumps, black boxes."""

from dataclasses import replace

import numpy as np
import pytest
import zoo

from sdhj import BlackBox, Dynamics, Grid, Sensing
from sdhj.problem.steepness import lipschitz_bounds
from sdhj.table.beside import predicted

PLANE = Grid([-np.pi, -3.0], [np.pi, 3.0], [21, 21], [True, False])


def columns(*values):
    return np.stack(np.broadcast_arrays(*values), axis=1)


def rates_of(dynamics, grid=PLANE, end=1.0):
    return lipschitz_bounds(grid, dynamics.read(grid.ndim), end, 0.1)


def test_a_car():
    """A of cosine and sine is the speed, also where no node is at their steepest."""
    drift = lambda q, u: columns(2 * np.cos(q[:, 2]), 2 * np.sin(q[:, 2]), u[0])  # noqa: E731
    slope, push, jumps = rates_of(
        Dynamics([[-1.0], [1.0]], drift, np.eye(3)[:, :2], [0.1, 0.2]),
        Grid([-1, -1, -np.pi], [1, 1, np.pi], [9, 9, 7], [False, False, True]),
    )
    np.testing.assert_allclose(slope, [[0, 0, 2], [0, 0, 2], [0, 0, 0]], rtol=1e-12)
    np.testing.assert_allclose(push, [0.1, 0.2, 0.0], rtol=1e-12)
    assert not jumps.any() and (slope[:2, 2] >= 2.0).all()


def test_a_pendulum_with_friction():
    """The derivative of v |v| / 10 is |v| / 5; a kink at 0 is none of v |v|."""
    drift = lambda q, u: columns(q[:, 1], u[0] - 9.81 * np.sin(q[:, 0]) - 0.1 * q[:, 1] * abs(q[:, 1]))  # noqa: E731
    slope, push, _ = rates_of(Dynamics([[-1.0], [1.0]], drift, [[0.0], [1.0]], [0.3]))
    np.testing.assert_allclose(slope, [[0.0, 1.0], [9.81, 0.6]], rtol=1e-3)
    np.testing.assert_allclose(push, [0.0, 0.3])


FIELDS = {
    "gain": ({"drift": lambda q: columns(q[:, 1] ** 2, np.sin(q[:, 0]) * q[:, 1]),
              "gain": lambda q: columns(np.cos(q[:, 0]), 1 + q[:, 1] ** 2)[:, :, None], "bounds": [0.5]}, 1.0),
    "not linear": ({"velocity": lambda q, v: columns(np.sin(v[0]) * q[:, 1], np.cos(q[:, 0]) * (1 + v[0]) ** 2),
                    "bounds": [0.5]}, 1.0),
    "bounds of the state": ({"drift": lambda q: 0.0 * q, "gain": np.ones((2, 1)),
                             "bounds": lambda q: 0.1 * np.hypot(np.sin(q[:, 0]), q[:, 1])[:, None]}, 1.0),
    "time": ({"drift": lambda q, t: columns(np.sin(q[:, 0]) * np.sin(3 * t), q[:, 1] * np.exp(-t)),
              "gain": np.ones((2, 1)), "bounds": lambda t: [np.cos(5 * t)**2]}, 2.0),
}  # fmt: skip


@pytest.mark.parametrize("name", FIELDS)
def test_no_difference_on_a_fine_grid_is_steeper(name):
    """And A is not much more than the largest of them, nor b more than what v is found to add."""
    given, end = FIELDS[name]
    field = Dynamics([[0.0]], **given).read(2)
    slope, push, jumps = lipschitz_bounds(PLANE, field, end, 0.1)
    fine, steep, added = Grid(PLANE.lower, PLANE.upper, [150, 151], PLANE.periodic), np.zeros((2, 2)), np.zeros(2)
    for t in np.linspace(0, end, 9 if field.depends_on_time else 1):
        most = field.bounds_at(0, t)
        calm = field.velocity_at(fine.points(), 0, 0 * most, t)
        for share in (-1.0, -0.9, 1.0):
            velocity = field.velocity_at(fine.points(), 0, share * most, t)
            added = np.maximum(added, np.abs(velocity - calm).max(axis=0))
            for axis, k in np.ndindex(2, 2):
                low, high = fine.edges(velocity[:, axis].reshape(fine.shape), k)
                steep[axis, k] = max(steep[axis, k], np.abs(high - low).max() / fine.spacing[k])
    assert (steep <= slope + 1e-12).all() and (added <= push + 1e-12).all() and not jumps.any()
    assert (slope <= 1.02 * steep + 1e-9).all() and (push <= 1.01 * added + 1e-9).all()


@pytest.mark.parametrize(
    ("law", "width"),
    [
        (lambda q: np.sign(q), 2.0),
        (lambda q: np.where(q > 1, 1.0, 0.0) * q, 3.0),
        (lambda q: np.sqrt(np.abs(q)), np.sqrt(3)),
    ],
    ids=["sign", "where", "root"],
)
def test_what_jumps_is_taken_at_its_worst(law, width):
    """The velocity on one side of a jump is no nearer to the other's for a smaller error: E grows by all of it."""
    slope, push, jumps = rates_of(Dynamics([[0.0]], lambda q: columns(np.sin(q[:, 0]), law(q[:, 1]))))
    np.testing.assert_allclose(slope, [[1.0, 0.0], [0.0, 0.0]], rtol=1e-3)
    np.testing.assert_allclose(jumps, [0.0, width], rtol=1e-9)
    assert not push.any()


def test_states_on_two_sides_of_a_jump_stay_in_the_box():
    """A robot that is pushed away from 0, and measured on the other side: differences between nodes would say less."""
    jump = Dynamics([[-1.0], [0.0], [1.0]], lambda q, u: u[0] + 0.2 * np.sign(q), [[1.0]], [0.1])
    problem = replace(zoo.interval_problem(), dynamics=jump, sensing=Sensing(0.01, 0.1, memory=False))
    box, wider = problem.half_widths
    np.testing.assert_allclose(box, 0.01 + 0.1 * (0.4 + 0.2), rtol=1e-9)
    np.testing.assert_allclose(wider, 2 * box + 0.5 * (0.4 + 0.2), rtol=1e-9)
    state, measured = np.array([[0.004]]), np.array([[-0.004]])
    moved = problem.interval(0).advance(state, np.array([1]), np.array([[0.1]]), 0.0, 0.1)
    off = float((moved - predicted(problem, measured, np.array([1])))[0, 0])
    assert 0.057 < off <= box[0]


def test_ends_of_a_periodic_axis_that_differ_are_a_jump():
    _, _, jumps = rates_of(Dynamics([[0.0]], lambda q: columns(-q[:, 0], np.cos(q[:, 0] + 1) * q[:, 1])))
    np.testing.assert_allclose(jumps, [2 * np.pi, 0.0])


def test_black_boxes_declare_it():
    gain = BlackBox(lambda q: columns(0 * q[:, 0], q[:, 0])[:, :, None], reads=[0], slope=[[0, 0], [1, 0]], rate=0.0)
    drift = BlackBox(lambda q: columns(q[:, 1], np.sin(q[:, 0])), slope=[[0, 1.0], [1.0, 0]], rate=0.0)
    known = lambda q: columns(np.sin(q[:, 0]), q[:, 1])  # noqa: E731
    slope, push, _ = rates_of(Dynamics([[0.0]], known, gain, [0.5]))
    np.testing.assert_allclose(slope, [[1.0, 0.0], [0.5, 1.0]], rtol=1e-3)
    np.testing.assert_allclose(push, [0.0, np.pi / 2], rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(rates_of(Dynamics([[0.0]], drift, gain, [0.5]))[0], [[0, 1], [1.5, 0]])
    alone = Dynamics([[0.0]], known, gain, [0.5]).read(2).past_ends([0], [-9.0, 0.0], [9.0, 0.0])
    np.testing.assert_allclose(lipschitz_bounds(Grid([-3.0], [3.0], [5]), alone, 1.0, 0.1)[0], [[1.0]], rtol=1e-3)
    with pytest.raises(ValueError, match="BlackBox without a slope"):
        rates_of(Dynamics([[0.0]], replace(drift, slope=None)))
    with pytest.raises(ValueError, match="BlackBox without a rate"):
        rates_of(Dynamics([[0.0]], known, replace(gain, rate=None), [0.5]))
