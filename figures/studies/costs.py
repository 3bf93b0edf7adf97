"""What tables cost: shares, seconds and megabytes of rows of problems.

`python figures/studies/costs.py verified` prints the rows of one table of the pages, `costs.py verified rail` one of
its problems. Each problem is solved in several ways, in turn, `--repeats` times; of each way the fewest seconds are
told, and what they are of the first way's ("ratio"). The first of two repeats also compiles. Seconds are the
processor's, memory is the most that the process had in memory of no file (RssAnon) beyond what it had before.

`--workers 2` solves problems by one worker of a Dask cluster and by two, with one thread each; seconds are those of
the clock there. `maze -o maze.png` draws from where the target of the maze can be reached.
"""

import ctypes
import gc
import importlib
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple
from unittest.mock import patch

import click
import large
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

import sdhj
from sdhj import plotting
from sdhj.certified.check import verify
from sdhj.certified.choosing import seconds_taken
from sdhj.cli import plainly
from sdhj.common.remembering import FloatArray
from sdhj.plotting.looks import TARGET_LOOKS, UNSAFE_LOOKS, style, writable_picture
from sdhj.table.batches import Table

sys.path.append(str(Path(__file__).parents[1]))  # the scripts are no package to install
sys.path.append(str(Path(__file__).parents[2] / "tests" / "lib"))  # where the robots are

import extra_sensing
import fleet

Problem = sdhj.ReachAvoidProblem
Prepared = tuple[Callable[[], Table], Callable[[Table], str]]  # what is timed, and what is said of its table
HEAD = """\
| problem | solved | share | seconds | ratio | memory, MB | disk, MB | |
| --- | --- | --- | --- | --- | --- | --- | --- |"""

# --------------------------------------------------------------------------------------------------------------------
# Problems that nothing else asks for
# --------------------------------------------------------------------------------------------------------------------


def coasting(q: FloatArray, u: Any) -> FloatArray:
    """d(place, speed)/dt under an acceleration."""
    return fleet.rows(q, q[:, 1], u[0])


def driving(q: FloatArray, u: Any) -> FloatArray:
    """d(x, y, heading)/dt under a speed and a turn rate."""
    return fleet.rows(q, u[0] * np.cos(q[:, 2]), u[0] * np.sin(q[:, 2]), u[1])


def turning(nodes: int) -> Problem:
    """A car with 25 inputs and a post; nothing depends on time."""
    return Problem(
        sdhj.Grid([-2, -2, -np.pi], [2, 2, np.pi], [nodes, nodes, 48], [False, False, True]),
        sdhj.Dynamics(
            fleet.every(np.linspace(0.2, 1, 5), np.linspace(-1, 1, 5)), driving, np.eye(3), [0.05, 0.05, 0.1]
        ),
        sdhj.TargetSet((0, 1), fleet.disk(1.0, 0.0, 0.4)),
        [sdhj.UnsafeSet((0, 1), fleet.disk(0.0, 0.0, 0.4), name="post")],
        delta=0.25,
        steps=20,
    )


def crane() -> Problem:
    """A trolley (x, v; m) with a load on a rope of 5 m (angle, its rate; rad) that has to come to rest."""
    degree = np.pi / 180
    at_rest = [0.3, 0.2, 2 * degree, 0.06]

    def drift(q: FloatArray, u: Any) -> FloatArray:
        swing = -9.81 / 5.0 * np.sin(q[:, 2]) - u[0] / 5.0 * np.cos(q[:, 2])
        return fleet.rows(q, q[:, 1], u[0], q[:, 3], swing)

    return Problem(
        sdhj.Grid([-1.0, -1.0, -6 * degree, -0.16], [4.0, 1.0, 6 * degree, 0.16], [33, 15, 19, 17]),
        sdhj.Dynamics([[-0.4], [0.0], [0.4]], drift, [[0.0], [0.0], [0.0], [1.0]], [0.006]),
        sdhj.TargetSet((0, 1, 2, 3), lambda p, t: np.max(np.abs(p - [3, 0, 0, 0]) / at_rest, axis=1) - 1),
        [],
        delta=0.3,
        steps=45,
    )


