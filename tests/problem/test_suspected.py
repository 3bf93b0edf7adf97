"""What is unusual in a problem is said aloud, once, with what to write; what is usual is not."""

import numpy as np
import pytest
from fleet import FLEET
from zoo import torus_problem, unicycle_problem

import sdhj
from sdhj.common.findings import ResolutionWarning, tell
from sdhj.solver.findings import suspicions

PI = np.pi


def car(low, high, *, turn=1.0, unit=1.0, **changed):
    """A car in the plane; `unit` is that of its heading, in radians, and `turn` its rate, in units per second."""

    def drift(q, u):
        return np.stack([np.cos(unit * q[:, 2]), np.sin(unit * q[:, 2]), np.full(len(q), u[0])], axis=1)

    usual = {"lower": [-2.0, -2.0, low], "upper": [2.0, 2.0, high], "nodes": [21, 21, 32], "periodic": None}
    usual |= {"ends": None, "names": ["x", "y", "heading"], "unsafe": [], "delta": 0.25, "steps": 2}
    return unicycle_problem((-turn, 0.0, turn), **usual | {"drift": drift} | changed)


def outside(p, t):
    return 0.5 - np.hypot(p[:, 0], p[:, 1])


RING = {"periodic": [False, False, True]}
SUSPECT = {
    "degrees": (lambda: car(-180.0, 180.0, **RING), "along heading.*57.3 turns"),
    "degrees, bounded": (lambda: car(0.0, 90.0), "along heading.*14.3 turns"),
    "no periodic": (lambda: car(-PI, PI), "heading is a whole turn.*periodic=.*heading"),
    "no end": (lambda: car(0.0, 2 * PI * 31 / 32), "heading is a whole turn"),
    "no periodic, in degrees": (lambda: car(0.0, 360.0, unit=PI / 180), "heading is a whole turn"),
    "rates": (lambda: car(-PI, PI, turn=90.0, **RING), "heading by 3.58 turns.*0.25 s"),
    "milliseconds": (lambda: car(-PI, PI, delta=250.0, **RING), "heading by 39.8 turns.*seconds"),
    "sign": (
        lambda: car(-PI, PI, target=sdhj.TargetSet((0, 1), outside), **RING),
        r"target 'target'.*9\d.\d%.*turn the sign",
    ),
}
USUAL = {
    "a car": lambda: car(-PI, PI, **RING),
    "in degrees": lambda: car(-180.0, 180.0, unit=PI / 180, turn=60.0, **RING),
    "stops at a whole turn, said": lambda: car(-PI, PI, ends="unsafe"),
    "stops at a whole turn, not periodic, said": lambda: car(-PI, PI, periodic=[False] * 3),
    "stops before a turn": lambda: car(-2.5, 2.5),
    "stops after two turns": lambda: car(-2 * PI, 2 * PI),
    "half a plane": lambda: car(-PI, PI, target=sdhj.TargetSet((0, 1), lambda p, t: p[:, 0] - 1.0), **RING),
    "a corner out": lambda: car(
        -PI, PI, target=sdhj.TargetSet((0, 1), lambda p, t: 0.5 - np.hypot(p[:, 0] - 2, p[:, 1] - 2)), **RING
    ),
    "an arm": lambda: sdhj.arm_case_study(nodes=13, steps=2),
    "an evader": lambda: sdhj.evader_case_study(nodes=13, steps=2),
    "a torus": torus_problem,
    "a unicycle": unicycle_problem,
} | {name: lambda make=make: make().problem() for name, make in FLEET.items()}


@pytest.mark.parametrize("name", SUSPECT)
def test_what_is_unusual_is_said(name):
    make, says = SUSPECT[name]
    (said,) = suspicions(make())
    with pytest.warns(ResolutionWarning, match=says):
        tell(said)


@pytest.mark.parametrize("name", USUAL)
def test_what_is_usual_is_not(name):
    assert not list(suspicions(USUAL[name]()))


def test_a_solve_says_it_whatever_the_method():
    make, says = SUSPECT["no periodic"]
    for method in ("hji", "certified"):
        with pytest.warns(ResolutionWarning, match=says):
            sdhj.solve(make(), sdhj.Certified(cells=[8, 8, 8]) if method == "certified" else method, play=False)
