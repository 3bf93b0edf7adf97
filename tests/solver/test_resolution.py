"""What a grid does not see of an unsafe set it says, and a sampling by cells sees everything."""

import warnings
from dataclasses import replace

import judge
import numpy as np
import pytest
import zoo

import sdhj
from sdhj import Controller, Grid, TargetSet, UnsafeSet
from sdhj.common.findings import ResolutionWarning
from sdhj.problem.nodes import least_in_cells, least_of_cells
from sdhj.problem.samples import Samples
from sdhj.solver.findings import check_resolution, check_sets
from sdhj.solver.joint import Joint

MOVES = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0], [0.0, 0.0]])


def looked_over(problem):
    check_resolution(Samples(problem))


def plan(p, half):
    """A thick block merged with a wall around x = 4.1 into one set, as in a map; the way round is above."""
    wall = np.maximum(np.abs(p[:, 0] - 4.1) - half, p[:, 1] - 6.5)
    return np.minimum(wall, np.maximum(np.abs(p[:, 0] - 2.0) - 0.5, np.abs(p[:, 1] - 2.0) - 0.5))


def room(nodes=41, half=0.05, sampling="nodes"):
    part = UnsafeSet((0, 1), lambda p, t: plan(p, half), name="plan", sampling=sampling)
    grid = Grid([0.0, 0.0], [8.0, 8.0], [nodes, nodes])
    return zoo.plane(MOVES, grid=grid, target=zoo.goal(6.0, 4.0, 0.6), unsafe=(part,), steps=20)


def lost(table, rng, half=0.05):
    controller, starts = Controller(table), rng.uniform(0.0, 8.0, (8000, 2))
    starts = starts[table.contains(starts, start=0, within=20)][:2000]
    outcomes = judge.play(
        lambda states, step: controller.choose(controller.batch(states, step)),
        lambda states, inputs, signs, t: MOVES[inputs] + 0.1 * signs,
        lambda states, inputs, t, end: rng.choice([-1.0, 1.0], states.shape),
        lambda states, t: np.hypot(states[:, 0] - 6.0, states[:, 1] - 4.0) - 0.6,
        lambda states, t: np.minimum(plan(states, half), np.minimum(states, 8.0 - states).min(axis=1) + 1e-9),
        starts,
        delta=0.3,
        steps=20,
    )
    return (outcomes != "reached").mean()


@pytest.mark.slow
def test_a_wall_between_the_nodes_is_told_and_where_and_how_many_nodes_it_takes(rng):
    with pytest.warns(ResolutionWarning, match="'plan'.*between") as told:
        blind = sdhj.solve(room())
    assert "about 0.1 thick" in str(told[0].message) and "81 nodes along x1" in str(told[0].message).replace("82", "81")
    assert lost(blind, rng) > 0.1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert lost(sdhj.solve(room(nodes=101)), rng) < 0.01
        cautious = sdhj.solve(room(sampling="cell"))
    assert lost(cautious, rng) < 0.005 and cautious.fraction(start=0, within=20) > 0.2


@pytest.mark.parametrize("half", [0.005, 0.02, 0.09])
def test_walls_of_any_thickness_are_found(half):
    with pytest.warns(ResolutionWarning, match="between"):
        looked_over(room(half=half))


def test_what_the_grid_sees_is_not_told():
    """Round sets, oblique walls and corners, whose boundaries pass between nodes everywhere; the case study."""
    shapes = {
        "disk": lambda p, t: np.hypot(p[:, 0] - 3.03, p[:, 1] - 2.99) - 0.31,
        "oblique": lambda p, t: np.abs(0.6 * p[:, 0] + 0.8 * p[:, 1] - 5.0) - 0.25,
        "corner": lambda p, t: np.abs(p - 4.0).sum(axis=1) - 1.0,
    }
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for name, shape in shapes.items():
            looked_over(replace(room(), unsafe=(UnsafeSet((0, 1), shape, name=name),)))
        looked_over(sdhj.arm_case_study())


