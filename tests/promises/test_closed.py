"""G is closed: what is near a set whose function is 0 inside is as clear of it as of one with a sign.

The plant of the runs here is that of the simulation, in the true geometry: a state with g <= 0 has collided.
"""

from dataclasses import replace

import numpy as np
import pytest
from on_disk import assert_bit_equal

import sdhj
from sdhj.problem.findings import ResolutionWarning
from sdhj.problem.nodes import ON_BOUNDARY, closed
from sdhj.solver.joint import Joint

CENTRE, HALF = np.array([2.03, 1.47]), np.array([0.41, 0.52])  # of a box, m
RUNS = 1000


def signed(points, t):
    """Distance to the box, negative inside."""
    beyond = np.abs(points - CENTRE) - HALF
    return np.hypot(*np.maximum(beyond, 0.0).T) + np.minimum(beyond.max(axis=1), 0.0)


def unsigned(points, t):
    """As Shapely and distance transforms give it: 0 in the box."""
    return np.maximum(signed(points, t), 0.0)


def free(points, t):
    """1 - occupancy."""
    return np.where(signed(points, t) > 0.0, 1.0, 0.0)


def beside_a_post(level_set):
    """The smaller of a function and of a distance with a sign."""
    return lambda points, t: np.minimum(level_set(points, t), np.hypot(points[:, 0] - 0.9, points[:, 1] - 0.6) - 0.3)


def problem(level_set, steps=20, **options):
    """The robot of README's recipes: five velocities and a push of at most 0.1 m/s."""
    speeds = 0.5 * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
    return sdhj.ReachAvoidProblem(
        grid=sdhj.Grid([0, 0], [4, 3], [81, 61]),
        dynamics=sdhj.Dynamics(speeds, speeds, np.eye(2), [0.1, 0.1]),
        target=sdhj.TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 3.4, p[:, 1] - 1.5) - 0.4),
        unsafe=[sdhj.UnsafeSet((0, 1), level_set, **options)],
        delta=0.25,
        steps=steps,
    )


def collisions(table, adversary="none"):
    counts = sdhj.monte_carlo(sdhj.Controller(table), RUNS, adversary=adversary, seed=0, progress=False).counts
    assert counts["reached"] > 0.9 * RUNS
    return counts["collided"]


METHODS = {
    "hji": "hji",
    "joint": Joint(),
    "lax": "lax",
    "projected": "projected",
}


@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
def test_a_distance_without_a_sign_is_as_good_as_one_with(method):
    """Its tubes are those of the distance with a sign, but for rounding, and nobody collides without an adversary."""
    table, other = (sdhj.solve(problem(one), method, progress=False) for one in (unsigned, signed))
    shares = [one.fraction(start=0, within=20) for one in (table, other)]
    assert shares[0] == pytest.approx(shares[1], abs=1e-3)
    assert collisions(table) == 0


@pytest.mark.parametrize(
    ("method", "level_set"),
    [
        ("hji", free),
        ("lax", free),
        ("hji", beside_a_post(unsigned)),
        ("hji", lambda p, t: unsigned(p, t) ** 2),
        ("lax", lambda p, t: np.minimum(unsigned(p, t), 0.025)),  # cut off half a cell outside
        ("hji", lambda p, t: np.maximum(signed(p, t), -1e-12)),  # a hair below 0 inside
    ],
    ids=["occupancy", "occupancy, lax", "beside a post", "square", "cut off", "a hair below"],
)
def test_other_functions_that_tell_nothing_inside(method, level_set):
    """Each is constant in the set, and of none is more known than where it is at most 0."""
    assert collisions(sdhj.solve(problem(level_set), method, progress=False)) == 0


@pytest.mark.slow
def test_a_moving_set_and_a_store(tmp_path):
    """Swept over pieces of the interval, and then closed; and on disk with the same bits."""
    moving = problem(lambda p, t: unsigned(p - [0.1 * t, 0.0], t), steps=6)
    moving = replace(moving, grid=sdhj.Grid([0, 0], [4, 3], [33, 25]))
    table = sdhj.solve(moving, progress=False)
    counts = sdhj.monte_carlo(sdhj.Controller(table), RUNS, adversary="none", seed=0, progress=False).counts
    assert counts["collided"] == 0
    stored = sdhj.solve(moving, store=tmp_path / "t", progress=False)
    assert_bit_equal(stored, table)


