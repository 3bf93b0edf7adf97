"""The figures of the paper, shown in a notebook by the scripts in figures/ that draw them."""

import sys
from pathlib import Path

from widgets import show

sys.path.append(str(Path(__file__).resolve().parent.parent / "figures"))  # the scripts are no package to install

import boat
from charts import draw_fractions, draw_sweep
from common import PAPER_NODES, Context, draw, starts_of_runs, title
from fig14_timing import PAPER_SECONDS
from surfaces import draw_isosurface

__all__ = [
    "PAPER_NODES",
    "PAPER_SECONDS",
    "Context",
    "boat",
    "draw_fractions",
    "draw_isosurface",
    "draw_sweep",
    "paper_figure",
    "starts_of_runs",
]


def paper_figure(name: str, context: Context | None = None) -> None:
    """Show a figure of the paper, by the name of its script, from what a `Context` holds."""
    show(draw(name, context or Context()), alt=title(name))
