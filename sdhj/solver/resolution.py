"""Whether a grid resolves the unsafe sets: a set thinner than a cell may lie between its nodes.

A cell *hides* a part of an unsafe set if the set meets the cell, but contains none of the corners of the cell or of its
neighbours. (If it contains one, the set's boundary is nearby, and the interpolated boundary is off by a part of a cell,
as everywhere.) The change of a level-set function from node to node bounds its values between them; if this bound does
not exclude a hidden part, the least value in the cell is searched for.
"""

import math
from functools import lru_cache
from itertools import permutations, product

import numpy as np

from sdhj.common.findings import Finding, tell
from sdhj.common.memory import available
from sdhj.kernels import FloatArray
from sdhj.problem.grid import Grid
from sdhj.problem.nodes import neighbour, steepest
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.samples import Samples
from sdhj.problem.sets import TargetSet, UnsafeSet

ROUNDS = 5  # of the search: each finds the least value on a lattice of 3 points an axis, three times as fine as before
SOUGHT = 200_000  # values at most that a search computes
MOST_NODES = 2_000_000  # at which a set is sampled to look for parts between nodes where no method asks the nodes
CROSSINGS = 1000  # of the boundary and the lines between nodes along an axis, at which the function is checked
TIMES = 3  # at which a moving set is checked
SEAM, STATES = 2000, 300  # points on a seam, at which sets and velocities are asked
SPANS = 50  # intervals at most in which something that moves is looked at
IGNORED = "so the table ignores it"
ASKED = "so whatever asks the nodes alone ignores it, as methods on the grid and pictures do"
ABRUPT = 0.25  # of the change between two nodes: a level-set function that is farther from linear jumps there


def check_resolution(problem: ReachAvoidProblem, most: float = math.inf) -> None:
    """Warn of unsafe sets that the grid does not resolve, for methods on the grid.

    That is of sets that hide between nodes, are too thin or flat inside, of level-set functions that jump at the set's
    boundary, and of what `check_seams` finds: of each set one warning, looked for at `TIMES` times if the set moves.
    Sets with sampling="cell", and those whose axes have more than `most` nodes, are not looked at.
    """
    check_seams(problem)
    samples, kinds = Samples(problem), (_hidden_finding, _abrupt_finding, too_thin_finding, flat_inside_finding)
    for unsafe_set in problem.unsafe:
        if unsafe_set.sampling == "cell" or problem.grid.subgrid(unsafe_set.axes).size > most:
            continue
        each = (find(samples, unsafe_set, t) for t in _few_moments(problem, unsafe_set) for find in kinds)
        tell(next(filter(None, each), None))


def check_sets(problem: ReachAvoidProblem) -> None:
    """Warn of what is wrong with sets and velocities, for methods that are not on the grid.

    That is of what `check_seams` finds, and of unsafe sets that no node is in at any time, or that hide between the
    nodes; between more than `MOST_NODES` only where no node is in the set. Methods on the grid call `check_resolution`
    instead, and see for themselves whether a node is ever in danger.
    """
    check_seams(problem)
    samples = Samples(problem)
    for unsafe_set in problem.unsafe:
        nowhere = _nowhere_finding(samples, unsafe_set)
        sought = nowhere or problem.grid.subgrid(unsafe_set.axes).size <= MOST_NODES
        times = _few_moments(problem, unsafe_set) if sought else []
        hidden = (_hidden_finding(samples, unsafe_set, t, ASKED) for t in times)
        tell(next(filter(None, hidden), nowhere))


def _few_moments(problem: ReachAvoidProblem, unsafe_set: UnsafeSet) -> list[float]:
    """Times, s, at which a set is looked at closely: `TIMES`, from 0 to the last step, or 0 if it does not move."""
    return np.linspace(0.0, problem.most_steps * problem.delta, TIMES if unsafe_set.moving else 1).tolist()


