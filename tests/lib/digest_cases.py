"""Small problems that between them use all that a problem can say and every method: `record_digests` solves them.

Little but what `import sdhj` offers is used here, so the same file runs whatever the package looks like inside.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import zoo

import sdhj
from sdhj.solver.joint import Joint

FIVE = 0.5 * np.array(zoo.STEPS)  # m/s
EXACT = sdhj.Scheme(order=3, integrator="rk3", frame="fixed", dtype="float64")
ROUGH = sdhj.Scheme(flux="lax-friedrichs", order=1, integrator="euler", frame="fixed")


@dataclass(frozen=True)
class Case:
    """A problem and how it is solved.

    Attributes
    ----------
    problem : callable () -> ReachAvoidProblem
    method : str or method object
    stored : bool
        Whether it is solved into a folder.
    """

    problem: Callable[[], Any]
    method: Any = "hji"
    stored: bool = False


def arm(**given: Any) -> Callable[[], Any]:
    """The paper's arm on few nodes, with intervals so long that it matters how moving sets enter them."""
    return lambda: sdhj.arm_case_study(**{"nodes": (13, 12, 7, 7), "steps": 3, "delta": 0.15} | given)


def evader() -> Any:
    return sdhj.evader_case_study(nodes=(11, 10, 7, 7), steps=3, delta=0.2)


def plane(*unsafe: Any, grid: Any = None, **given: Any) -> Any:
    """The zoo's walk on a coarser grid, with a wind of its own."""
    usual: dict[str, Any] = {
        "grid": grid or sdhj.Grid([0, 0], [4, 3], [33, 25]),
        "dynamics": sdhj.Dynamics(FIVE, FIVE, np.eye(2), [0.1, 0.08]),
        "target": zoo.goal(3.3, 1.5, 0.45),
        "unsafe": unsafe,
        "delta": 0.5,
        "steps": 6,
    }
    return zoo.walk(**usual | given)


def across(middle: float = 3.3) -> Any:
    """A target that depends on the first axis alone, so that a projection that keeps it has something to reach."""
    return sdhj.TargetSet((0,), lambda p, t: np.abs(p[:, 0] - middle) - 0.45)


def mapped() -> Any:
    """Past a wall of a map, through its door, and a desk."""
    blocked = np.zeros((12, 16), bool)
    blocked[[0, -1]] = blocked[:, [0, -1]] = blocked[:, 8] = True
    blocked[4:9, 8] = False
    office = sdhj.UnsafeSet.from_map(blocked, resolution=0.25, origin=(0.0, 0.0, 0.02), radius=0.1, name="office")
    desk = sdhj.UnsafeSet.polygon([[0.4, 2.2], [1.0, 2.2], [1.2, 2.6]], radius=0.1, name="desk")
    return plane(office, desk)


def thin(sampling: str) -> Any:
    """Two fences of which only parts are felt at the nodes, sampled in one way each."""
    fence = sdhj.UnsafeSet((0,), lambda p, t: np.abs(p[:, 0] - 1.06) - 0.07, name="fence", sampling=sampling)
    post = sdhj.UnsafeSet((0, 1), zoo.near(2.3, 1.45, 0.3), name="post", sampling="steep")
    low = sdhj.UnsafeSet((1,), lambda p, t: p[:, 0] - 0.4 - 0.05 * np.sin(t), name="low", sampling=sampling)
    return plane(fence, post, low)


def moving(swept: bool, **given: Any) -> Any:
    """A disk that comes nearer and a target that moves, with the robot's own bound on it or with samples lowered."""

    def over(p: Any, t0: float, t1: float) -> Any:
        nearest = np.clip(p[:, 0], 2.6 - 0.3 * t1, 2.6 - 0.3 * t0)
        return np.hypot(p[:, 0] - nearest, p[:, 1] - 1.4) - 0.35

    ball = sdhj.UnsafeSet(
        (0, 1), lambda p, t: zoo.near(2.6 - 0.3 * t, 1.4, 0.35)(p, t), over if swept else None, name="ball"
    )
    post = sdhj.UnsafeSet((0, 1), zoo.near(1.0, 0.7, 0.25), name="post")
    target = sdhj.TargetSet((0, 1), lambda p, t: zoo.near(3.3 - 0.05 * t, 1.5, 0.45)(p, t))
    return plane(ball, post, target=target, **given)


def tide(*, turning: bool) -> Any:
    """Drift, gain and bounds that depend on time and input, and with `turning` on the state too."""

    def drift(q: Any, u: Any, t: float) -> Any:
        return u + 0.2 * np.stack([np.sin(q[:, 1] + t), np.cos(q[:, 0] - t)], axis=1)

    dynamics = sdhj.Dynamics(
        FIVE,
        drift if turning else lambda q, u, t: u + 0.2 * np.array([np.sin(t), np.cos(2 * t)]),
        (lambda q, t: np.eye(2) * (1 + 0.3 * np.cos(q[:, 0] + t))[:, None, None])
        if turning
        else lambda q, u: np.eye(2) * (1 + u[0]),
        lambda q, u, t: np.stack([0.08 + 0.02 * np.sin(t) ** 2, 0.06 + 0.05 * abs(u[1])]),
    )
    return plane(sdhj.UnsafeSet((0, 1), zoo.near(1.9, 1.4, 0.4), name="post"), dynamics=dynamics, steps=4)


