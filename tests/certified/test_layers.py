"""Cells of no width at walls: what stands there is held there, for ever, and nothing else is said to be."""

import shutil
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import zoo
from naive_certified import assert_runs_succeed

import sdhj
from sdhj.certified import images as images_module
from sdhj.certified.cells import CellAxis, axis_in_file
from sdhj.certified.general_proof import GeneralProof
from sdhj.certified.table import CellSets
from sdhj.solver.recursion import recursion

BRAKES, PUSH = 4.0, 0.2


def blocked(target=None, **changed):
    """A car that cannot go back before something that blocks its lane from 50 to 52 m; m, m/s."""
    usual = {"lower": [0, 0], "upper": [100, 15], "nodes": (101, 16), "unsafe": [zoo.post(51, 1, name="blocked")]}
    usual["ends"] = [("unsafe", "safe" if target is None else "unsafe"), "wall"]
    return zoo.cart((-BRAKES, 0.0, 2.0), PUSH, target=target, **usual | {"delta": 0.5} | changed)


@pytest.fixture(scope="module")
def standing():
    return sdhj.solve(blocked(), sdhj.Certified(cells=(400, 60)), progress=False, play=False)


def can_stop(q):
    """In closed form: where the brakes, at their weakest, stop the car before the block, or what is behind it."""
    return (q[:, 0] + q[:, 1] ** 2 / (2 * (BRAKES - PUSH)) < 50) | (q[:, 0] > 52)


def driven(states, inputs, rng, pieces=40):
    """An interval of 0.5 s by small steps; the disturbance switches. Whether the block was met, and where they are."""
    met = np.zeros(len(states), np.bool_)
    for _ in range(pieces):
        push = rng.choice([-PUSH, PUSH], len(states))
        before = states[:, 1]
        after = np.clip(before + 0.5 / pieces * (inputs + push), 0.0, 15.0)
        states = np.stack([states[:, 0] + 0.5 / pieces * (before + after) / 2, after], axis=1)
        met |= np.abs(states[:, 0] - 51) <= 1
    return states, met


def test_a_car_stands_for_ever_wherever_it_can(standing):
    places = np.linspace(0.26, 49.74, 500)  # of a cell that is a quarter of a metre wide
    assert standing.contains(np.stack([places, 0 * places], axis=1)).all()
    assert standing.shape == (400, 62) and standing.details["endless"]
    q = np.random.default_rng(0).uniform([0, 0], [100, 15], (20_000, 2))
    inside, true = standing.contains(q), can_stop(q)
    assert not (inside & ~true).any() and inside.mean() > 0.97 * true.mean()
    assert standing.fraction() == pytest.approx(inside.mean(), abs=0.01)  # a layer has no share


@pytest.mark.slow
def test_it_takes_the_layer(standing):
    """With cells of full width alone the lowest cell creeps on until it meets the block."""
    proof = standing.proof
    axes = tuple(replace(axis, layers=(0, 0)) for axis in proof.axes)
    sets = CellSets(GeneralProof.of(blocked(), axes, proof.parts), False)
    recursion(sets, blocked().most_steps, lambda: None)
    assert not sets.finish({}).contains([[10.0, 0.0], [49.0, 0.0]]).any()


def test_the_first_piece_is_short(standing, monkeypatch):
    """Otherwise what counts as in the layer, 1e-10 beside it, moves on by more than rounding."""
    monkeypatch.setattr(images_module, "BESIDE_LAYER", 0.05)
    again = sdhj.solve(blocked(), sdhj.Certified(cells=(200, 30)), progress=False, play=False)
    assert not again.contains([[10.0, 0.0], [49.0, 0.0]]).any()
    assert standing.contains([[10.0, 0.0], [49.0, 0.0]]).all()


@pytest.mark.slow
def test_nobody_is_lost(standing):
    rng, controller = np.random.default_rng(1), sdhj.Controller(standing)
    q = rng.uniform([0, 0], [50, 15], (40_000, 2))
    q[:2000, 1] = 0.0
    q[2000:4000, 1] = rng.choice([1e-12, 1e-10, 1e-9, 1e-6], 2000)
    q = q[standing.contains(q)][::20]
    for wanted in (2, 0):
        states = q.copy()
        for _ in range(100):
            answer = controller.filter(states, 0, np.full(len(states), wanted))
            assert answer.promised.all()
            states, met = driven(states, standing.problem.inputs[answer.inputs, 0], rng)
            assert not met.any()
            states = states[states[:, 0] < 100]


