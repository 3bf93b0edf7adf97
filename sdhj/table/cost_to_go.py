"""A rule that looks along the whole run: the input of least cost to go among those that keep all the steps left.

Sec. 6.1 leaves open which of the safe inputs is applied. Here it is the first of a plan, made by dynamic programming on
the safe sets. At the last step, and in the target, where a run is over, the cost to go J is that of the end; before,

    J_k(q) = min over u of  c_k(q, u) + J_{k+1}(q'),    or of  max(c_k(q, u), J_{k+1}(q'))

where q' is the state to which u leads in one interval with v = 0, and the minimum is over the inputs that a controller
may apply: after them the target can still be reached within all the steps that are left, whatever the adversary does.
So v = 0 is what the plan hopes for, not what it rests on. J is computed at the nodes of the problem's grid, for tables
of cells too, and is multilinear between those of them that are in the tube.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from tqdm import tqdm

from sdhj.common.checks import option, real_array
from sdhj.common.memory import require_memory
from sdhj.common.remembering import FloatArray, ReadOnly, read_only
from sdhj.common.showing import hidden
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.table.batches import NOT_ADMISSIBLE, Table
from sdhj.table.controller import Controller
from sdhj.table.rules import Candidates, Rule

PAIRS = 1 << 18  # of a node and an input, that are looked at at a time
LEAST_WEIGHT = 1e-3  # of the nodes in the tube around a state, for the cost to be known there


def _free(problem: ReachAvoidProblem, states: FloatArray, t: float) -> FloatArray:
    """The end of a run costs nothing: zeros (M,)."""
    return np.zeros(len(states))


@dataclass(frozen=True)
class _Cost:
    """The sum, or the maximum, of the costs of a run's intervals and of its end."""

    of: Rule  # the costs of the intervals of P candidates
    end: Callable[[ReachAvoidProblem, FloatArray, float], FloatArray] = _free  # of runs that end in states at a time
    join: np.ufunc = np.add
    nothing: float = 0.0  # the cost of what is left past a safe end, where nothing matters any longer


def _effort(among: Candidates) -> FloatArray:
    """|u|^2 delta of each of P candidates: (P,)."""
    return among.problem.delta * np.square(among.problem.inputs).sum(axis=1)[among.inputs]


def _distance(among: Candidates) -> FloatArray:
    """max(g(q'), 0) delta of P candidates, g the target's level-set function and q' the successor: (P,)."""
    far = among.problem.target_value(among.successors, among.problem.time(among.step + 1))
    return among.problem.delta * np.maximum(far, 0.0)


def _clearance(among: Candidates) -> FloatArray:
    """-g(q') of P candidates, g the unsafe sets' level-set function and q' the successor: (P,)."""
    return -among.problem.unsafe_value(among.successors, among.problem.time(among.step + 1))


def _clearance_at_end(problem: ReachAvoidProblem, states: FloatArray, t: float) -> FloatArray:
    """-g of states (M, ndim) at time t: (M,)."""
    return -problem.unsafe_value(states, t)


COSTS = {
    "effort": _Cost(_effort),
    "distance": _Cost(_distance),
    "clearance": _Cost(_clearance, _clearance_at_end, np.maximum, -np.inf),
}


