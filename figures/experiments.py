"""What several experiments of Sec. 6.1 need: what is won, where runs start, how near they come."""

from collections.abc import Sequence

import numpy as np

from sdhj.common.remembering import FloatArray
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.simulation.runs import Z95, Trajectory, admissible_states
from sdhj.table.batches import Table
from sdhj.table.controller import Controller


def share_won(table: Table) -> float:
    """Share of the grid's volume from which the robot, not in the target yet, is guaranteed to reach it."""
    inside = table.values(start=0, within=table.steps) <= 0
    return table.grid.fraction(inside & ~(table.values(start=0, within=0) <= 0))


def starts_outside(table: Table, count: int, seed: int) -> FloatArray:
    """States (count, ndim) drawn uniformly from the tube of step 0, truly outside the target and what is unsafe.

    Raises
    ------
    ValueError
        Where hardly a state is so.
    """
    controller, rng, found = Controller(table), np.random.default_rng(seed), np.empty((0, table.grid.ndim))
    while len(found) < count:
        drawn = admissible_states(controller, 4 * count, rng)
        outside = (table.problem.target_value(drawn, 0.0) > 0) & (table.problem.unsafe_value(drawn, 0.0) > 0)
        if not outside.any():
            raise ValueError("the tube of step 0 holds next to nothing but the target: there is nothing to simulate")
        found = np.concatenate([found, drawn[outside]])
    return found[:count]


def mean_interval(values: Sequence[float] | FloatArray) -> tuple[float, float]:
    """95% confidence interval of a mean: 1.96 standard errors to either side; NaN for less than two values."""
    if len(values) < 2:
        return float("nan"), float("nan")
    mean, error = float(np.mean(values)), float(np.std(values, ddof=1)) / np.sqrt(len(values))
    return mean - Z95 * error, mean + Z95 * error


def clearances(problem: ReachAvoidProblem, runs: Sequence[Trajectory], finer: int) -> FloatArray:
    """Least true level-set value of what is unsafe along each run, (runs,), `finer` instants for each one simulated.

    Between the simulated instants the velocity is constant, so states are interpolated, not approximated.
    """
    if not runs:
        return np.empty(0)
    least = problem.unsafe_value(np.array([run.states[0] for run in runs]), 0.0)
    for i in range(max(len(run.times) for run in runs) - 1):
        going = [place for place, run in enumerate(runs) if len(run.times) > i + 1]
        before, after = (np.array([runs[place].states[at] for place in going]) for at in (i, i + 1))
        t0, t1 = runs[going[0]].times[[i, i + 1]]
        for part in np.arange(1, finer + 1) / finer:
            value = problem.unsafe_value(before + part * (after - before), t0 + part * (t1 - t0))
            least[going] = np.minimum(least[going], value)
    return least
