"""What a controller gains that remembers what the state can be: shares of robots that measure with errors.

python figures/studies/remembering.py              all rows, some minutes
python figures/studies/remembering.py "joint, 100 Hz" standing
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import click
import numpy as np

import sdhj
from sdhj.cli import plainly

ERROR = (0.002, 0.02)  # rad, rad/s
HEAD = "| robot | method | by each measurement alone | by who remembers |\n| --- | --- | --- | --- |"


def joint(rate: int, **late: float) -> sdhj.ReachAvoidProblem:
    """A joint before its stops at +-1 rad, at most 2 rad/s, pushed by 0.1 rad/s^2, for ever."""
    levels = np.array([[-4.0], [-2.0], [0.0], [2.0], [4.0]])

    def drift(q: Any, u: Any) -> Any:
        return np.stack([q[:, 1], np.full(len(q), u[0])], axis=1)

    grid = sdhj.Grid([-1, -2], [1, 2], (201, 161), ends=["unsafe", "wall"])
    dynamics, sensing = sdhj.Dynamics(levels, drift, [[0], [1]], [0.1]), sdhj.Sensing(ERROR, **late)
    return sdhj.ReachAvoidProblem(grid, dynamics, None, [], 1 / rate, None, sensing=sensing)


def standing() -> sdhj.ReachAvoidProblem:
    """A car that cannot go back, before something that blocks its lane: it stands for ever."""

    def drift(q: Any, u: Any) -> Any:
        return np.stack([q[:, 1], np.full(len(q), u[0])], axis=1)

    blocked = sdhj.UnsafeSet((0,), lambda p, t: np.abs(p[:, 0] - 51) - 1, name="blocked")
    dynamics = sdhj.Dynamics([[-4.0], [0.0], [2.0]], drift, [[0], [1]], [0.2])
    grid = sdhj.Grid([0, 0], [100, 15], (201, 61), ends=["unsafe", "wall"])
    return sdhj.ReachAvoidProblem(grid, dynamics, None, [blocked], 0.5, None, sensing=sdhj.Sensing((0.05, 0.05)))


def dubins() -> sdhj.ReachAvoidProblem:
    """A car that turns, to a target past a post; its heading is known to 0.03 rad, its place to 2 cm."""

    def drift(q: Any, u: Any) -> Any:
        return np.stack([np.cos(q[:, 2]), np.sin(q[:, 2]), np.full(len(q), u[0])], axis=1)

    post = sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0], p[:, 1]) - 0.4, name="post")
    target = sdhj.TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 1.2, p[:, 1]) - 0.5)
    grid = sdhj.Grid([-2, -2, -np.pi], [2, 2, np.pi], (41, 41, 36), [False, False, True])
    sensing = sdhj.Sensing((0.02, 0.02, 0.03))
    dynamics = sdhj.Dynamics([[-2.0], [0.0], [2.0]], drift)
    return sdhj.ReachAvoidProblem(grid, dynamics, target, [post], 0.05, 24, sensing=sensing)


ROBOTS: dict[str, Callable[[], sdhj.ReachAvoidProblem]] = {
    **{f"joint, {rate} Hz": partial(joint, rate) for rate in (10, 20, 50, 100, 200)},
    "joint, 100 Hz, 8 ms late": partial(joint, 100, delay=0.008),
    "joint, 100 Hz, 5 ms late, 1 ms of jitter": partial(joint, 100, delay=0.005, jitter=0.001),
    "standing": standing,
    "Dubins' car": dubins,
}


def row(name: str) -> str:
    """The shares of one robot, of who forgets and of who remembers, by the method that `solve` takes by itself."""
    problem = ROBOTS[name]()
    each = [replace(problem, sensing=replace(problem.sensing, memory=memory)) for memory in (False, True)]
    tables = [sdhj.solve(one, play=False, progress=False) for one in each]
    return f"| {name} | `{tables[0].method}` | {' | '.join(f'{table.fraction():.3f}' for table in tables)} |"


@click.command()
@click.argument("names", nargs=-1, type=click.Choice([*ROBOTS]))
@plainly
def main(names: tuple[str, ...]) -> None:
    """Print a row for each robot: the share that is proved or found by who forgets, and by who remembers."""
    click.echo(HEAD)
    for name in names or ROBOTS:
        click.echo(row(name))


if __name__ == "__main__":
    main()
