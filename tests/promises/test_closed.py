"""G is closed: g = 0 is inside; a function that is 0 in a whole region does not say where it ends, and is refused.

The plant of the runs here is that of the simulation, in the true geometry: a state with g <= 0 has collided.
"""

import shutil

import numpy as np
import pytest
import zoo
from zoo import plane, post, walk

import sdhj
from sdhj.common.findings import ResolutionWarning
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
    return walk(unsafe=[sdhj.UnsafeSet((0, 1), level_set, **options)], steps=steps)


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


FLAT = {
    "distance": unsigned,
    "occupancy": free,
    "beside a post": beside_a_post(unsigned),
    "square": lambda p, t: unsigned(p, t) ** 2,
    "a hair below": lambda p, t: np.maximum(signed(p, t), -1e-12),  # 0 inside
    "moving": lambda p, t: unsigned(p - [0.1 * t, 0.0], t),
}


@pytest.mark.parametrize(
    ("method", "name"), [*(("hji", name) for name in FLAT), *((name, "distance") for name in METHODS if name != "hji")]
)
def test_a_function_that_is_0_in_a_region_is_refused_with_what_helps(method, name):
    with pytest.raises(ValueError, match="'unsafe' is 0 in"):
        sdhj.solve(problem(FLAT[name]), METHODS[method], progress=False)


@pytest.mark.parametrize("level_set", [unsigned, free], ids=["distance", "occupancy"])
def test_by_cells_it_is_clear_whatever_it_is_inside(level_set):
    assert collisions(sdhj.solve(problem(level_set, sampling="cell"), progress=False)) == 0


@pytest.mark.parametrize("axes", [1, 2, 3])
def test_no_node_of_a_set_is_lost_and_no_other_changed(axes, rng):
    """Random functions with zeros at some nodes keep every value that is not 0."""
    grid = sdhj.Grid([0.0] * axes, [1.0] * axes, [9] * axes, [False, True, False][:axes])
    values = rng.uniform(-1.0, 1.0, grid.shape) * (rng.uniform(size=grid.shape) > 0.1)
    found = closed(grid, values, lambda points: np.ones(len(points)), "it")
    assert (found[values <= 0.0] < 0.0).all() and (found[values != 0.0] == values[values != 0.0]).all()
    assert found[values == 0.0].min() == -ON_BOUNDARY


def test_a_boundary_on_nodes_is_unsafe_and_moves_nobody_else():
    """A distance with a sign that is 0 at nodes: they are no longer safe, and everything else stays as it was."""
    grid = sdhj.Grid([-2.0], [2.0], [81])
    distance = np.abs(grid.points()[:, 0]) - 1.0
    level = lambda p: np.abs(p[:, 0]) - 1.0  # noqa: E731
    found = closed(grid, np.where(np.abs(distance) < 1e-12, 0.0, distance), level, "it")
    assert np.count_nonzero((found < 0) & (found > -1e-12)) == 2
    assert found == pytest.approx(distance, abs=1e-12)


def test_a_set_that_hides_is_told_though_its_function_is_0():
    """A post between the nodes, by a distance without a sign: that it is there is said, and the remedy finds it."""
    post = lambda p, t: np.maximum(np.hypot(p[:, 0] - 2.025, p[:, 1] - 1.525) - 0.02, 0.0)  # noqa: E731
    with pytest.warns(
        ResolutionWarning,
        match="between.*nodes",
    ):
        sdhj.solve(problem(post, steps=2), progress=False)
    known = lambda p, t: np.hypot(p[:, 0] - 2.025, p[:, 1] - 1.525) - 0.02  # noqa: E731
    sdhj.solve(problem(known, steps=2, sampling="cell"), progress=False)


def test_the_state_that_is_asked_for():
    """A disk not much larger than a cell: what is interpolated holds a part of it, and no state of it is contained."""
    stay = plane(
        [[0.0, 0.0]],
        0.01,
        grid=sdhj.Grid([-1.5, -1.5], [1.5, 1.5], [9, 9]),
        target=None,
        unsafe=[post(0.0, 0.0, 0.3)],
        delta=0.1,
        steps=1,
    )
    table = sdhj.solve(stay, progress=False)
    angle, radius = np.random.default_rng(0).uniform(0.0, 1.0, (2, 2000))
    points = (0.3 * np.sqrt(radius) * [np.cos(2 * np.pi * angle), np.sin(2 * np.pi * angle)]).T
    assert (stay.grid.interpolate(table.values(start=0, within=1), points) <= 0).any()
    assert not table.contains(points, start=0, within=1).any()


def test_on_a_border_the_target_counts_and_what_is_unsafe_does_not(tmp_path):
    """Both are closed, to the bit, in Python and in C."""
    posts = [zoo.post(0.75, 0.25), sdhj.UnsafeSet((0,), lambda p, t: np.abs(p[:, 0] + 0.75) - 0.125)]
    problem = zoo.line(target=zoo.goal(0.0, 1.0), unsafe=posts)
    table = sdhj.solve(problem, sdhj.Certified(cells=(80,)), progress=False, play=False)
    here = [-1.0, np.nextafter(-0.875, -1.0), -0.5, np.nextafter(0.5, 0.0)]
    states = np.array([*here, np.nextafter(-1.0, -2.0), -0.875, -0.625, 0.5, 1.0])[:, None]
    told = [problem.arrived(states, 0), table.arrived(states, 0), np.flatnonzero(table.steps_to_go(states, 0) == 0)]
    told.append(np.flatnonzero(table.contains(states, start=0, within=0)))
    if shutil.which("cc"):
        status, steps = sdhj.export_c(table, tmp_path, progress=False).steps_to_go(states, 0)
        told.append(np.flatnonzero((status == 0) & (steps == 0)))
    assert [one.tolist() for one in told] == [list(range(4))] * len(told)
