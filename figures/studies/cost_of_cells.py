"""What the parts of a certified solve take, beside what the model says by which cells are chosen.

`NUMBA_NUM_THREADS=1 python figures/studies/cost_of_cells.py` solves some robots and prints for each part of the model
(`sdhj.certified.choosing.costs`) the processor's seconds and those of the model. Where the constants of the model were
measured, the sums of both were about the same. It takes two to four minutes.
"""

import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import click
import fleet
import large
import maze
import numpy as np

import sdhj
from sdhj.certified.arrivals import Arrivals
from sdhj.certified.choosing import costs, speeds_of
from sdhj.certified.general_proof import GeneralProof
from sdhj.certified.images import Images
from sdhj.certified.table import CellSets

PARTS: dict[str, list[tuple[Any, str]]] = {
    "intervals": [(Images, "tubes_of_places")],
    "unsafe sets": [(GeneralProof, name) for name in ("_mark_collisions", "_boxes_of_sets", "_mark_in_words")],
    "arrivals": [(Arrivals, "add")],
    "recursion": [(CellSets, "extend"), (CellSets, "write_goal"), (CellSets, "finish")],
}
FEW = 6  # cells of an axis, to compile with


@contextmanager
def timed() -> Iterator[Counter[str]]:
    """The seconds that each part takes, of all solves in between."""
    spent = Counter[str]()
    plain: list[tuple[Any, str, Any]] = [(*one, getattr(*one)) for some in PARTS.values() for one in some]

    def clocked(part: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """A function that adds what it takes to a part."""

        def run(*args: Any, **kwargs: Any) -> Any:
            began = time.thread_time()
            out = function(*args, **kwargs)
            spent[part] += time.thread_time() - began
            return out

        return run

    try:
        for part, some in PARTS.items():
            for kind, name in some:
                setattr(kind, name, clocked(part, getattr(kind, name)))
        yield spent
    finally:
        for kind, name, function in plain:
            setattr(kind, name, function)


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
    """Print seconds of each part: measured, by the model."""
    took, said = Counter[str](), Counter[str]()
    for name in names or ROBOTS:
        make, cells = ROBOTS[name]
        problem = make()
        sdhj.solve(problem, sdhj.Certified(cells=(FEW,) * problem.grid.ndim), progress=False, play=False)
        method = sdhj.Certified(cells=cells)
        with timed() as spent:
            table = sdhj.solve(problem, method, progress=False, play=False)
        model = costs(problem, method.axes(problem), method.parts, speeds_of(problem))
        each = ", ".join(f"{part} {spent[part]:.2f} {model[part]:.2f}" for part in PARTS)
        took.update(spent)
        said.update(model)
        whole = f"{sum(spent.values()):.1f} {sum(model.values()):.1f}"
        click.echo(f"{name} {table.shape}, share {table.fraction():.3f}: {each}; in all {whole}")
    click.echo(", ".join(f"{part} {took[part]:.1f} {said[part]:.1f}" for part in PARTS))


if __name__ == "__main__":
    main()
