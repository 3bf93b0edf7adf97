"""Chapter 14, The evader, and limits: what it draws, its widgets, and the checks of its exercises."""

from fractions import Fraction
from functools import lru_cache
from itertools import product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import sdhj
from course.chapter_08 import TALL, draw_tube_and_arm
from course.exercises import exercise, expect, expect_close
from course.slices import POSTURE
from course.widgets import Explorer, Numbers, agent_sliders, slider
from sdhj.common.remembering import FloatArray
from sdhj.table.batches import Table

# ---- pictures


def draw_limits(ax: Axes, bounds: FloatArray, shares: FloatArray, limit: float) -> None:
    """Shares of C within 0 and 8 steps, (B, 2), against the disturbance, with the limit that the pencil found."""
    for column, label in enumerate(("in the target", "within 8 steps")):
        ax.plot(bounds, shares[:, column], marker="o", label=label, gid=label)
    ax.axvline(limit, color="#c44e00", linestyle=":", label="predicted limit")
    share = r"share of $\mathcal{C}$ inside"
    ax.set(xlabel="disturbance of the joints (rad/s)", ylabel=share, ylim=(0, 1.05 * float(np.max(shares))))
    ax.grid(axis="y")
    ax.legend()


# ---- widgets


def explore_evader(nodes: int = 25, method: str = "hji") -> Explorer:
    """The evading target of Sec. 6.1, solved at each change of its speed and size."""

    @lru_cache(maxsize=2)
    def solved(v_e: float, v_d: float, radius: float) -> Table:
        problem = sdhj.evader_case_study(nodes, v_e_max=v_e, v_d_max=v_d, evader_radius=radius)
        return sdhj.solve(problem, method=method, progress=False, play=False)

    def draw(figure: Figure, v_e: float, v_d: float, radius: float, px: float, py: float) -> Numbers:
        return draw_tube_and_arm(figure, solved(v_e, v_d, radius), state=(*POSTURE, px, py))

    problem = sdhj.evader_case_study(nodes)
    controls = {
        "v_e": slider("evader's speed (m/s)", 0.0, 0.5, 0.025, 0.1, live=False),
        "v_d": slider("disturbance (rad/s)", 0.0, 2.0, 0.1, 0.3, live=False),
        "radius": slider("evader's radius (m)", 0.05, 0.1, 0.01, 0.06, live=False),
        **agent_sliders(problem),
    }
    alt = "A slice of the tube of the evader game"
    return Explorer(draw, controls, size=TALL, slow="solving", alt=alt, motion="v_e")


# ---- checks


@exercise("14.1", "Stretched, the tip is l1 + l2 from the first joint and l2 from the second; both turn the same way.")
def check_tip(top_speed):
    """(l1 + 2 l2) u, stretched, both joints the same way."""
    given = sdhj.arm_case_study(nodes=5).recipe["arguments"]
    (l1, l2), u = given["lengths"], given["u_max"]
    expect(abs(top_speed - (l1 + l2) * u) > 1e-9, "that is the first joint alone.")
    expect(abs(top_speed - (l1 + l2) * (u + given["v_d_max"])) > 1e-9, "without a disturbance.")
    expect_close(top_speed, (l1 + 2 * l2) * u, "stretched, the first joint moves l1 + l2, the second l2.", within=1e-6)


@exercise(
    "14.2",
    "|a + b|^2 = |a|^2 + |b|^2 + 2 a . b with the columns a and b of J; the better sign makes the last term |a . b|.",
)
def check_push(push_formula, gentlest_angle):
    """sqrt(c1^2 + c2^2 + 2 |c1 . c2|) with the columns of J."""
    for l1, l2 in ((0.15, 0.15), (0.3, 0.1), (0.1, 0.3)):
        for q2 in np.linspace(-3, 3, 25):
            first = np.array([l1 + l2 * np.cos(q2), l2 * np.sin(q2)])
            second = l2 * np.array([np.cos(q2), np.sin(q2)])
            wanted = max(np.linalg.norm(first + second), np.linalg.norm(first - second))
            got = push_formula(q2, l1, l2)
            hint = f"q2 = {q2:.2f}, lengths {l1}, {l2}: |a + b|^2 = |a|^2 + |b|^2 + 2 a.b; take the better sign."
            expect_close(got, wanted, hint, within=1e-9)
    nu = [push_formula(q2, 1.0, 1.0) for q2 in np.linspace(0, np.pi, 4001)]
    expect_close(push_formula(gentlest_angle, 1.0, 1.0), min(nu), "there nu is not least on [0, pi].", within=1e-6)


