"""A vehicle in a maze, the standard example of discretised control: from where can the target be reached at all?

The problem is `examples/vehicle` of SCOTS (Rungger & Zamani, HSCC 2016; the vehicle of Reissig, Weber & Rungger, IEEE
TAC 2017, doi 10.1109/TAC.2016.2593947): 15 walls, a corner to be reached, 7 x 7 inputs held for 0.3 s. SCOTS answers on
cells of 0.2 m x 0.2 m x 0.2 rad, walls grown by half a cell, and wins from 48,018 of 91,035 cells. Nothing here depends
on time and no number of steps is given, so there is one tube for each number of steps to go, until none grows.

`python figures/studies/maze.py -o maze.png` certifies it (a minute), plays it and draws where the target can be reached
from. `--method hji` is for tables of few steps: errors of the scheme in each of hundreds add up to standing still.
Where walls, or the promises of the table, are lost between the nodes there is a refusal in place of a number.
"""

import time
import warnings
from pathlib import Path

import click
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

import sdhj
from sdhj import plotting
from sdhj.cli import plainly
from sdhj.common.findings import ResolutionWarning
from sdhj.common.remembering import FloatArray
from sdhj.plotting.looks import TARGET_LOOKS, UNSAFE_LOOKS, style, writable_picture
from sdhj.table.batches import Table

SIDE = 10.0  # m
TARGET = (9.0, 9.5, 0.0, 0.5)
WALLS = (  # x from, x to, y from, y to, m
    (1.0, 1.2, 0.0, 9.0),
    (2.2, 2.4, 0.0, 5.0),
    (2.2, 2.4, 6.0, 10.0),
    (3.4, 3.6, 0.0, 9.0),
    (4.6, 4.8, 1.0, 10.0),
    (5.8, 6.0, 0.0, 6.0),
    (5.8, 6.0, 7.0, 10.0),
    (7.0, 7.2, 1.0, 10.0),
    (8.2, 8.4, 0.0, 8.5),
    (8.4, 9.3, 8.3, 8.5),
    (9.3, 10.0, 7.1, 7.3),
    (8.4, 9.3, 5.9, 6.1),
    (9.3, 10.0, 4.7, 4.9),
    (8.4, 9.3, 3.5, 3.7),
    (9.3, 10.0, 2.3, 2.5),
)
LEVELS = 0.3 * np.arange(-3, 4)  # of the speed, m/s, and of the steering angle, rad
CELLS = 51, 51, 72  # of a certified table; walls lie on the sides of such cells nowhere
SCOTS_SHARE = 48_018 / 91_035


def velocity(headings: FloatArray, speed: FloatArray, steering: FloatArray) -> FloatArray:
    """d(x, y, heading)/dt of a bicycle, (M, 3): its axles are 1 m apart, and the middle between them is followed."""
    slip = np.arctan(np.tan(steering) / 2)
    way = speed / np.cos(slip)
    turn = speed * np.tan(steering)
    return np.stack(np.broadcast_arrays(way * np.cos(slip + headings), way * np.sin(slip + headings), turn), axis=1)


def to_box(points: FloatArray, box: tuple[float, ...]) -> FloatArray:
    """Signed distance of points (M, 2) to a box of `WALLS`, m."""
    low, high = np.array(box[::2]), np.array(box[1::2])
    away = np.maximum(low - points, points - high)
    return np.hypot(*np.maximum(away, 0.0).T) + np.minimum(away.max(axis=1), 0.0)


def to_walls(points: FloatArray) -> FloatArray:
    return np.min(np.stack([to_box(points, wall) for wall in WALLS]), axis=0)


