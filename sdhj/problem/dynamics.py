"""The dynamics of the state as data (Eq. 1), and what input and adversary can do in one sampling interval.

    dq/dt = drift(q, u_j, t) + gain(q, u_j, t) v,    |v_d| <= bounds_d(u_j, t)

`Interval` alone defines what may happen from step k on: the velocity sets of the games, the boxes with which the
controller looks ahead, and the plant that the simulation integrates.
"""

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from sdhj.kernels import FloatArray
from sdhj.problem.checks import ARGUMENTS, arguments, ask, finite_array
from sdhj.problem.grid import Grid, Window
from sdhj.problem.memory import require

MOST_STEPS = 100_000  # time steps of one PDE; whatever needs more has a wrong unit


@dataclass(frozen=True)
class Velocities:
    """The velocity set at every node, in the form that the kernels take.

    An interval [lower, upper] for each axis: arrays (ndim,) if it does not depend on the state, else (ndim, *shape). If
    the adversary couples axes or a coordinate was projected out, also `drift` (modes, ndim, *shape) and `gain` (modes,
    ndim, D, *shape), times the bounds: H = max over modes of p . drift + sum_d |p . gain_d|.
    """

    lower: FloatArray
    upper: FloatArray
    drift: FloatArray | None = None
    gain: FloatArray | None = None

    @property
    def coupled(self) -> bool:
        return self.drift is not None

    @property
    def nbytes(self) -> int:
        return sum(part.nbytes for part in (self.lower, self.upper, self.drift, self.gain) if part is not None)

    def steps(self, grid: Grid, duration: float, cfl: float) -> int:
        """Number of time steps that the CFL condition dt * sum_i max|v_i| / dx_i <= cfl requires.

        Raises
        ------
        ValueError
            If it is more than `MOST_STEPS`.
        """
        speed = np.maximum(np.abs(self.lower), np.abs(self.upper))
        # no BLAS, whose threads would compete with the kernels'
        rate = np.max(sum(along / spacing for along, spacing in zip(speed, grid.spacing, strict=True)))
        count = duration * float(rate) / cfl * (1 - 1e-9)
        if count > MOST_STEPS:
            what = f"time steps for each PDE, at cfl {cfl:g}"
            raise too_fast(grid, speed.reshape(grid.ndim, -1).max(axis=1), duration, count, what)
        return int(np.ceil(count))


def too_fast(grid: Grid, speed: FloatArray, duration: float, count: float, what: str) -> ValueError:
    """The error for an interval that needs too many (`count`) of `what` at speeds (ndim,); it names the worst axis."""
    axis = int(np.argmax(speed / np.array(grid.spacing)))
    return ValueError(
        f"a sampling interval of delta = {duration:g} needs {count:.1e} {what}, and at most {MOST_STEPS:,} are "
        f"supported: along axis {axis} ({grid.names[axis]}) the velocity is up to {speed[axis]:g} and nodes are "
        f"{grid.spacing[axis]:g} apart; use a shorter delta, lower velocities or fewer nodes, or check their units"
    )


MOST_INPUTS = 256
SURVEYED = 2**22  # nodes at which velocities are compared at a time
NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)  # for means over time of velocities that depend on nothing else
# fractions of an interval at which time-dependent velocities are compared: evenly spaced ones would miss vibrations
INSTANTS = np.concatenate([[0.0], (NODES + 1) / 2, [1.0]])


