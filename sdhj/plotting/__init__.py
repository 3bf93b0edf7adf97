"""Pictures of problems, tables and runs, as pure functions `draw_*(axes or figure, data, **sliders)`.

The figure scripts and the notebooks share them. A drawing function only draws: it computes no table, reads no clock and
keeps no state, so a slider can call it again on cleared axes. Every artist that stands for a set or a run carries an
identifier (`artist.get_gid()`), by which tests and readers of an SVG file find it.

Draw inside `with style():`, or call `use_style()` once, to get the project's look.
"""

from game_pictures import draw_cost, draw_one_step, one_step_legend
from sdhj.plotting.looks import new_figure, patch, save, step_colours, style, use_style
from sdhj.plotting.runs import (
    Run,
    draw_cspace_run,
    draw_frame,
    draw_frames,
    draw_lookup,
    draw_moment,
    draw_sampled_data,
    draw_workspace_run,
    save_animation,
)
from sdhj.plotting.slices import (
    Plane,
    comparison_legend,
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
from studies import draw_bars, draw_entries, draw_input_levels, draw_sweep, draw_timings, fraction_curves
from sdhj.plotting.surfaces import draw_isosurface, isosurface
from sdhj.plotting.workspace import draw_agent, draw_arm, draw_disk, draw_workspace, frame_workspace

__all__ = [
    "Plane",
    "Run",
    "comparison_legend",
    "draw_agent",
    "draw_arm",
    "draw_bars",
    "draw_comparison",
    "draw_constraints",
    "draw_cost",
    "draw_cspace_run",
    "draw_disk",
    "draw_entries",
    "draw_frame",
    "draw_frames",
    "draw_input_levels",
    "draw_isosurface",
    "draw_lookup",
    "draw_moment",
    "draw_one_step",
    "draw_path",
    "draw_sampled_data",
    "draw_set",
    "draw_steps_bar",
    "draw_sweep",
    "draw_timings",
    "draw_tubes",
    "draw_workspace",
    "draw_workspace_run",
    "fraction_curves",
    "frame_slice",
    "frame_workspace",
    "isosurface",
    "new_figure",
    "one_step_legend",
    "patch",
    "plane",
    "save",
    "save_animation",
    "step_colours",
    "style",
    "unwrapped",
    "use_style",
]
