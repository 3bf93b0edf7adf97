"""Tubes that are separate pieces: the gaps between them, and walls and ends beside them, against plain loops.

A step is longer than the target is wide. The plain recursion knows no level-set functions: states are points on a line,
1/4 mm apart, and a set is a row of bools.
"""

import re
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import zoo

import sdhj
from sdhj import HJI, Dynamics, Grid, ReachAvoidProblem, Scheme, TargetSet, UnsafeSet
from sdhj.common.findings import ResolutionWarning
from sdhj.problem.samples import Samples
from sdhj.solver.findings import gaps_advice
from sdhj.solver.games import HJIGames, nodes_past_ends
from sdhj.solver.joint import Joint

FIXED = HJI(Scheme(frame="fixed"))
LOWER, UPPER = -2.0, 2.0
U = (-1.0, 0.0, 1.0)
X = np.linspace(LOWER, UPPER, 16001)
H = X[1] - X[0]
DELTA = 0.25
Level = Callable[[Any], Any]


def line(
    nodes: int,
    inputs: Sequence[float] = U,
    push: float = 0.05,
    *,
    target: Level | None = lambda x: np.abs(x) - 0.1,
    unsafe: Level | None = None,
    steps: int = 7,
    ends: str = "unsafe",
    drift: Any = None,
    **given: Any,
) -> ReachAvoidProblem:
    """One axis, dx = u + v: by default the target is .2 wide, a step .25 long, and the disturbance pushes .0125."""
    moves = np.array(inputs)[:, None]
    return zoo.line(
        grid=Grid([LOWER], [UPPER], [nodes], ends=ends),
        dynamics=Dynamics(moves, moves if drift is None else drift, [[1.0]], [push]),
        target=None if target is None else TargetSet((0,), lambda p, t: target(p[:, 0])),
        unsafe=[] if unsafe is None else [UnsafeSet((0,), lambda p, t: unsafe(p[:, 0]))],
        delta=DELTA,
        steps=steps,
        **given,
    )


def exact(n: int) -> Any:
    """What is won within n steps: a piece for each number of steps to either side, each thinner than the one before."""
    return np.logical_or.reduce([np.abs(X - k / 4) < 0.1 - abs(k) / 80 for k in range(-n, n + 1)])


def plain(
    inputs: Sequence[float],
    push: float,
    target: Level | None = None,
    unsafe: Level | None = None,
    *,
    steps: int,
    ends: str,
) -> Any:
    """Theorem 2 for the states X: under an input those paths matter that the disturbance bends most."""
    bad = np.zeros(len(X), bool) if unsafe is None else unsafe(X) <= 0
    touched = np.concatenate([[0], np.cumsum(bad)])
    inside = ~bad if target is None else (target(X) <= 0) & ~bad

    def at(x: Any) -> Any:
        return np.clip(np.rint((np.clip(x, LOWER, UPPER) - LOWER) / H).astype(int), 0, len(X) - 1)

    for _ in range(steps):
        outside = np.concatenate([[0], np.cumsum(~inside)])
        now = np.zeros(len(X), bool) if target is None else inside.copy()
        for u in inputs:
            low, high = X + (u - push) * DELTA, X + (u + push) * DELTA
            first, last = at(np.minimum(X, low)), at(np.maximum(X, high))
            clear = touched[last + 1] == touched[first]
            if ends == "unsafe":
                clear &= (low >= LOWER - 1e-12) & (high <= UPPER + 1e-12)
            there = outside[at(high) + 1] == outside[at(low)]
            if ends == "safe":
                there |= (high < LOWER - 1e-12) | (low > UPPER + 1e-12)
            now |= clear & there
        inside = now & ~bad
    return inside


def wrong_and_missed(table: Any, truth: Any) -> tuple[float, float]:
    """Shares of the line that the table holds and the truth does not, and the other way round."""
    held = table.contains(X[:, None])
    return float(np.mean(held & ~truth)), float(np.mean(~held & truth))


