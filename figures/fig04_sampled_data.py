"""Fig. 4: The state moves all the time, but it is measured, and the input chosen, at the times t_k only."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from common import Context, command_of
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sdhj import plotting
from sdhj.common.remembering import FloatArray
from sdhj.plotting.looks import FAINT, INK, OUTCOME_INK

PARTS = 40  # Runge-Kutta steps in each interval


@dataclass(frozen=True)
class SampledRun:
    """A sampled-data run of the boat: `times` (T,), `states` (T, 2), and the inputs `held` (K, 2) over intervals."""

    times: FloatArray
    states: FloatArray
    held: FloatArray
    levels: FloatArray
    delta: float


def sampled_run(
    *, delta: float = 0.4, intervals: int = 6, gain: float = 2.4, wind: float = 1.1, turn: float = 0.8, seed: int = 0
) -> SampledRun:
    """The boat steers for (0.5, 0.3) by what it measured at t_k, quantised to five levels, and holds that (Fig. 4).

    The wind, a smooth one within its bound, and the turning water act all the time, also between the measurements.
    """
    levels = np.linspace(-1.5, 1.5, 5)
    phases = np.random.default_rng(seed).uniform(0.0, 2 * np.pi, (2, 2))
    rates = np.array([[9.0, 23.0], [11.0, 19.0]])

    def blowing(t: float) -> FloatArray:
        return wind * np.sin(rates * t + phases).mean(axis=1)

    def velocity(q: FloatArray, u: FloatArray, t: float) -> FloatArray:
        return u + turn * np.array([-q[1], q[0]]) + blowing(t)

    h, goal = delta / PARTS, np.array([0.5, 0.3])
    q, states, held = np.array([-0.8, -0.5]), [], []
    for k in range(intervals):
        wanted = gain * (goal - q) - turn * np.array([-q[1], q[0]])
        u = levels[np.argmin(np.abs(wanted[:, None] - levels), axis=1)]
        held.append(u)
        for part in range(PARTS):
            states.append(q)
            t = k * delta + part * h
            k1 = velocity(q, u, t)
            k2 = velocity(q + h / 2 * k1, u, t + h / 2)
            k3 = velocity(q + h / 2 * k2, u, t + h / 2)
            q = q + h / 6 * (k1 + 2 * k2 + 2 * k3 + velocity(q + h * k3, u, t + h))
    states.append(q)
    times = np.linspace(0.0, intervals * delta, len(states))
    return SampledRun(times, np.array(states), np.array(held), levels, delta)


def value(context: Context) -> float:
    """How far a state gets from the last that was measured, m."""
    run = sampled_run()
    known = run.states[np.arange(len(run.times) - 1) // PARTS * PARTS]
    return float(np.hypot(*(run.states[1:] - known).T).max())


def draw(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 3.6)
    draw_sampled_data(figure.subplots(2, 1, sharex=True, height_ratios=(1.25, 1.0)), sampled_run())
    return figure


def draw_sampled_data(axes: Sequence[Axes], run: SampledRun) -> None:
    """A continuous state, its samples, which are all that is known, and the input held, over one time line."""
    above, below = axes
    times, state, held, delta = run.times, run.states[:, 0], run.held[:, 0], run.delta
    edges = np.arange(len(held) + 1) * delta
    sampled = np.interp(edges, times, state)
    above.plot(times, state, color=INK, linestyle="-", gid="state", label="state $x(t)$")
    known: dict[str, Any] = {"color": OUTCOME_INK, "linestyle": (0, (3, 1.5)), "linewidth": 1.0}
    above.stairs(sampled[:-1], edges, baseline=None, gid="known", label="what the controller knows of it", **known)
    dots: dict[str, Any] = {"color": "white", "markeredgecolor": OUTCOME_INK, "markersize": 5, "zorder": 3}
    above.plot(edges, sampled, "o", gid="samples", label="measurement $x^k$", **dots)
    for k, (t, x) in enumerate(zip(edges, sampled, strict=True)):
        falls = k > 0 and x < sampled[k - 1]  # then the step is above
        looks: dict[str, Any] = {"ha": "right", "va": "top" if falls else "bottom", "color": OUTCOME_INK}
        above.annotate(f"$x^{{{k}}}$", (t, x), (-5, -4 if falls else 4), textcoords="offset points", **looks)
    below.stairs(held, edges, baseline=None, color="#0b3c5d", linewidth=1.8, gid="input", label="input $u^k$, held")
    below.plot(edges[:-1], held, "o", color="#0b3c5d", markersize=4)
    for k, (t, u) in enumerate(zip(edges, held, strict=False)):
        below.annotate(
            f"$u^{{{k}}}$", (t + delta / 2, u), (0, 3), textcoords="offset points", ha="center", fontsize=7.5
        )
    below.hlines(run.levels, 0.0, edges[-1], color="#d0d0d0", linewidth=0.5, zorder=0, label="levels of the input")
    for ax in axes:
        ax.margins(y=0.2)
        ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3)
        for t in edges:
            ax.axvline(t, color=FAINT, linestyle=":", linewidth=0.6, zorder=0)
    above.tick_params(labelbottom=False)
    below.set_xticks(edges, [f"$t_{{{k}}}$\n{t:.3g}" for k, t in enumerate(edges)])
    below.set_xlabel("time (s)")
    above.set_ylabel("state $x(t)$ (m)")
    below.set_ylabel("input $u(t)$ (m/s)")


if __name__ == "__main__":
    command_of(__file__)()
