"""The figures of the paper, shown in a notebook by the scripts in figures/ that draw them."""

import sys
from pathlib import Path

from course.widgets import show

sys.path.append(str(Path(__file__).resolve().parents[2] / "figures"))  # the scripts are no package to install

import boat
from charts import METHOD_NAMES, draw_fractions, draw_sweep
from common import PAPER_NODES, Context, draw, starts_of_runs, title
from fig14_timing import PAPER_SECONDS, draw_timings, printed
from keep import kept
from surfaces import LIGHT, block, draw_isosurface, isosurface

__all__ = [
    "LIGHT",
    "METHOD_NAMES",
    "PAPER_NODES",
    "PAPER_SECONDS",
    "Context",
    "block",
    "boat",
    "draw_fractions",
    "draw_isosurface",
    "draw_sweep",
    "draw_timings",
    "isosurface",
    "kept",
    "paper_figure",
    "printed",
    "starts_of_runs",
]


def paper_figure(name: str, context: Context | None = None) -> None:
    """Show a figure of the paper, by the name of its script, from what a `Context` holds."""
    show(draw(name, context or Context()), alt=title(name))
