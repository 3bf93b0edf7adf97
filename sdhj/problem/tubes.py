"""The tube of a table as a level-set function, for `TargetSet.from_table`."""

from collections.abc import Callable
from typing import Any

import numpy as np

from sdhj.formulas.formula import BlackBox
from sdhj.formulas.gridded import gridded
from sdhj.kernels import FloatArray
from sdhj.kernels.interpolation import SLACK
from sdhj.problem.checks import whole

ON_TIME = 1e-9  # of a sampling interval: what rounding may move a sampling time by


def table_level_set(table: Any, within: int | None) -> Callable[[FloatArray, float], FloatArray]:
    """Level-set function of the tube of a table: see `TargetSet.from_table`."""
    if not hasattr(table, "values_at"):
        raise ValueError(f"table must be what sdhj.solve returns, got {type(table).__name__}")
    most = table.steps if within is None else whole("within", within, least=0, most=table.steps)
    return _cells(table, most) if table.method == "certified" else _interpolated(table, most)


def _interpolated(table: Any, within: int) -> Callable[[FloatArray, float], FloatArray]:
    """Of a grid table: the interpolated tube of the step that it is time for, 1 at other times."""
    problem = table.problem
    steps = range(1) if problem.time_invariant else range(table.steps + 1)
    tubes = [_tube(problem.grid, table.values(start=step, within=within)) for step in steps]

    def level_set(points: FloatArray, t: float) -> FloatArray:
        """The tube of the step at time t, interpolated at points; 1 at other times."""
        if problem.time_invariant:
            return tubes[0](points)
        value = np.ones(len(points))
        for step, tube in enumerate(tubes):
            value = np.where(np.abs(t - problem.time(step)) <= ON_TIME * problem.delta, tube(points), value)
        return value

    return level_set


def _tube(grid: Any, values: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """Values at the nodes, interpolated at points (M, ndim); beyond bounded axes something above 0."""
    beyond = max(float(values.max()), 1.0)
    periodic, spacing = np.array(grid.periodic), np.array(grid.spacing)
    table = gridded(np.pad(values, [(0, int(turns)) for turns in periodic], mode="wrap"), grid.lower, spacing)
    bounded = np.flatnonzero(~periodic)
    least, greatest = (grid.lower - SLACK * spacing)[bounded], (grid.upper + SLACK * spacing)[bounded]

    def tube(points: FloatArray) -> FloatArray:
        """The interpolated tube at points; `beyond` where they are off a bounded axis."""
        places = points[:, bounded]
        outside = ((places < least) | (places > greatest)).any(axis=1)
        return np.where(outside, beyond, table(points)) if bounded.size else table(points)

    return tube


def _cells(table: Any, within: int) -> BlackBox:
    """Of a certified table: -1 in its certified cells, 1 elsewhere."""
    problem = table.problem

    def step_at(t: float) -> int | None:
        """The step whose sampling time t is; None if it is none of the table's."""
        step = 0 if problem.time_invariant else max(round((t - problem.time(0)) / problem.delta), 0)
        on_time = problem.time_invariant or abs(problem.time(step) - t) <= ON_TIME * problem.delta
        return step if on_time and step <= table.steps else None

    def level_set(points: FloatArray, t: float) -> FloatArray:
        """-1 in certified cells of the step at time t, 1 elsewhere."""
        step = step_at(t)
        if step is None:
            return np.ones(len(points))
        return np.where(table.contains(points, start=step, within=within), -1.0, 1.0)

    def enclosure(low: FloatArray, high: FloatArray, t0: float, t1: float) -> tuple[FloatArray, FloatArray]:
        """Bounds over boxes: (-1, -1) in certified cells only, (1, 1) in none, else (-1, 1)."""
        if t0 != t1 and not problem.time_invariant:
            raise ValueError(f"the tube of {problem.name!r} depends on time, so it has no bounds over an interval")
        step = step_at(t0)
        if step is None:
            return np.ones(len(low)), np.ones(len(low))
        off = table.proof.prediction_error  # with sensing the certified states are predictions
        every, some = table.certified_boxes(low - off, high + off, start=step, within=within)
        return np.where(some, -1.0, 1.0), np.where(every, -1.0, 1.0)

    rate = 0.0 if problem.time_invariant else None
    return BlackBox(level_set, rate=rate, enclosure=enclosure, name=f"the tube of {problem.name!r}")
