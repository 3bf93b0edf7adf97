"""Small robots with certified tables, and forgeries of their files: what the checker must refuse, with which words.

Of each forgery something is false, or not what the file of such a table may say. Nothing here looks into the checker.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import zoo
from forging import describe

import sdhj
from sdhj.common.remembering import FloatArray

Told = dict[str, Any]
CLEAR, MOVES, GOAL, NEARER = "clear of the unsafe", "moves: ", "target, and safe", "one step nearer"
ARRIVE = "into the target itself"
COVER, GROW, NEAR = "cells cover the axes", "sets grow", "predictions are as near"


# ---- robots


def line(*, push=0.2, posts=(-3.0, 3.0), wide=0.05, target=0.0, ends="unsafe", upper=4.0, **given):
    """On a line, dx = u + v, past two posts of 0.1 m."""
    usual = {
        "grid": sdhj.Grid([-4.0], [upper], [81], ends=ends),
        "target": zoo.goal(target, 1.0),
        "unsafe": [zoo.post(at, wide, name=f"post {at:g}") for at in posts],
    }
    return zoo.line(push=push, **usual | given)


def eight():
    """The line, with as many inputs as a byte has bits."""
    speeds = np.linspace(-1.0, 1.0, 8)[:, None]
    return line(dynamics=sdhj.Dynamics(speeds, lambda q, u: u + 0.0 * q, [[1.0]], [0.2]))


def two_in_one():
    """The line, whose posts are one set."""
    posts = sdhj.UnsafeSet(
        (0,), lambda p, t: np.minimum(np.abs(p[:, 0] + 3.0) - 0.05, np.abs(p[:, 0] - 3.0) - 0.05), name="posts"
    )
    return line(unsafe=[posts])


def forbidden():
    """A line on which two inputs are each forbidden somewhere, one of them in the target."""
    level = [lambda p, t, at=at: np.abs(p[:, 0] - at) - 0.3 for at in (-2.0, 0.0)]
    return line(unsafe=[sdhj.UnsafeSet((0,), one, inputs=[j]) for one, j in zip(level, (2, 0), strict=True)])


def crossed(*, speed=1.0, begin=2.9, **given):
    """A line that a post comes along, as fast as the robot."""
    post = sdhj.UnsafeSet((0,), lambda p, t: np.abs(p[:, 0] - begin + speed * t) - 0.05, name="post")
    return line(unsafe=[post], **given)


def sensed(*, error=0.1, delay=0.1, jitter=0.05, push=0.0, begin=2.0, memory=False, **given):
    return crossed(sensing=sdhj.Sensing(error, delay, jitter, memory=memory), push=push, begin=begin, **given)


def calming():
    """dx = u - 3 x + v: an interval leads all that a measurement may stand for to less than twice its error."""
    levels = [[-1.0], [0.0], [1.0]]
    dynamics = sdhj.Dynamics(levels, lambda q, u: u - 3.0 * q, [[1.0]], [0.05])
    return replace(line(), dynamics=dynamics, sensing=sdhj.Sensing(0.1, memory=True))


def ring(*, low=-3.0, high=3.0, push=0.2):
    """On a circle, where two sets written for plain numbers end at the seam; the last cell is a narrower one."""
    sets = [
        sdhj.UnsafeSet((0,), lambda p, t: p[:, 0] - low, name="behind the seam"),
        sdhj.UnsafeSet((0,), lambda p, t: high - p[:, 0], name="before the seam"),
    ]
    return zoo.line(push=push, grid=sdhj.Grid([-np.pi], [np.pi], [60], [True]), unsafe=sets, delta=0.25)


def turning():
    """Along a line by a heading, so that bounds on what is at the seam are made of two halves under each input."""

    def drift(q, u):
        return np.stack([u[0] * np.cos(q[:, 1]), np.full(len(q), 0.4 * u[0])], axis=1)

    return sdhj.ReachAvoidProblem(
        sdhj.Grid([-1.0, -np.pi], [1.0, np.pi], [21, 24], [False, True]),
        sdhj.Dynamics([[u] for u in (-1.0, -0.6, -0.2, 0.2, 0.6, 1.0)], drift, [[1.0], [0.0]], [0.1]),
        sdhj.TargetSet((0,), lambda p, t: np.abs(p[:, 0]) - 0.5),
        [],
        0.2,
        2,
    )


def circle():
    """On a circle of a whole number of cells, of which the first is all that lies in the target, across the seam."""
    target = sdhj.TargetSet((0,), lambda p, t: np.minimum(np.abs(p[:, 0] - 0.02), np.abs(p[:, 0] - 6.02)) - 0.04)
    post = sdhj.UnsafeSet((0,), lambda p, t: np.abs(p[:, 0] - 3.0) - 0.1, name="post")
    return replace(ring(), grid=sdhj.Grid([0.0], [6.0], [60], [True]), target=target, unsafe=[post])


def past_the_seam():
    """The same, and a little behind the seam a post."""
    post = sdhj.UnsafeSet((0,), lambda p, t: np.abs(p[:, 0] + 3.05) - 0.03, name="post")
    return replace(ring(), unsafe=[post])


def cart(*, ends="unsafe", push=0.2, bent=0.0, delta=0.2, steps=3, brakes=3.0):
    """A cart on a rail that has to stay on it: dx = v, dv = u + w; bent: the place counts, too, a little."""

    def drift(q, u):
        return np.stack([q[:, 1] + bent * np.sin(q[:, 0]), np.full(len(q), u[0])], axis=1)

    return sdhj.ReachAvoidProblem(
        sdhj.Grid([-1.0, -1.0], [1.0, 1.0], [21, 21], ends=[ends, "unsafe"]),
        sdhj.Dynamics([[-brakes], [0.0], [brakes]], drift, [[0.0], [1.0]], [push]),
        None,
        [],
        delta,
        steps,
    )


def standing(*, ends=("wall", "wall"), periodic=False, steps=20, most=1.0):
    """The cart that cannot go back, nor faster than 1 m/s, and stands still where it brakes."""
    grid = sdhj.Grid([-1.0, 0.0], [1.0, most], [21, 21], [False, periodic], ends=["unsafe", ends])
    return replace(cart(brakes=3.0 * most), grid=grid, steps=steps)


def noisy(*, memory=True):
    """The cart that stands still where it brakes, measured with errors, and its controller remembers.

    From the lowest cell of full width it brakes to half a shell above the wall, too far to be held there.
    """
    grid = sdhj.Grid([-1.0, 0.0], [1.0, 1.0], [21, 21], ends=["unsafe", "wall"])
    sensing = sdhj.Sensing((0.02, 0.05 + 5e-11), memory=memory)
    return replace(cart(brakes=0.95), grid=grid, steps=20, sensing=sensing)


def rail():
    """The cart of the recipes, for ever: where its speed is from 0 inwards it leaves no end of the rail."""
    speeds = sdhj.Grid([-1.0, -4.0], [1.0, 4.0], [81, 81])
    return replace(cart(push=0.3, delta=0.1, steps=None), grid=speeds)


def growing(*, rate=24.0, delta=1.0, most=20.0, upper=40.0):
    """dx = 24 min(x, 20): from 1 it comes to 20 within 0.125 s, and to 440 within 1 s."""
    return zoo.line(
        grid=sdhj.Grid([0.0], [upper], [int(upper) + 1]),
        dynamics=sdhj.Dynamics([[0.0]], lambda q, u: u + rate * np.minimum(q, most)),
        target=zoo.goal(10.0, 9.0),
        delta=delta,
        steps=1,
    )


def tide(*, phase=0.0, bound=0.05, more=0.0, target=0.0, pace=0.3, **given):
    """A current that turns, a target and a wall that drift, gusts that grow."""
    levels = [[-1.5], [0.0], [1.5]]
    return sdhj.ReachAvoidProblem(
        sdhj.Grid([-3.0], [3.0], [31]),
        sdhj.Dynamics(
            levels,
            lambda q, u, t: u + 1.2 * np.sin(5.0 * t + phase) + 0.0 * q,
            [[1.0]],
            lambda t: np.stack([bound + more * t]),
        ),
        sdhj.TargetSet((0,), lambda p, t: np.abs(p[:, 0] - target - pace * t) - 0.7),
        [sdhj.UnsafeSet((0,), lambda p, t: 2.0 - pace * t - p[:, 0], name="wall")],
        0.4,
        3,
        **given,
    )


def blown(*, gain=0.2, bound=0.5):
    """dx = u + gain x v and gusts that are as strong in the second input only."""
    levels = [[-1.0], [1.0]]
    return replace(
        line(),
        dynamics=sdhj.Dynamics(
            levels,
            lambda q, u: u + 0.0 * q,
            lambda q: gain * q[:, :, None],
            lambda q, u: np.stack([np.where(u[0] > 0, bound, 0.5)]),
        ),
    )


def pushed(*, share=1.0, **given):
    """dx = u - |v| share: the adversary enters as it likes."""
    velocity = lambda q, u, v: u + share * (0.5 * v - np.abs(v)) + 0.0 * q  # noqa: E731
    return line(dynamics=sdhj.Dynamics([[-1.0], [0.0], [1.0]], velocity=velocity, bounds=[0.2]), **given)


def drone(*, push=(0.1, 0.1)):
    """dx = u + v_1 + v_2."""
    return replace(line(), dynamics=sdhj.Dynamics([[-1.0], [1.0]], [[-1.0], [1.0]], [[1.0, 1.0]], push))


def sliding():
    """dx = v, dv = 0, for 1 s; a cell of places is wider by 5e-11 than what one of speeds lets pass."""
    return zoo.cart(
        grid=sdhj.Grid([-10.0, 0.0], [10.000000002, 2.0], [41, 5]),
        dynamics=sdhj.Dynamics([[0.0]], lambda q, u: np.stack([q[:, 1] + u[0], 0.0 * q[:, 1]], axis=1)),
        target=zoo.goal(0.0, 5.0),
        delta=1.0,
        steps=1,
    )


def nearer(*, moving=0.0):
    """A robot that stays where it is, nearer to a set than what a state may be off its cell."""
    part = sdhj.UnsafeSet((0,), lambda p, t: 3.0 + 1e-10 - p[:, 0] + moving * t, name="wall")
    return line(push=0.0, unsafe=[part])


def aimed():
    """A line without a push on which images end at the target's ends, nearer than what a state may be off its cell."""
    return replace(line(push=0.0), target=sdhj.TargetSet((0,), lambda p, t: np.abs(p[:, 0]) - 1.0 - 1e-10))


