"""Judges of promises that share no code with what they judge: nothing is imported from sdhj.

Motion is integrated here, forty times in each interval, by the textbook's Runge-Kutta step of order 4; collisions are
looked for each time; the adversary may switch eight times within an interval. `play` and `play_sensed` take a robot as
functions of the caller (a test, `large.py`), and ask the controller for inputs alone. `trial` takes a robot as it is
(`World`), holds it at the end of a grid only where it truly has a wall, and has adversaries of its own; what is judged
is asked for inputs, for whether it promises anything, and, by adversaries that play against its own tube, for that
tube.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Any, Protocol

import numpy as np

PARTS, SUBSTEPS = 8, 5  # of an interval: the adversary's turns, and the steps of the integration in each
STRIDES = 4  # steps of order 4 in which an adversary looks ahead, of what is left and one interval more
FAR = 1e6  # what a tube's level counts for off the grid
WON, COLLIDED, NO_ANSWER, LATE, OFF = "won", "collided", "no answer", "late", "off the grid"
LOST = (COLLIDED, NO_ANSWER, LATE, OFF)


def rk4(velocity, states, t, h):
    k1 = velocity(states, t)
    k2 = velocity(states + h / 2 * k1, t + h / 2)
    k3 = velocity(states + h / 2 * k2, t + h / 2)
    k4 = velocity(states + h * k3, t + h)
    return states + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def play(choose, velocity, signs, target, unsafe, starts, *, delta, steps):
    """Outcomes (M,) of runs from starts (M, ndim): "reached", "collided", "left" or "late".

    choose(states, step) -> (M,) places of inputs, -1 where the controller has none.
    velocity(states, inputs, signs, t) -> (M, ndim); signs (M, D) in [-1, 1] say where in its box the adversary is.
    signs(states, inputs, t, end) -> (M, D), asked PARTS times in an interval that ends at `end`.
    target(states, t), unsafe(states, t) -> (M,), negative inside.
    """
    states, outcomes = np.array(starts, dtype=float), np.full(len(starts), "late", dtype=object)
    running = np.ones(len(starts), bool)

    def end(which, outcome):
        outcomes[which & running] = outcome
        running[which] = False

    end(unsafe(states, 0.0) <= 0, "collided")
    for step in range(steps + 1):
        end(target(states, step * delta) <= 0, "reached")
        if step == steps or not running.any():
            break
        inputs = choose(states, step)
        end(inputs < 0, "left")
        for part in range(PARTS):
            t, h = (step + part / PARTS) * delta, delta / PARTS / SUBSTEPS
            v = signs(states, inputs, t, (step + 1) * delta)
            for sub in range(SUBSTEPS):
                now = t + sub * h
                states = rk4(lambda q, at, v=v, inputs=inputs: velocity(q, inputs, v, at), states, now, h)
                end(unsafe(states, now + h) <= 0, "collided")
    return outcomes


def play_sensed(choose, velocity, signs, mislead, target, unsafe, kept, starts, late, *, delta, delay, steps):
    """As `play`, of robots that measure with an error, act after a delay, and whose clock is off.

    choose(measured, held, step) -> (M,) inputs and (M,) bool, whether the target is said to be reached; held: the
    inputs before, which are kept for the delay. mislead(states) -> what is measured. late (steps + 1, M): how late each
    instant comes. Nothing depends on time. Robots are at `starts` when they measure first, and are promised something
    where kept(states) when they act first. Outcomes also
    "nothing promised", and "wrong" where the target is said to be reached and is not.
    """
    states, outcomes = np.array(starts, dtype=float), np.full(len(starts), "late", dtype=object)
    running, held = np.ones(len(starts), bool), np.zeros(len(starts), np.int64)

    def end(which, outcome):
        outcomes[which & running] = outcome
        running[which] = False

    def drive(states, seconds, parts, watched):
        for _ in range(parts):
            v, h = signs(states, held), (seconds / parts / SUBSTEPS)[:, None]
            for _ in range(SUBSTEPS):
                states = rk4(lambda q, at, v=v: velocity(q, held, v), states, 0.0, h)
                end(watched & (unsafe(states) <= 0), "collided")
        return states

    everyone = np.ones(len(states), bool)
    measured = mislead(states)
    states = drive(states, np.full(len(states), delay), PARTS, ~everyone)
    end(~kept(states) | (unsafe(states) <= 0), "nothing promised")
    for step in range(steps + 1):
        inputs, done = choose(measured, held, step)
        end(done & (target(states) <= 0), "reached")
        end(done, "wrong")
        if step == steps or not running.any():
            break
        end(inputs < 0, "left")
        held = np.maximum(inputs, 0)
        lasting = delta + late[step + 1] - late[step]
        states = drive(states, lasting - delay, PARTS, everyone)
        measured = mislead(states)
        states = drive(states, np.full(len(states), delay), PARTS if delay else 0, everyone)
    return outcomes


# ---- robots as they are


class World(Protocol):
    """A robot as it is: `fleet.Robot` is one."""

    @property
    def inputs(self) -> Any: ...  # (L, m)
    @property
    def bounds(self) -> Any: ...  # (D,)
    @property
    def delta(self) -> float: ...  # s
    @property
    def target(self) -> Any: ...  # None where there is none
    def velocity(self, q: Any, u: Any, v: Any) -> Any: ...
    def unsafe(self, q: Any, t: float) -> Any: ...
    def clearances(self, q: Any, t: float) -> Any: ...
    def reached(self, q: Any, t: float) -> Any: ...
    def held(self, q: Any) -> Any: ...
    def beyond(self, q: Any, kind: str) -> Any: ...


@dataclass(frozen=True)
class Answer:
    """What is said of M states at a step.

    Attributes
    ----------
    inputs : (M,) int
        Places of the inputs to be held; -1 where there is none.
    promised : (M,) bool
    left : (M,) int
        In how many steps more, after this one, the target is to be reached, or the robot to stay clear.
    """

    inputs: Any
    promised: Any
    left: Any


@dataclass(frozen=True)
class Moment:
    """What an adversary sees of M runs that go on.

    Attributes
    ----------
    world : World
    states : (M, ndim)
    commands : (M, m)
        What the robots hold.
    runs : (M,) int
        Which of the runs that began these are.
    step : int
    time, remaining : float
        Now, and until the interval's end, s.
    left : (M,) int
        As in `Answer`.
    tube : callable (points (M, V, ndim), step, left (M,)) -> (M, V)
        Level of the set that the robot means to be in at the interval's end, at most 0 inside.
    rng : numpy.random.Generator
    """

    world: World
    states: Any
    commands: Any
    runs: Any
    step: int
    time: float
    remaining: float
    left: Any
    tube: Callable[[Any, int, Any], Any]
    rng: np.random.Generator


Adversary = Callable[[Moment], Any]  # pushes (M, D), each component within its bound


# ---- the adversaries


def vertices(world: World) -> Any:
    """All corners of the box of pushes: (2^D, D)."""
    return np.array(list(product((-1.0, 1.0), repeat=len(world.bounds)))) * world.bounds


def still(moment: Moment) -> Any:
    """No push at all."""
    return np.zeros((len(moment.states), len(moment.world.bounds)))


def switching(moment: Moment) -> Any:
    """A corner drawn at random, another one in each eighth of an interval."""
    corners = vertices(moment.world)
    return corners[moment.rng.integers(len(corners), size=len(moment.states))]


def persistent(moment: Moment) -> Any:
    """The same corner through the whole run: each run has its own."""
    corners = vertices(moment.world)
    return corners[(7919 * moment.runs + 3) % len(corners)]


def ahead(moment: Moment, pushes: Any, span: float) -> tuple[Any, Any, Any]:
    """Under each of V pushes (V, D) held for `span` s: states (V, M, ndim), the least clearance, and the least level.

    Clearances are (V, M, kinds), each the least on the way; levels (V, M) are the least of `World.unsafe`.
    """
    world, count = moment.world, len(moment.states)
    states, commands = np.tile(moment.states, (len(pushes), 1)), np.tile(moment.commands, (len(pushes), 1))
    v, h = np.repeat(pushes, count, axis=0), span / STRIDES
    nearest, level = np.inf, np.inf
    for stride in range(STRIDES):
        states = advanced(world, states, commands, v, moment.time + stride * h, h)
        now = moment.time + (stride + 1) * h
        nearest = np.minimum(nearest, world.clearances(states, now))
        level = np.minimum(level, world.unsafe(states, now))
    shape = len(pushes), count
    return states.reshape(*shape, -1), nearest.reshape(*shape, -1), level.reshape(shape)


def sides(world: World) -> Any:
    """Each component of the push alone, up and then down: (2 D, D)."""
    return np.concatenate([np.diag(world.bounds), -np.diag(world.bounds)])


def nearer(moment: Moment) -> Any:
    """Each component goes the way that brings the nearest of what is unsafe nearer, of all that it has an effect on.

    The slope of each true level set is that between pushing up and pushing down until an interval after this one.
    """
    world, count = moment.world, len(moment.states)
    span = moment.remaining + world.delta
    _, found, _ = ahead(moment, np.concatenate([sides(world), [0.0 * np.asarray(world.bounds)]]), span)
    if not found.shape[2]:
        return switching(moment)
    middle, found = found[-1], found[:-1].reshape(2, len(world.bounds), count, -1)
    slopes = found[0] - found[1]  # (D, M, kinds)
    order, each = np.argsort(-middle, axis=1), np.arange(count)
    signs = np.ones((count, len(world.bounds)))
    for kind in order.T:  # the nearest has the last word
        slope = slopes[:, each, kind].T
        signs = np.where(slope != 0.0, -np.sign(slope), signs)
    return signs * world.bounds


def outward(moment: Moment) -> Any:
    """Each component goes the way that leads out of the table's own tube by the interval's end."""
    ends, _, _ = ahead(moment, sides(moment.world), moment.remaining)
    values = tube_at(moment, ends)
    half = len(values) // 2
    return np.where(values[:half] >= values[half:], 1.0, -1.0).T * moment.world.bounds


def worst(moment: Moment) -> Any:
    """The corner whose end of the interval is worst: the larger of the tube's level and of minus that of the hazards.

    Of equals the one that comes nearest to what is unsafe.
    """
    corners, each = vertices(moment.world), np.arange(len(moment.states))
    ends, near, level = ahead(moment, corners, moment.remaining)
    score = np.maximum(tube_at(moment, ends), np.where(np.isfinite(level), -level, -FAR))
    least = near.min(axis=2) if near.shape[2] else np.zeros(score.shape)
    among = np.where(score >= score.max(axis=0) - 1e-12, -least, -np.inf)
    return corners[among.argmax(axis=0)[each]]


def tube_at(moment: Moment, ends: Any) -> Any:
    """The tube's level at V ends of each run, (V, M, ndim): (V, M)."""
    values = moment.tube(np.ascontiguousarray(np.swapaxes(ends, 0, 1)), moment.step, moment.left)
    return np.clip(values, -FAR, FAR).T