@exercise("14.3", "The levels are -3 + 6 i / (m - 1). When is every one of them among those of m'?")
def check_nested(pairs):
    """m - 1 divides m' - 1."""
    levels = {m: {Fraction(-3) + Fraction(6 * i, m - 1) for i in range(m)} for m in range(2, 10)}
    wanted = {(m, n) for m in levels for n in levels if m < n and levels[m] <= levels[n]}
    got = {(int(m), int(n)) for m, n in pairs}
    expect(got >= wanted, f"some are missing, for example {min(wanted - got, default='')}.")
    expect(got <= wanted, f"{max(got - wanted, default='')}: a level of the first is missing in the second.")


@exercise(
    "14.4",
    "A norm is convex, so only corners matter, four of s and four of s'. It grows with the evader's speed: bisect.",
)
def check_evader_limit(evader_limit):
    """Vertices decide: a convex function is largest at one."""
    rng = np.random.default_rng(0)
    corners = np.array(list(product((-1, 1), repeat=2)))
    for _ in range(40):
        J, rho, delta, v_d = rng.normal(size=(2, 2)) * 0.2, 0.06, 0.1, rng.uniform(0, 0.6)
        blur = delta * v_d * np.max(np.linalg.norm(corners @ J.T, axis=1))
        if blur >= rho:
            continue
        got = float(evader_limit(J, rho, delta, v_d))
        ends = delta * (v_d * (corners @ J.T)[:, None] + got * corners[None])
        reach = np.max(np.linalg.norm(ends, axis=-1))
        expect(got >= 0, "a speed is not negative.")
        expect(reach <= rho + 1e-6, f"J = {J.round(3).tolist()}: at your limit the gap opens to {reach:.5f} > rho.")
        expect(reach >= rho - 1e-6, f"J = {J.round(3).tolist()}: a faster evader is still caught, {reach:.5f} < rho.")
    return "At the sharp limit the two pushes need not be parallel."


def _captured(r, v, delta, n):
    """By the definition: for each u the gaps whose image lies in one of the intervals."""
    intervals = [(-r, r)]
    for _ in range(n):
        found = list(intervals)
        for u in (-1, 0, 1):
            for left, right in intervals:
                a, b = left + delta * u + delta * v, right + delta * u - delta * v
                if a <= b:
                    found.append((a, b))
        found.sort()
        intervals = [found[0]]
        for a, b in found[1:]:
            if a <= intervals[-1][1]:
                intervals[-1] = intervals[-1][0], max(b, intervals[-1][1])
            else:
                intervals.append((a, b))
    return intervals


@exercise(
    "14.5",
    "In one step each interval shrinks by delta v at both ends and moves by delta u. Keep what is not empty, "
    "sort, and unite what meets.",
)
def check_capture(capture_set):
    """Against the recursion, connected and in pieces."""
    F = Fraction
    for r, v, delta, n, what in (
        (F(1), F(1, 2), F(1, 2), 0, "no step: the target itself"),
        (F(1), F(1, 2), F(1, 2), 1, "one step: u = 1 and u = -1 add a piece on either side"),
        (F(1), F(1, 2), F(1, 2), 4, "four steps"),
        (F(1, 4), F(1, 4), F(1), 1, "r = delta v: from outside only single gaps are caught"),
        (F(3, 10), F(1, 4), F(1), 3, "pieces that do not touch: the gaps between the inputs' images are lost"),
        (F(1, 5), F(1, 4), F(1), 3, "r < delta v: the evader always gets away"),
        (F(1), F(0), F(1, 4), 5, "an evader that does not move"),
    ):
        got = [tuple(one) for one in capture_set(r, v, delta, n)]
        expect(not any(isinstance(end, float) for one in got for end in one), "as Fractions: nothing is rounded.")
        expect(got == sorted(got), f"{what}: sort the intervals.")
        expect(got == _captured(r, v, delta, n), f"{what} (r = {r}, v = {v}, delta = {delta}, n = {n}).")
