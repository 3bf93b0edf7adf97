"""The robots of the tests: a test takes one and changes a field. Most have answers one can work out by hand."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np

import sdhj
from sdhj import Dynamics, Grid, ReachAvoidProblem, TargetSet, UnsafeSet
from sdhj.common.remembering import read_only
from sdhj.solver.recursion import unshared_index
from sdhj.table.table import LookupTable


def empty_table(problem, avoid, dtype="float32"):
    """A table on the grid to be filled in by a test: tubes undefined, no input marked, with complete avoid tubes."""
    index = unshared_index(problem)
    number = int(index.max()) + 1
    marks = np.zeros((number, -(-len(problem.inputs) // 8), problem.grid.size), np.uint8)
    return LookupTable(problem, "by hand", index, np.empty((number, *problem.grid.shape), dtype), marks, avoid, {})


# ---- families: any field of the problem may be given


def near(*place):
    """Level-set function of what is within a radius of a place: `near(x, radius)`, `near(x, y, radius)`."""
    *at, radius = place
    if len(at) == 1:
        return lambda p, t: np.abs(p[:, 0] - at[0]) - radius
    return lambda p, t: np.hypot(p[:, 0] - at[0], p[:, 1] - at[1]) - radius


def goal(*place):
    return TargetSet(tuple(range(len(place) - 1)), near(*place))


def post(*place, name="post", **given):
    return UnsafeSet(tuple(range(len(place) - 1)), near(*place), name=name, **given)


def line(levels=(-1.0, 0.0, 1.0), push=0.2, **changed):
    """On a line from -4 to 4 m, dx = u + v: to within 1 m of its middle."""
    inputs = np.reshape(levels, (-1, 1))
    usual = {
        "grid": Grid([-4.0], [4.0], [81]),
        "dynamics": Dynamics(inputs, inputs, [[1.0]], [push]),
        "target": goal(0.0, 1.0),
        "unsafe": [],
        "delta": 0.5,
        "steps": 3,
    }
    return ReachAvoidProblem(**usual | changed)


STEPS = ((0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))


def plane(moves=STEPS, push=0.1, *, gain=((1.0, 0.0), (0.0, 1.0)), **changed):
    """In the plane, from -2 to 2 m, dq = u + v: to within 0.5 m of (1, 0)."""
    usual = {
        "grid": Grid([-2.0, -2.0], [2.0, 2.0], [41, 41]),
        "dynamics": Dynamics(moves, moves, gain, np.broadcast_to(push, np.shape(gain)[1])),
        "target": goal(1.0, 0.0, 0.5),
        "unsafe": [],
        "delta": 0.3,
        "steps": 3,
    }
    return ReachAvoidProblem(**usual | changed)


def cart(pushes=(-3.0, 0.0, 3.0), gust=0.2, **changed):
    """On a rail from -1 to 1 m, dx = v, dv = u + w: to stay on it."""
    usual = {
        "grid": Grid([-1.0, -2.0], [1.0, 2.0], [41, 41], names=["x", "v"]),
        "dynamics": Dynamics(
            np.reshape(pushes, (-1, 1)),
            lambda q, u: np.stack([q[:, 1], np.full(len(q), u[0])], axis=1),
            [[0.0], [1.0]],
            [gust],
        ),
        "target": None,
        "unsafe": [],
        "delta": 0.1,
        "steps": None,
    }
    return ReachAvoidProblem(**usual | changed)


INPUTS = tuple((speed, turn) for speed in (0.5, 1.0) for turn in (-2.0, 0.0, 2.0))


def car(inputs=INPUTS, bound=0.1, *, speed=1.0, **changed):
    """The README's car: what its velocity reads is its heading; `speed` counts on x alone."""

    def drift(q, u):
        return np.stack([speed * u[0] * np.cos(q[:, 2]), u[0] * np.sin(q[:, 2]), np.full(len(q), u[1])], axis=1)

    usual = {
        "grid": Grid([-2.0, -2.0, -np.pi], [2.0, 2.0, np.pi], [41, 41, 32], [False, False, True]),
        "dynamics": Dynamics(inputs, drift, [[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]], [bound, bound]),
        "target": goal(1.2, 0.8, 0.4),
        "unsafe": [post(0.0, 0.0, 0.4)],
        "delta": 0.25,
        "steps": 4,
    }
    return ReachAvoidProblem(**usual | changed)


