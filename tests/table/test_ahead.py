"""The boxes that the controller looks ahead with, against a slow twin, and what the controller makes of them."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import judge
import numpy as np
import pytest
import zoo

import sdhj
from sdhj import BlackBox, Controller, Dynamics, Grid, ReachAvoidProblem
from sdhj.kernels.true_sets import TRUE_SETS_TOO
from sdhj.table.batches import Table
from sdhj.table.table import LookupTable

TORUS = Grid([-np.pi] * 2, [np.pi] * 2, [48, 48], [True] * 2)
COURSES = 0.6 * np.array([[np.cos(a), np.sin(a)] for a in np.pi / 4 * np.arange(8)])  # m/s, of a boat


def current(points: np.ndarray, t: float = 0.0) -> np.ndarray:
    """A jet along x between two banks of still water, m/s; it swells with time."""
    jet = (0.35 + 0.2 * np.sin(t)) / np.cosh(1.5 * points[:, 1]) ** 2
    return np.stack([jet, 0.1 * np.sin(points[:, 0])], axis=1)


def gusts(points: np.ndarray) -> np.ndarray:
    """What the wind does: more in the open than below the banks."""
    return (1 - 0.15 * points[:, 1] ** 2)[:, None, None] * np.array([[1.0, 0.2], [0.0, 1.0]])


def boat(drift: Any = None, gain: Any = gusts, **others: Any) -> ReachAvoidProblem:
    """Two axes, 8 courses in a current; a buoy to stay clear of."""
    usual: dict[str, Any] = {
        "dynamics": Dynamics(COURSES, drift or (lambda q, u: u + current(q)), gain, [0.1, 0.1]),
        "target": zoo.goal(1.0, 0.0, 0.4),
        "unsafe": (zoo.post(0.0, -0.2, 0.3, name="buoy"),),
        "delta": 0.25,
        "steps": 6,
    }
    return zoo.plane(**usual | others)


def jump(q: np.ndarray, u: np.ndarray) -> np.ndarray:
    return u * np.where(q[:, :1] > 0.123, 1.0, 0.5)


def rapids(q: np.ndarray, u: np.ndarray) -> np.ndarray:
    """A current narrower than a cell that no node of the grid or of a finer one meets, beside one that all meet."""
    return u + np.stack([0.3 * (np.abs(q[:, 1] - 0.0333) < 0.006), 0.1 * q[:, 0]], axis=1)


def kinked(q: np.ndarray, u: np.ndarray) -> np.ndarray:
    return u * (1 - 0.4 * np.abs(q[:, 1:] - 0.33))


def seam(q: np.ndarray, u: np.ndarray) -> np.ndarray:
    return u * (q[:, :1] / np.pi) ** 2


def slip(q: np.ndarray, u: np.ndarray) -> np.ndarray:
    return (0.2 + np.cos(q[:, :1]))[:, :, None] * (np.eye(2) * (1 + u[0]))


def tide(q: np.ndarray, u: np.ndarray, t: float) -> np.ndarray:
    return u + current(q, t)


PROBLEMS: dict[str, Callable[[], ReachAvoidProblem]] = {
    "car": lambda: zoo.unicycle_problem(nodes=(17, 17, 16)),
    "boat": boat,
    "tide": lambda: boat(tide),
    "truck": zoo.truck,
    "kink": lambda: boat(kinked, grid=Grid([-2, -2], [2, 2], [31, 41])),
    "seam": lambda: boat(seam, np.eye(2), grid=TORUS),
    "slip": lambda: boat(gain=slip),
    "jump": lambda: boat(jump),
    "rapids": lambda: boat(rapids),
    "black box": lambda: boat(BlackBox(lambda q, u, t: rapids(q, u), rate=0.0)),
    "walls": lambda: boat(grid=Grid([-2, -2], [2, 2], [41, 41], ends="wall")),
}
GAINS: dict[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {
    "car": lambda q, u: np.eye(3)[None, :, :2],
    "truck": lambda q, u: np.eye(4)[None, :, :2],
    "seam": lambda q, u: np.eye(2)[None],
    "slip": slip,
}


def car(q: np.ndarray, u: np.ndarray) -> np.ndarray:
    return np.array([[math.cos(q[0, 2]), math.sin(q[0, 2]), u[0]]])


def lorry(q: np.ndarray, u: np.ndarray) -> np.ndarray:
    speed = q[0, 3]
    return np.array(
        [[speed * math.cos(q[0, 2]), speed * math.sin(q[0, 2]), speed * u[1], u[0] - 0.1 * speed**2]],
    )


DRIFTS: dict[str, Any] = {"car": car, "truck": lorry, "kink": kinked, "seam": seam, "tide": tide, "jump": jump}
DRIFTS |= {"rapids": rapids, "black box": rapids}


def box_of(name: str, problem: ReachAvoidProblem, q: np.ndarray, j: int, begin: float) -> tuple[np.ndarray, np.ndarray]:
    """The twin: one state under one input, by the midpoint rule, the adversary's part as strong as anywhere at q."""
    grid, delta, u = problem.grid, problem.delta, problem.inputs[j]
    bounds = {"car": 0.1, "truck": 0.05}.get(name, 0.1)

    def wrapped(at: np.ndarray) -> np.ndarray:
        period = np.subtract(grid.upper, grid.lower)
        return np.where(grid.periodic, grid.lower + (at - grid.lower) % period, at)[None]

    def drift(at: np.ndarray, t: float) -> np.ndarray:
        function = DRIFTS.get(name, lambda q, u: u + current(q))
        return (function(wrapped(at), u, t) if name == "tide" else function(wrapped(at), u))[0]

    slope, walls = drift(q, begin), np.array([ends[0] == "wall" for ends in grid.ends])
    halfway = q + delta / 2 * slope
    halfway = np.where(walls & ~np.array(grid.periodic), np.clip(halfway, grid.lower, grid.upper), halfway)
    centre = delta * drift(halfway, begin + delta / 2)
    spread = delta * bounds * np.abs(GAINS.get(name, lambda q, u: gusts(q))(wrapped(q), u)[0]).sum(axis=1)
    return centre - spread, centre + spread


