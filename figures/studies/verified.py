"""How long `sdhj verify` takes: claims of certified tables of robots of several kinds, and processor time a claim.

python figures/studies/verified.py               the rows of the page, some minutes
python figures/studies/verified.py rail pendulum  some of them
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import click
import fleet

import sdhj
from sdhj.certified.check import verify
from sdhj.cli import plainly

sys.path.append(str(Path(__file__).parents[1]))  # the scripts are no package to install

import extra_sensing


class Checked(NamedTuple):
    """A problem, the cells that it is certified on, and few, with which everything is compiled before it is timed."""

    problem: Callable[[], sdhj.ReachAvoidProblem]
    cells: tuple[int, ...]
    few: tuple[int, ...]


ROBOTS = {
    "rail": Checked(fleet.rail().problem, (160, 160), (40, 40)),
    "pendulum": Checked(fleet.pendulum().problem, (200, 200), (50, 50)),
    "README's car": Checked(extra_sensing.car, (64, 64, 63), (16, 16, 21)),
    "README's car, finer": Checked(extra_sensing.car, (120, 120, 126), (16, 16, 21)),
    "the paper's arm": Checked(lambda: sdhj.arm_case_study(9), (64, 64, 36, 36), (16, 16, 8, 8)),
}
HEAD = """\
| robot | cells | claims | solve, CPU s | verify, CPU s | verify, CPU s a million claims |
| --- | --- | --- | --- | --- | --- |"""


def timed(problem: sdhj.ReachAvoidProblem, cells: tuple[int, ...]) -> tuple[tuple[int, ...], int, float, float]:
    """Cells (aligned), claims, and the processor time of solving and of verifying."""
    with TemporaryDirectory() as folder:
        began = time.process_time()
        table = sdhj.solve(problem, sdhj.Certified(cells=cells), progress=False, play=False)
        solved = time.process_time() - began
        table.save(file := Path(folder) / "table.npz")
        began = time.process_time()
        verdict = verify(file, everywhere=True, progress=False)
        checked = time.process_time() - began
    if not verdict.ok:
        raise click.ClickException(str(verdict))
    return table.shape, sum(claim.made for claim in verdict.claims), solved, checked


def row(name: str, cells: tuple[int, ...] | None = None) -> str:
    """What is measured of a robot, at its cells or others."""
    problem = ROBOTS[name].problem()
    timed(problem, ROBOTS[name].few)
    shape, claims, solved, checked = timed(problem, cells or ROBOTS[name].cells)
    at, each = " x ".join(map(str, shape)), checked / claims * 1e6
    return f"| {name} | {at} | {claims:,} | {solved:.1f} | {checked:.1f} | {each:.2f} |"


@click.command()
@click.argument("names", nargs=-1, type=click.Choice([*ROBOTS]))
@plainly
def main(names: tuple[str, ...]) -> None:
    """Print a row for each of these robots."""
    click.echo(HEAD)
    for name in names or ROBOTS:
        click.echo(row(name))


if __name__ == "__main__":
    main()
