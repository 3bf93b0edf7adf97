"""A solved table as the target of another problem: first into its tube, and from there on by its own inputs.

Both clocks are one: at time t the second problem's target holds the states from which the first table reaches its own
target, from its step k = t / delta on, in the steps that are left of its N, or in `within` of them. At times that are
no sampling times of the first table, and after its last step, the target is empty. Where nothing depends on time in the
first problem its step is 0 at any time. A table without a target is one of staying safe: then the target holds the
states from which it keeps clear until its last step.

Of a certified table the target is exactly its certified cells, and a certified table of the second problem proves the
whole way: a cell is in its target where certified cells of the first cover it. Handing over may take a state out of
them by what rounding may in three steps (`sdhj.certified.cells.DRIFT`), within the slack of every certified set. Of
other tables it is the interpolated tube, which proves nothing, so method "certified" refuses it as a target.
"""

from typing import Any

import numpy as np

from sdhj.checks import whole
from sdhj.controller import Controller
from sdhj.grid import FloatArray
from sdhj.problem import TargetSet


def from_table(table: Any, within: int | None = None) -> TargetSet:
    """The states from which a table reaches its target within its remaining steps, or `within` of them.

    The problem that it is the target of has the same axes, and time 0 is that of the table's.

    Raises
    ------
    ValueError
        For what is no table, or a number of steps that it does not have.
    """
    if not hasattr(table, "values_at"):
        raise ValueError(f"table must be what sdhj.solve returns, got {type(table).__name__}")
    most = table.steps if within is None else whole("within", within, least=0, most=table.steps)
    problem = table.problem

    def step_at(t: float) -> int | None:
        step = 0 if problem.timeless else max(round((t - problem.time(0)) / problem.delta), 0)
        on_time = problem.timeless or abs(problem.time(step) - t) <= 1e-9 * problem.delta
        return step if on_time and step <= table.steps else None

    def level_set(points: FloatArray, t: float) -> FloatArray:
        step = step_at(t)
        if step is None:
            return np.ones(len(points))
        if table.method == "certified":
            return np.where(table.contains(points, start=step, within=most), -1.0, 1.0)
        tube = table.values(start=step, within=most)
        return np.minimum(problem.grid.interpolate(tube, points), max(float(tube.max()), 1.0))

    def enclosure(low: FloatArray, high: FloatArray, t0: float, t1: float) -> tuple[FloatArray, FloatArray]:
        if t0 != t1 and not problem.timeless:
            raise ValueError(f"what a table of {problem.name!r} reaches depends on time")
        step = step_at(t0)
        if step is None:
            return np.ones(len(low)), np.ones(len(low))
        off = table.proof.unsure  # what is certified with sensing are predictions
        every, some = table.over(low - off, high + off, start=step, within=most)
        return np.where(some, -1.0, 1.0), np.where(every, -1.0, 1.0)

    if table.method == "certified":
        level_set.enclosure = enclosure  # type: ignore[attr-defined]
    return TargetSet(tuple(range(problem.grid.ndim)), level_set, f"the tube of {problem.name}")


class Relay:
    """Controllers one after the other: of those that admit a state, the last plays.

    Give them in the order in which their tables are needed: Relay(Controller(second), Controller(first)), where `first`
    was the target of the problem of `second`.
    """

    def __init__(self, *controllers: Controller) -> None:
        self.controllers = controllers

    def choose(self, states: FloatArray, step: int) -> FloatArray:
        """Which controller plays from each of the states (M, ndim) at a step, and the index of its input: (M, 2) int.

        -1 for both where none admits the state; for the input where the state is in the last target already, and none
        is known that brings it back.
        """
        states = np.asarray(states, dtype=np.float64)
        out = np.full((len(states), 2), -1)
        for place, controller in enumerate(self.controllers):
            at = 0 if controller.problem.timeless else step
            if at <= controller.table.steps:
                batch = controller.batch(states, at)
                held = batch.steps_to_go >= 0
                out[held] = np.stack([np.full(held.sum(), place), controller.choose(batch)[held]], axis=1)
        return out
