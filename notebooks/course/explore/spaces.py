"""The arm in both spaces, live."""

from matplotlib.figure import Figure

from course.draw.slices import POSTURE
from course.draw.spaces import draw_both_spaces, draw_view_time
from course.widgets import Explorer, Numbers, agent_sliders, angle, slider
from sdhj.problem.problem import ReachAvoidProblem


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
    return Explorer(draw, controls, alt="The arm in the workspace and as a point in configuration space", motion="q1")


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
