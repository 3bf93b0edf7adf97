"""What a user should know of a problem or a table beside its answers, in six kinds of findings.

* *Missed*: a part of an unsafe set lies between the nodes, or no node is in the set or ever in danger of it.
* *Seams*: a set is cut off, or a velocity jumps, where a periodic axis closes.
* *Suspicions*: a target that may have the wrong sign, an axis that may be an angle with wrong ends or units.
* *Empty*: a tube holds next to nothing, and why.
* *Gaps*: tubes may be separate pieces that the grid does not keep apart.
* *Lost by projection*: what is dropped leaves nothing of the target, or no state free of an unsafe set.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache, partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from sdhj.common.findings import Finding, ProjectionWarning, tell
from sdhj.common.remembering import FloatArray
from sdhj.formulas.formula import Formula
from sdhj.problem.grid import SMALL, Grid
from sdhj.problem.nodes import neighbour, steepest
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.samples import Samples
from sdhj.problem.sets import TargetSet, UnsafeSet
from sdhj.table.batches import Table

ROUNDS = 5  # of the search: each finds the least value on a lattice of 3 points an axis, three times as fine as before
SOUGHT = 200_000  # values at most that a search computes
MOST_NODES = 2_000_000  # at which a set is sampled to look for parts between nodes where no method asks the nodes
TIMES = 3  # at which a moving set is checked
SEAM, STATES = 2000, 300  # points on a seam, at which sets and velocities are asked
SPANS = 50  # intervals at most in which something that moves is looked at
IGNORED = "so the table ignores it"
ASKED = "so whatever asks the nodes alone ignores it, as methods on the grid and pictures do"
TURNS = {"radians": 2.0 * math.pi, "degrees": 360.0}
MOST_TURNS = 4  # of an axis in radians; from 30 degrees on an axis in degrees has more
TRIED_STATES = 100  # at which functions are compared with themselves a turn on
ALIKE = 1e-9  # relative to the values, or absolute below one
NEARLY_EMPTY = 1e-4  # a tube that holds a smaller share of the state space is called empty
EMPTIED_STATES = 20_000  # states at which an empty tube is looked into
MOST_CORNERS = 2**23  # numbers
# cells that the disturbance has to push and that a gap has to be wide, if shifted and by differences: of what a line of
# gaps promises .001 to .002 is wrong at such a push, and less than .02 at such a width, for pushes of 1/4 to 32 cells
ENOUGH = {True: (1.0, 8.0), False: (8.0, 16.0)}
PARTS = 16  # of a displacement, at whose ends the target is asked
MOST_PAIRS = 5_000  # pairs of displacements at most
MIDDLES = 64  # of the middle of the target, with other coordinates drawn at random
LARGEST = 2**22  # nodes of a target that is looked at
RARE = 0.1  # of the states in the middle of the target, or of the gaps: fewer may be a corner of it


# ---- a set that nodes miss


def check_resolution(samples: Samples, most: float = math.inf) -> None:
    """Warn of seams, and of unsafe sets that hide between nodes, for methods on the grid.

    Sets with sampling="cell", and those whose axes have more than `most` nodes, are not looked at. Sets that no node is
    in danger of have `never_met_finding`.
    """
    problem = samples.problem
    check_seams(problem)
    for unsafe_set in problem.unsafe:
        # with sampling="cell" no part can hide: nodes have the least value of the cells around them
        if unsafe_set.sampling != "cell" and problem.grid.subgrid(unsafe_set.axes).size <= most:
            each = (_hidden(samples, unsafe_set, t) for t in _times(problem, unsafe_set.moving, TIMES))
            tell(next(filter(None, each), None))


def check_sets(problem: ReachAvoidProblem) -> None:
    """Warn of seams, and of unsafe sets that nodes miss, for methods that are not on the grid.

    Between more than `MOST_NODES` parts are sought only where no node is in the set.
    """
    check_seams(problem)
    samples = Samples(problem)
    for unsafe_set in problem.unsafe:
        nowhere = _nowhere_finding(samples, unsafe_set)
        sought = nowhere or problem.grid.subgrid(unsafe_set.axes).size <= MOST_NODES
        times = _times(problem, unsafe_set.moving, TIMES) if sought else []
        hidden = (_hidden(samples, unsafe_set, t, ASKED) for t in times)
        # One warning of a set is enough: the first that is found.
        tell(next(filter(None, hidden), nowhere))


def _nowhere_finding(samples: Samples, unsafe_set: UnsafeSet) -> Finding | None:
    """The finding that no node is in an unsafe set, in any of `SPANS` intervals if it moves."""
    problem = samples.problem
    steps = np.unique(np.linspace(0, problem.most_steps - 1, SPANS if unsafe_set.moving else 1).astype(int)).tolist()
    first, pieces = problem.span(0)[0], problem.grid.subgrid(unsafe_set.axes).pieces()
    if any((unsafe_set.level_set(points, first) <= 0).any() for points in pieces):  # mostly soon
        return None
    if any((samples.sample(unsafe_set, *problem.span(step)) <= 0).any() for step in steps):
        return None
    return Finding(
        f"the unsafe set {unsafe_set.name!r} is nowhere on the grid, so nothing keeps clear of it: ",
        0.0,
        "check its axes, its place and its units, and the sign of its level-set function (negative is inside)",
    )


def _hidden(samples: Samples, unsafe_set: UnsafeSet, t: float, so: str = IGNORED) -> Finding | None:
    """`_hidden_finding`, kept with a formula for the next solve, of which the search is a twentieth."""
    level_set, known = unsafe_set.level_set, dict[Any, Finding | None]()
    if isinstance(level_set, Formula):
        known = level_set.remembered("hidden", dict)
    # with all that the finding's words have, such as the name and `so`
    key = unsafe_set.name, unsafe_set.axes, unsafe_set.sampling, samples.grid, t, so
    if key not in known:
        known[key] = _hidden_finding(samples, unsafe_set, t, so)
    return known[key]


def _hidden_finding(samples: Samples, unsafe_set: UnsafeSet, t: float, so: str = IGNORED) -> Finding | None:
    """The finding that part of an unsafe set lies between the nodes at time t, and `so` what follows.

    Such a part lies in a cell of which no corner, nor any corner of a neighbouring cell, is in the set.
    """
    grid, values = samples.grid.subgrid(unsafe_set.axes), samples.sample(unsafe_set, t)
    spacing = np.array(grid.spacing)
    bound, corners = sum(steepest(grid, values, axis) for axis in range(grid.ndim)) / 2, values
    for axis in range(grid.ndim):
        corners = np.minimum(*grid.edges(corners, axis))
    seen = corners <= 0
    for axis in range(grid.ndim):
        # Beside a node that is in the set, the grid sees it as well as it can.
        seen = seen | neighbour(grid, seen, axis, -1, False) | neighbour(grid, seen, axis, 1, False)
    # where the least value at the corners is at most half the sum, over the axes, of the largest change between
    # neighbours; those of least value first, so that what is overlooked for `SOUGHT` is least likely
    suspects = np.flatnonzero((corners <= bound) & ~seen)
    offsets = np.array(list(product((-1.0, 0.0, 1.0), repeat=grid.ndim)))
    most = SOUGHT // (ROUNDS * len(offsets)) + 1
    suspects = suspects[np.argsort(corners.ravel()[suspects], kind="stable")[:most]]
    if not suspects.size:
        return None
    places = np.stack(np.unravel_index(suspects, corners.shape), axis=1) + 0.5
    centres, radius = np.array(grid.lower) + places * spacing, spacing / 3
    for _ in range(ROUNDS):
        points = centres[:, None] + offsets * radius
        found = unsafe_set.level_set(grid.wrapped(points.reshape(-1, grid.ndim)), t).reshape(len(points), -1)
        rows, best = np.arange(len(points)), found.argmin(axis=1)
        centres, radius, least = points[rows, best], radius / 3, found[rows, best]
    deepest = int(least.argmin())
    if least[deepest] > 0:
        return None
    thickness, thick = -2 * float(least[deepest]), "its level-set function is 0, which gives no thickness,"
    use = "a distance that is negative inside, with sampling='cell', or more nodes"
    names = [samples.grid.names[axis] for axis in unsafe_set.axes]
    if thickness > 0:
        needed = [int(np.ceil((hi - lo) / thickness)) + 1 for lo, hi in zip(grid.lower, grid.upper, strict=True)]
        use = f"{', '.join(f'{n} nodes along {name}' for n, name in zip(needed, names, strict=True))}, or "
        use += 'UnsafeSet(..., sampling="cell"), which uses the least value in the cells around each node'
        thick = f"it is about {thickness:.2g} thick there,"
    where = ", ".join(f"{name} = {x:.4g}" for name, x in zip(names, centres[deepest], strict=True))
    return Finding(
        f"the unsafe set {unsafe_set.name!r} hides between the nodes at {where}, t = {t:g}: {thick} and nodes are "
        f"{', '.join(f'{h:.2g}' for h in spacing)} apart, {so}. ",
        thickness,
        f"Use {use}",
    )


def never_met_finding(unsafe_set: UnsafeSet) -> Finding:
    """The finding that no node is in danger of an unsafe set under any input, as the caller has found."""
    return Finding(
        f"no node is ever in danger of the unsafe set {unsafe_set.name!r}, so the table ignores it. ",
        0.0,
        "It lies between the nodes (use more nodes, or enlarge the set), or is out of reach",
        UserWarning,
    )


# ---- seams


def check_seams(problem: ReachAvoidProblem) -> None:
    """Warn of sets that are cut off, and of velocities that jump, where a periodic axis closes."""
    # of each set the first finding in time is told
    for part in problem.all_sets:
        each = (_cut_off_finding(problem, part, t) for t in _times(problem, part.moving, SPANS + 1))
        tell(next(filter(None, each), None))
    times = _times(problem, problem.dynamics.depends_on_time, SPANS + 1)
    tell(next(filter(None, (_turning_over_finding(problem, t) for t in times)), None))


def _times(problem: ReachAvoidProblem, timed: bool, most: int) -> list[float]:
    """Up to so many times, s, from 0 to the problem's last step; 0 alone if not `timed`."""
    steps = problem.most_steps
    return np.linspace(0.0, steps * problem.delta, min(most, steps + 1) if timed else 1).tolist()


