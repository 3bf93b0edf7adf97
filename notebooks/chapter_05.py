"""Pictures of the three games on a rail, in the plane of robot and pursuer; the games are the reader's own."""

from collections.abc import Callable, Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from widgets import Explorer, Numbers, choice, slider

from sdhj.kernels import FloatArray
from sdhj.plotting import draw_set, frame_slice, plane
from sdhj.plotting.looks import FULL_LOOKS, OUTCOME_INK
from sdhj.problem.grid import Grid

Games = Mapping[str, FloatArray]
HELD = {"to the left": -0.8, "none": 0.0, "to the right": 0.8}  # m/s


def draw_games(figure: Figure, rail: Grid, games: Games, joint: FloatArray | None = None) -> Numbers:
    """The won set of each game in the plane of robot and pursuer; the last one with the joint game's edge dashed."""
    axes = np.atleast_1d(figure.subplots(1, len(games), sharey=True))
    where = plane(rail, (0.0, 0.0), resolution=161)
    for ax, (title, values) in zip(axes, games.items(), strict=True):
        whole = np.broadcast_to(values, rail.shape)
        draw_set(ax, where, where.of(rail, np.ascontiguousarray(whole)), FULL_LOOKS, title, zorder=1.0)
        frame_slice(ax, rail)
        ax.set(aspect="equal", title=title)
    if joint is not None:
        edge = {"colors": OUTCOME_INK, "linewidths": 1.2, "linestyles": "--"}
        axes[-1].contour(where.x, where.y, where.of(rail, joint), levels=[0.0], zorder=3, **edge)
    for ax in axes[1:]:
        ax.set_ylabel("")
    return {title: rail.fraction(np.broadcast_to(values, rail.shape) <= 0) for title, values in games.items()}


def draw_wrong_union(ax: Axes, rail: Grid, right: FloatArray, wrong: FloatArray) -> None:
    """What is won (blue), and what is claimed besides if sets are united before they are intersected (orange)."""
    where = plane(rail, (0.0, 0.0), resolution=201)
    claimed = {"facecolor": "#d9480f", "edgecolor": "#8a2b06", "linewidth": 0.8}
    draw_set(ax, where, where.of(rail, wrong), claimed, "claimed", zorder=1.0)
    draw_set(ax, where, where.of(rail, right), FULL_LOOKS, "won", zorder=2.0)
    frame_slice(ax, rail)
    ax.set_aspect("equal")


def explore_games(rail: Grid, games: Callable[..., tuple[Games, FloatArray]]) -> Explorer:
    """Three games and their intersection, with the joint game beside it; `games` is the reader's."""

    def draw(figure: Figure, held: str, v_d: float, v_p: float, delta: float) -> Numbers:
        return draw_games(figure, rail, *games(HELD[held], v_d, v_p, delta))

    controls = {
        "held": choice("input held", tuple(HELD), "to the right"),
        "v_d": slider("disturbance, at most (m/s)", 0.0, 0.4, 0.05, 0.1, live=False),
        "v_p": slider("pursuer, at most (m/s)", 0.0, 1.0, 0.05, 0.4, live=False),
        "delta": slider("length of the interval (s)", 0.05, 0.6, 0.05, 0.3, live=False),
    }
    alt = "Won sets of games 1, 2 and 3 on a rail, their intersection, and the joint game's edge"
    return Explorer(draw, controls, size=(9.2, 2.8), slow=True, alt=alt, motion="delta")
