"""Measurement error, delay and jitter: the guarantees for a robot that does not measure exactly, at once and on time.

At t_k = k delta the controller receives a measurement y with |y - q(t_k)| <= e on each axis. The input that it chooses
starts at s_k = t_k + d, d <= delta; until then the previous input is held (before the first, the rest input). An input
computed sooner waits, so d is exact. Sampling times are not: t_k, and s_k with it, comes up to j early or late, so an
input is held for anything from delta - 2 j to delta + 2 j. The adversary chooses the disturbance, the error of each
measurement and each sampling time, and it knows everything.

*Prediction.* The controller computes where the measured state will be after the delay d under the previous input,
without a disturbance. When the new input starts, the state is in the box of half-widths E around this prediction:

    E = w(d),    w(0) = e,    dw/dt = A w + b,

where A holds the Lipschitz constants of the velocity, axis by axis, and b the most that the disturbance adds
(`sdhj.problem.steepness`). Jitter adds nothing, because d is exact.

*Sets*, all of them at the time s_k = k delta + d:

* K_k^n(u): the states from which u stays clear of G and ends in W_{k+1}^{n-1}, whenever the interval begins and ends
  within jitter. The adversary chooses the stopping time, so the value is a running maximum over the durations.
* M_k^n: the predictions y for which one u is right for every state of y + E: the union of M_k^{n-1} and, over all u,
  of K_k^n(u) shrunk by E. M_k^0 is L minus G, with G at every time that jitter allows, shrunk by E.
* W_k^n: M_k^n shrunk by E, the states all of whose predictions are in M_k^n. The guarantee for a state is W.

*Memory.* Here each prediction is judged by itself, so an error costs the same in every step, however little an input
changes in one, and tables at a high rate are empty. With `memory=True`, the default, the controller carries a point c
from step to step, with the promise that the state is in c +- E. Let [L, H] hold, axis by axis, all that c +- E can lead
to under the input. The next c is the prediction, clipped to [L + E, H - E] (the middle where that is empty): the state
is in it again +- E, because it is in [L, H] and within E of the prediction. So in place of "shrunk by E" in K, the box
[L, H] of a point is shrunk: M_k^n are the points c for which one u is right for every state of c +- E and leads to
points of M_{k+1}^{n-1} only. `Controller.step` is the loop that remembers; who asks `select`, `batch` or `filter` with
every new prediction does not, would be promised nothing by such a table beyond the step, and is refused, in C too:
`memory=False` is for who cannot remember.

On an axis along which all of [L, H] is held at a wall the state is known: the next c is at the wall, and its box has no
width there. So who brakes until nothing it can have come to moves stands, whatever it measures; a first measurement
that happens to be 0 says nothing of the kind. Certified tables count on that (`sdhj.certified.cells`).

Chapter 16 of the course has the proof, what is lost, and the sets in closed form for dq = u + v. Grids shrink a set by
the maximum of its level-set function over the box; cells are certified where the image of y + E, widened by E, is
covered. What happens before s_0 is not covered.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sdhj.common.checks import number, whole


@dataclass(frozen=True)
class Sensing:
    """How accurately a robot measures and how promptly it acts; by default exactly and at once.

    Parameters
    ----------
    error : float, or one for each axis
        e, the largest of a measurement, in the units of the state.
    delay : float
        d, from a measurement to the start of the input chosen from it, s; at most delta.
    jitter : float
        j, the most by which a sampling time may come early or late, s.
    rest : int
        The input that is held before the first chosen one starts, by index.
    memory : bool
        Whether the controller remembers what the state can be: larger sets, for loops of `Controller.step`, or
        `sdhj_step` in C. A loop of `select`, `batch` or `filter` needs memory=False.

    Examples
    --------
    The arm knows its angles to 0.02 rad, the pursuer to 5 mm, and acts 10 ms late:

    >>> from dataclasses import replace
    >>> import sdhj
    >>> problem = sdhj.arm_case_study(nodes=15, steps=3)
    >>> sensed = replace(problem, sensing=sdhj.Sensing(error=[0.02, 0.02, 0.005, 0.005], delay=0.01))
    >>> forgets = replace(problem, sensing=replace(sensed.sensing, memory=False))
    >>> [round(sdhj.solve(each).fraction(start=0, within=3), 2) for each in (problem, sensed, forgets)]
    [0.19, 0.15, 0.07]
    """

    error: Any = 0.0
    delay: float = 0.0
    jitter: float = 0.0
    rest: int = 0
    memory: bool = True

    def __post_init__(self) -> None:
        if isinstance(self.error, Sequence | np.ndarray) and not isinstance(self.error, str):
            errors = tuple(number(f"error[{axis}]", one, least=0.0) for axis, one in enumerate(self.error))
            object.__setattr__(self, "error", errors)
        else:
            object.__setattr__(self, "error", number("error", self.error, least=0.0))
        for name in ("delay", "jitter"):
            object.__setattr__(self, name, number(name, getattr(self, name), least=0.0))
        object.__setattr__(self, "rest", whole("rest", self.rest, least=0))
        if not isinstance(self.memory, bool | np.bool_):
            raise ValueError(f"memory must be True or False, got {self.memory!r}")
        object.__setattr__(self, "memory", bool(self.memory))

    def __bool__(self) -> bool:
        """Whether there is any error, delay or jitter, whatever `memory` is."""
        errors = self.error if isinstance(self.error, tuple) else (self.error,)
        return any((*errors, self.delay, self.jitter))

    @property
    def remembers(self) -> bool:
        """Whether the controller carries a point from step to step: `memory`, with an error, delay or jitter."""
        return self.memory and bool(self)

    @property
    def entry_in_head(self) -> dict[str, Any]:
        """The fields by name, for the head of a file: without a False `memory`, and {} where robots measure exactly."""
        # the checker takes a `memory` that is left out as False, too
        return {name: value for name, value in vars(self).items() if name != "memory" or value} if self else {}

    def hold(self, delta: float) -> tuple[float, float]:
        """The longest time for which an input may be held, and by how much that may be shorter, s."""
        # in the order of `Interval.delta` and `Interval.early`, which `ReachAvoidProblem.interval` fills with them
        return delta + 2 * self.jitter, 4 * self.jitter