def test_the_speed_1e_9_above_the_wall_is_no_standing(standing):
    """Within the shell, 1e-10 of 15 m/s, a state counts as standing; a little above it is in the lowest cell."""
    beside = np.array([0.0, 1e-9, 2e-9, 1e-3, 0.4])
    answer = standing.contains(np.stack([np.full(5, 49.74), beside], axis=1))
    assert answer.tolist() == [True, False, False, False, False]
    shell = standing.proof.shell[1]
    assert shell == pytest.approx(1.5e-9)
    assert standing.steps_to_go(np.stack([np.full(5, 49.74), beside], axis=1), 0)[:2].tolist() == [0, 0]


def test_no_state_past_a_wall_is_in_a_layer(standing):
    past = np.array([[10.0, -0.25], [10.0, -1e-6], [10.0, 15.25], [90.0, 15.1], [90.0, 15.0], [10.0, 0.0]])
    assert standing.contains(past).tolist() == [False, False, False, False, True, True]
    found = sdhj.Controller(standing).batch(np.array([[10.0, -0.25]]), 0)
    assert found.steps_to_go[0] == -1


def test_a_file_keeps_layers(standing, noisy, tmp_path):
    for table in (standing, noisy):
        table.save(tmp_path / "table.npz")
        again = sdhj.load(tmp_path / "table.npz")
        assert [axis.layers for axis in again.axes] == [(0, 0), (1, 1)] and again.shape == table.shape
        assert np.array_equal(again.index, table.index) and np.array_equal(again.pool, table.pool)
        assert again.cells.wall_known == (table is noisy)


@pytest.mark.parametrize("layers", [(1, 0), (0, 2), [1], "11", [True, None], [0.5, 0]])
def test_layers_where_there_is_no_wall_are_no_cells(layers):
    grid = sdhj.Grid([0.0], [1.0], [11], ends=[("unsafe", "wall")])
    with pytest.raises(ValueError, match="be 0 or 1"):
        axis_in_file(grid, 0, "1/10", 11, layers)
    assert axis_in_file(grid, 0, "1/10", 11, (0, 1)).count == 11


def test_edges_and_shares_of_layers():
    axis = CellAxis(Fraction(-1), (Fraction(3), Fraction(3)), Fraction(1, 2), False, (1, 1))
    assert axis.count == 8 and axis.edges().tolist() == [-1, -1, -0.5, 0, 0.5, 1, 1.5, 2, 2]
    assert axis.shares().tolist() == [0, *[1 / 6] * 6, 0]


@pytest.mark.slow
def test_images_beside_layers_as_intervals_say():
    """What a cell comes to, clipped at walls, is in the cells of its image; a layer only if all of it is there."""
    axis = CellAxis(Fraction(-1), (Fraction(3), Fraction(3)), Fraction(1, 2), False, (1, 1))
    rng, edges = np.random.default_rng(0), axis.edges()
    for _ in range(2000):
        cell = int(rng.integers(0, axis.count))
        low, high = np.sort(rng.choice([-9.0, -1.5, -0.5, 0.0, 0.25, 0.5, 1.7, 3.0, rng.uniform(-3, 3)], 2))
        begin, end = np.clip([edges[cell] + low, edges[cell + 1] + high], -1, 2)
        first, last = (
            int(one[0]) + cell for one in axis.moved(np.array([cell]), begin - edges[cell], end - edges[cell + 1], True)
        )
        assert edges[first] <= begin + 1e-12 and edges[last + 1] >= end - 1e-12 and first <= last
        assert (first == 0) == (end <= -1) and (last == axis.count - 1) == (begin >= 2)
        assert not (last - first) or (edges[first + 1] > begin and edges[last] < end)  # nor a cell more


ERROR = np.array([0.05, 0.05])  # m, m/s


@pytest.fixture(scope="module")
def noisy():
    """The same car, whose speedometer errs, and whose controller remembers that it stands."""
    grid = sdhj.Grid([0, 0], [100, 15], (101, 16), ends=["unsafe", "wall"])
    problem = blocked(grid=grid, sensing=sdhj.Sensing(tuple(ERROR), memory=True))
    return sdhj.solve(problem, sdhj.Certified(cells=(400, 60)), progress=False, play=False)


def measured(states, rng):
    return states + rng.choice([-1.0, 0.0, 1.0], states.shape) * ERROR