def fence() -> Problem:
    """A multicopter (x, y, their rates; m, m/s) in a fence that is an L, with a hole; a third of its states is outside.

    So many cells are inside an unsafe set, or beside its boundary, that marking takes most of the time.
    """
    corners = [[0, 0], [40, 0], [40, 18], [20, 18], [20, 36], [0, 36]]
    hole = sdhj.UnsafeSet.polygon([[26, 6], [32, 6], [29, 11]], name="hole")
    outside = sdhj.UnsafeSet((0, 1), sdhj.complement(sdhj.UnsafeSet.polygon(corners).level_set), name="outside")

    def drift(q: FloatArray, u: Any) -> FloatArray:
        return fleet.rows(q, q[:, 2], q[:, 3], u[0], u[1])

    return Problem(
        sdhj.Grid([-1, -1, -6, -6], [41, 37, 6, 6], [41, 37, 13, 13], ends=["unsafe", "unsafe", "wall", "wall"]),
        sdhj.Dynamics(fleet.every([-4.0, 0.0, 4.0], [-4.0, 0.0, 4.0]), drift, np.eye(4)[:, 2:], [0.5, 0.5]),
        None,
        [outside, hole],
        delta=0.2,
        steps=None,
    )


def joint(rate: int, **late: float) -> Problem:
    """A joint before its stops at +-1 rad, at most 2 rad/s, pushed by 0.1 rad/s^2, for ever; an encoder at a rate."""
    grid = sdhj.Grid([-1, -2], [1, 2], (201, 161), ends=["unsafe", "wall"])
    dynamics = sdhj.Dynamics([[-4.0], [-2.0], [0.0], [2.0], [4.0]], coasting, [[0], [1]], [0.1])
    return Problem(grid, dynamics, None, [], 1 / rate, None, sensing=sdhj.Sensing((0.002, 0.02), **late))


def standing() -> Problem:
    """A car that cannot go back, before something that blocks its lane: it stands for ever."""
    blocked = sdhj.UnsafeSet((0,), lambda p, t: np.abs(p[:, 0] - 51) - 1, name="blocked")
    dynamics = sdhj.Dynamics([[-4.0], [0.0], [2.0]], coasting, [[0], [1]], [0.2])
    grid = sdhj.Grid([0, 0], [100, 15], (201, 61), ends=["unsafe", "wall"])
    return Problem(grid, dynamics, None, [blocked], 0.5, None, sensing=sdhj.Sensing((0.05, 0.05)))


def dubins() -> Problem:
    """A car that turns, to a target past a post; its heading is known to 0.03 rad, its place to 2 cm."""
    post = sdhj.UnsafeSet((0, 1), fleet.disk(0.0, 0.0, 0.4), name="post")
    grid = sdhj.Grid([-2, -2, -np.pi], [2, 2, np.pi], (41, 41, 36), [False, False, True])
    dynamics = sdhj.Dynamics([[1.0, -2.0], [1.0, 0.0], [1.0, 2.0]], driving)
    target = sdhj.TargetSet((0, 1), fleet.disk(1.2, 0.0, 0.5))
    return Problem(grid, dynamics, target, [post], 0.05, 24, sensing=sdhj.Sensing((0.02, 0.02, 0.03)))


# ---- a vehicle in a maze
#
# `examples/vehicle` of SCOTS (Rungger & Zamani, HSCC 2016; the vehicle of Reissig, Weber & Rungger, IEEE TAC 2017, doi
# 10.1109/TAC.2016.2593947). SCOTS answers on cells of 0.2 m x 0.2 m x 0.2 rad, walls grown by half a cell, and wins
# from 48,018 of 91,035 cells. Nothing depends on time and no number of steps is given, so there is one tube for each
# number of steps to go, until none grows.

