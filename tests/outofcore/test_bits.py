"""What is solved in slabs is what is solved in memory, to the last bit, and one node less beside a slab is too few."""

import numpy as np
import pytest
import toys
from plain import run_plainly
from slabbed import assert_bit_equal, room, rough_problem

import sdhj
from sdhj import outofcore
from sdhj.outofcore import planned
from sdhj.problem import grid as grid_module
from sdhj.solver.avoid import dangers
from sdhj.solver.recursion import GridSets, Slabs, recursion
from sdhj.solver.slabs import avoid_halo, in_slabs, nodes_read_in_a_step, reach_halo, slab_window, time_steps
from sdhj.solving import method_of
from sdhj.table.store import Memory

pytestmark = pytest.mark.filterwarnings("ignore::sdhj.problem.findings.ResolutionWarning")
ROUGHEST = sdhj.HJI(scheme=sdhj.Scheme(order=1, integrator="euler", frame="fixed"))
ROUGH = sdhj.HJI(scheme=sdhj.Scheme(integrator="euler", frame="fixed"))
EXACT = sdhj.HJI(scheme=sdhj.Scheme(order=3, integrator="rk3", frame="fixed", dtype="float64"))


def staying_problem():
    """No target; ends that are unsafe on the axis that is cut, and a speed that depends on the state."""
    return sdhj.ReachAvoidProblem(
        grid=sdhj.Grid([-1.0, -2.0], [1.0, 2.0], [41, 15], ends=["unsafe", "wall"]),
        dynamics=sdhj.Dynamics(
            [[-2.0], [2.0]], lambda q, u: np.stack([q[:, 1], np.full(len(q), u[0])], axis=1), [[0.0], [1.0]], [0.3]
        ),
        target=None,
        unsafe=[sdhj.UnsafeSet((1,), lambda p, t: 1.9 - np.abs(p[:, 0]), name="fast")],
        delta=0.1,
        steps=4,
    )


def half_coupled_problem():
    """The adversary moves both axes at once on one half of the grid only: elsewhere a slab would take another flux."""

    def gain(q):
        both = np.where(q[:, 0] > 0.3, 0.2, 0.0)
        return np.stack([np.full(len(q), 0.3), both], axis=1)[:, :, None]

    return sdhj.ReachAvoidProblem(
        grid=sdhj.Grid([-1.0, -1.0], [1.0, 1.0], [40, 15], ends="wall"),
        dynamics=sdhj.Dynamics([[1.0], [-1.0]], [[1.0, 0.0], [-1.0, 0.0]], gain, [1.0]),
        target=sdhj.TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 0.2 * t, p[:, 1]) - 0.4),
        unsafe=[],
        delta=0.1,
        steps=3,
    )


def drifting_problem():
    """A drift along three axes with ends, an interval's way and push long beside a slab."""
    inputs = [[a, b, c] for a in (-1.0, 1.0) for b in (0.0, 0.7) for c in (-0.5, 0.5)]
    return sdhj.ReachAvoidProblem(
        grid=sdhj.Grid([-1.0] * 3, [1.0] * 3, [41, 12, 13], ends=["wall", "unsafe", ("unsafe", "wall")]),
        dynamics=sdhj.Dynamics(inputs, inputs, np.eye(3), [0.3, 0.2, 0.1]),
        target=sdhj.TargetSet((0, 1, 2), lambda p, t: np.abs(p - 0.2 * t).max(axis=1) - 0.3),
        unsafe=[sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0] + 0.5, p[:, 1]) - 0.2, name="post")],
        delta=0.15,
        steps=3,
    )


