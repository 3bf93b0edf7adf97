"""The robots of the tests: a test takes one and changes a field. Most have answers one can work out by hand."""

from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import judge
import naive_certified as naive
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


# ---- problems by name: any field may be changed, the grid's and the dynamics' own among them

OF_GRID = {"lower", "upper", "nodes", "periodic", "names", "ends"}
OF_DYNAMICS = {"inputs", "drift", "gain", "bounds", "velocity", "pieces"}
ALONE = {"gain": None, "bounds": None}  # without a disturbance


def made(changed, **usual):
    """The problem of what is usual but for what is changed; a grid or dynamics given whole take the place of parts."""
    given = usual | changed
    if "velocity" in changed:
        given |= {"drift": None, "gain": None}
    grid, dynamics = ({name: given.pop(name) for name in own & given.keys()} for own in (OF_GRID, OF_DYNAMICS))
    if "grid" not in given:
        nodes = grid.pop("nodes")
        given["grid"] = Grid(shape=[nodes] * len(grid["lower"]) if isinstance(nodes, int) else nodes, **grid)
    if "dynamics" not in given:
        given["dynamics"] = Dynamics(**dynamics)
    return ReachAvoidProblem(**given)


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


# ---- one axis


def line(levels=(-1.0, 0.0, 1.0), push=0.2, **changed):
    """On a line from -4 to 4 m, dx = u + v: to within 1 m of its middle."""
    inputs = np.reshape(levels, (-1, 1))
    return made(
        changed,
        **{"lower": [-4.0], "upper": [4.0], "nodes": 81},
        **{"inputs": inputs, "drift": inputs, "gain": [[1.0]], "bounds": [push]},
        target=goal(0.0, 1.0),
        unsafe=[],
        delta=0.5,
        steps=3,
    )


def run(**changed):
    """On a line of 10 m: it stands or moves 1 m in a step, pushed by 0.25 m; a post at 3 m, and a goal at 7 m."""
    usual = {"lower": [0.0], "upper": [10.0], "nodes": 41, "names": ["x"], "delta": 1.0, "steps": 1}
    return line((0.0, 1.0), 0.25, **usual | {"target": goal(7.0, 1.1), "unsafe": [post(3.0, 0.4)]} | changed)


def interval_problem(*, disturbance=0.2, rate=0.0, wall=3.0, unsafe=True, **changed):
    """The line, between walls, with something unsafe at x >= wall + rate t.

    With n steps to go the tube is [-1 - n (1 - disturbance) delta, ...] as long as the target is wider than what the
    disturbance spreads in a step (2 * 0.2 * 0.5 = 0.2 < 2), cut where the wall may be touched.
    """
    part = UnsafeSet((0,), lambda p, t: wall + rate * t - p[:, 0], name="wall")
    return line(push=disturbance, unsafe=(part,) if unsafe else (), **{"ends": "wall", "steps": 5} | changed)


def ring(*, rate=0.0, **changed):
    """32 nodes, 0.5 apart; u moves the state by 4 nodes and v by one; a target around 4, something unsafe around 10."""

    def around(centre):
        return lambda p, t: np.abs((p[:, 0] - centre - rate * t + 8) % 16 - 8)

    usual = {"lower": [0.0], "upper": [16.0], "nodes": 32, "periodic": [True], "delta": 1.0, "steps": 5}
    usual["target"] = TargetSet((0,), lambda p, t: around(4.0)(p, t) - 2.0)
    usual["unsafe"] = [UnsafeSet((0,), lambda p, t: around(10.0)(p, t) - 1.0, name="rock")]
    return line((-2.0, 0.0, 2.0), 0.5, **usual | changed)


# ---- two axes

STEPS = ((0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))


def plane(moves=STEPS, push=0.1, *, gain=((1.0, 0.0), (0.0, 1.0)), **changed):
    """In the plane, from -2 to 2 m, dq = u + v: to within 0.5 m of (1, 0)."""
    return made(
        changed,
        **{"lower": [-2.0, -2.0], "upper": [2.0, 2.0], "nodes": 41},
        **{"inputs": moves, "drift": moves, "gain": gain},
        bounds=np.broadcast_to(push, np.shape(gain)[1] if np.ndim(gain) == 2 else 2),
        target=goal(1.0, 0.0, 0.5),
        unsafe=[],
        delta=0.3,
        steps=3,
    )