class CostToGo(ReadOnly):
    """A rule: the first input of a run of least cost, among those that keep all the steps left.

    J_k(q) = min_u c_k(q, u) + J_{k+1}(q'), for clearance max instead of +, with v = 0 (`sdhj.table.cost_to_go`). Other
    rules reach the target in the fewest steps, this one by the last; the controller has to be told the step always.
    What is promised stays so: on a grid inputs are taken that keep a third of a cell, as by `Controller.filter`.

    Computing J asks the table once for each step and node, and takes 8 bytes for each.

    Parameters
    ----------
    table : Table
        That of the controller.
    cost : {"effort", "distance", "clearance"} or callable (Candidates) -> (P,)
        What is made least: the sum of |u|^2 delta; that of the target's level-set value times delta, as far as it is
        positive, at the ends of the intervals; or the largest of the negative level-set values of the unsafe sets
        there. A function of your own is the cost of an interval, and is added up, inf for what should not be done.
    progress : bool, optional
        By default where standard error is a terminal.

    Attributes
    ----------
    problem, name : ReachAvoidProblem, str
    all_left : bool
        True, as `Controller` explains.

    Raises
    ------
    ValueError
        If `table` holds for ever without a target, where no sum ends, or the cost asks for a target or an unsafe set
        that there is not.
    MemoryError
        If J would not fit into memory.

    Examples
    --------
    With the robot on a line of `help(sdhj)`, which needs 2 steps and has 5: it puts off what costs less later.

    >>> import sdhj
    >>> def energy(among: sdhj.Candidates):
    ...     return abs(problem.inputs[among.inputs, 0]) * 0.9**among.step
    >>> later = sdhj.Controller(table, rule=sdhj.CostToGo(table, energy, progress=False))
    >>> problem.inputs[later.select([-1.6], 0)], problem.inputs[later.select([-1.6], 3)]
    (array([0.]), array([1.]))
    """

    all_left = True

    def __init__(self, table: Table, cost: str | Rule, progress: bool | None = None) -> None:
        """Compute J at all nodes, from the last step back."""
        # before there is any J: a controller that is made reads `all_left` alone, and asks no rule of this kind
        # (`_prepare`)
        controller = Controller(table, rule=self)
        if not callable(cost):
            option("cost", cost, tuple(COSTS))
        problem, grid = table.problem, table.problem.grid
        if problem.has_no_target and table.details.get("endless"):
            raise ValueError("a cost along a run that lasts for ever has no sum: solve it with a number of steps")
        if cost == "distance" and problem.has_no_target:
            raise ValueError('the cost "distance" is that to a target, and the problem has none: use another cost')
        if cost == "clearance" and not any(one.inputs is None for one in problem.unsafe):
            raise ValueError('the cost "clearance" needs an unsafe set, unsafe under every input: use another cost')
        named = cost if isinstance(cost, str) else getattr(cost, "__name__", type(cost).__name__)
        self.problem, self.name = problem, f"cost to go of {named}"
        self._cost = _Cost(cost) if callable(cost) else COSTS[cost]
        shape = (table.steps + 1, 2, grid.size)
        require_memory(4 * math.prod(shape), f"a cost to go at {grid.size:,} nodes and {table.steps + 1} steps")
        self._values = np.zeros(shape, np.float32)  # of each step J, 0 off the tube, and whether it is in the tube
        points, size = grid.points(), max(PAIRS // len(problem.inputs), 1)
        for step in tqdm(range(table.steps, -1, -1), desc="cost to go", unit="step", disable=hidden(progress)):
            for begin in range(0, grid.size, size):
                some = slice(begin, begin + size)
                found = self._at(controller, points[some], step)
                known = np.isfinite(found)
                self._values[step, :, some] = np.where(known, found, 0.0), known
        read_only((self._values,))

    def _at(self, controller: Controller, states: FloatArray, step: int) -> FloatArray:
        """J of states (M, ndim) at a step, from J of the next: (M,), inf off the tube or where no input is safe."""
        problem, last = self.problem, step == controller.table.steps
        batch = controller.answers(states, step)
        out = np.full(len(states), np.inf)
        over = batch.steps_to_go == 0 if not problem.has_no_target else (batch.steps_to_go >= 0) & last
        out[over] = self._cost.end(problem, states[over], problem.time(step))
        rows, inputs = np.nonzero(controller.allowed(batch) & ~over[:, None])
        if rows.size:
            asked = Candidates(problem, batch, rows, inputs, np.full(len(rows), NOT_ADMISSIBLE))
            # of all inputs that are asked about in a state the least
            np.minimum.at(out, rows, controller.scores(asked))
        return out

    def __call__(self, candidates: Candidates) -> FloatArray:
        """The scores c_k(q, u) + J_{k+1}(q'), or the larger of the two, of P candidates: (P,)."""
        if candidates.problem != self.problem:
            raise ValueError("this cost to go is that of another table: use CostToGo(table, ...) of the controller's")
        ends = candidates.successors
        sums, weights = (self.problem.grid.interpolate(one, ends) for one in self._values[candidates.step + 1])
        # inf where next to none of the nodes around q' is in the tube
        known = (weights >= LEAST_WEIGHT) & np.isfinite(weights)
        after = np.where(known, sums, np.inf) / np.where(known, weights, 1.0)
        after[self.problem.grid.beyond(ends, "frees")] = self._cost.nothing
        cost = real_array(f"what the {self.name} adds up", self._cost.of(candidates))
        if cost.shape != after.shape:  # as `Controller.scores` says
            return cost
        if self._cost.join is np.add and not (cost > -np.inf).all():
            raise ValueError(f"what the {self.name} adds up must be numbers, or inf for what no run should do")
        joined: Any = self._cost.join(cost, after)
        return np.asarray(joined)

    def __repr__(self) -> str:
        return f"<CostToGo, {self.name}>"
