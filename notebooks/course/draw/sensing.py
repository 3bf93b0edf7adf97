"""A cart whose controller is misled: what its table promises, true paths, and a table of two by two."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba

from course.draw.slices import LIVE, around, draw_pixels
from sdhj.kernels import FloatArray
from sdhj.plotting import plane
from sdhj.plotting.looks import FULL_LOOKS, INNER_LOOKS, OUTCOME_INK, TARGET_LOOKS
from sdhj.table.batches import Table

SHOWN = 20  # paths of either kind in a picture


def draw_sensed(ax: Axes, table: Table, paths: FloatArray, lost: FloatArray) -> None:
    """What a table promises to states of a cart, in some steps (light) and in none (dark), and true paths from it."""
    grid, problem = table.grid, table.problem
    where = plane(grid, (0.0, 0.0), resolution=LIVE)
    image = np.zeros((*where.shaped(where.points[:, 0]).shape, 4))
    inside = where.shaped(table.contains(where.points, start=0, within=table.steps)) > 0
    known = where.shaped(table.contains(where.points, start=0, within=0)) > 0
    wall = where.shaped(problem.unsafe_value(where.points, 0.0)) <= 0
    for chosen, colour in (
        (inside, FULL_LOOKS["facecolor"]),
        (known, TARGET_LOOKS["facecolor"]),
        (wall, "#f6bda8"),
    ):
        image[chosen] = to_rgba(colour)
    draw_pixels(ax, image, around(where.x, where.y), "promised")
    worst_last = np.concatenate([np.flatnonzero(~lost)[:SHOWN], np.flatnonzero(lost)[:SHOWN]])
    for path, bad in zip(paths[worst_last], lost[worst_last], strict=True):
        colour, width = (OUTCOME_INK, 1.3) if bad else (INNER_LOOKS["facecolor"], 0.7)
        ax.plot(path[:, 0], path[:, 1], color=colour, linewidth=width, linestyle="-", gid="lost" if bad else "won")
        ax.plot(*path[0], "o", color=colour, markersize=2.5)
    ax.set(
        xlabel="x (m)",
        ylabel="v (m/s)",
        xlim=(grid.lower[0], grid.upper[0]),
        ylim=(grid.lower[1], grid.upper[1]),
    )


def draw_two_by_two(ax: Axes, cells: Sequence[Sequence[str]]) -> None:
    """A table of two by two: of each table of the robot, in each world."""
    ax.axis("off")
    columns = ("the robot as it is", "the same, measured and timed perfectly")
    rows = ("the table reckons with it", "it does not")
    made = ax.table(cells, rowLabels=rows, colLabels=columns, cellLoc="center", bbox=(0.28, 0.0, 0.7, 1.0))
    made.auto_set_font_size(False)
    made.set_fontsize(8)
