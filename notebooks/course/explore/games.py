"""The three games on a rail, live, by the reader's own functions."""

from collections.abc import Callable

from matplotlib.figure import Figure

from course.draw.games import Games, draw_games
from course.widgets import Explorer, Numbers, choice, slider
from sdhj.kernels import FloatArray
from sdhj.problem.grid import Grid

HELD = {"to the left": -0.8, "none": 0.0, "to the right": 0.8}  # m/s


def explore_games(rail: Grid, games: Callable[..., tuple[Games, FloatArray]]) -> Explorer:
    """Three games and their intersection, with the joint game beside it; `games` is the reader's."""

    def draw(figure: Figure, held: str, v_d: float, v_p: float, delta: float) -> Numbers:
        return draw_games(figure, rail, *games(HELD[held], v_d, v_p, delta))

    controls = {
        "held": choice("input held", tuple(HELD), "to the right"),
        "v_d": slider("disturbance, at most (m/s)", 0.0, 0.4, 0.05, 0.1, live=False),
        "v_p": slider("pursuer, at most (m/s)", 0.0, 1.0, 0.05, 0.4, live=False),
        "delta": slider("length of the interval (s)", 0.03, 0.6, 0.03, 0.3, live=False),
    }
    alt = "Won sets of games 1, 2 and 3 on a rail, their intersection, and the joint game's edge"
    return Explorer(draw, controls, size=(9.2, 2.8), slow=True, alt=alt, motion="delta")
