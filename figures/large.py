"""Where the projection question matters: a car, an arm of three links and a point in space, in five and six dimensions.

`python figures/large.py -o large.png` solves each problem in full and by projections onto one axis less (Sec. 5.1),
draws both, certifies what it can, and has `judge` play the tables: nothing of the library but the controller's choice
is in those runs.
`--store FOLDER` keeps the full tables there and solves them slab by slab.
"""

import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise
from pathlib import Path
from typing import Any

import click
import judge
import numpy as np
from fig13_comparison import comparison_legend, draw_comparison, kept_share
from matplotlib.figure import Figure

import sdhj
from sdhj import plotting
from sdhj.cli import SEED, plainly, writable_picture
from sdhj.grid import FloatArray
from sdhj.table import Table

Velocity = Callable[[FloatArray, FloatArray, FloatArray, float], FloatArray]  # (states, inputs (M, m), signs, t)
Level = Callable[[FloatArray, float], FloatArray]
DRAWN = 200_000  # states among which starts are looked for, at a time


@dataclass(frozen=True)
class Worked:
    """A problem, and its robot written once more for the judge.

    Attributes
    ----------
    problem : callable (nodes) -> ReachAvoidProblem
    nodes : int
        Along the axes that have most.
    subspaces : of the projected method.
    cells : of the certified method, or none where what fits into minutes proves no more than the target.
    velocity, target, unsafe : as `judge.play` takes them, of inputs instead of their places.
    hunt : callable (states, inputs (M, m), seconds left) -> (M, D) in [-1, 1]
        An adversary that does its worst.
    slices : states through which the pictures of the first two axes go.
    """

    problem: Callable[[int], sdhj.ReachAvoidProblem]
    nodes: int
    subspaces: tuple[tuple[int, ...], ...]
    cells: tuple[int, ...]
    velocity: Velocity
    target: Level
    unsafe: Level
    hunt: Callable[[FloatArray, FloatArray, float], FloatArray]
    slices: tuple[tuple[float, ...], ...]


def distance(points: FloatArray, centre: Any) -> Any:
    """Of points (M, n) from a place: n coordinates, numbers or (M,)."""
    return reduce(np.hypot, (points[:, axis] - x for axis, x in enumerate(centre)))


def confined(places: FloatArray, velocity: FloatArray, box: float) -> FloatArray:
    """The velocity (M, 2) of a pursuer that cannot pass the walls of its box: it stops 10 ms before them."""
    return np.where(np.abs(places + 0.01 * velocity) > box, 0.0, velocity)


# ---- a car, a pursuer and a disk that crosses its way: (x, y, heading, px, py)

GOAL, PURSUER_SPEED, CAPTURE = (1.2, 0.6), 0.3, 0.4


def crossing(t: float) -> tuple[float, float]:
    return 0.3, -1.0 + 0.6 * t


def car_velocity(q: FloatArray, u: FloatArray, signs: FloatArray, t: float) -> FloatArray:
    pursuer = confined(q[:, 3:], PURSUER_SPEED * signs, 2.0)
    return np.column_stack([np.cos(q[:, 2]), np.sin(q[:, 2]), u[:, 0], pursuer])


def car(nodes: int) -> sdhj.ReachAvoidProblem:
    def drift(q: FloatArray, u: FloatArray) -> FloatArray:
        still = np.zeros(len(q))
        return np.stack([np.cos(q[:, 2]), np.sin(q[:, 2]), still + u[0], still, still], axis=1)

    names = ["x (m)", "y (m)", "heading (rad)", "pursuer x (m)", "pursuer y (m)"]
    ends, periodic = ["unsafe"] * 3 + ["wall"] * 2, [False, False, True, False, False]
    return sdhj.ReachAvoidProblem(
        sdhj.Grid([-2, -2, -np.pi, -2, -2], [2, 2, np.pi, 2, 2], [nodes] * 5, periodic, names, ends),
        sdhj.Dynamics([[-1.5], [0.0], [1.5]], drift, np.eye(5)[:, 3:], [PURSUER_SPEED] * 2),
        sdhj.TargetSet((0, 1), lambda p, t: distance(p, GOAL) - 0.5),
        [
            sdhj.UnsafeSet(
                (0, 1, 3, 4), lambda p, t: distance(p, (p[:, 2], p[:, 3])) - CAPTURE, name="pursuer", sampling="steep"
            ),
            sdhj.UnsafeSet((0, 1), lambda p, t: distance(p, crossing(t)) - 0.4, rate=0.6, name="disk"),
        ],
        delta=0.4,
        steps=4,
        name="car",
    )


