"""The feedback controller: against its slow twin, against the table at the nodes, its rules and its guards."""

import threading
import time
from dataclasses import replace
from functools import cache
from itertools import product
from types import SimpleNamespace
from typing import Any

import naive_controller
import numpy as np
import pytest
import zoo
from parameters import but_slow

import sdhj
from sdhj.common.remembering import read_only
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.samples import Samples
from sdhj.table.ahead import CHECKED_INSTANTS, choose_by_true_sets
from sdhj.table.batches import CHUNK, Batch, Table
from sdhj.table.beside import fallbacks
from sdhj.table.controller import Controller
from sdhj.table.rules import RULES, Candidates
from sdhj.table.table import AvoidTubes, LookupTable


@cache
def free_problem() -> ReachAvoidProblem:
    return zoo.interval_problem(nodes=33, steps=3, unsafe=False)


def solved(problem: ReachAvoidProblem, method: str = "lax") -> LookupTable:
    """With linear interpolation "lax" is the operator the controller looks ahead with, and exact on the interval."""
    chosen = sdhj.HopfLax("linear") if method == "lax" else method
    return sdhj.solve(problem, chosen, progress=False)


@cache
def double_table() -> LookupTable:
    return sdhj.solve(zoo.torus_problem(), sdhj.HopfLax("linear", "float64"), progress=False)


@cache
def free_table() -> LookupTable:
    return solved(free_problem())


def coupled_problem(bounds: Any = (0.3, 0.3)) -> ReachAvoidProblem:
    """A point in the plane whose adversary moves both axes at once: what it reaches in an interval is no box."""
    moves = np.stack(np.meshgrid([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0], indexing="ij"), axis=-1).reshape(-1, 2)
    dynamics = sdhj.Dynamics(moves, moves, [[1.0, 0.5], [0.5, 1.0]], bounds)
    return zoo.plane(dynamics=dynamics, target=zoo.goal(0.0, 0.0, 0.5), steps=2)


@pytest.fixture(scope="module")
def tables() -> dict[str, LookupTable]:
    """Tables in one to four dimensions: walls and periodic axes, moving sets, velocities that depend on the state."""
    return {
        "interval": solved(zoo.interval_problem(nodes=41, rate=-0.3)),
        "free": free_table(),
        "torus": solved(zoo.torus_problem()),
        "unicycle": solved(zoo.unicycle_problem(nodes=(9, 9, 8), steps=2), "hji"),
        "arm": solved(sdhj.arm_case_study(nodes=9, steps=3), "hji"),
        "coupled": solved(coupled_problem(), "hji"),
        "misled": solved(zoo.misled(nodes=21, delta=0.2, steps=3, pieces=zoo.PIECES), "hji"),
        "misled car": solved(zoo.misled_car(pieces=zoo.PIECES), "hji"),
    }


NAMES = ("interval", "free", "torus", "unicycle", "arm", "coupled", "misled", "misled car")
DOUBLE = pytest.param("double", marks=pytest.mark.slow)  # what is compiled for double precision alone


