"""Pictures of problems, tables and runs: `draw_*(axes, data, **choices)`. They need the extra `plot`.

    with plotting.style():
        figure = plotting.new_figure(5, 4)
        plotting.draw_tubes(figure.subplots(), table, through=state)
        plotting.save(figure, "results", "tubes")

===================  ===============================================================================================
of any robot         `draw_tubes`, `draw_constraints` and `draw_labels` (what of a tube is certified), on a slice along
                     two axes through a state; `draw_run` and `draw_path`, a run on a slice. Whatever else is to be
                     drawn on a slice: its states are `plane(grid, through).points`, a set on it `draw_set`
of the arm           `draw_workspace`, `draw_arm`; `draw_moment` of a run
===================  ===============================================================================================

A function only draws: it computes no table, reads no clock and keeps no state, so a slider can call it again on cleared
axes. What stands for a set or a run carries an identifier (`artist.get_gid()`), by which tests and readers of an SVG
file find it. Draw inside `with style():` to get the project's look. Nothing here uses `matplotlib.pyplot`.
"""

import importlib.util

if importlib.util.find_spec("matplotlib") is None:
    raise ImportError('pictures need Matplotlib, which is not installed: pip install "sdhj[plot]"')

from sdhj.plotting.looks import new_figure, patch, save, step_colours, style, write
from sdhj.plotting.scenes import draw_arm, draw_workspace
from sdhj.plotting.slices import (
    draw_constraints,
    draw_labels,
    draw_path,
    draw_set,
    draw_tubes,
    frame_slice,
    label_legend,
    plane,
)
from sdhj.plotting.trajectories import draw_moment, draw_run

__all__ = [
    "draw_arm",
    "draw_constraints",
    "draw_labels",
    "draw_moment",
    "draw_path",
    "draw_run",
    "draw_set",
    "draw_tubes",
    "draw_workspace",
    "frame_slice",
    "label_legend",
    "new_figure",
    "patch",
    "plane",
    "save",
    "step_colours",
    "style",
    "write",
]
