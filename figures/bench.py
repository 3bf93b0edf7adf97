"""Benchmarks that anyone can repeat: time and error of one reach problem, beside the fastest peer.

The problem is game 3 of the arm's case study for one sampling interval and one input, on the whole 4-D grid. The set to
be reached is a ball with a hole, in scaled coordinates: the Hopf-Lax formula then has a closed form (the farthest and
the nearest point of a box), so that every error is against the truth. The peer is hj_reachability (JAX) from
PyPI, on the same grid, with the same scheme (Lax-Friedrichs, second-order ENO, TVD-RK2), CFL number and precision. It
treats walls in its own way, so errors are counted at the nodes that no wall can have reached.

All solvers are timed in turn, several rounds of it, and the medians are compared: what else the machine does then
strikes all of them alike. `measure_case_study`, `measure_controller` and `measure_slider` time what
users wait for: whole tables, one that is solved anew when an obstacle is seen elsewhere, the controller's answers, and
pictures of games.
"""

import importlib
import importlib.metadata
import itertools
import os
import platform
import re
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import click
import numba
import numpy as np

import sdhj
from sdhj import plotting
from sdhj.arm.case_studies import arm_case_study
from sdhj.cli import INTERPOLATED, compile_kernels, numbers, plainly
from sdhj.common.remembering import FloatArray
from sdhj.plotting.looks import writable_picture
from sdhj.problem.grid import Grid
from sdhj.problem.velocities import Velocities
from sdhj.simulation.runs import admissible_states
from sdhj.solver.schemes import Scheme, evolve
from sdhj.table.controller import Controller
from sdhj.table.rules import RULES

sys.path.append(str(Path(__file__).parent / "studies"))  # the scripts are no package to install

import first

NODES = (15, 20, 25, 30, 35, 40)
LEAST_NODES = 9  # with fewer the walls reach every node
BALL = ((0.4, -0.3, 0.05, -0.02), 1.6)  # centre in the units of the axes, radius in scaled ones
HOLE = ((0.9, -0.6, 0.02, 0.03), 0.7)
NEAR = 0.3  # errors are averaged where the solution is this small: elsewhere they move no set
PEER = "hj_reachability"
PLAIN = Scheme(flux="lax-friedrichs", order=2, integrator="rk2", cfl=0.75)  # the scheme that the peer has too
QUERIES = 1000
BATCH = 100_000
Run = Callable[[], FloatArray]


@dataclass(frozen=True)
class Case:
    """One reach problem with its exact solution."""

    grid: Grid
    velocities: Velocities
    duration: float
    values: FloatArray
    exact: FloatArray
    free: FloatArray  # nodes that no wall can have reached


@dataclass(frozen=True)
class Row:
    """What was measured of one solver on one grid; times in seconds."""

    solver: str
    nodes: int
    threads: int
    seconds: float  # median
    fastest: float
    error: float  # mean of abs(solution - exact) near the boundary
    wrongly_inside: float  # share of the nodes


@dataclass(frozen=True)
class Report:
    """All rows of one run, and what they were measured on."""

    rows: tuple[Row, ...]
    machine: str
    versions: str


def case(nodes: int, dtype: str = "float32") -> Case:
    """The problem on nodes^4: the last input of the arm's case study, both joints at full speed."""
    problem = arm_case_study(nodes)
    grid, dynamics = problem.grid, problem.dynamics
    drift, gain, bounds = dynamics.arrays
    spread = np.abs(gain) @ bounds
    lower, upper = drift[-1] - spread, drift[-1] + spread
    scale = np.pi / np.where(grid.periodic, np.pi, np.array(grid.upper))

    def level_set(low: FloatArray, high: FloatArray) -> FloatArray:
        """Maximum over the box from x + low to x + high: the farthest from the ball, or the nearest to the hole."""
        farthest, nearest = np.zeros(()), np.zeros(())
        for axis in range(grid.ndim):
            x = grid.nodes(axis)
            (_, far), (near, _) = (
                _distances(grid, axis, x + low[axis], x + high[axis], centre[axis]) for centre, _ in (BALL, HOLE)
            )
            farthest = farthest[..., None] + np.square(scale[axis] * far)
            nearest = nearest[..., None] + np.square(scale[axis] * near)
        return np.maximum(np.sqrt(farthest) - BALL[1], HOLE[1] - np.sqrt(nearest))

    away = np.max([np.maximum(-lower, 0), np.maximum(upper, 0)], axis=0) * problem.delta
    return Case(
        grid=grid,
        velocities=Velocities(lower, upper),
        duration=problem.delta,
        values=level_set(0 * lower, 0 * upper).astype(dtype),
        exact=level_set(lower * problem.delta, upper * problem.delta),
        free=_inner(grid, away),
    )


