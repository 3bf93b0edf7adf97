"""Chapter 15, Your own robot: what it draws, its widgets, and the checks of its exercises."""

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import sdhj
from course.exercises import exercise, expect, expect_close
from course.widgets import Explorer, Numbers, angle, slider
from sdhj.plotting import draw_constraints, draw_path, draw_set, draw_tubes, plane
from sdhj.plotting.looks import INK, TARGET_LOOKS
from sdhj.table.batches import Table

# ---- pictures


def draw_plane_tubes(ax: Axes, table: Table, *, through: Sequence[float], within: int | None = None) -> None:
    """Tubes of a robot in the plane, with its target and its obstacles; the edge of the map is left out."""
    draw_tubes(ax, table, through=through, within=within, unsafe=False)
    shown = [part.name for part in table.problem.unsafe if part.name != "edge"]
    draw_constraints(ax, table.problem, through=through, parts=shown)
    where = plane(table.grid, through, resolution=201)
    target = table.problem.target
    goal = where.shaped(target.level_set(where.points[:, target.axes], 0.0))
    draw_set(ax, where, goal, TARGET_LOOKS | {"facecolor": "none"}, "target", zorder=5.0)
    ax.set_aspect("equal")


def draw_car(ax: Axes, table: Table, *, heading: float, within: int | None = None) -> Numbers:
    """The car's tubes for one heading, with the heading as an arrow; north is up."""
    within = table.steps if within is None else within
    state = (0.0, 0.0, heading)
    draw_plane_tubes(ax, table, within=within, through=state)
    tip = 0.18 * np.array([np.cos(heading), np.sin(heading)])
    corner, arrow = np.array([-0.75, 0.75]), {"arrowstyle": "-|>", "color": INK, "linewidth": 2}
    ax.annotate("", tuple(corner + tip), tuple(corner - tip), arrowprops=arrow)
    where = plane(table.grid, state, resolution=121)
    inside = where.of(table.grid, table.values(start=0, within=within)) <= 0
    return {"share of places for this heading": float(inside.mean())}


def draw_plane_run(ax: Axes, table: Table, run: Any) -> None:
    """A run in the plane over the tubes it starts in."""
    draw_plane_tubes(ax, table, through=run.states[0])
    draw_path(ax, table.grid, run.states, marks=run.samples)


# ---- widgets


def explore_car(table: Table) -> Explorer:
    """The car's tubes, heading by heading."""

    def draw(figure: Figure, heading: float, within: int) -> Numbers:
        return draw_car(figure.subplots(), table, heading=heading, within=within)

    controls = {
        "heading": angle("heading (rad)", 0.0),
        "within": slider("within, steps to go n", 0, table.steps, 1, table.steps),
    }
    return Explorer(draw, controls, size=(4.8, 3.9), alt="Tubes of the car for one heading", motion="heading")


# ---- checks


def reference_car(nodes=(25, 25, 24), inputs=((1.0, -2.0), (1.0, 0.0), (1.0, 2.0)), **changes):
    """The car of the chapter, with inputs (speed, rate of turn)."""

    def drift(q, u):
        return np.stack([u[0] * np.cos(q[:, 2]), u[0] * np.sin(q[:, 2]), np.full(len(q), u[1])], axis=1)

    parts = {
        "grid": sdhj.Grid([-1, -1, -np.pi], [1, 1, np.pi], nodes, [False, False, True], ["x", "y", "heading"]),
        "dynamics": sdhj.Dynamics(
            np.array(inputs), drift, gain=np.array([[1, 0], [0, 1], [0, 0]]), bounds=np.array([0.15, 0.15])
        ),
        "target": sdhj.TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 0.55, p[:, 1]) - 0.25),
        "unsafe": (sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0], p[:, 1]) - 0.18, name="obstacles"),),
        "delta": 0.25,
        "steps": 5,
    }
    return sdhj.ReachAvoidProblem(**parts | changes)


