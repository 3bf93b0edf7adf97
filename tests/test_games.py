"""One sampling interval: the games of App. A.3 against closed forms and each other."""

import dataclasses

import numpy as np
import pytest
from toys import interval_problem, torus_problem, unicycle_problem

import sdhj
from sdhj import Dynamics, Scheme
from sdhj.games import HJISolver, JointSolver, LaxSolver, avoid_axes, unsafe_values, velocities

DOUBLE = Scheme(dtype="float64")


def solvers(problem):
    return {
        "moving": HJISolver(problem, DOUBLE),
        "fixed": HJISolver(problem, dataclasses.replace(DOUBLE, frame="fixed")),
        "lax": LaxSolver(problem, "linear", "float64"),
    }


def test_reach_in_one_dimension_has_its_closed_form():
    """s = |q| - 1 under u and |v| <= 0.2 for 0.5 s: Phi(q) = |q + u / 2| + 0.1 - 1 away from the walls."""
    problem = interval_problem(nodes=161)
    grid = problem.grid
    q = grid.nodes(0)
    inner = np.abs(q) < 3.0
    for name, solver in solvers(problem).items():
        for j, values in solver.reach(np.abs(q) - 1.0):
            exact = np.abs(q + problem.inputs[j, 0] / 2) + 0.1 - 1.0
            error = np.abs(values - exact)[inner]
            # exact up to the rounding-off of the kink, which a second-order scheme spreads over a few cells
            assert error.max() < 1.5 * grid.spacing[0], name
            assert error.mean() < 0.1 * grid.spacing[0], name


@pytest.mark.parametrize("view_time", ["swept", "sampled", "instantaneous"])
def test_avoid_in_one_dimension_has_its_closed_form(view_time):
    """The wall q >= 3 - 0.5 t moves in; the value is the most that q + (u + 0.2) tau - wall becomes, at an end."""
    problem = interval_problem(nodes=161, rate=-0.5, view_time=view_time)
    q = problem.grid.nodes(0)
    # what the grid's own wall at q = 4 does to a state stays within its numerical domain of dependence: 6 * 3 cells of
    # 0.05 for each of the 2 stages' stencils; 2 m away nothing arrives
    inner = np.abs(q) < 2.0
    tau = np.array([0.0, 0.5])
    t = 1.0 + tau if view_time == "instantaneous" else np.array([1.5, 1.5])  # from step 2; swept, the wall is all in
    (part,) = problem.unsafe
    # swept without a formula of its own: 20 samples, lowered by half a gap's motion
    sweep = 0.5 * 0.5 / 19 / 2 if view_time == "swept" else 0.0
    for name, solver in solvers(problem).items():
        steps = max(velocities(problem, j, (0,)).steps(problem.grid, 0.5, DOUBLE.cfl) for j in range(3))
        pieces = solver._pieces([0]) if name == "lax" else steps
        # an instantaneous wall is swept over one piece of the interval, so that nothing fast slips past in between
        slack = 0.5 * 0.5 / pieces * 1.1 if view_time == "instantaneous" else 0.0
        for j, tube in enumerate(solver.avoid(part, 2)):
            exact = (q[:, None] + (problem.inputs[j, 0] + 0.2) * tau - (3.0 - 0.5 * t)).max(axis=1) + sweep
            assert (tube >= exact - 1e-9)[inner].all(), (name, j)
            assert (tube <= exact + slack + 1e-9)[inner].all(), (name, j)


def test_moving_and_fixed_frame_agree_as_the_grid_refines():
    gaps = []
    for nodes in (16, 32, 64):
        problem = torus_problem(nodes=nodes)
        by_frame = [dict(solvers(problem)[frame].reach(problem.goal(1))) for frame in ("moving", "fixed")]
        gaps.append(np.mean([np.abs(by_frame[0][j] - by_frame[1][j]).mean() for j in by_frame[0]]))
    print("mean difference of the frames", gaps)
    assert gaps[2] < gaps[1] / 1.5 < gaps[0] / 1.5**2


def test_frames_and_dynamics_choose_the_path():
    torus = HJISolver(torus_problem(), DOUBLE)
    assert torus.moving_frame
    assert not HJISolver(torus_problem(), dataclasses.replace(DOUBLE, frame="fixed")).moving_frame
    assert not HJISolver(interval_problem(), DOUBLE).moving_frame  # its axis has walls, which clip the drift
    assert not HJISolver(unicycle_problem(), DOUBLE).moving_frame


