"""The three games on a rail, in the plane of robot and pursuer."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from course.widgets import Numbers
from sdhj.kernels import FloatArray
from sdhj.plotting import draw_set, frame_slice, plane
from sdhj.plotting.looks import FULL_LOOKS, OUTCOME_INK
from sdhj.problem.grid import Grid

Games = Mapping[str, FloatArray]


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