SIDE = 10.0  # m
TARGET = (9.0, 9.5, 0.0, 0.5)
WALLS = (  # x from, x to, y from, y to, m
    (1.0, 1.2, 0.0, 9.0),
    (2.2, 2.4, 0.0, 5.0),
    (2.2, 2.4, 6.0, 10.0),
    (3.4, 3.6, 0.0, 9.0),
    (4.6, 4.8, 1.0, 10.0),
    (5.8, 6.0, 0.0, 6.0),
    (5.8, 6.0, 7.0, 10.0),
    (7.0, 7.2, 1.0, 10.0),
    (8.2, 8.4, 0.0, 8.5),
    (8.4, 9.3, 8.3, 8.5),
    (9.3, 10.0, 7.1, 7.3),
    (8.4, 9.3, 5.9, 6.1),
    (9.3, 10.0, 4.7, 4.9),
    (8.4, 9.3, 3.5, 3.7),
    (9.3, 10.0, 2.3, 2.5),
)
LEVELS = 0.3 * np.arange(-3, 4)  # of the speed, m/s, and of the steering angle, rad
MAZE_CELLS = 51, 51, 72  # walls lie on the sides of such cells nowhere
SCOTS_SHARE = 48_018 / 91_035


def velocity(headings: FloatArray, speed: FloatArray, steering: FloatArray) -> FloatArray:
    """d(x, y, heading)/dt of a bicycle, (M, 3): its axles are 1 m apart, and the middle between them is followed."""
    slip = np.arctan(np.tan(steering) / 2)
    way = speed / np.cos(slip)
    turn = speed * np.tan(steering)
    return np.stack(np.broadcast_arrays(way * np.cos(slip + headings), way * np.sin(slip + headings), turn), axis=1)


def to_box(points: FloatArray, box: tuple[float, ...]) -> FloatArray:
    """Signed distance of points (M, 2) to a box of `WALLS`, m."""
    low, high = np.array(box[::2]), np.array(box[1::2])
    away = np.maximum(low - points, points - high)
    return np.hypot(*np.maximum(away, 0.0).T) + np.minimum(away.max(axis=1), 0.0)


def to_walls(points: FloatArray) -> FloatArray:
    return np.min(np.stack([to_box(points, wall) for wall in WALLS]), axis=0)


def maze(nodes: int = 61, headings: int = 36, steps: int | None = None, sampling: str = "steep") -> Problem:
    """The problem on nodes x nodes x headings; leaving the square is losing."""
    names, periodic = ["x", "y", "heading"], [False, False, True]
    return Problem(
        grid=sdhj.Grid([0, 0, -np.pi], [SIDE, SIDE, np.pi], [nodes, nodes, headings], periodic, names),
        dynamics=sdhj.Dynamics(fleet.every(LEVELS, LEVELS), lambda q, u: velocity(q[:, 2], *u), np.eye(3), np.zeros(3)),
        target=sdhj.TargetSet((0, 1), lambda points, t: to_box(points, TARGET)),
        unsafe=[sdhj.UnsafeSet((0, 1), lambda points, t: to_walls(points), name="walls", sampling=sampling)],
        delta=0.3,
        steps=steps,
        name="maze",
    )


def draw(table: Table) -> Figure:
    """For each place in the maze the share of headings from which the target is reached, and a run."""
    figure = plotting.new_figure(4.6, 4.2)
    ax, n = figure.subplots(), table.steps
    won = (table.values(start=0, within=n) <= 0).mean(axis=2)
    image = ax.imshow(won.T, extent=(0, SIDE, 0, SIDE), origin="lower", vmin=0, vmax=1, interpolation="bilinear")
    figure.colorbar(image, ax=ax, label="share of headings from which the target is reached")
    for box, looks in [*((wall, UNSAFE_LOOKS) for wall in WALLS), (TARGET, TARGET_LOOKS)]:
        ax.add_patch(Rectangle((box[0], box[2]), box[1] - box[0], box[3] - box[2], **looks))
    run = sdhj.simulate(sdhj.Controller(table), np.array([0.5, 0.5, np.pi / 2]), adversary="none")
    ax.plot(*run.states[:, :2].T, color="white", linewidth=1.4, linestyle="-")
    ax.set(xlim=(0, SIDE), ylim=(0, SIDE), xlabel="x (m)", ylabel="y (m)", aspect="equal")
    ax.set_title(f"{table.fraction(within=n):.1%} won, in at most {n} steps; the run takes {len(run.inputs)}")
    return figure


