"""The command line: `sdhj --help`."""

import functools
import json
import os
import re
import reprlib
import signal
import sys
import time
import uuid
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import reduce
from pathlib import Path
from pkgutil import resolve_name
from tempfile import TemporaryDirectory, gettempdir
from types import FrameType
from typing import Any, cast

import click
import numpy as np

from sdhj.arm.case_studies import arm_case_study
from sdhj.arm.workspace import KINEMATICS
from sdhj.certified.check import verify as check
from sdhj.certified.sets import Certified
from sdhj.certified.table import CertifiedTable
from sdhj.formulas.graph import Node, leaf
from sdhj.formulas.text import shown
from sdhj.kernels import FloatArray
from sdhj.kernels.compiling import announced
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.restoring import formulas_in, sets_in, tables_of
from sdhj.problem.sets import VIEW_TIMES
from sdhj.simulation.adversaries import ADVERSARIES
from sdhj.simulation.runs import MOST_RUNS, monte_carlo, outcome_name, simulate
from sdhj.solver.resolution import ResolutionWarning
from sdhj.solving import load, solve
from sdhj.table.controller import Controller
from sdhj.table.files import TEMPORARIES, VERSION, arrays_in, checked_head, header, opened, writable_file


def stop(number: int, frame: FrameType | None) -> None:
    """Delete temporary files and end the process with status 128 + the signal's number; no exception can be caught."""
    for temporary in list(TEMPORARIES):
        with suppress(OSError):
            temporary.unlink()
    what = "interrupted" if number == signal.SIGINT else "ended by a signal"
    with suppress(OSError):
        os.write(2, f"\nsdhj was {what}; no unfinished file is left, and existing files are unchanged\n".encode())
    os._exit(128 + number)


INTERPOLATED = ("hji", "projected", "lax")  # the methods whose tubes are interpolated between nodes
METHOD = click.Choice([*INTERPOLATED, "certified"])
RUNS = click.IntRange(1, MOST_RUNS)
SEED = click.IntRange(0)
VIEWS = click.Choice(VIEW_TIMES)
READINGS = click.Choice(KINEMATICS)
WARM_CELLS = (63, 63, 18, 18)  # enough cells that the tubes of the certified table grow, so that every kernel is called


class Refusal(click.ClickException):
    """One clear line on standard error, exit status 2."""

    exit_code = 2


def plainly(command: Callable[..., None]) -> Callable[..., None]:
    """Turn the library's errors into one line without a traceback, and report when kernels are compiled."""

    @functools.wraps(command)
    def wrapped(*args: Any, **kwargs: Any) -> None:
        try:
            with announced(progress=True):
                command(*args, **kwargs)
        except BrokenPipeError:  # the reader has closed the pipe; click then ends silently
            raise
        except KeyboardInterrupt:
            click.echo("\ninterrupted; no unfinished file is left, and existing files are unchanged", err=True)
            sys.exit(128 + signal.SIGINT)
        except (ValueError, OSError, MemoryError, ImportError) as error:
            raise Refusal(" ".join(str(error).split()) or type(error).__name__) from error

    return wrapped


def numbers(option: str, text: str, kind: type = float) -> list[Any]:
    """Parse numbers separated by commas."""
    try:
        return [kind(part) for part in text.split(",")]
    except ValueError:
        kinds = "whole numbers" if kind is int else "numbers"
        raise ValueError(f"--{option} must be {kinds} separated by commas, got {reprlib.repr(text)}") from None


@click.group(context_settings={"help_option_names": ["-h", "--help"], "show_default": True})
@click.version_option(VERSION, prog_name="sdhj")
def main() -> None:
    """Sampled-data Hamilton-Jacobi reachability for robust motion planning."""


@main.command("solve")
@click.option("--nodes", default=25, help="Nodes on each axis.")
@click.option("--steps", default=8, help="N, the number of sampling intervals.")
@click.option("--method", default="hji", type=METHOD, help="The method that solves the games.")
@click.option("--view-time", default="swept", type=VIEWS, help="How moving obstacles are treated within an interval.")
@click.option("--kinematics", default="relative", type=READINGS, help="The textbook arm, or Eq. (8) as printed.")
@click.option("--cells", help="With --method certified: the number of cells on each axis, separated by commas.")
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="The file to write or replace.")
@plainly
def solve_command(
    nodes: int, steps: int, method: str, view_time: str, kinematics: str, cells: str | None, output: Path
) -> None:
    """Solve the arm case study and write its look-up table."""
    if cells is not None and method != "certified":
        raise ValueError(f"--cells needs --method certified, got --method {method}; leave out one of them")
    counts = None if cells is None else numbers("cells", cells, int)
    writable_file(output)
    problem = arm_case_study(nodes=nodes, steps=steps, view_time=view_time, kinematics=kinematics)
    table = solve(problem, Certified(cells=counts) if method == "certified" else method)
    try:
        table.save(output)
    except OSError as error:  # as on a full disk
        kept = Path(gettempdir()) / f"sdhj-{uuid.uuid4().hex}.h5"
        table.save(kept)
        raise Refusal(f"{error}; the table was saved as {kept} instead") from error
    name = click.format_filename(output)
    share, seconds = table.fraction(start=0, within=steps), table.details["seconds"]
    click.echo(f"{name}: target reachable from {share:.1%} of C within {steps} steps; solved in {seconds:.1f} s")