def _distances(
    grid: Grid, axis: int, low: FloatArray, high: FloatArray, centre: float
) -> tuple[FloatArray, FloatArray]:
    """Least and greatest distance from `centre` over the intervals [low, high] of an axis, around it where periodic."""
    period = grid.upper[axis] - grid.lower[axis]

    def distance(x: FloatArray) -> FloatArray:
        offset = np.abs(x - centre)
        return np.abs(offset - period * np.round(offset / period)) if grid.periodic[axis] else offset

    def holds(point: float) -> FloatArray:
        """Whether the interval holds the point, or one of its images."""
        if not grid.periodic[axis]:
            return (low <= point) & (point <= high)
        return np.floor((high - point) / period) > np.floor((low - point) / period)

    least, greatest = np.minimum(distance(low), distance(high)), np.maximum(distance(low), distance(high))
    opposite = holds(centre + period / 2) & grid.periodic[axis]
    return np.where(holds(centre), 0.0, least), np.where(opposite, period / 2, greatest)


def _inner(grid: Grid, reach: FloatArray) -> FloatArray:
    """Nodes farther from all walls than the solution and its stencils carry anything: (shape) bool."""
    free = np.ones((), bool)
    for axis in range(grid.ndim):
        x, margin = grid.nodes(axis), reach[axis] + 3 * grid.spacing[axis]
        far = (x - grid.lower[axis] > margin) & (grid.upper[axis] - x > margin)
        free = free[..., None] & (far | grid.periodic[axis])
    return free


def errors(problem: Case, solution: FloatArray) -> tuple[float, float]:
    """Mean absolute error near the boundary, and the share of the nodes wrongly inside."""
    exact, got = problem.exact[problem.free], solution[problem.free]
    near = np.abs(exact) < NEAR
    return float(np.abs(got - exact)[near].mean()), float(np.mean((got <= 0) & (exact > 0)))


def ours(problem: Case, scheme: Scheme, threads: int) -> Run:
    """This library's solver with some number of threads."""

    def run() -> FloatArray:
        before = numba.get_num_threads()
        numba.set_num_threads(threads)
        try:
            return evolve(problem.grid, problem.values, problem.velocities, problem.duration, scheme)
        finally:
            numba.set_num_threads(before)

    return run


def peer(problem: Case) -> Run:
    """hj_reachability on the same problem.

    Raises
    ------
    ImportError
        Saying how to install it.
    """
    try:
        import hj_reachability as hj
        import jax
        import jax.numpy as jnp
    except ImportError as error:
        raise ImportError(
            f"the benchmark's peer is not installed ({error}): pip install 'sdhj[bench]', or measure without it, "
            "with_peer=False or --no-peer"
        ) from error
    mean = jnp.asarray((problem.velocities.low + problem.velocities.high) / 2)
    half = (problem.velocities.high - problem.velocities.low) / 2
    ndim = problem.grid.ndim

    class Arm(hj.dynamics.ControlAndDisturbanceAffineDynamics):  # type: ignore[misc]
        def __init__(self) -> None:
            still, moved = hj.sets.Box(jnp.zeros(1), jnp.zeros(1)), hj.sets.Box(jnp.asarray(-half), jnp.asarray(half))
            super().__init__("min", "max", still, moved)

        def open_loop_dynamics(self, state: Any, _: Any) -> Any:
            return mean

        def control_jacobian(self, state: Any, _: Any) -> Any:
            return jnp.zeros((ndim, 1))

        def disturbance_jacobian(self, state: Any, _: Any) -> Any:
            return jnp.eye(ndim)

    lattice = hj.Grid.from_lattice_parameters_and_boundary_conditions(
        hj.sets.Box(np.array(problem.grid.lower), np.array(problem.grid.upper)),
        problem.grid.shape,
        periodic_dims=tuple(axis for axis in range(ndim) if problem.grid.periodic[axis]),
    )
    settings = hj.SolverSettings.with_accuracy("medium", CFL_number=PLAIN.cfl)
    dynamics, values = Arm(), jnp.asarray(problem.values)

    def run() -> FloatArray:
        end = hj.step(settings, dynamics, lattice, 0.0, values, -problem.duration, progress_bar=False)
        return np.asarray(jax.block_until_ready(end))

    return run