def walk(**changed):
    """In a room of 4 x 3 m, at 0.5 m/s along the axes, to (3.4, 1.5): the robot of README's recipes."""
    usual = {"lower": [0.0, 0.0], "upper": [4.0, 3.0], "nodes": [81, 61], "delta": 0.25, "steps": 20}
    return plane(0.5 * np.array(STEPS), **usual | {"target": goal(3.4, 1.5, 0.4)} | changed)


def raft(levels=(-1.0, 0.0, 1.0), push=0.3, *, current=1.0, **changed):
    """Carried to the right at 1 m/s, it steers up or down, from -1 to 1 m: to stay clear of a disk at (0.5, 0)."""
    inputs = np.reshape(levels, (-1, 1))
    usual = {"lower": [-1.0, -1.0], "upper": [1.0, 1.0], "inputs": inputs}
    usual |= {"drift": np.hstack([np.full(inputs.shape, current), inputs]), "target": None, "delta": 0.4, "steps": 5}
    return plane(push=push, **usual | {"unsafe": [post(0.5, 0.0, 0.45, name="disk")]} | changed)


def torus_problem(**changed):
    """Two periodic axes, dq = u + v, a moving round target and a round obstacle on a circle path; 9 inputs."""
    levels = np.array([-2.0, 0.0, 2.0])
    moves = np.array([(a, b) for a in levels for b in levels])

    def obstacle(p, t):
        dx, dy = wrapped(p[:, 0] - np.cos(2 * t)), wrapped(p[:, 1] - np.sin(2 * t))
        return np.hypot(dx, dy) - 0.5

    usual = {"lower": [-np.pi] * 2, "upper": [np.pi] * 2, "nodes": 12, "periodic": [True] * 2, "delta": 0.2}
    usual["target"] = TargetSet((0, 1), lambda p, t: np.hypot(wrapped(p[:, 0] + 1 - 0.2 * t), wrapped(p[:, 1])) - 0.8)
    usual["unsafe"] = (UnsafeSet((0, 1), obstacle, name="orbiting disk"),)
    return plane(moves, 0.4, **usual | changed)


def between_posts(moves=STEPS, push=0.1, **changed):
    """On a torus from -1 to 1 m, dq = u + v, between two posts at (0, 0.3) and (0, -0.3): to (0.5, 0)."""

    def posts(p, t):
        return np.minimum(np.hypot(p[:, 0], p[:, 1] - 0.3), np.hypot(p[:, 0], p[:, 1] + 0.3)) - 0.15

    usual = {"lower": [-1.0] * 2, "upper": [1.0] * 2, "nodes": 61, "periodic": [True] * 2, "delta": 0.1, "steps": 10}
    usual |= {"target": goal(0.5, 0.0, 0.25), "unsafe": [UnsafeSet((0, 1), posts, name="posts")]}
    return plane(moves, push, **usual | changed)


def cart(pushes=(-3.0, 0.0, 3.0), gust=0.2, **changed):
    """On a rail from -1 to 1 m, dx = v, dv = u + w: to stay on it."""
    return made(
        changed,
        **{"lower": [-1.0, -2.0], "upper": [1.0, 2.0], "nodes": 41, "names": ["x", "v"]},
        inputs=np.reshape(pushes, (-1, 1)),
        drift=lambda q, u: np.stack([q[:, 1], np.full(len(q), u[0])], axis=1),
        gain=[[0.0], [1.0]],
        bounds=[gust],
        target=None,
        unsafe=[],
        delta=0.1,
        steps=None,
    )


def pursued_on_a_line(**changed):
    """A robot that is driven along one axis, and a pursuer that the adversary moves along another."""
    return made(
        changed,
        **{"lower": [-2.0, -1.0], "upper": [2.0, 1.0], "nodes": [41, 21], "names": ["robot", "pursuer"]},
        **{"inputs": [[-1.0], [1.0]], "drift": [[-1.0, 0.0], [1.0, 0.0]], "gain": [[0.0], [1.0]], "bounds": [0.2]},
        target=goal(0.0, 0.4),
        unsafe=[],
        delta=0.3,
        steps=4,
    )


# ---- three axes

INPUTS = tuple((speed, turn) for speed in (0.5, 1.0) for turn in (-2.0, 0.0, 2.0))


