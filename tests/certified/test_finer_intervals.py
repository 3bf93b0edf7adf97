"""Where velocities grow fast, an interval is cut finer until a proof is found: a stirred reactor, and a closed form."""

import numpy as np
import pytest
import zoo

import sdhj
from sdhj.certified.check import verify

COOLING = np.array([[290.0], [300.0], [310.0]])


def reaction(q):
    return 7.2e10 * np.exp(-72750.0 / (8.314 * q[:, 1])) * q[:, 0]


def reactor(nodes=(71, 61), steps=None):
    """Concentration and temperature of a stirred tank, which runs away where it is hot; the feed varies by 2 K."""

    def drift(q, u):
        k, c, temperature = reaction(q), q[:, 0], q[:, 1]
        return np.stack(
            [1.0 - c - k, 350.0 - temperature + 5e4 / 239.0 * k + 5e4 / 23900.0 * (u[0] - temperature)], axis=1
        )

    return zoo.cart(
        grid=sdhj.Grid([0.2, 320.0], [0.9, 380.0], nodes, names=["cA", "T"]),
        dynamics=sdhj.Dynamics(COOLING, drift, gain=[[0], [1]], bounds=[2.0]),
        delta=0.25,
        steps=steps,
    )


def judged(controller, states, rng, steps):
    """Own plant, Runge-Kutta with an adversary that jumps between its bounds: whether somebody leaves."""

    def velocity(q, u, v):
        k, c, temperature = reaction(q), q[:, 0], q[:, 1]
        heating = 350.0 - temperature + 5e4 / 239.0 * k + 5e4 / 23900.0 * (u - temperature) + v
        return np.stack([1.0 - c - k, heating], axis=1)

    q, h = states.copy(), 0.25 / 40
    for _ in range(steps):
        chosen = controller.choose(controller.batch(q))
        assert (chosen >= 0).all()
        u = COOLING[chosen, 0]
        pushes = rng.choice([-2.0, 2.0], (2, len(q)))
        for part in range(40):
            v = pushes[part // 20]
            a = velocity(q, u, v)
            b = velocity(q + h / 2 * a, u, v)
            c = velocity(q + h / 2 * b, u, v)
            q = q + h / 6 * (a + 2 * b + 2 * c + velocity(q + h * c, u, v))
            assert ((q > [0.2, 320]) & (q < [0.9, 380])).all()


@pytest.mark.slow
def test_a_reactor_is_proved_though_its_rate_grows_fast(tmp_path):
    """Of 2 parts nothing follows; a fifth of the states is proved, verified, and nobody is lost by the judge."""
    table = sdhj.solve(reactor(), sdhj.Certified(cells=(90, 140), parts=2), progress=False, play=False)
    assert table.details["parts"] in (4, 8, 16) and table.fraction() > 0.2
    table.save(tmp_path / "table.npz")
    assert verify(tmp_path / "table.npz", progress=False).ok
    rng = np.random.default_rng(0)
    q = rng.uniform([0.2, 320], [0.9, 380], (2000, 2))
    judged(sdhj.Controller(table), q[table.contains(q)][:100], rng, 20)


def test_what_is_gone_within_any_part_is_refused_with_advice_on_parts():
    """x' = u (x / 1.5)^9 + v: from x = 3 it is gone within 0.0005 s."""
    problem = zoo.line(
        grid=sdhj.Grid([0.0], [4.0], [41]),
        dynamics=sdhj.Dynamics([[0.0], [1.0]], lambda q, u: u[0] * (q / 1.5) ** 9, [[1.0]], [0.1]),
        target=zoo.goal(3.5, 0.3),
        delta=0.25,
    )
    with pytest.raises(ValueError, match=r"np\.minimum, use a shorter"):
        sdhj.solve(problem, sdhj.Certified(cells=[120], parts=2), progress=False, play=False)