def slit():
    """The line, whose target lacks a slit that is thinner than all pieces that images are cut into."""
    target = sdhj.TargetSet((0,), lambda p, t: np.maximum(np.abs(p[:, 0]) - 1.0, 1e-6 - np.abs(p[:, 0] - 0.1234567)))
    return replace(line(), target=target)


def pole():
    """What is unsafe is told by a function that is undefined at -2.03."""
    part = sdhj.UnsafeSet((0,), lambda p, t: 5.0 + 1.0 / (p[:, 0] + 2.03), name="pole")
    return line(unsafe=[part])


def hump():
    """dx = 1 - x^2 / 4: nearly still at both ends, and fastest in between."""
    dynamics = sdhj.Dynamics([[0.0]], lambda q, u: u + 1.0 - 0.25 * q * q)
    return zoo.line(grid=sdhj.Grid([-2.0], [2.0], [41]), dynamics=dynamics, delta=0.2, steps=1)


def surge():
    """dx = 9.9 t + u: by 0.792 in 0.4 s."""
    dynamics = sdhj.Dynamics([[0.0]], lambda q, u, t: u + 9.9 * t + 0.0 * q)
    return zoo.line(grid=sdhj.Grid([-3.0], [3.0], [31]), dynamics=dynamics, delta=0.4, steps=1)


def spread(*, steep=2.0, bounds=lambda q, u: np.stack([0.1 + 0.0 * u[0]]), **sensing):
    """dx = u + steep sin(x) + v, measured with an error and late: what is not known grows with itself."""
    return zoo.line(
        grid=sdhj.Grid([-2.0], [2.0], [41]),
        dynamics=sdhj.Dynamics([[0.0], [1.0]], lambda q, u: u + steep * np.sin(q), [[1.0]], bounds),
        target=zoo.goal(0.0, 1.9),
        delta=0.2,
        steps=2,
        sensing=sdhj.Sensing(**({"error": 0.05, "delay": 0.1} | sensing), memory=False),
    )


def rapids():
    """dx = u + 2 x + v with gusts that grow with x, measured late: where a prediction comes to all is faster."""
    gusts = lambda q, u: 0.5 + 0.2 * q  # noqa: E731
    return replace(spread(), dynamics=sdhj.Dynamics([[0.0], [2.0]], lambda q, u: u + 2.0 * q, [[1.0]], gusts))


def stream(*, ends="safe", speed=3.0, push=0.0, rock=(0.5, 0.5, 0.15), pace=0.0, ways=(-1, 1)):
    """A stream to the right, some cells a step, past a rock: who leaves with it, or to the left, is out of danger."""
    x, y, radius = rock
    return zoo.plane(
        grid=sdhj.Grid([0.0, 0.0], [1.0, 1.0], [11, 11], ends=[ends, "wall"]),
        dynamics=sdhj.Dynamics(
            np.reshape(ways, (-1, 1)), [[way * speed, 0.0] for way in ways], np.eye(2), [push, push]
        ),
        target=None,
        unsafe=[
            sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0] - x - pace * t, p[:, 1] - y) - radius, name="rock")
        ],
        delta=0.1,
    )


def hidden(*, pace=0.0, **declared):
    """A line with a wall that nobody can look into: its author states how steep it is."""
    wall = sdhj.BlackBox(
        lambda p, t: [3.0 - pace * t - float(x) for (x,) in p], **({"slope": 1.0, "rate": 0.0} | declared)
    )
    return line(unsafe=[sdhj.UnsafeSet((0,), wall, name="wall")])


WIND = sdhj.gridded(np.eye(5) * 0.2, [-2.0, -2.0], [1.0, 1.0])


def plane(radius=0.3, **dynamics):
    """A robot in the plane, beside which a disk passes."""
    post = sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0], p[:, 1] - 1.2 + 0.4 * t) - radius, name="post")
    inputs = zoo.STEPS[1:]
    given = {"drift": np.array(inputs), "gain": np.eye(2), "bounds": [0.1, 0.1]} | dynamics
    grid = sdhj.Grid([-2.0, -2.0], [2.0, 2.0], [21, 21])
    return zoo.plane(grid=grid, dynamics=sdhj.Dynamics(inputs, **given), unsafe=[post], delta=0.25)


def pursued(*, height=-0.5, forbids=None, end="unsafe"):
    """A pursuer that runs along a line, on a wide ring on which a post comes nearer, too: (p, x, y).

    forbids : the inputs under which the post counts.
    """
    pursuer = sdhj.UnsafeSet(
        (0, 1, 2), lambda q, t: np.hypot(1.27 * np.sin(np.pi / 4 * q[:, 1]), q[:, 2] - q[:, 0]) - 0.5, name="pursuer"
    )
    post = sdhj.UnsafeSet(
        (0, 1, 2),
        lambda q, t: np.hypot(1.27 * np.sin(np.pi / 4 * (q[:, 1] - 1.0 + t)), q[:, 2] - 0.3 * q[:, 0] - height) - 0.3,
        name="post",
        inputs=forbids,
    )
    inputs = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    grid = sdhj.Grid([-1.0, -2.0, -1.5], [1.0, 2.0, 1.5], [9, 9, 9], [False, True, False], ends=["wall", "wall", end])
    return sdhj.ReachAvoidProblem(
        grid,
        sdhj.Dynamics(inputs[:, 1:], inputs, np.eye(3), [0.4, 0.1, 0.1]),
        sdhj.TargetSet((1, 2), lambda p, t: 0.7 - p[:, 1]),
        [pursuer, post],
        0.25,
        3,
    )


def windy():
    """The same in a wind from a table."""
    return plane(drift=lambda q, u: np.stack([u[0] + WIND(q), np.full(len(q), u[1])], axis=1))


def cornered(**dynamics):
    """Walls around, and the target in a corner."""
    grid = sdhj.Grid([-2.0, -2.0], [2.0, 2.0], [21, 21], ends="wall")
    return replace(
        plane(**dynamics), grid=grid, target=sdhj.TargetSet((0, 1), lambda p, t: np.hypot(*(p + 2.0).T) - 1.0)
    )


def turned_by_gusts():
    """A wall on an axis whose velocity reads no coordinate, beside one that reads its own; v is not linear."""
    still = lambda q: 0.0 * q[:, 0]  # noqa: E731
    velocity = lambda q, u, v: np.stack([u[0] + 0.1 * v[0] ** 2 + still(q), -0.5 * q[:, 1] + 0.1 * np.sin(v[0])], 1)  # noqa: E731
    return replace(
        cornered(),
        grid=sdhj.Grid([-1.0, -1.0], [1.0, 1.0], [21, 21], ends=["wall", "unsafe"]),
        dynamics=sdhj.Dynamics([[-1.0], [0.0], [1.0]], velocity=velocity, bounds=[0.2]),
        target=sdhj.TargetSet((0, 1), lambda p, t: np.hypot(*p.T) - 0.3),
        delta=0.1,
    )


