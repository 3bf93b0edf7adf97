"""Chapter 17, An experiment: what it draws, its widgets, and the checks of its exercises."""

from collections.abc import Callable
from fractions import Fraction
from itertools import product
from math import ceil, log
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from course.chapter_12 import LOST
from course.exercises import exercise, expect, expect_close
from course.widgets import Explorer, Numbers, slider
from sdhj.common.remembering import FloatArray
from sdhj.plotting.looks import FAINT, OUTCOME_INK

# ---- pictures


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


# ---- widgets

PATTERN = np.array([1.0, -1.0, -1.0, 1.0, 0.0, 1.0, -1.0, 1.0])  # of the largest speed


def explore_tracking(follow: Callable[..., tuple[Any, ...]], expected: Callable[[float, float], float]) -> Explorer:
    """How far a joint is from its reference: `follow` simulates it, `expected` is the formula."""

    def draw(figure: Figure, torque: float, u_max: float, ratio: float) -> Numbers:
        formula = expected(2 * u_max, torque)
        times, *ways, torques = follow(u_max * PATTERN[None], torque, ratio=ratio)
        reference, angle = (way[0] for way in ways)
        apart = draw_tracking(figure, times, reference, angle, torques[0], formula)
        return {"largest distance (rad)": apart, "formula (17.2)": formula}

    controls = {
        "torque": slider("torque (N m)", 0.5, 8.0, 0.5, 4.0),
        "u_max": slider("speed u (rad/s)", 0.5, 3.0, 0.5, 2.0),
        "ratio": slider("damping ratio", 0.5, 4.0, 0.5, 2.5),
    }
    alt = "A joint, its reference, how far they are apart, and the torque of its motor"
    return Explorer(draw, controls, size=(7.0, 4.6), alt=alt, motion="torque")


# ---- checks


@exercise("17.1", "The joint i turns all that comes after it: the links i, i + 1, ..., which are at most stretched.")
def check_lever(lever):
    """sum_i e_i (l_i + ... + l_n)."""
    expect(lever([1], [Fraction(1, 10)]) == Fraction(1, 10), "one link of 1 m that turns by 1/10: 1/10 m.")
    expect(lever([2, 1], [0, Fraction(1, 10)]) == Fraction(1, 10), "only the second joint is off: it turns 1 m.")
    expect(lever([2, 1], [Fraction(1, 10), 0]) == Fraction(3, 10), "only the first is off: it turns both links, 3 m.")
    rng = np.random.default_rng(0)
    for _ in range(100):
        n = int(rng.integers(1, 6))
        lengths, errors = ([Fraction(int(k), 7) for k in rng.integers(0, 9, n)] for _ in range(2))
        wanted = sum(e * sum(lengths[i:]) for i, e in enumerate(errors))
        expect(lever(lengths, errors) == wanted, f"links {lengths}, errors {errors}: it should be {wanted}.")


@exercise("17.2", "(1 - eps)^n has to be at most 1 - confidence: take logarithms, and round up.")
def check_count(records_needed):
    """The least n with (1 - eps)^n <= 1 - confidence."""
    expect(records_needed(0.01, 0.95) == 299, "about 3 / eps at 95 %, and a whole number: 299 for 1 %.")
    expect(records_needed(0.4, 0.7) == 3, "0.6^2 = 0.36 is more than 0.3, and 0.6^3 is less: three records.")
    rng = np.random.default_rng(0)
    for _ in range(200):
        eps, confidence = float(rng.uniform(1e-4, 0.5)), float(rng.uniform(0.5, 0.999))
        wanted = ceil(log(1 - confidence) / log(1 - eps))
        got = records_needed(eps, confidence)
        expect(got == wanted, f"eps = {eps:.4g} at {confidence:.2%}: {wanted} records, got {got}.")


@exercise("17.3", "Take what friction needs off the torque, and solve (17.2) for what is left.")
def check_motor(torque_needed):
    """change^2 inertia / (2 error), plus what friction takes."""
    expect_close(torque_needed(4.0, 0.018, 0.036, 0.0), 4.0, "the chapter's arm: 4 N m for 0.036 rad, Eq. (17.2).")
    expect_close(torque_needed(8.0, 0.018, 0.036, 0.0), 16.0, "twice the change of speed takes four times the torque.")
    expect_close(torque_needed(4.0, 0.018, 0.036, 0.5), 4.5, "friction takes its part before anything is accelerated.")
    rng = np.random.default_rng(0)
    for change, inertia, error, friction in rng.uniform(0.01, 3.0, (100, 4)):
        said = f"{change:.3g} rad/s, {inertia:.3g} kg m^2, {error:.3g} rad, {friction:.3g} N m."
        wanted = change**2 * inertia / (2 * error) + friction
        expect_close(torque_needed(change, inertia, error, friction), wanted, said)


@exercise("17.4", "Each measured difference may be off by the errors of both its ends.")
def check_push(surely):
    """max(0, max |dy / dt - u| - 2 e / dt)."""
    calm = np.array([0.0, 0.1, 0.2])
    expect_close(surely(calm, np.ones(2), 0.1, 0.0), 0.0, "it moves as it was told to: no push.")
    expect_close(surely(calm, np.zeros(2), 0.1, 0.0), 1.0, "told to rest, it moves at 1: that is all push.")
    expect_close(surely(calm, np.zeros(2), 0.1, 0.01), 0.8, "two errors of 0.01 in 0.1 s may be 0.2 of it.")
    expect_close(surely(calm, np.zeros(2), 0.1, 0.5), 0.0, "where errors explain all, it is 0 and not less.")
    expect_close(surely(-calm, np.zeros(2), 0.1, 0.01), 0.8, "a push may have either sign.")
    rng = np.random.default_rng(0)
    for _ in range(100):
        y, u = rng.normal(size=12), rng.normal(size=11)
        dt, error = float(rng.uniform(0.05, 1.0)), float(rng.uniform(0.0, 0.5))
        wanted = max(0.0, float(np.abs(np.diff(y) / dt - u).max()) - 2 * error / dt)
        expect_close(surely(y, u, dt, error), wanted, f"dt = {dt:.3g}, e = {error:.3g}.")


@exercise("17.5", "There are 2^N sequences of extreme inputs; for N = 7 that is few enough to try all.")
def check_worst(worst_commands):
    """As bad as the worst of all."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        weights, steps = rng.normal(size=(7, 7)), 7

        def peak(inputs, weights=weights):
            return float((weights @ np.asarray(inputs)).max())

        found = np.asarray(worst_commands(peak, 2.0, steps))
        expect(found.shape == (steps,), f"a sequence of {steps} inputs.")
        expect(bool((np.abs(found) == 2.0).all()), "of inputs that are -u_max or u_max.")
        worst = max(peak(2.0 * np.array(one)) for one in product((-1.0, 1.0), repeat=steps))
        expect(peak(found) >= worst * (1 - 1e-12), f"one of them has a peak of {worst:.4g}, yours {peak(found):.4g}.")
