"""Fig. 12: a run in workspace and configuration space."""

from pathlib import Path

from common import Context, command_of, set_legend
from matplotlib.figure import Figure

from sdhj import plotting
from sdhj.plotting.trajectories import samples


def draw(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 7.4)
    above, below = figure.subfigures(2, 1, squeeze=False)[:, 0]
    left, right = above.subplots(1, 2)
    plotting.draw_workspace_run(left, context.problem, context.run)
    plotting.draw_run(right, context.table("hji"), context.run)
    left.set_title(r"(a) end-effector in $\mathcal{W}$")
    right.set_title(r"(b) robot in $\mathcal{C}^r$")
    columns = max(3, -(-len(samples(context.run, context.problem)) // 2))
    plotting.draw_frames(below.subplots(2, columns).ravel(), context.problem, context.run)
    set_legend(figure)
    return figure


def also(context: Context, folder: Path) -> list[Path]:
    """The run as an animation."""
    return [plotting.save_animation(context.table("hji"), context.run, folder / "fig12_trajectory.gif")]


if __name__ == "__main__":
    command_of(__file__)()
