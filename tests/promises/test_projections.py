"""The projected method: projections of sets and dynamics, union of directions, under-approximation, diagnosis."""

import itertools
from dataclasses import replace

import naive_projections as naive
import numpy as np
import pytest
import zoo
from zoo import ends_of

import sdhj
from sdhj import HJI, Dynamics, Grid, HopfLax, Projected, Scheme, TargetSet, UnsafeSet
from sdhj.common.findings import ProjectionWarning
from sdhj.problem.samples import Samples
from sdhj.solver.games import HJIGames, Pieces
from sdhj.solver.projections import ProjectedGames, checked_subspaces, default_subspaces
from sdhj.solver.recursion import InputRows
from sdhj.table.table import AvoidTubes

MONOTONE = HopfLax("linear")  # leaves the order of sets alone
ROUNDING = 1e-5  # sums of a few products of numbers below ten, in another order and single precision
pytestmark = pytest.mark.filterwarnings("ignore::sdhj.ProjectionWarning")  # each test says what it expects


def current_problem(*, speed=0.5, rate=0.0, **changed):
    """A boat (x, y) in a current of unknown heading w: dx = u + speed cos w, dy = speed sin w, dw = v."""

    def drift(points, u):
        w = points[:, 2]
        return np.stack([u[0] + speed * np.cos(w), speed * np.sin(w), np.zeros(len(points))], axis=1)

    rock = UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0] + rate * t, p[:, 1] - 1.0) - 0.3, name="rock")
    usual = {"nodes": (31, 31, 16), "drift": drift, "gain": [[0.0], [0.0], [1.0]], "bounds": [1.0], "delta": 0.2}
    usual |= {"target": zoo.goal(0.0, 0.0, 0.8), "unsafe": (rock,), "names": ["x", "y", "w"], "steps": 3}
    return zoo.car([[-1.0], [0.0], [1.0]], **usual | changed)


def wind_problem(*, nodes=41):
    """dx = u + v + 0.5 w: the dropped coordinate w in [-1, 1] moves one axis only."""

    def drift(points, u):
        return np.stack([u[0] + 0.5 * points[:, 1], np.zeros(len(points))], axis=1)

    return zoo.plane(
        grid=Grid([-3.0, -1.0], [3.0, 1.0], [nodes, 9], names=["x", "w"]),
        dynamics=Dynamics([[-1.0], [0.0], [1.0]], drift, np.eye(2), [0.2, 0.3]),
        target=zoo.goal(0.0, 1.0),
        delta=0.4,
        steps=2,
    )


def damped_problem():
    """dx = u - x / 2 + v, dy = v."""

    def drift(points, u):
        return np.stack([u[0] - points[:, 0] / 2, np.zeros(len(points))], axis=1)

    return zoo.plane([[-1.0], [0.0], [1.0]], (0.1, 0.5), drift=drift, nodes=(7, 5), target=zoo.goal(0.0, 0.5))


def solve_quietly(problem, method="hji"):
    return sdhj.solve(problem, method, progress=False)


def projected_games(problem, subspaces=None, inner=None):
    inner = inner or HJI()
    return ProjectedGames(
        Samples(problem), lambda axes: inner.on(Samples(problem), axes), checked_subspaces(problem, subspaces)
    )


def entries(steps):
    return [(k, n) for k in range(steps + 1) for n in range(steps - k + 1)]


# ---- which subspaces


def test_the_case_studies_drop_the_agents_coordinates():
    for build in (sdhj.arm_case_study, sdhj.evader_case_study):
        assert default_subspaces(build(nodes=7, steps=1)) == ((0, 1, 2), (0, 1, 3))


def test_where_inputs_drive_every_axis_each_is_dropped():
    problem = zoo.plane([[0.0, 0.0], [1.0, 1.0]], target=TargetSet((0,), lambda p, t: p[:, 0]))
    assert default_subspaces(problem) == ((0,), (1,))


def test_an_axis_that_inputs_drive_at_some_time_stays():
    """At t = 0 no input drives anything, later x alone."""
    problem = zoo.plane(
        dynamics=Dynamics([[0.0], [1.0]], lambda q, u, t: [u[0] * t, 1.0], np.eye(2), [0.1, 0.1]),
        target=TargetSet((0,), lambda p, t: p[:, 0]),
    )
    assert default_subspaces(problem) == ((0,),)


