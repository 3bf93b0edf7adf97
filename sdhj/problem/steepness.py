"""How much velocities differ between two states, from the derivatives of their formulas: A and b of `sensing`."""

from collections.abc import Iterable
from itertools import pairwise, product

import numpy as np

from sdhj.common.remembering import FloatArray
from sdhj.formulas.derivative import derivative
from sdhj.formulas.formula import BlackBox, Ends, Formula
from sdhj.formulas.graph import Node, constant, leaf, make, rebuilt
from sdhj.problem.grid import Grid
from sdhj.problem.vector_field import VectorField

BEGINNING_BOXES = 4096  # boxes that a search for the greatest value begins with
HALVED = 1024  # of them at a time, those with the greatest bounds
ROUNDS_OF_HALVING = 30
SETTLED_WITHIN = 1 + 1e-3  # the bound is at most this times a value that is taken: the search ends
TERMS = 60  # of an exponential series
SAME = 1e-9  # relative difference of velocities at both ends of a periodic axis that is no jump


def lipschitz_bounds(
    grid: Grid, dynamics: VectorField, end: float, delta: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Bounds A (ndim, ndim), b (ndim,) and jumps (ndim,) on how much the velocities of two states may differ.

    |dq1/dt - dq2/dt| <= A |q1 - q2| + b + jumps, axis by axis, for any two states on the grid under the same input at
    the same time up to `end`, s, of which one is disturbed. A_ik >= |d velocity_i / d q_k|, 1/s; b is the most that the
    disturbance adds, per second.
    """
    # Differences between nodes would take a jump J for a slope J / h, and so let velocities at both sides of it, w < h
    # apart, differ by J w / h only. With `jumps` the bound is never too low; where it is too high, nothing is left of
    # the target, and a solve says so.
    ndim, D = grid.ndim, dynamics.disturbance_dim
    # ends of what `_velocities` reads: the state, the time, and components of v as shares of their bounds
    low, high = np.array([*grid.lower, 0.0, *[-1.0] * D]), np.array([*grid.upper, end, *[1.0] * D])
    slope, push, jumps = np.zeros((ndim, ndim)), np.zeros(ndim), np.zeros(ndim)
    pushed = [leaf("x", ndim + 1 + d) for d in range(D)]
    for axis, nodes in enumerate(zip(*_velocities(dynamics), strict=True)):
        each = dict.fromkeys(nodes)  # inputs that differ by a number have the same derivatives
        slope[axis] = [greatest(derivative(list(each), leaf("x", k)), low, high) for k in range(ndim)]
        by_v = [[make("abs", one) for one in derivative(list(each), v)] for v in pushed]
        push[axis] = greatest([sum(terms, constant(0.0)) for terms in zip(*by_v, strict=True)], low, high)
        if dynamics.gain is None:  # the prediction is for v = 0
            calm = rebuilt(list(each), lambda one: constant(0.0) if one in pushed else None)
            moved = [make("sub", *pair) for pair in zip(each, calm, strict=True)]
            push[axis] = min(push[axis], greatest(moved, low, high))
        if not np.isfinite([*slope[axis], push[axis]]).all() or _seam(grid, each, low, high):
            slope[axis], push[axis] = 0.0, 0.0
            formulas = [Formula((one,), len(low)) for one in each]
            ends = [one.bounds(*_boxes(one.reads[0], low, high), (0.0, 0.0)) for one in formulas]
            jumps[axis] = max(float(most.max() - least.min()) for least, most in ends)
        if not np.isfinite(jumps[axis]):
            raise ValueError(
                f"the velocity along {grid.names[axis]} may be undefined somewhere on the grid, so no bound is "
                "known on how it changes, which a Sensing needs; clip what it is divided by, or a root is taken of"
            )
    declared = _of_black_boxes(grid, dynamics, end, delta)
    return slope + declared[0], push + declared[1], jumps


def _velocities(dynamics: VectorField) -> list[list[Node]]:
    """The velocity along each axis under each input, [input][axis], as nodes of (state, t, v / bounds)."""
    ndim, D, out = dynamics.ndim, dynamics.disturbance_dim, []
    for j in range(len(dynamics.inputs)):
        known = {leaf("p", 0): leaf("x", ndim)}
        bounds = rebuilt(dynamics.functions_by_input["bounds"][j].outputs, known.get)
        v = [bound * leaf("x", ndim + 1 + d) for d, bound in enumerate(bounds)]
        known |= {leaf("p", 1 + d): one for d, one in enumerate(v)}
        # black boxes count as 0
        rows = {name: each[j] for name, each in dynamics.functions_by_input.items() if isinstance(each[j], Formula)}
        parts = {name: rebuilt(row.outputs, known.get) for name, row in rows.items()}
        drift, gain = parts.get("drift", [constant(0.0)] * ndim), parts.get("gain", [constant(0.0)] * ndim * D)
        out.append([sum((gain[i * D + d] * v[d] for d in range(D)), drift[i]) for i in range(ndim)])
    return out


def _boxes(reads: FloatArray, low: FloatArray, high: FloatArray) -> Ends:
    """Lower and upper corners, (M, n) each, of about `BEGINNING_BOXES` equal boxes that fill [low, high]."""
    count = int(BEGINNING_BOXES ** (1 / max(reads.sum(), 1)) + 1e-9)
    edges = np.linspace(low, high, count + 1)
    first, columns = np.indices(np.where(reads, count, 1).tolist()).reshape(len(low), -1).T, np.arange(len(low))
    return edges[first, columns], edges[np.where(reads, first + 1, count), columns]


def greatest(nodes: Iterable[Node], low: FloatArray, high: FloatArray) -> float:
    """An upper bound on |node| for all of these nodes, over the box [low, high]; inf where undefined."""
    return max(_greatest(one, low, high) for one in dict.fromkeys(nodes))


def _greatest(one: Node, low: FloatArray, high: FloatArray) -> float:
    """An upper bound on |node| over the box, if found soon within `SETTLED_WITHIN` of a value taken."""
    # A bound that is too high only makes error boxes larger, one that is too low breaks what they promise.
    if one.op == "const":
        return abs(float(one.value))
    formula = Formula((one,), len(low))
    begin, end = _boxes(formula.reads[0], low, high)
    size = np.where(formula.reads[0], (end - begin).max(axis=0), np.inf)
    bounds, taken = _magnitudes(formula, begin, end)
    for _ in range(ROUNDS_OF_HALVING):  # of the boxes with the greatest bounds
        if bounds.max() <= taken * SETTLED_WITHIN:
            break
        order = np.argsort(bounds)
        rest, worst = order[:-HALVED], order[-HALVED:]
        first, last = begin[worst], end[worst]
        place = np.arange(len(worst)), ((last - first) / size).argmax(axis=1)
        left, right = last.copy(), first.copy()
        left[place] = right[place] = (first[place] + last[place]) / 2
        first, last = np.concatenate([first, right]), np.concatenate([left, last])
        found, least = _magnitudes(formula, first, last)
        begin, end = np.concatenate([begin[rest], first]), np.concatenate([end[rest], last])
        bounds, taken = np.concatenate([bounds[rest], found]), max(taken, least)
    return float(bounds.max())


def _magnitudes(formula: Formula, low: FloatArray, high: FloatArray) -> tuple[FloatArray, float]:
    """A bound (M,) on a formula's magnitude in each box, and the largest that it surely has."""
    least, most = formula.bounds(low, high, (0.0, 0.0))
    return np.maximum(-least, most), float(np.maximum(least, -most).max(initial=0.0))


def _seam(grid: Grid, nodes: Iterable[Node], low: FloatArray, high: FloatArray) -> bool:
    """Whether a velocity differs between the ends of a periodic axis, beyond `SAME`."""
    for axis, one in product(np.flatnonzero(grid.periodic).tolist(), nodes):
        sides = [rebuilt([one], {leaf("x", axis): constant(float(end[axis]))}.get)[0] for end in (low, high)]
        if sides[0] is sides[1]:
            continue
        formula = Formula((make("sub", *sides), one), len(low), shape=(2,))
        begin, end = _boxes(formula.reads[0], low, high)
        points = begin + 0.3 * (end - begin)  # in the middle v is 0
        least, most = formula.bounds(points, points, (0.0, 0.0))
        if np.maximum(least, -most)[:, 0].max() > SAME * (1.0 + np.abs(most[:, 1]).max()):
            return True
    return False


def _of_black_boxes(grid: Grid, dynamics: VectorField, end: float, delta: float) -> tuple[FloatArray, FloatArray]:
    """What a drift or gain that is a black box adds to A and b of `lipschitz_bounds`."""
    low, high, ndim = np.array(grid.lower), np.array(grid.upper), grid.ndim
    slope, push = np.zeros((ndim, ndim)), np.zeros(ndim)
    opaque = {name: part for name in ("drift", "gain") if isinstance(part := getattr(dynamics, name), BlackBox)}
    if lacking := [name for name, part in opaque.items() if part.slope is None]:
        raise ValueError(f"{lacking[0]} is a BlackBox without a slope, which a Sensing needs")
    cuts = np.linspace(0.0, end, max(1, round(end / delta)) + 1).tolist()
    times = list(pairwise(cuts)) if dynamics.depends_on_time else [(0.0, 0.0)]
    for j, time in product(range(len(dynamics.inputs)), times if opaque else []):
        most = dynamics.disturbance_bounds(j, low[None], high[None], time)[1]
        shares = {"drift": 1.0, "gain": most.sum()}
        steepness = sum(shares[name] * np.broadcast_to(part.slope, slope.shape) for name, part in opaque.items())
        slope = np.maximum(slope, steepness)  # of the drift, and of the gain times the sum of the bounds of v
        if "gain" in opaque:
            given = opaque["gain"].reads
            reads = np.isin(np.arange(ndim), range(ndim) if given is None else given)
            ends = dynamics.functions_by_input["gain"][j].bounds(*_boxes(reads, low, high), time)
            push = np.maximum(push, (np.abs(ends).max(axis=0) @ most).max(axis=0))
    return slope, push


def growth_bound(slope: FloatArray, push: FloatArray | float, box: FloatArray, duration: float) -> FloatArray:
    """w(duration), (ndim,), of dw/dt = slope w + push, w(0) = box: how a box around a state has grown."""
    ndim = len(box)
    rate, term = np.zeros((ndim + 1, ndim + 1)), np.array([*box, 1.0])
    rate[:ndim, :ndim], rate[:ndim, ndim] = slope, push
    total = term.copy()
    # Exact to rounding unless slope times duration is large: terms are missed from some 40 on, where a box has grown by
    # 1e17.
    for place in range(1, TERMS):
        term = rate @ term * (duration / place)
        total += term
    return total[:ndim]
