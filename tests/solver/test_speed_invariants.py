"""What makes the solver fast must not change its answer: threads, copied tubes, runs of rows; what a solve takes."""

import dataclasses
import re
import tracemalloc

import numba
import numpy as np
import pytest
from plain import run_plainly
from room import room
from zoo import ALONE, chain, chase, interval_problem, torus_problem, unicycle_problem

import sdhj
from sdhj import Grid, Scheme
from sdhj.common import memory
from sdhj.kernels import compiling
from sdhj.problem.velocities import Velocities
from sdhj.solver import recursion, schemes
from sdhj.solver.joint import Joint
from sdhj.solver.schemes import evolve
from sdhj.table.table import entries

# The two paths compute the same differences in the same order; a fused multiply-add more or less is a rounding.
ROUNDING = 1e-13


def arm():
    return sdhj.arm_case_study(nodes=(9, 8, 7, 10), steps=2, view_time="instantaneous")


@pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS < 2, reason="needs two threads")
@pytest.mark.parametrize(
    ("problem", "options"),
    [
        (arm, {}),
        pytest.param(arm, {"method": sdhj.HJI(Scheme(frame="fixed", order=3))}, marks=pytest.mark.slow),
        (arm, {"method": "projected"}),
        (arm, {"method": Joint()}),
        (unicycle_problem, {}),
    ],
    ids=["default", "fixed, third order", "projected", "joint", "state-dependent"],
)
def test_one_and_two_threads_give_the_same_bits(problem, options):
    tables = []
    before = numba.get_num_threads()
    try:
        for threads in (1, 2):
            numba.set_num_threads(threads)
            tables.append(sdhj.solve(problem(), **options))
    finally:
        numba.set_num_threads(before)
    one, two = tables
    assert np.array_equal(one.tubes, two.tubes) and np.array_equal(one.marks, two.marks)
    assert np.array_equal(one.avoid.static, two.avoid.static) and np.array_equal(one.avoid.moving, two.avoid.moving)


@pytest.mark.parametrize(
    ("problem", "method", "most"),
    [(lambda: interval_problem(steps=6), "lax", 7), (lambda: torus_problem(nodes=9, steps=3), "hji", 10)],
)
def test_shared_tubes_are_the_tubes_that_would_be_computed(monkeypatch, problem, method, most):
    """Where nothing depends on time, and where a tube has stopped growing: the same tubes as one by one."""
    table = sdhj.solve(problem(), method=method)
    monkeypatch.setattr(sdhj.ReachAvoidProblem, "time_invariant", False)
    monkeypatch.setattr(recursion.GridSets, "unchanged", lambda self, step, within: False)
    computed = sdhj.solve(problem(), method=method)
    assert len(table.tubes) <= most <= len(computed.tubes) == len(computed.index)
    for start, within in entries(table.steps).tolist():
        assert np.array_equal(table.value_array(start, within), computed.value_array(start, within))
        assert np.array_equal(table.mark_array(start, within), computed.mark_array(start, within))


def test_cores_that_other_programs_keep_busy_are_left_to_them(monkeypatch, cores_are_looked_at, tmp_path):
    """What runs, less what this process does, in two looks with some time between; where nothing can be seen, all."""
    monkeypatch.setattr(compiling, "PROC", tmp_path)
    monkeypatch.setattr(compiling.os, "cpu_count", lambda: 4)
    for number, state in enumerate("RSR"):
        (tmp_path / "self/task" / str(number)).mkdir(parents=True)
        (tmp_path / "self/task" / str(number) / "stat").write_text(f"{number} (a ) b) {state} 1 2")
    seen = (("0.5 0.4 0.3 3/90 7", 3), ("2/90", 4), ("0 0 0 1/90 7", 4), ("", 4), ("0 0 0 9/9 7", 1))
    for allowed in (range(3), range(4)):  # the first process may use some cores only
        monkeypatch.setattr(compiling.os, "sched_getaffinity", lambda _, allowed=allowed: set(allowed), raising=False)
        for text, free in seen:
            (tmp_path / "loadavg").write_text(text)
            monkeypatch.setattr(compiling.Shared, "free", (1, 1))
            monkeypatch.setattr(compiling.Shared, "looked", -np.inf)
            assert cores_are_looked_at() == (free if len(allowed) == 4 else 4), text
    monkeypatch.setattr(compiling.Shared, "free", (4, 4))
    (tmp_path / "loadavg").write_text("0 0 0 9/9 7")
    for looked, free in ((np.inf, 4), (-np.inf, 4), (-np.inf, 1)):  # not again so soon; busy once; and still
        monkeypatch.setattr(compiling.Shared, "looked", looked)
        assert cores_are_looked_at() == free
    seen = []
    monkeypatch.setattr(compiling, "get_num_threads", lambda: 2)
    monkeypatch.setattr(compiling, "set_num_threads", seen.append)
    compiling.Shared(lambda *arguments: None)(np.zeros(9))
    assert seen == [1, 2]


