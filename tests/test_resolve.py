"""`sdhj.resolve`: bit for bit a whole solve, for less where little has changed."""

import pickle
import warnings
from dataclasses import replace

import numpy as np
import pytest
from digest_cases import CASES, FIVE, arm, disk, plane

import sdhj
from sdhj.problem.interval import Velocities
from sdhj.solver import avoid, recursion
from sdhj.solver.former import differing, within_boxes, within_stages
from sdhj.solver.schemes import Scheme, evolve

FAST = "arm, swept", "car", "torus", "plane, moving, lowered", "cart, safe ends"
ON_GRIDS = [
    pytest.param(name, marks=[] if name in FAST else pytest.mark.slow)
    for name in CASES
    if not any(word in name for word in ("store", "certified", "from a table"))
]


def assert_same(found, expected):
    """To the last bit, and zeros by their signs."""
    for name in ("index", "tubes", "marks"):
        assert getattr(found, name).tobytes() == getattr(expected, name).tobytes(), name
    assert found.avoid.static.tobytes() == expected.avoid.static.tobytes()
    assert found.avoid.moving.tobytes() == expected.avoid.moving.tobytes()
    assert (found.problem.steps, found.method) == (expected.problem.steps, expected.method)


def moved(part, by=0.07):
    """A set, a little along its last axis."""
    off = by * (np.arange(len(part.axes)) == len(part.axes) - 1)
    given = {"level_set": lambda p, t: part.level_set(p + off, t)}
    if getattr(part, "swept", None) is not None:
        given["swept"] = lambda p, t0, t1: part.swept(p + off, t0, t1)
    return replace(part, **given)


def changes(problem):
    """The problem with one thing or another changed, and back again."""
    sets = problem.unsafe
    if sets:
        yield replace(problem, unsafe=(moved(sets[0]), *sets[1:]))
        yield replace(problem, unsafe=(moved(sets[0]), *map(moved, sets[1:])))
    if len(sets) > 1 or (sets and problem.grid.has("fails")):
        yield replace(problem, unsafe=sets[1:])
        yield replace(problem, unsafe=sets[::-1])
    middle = (np.array(problem.grid.lower) + problem.grid.upper)[:1] / 2
    post = sdhj.UnsafeSet((0,), lambda p, t: np.abs(p[:, 0] - middle[0]) - 0.6 * problem.grid.spacing[0], name="new")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield replace(problem, unsafe=(*sets, post))
    if not problem.has_no_target:
        yield replace(problem, target=moved(problem.target, 0.03))
    if problem.steps:
        yield replace(problem, steps=problem.steps + 1)
        yield replace(problem, steps=problem.steps - 1)
    yield replace(problem, delta=1.02 * problem.delta)
    yield problem
    yield problem


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", ON_GRIDS)
def test_resolved_is_solved(name):
    case = CASES[name]
    problem = case.problem()
    table = sdhj.solve(problem, case.method, progress=False, play=False)
    for changed in changes(problem):
        table = sdhj.resolve(table, changed, case.method)
        assert_same(table, sdhj.solve(changed, case.method, progress=False, play=False))


@pytest.mark.filterwarnings("ignore")
def test_other_bounds_inputs_and_methods():
    def robot(wind=0.1, inputs=FIVE, **given):
        post = sdhj.UnsafeSet((0, 1), disk(1.9, 1.4, 0.4), name="post")
        return plane(post, dynamics=sdhj.Dynamics(inputs, inputs, np.eye(2), [wind, 0.08]), **given)

    table = sdhj.solve(robot(), progress=False, play=False)
    wide = sdhj.Grid([0, 0], [4, 3], [33, 25], ends="wall")
    tried = [
        (robot(0.2), "hji"),
        (robot(inputs=FIVE[::-1]), "hji"),
        (robot(grid=wide), "hji"),
        (robot(), "lax"),
        (robot(), sdhj.HopfLax("linear")),
        (robot(), sdhj.HJI(sdhj.Scheme(cfl=0.5))),
        (robot(target=None), "lax"),
        (robot(), "lax"),
    ]
    for problem, method in tried:
        table = sdhj.resolve(table, problem, method)
        assert_same(table, sdhj.solve(problem, method, progress=False, play=False))


def rows_written(monkeypatch):
    counted = []
    add_inputs = recursion.add_inputs
    monkeypatch.setattr(recursion, "add_inputs", lambda *given: (counted.append(len(given[-1])), add_inputs(*given)))
    return counted


def with_obstacle(x, y):
    from sdhj.arm.case_studies import OBSTACLES
    from sdhj.arm.workspace import Disk, Still

    return arm(nodes=(25, 24, 7, 7), obstacles=(Disk(Still((x, y)), 0.06), *OBSTACLES[1:]))()


@pytest.mark.filterwarnings("ignore")
def test_what_does_not_change_is_not_solved(monkeypatch):
    problem, changed = with_obstacle(-0.22, 0.1), with_obstacle(-0.22, 0.16)
    table = sdhj.resolve(sdhj.solve(problem, play=False, progress=False), problem)
    counted, played = rows_written(monkeypatch), []
    playing = avoid.dangers
    monkeypatch.setattr(avoid, "dangers", lambda *given: (played.append(given), playing(*given))[1])
    again = sdhj.resolve(table, problem)
    assert not counted and again.details["pdes_solved"] == 0
    assert np.shares_memory(again.avoid.static, table.avoid.static)
    found = sdhj.resolve(table, changed)
    few = sum(counted)
    counted.clear()
    whole = sdhj.solve(changed, play=False, progress=False)
    assert few < 0.7 * sum(counted)
    assert found.details["pdes_solved"] < whole.details["pdes_solved"]
    assert np.shares_memory(found.avoid.static, table.avoid.static)  # of the pursuer


