"""What of a problem can be refuted by asking its functions: imported when the first problem is made.

A set that moves faster than it says, or a `swept` that leaves a part of it out, is met where nobody expects it; a
function that answers differently when it is asked twice makes a table of one problem and a run of another. They are
asked at some nodes, in every step and at uneven times within it: evenly spaced ones would miss what vibrates. In
problems of hundreds of steps each gets fewer times, down to one; only those of more than `MOMENTS` steps are not met in
every one. What comes and goes between those times is not seen here: certificates see it, because there level sets are
called with whole intervals of time (`sdhj.certified.bounds`), and where that goes through no rate is believed.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from sdhj.checks import ARGUMENTS, repeated
from sdhj.dynamics import INSTANTS
from sdhj.grid import FloatArray

if TYPE_CHECKING:
    from sdhj.problem import ReachAvoidProblem, UnsafeSet

MOMENTS = 20_000  # times at most
FEW_STEPS = 50  # steps, each tried in parts
PARTS = 4  # of a step: a run is judged at 20 times of a step, which are then no closer
QUESTIONS = 500_000  # values at most of one function
CHECKED = 5000  # nodes at most
VISITED = 200  # nodes at which velocities are asked for
UNDECIDED_STEPS = 20  # of a problem that has no number of steps
EXCUSED = 1e-9  # that is no change, relative to the values or absolute below one
SINGLE = 1e-5  # of the largest velocity: what computes in single precision rounds otherwise with the number of points


def tried(problem: "ReachAvoidProblem") -> None:
    """Raise ValueError where a function of a problem is not what it says, or no node is where it has to be."""
    _try_dynamics(problem)
    for part in (problem.target, *problem.unsafe):
        nodes = _some_nodes(problem, part.axes, CHECKED)
        _try_answers(f"level set of {part.name!r}", part.level_set, nodes, problem.delta, exact=True)
    for part in problem.unsafe:
        _try_rate(problem, part)
        if part.moving and part.swept is not None and problem.view_time == "swept":
            _try_swept(problem, part)
    _try_goals(problem)


def _moments(problem: "ReachAvoidProblem") -> FloatArray:
    """Times at which sets are tried, ascending: (T,); a delay and jitter go on into one more interval."""
    steps = (problem.steps or UNDECIDED_STEPS) + bool(problem.sensing)
    parts = PARTS if steps <= FEW_STEPS else 1
    if steps * len(INSTANTS) <= MOMENTS:
        return np.unique((np.arange(steps * parts)[:, None] + INSTANTS) * (problem.delta / parts))
    spans = min(steps, MOMENTS)  # one time, drawn, in each
    drawn = (np.arange(spans) + np.random.default_rng(0).random(spans)) / spans
    return np.array([0.0, *drawn, 1.0]) * steps * problem.delta


def _some_nodes(problem: "ReachAvoidProblem", axes: Sequence[int], most: int) -> FloatArray:
    """Nodes of some axes, (M, axes)."""
    grid = problem.grid.subgrid(axes)
    nodes = np.unique(np.linspace(0, grid.size - 1, min(grid.size, most)).astype(np.int64))
    return np.array(grid.lower) + np.stack(np.unravel_index(nodes, grid.shape), axis=1) * np.array(grid.spacing)


def _try_answers(name: str, asked: Callable[..., FloatArray], points: FloatArray, later: float, exact: bool) -> None:
    """It says the same when it is asked again, after another question, and when it is asked of a few of the points."""
    first, _, few = asked(points, 0.0), asked(points, later), slice(1, None, 1 + len(points) // 7)
    repeated(name, first, asked(points, 0.0))
    rtol, atol = (EXCUSED, EXCUSED) if exact else (0.0, SINGLE * float(np.abs(first).max()))
    if not np.allclose(asked(np.ascontiguousarray(points[few]), 0.0), first[few], rtol=rtol, atol=atol):
        raise ValueError(
            f"{name} says something else of a point when it is asked of other points with it; points come in pieces, "
            "and what is said of one must depend on its coordinates alone"
        )


def _try_dynamics(problem: "ReachAvoidProblem") -> None:
    dynamics, points = problem.dynamics, _some_nodes(problem, range(problem.grid.ndim), VISITED)
    functions = dynamics.drift_at, dynamics.gain_at, lambda p, *when: np.array([dynamics.bounds_at(*when)] * len(p))
    for name, function in zip(ARGUMENTS, functions, strict=True):
        if name in dynamics.takes:  # of the first input, and later of the last
            asked = lambda p, t, function=function: function(p, -1 if t else 0, t)  # noqa: E731
            _try_answers(name, asked, points, problem.delta, exact=False)


def _try_rate(problem: "ReachAvoidProblem", part: "UnsafeSet") -> None:
    times = _moments(problem)
    points = _some_nodes(problem, part.axes, min(CHECKED, QUESTIONS // len(times)))
    values = part.level_set(points, 0.0)
    for before, t in pairwise(times.tolist()):
        later, span = part.level_set(points, t), t - before
        changed = float(np.abs(later - values).max())
        if changed > part.rate * span + EXCUSED * (1.0 + float(np.abs(later).max())):
            raise ValueError(
                f"the level-set function of {part.name!r} changes by {changed:.3g} within {span:.3g} s, from t = "
                f"{before:g} on, more than its rate {part.rate:g} allows; give a rate of at least {changed / span:.3g}"
            )
        values = later


def _try_swept(problem: "ReachAvoidProblem", part: "UnsafeSet") -> None:
    assert part.swept is not None
    most = MOMENTS // len(INSTANTS)
    steps = np.unique(np.linspace(0, problem.steps - 1, min(problem.steps, most)).astype(np.int64))
    points = _some_nodes(problem, part.axes, min(CHECKED, QUESTIONS // (len(steps) * len(INSTANTS))))
    for step in steps.tolist():
        (t0, t1), held = problem.span(step), problem.sensing.held(problem.delta)[0]
        swept = part.swept(points, t0, t1)
        repeated(f"swept of {part.name!r}", swept, part.swept(points, t0, t1))
        for t in (t0 + INSTANTS * held).tolist():
            excess = swept - part.level_set(points, t)
            if excess.max() > EXCUSED * (1.0 + float(np.abs(swept).max())):
                worst = points[int(excess.argmax())].tolist()
                raise ValueError(
                    f"swept of {part.name!r} over [{t0:g}, {t1:g}] is {excess.max():.3g} above the level-set "
                    f"function at t = {t:g}, at the node {worst}; it must be at most that at every time of the "
                    "interval, or leave it out: the library then sweeps the set itself"
                )


def _try_goals(problem: "ReachAvoidProblem") -> None:
    steps = range((problem.steps or 0) + 1)
    if any((part.goal(step) <= 0).any() for part in problem.pieces() for step in steps):
        return
    if problem.stays:
        raise ValueError("every grid node is in an unsafe set: check the signs (negative is inside)")
    axes, target = problem.target.axes, problem.target
    points = problem.grid.subgrid(axes).points()
    if not any((target.level_set(points, problem.time(step)) <= 0).any() for step in steps):
        raise ValueError(
            "no grid node is in the target at any step: it lies off the grid or falls between nodes, or its "
            "level-set function has the wrong sign (negative is inside); move or enlarge it, or use more nodes"
        )
    raise ValueError(
        "no grid node is in the target and safe at any step: the unsafe sets swallow the target; move it, or "
        "check the sign of their level-set functions (negative is inside)"
    )