@exercise("15.1", "The place moves along the heading at `speed`; only the rate of turn is new.")
def check_drift(tricycle):
    """(s cos, s sin, s tan(phi) / 0.3)."""
    q = np.random.default_rng(0).uniform(-3, 3, (40, 3))
    for u in (np.array([1.0, 0.2]), np.array([-0.5, -0.4]), np.array([0.0, 0.3])):
        got = np.asarray(tricycle(q, u))
        expect(got.shape == (40, 3), "many states at once: (M, 3) in, (M, 3) out.")
        place = u[0] * np.stack([np.cos(q[:, 2]), np.sin(q[:, 2])], axis=1)
        expect_close(got[:, :2], place, "the place moves along the heading q[:, 2].")
        turn = np.full(40, u[0] * np.tan(u[1]) / 0.3)
        expect_close(got[:, 2], turn, "the heading: speed tan(phi) / 0.3; without speed a car does not turn.")


@cache
def _forward():
    return sdhj.solve(reference_car(), progress=False)


@exercise("15.2", "Let an input be a pair of speed and rate of turn, and let the drift read both.")
def check_reverse(reversing_car):
    """All three forward inputs kept, two or three backward ones at half the speed."""
    problem, known = reversing_car(), _forward().problem
    expect(isinstance(problem, sdhj.ReachAvoidProblem), "return a sdhj.ReachAvoidProblem.")
    expect(problem.grid.shape == known.grid.shape, "on (25, 25, 24) nodes.")
    expect(problem.grid.ends == known.grid.ends, "what the ends of the map are has changed: to leave it is to lose.")
    expect((problem.delta, problem.steps) == (known.delta, known.steps), "the same clock.")
    count = len(problem.inputs)
    expect(count in (5, 6), f"five or six inputs, not {count}.")
    q = np.random.default_rng(1).uniform(-0.9, 0.9, (20, 3))
    drifts = [problem.dynamics.drift_at(q, j, 0.0) for j in range(count)]
    for j in range(3):
        wanted = known.dynamics.drift_at(q, j, 0.0)
        expect(any(np.allclose(drift, wanted) for drift in drifts), "the three forward inputs must stay.")
    along = [np.sum(drift[:, :2] * np.stack([np.cos(q[:, 2]), np.sin(q[:, 2])], axis=1), axis=1) for drift in drifts]
    back = [j for j in range(count) if np.allclose(along[j], -0.5)]
    expect(len(back) == count - 3, "the others drive backwards at half the speed: -0.5 along the heading.")
    turns = sorted({round(float(drifts[j][0, 2]), 6) for j in back})
    expect(len(turns) == len(back), "straight or with a turn, each once.")
    said = "backwards it turns as forwards, by 2 rad/s, or on the same circle, by 1 rad/s."
    expect({abs(turn) for turn in turns} <= {0.0, 1.0, 2.0}, said)
    states = np.random.default_rng(2).uniform(-0.9, 0.9, (200, 3))
    expect_close(problem.target_value(states, 0.0), known.target_value(states, 0.0), "the target has changed.")
    expect_close(problem.unsafe_value(states, 0.0), known.unsafe_value(states, 0.0), "the unsafe sets have changed.")
    expect_close(problem.dynamics.bounds_at(0, 0.0), known.dynamics.bounds_at(0, 0.0), "the wind has changed.")
    table = sdhj.solve(problem, progress=False)
    before, now = (solved.values(start=0, within=5) <= 0 for solved in (_forward(), table))
    lost = table.grid.fraction(before & ~now)
    share = table.fraction(start=0, within=5)
    return (
        f"It wins {share:.0%} instead of {_forward().fraction(start=0, within=5):.0%}, and loses {lost:.1%}: as (14.3)."
    )


@exercise("15.3", "With the distance d the colleague's value is (d + r)^2 - r^2. Solve for d.")
def check_gradient(repaired):
    """sqrt(value + r^2) - r."""
    x = np.random.default_rng(0).uniform(-1, 1, (5000, 2))
    value = (x**2).sum(axis=1) - 0.18**2
    got, distance = np.asarray(repaired(value)), np.linalg.norm(x, axis=1) - 0.18
    expect(got.shape == value.shape, "one value for each.")
    expect((got <= 0) == (value <= 0), "the set has changed.")
    expect(np.isfinite(got), "not a number somewhere: what is the least that the colleague's value can be?")
    expect_close(got, distance, "the distance to the post: solve value = d^2 + 2 r d for d.", within=1e-9)