# --------------------------------------------------------------------------------------------------------------------
# Ways to solve a problem
# --------------------------------------------------------------------------------------------------------------------

solve = partial(sdhj.solve, progress=False, play=False)


def nothing(table: Table) -> str:
    return ""


def in_memory(problem: Problem, method: Any, folder: Path) -> Prepared:
    return partial(solve, problem, method), nothing


def saved(problem: Problem, method: Any, folder: Path) -> Prepared:
    def save() -> Table:
        table = solve(problem, method)
        table.save(folder / "table.npz")
        return table

    return save, nothing


def with_store(problem: Problem, method: Any, folder: Path) -> Prepared:
    return partial(solve, problem, method, store=folder / "table"), nothing


def verified(problem: Problem, method: Any, folder: Path) -> Prepared:
    """All claims of a table that is solved before."""
    table, claims = solve(problem, method), []
    table.save(file := folder / "table.npz")

    def check() -> Table:
        verdict = verify(file, everywhere=True, progress=False)
        if not verdict.ok:
            raise click.ClickException(str(verdict))
        claims.append(sum(claim.made for claim in verdict.claims))
        return table

    return check, lambda checked: f"{claims[-1]:,} claims"


def forgetting(problem: Problem, method: Any, folder: Path) -> Prepared:
    return remembering(replace(problem, sensing=replace(problem.sensing, memory=False)), method, folder)


def remembering(problem: Problem, method: Any, folder: Path) -> Prepared:
    """By loops that carry a point on from measurement to measurement, as is the default."""
    return in_memory(problem, method, folder)


def counted(problem: Problem, method: Any, folder: Path) -> Prepared:
    """With the count by which `Certified(seconds=...)` chooses cells."""

    def terms(table: Any) -> str:
        each = seconds_taken(problem, table.axes, method.parts)
        return f"counted {' + '.join(f'{term:.2f}' for term in each)} = {sum(each):.1f}"

    return partial(solve, problem, method), terms


def played(problem: Problem, method: Any, folder: Path) -> Prepared:
    """And 2,000 runs from states drawn where they are won."""

    def runs(table: Table) -> str:
        report = sdhj.monte_carlo(sdhj.Controller(table), 2000, "none")
        return f"{table.steps} steps; of {report.runs:,} runs {report.counts['reached']:,} reached"

    return partial(solve, problem, method), runs


@contextmanager
def cluster_of(workers: int) -> Iterator[Any]:
    """A client of a Dask cluster of so many workers, with one thread each."""
    dask, distributed = map(importlib.import_module, ("dask", "distributed"))
    # Dask's own settings have freed memory given back at once: each array would find its pages anew.
    settings = {"distributed.nanny.pre-spawn-environ": {}}
    with TemporaryDirectory() as folder, dask.config.set(settings | {"temporary-directory": folder}):
        # For the workers alone: Numba refuses another number of threads where its own have started.
        with patch.dict(os.environ, NUMBA_NUM_THREADS="1"):
            cluster = distributed.LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=":0")
        with cluster, distributed.Client(cluster) as client:
            yield client


def by_workers(client: Any, problem: Problem, method: Any, folder: Path) -> Prepared:
    """When all have compiled."""
    solve(replace(problem, steps=2), method, store=folder / "first", client=client)
    return partial(solve, problem, method, store=folder / "table", client=client), nothing


# --------------------------------------------------------------------------------------------------------------------
# Rows
# --------------------------------------------------------------------------------------------------------------------


