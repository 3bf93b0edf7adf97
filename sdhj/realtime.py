"""A controller in a real loop: what a measurement says of the state, and an answer for every instant, late ones too."""

import importlib
from typing import TYPE_CHECKING, Any

import numpy as np

from sdhj.checks import plain_array, real_array
from sdhj.grid import FloatArray

if TYPE_CHECKING:
    from sdhj.prediction import Action
    from sdhj.problem import ReachAvoidProblem


class RealTime:
    """The part of `Controller` that knows of time."""

    problem: "ReachAvoidProblem"
    last: "Action | None" = None

    def _at(self, step: int | None) -> int:
        if step is None and not self.problem.timeless:
            raise ValueError("the answer depends on time: say at which step, for example select(q, step=0)")
        return 0 if step is None else step

    def predict(self, measurement: FloatArray, previous: Any = None, step: int | None = None) -> FloatArray:
        """Where states measured at t_k will be when the next input starts, without an adversary: of the same shape.

        measurement is (ndim,) or (M, ndim); previous, an index or (M,) of them, the input held until then, by default
        the rest input; step, k, may be left out where nothing depends on time. The state then is within
        `problem.half_widths[0]` of it on each axis.
        """
        predicted = importlib.import_module("sdhj.prediction").predicted
        states, most = real_array("a measurement", measurement), len(self.problem.inputs) - 1
        given = plain_array("previous", self.problem.sensing.rest if previous is None else previous)
        count = 1 if states.ndim == 1 else len(states)
        known = given.dtype.kind in "iu" and bool(((given >= 0) & (given <= most)).all())
        if not known or given.shape not in ((), (count,)):
            raise ValueError(f"previous must be an index from 0 to {most}, or one for each measurement, got {given}")
        told = predicted(self.problem, np.atleast_2d(states), np.broadcast_to(given, count), self._at(step))
        return told[0] if states.ndim == 1 else told

    def step(self, measurement: FloatArray, time: float, *, fallback: bool = True) -> "Action":
        """The answer to a measurement (ndim,) taken `time` s after the loop began: see `sdhj.prediction.Action`.

        The measurement is for the instant that it comes nearest to, and the loop begins anew with a time next to 0. The
        controller remembers the input before. Where nothing depends on time a loop may go on for ever: every instant is
        asked about as the first. What is not admissible gets the input of `Controller.fallback`, or NotAdmissible.

        Raises
        ------
        NotAdmissible
        ValueError
            For what is no state or no time, where time does not go on, and after the last step.
        """
        self.last = importlib.import_module("sdhj.prediction").acted(self, measurement, time, fallback)
        return self.last