@exercise("15.4", "Differentiate s cos(theta), s sin(theta) and the input by x, y and theta.")
def check_bound(bounds):
    """|d f / d theta| <= 1 for x and y; nothing else depends on the state."""
    got = np.asarray(bounds, dtype=np.float64)
    expect(got.shape == (3, 3), "A[i, k] bounds the derivative of component i by coordinate k.")
    expect(got >= np.array([[0, 0, 1], [0, 0, 1], [0, 0, 0]]), "x and y change with the heading, by up to s = 1.")
    expect(got[:, :2] == 0, "nothing depends on the place.")
    expect(got[2] == 0, "the rate of turn is the input: it depends on no coordinate.")
    expect(got[:2, 2] == 1, "|sin| and |cos| are at most 1.")


def _boat():
    """The boat as the exercise describes it."""
    angles = np.arange(8) * np.pi / 4
    inputs = np.concatenate([[[0.0, 0.0]], np.stack([np.cos(angles), np.sin(angles)], axis=1)])

    def drift(q, u):
        return np.stack([u[0] - q[:, 1] / 2, u[1] + q[:, 0] / 2], axis=1)

    return sdhj.ReachAvoidProblem(
        grid=sdhj.Grid([-1, -1], [1, 1], [41, 41]),
        dynamics=sdhj.Dynamics(inputs, drift, gain=np.eye(2), bounds=np.array([0.14, 0.14])),
        target=sdhj.TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 0.6, p[:, 1]) - 0.25),
        unsafe=(
            sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0], p[:, 1] - 0.1) - 0.2, name="island"),
            sdhj.UnsafeSet((0, 1), lambda p, t: 0.95 - np.abs(p).max(axis=1), name="shore"),
        ),
        delta=0.3,
        steps=4,
    )


@exercise("15.5", "As the car, part by part: nine inputs, and a drift of the input and (-y / 2, x / 2).")
def check_boat(boat):
    """Its parts one after the other, then the share."""
    problem, share = boat()
    known = _boat()
    q = np.random.default_rng(3).uniform(-0.99, 0.99, (300, 2))
    expect(problem.grid.shape == (41, 41), "41 nodes on each axis.")
    expect_close([problem.grid.lower, problem.grid.upper], [[-1, -1], [1, 1]], "the lake is [-1, 1]^2.")
    expect(abs(problem.delta - 0.3) < 1e-12 and problem.steps == 4, "delta 0.3 s, four intervals.")
    expect((problem.target_value(q, 0.0) <= 0) == (known.target_value(q, 0.0) <= 0), "the target: 0.25 about (0.6, 0).")
    expect((problem.unsafe_value(q, 0.0) <= 0) == (known.unsafe_value(q, 0.0) <= 0), "the island, or the shore.")
    expect(len(problem.inputs) == 9, "eight headings, or nothing: nine inputs.")
    ours, theirs = (
        np.sort(np.stack([one.dynamics.drift_at(q, j, 0.0) for j in range(9)]), axis=0) for one in (known, problem)
    )
    expect_close(theirs, ours, "the water carries with (-y/2, x/2), the motor adds 1 m/s.", within=1e-9)
    push = np.abs(problem.dynamics.gain_at(q, 0, 0.0)) @ problem.dynamics.bounds_at(0, 0.0)
    expect_close(push, np.full((300, 2), 0.14), "the wind: 0.14 m/s on each axis.")
    wanted = sdhj.solve(problem, progress=False).fraction(start=0, within=4)
    expect_close(share, wanted, "the share: fraction(start=0, within=4) of its table.", within=2e-3)
    return f"Within no step it is {sdhj.solve(known, progress=False).fraction(start=0, within=0):.0%}."