def costly_error_finding(problem: ReachAvoidProblem) -> Finding | None:
    """The finding that errors of a `Sensing` without memory cost more along an axis than the inputs change, or None.

    It names the first axis along which 2 E, what the errors cost in an interval, is at least half the range of the
    velocities under all inputs, times delta. Axes along which the inputs change nothing are left out. Velocities are
    without a disturbance, at the first step, at `STATES` random states (of seed 0). None also without a `Sensing`.
    """
    sensing, grid = problem.sensing, problem.grid
    if not sensing or sensing.remembers:
        return None
    states = np.random.default_rng(0).uniform(grid.lower, grid.upper, (STATES, grid.ndim))
    still, t = np.zeros((STATES, problem.dynamics.disturbance_dim)), problem.time(0)
    speeds = [problem.dynamics.velocity_at(states, j, still, t) for j in range(len(problem.inputs))]
    changed, costs = problem.delta * np.ptp(speeds, axis=0).max(axis=0) / 2, 2 * problem.half_widths[0]
    for axis in np.flatnonzero((changed > 0) & (costs >= changed * (1 - 1e-9))).tolist():
        return Finding(
            f"an input changes {grid.names[axis]} by {changed[axis]:.3g} in an interval, and what the sensing leaves "
            f"open of it costs {costs[axis]:.3g} in each: sets that are to be kept for many steps are empty. ",
            float(costs[axis]),
            "Use Sensing(..., memory=True) and ask Controller.step, or a longer delta",
        )
    return None


def check_seams(problem: ReachAvoidProblem) -> None:
    """Warn of what does not fit together where a periodic axis closes, and of a `Sensing` with too large an error.

    That is of unsafe sets and targets that are cut off there (`_cut_off_finding`), of velocities that jump there
    (`_turning_over_finding`), and of errors that cost more than inputs change (`costly_error_finding`): one warning of
    each set, one of velocities.
    """
    for part in problem.all_sets:
        tell(next(filter(None, (_cut_off_finding(problem, part, t) for t in _moments(problem, part.moving))), None))
    tell(
        next(
            filter(
                None, (_turning_over_finding(problem, t) for t in _moments(problem, problem.dynamics.depends_on_time))
            ),
            None,
        )
    )
    tell(costly_error_finding(problem))


def _moments(problem: ReachAvoidProblem, timed: bool) -> list[float]:
    """Times, s, from 0 to the problem's last step, at most `SPANS` + 1; 0 alone if not `depends_on_time`."""
    count = min(problem.most_steps, SPANS) if timed else 0
    return np.linspace(0.0, problem.most_steps * problem.delta, count + 1).tolist()


@lru_cache(maxsize=8)  # what moves is looked at many times
def _seams(grid: Grid, most: int) -> "list[tuple[int, FloatArray, FloatArray]]":
    """For each periodic axis its number, points (M, ndim) just before its upper end, and the same at its lower end.

    They are `most` random points (of seed 0), half of their coordinates at nodes, and all nodes of the seam if these
    are at most `most`. Cached: the arrays are shared and must not be written.
    """
    rng, found = np.random.default_rng(0), list[tuple[int, FloatArray, FloatArray]]()
    for axis in np.flatnonzero(grid.periodic).tolist():
        sides = [grid.nodes(k) if k != axis else np.zeros(1) for k in range(grid.ndim)]
        drawn = np.stack([rng.choice(side, most) for side in sides], axis=1)
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
    """The finding that a set is cut off where a periodic axis closes, at time t; None where it is not.

    It is if the level-set function differs in sign on both sides of the seam, by more than 1e-6 of its largest absolute
    value at random states.
    """
    grid = problem.grid.subgrid(part.axes)
    for axis, before, after in _seams(grid, SEAM):
        first, last = np.split(part.level_set(np.concatenate([before, after]), t), 2)
        if not (turns := (first > 0) != (last > 0)).any():
            continue
        inside = np.random.default_rng(0).uniform(grid.lower, grid.upper, (SEAM, grid.ndim))
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
    """The finding that the least or the greatest velocity jumps where a periodic axis closes, at time t; else None.

    A jump is a difference of more than 1e-6 of the greatest velocity there. Velocities that are undefined at the seam
    are passed over.
    """
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


def _nowhere_finding(samples: Samples, unsafe_set: UnsafeSet) -> Finding | None:
    """The finding that no node is in an unsafe set, in any of `SPANS` intervals if it moves; None where one is."""
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


def _hidden_finding(samples: Samples, unsafe_set: UnsafeSet, t: float, so: str = IGNORED) -> Finding | None:
    """The finding that part of an unsafe set lies between the nodes at time t; None where no such part is found.

    Such a part lies in a cell of which no corner, nor any corner of a neighbouring cell, is in the set. A cell is
    searched if the least value at its corners is at most half the sum, over the axes, of the largest change between
    neighbouring nodes; those of least value come first. At most about `SOUGHT` values of the function are computed, so
    a part may be overlooked.

    so : what follows from it, the end of the finding's sentence.
    """
    grid, values = samples.grid.subgrid(unsafe_set.axes), samples.sample(unsafe_set, t)
    spacing = np.array(grid.spacing)
    bound, corners = sum(steepest(grid, values, axis) for axis in range(grid.ndim)) / 2, values
    for axis in range(grid.ndim):
        corners = np.minimum(*grid.edges(corners, axis))
    seen = corners <= 0
    for axis in range(grid.ndim):
        seen = seen | neighbour(grid, seen, axis, -1, False) | neighbour(grid, seen, axis, 1, False)
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