# ---- gaps


def thin(nodes: int) -> ReachAvoidProblem:
    """A target 2 m wide, steps of 1.5 m and a push of .75: copies of .5 m, .25 m beside it."""
    return zoo.line((-3.0, 0.0, 3.0), 1.5, grid=Grid([-4.0], [4.0], [nodes], ends="wall"), steps=5)


def lattice(nodes: int, radius: float) -> ReachAvoidProblem:
    """A plane robot whose steps of 1/4 along both axes lead it past a disk; the disturbance pushes 1/80."""
    return zoo.plane(
        [[x, y] for x in U for y in U],
        0.05,
        grid=Grid([-1, -1], [1, 1], [nodes, nodes]),
        target=zoo.goal(0.0, 0.0, radius),
        delta=DELTA,
    )


def holes(table: Any, radius: float, fine: int = 640) -> tuple[float, float]:
    """Shares wrong and missed, by sets of points 1/320 apart, of which steps and pushes are multiples."""
    x = np.linspace(-1, 1, fine + 1)
    step, push, n = fine // 8, fine // 160, len(x)
    target = np.hypot(x[:, None], x) <= radius
    won = target
    for _ in range(table.steps):
        inner = np.pad(won, push)
        for axis in (0, 1):
            spread = np.lib.stride_tricks.sliding_window_view(inner, 2 * push + 1, axis=axis)
            inner = spread.all(axis=-1)
        around = np.pad(inner, step)
        won = target.copy()
        for i in (0, step, 2 * step):
            for k in (0, step, 2 * step):
                won |= around[i : i + n, k : k + n]
    held = table.contains(np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)).reshape(n, n)
    return float(np.mean(held & ~won)), float(np.mean(~held & won))


def test_the_plain_recursion_has_the_closed_form() -> None:
    found = plain(U, 0.05, lambda x: np.abs(x) - 0.1, steps=7, ends="unsafe")
    assert np.mean(found != exact(7)) < 15 * 4 * H / (UPPER - LOWER)  # two points at each end of fifteen pieces
    assert exact(7).mean() == pytest.approx(0.4, abs=1e-3)


@pytest.mark.parametrize(
    ("method", "nodes", "most"),
    [
        ("hji", 161, 0.015),
        ("hji", 321, 0.003),
        ("hji", 641, 0.001),
        (Joint(), 321, 0.003),
        ("lax", 321, 0.001),
    ],
    ids=str,
)
def test_gaps_stay_open(method: Any, nodes: int, most: float) -> None:
    wrong, missed = wrong_and_missed(sdhj.solve(line(nodes), method), exact(7))
    assert wrong < most and missed < 1e-3


@pytest.mark.parametrize(("method", "nodes"), [("hji", 81), ("hji", 161), (Joint(), 81), ("lax", 81)], ids=str)
def test_thin_gaps_stay_open_under_a_push_of_many_cells(method: Any, nodes: int) -> None:
    """Gaps of 2.5 cells and a push of 7.5: by differences alone .5125 of the axis would be held for .375."""
    assert sdhj.solve(thin(nodes), method).fraction() == pytest.approx(0.375, abs=0.02)
    assert sdhj.solve(thin(81), FIXED).fraction() > 0.8


@pytest.mark.slow
@pytest.mark.parametrize("radius", [0.145, 0.155, 0.165])
def test_holes_between_disks_stay_open(radius: float) -> None:
    """Nine copies of a disk that touch: what is left between them is filled from all sides."""
    table = sdhj.solve(lattice(161, radius))
    wrong, missed = holes(table, radius)
    assert wrong < 0.0075 and missed < 0.002
    fixed = sdhj.solve(lattice(161, radius), FIXED)
    assert holes(fixed, radius)[0] > 2 * wrong


