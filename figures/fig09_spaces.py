"""Fig. 9: The disks of the workspace become sets of joint angles in the configuration space."""

import numpy as np
from common import SHOWN_STATE, Context, command_of, draw_velocities, set_legend
from matplotlib.figure import Figure

from sdhj import plotting


def value(context: Context) -> float:
    """Share of the joint angles that are unsafe at t = 0."""
    where = plotting.plane(context.problem.grid, SHOWN_STATE)
    return float((context.problem.unsafe_value(where.points, 0.0) <= 0).mean())


def draw(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 3.75)
    left, right = figure.subplots(1, 2)
    times = context.problem.delta * np.arange(0, context.problem.steps + 1, 2)
    plotting.draw_workspace(left, context.scene, state=SHOWN_STATE, trail=times)
    draw_velocities(left, context.scene)
    plotting.draw_constraints(right, context.problem, through=SHOWN_STATE)
    left.set_title(r"(a) workspace $\mathcal{W}$ at $t = 0$")
    right.set_title(r"(b) configuration space $\mathcal{C}^r$ at $t = 0$")
    set_legend(figure)
    return figure


if __name__ == "__main__":
    command_of(__file__)()
