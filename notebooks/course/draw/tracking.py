"""A joint that follows its reference as well as its motor can."""

from matplotlib.figure import Figure

from course.draw.lines import LOST
from sdhj.kernels import FloatArray
from sdhj.plotting.looks import FAINT, OUTCOME_INK


def draw_tracking(
    figure: Figure, times: FloatArray, reference: FloatArray, angle: FloatArray, torque: FloatArray, formula: float
) -> float:
    """Angles (rad), how far they are apart, and torques (N m); the largest distance. `formula` is what to expect."""
    both, off, motor = figure.subplots(3, 1, sharex=True, height_ratios=(1.0, 1.0, 0.7))
    both.plot(times, reference, color=LOST, linestyle="--", label="reference", gid="reference")
    both.plot(times, angle, color=OUTCOME_INK, linestyle="-", label="joint", gid="joint")
    both.set_ylabel("angle (rad)")
    both.legend(loc="lower right", fontsize="small")
    off.plot(times, angle - reference, color=OUTCOME_INK, linestyle="-", gid="off")
    for side in (-formula, formula):
        off.axhline(side, color=FAINT, linestyle=":", gid="formula")
    off.set_ylabel("apart (rad)")
    motor.plot(times, torque, color="#0b3c5d", linestyle="-", gid="torque")
    motor.set(ylabel="torque (N m)", xlabel="time (s)")
    return float(abs(angle - reference).max())