def random_states(problem: ReachAvoidProblem, count: int, rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(problem.grid.lower, problem.grid.upper, (count, problem.grid.ndim))


def admissible_states(table: LookupTable, count: int, rng: np.random.Generator, step: int = 0) -> np.ndarray:
    states = random_states(table.problem, 200 * count, rng)
    found = states[table.contains(states, start=step, within=table.steps)][:count]
    assert len(found) == count
    return found


def truth(problem: ReachAvoidProblem, q: np.ndarray, step: int, boxes: list[Any]) -> dict[str, Any]:
    """What the true sets say of a state, one place at a time."""
    grid, dynamics, begin = problem.grid, problem.dynamics, problem.time(step)
    walls = [
        np.where([(end == "wall") and not p for end, p in zip(ends, grid.periodic, strict=True)], face, off)
        for ends, face, off in zip(
            zip(*grid.ends, strict=True), (grid.lower, grid.upper), (-np.inf, np.inf), strict=True
        )
    ]

    def unsafe(place: Any, t: float) -> bool:
        return bool(problem.unsafe_value(np.clip(place, *walls)[None], t)[0] <= 0)

    def target(place: Any, t: float) -> bool:
        return bool(problem.target_value(np.clip(place, *walls)[None], t)[0] <= 0)

    def passes(j: int, left: int) -> bool:
        slope = problem.delta * dynamics.drift_at(grid.wrapped(q[None]), j)[0]
        halfway = np.clip(q + slope / 2, *walls)
        bent = problem.delta * dynamics.drift_at(grid.wrapped(halfway[None]), j)[0] - slope
        shares = np.arange(1, CHECKED_INSTANTS + 1) / CHECKED_INSTANTS
        path = [q + share * slope + share**2 * bent for share in shares]
        ends = [face for face, end in zip((grid.lower, grid.upper), zip(*grid.ends, strict=True), strict=True)]
        for place in path:
            for axis in range(grid.ndim):
                if not grid.periodic[axis]:
                    low, high = (end == "unsafe" for end in grid.ends[axis])
                    if (low and place[axis] < ends[0][axis] - 1e-9) or (high and place[axis] > ends[1][axis] + 1e-9):
                        return False
        goal = target if left == 0 else None
        return naive_controller.looked_at(
            q, path, boxes[j], {"spacing": grid.spacing}, begin + problem.delta * shares, unsafe, goal
        )

    return {"unsafe": unsafe(q, begin), "off the target": not target(q, begin), "passes": passes}


def twin(
    table: LookupTable, q: np.ndarray, step: int, within: int = 1
) -> tuple[int | None, list[int], list[float], int | None]:
    """What the slow twin says of a state."""
    (boxes, order, avoid, grid), left = around(table, q, step), table.steps - step
    tubes, following = [
        [table.value_array(start, n) for n in range(table.steps - start + 1)] if start <= table.steps else []
        for start in (step, step + 1)
    ]
    marks = [table.inputs(start=step, within=n) for n in range(left + 1)]
    true = truth(table.problem, q, step, boxes)
    return naive_controller.decide(q, tubes, following, marks, boxes, order, avoid, grid, true, within)


def around(table: LookupTable, q: np.ndarray, step: int) -> tuple[list[Any], list[int], list[Any], dict[str, Any]]:
    """The boxes of all inputs, worked out here from Eq. (1), the order of axes, the avoid tubes, and the grid."""
    problem, grid = table.problem, table.grid
    dynamics, boxes = problem.dynamics, []
    told = {"lower": grid.lower, "spacing": grid.spacing, "shape": grid.shape, "periodic": grid.periodic}
    for j in range(len(problem.inputs)):
        middle = problem.grid.lower, problem.grid.upper
        half = q + problem.delta / 2 * dynamics.drift_at(q[None], j)[0]
        held = np.where(grid.periodic, half, np.clip(half, *middle))
        centre = q + problem.delta * dynamics.drift_at(held[None], j)[0]
        if dynamics.gain is None:
            pieces = [
                [q + problem.delta * np.array(end) for end in box]
                for box in zoo.misled_velocities(held, problem.inputs[j])
            ]
            low, high = np.min([a for a, _ in pieces], axis=0), np.max([b for _, b in pieces], axis=0)
            walls = [ends[0] == "wall" and not p for ends, p in zip(grid.ends, grid.periodic, strict=True)][:2]
            held = (walls & ((low < grid.lower) | (high > grid.upper))[:2]).any()
            planes = naive_controller.planes_around(pieces, 4 * zoo.PIECES, [(0, 1)], told)
            boxes.append((low, high, [], [] if held else planes))
            continue
        pushes = problem.delta * dynamics.gain_at(q[None])[0] * dynamics.bounds_at(0)
        several = (pushes != 0).sum(axis=0) > 1
        spread = np.abs(pushes[:, ~several]).sum(axis=1)
        boxes.append((centre - spread, centre + spread, list(pushes[:, several].T), []))
    kinds = [len({(low[axis] - q[axis], high[axis] - q[axis]) for low, high, *_ in boxes}) for axis in range(grid.ndim)]
    order = sorted(range(grid.ndim), key=lambda axis: kinds[axis] if dynamics.constant else axis)
    avoid = [(table.avoid.static_axes, table.avoid.static)]
    if step < table.steps:
        avoid.append((table.avoid.moving_axes, table.avoid.moving[step]))
    return boxes, order, avoid, told


@pytest.mark.parametrize("name", [*but_slow(NAMES, "misled", "arm", "coupled", "misled car"), DOUBLE])
def test_controller_equals_its_slow_twin(tables: dict[str, LookupTable], name: str, rng: np.random.Generator) -> None:
    table, seen = tables[name] if name != "double" else double_table(), set()
    controller = Controller(table)
    for step, all_left in product(range(table.steps + 1), (False, True)):
        states = random_states(table.problem, 40, rng)
        within = max(1, table.steps - step) if all_left else 1
        batch = table.batch(states, step, within) if all_left else controller.batch(states, step)
        for m, q in enumerate(states):
            to_go, safe, margins, best = twin(table, q, step, within)
            assert batch.steps_to_go[m] == (-1 if to_go is None else to_go)
            assert np.flatnonzero(batch.safe[m]).tolist() == safe
            assert batch.best[m] == (-1 if best is None else best)
            if margins:  # products and sums of a few dozen float64 numbers of order one, in another order
                np.testing.assert_allclose(batch.margins[m], margins, rtol=0, atol=1e-12)
            else:
                assert np.isposinf(batch.margins[m]).all()
            seen.add(to_go)
    assert None in seen and len(seen) >= 3  # states in and out of the tubes were compared


@pytest.mark.parametrize("name", [*but_slow(NAMES, "misled", "arm"), DOUBLE])
def test_fallback_equals_its_slow_twin(tables: dict[str, LookupTable], name: str, rng: np.random.Generator) -> None:
    table, promised = tables[name] if name != "double" else double_table(), set()
    for step in range(table.steps):
        states = random_states(table.problem, 5, rng)
        chosen, steps, hazards = fallbacks(table, states, step)
        every = table.hazards(states, step)
        following = [table.value_array(step + 1, table.steps - step - 1)]
        for m, q in enumerate(states):
            boxes, _, avoid, grid = around(table, q, step)
            scores = naive_controller.fallback_scores(q, following, boxes, avoid, grid)
            with np.errstate(invalid="ignore"):  # -inf where nothing is unsafe
                np.testing.assert_allclose(every[m], [hazard for hazard, _ in scores], rtol=0, atol=1e-12)
            true = truth(table.problem, q, step, boxes)
            passing = [score for j, score in enumerate(scores) if true["passes"](j, 1)]
            (hazard, margin), (least, best) = scores[chosen[m]], min(passing or scores)
            assert hazard == least or hazard - least < 1e-12  # rounding tells equals apart
            assert hazard > least or margin - best < 1e-12
            assert hazards[m] == every[m, chosen[m]]
            assert steps[m] == (hazards[m] <= 0 and bool(passing) and not true["unsafe"])
            alone = Controller(table).fallback(q, step)
            assert (alone.input, alone.steps, alone.hazard) == (chosen[m], steps[m], hazards[m])
        promised |= set(steps.tolist())
    assert 1 in promised


@pytest.mark.parametrize("boxed", [False, True], ids=["formula", "black box"])
@pytest.mark.parametrize("soon", [False, True])
def test_true_sets_are_looked_at_at_the_times_of_the_points(soon: bool, boxed: bool) -> None:
    """From -1.3 m, pushed, into what is the target or unsafe at the end of the interval alone, or until then.

    The tubes know nothing of it: at the end the state is from -0.9 to -0.7 m, and -0.8 m without a push.
    """

    def only(inside: Any, far: float) -> Any:
        return lambda p, t: np.where((t < 0.47) == soon, inside(p), far)

    known = zoo.line(steps=1)
    for unsafe, target, safe in (
        (only(lambda p: np.abs(p[:, 0] + 0.69) - 0.05, 5.0), known.target.level_set, soon),
        (lambda p, t: 9.0 - p[:, 0], only(lambda p: np.abs(p[:, 0]) - 1.0, 5.0), not soon),
    ):
        part = sdhj.UnsafeSet((0,), sdhj.BlackBox(unsafe, slope=1.0, rate=100.0) if boxed else unsafe)
        told = replace(known, unsafe=[part], target=sdhj.TargetSet((0,), target))
        controller = Controller(replace(solved(known), problem=told))
        assert controller.batch([[-1.3]], 0).safe.tolist() == [[False, False, safe]]


@pytest.mark.parametrize("method", ["hji", "lax", sdhj.Certified(cells=[40])], ids=["hji", "lax", "certified"])
@pytest.mark.parametrize("rate", [0.0, 0.1])
def test_without_a_target_as_many_steps_are_to_go_as_are_left(rate: float, method: Any) -> None:
    problem = zoo.interval_problem(nodes=41, rate=rate, target=None, steps=4)
    controller = Controller(solved(problem, method))
    for step in range(5):
        assert controller.batch([[0.0], [3.9]], step).steps_to_go.tolist() == [4 - step, -1]
        assert controller.steps_to_go(np.zeros(1), step) == 4 - step


@pytest.mark.parametrize("ends", ["wall", "unsafe"])
@pytest.mark.parametrize("method", ["hji", sdhj.Certified(cells=[40, 40])], ids=["hji", "certified"])
def test_a_fallback_promises_nothing_off_the_grid(ends: str, method: Any) -> None:
    """Neither along the axis of the unsafe set nor along the other one."""
    post = sdhj.UnsafeSet((1,), lambda p, t: np.abs(p[:, 0]) - 0.2)
    problem = zoo.plane(nodes=21, unsafe=[post], ends=ends, steps=1)
    controller = Controller(sdhj.solve(problem, method, progress=False, play=False))
    places = [[0.0, 1.0], [2.1, 1.0], [-2.1, 1.0], [0.0, 2.1], [0.0, -2.1], [0.0, 0.1]]
    assert [controller.fallback(np.array(place), 0).steps for place in places] == [1, 0, 0, 0, 0, 0]


@pytest.mark.parametrize("way", [-1.0, 1.0])
@pytest.mark.parametrize("method", ["hji", "lax"])
def test_where_all_is_clear_a_fallback_leads_to_where_the_next_tube_is(method: str, way: float) -> None:
    """A target that jumps from one side to the other with the first step."""
    target = sdhj.TargetSet((0,), lambda p, t: np.abs(p[:, 0] + way * np.where(t > 0.25, -2.0, 2.0)) - 1.0)
    problem = zoo.line(ends="wall", target=target, steps=1)
    answer = Controller(solved(problem, method)).fallback(np.zeros(1), 0)
    assert problem.inputs[answer.input, 0] == way and answer.steps == 1


@pytest.mark.parametrize("bounds", but_slow([0.4, 2.0, 0.0], 2.0))
def test_controller_equals_its_slow_twin_on_noise(bounds: float, rng: np.random.Generator) -> None:
    """Tubes of noise have their largest values anywhere in a box, at inner nodes too; boxes up to a dozen nodes."""
    problem = zoo.torus_problem(nodes=24, steps=2)
    nowhere = sdhj.UnsafeSet((0,), lambda p, t: np.full(len(p), 1.0 + t))  # moves: each step has its own tubes
    everywhere = sdhj.TargetSet((0,), lambda p, t: np.full(len(p), -1.0))  # the true sets refute nothing
    dynamics = sdhj.Dynamics(problem.inputs, problem.inputs, np.eye(2), np.full(2, bounds))
    problem = replace(problem, dynamics=dynamics, target=everywhere, unsafe=(nowhere,))
    table = zoo.empty_table(problem, torus_avoid(rng))
    for step in range(3):
        for n in range(3 - step):
            lower = rng.normal(0.6 if bounds < 1 else -1.0, 1.0, problem.grid.shape)
            table.value_array(step, n)[:] = np.minimum(lower, table.value_array(step, max(n - 1, 0)) if n else np.inf)
            table.mark_array(step, n)[:] = rng.integers(0, 256, table.mark_array(step, n).shape) | 15
    read_only((table.index, table.tubes, table.marks))  # as solved ones are
    controller = Controller(table)
    seen, marked = set(), 0
    for step in range(3):
        states = random_states(problem, 40, rng)
        batch = controller.batch(states, step)
        for m, q in enumerate(states):
            to_go, safe, margins, best = twin(table, q, step)
            assert batch.steps_to_go[m] == (-1 if to_go is None else to_go)
            assert np.flatnonzero(batch.safe[m]).tolist() == safe
            assert batch.best[m] == (-1 if best is None else best)  # by the marks where no margin promises
            marked += best is not None and not safe
            if safe:
                np.testing.assert_allclose(batch.margins[m], margins, rtol=0, atol=1e-12)
                seen.add(len(safe) > 1)
    assert seen and marked


def test_inputs_that_lead_to_the_same_box_have_one_margin(rng: np.random.Generator) -> None:
    """In whatever order the inputs come, and however many share a box."""
    problem = zoo.torus_problem()
    picked = [3, 1, 3, 8, 3, 0, 8]
    moves = sdhj.Dynamics(problem.inputs[picked], problem.inputs[picked], np.eye(2), [0.4, 0.4])
    table, states = solved(replace(problem, dynamics=moves)), random_states(problem, 200, rng)
    batch = Controller(table).batch(states, 1)
    assert batch.safe.any()
    for q, n, margins in zip(states, batch.steps_to_go, batch.margins, strict=True):
        if n >= 0:
            to_go, safe, expected, _ = twin(table, q, 1)
            assert to_go == n and len(set(margins[[0, 2, 4]])) == len(set(margins[[3, 6]])) == 1 and safe
            np.testing.assert_allclose(margins, expected, rtol=0, atol=1e-12)


def torus_avoid(rng: np.random.Generator) -> AvoidTubes:
    static, moving = (rng.normal(-1.0, 1.0, shape).astype(np.float32) for shape in ((9, 24), (2, 9, 24, 24)))
    return AvoidTubes((1,), static, (0, 1), moving)


@pytest.mark.parametrize("shift", [0.0, 1e-12])
def test_safe_inputs_at_the_nodes_are_the_ones_the_table_marks(shift: float) -> None:
    """With the Hopf-Lax table the look-ahead is the very operator that marked the nodes: nothing may differ there.

    A state that rounding has put beside a node is still on it.
    """
    table = solved(zoo.torus_problem())
    controller = Controller(table)
    nodes = table.grid.points() + shift
    for step in range(table.steps):
        batch = controller.batch(nodes, step)
        for n in range(1, table.steps - step + 1):
            rows = batch.steps_to_go == n
            assert rows.any()
            marks = table.inputs(start=step, within=n).reshape(len(nodes), -1)[rows]
            np.testing.assert_array_equal(batch.safe[rows], marks)


def test_closed_form_on_an_interval() -> None:
    """Tube: |q| <= 1 + 0.4 n, the wall cuts it; from the left, only u = +1 makes progress at its edge."""
    controller = Controller(solved(zoo.interval_problem(steps=4)))
    for q, n in ((0.5, 0), (-1.05, 1), (-1.39, 1), (-1.41, 2), (-2.59, 4), (2.35, 4), (1.79, 2)):
        assert controller.steps_to_go([q], 0) == n
    assert controller.steps_to_go([-2.61], 0) is None
    assert controller.steps_to_go([-1.41], 3) is None  # one step left reaches to -1.4
    assert controller.safe_inputs([-1.39], 0).tolist() == [2]
    assert controller.safe_inputs([1.39], 0).tolist() == [0]
    # -1.05: u = 0 ends in [-1.15, -0.95], u = 1 in [-0.65, -0.45], u = -1 farther out
    assert controller.safe_inputs([-1.05], 0).tolist() == [2]
    # in the target: every input that certainly stays in it
    assert controller.safe_inputs([0.0], 0).tolist() == [0, 1, 2]
    assert controller.safe_inputs([0.7], 0).tolist() == [0, 1]


def test_boxes_that_differ_at_one_end_only_have_margins_of_their_own() -> None:
    """The faster the input, the more it slips: all boxes begin at q - 0.25 and end at q - 0.25, q + 0.25, q + 0.75."""
    problem = zoo.interval_problem(steps=2, unsafe=False)
    inputs = np.array([[-0.5], [0.0], [0.5]])
    slipping = sdhj.Dynamics(inputs, inputs, [[1.0]], lambda q, u: np.array([u[0] + 0.5]))
    table = solved(replace(problem, dynamics=slipping))
    for q, margins in ((0.0, [-0.75, -0.75, -0.25]), (0.3, [-0.95, -0.45, 0.05]), (-0.3, [-0.45, -0.45, -0.45])):
        batch = Controller(table).batch(np.array([[q]]), 0)
        np.testing.assert_allclose(batch.margins[0], margins, rtol=0, atol=1e-6)
        assert batch.safe[0].tolist() == [margin <= 0 for margin in margins]


@pytest.mark.parametrize("name", ["torus", "unicycle"])
def test_one_state_and_a_batch_over_several_threads_agree(
    tables: dict[str, LookupTable], name: str, rng: np.random.Generator
) -> None:
    controller = Controller(tables[name])
    states = random_states(controller.problem, 2 * CHUNK + 100, rng)
    batch = controller.batch(states, 1)
    chosen = controller.choose(batch)
    for m in (*range(100), CHUNK - 1, CHUNK, 2 * CHUNK, len(states) - 1):
        n = controller.steps_to_go(states[m], 1)
        assert batch.steps_to_go[m] == (-1 if n is None else n)
        if n is None:
            assert chosen[m] == -1 and not batch.safe[m].any()
        else:
            assert controller.safe_inputs(states[m], 1).tolist() == np.flatnonzero(batch.safe[m]).tolist()
            assert controller.select(states[m], 1) == chosen[m]
    assert (chosen >= 0).any() and (chosen < 0).any()


def test_a_state_is_the_same_a_turn_later(tables: dict[str, LookupTable], rng: np.random.Generator) -> None:
    controller = Controller(tables["arm"])
    turns = 2 * np.pi * np.array([1.0, -2.0, 0.0, 0.0])
    for q in admissible_states(tables["arm"], 20, rng):
        assert controller.steps_to_go(q, 0) == controller.steps_to_go(q + turns, 0)
        assert controller.select(q, 0) == controller.select(q + turns, 0)


def test_a_query_may_run_beside_a_solve(tables: dict[str, LookupTable], rng: np.random.Generator) -> None:
    controller = Controller(tables["arm"])
    states = admissible_states(tables["arm"], 50, rng)
    alone = [controller.select(q, 0) for q in states]
    problem = sdhj.arm_case_study(nodes=11, steps=3)
    worker = threading.Thread(target=lambda: sdhj.solve(problem, progress=False))
    worker.start()
    beside = 0
    while worker.is_alive():
        assert [controller.select(q, 0) for q in states] == alone
        with pytest.raises(sdhj.NotAdmissible):
            controller.select([0.0, 0.0, 0.3, 0.3], 3)
        beside += 1
        time.sleep(0.001)
    assert beside > 0


# ---- rules


def test_rules_take_the_best_of_the_safe_inputs(tables: dict[str, LookupTable], rng: np.random.Generator) -> None:
    table = tables["arm"]
    problem, step = table.problem, 1
    states = admissible_states(table, 40, rng)
    states = states[table.contains(states, start=step, within=table.steps)]
    end = problem.time(step + 1)
    chosen = {rule: Controller(table, rule).choose(Controller(table).batch(states, step)) for rule in RULES}
    for m, q in enumerate(states):
        safe = Controller(table).safe_inputs(q, step)
        margins = Controller(table).batch(q[None], step).margins[0]
        after = q + problem.delta * problem.dynamics.arrays[0][safe]
        scores = {
            "deepest": margins[safe],
            "effort": np.hypot(*problem.inputs[safe].T),
            "target": problem.target_value(after, end),
            "clearance": -problem.unsafe_value(after, end),
        }
        for rule in RULES:
            j = chosen[rule][m]
            if not safe.size:
                continue
            assert j in safe
            assert scores[rule][safe.tolist().index(j)] == scores[rule].min()
            assert Controller(table, rule).select(q, step) == j
    assert any((chosen["deepest"] != chosen[rule]).any() for rule in RULES if rule != "deepest")


def test_equals_go_to_the_deeper_one() -> None:
    """At q = 0.1 in the target both moves cost the same effort; the one towards the middle is deeper."""
    problem = zoo.interval_problem(steps=2, unsafe=False)
    moves = sdhj.Dynamics([[-1.0], [1.0]], [[-1.0], [1.0]], [[1.0]], [0.2])
    controller = Controller(solved(replace(problem, dynamics=moves)), "effort")
    assert controller.select([0.1], 0) == 0 and controller.select([-0.1], 0) == 1


def test_the_best_candidate_is_the_slow_twin_s(rng: np.random.Generator) -> None:
    """Scores and margins of few levels, so that many are equal; infinite ones too. What fails a look is passed over."""
    levels = 3
    safe, failing = rng.random((300, 9)) < 0.4, rng.random((300, 9)) < 0.3
    scores = rng.integers(0, levels, safe.sum()).astype(float)
    scores[scores == 0] = np.inf
    margins = rng.integers(-levels, levels, safe.shape).astype(float)
    best = np.array([(np.flatnonzero(row & ~bad).tolist() or [-1])[0] for row, bad in zip(safe, failing, strict=True)])
    safe[best < 0] = False
    to_go = np.where(safe.any(axis=1), 1, -1)
    ranked = np.full(safe.shape, np.nan)
    ranked[safe] = scores[: safe.sum()]
    apart, ends = 1.8 / failing.size, np.zeros((4, 9, 1, 1))  # no state comes by where another one does
    states = -0.9 + apart * 9 * np.arange(300.0)[:, None]
    ends[2, :, 0, 0] = apart * np.arange(9)

    def unsafe_along(points: Any, times: Any) -> Any:
        met = failing.ravel()[np.rint((points[:, CHECKED_INSTANTS - 1, 0] + 0.9) / apart).astype(int)]
        return np.where(met[:, None] & (np.arange(len(times)) == CHECKED_INSTANTS - 1), -1.0, 1.0)

    problem: Any = SimpleNamespace(
        inputs=np.zeros((9, 1)), grid=free_problem().grid, has_no_target=True, unsafe=(), unsafe_along=unsafe_along
    )
    table: Any = SimpleNamespace(problem=problem, tape_at=free_table().tape_at, normals=free_table().normals)

    def looked_at(batch: Any, scores: Any, looks: Any, rows: Any) -> Any:
        return choose_by_true_sets(table, batch, rows, ends, scores, looks)

    setattr(table, Table._fill_in_and_check.__name__, looked_at)
    chosen = Table.preferred(table, Batch(states, 0, 1, to_go, safe, margins, best), ranked)
    kept = safe & ~failing
    assert chosen.tolist() == naive_controller.best(kept.tolist(), ranked[kept].tolist(), margins.tolist())
    assert (chosen < 0).any() and np.isinf(scores).any() and (safe & failing).any()


def test_own_rule_sees_the_candidates_of_a_batch_and_decides() -> None:
    seen = []

    def last(candidates: Candidates) -> np.ndarray:
        seen.append(candidates)
        return -candidates.inputs

    controller = Controller(free_table(), last)
    assert controller.select([0.0], 1) == 2
    (one,) = seen
    assert one.step == 1 and one.problem is free_problem()
    assert one.steps_to_go.tolist() == [0, 0, 0] and one.states.tolist() == [[0.0]] * 3
    assert one.inputs.tolist() == [0, 1, 2] and one.rows.tolist() == [0, 0, 0]
    np.testing.assert_allclose(one.margins, [-0.4, -0.9, -0.4], atol=1e-12)  # |q| - 1 at 0.6, 0.1 and 0.6
    np.testing.assert_allclose(one.successors, [[-0.5], [0.0], [0.5]], atol=1e-15)
    batch = controller.batch(np.array([[0.0], [3.9], [0.7]]), 1)
    assert controller.choose(batch).tolist() == [2, -1, 1]
    assert seen[1].rows.tolist() == [0, 0, 0, 2, 2] and seen[1].inputs.tolist() == [0, 1, 2, 0, 1]
    assert seen[1].states[:, 0].tolist() == [0.0, 0.0, 0.0, 0.7, 0.7]
    assert len(seen) == 2  # the whole batch at once


def test_the_named_rules_are_functions_like_one_s_own(tables: dict[str, LookupTable], rng: np.random.Generator) -> None:
    """On a batch as well as one state at a time, also where the moves depend on the state."""
    table = tables["unicycle"]
    states = admissible_states(table, 60, rng)
    for rule, function in RULES.items():
        controller, own = Controller(table, rule), Controller(table, function)
        chosen = controller.choose(controller.batch(states, 0))
        assert chosen.tolist() == own.choose(own.batch(states, 0)).tolist()
        assert chosen.tolist() == [own.select(q, 0) for q in states]


# ---- guards


def ruled(answer: Any) -> Any:
    """Asks for an input by a rule of one's own, of a state with two candidates."""
    return lambda: Controller(free_table(), answer if callable(answer) else lambda candidates: answer).select([0.7], 0)


def undefined() -> Any:
    """Asks the rule that goes by the target, whose level set is NaN at the end of the step."""
    broken = replace(free_problem().target, level_set=lambda p, t: np.where(t == 0.5, np.nan, np.abs(p[:, 0]) - 1.0))
    problem = replace(free_problem(), delta=0.5)
    object.__setattr__(problem, "target", broken)
    return Controller(replace(free_table(), problem=problem), "target").select([0.0], 0)


def asked(name: str, *given: Any) -> Any:
    return lambda: getattr(Controller(free_table()), name)(*given)


SCORE = r"rule.*score.*\(2,\).*\("
REFUSED = [
    *((ruled(scores), SCORE) for scores in (2.0, np.array([[0.0, 1.0]]))),
    (
        ruled(lambda candidates: np.where(candidates.inputs == 1, np.nan, 0.0)),
        r"rule.*NaN.*input 1.*\[0\.7\]",
    ),
    (undefined, r"level set of 'target' is undefined or infinite \(nan\) at \["),
    (
        lambda: Controller(free_table(), "boldest"),
        "rule",
    ),
    *((lambda rule=rule: Controller(free_table(), rule), "rule") for rule in (None, np.zeros(3))),
    (lambda: Controller("table.npz"), r"sdhj\.solve returns"),
    *(
        (asked(name, [bad], 0), "NaN or an infinity")
        for name in ("steps_to_go", "safe_inputs", "select")
        for bad in (np.nan, -np.inf)
    ),
    (asked("batch", [[0.0], [np.nan]], 0), "NaN or an infinity"),
    *((asked("select", bad, 0), r"shape \(1,\)") for bad in (0.0, [0.0, 0.0])),
    *((asked("batch", bad, 0), r"shape \(M, 1\)") for bad in ([0.0], [[0.0, 0.0]])),
    *((asked("steps_to_go", [0.0], bad), "step") for bad in (-1, 4, 0.5, True)),
    (lambda: free_table().batch([[0.0]], 4), "step"),
]


@pytest.mark.parametrize(("ask", "said"), REFUSED)
def test_what_cannot_be_asked_is_refused(ask: Any, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        ask()


def test_not_admissible_names_state_step_and_remedy() -> None:
    controller = Controller(free_table())
    for ask in (controller.safe_inputs, controller.select):
        with pytest.raises(sdhj.NotAdmissible, match="within 2 steps"):
            ask([3.9], 1)
        with pytest.raises(sdhj.NotAdmissible, match=r"state \[4\.1\]"):
            ask([4.1], 1)
    unsafe_ends = solved(replace(free_problem(), grid=sdhj.Grid([-4.0], [4.0], [81])))
    with pytest.raises(sdhj.NotAdmissible, match=r"state \[5\.\]"):
        Controller(unsafe_ends).select([5.0], 1)
    assert issubclass(sdhj.NotAdmissible, ValueError)
    assert controller.steps_to_go([3.9], 1) is None and controller.steps_to_go([4.1], 1) is None
    assert controller.steps_to_go([1e300], 1) is None


def test_a_whole_number_may_be_a_float() -> None:
    controller = Controller(free_table())
    assert controller.fallback([3.9], 1.0) == controller.fallback([3.9], 1)  # type: ignore[arg-type]
    assert controller.filter([0.1], 1.0, [0.0]) == controller.filter([0.1], 1, [0.0])  # type: ignore[arg-type]


def test_the_last_step_has_no_inputs() -> None:
    controller = Controller(free_table())
    assert controller.steps_to_go([0.0], np.int64(3)) == 0
    assert controller.safe_inputs([0.0], 3).size == 0
    with pytest.raises(ValueError, match="step 3 is the"):
        controller.select([0.0], 3)
    for last in (3, 3.0, np.float64(3)):
        with pytest.raises(sdhj.NotAdmissible, match="step 3"):
            controller.select([1.1], last)


def test_rules_stay_with_the_safe_inputs_where_all_score_infinitely_badly() -> None:
    """Input 2 is the deepest, but hits something: it is not to be taken where no safe input ever reaches the target."""
    controller = Controller(free_table(), lambda candidates: np.full(len(candidates.rows), np.inf))
    batch = controller.batch(np.array([[0.7], [3.9]]), 0)
    batch.safe[0], batch.margins[0] = [True, True, False], [-0.1, -0.2, -0.5]
    assert controller.choose(batch).tolist() == [1, -1]


def test_no_state_is_a_batch_too(tables: dict[str, LookupTable]) -> None:
    """Also where moves depend on the state, so that there are none."""
    for rule in (*RULES, lambda candidates: candidates.margins):
        controller = sdhj.Controller(tables["unicycle"], rule)
        batch = controller.batch(np.empty((0, 3)), 0)
        assert batch.safe.shape == (0, 3) and controller.choose(batch).shape == (0,)


def test_a_batch_keeps_its_states() -> None:
    controller = Controller(free_table(), "target")
    states = np.array([[0.3], [-0.3]])
    batch = controller.batch(states, 1)
    states *= -1  # as a closed loop may do that moves its states in place
    assert controller.choose(batch).tolist() == [0, 2]


def test_on_six_axes_many_states_are_answered_as_each_alone(rng):
    """So many corners are looked at that a block of states is one of them, each with inputs that lead elsewhere."""
    problem = zoo.six(nodes=5, unsafe=[], steps=1)
    nothing = AvoidTubes((), np.full(3, -np.inf, np.float32), (), np.full((1, 3), -np.inf, np.float32))
    table = zoo.empty_table(problem, nothing)
    for step, within in ((0, 0), (1, 0), (0, 1)):
        noise = rng.normal(0.2, 1.0, problem.grid.shape) if within else np.inf
        table.value_array(step, within)[:] = np.minimum(Samples(problem).goal(step), noise)
        table.mark_array(step, within)[:] = rng.integers(0, 8, table.mark_array(step, within).shape)
    read_only((table.index, table.tubes, table.marks))
    states = rng.uniform(problem.grid.lower, problem.grid.upper, (60, 6))
    together, alone = table.batch(states, 0), [table.batch(one[None], 0) for one in states]
    assert (together.steps_to_go >= 0).sum() > 10
    for field in ("steps_to_go", "safe", "margins", "best"):
        np.testing.assert_array_equal(getattr(together, field), np.concatenate([getattr(one, field) for one in alone]))


@pytest.mark.parametrize("corner", [None, *product((-1.0, 1.0), repeat=2)])
def test_each_corner_of_what_the_last_input_leads_to_is_in_the_target(corner):
    """A hole between the nodes, which no tube knows of, about one corner of the box to which the only input leads."""
    ends, push = np.array([-0.7, 0.0]), 0.065
    hole = None if corner is None else ends + push * np.array(corner)

    def level_set(p, t):
        whole = np.abs(p).max(axis=1) - 1.0
        return whole if hole is None else np.maximum(whole, 0.02 - np.abs(p - hole).max(axis=1))

    problem = zoo.plane(
        [[1.0]], 2 * push, drift=[[1.0, 0.0]], target=sdhj.TargetSet((0, 1), level_set), delta=0.5, steps=1
    )
    controller = sdhj.Controller(sdhj.solve(problem, sdhj.HopfLax("linear"), play=False))
    state = ends - np.array([0.5, 0.0])
    assert controller.table.batch([state], 0).steps_to_go == 1
    assert controller.safe_inputs(state, 0).tolist() == ([0] if corner is None else [])


@pytest.mark.filterwarnings("ignore:.*so the table ignores it")
@pytest.mark.parametrize(
    ("place", "met"),
    [*((place, True) for place in range(1, CHECKED_INSTANTS + 1)), (1, False), (CHECKED_INSTANTS, False)],
)
def test_the_path_is_looked_at_where_and_when_the_robot_is_there(place, met):
    """What flies by between the nodes, for 40 ms, when the robot is there or has gone on, on a parabola."""
    instant, bend = 0.5 * place / CHECKED_INSTANTS, 4.0
    there, when = np.array([-1.23 + instant, 0.05 + bend * instant**2 / 2]), instant + (0.0 if met else 0.06)

    def flying(p, t):
        return np.maximum(np.abs(p - there).max(axis=1) - 0.015, np.abs(t - when) - 0.02)

    problem = zoo.plane(
        [[1.0]],
        drift=lambda q, u: np.stack([u[0] + 0.0 * q[:, 0], bend * (q[:, 0] + 1.23)], axis=1),
        **zoo.ALONE,
        target=sdhj.TargetSet((0, 1), lambda p, t: np.abs(p).max(axis=1) - 1.0),
        unsafe=[sdhj.UnsafeSet((0, 1), flying, name="what flies by")],
        delta=0.5,
        steps=1,
    )
    controller = sdhj.Controller(sdhj.solve(problem, sdhj.HJI(), play=False))
    assert controller.safe_inputs([-1.23, 0.05], 0).tolist() == ([] if met else [0])


@pytest.mark.filterwarnings("ignore:.*so the table ignores it")
@pytest.mark.parametrize("forbids", [None, 1])
def test_a_state_where_an_input_is_forbidden_is_not_lost(forbids):
    """Between the nodes, and left at once: under all inputs the state is lost, else none but that one is refused."""
    state = np.array([-1.23, 0.05])
    small = sdhj.UnsafeSet(
        (0, 1), lambda p, t: np.abs(p - state).max(axis=1) - 0.015, inputs=None if forbids is None else [forbids]
    )
    problem = zoo.plane(
        [[1.0, 0.0], [0.9, 0.0]],
        **zoo.ALONE,
        target=sdhj.TargetSet((0, 1), lambda p, t: np.abs(p).max(axis=1) - 1.0),
        unsafe=[small],
        delta=0.5,
        steps=1,
    )
    controller = sdhj.Controller(sdhj.solve(problem, sdhj.HopfLax("linear"), play=False))
    if forbids is None:
        assert controller.steps_to_go(state, 0) is None
    else:
        assert controller.safe_inputs(state, 0).tolist() == [1 - forbids] and controller.steps_to_go(state, 0) == 1
