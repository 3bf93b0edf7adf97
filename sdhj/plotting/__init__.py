"""Pictures of problems, tables and runs, as pure functions `draw_*(axes or figure, data, **sliders)`.

The figure scripts and the notebooks share them. A drawing function only draws: it computes no table, reads no clock and
keeps no state, so a slider can call it again on cleared axes. Every artist that stands for a set or a run carries an
identifier (`artist.get_gid()`), by which tests and readers of an SVG file find it.

Draw inside `with style():`, or call `use_style()` once, to get the project's look.
"""

from sdhj.plotting.slices import (
    Plane,
    draw_comparison,
    draw_constraints,
    draw_path,
    draw_set,
    draw_steps_bar,
    draw_tubes,
    frame_slice,
    plane,
    unwrapped,
)
from sdhj.plotting.style import new_figure, patch, save, step_colours, style, use_style, writable_folder
from sdhj.plotting.surfaces import draw_isosurface, isosurface
from sdhj.plotting.workspace import draw_agent, draw_arm, draw_disk, draw_workspace, frame_workspace

__all__ = [
    "Plane",
    "draw_agent",
    "draw_arm",
    "draw_comparison",
    "draw_constraints",
    "draw_disk",
    "draw_isosurface",
    "draw_path",
    "draw_set",
    "draw_steps_bar",
    "draw_tubes",
    "draw_workspace",
    "frame_slice",
    "frame_workspace",
    "isosurface",
    "new_figure",
    "patch",
    "plane",
    "save",
    "step_colours",
    "style",
    "unwrapped",
    "use_style",
    "writable_folder",
]
