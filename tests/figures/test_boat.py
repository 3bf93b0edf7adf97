"""One sampling interval of the boat: its constructs against runs, and what the pictures hold."""

import numpy as np
import pytest
from artists import axes, named, vertices
from boat import (
    CONSTRUCTS,
    PIECES,
    OneStepGame,
    boat_problem,
    draw_one_step,
    one_step_game,
    one_step_legend,
    play,
    winds,
)
from fig07_game_cost import LEVELS, draw_cost


@pytest.fixture(scope="module")
def boat() -> OneStepGame:
    return one_step_game(boat_problem(nodes=61))


@pytest.mark.parametrize(
    "start", [(-0.42, 0.30), (-0.42, 0.03), (-0.60, 0.68), (-0.2, 0.2), (-0.3, -0.2), (-0.1, -0.4)]
)
def test_the_cost_bounds_what_winds_can_do(boat, start):
    """V^j is a supremum: no wind does worse, some wind nearly attains it, both up to a scheme error of under a cell."""
    value = boat.problem.grid.interpolate(boat.cost, np.array([start]))[0]
    worst = play(boat.problem, start).costs.max()
    cell = max(boat.problem.grid.spacing)
    assert value - cell < worst < value + cell


def test_reach_avoid_is_reach_and_avoid(boat):
    apart = np.maximum(boat.reach, boat.avoid)
    assert np.abs(apart - boat.cost).max() < max(boat.problem.grid.spacing)
    assert (boat.cost <= 0).sum() < (boat.reach <= 0).sum()


def test_winds_stay_within_bounds_and_change_at_the_pieces():
    problem = boat_problem(nodes=11)
    signals = winds(problem, 20, seed=3)
    assert signals.shape == (24, PIECES, 2)
    assert (np.abs(signals) == problem.dynamics.bounds_at()).all()
    assert np.array_equal(signals, winds(problem, 20, seed=3))


def test_one_step_pictures(boat):
    for show in CONSTRUCTS:
        ax = axes()
        starts = [
            ("$q$", play(boat.problem, (-0.42, 0.30))),
            ("$q'$", play(boat.problem, (-0.6, 0.68))),
        ]
        draw_one_step(ax, boat, show=show, starts=starts)
        assert named(ax, show) and named(ax, "target")
        assert bool(named(ax, "unsafe")) == (show != "reach")
        assert len(named(ax, "win")) == 1 and len(named(ax, "defeat")) == 1
        assert one_step_legend(show)
    ax = axes()
    draw_cost(ax, boat)
    (lines,) = named(ax, "cost")
    assert set(lines.levels) == set(LEVELS)
    written = [float(text.get_text()) for text in lines.labelTexts]
    seen = [level for level, path in zip(lines.levels, lines.get_paths(), strict=True) if len(path.vertices)]
    assert set(written) == set(np.round(seen, 1)), "every level that is seen has its number"
    assert lines.get_zorder() > max(named(ax, name)[0].get_zorder() for name in ("target", "unsafe", "reach-avoid"))
    edge = vertices(ax, "reach-avoid-edge")
    assert np.abs(boat.problem.grid.interpolate(boat.cost, edge)).max() < max(boat.problem.grid.spacing) ** 2
    with pytest.raises(ValueError, match="reach, avoid, reach-avoid"):
        draw_one_step(axes(), boat, show="everything")