def measure(nodes: Sequence[int] = NODES, *, repeats: int = 7, with_peer: bool = True) -> Report:
    """Time all solvers on all grids, in turn.

    Parameters
    ----------
    nodes : sequence of int
        Nodes on each of the four axes.
    repeats : int
        Rounds on each grid; the first call of each solver, which compiles, is not counted.
    with_peer : bool
        Whether to measure hj_reachability as well.

    Returns
    -------
    Report

    Raises
    ------
    ValueError
        Before anything is measured, for numbers that leave nothing to measure.
    """
    if repeats < 1 or not nodes:
        raise ValueError(f"repeats must be at least 1 and nodes not empty, got {repeats} and {tuple(nodes)}")
    if min(nodes) < LEAST_NODES:
        raise ValueError(
            f"nodes must be at least {LEAST_NODES} on each axis, got {min(nodes)}: errors are counted where no wall "
            "can reach, which with fewer is nowhere"
        )
    rows = []
    for n in nodes:
        problem = case(n)
        rows += _measure_one(problem, n, _solvers(problem, with_peer), repeats)
    return Report(tuple(rows), _machine(), _versions(with_peer))


def _solvers(problem: Case, with_peer: bool) -> dict[tuple[str, int], Run]:
    """What is measured: name and threads of each solver."""
    most = numba.get_num_threads()
    named = {"sdhj, same scheme": PLAIN, "sdhj, default": Scheme(), "sdhj, third order": Scheme(order=3)}
    solvers = {(name, most): ours(problem, scheme, most) for name, scheme in named.items()}
    if most > 1:
        solvers[("sdhj, same scheme", 1)] = ours(problem, PLAIN, 1)
    if with_peer:
        solvers[(PEER, os.cpu_count() or 1)] = peer(problem)
    return solvers


def _measure_one(problem: Case, nodes: int, solvers: dict[tuple[str, int], Run], repeats: int) -> list[Row]:
    found = {key: errors(problem, run()) for key, run in solvers.items()}  # compiles
    seconds: dict[tuple[str, int], list[float]] = {key: [] for key in solvers}
    for _ in range(repeats):
        for key, run in solvers.items():
            seconds[key].append(_timed(run))
    return [
        Row(name, nodes, threads, float(np.median(seconds[name, threads])), min(seconds[name, threads]), *error)
        for (name, threads), error in found.items()
    ]


def measure_case_study(nodes: Sequence[int], repeats: int = 3) -> dict[tuple[str, int], float]:
    """Median seconds of solving the whole case study, kernels compiled: by method and nodes."""
    for method in INTERPOLATED:
        compile_kernels("arm", method)
    found = {}
    for n in nodes:
        problem = arm_case_study(nodes=n)
        seconds: dict[str, list[float]] = {method: [] for method in INTERPOLATED}
        for _ in range(repeats):
            for method in INTERPOLATED:
                seconds[method].append(_timed(sdhj.solve, problem, method=method, progress=False))
        for method in INTERPOLATED:
            found[method, n] = float(np.median(seconds[method]))
    return found


def measure_controller(nodes: int = 25, seed: int = 0) -> dict[str, tuple[float, float]]:
    """Median and 99% quantile of what one answer takes, in seconds: by what is asked.

    Queries are single calls, of `Controller.fallback` for states that are not admissible; batches have BATCH states.
    """
    solved = sdhj.solve(arm_case_study(nodes=nodes), progress=False)
    rng = np.random.default_rng(seed)
    controller, found = Controller(solved), {}
    states = admissible_states(controller, BATCH, rng)
    anywhere = rng.uniform(solved.grid.lower, solved.grid.upper, states.shape)
    lost = anywhere[controller.batch(anywhere, 0).steps_to_go < 0]
    calls: dict[str, Any] = {f"select, rule {rule}": (Controller(solved, rule).select, states) for rule in RULES}
    calls |= {"filter": (partial(controller.filter, wanted=0), states), "fallback": (controller.fallback, lost)}
    for name, (call, points) in calls.items():
        call(points[0], 0)
        times = [_timed(call, q, 0) for q in points[:QUERIES]]
        found[name] = float(np.median(times)), float(np.quantile(times, 0.99))
    for name, points in (("batch, admissible states", states), ("batch, uniform states", anywhere)):
        controller.batch(points, 0)
        times = [_timed(controller.batch, points, 0) / BATCH for _ in range(5)]
        found[name] = float(np.median(times)), max(times)
    return found


