"""Fig. 6: From the reach set of S one input leads into S, whatever the adversary does."""

from boat import STARTS, draw_one_step, one_step_legend, play, shown_game
from common import Context, command_of
from matplotlib.figure import Figure

from sdhj import plotting


def value(context: Context) -> float:
    """Share of the plane in the reach set."""
    game = shown_game()
    return game.problem.grid.fraction(game.reach <= 0)


def draw(context: Context) -> Figure:
    figure, game = plotting.new_figure(5.0, 4.3), shown_game()
    (_, inside), _, (_, outside) = STARTS
    starts = [("$q$", play(game.problem, inside)), ("$q'$", play(game.problem, outside))]
    draw_one_step(figure.subplots(), game, show="reach", starts=starts)
    figure.legend(handles=one_step_legend("reach"), loc="outside upper center", ncols=2)
    return figure


if __name__ == "__main__":
    command_of(__file__)()
