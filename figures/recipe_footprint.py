"""The recipe of a robot with a shape: out of a corridor backwards, a turn in a room, and back in.

python figures/recipe_footprint.py figures/gallery/recipe_footprint.png    what the page shows, about a minute

The robot is the recipe's: the code of notebooks/site/maps.md is run, and its run drawn.
"""

import re
from pathlib import Path
from typing import Any

import click
import numpy as np
from matplotlib.figure import Figure

from sdhj import plotting
from sdhj.cli import plainly
from sdhj.plotting.looks import INK

RECIPES = Path(__file__).parents[1] / "notebooks" / "site" / "maps.md"
HEADING = "## A robot with a shape"
EVERY = 4  # samples, of which one outline is drawn


def played() -> dict[str, Any]:
    """What the first block of code below the heading defines: `room`, `robot`, `turn` and what they rest on."""
    code = re.search(r"```python\n(.*?)```", RECIPES.read_text(encoding="utf-8").split(HEADING)[1], re.DOTALL)
    assert code is not None
    found: dict[str, Any] = {}
    exec(code[1], found)
    return found


def draw(recipe: dict[str, Any]) -> Figure:
    """The walls, the way of the middle of its wheels, and the robot's outline at some samples."""
    figure = plotting.new_figure(5.0, 2.9)
    ax, run, body = figure.subplots(), recipe["turn"], np.array(recipe["robot"])
    ax.set_facecolor("#d9d9d9")
    ax.fill(*np.array(recipe["room"]).T, facecolor="white", edgecolor=INK)
    for x, y, heading in run.samples[::EVERY]:
        cos, sin = np.cos(heading), np.sin(heading)
        corners = body @ np.array([[cos, sin], [-sin, cos]]) + (x, y)
        ax.fill(*corners.T, fill=False, edgecolor="#0b3c5d", linewidth=0.8, gid="outline")
    ax.plot(*run.states[:, :2].T, color="#c44e00", linewidth=1.6, label="middle of its wheels", gid="path")
    ax.plot(*run.states[0, :2], "o", color="#c44e00", label="start")
    ax.plot(*run.states[-1, :2], "s", color="#c44e00", label="end")
    ax.set(xlabel="x (m)", ylabel="y (m)", aspect="equal", xlim=(-0.3, 6.3), ylim=(-0.2, 3.2))
    ax.legend(loc="lower left")
    return figure


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@plainly
def main(file: Path) -> None:
    """Draw the recipe of a robot with a shape into a file."""
    draw(played()).savefig(file, dpi=200)


if __name__ == "__main__":
    main()