def measure_slider(nodes: int = 25) -> float:
    """Median seconds of ten moves of chapter 10's sliders: each makes, solves and draws the arm's game anew."""
    sys.path.insert(0, str(Path(__file__).parents[1] / "notebooks"))
    explorer = importlib.import_module("course.chapter_08").explore_arm_game(nodes)
    start = {"v_d": 0.4, "v_p": 0.25, "delta": 0.11, "x": -0.2, "y": 0.12}
    second = {"v_d": 0.5, "v_p": 0.3, "delta": 0.12, "x": -0.18, "y": 0.14}
    return float(np.median([_timed(explorer.set, **{name: to[name]}) for to in (start, second) for name in to]))


def _timed(call: Callable[..., Any], *args: Any, **options: Any) -> float:
    started = time.perf_counter()
    call(*args, **options)
    return time.perf_counter() - started


def whole_table(case_study: dict[tuple[str, int], float], controller: dict[str, tuple[float, float]]) -> str:
    """What `measure_case_study` and `measure_controller` found, as lines of text."""
    lines = [f"{'whole case study':<26}{'nodes':>7}{'s':>10}"]
    lines += [f"{method:<26}{n:>7}{seconds:>10.2f}" for (method, n), seconds in case_study.items()]
    lines += ["", f"{'controller':<26}{'us':>8}{'99%':>8}{'1/s':>12}"]
    for name, (median, slow) in controller.items():
        lines.append(f"{name:<26}{1e6 * median:>8.2f}{1e6 * slow:>8.2f}{1 / median:>12.0f}")
    return "\n".join(lines)


def read(lines: Sequence[str]) -> Report:
    """The report of lines that `table` wrote, such as those in figures/kept/bench.txt."""
    pattern = r" *(\d+)  (\D+?) +(\d+) +([\d.]+) +([\d.]+) +[\d.]+ +([\d.]+) +(\S+)"
    rows = [
        Row(solver, int(nodes), int(threads), float(ms) / 1e3, float(fastest) / 1e3, float(error), float(wrong))
        for nodes, solver, threads, ms, fastest, error, wrong in (
            found.groups() for found in (re.fullmatch(pattern, line) for line in lines) if found
        )
    ]
    return Report(tuple(rows), *lines[:2])


def beside_peer(report: Report, case_study: dict[tuple[str, int], float]) -> str:
    """The whole case study by hji, and as many PDEs of hj_reachability one by one as one for each input would be."""
    lines = [f"{'hj_reachability':<26}{'nodes':>7}{'PDEs':>10}{'s':>12}{'of ours':>13}"]
    for row in report.rows:
        if row.solver == PEER and ("hji", row.nodes) in case_study:
            problem, seconds = arm_case_study(row.nodes), case_study["hji", row.nodes]
            pdes = len(problem.inputs) * problem.steps * (problem.steps + 1) // 2
            ratio = pdes * row.seconds / seconds
            lines.append(f"{'one by one':<26}{row.nodes:>7}{pdes:>10}{pdes * row.seconds:>12.1f}{ratio:>13.0f}")
    return "\n".join(lines)


def exponents(report: Report) -> dict[tuple[str, int], float]:
    """Exponent e of time ~ (all nodes)^e for each solver that was measured on two grids or more."""
    fitted = {}
    for key in dict.fromkeys((row.solver, row.threads) for row in report.rows):
        points = [(row.nodes**4, row.seconds) for row in report.rows if (row.solver, row.threads) == key]
        if len(points) > 1:
            logs = np.log(points)
            fitted[key] = float(np.polyfit(logs[:, 0], logs[:, 1], 1)[0])
    return fitted


