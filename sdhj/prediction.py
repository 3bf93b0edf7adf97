"""Measurement error, delay and jitter: what a robot that does not measure exactly, at once and on time can be promised.

The controller is asked at t_k = k delta. It sees y with |y - q(t_k)| <= e on each axis, and the input that it chooses
starts at s_k = t_k + d, d <= delta; until then the one before is held (before the first: the rest input). An answer
that is ready sooner waits: d is exact. What is not are the instants: t_k, and s_k with it, comes up to j early or late,
so that an input is held for anything from delta - 2 j to delta + 2 j. The adversary has a say in all of it: the
disturbance, the error of each measurement, each instant; it knows everything.

*Prediction.* When an input starts, the controller has moved the measurement on by d with the input before, without an
adversary. The state is then in the box of half-widths E around the prediction, however the adversary played:

    E = w(d),    w(0) = e,    dw/dt = A w + b,

A the Lipschitz constants of the velocity, axis by axis, and b the most that the adversary adds to it. For velocities
that do not depend on the state E = e + d b: a delay is an error that is known. Jitter adds nothing, as d is exact.

*Sets*, all of them at the time s_k:

* K_k^n(u): the states from which u keeps clear of G whenever the interval begins and ends within jitter, and ends,
  whenever that is, in W_{k+1}^{n-1}. The stopping time is the adversary's: the value is a running maximum over the
  durations.
* M_k^n: the predictions y for which one u is right for every state of y + E: M_k^{n-1} united over u with K_k^n(u)
  shrunk by E. M_k^0 is L minus G, G at every time that jitter allows, shrunk by E: success is success that the
  controller knows of. (With jitter neither L nor the dynamics may depend on time.)
* W_k^n: M_k^n shrunk by E, the states of which every prediction is good.

From a state of W_k^n every prediction is in M_k^n, has n' <= n steps to go and an input right for the whole box, the
true state in it: it keeps clear and ends in W_{k+1}^{n'-1}. By induction the target is reached, and known to be
reached, within n steps. The controller reads M and K; what a state is promised is W. What happens before s_0 is not
part of it. The sets are not the largest: a prediction is judged by itself, without those before it, and a state and
the error of its prediction count as independent, though with d > 0 one disturbance makes both.

On a grid, shrinking a set by a box is the maximum of its level-set function over the box (`sdhj.hopf_lax`, "linear": of
what the controller reads between the nodes). Near an unsafe end the box has to be on the grid. Whether W holds a state
between the nodes is asked of M itself, all around it.

Certified sets are of cells, and M_k^n holds a cell y where the image of y + E, widened by E, is in M_{k+1}^{n-1}: for a
cell that is a point the same. Their E is bounded by intervals (`sdhj.certified.guesses`), not by differences.

*In closed form.* dq = u + v, u in {-1, 0, 1}, |v| <= b < 1, target |q| <= r; T = delta + 2 j, S = delta - 2 j. Here
E = e + d b, and the sets are intervals around 0. M^0 has the half-width r - E; W^n has E less than M^n. u = 1 leads
[-w - (1 - b) S, w - (1 + b) T] into [-w, w]: its low end may be stopped early, its high end late. With w the half-width
of W^{n-1}, shrunk by E and united with M^{n-1} (without a gap while 2 w >= (1 + b) T),

    half-width of W^n = r - 2 E + n ((1 - b) (delta - 2 j) - 2 E)

as long as the last term is positive: each step gains what the slowest robot moves in the shortest interval, less 2 E.
Nothing beyond the target is left from e = (1 - b) (delta - 2 j) / 2 - d b on. A wall at q >= c cuts W^n off at c - 2 E.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from sdhj.batches import NOT_ADMISSIBLE
from sdhj.checks import finite_array, number, states_array, whole
from sdhj.dynamics import INSTANTS
from sdhj.grid import FloatArray
from sdhj.hopf_lax import maximum_over_boxes
from sdhj.problem import ReachAvoidProblem
from sdhj.sensing import shrunk

if TYPE_CHECKING:
    from sdhj.controller import Controller

TERMS = 60  # of an exponential series
STRIDES = 8  # steps of order 4 in which a measurement is moved on
CLOCK = 1e-9  # of times, s


def check_sensing(problem: ReachAvoidProblem) -> None:
    """Raise ValueError where a problem does not fit its sensing."""
    sensing, grid, delta = problem.sensing, problem.grid, problem.delta
    if isinstance(sensing.error, tuple) and len(sensing.error) != grid.ndim:
        raise ValueError(f"error must be one number or {grid.ndim}, one for each axis, got {len(sensing.error)}")
    if problem.steps is None:
        raise ValueError("sensing is for problems with a number of steps so far, got steps=None; give the problem one")
    whole("rest", sensing.rest, least=0, most=len(problem.inputs) - 1)
    if sensing.delay > delta:
        raise ValueError(
            f"delay must be at most delta, {delta:g} s: the input before is held meanwhile; got {sensing.delay:g}"
        )
    if 2 * sensing.jitter > delta:
        raise ValueError(f"jitter must be at most half of delta, {delta / 2:g} s, got {sensing.jitter:g}")
    if sensing.delay + 2 * sensing.jitter > delta:
        raise ValueError(
            f"delay + 2 jitter must be at most delta, {delta:g} s, or a measurement may come before the input "
            f"before it has started; got {sensing.delay:g} + 2 x {sensing.jitter:g}"
        )
    steps, j = range(problem.steps + 1), sensing.jitter
    goals = (problem.target_at(problem.time(step) + late) for step in steps for late in (-j, j))
    moves = j and not all(np.array_equal(goal, problem.target_at(0.0)) for goal in goals)
    if j and (moves or problem.dynamics.timed or problem.view_time == "instantaneous"):
        raise ValueError(
            "jitter leaves the time open: neither dynamics nor target may depend on it, and view_time must be "
            '"swept" or "sampled"'
        )
    if any(np.isfinite(face).any() for face in grid.faces("safe")):
        raise ValueError('with sensing no end of the grid may be "safe": nobody knows that the state is past it')
    goals = (problem.goal(step) for step in steps)
    if not any((shrunk(problem, shrunk(problem, goal)) <= 0).any() for goal in goals):
        raise ValueError(
            f"the state is known to within {np.round(problem.half_widths[0], 6).tolist()} only, and no grid node has "
            "twice that around it inside the target and safe; measure better or sooner, or enlarge the target"
        )


def rates(problem: ReachAvoidProblem) -> tuple[FloatArray, FloatArray]:
    """A (ndim, ndim) and b (ndim,): the largest differences between neighbouring nodes, and the adversary's most.

    Between two nodes a velocity that is curved may be steeper, by a share of second order in their distance.
    """
    grid, dynamics, axes = problem.grid, problem.dynamics, tuple(range(problem.grid.ndim))
    points = np.zeros((1, grid.ndim)) if dynamics.stateless else grid.points()
    slope, push = np.zeros((grid.ndim, grid.ndim)), np.zeros(grid.ndim)
    steps = range(problem.steps + 1 if dynamics.timed else 1)
    times = [problem.delta * (step + share) for step in steps for share in (INSTANTS if dynamics.timed else [0.0])]
    for j, t in product(range(len(problem.inputs)), times):
        gain = dynamics.gain_at(points, j, t) * dynamics.bounds_at(j, t)
        push = np.maximum(push, np.abs(gain).sum(axis=2).max(axis=0))
        if dynamics.stateless:
            continue
        parts = np.concatenate([dynamics.drift_at(points, j, t)[..., None], gain], axis=2)
        parts = parts.reshape(*grid.shape, *parts.shape[1:])
        for axis in axes:
            one, other = grid.edges(parts, axis)
            steepest = np.abs(other - one).sum(axis=-1).max(axis=axes) / grid.spacing[axis]
            slope[:, axis] = np.maximum(slope[:, axis], steepest)
    return slope, push


def carried(slope: FloatArray, push: FloatArray | float, box: FloatArray, duration: float) -> FloatArray:
    """w(duration) of dw/dt = slope w + push, w(0) = box: (ndim,), by its series, which has no negative terms."""
    ndim = len(box)
    rate, term = np.zeros((ndim + 1, ndim + 1)), np.array([*box, 1.0])
    rate[:ndim, :ndim], rate[:ndim, ndim] = slope, push
    total = term.copy()
    for place in range(1, TERMS):
        term = rate @ term * (duration / place)
        total += term
    return total[:ndim]


def boxes(problem: ReachAvoidProblem) -> tuple[FloatArray, FloatArray]:
    """E, and by how much it widens what can be reached to where the next prediction may be; both (ndim,)."""
    sensing, nothing = problem.sensing, np.zeros(problem.grid.ndim)
    slope, push = rates(problem)
    box = carried(slope, push, nothing + np.array(sensing.error), sensing.delay)
    return box, box + carried(slope, 0.0, box, problem.delta + 2 * sensing.jitter)


def less_the_box(problem: ReachAvoidProblem, values: FloatArray, axes: Sequence[int]) -> FloatArray:
    """Level-set function of the places around which the whole box E is in {values <= 0}, on the grid of some axes."""
    grid, box = problem.grid.subgrid(axes), problem.half_widths[0][list(axes)]
    ((_, out),) = maximum_over_boxes(grid, values, -box[None], box[None], "linear")
    for axis, (low, high) in enumerate(zip(*grid.faces("unsafe"), strict=True)):
        nodes = grid.nodes(axis)
        beyond = grid.lift(box[axis] - np.minimum(nodes - low, high - nodes), (axis,))  # -inf where no end is unsafe
        out = np.maximum(out, beyond.astype(out.dtype))
    return out


def spots_of_the_box(problem: ReachAvoidProblem, points: FloatArray) -> FloatArray:
    """Places (M, V, ndim) in the box E around points (M, ndim), among them where what is multilinear is largest there.

    On each axis the ends and the nodes in between, held at the walls; and the points themselves.
    """
    grid, columns = problem.grid, []
    for axis, (width, lower, h) in enumerate(zip(problem.half_widths[0], grid.lower, grid.spacing, strict=True)):
        x = points[:, axis, None]
        nodes = lower + h * (np.ceil((x - width - lower) / h) + np.arange(int(2 * width / h) + 1))
        between = [x - width, np.minimum(nodes, x + width), x + width]
        columns.append(np.concatenate(between, axis=1) if width else x)
    places = np.indices([column.shape[1] for column in columns]).reshape(len(columns), -1)
    found = np.stack([column[:, place] for column, place in zip(columns, places, strict=True)], axis=-1)
    return np.concatenate([points[:, None], grid.held(found)], axis=1)


def predicted(problem: ReachAvoidProblem, measured: FloatArray, previous: FloatArray, step: int = 0) -> FloatArray:
    """Measurements (M, ndim) of t_k moved on by the delay with the inputs held meanwhile (M,): (M, ndim).

    Held at all ends of the grid, where the state is, and without an adversary.
    """
    delay, grid = problem.sensing.delay, replace(problem.grid, ends=(("wall", "wall"),) * problem.grid.ndim)
    states = grid.held(states_array("a measurement", measured, grid.ndim))
    if not delay:
        return states
    interval, parts = replace(problem.interval(step), grid=grid), 1 if problem.dynamics.constant else STRIDES
    still = np.zeros((len(states), problem.dynamics.adversaries))
    for part in range(parts):
        t = problem.time(step) - delay * (1 - part / parts)
        states = interval.advance(states, previous, still, t, delay / parts)
    return states


@dataclass(frozen=True)
class Action:
    """What to do from the next start of an input on, one delay after the measurement.

    Attributes
    ----------
    input : int
        Index into problem.inputs.
    step : int
        The instant that the measurement was taken for.
    steps_to_go : int or None
        As `Controller.steps_to_go`, of the prediction; 0 is success, None where it is not admissible.
    promised : bool
        Whether the table promises it, `Batch.promised`. Never where the instant was missed.
    late : float
        By how much the measurement came after its instant, s; negative where it came before.
    missed : bool
        Whether that is more than the jitter the table was solved for, or no measurement came at the instant before.
    """

    input: int
    step: int
    steps_to_go: int | None
    promised: bool
    late: float
    missed: bool


def acted(controller: "Controller", measurement: FloatArray, time: float, fallback: bool) -> Action:
    """As `Controller.step`, which keeps the answer as `controller.last`."""
    problem, last = controller.problem, controller.last
    k = round(number("time", time, least=-problem.delta / 2) / problem.delta)
    last = None if k == 0 else last
    if last is not None and k <= last.step:
        raise ValueError(f"time must go on: instant {last.step} has been answered, and {time:g} s is for instant {k}")
    late = time - k * problem.delta
    missed = abs(late) > problem.sensing.jitter + CLOCK * max(1.0, time) or k != (last.step if last else -1) + 1
    step, held = 0 if problem.timeless else k, last.input if last else None
    state = controller.predict(finite_array("a measurement", measurement, (problem.grid.ndim,)), held, step)
    batch = controller.batch(state[None], step)
    if step == controller.table.steps:
        raise ValueError(f"step {step} is the last: no interval is left to hold an input over")
    chosen = int(controller.choose(batch)[0])
    to_go = controller.steps_to_go(state, step)
    if chosen == NOT_ADMISSIBLE:
        chosen = controller.fallback(state, step).input if fallback else controller.select(state, step)
    return Action(chosen, k, to_go, bool(batch.promised[0]) and not missed, late, missed)
