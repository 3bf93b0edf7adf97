"""Closed-loop runs (Fig. 12): on a slice, of any robot; in the workspace, as frames and as an animation, of the arm."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from matplotlib.animation import PillowWriter
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sdhj.arm.case_studies import scene
from sdhj.files import replaced_whole
from sdhj.grid import FloatArray
from sdhj.plotting.looks import FULL_LOOKS, OUTCOME_INK, PURSUER_LOOKS, new_figure, style
from sdhj.plotting.scenes import draw_arm, draw_workspace
from sdhj.plotting.slices import draw_constraints, draw_path, draw_set, plane
from sdhj.problem import ReachAvoidProblem
from sdhj.table import Table

LIVE = 97  # points along each side of a slice of which an animation shows many
WAY: dict[str, Any] = {"linestyle": "-", "linewidth": 1.5, "color": OUTCOME_INK}


class Run(Protocol):
    """What drawing needs of a run; `sdhj.simulate` returns one.

    `times` (T,) and `states` (T, ndim) are fine, and hold the sampling times; `inputs` (K,) are the indices of the
    inputs held over the intervals, `steps_to_go` (K,) what the controller promised at the start of each.
    """

    @property
    def times(self) -> FloatArray: ...

    @property
    def states(self) -> FloatArray: ...

    @property
    def inputs(self) -> FloatArray: ...

    @property
    def steps_to_go(self) -> FloatArray: ...

    @property
    def outcome(self) -> str: ...


def samples(run: Run, problem: ReachAvoidProblem) -> FloatArray:
    """Indices into run.times of the sampling times 0, delta, ... that the run came to."""
    steps = np.arange(int(np.floor(run.times[-1] / problem.delta + 1e-6)) + 1)
    return np.array([int(np.argmin(np.abs(run.times - k * problem.delta))) for k in steps])


def draw_workspace_run(ax: Axes, problem: ReachAvoidProblem, run: Run) -> None:
    """The end-effector's way in the workspace, the arm faintly at sampling times, the sets at the end (Fig. 12a)."""
    view, at = scene(problem), samples(run, problem)
    draw_workspace(ax, view, state=run.states[-1], time=float(run.times[-1]), arrows=False)
    for index in at[:-1]:
        draw_arm(ax, view, run.states[index], alpha=0.25, zorder=3.0)
    tips = view.arm.tip(run.states[:, :2])
    ax.plot(*tips.T, zorder=6, gid="tip-path", **WAY)
    ax.plot(*tips[at].T, "o", color="white", markeredgecolor=OUTCOME_INK, markersize=3.6, zorder=6.5)
    ax.plot(*run.states[:, 2:4].T, color=PURSUER_LOOKS["edgecolor"], linestyle=":", linewidth=1.0, zorder=4)


def draw_run(ax: Axes, table: Table, run: Run, *, axes: Sequence[int] = (0, 1)) -> None:
    """A run on a slice over the tube it starts in, with target and unsafe sets as they are at its end (Fig. 12b)."""
    problem, at = table.problem, samples(run, table.problem)
    where = plane(problem.grid, run.states[0], axes)
    n = int(run.steps_to_go[0])
    draw_set(ax, where, where.of(problem.grid, table.values(start=0, within=n)), FULL_LOOKS, "tube", zorder=1.0)
    draw_constraints(ax, problem, through=run.states[-1], step=float(run.times[-1]) / problem.delta, axes=axes)
    draw_path(ax, problem.grid, run.states, axes, marks=run.states[at])


def draw_frame(ax: Axes, problem: ReachAvoidProblem, run: Run, *, index: int) -> None:
    """The workspace at one moment of a run, with the end-effector's way so far."""
    view = scene(problem)
    draw_workspace(ax, view, state=run.states[index], time=float(run.times[index]), arrows=False)
    ax.plot(*view.arm.tip(run.states[: index + 1, :2]).T, zorder=6, gid="tip-path", **WAY)


def draw_frames(axes: Sequence[Axes], problem: ReachAvoidProblem, run: Run) -> None:
    """A strip of workspace frames at the sampling times; axes that are left over are switched off."""
    at = samples(run, problem)
    for place, ax in enumerate(axes):
        if place >= len(at):
            ax.axis("off")
            continue
        draw_frame(ax, problem, run, index=int(at[place]))
        ax.set(xlabel="", ylabel="", xticks=[], yticks=[])
        ax.set_title(f"$t = {run.times[at[place]]:.1f}$ s", fontsize=8, loc="center", pad=2)
        for spine in ax.spines.values():
            spine.set_visible(True)


def draw_moment(figure: Figure, table: Table, run: Run, *, index: int) -> None:
    """One moment of a run: workspace on the left, C-space with the tube in force on the right. Clears the figure."""
    figure.clear()
    problem = table.problem
    left, right = figure.subplots(1, 2)
    draw_frame(left, problem, run, index=index)
    step, n, goal = 0, 0, (0, 0)
    if len(run.inputs):  # a run that starts in the target holds none
        step = min(int(run.times[index] / problem.delta + 1e-6), len(run.inputs) - 1)
        n = int(run.steps_to_go[step])
        goal = (step + 1, max(n - 1, 0))  # where the interval has to end
    state = run.states[index]
    where = plane(problem.grid, state, resolution=LIVE)
    values = where.of(problem.grid, table.values(start=goal[0], within=goal[1]))
    draw_set(right, where, values, FULL_LOOKS, "tube", zorder=1.0)
    draw_constraints(right, problem, through=state, step=float(run.times[index]) / problem.delta, resolution=LIVE)
    draw_path(right, problem.grid, run.states[: index + 1], marks=state[None])
    left.set_title(f"$t = {run.times[index]:.2f}$ s, step {step}")
    right.set_title(f"{n} step{'' if n == 1 else 's'} to go" if index < len(run.times) - 1 else run.outcome)


def save_animation(table: Table, run: Run, path: Path, *, frames: int = 41, rate: int = 12, dpi: int = 90) -> Path:
    """Write a run as an animated GIF: slower than life, and still for a moment at its end."""
    shown = np.unique(np.linspace(0, len(run.times) - 1, min(frames, len(run.times))).astype(int))

    with replaced_whole(path) as temporary, style():
        figure = new_figure(6.4, 3.3, layout="none")  # one layout for all frames, and quick
        writer = PillowWriter(fps=rate)
        with writer.saving(figure, str(temporary), dpi=dpi):
            for index in [*shown, *[shown[-1]] * (rate // 2)]:
                draw_moment(figure, table, run, index=int(index))
                figure.subplots_adjust(left=0.08, right=0.985, bottom=0.125, top=0.92, wspace=0.24)
                writer.grab_frame()
    return path
