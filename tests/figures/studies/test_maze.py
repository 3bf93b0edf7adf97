"""The maze: its walls, the refusal where nodes are too far apart, and a short way of it judged without the library."""

import re
import warnings
from pathlib import Path
from typing import Any

import judge
import numpy as np
import pytest
from costs import MAZE_CELLS, SCOTS_SHARE, SIDE, TARGET, WALLS, maze, to_box, to_walls, velocity

import sdhj
from sdhj.common.findings import ResolutionWarning
from sdhj.table.batches import Table

NUMBERS = Path(__file__).parents[3] / "notebooks" / "site" / "numbers.md"


@pytest.mark.slow
def test_the_distance_to_the_walls(rng: np.random.Generator) -> None:
    """Against the nearest of many points of all walls."""
    lattice = [np.stack(np.meshgrid(np.linspace(*w[:2], 9), np.linspace(*w[2:], 401)), axis=-1) for w in WALLS]
    near = np.concatenate([points.reshape(-1, 2) for points in lattice])
    points = rng.uniform(0, SIDE, (120, 2))
    outside = points[to_walls(points) > 0]
    nearest = np.linalg.norm(outside[:, None] - near, axis=2).min(axis=1)
    assert len(outside) > 80
    np.testing.assert_allclose(to_walls(outside), nearest, atol=0.02)  # half the way between two points of the lattice
    inside = np.array([[(w[0] + w[1]) / 2, (w[2] + w[3]) / 2] for w in WALLS])
    np.testing.assert_allclose(to_walls(inside), -0.1, atol=1e-12)  # all are 0.2 m thick


def warned(problem: sdhj.ReachAvoidProblem) -> None:
    """By finite differences, with the first warning as an error: that ends the solve early."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", ResolutionWarning)
        sdhj.solve(problem, "hji", progress=False)


def test_where_walls_hide_between_the_nodes_it_refuses() -> None:
    with pytest.raises(ResolutionWarning, match=r"between.*nodes"):
        warned(maze(21, 12, steps=60))


@pytest.mark.slow
def test_promises_that_hundreds_of_steps_outlive_are_refused(solves_are_played: None) -> None:
    with pytest.raises(ResolutionWarning, match="what this table promises"):
        warned(maze(41, 24, steps=60))


def judged(table: Table, starts: Any) -> Any:
    """The outcomes of runs from starts (M, 3), for at most twice the steps of the table."""
    controller, inputs = sdhj.Controller(table), table.problem.inputs
    return judge.play(
        lambda q, step: controller.choose(controller.batch(q, 0)),
        lambda q, j, signs, t: velocity(q[:, 2], *inputs[np.maximum(j, 0)].T),
        lambda q, j, t, end: np.zeros((len(q), 1)),
        lambda q, t: to_box(q[:, :2], TARGET),
        lambda q, t: np.minimum(to_walls(q[:, :2]), np.minimum(q[:, :2], SIDE - q[:, :2]).min(axis=1) + 1e-9),
        starts,
        delta=table.problem.delta,
        steps=2 * table.steps,
    )


def won(table: Table, rng: np.random.Generator, most: int) -> Any:
    """States (M, 3) out of the target from which it is reached in all steps, at most so many."""
    states = rng.uniform(table.grid.lower, table.grid.upper, (200_000, 3))
    away = to_box(states[:, :2], TARGET) > 0
    return states[table.contains(states, start=0, within=table.steps) & away][:most]


@pytest.mark.slow
def test_the_last_steps_of_the_maze(rng: np.random.Generator) -> None:
    """With steep walls all is kept; without, differences wear them down and the table leads through them."""
    lost = {}
    for sampling in ("steep", "nodes"):
        table = sdhj.solve(maze(61, steps=20, sampling=sampling), progress=False)
        starts = won(table, rng, 2000)
        assert len(starts) == 2000
        lost[sampling] = np.mean(judged(table, starts) != "reached")
    assert lost["steep"] < 0.005 and lost["nodes"] > 0.2, lost


@pytest.mark.slow
def test_the_whole_maze_is_certified(rng: np.random.Generator) -> None:
    table = sdhj.solve(maze(), sdhj.Certified(cells=MAZE_CELLS))
    starts = won(table, rng, 200)
    share = table.fraction(start=0, within=table.steps)
    assert share > SCOTS_SHARE
    said = f"| maze, 51 x 51 x 72 | certified, played | {share:.3f} |.*| {table.steps} steps;"
    assert re.search(said.replace("|", "[|]"), NUMBERS.read_text(encoding="utf-8"))
    assert len(starts) == 200 and (judged(table, starts) == "reached").all()