CASES = {
    "a drift along three axes": (drifting_problem, "hji", 4),
    "a line": (lambda: toys.interval_problem(nodes=81, rate=0.1, steps=2), "hji", 20),
    "a torus, gone around": (lambda: toys.torus_problem(nodes=48, steps=1), "hji", 10),
    "a torus, by Hopf and Lax": (lambda: toys.torus_problem(nodes=40, steps=2), "lax", 10),
    "a torus, at each time": (lambda: toys.torus_problem(nodes=40, view_time="instantaneous", steps=1), ROUGH, 10),
    "rough values": (lambda: rough_problem(48, across=8), ROUGHEST, 8),
    "third order": (lambda: rough_problem(24, across=8, state=True), EXACT, 8),
    "a car, three axes": (lambda: toys.unicycle_problem(nodes=(41, 9, 8), steps=2), "hji", 12),
    "staying, unsafe ends": (staying_problem, "hji", 4),
    "coupled here and there": (half_coupled_problem, "hji", 4),
    "the arm, four axes": (lambda: sdhj.arm_case_study(nodes=(20, 7, 7, 7), steps=2), "hji", 5),
    "the arm, by Hopf and Lax": (lambda: sdhj.arm_case_study(nodes=9, steps=2), "lax", 3),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_slabs_give_every_bit(case, tmp_path, monkeypatch):
    make, method, width = CASES[case]
    if method in (ROUGHEST, EXACT):
        run_plainly(monkeypatch)
    problem = make()
    stored = sdhj.solve(problem, method, store=tmp_path / "t", memory=room(problem, method, width))
    assert stored.details["slabs"] > 2
    assert_bit_equal(stored, sdhj.solve(problem, method))


@pytest.mark.slow
@pytest.mark.parametrize("case", ["a drift along three axes", "a torus, gone around", "the arm, by Hopf and Lax"])
def test_slabs_in_memory_give_every_bit(case):
    """What `solve` never does, as one slab is always faster there: three slabs or more of arrays in memory."""
    make, method, width = CASES[case]
    problem, method = make(), method_of(method)
    plan = planned(problem, method, (0, width))
    sets = GridSets(problem, method, slabs=Slabs(plan))
    assert plan.layout.slabs >= 3 and isinstance(sets.arrays, Memory)
    recursion(sets, problem.steps, lambda: None)
    assert_bit_equal(sets.finish({}), sdhj.solve(problem, method))


@pytest.mark.slow
@pytest.mark.parametrize("width", [1, 2, 3, 7, 16])
@pytest.mark.parametrize("axis", [0, 1])
def test_however_the_grid_is_cut(width, axis, tmp_path, monkeypatch):
    """Also along axes that are not chosen by themselves."""
    problem = toys.unicycle_problem(nodes=(24, 24, 16), steps=2)
    monkeypatch.setattr(outofcore, "planned", lambda problem, method, **_: planned(problem, method, (axis, width)))
    assert_bit_equal(sdhj.solve(problem, store=tmp_path / "t"), sdhj.solve(problem))


def played(method, problem, halo, rng):
    """Reach sets of rough values on the whole grid, and on a slab with a halo: both on the slab."""
    values, axes = rng.uniform(-1.0, 1.0, problem.grid.shape).astype(np.float32), (0, 1)
    window, kept = slab_window(problem.grid, 0, (20, 24), halo)
    part = method.on(problem.on(window), counted=time_steps(method, problem, axes), wanted={0: kept})
    cut = values.take(window.places(0), axis=0)
    whole = np.stack([phi.copy() for _, phi in sorted_by_input(method.on(problem).reach(values, 0))])
    return whole[:, 20:24], np.stack([phi.copy() for _, phi in sorted_by_input(part.reach(cut, 0))])


def sorted_by_input(found):
    return sorted(((j, phi.copy()) for j, phi in found), key=lambda pair: pair[0])


SCHEMES = [
    sdhj.Scheme(order=order, integrator=integrator, frame=frame)
    for order, integrator, frame in (
        (1, "euler", "fixed"),
        (2, "rk2", "fixed"),
        (3, "rk3", "fixed"),
        (2, "rk2", "moving"),
    )
]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scheme", "state", "across"),
    [
        (SCHEMES[0], False, 12),
        (SCHEMES[0], True, 12),
        (SCHEMES[1], False, 72),
        (SCHEMES[1], True, 72),
        (SCHEMES[2], True, 12),
        pytest.param(SCHEMES[2], False, 72, marks=pytest.mark.slow),  # of fewer rows it may hang on none
        (SCHEMES[3], False, 72),
        (SCHEMES[3], True, 72),
    ],
    ids=lambda value: f"{value.order} {value.integrator} {value.frame}" if hasattr(value, "order") else None,
)
def test_one_node_less_is_too_few(scheme, state, across, monkeypatch):
    """On few rows as plain Python, of schemes that nothing else compiles."""
    if across < 72:
        run_plainly(monkeypatch)
    method, problem = (
        sdhj.HJI(scheme=scheme),
        rough_problem(72, across=across, state=state, gain=0.05, drift=0.6, delta=0.006 if state else 0.05),
    )
    halo = reach_halo(method.on(problem), 0, time_steps(method, problem, (0, 1)))
    assert 2 * halo + 4 < 72
    assert np.array_equal(*played(method, problem, halo, np.random.default_rng(0)))
    seeds = [np.random.default_rng(seed) for seed in range(20)]
    assert not all(np.array_equal(*played(method, problem, halo - 1, rng)) for rng in seeds)


