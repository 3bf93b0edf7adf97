"""The value function on a line, live, by the reader's own functions."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from course.draw.values import draw_games_on_a_line
from course.widgets import Explorer, Numbers, choice, slider


def explore_value(model: Callable[..., Mapping[str, Any]]) -> Explorer:
    """The value of a start, by trying signals and from the equation; `model` is the reader's, with these arguments."""

    def draw(figure: Figure, game: str, start: float, v_max: float, duration: float) -> Numbers:
        shown = model(game=game, start=start, v_max=v_max, duration=duration)
        draw_games_on_a_line(figure, shown)
        values = list(shown["curves"].values())[-1]
        return {
            "costliest run tried": float(np.max(shown["costs"])),
            "value from the equation": float(np.interp(start, shown["x"], values)),
        }

    controls = {
        "game": choice("game", ("reach", "avoid", "reach-avoid"), "reach-avoid"),
        "start": slider("start x (m)", -1.2, 1.0, 0.02, -0.1),
        "v_max": slider("adversary, at most (m/s)", 0.0, 0.8, 0.05, 0.25),
        "duration": slider("length of the interval (s)", 0.1, 1.0, 0.05, 0.6),
    }
    return Explorer(draw, controls, alt="Runs against many signals, and the value function on a line", motion="v_max")
