"""Whether the recipe of a case study, of which an arm's claims are, makes the robot that its file describes.

Numbers are compared with those of the recipe, and the formulas of the sets, at some states, with distances worked out
here: the digest of a file is of what its head describes, and the proof of what its recipe says.
"""

from typing import Any

import numpy as np

from sdhj.certified.check.arm.bits import Array
from sdhj.certified.check.reading import expect
from sdhj.certified.check.stated import Problem

CLOSE = 1e-9  # m, rad, m/s: more than rounding makes of numbers up to 100 (`refuse_large`)
STATES = 300


def expect_recipe(robot: Problem, scene: Any) -> None:
    """Raise ValueError unless what a head describes is the arm of the recipe that `scene`, a `Scene`, was made of."""
    given = scene.given
    inputs, box = np.array(scene.inputs(), dtype=np.float64), float(scene.box)
    upper = np.array([np.pi, np.pi, box, box])
    same = (robot.delta, robot.steps) == (given["delta"], given["steps"]) and robot.ndim == 4
    same = same and near(robot.inputs, inputs) and near(robot.upper, upper) and near(robot.lower, -upper)
    same = same and robot.periodic.tolist() == [True, True, False, False] and robot.ends[2:] == [["wall"] * 2] * 2
    expect(same, "numbers of the head must be those of its recipe", given)
    still = np.zeros((4, 1))
    push = np.array([float(scene.push(axis)) for axis in range(4)])
    # At rest and at time 0 alone: that velocities depend on neither is asked below.
    for j, u in enumerate(inputs):
        ends = [end[:, 0] for end in robot.velocity(j, still, still, (0.0, 0.0), True)]
        same = same and all(near(end, [*u, 0.0, 0.0] + way * push) for way, end in zip((-1, 1), ends, strict=True))
    same = same and not robot.timed and not any(one.reads("x") for each in robot.of.values() for one in each)
    expect(same, "velocities of the head must be those of its recipe", given)
    target, unsafe = robot.target, robot.unsafe
    # in the order of the case study's sets (`_sets`): target, obstacles, pursuer
    own = [lambda q, t: obstacles(q, t, scene)] * bool(len(scene.disks))
    own += [lambda q, t: arm_to(q, q[:, 2:], scene) - (given["pursuer_radius"] + given["half_width"])] * chased(scene)
    parts: list[Any] = [target, *unsafe]
    same = target is not None and len(unsafe) == len(own) and all(one.inputs is None for one in unsafe)
    expect(same, "sets of the head must be those of its recipe", len(unsafe))
    states: Array = np.random.default_rng(0).uniform(-upper, upper, (STATES, 4))
    for part, value in zip(parts, (lambda q, t: target_value(q, t, scene), *own), strict=True):
        for t in np.linspace(0.0, given["delta"] * given["steps"], 5).tolist():
            least, most = part.function.bounds(*[states[:, list(part.axes)]] * 2, (t, t))
            same = near(least[:, 0], value(states, t)) and near(most[:, 0], value(states, t))
            expect(same, f"the set {part.called} of the head must be that of its recipe", t)


def near(one: Any, other: Any) -> bool:
    """Whether two arrays have as many entries and a last axis as long, and differ by less than `CLOSE`."""
    one, other = np.asarray(one, dtype=np.float64), np.asarray(other, dtype=np.float64)
    return one.shape[-1:] == other.shape[-1:] and one.size == other.size and bool((np.abs(one - other) < CLOSE).all())


def chased(scene: Any) -> bool:
    """Whether the adversary is a pursuer, which the arm must not touch, and not an evader."""
    return bool(scene.agent == "pursuer")


def joints(q: Array, scene: Any) -> tuple[Array, Array]:
    """The elbow and the tip of the arm at states (M, 4): both (M, 2), m."""
    first, second = scene.given["lengths"]
    relative = scene.given["kinematics"] == "relative"  # else Eq. (8) as printed: l1 + l2, and the angle q2
    turned, length = q[:, 1] + q[:, 0] * relative, second + first * (not relative)
    elbow = first * np.stack([np.cos(q[:, 0]), np.sin(q[:, 0])], axis=1)
    return elbow, elbow + length * np.stack([np.cos(turned), np.sin(turned)], axis=1)


def arm_to(q: Array, places: Array, scene: Any) -> Array:
    """The distance of places (M, 2) from the nearest link of the arm at states (M, 4): (M,), m."""
    elbow, tip = joints(q, scene)
    return np.minimum(to_link(0.0 * elbow, elbow, places), to_link(elbow, tip, places))


def to_link(begin: Array, end: Array, places: Array) -> Array:
    """The distance of places from segments that go from `begin` to `end`, (M, 2) each: (M,); NaN for no length."""
    along = end - begin
    share = ((places - begin) * along).sum(axis=1) / (along**2).sum(axis=1)
    return np.asarray(np.hypot(*(begin + np.clip(share, 0.0, 1.0)[:, None] * along - places).T))


def centre(disk: Array, t: float) -> Array:
    """The centre (2,) of a disk (8,), as `separation.disk_at` reads it, at time t, s."""
    x, y, vx, vy, radius, rate, phase, _ = disk
    return np.array([x + vx * t + radius * np.cos(rate * t + phase), y + vy * t + radius * np.sin(rate * t + phase)])


def obstacles(q: Array, t: float, scene: Any) -> Array:
    """The distance of the arm at states (M, 4) from the nearest obstacle at time t, less the radius: (M,), m.

    Obstacles are grown by the links' width, so it is <= 0 where the arm meets one.
    """
    each = [arm_to(q, centre(disk, t) + 0.0 * q[:, 2:], scene) - disk[7] for disk in scene.disks]
    return np.asarray(np.min(each, axis=0))


def target_value(q: Array, t: float, scene: Any) -> Array:
    """The distance of the tip at states (M, 4) from the target's centre at time t, less its radius: (M,), m."""
    at = centre(scene.target, t) if chased(scene) else q[:, 2:]
    return np.asarray(np.hypot(*(joints(q, scene)[1] - at).T) - scene.target[7])
