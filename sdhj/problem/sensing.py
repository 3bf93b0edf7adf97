"""Measurement error, delay and jitter: the guarantees for a robot that does not measure exactly, at once and on time.

At t_k = k delta the controller receives a measurement y with |y - q(t_k)| <= e on each axis. The input that it chooses
starts at s_k = t_k + d, d <= delta; until then the previous input is held (before the first, the rest input). An input
computed sooner waits, so d is exact. Sampling times are not: t_k, and s_k with it, comes up to j early or late, so an
input is held for anything from delta - 2 j to delta + 2 j. The adversary chooses the disturbance, the error of each
measurement and each sampling time, and it knows everything.

*Prediction.* The controller computes where the measured state will be after the delay d under the previous input,
without a disturbance. When the new input starts, the state is in the box of half-widths E around this prediction:

    E = w(d),    w(0) = e,    dw/dt = A w + b,

where A holds the Lipschitz constants of the velocity, axis by axis, and b the most that the disturbance adds. Both are
bounds on derivatives of its formulas, for all states on the grid, inputs and times (`sdhj.problem.steepness`), or
what a black box declares. A velocity that jumps has no such constant: there b is all by which it may vary. Where
velocities do not depend on the state, E = e + d b. Jitter adds nothing, because d is exact.

*Sets*, all of them at the time s_k:

* K_k^n(u): the states from which u stays clear of G and ends in W_{k+1}^{n-1}, whenever the interval begins and ends
  within jitter. The adversary chooses the stopping time, so the value is a running maximum over the durations.
* M_k^n: the predictions y for which one u is right for every state of y + E: the union of M_k^{n-1} and, over all u,
  of K_k^n(u) shrunk by E. M_k^0 is L minus G, with G at every time that jitter allows, shrunk by E, so that the
  controller can tell that it has reached the target. (With jitter neither L nor the dynamics may depend on time.)
* W_k^n: M_k^n shrunk by E, the states all of whose predictions are in M_k^n.

From a state of W_k^n every prediction is in M_k^n. It has n' <= n steps to go and an input that is right for the whole
box, which contains the true state: it stays clear of G and ends in W_{k+1}^{n'-1}. By induction the robot reaches the
target within n steps, and the controller can tell. The controller uses M and K; the guarantee for a state is W. What
happens before s_0 is not covered. The sets are not the largest possible: each prediction is judged without the earlier
ones, and a state and the error of its prediction count as independent, though for d > 0 one disturbance causes both.

On a grid, shrinking a set by a box is the maximum of its level-set function over the box (`sdhj.solver.hopf_lax`,
"linear", as the controller interpolates). Near an unsafe end the box must be on the grid. Between the nodes, a state is
in W if the interpolated M contains the whole box around it.

Certified sets consist of cells: M_k^n contains a cell y if the image of y + E, widened by E, is in M_{k+1}^{n-1}, which
for a cell of one point is the same. Their E is proved, by intervals of the velocities (`sdhj.certified.images`).

*In closed form.* dq = u + v, u in {-1, 0, 1}, |v| <= b < 1, target |q| <= r; T = delta + 2 j, S = delta - 2 j. Here
E = e + d b, and the sets are intervals around 0. M^0 has the half-width r - E; W^n has E less than M^n. u = 1 leads
[-w - (1 - b) S, w - (1 + b) T] into [-w, w]: from the low end it may stop early, from the high end late. With w the
half-width of W^{n-1}, shrunk by E and united with M^{n-1} (without a gap while 2 w >= (1 + b) T),

    half-width of W^n = r - 2 E + n ((1 - b) (delta - 2 j) - 2 E)

as long as the last term is positive: each step gains the distance that the robot moves against the disturbance in the
shortest interval, less 2 E. For e >= (1 - b) (delta - 2 j) / 2 - d b the tubes do not extend beyond the target. An
unsafe set q >= c cuts W^n off at c - 2 E.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sdhj.problem.checks import number, whole


@dataclass(frozen=True)
class Sensing:
    """How accurately a robot measures and how promptly it acts; by default exactly and at once.

    Parameters
    ----------
    error : float, or one for each axis
        e, the largest error of a measurement, in the units of the state.
    delay : float
        d, the time from a measurement to the start of the input chosen from it, s; at most delta.
    jitter : float
        j, the most by which a sampling time may come early or late, s.
    rest : int
        Index into problem.inputs of the input that is held before the first chosen one starts.

    Raises
    ------
    ValueError
        If a value is not a number, or negative; `ReachAvoidProblem` checks that the values fit the problem.

    Examples
    --------
    The arm knows its angles to 0.02 rad, the pursuer to 5 mm, and acts 10 ms late:

    >>> from dataclasses import replace
    >>> import sdhj
    >>> problem = sdhj.arm_case_study(nodes=15, steps=3)
    >>> sensed = replace(problem, sensing=sdhj.Sensing(error=[0.02, 0.02, 0.005, 0.005], delay=0.01))
    >>> [round(sdhj.solve(each).fraction(start=0, within=3), 2) for each in (problem, sensed)]
    [0.19, 0.07]
    """

    error: Any = 0.0
    delay: float = 0.0
    jitter: float = 0.0
    rest: int = 0

    def __post_init__(self) -> None:
        if isinstance(self.error, Sequence | np.ndarray) and not isinstance(self.error, str):
            errors = tuple(number(f"error[{axis}]", one, least=0.0) for axis, one in enumerate(self.error))
            object.__setattr__(self, "error", errors)
        else:
            object.__setattr__(self, "error", number("error", self.error, least=0.0))
        for name in ("delay", "jitter"):
            object.__setattr__(self, name, number(name, getattr(self, name), least=0.0))
        object.__setattr__(self, "rest", whole("rest", self.rest, least=0))

    def __bool__(self) -> bool:
        """Whether there is any error, delay or jitter."""
        return bool(np.any(self.error) or self.delay or self.jitter)

    def hold(self, delta: float) -> tuple[float, float]:
        """The longest time for which an input may be held, s, and how much shorter it may be, s."""
        return delta + 2 * self.jitter, 4 * self.jitter