def test_a_wall_across_the_seam_of_a_periodic_axis_and_one_that_comes_later_are_found():
    grid = Grid([0.0, 0.0], [8.0, 8.0], [40, 41], [True, False])
    seam = UnsafeSet((0, 1), lambda p, t: 0.02 - np.abs(np.abs(p[:, 0] - 4.0) - 3.9), name="not a wall")
    seam = replace(seam, level_set=lambda p, t: np.abs((p[:, 0] - 7.9 + 4.0) % 8.0 - 4.0) - 0.02, name="seam")
    later = UnsafeSet((1,), lambda p, t: np.abs(p[:, 0] - 9.1 + 0.5 * t) - 0.02, name="later")
    problem = replace(room(), grid=grid)
    for part in (seam, later):
        with pytest.warns(ResolutionWarning, match=part.name):
            looked_over(replace(problem, unsafe=(part,)))


def test_by_bounds_the_least_in_the_cells_is_that_of_the_closed_form(rng):
    """Also across the seam of a periodic axis, of a function that is periodic."""
    grid, centre = Grid([0.0, 0.0], [2.0, 3.0], [12, 9], [True, False]), np.array([0.1, 1.21])
    away = UnsafeSet((0, 1), lambda p, t: np.hypot(np.sin(np.pi / 2 * (p[:, 0] - 0.1)), p[:, 1] - 1.21) - 0.2)
    least = least_of_cells(grid, lambda low, high: away.least(low, high, 0.0, None, "swept"))
    around = grid.points()[:, None] + np.array(grid.spacing) * rng.uniform(-1, 1, (500, 2))
    around[..., 1] = np.clip(around[..., 1], 0.0, 3.0)
    values = away.level_set(grid.wrapped(around.reshape(-1, 2)), 0.0).reshape(*grid.shape, 500).min(axis=-1)
    assert (least <= values).all() and (values - least).max() <= 0.5 * max(grid.spacing) and centre.size == 2


def test_the_least_in_the_cells_is_that_of_the_closed_form_or_a_little_less(rng):
    """The distance to a point, in the box of all cells around a node; its slope is at most 1 along each axis."""
    grid, centre = Grid([0.0, 0.0], [2.0, 3.0], [12, 9]), np.array([0.83, 1.21])
    least = least_in_cells(grid, lambda p: np.hypot(*(p - centre).T))
    low, high = (np.clip(grid.points() + side * np.array(grid.spacing), 0.0, grid.upper) for side in (-1, 1))
    exact = np.hypot(*(np.clip(centre, low, high) - centre).T).reshape(grid.shape)
    assert (least <= exact).all() and (exact - least).max() <= sum(grid.spacing) / 4


def test_the_least_in_the_cells_is_below_the_function_in_all_of_them(rng):
    """Of random waves, across the seam of a periodic axis too."""
    grid = Grid([0.0, 0.0], [2 * np.pi, 3.0], [12, 9], [True, False])
    waves = rng.normal(size=(6, 2))

    def function(p):  # periodic along the first axis
        return sum(np.sin(np.round(3 * a) * p[:, 0] + b * p[:, 1]) for a, b in waves)

    least, spacing = least_in_cells(grid, function), np.array(grid.spacing)
    around = grid.points()[:, None] + spacing * rng.uniform(-1, 1, (500, 2))
    around[..., 1] = np.clip(around[..., 1], 0.0, 3.0)
    values = function(grid.wrapped(around.reshape(-1, 2))).reshape(*grid.shape, 500)
    assert (values >= least[..., None]).all()


@pytest.mark.parametrize("periodic", [True, False])
@pytest.mark.parametrize("nodes", [64, 256, 1024])
def test_a_cell_is_bounded_by_what_the_function_does_there(nodes, periodic):
    """An interval of an angle, written without regard to where the angle begins anew, which is far away."""
    grid, far = Grid([-np.pi], [np.pi], [nodes], [periodic]), 0.8
    for centre in (0.0, 1.0, 2.0):
        least = least_in_cells(grid, lambda p, centre=centre: np.abs(p[:, 0] - centre) - 0.3)
        distance = np.maximum(np.abs(grid.nodes(0) - centre) - 0.3, 0.0)
        # unsafe: the set, a cell on each side, and half a part (an eighth of a cell) for the change nearby
        assert (least[distance == 0] < 0).all() and (least[distance > 1.2 * grid.spacing[0]] > 0).all()
        away = distance > far
        if periodic:  # the first node touches a cell on each side of the seam
            distance[0] = min(distance[0], np.pi - centre - 0.3)
        assert (least[away] >= (distance - 1.2 * grid.spacing[0])[away]).all()


