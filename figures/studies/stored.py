"""What a store costs.

`python figures/studies/stored.py` tells the CPU seconds of solves in memory, of solves in memory that are then saved,
and of solves with a store, in turn; of each the fewest. `python figures/studies/stored.py --robot hunted --nodes 20
--method lax --memory 3800000000` solves one problem with a store, once: its slabs, time, the most memory that the
process had, disk, and the share won. With `--workers 1` the same slabs are solved once more by a Dask cluster of so
many processes: what a task costs beside what it does, and how many bytes go through the scheduler and through the
store.
"""

import gc
import importlib
import os
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click
import large
import numpy as np

import sdhj
from sdhj.cli import plainly

Clock = Callable[[], float]
MAKERS: dict[str, Callable[[int], sdhj.ReachAvoidProblem]] = {"case study": sdhj.arm_case_study}
MAKERS |= {name: robot.problem for name, robot in large.WORKED.items()}
COMPARED = (
    ("case study", 25, "hji"),
    ("case study", 40, "hji"),
    ("arm", 17, "hji"),
    ("arm", 17, "lax"),
    ("car", 13, "hji"),
)


def timed(call: Callable[..., Any], *args: Any, clock: Clock = time.perf_counter, **options: Any) -> tuple[float, Any]:
    """How long a call takes by a clock, and what it returns."""
    gc.collect()
    began = clock()
    result = call(*args, **options)
    return clock() - began, result


def on_disk(folder: Path) -> int:
    """Bytes that the files in a folder take, without what has never been written."""
    return sum(512 * file.stat().st_blocks for file in folder.rglob("*") if file.is_file())


def most_memory() -> str:
    """The most memory that this process has had, with the pages of files that the system kept for it."""
    try:
        usage: Any = importlib.import_module("resource")
    except ImportError:  # not on Windows
        return "unknown"
    unit = 1 if sys.platform == "darwin" else 1024
    return f"{usage.getrusage(usage.RUSAGE_SELF).ru_maxrss * unit / 1e9:.1f} GB"


def three_ways(problem: sdhj.ReachAvoidProblem, method: str) -> tuple[float, float, float, int]:
    """CPU s in memory, with `save`, and with a store, and the bytes of that; each finds what the last one freed."""
    worked = partial(timed, clock=time.process_time)  # without waiting for the disk and for other processes
    told = {"progress": False, "play": False}  # with a store nothing is played
    bare = worked(sdhj.solve, problem, method, **told)[0]
    with TemporaryDirectory() as folder:
        stored = worked(sdhj.solve, problem, method, store=Path(folder) / "table", **told)[0]
        size = on_disk(Path(folder) / "table")
        saved = worked(lambda: sdhj.solve(problem, method, **told).save(Path(folder) / "table.npz"))[0]
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
        path = Path(folder) / "table"
        given = {"store": path, "memory": memory}
        taken, table = timed(sdhj.solve, MAKERS[name](nodes), method, clock=time.process_time, **given)
        peak, share = most_memory(), table.fraction(start=0, within=table.steps)
        told = table.details["slabs"], f"{taken:,.0f}", peak, f"{on_disk(path) / 1e9:.1f} GB", f"{share:.3f}"
    return f"| {name}, {nodes} nodes, {method} | {' | '.join(map(str, told))} |"


def moved(client: Any) -> list[int]:
    """Bytes so far: sent by the network devices of this machine, and written by the workers of a client.

    What workers read is mapped, and counted by nobody.
    """
    psutil: Any = importlib.import_module("psutil")
    own = client.run(lambda: psutil.Process().io_counters().write_chars).values()
    return [psutil.net_io_counters().bytes_sent, sum(own)]


def by_workers(client: Any, problem: sdhj.ReachAvoidProblem, method: str, memory: int | None) -> tuple[Any, ...]:
    """Slabs, tasks, and seconds of a solve by this process and of one by workers; bytes moved by the latter."""
    with TemporaryDirectory() as folder:
        path, told = Path(folder) / "workers", {"memory": memory, "progress": False}
        alone, _ = timed(sdhj.solve, problem, method, store=Path(folder) / "alone", **told)
        before = moved(client)
        shared, table = timed(sdhj.solve, problem, method, store=path, client=client, **told)
        bytes_moved = np.subtract(moved(client), before).tolist()
        tasks = sum(map(bool, (path / "ledger").read_text().splitlines()))  # each has its line
    return table.details["slabs"], tasks, alone, shared, *bytes_moved


def shared_out(name: str, nodes: int, method: str, memory: int | None, workers: int, repeats: int) -> str:
    """The line of solves by this process and by workers that share its cores."""
    dask, distributed = map(importlib.import_module, ("dask", "distributed"))
    cores = max(1, (os.cpu_count() or 1) // workers)
    # in place of Dask's, which have freed memory given back at once: each array would find its pages anew
    environment = {"distributed.nanny.pre-spawn-environ": {"NUMBA_NUM_THREADS": cores}}
    with (
        TemporaryDirectory() as folder,
        dask.config.set(environment | {"temporary-directory": folder}),
        distributed.LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        taken = [by_workers(client, MAKERS[name](nodes), method, memory) for _ in range(repeats + 1)]
    slabs, tasks, alone, shared, sent, written = map(min, zip(*taken[1:], strict=True))  # the first compiles
    told = f"{slabs}", f"{tasks}", f"{alone:.1f}", f"{shared:.1f}", f"{(shared - alone) / tasks * 1e3:.0f} ms"
    told += f"{sent / tasks / 1e3:.0f} kB", f"{written / 1e6:,.0f} MB"
    return f"| {name}, {nodes} nodes, {method} | {' | '.join(told)} |"


@click.command(context_settings={"show_default": True})
@click.option("--robot", type=click.Choice(list(MAKERS)), help="Solve this one, once, with a store.")
@click.option("--nodes", type=click.IntRange(9), help="Of the robot's grid, along most axes; 25 where none are given.")
@click.option("--method", type=click.Choice(["hji", "lax"]), help="hji where none is given.")
@click.option("--memory", type=click.IntRange(1), help="Bytes that a slab may take.")
@click.option("--workers", type=click.IntRange(1), help="Solve it with so many Dask workers, too.")
@click.option("--repeats", default=3, type=click.IntRange(1), help="Of each solve, where some are compared.")
@plainly
def main(
    robot: str | None, nodes: int | None, method: str | None, memory: int | None, workers: int | None, repeats: int
) -> None:
    """Time solves with a store. Stores are written where temporary files are (TMPDIR), and removed."""
    if robot and workers:
        click.echo("| problem | slabs | tasks | alone, s | shared, s | more a task | sent a task | written |")
        click.echo("|---" * 8 + "|")
        click.echo(shared_out(robot, nodes or 25, method or "hji", memory, workers, repeats))
        return
    if robot:
        click.echo("| problem | slabs | CPU s | most memory | disk | share |\n|---|---|---|---|---|---|")
        click.echo(solved_once(robot, nodes or 25, method or "hji", memory))
        return
    if nodes or method or memory or workers:
        raise click.UsageError("all but --repeats are options of a --robot; give one of them, too")
    click.echo("| problem | in memory, CPU s | and saved | with a store | ratio | disk |\n|---|---|---|---|---|---|")
    for one in COMPARED:
        click.echo(compared(*one, repeats))


if __name__ == "__main__":
    main()