@lru_cache(maxsize=8)  # what moves is looked at many times
def _seams(grid: Grid, most: int) -> "list[tuple[int, FloatArray, FloatArray]]":
    """For each periodic axis its number, points (M, ndim) just before its upper end, and the same at its lower end.

    They are `most` random points, or all nodes of the seam; nobody may write them.
    """
    rng, found = np.random.default_rng(0), list[tuple[int, FloatArray, FloatArray]]()
    for axis in np.flatnonzero(grid.periodic).tolist():
        sides = [grid.nodes(k) if k != axis else np.zeros(1) for k in range(grid.ndim)]
        drawn = np.stack([rng.choice(side, most) for side in sides], axis=1)
        # half of the coordinates are those of nodes
        at_nodes = rng.random((most, grid.ndim)) < 0.5
        points = np.where(at_nodes, drawn, rng.uniform(grid.lower, grid.upper, (most, grid.ndim)))
        if np.prod([len(side) for side in sides]) <= most:
            nodes = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, grid.ndim)
            points = np.concatenate([nodes, points])
        before, after = points.copy(), points
        before[:, axis], after[:, axis] = np.nextafter(grid.upper[axis], grid.lower[axis]), grid.lower[axis]
        found.append((axis, before, after))
    return found


def _cut_off_finding(problem: ReachAvoidProblem, part: TargetSet | UnsafeSet, t: float) -> Finding | None:
    """The finding that a set is cut off where a periodic axis closes, at time t."""
    grid = problem.grid.subgrid(part.axes)
    for axis, before, after in _seams(grid, SEAM):
        first, last = np.split(part.level_set(np.concatenate([before, after]), t), 2)
        if not (turns := (first > 0) != (last > 0)).any():
            continue
        inside = np.random.default_rng(0).uniform(grid.lower, grid.upper, (SEAM, grid.ndim))
        # of the largest value at random states
        rounding = 1e-6 * np.abs(part.level_set(inside, t)).max()
        jump = np.abs(first - last)
        if np.any(turns & (jump > rounding)):
            name, what = grid.names[axis], "unsafe set" if isinstance(part, UnsafeSet) else "target"
            return Finding(
                f"the {what} {part.name!r} is cut off where the periodic axis {name} ends and begins anew: its "
                "level-set function ",
                float(jump.max()),
                f"has to be periodic, as np.cos(r) - np.cos({name} - c) is for |{name} - c| <= r",
            )
    return None


