"""The share of the states from which the target is reached grows with the steps to go, by every method."""

from charts import draw_fractions
from common import Context, command_of
from matplotlib.figure import Figure

from sdhj import plotting


def value(context: Context) -> list[float]:
    """The shares of C by the Hopf-Lax formula, by the steps to go."""
    return context.shares("lax")


def draw(context: Context) -> Figure:
    figure = plotting.new_figure(4.6, 3.2)
    draw_fractions(figure.subplots(), {method: context.shares(method) for method in ("hji", "lax", "projected")})
    return figure


if __name__ == "__main__":
    command_of(__file__)()