def askew() -> Any:
    """Commands that are played in a direction which is off by v, the more so with time: margins are over hulls."""

    def velocity(q: Any, u: Any, v: Any) -> Any:
        return np.stack([u[0] * np.cos(v[0]) - u[1] * np.sin(v[0]), u[0] * np.sin(v[0]) + u[1] * np.cos(v[0])])

    dynamics = sdhj.Dynamics(FIVE, velocity=velocity, bounds=lambda t: np.stack([0.5 + 0.1 * np.sin(t)]), pieces=4)
    return plane(sdhj.UnsafeSet((0, 1), zoo.near(1.9, 1.4, 0.4), name="post"), dynamics=dynamics)


def turned() -> Any:
    """The adversary pushes along two directions that are no axes: no box, Lax-Friedrichs with modes."""
    dynamics = sdhj.Dynamics(FIVE, FIVE, [[0.1, 0.06], [-0.05, 0.1]], [1.0, 0.8])
    return plane(sdhj.UnsafeSet((0, 1), zoo.near(1.9, 1.4, 0.4), name="post"), dynamics=dynamics)


def cart(ends: Any = "unsafe", **given: Any) -> Any:
    """The zoo's, pushed at by an adversary that the brakes are stronger than."""
    grid = sdhj.Grid([-1, -2], [1, 2], [41, 41], ends=ends, names=["x", "v"])
    return zoo.cart(gust=0.5, **{"grid": grid, "steps": 5} | given)


def posts() -> list[Any]:
    """What the cart has to stay clear of: states that are a disk."""
    return [sdhj.UnsafeSet((0, 1), zoo.near(0.2, 0.5, 0.3), name="states")]


def robot() -> Any:
    """A random robot, everything of which depends on state, input and time, beside a disk that moves."""
    return zoo.random_robot(6).problem()


def chained(method: Any, **given: Any) -> Any:
    """First into the tube of a table, then on by its inputs."""
    first = sdhj.solve(zoo.interval_problem(steps=4, rate=-0.1, ends="unsafe", **given), method, progress=False)
    target = sdhj.TargetSet.from_table(first, within=2)
    return replace(zoo.interval_problem(steps=3, rate=-0.1, ends="unsafe", **given), target=target)


SENSING = sdhj.Sensing(error=(0.02, 0.01), delay=0.1, jitter=0.02, memory=False)
ARM_CELLS = sdhj.Certified(cells=(63, 63, 18, 18), parts=4)