def maze(
    nodes: int = 61, headings: int = 36, steps: int | None = None, sampling: str = "steep"
) -> sdhj.ReachAvoidProblem:
    """The problem on nodes x nodes x headings; leaving the square is losing."""
    inputs = np.array([[speed, steering] for speed in LEVELS for steering in LEVELS])
    return sdhj.ReachAvoidProblem(
        grid=sdhj.Grid(
            [0, 0, -np.pi], [SIDE, SIDE, np.pi], [nodes, nodes, headings], [False, False, True], ["x", "y", "heading"]
        ),
        dynamics=sdhj.Dynamics(inputs, lambda points, u: velocity(points[:, 2], *u), np.eye(3), np.zeros(3)),
        target=sdhj.TargetSet((0, 1), lambda points, t: to_box(points, TARGET)),
        unsafe=[sdhj.UnsafeSet((0, 1), lambda points, t: to_walls(points), name="walls", sampling=sampling)],
        delta=0.3,
        steps=steps,
        name="maze",
    )


def solved(problem: sdhj.ReachAvoidProblem, method: str = "certified") -> Table:
    """Its table; ValueError where hji loses walls or promises between the nodes: a number would be none."""
    if method == "certified":
        return sdhj.solve(problem, sdhj.Certified(cells=CELLS))
    with warnings.catch_warnings():
        warnings.simplefilter("error", ResolutionWarning)
        try:
            return sdhj.solve(problem, method)
        except ResolutionWarning as lost:
            raise ValueError(str(lost)) from None


def draw(table: Table) -> Figure:
    """For each place the share of headings from which the target is reached, and a run."""
    figure = plotting.new_figure(4.6, 4.2)
    ax, n = figure.subplots(), table.steps
    won = (table.values(start=0, within=n) <= 0).mean(axis=2)
    image = ax.imshow(won.T, extent=(0, SIDE, 0, SIDE), origin="lower", vmin=0, vmax=1, interpolation="bilinear")
    figure.colorbar(image, ax=ax, label="share of headings from which the target is reached")
    for box, looks in [*((wall, UNSAFE_LOOKS) for wall in WALLS), (TARGET, TARGET_LOOKS)]:
        ax.add_patch(Rectangle((box[0], box[2]), box[1] - box[0], box[3] - box[2], **looks))
    run = sdhj.simulate(sdhj.Controller(table), np.array([0.5, 0.5, np.pi / 2]), adversary="none")
    ax.plot(*run.states[:, :2].T, color="white", linewidth=1.4, linestyle="-")
    ax.set(xlim=(0, SIDE), ylim=(0, SIDE), xlabel="x (m)", ylabel="y (m)", aspect="equal")
    ax.set_title(f"{table.fraction(start=0, within=n):.1%} won, in at most {n} steps; the run takes {len(run.inputs)}")
    return figure


@click.command(context_settings={"show_default": True})
@click.option("--method", default="certified", type=click.Choice(["certified", "hji"]))
@click.option("--nodes", default=61, type=click.IntRange(21, 201), help="Nodes along x and along y, for hji.")
@click.option("--headings", default=36, type=click.IntRange(12, 144), help="Nodes along the heading, for hji.")
@click.option("--steps", type=click.IntRange(1), help="At most so many; by default as many as it takes.")
@click.option("--runs", default=2000, type=click.IntRange(1), help="Runs from states drawn where they are won.")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="A picture: a png or pdf file.")
@plainly
def main(method: str, nodes: int, headings: int, steps: int | None, runs: int, output: Path | None) -> None:
    """Solve the maze from wherever it can be solved."""
    writable_picture(output, [".png", ".pdf"])
    began = time.perf_counter()
    table = solved(maze(nodes, headings, steps), method)
    share, free = table.fraction(start=0, within=table.steps), float((to_walls(table.grid.points()[:, :2]) > 0).mean())
    click.echo(f"{share:.1%} of all states won within {table.steps} steps; walls leave {free:.1%} free")
    click.echo(f"{SCOTS_SHARE:.1%} by SCOTS, whose walls are a cell thicker")
    click.echo(f"{time.perf_counter() - began:.0f} s, {table.nbytes / 1e6:.0f} MB")
    click.echo(str(sdhj.monte_carlo(sdhj.Controller(table), runs, "none")))
    if output is not None:
        with style():
            plotting.write(draw(table), output)
        click.echo(output)


if __name__ == "__main__":
    main()