@pytest.mark.parametrize("view_time", ["swept", "instantaneous"])
def test_joint_game_equals_the_decomposed_ones_up_to_scheme_error(view_time):
    gaps = []
    for nodes in (16, 32, 64):
        problem = torus_problem(nodes=nodes, view_time=view_time)
        scheme = dataclasses.replace(DOUBLE, frame="fixed")
        values = problem.goal(1)
        joint = dict(JointSolver(problem, scheme).reach_avoid(values, 0))
        apart = HJISolver(problem, scheme)
        tubes = apart.avoid(problem.unsafe[0], 0)
        gaps.append(
            np.mean([np.abs(joint[j] - np.maximum(reach, tubes[j])).mean() for j, reach in apart.reach(values)])
        )
    print(view_time, "mean difference of joint and decomposed", gaps)
    assert gaps[2] < gaps[1] / 1.5 < gaps[0] / 1.5**2


def test_velocities_of_constant_and_sampled_dynamics_agree():
    problem = torus_problem(nodes=8)
    dynamics = problem.dynamics
    callables = Dynamics(
        dynamics.inputs,
        lambda points, u: np.tile(u, (len(points), 1)),
        lambda points: np.tile(np.eye(2), (len(points), 1, 1)),
        dynamics.bounds,
    )
    sampled = dataclasses.replace(problem, dynamics=callables)
    for j in (0, 4, 7):
        a, b = velocities(problem, j, (0, 1)), velocities(sampled, j, (0, 1))
        assert a.lower.shape == (2,) and b.lower.shape == (2, 8, 8)
        assert np.array_equal(np.broadcast_to(a.lower[:, None, None], (2, 8, 8)), b.lower)
        assert np.array_equal(np.broadcast_to(a.upper[:, None, None], (2, 8, 8)), b.upper)
    fixed = dataclasses.replace(DOUBLE, frame="fixed")
    for (_, a), (_, b) in zip(
        HJISolver(problem, fixed).reach(problem.goal(1)), HJISolver(sampled, fixed).reach(problem.goal(1)), strict=True
    ):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-12)
    with pytest.raises(ValueError, match="hji"):
        LaxSolver(sampled, "linear", "float64")


def test_coupled_adversary_is_recognised():
    problem = torus_problem(nodes=8)
    turned = dataclasses.replace(problem.dynamics, gain=np.array([[1.0, 1.0], [1.0, -1.0]]))
    field = velocities(dataclasses.replace(problem, dynamics=turned), 0, (0, 1))
    assert field.coupled
    assert not velocities(problem, 0, (0, 1)).coupled
    # each axis alone sees an uncoupled adversary
    assert not velocities(dataclasses.replace(problem, dynamics=turned), 0, (0,)).coupled


def test_avoid_games_of_a_car_take_all_axes():
    car = unicycle_problem(nodes=(7, 7, 8))
    assert velocities(car, 0, (0, 1)) is None  # x and y move with theta
    assert velocities(car, 0, (2,)) is not None
    assert avoid_axes(car, car.unsafe[0]) == (0, 1, 2)
    tube = HJISolver(car, DOUBLE).avoid(car.unsafe[0], 0)
    assert tube.shape == (3, 7, 7, 8)
    pillar = unsafe_values(car, car.unsafe[0], (0, 1, 2), 0.0, 0.2, "swept")
    assert (tube >= -pillar - 1e-12).all()  # whoever starts in the pillar has lost


def test_view_time_settings_are_ordered():
    """Swept holds every sample; an instantaneous obstacle is never larger than what it sweeps."""
    tubes = {}
    for view_time in ("swept", "sampled", "instantaneous"):
        problem = torus_problem(nodes=24, view_time=view_time)
        tubes[view_time] = LaxSolver(problem, "linear", "float64").avoid(problem.unsafe[0], 1)
    assert (tubes["swept"] >= tubes["sampled"] - 1e-12).all()
    assert (tubes["swept"] > tubes["sampled"]).any()
    # instantaneous, piece by piece swept, with the pieces' own gaps
    slack = 2.0 * 0.2 / 19 / 2
    assert (tubes["swept"] >= tubes["instantaneous"] - slack).all()
    assert (tubes["swept"] > tubes["instantaneous"] + 0.05).any()


