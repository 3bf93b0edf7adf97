"""Chapter 5, Three games: what it draws, its widgets, and the checks of its exercises."""

from collections.abc import Callable, Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from course.exercises import exercise, expect, expect_close
from course.widgets import Explorer, Numbers, choice, slider
from sdhj import Grid, Scheme
from sdhj.common.remembering import FloatArray
from sdhj.plotting import draw_set, frame_slice, plane
from sdhj.plotting.looks import FULL_LOOKS, OUTCOME_INK
from sdhj.problem.velocities import Velocities
from sdhj.solver.schemes import evolve

# ---- pictures

Games = Mapping[str, FloatArray]


def draw_games(figure: Figure, rail: Grid, games: Games, joint: FloatArray | None = None) -> Numbers:
    """The won set of each game in the plane of robot and pursuer; the last one with the joint game's edge dashed."""
    axes = np.atleast_1d(figure.subplots(1, len(games), sharey=True))
    where = plane(rail, (0.0, 0.0), resolution=161)
    for ax, (title, values) in zip(axes, games.items(), strict=True):
        whole = np.broadcast_to(values, rail.shape)
        draw_set(ax, where, where.of(rail, np.ascontiguousarray(whole)), FULL_LOOKS, title, zorder=1.0)
        frame_slice(ax, rail)
        ax.set(aspect="equal", title=title)
    if joint is not None:
        edge = {"colors": OUTCOME_INK, "linewidths": 1.2, "linestyles": "--"}
        axes[-1].contour(where.x, where.y, where.of(rail, joint), levels=[0.0], zorder=3, **edge)
    for ax in axes[1:]:
        ax.set_ylabel("")
    return {title: rail.fraction(np.broadcast_to(values, rail.shape) <= 0) for title, values in games.items()}


def draw_wrong_union(ax: Axes, rail: Grid, right: FloatArray, wrong: FloatArray) -> None:
    """What is won (blue), and what is claimed besides if sets are united before they are intersected (orange)."""
    where = plane(rail, (0.0, 0.0), resolution=201)
    claimed = {"facecolor": "#d9480f", "edgecolor": "#8a2b06", "linewidth": 0.8}
    draw_set(ax, where, where.of(rail, wrong), claimed, "claimed", zorder=1.0)
    draw_set(ax, where, where.of(rail, right), FULL_LOOKS, "won", zorder=2.0)
    frame_slice(ax, rail)
    ax.set_aspect("equal")


# ---- widgets

HELD = {"to the left": -0.8, "none": 0.0, "to the right": 0.8}  # m/s


def explore_games(rail: Grid, games: Callable[..., tuple[Games, FloatArray]]) -> Explorer:
    """Three games and their intersection, with the joint game beside it; `games` is the reader's."""

    def draw(figure: Figure, held: str, v_d: float, v_p: float, delta: float) -> Numbers:
        return draw_games(figure, rail, *games(HELD[held], v_d, v_p, delta))

    controls = {
        "held": choice("input held", tuple(HELD), "to the right"),
        "v_d": slider("disturbance, at most (m/s)", 0.0, 0.4, 0.05, 0.1, live=False),
        "v_p": slider("pursuer, at most (m/s)", 0.0, 1.0, 0.05, 0.4, live=False),
        "delta": slider("length of the interval (s)", 0.03, 0.6, 0.03, 0.3, live=False),
    }
    alt = "Won sets of games 1, 2 and 3 on a rail, their intersection, and the joint game's edge"
    return Explorer(draw, controls, size=(9.2, 2.8), slow="solving", alt=alt, motion="delta")


# ---- checks


@exercise("5.1", "Claimed is a maximum of two minima, won a minimum of maxima. One does not follow from the other.")
def check_claims(claimed_in_error):
    """max(min reach, min avoid) <= 0 < min max."""
    reach, avoid = np.random.default_rng(0).normal(size=(2, 3, 500))
    got = np.asarray(claimed_in_error(reach, avoid))
    expect(got.shape == (500,), "one answer for each state: the inputs are the first axis.")
    won = (np.maximum(reach, avoid) <= 0).any(axis=0)
    claimed = (reach <= 0).any(axis=0) & (avoid <= 0).any(axis=0)
    expect(~(got & won), "some of these are won by a single input, so the claim is right.")
    expect(~(got & ~claimed), "some of these are not even claimed: no input reaches, or none avoids.")
    expect(got == (claimed & ~won), "some claims in error are missing: one input reaches, another avoids.")
    return f"{got.sum()} of 500 here: with two inputs it can happen, with one it cannot."