def _abrupt_finding(samples: Samples, unsafe_set: UnsafeSet, t: float) -> Finding | None:
    """The finding that a level-set function g jumps at the set's boundary at time t; None if it does not.

    It does if the median of |g(z)| / |change of g between two nodes| is `ABRUPT` or more. The two are neighbours, one
    inside and one outside, and z is the zero of the linear interpolant between them. Of each axis at most `CROSSINGS`
    pairs are looked at, drawn at random (seed 0). None also if there are no such pairs.
    """
    grid, values, off = samples.grid.subgrid(unsafe_set.axes), samples.sample(unsafe_set, t), list[FloatArray]()
    rng = np.random.default_rng(0)
    for axis in range(grid.ndim):
        here, there = grid.edges(values, axis)
        crossing = np.flatnonzero((here > 0) != (there > 0))
        if crossing.size > CROSSINGS:
            crossing = rng.choice(crossing, CROSSINGS, replace=False)
        if crossing.size:
            one, other = here.ravel()[crossing], there.ravel()[crossing]
            places = np.stack(np.unravel_index(crossing, here.shape), axis=1).astype(float)
            places[:, axis] += one / (one - other)  # where the interpolant is zero
            at = unsafe_set.level_set(grid.wrapped(np.array(grid.lower) + places * grid.spacing), t)
            off.append(np.abs(at) / np.abs(one - other))
    if not off or (share := float(np.median(np.concatenate(off)))) < ABRUPT:
        return None
    return Finding(
        f"the level-set function of {unsafe_set.name!r} jumps at the set's boundary, like an indicator function, so "
        "it is located to half a cell at best; ",
        share,
        "use a distance to the set (sdhj.UnsafeSet.from_map computes one from a map)",
    )


ZERO = 1e-3  # cells
FLAT = 1.5  # cells: from two on as many collide as with a signed distance (a car beside a square, 5,000 runs)


def flat_inside_finding(samples: Samples, unsafe_set: UnsafeSet, t: float) -> Finding | None:
    """The finding that a level-set function is flat inside, so that differences wear the set down; None if not.

    It is if it falls to a value less than `FLAT` cells below zero and is constant, to rounding, around some node there;
    a cell is the median change from node to node at the boundary. None also where it is 0 in the whole set, where
    velocities do not depend on the state, and unless sampling="nodes".
    """
    if samples.dynamics.stateless or unsafe_set.sampling != "nodes":
        return None
    grid, values = samples.grid.subgrid(unsafe_set.axes), samples.sample(unsafe_set, t)
    least, changes = float(values.min()), list[FloatArray]()
    bottom = values <= least + 1e-9 * float(np.abs(values).max())
    for axis in range(grid.ndim):
        here, there = grid.edges(values, axis)
        changes.append(np.abs(here - there)[(here > 0) != (there > 0)])
        bottom &= neighbour(grid, bottom, axis, -1, False) & neighbour(grid, bottom, axis, 1, False)
    crossed = np.concatenate(changes)
    if least >= 0 or not bottom.any() or not crossed.size:
        return None
    cells = -least / max(float(np.median(crossed)), 1e-300)
    if not ZERO < cells < FLAT:  # one that is 0 in the whole set loses no more than a signed distance
        return None
    return Finding(
        f"the level-set function of {unsafe_set.name!r} is flat inside the set, {-least:.2g} below zero, which is "
        f"{cells:.2g} of what it changes by from node to node at the boundary, t = {t:g}: finite differences wear such "
        "a set down, so the tubes may leak into it. ",
        cells,
        'Use a distance that is negative inside; or UnsafeSet(..., sampling="steep"), which enlarges the set by less '
        'than a cell; or sampling="cell", which enlarges it by a cell',
    )


DEEP = 0.75  # cells, of the deepest node across a wall
ROOMY = 2 * DEEP + 1  # cells, of a wall so thick that some node is that deep wherever it lies
LEAST_SHOWN = 0.1  # cells: a message names no thickness below this