ROBOTS: dict[str, tuple[Callable[..., Any], tuple[int, ...], int]] = {  # the problem, cells, parts
    "line": (line, (80,), 1),
    "eight": (eight, (40,), 1),
    "two posts in one": (two_in_one, (80,), 1),
    "forbidden": (forbidden, (80,), 1),
    "crossed": (crossed, (80,), 2),
    "sensed": (sensed, (160,), 1),
    "held": (lambda: sensed(push=0.1), (160,), 1),
    "sensed in the target": (lambda: sensed(begin=1.5, jitter=0.08), (160,), 2),
    "remembered": (lambda: sensed(memory=True), (160,), 1),
    "calming": (calming, (160,), 1),
    "nearer": (nearer, (80,), 1),
    "aimed": (aimed, (80,), 1),
    "slit": (slit, (80,), 1),
    "nearer in time": (lambda: nearer(moving=2.0**-50), (80,), 2),
    "pole": (pole, (80,), 1),
    "ring": (ring, (125,), 1),
    "turning": (turning, (40, 24), 1),
    "circle": (circle, (120,), 1),
    "cart": (cart, (20, 20), 1),
    "rail": (rail, (80, 80), 10),
    "standing": (standing, (40, 10), 1),
    "noisy": (noisy, (40, 10), 1),
    "standing soon": (lambda: standing(most=10.0), (40, 10), 1),
    "standing unsafely": (lambda: standing(ends=("wall", "unsafe")), (40, 10), 2),
    "endless": (lambda: cart(steps=None), (20, 20), 1),
    "bent": (lambda: cart(ends="safe", bent=1e-3, delta=0.3), (20, 20), 2),
    "bent rail": (lambda: cart(bent=1e-3, steps=None), (20, 80), 2),  # no cells of it move alike
    "walled": (lambda: cart(ends="wall", delta=0.3), (20, 20), 1),
    "growing": (growing, (40,), 1),
    "growing faster": (lambda: growing(rate=48.0, most=400.0, upper=800.0), (800,), 1),
    "growing slowly": (lambda: growing(rate=0.5), (40,), 1),
    "tide": (tide, (60,), 1),
    "tide at a quay": (lambda: tide(pace=0.0), (60,), 1),
    "blown": (blown, (160,), 1),
    "pushed": (pushed, (80,), 1),
    "late": (lambda: pushed(sensing=sdhj.Sensing(0.05, 0.1, memory=False)), (80,), 1),
    "drone": (drone, (80,), 1),
    "sliding": (sliding, (40, 4), 2),
    "hump": (hump, (40,), 1),
    "surge": (surge, (120,), 2),
    "spread": (spread, (200,), 1),
    "spread and remembered": (
        lambda: replace(spread(), target=zoo.goal(0.0, 0.6), sensing=sdhj.Sensing(0.05, 0.1)),
        (200,),
        2,
    ),
    "rapids": (rapids, (100,), 1),
    "gusty": (lambda: spread(steep=0.0, bounds=lambda q, u, t: np.stack([0.1 + 0.1 * u[0] + 0.2 * t])), (200,), 2),
    "less gusty": (lambda: spread(steep=0.0, bounds=lambda q, u, t: np.stack([0.3 + 0.1 * u[0] - 0.2 * t])), (200,), 2),
    "stream": (stream, (10, 10), 2),
    "one way out": (lambda: stream(ends=("unsafe", "safe")), (10, 10), 2),
    "rock at the lower end": (lambda: stream(rock=(0.02, 0.5, 0.02)), (10, 10), 2),
    "rock at the upper end": (lambda: stream(rock=(0.98, 0.5, 0.02)), (10, 10), 2),
    "out to the left": (lambda: stream(rock=(-0.13, 0.5, 0.02), pace=1.0, ways=(-1,)), (10, 10), 2),
    "out to the right": (lambda: stream(rock=(1.13, 0.5, 0.02), pace=-1.0, ways=(1,)), (10, 10), 2),
    "thin": (lambda: line(push=0.19, posts=(-3.0,), wide=0.006), (80,), 1),
    "calm": (lambda: line(push=0.001, posts=(-2.9968,), wide=0.003), (80,), 1),
    "beside a post": (lambda: line(posts=(-1.5, 3.0)), (80,), 1),
    "past the seam": (past_the_seam, (125,), 2),
    "before the seam": (lambda: ring(low=-9.0), (125,), 2),
    "cornered": (cornered, (20, 20), 2),
    "pursued": (pursued, (8, 16, 24), 2),
    "pursued where it must not go up": (lambda: pursued(height=0.5, forbids=[2]), (8, 16, 24), 2),
    "pursued without a target": (lambda: replace(pursued(end="wall"), target=None), (8, 16, 24), 2),
    "plane": (plane, (30, 30), 3),
    "to the left": (lambda: cornered(drift=[[-1.0, 0.0], [-1.0, 1.0], [-1.0, -1.0], [-2.0, 0.0]]), (20, 20), 2),
    "post in the target": (lambda: line(posts=(0.0, 3.0)), (80,), 1),
    "hidden": (hidden, (80,), 1),
    "hidden and moving": (lambda: hidden(pace=0.5, rate=0.5), (80,), 2),
    "windy": (windy, (12, 12), 2),
    "turned by gusts": (turned_by_gusts, (20, 20), 2),
}


@cache
def solved(name: str) -> Any:
    """The table of a robot, solved once."""
    problem, cells, parts = ROBOTS[name]
    return sdhj.solve(problem(), sdhj.Certified(cells=cells, parts=parts), progress=False, play=False)


@cache
def file_of(name: str) -> bytes:
    """The bytes of a robot's file, made once."""
    with TemporaryDirectory() as folder:
        solved(name).save(path := Path(folder) / "table.npz")
        return path.read_bytes()


# ---- changing what stands in a file


def edit(name: str, change: Callable[[FloatArray], Any]) -> Callable[[Told, Any], None]:
    """An array of the file, changed in place; of clear inputs those of the first axes: (starts, cells, bytes)."""

    def forge(told: Told, arrays: Any) -> None:
        values = arrays[name][()]
        change(first_clear(told, values) if name == "clear" else values)
        arrays[name][...] = values

    return forge