def states_of(problem: ReachAvoidProblem, count: int, rng: np.random.Generator) -> np.ndarray:
    """Anywhere, on nodes, on walls, and whole turns away."""
    grid = problem.grid
    states = rng.uniform(grid.lower, grid.upper, (count, grid.ndim))
    states[: count // 8] = grid.points()[rng.integers(0, grid.size, count // 8)]
    walls = np.where(rng.random(states.shape) < 0.5, grid.lower, grid.upper)
    states[count // 8 : count // 4] = np.where(rng.random(states.shape) < 0.4, walls, states)[count // 8 : count // 4]
    turns = np.where(grid.periodic, np.array(grid.upper) - grid.lower, 0.0) * rng.integers(-2, 3, states.shape)
    return states + np.where(rng.random((count, 1)) < 0.2, turns, 0.0)


@pytest.mark.parametrize("name", PROBLEMS)
@pytest.mark.slow
def test_boxes_are_those_of_the_slow_twin(name: str, rng: np.random.Generator) -> None:
    """Anywhere, on nodes, on walls and whole turns away; and of some rows alone."""
    problem = PROBLEMS[name]()
    for step in range(problem.steps if problem.dynamics.depends_on_time else 1):
        states, rows = states_of(problem, 200, rng), rng.permutation(200)[:60]
        (told_low, told_high), begin = problem.interval(step).reachable_boxes(states[rows]), problem.delta * step
        assert told_low.shape == told_high.shape == (60, len(problem.inputs), problem.grid.ndim)
        for r, m in enumerate(rows):
            for j in range(len(problem.inputs)):
                low, high = box_of(name, problem, states[m], j, begin)
                np.testing.assert_allclose(told_low[r, j], low, rtol=0, atol=1e-12)
                np.testing.assert_allclose(told_high[r, j], high, rtol=0, atol=1e-12)


def test_velocities_that_read_nothing_share_one_box() -> None:
    """Arrays, and functions that take the points to no end; each step its own where they depend on time."""
    constant = zoo.torus_problem()
    inputs, rest = constant.inputs, (np.eye(2), [0.4, 0.4])
    idle = replace(constant, dynamics=Dynamics(inputs, lambda q, u: np.tile(u, (len(q), 1)), *rest))
    for problem in (constant, idle):
        low, _ = problem.interval(0).reachable_boxes(np.zeros((3, 2)))
        assert low.shape == (1, 9, 2)
        np.testing.assert_allclose(low[0], 0.2 * (problem.inputs - 0.4), rtol=0, atol=1e-15)
    tide = replace(constant, dynamics=Dynamics(inputs, lambda q, u, t: u * t, *rest))
    moved = [tide.interval(step).reachable_boxes(np.zeros((1, 2)))[1][0, 8, 0] for step in range(3)]
    np.testing.assert_allclose(moved, [0.2 * (2.0 * (0.2 * k + 0.1) + 0.4) for k in range(3)], rtol=0, atol=1e-12)


def test_drifts_that_are_undefined_between_the_nodes_are_evaluated_for_no_other_states(
    rng: np.random.Generator,
) -> None:
    """Nobody flies there: a strip without an answer is no reason not to answer for other states."""

    def narrow(q: np.ndarray, u: np.ndarray) -> np.ndarray:
        return u / np.sqrt(np.abs(q[:, 1:] - 0.05) - 0.01)  # not a number between y = 0.04 and 0.06

    interval = boat(narrow, np.eye(2)).interval(0)
    low, high = interval.reachable_boxes(rng.uniform([-2, -1.5], [2, -1], (50, 2)))
    assert np.isfinite(low).all() and (low < high).all()
    with pytest.raises(ValueError, match=r"\(nan\) at \[0.0, 0.05\]"):
        interval.reachable_boxes(np.array([[0.0, 0.05]]))


# ---- what the controller makes of them


@cache
def controller_of(name: str) -> Controller:
    return Controller(sdhj.solve(PROBLEMS[name](), progress=False))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["car", "tide", "walls", "slip"])
def test_sets_that_are_played_are_looked_at_as_those_that_python_evaluates(
    name: str, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """For the filter's scores, too; at the last step, and one input at a time."""
    table = controller_of(name).table
    for step, within in ((0, 1), (0, table.steps), (table.steps - 1, 1), (table.steps, 1)):
        states = states_of(table.problem, 2000, rng)
        scores = rng.integers(0, 3, (2000, len(table.problem.inputs))).astype(float)
        for one in (scores, None):
            fast, slow = (table.answers(states, step, within, one) for _ in range(2))
            Table._fill_in_and_check(
                table, slow, slow.margins if one is None else one, TRUE_SETS_TOO, np.arange(2000)
            )  # into the same arrays
            for field in ("steps_to_go", "safe", "margins", "best"):
                np.testing.assert_array_equal(getattr(fast, field), getattr(slow, field))
        if step < table.steps:
            inputs, left = rng.integers(0, len(table.problem.inputs), 2000), rng.integers(0, 2, 2000)
            found = table.passes_true_sets(states, inputs, step, left)
            monkeypatch.setattr(LookupTable, Table._fill_in_and_check.__name__, Table._fill_in_and_check)
            np.testing.assert_array_equal(found, table.passes_true_sets(states, inputs, step, left))
            monkeypatch.undo()
            assert found.any() and not found.all()


@pytest.mark.slow
def test_boats_arrive(rng: np.random.Generator) -> None:
    """Judged without the library, the wind at the corners of its box."""
    problem, controller, wind = boat(), controller_of("boat"), np.random.default_rng(5)
    states = rng.uniform(-2, 2, (20_000, 2))
    starts = states[controller.table.contains(states, start=0, within=problem.steps)]
    outcomes = judge.play(
        lambda q, step: controller.choose(controller.batch(q, step)),
        lambda q, u, v, t: COURSES[u] + current(q) + np.einsum("mad,md->ma", gusts(q), 0.1 * v),
        lambda q, u, t, end: wind.choice([-1.0, 1.0], q.shape),
        lambda q, t: np.hypot(q[:, 0] - 1.0, q[:, 1]) - 0.4,
        lambda q, t: np.hypot(q[:, 0], q[:, 1] + 0.2) - 0.3,
        starts,
        delta=problem.delta,
        steps=problem.steps,
    )
    lost = np.mean(outcomes != "reached")
    print(f"{len(starts)} boats, lost {lost:.2%}")
    assert len(starts) > 3000 and lost < 0.03