def car_unsafe(q: FloatArray, t: float) -> FloatArray:
    beyond = np.abs(q[:, :2]).max(axis=1) - 2.0
    return np.minimum(np.minimum(distance(q, q[:, 3:].T), distance(q, crossing(t))) - 0.4, -beyond + 1e-9)


def car_hunt(q: FloatArray, u: FloatArray, left: float) -> FloatArray:
    ahead = left * np.column_stack([np.cos(q[:, 2]), np.sin(q[:, 2])])
    return np.sign(q[:, :2] + ahead - q[:, 3:])


# ---- an arm of three links and a pursuer: (q1, q2, q3, px, py)

LINK, BOX, CATCH, TIP, REACH = 0.1, 0.36, 0.05, (0.05, 0.2), 0.08
POST, POST_RADIUS = (-0.2, 0.1), 0.07
MIGHT = np.array([0.3, 0.3, 0.3, 0.2, 0.2])  # of the adversary, rad/s and m/s


def joints(q: FloatArray) -> list[tuple[Any, Any]]:
    """Base, elbows and tip of states (M, >= 3): four places."""
    found, angle = [(0.0 * q[:, 0], 0.0 * q[:, 0])], 0.0
    for joint in range(3):
        angle = angle + q[:, joint]
        found.append((found[-1][0] + LINK * np.cos(angle), found[-1][1] + LINK * np.sin(angle)))
    return found


