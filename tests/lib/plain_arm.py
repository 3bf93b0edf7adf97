"""The arm's case study in plain NumPy, which intervals go through; `sdhj.arm` has compiled functions of it."""

from dataclasses import replace
from typing import Any

import numpy as np

import sdhj
from sdhj.arm.case_studies import OBSTACLES, TARGET
from sdhj.arm.workspace import Circle, Line

LENGTH, HALF_WIDTH, PURSUER = 0.15, 0.01, 0.04


def gap(cos: Any, sin: Any, x: Any, y: Any) -> Any:
    """Distance of (x, y) from a link at the origin: seen from the link, so that each coordinate occurs once."""
    along, across = cos * x + sin * y, cos * y - sin * x
    return np.hypot(along - np.clip(along, 0.0, LENGTH), across)


def clearance(q: Any, x: Any, y: Any) -> Any:
    """Distance from the links to points; that from the second in two frames, of which the larger bound holds."""
    first, second, both = q[:, 0], q[:, 1], q[:, 0] + q[:, 1]
    cos, sin = np.cos(first), np.sin(first)
    along, across = cos * x + sin * y, cos * y - sin * x
    one = gap(np.cos(both), np.sin(both), x - LENGTH * cos, y - LENGTH * sin)
    other = gap(np.cos(second), np.sin(second), along - LENGTH, across)
    return np.minimum(gap(cos, sin, x, y), np.maximum(one, other)) - HALF_WIDTH


def on_path(path: Any, t: Any) -> Any:
    if isinstance(path, Line):
        return path.start[0] + path.velocity[0] * t, path.start[1] + path.velocity[1] * t
    if isinstance(path, Circle):
        angle = path.rate * t + path.phase
        return path.centre[0] + path.radius * np.cos(angle), path.centre[1] + path.radius * np.sin(angle)
    return path.centre


def plain_arm(**options: Any) -> sdhj.ReachAvoidProblem:
    """The case study without its recipe: nothing tells that it is an arm."""

    def target(q: Any, t: Any) -> Any:
        x, y = on_path(TARGET.path, t)
        tip = [LENGTH * (turn(q[:, 0]) + turn(q[:, 0] + q[:, 1])) for turn in (np.cos, np.sin)]
        return np.hypot(tip[0] - x, tip[1] - y) - TARGET.radius

    unsafe = [sdhj.UnsafeSet((0, 1, 2, 3), lambda q, t: clearance(q, q[:, 2], q[:, 3]) - PURSUER, name="pursuer")]
    for k, disk in enumerate(OBSTACLES):
        apart = lambda q, t, disk=disk: clearance(q, *on_path(disk.path, t)) - disk.radius  # noqa: E731
        unsafe.append(sdhj.UnsafeSet((0, 1), apart, name=f"disk {k}"))
    problem = sdhj.arm_case_study(**options)
    return replace(problem, target=sdhj.TargetSet((0, 1), target), unsafe=unsafe, recipe={})
