"""Several controllers that act one after the other."""

import numpy as np

from sdhj.kernels import FloatArray
from sdhj.table.controller import Controller


class Relay:
    """Several controllers for chained problems: the last one for whose table a state is admissible chooses the input.

    Give them in the order in which they act: Relay(Controller(second), Controller(first)), where the tube of the first
    table is the target of the second one's problem (`TargetSet.from_table`). Each state is judged by itself: with
    `Sensing` that needs tables of memory=False.

    Attributes
    ----------
    controllers : tuple of Controller
        As given.
    """

    def __init__(self, *controllers: Controller) -> None:
        """Controllers in the order in which they act; ValueError if one is none, or remembers (`Sensing.memory`)."""
        for one in controllers:
            if not isinstance(one, Controller):
                raise ValueError(f"Relay takes controllers, for example Relay(Controller(table)), got {one!r}")
            if one.problem.sensing.remembers:
                raise ValueError("a Relay remembers nothing: solve the problems with Sensing(..., memory=False)")
        self.controllers = controllers

    def choose(self, states: FloatArray, step: int) -> FloatArray:
        """Which controller acts from each of the states (M, ndim) at a step k, and the index of its input: (M, 2) int.

        The controller is a position among those given, the last for whose table the state is admissible; the input an
        index into its problem.inputs. Tables whose answers do not depend on time are asked for step 0; others only for
        steps up to their last. Both numbers are -1 for a state that is admissible for none; the input alone is -1 if
        the state is in the controller's target and no input is proved to lead back into it, and at the table's last
        step. ValueError if states or step do not fit.
        """
        states = np.asarray(states, dtype=np.float64)
        out = np.full((len(states), 2), -1)
        for i, controller in enumerate(self.controllers):
            at = step if controller.depends_on_time else 0
            if at <= controller.table.steps:
                batch = controller.batch(states, at)
                admitted = batch.steps_to_go >= 0
                out[admitted] = np.stack([np.full(admitted.sum(), i), controller.choose(batch)[admitted]], axis=1)
        return out