def test_one_node_less_is_too_few_for_hopf_and_lax():
    method, problem = sdhj.HopfLax(), rough_problem(72, gain=0.05)
    halo = reach_halo(method.on(problem), 0, {})
    assert np.array_equal(*played(method, problem, halo, np.random.default_rng(0)))
    assert not np.array_equal(*played(method, problem, halo - 1, np.random.default_rng(0)))


@pytest.mark.parametrize("gain", [0.3, 0.6, 2.4])
def test_what_the_disturbance_reaches_is_beside_a_slab(gain):
    """A push of 1.1, 2.2 and 8.6 cells: the maximum over it may read farther than time steps of first order."""
    method = sdhj.HJI(scheme=sdhj.Scheme(order=1, integrator="euler"))
    problem = rough_problem(72, gain=gain, drift=0.3)
    games = method.on(problem)
    assert games.shifted and games.displacement_by_disturbance.all()
    assert np.array_equal(*played(method, problem, reach_halo(games, 0, {}), np.random.default_rng(0)))


def test_what_a_time_step_reads():
    assert [nodes_read_in_a_step(scheme) for scheme in SCHEMES] == [1, 4, 9, 4]


@pytest.mark.parametrize("method", [ROUGHEST, sdhj.HJI(), sdhj.HopfLax()], ids=["fixed", "moving", "lax"])
def test_avoid_tubes_need_what_they_say(method, monkeypatch):
    if method is ROUGHEST:
        run_plainly(monkeypatch)
    problem = rough_problem(72, across=12, gain=0.05)
    (game,) = (in_slabs(method, problem, one, 0) for one in dangers(problem))
    whole = method.on(problem).avoid(game.danger.unsafe_set, 0)[:, 20:24]

    def on_a_slab(halo):
        window, kept = slab_window(problem.grid, 0, (20, 24), halo)
        games = method.on(problem.on(window), counted=game.counted, wanted={0: kept})
        return games.avoid(game.danger.unsafe_set, 0)

    assert game.halo == avoid_halo(method.on(problem), (0, 1), 0, game.counted)
    assert np.array_equal(on_a_slab(game.halo), whole)
    less = game.halo - 1 if method is ROUGHEST else game.halo - 2  # Hopf-Lax: a node to each side is to spare
    assert not np.array_equal(on_a_slab(less), whole)


