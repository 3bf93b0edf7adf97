"""Fig. 10: reach-avoid tubes from step 0."""

from common import PURSUER_AT, Context, command_of, set_legend
from matplotlib.figure import Figure

from sdhj import plotting
from sdhj.table import Table

PURSUER_ALSO = (0.0, 0.0, -0.15, 0.21)


def draw(context: Context) -> Figure:
    return draw_two_slices(context.table("hji"))


def draw_two_slices(table: Table) -> Figure:
    """The tubes for two places of the pursuer; Fig. 11 shows another table's."""
    figure = plotting.new_figure(7.0, 4.15)
    parts = figure.subplot_mosaic([["left", "right"], ["bar", "bar"]], height_ratios=(1.0, 0.045))
    for ax, state in ((parts["left"], PURSUER_AT), (parts["right"], PURSUER_ALSO)):
        plotting.draw_tubes(ax, table, through=state)
        ax.set_title(f"pursuer at ({state[2]:.2f}, {state[3]:.2f}) m")
    parts["right"].set_ylabel("")
    label = r"steps to go, $n$:  the set $\mathcal{S}_0^{N-n}$"
    plotting.draw_steps_bar(parts["bar"], table.steps, label, horizontal=True)
    set_legend(figure, target=False)
    return figure


if __name__ == "__main__":
    command_of(__file__)()
