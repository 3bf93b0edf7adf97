"""What a store costs.

`python figures/stored.py` times solves in memory, solves in memory that are then saved, and solves with a store, in
turn; the fastest of each is told. `python figures/stored.py --robot hunted --nodes 20 --method lax --memory 3800000000`
solves one problem with a store, once: its slabs, time, the most memory that the process had, disk, and the share won.
"""

import gc
import importlib
import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click
import large

import sdhj
from sdhj.cli import plainly

MAKERS: dict[str, Callable[[int], sdhj.ReachAvoidProblem]] = {"case study": sdhj.arm_case_study}
MAKERS |= {name: robot.problem for name, robot in large.WORKED.items()}
COMPARED = (
    ("case study", 25, "hji"),
    ("case study", 40, "hji"),
    ("case study", 40, "lax"),
    ("arm", 17, "hji"),
    ("car", 17, "hji"),
)


def timed(call: Callable[..., Any], *args: Any, **options: Any) -> tuple[float, Any]:
    """How long a call takes, and what it returns."""
    gc.collect()
    began = time.perf_counter()
    result = call(*args, **options)
    return time.perf_counter() - began, result


def on_disk(folder: Path) -> int:
    """Bytes of the files in a folder."""
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())


def most_memory() -> str:
    """The most memory that this process has had."""
    try:
        usage: Any = importlib.import_module("resource")
    except ImportError:  # not on Windows
        return "unknown"
    unit = 1 if sys.platform == "darwin" else 1024
    return f"{usage.getrusage(usage.RUSAGE_SELF).ru_maxrss * unit / 1e9:.1f} GB"


def three_ways(problem: sdhj.ReachAvoidProblem, method: str) -> tuple[float, float, float, int]:
    """Seconds in memory, with `save`, and with a store, and the bytes of that; each finds what the last one freed."""
    bare = timed(sdhj.solve, problem, method, progress=False)[0]
    with TemporaryDirectory() as folder:
        stored = timed(sdhj.solve, problem, method, store=Path(folder) / "table.zarr", progress=False)[0]
        size = on_disk(Path(folder) / "table.zarr")
        # last: the disk is busy with it for a while
        saved = timed(lambda: sdhj.solve(problem, method, progress=False).save(Path(folder) / "table.h5"))[0]
    return bare, saved, stored, size


def compared(name: str, nodes: int, method: str, repeats: int) -> str:
    """A line of the table."""
    three_ways(MAKERS[name](9), method)  # compiles
    problem = MAKERS[name](nodes)
    bare, saved, stored, size = map(min, zip(*(three_ways(problem, method) for _ in range(repeats)), strict=True))
    told = f"{bare:.1f}", f"{saved:.1f}", f"{stored:.1f}", f"{stored / bare:.2f}", f"{size / 1e6:.0f} MB"
    return f"| {name}, {nodes} nodes, {method} | {' | '.join(told)} |"


def solved_once(name: str, nodes: int, method: str, memory: int | None) -> str:
    """The line of one solve with a store."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "table.zarr"
        taken, table = timed(sdhj.solve, MAKERS[name](nodes), method, store=path, memory=memory)
        peak, share = most_memory(), table.fraction(start=0, within=table.steps)
        told = table.details["slabs"], f"{taken:,.0f}", peak, f"{on_disk(path) / 1e9:.1f} GB", f"{share:.3f}"
    return f"| {name}, {nodes} nodes, {method} | {' | '.join(map(str, told))} |"


@click.command(context_settings={"show_default": True})
@click.option("--robot", type=click.Choice(list(MAKERS)), help="Solve this one, once, with a store.")
@click.option("--nodes", type=click.IntRange(9), help="Of the robot's grid, along most axes; 25 where none are given.")
@click.option("--method", type=click.Choice(["hji", "lax"]), help="hji where none is given.")
@click.option("--memory", type=click.IntRange(1), help="Bytes that a slab may take.")
@click.option("--repeats", default=3, type=click.IntRange(1), help="Of each solve, where all are compared.")
@plainly
def main(robot: str | None, nodes: int | None, method: str | None, memory: int | None, repeats: int) -> None:
    """Time solves with a store. Stores are written where temporary files are (TMPDIR), and removed."""
    if robot:
        click.echo("| problem | slabs | s | most memory | disk | share |\n|---|---|---|---|---|---|")
        click.echo(solved_once(robot, nodes or 25, method or "hji", memory))
        return
    if nodes or method or memory:
        raise click.UsageError("--nodes, --method and --memory are those of a --robot; give one of them, too")
    click.echo("| problem | in memory, s | and saved | with a store | ratio | disk |\n|---|---|---|---|---|---|")
    for one in COMPARED:
        click.echo(compared(*one, repeats))


if __name__ == "__main__":
    main()