def test_the_number_of_pdes_is_told():
    """Of 25 inputs, three tubes of two steps, and an avoid game for each set, in each step if it moves.

    A moving frame solves one reach game for all inputs, and the avoid games by a formula.
    """
    problem = sdhj.arm_case_study(nodes=9, steps=2)
    asked = 25 * (3 + sum(2 if part.moving else 1 for part in problem.unsafe))
    solved = {}
    methods = {"moving": "hji", "fixed": sdhj.HJI(Scheme(frame="fixed")), "lax": "lax", "projected": "projected"}
    for name, method in methods.items():
        table = sdhj.solve(problem, method)
        assert table.details["pdes_of_algorithm"] == asked
        solved[name] = table.details["pdes_solved"]
    assert solved == {"moving": 3, "fixed": asked, "lax": 0, "projected": 2 * 3}


@pytest.mark.slow
@pytest.mark.parametrize("run", [8, 40])
@pytest.mark.parametrize(("plain", "order"), [(False, 2), (True, 3)])
def test_the_length_of_the_loops_does_not_matter(monkeypatch, rng, run, plain, order):
    """However the planes are cut into runs of rows, ghost nodes included; compiled on the last two axes alone."""
    axes = slice(None) if plain else slice(2, None)
    if plain:
        run_plainly(monkeypatch)
    shape, periodic = (5, 5, 7, 6)[axes], (True, False, True, False)[axes]
    grid = Grid([0.0] * len(shape), [1.0] * len(shape), shape, periodic)
    velocities = Velocities(np.array([-1.0, 0.3, -0.2, -2.0])[axes], np.ones(len(shape)))
    values = rng.normal(size=shape)
    scheme = Scheme(order=order, dtype="float64" if plain else "float32")
    expected = evolve(grid, values, velocities, 0.05, scheme)
    schemes.layout_of.cache_clear()
    monkeypatch.setattr(schemes, "RUN", run)
    try:
        got = evolve(grid, values, velocities, 0.05, scheme)
    finally:
        schemes.layout_of.cache_clear()
    np.testing.assert_array_equal(got, expected)


@pytest.mark.parametrize(
    ("plain", "orders"), [(False, (2,)), (True, (1, 3)), pytest.param(False, (1, 3), marks=pytest.mark.slow)]
)
def test_mirror_images_stay_mirror_images(rng, monkeypatch, plain, orders):
    """Ties between differences are broken towards the node on both sides: to the last bit."""
    if plain:
        run_plainly(monkeypatch)
    grid = Grid([0.0, 0.0], [1.0, 1.0], (12, 9), (True, False))
    values = rng.integers(-3, 4, size=grid.shape).astype(float)  # many ties
    for order in orders:
        scheme = Scheme(order=order, dtype="float64" if plain else "float32")
        straight = evolve(grid, values, Velocities(np.array([-0.7, -0.1]), np.array([0.2, 0.4])), 0.1, scheme)
        mirrored = Velocities(np.array([-0.2, -0.4]), np.array([0.7, 0.1]))
        assert np.array_equal(straight, evolve(grid, values[::-1, ::-1], mirrored, 0.1, scheme)[::-1, ::-1])


def test_what_is_given_is_left_alone(rng):
    grid = Grid([0.0, 0.0], [1.0, 1.0], (8, 9))
    values, wall = rng.normal(size=grid.shape).astype(np.float32), rng.normal(size=grid.shape).astype(np.float32)
    copies = values.copy(), wall.copy()
    evolve(grid, values, Velocities(-np.ones(2), np.ones(2)), 0.1, Scheme(), obstacle=wall)
    assert np.array_equal(values, copies[0]) and np.array_equal(wall, copies[1])


def stated(problem, method):
    """Bytes that a solve takes beside the process, as it says before it begins."""
    return recursion.bytes_of_solve(recursion.GridParts(problem, method)) - recursion.PROCESS


def test_memory_is_stated_in_advance_and_checked(monkeypatch):
    problem = arm()
    table = sdhj.solve(problem)
    held = table.tubes.nbytes + table.marks.nbytes + table.avoid.static.nbytes + table.avoid.moving.nbytes
    assert held < stated(problem, sdhj.HJI()) < 3 * held
    assert stated(problem, sdhj.HJI(Scheme(dtype="float64"))) > stated(problem, sdhj.HJI())
    monkeypatch.setattr(recursion, "bytes_of_solve", lambda parts: 10**18)
    with pytest.raises(MemoryError, match="fewer nodes"):
        sdhj.solve(problem)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::sdhj.ProjectionWarning")
