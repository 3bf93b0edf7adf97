"""One sampling interval: reach set, avoid tube, the game and its cost (Figs. 6 and 7)."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from sdhj.grid import FloatArray
from illustrations import OneStepGame, Rollouts
from sdhj.plotting.looks import FULL, INK, OUTCOME_INK, UNSAFE, patch
from sdhj.plotting.slices import Plane, draw_constraints, draw_set, plane

CONSTRUCTS = ("reach", "avoid", "reach-avoid")
VIEW = (-0.9, 1.05, -0.5, 0.85)
WIN, THIN_WIN, THIN_LOSS = "#12492f", "#5f9b7d", "#d59a70"
OUTLINE = {"facecolor": "none", "edgecolor": "#0b3c5d", "linewidth": 1.0, "linestyle": (0, (5, 2))}


def construct(game: OneStepGame, name: str) -> FloatArray:
    """Level-set function of one construct of an interval.

    Raises
    ------
    ValueError
        For an unknown name.
    """
    if name not in CONSTRUCTS:
        raise ValueError(f"construct must be one of {', '.join(CONSTRUCTS)}, got {name!r}")
    return {"reach": game.reach, "avoid": game.avoid, "reach-avoid": game.cost}[name]


def _scene(ax: Axes, game: OneStepGame, view: Sequence[float], unsafe: bool) -> Plane:
    """Target, unsafe set and axes in metres; returns the slice."""
    grid, (left, right, bottom, top) = game.problem.grid, view
    parts = None if unsafe else [game.problem.target.name]
    draw_constraints(ax, game.problem, through=(0.0, 0.0), step=1, parts=parts)
    ax.set(xlim=(left, right), ylim=(bottom, top), xlabel="$x$ (m)", ylabel="$y$ (m)", aspect="equal")
    return plane(grid, (0.0, 0.0), resolution=201)


def draw_rollouts(ax: Axes, rollouts: Rollouts, label: str) -> None:
    """Runs from one state against many winds: the worst one bold, red and dashed if the robot loses it."""
    for path, cost in zip(rollouts.paths, rollouts.costs, strict=True):
        ax.plot(*path.T, color=THIN_WIN if cost <= 0 else THIN_LOSS, linestyle="-", linewidth=0.4, zorder=5)
    worst = rollouts.paths[rollouts.worst]
    lost = rollouts.costs.max() > 0
    ax.plot(
        *worst.T,
        color=OUTCOME_INK if lost else WIN,
        linestyle=(0, (4, 1.2)) if lost else "-",
        linewidth=1.5,
        zorder=6,
        gid="defeat" if lost else "win",
    )
    ax.plot(*worst[-1], marker="X" if lost else "o", color=OUTCOME_INK if lost else WIN, markersize=5, zorder=7)
    ax.plot(*worst[0], "o", color=INK, markersize=4.5, zorder=7, gid="start")
    ax.annotate(label, worst[0], (-4, 4), textcoords="offset points", ha="right", va="bottom", zorder=8, fontsize=9)


def draw_one_step(
    ax: Axes,
    game: OneStepGame,
    *,
    show: str = "reach",
    starts: Sequence[tuple[str, Rollouts]] = (),
    view: Sequence[float] = VIEW,
) -> None:
    """A construct of one interval and runs that show why states are in it or not (Figs. 6 and 7).

    Parameters
    ----------
    show : {"reach", "avoid", "reach-avoid"}
        With "reach" the unsafe set plays no part and is left out.
    starts : sequence of (label, Rollouts)
    view : (left, right, bottom, top)
        The part of the lake to show, m.
    """
    values = construct(game, show)
    where = _scene(ax, game, view, unsafe=show != "reach")
    draw_set(ax, where, where.of(game.problem.grid, values), FULL, show, zorder=1.0)
    if show == "reach-avoid":  # what the reach set was without the obstacle
        draw_set(ax, where, where.of(game.problem.grid, game.reach), OUTLINE, "reach", zorder=1.6)
    for label, rollouts in starts:
        draw_rollouts(ax, rollouts, label)


def draw_cost(ax: Axes, game: OneStepGame, *, view: Sequence[float] = VIEW) -> None:
    """Contours of the optimal cost V^j of Eq. (6); its zero level, bold, bounds the reach-avoid set (Fig. 7)."""
    where = _scene(ax, game, view, unsafe=True)
    cost = where.of(game.problem.grid, game.cost)
    levels = np.arange(-0.3, 0.91, 0.1)
    positive = levels > 1e-9
    for chosen, style in ((levels[positive], "--"), (levels[~positive], "-")):
        lines = ax.contour(
            where.x, where.y, cost, levels=chosen, colors=["#666666"], linewidths=0.7, linestyles=style, zorder=1.2
        )
        ax.clabel(lines, [level for level in chosen[::2] if level < 0.4], fontsize=6.5, fmt="%.1f")
    draw_set(ax, where, cost, FULL | {"linewidth": 2.0}, "reach-avoid", zorder=1.0)


def one_step_legend(show: str) -> list[Patch | Line2D]:
    """Legend entries of `draw_one_step`."""
    names = {"reach": r"reach set $\underline{\mathcal{R}}_k^j(\mathcal{S})$", "avoid": r"avoid tube $\mathcal{A}_k^j$"}
    shown = names.get(show, r"reach-avoid set, $V^j \leq 0$")
    entries: list[Patch | Line2D] = [
        Patch(**FULL, label=shown),
        patch("target", r"$\mathcal{S}$, to be in at $t_{k+1}$"),
    ]
    if show != "reach":
        entries.append(Patch(**UNSAFE, label=r"unsafe $\mathcal{G}$"))
    if show == "reach-avoid":
        entries.append(Line2D([], [], color="#0b3c5d", linestyle=(0, (5, 2)), linewidth=1.0, label="reach set alone"))
    entries.append(Line2D([], [], color=WIN, linestyle="-", marker="o", label="worst run, the robot wins"))
    entries.append(Line2D([], [], color=OUTCOME_INK, linestyle=(0, (4, 1.2)), marker="X", label="defeating run"))
    return entries
