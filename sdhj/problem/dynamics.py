"""The dynamics of the state as data (Eq. 1), and what input and adversary can do in one sampling interval.

    dq/dt = drift(q, u_j, t) + gain(q, u_j, t) v,    |v_d| <= bounds_d(q, u_j, t),    or dq/dt = velocity(q, u_j, v, t)

`Interval` alone defines what may happen from step k on: the velocity sets of the games, the boxes with which the
controller looks ahead, and the plant that the simulation integrates.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial, reduce
from itertools import product
from typing import Any

import numpy as np

from sdhj.formulas.formula import BlackBox, Formula, compare, read
from sdhj.formulas.graph import Node, constant, is_constant, leaf, linear, make, ordered, rebuilt
from sdhj.formulas.text import MOST_LINES
from sdhj.formulas.tracing import parameter, points_of, rows_for
from sdhj.kernels import FloatArray
from sdhj.problem.checks import KNOWN, arguments, finite_array, sealed
from sdhj.problem.grid import Grid
from sdhj.problem.memory import require

MOST_STEPS = 100_000  # time steps of one PDE; whatever needs more has a wrong unit


@dataclass(frozen=True)
class Velocities:
    """The velocity set at every node, in the form that the kernels take.

    An interval [low, high] for each axis: arrays (ndim,) if it does not depend on the state, else (ndim, *shape), or a
    list of arrays that broadcast to the shape, each on the axes that it varies along. If the adversary couples axes or
    a coordinate was projected out, also `drift` (modes, ndim, *shape) and `gain` (modes, ndim, D, *shape), times the
    bounds: H = max over modes of p . drift + sum_d |p . gain_d|.
    """

    low: Any
    high: Any
    drift: FloatArray | None = None
    gain: FloatArray | None = None
    shape: tuple[int, ...] = ()

    def kept(self) -> "Velocities":
        """These velocities, which keep what is made of them for the kernels in `terms`, by the layout."""
        self.__dict__.setdefault("terms", {})
        return self

    @cached_property
    def lower(self) -> FloatArray:
        """`low` as one array."""
        return self._whole(self.low)

    @cached_property
    def upper(self) -> FloatArray:
        """`high` as one array."""
        return self._whole(self.high)

    def _whole(self, ends: Any) -> FloatArray:
        return ends if isinstance(ends, np.ndarray) else np.stack([np.broadcast_to(one, self.shape) for one in ends])

    @property
    def coupled(self) -> bool:
        return self.drift is not None

    @property
    def nbytes(self) -> int:
        """Bytes of what is kept."""
        ends = [
            part.nbytes for end in (self.low, self.high) for part in ([end] if isinstance(end, np.ndarray) else end)
        ]
        return sum(ends) + sum(part.nbytes for part in (self.drift, self.gain) if part is not None)

    def steps(self, grid: Grid, duration: float, cfl: float) -> int:
        """Number of time steps that the CFL condition dt * sum_i max|v_i| / dx_i <= cfl requires.

        Raises
        ------
        ValueError
            If it is more than `MOST_STEPS`.
        """
        speed = [np.maximum(np.abs(low), np.abs(high)) for low, high in zip(self.low, self.high, strict=True)]
        # no BLAS, whose threads would compete with the kernels'
        rate = np.max(sum(along / spacing for along, spacing in zip(speed, grid.spacing, strict=True)))
        count = duration * float(rate) / cfl * (1 - 1e-9)
        if count > MOST_STEPS:
            what = f"time steps for each PDE, at cfl {cfl:g}"
            raise too_fast(grid, np.array([along.max() for along in speed]), duration, count, what)
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
KNOWN_AT_MOST = 512  # velocities at different times that an interval keeps
KNOWN_BYTES = 2**25  # of all of them together
NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)  # for means over time of velocities that depend on nothing else
# fractions of an interval at which time-dependent velocities are compared: evenly spaced ones would miss vibrations
INSTANTS = np.concatenate([[0.0], (NODES + 1) / 2, [1.0]])


@dataclass(frozen=True)
class Dynamics:
    """The velocity of the state under each input and disturbance (Eq. 1).

    Either dq/dt = drift(q, u_j, t) + gain(q, u_j, t) v with |v_d| <= bounds_d, or any dq/dt = velocity(q, u_j, v, t).

    Parameters
    ----------
    inputs : (L, m) array
        The quantised inputs u_j, at most 256.
    drift : (L, ndim) array, or function of (points (M, ndim), u (m,), t) -> (M, ndim)
        Velocity of the state under each input without a disturbance, per second; an array if it depends on u alone.
    gain : (ndim, D) array, or function of (points, u, t) -> (M, ndim, D), optional
        How the D components of the disturbance v move the state. Default: there is no disturbance.
    bounds : (D,) array, or function of (points, u, t) -> (M, D), optional
        Half-widths of the box of disturbances.
    velocity : function of (points, u, v (D,), t) -> (M, ndim), optional
        In place of drift and gain. Where v does not enter linearly, each component of the velocity may be anything
        between its extremes over the box of v, which errs to the safe side.

    Raises
    ------
    ValueError
        If a shape, a number or a function does not fit.

    Notes
    -----
    Functions are read once, as formulas (`sdhj.formulas`), when a `ReachAvoidProblem` is made; the time t is in s, from
    step 0 on. The first parameter is the state, whatever it is called, and the others are known by the names u, v and
    t; those that are not used may be left out: `drift(q, u)`, `gain(q)`, `bounds(t)`. Without the state a function
    returns one value for all states, without the leading dimension M. Coordinates on periodic axes are wrapped into the
    grid before a velocity is evaluated.

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

    def __post_init__(self) -> None:
        inputs = finite_array("inputs", self.inputs)
        if inputs.ndim != 2 or inputs.shape[0] < 1:
            raise ValueError(f"inputs must have shape (L, m) with at least one row, got {inputs.shape}")
        if inputs.shape[0] > MOST_INPUTS:
            raise ValueError(
                f"{inputs.shape[0]} inputs; at most {MOST_INPUTS} are supported, so quantise more coarsely"
            )
        object.__setattr__(self, "inputs", inputs)
        if (self.velocity is None) == (self.drift is None) or (self.velocity is not None and self.gain is not None):
            raise ValueError("give drift, with gain and bounds, or velocity, with bounds")
        if self.velocity is None and (self.gain is None) != (self.bounds is None):
            raise ValueError(
                "gain and bounds belong together: how the disturbance moves the state, and how large it is"
            )
        if self.bounds is not None and not callable(self.bounds):
            bounds = np.atleast_1d(finite_array("bounds", self.bounds))
            if bounds.ndim != 1 or (bounds < 0).any():
                raise ValueError(f"bounds must be a row of half-widths >= 0, got {self.bounds}")
            object.__setattr__(self, "bounds", bounds)
        for name in KNOWN:
            given = getattr(self, name)
            if callable(given):
                arguments(name, given)
            elif name in ("drift", "gain") and given is not None:
                object.__setattr__(self, name, finite_array(name, given))
            elif name == "velocity" and given is not None:
                raise ValueError(f"velocity must be a function of (points, u, v, t), got {given!r}")

    def read(self, ndim: int) -> "VectorField":
        """The dynamics of a state of `ndim` coordinates, its functions read as formulas.

        Raises
        ------
        ValueError
            If an array does not fit, or a function cannot be read.
        """
        count = len(self.inputs)
        bounds = Formula((constant(0.0),) * count, ndim, 1, (count, 1), "bounds")
        if self.bounds is not None:
            bounds = self._read("bounds", ndim, None)
        if not isinstance(bounds, Formula):
            raise ValueError(
                "bounds cannot be a BlackBox: give half-widths that are large enough, or a function that can be read"
            )
        D = bounds.shape[1]
        if self.velocity is not None:
            velocity = self._read("velocity", ndim, (ndim,), D)
            parts = linear(velocity.outputs, 1, D) if isinstance(velocity, Formula) else None
            if parts is None:
                return VectorField(self.inputs, ndim, *_scaled_velocity(velocity, bounds))
            drift = Formula(tuple(part[0] for part in parts), ndim, 1, (count, ndim), "drift")
            gain: Any = Formula(tuple(one for part in parts for one in part[1:]), ndim, 1, (count, ndim, D), "gain")
        else:
            drift = self._read("drift", ndim, (ndim,))
            gain = Formula((constant(0.0),) * ndim * count, ndim, 1, (count, ndim, 1), "gain")
            if self.gain is not None:
                self._check_gain(ndim, D)
                gain = self._read("gain", ndim, (ndim, D))
        return VectorField(self.inputs, ndim, drift, *_scaled(gain, bounds))

    def compare(self, field: "VectorField", states: FloatArray, delta: float) -> None:
        """Raise ValueError where a function's values at states (M, ndim) are not what was read from it."""
        for name, formula in self._parts.items():
            function = getattr(self, name)
            takes = arguments(name, function)
            size = len(formula.outputs) // len(self.inputs)
            for j, u in enumerate(self.inputs):
                t, v = (j % 2) * 0.7 * delta, np.linspace(-0.5, 0.5, field.adversaries)

                def called(points: FloatArray, t: float, *v: float, u: FloatArray = u) -> Any:
                    known = {"points": points, "u": sealed(u), "t": t, "v": np.array(v)}
                    values = np.asarray(function(*(known[one] for one in takes)))  # noqa: B023
                    return values if "points" in takes else np.broadcast_to(values, (len(points), *values.shape))  # noqa: B023

                part = formula.of(range(j * size, (j + 1) * size), formula.shape[1:])
                compare(part, called, states, t, *(v if name == "velocity" else ()))

    def _check_gain(self, ndim: int, components: int) -> None:
        if not callable(self.gain) and self.gain.shape[:1] == (ndim,) and self.gain.shape != (ndim, components):
            raise ValueError(
                f"bounds must have one half-width for each column of the gain, which has shape {self.gain.shape}; "
                f"got {components}"
            )

    def _read(self, name: str, ndim: int, shape: tuple[int, ...] | None, components: int = 0) -> Any:
        """A formula of shape (L, *shape), or a black box."""
        if name == "velocity" and isinstance(self.velocity, BlackBox):
            raise ValueError("velocity cannot be a BlackBox: give drift and gain, which can be")
        given, count = getattr(self, name), len(self.inputs)
        if isinstance(given, BlackBox):
            function = partial(_called, given.function, arguments(name, given))
            return replace(given, function=function, name=name, shape=shape or ())
        if isinstance(given, Formula):
            return given
        if not callable(given):
            array = given if shape is None else finite_array(name, given, (count, ndim) if name == "drift" else shape)
            array = array if name == "drift" else np.broadcast_to(array, (count, *array.shape))
            return Formula(tuple(map(constant, array.ravel().tolist())), ndim, 1, array.shape, name)
        takes, parameters = arguments(name, given), 1 + components
        rows = rows_for(ndim, count, self.inputs.shape[1], components)
        known = {"points": points_of(ndim, rows), "t": parameter(0), "v": parameter(1, components or 1)}
        outputs: list[Node] = []
        for j, u in enumerate(self.inputs):
            values = known | {"u": sealed(u)}
            label = f"{name} under input {j}" if "u" in takes else name
            found, one = read(
                label, given, rows, [values[each] for each in takes], shape, "points" in takes, again=j == 0
            )
            if name == "bounds" and len(one) != 1:
                raise ValueError(f"bounds must return a row of half-widths for each point, got shape {one}")
            outputs += found
        if (lines := len(ordered(outputs))) >= MOST_LINES:
            raise ValueError(
                f"{name} has {lines:,} operations for all {count} inputs together, and a file keeps fewer than "
                f"{MOST_LINES:,}; use fewer inputs or operations, sdhj.gridded for a table, or wrap it in sdhj.BlackBox"
            )
        self._parts[name] = Formula(tuple(outputs), ndim, parameters, (count, *one), name)
        return self._parts[name]

    @cached_property
    def _parts(self) -> dict[str, Formula]:
        """What was read last from each function, by name."""
        return {}


