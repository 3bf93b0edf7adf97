"""The velocity of the state under each input and disturbance, as formulas or black boxes, by `Dynamics.read`."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise, product
from typing import Any

import numpy as np

from sdhj.common.remembering import FloatArray, Remembering, kept, read_only
from sdhj.formulas.formula import BlackBox, Ends, Formula
from sdhj.formulas.graph import Node, constant, leaf, leaves, make, rebuilt

CUTS = 8  # of the range of a component of v that does not enter linearly
AT_ONCE = 1 << 20  # points and pieces whose velocities are bounded together
Times = tuple[float, float]


def constant_formula(name: str, array: FloatArray, ndim: int) -> Formula:
    """A formula of `ndim` coordinates and the time that has an array's numbers as its results at every point."""
    return Formula(tuple(map(constant, array.ravel().tolist())), ndim, 1, array.shape, name)


@dataclass(frozen=True, eq=False)
class VectorField(Remembering):
    """The dynamics of a problem as formulas or black boxes: `problem.dynamics`.

    Coordinates on periodic axes must be wrapped into the grid.
    """

    inputs: FloatArray  # (L, m), the input vectors u_j
    ndim: int  # coordinates of the state
    drift: Formula | BlackBox  # (L, ndim) without v; where v does not enter linearly, a Formula that also reads v
    gain: Formula | BlackBox | None  # (L, ndim, D); None where v does not enter linearly
    bounds: Formula  # (L, D), half-widths of the box of v, whatever the state, which scales the gain instead
    pieces: int = CUTS  # as in `Dynamics`

    @property
    def parts(self) -> list[Any]:
        """[drift, gain, bounds], formulas or black boxes, without a gain that is None."""
        return [part for part in (self.drift, self.gain, self.bounds) if part is not None]

    @cached_property
    def formulas(self) -> bool:
        """Whether none of `parts` is a black box."""
        return all(isinstance(part, Formula) for part in self.parts)

    @cached_property
    def constant(self) -> bool:
        """Whether velocities are drift_j + gain v with constants, of which only the drift depends on the input."""
        fixed = self.formulas and all(one.op == "const" for part in self.parts for one in part.outputs)
        return fixed and self.gain is not None and self.shared_gain

    @kept
    def arrays(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Drift (L, ndim), gain (ndim, D) and bounds (D,), where the dynamics are `constant`."""
        drift, gain, bounds = (np.array([one.value for one in p.outputs], float).reshape(p.shape) for p in self.parts)
        return drift, gain[0], bounds[0]

    @cached_property
    def stateless(self) -> bool:
        """Whether velocities do not depend on the state, under any input."""
        return not self.reads.any()

    @cached_property
    def depends_on_time(self) -> bool:
        """Whether drift, gain or bounds depend on time."""
        return any(part.depends_on_time for part in self.parts)

    @property
    def disturbance_dim(self) -> int:
        """D, the number of components of v; at least 1."""
        return self.bounds.shape[1]

    @cached_property
    def shared_gain(self) -> bool:
        """Whether gain and bounds are the same formulas for every input."""
        parts = (self.gain, self.bounds)
        return all(isinstance(part, Formula) and bool((part.entries == part.entries[0]).all()) for part in parts)

    @kept
    def pushes(self) -> FloatArray:
        """Whether component d of v may move axis i under input j: (L, ndim, D)."""
        if not isinstance(self.gain, Formula):
            return np.ones((len(self.inputs), self.ndim, self.disturbance_dim), np.bool_)
        zero = constant(0.0)
        return ((self.gain.entries != zero) & (self.bounds.entries != zero)[:, None]).astype(np.bool_)

    @kept
    def reads(self) -> FloatArray:
        """Whether the velocity along axis i may depend on coordinate k: (ndim, ndim)."""
        # a False has to be sure: games leave such an axis out, and cells that lie apart along it share one place
        out = np.zeros((self.ndim, self.ndim), np.bool_)
        for part, moved in ((self.drift, np.True_), (self.gain, self.pushes[..., None])):
            if isinstance(part, Formula):
                # entries of the gain with which v does not push do not count
                read = part.reads.reshape(len(self.inputs), self.ndim, -1, self.ndim) & moved
                out |= read.any(axis=(0, 2))
            elif part is not None:
                out[:, list(range(self.ndim) if part.reads is None else part.reads)] = True
        return out

    def couples(self, axes: Sequence[int]) -> bool:
        """Whether a component of v, entering linearly, moves several of these axes: their velocity set is no box."""
        moved = self.pushes[:, list(axes)].any(axis=0)
        if self.constant:
            pushed = np.abs(self.arrays[1])[list(axes)] * self.arrays[2]
            moved = pushed > 1e-12 * pushed.max(initial=0.0)  # the rest is rounding, as of a gain that is a rotation
        return self.gain is not None and bool((np.count_nonzero(moved, axis=0) > 1).any())

    def pieces_of_components(self, axes: Sequence[int]) -> tuple[int, ...]:
        """Into how many pieces the range of each component of v is cut, (D,); the velocity set is a union of boxes."""
        if self.gain is not None:
            return (1,) * self.disturbance_dim
        several = (self._moved[:, list(axes)].sum(axis=1) > 1).any(axis=0)
        return tuple(np.where(several, self.pieces, 1).tolist())

    @cached_property
    def _moved(self) -> FloatArray:
        """Whether component d of v moves axis i under input j, where v does not enter linearly: (L, ndim, D)."""
        each = [[leaves([one], "p") for one in row.outputs] for row in self.functions_by_input["drift"]]
        return np.array([[[1 + d in one for d in range(self.disturbance_dim)] for one in row] for row in each])

    @property
    def is_cut(self) -> bool:
        """Whether `pieces` matters: v does not enter linearly, and a component of it moves more than one axis."""
        return self.gain is None and bool((self._moved.sum(axis=1) > 1).any())

    @cached_property
    def oblique(self) -> tuple[int, ...]:
        """The components d of v that move several axes, each of which adds a segment to the velocity set."""
        if (
            self.gain is None
            or not self.couples(range(self.ndim))
            or self.gain.depends_on_time
            or self.bounds.depends_on_time
        ):
            return ()
        moved = self.pushes
        if self.constant:
            pushed = np.abs(self.arrays[1]) * self.arrays[2]
            # as in `couples`, and as by `ROUNDING` in `Interval.segments`: what one drops the others have to drop
            moved = (pushed > 1e-12 * pushed.max(initial=0.0))[None]
        # in this order `Interval.displacement_sets` has their segments
        return tuple(np.flatnonzero((moved.sum(axis=1) > 1).any(axis=0)).tolist())

    def clipped(self, lower: FloatArray, upper: FloatArray) -> "VectorField":
        """The dynamics with states clipped to [lower, upper]: past an end states move as at the end."""
        gain = self.gain and self.gain.clipped(lower, upper)
        return replace(self, drift=self.drift.clipped(lower, upper), gain=gain)

    def past_ends(self, axes: Sequence[int], lower: Sequence[float], upper: Sequence[float]) -> "VectorField":
        """The dynamics of some axes, numbered anew, past the ends as at the ends.

        The other coordinates, at `lower`, must not matter to these: `Interval.self_contained` has such axes.
        """
        keep = list(axes)

        def full(points: FloatArray) -> FloatArray:
            out = np.tile(np.array(lower), (len(points), 1))
            out[:, keep] = points
            return np.clip(out, lower, upper)

        put = {leaf("x", k): constant(lower[k]) for k in range(self.ndim)}
        for place, k in enumerate(keep):
            inner = make("max", leaf("x", place), constant(lower[k]))
            put[leaf("x", k)] = make("min", inner, constant(upper[k]))

        def some(part: Any) -> Any:
            if part is None:
                return None
            if isinstance(part, Formula):
                entries = part.entries.take(keep, axis=1)
                outputs = tuple(rebuilt(entries.ravel().tolist(), put.get))
                return Formula(outputs, len(keep), part.parameters, entries.shape, part.name)

            def of_some(points: Any, *given: Any) -> Any:
                return part.function(full(points), *given).take(keep, 1)

            reads = part.reads and tuple(keep.index(axis) for axis in part.reads if axis in keep)
            slope = None if part.slope is None else np.broadcast_to(part.slope, (self.ndim,) * 2)[np.ix_(keep, keep)]
            shape = (len(keep), *part.shape[1:])
            # an enclosure is of all axes
            return replace(part, function=of_some, reads=reads, slope=slope, enclosure=None, shape=shape)

        bounds = replace(self.bounds, coordinates=len(keep))
        return VectorField(self.inputs, len(keep), some(self.drift), some(self.gain), bounds, self.pieces)

    def undisturbed(self) -> "VectorField":
        """The same dynamics, in which v has bounds 0."""
        return replace(self, bounds=constant_formula("bounds", np.zeros(self.bounds.shape), self.ndim))

    @kept
    def functions_by_input(self) -> dict[str, list[Any]]:
        """{"drift": [of input 0, of input 1, ...], "gain": ..., "bounds": ...}: (ndim,), (ndim, D) and (D,)."""
        # without a gain the drift is the whole velocity, with v as parameters after the time
        parts = [(name, part) for name in ("drift", "gain", "bounds") if (part := getattr(self, name)) is not None]
        rows = [list(one.rows) if isinstance(one, Formula) else list(map(one.under, self.inputs)) for _, one in parts]
        return dict(zip((name for name, _ in parts), rows, strict=True))

    def component(self, name: str, j: int, index: int) -> Formula:
        """Number `index` of the flattened "drift", "gain" or "extremes" under input j, as a formula."""
        found = (self.extremes_of if name == "extremes" else self.functions_by_input[name])[j]
        one = found.outputs[index]  # the same object under inputs that share it, as a speed does with several turns
        return self.remembered((name, one), lambda: replace(found, outputs=(one,), shape=()))

    def drift_at(self, points: Any, j: int, t: Any = 0.0) -> Any:
        """Velocity under input j with v = 0, at points (M, ndim) and time t, s, also traced: (M, ndim)."""
        still = [0.0] * self.disturbance_dim if self.gain is None else []
        return self.functions_by_input["drift"][j](points, t, *still)

    def gain_at(self, points: Any, j: int = 0, t: Any = 0.0) -> Any:
        """The gain of v under input j at points (M, ndim) and time t, s: (M, ndim, D)."""
        if self.gain is not None:
            return self.functions_by_input["gain"][j](points, t)
        # The mean slope over the range of each component, the others being 0. Adversaries, records and warnings ask: no
        # game and no proof goes by it.
        most, columns = self.bounds_at(j, t), []
        for d in range(self.disturbance_dim):
            ends = [
                self.velocity_at(points, j, s * most * (np.arange(self.disturbance_dim) == d), t) for s in (-1.0, 1.0)
            ]
            columns.append((ends[1] - ends[0]) / (2 * most[d]) if most[d] else 0.0 * ends[0])
        return np.stack(columns, axis=2)

    def velocity_at(self, points: Any, j: int, v: Any, t: Any) -> Any:
        """Velocity under input j and v, (D,) or (M, D), at points (M, ndim) and time t, also traced: (M, ndim)."""
        each = np.broadcast_to(v, (len(points), self.disturbance_dim))
        if self.gain is not None:
            return self.drift_at(points, j, t) + np.einsum("mad,md->ma", self.gain_at(points, j, t), each)
        return self._with_disturbance[j](np.concatenate([points, each], axis=1), t)

    @cached_property
    def _with_disturbance(self) -> list[Formula]:
        """The velocity under each input as a formula of state, v and time, where v does not enter linearly."""
        ndim, count = self.ndim, self.ndim + self.disturbance_dim

        def velocity(one: Formula, points: Any, t: Any) -> Any:
            return one(points[:, :ndim], t, *points[0, ndim:])  # of one point

        return [Formula.traced("velocity", partial(velocity, one), count) for one in self.functions_by_input["drift"]]

    def bounds_at(self, j: int = 0, t: float = 0.0) -> FloatArray:
        """Half-widths of the box of v under input j at time t, (D,), new; ValueError where one is below 0."""
        known: dict[int, FloatArray] = self.remembered("bounds", dict)
        if j in known:
            return known[j].copy()
        # at one state, as bounds depend on none: `Dynamics.read` puts such into the gain
        bounds = self.functions_by_input["bounds"][j](np.zeros((1, self.ndim)), t)[0]
        if (bounds < 0).any():
            raise ValueError(f"bounds must be half-widths >= 0, got {bounds.tolist()} at t = {t:g}")
        if not self.bounds.depends_on_time:
            known[j] = read_only(bounds.copy())
        return bounds

    @cached_property
    def extremes_of(self) -> tuple[Formula, ...]:
        """For each input a formula of the extremes over v, drift -+ sum_d |gain_d| |bounds_d|: (2, ndim)."""
        found, parts = [], self.functions_by_input  # all formulas, and v enters linearly
        for drift, gain, bounds in zip(parts["drift"], parts["gain"], parts["bounds"], strict=True):
            most = [make("abs", one) for one in bounds.outputs]
            ends = list[Node](), list[Node]()
            for f, row in zip(drift.outputs, gain.entries, strict=True):
                spread = sum((make("abs", b) * v for b, v in zip(row, most, strict=True)), constant(0.0))
                ends[0].append(f - spread)
                ends[1].append(f + spread)
            found.append(Formula((*ends[0], *ends[1]), self.ndim, 1, (2, self.ndim), "velocity"))
        return tuple(found)

    def _spread(self, j: int, points: Any, t: Any) -> Any:
        """As `extremes_of`, of black boxes: drift -+ sum_d |gain_d| |bounds_d| at points (M, ndim), (M, 2, ndim)."""
        drift, bounds = self.drift_at(points, j, t), self.functions_by_input["bounds"][j](points, t)
        spread = (np.abs(self.gain_at(points, j, t)) * np.abs(bounds)[:, None]).sum(axis=2)
        return np.stack([drift - spread, drift + spread], axis=1)

    def extremes(self, points: Any, j: int, t: Any) -> Any:
        """Least and greatest velocity on each axis under input j over v, or bounds: (M, 2, ndim)."""
        if self.gain is None:  # by intervals, perhaps wider
            low, high = self.velocity_bounds(j, points, points, (t, t))
            if not (good := np.isfinite(low).all(axis=1)).all():
                raise ValueError(
                    f"velocity under input {j} may be undefined or infinite for some disturbance within its bounds, at "
                    f"{points[int(np.argmin(good))].tolist()}, t = {t:g}; every velocity must be finite"
                )
            return np.stack([low, high], axis=1)
        return self.extremes_of[j](points, t) if self.formulas else self._spread(j, points, t)

    def velocity_bounds(self, j: int, low: FloatArray, high: FloatArray, time: Times) -> Ends:
        """Bounds (M, ndim) of the velocity under input j over boxes and `time`; -+inf if undefined."""
        # the checker has its own (`velocity` in `sdhj.certified.check.stated`): what holds by narrower ones it refuses
        if not self.formulas:
            return self._declared(j, low, high, time)
        if self.gain is None:
            v = zip(*self.disturbance_bounds(j, low, high, time), strict=True)
            return self.functions_by_input["drift"][j].bounds(low, high, time, *v)
        least, greatest = self.extremes_of[j].bounds(low, high, time)
        return least[:, 0], greatest[:, 1]

    def greatest_along(self, points: FloatArray, j: int, t: float, directions: FloatArray) -> FloatArray:
        """An upper bound on n @ velocity over v, which is cut, for directions n (K, ndim), at points: (M, K)."""
        ends = self.disturbance_bounds(j, points[:1], points[:1], (t, t))
        edges = [
            np.linspace(a, b, cut + 1)
            for a, b, cut in zip(*ends, self.pieces_of_components(range(self.ndim)), strict=True)
        ]
        pieces, found = np.array([*product(*map(pairwise, edges))]), np.full((len(points), len(directions)), -np.inf)
        for v in np.array_split(pieces, 1 + len(points) * len(pieces) // AT_ONCE):
            states = np.repeat(points, len(v), 0)
            low, high = (np.hstack([states, np.tile(v[..., i], (len(points), 1))]) for i in (0, 1))
            least, most = self._with_disturbance[j].bounds(low, high, (t, t))
            reach = (least + most) / 2 @ directions.T + (most - least) / 2 @ np.abs(directions).T
            found = np.maximum(found, reach.reshape(len(points), len(v), -1).max(axis=1))
        if not np.isfinite(found).all():
            self.extremes(points, j, t)  # says what is wrong
        return found

    def disturbance_bounds(self, j: int, low: FloatArray, high: FloatArray, time: Times) -> FloatArray:
        """Least and greatest v under input j in an interval, s: -+ the greatest half-widths, (2, D)."""
        # bounds depend on no state, so any box does
        ends = np.array(self.functions_by_input["bounds"][j].bounds(low[:1], high[:1], time))[:, 0]
        most = np.abs(ends).max(axis=0)
        return np.stack([-most, most])

    def _declared(self, j: int, low: FloatArray, high: FloatArray, time: Times) -> Ends:
        """As `velocity_bounds`, where drift or gain is a black box: by what is declared, rounded outward."""
        drift, gain = (self.functions_by_input[name][j].bounds(low, high, time) for name in ("drift", "gain"))
        pushes = np.stack([one * v for one in gain for v in self.disturbance_bounds(j, low, high, time)])
        least, most = pushes.min(axis=0).sum(axis=2), pushes.max(axis=0).sum(axis=2)
        rounded = 1e-12 * np.abs(pushes).max(axis=0).sum(axis=2)
        return drift[0] + least - rounded, drift[1] + most + rounded
