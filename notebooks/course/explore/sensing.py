"""A cart whose controller knows of errors, and one whose controller does not, live."""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Any

from matplotlib.figure import Figure

import sdhj
from course.draw.sensing import draw_sensed, draw_two_by_two
from course.widgets import Explorer, Numbers, slider
from sdhj.kernels import FloatArray


def explore_sensing(problem: Any, drive: Callable[..., tuple[FloatArray, FloatArray]]) -> Explorer:
    """Two controllers of one robot: one whose table knows what is uncertain, one whose table does not."""

    @lru_cache(maxsize=64)
    def solved(**sensing: float) -> sdhj.Controller:
        unsure = replace(problem, sensing=sdhj.Sensing(**sensing, memory=False))
        return sdhj.Controller(sdhj.solve(unsure, progress=False))

    def draw(figure: Figure, error: float, delay: float, jitter: float) -> Numbers:
        told = {"error": error, "delay": delay, "jitter": jitter}
        grid = figure.add_gridspec(2, 2, height_ratios=(1.0, 0.3))
        numbers: dict[str, float | str] = {}
        rows = []
        for place, (name, known) in enumerate((("reckons with it", told), ("does not", dict.fromkeys(told, 0.0)))):
            controller = solved(**known)
            worlds = {
                "as it is": sdhj.Sensing(**told, memory=False),
                "perfect": sdhj.Sensing(delay=known["delay"], memory=False),
            }
            runs = {world: drive(controller, sensing) for world, sensing in worlds.items()}
            ax = figure.add_subplot(grid[0, place])
            draw_sensed(ax, controller.table, *runs["as it is"])
            ax.set_title(f"a table that {name}, the robot as it is")
            share = controller.table.fraction(start=0, within=problem.steps)
            numbers[f"promised, {name}"] = share
            for world, (_, lost) in runs.items():
                numbers[f"lost, {name}, {world}"] = float(lost.mean()) if len(lost) else "nothing promised"
            rows.append([f"{lost.sum()} of {len(lost)} lost" for _, lost in runs.values()])
        draw_two_by_two(figure.add_subplot(grid[1, :]), rows)
        return numbers

    controls = {
        "error": slider("error e (m, m/s)", 0.0, 0.08, 0.005, 0.02, live=False),
        "delay": slider("delay d (s)", 0.0, 0.2, 0.02, 0.1, live=False),
        "jitter": slider("jitter j (s)", 0.0, 0.1, 0.01, 0.02, live=False),
    }
    alt = "Runs of a cart with a table that knows of errors, and without"
    return Explorer(draw, controls, size=(8.2, 4.4), slow=True, alt=alt, motion="error")