def test_a_time_step_of_its_own_would_give_other_bits(tmp_path, monkeypatch):
    problem = toys.unicycle_problem(nodes=(41, 9, 8), steps=1)

    def faster(q, u):
        return np.stack([1.0 + 2.0 * (q[:, 0] > 0.5), 0 * q[:, 0], 0 * q[:, 0]], axis=1)

    fast = sdhj.Dynamics([[1.0]], faster, np.zeros((3, 1)), [0.0])
    problem = sdhj.ReachAvoidProblem(problem.grid, fast, problem.target, (), 0.2, 1)
    table = sdhj.solve(problem)
    assert_bit_equal(sdhj.solve(problem, store=tmp_path / "a", memory=room(problem, width=5)), table)
    monkeypatch.setattr(outofcore, "time_steps", lambda *_: {})
    monkeypatch.setattr(outofcore, "reach_halo", lambda *_: 20)
    other = sdhj.solve(problem, store=tmp_path / "b", memory=room(problem, width=5))
    assert not np.array_equal(other.values(start=0, within=1), table.values(start=0, within=1))


def test_what_is_found_in_pieces_is_what_is_found_at_once(monkeypatch):
    """Large grids are gone through in pieces, whose size does not matter."""
    make = {"car": lambda: toys.unicycle_problem(nodes=(17, 9, 8)), "rough": lambda: rough_problem(24, state=True)}
    for build in make.values():
        at_once = build()
        monkeypatch.setattr(grid_module, "PIECE", 100)
        in_pieces, pieces = build(), list(build().grid.pieces())
        assert len(pieces) > 3 and max(piece.size for piece in pieces) <= 100
        assert np.array_equal(np.concatenate([piece.points() for piece in pieces]), at_once.grid.points())
        assert np.array_equal(in_pieces.interval(0).speeds, at_once.interval(0).speeds)
        for ends in zip(*(one.interval(0).ends_at_nodes(1, 0.0) for one in (in_pieces, at_once)), strict=True):
            assert all(np.array_equal(one, other) for one, other in zip(*ends, strict=True))
        assert in_pieces.time_invariant == at_once.time_invariant
        monkeypatch.undo()


def test_a_window_has_the_nodes_of_its_grid():
    grid = sdhj.Grid([-1.0, 0.1, -np.pi], [1.0, 0.7, np.pi], [9, 12, 10], [False, False, True])
    window = grid.window([2, 3, 7], [5, 4, 6])
    product = np.stack(np.meshgrid(*map(window.nodes, range(3)), indexing="ij"), -1)
    assert np.array_equal(window.points(), product.reshape(-1, 3))
    assert window.nodes(2).tolist() == grid.nodes(2)[[7, 8, 9, 0, 1, 2]].tolist()
    assert window.spacing == grid.spacing
    assert window.subgrid([0, 2]).nodes(1).tolist() == window.nodes(2).tolist()
    assert window.subgrid([0]) == grid.subgrid([0]).window([2], [5])
    whole, parts = grid.weights, [grid.stretch(1, begin, 4) for begin in (0, 4, 8)]
    assert np.array_equal(np.concatenate([part.weights for part in parts], axis=1), whole)
    values = np.random.default_rng(0).normal(size=grid.shape)
    some = values[np.ix_(*map(window.places, range(3)))]
    points = np.random.default_rng(1).uniform([-0.4, 0.3, 2.0], [0.4, 0.4, 4.0], (50, 3))
    assert np.array_equal(window.interpolate(some, points), grid.interpolate(values, points))


def test_states_past_a_wall_are_in_no_tube_of_a_store_either(tmp_path):
    problem = rough_problem()
    table, stored = sdhj.solve(problem), sdhj.solve(problem, store=tmp_path / "t", memory=room(problem))
    points = np.random.default_rng(0).uniform(-1.5, 1.5, (400, 2))
    found = stored.contains(points)
    assert (
        np.array_equal(found, table.contains(points)) and found.any() and not found[np.abs(points[:, 1]) > 1.01].any()
    )