def _turning_over_finding(problem: ReachAvoidProblem, t: float) -> Finding | None:
    """The finding that the least or the greatest velocity jumps where a periodic axis closes, at time t."""
    grid, dynamics = problem.grid, problem.dynamics
    for axis, before, after in _seams(grid, STATES):
        for j in range(len(problem.inputs)) if dynamics.reads[:, axis].any() else ():
            try:
                first, last = dynamics.extremes(before, j, t), dynamics.extremes(after, j, t)
            except ValueError:  # undefined there: said elsewhere
                continue
            jump = np.abs(first - last).max(axis=1)
            row, along = np.unravel_index(int(jump.argmax()), jump.shape)
            if jump[row, along] > 1e-6 * max(np.abs(first).max(), np.abs(last).max()):
                name = grid.names[axis]
                ends = f"{first[row, :, along].mean():.3g} to {last[row, :, along].mean():.3g}"
                return Finding(
                    f"the velocity along {grid.names[along]} jumps from {ends} under input {j} where the periodic axis "
                    f"{name} ends and begins anew: ",
                    float(jump[row, along]),
                    f"it has to be periodic, as k np.sin({name}) is in place of k {name}, unless the robot does jump "
                    "there",
                )
    return None


# ---- suspicions


def suspicions(problem: ReachAvoidProblem) -> Iterator[Finding]:
    """Yield a `Finding` for each thing that is unusual in a problem, with what to do if it was not meant."""
    yield from _wrong_sign_findings(problem)
    grid = problem.grid
    states = np.random.default_rng(0).uniform(grid.lower, grid.upper, (TRIED_STATES, grid.ndim))
    for axis in range(grid.ndim):
        yield from _angle_findings(problem, states, axis)