def pursued_on_a_line(**changed):
    """A robot that is driven along one axis, and a pursuer that the adversary moves along another."""
    usual = {
        "grid": Grid([-2.0, -1.0], [2.0, 1.0], [41, 21], names=["robot", "pursuer"]),
        "dynamics": Dynamics([[-1.0], [1.0]], [[-1.0, 0.0], [1.0, 0.0]], [[0.0], [1.0]], [0.2]),
        "target": goal(0.0, 0.4),
        "unsafe": [],
        "delta": 0.3,
        "steps": 4,
    }
    return ReachAvoidProblem(**usual | changed)


def run(**changed):
    """On a line of 10 m: it stands or moves 1 m in a step, pushed by 0.25 m; a post at 3 m, and a goal at 7 m."""
    usual = {
        "grid": Grid([0.0], [10.0], [41], names=["x"]),
        "target": goal(7.0, 1.1),
        "unsafe": [post(3.0, 0.4)],
        "delta": 1.0,
        "steps": 1,
    }
    return line((0.0, 1.0), 0.25, **usual | changed)


def walk(**changed):
    """In a room of 4 x 3 m, at 0.5 m/s along the axes, to (3.4, 1.5): the robot of README's recipes."""
    usual = {
        "grid": Grid([0.0, 0.0], [4.0, 3.0], [81, 61]),
        "target": goal(3.4, 1.5, 0.4),
        "delta": 0.25,
        "steps": 20,
    }
    return plane(0.5 * np.array(STEPS), **usual | changed)


# ---- single robots


def interval_problem(
    *, nodes=81, steps=5, disturbance=0.2, view_time="swept", rate=0.0, wall=3.0, unsafe=True, ends="wall"
):
    """One axis, dq = u + v: u in {-1, 0, 1}, |v| <= disturbance, delta = 0.5; target |q| <= 1;
    unsafe q >= wall + rate t.

    With n steps to go the tube is [-1 - n (1 - disturbance) delta, ...] as long as the target is wider than what the
    disturbance spreads in a step (2 * 0.2 * 0.5 = 0.2 < 2), cut where the wall may be touched.
    """
    part = UnsafeSet((0,), lambda p, t: wall + rate * t - p[:, 0], name="wall")
    return line(
        push=disturbance,
        grid=Grid([-4.0], [4.0], [nodes], ends=ends),
        unsafe=(part,) if unsafe else (),
        steps=steps,
        view_time=view_time,
    )


def unicycle_problem(*, nodes=(17, 17, 16), steps=3):
    """Dubins car: dx = cos th + v1, dy = sin th + v2, dth = u: a drift that depends on the state, on three axes."""

    def drift(points, u):
        theta = points[:, 2]
        return np.stack([np.cos(theta), np.sin(theta), np.full(len(points), u[0])], axis=1)

    dynamics = Dynamics([[-2.0], [0.0], [2.0]], drift, np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]]), [0.1, 0.1])
    return ReachAvoidProblem(
        Grid([-1.5, -1.5, -np.pi], [1.5, 1.5, np.pi], nodes, [False, False, True], ["x", "y", "theta"], "wall"),
        dynamics,
        TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0], p[:, 1]) - 0.5),
        (UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 0.8, p[:, 1]) - 0.2, name="pillar"),),
        0.2,
        steps,
    )


def torus_problem(*, nodes=12, steps=3, view_time="swept"):
    """Two periodic axes, dq = u + v, a moving round target and a round obstacle on a circle path; 9 inputs."""
    levels = np.array([-2.0, 0.0, 2.0])
    inputs = np.array([(a, b) for a in levels for b in levels])

    def obstacle(p, t):
        dx, dy = wrapped(p[:, 0] - np.cos(2 * t)), wrapped(p[:, 1] - np.sin(2 * t))
        return np.hypot(dx, dy) - 0.5

    return ReachAvoidProblem(
        Grid([-np.pi, -np.pi], [np.pi, np.pi], [nodes, nodes], [True, True]),
        Dynamics(inputs, inputs, np.eye(2), [0.4, 0.4]),
        TargetSet((0, 1), lambda p, t: np.hypot(wrapped(p[:, 0] + 1 - 0.2 * t), wrapped(p[:, 1])) - 0.8),
        (UnsafeSet((0, 1), obstacle, name="orbiting disk"),),
        0.2,
        steps,
        view_time,
    )


PIECES, ERROR = 4, 0.6  # of what a compass may be off by, rad