@pytest.mark.parametrize(
    ("subspaces", "said"),
    [
        ([], "one or more"),
        ([()], "distinct axes"),
        ([(0, 3)], "0 to 2"),
        ([(0, 1), (1, 0)], "different"),
        ([0, 1], r"got \[0, 1\]"),
        (["01"], "sequence of sequences of"),
        ([[True]], "sequence of sequences of"),
    ],
)
def test_subspaces_that_do_not_fit_are_refused(subspaces, said):
    with pytest.raises(ValueError, match=said):
        solve_quietly(zoo.chase(nodes=5), Projected(subspaces))


def test_a_grid_of_one_axis_has_none_to_drop():
    with pytest.raises(ValueError, match="at least 2 axes"):
        sdhj.solve(zoo.line(), "projected")


# ---- projections of sets, and the kernels


@pytest.mark.parametrize("axes", [(0,), (2,), (0, 1), (0, 2), (1, 2), (0, 1, 2)])
def test_projections_are_those_of_the_twin(axes, rng):
    problem = zoo.chase(nodes=5)
    games = projected_games(problem, [axes])
    values = rng.normal(size=problem.grid.shape).astype(np.float32)
    np.testing.assert_array_equal(games.inner_projection(values, axes), naive.inner_projection(values, axes))
    g = problem.unsafe[0].level_set(problem.grid.points(), 0.0).reshape(problem.grid.shape)
    walls = games.outer_projections(problem.unsafe[0], (0, 1, 2), -g)[axes]
    np.testing.assert_array_equal(-walls, naive.outer_projection(g, axes))


@pytest.mark.parametrize(
    ("static", "moving"),
    [
        ((0, 1), (0, 1, 2, 3)),  # the case study's
        ((0, 1, 2, 3), (0, 1)),
        ((0, 2), (1, 2)),
        ((3,), ()),
        ((), (1,)),
        ((), ()),
    ],
)
def test_rows_say_of_every_node_what_the_avoid_tubes_say(static, moving, rng):
    """Whatever axes the unsafe sets depend on: the tube and its marks are the twin's, node by node."""
    grid, count, steps = Grid([0.0] * 4, [1.0] * 4, [5, 6, 7, 8]), 10, 2

    def random(*shape):
        return rng.normal(size=shape).astype(np.float32)

    def walls(axes, *leading):
        shape = [grid.shape[axis] for axis in axes]
        return random(*leading, *shape) if axes else np.full(leading, -np.inf, np.float32)

    tubes = AvoidTubes(static, walls(static, count), moving, walls(moving, steps, count))
    rows, tube, mask = InputRows(grid, tubes), random(*grid.shape), np.zeros((2, grid.size), np.uint8)
    added, everything = tube.copy(), (0, 1, 2, 3)
    expected, reach = tube.astype(float), random(count, *grid.shape)
    member = np.zeros((count, *grid.shape), bool)
    for j in range(count):
        both = naive.intersection(grid.shape, reach[j], [(static, tubes.static[j]), (moving, tubes.moving[1, j])])
        member[j], expected = both <= 0, np.minimum(expected, both)
    for begin, end in ((0, 3), (3, count)):  # of one byte, and of two
        rows.add(added, mask, Pieces(begin, grid, [reach[begin:end]], [everything]), 1, added)
    np.testing.assert_array_equal(added, expected)  # min and max round nothing
    found = np.unpackbits(mask, axis=0, count=count, bitorder="little").reshape(count, *grid.shape)
    np.testing.assert_array_equal(found.astype(bool), member)


