"""Five problems are worked out of which the paper says that they can be done.

Joint limits and self-collision of the arm (Sec. 6.1); a robot with extent among obstacles in three dimensions
(Sec. 3.2, Eq. 4); a pursuer whose configurations are not the workspace (Sec. 5.2); an obstacle of any shape on any path
(Sec. 5.3); a mass and a friction that nobody knows (Summary, Eq. 1). Each is solved, played and drawn;
`notebooks/site/worked.md` says what to look at.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from common import PURSUER_AT, Context, command_of
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch, Polygon, Rectangle

import sdhj
from sdhj import plotting
from sdhj.arm.case_studies import scene
from sdhj.common.remembering import FloatArray
from sdhj.plotting.looks import FAINT, INK, ROBOT_LOOKS, UNSAFE_LOOKS
from sdhj.simulation.adversaries import ADVERSARIES
from sdhj.simulation.outcomes import OUTCOMES
from sdhj.simulation.runs import Trajectory, admissible_states, rollouts
from sdhj.table.batches import Table

MAIN_JOB = False
RUNS = 10_000
SHADES = 20  # of the colours of steps to go, in the bar that all slices share
EIGHT = [[0.0, 0.0]] + [[np.cos(a), np.sin(a)] for a in np.pi / 4 * np.arange(8)]  # to stand, and eight directions

# --------------------------------------------------------------------------------------------------------------------
# Joint limits and self-collision
# --------------------------------------------------------------------------------------------------------------------


def folding_arm(nodes: int = 25) -> sdhj.ReachAvoidProblem:
    """The case study's arm, whose first joint has limits and whose forearm must not touch the base it stands on."""
    link, half_width, base, limit = 0.15, 0.01, 0.05, 2.9  # m; rad

    def past_limit(q: FloatArray, t: float) -> FloatArray:  # rad, of the first joint alone
        return limit - np.abs(q[:, 0])

    def folded(q: FloatArray, t: float) -> FloatArray:
        # the base is a disk about the origin; from the elbow it is `along` the forearm and `across` it
        along, across = -link * np.cos(q[:, 0]), link * np.sin(q[:, 0])
        return np.hypot(along - np.clip(along, 0.0, link), across) - base - half_width

    arm = sdhj.arm_case_study(nodes=nodes)
    limits = sdhj.UnsafeSet((0,), past_limit, name="joint limit")
    touches = sdhj.UnsafeSet((1,), folded, name="self-collision")
    return replace(arm, unsafe=(*arm.unsafe, limits, touches), recipe={}, name="arm that folds")


# --------------------------------------------------------------------------------------------------------------------
# A robot with extent in three dimensions
# --------------------------------------------------------------------------------------------------------------------

ROD, RADIUS = 0.5, 0.15  # m
BOXES = (  # lower and upper corners, m: a low wall, a beam over it, a pillar behind
    ((1.4, 0.0, 0.0), (1.6, 3.0, 0.7)),
    ((1.4, 0.0, 1.9), (1.6, 3.0, 2.4)),
    ((2.4, 0.9, 0.0), (2.8, 1.9, 2.4)),
)


def drone(nodes: int = 11, rod: float = ROD, radius: float = RADIUS) -> sdhj.ReachAvoidProblem:
    """A drone from which a load hangs on a rod: a capsule, among boxes; `nodes` a metre."""

    def apart(p: FloatArray, t: float) -> FloatArray:
        # it touches a box where its upper end is in the box, grown upwards by the rod, or within the radius of that
        gaps = []
        for low, high in BOXES:
            beyond = np.maximum(np.array(low) - p, p - np.array(high) - np.array([0.0, 0.0, rod]))
            outside = np.sqrt(np.sum(np.square(np.maximum(beyond, 0.0)), axis=1))
            gaps.append(outside + np.minimum(beyond.max(axis=1), 0.0) - radius)
        return np.minimum(np.minimum(gaps[0], gaps[1]), gaps[2])

    def target(p: FloatArray, t: float) -> FloatArray:
        return np.sqrt(np.square(p[:, 0] - 3.4) + np.square(p[:, 1] - 1.4) + np.square(p[:, 2] - 1.2)) - 0.4

    speeds = 0.8 * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])  # m/s
    size = np.array([4.0, 3.0, 2.4])  # m
    shape = np.rint(nodes * size).astype(int) + 1
    return sdhj.ReachAvoidProblem(
        grid=sdhj.Grid(np.zeros(3), size, shape, names=["$x$ (m)", "$y$ (m)", "$z$ (m)"]),
        dynamics=sdhj.Dynamics(inputs=speeds, drift=speeds, gain=np.eye(3), bounds=[0.1, 0.1, 0.1]),
        target=sdhj.TargetSet((0, 1, 2), target),
        unsafe=[sdhj.UnsafeSet((0, 1, 2), apart, name="boxes")],
        delta=0.25,
        steps=32,
        name="drone",
    )


