"""Figures of closed-loop runs: on a slice, for any robot; in the workspace, for the arm (as in Fig. 12)."""

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sdhj.arm.case_studies import scene
from sdhj.plotting.looks import FULL_LOOKS, OUTCOME_INK, TARGET_LOOKS
from sdhj.plotting.scenes import draw_workspace
from sdhj.plotting.slices import draw_constraints, draw_path, draw_set, plane
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.simulation.runs import Trajectory
from sdhj.table.batches import Table

LIVE = 97  # points along each side of the slices of an animation, fewer than elsewhere for speed
THEN_LOOKS = TARGET_LOOKS | {"facecolor": "none", "linestyle": (0, (3, 1.5))}  # a target at a later time
WAY: dict[str, Any] = {"linestyle": "-", "linewidth": 1.5, "color": OUTCOME_INK}


def draw_run(ax: Axes, table: Table, run: Trajectory, *, axes: Sequence[int] = (0, 1)) -> None:
    """Draw a run on a slice: tube, target and unsafe sets at its start, and the target at its end outlined (Fig. 12b).

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    table : Table
    run : Trajectory
        Of `sdhj.simulate`.
    axes : (int, int)
        As for `plane`.

    Examples
    --------
    With the paper's arm on a few nodes:

    >>> import sdhj
    >>> from sdhj import plotting
    >>> arm = sdhj.solve(sdhj.arm_case_study(nodes=9, steps=2), play=False)
    >>> controller = sdhj.Controller(arm)
    >>> start = arm.grid.points()[(arm.values() <= 0).ravel()][0]
    >>> plotting.draw_run(plotting.new_figure(3, 3).subplots(), arm, sdhj.simulate(controller, start))
    """
    problem = table.problem
    where = plane(problem.grid, run.states[0], axes)
    n = int(run.steps_to_go[0]) if len(run.inputs) else 0  # a run that starts in the target has no inputs
    draw_set(ax, where, where.of(problem.grid, table.values(start=0, within=n)), FULL_LOOKS, "tube", zorder=1.0)
    draw_constraints(ax, problem, through=run.states[0], axes=axes)
    then = where.true(problem.target, float(run.times[-1]))  # whose outline is found by its name + "-then-edge"
    draw_set(ax, where, then, THEN_LOOKS, f"{problem.target.name}-then", zorder=5.0)
    draw_path(ax, problem.grid, run.states, axes, marks=run.samples)


def draw_frame(ax: Axes, problem: ReachAvoidProblem, run: Trajectory, *, index: int) -> None:
    """Draw the workspace at an instant of a run of the arm, with the end-effector's path so far."""
    view = scene(problem)
    draw_workspace(ax, view, state=run.states[index], time=float(run.times[index]))
    ax.plot(*view.arm.tip(run.states[: index + 1, :2]).T, zorder=6, gid="tip-path", **WAY)


def draw_moment(figure: Figure, table: Table, run: Trajectory, *, index: int) -> None:
    """Redraw the figure for one instant of a run: the workspace on the left, the next tube on a slice on the right.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        Cleared first.
    table : Table
        Of a case study of the arm, else ValueError.
    run : Trajectory
        Of `sdhj.simulate`.
    index : int
        Which of run.times, else IndexError.

    Examples
    --------
    With the paper's arm on a few nodes:

    >>> import sdhj
    >>> from sdhj import plotting
    >>> arm = sdhj.solve(sdhj.arm_case_study(nodes=9, steps=2), play=False)
    >>> start = arm.grid.points()[(arm.values() <= 0).ravel()][0]
    >>> run = sdhj.simulate(sdhj.Controller(arm), start)
    >>> plotting.draw_moment(plotting.new_figure(6, 3), arm, run, index=0)
    """
    figure.clear()
    problem = table.problem
    left, right = figure.subplots(1, 2)
    draw_frame(left, problem, run, index=index)
    step, n, goal = 0, 0, (0, 0)
    if len(run.inputs):  # a run that starts in the target has no inputs
        # a sampling time may come out as a little less than its step
        step = min(int(run.times[index] / problem.delta + 1e-6), len(run.inputs) - 1)
        n = int(run.steps_to_go[step])
        goal = (step + 1, max(n - 1, 0))  # the tube in which the interval has to end
    state = run.states[index]
    where = plane(problem.grid, state, resolution=LIVE)
    values = where.of(problem.grid, table.values(start=goal[0], within=goal[1]))
    draw_set(right, where, values, FULL_LOOKS, "tube", zorder=1.0)
    draw_constraints(right, problem, through=state, step=float(run.times[index]) / problem.delta, resolution=LIVE)
    draw_path(right, problem.grid, run.states[: index + 1], marks=state[None])
    left.set_title(f"$t = {run.times[index]:.2f}$ s, step {step}")
    right.set_title(f"{n} step{'' if n == 1 else 's'} to go" if index < len(run.times) - 1 else run.outcome)