def _wrong_sign_findings(problem: ReachAvoidProblem) -> Iterator[Finding]:
    """Yield a finding where the target's level-set function may have the wrong sign.

    It may where the target fills more than half of its axes' grid, not all, and all nodes at the ends of bounded axes.
    """
    grid = problem.grid.subgrid(problem.target.axes)
    if problem.has_no_target or all(grid.periodic):
        return
    if grid.size > SMALL:  # fewer nodes show it as well
        most = int(SMALL ** (1 / grid.ndim))
        grid = Grid(grid.lower, grid.upper, [min(n, most) for n in grid.shape], grid.periodic)
    inside = problem.target.level_set(grid.points(), problem.time(0)).reshape(grid.shape) <= 0
    ends = [inside.take(end, axis) for axis in range(grid.ndim) if not grid.periodic[axis] for end in (0, -1)]
    if 0.5 < (share := grid.fraction(inside)) and not inside.all() and all(end.all() for end in ends):
        yield Finding(
            f"the target {problem.target.name!r} is all but a region in the midst of its axes, {share:.1%} of them: ",
            share,
            "a level-set function is negative inside the target; if that region was meant, turn the sign",
        )


def _angle_findings(problem: ReachAvoidProblem, states: FloatArray, axis: int) -> Iterator[Finding]:
    """Yield findings of an axis that may be an angle, as all functions repeat after a whole turn, of 2 pi or 360."""
    grid = problem.grid
    length, spacing, name = grid.upper[axis] - grid.lower[axis], grid.spacing[axis], grid.names[axis]
    if length > MOST_TURNS * TURNS["radians"] and _repeats(problem, states, axis, TURNS["radians"]):
        yield Finding(
            f"the functions of the problem repeat every 2 pi along {name}, which has {length / 2 / math.pi:.3g} turns "
            f"from {grid.lower[axis]:g} to {grid.upper[axis]:g}: ",
            length / 2 / math.pi,
            "if it is in degrees, convert it by np.deg2rad where it enters a sine or cosine",
        )
    for unit, turn in TURNS.items():
        # an axis whose last node is left out, as it is the first one again, is short by a spacing
        if not math.isclose(length, turn, abs_tol=1.01 * spacing) or not _repeats(problem, states, axis, turn):
            continue
        if grid.ends_not_given and not grid.periodic[axis]:
            yield Finding(
                f"the axis {name} is a whole turn, after which the functions of the problem repeat, but it has ends, "
                "beyond which the robot has failed: ",
                1.0,
                f'if it is an angle, give periodic=, True for {name}; if it has stops, give ends="unsafe" or "wall"',
            )
        each = (problem.dynamics.extremes(states, j, problem.time(0)) for j in range(len(problem.inputs)))
        speed = max(float(np.abs(velocities[..., axis]).max()) for velocities in each)
        if (turns := speed * problem.delta / turn) > 1:
            yield Finding(
                f"some input moves {name} by {turns:.3g} turns within one interval of {problem.delta:g} s: ",
                turns,
                f"its rates have to be in {unit} per second, and delta in seconds",
            )


