"""The robot as it is: sets on a line and what is shrunk of them, and a cart whose controller is misled."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from live_slices import LIVE, around, draw_pixels
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from widgets import Explorer, Numbers, slider

import sdhj
from sdhj.kernels import FloatArray
from sdhj.plotting import plane
from sdhj.plotting.looks import FULL_LOOKS, INNER_LOOKS, OUTCOME_INK, TARGET_LOOKS
from sdhj.table.batches import Table

Row = tuple[str, Sequence[tuple[Any, Any]], str]  # what is written, intervals, and "known" or "true"
COLOURS = {"true": TARGET_LOOKS["facecolor"], "known": "#f2c14e"}
SHOWN = 20  # paths of either kind in a picture


def draw_line_sets(ax: Axes, rows: Sequence[Row], box: float) -> None:
    """Sets of a line, one below the other: sets of states blue, of predictions yellow; the first row is on top."""
    for place, (label, intervals, kind) in enumerate(reversed(rows)):
        for low, high in intervals:
            ax.plot(
                [float(low), float(high)],
                [place, place],
                linewidth=9,
                linestyle="-",
                color=COLOURS[kind],
                solid_capstyle="butt",
                gid=label,
            )
            for end, away in ((float(low), -1), (float(high), 1)):
                ax.annotate(
                    f"{end:.2f}", (end, place), (4 * away, 0), textcoords="offset points", va="center", fontsize=7,
                    ha="left" if away > 0 else "right",
                )  # fmt: skip
    ax.set_yticks(range(len(rows)), [label for label, _, _ in reversed(rows)])
    ax.plot([-box, box], [len(rows) - 0.3] * 2, linewidth=2, linestyle="-", color=OUTCOME_INK, gid="box")
    ax.text(box, len(rows) - 0.3, " the box E", va="center", fontsize=8, color=OUTCOME_INK)
    ax.set(xlabel="q", ylim=(-0.7, len(rows) + 0.1))
    ax.margins(x=0.12)


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


def explore_sensing(problem: Any, drive: Callable[..., tuple[FloatArray, FloatArray]]) -> Explorer:
    """Two controllers of one robot: one whose table knows what is uncertain, one whose table does not."""

    @lru_cache(maxsize=64)
    def solved(**sensing: float) -> sdhj.Controller:
        unsure = replace(problem, sensing=sdhj.Sensing(**sensing))
        return sdhj.Controller(sdhj.solve(unsure, progress=False))

    def draw(figure: Figure, error: float, delay: float, jitter: float) -> Numbers:
        told = {"error": error, "delay": delay, "jitter": jitter}
        grid = figure.add_gridspec(2, 2, height_ratios=(1.0, 0.3))
        numbers: dict[str, float | str] = {}
        rows = []
        for place, (name, known) in enumerate((("reckons with it", told), ("does not", dict.fromkeys(told, 0.0)))):
            controller = solved(**known)
            worlds = {"as it is": sdhj.Sensing(**told), "perfect": sdhj.Sensing(delay=known["delay"])}
            runs = {world: drive(controller, sensing) for world, sensing in worlds.items()}
            draw_sensed(figure.add_subplot(grid[0, place]), controller.table, *runs["as it is"])
            figure.axes[-1].set_title(f"a table that {name}, the robot as it is")
            share = controller.table.fraction(start=0, within=problem.steps)
            numbers[f"promised, {name}"] = share
            for world, (_, lost) in runs.items():
                numbers[f"lost, {name}, {world}"] = float(lost.mean()) if len(lost) else "nothing promised"
            rows.append([f"{lost.sum()} of {len(lost)} lost" for _, lost in runs.values()])
        draw_two_by_two(figure.add_subplot(grid[1, :]), rows)
        return numbers

    controls = {
        "error": slider("error e (m, m/s)", 0.0, 0.08, 0.01, 0.02, live=False),
        "delay": slider("delay d (s)", 0.0, 0.2, 0.02, 0.1, live=False),
        "jitter": slider("jitter j (s)", 0.0, 0.1, 0.01, 0.02, live=False),
    }
    alt = "Runs of a cart with a table that knows of errors, and without"
    return Explorer(draw, controls, size=(8.2, 4.4), slow=True, alt=alt, motion="error")
