"""The share of the states that is promised shrinks with the error of measurement, the delay and the jitter.

The arm's case study and the car of the README, by grids and certified. What is promised to states (W of
`sdhj.problem.sensing`), within all steps, against one uncertainty while the other two are zero. Jitter asks for a
target that stands still: in its panel the arm's does, in the middle of its way.

Cells are few, so that a set is certified within seconds; on finer ones less of the difference to the grids is left.
Their number is moved to one that is aligned with all lengths of the problem (`sdhj.Certified`): for the arm 210 x 210
x 36 x 36 without uncertainty, and with some about half as many on each joint, so that its first step down is in part
the cells'.

A table says which error and which delay leave anything: anything at all, the target less what is uncertain about the
state; and anything beyond that, which takes steps that gain more than they blur.
"""

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from charts import METHOD_LOOKS, METHOD_NAMES
from common import Context, command_of
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import sdhj
from sdhj import plotting
from sdhj.arm.workspace import Disk, Still
from sdhj.common.findings import ProjectionWarning
from sdhj.common.remembering import FloatArray
from sdhj.problem.problem import ReachAvoidProblem

MAIN_JOB = False
ERRORS = (0.0, 0.004, 0.01, 0.02)  # m and rad, on each axis
INTERVALS = {"delay": (0.0, 0.2, 0.5, 1.0), "jitter": (0.0, 0.05, 0.12, 0.25)}  # shares of delta
LABELS = {
    "error": "error of each measurement (m, rad)",
    "delay": "delay $d / \\delta$",
    "jitter": "jitter $j / \\delta$",
}
RESTING = Disk(Still((0.09, 0.18)), 0.06)  # the middle of the target's way
ARM_CELLS = ((105, 105, 24, 24), (42, 42, 12, 12))  # the second for a quick look
CAR_CELLS, CAR_PARTS = ((100, 100, 76), (40, 40, 38)), 4
HALVINGS = 5
TOO_MUCH = "is known to within"  # in the words of the problem that refuses


def car() -> ReachAvoidProblem:
    """The README's."""

    def drift(q: FloatArray, u: FloatArray) -> FloatArray:
        return np.stack([u[0] * np.cos(q[:, 2]), u[0] * np.sin(q[:, 2]), np.full(len(q), u[1])], axis=1)

    return ReachAvoidProblem(
        grid=sdhj.Grid([-2, -2, -np.pi], [2, 2, np.pi], [41, 41, 32], periodic=[False, False, True]),
        dynamics=sdhj.Dynamics(
            [[speed, turn] for speed in (0.5, 1.0) for turn in (-2.0, 0.0, 2.0)],
            drift,
            [[1, 0], [0, 1], [0, 0]],
            [0.1, 0.1],
        ),
        target=sdhj.TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 1.2, p[:, 1] - 0.8) - 0.4),
        unsafe=[sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0], p[:, 1]) - 0.4, name="post")],
        delta=0.25,
        steps=8,
        name="car",
    )


@dataclass(frozen=True)
class Promise:
    """Shares of the grid's volume from step 0: within all steps, and of these without any."""

    share: float = 0.0
    at_once: float = 0.0

    @property
    def beyond(self) -> float:
        """What is promised to states that are not surely in the target already."""
        return self.share - self.at_once


def promised(problem: ReachAvoidProblem, method: Any, kind: str, size: float) -> Promise:
    """What is promised with an "error", a "delay" or a "jitter" of this much; nothing where the target is too small."""
    try:
        unsure = replace(problem, sensing=sdhj.Sensing(**{kind: size}, memory=False))
    except ValueError as refused:
        if TOO_MUCH not in str(refused):
            raise
        return Promise()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ProjectionWarning)  # an empty tube is what a sweep is for
        table = sdhj.solve(unsure, method, progress=False)
    return Promise(*(table.fraction(start=0, within=n) for n in (problem.steps, 0)))


def sweep_sensing(
    problem: ReachAvoidProblem,
    methods: Mapping[str, Any],
    kind: str,
    values: tuple[float, ...],
    perfect: dict[tuple[str, str], Promise],
) -> dict[str, list[Promise]]:
    """What is promised for each of `values`, by the name of the method; for none from `perfect`, or kept there."""
    found: dict[str, list[Promise]] = {}
    for name, method in methods.items():
        key = problem.digest, name
        if 0.0 in values and key not in perfect:
            perfect[key] = promised(problem, method, kind, 0.0)
        found[name] = [promised(problem, method, kind, value) if value else perfect[key] for value in values]
    return found