AT_THE_END: dict[str, dict[str, Any]] = {
    "target at the wall": dict(target=lambda x: x + 1.9, ends="wall"),
    "narrow target at the wall": dict(push=0.2, target=lambda x: x + 1.96, ends="wall"),
    "unsafe end beside the target": dict(target=lambda x: np.abs(x + 1.85) - 0.1, ends="unsafe"),
    "unsafe end and obstacle": dict(
        target=lambda x: np.abs(x + 1.85) - 0.1, unsafe=lambda x: np.abs(x + 1.5) - 0.03, ends="unsafe"
    ),
    "obstacle at the wall": dict(target=lambda x: np.abs(x + 1.6) - 0.1, unsafe=lambda x: x + 1.95, ends="wall"),
    "safe ends": dict(push=0.3, unsafe=lambda x: np.abs(x) - 0.2, ends="safe", steps=8),
    "driven out of a safe end": dict(
        inputs=(0.4,), push=0.3, unsafe=lambda x: np.abs(x - 0.5) - 0.2, ends="safe", steps=12
    ),
    "clear between unsafe ends": dict(inputs=(-1.0, 1.0), unsafe=lambda x: np.abs(x) - 0.2, ends="unsafe", steps=8),
    # .02 thick: avoid games go by differences, which erode what is a cell or two thick
    "driven to a wall with an obstacle": dict(
        inputs=(-0.6, -1.0), push=0.3, unsafe=lambda x: np.abs(x + 1.93) - 0.01, ends="wall", steps=8
    ),
}


@pytest.mark.parametrize("case", AT_THE_END)
def test_ends_against_plain_loops(case: str) -> None:
    given = {"inputs": U, "push": 0.05, "steps": 7, "target": None} | AT_THE_END[case]
    truth = plain(**given)
    problem = line(321, **given)
    # sets that shrink from unsafe ends without a target are left to differences
    assert HJIGames(Samples(problem).padded, Scheme()).shifted == (case != "clear between unsafe ends")
    assert nodes_past_ends(Samples(problem), (0,)) > (0,)
    wrong, missed = wrong_and_missed(sdhj.solve(problem), truth)
    assert wrong < (0.012 if case == "driven to a wall with an obstacle" else 0.003) and missed < 0.003


def beside_a_wall(nodes: tuple[int, int], pushes: Any, inputs: Any = ((-1.0, 0.0),)) -> ReachAvoidProblem:
    """Driven to a wall while one disturbance moves both axes; the target is a strip aslant that ends at the wall."""

    def strip(p: Any, t: Any) -> Any:
        return np.maximum(np.maximum(p[:, 1] - p[:, 0] - 0.05, p[:, 0] - p[:, 1] - 0.6), p[:, 0] - 0.1)

    return zoo.plane(
        inputs,
        0.3,
        gain=pushes,
        grid=Grid([0, -2], [2, 2], nodes, ends=["wall", "unsafe"]),
        target=TargetSet((0, 1), strip),
        delta=DELTA,
        steps=2,
    )


