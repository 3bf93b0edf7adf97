"""Whether the parts of a problem fit one another: formulas the functions they were read from, sets the nodes, sensing
all the rest.

All of these checks raise ValueError, and return nothing where all is well. `ReachAvoidProblem` calls them when it is
made.
"""

import math
from itertools import product
from typing import Any

import numpy as np

from sdhj.common.checks import whole
from sdhj.common.memory import available
from sdhj.common.remembering import FloatArray
from sdhj.formulas.formula import Formula
from sdhj.problem.grid import Grid
from sdhj.problem.interval import INSTANTS
from sdhj.problem.nodes import checked_values
from sdhj.problem.sets import TargetSet, UnsafeSet

COMPARED_STATES = 200  # at which a formula is compared with the function that it was read from
SWEPT_STATES = 1000  # at which `swept` is compared with the level-set function, each at INSTANTS of every interval
MOST_LOOKED_AT, DRAWN = 2**14, 2**8  # pieces of a grid, and of a larger one
EXCUSED = 1e-9  # of the values: that is no difference


def compared_states(grid: Grid) -> FloatArray:
    """States (`COMPARED_STATES`, ndim) at which functions are compared with their formulas."""
    rng = np.random.default_rng(0)  # a problem is refused or not, whenever it is made
    states = rng.uniform(grid.lower, grid.upper, (COMPARED_STATES, grid.ndim))
    for axis in range(grid.ndim):  # a tenth has coordinates of nodes, ends or zeros, where formulas may branch
        inside = [0.0] if grid.lower[axis] <= 0.0 <= grid.upper[axis] else []
        last = [] if grid.periodic[axis] else [grid.upper[axis]]  # where it closes it is the first one
        kinds = np.concatenate([grid.nodes(axis), [grid.lower[axis]], last, inside])
        states[: COMPARED_STATES // 10, axis] = rng.choice(kinds, COMPARED_STATES // 10)
    return states


def compared_times(problem: Any) -> list[float]:
    """The six times, s, at which functions are compared with their formulas."""
    # some are within the first interval, and one past the last, as are times with a delay
    return [share * problem.delta for share in (0.0, 0.7)] + [
        share * problem.delta * problem.most_steps for share in (0.31, 0.59, 0.83, 1.01)
    ]


def check_set(problem: Any, part: TargetSet | UnsafeSet) -> None:
    """Raise ValueError where axes, inputs or functions of a set do not fit the problem, or the user's functions."""
    ndim, count = problem.grid.ndim, len(problem.inputs)
    if not part.axes or list(part.axes) != sorted(set(part.axes)) or not set(part.axes) <= set(range(ndim)):
        where = f"axes of the grid, from 0 to {ndim - 1}, ascending"
        raise ValueError(f"axes of {part.name!r} must be {where}, got {part.axes}")
    if isinstance(part, UnsafeSet) and part.inputs is not None and part.inputs[-1] >= count:
        raise ValueError(f"inputs of {part.name!r} must be numbers from 0 to {count - 1}, got {part.inputs}")
    states, times = compared_states(problem.grid.subgrid(part.axes)), compared_times(problem)
    spans = [(t, t + problem.delta) for t in times]
    for formula, each in ((part.level_set, [(t,) for t in times]), (getattr(part, "swept", None), spans)):
        if isinstance(formula, Formula):  # the next problem that has the set does not compare it again
            formula.compare_with_source(states, each)
    if isinstance(part, UnsafeSet):
        corner = np.array([[problem.grid.lower[axis] for axis in part.axes]])
        between = "swept" if problem.view_time == "instantaneous" else problem.view_time  # as games sweep time steps
        part.over(corner, 0.0, problem.delta, between)  # refuses a black box of which too little is known
        if part.moving and part.swept is not None and problem.view_time == "swept":
            check_swept(problem, part)


def check_swept(problem: Any, unsafe_set: UnsafeSet) -> None:
    """Raise ValueError where `swept` is above the level-set function at a time of the interval."""
    grid, rng = problem.grid.subgrid(unsafe_set.axes), np.random.default_rng(0)
    points = rng.uniform(grid.lower, grid.upper, (SWEPT_STATES, grid.ndim))
    # as long as `span`, jitter counted in
    lasting = problem.sensing.hold(problem.delta)[0]
    for step in np.unique(np.linspace(0, problem.steps - 1, min(problem.steps, SWEPT_STATES)).astype(int)).tolist():
        t0, t1 = problem.span(step)
        swept = unsafe_set.swept(points, t0, t1)
        for t in (t0 + INSTANTS * lasting).tolist():
            excess = swept - unsafe_set.level_set(points, t)
            # What may be rounding is excused.
            if excess.max() > EXCUSED * float(np.abs(swept).max()):
                worst = points[int(excess.argmax())].tolist()
                raise ValueError(
                    f"swept of {unsafe_set.name!r} over [{t0:g}, {t1:g}] is {excess.max():.3g} above the level-set "
                    f"function at t = {t:g}, at {worst}; it must be at most that at every time of the interval, or "
                    "leave it out: the library then sweeps the set itself"
                )


def in_goal(problem: Any, points: FloatArray, step: int) -> FloatArray:
    """Which points (M, ndim) of the grid are in the target and in no unsafe set at any time of the step: (M,)."""
    # `Samples.goal` says the same at all nodes, for the methods on a grid: both change together
    t, jitter, inside = problem.time(step), problem.sensing.jitter, np.ones(len(points), np.bool_)
    for part in problem.all_sets:
        if getattr(part, "inputs", None) is not None or not inside.any():
            continue
        at = points[inside].take(part.axes, axis=1)
        if jitter and part.moving and isinstance(part, UnsafeSet):
            values = part.over(at, t - jitter, t + jitter, problem.view_time)
        else:
            values = part.level_set(at, t)
        values = checked_values(values, at, part.name)
        inside[inside] = values <= 0 if part is problem.target else values > 0
    return inside


def try_goals(problem: Any) -> None:
    """Raise ValueError, with the likely cause, where at no step some node is in the target and safe."""
    steps, target = range(1 if problem.time_invariant else problem.steps + 1), problem.target
    count, rng = math.prod(problem.grid.piece_shape[1]), np.random.default_rng(0)  # may be more than 64 bits hold
    order = rng.permutation(count) if count <= MOST_LOOKED_AT else rng.integers(min(count, 2**63 - 1), size=DRAWN)
    for points in problem.grid.pieces(order):  # up to the first that has such a node
        if any(in_goal(problem, points, step).any() for step in steps):
            return
    if count > MOST_LOOKED_AT:  # of so many pieces `DRAWN` were looked at, which shows nothing
        return
    if problem.has_no_target:
        raise ValueError("every grid node is in an unsafe set: check the signs (negative is inside)")
    points = problem.grid.subgrid(target.axes).points()
    if not any((target.level_set(points, problem.time(step)) <= 0).any() for step in steps):
        raise ValueError(
            "no grid node is in the target at any step: it lies off the grid or falls between nodes, or its "
            "level-set function has the wrong sign (negative is inside); move or enlarge it, or use more nodes"
        )
    raise ValueError(
        "no grid node is in the target and safe at any step: the unsafe sets swallow the target; move it, or "
        "check the sign of their level-set functions (negative is inside)"
    )


def check_sensing(problem: Any) -> None:
    """Raise ValueError where the sensing does not fit grid, inputs, delta, dynamics, ends or target."""
    sensing, grid, delta = problem.sensing, problem.grid, problem.delta
    if isinstance(sensing.error, tuple) and len(sensing.error) != grid.ndim:
        raise ValueError(f"error must be one number or {grid.ndim}, one for each axis, got {len(sensing.error)}")
    whole("rest", sensing.rest, least=0, most=len(problem.inputs) - 1)
    # the checker asks the same of a file (`read_sensing` in `sdhj.certified.check.stated`)
    if sensing.delay + 2 * sensing.jitter > delta:
        raise ValueError(
            f"delay + 2 jitter must be at most delta, {delta:g} s, or a measurement could come before the previous "
            f"input has started; got {sensing.delay:g} + 2 x {sensing.jitter:g}"
        )
    steps = range(1 if problem.time_invariant else problem.steps + 1)
    if sensing.jitter and (
        problem.target.moving or problem.dynamics.depends_on_time or problem.view_time == "instantaneous"
    ):
        raise ValueError(
            "with jitter sampling times are uncertain: neither dynamics nor target may depend on time, and view_time "
            'must be "swept" or "sampled"'
        )
    if grid.has("frees"):
        raise ValueError('with sensing no end of the grid may be "safe": it is uncertain when the state has passed it')
    free = available()
    if free is not None and grid.sampling_bytes > free[0]:
        return  # and `solve` says so
    if not any(_some_box_in_goal(problem, points, step) for points in grid.pieces() for step in steps):
        raise ValueError(
            f"the state is known to within {np.round(problem.half_widths[0], 6).tolist()} only, and no box of twice "
            "that around a grid node is in the target and safe; reduce error or delay, or enlarge the target"
        )


def _some_box_in_goal(problem: Any, points: FloatArray, step: int) -> bool:
    """Whether of some point all corners of the box of 2 E around it are `in_goal`."""
    points = points[in_goal(problem, points, step)]
    # twice: M is the goal shrunk by E, and W, which is promised, M shrunk by E (`sdhj.problem.sensing`)
    for off in 2 * problem.half_widths[0] * np.array([*product((-1.0, 1.0), repeat=problem.grid.ndim)]):
        corners = problem.grid.wrapped(problem.grid.clipped(points + off))
        inside = ~problem.grid.beyond(corners, "fails")  # at walls they are clipped
        inside[inside] = in_goal(problem, corners[inside], step)
        points = points[inside]
    return len(points) > 0
