"""The stronger the adversary is, the smaller is the victory domain, until nothing is left (Sec. 6.1)."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from charts import draw_sweep
from common import Context, command_of
from experiments import share_won
from matplotlib.figure import Figure

import sdhj
from sdhj import plotting
from sdhj.solver.projections import ProjectionWarning

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


def sweep_adversary(bound: str, values: Sequence[float], method: str, **arguments: Any) -> Sweep:
    """Solve the arm's case study for values of "v_p_max" or "v_d_max"; arguments as for `arm_case_study`."""
    tables = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ProjectionWarning)  # an empty tube is what a sweep is for
        for value in values:
            problem = sdhj.arm_case_study(**(arguments | {bound: value}))
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
        sweeps = {m: sweep_adversary(bound, values, m, nodes=context.nodes) for m in ("hji", "projected")}
        nominal = context.problem.recipe["arguments"][bound]
        won = {method: sweep.won for method, sweep in sweeps.items()}
        draw_sweep(ax, values, won, xlabel=LABELS[bound], nominal=nominal)
        extinct = sweeps["hji"].extinct
        ax.set_title("nothing is left at " + (f"{extinct:g}" if extinct is not None else "none of these"))
        ax.set_ylabel(r"share of $\mathcal{C}$ won" if bound == "v_p_max" else "")
    return figure


if __name__ == "__main__":
    command_of(__file__)()