@pytest.mark.slow
@pytest.mark.parametrize("subspaces", [None, [(0, 1)], [(0, 1), (0, 2), (1, 2)]])
@pytest.mark.parametrize("moving", [False, True])
def test_the_recursion_is_the_plain_one_over_reach_and_avoid(subspaces, moving):
    problem = zoo.chase(nodes=9, rate=0.4 * moving)
    table = solve_quietly(problem, Projected(subspaces))
    games = projected_games(problem, subspaces, HJI())
    avoid = table.avoid
    for k in range(problem.steps - 1, -1, -1):
        tube = Samples(problem).goal(k).astype(np.float32)
        for n in range(1, problem.steps - k + 1):
            marks = []
            for j, reach in games.reach(table.values(start=k + 1, within=n - 1), k):
                walls = [(avoid.static_axes, avoid.static[j]), (avoid.moving_axes, avoid.moving[k, j])]
                both = naive.intersection(problem.grid.shape, reach, walls)
                marks.append(both <= 0)
                tube = np.minimum(tube, both)
            np.testing.assert_array_equal(table.values(start=k, within=n), tube)
            np.testing.assert_array_equal(table.inputs(start=k, within=n), np.stack(marks, axis=-1))


# ---- under-approximation, and which way round the directions combine


@pytest.mark.parametrize(
    "view_time", ["swept", "sampled", "instantaneous", pytest.param("tide", marks=pytest.mark.slow)]
)
def test_with_a_monotone_operator_the_sets_are_inside_the_full_ones_to_rounding(view_time):
    """Hopf-Lax with linear interpolation is monotone and leaves an axis without variation alone: no scheme error.

    So it is in a tide along x, with gusts that grow along y and z.
    """
    problem = zoo.chase(rate=0.4, view_time="instantaneous" if view_time == "tide" else view_time)
    if view_time == "tide":
        dynamics = Dynamics(
            problem.inputs,
            drift=lambda q, u, t: [u[0] + np.sin(6 * t), 0.2 * t, 0.0],
            gain=np.eye(3),
            bounds=lambda q, u, t: [0.1 + 0.05 * abs(u[0]), 0.2 + 0.3 * t, 0.3],
        )
        problem = replace(problem, dynamics=dynamics)
    full = solve_quietly(problem, MONOTONE)
    inner = solve_quietly(problem, Projected(inner=MONOTONE))
    for k, n in entries(problem.steps):
        assert (inner.values(start=k, within=n) >= full.values(start=k, within=n) - ROUNDING).all(), (k, n)
    assert 0.5 < inner.fraction(start=0, within=3) / full.fraction(start=0, within=3) < 1.0
    assert inner.fraction(start=0, within=3) > 1.2 * inner.fraction(start=0, within=0)


def test_limited_interpolation_is_inside_but_for_its_error():
    """It is not monotone; out of order by what it may differ from the line, t (1 - t) / 2 of a second difference.

    At a kink of slope 1 to -1 that is at most an eighth of two cells' rise, twice as full and projected may err apart.
    """
    problem = zoo.chase(rate=0.4)
    full = solve_quietly(problem, HopfLax())
    inner = solve_quietly(problem, Projected(inner=HopfLax()))
    for k, n in entries(problem.steps):
        a, b = full.values(start=k, within=n), inner.values(start=k, within=n)
        assert a[b <= 0].max() < 0.5 * problem.grid.spacing[0], (k, n)
        assert problem.grid.fraction((b <= 0) & (a > 0)) < 0.01
        assert inner.fraction(start=k, within=n) <= full.fraction(start=k, within=n)