def table(report: Report) -> str:
    """The report as lines of text: times, their ratio to this library's with the same scheme, and errors."""
    lines = [report.machine, report.versions, ""]
    head = f"{'nodes':>5}  {'solver':<20}{'threads':>7}{'ms':>10}{'fastest':>10}{'ratio':>8}{'error':>10}{'wrong':>10}"
    lines.append(head)
    reference = {row.nodes: row.seconds for row in reversed(report.rows) if row.solver == "sdhj, same scheme"}
    for row in report.rows:
        ratio = row.seconds / reference[row.nodes]
        lines.append(
            f"{row.nodes:>5}  {row.solver:<20}{row.threads:>7}{1e3 * row.seconds:>10.2f}{1e3 * row.fastest:>10.2f}"
            f"{ratio:>8.2f}{row.error:>10.5f}{row.wrongly_inside:>10.1e}"
        )
    lines += ["", "ms: median of all rounds. ratio: to sdhj with the same scheme. error: mean, near the boundary."]
    lines += ["wrong: share of the nodes inside that are not in truth."]
    lines += [f"{name}, {threads} threads: time ~ nodes^{e:.2f}" for (name, threads), e in exponents(report).items()]
    return "\n".join(lines)


LOOKS = (
    ("#a8330f", "--", "s"),
    ("#0b3c5d", "-", "o"),
    ("#46ab9f", "-.", "^"),
    ("#8c8c8c", ":", "D"),
    ("#000000", "-", "x"),
)


def plot(report: Report, path: str | os.PathLike[str]) -> Path:
    """Draw time against nodes and error against time, both logarithmic, to a file; returns its path."""
    with plotting.style():
        figure = plotting.new_figure(7.0, 3.8)
        left, right = figure.subplots(1, 2)
        pairs = dict.fromkeys((row.solver, row.threads) for row in report.rows)
        for (name, threads), (colour, line, marker) in zip(pairs, itertools.cycle(LOOKS), strict=False):
            rows = [row for row in report.rows if (row.solver, row.threads) == (name, threads)]
            label = f"{name}, {threads} thread{'s' if threads > 1 else ''}"
            looks = {"color": colour, "linestyle": line, "marker": marker, "label": label}
            left.loglog([row.nodes**4 for row in rows], [row.seconds for row in rows], **looks)
            right.loglog([row.seconds for row in rows], [row.error for row in rows], **looks)
        left.set(xlabel="nodes", ylabel="time of one reach problem (s)")
        right.set(xlabel="time of one reach problem (s)", ylabel="mean error near the boundary")
        figure.legend(*left.get_legend_handles_labels(), loc="outside upper center", ncols=3)
        left.set_title(report.machine, fontsize=7, loc="left")
    path = Path(path)
    return plotting.save(figure, path.parent, path.stem, (path.suffix[1:],))[0]


def _machine() -> str:
    model = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        model = next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), model)
    except OSError:
        pass
    return f"{model}, {os.cpu_count()} cores, {platform.system()}, Python {platform.python_version()}"


def _versions(with_peer: bool) -> str:
    names = ["numpy", "numba", *(["jax", "hj-reachability"] if with_peer else [])]
    return ", ".join(f"{name} {importlib.metadata.version(name)}" for name in names)


@click.command(context_settings={"show_default": True})
@click.option("--nodes", default="15,20,25,30,35,40", help="Nodes on each axis, separated by commas.")
@click.option(
    "--repeats", default=5, type=click.IntRange(1), help="Rounds in which all solvers take turns; medians are printed."
)
@click.option("--peer/--no-peer", "with_peer", default=True, help="Also measure hj_reachability ('sdhj[bench]').")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Plot of time and error: png, pdf, svg.")
@click.option("--kept", is_flag=True, help="Only draw what was measured last, figures/kept/bench.txt.")
@plainly
def main(nodes: str, repeats: int, with_peer: bool, output: Path | None, kept: bool) -> None:
    """Time one reach problem beside a peer, the whole case study, and the controller's answers."""
    counts = numbers("nodes", nodes, int)
    writable_picture(output)
    if kept:
        lines = (Path(__file__).parent / "kept" / "bench.txt").read_text("utf-8").splitlines()[2:]
        click.echo(plot(read(lines), output or Path("bench.png")))
        return
    report = measure(counts, repeats=repeats, with_peer=with_peer)
    click.echo(table(report) + "\n")
    case_study = measure_case_study([n for n in counts if n in (25, 40)] or [max(counts)])
    click.echo(whole_table(case_study, measure_controller()) + "\n")
    if with_peer:
        click.echo(beside_peer(report, case_study) + "\n")
    click.echo(first.table("arm", first.in_a_new_process("arm")) + "\n")
    click.echo(f"chapter 10's sliders: {measure_slider():.2f} s from a move to the picture\n")
    if output is not None:
        click.echo(plot(report, output))


if __name__ == "__main__":
    main()