def too_thin_finding(samples: Samples, unsafe_set: UnsafeSet, t: float) -> Finding | None:
    """The finding that a wall or a dot is too thin for finite differences at time t, with how many nodes would do.

    Thin along an axis is what `_thickness` finds, unless something that is not thin lies within two nodes. A wall is
    thin across at three nodes along it or more, and may lie aslant; a dot is thin along all axes. The number in the
    finding is the least thickness, in cells, at the thinnest such node. None where there is neither, where velocities
    do not depend on the state, or with sampling="steep".
    """
    if samples.dynamics.stateless or unsafe_set.sampling == "steep":
        return None
    grid, values = samples.grid.subgrid(unsafe_set.axes), samples.sample(unsafe_set, t)
    cells = np.array([_thickness(grid, values, axis) for axis in range(grid.ndim)])
    thin = np.isfinite(cells)
    deepest = values
    for axis in range(grid.ndim):
        deepest = np.minimum.reduce([deepest, *(neighbour(grid, deepest, axis, by, np.inf) for by in (-1, 1))])
    found = thin.all(axis=0) & (values == deepest)  # dots, not the tips of what is deeper behind
    for across, along in permutations(range(grid.ndim), 2):  # a wall may lie aslant
        near = np.logical_or.reduce([neighbour(grid, thin[across], across, by, False) for by in (-1, 0, 1)])
        found |= thin[across] & neighbour(grid, near, along, -1, False) & neighbour(grid, near, along, 1, False)
    for axis in range(grid.ndim):  # a chord that grazes what is thick beside it is no wall
        thick = (values <= 0) & ~thin[axis]
        for along, by in product(range(grid.ndim), (1, 2)):
            thick = thick | neighbour(grid, thick, along, -by, False) | neighbour(grid, thick, along, by, False)
        thin[axis] &= ~thick
    found &= thin.any(axis=0)
    if not found.any():
        return None
    place = np.unravel_index(np.where(found, cells.min(axis=0), np.inf).argmin(), grid.shape)
    names = [samples.grid.names[axis] for axis in unsafe_set.axes]
    where = ", ".join(f"{name} = {grid.nodes(axis)[place[axis]]:.4g}" for axis, name in enumerate(names))
    wrong = [axis for axis in range(grid.ndim) if thin[(axis, *place)]]
    thick = [f"{float(cells[(axis, *place)]) * grid.spacing[axis]:.2g} along {names[axis]}" for axis in wrong]
    needed = [int(np.ceil((grid.shape[axis] - 1) * ROOMY / cells[(axis, *place)])) + 1 for axis in wrong]
    steep = 'UnsafeSet(..., sampling="steep"), which prevents that and enlarges the set by less than a cell'
    more = " and ".join(f"{n} nodes along {names[axis]}" for n, axis in zip(needed, wrong, strict=True))
    nodes = samples.grid.size * float(np.prod([n / grid.shape[axis] for n, axis in zip(needed, wrong, strict=True)]))
    fits = 8 * nodes * samples.problem.most_steps < (available() or [np.inf])[0]
    return Finding(
        f"the unsafe set {unsafe_set.name!r} is too thin for the grid at {where}, t = {t:g}: it is about "
        f"{', '.join(thick)} "
        "thick there, and finite differences erode a set that is not some cells thick, so the tubes may leak through "
        "it. ",
        min(float(cells[(axis, *place)]) for axis in wrong),
        "Use " + (f"{more}, or {steep}" if fits else f"{steep}; {more} would need more memory than is available"),
    )


def _thickness(grid: Grid, values: FloatArray, axis: int) -> FloatArray:
    """How thick {values <= 0} is along an axis, in cells, at the nodes of thin pieces; +inf elsewhere: (*shape).

    A thin piece has one or two nodes along the axis, which lie less than `DEEP` cells deep. Thickness is measured
    between the zeros of the interpolant; it is at least `LEAST_SHOWN`.
    """
    last, before, after, further = (neighbour(grid, values, axis, by, -np.inf) for by in (-2, -1, 1, 2))
    thickness = np.full(values.shape, np.inf)
    alone, pairs = (before, values, values, after), ((before, values, after, further), (last, before, values, after))
    with np.errstate(invalid="ignore", divide="ignore"):
        for left, first, second, right in (alone, *pairs):  # from outside to outside
            inside = (left > 0) & (first <= 0) & (second <= 0) & (right > 0)
            thin = inside & (-np.minimum(first, second) < DEEP * np.maximum(left - first, right - second))
            across = first / (first - left) + second / (second - right) + (first is not second)
            thickness = np.where(thin, np.maximum(across, LEAST_SHOWN), thickness)
    return thickness