@exercise("5.2", "The table has N (N + 1) / 2 entries with n >= 1, and a reach set is solved for each of them.")
def check_count(equations):
    """L (N (N + 1) / 2 + moving N + static)."""
    expect(
        equations(1, 1, 0, 0) == 1, "without anything to avoid there is one game to reach, for one input and one step."
    )
    expect(equations(3, 4, 0, 0) == 30, "to reach: one for each input and each entry (k, n) of the table with n >= 1.")
    expect(equations(3, 4, 0, 2) == 36, "a static set is solved once for each input, whatever the step.")
    expect(equations(3, 4, 1, 0) == 42, "a moving set is solved for each input and each step, not for each entry.")
    expect(equations(25, 8, 1, 1) == 1125, "the case study: 25 inputs, 8 steps.")
    return "900 on four axes to reach, 200 on two for the disks, 25 on four for the pursuer."


@exercise("5.3", "Add what the known axes read, again and again, until nothing is new.")
def check_axes(needed):
    """The closure of a set of axes."""
    nothing = np.zeros((4, 4), bool)
    expect(
        tuple(needed((0, 1), nothing)) == (0, 1),
        "velocities that read nothing add nothing: the arm's disks need (0, 1).",
    )
    chain = nothing.copy()
    chain[0, 1] = chain[1, 2] = True  # axis 0 reads 1, axis 1 reads 2
    expect(tuple(needed((0,), chain)) == (0, 1, 2), "what is added has velocities too: go on until nothing is new.")
    expect(tuple(needed((2,), chain)) == (2,), "reads[i][k]: axis i reads coordinate k, not the other way round.")
    car = np.zeros((3, 3), bool)
    car[0, 2] = car[1, 2] = True
    expect(tuple(needed((0, 1), car)) == (0, 1, 2), "a car's position needs its heading.")
    loop = nothing.copy()
    loop[3, 0] = loop[0, 3] = True
    expect(tuple(needed((3,), loop)) == (0, 3), "sorted, each axis once, also where two axes read each other.")


@exercise("5.4", "Count the coordinates in each distance: arm to disk, and end-effector to evader.")
def check_evader(avoid, reach):
    """2 and 4."""
    expect(avoid == 2, "the known disks meet the arm only, and the arm does not feel the evader.")
    expect(reach == 4, "whether the end-effector is at the evader depends on both joints and both coordinates.")


@exercise("5.5", "One tube on (q_r, q_p) serves both pursuers: tube[:, :, None] and tube[:, None, :].")
def check_two(avoid_two):
    """Two planar games, lifted, against one in three dimensions."""
    n, numbers = 41, (0.5, 0.2, 0.3, 0.25)
    grid = Grid((-1.0, -1.0), (1.0, 1.0), (n, n), ends="wall")
    got = np.asarray(avoid_two(grid, *numbers))
    expect(got.shape == (n, n, n), "a value for each (q_r, q_a, q_b): broadcast the two tubes and join them.")
    u, v_d, v_p, delta = numbers
    cube = Grid((-1.0,) * 3, (1.0,) * 3, (n,) * 3, ends="wall")
    r, a, b = cube.points().T.reshape(3, n, n, n)
    wall = 0.12 - np.minimum(np.abs(r - a), np.abs(r - b))
    box = Velocities(np.array([u - v_d, -v_p, -v_p]), np.array([u + v_d, v_p, v_p]))
    whole = evolve(cube, wall, box, delta, Scheme(frame="fixed", dtype="float64"), obstacle=wall)
    expect_close(got.transpose(0, 2, 1), got, "the pursuers are alike: exchanging them must change nothing.")
    near = np.abs(whole) < 0.03
    lost = (whole > 0) & ~near
    expect(got[lost] > 0, "some states are called safe from which a pursuer can touch the robot. Is it max or min?")
    safe = (whole <= 0) & ~near
    expect(got[safe] <= 0, "some states are called lost that are safe from both.")
    expect(
        np.abs(got - whole).mean() < 0.02, "the sign is right and the value is not: is it the maximum of the two games?"
    )
    return f"Two games of {n}^2 nodes in place of one of {n}^3."
