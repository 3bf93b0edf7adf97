"""Measurement error, delay and jitter: what a robot that does not measure exactly, at once and on time can be promised.

The controller is asked at t_k = k delta. It sees y with |y - q(t_k)| <= e on each axis, and the input that it chooses
starts at s_k = t_k + d, d <= delta; until then the one before is held (before the first: the rest input). An answer
that is ready sooner waits: d is exact. What is not are the instants: t_k, and s_k with it, comes up to j early or late,
so that an input is held for anything from delta - 2 j to delta + 2 j. The adversary has a say in all of it: the
disturbance, the error of each measurement, each instant; it knows everything.

*Prediction.* When an input starts, the controller has moved the measurement on by d with the input before, without an
adversary. The state is then in the box of half-widths E around the prediction, however the adversary played:

    E = w(d),    w(0) = e,    dw/dt = A w + b,

A the Lipschitz constants of the velocity, axis by axis, and b the most that the adversary adds to it. For velocities
that do not depend on the state E = e + d b: a delay is an error that is known. Jitter adds nothing, as d is exact.

*Sets*, all of them at the time s_k:

* K_k^n(u): the states from which u keeps clear of G whenever the interval begins and ends within jitter, and ends,
  whenever that is, in W_{k+1}^{n-1}. The stopping time is the adversary's: the value is a running maximum over the
  durations.
* M_k^n: the predictions y for which one u is right for every state of y + E: M_k^{n-1} united over u with K_k^n(u)
  shrunk by E. M_k^0 is L minus G, G at every time that jitter allows, shrunk by E: success is success that the
  controller knows of. (With jitter neither L nor the dynamics may depend on time.)
* W_k^n: M_k^n shrunk by E, the states of which every prediction is good.

From a state of W_k^n every prediction is in M_k^n, has n' <= n steps to go and an input right for the whole box, the
true state in it: it keeps clear and ends in W_{k+1}^{n'-1}. By induction the target is reached, and known to be
reached, within n steps. The controller reads M and K; what a state is promised is W. What happens before s_0 is not
part of it. The sets are not the largest: a prediction is judged by itself, without those before it, and a state and
the error of its prediction count as independent, though with d > 0 one disturbance makes both.

On a grid, shrinking a set by a box is the maximum of its level-set function over the box (`sdhj.solver.hopf_lax`,
"linear": of what the controller reads between the nodes). Near an unsafe end the box has to be on the grid. Whether W
holds a state between the nodes is asked of M itself, all around it.

Certified sets are of cells, and M_k^n holds a cell y where the image of y + E, widened by E, is in M_{k+1}^{n-1}: for a
cell that is a point the same. Their E is bounded by intervals (`sdhj.certified.general_proof`), not by differences.

*In closed form.* dq = u + v, u in {-1, 0, 1}, |v| <= b < 1, target |q| <= r; T = delta + 2 j, S = delta - 2 j. Here
E = e + d b, and the sets are intervals around 0. M^0 has the half-width r - E; W^n has E less than M^n. u = 1 leads
[-w - (1 - b) S, w - (1 + b) T] into [-w, w]: its low end may be stopped early, its high end late. With w the half-width
of W^{n-1}, shrunk by E and united with M^{n-1} (without a gap while 2 w >= (1 + b) T),

    half-width of W^n = r - 2 E + n ((1 - b) (delta - 2 j) - 2 E)

as long as the last term is positive: each step gains what the slowest robot moves in the shortest interval, less 2 E.
Nothing beyond the target is left from e = (1 - b) (delta - 2 j) / 2 - d b on. A wall at q >= c cuts W^n off at c - 2 E.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sdhj.problem.checks import number, whole


@dataclass(frozen=True)
class Sensing:
    """How well a robot measures and how promptly it acts; by default exactly and at once.

    Parameters
    ----------
    error : float, or one for each axis
        e, the most by which a measurement is off, in the units of the state.
    delay : float
        d, from a measurement to the start of the input that is chosen from it, s.
    jitter : float
        j, how early or late a sampling time may come, s.
    rest : int
        Index of the input that is held before the first one starts.

    Raises
    ------
    ValueError
        For what is no number or negative; a problem also checks that it fits.
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
        """Whether anything is not exact or not at once."""
        return bool(np.any(self.error) or self.delay or self.jitter)

    def hold(self, delta: float) -> tuple[float, float]:
        """The longest time for which an input may be held, s, and how much sooner that may end."""
        return delta + 2 * self.jitter, 4 * self.jitter