def car(inputs=INPUTS, bound=0.1, *, speed=1.0, **changed):
    """The README's car: what its velocity reads is its heading; `speed` counts on x alone."""

    def drift(q, u):
        return np.stack([speed * u[0] * np.cos(q[:, 2]), u[0] * np.sin(q[:, 2]), np.full(len(q), u[1])], axis=1)

    return made(
        changed,
        **{"lower": [-2.0, -2.0, -np.pi], "upper": [2.0, 2.0, np.pi], "nodes": [41, 41, 32]},
        **{"periodic": [False, False, True], "inputs": inputs, "drift": drift},
        **{"gain": [[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]], "bounds": [bound, bound]},
        target=goal(1.2, 0.8, 0.4),
        unsafe=[post(0.0, 0.0, 0.4)],
        delta=0.25,
        steps=4,
    )


def unicycle_problem(turns=(-2.0, 0.0, 2.0), **changed):
    """Dubins' car between walls, at 1 m/s: to within 0.5 m of the middle."""

    def drift(q, u):
        return np.stack([np.cos(q[:, 2]), np.sin(q[:, 2]), np.full(len(q), u[0])], axis=1)

    usual = {"lower": [-1.5, -1.5, -np.pi], "upper": [1.5, 1.5, np.pi], "nodes": (17, 17, 16), "ends": "wall"}
    usual |= {"names": ["x", "y", "theta"], "drift": drift, "delta": 0.2, "steps": 3}
    usual |= {"target": goal(0.0, 0.0, 0.5), "unsafe": (post(0.8, 0.0, 0.2, name="pillar"),)}
    return car(np.reshape(turns, (-1, 1)), **usual | changed)