def _repeats(problem: ReachAvoidProblem, states: FloatArray, axis: int, turn: float) -> bool:
    """Whether all functions that read an axis are alike a `turn` further on, to `ALIKE`, and some change along it."""
    # of a black box nothing is known off the grid
    if not problem.dynamics.formulas or not all(isinstance(one.level_set, Formula) for one in problem.all_sets):
        return False
    depends, further, elsewhere = False, states.copy(), states.copy()
    further[:, axis] += turn
    elsewhere[:, axis] = np.roll(states[:, axis], 1)
    together = np.concatenate([states, further, elsewhere])
    t, dynamics = problem.time(0), problem.dynamics
    inputs = range(len(problem.inputs)) if dynamics.reads[:, axis].any() else ()
    functions: list[Callable[[FloatArray], FloatArray]] = [partial(dynamics.extremes, j=j, t=t) for j in inputs]
    functions += [partial(_level_set_values, problem, part) for part in problem.all_sets if axis in part.axes]
    for function in functions:
        try:
            here, there, other = np.split(function(together), 3)
        except (ValueError, ArithmeticError):  # undefined a turn on
            return False
        scale = 1.0 + np.abs(here)
        if (np.abs(there - here) > ALIKE * scale).any():
            return False
        depends |= bool((np.abs(other - here) > ALIKE * scale).any())
    return depends


def _level_set_values(problem: ReachAvoidProblem, part: TargetSet | UnsafeSet, states: FloatArray) -> FloatArray:
    """Level-set values (M,) of a set at states (M, ndim) at the time of step 0."""
    return np.asarray(part.level_set(states.take(part.axes, axis=1), problem.time(0)))  # not wrapped into the grid


# ---- an empty tube, and why


def empty_finding(table: Table, share: float) -> Finding:
    """The finding on a tube with a `share` of next to nothing: a likely cause, and what helps."""
    problem, grid = table.problem, table.grid
    message = f"the tube of {problem.name!r} holds {share:.2g} of the state space"
    message += "" if problem.has_no_target else ", no more than the target itself" if share else ""
    states = np.random.default_rng(0).uniform(grid.lower, grid.upper, (EMPTIED_STATES, grid.ndim))
    clear = problem.unsafe_value(states, problem.time(0)) > 0
    hazards = table.hazards(states[clear], 0) if clear.any() else np.empty((0, 1))
    ways = float((hazards <= 0).any(axis=1).mean()) if len(hazards) else 0.0
    if table.method == "projected" and ways > NEARLY_EMPTY:
        message += ": the projections may be too conservative for this problem; "
        return Finding(message, share, 'try method="hji"')
    if ways <= NEARLY_EMPTY:
        names = ", ".join(repr(unsafe_set.name) for unsafe_set in problem.unsafe) or "the unsafe ends of the grid"
        message += f": no input stays clear of {names} for one interval; "
        return Finding(message, share, "use a shorter delta or other inputs")
    if eaten := _costly_error(problem):  # no node brings that back
        return Finding(f"{message}: {eaten.cause}", share, eaten.remedy)
    gains = f"none of the {len(problem.inputs)} inputs makes progress against the adversary"
    but = "hardly from any for all steps" if problem.has_no_target else gains
    message += f": from {ways:.0%} of the free states some input stays clear for one interval, but {but}; "
    less = "a smaller error, delay or jitter, " if problem.sensing else ""
    outside = (
        np.empty(0) if problem.has_no_target else states[clear & (problem.target_value(states, problem.time(0)) > 0)]
    )
    nodes = (
        "more nodes or "
        if problem.has_no_target or target_reachable_in_a_step(problem, outside)
        else "a smaller disturbance or "
    )
    return Finding(message, share, f"use {less}stronger inputs, {nodes}another delta")


