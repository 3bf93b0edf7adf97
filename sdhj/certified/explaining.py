"""Why a state is not certified: by which obligation of the proof each input fails, by how much, and what would help."""

import itertools
import warnings
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from sdhj.certified.general_proof import FINEST
from sdhj.certified.images import Images
from sdhj.common.checks import finite_array, whole
from sdhj.common.findings import Finding, findings
from sdhj.common.remembering import FloatArray
from sdhj.kernels.packed import boxes_in_set, cells_at
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.solver.methods import HJI
from sdhj.solver.recursion import recursion
from sdhj.table.explaining import Explanation, Failure, tube_in_words, why_refuted

TRIED = 4096  # boxes that a tube is cut into, to see how near a set it comes
LOOSE = 1.5  # bounds on a velocity that are wider by this factor than what it is at states and disturbances
SCANTY, SCANTY_STATES = 0.1, 20_000  # a share that is never scanty; states
FEW_NODES, FEWEST_NODES, FINER = 5_000, 5, 4.0  # of a grid; along an axis; and there for each cell, at most
WORK = 1.5e6  # nodes x inputs x tubes: fewer nodes where this would be more
MORE_CELLS = 'more cells: method "hji" on few nodes has it, which rounds nothing to whole cells'
BEYOND = (
    'not more cells, as "hji" on few nodes lacks it: a smaller disturbance, stronger inputs, more room or more steps'
)
UNDECIDED = 'it is not known whether more cells would do: of "hji" on few nodes the boundary is near'
UNKNOWN = "it is not known whether more cells would do, as the problem cannot be solved on a grid"
COVER = ("rounding", "image")  # why an input fails whose tube is clear
NEGLIGIBLE = 1e-9  # of the largest coordinate of an axis: rounding


def explain(table: Any, q: FloatArray, step: int, within: int | None) -> Explanation:
    """Why a state q (ndim,) is certified in the tube (step, within) or not: by which obligation each input fails."""
    problem, step = table.problem, whole("step", step, least=0, most=table.steps)
    step, within = table.clipped(step, within)
    state = finite_array("a state", q, (len(table.axes),))[None]
    entry = tube_in_words(table, step, within)
    if table.contains(state, start=step, within=within)[0]:
        ways = np.flatnonzero(table.certified_inputs(state, step, within)[0]).tolist()
        return Explanation(True, f"Certified {entry}" + (f", by inputs {ways}." if within else "."))
    found = np.empty((1 << len(table.axes), len(table.axes)), np.int64)
    if not cells_at(state[0], table.cells, table.proof.shell, found):
        return Explanation(False, "The state is off the grid.")
    if says := why_refuted(table, state, step, within):
        return Explanation(False, says)
    seen, says = state, f"Not proved at these cells {entry}:"
    if problem.sensing and not table.outside(state, step, within)[0]:  # but not of all that may be measured of it
        around = table.points_of_error_box(state)[0]
        seen = around[table.outside(around, step, within)][:1]
        shown = np.array2string(seen[0], precision=4, separator=", ")
        says = f"Not proved at these cells {entry}, as the state may be measured, or predicted, at {shown}:"
    cells = found[: cells_at(seen[0], table.cells, table.proof.shell, found)]
    if within == 0:
        what = "clear of the unsafe sets" if problem.has_no_target else "in the target and clear of the unsafe sets"
        return Explanation(False, f"{says[:-1]}: not all of its cell is {what}.")
    # The first cell that is not held: a state is in the set only if all cells near it are.
    held = np.array([table.holds(cell, step, within) for cell in cells])
    causes, helps = what_keeps_out(table, state, step, within)
    return _Cell(table, seen[0], cells[int(np.argmin(held))], step, within).explained(says, causes, helps)


def on_few_nodes(table: Any) -> Any:
    """The table of the same problem and steps by `HJI` on few nodes, if that can be."""
    problem, cells = table.problem, np.array(table.shape)
    tubes = table.steps if problem.time_invariant else table.steps * (table.steps + 1) // 2
    few = min(FEW_NODES, WORK / (len(problem.inputs) * max(tubes, 1)))
    nodes = np.maximum(np.round(cells * min((few / cells.prod()) ** (1 / len(cells)), FINER)), FEWEST_NODES) + 1
    # some black boxes are refused; nobody asked for what this solve finds
    with warnings.catch_warnings(), findings(), suppress(ValueError, MemoryError):
        warnings.simplefilter("ignore")
        grid: Any = replace(problem.grid, shape=tuple(nodes.astype(int).tolist()))
        # with other nodes it is not what its recipe makes
        made = replace(problem, grid=grid, recipe={})
        sets = HJI().sets(made, False)
        recursion(sets, made.most_steps, lambda: None)
        return sets.finish({})
    return None


