"""What chapter 15 shows of formulas, and of what cannot be read."""

import numpy as np
from course.reading import mathematics, reply

import sdhj


def cart(**changes: object) -> sdhj.ReachAvoidProblem:
    given = {"drift": lambda q, u: np.stack([q[:, 1], np.full(len(q), u[0])], axis=1), **changes}
    return sdhj.ReachAvoidProblem(
        grid=sdhj.Grid([-2.0, -1.0], [2.0, 1.0], [21, 11], names=["place", "speed"]),
        dynamics=sdhj.Dynamics(inputs=[[-1.0], [1.0]], **given),
        target=sdhj.TargetSet((0,), lambda p, t: np.abs(p[:, 0] - 0.5) - 0.25),
        unsafe=[sdhj.UnsafeSet((1,), lambda p, t: 0.75 + t - p[:, 0], name="too fast")],
        delta=0.1,
        steps=1,
    )


def test_a_robot_is_shown_in_mathematics() -> None:
    assert mathematics(cart(), 1) == [
        "dplace/dt = speed",
        "dspeed/dt = 1",
        "target: |place - 0.5| - 0.25 <= 0",
        "too fast: 0.75 + t - speed <= 0",
    ]


def test_what_is_long_and_used_twice_has_a_line_of_its_own() -> None:
    def drift(q, u):
        bent = np.sin(q[:, 0]) + np.cos(q[:, 1])
        return np.stack([bent * np.abs(bent), bent], axis=1)

    assert mathematics(cart(drift=drift), 1)[:3] == [
        "a = sin(place) + cos(speed)",
        "dplace/dt = a |a|",
        "dspeed/dt = a",
    ]


def test_a_refusal_names_the_line_and_not_the_file() -> None:
    def drift(q, u):
        return q if q[0, 0] > 0 else -q

    said = reply(cart, drift=drift)
    assert "read as a formula" in said and ".py" not in said and "np.where(" in said
    assert max(map(len, said.splitlines())) <= 84 and "sdhj.BlackBox(drift" in said
    assert reply(lambda: 3) == "3"
