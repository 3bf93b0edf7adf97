"""Figures of problems, tables and runs: functions `draw_*(axes, data, **options)`. They need the extra `plot`.

    with plotting.style():
        figure = plotting.new_figure(5, 4)
        plotting.draw_tubes(figure.subplots(), table, through=state)
        plotting.save(figure, "results", "tubes")

===================  ===============================================================================================
for any robot        `draw_tubes` and `draw_constraints`, on a slice along two axes through a state; `draw_run` and
                     `draw_path`, a run on a slice. For other drawings on a slice, `plane(grid, through).points` gives
                     its states, and `draw_set` draws a set
of records           `draw_records`, of what `sdhj.bounds_from_records` returns
for the arm          `draw_workspace`, `draw_arm`; `draw_moment`, one instant of a run
===================  ===============================================================================================

These functions only draw: they compute no table and keep no state, so a slider can call them again on cleared axes. The
artist of a set or a run has an identifier (Matplotlib's gid) by which it is found in tests and in SVG files. Draw
inside `with style():` to get the project's style.
"""

import importlib.util

if importlib.util.find_spec("matplotlib") is None:
    raise ImportError('figures need Matplotlib, which is not installed: pip install "sdhj[plot]"')

from sdhj.plotting.looks import new_figure, patch, save, step_colours, style, write
from sdhj.plotting.records import draw_records
from sdhj.plotting.scenes import draw_arm, draw_workspace
from sdhj.plotting.slices import (
    draw_constraints,
    draw_path,
    draw_set,
    draw_tubes,
    frame_slice,
    plane,
)
from sdhj.plotting.trajectories import draw_moment, draw_run

__all__ = [
    "draw_arm",
    "draw_constraints",
    "draw_moment",
    "draw_path",
    "draw_records",
    "draw_run",
    "draw_set",
    "draw_tubes",
    "draw_workspace",
    "frame_slice",
    "new_figure",
    "patch",
    "plane",
    "save",
    "step_colours",
    "style",
    "write",
]
