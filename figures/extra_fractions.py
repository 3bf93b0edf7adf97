"""Share of C inside against the steps to go, by method."""

from charts import draw_fractions
from common import Context, command_of
from matplotlib.figure import Figure

from sdhj import plotting


def draw(context: Context) -> Figure:
    figure = plotting.new_figure(4.6, 3.2)
    draw_fractions(figure.subplots(), {method: context.shares(method) for method in ("hji", "lax", "projected")})
    return figure


if __name__ == "__main__":
    command_of(__file__)()
