"""The maze: its walls, the refusal where nodes are too far apart, and a short way of it judged without the library."""

import judge
import numpy as np
import pytest
from maze import SIDE, TARGET, WALLS, maze, solved, to_box, to_walls, velocity

import sdhj


def test_the_distance_to_the_walls(rng: np.random.Generator) -> None:
    """Against the nearest of many points of all walls."""
    lattice = [np.stack(np.meshgrid(np.linspace(*w[:2], 9), np.linspace(*w[2:], 401)), axis=-1) for w in WALLS]
    near = np.concatenate([points.reshape(-1, 2) for points in lattice])
    points = rng.uniform(0, SIDE, (300, 2))
    outside = points[to_walls(points) > 0]
    nearest = np.linalg.norm(outside[:, None] - near, axis=2).min(axis=1)
    assert len(outside) > 200
    np.testing.assert_allclose(to_walls(outside), nearest, atol=0.02)  # half the way between two points of the lattice
    inside = np.array([[(w[0] + w[1]) / 2, (w[2] + w[3]) / 2] for w in WALLS])
    np.testing.assert_allclose(to_walls(inside), -0.1, atol=1e-12)  # all are 0.2 m thick


def test_where_walls_hide_between_the_nodes_it_refuses() -> None:
    with pytest.raises(ValueError, match=r"the unsafe set .walls. hides between the nodes at x = .* Use"):
        solved(maze(21, 12))


def lost(sampling: str, rng: np.random.Generator) -> float:
    """The share of the starts of 20 steps whose runs do not reach the target, walls being a node or two thick."""
    table = sdhj.solve(maze(61, steps=20, sampling=sampling), progress=False)
    controller, inputs = sdhj.Controller(table), table.problem.inputs
    states = rng.uniform(table.grid.lower, table.grid.upper, (200_000, 3))
    away = to_box(states[:, :2], TARGET) > 0
    starts = states[table.contains(states, start=0, within=20) & away][:2000]
    outcomes = judge.play(
        lambda q, step: controller.choose(controller.batch(q, 0)),
        lambda q, j, signs, t: velocity(q[:, 2], *inputs[np.maximum(j, 0)].T),
        lambda q, j, t, end: np.zeros((len(q), 1)),
        lambda q, t: to_box(q[:, :2], TARGET),
        lambda q, t: np.minimum(to_walls(q[:, :2]), np.minimum(q[:, :2], SIDE - q[:, :2]).min(axis=1) + 1e-9),
        starts,
        delta=table.problem.delta,
        steps=40,
    )
    assert len(starts) == 2000
    return float(np.mean(outcomes != "reached"))


@pytest.mark.slow
def test_the_last_steps_of_the_maze(rng: np.random.Generator) -> None:
    """With steep walls all is kept; without, differences wear them down and the table leads through them."""
    assert lost("steep", rng) < 0.005
    assert lost("nodes", rng) > 0.2