# --------------------------------------------------------------------------------------------------------------------
# A pursuer on a circle
# --------------------------------------------------------------------------------------------------------------------

TRACK, REACH = 1.0, 0.45  # m: of the circle; of both disks together


def ring(nodes: int = 41) -> sdhj.ReachAvoidProblem:
    """A robot that has to get to the middle of a circular track, on which a guard runs: C^p is an angle, W a plane."""

    def caught(q: FloatArray, t: float) -> FloatArray:
        return np.hypot(q[:, 0] - TRACK * np.cos(q[:, 2]), q[:, 1] - TRACK * np.sin(q[:, 2])) - REACH

    speeds = 0.8 * np.array([[*direction, 0.0] for direction in EIGHT])  # m/s, m/s; the guard's angle is not ours
    names = ["$x$ (m)", "$y$ (m)", "guard (rad)"]
    return sdhj.ReachAvoidProblem(
        grid=sdhj.Grid([-2, -2, -np.pi], [2, 2, np.pi], [nodes, nodes, nodes - 1], [False, False, True], names),
        dynamics=sdhj.Dynamics(inputs=speeds, drift=speeds, gain=np.eye(3), bounds=[0.1, 0.1, 0.5]),  # m/s, m/s, rad/s
        target=sdhj.TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0], p[:, 1]) - 0.3),
        unsafe=[sdhj.UnsafeSet((0, 1, 2), caught, name="pursuer")],
        delta=0.2,
        steps=16,
        name="ring",
    )


# --------------------------------------------------------------------------------------------------------------------
# An obstacle that is no disk on a path that is no line
# --------------------------------------------------------------------------------------------------------------------

BAR, AMPLITUDE, PACE, SPIN = (0.55, 0.08), (0.5, 0.4), 1.2, 0.9  # m (half sides), m, rad/s, rad/s


def bar_at(t: Any) -> tuple[Any, Any, Any]:
    """Where the middle of the bar is at a time, on a figure of eight, and at what angle it stands."""
    return AMPLITUDE[0] * np.sin(PACE * t), AMPLITUDE[1] * np.sin(2 * PACE * t), SPIN * t


def swinging_bar(nodes: int = 31, radius: float = 0.1) -> sdhj.ReachAvoidProblem:
    """A disk robot and a bar that turns while its middle runs along a figure of eight; `nodes` on the shorter side."""

    def apart(p: FloatArray, t: float) -> FloatArray:
        x, y, angle = bar_at(t)
        cos, sin = np.cos(angle), np.sin(angle)
        along = np.abs(cos * (p[:, 0] - x) + sin * (p[:, 1] - y)) - BAR[0]
        across = np.abs(cos * (p[:, 1] - y) - sin * (p[:, 0] - x)) - BAR[1]
        outside = np.hypot(np.maximum(along, 0.0), np.maximum(across, 0.0))
        return outside + np.minimum(np.maximum(along, across), 0.0) - radius

    speeds = 0.6 * np.array(EIGHT)  # m/s
    return sdhj.ReachAvoidProblem(
        grid=sdhj.Grid([-1.5, -1], [1.5, 1], [3 * (nodes - 1) // 2 + 1, nodes], names=["$x$ (m)", "$y$ (m)"]),
        dynamics=sdhj.Dynamics(inputs=speeds, drift=speeds, gain=np.eye(2), bounds=[0.1, 0.1]),
        target=sdhj.TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 1.1, p[:, 1] - 0.5) - 0.3),
        unsafe=[sdhj.UnsafeSet((0, 1), apart, name="bar")],
        delta=0.2,
        steps=20,
        view_time="swept",
        name="bar",
    )


