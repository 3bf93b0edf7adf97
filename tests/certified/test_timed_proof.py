"""Proofs for drift, gain and bounds that depend on time and on the input, held against motions of the test's own.

Nothing of the library moves a state here: `judge` integrates the functions of a case, which are written once.
"""

from dataclasses import dataclass

import judge
import naive_certified as naive
import numpy as np
import pytest
import zoo

import sdhj


@dataclass(frozen=True)
class Case:
    """dx = drift(x, u, t) + gain(u, t) v with |v| <= bound(u, t) on each axis; the target is a ball about centre(t).

    unsafe: x_1 >= wall + rate t.
    """

    inputs: tuple
    drift: object
    gain: object
    bound: object
    centre: object
    radius: float
    wall: float
    rate: float
    cells: tuple
    delta: float = 0.4
    steps: int = 3

    @property
    def ndim(self):
        return len(self.cells)

    def problem(self):
        eye = np.eye(self.ndim)
        return (zoo.line, zoo.plane)[self.ndim - 1](
            self.inputs,
            drift=lambda x, u, t: self.drift(x, u, t),
            gain=lambda q, u, t: self.gain(u, t) * eye,
            bounds=lambda q, u, t: np.stack([self.bound(u, t)] * self.ndim),
            **{"lower": [-3.0] * self.ndim, "upper": [3.0] * self.ndim, "nodes": 31},
            target=sdhj.TargetSet(tuple(range(self.ndim)), self.target),
            unsafe=[sdhj.UnsafeSet((0,), self.unsafe, name="wall")],
            delta=self.delta,
            steps=self.steps,
        )

    def target(self, points, t):
        return np.sqrt(((points - self.centre(t)) ** 2).sum(axis=1)) - self.radius

    def unsafe(self, points, t):
        return self.wall + self.rate * t - points[:, 0]

    def velocity(self, states, places, signs, t):
        """signs (M, ndim) in [-1, 1] say where in its box the adversary is."""
        out = np.empty_like(states)
        for j in np.unique(places):
            u, own = np.array(self.inputs[j]), places == j
            out[own] = self.drift(states[own], u, t) + self.gain(u, t) * self.bound(u, t) * signs[own]
        return out


CASES = {
    # a current that turns within an interval and is about as fast as the robot; gusts that grow with speed
    "tide": Case(
        inputs=((-1.5,), (0.0,), (1.5,)),
        drift=lambda x, u, t: u + 1.2 * np.sin(5.0 * t) + 0.0 * x,
        gain=lambda u, t: 1.0 + 0.5 * np.cos(3.0 * t),
        bound=lambda u, t: 0.05 + 0.04 * np.abs(u[0]),
        centre=lambda t: 0.3 * t,
        radius=0.7,
        wall=1.7,
        rate=-0.3,
        cells=(240,),
    ),
    # also the place matters, and the adversary's bound dies down
    "eddy": Case(
        inputs=tuple((a, b) for a in (-1.0, 0.0, 1.0) for b in (-1.0, 0.0, 1.0)),
        drift=lambda x, u, t: u * (1.0 - 0.2 * np.sin(2.0 * t)) + 0.4 * np.sin(2.0 * t + x[:, ::-1]),
        gain=lambda u, t: 1.0 + 0.1 * np.sin(2.0 * t) * u[0],
        bound=lambda u, t: 0.06 + 0.06 * np.exp(-2.0 * t),
        centre=lambda t: 0.1,
        radius=0.9,
        wall=1.6,
        rate=0.2,
        cells=(60, 60),
    ),
}


@pytest.fixture(scope="module", params=CASES)
def proved(request):
    """A case and its table."""
    case = CASES[request.param]
    return case, sdhj.solve(case.problem(), sdhj.Certified(cells=case.cells), progress=False)


@pytest.mark.slow
@pytest.mark.parametrize("adversary", ["switching", "away"])
def test_no_run_from_a_certified_state_is_lost(proved, adversary, rng):
    case, table = proved
    assert table.fraction(start=0, within=3) > 1.2 * table.fraction(start=0, within=0) > 0.01
    starts = naive.states_in(table, rng, 1000)

    def choose(states, step):
        left, places = naive.steps_to_go(table, states, step), np.full(len(states), -1)
        ahead = (left > 0) & (left < 99)
        places[ahead] = naive.chosen_inputs(table, states[ahead], step, rng)
        return places

    def signs(states, inputs, t, end):
        if adversary == "switching":
            return rng.choice([-1.0, 1.0], states.shape)
        return np.where(states >= case.centre(end), 1.0, -1.0)

    outcomes = judge.play(
        choose, case.velocity, signs, case.target, case.unsafe, starts, delta=case.delta, steps=case.steps
    )
    assert set(outcomes) == {"reached"}


@pytest.mark.slow
def test_every_step_leads_one_nearer(proved, rng):
    """From every step of the problem on, not only from the first: what is proved of step k rests on the time t_k."""
    case, table = proved
    grid = table.grid
    for step in range(case.steps):
        states = rng.uniform(grid.lower, grid.upper, (4000, case.ndim))
        left = naive.steps_to_go(table, states, step)
        states, left = states[(left > 0) & (left < 99)], left[(left > 0) & (left < 99)]
        assert len(states) > 150
        inputs = naive.chosen_inputs(table, states, step, rng)
        for _ in range(4):
            ended, t, h = states.copy(), step * case.delta, case.delta / 40
            for k in range(40):
                if k % 10 == 0:
                    signs = rng.choice([-1.0, 1.0], states.shape)
                ended = judge.rk4(lambda q, at, v=signs, j=inputs: case.velocity(q, j, v, at), ended, t + k * h, h)
                assert (case.unsafe(ended, t + (k + 1) * h) > 0).all()
            assert (naive.steps_left(table, np.clip(ended, -3, 3), step + 1) < left).all()
