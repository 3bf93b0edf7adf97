"""Fig. 7: The optimal cost is at most 0 in the reach-avoid set; outside, some adversary defeats the input."""

import numpy as np
from boat import STARTS, OneStepGame, draw_lake, draw_one_step, one_step_legend, play, shown_game
from common import Context, command_of
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sdhj import plotting
from sdhj.plotting.looks import FULL_LOOKS, INK

LEVELS = (-0.1, 0.1, 0.2, 0.3, 0.4, 0.5)  # m; the zero level is drawn apart


def value(context: Context) -> float:
    """Share of the plane in the reach-avoid set."""
    game = shown_game()
    return game.problem.grid.fraction(game.cost <= 0)


def draw(context: Context) -> Figure:
    figure, game = plotting.new_figure(7.0, 3.3), shown_game()
    left, right = figure.subplots(1, 2, sharey=True)
    starts = [(label, play(game.problem, start)) for label, start in STARTS]
    draw_one_step(left, game, show="reach-avoid", starts=starts)
    draw_cost(right, game)
    left.set_title("(a) runs from three states")
    right.set_title("(b) optimal cost $V^j$ (m): 0 bold, more dashed")
    right.set_ylabel("")
    figure.legend(handles=one_step_legend("reach-avoid"), loc="outside upper center", ncols=3)
    return figure


def draw_cost(ax: Axes, game: OneStepGame) -> None:
    """Contours of the optimal cost V^j of Eq. (6), each with its number, over target and unsafe set.

    The zero level, bold, bounds the reach-avoid set; greater levels are dashed.
    """
    where = draw_lake(ax, game)
    cost = where.of(game.problem.grid, game.cost)
    plotting.draw_set(ax, where, cost, FULL_LOOKS | {"linewidth": 2.0}, "reach-avoid", zorder=1.0)
    looks = {"levels": LEVELS, "colors": [INK], "linewidths": 0.7, "zorder": 4.0}
    shown = np.ix_(*(np.digitize(c, lim) == 1 for c, lim in ((where.y, ax.get_ylim()), (where.x, ax.get_xlim()))))
    x, y = np.meshgrid(where.x, where.y)  # what is not seen has no part in where numbers stand
    dashes = ["--" if level > 0 else "-" for level in LEVELS]
    lines = ax.contour(x[shown], y[shown], cost[shown], linestyles=dashes, **looks)
    lines.set_gid("cost")
    for text in ax.clabel(lines, fontsize=6.5, fmt="%.1f"):
        text.set(zorder=4.5, bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.4})


if __name__ == "__main__":
    command_of(__file__)()
