"""What a certified solve takes, beside the count by which cells are chosen.

`NUMBA_NUM_THREADS=1 python figures/studies/cost_of_cells.py` solves some robots and prints the processor's seconds, the
look at the table's claims among them, and the three terms of `sdhj.certified.choosing.seconds_taken`. It takes two to
four minutes.
"""

import time
from collections.abc import Callable
from typing import Any

import click
import fleet
import large
import maze
import numpy as np

import sdhj
from sdhj.certified.choosing import seconds_taken

FEW = 6  # cells of an axis, to compile with


def crane() -> sdhj.ReachAvoidProblem:
    """A trolley (x, v; m) with a load on a rope of 5 m (angle, its rate; rad) that has to come to rest."""
    degree = np.pi / 180
    at_rest = [0.3, 0.2, 2 * degree, 0.06]

    def drift(q: Any, u: Any) -> Any:
        swing = -9.81 / 5.0 * np.sin(q[:, 2]) - u[0] / 5.0 * np.cos(q[:, 2])
        return fleet.rows(q, q[:, 1], u[0], q[:, 3], swing)

    return sdhj.ReachAvoidProblem(
        sdhj.Grid([-1.0, -1.0, -6 * degree, -0.16], [4.0, 1.0, 6 * degree, 0.16], [33, 15, 19, 17]),
        sdhj.Dynamics([[-0.4], [0.0], [0.4]], drift, [[0.0], [0.0], [0.0], [1.0]], [0.006]),
        sdhj.TargetSet((0, 1, 2, 3), lambda p, t: np.max(np.abs(p - [3, 0, 0, 0]) / at_rest, axis=1) - 1),
        [],
        delta=0.3,
        steps=45,
    )


def fence() -> sdhj.ReachAvoidProblem:
    """A multicopter (x, y, their rates; m, m/s) in a fence that is an L, with a hole; a third of its states is outside.

    So many cells are inside an unsafe set, or beside its boundary, that marking takes most of the time.
    """
    corners = [[0, 0], [40, 0], [40, 18], [20, 18], [20, 36], [0, 36]]
    hole = sdhj.UnsafeSet.polygon([[26, 6], [32, 6], [29, 11]], name="hole")
    outside = sdhj.UnsafeSet((0, 1), sdhj.complement(sdhj.UnsafeSet.polygon(corners).level_set), name="outside")

    def drift(q: Any, u: Any) -> Any:
        return fleet.rows(q, q[:, 2], q[:, 3], u[0], u[1])

    return sdhj.ReachAvoidProblem(
        sdhj.Grid([-1, -1, -6, -6], [41, 37, 6, 6], [41, 37, 13, 13], ends=["unsafe", "unsafe", "wall", "wall"]),
        sdhj.Dynamics(fleet.every([-4.0, 0.0, 4.0], [-4.0, 0.0, 4.0]), drift, np.eye(4)[:, 2:], [0.5, 0.5]),
        None,
        [outside, hole],
        delta=0.2,
        steps=None,
    )


ROBOTS: dict[str, tuple[Callable[[], sdhj.ReachAvoidProblem], tuple[int, ...]]] = {
    "crane": (crane, (128, 50, 48, 48)),  # with 70 along x it proves nothing, and the recursion has nothing to do
    "fence": (fence, (121, 192, 14, 14)),
    "maze": (lambda: maze.maze(steps=20, sampling="nodes"), (128, 128, 20)),
    "airship": (fleet.airship().problem, (250, 200)),
    "forklift": (fleet.forklift().problem, (150, 100, 69)),
    "tractor": (fleet.tractor().problem, (40, 40, 40, 20)),
    "merging": (fleet.merging().problem, (80, 60, 60)),
    "arm": (fleet.arm().problem, (24, 24, 24, 12, 12)),
    "256 inputs": (fleet.many_inputs().problem, (300, 250)),
    "crossing": (fleet.crossing().problem, (120, 60, 90)),
    "pendulum": (fleet.pendulum().problem, (400, 400)),
    "air3d": (fleet.air3d().problem, (150, 120, 100)),
    "car with a pursuer": (lambda: large.car(9), (24, 24, 21, 17, 17)),
}


@click.command()
@click.option("--robot", "names", multiple=True, type=click.Choice(list(ROBOTS)), help="All of them by default.")
def main(names: tuple[str, ...]) -> None:
    """Print the seconds of each robot: measured, and by the three terms of the count."""
    for name in names or ROBOTS:
        make, cells = ROBOTS[name]
        problem = make()
        sdhj.solve(problem, sdhj.Certified(cells=(FEW,) * problem.grid.ndim), progress=False, play=False)
        method, began = sdhj.Certified(cells=cells), time.process_time()
        table = sdhj.solve(problem, method, progress=False, play=False)
        took, terms = time.process_time() - began, seconds_taken(problem, table.axes, method.parts)
        each = " + ".join(f"{term:.2f}" for term in terms)
        counted = f"counted {each} = {sum(terms):.1f}"
        click.echo(f"{name} {table.shape}, share {table.fraction():.3f}: {took:.1f} s, {counted}")


if __name__ == "__main__":
    main()
