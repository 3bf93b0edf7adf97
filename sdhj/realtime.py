"""A controller in a real loop: what a measurement says of the state, and an answer for every instant, late ones too."""

import importlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sdhj.grid import FloatArray

if TYPE_CHECKING:
    from sdhj.problem import ReachAvoidProblem


@dataclass(frozen=True)
class Action:
    """What to do from the next start of an input on, one delay after the measurement.

    Attributes
    ----------
    input : int
        Index into problem.inputs.
    step : int
        The instant that the measurement was taken for.
    steps_to_go : int or None
        As `Controller.steps_to_go`, of the prediction; 0 is success, None where it is not admissible.
    promised : bool
        Whether the table promises it, `Batch.promised`. Never where the instant was missed.
    late : float
        By how much the measurement came after its instant, s; negative where it came before.
    missed : bool
        Whether that is more than the jitter the table was solved for, or no measurement came at the instant before.
    """

    input: int
    step: int
    steps_to_go: int | None
    promised: bool
    late: float
    missed: bool


class RealTime:
    """The part of `Controller` that knows of time."""

    problem: "ReachAvoidProblem"
    last: Action | None = None

    def predict(self, measurement: FloatArray, previous: Any = None, step: int = 0) -> FloatArray:
        """Where a state measured at t_k will be when the next input starts, without an adversary: of that shape.

        Parameters
        ----------
        measurement : (ndim,) or (M, ndim) array
        previous : int, or (M,) int array
            Index of the input that is held until then; by default the rest input.
        step : int
            k, where the dynamics depend on time.

        The state then is within `problem.half_widths[0]` of it on each axis. Where there is no delay it is the
        measurement, held at the walls.
        """
        predicted = importlib.import_module("sdhj.prediction").predicted
        held = self.problem.sensing.rest if previous is None else previous
        states = np.atleast_2d(np.asarray(measurement))
        told = predicted(self.problem, states, np.broadcast_to(held, len(states)), step)
        return told[0] if np.ndim(measurement) == 1 else told

    def step(self, measurement: FloatArray, time: float, *, fallback: bool = True) -> Action:
        """The answer to a measurement (ndim,) taken `time` s after the loop began: see `Action`.

        The controller remembers the input before. It counts instants from a call with a time before delta / 2 on; what
        comes nearest to the k-th is for that one. Where nothing depends on time a loop may go on for ever: every
        instant is then asked about as the first.

        Parameters
        ----------
        fallback : bool
            What a prediction gets that is not admissible: the input of `Controller.fallback`, or NotAdmissible.

        Raises
        ------
        NotAdmissible
        ValueError
            For what is no state or no time, where time does not go on, and after the last step.
        """
        self.last = importlib.import_module("sdhj.prediction").acted(self, measurement, time, fallback)
        return self.last