# --------------------------------------------------------------------------------------------------------------------
# A mass and a friction that nobody knows
# --------------------------------------------------------------------------------------------------------------------

MASS, FRICTION = (0.8, 1.25), (0.2, 0.6)  # kg, 1/s: between these


def loaded_cart(nodes: int = 81, *, known: bool = False) -> sdhj.ReachAvoidProblem:
    """A cart, dv/dt = u / m - c v, whose load and bearings are not known; `known`: as if both were in the middle.

    1 / m and c enter linearly, so each is its middle and a component of the adversary's: the columns of the gain are u
    and -v. The adversary may change both at any time, and every constant value is one of its choices.
    """
    inverse = np.array([1 / MASS[1], 1 / MASS[0]])  # 1/kg
    middle, spread = (np.array([f(inverse), f(np.array(FRICTION))]) for f in (np.mean, np.ptp))

    def drift(q: FloatArray, u: FloatArray) -> FloatArray:
        return np.stack([q[:, 1], u[0] * middle[0] - middle[1] * q[:, 1]], axis=1)

    def gain(q: FloatArray, u: FloatArray) -> FloatArray:
        nothing = 0.0 * q[:, 1]
        return np.stack([np.stack([nothing, nothing], axis=1), np.stack([nothing + u[0], -q[:, 1]], axis=1)], axis=1)

    return sdhj.ReachAvoidProblem(
        grid=sdhj.Grid([-1, -2], [1, 2], [nodes, nodes], names=["$x$ (m)", "$v$ (m/s)"]),
        dynamics=sdhj.Dynamics(
            inputs=[[-2.0], [-1.0], [0.0], [1.0], [2.0]],  # N
            drift=drift,
            gain=gain,
            bounds=(0.0 if known else 0.5) * spread,
        ),
        target=sdhj.TargetSet((0, 1), lambda q, t: np.maximum(np.abs(q[:, 0] - 0.6) / 0.1, np.abs(q[:, 1]) / 0.3) - 1),
        unsafe=[],
        delta=0.1,
        steps=25,
        name="cart",
    )


# --------------------------------------------------------------------------------------------------------------------
# What is seen of them
# --------------------------------------------------------------------------------------------------------------------

KNOWN = {"facecolor": "none", "edgecolor": INK, "linewidth": 1.0, "linestyle": (0, (4, 1.5))}
BODY = {"facecolor": "none", "edgecolor": ROBOT_LOOKS["edgecolor"], "linewidth": 0.8, "zorder": 6.2}


def draw_slice(ax: Axes, table: Table, run: Trajectory, axes: tuple[int, int]) -> None:
    """The tubes through the state at which a run begins, what is unsafe there, and the run."""
    plotting.draw_tubes(ax, table, through=run.states[0], axes=axes)
    plotting.draw_path(ax, table.grid, run.states, axes, marks=run.samples, linewidth=1.2)
    ax.set_aspect(0.5 if table.problem.name == "cart" else "equal")


def draw_poses(ax: Axes, table: Table, run: Trajectory) -> None:
    """The workspace at a run's end, the arm at all its sampling times, and the base."""
    view = scene(sdhj.arm_case_study(nodes=5))
    plotting.draw_workspace(ax, view, state=run.states[-1], time=float(run.times[-1]))
    for q in run.samples[:-1]:
        plotting.draw_arm(ax, view, q[:2], alpha=0.35, zorder=4.0)
    ax.add_artist(Circle((0, 0), 0.05, zorder=3.0, gid="base", facecolor=FAINT, edgecolor=INK))
    ax.set_title("the run, seen in the workspace")