def _costly_error(problem: ReachAvoidProblem) -> Finding | None:
    """The finding that errors of a `Sensing` without memory cost more along an axis than the inputs change, or None.

    It names the first axis along which 2 E is at least half of what the choice of the input changes, without a
    disturbance, at random states.
    """
    sensing, grid = problem.sensing, problem.grid
    if not sensing or sensing.remembers:
        return None
    states = np.random.default_rng(0).uniform(grid.lower, grid.upper, (STATES, grid.ndim))
    still, t = np.zeros((STATES, problem.dynamics.disturbance_dim)), problem.time(0)
    speeds = [problem.dynamics.velocity_at(states, j, still, t) for j in range(len(problem.inputs))]
    # K is shrunk by E to M, and M by E to W (`sdhj.problem.sensing`): 2 E a step; inputs win back half of their range
    changed, costs = problem.delta * np.ptp(speeds, axis=0).max(axis=0) / 2, 2 * problem.half_widths[0]
    for axis in np.flatnonzero((changed > 0) & (costs >= changed * (1 - 1e-9))).tolist():
        return Finding(
            f"an input changes {grid.names[axis]} by {changed[axis]:.3g} in an interval, and what the sensing leaves "
            f"open of it costs {costs[axis]:.3g} in each: sets that are to be kept for many steps are empty. ",
            float(costs[axis]),
            "Use Sensing(..., memory=True) and ask Controller.step, or a longer delta",
        )
    return None


