"""A Gymnasium environment for training agents safely: unsafe actions are replaced by the filter, or masked.

It needs the extra `gym`: pip install 'sdhj[gym]'.
"""

from typing import Any

import numpy as np

from sdhj.common.checks import finite_array
from sdhj.common.remembering import FloatArray
from sdhj.simulation.adversaries import Adversary
from sdhj.simulation.outcomes import OUTCOMES, UNDECIDED
from sdhj.simulation.runs import admissible_states, adversary_of
from sdhj.simulation.sensed import Runs
from sdhj.table.batches import Table
from sdhj.table.controller import Controller

try:
    import gymnasium
except ImportError as error:
    raise ImportError("the environment needs Gymnasium, which is not installed: pip install 'sdhj[gym]'") from error

# not "left", which `simulate_interval` alone gives to a run whose controller has no answer
REWARDS = {"reached": 1.0, "collided": -1.0, "off the grid": -1.0, "late": 0.0, "": 0.0}
DRAWN = 256  # start states drawn; the first one outside the target is used


class ReachAvoidEnv(gymnasium.Env[FloatArray, np.int64]):
    """A Gymnasium environment: an episode is a run, an action is an input for a sampling interval.

    The observation is the state (periodic coordinates wrapped into the grid), with `Sensing` the `point` of
    `Controller.step`, followed by the step. An action is an index into problem.inputs. An episode ends when the run
    reaches the target (reward 1), collides or leaves the grid (reward -1), as in `sdhj.simulate`, and is truncated
    after the last step (reward 0).

    `info` has "outcome": "reached", "collided", "off the grid" or "late", or "" while the run goes on; "action_mask",
    (L,) int8: 1 for what the filter passes on, else for the fallback alone, for all when the run is over; "promised":
    whether some safe input has a margin <= 0. After a step also "applied", the index of the input that was applied, and
    "overruled", whether that differs from the action.

    Parameters
    ----------
    table : Table
    adversary
        As for `sdhj.simulate`.
    shield : bool
        Whether `Controller.filter` replaces actions that it does not let pass.

    Attributes
    ----------
    controller : Controller
    now : int
        The step of the run.
    outcome : str
        As in `info`.
    runs : Runs
        A batch of one.

    Examples
    --------
    With the robot on a line of `help(sdhj)`, which does what the table proposes:

    >>> from sdhj.simulation.environment import ReachAvoidEnv
    >>> env = ReachAvoidEnv(table, adversary="worst")
    >>> state, info = env.reset(seed=0)
    >>> while not info["outcome"]:
    ...     action = int(info["action_mask"].argmax())
    ...     state, reward, terminated, truncated, info = env.step(action)
    >>> info["outcome"]
    'reached'
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - as Gymnasium declares it

    def __init__(self, table: Table, adversary: str | Adversary = "random", *, shield: bool = True) -> None:
        self.controller, self.play, self.shield = Controller(table), adversary_of(adversary), shield
        grid = table.grid
        self.low, self.high = np.array([*grid.lower, 0.0]), np.array([*grid.upper, table.steps])
        self.observation_space = gymnasium.spaces.Box(self.low, self.high, dtype=np.float64)
        self.action_space = gymnasium.spaces.Discrete(len(table.problem.inputs))
        # over, so that `step` refuses until `reset` has begun a run
        self.table, self.now, self.outcome = table, 0, "late"

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """Start at step 0 from options["state"] (ndim,), or from a random state of the tube outside the target.

        Returns the observation and `info`; ValueError if the state does not fit or none can be drawn.
        """
        super().reset(seed=seed)
        problem = self.table.problem
        if options and "state" in options:
            state = finite_array("options['state']", options["state"], (problem.grid.ndim,))
        else:
            drawn = admissible_states(self.controller, DRAWN, self.np_random)
            # argmax is 0 where none is outside, or there is no target: then the first one is taken
            state = drawn[int(np.argmax(problem.target_value(drawn, 0.0) > 0))]
        sensing = problem.sensing
        given = self.controller, state[None], self.play, self.np_random, sensing, None
        self.runs = Runs(*given, first_tubes_only=False, controller_chooses=False)
        self.now, self.outcome = 0, ""
        return self._observed(), self._info()

    def step(self, action: np.int64) -> tuple[FloatArray, float, bool, bool, dict[str, Any]]:
        """Simulate one interval with the input of index `action` against the adversary; after `reset`.

        Returns observation (ndim + 1,), reward, whether the run terminated or was truncated, and `info`. ValueError if
        `action` is no index into problem.inputs, or the run is over.
        """
        if self.outcome:
            raise ValueError("the run is over; call reset()")
        if not self.action_space.contains(action):
            raise ValueError(f"an action must be an int from 0 to {len(self.table.problem.inputs) - 1}, got {action!r}")
        runs, now, end = self.runs, self.now, self.now + 1
        last = end == self.table.steps
        known, rows = runs.predictions, np.array([0])
        applied = int(action)
        if self.shield:  # the runs themselves carry the points on
            applied = int(self.controller.filter(known[0], now, applied, first=True).inputs)
        runs.simulate_inputs(now, rows, np.array([applied]), self.table.batch(known, now).steps_to_go)
        runs.end_reached(end, last)
        self.now = end
        self.outcome = OUTCOMES[runs.outcomes[0]] if runs.outcomes[0] != UNDECIDED else "late" if last else ""
        # Being late ends the table and not the task, which Gymnasium tells apart: truncated, not terminated.
        finished, late = self.outcome != "", self.outcome == "late"
        info = self._info() | {"applied": applied, "overruled": applied != int(action)}
        return self._observed(), REWARDS[self.outcome], finished and not late, late, info

    def _observed(self) -> FloatArray:
        """What is known of the state, wrapped and clipped to the grid, and the step: (ndim + 1,)."""
        state = self.table.grid.wrapped(self.runs.predictions)[0]
        return np.clip([*state, float(self.now)], self.low, self.high)  # off the grid: the nearest point of it

    def _info(self) -> dict[str, Any]:
        """The entries "outcome", "action_mask" and "promised" of `info`."""
        mask = np.ones(len(self.table.problem.inputs), np.int8)
        if self.outcome:
            return {"outcome": self.outcome, "action_mask": mask, "promised": self.outcome == "reached"}
        each = np.arange(len(mask))
        # each input is asked about as the wanted one: those that the filter leaves as they are may be applied
        told = self.controller.filter(np.repeat(self.runs.predictions, len(mask), axis=0), self.now, each, first=True)
        mask[:] = ~told.changed
        return {"outcome": "", "action_mask": mask, "promised": bool(told.promised[0])}