@main.command("simulate")
@click.argument("table", type=click.Path(path_type=Path))
@click.option("--start", help="Simulate one run from this state: numbers separated by commas, for the arm q1,q2,px,py.")
@click.option("--runs", type=RUNS, show_default="10000", help="Number of runs from uniformly drawn admissible states.")
@click.option("--adversary", default="worst", type=click.Choice(list(ADVERSARIES)), help="The adversary's strategy.")
@click.option("--rule", default="deepest", help="The rule that selects one of the safe inputs.")
@click.option("--seed", default=0, type=SEED, help="Seed of the adversary and of the start states.")
@plainly
def simulate_command(table: Path, start: str | None, runs: int | None, adversary: str, rule: str, seed: int) -> None:
    """Simulate the controller of a table against an adversary."""
    state = None if start is None else np.array(numbers("start", start))
    if start is not None and runs is not None:
        raise ValueError("--start simulates one run and --runs many from random start states; give only one of them")
    controller = Controller(load(table), rule=rule)
    if state is None:
        click.echo(str(monte_carlo(controller, runs=runs or 10_000, adversary=adversary, seed=seed)))
        return
    if state.size != controller.problem.grid.ndim or not np.isfinite(state).all():
        raise ValueError(f"--start must be {controller.problem.grid.ndim} finite numbers, got {reprlib.repr(start)}")
    trajectory = simulate(controller, state, adversary=adversary, seed=seed)
    for t, at in zip(trajectory.times, trajectory.states, strict=True):
        click.echo(f"{t:7.3f} s  " + "  ".join(f"{x:+8.4f}" for x in at))
    click.echo(f"outcome: {outcome_name(trajectory.outcome, controller.problem.stays)}")


@main.command()
@click.argument("table", type=click.Path(path_type=Path))
@plainly
def info(table: Path) -> None:
    """Print what a table contains and how it was computed."""
    if (table / "zarr.json").is_file():
        store = cast(Any, load(table)).store
        head = checked_head(store.head)
        mathematics = in_mathematics(head, store.functions)
    else:
        with opened(table) as (head, file):
            mathematics = in_mathematics(head, arrays_in(file))
    grid, steps = head["grid"], head["steps"]
    name = click.format_filename(table)
    click.echo(f"{name}: {head['problem']}, method {head['method']}, written by sdhj {head['sdhj_version']}")
    for axis, (low, high, n) in enumerate(zip(grid.lower, grid.upper, grid.shape, strict=True)):
        ends = " and ".join(dict.fromkeys(grid.ends[axis]))  # of the lower and of the upper end
        kind = "periodic" if grid.periodic[axis] else f"bounded, {ends} ends"
        click.echo(f"  {grid.names[axis]}: {n} nodes on [{low:g}, {high:g}], {kind}")
    lasting = " (steps=None)" if head["details"].get("endless") else ""
    much = f"{len(head['inputs'])} inputs, view-time {head['view_time']}"
    click.echo(f"  {steps} steps of {head['delta']:g} s{lasting}, {much}")
    if head["sensing"]:
        click.echo("  sensing: " + ", ".join(f"{name} {value}" for name, value in vars(head["sensing"]).items()))
    click.echo(f"  details: {json.dumps(head['details'], sort_keys=True)}")
    click.echo(f"  problem digest: {head['digest']}")
    for line in mathematics:
        click.echo(f"  {line}")
    if opaque := head["formulas"]["opaque"]:
        click.echo("  black boxes, which a file cannot contain, so that load(path, problem=...) needs the problem:")
        for what, why in opaque.items():
            click.echo(f"    {what}: {why}")
        return
    read = load(table)
    if isinstance(read, CertifiedTable):
        steps_of = f"{read.steps_of_rounding()} steps in which all rounding, of 1e-14 each, falls to one side"
        click.echo(f"  from the states that it contains, promises hold for {steps_of}")
    shares = [read.fraction(start=0, within=n) for n in range(steps + 1)]
    click.echo("  share of C inside from step 0: " + "  ".join(f"{n}: {share:.4f}" for n, share in enumerate(shares)))


