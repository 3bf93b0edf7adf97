"""What is read of a file: numbers it lets in, and the cells that an image may overlap."""

import itertools
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest
from naive_certified import CIRCLE, STILL
from naive_certified import sensing as certain

from sdhj.certified.check.arm.claims import PI, Scene, overlapped
from sdhj.certified.check.reading import edges_of


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