def what_keeps_out(table: Any, state: FloatArray, step: int, within: int) -> tuple[tuple[str, ...], list[str]]:
    """What keeps a state out of a tube, as `Explanation.causes`, and what may help."""
    grid = table.on_few_nodes
    if grid is None:
        return (), [UNKNOWN, *advice_for_ever(table)]
    space, asked = grid.problem.grid, {"start": step, "within": within}
    if grid.contains(state, **asked)[0]:
        return ("creep" if table.problem.has_no_target else "rounding",), [MORE_CELLS, *advice_for_ever(table)]
    # a state that the grid lacks may be in finer tubes where the grid has something within a node
    around = state + np.array(list(itertools.product((-1, 0, 1), repeat=space.ndim))) * space.spacing
    near = grid.contains(np.clip(space.wrapped(around), space.lower, space.upper), **asked).any()
    return (), [UNDECIDED if near else BEYOND, *advice_for_ever(table)]


def scanty_finding(table: Any) -> Finding | None:
    """A `Finding` that a table certifies next to nothing, with what may help."""
    # `sdhj.solve` asks at its end, where it may simulate, too: "hji" is solved only where the share is scanty
    problem, share = table.problem, table.fraction()
    if share > SCANTY:
        return None
    grid, t = problem.grid, problem.time(0)
    drawn = np.random.default_rng(0).uniform(grid.lower, grid.upper, (SCANTY_STATES, grid.ndim))
    free = problem.unsafe_value(drawn, t) > 0
    target = 0.0 if problem.has_no_target else float(((problem.target_value(drawn, t) <= 0) & free).mean())
    # solved for this
    claimed = table.on_few_nodes.fraction() if table.on_few_nodes else 0.0
    if share > target and claimed <= 10 * share:
        return None
    few = share <= target and not problem.has_no_target
    than = f"no more than the target, {target:.2g}" if few else f'{claimed:.2g} by "hji" on few nodes'
    message = (
        f"{share:.2g} of the state space of {problem.name!r} is certified, {than}: more is not proved at "
        f"{' x '.join(map(str, table.shape))} cells, which does not mean that there is no more"
    )
    # What is neither certified nor plainly lost or won.
    lost = ~table.in_cells(drawn, 0, table.steps) & free
    if not problem.has_no_target:
        lost &= problem.target_value(drawn, t) > 0
    if not lost.any():
        return Finding(message, share, "")
    has = np.zeros_like(lost)
    if table.on_few_nodes:
        has[lost] = table.on_few_nodes.contains(drawn[lost])
    at = np.array2string(drawn[np.argmax(has if has.any() else lost)], precision=3, separator=", ")
    some = MORE_CELLS if has.any() else BEYOND if table.on_few_nodes else UNKNOWN
    return Finding(
        f"{message}. ", share, f"What may help: {'; '.join([some, *advice_for_ever(table)])}. See table.explain({at})"
    )


def advice_for_ever(table: Any) -> list[str]:
    """What may help where nothing is certified for ever: longer intervals, cells where it creeps, no axis."""
    problem, names = table.problem, table.problem.grid.names
    if not (table.details.get("endless") and problem.has_no_target) or table.fraction():
        return []
    out = [f"inputs held for two or three periods, delta={2 * problem.delta:g} or {3 * problem.delta:g}"]
    middle, t = np.add(problem.grid.lower, problem.grid.upper)[None] / 2, problem.time(0)
    each = [
        np.mean(table.proof.bounds.velocity(j, middle, middle, t, t), axis=0)[0] for j in range(len(problem.inputs))
    ]
    # by an input, from most cells on by a whole one
    led = (np.maximum(table.proof.low, -table.proof.high).max(axis=(0, 1)) > 0).mean(axis=0) > 0.5
    for axis in np.flatnonzero((np.ptp(each, axis=0) > 0) & ~led):
        out.append(f"more cells along {names[axis]}, where no input leads on by a whole cell in an interval")
    return out + advice_to_leave_out(problem)


