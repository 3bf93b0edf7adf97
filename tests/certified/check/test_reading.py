"""What is read of a file: numbers it lets in, and the cells that an image may overlap."""

import itertools
import json
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest
from naive_certified import CIRCLE, LINE, SMALL, STILL, TARGET
from naive_certified import sensing as certain

import sdhj
from sdhj.certified.check.arm.claims import PI, Scene, overlapped
from sdhj.certified.check.arm.recipe import expect_recipe
from sdhj.certified.check.reading import edges_of
from sdhj.certified.check.sampled import InMemory
from sdhj.certified.check.stated import Problem
from sdhj.table.files import make_head


def test_numbers_beyond_the_bound_on_rounding_are_refused(recipe):
    far = STILL | {"path": {"kind": "still", "centre": [20.0, 0.0]}}
    fast = CIRCLE | {"path": CIRCLE["path"] | {"rate": 1000.0}}
    for changes in (
        {"obstacles": [far]},
        {"obstacles": [fast]},
        {"target": far},
        {"u_max": 150.0},
        {"lengths": [11.0, 1.0]},
        {"lengths": [0.15, 0.0]},
    ):
        scene = Scene(recipe | {"arguments": recipe["arguments"] | changes}, certain())
        with pytest.raises(ValueError, match="bound on rounding"):
            scene.world((np.linspace(-1, 1, 9),) * 4)


def other(disk, **path):
    """A disk with another radius, or on another path."""
    return disk | {"path": disk["path"] | path} if path else disk | {"radius": disk["radius"] + 1e-3}


AMONG = [STILL, LINE, CIRCLE]
OTHERS = {
    **{"half_width": 0.011, "u_max": 4.1, "v_d_max": 2.1, "delta": 0.11, "steps": 3, "input_levels": 2},
    **{"lengths": (0.15, 0.151), "kinematics": "printed"},
}
PATHS = {  # an obstacle, and what is other of it
    "its radius": (0, {}),
    "where it is": (0, {"centre": [-0.22, 0.101]}),
    "where it begins": (1, {"start": [0.241, -0.02]}),
    "how fast it goes": (1, {"velocity": [-0.6, 0.71]}),
    "its circle": (2, {"radius": 0.071}),
    "how fast it turns": (2, {"rate": 9.1}),
    "where it turns": (2, {"phase": -0.99}),
}


@pytest.mark.parametrize("built", ["relative", "printed", "evader"])
def test_a_head_is_what_its_recipe_makes_and_no_other(built):
    """At any time; each number of the recipe and of the disks by itself."""
    agent, own = ("evader", {"v_e_max": 0.3, "evader_radius": 0.14}) if built == "evader" else ("pursuer", {})
    small = {name: one for name, one in SMALL.items() if built != "evader" or name not in ("target", "v_p_max")}
    kinematics = {} if built == "evader" else {"kinematics": built}
    make = sdhj.evader_case_study if built == "evader" else sdhj.arm_case_study
    problem = make(**small | own | kinematics | {"obstacles": AMONG})
    head = json.loads(json.dumps(make_head(problem, "certified", {}, problem.digest)))
    robot, made = Problem(head, InMemory({}), None), head["recipe"]
    expect_recipe(robot, Scene(made, robot))
    changes = OTHERS | {f"{agent}_radius": 0.139, f"v_{agent[0]}_max": 0.61, f"{agent}_box": 0.361}
    changes["kinematics"] = "relative" if made["arguments"]["kinematics"] == "printed" else "printed"
    each = [{name: one} for name, one in changes.items()] + [{"obstacles": AMONG[:2]}, {"obstacles": []}]
    each += [{"obstacles": [*AMONG[:at], other(AMONG[at], **path), *AMONG[at + 1 :]]} for at, path in PATHS.values()]
    if built != "evader":
        each += [{"target": other(TARGET)}, {"target": other(TARGET, velocity=[0.1, -0.06])}]
    for change in each:
        with pytest.raises(ValueError, match="of its recipe"):
            expect_recipe(robot, Scene(made | {"arguments": made["arguments"] | change}, robot))


@pytest.mark.parametrize("sensing", [{}, {"error": [0.02, 0.0, 0.01, 0.0], "delay": 0.03, "jitter": 0.01}])
@pytest.mark.parametrize("axis", [0, 2])
def test_image_lists_hold_every_end(axis, sensing, recipe, rng):
    """Exact end states of random starts, and of the cells' ends, lie in the listed cells; and no list is idly long."""
    recipe["arguments"]["target"] = STILL  # as jitter needs
    scene = Scene(recipe, certain(**sensing))
    push = Fraction(str(recipe["arguments"]["v_d_max" if axis == 0 else "v_p_max"]))
    off, late = Fraction(0), Fraction(0)
    if sensing:
        off, late = Fraction(2 - axis // 2, 100) + Fraction(3, 100) * push, Fraction(1, 50)
    size = 2 * PI[1] if axis == 0 else 2 * scene.box
    n, width = 23, size / 23 + Fraction(1, 10**4)
    file = SimpleNamespace(scene=scene, counts=(n,) * 4, axes=[(0, width, size, size)] * 4)
    slow, fast = Fraction(-17, 10), Fraction(23, 10)
    lists = overlapped(axis, file, slow, fast)
    delta = Fraction(str(scene.given["delta"]))
    for cell, listed in enumerate(lists):
        high = min((cell + 1) * width, size)
        found = set()
        for a, b in [*itertools.product((0, 1), repeat=2), *rng.integers(0, 10**6, (20, 2)).tolist()]:
            scale = 1 if a in (0, 1) and b in (0, 1) else 10**6
            end = (
                cell * width
                + Fraction(a, scale) * (high - cell * width)
                + (slow + Fraction(b, scale) * (fast - slow)) * (delta + (-1) ** (a + b < scale) * late)
                + 2 * off * (-1) ** (b < scale / 2)
            )
            end = end % size if axis == 0 else min(max(end, Fraction(0)), size)
            if end % width == 0 and (a, b) == (1, 1):  # an edge that is shared with the next cell
                continue
            found.add(min(int(end // width), n - 1))
        assert found <= set(listed)
        span = (high - cell * width + (fast - slow) * (delta + late) + 4 * off) / width
        assert len(listed) <= span + 2
        begin, end = cell * width + slow * (delta + late) - 2 * off, high + fast * (delta + late) + 2 * off
        laps = [lap * size for lap in range(-2, 3)] if axis == 0 else [0]
        assert listed == [m for m in range(n) if any(begin < (m + 1) * width + t and m * width + t < end for t in laps)]


def test_edges_are_the_floats_nearest_to_fractions(rng):
    for _ in range(200):
        below, powers, numbers = rng.integers(1, 10**9, 3).tolist(), rng.integers(1, 30, 3).tolist(), range(2, 90)
        low, width, more = (Fraction(a - 5 * 10**8, 7**b * 10**9) for a, b in zip(below, powers, strict=True))
        axis = low, abs(width) + Fraction(1, 10 ** (10 * powers[0])), abs(more), abs(more) + Fraction(1, 10**20)
        cells, layers = int(rng.choice(numbers)), rng.integers(0, 2, 2).tolist()
        inner = [float(low + i * axis[1]) for i in range(cells - sum(layers))]
        ends = [float(low)] * layers[0] + inner + [float(low + (axis[2] + axis[3]) / 2)] * (1 + layers[1])
        assert edges_of(cells, axis, layers).tolist() == ends
