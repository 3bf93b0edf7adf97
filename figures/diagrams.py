"""Boxes and arrows for block diagrams (Figs. 2, 3 and 5)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch
from matplotlib.path import Path

from sdhj.plotting import new_figure
from sdhj.plotting.looks import FAINT, INK

ROBOT_SIDE = "#e3edf7"  # what the robot's designer chooses
ADVERSE = "#f8d9cc"  # what the adversary chooses; hatched as well
NEUTRAL = "#ffffff"
STORED = "#eef0f2"
Point = tuple[float, float]


@dataclass(frozen=True)
class Box:
    """A box of a block diagram: centre and size, inches."""

    x: float
    y: float
    width: float
    height: float

    def side(self, name: str, shift: float = 0.0) -> Point:
        """The middle of a side ("left", "right", "top", "bottom"), or a point `shift` beside it."""
        if name in ("left", "right"):
            return self.x + (self.width if name == "right" else -self.width) / 2, self.y + shift
        return self.x + shift, self.y + (self.height if name == "top" else -self.height) / 2


class Board:
    """An empty page of that many inches, to put boxes and arrows on; its coordinates are inches too."""

    def __init__(self, width: float, height: float) -> None:
        self.figure: Figure = new_figure(width, height, layout="none")
        self.ax = self.figure.add_axes((0.0, 0.0, 1.0, 1.0))
        self.ax.set(xlim=(0, width), ylim=(0, height))
        self.ax.axis("off")

    def box(
        self,
        x: float,
        y: float,
        width: float,
        height: float,
        text: str,
        face: str = NEUTRAL,
        hatch: str = "",
        **font: Any,
    ) -> Box:
        """A rounded box about (x, y) with centred text."""
        shape = FancyBboxPatch(
            (x - width / 2, y - height / 2),
            width,
            height,
            boxstyle="round,pad=0,rounding_size=0.06",
            facecolor=face,
            edgecolor=INK,
            linewidth=0.9,
            zorder=2,
            gid="box",
        )
        self.ax.add_patch(shape)
        if hatch:  # a strip at the left edge: hatching behind words would make them hard to read
            strip = FancyBboxPatch(
                (x - width / 2, y - height / 2),
                0.09,
                height,
                boxstyle="square,pad=0",
                facecolor="none",
                edgecolor="#a8330f",
                hatch=hatch,
                linewidth=0.0,
                zorder=2.1,
            )
            strip.set_clip_path(shape)
            self.ax.add_patch(strip)
        self.text(x + (0.04 if hatch else 0.0), y, text, **font)
        return Box(x, y, width, height)

    def text(self, x: float, y: float, text: str, **font: Any) -> None:
        looks: dict[str, Any] = {"ha": "center", "va": "center", "zorder": 4, "linespacing": 1.35} | font
        self.ax.text(x, y, text, **looks)

    def arrow(self, *points: Point, dashed: bool = False) -> None:
        """An arrow along a polyline."""
        self.ax.add_patch(
            FancyArrowPatch(
                path=Path(np.array(points)),
                arrowstyle="-|>,head_length=4,head_width=2",
                mutation_scale=1.0,
                color=INK,
                linewidth=1.0,
                linestyle="--" if dashed else "-",
                joinstyle="miter",
                zorder=3,
            )
        )

    def zone(self, x0: float, y0: float, x1: float, y1: float, title: str) -> None:
        """A dashed frame with a title at its top left."""
        self.ax.add_patch(
            FancyBboxPatch(
                (x0, y0),
                x1 - x0,
                y1 - y0,
                boxstyle="round,pad=0,rounding_size=0.08",
                facecolor="#fafafa",
                edgecolor=FAINT,
                linestyle=(0, (4, 2)),
                linewidth=0.9,
                zorder=0.5,
            )
        )
        self.text(x0 + 0.08, y1 - 0.13, title, ha="left", color="#444444", fontsize=7.5)