def draw_capsules(ax: Axes, table: Table, run: Trajectory) -> None:
    """The boxes that are cut, and the robot once a second."""
    for low, high in BOXES:
        if low[1] <= run.states[0, 1] <= high[1]:
            sides = high[0] - low[0], high[2] - low[2]
            ax.add_artist(Rectangle((low[0], low[2]), *sides, zorder=5.5, gid="box", facecolor=FAINT, edgecolor=INK))
    for x, _, z in run.samples[::4]:
        round_ends = f"round,pad={RADIUS},rounding_size={RADIUS}"
        ax.add_artist(FancyBboxPatch((x, z - ROD), 0.0, ROD, boxstyle=round_ends, gid="robot", **BODY))


def draw_track(ax: Axes, table: Table, run: Trajectory) -> None:
    """The track, and where the guard is at the run's sampling times: full at the last of them."""
    ax.add_artist(Circle((0, 0), TRACK, facecolor="none", edgecolor=INK, linestyle=":", zorder=3.0, gid="track"))
    at = TRACK * np.stack([np.cos(run.states[:, 2]), np.sin(run.states[:, 2])], axis=1)
    ax.plot(*at.T, color=INK, linewidth=1.6, zorder=5.0, gid="guard")
    ax.plot(*at[0], "o", color="white", markeredgecolor=INK, zorder=5.1)
    ax.plot(*at[-1], "o", color=INK, zorder=5.2)


def draw_bars(ax: Axes, table: Table, run: Trajectory) -> None:
    """The way of the bar's middle, and the bar at every fourth sampling time, darker later."""
    ax.plot(*bar_at(np.linspace(0.0, 2 * np.pi / PACE, 200))[:2], color=INK, linestyle=":", linewidth=0.8, zorder=3.0)
    for k, t in enumerate(np.arange(0.0, float(run.times[-1]) + 1e-9, 4 * table.problem.delta)):
        x, y, angle = bar_at(t)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * BAR @ turn.T + [x, y]
        looks = {"facecolor": UNSAFE_LOOKS["facecolor"], "edgecolor": UNSAFE_LOOKS["edgecolor"], "linewidth": 0.7}
        ax.add_artist(Polygon(corners, alpha=min(0.25 + 0.2 * k, 1.0), zorder=3.2 + 0.1 * k, gid="bar", **looks))


def draw_known(ax: Axes, unaware: Table, run: Trajectory) -> None:
    """What would be won if mass and friction were known."""
    where = plotting.plane(unaware.grid, run.states[0])
    values = where.of(unaware.grid, unaware.values(start=0, within=unaware.steps))
    plotting.draw_set(ax, where, values, KNOWN, "known", zorder=5.0)


# --------------------------------------------------------------------------------------------------------------------
# Solved, played, drawn
# --------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Worked:
    """A problem, and what is done with it.

    Attributes
    ----------
    problem : callable (nodes) -> ReachAvoidProblem
    unaware : callable (nodes) -> ReachAvoidProblem
        The same without what it is about.
    nodes : (int, int)
        For a quick look, and for a good one.
    draw : callable (ax, unaware's table, run)
        What is seen beside a slice of the tubes.
    start : (ndim,)
        The run that is shown starts from where it takes longest, near here.
    axes : (int, int)
        Of the slice that is shown.
    """

    problem: Callable[..., sdhj.ReachAvoidProblem]
    unaware: Callable[..., sdhj.ReachAvoidProblem]
    nodes: tuple[int, int]
    draw: Callable[[Axes, Table, Trajectory], None]
    start: tuple[float, ...]
    axes: tuple[int, int] = (0, 1)


WORKED = {
    "arm": Worked(
        folding_arm, lambda n: sdhj.arm_case_study(nodes=n), (13, 25), draw_poses, (-2.6, 1.0, *PURSUER_AT[2:])
    ),
    "drone": Worked(drone, lambda n: drone(n, rod=0.0, radius=0.0), (5, 11), draw_capsules, (0.4, 2.5, 0.8), (0, 2)),
    "ring": Worked(ring, lambda n: replace(ring(n), unsafe=()), (21, 41), draw_track, (-1.5, 0.1, np.pi)),
    "bar": Worked(swinging_bar, lambda n: replace(swinging_bar(n), unsafe=()), (21, 31), draw_bars, (-1.2, -0.4)),
    "cart": Worked(loaded_cart, lambda n: loaded_cart(n, known=True), (41, 81), draw_known, (-0.8, 0.0)),
}


