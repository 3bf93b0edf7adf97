"""How many runs are lost that a table promises to win: a fleet of robots, each judged by who shares no code with it.

`python figures/studies/promises.py` solves a problem for each robot of `tests/lib/fleet.py`, draws starts uniformly
from what its table holds, and has `tests/lib/judge.py` play them against six adversaries; a row for each robot and
method, in promises.md and promises.csv. Robots that are to stay clear for ever are asked at step 0 throughout where
that is proved, and on a grid for `ON_GRID` steps; the rows "filtered" are runs in which a commander drives at what is
unsafe and `Controller.filter` lets through what it finds safe.
"""

import csv
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np
from scipy.special import betaincinv

import sdhj
from sdhj.cli import SEED, plainly
from sdhj.common.remembering import FloatArray
from sdhj.plotting.looks import writable_folder
from sdhj.table.batches import Table
from sdhj.table.files import replaced_whole

sys.path.append(str(Path(__file__).parents[2] / "tests" / "lib"))  # where the robots and the judge are

from fleet import FLEET, Robot
from judge import ADVERSARIES, LOST, Answer, reckless, trial

ROBOTS = {name: lambda build=build: build().problem() for name, build in FLEET.items()}  # of each its problem
DRAWN = 50_000  # states among which starts are looked for, at a time
MOST_DRAWN = 200  # times
MARK = "<!-- promises: what `python figures/studies/promises.py` writes into results/promises.md -->"
EVER = 200  # steps that stand for ever
ON_GRID = 60  # steps that a grid promises, of a robot that is to stay clear for ever


@dataclass(frozen=True)
class Row:
    """How the runs of one robot and method ended.

    Attributes
    ----------
    robot, nodes, method : str
    share : float
        Of the grid's volume that is promised.
    runs, lost, promised : int
        Runs; those lost; those lost of which every input had been promised.
    how : str
        In which ways, and to which adversaries.
    solved, played : float
        Processor time, s.
    """

    robot: str
    nodes: str
    method: str
    share: float
    runs: int
    lost: int
    promised: int
    how: str
    solved: float
    played: float

    def __str__(self) -> str:
        low, high = bounds(self.lost, self.runs)
        told = self.robot, self.nodes, f"{self.share:.1%}", self.method, f"{self.runs:,}"
        counts = f"{self.lost:,}", f"{low:.3%} to {high:.3%}", f"{self.promised:,}"
        return f"| {' | '.join((*told, *counts, self.how))} |"


HEAD = ("robot", "nodes", "share promised", "method", "runs", "lost", "95 %", "lost while promised", "how")


def bounds(lost: int, runs: int) -> tuple[float, float]:
    """Between which rates it lies with 95 % confidence, if runs are independent (Clopper & Pearson)."""
    low = betaincinv(lost, runs - lost + 1, 0.025) if lost else 0.0
    high = betaincinv(lost + 1, runs - lost, 0.975) if lost < runs else 1.0
    return float(low), float(high)


def starts(table: Table, count: int, seed: int) -> FloatArray:
    """Up to `count` states (M, ndim), drawn uniformly from what a table promises within all of its steps."""
    rng, found, some = np.random.default_rng(seed), [np.empty((0, table.grid.ndim))], 0
    for _ in range(MOST_DRAWN):
        states = rng.uniform(table.grid.lower, table.grid.upper, (DRAWN, table.grid.ndim))
        found.append(states[table.contains(states, start=0, within=table.steps)])
        some += len(found[-1])
        if some >= count:
            break
    return np.concatenate(found)[:count]


def answer(robot: Robot, controller: sdhj.Controller, states: FloatArray, step: int) -> Answer:
    """What the controller says of states (M, ndim)."""
    at = 0 if robot.steps is None else step
    batch = controller.batch(states, at)
    rest = np.full(len(states), controller.table.steps - (0 if robot.steps is None else at + 1))
    left = rest if robot.target is None else np.maximum(batch.steps_to_go, 1) - 1
    return Answer(controller.choose(batch), batch.promised, left)


def filtered(robot: Robot, controller: sdhj.Controller, states: FloatArray, step: int) -> Answer:
    """What the filter makes of a commander who drives at what is unsafe."""
    wanted = np.asarray(robot.inputs)[reckless(robot, states, step * robot.delta)]
    at = 0 if robot.steps is None else step
    told, left = controller.filter(states, at, wanted), controller.table.steps - (0 if robot.steps is None else at + 1)
    return Answer(np.asarray(told.inputs), np.asarray(told.promised), np.full(len(states), left))


def tube(robot: Robot, table: Table, points: FloatArray, step: int, left: FloatArray) -> FloatArray:
    """Level of the table's own tube at points (M, V, ndim) when the interval of a step ends: (M, V)."""
    return table.values_at(points, 0 if robot.steps is None else step + 1, left)


