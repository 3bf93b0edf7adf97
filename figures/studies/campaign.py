"""Many runs of several tables against several adversaries, one row for each pair.

`python figures/studies/campaign.py TABLE...` plays tables from files, or, for the name of a method such as hji, the one
of the paper's arm; runs go in batches, so that tens of millions need no more
memory than one batch.
"""

import csv
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import click
import numpy as np
from search import search_losing
from tqdm import tqdm

import sdhj
from sdhj.cli import SEED, plainly
from sdhj.common.checks import whole
from sdhj.common.showing import hidden
from sdhj.plotting.looks import writable_folder
from sdhj.simulation.adversaries import ADVERSARIES
from sdhj.simulation.outcomes import OUTCOMES
from sdhj.simulation.runs import monte_carlo
from sdhj.solving import METHODS
from sdhj.table.batches import Table
from sdhj.table.controller import Controller
from sdhj.table.files import replaced_whole

SEARCH = "search"
PLAYERS = (*ADVERSARIES, SEARCH)
BATCH = 200_000  # runs at a time; the seed of batch b is `seed` + b
POPULATION, GENERATIONS = 32, 8  # of a search


@dataclass(frozen=True)
class Row:
    """How one table did against one adversary.

    Attributes
    ----------
    table, method, adversary : str
    starts : int
        States it started from: a run from each, but for a search, which plays many.
    runs : int
    collided, left, late : int
        Starts with a run that ended so.
    seconds : float
        Wall-clock time.
    """

    table: str
    method: str
    adversary: str
    starts: int
    runs: int
    collided: int
    left: int
    late: int
    seconds: float


def campaign(
    tables: Mapping[str, Table],
    adversaries: Sequence[str] = ("random", "aggressive", "worst", SEARCH),
    *,
    runs: int = 100_000,
    rule: str = "deepest",
    seed: int = 0,
    progress: bool | None = None,
) -> list[Row]:
    """Play every table against every adversary, `runs` runs for each pair; a search gets as many in all, or fewer.

    Batch b has the seed `seed` + b: `monte_carlo(controller, BATCH, adversary, seed + b)` plays it again.

    Raises
    ------
    ValueError
        For an option that does not fit, or an empty tube.
    """
    whole("runs", runs, least=1)
    if not set(adversaries) <= set(PLAYERS) or not adversaries:
        raise ValueError(f"adversaries must be some of {', '.join(PLAYERS)}, got {list(adversaries)}")
    rows = []
    for name, table in tables.items():
        controller = Controller(table, rule=rule)
        for adversary in adversaries:
            with tqdm(total=runs, desc=f"{name}: {adversary}", unit="run", disable=hidden(progress)) as bar:
                rows.append(_row(controller, name, adversary, runs, seed, bar))
    return rows


def _row(controller: Controller, name: str, adversary: str, runs: int, seed: int, bar: tqdm) -> Row:
    began, played, starts, counts = time.perf_counter(), 0, 0, Counter[str]()
    for number, begin in enumerate(range(0, runs, BATCH)):
        budget = min(BATCH, runs - begin)
        if adversary == SEARCH:
            found = search_losing(
                controller,
                max(1, budget // (POPULATION * GENERATIONS)),
                population=POPULATION,
                generations=GENERATIONS,
                seed=seed + number,
                progress=False,
            )
            ends, done = found.outcomes, found.rollouts
        else:
            report = monte_carlo(controller, budget, adversary, seed + number, progress=False)
            ends, done = report.outcomes, report.runs
        counts.update({outcome: int((ends == place).sum()) for place, outcome in enumerate(OUTCOMES)})
        starts, played = starts + len(ends), played + done
        bar.update(budget)
        bar.set_postfix(failed=starts - counts["reached"])
    return Row(
        table=name,
        method=controller.table.method,
        adversary=adversary,
        starts=starts,
        runs=played,
        collided=counts["collided"],
        left=counts["left"],
        late=counts["late"],
        seconds=round(time.perf_counter() - began, 2),
    )


def write_rows(rows: Sequence[Row], folder: Path, note: str) -> list[Path]:
    """campaign.csv and campaign.md in a folder, with the same rows; the paths."""
    folder = writable_folder(folder)
    table, page = folder / "campaign.csv", folder / "campaign.md"
    records = [asdict(row) for row in rows]
    with replaced_whole(table) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(records[0]))
        writer.writeheader()
        writer.writerows(records)
    head = ["table", "adversary", "starts", "runs", "collided", "left", "late", "failed", "seconds"]
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head), *map(_line, rows), "", note, ""]
    with replaced_whole(page) as temporary:
        temporary.write_text("\n".join(lines), encoding="utf-8")
    click.echo("\n".join(lines))
    return [table, page]


def _line(row: Row) -> str:
    failed = row.collided + row.left + row.late
    cells = (row.table, row.adversary, row.starts, row.runs, row.collided, row.left, row.late)
    share = f"{failed / row.starts:.2%}" if failed else f"0 (< {upper_bound(row.starts):.1e})"
    return "| " + " | ".join([*map(str, cells), share, f"{row.seconds:.0f}"]) + " |"


def upper_bound(starts: int) -> float:
    """The rate that no failure in so many independent starts excludes with 95% confidence (exact, binomial)."""
    return float(-np.expm1(np.log(0.05) / starts))


@click.command(context_settings={"show_default": True})
@click.argument("tables", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--runs", default=100_000, type=click.IntRange(1), help="Closed-loop runs for each table and adversary.")
@click.option("--adversaries", default="random,aggressive,worst,search", help="Who plays: a list with commas.")
@click.option("--rule", default="deepest", help="How one of the safe inputs is chosen.")
@click.option("--seed", default=0, type=SEED, help="Seed of the adversaries and the starts.")
@click.option("--out", default="results", type=click.Path(path_type=Path), help="Folder for campaign.csv and .md.")
@plainly
def main(tables: tuple[Path, ...], runs: int, adversaries: str, rule: str, seed: int, out: Path) -> None:
    """Play tables against every adversary, also one that searches for the runs that fail; millions of runs."""
    writable_folder(out)  # before long work
    read = {
        path.stem: sdhj.solve(sdhj.arm_case_study(), str(path)) if str(path) in METHODS else sdhj.load(path)
        for path in tables
    }
    if len(read) < len(tables):
        raise ValueError("two of the tables have the same file name; rename one, as rows are called by it")
    rows = campaign(read, adversaries.split(","), runs=runs, rule=rule, seed=seed)
    for path in write_rows(rows, out, f"Rule {rule}, seed {seed}, sdhj {sdhj.__version__}."):
        click.echo(path)


if __name__ == "__main__":
    main()