def _scaled(gain: Any, bounds: Any) -> tuple[Any, Any]:
    """Gain and bounds; bounds that depend on the state go into the gain, and are 1 then."""
    if not bounds.reads.any():
        return gain, bounds
    if isinstance(gain, BlackBox):
        raise ValueError("bounds that depend on the state need a gain that can be read as a formula")
    count, _, D = gain.shape
    outputs = np.array(gain.outputs, dtype=object).reshape(gain.shape)
    each = np.array(bounds.outputs, dtype=object).reshape(count, 1, D)
    scaled = [
        make("mul", a, make("abs", b))
        for a, b in zip(outputs.flat, np.broadcast_to(each, gain.shape).flat, strict=True)
    ]
    return replace(gain, outputs=tuple(scaled)), _ones(bounds)


def _scaled_velocity(velocity: Any, bounds: Formula) -> tuple[Any, None, Formula]:
    """As `_scaled`, where v does not enter linearly: each component of v is multiplied by its bound."""
    if not bounds.reads.any():
        return velocity, None, bounds
    (count, D), out = bounds.shape, []
    for j in range(count):
        most = bounds.outputs[j * D : (j + 1) * D]

        def put(one: Node, most: Sequence[Node] = most) -> Node | None:
            return make("mul", one, make("abs", most[one.value[0] - 1])) if one.op == "p" and one.value[0] else None

        size = len(velocity.outputs) // count
        out += rebuilt(velocity.outputs[j * size : (j + 1) * size], put)
    return replace(velocity, outputs=tuple(out)), None, _ones(bounds)