@pytest.mark.filterwarnings("ignore")
def test_one_of_several_obstacles_is_solved_anew(monkeypatch):
    def seen(x):
        return plane(*(sdhj.UnsafeSet((0, 1), disk(at, 1.4, 0.3), name=f"at {at}") for at in (1.0, 1.9, x)))

    from sdhj.solver.games import HJIGames

    table, tubes, played = sdhj.solve(seen(2.5), play=False, progress=False), HJIGames.tubes, []
    monkeypatch.setattr(HJIGames, "tubes", lambda *given: (played.append(1), tubes(*given))[1])
    for at, fresh in ((2.6, 3), (2.7, 1), (2.7, 0), (2.5, 1)):  # the ends of the two axes are as they were, too
        played.clear()
        table = sdhj.resolve(table, seen(at))
        assert len(played) in (fresh, fresh + 2 * (at == 2.6))
        assert_same(table, sdhj.solve(seen(at), play=False, progress=False))


def test_a_black_box_may_have_changed():
    at = [1.9]
    box = sdhj.BlackBox(lambda p, t: disk(at[0], 1.4, 0.4)(p, t), rate=0.0)
    problem = plane(sdhj.UnsafeSet((0, 1), box, name="post"))
    table = sdhj.solve(problem, "lax", play=False, progress=False)
    at[0] = 1.5
    changed = replace(problem)
    found = sdhj.resolve(table, changed, "lax")
    assert_same(found, sdhj.solve(changed, "lax", play=False, progress=False))
    assert not np.array_equal(found.avoid.static, table.avoid.static)


def test_what_is_kept_stays_in_its_process(tmp_path):
    problem = plane(sdhj.UnsafeSet((0, 1), disk(1.9, 1.4, 0.4), name="post"))
    table = sdhj.resolve(sdhj.solve(problem, "lax", play=False, progress=False), problem, "lax")
    assert table.reusable is not None
    table.save(tmp_path / "table.npz")
    for other in (pickle.loads(pickle.dumps(table)), sdhj.load(tmp_path / "table.npz")):
        assert other.reusable is None
        assert_same(sdhj.resolve(other, problem, "lax"), table)


def test_resolve_refuses_what_is_no_table_or_problem():
    problem = plane(sdhj.UnsafeSet((0, 1), disk(1.9, 1.4, 0.4), name="post"))
    with pytest.raises(ValueError, match=r"table must be what sdhj.solve or sdhj.resolve returns, got 3"):
        sdhj.resolve(3, problem)
    with pytest.raises(ValueError, match="problem must be a ReachAvoidProblem, got 4"):
        sdhj.resolve(sdhj.solve(problem, "lax", play=False, progress=False), 4)


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("periodic", [True, False])
def test_what_is_in_few_planes_spreads_as_far_as_said(order, periodic):
    """A change of one plane: where the solution changes is found by solving twice."""
    grid = sdhj.Grid([-1.0] * 4, [1.0] * 4, [20, 21, 5, 6], [periodic] * 4, ends="wall")
    rng, scheme, place = np.random.default_rng(order), Scheme(order=order), (2, 18)
    values, speeds = rng.standard_normal(grid.shape).astype(np.float32), np.array([1.0, 2.0, 0.5, 0.1])
    other = values.copy()
    other[place] += rng.standard_normal(grid.shape[2:]).astype(np.float32)
    here = np.zeros(grid.shape[:2], bool)
    here[place] = True
    reads = order, 2 * 2  # of two time steps
    given = Velocities(-speeds, speeds), 0.05, scheme
    whole, beside = (evolve(grid, one, *given, steps=2) for one in (values, other))
    changed, said = differing(whole, beside), within_stages(grid, here, *reads)
    assert changed.sum() > 10
    assert not (changed & ~said).any() and not said.all()
    some = evolve(grid, other, *given, steps=2, planes=said)
    assert np.array_equal(some[said], beside[said])


def test_maxima_over_boxes_carry_as_far_as_said():
    from sdhj.problem.boxes import maximum_over_boxes

    grid = sdhj.Grid([-1.0] * 3, [1.0] * 3, [20, 5, 6], [True, False, False])
    rng, corner = np.random.default_rng(0), np.array([[2.3, 0.4, 0.0]]) * grid.spacing
    values = rng.standard_normal(grid.shape).astype(np.float32)
    for place in range(20):
        other = values.copy()
        other[place] = rng.standard_normal(grid.shape[1:])
        found = [next(maximum_over_boxes(grid, one, -corner, corner, "limited"))[1] for one in (values, other)]
        here = np.arange(20) == place
        assert not (differing(*found) & ~within_boxes(grid, here, np.array([2.3, 0.4, 0.0]))).any()


def test_a_target_whose_sign_is_turned_is_told():
    """As `solve` does; where only an obstacle moved nothing is said again."""

    def seen(sign, x=0.0):
        return sdhj.ReachAvoidProblem(
            grid=sdhj.Grid([-2, -2], [2, 2], [21, 21]),
            dynamics=sdhj.Dynamics([[0.0, 0.0], [1.0, 0.0]], [[0.0, 0.0], [1.0, 0.0]], np.eye(2), [0.1, 0.1]),
            target=sdhj.TargetSet((0, 1), lambda p, t: sign * (np.hypot(p[:, 0], p[:, 1]) - 0.8)),
            unsafe=[sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0] - x, p[:, 1] + 1.5) - 0.4)],
            delta=0.25,
            steps=2,
        )

    table = sdhj.solve(seen(1.0), progress=False, play=False)
    with pytest.warns(UserWarning, match="turn the sign"):
        turned = sdhj.resolve(table, seen(-1.0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sdhj.resolve(turned, seen(-1.0, 0.2))