def chase(*, rate=0.0, **changed):
    """x is driven, the adversary moves y and z; unsafe near (y, z) = (x, rate t), so all axes matter; to x near 1."""

    def ball(p, t):
        return np.sqrt((p[:, 0] - p[:, 1]) ** 2 + (p[:, 2] - rate * t) ** 2) - 0.6

    return made(
        changed,
        **{"lower": [-2.0, -1.5, -1.5], "upper": [2.0, 1.5, 1.5], "nodes": 15, "names": ["x", "y", "z"]},
        **{"inputs": [[-2.0], [0.0], [2.0]], "drift": [[-2.0, 0.0, 0.0], [0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]},
        **{"gain": np.eye(3), "bounds": [0.1, 0.3, 0.3]},
        target=goal(1.0, 0.5),
        unsafe=(UnsafeSet((0, 1, 2), ball, name="ball"),),
        delta=0.25,
        steps=3,
    )


# ---- four axes and more


def chain(**changed):
    """dx = y, dy = u + v, dz = x, dw = w: (x, y) is the least set that holds x and moves alone."""

    def drift(q, u):
        x, y, _, w = q.T
        return np.stack([y, np.full(len(q), u[0]), x, w], axis=1)

    return made(
        changed,
        **{"lower": [-1.0] * 4, "upper": [1.0] * 4, "nodes": (9, 8, 7, 6)},
        **{"inputs": [[-1.0], [1.0]], "drift": drift, "gain": np.eye(4)[:, 1:2], "bounds": [0.2]},
        target=goal(0.0, 0.4),
        unsafe=(UnsafeSet((0,), lambda p, t: 0.8 - p[:, 0], name="wall"),),
        delta=0.2,
        steps=2,
    )


def truck(**changed):
    """x, y, heading and speed, which inputs change: the velocities read two of the four axes, one of them turns."""

    def drift(q, u):
        heading, speed = q[:, 2], q[:, 3]
        return np.stack([speed * np.cos(heading), speed * np.sin(heading), speed * u[1], u[0] - 0.1 * speed**2], axis=1)

    return made(
        changed,
        **{"lower": [-2, -2, -np.pi, 0], "upper": [2, 2, np.pi, 1.5], "nodes": [17, 17, 16, 9], "ends": "wall"},
        **{"periodic": [False, False, True, False], "drift": drift, "gain": np.eye(4)[:, :2], "bounds": [0.05, 0.05]},
        inputs=[(pull, turn) for pull in (-1.0, 0.0, 1.0) for turn in (-1.0, 0.0, 1.0)],
        target=goal(0.0, 0.0, 0.6),
        unsafe=[],
        delta=0.3,
        steps=2,
    )


def chased(**changed):
    """Five axes: a car with its heading, and a pursuer that moves along two axes."""

    def drift(q, u):
        still = np.zeros(len(q))
        return np.stack([np.cos(q[:, 2]), np.sin(q[:, 2]), np.full(len(q), u[0]), still, still], axis=1)

    gain = np.zeros((5, 4))
    gain[[0, 1, 3, 4], range(4)] = 1.0
    apart = lambda p, t: np.hypot(p[:, 0] - p[:, 2], p[:, 1] - p[:, 3]) - 0.35  # noqa: E731
    return made(
        changed,
        **{"lower": [-1.5, -1.5, -np.pi, -1.0, -1.0], "upper": [1.5, 1.5, np.pi, 1.0, 1.0], "nodes": [7, 7, 8, 6, 6]},
        **{"periodic": [False, False, True, False, False], "names": ["x", "y", "theta", "px", "py"]},
        ends=["unsafe", ("unsafe", "wall"), "wall", "wall", "wall"],
        **{"inputs": [[-2.0], [0.0], [2.0]], "drift": drift, "gain": gain, "bounds": [0.1, 0.1, 0.2, 0.2]},
        target=goal(0.0, 0.0, 0.7),
        unsafe=[UnsafeSet((0, 1, 3, 4), apart, name="pursuer")],
        delta=0.2,
        steps=2,
    )


def six(**changed):
    """Six axes, two of them periodic: rates that follow inputs, and angles and places that follow rates."""

    def drift(q, u):
        still = np.zeros(len(q))
        return np.stack(
            [q[:, 3] * np.cos(q[:, 2]), q[:, 3] * np.sin(q[:, 2]), q[:, 4], still + u[0], still + u[1], still], 1
        )

    gain = np.zeros((6, 2))
    gain[[3, 5], range(2)] = 1.0
    apart = lambda p, t: np.abs(p[:, 0] - 0.4 * np.cos(p[:, 1])) - 0.2  # noqa: E731
    return made(
        changed,
        **{"lower": [-1, -1, -np.pi, -1, -2, -np.pi], "upper": [1, 1, np.pi, 1, 2, np.pi], "nodes": [6, 5, 6, 5, 5, 6]},
        periodic=np.arange(6) % 3 == 2,
        **{"inputs": [[-1.0, 2.0], [0.0, -2.0], [1.0, 0.0]], "drift": drift, "gain": gain, "bounds": [0.1, 0.2]},
        target=goal(0.0, 0.0, 0.6),
        unsafe=[UnsafeSet((0, 5), apart, name="gate")],
        delta=0.2,
        steps=2,
    )


# ---- with an error of the direction, which enters nonlinearly

PIECES, ERROR = 4, 0.6  # of what a compass may be off by, rad
COURSES = np.pi / 4 * np.arange(8)
WAYS = np.vstack([np.zeros((1, 2)), 0.8 * np.stack([np.cos(COURSES), np.sin(COURSES)], axis=1)])


def turned(q, u, v):
    """A command in a direction that is off by v."""
    return np.stack([u[0] * np.cos(v[0]) - u[1] * np.sin(v[0]), u[0] * np.sin(v[0]) + u[1] * np.cos(v[0])])


def misled(**changed):
    """Between the posts with a compass that is wrong: v enters nonlinearly, and moves both axes."""
    return between_posts(**{"inputs": WAYS, "velocity": turned, "bounds": [ERROR]} | changed)


def misled_car(**changed):
    """The unicycle between walls, whose wheels are askew by v."""

    def velocity(q, u, v):
        return np.stack([np.cos(q[:, 2] + v[0]), np.sin(q[:, 2] + v[0]), np.full(len(q), u[0])], axis=1)

    return unicycle_problem(**{"velocity": velocity, "bounds": [ERROR], "steps": 2} | changed)


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


# ---- random robots for the proofs, each function written once: the library and the judge call the same

ADVERSARIES = ("switching", "up", "down", "outward", "inward")


@dataclass(frozen=True)
class RandomRobot:
    """dx = drift(x, u, t) + gain(x, u, t) v; axes are periodic, or bounded with unsafe ends."""

    grid: Grid
    inputs: np.ndarray
    drift: object
    gain: object
    bound: np.ndarray
    target: object  # (states, t), as `unsafe`
    obstacles: tuple  # (axes, level_set, rate)
    delta: float
    steps: int

    def problem(self, **changed):
        everything = tuple(range(self.grid.ndim))
        unsafe = [
            UnsafeSet(axes, level_set, name=f"set {k}") for k, (axes, level_set, rate) in enumerate(self.obstacles)
        ]
        return made(
            changed,
            grid=self.grid,
            **{"inputs": self.inputs, "drift": self.drift, "gain": self.gain, "bounds": self.bound},
            target=TargetSet(everything, self.target),
            unsafe=unsafe,
            delta=self.delta,
            steps=self.steps,
        )

    def held(self, states):
        return naive.held_periodic(self.grid, states)

    def velocity(self, states, places, signs, t):
        states, out = self.held(states), np.empty_like(states)
        for j in np.unique(places):
            own, u = places == j, self.inputs[j]
            push = np.einsum("mid,md->mi", self.gain(states[own], u, t), self.bound * signs[own])
            out[own] = self.drift(states[own], u, t) + push
        return out

    def unsafe(self, states, t):
        """Also past an end, by more than rounding."""
        states, values = self.held(states), [np.full(len(states), np.inf)]
        values += [level_set(states[:, list(axes)], t) for axes, level_set, _ in self.obstacles]
        for axis in np.flatnonzero(~np.array(self.grid.periodic)):
            lower, upper = self.grid.lower[axis], self.grid.upper[axis]
            values.append(np.minimum(states[:, axis] - lower, upper - states[:, axis]) + 1e-9)
        return np.min(values, axis=0)

    def outcomes(self, table, adversary, rng, count):
        """Of runs from random certified states, by any of the inputs certified for them."""
        starts = naive.states_in(table, rng, count)
        middle = (np.array(self.grid.lower) + self.grid.upper) / 2

        def choose(states, step):
            left, places = naive.steps_to_go(table, states, step), np.full(len(states), -1)
            ahead = (left > 0) & (left < 99)
            if ahead.any():
                places[ahead] = naive.chosen_inputs(table, states[ahead], step, rng)
            return places

        def signs(states, inputs, t, end):
            shape = len(states), len(self.bound)
            if adversary == "switching":
                return rng.choice([-1.0, 1.0], shape)
            if adversary in ("up", "down"):
                return np.full(shape, 1.0 if adversary == "up" else -1.0)
            away = np.where(self.held(states) >= middle, 1.0, -1.0) * (1.0 if adversary == "outward" else -1.0)
            return np.sign(np.einsum("mid,mi->md", self.gain(self.held(states), self.inputs[0], t), away))

        target = lambda states, t: self.target(self.held(states), t)  # noqa: E731
        return judge.play(
            choose, self.velocity, signs, target, self.unsafe, starts, delta=self.delta, steps=table.steps
        )


def random_robot(seed):
    """Two or three axes, some periodic; drift and often gains depend on the state, some on time; a disk that moves."""
    rng = np.random.default_rng(seed)
    ndim = int(rng.integers(2, 4))
    periodic = [bool(rng.random() < 0.4) for _ in range(ndim)]
    lower, upper = ([(-np.pi if own else -2.0) for own in periodic], [(np.pi if own else 2.0) for own in periodic])
    grid = Grid(lower, upper, [21] * ndim, periodic)
    inputs = np.array([[0.0, 0.0], [1.0, 0.3], [-1.0, 0.3], [0.3, 1.0], [0.3, -1.0]]) * rng.uniform(0.8, 1.4)
    mix = rng.uniform(-1.0, 1.0, (2, ndim)) + np.eye(2, ndim)
    waves, phases = rng.uniform(0.0, 0.5, (ndim, ndim)) * (rng.random((ndim, ndim)) < 0.5), rng.uniform(-3, 3, ndim)
    often = np.array([1.0 if own else 1.3 for own in periodic])
    tide = rng.uniform(0.0, 0.3, ndim) * (rng.random() < 0.4)
    share = rng.uniform(0.0, 0.6) * (rng.random() < 0.6)
    bound = rng.uniform(0.02, 0.12, ndim)

    def drift(x, u, t):
        return u @ mix + np.sin(often * x + phases) @ waves.T + tide * np.sin(3.0 * t)

    def gain(x, u, t):
        return np.eye(ndim) * (1.0 + share * np.cos(often[0] * x[:, 0] + u[0]))[:, None, None]

    centre, radius = rng.uniform(-0.5, 0.5, ndim), rng.uniform(1.0, 1.3)
    place, speed, size = rng.uniform(-1.5, 1.5, 2), rng.uniform(-0.5, 0.5, 2), rng.uniform(0.25, 0.5)

    def apart(x, at, own):
        return np.stack([wrapped(x[:, k] - at[k]) if own[k] else x[:, k] - at[k] for k in range(len(at))], axis=1)

    def target(x, t):
        return np.linalg.norm(apart(x, centre, periodic), axis=1) - radius

    def disk(x, t):
        return np.hypot(*apart(x, [place[k] + speed[k] * t for k in (0, 1)], periodic).T) - size

    return RandomRobot(
        *(grid, inputs, drift, gain, bound, target, (((0, 1), disk, float(np.hypot(*speed))),)),
        delta=0.25,
        steps=int(rng.integers(2, 5)),
    )