def test_directions_combine_by_union_and_the_printed_intersection_is_smaller():
    """App. A.5: each direction is inside the full solution; so is their union, and it is strictly larger than either.

    The intersection as printed is inside as well, and smaller than either: valid, but looser. And the union of what the
    directions call unsafe would be that smaller set's complement, the intersection is the union's.
    """
    problem = zoo.chase()
    full = solve_quietly(problem, MONOTONE)
    both = solve_quietly(problem, Projected(inner=MONOTONE))
    one, other = (solve_quietly(problem, Projected([axes], MONOTONE)) for axes in default_subspaces(problem))
    fractions = [table.fraction(start=0, within=3) for table in (one, other, both, full)]
    assert max(fractions[:2]) < fractions[2] < fractions[3]
    for k, n in entries(problem.steps):
        a, b, union, whole = (table.values(start=k, within=n) for table in (one, other, both, full))
        assert (union <= np.minimum(a, b) + ROUNDING).all()  # monotone in the sets it starts from: at least their union
        assert (union >= whole - ROUNDING).all()
    # one interval alone, where nothing but the combination differs
    games = projected_games(problem, inner=MONOTONE)
    goal = full.values(start=1, within=1)
    (united,) = games.grouped_reach_sets(goal, 0)
    pieces = [
        [problem.grid.lift(piece[j], axes) for axes, piece in zip(united.axes, united.pieces, strict=True)]
        for j in range(3)
    ]
    exact = dict(full_games(problem).reach(goal, 0))
    for j, (a, b) in enumerate(pieces):
        union, intersection = np.minimum(a, b), np.maximum(a, b)
        assert (union >= exact[j] - ROUNDING).all() and (intersection >= union).all()
    unions = [(np.minimum(a, b) <= 0).sum() for a, b in pieces]
    intersections = [(np.maximum(a, b) <= 0).sum() for a, b in pieces]
    assert all(u >= i for u, i in zip(unions, intersections, strict=True)) and sum(unions) > 1.2 * sum(intersections)


def full_games(problem):
    return projected_games(problem, [tuple(range(problem.grid.ndim))], MONOTONE)


@pytest.mark.slow
def test_finite_differences_are_inside_but_for_scheme_error():
    """The full and the projected PDE take different time steps; what that leaves is a small part of a cell.

    Both solve monotone games of which one majorises the other, so values may be out of order by no more than the
    two scheme errors: a tenth of a cell each is what their comparison with closed forms allows (tests of the games,
    0.1 of a spacing on average). The worst states outside the full set are within that in value, and few.
    """
    for nodes in (9, 13, 17):
        problem = sdhj.arm_case_study(nodes=nodes, steps=3)
        full, inner = solve_quietly(problem), solve_quietly(problem, "projected")
        for k, n in entries(3):
            a, b = full.values(start=k, within=n), inner.values(start=k, within=n)
            outside = (b <= 0) & (a > 0)
            assert a[outside].max(initial=0.0) < 0.2 * problem.grid.spacing[2], (nodes, k, n)
            assert problem.grid.fraction(outside) < 1e-3, (nodes, k, n)
            assert inner.fraction(start=k, within=n) <= full.fraction(start=k, within=n)


@pytest.mark.slow
def test_case_study_against_an_independent_prototype():
    """Fractions of the nodes from a separate program (projected Hopf-Lax, 25^4, instantaneous obstacles).

    The two programs cut the interval differently when the obstacle moves; that is worth up to 0.003 between the full
    solutions of both, and the projection costs 0.029, so 0.005 tells them apart.
    """
    problem = sdhj.arm_case_study(view_time="instantaneous")
    table = solve_quietly(problem, Projected(inner=HopfLax("linear")))
    found = [(table.values(start=0, within=n) <= 0).mean() for n in range(9)]
    expected = [0.025, 0.071, 0.147, 0.221, 0.281, 0.315, 0.337, 0.354, 0.369]
    np.testing.assert_allclose(found, expected, atol=0.005)


def test_an_unsafe_set_within_a_subspace_stays_exact():
    problem = sdhj.arm_case_study(nodes=7, steps=2)
    obstacles, pursuer = problem.unsafe
    projected, full = projected_games(problem), HJIGames(Samples(problem), Scheme())
    np.testing.assert_array_equal(projected.avoid(obstacles, 1), full.avoid(obstacles, 1))
    assert projected.avoid(pursuer, 0).shape == (25, 7, 7, 7, 7)