def test_a_function_that_is_0_in_its_set_is_negative_there_by_cells_too():
    """As G is closed: deep inside, where nothing changes nearby, and in a set of one point."""
    grid = Grid([-1.0, -1.0], [1.0, 1.0], [41, 41])
    least = least_in_cells(grid, lambda p: np.maximum(np.hypot(p[:, 0], p[:, 1]) - 0.5, 0.0))
    inside = np.hypot(*grid.points().T).reshape(grid.shape) <= 0.5
    assert (least[inside] < 0).all() and np.float32(least[20, 20]) < 0


def test_a_steep_sampling_is_ten_times_as_deep_inside_and_else_the_same(rng):
    plain, steep = room(half=0.3), room(half=0.3, sampling="steep")
    values, deeper = (Samples(problem).sample(problem.unsafe[0], 0.0) for problem in (plain, steep))
    assert (values < 0).any() and np.array_equal(deeper, np.where(values < 0, 10 * values, values))
    solved, cautious, states = sdhj.solve(plain), sdhj.solve(steep), rng.uniform(0.0, 8.0, (20_000, 2))
    assert cautious.fraction(start=0, within=20) < solved.fraction(start=0, within=20)
    assert not (cautious.contains(states, start=0, within=20) & ~solved.contains(states, start=0, within=20)).any()


def test_an_unknown_sampling_is_refused():
    with pytest.raises(ValueError, match="the unsafe set 'unsafe'"):
        UnsafeSet((0,), lambda p, t: p[:, 0], sampling="dense")


TURNS = np.array([[v, w] for v in (-1.0, 1.0) for w in (-1.0, 0.0, 1.0)])


def turning(q, u):
    """Velocities of a unicycle at states (M, 3) under inputs (M, 2)."""
    return np.stack([u[:, 0] * np.cos(q[:, 2]), u[:, 0] * np.sin(q[:, 2]), u[:, 1]], axis=1)


def hall(level):
    """A car on 6 m x 6 m, nodes 0.2 m apart; behind x = 3 is the target."""
    box = {"lower": [0.0, 0.0, -np.pi], "upper": [6.0, 6.0, np.pi], "nodes": [31, 31, 24]}
    sets = {"target": zoo.goal(4.6, 3.0, 0.6), "unsafe": [UnsafeSet((0, 1), lambda p, t: level(p), name="it")]}
    return zoo.car(TURNS, gain=np.zeros((3, 1)), bounds=[0.0], **box, **sets, delta=0.3, steps=20)


def wall(x, half):
    return lambda p: np.maximum(np.abs(p[:, 0] - x) - half, p[:, 1] - 5.0)


@pytest.mark.slow
def test_a_thin_wall_loses_what_a_thick_one_does_not(rng):
    """Judged on the true unicycle: why the line is drawn at three quarters of a cell."""
    lost = {}
    for name, level in {"thin": wall(3.0, 0.11), "deep": wall(3.0, 0.19), "cell": wall(3.0, 0.11)}.items():
        problem = hall(level)
        if name == "cell":
            problem = replace(problem, unsafe=(replace(problem.unsafe[0], sampling="cell"),))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            controller = Controller(sdhj.solve(problem, progress=False))
        states = rng.uniform(problem.grid.lower, problem.grid.upper, (20_000, 3))
        starts = states[controller.table.contains(states, start=0, within=20) & (states[:, 0] < 2.7)][:2000]
        outcomes = judge.play(
            lambda q, step, controller=controller: controller.choose(controller.batch(q, step)),
            lambda q, u, v, t: turning(q, TURNS[u]),
            lambda q, u, t, end: np.zeros((len(q), 1)),
            lambda q, t: np.hypot(q[:, 0] - 4.6, q[:, 1] - 3.0) - 0.6,
            lambda q, t, level=level: np.minimum(level(q), np.minimum(q, 6.0 - q)[:, :2].min(axis=1) + 1e-9),
            starts,
            delta=0.3,
            steps=20,
        )
        lost[name] = np.mean(outcomes == "collided")
    assert lost["thin"] > 0.02 and lost["deep"] < 0.01 and lost["cell"] < 0.01, lost  # of 2,000: five errors apart