@dataclass(frozen=True)
class Dynamics:
    """dq/dt = drift(q, u_j, t) + gain(q, u_j, t) v with |v_d| <= bounds_d(u_j, t) (Eq. 1, affine in the adversary).

    Parameters
    ----------
    inputs : (L, m) array
        The quantised inputs u_j, at most 256.
    drift : (L, ndim) array, or function of (points (M, ndim), u (m,), t) -> (M, ndim)
        Velocity of the state under each input without a disturbance, per second; an array if it depends on u alone.
    gain : (ndim, D) array, or function of (points, u, t) -> (M, ndim, D)
        How the D components of the disturbance v move the state.
    bounds : (D,) array, or function of (u, t) -> (D,)
        Half-widths of the box of disturbances. Without an adversary: bounds [0.0] and a gain of zeros (ndim, 1).

    Raises
    ------
    ValueError
        If a shape, a number or a function does not fit.

    Notes
    -----
    A function may omit arguments that it does not use: `drift(points, u)`, `gain(u)`, `bounds(t)`. They are matched by
    these names; one of another name gets the first that is left, as `q` gets the points in `drift(q, u)`. The time t is
    in s, from step 0 on. Without `points` a function returns one value for all states, without the leading dimension M.
    Coordinates on periodic axes are wrapped into the grid before a function is called.

    Examples
    --------
    A cart drives at 1 m/s, turns at -1 or 1 rad/s, and is pushed about by up to 0.1 m/s:

    >>> import numpy as np
    >>> import sdhj
    >>> dynamics = sdhj.Dynamics(
    ...     inputs=[[-1.0], [1.0]],
    ...     drift=lambda q, u: np.stack([np.cos(q[:, 2]), np.sin(q[:, 2]), np.full(len(q), u[0])], axis=1),
    ...     gain=np.eye(3)[:, :2],
    ...     bounds=[0.1, 0.1],
    ... )
    >>> dynamics.drift(np.zeros((1, 3)), dynamics.inputs[1])
    array([[1., 0., 1.]])
    """

    inputs: FloatArray
    drift: FloatArray | Callable[..., FloatArray]
    gain: FloatArray | Callable[..., FloatArray]
    bounds: FloatArray | Callable[..., FloatArray]
    takes: dict[str, tuple[str, ...]] = field(init=False, repr=False, compare=False, default_factory=dict)

    def __post_init__(self) -> None:
        inputs = finite_array("inputs", self.inputs)
        if inputs.ndim != 2 or inputs.shape[0] < 1:
            raise ValueError(f"inputs must have shape (L, m) with at least one row, got {inputs.shape}")
        if inputs.shape[0] > MOST_INPUTS:
            raise ValueError(
                f"{inputs.shape[0]} inputs; at most {MOST_INPUTS} are supported, so quantise more coarsely"
            )
        object.__setattr__(self, "inputs", inputs)
        if not callable(self.bounds):
            bounds = np.atleast_1d(finite_array("bounds", self.bounds))
            if bounds.ndim != 1 or (bounds < 0).any():
                raise ValueError(f"bounds must be a row of half-widths >= 0, got {self.bounds}")
            object.__setattr__(self, "bounds", bounds)
        for name in ARGUMENTS:
            if callable(given := getattr(self, name)):
                self.takes[name] = arguments(name, given)
            elif name != "bounds":
                object.__setattr__(self, name, finite_array(name, given))

    def check(self, ndim: int) -> None:
        """Raise ValueError if an array does not fit a state of `ndim` coordinates."""
        if not callable(self.drift):
            finite_array("drift", self.drift, (len(self.inputs), ndim))
        if not callable(self.gain):
            if self.gain.shape[:1] == (ndim,) and self.gain.shape != (ndim, self.adversaries):
                raise ValueError(
                    f"bounds must have one half-width for each column of the gain, which has shape {self.gain.shape}; "
                    f"got {self.bounds_at(0, 0.0).tolist()}"
                )
            finite_array("gain", self.gain, (ndim, self.adversaries))

    @property
    def constant(self) -> bool:
        """Whether drift, gain and bounds are arrays, so that velocities depend on input and disturbance only."""
        return not self.takes

    @property
    def stateless(self) -> bool:
        """Whether velocities do not depend on the state."""
        return not any("points" in takes for takes in self.takes.values())

    @property
    def timed(self) -> bool:
        """Whether velocities depend on time."""
        return any("t" in takes for takes in self.takes.values())

    @cached_property
    def adversaries(self) -> int:
        """D, the number of components of the disturbance."""
        return len(self._bounds(0, 0.0))

    @cached_property
    def alike(self) -> bool:
        """Whether gain and bounds are the same for every input."""
        return not any("u" in self.takes.get(name, ()) for name in ("gain", "bounds"))

    def couples(self, axes: Sequence[int]) -> bool:
        """Whether a component of the disturbance moves several of the given axes, so that their velocity set is no box.

        True if the gain is a function, because it may.
        """
        if callable(self.gain):
            return True
        pushed = np.abs(self.gain)[list(axes)] * (1.0 if callable(self.bounds) else self.bounds)
        moved = pushed > 1e-12 * pushed.max(initial=0.0)  # the rest is rounding, as of a gain that is a rotation
        return bool((np.count_nonzero(moved, axis=0) > 1).any())

    def restricted(self, axes: Sequence[int], embedded: Callable[[FloatArray], FloatArray]) -> "Dynamics":
        """The dynamics of some axes; `embedded` turns their coordinates (M, len(axes)) into states (M, ndim)."""
        keep = list(axes)

        def of_axes(function: Any, takes: tuple[str, ...], last: int) -> Any:
            def restricted(*values: Any) -> FloatArray:
                given = [
                    embedded(value) if name == "points" else value for name, value in zip(takes, values, strict=True)
                ]
                return np.moveaxis(np.moveaxis(np.asarray(function(*given)), last, 0)[keep], 0, last)

            parameters = [inspect.Parameter(name, inspect.Parameter.POSITIONAL_ONLY) for name in takes]
            restricted.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
            return restricted

        parts = [(self.drift, "drift", -1), (self.gain, "gain", -2)]
        drift, gain = (
            of_axes(part, self.takes[name], last) if callable(part) else np.take(part, keep, axis=last)
            for part, name, last in parts
        )
        return Dynamics(self.inputs, drift, gain, self.bounds)

    def _called(self, name: str, points: FloatArray | None, j: int, t: float, shape: tuple[int, ...]) -> FloatArray:
        """The checked result of a function: of `shape`, or of shape[1:] if the function does not take the points."""
        values = {"points": points, "u": self.inputs[j], "t": t}
        answer = ask(name, getattr(self, name), *(values[one] for one in self.takes[name]))
        if "points" in self.takes[name]:
            return finite_array(name, answer, shape)
        return np.broadcast_to(finite_array(name, answer, shape[1:]), shape)

    def drift_at(self, points: FloatArray, j: int, t: float = 0.0) -> FloatArray:
        """Velocity under input j at points (M, ndim) and time t without a disturbance; shape (M, ndim)."""
        if callable(self.drift):
            return self._called("drift", points, j, t, points.shape)
        return np.broadcast_to(self.drift[j], points.shape)

    def gain_at(self, points: FloatArray, j: int = 0, t: float = 0.0) -> FloatArray:
        """The gain of the disturbance under input j at points (M, ndim) and time t; shape (M, ndim, D)."""
        shape = (*points.shape, self.adversaries)
        if callable(self.gain):
            return self._called("gain", points, j, t, shape)
        return np.broadcast_to(self.gain, shape)

    def bounds_at(self, j: int = 0, t: float = 0.0) -> FloatArray:
        """Half-widths of the box of disturbances under input j at time t, (D,)."""
        return finite_array("bounds", self._bounds(j, t), (self.adversaries,))

    def _bounds(self, j: int, t: float) -> FloatArray:
        if not callable(self.bounds):
            return self.bounds
        values = {"u": self.inputs[j], "t": t}
        answer = finite_array("bounds", ask("bounds", self.bounds, *(values[one] for one in self.takes["bounds"])))
        if answer.ndim != 1 or (answer < 0).any():
            raise ValueError(f"bounds must return a row of half-widths >= 0, got {answer} at t = {t:g}")
        return answer