@pytest.mark.filterwarnings("ignore:no node is ever in danger:UserWarning")
@pytest.mark.parametrize("method", ["hji", "lax"])
@pytest.mark.parametrize(
    ("begin", "rate", "met"),
    [(0.5, 0.0, [True, True]), (1.5, 0.0, [False, False]), (1.6, 1.0, [False, True]), (0.5, -2.0, [True, False])],
)
def test_a_set_of_which_every_axis_is_dropped_is_everywhere_where_it_is_anywhere(method, begin, rate, met):
    """At each step by itself: w >= begin - rate t, on the axis of the wind from -1 to 1."""
    gale = UnsafeSet((1,), lambda p, t: begin - rate * t - p[:, 0], name="gale")
    problem = replace(wind_problem(), unsafe=[gale], grid=Grid([-3.0, -1.0], [3.0, 1.0], [41, 9], ends="wall"))
    if method == "lax":  # of velocities that do not depend on the state
        problem = replace(problem, dynamics=Dynamics([[-1.0], [1.0]], [[-1.0, 0.0], [1.0, 0.0]], np.eye(2), [0.2, 0.3]))
    table = solve_quietly(problem, Projected([(0,)], MONOTONE if method == "lax" else HJI()))
    points = problem.grid.points()
    assert [(table.hazards(points, step) > 0).all() for step in range(2)] == met
    assert [(table.hazards(points, step) <= 0).all() for step in range(2)] == [not one for one in met]
    grows = [table.fraction(start=step, within=1) > table.fraction(start=step, within=0) for step in range(2)]
    assert grows == [not one for one in met]


def test_a_subspace_with_all_axes_is_the_full_method():
    problem = zoo.chase(nodes=9)
    full = solve_quietly(problem)
    same = solve_quietly(problem, Projected([(0, 1, 2)]))
    np.testing.assert_array_equal(same.tubes, full.tubes)
    np.testing.assert_array_equal(same.marks, full.marks)


def test_dropping_what_nothing_depends_on_costs_nothing():
    """y enters neither the sets nor the velocity of x: the solution on (x) alone is the full one."""
    drift = np.array([[-1.0, 0.0], [0.0, 0.0], [1.0, 0.0]])
    problem = zoo.plane(
        grid=Grid([-3.0, -1.0], [3.0, 1.0], [41, 7], ends="wall"),
        dynamics=Dynamics([[-1.0], [0.0], [1.0]], drift, np.eye(2), [0.2, 0.5]),
        target=zoo.goal(0.0, 0.7),
        unsafe=(UnsafeSet((0,), lambda p, t: 2.0 - p[:, 0]),),
        delta=0.4,
    )
    full = solve_quietly(problem, HopfLax())
    inner = solve_quietly(problem, Projected([(0,)], HopfLax()))
    np.testing.assert_allclose(inner.tubes, full.tubes, atol=ROUNDING)


# ---- dropped coordinates that enter the dynamics


@pytest.mark.parametrize(
    ("problem", "axes"),
    [
        (lambda: current_problem(nodes=(5, 5, 6)), (0, 1)),
        (lambda: wind_problem(nodes=5), (0,)),
        (lambda: current_problem(nodes=(5, 5, 6)), (0,)),
        (lambda: damped_problem(), (0,)),  # what is dropped does not enter, what is kept does
    ],
)
def test_the_hamiltonian_is_the_supremum_over_the_dropped_nodes(problem, axes, rng):
    problem = problem()
    grid = problem.grid
    nodes = [grid.nodes(axis) for axis in range(grid.ndim)]
    sub = grid.subgrid(axes)
    for j in range(len(problem.inputs)):
        field = problem.interval(0).velocities(j, axes)
        lower, upper = ends_of(field)
        for index in itertools.product(*(range(n) for n in sub.shape)):
            p = rng.normal(size=len(axes))
            if field.coupled:
                f, b = field.drift[(..., *index)], field.gain[(..., *index)]
                value = max(p @ f[m] + np.abs(p @ b[m]).sum() for m in range(len(f)))
                most = np.maximum(-lower, upper)[(..., *index)]
                assert (np.abs(f[:, :, None] + b) <= most[:, None] + 1e-12).all()
            else:
                value = np.maximum(lower[(..., *index)] * p, upper[(..., *index)] * p).sum()
            expected = naive.hamiltonian(
                nodes,
                axes,
                {axis: nodes[axis][i] for axis, i in zip(axes, index, strict=True)},
                p,
                lambda q, j=j: problem.dynamics.drift_at(q[None], j)[0],
                lambda q: problem.dynamics.gain_at(q[None])[0],
                problem.dynamics.bounds_at(),
            )
            assert value == pytest.approx(expected, abs=1e-12)  # rounding


