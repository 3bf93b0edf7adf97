"""Robots that measure with an error, act late and by a clock that is off, against adversaries who choose all of it.

`python figures/studies/shaky.py --runs 1000000` plays so many runs of certified tables of an arm with a pursuer, a
double integrator, a car and a point in the plane that has to brake (4-D). Of tables that know of it no run may be lost;
the same attacks on tables that do not are the control. The methods on grids play a tenth as many.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import click
import numpy as np

import sdhj
from sdhj.arm.workspace import Disk, Still
from sdhj.cli import plainly
from sdhj.common.remembering import FloatArray
from sdhj.table.batches import Table

ADVERSARIES = ("random", "worst")
BATCH = 100_000  # runs at a time; batch b has the seed b


def point(axes: int) -> sdhj.ReachAvoidProblem:
    """A point that accelerates along each of its axes and is to come to rest near the middle, clear of a disk."""
    levels = np.array([-1.0, 0.0, 1.0])
    inputs = np.stack(np.meshgrid(*[levels] * axes, indexing="ij"), axis=-1).reshape(-1, axes)

    def drift(q: FloatArray, u: FloatArray) -> FloatArray:
        return np.concatenate([q[:, axes:], np.tile(u, (len(q), 1))], axis=1)

    def near(q: FloatArray, t: float) -> FloatArray:
        return np.max(np.abs(q) - np.array([0.4] * axes + [0.5] * axes), axis=1)

    disk = sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 0.8, p[:, 1] - 0.8) - 0.2, name="disk")
    return sdhj.ReachAvoidProblem(
        sdhj.Grid([-1.2] * axes + [-1.2] * axes, [1.2] * axes + [1.2] * axes, [25] * (2 * axes)),
        sdhj.Dynamics(inputs, drift, np.eye(2 * axes)[:, axes:], [0.1] * axes),
        sdhj.TargetSet(tuple(range(2 * axes)), near),
        [disk] if axes == 2 else [],
        delta=0.2,
        steps=4,
    )


def car() -> sdhj.ReachAvoidProblem:
    """The car of the README, its steps as long as its turns need."""

    def drift(q: FloatArray, u: FloatArray) -> FloatArray:
        return np.stack([u[0] * np.cos(q[:, 2]), u[0] * np.sin(q[:, 2]), np.full(len(q), u[1])], axis=1)

    return sdhj.ReachAvoidProblem(
        sdhj.Grid([-2, -2, -np.pi], [2, 2, np.pi], [41, 41, 32], periodic=[False, False, True]),
        sdhj.Dynamics(
            [[s, turn] for s in (0.5, 1.0) for turn in (-2.0, 0.0, 2.0)], drift, np.eye(3)[:, :2], [0.1, 0.1]
        ),
        sdhj.TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 1.2, p[:, 1] - 0.8) - 0.4),
        [sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0], p[:, 1]) - 0.4, name="post")],
        delta=0.25,
        steps=4,
    )


def arm() -> sdhj.ReachAvoidProblem:
    """The arm and its pursuer, with a target at rest, as jitter needs."""
    return sdhj.arm_case_study(nodes=25, steps=4, target=Disk(Still((0.1, 0.15)), 0.07))


@dataclass(frozen=True)
class Shaky:
    """A robot, how it senses, about how many cells prove it, and a projection."""

    problem: Callable[[], sdhj.ReachAvoidProblem]
    sensing: sdhj.Sensing
    cells: tuple[int, ...]
    subspaces: tuple[tuple[int, ...], ...]


ROBOTS = {
    "arm, pursuer": Shaky(
        arm,
        sdhj.Sensing((0.01, 0.01, 0.004, 0.004), 0.01, 0.004, memory=False),
        (210, 210, 36, 36),
        ((0, 1, 2), (0, 1, 3)),
    ),
    "double integrator": Shaky(lambda: point(1), sdhj.Sensing(0.01, 0.05, 0.01, memory=False), (240, 240), ((0, 1),)),
    "car": Shaky(car, sdhj.Sensing(0.005, 0.02, 0.005, memory=False), (80, 80, 76), ((0, 2), (1, 2))),
    "point in the plane": Shaky(
        lambda: point(2), sdhj.Sensing(0.01, 0.02, 0.005, memory=False), (40, 40, 40, 40), ((0, 2), (1, 3))
    ),
}


@dataclass(frozen=True)
class Row:
    """How many of its runs a table lost, and in which ways."""

    robot: str
    method: str
    share: float
    runs: int
    lost: int
    ways: str

    def __str__(self) -> str:
        rate = f"{self.lost / self.runs:.4%}" if self.runs else "-"
        told = self.robot, self.method, f"{self.share:.4f}", f"{self.runs:,}", f"{self.lost:,}", rate, self.ways
        return f"| {' | '.join(told)} |"


def played(table: Table, sensing: sdhj.Sensing, runs: int) -> tuple[int, int, str]:
    """Runs made and lost against all adversaries in turn, and how they were lost; none where nothing is promised."""
    controller, counts = sdhj.Controller(table), dict.fromkeys(("collided", "left", "late", "off the grid"), 0)
    if not table.fraction(start=0, within=table.steps):
        return 0, 0, "nothing promised"
    made, batches = 0, -(-runs // BATCH)
    for batch in range(batches):
        size = min(BATCH, runs - made)
        for part, adversary in enumerate(ADVERSARIES):
            own = (size + part) // len(ADVERSARIES)
            if own:
                report = sdhj.monte_carlo(controller, own, adversary, batch, sensing=sensing, progress=False)
                for way in counts:
                    counts[way] += report.counts[way]
        made += size
    lost = sum(counts.values())
    return runs, lost, ", ".join(f"{way} {count:,}" for way, count in counts.items() if count)


def rows(names: list[str], runs: int) -> Iterator[Row]:
    """A row for each robot and method, one after the other."""
    for name in names:
        robot = ROBOTS[name]
        exact, certified = robot.problem(), sdhj.Certified(cells=robot.cells)
        shaky = replace(exact, sensing=robot.sensing)
        for method, problem, count, told in (
            (certified, shaky, runs, "certified"),
            (certified, exact, runs // 10, "certified, told nothing of it"),
            (sdhj.HJI(), shaky, runs // 10, "hji"),
            (sdhj.HJI(), exact, runs // 10, "hji, told nothing of it"),
            (sdhj.Projected(robot.subspaces), shaky, runs // 10, "projected"),
        ):
            table = sdhj.solve(problem, method, progress=False)
            share = table.fraction(start=0, within=table.steps)
            yield Row(name, told, share, *played(table, robot.sensing, max(count, 1)))


@click.command(context_settings={"show_default": True})
@click.option("--runs", default=20_000, type=click.IntRange(1), help="Of each certified table.")
@click.option("--robot", "names", multiple=True, type=click.Choice(list(ROBOTS)), help="Which; by default all.")
@plainly
def main(runs: int, names: tuple[str, ...]) -> None:
    """Play the campaign and print its table."""
    began = time.perf_counter()
    click.echo("| robot | method | promised | runs | lost | rate | how |\n|---|---|---|---|---|---|---|")
    for row in rows(list(names) or list(ROBOTS), runs):
        click.echo(str(row))
    click.echo(f"\n{time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