def clear_of(q: FloatArray, x: Any, y: Any) -> Any:
    """Distance (M,) of the links from a point, or from one for each state."""
    gaps = []
    for (x0, y0), (x1, y1) in pairwise(joints(q)):
        along = np.clip(((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / LINK**2, 0.0, 1.0)
        gaps.append(np.hypot(x0 + along * (x1 - x0) - x, y0 + along * (y1 - y0) - y))
    return reduce(np.minimum, gaps)


def tip_off(q: FloatArray) -> Any:
    """Distance (M,) of the tip from the middle of the target."""
    x, y = joints(q)[-1]
    return np.hypot(x - TIP[0], y - TIP[1])


def arm_velocity(q: FloatArray, u: FloatArray, signs: FloatArray, t: float) -> FloatArray:
    v = MIGHT * signs
    return np.column_stack([u + v[:, :3], confined(q[:, 3:], v[:, 3:], BOX)])


def arm(nodes: int) -> sdhj.ReachAvoidProblem:
    levels = np.array([-3.0, 0.0, 3.0])
    inputs = np.stack(np.meshgrid(levels, levels, levels, indexing="ij"), axis=-1).reshape(-1, 3)
    names = ["q1 (rad)", "q2 (rad)", "q3 (rad)", "px (m)", "py (m)"]
    low, high = [-np.pi] * 3 + [-BOX] * 2, [np.pi] * 3 + [BOX] * 2
    return sdhj.ReachAvoidProblem(
        sdhj.Grid(low, high, [nodes] * 5, [True] * 3 + [False] * 2, names, ["unsafe"] * 3 + ["wall"] * 2),
        sdhj.Dynamics(inputs, np.pad(inputs, ((0, 0), (0, 2))), np.eye(5), MIGHT),
        sdhj.TargetSet((0, 1, 2), lambda q, t: tip_off(q) - REACH),
        [
            sdhj.UnsafeSet(tuple(range(5)), lambda q, t: clear_of(q, q[:, 3], q[:, 4]) - CATCH, name="pursuer"),
            sdhj.UnsafeSet((0, 1, 2), lambda q, t: clear_of(q, *POST) - POST_RADIUS, name="post"),
        ],
        delta=0.1,
        steps=8,
        name="arm of three links",
    )


def arm_hunt(q: FloatArray, u: FloatArray, left: float) -> FloatArray:
    apart = np.array(joints(q[:, :3] + left * u)[1:]).swapaxes(1, 2) - q[:, 3:]
    nearest = np.argmin(np.linalg.norm(apart, axis=2), axis=0)
    return np.column_stack([np.sign(u + 1e-9), np.sign(apart[nearest, np.arange(len(q))])])


# ---- a point that accelerates in space: (x, y, z, vx, vy, vz)

PUSH, GUST, PLACE, BALL, BALL_RADIUS = 1.5, 0.1, (0.0, 0.0, 0.0), (0.7, 0.5, 0.0), 0.35


def space_velocity(q: FloatArray, u: FloatArray, signs: FloatArray, t: float) -> FloatArray:
    return np.column_stack([q[:, 3:], u + GUST * signs])


def space(nodes: int) -> sdhj.ReachAvoidProblem:
    corners = np.stack(np.meshgrid(*[(-PUSH, PUSH)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)

    def drift(q: FloatArray, u: FloatArray) -> FloatArray:
        return np.column_stack([q[:, 3:], np.tile(u, (len(q), 1))])

    names = ["x (m)", "y (m)", "z (m)", "vx (m/s)", "vy (m/s)", "vz (m/s)"]
    shape = [nodes] * 3 + [nodes // 2 + 1] * 3
    return sdhj.ReachAvoidProblem(
        sdhj.Grid([-1.2] * 6, [1.2] * 6, shape, names=names),
        sdhj.Dynamics(np.vstack([np.zeros(3), corners]), drift, np.eye(6)[:, 3:], [GUST] * 3),
        sdhj.TargetSet((0, 1, 2), lambda p, t: distance(p, PLACE) - 0.45),
        [sdhj.UnsafeSet((0, 1, 2), lambda p, t: distance(p, BALL) - BALL_RADIUS, name="ball")],
        delta=0.3,
        steps=4,
        name="point in space",
    )


def space_unsafe(q: FloatArray, t: float) -> FloatArray:
    return np.minimum(distance(q, BALL) - BALL_RADIUS, 1.2 + 1e-9 - np.abs(q).max(axis=1))


def space_hunt(q: FloatArray, u: FloatArray, left: float) -> FloatArray:
    return np.sign(BALL - q[:, :3] - left * q[:, 3:])


WORKED: Mapping[str, Worked] = {
    "car": Worked(
        car,
        25,
        ((0, 1, 2, 3), (0, 1, 2, 4)),
        (32, 32, 24, 12, 12),
        car_velocity,
        lambda q, t: distance(q, GOAL) - 0.5,
        car_unsafe,
        car_hunt,
        ((0, 0, 0.0, 0.0, -1.0), (0, 0, 0.8, 1.0, 0.0), (0, 0, 1.6, 1.6, 1.4)),
    ),
    "arm": Worked(
        arm,
        25,
        ((0, 1, 2, 3), (0, 1, 2, 4)),
        (),
        arm_velocity,
        lambda q, t: tip_off(q) - REACH,
        lambda q, t: np.minimum(clear_of(q, q[:, 3], q[:, 4]) - CATCH, clear_of(q, *POST) - POST_RADIUS),
        arm_hunt,
        ((0, 0, 0.0, 0.24, 0.24), (0, 0, 0.8, -0.15, 0.21), (0, 0, -0.8, 0.3, 0.03)),
    ),
    "space": Worked(
        space,
        17,
        ((0, 1, 2, 3, 4), (0, 1, 2, 3, 5), (0, 1, 2, 4, 5)),
        (20, 20, 20, 10, 10, 10),
        space_velocity,
        lambda q, t: distance(q, PLACE) - 0.45,
        space_unsafe,
        space_hunt,
        ((0, 0, 0, 0.0, 0.0, 0.0), (0, 0, 0, 0.6, 0.3, 0.0), (0, 0, 0.4, 0.0, -0.6, -0.3)),
    ),
}


# ---- solved, judged and drawn


def promised(table: Table, count: int, seed: int) -> FloatArray:
    """Up to `count` states (M, ndim), drawn uniformly, from which a table promises to reach the target."""
    rng, found = np.random.default_rng(seed), []
    for _ in range(20):
        states = rng.uniform(table.grid.lower, table.grid.upper, (DRAWN, table.grid.ndim))
        found.append(states[table.contains(states, start=0, within=table.steps)])
        if sum(map(len, found)) >= count:
            break
    return np.concatenate(found)[:count]


def judged(robot: Worked, table: Table, starts: FloatArray, seed: int = 0) -> Counter[str]:
    """Outcomes of runs from `starts`: every other one against `hunt`, the rest against corners drawn at random."""
    controller, inputs, delta = sdhj.Controller(table), table.problem.inputs, table.problem.delta
    rng, hunted = np.random.default_rng(seed), np.arange(len(starts)) % 2 == 0

    def signs(q: FloatArray, j: FloatArray, t: float, end: float) -> FloatArray:
        worst = robot.hunt(q, inputs[np.maximum(j, 0)], end - t)
        return np.where(hunted[:, None], worst, rng.choice([-1.0, 1.0], worst.shape))

    outcomes = judge.play(
        lambda q, step: controller.choose(controller.batch(q, step)),
        lambda q, j, v, t: robot.velocity(q, inputs[np.maximum(j, 0)], v, t),
        signs,
        robot.target,
        robot.unsafe,
        starts,
        delta=delta,
        steps=table.steps,
    )
    return Counter(outcomes.tolist())


def row(name: str, table: Table, seconds: float, runs: int, seed: int) -> str:
    """What a table holds, took and kept, a line of the printed table."""
    share = table.fraction(start=0, within=table.steps)
    counts = judged(WORKED[name], table, promised(table, runs, seed), seed)
    lost = ", ".join(f"{way} {count}" for way, count in counts.items() if way != "reached") or "none"
    shape = " x ".join(map(str, WORKED[name].cells if table.method == "certified" else table.grid.shape))
    told = name, table.method, shape, f"{seconds:.0f}", f"{share:.4f}", f"{counts.total():,}", lost
    return f"| {' | '.join(told)} |"


def draw(pairs: Mapping[str, tuple[Table, Table]]) -> Figure:
    """A row of slices for each robot, full and projected tubes over each other."""
    figure = plotting.new_figure(7.0, 0.4 + 2.4 * len(pairs))
    panels = figure.subplots(len(pairs), 3, squeeze=False)
    for axes, (name, (full, inner)) in zip(panels, pairs.items(), strict=True):
        for ax, through in zip(axes, WORKED[name].slices, strict=True):
            draw_comparison(ax, full, inner, through=through)
            at = ", ".join(f"{x:g}" for x in through[2:])
            ax.set_title(f"({at}): {kept_share(full, inner, through):.0%} kept", fontsize=7)
    figure.legend(handles=comparison_legend(), loc="outside upper center", ncols=4, handleheight=1.1)
    return figure


@click.command(context_settings={"show_default": True})
@click.option("--robot", "names", multiple=True, type=click.Choice(list(WORKED)), help="Which; by default all.")
@click.option("--nodes", type=click.IntRange(9), help="Nodes along most axes; by default 25, in space 17.")
@click.option("--runs", default=4000, type=click.IntRange(1), help="Runs of each table.")
@click.option("--seed", default=0, type=SEED)
@click.option("--store", type=click.Path(path_type=Path), help="A folder for the full tables.")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="A picture: a png or pdf file.")
@plainly
def main(names: tuple[str, ...], nodes: int | None, runs: int, seed: int, store: Path | None, output: Path) -> None:
    """Solve, judge and draw."""
    if output is not None:
        writable_picture(output, [".png", ".pdf"])
    pairs = {}
    click.echo("| robot | method | nodes or cells | s | share | runs | lost |\n|---|---|---|---|---|---|---|")
    for name in names or WORKED:
        robot, tables = WORKED[name], []
        problem = robot.problem(nodes or robot.nodes)
        methods: list[Any] = [sdhj.HJI(), sdhj.Projected(robot.subspaces)]
        if robot.cells:
            methods.append(sdhj.Certified(cells=robot.cells))
        for method in methods:
            kept = store / f"{name}.zarr" if store and method.name == "hji" else None
            began = time.perf_counter()
            tables.append(sdhj.solve(problem, method, store=kept))
            click.echo(row(name, tables[-1], time.perf_counter() - began, runs, seed))
        pairs[name] = tables[0], tables[1]
    if output is not None:
        with plotting.style():
            plotting.write(draw(pairs), output)
        click.echo(output)


if __name__ == "__main__":
    main()
