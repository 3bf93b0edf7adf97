"""Chapter 3, The value function: what it draws, its widgets, and the checks of its exercises."""

from collections.abc import Callable, Mapping
from itertools import product
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from course.exercises import exercise, expect, expect_close
from course.widgets import Explorer, Numbers, choice, slider
from sdhj.common.remembering import FloatArray
from sdhj.plotting.looks import OUTCOME_INK

# ---- pictures

BLUE, GREY, GREEN, RED = "#0b3c5d", "#8c8c8c", "#2e7d32", "#e8b4a0"


def draw_curves(
    ax: Axes, x: FloatArray, curves: Mapping[str, FloatArray], sets: bool = True, legend: str = "upper center"
) -> None:
    """Level-set functions on a line, and the sets where they are <= 0 as bars below."""
    ax.axhline(0.0, color=GREY, linewidth=0.6)
    looks = [(GREY, "-", 1.0), (BLUE, "-", 1.8), ("#c44e00", "--", 1.6), (GREEN, ":", 2.0)]
    lowest = min(float(np.min(values)) for values in curves.values())
    for row, ((name, values), (colour, dashes, width)) in enumerate(zip(curves.items(), looks, strict=False)):
        ax.plot(x, values, color=colour, linestyle=dashes, linewidth=width, label=name, gid=name)
        if sets:
            bar = np.where(values <= 0, lowest - 0.08 - 0.05 * row, np.nan)
            ax.plot(x, bar, color=colour, linewidth=3, linestyle="-", solid_capstyle="butt")
    ax.set(xlim=(x[0], x[-1]), xlabel="$x$ (m)", ylabel="cost (m)")
    ax.legend(loc=legend)


