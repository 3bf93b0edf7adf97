"""Fig. 6: reach set of S under one input."""

from boat import STARTS, draw_one_step, one_step_legend, play, shown_game
from common import Context, command_of
from matplotlib.figure import Figure

from sdhj import plotting


def draw(context: Context) -> Figure:
    figure, game = plotting.new_figure(5.0, 4.3), shown_game()
    (_, inside), _, (_, outside) = STARTS
    starts = [("$q$", play(game.problem, inside)), ("$q'$", play(game.problem, outside))]
    draw_one_step(figure.subplots(), game, show="reach", starts=starts)
    figure.legend(handles=one_step_legend("reach"), loc="outside upper center", ncols=2)
    return figure


if __name__ == "__main__":
    command_of(__file__)()