def in_mathematics(head: Mapping[str, Any], arrays: Mapping[str, FloatArray]) -> list[str]:
    """The dynamics under the first input, and the sets, of the head of a file and its tables, as lines."""
    found, grid = formulas_in(head, tables_of(arrays)), head["grid"]
    bounds, velocity = found["bounds"].entries[0], list[Node]()
    v = [f"v{d + 1}" for d in range(len(bounds))]
    if "velocity" in found:
        velocity = found["velocity"].entries[0].tolist()
    elif {"drift", "gain"} <= set(found):
        pushes = found["gain"].entries[0] * [leaf("p", 1 + d) for d in range(len(v))]
        velocity = reduce(np.add, pushes.T, found["drift"].entries[0]).tolist()
    u = ", ".join(format(one, "g") for one in head["inputs"][0])
    lines = [f"dynamics under the first of {len(head['inputs'])} inputs, u = ({u}):"]
    text, most = shown(velocity, grid.names, ["t", *v]), shown(bounds.tolist(), grid.names)[-len(v) :]
    letters, rates = text[: len(text) - len(velocity)], text[len(text) - len(velocity) :]
    text = letters + [f"d{name}/dt = {one}" for name, one in zip(grid.names, rates, strict=False)]
    text += [f"|{one}| <= {bound}" for one, bound in zip(v, most, strict=True) if bound != "0"]
    lines += [f"  {one}" for one in text]
    if all(entry["kind"] != "target" for entry in head["sets"]):
        lines.append("no target: the robot only has to stay clear")
    for name, entry in sets_in(head).items():
        if name in found:
            chosen = "" if entry.get("sampling", "nodes") == "nodes" else f", sampling {entry['sampling']}"
            *letters, value = shown(found[name].outputs, [grid.names[axis] for axis in entry["axes"]])
            lines.append(f"{entry['kind']} {entry['name']!r}{chosen}:")
            lines += [f"  {one}" for one in (*letters, f"{value} <= 0")]
    return lines


@main.command("verify")
@click.argument("table", type=click.Path(path_type=Path))
@click.option(
    "--samples",
    default=0,
    type=click.IntRange(0),
    help="Check so many random cells (of the arm, pairs of them), with Arb's arithmetic if sdhj[arb] is there; 0: all.",
)
@click.option("--seed", default=0, type=SEED, help="Seed of the random sample.")
@click.option("--problem", help="module:function that returns the problem, of a table with black boxes.")
@click.pass_context
@plainly
def verify_command(context: click.Context, table: Path, samples: int, seed: int, problem: str | None) -> None:
    """Check every claim of a certified table again."""
    if header(table)["method"] != "certified":
        how = 'solve(problem, "certified") makes a table with one, and so does `sdhj solve --method certified`'
        raise ValueError(f"{table} contains interpolated tubes, which have no proof; {how}")
    began, given = time.perf_counter(), user_problem(problem)
    if given is not None:
        load(table, problem=given)  # which compares: what is proved of another problem says nothing of the file's
    report = check(table, given, samples=samples or None, seed=seed)
    click.echo(f"{report}\ntook {time.perf_counter() - began:.1f} s")
    context.exit(0 if report.ok else 1)


def user_problem(name: str | None) -> Any:
    """Return what module:function returns; the module may lie in the current folder."""
    if name is None:
        return None
    if not re.fullmatch(r"[\w.]+:\w+", name):
        raise ValueError(f"--problem must be module:function, got {name!r}")
    sys.path.insert(0, "")
    try:
        problem = resolve_name(name)()
    except Exception as error:  # user code can raise anything
        raise ValueError(f"calling --problem {name} failed with {type(error).__name__}: {error}") from error
    if not isinstance(problem, ReachAvoidProblem):
        raise ValueError(f"--problem {name} must return a ReachAvoidProblem, got {reprlib.repr(problem)}")
    return problem


@main.command()
@plainly
def warmup() -> None:
    """Compile every kernel and store it in the disk cache."""
    compile_kernels((*INTERPOLATED, "certified"), click.echo)


def compile_kernels(methods: Sequence[str] = INTERPOLATED, say: Callable[[str], Any] = lambda line: None) -> None:
    """Compile every kernel that the methods and the controller need, by solving a small problem."""
    for method in methods:
        began = time.perf_counter()
        say(f"warming up {method}")
        chosen = Certified(cells=WARM_CELLS) if method == "certified" else method
        with warnings.catch_warnings(action="ignore", category=ResolutionWarning):  # the table is thrown away
            table = solve(arm_case_study(nodes=9, steps=2), chosen, progress=False)
        monte_carlo(Controller(table), runs=10, adversary="worst", seed=0, progress=False)
        if method == "certified":
            with TemporaryDirectory() as folder:
                table.save(path := Path(folder) / "certified.h5")
                check(path, samples=10, progress=False)
        say(f"  {time.perf_counter() - began:.1f} s")


def command() -> None:
    """Run the command `sdhj`; Ctrl-C and SIGTERM end it at once, unless they are ignored."""
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, stop)
    warnings.formatwarning = lambda message, *_, **__: f"Warning: {message}\n"
    try:
        main(prog_name="sdhj")
    except OSError as error:  # the output of --help cannot be written
        sys.exit(f"Error: {error}")
    finally:
        try:
            click.echo(nl=False)
        except OSError:  # Python would try once more at its end, and end with a traceback
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
