"""What is computed: a robot among obstacles, and the joint angles from which it can reach the target in time."""

from common import Context, command_of, set_legend
from fig10_tubes import draw_steps_bar
from fig12_trajectory import draw_workspace_run
from matplotlib.figure import Figure

from sdhj import plotting
from sdhj.plotting.trajectories import draw_path


def value(context: Context) -> float:
    """The share of the joint angles from which the target can be reached, with the pursuer where the run begins."""
    where = plotting.plane(context.problem.grid, tuple(context.run.states[0]))
    return float(context.table("hji").contains(where.points, start=0, within=context.problem.steps).mean())


def draw(context: Context) -> Figure:
    run, table = context.run, context.table("hji")
    figure = plotting.new_figure(7.0, 4.1)
    parts = figure.subplot_mosaic([["left", "right"], ["bar", "bar"]], height_ratios=(1.0, 0.045))
    draw_workspace_run(parts["left"], context.problem, run)
    plotting.draw_tubes(parts["right"], table, through=run.states[0])
    draw_path(parts["right"], table.grid, run.states, marks=run.samples)
    parts["left"].set_title(f"the arm from 0 to {run.times[-1]:.1f} s, and the sets at {run.times[-1]:.1f} s")
    parts["right"].set_title("its joint angles, and the sets at 0 s")
    draw_steps_bar(parts["bar"], table.steps, "steps in which the target can be reached, whatever the adversary does")
    set_legend(figure, pursuer="pursuer")
    return figure


if __name__ == "__main__":
    command_of(__file__)()