def test_problems_that_share_a_set_have_samples_of_their_own():
    """A grid that differs has its own; a black box may say something else for every problem."""
    wall, coarse = room().unsafe[0], room(nodes=17)
    other = Samples(replace(coarse, unsafe=(wall,))).sample(wall, 0.0)
    assert other.shape == (17, 17)
    np.testing.assert_array_equal(other, Samples(coarse).sample(coarse.unsafe[0], 0.0))
    half = [0.05]
    changing = UnsafeSet((0, 1), sdhj.BlackBox(lambda p, t: plan(p, half[0]), slope=1.0, rate=0.0), name="plan")
    thin = Samples(replace(room(), unsafe=(changing,))).sample(changing, 0.0)
    half[0] = 0.5
    assert (Samples(replace(room(), unsafe=(changing,))).sample(changing, 0.0) <= 0).sum() > (thin <= 0).sum()


@pytest.mark.parametrize("low", [0.0, -np.pi])
def test_a_set_that_ends_where_a_periodic_axis_begins_anew_is_told(low):
    def ring(level_set, axes=(0, 1)):
        grid = Grid([low, -1.0], [low + 2 * np.pi, 1.0], [60, 21], [True, False], names=["angle", "height"])
        return zoo.plane(
            [[-1.0, 0.0], [1.0, 0.0]],
            **zoo.ALONE,
            grid=grid,
            target=None,
            unsafe=[UnsafeSet(axes, level_set)],
            delta=0.1,
        )

    at = low + 2 * np.pi - 0.1
    with pytest.warns(ResolutionWarning, match="periodic axis angle ends"):
        looked_over(ring(lambda p, t: np.hypot(p[:, 0] - at, p[:, 1]) - 0.4))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        looked_over(ring(lambda p, t: np.cos(0.4) - np.cos(p[:, 0] - at), axes=(0,)))
        looked_over(ring(lambda p, t: np.maximum(-np.sin(p[:, 0] - low), np.abs(p[:, 1]) - 0.4)))  # ends just there


RING = Grid([-np.pi, -1.0], [np.pi, 1.0], [64, 41], [True, False], names=["angle", "height"])
FREE = lambda q, u: np.stack([np.full(len(q), u[0]), np.full(len(q), u[1])], axis=1)  # noqa: E731
BACKWARDS = lambda p, t: np.cos(0.3) + np.cos(p[:, 0])  # noqa: E731
CLOSE = lambda p, t: np.hypot(2 * np.sin(p[:, 0] / 2), p[:, 1]) - 0.3  # noqa: E731


def on_the_ring(drift=FREE, target=CLOSE, axes=(0,), level=BACKWARDS, sampling="nodes"):
    speeds = [[-1.0, 0.0], [1.0, 0.0], [0.0, 0.5], [0.0, -0.5], [0.0, 0.0]]
    goal = None if target is None else TargetSet((0, 1), target)
    unsafe = [UnsafeSet(axes, level, name="o", sampling=sampling)]
    return zoo.plane(
        speeds,
        drift=drift,
        gain=[[1.0], [0.0]],
        bounds=[0.1],
        grid=RING,
        target=goal,
        unsafe=unsafe,
        delta=0.2,
        steps=4,
    )


