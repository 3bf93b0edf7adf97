"""A joint with a limited motor, live."""

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from course.draw.tracking import draw_tracking
from course.widgets import Explorer, Numbers, slider

PATTERN = np.array([1.0, -1.0, -1.0, 1.0, 0.0, 1.0, -1.0, 1.0])  # of the largest speed


def explore_tracking(follow: Callable[..., tuple[Any, ...]], expected: Callable[[float, float], float]) -> Explorer:
    """How far a joint is from its reference: `follow` simulates it, `expected` is the formula."""

    def draw(figure: Figure, torque: float, u_max: float, ratio: float) -> Numbers:
        formula = expected(2 * u_max, torque)
        times, *ways, torques = follow(u_max * PATTERN[None], torque, ratio=ratio)
        reference, angle = (way[0] for way in ways)
        apart = draw_tracking(figure, times, reference, angle, torques[0], formula)
        return {"largest distance (rad)": apart, "formula (17.2)": formula}

    controls = {
        "torque": slider("torque (N m)", 0.5, 8.0, 0.5, 4.0),
        "u_max": slider("speed u (rad/s)", 0.5, 3.0, 0.5, 2.0),
        "ratio": slider("damping ratio", 0.5, 4.0, 0.5, 2.5),
    }
    alt = "A joint, its reference, how far they are apart, and the torque of its motor"
    return Explorer(draw, controls, size=(7.0, 4.6), alt=alt, motion="torque")
