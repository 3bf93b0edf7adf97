"""What a store costs.

`python figures/studies/stored.py` tells the CPU seconds of solves in memory, of solves in memory that are then saved,
and of solves with a store, in turn; of each the fewest. `python figures/studies/stored.py --robot arm --nodes 20
--method lax` solves one problem with a store, once: CPU seconds, the most anonymous memory (RssAnon) beyond what the
process had before, disk, and the share won. With `--workers 2` a problem is solved by so many workers of a Dask
cluster, with one thread each, and by one of them: how long both take.
"""

import gc
import importlib
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

import click
import large
import numpy as np

import sdhj
from sdhj.cli import plainly

Clock = Callable[[], float]
MAKERS: dict[str, Callable[[int], sdhj.ReachAvoidProblem]] = {"case study": sdhj.arm_case_study}
MAKERS["turning"] = lambda nodes: turning(nodes)
MAKERS |= {name: robot.problem for name, robot in large.WORKED.items()}
COMPARED = (
    ("case study", 25, "hji"),
    ("case study", 40, "hji"),
    ("arm", 17, "hji"),
    ("arm", 17, "lax"),
    ("car", 13, "hji"),
)


def turning(nodes: int) -> sdhj.ReachAvoidProblem:
    """A car with 25 inputs among posts, of which each has games of its own; nothing depends on time."""
    speeds, rates = np.linspace(0.2, 1.0, 5), np.linspace(-1.0, 1.0, 5)
    inputs = np.stack(np.meshgrid(speeds, rates, indexing="ij"), axis=-1).reshape(-1, 2)

    def drift(q: Any, u: Any) -> Any:
        return np.stack([u[0] * np.cos(q[:, 2]), u[0] * np.sin(q[:, 2]), u[1] + 0.0 * q[:, 2]], axis=1)

    return sdhj.ReachAvoidProblem(
        sdhj.Grid([-2, -2, -np.pi], [2, 2, np.pi], [nodes, nodes, 48], [False, False, True]),
        sdhj.Dynamics(inputs, drift, np.eye(3), [0.05, 0.05, 0.1]),
        sdhj.TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 1.0, p[:, 1]) - 0.4),
        [sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0], p[:, 1]) - 0.4, name="post")],
        0.25,
        20,
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


def anonymous_memory() -> int:
    """Bytes of this process that are in memory and of no file; 0 where the system does not say."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    except OSError:  # as on Windows
        return 0
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith("RssAnon")), 0)


@contextmanager
def watched(every: float = 0.005) -> Iterator[list[int]]:
    """A context with a list whose only entry is the most bytes of `anonymous_memory` beyond those at its begin."""
    before, most, ended = anonymous_memory(), [0], threading.Event()

    def watch() -> None:
        while not ended.wait(every):
            most[0] = max(most[0], anonymous_memory() - before)

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield most
    finally:
        ended.set()
        watcher.join()


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


def solved_once(name: str, nodes: int, method: str) -> str:
    """The line of one solve with a store."""
    sdhj.solve(MAKERS[name](9), method, progress=False, play=False)  # compiles
    problem = MAKERS[name](nodes)
    with TemporaryDirectory() as folder, watched() as most:
        path = Path(folder) / "table"
        taken, table = timed(sdhj.solve, problem, method, clock=time.process_time, store=path, progress=False)
        told = f"{taken:,.0f}", f"{most[0] / 1e9:.2f} GB", f"{on_disk(path) / 1e9:.1f} GB"
        share = table.fraction(start=0, within=table.steps)
    return f"| {name}, {nodes} nodes, {method} | {' | '.join(told)} | {share:.3f} |"


def by_workers(problem: sdhj.ReachAvoidProblem, method: str, workers: int) -> float:
    """Seconds of a solve by so many workers of a Dask cluster, with one thread each, when all have compiled."""
    dask, distributed = map(importlib.import_module, ("dask", "distributed"))
    # Dask's own settings have freed memory given back at once: each array would find its pages anew.
    settings = {"distributed.nanny.pre-spawn-environ": {}}
    with TemporaryDirectory() as folder, dask.config.set(settings | {"temporary-directory": folder}):
        # For the workers alone: Numba refuses another number of threads where its own have started.
        with patch.dict(os.environ, NUMBA_NUM_THREADS="1"):
            cluster = distributed.LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None)
        with cluster, distributed.Client(cluster) as client:
            told = {"client": client, "progress": False}
            sdhj.solve(replace(problem, steps=2), method, store=Path(folder) / "first", **told)
            return timed(sdhj.solve, problem, method, store=Path(folder) / "table", **told)[0]


def shared_out(name: str, nodes: int, method: str, workers: int, repeats: int) -> str:
    """The line of solves by one worker and by several, in turn; of each the fastest."""
    problem = MAKERS[name](nodes)
    alone, shared = (
        min(one)
        for one in zip(*([by_workers(problem, method, n) for n in (1, workers)] for _ in range(repeats)), strict=True)
    )
    return f"| {name}, {nodes} nodes, {method} | {alone:.1f} | {shared:.1f} | {shared / alone:.2f} |"


@click.command(context_settings={"show_default": True})
@click.option("--robot", type=click.Choice(list(MAKERS)), help="Solve this one, once, with a store.")
@click.option("--nodes", type=click.IntRange(9), help="Of the robot's grid, along most axes; 25 where none are given.")
@click.option("--method", type=click.Choice(["hji", "lax"]), help="hji where none is given.")
@click.option("--workers", type=click.IntRange(1), help="Solve it with so many Dask workers, too.")
@click.option("--repeats", default=3, type=click.IntRange(1), help="Of each solve, where some are compared.")
@plainly
def main(robot: str | None, nodes: int | None, method: str | None, workers: int | None, repeats: int) -> None:
    """Time solves with a store. Stores are written where temporary files are (TMPDIR), and removed."""
    if robot and workers:
        click.echo(f"| problem | one worker, s | {workers} workers, s | ratio |\n|---|---|---|---|")
        click.echo(shared_out(robot, nodes or 25, method or "hji", workers, repeats))
        return
    if robot:
        click.echo("| problem | CPU s | most memory | disk | share |\n|---|---|---|---|---|")
        click.echo(solved_once(robot, nodes or 25, method or "hji"))
        return
    if nodes or method or workers:
        raise click.UsageError("all but --repeats are options of a --robot; give one of them, too")
    click.echo("| problem | in memory, CPU s | and saved | with a store | ratio | disk |\n|---|---|---|---|---|---|")
    for one in COMPARED:
        click.echo(compared(*one, repeats))


if __name__ == "__main__":
    main()