def judged(
    robot: Robot, table: Table, runs: int, steps: int, seed: int, says: Any = answer
) -> tuple[int, int, int, str]:
    """Runs made, lost, lost while promised, and how; `runs` of them against each adversary."""
    controller, begun = sdhj.Controller(table), starts(table, runs, seed)
    ways, promised = Counter[str](), 0
    by: list[str] = []
    steps = robot.steps or steps
    for place, (name, adversary) in enumerate(ADVERSARIES.items()):
        ask, level = partial(says, robot, controller), partial(tube, robot, table)
        outcomes, kept = trial(robot, ask, level, adversary, begun, steps, np.random.default_rng([seed, place]))
        lost = np.isin(outcomes, LOST)
        promised += int((lost & kept).sum())
        ways.update(outcomes[lost].tolist())
        by += [f"{name} {lost.sum():,}"] if lost.any() else []
    told = ", ".join(f"{way} {count:,}" for way, count in ways.items())
    return len(ADVERSARIES) * len(begun), ways.total(), promised, f"{told} (to {', '.join(by)})" if by else "none"


def methods(robot: Robot) -> Iterator[tuple[str, Robot, sdhj.ReachAvoidProblem, Any]]:
    """What a robot's problem is solved by: what to call it, the robot as it is then judged, the problem, the method."""
    counted = replace(robot, steps=robot.steps or ON_GRID)
    yield "hji" if robot.steps else f"hji, {ON_GRID} steps", counted, counted.problem(), sdhj.HJI()
    if robot.stateless:
        yield "lax", counted, counted.problem(), sdhj.HopfLax()
    if robot.steep:
        yield "hji, steep", counted, counted.problem(sampling="steep"), sdhj.HJI()
    if robot.cells:
        yield "certified", robot, robot.problem(), sdhj.Certified(cells=robot.cells)


def rows(names: Sequence[str], runs: int, steps: int, seed: int, only: Sequence[str] = ()) -> Iterator[Row]:
    """A row for each robot and method, one after the other; `only` some methods, by default all."""
    for name in names:
        for method, robot, problem, solver in methods(FLEET[name]()):
            if only and method not in only:
                continue
            began = time.process_time()
            table = sdhj.solve(problem, solver, progress=False)
            share, solved = table.fraction(start=0, within=table.steps), time.process_time() - began
            nodes = " x ".join(map(str, table.shape if method == "certified" else robot.nodes))
            says = {method: answer} | ({f"{method}, filtered": filtered} if FLEET[name]().steps is None else {})
            for told, how in says.items():
                began = time.process_time()
                counts = judged(robot, table, runs, steps, seed, how)
                played = time.process_time() - began
                yield Row(name, nodes, told, share, *counts, round(solved, 1), round(played, 1))


def write_rows(found: Sequence[Row], folder: Path, note: str) -> list[Path]:
    """promises.csv and promises.md in a folder, with the same rows; the paths."""
    table, page = folder / "promises.csv", folder / "promises.md"
    with replaced_whole(table) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(Row.__dataclass_fields__))
        writer.writeheader()
        writer.writerows(map(asdict, found))
    with replaced_whole(page) as temporary:
        temporary.write_text("\n".join([*heading(), *map(str, found), "", note, ""]), encoding="utf-8")
    return [table, page]


def into_page(found: Sequence[Row], page: Path) -> None:
    """Put the table below its mark in a page, in place of the one that stands there.

    Raises
    ------
    ValueError
        Where the page has no such mark, or two.
    """
    parts = page.read_text(encoding="utf-8").split(MARK)
    if len(parts) != 2:
        raise ValueError(f"{page} must have the line {MARK} once, above the table")
    lines = parts[1].lstrip("\n").split("\n")
    kept = next(number for number, line in enumerate(lines) if not line.startswith("|"))
    table = "\n".join([*heading(), *map(str, found)])
    with replaced_whole(page) as temporary:
        rest = "\n".join(lines[kept:]).lstrip("\n")
        temporary.write_text(f"{parts[0]}{MARK}\n{table}\n\n{rest}", encoding="utf-8")


def heading() -> list[str]:
    """The two lines above the rows."""
    return [f"| {' | '.join(HEAD)} |", "|" + " --- |" * len(HEAD)]


@click.command(context_settings={"show_default": True})
@click.option("--runs", default=2000, type=click.IntRange(1), help="Starts of each table; each meets all adversaries.")
@click.option("--robot", "names", multiple=True, type=click.Choice(list(FLEET)), help="Which; by default all.")
@click.option("--method", "only", multiple=True, help="Which, as rows call them; by default all.")
@click.option("--steps", default=EVER, type=click.IntRange(1, 1000), help="Of robots that are to stay clear for ever.")
@click.option("--seed", default=0, type=SEED, help="Of the starts and the adversaries.")
@click.option("--out", default="results", type=click.Path(path_type=Path), help="Folder for promises.csv and .md.")
@click.option("--page", type=click.Path(path_type=Path, exists=True), help="Put the table into this page too.")
@plainly
def main(
    names: tuple[str, ...], only: tuple[str, ...], runs: int, steps: int, seed: int, out: Path, page: Path | None
) -> None:
    """Count how many promised runs are lost, by robot and method."""
    folder = writable_folder(out)  # before long work
    click.echo("\n".join(heading()))
    found = []
    for row in rows(names or list(FLEET), runs, steps, seed, only):
        click.echo(str(row))
        found.append(row)
    adversaries = ", ".join(ADVERSARIES)
    note = f"{runs} starts for each of {adversaries}; for ever: {steps} steps; seed {seed}. sdhj {sdhj.__version__}."
    for path in write_rows(found, folder, note):
        click.echo(path)
    if page:
        into_page(found, page)


if __name__ == "__main__":
    main()