def draw_rides(
    ax: Axes, times: FloatArray, paths: FloatArray, costs: FloatArray, target: FloatArray, unsafe: FloatArray
) -> None:
    """Runs (M, T) over time, the costliest bold; the target is a bar at the end, the unsafe set a band."""
    if unsafe.size:
        ax.axhspan(unsafe.min(), unsafe.max(), color=RED, linewidth=0, zorder=0, gid="unsafe")
    ax.plot(
        np.full(target.size, times[-1] * 1.03), target, color=GREEN, linewidth=5, solid_capstyle="butt", gid="target"
    )
    for path in paths[:: max(1, len(paths) // 80)]:
        ax.plot(times, path, color=GREY, linewidth=0.5, linestyle="-")
    worst = int(np.argmax(costs))
    ax.plot(
        times, paths[worst], color=OUTCOME_INK if costs[worst] > 0 else BLUE, linewidth=2, linestyle="-", gid="worst"
    )
    ax.plot(0.0, paths[0, 0], "o", color=BLUE)
    ax.set(xlabel="time since $t_k$ (s)", ylabel="$x$ (m)", xlim=(-0.02, times[-1] * 1.06))


def draw_games_on_a_line(figure: Figure, shown: Mapping[str, Any]) -> None:
    """Runs from one start on the left, cost and value of all starts on the right."""
    left, right = figure.subplots(1, 2)
    draw_rides(left, *(shown[name] for name in ("times", "paths", "costs", "target", "unsafe")))
    draw_curves(right, shown["x"], shown["curves"])


# ---- widgets


def explore_value(model: Callable[..., Mapping[str, Any]]) -> Explorer:
    """The value of a start, by trying signals and from the equation; `model` is the reader's, with these arguments."""

    def draw(figure: Figure, game: str, start: float, v_max: float, duration: float) -> Numbers:
        shown = model(game=game, start=start, v_max=v_max, duration=duration)
        draw_games_on_a_line(figure, shown)
        values = list(shown["curves"].values())[-1]
        return {
            "costliest run tried": float(np.max(shown["costs"])),
            "value from the equation": float(np.interp(start, shown["x"], values)),
        }

    controls = {
        "game": choice("game", ("reach", "avoid", "reach-avoid"), "reach-avoid"),
        "start": slider("start x (m)", -1.2, 1.0, 0.02, -0.1),
        "v_max": slider("adversary, at most (m/s)", 0.0, 0.8, 0.05, 0.25),
        "duration": slider("length of the interval (s)", 0.1, 1.0, 0.05, 0.6),
    }
    return Explorer(draw, controls, alt="Runs against many signals, and the value function on a line", motion="v_max")


# ---- checks


@exercise("3.1", "p . v is greatest where v points along p (Cauchy and Schwarz).")
def check_ball(hamiltonian):
    """p . u + v_max |p|."""
    p, u = np.random.default_rng(0).normal(size=(200, 2)), np.array([1.0, -0.4])
    got, angle = np.asarray(hamiltonian(p, u, 0.7)), np.linspace(0, 2 * np.pi, 721)
    expect(got.shape == (200,), "one number for each row of p.")
    pushes = 0.7 * np.stack([np.cos(angle), np.sin(angle)])
    tried = p @ u + (p @ pushes).max(axis=1)
    expect(got >= tried - 1e-9, "the adversary finds a direction that pays more: which way does it push, given p?")
    wanted = p @ u + 0.7 * np.linalg.norm(p, axis=1)
    box = p @ u + 0.7 * np.abs(p).sum(axis=1)
    expect(not np.allclose(got, box), "that is the box |v|_inf <= v_max: the ball has no corners.")
    expect_close(got, wanted, "the best push is along p, as long as it may be.")
    expect_close(hamiltonian(np.zeros((1, 2)), u, 0.7), [0.0], "p = 0 must give 0 and not NaN.")


@exercise(
    "3.2", "Who commits expects the costliest column in each row; who answers has the cheapest row in each column."
)
def check_order(orders):
    """(min max, max min)."""
    rng = np.random.default_rng(1)
    for _ in range(50):
        table = rng.normal(size=(3, 5))
        first, second = orders(table)
        expect(first >= second - 1e-12, "whoever commits first cannot be better off: the robot pays, so it minimises.")
        expect_close(
            first, table.max(axis=1).min(), "committing first: for each row the costliest column, then the best row."
        )
        expect_close(
            second, table.min(axis=0).max(), "answering: for each column the cheapest row, then the worst column."
        )
    return "In a sampled-data game the robot commits, so it pays the first."


@exercise("3.3", "Put H(p) = |p| into (3.7), and write down which inequality belongs to which side.")
def check_touch(passes):
    """above: rate <= |p|; below: rate >= |p|."""
    for rate, p in product((-0.5, 0.0, 0.3, 1.0), (-1.0, -0.3, 0.0, 0.6, 1.0)):
        at = f"rate {rate}, slope {p}"
        expect(bool(passes(rate, p, "above")) == (rate <= abs(p)), f"{at}, from above: (3.7) asks for rate <= H(p).")
        expect(bool(passes(rate, p, "below")) == (rate >= abs(p)), f"{at}, from below: (3.7) asks for rate >= H(p).")
    return "tau - |x| fails it at 0: rate 1 from above with any slope |p| < 1."


@exercise(
    "3.4",
    "By the time T the state can have touched all of [x + min(0, T a), x + max(0, T b)]. The point nearest to c "
    "counts.",
)
def check_avoid_tube(avoid_value):
    """radius - distance from the centre to [x + min(0, T low), x + max(0, T high)]."""
    x = np.linspace(-2, 2, 81)
    for low, high in ((0.2, 1.0), (-0.4, 0.6), (-1.0, -0.3)):
        got = np.asarray(avoid_value(x, low, high, 0.1, 0.25, 0.8))
        expect(got.shape == x.shape, "one value for each start.")
        at_end = np.clip(0.1, x + 0.8 * low, x + 0.8 * high)
        expect(
            low < 0 < high or not np.allclose(got, 0.25 - np.abs(at_end - 0.1)),  # else the end is the nearest
            "that looks at the end only. The start counts, and all between.",
        )
        near = np.clip(0.1, x + min(0.0, 0.8 * low), x + max(0.0, 0.8 * high))
        expect_close(
            got, 0.25 - np.abs(near - 0.1), f"velocities in [{low}, {high}]: which points can be touched by T?"
        )


def _sampled(x, intervals):
    nodes = np.linspace(-3.0, 3.0, 4801)
    delta, h = 0.8 / intervals, nodes[1] - nodes[0]
    reach = round(0.5 * delta / h)
    values = np.abs(nodes) - 0.3
    for _ in range(intervals):
        padded = np.pad(values, reach, mode="edge")
        worst = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1).max(axis=1)
        values = np.min([np.interp(nodes + u * delta, nodes, worst) for u in (-1.0, 0.0, 1.0)], axis=0)
    return np.interp(x, nodes, values)


@exercise(
    "3.5",
    "On a fine line: the maximum over all that the push reaches, then the minimum over the three shifts; this N times.",
)
def check_sampled(sampled_value):
    """N times the best input against the worst push."""
    x = np.linspace(-1.2, 1.2, 49)
    limit = np.maximum(np.abs(x) - 0.4, 0.0) - 0.3
    for intervals in (1, 2, 4, 8):
        got, wanted = np.asarray(sampled_value(x, intervals)), _sampled(x, intervals)
        expect(got.shape == x.shape, "one value for each start.")
        expect(
            got >= limit - 0.01, f"N = {intervals}: cheaper than with measurements at every instant. Who moves first?"
        )
        expect_close(
            got, wanted, f"N = {intervals}: the robot chooses anew at each measurement, knowing x.", within=0.01
        )
    return "It tends to max(|x| - 0.4, 0) - 0.3, the continuous-time value: what is above it is the price of holding."
