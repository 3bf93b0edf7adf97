"""The arm's level sets as formulas: how long they are, that they are the functions, that their bounds hold."""

import itertools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sdhj.arm.case_studies import arm_case_study, evader_case_study, scene
from sdhj.arm.workspace import KINEMATICS, Circle, Disk, Line, Segment, Still
from sdhj.formulas.formula import Formula
from sdhj.formulas.graph import ordered

ROUNDING = 1e-14  # what the values, and the bounds at a point, may differ by: some units of 1e-16 for each operation


def formula(function: Callable[..., Any], coordinates: int, parameters: int = 1) -> Formula:
    return Formula.read("level_set", function, coordinates, *["t", "t0 t1"][parameters - 1].split())


def check(
    function: Callable[..., Any], read: Formula, low: Any, high: Any, times: Sequence[float], rng: np.random.Generator
) -> None:
    """Values of a formula are the function's, and lie within its bounds over boxes."""
    corners = rng.uniform(low, high, (400, read.coordinates))
    for width in (0.0, 1e-3, 0.1):
        inside = corners + width * rng.random(corners.shape)
        values = function(inside, *times)
        assert_allclose(read(inside, *times), values, rtol=0, atol=ROUNDING)
        least, greatest = read.bounds(corners, corners + width, *zip(times, times, strict=True))
        assert (least - ROUNDING <= values).all() and (values <= greatest + ROUNDING).all()
        bound = read.coordinates * width * 2.0 + ROUNDING
        assert np.median(greatest - least) <= bound


@pytest.mark.slow
@pytest.mark.parametrize("kinematics", KINEMATICS)
def test_level_sets_are_short_formulas(kinematics: str, rng: np.random.Generator) -> None:
    view = scene(arm_case_study(7, kinematics=kinematics))
    for function, axes, most in (
        (view.obstacles_value, 2, 110),
        (view.obstacles_swept_value, 2, 320),
        (view.pursuer_value, 4, 40),
        (view.target_value, 2, 30),
        (scene(evader_case_study(7, kinematics=kinematics)).evader_value, 4, 25),
    ):
        read = formula(function, axes, 2 if function == view.obstacles_swept_value else 1)
        assert len(ordered(read.outputs)) <= most
        assert read.depends_on_time == (axes == 2) and read.reads.all()
        times = [(0.3,), (0.3, 0.4)][read.parameters - 1]
        check(function, read, [-3.1, -3.1, -0.36, -0.36][:axes], [3.1, 3.1, 0.36, 0.36][:axes], times, rng)


@pytest.mark.parametrize(
    "path",
    [
        Still((0.1, -0.2)),
        Line((0.24, -0.02), (-0.1, 0.12)),
        Line((0.1, 0.1), (0.0, 0.0)),
        Circle((0.0, -0.2), 0.1, -2.0),
    ],
    ids=["still", "line", "line that stays", "circle"],
)
def test_what_a_disk_sweeps_is_at_most_its_distance_at_every_time(path: Any, rng: np.random.Generator) -> None:
    """Also for the point robot of the course, whose segments are points; bounds hold over intervals of time, too."""
    disk = Disk(path, 0.05)
    away = formula(lambda points, t: np.linalg.norm(points - disk.centre(t), axis=1) - 0.05, 2)
    over = formula(lambda points, t0, t1: path.swept_distance(Segment.point(points), t0, t1) - 0.05, 2, 2)
    points = rng.uniform(-0.5, 0.5, (500, 2))
    swept = over(points, 0.2, 0.9)
    each = np.array([away(points, t) for t in np.linspace(0.2, 0.9, 401)])
    assert (swept <= each.min(axis=0) + ROUNDING).all()
    assert (swept >= each.min(axis=0) - disk.speed * 0.7 / 400 / 2 - ROUNDING).all()
    for (t0, t1), (t2, t3) in itertools.combinations([(0.2, 0.3), (0.25, 0.6), (0.0, 0.0)], 2):
        begins, ends = sorted([t0, t2]), sorted([t1, t3])
        least, greatest = over.bounds(points, points, (begins[0], begins[1]), (ends[0], ends[1]))
        for times in ((t0, t1), (t2, t3)):
            assert (least <= over(points, *times) + ROUNDING).all() and (
                over(points, *times) <= greatest + ROUNDING
            ).all()