def advice_to_leave_out(problem: ReachAvoidProblem) -> list[str]:
    """Advice, for each axis that no velocity and no unsafe set reads, to leave it out."""
    grid, out = problem.grid, []
    read: Any = problem.dynamics.reads.any(axis=0)
    fails = grid.ends_where("fails")
    # where enough is left to be kept
    for axis in range(grid.ndim) if grid.ndim > 2 and problem.has_no_target else ():
        if not read[axis] and fails[:, axis].any() and all(axis not in part.axes for part in problem.unsafe):
            name, between = grid.names[axis], f"{grid.lower[axis]:g} and {grid.upper[axis]:g}"
            out.append(
                f"{name} left out, which no velocity depends on; then it is not promised to stay between {between}"
            )
    return out


class _Cell:
    """One cell that is not certified: by how much each input fails, and what would help."""

    def __init__(self, table: Any, state: FloatArray, cell: FloatArray, step: int, within: int) -> None:
        self.table, self.state, self.cell, self.step = table, state, cell, step
        self.problem: ReachAvoidProblem = table.problem
        self.within = within
        self.place, parts = table.tube_index(step + 1, within - 1), table.proof.parts
        edges = np.array([axis.edges()[i : i + 2] for axis, i in zip(table.axes, cell, strict=True)])
        self.box = np.stack([edges[:, 0] - table.proof.shell, edges[:, 1] + table.proof.shell])
        self.scales = np.array([axis.scale for axis in table.axes])
        length = self.problem.sensing.hold(self.problem.delta)[0]
        self.cuts = self.problem.time(step) + np.linspace(0.0, length, parts + 1)
        # Of this proof only bounds are asked, of boxes as they are: all axes are those of a place, and it has no moves.
        nothing, every = np.zeros((1, 1, 1, 1), np.int16), np.ones(len(cell), np.int64)
        self.proof = Images(self.problem, table.axes, parts, every, nothing, nothing)

    def explained(self, says: str, causes: tuple[str, ...], helps: list[str]) -> Explanation:
        """Every input's failure, the nearest first, and advice, after the text `says`."""
        clear = self.table.hazards(self.state[None], self.step)[0] <= 0
        failures = [self.image_failure(j) if clear[j] else self.collision_failure(j) for j in range(len(clear))]
        # those whose tube is clear come first
        failures.sort(key=lambda one: (one.by not in COVER, -one.short))
        return Explanation(False, says, tuple(failures), (*helps, *self.helps(failures[0])), causes)

    # ---- the two obligations

    def image_failure(self, j: int) -> Failure:
        """The `Failure` of an input u_j whose tube is clear: which cells of its image are not certified.

        `short` is minus their share; `by` is "rounding" where the state alone leads to certified cells only, else
        "image".
        """
        cells, missing = self.covering(*self.table.proof.image(self.cell, j, self.step))
        counts, lost = self.table.cells.counts, cells[missing]
        if not len(lost):
            return Failure(j, "", 0.0, "all cells that it may lead to are certified")
        # The cells past a seam have the numbers of those that they are.
        begin, end = lost.min(axis=0) % counts, lost.max(axis=0) % counts + 1
        edges = [axis.edges()[[a, b]] for axis, a, b in zip(self.table.axes, begin, end, strict=True)]
        ends = zip(self.problem.grid.names, edges, strict=True)
        where = ", ".join(f"{name} {a:.4g} to {b:.4g}" for name, (a, b) in ends)
        says = f"of {len(cells)} cells that it may lead to {len(lost)} are not certified, within {where}"
        if self.state_image_certified(j):
            return Failure(j, "rounding", -len(lost) / len(cells), f"{says}; from the state alone all are")
        return Failure(j, "image", -len(lost) / len(cells), says)

    def state_image_certified(self, j: int) -> bool:
        """Whether all cells that u_j may lead the state alone to are certified next."""
        known, alone = self.table.cells, np.stack([self.state, self.state])
        _, last = self.proof.swept(alone[:, None], j, float(self.cuts[0]), FINEST)
        first, end = (alone + last[0].T - known.lower) / known.width
        low = np.floor(first).astype(np.int64)
        return not self.covering(low, np.maximum(np.ceil(end).astype(np.int64) - 1, low))[1].any()

    def covering(self, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The cells (M, ndim) of the box from low to high, inclusive, and which are not certified next: (M,)."""
        known, table = self.table.cells, self.table
        high = np.where(known.periodic, np.minimum(high, low + known.counts - 1), np.clip(high, 0, known.counts - 1))
        low = np.where(known.periodic, low, np.clip(low, 0, known.counts - 1))
        cells = low + np.indices((high - low + 1).tolist()).reshape(len(low), -1).T
        at, answer = np.ascontiguousarray(cells % known.counts), np.empty((2, len(cells)), np.bool_)
        # each cell as a box of its own; what is beyond a bounded end counts as the last cell, as in the proof
        boxes_in_set(at, at, known, table.index[self.place], table.pool, answer)
        return cells, ~answer[0]

    def collision_failure(self, j: int) -> Failure:
        """The `Failure` of an input u_j whose tube may meet something: what first, when, and how deep."""
        depths = {name: deep for name, deep in self.depths(j, self.box) if deep.min() <= 0}
        if not depths:
            return Failure(j, "", 0.0, "its tube is clear, but not of the larger boxes by which the proof looks it up")
        # Of several the one that may be met first.
        name = min(depths, key=lambda one: int(np.argmax(depths[one] <= 0)))
        at, deepest = int(np.argmax(depths[name] <= 0)), float(depths[name].min())
        says = f"it may meet {name} from {self.cuts[at]:.4g} to {self.cuts[at + 1]:.4g} s, by up to {-deepest:.3g}"
        return Failure(j, name, deepest, says)

    def depths(self, j: int, box: FloatArray) -> Iterator[tuple[str, FloatArray]]:
        """Yield for each end and unsafe set its name and how far the tube of a box (2, ndim) stays from it: (parts,).

        Lower bounds for each part of the interval, <= 0 where the tube of u_j may meet it: in the axis's unit for an
        end, level-set values for a set.
        """
        tubes, _ = self.proof.swept(box[:, None], j, float(self.cuts[0]), FINEST)
        low, high = box[:, None] + np.moveaxis(tubes[0], 2, 0)
        ends, scales = zip(self.problem.grid.names, *self.problem.grid.faces("fails"), strict=True), self.scales
        for k, (name, lower, upper) in enumerate(ends):
            # As for the solver, which counts what is so near past an end as at it.
            yield f"the lower end of {name}", low[:, k] - lower + NEGLIGIBLE * scales[k]
            yield f"the upper end of {name}", upper - high[:, k] + NEGLIGIBLE * scales[k]
        late = self.problem.sensing.jitter
        for unsafe_set in (one for one in self.problem.unsafe if one.counts(j)):
            own, least = list(unsafe_set.axes), []
            # Some `TRIED` boxes in all, so fewer along each axis of a set of more axes.
            pieces = int(TRIED ** (1 / len(own)))
            corners = np.indices([pieces] * len(own)).reshape(len(own), -1).T
            for a, b, begin, end in zip(low[:, own], high[:, own], self.cuts[:-1], self.cuts[1:], strict=True):
                first = a + corners * (b - a) / pieces
                level = self.proof.bounds.bounds_of_level_set(
                    unsafe_set, first, first + (b - a) / pieces, begin - late, end + late
                )
                least.append(float(level[0].min()))
            yield unsafe_set.name, np.array(least)

    # ---- what would help

    def helps(self, nearest: Failure) -> Iterator[str]:
        """Advice: whether the input meets something from the state alone, and loose bounds."""
        names, ndim, j = self.problem.grid.names, len(self.state), nearest.input
        if nearest.by not in ("", *COVER):
            alone = dict(self.depths(j, np.stack([self.state, self.state])))
            if nearest.by in alone and alone[nearest.by].min() < 0:
                yield "other inputs, or a smaller set or disturbance: the tube of the state alone is not clear either"
        rng, t, dynamics = np.random.default_rng(0), float(self.cuts[0]), self.problem.dynamics
        states = self.problem.grid.wrapped(rng.uniform(self.box[0], self.box[1], (TRIED, ndim)))
        pushes = rng.choice([-1.0, 1.0], (TRIED, dynamics.disturbance_dim)) * dynamics.bounds_at(j, t)
        # Tried at states and disturbances, to compare with what is bounded over the whole cell.
        tried = np.ptp(dynamics.velocity_at(states, j, pushes, t), axis=0)
        bounded = np.ptp(self.proof.bounds.velocity(j, self.box[:1], self.box[1:], t, t), axis=0)[0]
        for axis in np.flatnonzero(bounded > LOOSE * tried + NEGLIGIBLE * self.scales / self.problem.delta):
            yield f"closer bounds on the velocity along {names[axis]}, {bounded[axis]:.3g} wide, not {tried[axis]:.3g}"