def first_clear(told: Told, values: FloatArray) -> FloatArray:
    """The bits of clear inputs by the first axes that a file names, a view; all there are, for robots of one kind."""
    first, *others = told["proof"]["clear"]
    assert not others
    size = -(-len(told["inputs"]) // 8)
    return values.reshape(-1, int(np.prod([told["cells"]["shape"][k] for k in first["axes"]])), size)


def put(arrays: Any, **given: FloatArray) -> None:
    """Arrays in place of those that were there."""
    for name, values in given.items():
        del arrays[name]
        arrays[name] = values


@contextmanager
def sets_of(told: Told, arrays: Any) -> Iterator[FloatArray]:
    """All sets of the file as they count: (entries, *cells) bool, to be changed."""
    shape = told["cells"]["shape"]
    blocks = arrays["pool"][()][arrays["index"][()]].view(np.uint8)
    sets = np.unpackbits(blocks, axis=-1, count=shape[-1], bitorder="little").reshape(-1, *shape).astype(bool)
    yield sets
    packed = np.packbits(sets.reshape(-1, shape[-1]), axis=1, bitorder="little")
    packed = np.pad(packed, [(0, 0), (0, -packed.shape[1] % 8)]).view(np.uint64)
    pool = np.concatenate([np.zeros_like(packed[:1]), packed])
    put(arrays, pool=pool, index=np.arange(1, len(pool), dtype=np.uint32).reshape(len(sets), -1))


def sets(change: Callable[[FloatArray], Any]) -> Callable[[Told, Any], None]:
    def forge(told: Told, arrays: Any) -> None:
        with sets_of(told, arrays) as found:
            change(found)

    return forge


def of_each_step(told: Told, arrays: Any) -> None:
    """Sets for each step of a robot of which nothing moves: of step 0, as which a run asks all, the last alone."""
    index, steps = arrays["index"][()], told["steps"]
    assert len(index) == steps + 1
    later = [index[: steps + 1 - step] for step in range(1, steps + 1)]
    put(arrays, index=np.concatenate([np.zeros_like(index[1:]), index[-1:], *later]))


def nothing_in_sets(told: Told, arrays: Any) -> None:
    """No set has a cell: what is claimed is of moves, and of which inputs are clear."""
    sets(lambda found: found.fill(False))(told, arrays)


def goals_only(told: Told, arrays: Any) -> None:
    """No input is clear, so sets do not grow: what is claimed is of goals, and of moves."""
    edit("clear", lambda clear: clear.fill(0))(told, arrays)

    def change(found: FloatArray) -> None:
        assert len(found) == told["steps"] + 1
        found[1:] = found[0]

    sets(change)(told, arrays)


def clears(j: int, *cells: int, step: int = 0) -> Callable[[Told, Any], None]:
    """An input is said to be clear from some cells."""

    def change(clear: FloatArray) -> None:
        assert not (clear[step, list(cells), j // 8] >> (j % 8) & 1).any()
        clear[step, list(cells), j // 8] |= 1 << (j % 8)

    return edit("clear", change)


def arrives(j: int, site: int) -> Callable[[Told, Any], None]:
    """An input is said to lead from a site into the target itself, and nothing else is said."""

    def change(marks: FloatArray) -> None:
        assert not marks[0, site, j // 8] >> (j % 8) & 1
        marks.fill(0)
        marks[0, site, j // 8] |= 1 << (j % 8)

    return both(nothing_in_sets, edit("arrives", change))


def arrives_unknown(told: Told, arrays: Any) -> None:
    """Predictions are said to be led into the target itself."""
    told["proof"]["arrives"] = True
    arrays["arrives"] = np.zeros((1, told["cells"]["shape"][0], 1), np.uint8)


def shifts(name: str, by: int, *, start: int = 0, j: int = 1, place: int = 0, axis: int = 0) -> Any:
    def change(moves: FloatArray) -> None:
        moves[start, j, place, axis] += by

    return edit(name, change)


def both(*forges: Callable[[Told, Any], None]) -> Callable[[Told, Any], None]:
    def forge(told: Told, arrays: Any) -> None:
        for one in forges:
            one(told, arrays)

    return forge


def head(change: Callable[[Told], Any]) -> Callable[[Told, Any], None]:
    return lambda told, arrays: change(told)


@dataclass(frozen=True)
class Forgery:
    """What is changed in the file of a robot, what of it the checker has to say, and the problem given beside it.

    becomes : the problem that the head then describes.
    """

    robot: str
    said: str
    forge: Callable[[Told, Any], None] = lambda told, arrays: None
    becomes: Callable[[], Any] | None = None
    beside: Callable[[], Any] | None = None

    def write(self, whole: bytes, path: Path) -> Path:
        """The forged file, of the bytes of the robot's."""
        from forging import forged

        path.write_bytes(whole)
        if self.becomes:
            describe(path, self.becomes())
        with forged(path, named=True) as (told, arrays):
            self.forge(told, arrays)
        return path


# ---- forgeries


def first_beside(found: FloatArray, entry: int) -> int:
    """The cell of a line below all those of a set."""
    return int(np.flatnonzero(found[entry])[0]) - 1


def a_cell_more(entry: int) -> Callable[[Told, Any], None]:
    """The next cell of a line in a set."""
    return sets(lambda found: found[entry].put(first_beside(found, entry), True))


def beside_the_post(j: int, step: int, above: bool = False) -> Callable[[Told, Any], None]:
    """One input is said to be clear, from the first cell from which it meets something that comes, or the last."""

    def change(clear: FloatArray) -> None:
        met = np.flatnonzero(clear[step, :, 0] >> j & 1 == 0)
        inner = met[(met > 20) & (met < len(clear[0]) - 20)]  # not the ends
        clear.fill(0)
        clear[step, inner[-1] if above else inner[0], 0] |= 1 << j

    return both(nothing_in_sets, edit("clear", change))


def level(name: str, *lines: str) -> Callable[[Told, Any], None]:
    """A function of the file becomes another."""
    return head(lambda told: told["formulas"]["functions"][name].update(lines=[*lines, f"return {len(lines) - 1}"]))


def unlike_ends(told: Told, arrays: Any) -> None:
    told["cells"]["extents"] = [["6283/1000", told["cells"]["extents"][0][1]]]


def one_place(told: Told, arrays: Any, place: int = 60) -> None:
    told["proof"]["own"] = [False]
    put(arrays, **{name: arrays[name][()][:, :, place : place + 1] for name in ("low", "high")})


def as_in_the_middle(told: Told, arrays: Any) -> None:
    for name in ("low", "high"):
        edit(name, lambda moves: np.copyto(moves, moves[:, :, 60:61]))(told, arrays)


def no_place(told: Told, arrays: Any) -> None:
    told["proof"]["own"] = [False, False]
    put(arrays, **{name: arrays[name][()][:, :, :1] for name in ("low", "high")})


def first_moves(told: Told, arrays: Any) -> None:
    for name in ("low", "high"):
        edit(name, lambda moves: np.copyto(moves, moves[:1]))(told, arrays)


def narrower(low: int, high: int) -> Callable[[Told, Any], None]:
    """Every move of a file ends in fewer cells."""
    return both(edit("low", lambda moves: np.add(moves, low, moves)), edit("high", lambda m: np.subtract(m, high, m)))


def off_by(least: float) -> Callable[[Told, Any], None]:
    return head(lambda told: told["proof"].update(unsure=[least]))


def only_clear(j: int, *cells: int, step: int = 0) -> Callable[[Told, Any], None]:
    """One input is said to be clear, from some cells, and nothing else."""
    return both(nothing_in_sets, edit("clear", lambda clear: clear.fill(0)), clears(j, *cells, step=step))


def both_ends(told: Told, arrays: Any) -> None:
    """Inputs are said to be clear of the ends of both axes."""
    told["proof"]["clear"][0].update(ends=[0, 1])


FORGERIES: dict[str, Forgery] = {
    # cells
    "cells that begin elsewhere": Forgery("line", COVER, head(lambda told: told["cells"].update(lowers=["-39/10"]))),
    "a longer axis": Forgery("line", COVER, becomes=lambda: line(upper=4.05)),
    "cells that are too narrow": Forgery("line", COVER, head(lambda told: told["cells"].update(widths=["99/1000"]))),
    "cells that are too wide": Forgery("line", COVER, head(lambda told: told["cells"].update(widths=["1/9"]))),
    "a length that is a guess": Forgery(
        "line", COVER, head(lambda told: told["cells"].update(extents=[["799/100", "8"]]))
    ),
    "a period that is a guess": Forgery("ring", COVER, unlike_ends),
    "cells that are not alike": Forgery("ring", COVER, one_place),
    "a wall on the way": Forgery("cart", COVER, becomes=lambda: cart(ends="wall")),
    # moves
    "a stronger push": Forgery("line", MOVES, becomes=lambda: line(push=0.3)),
    "a shorter move": Forgery("line", MOVES, shifts("low", 1)),
    "a move that ends too early": Forgery("line", MOVES, shifts("high", -1)),
    "a seam like any other edge": Forgery("ring", MOVES, as_in_the_middle),
    "a wall that holds": Forgery(
        "bent", MOVES, nothing_in_sets, becomes=lambda: cart(ends="wall", bent=1e-3, delta=0.3)
    ),
    "less growth": Forgery("growing", MOVES, edit("high", lambda moves: moves[0, 0, 0].fill(470))),
    "growth from the lower end": Forgery("growing", MOVES, edit("low", lambda moves: moves[0, 0, 0].fill(100))),
    "the tide of another hour": Forgery("tide", MOVES, first_moves),
    "gusts that grow": Forgery("tide", MOVES, becomes=lambda: tide(more=0.3)),
    "gusts of another input": Forgery("blown", MOVES, becomes=lambda: blown(bound=1.0)),
    "gusts from the other side": Forgery(
        "blown", MOVES, both(*(edit(name, lambda moves: moves[0, 0, 10].fill(-10)) for name in ("low", "high")))
    ),
    "an adversary that enters as it likes": Forgery("pushed", MOVES, shifts("low", 1)),
    "one measurement that errs": Forgery("sensed", MOVES, narrower(2, 2)),
    "predictions that end as near as measurements": Forgery("spread", MOVES, both(nothing_in_sets, narrower(1, 1))),
    "no late end": Forgery(
        "sensed", MOVES, both(nothing_in_sets, shifts("low", -2, j=2), shifts("high", -2, j=2), shifts("high", 2, j=0))
    ),
    "no early end": Forgery("sensed", MOVES, both(nothing_in_sets, shifts("low", 3, j=2))),
    "an end that is early by half": Forgery("sensed", MOVES, both(nothing_in_sets, shifts("low", 1, j=2))),
    "an end that is early by half, on the way back": Forgery(
        "sensed", MOVES, both(nothing_in_sets, shifts("high", -1, j=0))
    ),
    "errors that are forgotten": Forgery("remembered", MOVES, becomes=sensed),
    "images shrunk by too much": Forgery(
        "remembered", MOVES, both(nothing_in_sets, shifts("low", 1, j=2), shifts("high", -1, j=2))
    ),
    "a middle that is elsewhere": Forgery(
        "calming", MOVES, both(shifts("low", 1, place=60), shifts("high", 1, place=60))
    ),
    "a speed that grows": Forgery("cart", MOVES, shifts("high", -1, j=2, place=11)),
    "states near a cell": Forgery("sliding", MOVES, edit("high", lambda moves: moves[0, 0, 0, :1].fill(1))),
    "a little later": Forgery("surge", MOVES, narrower(-2, 2)),
    "a little sooner": Forgery("surge", MOVES, narrower(2, -2)),
    "two that push": Forgery("drone", MOVES, becomes=lambda: drone(push=(0.1, 0.3))),
    # layers
    "a layer at an end that is no wall": Forgery(
        "standing", COVER, both_ends, becomes=lambda: standing(ends=("unsafe", "wall"))
    ),
    "a layer at an upper end that is no wall": Forgery(
        "standing", COVER, both_ends, becomes=lambda: standing(ends=("wall", "unsafe"))
    ),
    "a layer where an axis closes": Forgery(
        "standing", "close where the axes", becomes=lambda: standing(periodic=True)
    ),
    "a layer of cells that move alike": Forgery("standing", COVER, lambda told, arrays: no_place(told, arrays)),
    "moves of both ends, said to be those of all": Forgery(
        "hump", MOVES, both(nothing_in_sets, lambda told, arrays: one_place(told, arrays, 0))
    ),
    "moves of the slowest, said to be those of all": Forgery(
        "cart", MOVES, both(nothing_in_sets, lambda told, arrays: no_place(told, arrays))
    ),
    "coasting that stays on the layer": Forgery(
        "standing", MOVES, both(shifts("low", -1, j=1, axis=1), shifts("high", -1, j=1, axis=1))
    ),
    "the fastest that are not held by the wall": Forgery(
        "standing",
        MOVES,
        both(shifts("low", 1, j=1, place=11, axis=1), shifts("high", 1, j=1, place=11, axis=1)),
    ),
    "braking without a cell more": Forgery("standing", MOVES, shifts("high", -1, j=0, place=1)),
    "half a shell above a wall": Forgery(
        "noisy", MOVES, both(shifts("low", -1, j=0, place=1, axis=1), shifts("high", -1, j=0, place=1, axis=1))
    ),
    "half a shell below a wall": Forgery(
        "noisy", MOVES, both(shifts("low", 1, j=2, place=10, axis=1), shifts("high", 1, j=2, place=10, axis=1))
    ),
    "a measurement that errs nowhere": Forgery(
        "noisy", MOVES, both(shifts("low", 1, j=1, place=5, axis=1), shifts("high", -1, j=1, place=5, axis=1))
    ),
    "a cell behind the layer at a wall": Forgery("noisy", MOVES, shifts("low", -1, axis=1, j=0)),
    "a cell behind the layer at an upper wall": Forgery("noisy", MOVES, shifts("high", 1, axis=1, j=2, place=11)),
    # predictions
    "predictions as near as measurements": Forgery("spread", NEAR, off_by(0.05)),
    "predictions that begin where the state is": Forgery("spread", NEAR, off_by(0.075)),
    "predictions that move on at once": Forgery("spread", NEAR, off_by(0.078)),
    "predictions pushed as where they come from": Forgery("rapids", NEAR, off_by(0.2)),
    "predictions pushed one way": Forgery("late", NEAR, off_by(0.065)),
    "predictions for the first input": Forgery("gusty", NEAR, off_by(0.068)),
    "predictions from one end, said to be those of all": Forgery(
        "spread", NEAR, lambda told, arrays: one_place(told, arrays, 0)
    ),
    "predictions for the first step": Forgery("gusty", NEAR, off_by(0.0735)),
    # which inputs are clear
    "a post not met at the end": Forgery("line", CLEAR, clears(0, 12)),
    "the far half of a tube": Forgery("line", CLEAR, clears(2, 5)),
    "the last of eight inputs": Forgery("eight", CLEAR, clears(7, 2)),
    "the second post": Forgery("line", CLEAR, clears(1, 69)),
    "an input where it is forbidden": Forgery("forbidden", CLEAR, clears(2, 18)),
    "a set that is closed": Forgery("line", CLEAR, level("unsafe 0", "const 0x0p+0")),
    "a set nearer than rounding": Forgery(
        "line",
        CLEAR,
        both(level("unsafe 1", f"const {(3.0 + 1e-10).hex()}", "x 0", "sub 0 1"), only_clear(1, 69)),
        becomes=lambda: line(push=0.0),
    ),
    "out by the upper end": Forgery("line", CLEAR, clears(2, 79)),
    "out by the lower end": Forgery("line", CLEAR, clears(0, 0)),
    "out by an end of the second axis": Forgery("plane", CLEAR, clears(3, 450)),
    "a post that comes later": Forgery("crossed", CLEAR, only_clear(1, 56, step=2)),
    "a post that comes meanwhile": Forgery("crossed", CLEAR, only_clear(2, 50, step=2)),
    "a post beside an uncertain clock": Forgery("sensed", CLEAR, beside_the_post(1, 2)),
    "a post behind an uncertain clock": Forgery("sensed", CLEAR, beside_the_post(1, 2, above=True)),
    "a set behind the seam": Forgery("ring", CLEAR, only_clear(2, 123), becomes=lambda: ring(high=9.0)),
    "a set before the seam": Forgery("ring", CLEAR, only_clear(0, 2), becomes=lambda: ring(low=-9.0)),
    "a rock at the end of the way": Forgery("stream", CLEAR, clears(1, 5)),
    "a rock on its way while a part of the cell is out to the left": Forgery(
        "out to the left",
        CLEAR,
        only_clear(0, 15),
        becomes=lambda: stream(rock=(-0.73, 0.5, 0.02), pace=13.0, ways=(-1,)),
    ),
    "a rock on its way while a part of the cell is out to the right": Forgery(
        "out to the right",
        CLEAR,
        only_clear(0, 85),
        becomes=lambda: stream(rock=(1.73, 0.5, 0.02), pace=-13.0, ways=(1,)),
    ),
    "a rock that comes to a lower wall": Forgery(
        "out to the left",
        CLEAR,
        only_clear(0, 5),
        becomes=lambda: stream(ends=("wall", "safe"), rock=(-0.73, 0.5, 0.02), pace=13.0, ways=(-1,)),
    ),
    "a rock that comes to an upper wall": Forgery(
        "out to the right",
        CLEAR,
        only_clear(0, 95),
        becomes=lambda: stream(ends=("safe", "wall"), rock=(1.73, 0.5, 0.02), pace=-13.0, ways=(1,)),
    ),
    "a rock at a safe end": Forgery("stream", CLEAR, only_clear(0, 5), becomes=lambda: stream(rock=(0.05, 0.5, 0.04))),
    "a rock at the upper safe end": Forgery(
        "stream", CLEAR, only_clear(1, 95), becomes=lambda: stream(rock=(0.95, 0.5, 0.04))
    ),
    "a sweep that the file states": Forgery(
        "crossed",
        CLEAR,
        both(
            clears(1, 56, step=2),
            head(
                lambda told: told["formulas"]["functions"].update(
                    {"swept 0": {"coordinates": 1, "parameters": 2, "lines": ["const 0x1p+0", "return 0"]}}
                )
            ),
        ),
    ),
    # sets
    "a goal more": Forgery("line", GOAL, a_cell_more(0)),
    "a goal in a post": Forgery("line", GOAL, goals_only, becomes=lambda: line(posts=(0.0, 3.0))),
    "an arrival more": Forgery("line", ARRIVE, arrives(1, 29)),
    "an arrival that leaves": Forgery("line", ARRIVE, arrives(2, 48)),
    "an arrival nearer than rounding": Forgery("aimed", ARRIVE, arrives(2, 44)),
    "arrivals of predictions": Forgery("sensed", "states that are known", arrives_unknown),
    "a goal of another time": Forgery("tide", GOAL, lambda told, arrays: goals_of_step_0(told, arrays)),
    "a goal beside an error": Forgery("sensed", GOAL, a_cell_more(0)),
    "a goal beside an uncertain clock": Forgery("sensed", GOAL, lambda told, arrays: goal_by_the_post(told, arrays)),
    "a goal behind an uncertain clock": Forgery(
        "sensed in the target", GOAL, lambda told, arrays: goal_by_the_post(told, arrays, -1)
    ),
    "a set that loses a cell": Forgery("line", GROW, sets(lambda found: found[2].put(first_beside(found, 1) + 1, 0))),
    "a set that wins a cell": Forgery(
        "cart", GROW, sets(lambda found: found[0].__setitem__(tuple(np.argwhere(found[1])[0]), False))
    ),
    "a late set that has all cells": Forgery("tide", NEARER, sets(lambda found: found[8].fill(True))),
    "a late set that loses a cell": Forgery(  # S_2^1 one of S_2^0
        "tide", GROW, sets(lambda found: found[8].__setitem__(tuple(np.argwhere(found[7])[0]), False))
    ),
    "a cell more": Forgery("line", NEARER, a_cell_more(1)),
    "a cell of which no input is clear": Forgery(
        "line", NEARER, lambda told, arrays: nothing_clear_from_the_first(told, arrays)
    ),
    "a step into sets of another time": Forgery(
        "crossed", NEARER, lambda told, arrays: later_sets_shrink(told, arrays)
    ),
    "a cell that is not safe as long": Forgery("cart", NEARER, lambda told, arrays: safe_for_longer(told, arrays)),
    "a cell that is not safe for ever": Forgery("endless", NEARER, lambda told, arrays: safe_for_ever(told, arrays)),
    "past the lower end by less than a cell": Forgery("stream", NEARER, sets(lambda found: found[:, 0, 5].fill(0))),
    "past the upper end by less than a cell": Forgery("stream", NEARER, sets(lambda found: found[:, 9, 5].fill(0))),
    "past a wall": Forgery(
        "stream", NEARER, sets(lambda found: found[:, 0:4:2, 5].fill(0)), becomes=lambda: stream(ends="wall")
    ),
    # black boxes
    "a slope of 0": Forgery("hidden", "must hold at 0 s", beside=lambda: hidden(slope=0.0)),
    "a black box that comes meanwhile": Forgery(
        "hidden and moving", CLEAR, clears(2, 61), beside=lambda: hidden(pace=0.5, rate=0.5)
    ),
    "a rate of 0": Forgery("hidden", "must hold at", beside=lambda: hidden(pace=0.5)),
    "an enclosure that ends below": Forgery(
        "hidden",
        "must hold at 0 s",
        beside=lambda: hidden(enclosure=lambda low, high, *t: (low - 9.0, 0.0 * low + 1.0)),
    ),
    "an enclosure that begins above": Forgery(
        "hidden",
        "must hold at 0 s",
        beside=lambda: hidden(enclosure=lambda low, high, *t: (0.0 * low + 1.0, 0.0 * low + 9.0)),
    ),
    "a slope that the file states": Forgery(
        "hidden",
        CLEAR,
        both(
            clears(1, 70), head(lambda told: told["formulas"]["opaque"].update({"unsafe 0": "a BlackBox with slope 0"}))
        ),
        beside=hidden,
    ),
    "nobody's black box": Forgery("hidden", "have the black box"),
    "the black box of another": Forgery("hidden", "have the black box", beside=line),
    "a black box among fewer sets": Forgery("hidden", "have the black box", beside=lambda: line(unsafe=[])),
    "a black box of which nothing is stated": Forgery(
        "hidden", "must have an enclosure", beside=lambda: hidden(slope=None)
    ),
    # arrays
    "moves of one hour": Forgery(
        "tide", "low must be kept", lambda told, arrays: put(arrays, low=arrays["low"][()][:1])
    ),
    "sets for all times": Forgery("crossed", "sets for each step", lambda told, arrays: alike(told, arrays)),
    "sets for all times of a tide": Forgery(
        "tide at a quay", "sets for each step", lambda told, arrays: alike(told, arrays)
    ),
    "moves that end before they begin": Forgery("line", "lead to some cell", shifts("low", 9)),
    "a clock that is off, and a tide": Forgery(
        "tide", "with jitter the velocity", head(lambda told: told.update(sensing={"jitter": 0.05}))
    ),
}


def goal_by_the_post(told: Told, arrays: Any, side: int = 0) -> None:
    """The cell of S_2^0 that is next to where the post may be, or may have been (-1), in S_2^1, too."""

    def change(found: FloatArray) -> None:
        gap = np.flatnonzero(~found[7] & found[0])[side]
        found[7:9, gap] = True

    sets(change)(told, arrays)


def nothing_clear_from_the_first(told: Told, arrays: Any) -> None:
    with sets_of(told, arrays) as found:
        cell = first_beside(found, 1) + 1
    edit("clear", lambda clear: clear[:, cell].fill(0))(told, arrays)


def goals_of_step_0(told: Told, arrays: Any) -> None:
    """They are told of step 2, and of no other."""

    def change(found: FloatArray) -> None:
        goals = found[0].copy()
        found.fill(False)
        found[7:9] = goals

    sets(change)(told, arrays)


def later_sets_shrink(told: Told, arrays: Any) -> None:
    """Later nothing is in the target; the sets of step 0 are as if it were."""

    def change(found: FloatArray) -> None:
        found[2:4] = found[1]
        found[4:] = False

    both(sets(change), edit("arrives", lambda arrives: arrives.fill(0)))(told, arrays)


def safe_for_longer(told: Told, arrays: Any) -> None:
    sets(lambda found: found[1].__setitem__(tuple(np.argwhere(found[0] & ~found[1])[0]), True))(told, arrays)


def safe_for_ever(told: Told, arrays: Any) -> None:
    def change(found: FloatArray) -> None:
        outside = np.argwhere(~found[0] & np.roll(found[0], 1, axis=1))
        found[0][tuple(outside[len(outside) // 2])] = True

    sets(change)(told, arrays)


def lines(told: Told, name: str) -> list[str]:
    return told["formulas"]["functions"][name]["lines"]


HEADS: dict[str, tuple[Callable[[Told], Any], str]] = {
    "lines": (
        lambda told: told["proof"].update(normals=[[1.0, 0.0]], halo=[[0, 0], [0, 0]]),
        "no unknown field",
    ),
    "a function less": (lambda told: told["formulas"]["functions"].pop("gain"), "a formula gain"),
    "no bounds": (lambda told: told["formulas"]["functions"].pop("bounds"), "a formula bounds"),
    "bounds of some inputs": (
        lambda told: lines(told, "bounds").__setitem__(-1, "return 0 0 0"),
        "as many results for",
    ),
    "bounds of too many disturbances": (
        lambda told: lines(told, "bounds").__setitem__(-1, "return" + 4 * 1001 * " 0"),
        "as many results for",
    ),
    "another format": (lambda told: told["formulas"].update(format=2), "of format 1"),
    "a line": (lambda told: lines(told, "drift").insert(0, "halt 0"), "of drift: an operation"),
    "results": (lambda told: lines(told, "drift").__setitem__(-1, "return 0"), "drift must have 8 results"),
    "more results": (
        lambda told: lines(told, "drift").__setitem__(-1, "return 0" + 8 * " 0"),
        "drift must have 8 results",
    ),
    "two results": (lambda told: lines(told, "target").__setitem__(-1, "return 0 0"), "target must have one result"),
    "coordinates": (lambda told: told["formulas"]["functions"]["gain"].update(coordinates=3), "gain must have 2 coord"),
    "both": (lambda told: told["formulas"].update(opaque={"drift": ""}), "function is a formula"),
    "axes": (lambda told: told["sets"][1].update(axes=[0, 2]), "axes of a set"),
    "axes twice": (lambda told: told["sets"][1].update(axes=[0, 0]), "axes of a set"),
    "kinds": (lambda told: told["sets"].reverse(), "must be a target"),
    "ends": (lambda told: told["grid"].update(ends=[["open", "wall"]] * 2), "safe, unsafe, wall"),
    "seven axes": (lambda told: told["grid"].update(lower=[0.0] * 7), "1 to 6 axes"),
    "no number": (lambda told: told["grid"].update(lower=["0", 0.0]), "lower "),
    "nodes": (lambda told: told["grid"].update(shape=[1, 21]), "numbers of nodes"),
    "infinite": (lambda told: told.update(delta=float("inf")), "delta "),
    "delay": (lambda told: told.update(sensing={"delay": -1}), "delay "),
    "error": (lambda told: told.update(sensing={"error": [0.1]}), "error must be 2 numbers"),
    "an error below zero": (lambda told: told.update(sensing={"error": -0.1}), "error "),
    "no inputs": (lambda told: told.update(inputs=[]), "there must be 1 to"),
    "parts": (lambda told: told["proof"].update(parts=0), "parts must"),
    "one cell": (lambda told: told["cells"].update(shape=[1, 30]), "shape must be numbers"),
    "widths": (lambda told: told["cells"].update(widths=["0x1", "1"]), "as fractions"),
    "axes of a place": (
        lambda told: told["proof"].update(own=[True, True, False]),
        "axes of a place",
    ),
    "predictions": (lambda told: told["proof"].update(unsure=[0.0]), "unsure must be 2 numbers"),
    "predictions below zero": (lambda told: told["proof"].update(unsure=[-1.0, 0.0]), "unsure "),
    "a field that is a part of another's name": (lambda told: told.update(sensing={"rror": 0.0}), "no unknown field"),
    "a grid as a list": (lambda told: told.update(grid=["lower"]), "grid must be an entry"),
    "a field less": (lambda told: told["proof"].pop("parts"), "the proof must have the fields"),
    "names as a text": (lambda told: told["grid"].update(names="xy"), "names must be a list of 2"),
    "no axes": (lambda told: told["grid"].update(lower=[]), "1 to 6 axes"),
    "too many nodes": (lambda told: told["grid"].update(shape=[10**6 + 1, 21]), "numbers of nodes"),
    "too many cells": (lambda told: told["cells"].update(shape=[2, 10**6 + 1]), "shape must be numbers of cells"),
    "inputs of one number": (lambda told: told.update(inputs=[0.0] * 4), "an input must be"),
    "no steps": (lambda told: told.update(steps=0), "steps must"),
    "too many steps": (lambda told: told.update(steps=10**6 + 1), "steps must"),
    "too many parts": (lambda told: told["proof"].update(parts=1001), "parts must"),
    "a delay of more than an interval": (lambda told: told.update(sensing={"delay": 0.26}), "delay must be"),
    "jitter of more than half an interval": (lambda told: told.update(sensing={"jitter": 0.126}), "jitter must be"),
    "jitter below zero": (lambda told: told.update(sensing={"jitter": -0.01}), "jitter must be"),
    "rest": (lambda told: told.update(sensing={"rest": 4}), "rest must be"),
    "a set on no axes": (lambda told: told["sets"][1].update(axes=[]), "axes of a set"),
    "an input of a set twice": (lambda told: told["sets"][1].update(inputs=[0, 0]), "inputs of an unsafe set"),
}
FORGERIES |= {f"head: {name}": Forgery("plane", said, head(change)) for name, (change, said) in HEADS.items()}
FORGERIES |= {
    "head: periods": Forgery("line", "periodic must", head(lambda told: told["grid"].update(periodic=["no"]))),
    "head: inputs of a set": Forgery(
        "forbidden", "inputs of an unsafe", head(lambda told: told["sets"][1].update(inputs=[3]))
    ),
    "head: memory": Forgery("line", "memory must", head(lambda told: told.update(sensing={"error": 0.1, "memory": 2}))),
}


def says(*lines: str) -> Callable[[Told, Any], None]:
    return head(lambda told: told["formulas"]["functions"]["unsafe 0"].update(lines=list(lines)))


FORGERIES |= {  # of a text by itself `check/test_formulas.py` has more
    "text: a later line": Forgery("plane", "unsafe 0: an operand", says("x 0", "neg 2", "return 1")),
    "text: a table of more axes": Forgery(
        "windy", "axis for each operand", says("x 0", "gridded 0 0 lower 0x0p+0 spacing 0x1p+0", "return 1")
    ),
}


# ---- forgeries that a reading of the checker brought


def drifting():
    """A robot whose target alone moves, so that no unsafe set nor velocity tells of a time."""
    target = sdhj.TargetSet((0,), lambda p, t: np.abs(p[:, 0] - 0.4 * t) - 1.0)
    return replace(line(), target=target)


def carried():
    """A place between walls, carried on by a current that depends on a second coordinate, which stays as it is."""
    grid = sdhj.Grid([-1.0, -1.0], [1.0, 1.0], [21, 21], ends=["wall", "unsafe"])
    inputs = [[-1.0], [1.0]]
    drift = lambda q, u: np.stack([u[0] + 0.5 * np.sin(q[:, 1]), 0.0 * q[:, 1]], axis=1)  # noqa: E731
    target = sdhj.TargetSet((0,), lambda p, t: np.abs(p[:, 0]) - 0.5)
    return zoo.plane(grid=grid, dynamics=sdhj.Dynamics(inputs, drift), target=target, delta=0.2, steps=2)


def lane():
    """A stream from which the first input leads out to the left, and meanwhile beside what is above."""
    above = sdhj.UnsafeSet((1,), lambda p, t: 0.8 - p[:, 0], name="above")
    problem = stream()
    dynamics = sdhj.Dynamics([[-1.0], [1.0]], [[-3.0, 1.5], [3.0, 0.0]], np.eye(2), [0.0, 0.0])
    return replace(problem, dynamics=dynamics, unsafe=[above])


def parked():
    """The cart whose first input stops it at once, so that where this leads depends on no speed."""

    def drift(q, u):
        return np.stack([q[:, 1] if u[0] else np.full(len(q), 0.0), np.full(len(q), u[0])], axis=1)

    return replace(cart(), dynamics=sdhj.Dynamics([[0.0], [-3.0], [3.0]], drift, [[0.0], [1.0]], [0.2]))


ROBOTS |= {"drifting": (drifting, (80,), 1), "carried": (carried, (20, 20), 1), "lane": (lane, (10, 10), 2)}


def sheltered(least, most):
    """dx = u + clip(20 y, least, most) v: beside y = 0 one end of a cell has no gusts, the other all."""
    zero = lambda q: 0.0 * q[:, 0]  # noqa: E731
    drift = lambda q, u: np.stack([u[0] + zero(q), zero(q)], axis=1)  # noqa: E731
    gain = lambda q: np.stack([np.clip(20.0 * q[:, 1], least, most), zero(q)], axis=1)[:, :, None]  # noqa: E731
    return replace(carried(), dynamics=sdhj.Dynamics([[-1.0], [1.0]], drift, gain, [0.5]))


def veering():
    """The same with two gusts, one along each axis, the second the stronger the farther to the right it is."""
    zero = lambda q: 0.0 * q[:, 0]  # noqa: E731
    drift = lambda q, u: np.stack([u[0] + zero(q), zero(q)], axis=1)  # noqa: E731
    rows = lambda q: [[0.1 + zero(q), zero(q)], [zero(q), 0.2 + 0.1 * q[:, 0]]]  # noqa: E731
    gain = lambda q: np.stack([np.stack(row, axis=1) for row in rows(q)], axis=1)  # noqa: E731
    return replace(carried(), dynamics=sdhj.Dynamics([[-1.0], [1.0]], drift, gain, [0.5, 0.5]))


def swell():
    """Carried by 0.25 m and back within one interval, between walls that are 2 m away from 0."""
    wall = sdhj.UnsafeSet((0,), lambda p, t: 2.0 - np.abs(p[:, 0]), name="wall")
    dynamics = sdhj.Dynamics([[0.0]], lambda q, u, t: u + 2.0 * np.sin(5.0 * np.pi * t) + 0.0 * q)
    return replace(surge(), dynamics=dynamics, unsafe=[wall])


def between():
    """In the plane between walls, some of which move: which inputs are clear is told for those of each axis alone."""
    walls = [
        sdhj.UnsafeSet((axis,), lambda p, t, pace=0.01 * axis: 1.5 + pace * t - np.abs(p[:, 0]), name=f"wall {axis}")
        for axis in (0, 1)
    ]
    return replace(plane(), unsafe=walls)


ROBOTS |= {"parked": (parked, (20, 20), 1), "veering": (veering, (20, 20), 1), "between": (between, (20, 20), 1)}
ROBOTS |= {"swell": (swell, (120,), 3)}
ROBOTS |= {"gusts on the left": (lambda: sheltered(-0.5, 0.0), (40, 20), 1)}
ROBOTS |= {"gusts on the right": (lambda: sheltered(0.0, 0.5), (40, 20), 1)}


def whole(name, values):
    """A field of the proof, of the cells or of the grid is other than it is."""
    of, field = name.split(" ")
    return head(lambda told: told[of].__setitem__(field, values))


def of_a_set(number, **fields):
    return head(lambda told: told["sets"][number].update(fields))


def fewer_rows(told, arrays):
    index = arrays["index"][()][:-1]
    put(arrays, index=index, pool=arrays["pool"][()][: index.max() + 1])


def arrives_everywhere(step):
    return edit("arrives", lambda marks: marks[step].fill(255))


def two_targets(told, arrays):
    told["sets"].insert(1, dict(told["sets"][0]))


def alike(told, arrays):
    """The sets of step 0, for all steps, though something moves on."""
    index = arrays["index"][()][:4]
    put(arrays, index=index, pool=arrays["pool"][()][: index.max() + 1])


def places_on_one_axis(told, arrays):
    told["proof"]["own"] = [False, True]
    for name in ("low", "high"):
        moves = arrays[name][()]
        middle = moves.reshape(1, 2, 20, -1, 2)[:, :, 10]
        put(arrays, **{name: middle})


def never_clear_of_the_last(told, arrays):
    """Of the last sets and ends that the file names apart, no input is said to be clear from anywhere."""
    *_, last = told["proof"]["clear"]
    size = int(np.prod([told["cells"]["shape"][k] for k in last["axes"]])) * -(-len(told["inputs"]) // 8)
    assert len(told["proof"]["clear"]) > 1 and arrays["clear"][-size:].any()
    arrays["clear"][-size:] = 0


def on_axes(*each):
    """What is clear is told of cells of fewer axes: what it was of the first cells on the others."""

    def forge(told, arrays):
        every, cells = first_clear(told, arrays["clear"][()]), told["cells"]["shape"]
        every, out = every.reshape(len(every), *cells, -1), []
        for axes, some, _ in each:
            few = tuple(slice(None) if k in axes else slice(1) for k in range(len(cells)))
            out.append(every[slice(None if some else 1), *few].ravel())
        put(arrays, clear=np.concatenate(out))
        told["proof"]["clear"] = [dict(zip(("axes", "sets", "ends"), one, strict=True)) for one in each]

    return both(nothing_in_sets, forge)


def of_clear(**entry):
    """What is clear is of other axes, sets or ends."""
    return head(lambda told: told["proof"]["clear"][0].update(entry))


def first_cell_leaves(told, arrays):
    """From the first cell of a line an input leads out: as if that were the target."""
    sets(lambda found: found[1:, 0].fill(True))(told, arrays)


def before_the_seam():
    """The ring, whose target ends at the seam: an image that begins before it ends elsewhere."""
    return replace(ring(), target=sdhj.TargetSet((0,), lambda p, t: 2.0 - p[:, 0]))


WAY_OUT = "without target and sensing"
DEPENDS, EVERY = "depend on no other", "every unsafe set"


def at_the_wall_to_a_cell(told, arrays):
    """From the layer at the lower wall coasting ends in the first cell above it; all other images are wide."""
    nothing_in_sets(told, arrays)
    edit("low", lambda moves: moves.fill(-30))(told, arrays)
    edit("high", lambda moves: (moves.fill(30), moves[0, 1, 0].put(1, 1)))(told, arrays)


def no_layers(told, arrays):
    del told["cells"]["layers"]


FORGERIES |= {
    "own as numbers": Forgery("growing", "axes of a place", whole("proof own", [1])),
    "no sets at all": Forgery(
        "line", "there must be sets", lambda told, arrays: put(arrays, index=arrays["index"][()][:0])
    ),
    "a block of no set": Forgery(
        "line", "pool must be kept", lambda told, arrays: put(arrays, pool=np.tile(arrays["pool"][()], (2, 1)))
    ),
    "sets of a step that is none": Forgery("cart", "sets for each step", fewer_rows),
    "sets alike while the target moves": Forgery("drifting", "sets for each step", alike),
    "arrivals of a tide": Forgery("tide", ARRIVE, arrives_everywhere(1)),
    "arrivals of a target that moves": Forgery("drifting", ARRIVE, arrives_everywhere(2)),
    "a wall on the way of an axis of no place": Forgery("carried", COVER, places_on_one_axis),
    "an axis on which rounding is no share": Forgery(
        "line", "upper ends must be 1e-120 above", head(lambda told: told["grid"].update(lower=[0.0], upper=[1e-323]))
    ),
    "an Unsafe set": Forgery("line", "must be a target", of_a_set(2, kind="Unsafe")),
    "a second target": Forgery("line", "must be a target", two_targets),
    "no input of a set": Forgery("forbidden", "inputs of an unsafe", of_a_set(1, inputs=[])),
    "inputs of a target": Forgery("line", "inputs of an unsafe", of_a_set(0, inputs=[0])),
    "truth values that are numbers": Forgery(
        "line",
        "given truth values",
        head(
            lambda told: told["formulas"]["functions"]["unsafe 0"].update(
                lines=["x 0", "const 0x1.0p+0", "where 0 1 0", "return 2"]
            )
        ),
    ),
    "a negative delta": Forgery("line", "delta ", head(lambda told: told.update(delta=-0.5))),
    "a delta that is true": Forgery("line", "delta ", head(lambda told: told.update(delta=True))),
    "two layers": Forgery("standing", "layers must be 0 or 1", whole("cells layers", [[0, 0], [2, 1]])),
    "less than no layer": Forgery("standing", "layers must be 0 or 1", whole("cells layers", [[0, 0], [-1, 1]])),
    "a layer where an axis closes, said so": Forgery(
        "standing", COVER, whole("cells periodic", [False, True]), becomes=lambda: standing(periodic=True)
    ),
    "the second of two posts in one": Forgery("two posts in one", CLEAR, clears(1, 69)),
    "layers that are cells": Forgery("standing", COVER, no_layers),
    "unsure of what is measured exactly": Forgery("line", "without a delay", whole("proof unsure", [0.1])),
    "unsure of less than the error on one axis": Forgery(
        "noisy", "predictions are off by", whole("proof unsure", [0.02, 0.01])
    ),
    "unsure of more than the error on one axis": Forgery(
        "noisy", "without a delay", whole("proof unsure", [0.02, 0.2])
    ),
    "a field of the grid": Forgery("line", "no unknown field", whole("grid offset", [0.0])),
    "a field of the cells": Forgery("line", "no unknown field", whole("cells first", [0])),
    "a field of a set": Forgery("line", "no unknown field", of_a_set(1, until=1.0)),
    "cells of an arm": Forgery("line", "those of a robot", whole("cells kind", "arms")),
    "a name that is none": Forgery("line", "a name must", of_a_set(1, name=7)),
    "two velocities": Forgery(
        "line",
        "be of velocities",
        head(lambda told: told["formulas"]["functions"].update(velocity=told["formulas"]["functions"]["drift"])),
    ),
    "sets for ever that are not": Forgery(
        "cart", "that hold for ever", head(lambda told: told["details"].update(endless=True))
    ),
    "endless in words": Forgery("cart", "endless must", head(lambda told: told["details"].update(endless="no"))),
    "a rail on too few axes": Forgery("cart", DEPENDS, on_axes(([0], [], [0]), ([1], [], [1]))),
    "inputs that are clear of the first wall alone": Forgery("between", NEARER, never_clear_of_the_last),
    "a cart on too few axes for its other inputs": Forgery("parked", DEPENDS, on_axes(([0], [], [0]), ([1], [], [1]))),
    "gusts on too few axes": Forgery("veering", DEPENDS, on_axes(([1], [], [1]))),
    "beside what is above, from where nothing has left": Forgery("lane", CLEAR, clears(0, 193)),
    "a lane on too few axes": Forgery("lane", DEPENDS, on_axes(([1], [0], []))),
    "a post on too few axes": Forgery("plane", DEPENDS, on_axes(([0], [0], [0]), ([1], [], [1]))),
    "a second wall on the axis of the first": Forgery("between", DEPENDS, of_clear(sets=[0, 1])),
    "ends on too few axes": Forgery("cart", DEPENDS, on_axes(([1], [], [0, 1]))),
    "a set less": Forgery("line", EVERY, of_clear(sets=[1])),
    "an end less": Forgery("line", EVERY, of_clear(ends=[])),
    "an axis that is unsafe at one end less": Forgery("standing unsafely", EVERY, of_clear(ends=[0])),
    "an end of another axis": Forgery("line", "ends that inputs are", of_clear(ends=[1])),
    "a set that is none": Forgery("line", "sets that inputs are", of_clear(sets=[0, 1, 2])),
    "an axis twice": Forgery("line", "axes that clear inputs", of_clear(axes=[0, 0])),
    "steps of clear inputs": Forgery("line", "no unknown field", of_clear(starts=1)),
    "clear inputs by name": Forgery("line", "clear must be a", whole("proof clear", {"axes": [0]})),
    "fewer clear inputs": Forgery(
        "line", "clear must be kept", lambda told, arrays: put(arrays, clear=arrays["clear"][()][:-1])
    ),
    "more clear inputs": Forgery(
        "line", "clear must be kept", lambda told, arrays: put(arrays, clear=np.tile(arrays["clear"][()], 2))
    ),
    "a way out with a target": Forgery(
        "line", WAY_OUT, both(whole("grid ends", [["safe", "safe"]]), clears(0, 0), first_cell_leaves)
    ),
    "a way out that is measured": Forgery("stream", WAY_OUT, head(lambda told: told.update(sensing={"error": 0.01}))),
    "inputs that begin before the last": Forgery(
        "line", "delay + 2 jitter", head(lambda told: told.update(sensing={"delay": 0.3, "jitter": 0.2}))
    ),
    "an arrival whose first half is in the target": Forgery("ring", ARRIVE, arrives(2, 119), becomes=before_the_seam),
    "a wall that nobody remembers": Forgery("noisy", MOVES, at_the_wall_to_a_cell, becomes=lambda: noisy(memory=False)),
    "a wall met on the way up and back": Forgery("swell", CLEAR, only_clear(0, 94)),
    "a gust from the left alone": Forgery("gusts on the left", MOVES, shifts("low", 1, place=9)),
    "a gust from the right alone": Forgery("gusts on the right", MOVES, shifts("high", -1, place=10)),
    "cells beyond the last": Forgery("line", "no cells that there", edit("pool", lambda pool: pool.fill(2**64 - 1))),
}


def only_from_step_1(told, arrays):
    """No set of step 0 has a cell, and those of step 1 are the first of which something is promised."""
    sets(lambda found: found[: told["steps"] + 1].fill(False))(told, arrays)


PROMISED = {  # on which promises rest, so that whoever verifies by default is told
    "a stronger push once step 0 is over": Forgery(
        "crossed", MOVES, only_from_step_1, becomes=lambda: crossed(push=0.3)
    ),
    "a move from where nothing is promised, by which a point is carried on": Forgery(
        "spread and remembered", MOVES, shifts("high", -2)
    ),
    "a post where two steps are to go": Forgery("line", CLEAR, becomes=lambda: line(posts=(-2.1, 3.0))),
    "sets of each step where nothing moves": Forgery("line", "there must be sets for each step", of_each_step),
}
FORGERIES |= PROMISED