CASES: dict[str, Case] = {
    # the paper's arm: how moving sets enter, kinematics, methods and their options
    "arm, swept": Case(arm()),
    "arm, sampled": Case(arm(view_time="sampled")),
    "arm, instantaneous": Case(arm(view_time="instantaneous")),
    "arm, swept, printed kinematics": Case(arm(kinematics="printed", nodes=(11, 12, 9, 8))),
    "arm, sampled, printed kinematics": Case(arm(kinematics="printed", view_time="sampled")),
    "arm, instantaneous, printed kinematics": Case(arm(kinematics="printed", view_time="instantaneous")),
    "arm, joint games": Case(arm(steps=2), Joint()),
    "arm, fixed frame": Case(arm(steps=2), sdhj.HJI(sdhj.Scheme(frame="fixed"))),
    "arm, first order": Case(arm(steps=2), sdhj.HJI(ROUGH)),
    "arm, third order": Case(arm(steps=2), sdhj.HJI(EXACT)),
    "arm, projected": Case(arm(), "projected"),
    "arm, projected, lax": Case(arm(), sdhj.Projected([(0, 1, 3), (0, 1, 2)], sdhj.HopfLax())),
    "arm, lax": Case(arm(), "lax"),
    "arm, lax, linear": Case(arm(view_time="sampled"), sdhj.HopfLax("linear", "float64")),
    "arm, certified": Case(arm(), ARM_CELLS),
    "arm, sensing": Case(lambda: replace(arm()(), sensing=sdhj.Sensing(0.005, 0.01, memory=False))),
    "arm, in a store": Case(arm(nodes=(20, 7, 7, 7), steps=2), stored=True),
    "evader": Case(evader),
    "evader, projected": Case(evader, "projected"),
    "evader, certified": Case(evader, ARM_CELLS),
    # one and two axes
    "line": Case(lambda: zoo.interval_problem(rate=0.1, ends=[("wall", "unsafe")])),
    "line, lax": Case(zoo.interval_problem, sdhj.HopfLax("linear", "float64")),
    "line, some time": Case(lambda: zoo.interval_problem(steps=None), sdhj.Certified(cells=(80,))),
    "line, from a table": Case(lambda: chained("lax"), "lax"),
    "line, certified from a certified table": Case(
        lambda: chained(sdhj.Certified(cells=(80,))), sdhj.Certified(cells=(80,))
    ),
    "torus": Case(zoo.torus_problem),
    "torus, joint games, third order": Case(zoo.torus_problem, Joint(EXACT)),
    "torus, in a store": Case(lambda: zoo.torus_problem(nodes=60, steps=2), stored=True),
    "torus, in a store, lax": Case(lambda: zoo.torus_problem(nodes=40), "lax", stored=True),
    "torus, certified": Case(zoo.torus_problem, sdhj.Certified(cells=(60, 60))),
    "plane, map and polygon": Case(mapped),
    "plane, map and polygon, lax": Case(mapped, "lax"),
    "plane, cells": Case(lambda: thin("cell")),
    "plane, nodes": Case(lambda: thin("nodes"), "lax"),
    "plane, moving, swept": Case(lambda: moving(True)),
    "plane, moving, lowered": Case(lambda: moving(False), "lax"),
    "plane, moving, instantaneous": Case(lambda: moving(False, view_time="instantaneous"), sdhj.HJI(EXACT)),
    "plane, time and state": Case(lambda: tide(turning=True)),
    "plane, time": Case(lambda: tide(turning=False), "lax"),
    "plane, time and state, certified": Case(lambda: tide(turning=True), sdhj.Certified(cells=(32, 24), parts=3)),
    "plane, moving, certified": Case(lambda: moving(True), sdhj.Certified(cells=(40, 30), parts=3)),
    "plane, turned adversary": Case(turned),
    "plane, turned adversary, certified": Case(turned, sdhj.Certified(cells=(80, 60), parts=3)),
    "plane, askew": Case(askew),
    "plane, forbidden inputs": Case(
        lambda: plane(sdhj.UnsafeSet((0, 1), zoo.near(2.3, 1.45, 0.5), name="zone", inputs=[1, 3]))
    ),
    "plane, projected": Case(lambda: plane(*thin("nodes").unsafe[:2], target=across(), steps=2), "projected"),
    "plane, safe ends, lax": Case(
        lambda: plane(
            *thin("nodes").unsafe, grid=sdhj.Grid([0, 0], [4, 3], [33, 25], ends=["safe", "wall"]), target=None
        ),
        "lax",
    ),
    "plane, map and polygon, certified": Case(mapped, sdhj.Certified(cells=(80, 60), parts=4)),
    "plane, sensing": Case(lambda: moving(True, sensing=replace(SENSING, jitter=0.0))),
    "plane, sensing, certified": Case(
        lambda: plane(*thin("nodes").unsafe[:1], sensing=SENSING), sdhj.Certified(cells=(80, 60), parts=4)
    ),
    "cart, for ever": Case(
        lambda: cart(grid=sdhj.Grid([-1, -2], [1, 2], [25, 21]), steps=None), sdhj.Certified(cells=(40, 40))
    ),
    "cart, safe ends": Case(lambda: cart([("safe", "unsafe"), ("wall", "unsafe")], unsafe=posts())),
    "cart, safe ends, joint games": Case(lambda: cart(["safe", "wall"], unsafe=posts()), Joint()),
    "cart, safe ends, certified": Case(
        lambda: cart([("safe", "unsafe"), ("wall", "unsafe")], unsafe=posts()), sdhj.Certified(cells=(40, 40), parts=4)
    ),
    "cart, to a target": Case(
        lambda: cart(["unsafe", "wall"], target=sdhj.TargetSet((0,), lambda p, t: np.abs(p[:, 0] - 0.5) - 0.2))
    ),
    # three axes and more
    "car": Case(zoo.unicycle_problem),
    "car, sensing": Case(
        lambda: replace(
            zoo.unicycle_problem(), sensing=sdhj.Sensing((0.02, 0.02, 0.03), 0.05, 0.01, rest=1, memory=False)
        )
    ),
    "car, third order": Case(lambda: zoo.unicycle_problem(steps=2), sdhj.HJI(EXACT)),
    "car, projected": Case(
        lambda: replace(zoo.unicycle_problem(), target=across(0.0)), sdhj.Projected([(0, 1), (0, 2)])
    ),
    "car, certified": Case(zoo.unicycle_problem, sdhj.Certified(cells=(30, 30, 38), parts=4)),
    "random robot, certified": Case(robot, sdhj.Certified(cells=(24, 24), parts=3)),
    "six axes": Case(zoo.six),
    "chased, five axes": Case(zoo.chased),
    "chased, five axes, projected": Case(zoo.chased, sdhj.Projected([(0, 1, 2, 3), (0, 1, 2, 4)])),
}