class Row(NamedTuple):
    """A problem, of so many nodes where it is made for any number, the method, and the ways that are measured."""

    name: str
    make: Callable[..., Problem]
    method: Any = None
    nodes: tuple[int, ...] = ()
    ways: Sequence[Callable[[Problem, Any, Path], Prepared]] = (in_memory,)


class Measured(NamedTuple):
    table: Table
    seconds: float
    memory: int  # bytes
    disk: int
    note: str


def cells(*counts: int) -> sdhj.Certified:
    return sdhj.Certified(cells=counts)


CHECKED, STORED, SENSED = (in_memory, verified), (in_memory, saved, with_store), (forgetting, remembering)
RAIL, PENDULUM = fleet.rail().problem, fleet.pendulum().problem
TABLES: dict[str, list[Row]] = {
    "verified": [
        Row("rail", RAIL, cells(160, 160), ways=CHECKED),
        Row("pendulum", PENDULUM, cells(200, 200), ways=CHECKED),
        Row("README's car", extra_sensing.car, cells(64, 64, 63), ways=CHECKED),
        Row("README's car, finer", extra_sensing.car, cells(120, 120, 126), ways=CHECKED),
        Row("the paper's arm", sdhj.arm_case_study, cells(64, 64, 36, 36), (9,), CHECKED),
    ],
    "stored": [
        Row("case study", sdhj.arm_case_study, "hji", (25,), STORED),
        Row("case study, finer", sdhj.arm_case_study, "hji", (40,), STORED),
        Row("arm", large.WORKED["arm"].problem, "hji", (17,), STORED),
        Row("arm, lax", large.WORKED["arm"].problem, "lax", (17,), STORED),
        Row("car", large.WORKED["car"].problem, "hji", (13,), STORED),
    ],
    "storable": [  # in memory some take more than there is
        Row("case study", sdhj.arm_case_study, "hji", (41,), (with_store,)),
        Row("turning", turning, "hji", (61,), (with_store,)),
        *(Row(name, robot.problem, "hji", (robot.nodes,), (with_store,)) for name, robot in large.WORKED.items()),
    ],
    "remembering": [
        *(Row(f"joint, {rate} Hz", partial(joint, rate), ways=SENSED) for rate in (10, 20, 50, 100, 200)),
        Row("joint, 100 Hz, 8 ms late", partial(joint, 100, delay=0.008), ways=SENSED),
        Row("joint, 100 Hz, 5 ms late, 1 ms of jitter", partial(joint, 100, delay=0.005, jitter=0.001), ways=SENSED),
        Row("standing", standing, ways=SENSED),
        Row("Dubins' car", dubins, ways=SENSED),
    ],
    "maze": [Row("maze", maze, cells(*MAZE_CELLS), ways=(played,))],
    "counted": [
        Row(name, make, cells(*counts), ways=(counted,))
        for name, make, counts in (
            ("crane", crane, (128, 50, 48, 48)),  # with 70 along x it proves nothing: the recursion has nothing to do
            ("fence", fence, (121, 192, 14, 14)),
            ("maze", partial(maze, steps=20, sampling="nodes"), (128, 128, 20)),
            ("airship", fleet.airship().problem, (250, 200)),
            ("forklift", fleet.forklift().problem, (150, 100, 69)),
            ("tractor", fleet.tractor().problem, (40, 40, 40, 20)),
            ("merging", fleet.merging().problem, (80, 60, 60)),
            ("arm", fleet.arm().problem, (24, 24, 24, 12, 12)),
            ("256 inputs", fleet.many_inputs().problem, (300, 250)),
            ("crossing", fleet.crossing().problem, (120, 60, 90)),
            ("pendulum", PENDULUM, (400, 400)),
            ("air3d", fleet.air3d().problem, (150, 120, 100)),
            ("car with a pursuer", partial(large.car, 9), (24, 24, 21, 17, 17)),
        )
    ],
}


def on_disk(folder: Path) -> int:
    """Bytes that the files in a folder take, without what has never been written."""
    return sum(512 * file.stat().st_blocks for file in folder.rglob("*") if file.is_file())


