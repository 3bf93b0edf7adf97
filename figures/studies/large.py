"""Where the projection question matters: a car, two arms and a point in space, in five and six dimensions.

`python figures/studies/large.py -o large.png` solves each problem in full and by projections onto one axis less (Sec.
5.1), draws both, certifies what it can, and has `judge` play the tables: nothing of the library but the controller's
choice is in those runs. Motion and adversary are written twice, for the problem and for the judge; distances once.
`--store FOLDER` keeps the full tables there.
"""

import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any

import click
import numpy as np
from matplotlib.figure import Figure

import sdhj
from sdhj import plotting
from sdhj.certified.table import CertifiedTable
from sdhj.cli import SEED, plainly
from sdhj.common.remembering import FloatArray
from sdhj.plotting.looks import writable_picture
from sdhj.table.batches import Table

sys.path.append(str(Path(__file__).parents[1]))  # the scripts are no package to install
sys.path.append(str(Path(__file__).parents[2] / "tests" / "lib"))  # where the judge and robots are

import judge
from fig13_comparison import comparison_legend, draw_comparison, kept_share
from fleet import ArmPursued, confined

Velocity = Callable[[FloatArray, FloatArray, FloatArray, float], FloatArray]  # (states, inputs (M, m), signs, t)
Level = Callable[[FloatArray, float], FloatArray]
DRAWN = 200_000  # states among which starts are looked for, at a time


@dataclass(frozen=True)
class Worked:
    """A problem, and the motion of its robot once more, for the judge.

    Attributes
    ----------
    problem : callable (nodes) -> ReachAvoidProblem
    nodes : int
        Along the axes that have most.
    subspaces : of the projected method.
    cells : of the certified method, None for those that it chooses itself; empty where what fits into minutes proves no
        more than the target.
    velocity, target, unsafe : as `judge.play` takes them, of inputs instead of their places.
    hunt : callable (states, inputs (M, m), seconds left) -> (M, D) in [-1, 1]
        An adversary that does its worst.
    slices : states through which the pictures of the first two axes go.
    """

    problem: Callable[[int], sdhj.ReachAvoidProblem]
    nodes: int
    subspaces: tuple[tuple[int, ...], ...]
    cells: tuple[int, ...] | None
    velocity: Velocity
    target: Level
    unsafe: Level
    hunt: Callable[[FloatArray, FloatArray, float], FloatArray]
    slices: tuple[tuple[float, ...], ...]


def distance(points: FloatArray, centre: Any) -> Any:
    """Of points (M, n) from a place: n coordinates, numbers or (M,)."""
    return reduce(np.hypot, (points[:, axis] - x for axis, x in enumerate(centre)))


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
            sdhj.UnsafeSet((0, 1), lambda p, t: distance(p, crossing(t)) - 0.4, name="disk"),
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


def arm(
    links: int, pursuers: int, nodes: int, slices: tuple[tuple[float, ...], ...], cells: tuple[int, ...] | None = ()
) -> Worked:
    """An arm to be worked on; projections drop a coordinate of a pursuer."""
    robot, ndim = ArmPursued(links, pursuers), links + 2 * pursuers
    dropped = tuple(tuple(axis for axis in range(ndim) if axis != drop) for drop in range(links, ndim))
    functions = robot.velocity, robot.target, robot.unsafe, robot.hunt
    return Worked(robot.problem, nodes, dropped, cells, *functions, tuple((0.0, 0.0, *rest) for rest in slices))


WORKED: Mapping[str, Worked] = {
    "car": Worked(
        car,
        25,
        ((0, 1, 2, 3), (0, 1, 2, 4)),
        None,
        car_velocity,
        lambda q, t: distance(q, GOAL) - 0.5,
        car_unsafe,
        car_hunt,
        ((0, 0, 0.0, 0.0, -1.0), (0, 0, 0.8, 1.0, 0.0), (0, 0, 1.6, 1.6, 1.4)),
    ),
    "arm": arm(3, 1, 25, ((0.0, 0.24, 0.24), (0.8, -0.15, 0.21), (-0.8, 0.3, 0.03)), None),
    "hunted": arm(2, 2, 15, ((0.24, 0.24, -0.3, 0.0), (-0.15, 0.21, 0.3, 0.03), (0.3, 0.03, 0.0, -0.3))),
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
    own = table.shape if isinstance(table, CertifiedTable) else table.grid.shape  # cells that are asked for are aligned
    shape = " x ".join(map(str, own))
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
@click.option("--nodes", type=click.IntRange(9), help="Nodes along most axes, instead of those that fit into minutes.")
@click.option("--full", default="hji", type=click.Choice(["hji", "lax"]), help="The method of the full tables.")
@click.option("--full-only", is_flag=True, help="Neither projected nor certified tables, and no picture.")
@click.option("--runs", default=4000, type=click.IntRange(1), help="Runs of each table.")
@click.option("--seed", default=0, type=SEED)
@click.option("--store", type=click.Path(path_type=Path), help="A folder for the full tables.")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="A picture: a png or pdf file.")
@plainly
def main(
    names: tuple[str, ...],
    nodes: int | None,
    full: str,
    full_only: bool,
    runs: int,
    seed: int,
    store: Path | None,
    output: Path | None,
) -> None:
    """Solve, judge and draw."""
    if output is not None:
        if full_only:
            raise click.UsageError(
                "-o draws full and projected tables over each other, and --full-only solves no projected one"
            )
        writable_picture(output, [".png", ".pdf"])
    pairs = {}
    click.echo("| robot | method | nodes or cells | s | share | runs | lost |\n|---|---|---|---|---|---|---|")
    for name in names or WORKED:
        robot, tables = WORKED[name], []
        problem = robot.problem(nodes or robot.nodes)
        chosen = sdhj.HopfLax() if full == "lax" else sdhj.HJI()
        methods: list[Any] = [chosen] if full_only else [chosen, sdhj.Projected(robot.subspaces, chosen)]
        if robot.cells != () and not full_only:
            methods.append(sdhj.Certified(cells=robot.cells))
        for method in methods:
            kept = {"store": store / f"{name}"} if store and method is chosen else {}
            began = time.perf_counter()
            tables.append(sdhj.solve(problem, method, **kept))
            click.echo(row(name, tables[-1], time.perf_counter() - began, runs, seed))
        if not full_only:
            pairs[name] = tables[0], tables[1]
    if output is not None:
        with plotting.style():
            plotting.write(draw(pairs), output)
        click.echo(output)


if __name__ == "__main__":
    main()
