"""The dynamics of the state (Eq. 1) as the user gives them, and how they are read, as a `VectorField`.

dq/dt = drift(q, u_j, t) + gain(q, u_j, t) v,    |v_d| <= bounds_d(q, u_j, t),    or dq/dt = velocity(q, u_j, v, t)
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from sdhj.common.checks import finite_array, whole
from sdhj.common.remembering import FloatArray, ReadOnly, read_only
from sdhj.formulas.derivative import linear
from sdhj.formulas.formula import BlackBox, Formula, compare
from sdhj.formulas.graph import Node, leaf, ordered
from sdhj.formulas.text import MOST_LINES
from sdhj.formulas.tracing import parameter, points_of, rows_for, traced
from sdhj.problem.arguments import KNOWN, arguments
from sdhj.problem.ball import Ball
from sdhj.problem.vector_field import CUTS, VectorField, constant_formula

MOST_CUTS = 1024  # of the range of a component of v that does not enter linearly
MOST_INPUTS = 1 << 16  # an export in C numbers them by 16 bits


@dataclass(frozen=True)
class Dynamics(ReadOnly):
    """The velocity of the state (Eq. 1).

    Either dq/dt = drift(q, u_j, t) + gain(q, u_j, t) v with |v_d| <= bounds_d, or any dq/dt = velocity(q, u_j, v, t).

    Parameters
    ----------
    inputs : (L, m) array
        The quantised inputs u_j, at most 65,536.
    drift : (L, ndim) array, or function of (points (M, ndim), u (m,), t) -> (M, ndim)
        Velocity without a disturbance, per second; an array if it depends on u alone.
    gain : (ndim, D) array, or function of (points, u, t) -> (M, ndim, D), optional
        How the D components of the disturbance v move the state.
    bounds : (D,) array, or function of (points, u, t) -> (M, D), or `sdhj.Ball`, optional
        Half-widths of the box of disturbances, or a ball.
    velocity : function of (points, u, v (D,), t) -> (M, ndim), optional
        In place of drift and gain. Where v does not enter linearly, each component may be anything between its extremes
        over a piece of the box of v, which errs to the safe side.
    pieces : int
        Into how many the range of each component of v that does not enter linearly and moves several axes is cut: the
        more, the smaller the error, the larger cost and memory. Certified tables take the whole range.

    Notes
    -----
    Functions are read once, as formulas (`sdhj.formulas`), when a `ReachAvoidProblem` is made; the time t is in s, from
    step 0 on. The first parameter is the state, not called u, v or t, and the others are known by these names; those
    that are not used may be left out: `drift(q, u)`, `gain(q)`, `bounds(t)`. Where nothing depends on the state, an
    answer may lack the leading dimension M. Coordinates on periodic axes are wrapped before a velocity is evaluated.

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
    drift: Any = None
    gain: Any = None
    bounds: Any = None
    velocity: Any = None
    pieces: int = CUTS
    _polar: Any = field(default=None, init=False, repr=False, compare=False)  # where a ball's v may be nonlinear
    # of the functions read by the last `read`, by the field's name: (function, its formula)
    _parts: dict[str, tuple[Any, Formula]] = field(default_factory=dict, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        # arrays become read-only copies, so that no later write changes what was read
        inputs = finite_array("inputs", self.inputs)
        if inputs.ndim != 2 or inputs.shape[0] < 1:
            few = ", ".join(f"[{value:g}]" for value in inputs.ravel()[:3]) + ", ..." * (inputs.size > 3)
            helps = f"; of one number each: [{few}]" if inputs.ndim < 2 and inputs.size else ""
            raise ValueError(f"inputs must have shape (L, m), a row for each input, got {inputs.shape}{helps}")
        # first of all, so that who gives drift=f(q, u, v) is told to give a velocity, and not that bounds lack a gain
        for name in ("drift", "gain"):
            if callable(given := getattr(self, name)):
                arguments(name, given)
        if inputs.shape[0] > MOST_INPUTS:
            raise ValueError(f"{len(inputs)} inputs; at most {MOST_INPUTS} are supported, so quantise more coarsely")
        object.__setattr__(self, "inputs", read_only(inputs))
        if (self.velocity is None) == (self.drift is None) or (self.velocity is not None and self.gain is not None):
            raise ValueError("give drift, with gain and bounds, or velocity, with bounds")
        if self.velocity is None and (self.gain is None) != (self.bounds is None):
            raise ValueError("gain and bounds belong together: how the disturbance moves the state, how large it is")
        if isinstance(ball := self.bounds, Ball):  # from here on, its sides are components
            # of the user's velocity, before that of the sides takes its place below
            if self.velocity is not None and not isinstance(self.velocity, BlackBox):
                velocity, most = ball.in_polar(self.velocity)
                # in case v does not enter linearly
                polar = Dynamics(inputs, velocity=velocity, bounds=most, pieces=self.pieces)
                object.__setattr__(self, "_polar", polar)
            name = "gain" if self.velocity is None else "velocity"
            object.__setattr__(self, name, getattr(ball, name)(getattr(self, name)))
            object.__setattr__(self, "bounds", ball.bounds())
        if self.bounds is not None and not callable(self.bounds):
            bounds = np.atleast_1d(finite_array("bounds", self.bounds))
            if bounds.ndim != 1 or (bounds < 0).any():
                raise ValueError(f"bounds must be a row of half-widths >= 0, got {self.bounds}")
            object.__setattr__(self, "bounds", read_only(bounds))
        whole("pieces", self.pieces, least=1, most=MOST_CUTS)
        for name in KNOWN:
            given = getattr(self, name)
            if callable(given):
                arguments(name, given)
            elif name in ("drift", "gain") and given is not None:
                object.__setattr__(self, name, read_only(finite_array(name, given)))
            elif name == "velocity" and given is not None:
                raise ValueError(f"velocity must be a function of (points, u, v, t), got {given!r}")

    def read(self, ndim: int) -> VectorField:
        """The dynamics of a state of `ndim` coordinates, as formulas; the functions are kept for `compare`."""
        count = len(self.inputs)
        bounds = self._read("bounds", ndim, None)
        if not isinstance(bounds, Formula):
            raise ValueError("bounds cannot be a BlackBox: give half-widths, or a function that can be read")
        D = bounds.shape[1]
        if self.velocity is not None:
            velocity = self._read("velocity", ndim, (ndim,), D)
            # drift and gain where v enters linearly; else there is no gain, and the drift also reads v
            parts = linear(velocity.outputs, [leaf("p", 1 + d) for d in range(D)])
            if parts is None:
                if self._polar is not None:
                    found = self._polar.read(ndim)
                    # so that `compare` compares the functions that were read, and not those of the sides
                    self._parts.clear()
                    self._parts.update(self._polar._parts)
                    return found
                scaled = partial(_scaled_velocity, velocity, bounds)
                drift, gain = Formula.traced("velocity", scaled, ndim, 1 + D) if bounds.reads.any() else velocity, None
            else:
                drift = Formula(tuple(part[0] for part in parts), ndim, 1, (count, ndim), "drift")
                gain = Formula(tuple(one for part in parts for one in part[1:]), ndim, 1, (count, ndim, D), "gain")
        else:
            drift, gain = self._read("drift", ndim, (ndim,)), self._read("gain", ndim, (ndim, D))
        if bounds.reads.any():  # they go into the gain, and are 1 then
            if isinstance(gain, BlackBox):
                raise ValueError("bounds that depend on the state need a gain that can be read as a formula")
            gain = gain and Formula.traced("gain", partial(_scaled_gain, gain, bounds), ndim)
            # `bounds_at` and `disturbance_bounds` of the result evaluate bounds at one state only
            bounds = constant_formula("bounds", np.ones(bounds.shape), ndim)
        return VectorField(self.inputs, ndim, drift, gain, bounds, self.pieces)

    def compare(self, vector_field: VectorField, states: FloatArray, times: Sequence[float]) -> None:
        """Raise ValueError where a function that `read` kept has other values than its formula."""
        for name, (function, formula) in self._parts.items():
            takes = arguments(name, function)
            # input 0 at all times, every other one at one of them
            for j, t in [*((0, t) for t in times[1:]), *((j, times[j % len(times)]) for j in range(len(self.inputs)))]:
                u, v = self.inputs[j], np.linspace(-0.5, 0.5, vector_field.disturbance_dim)

                # The user's function as `compare` calls a formula: points, t, then each component of v; broadcast, as
                # an answer may lack the axis of points. It is called within this turn of the loop only.
                def called(
                    points: FloatArray, t: float, *v: float, u: FloatArray = u, one: Any = formula.shape[1:]
                ) -> Any:
                    given = _arguments_taken(takes, points, u, t, np.array(v))  # noqa: B023
                    values = np.asarray(function(*given))  # noqa: B023
                    return np.broadcast_to(values, (len(points), *one))

                compare(formula.rows[j], called, states, t, *(v if name == "velocity" else ()))

    def _read(self, name: str, ndim: int, shape: tuple[int, ...] | None, components: int = 0) -> Any:
        """The field `name` as a formula with results (L, *shape), kept with its function, or a BlackBox."""
        if name == "velocity" and isinstance(self.velocity, BlackBox):
            raise ValueError("velocity cannot be a BlackBox: give drift and gain, which can be")
        given, count = getattr(self, name), len(self.inputs)
        if given is None:  # there is no disturbance; bounds have any number of components, so no shape
            given = np.zeros(1 if shape is None else shape)
        if isinstance(given, BlackBox):
            function = partial(_call_with_taken, given.function, arguments(name, given))
            given = given.checked(name, (), ("u", "t0", "t1"))
            return replace(given, function=function, shape=shape or ())
        if isinstance(given, Formula):
            return given
        if not callable(given):
            if name == "drift":
                return constant_formula(name, finite_array(name, given, (count, ndim)), ndim)
            if shape is not None and given.shape != shape:
                raise ValueError(f"gain must have shape {shape}, for {shape[1]} bounds, got {given.shape}")
            return constant_formula(name, np.broadcast_to(given, (count, *given.shape)), ndim)
        takes, parameters = arguments(name, given), 1 + components
        rows = rows_for(ndim, count, self.inputs.shape[1], components)

        def taken(u: FloatArray, rows: int) -> list[Any]:
            return _arguments_taken(takes, points_of(ndim, rows), u, parameter(0), parameter(1, components or 1))

        outputs: list[Node] = []
        for j, u in enumerate(self.inputs):
            label = f"{name} under input {j}" if "u" in takes else name
            # under the first input alone `again`, with another number of points, which takes as long once more
            found, one = traced(label, given, rows, partial(taken, u), shape, "points" in takes, again=j == 0)
            if name == "bounds" and len(one) != 1:
                points = ("M",) * ("points" in takes)
                shapes = f"shape {(*points, 'D')}, got {(*points, *one)}".replace("'", "")
                raise ValueError(f"bounds must return the half-widths of the D components of v, {shapes}")
            outputs += found
        if (lines := len(ordered(outputs))) >= MOST_LINES:
            raise ValueError(
                f"{name} has {lines:,} operations for all {count} inputs together, and a file keeps fewer than "
                f"{MOST_LINES:,}; use fewer inputs or operations, sdhj.gridded for a table, or wrap it in sdhj.BlackBox"
            )
        self._parts[name] = given, Formula(tuple(outputs), ndim, parameters, (count, *one), name)
        return self._parts[name][1]


def _scaled_gain(gain: Any, bounds: Formula, points: Any, t: Any) -> Any:
    """The gain for |v_d| <= 1, gain_{id} |bounds_d|, at traced points: (M, L, ndim, D)."""
    return gain(points, t) * np.abs(bounds(points, t))[:, :, None]


def _scaled_velocity(velocity: Formula, bounds: Formula, points: Any, t: Any, *v: Any) -> Any:
    """The velocity for |v_d| <= 1, f(q, t, v_d |bounds_d|), at traced points: (M, L, ndim)."""
    # bounds depend on no state, so they are read at the first point
    pairs = zip(velocity.rows, bounds.rows, strict=True)
    return np.stack([one(points, t, *(np.stack(v) * np.abs(most(points, t)[0]))) for one, most in pairs], axis=1)


def _arguments_taken(takes: Sequence[str], points: Any, u: FloatArray, t: Any, v: Any = None) -> list[Any]:
    """Those of points, u, t and v that a function takes."""
    known = {"points": points, "u": u, "t": t, "v": v}
    return [known[one] for one in takes]


def _call_with_taken(function: Callable[..., Any], takes: Sequence[str], *given: Any) -> Any:
    """The answer of a function to those of points, u, t and v that it takes."""
    return function(*_arguments_taken(takes, *given))
