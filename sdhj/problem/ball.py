"""Disturbances of two components in a ball, played as a polygon around it whose sides are components of their own."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from typing import Any

import numpy as np

from sdhj.common.checks import number, whole
from sdhj.common.remembering import FloatArray
from sdhj.formulas.formula import BlackBox
from sdhj.problem.arguments import arguments

MOST_SIDES = 32


@dataclass(frozen=True)
class Ball:
    """Bounds of a disturbance v of two components: |v| <= radius, in `sdhj.Dynamics(..., bounds=sdhj.Ball(0.1))`.

    What is played is the regular polygon around the ball, farther out by 1 / cos(pi / sides) - 1 at its corners: 8 %
    with 8 sides, 2 % with 16 (the square: 41 %). It is the sum of a segment along each of its K = sides / 2 directions,
    so v then has K components w of a box: the velocity is drift + gain sum_k (cos(pi k / K), sin(pi k / K)) w_k with
    |w_k| <= radius tan(pi / (2 K)). Projections and certified tables play the box around the polygon; for these
    bounds=[radius, radius] proves more: cells are aligned with it.

    Where v does not enter the velocity linearly, it is a (cos b, sin b) with |a| <= radius and |b| <= pi / 2, the two
    components of `problem.dynamics`, cut into `Dynamics.pieces` each: up to 18 % farther out with 8 pieces, 10 % with
    16.

    Parameters
    ----------
    radius : float, or function of (points (M, ndim), u (m,), t) -> (M,)
        In the unit of v.
    sides : int
        An even number from 4 to 32. Each pair is one more component.

    Examples
    --------
    >>> import numpy as np
    >>> import sdhj
    >>> speeds = [[0.5, 0.0], [-0.5, 0.0]]
    >>> dynamics = sdhj.Dynamics(inputs=speeds, drift=speeds, gain=np.eye(2), bounds=sdhj.Ball(0.1))
    >>> dynamics.gain.shape, dynamics.bounds.round(4).tolist()
    ((2, 4), [0.0414, 0.0414, 0.0414, 0.0414])
    """

    radius: Any
    sides: int = 8

    def __post_init__(self) -> None:
        if not callable(self.radius):
            object.__setattr__(self, "radius", number("radius", self.radius, least=0.0))
        if whole("sides", self.sides, least=4, most=MOST_SIDES) % 2:
            raise ValueError(f"sides must be an even number, as each has another opposite to it, got {self.sides}")

    @property
    def directions(self) -> FloatArray:
        """Unit vectors (cos(pi k / K), sin(pi k / K)) along which the pairs of sides run: (2, K)."""
        angles = 2 * np.pi / self.sides * np.arange(self.sides // 2)
        return np.stack([np.cos(angles), np.sin(angles)])

    def bounds(self) -> Any:
        """Half-widths radius tan(pi / (2 K)) of the K components along the sides, as `Dynamics.bounds`."""
        share = np.full(self.sides // 2, np.tan(np.pi / self.sides))
        if not callable(self.radius):
            return self.radius * share
        radius: Callable[..., Any] = self.radius
        arguments("bounds", radius)  # refuses what is not called like bounds
        # through `wraps`, `arguments` sees the user's parameters, and tracing finds the module whose numpy it replaces
        return wraps(radius)(lambda *given: np.stack([radius(*given) * one for one in share.tolist()], axis=-1))

    def gain(self, given: Any) -> Any:
        """The gain of the K components along the sides, given @ `directions`, or a function's answer so."""
        # `Dynamics` asks for this method, and for `velocity`, by the name of the field that it replaces
        if isinstance(given, BlackBox):
            raise ValueError("a Ball needs a gain that can be read as a formula, or as an array")
        if callable(given):
            return wraps(given)(lambda *found: self._along(given(*found)))
        found = np.asarray(given, dtype=float)
        if found.ndim != 2 or found.shape[1] != 2:
            raise ValueError(f"a Ball needs a gain of shape (ndim, 2), for its two components, got {found.shape}")
        return found @ self.directions

    def velocity(self, given: Any) -> Any:
        """The `given` velocity as a function of the components w (K,) along the sides, with v = directions @ w."""
        axes = self.directions.tolist()
        return _velocity_of(given, lambda w: [sum(w[k] * one for k, one in enumerate(axis)) for axis in axes])

    def in_polar(self, given: Any) -> tuple[Any, Any]:
        """The `given` velocity as a function of (a, b), v = a (cos b, sin b), and their bounds (radius, pi / 2)."""
        velocity = _velocity_of(given, lambda w: [w[0] * np.cos(w[1]), w[0] * np.sin(w[1])])
        if not callable(radius := self.radius):
            return velocity, np.array([radius, np.pi / 2])

        def most(*found: Any) -> Any:
            far = radius(*found)
            # of the shape of `far`, also where that is traced
            return np.stack([far, 0.0 * far + np.pi / 2], axis=-1)

        return velocity, wraps(radius)(most)

    def _along(self, gain: Any) -> Any:
        """gain @ `directions`, (..., ndim, K), also traced."""
        if gain.shape[-1] != 2:
            raise ValueError(f"a Ball needs a gain of two columns, for its two components, got {gain.shape[-1]}")
        pairs = self.directions.T.tolist()
        return np.stack([gain[..., 0] * x + gain[..., 1] * y for x, y in pairs], axis=-1)


def _velocity_of(given: Any, disturbance: Callable[[Any], list[Any]]) -> Any:
    """The `given` velocity as a function of w, of which `disturbance` makes v, if it takes v."""
    takes = arguments("velocity", given)
    if "v" not in takes:
        return given
    # `v` stays where the user has it among the arguments.
    place = takes.index("v")

    def velocity(*found: Any) -> Any:
        return given(*found[:place], np.stack(disturbance(found[place])), *found[place + 1 :])

    return wraps(given)(velocity)
