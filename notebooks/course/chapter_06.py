"""Chapter 6, Configuration space: what it draws, its widgets, and the checks of its exercises."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from course.exercises import exercise, expect, expect_close
from course.slices import HERE, POSTURE, draw_arm_live, draw_sets, draw_slice_legend, wrapped
from course.widgets import Explorer, Numbers, agent_sliders, angle, slider
from sdhj.arm.case_studies import scene
from sdhj.common.remembering import FloatArray
from sdhj.plotting import draw_constraints, draw_set, draw_workspace, frame_slice, plane
from sdhj.plotting.looks import INK, UNSAFE_LOOKS
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sets import UnsafeSet

# ---- pictures


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
    draw_sets(right, problem, through=state, step=step)
    right.plot(*wrapped(state), **HERE)
    right.set_title("configuration space (slice)")
    draw_slice_legend(figure, problem)
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


# ---- widgets


def explore_spaces(problem: ReachAvoidProblem) -> Explorer:
    """Place the arm in C-space and see it in the workspace, or the other way round."""

    def draw(figure: Figure, q1: float, q2: float, px: float, py: float, step: float) -> Numbers:
        return draw_both_spaces(figure, problem, state=(q1, q2, px, py), step=step)

    controls = {
        "q1": angle("joint angle q1 (rad)", POSTURE[0]),
        "q2": angle("joint angle q2 (rad)", POSTURE[1]),
        **agent_sliders(problem),
        "step": slider("time (steps of delta)", 0.0, float(problem.steps), 0.1, 0.0),
    }
    alt = "The arm in the workspace and as a point in configuration space"
    return Explorer(draw, controls, size=(7.4, 3.9), alt=alt, motion="q1")


def explore_view_time(problem: ReachAvoidProblem) -> Explorer:
    """Swept volume of the moving obstacles over one interval, and what a union of samples misses."""

    def draw(figure: Figure, step: int, samples: int) -> Numbers:
        return draw_view_time(figure, problem, step=step, samples=samples)

    controls = {
        "step": slider("step k", 0, problem.steps - 1, 1, 2),
        "samples": slider("samples of the interval", 1, 20, 1, 2),
    }
    alt = "Swept and sampled obstacles in the workspace and in configuration space"
    return Explorer(draw, controls, alt=alt, motion="samples")


# ---- checks


@exercise("6.1", "By (6.4) the tip moves at most (l1 + l2) v + l2 v in a second.")
def check_disturbance(largest):
    """0.06 / ((0.3 + 0.15) 0.1)."""
    expect(abs(largest - 2.0) > 1e-6, "the second joint turns too, and its lever is l2.")
    expect(abs(largest - 4.0) > 1e-6, "the first joint turns too, with the stretched arm for its lever.")
    expect_close(largest, 0.06 / (0.45 * 0.1), "radius over (l1 + l2 + l2) delta.", within=0.005)
    return "The case study has 0.3 rad/s."


def _tip(q, lengths=(0.15, 0.15)):
    angles = np.cumsum(q)
    return np.array([np.dot(lengths, np.cos(angles)), np.dot(lengths, np.sin(angles))])


@exercise(
    "6.2",
    "Base, elbow and tip make an isosceles triangle: cos(q2 / 2) = r / (2 l), and q1 + q2 / 2 points at the tip.",
)
def check_inverse(inverse):
    """Two postures with the tip at a place."""
    rng = np.random.default_rng(0)
    for _ in range(100):
        r, bearing = rng.uniform(0.02, 0.29), rng.uniform(-np.pi, np.pi)
        place = r * np.cos(bearing), r * np.sin(bearing)
        both = np.asarray(inverse(*place), dtype=np.float64)
        expect(both.shape == (2, 2), "two pairs of joint angles.")
        for q in both:
            look = (
                f"these angles put the tip at {_tip(q).round(3)} and not at {np.round(place, 3)}: q2 is relative to q1."
            )
            expect_close(_tip(q), place, look, within=1e-7)
        apart = np.abs(np.angle(np.exp(1j * (both[0, 1] - both[1, 1]))))
        expect(apart > 1e-3, "twice the same posture: the elbow can be on either side, q2 and -q2.")


@exercise("6.3", "Half the way between two samples, r - depth and r are the sides of a right triangle.")
def check_samples(samples_needed):
    """1 + ceil(c delta / (2 sqrt(2 r depth - depth^2)))."""

    def depth(n, radius, speed, delta):
        half = speed * delta / (n - 1) / 2
        return radius - np.sqrt(radius**2 - half**2) if half < radius else radius

    for numbers, wanted in (
        ((0.04, 0.156, 0.1), 1e-5),
        ((0.04, 0.5, 0.4), 1e-3),
        ((0.1, 2.0, 0.5), 0.02),
        ((0.1, 1.0, 0.2), 0.02),
        ((0.04, 0.05, 0.1), 1e-3),
    ):
        n = samples_needed(*numbers, wanted)
        expect(n >= 2 and n == int(n), "a whole number, at least the two ends of the interval.")
        expect(
            depth(n, *numbers) <= wanted * (1 + 1e-9),
            f"{n} samples leave slivers that are deeper. n samples have n - 1 gaps.",
        )
        expect(n == 2 or depth(n - 1, *numbers) > wanted, f"one sample fewer than {n} would do as well.")


@exercise("6.4", "Wrap the angle first, for example with np.angle(np.exp(1j * q2)).")
def check_limits(overlap):
    """2.8 - |q2|, wrapped."""
    q = np.stack([np.zeros(2001), np.linspace(-9.0, 9.0, 2001)], axis=1)
    got = np.asarray(overlap(q))
    expect(got.shape == (2001,), "one value for each row of q.")
    turned = np.angle(np.exp(1j * q[:, 1]))
    sure = np.abs(np.abs(turned) - 2.8) > 1e-6
    near = np.abs(q[:, 1]) < 3.1
    expect(
        (got <= 0)[sure & near] == (np.abs(turned) > 2.8)[sure & near],
        "the unsafe set is |q2| > 2.8: inside is negative.",
    )
    expect(
        (got <= 0)[sure] == (np.abs(turned) > 2.8)[sure],
        "q2 and q2 + 2 pi are the same configuration: wrap the angle.",
    )
    slope = np.abs(np.diff(got)) / (q[1, 1] - q[0, 1])
    expect(slope <= 1 + 1e-6, "it jumps somewhere: is it continuous at q2 = pi?")
    expect(np.abs(np.asarray(overlap(q + np.array([1.0, 0.0]))) - got) < 1e-9, "it must not depend on q1.")


@exercise(
    "6.5",
    "np.cumsum of the angles gives the directions of the links, and the distance to a segment is that of exercise 1.4.",
)
def check_three_links(clearance):
    """Against points along the arm."""
    rng = np.random.default_rng(1)
    q, lengths = rng.uniform(-np.pi, np.pi, (500, 3)), (0.15, 0.1, 0.08)
    centre, radius, width = np.array([0.12, 0.05]), 0.04, 0.01
    got = np.asarray(clearance(q, lengths, width, centre, radius))
    expect(got.shape == (500,), "one clearance for each row of q.")
    angles, start, wanted = np.cumsum(q, axis=1), np.zeros((500, 2)), np.full(500, np.inf)
    for link in range(3):
        along = lengths[link] * np.stack([np.cos(angles[:, link]), np.sin(angles[:, link])], axis=1)
        theta = np.clip(np.sum((centre - start) * along, axis=1) / lengths[link] ** 2, 0, 1)
        wanted = np.minimum(wanted, np.linalg.norm(centre - start - theta[:, None] * along, axis=1))
        start = start + along
    wanted = wanted - radius - width
    expect_close(got[0], wanted[0], "the angles are relative: the third link stands at q1 + q2 + q3.", within=0.2)
    off = np.abs(got - wanted)
    expect(np.abs(off - width).max() > 1e-9, "the arm's half-width is missing, or has the wrong sign.")
    expect_close(got, wanted, "compare with the distance to many points along each of the three links.")