def _ones(bounds: Formula) -> Formula:
    return replace(bounds, outputs=(constant(1.0),) * len(bounds.outputs))


@dataclass(frozen=True, eq=False)
class VectorField:
    """The dynamics of a problem, read: `problem.dynamics`.

    Attributes
    ----------
    inputs : (L, m) array
    ndim : int
    drift : Formula (L, ndim), or BlackBox
        Without a disturbance; where that does not enter linearly, a formula that also reads v.
    gain : Formula (L, ndim, D), or BlackBox; None where the disturbance does not enter linearly
    bounds : Formula (L, D)
        Half-widths of the box of v; they do not depend on the state, which scales the gain instead.
    """

    inputs: FloatArray
    ndim: int
    drift: Any
    gain: Any
    bounds: Formula

    @cached_property
    def derived(self) -> dict[Any, Formula]:
        """Formulas that were made from those of the dynamics, by what they are."""
        return {}

    @property
    def parts(self) -> list[Any]:
        return [part for part in (self.drift, self.gain, self.bounds) if part is not None]

    @property
    def formulas(self) -> bool:
        """Whether nothing is a black box."""
        return all(isinstance(part, Formula) for part in self.parts)

    @cached_property
    def constant(self) -> bool:
        """Whether velocities depend on input and disturbance only, and the disturbance moves the state always alike."""
        fixed = self.formulas and all(one.op == "const" for part in self.parts for one in part.outputs)
        return fixed and self.gain is not None and self.alike

    @cached_property
    def arrays(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Drift (L, ndim), gain (ndim, D) and bounds (D,) where they are constant."""
        drift, gain, bounds = (np.array([one.value for one in p.outputs], float).reshape(p.shape) for p in self.parts)
        return drift, gain[0], bounds[0]

    @cached_property
    def stateless(self) -> bool:
        """Whether velocities do not depend on the state."""
        return not self.reads.any()

    @cached_property
    def timed(self) -> bool:
        """Whether velocities depend on time."""
        return any(part.timed for part in self.parts)

    @property
    def adversaries(self) -> int:
        """D, the number of components of the disturbance."""
        return self.bounds.shape[1]

    @cached_property
    def alike(self) -> bool:
        """Whether gain and bounds are the same for every input."""
        if not isinstance(self.gain, Formula):
            return False
        rows = [np.array(part.outputs, object).reshape(len(self.inputs), -1) for part in (self.gain, self.bounds)]
        return all(one is first for part in rows for row in part for one, first in zip(row, part[0], strict=True))

    @cached_property
    def pushes(self) -> FloatArray:
        """Whether a component of the disturbance moves an axis, (L, ndim, D) bool."""
        out = np.ones((len(self.inputs), self.ndim, self.adversaries), np.bool_)
        if isinstance(self.gain, Formula):
            none = [
                np.array([is_constant(o, 0.0) for o in p.outputs], np.bool_).reshape(p.shape)
                for p in (self.gain, self.bounds)
            ]
            out = ~(none[0] | none[1][:, None])
        return out

    @cached_property
    def reads(self) -> FloatArray:
        """Whether the velocity along axis i depends on coordinate k, under any input: (ndim, ndim) bool."""
        out = np.zeros((self.ndim, self.ndim), np.bool_)
        for part, moved in ((self.drift, np.True_), (self.gain, self.pushes[..., None])):
            if isinstance(part, Formula):
                read = part.reads.reshape(len(self.inputs), self.ndim, -1, self.ndim) & moved
                out |= read.any(axis=(0, 2))
            elif part is not None:
                out[:, list(range(self.ndim) if part.reads is None else part.reads)] = True
        return out

    def couples(self, axes: Sequence[int]) -> bool:
        """Whether a component of the disturbance moves several of some axes, so that their velocity set is no box."""
        if self.gain is None:
            return False  # it is bounded by a box
        if self.constant:
            _, gain, bounds = self.arrays
            pushed = np.abs(gain)[list(axes)] * bounds
            moved = pushed > 1e-12 * pushed.max(initial=0.0)  # the rest is rounding, as of a gain that is a rotation
        else:
            moved = self.pushes[:, list(axes)].any(axis=0)
        return bool((np.count_nonzero(moved, axis=0) > 1).any())

    def clipped(self, lower: FloatArray, upper: FloatArray) -> "VectorField":
        """The same dynamics, states past some ends moving as at the end."""
        drift, gain = (part and part.clipped(lower, upper) for part in (self.drift, self.gain))
        return replace(self, drift=drift, gain=gain)

    def on_axes(self, axes: Sequence[int], lower: FloatArray) -> "VectorField":
        """The dynamics of some axes, which read no others; those are taken at `lower` (ndim,)."""
        new = {axis: place for place, axis in enumerate(axes)}

        def put(one: Node) -> Node | None:
            if one.op != "x":
                return None
            return leaf("x", new[one.value[0]]) if one.value[0] in new else constant(float(lower[one.value[0]]))

        def some(part: Any) -> Any:
            if not isinstance(part, Formula):
                return part and _black_box_on(part, axes, lower)
            entries = np.array(part.outputs, dtype=object).reshape(part.shape)[:, list(axes)]
            outputs = tuple(rebuilt(list(entries.flat), put))
            return replace(part, outputs=outputs, shape=entries.shape, coordinates=len(axes))

        bounds = replace(self.bounds, coordinates=len(axes))
        return VectorField(self.inputs, len(axes), some(self.drift), some(self.gain), bounds)

    def undisturbed(self) -> "VectorField":
        """The same without a disturbance."""
        none = replace(self.bounds, outputs=(constant(0.0),) * len(self.bounds.outputs))
        return replace(self, bounds=none)

    @cached_property
    def each(self) -> dict[str, list[Formula]]:
        """The formulas under each input, by name."""
        out = {}
        for name in ("drift", "gain", "bounds"):
            if isinstance(part := getattr(self, name), Formula):
                size = len(part.outputs) // len(self.inputs)
                out[name] = [part.of(range(j * size, (j + 1) * size), part.shape[1:]) for j in range(len(self.inputs))]
        return out

    def component(self, name: str, j: int, place: int) -> Formula:
        """One number of the drift, the gain or the "extremes" under an input."""
        known, key = self.derived, (name, j, place)
        if key not in known:
            known[key] = (self.extremes_of if name == "extremes" else self.each[name])[j].of([place])
        return known[key]

    def drift_at(self, points: Any, j: int, t: Any = 0.0) -> Any:
        """Velocity under input j at points (M, ndim) and time t without a disturbance; shape (M, ndim)."""
        if isinstance(self.drift, BlackBox):
            return self.drift(points, self.inputs[j], t)
        still = [0.0] * (self.drift.parameters - 1)
        return self.each["drift"][j](points, t, *still)

    def gain_at(self, points: Any, j: int = 0, t: Any = 0.0) -> Any:
        """The gain of the disturbance under input j at points (M, ndim) and time t; shape (M, ndim, D).

        Where the disturbance does not enter linearly: how the velocity changes from one end of its box to the other,
        for each component alone.
        """
        if isinstance(self.gain, BlackBox):
            return self.gain(points, self.inputs[j], t)
        if self.gain is not None:
            return self.each["gain"][j](points, t)
        most, columns = self.bounds_at(j, t), []
        for d in range(self.adversaries):
            ends = [self.velocity_at(points, j, s * most * (np.arange(self.adversaries) == d), t) for s in (-1.0, 1.0)]
            columns.append((ends[1] - ends[0]) / (2 * most[d]) if most[d] else 0.0 * ends[0])
        return np.stack(columns, axis=2)

    def velocity_at(self, points: Any, j: int, v: Any, t: Any) -> Any:
        """Velocity under input j and a disturbance v, (D,) or (M, D), at points (M, ndim): (M, ndim)."""
        each = np.broadcast_to(v, (len(points), self.adversaries))
        if self.gain is not None:
            return self.drift_at(points, j, t) + np.einsum("mad,md->ma", self.gain_at(points, j, t), each)
        return self._with_disturbance[j](np.concatenate([points, each], axis=1), t)

    @cached_property
    def _with_disturbance(self) -> list[Formula]:
        """Where v does not enter linearly: velocities with v as further coordinates."""
        ndim, out = self.ndim, []
        for one in self.each["drift"]:
            moved = rebuilt(
                one.outputs, lambda n: leaf("x", ndim + n.value[0] - 1) if n.op == "p" and n.value[0] else None
            )
            out.append(replace(one, outputs=tuple(moved), coordinates=ndim + self.adversaries, parameters=1))
        return out

    def bounds_at(self, j: int = 0, t: float = 0.0) -> FloatArray:
        """Half-widths of the box of disturbances under input j at time t, (D,); ValueError where one is below 0."""
        bounds = self.each["bounds"][j](np.zeros((1, self.ndim)), t)[0]
        if (bounds < 0).any():
            raise ValueError(f"bounds must be half-widths >= 0, got {bounds.tolist()} at t = {t:g}")
        return bounds

    @cached_property
    def extremes_of(self) -> list[Formula]:
        """Under each input the least velocity along each axis over the box of v, and the greatest: (2, ndim)."""
        out = []
        for drift, gain, bounds in zip(self.each["drift"], self.each["gain"], self.each["bounds"], strict=True):
            pushes = np.array(gain.outputs, dtype=object).reshape(gain.shape)
            ends: list[Node] = []
            for op in ("sub", "add"):
                for one, row in zip(drift.outputs, pushes, strict=True):
                    terms = [
                        make("mul", make("abs", a), make("abs", b)) for a, b in zip(row, bounds.outputs, strict=True)
                    ]
                    ends.append(make(op, one, reduce(lambda a, b: make("add", a, b), terms, constant(0.0))))
            out.append(replace(drift, outputs=tuple(ends), shape=(2, self.ndim), name="velocity"))
        return out

    def extremes(self, points: Any, j: int, t: Any) -> Any:
        """Least and greatest velocity along each axis under input j over the box of v, at points: (M, 2, ndim)."""
        if self.gain is None:
            low, high = self.range(j, points, points, (t, t))
            if not (good := np.isfinite(low).all(axis=1)).all():
                raise ValueError(
                    f"velocity under input {j} may be undefined or infinite for some disturbance within its bounds, at "
                    f"{points[int(np.argmin(good))].tolist()}, t = {t:g}; every velocity must be finite"
                )
            return np.stack([low, high], axis=1)
        if self.formulas:
            return self.extremes_of[j](points, t)
        spread = np.abs(self.gain_at(points, j, t)) @ self.bounds_at(j, t)
        drift = self.drift_at(points, j, t)
        return np.stack([drift - spread, drift + spread], axis=1)

    def range(
        self, j: int, low: FloatArray, high: FloatArray, time: tuple[float, float], signs: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Bounds on the velocity under input j in boxes (M, ndim) and an interval of time: both (M, ndim).

        signs : (D,), optional
            The one vertex of its box that the adversary keeps to; by default any disturbance.

        Raises
        ------
        ValueError
            Where a black box does not declare enough.
        """
        if not self.formulas:
            return self._declared(j, low, high, time, signs)
        if self.gain is None:
            v = zip(*self.disturbance(j, low, high, time, signs), strict=True)
            return self.each["drift"][j].bounds(low, high, time, *v)
        if signs is not None:
            return self._at_vertex(j, tuple(signs.tolist())).bounds(low, high, time)
        (least, _), (_, greatest) = np.moveaxis(np.array(self.extremes_of[j].bounds(low, high, time)), 2, 1)
        return least, greatest

    def disturbance(
        self, j: int, low: FloatArray, high: FloatArray, time: tuple[float, float], signs: FloatArray | None = None
    ) -> FloatArray:
        """Least and greatest v in an interval of time, (2, D): the vertex that the adversary keeps to moves with it."""
        ends = np.array(self.each["bounds"][j].bounds(low[:1], high[:1], time))[:, 0]
        if signs is not None:
            return np.sort(signs * ends, axis=0)
        most = np.abs(ends).max(axis=0)
        return np.stack([-most, most])

    def _at_vertex(self, j: int, signs: tuple[float, ...]) -> Formula:
        drift, gain, bounds = (self.each[name][j] for name in ("drift", "gain", "bounds"))
        out = []
        for one, row in zip(drift.outputs, np.array(gain.outputs, dtype=object).reshape(gain.shape), strict=True):
            terms = [
                make("mul", make("mul", a, b), constant(s)) for a, b, s in zip(row, bounds.outputs, signs, strict=True)
            ]
            out.append(reduce(lambda a, b: make("add", a, b), terms, one))
        return replace(drift, outputs=tuple(out))

    def _declared(
        self, j: int, low: FloatArray, high: FloatArray, time: tuple[float, float], signs: FloatArray | None
    ) -> tuple[FloatArray, FloatArray]:
        """As `range`, where drift or gain is a black box: what is declared of each, and intervals of the rest."""
        drift, gain = (self.part_in(name, j, low, high, time) for name in ("drift", "gain"))
        pushes = np.stack([one * v for one in gain for v in self.disturbance(j, low, high, time, signs)])
        least, most = pushes.min(axis=0).sum(axis=2), pushes.max(axis=0).sum(axis=2)
        rounded = 1e-12 * np.abs(pushes).max(axis=0).sum(axis=2)
        return drift[0] + least - rounded, drift[1] + most + rounded

    def part_in(self, name: str, j: int, low: FloatArray, high: FloatArray, time: tuple[float, float]) -> Any:
        """Bounds on drift or gain under input j in boxes (M, ndim) and an interval of time, as of one alone."""
        part = getattr(self, name)
        if isinstance(part, Formula):
            return self.each[name][j].bounds(low, high, time)
        u = self.inputs[j]
        if part.enclosure is not None:
            return [np.asarray(end, dtype=np.float64) for end in part.enclosure(low, high, u, *time)]
        if part.slope is None or (time[0] != time[1] and part.rate is None):
            what = "a slope" if part.slope is None else "a rate"
            raise ValueError(f"{name} is a BlackBox without {what} or an enclosure, which a proof needs")
        value = part((low + high) / 2, u, sum(time) / 2)
        far = (high - low) / 2 @ np.broadcast_to(part.slope, (self.ndim, self.ndim)).T
        far = far + np.broadcast_to(part.rate or 0.0, (self.ndim,)) * ((time[1] - time[0]) / 2)
        far = far * (1 + 1e-9) + 1e-9 * (1.0 + np.abs(value if name == "drift" else value.sum(axis=2)))
        far = far if name == "drift" else far[:, :, None]
        return value - far, value + far


def _called(function: Callable[..., Any], takes: Sequence[str], points: FloatArray, u: FloatArray, t: float) -> Any:
    """What a black box answers, called with what it takes."""
    known = {"points": points, "u": u, "t": t}
    return function(*(known[one] for one in takes))


def _black_box_on(part: BlackBox, axes: Sequence[int], lower: FloatArray) -> BlackBox:
    """A drift or a gain of the axes `axes` alone."""
    keep, function = list(axes), part.function

    def some(points: FloatArray, *others: Any) -> FloatArray:
        full = np.tile(lower, (len(points), 1))
        full[:, keep] = points
        return np.asarray(function(full, *others))[:, keep]

    reads = None if part.reads is None else tuple(keep.index(axis) for axis in part.reads if axis in keep)
    slope = part.slope if part.slope is None else np.broadcast_to(part.slope, (len(lower),) * 2)[np.ix_(keep, keep)]
    return BlackBox(some, reads, slope, part.rate, name=part.name, shape=(len(keep), *part.shape[1:]))


def by_input(inputs: FloatArray) -> Iterator[tuple[int, Any]]:
    """Each input that occurs among some (M,), and the rows where it does."""
    if len(inputs) == 1:
        yield int(inputs[0]), slice(None)
        return
    for j in np.flatnonzero(np.bincount(inputs)).tolist():
        yield j, np.flatnonzero(inputs == j)


@dataclass(frozen=True, eq=False)
class Interval:
    """What an input and the adversary can do from one sampling time to the next.

    Made by `ReachAvoidProblem.interval`. States may have any coordinates on periodic axes.

    Attributes
    ----------
    grid : Grid
    dynamics : VectorField
    begin, delta : float
        When it begins and how long it lasts, s.
    early, wider : float, (ndim,)
        How much sooner the adversary may end it, s; by how much boxes of what is reachable are widened.
    """

    grid: Grid
    dynamics: VectorField
    begin: float
    delta: float
    early: float = 0.0
    wider: FloatArray | float = 0.0

    @property
    def end(self) -> float:
        return self.begin + self.delta

    # ---- of single states: the controller, the adversaries, the plant

    def drift(self, states: Any, j: int, t: Any) -> Any:
        """Velocity of states (M, ndim) under input j without the adversary: (M, ndim)."""
        return self.dynamics.drift_at(self.grid.wrapped(states), j, t)

    def gain(self, states: FloatArray, inputs: FloatArray, t: float) -> FloatArray:
        """What the adversary's box adds to the velocity of each state (M, ndim) under its own input, (M, ndim, D)."""
        points = self.grid.wrapped(states)
        if self.dynamics.alike:
            return self.dynamics.gain_at(points, 0, t)
        gain = np.empty((*states.shape, self.dynamics.adversaries))
        for j, rows in by_input(inputs):
            gain[rows] = self.dynamics.gain_at(points[rows], j, t)
        return gain

    def bounds(self, inputs: FloatArray, t: float) -> FloatArray:
        """Half-widths of the adversary's box for each of the inputs (M,) held: (M, D)."""
        if self.dynamics.alike:
            return np.broadcast_to(self.dynamics.bounds_at(0, t), (len(inputs), self.dynamics.adversaries))
        table = np.stack([self.dynamics.bounds_at(j, t) for j in range(len(self.dynamics.inputs))])
        return table[inputs]

    def undisturbed(self, states: FloatArray, inputs: FloatArray, t: float) -> FloatArray:
        """Velocity of each state (M, ndim) under its own input, given by its index (M,), no adversary: (M, ndim)."""
        if self.dynamics.constant:
            return self.dynamics.arrays[0][inputs]
        velocity = np.empty_like(states)
        for j, rows in by_input(inputs):
            velocity[rows] = self.drift(states[rows], j, t)
        return velocity

    def advance(
        self, states: FloatArray, inputs: FloatArray, v: FloatArray, t: float, duration: float, *, walls: bool = True
    ) -> FloatArray:
        """States `duration` s after t under held inputs (M,) and v (M, D), clipped at the walls of the grid.

        Exact for constant velocities, else one Runge-Kutta step of order 4. walls=False lets them through.
        """

        if self.dynamics.constant:
            moved = states + duration * (self.dynamics.arrays[0][inputs] + v @ self.dynamics.arrays[1].T)
            return self.grid.clipped(moved) if walls else moved
        out, whole = np.empty_like(states), np.concatenate([states, v], axis=1)
        for j, rows in by_input(inputs):
            if self.dynamics.formulas:
                out[rows] = self._steps_formula(j, walls)(whole[rows], t, duration)
            else:
                out[rows] = self._runge_kutta(whole[rows], j, walls, t, duration)
        return out

    def _runge_kutta(self, whole: Any, j: int, walls: bool, t: Any, duration: Any) -> Any:
        """States and disturbances side by side, (M, ndim + D), to states a step later."""
        states, v = whole[:, : self.grid.ndim], whole[:, self.grid.ndim :]

        def velocity(q: Any, now: Any) -> Any:
            return self.dynamics.velocity_at(self.grid.wrapped(q), j, v, now)

        def moved(span: Any, slope: Any) -> Any:
            return self.grid.clipped(states + span * slope) if walls else states + span * slope

        k1 = velocity(states, t)
        k2 = velocity(moved(duration / 2, k1), t + duration / 2)
        k3 = velocity(moved(duration / 2, k2), t + duration / 2)
        k4 = velocity(moved(duration, k3), t + duration)
        return moved(duration, (k1 + 2 * k2 + 2 * k3 + k4) / 6)

    def _steps_formula(self, j: int, walls: bool) -> Formula:
        """`_runge_kutta`, read: one tape for a step."""
        known, grid = self.dynamics.derived, self.grid
        key = j, walls, grid.lower, grid.upper, grid.periodic, grid.ends
        if key not in known:
            count = grid.ndim + self.dynamics.adversaries
            found = self._runge_kutta(points_of(count, 1), j, walls, parameter(0), parameter(1))
            known[key] = Formula(tuple(found.entries.flat), count, 2, (grid.ndim,), "where the state moves to")
        return known[key]

    def displacements(self, states: FloatArray) -> FloatArray:
        """Where every input takes each state (M, ndim) in the interval without an adversary, relative to it.

        Shape (M, L, ndim), or (1, L, ndim) where it is the same for all states. Exact for a constant drift, else by the
        midpoint rule.
        """
        if self.dynamics.constant:
            return self.delta * self.dynamics.arrays[0][None]
        if isinstance(self.dynamics.drift, Formula):
            return self._as_formula("_displaced", (len(self.dynamics.inputs), self.grid.ndim))(states, self.begin)
        return self._displaced(states, self.begin)

    def _displaced(self, states: Any, begin: Any) -> Any:
        moves = []
        for j in range(len(self.dynamics.inputs)):
            halfway = self.grid.clipped(states + self.delta / 2 * self.drift(states, j, begin))
            moves.append(self.delta * self.drift(halfway, j, begin + self.delta / 2))
        return np.stack(moves, axis=1)

    def _as_formula(self, name: str, shape: tuple[int, ...]) -> Formula:
        """A method of states and the begin, read: one tape for all inputs, which share what is common to them."""
        known = self.dynamics.derived
        key = name, self.delta, self.grid.lower, self.grid.upper, self.grid.periodic, self.grid.ends
        if key not in known:
            found = getattr(self, name)(points_of(self.grid.ndim, 1), parameter(0))
            known[key] = Formula(tuple(found.entries.flat), self.grid.ndim, 1, shape, "where the state moves to")
        return known[key]

    def path(self, states: FloatArray, inputs: FloatArray, parts: int) -> FloatArray:
        """Where each state (M, ndim) is under its own input (M,) after 1, ..., `parts` parts, without an adversary.

        Shape (M, parts, ndim); held at walls. Exact for a constant drift, else to second order.
        """
        shares, slope = np.arange(1, parts + 1)[:, None] / parts, self.undisturbed(states, inputs, self.begin)
        moved = self.delta * slope
        bent = 0.0 * moved
        if not self.dynamics.constant:
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
        if dynamics.formulas and dynamics.gain is not None:
            shape = 2, len(dynamics.inputs), self.grid.ndim
            ends = self._as_formula("_reach_of", shape)(states, self.begin)
        else:
            ends = self._reach_of(states, self.begin)
        return ends[:, 0] - self.wider, ends[:, 1] + self.wider

    def _reach_of(self, states: Any, begin: Any) -> Any:
        """Lower and upper corners of `reachable`, (M, 2, L, ndim)."""
        dynamics, centre, points = self.dynamics, self._displaced(states, begin), self.grid.wrapped(states)
        times = [begin] if not dynamics.timed else [begin, begin + self.delta / 2, begin + self.delta]
        lows, highs = [], []
        for j in range(len(dynamics.inputs)):
            drift, ends = dynamics.drift_at(points, j, begin), [dynamics.extremes(points, j, t) for t in times]
            middle = [drift if t is begin else dynamics.drift_at(points, j, t) for t in times]
            lows.append(reduce(np.maximum, [one - end[:, 0] for one, end in zip(middle, ends, strict=True)]))
            highs.append(reduce(np.maximum, [end[:, 1] - one for one, end in zip(middle, ends, strict=True)]))
        below, above = (self.delta * np.stack(one, axis=1) for one in (lows, highs))
        return np.stack([centre - below, centre + above], axis=1)

    # ---- of velocities that do not depend on the state: the Hopf-Lax formula

    def extremes(self, t: float) -> FloatArray:
        """The least and the greatest velocity along each axis under each input at time t: (2, L, ndim)."""
        nothing = np.zeros((1, self.grid.ndim))
        each = [self.dynamics.extremes(nothing, j, t)[0] for j in range(len(self.dynamics.inputs))]
        return np.stack(each, axis=1)

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
        return 8 * self.grid.ndim * (self.dynamics.adversaries + 6) * self.grid.size

    def _sampled(self, formula: Formula, seen: Sequence[int], t: float) -> FloatArray:
        """A formula of one result at the nodes, on the axes that it reads; broadcastable over the subgrid of `seen`."""
        own = [axis for axis in seen if formula.reads[0, axis]]
        if not own:
            return formula(np.array([self.grid.lower]), t).reshape((1,) * len(seen))
        grid, some = self.grid.subgrid(own), formula.restricted(own)
        values = np.concatenate([some(piece.points(), t) for piece in grid.pieces()]).reshape(grid.shape)
        return self.grid.subgrid(seen).lift(values, [seen.index(axis) for axis in own])

    def ends_at_nodes(self, j: int, t: float) -> tuple[list[FloatArray], list[FloatArray]]:
        """The least and the greatest velocity along each axis under u_j, each on the axes that it reads: (*shape)."""
        dynamics, everything, ndim = self.dynamics, list(range(self.grid.ndim)), self.grid.ndim
        if dynamics.formulas and dynamics.gain is not None:
            found = [self._sampled(dynamics.component("extremes", j, row), everything, t) for row in range(2 * ndim)]
            return found[:ndim], found[ndim:]
        pieces = [dynamics.extremes(piece.points(), j, t) for piece in self.grid.pieces()]
        least, greatest = np.moveaxis(np.concatenate(pieces), 0, 2).reshape(2, ndim, *self.grid.shape)
        return list(least), list(greatest)

    @cached_property
    def speeds(self) -> FloatArray:
        """The greatest speed along each axis at the nodes, whatever the input and the adversary; (ndim,)."""
        instants = self.begin + self.delta * (INSTANTS[::4] if self.dynamics.timed else INSTANTS[:1])
        ends = [self.ends_at_nodes(j, t) for j, t in product(range(len(self.dynamics.inputs)), instants.tolist())]
        return np.max([[max(-low.min(), high.max()) for low, high in zip(*pair, strict=True)] for pair in ends], axis=0)

    def on(self, grid: Grid) -> "Interval":
        """The interval on a window of its grid, where what is said of the whole grid stays as it is there."""
        part = replace(self, grid=grid)
        part.__dict__["speeds"] = self.speeds
        return part

    def closed(self, axes: Sequence[int]) -> tuple[int, ...]:
        """The smallest set of axes that holds `axes` and whose velocities depend on no other coordinate."""
        known = set(axes)
        while grown := {int(k) for i in known for k in np.flatnonzero(self.dynamics.reads[i])} - known:
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
        key = j, tuple(axes), t, drift
        if key not in self._known:
            found = self._velocities(j, list(axes), t, drift)
            if not self.dynamics.timed or found.nbytes * KNOWN_AT_MOST > KNOWN_BYTES:
                return found  # the games keep what is the same at all times
            if len(self._known) >= KNOWN_AT_MOST:
                self._known.clear()
            self._known[key] = found.kept()
        return self._known[key]

    @cached_property
    def _known(self) -> dict[Any, Velocities]:
        """Velocities at some times, which each number of steps to go asks for again."""
        return {}

    def _velocities(self, j: int, axes: list[int], t: float, drift: bool) -> Velocities:
        dynamics = self.dynamics
        if dynamics.stateless and dynamics.gain is not None:
            nothing = np.zeros((1, self.grid.ndim))
            f = dynamics.drift_at(nothing, j, t)[:, axes] * drift
            b = dynamics.gain_at(nothing, j, t)[:, axes] * dynamics.bounds_at(j, t)
        elif (box := self._hull(j, axes, t)) is not None:
            return box
        elif dynamics.gain is None:
            return self._ranges(j, axes, t)
        else:
            f, b = self._modes(j, axes, t)
        spread = np.abs(b).sum(axis=2)
        lower, upper = f - spread, f + spread
        hull = lower.min(axis=0), upper.max(axis=0)
        swayed = [((lower[:, i] != hull[0][i]) | (upper[:, i] != hull[1][i])).any() for i in range(len(axes))]
        coupled = (np.count_nonzero(dynamics.pushes[j][axes], axis=0) > 1).any()
        return Velocities(*hull) if sum(swayed) <= 1 and not coupled else Velocities(*hull, drift=f, gain=b)

    def _seen(self, axes: list[int]) -> tuple[list[int], tuple[int, ...]]:
        """Some axes and those that their velocities read, ascending; the places among them of the latter alone."""
        seen = sorted({*axes, *np.flatnonzero(self.dynamics.reads[axes].any(axis=0)).tolist()})
        return seen, tuple(place for place, axis in enumerate(seen) if axis not in axes)

    def _hull(self, j: int, axes: list[int], t: float) -> Velocities | None:
        """The velocity set where it is a box, each end sampled on the axes that it reads; None where it is none."""
        dynamics, (seen, outside) = self.dynamics, self._seen(axes)
        if not dynamics.formulas or dynamics.gain is None:
            return None
        if (np.count_nonzero(dynamics.pushes[j][axes], axis=0) > 1).any():
            return None
        dynamics.bounds_at(j, t)  # refuses what is below 0
        ends: tuple[list[FloatArray], list[FloatArray]] = ([], [])
        swayed = 0
        for axis in axes:
            low, high = (
                self._sampled(dynamics.component("extremes", j, axis + side), seen, t) for side in (0, self.grid.ndim)
            )
            hull = low.min(axis=outside, keepdims=True), high.max(axis=outside, keepdims=True)
            swayed += bool((low != hull[0]).any() or (high != hull[1]).any())
            for end, one in zip(ends, hull, strict=True):
                end.append(one.reshape([n for place, n in enumerate(one.shape) if place not in outside]))
        return Velocities(*ends, shape=self.grid.subgrid(axes).shape) if swayed <= 1 else None

    def _points(self, seen: list[int]) -> FloatArray:
        """States (M, ndim) at the nodes of some axes, at the lower ends of the others."""
        grid = self.grid.subgrid(seen)
        points = np.tile(np.array(self.grid.lower), (grid.size, 1))
        points[:, seen] = grid.points()
        return points

    def _ranges(self, j: int, axes: list[int], t: float) -> Velocities:
        """The box of velocities where the disturbance does not enter linearly."""
        seen, outside = self._seen(axes)
        points, shape = self._points(seen), self.grid.subgrid(seen).shape
        low, high = (end[:, axes].T.reshape(-1, *shape) for end in self.dynamics.range(j, points, points, (t, t)))
        places = tuple(1 + place for place in outside)
        return Velocities(low.min(axis=places), high.max(axis=places))

    def _modes(self, j: int, axes: list[int], t: float) -> tuple[FloatArray, FloatArray]:
        """Drift (modes, axes, *subgrid) and gain times bounds (modes, axes, D, *subgrid) at time t."""
        dynamics, (seen, outside) = self.dynamics, self._seen(axes)
        grid, count = self.grid.subgrid(seen), dynamics.adversaries
        require(8 * len(axes) * grid.size * (count + 3), "sampling the velocities")
        sampled = np.zeros((len(axes), 1 + count, *grid.shape))
        if dynamics.formulas:
            self._fill(sampled, j, axes, seen, t)
        else:
            points = self._points(seen)
            gain = dynamics.gain_at(points, j, t)[:, axes] * dynamics.bounds_at(j, t)
            parts = np.concatenate([dynamics.drift_at(points, j, t)[:, axes, None], gain], axis=2)
            sampled = np.moveaxis(parts, 0, 2).reshape(sampled.shape)
        sampled = np.moveaxis(sampled, [2 + place for place in outside], range(len(outside)))
        sampled = sampled.reshape(-1, *sampled.shape[len(outside) :])
        return sampled[:, :, 0], sampled[:, :, 1:]

    def _fill(self, sampled: FloatArray, j: int, axes: list[int], seen: list[int], t: float) -> None:
        """Write drift and gain times bounds of some axes, each sampled on the axes that it reads."""
        dynamics, bounds = self.dynamics, self.dynamics.bounds_at(j, t)
        for row, axis in enumerate(axes):
            sampled[row, 0] = self._sampled(dynamics.component("drift", j, axis), seen, t)
            for d in np.flatnonzero(dynamics.pushes[j, axis]):
                place = axis * dynamics.adversaries + int(d)
                sampled[row, 1 + d] = bounds[d] * self._sampled(dynamics.component("gain", j, place), seen, t)

    def velocity_field(
        self, j: int, axes: Sequence[int], *, drift: bool = True
    ) -> Velocities | Callable[[float], Velocities]:
        """The velocity set as `schemes.evolve` reads it: itself or, where it depends on time, as a function of tau.

        tau is counted back from the interval's end.
        """
        if self.dynamics.timed:
            return lambda tau: self.velocities(j, axes, self.end - tau, drift=drift)
        return self.velocities(j, axes, drift=drift)