def lost(table: Table, problem: sdhj.ReachAvoidProblem, adversary: str, runs: int) -> float:
    """Share of a table's runs that do not reach the target in the world of a problem.

    They begin in states that are drawn uniformly from the table's tube, less those that are unsafe from the beginning.
    """
    controller, rng = sdhj.Controller(table), np.random.default_rng(0)
    controller.problem = problem  # the plant's: the table knows its own alone
    starts = admissible_states(controller, runs, rng)
    starts = starts[problem.unsafe_value(starts, problem.time(0)) > 0]
    outcomes, _ = rollouts(controller, starts, ADVERSARIES[adversary], rng)
    return float(np.mean(outcomes != OUTCOMES.index("reached")))


def row(name: str, table: Table, unaware: Table, runs: int) -> str:
    """Size, share, and shares of runs lost, of the table and of one that is unaware, as a row of a table."""
    problem = table.problem
    cells = [name, " x ".join(map(str, problem.grid.shape)), str(problem.steps)]
    for one in (table, unaware):
        cells.append(f"{one.fraction(start=0, within=one.steps):.4f}")
        cells += [f"{lost(one, problem, adversary, runs):.2%}" for adversary in ("random", "worst")]
    return f"| {' | '.join(cells)} |"


def shown_run(table: Table, near: tuple[float, ...]) -> Trajectory:
    """A run against "worst" from where it takes longest: of the nodes well inside, the one nearest to a state."""
    grid, most = table.grid, table.steps
    values = [table.values(start=0, within=n) for n in range(most + 1)]
    last = max(n for n in range(most + 1) if n == 0 or ((values[n] <= 0) & (values[n - 1] > 0)).any())
    there = (values[last] <= 0) & (values[last - 1] > 0 if last else True)
    deep = there & (values[last] <= np.quantile(values[last][there], 0.3))
    points = grid.points()[deep.ravel()]
    start = points[np.argmin(np.square((points - np.array(near)) / grid.spacing).sum(axis=1))]
    return sdhj.simulate(sdhj.Controller(table), start, adversary="worst", seed=0)


def value(context: Context) -> list[float]:
    """The share that is won of each problem, on coarse grids."""
    tables = (sdhj.solve(worked.problem(worked.nodes[0]), progress=False) for worked in WORKED.values())
    return [table.fraction(start=0, within=table.steps) for table in tables]


def draw(context: Context) -> Figure:
    quick, runs = (0, 200) if context.coarse else (1, RUNS)
    figure = plotting.new_figure(7.4, 6.1)
    rows = ["arm", "workspace", "drone"], ["ring", "bar", "cart"], ["steps"] * 3
    parts = figure.subplot_mosaic([*rows], height_ratios=(1.0, 1.0, 0.05))
    colours = ScalarMappable(Normalize(0, 1), ListedColormap(plotting.step_colours(SHADES)))
    bar = figure.colorbar(colours, cax=parts["steps"], orientation="horizontal", ticks=(0, 0.5, 1))
    bar.set_label("steps to go, as a share of the problem's steps; from white nothing is promised")
    context.say("| problem | nodes | steps | share | random | worst | unaware: share | random | worst |")
    context.say("| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    for name, worked in WORKED.items():
        nodes = worked.nodes[quick]
        table, unaware = (sdhj.solve(of(nodes), progress=False) for of in (worked.problem, worked.unaware))
        context.say(row(name, table, unaware, runs))
        run = shown_run(table, worked.start)
        draw_slice(parts[name], table, run, worked.axes)
        worked.draw(parts["workspace" if name == "arm" else name], unaware, run)
        parts[name].set_title(f"{name}, {table.fraction(start=0, within=table.steps):.0%} won")
    return figure


if __name__ == "__main__":
    command_of(__file__)()