ADVERSARIES: dict[str, Adversary] = {
    "none": still,
    "random": switching,
    "push": persistent,
    "nearer": nearer,
    "outward": outward,
    "worst": worst,
}


# ---- the runs


def advanced(world: World, states: Any, commands: Any, v: Any, t: float, h: float) -> Any:
    """States (M, ndim) after h s, held where the robot has walls."""
    return world.held(rk4(lambda q, now: world.velocity(world.held(q), commands, v), states, t, h))


class Runs:
    """Runs that go on, and how the others ended."""

    def __init__(self, world: World, starts: Any) -> None:
        self.world, self.states = world, np.array(starts, dtype=float)
        count = len(self.states)
        self.runs, self.commands, self.pushes = np.arange(count), np.zeros((count, 0)), np.zeros((count, 0))
        self.left = np.zeros(count, int)
        self.outcomes = np.full(count, WON if world.target is None else LATE, dtype=object)
        self.promised, self.asked = np.ones(count, bool), np.zeros(count, bool)

    def end(self, which: Any, outcome: str) -> None:
        """Take those of the runs that still go on out, (M,) bool."""
        if which.any():
            self.outcomes[self.runs[which]] = outcome
            for name in ("states", "runs", "commands", "pushes", "left"):
                setattr(self, name, getattr(self, name)[~which])

    def look(self, t: float) -> None:
        """Who has collided or left at time t, s."""
        self.end(self.world.unsafe(self.states, t) <= 0, COLLIDED)
        self.end(self.world.beyond(self.states, "unsafe"), OFF)
        self.end(self.world.beyond(self.states, "safe"), WON)

    def hear(self, answer: Answer) -> None:
        """Take what is answered; a run is promised as long as every input that it was given was promised."""
        lost = answer.inputs < 0
        given = self.runs[~lost]
        self.promised[given] &= answer.promised[~lost]
        self.asked[given] = True
        self.left, self.commands = answer.left, np.asarray(self.world.inputs)[np.maximum(answer.inputs, 0)]
        self.end(lost, NO_ANSWER)