@pytest.mark.parametrize(
    "gain",
    [pytest.param(np.eye(3), id="boxes"), pytest.param(np.ones((3, 3)), id="coupled", marks=pytest.mark.slow)],
)
@pytest.mark.parametrize(
    "method",
    [
        pytest.param(sdhj.HJI(), id="hji"),
        pytest.param(Joint(), id="joint", marks=pytest.mark.slow),
        pytest.param(sdhj.Projected(subspaces=[(0, 2)]), id="proj", marks=pytest.mark.slow),
    ],
)
def test_sampled_velocities_stay_within_what_is_stated(gain, method):
    """State-dependent dynamics on 25^3 nodes, 25 inputs: the peak stays below what is stated in advance.

    On fewer nodes the peak is half of what any solve takes (some MB), which is stated with the process.
    """
    levels = np.linspace(-1, 1, 5)
    inputs = np.stack(np.meshgrid(levels, levels, indexing="ij"), -1).reshape(-1, 2)

    def drift(q, u):
        still = np.zeros(len(q))
        return np.stack([u[0] * np.cos(q[:, 1]), u[1] + still, still], axis=1)

    problem = chase(
        inputs=inputs,
        drift=drift,
        gain=gain,
        bounds=[0.1] * 3,
        lower=[-1.0] * 3,
        upper=[1.0] * 3,
        nodes=25,
        delta=0.1,
        steps=1,
    )
    sdhj.solve(problem, method, progress=False)  # compiles
    tracemalloc.start()
    try:
        sdhj.solve(problem, method, progress=False)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    said = stated(problem, sdhj.HJI())
    print(f"peak {peak / 1e6:.1f} MB, stated {said / 1e6:.1f} MB")
    assert peak < said


def refused(problem: sdhj.ReachAvoidProblem, method: str = "hji") -> float:
    """The GB that a refused solve says it needs."""
    with pytest.raises(MemoryError, match="fewer nodes") as refusal:
        sdhj.solve(problem, method)
    return float(re.findall(r"this solve needs about (\S+) GB", str(refusal.value))[0])


@pytest.mark.slow
def test_too_large_a_grid_is_refused_with_what_its_whole_solve_takes():
    """By one model for all numbers of nodes, and with a few nodes looked at: 10^24 are more than 64 bits hold."""
    looked = list[int]()

    def sampled(points, t):
        looked.append(len(points))
        return np.abs(points).max(axis=1) - 0.5

    half = sdhj.TargetSet((0, 1, 2, 3), sdhj.BlackBox(sampled))

    def boxed(nodes):
        return chain(inputs=[[0.0]], drift=np.zeros((1, 4)), **ALONE, nodes=nodes, target=half, unsafe=(), steps=1)

    for make, method, many in (
        (sdhj.arm_case_study, "hji", (160, 170, 180, 200, 220, 1000)),
        (sdhj.arm_case_study, "projected", (160, 200)),
        (boxed, "lax", (160, 200, 10**6)),
    ):
        with room(10**9):
            needed = [refused(make(nodes), method) for nodes in many]
        growth = np.diff(np.log(needed)) / np.diff(np.log(many))
        assert ((growth > 3.9) & (growth < 4.1)).all()
    assert sum(looked) < 2e7
    with room(10**9), pytest.raises(MemoryError, match="1000 x 1000 needs"):
        Grid([-1] * 4, [1] * 4, [1000] * 4).points()


def test_a_solve_that_does_not_fit_is_refused():
    with pytest.raises(ValueError, match="steps"):
        sdhj.arm_case_study(nodes=9, steps=10**300)
    with pytest.raises(MemoryError, match="this solve needs about"):
        sdhj.solve(dataclasses.replace(arm(), steps=10**6))
    with room(None):  # a system that does not say
        memory.require_memory(10**18, "anything")


@pytest.mark.parametrize("integrator", ["euler", "rk2", "rk3"])
@pytest.mark.parametrize("order", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_what_memory_held_before_does_not_matter(rng, monkeypatch, order, integrator):
    grid = Grid([0.0] * 3, [1.0] * 3, (6, 7, 8), (True, False, True))
    values, speed = rng.normal(size=grid.shape), np.array([-1.0, 0.2, -2.0])
    fields = np.broadcast_to(speed[:, None, None, None], (3, *grid.shape))
    scheme = Scheme(order=order, integrator=integrator)
    for lower in (speed, fields):
        clean = evolve(grid, values, Velocities(lower, lower + 1.5), 0.01, scheme, steps=2)
        with monkeypatch.context() as patch:
            patch.setattr(schemes.np, "empty_like", lambda like: np.full_like(like, np.nan))
            np.testing.assert_array_equal(
                evolve(grid, values, Velocities(lower, lower + 1.5), 0.01, scheme, steps=2), clean
            )


def test_no_problem_is_made_while_tests_are_collected(kernels_called_while_collecting):
    assert kernels_called_while_collecting == []
