"""Fig. 11: The reach-avoid tubes that projections give grow likewise, and are smaller."""

from common import Context, command_of
from fig10_tubes import draw_two_slices
from matplotlib.figure import Figure


def value(context: Context) -> list[float]:
    """The shares of C that the tubes take up, by the steps to go."""
    return context.shares("projected")


def draw(context: Context) -> Figure:
    return draw_two_slices(context.table("projected"))


if __name__ == "__main__":
    command_of(__file__)()