def largest(leaves: Callable[[float], bool], most: float, halvings: int = HALVINGS) -> tuple[float, float]:
    """Between which two values what is left ends: halving [0, most]; both `most` where all of it leaves something."""
    if leaves(most):
        return most, most
    low, high = 0.0, most
    for _ in range(halvings):
        middle = (low + high) / 2
        low, high = (middle, high) if leaves(middle) else (low, middle)
    return low, high


def limits(problem: ReachAvoidProblem, method: Any, kind: str, most: float) -> list[tuple[float, float]]:
    """As `largest`: what leaves anything of the target, which takes no solve, and what leaves anything beyond."""

    def fits(size: float) -> bool:
        try:
            replace(problem, sensing=sdhj.Sensing(**{kind: size}, memory=False))
        except ValueError as refused:
            if TOO_MUCH not in str(refused):
                raise
            return False
        return True

    first = largest(fits, most, 3 * HALVINGS)
    return [first, largest(lambda value: promised(problem, method, kind, value).beyond > 0, first[0])]


def value(context: Context) -> list[float]:
    """The shares promised to the car that measures exactly, and with an error."""
    return [promised(car(), "hji", "error", error).share for error in (0.0, 0.02)]


def draw(context: Context) -> Figure:
    thinned = slice(None, None, 3 if context.coarse else 1)
    certified = {
        "arm": sdhj.Certified(cells=ARM_CELLS[context.coarse]),
        "car": sdhj.Certified(cells=CAR_CELLS[context.coarse], parts=CAR_PARTS),
    }
    resting = sdhj.arm_case_study(nodes=context.nodes, target=RESTING)
    robots, perfect = {"arm": context.problem, "car": car()}, dict[tuple[str, str], Promise]()
    figure = plotting.new_figure(7.0, 3.4)
    for ax, kind in zip(figure.subplots(1, 3, sharey=True), LABELS, strict=True):
        for robot, problem in robots.items():
            problem = resting if (robot, kind) == ("arm", "jitter") else problem
            methods = {"hji": "hji"} | ({"projected": "projected"} if robot == "arm" else {})
            methods["certified"] = certified[robot]
            context.say(f"{robot}: sweeping {kind}")
            given = ERRORS[thinned] if kind == "error" else INTERVALS[kind][thinned]
            values = tuple(value * (1 if kind == "error" else problem.delta) for value in given)
            draw_promises(ax, robot, given, sweep_sensing(problem, methods, kind, values, perfect))
        ax.set(xlabel=LABELS[kind], ylim=(0, None))
        ax.set_title(
            {"jitter": "the arm's target at rest", "error": f"arm: {context.nodes} nodes an axis"}.get(kind, " ")
        )
        ax.grid(axis="y")
    figure.axes[0].set_ylabel("share of $\\mathcal{C}$ promised")
    figure.legend(handles=figure.axes[0].lines, loc="outside upper center", ncols=5)
    soon = {"arm": sdhj.arm_case_study(nodes=context.nodes, steps=2), "car": replace(robots["car"], steps=2)}
    for line in told_limits({} if context.coarse else soon):
        context.say(line)
    return figure


def draw_promises(ax: Axes, robot: str, values: tuple[float, ...], found: Mapping[str, list[Promise]]) -> None:
    """Shares promised against one uncertainty, a line for each method; the car's with hollow marks."""
    for method, promises in found.items():
        looks = METHOD_LOOKS[method] | ({"markerfacecolor": "white", "linewidth": 1.0} if robot == "car" else {})
        shares, label = [promise.share for promise in promises], f"{robot}, {METHOD_NAMES[method]}"
        ax.plot(values, shares, label=label, gid=f"{robot}-{method}", **looks)


def told_limits(robots: Mapping[str, ReachAvoidProblem]) -> list[str]:
    """Lines for robots that have 2 steps: what leaves anything, by finite differences on the problem's grid."""
    lines = []
    for robot, problem in robots.items():
        for kind, unit, most in (("error", "m, rad", 0.2), ("delay", "s", problem.delta)):
            ends = [f"{low:.4f}" if high - low < 1e-4 else f"{low:.4f} to {high:.4f}"
                    for low, high in limits(problem, "hji", kind, most)]  # fmt: skip
            lines.append(f"{robot}: the largest {kind} ({unit}) that leaves anything is {ends[0]},")
            lines.append(f"     anything beyond the target within 2 steps {ends[1]} (delta is {problem.delta:g} s)")
    return lines


if __name__ == "__main__":
    command_of(__file__)()
