"""The boxes that the controller looks ahead with: tabulated ones hold the true ones and are hardly larger."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from typing import Any

import judge
import naive_controller
import numpy as np
import pytest
import toys

import sdhj
from sdhj import Controller, Dynamics, Grid, ReachAvoidProblem, TargetSet, UnsafeSet
from sdhj.kernels.lookup import Reach
from sdhj.problem.dynamics import Interval
from sdhj.table import batches
from sdhj.table.ahead import ROOM, WIDER, look_ahead

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
    return ReachAvoidProblem(
        others.pop("grid", Grid([-2, -2], [2, 2], [41, 41])),
        Dynamics(COURSES, drift or (lambda q, u: u + current(q)), gain, [0.1, 0.1]),
        TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 1.0, p[:, 1]) - 0.4),
        (UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0], p[:, 1] + 0.2) - 0.3, name="buoy"),),
        others.pop("delta", 0.25),
        others.pop("steps", 6),
    )


def truck() -> ReachAvoidProblem:
    """x, y, heading and speed, which inputs change: the velocities read two of the four axes, one of them turns."""
    inputs = np.array([[pull, turn] for pull in (-1.0, 0.0, 1.0) for turn in (-1.0, 0.0, 1.0)])

    def drift(q: np.ndarray, u: np.ndarray) -> np.ndarray:
        heading, speed = q[:, 2], q[:, 3]
        return np.stack([speed * np.cos(heading), speed * np.sin(heading), speed * u[1], u[0] - 0.1 * speed**2], axis=1)

    return ReachAvoidProblem(
        Grid([-2, -2, -np.pi, 0], [2, 2, np.pi, 1.5], [17, 17, 16, 9], [False, False, True, False], ends="wall"),
        Dynamics(inputs, drift, np.eye(4)[:, :2], [0.05, 0.05]),
        TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0], p[:, 1]) - 0.6),
        (),
        0.3,
        2,
    )


PROBLEMS: dict[str, Callable[[], ReachAvoidProblem]] = {
    "car": lambda: toys.unicycle_problem(nodes=(17, 17, 16)),
    "boat": boat,
    "tide": lambda: boat(lambda q, u, t: u + current(q, t)),
    "truck": truck,
    "kink": lambda: boat(lambda q, u: u * (1 - 0.4 * np.abs(q[:, 1:] - 0.33)), grid=Grid([-2, -2], [2, 2], [31, 41])),
    "seam": lambda: boat(lambda q, u: u * (q[:, :1] / np.pi) ** 2, np.eye(2), grid=TORUS),
    "slip": lambda: boat(gain=lambda q, u: (0.2 + np.cos(q[:, :1]))[:, :, None] * (np.eye(2) * (1 + u[0]))),
}


def states_of(problem: ReachAvoidProblem, count: int, rng: np.random.Generator) -> np.ndarray:
    """Anywhere, on nodes, on walls, and whole turns away."""
    grid = problem.grid
    states = rng.uniform(grid.lower, grid.upper, (count, grid.ndim))
    states[: count // 8] = grid.points()[rng.integers(0, grid.size, count // 8)]
    walls = np.where(rng.random(states.shape) < 0.5, grid.lower, grid.upper)
    states[count // 8 : count // 4] = np.where(rng.random(states.shape) < 0.4, walls, states)[count // 8 : count // 4]
    turns = np.where(grid.periodic, np.array(grid.upper) - grid.lower, 0.0) * rng.integers(-2, 3, states.shape)
    return states + np.where(rng.random((count, 1)) < 0.2, turns, 0.0)


def tabulated(tell: Any) -> bool:
    """Whether boxes come from a table, which is then among the arguments of what tells them."""
    return isinstance(tell, partial)


def recorded(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Interval, float, Any]]:
    """What tables ask `look_ahead` for from now on: the interval, the room, and what they got."""
    asked = []

    def look(interval: Interval, room: float = ROOM) -> Any:
        asked.append((interval, room, look_ahead(interval, room)))
        return asked[-1][2]

    monkeypatch.setattr(batches, "look_ahead", look)
    return asked


def as_worked_out(told: Reach, interval: Interval, states: np.ndarray) -> bool:
    return all(np.array_equal(*pair) for pair in zip(told[:2], interval.reachable(states), strict=True))


@pytest.mark.parametrize("name", PROBLEMS)
def test_boxes_from_a_table_hold_the_true_ones_and_exceed_them_by_little(name: str, rng: np.random.Generator) -> None:
    """By less than twice `WIDER` of a cell; almost everywhere by hardly more than once."""
    problem, excess = PROBLEMS[name](), []
    for step in range(problem.steps if problem.dynamics.timed else 1):
        interval = problem.interval(step)
        tell, states = look_ahead(interval), states_of(problem, 5000, rng)
        assert tabulated(tell)
        told, (low, high) = tell(states, np.arange(5000)), interval.reachable(states)
        slack = 1e-9 * np.array(problem.grid.spacing)
        assert (told.low <= low + slack).all() and (told.high >= high - slack).all()
        excess.append(np.maximum(low - told.low, told.high - high) / problem.grid.spacing)
        np.testing.assert_array_equal(told.lowest, told.low.min(axis=1))
        np.testing.assert_array_equal(told.highest, told.high.max(axis=1))
        nodes = np.ceil((told.highest - told.lowest) / problem.grid.spacing) + 1
        assert nodes.prod(axis=1).max() <= told.size
    assert np.max(excess) < 2 * WIDER and np.median(excess) < WIDER
    print(f"{name}: boxes exceed the true ones by {np.max(excess):.4f} of a cell at most")


def test_only_axes_that_velocities_read_are_tabulated() -> None:
    """As finely as their bends need: the speed more than the heading, because of the kinks next to its walls."""
    tell = look_ahead(truck().interval(0))
    table, axes, lattice, _ = tell.args  # type: ignore[attr-defined]
    assert axes.tolist() == [2, 3] and table.shape == (2, lattice[2][2] * lattice[2][3], 9, 4)
    finer = lattice[2][2] / 16, (lattice[2][3] - 1) / 8
    assert finer[1] > finer[0] > 1 and table.nbytes < 2 * 10**7
    coarse = look_ahead(boat(gain=np.eye(2), drift=lambda q, u: u - 0.3 * q).interval(0))  # nothing bends
    assert tabulated(coarse) and coarse.args[0].shape == (2, 41 * 41, 8, 2)  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", ["car", "boat", "truck"])
def test_the_table_is_interpolated_as_its_slow_twin_does(name: str, rng: np.random.Generator) -> None:
    problem = PROBLEMS[name]()
    tell, states = look_ahead(problem.interval(0)), states_of(problem, 40, rng)
    table, axes, lattice, _ = tell.args  # type: ignore[attr-defined]
    grid = dict(zip(("lower", "spacing", "shape", "periodic"), lattice, strict=False))
    boxes = np.moveaxis(table, 1, -1).reshape(2, *table.shape[2:], *lattice[2][axes])
    rows = rng.permutation(40)[:30]
    told = tell(states, rows)
    for r, m in enumerate(rows):
        for side, corner in enumerate((told.low, told.high)):
            for place in np.ndindex(corner.shape[1:]):
                expected = naive_controller.interpolated(boxes[side][place], states[m], axes.tolist(), grid)
                assert corner[r][place] == pytest.approx(expected, rel=0, abs=1e-12)


def test_velocities_that_read_nothing_share_one_box(monkeypatch: pytest.MonkeyPatch) -> None:
    """Arrays, and functions that take the points to no end; each step its own where they depend on time."""
    constant = toys.torus_problem()
    idle = replace(constant, dynamics=replace(constant.dynamics, drift=lambda q, u: np.tile(u, (len(q), 1))))
    for problem in (constant, idle):
        tell = look_ahead(problem.interval(0))
        told = tell(np.zeros((3, 2)), np.arange(3))
        assert told.low.shape == (1, 9, 2) and tell(np.ones((1, 2)), np.arange(1)) is told
        np.testing.assert_allclose(told.low[0], 0.2 * (problem.inputs - 0.4), rtol=0, atol=1e-15)
    tide = replace(constant, dynamics=replace(constant.dynamics, drift=lambda u, t: u * t))
    table, asked = sdhj.solve(tide, progress=False), recorded(monkeypatch)
    for step in (2, 0, 3, 1):
        table.batch(np.zeros((1, 2)), step)
    moved = [tell(np.zeros((1, 2)), np.arange(1)).high[0, 8, 0] for _, _, tell in asked]
    np.testing.assert_allclose(moved, [0.2 * (2.0 * (0.2 * k + 0.1) + 0.4) for k in (2, 0, 1)], rtol=0, atol=1e-12)


def jump(q: np.ndarray, u: np.ndarray) -> np.ndarray:
    return u * np.where(q[:, :1] > 0.123, 1.0, 0.5)


def rapids(q: np.ndarray, u: np.ndarray) -> np.ndarray:
    """A current narrower than a cell that no node of the grid or of a finer one meets, beside one that all meet."""
    return u + np.stack([0.3 * (np.abs(q[:, 1] - 0.0333) < 0.006), 0.1 * q[:, 0]], axis=1)


@pytest.mark.parametrize("drift", [jump, rapids])
def test_what_a_table_cannot_tell_is_worked_out(drift: Any, rng: np.random.Generator) -> None:
    interval, states = boat(drift, np.eye(2)).interval(0), rng.uniform(-2, 2, (500, 2))
    tell = look_ahead(interval)
    assert not tabulated(tell)
    assert as_worked_out(tell(states, np.arange(100, 200)), interval, states[100:200])


def test_without_room_for_a_table_boxes_are_worked_out(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, states = boat(), rng.uniform(-2, 2, (300, 2))
    tell = look_ahead(problem.interval(0), room=10_000)
    assert not tabulated(tell) and as_worked_out(tell(states, np.arange(300)), problem.interval(0), states)
    tide = sdhj.solve(boat(lambda q, u, t: u + current(q, t), steps=3), progress=False)
    asked = recorded(monkeypatch)
    tide.batch(states, 1)
    ((interval, room, tell),) = asked
    assert interval.begin == tide.problem.interval(1).begin and room == ROOM / 3
    assert tabulated(tell) and tell.args[0].nbytes <= room


def test_drifts_that_fail_between_the_nodes_are_asked_for_no_other_states(rng: np.random.Generator) -> None:
    """Nobody flies there: a table that cannot be made is no reason not to answer for other states."""

    def narrow(q: np.ndarray, u: np.ndarray) -> np.ndarray:
        return u / np.sqrt(np.abs(q[:, 1:] - 0.05) - 0.01)  # not a number between y = 0.04 and 0.06

    interval = boat(narrow, np.eye(2)).interval(0)
    tell, states = look_ahead(interval), rng.uniform([-2, -1.5], [2, -1], (50, 2))
    assert not tabulated(tell) and as_worked_out(tell(states, np.arange(50)), interval, states)


# ---- what the controller makes of them


@cache
def both(name: str) -> tuple[Controller, Controller]:
    """One with tables of boxes, one that works them out at each state."""
    table = sdhj.solve(PROBLEMS[name](), progress=False)
    exact = replace(table)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(batches, "ROOM", 0)
        asked = recorded(patch)
        for step in range(table.steps):  # what tells the boxes of a step is kept from the first question on
            exact.batch(table.grid.points()[:1], step)
    assert len(asked) == (table.steps if table.problem.dynamics.timed else 1)
    assert not any(tabulated(tell) for _, _, tell in asked)
    return Controller(table), Controller(exact)


@pytest.mark.parametrize("name", ["car", "boat", "tide"])
def test_answers_differ_where_margins_are_as_good_as_zero_only(name: str, rng: np.random.Generator) -> None:
    """A margin grows by what the tube rises over the widening: a slope of one a unit, by 2 * `WIDER` of a cell."""
    table, exact = both(name)
    most = 2 * WIDER * 2 * np.linalg.norm(table.problem.grid.spacing)  # twice the slope of a distance
    compared = other = 0
    for step in range(table.table.steps):
        states = states_of(table.problem, 4000, rng)
        one, two = table.batch(states, step), exact.batch(states, step)
        np.testing.assert_array_equal(one.steps_to_go, two.steps_to_go)
        rows = np.isfinite(two.margins) & np.isfinite(one.margins) & one.promised[:, None] & two.promised[:, None]
        assert (one.margins[rows] >= two.margins[rows] - 1e-9).all()
        assert (one.margins[rows] <= two.margins[rows] + most).all()
        assert not (one.promised & ~two.promised).any()  # no promise is given that was not
        clear = two.promised & ~((two.margins <= 0) & (two.margins > -most)).any(axis=1)
        np.testing.assert_array_equal(one.safe[clear], two.safe[clear])
        admissible = two.steps_to_go >= 0
        compared, other = compared + admissible.sum(), other + (one.safe != two.safe).any(axis=1)[admissible].sum()
    print(f"{name}: other safe inputs in {other} of {compared} states")
    assert compared > 1000 and other < 0.02 * compared


@pytest.mark.parametrize("name", ["car", "boat"])
def test_one_state_and_many_get_the_same_answer(name: str, rng: np.random.Generator) -> None:
    controller, _ = both(name)
    states = states_of(controller.problem, 200, rng)
    batch = controller.batch(states, 0)
    chosen = controller.choose(batch)
    for m in np.flatnonzero(batch.steps_to_go >= 0):
        assert controller.select(states[m], 0) == chosen[m]
        assert controller.safe_inputs(states[m], 0).tolist() == np.flatnonzero(batch.safe[m]).tolist()


def test_as_many_boats_arrive_as_with_true_boxes(rng: np.random.Generator) -> None:
    """Judged without the library, the wind at the corners of its box; both controllers meet the same wind."""
    problem, controllers = boat(), both("boat")
    states = rng.uniform(-2, 2, (20_000, 2))
    starts = states[controllers[0].table.contains(states, start=0, within=problem.steps)]
    lost = []
    for controller in controllers:
        wind = np.random.default_rng(5)
        outcomes = judge.play(
            lambda q, step, controller=controller: controller.choose(controller.batch(q, step)),
            lambda q, u, v, t: COURSES[u] + current(q) + np.einsum("mad,md->ma", gusts(q), 0.1 * v),
            lambda q, u, t, end, wind=wind: wind.choice([-1.0, 1.0], q.shape),
            lambda q, t: np.hypot(q[:, 0] - 1.0, q[:, 1]) - 0.4,
            lambda q, t: np.hypot(q[:, 0], q[:, 1] + 0.2) - 0.3,
            starts,
            delta=problem.delta,
            steps=problem.steps,
        )
        lost.append(np.mean(outcomes != "reached"))
    print(f"{len(starts)} boats, lost {lost[0]:.2%}, with true boxes {lost[1]:.2%}")
    assert len(starts) > 3000 and lost[0] < lost[1] + 3 * np.sqrt(2 * lost[1] / len(starts)) + 1e-3 < 0.03
