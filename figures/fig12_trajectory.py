"""Fig. 12: A run reaches the target past the obstacles and the pursuer, in workspace and configuration space."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from common import Context, command_of, set_legend
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from PIL import Image

from sdhj import plotting
from sdhj.arm.case_studies import scene
from sdhj.plotting.looks import FULL_LOOKS, OUTCOME_INK, PURSUER_LOOKS
from sdhj.plotting.scenes import draw_arm, draw_workspace
from sdhj.plotting.trajectories import THEN_LOOKS, WAY, draw_frame, draw_moment
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.simulation.runs import SUBSTEPS, Trajectory
from sdhj.table.batches import Table
from sdhj.table.files import replaced_whole


def value(context: Context) -> float:
    """When the run reaches the target, s."""
    return float(context.run.times[-1])


def draw(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 7.4)
    above, below = figure.subfigures(2, 1, squeeze=False)[:, 0]
    left, right = above.subplots(1, 2)
    draw_workspace_run(left, context.problem, context.run)
    plotting.draw_run(right, context.table("hji"), context.run)
    end, n = f"{context.run.times[-1]:.1f} s", context.run.steps_to_go[0]
    left.set_title(rf"(a) end-effector in $\mathcal{{W}}$, sets at {end}")
    right.set_title(r"(b) robot in $\mathcal{C}^r$, sets at 0 s")
    columns = max(3, -(-len(context.run.samples) // 2))
    draw_frames(below.subplots(2, columns).ravel(), context.problem, context.run)
    set_legend(
        figure,
        Patch(**FULL_LOOKS, label=rf"tube $\mathcal{{S}}_0^{{N-{n}}}$ that it starts in"),
        Patch(**THEN_LOOKS, label=f"target at {end}"),
        Line2D([], [], markerfacecolor="white", marker="o", markersize=3.6, label="run, measured at $t_k$", **WAY),
        pursuer="pursuer, and its way",
    )
    return figure


def also(context: Context, folder: Path) -> list[Path]:
    """The run as an animation."""
    return [save_animation(context.table("hji"), context.run, folder / "fig12_trajectory.gif")]


def draw_workspace_run(ax: Axes, problem: ReachAvoidProblem, run: Trajectory) -> None:
    """The end-effector's way in the workspace, the arm faintly at sampling times, the sets at the end (Fig. 12a)."""
    view = scene(problem)
    draw_workspace(ax, view, state=run.states[-1], time=float(run.times[-1]))
    for state in run.samples[:-1]:
        draw_arm(ax, view, state, alpha=0.25, zorder=3.0)
    tips = view.arm.tip(run.states[:, :2])
    ax.plot(*tips.T, zorder=6, gid="tip-path", **WAY)
    ax.plot(*tips[::SUBSTEPS].T, "o", color="white", markeredgecolor=OUTCOME_INK, markersize=3.6, zorder=6.5)
    ax.plot(*run.states[:, 2:4].T, color=PURSUER_LOOKS["edgecolor"], linestyle=":", linewidth=1.0, zorder=4)


def draw_frames(axes: Sequence[Axes], problem: ReachAvoidProblem, run: Trajectory) -> None:
    """A strip of workspace frames at the sampling times; axes that are left over are switched off."""
    times = run.times[::SUBSTEPS]
    for place, ax in enumerate(axes):
        if place >= len(times):
            ax.axis("off")
            continue
        draw_frame(ax, problem, run, index=place * SUBSTEPS)
        ax.set(xlabel="", ylabel="", xticks=[], yticks=[])
        ax.set_title(f"$t = {times[place]:.1f}$ s", fontsize=8, loc="center", pad=2)
        for spine in ax.spines.values():
            spine.set_visible(True)


def save_animation(
    table: Table, run: Trajectory, path: Path, *, frames: int = 41, rate: int = 12, dpi: int = 90
) -> Path:
    """Write a run as an animated GIF: slower than life, and still for half a second at its end."""
    shown = np.unique(np.linspace(0, len(run.times) - 1, min(frames, len(run.times))).astype(int))
    pictures, lasts = [], [round(1000 / rate)] * len(shown)
    lasts[-1] += 500
    with plotting.style(), rc_context({"axes.titley": 1.0}):  # else each frame is laid out twice, for its titles
        figure = plotting.new_figure(6.4, 3.3, layout="none", dpi=dpi)  # one layout for all frames, and quick
        canvas = FigureCanvasAgg(figure)  # one for all frames: it keeps its letters
        for index in shown:
            draw_moment(figure, table, run, index=int(index))
            figure.subplots_adjust(left=0.08, right=0.985, bottom=0.125, top=0.92, wspace=0.24)
            canvas.draw()
            pictures.append(Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB"))
    with replaced_whole(path) as temporary:
        pictures[0].save(temporary, "GIF", save_all=True, append_images=pictures[1:], duration=lasts, loop=0)
    return path


if __name__ == "__main__":
    command_of(__file__)()