@dataclass(frozen=True, eq=False)
class Interval:
    """What an input and the adversary can do from one sampling time to the next.

    Made by `ReachAvoidProblem.interval`. States may have any coordinates on periodic axes.

    Attributes
    ----------
    grid : Grid
    dynamics : Dynamics
    begin, delta : float
        When it begins and how long it lasts, s.
    early, wider : float, (ndim,)
        How much sooner the adversary may end it, s; by how much boxes of what is reachable are widened.
    """

    grid: Grid
    dynamics: Dynamics
    begin: float
    delta: float
    early: float = 0.0
    wider: FloatArray | float = 0.0

    @property
    def end(self) -> float:
        return self.begin + self.delta

    # ---- of single states: the controller, the adversaries, the plant

    def drift(self, states: FloatArray, j: int, t: float) -> FloatArray:
        """Velocity of states (M, ndim) under input j without the adversary: (M, ndim)."""
        return self.dynamics.drift_at(self.grid.wrapped(states), j, t)

    def gain(self, states: FloatArray, inputs: FloatArray, t: float) -> FloatArray:
        """What the adversary's box adds to the velocity of each state (M, ndim) under its own input, (M, ndim, D)."""
        points = self.grid.wrapped(states)
        if self.dynamics.alike:
            return self.dynamics.gain_at(points, 0, t)
        gain = np.empty((*states.shape, self.dynamics.adversaries))
        for j in np.unique(inputs):
            gain[inputs == j] = self.dynamics.gain_at(points[inputs == j], int(j), t)
        return gain

    def bounds(self, inputs: FloatArray, t: float) -> FloatArray:
        """Half-widths of the adversary's box for each of the inputs (M,) held: (M, D)."""
        if self.dynamics.alike:
            return np.broadcast_to(self.dynamics.bounds_at(0, t), (len(inputs), self.dynamics.adversaries))
        table = np.stack([self.dynamics.bounds_at(j, t) for j in range(len(self.dynamics.inputs))])
        return table[inputs]

    def undisturbed(self, states: FloatArray, inputs: FloatArray, t: float) -> FloatArray:
        """Velocity of each state (M, ndim) under its own input, given by its index (M,), no adversary: (M, ndim)."""
        if not callable(self.dynamics.drift):
            return np.asarray(self.dynamics.drift)[inputs]
        velocity = np.empty_like(states)
        for j in np.unique(inputs):
            velocity[inputs == j] = self.drift(states[inputs == j], int(j), t)
        return velocity

    def advance(
        self, states: FloatArray, inputs: FloatArray, v: FloatArray, t: float, duration: float, *, walls: bool = True
    ) -> FloatArray:
        """States `duration` s after t under held inputs (M,) and v (M, D), clipped at the walls of the grid.

        Exact for constant velocities, else one Runge-Kutta step of order 4. walls=False lets them through.
        """

        def velocity(q: FloatArray, now: float) -> FloatArray:
            if not callable(self.dynamics.gain):
                return self.undisturbed(q, inputs, now) + v @ np.asarray(self.dynamics.gain).T
            return self.undisturbed(q, inputs, now) + np.einsum("mad,md->ma", self.gain(q, inputs, now), v)

        def moved(span: float, slope: FloatArray) -> FloatArray:
            moved = states + span * slope
            return self.grid.clipped(moved) if walls else moved

        k1 = velocity(states, t)
        if self.dynamics.constant:
            return moved(duration, k1)
        k2 = velocity(moved(duration / 2, k1), t + duration / 2)
        k3 = velocity(moved(duration / 2, k2), t + duration / 2)
        k4 = velocity(moved(duration, k3), t + duration)
        return moved(duration, (k1 + 2 * k2 + 2 * k3 + k4) / 6)

    def displacements(self, states: FloatArray) -> FloatArray:
        """Where every input takes each state (M, ndim) in the interval without an adversary, relative to it.

        Shape (M, L, ndim), or (1, L, ndim) where it is the same for all states. Exact for a constant drift, else by the
        midpoint rule.
        """
        dynamics, middle = self.dynamics, self.begin + self.delta / 2
        if not callable(dynamics.drift):
            return self.delta * np.asarray(dynamics.drift)[None]
        moves = []
        for j in range(len(dynamics.inputs)):
            halfway = self.grid.clipped(states + self.delta / 2 * self.drift(states, j, self.begin))
            moves.append(self.delta * self.drift(halfway, j, middle))
        return np.stack(moves, axis=1)

    def path(self, states: FloatArray, inputs: FloatArray, parts: int) -> FloatArray:
        """Where each state (M, ndim) is under its own input (M,) after 1, ..., `parts` parts, without an adversary.

        Shape (M, parts, ndim); held at walls. Exact for a constant drift, else to second order.
        """
        shares, slope = np.arange(1, parts + 1)[:, None] / parts, self.undisturbed(states, inputs, self.begin)
        moved = self.delta * slope
        bent = 0.0 * moved
        if callable(self.dynamics.drift):
            halfway = self.grid.clipped(states + moved / 2)
            bent = self.delta * self.undisturbed(halfway, inputs, self.begin + self.delta / 2) - moved
        return self.grid.clipped(states[:, None] + shares * moved[:, None] + shares**2 * bent[:, None])

    def reachable(self, states: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Boxes that hold the states at the interval's end under each input and any adversary, relative to the states.

        Lower and upper corners, both (M, L, ndim), or (1, L, ndim) where they are the same for all states. Exact where
        velocities do not depend on the state; else the adversary's gain is that at the start.
        """
        dynamics = self.dynamics
        if self.early:
            sooner = [replace(self, delta=self.delta - by * self.early, early=0.0) for by in (0.0, 0.5, 1.0)]
            lows, highs = zip(*(interval.reachable(states) for interval in sooner), strict=True)
            return np.min(lows, axis=0), np.max(highs, axis=0)
        if dynamics.stateless:
            low, high = self.reached(0.0, self.delta)
            return low[None] - self.wider, high[None] + self.wider
        centre, points = self.displacements(states), self.grid.wrapped(states)
        times = [self.begin] if not dynamics.timed else [self.begin, self.begin + self.delta / 2, self.end]
        spreads = []
        for j in range(1 if dynamics.alike else len(dynamics.inputs)):
            most = [self.delta * np.abs(dynamics.gain_at(points, j, t)) @ dynamics.bounds_at(j, t) for t in times]
            spreads.append(np.max(most, axis=0))
        spread = np.stack(spreads, axis=1) + self.wider
        return centre - spread, centre + spread

    # ---- of velocities that do not depend on the state: the Hopf-Lax formula

    def extremes(self, t: float) -> FloatArray:
        """The least and the greatest velocity along each axis under each input at time t: (2, L, ndim)."""
        dynamics, nothing = self.dynamics, np.zeros((1, self.grid.ndim))
        extremes = np.empty((2, len(dynamics.inputs), self.grid.ndim))
        for j in range(len(dynamics.inputs)):
            drift = dynamics.drift_at(nothing, j, t)[0]
            spread = np.abs(dynamics.gain_at(nothing, j, t)[0]) @ dynamics.bounds_at(j, t)
            extremes[:, j] = drift - spread, drift + spread
        return extremes

    @cached_property
    def _always(self) -> FloatArray:
        return self.extremes(self.begin)

    def reached(self, begin: float, end: float) -> tuple[FloatArray, FloatArray]:
        """Corners of the boxes of displacements from `begin` to `end`, s into the interval, by input: two (L, ndim).

        For velocities that do not depend on the state; exact where they do not depend on time, else by Gauss's rule.
        """
        if self.dynamics.timed:
            times = self.begin + begin + (end - begin) * (NODES + 1) / 2
            mean = np.tensordot(WEIGHTS / 2, np.stack([self.extremes(t) for t in times]), axes=1)
        else:
            mean = self._always
        low, high = (end - begin) * mean
        return low, high

    # ---- on the grid: velocity sets for the games

    @property
    def sampling_bytes(self) -> int:
        """Bytes that the velocities under one input take while they are sampled on the whole grid."""
        return 8 * self.grid.ndim * (2 * self.dynamics.adversaries + 6) * self.grid.size

    def _sampled(self, j: int, axes: Sequence[int], t: float, grid: Grid, points: FloatArray) -> FloatArray:
        """Drift under u_j and gain times bounds of some axes, one behind the other: (axes, 1 + D, *grid.shape)."""
        dynamics, keep = self.dynamics, list(axes)
        sampled = np.empty((len(keep), 1 + dynamics.adversaries, len(points)))
        sampled[:, 0] = dynamics.drift_at(points, j, t).T[keep]
        sampled[:, 1:] = np.moveaxis(dynamics.gain_at(points, j, t), 0, 2)[keep]
        sampled[:, 1:] *= dynamics.bounds_at(j, t)[:, None]
        return sampled.reshape(*sampled.shape[:2], *grid.shape)

    @cached_property
    def reads(self) -> FloatArray:
        """Whether the velocity along axis i depends on coordinate k, by its values at the nodes; (ndim, ndim) bool."""
        return self.survey[0]

    @cached_property
    def speeds(self) -> FloatArray:
        """The greatest speed along each axis at the nodes, whatever the input and the adversary; (ndim,)."""
        return self.survey[1]

    @cached_property
    def survey(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """`reads`, `speeds` and which component of the adversary moves which axis, (L, ndim, D) bool, sampled once."""
        ndim, dynamics = self.grid.ndim, self.dynamics
        instants = self.begin + self.delta * (INSTANTS[::4] if dynamics.timed else INSTANTS[:1])
        reads, speeds = np.zeros((ndim, ndim), np.bool_), np.zeros(ndim)
        pushes = np.zeros((len(dynamics.inputs), ndim, dynamics.adversaries), np.bool_)
        if dynamics.stateless:
            return reads, np.max([np.abs(self.extremes(t)).max(axis=(0, 1)) for t in instants], axis=0), pushes
        # neighbours share a node, so what varies along an axis that is cut does so within one of them too
        pieces, everything = list(self.grid.pieces(SURVEYED, overlap=1)), range(ndim)
        most = max(piece.size for piece in pieces)
        require(self.sampling_bytes // self.grid.size * most, f"sampling the velocities on {most:.1e} nodes")
        for piece in pieces:
            points = piece.points()
            for j, t in product(range(len(dynamics.inputs)), instants.tolist()):
                sampled = self._sampled(j, everything, t, piece, points)
                speeds = np.maximum(speeds, np.abs(sampled).sum(axis=1).reshape(ndim, -1).max(axis=1))
                pushes[j] |= sampled[:, 1:].any(axis=tuple(range(2, sampled.ndim)))
                for k in everything:
                    varies = sampled != sampled.take([0], axis=2 + k)
                    reads[:, k] |= varies.any(axis=tuple(range(1, varies.ndim)))
        return reads, speeds, pushes

    def on(self, grid: Grid) -> "Interval":
        """The interval on a window of its grid, where what is said of the whole grid stays as it is there."""
        part = replace(self, grid=grid)
        part.__dict__["survey"] = self.survey
        return part

    def closed(self, axes: Sequence[int]) -> tuple[int, ...]:
        """The smallest set of axes that holds `axes` and whose velocities depend on no other coordinate."""
        known = set(axes)
        while grown := {int(k) for i in known for k in np.flatnonzero(self.reads[i])} - known:
            known |= grown
        return tuple(sorted(known))

    def velocities(self, j: int, axes: Sequence[int], t: float | None = None, *, drift: bool = True) -> Velocities:
        """The velocity set under u_j along some axes at time t, by default at the begin, on their subgrid.

        Coordinates left out that enter are taken at all their nodes (App. A.4): each is one mode, H = max over modes.
        Where they move the velocity of one axis at most and the adversary does not couple axes, the hull of the modes'
        boxes has the same H: it is again a box, cheaper and with the sharper flux. drift=False leaves the drift out
        (the moving frame).
        """
        t = self.begin if t is None else t
        dynamics = self.dynamics
        if dynamics.stateless:
            nothing, keep = np.zeros((1, self.grid.ndim)), list(axes)
            f = dynamics.drift_at(nothing, j, t)[:, keep] * drift
            b = dynamics.gain_at(nothing, j, t)[:, keep] * dynamics.bounds_at(j, t)
        else:
            f, b = self._modes(j, axes, t)
            f = f * drift
        spread = np.abs(b).sum(axis=2)
        lower, upper = f - spread, f + spread
        hull = lower.min(axis=0), upper.max(axis=0)
        swayed = [((lower[:, i] != hull[0][i]) | (upper[:, i] != hull[1][i])).any() for i in range(len(axes))]
        pushed = b.any(axis=(0, *range(3, b.ndim)))
        if isinstance(self.grid, Window) and not (dynamics.timed or dynamics.stateless):
            pushed = self.survey[2][j][list(axes)]  # elsewhere on the grid perhaps
        coupled = (np.count_nonzero(pushed, axis=0) > 1).any()
        return Velocities(*hull) if sum(swayed) <= 1 and not coupled else Velocities(*hull, drift=f, gain=b)

    def _modes(self, j: int, axes: Sequence[int], t: float) -> tuple[FloatArray, FloatArray]:
        """Drift (modes, axes, *subgrid) and gain times bounds (modes, axes, D, *subgrid) at time t."""
        outside = [axis for axis in range(self.grid.ndim) if axis not in axes]
        entering = [axis for axis in outside if self.reads[list(axes), axis].any()]
        seen = sorted({*axes, *entering})
        grid = self.grid.subgrid(seen)
        require(8 * self.grid.ndim * grid.size * (2 * self.dynamics.adversaries + 6), "sampling the velocities")
        points = np.tile(np.array(self.grid.lower), (grid.size, 1))
        points[:, seen] = grid.points()
        sampled = self._sampled(j, axes, t, grid, points)
        sampled = np.moveaxis(sampled, [2 + seen.index(axis) for axis in entering], range(len(entering)))
        sampled = sampled.reshape(-1, *sampled.shape[len(entering) :])
        return sampled[:, :, 0], sampled[:, :, 1:]

    def velocity_field(
        self, j: int, axes: Sequence[int], *, drift: bool = True
    ) -> Velocities | Callable[[float], Velocities]:
        """The velocity set as `schemes.evolve` reads it: itself or, where it depends on time, as a function of tau.

        tau is counted back from the interval's end.
        """
        if self.dynamics.timed:
            return lambda tau: self.velocities(j, axes, self.end - tau, drift=drift)
        return self.velocities(j, axes, drift=drift)
