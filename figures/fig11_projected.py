"""Fig. 11: reach-avoid tubes by projections."""

from common import Context, command_of
from fig10_tubes import draw_two_slices
from matplotlib.figure import Figure


def draw(context: Context) -> Figure:
    return draw_two_slices(context.table("projected"))


if __name__ == "__main__":
    command_of(__file__)()
