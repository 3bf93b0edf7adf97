"""Rules by which a controller selects one of the inputs that are safe."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sdhj.common.remembering import FloatArray
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.table.batches import Batch


@dataclass(frozen=True)
class Candidates:
    """The argument of a rule: P pairs of a state of a batch and an input that is safe there, sorted by state.

    A rule is a function of it that returns scores (P,); of each state the input of least score is taken. It is given to
    `sdhj.Controller`.

    Attributes
    ----------
    problem : ReachAvoidProblem
    step : int
        The step k at which the inputs start.
    batch : Batch
        What the table answers for all states.
    rows, inputs : (P,) int array
        Index of the state in the batch, and of the input in problem.inputs.
    states, steps_to_go, margins : (P, ndim), (P,) int and (P,) arrays
        As in `Batch`.
    before : (P,) int array
        Index of the input held until now; -1 where none is known.
    successors : (P, ndim) array
        Where the input leads in one interval without a disturbance.

    Examples
    --------
    With the robot on a line of `help(sdhj)`, as far to the right as is safe:

    >>> def to_the_right(candidates: sdhj.Candidates):
    ...     return -problem.inputs[candidates.inputs, 0]
    >>> sdhj.Controller(table, rule=to_the_right).select([0.0], 0)
    2
    """

    problem: ReachAvoidProblem
    batch: Batch
    rows: FloatArray
    inputs: FloatArray
    before: FloatArray

    @property
    def step(self) -> int:
        return self.batch.step

    @property
    def states(self) -> FloatArray:
        return self.batch.states[self.rows]

    @property
    def steps_to_go(self) -> FloatArray:
        return self.batch.steps_to_go[self.rows]

    @property
    def margins(self) -> FloatArray:
        """The largest value of the next tube that the adversary can bring about: (P,), new."""
        return self.batch.margins[self.batch.safe]  # so the candidates must be all of the safe inputs, in order

    @property
    def successors(self) -> FloatArray:
        """Where inputs lead in one interval without a disturbance, clipped to the grid: (P, ndim), new."""
        moves = self.problem.interval(self.step).displacements(self.batch.states)
        moved = self.states + moves[self.rows if len(moves) > 1 else 0, self.inputs]
        return self.problem.grid.clipped(moved)


Rule = Callable[[Candidates], FloatArray]
RULES: dict[str, Rule] = {  # the input of the least score is selected
    # never called: `Controller.choose` and the words of certified tables take `best` or the margins themselves
    "deepest": lambda among: among.margins,
    "effort": lambda among: np.linalg.norm(among.problem.inputs, axis=1)[among.inputs],
    "target": lambda among: among.problem.target_value(among.successors, among.problem.time(among.step + 1)),
    "clearance": lambda among: (
        -among.problem.unsafe_value(among.successors, among.problem.time(among.step + 1), among.inputs)
    ),
}