def trial(
    world: World,
    ask: Callable[[Any, int], Answer],
    tube: Callable[[Any, int, Any], Any],
    adversary: Adversary,
    starts: Any,
    steps: int,
    rng: np.random.Generator,
) -> tuple[Any, Any]:
    """Play runs from starts (M, ndim) for so many steps: how they ended (M,) str, and which were promised (M,) bool.

    ask(states, step) answers for the runs that go on. A run was promised where every input that it was given, up to its
    end, was: who is promised an input and has none at the next step was promised too much.
    """
    runs, delta = Runs(world, starts), world.delta
    runs.look(0.0)
    for step in range(steps + 1):
        runs.end(world.reached(runs.states, step * delta), WON)
        if step == steps or not len(runs.runs):
            break
        runs.hear(ask(runs.states, step))
        for part in range(PARTS):
            if not len(runs.runs):
                break
            t, h = (step + part / PARTS) * delta, delta / PARTS / SUBSTEPS
            seen = (runs.states, runs.commands, runs.runs, step, t, (1 - part / PARTS) * delta, runs.left, tube, rng)
            runs.pushes = adversary(Moment(world, *seen))
            if (np.abs(runs.pushes) > np.asarray(world.bounds) * (1 + 1e-12)).any():
                raise ValueError("an adversary left its box")
            for sub in range(SUBSTEPS):
                runs.states = advanced(world, runs.states, runs.commands, runs.pushes, t + sub * h, h)
                runs.look(t + (sub + 1) * h)
    return runs.outcomes, runs.promised & runs.asked


def reckless(world: World, states: Any, t: float) -> Any:
    """What a commander wants who drives at what is unsafe: the input that comes nearest to it in five intervals, (M,).

    Held for as long, and not pushed.
    """
    inputs, count = np.asarray(world.inputs), len(states)
    commands, q = np.repeat(inputs, count, axis=0), np.tile(states, (len(inputs), 1))
    none, nearest = np.zeros((len(q), len(world.bounds))), np.full(len(q), np.inf)
    for stride in range(10):
        q = advanced(world, q, commands, none, t + stride * world.delta / 2, world.delta / 2)
        found = world.clearances(q, t + (stride + 1) * world.delta / 2)
        nearest = np.minimum(nearest, found.min(axis=1, initial=np.inf))
    return nearest.reshape(len(inputs), count).argmin(axis=0)
