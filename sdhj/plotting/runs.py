"""Closed-loop runs: sampled signals, the way through the table, frames, animations (Figs. 4, 8 and 12)."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from matplotlib.animation import PillowWriter
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import ConnectionPatch

from sdhj.arm.case_studies import scene
from sdhj.files import replaced_whole
from sdhj.grid import FloatArray
from sdhj.plotting.looks import FAINT, FULL, INK, OUTCOME_INK, PURSUER, new_figure, step_colours, style
from sdhj.plotting.slices import State, draw_constraints, draw_path, draw_set, plane
from sdhj.plotting.workspace import draw_arm, draw_workspace
from sdhj.problem import ReachAvoidProblem
from sdhj.table import LookupTable

CELL = 49  # points along each side of the small slices of Fig. 8
WAY: dict[str, Any] = {"linestyle": "-", "linewidth": 1.5, "color": OUTCOME_INK}
LOOKUP_KEY = (
    "each cell: joint angles $q_1$ (across) and $q_2$ (up), from $-\\pi$ to $\\pi$,\n"
    "at where the pursuer is at step $k$ of the run\n"
    "coloured: $\\mathcal{S}_k^{N-n}$;  grey: unsafe at $t_k$\n"
    "dot: the arm;  frame: the leftmost set of its row that holds it\n"
    "$*$: the same as the last set of its row"
)


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


def draw_sampled_data(
    axes: Sequence[Axes],
    times: FloatArray,
    state: FloatArray,
    held: FloatArray,
    delta: float,
    *,
    levels: Sequence[float] | FloatArray = (),
    names: tuple[str, str] = ("$x(t)$", "$u(t)$"),
) -> None:
    """A continuous state with its samples, and the input held between them (Fig. 4), on two axes over one time line.

    Parameters
    ----------
    axes : two Axes
    times, state : (T,) arrays
        One coordinate of a run, finely.
    held : (K,) array
        One component of the input over each interval.
    delta : float
        Sampling interval, s.
    levels : sequence, optional
        The input's quantised levels, ruled faintly.
    names : (str, str)
        Labels of the vertical axes, with units.
    """
    above, below = axes
    edges = np.arange(len(held) + 1) * delta
    sampled = np.interp(edges, times, state)
    above.plot(times, state, color=INK, linestyle="-", gid="state")
    above.plot(edges, sampled, "o", color="white", markeredgecolor=OUTCOME_INK, markersize=5, gid="samples")
    for k, (t, x) in enumerate(zip(edges, sampled, strict=True)):
        above.annotate(f"$x^{{{k}}}$", (t, x), (4, 6), textcoords="offset points", fontsize=7.5, color=OUTCOME_INK)
    below.stairs(held, edges, baseline=None, color="#0b3c5d", linewidth=1.8, gid="input")
    below.plot(edges[:-1], held, "o", color="#0b3c5d", markersize=4)
    for k, (t, u) in enumerate(zip(edges, held, strict=False)):
        below.annotate(
            f"$u^{{{k}}}$", (t + delta / 2, u), (0, 3), textcoords="offset points", ha="center", fontsize=7.5
        )
    for level in levels:
        below.axhline(level, color="#d0d0d0", linewidth=0.5, zorder=0)
    for ax in axes:
        ax.margins(y=0.2)
        for t in edges:
            ax.axvline(t, color=FAINT, linestyle=":", linewidth=0.6, zorder=0)
    above.tick_params(labelbottom=False)
    below.set_xticks(edges, [f"$t_{{{k}}}$\n{t:.3g}" for k, t in enumerate(edges)])
    below.set_xlabel("time (s)")
    above.set_ylabel(names[0])
    below.set_ylabel(names[1])


def draw_lookup(figure: Figure, table: LookupTable, run: Run | None = None, *, through: State | None = None) -> None:
    """The look-up table as small C-space slices and a run's way through it (Fig. 8), for a figure of 7 by 7 inches.

    Row k is the step, column n the steps to go. Each row is sliced at where the agent was then in the run (or through
    the state `through`), so the dot, the joint angles at step k, lies in the framed set and in none to its left.
    """
    figure.set_layout_engine("none")
    steps, problem = table.steps, table.problem
    left, top, size, gap = 0.105, 0.915, 0.087, 0.0095
    colours = step_colours(steps)
    at = samples(run, problem) if run is not None else np.array([], dtype=np.int64)
    promised = [] if run is None else [int(n) for n in run.steps_to_go]
    if run is not None and run.outcome == "reached":  # by the true target: S_k^N on the grid may miss its rim
        promised.append(0)
    framed: list[Axes] = []
    for k in range(steps + 1):
        state = run.states[at[min(k, len(at) - 1)]] if run is not None else np.asarray(through, dtype=np.float64)
        now = promised[k] if k < len(promised) else None
        where = plane(problem.grid, state, resolution=CELL)
        for n in range(steps + 1):
            ax = figure.add_axes((left + n * (size + gap), top - (k + 1) * size - k * gap, size, size))
            ax.set(xticks=[], yticks=[], xlim=where.x[[0, -1]], ylim=where.y[[0, -1]])
            if n > steps - k:
                ax.axis("off")
                if n == steps - k + 1:
                    ax.text(0, 0, r"$*$", ha="center", va="center", color="#777777", fontsize=10)
                continue
            ax.set_gid(f"cell-{k}-{n}")
            for part in problem.unsafe:
                values = where.shaped(part.level_set(where.points[:, part.axes], k * problem.delta))
                faint = {"facecolor": "#e9e9e9", "edgecolor": "#9a9a9a", "linewidth": 0.5}
                draw_set(ax, where, values, faint, part.name, zorder=1.0)
            values = where.of(problem.grid, table.values(start=k, within=n))
            draw_set(
                ax,
                where,
                values,
                {"facecolor": colours[n], "edgecolor": "#222222", "linewidth": 0.5},
                "tube",
                zorder=2.0,
            )
            if k < len(at):
                joints = np.where(problem.grid.periodic, np.mod(state + np.pi, 2 * np.pi) - np.pi, state)[:2]
                chosen = n == now
                ax.plot(
                    *joints,
                    "o",
                    markersize=4.2 if chosen else 2.0,
                    color=OUTCOME_INK,
                    markeredgecolor="white",
                    markeredgewidth=0.6,
                    zorder=5,
                )
                if chosen:
                    framed.append(ax)
            for spine in ax.spines.values():
                spine.set(visible=True, linewidth=0.5, color="#9a9a9a")
    for ax in framed:
        for spine in ax.spines.values():
            spine.set(linewidth=2.0, color=OUTCOME_INK)
        ax.set_zorder(2)
    for first, second in pairwise(framed):
        figure.add_artist(
            ConnectionPatch(
                (0.0, 0.0),
                (1.0, 1.0),
                "axes fraction",
                "axes fraction",
                axesA=first,
                axesB=second,
                arrowstyle="-|>,head_length=5,head_width=2.5",
                mutation_scale=1.0,
                color=OUTCOME_INK,
                linewidth=1.4,
                zorder=10,
            )
        )
    for n in range(steps + 1):
        figure.text(left + n * (size + gap) + size / 2, top + 0.008, str(n), ha="center", va="bottom")
        figure.text(left - 0.008, top - n * (size + gap) - size / 2, str(n), ha="right", va="center")
    middle = (steps + 1) * (size + gap) / 2
    figure.text(left + middle, top + 0.045, r"reach within ... steps ($n$)", ha="center", va="bottom", fontsize=9)
    figure.text(0.035, top - middle, r"from step ($k$)", ha="center", va="center", rotation=90, fontsize=9)
    figure.text(0.98, 0.06, LOOKUP_KEY, ha="right", va="bottom", linespacing=1.6, color="#333333")


def draw_workspace_run(ax: Axes, problem: ReachAvoidProblem, run: Run) -> None:
    """The end-effector's way in the workspace, the arm faintly at sampling times, the sets at the end (Fig. 12a)."""
    view, at = scene(problem), samples(run, problem)
    draw_workspace(ax, view, state=run.states[-1], time=float(run.times[-1]), arrows=False)
    for index in at[:-1]:
        draw_arm(ax, view, run.states[index], alpha=0.25, zorder=3.0)
    tips = view.arm.tip(run.states[:, :2])
    ax.plot(*tips.T, zorder=6, gid="tip-path", **WAY)
    ax.plot(*tips[at].T, "o", color="white", markeredgecolor=OUTCOME_INK, markersize=3.6, zorder=6.5)
    ax.plot(*run.states[:, 2:4].T, color=PURSUER["edgecolor"], linestyle=":", linewidth=1.0, zorder=4)