@pytest.mark.parametrize("low, high", [(3.2, 6.1), (3.0, 6.0), (3.45, 3.55), (3.5, 3.5), (3.2, 3.55)])
def test_a_distance_ends_where_it_does(low, high):
    """Along a line what is made of it is the distance with a sign; of a set with one node the nearer end counts."""
    grid = sdhj.Grid([0.0], [10.0], [21])
    x = grid.points()[:, 0]
    true = np.maximum(low - x, x - high)
    found = closed(grid, np.maximum(true, 0.0))
    lone = (np.count_nonzero(true <= 0.0) == 1) & (true <= 0.0)
    assert found[~lone] == pytest.approx(true[~lone], abs=1e-12)
    assert (found[lone] <= true[lone] + 1e-12).all() and (found[lone] > -0.5).all()
    assert (found[true <= 0.0] < 0.0).all()


@pytest.mark.parametrize("axes", [1, 2, 3])
def test_no_node_of_a_set_is_lost_and_no_other_changed(axes, rng):
    """Random functions with many zeros; those with a sign at their boundary keep every value that is not 0."""
    grid = sdhj.Grid([0.0] * axes, [1.0] * axes, [9] * axes, [False, True, False][:axes])
    for least in (0.0, -1.0):
        values = np.maximum(rng.uniform(-1.0, 1.0, grid.shape), least)
        found = closed(grid, values)
        assert (found[values <= 0.0] < 0.0).all() and (found[values != 0.0] == values[values != 0.0]).all()
    assert closed(grid, np.zeros(grid.shape)).max() == -ON_BOUNDARY


def test_a_boundary_on_nodes_is_unsafe_and_moves_nobody_else():
    """A distance with a sign that is 0 at nodes: they are no longer safe, and everything else stays as it was."""
    grid = sdhj.Grid([-2.0], [2.0], [81])
    distance = np.abs(grid.points()[:, 0]) - 1.0
    found = closed(grid, np.where(np.abs(distance) < 1e-12, 0.0, distance))
    assert np.count_nonzero(found == -ON_BOUNDARY) == 2
    assert found == pytest.approx(distance, abs=1e-12)


def test_a_set_that_hides_is_told_though_its_function_is_0():
    """A post between the nodes, by a distance without a sign: that it is there is said, and the remedy finds it."""
    post = lambda p, t: np.maximum(np.hypot(p[:, 0] - 2.025, p[:, 1] - 1.525) - 0.02, 0.0)  # noqa: E731
    with pytest.warns(
        ResolutionWarning,
        match=r"hides between the nodes .* is 0, which gives no thickness, .* Use a distance that is negative",
    ):
        sdhj.solve(problem(post, steps=2), progress=False)
    known = lambda p, t: np.hypot(p[:, 0] - 2.025, p[:, 1] - 1.525) - 0.02  # noqa: E731
    sdhj.solve(problem(known, steps=2, sampling="cell"), progress=False)


def test_the_state_that_is_asked_for():
    """A disk not much larger than a cell: what is interpolated holds a part of it, and no state of it is contained."""
    disk = sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0], p[:, 1]) - 0.3)
    stay = sdhj.ReachAvoidProblem(
        grid=sdhj.Grid([-1.5, -1.5], [1.5, 1.5], [9, 9]),
        dynamics=sdhj.Dynamics([[0.0, 0.0]], [[0.0, 0.0]], np.eye(2), [0.01, 0.01]),
        target=None,
        unsafe=[disk],
        delta=0.1,
        steps=1,
    )
    table = sdhj.solve(stay, progress=False)
    angle, radius = np.random.default_rng(0).uniform(0.0, 1.0, (2, 2000))
    points = (0.3 * np.sqrt(radius) * [np.cos(2 * np.pi * angle), np.sin(2 * np.pi * angle)]).T
    assert (stay.grid.interpolate(table.values(start=0, within=1), points) <= 0).any()
    assert not table.contains(points, start=0, within=1).any()