def target_reachable_in_a_step(problem: ReachAvoidProblem, states: FloatArray) -> bool:
    """Whether from any of these states (M, ndim) some input leads into the target in a step, by corners of the box.

    Only as many states are looked at as have `MOST_CORNERS` numbers.
    """
    corners = np.array(list(product((False, True), repeat=problem.grid.ndim)))
    # at corners alone: what lies between them is not looked at, so it may be True too often
    states = states[: max(1, MOST_CORNERS // (len(problem.inputs) * corners.size))]
    low, high = problem.interval(0).reachable_boxes(states)
    ends = states[:, None, None] + np.where(corners, high[:, :, None], low[:, :, None])
    values = problem.target_value(ends.reshape(-1, problem.grid.ndim), problem.time(1))
    return bool((values.reshape(*ends.shape[:3]).max(axis=2) <= 0).any())


# ---- gaps between the pieces of a tube


class _Gaps(NamedTuple):
    """The worst gaps that were seen between pieces of a tube along one axis; inf if there is none."""

    push: float  # in the axis's unit: how far the disturbance pushes in an interval, at least
    width: float  # in the axis's unit: how wide the gaps are


def gaps_advice(problem: ReachAvoidProblem, shifted: bool) -> str:
    """Advice if tubes may be separate pieces that the grid does not keep apart; else "".

    Where reach sets are not `shifted`, nor by a formula, more nodes are needed (`ENOUGH`).
    """
    # `sdhj.simulation.played` has it in its warnings, and plays the most runs wherever it is not ""
    grid, axes = problem.grid, list(problem.target.axes)
    if problem.has_no_target or grid.subgrid(axes).size > LARGEST:
        return ""
    found: dict[int, _Gaps] = {}  # by the axis
    for step in (0, problem.most_steps // 2, problem.most_steps) if problem.target.moving else (0,):
        for axis, here in _gaps_along(problem, step).items():
            found[axis] = _Gaps(*np.minimum(here, found.get(axis, here)).tolist())
    cells = {axis: np.array(there) / grid.spacing[axis] for axis, there in found.items()}
    with np.errstate(divide="ignore"):  # without a disturbance no number of nodes is enough
        finer = {axis: float(np.max(ENOUGH[shifted] / has)) * (1 - 1e-9) for axis, has in cells.items()}
    short = [axis for axis in sorted(finer) if finer[axis] > 1]
    if not short:
        return ""
    nodes = []
    for axis in sorted(finer):
        # where pieces touch along an axis a gap along another is a hole, which is filled from all sides
        factor = finer[axis] or max(finer.values())
        if 1 < factor < math.inf:
            ends = not grid.periodic[axis]
            nodes.append(f"{math.ceil((grid.shape[axis] - ends) * factor) + ends:,} nodes along {grid.names[axis]}")
    along = " and ".join(grid.names[axis] for axis in short)
    pushes, widths = (" and ".join(f"{cells[axis][which]:.2g}" for axis in short) for which in (0, 1))
    lax = "sdhj.HopfLax(), which needs fewer nodes; " if not shifted and problem.dynamics.stateless else ""
    return (
        f"The tubes may be separate pieces along {along}, because a step is longer than the target is thick, and the "
        f"grid fills the gaps between them: the disturbance pushes {pushes} cells in a step, and the gaps are {widths} "
        "cells wide, which should be {:g} and {:g}. What helps: ".format(*ENOUGH[shifted])
        + (f"{' and '.join(nodes)}; " if nodes else "")
        + f"{lax}a shorter delta, or slower inputs beside these, so that steps are shorter than the target is thick"
    )


def _gaps_along(problem: ReachAvoidProblem, step: int) -> dict[int, _Gaps]:
    """The gaps at a step by the axis along which inputs move the target.

    Looked for at random states in the middle of the target, between neighbouring displacements of the inputs
    (`_neighbouring_pairs`): of each axis the least push and a small width, the quantile `RARE`.
    """
    grid, count = problem.grid, len(problem.inputs)
    axes, t = list(problem.target.axes), problem.time(step)
    some, rng = grid.subgrid(axes), np.random.default_rng(0)
    middle = _deepest_nodes(problem, some, t)
    if not len(middle):
        return {}
    points = rng.uniform(grid.lower, grid.upper, (MIDDLES if count < MIDDLES else MIDDLES // 16, grid.ndim))
    points[:, axes] = middle[rng.permutation(len(middle))[np.arange(len(points)) % len(middle)]]
    interval = problem.interval(min(step, problem.most_steps - 1))
    low, high = (end[..., axes] for end in interval.reachable_boxes(points))
    push = np.broadcast_to(((high - low) / 2).max(axis=1), (len(points), len(axes)))
    moves = np.zeros((len(points), 1 + count, len(axes)))  # the first is that of the target itself
    moves[:, 1:] = interval.displacements(points)[..., axes]
    state, one, other = _neighbouring_pairs(moves / some.spacing, rng)
    between, centres = moves[state, other] - moves[state, one], points[state][:, axes]
    length = np.abs(between) / some.spacing
    along = (length > 0) & (length >= length.max(axis=1, keepdims=True) / 2)
    taken_off = np.max(push[state] / np.where(along, np.abs(between), np.inf), axis=1)
    taken_off *= np.where((moves[state, one] == 0).all(axis=1) | (moves[state, other] == 0).all(axis=1), 1, 2)
    # the width of a gap is the distance of the two, less what the target reaches between them and what the disturbance
    # pushes
    longer = between * (1.0 + taken_off)[:, None]
    ways = _share_inside(problem, centres, longer, t) + _share_inside(problem, centres, -longer, t)
    alone, widths = ways < 1.0, np.abs(longer) * (1.0 - ways)[:, None]
    if len(np.unique(state[alone])) < RARE * len(points):
        return {}
    hit = along & alone[:, None]
    found = {axis: _Gaps(math.inf, math.inf) for axis, moved in zip(axes, along.T, strict=True) if moved.any()}
    for i, axis in enumerate(axes):
        if (here := hit[:, i]).any():
            width = np.quantile(widths[here, i], RARE, method="lower")
            found[axis] = _Gaps(float(push[state[here], i].min()), float(width))
    return found


def _neighbouring_pairs(
    displacements: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Pairs of neighbours among the K `displacements` (M, K, axes), in cells; at most `MOST_PAIRS`.

    Returns (pairs,) ints: states, and indices of the first and second displacement, which differ and of which no third
    is nearer to both than they are to each other (the relative neighbourhood graph, Toussaint 1980).
    """
    distances = np.sqrt(((displacements[:, :, None] - displacements[:, None]) ** 2).sum(axis=3))
    # each pair once, and none of equal displacements
    far = np.triu(distances > 0)
    for third in range(displacements.shape[1]):
        far &= np.maximum(distances[:, :, third, None], distances[:, None, third]) >= distances * (1 - 1e-9)
    found = np.argwhere(far)
    some = found[np.sort(rng.permutation(len(found))[:MOST_PAIRS])]
    return some[:, 0], some[:, 1], some[:, 2]


def _deepest_nodes(problem: ReachAvoidProblem, some: Grid, t: float) -> FloatArray:
    """The nodes of the target's subgrid that are as deep in the target as all neighbours: (M, axes)."""
    values = problem.target.level_set(some.points(), t).reshape(some.shape)
    deepest = values
    for axis in range(some.ndim):
        # Axis by axis, so that neighbours across corners count as well.
        deepest = np.minimum.reduce([deepest, *(neighbour(some, deepest, axis, by, np.inf) for by in (-1, 1))])
    inside = np.argwhere((values <= 0) & (values == deepest))
    return np.array(some.lower) + inside * some.spacing


def _share_inside(problem: ReachAvoidProblem, centres: FloatArray, way: FloatArray, t: float) -> FloatArray:
    """How far the target continues from `centres` in it along `way`, both (M, axes), as a share of it: (M,)."""
    grid, shares = problem.grid.subgrid(problem.target.axes), np.arange(PARTS + 1) / PARTS
    # taken to be linear between these points
    points = centres[:, None] + shares[:, None] * way[:, None]
    values = problem.target.level_set(grid.wrapped(points.reshape(-1, grid.ndim)), t).reshape(len(way), len(shares))
    first = np.where((values > 0).any(axis=1), (values > 0).argmax(axis=1), len(shares) - 1)
    rows = np.arange(len(way))
    inner, outer = np.minimum(values[rows, first - 1], 0.0), np.maximum(values[rows, first], 0.0)
    return (first - 1 + inner / np.where(outer > inner, inner - outer, -1.0)) / PARTS


# ---- what a projection loses


def names_apart(problem: ReachAvoidProblem) -> list[str]:
    """The names of the unsafe sets, with their number where others have the same."""
    # `ProjectedSets.look_over` keeps "free" under these names, where `projection_findings` looks them up; files keep
    # them
    names = [one.name for one in problem.unsafe]
    apart = (f"{name}, number {number} of problem.unsafe" for number, name in enumerate(names, 1))
    return [name if names.count(name) == 1 else other for name, other in zip(names, apart, strict=True)]


def projection_findings(
    problem: ReachAvoidProblem, subspaces: Sequence[Sequence[int]], losses: Mapping[str, Any]
) -> list[Finding]:
    """Findings of subspaces that keep nothing of the target, and of sets that leave none free."""
    # asked twice, to warn of them and to keep their words: so it does not warn itself
    names, found = problem.grid.names, []
    for axes, share in zip(subspaces, losses["target_kept"], strict=True):
        dropped = [axis for axis in range(problem.grid.ndim) if axis not in axes]
        if share == 0.0:
            lost = [axis for axis in dropped if axis in problem.target.axes]
            all_dropped, all_lost = (" and ".join(names[axis] for axis in some) for some in (dropped, lost))
            cause = f"everywhere in the target some value of {all_dropped} is unsafe"
            cause = f"the target depends on {all_lost}" if lost else cause
            cause = (
                f"dropping {all_dropped} leaves nothing of the target: the projected target has to be reached for "
                f"every value of what was dropped, but {cause}; "
            )
            found.append(Finding(cause, share, "keep it, or use method='hji'", ProjectionWarning))
    for name, part in zip(names_apart(problem), problem.unsafe, strict=True):
        if losses["free"].get(name) == 0.0:
            cause = (
                f"the outer projection of the unsafe set {name!r} fills every subspace: everywhere some value of what "
                "was dropped is unsafe, so no input counts as safe"
            )
            cause += "; " if part.inputs is None else f" of {list(part.inputs)}; "
            found.append(Finding(cause, 0.0, "keep more of the axes it depends on", ProjectionWarning))
    return found