@pytest.mark.parametrize(("nodes", "most"), [((81, 161), 107), ((161, 321), 66)])
def test_a_push_that_moves_two_axes_beside_a_wall(nodes: tuple[int, int], most: int, rng: Any) -> None:
    """Played in plain loops; `most` are lost to tables by differences alone, and 194 and 304 if the wall came first."""
    problem = beside_a_wall(nodes, [[1.0], [1.0]])
    assert HJIGames(Samples(problem), Scheme()).shifted
    table = sdhj.solve(problem)
    level, controller = problem.target.level_set, sdhj.Controller(table)
    starts = rng.uniform([0.0, -1.5], [0.6, 1.5], (100_000, 2))
    starts = starts[table.contains(starts) & (level(starts, 0.0) > 0)][:4000]
    assert len(starts) == 4000
    lost = np.zeros(4000, bool)
    for signs in ((1, 1), (-1, -1), (1, -1), (-1, 1)):
        states, done, dead = starts.copy(), np.zeros(4000, bool), np.zeros(4000, bool)
        for step in range(2):
            chosen = controller.choose(controller.batch(states, step))
            dead |= ~done & (chosen < 0)
            for part in range(40):
                moved = states + DELTA / 40 * (np.array([-1.0, 0.0]) + 0.3 * signs[part // 20])
                moved[:, 0] = np.clip(moved[:, 0], 0.0, 2.0)
                states = np.where((done | dead)[:, None], states, moved)
            done |= ~dead & (level(states, 0.0) <= 0)
        lost |= ~done
    assert lost.sum() < most * 0.6


def test_where_the_frame_does_not_move() -> None:
    """Where the disturbance takes the state off a wall again and moves another axis with it; not where it cannot."""

    def shifted(*given: Any) -> bool:
        return HJIGames(Samples(beside_a_wall((21, 21), *given)), Scheme()).shifted

    both, apart = [[1.0], [1.0]], [[1.0, 0.0], [0.0, 1.0]]
    assert shifted(both) and shifted(apart) and shifted(apart, ((0.1, 0.0), (-1.0, 0.0)))
    assert not shifted(both, ((-0.2, 0.0), (-1.0, 0.0)))
    assert not shifted(both, ((0.0, 0.0), (1.0, 0.0)))
    assert not shifted([[1.0, 0.5], [0.0, 0.7]], ((-0.4, 0.0),))  # the two together are stronger
    assert shifted([[0.3, 1.0], [0.0, 0.0]], ((0.1, 0.0),))  # both move the one axis only


# ---- what a solve says


def warned(problem: ReachAvoidProblem, method: Any = "hji") -> tuple[str, Any]:
    with pytest.warns() as caught:
        table = sdhj.solve(problem, method)
        warnings.warn("nothing", stacklevel=1)  # `pytest.warns` wants one
    said = [str(one.message) for one in caught if issubclass(one.category, ResolutionWarning)]
    return " ".join(said), table


@pytest.mark.slow
@pytest.mark.usefixtures("solves_are_played")
def test_gaps_that_the_grid_fills_are_said_and_the_advice_is_right() -> None:
    for method, nodes, enough in (("hji", 161, "513"), (FIXED, 321, "2,561")):
        said, table = warned(line(nodes), method)
        assert "separate pieces along x1" in said and f"What helps: {enough} nodes along x1" in said
        assert ("sdhj.HopfLax()" in said) == (method is FIXED)
        found = warned(line(int(enough.replace(",", ""))), method)
        assert found[0] == "" and wrong_and_missed(found[1], exact(7))[0] < 0.003
        assert wrong_and_missed(table, exact(7))[0] > 0.01
    assert "sdhj.HopfLax()" not in warned(line(161, drift=lambda q, u: u + 0.001 * q))[0]
    assert warned(replace(line(161), delta=0.125, steps=14))[0] == ""  # a shorter delta
    assert warned(line(161, inputs=(-1.0, -0.5, 0.0, 0.5, 1.0)))[0] == ""  # slower inputs beside


@pytest.mark.usefixtures("solves_are_played")
@pytest.mark.parametrize(
    ("method", "nodes", "enough"), [("hji", 41, 257), ("lax", 41, 257), (FIXED, 161, 513)], ids=str
)
def test_thin_gaps_are_said_and_the_advice_is_right(method: Any, nodes: int, enough: int) -> None:
    """Though the disturbance pushes many cells."""
    said, table = warned(thin(nodes), method)
    assert "the gaps are" in said and f"What helps: {enough} nodes along x1" in said and table.played(500).lost > 10
    said, table = warned(thin(enough), method)
    assert said == "" and table.played(1000).lost < 20


@pytest.mark.slow
@pytest.mark.usefixtures("solves_are_played")
def test_holes_are_said_and_the_advice_is_right() -> None:
    """Along both axes, and along x where copies touch along y as well."""
    found = gaps_advice(lattice(41, 0.12), shifted=True)
    numbers = re.search(r"What helps: ([\d,]+) nodes along x1 and ([\d,]+) nodes along x2", found)
    assert numbers
    most = max(int(one.replace(",", "")) for one in numbers.groups())
    assert warned(lattice(most, 0.12))[0] == ""
    aslant = replace(
        lattice(41, 0.12),
        target=TargetSet((0, 1), lambda p, t: np.maximum(np.abs(p[:, 0]) - 0.1, np.abs(p[:, 1]) - 0.2)),
    )
    said = gaps_advice(aslant, shifted=True)
    assert "separate pieces along x1," in said and "nodes along x1 and" in said and "nodes along x2" in said


@pytest.mark.slow
@pytest.mark.usefixtures("solves_are_played")
def test_advice_for_an_elbow_of_two_turns() -> None:
    """Two joints to a place of the tool: an island of the joint space touches its copies, aslant, at their corners."""

    def place(p: Any, t: Any) -> Any:
        x = np.cos(p[:, 0]) + np.cos(p[:, 0] + p[:, 1]) - 0.9
        return np.hypot(x, np.sin(p[:, 0]) + np.sin(p[:, 0] + p[:, 1]) - 1.1) - 0.15

    def elbow(*nodes: int) -> ReachAvoidProblem:
        moves = np.array([[x, y] for x in U for y in U])
        return zoo.plane(
            moves,
            0.05,
            lower=[-np.pi, -2 * np.pi],
            upper=[np.pi, 2 * np.pi],
            nodes=nodes,
            periodic=[True, False],
            names=["shoulder", "elbow"],
            target=TargetSet((0, 1), place),
            unsafe=[UnsafeSet((1,), lambda p, t: np.cos(p[:, 0]) - np.cos(np.pi - 0.35), name="folded")],
            delta=DELTA,
            steps=60,
        )

    assert "986 nodes along shoulder" in warned(elbow(144, 289))[0]
    said, table = warned(elbow(986, 1972))
    assert "separate pieces" not in said and table.played(2000).interval[0] < 0.02


@pytest.mark.usefixtures("solves_are_played")
def test_gaps_are_not_said_where_there_are_none() -> None:
    assert warned(line(81, target=lambda x: np.abs(x) - 0.2))[0] == ""
    assert warned(line(321))[0] == ""  # the disturbance pushes a cell


@pytest.mark.slow
def test_gaps_along_some_axes_of_a_robot_that_turns() -> None:
    def car(radius: float, inputs: Any) -> ReachAvoidProblem:
        grid = Grid([-2, -2, -np.pi], [2, 2, np.pi], [81, 81, 64], [False, False, True], ["x", "y", "heading"])
        return zoo.car(inputs, grid=grid, target=zoo.goal(1.2, 0.8, radius), unsafe=[], delta=0.5, steps=8)

    fast = [[speed, turn] for speed in (0.5, 1.0) for turn in (-2.0, 0.0, 2.0)]
    said = gaps_advice(car(0.12, fast), shifted=False)
    assert "x and y, because" in said
    numbers = re.search(r"What helps: ([\d,]+) nodes along x and ([\d,]+) nodes along y", said)
    assert numbers and min(int(one.replace(",", "")) for one in numbers.groups()) >= 641  # for a push of 8 cells
    assert gaps_advice(car(0.4, fast), shifted=False) == ""
    assert gaps_advice(car(0.12, [*fast, [0.1, 0.0]]), shifted=False) != ""  # .05 m, and then .25 m
    # two parts, of which one is thin enough
    parts = lambda x: np.minimum(np.abs(x) - 0.4, np.abs(x - 1.5) - 0.1)  # noqa: E731
    assert gaps_advice(line(161, target=parts), shifted=True) and not gaps_advice(
        line(161, inputs=(0.5, 1.0), target=parts), True
    )
    assert gaps_advice(line(161, target=None, unsafe=lambda x: x - 1.0), shifted=True) == ""