def misled_problem(*, nodes=21, steps=3):
    """Two periodic axes, and a command that is played in a direction which is off by v: nonlinear, and in both axes."""
    courses = np.pi / 4 * np.arange(8)
    inputs = np.vstack([np.zeros((1, 2)), 0.8 * np.stack([np.cos(courses), np.sin(courses)], axis=1)])

    def velocity(q, u, v):
        return np.stack([u[0] * np.cos(v[0]) - u[1] * np.sin(v[0]), u[0] * np.sin(v[0]) + u[1] * np.cos(v[0])])

    return ReachAvoidProblem(
        Grid([-1.0, -1.0], [1.0, 1.0], [nodes, nodes], [True, True]),
        Dynamics(inputs, velocity=velocity, bounds=[ERROR], pieces=PIECES),
        TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 0.5, p[:, 1]) - 0.3),
        (UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0], p[:, 1] - 0.3) - 0.15, name="post"),),
        0.2,
        steps,
    )


def misled_car_problem(*, nodes=(17, 17, 16), steps=2):
    """The unicycle between walls, whose wheels are askew by v."""

    def velocity(q, u, v):
        return np.stack([np.cos(q[:, 2] + v[0]), np.sin(q[:, 2] + v[0]), np.full(len(q), u[0])], axis=1)

    problem = unicycle_problem(nodes=nodes, steps=steps)
    dynamics = Dynamics(problem.inputs, velocity=velocity, bounds=[ERROR], pieces=PIECES)
    return replace(problem, dynamics=dynamics)


def misled_velocities(q, u):
    """For each piece of what the compass may be off by, the box (low, high) of velocities of these two at a state."""

    def cosine(a, b):
        turns = [k for k in range(-4, 5) if a <= k * np.pi <= b]
        found = [np.cos(a), np.cos(b), *((-1.0) ** abs(k) for k in turns)]
        return np.array([min(found), max(found)])

    boxes, cuts = [], np.linspace(-ERROR, ERROR, PIECES + 1)
    for a, b in pairwise(cuts):
        if len(q) == 3:
            both = [cosine(q[2] + a, q[2] + b), cosine(q[2] + a - np.pi / 2, q[2] + b - np.pi / 2), [u[0], u[0]]]
        else:
            c, s = cosine(a, b), cosine(a - np.pi / 2, b - np.pi / 2)
            both = [np.sort(u[0] * c) + np.sort(-u[1] * s), np.sort(u[0] * s) + np.sort(u[1] * c)]
        boxes.append(([one[0] for one in both], [one[1] for one in both]))
    return boxes


def wrapped(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def one_row(table):
    """The table that has the tubes of step 0 at every step, each stored once: as if nothing depended on the time."""
    tubes, marks = (
        np.stack([array(0, within) for within in range(table.steps + 1)])
        for array in (table.value_array, table.mark_array)
    )
    index = [within for start in range(table.steps + 1) for within in range(table.steps - start + 1)]
    return replace(table, **read_only({"index": np.array(index), "tubes": tubes, "marks": marks}))


@cache
def interval_table():
    """Exact but for rounding, single precision's: tubes are piecewise linear with kinks at nodes."""
    return sdhj.solve(interval_problem(), sdhj.HopfLax("linear"), progress=False)


@cache
def torus_table():
    return sdhj.solve(torus_problem(nodes=32), sdhj.HopfLax(), progress=False)


@cache
def small_arm_table():
    return sdhj.solve(sdhj.arm_case_study(nodes=9, steps=3), method="lax", progress=False)


@cache
def small_arm_run():
    """The longest of some runs that reach the target."""
    table = small_arm_table()
    controller = sdhj.Controller(table)
    states = np.random.default_rng(1).uniform(table.grid.lower, table.grid.upper, (4000, 4))
    states = states[table.contains(states, start=0, within=3) & ~table.contains(states, start=0, within=1)]
    tried = [sdhj.simulate(controller, q, adversary="random", seed=0) for q in states[:30]]
    return max(tried, key=lambda r: (r.outcome == "reached", len(r.inputs)))


@cache
def small_torus_table():
    return sdhj.solve(torus_problem(nodes=10, steps=3))


@cache
def arm_table():
    return sdhj.solve(sdhj.arm_case_study(nodes=13, steps=4), progress=False)


def ends_of(velocities):
    """The least and the greatest velocities along each axis, each as one array."""
    ends = velocities.low, velocities.high
    whole = [[np.broadcast_to(one, velocities.shape) for one in end] for end in ends if isinstance(end, list)]
    return [np.stack(end) for end in whole] or list(ends)