def test_unknown_interpolation_is_named():
    with pytest.raises(ValueError, match="nearest"):
        sdhj.solve(torus_problem(nodes=8), method="lax", interpolation="nearest")


@pytest.mark.parametrize("method", ["hji", "lax", "joint"])
def test_nothing_fast_slips_between_the_time_steps(method):
    """A thin wall crosses the whole axis within one interval, much more than a cell in each time step: none is safe."""
    problem = interval_problem(nodes=81, view_time="instantaneous")

    def bullet(points, t):
        return np.abs(points[:, 0] - (-4.5 + 18.0 * (t - 0.5))) - 0.02  # over the axis from t = 0.53 to 0.97

    problem = dataclasses.replace(problem, unsafe=(sdhj.UnsafeSet((0,), bullet, rate=18.0, name="bullet"),))
    if method == "joint":
        tubes = dict(JointSolver(problem, DOUBLE).reach_avoid(np.full(81, -1.0), 1)).values()
    else:
        solver = HJISolver(problem, DOUBLE) if method == "hji" else LaxSolver(problem, "linear", "float64")
        tubes = solver.avoid(problem.unsafe[0], 1)
    inner = np.abs(problem.grid.nodes(0)) < 3.5
    for tube in tubes:
        assert (tube[inner] > 0).all()


def without_adversary(problem):
    """The problem with an adversary of no components, and with one that may do nothing."""
    dynamics, ndim = problem.dynamics, problem.grid.ndim
    return [
        dataclasses.replace(problem, dynamics=dataclasses.replace(dynamics, gain=gain, bounds=bounds))
        for gain, bounds in ((np.zeros((ndim, 0)), []), (np.zeros((ndim, 1)), [0.0]))
    ]


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"scheme": dataclasses.replace(DOUBLE, frame="fixed")},
        {"games": "joint"},
        {"method": "lax"},
        {"method": "projected", "subspaces": [(0, 1)]},
        {"method": "projected", "subspaces": [(0, 1)], "inner": "lax"},
    ],
    ids=str,
)
def test_an_adversary_of_no_components_is_one_that_does_nothing(options):
    none, idle = without_adversary(torus_problem(nodes=8, steps=2))
    tables = [sdhj.solve(problem, progress=False, **options) for problem in (none, idle)]
    for within in (1, 2):
        assert np.array_equal(*(table.values(start=0, within=within) for table in tables))
    assert tables[0].fraction(start=0, within=2) > tables[0].fraction(start=0, within=0) > 0


@pytest.mark.parametrize("options", [{}, {"games": "joint"}, {"method": "projected", "subspaces": [(0, 1), (0, 2)]}])
@pytest.mark.filterwarnings("ignore::sdhj.projections.ProjectionWarning")
def test_state_dependent_dynamics_without_an_adversary(options):
    none, idle = without_adversary(unicycle_problem(nodes=(7, 7, 8), steps=1))
    tables = [sdhj.solve(problem, progress=False, **options) for problem in (none, idle)]
    assert np.array_equal(*(table.values(start=0, within=1) for table in tables))


@pytest.mark.parametrize("method", ["hji", "projected", "lax"])
@pytest.mark.parametrize("change", ["delta", "drift", "disturbance"])
@pytest.mark.parametrize("make", [torus_problem, unicycle_problem])
def test_absurd_speeds_are_refused(method, change, make):
    """They would need more time steps than anyone can wait for."""
    if make is unicycle_problem and (method == "lax" or change == "drift"):
        pytest.skip("lax takes constant dynamics only; the car's drift is a function")
    problem = make()
    if change == "delta":
        problem = dataclasses.replace(problem, delta=1e8, unsafe=())
    else:
        dynamics = {"drift": {"drift": [[0.0, 1e12]] * 9}, "disturbance": {"bounds": [0.1, 1e12]}}[change]
        problem = dataclasses.replace(problem, dynamics=dataclasses.replace(problem.dynamics, **dynamics))
    with pytest.raises(ValueError, match=r"delta = .* needs .*e\+.* at most 100,000 .*along axis \d \(.* apart; use a"):
        sdhj.solve(problem, method=method, progress=False)


def test_a_tiny_cfl_number_is_refused():
    with pytest.raises(ValueError, match="time steps for each PDE, at cfl 1e-12"):
        sdhj.solve(interval_problem(), scheme=Scheme(cfl=1e-12), progress=False)