CUT = lambda p, t: np.abs(p[:, 0] - np.pi) - 0.3  # noqa: E731
MISTAKES = {
    "an unsafe set cut off": ({"level": CUT}, "unsafe set 'o' is cut off.*angle"),
    "a target cut off": (
        {
            "target": lambda p, t: np.maximum(CUT(p, t), np.abs(p[:, 1]) - 0.3),
            "axes": (1,),
            "level": lambda p, t: p[:, 0] + 0.8,
        },
        "target 'target' is cut off.*angle",
    ),
    "a velocity that jumps": (
        {"drift": lambda q, u: np.stack([u[0] - 0.3 * q[:, 0], np.full(len(q), u[1])], axis=1)},
        "along angle jumps.*np.sin",
    ),
    "nowhere": (
        {"axes": (1,), "level": lambda p, t: np.abs(p[:, 0] - 9.0) - 0.3},
        "'o'.*(nowhere on the grid|ignore)",
    ),
    "a thin fence": (
        {"axes": (1,), "level": lambda p, t: np.abs(p[:, 0] - 0.513) - 0.004},
        "'o'.*height .*0.513",
    ),
}
METHODS = {"hji": "hji", "joint": Joint(), "lax": "lax", "projected": "projected"}
METHODS |= {"certified": sdhj.Certified(cells=[32, 20]), "store": "hji"}


@pytest.mark.parametrize(
    ("mistake", "method"),
    [
        *[(mistake, method) for mistake in MISTAKES for method in ("hji", "certified")],
        *[("an unsafe set cut off", method) for method in ("joint", "lax", "projected", "store")],
        ("a velocity that jumps", "joint"),
    ],
)
def test_every_method_says_what_is_wrong_with_a_problem(mistake, method, tmp_path):
    changes, said = MISTAKES[mistake]
    store = {"store": tmp_path / "table"} if method == "store" else {"play": False}
    with pytest.warns(UserWarning, match=said) as told:
        sdhj.solve(on_the_ring(**changes), METHODS[method], progress=False, **store)
    assert told[0].filename == __file__  # the line that called solve


def test_between_many_nodes_a_set_is_sought_if_none_is_in_it(monkeypatch):
    monkeypatch.setattr(sdhj.solver.findings, "MOST_NODES", 1)
    for mistake in ("nowhere", "a thin fence"):
        changes, said = MISTAKES[mistake]
        with pytest.warns(ResolutionWarning, match=said):
            check_sets(on_the_ring(**changes))
    seen = {"axes": (1,), "level": lambda p, t: np.minimum(np.abs(p[:, 0] - 0.513) - 0.004, p[:, 0] + 0.8)}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_sets(on_the_ring(**seen))


@pytest.mark.slow
@pytest.mark.parametrize("method", ["hji", "certified"])
def test_and_says_it_of_cells_of_velocities_and_of_sets_that_move(method):
    jumps = lambda q, u: np.stack([np.full(len(q), u[0]), u[1] + 0.1 * q[:, 0]], axis=1)  # noqa: E731
    told = {
        "'o' is cut off": {"level": CUT, "sampling": "cell"},
        "velocity along height jumps": {"drift": jumps, "target": None},
        "'o' is cut off.*": {"level": lambda p, t: np.abs(p[:, 0] - 1.9 - 2 * t) - 0.3},  # later
    }
    for said, changes in told.items():
        with pytest.warns(UserWarning, match=said):
            sdhj.solve(on_the_ring(**changes), METHODS[method], play=False, progress=False)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["hji", "certified"])
def test_what_is_periodic_or_comes_by_is_not_told(method):
    around = lambda q, u: np.stack([u[0] - 0.3 * np.sin(q[:, 0]), np.full(len(q), u[1])], axis=1)  # noqa: E731
    late = lambda p, t: np.abs(p[:, 0] + 2.2 - 2.0 * t) - 0.3  # noqa: E731  # on the grid from .45 s on
    for changes in ({}, {"drift": around}, {"sampling": "cell"}, {"axes": (1,), "level": late}):
        with warnings.catch_warnings(action="error"):
            sdhj.solve(on_the_ring(**changes), METHODS[method], play=False, progress=False)
