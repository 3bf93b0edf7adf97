"""Windows of what is projected away: their games against ends that are drawn; one window, and one for each node."""

import numpy as np
import pytest
from large import BALL, BALL_RADIUS, GUST, PUSH, space
from windows import LOST, SIGNS, Game, cut, shares


@pytest.mark.parametrize("dropped", [pytest.param(0, marks=pytest.mark.slow), 2])
@pytest.mark.slow
def test_no_end_is_worse_than_the_game_of_a_window(dropped: int, rng: np.random.Generator) -> None:
    """From a node, wherever in the window the dropped velocity is, whatever the gust is, held over the interval."""
    problem = space(9)
    game, windows = Game(problem), cut(5, 2)
    values = problem.goal(0).astype(np.float32) + rng.uniform(-0.2, 0.2, problem.grid.shape).astype(np.float32)
    drawn, delta, tight = rng.integers(0, problem.grid.shape, (400, 6)), problem.delta, 0
    for sign, found in zip(SIGNS, game.reached(values, dropped, windows), strict=True):
        clear, told, u = game.touched(sign, dropped, windows), found[tuple(drawn.T)], PUSH * np.array(sign)
        q = np.stack([problem.grid.nodes(axis)[drawn[:, axis]] for axis in range(6)], axis=1)
        worst, nearest = np.full(400, -np.inf), np.full(400, np.inf)
        for _ in range(60):
            v = rng.choice([-1.0, 0.3, 1.0], (400, 3)) * GUST
            window = np.array([next(w for w in windows if w[0] <= node <= w[1]) for node in drawn[:, dropped + 3]])
            low, high = problem.grid.nodes(dropped + 3)[window].T
            speed = q[:, 3:].copy()
            speed[:, dropped] = rng.choice([0.0, 0.5, 1.0], 400) * (high - low) + low
            for t in np.linspace(0.0, delta, 7):
                end = np.hstack([q[:, :3] + t * speed + t**2 / 2 * (u + v), speed + t * (u + v)])
                nearest = np.minimum(nearest, np.linalg.norm(end[:, :3] - BALL, axis=1) - BALL_RADIUS)
            worst = np.maximum(worst, np.minimum(problem.grid.interpolate(values, end), LOST))
        assert (worst <= told + 1e-5).all()
        assert (-nearest <= clear[tuple(drawn.T)] + 1e-5).all()
        tight += int((worst > told - 0.02).sum())
    assert tight > 400


@pytest.mark.slow
def test_one_window_is_the_projection_and_one_for_each_node_the_full_game() -> None:
    problem = space(9)
    each, whole = cut(5, 5), cut(5, 1)
    full = [shares(problem, each, axes=(axis,)) for axis in range(3)]
    for other in full[1:]:  # but for a few of 91,125 nodes at which single precision rounds to either side of zero
        assert full[0] == pytest.approx(other, rel=0, abs=1e-4)
    few, some = shares(problem, whole), shares(problem, cut(5, 3))
    assert few[-1] == few[0] < some[-1] < full[0][-1]