@pytest.mark.parametrize(("step", "rate"), [(0, 0.0), (1, 1.0)])
def test_one_axis_moved_by_the_dropped_coordinate_has_its_closed_form(step, rate):
    """dx = u + v + (1 + r t) w / 2, |w| <= 1, |v| <= 0.2: Phi(x) = |x + 0.4 u| + 0.4 (0.2 + (1 + r t) / 2) - 1.

    t is the middle of the interval.
    """
    problem = wind_problem(nodes=121)
    assert problem.interval(0).self_contained((0,)) == (0, 1)
    assert not problem.interval(0).velocities(0, (0,)).coupled

    def drift(points, u, t):
        return np.stack([u[0] + 0.5 * (1 + rate * t) * points[:, 1], np.zeros(len(points))], axis=1)

    if rate:
        problem = replace(problem, dynamics=Dynamics(problem.inputs, drift, np.eye(2), [0.2, 0.3]))
    x, away = problem.grid.nodes(0), np.abs(problem.grid.nodes(0)) < 2.0  # the walls are felt up to 0.4 * 1.9 from them
    for j, phi in projected_games(problem, [(0,)]).reach(Samples(problem).goal(0).astype(np.float32), step):
        spread = 0.2 + (1 + rate * 0.4 * (step + 0.5)) / 2
        exact = np.abs(x + 0.4 * problem.inputs[j, 0]) + 0.4 * spread - 1.0
        error = np.abs(phi - exact[:, None])[away]
        assert error.max() < 1.5 * problem.grid.spacing[0]  # a kink is spread over a few cells
        assert error.mean() < 0.1 * problem.grid.spacing[0]


@pytest.mark.slow
def test_coupled_modes_have_their_closed_form():
    """A current of any heading spreads a disk of radius 0.8 evenly: Phi = |(x + 0.2 u, y)| + 0.2 * 0.5 - 0.8.

    The heading takes 16 values, so the spread is between cos(pi / 16) and 1 times 0.1; the rest is scheme error.
    """
    errors = []
    for nodes in (21, 41):
        problem = current_problem(nodes=(nodes, nodes, 16))
        games = projected_games(problem, [(0, 1)])
        assert problem.interval(0).velocities(0, (0, 1)).coupled
        x, y = np.meshgrid(problem.grid.nodes(0), problem.grid.nodes(1), indexing="ij")
        ring = (np.hypot(x, y) > 0.5) & (np.hypot(x, y) < 1.2)
        target = np.broadcast_to((np.hypot(x, y) - 0.8).astype(np.float32)[..., None], problem.grid.shape)
        worst = 0.0
        for j, phi in games.reach(target, 0):
            exact = np.hypot(x + 0.2 * problem.inputs[j, 0], y) + 0.1 - 0.8
            worst = max(worst, np.abs(phi[..., 0] - exact)[ring].mean())
        errors.append(worst)
    assert errors[0] < 0.1 * 0.2 and errors[1] < 0.6 * errors[0]


@pytest.mark.slow
@pytest.mark.parametrize("view_time", ["swept", "instantaneous"])
def test_where_a_dropped_coordinate_enters_the_sets_are_inside_the_full_ones(view_time):
    """With Lax-Friedrichs on the subspace and Godunov on the whole grid, the order holds up to a fifth of a cell."""
    problem = current_problem(nodes=(21, 21, 12), view_time=view_time, rate=0.5)
    full = solve_quietly(problem)
    inner = solve_quietly(problem, Projected([(0, 1)]))
    cell = problem.grid.spacing[0]
    for k, n in entries(problem.steps):
        a, b = full.values(start=k, within=n), inner.values(start=k, within=n)
        assert a[b <= 0].max() < 0.2 * cell, (k, n)
        assert inner.fraction(start=k, within=n) <= full.fraction(start=k, within=n)
    assert inner.fraction(start=0, within=3) > 1.2 * inner.fraction(start=0, within=0)
    assert inner.details["projection"]["warnings"] == []


# ---- diagnosis


