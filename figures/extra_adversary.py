"""The stronger the adversary is, the smaller is the victory domain, until nothing is left (Sec. 6.1).

Where nothing is left against the disturbance is also worked out by hand, to first order, as in chapter 14: near there
the grid still promises what nobody can keep, and what is certified has long come to its end.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from charts import draw_sweep
from common import Context, command_of
from experiments import share_won
from matplotlib.figure import Figure

import sdhj
from sdhj import plotting
from sdhj.arm.workspace import Disk
from sdhj.common.findings import ProjectionWarning
from sdhj.plotting.looks import INK

MAIN_JOB = False
BOUNDS = {
    "v_p_max": (0.0, 0.1, 0.2, 0.4, 0.8, 1.2, 1.6, 2.4, 3.2, 4.0, 5.0),  # m/s
    "v_d_max": (0.0, 0.3, 0.6, 0.9, 1.2, 1.6, 2.0, 2.5, 3.0, 4.0, 5.0),  # rad/s
}
LABELS = {
    "v_p_max": "pursuer's speed bound $v_p^{\\max}$ (m/s)",
    "v_d_max": "disturbance bound $v_d^{\\max}$ (rad/s)",
}


@dataclass(frozen=True)
class Sweep:
    """The victory domain against a bound of the adversary's.

    Attributes
    ----------
    values : tuple of float
    fractions : tuple of float
        Share of the grid inside the tube of step 0 within all steps, the target itself included.
    won : tuple of float
        The same without the states that are in the target already: what the controller wins.
    """

    values: tuple[float, ...]
    fractions: tuple[float, ...]
    won: tuple[float, ...]

    @property
    def extinct(self) -> float | None:
        """The first value at which nothing is won; None where the sweep does not reach so far."""
        return next((value for value, won in zip(self.values, self.won, strict=True) if won == 0.0), None)


def certified(nodes: int) -> sdhj.Certified:
    """The method with 5/2 as many cells of a joint as there are nodes, 3/2 as many of the pursuer's coordinates."""
    return sdhj.Certified(cells=tuple(max(factor * nodes // 2, 8) for factor in (5, 5, 3, 3)))


def least_disturbance(problem: sdhj.ReachAvoidProblem) -> float:
    """The bound of the disturbance (rad/s) from which nothing outside the target can be won, to first order.

    An interval's disturbance moves the tip by up to delta v nu, nu = max |J(q) s|_2 over s in {-1, 1}^2, from wherever
    the input leads it, at best into the middle of the disk of radius rho: v = rho / (delta min nu), over the places of
    the target at t_1 to t_N. Turning the whole arm changes no length.
    """
    given, delta = problem.recipe["arguments"], problem.delta
    (a, b), target = given["lengths"], Disk.of(given["target"])
    far = np.array([np.hypot(*target.centre(delta * k)) for k in range(1, problem.most_steps + 1)])
    elbow = np.arccos(np.clip((far**2 - a**2 - b**2) / (2 * a * b), -1, 1))
    # with the upper arm along the first axis J s is (0, a), or that and twice (-b sin, b cos) of the elbow
    pushes = np.maximum(a, np.hypot(2 * b * np.sin(elbow), a + 2 * b * np.cos(elbow)))
    return float((target.radius / (delta * pushes)).max())


def sweep_adversary(bound: str, values: Sequence[float], method: str | sdhj.Certified, **arguments: Any) -> Sweep:
    """Solve the arm's case study for values of "v_p_max" or "v_d_max"; arguments as for `arm_case_study`."""
    tables = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ProjectionWarning)  # an empty tube is what a sweep is for
        for bound_value in values:
            problem = sdhj.arm_case_study(**(arguments | {bound: bound_value}))
            table = sdhj.solve(problem, method=method, progress=False)
            tables.append((table.fraction(start=0, within=table.steps), share_won(table)))
    fractions, won = zip(*tables, strict=True)
    return Sweep(tuple(values), fractions, won)


def value(context: Context) -> list[float]:
    """The shares of C won against the case study's pursuer and one that is ten times as fast."""
    return list(sweep_adversary("v_p_max", (0.2, 2.0), "hji", nodes=context.nodes).won)


def draw(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 3.2)
    for ax, (bound, values) in zip(figure.subplots(1, 2, sharey=True), BOUNDS.items(), strict=True):
        context.say(f"sweeping {bound}")
        methods = {"hji": "hji", "projected": "projected", "certified": certified(context.nodes)}
        sweeps = {name: sweep_adversary(bound, values, m, nodes=context.nodes) for name, m in methods.items()}
        nominal = context.problem.recipe["arguments"][bound]
        won = {method: sweep.won for method, sweep in sweeps.items()}
        draw_sweep(ax, values, won, xlabel=LABELS[bound], nominal=nominal)
        if bound == "v_d_max":
            limit = least_disturbance(context.problem)
            ax.axvline(limit, color=INK, linestyle="--", linewidth=0.9)
            ax.set_title(f"by hand nothing is left from {limit:.2f} rad/s on")
        else:
            cells = " x ".join(map(str, certified(context.nodes).cells))
            ax.set_title(f"{context.nodes} nodes an axis; about {cells} cells")
        ax.set_ylabel(r"share of $\mathcal{C}$ won" if bound == "v_p_max" else "")
    return figure


if __name__ == "__main__":
    command_of(__file__)()