def anonymous_memory() -> int:
    """Bytes of this process that are in memory and of no file; 0 where the system does not say."""
    try:
        said = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    except OSError:  # as on Windows
        return 0
    return next((1024 * int(line.split()[1]) for line in said if line.startswith("RssAnon")), 0)


def give_back() -> None:
    """What is free to the system: a solve that found the memory of the last one would seem to take none."""
    gc.collect()
    if sys.platform == "linux" and hasattr(libc := ctypes.CDLL(None), "malloc_trim"):
        libc.malloc_trim(0)


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


def measured(way: Callable[[Problem, Any, Path], Prepared], row: Row, clock: Callable[[], float]) -> Measured:
    with TemporaryDirectory() as folder:
        timed, note = way(row.make(*row.nodes), row.method, Path(folder))
        give_back()
        with watched() as most:
            began = clock()
            table = timed()
            seconds = clock() - began
        return Measured(table, seconds, most[0], on_disk(Path(folder)), note(table))


def lines(
    row: Row, repeats: int, names: Sequence[str] = (), clock: Callable[[], float] = time.process_time
) -> Iterator[str]:
    """What is printed of a row: a line for each way, of which `names` are others than its own."""
    best: list[Measured] = []
    for _ in range(repeats):  # in turn, so each finds what the others freed
        each = [measured(way, row, clock) for way in row.ways]
        best = [min(pair, key=lambda one: one.seconds) for pair in zip(best or each, each, strict=True)]
    for one, name in zip(best, names or [way.__name__.replace("_", " ") for way in row.ways], strict=True):
        table = one.table
        shape = getattr(table, "shape", table.grid.shape)  # cells that are asked for are aligned
        ratio = f"{one.seconds / best[0].seconds:.2f}" if one is not best[0] and best[0].seconds else ""
        told = [f"{row.name}, {' x '.join(map(str, shape))}", f"{table.method}, {name}"]
        told += [f"{table.fraction():.3f}", f"{one.seconds:,.1f}", ratio]
        told += [f"{size / 1e6:,.1f}" if size else "" for size in (one.memory, one.disk)]
        yield f"| {' | '.join([*told, one.note])} |"


@click.command(context_settings={"show_default": True})
@click.argument("table", type=click.Choice([*TABLES]))
@click.argument("names", nargs=-1)
@click.option("--nodes", type=click.IntRange(9), help="Along most axes, where problems are made for any number.")
@click.option("--workers", type=click.IntRange(1), help="Solve them by one Dask worker and by so many.")
@click.option("--repeats", default=2, type=click.IntRange(1), help="Of each solve; the first of them also compiles.")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="A picture of the maze: a png or pdf file.")
@plainly
def main(
    table: str, names: tuple[str, ...], nodes: int | None, workers: int | None, repeats: int, output: Path | None
) -> None:
    """Print the rows of TABLE, of all of its problems or of NAMES.

    Stores are written where temporary files are (TMPDIR), and removed.
    """
    rows = {row.name: row for row in TABLES[table]}
    if unknown := set(names) - set(rows):
        raise click.UsageError(f"{table} has {', '.join(rows)}, not {', '.join(sorted(unknown))}")
    if output is not None:
        writable_picture(output, [".png", ".pdf"])
        if table != "maze":
            raise click.UsageError("only of the maze there is a picture")
    click.echo(HEAD)
    for name in names or rows:
        row = rows[name]._replace(nodes=(nodes,)) if nodes and rows[name].nodes else rows[name]
        if workers:
            with cluster_of(1) as one, cluster_of(workers) as several:
                row = row._replace(ways=[partial(by_workers, client) for client in (one, several)])
                for line in lines(row, repeats, ["one worker", f"{workers} workers"], time.perf_counter):
                    click.echo(line)
        else:
            for line in lines(row, repeats):
                click.echo(line)
    if output is not None:
        with style():
            plotting.write(draw(solve(maze(), cells(*MAZE_CELLS))), output)
        click.echo(output)


if __name__ == "__main__":
    main()