def draw_cspace_run(ax: Axes, table: LookupTable, run: Run) -> None:
    """The run in C-space over the tube it starts in, with target and unsafe sets as they are at its end (Fig. 12b)."""
    problem, at = table.problem, samples(run, table.problem)
    where = plane(problem.grid, run.states[0])
    n = int(run.steps_to_go[0])
    draw_set(ax, where, where.of(problem.grid, table.values(start=0, within=n)), FULL, "tube", zorder=1.0)
    draw_constraints(ax, problem, through=run.states[-1], step=float(run.times[-1]) / problem.delta)
    draw_path(ax, problem.grid, run.states, marks=run.states[at])


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


def draw_moment(figure: Figure, table: LookupTable, run: Run, *, index: int) -> None:
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
    where = plane(problem.grid, state, resolution=CELL * 2 - 1)
    values = where.of(problem.grid, table.values(start=goal[0], within=goal[1]))
    draw_set(right, where, values, FULL, "tube", zorder=1.0)
    draw_constraints(
        right, problem, through=state, step=float(run.times[index]) / problem.delta, resolution=CELL * 2 - 1
    )
    draw_path(right, problem.grid, run.states[: index + 1], marks=state[None])
    left.set_title(f"$t = {run.times[index]:.2f}$ s, step {step}")
    right.set_title(f"{n} step{'' if n == 1 else 's'} to go" if index < len(run.times) - 1 else run.outcome)


def save_animation(
    table: LookupTable, run: Run, path: Path, *, frames: int = 41, rate: int = 12, dpi: int = 90
) -> Path:
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
