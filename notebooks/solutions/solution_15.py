"""Solutions of chapter 15, and answers that its checks refuse."""

import numpy as np
from course.chapter_15 import check_boat, check_bound, check_drift, check_gradient, check_reverse, reference_car

import sdhj


def tricycle(q, u):
    """The front wheel rolls where it points: that turns the car by speed tan(phi) in a way of one wheelbase."""
    speed, phi = u
    turn = np.full(len(q), speed * np.tan(phi) / 0.3)
    return np.stack([speed * np.cos(q[:, 2]), speed * np.sin(q[:, 2]), turn], axis=1)


def reversing_car(slow=-0.5, turns=(-2.0, 0.0, 2.0)):
    """Inputs (speed, rate of turn); the drift reads both."""
    forward = [(1.0, turn) for turn in (-2.0, 0.0, 2.0)]
    return reference_car(inputs=[*forward, *((slow, turn) for turn in turns)])


def repaired(value):
    """value = (d + r)^2 - r^2 with the distance d."""
    return np.sqrt(value + 0.18**2) - 0.18


# d(s cos)/d theta = -s sin and d(s sin)/d theta = s cos, at most 1; nothing else depends on the state
bounds = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])


def boat(turning=0.5, wind=0.14):
    """The motor adds to the water, the wind is the adversary's; the shore is an unsafe set, not the grid's end."""
    angles = np.arange(8) * np.pi / 4
    inputs = [[0.0, 0.0], *([np.cos(a), np.sin(a)] for a in angles)]

    def drift(q, u):
        return np.stack([u[0] - turning * q[:, 1], u[1] + turning * q[:, 0]], axis=1)

    problem = sdhj.ReachAvoidProblem(
        grid=sdhj.Grid([-1, -1], [1, 1], [41, 41]),
        dynamics=sdhj.Dynamics(inputs, drift, gain=np.eye(2), bounds=[wind, wind]),
        target=sdhj.TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 0.6, p[:, 1]) - 0.25),
        unsafe=(
            sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0], p[:, 1] - 0.1) - 0.2, name="island"),
            sdhj.UnsafeSet((0, 1), lambda p, t: 0.95 - np.abs(p).max(axis=1), name="shore"),
        ),
        delta=0.3,
        steps=4,
    )
    return problem, sdhj.solve(problem, progress=False).fraction(start=0, within=4)


def _one_state(q, u):
    return np.array([u[0] * np.cos(q[0, 2]), u[0] * np.sin(q[0, 2]), u[0] * np.tan(u[1]) / 0.3])


def _spins(q, u):
    """The front wheel's angle taken for the rate of turn."""
    return np.stack([u[0] * np.cos(q[:, 2]), u[0] * np.sin(q[:, 2]), np.full(len(q), u[1])], axis=1)


RIGHT = {
    check_drift: tricycle,
    check_reverse: reversing_car,
    check_gradient: repaired,
    check_bound: bounds,
    check_boat: boat,
}
WRONG = {
    check_drift: [_one_state, _spins],
    check_reverse: [
        lambda: reversing_car(slow=-1.0),  # too fast
        lambda: reversing_car(turns=(0.0,)),  # four inputs
        lambda: reference_car(inputs=[(s, t) for s in (-0.5, 0.5) for t in (-2.0, 0.0, 2.0)]),  # slow forwards too
    ],
    check_gradient: [
        lambda value: value / 0.36,  # right at the boundary only
        lambda value: np.sqrt(np.abs(value)) * np.sign(value),
        lambda value: np.sqrt(np.maximum(value, 0)) - 0.18,
    ],
    check_bound: [np.ones((3, 3)), np.array([[0, 0, 1], [0, 0, 1], [0, 0, 1.0]]), bounds.T],
    check_boat: [
        lambda: boat(turning=-0.5),  # turns the other way
        lambda: boat(wind=0.2),
        lambda: (boat()[0], 0.9),
    ],
}
