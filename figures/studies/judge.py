"""Closed loops judged without the library: the controller is asked for inputs, nothing else. Imports nothing from sdhj.

The motion is integrated here, by the textbook's Runge-Kutta step of order 4, with functions of the caller (a test,
`large.py`); the adversary may switch several times within a sampling interval.
"""

import numpy as np

PARTS, SUBSTEPS = 8, 5  # of an interval: the adversary's turns, and the steps of the integration in each


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