@pytest.mark.slow
def test_who_remembers_to_stand_stands_for_ever(noisy):
    """.7746 of all states less 2 E can stop in closed form; 400 x 60 cells without noise prove .7428 of .7826."""
    assert noisy.shape == (400, 62) and noisy.details["endless"] and noisy.fraction() > 0.73
    forgets = replace(noisy.problem, steps=None, sensing=sdhj.Sensing(tuple(ERROR), memory=False))
    assert sdhj.solve(forgets, sdhj.Certified(cells=(400, 60)), progress=False, play=False).fraction() == 0.0
    edge = 50.0 - 2 * ERROR[0] - 0.25  # a cell is a quarter of a metre
    assert noisy.contains([[edge - 1.0, 0.0], [edge - 1.0, 0.5]]).all()


def test_a_first_measurement_of_nothing_is_no_standing(noisy):
    """Whatever a measurement is: only what all images are held at is known to be at the wall."""
    controller, shell = sdhj.Controller(noisy), noisy.proof.shell[1]
    before = 49.6  # so near to the block that only who stands is safe
    place = np.array([[before, 0.0], [before, -0.04], [before, -1e-10], [before, -0.5 * shell]])
    assert controller.batch(controller.predict(place), 0, first=True).steps_to_go.tolist() == [-1] * 4
    assert noisy.batch(place, 0).steps_to_go.tolist() == [-1, -1, -1, noisy.steps]
    assert not noisy.contains(place).any() and not controller.admissible(place).any()


@pytest.mark.slow
def test_nobody_is_lost_who_stands_with_noise(noisy, tmp_path):
    """Own play of 200 runs for 50 s, in Python and in C, which carry on the same points: none lost, many stand."""
    rng, controller = np.random.default_rng(5), sdhj.Controller(noisy)
    q = rng.uniform([0, 0], [50, 15], (20_000, 2))
    states = q[noisy.contains(q)][:200]
    loop = sdhj.export_c(noisy, tmp_path, progress=False).loop(len(states)) if shutil.which("gcc") else None
    known, wanted = None, np.full(len(states), 2)
    for _ in range(100):
        seen = measured(states, rng)
        if known is None:
            known = controller.predict(seen)
        else:
            known, lost = noisy.next_points(known, inputs, 0, controller.predict(seen))  # noqa: F821
            assert not lost.any()
        assert (np.abs(known - states) <= ERROR + 1e-9).all()
        standing = known[:, 1] < 0
        assert (states[standing, 1] <= 1e-12).all()
        answer = controller.filter(known, 0, wanted, first=True)  # carried on above
        assert answer.promised.all()
        if loop is not None:
            status, inputs, points, missed = loop.step(seen, 0, wanted)
            assert not status.any() and not missed.any() and np.array_equal(points, known)
            assert np.array_equal(inputs, answer.inputs)
        inputs = answer.inputs
        states, met = driven(states, noisy.problem.inputs[inputs, 0], rng)
        assert not met.any()
    assert standing.mean() > 0.5
    pushed = states[standing][:1] + np.array([0.0, 1.5 * ERROR[1]])  # somebody has pushed it
    assert noisy.next_points(known[standing][:1], inputs[standing][:1] * 0, 0, controller.predict(pushed))[1].all()


def to_the_goal(steps=30):
    """The car stops before the block: within some steps it stands, wherever."""
    return blocked(
        steps=steps, target=sdhj.TargetSet((0, 1), lambda p, t: np.maximum(np.abs(p[:, 0] - 20) - 12, p[:, 1] - 0.05))
    )


def test_runs_to_where_a_car_stands():
    table = sdhj.solve(to_the_goal(12), sdhj.Certified(cells=(100, 60)), progress=False, play=False)
    rng = np.random.default_rng(0)
    q = rng.uniform([0, 0], [50, 15], (20_000, 2))
    q = q[table.contains(q)][:200]
    assert len(q) == 200
    assert_runs_succeed(table, q, rng)


@pytest.mark.slow
def test_a_second_table_leads_to_where_the_first_one_stands(standing):
    """A certified table as a target: its layer counts where a cell of the second one is at the wall."""
    problem = blocked(steps=3, target=sdhj.TargetSet.from_table(standing))
    second = sdhj.solve(problem, sdhj.Certified(cells=(200, 30)), progress=False, play=False)
    places = np.linspace(1.0, 49.0, 100)
    assert second.contains(np.stack([places, 0 * places], axis=1), within=0).all()
