"""From the workspace to the configuration space; obstacles that move (Secs. 2 and 5.4)."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from course.draw.slices import HERE, draw_arm_live, draw_sets_quickly, wrapped
from course.widgets import Numbers
from sdhj.arm.case_studies import scene
from sdhj.kernels import FloatArray
from sdhj.plotting import draw_constraints, draw_set, draw_workspace, frame_slice, plane
from sdhj.plotting.looks import INK, UNSAFE_LOOKS
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sets import UnsafeSet


def union_of_samples(part: UnsafeSet, points: FloatArray, t0: float, t1: float, samples: int) -> FloatArray:
    """Union of a moving unsafe set at `samples` times of [t0, t1]: the paper's view-time, any number of samples."""
    times = np.linspace(t0, t1, samples) if samples > 1 else np.array([t0])
    return np.minimum.reduce([part.level_set(points, float(t)) for t in times])


def draw_both_spaces(
    figure: Figure, problem: ReachAvoidProblem, *, state: Sequence[float], step: float = 0.0
) -> Numbers:
    """The arm in the workspace and as a point of C-space, with the sets at time step * delta (Fig. 9)."""
    left, right = figure.subplots(1, 2)
    t = step * problem.delta
    draw_arm_live(left, problem, state, t)
    left.set_title(f"workspace, t = {t:.2f} s")
    draw_sets_quickly(right, problem, through=state, step=step)
    right.plot(*wrapped(state), **HERE)
    right.set_title("configuration space (slice)")
    q = np.asarray([state], dtype=np.float64)
    return {
        "target (m, inside below 0)": float(problem.target_value(q, t)[0]),
        "unsafe sets (m, collision below 0)": float(problem.unsafe_value(q, t)[0]),
    }


def draw_view_time(
    figure: Figure, problem: ReachAvoidProblem, *, step: int = 0, samples: int = 3, pieces: Sequence[float] = (0.0, 1.0)
) -> Numbers:
    """What the moving obstacles sweep over one interval, in C-space, and a union of samples that misses some of it."""
    left, right = figure.subplots(1, 2)
    part = next(part for part in problem.unsafe if part.moving)
    grid = problem.grid.subgrid(part.axes)
    t0, t1 = problem.time(step) + np.asarray(pieces) * problem.delta
    view = scene(problem)
    draw_workspace(left, view, time=t0, trail=np.linspace(t0, t1, max(samples, 2)))
    left.set_title(f"samples of the obstacles, t in [{t0:.1f}, {t1:.1f}] s")
    where = plane(grid, (0.0, 0.0), resolution=241)
    swept = where.shaped(part.over(where.points, t0, t1, "swept"))
    union = where.shaped(union_of_samples(part, where.points, t0, t1, samples))
    draw_set(right, where, swept, UNSAFE_LOOKS, "swept", zorder=1.0)
    draw_set(right, where, union, {"facecolor": "#e2e2e2", "edgecolor": INK, "linewidth": 0.8}, "sampled", zorder=2.0)
    frame_slice(right, grid)
    right.set_title("swept (red, all of it) and sampled (grey)")
    missed = (swept <= 0) & (union > 0)
    return {
        "share of C-space swept": float(np.mean(swept <= 0)),
        "of it missed by the samples": float(missed.sum() / (swept <= 0).sum()),
    }


def draw_kinematics(figure: Figure, problems: Mapping[str, ReachAvoidProblem], *, state: Sequence[float]) -> None:
    """The same joint angles under two readings of Eq. (8), workspace above, C-space below."""
    axes = figure.subplots(2, len(problems))
    for (top, bottom), (title, problem) in zip(axes.T, problems.items(), strict=True):
        draw_workspace(top, scene(problem), state=state)
        top.set_title(title)
        draw_constraints(bottom, problem, through=state)
        bottom.plot(*wrapped(state), **HERE)
