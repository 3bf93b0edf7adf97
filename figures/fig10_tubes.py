"""Fig. 10: The reach-avoid tubes from step 0 grow with the steps to go."""

import numpy as np
from common import Context, command_of, set_legend
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure

from sdhj import plotting
from sdhj.table.batches import Table

PURSUERS = ((-0.27, -0.09), (0.27, -0.09))  # m: where every step to go adds to what is seen


def value(context: Context) -> list[float]:
    """The shares of C that the tubes take up, by the steps to go."""
    return context.shares("hji")


def draw(context: Context) -> Figure:
    return draw_two_slices(context.table("hji"))


def draw_two_slices(table: Table) -> Figure:
    """The tubes for two places of the pursuer; Fig. 11 shows another table's."""
    figure = plotting.new_figure(7.0, 4.15)
    parts = figure.subplot_mosaic([["left", "right"], ["bar", "bar"]], height_ratios=(1.0, 0.045))
    for ax, (px, py) in zip((parts["left"], parts["right"]), PURSUERS, strict=True):
        plotting.draw_tubes(ax, table, through=(0.0, 0.0, px, py))
        ax.set_title(f"pursuer at ({px:.2f}, {py:.2f}) m")
    parts["right"].set_ylabel("")
    label = r"steps to go, $n$:  the set $\mathcal{S}_0^{N-n}$"
    draw_steps_bar(parts["bar"], table.steps, label)
    shown = {"facecolor": plotting.step_colours(table.steps)[0], "edgecolor": "#333333"}
    set_legend(figure, target=shown, pursuer="capture by the pursuer")
    return figure


def draw_steps_bar(ax: Axes, steps: int, label: str) -> None:
    """A bar of the colours of 0 to `steps` steps to go, filling `ax`."""
    colours = ListedColormap(plotting.step_colours(steps))
    norm = BoundaryNorm(np.arange(-0.5, steps + 1), steps + 1)
    bar = ax.figure.colorbar(ScalarMappable(norm, colours), cax=ax, orientation="horizontal", drawedges=True)
    bar.dividers.set(color="#333333", linewidth=0.45)
    bar.outline.set_linewidth(0.6)
    bar.set_ticks(list(range(steps + 1)))
    bar.set_label(label)
    bar.ax.tick_params(length=0)


if __name__ == "__main__":
    command_of(__file__)()
