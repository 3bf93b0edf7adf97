"""Fig. 7: reach-avoid set, the cost's zero level, defeating adversaries."""

import numpy as np
from boat import STARTS, OneStepGame, draw_lake, draw_one_step, one_step_legend, play, shown_game
from common import Context, command_of
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sdhj import plotting
from sdhj.plotting.looks import FULL_LOOKS


def draw(context: Context) -> Figure:
    figure, game = plotting.new_figure(7.0, 3.3), shown_game()
    left, right = figure.subplots(1, 2, sharey=True)
    starts = [(label, play(game.problem, start)) for label, start in STARTS]
    draw_one_step(left, game, show="reach-avoid", starts=starts)
    draw_cost(right, game)
    left.set_title("(a) runs from three states")
    right.set_title("(b) optimal cost $V^j$ (m); its zero level is bold")
    right.set_ylabel("")
    figure.legend(handles=one_step_legend("reach-avoid"), loc="outside upper center", ncols=3)
    return figure


def draw_cost(ax: Axes, game: OneStepGame) -> None:
    """Contours of the optimal cost V^j of Eq. (6); its zero level, bold, bounds the reach-avoid set."""
    where = draw_lake(ax, game)
    cost = where.of(game.problem.grid, game.cost)
    levels = np.arange(-0.3, 0.91, 0.1)
    positive = levels > 1e-9
    for chosen, style in ((levels[positive], "--"), (levels[~positive], "-")):
        lines = ax.contour(
            where.x, where.y, cost, levels=chosen, colors=["#666666"], linewidths=0.7, linestyles=style, zorder=1.2
        )
        ax.clabel(lines, [level for level in chosen[::2] if level < 0.4], fontsize=6.5, fmt="%.1f")
    plotting.draw_set(ax, where, cost, FULL_LOOKS | {"linewidth": 2.0}, "reach-avoid", zorder=1.0)


if __name__ == "__main__":
    command_of(__file__)()