def test_a_good_choice_is_not_warned_about(recwarn):
    table = solve_quietly(sdhj.arm_case_study(nodes=9, steps=2), "projected")
    assert not [w for w in recwarn if issubclass(w.category, ProjectionWarning)]
    notes = table.details["projection"]
    assert notes["warnings"] == [] and all(0 < share <= 1 for share in notes["target_kept"])
    assert 0 < notes["free"]["pursuer"] < 1


@pytest.mark.parametrize(
    ("names", "told"),
    [
        (("a", "b"), ["a", "b"]),
        (("unsafe", "unsafe"), ["unsafe, number 1 of problem.unsafe", "unsafe, number 2 of problem.unsafe"]),
    ],
)
def test_a_set_that_fills_every_subspace_is_told_from_another_of_its_name(names, told):
    """The first is a cross on the axes dropped in turn, so all of every projection; the second a ball in a corner."""
    cross = UnsafeSet((1, 2), lambda p, t: np.abs(p).min(axis=1) - 0.1, name=names[0])
    ball = UnsafeSet((0, 1, 2), lambda p, t: np.linalg.norm(p - 0.7, axis=1) - 0.3, name=names[1])
    problem = zoo.chase(nodes=9, lower=[-1.0] * 3, upper=[1.0] * 3, unsafe=(cross, ball), steps=2)
    with pytest.warns(ProjectionWarning, match=rf"the unsafe set '{told[0]}' fills every subspace"):
        table = solve_quietly(problem, "projected")
    free = table.details["projection"]["free"]
    assert list(free) == told and free[told[0]] == 0.0 < free[told[1]] < 1.0


def test_what_is_written_before_the_recursion_moves_up_with_tubes_that_are_shared():
    """The target is gone after half a second, so that rows share their tubes, and those behind them move up."""
    target = TargetSet((0,), lambda p, t: np.abs(p[:, 0] - 1.0) - 0.5 + 5.0 * np.minimum(t, 1.0))
    problem = replace(zoo.chase(rate=0.4, steps=8, nodes=9), target=target)
    table = sdhj.solve(problem, Projected(), play=False)
    assert table.details["tubes_shared"] > 0
    for step in range(9):
        np.testing.assert_array_equal(table.value_array(step, 0), Samples(problem).goal(step).astype(np.float32))


def test_the_evading_target_is_lost_in_projection_and_the_table_says_why():
    problem = sdhj.evader_case_study(nodes=11, steps=2)
    with pytest.warns(ProjectionWarning, match="target depends on p[xy]"):
        table = solve_quietly(problem, "projected")
    assert table.details["projection"]["target_kept"] == [0.0, 0.0]
    assert len(table.details["projection"]["warnings"]) == 2
    for k, n in entries(2):  # nothing but the target itself
        np.testing.assert_array_equal(
            table.values(start=k, within=n) <= 0, Samples(problem).goal(k).astype(np.float32) <= 0
        )
        assert not table.inputs(start=k, within=n).any()
    assert solve_quietly(problem).inputs(start=0, within=2).any()  # while the full method does gain something


@pytest.mark.parametrize(
    ("subspaces", "said"),
    [
        ([(0, 1)], "some value of px and py is unsafe"),  # the pursuer may be anywhere
        ([(0, 2), (1, 3)], "the target depends on q1"),
        ([(2, 3)], "'obstacles' fills every subspace"),  # none of whose axes is kept
    ],
)
def test_poorly_chosen_subspaces_are_reported(subspaces, said):
    problem = sdhj.arm_case_study(nodes=9, steps=2)
    with pytest.warns(ProjectionWarning, match=said):
        table = solve_quietly(problem, Projected(subspaces))
    assert any(said in sentence for sentence in table.details["projection"]["warnings"])
    assert table.fraction(start=0, within=2) == table.fraction(start=0, within=0)


def test_tubes_that_do_not_grow_are_reported():
    """The disturbance outruns the target: the projections are sound, and still nothing is won."""
    problem = sdhj.arm_case_study(nodes=9, steps=1, v_p_max=5.0)
    with pytest.warns(ProjectionWarning, match="never grow") as told:
        sdhj.solve(problem, "projected", progress=False)
    assert {one.filename for one in told} == {__file__}  # the line that called solve
